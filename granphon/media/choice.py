"""The media by name, with their options, and the automatic choice of a medium, for scenes, sweeps
and fits.

An automatic medium takes the first of its candidates that is accurate enough: the averaged lattice,
the averaged force, the effective medium, and simulations of more and more balls.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load, require_of_packing
from granphon.balls.packing import Packing, given_packing
from granphon.base.arrays import Array
from granphon.base.differences import Course
from granphon.base.errors import InputError, Refused, brief
from granphon.base.quantities import load_quantities
from granphon.base.registry import Later, Registry
from granphon.base.text import show
from granphon.base.validation import (
    block,
    choice,
    is_one_of,
    number,
    read_inside,
    real_number,
    require,
)
from granphon.media.accuracy import (
    AVERAGES,
    explain_uncovered,
    find_error,
    find_least_load,
    find_rows,
)
from granphon.media.array_options import (
    DEFAULT_SHAPES,
    HISTORY_OPTIONS,
    REFERENCE_OPTIONS,
    REST,
    FrictionHistory,
    no_finite_overlap,
    read_cells,
    read_start,
    reduce_load,
)
from granphon.media.left_out import EXACT, LATTICE, expect_shear_deficit, find_left_out
from granphon.media.medium import (
    CRYSTAL,
    NETWORK,
    SIMULATION,
    AveragedForce,
    AveragedLattice,
    Change,
    EffectiveMedium,
    Medium,
    Option,
)
from granphon.media.newtons import write_force
from granphon.media.state import ContactState, read_finite_overlap

if TYPE_CHECKING:
    from granphon.media.arrangement import Balls
    from granphon.media.simulation import DirectSimulation

#: the class of a medium
T = TypeVar("T", bound=type)
#: sides, in diameters, of the samples that an automatic medium chooses among, with two and with
#: three periods
SIDES = {
    2: (16, 20, 24, 32, 40, 50, 64, 80, 100, 128, 160, 200, 256, 320, 400, 512, 640, 800, 1024),
    3: (8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 80, 96),
}
#: what each of the :data:`~granphon.media.array_options.REFERENCE_OPTIONS` means as an option of an
#: automatic medium: it says how the arrays are loaded that errors are relative to
_MEANINGS_OF_TRUTH = (
    "whether errors are relative to arrays [loaded with friction]"
    "(../how-to/tradeoff.md#arrays-loaded-with-friction)",
    "of these arrays; needed with `friction_history`, and only then",
    "of these arrays to sound, as of a `simulation`",
)


@dataclass(frozen=True)
class AutoMedium(Medium[ContactState]):
    """The first medium whose expected error is within a tolerance.

    As the load falls, that is first the averaged lattice, then the averaged force, and then the
    effective medium, unless a list of diameters makes it slow. Below the load where these fail it
    is a simulation of one sample (seed 0), of as many balls as the tolerance needs: up to 1024 x
    1024 on the triangular lattice, and a cube of 96 diameters in fcc and hcp. Errors are relative
    errors of velocities and frequencies against simulated arrays, the :attr:`truth`; they are those
    of :mod:`granphon.media.accuracy`.
    The expected error of a simulation is 1.9 standard deviations of a sample. ``at_*`` take scalars
    or arrays, and return the state of the first medium that is accurate enough at all of these
    loads, or else of the largest simulation; :meth:`choose` chooses for each load.

    Parameters
    ----------
    packing : the balls.
    tolerance : largest expected relative error.
    friction_history : whether the truth is samples loaded with friction. The simulations are then
        loaded with it.
    friction_coefficient, shear_response : of such a truth, as in
        :class:`~granphon.DirectSimulation`; a history needs the coefficient.

    Raises
    ------
    InputError : something else than a :class:`~granphon.Packing`; a tolerance that is not between
        1e-12 and 0.99; a history without a friction coefficient, or the reverse. From ``at_*``,
        :meth:`follow`, :meth:`serving` and :meth:`choose`: a load that is not finite or not
        compressive; a load at which no medium is within the tolerance (the message gives the
        smallest error available); a load, a packing or a friction for which errors are not known.
        From ``at_*`` and :meth:`follow`: finite overlap, a load that crystals alone bear, and what
        the chosen medium raises.
    """

    name = "auto"
    words = "automatic medium"

    packing: Packing
    tolerance: float = 1e-3
    friction_history: bool = False
    friction_coefficient: float | None = REST.friction_coefficient
    shear_response: str = REST.shear_response

    options = {
        "tolerance": Option(
            tolerance,
            partial(number, low=1e-12, high=0.99),
            "largest expected relative error of velocities and frequencies",
        ),
        **{
            name: replace(HISTORY_OPTIONS[name], meaning=meaning)
            for name, meaning in zip(REFERENCE_OPTIONS, _MEANINGS_OF_TRUTH, strict=True)
        },
    }

    def __post_init__(self) -> None:
        """Read the options, replace each by the value that was read, and raise the errors that the
        class lists for options.
        """
        given_packing(self.packing)
        tolerance = require("tolerance", self.options["tolerance"].rule, self.tolerance)
        options = {name: self.truth.options[name] for name in REFERENCE_OPTIONS}
        for name, value in {"tolerance": tolerance, **options}.items():
            object.__setattr__(self, name, value)

    @cached_property
    def truth(self) -> FrictionHistory:
        """The friction of the simulated arrays that expected errors are relative to."""
        options = {name: getattr(self, name) for name in REFERENCE_OPTIONS}
        return require("AutoMedium", FrictionHistory.read, options)  # type: ignore[no-any-return]

    def choose(self, kind: str, loads: ArrayLike) -> list[ServingMedium]:
        """Choose for each of the ``loads`` the first medium that is accurate enough.

        The loads are of one ``kind``: "force" (N), "pressure" (N/m in the plane, Pa in space) or
        "overlap" (m). Each medium that is chosen is returned once, as a :class:`ServingMedium` with
        its loads; the cheapest comes first. Raises the errors that the class lists.
        """
        load = Load(kind, loads).flat
        candidates, errors = self._find_errors(load)
        # (n_loads,) the first candidate within the tolerance: argmax finds the first True
        candidate_of_load = np.argmax(errors <= self.tolerance, axis=0)
        serving_media = []
        for candidate in np.unique(candidate_of_load):
            load_indices = np.flatnonzero(candidate_of_load == candidate)
            serving_medium = ServingMedium(
                candidates[candidate],
                load_indices,
                self.packing,
                load[load_indices],
                chosen_automatically=True,
                truth=self.truth,
            )
            serving_media.append(serving_medium)
        return serving_media

    def serving(self, kind: str, loads: ArrayLike) -> MediumChoice:
        """Return the first medium that is accurate enough at all ``loads``, or else the last
        candidate, the largest simulation.

        The loads are of one ``kind``, as in :meth:`choose`. Raises the errors that the class lists.
        """
        candidates, errors = self._find_errors(Load(kind, loads).flat)
        sufficient_candidates = np.flatnonzero(np.max(errors, axis=1) <= self.tolerance)
        return (
            candidates[sufficient_candidates[0]] if sufficient_candidates.size else candidates[-1]
        )

    def _find_errors(self, load: Load) -> tuple[list[MediumChoice], Array]:
        """Return the candidates and their expected relative errors (n_candidates, n_loads).

        Raises InputError if errors are not known, or if there is a load at which no candidate is
        within the tolerance; the ``load_index`` of the error is that of the worst load.
        """
        reason = explain_uncovered(self.packing, self.truth)
        if reason is not None:
            problem = f"the errors of the media are not known here: {reason}"
            raise InputError(problem, mend="Name a medium")
        candidates = list_candidates(self.packing, self.truth)
        errors = np.array(
            [medium.expected_error(self.packing, load, self.truth) for medium in candidates]
        )
        least_errors = np.min(errors, axis=0)  # (n_loads,)
        worst_index = int(np.argmax(least_errors))
        if least_errors[worst_index] > self.tolerance:
            least_error = float(least_errors[worst_index])
            refusal = self._explain_failure(load[worst_index], least_error, candidates[-1])
            refusal.load_index = worst_index
            raise refusal
        return candidates, errors

    def _explain_failure(
        self, load: Load, least_error: float, largest_simulation: MediumChoice
    ) -> InputError:
        """Return the error for a ``load`` at which the ``least_error`` of all candidates is above
        the tolerance. The least error is that of the ``largest_simulation``, or infinite if no
        error is known at so low a load.
        """
        load_in_words = load.describe(self.packing.structure.periods)
        if self.truth.is_loaded:
            load_in_words += f" against {self.truth}"
        if math.isfinite(least_error):
            balls = largest_simulation.of(self.packing).arrays[0].balls
            return InputError(
                f"no medium has an expected error of {self.tolerance:g} or less at {load_in_words}",
                f"The smallest expected error there is {least_error:.2g}, of a simulation of"
                f" {balls:,} balls",
                "Raise the tolerance, or simulate more samples by hand",
            )
        least_load = find_least_load(self.packing, load, self.truth)
        if load.kind == "overlap":
            load_in_words += f", a* = {float(reduce_load(self.packing, load)):.3g}"
            least_in_words = f"a* = {least_load:g}"
        else:
            least_in_words = f"a contact force of {write_force(self.packing, least_load)}"
        return InputError(
            f"the errors of the media are not known at {load_in_words}",
            f"They are known from {least_in_words} on",
            "Raise the load, or name a medium",
        )

    def at(self, load: Load, *, finite_overlap: bool | None = None) -> ContactState:
        """Return the state at a load, in the one medium that :meth:`serving` finds for all values
        of the load; InputError if finite overlap is asked for, and for a load that crystals alone
        bear.
        """
        if read_finite_overlap(finite_overlap):
            raise _explain_no_finite_overlap(self.name)
        require_of_packing(load)
        applied = load.applied
        medium = self.serving(applied.kind, applied.array).of(self.packing)
        state: ContactState = medium.at(applied, finite_overlap=finite_overlap)
        return replace(state, chosen_automatically=True)

    def follow(
        self, load: Load, changes: Sequence[Change], finite_overlap: bool | None = None
    ) -> tuple[ContactState, list[Course[Any]]]:
        """Return the state at a single load, and its course with each of the ``changes``, in the
        medium that serves the load; see :meth:`Medium.follow`. The medium stays the same along a
        course. Raises InputError where :meth:`at` does, for ``finite_overlap`` too.
        """
        if read_finite_overlap(finite_overlap):
            raise _explain_no_finite_overlap(self.name)
        require_of_packing(load)
        choice = self.serving(load.applied.kind, load.applied.array)

        def convert(change: Change) -> Change:
            """Return a ``change`` of the automatic medium as one of the medium that is chosen."""

            def change_chosen(step: float) -> tuple[Any, Load]:
                """Return the chosen medium of the changed packing, and the changed load."""
                medium, changed_load = change(step)
                return choice.of(medium.packing), changed_load

            return change_chosen

        def mark_states(course: Course[Any]) -> Course[Any]:
            """Return the course, whose states say that the medium was chosen automatically."""
            return course._replace(
                at=lambda step: replace(course.at(step), chosen_automatically=True)
            )

        medium: Any = choice.of(self.packing)
        state, courses = medium.follow(load, [convert(change) for change in changes])
        marked_courses = [mark_states(course) for course in courses]
        return replace(state, chosen_automatically=True), marked_courses


#: the classes of media of packings by the names that scenes and sweeps use
MEDIA: Registry[type[Medium[Any]]] = Registry("medium")
for _medium in (AveragedLattice, AveragedForce, EffectiveMedium):
    MEDIA.own(_medium.name, _medium)
MEDIA.own(SIMULATION, Later("granphon.media.simulation", "DirectSimulation"))
MEDIA.own(AutoMedium.name, AutoMedium)


#: the media that belong to crystals and to packings in files, by name
_OF_BALLS = {
    CRYSTAL: Later("granphon.media.arrangement", "CrystalMedium"),
    NETWORK: Later("granphon.media.network_file", "NetworkMedium"),
}


def register_medium(medium: T) -> T:
    """Make a class of media known, by its ``name``, to sweeps, scenes and fits.

    ``medium`` is a subclass of :class:`~granphon.LawMedium`, or of another medium, with a ``name``
    of its own; it is called with a packing. Figures call it by its ``words``; a class without
    ``words`` of its own gets its name as these. The class is returned, so that the function may
    stand above it as a decorator. Raises :class:`~granphon.base.errors.InputError` for an argument
    that is no such class, and for a name that is taken.
    """
    candidate: Any = medium
    is_medium = isinstance(candidate, type) and issubclass(candidate, Medium)
    attributes = vars(candidate) if is_medium else {}
    if not isinstance(attributes.get("name"), str):
        mend = "Give a subclass of granphon.LawMedium with a name of its own"
        raise InputError(f"{brief(medium)} is no medium", mend=mend)
    has_words = "words" in attributes
    MEDIA.add(attributes["name"], candidate, candidate)
    if not has_words:
        candidate.words = attributes["name"]
    return medium


def find_medium(name: str) -> type[Any]:
    """Return the class of the medium with a ``name``, also of the media of crystals and of packings
    in files. Raises KeyError if there is none.
    """
    return _OF_BALLS[name].load() if name in _OF_BALLS else MEDIA[name]


def _list_defaults(name: str) -> dict[str, Any]:
    """Return the default of each option of the medium with a ``name``, by the name of the option.
    Raises KeyError if there is no such medium.
    """
    options = find_medium(name).options
    return {option_name: option.default for option_name, option in options.items()}


@dataclass(frozen=True)
class MediumChoice:
    """The name and options of a medium, without a packing.

    Attributes
    ----------
    name : name of the medium, as in a scene file: "ala", "ema", "simulation" and so on.
    options : (name, value) of each option that is not left at its default.

    Raises
    ------
    InputError : a name that no medium has, options that are no pairs of name and value, an option
        that the medium does not have, a value that the option does not take, or options of a
        history of friction that do not go together.
    """

    name: str
    # ``kind`` names Load, as a value of an option may be one: it is restored from plain data
    options: tuple[tuple[str, Load | Any], ...] = field(
        default=(), metadata={"kind": ((str, [Load, object]), ...)}
    )

    def __post_init__(self) -> None:
        """Read name and options, and leave out the options that are at their default."""
        name = require("medium", _read_name, self.name)
        given_options: Any = self.options
        with suppress(TypeError, ValueError):  # what is no list of pairs is refused below
            given_options = dict(given_options)
        options = require(f"medium.{name}", partial(_read_options, name), given_options)
        # options at their default are dropped, so that choices with the same meaning compare equal
        defaults = _list_defaults(name)
        changed_options = [
            (option, value)
            for option, value in sorted(options.items())
            if value != defaults[option]
        ]
        object.__setattr__(self, "options", tuple(changed_options))

    @classmethod
    def parse(
        cls,
        value: str | Mapping[str, Mapping[str, Any] | None] | MediumChoice,
        lattice: Lattice | None = None,
    ) -> MediumChoice:
        """Return the choice that a ``value`` gives: a name such as "ema", a mapping such as {"ema":
        {"local_field": "paper"}}, or a choice. ``lattice`` is as in :func:`read_medium`.

        Raises InputError for any other value.
        """
        medium: MediumChoice = require("medium", partial(read_medium, lattice=lattice), value)
        return medium

    def settings_on(self, lattice: Lattice) -> dict[str, Any]:
        """Return every option of the medium with its value on a ``lattice``, by name, as a scene
        would give it. The lattice decides on the default shape of a sample, and on units.

        Options whose value is None, as a geometry that is not named, are left out. So are all
        options of a history of friction if there is none.
        """
        settings = self.settings
        if "shape" in settings:
            settings["shape"] = settings["shape"] or DEFAULT_SHAPES[lattice.periods]
        if "friction_history" in settings and not self.history.is_loaded:
            for option in HISTORY_OPTIONS:
                settings.pop(option, None)
        start = settings.get("start")
        if isinstance(start, Load):
            quantity = load_quantities(lattice.periods)[start.kind]
            settings["start"] = {start.kind: quantity.write(float(start.array))}
        return {name: value for name, value in settings.items() if value is not None}

    @cached_property
    def label(self) -> str:
        """The name of the medium, with the options that are not at their default in brackets. Other
        options make another label: numbers have all their digits.
        """

        def write(value: Any) -> str:
            """Write the value of an option as a scene would: numbers separated by spaces."""
            if isinstance(value, Load):
                size = value.values[0]
                short_text = f"{size:g}"
                return f"{value.kind} {short_text if float(short_text) == size else size}"
            if isinstance(value, bool):
                return str(value).lower()
            if isinstance(value, tuple):
                return " ".join(map(str, value))
            return str(value)

        options = ", ".join(f"{option}={write(value)}" for option, value in self.options)
        return f"{self.name}({options})" if options else self.name

    @property
    def settings(self) -> dict[str, Any]:
        """Every option with its value, defaults included; a shape whose default depends on the
        lattice is None.
        """
        return _list_defaults(self.name) | dict(self.options)

    @property
    def history(self) -> FrictionHistory:
        """How the simulated arrays of the choice come to their load: by a history of friction if
        the options name one, else at rest without friction.
        """
        return FrictionHistory.read(dict(self.options))

    def expected_error(
        self, packing: Packing, load: Load, against: FrictionHistory = REST
    ) -> Array:
        """Return the expected relative error of velocities and frequencies, with the shape of the
        load.

        The error is relative to arrays with the friction ``against``. It is +inf where it is not
        known, for example of a simulation whose history of friction is another. It is zero where
        every medium is exact: for equal balls, and on a line.

        The error is that of the table of measured errors, and a term for the shear modulus, of
        which half is the error of the transverse velocity. The contacts of a simulation may have
        the directions of the lattice: the term is then the part of the modulus that these leave
        out. The averages were measured against arrays of one W/d: their term is the difference that
        the W/d of the packing makes to what the directions of the lattice leave out.

        Raises the errors of :class:`~granphon.DirectSimulation` for a simulation that balls of the
        ``packing``, whose diameters differ, do not have.
        """
        if not packing.spread_matters:
            return np.zeros(load.shape)
        if not self._has_known_error(against):
            return np.full(load.shape, np.inf)
        deficit = expect_shear_deficit(packing, load, against.is_loaded).reshape(load.shape)
        if self.simulates:
            (simulation,) = self.of(packing).arrays
            balls = simulation.balls * simulation.samples
            missing_modulus = find_left_out(deficit, simulation.geometry)
        else:
            balls = 1  # the table has the error of an average itself, not that of one ball
            rows = find_rows(packing.structure, against)
            table_ratio = rows["width_ratio"] if rows else 0.0
            table_deficit = expect_shear_deficit(packing, load, against.is_loaded, table_ratio)
            missing_modulus = np.abs(deficit - table_deficit.reshape(load.shape))
        error = find_error(self.name, packing, load, balls, against)
        # a velocity goes as the square root of a modulus
        return error + 0.5 * missing_modulus

    def _has_known_error(self, against: FrictionHistory) -> bool:
        """Return whether the table has the error of the medium relative to arrays with the friction
        ``against``.
        """
        settings = self.settings
        if not self.simulates:
            return self.name in AVERAGES and settings.get("local_field") != "paper"
        # a history of friction in the directions of the lattice was not measured
        is_measured = not (against.is_loaded and settings["geometry"] == LATTICE)
        return is_measured and self.history == against

    @property
    def simulates(self) -> bool:
        """Whether the medium is a :class:`~granphon.media.simulation.DirectSimulation`."""
        return self.name == SIMULATION

    @property
    def is_exact(self) -> bool:
        """Whether the options ask for the exact geometry of balls at every load: they name this
        geometry, or they name none and there is a history of friction.

        The choice knows no packing: a history of balls that cannot be exact
        (:func:`~granphon.media.left_out.can_be_exact`) has the directions of the lattice all the
        same, and :meth:`has_finite_overlap` says so. Otherwise a simulation without a named
        geometry leaves it to the load (:meth:`by_geometry`), and this property is False.
        """
        geometry = dict(self.options).get("geometry")
        if geometry is None:
            return self.simulates and self.history.is_loaded
        return bool(geometry == EXACT)

    def has_finite_overlap(self, packing: Balls, wants_terms: bool) -> bool:
        """Return whether the states of the medium of a ``packing`` have the terms of relative order
        delta/d, where ``wants_terms`` says whether the user asks for them; see
        :meth:`Medium.has_finite_overlap`.
        """
        # no simulation has another geometry than the one that is named, and a fit may begin with
        # equal balls, which have no medium in the exact geometry
        geometry = self.settings.get("geometry")
        if geometry is not None:
            return bool(geometry == EXACT)
        return self.of(packing).has_finite_overlap(wants_terms)

    def by_geometry(
        self, packing: Balls, load: Load, finite_overlap: bool = False
    ) -> list[tuple[MediumChoice, list[int]]]:
        """Return pairs: the choice for one geometry, and the indices, in C order, of the values of
        the applied ``load`` that have this geometry.

        If the load decides on the geometry, each choice returned names its geometry as an option;
        with ``finite_overlap`` all values are then exact. Otherwise there is one pair, of this
        choice and all values.
        """
        medium = self.of(packing)
        choices = []
        for medium_in_geometry, indices in medium.by_geometry(load, finite_overlap or None):
            choice_of_geometry = self
            if medium_in_geometry is not medium:  # a simulation, whose geometry the load decides on
                (simulation,) = medium_in_geometry.arrays
                options = (*self.options, ("geometry", simulation.geometry))
                choice_of_geometry = MediumChoice(self.name, options)
            choices.append((choice_of_geometry, indices))
        return choices

    def settle(self, packing: Packing, load: Load, finite_overlap: bool = False) -> MediumChoice:
        """Return the choice in one geometry for all values of the applied ``load``: in the exact
        geometry if :meth:`by_geometry`, with the same arguments, has this for any value.
        """
        choices = [medium for medium, _ in self.by_geometry(packing, load, finite_overlap)]
        return next(
            (medium for medium in choices if medium.settings.get("geometry") == EXACT), choices[0]
        )

    @property
    def stand_in(self) -> MediumChoice:
        """The medium to take in place of this one where very many states are needed: the effective
        medium in place of a simulation, whose states take long; any other medium itself.
        """
        return MediumChoice(EffectiveMedium.name) if self.simulates else self

    def require_fixed(self, what: str) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for an :class:`AutoMedium`, with which
        the task ``what`` cannot be done.
        """
        if self.name == AutoMedium.name:
            raise InputError(
                f"the medium {self.label!r} cannot be used in {what}",
                "It chooses another medium at each load and width",
                "Name a medium",
            )

    def require_arrays(self, what: str) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless the medium simulates arrays, which
        the task ``what`` needs.
        """
        if not self.simulates:
            raise InputError(
                f"the medium {self.label!r} has no array of balls for {what}",
                mend="Take medium: simulation, or in Python gp.Waves of a state's network",
            )

    def require_for(self, balls: Balls) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if these ``balls`` do not have the
        medium: crystals and packings in files have one medium each, which no other balls have.
        """
        # packings have many media, and no name of one as their ``medium_name``
        medium_of_balls = self.name if self.name in _OF_BALLS else ""
        if balls.medium_name != medium_of_balls:
            raise InputError(
                f"the medium is {self.label!r}",
                f"Balls of several kinds have the medium {CRYSTAL} alone, packings in"
                f" files the medium {NETWORK}, and no others have these",
                f"Take {default_medium(balls)}",
            )

    def of(self, packing: Balls) -> Medium[Any]:
        """Return the medium of this packing with the options of the choice. Raises InputError if
        such balls do not have this medium, and the errors of the class of the medium.
        """
        self.require_for(packing)
        options: Any = dict(self.options)
        # a worker process may not know a medium that the user registered: the name is read again
        medium: type[Any] = find_medium(require("medium", _read_name, self.name))
        return medium(packing, **options)  # type: ignore[no-any-return]

    def choose(self, packing: Balls, load: Load) -> list[ServingMedium]:
        """Return the media of a ``packing`` that serve the values of an applied ``load``.

        This medium serves all of them, unless it is an :class:`AutoMedium`, which chooses for each.
        """
        medium = self.of(packing)
        if isinstance(medium, AutoMedium):
            return medium.choose(load.kind, load.array)
        return [ServingMedium(self, np.arange(load.size), packing, load)]


