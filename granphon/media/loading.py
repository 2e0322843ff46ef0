"""Samples that are loaded with friction: where the loading starts, its options, and the samples at each load of a path."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from granphon.array.equilibrium import equilibrate
from granphon.array.gas import GAS
from granphon.array.history import REFINEMENT_TOLERANCE, START_SPACING, LoadingHistory
from granphon.array.pressed_sample import SHEAR_RESPONSES, PressedEquilibrium, PressedSample
from granphon.array.pressing import PressedArray
from granphon.array.stencils import Stencils
from granphon.array.steps import ReducedLoad
from granphon.array.true_geometry import ExactGeometry, require_small
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.errors import GranphonError, InputError, Refused, message
from granphon.base.progress import Progress
from granphon.base.results import read_only
from granphon.base.text import show
from granphon.base.validation import choice, number, real_number, require, truth
from granphon.media.equilibria import prescribe, require_load
from granphon.media.left_out import EXACT, GEOMETRIES, LATTICE, can_be_exact, choose_geometries
from granphon.media.medium import Option
from granphon.media.sampled_balls import SampledBalls, require_standing

Array = NDArray[np.float64]
#: least and greatest reduced spacing a* that may be given as a start
_STARTS = (-1.0, 1e6)
#: fraction by which rounding may put a load below the start
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Loading:
    """How samples are loaded with friction.

    Attributes
    ----------
    mindlin_ratio, friction_coefficient : eta and mu of the contacts.
    start : at which samples are at rest without friction, reduced; or "gas": balls apart on their sites.
    shear_response : tangential stiffness under sound, one of :data:`~granphon.array.pressed_sample.SHEAR_RESPONSES`.
    step_tolerance : relative change of f* below which steps of the load are not halved again.
    ordered : whether loads come in the order given; otherwise they rise from the start.
    ratio : W/d in the true geometry of contacts; zero where they keep the directions of the lattice.
    """

    mindlin_ratio: float
    friction_coefficient: float
    start: ReducedLoad | str
    shear_response: str
    step_tolerance: float
    ordered: bool
    ratio: float = 0.0

    def sort(self, prescribed: Sequence[ReducedLoad]) -> list[int]:
        """Return the indices of the loads in the order in which they are applied."""
        places = range(len(prescribed))
        return list(places) if self.ordered else sorted(places, key=lambda place: prescribed[place])


@dataclass(frozen=True)
class Pressed:
    """The samples of one seed at the loads of a path, in the order of the path; and the error at which the path ended."""

    samples: list[PressedSample]
    error: GranphonError | None = None


# -- options ----------------------------------------------------------------------------------------------------------


def read_friction_coefficient(value: Any) -> float | None:
    """Read a friction coefficient: a number, zero or above, infinity too; None is that of no history.

    It is a rule of :mod:`granphon.base.validation`.
    """
    if value is None:
        return None
    word = value.strip().lower() if isinstance(value, str) else ""
    found = math.inf if word in ("inf", "infinite", "infinity") else real_number(value)
    if not found >= 0.0:
        raise Refused(show(value), "a number, zero or above, or inf")
    return found


def read_start(value: Any, load: Callable[[str, Any], float] | None = None) -> float | Load | str | None:
    """Read the start of a loading: a reduced spacing a*, {force: ...}, {pressure: ...}, {overlap: ...}, or "gas".

    It is a rule of :mod:`granphon.base.validation`; ``load(kind, value)`` reads the value of a load.
    """
    if value is None or isinstance(value, Load) or (isinstance(value, str) and value == GAS):
        return value
    kinds = ("force", "pressure", "overlap")
    if isinstance(value, Mapping):
        if len(value) != 1 or next(iter(value)) not in kinds:
            told = " and ".join(map(str, value)) or "an empty block"
            raise Refused(told, "one of " + ", ".join(f"{{{kind}: ...}}" for kind in kinds))
        kind, given = next(iter(value.items()))
        one = f"one {kind}{'' if load else ' in SI, as a plain number'}"
        if isinstance(given, list | tuple | Mapping) or (isinstance(given, np.ndarray) and given.ndim):
            raise Refused(show(given), one, "A loading starts at one load.", (kind,))
        if load is None and not math.isfinite(real_number(given)):
            raise Refused(show(given), one, path=(kind,))
        try:
            return Load(kind, real_number(given) if load is None else load(kind, given))
        except Refused as refused:
            raise refused.under(kind) from None
        except InputError as error:
            raise Refused(show(given), one, str(error), (kind,)) from None
    found = real_number(value)
    if not _STARTS[0] <= found <= _STARTS[1]:
        raise Refused(show(value), f"a reduced spacing a* such as 0.5, a load such as {{force: ...}}, or {GAS}")
    return found


def read_geometry(value: Any) -> str | None:
    """Read the name of a geometry; None leaves it to the load. It is a rule of :mod:`granphon.base.validation`."""
    return None if value is None else choice(value, options=GEOMETRIES)


#: the options that have no meaning without friction_history
LOADING_OPTIONS: Mapping[str, Option] = {
    "friction_coefficient": Option(None, read_friction_coefficient),
    "start": Option(None, read_start),
    "shear_response": Option(SHEAR_RESPONSES[0], partial(choice, options=SHEAR_RESPONSES)),
    "step_tolerance": Option(REFINEMENT_TOLERANCE, partial(number, low=1e-9, high=1.0)),
    "ordered": Option(False, truth),
}
#: those that say whether and how samples are loaded with friction
HISTORY_OPTIONS: Mapping[str, Option] = {"friction_history": Option(False, truth), **LOADING_OPTIONS}


def read_history_options(given: Mapping[str, Any]) -> dict[str, Any]:
    """Read some of :data:`HISTORY_OPTIONS`; :class:`~granphon.base.errors.InputError` for one that is out of range."""
    return {name: require(name, HISTORY_OPTIONS[name].rule, value) for name, value in given.items()}


def refuse_without_history(options: Mapping[str, Any]) -> None:
    """Raise :class:`~granphon.base.errors.Refused` for options of a medium that contradict each other.

    These are options of a history without ``friction_history``, and a history without a friction coefficient.
    """
    if options.get("friction_history"):
        if options.get("friction_coefficient") is None:
            mend = "Give a friction_coefficient too, such as 0.2: it is a property of the surfaces."
            raise Refused("no friction_coefficient", "a number, zero or above, or inf", mend, ("friction_coefficient",))
        return
    for name, option in LOADING_OPTIONS.items():
        default = option.default
        value = options.get(name, default)
        if value is not default and not (isinstance(value, str | float | int) and value == default):
            found = f"{show(options[name])} without friction_history"
            mend = "Samples then come to rest without friction."
            raise Refused(found, f"{name} together with friction_history: true", mend, (name,))


def read_loading(
    packing: Packing, friction_history: bool, geometry: str | None, options: Mapping[str, Any]
) -> tuple[Loading | None, dict[str, Any]]:
    """Return the loading that the options of a simulation describe, None without a history; and the options as read.

    Raises :class:`~granphon.base.errors.InputError` for an option out of range, without ``friction_history``, or without
    meaning for the packing.
    """
    require("DirectSimulation", refuse_without_history, {"friction_history": friction_history, **options})
    ratio = find_ratio(packing, geometry)
    if not friction_history:
        return None, dict(options)
    given = read_history_options(options)
    if packing.structure.periods == 1:
        why = "On a line contacts do not slip, so that friction does nothing"
        raise InputError(message("a chain has no friction_history", why, "Leave it out"))
    if not packing.mindlin_ratio > 0.0:
        why = "The balls of this packing resist no slip (its mindlin_ratio is zero)"
        raise InputError(message("friction_history needs contacts with friction", why, "Give the packing friction=True"))
    given_start = _reduce_start(packing, given["start"], bool(ratio))
    return Loading(packing.mindlin_ratio, **{**given, "start": given_start}, ratio=ratio), given


def find_ratio(packing: Packing, geometry: str | None) -> float:
    """Return W/d for the exact geometry, and zero for that of the lattice, or where the load decides.

    Raises :class:`~granphon.base.errors.InputError` where the exact one is that of the lattice: of equal balls, on a line;
    and where balls differ too much for it.
    """
    if geometry != EXACT:
        return 0.0
    if not packing.spread_matters:
        what = "on a line" if packing.width else "of equal balls"
        why = f"The contacts {what} have the directions of the lattice anyway"
        raise InputError(message(f"the exact geometry {what} is not simulated", why, "Use a medium with finite_overlap"))
    require_small(packing.relative_width)
    return packing.relative_width


def _reduce_start(packing: Packing, start: float | Load | str | None, is_exact: bool) -> ReducedLoad | str:
    """Return the start in reduced units; that of equal balls, which need none, is at the default a*."""
    if isinstance(start, str):
        return start
    if isinstance(start, Load):
        if start.size != 1:
            raise InputError(message(f"start holds {start.size} loads", mend="Give one"))
        return prescribe(packing, start.applied, is_exact)[0]
    return ReducedLoad(overlap=(START_SPACING if start is None else start) - 0.5)


@dataclass(frozen=True, eq=False)
class LoadedBalls(SampledBalls):
    """Balls of samples, and how they are loaded; :class:`granphon.DirectSimulation` describes the fields."""

    friction_history: bool = False
    friction_coefficient: float | None = None
    geometry: str | None = None
    start: float | Load | str | None = None
    shear_response: str = SHEAR_RESPONSES[0]
    step_tolerance: float = REFINEMENT_TOLERANCE
    ordered: bool = False

    options: ClassVar[Mapping[str, Option]] = {
        **SampledBalls.options, "geometry": Option(geometry, read_geometry), **HISTORY_OPTIONS,
    }  # fmt: skip

    #: how samples are loaded with friction; None if they come to rest without
    loading: ClassVar[Loading | None]

    def __post_init__(self) -> None:
        super().__post_init__()
        history = read_history_options({"friction_history": self.friction_history})
        options = {name: getattr(self, name) for name in LOADING_OPTIONS}
        geometry = require("geometry", read_geometry, self.geometry)
        if geometry is None and not can_be_exact(self.packing):
            geometry = LATTICE
        elif geometry is None and history["friction_history"]:
            geometry = EXACT  # otherwise the load decides
        loading, read = read_loading(self.packing, history["friction_history"], geometry, options)
        for name, value in {**history, **read, "geometry": geometry, "loading": loading}.items():
            object.__setattr__(self, name, value)
        self._require_start()

    def _require_start(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for a start that no sample can bear, solving none."""
        start = self.start
        if start is None or isinstance(start, str):
            return
        if not isinstance(start, Load):
            if not self.packing.width:
                return
            start = Load("overlap", self.packing.width * (start - 0.5))
        try:
            require_load(self.packing, start.applied, self._largest)
        except InputError as error:
            refused = InputError(f"the start of the loading: {error}")
            refused.option = "start"
            raise refused from None

    @property
    def is_exact(self) -> bool:
        """Whether contacts have the geometry of the displaced balls, and so finite overlap, whatever the load."""
        return self.geometry == EXACT

    @property
    def named_geometry(self) -> tuple[tuple[str, str], ...]:
        """The option that names the geometry, with its value."""
        return (("geometry", self.geometry),) if self.geometry is not None else ()

    def by_geometry(self, load: Load, finite_overlap: bool | None = None) -> list[tuple[Self, list[int]]]:
        """Return this simulation in each geometry, by word, that it has at values of an applied load, and their places.

        Where no geometry is named, each load has its own (:func:`~granphon.media.left_out.choose_geometries`).
        """
        if self.geometry is not None:
            return [(self, list(range(load.size)))]
        words = choose_geometries(self.packing, load.applied.flat, finite_overlap)
        return [
            (replace(self, geometry=word), [place for place, one in enumerate(words) if one == word])
            for word in dict.fromkeys(words)
        ]

    @property
    def floats(self) -> bool:
        """Whether loose balls float in their cages as samples are pressed from the gas: in the directions of the lattice."""
        return self.loading is not None and self.loading.start == GAS and not self.ratio

    @property
    def resists_slip(self) -> bool:
        """Whether contacts have springs against slip under sound: not where all of them slide, as mu is zero."""
        all_slide = self.friction_coefficient == 0.0 and self.shear_response != "stick"
        return self.packing.mindlin_ratio > 0.0 and not all_slide

    @property
    def ratio(self) -> float:
        """W/d in the true geometry of contacts; zero where they keep the directions of the lattice."""
        return find_ratio(self.packing, self.geometry)

    def _require_standing(self) -> None:
        held = isinstance(self.start, str) and self.start == GAS and self.friction_coefficient != 0
        require_standing(self.packing, bool(self.friction_history), bool(self.friction_history) and held)

    @property
    def _key(self) -> tuple[Any, ...]:
        return (*super()._key, self.geometry, *(getattr(self, name) for name in HISTORY_OPTIONS))


