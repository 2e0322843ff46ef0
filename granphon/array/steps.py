"""Points on the way to equilibrium, and steps between them; see :mod:`granphon.array.equilibrium`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.array.stencils import Motion, Stencils, dot

Array = NDArray[np.float64]
#: fraction of a given load by which rounding may miss it
_LOAD_ROUNDING = 1e-15
#: force left on a ball that the rounding of displacements explains, in units of it times the stiffness
_MOVE_ROUNDING = 16.0
#: tolerance of the load, as a fraction of the tolerance of forces: the load, a number that the user gave, is met to more
#: digits
_LOAD_TOLERANCE = 1e-3
#: largest number of trials for the length of a step
_LENGTH_TRIALS = 30
#: number of contacts that are worked on at a time, so that they stay in the processor's cache
_CACHED = 2**14


class ReducedLoad(NamedTuple):
    """Prescribed load: the reduced ``overlap`` y or, if that is None, the reduced mean contact ``force`` f*.

    If ``on_boundary`` is true, the load is a pressure: ``force`` is the f* under it where the cell keeps its size. In the
    true geometry the boundary shrinks with the cell.
    """

    overlap: float | None = None
    force: float = 0.0
    on_boundary: bool = False


def compute_excess(overlap: float, differences: Array, out: Array | None = None) -> tuple[Array, Array]:
    """Return h_+^(3/2) - y_+^(3/2) and h_+^(1/2) for h = y + difference."""
    common = max(overlap, 0.0)
    change = np.maximum(differences, -overlap, out=out)  # h_+ - y_+
    if overlap < 0.0:
        change += overlap
    root = change + common
    np.sqrt(root, out=root)
    if common == 0.0:
        change *= root
        return change, root
    # the difference of the powers 3/2, over that of h and y, is h^(1/2) + y/(h^(1/2) + y^(1/2))
    factor = root + math.sqrt(common)
    np.divide(common, factor, out=factor)
    factor += root
    change *= factor
    return change, root


class NewtonIterate(NamedTuple):
    """Balls on the way to equilibrium: what their place tells of the contacts, and how far they are from rest.

    Attributes
    ----------
    overlap, balls : y and the displacements.
    root : (contacts, L1, ..., Lp) h_+^(1/2) of the contacts, in single precision.
    rest : force left on the balls and, at given load, what the contacts' forces lack to it in sum.
    force, spread : mean and standard deviation of the contact forces.
    level : mean stiffness of the contacts.
    left : largest force left on a ball.
    """

    overlap: float
    balls: Array
    root: Array
    rest: Motion
    force: float
    spread: float
    level: float
    left: float

    @classmethod
    def find(
        cls, y: float, balls: Array, means: Array, load: ReducedLoad, stencils: Stencils, forces: _Forces | None = None
    ) -> NewtonIterate:
        """Return the state with the ``forces`` of contacts, if these are at hand."""
        forces = forces or _Forces.find(y, balls, means, stencils)
        pull = stencils.forces(forces.excess)
        contacts, common = means.size, max(y, 0.0) ** 1.5
        mean, square, stiffness = (one / contacts for one in (forces.sum, forces.square, 1.5 * forces.roots))
        force = common + mean
        push = (load.force - common) - mean if load.overlap is None else 0.0
        # where overlaps are small, near the rigidity threshold and on a line, the spacing of doubles at y and at the
        # displacements is too coarse to meet the load
        spacing = math.ulp(max(y, float(np.max(np.abs(balls)))))
        push *= abs(push) > _LOAD_ROUNDING * force + spacing * stiffness
        left = math.sqrt(float(np.max(np.sum(stencils.cartesian(pull) ** 2, axis=0))))
        spread, rest = math.sqrt(max(0.0, square - mean**2)), Motion(pull, contacts * push)
        return cls(y, balls, forces.root, rest, force, spread, stiffness, left)

    def distance(self, least: float, stencils: Stencils) -> float:
        """Return the force left over the scale that tolerances are of; forces no larger than ``least`` count as that."""
        push = self.rest.compression / self.root.size
        scale = min(self.force, max(self.spread, self.level * least))
        # on a line displacements add up, as in a random walk, and all that is left in the end is their rounding
        moved = float(np.max(np.abs(self.balls))) if len(stencils.shape) == 1 else 0.0
        at_rest = self.left <= _MOVE_ROUNDING * math.ulp(moved) * self.level
        # the load itself is met to more digits: it is a number that the user gave
        return max(0.0 if at_rest else self.left / scale, abs(push) / (_LOAD_TOLERANCE * self.force) if push else 0.0)


class _Forces(NamedTuple):
    """Forces of contacts less those with the common overlap, roots of overlaps, and sums of these and of squared forces."""

    excess: Array
    root: Array
    sum: float
    square: float
    roots: float

    @classmethod
    def find(cls, y: float, balls: Array, means: Array, stencils: Stencils) -> _Forces:
        """Find them from the overlap y and the displacements."""
        differences = stencils.operator.deform(balls)
        np.subtract(means, differences, out=differences)
        root: Array = differences.astype(np.float32)
        sums = np.zeros(3)
        flat, roots = differences.reshape(-1), root.reshape(-1)
        for low in range(0, flat.size, _CACHED):
            part = flat[low : low + _CACHED]
            _, contact = compute_excess(y, part, part)
            roots[low : low + _CACHED] = contact
            sums += np.sum(part), dot(part, part), np.sum(contact)
        return cls(differences, root, *sums.tolist())


def take_step(
    here: NewtonIterate, step: Motion, means: Array, load: ReducedLoad, stencils: Stencils
) -> tuple[NewtonIterate, float]:
    """Go along a step until the slope of the energy, negative at first, has at most a tenth of its first size.

    Returns the state there, and the length. Lengths are tried by Newton's method in one dimension, within brackets.
    """
    strain = stencils.operator.deform(step.balls) - step.compression
    first, low, high, length = (
        dot(here.rest.balls, step.balls) + here.rest.compression * step.compression,
        0.0,
        math.inf,
        1.0,
    )
    for _ in range(_LENGTH_TRIALS):
        y, balls = here.overlap + length * step.compression, here.balls + length * step.balls
        forces = _Forces.find(y, balls, means, stencils)
        slope = -dot(forces.excess, strain)
        if load.overlap is None:
            slope += step.compression * means.size * (max(y, 0.0) ** 1.5 - load.force)
        if abs(slope) <= 0.1 * abs(first):
            break
        low, high = (length, high) if slope < 0.0 else (low, length)
        rise = 1.5 * float(np.einsum("i,i,i", forces.root.ravel(), strain.ravel(), strain.ravel()))
        length = length - slope / rise if rise > 0.0 else math.inf
        if not low < length < high:
            length = 0.5 * (low + high) if high < math.inf else 2.0 * low
        length = min(length, 4.0 * low) if high == math.inf else length
    return NewtonIterate.find(y, balls, means, load, stencils, forces), length
