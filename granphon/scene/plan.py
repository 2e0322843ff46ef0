"""The plan of a scene: its values, checked, its cases, the media that serve the loads, and memory
and time.

Reading, checking, running and estimating the cost all use the plan of a scene, so that nothing is
computed twice.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

import numpy as np

from granphon.balls.contact_table import touch_once_at_most
from granphon.balls.lattices import TRIANGULAR
from granphon.balls.layers import Layers
from granphon.balls.loads import Load
from granphon.balls.packing import Axis, Packing, change_packing, count_combinations, find_unit
from granphon.base import memory
from granphon.base.errors import GranphonError, InputError, MechanismError, Refused
from granphon.base.progress import Progress, silent
from granphon.base.quantities import LENGTH, find_load_unit
from granphon.base.tables import Heading, table_text
from granphon.base.text import MOST_SCENE_BYTES, dump_yaml, spell
from granphon.base.validation import read_inside, require
from granphon.media import cost as costs
from granphon.media.arrangement import Arrangement
from granphon.media.choice import (
    MEDIA,
    MediumChoice,
    ServingMedium,
    default_medium,
    require_finite_overlap,
)
from granphon.media.cost import Cost
from granphon.media.simulation import DirectSimulation
from granphon.media.state import ContactState
from granphon.observables.validity import expect_warnings
from granphon.phonons.paths import MESHES, BandPath, read_paths
from granphon.runs.tasks import Case, Grid, Request, require_arrays
from granphon.scene import rules
from granphon.scene.file import SceneSource, scene_rule, write_blocks
from granphon.scene.rules import Context
from granphon.waves.settings import (
    MOMENTS,
    NETWORK_BLOCKS,
    READINGS,
    WAVES,
    BandsSettings,
    MotionSettings,
    PulseSettings,
    ResponseSettings,
    SpectrumSettings,
    SurfaceSettings,
    WaveSettings,
)

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from granphon.networks.network import ContactNetwork
    from granphon.runs.dataset import Dataset


#: the settings of a spectrum by default
_SPECTRUM = SpectrumSettings()
#: attributes of a scene that are checked by the rules of their keys in a file
_CHECKED = ("media", "finite_overlap", "observe", "band_points", "mesh", "dim", "direction")
#: a part of the work: the path of the key that asks for it, how the user can make it smaller, and
#: its cost
CostPart = tuple[tuple[str, ...], str, Cost]
#: greatest number of cases that are all checked; of more cases, only the ends of the axes are
MOST_CASES = 100
#: greatest number of states that are all solved by a survey; of more states, the survey solves the
#: ends of the axes and loads
MOST_STATES = 20_000
#: most balls of a network whose product with a vector is timed
_PRODUCT_BALLS = 2000
#: greatest number of balls of an array whose waves are checked when a scene is read
QUICK_BALLS = 100_000
#: greatest number of balls, in all samples and cases, whose rest at the start of a loading is found
#: when a scene is read
QUICK_STARTS = 5_000
#: random vectors of a density of states: ten, each cut into translations and rotations
_DOS_VECTORS = 20.0
#: greatest number of directions of sound that the description of a scene names
_MOST_DESCRIBED = 4
#: number of cells along each period below which the smallest possible supercell is sought
_MOST_CELLS = 100


@dataclass(frozen=True, eq=False)
class PlannedCase:
    """A case of a scene, whose errors are placed in the file: one medium on one packing, at all
    loads.

    The load of the ``case`` is a load of the contacts: a force, pressure or overlap; ``written`` is
    the kind of load that the scene gives, which may be a side force instead.
    """

    case: Case
    written: str
    origin: SceneSource

    @property
    def serving_media(self) -> list[ServingMedium]:
        """The media that serve the loads, see :attr:`granphon.runs.tasks.Case.serving_media`."""
        with self.origin.at_medium(self.case.medium.label, "a tolerance that is met at every load"):
            return self.case.serving_media

    @cached_property
    def state(self) -> ContactState:
        """State of the contacts under the first load, the only one if the scene is not a sweep."""
        return self._find_state(0)

    def states(self, quick: bool) -> Iterator[tuple[str, ContactState]]:
        """Label and state of each medium, or of those alone whose states are ``quick`` to find.

        Quantities of a state have the shape (n,) for the n loads that the medium serves, or () if
        the case has one load.
        """
        for serving in self.serving_media:
            if quick and not serving.is_quick:
                continue
            is_alone = self.case.load.size == 1
            state = self.state if is_alone else self._solve(serving, serving.load)
            yield self.case.name(serving), state

    @cached_property
    def is_possible(self) -> bool:
        """True; raises GranphonError if the packing is not rigid, has no such medium, or cannot
        carry the least or greatest of the loads.

        The property is cached, so that a case is checked once. No simulation and no effective
        medium of a long list of diameters is solved for the check.
        """
        least = int(np.argmin(self.case.load.array))
        greatest = int(np.argmax(self.case.load.array))
        for index in dict.fromkeys((least, greatest)):
            serving = next(serving for serving in self.serving_media if index in serving.loads)
            with self.at_load(index, f"{self.case.label}: "):
                serving.medium.of(self.case.packing).require(self.case.load[index])
                if serving.is_quick:
                    state = self._find_state(index) if index else self.state
                    if self.case.packing.repeats:
                        state.contact_lattice()  # raises for a lattice that is not rigid
        return True

    def require_start(self, most: float) -> float:
        """Raise GranphonError if a load is below the start of its history, where this is a load of
        another kind; samples of more than ``most`` balls in all are not looked at. Return the
        number of balls that may still be looked at.
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
        text; see :class:`SceneSource`.
        """
        return self.origin.at_index("load", self.written, index, prefix)

    def _find_state(self, index: int) -> ContactState:
        """Return the state under the load number ``index``; InputError if double precision does not
        hold its scales.
        """
        serving = next(serving for serving in self.serving_media if index in serving.loads)
        state = self._solve(serving, self.case.load[index])
        for scale in (state.scales.frequency, state.scales.velocity):
            if not 0.0 < scale < math.inf:
                raise InputError("the frequencies or velocities are beyond double precision")
        return state

    def _solve(self, serving: ServingMedium, load: Load) -> ContactState:
        """Return the state of one of the media under one or several loads."""
        # False is the default of a scene, and counts as no wish of the user
        finite_overlap = self.case.request.finite_overlap or None
        # what overflows is refused afterwards
        with np.errstate(all="ignore"):
            return serving.at(load, finite_overlap=finite_overlap)


class Conflict(NamedTuple):
    """A reason for which an observable cannot be observed.

    Attributes
    ----------
    name : the observable.
    holds : whether the reason holds in the scene, as the truth of any value.
    problem, allowed, mend : the parts of the message, of which the first follows the name.
    """

    name: str
    holds: Any
    problem: str
    allowed: str
    mend: str


@dataclass(frozen=True)
class Plan:
    """The values of a :class:`~granphon.scene.scene.Scene`, which describes each of them, and how a
    scene is carried out.
    """

    schema: ClassVar[int] = rules.SCENE_SCHEMA

    packing: Packing | Arrangement
    load: Load
    _: KW_ONLY
    media: tuple[MediumChoice, ...] = ()
    parameters: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    finite_overlap: bool = False
    observe: tuple[str, ...] = ("velocities",)
    direction: tuple[Any, ...] | None = None
    band: BandPath | None = None
    band_points: int = 101
    mesh: tuple[int, ...] = ()  # the default of the lattice
    dim: tuple[int, ...] | None = None
    surface: SurfaceSettings | None = None
    spectrum: SpectrumSettings = _SPECTRUM
    pulse: PulseSettings | None = None
    response: ResponseSettings | None = None
    motion: MotionSettings | None = None
    bands: BandsSettings | None = None
    source: Path | None = field(default=None, compare=False)
    #: document and file that the scene was read from; a copy made by ``replace`` has none, as its
    #: values may differ
    origin: SceneSource = field(default=SceneSource(), init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        # the dataclass is frozen: read values and defaults are put in place of the arguments
        assign = partial(object.__setattr__, self)
        axes = tuple(Axis.of(name, values) for name, values in dict(self.parameters).items())
        assign("parameters", tuple((axis.name, axis.values) for axis in axes))
        lattices = dict(self.parameters).get("lattice", ())
        lattice = rules.choose_lattice(self.packing.structure, lattices)
        if lattice != self.packing.structure:
            assign("packing", change_packing(self.packing, {"lattice": lattices[0]}))
        if not self.mesh:
            assign("mesh", MESHES[lattice.periods - 1])
        # media of another type are refused below
        if isinstance(cast("object", self.media), tuple | list) and not self.media:
            assign("media", default_medium(self.packing, self.balls_differ))
        context = Context(lattice, written=False, kinds=self.packing.kind_names)
        for name in _CHECKED:
            value = getattr(self, name)
            if value is not None:
                assign(name, require(name, scene_rule(name, context), value))
        if all(choice.is_exact for choice in self.media) and self.balls_differ:
            assign("finite_overlap", True)
        # a scene without bands in space does not ask ASE, which knows the path there
        has_path = lattice.periods == 2 or bool({"bands", "spectrum"} & set(self.observe))
        if self.band is None and has_path:
            assign("band", BandPath.default(lattice))
        if self.load.array.ndim > 1:
            problem = f"the load has the shape {self.load.shape}"
            raise InputError(problem, mend="Give one number, or a list of them")
        self._require_consistency()

    @property
    def path(self) -> BandPath:
        """Path of the bands in reciprocal space; never None, unlike the argument ``band``."""
        return BandPath.default(self.packing.structure) if self.band is None else self.band

    @property
    def directions(self) -> tuple[tuple[float, ...], ...]:
        """The directions of sound that the scene names, one or many; empty for none."""
        if not self.direction:
            return ()
        return self.direction if isinstance(self.direction[0], tuple) else (self.direction,)

    @property
    def balls_differ(self) -> bool:
        """Whether the diameters of the balls differ, or differ in a sweep over "width" or
        "spread".
        """
        return self.packing.width > 0.0 or not {"width", "spread"}.isdisjoint(dict(self.parameters))

    def observed_settings(self, block: str) -> Any:
        """Return the settings of a block whose subject the scene observes; None for another."""
        return getattr(self, block) if block in self.observe else None

    @cached_property
    def waves(self) -> WaveSettings | None:
        """The waves that are observed in arrays, where media simulate them, and in networks; None
        for none.
        """
        blocks = map(self.observed_settings, NETWORK_BLOCKS)
        networks = tuple(settings for settings in blocks if settings is not None)
        if not networks and not set(WAVES) & set(self.observe):
            return None
        spectrum = self.observed_settings("spectrum")
        pulse = self.observed_settings("pulse")
        return WaveSettings(
            dos="dos" in self.observe,
            spectrum=spectrum,
            path=() if spectrum is None else self.path.paths,
            labels=() if spectrum is None else self.path.names,
            pulse=pulse,
            direction=None if pulse is None else self.direction,
            of_networks=networks,
        )

    @property
    def is_single(self) -> bool:
        """Whether the scene has one state alone: one load, one medium, and no swept parameter."""
        return len(self.load.values) == len(self.media) == 1 and not self.parameters

    def to_yaml(self) -> str:
        """Return the text of the scene, in which defaults are written out as by
        :func:`~granphon.scene.file.write_blocks`, and quantities are in SI units.

        The text gives the same scene, to the last bit, when it is read again. A measured spread of
        more than 1000 diameters is written as the name of a table, whose text is
        :attr:`diameters`. :class:`~granphon.base.errors.InputError` if a file has no words for the
        law of contacts, or the text is too long.
        """
        return self._text

    @cached_property
    def _text(self) -> str:
        """The text of :meth:`to_yaml`."""
        text = dump_yaml(write_blocks(self, Context(self.packing.structure)))
        n_bytes = len(text.encode())
        if n_bytes > MOST_SCENE_BYTES:
            problem = (
                f"the scene takes {n_bytes // 1000} kB as a text; a scene file holds"
                f" {MOST_SCENE_BYTES // 1000} kB"
            )
            raise InputError(problem, mend="Give long lists as a range, or call granphon.sweep")
        return text

    def describe(self) -> list[tuple[str, Any, str]]:
        """Return names, values and SI units of the settings of the scene; no state is computed."""
        # imported here: a run does not need words for figures
        from granphon.figures.words import describe_medium

        load = self.load
        structure = self.packing.structure
        media = [
            describe_medium(choice.label, structure.periods, structure.n_balls)
            for choice in self.media
        ]
        if len(media) > 1 and not self.balls_differ:
            media.append("the same for equal balls")
        load_unit = find_load_unit(load.kind, structure.periods, structure.pressed_axes)
        sweeps = [
            (f"sweep of {spell(name)}", values, find_unit(name) or "")
            for name, values in self.parameters
        ]
        directions = [
            ("direction", direction, "") for direction in self.directions[:_MOST_DESCRIBED]
        ]
        rows: list[tuple[str, Any, str]] = [
            *self.packing.describe(),
            (load.kind.replace("_", " "), load.array, load_unit),
            ("components", load.tensor, "of that"),
            ("balls per side", load.balls_per_side, ""),
            ("gravity", load.gravity, "m/s^2"),
            ("medium", media, ""),
            *sweeps,
            ("finite overlap", self.finite_overlap, ""),
            ("observe", self.observe, ""),
            *directions,
            *self._describe_observed(),
        ]
        return [(name, value, unit) for name, value, unit in rows if value is not None]

    def _describe_observed(self) -> list[tuple[str, Any, str]]:
        """Return names, values and SI units of the settings of the observables that the scene
        observes; motions and damped bands are not described.
        """
        rows: list[tuple[str, Any, str]] = []
        if {"bands", "spectrum"} & set(self.observe):
            path = " ".join(self.path.labels) if self.path.labels else str(self.path)
            rows.append(("path", path, ""))
        if "bands" in self.observe:
            rows.append(("points of a segment", self.band_points, ""))
        spectrum = self.observed_settings("spectrum")
        if spectrum is not None:
            rows += [
                ("polarisation", spectrum.polarisation, ""),
                ("points of a leg", spectrum.points, ""),
            ]
        pulse = self.observed_settings("pulse")
        if pulse is not None:
            rows += [
                ("frequency of the pulse", pulse.frequency, "Hz"),
                ("cycles of the pulse", pulse.cycles, ""),
                ("polarisation of the pulse", pulse.polarisation, ""),
            ]
        surface = self.observed_settings("surface")
        if surface is not None:
            axis = surface.axis
            if not isinstance(axis, int):
                axis = " ".join(map(str, axis))
            rows.append(("surface", f"axis {axis}, {surface.edge}", ""))
        response = self.observed_settings("response")
        if response is not None:
            rows += [
                ("response", response.quantity, ""),
                ("frequencies of the response", response.frequencies, "Hz"),
                ("source", ", ".join(response.source), ""),
                ("receiver", ", ".join(response.receiver), ""),
                ("damping of contacts", response.damping, "s"),
                ("loss factor of contacts", response.loss_factor, ""),
            ]
        if "dos" in self.observe:
            rows.append(("mesh", " x ".join(map(str, self.mesh)), ""))
        return rows

    @cached_property
    def diameters(self) -> str | None:
        """Text of ``diameters.csv``: the measured diameters, m, if they are too many for the scene
        file; else None.
        """
        spread: Any = self.packing.spread
        if not rules.is_long(spread):
            return None
        rows = ([diameter] for diameter in spread.diameters)
        return table_text([Heading("diameter", LENGTH.unit)], rows)

    @property
    def parameters_of_branches(self) -> list[str]:
        """Names of swept parameters on which the number of branches or the zone depends: bands are
        not swept over them.
        """
        changing = []
        for name, values in self.parameters:
            motions = set[Any]()
            if name in ("motions", "torsion", "bending"):
                # a value that the packing cannot have is refused later, with its place
                with suppress(InputError):
                    packings = [change_packing(self.packing, {name: value}) for value in values]
                    motions = {packing.ball_motions for packing in packings}
            if name in ("friction", "lattice") or len(motions) > 1:
                changing.append(name)
        return changing

    @contextmanager
    def place_errors(self) -> Iterator[None]:
        """Place an error of the with-block in the file, if the error names an option of a medium, a
        block or a load.
        """
        try:
            yield
        except GranphonError as error:
            if error.option is not None or error.block is not None:
                # such an error knows its own place, which goes before the medium
                placing: AbstractContextManager[None] = self.origin.at("medium")
            elif error.load_index is None:
                raise
            else:
                placing = self.origin.at_index("load", self.load.kind, error.load_index)
            with placing:
                raise

    @property
    def n_cases(self) -> int:
        """Number of cases; a case is one medium at one combination of parameters."""
        return len(self.media) * math.prod(len(axis.values) for axis in self.axes)

    @property
    def n_states(self) -> int:
        """Number of states; a state is one case at one load."""
        return self.n_cases * self.load.size

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """The swept parameters, each with its values."""
        return tuple(Axis(*axis) for axis in self.parameters)

    @cached_property
    def case_grid(self) -> Grid:
        """The cases without their places in the file, which a sweep carries out."""
        has_velocities = "velocities" in self.observe
        # a mechanism has other observables, but no velocities
        of_mechanisms = {"bands", "dos", "surface", *NETWORK_BLOCKS}
        path = None
        if "bands" in self.observe:
            path = (self.path.arrays, self.band_points, self.path.labels)
        request = Request(
            finite_overlap=self.finite_overlap,
            path=path,
            direction=self.direction,
            waves=self.waves,
            exponents=has_velocities,
            surface=self.observed_settings("surface"),
            bands=self.observed_settings("bands"),
            observe=self.observe,
            sound=has_velocities or of_mechanisms.isdisjoint(self.observe),
            alone=self.is_single,
        )
        return Grid(self.packing, self.axes, self.media, self.load.applied.flat, request)

    @cached_property
    def cases(self) -> tuple[PlannedCase, ...]:
        """The cases: every medium at every combination of parameters, the media running fastest."""
        return self._plan_cases(self.case_grid)

    def _plan_cases(self, grid: Grid) -> tuple[PlannedCase, ...]:
        """Return the cases of a grid, whose errors are placed in the file."""
        return tuple(PlannedCase(case, self.load.kind, self.origin) for case in grid.cases)

    @property
    def case(self) -> PlannedCase:
        """The only case of a scene of one state; :class:`~granphon.base.errors.InputError` if the
        scene is a sweep.
        """
        if not self.is_single:
            mend = "Use states(), or run it"
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

    @property
    def has_tasks(self) -> bool:
        """Whether the work is cut into tasks, which can be done elsewhere: a sweep, or the samples
        of one state.
        """
        return not self.is_single or bool(self.serving.arrays)

    @cached_property
    def checked_cases(self) -> tuple[PlannedCase, ...]:
        """All cases, or the cases at the ends of the axes if all are more than :data:`MOST_CASES`.

        The ends suffice for checks: a packing that is possible at two values of a parameter is
        possible between them. Of a parameter without numbers, as the lattice, every value is an
        end.
        """
        if self.n_cases <= MOST_CASES:
            return self.cases
        return self._plan_cases(replace(self.case_grid, axes=[axis.ends for axis in self.axes]))

    # -- what can be carried out -------------------------------------------------------------------

    def require(self) -> None:
        """Raise GranphonError, placed in the file, if a packing cannot have a value of a parameter,
        is not rigid or has no such medium; if a quickly solved medium cannot carry a load, or a
        load is below the start of its history; or if arrays or networks lack the waves that are
        observed. Only the :attr:`checked_cases` and small arrays are looked at.
        """
        self._require_parameters()
        with self.origin.at("sweep"):
            count_combinations(self.axes)
            checked_cases = self.checked_cases
        most_balls: float = QUICK_STARTS
        for planned in checked_cases:
            most_balls = self._require_case(planned, most_balls)
        self.require_waves(QUICK_BALLS)

    def _require_parameters(self) -> None:
        """Raise InputError, placed in the file, for the first value of a parameter that the packing
        cannot have.
        """
        for axis in self.axes:
            try:
                # between values that a packing can have are no others
                for value in axis.ends.values:
                    change_packing(self.packing, {axis.name: value})
            except (GranphonError, ArithmeticError):
                for index, value in enumerate(axis.values):
                    with self.origin.at_index("sweep", axis.name, index):
                        change_packing(self.packing, {axis.name: value})

    @property
    def _path_of_lattice(self) -> tuple[str, ...]:
        """The keys of a scene file at which the lattice stands."""
        if "lattice" in dict(self.parameters):
            return ("sweep", "lattice")
        return ("crystal",) if self.packing.kind_names else ("packing", "lattice")

    def _require_case(self, planned: PlannedCase, most_balls: float) -> float:
        """Raise GranphonError, placed in the file, if a case cannot be carried out; return, of the
        ``most_balls`` whose start may be found, the number that remains.
        """
        path = self._path_of_lattice
        case = planned.case
        lattice = case.packing.structure.name
        has_velocities = "velocities" in self.observe
        refusal = f"found {lattice!r}; allowed: a lattice that is rigid; "
        if case.where:
            refusal += f"{case.where}: "
        allowed_medium = f"a medium for the {lattice} lattice"
        with self.origin.at_medium(case.medium.label, allowed_medium):
            medium = case.medium.of(case.packing)
        if has_velocities:
            with self.origin.at(*path, prefix=refusal):
                try:
                    medium.require_sound()
                except MechanismError as error:
                    raise MechanismError(str(error), mend=self._mend_mechanism()) from None
        # where a medium is solved anew for each packing, the processes of a sweep solve it
        is_solved_later = not self.is_single and medium.is_solved_anew
        if not is_solved_later:
            with self.origin.at_medium(case.medium.label, allowed_medium):
                medium.prepare()
            _ = planned.is_possible
            is_quick = all(serving.is_quick for serving in planned.serving_media)
            if has_velocities and is_quick:
                with self.origin.at(*path, prefix=refusal):
                    planned.state.reference_lattice.require_rigid()
        return planned.require_start(most_balls)

    def _mend_mechanism(self) -> str:
        """Return a sentence on how a scene is mended whose lattice has no velocities."""
        if self.parameters_of_branches:
            return (
                "In a scene of its own it has bands and a density of states: observe: [bands, dos]"
            )
        if not self.is_single:
            return "It has bands, which a sweep without velocities has: observe: [bands]"
        return (
            "It has bands and a density of states: observe them without velocities, as observe:"
            " [bands, dos]"
        )

    def require_waves(self, most: float = math.inf) -> None:
        """Raise GranphonError, placed in the file, if arrays are known not to have the waves that
        are observed.

        Arrays of up to ``most`` balls, a number without a unit, are looked at, and nothing is
        simulated; arrays of more than a hundred thousand balls take seconds.
        """
        waves = self.waves
        if waves is None:
            return
        has_only_dos = waves.spectrum is None and waves.pulse is None and not waves.of_networks
        if has_only_dos:  # which any array has
            return
        # imported here: not all scenes need waves
        from granphon.runs.wave_records import require_network, require_waves

        for planned in self.checked_cases:
            for settings in waves.of_networks:
                for key in settings.of_network:
                    with self.origin.at(settings.block, key):
                        require_network(planned.serving_media, settings, key, most)
            with self.origin.at("spectrum"):
                require_waves(planned.serving_media, replace(waves, pulse=None), most)
            with self.origin.at("pulse"):
                require_waves(planned.serving_media, replace(waves, spectrum=None), most)

    # -- states ------------------------------------------------------------------------------------

    def state(self) -> ContactState:
        """Return the state of the contacts under the load.

        :class:`~granphon.base.errors.InputError` if the balls cannot carry the load, or if the
        scene is a sweep.
        """
        case = self.case
        # first, so that an error in choosing the medium is not placed at the load
        _ = case.serving_media
        with case.at_load(0):
            return case.state

    def states(self, quick: bool = False) -> Iterator[tuple[str, ContactState]]:
        """Return label and state of every medium at every combination of parameters, one after the
        other.

        Quantities of a state have the shape (n,) for the n loads that the medium serves, or () if
        the scene has one load. A state is solved when its turn comes; with ``quick`` simulations
        and effective media of long lists are left out.
        :class:`~granphon.base.errors.InputError` at the first medium that cannot carry the loads.
        """
        return self._solve(self.cases, quick)

    def _solve(
        self, cases: Iterable[PlannedCase], quick: bool
    ) -> Iterator[tuple[str, ContactState]]:
        """Yield label and state of each medium of the ``cases``, or with ``quick`` of those alone
        whose states are quick to find.
        """
        for planned in cases:
            _ = planned.is_possible
            yield from planned.states(quick)

    def survey(self) -> tuple[Iterator[tuple[str, ContactState]], str]:
        """Return the :meth:`states` that are quick to find, and words for the states that are left
        out; an empty text for none.

        Simulations and effective media of long lists are left out. If there are more than 100
        combinations of medium and packing, or more than 20 000 states, so are all but those at the
        least and the greatest load and value of each numeric parameter.
        """
        left_out = list[str]()
        if self.n_cases <= MOST_CASES and self.n_states <= MOST_STATES:
            cases = self.cases
        else:
            load_ends = tuple(dict.fromkeys((min(self.load.values), max(self.load.values))))
            grid = replace(
                self.case_grid,
                axes=[axis.ends for axis in self.axes],
                load=replace(self.load, array=load_ends).applied.flat,
            )
            cases = self._plan_cases(grid)
            left_out.append(f"all but the ends of {self.n_states:,} states")
        slow_names = {
            serving.medium.name
            for planned in cases
            for serving in planned.serving_media
            if not serving.is_quick
        }
        for name, medium in MEDIA.items():
            if name in slow_names and medium.slow_part:
                left_out.append(medium.slow_part)
        return self._solve(cases, quick=True), " and ".join(left_out)

    def expect_warnings(self) -> list[tuple[str, str]]:
        """Return the warnings that are known before simulations are run, as pairs of the label of a
        case and a sentence; none of simulations that were chosen automatically.
        """
        labelled = list[tuple[str, str]]()
        for planned in self.checked_cases:
            for serving in planned.serving_media:
                if serving.chosen_automatically:
                    continue
                for medium in serving.arrays:
                    sentences = expect_warnings(medium, serving.load)
                    labelled += [(planned.case.label, sentence) for sentence in sentences]
        return labelled

    def sweep(
        self, progress: Progress = silent, executor: Executor | None = None, **options: Any
    ) -> Dataset:
        """Compute every state of the scene as one data set, from its :attr:`cases`.

        ``options`` are keywords of :func:`granphon.runs.sweep.sweep` besides those that the scene
        answers: ``path``, ``resume``, ``overwrite`` and ``store``. A load that cannot be carried
        raises :class:`~granphon.base.errors.SceneError` if the scene was read from a file, and one
        that a computation does not reach :class:`~granphon.base.errors.ConvergenceError`.
        """
        from granphon.runs.sweep import sweep_grid

        self.require_waves()
        with self.place_errors():
            return sweep_grid(self.case_grid, progress=progress, executor=executor, **options)

    # -- cost --------------------------------------------------------------------------------------

    def cost(self) -> Cost | None:
        """Memory and time that the scene will take, its parts done one after the other; None if
        both are negligible.

        :class:`~granphon.base.errors.InputError` if more memory is needed than is available on this
        machine now, or more than 10,000 days on one processor.
        """
        parts = [(path, mend, cost) for path, mend, cost in self.parts if cost.tells]
        total = sum((cost for _, _, cost in parts), Cost())
        free_memory = memory.available_memory()  # bytes
        most_seconds = costs.MOST_SECONDS
        if total.memory > free_memory:
            limit = f"this machine has {free_memory / 1e9:.3g} GB of memory available"
            sizes = [cost.memory for _, _, cost in parts]
        elif total.takes_longer(most_seconds):
            duration = costs.write_duration(most_seconds)
            limit = f"no run may take more than {duration} on one processor"
            sizes = [cost.seconds for _, _, cost in parts]
        else:
            return total if parts else None
        # the error stands at the key of the largest part
        path, mend, _ = parts[sizes.index(max(sizes))]
        with self.origin.at(*path):
            raise InputError(f"{total.text}, and {limit}", mend=mend)

    @cached_property
    def parts(self) -> list[CostPart]:
        """The parts of the work that may take much memory or time, each with its place in the scene
        file.
        """
        simulations = self._cost_simulations()
        waves = self._cost_waves()
        networks = self._cost_networks()
        if not self.is_single:
            return [simulations, *networks, waves, self._cost_states()]
        spectra = self._cost_spectra()
        return [simulations, *networks, *spectra, waves, *self._cost_force_constants()]

    @cached_property
    def _arrays(self) -> list[tuple[DirectSimulation, Load]]:
        """The simulations of the checked cases, each with its loads."""
        return [
            (medium, serving.load)
            for case in self.checked_cases
            for serving in case.serving_media
            for medium in serving.arrays
        ]

    def _add_costs(self, works: list[Cost]) -> Cost:
        """Return the cost of the ``works`` of the checked cases, one after the other; if only cases
        at the ends of axes are checked, the cost of as many works in all cases as large as the
        largest.
        """
        n_checked = len(self.checked_cases)
        if n_checked == self.n_cases or not works:
            return sum(works, Cost())
        # by the number of units of work, whose time is not measured for a comparison
        largest = max(works, key=lambda work: sum(number for number, _ in work.units))
        return largest.times(len(works) * self.n_cases / n_checked)

    def _cost_simulations(self) -> CostPart:
        """Return the part of the work that finds arrays at rest, whose cost may be zero."""
        has_velocities = "velocities" in self.observe
        works = [
            costs.estimate(medium, load, exponents=has_velocities) for medium, load in self._arrays
        ]
        mend = "Take fewer balls (medium.simulation.shape), samples or loads"
        return ("medium",), mend, self._add_costs(works)

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
            total = self._add_costs(works)
        mend = (
            "Take fewer balls (medium.simulation.shape), fewer wave vectors or a coarser"
            " resolution (spectrum)"
        )
        return ("medium",), mend, replace(total, parts=total.parts[:1])

    def _cost_networks(self) -> list[CostPart]:
        """Return the parts of the work that find motions and responses of networks, if the scene
        observes them.
        """
        parts: list[CostPart] = []
        for block, estimate, fewer in (
            ("motion", _estimate_motion, "a shorter motion.duration or fewer motion.frames"),
            ("response", _estimate_response, "fewer response.frequencies, or give more damping"),
        ):
            settings = self.observed_settings(block)
            if settings is None:
                continue
            with self.origin.at(block):
                works = [
                    estimate(serving, settings)
                    for case in self.checked_cases
                    for serving in case.serving_media
                ]
            total = self._add_costs([work for work in works if work is not None])
            mend = f"Take fewer balls ({block}.repeat, {block}.cut), {fewer}"
            # the words for one of the works serve for all
            parts.append(((block,), mend, replace(total, parts=total.parts[:1])))
        return parts

    @property
    def _n_branches(self) -> int:
        """Number of branches of the lattice."""
        return self.packing.structure.n_balls * self.packing.ball_motions.count

    @property
    def _n_path_points(self) -> int:
        """Number of wave vectors along the path of the bands; 0 without bands."""
        if "bands" not in self.observe:
            return 0
        return self.band_points * sum(len(path) - 1 for path in self.path.paths)

    def _cost_states(self) -> CostPart:
        """Return the part of the work of a sweep that finds its states, with their bands."""
        path: tuple[str, ...] = ("sweep",) if self.axes else ("load", self.load.kind)
        mend = "Take fewer loads or values"
        n_points = self._n_path_points
        if n_points:
            path = ("phonopy", "band_points")
            mend += ", or points of the bands (phonopy.band_points)"
        n_frequencies = n_points * self._n_branches
        return path, mend, costs.sweep_states(self.n_cases, self.load.size, n_frequencies)

    def _cost_spectra(self) -> list[CostPart]:
        """Return the parts of the work that find the bands and the density of states of a single
        state, if the scene observes them.
        """
        parts: list[CostPart] = []
        if "bands" in self.observe:
            cost = costs.bands(self._n_path_points, self._n_branches)
            parts.append((("phonopy", "band_points"), "Take fewer points", cost))
        if "dos" in self.observe:
            cost = costs.density_of_states(self.mesh, self._n_branches)
            parts.append((("phonopy", "mesh"), "Take a coarser mesh", cost))
        return parts

    def _cost_force_constants(self) -> list[CostPart]:
        """Return the part of the work that finds the force constants of a single state in a given
        supercell; empty without bands and density of states.
        """
        if self.dim is None or not {"bands", "dos"} & set(self.observe):
            return []
        mend = "Take a smaller supercell: bands and densities of states do not depend on it"
        cost = costs.force_constants(self.dim, self.packing.structure.n_balls)
        return [(("phonopy", "dim"), mend, cost)]

    # -- values that exclude each other, by the key in the file ------------------------------------

    def _list_conflicts(self) -> list[Conflict]:
        """Return every reason for which an observable cannot be observed, whether or not it holds
        in this scene.
        """
        held = Conflict(
            "velocities",
            self.packing.is_held,
            "of balls that are held",
            "bands, gaps, dos of these",
            "Long waves move all balls together, which a floor or clamp holds: write"
            " observe: [bands].",
        )
        first_block = next(iter(NETWORK_BLOCKS))
        without_period = [
            Conflict(
                name,
                not self.packing.repeats,
                "of what repeats nowhere",
                f"{', '.join(NETWORK_BLOCKS)} of these",
                f"Waves of this kind need a period: write observe: [{first_block}].",
            )
            for name in ("velocities", "bands", "gaps", "dos", "surface")
        ]
        gaps = Conflict(
            "gaps", not self.is_single, "of several states", "gaps of one state", "Observe bands."
        )
        pulse = Conflict(
            "pulse",
            self.pulse is None,
            "without a frequency",
            "pulse with a block 'pulse'",
            "Add a block such as pulse: {frequency: 6.5 kHz}.",
        )
        return [
            held,
            *without_period,
            gaps,
            *self._list_conflicts_of_surface(),
            pulse,
            *self._list_conflicts_of_networks(),
            *self._list_conflicts_of_bands(),
        ]

    def _list_conflicts_of_surface(self) -> list[Conflict]:
        """Return the reasons for which the waves of an edge cannot be observed."""
        changing = [name for name in dict(self.parameters) if name in ("lattice", "motions")]
        return [
            Conflict(
                "surface",
                self.surface is None,
                "without an axis",
                "surface with a block 'surface'",
                "Add a block such as surface: {axis: 1}.",
            ),
            Conflict(
                "surface",
                any(choice.simulates for choice in self.media),
                "of a simulation",
                "surface of a lattice or crystal",
                "An array has no edge of its own: take another medium.",
            ),
            Conflict(
                "surface",
                changing,
                f"with a sweep over {' and '.join(changing)}",
                "surface of one lattice",
                "Make a scene of each.",
            ),
        ]

    def _list_conflicts_of_networks(self) -> list[Conflict]:
        """Return the reasons for which a response or motion of networks cannot be observed."""
        without_settings = [
            Conflict(
                name,
                getattr(self, name) is None,
                "without its settings",
                f"{name} with a block '{name}'",
                f"Add a block '{name}'.",
            )
            for name in NETWORK_BLOCKS
        ]
        of_mixed_media = [
            Conflict(
                name,
                len({choice.simulates for choice in self.media}) > 1,
                "of lattices and of arrays",
                f"{name} of one or the other",
                "Make a scene of each.",
            )
            for name in NETWORK_BLOCKS
        ]
        return without_settings + of_mixed_media

    def _list_conflicts_of_bands(self) -> list[Conflict]:
        """Return the reasons for which bands cannot be observed."""
        changing = self.parameters_of_branches
        return [
            Conflict(
                "bands",
                self.bands is not None and any(choice.simulates for choice in self.media),
                "with losses of a simulation",
                "damped bands of a lattice or crystal",
                "Observe the response of the array, or leave the block 'bands' out.",
            ),
            Conflict(
                "bands",
                changing,
                f"with a sweep over {' and '.join(changing)}",
                "velocities, as the branches differ in number or zone",
                "Make a scene of each.",
            ),
        ]

    def _require_consistency(self) -> None:
        """Raise :class:`~granphon.base.errors.Refused` if values that are allowed one by one
        exclude each other.
        """
        structure = self.packing.structure
        self._require_supercell()
        if self.finite_overlap:
            with rules.refusing(True, "false, with a simulation", "packing", "finite_overlap"):
                require_finite_overlap(self.media)
        for choice in self.media:
            with rules.refusing(choice.label, "a medium of these balls", "medium"):
                choice.require_for(self.packing)
        # the density of states of one state is that of its lattice; a simulation adds the density
        # of states of the array
        waves = [name for name in WAVES if name in self.observe]
        if self.is_single:
            waves = [name for name in waves if name != "dos"]
        kinds = "one state, or of arrays" if waves == ["dos"] else "arrays"
        allowed_waves = f"{', '.join(waves)} of {kinds} that a medium: simulation makes"
        first_waves = waves[0] if waves else ""
        with rules.refusing(first_waves, allowed_waves, "observe"):
            require_arrays(self.media, dict(self.parameters), waves)
        for conflict in self._list_conflicts():
            if conflict.name in self.observe and conflict.holds:
                found = f"{conflict.name!r} {conflict.problem}"
                raise Refused(found, conflict.allowed, conflict.mend, ("observe",))
        surface = self.observed_settings("surface")
        if surface is not None:
            allowed = "an axis across which the balls repeat"
            with rules.refusing(surface.axis, allowed, "surface", "axis"):
                Layers.across(surface.axis, structure.vectors)
        if "pulse" in waves and len(self.directions) > 1:
            raise Refused("several directions with a pulse", "one direction", path=("direction",))
        if self.band is not None:
            # a path of another dimension is refused, with its key in the block
            rule = partial(read_paths, periods=structure.periods)
            read_inside("phonopy", partial(read_inside, "band", rule), str(self.band))
        if self.load.kind == "side_force" and structure != TRIANGULAR:
            allowed = "on the triangular lattice only, whose frame is a hexagon"
            raise Refused("a side_force", allowed, path=("load", "side_force"))

    def _require_supercell(self) -> None:
        """Raise :class:`~granphon.base.errors.Refused` if two balls of the supercell would touch
        through two images.
        """
        structure = self.packing.structure
        touch_once = partial(touch_once_at_most, structure.vectors, contact=structure.reach)
        if self.dim is None or touch_once(self.dim):
            return
        supercells = ((n_cells,) * structure.periods for n_cells in range(1, _MOST_CELLS))
        smallest = next(supercell for supercell in supercells if touch_once(supercell))
        allowed = f"{rules.write_grid(smallest)} or more"
        raise Refused(rules.write_grid(self.dim), allowed, path=("phonopy", "dim"))


def _estimate_waves(medium: DirectSimulation, load: Load, settings: WaveSettings) -> Iterator[Cost]:
    """Yield, for each ``load``, the estimated memory and time of the density of states, spectral
    functions and pulses of a simulation, all samples together.
    """
    packing = medium.packing
    structure = medium.packing.structure
    n_contacts = len(structure.contacts) / structure.n_balls  # per ball
    n_directions = structure.periods if packing.friction else 1  # in which a contact deforms
    spectrum = settings.spectrum
    pulse = settings.pulse
    for force in costs.find_typical_force(packing, load).tolist():
        ideal = MediumChoice("ala").of(packing).at(Load.only(force=force))[0]
        # Hz, a bound for differing balls too
        top = 1.5 * ideal.contact_lattice().top_frequency * ideal.scales.frequency
        n_products = 0.0  # of the dynamical matrix with a vector, in one sample
        if settings.dos:
            n_products += _DOS_VECTORS * 0.5 * MOMENTS  # each product gives two moments
        if spectrum is not None:
            n_products += _count_spectrum_products(medium, spectrum, settings.path, top)
        n_heard = 0.0
        n_readings = 0.0
        if pulse is not None:
            length = pulse.distance or 0.5 * max(medium.cells) * packing.diameter  # m
            # the burst, and the pulse on three times its way
            duration = pulse.cycles / pulse.frequency + 3.0 * length / ideal.scales.velocity  # s
            n_steps = math.pi * top * duration  # a product for each half period of the top
            n_products += n_steps
            # the planes of balls that hear the pulse are largest across the shortest side
            n_heard = n_steps * medium.balls / min(medium.cells)
            n_readings = READINGS * pulse.frequency * duration * n_heard * medium.samples
        yield costs.array_waves(
            partial(_measure_product, ideal.network, medium.balls),
            products=n_products * medium.samples,
            balls=medium.balls,
            contacts=n_contacts,
            rows=n_contacts * n_directions,
            heard=n_heard,
            readings=n_readings,
        )


def _count_spectrum_products(
    medium: DirectSimulation, spectrum: SpectrumSettings, path: Any, top: float
) -> float:
    """Return the number of products of the dynamical matrix with a vector for the spectral
    functions of one sample along the pieces of a ``path``; ``top`` is the greatest frequency, Hz.
    """
    # each point of the path becomes the nearest wave vector that the array has, of which there are
    # as many along a leg as cells
    points_of_leg = min(spectrum.points - 1, max(medium.cells))
    n_vectors = points_of_leg * sum(len(piece) - 1 for piece in path)
    n_products = 0.5 * MOMENTS  # each product gives two moments
    if spectrum.resolution is not None:
        # the resolution of M moments is pi top / 2M
        n_products = max(n_products, 0.25 * math.pi * top / spectrum.resolution)
    # a wave is complex, so that each moment takes two products
    return 2.0 * n_products * n_vectors * len(spectrum.polarisation)


def _measure_product(network: ContactNetwork, balls: int) -> float:
    """Return the measured time per ball, s, of a product of the dynamical matrix with a vector, for
    a repetition of ``network`` to about ``balls`` balls, or to :data:`_PRODUCT_BALLS` if these are
    fewer.
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
    """Return the estimated memory and time of the responses of a medium at all its loads, in all
    samples; None if no network is quickly found.

    Raises :class:`~granphon.base.errors.ConvergenceError` for a response that would be refused.
    """
    # imported here: other scenes do not need it
    from granphon.dynamics.damping import ContactDamping
    from granphon.runs.wave_records import find_typical_state
    from granphon.waves.operator import make_operator
    from granphon.waves.response import ResponseWork

    state = find_typical_state(serving)
    if state is None:
        return None
    array = next(iter(serving.arrays), None)
    n_balls = state.network.n_balls if array is None else array.balls
    if settings.count(n_balls) > QUICK_BALLS:
        return None
    whole_network = state.network if array is None else state.network.repeat(array.cells)
    network = settings.shape(whole_network)
    damping = ContactDamping.of(network, settings.damping, settings.loss_factor)
    omega = 2.0 * math.pi * np.array(settings.frequencies)  # rad/s
    work = ResponseWork(make_operator(network), damping, omega)
    is_factorised, seconds = work.choose(None)
    cost_of_network = costs.response(
        partial(_measure_product, state.network, network.n_balls),
        products=seconds / work.step,
        balls=network.n_balls,
        contacts=network.n_contacts,
        frequencies=len(settings.frequencies),
        factors=work.factor_bytes if np.any(is_factorised) else 0.0,
    )
    n_samples = 1 if array is None else array.samples
    return cost_of_network.times(serving.load.size * n_samples)