# -- the path ---------------------------------------------------------------------------------------------------------


def press(
    packing: Packing, seed: int | None, deviations: Array, loading: Loading, path: Sequence[ReducedLoad], workers: int,
    report: Callable[[], None] = lambda: None,
) -> Pressed:  # fmt: skip
    """Load a sample with these ``deviations`` along a path, and find its linear response at each load.

    ``report`` is called after each load. An error ends the path and is returned with the samples found before it; its
    ``load_index`` is the place of the load in the path, or None if the start is not found.
    """
    found: list[PressedSample] = []
    try:
        steps = _press_equal if not np.ptp(deviations) else _press_different
        for one in steps(packing, deviations, loading, path, workers):
            sample = PressedSample(packing, seed, one, loading.shear_response)
            _ = sample.elastic_tensor  # every state needs it: found here, it is found in parallel
            found.append(sample)
            report()
    except GranphonError as error:
        error.reached = None  # what of the samples is reached, who asked for them puts together
        return Pressed(found, error)
    return Pressed(found)


def _begin(
    packing: Packing, deviations: Array, loading: Loading, workers: int
) -> tuple[LoadingHistory, PressedArray, Stencils]:
    """Return the history of a sample of different balls at its start, and stencils without friction."""
    structure, shape = packing.structure, deviations.shape[packing.structure.n_balls > 1 :]
    smooth = Stencils(shape, workers=workers, lattice=structure)
    stencils = Stencils(shape, loading.mindlin_ratio, workers, structure)
    geometry = ExactGeometry(stencils, deviations, loading.ratio) if loading.ratio else None
    history = LoadingHistory(
        deviations, stencils, loading.friction_coefficient, loading.step_tolerance, loading.start, geometry=geometry
    )
    try:
        here = history.begin()
    except GranphonError as error:
        error.option = "start"
        raise
    return history, here, smooth


