"""How contacts deform as balls move, and how their forces act on the balls: in the directions of rest, or in the true ones.

Both take mass-weighted motions x of the balls that move and the ways of the drives, which they join to the motions of
contacts by a sparse matrix G; forces come back by its transpose. A geometry at a moment has elongations (n_c,); between two
moments there are slips, twists and rolls (rows - 1, n_c). Forces are a ``pull`` (rows, n_c) of
:class:`~granphon.waves.contact_forces.Touch`.

In the directions of rest all is linear, by the rows of :mod:`granphon.dynamics.rows`. In the true ones r joins two balls
and n = r/|r|; arms add up to |r|, and the contact has the overlap h_0 + |r_0| - |r|. A step takes its slips across the mean
of r before and after; forces across contacts turn with n by the smallest rotation that takes n along, and about n with the
mean spin of the two balls. So |T| stays, and pairs of forces and torques keep momentum and angular momentum exactly. Loads
that hold the balls at rest keep their directions. In a plane T is a number, which such a rotation leaves as it is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from granphon.base.arrays import Array, Index
from granphon.waves.contact_forces import divide, share
from granphon.waves.operator import WaveOperator


class _Directions:
    """What contacts have of the motions of their balls: G x, and s for a unit way of each drive."""

    #: (count - 1, n_c) forces across contacts at rest, and (size,) those of the loads that hold the balls against them
    held: Array
    load: Array
    _forward: Any
    _back: Any
    _strain: Array

    def _move(self, x: Array, ways: Array) -> Array:
        """Return the motions of contacts, (rows, n_c)."""
        found = self._forward @ x
        if ways.size:
            found += ways @ self._strain
        return np.asarray(found.reshape(-1, self.held.shape[1]))

    def turn(self, pull: Array, before: Any, after: Any, first: bool = True) -> Array:
        """Return the forces across contacts as they have turned in the first half of a step: as they are."""
        return pull[1:]

    def turn_on(self, pull: Array, before: Any, after: Any) -> None:
        """Turn the forces across contacts in the second half of a step."""


class FixedDirections(_Directions):
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
        self.load = -(self._back @ np.concatenate([np.zeros((1, n)), self.held]).ravel())

    def top(self, stiffness: Array) -> float:
        """Return a bound of the angular frequencies of contacts of a normal ``stiffness`` (n_c,), rad/s."""
        n = self.held.shape[1]
        if len(stiffness) > n:  # balls have met
            stiffness = np.maximum(stiffness[:n], stiffness[n:].max())
        each = np.concatenate([stiffness[None], self.ratio * stiffness]).ravel()
        return float(np.sqrt(np.max(self._reach @ (each * (self._reach.T @ np.ones(len(self.load)))))))

    def rate(self, at: Array, v: Array, ways: Array) -> Array:
        """Return the rates of all deformations (count, n_c), at velocities ``v`` and speeds of the drives."""
        return self._move(v, ways)

    def step(self, before: Array | None, x: Array, ways: Array, out: Any = None) -> tuple[Array, Array, Array]:
        """Return the deformations (count, n_c), elongations, and slips, twists and rolls since those before."""
        after = self._move(x, ways)
        return after, after[0], after[1:] if before is None else np.asarray(after[1:] - before[1:])

    def push(self, at: Array, pull: Array, before: Array | None = None) -> Array:
        """Return the accelerations (size,) of a pull, without :attr:`load`; with ``before``, its mean over a step."""
        return np.asarray(self._back @ pull.ravel())

    def resist(self, at: Array, pull: Array, before: Array | None = None) -> Array:
        """Return the forces (drives,) along each drive with which contacts and loads resist it."""
        tension = np.concatenate([-pull[:1], pull[1:] - self.held])
        return np.asarray(self._strain @ tension.ravel())

    def rest_energy(self, at: Array) -> float:
        """Return the energy that static forces across contacts take up, J."""
        return -float(np.sum(self.held * at[1:]))


class Moment(NamedTuple):
    """Contacts at a moment: motions (rows, n_c), vectors r across them (axes, n_c), lengths |r| and elongations (n_c,)."""

    moved: Array
    r: Array
    length: Array
    e: Array


class TrueDirections(_Directions):
    """Deformations in the true directions. Slips and rolls are vectors: slip has three rows, twist one, roll three.

    ``rest`` (n_c,) are the normal forces of the network at rest, and ``more`` contacts (i, j, shift) besides, which begin to
    push where the distance of two balls is that of their radii and a ``bulge``. A contact has of the motions of its balls
    their displacements across it; the sum of their rotations, each times the part of |r| that is its arm; the rotation of
    ball j less that of i; and the sum of both.
    """

    slips = 3
    #: axes of displacements and of rotations
    axes: tuple[int, ...] = (0, 1, 2)
    turns: tuple[int, ...] = (0, 1, 2)

    def __init__(
        self, operator: WaveOperator, fixed: FixedDirections, moved: list[tuple[Index, Array]], rest: Array,
        more: tuple[Index, Index, Index], bulge: float,
    ) -> None:  # fmt: skip
        network, motions, self.top = operator.network, operator.motions, fixed.top
        (i, j, shift), extra = more, len(more[0])
        ends = i_of, j_of = np.concatenate([network.i, i]), np.concatenate([network.j, j])
        flat, n = np.isinf(network.distance), len(i_of)
        vectors = np.where(flat[:, None], network.normal, network.vector)
        apart, at_wall = network.positions[j] + shift @ network.cell - network.positions[i], np.isinf(network.radii[j])
        gap = np.linalg.norm(apart, axis=1) - network.radii[i] - np.where(at_wall, 0.0, network.radii[j]) - bulge
        for wall in np.unique(j[at_wall]):  # a plane through the places where balls touch it
            one, own = np.flatnonzero(flat & (network.j == wall))[0], j == wall
            plane = network.positions[network.i[one]] + network.arm_i[one] * network.normal[one]
            apart[own] = network.normal[one]
            gap[own] = (plane - network.positions[i[own]]) @ network.normal[one] - network.radii[i[own]]
        self._gap = np.append(np.zeros(network.n_contacts), gap) if extra else gap
        self._r = np.ascontiguousarray(np.concatenate([vectors, apart]).T[list(self.axes)])
        self._square = np.sum(self._r**2, axis=0)
        self._length = np.sqrt(self._square)
        walls = np.flatnonzero(np.concatenate([flat, at_wall]))  # r is the normal, of length one
        stiffness = (network.shear_stiffness, network.torsion_stiffness, network.bending_stiffness)
        slip, twist, roll = (
            np.append(one := each / network.normal_stiffness, np.full(extra, np.mean(one))) for each in stiffness
        )
        held = np.zeros((3, n))
        if network.tangential_force is not None:
            held[:, : network.n_contacts] = -network.tangential_force.T
        self.ratio, self.held = self._list_rows(slip, twist, roll, held)
        self.count = 1 + len(self.ratio)
        self._rest = share(np.append(rest, np.zeros(extra)))
        # arms share the distance, so that torques balance the moment of forces across contacts
        arm = np.concatenate([network.arm_i, network.radii[i]])
        near = arm / (arm + np.concatenate([network.arm_j, np.where(at_wall, 0.0, network.radii[j])]))
        other = 1.0 - near
        near[walls], other[walls] = arm[walls], 0.0
        kinds = [(axis, -1.0, 1.0) for axis in self.axes] + [
            (3 + axis, *parts) for parts in self._parts(near, other) for axis in self.turns
        ]
        places, weights = np.zeros((6, network.n_balls), np.int32), np.zeros((6, network.n_balls))
        for column, axis in enumerate([*motions.translations, *(3 + axis for axis in motions.rotations)]):
            places[axis, operator.balls] = operator.values(np.arange(operator.size))[:, column]
            own_mass = network.masses if axis < 3 else network.inertias
            weights[axis, operator.balls] = 1.0 / np.sqrt(own_mass[operator.balls])
        entries, columns = np.empty((len(kinds), n, 2)), np.empty((len(kinds), n, 2), np.int32)
        for line, (axis, *parts) in enumerate(kinds):
            for place, (end, part) in enumerate(zip(ends, parts, strict=True)):
                entries[line, :, place], columns[line, :, place] = part * weights[axis, end], places[axis, end]
        starts = np.arange(0, entries.size + 1, 2, dtype=np.int32)
        self._forward = type(fixed._forward)((entries.ravel(), columns.ravel(), starts), (starts.size - 1, operator.size))
        self._forward.sum_duplicates()
        self._forward.eliminate_zeros()
        self._strain = np.zeros((len(moved), len(kinds) * n))
        for strain, (balls, along) in zip(self._strain, moved, strict=True):
            driven = np.isin(np.arange(network.n_balls), balls).astype(float)
            strain[: len(self.axes) * n] = np.outer(along[list(self.axes)], driven[j_of] - driven[i_of]).ravel()
        self._blocks = [(at, walls[(walls >= at.start) & (walls < at.stop)], room) for at, room in divide(n, 8)]
        self._way, self._acting = np.zeros((self.count - 1, n)), np.zeros((len(kinds), n))
        self._back = self._forward.T.tocsr()
        at, *_ = self.step(None, np.zeros(operator.size), np.zeros(len(moved)))
        self._still = self._act(at, np.concatenate([np.zeros((1, n)), self.held]), None).copy()
        self.load = -(self._back @ self._still)

    def _list_rows(self, slip: Array, twist: Array, roll: Array, held: Array) -> tuple[Array, Array]:
        """Return the ratios of stiffnesses (rows - 1, n_c), and forces across contacts at rest likewise."""
        return np.array([slip] * 3 + [twist] + [roll] * 3), np.concatenate([held, np.zeros((4, len(slip)))])

    def _parts(self, near: Array, other: Array) -> list[tuple[Any, Any]]:
        """Return the parts that rotations of balls i and j have in those of contacts, for each axis in turn."""
        return [(near, other), (-1.0, 1.0), (1.0, 1.0)]

    def step(
        self, before: Moment | None, x: Array, ways: Array, out: Moment | None = None
    ) -> tuple[Moment, Array, Array]:  # fmt: skip
        """Return the balls at a moment, elongations, and slips, twists and rolls since the one before, in ``out``."""
        moved, n = self._move(x, ways), len(self._length)
        after = Moment(moved, *((np.empty_like(self._r), np.empty(n), np.empty(n)) if out is None else out[1:]))
        for block in self._blocks:
            self._place(after, *block)
            if before is not None:
                self._slip(before, after, *block)
        return after, after.e, self._way

    def _slip(self, before: Moment, after: Moment, at: slice, walls: Index, room: Array) -> None:
        """Set slips, twists and rolls between two moments, across the mean of r."""
        r = 0.5 * (before.r[:, at] + after.r[:, at])
        length = np.sqrt(np.sum(r * r, axis=0))
        self._way[:, at] = self._deform(r / length, length, after.moved[:, at] - before.moved[:, at])

    def _place(self, found: Moment, at: slice, walls: Index, room: Array) -> None:
        """Set vectors, lengths and elongations of contacts at a moment."""
        e, length, start = found.e[at], found.length[at], self._r[:, at]
        across, parts = found.moved[: len(start), at], room[: len(start)]
        np.add(start, across, out=found.r[:, at])
        np.add(start, found.r[:, at], out=parts)
        parts *= across
        np.add(parts[0], parts[1], out=e)  # |r|^2 - |r_0|^2, no difference of near-equal lengths
        for more in parts[2:]:
            e += more
        np.add(self._square[at], e, out=length)
        np.sqrt(length, out=length)
        e /= np.add(self._length[at], length, out=room[0])
        if len(walls):
            found.r[:, walls], found.length[walls] = self._r[:, walls], 1.0
            found.e[walls] = np.sum(self._r[:, walls] * found.moved[: len(self.axes), walls], axis=0)
        if len(self._gap):
            e += self._gap[at]

    def _deform(self, n: Array, length: Array, moved: Array) -> Array:
        """Return (rows - 1, n_c) slip, twist and roll of contacts of the direction n; motions are small."""
        across, roll = moved[:3], moved[6:9]
        slip, twist = across - n * np.sum(n * across, axis=0) - length * _cross(moved[3:6], n), np.sum(n * roll, axis=0)
        return np.concatenate([slip, twist[None], roll - n * twist])

    def rate(self, at: Moment, v: Array, ways: Array) -> Array:
        """Return the rates of all deformations (count, n_c), at velocities ``v`` and speeds of the drives."""
        n, moving = at.r / at.length, self._move(v, ways)
        return np.concatenate([np.sum(n * moving[: len(n)], axis=0)[None], self._deform(n, at.length, moving)])

    def turn(self, pull: Array, before: Moment, after: Moment, first: bool = True) -> Array:
        """Return the forces across contacts as they have turned in the ``first`` half of a step, or in the second."""
        r, length = _mean(before, after)
        mean, t = r / length, pull[1:].copy()
        a, b = (before.r / before.length, mean) if first else (mean, after.r / after.length)
        angle = 0.25 * np.sum((after.moved[9:] - before.moved[9:]) * mean, axis=0)
        for part in (t[:3], t[4:]):
            part -= np.sum(b * part, axis=0) / (1.0 + np.sum(a * b, axis=0)) * (a + b)
            part[:] = part * np.cos(angle) + _cross(b, part) * np.sin(angle)
        return t

    def turn_on(self, pull: Array, before: Moment, after: Moment) -> None:
        """Turn the forces across contacts in the second half of a step."""
        pull[1:] = self.turn(pull, before, after, first=False)

    def _act(self, at: Moment, pull: Array, before: Moment | None) -> Array:
        """Return what acts along the motions of contacts; over a step, so that it keeps its energy."""
        r, length, both = at.r, at.length, None
        if before is not None:
            r, length = _mean(before, at)
            both = 2.0 * length / (at.length + before.length)
        self._resist(r, length, pull, both)
        return self._acting.ravel()

    def _resist(self, r: Array, length: Array, pull: Array, factor: Any) -> None:
        """Set forces and torques of contacts, whose normal forces have a factor."""
        n, across, normal = r / length, pull[1:4], (pull[0] + self._rest) * (1.0 if factor is None else factor)
        self._acting[:3], self._acting[3:6] = normal * n - across, length * _cross(n, across)
        self._acting[6:9] = -(pull[4] * n + pull[5:])

    def push(self, at: Moment, pull: Array, before: Moment | None = None) -> Array:
        """Return the accelerations (size,) of a pull, without :attr:`load`; with ``before``, its mean over a step."""
        return np.asarray(self._back @ self._act(at, pull, before))

    def resist(self, at: Moment, pull: Array, before: Moment | None = None) -> Array:
        """Return the forces (drives,) along each drive with which contacts and loads resist it."""
        return np.asarray(self._strain @ (self._still - self._act(at, pull, before)))

    def rest_energy(self, at: Moment) -> float:
        """Return the energy of the loads, J, less what the laws count of it."""
        return float(self._still @ at.moved.ravel() - np.sum(self._rest * at.e))


class PlaneDirections(TrueDirections):
    """The same of motions in the plane x, y: slip, roll and their forces are numbers, along (-n_y, n_x) and about z.

    There are no rolls where nothing resists them.
    """

    slips, axes, turns = 1, (0, 1), (2,)
    turn, turn_on = _Directions.turn, _Directions.turn_on

    def _list_rows(self, slip: Array, twist: Array, roll: Array, held: Array) -> tuple[Array, Array]:
        n, rows = self._r / self._length, 1 + int(np.any(roll))
        return np.array([slip, roll])[:rows], np.array([n[0] * held[1] - n[1] * held[0], np.zeros(len(slip))])[:rows]

    def _parts(self, near: Array, other: Array) -> list[tuple[Any, Any]]:
        return [(near, other), (-1.0, 1.0)][: len(self.ratio)]

    def _deform(self, n: Array, length: Array, moved: Array) -> Array:
        return np.concatenate([(n[0] * moved[1] - n[1] * moved[0] - length * moved[2])[None], moved[3:]])

    def _slip(self, before: Moment, after: Moment, at: slice, walls: Index, room: Array) -> None:
        way, moved, slip = room[: len(self._acting)], room[4:6], self._way[0, at]
        r = np.add(before.r[:, at], after.r[:, at], out=room[6:])
        np.subtract(after.moved[:, at], before.moved[:, at], out=way)
        np.multiply(r, way[1::-1], out=moved)
        np.subtract(moved[0], moved[1], out=slip)
        r *= r
        length = np.add(r[0], r[1], out=r[0])
        slip /= np.sqrt(length, out=length)  # twice the length
        length *= 0.5
        slip -= np.multiply(way[2], length, out=length)
        self._way[1:, at] = way[3:]

    def _resist(self, r: Array, length: Array, pull: Array, factor: Any) -> None:
        for at, _, room in self._blocks:
            (inverse, push, across), parts, acting = room[:3], room[3:5], self._acting[:3, at]
            np.divide(1.0, length[at], out=inverse)
            np.add(pull[0, at], self._rest[at], out=push)
            push *= inverse
            if factor is not None:
                push *= factor[at]
            np.multiply(pull[1, at], inverse, out=across)
            np.multiply(push, r[:, at], out=acting[:2])
            np.multiply(across, r[::-1, at], out=parts)
            acting[0] += parts[0]
            acting[1] -= parts[1]
            np.multiply(pull[1, at], length[at], out=acting[2])
        self._acting[3:] = -pull[2:]


def _mean(before: Moment, after: Moment) -> tuple[Array, Array]:
    """Return the mean of r over a step, and its length."""
    r = 0.5 * (before.r + after.r)
    return r, np.sqrt(np.sum(r * r, axis=0))


def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
