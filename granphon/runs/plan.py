"""The plan of many states: which cases there are, which media serve their loads, whether the work
can be carried out, how much memory and time it takes, and the work itself.

A scene is read, checked, estimated and run by one plan, so that nothing is computed twice. A sweep
in Python has a plan too.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.balls.loads import Load
from granphon.balls.packing import Axis, change_packing, count_combinations
from granphon.base import memory
from granphon.base.errors import (
    ConvergenceError,
    GranphonError,
    InputError,
    MechanismError,
    OutputError,
)
from granphon.base.progress import Progress, require_progress, silent
from granphon.base.staging import ResultFiles, is_whole
from granphon.base.text import require_path
from granphon.base.threads import require_executor
from granphon.base.validation import require, truth
from granphon.media import cost as costs
from granphon.media.choice import MEDIA, MediumChoice, ServingMedium
from granphon.media.cost import Cost
from granphon.media.limits import Check
from granphon.media.state import ContactState
from granphon.observables.catalogue import Analysis
from granphon.observables.validity import expect_checks, validity
from granphon.runs.dataset import (
    Dataset,
    SweepRun,
    collect_identity,
    file_names,
    load_sweep,
    write_sweep,
)
from granphon.runs.finished_tasks import Store, open_store, require_store
from granphon.runs.notes import CaseNotes, tell_notes
from granphon.runs.tasks import INCOMPLETE, Case, Grid, find_analysis, to_json
from granphon.waves.settings import (
    MOMENTS,
    READINGS,
    MotionSettings,
    NetworkSettings,
    PulseSettings,
    ResponseSettings,
    SpectrumSettings,
    WaveSettings,
)

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from granphon.media.arrangement import Balls
    from granphon.media.simulation import DirectSimulation
    from granphon.networks.network import ContactNetwork
    from granphon.waves.waves import Waves


#: a part of the work, as three entries: the path of the key that asks for the part, a sentence that
#: says how the user can make the part smaller, and the cost of the part
CostPart = tuple[tuple[str, ...], str, Cost]
#: the path of the key at which the cost of the waves of an edge stands
PLACE_OF_EDGE = ("surface", "points")
#: greatest number of cases that are all checked; of more cases, only those at the ends of the axes
#: are checked
MOST_CASES = 100
#: greatest number of states that are all solved by a survey; of more states, the survey solves the
#: ends of the axes and loads
MOST_STATES = 20_000
#: number of balls up to which a cell is repeated, about, before the product of its dynamical matrix
#: with a vector is timed
_PRODUCT_BALLS = 2000
#: greatest number of balls of an array whose waves are checked when a scene is read
QUICK_BALLS = 100_000
#: greatest number of balls, of all samples and cases together, that are brought to rest at the
#: start of a loading when a scene is read
QUICK_STARTS = 5_000
#: greatest number of vectors of a density of states: the translations and the rotations of each of
#: ten random vectors
_DOS_VECTORS = 20.0


class Places:
    """The places of errors in what the user wrote. This class is that of a sweep in Python, in
    which errors have no places and pass unchanged; the source of a scene derives from it.
    """

    def at(self, *path: str | int, prefix: str = "") -> AbstractContextManager[None]:
        """Place errors of the with-block at the key ``path``, with ``prefix`` before their text."""
        return nullcontext()

    def at_medium(self, label: str, allowed: str) -> AbstractContextManager[None]:
        """Place errors of the with-block at the key of the medium ``label``; ``allowed`` are words
        for the values of that key.
        """
        return nullcontext()

    def at_index(
        self, block: str, key: str, index: int, prefix: str = ""
    ) -> AbstractContextManager[None]:
        """Place errors of the with-block at the value number ``index``, from 0, of the ``key`` of a
        block, "load" or "sweep", with ``prefix`` before their text.
        """
        return nullcontext()

    def where_it_buckles(self) -> AbstractContextManager[None]:
        """Place an InstabilityError of the with-block at the key that keeps static forces."""
        return nullcontext()


#: the places of errors of what was not read from a file
NOWHERE = Places()


def list_parameters_of_branches(
    packing: Balls, parameters: Iterable[tuple[str, Sequence[Any]]]
) -> list[str]:
    """Return the names of the swept parameters on which the number of branches or the Brillouin
    zone may depend. Bands are not swept over these.

    ``parameters`` are pairs of the name and the values of a swept parameter, and ``packing`` is the
    packing before any of them is changed. Friction and lattices count whatever their values are;
    motions, torsion and bending count if the motions of the balls differ between their values.
    """
    names = []
    for name, values in parameters:
        # the motions of balls, which the number of branches follows, at the values of the parameter
        motions = set[Any]()
        if name in ("motions", "torsion", "bending"):
            # a value that the packing cannot have is refused later, with its place
            with suppress(InputError):
                packings = [change_packing(packing, {name: value}) for value in values]
                motions = {changed.ball_motions for changed in packings}
        if name in ("friction", "lattice") or len(motions) > 1:
            names.append(name)
    return names


@dataclass(frozen=True, eq=False)
class PlannedCase:
    """A case of a plan, one medium on one packing at all loads, with the places of its errors.

    Attributes
    ----------
    case : the case.
    load_kind : the kind of load that the user gives. It is the kind of the load of the ``case``, or
        a side force, from which the force of the contacts follows.
    places : where errors stand in what the user wrote.
    """

    case: Case
    load_kind: str
    places: Places

    @property
    def serving_media(self) -> list[ServingMedium]:
        """The media that serve the loads, see :attr:`granphon.runs.tasks.Case.serving_media`."""
        with self.places.at_medium(self.case.medium.label, "a tolerance that is met at every load"):
            return self.case.serving_media

    def states(self, quick: bool) -> Iterator[tuple[ServingMedium, ContactState]]:
        """Yield each medium and its state at the loads that it serves; with ``quick`` only media
        whose states are quick to find. A state is solved when its turn comes.

        Quantities of a state have the shape (n,) for the n loads that the medium serves, or () if
        the case has one load.
        """
        for serving in self.serving_media:
            if quick and not serving.is_quick:
                continue
            if self.case.load.size == 1:
                state = self.case.state
            else:
                with np.errstate(all="ignore"):  # what overflows is refused afterwards
                    finite_overlap = self.case.request.finite_overlap
                    state = serving.at(serving.load, finite_overlap=finite_overlap)
            yield serving, state

    @cached_property
    def quick_states(self) -> list[tuple[ServingMedium, ContactState]]:
        """Those of the :meth:`states` that are quick to find. They are solved once, after
        :meth:`require`, whose errors are raised.
        """
        self.require()
        return list(self.states(quick=True))

    def require(self) -> None:
        """Raise GranphonError if the packing has no such medium, if no medium can be chosen, or if
        the balls are found not to carry the least or the greatest of the loads.

        States that are quick to find are solved at these two loads; where the packing repeats, the
        lattice of their contacts is made, which must have contacts and be at rest. Media whose
        states are not quick to find, such as simulations, refuse what they know without solving,
        :meth:`granphon.media.medium.Medium.require`. A case that was not refused is not checked
        again.
        """
        _ = self._states_at_ends

    @cached_property
    def _states_at_ends(self) -> list[ContactState]:
        """The states that :meth:`require` solves, at most one under the least and one under the
        greatest load; errors are those of the method.
        """
        case = self.case
        ends = (int(np.argmin(case.load.array)), int(np.argmax(case.load.array)))
        states = list[ContactState]()
        for index in dict.fromkeys(ends):  # one index where all loads are equal
            serving = next(serving for serving in self.serving_media if index in serving.loads)
            with self.at_load(index, f"{case.label}: "):
                serving.medium.of(case.packing).require(case.load[index])
                if not serving.is_quick:
                    continue
                # the case keeps its state under the first load
                state = case.solve(index) if index else case.state
                if case.packing.repeats:
                    state.contact_lattice()
                states.append(state)
        return states

    def require_start(self, most: float) -> float:
        """Raise GranphonError if a load is below a start of a loading with friction that is given
        by another kind of load, say an overlap where the loads are forces. Loads of the kind of the
        start are compared in :meth:`require`.

        Such a start must be solved for before the two can be compared. This is done for at most
        ``most`` balls, as :meth:`~granphon.media.simulation.DirectSimulation.count_start` counts
        those of all samples; a medium with more balls is left out. Returns how many of the ``most``
        balls remain for other cases.
        """
        n_remaining = most
        for serving in self.serving_media:
            medium = serving.medium.of(self.case.packing)
            loads = np.ravel(self.case.load.array)[serving.loads]
            lowest = int(serving.loads[np.argmin(loads)])
            load = self.case.load[lowest]
            with self.at_load(lowest, f"{self.case.label}: "):
                n_balls = medium.count_start(load)
                if 0 < n_balls <= n_remaining:
                    medium.require_start(load)
                    n_remaining -= n_balls
        return n_remaining

    def at_load(self, index: int, prefix: str = "") -> AbstractContextManager[None]:
        """Place errors of the with-block at the load number ``index``, with ``prefix`` before their
        text; see :class:`Places`.
        """
        return self.places.at_index("load", self.load_kind, index, prefix)


def _note_limits(planned: PlannedCase) -> CaseNotes:
    """Return the notes on those states of a ``planned`` case that are quick to find: the conditions
    of validity, each joined over the media, and the indices of the loads of these states.
    """
    checks: dict[Any, Check] = {}
    loads = []
    for serving, state in planned.quick_states:
        loads.append(serving.loads)
        for check in validity(state).checks:
            key = (check.name, check.reason)
            checks[key] = checks[key].join(check) if key in checks else check
    served_loads = np.concatenate(loads) if loads else np.zeros(0, int)
    return CaseNotes(planned.case, tuple(checks.values()), served_loads)


@dataclass(frozen=True, eq=False)
class Plan:
    """How the states of a grid of cases are checked and found.

    Attributes
    ----------
    grid : the cases, and what is requested of their states.
    places : where errors stand in what the user wrote.
    load_kind : the kind of load that the user gives; by default that of the grid.
    """

    grid: Grid
    places: Places = NOWHERE
    load_kind: str = ""

    def __post_init__(self) -> None:
        """Set the kind of load if it is not given."""
        if not self.load_kind:
            object.__setattr__(self, "load_kind", self.grid.load.kind)

    @cached_property
    def observe(self) -> tuple[str, ...]:
        """The names of the observables."""
        return self.grid.request.observe

    @cached_property
    def waves(self) -> WaveSettings | None:
        """The waves that are observed in arrays and in networks; None for none."""
        return self.grid.request.waves

    @contextmanager
    def place_errors(self) -> Iterator[None]:
        """Place an error of the with-block, if the error names an option of a medium, a block or a
        load.
        """
        try:
            yield
        except GranphonError as error:
            if error.option is not None or error.block is not None:
                # such an error is placed at its own option or block, whatever path is given here
                placing: AbstractContextManager[None] = self.places.at("medium")
            elif error.load_index is None:
                raise
            else:
                placing = self.places.at_index("load", self.load_kind, error.load_index)
            with placing:
                raise

    @cached_property
    def n_cases(self) -> int:
        """Number of cases; a case is one medium at one combination of parameters."""
        return len(self.grid.media) * math.prod(len(axis.values) for axis in self.axes)

    @property
    def n_states(self) -> int:
        """Number of states; a state is one case at one load."""
        return self.n_cases * self.grid.load.size

    @cached_property
    def axes(self) -> Sequence[Axis]:
        """The swept parameters, each with its values."""
        return self.grid.axes

    @cached_property
    def cases(self) -> tuple[PlannedCase, ...]:
        """The cases: every medium at every combination of parameters, the media running fastest."""
        return self._plan_cases(self.grid)

    def _plan_cases(self, grid: Grid) -> tuple[PlannedCase, ...]:
        """Return the cases of a ``grid`` with the places of their errors."""
        return tuple(PlannedCase(case, self.load_kind, self.places) for case in grid.cases)

    @property
    def case(self) -> PlannedCase:
        """The only case of a scene of one state; :class:`~granphon.base.errors.InputError` if the
        scene is a sweep.
        """
        if self.grid.swept:
            mend = "Use states(), or the dataset of its run"
            raise InputError("the scene is a sweep", "It has many states", mend)
        return self.cases[0]

    @property
    def serving(self) -> ServingMedium:
        """The medium of a scene of one state, and its expected error; an automatic medium has made
        its choice.

        :class:`~granphon.base.errors.InputError` if none can be chosen, or if the scene is a sweep.
        """
        (serving,) = self.case.serving_media
        return serving

    @cached_property
    def has_tasks(self) -> bool:
        """Whether the work is cut into tasks, which can be done elsewhere, and are kept when they
        are finished: a sweep, or the samples of one state.
        """
        return bool(self.grid.swept) or bool(self.serving.arrays)

    @cached_property
    def checked_cases(self) -> tuple[PlannedCase, ...]:
        """All cases, or the cases at the ends of the axes if all are more than :data:`MOST_CASES`.

        The ends are taken to suffice for checks: a packing that is possible at two values of a
        parameter is nearly always possible between them. Of a parameter without numbers, as the
        lattice, every value is an end.
        """
        if self.n_cases <= MOST_CASES:
            return self.cases
        return self._plan_cases(replace(self.grid, axes=[axis.ends for axis in self.axes]))

    # -- what can be carried out -------------------------------------------------------------------

    def require(self) -> None:
        """Raise GranphonError, placed in the file, if a packing cannot have a value of a parameter,
        is not rigid or has no such medium; if a quickly solved medium cannot carry a load, or a
        load is below the start of a loading with friction; or if arrays or networks lack the waves
        that are observed. Only the :attr:`checked_cases` and small arrays are looked at.
        """
        self._require_parameters()
        with self.places.at("sweep"):
            count_combinations(self.axes)
            checked_cases = self.checked_cases
        most_balls: float = QUICK_STARTS
        for planned in checked_cases:
            most_balls = self._require_case(planned, most_balls)
        self.require_waves(QUICK_BALLS)

    def _require_parameters(self) -> None:
        """Raise GranphonError, placed in the file, for the first value of a parameter that the
        packing, its walls or its losses cannot have. If the ends of an axis are possible, its other
        values are taken to be.
        """
        for axis in self.axes:
            try:
                for value in axis.ends.values:
                    self.grid.change({axis.name: value})
            except (GranphonError, ArithmeticError):
                # again, value by value, to find the first that fails and its place
                for index, value in enumerate(axis.values):
                    with self.places.at_index("sweep", axis.name, index):
                        self.grid.change({axis.name: value})

    @property
    def _path_of_lattice(self) -> tuple[str, ...]:
        """The keys of a scene file at which the lattice stands."""
        if "lattice" in [axis.name for axis in self.axes]:
            return ("sweep", "lattice")
        # the block of a crystal, and of a packing in files, has the name of the medium
        name = self.grid.packing.medium_name
        return (name,) if name else ("packing", "lattice")

    def _require_case(self, planned: PlannedCase, most_balls: float) -> float:
        """Raise GranphonError, placed in the file, if a case cannot be carried out: the packing has
        no such medium, is not rigid where velocities or their sensitivities are observed, cannot
        carry a load, or a load is below the start of a loading.

        At most ``most_balls`` are looked at for a start; the number that remains is returned, see
        :meth:`PlannedCase.require_start`.
        """
        case = planned.case
        # sensitivities are those of velocities, and of the frequencies that are observed with them
        is_of_sound = not {"velocities", "sensitivities"}.isdisjoint(self.observe)
        has_velocities = is_of_sound and self.grid.request.sound
        allowed_medium = f"a medium for the {case.packing.structure.name} lattice"
        with self.places.at_medium(case.medium.label, allowed_medium):
            medium = case.medium.of(case.packing)
        if has_velocities:
            with self._at_lattice(case):
                try:
                    medium.require_sound()
                except MechanismError as error:
                    raise MechanismError(str(error), mend=self._mend_mechanism()) from None
        # where a medium is solved anew for each packing, the processes of a sweep solve it
        is_solved_later = bool(self.grid.swept) and medium.is_solved_anew
        if not is_solved_later:
            with self.places.at_medium(case.medium.label, allowed_medium):
                medium.prepare()
            planned.require()
            is_quick = all(serving.is_quick for serving in planned.serving_media)
            if has_velocities and is_quick:
                with self._at_lattice(case):
                    case.state.reference_lattice.require_rigid()
        return planned.require_start(most_balls)

    def _at_lattice(self, case: Case) -> AbstractContextManager[None]:
        """Place errors of the with-block at the key of the lattice of a ``case``, with words before
        their text that say what is allowed there.
        """
        refusal = f"found {case.packing.structure.name!r}; allowed: a lattice that is rigid; "
        if case.where:
            refusal += f"{case.where}: "
        return self.places.at(*self._path_of_lattice, prefix=refusal)

    def _mend_mechanism(self) -> str:
        """Return a sentence on how a scene is mended whose lattice has no velocities."""
        parameters = [(axis.name, axis.values) for axis in self.axes]
        if list_parameters_of_branches(self.grid.packing, parameters):
            return (
                "In a scene of its own it has bands and a density of states: observe: [bands, dos]"
            )
        return (
            "It has bands without velocities, and as one state a density of states: observe:"
            " [bands], or [dos]"
        )

    def require_waves(self, most: float = math.inf) -> None:
        """Raise GranphonError, placed in the file, if arrays or networks are known not to have the
        waves that are observed.

        Arrays and networks of up to ``most`` balls, a number without a unit, are looked at, and
        nothing is simulated; arrays of more than a hundred thousand balls take seconds.
        """
        waves = self.waves
        if waves is None:
            return
        has_only_dos = waves.spectrum is None and waves.pulse is None and not waves.of_networks
        if has_only_dos:  # any array has a density of states
            return
        # imported here: not all scenes need waves
        from granphon.runs.wave_records import require_friction, require_network, require_waves

        for planned in self.checked_cases:
            naming_case = partial(self._name_case, planned.case)
            for settings in waves.of_networks:
                for key in settings.of_network:
                    with self.places.at(settings.block, key), naming_case():
                        require_network(planned.serving_media, settings, key, most)
            with self.places.at("spectrum"), naming_case():
                require_waves(planned.serving_media, replace(waves, pulse=None), most)
            with self.places.at("pulse"), naming_case():
                require_waves(planned.serving_media, replace(waves, spectrum=None), most)
        cases = [planned.serving_media for planned in self.checked_cases]
        for settings in waves.of_networks:
            if isinstance(settings, MotionSettings):
                with self.places.at(settings.block, "friction_coefficient"):
                    require_friction(cases, settings, most)

    @contextmanager
    def _name_case(self, case: Case) -> Iterator[None]:
        """Raise errors of the with-block with the label of a ``case`` before their text, unless the
        plan has this case alone.
        """
        try:
            yield
        except GranphonError as error:
            if self.n_cases == 1:
                raise
            raise error.restate(f"{case.label}: {error}") from None

    # -- states ------------------------------------------------------------------------------------

    def state(self) -> ContactState:
        """Return the state of the contacts under the load.

        :class:`~granphon.base.errors.GranphonError` if the balls cannot carry the load, or the
        medium cannot be solved there; :class:`~granphon.base.errors.InputError` if the scene is a
        sweep.
        """
        planned = self.case
        # first, so that an error in choosing the medium is not placed at the load
        _ = planned.serving_media
        with planned.at_load(0):
            return planned.case.state

    @property
    def analysis(self) -> Analysis:
        """The only state with the results that several observables share."""
        return find_analysis(self.case.case.state, self.grid.request.direction)

    @property
    def records(self) -> list[Mapping[str, Any]]:
        """What is kept of the waves of the only state, arrays by name: one mapping for each sample,
        or one for the network of a state without samples. Only for a plan that requests waves.
        """
        case = self.case.case
        (task,) = case.media  # one load has one medium, in one geometry
        return [record.of_waves for record in task.list_records(case.state)]

    def states(self, quick: bool = False) -> Iterator[tuple[str, ContactState]]:
        """Return an iterator over every medium at every combination of parameters, which gives its
        label and its state.

        Quantities of a state have the shape (n,) for the n loads that the medium serves, or () if
        the scene has one load. A state is solved when its turn comes; ``quick`` leaves out
        simulations and effective media of long lists.
        :class:`~granphon.base.errors.GranphonError` at the first medium that cannot carry the
        loads.
        """
        return self._solve(self.cases, quick)

    def _solve(
        self, cases: Iterable[PlannedCase], quick: bool
    ) -> Iterator[tuple[str, ContactState]]:
        """Yield label and state of each medium of the ``cases``, or with ``quick`` of those alone
        whose states are quick to find. Each case is checked first (:meth:`PlannedCase.require`).
        """
        for planned in cases:
            planned.require()
            for serving, state in planned.states(quick):
                yield planned.case.name(serving), state

    @property
    def is_surveyed_whole(self) -> bool:
        """Whether a survey looks at all states, and not only at the ends of axes and loads."""
        return self.n_cases <= MOST_CASES and self.n_states <= MOST_STATES

    @cached_property
    def surveyed_cases(self) -> tuple[PlannedCase, ...]:
        """The cases of a survey: all, or, of more than :data:`MOST_CASES` cases or
        :data:`MOST_STATES` states, those at the least and the greatest load and value of each
        numeric parameter, and at every value of another parameter.
        """
        if self.is_surveyed_whole:
            return self.cases
        loads = self.grid.load
        # indices of the least and the greatest load, which may be one
        ends = [*dict.fromkeys((int(np.argmin(loads.array)), int(np.argmax(loads.array))))]
        written = self.grid.written
        load_as_given = None if written.load is None else written.load[ends]
        grid = replace(
            self.grid,
            axes=[axis.ends for axis in self.axes],
            load=loads[ends],
            written=replace(written, load=load_as_given),
        )
        return self._plan_cases(grid)

    def collect(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the attributes ``names`` of all n states of the :attr:`surveyed_cases`, as arrays
        (n,) by name, in SI units; an empty mapping if some states are not quick to find.
        """
        cases = self.surveyed_cases
        if not all(serving.is_quick for planned in cases for serving in planned.serving_media):
            return {}
        states = [state for planned in cases for _serving, state in planned.quick_states]
        return {
            name: np.concatenate([np.ravel(getattr(state, name)) for state in states])
            for name in names
        }

    def survey(self) -> tuple[Iterator[CaseNotes], str]:
        """Return an iterator over notes on the :attr:`surveyed_cases`, and words for the states
        that are left out, an empty text for none.

        The notes of a case are the conditions of validity on its states that are quick to find. The
        states are solved as the iterator comes to their case. Simulations and effective media of
        long lists are left out, and so are all states that are not among the surveyed cases.
        """
        left_out = list[str]()
        cases = self.surveyed_cases
        if not self.is_surveyed_whole:
            left_out.append(f"all but the ends of {self.n_states:,} states")
        slow_names = {
            serving.medium.name
            for planned in cases
            for serving in planned.serving_media
            if not serving.is_quick
        }
        for name in MEDIA:
            slow_part = MEDIA[name].slow_part if name in slow_names else ""
            if slow_part:
                left_out.append(slow_part)
        entries = (entry for entry in map(_note_limits, cases) if entry.has_states)
        return entries, " and ".join(left_out)

    def foresee_warnings(self) -> tuple[list[str], str]:
        """Return the warnings that are known before a run, and words for the states that are left
        out, as :meth:`survey` gives them. Known are those of simulations, and of states that are
        quick to find.
        """
        entries, left_out = self.survey()
        with self.places.where_it_buckles():
            notes = list(entries)
        return tell_notes([*notes, *self._expect_notes()]), left_out

    def _expect_notes(self) -> list[CaseNotes]:
        """Return the notes on cases that are known before simulations are run; none on simulations
        that were chosen automatically.
        """
        entries = list[CaseNotes]()
        for planned in self.checked_cases:
            for serving in planned.serving_media:
                if not serving.chosen_automatically:
                    for medium in serving.arrays:
                        checks = expect_checks(medium, serving.load)
                        entries.append(CaseNotes(planned.case, checks, serving.loads))
        return entries

    # -- work --------------------------------------------------------------------------------------

    def sweep(
        self,
        progress: Progress = silent,
        executor: Executor | None = None,
        *,
        path: str | os.PathLike[str] | None = None,
        resume: bool = False,
        overwrite: bool = False,
        store: Store | None = None,
    ) -> Dataset:
        """Compute every state as one data set; arguments and errors are those of
        :func:`granphon.runs.sweep.sweep`.

        Raises :class:`~granphon.base.errors.InputError` for a load that cannot be carried, as a
        :class:`~granphon.base.errors.SceneError` if a scene was read from a file; and
        :class:`~granphon.base.errors.ConvergenceError` for a load that a computation does not
        reach.
        """
        require_executor(executor)
        require_progress(progress)
        if store is not None:
            require_store(store)
        require("resume", truth, resume)
        require("overwrite", truth, overwrite)
        _require_path(path, resume)
        self.require_waves()
        placing = nullcontext() if self.has_tasks else self.places.where_it_buckles()
        with self.place_errors(), placing:
            return self._sweep(progress, executor, path, resume, overwrite, store)

    def _sweep(
        self,
        progress: Progress,
        executor: Executor | None,
        path: str | os.PathLike[str] | None,
        resume: bool,
        overwrite: bool,
        store: Store | None,
    ) -> Dataset:
        """Carry out :meth:`sweep`, which has the same arguments: compute what is not finished, and
        write the file at ``path``, if one is given, whole.
        """
        run = SweepRun.of(self.grid)
        if path is None:
            return self._do(run, executor, progress, store)
        target = Path(path)
        if resume and not overwrite:
            earlier_sweep = _load_finished_sweep(run, target)
            if earlier_sweep is not None:
                return earlier_sweep
        incomplete_names = _name_incomplete_files(target.name)
        files = ResultFiles(target.parent, file_names(target), overwrite, earlier=incomplete_names)
        store_beside = open_store(target.with_name(f".{target.name}.partial"), force=overwrite)
        opened_store = store_beside if store is None else nullcontext(store)
        with files.open() as locked, opened_store as task_store:
            try:
                dataset = self._do(run, executor, progress, task_store)
            except ConvergenceError as error:
                if error.reached is None:
                    raise
                # a store of the caller is not cleared
                own_store = task_store if store is None else None
                raise keep_incomplete(error, locked, target.name, own_store) from None
            with locked.staging() as stage:
                write_sweep(dataset, stage / target.name)
        return dataset

    def _do(
        self, run: SweepRun, executor: Executor | None, progress: Progress, store: Store | None
    ) -> Dataset:
        """Do the tasks of a ``run``, as :meth:`SweepRun.do` does with the same arguments, and
        return their data set.
        """
        if not self.has_tasks:
            _ = self.state()  # first, so that its errors are placed at the load
        return run.join(run.do(executor, progress, store))

    # -- cost --------------------------------------------------------------------------------------

    def add_costs(self, parts: Iterable[CostPart]) -> Cost | None:
        """Return memory and time that ``parts`` of the work take, done one after the other; None if
        both are negligible for every part.

        :class:`~granphon.base.errors.InputError` if more memory is needed than is available on this
        machine now, or more than 10,000 days on one processor.
        """
        told_parts = [(path, mend, cost) for path, mend, cost in parts if cost.tells]
        if not told_parts:
            return None
        total = sum((cost for _, _, cost in told_parts), Cost())
        free_memory = memory.available_memory()  # bytes
        most_seconds = costs.MOST_SECONDS
        if total.memory > free_memory:
            limit = f"this machine has {free_memory / 1e9:.3g} GB of memory available"
            sizes = [cost.memory for _, _, cost in told_parts]
        elif total.takes_longer(most_seconds):
            duration = costs.write_duration(most_seconds)
            limit = f"no run may take more than {duration} on one processor"
            sizes = [cost.seconds for _, _, cost in told_parts]
        else:
            return total
        # the error stands at the key of the largest part
        path, mend, _ = told_parts[sizes.index(max(sizes))]
        with self.places.at(*path):
            raise InputError(f"{total.text}, and {limit}", mend=mend)

    @cached_property
    def parts(self) -> list[CostPart]:
        """The parts of the work on states that may take much memory or time, each with its place in
        the scene file.
        """
        return [
            self._cost_simulations(),
            self._cost_sensitivities(),
            *self._cost_networks(),
            self._cost_waves(),
            *self._cost_packings(),
            *self._cost_edges(),
            *self._cost_waves_of_edge(),
            *self._cost_states(),
            *self._cost_derivatives(),
        ]

    @cached_property
    def _arrays(self) -> list[tuple[DirectSimulation, Load]]:
        """The simulations of the checked cases, each with its loads."""
        return [
            (medium, serving.load)
            for case in self.checked_cases
            for serving in case.serving_media
            for medium in serving.arrays
        ]

    def _add_over_cases(self, works: list[Cost]) -> Cost:
        """Return the cost of a part of the work in all cases, done one after the other. ``works``
        are the costs of this part in the :attr:`checked_cases`, in which a case may have several or
        none.

        If only the cases at the ends of axes are checked, every case is taken to have as many works
        as the checked cases have in the mean, each as large as the largest of ``works``.
        """
        n_checked = len(self.checked_cases)
        if n_checked == self.n_cases or not works:
            return sum(works, Cost())
        # compared by their numbers of units of work: to compare times, these would be measured
        largest = max(works, key=lambda work: sum(unit.number for unit in work.units))
        return largest.times(len(works) * self.n_cases / n_checked)

    def _cost_simulations(self) -> CostPart:
        """Return the part of the work that finds arrays at rest, whose cost may be zero."""
        has_velocities = "velocities" in self.observe
        works = [
            costs.estimate(medium, load, exponents=has_velocities) for medium, load in self._arrays
        ]
        mend = "Take fewer balls (medium.simulation.shape), samples or loads"
        return ("medium",), mend, self._add_over_cases(works)

    def _cost_sensitivities(self) -> CostPart:
        """Return the part of the work that finds derivatives by parameters of arrays; its cost is
        zero without them.
        """
        total = Cost()
        if "sensitivities" in self.observe:
            from granphon.observables.parameters import list_parameters  # other runs do not need it

            works = list[Cost]()
            for medium, load in self._arrays:
                # of a load only the kind is a parameter, and the kind is the same at all values
                n_parameters = len(list_parameters(medium.packing, load))
                works.append(costs.estimate_sensitivities(medium, load, n_parameters))
            total = self._add_over_cases(works)
        mend = "Take fewer balls (medium.simulation.shape), samples or loads"
        return ("medium",), mend, _describe_once(total)

    def _cost_derivatives(self) -> list[CostPart]:
        """Return the part of the work that finds derivatives by parameters of states that are no
        arrays; empty without them.
        """
        if "sensitivities" not in self.observe:
            return []
        from granphon.runs.sensitivities import estimate_derivatives  # other runs do not need it

        works = [
            estimate_derivatives(
                serving,
                has_cutoffs="cutoffs" in self.observe,
                surface=self.grid.request.surface,
            )
            for serving in self._media_without_arrays
        ]
        if not works:
            return []
        total = self._add_over_cases(works)
        mend = "Take fewer loads, values or balls, or leave sensitivities out"
        return [(("observe",), mend, _describe_once(total))]

    @property
    def _media_without_arrays(self) -> list[ServingMedium]:
        """The media that serve the checked cases without simulated arrays: with lattices, crystals,
        or packings in files.
        """
        return [
            serving
            for case in self.checked_cases
            for serving in case.serving_media
            if not serving.arrays
        ]

    def _cost_waves(self) -> CostPart:
        """Return the part of the work that finds the waves in arrays; its cost is zero without
        waves.
        """
        total = Cost()
        settings = self.waves
        if settings is not None:
            works = list[Cost]()
            for medium, load in self._arrays:
                works += _estimate_waves(medium, load, settings)
            total = self._add_over_cases(works)
        mend = (
            "Take fewer balls (medium.simulation.shape), fewer wave vectors or a coarser"
            " resolution (spectrum)"
        )
        return ("medium",), mend, _describe_once(total)

    def _cost_packings(self) -> list[CostPart]:
        """Return the part of the work that finds the sound and the waves in packings of files;
        empty without them.
        """
        has_sound = "velocities" in self.observe
        if not self.grid.packing.is_network or (self.waves is None and not has_sound):
            return []
        works = [
            _estimate_packing(serving, self.waves, has_sound)
            for case in self.checked_cases
            for serving in case.serving_media
        ]
        total = self._add_over_cases(works)
        mend = "Observe less, or take fewer wave vectors or a coarser resolution (spectrum)"
        return [(("observe",), mend, _describe_once(total))]

    def _cost_networks(self) -> list[CostPart]:
        """Return the parts of the work that find the motions and the responses of networks; a part
        that the scene does not observe is left out.
        """
        parts: list[CostPart] = []
        for block, estimate, other_mend in (
            ("motion", _estimate_motion, "a shorter motion.duration or fewer motion.frames"),
            ("response", _estimate_response, "fewer response.frequencies, or give more losses"),
        ):
            settings = self._find_network_settings(block)
            if settings is None:
                continue
            with self.places.at(block):
                works = [
                    estimate(serving, settings)
                    for case in self.checked_cases
                    for serving in case.serving_media
                ]
            total = self._add_over_cases([work for work in works if work is not None])
            mend = f"Take fewer balls ({block}.repeat, {block}.cut), {other_mend}"
            parts.append(((block,), mend, _describe_once(total)))
        return parts

    def _find_network_settings(self, block: str) -> Any:
        """Return the settings of a ``block`` about networks, "response", "motion" or "modes"; None
        if the scene does not observe it.
        """
        networks: Sequence[NetworkSettings] = self.waves.of_networks if self.waves else ()
        return next((settings for settings in networks if settings.block == block), None)

    @property
    def n_branches(self) -> int:
        """Number of branches of the lattice."""
        packing = self.grid.packing
        return packing.structure.n_balls * packing.ball_motions.count

    @property
    def n_path_points(self) -> int:
        """Number of wave vectors along the path of the bands, 0 without bands. The path is that of
        a scene, a list of pieces.
        """
        if self.grid.request.path is None:
            return 0
        pieces, n_points, _labels = self.grid.request.path
        return n_points * sum(len(piece) - 1 for piece in pieces)

    def _cost_states(self) -> list[CostPart]:
        """Return the part of the work that finds the states of a sweep, with their bands; empty for
        one state, whose numbers are few beside its bands.
        """
        if not self.grid.swept:
            return []
        path: tuple[str, ...] = ("sweep",) if self.axes else ("load", self.load_kind)
        mend = "Take fewer loads or values"
        n_points = self.n_path_points
        if n_points:
            path = ("phonopy", "band_points")
            mend += ", or points of the bands (phonopy.band_points)"
        n_frequencies = n_points * self.n_branches
        cost = costs.sweep_states(self.n_cases, self.grid.load.size, n_frequencies)
        return [(path, mend, cost)]

    def _cost_edges(self) -> list[CostPart]:
        """Return the part of the work that finds the edges of the bands in the whole zone; empty if
        the scene observes none.
        """
        of_zone = self.grid.request.of_zone
        if not of_zone:
            return []
        from granphon.phonons.paths import choose_gap_mesh  # other runs do not need it

        structure = self.grid.packing.structure
        n_points = math.prod(choose_gap_mesh(structure.n_balls, structure.periods))
        estimate = partial(
            costs.band_edges,
            self.n_states,
            n_points,
            self.n_branches,
            of_network=self.grid.packing.is_network,
        )
        # the edges of gaps are among the cut-offs; onsets seek the lowest edge alone
        total = estimate(of_all="cutoffs" in of_zone)
        mend = "Take fewer loads or values, or leave the edges of bands out"
        return [(("observe",), mend, _describe_once(total))]

    def _cost_waves_of_edge(self) -> list[CostPart]:
        """Return the part of the work that finds the waves of an edge; empty if the scene observes
        none.
        """
        surface = self.grid.request.surface
        if surface is None:
            return []
        from granphon.runs.edge_costs import estimate_edge  # other runs do not need it

        works = [estimate_edge(serving, surface) for serving in self._media_without_arrays]
        if not works:
            return []
        total = self._add_over_cases(works)
        mend = "Take fewer points, loads or balls"
        return [(PLACE_OF_EDGE, mend, _describe_once(total))]


