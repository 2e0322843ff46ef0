"""How simulated samples come to their load: at rest without friction, or loaded with friction, step
by step from a start.

The fields of a :class:`FrictionHistory` are options of a :class:`~granphon.DirectSimulation`, and
some are options of an :class:`~granphon.AutoMedium` and of a trade-off. All three take the options
as flat keywords beside ``friction_history``, and scenes do too; :meth:`FrictionHistory.read` reads
them. :func:`find_equilibria` finds one sample at rest under many loads. A :class:`LoadedSample` is
one sample that is loaded with friction along a path: the sample at each load, and the error at
which the path ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, Self

import numpy as np

from granphon.array.equilibrium import (
    THRESHOLD_FORCE,
    Equilibrium,
    array_shape,
    explain_too_small,
)
from granphon.array.geometry import ReducedLoad
from granphon.array.history import REFINEMENT_TOLERANCE, START_SPACING, LoadingHistory
from granphon.array.pressed_array import PressedArray
from granphon.array.pressed_place import PressedGeometry
from granphon.array.pressed_sample import SHEAR_RESPONSES, PressedEquilibrium, PressedSample
from granphon.array.rest import equilibrate
from granphon.array.sheared_equilibrium import equilibrate_sheared
from granphon.array.stencils import Stencils
from granphon.array.stepper import GAS
from granphon.balls.hertz import energy_of, force_of, overlap_of
from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.base.errors import GranphonError, InputError, Refused
from granphon.base.text import show
from granphon.base.validation import choice, number, read_inside, real_number, truth
from granphon.media.medium import AveragedLattice, Option, explain_untouched


def reduce_load(packing: Packing, load: Load) -> Array:
    """Return f* of each value of an applied load, or a* of a load that is given as an overlap, with
    the shape of the load.
    """
    units = packing.width_units
    with np.errstate(all="ignore"):  # beyond the floating range f* and a* are infinite
        if load.kind == "overlap":
            return np.asarray(units.reduced_spacing(load.array))
        forces = load.array
        if load.kind == "pressure":
            forces = load.array / packing.pressure_per_force
        return np.asarray(units.reduced_force(forces))


def prescribe(packing: Packing, load: Load, is_exact: bool = False) -> list[ReducedLoad]:
    """Return the prescribed force or overlap, in units of the width, of each value of an applied
    load, in C order.

    In the exact geometry the boundary on which a pressure acts shrinks with the cell.
    """
    if load.kind == "overlap":  # a* would lose the digits of a small overlap
        overlaps = packing.width_units.reduced_overlap(load.array).ravel().tolist()
        return [ReducedLoad(overlap=overlap) for overlap in overlaps]
    on_boundary = is_exact and load.kind == "pressure"
    forces = reduce_load(packing, load).ravel().tolist()
    return [ReducedLoad(force=force, on_boundary=on_boundary) for force in forces]


def require_load(packing: Packing, load: Load, largest: float) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for an applied load that no sample of a
    packing can bear.

    Such loads are beyond the range of the law of equal balls, or press equal balls together by a
    whole diameter. Where balls differ, forces and pressures below f* = 1e-8 are refused too (on a
    line also such overlaps), and overlaps at which not even two of the largest balls touch;
    ``largest`` is the excess of the largest diameter over the mean, m.
    """
    equal_balls = AveragedLattice(replace(packing, spread=None))
    # balls that differ on a line have the law of equal ones
    if load.kind == "overlap" and packing.spread_matters:
        greatest = np.max(load.array)
        if greatest > packing.width:
            equal_balls.at(Load("overlap", greatest))  # raises for too large an overlap
        # two of the largest balls touch where the overlap of mean balls is minus their excess
        if np.min(load.array) <= -largest:
            raise explain_untouched(load, largest)
        return
    forces = equal_balls.at(load).force
    if not packing.width:
        return
    least_force = packing.width_units.reduced_force(float(np.min(forces)))
    if least_force >= THRESHOLD_FORCE:
        return
    if packing.spread_matters:
        raise explain_too_small(least_force)
    # on a line there is no threshold of rigidity that the error could name
    raise InputError(
        f"a contact force of f* = {least_force:.3g} is below f* = {THRESHOLD_FORCE:g}, the least"
        f" that is simulated",
        mend="Raise the load, or take another medium, which on a line is exact too",
    )


