"""Where the contacts of an array are: in the geometry of the lattice, the limit of small spread,
and in the true one.

Units are those of :mod:`granphon.array.equilibrium`: displacements u in W; rotations phi in W/d;
the lattice's lengths in d. In the limit contacts keep the directions e of the lattice, and all is
linear: h = y + (x_i + x_j)/2 - e.(u_j - u_i), and slips are those of
:class:`~granphon.array.stencils.Stencils`.

In the true geometry directions, arms, overlaps and slips follow from the positions of balls. A load
compresses the cell evenly, by the factor 1 - eps y with eps = W/d and y = (d - a)/W, where a is the
spacing of the lattice in the compressed cell. A contact whose direction on the lattice is e then
has the vector from centre to centre

    w = e + eps v,    v = u_j - u_i - y e

and the overlap

    h = (x_i + x_j)/2 - q,    q = (|w| - 1)/eps = (2 e.v + eps v.v)/(1 + |w|),

in which no two numbers that are nearly equal are subtracted. It touches at the distances |w|/2 -+
eps (x_j - x_i)/4 from the centres, which are the radii less half of the overlap each; they add up
to |w|, so that forces exert no torque on a pair. It slips by

    ds = (1 - nn) du - (arm_i dphi_i + arm_j dphi_j) x n,    n = w/|w|

where du is the change of u_j - u_i - y e. From one configuration to the next the slip is found with
the angle by which n turns, exact, and the means of arms and tangents at both ends. It is of second
order in the step; in a plane it depends on the way by nothing but the change of arms. The tangents
turn with n along the shortest way from e, and about n with both balls.

For eps = 0 all this is the linear map of the lattice. The coefficient of Hertz's law is that of the
mean ball in both: its own radii change that of a contact by a part of order eps.

A geometry makes places: configurations of an array, that is, the motion of its balls and where that
leaves the contacts.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from granphon.array.contact_operator import ContactHessian
from granphon.array.friction import Tangent
from granphon.array.krylov import Single
from granphon.array.stencils import Motion, Stencils
from granphon.balls.contact_table import contact_frames
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.dynamics.rows import Row

#: changes of forces (-df, dT) that follow from a loss of overlap -dh and a slip ds
Law = Callable[[Array, Any], tuple[Array, Any]]
#: tangential forces T of contacts (n_s, n_c, L1, ..., Lp), none without friction
Shears = Array | tuple[()]
#: changes of the forces on balls and of the sum of forces, times -1, by a motion of balls and a
#: change of y; without one, y is held and the sum is not asked for
Product = Callable[[Single, float | None], tuple[Single, float]]
#: approximate inverse of C^T K C
Inverse = Callable[[Array], Array]


#: components along a contact's direction on the lattice and the two tangents there, arrays (n_c,
#: L1, ..., Lp); those that balls on a line or in a plane do not have are the number 0.0
_Vector = tuple[Any, Any, Any]
_ZERO: _Vector = (0.0, 0.0, 0.0)
#: largest width over diameter: of balls that differ more, some leave their neighbours, and touch
#: others
LARGEST_RATIO = 0.2
#: stiffness added to each contact in a step of Newton's method, as a fraction of the mean stiffness
#: times the distance from equilibrium: where many contacts are open the others do not make a solid,
#: and without it the step would be unbounded
ADDED_STIFFNESS = 1e-2
#: fraction by which Newton's method may miss a given mean force, with friction or in the true
#: geometry
LOAD_TOLERANCE = 1e-12


class ReducedLoad(NamedTuple):
    """Prescribed load: the reduced ``overlap`` y or, if that is None, the reduced mean contact
    ``force`` f*.

    If ``on_boundary`` is true, the load is a pressure: ``force`` is the f* under it where the cell
    keeps its size. In the true geometry the boundary shrinks with the cell.
    """

    overlap: float | None = None
    force: float = 0.0
    on_boundary: bool = False


class ActingForces(NamedTuple):
    """What the contacts of an array do in a small motion.

    Attributes
    ----------
    law : changes of forces (-df, dT) that follow from a loss of overlap and a slip.
    forces : (n_c, L1, ..., Lp) normal forces that act, and turn with their contacts; with the sign
        below zero where they are to hold balls against going aside, and not to push them there.
    shears : (n_s, n_c, L1, ..., Lp) tangential forces that act; none where nothing resists slip.
    rolling : stiffnesses of contacts against twist and rolls.
    """

    law: Law
    forces: Array
    shears: Shears = ()
    rolling: tuple[Any, Any] = (0.0, 0.0)


class LatticeGeometry:
    """Geometry of contacts that keep the directions of the lattice: the limit of spread and overlap
    small against d.

    ``ratio`` is eps = W/d, zero in this limit.
    """

    ratio = 0.0

    def __init__(self, stencils: Stencils, deviations: Array) -> None:
        self.stencils = stencils
        self.means = stencils.average_pairs(deviations)

    def place(self, balls: Array, overlap: float) -> LatticePlace:
        """Return the configuration with these motions ``balls`` and the overlap y."""
        return LatticePlace(self, balls, overlap)

    def begin(self, balls: Array, overlap: float) -> tuple[Array, Array]:
        """Return the overlaps of contacts and their slips from the sites, with which a history
        begins.
        """
        place = self.place(balls, overlap)
        return place.overlaps, place.slips(place, place.overlaps)


class LatticePlace:
    """Configuration of an array in its :class:`LatticeGeometry`.

    Attributes
    ----------
    balls : (fields, L1, ..., Lp) displacements and rotations.
    overlap : y.
    overlaps : (n_c, L1, ..., Lp) overlaps h of the contacts.
    boundary : size of the cell's boundary, over that with y = 0.
    """

    boundary = 1.0

    def __init__(self, geometry: LatticeGeometry, balls: Array, overlap: float) -> None:
        self._stencils = geometry.stencils
        self.balls = balls
        self.overlap = overlap
        stencils = self._stencils
        n = self._stencils.n_contacts
        rows = stencils.operator.deform(balls)
        self.overlaps = overlap + geometry.means - rows[:n]
        self._slips = rows[n:].reshape(-1, *self.overlaps.shape)

    def slips(self, before: Place, slips: Array) -> Array:
        """Return (n_s, n_c, L1, ..., Lp) slips from the sites: ``slips`` in the configuration
        ``before`` do not matter.
        """
        return self._slips

    def losses(self, motion: Motion) -> Array:
        """Return (n_c, L1, ..., Lp) losses of overlap by a small motion."""
        return self._stencils.deformations(motion)[: self._stencils.n_contacts]

    def pull(self, forces: Array, shears: Shears = ()) -> Array:
        """Return the forces on balls (fields, L1, ..., Lp) by normal forces f of contacts, and
        tangential ones T.
        """
        return self._stencils.forces(forces, *(-one for one in shears))

    def press(self, forces: Array, shears: Shears = ()) -> float:
        """Return the force whose work on dy is that of the load: the mean normal force."""
        return float(np.mean(forces))

    def linearise(self, tangent: Tangent, forces: Array, shears: Array) -> Product:
        """Return the changes of :meth:`pull` and of the sum of forces by small motions in single
        precision, both times -1.

        They follow from the ``tangent`` of the law of friction; no force turns.
        """
        return multiply(self._stencils, tangent)


def require_small(ratio: float) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless the ratio W/d is from zero to
    :data:`LARGEST_RATIO`.
    """
    if not 0.0 <= ratio <= LARGEST_RATIO:
        what = f"the exact geometry is not simulated of a width of {ratio:.3g} diameters"
        why = (
            "Contacts are those of neighbours on the lattice: of balls that differ much, others"
            " touch"
        )
        raise InputError(what, why, f"Give a width from zero to {LARGEST_RATIO:g} diameters")