def _describe_once(total: Cost) -> Cost:
    """Return the cost ``total`` of works of one kind with the words for the first work alone, which
    serve for all.
    """
    return replace(total, parts=total.parts[:1])


def _estimate_waves(medium: DirectSimulation, load: Load, settings: WaveSettings) -> Iterator[Cost]:
    """Yield, for each value of the ``load``, the estimated memory and time of the density of
    states, spectral functions and pulse of the ``settings`` in the arrays of a simulation,
    ``medium``, all samples together.
    """
    packing = medium.packing
    structure = medium.packing.structure
    n_contacts = len(structure.contacts) / structure.n_balls  # per ball
    n_directions = structure.periods if packing.friction else 1  # in which a contact deforms
    spectrum = settings.spectrum
    pulse = settings.pulse
    for force in costs.estimate_contact_force(packing, load).tolist():
        # equal balls at the same mean force stand for those of the samples
        state = MediumChoice("ala").of(packing).at(Load.only(force=force))[0]
        # Hz, a bound for differing balls too
        top = 1.5 * state.contact_lattice().top_frequency * state.scales.frequency
        n_products = 0.0  # of the dynamical matrix with a vector, in one sample
        if settings.dos:
            n_products += _DOS_VECTORS * 0.5 * MOMENTS  # each product gives two moments
        if spectrum is not None:
            n_products += _count_spectrum_products(medium, spectrum, settings.path, top)
        n_heard = 0.0  # products in one sample times the balls at which the pulse is read
        n_readings = 0.0  # times at which the pulse is read times these balls, in all samples
        if pulse is not None:
            length = _find_pulse_length(medium, state.network, pulse, settings.direction)
            # the burst, and the pulse on three times its way
            duration = pulse.cycles / pulse.frequency + 3.0 * length / state.scales.velocity  # s
            n_steps = math.pi * top * duration  # a product for each half period of the top
            n_products += n_steps
            # the planes of balls that hear the pulse are largest across the shortest side
            n_heard = n_steps * medium.balls / min(medium.cells)
            n_readings = READINGS * pulse.frequency * duration * n_heard * medium.samples
        yield costs.array_waves(
            partial(_measure_product, state.network, medium.balls),
            products=n_products * medium.samples,
            balls=medium.balls,
            contacts=n_contacts,
            rows=n_contacts * n_directions,
            heard=n_heard,
            readings=n_readings,
        )