def _estimate_motion(serving: ServingMedium, settings: MotionSettings) -> Cost | None:
    """Return the estimated memory and time of the motions of a medium at all its loads, in all
    samples; None if no state of the medium is quickly found.

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
    n_cells = settings.count(1 if array is None else math.prod(array.cells))
    step = settings.step  # s
    if not step:
        # a few cells have the contacts of the whole array, but for its edges, and so its step
        few_cells = network
        if any(network.pbc):
            few_cells = network.repeat((3,) * sum(network.pbc))
        impact = max(drive.impact or 0.0 for drive in settings.drive)
        step = make_waves(state, few_cells, settings).find_step(impact)
    steps_of_frame = math.ceil(settings.duration / (settings.frames - 1) / step)
    n_steps = steps_of_frame * (settings.frames - 1)
    require_steps(n_steps)
    n_balls = n_cells * network.n_balls
    cost_of_motion = costs.motion(
        partial(_measure_product, network, n_balls),
        steps=n_steps,
        balls=n_balls,
        contacts=n_cells * network.n_contacts,
        frames=settings.frames,
        damped=bool(np.any(settings.damping)),
        implicit=settings.scheme == "midpoint",
    )
    n_samples = 1 if array is None else array.samples
    return cost_of_motion.times(serving.load.size * n_samples)
