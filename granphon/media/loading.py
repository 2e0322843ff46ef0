"""How simulated samples come to their load: at rest without friction, or loaded with friction, step
by step from a start.

:class:`FrictionHistory` holds it. Its fields are options of a :class:`~granphon.DirectSimulation`,
some also of an :class:`~granphon.AutoMedium` and of a trade-off, which take them as flat keywords
beside ``friction_history``; so do scenes. :meth:`FrictionHistory.read` reads all of these.
:func:`find_equilibria` finds one sample at rest under many loads. A :class:`LoadedSample` is one
sample that is loaded with friction along a path: the sample at each load, and the error at which
the path ends.
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
    equilibrate,
    explain_too_small,
)
from granphon.array.friction import PressedArray
from granphon.array.geometry import ExactGeometry, ReducedLoad
from granphon.array.history import REFINEMENT_TOLERANCE, START_SPACING, LoadingHistory
from granphon.array.pressed_sample import SHEAR_RESPONSES, PressedEquilibrium, PressedSample
from granphon.array.stencils import Stencils
from granphon.array.stepper import GAS
from granphon.array.true_equilibrium import equilibrate_exactly
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
    its shape.
    """
    units = packing.width_units
    values = load.array
    with np.errstate(all="ignore"):  # beyond the floating range f* and a* are infinite
        if load.kind == "overlap":
            return np.asarray(units.reduced_spacing(values))
        if load.kind == "pressure":
            values = values / packing.pressure_per_force
        return np.asarray(units.reduced_force(values))


def prescribe(packing: Packing, load: Load, is_exact: bool = False) -> list[ReducedLoad]:
    """Convert each value of an applied load to a prescribed force or overlap in units of the width,
    in C order.

    In the exact geometry the boundary on which a pressure acts shrinks with the cell.
    """
    if load.kind == "overlap":  # a* would lose the digits of a small overlap
        return [
            ReducedLoad(overlap=one)
            for one in packing.width_units.reduced_overlap(load.array).ravel().tolist()
        ]
    on_boundary = is_exact and load.kind == "pressure"
    return [
        ReducedLoad(force=one, on_boundary=on_boundary)
        for one in reduce_load(packing, load).ravel().tolist()
    ]