def _find_pulse_length(
    medium: DirectSimulation, network: ContactNetwork, pulse: PulseSettings, direction: Any
) -> float:
    """Return the distance, m, that a ``pulse`` along the ``direction`` goes in an array of the
    simulation ``medium``, of which ``network`` is one cell.

    A distance that the ``pulse`` gives is returned as it is, also one longer than the array. The
    distance is 0 where :meth:`~granphon.waves.pulses.PulseSource.of` finds none.
    """
    # imported here: other scenes do not need it
    from granphon.waves.pulses import PulseSource

    # the array has longer periods than its cell, and the balls of one cell stand for all of them
    cell = network.cell.copy()
    cell[: len(medium.cells)] *= np.array(medium.cells)[:, None]
    names = ("pbc", "positions", "radii", "moving", "dimension")
    array: Any = SimpleNamespace(cell=cell, **{name: getattr(network, name) for name in names})
    with suppress(InputError):
        return float(PulseSource.of(pulse, array, direction).distance)
    return 0.0


def _estimate_packing(
    serving: ServingMedium, settings: WaveSettings | None, has_sound: bool
) -> Cost:
    """Return the estimated memory and time of what a scene observes in the packing in files that a
    medium serves: with ``has_sound`` the moduli and sound velocities, and with ``settings`` their
    density of states, spectral functions and pulse.
    """
    # imported here: other scenes do not need it
    from granphon.runs.wave_records import find_typical_state
    from granphon.waves.waves import Waves

    network = find_typical_state(serving).network
    waves = Waves(network)
    works = list[Cost]()
    if has_sound:
        works.append(waves.estimate("moduli"))
    if settings is not None:
        works += _estimate_packing_waves(waves, settings)
    return sum(works, Cost())