@dataclass(frozen=True, eq=False)
class ServingMedium:
    """A medium that serves some of many loads.

    Attributes
    ----------
    medium : the medium.
    loads : (n,) indices, among the many, of the n loads that it serves.
    packing : the balls.
    load : the load with these n values, in SI.
    chosen_automatically : whether an :class:`AutoMedium` chose the medium for its expected error.
    truth : simulated arrays that the error is relative to.
    is_part : whether the same medium serves other loads in another geometry.
    """

    medium: MediumChoice
    loads: NDArray[np.intp]
    packing: Any
    load: Load
    chosen_automatically: bool = False
    truth: FrictionHistory = REST
    is_part: bool = False

    @property
    def is_quick(self) -> bool:
        """Whether the states of the medium take less than 0.1 s; those of simulations, and of the
        effective medium of long lists of diameters, take longer.
        """
        return self.medium.of(self.packing).is_quick

    @property
    def arrays(self) -> tuple[DirectSimulation, ...]:
        """The medium of the packing if it simulates arrays; none otherwise."""
        return self.medium.of(self.packing).arrays

    @property
    def samples(self) -> list[ServingMedium]:
        """The simulation of each sample alone, by its own seed; none of a medium that simulates no
        arrays. A sample is the same in simulations of one and of many samples.
        """
        options = {name: value for name, value in self.medium.options if name != "samples"}
        samples = []
        for simulation in self.arrays:
            for seed in range(simulation.seed, simulation.seed + simulation.samples):
                sample_options = options | {"shape": simulation.shape, "seed": seed}
                medium = MediumChoice(self.medium.name, tuple(sample_options.items()))
                samples.append(replace(self, medium=medium))
        return samples

    def at(self, load: Load, *, finite_overlap: bool = False) -> ContactState:
        """Return the state of the medium at a ``load``, one or more of those that it serves, with
        terms of finite overlap if ``finite_overlap`` asks for them or the geometry has them. The
        state says whether the medium was chosen automatically.
        """
        medium = self.medium.of(self.packing)
        # False is the default of a scene, and must not forbid the exact geometry: None does not
        state: ContactState = medium.at(load, finite_overlap=finite_overlap or None)
        return replace(state, chosen_automatically=True) if self.chosen_automatically else state

    def has_finite_overlap(self, wants_terms: bool) -> bool:
        """Return whether the states have the terms of relative order delta/d, where ``wants_terms``
        says whether the user asks for them; see :meth:`Medium.has_finite_overlap`.
        """
        return self.medium.has_finite_overlap(self.packing, wants_terms)

    def by_geometry(self, finite_overlap: bool = False) -> list[ServingMedium]:
        """Return this serving medium split by geometry, see :meth:`MediumChoice.by_geometry`, also
        for ``finite_overlap``: for each geometry that its loads have, the medium in that geometry
        with these loads.
        """
        choices = self.medium.by_geometry(self.packing, self.load, finite_overlap)
        if len(choices) == 1:
            [(only_choice, _)] = choices
            return [replace(self, medium=only_choice)]
        serving_media = []
        for medium, indices in choices:
            loads = self.loads[indices]
            load = self.load[indices]
            serving_medium = replace(self, medium=medium, loads=loads, load=load, is_part=True)
            serving_media.append(serving_medium)
        return serving_media

    @cached_property
    def errors(self) -> Array:
        """Expected relative error at each load, (n,), see :meth:`MediumChoice.expected_error`.

        The error is computed when it is first asked for, as a scene that names its medium does not
        need it.
        """
        return self.medium.expected_error(self.packing, self.load, self.truth).ravel()


