"""Mechanical equilibrium of an array of balls of different diameters, in reduced units.

In the paper's limit, where spread and overlap are small compared with the diameter, the directions of contacts stay those of
the lattice. In units of W and of the force c W^(3/2) (Section IV) a contact has the overlap

    h = y + (x_i + x_j)/2 - n.(u_j - u_i)

with y = (d - a)/W common to all contacts, and carries the force h_+^(3/2). Equilibrium is the minimum of the sum of
(2/5) h_+^(5/2) over all u; at given load, the minimum over y too, with the work of the load subtracted. This function is
convex. Newton's method finds the minimum; where many contacts are open, an interior-point method
(:mod:`granphon.array.interior`) first goes near it. Conjugate gradients solve the linear equations of each step, no more
accurately than the step needs, in single precision as long as that serves; forces are found in double. The length of a step
is chosen from the slope of the energy along it, never from the energy itself, a large sum in which rounding hides the
changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granphon.array.conjugate_gradients import solve_for_motion
from granphon.array.geometry import LatticeGeometry
from granphon.array.interior import approach
from granphon.array.linear_response import find_linear_response
from granphon.array.preconditioners import Preconditioners
from granphon.array.stencils import Motion, Stencils
from granphon.array.steps import NewtonIterate, ReducedLoad, compute_excess, take_step
from granphon.balls.lattices import TRIANGULAR, Lattice
from granphon.base.errors import ConvergenceError, InputError, message
from granphon.base.results import Result

Array = NDArray[np.float64]
#: largest residual force on a ball, over the mean contact force (or over the rms difference of contact forces, if that is
#: less)
REST_TOLERANCE = 1e-10
#: f* below which a sample with open contacts counts as carrying no load: it is within 1e-5 W of its rigidity threshold, or
#: below it
THRESHOLD_FORCE = 1e-8
#: largest number of steps of Newton's method
_NEWTON_STEPS = 1000
#: fraction of contacts closed on the sites of the lattice, below which the interior-point method comes before Newton's
_CLOSED_ON_SITES = 0.45
#: if the force is given, largest f* at which it does
_MOST_INTERIOR = 1.5e-2
#: f* below which an equilibrium at given force is started from the equilibrium at ten times the force, by Newton's method
_DIRECT_FORCE = 1e-4
#: stiffness added to each contact in a step, as a fraction of the mean stiffness times the distance from equilibrium: where
#: many contacts are open the others do not make a solid, and without it the step would be unbounded
_ADDED_STIFFNESS = 1e-2
#: least rms difference of contact forces, over that of balls held at their sites: in a chain all contacts carry the same
#: force, but for rounding
_LEAST_DIFFERENCE = 1e-4
#: largest residual of a linear system, over its right side. Otherwise it is the ratio by which the step before came nearer
#: to rest, to this power: where balls that nothing holds come to rest, progress is slow, however accurate the steps (S. C.
#: Eisenstat and H. F. Walker, SIAM J. Sci. Comput. 17, 16 (1996), choose accuracies in this way)
_LOOSEST, _PROGRESS = 0.15, 1.2
#: length of a step below which the linear equations of later ones are solved in double precision
_SPOILT_LENGTH = 0.3
#: force of a contact, over the largest residual force on a ball, above which the contact counts as carrying load. In
#: practice the ratio is either far below one or above a hundred
CARRIED_FORCE = 10.0
#: relative error of the linear response: that of the stiffness is its square, that of its slope of the same order
_RESPONSE = 1e-8


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Result):
    """Sample at rest, in units of W and c W^(3/2).

    Attributes
    ----------
    deviations : (L1, ..., Lp) x = Delta/W of the balls; (n, L1, ..., Lp) of n > 1 balls in the cell.
    overlap : y, common to all contacts.
    balls : (n p, L1, ..., Lp) displacements in units of W, in the coordinates of :class:`~granphon.array.stencils.Stencils`.
    residual : largest force left on a ball, divided by the mean contact force.
    newton, conjugate : number of steps taken by Newton's method and by conjugate gradients.
    lattice : the lattice of the contacts.

    In arrays of contacts the first axis is the kind of contact, in the order of the lattice's table: (n_c, L1, ..., Lp).
    """

    _shapes = {"deviations": "..."}

    deviations: Array
    overlap: float
    balls: Array
    residual: float = math.inf
    newton: int = 0
    conjugate: int = 0
    lattice: Lattice = TRIANGULAR

    def __reduce__(self) -> tuple[Any, ...]:
        # keep derivatives already found: each costs a linear response, and another process may have asked for them
        found = {name: vars(self)[name] for name in ("_derivatives",) if name in vars(self)}
        return *super().__reduce__(), found

    def share(self, deviations: Array, stencils: Stencils) -> Self:
        """Return the same equilibrium with ``deviations``, equal to its own, and ``stencils`` shared with others."""
        other, known = replace(self, deviations=deviations), vars(self)
        vars(other).update({name: known[name] for name in ("_derivatives",) if name in known}, stencils=stencils)
        return other

    @cached_property
    def stencils(self) -> Stencils:
        """Compatibility matrix C of the array, without slips."""
        return Stencils(array_shape(self.deviations, self.lattice), lattice=self.lattice)

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the arrays do not belong to balls on the lattice."""
        super()._check()
        shape = array_shape(self.deviations, self.lattice)
        wanted = self.lattice.n_balls * self.lattice.periods, *shape
        if len(shape) != self.lattice.periods or np.shape(self.balls) != wanted:
            found = f"deviations of the shape {np.shape(self.deviations)} and balls of {np.shape(self.balls)}"
            raise InputError(message(f"the Equilibrium has {found}, which is no array of the {self.lattice.name} lattice"))

    @property
    def differences(self) -> Array:
        """(n_c, L1, ..., Lp) differences h - y of the contacts' overlaps from the common one."""
        still = Motion(self.balls, 0.0)
        return self.stencils.average_pairs(self.deviations) - self.stencils.deformations(still)

    @property
    def overlaps(self) -> Array:
        """(n_c, L1, ..., Lp) overlaps h of the contacts; below zero where balls are apart."""
        return self.overlap + self.differences

    @property
    def forces(self) -> Array:
        """(n_c, L1, ..., Lp) contact forces h_+^(3/2)."""
        closed = np.maximum(self.overlaps, 0.0)
        return closed * np.sqrt(closed)

    @property
    def excess(self) -> Array:
        """(n_c, L1, ..., Lp) contact forces minus y_+^(3/2), found without the loss of digits of a subtraction."""
        return compute_excess(self.overlap, self.differences)[0]

    @property
    def stiffnesses(self) -> Array:
        """(n_c, L1, ..., Lp) stiffnesses (3/2) h^(1/2) of the contacts that carry load; zero for the others."""
        return 1.5 * self._roots

    @property
    def stiffness_slopes(self) -> Array:
        """(n_c, L1, ..., Lp) slopes of the stiffnesses, (3/4) h^(-1/2); zero where no load is carried."""
        root = self._roots
        return np.divide(0.75, root, out=np.zeros_like(root), where=root > 0.0)

    @property
    def _roots(self) -> Array:
        """Square roots h^(1/2) of overlaps where contacts carry load; zero where the force may be a residual only.

        The iteration leaves balls that nothing holds where they touch others with a trace of force. Shear springs at such
        contacts would hold them.
        """
        overlaps = self.overlaps
        least = (CARRIED_FORCE * self.residual * self.force) ** (2.0 / 3.0)
        return np.asarray(np.sqrt(np.where(overlaps > least, overlaps, 0.0)))

    @property
    def force(self) -> float:
        """Mean contact force f*, a reduced number."""
        return float(max(self.overlap, 0.0) ** 1.5) + float(np.mean(self.excess))

    @property
    def energy(self) -> float:
        """Mean energy of a contact, in units of c W^(5/2)."""
        return float(np.mean(0.4 * self.forces * np.maximum(self.overlaps, 0.0)))

    @property
    def boundary_force(self) -> float:
        """Force f*, a reduced number, at which the pressure is the same where the cell keeps its size."""
        return self.force

    def response(self) -> Array:
        """Return (n_c, L1, ..., Lp) derivatives of the contacts' overlaps with respect to y; computed anew at each call."""
        stiffness = self.stiffnesses
        (balls,) = find_linear_response(self.stencils, stiffness, [stiffness - find_uniform_part(stiffness)], _RESPONSE)
        return np.asarray(1.0 - self.stencils.deformations(Motion(balls, 0.0)))

    @cached_property
    def _derivatives(self) -> tuple[float, float]:
        response = self.response()
        return float(np.mean(self.stiffnesses * response**2)), float(np.mean(self.stiffness_slopes * response**3))

    @property
    def stiffness(self) -> float:
        """Stiffness df*/dy, a reduced number."""
        return self._derivatives[0]

    @property
    def stiffness_slope(self) -> float:
        """Slope of the stiffness, d^2f*/dy^2.

        By the (2n + 1)-theorem the third derivative of the energy needs the first response only.
        """
        return self._derivatives[1]