def sort_by_load(prescribed: Sequence[ReducedLoad]) -> list[int]:
    """Return the indices of the loads, from the highest load down.

    Each equilibrium is found from the one at the next higher load. The starting point affects only
    digits beyond the tolerance. In the true geometry the starting point decides where loose balls
    come to rest: there each equilibrium has a starting point of its own.
    """
    return sorted(range(len(prescribed)), key=lambda index: prescribed[index], reverse=True)


def find_equilibria(
    deviations: Array,
    lattice: Lattice,
    prescribed: Sequence[ReducedLoad],
    workers: int,
    ratio: float = 0.0,
    boundary: str = "isotropic",
) -> dict[int, Equilibrium]:
    """Return the equilibria of a sample with these ``deviations`` (of the shape of the array, in
    units of the width) under all ``prescribed`` loads, by the index of the load.

    Each equilibrium is found from the one at the next higher load. A ``ratio`` W/d above zero means
    the true geometry: there each equilibrium is found from that of the lattice under the same load,
    so that it does not depend on the other loads. With the ``boundary`` "stress" the cell shears
    until its stress is hydrostatic. ``workers`` is the number of threads for each
    Fourier transform. An error carries the index of its load as ``load_index``.
    """
    stencils = Stencils(array_shape(deviations, lattice), workers=workers, lattice=lattice)
    equilibria = dict[int, Equilibrium]()
    previous = None
    for index in sort_by_load(prescribed):
        try:
            equilibrium = find_equilibrium(
                deviations, stencils, prescribed[index], previous, ratio, boundary
            )
            # every state needs the stiffness: found here, it is found by workers in parallel
            _ = equilibrium.stiffness
        except GranphonError as error:
            error.load_index = index
            raise
        equilibria[index] = equilibrium
        previous = equilibrium.overlap, equilibrium.balls
    stencils.forget()
    return equilibria


def find_equilibrium(
    deviations: Array,
    stencils: Stencils,
    load: ReducedLoad,
    previous: tuple[float, Array] | None,
    ratio: float = 0.0,
    boundary: str = "isotropic",
) -> Equilibrium:
    """Return the equilibrium of a sample with these ``deviations`` under one load.

    The search starts from ``previous``, the overlap and displacements of an earlier equilibrium, if
    there is one. In the true geometry, with a ``ratio`` W/d above zero, and with the ``boundary``
    "stress", the search starts from the lattice.
    """
    if boundary == "stress":
        return equilibrate_sheared(deviations, load, ratio, stencils)
    if ratio:
        return equilibrate(deviations, load, stencils, ratio=ratio)
    start = None
    if previous is not None:
        start = Equilibrium(deviations, *previous, lattice=stencils.lattice)
    return equilibrate(deviations, load, stencils, start)


#: least and greatest reduced spacing a* that may be given as a start
_STARTS = (-1.0, 1e6)
#: the options of arrays that errors are measured against; such arrays are loaded from the default
#: start, in one direction
REFERENCE_OPTIONS = ("friction_history", "friction_coefficient", "shear_response")
#: difference by which rounding may put a load below the start: of forces over that of the start,
#: of overlaps in units of the width
_ROUNDING = 1e-12