def list_candidates(packing: Packing, truth: FrictionHistory = REST) -> list[MediumChoice]:
    """Return the media that an :class:`AutoMedium` chooses among, the cheapest first.

    The last is the largest and most accurate simulation, with the friction of the ``truth``. An
    effective medium that is slow, as that of a long list of diameters, is left out.
    """
    if not packing.spread_matters:
        return [MediumChoice(AveragedLattice.name)]  # exact for equal balls, and on a line
    averages = [MediumChoice(name) for name in AVERAGES]
    candidates = [medium for medium in averages if medium.of(packing).is_quick]
    history = tuple(truth.options.items())
    structure = packing.structure
    for side in SIDES[structure.periods]:
        shape = choose_shape(structure, side)
        options = (("shape", shape), *history)
        candidates.append(MediumChoice(SIMULATION, options))
    return candidates


def choose_shape(structure: Lattice, side: float) -> tuple[int, ...]:
    """Return the number of cells along each period, (p,), of a sample whose sides are about
    ``side`` diameters.
    """
    period_lengths = np.linalg.norm(structure.vectors, axis=1)
    return tuple(max(round(side / length), 1) for length in period_lengths.tolist())


def split_label(label: str) -> tuple[str, dict[str, str]]:
    """Return the name of the medium with a :attr:`~MediumChoice.label`, and the options of the
    label by name, with their values as texts.
    """
    name, _, settings_text = label.removesuffix(")").partition("(")
    settings = settings_text.split(", ")
    return name, dict(setting.split("=", 1) for setting in settings if "=" in setting)