def _estimate_packing_waves(waves: Waves, settings: WaveSettings) -> Iterator[Cost]:
    """Yield the estimated memory and time of the density of states, of the spectral functions of
    each polarisation and of the pulse of the ``settings``, in a packing in files with these
    ``waves``.
    """
    # imported here: other scenes do not need it
    from granphon.waves.estimates import WaveEstimate
    from granphon.waves.path_spectra import find_packing_points
    from granphon.waves.pulses import PulseSource

    if settings.dos:
        yield waves.estimate("dos")
    spectrum = settings.spectrum
    if spectrum is not None:
        q = find_packing_points(waves.network, settings.path, spectrum.points).q
        for polarisation in spectrum.polarisation:
            yield waves.estimate("spectral_function", q, polarisation, spectrum.resolution)
    pulse = settings.pulse
    if pulse is not None:
        # a pulse that cannot be sent has a note in place of numbers, and takes no time
        with suppress(InputError):
            source = PulseSource.of(pulse, waves.network, settings.direction)
            yield WaveEstimate(waves.operator).find_pulse(source)


def _count_spectrum_products(
    medium: DirectSimulation, spectrum: SpectrumSettings, path: Any, top: float
) -> float:
    """Return the number of products of the dynamical matrix with a vector for the spectral
    functions of a ``spectrum`` in one sample of a simulation, ``medium``, along the pieces of a
    ``path``; ``top`` is the greatest frequency, Hz.
    """
    # each point of the path becomes the nearest wave vector that the array has, of which there are
    # as many along a leg as cells
    n_points_of_leg = min(spectrum.points - 1, max(medium.cells))
    n_vectors = n_points_of_leg * sum(len(piece) - 1 for piece in path)
    n_products = 0.5 * MOMENTS  # each product gives two moments
    if spectrum.resolution is not None:
        # the resolution of M moments is pi top / 2M, and M/2 products give them
        n_products = max(n_products, 0.25 * math.pi * top / spectrum.resolution)
    # a wave is complex, so that each moment takes two products
    return 2.0 * n_products * n_vectors * len(spectrum.polarisation)