class ExactGeometry:
    """True geometry of an array whose balls are of the mean diameter d: directions, arms and
    overlaps from positions.

    ``ratio`` is eps = W/d. The ``stencils`` say how balls move, with rotations or without; their
    lattice has as many periods as dimensions. Raises :class:`~granphon.base.errors.InputError` if
    the ratio is not from zero to :data:`LARGEST_RATIO`.
    """

    def __init__(self, stencils: Stencils, deviations: Array, ratio: float) -> None:
        require_small(ratio)
        self.stencils = stencils
        self.ratio = ratio
        self.means = stencils.average_pairs(deviations)
        first = stencils.by_ball(deviations)
        ends = np.stack([first[i] for i, _ in stencils.ends])
        #: (n_c, L1, ..., Lp) half of the difference of the radii of ball j and ball i, in d
        self.uneven = 0.5 * ratio * (self.means - ends)
        self.dimension = stencils.lattice.dimension
        self._turns = len(stencils.motions.rotations)
        # rows for the relative displacement of two balls, then for the sum and the difference of
        # their rotations: components along the contact's direction on the lattice and its tangents
        # there
        motions = stencils.motions
        p = self.dimension
        frame = [np.array(axis) for axis in contact_frames(stencils.lattice.contacts.normal[:, :p])]
        still, fixed = (
            np.zeros((len(axes), stencils.n_contacts))
            for axes in (motions.rotations, motions.translations)
        )
        moves = [np.concatenate([axis[list(motions.translations)], still]).T for axis in frame[:p]]
        turns = [
            np.concatenate([fixed, axis[list(motions.rotations)]]).T
            for axis in frame[3 - self._turns :]
        ]
        pushes = [Row("push", 1.0, move, move) for move in moves]
        #: stencils with the vectors of :meth:`split`
        self.frame = stencils.observe(
            [
                *pushes,
                *(Row("turn", 1.0, turn, sign * turn) for sign in (-1.0, 1.0) for turn in turns),
            ]
        )

    def place(self, balls: Array, overlap: float) -> ExactPlace:
        """Return the configuration with these motions ``balls`` and the overlap y."""
        return ExactPlace(self, balls, overlap)

    def begin(self, balls: Array, overlap: float) -> tuple[Array, Array]:
        """Return the overlaps of contacts, and slips of zero: they are counted from there."""
        overlaps = self.place(balls, overlap).overlaps
        return overlaps, np.zeros((self.dimension - 1, *overlaps.shape))

    def deform(self, motion: Motion) -> Array:
        """Return the deformations (rows, n_c, L1, ..., Lp) of :attr:`frame`."""
        return self.frame.deformations(motion).reshape(-1, *self.means.shape)

    def split(self, motion: Motion) -> tuple[_Vector, _Vector, _Vector]:
        """Return v, and the sum and the difference of the rotations of balls j and i, in the frames
        of the lattice.
        """
        return self.sort(self.deform(motion))

    def sort(self, rows: Array) -> tuple[_Vector, _Vector, _Vector]:
        """Return the three vectors from the deformations (rows, n_c, L1, ..., Lp) of
        :attr:`frame`.
        """
        p = self.dimension
        r = self._turns
        moved = (*rows[:p], *_ZERO[p:])
        if not r:
            return moved, _ZERO, _ZERO
        still = _ZERO[r:]  # in a plane balls turn about its normal, the last tangent
        return moved, (*still, *rows[p : p + r]), (*still, *rows[p + r :])

    def join(self, push: _Vector, turning: _Vector, rolling: _Vector) -> Array:
        """Return the forces on balls whose work is that of forces on the three vectors of
        :meth:`split`.
        """
        return self.frame.forces(*self.stack(push, turning, rolling))

    def stack(self, push: _Vector, turning: _Vector, rolling: _Vector) -> Array:
        """Return the forces on the three vectors as those on the deformations (rows, n_c, L1, ...,
        Lp) of :attr:`frame`.
        """
        parts = [*push[: self.dimension], *turning[3 - self._turns :], *rolling[3 - self._turns :]]
        return np.array([np.broadcast_to(part, self.means.shape) for part in parts])

    def axes(self) -> Array:
        """Return (n_c, p, p) directions of each kind of contact and its tangents on the lattice, as
        rows.
        """
        p = self.dimension
        return np.array(contact_frames(self.stencils.lattice.contacts.normal[:, :p]))[
            :p, :p
        ].transpose(2, 0, 1)


