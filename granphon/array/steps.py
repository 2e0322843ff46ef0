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


class ReducedLoad(NamedTuple):
    """Prescribed load: the reduced ``overlap`` y or, if that is None, the reduced mean contact ``force`` f*.

    If ``on_boundary`` is true, the load is a pressure: ``force`` is the f* under it where the cell keeps its size. In the
    true geometry the boundary shrinks with the cell.
    """

    overlap: float | None = None
    force: float = 0.0
    on_boundary: bool = False


def compute_excess(overlap: float, differences: Array) -> tuple[Array, Array]:
    """Return h_+^(3/2) - y_+^(3/2) and h_+^(1/2) for h = y + difference."""
    common = max(overlap, 0.0)
    change = differences + min(overlap, 0.0)
    np.maximum(change, -common, out=change)  # h_+ - y_+
    root = change + common
    np.sqrt(root, out=root)
    if common == 0.0:
        change *= root
        return change, root
    # the difference of the powers 3/2, over that of h and y, is h^(1/2) + y/(h^(1/2) + y^(1/2))
    factor = root + math.sqrt(common)
    np.divide(common, factor, out=factor)
    factor += root
    factor *= change
    return factor, root


class NewtonIterate(NamedTuple):
    """Balls on the way to equilibrium: what their place tells of the contacts, and how far they are from rest.

    Attributes
    ----------
    overlap, balls : y and the displacements.
    rest : force left on the balls and, at given load, what the contacts' forces lack to it in sum.
    force, spread : mean and standard deviation of the contact forces.
    level : mean stiffness of the contacts.
    left : largest force left on a ball.
    """

    overlap: float
    balls: Array
    rest: Motion
    force: float
    spread: float
    level: float
    left: float

    @classmethod
    def find(cls, y: float, balls: Array, means: Array, root: Array, load: ReducedLoad, stencils: Stencils) -> NewtonIterate:
        """Return the state, and write h_+^(1/2) of the contacts into ``root``; that and ``means`` are in rooms."""
        inside, sums = stencils.rooms.inside.ravel(), np.zeros(3)
        roots, middles = root.reshape(len(root), -1), means.reshape(len(means), -1)

        def tension(kind: int, part: slice, elongation: Array) -> Array:
            np.subtract(middles[kind, part], elongation, out=elongation)
            excess, contact = compute_excess(y, elongation)
            excess *= inside[part]
            contact *= inside[part]
            roots[kind, part] = contact
            sums[:] += np.sum(excess), dot(excess, excess), np.sum(contact)
            return excess

        pull = stencils.balance(balls, tension)
        contacts, common = stencils.n_contacts * math.prod(stencils.shape), max(y, 0.0) ** 1.5
        mean, square, stiffness = (sums * (1.0, 1.0, 1.5) / contacts).tolist()
        force = common + mean
        push = (load.force - common) - mean if load.overlap is None else 0.0
        # where overlaps are small, near the rigidity threshold and on a line, the spacing of doubles at y and at the
        # displacements is too coarse to meet the load
        spacing = math.ulp(max(y, float(np.max(np.abs(balls)))))
        push *= abs(push) > _LOAD_ROUNDING * force + spacing * stiffness
        left = math.sqrt(float(np.max(np.sum(stencils.cartesian(pull) ** 2, axis=0))))
        spread = math.sqrt(max(0.0, square - mean**2))
        return cls(y, balls, Motion(pull, contacts * push), force, spread, stiffness, left)

    def distance(self, least: float, stencils: Stencils) -> float:
        """Return the force left over the scale that tolerances are of; forces no larger than ``least`` count as that."""
        push = self.rest.compression / (stencils.n_contacts * math.prod(stencils.shape))
        scale = min(self.force, max(self.spread, self.level * least))
        # on a line displacements add up, as in a random walk, and all that is left in the end is their rounding
        moved = float(np.max(np.abs(self.balls))) if len(stencils.shape) == 1 else 0.0
        at_rest = self.left <= _MOVE_ROUNDING * math.ulp(moved) * self.level
        # the load itself is met to more digits: it is a number that the user gave
        return max(0.0 if at_rest else self.left / scale, abs(push) / (_LOAD_TOLERANCE * self.force) if push else 0.0)


def take_step(
    here: NewtonIterate, step: Motion, means: Array, root: Array, load: ReducedLoad, stencils: Stencils
) -> tuple[NewtonIterate, float]:
    """Go along a step until the slope of the energy, negative at first, has at most a tenth of its first size.

    Returns the state there, and the length.
    """

    def go(length: float) -> NewtonIterate:
        y, balls = here.overlap + length * step.compression, here.balls + length * step.balls
        return NewtonIterate.find(y, balls, means, root, load, stencils)

    def slope(point: NewtonIterate) -> float:
        return -dot(point.rest.balls, step.balls) - point.rest.compression * step.compression

    there, first = go(1.0), slope(here)
    if abs(slope(there)) <= 0.1 * abs(first):
        return there, 1.0
    length = _step_length(here, first, step, means[stencils.rooms.inner], load, stencils)
    return go(length), length


def _step_length(
    here: NewtonIterate, first: float, step: Motion, means: Array, load: ReducedLoad, stencils: Stencils
) -> float:
    """Find the length at which the slope of the energy along the step has at most a tenth of its ``first`` size."""
    strain, more = stencils.deformations(Motion(step.balls, 0.0)), step.compression
    differences = means - stencils.deformations(Motion(here.balls, 0.0))

    def slope(length: float) -> tuple[float, float]:
        there, value, rise = here.overlap + length * more, 0.0, 0.0
        for rows in stencils.blocks(stencils.n_contacts):
            excess, root = compute_excess(there, differences[:, rows] - length * strain[:, rows])
            part = strain[:, rows] - more
            value -= dot(excess, part)
            rise += 1.5 * dot(root, part * part)
        if load.overlap is None:
            value += more * strain.size * (max(there, 0.0) ** 1.5 - load.force)
        return value, rise

    low, high, length = 0.0, math.inf, 1.0
    for _ in range(_LENGTH_TRIALS):
        value, rise = slope(length)
        if abs(value) <= 0.1 * abs(first):
            break
        if value < 0.0:
            low = length
        else:
            high = length
        length = length - value / rise if rise > 0.0 else math.inf
        if not low < length < high:
            length = 0.5 * (low + high) if high < math.inf else 2.0 * low
        length = min(length, 4.0 * low) if high == math.inf else length
    return length
