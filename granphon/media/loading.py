"""A sample that is loaded with friction along a path: the sample at each load, and the error at which the path ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from granphon.array.equilibrium import equilibrate
from granphon.array.friction import PressedArray
from granphon.array.geometry import ExactGeometry, ReducedLoad
from granphon.array.history import LoadingHistory
from granphon.array.pressed_sample import PressedEquilibrium, PressedSample
from granphon.array.stencils import Stencils
from granphon.balls.hertz import energy_of, force_of, overlap_of
from granphon.balls.packing import Packing
from granphon.base.errors import GranphonError, InputError
from granphon.media.friction_history import FrictionHistory

Array = NDArray[np.float64]
#: fraction by which rounding may put a load below the start
_ROUNDING = 1e-12


@dataclass(frozen=True)
class LoadedSample:
    """One sample that is loaded with friction.

    Attributes
    ----------
    packing, seed, deviations : the balls; their seed is None if their diameters were given.
    history : how they are loaded.
    ratio : W/d in the exact geometry of contacts; zero where they keep the directions of the lattice.
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

        ``report`` is called after each load. An error ends the path and is returned with the samples found before it; its
        ``load_index`` is the place of the load in the path, or None if the start is not found.
        """
        found: list[PressedSample] = []
        try:
            for one in self._press_different(path) if np.ptp(self.deviations) else self._press_equal(path):
                sample = PressedSample(self.packing, self.seed, one, self.history.shear_response)
                _ = sample.elastic_tensor  # every state needs it: found here, it is found in parallel
                found.append(sample)
                report()
        except GranphonError as error:
            error.reached = None  # what of the samples is reached, who asked for them puts together
            return found, error
        return found, None

    def require_start(self, path: Sequence[ReducedLoad]) -> None:
        """Raise as :meth:`press` does for a load below the start, which alone is solved; not for a start at the gas."""
        if not self.history.ordered and np.ptp(self.deviations):
            self._refuse(*self._begin(), path)

    def _stencils(self, mindlin_ratio: float = 0.0) -> Stencils:
        structure = self.packing.structure
        return Stencils(self.deviations.shape[structure.n_balls > 1 :], mindlin_ratio, self.workers, structure)

    def _begin(self) -> tuple[LoadingHistory, PressedArray]:
        """Return the history of different balls, and their state at its start."""
        stencils, own = self._stencils(self.packing.mindlin_ratio), self.history
        geometry = ExactGeometry(stencils, self.deviations, self.ratio) if self.ratio else None
        start = own.reduce_start(self.packing, bool(self.ratio))
        mu = own.friction_coefficient
        assert mu is not None
        history = LoadingHistory(self.deviations, stencils, mu, own.step_tolerance, start, geometry=geometry)
        try:
            return history, history.begin()
        except GranphonError as error:
            error.option = "start"
            raise

    def _refuse(self, history: LoadingHistory, here: PressedArray, path: Sequence[ReducedLoad]) -> None:
        """Raise for a load of the path below ``here``, the start; one that is ordered goes where it likes."""
        if not self.history.ordered:
            force = history.stepper.measure(here, path[0]) if path[0].overlap is None else here.force
            require_above(ReducedLoad(here.overlap, force), path, isinstance(history.start, str))

    def _press_different(self, path: Sequence[ReducedLoad]) -> Iterator[PressedEquilibrium]:
        history, here = self._begin()
        self._refuse(history, here, path)
        states, smooth = history.path(path, here), self._stencils()
        for place in range(len(path)):
            try:
                here = next(states)
            except GranphonError as error:
                error.load_index = place
                raise
            yield PressedEquilibrium.of(here, self.deviations, history.stencils, self.ratio).share(self.deviations, smooth)
        smooth.forget()

    def _press_equal(self, path: Sequence[ReducedLoad]) -> Iterator[PressedEquilibrium]:
        """Yield the equilibria of equal balls, whose contacts never slip: all work of the load since the start is stored."""
        stencils, smooth = self._stencils(self.packing.mindlin_ratio), self._stencils()
        start, mu = self.history.reduce_start(self.packing, bool(self.ratio)), self.history.friction_coefficient
        assert mu is not None
        stored = 0.0  # mean energy of a contact at the start, in units of c W^(5/2); at the gas contacts begin
        if isinstance(start, ReducedLoad):
            overlap = overlap_of(start.force) if start.overlap is None else max(start.overlap, 0.0)
            stored = float(energy_of(force_of(overlap), overlap))
        for load in path:
            rest = equilibrate(self.deviations, load, smooth)
            state = LoadingHistory(self.deviations, stencils, mu, start=rest).begin()
            state = replace(state, work=state.stored - stored)
            yield PressedEquilibrium.of(state, self.deviations, stencils, 0.0).share(self.deviations, smooth)


def require_above(start: ReducedLoad, path: Sequence[ReducedLoad], from_gas: bool = False) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for the first load of a path that is below the start.

    Of a start that is prescribed as a force alone overlaps are not looked at, and of one as an overlap forces.
    """
    for place, load in enumerate(path):
        if load.overlap is None:
            low, name = load.force < start.force * (1.0 - _ROUNDING), f"f* = {load.force:.4g}"
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
                why, lower = "Pressed from the gas, the sample stands there at first, and is loaded from there", ""
            mend = f"Raise the load, {lower}or unload along a path: simulation.path(...), in a scene ordered: true"
            error = InputError(what, why, mend)
            error.load_index = place
            raise error