class ExactPlace:
    """Configuration of an array in its :class:`ExactGeometry`.

    Attributes
    ----------
    geometry, balls, overlap : the array, its motion, and y.
    size : (n_c, L1, ..., Lp) distances |w| of the centres, in d.
    normal : components of n.
    overlaps : (n_c, L1, ..., Lp) overlaps h.
    """

    def __init__(self, geometry: ExactGeometry, balls: Array, overlap: float) -> None:
        self.geometry = geometry
        self.balls = balls
        self.overlap = overlap
        eps = geometry.ratio
        self._moved, self._sum, self._difference = geometry.split(Motion(balls, overlap))
        self.vector = (
            1.0 + eps * self._moved[0],
            _scale(eps, self._moved[1]),
            _scale(eps, self._moved[2]),
        )
        self.size = np.sqrt(_dot(self.vector, self.vector))
        self.normal = _times(1.0 / self.size, self.vector)
        self._square = _dot(self._moved, self._moved)
        self._change = (2.0 * self._moved[0] + eps * self._square) / (1.0 + self.size)
        self.overlaps = geometry.means - self._change

    @cached_property
    def differences(self) -> Array:
        """(n_c, L1, ..., Lp) differences h - y, found without the loss of digits of a
        subtraction.
        """
        eps = self.geometry.ratio
        first = self._moved[0]
        straight = self.geometry.split(Motion(self.balls, 0.0))[0][0]
        curved = eps * (self._square - first * self._change) / (1.0 + self.size)
        return np.asarray(self.geometry.means - straight - curved)

    @cached_property
    def tangents(self) -> tuple[_Vector, _Vector]:
        """The tangents t and b, with n x t = b."""
        n0, n1, n2 = self.normal
        if not isinstance(n2, np.ndarray):
            return (-n1, n0, 0.0), (0.0, 0.0, 1.0)
        # a step that is too long may turn a contact round
        one = 1.0 / np.maximum(1.0 + n0, np.finfo(float).tiny)
        mixed = -n1 * n2 * one
        t = (-n1, 1.0 - n1 * n1 * one, mixed)
        b = (-n2, mixed, 1.0 - n2 * n2 * one)
        spin = 0.5 * self.geometry.ratio * self._sum[0]
        cosine = np.cos(spin)
        sine = np.sin(spin)
        return _add(_times(cosine, t), _times(sine, b)), _add(_times(cosine, b), _times(-sine, t))

    # -- slips -------------------------------------------------------------------------------------

    def slips(self, before: Place, slips: Array) -> Array:
        """Return (n_s, n_c, L1, ..., Lp) slips s here, if they are ``slips`` in the configuration
        ``before``.
        """
        assert isinstance(before, ExactPlace)
        if before is self:
            return slips
        eps = self.geometry.ratio
        size = 0.5 * (before.size + self.size)
        # the vector of the rotation that turns one direction into the other, over eps
        turn = _cross(before.vector, _subtract(self._moved, before._moved))
        if eps:
            sine = np.sqrt(_dot(turn, turn))
            angle = np.arctan2(eps * sine, _dot(before.vector, self.vector))
            turn = _times(
                np.divide(angle, eps * sine, out=np.ones_like(sine), where=sine > 0.0), turn
            )
        rolled = self._roll(
            _subtract(self._sum, before._sum), _subtract(self._difference, before._difference), size
        )
        gone = _subtract(_times(size, turn), rolled)
        (t0, b0), (t1, b1) = before.tangents, self.tangents
        found = _dot(gone, _add(b0, b1)), _scale(-1.0, _dot(gone, _add(t0, t1)))
        return slips + 0.5 * np.stack(found[: len(slips)])

    def _roll(self, total: _Vector, difference: _Vector, size: Array) -> _Vector:
        """Return arm_i phi_i + arm_j phi_j, from the sum and the difference of the rotations."""
        return _add(_times(0.5 * size, total), _times(self.geometry.uneven, difference))

    def losses(self, motion: Motion) -> Array:
        """Return (n_c, L1, ..., Lp) losses of overlap by a small motion."""
        return self.lose(self.geometry.split(motion)[0])

    def lose(self, moved: Any) -> Array:
        """Return the losses of overlap by small relative displacements of the two balls."""
        return np.asarray(_dot(self.normal, moved))

    def curve(self, moved: Any, forces: Array, stiffness: Array, slope: Array) -> tuple[Array, Any]:
        """Return the second derivatives along a straight line of the overlaps, and of the forces f
        n.

        ``moved`` are the relative displacements, ``stiffness`` df/dh and ``slope`` d^2f/dh^2.
        """
        eps = self.geometry.ratio
        n = self.normal
        loss = self.lose(moved)
        across = _subtract(moved, _times(loss, n))
        tilt = _times(eps / self.size, across)
        square = _dot(across, across)
        bend = -eps * square / self.size
        along = slope * loss**2 + stiffness * bend - forces * eps * eps * square / self.size**2
        aside = -2.0 * stiffness * loss - 2.0 * forces * eps * loss / self.size
        return bend, _add(_times(along, n), _times(aside, tilt))

    # -- forces ------------------------------------------------------------------------------------

    def pull(self, forces: Array, shears: Shears = ()) -> Array:
        """Return the forces on balls (fields, L1, ..., Lp) by normal forces f of contacts, and
        tangential ones T.
        """
        along, across = self._carry(shears)
        push = _subtract(_times(forces, self.normal), along)
        return self.geometry.join(
            push, _times(0.5 * self.size, across), _times(self.geometry.uneven, across)
        )

    def _carry(self, shears: Shears) -> tuple[_Vector, _Vector]:
        """Return the vectors T and n x T of the tangential forces."""
        parts = (*shears, *_ZERO[len(shears) : 2])
        t, b = self.tangents
        return _add(_times(parts[0], t), _times(parts[1], b)), _subtract(
            _times(parts[0], b), _times(parts[1], t)
        )

    @property
    def boundary(self) -> float:
        """Size of the cell's boundary, over that with y = 0."""
        return (1.0 - self.geometry.ratio * self.overlap) ** (len(self.geometry.stencils.shape) - 1)

    def press(self, forces: Array, shears: Shears = ()) -> float:
        """Return the force whose work on dy is that of the load: the mean of (f n - T).e over
        contacts.
        """
        push = forces * self.normal[0]
        if len(shears):
            push = push - self._carry(shears)[0][0]
        return float(np.mean(push))

    def stress(self, forces: Array, shears: Shears = ()) -> Array:
        """Return the (p, p) sum over contacts of the force on ball i times w, below zero where
        balls are pressed together.

        It is in units of stiffness times d^2.
        """
        along, _ = self._carry(shears)
        push, axes = _subtract(along, _times(forces, self.normal)), self.geometry.axes()
        out = np.zeros(axes.shape[1:])
        p = axes.shape[1]
        for a in range(p):
            for b in range(p):
                sums = np.sum(
                    np.broadcast_to(push[a] * self.vector[b], forces.shape).reshape(len(axes), -1),
                    axis=1,
                )
                out += np.einsum("c,ci,cj->ij", sums, axes[:, a], axes[:, b])
        return np.asarray(self.geometry.ratio * out)

    def respond(self, motion: Motion, acting: ActingForces) -> tuple[Array, float]:
        """Return the changes of :meth:`pull` and of the sum of forces by a small motion, both times
        -1.
        """
        tensions, normal = self.resist(self.geometry.deform(motion), acting)
        return self.geometry.frame.forces(*tensions), -float(np.sum(normal))

    def tabulate_stiffness(self, stiffness: Array, forces: Array) -> Array:
        """Return (p, p, n_c, L1, ..., Lp) what :meth:`resist` does for a unit of each deformation,
        without tangential forces and rotations.
        """
        n = np.array(self.normal[: self.geometry.dimension])
        aside = self.geometry.ratio * forces / self.size
        table = (stiffness + aside) * n[:, None] * n
        for a in range(len(n)):
            table[a, a] -= aside
        return np.asarray(table)

    def linearise(self, tangent: Tangent, forces: Array, shears: Array) -> Product:
        """Return :meth:`respond` with the ``tangent`` of the law of friction, for motions in single
        precision.
        """

        acting = ActingForces(tangent.apply, forces, shears)

        def product(balls: Single, press: float | None) -> tuple[Single, float]:
            pull, push = self.respond(Motion(balls.astype(float), press or 0.0), acting)
            return pull.astype(np.float32), push

        return product

    def resist(self, rows: Array, acting: ActingForces) -> tuple[Array, Array]:
        """Return what :meth:`respond` does, contact by contact: forces against the small
        deformations of frames, and -df.

        Deformations and forces are (rows, n_c, L1, ..., Lp).
        """
        law, forces, shears, (twist, roll) = acting
        moved, total, difference = self.geometry.sort(rows)
        eps = self.geometry.ratio
        n = self.normal
        half = 0.5 * self.size
        loss = _dot(n, moved)
        shear: Any = ()
        if len(shears):
            (t, b), rolled = self.tangents, self._roll(total, difference, self.size)
            slide = _dot(t, moved) - _dot(b, rolled), _dot(b, moved) + _dot(t, rolled)
            shear = np.stack(slide[: len(shears)])
        normal, shear = law(loss, shear)
        tilt = _times(eps / self.size, _subtract(moved, _times(loss, n)))  # dn
        along, across = self._carry(shear)
        push = _subtract(_add(_times(normal, n), along), _times(forces, tilt))
        if np.any(shears):
            held, arms = self._carry(shears)
            spin = 0.5 * eps * total[0]
            if isinstance(n[2], np.ndarray):  # of tangents that turn with n along the shortest way
                spin = spin - (n[1] * tilt[2] - n[2] * tilt[1]) / (1.0 + n[0])
            turn = _add(_cross(n, tilt), _times(spin, n))
            push = _add(push, _cross(turn, held))
            across = _add(across, _cross(turn, arms))
            turning = _add(_times(half, across), _times(0.5 * eps * loss, arms))
        else:
            turning = _times(half, across)
        turning = _times(-1.0, turning)
        back = _times(-self.geometry.uneven, across)
        if np.any(twist) or np.any(roll):
            back = _add(
                back,
                _add(_times(roll, difference), _times((twist - roll) * _dot(difference, n), n)),
            )
        return self.geometry.stack(push, turning, back), normal