def require_load(packing: Packing, load: Load, largest: float) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for an applied load that no sample of a
    packing can bear.

    These are loads beyond the range of the law of equal balls, or that press them together by a
    whole diameter. Where balls differ they are also loads below f* = 1e-8, and overlaps at which
    not even two of the largest balls touch; ``largest`` is the excess of their diameter over the
    mean, m.
    """
    hertz = AveragedLattice(replace(packing, spread=None))
    if packing.width and not packing.spread_matters:
        least = packing.width_units.reduced_force(float(np.min(hertz.at(load).force)))
        if least < THRESHOLD_FORCE:  # no threshold of rigidity is on a line
            what = (
                f"a contact force of f* = {least:.3g} is below {THRESHOLD_FORCE:g}, the least"
                f" that is simulated"
            )
            raise InputError(
                what, mend="Raise the load, or take another medium, which on a line is exact too"
            )
    elif load.kind != "overlap":
        least = packing.width_units.reduced_force(float(np.min(hertz.at(load).force)))
        if packing.width and least < THRESHOLD_FORCE:
            raise explain_too_small(least)
    elif not packing.width:
        hertz.at(load)
    else:
        if np.max(load.array) > packing.width:
            hertz.at(Load("overlap", np.max(load.array)))
        if np.min(load.array) <= -largest:
            raise explain_untouched(load, largest)


def sort_by_load(prescribed: Sequence[ReducedLoad]) -> list[int]:
    """Return the indices of the loads, from the highest load down.

    Each equilibrium is found from that at the next higher load. The starting point affects only
    digits beyond the tolerance; in the true geometry, where it decides where loose balls come to
    rest, each has its own.
    """
    return sorted(range(len(prescribed)), key=lambda i: prescribed[i], reverse=True)


def find_equilibria(
    deviations: Array,
    lattice: Lattice,
    prescribed: Sequence[ReducedLoad],
    workers: int,
    ratio: float = 0.0,
) -> dict[int, Equilibrium]:
    """Find the equilibria of a sample with these ``deviations`` under all loads, by the index of
    the load.

    Each is found from the equilibrium at the next higher load. A ``ratio`` W/d above zero means the
    true geometry: there each is found from the lattice's under the same load, so that it does not
    depend on which others are asked for. An error carries the index of its load as ``load_index``.
    """
    stencils = Stencils(array_shape(deviations, lattice), workers=workers, lattice=lattice)
    out = dict[int, Equilibrium]()
    before = None
    for place in sort_by_load(prescribed):
        try:
            found = out[place] = find_equilibrium(
                deviations, stencils, prescribed[place], before, ratio
            )
            _ = found.stiffness  # every state needs it: found here, it is found in parallel
        except GranphonError as error:
            error.load_index = place
            raise
        before = found.overlap, found.balls
    stencils.forget()
    return out


def find_equilibrium(
    deviations: Array,
    stencils: Stencils,
    load: ReducedLoad,
    before: tuple[float, Array] | None,
    ratio: float = 0.0,
) -> Equilibrium:
    """Find the equilibrium of a sample with these ``deviations`` under one load.

    The search starts from ``before``, the overlap and displacements of an earlier equilibrium,
    unless it is None; in the true geometry it does not.
    """
    if ratio:
        return equilibrate_exactly(deviations, load, ratio, stencils)
    start = None if before is None else Equilibrium(deviations, *before, lattice=stencils.lattice)
    return equilibrate(deviations, load, stencils, start)


#: least and greatest reduced spacing a* that may be given as a start
_STARTS = (-1.0, 1e6)
#: the options of arrays that errors are measured against: they are loaded from the default start,
#: in one direction
REFERENCE_OPTIONS = ("friction_history", "friction_coefficient", "shear_response")
#: fraction by which rounding may put a load below the start
_ROUNDING = 1e-12


@dataclass(frozen=True)
class FrictionHistory:
    """How samples are loaded with friction; the default is that they come to rest without friction.

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
        """Return the history that some options name, of a medium or a trade-off; it may have others
        too.

        It is a rule of :mod:`granphon.base.validation`: :class:`~granphon.base.errors.Refused` for
        an option out of range, a history without a friction coefficient, and options of a history
        without ``friction_history``.
        """
        given = {
            name: read_inside(name, known.rule, options[name])
            for name, known in HISTORY_OPTIONS.items()
            if name in options
        }
        if given.pop("friction_history", False):
            if given.get("friction_coefficient") is None:
                mend = (
                    "Give a friction_coefficient too, such as 0.2: it is a property of the"
                    " surfaces."
                )
                raise Refused(
                    "no friction_coefficient",
                    "a number, zero or above, or inf",
                    mend,
                    ("friction_coefficient",),
                )
            return cls(**given)
        for name, value in given.items():
            if value != HISTORY_OPTIONS[name].default:
                found = f"{show(options[name])} without friction_history"
                mend = "Samples then come to rest without friction."
                raise Refused(found, f"{name} together with friction_history: true", mend, (name,))
        return cls()

    @property
    def is_loaded(self) -> bool:
        """Whether samples are loaded with friction."""
        return self.friction_coefficient is not None

    @property
    def options(self) -> dict[str, Any]:
        """Every option of :data:`HISTORY_OPTIONS`, with its value."""
        return {"friction_history": self.is_loaded} | {
            one.name: getattr(self, one.name) for one in fields(self)
        }

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
        """Return the start in reduced units, or "gas"; that of equal balls, which need none, is at
        the default a*.

        ``is_exact`` says whether balls have their exact geometry, in which a pressure acts on a
        boundary that shrinks.
        """
        if isinstance(self.start, Load):
            return prescribe(packing, self.start.applied, is_exact)[0]
        return self.start if isinstance(self.start, str) else ReducedLoad(overlap=self.start - 0.5)

    def sort(self, prescribed: Sequence[ReducedLoad]) -> list[int]:
        """Return the indices of the loads in the order in which they are applied."""
        places = range(len(prescribed))
        return list(places) if self.ordered else sorted(places, key=lambda place: prescribed[place])

    @property
    def words(self) -> str:
        """How samples come to their load, in words."""
        if self.friction_coefficient is None:
            return "at rest without friction"
        return (
            f"loaded with friction, mu = {self.friction_coefficient:g}, shear_response"
            f" {self.shear_response}"
        )

    def __str__(self) -> str:
        return f"arrays {self.words}"


