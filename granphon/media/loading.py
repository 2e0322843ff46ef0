"""How simulated samples come to their load: at rest without friction, or loaded with friction, step
by step from a start.

The options are those of :mod:`granphon.media.array_options`. :func:`find_equilibria` finds one
sample at rest under many loads. A :class:`LoadedSample` is one sample that is loaded with friction
along a path.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from granphon.array.equilibrium import (
    THRESHOLD_FORCE,
    Equilibrium,
    array_shape,
    explain_too_small,
)
from granphon.array.history import LoadingHistory
from granphon.array.options import ReducedLoad
from granphon.array.pressed_array import PressedArray
from granphon.array.pressed_place import PressedGeometry
from granphon.array.pressed_sample import PressedEquilibrium, PressedSample
from granphon.array.rest import bring_to_rest
from granphon.array.sheared_equilibrium import equilibrate_sheared
from granphon.array.stencils import Stencils
from granphon.balls.hertz import energy_of, force_of, overlap_of
from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load, require_of_packing
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.base.errors import GranphonError, InputError
from granphon.media.array_options import FrictionHistory, sort_by_load
from granphon.media.medium import AveragedLattice, explain_untouched


def require_load(packing: Packing, load: Load, largest_excess: float) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for an applied load that no sample of a
    packing can bear.

    Refused are loads that crystals alone bear, loads under which equal balls do not press each
    other, loads beyond the range of the law of equal balls, and those that press equal balls
    together by a whole diameter. Where balls differ, forces and pressures below f* = 1e-8 are
    refused too. Overlaps of such balls may be zero or below, but not so small that not even two of
    the largest balls touch; on a line, where all contacts have one force, overlaps are refused as
    forces are. ``largest_excess`` is the excess of the largest diameter over the mean, m.
    """
    require_of_packing(load)
    equal_balls = AveragedLattice(replace(packing, spread=None))
    # on a line balls that differ have the law of equal balls, and overlaps are treated as forces
    if load.kind == "overlap" and packing.spread_matters:
        greatest_overlap = np.max(load.array)
        if greatest_overlap >= packing.diameter:
            equal_balls.at(Load("overlap", greatest_overlap))  # raises for too large an overlap
        # two of the largest balls touch where the overlap of mean balls is minus their excess
        if np.min(load.array) <= -largest_excess:
            raise explain_untouched(load, largest_excess)
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

    A ``ratio`` W/d above zero means the true geometry, zero the directions of the lattice. With the
    ``boundary`` "stress" the cell shears until its stress is hydrostatic. ``workers`` is the number
    of threads for each Fourier transform. An error has the index of its load as ``load_index``.

    In the directions of the lattice, unless the cell shears, each equilibrium is found from the one
    at the next higher load. Otherwise the search starts from the lattice, so that no equilibrium
    depends on the other loads.
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
        return bring_to_rest(deviations, load, stencils, ratio=ratio)
    start = None
    if previous is not None:
        start = Equilibrium(deviations, *previous, lattice=stencils.lattice)
    return bring_to_rest(deviations, load, stencils, start)


#: difference by which rounding may put a load below the start: of forces over that of the start,
#: of overlaps in units of the width
_ROUNDING = 1e-12


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
        """Load the sample along a path, and return the sample at each load that is reached, with
        its linear response, and the error that ended the path, or None.

        ``report`` is called after each load. The ``load_index`` of the error is the index of its
        load in the path; None if the start is not found, or if the error does not know its load.
        """
        samples: list[PressedSample] = []
        yield_equilibria = self._press_different if self._has_spread else self._press_equal
        response = self.history.shear_response
        try:
            for equilibrium in yield_equilibria(path):
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
        """Solve the start alone, and raise :class:`~granphon.base.errors.InputError` for a load of
        the path below it, the error that :meth:`press` would return.

        Nothing is raised for equal balls, nor for loads in the order of the user, which may go
        below the start.
        """
        if self._has_spread and not self.history.ordered:
            history, start = self._begin()
            self._require_above(history, start, path)

    @property
    def _has_spread(self) -> bool:
        """Whether the balls of the sample differ."""
        return bool(np.ptp(self.deviations))

    def _make_stencils(self, mindlin_ratio: float = 0.0) -> Stencils:
        """Return new stencils of the sample for contacts with a ``mindlin_ratio`` kappa/k, by
        default without friction.
        """
        structure = self.packing.structure
        shape = array_shape(self.deviations, structure)
        return Stencils(shape, mindlin_ratio, self.workers, structure)

    def _begin(self) -> tuple[LoadingHistory, PressedArray]:
        """Return the history of a sample whose balls differ, and the array at its start.

        An error of the start has "start" as its ``option``.
        """
        stencils = self._make_stencils(self.packing.mindlin_ratio)
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
        """Raise InputError for a load of the ``path`` below the ``start``, the array at the start
        of the ``history``; for loads in the order of the user raise nothing.
        """
        if self.history.ordered:
            return
        start_force = start.force
        # under forces the start is measured as its load is: on a boundary that may have shrunk
        if path[0].overlap is None:
            start_force = history.stepper.measure(start, path[0])
        start_load = ReducedLoad(start.overlap, start_force)
        require_above(start_load, path, from_gas=self.history.from_gas)

    def _press_different(self, path: Sequence[ReducedLoad]) -> Iterator[PressedEquilibrium]:
        """Yield the equilibrium at each load of the path, of balls that differ and are loaded step
        by step from the start. An error while a load is approached has its index as ``load_index``.
        """
        history, state = self._begin()
        self._require_above(history, state, path)
        states = history.path(path, state)
        frictionless_stencils = self._make_stencils()  # shared by all equilibria of the path
        for index in range(len(path)):
            try:
                state = next(states)
            except GranphonError as error:
                error.load_index = index
                raise
            equilibrium = PressedEquilibrium.of(
                state, self.deviations, history.stencils, self.ratio
            )
            yield equilibrium.share(self.deviations, frictionless_stencils)
        frictionless_stencils.forget()

    def _press_equal(self, path: Sequence[ReducedLoad]) -> Iterator[PressedEquilibrium]:
        """Yield the equilibrium at each load of the path, of equal balls. Their contacts never
        slip, so that the path does not matter, and all work of the load since the start is stored
        as energy.
        """
        stencils = self._make_stencils(self.packing.mindlin_ratio)
        frictionless_stencils = self._make_stencils()
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
            rest = bring_to_rest(self.deviations, load, frictionless_stencils)
            array = LoadingHistory(self.deviations, stencils, mu, start=rest).begin()
            loaded_array = replace(array, work=array.stored - start_energy)
            equilibrium = PressedEquilibrium.of(loaded_array, self.deviations, stencils, 0.0)
            yield equilibrium.share(self.deviations, frictionless_stencils)


def require_above(start: ReducedLoad, path: Sequence[ReducedLoad], from_gas: bool = False) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for the first load of a path that is below
    the start.

    Loads given as overlaps are compared with the overlap of the start, or not at all if the start
    has no overlap. Loads given as forces are compared with the force of the start, which is zero if
    the start is an overlap alone. With ``from_gas`` the message says that the start was found by
    pressing balls from the gas.
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
    """Return the error for a ``load`` below the ``start``, which was found by pressing the sample
    from the gas (``from_gas``), or was prescribed.
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