def _split_medium(value: Any) -> tuple[Any, Any]:
    """Return the name and the options, unread, of a medium from a ``value`` as :func:`read_medium`
    takes it; the options are None if it has none.
    """
    if isinstance(value, MediumChoice):
        return value.name, dict(value.options)
    if isinstance(value, Mapping) and len(value) == 1:
        name, options = next(iter(value.items()))
        return name, options
    return value, None


def read_medium(value: Any, lattice: Lattice | None = None, written: bool = False) -> MediumChoice:
    """Return the choice of a medium that is given as its name or as {name: {option: value}}. The
    function is a rule of :mod:`granphon.base.validation`.

    With a ``lattice``, the shape of a sample has one length for each of its periods, and a shape
    that is the default on that lattice is left out. What is ``written`` in a file has units;
    otherwise plain numbers are in SI.
    """
    name, options = _split_medium(value)
    _read_name(name)
    has_units = written and not isinstance(value, MediumChoice)
    rule = partial(_read_options, name, lattice=lattice, written=has_units)
    option_values = {} if options is None else read_inside(name, rule, options)
    if lattice is not None and option_values.get("shape") == DEFAULT_SHAPES[lattice.periods]:
        del option_values["shape"]
    return MediumChoice(name, tuple(option_values.items()))


def default_medium(balls: Balls, diameters_differ: bool = False) -> str:
    """Return the name of the medium that balls have if none is named: that of crystals or of
    packings in files, or else the effective medium if ``diameters_differ``, the averaged lattice if
    not.
    """
    name = EffectiveMedium.name if diameters_differ else AveragedLattice.name
    return balls.medium_name or name