@dataclass(frozen=True)
class FrictionHistory:
    """How samples are loaded with friction; by default samples come to rest without friction.

    Attributes
    ----------
    friction_coefficient : mu of the contacts, zero to infinity; None of samples at rest without
        friction.
    shear_response : tangential stiffness under sound, one of
        :data:`~granphon.array.pressed_sample.SHEAR_RESPONSES`.
    start : where the loading starts, at rest without friction: a reduced spacing a*, or a load; or
        "gas": balls apart on their sites.
    step_tolerance : relative change of f* below which steps of the load are not halved again.
    ordered : whether loads come in the order given; otherwise they rise from the start.
    """

    friction_coefficient: float | None = None
    shear_response: str = SHEAR_RESPONSES[0]
    start: float | Load | str = START_SPACING
    step_tolerance: float = REFINEMENT_TOLERANCE
    ordered: bool = False

    @classmethod
    def read(cls, options: Mapping[str, Any]) -> Self:
        """Return the history that the ``options`` of a medium or a trade-off name; other options
        are left alone.

        The method is a rule of :mod:`granphon.base.validation`: it raises
        :class:`~granphon.base.errors.Refused` for an option out of range, a history without a
        friction coefficient, and options of a history without ``friction_history``.
        """
        history_options: dict[str, Any] = {}
        for name, option in HISTORY_OPTIONS.items():
            if name in options:
                history_options[name] = read_inside(name, option.rule, options[name])
        has_history = history_options.pop("friction_history", False)
        if has_history and history_options.get("friction_coefficient") is None:
            raise Refused(
                "no friction_coefficient",
                "a number, zero or above, or inf",
                "Give a friction_coefficient too, such as 0.2: it is a property of the surfaces.",
                ("friction_coefficient",),
            )
        if has_history:
            return cls(**history_options)
        for name, value in history_options.items():
            if value != HISTORY_OPTIONS[name].default:
                raise Refused(
                    f"{show(options[name])} without friction_history",
                    f"{name} together with friction_history: true",
                    "Samples then come to rest without friction.",
                    (name,),
                )
        return cls()

    @property
    def is_loaded(self) -> bool:
        """Whether samples are loaded with friction."""
        return self.friction_coefficient is not None

    @property
    def options(self) -> dict[str, Any]:
        """Every option of :data:`HISTORY_OPTIONS`, with its value."""
        options = {option.name: getattr(self, option.name) for option in fields(self)}
        return {"friction_history": self.is_loaded} | options

    @property
    def reference(self) -> Self:
        """The same friction in the arrays that errors are measured against, see
        :data:`REFERENCE_OPTIONS`.
        """
        return type(self)(self.friction_coefficient, self.shear_response)

    @property
    def from_gas(self) -> bool:
        """Whether the loading starts at the gas: balls apart on their sites."""
        return isinstance(self.start, str)

    def reduce_start(self, packing: Packing, is_exact: bool) -> ReducedLoad | str:
        """Return the start in reduced units, or "gas".

        ``is_exact`` says whether balls have their exact geometry, in which a pressure acts on a
        boundary that shrinks.
        """
        if isinstance(self.start, Load):
            (start,) = prescribe(packing, self.start.applied, is_exact)
            return start
        if isinstance(self.start, str):
            return self.start
        return ReducedLoad(overlap=self.start - 0.5)  # y = a* - 1/2

    def sort(self, prescribed: Sequence[ReducedLoad]) -> list[int]:
        """Return the indices of the loads in the order in which they are applied."""
        indices = list(range(len(prescribed)))
        if not self.ordered:
            indices.sort(key=lambda index: prescribed[index])
        return indices

    @property
    def words(self) -> str:
        """How samples come to their load, in words."""
        mu = self.friction_coefficient
        if mu is None:
            return "at rest without friction"
        return f"loaded with friction, mu = {mu:g}, shear_response {self.shear_response}"

    def __str__(self) -> str:
        return f"arrays {self.words}"


def read_friction_coefficient(value: Any) -> float | None:
    """Read a friction coefficient: a number, zero or above, infinity too; None means no history.

    The function is a rule of :mod:`granphon.base.validation`.
    """
    if value is None:
        return None
    word = value.strip().lower() if isinstance(value, str) else ""
    is_infinite = word in ("inf", "infinite", "infinity")
    coefficient = math.inf if is_infinite else real_number(value)
    if not coefficient >= 0.0:
        raise Refused(show(value), "a number, zero or above, or inf")
    return coefficient


def read_start(value: Any, load: Callable[[str, Any], float] | None = None) -> float | Load | str:
    """Read the start of a loading: a reduced spacing a*, {force: ...}, {pressure: ...}, {overlap:
    ...}, or "gas".

    The function is a rule of :mod:`granphon.base.validation`; ``load(kind, value)`` reads the value
    of a load, in SI; without it the value is a plain number in SI. A ``value`` of None is the
    default start, a* = 1/2.
    """
    if isinstance(value, Load):
        if value.size != 1:
            raise Refused(f"{value.size} loads", "one load")
        return value
    if value is None:
        return START_SPACING
    if isinstance(value, str) and value == GAS:
        return GAS
    if isinstance(value, Mapping):
        return _read_start_load(value, load)
    spacing = real_number(value)
    if not _STARTS[0] <= spacing <= _STARTS[1]:
        allowed = f"a reduced spacing a* such as 0.5, a load such as {{force: ...}}, or {GAS}"
        raise Refused(show(value), allowed)
    return spacing