def _measure_product(network: ContactNetwork, balls: int) -> float:
    """Return the measured time per ball, s, of a product of the dynamical matrix with a vector.

    The matrix is that of ``network``, repeated along its periods to about as many balls as the
    smaller of ``balls`` and :data:`_PRODUCT_BALLS`. A network that has more stays as it is.
    """
    # imported here: other scenes do not need it
    from granphon.waves.operator import make_operator

    n_periods = sum(bool(is_periodic) for is_periodic in network.pbc)
    most_cells = min(balls, _PRODUCT_BALLS) / network.n_balls
    n_cells = max(round(most_cells ** (1.0 / max(n_periods, 1))), 1)  # along each period
    if n_cells > 1 and n_periods:
        network = network.repeat((n_cells,) * n_periods)
    operator = make_operator(network)
    displacements = np.linspace(0.0, 1.0, operator.size)
    velocities = np.zeros(operator.size)
    seconds = costs.time_once(lambda: operator.advance(displacements, velocities))
    return seconds / network.n_balls


def _estimate_response(serving: ServingMedium, settings: ResponseSettings) -> Cost | None:
    """Return the estimated memory and time of the responses of the ``settings`` in the networks of
    a medium, ``serving``, at all its loads, in all samples. None if no state of the medium is
    quickly found, or if the network, repeated and cut, has more than :data:`QUICK_BALLS` balls.

    Raises :class:`~granphon.base.errors.ConvergenceError` for a response that would be refused.
    """
    # imported here: other scenes do not need it
    from granphon.dynamics.damping import GivenLosses, Losses
    from granphon.runs.wave_records import find_typical_state
    from granphon.waves.operator import make_operator
    from granphon.waves.response import ResponseWork

    state = find_typical_state(serving)
    if state is None:
        return None
    array = next(iter(serving.arrays), None)
    n_balls = state.network.n_balls if array is None else array.balls
    if settings.count_balls(n_balls) > QUICK_BALLS:
        return None
    whole_network = state.network if array is None else state.network.repeat(array.cells)
    network = settings.shape(whole_network)
    losses = Losses.of(network, GivenLosses(**settings.losses))
    omega = 2.0 * math.pi * np.array(settings.frequencies)  # rad/s
    work = ResponseWork(make_operator(network), losses, omega)
    is_factorised, seconds = work.choose(None)
    cost_of_network = costs.response(
        partial(_measure_product, state.network, network.n_balls),
        products=seconds / work.step_time,  # the time of factors is counted in products too
        balls=network.n_balls,
        contacts=network.n_contacts,
        frequencies=len(settings.frequencies),
        factors=work.factor_bytes if np.any(is_factorised) else 0.0,
    )
    n_samples = 1 if array is None else array.samples
    return cost_of_network.times(serving.load.size * n_samples)