def require_finite_overlap(media: Iterable[MediumChoice]) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if one of the ``media`` takes no terms of
    finite overlap: a simulation in the directions of the lattice, or an automatic medium, whose
    expected errors are those of media without these terms.
    """
    for medium in media:
        if medium.name == AutoMedium.name:
            raise _explain_no_finite_overlap(medium.label)
        if medium.settings.get("geometry") == LATTICE:
            raise no_finite_overlap(medium.label)


def _explain_no_finite_overlap(medium: str) -> InputError:
    """Return the error for terms of finite overlap that are asked of an automatic ``medium``."""
    return InputError(
        f"the medium {medium!r} takes no finite_overlap",
        "It chooses by the errors of media, which are known only without these terms",
        "Leave finite_overlap out, or name a medium",
    )


#: what to take in place of a medium that granphon no longer has, by the name of that medium
_REPLACEMENTS = {
    "cluster": "Take {simulation: {shape: 64 64}}, one sample of 64 x 64 balls: it is quicker, and"
    " right at low loads too"
}


def _read_name(value: Any) -> str:
    """Return the name of a medium if there is one of this name; a name of former versions is
    refused with what to take. The function is a rule of :mod:`granphon.base.validation`.
    """
    if is_one_of(value, MEDIA) or is_one_of(value, _OF_BALLS):
        return str(value)
    if is_one_of(value, _REPLACEMENTS):
        raise Refused(show(value), ", ".join(MEDIA), _REPLACEMENTS[value])
    return choice(value, MEDIA)


def _read_options(
    name: str, values: Any, lattice: Lattice | None = None, written: bool = False
) -> dict[str, Any]:
    """Return the options of the medium ``name``, by their names, from the block ``values``; each is
    read by its rule.

    With a ``lattice``, the options ``shape`` and ``start`` are read for its periods. ``written``
    says whether the block stands in a file, where a load in ``start`` has a unit; else it may be a
    number, SI.
    """
    rules = {option_name: option.rule for option_name, option in find_medium(name).options.items()}
    if lattice is not None and "shape" in rules:
        rules["shape"] = partial(read_cells, periods=lattice.periods)
    if lattice is not None and "start" in rules:
        quantities = load_quantities(lattice.periods)

        def read_load(kind: str, value: Any) -> float:
            """Return the value of a load of a kind, SI."""
            is_plain = not written and not isinstance(value, str)
            return real_number(value) if is_plain else quantities[kind].read(value)

        rules["start"] = partial(read_start, load=read_load)
    options = block(values, rules)
    # each option is right by itself: this refuses options of a history that do not go together
    if options and "friction_history" in rules:
        FrictionHistory.read(options)
    return options
