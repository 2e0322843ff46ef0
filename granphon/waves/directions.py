"""How contacts deform as balls move, and how their forces act on the balls: in the directions of rest, or in the true ones.

Both take mass-weighted motions x of the balls that move and the ways of the drives, which they join to the motions of
contacts by a sparse matrix G; forces come back by its transpose. A geometry at a moment has elongations (n_c,); between two
moments there are slips, twists and rolls (rows - 1, n_c). Forces are a ``pull`` (rows, n_c) of
:class:`~granphon.waves.contact_forces.Touch`. A step goes through the contacts in parts that stay in the processor's cache.

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
from granphon.waves.contact_forces import Part, divide, share
from granphon.waves.operator import WaveOperator


class Moment(NamedTuple):
    """Contacts at a moment: their motions (rows, n_c) and elongations e (n_c,), and in true directions the vectors r across
    them (axes, n_c) and lengths |r| (n_c,)."""

    moved: Array
    e: Array
    r: Any = None
    length: Any = None


class _Directions:
    """What contacts have of the motions of their balls: G x, and s for a unit way of each drive."""

    #: (count - 1, n_c) forces across contacts at rest, and (size,) those of the loads that hold the balls against them
    held: Array
    load: Array
    #: (count - 1, n_c) slips, twists and rolls of a step, and the forces across contacts as they turn in its first half
    way: Array
    turned: Array
    parts: list[Part]
    _forward: Any
    _back: Any
    _strain: Array

    def _move(self, x: Array, ways: Array) -> Array:
        """Return the motions of contacts, (rows, n_c)."""
        found = self._forward @ x
        if ways.size:
            found += ways @ self._strain
        return np.asarray(found.reshape(-1, self.held.shape[1]))

    def turn_on(self, pull: Array, after: Moment, part: Part) -> None:
        """Turn the forces across contacts in the second half of a step: they stay as they are."""


class FixedDirections(_Directions):
    """Deformations in the directions of the network, which are linear in the motions.

    Attributes
    ----------
    count : number of deformations of a contact.
    slips : number of slips among them, which come first after the elongation.
    """

    def __init__(self, operator: WaveOperator, moved: list[tuple[Index, Array]], divides: bool) -> None:
        network, self.operator, rows = operator.network, operator, operator.law_rows
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
        self.held, self.way, self.parts = np.zeros((self.count - 1, n)), np.empty((self.count - 1, n)), divide(n, 3, divides)
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

    def rate(self, at: Moment, v: Array, ways: Array) -> Array:
        """Return the rates of all deformations (count, n_c), at velocities ``v`` and speeds of the drives."""
        return self._move(v, ways)

    def locate(self, x: Array, ways: Array) -> Moment:
        """Return the contacts of balls at ``x``."""
        moved = self._move(x, ways)
        return Moment(moved, moved[0])

    def begin(self, x: Array, ways: Array, spare: Moment | None = None) -> Moment:
        """As :meth:`locate`, but that :meth:`step` finishes it part by part; ``spare`` is written over."""
        return self.locate(x, ways)

    def step(self, before: Moment, after: Moment, pull: Array, part: Part) -> None:
        """Set :attr:`way` and :attr:`turned` of a part of the contacts; ``pull`` is that before."""
        np.subtract(after.moved[1:, part.at], before.moved[1:, part.at], out=self.way[:, part.at])
        self.turned = pull[1:]

    def push(self, at: Moment, pull: Array, before: Moment | None = None) -> Array:
        """Return the accelerations (size,) of a pull, without :attr:`load`; with ``before``, its mean over a step."""
        return np.asarray(self._back @ pull.ravel())

    def resist(self, at: Moment, pull: Array, before: Moment | None = None) -> Array:
        """Return the forces (drives,) along each drive with which contacts and loads resist it."""
        tension = np.concatenate([-pull[:1], pull[1:] - self.held])
        return np.asarray(self._strain @ tension.ravel())

    def rest_energy(self, at: Moment) -> float:
        """Return the energy that static forces across contacts take up, J."""
        return -float(np.sum(self.held * at.moved[1:]))


class TrueDirections(_Directions):
    """Deformations in the true directions. Slips and rolls are vectors: slip has three rows, twist one, roll three.

    ``rest`` (n_c,) are the normal forces of the network at rest, and ``more`` contacts (i, j, shift, kappa/k) besides, which
    begin to push where the distance of two balls is that of their radii and a ``bulge``. Their twists and rolls are resisted
    as in the mean of contacts, with the square of the distance of the balls. A contact has of the motions of its balls
    their displacements across it; the sum of their rotations, each times the part of |r| that is its arm; the rotation of
    ball j less that of i, where something resists it; and the sum of both, where arms are not the same.
    """

    slips = 3
    #: rows of room to work with, for each part of the contacts
    rows = 11
    #: axes of displacements and of rotations
    axes: tuple[int, ...] = (0, 1, 2)
    turns: tuple[int, ...] = (0, 1, 2)

    def __init__(
        self, operator: WaveOperator, fixed: FixedDirections, moved: list[tuple[Index, Array]], rest: Array,
        more: tuple[Index, Index, Index, Array], bulge: float, divides: bool,
    ) -> None:  # fmt: skip
        network, motions, self.top = operator.network, operator.motions, fixed.top
        (i, j, shift, ratio), extra = more, len(more[0])
        ends = i_of, j_of = np.concatenate([network.i, i]), np.concatenate([network.j, j])
        flat, n = np.isinf(network.distance), len(i_of)
        vectors = np.where(flat[:, None], network.normal, network.vector)
        apart, at_wall = network.positions[j] + shift @ network.cell - network.positions[i], np.isinf(network.radii[j])
        gap = np.linalg.norm(apart, axis=1) - network.radii[i] - np.where(at_wall, 0.0, network.radii[j]) - bulge
        for wall, (spot, toward) in network.walls.items():
            own = j == wall
            apart[own], gap[own] = toward, (spot - network.positions[i[own]]) @ toward - network.radii[i[own]]
        self._gap = np.append(np.zeros(network.n_contacts), np.maximum(gap, 0.0)) if extra else gap  # none pushes at rest
        self._r = np.ascontiguousarray(np.concatenate([vectors, apart]).T[list(self.axes)])
        self._square = np.sum(self._r**2, axis=0)
        self._length = np.sqrt(self._square)
        self._walls = walls = np.flatnonzero(np.concatenate([flat, at_wall]))  # r is the normal, of length one
        # arms share the distance, so that torques balance the moment of forces across contacts
        arm = np.concatenate([network.arm_i, network.radii[i]])
        arms = arm + np.concatenate([network.arm_j, np.where(at_wall, 0.0, network.radii[j])])
        slip = np.append(network.shear_stiffness / network.normal_stiffness, ratio)
        own, new = np.split(arms**2, [network.n_contacts])
        twist, roll = (
            np.append(one := each / network.normal_stiffness, np.mean(one / own) * new)
            for each in (network.torsion_stiffness, network.bending_stiffness)
        )
        held = np.zeros((3, n))
        if network.tangential_force is not None:
            held[:, : network.n_contacts] = -network.tangential_force.T
        self.ratio, self.held = self._list_rows(slip, twist, roll, held)
        self.count, rolls = 1 + len(self.ratio), len(self.ratio) > self.slips
        self._rest = share(np.append(rest, np.zeros(extra)))
        near = arm / arms
        other = 1.0 - near
        near[walls], other[walls] = arm[walls], 0.0
        turns = [(near, other), (-1.0, 1.0)][: 1 + rolls]
        acting = len(self.axes) + len(self.turns) * len(turns)
        if self.slips == 3:  # forces turn about n with the mean of both rotations: by half of it in half a step
            alike = bool(np.all(near == other))
            turns += [] if alike else [(1.0, 1.0)]
            self._spin, self._quarter = (slice(3, 6), 0.25) if alike else (slice(acting, acting + 3), 0.125)
            self._middle, self._axis, self._cosine = np.empty((3, n)), np.empty((3, n)), np.empty(n)
            self.turned = np.empty_like(self.held)
        kinds = [(axis, -1.0, 1.0) for axis in self.axes] + [(3 + axis, *each) for each in turns for axis in self.turns]
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
        self.parts, self.way = divide(n, self.rows, divides), np.empty_like(self.held)
        self._acting, self._back = np.empty((acting, n)), self._forward[: acting * n].T.tocsr()
        at = self.locate(np.zeros(operator.size), np.zeros(len(moved)))
        self._still = self._act(at, np.concatenate([np.zeros((1, n)), self.held]), None).copy()
        self.load = -(self._back @ self._still)

    def _list_rows(self, slip: Array, twist: Array, roll: Array, held: Array) -> tuple[Array, Array]:
        """Return the ratios of stiffnesses (rows - 1, n_c), and forces across contacts at rest likewise."""
        rows = 7 if np.any(twist) or np.any(roll) else 3
        return np.array([slip] * 3 + [twist] + [roll] * 3)[:rows], np.concatenate([held, np.zeros((4, len(slip)))])[:rows]

    def locate(self, x: Array, ways: Array) -> Moment:
        """Return the contacts of balls at ``x``."""
        found = self.begin(x, ways)
        for part in self.parts:
            self._place(found, *part)
        return found

    def begin(self, x: Array, ways: Array, spare: Moment | None = None) -> Moment:
        """As :meth:`locate`, but that :meth:`step` finishes it part by part; ``spare`` is written over."""
        moved, length = self._move(x, ways), self._length
        if spare is None:
            return Moment(moved, np.empty_like(length), np.empty_like(self._r), np.empty_like(length))
        return spare._replace(moved=moved)

    def step(self, before: Moment, after: Moment, pull: Array, part: Part) -> None:
        """Set contacts after a step, and :attr:`way` and :attr:`turned`, of a part; ``pull`` is that before."""
        self._place(after, *part)
        self._slip(before, after, self.way[:, part.at], *part)
        self._turn(before, after, pull, *part)

    def _place(self, found: Moment, at: slice, room: Array) -> None:
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
        if len(self._walls):
            walls = self._walls[(self._walls >= at.start) & (self._walls < at.stop)]
            found.r[:, walls], found.length[walls] = self._r[:, walls], 1.0
            found.e[walls] = np.sum(self._r[:, walls] * found.moved[: len(self.axes), walls], axis=0)
        if len(self._gap):
            e += self._gap[at]

    def _slip(self, before: Moment, after: Moment, way: Array, at: slice, room: Array) -> None:
        """Set slips, twists and rolls of a step, across the mean of r, to ``way``, and the direction of that."""
        n, slip = self._middle[:, at], way[:3]
        r = np.add(before.r[:, at], after.r[:, at], out=room[:3])  # twice the mean
        turn = np.subtract(after.moved[3:6, at], before.moved[3:6, at], out=room[3:6])
        turn *= 0.5
        np.subtract(after.moved[:3, at], before.moved[:3, at], out=slip)
        slip -= _cross(turn, r, room[6:10])
        square = _dot(r, r, room[3:6])
        along = _dot(r, slip, room[6:9])
        along /= square
        np.sqrt(square, out=square)
        np.divide(r, square, out=n)
        r *= along
        slip -= r
        if len(way) > 3:
            np.subtract(after.moved[6:9, at], before.moved[6:9, at], out=way[4:])
            way[3] = _dot(n, way[4:], room[:3])
            way[4:] -= n * way[3]

    def _turn(self, before: Moment, after: Moment, pull: Array, at: slice, room: Array) -> None:
        """Turn the forces across contacts to the mean of r, and half of the way about it."""
        n, sine, cosine = self._middle[:, at], room[6], self._cosine[at]
        self._carry(before, n, pull[1:, at], self.turned[:, at], at, room)
        spin = np.subtract(after.moved[self._spin, at], before.moved[self._spin, at], out=room[:3])
        half = _dot(spin, n, room[3:6])
        half *= self._quarter  # the tangent of half of the angle, which is small
        np.multiply(half, half, out=sine)
        sine += 1.0
        np.divide(2.0, sine, out=cosine)
        np.multiply(half, cosine, out=sine)
        cosine -= 1.0
        np.multiply(n, sine, out=self._axis[:, at])
        self._rotate(self.turned[:, at], at, room)

    def _rotate(self, across: Array, at: slice, room: Array) -> None:
        """Rotate forces across contacts about the mean of r."""
        for force in (across[:3], across[4:]):
            if len(force):
                aside = _cross(self._axis[:, at], force, room[:4])
                force *= self._cosine[at]
                force += aside

    def _carry(self, moment: Moment, n: Array, across: Array, out: Array, at: slice, room: Array) -> None:
        """Turn forces across contacts by the smallest rotation between n and the direction of r at a moment, to ``out``."""
        start = np.divide(moment.r[:, at], moment.length[at], out=room[:3])
        both = _dot(start, n, room[3:6])
        both += 1.0
        start += n
        start /= np.sqrt(both, out=both)  # of length 2^1/2: what is across one direction is mirrored to be across the other
        for rows in (slice(0, 3), slice(4, 7)):
            force = across[rows]
            if len(force):
                np.subtract(force, np.multiply(start, _dot(start, force, room[3:6]), out=room[6:9]), out=out[rows])
        if len(across) > 3:
            out[3] = across[3]

    def turn_on(self, pull: Array, after: Moment, part: Part) -> None:
        """Turn the forces across contacts in the second half of a step: about the mean of r, and from it."""
        at, room = part
        self._rotate(pull[1:, at], at, room)
        self._carry(after, self._middle[:, at], pull[1:, at], pull[1:, at], at, room)

    def rate(self, at: Moment, v: Array, ways: Array) -> Array:
        """Return the rates of all deformations (count, n_c), at velocities ``v`` and speeds of the drives."""
        moving = self._move(v, ways)
        found = np.concatenate([np.sum(at.r * moving[: len(at.r)], axis=0)[None] / at.length, np.empty_like(self.held)])
        before, after = at._replace(moved=np.zeros_like(moving)), at._replace(moved=moving)
        for part, room in self.parts:
            self._slip(before, after, found[1:, part], part, room)
        return found

    def _act(self, at: Moment, pull: Array, before: Moment | None) -> Array:
        """Return what acts along the motions of contacts; over a step, so that it keeps its energy."""
        r, length, both = at.r, at.length, None
        if before is not None:
            r = 0.5 * (before.r + at.r)
            length = np.sqrt(np.sum(r * r, axis=0))
            both = 2.0 * length / (at.length + before.length)
        for part, room in self.parts:
            push = np.add(pull[0, part], self._rest[part], out=room[0])
            if both is not None:
                push *= both[part]
            self._resist(r[:, part], length[part], push, pull[1:, part], self._acting[:, part], room[1:])
        return self._acting.ravel()

    def _resist(self, r: Array, length: Array, push: Array, across: Array, out: Array, room: Array) -> None:
        """Set forces and torques of contacts that push, and resist across."""
        np.multiply(r, np.divide(push, length, out=push), out=out[:3])
        out[:3] -= across[:3]
        _cross(r, across[:3], room, out[3:6])
        if len(out) > 6:
            out[6:] = -(across[3] * r / length + across[4:])

    def push(self, at: Moment, pull: Array, before: Moment | None = None) -> Array:
        """Return the accelerations (size,) of a pull, without :attr:`load`; with ``before``, its mean over a step."""
        return np.asarray(self._back @ self._act(at, pull, before))

    def resist(self, at: Moment, pull: Array, before: Moment | None = None) -> Array:
        """Return the forces (drives,) along each drive with which contacts and loads resist it."""
        return np.asarray(self._strain[:, : self._acting.size] @ (self._still - self._act(at, pull, before)))

    def rest_energy(self, at: Moment) -> float:
        """Return the energy of the loads, J, less what the laws count of it."""
        return float(self._still @ at.moved[: len(self._acting)].ravel() - np.sum(self._rest * at.e))


class PlaneDirections(TrueDirections):
    """The same of motions in the plane x, y: slip, roll and their forces are numbers, along (-n_y, n_x) and about z.

    There are no rolls where nothing resists them.
    """

    slips, rows, axes, turns = 1, 8, (0, 1), (2,)
    turn_on = _Directions.turn_on

    def _list_rows(self, slip: Array, twist: Array, roll: Array, held: Array) -> tuple[Array, Array]:
        n, rows = self._r / self._length, 1 + int(np.any(roll))
        return np.array([slip, roll])[:rows], np.array([n[0] * held[1] - n[1] * held[0], np.zeros(len(slip))])[:rows]

    def _slip(self, before: Moment, after: Moment, way: Array, at: slice, room: Array) -> None:
        moved, crossed, slip = room[: len(self._acting)], room[4:6], way[0]
        r = np.add(before.r[:, at], after.r[:, at], out=room[6:])
        np.subtract(after.moved[:, at], before.moved[:, at], out=moved)
        np.multiply(r, moved[1::-1], out=crossed)
        np.subtract(crossed[0], crossed[1], out=slip)
        r *= r
        length = np.add(r[0], r[1], out=r[0])
        slip /= np.sqrt(length, out=length)  # twice the length
        length *= 0.5
        slip -= np.multiply(moved[2], length, out=length)
        way[1:] = moved[3:]

    def _turn(self, before: Moment, after: Moment, pull: Array, at: slice, room: Array) -> None:
        self.turned = pull[1:]

    def _resist(self, r: Array, length: Array, push: Array, across: Array, out: Array, room: Array) -> None:
        inverse, aside, parts = room[0], room[1], room[2:4]
        np.divide(1.0, length, out=inverse)
        push *= inverse
        np.multiply(across[0], inverse, out=aside)
        np.multiply(push, r, out=out[:2])
        np.multiply(aside, r[::-1], out=parts)
        out[0] += parts[0]
        out[1] -= parts[1]
        np.multiply(across[0], length, out=out[2])
        out[3:] = -across[1:]


def _dot(a: Array, b: Array, room: Array) -> Array:
    """Return a . b of vectors (3, n), in a row of the room (3, n)."""
    np.multiply(a, b, out=room)
    room[0] += room[1]
    room[0] += room[2]
    return np.asarray(room[0])


def _cross(a: Array, b: Array, room: Array, out: Array | None = None) -> Array:
    """Return a x b of vectors (3, n), in ``out`` or the room (4, n)."""
    found, work = room[:3] if out is None else out, room[3]
    for axis in range(3):
        np.multiply(a[axis - 2], b[axis - 1], out=found[axis])
        found[axis] -= np.multiply(a[axis - 1], b[axis - 2], out=work)
    return found