def require_path(packing: Packing, deviations: Array, loading: Loading, path: Sequence[ReducedLoad], workers: int) -> None:
    """Raise as :func:`press` would before its first step, where the start is not at the gas: only the start is solved."""
    if loading.ordered or not np.ptp(deviations):
        return
    history, here, smooth = _begin(packing, deviations, loading, workers)
    smooth.forget()
    _require_above_state(history, here, path)


def _require_above_state(history: LoadingHistory, here: PressedArray, path: Sequence[ReducedLoad]) -> None:
    by_force = path[0].overlap is None
    start = ReducedLoad(here.overlap, history.stepper.measure(here, path[0]) if by_force else here.force)
    require_above(start, path, history.start == GAS)


def _press_different(
    packing: Packing, deviations: Array, loading: Loading, path: Sequence[ReducedLoad], workers: int
) -> Any:
    history, here, smooth = _begin(packing, deviations, loading, workers)
    stencils = history.stencils
    if not loading.ordered:
        _require_above_state(history, here, path)
    states = history.path(path, here)
    for place in range(len(path)):
        try:
            here = next(states)
        except GranphonError as error:
            error.load_index = place
            raise
        yield PressedEquilibrium.of(here, deviations, stencils, loading.ratio).share(deviations, smooth)
    smooth.forget()


