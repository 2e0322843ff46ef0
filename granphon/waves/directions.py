"""How contacts deform as balls move, and how their forces act on the balls: in the directions of
rest, or in the true ones.

Both take mass-weighted motions x of the balls that move and the ways of the drives. A geometry at a
moment has elongations (n_c,); between two moments there are slips, twists and rolls (rows - 1,
n_c). Forces are a ``pull`` (rows, n_c) of :class:`~granphon.waves.contact_forces.Touch`.

In the directions of rest all is linear, by the rows of :mod:`granphon.dynamics.rows`: a sparse
matrix takes motions to deformations, and its transpose forces to balls. In the true ones r joins
two balls and n = r/|r|; arms add up to |r|, and the contact has the overlap h_0 + |r_0| - |r|. A
step takes its slips across the mean of r before and after; forces across contacts turn with n by
the smallest rotation that takes n along, and about n with the mean spin of the two balls. So |T|
stays, and pairs of forces and torques keep momentum and angular momentum exactly. Loads that hold
the balls at rest keep their directions. These are some 300 operations on a contact, which compiled
loops make at once: as operations on arrays they take four times as long, most of it to read and
write what is between.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from granphon.base.arrays import Array, Index
from granphon.base.compiled import compiled
from granphon.waves.operator import WaveOperator


class Moment(NamedTuple):
    """Contacts at a moment: their deformations (rows, n_c), the first of which are elongations e
    (n_c,).

    In true directions, the motions (n, 6) of all balls, e, the vectors r across contacts (3, n_c),
    and |r| (n_c,).
    """

    moved: Array
    e: Array
    r: Any = None
    length: Any = None


class _Start(NamedTuple):
    """Contacts at rest, for true directions, (n_c,) or with vectors (3, n_c).

    They join the balls ``ends`` (2, n_c), and have r and its ``length``; the ``gap`` of those that
    do not touch; whether r is the normal of a ``flat`` wall, of length one; the parts of |r| that
    are the arms of ball i, ``near``, and of j, ``other``; and the normal ``force``.
    """

    ends: Any
    r: Array
    length: Array
    gap: Array
    flat: Any
    near: Array
    other: Array
    force: Array


class FixedDirections:
    """Deformations in the directions of the network, which are linear in the motions and in the
    ways of drives.

    Attributes
    ----------
    count : number of deformations of a contact.
    slips : number of slips among them, which come first after the elongation.
    ratio : (count - 1, n_c) stiffnesses of the others over those of flat punches as wide as the
        contacts, ``punch`` (n_c,).
    held, load : (count - 1, n_c) forces across contacts at rest, and (size,) those of the loads
        that hold the balls against them.
    way, turned : (count - 1, n_c) slips, twists and rolls of a step, and the forces across contacts
        as they turn in its first half.
    """

    def __init__(
        self, operator: WaveOperator, moved: list[tuple[Index, Array]], punch: Array
    ) -> None:
        network = operator.network
        self.operator = operator
        rows = operator.law_rows
        self.count = len(rows)
        self.slips = sum(row.kind == "slip" for row in rows)
        n = network.n_contacts
        self.ratio = np.array([row.stiffness / punch for row in rows[1:]]).reshape(-1, n)
        self._forward = operator.compose(rows)
        #: forces of a pull: f - f_0 pushes, and T resists
        self._back = self._forward.T.tocsr()
        signs = np.where(np.arange(self.count * n) < n, 1.0, -1.0)
        self._back.data *= signs[self._back.indices]
        # one of the same structure
        self._reach = type(self._back)(
            (abs(self._back.data), self._back.indices, self._back.indptr), self._back.shape
        )
        # what a unit way of driven balls adds to the deformations
        self._strain = np.zeros((len(moved), self.count * n))
        for number, (balls, along) in enumerate(moved):
            vector = np.zeros(operator.motions.count)
            vector[: len(operator.motions.translations)] = along[
                list(operator.motions.translations)
            ]
            driven = np.isin(np.arange(network.n_balls), balls)
            self._strain[number] = np.concatenate(
                [
                    np.where(driven[network.j], row.head @ vector, 0.0)
                    - np.where(driven[network.i], row.tail @ vector, 0.0)
                    for row in rows
                ]
            )
        self.held, self.way = np.zeros((self.count - 1, n)), np.empty((self.count - 1, n))
        if network.tangential_force is not None:
            axes = list(operator.motions.translations)
            for place in range(self.slips):
                self.held[place] = -np.sum(
                    network.tangential_force[:, axes] * rows[1 + place].head[:, : len(axes)], axis=1
                )
        self._still = np.concatenate([np.zeros(n), self.held.ravel()])
        self._resist = -signs * self._strain
        self.load = -(self._back @ self._still)

    def top(self, stiffness: Array) -> float:
        """Return a bound of the angular frequencies of contacts of a normal ``stiffness`` (n_c,),
        rad/s.
        """
        n = self.held.shape[1]
        if len(stiffness) > n:  # balls have met
            stiffness = np.maximum(stiffness[:n], stiffness[n:].max())
        each = np.concatenate([stiffness[None], self.ratio * stiffness]).ravel()
        return float(
            np.sqrt(np.max(self._reach @ (each * (self._reach.T @ np.ones(len(self.load))))))
        )

    def _deform(self, x: Array, ways: Array) -> Array:
        """Return the deformations (count, n_c)."""
        found = self._forward @ x
        if ways.size:
            found += ways @ self._strain
        return np.asarray(found.reshape(self.count, -1))

    def rate(self, at: Moment, v: Array, ways: Array) -> Array:
        """Return the rates of all deformations (count, n_c), at velocities ``v`` and speeds of the
        drives.
        """
        return self._deform(v, ways)

    def locate(self, x: Array, ways: Array, spare: Moment | None = None) -> Moment:
        """Return the contacts of balls at ``x``."""
        moved = self._deform(x, ways)
        return Moment(moved, moved[0])

    def step(self, before: Moment, after: Moment, pull: Array) -> None:
        """Set :attr:`way`, and :attr:`turned`, of a step; ``pull`` is that before."""
        np.subtract(after.moved[1:], before.moved[1:], out=self.way)
        self.turned = pull[1:]

    def turn_on(self, pull: Array, after: Moment) -> None:
        """Turn the forces across contacts in the second half of a step: they stay as they are."""

    def push(self, at: Moment, pull: Array, before: Moment | None = None) -> tuple[Array, Array]:
        """Return the accelerations (size,) of a pull, without :attr:`load`, and the forces along
        drives that resist them.

        With ``before``, those of its mean over a step.
        """
        flat = pull.ravel()
        resisted = self._resist @ (flat - self._still) if len(self._resist) else np.zeros(0)
        return np.asarray(self._back @ flat), np.asarray(resisted)

    def rest_energy(self, at: Moment) -> float:
        """Return the energy that static forces across contacts take up, J."""
        return -float(np.sum(self.held * at.moved[1:]))


class TrueDirections:
    """Deformations in the true directions. Slips and rolls are vectors: slip has three rows, twist
    one, roll three.

    ``rest`` (n_c,) are the normal forces of the network at rest, ``punch`` (n_c,) stiffnesses of
    flat punches as wide as its contacts, and ``more`` contacts (i, j, shift, kappa over that)
    besides, which begin to push where the distance of two balls is that of their radii and a
    ``bulge``. Their twists and rolls are resisted as in the mean of contacts, with the square of
    the distance of the balls.
    """

    slips = 3

    def __init__(
        self,
        operator: WaveOperator,
        fixed: FixedDirections,
        moved: list[tuple[Index, Array]],
        rest: Array,
        punch: Array,
        more: tuple[Index, Index, Index, Array],
        bulge: float,
    ) -> None:
        network = operator.network
        self.top = fixed.top
        self._driven = moved
        self._balls = operator.network.n_balls
        (i, j, shift, ratio), extra = more, len(more[0])
        ends = i_of, _ = np.array(
            [np.concatenate([network.i, i]), np.concatenate([network.j, j])]
        ).astype(np.uintp)
        flat = np.isinf(network.distance)
        n = len(i_of)
        vectors = np.where(flat[:, None], network.normal, network.vector)
        apart = network.positions[j] + shift @ network.cell - network.positions[i]
        at_wall = np.isinf(network.radii[j])
        gap = (
            np.linalg.norm(apart, axis=1)
            - network.radii[i]
            - np.where(at_wall, 0.0, network.radii[j])
            - bulge
        )
        for wall, (spot, toward) in network.walls.items():
            own = j == wall
            apart[own], gap[own] = (
                toward,
                (spot - network.positions[i[own]]) @ toward - network.radii[i[own]],
            )
        gap = np.append(np.zeros(network.n_contacts), np.maximum(gap, 0.0))  # none pushes at rest
        flat = np.append(flat, at_wall)
        # arms share the distance, so that torques balance the moment of forces across contacts
        arm = np.append(network.arm_i, network.radii[i])
        arms = arm + np.append(network.arm_j, np.where(at_wall, 0.0, network.radii[j]))
        near = np.where(flat, arm, arm / arms)
        r = np.ascontiguousarray(np.concatenate([vectors, apart]).T)
        length = np.sqrt(np.sum(r * r, axis=0))
        other = np.where(flat, 0.0, 1.0 - near)
        self._start = _Start(
            ends, r, length, gap, flat, near, other, np.append(rest, np.zeros(extra))
        )
        slip = np.append(network.shear_stiffness / punch, ratio)
        own, new = np.split(arms**2, [network.n_contacts])
        twist, roll = (
            np.append(one := each / punch, np.mean(one / own) * new)
            for each in (network.torsion_stiffness, network.bending_stiffness)
        )
        rows = 7 if np.any(twist) or np.any(roll) else 3
        self.count = 1 + rows
        self.ratio = np.array([slip] * 3 + [twist] + [roll] * 3)[:rows]
        self.held = np.zeros((rows, n))
        if network.tangential_force is not None:
            self.held[:3, : network.n_contacts] = -network.tangential_force.T
        self.way = np.empty((rows, n))
        self.turned = np.empty((rows, n))
        self._mean = np.empty((4, n))
        self._places, self._weights = operator.in_balls
        at = self.locate(np.zeros(operator.size), np.zeros(len(moved)))
        self._still = self._act(at, np.concatenate([np.zeros((1, n)), self.held]), at)
        self.load = -self._gather(self._still)

    def _spread(self, x: Array, ways: Array) -> Array:
        """Return the motions (n, 6) of all balls: displacements, m, and rotations, rad."""
        found = np.zeros((self._balls, 6))
        _spread(x, self._places, self._weights, found)
        for (balls, along), way in zip(self._driven, ways, strict=True):
            found[balls, :3] = way * along
        return found

    def _gather(self, forces: Array) -> Array:
        """Return the accelerations (size,) by forces and torques (n, 6) on all balls."""
        found = np.empty(len(self._places))
        _gather(forces, self._places, self._weights, found)
        return found

    def locate(self, x: Array, ways: Array, spare: Moment | None = None) -> Moment:
        """Return the contacts of balls at ``x``; ``spare`` is written over."""
        n = len(self._start.length)
        moved = self._spread(x, ways)
        found = Moment(
            moved, *((np.empty(n), np.empty((3, n)), np.empty(n)) if spare is None else spare[1:])
        )
        _place(self._start, found)
        return found

    def step(self, before: Moment, after: Moment, pull: Array) -> None:
        """Set :attr:`way`, and :attr:`turned`, of a step; ``pull`` is that before."""
        gone = after.moved - before.moved
        _step(self._start, before, after, gone, pull, self.way, self.turned, self._mean)

    def turn_on(self, pull: Array, after: Moment) -> None:
        """Turn the forces across contacts in the second half of a step: about the mean of r, and
        from it.
        """
        _turn_on(after, pull, self._mean)

    def rate(self, at: Moment, v: Array, ways: Array) -> Array:
        """Return the rates of all deformations (count, n_c), at velocities ``v`` and speeds of the
        drives.
        """
        found = np.empty((self.count, len(at.e)))
        _rate(self._start, at, self._spread(v, ways), found)
        return found

    def _act(self, at: Moment, pull: Array, before: Moment) -> Array:
        """Return the forces and torques (n, 6) on all balls; over a step from ``before``, so that
        it keeps its energy.
        """
        found = np.zeros_like(at.moved)
        _act(self._start, before, at, pull, found)
        return found

    def push(self, at: Moment, pull: Array, before: Moment | None = None) -> tuple[Array, Array]:
        """Return the accelerations (size,) of a pull, without :attr:`load`, and the forces along
        drives that resist them.

        With ``before``, those of its mean over a step.
        """
        forces = self._act(at, pull, at if before is None else before)
        drawn = [
            np.sum((self._still[balls, :3] - forces[balls, :3]) @ along)
            for balls, along in self._driven
        ]
        return self._gather(forces), np.array(drawn)

    def rest_energy(self, at: Moment) -> float:
        """Return the energy of the loads, J, less what the laws count of it."""
        return float(np.sum(self._still * at.moved) - np.sum(self._start.force * at.e))


_Vector = tuple[float, float, float]


@compiled
def _dot(a: _Vector, b: _Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _cross(a: _Vector, b: _Vector) -> _Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _add(a: _Vector, factor: float, b: _Vector) -> _Vector:
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@compiled
def _scale(factor: float, a: _Vector) -> _Vector:
    return factor * a[0], factor * a[1], factor * a[2]


@compiled
def _get(rows: Array, first: int, contact: int) -> _Vector:
    """Return the vector of a contact in three rows."""
    return rows[first, contact], rows[first + 1, contact], rows[first + 2, contact]


@compiled
def _set(rows: Array, first: int, contact: int, a: _Vector) -> None:
    """Set the vector of a contact in three rows."""
    rows[first, contact], rows[first + 1, contact], rows[first + 2, contact] = a


@compiled
def _of(motions: Array, ball: int, first: int) -> _Vector:
    """Return the displacement, or from the ``first`` 3 the rotation, of a ball."""
    return motions[ball, first], motions[ball, first + 1], motions[ball, first + 2]


@compiled
def _carry(force: _Vector, start: _Vector, end: _Vector) -> _Vector:
    """Turn a force across the unit vector ``start`` by the smallest rotation to ``end``: it is
    mirrored between both.
    """
    both = _add(start, 1.0, end)
    return _add(force, -_dot(both, force) / (1.0 + _dot(start, end)), both)


@compiled
def _turn(force: _Vector, n: _Vector, half: float) -> _Vector:
    """Turn a force across n about it, by the angle of whose half this is the tangent."""
    cosine = 2.0 / (1.0 + half * half)
    return _add(_scale(cosine - 1.0, force), half * cosine, _cross(n, force))


@compiled
def _spread(x: Array, places: Any, weights: Array, found: Array) -> None:
    """Set what is at these places of all motions to x times its weights."""
    flat = found.reshape(found.size)
    for place in range(len(x)):
        flat[places[place]] = weights[place] * x[place]


@compiled
def _gather(forces: Array, places: Any, weights: Array, found: Array) -> None:
    """Set ``found`` to what is at these places of all forces, times its weights."""
    flat = forces.reshape(forces.size)
    for place in range(len(found)):
        found[place] = weights[place] * flat[places[place]]


@compiled
def _place(start: _Start, found: Moment) -> None:
    """Set vectors, lengths and elongations of contacts at a moment."""
    for contact in range(len(start.length)):
        i = start.ends[0, contact]
        j = start.ends[1, contact]
        r = _get(start.r, 0, contact)
        length = start.length[contact]
        across = _add(_of(found.moved, j, 0), -1.0, _of(found.moved, i, 0))
        if start.flat[contact]:
            stretch = _dot(r, across)
        else:
            after = _add(r, 1.0, across)
            # |r|^2 - |r_0|^2, no difference of near-equal lengths
            square = _dot(_add(r, 1.0, after), across)
            r = after
            now = math.sqrt(length * length + square)
            stretch = square / (length + now)
            length = now
        _set(found.r, 0, contact, r)
        found.length[contact], found.e[contact] = length, stretch + start.gap[contact]


@compiled
def _slip(
    start: _Start, gone: Array, r: _Vector, n: _Vector, contact: int, way: Array, first: int
) -> None:
    """Set slip, and twist and roll where there are any, of a contact whose balls have ``gone``,
    across n = r/|r|.
    """
    i = start.ends[0, contact]
    j = start.ends[1, contact]
    turn_i = _of(gone, i, 3)
    turn_j = _of(gone, j, 3)
    turn = _add(_scale(start.near[contact], turn_i), start.other[contact], turn_j)
    slip = _add(_add(_of(gone, j, 0), -1.0, _of(gone, i, 0)), -1.0, _cross(turn, r))
    _set(way, first, contact, _add(slip, -_dot(n, slip), n))
    if len(way) > first + 3:
        roll = _add(turn_j, -1.0, turn_i)
        way[first + 3, contact] = _dot(n, roll)
        _set(way, first + 4, contact, _add(roll, -_dot(n, roll), n))


@compiled
def _step(
    start: _Start,
    before: Moment,
    after: Moment,
    gone: Array,
    pull: Array,
    way: Array,
    turned: Array,
    mean: Array,
) -> None:
    """Set slips, twists and rolls of a step, across the mean of r, and the forces across contacts
    as they turn to it.

    ``mean`` gets the direction of the mean of r, and the tangent of half of the angle about it in
    half of the step.
    """
    for contact in range(len(start.length)):
        i = start.ends[0, contact]
        j = start.ends[1, contact]
        first = _get(before.r, 0, contact)
        r = _scale(0.5, _add(first, 1.0, _get(after.r, 0, contact)))
        n = _scale(1.0 / math.sqrt(_dot(r, r)), r)
        _slip(start, gone, r, n, contact, way, 0)
        # about n with the mean of both rotations, by half of it in half of the step
        half = 0.125 * _dot(n, _add(_of(gone, i, 3), 1.0, _of(gone, j, 3)))
        _set(mean, 0, contact, n)
        mean[3, contact] = half
        first = _scale(1.0 / before.length[contact], first)
        _set(turned, 0, contact, _turn(_carry(_get(pull, 1, contact), first, n), n, half))
        if len(way) > 3:
            turned[3, contact] = pull[4, contact]
            _set(turned, 4, contact, _turn(_carry(_get(pull, 5, contact), first, n), n, half))


@compiled
def _turn_on(after: Moment, pull: Array, mean: Array) -> None:
    """Turn the forces across contacts about the mean of r, and from it."""
    for contact in range(pull.shape[1]):
        n = _get(mean, 0, contact)
        half = mean[3, contact]
        last = _scale(1.0 / after.length[contact], _get(after.r, 0, contact))
        _set(pull, 1, contact, _carry(_turn(_get(pull, 1, contact), n, half), n, last))
        if len(pull) > 4:
            _set(pull, 5, contact, _carry(_turn(_get(pull, 5, contact), n, half), n, last))


@compiled
def _rate(start: _Start, at: Moment, gone: Array, found: Array) -> None:
    """Set the rates of all deformations, at velocities ``gone`` of the balls."""
    for contact in range(len(start.length)):
        i = start.ends[0, contact]
        j = start.ends[1, contact]
        r = _get(at.r, 0, contact)
        n = _scale(1.0 / at.length[contact], r)
        found[0, contact] = _dot(n, _add(_of(gone, j, 0), -1.0, _of(gone, i, 0)))
        _slip(start, gone, r, n, contact, found, 1)


@compiled
def _act(start: _Start, before: Moment, after: Moment, pull: Array, found: Array) -> None:
    """Add forces and torques of contacts to those on balls, ``found``, in the mean of r before and
    after.
    """
    for contact in range(len(start.length)):
        i = start.ends[0, contact]
        j = start.ends[1, contact]
        r = _scale(0.5, _add(_get(before.r, 0, contact), 1.0, _get(after.r, 0, contact)))
        across = _get(pull, 1, contact)
        # over |r|: times its length over that of the mean of lengths, as energies change
        push = (
            (pull[0, contact] + start.force[contact])
            * 2.0
            / (before.length[contact] + after.length[contact])
        )
        force = _add(_scale(push, r), -1.0, across)
        moment = _cross(r, across)
        roll = (0.0, 0.0, 0.0)
        if len(pull) > 4:
            roll = _add(_get(pull, 5, contact), pull[4, contact] / math.sqrt(_dot(r, r)), r)
        for axis in range(3):
            found[i, axis] -= force[axis]
            found[j, axis] += force[axis]
            found[i, 3 + axis] += start.near[contact] * moment[axis] + roll[axis]
            found[j, 3 + axis] += start.other[contact] * moment[axis] - roll[axis]