def _read_start_load(
    block: Mapping[Any, Any], read_load: Callable[[str, Any], float] | None
) -> Load:
    """Return the start of a loading from a block {force: ...}, {pressure: ...} or {overlap: ...},
    whose value ``read_load`` reads; without it the value is a plain number in SI.
    """
    kinds = ("force", "pressure", "overlap")
    if len(block) != 1 or next(iter(block)) not in kinds:
        keys = " and ".join(map(str, block)) or "an empty block"
        raise Refused(keys, "one of " + ", ".join(f"{{{kind}: ...}}" for kind in kinds))
    [(kind, value)] = block.items()
    allowed = f"one {kind}" if read_load else f"one {kind} in SI, as a plain number"
    is_array = isinstance(value, np.ndarray) and value.ndim > 0
    if is_array or isinstance(value, list | tuple | Mapping):
        raise Refused(show(value), allowed, "A loading starts at one load.", (kind,))
    if read_load is None and not math.isfinite(real_number(value)):
        raise Refused(show(value), allowed, path=(kind,))
    try:
        size = real_number(value) if read_load is None else read_load(kind, value)
        return Load(kind, size)
    except Refused as refused:
        raise refused.under(kind) from None
    except InputError as error:
        raise Refused(show(value), allowed, str(error), (kind,)) from None


#: the options that say whether and how samples are loaded with friction
HISTORY_OPTIONS: Mapping[str, Option] = {
    "friction_history": Option(False, truth),
    "friction_coefficient": Option(FrictionHistory.friction_coefficient, read_friction_coefficient),
    "start": Option(FrictionHistory.start, read_start),
    "shear_response": Option(
        FrictionHistory.shear_response, partial(choice, options=SHEAR_RESPONSES)
    ),
    "step_tolerance": Option(FrictionHistory.step_tolerance, partial(number, low=1e-9, high=1.0)),
    "ordered": Option(FrictionHistory.ordered, truth),
}
#: the history of samples at rest without friction
REST = FrictionHistory()


# -- a sample that is loaded -----------------------------------------------------------------------


@dataclass(frozen=True)
class LoadedSample:
    """One sample that is loaded with friction.

    Attributes
    ----------
    packing, seed, deviations : the balls, with the deviations of their diameters over W, in the
        shape of the array; the seed is None if their diameters were given.
    history : how the sample is loaded.
    ratio : W/d in the exact geometry of contacts; zero where contacts keep the directions of the
        lattice.
    workers : number of threads for each Fourier transform.
    """

    packing: Packing
    seed: int | None
    deviations: Array
    history: FrictionHistory
    ratio: float
    workers: int

    def press(
        self, path: Sequence[ReducedLoad], report: Callable[[], None] = lambda: None
    ) -> tuple[list[PressedSample], GranphonError | None]:
        """Load the sample along a path, and find its linear response at each load.

        ``report`` is called after each load. An error ends the path and is returned with the
        samples of the loads that were reached. Its ``load_index`` is the index of the load in the
        path; None if the start is not found, or an error does not know its load.
        """
        samples: list[PressedSample] = []
        press = self._press_different if np.ptp(self.deviations) else self._press_equal
        response = self.history.shear_response
        try:
            for equilibrium in press(path):
                sample = PressedSample(self.packing, self.seed, equilibrium, response)
                # every state needs the tensor: found here, it is found by workers in parallel
                _ = sample.elastic_tensor
                samples.append(sample)
                report()
        except GranphonError as error:
            error.reached = None  # the caller joins the states that all samples have reached
            return samples, error
        return samples, None

    def require_start(self, path: Sequence[ReducedLoad]) -> None:
        """Raise for a load of the path below the start, an error that :meth:`press` returns; the
        start alone is solved. Nothing is raised for equal balls, nor for loads in the order of the
        user, which may go below the start.
        """
        balls_differ = bool(np.ptp(self.deviations))
        if balls_differ and not self.history.ordered:
            history, start = self._begin()
            self._require_above(history, start, path)

    def _stencils(self, mindlin_ratio: float = 0.0) -> Stencils:
        """Return the stencils of the sample; without a ``mindlin_ratio`` those of smooth balls."""
        structure = self.packing.structure
        shape = array_shape(self.deviations, structure)
        return Stencils(shape, mindlin_ratio, self.workers, structure)

    def _begin(self) -> tuple[LoadingHistory, PressedArray]:
        """Return the history of different balls, and their state at its start."""
        stencils = self._stencils(self.packing.mindlin_ratio)
        geometry = PressedGeometry(stencils, self.deviations, self.ratio)
        start = self.history.reduce_start(self.packing, is_exact=bool(self.ratio))
        mu = self.history.friction_coefficient
        assert mu is not None
        tolerance = self.history.step_tolerance
        history = LoadingHistory(self.deviations, stencils, mu, tolerance, start, geometry=geometry)
        try:
            return history, history.begin()
        except GranphonError as error:
            error.option = "start"
            raise

    def _require_above(
        self, history: LoadingHistory, start: PressedArray, path: Sequence[ReducedLoad]
    ) -> None:
        """Raise for a load of the path below ``start``, unless the loads of the path are ordered by
        the user.
        """
        if self.history.ordered:
            return
        start_force = start.force
        if path[0].overlap is None:  # a force, which may act on a boundary that shrinks
            start_force = history.stepper.measure(start, path[0])
        start_load = ReducedLoad(start.overlap, start_force)
        require_above(start_load, path, from_gas=isinstance(history.start, str))

    def _press_different(self, path: Sequence[ReducedLoad]) -> Iterator[PressedEquilibrium]:
        """Yield the equilibria of balls that differ, loaded step by step from the start."""
        history, state = self._begin()
        self._require_above(history, state, path)
        states = history.path(path, state)
        smooth = self._stencils()
        for index in range(len(path)):
            try:
                state = next(states)
            except GranphonError as error:
                error.load_index = index
                raise
            equilibrium = PressedEquilibrium.of(
                state, self.deviations, history.stencils, self.ratio
            )
            yield equilibrium.share(self.deviations, smooth)
        smooth.forget()

    def _press_equal(self, path: Sequence[ReducedLoad]) -> Iterator[PressedEquilibrium]:
        """Yield the equilibria of equal balls, whose contacts never slip: all work of the load
        since the start is stored as energy.
        """
        stencils = self._stencils(self.packing.mindlin_ratio)
        smooth = self._stencils()
        start = self.history.reduce_start(self.packing, is_exact=bool(self.ratio))
        mu = self.history.friction_coefficient
        assert mu is not None
        # mean energy of a contact at the start, in units of c W^(5/2); zero at the gas
        start_energy = 0.0
        if isinstance(start, ReducedLoad):
            if start.overlap is None:
                start_overlap = overlap_of(start.force)
            else:
                start_overlap = max(start.overlap, 0.0)
            start_energy = float(energy_of(force_of(start_overlap), start_overlap))
        for load in path:
            at_rest = equilibrate(self.deviations, load, smooth)
            pressed = LoadingHistory(self.deviations, stencils, mu, start=at_rest).begin()
            pressed = replace(pressed, work=pressed.stored - start_energy)
            equilibrium = PressedEquilibrium.of(pressed, self.deviations, stencils, 0.0)
            yield equilibrium.share(self.deviations, smooth)