def read_friction_coefficient(value: Any) -> float | None:
    """Read a friction coefficient: a number, zero or above, infinity too; None is that of no
    history.

    It is a rule of :mod:`granphon.base.validation`.
    """
    if value is None:
        return None
    word = value.strip().lower() if isinstance(value, str) else ""
    found = math.inf if word in ("inf", "infinite", "infinity") else real_number(value)
    if not found >= 0.0:
        raise Refused(show(value), "a number, zero or above, or inf")
    return found


def read_start(value: Any, load: Callable[[str, Any], float] | None = None) -> float | Load | str:
    """Read the start of a loading: a reduced spacing a*, {force: ...}, {pressure: ...}, {overlap:
    ...}, or "gas".

    It is a rule of :mod:`granphon.base.validation`; ``load(kind, value)`` reads the value of a
    load. None is the default.
    """
    if isinstance(value, Load):
        if value.size != 1:
            raise Refused(f"{value.size} loads", "one load")
        return value
    if value is None or (isinstance(value, str) and value == GAS):
        return START_SPACING if value is None else GAS
    kinds = ("force", "pressure", "overlap")
    if isinstance(value, Mapping):
        if len(value) != 1 or next(iter(value)) not in kinds:
            told = " and ".join(map(str, value)) or "an empty block"
            raise Refused(told, "one of " + ", ".join(f"{{{kind}: ...}}" for kind in kinds))
        kind, given = next(iter(value.items()))
        one = f"one {kind}{'' if load else ' in SI, as a plain number'}"
        if isinstance(given, list | tuple | Mapping) or (
            isinstance(given, np.ndarray) and given.ndim
        ):
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
        raise Refused(
            show(value),
            f"a reduced spacing a* such as 0.5, a load such as {{force: ...}}, or {GAS}",
        )
    return found


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
#: samples at rest without friction
REST = FrictionHistory()


# -- a sample that is loaded -----------------------------------------------------------------------


