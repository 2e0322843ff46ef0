"""Balls that bear little, brought to rest in the cages of the others, which are held.

Near the rigidity threshold many balls are loose: nothing holds them, or only two others in line,
between which they stay on the lattice, but in their true geometry not. Then they move out until
they touch a third, and may push others about; what they bear in the end is of the order W/d of the
other forces, or nothing. These ways are long, and each is a matter of a few balls, while the others
hardly move. So balls are told apart: where loose balls are neighbours they form a cluster; other
balls are held. Each cluster is brought to rest by Newton's method, with steps of its own length;
sparse factors solve the equations of all clusters together, whose matrix has a block for each.
Clusters at rest drop out.

As everywhere (:mod:`granphon.array.true_equilibrium`), the stiffness -f W/d by which forces push
balls aside is taken with the other sign: a step is then about as long as a ball is far from the
line between two others.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.geometry import ADDED_STIFFNESS, ExactGeometry
from granphon.array.stencils import number_cells
from granphon.balls import hertz
from granphon.base.arrays import Array, Index
from granphon.dynamics.factors import factorise

#: Newton steps, at most
_STEPS = 100
#: trials of a line search, at most
_LENGTHS = 12
#: slope of the energy at the end of a step over that at its beginning, at most
_SLOPE = 0.3
#: stiffness that holds balls which nothing else holds, over the mean
_HOLDING = 1e-14


class Cages:
    """Table of the contacts of an array, from which clusters of loose balls are cut."""

    def __init__(self, geometry: ExactGeometry) -> None:
        stencils = self._stencils = geometry.stencils
        self._cells = math.prod(stencils.shape)
        self._ratio = geometry.ratio
        self._dimension = len(stencils.shape)
        i, j = (self._cells * ball[:, None] for ball in np.transpose(stencils.ends))
        self._i = (i + np.arange(self._cells)).ravel()
        self._j = (j + number_cells(stencils.shape, stencils.shifts)).ravel()
        self._normal = stencils.lattice.contacts.normal[:, : self._dimension].T
        self._means = geometry.means.ravel()

    def settle(
        self, balls: Array, overlap: float, loose: NDArray[np.bool_], force: float, tolerance: float
    ) -> Array:
        """Return the displacements (fields, L1, ..., Lp) when the ``loose`` ones of all balls in
        turn have come to rest.

        At rest less than ``tolerance`` times the mean ``force`` is left on each. Clusters that do
        not come to rest are left where the last step has taken them.
        """
        where = self._stencils.displacements(balls).reshape(self._dimension, -1)
        chosen = np.flatnonzero(loose)
        place = np.full(loose.size, chosen.size)
        place[chosen] = np.arange(chosen.size)
        mine = np.flatnonzero(loose[self._i] | loose[self._j])
        normal = self._normal[:, mine // self._cells]
        still = np.where(loose, 0.0, where)
        fixed = still[:, self._j[mine]] - still[:, self._i[mine]] - overlap * normal
        ends = place[self._i[mine]], place[self._j[mine]]
        where[:, chosen] = _Clusters(
            normal, self._means[mine], *ends, fixed, where[:, chosen], self._ratio
        ).settle(force, tolerance)
        fields = (
            (self._stencils.basis @ where)
            .reshape(self._dimension, self._stencils.n_balls, -1)
            .swapaxes(0, 1)
        )
        return np.asarray(fields.reshape(balls.shape))


class _Clusters:
    """Loose balls and their contacts, cluster by cluster.

    Contacts have directions e (p, n) and means of x; ``i`` and ``j`` number their balls, one more
    than the last being any that is held; ``fixed`` (p, n) is the part of v that does not change.
    """

    def __init__(
        self,
        normal: Array,
        means: Array,
        i: Index,
        j: Index,
        fixed: Array,
        balls: Array,
        ratio: float,
    ) -> None:
        self._normal = normal
        self._means = means
        self._i = i
        self._j = j
        self._fixed = fixed
        self._ratio = ratio
        count = balls.shape[1]
        self._clusters, self._of_ball = _join(i, j, np.ones(i.size, bool), count)
        self._of_contact = self._of_ball[np.minimum(i, j)]
        self._balls = balls.copy()
        self._moved = balls
        self._numbers = np.arange(count)

    def settle(self, force: float, tolerance: float) -> Array:
        """Return the displacements (p, balls) at rest."""
        for step in range(_STEPS):
            forces = self._find_forces(self._moved)
            left = np.zeros(self._clusters)
            np.maximum.at(left, self._of_ball, np.sqrt(np.sum(forces[0] ** 2, axis=0)) / force)
            drop = bool(np.any(left[self._of_ball] <= tolerance))
            if drop:
                self._keep(left > tolerance)
                if not self._numbers.size:
                    break
                forces = self._find_forces(self._moved)
            if drop or not step:
                # where the stiffnesses of contacts, and those that hold balls, stand in the matrix
                # of the clusters
                p, count = self._moved.shape
                a = self._i[None]
                b = self._j[None]
                a, b = np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])
                part, contact = np.nonzero(np.maximum(a, b) < count)
                self._sign = np.where(part < 2, 1.0, -1.0)
                self._contact = contact
                own = np.arange(p * count)
                axes = np.arange(p)[:, None, None]
                turned = (p * a[part, contact] + axes, p * b[part, contact] + axes.swapaxes(0, 1))
                rows, columns = (np.broadcast_to(one, (p, p, len(part))) for one in turned)
                self._places = tuple(
                    np.append(one, own).astype(np.int32) for one in (rows, columns)
                )
            self._move(
                forces[0], self._find_step(*forces, left, force), forces[1], tolerance * force
            )
        self._keep(np.zeros(self._clusters, bool))
        return self._balls

    def _keep(self, active: NDArray[np.bool_]) -> None:
        """Go on with the ``active`` ones of the clusters alone."""
        self._balls[:, self._numbers] = self._moved
        balls = np.flatnonzero(active[self._of_ball])
        contacts = np.flatnonzero(active[self._of_contact])
        place = np.full(self._numbers.size + 1, balls.size)
        place[balls] = np.arange(balls.size)
        self._i = place[self._i[contacts]]
        self._j = place[self._j[contacts]]
        self._normal = self._normal[:, contacts]
        self._fixed = self._fixed[:, contacts]
        self._means = self._means[contacts]
        self._of_contact = self._of_contact[contacts]
        self._moved = self._moved[:, balls]
        self._numbers = self._numbers[balls]
        self._of_ball = self._of_ball[balls]

    def _find_forces(
        self, moved: Array, some: Any = slice(None)
    ) -> tuple[Array, Array, Array, Array]:
        """Return forces on balls, roots of overlaps, distances |w|, and directions n; see geometry.

        The forces are those of ``some`` contacts, to which the other arrays belong.
        """
        padded = _pad(moved)
        i = self._i[some]
        j = self._j[some]
        count = moved.shape[1]
        straight = self._normal[:, some]
        v = self._fixed[:, some] + padded[:, j] - padded[:, i]
        w = straight + self._ratio * v
        size = np.sqrt(np.sum(w * w, axis=0))
        w /= size
        change = np.sum((2.0 * straight + self._ratio * v) * v, axis=0) / (1.0 + size)
        force, root = hertz.press(self._means[some] - change)
        push = force * w
        pull = [
            np.bincount(j, one, count + 1)[:count] - np.bincount(i, one, count + 1)[:count]
            for one in push
        ]
        return np.array(pull), root, size, w

    def _find_step(
        self, pull: Array, root: Array, size: Array, normal: Array, left: Array, force: float
    ) -> Array:
        """Return the step (p, balls) of Newton's method."""
        from scipy.sparse import coo_array  # imported here: most simulations do not need it

        p, count = pull.shape
        aside = self._ratio * hertz.force_from(root) / size
        blocks = (hertz.stiffness_of(root) - aside) * normal[:, None] * normal
        blocks[range(p), range(p)] += aside
        held = hertz.stiffness_under(force) * (
            _HOLDING + ADDED_STIFFNESS * np.minimum(1.0, left[self._of_ball])
        )
        entries = np.append(self._sign * blocks[..., self._contact], np.repeat(held, p))
        matrix: Any = coo_array((entries, self._places), shape=(p * count, p * count)).tocsc()
        return np.asarray(factorise(matrix).solve(pull.T.ravel()).reshape(count, p).T)

    def _move(self, pull: Array, step: Array, root: Array, at_rest: float) -> None:
        """Take a step; balls that touch, or would at its end, go the same part of it, to where
        their energy is least.

        Where the energy still falls at its end they go all of it.
        """
        begun = self._moved
        padded = _pad(step)
        ahead = padded[:, self._j] - padded[:, self._i]
        at_end = self._find_forces(begun + step)
        groups, part = _join(self._i, self._j, (root > 0.0) | (at_end[1] > 0.0), step.shape[1])
        of_contact = part[np.minimum(self._i, self._j)]
        first = np.bincount(part, np.sum(pull * step, axis=0), groups)
        most = np.zeros(groups)
        np.maximum.at(most, part, np.sum(pull**2, axis=0))
        done = most <= at_rest**2
        low = np.zeros(groups)
        high = np.full(groups, np.inf)
        length = np.where(done, 0.0, 1.0)
        some: Any = slice(None)
        for trial in range(_LENGTHS):
            self._moved = begun + length[part] * step
            pull, root, _, normal = at_end
            if trial or np.any(done):  # forces between balls of which none goes on are not needed
                active = np.append(~done[part], False)
                some = np.flatnonzero(active[self._i] | active[self._j])
                pull, root, _, normal = self._find_forces(self._moved, some)
            slope = -np.bincount(part, np.sum(pull * step, axis=0), groups)
            low = np.where(slope < 0.0, length, low)
            high = np.where(slope > 0.0, length, high)
            done |= (slope <= 0.0) & (high == np.inf) | (np.abs(slope) <= _SLOPE * first)
            if np.all(done):
                break
            # of one contact that closes on the way the slope is -first + c (length - place)^(3/2)
            rise = np.bincount(
                of_contact[some],
                hertz.stiffness_of(root) * np.sum(normal * ahead[:, some], axis=0) ** 2,
                groups,
            )
            above = np.where(done | (slope <= 0.0), 1.0, first + slope)
            change = np.where(
                slope > 0.0, hertz.EXPONENT * (1.0 - hertz.overlap_of(first / above)) * above, slope
            )
            near = length - change / np.where(rise > 0.0, rise, np.inf)
            inside = np.clip(
                near,
                0.9 * low + 0.1 * np.minimum(high, 1.0),
                0.1 * low + 0.9 * np.minimum(high, 1.0),
            )
            length = np.where(done, length, inside)


def _join(i: Index, j: Index, contact: NDArray[np.bool_], count: int) -> tuple[int, Index]:
    """Return the number of the groups of balls between which there is a ``contact``, and the group
    of each ball.
    """
    links = np.flatnonzero(contact & (np.maximum(i, j) < count))
    i = i[links]
    j = j[links]
    first = np.arange(count)
    while True:
        first_of_i = first[i]
        first_of_j = first[j]
        if np.array_equal(first_of_i, first_of_j):
            break
        least = np.minimum(first_of_i, first_of_j)
        np.minimum.at(first, first_of_i, least)
        np.minimum.at(first, first_of_j, least)
        farther = first[first]
        while np.any(farther != first):
            first = farther
            farther = first[first]
    groups, of_ball = np.unique(first, return_inverse=True)
    return groups.size, of_ball


def _pad(moved: Array) -> Array:
    """Return motions (p, balls) with one more ball, which does not move."""
    padded = np.zeros((len(moved), moved.shape[1] + 1))
    padded[:, :-1] = moved
    return padded
