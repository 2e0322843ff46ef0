"""How contacts deform as balls move, and how their forces act on the balls: in the directions of rest, or in the true ones.

Both take mass-weighted motions x of the balls that move and the ways of the drives. A geometry at a moment has elongations
(n_c,); between two moments there are slips, twists and rolls (rows - 1, n_c). Forces are a ``pull`` (rows, n_c) of
:class:`~granphon.waves.contact_forces.Touch`.

In the directions of rest all is linear, by the rows of :mod:`granphon.dynamics.rows`. In the true ones r joins two balls
and n = r/|r|; arms add up to |r|, and the contact has the overlap h_0 + |r_0| - |r|. A step takes its slips across the mean
of r before and after; forces across contacts turn with n by the smallest rotation that takes n along, and about n with the
mean spin of the two balls. So |T| stays, and pairs of forces and torques keep momentum and angular momentum exactly. Loads
that hold the balls at rest keep their directions. In a plane T is a number, which such a rotation leaves as it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.array.sparse_matrices import compose
from granphon.waves.operator import WaveOperator

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class FixedDirections:
    """Deformations in the directions of the network, which are linear in the motions.

    Attributes
    ----------
    count : number of deformations of a contact.
    slips : number of slips among them, which come first after the elongation.
    """

    def __init__(self, operator: WaveOperator, moved: list[tuple[Index, Array]]) -> None:
        network, self.operator, rows = operator.network, operator, operator.rows
        self.count, self.slips = len(rows), sum(row.kind == "slip" for row in rows)
        n = network.n_contacts
        self.ratio = np.array([row.stiffness / network.normal_stiffness for row in rows[1:]]).reshape(-1, n)
        self._forward = operator.compose(rows)
        #: forces of a pull: f - f_0 pushes, and T resists
        self._back = self._forward.T.tocsr()
        signs = np.where(np.arange(self.count * n) < n, 1.0, -1.0)
        self._back.data *= signs[self._back.indices]
        # one of the same structure
        self._reach = type(self._back)((abs(self._back.data), self._back.indices, self._back.indptr), self._back.shape)
        # what a unit way of driven balls adds to the deformations
        self._strain = np.zeros((len(moved), self.count * n))
        for number, (balls, along) in enumerate(moved):
            vector = np.zeros(operator.motions.count)
            vector[: len(operator.motions.translations)] = along[list(operator.motions.translations)]
            driven = np.isin(np.arange(network.n_balls), balls)
            self._strain[number] = np.concatenate([
                np.where(driven[network.j], row.head @ vector, 0.0) - np.where(driven[network.i], row.tail @ vector, 0.0)
                for row in rows
            ])  # fmt: skip
        self.held = np.zeros((self.count - 1, n))
        if network.tangential_force is not None:
            axes = list(operator.motions.translations)
            for place in range(self.slips):
                self.held[place] = -np.sum(network.tangential_force[:, axes] * rows[1 + place].head[:, : len(axes)], axis=1)

    def top(self, stiffness: Array) -> float:
        """Return a bound of the angular frequencies of contacts of a normal ``stiffness`` (n_c,), rad/s."""
        n = self.held.shape[1]
        if len(stiffness) > n:  # balls have met
            stiffness = np.maximum(stiffness[:n], stiffness[n:].max())
        each = np.concatenate([stiffness[None], self.ratio * stiffness])
        rows = self._reach.T @ np.ones(self._reach.shape[0])
        return float(np.sqrt(np.max(self._reach @ (each.ravel() * rows))))

    def at(self, x: Array, ways: Array) -> Array:
        """Return the deformations (count, n_c)."""
        found = self._forward @ x
        if ways.size:
            found += ways @ self._strain
        return np.asarray(found.reshape(self.count, -1))

    def rate(self, at: Array, v: Array, ways: Array) -> Array:
        """Return the rates of all deformations (count, n_c), at velocities ``v`` and speeds of the drives."""
        return self.at(v, ways)

    def since(self, before: Array, after: Array) -> Array:
        """Return slips, twists and rolls between two moments."""
        return np.asarray(after[1:] - before[1:])

    def elongation(self, at: Array) -> Array:
        """Return e of a moment."""
        return np.asarray(at[0])

    def turn(self, pull: Array, before: Array, after: Array, half: int) -> Array:
        """Return the forces across contacts as they have turned in the first or the second half of a step: as they are."""
        return pull[1:]

    def push(self, at: Array, pull: Array, before: Array | None = None) -> Array:
        """Return the accelerations (size,) of a pull; with ``before``, its mean over a step."""
        return np.asarray(self._back @ pull.ravel())

    def resist(self, at: Array, pull: Array, before: Array | None = None) -> Array:
        """Return the forces (drives,) along each drive with which contacts and loads resist it."""
        tension = np.concatenate([-pull[:1], pull[1:] - self.held])
        return np.asarray(self._strain @ tension.ravel())

    def rest_energy(self, at: Array, x: Array) -> float:
        """Return the energy that static forces across contacts take up, J."""
        return -float(np.sum(self.held * at[1:]))


class Moment(NamedTuple):
    """Balls at a moment: displacements and rotations (3, n), vectors r across contacts (3, n_c), lengths and elongations."""

    u: Array
    turned: Array
    r: Array
    length: Array
    e: Array


class TrueDirections:
    """Deformations in the true directions. Slips and rolls are vectors: slip has three rows, twist one, roll three.

    ``rest`` (n_c,) are the normal forces of the network at rest, and ``more`` contacts (i, j, shift) besides, which begin to
    push where the distance of two balls is that of their radii and a ``bulge``.
    """

    count, slips = 8, 3
    #: axes of displacements and of rotations
    axes: tuple[int, ...] = (0, 1, 2)
    turns: tuple[int, ...] = (0, 1, 2)

    def __init__(
        self, operator: WaveOperator, fixed: FixedDirections, moved: list[tuple[Index, Array]], rest: Array,
        more: tuple[Index, Index, Index], bulge: float,
    ) -> None:  # fmt: skip
        network, self.operator, self.top = operator.network, operator, fixed.top
        self._drives = [(balls, along[list(self.axes)]) for balls, along in moved]
        (i, j, shift), extra = more, len(more[0])
        self.i, self.j = np.concatenate([network.i, i]), np.concatenate([network.j, j])
        flat = np.isinf(network.distance)
        vectors = np.where(flat[:, None], network.normal, network.vector)
        apart, at_wall = network.positions[j] + shift @ network.cell - network.positions[i], np.isinf(network.radii[j])
        gap = np.linalg.norm(apart, axis=1) - network.radii[i] - np.where(at_wall, 0.0, network.radii[j]) - bulge
        for wall in np.unique(j[at_wall]):  # a plane through the places where balls touch it
            one, own = np.flatnonzero(flat & (network.j == wall))[0], j == wall
            plane = network.positions[network.i[one]] + network.arm_i[one] * network.normal[one]
            apart[own] = network.normal[one]
            gap[own] = (plane - network.positions[i[own]]) @ network.normal[one] - network.radii[i[own]]
        self._gap = np.append(np.zeros(network.n_contacts), gap)
        self._r = np.ascontiguousarray(np.concatenate([vectors, apart]).T[list(self.axes)])
        self._length = np.sqrt(np.sum(self._r**2, axis=0))
        self._flat = np.concatenate([flat, at_wall])
        self._walls = np.flatnonzero(self._flat)
        self._arm = np.concatenate([network.arm_i, network.radii[i]])
        # arms share the distance, so that torques balance the moment of forces across contacts
        far = np.where(np.isinf(network.radii[j]), 0.0, network.radii[j])
        self._share = self._arm / (self._arm + np.concatenate([network.arm_j, far]))
        stiffness = (network.shear_stiffness, network.torsion_stiffness, network.bending_stiffness)
        slip, twist, roll = (
            np.append(one := each / network.normal_stiffness, np.full(extra, np.mean(one))) for each in stiffness
        )
        held = np.zeros((3, len(self.i)))
        if network.tangential_force is not None:
            held[:, : network.n_contacts] = -network.tangential_force.T
        self.ratio, self.held = self._list_rows(slip, twist, roll, held)
        both = np.concatenate([self.j, self.i])
        self._ends = compose([(both, np.arange(len(both)), 1.0)], (network.n_balls, len(both)))
        # where each motion of a ball stands among its displacements and rotations, and in a vector, and its weight
        weights, motions = np.sqrt(np.stack([network.masses, network.inertias])[:, operator.balls]), operator.motions
        rows = [self.axes.index(axis) for axis in motions.translations]
        rows += [len(self.axes) + self.turns.index(axis) for axis in motions.rotations]
        self._places = [(row, column, weights[int(column >= len(motions.translations))]) for column, row in enumerate(rows)]
        self._rest = np.append(rest, np.zeros(extra))
        # loads that hold the balls at rest, against forces and torques of contacts
        self._load = np.zeros((len(self.axes) + len(self.turns), network.n_balls))
        still = self.at(np.zeros(operator.size), np.zeros(len(moved)))
        self._load = -self._act(still, np.concatenate([np.zeros((1, len(self.i))), self.held]), None)

    def _list_rows(self, slip: Array, twist: Array, roll: Array, held: Array) -> tuple[Array, Array]:
        """Return the ratios of stiffnesses (rows - 1, n_c), and forces across contacts at rest likewise."""
        return np.array([slip] * 3 + [twist] + [roll] * 3), np.concatenate([held, np.zeros((4, len(slip)))])

    def _spread(self, x: Array, ways: Array) -> tuple[Array, Array]:
        """Return vectors (axes, n) of all balls from mass-weighted motions: displacements, and rotations."""
        values, out = self.operator.values(x), np.zeros(self._load.shape)
        for row, column, weight in self._places:
            out[row, self.operator.balls] = values[:, column] / weight
        for way, (balls, along) in zip(ways, self._drives, strict=True):
            out[: len(self.axes), balls] = (way * along)[:, None]
        return out[: len(self.axes)], out[len(self.axes) :]

    def at(self, x: Array, ways: Array) -> Moment:
        """Return the balls at a moment."""
        u, turned = self._spread(x, ways)
        across = self._difference(u)
        r = self._r + across
        r[:, self._walls] = self._r[:, self._walls]
        length = np.sqrt(np.einsum("ij,ij->j", r, r))
        # no difference of near-equal lengths
        e = np.einsum("ij,ij->j", self._r + r, across) / (length + self._length)
        return Moment(u, turned, r, length, e + self._gap)

    def _difference(self, of_balls: Array) -> Array:
        """Return what balls j have more than balls i, (axes, n_c)."""
        return np.asarray(of_balls.take(self.j, axis=1) - of_balls.take(self.i, axis=1))

    def elongation(self, at: Moment) -> Array:
        """Return e of a moment."""
        return at.e

    def _deform(self, n: Array, length: Array, across: Array, turned: Array) -> Array:
        """Return (rows - 1, n_c) slip, twist and roll of contacts of the direction n; displacements are small."""
        i, j = turned[:, self.i], turned[:, self.j]
        arm_i, arm_j = self._arms(length)
        slip = across - n * np.sum(n * across, axis=0) - _cross(arm_i * i + arm_j * j, n)
        twist = np.sum(n * (j - i), axis=0)
        return np.concatenate([slip, twist[None], j - i - n * twist])

    def _arms(self, length: Array) -> tuple[Array, Array]:
        arm = self._share * length
        arm[self._walls] = self._arm[self._walls]
        other = length - arm
        other[self._walls] = 0.0
        return arm, other

    def since(self, before: Moment, after: Moment) -> Array:
        """Return slips, twists and rolls between two moments, across the mean of r."""
        n, length = _mean(before, after)
        return self._deform(n, length, self._difference(after.u - before.u), after.turned - before.turned)

    def rate(self, at: Moment, v: Array, ways: Array) -> Array:
        """Return the rates of all deformations (8, n_c), at velocities ``v`` and speeds of the drives."""
        moving, spins = self._spread(v, ways)
        n, across = at.r / at.length, self._difference(moving)
        return np.concatenate([np.sum(n * across, axis=0)[None], self._deform(n, at.length, across, spins)])

    def turn(self, pull: Array, before: Moment, after: Moment, half: int) -> Array:
        """Return the forces across contacts as they have turned in the first or the second half of a step."""
        mean, t = _mean(before, after)[0], pull[1:].copy()
        a, b = (before.r / before.length, mean) if half == 0 else (mean, after.r / after.length)
        spins = after.turned - before.turned
        angle = 0.25 * np.sum((spins[:, self.i] + spins[:, self.j]) * mean, axis=0)
        for part in (t[:3], t[4:]):
            part -= np.sum(b * part, axis=0) / (1.0 + np.sum(a * b, axis=0)) * (a + b)
            part[:] = part * np.cos(angle) + _cross(b, part) * np.sin(angle)
        return t

    def _resist(self, n: Array, pull: Array) -> tuple[Array, Array, Array]:
        """Return forces across contacts (axes, n_c), the torque of each with an arm of one, and that of twist and roll."""
        return pull[1:4], _cross(n, pull[1:4]), pull[4] * n + pull[5:]

    def _act(self, at: Moment, pull: Array, before: Moment | None) -> Array:
        """Return forces and torques (axes, n) on all balls, those of loads among them; over a step, that keep its energy."""
        n, length = (at.r / at.length, at.length) if before is None else _mean(before, at)
        normal = pull[0] + self._rest
        if before is not None:
            normal = normal * np.where(self._flat, 1.0, 2.0 * length / (at.length + before.length))
        arm_i, arm_j = self._arms(length)
        across, lever, bend = self._resist(n, pull)
        force = normal * n - across
        ends = np.concatenate([
            np.concatenate([force, arm_j * lever - bend]), np.concatenate([-force, arm_i * lever + bend])
        ], axis=1)  # fmt: skip
        return np.array([self._ends @ one for one in ends]) + self._load

    def push(self, at: Moment, pull: Array, before: Moment | None = None) -> Array:
        """Return the accelerations (size,) of a pull; with ``before``, its mean over a step."""
        acting, balls = self._act(at, pull, before), self.operator.balls
        out = np.empty((len(balls), len(self._places)))
        for row, column, weight in self._places:
            out[:, column] = acting[row, balls] / weight
        return np.asarray(self.operator.vector(out))

    def resist(self, at: Moment, pull: Array, before: Moment | None = None) -> Array:
        """Return the forces (drives,) along each drive with which contacts and loads resist it."""
        acting = self._act(at, pull, before)[: len(self.axes)]
        return np.array([-float(np.sum(along @ acting[:, balls])) for balls, along in self._drives])

    def rest_energy(self, at: Moment, x: Array) -> float:
        """Return the energy of the loads, J, less what the laws count of it."""
        return -float(np.sum(self._rest * at.e) + np.sum(self._load * np.concatenate([at.u, at.turned])))


class PlaneDirections(TrueDirections):
    """The same of motions in the plane x, y: slip, roll and their forces are numbers, along (-n_y, n_x) and about z."""

    count, slips, axes, turns = 3, 1, (0, 1), (2,)

    def _list_rows(self, slip: Array, twist: Array, roll: Array, held: Array) -> tuple[Array, Array]:
        n = self._r / self._length
        return np.array([slip, roll]), np.array([n[0] * held[1] - n[1] * held[0], np.zeros(len(slip))])

    def _deform(self, n: Array, length: Array, across: Array, turned: Array) -> Array:
        i, j = turned[0].take(self.i), turned[0].take(self.j)
        arm_i, arm_j = self._arms(length)
        return np.array([n[0] * across[1] - n[1] * across[0] - arm_i * i - arm_j * j, j - i])

    def turn(self, pull: Array, before: Moment, after: Moment, half: int) -> Array:
        """Return the forces across contacts as they are."""
        return pull[1:]

    def _resist(self, n: Array, pull: Array) -> tuple[Array, Array, Array]:
        return np.array([-n[1] * pull[1], n[0] * pull[1]]), pull[1:2], pull[2:3]


def _mean(before: Moment, after: Moment) -> tuple[Array, Array]:
    """Return directions and lengths of the mean of r over a step."""
    r = 0.5 * (before.r + after.r)
    length = np.sqrt(np.einsum("ij,ij->j", r, r))
    return r / length, length


def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