def require_above(start: ReducedLoad, path: Sequence[ReducedLoad], from_gas: bool = False) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for the first load of a path that is below
    the start.

    Overlaps are not compared with a start that is prescribed as a force alone, nor forces with a
    start that is prescribed as an overlap alone. ``from_gas`` says for the message that the start
    was found by pressing balls from the gas.
    """
    for index, load in enumerate(path):
        if load.overlap is None:
            is_below = load.force < start.force * (1.0 - _ROUNDING)
        else:
            is_below = start.overlap is not None and load.overlap < start.overlap - _ROUNDING
        if is_below:
            error = _explain_below(start, load, from_gas)
            error.load_index = index
            raise error


def _explain_below(start: ReducedLoad, load: ReducedLoad, from_gas: bool) -> InputError:
    """Return the error of a load below the start, which was found by pressing the sample
    ``from_gas`` or prescribed.
    """
    load_in_words = f"f* = {load.force:.4g}"
    if load.overlap is not None:
        load_in_words = f"a* = {load.overlap + 0.5:.4g}"
    start_in_words = []
    if start.force:
        start_in_words.append(f"f* = {start.force:.4g}")
    if start.overlap is not None:
        start_in_words.append(f"a* = {start.overlap + 0.5:.4g}")
    problem = (
        f"the load {load_in_words} is below the start of the loading, {' at '.join(start_in_words)}"
    )
    path_mend = "unload along a path: simulation.path(...), in a scene ordered: true"
    if from_gas:
        why = "Pressed from the gas, the sample stands there at first, and is loaded from there"
        return InputError(problem, why, f"Raise the load, or {path_mend}")
    why = "Samples are at rest without friction at the start, and loaded from there"
    return InputError(problem, why, f"Raise the load, give a lower start, or {path_mend}")