@dataclass(frozen=True)
class LoadedSample:
    """One sample that is loaded with friction.

    Attributes
    ----------
    packing, seed, deviations : the balls; their seed is None if their diameters were given.
    history : how they are loaded.
    ratio : W/d in the exact geometry of contacts; zero where they keep the directions of the
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
        samples found before it; its ``load_index`` is the place of the load in the path, or None if
        the start is not found.
        """
        found: list[PressedSample] = []
        try:
            for one in (
                self._press_different(path) if np.ptp(self.deviations) else self._press_equal(path)
            ):
                sample = PressedSample(self.packing, self.seed, one, self.history.shear_response)
                # every state needs it: found here, it is found in parallel
                _ = sample.elastic_tensor
                found.append(sample)
                report()
        except GranphonError as error:
            error.reached = None  # what of the samples is reached, who asked for them puts together
            return found, error
        return found, None

    def require_start(self, path: Sequence[ReducedLoad]) -> None:
        """Raise as :meth:`press` does for a load below the start, which alone is solved; not for a
        start at the gas.
        """
        if not self.history.ordered and np.ptp(self.deviations):
            self._refuse(*self._begin(), path)

    def _stencils(self, mindlin_ratio: float = 0.0) -> Stencils:
        structure = self.packing.structure
        return Stencils(
            self.deviations.shape[structure.n_balls > 1 :], mindlin_ratio, self.workers, structure
        )

    def _begin(self) -> tuple[LoadingHistory, PressedArray]:
        """Return the history of different balls, and their state at its start."""
        stencils = self._stencils(self.packing.mindlin_ratio)
        own = self.history
        geometry = ExactGeometry(stencils, self.deviations, self.ratio) if self.ratio else None
        start = own.reduce_start(self.packing, bool(self.ratio))
        mu = own.friction_coefficient
        assert mu is not None
        history = LoadingHistory(
            self.deviations, stencils, mu, own.step_tolerance, start, geometry=geometry
        )
        try:
            return history, history.begin()
        except GranphonError as error:
            error.option = "start"
            raise

    def _refuse(
        self, history: LoadingHistory, here: PressedArray, path: Sequence[ReducedLoad]
    ) -> None:
        """Raise for a load of the path below ``here``, the start; one that is ordered goes where it
        likes.
        """
        if not self.history.ordered:
            force = (
                history.stepper.measure(here, path[0]) if path[0].overlap is None else here.force
            )
            require_above(ReducedLoad(here.overlap, force), path, isinstance(history.start, str))

    def _press_different(self, path: Sequence[ReducedLoad]) -> Iterator[PressedEquilibrium]:
        history, here = self._begin()
        self._refuse(history, here, path)
        states = history.path(path, here)
        smooth = self._stencils()
        for place in range(len(path)):
            try:
                here = next(states)
            except GranphonError as error:
                error.load_index = place
                raise
            yield PressedEquilibrium.of(here, self.deviations, history.stencils, self.ratio).share(
                self.deviations, smooth
            )
        smooth.forget()

    def _press_equal(self, path: Sequence[ReducedLoad]) -> Iterator[PressedEquilibrium]:
        """Yield the equilibria of equal balls, whose contacts never slip: all work of the load
        since the start is stored.
        """
        stencils = self._stencils(self.packing.mindlin_ratio)
        smooth = self._stencils()
        start = self.history.reduce_start(self.packing, bool(self.ratio))
        mu = self.history.friction_coefficient
        assert mu is not None
        # mean energy of a contact at the start, in units of c W^(5/2); at the gas contacts begin
        stored = 0.0
        if isinstance(start, ReducedLoad):
            overlap = overlap_of(start.force) if start.overlap is None else max(start.overlap, 0.0)
            stored = float(energy_of(force_of(overlap), overlap))
        for load in path:
            rest = equilibrate(self.deviations, load, smooth)
            state = LoadingHistory(self.deviations, stencils, mu, start=rest).begin()
            state = replace(state, work=state.stored - stored)
            yield PressedEquilibrium.of(state, self.deviations, stencils, 0.0).share(
                self.deviations, smooth
            )


def require_above(start: ReducedLoad, path: Sequence[ReducedLoad], from_gas: bool = False) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for the first load of a path that is below
    the start.

    Of a start that is prescribed as a force alone overlaps are not looked at, and of one as an
    overlap forces.
    """
    for place, load in enumerate(path):
        if load.overlap is None:
            low = load.force < start.force * (1.0 - _ROUNDING)
            name = f"f* = {load.force:.4g}"
        else:
            low = start.overlap is not None and load.overlap < start.overlap - _ROUNDING
            name = f"a* = {load.overlap + 0.5:.4g}"
        if low:
            known = [f"f* = {start.force:.4g}"] if start.force else []
            known += [f"a* = {start.overlap + 0.5:.4g}"] if start.overlap is not None else []
            what = f"the load {name} is below the start of the loading, {' at '.join(known)}"
            why = "Samples are at rest without friction at the start, and loaded from there"
            lower = "give a lower start, "
            if from_gas:
                why = (
                    "Pressed from the gas, the sample stands there at first, and is loaded from"
                    " there"
                )
                lower = ""
            mend = (
                f"Raise the load, {lower}or unload along a path: simulation.path(...), in a scene"
                f" ordered: true"
            )
            error = InputError(what, why, mend)
            error.load_index = place
            raise error