def find_uniform_part(stiffness: Array) -> float:
    """Return a stiffness that may be subtracted from that of every contact in the response to a uniform strain.

    Equal tension in all contacts moves nothing, so any constant may be subtracted. Where all contacts are closed, and so
    nearly alike, the mean is subtracted to save digits. Where some are open the result is zero: the rounding of a subtracted
    constant would pull at balls that nothing holds.
    """
    return float(np.mean(stiffness)) if np.all(stiffness) else 0.0


def array_shape(deviations: Array, lattice: Lattice) -> tuple[int, ...]:
    """Return the numbers of cells (L1, ..., Lp) of an array with these deviations; see :class:`Equilibrium`."""
    return np.shape(deviations)[lattice.n_balls > 1 :]


def equilibrate(
    deviations: Array,
    load: ReducedLoad,
    stencils: Stencils | None = None,
    start: Equilibrium | None = None,
    tolerance: float = REST_TOLERANCE,
) -> Equilibrium:
    """Find the equilibrium of an array of balls under a load.

    Parameters
    ----------
    deviations : x = Delta/W, of mean zero; (L1, ..., Lp), or (n, L1, ..., Lp) of n > 1 balls in the cell.
    load : overlap or mean contact force, reduced.
    stencils : of the array; by default those of the triangular lattice.
    start : equilibrium from which to begin, for example that of the same balls under a similar load.
    tolerance : largest force left on a ball, over the mean contact force, or over the rms difference of contact forces if
        that is less: at high loads the effect of disorder is itself only a small part of the force.

    Raises
    ------
    InputError : the sample carries no load at this overlap; or no start is given and the force is below f* = 1e-8.
    ConvergenceError : the tolerance is not reached; the message states the residual that is.
    """
    stencils = stencils or Stencils(deviations.shape)
    free = load.overlap is None
    means = stencils.average_pairs(deviations)
    equal = not np.ptp(deviations)
    if free and start is None and load.force < THRESHOLD_FORCE and not equal:
        raise explain_too_small(load.force)
    if start is None and free and load.force < _DIRECT_FORCE and not equal:
        start = equilibrate(deviations, load._replace(force=10.0 * load.force), stencils, tolerance=1e-3)
    fresh = start is None or equal
    if start is None or equal:  # begin at the overlap of Hertz's law, which is exact for equal balls
        y = load.overlap if load.overlap is not None else load.force ** (2.0 / 3.0)
        start = Equilibrium(deviations, float(y), np.zeros((stencils.n_fields, *stencils.shape)), lattice=stencils.lattice)
    y, balls, steps, begun = start.overlap if free else float(load.overlap or 0.0), start.balls, 0, 0
    least = _LEAST_DIFFERENCE * float(np.std(means))
    inverses = Preconditioners(stencils)
    near = _DIRECT_FORCE <= load.force <= _MOST_INTERIOR if free else np.mean(y + means > 0.0) < _CLOSED_ON_SITES
    # in space the interior-point method takes too many iterations without factors
    if near and not equal and (len(stencils.shape) < 3 or inverses.are_small):
        found = approach(LatticeGeometry(stencils, deviations), y, balls, load.force if free else None, inverses, fresh)
        y, balls, begun, steps = found or (y, balls, begun, steps)
    elif fresh and not equal and y + float(np.min(means)) > 0.0:
        # all contacts are closed on the sites: begin where springs that are alike would bring the balls. Where some are
        # open, balls that nothing holds stay nearer to their sites if they begin there
        balls = stencils.green_preconditioner(means.dtype, 1.0)(stencils.forces(means))
    # linear equations need few digits, and single precision takes half of the time
    single, before = not begun, 0.0
    here = NewtonIterate.find(y, balls, means, load, stencils)
    for newton in range(begun, _NEWTON_STEPS):
        if not free and here.force < THRESHOLD_FORCE and not np.all(here.root):
            raise InputError(
                message(
                    f"at an overlap of {here.overlap:.6g} widths this sample carries no load",
                    f"Its force is below f* = {THRESHOLD_FORCE:g}: too few balls touch to hold each other",
                    "Press it together more",
                )
            )
        distance = here.distance(least, stencils)
        if distance <= tolerance:
            state = Equilibrium(
                deviations=deviations, overlap=here.overlap, balls=_centre(here.balls, stencils),
                residual=here.left / here.force, newton=newton, conjugate=steps, lattice=stencils.lattice,
            )  # fmt: skip
            return state.share(deviations, stencils)  # keeps the Green's function of the stencils
        reduction = min(_LOOSEST, max(0.3 * tolerance / distance, (distance / before) ** _PROGRESS if before else _LOOSEST))
        stiffness = here.root if single else here.root.astype(float)
        stiffness *= 1.5 / here.level
        stiffness += _ADDED_STIFFNESS * min(1.0, distance)
        product = stencils.hessian(stiffness)
        inverse = inverses.choose(stiffness, product=product) if begun else stencils.preconditioner(stiffness, product)
        # forces and stiffnesses near one: single precision has no numbers below 1e-38
        size = max(float(np.max(np.abs(here.rest.balls))), abs(here.rest.compression) / means.size)
        rest = Motion((here.rest.balls / size).astype(stiffness.dtype), here.rest.compression / size)
        mean = float(np.mean(stiffness)) if free else None
        step, taken = solve_for_motion(product, rest, inverse, reduction, mean)
        scale = size / here.level
        step = Motion(step.balls.astype(float) * scale, step.compression * scale)
        inverses.count(taken)
        here, length = take_step(here, step, means, load, stencils)
        # where balls that nothing holds move far, single precision may spoil a step
        steps, before, single = steps + taken, distance, single and length > _SPOILT_LENGTH
    raise ConvergenceError(
        message(
            f"the sample has not come to rest after {_NEWTON_STEPS} steps",
            f"At an overlap of {here.overlap:.6g} widths a force of {here.left / here.force:.2g} of the mean contact force "
            "is left on a ball",
            "Raise the load, or take fewer balls",
        )
    )


def explain_too_small(force: float) -> InputError:
    """Return the error for a reduced force below :data:`THRESHOLD_FORCE`."""
    return InputError(
        message(
            f"a mean contact force of f* = {force:.3g} is below {THRESHOLD_FORCE:g}",
            "Such a sample is at its rigidity threshold, where its equilibrium cannot be found",
            "Raise the load",
        )
    )


def _centre(balls: Array, stencils: Stencils) -> Array:
    """Return the displacements minus their mean: a motion of the whole array costs nothing."""
    fields = balls.reshape(stencils.n_balls, -1, *stencils.shape)
    means = np.mean(fields, axis=(0, *range(2, fields.ndim)), keepdims=True)
    return np.asarray((fields - means).reshape(balls.shape))
