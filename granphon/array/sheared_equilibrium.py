"""Mechanical equilibrium without friction of an array whose cell may shear, until its stress is
hydrostatic.

Elsewhere the cell of an array keeps its shape: the mean of its principal stresses is the pressure,
and a small sample of balls that differ bears some shear stress. Here all strains of the cell are
free, as those of a crystal are. The balls, as an assembly (:mod:`granphon.contacts.assembly`), come
to rest under a pressure (:mod:`granphon.statics.find_rest`). In the directions of the lattice one
search for rest is enough: a mean force follows from the pressure alone, by the virial, and at a
given overlap only the shears of the cell are free. In true directions the pressure under which the
cell has a given overlap or mean force is searched for.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from granphon.array.equilibrium import (
    REST_TOLERANCE,
    THRESHOLD_FORCE,
    Equilibrium,
    explain_no_load,
    explain_too_small,
)
from granphon.array.geometry import LOAD_TOLERANCE, require_small
from granphon.array.options import ReducedLoad
from granphon.array.rest import (
    LEAST_TOLERANCE,
    apply_load,
    assemble,
    bring_to_rest,
    explain_unrest,
    find_residual,
    gather_balls,
)
from granphon.array.stencils import Stencils
from granphon.array.true_equilibrium import TrueEquilibrium
from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError, InputError
from granphon.contacts.assembly import Assembly
from granphon.statics.configuration import AppliedLoad, Geometry
from granphon.statics.find_rest import find_rest
from granphon.statics.options import RestOptions
from granphon.statics.rest import Rest

#: options of each search for rest, whose residuals are over the mean force of all contacts
_OPTIONS = RestOptions(tolerance=LEAST_TOLERANCE, negligible_force=REST_TOLERANCE, of_all=True)
#: greatest number of pressures that are tried for a mean force or an overlap: searches of 12 x 12
#: balls at f* from 1e-3 to 10, with W up to a tenth of d, took five or fewer
_MOST_PRESSURES = 40


def equilibrate_sheared(
    deviations: Array, load: ReducedLoad, ratio: float, stencils: Stencils
) -> Equilibrium:
    """Return the equilibrium without friction of an array whose cell shears until its stress is
    hydrostatic.

    Parameters
    ----------
    deviations, load, stencils : as in :func:`~granphon.array.rest.bring_to_rest`. The overlap is
        that of a cell of the same size and an even spacing.
    ratio : W/d in the true geometry; zero in the directions of the lattice.

    Raises
    ------
    InputError : the sample carries no load at this overlap or force; or the ratio is below zero or
        too large.
    ConvergenceError : a search does not come to rest, or no pressure is found for the load.
    InstabilityError : as in :func:`~granphon.array.rest.bring_to_rest`.
    """
    require_small(ratio)
    if stencils.lattice.periods == 1 or not np.ptp(deviations):
        # a line cannot shear, and the stress of equal balls is hydrostatic already
        return bring_to_rest(deviations, load, stencils, ratio=ratio or None)
    if load.overlap is None and load.force < THRESHOLD_FORCE:
        raise explain_too_small(load.force)
    search = _PressureSearch(deviations, ratio, stencils)
    if load.overlap is None and (load.on_boundary or not ratio):
        return search.press(load.force)
    if load.overlap is None:
        goal = load.force

        def measure(state: Equilibrium) -> float:
            """Return the overlap, in W, of equal balls that have the mean force of a ``state``."""
            return float(hertz.overlap_of(state.force))

        return search.find(goal, measure, float(hertz.overlap_of(goal)), explain_too_small(goal))
    # contacts that keep their directions bear no less than those that turn: if they bear nothing at
    # this overlap, the search ends here with an error
    lattice_rest = search.keep_size(load.overlap)
    if not ratio:
        return search.make_state(lattice_rest)
    guess = float(np.mean(hertz.force_of(np.maximum(lattice_rest.overlap, 0.0))))
    no_load = explain_no_load(load.overlap)
    return search.find(guess, lambda state: state.overlap, load.overlap, no_load)


class _PressureSearch:
    """The equilibria of one array under pressures, each searched for from the last.

    A pressure is given as the mean contact force f* that has this pressure in a cell that keeps its
    size.
    """

    def __init__(self, deviations: Array, ratio: float, stencils: Stencils) -> None:
        self._deviations = deviations
        self._ratio = ratio
        self._stencils = stencils
        # in the directions of the lattice nothing depends on the diameter
        self._assembly: Assembly = assemble(deviations, stencils, ratio or 1.0)
        self._last_rest: Rest | None = None
        self._steps = 0
        self._iterations = 0

    def keep_size(self, overlap: float) -> Rest:
        """Return the rest, in the directions of the lattice, of a cell that shears but keeps the
        size of the ``overlap`` y. Side effect: the rest is kept as the start of the next search.

        For an array in true directions the rest is only a start, and is found with a looser
        tolerance.

        Raises :class:`~granphon.base.errors.InputError` if the sample carries no load there.
        """
        scale = self._ratio or 1.0
        load = apply_load(self._assembly, ReducedLoad(overlap=overlap), scale, 1.0)
        load = replace(load, shears=True)
        options = _OPTIONS.loosen() if self._ratio else _OPTIONS
        try:
            return self._find_rest(load, "lattice", options)
        except InputError as error:
            raise explain_no_load(overlap) from error

    def press(self, force: float) -> Equilibrium:
        """Return the equilibrium under the pressure that stands for a mean contact ``force`` f*.
        Side effect: the equilibrium is kept as the start of the next search.
        """
        load = apply_load(self._assembly, ReducedLoad(force=force, on_boundary=True), 1.0, 1.0)
        geometry: Geometry = "exact" if self._ratio else "lattice"
        return self.make_state(self._find_rest(load, geometry, _OPTIONS))

    def find(
        self,
        guess: float,
        measure: Callable[[Equilibrium], float],
        goal: float,
        no_load: InputError,
    ) -> Equilibrium:
        """Return the equilibrium whose ``measure``, an overlap in W, is the ``goal``.

        The search begins at the pressure ``guess``, given as f* above zero. It goes by secants: the
        unknown is the overlap that equal balls have under the pressure, and the measure is a nearly
        linear function of it.

        Raises the error ``no_load`` where a pressure is so small that the sample carries no load,
        and :class:`~granphon.base.errors.ConvergenceError` if no pressure is found.
        """
        overlap = hertz.overlap_of(guess)  # of equal balls
        slope = 1.0  # derivative of this overlap with respect to the measure
        last_trial: tuple[float, float] | None = None  # overlap and lack
        for _ in range(_MOST_PRESSURES):
            force = hertz.force_of(overlap)
            if force < THRESHOLD_FORCE:
                raise no_load
            state = self.press(force)
            lack = goal - measure(state)
            if abs(lack) <= LOAD_TOLERANCE * max(1.0, abs(goal)):
                return state
            if last_trial is not None:
                last_overlap, last_lack = last_trial
                change = overlap - last_overlap
                gain = last_lack - lack
                slope = change / gain if gain * change > 0.0 else slope
            last_trial = (overlap, lack)
            # above zero, and not far from the last trial
            overlap = min(max(overlap + slope * lack, 0.5 * overlap), 2.0 * overlap)
        problem = "no pressure is found under which the sample has this load"
        raise ConvergenceError(problem, mend="Raise the load, or give a pressure")

    def _find_rest(self, load: AppliedLoad, geometry: Geometry, options: RestOptions) -> Rest:
        """Return the rest under a ``load``, found from the last one. Side effects: the rest is kept
        as the start of the next search, and its steps and iterations are added to those of all
        searches.

        Raises the errors of :func:`~granphon.statics.find_rest.find_rest`.
        """
        try:
            rest = find_rest(self._assembly, load, geometry, "stress", self._last_rest, options)
        except ConvergenceError as error:
            if error.reached is None:
                raise
            overlap, _ = split_strain(error.reached.strain, self._ratio)
            raise explain_unrest(error.reached, overlap) from error
        self._last_rest = rest
        self._steps += rest.steps
        self._iterations += rest.iterations
        return rest

    def make_state(self, rest: Rest) -> Equilibrium:
        """Return the equilibrium of balls at ``rest``; its numbers of steps are those of all
        searches so far.
        """
        stencils = self._stencils
        ratio = self._ratio
        overlap, strain = split_strain(rest.strain, ratio)
        # only the class of the true geometry follows overlaps as contacts turn
        state_class = TrueEquilibrium if ratio else Equilibrium
        state = state_class(
            deviations=self._deviations,
            overlap=overlap,
            balls=gather_balls(rest, stencils),
            residual=find_residual(rest),
            newton=self._steps,
            conjugate=self._iterations,
            lattice=stencils.lattice,
            ratio=ratio,
            strain=strain,
        )
        # a new state copies its deviations, and would make stencils of its own: one set is enough
        return state.share(self._deviations, stencils)


def split_strain(strain: Array, ratio: float) -> tuple[float, Array]:
    """Return the two parts of the ``strain`` (p, p) of a cell: the overlap y, in W, of an evenly
    compressed cell of the same size, and the strain (p, p), in units of W/d, that is added to the
    even one, -y.

    ``ratio`` is W/d in the true geometry, where the length of contacts at touch is d/W. Otherwise
    it is zero: strains are small, and the length of contacts is one.
    """
    p = len(strain)
    if ratio:  # cells of the same size have the same determinant of 1 + strain
        logarithms = np.log1p(np.linalg.eigvalsh(strain))
        overlap = -math.expm1(float(np.mean(logarithms))) / ratio
    else:
        overlap = -float(np.trace(strain)) / p
    overlap += 0.0  # makes a zero below zero one without a sign
    return overlap, strain / (ratio or 1.0) + overlap * np.eye(p)


def equilibrate_as(
    state: Equilibrium, load: ReducedLoad, tolerance: float | None = None
) -> Equilibrium:
    """Return the equilibrium of the balls of a ``state`` under a ``load`` near the one that it
    bears, in the same geometry and with the same boundary.

    If the cell keeps its shape, the search begins at the ``state``; in the true geometry it begins
    where the balls of the state rest under the ``load`` to first order. It ends at the
    ``tolerance`` of :func:`~granphon.array.rest.bring_to_rest`. If the cell has sheared, the balls
    come to rest anew, and the tolerance is not used.
    """
    if state.strain is not None:
        return equilibrate_sheared(state.deviations, load, state.ratio, state.stencils)
    start = state.approach(load) if isinstance(state, TrueEquilibrium) else state
    ratio = state.ratio or None
    return bring_to_rest(state.deviations, load, state.stencils, start, tolerance, ratio)