#: geometry of an array of balls, and a configuration in it
Geometry = LatticeGeometry | ExactGeometry
Place = LatticePlace | ExactPlace


def find_boundary_force(place: Place, forces: Array, shears: Shears = ()) -> float:
    """Return the mean contact force f* at which the pressure is the same where the cell keeps its
    size.
    """
    return place.press(forces, shears) / place.boundary


def find_lack(load: ReducedLoad, place: Place, forces: Array, shears: Shears = ()) -> float:
    """Return what the mean contact force lacks to a load; zero at a given overlap."""
    if load.overlap is not None:
        return 0.0
    if load.on_boundary:
        return load.force * place.boundary - place.press(forces, shears)
    return load.force - float(np.mean(forces))


def multiply(stencils: Stencils, tangent: Tangent) -> Product:
    """Return the product of C^T D C, D being the ``tangent`` of the law of friction, with motions
    in single precision.
    """
    coupling = {(1 + slip, 0): -one for slip, one in enumerate(tangent.coupling)}
    for one in -tangent.cross:
        coupling |= {(1, 2): one, (2, 1): one}
    return ContactHessian(stencils.operator, [tangent.stiffness, *tangent.springs], coupling)


# -- vectors ---------------------------------------------------------------------------------------


def _scale(a: Any, b: Any) -> Any:
    return a * b if isinstance(b, np.ndarray) or b else 0.0


def _times(factor: Any, vector: _Vector) -> _Vector:
    if not isinstance(factor, np.ndarray) and not factor:
        return _ZERO
    return _scale(factor, vector[0]), _scale(factor, vector[1]), _scale(factor, vector[2])


def _add(one: _Vector, other: _Vector) -> _Vector:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def _subtract(one: _Vector, other: _Vector) -> _Vector:
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


def _product(a: Any, b: Any) -> Any:
    """Return a b, or 0.0 if either is a component that is not there."""
    if isinstance(a, float) and not a:
        return 0.0
    return _scale(a, b)


def _dot(one: _Vector, other: _Vector) -> Any:
    return _product(one[0], other[0]) + _product(one[1], other[1]) + _product(one[2], other[2])


def _cross(one: _Vector, other: _Vector) -> _Vector:
    return (
        _product(one[1], other[2]) - _product(one[2], other[1]),
        _product(one[2], other[0]) - _product(one[0], other[2]),
        _product(one[0], other[1]) - _product(one[1], other[0]),
    )