def _estimate_motion(serving: ServingMedium, settings: MotionSettings) -> Cost | None:
    """Return the estimated memory and time of the motions of the ``settings`` in the networks of a
    medium, ``serving``, at all its loads, in all samples; None if no state of the medium is quickly
    found.

    Raises :class:`~granphon.base.errors.InputError` for more steps than any motion may have.
    """
    # imported here: other scenes do not need it
    from granphon.runs.wave_records import find_typical_state, make_waves
    from granphon.waves.nonlinear import require_steps

    state = find_typical_state(serving)
    if state is None:
        return None
    network = state.network
    array = next(iter(serving.arrays), None)
    n_cells = settings.count_balls(1 if array is None else math.prod(array.cells))
    step = settings.step  # s
    if not step:
        # a few cells have the contacts of the whole array, but for its edges, and so its step
        few_cells = network
        if any(network.pbc):
            few_cells = network.repeat((3,) * sum(network.pbc))
        step = make_waves(state, few_cells, settings).find_step(**settings.extremes)
    n_steps_of_frame = math.ceil(settings.duration / (settings.frames - 1) / step)
    n_steps = n_steps_of_frame * (settings.frames - 1)
    require_steps(n_steps)
    n_balls = n_cells * network.n_balls
    cost_of_motion = costs.motion(
        partial(_measure_product, network, n_balls),
        steps=n_steps,
        balls=n_balls,
        contacts=n_cells * network.n_contacts,
        frames=settings.frames,
        has_dashpots=settings.has_dashpots,
        is_implicit=settings.scheme == "midpoint",
    )
    n_samples = 1 if array is None else array.samples
    return cost_of_motion.times(serving.load.size * n_samples)