def _press_equal(packing: Packing, deviations: Array, loading: Loading, path: Sequence[ReducedLoad], workers: int) -> Any:
    """Yield the equilibria of equal balls, whose contacts never slip: what the load has done since the start is stored."""
    shape = deviations.shape[packing.structure.n_balls > 1 :]
    stencils = Stencils(shape, loading.mindlin_ratio, workers, packing.structure)
    smooth = Stencils(shape, workers=workers, lattice=packing.structure)
    for load in path:
        rest = equilibrate(deviations, load, smooth)
        history = LoadingHistory(deviations, stencils, loading.friction_coefficient, start=rest)
        state = history.begin()
        state = replace(state, work=state.stored - _find_stored(loading.start))
        yield PressedEquilibrium.of(state, deviations, stencils, 0.0).share(deviations, smooth)


def _find_stored(start: ReducedLoad | str) -> float:
    """Return the mean energy that a contact of equal balls stores at the start, in units of c W^(5/2)."""
    if not isinstance(start, ReducedLoad):  # the gas: contacts begin there
        return 0.0
    overlap = start.force ** (2.0 / 3.0) if start.overlap is None else max(start.overlap, 0.0)
    return float(0.4 * overlap**2.5)


def require_above(start: ReducedLoad, path: Sequence[ReducedLoad], from_gas: bool = False) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for the first load of a path that is below the start.

    Of a start that is prescribed as a force alone overlaps are not looked at, and of one as an overlap forces.
    """
    for place, load in enumerate(path):
        if load.overlap is None:
            low = load.force < start.force * (1.0 - _ROUNDING)
        else:
            low = start.overlap is not None and load.overlap < start.overlap - _ROUNDING
        if low:
            there = f"f* = {start.force:.4g}" if start.force else ""
            there += " at " * bool(there and start.overlap is not None)
            there += f"a* = {start.overlap + 0.5:.4g}" if start.overlap is not None else ""
            what = f"the load {_describe(load)} is below the start of the loading, {there}"
            why = "Samples are at rest without friction at the start, and loaded from there"
            lower = "give a lower start, "
            if from_gas:
                why, lower = "Pressed from the gas, the sample stands there at first, and is loaded from there", ""
            mend = f"Raise the load, {lower}or unload along a path: simulation.path(...), in a scene ordered: true"
            error = InputError(message(what, why, mend))
            error.load_index = place
            raise error


def _describe(load: ReducedLoad) -> str:
    return f"f* = {load.force:.4g}" if load.overlap is None else f"a* = {load.overlap + 0.5:.4g}"


def press_all(
    balls: SampledBalls, loading: Loading, prescribed: Sequence[ReducedLoad], progress: Progress
) -> tuple[list[PressedSample], list[int], GranphonError | None]:
    """Load all samples along one path.

    Returns the samples, load by load in the order of their indices, which are returned as well; and the error at which the
    path ended, with the index of its load, if it ended before all loads were reached. Then the loads are those before it.
    """
    order = loading.sort(prescribed)
    path = [prescribed[place] for place in order]
    jobs = [
        partial(press, balls.packing, balls.seed_of(one), read_only(balls.deviations(one)), loading, path, balls.workers)
        for one in range(balls.samples)
    ]
    with progress.step("loading with friction", len(path) * len(jobs)) as step:
        if balls.executor is None:
            found = [job(report=step.advance) for job in jobs]
        else:
            waiting, found = [balls.executor.submit(job) for job in jobs], []
            for one in waiting:
                found.append(one.result())
                step.advance(len(path))
    reached = min(len(one.samples) for one in found)
    places = sorted(range(reached), key=lambda place: order[place])
    samples = [one.samples[place] for place in places for one in found]
    error = next((one.error for one in found if one.error is not None and len(one.samples) == reached), None)
    if error is not None and error.load_index is not None:
        error.load_index = order[error.load_index]
    return samples, [order[place] for place in places], error