def _require_path(path: str | os.PathLike[str] | None, resume: bool) -> None:
    """Raise InputError for the ``path`` of a sweep that is not the name of a netCDF file, and for
    ``resume`` without a path.
    """
    if path is None and resume:
        problem = "a sweep without a path cannot be resumed"
        raise InputError(problem, "Its finished parts are kept beside its file", "Give path")
    if path is None:
        return
    require_path(path)
    if Path(path).suffix != ".nc":
        raise InputError(
            f"{Path(path)} does not end in .nc", "It is a netCDF file, with a .csv beside it"
        )


def _load_finished_sweep(run: SweepRun, path: Path) -> Dataset | None:
    """Return the sweep that the file ``path`` holds, if its files are whole and its inputs and
    versions are those of ``run``; None otherwise. Raises what :func:`load_sweep` raises for a file
    that is damaged.
    """
    if not is_whole(path.parent, file_names(path)):
        return None
    earlier_sweep = load_sweep(path)
    # through JSON and back, as what was read from a file has lists in place of tuples
    identity = json.loads(to_json(collect_identity(run.frame)))
    return earlier_sweep if collect_identity(earlier_sweep) == identity else None


def _name_incomplete_files(name: str) -> list[str]:
    """Return the names of the files of a sweep that lacks loads; the whole sweep would be in the
    file ``name``.
    """
    path = Path(name)
    return file_names(path.with_stem(f"{path.stem}_{INCOMPLETE}"))


def keep_incomplete(
    error: GranphonError, files: ResultFiles, name: str, store: Store | None
) -> GranphonError:
    """Write the data set that is the ``reached`` of an ``error`` into the locked folder of
    ``files``, clear the ``store``, if one is given, and return an error whose message ends with the
    names of the files that were written.

    ``name`` is the name of the file that the whole sweep would have. If the files cannot be
    written, the store is not cleared, and ``error`` is returned as it is.
    """
    names = _name_incomplete_files(name)
    n_loads = error.reached.sizes["load"]
    incomplete_files = replace(files, names=names, force=True, earlier=())
    try:
        with incomplete_files.staging() as stage:
            write_sweep(error.reached, stage / names[0])
        if store is not None:
            store.clear()
    except OutputError:
        return error
    loads = "The load that was reached is"
    if n_loads > 1:
        loads = f"The {n_loads} loads that were reached are"
    return error.restate(f"{error} {loads} in {' and '.join(names)} in {files.folder}.")
