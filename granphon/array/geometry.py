"""Where the contacts of an array are in its true geometry; in that of the lattice, the limit of
small spread, they are at rest on a grid (:mod:`granphon.contacts.grid`).

Units are those of :mod:`granphon.array.equilibrium`: displacements u in W; rotations phi in W/d;
the lattice's lengths in d. In the limit contacts keep the directions e of the lattice, and all is
linear: h = y + (x_i + x_j)/2 - e.(u_j - u_i).

In the true geometry directions, arms and overlaps follow from the positions of balls. A load
compresses the cell evenly, by the factor 1 - eps y with eps = W/d and y = (d - a)/W, where a is the
spacing of the lattice in the compressed cell. A contact whose direction on the lattice is e then
has the vector from centre to centre

    w = e + eps v,    v = u_j - u_i - y e

and the overlap

    h = (x_i + x_j)/2 - q,    q = (|w| - 1)/eps,

which the loops over contacts measure (:mod:`granphon.contacts.deformation`). It touches at the
distances |w|/2 -+ eps (x_j - x_i)/4 from the centres, which are the radii less half of the overlap
each; they add up to |w|, so that forces exert no torque on a pair. How it slips is said in
:mod:`granphon.contacts.slips`.

For eps = 0 all this is the linear map of the lattice. The coefficient of Hertz's law is that of the
mean ball in both: its own radii change that of a contact by a part of order eps.

The geometry makes places: configurations of an array, that is, the motion of its balls and where
that leaves the contacts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from granphon.array.options import LARGEST_RATIO, ReducedLoad
from granphon.array.stencils import Motion, Stencils
from granphon.balls.neighbours import contact_frames
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.contacts.grid import find_lattice_grid
from granphon.dynamics.deformation_rows import Row

#: approximate inverse of C^T K C


#: components along a contact's direction on the lattice and the two tangents there, arrays (n_c,
#: L1, ..., Lp); those that balls on a line or in a plane do not have are the number 0.0
_Vector = tuple[Any, Any, Any]
_ZERO: _Vector = (0.0, 0.0, 0.0)
#: stiffness added to each contact in a step of Newton's method, as a fraction of the mean stiffness
#: times the distance from equilibrium: where many contacts are open the others do not make a solid,
#: and without it the step would be unbounded
ADDED_STIFFNESS = 1e-2
#: fraction by which Newton's method may miss a given mean force, with friction or in the true
#: geometry
LOAD_TOLERANCE = 1e-12


class ActingForces(NamedTuple):
    """What the contacts of an array do in a small motion.

    Attributes
    ----------
    stiffness : (n_c, L1, ..., Lp) by which a normal force falls with a loss of overlap.
    forces : (n_c, L1, ..., Lp) normal forces that act, and turn with their contacts; with the sign
        below zero where they are to hold balls against going aside, and not to push them there.
    """

    stiffness: Array
    forces: Array


def require_small(ratio: float) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless the ratio W/d is from zero to
    :data:`LARGEST_RATIO`.
    """
    if not 0.0 <= ratio <= LARGEST_RATIO:
        problem = f"the exact geometry is not simulated of a width of {ratio:.3g} diameters"
        why = (
            "Contacts are those of neighbours on the lattice: of balls that differ much, others"
            " touch"
        )
        raise InputError(problem, why, f"Give a width from zero to {LARGEST_RATIO:g} diameters")


class ExactGeometry:
    """True geometry of an array whose balls are of the mean diameter d: directions, arms and
    overlaps from positions.

    ``ratio`` is eps = W/d. The ``stencils`` say how balls move, with rotations or without; their
    lattice has as many periods as dimensions. ``strain`` (p, p) is that of the cell in units of
    W/d, beside the even one; None if it has none. Raises
    :class:`~granphon.base.errors.InputError` if the ratio is not from zero to
    :data:`LARGEST_RATIO`.
    """

    def __init__(
        self, stencils: Stencils, deviations: Array, ratio: float, strain: Array | None = None
    ) -> None:
        require_small(ratio)
        self.stencils = stencils
        self.ratio = ratio
        self.means = stencils.average_pairs(deviations)
        first = stencils.by_ball(deviations)
        ends = np.stack([first[i] for i, _ in stencils.ends])
        #: (n_c, L1, ..., Lp) half of the difference of the radii of ball j and ball i, in d
        self.uneven = 0.5 * ratio * (self.means - ends)
        self.dimension = stencils.lattice.dimension
        # rows for the relative displacement of two balls: components along the contact's direction
        # on the lattice and its tangents there
        motions = stencils.motions
        p = self.dimension
        frame = contact_frames(stencils.lattice.contacts.normal[:, :p])[:p]
        still = np.zeros((len(motions.rotations), stencils.n_contacts))
        moves = [
            np.concatenate([np.array(axis)[list(motions.translations)], still]).T for axis in frame
        ]
        #: stencils with the vector of :meth:`split`
        self.frame = stencils.observe([Row("push", 1.0, move, move) for move in moves])
        self.strain = strain

    def shear(self, strain: Array) -> _Vector:
        """Return what a ``strain`` (p, p) of the cell, in units of W/d, adds to v: components (n_c,
        1, ..., 1) in the frames of the lattice.
        """
        p = self.dimension
        axes = self.axes()
        components = np.einsum("cka,ab,cb->kc", axes, strain, axes[:, 0])
        return (*(component[(..., *(None,) * p)] for component in components), *_ZERO[p:])

    def place(self, balls: Array, overlap: float) -> ExactPlace:
        """Return the configuration with these motions ``balls`` and the overlap y."""
        return ExactPlace(self, balls, overlap)

    def deform(self, motion: Motion) -> Array:
        """Return the deformations (rows, n_c, L1, ..., Lp) of :attr:`frame`."""
        return self.frame.deformations(motion).reshape(-1, *self.means.shape)

    def split(self, motion: Motion) -> _Vector:
        """Return v in the frames of the lattice."""
        return self.sort(self.deform(motion))

    def sort(self, rows: Array) -> _Vector:
        """Return the vector from the deformations (rows, n_c, L1, ..., Lp) of :attr:`frame`."""
        return (*rows, *_ZERO[len(rows) :])

    def join(self, push: _Vector) -> Array:
        """Return the forces on balls whose work is that of forces on the vector of
        :meth:`split`.
        """
        return self.frame.forces(*self.stack(push))

    def stack(self, push: _Vector) -> Array:
        """Return the forces on the vector as those on the deformations (rows, n_c, L1, ..., Lp) of
        :attr:`frame`.
        """
        parts = push[: self.dimension]
        return np.array([np.broadcast_to(part, self.means.shape) for part in parts])

    def axes(self) -> Array:
        """Return (n_c, p, p) directions of each kind of contact and its tangents on the lattice, as
        rows.
        """
        p = self.dimension
        frames = np.array(contact_frames(self.stencils.lattice.contacts.normal[:, :p]))
        return frames[:p, :p].transpose(2, 0, 1)


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
        from granphon.contacts.deformation import measure_turned  # averages need no Numba

        eps = geometry.ratio
        stencils = geometry.stencils
        p = geometry.dimension
        grid = find_lattice_grid(stencils.shape, stencils.lattice)
        n_contacts = geometry.means.size
        # from the evenly compressed cell, so that no digit of h - y is lost; without a width
        # contacts keep their directions, and lengths are in W
        spacing = 1.0 - eps * overlap
        unit = eps or 1.0
        is_flat = np.full(n_contacts, not eps)
        vector = np.repeat(spacing * grid.vector, grid.n_cells, axis=0)
        displacement = np.zeros((grid.n_balls * grid.n_cells, 3))
        displacement[:, :p] = unit * stencils.displacements(balls).reshape(p, -1).T
        strain = np.zeros((3, 3))
        if geometry.strain is not None:
            strain[:p, :p] = unit / spacing * geometry.strain
        loss = np.empty(n_contacts)
        current = np.empty((n_contacts, 3))
        distance = np.empty(n_contacts)
        measure_turned(*grid.ends, vector, is_flat, displacement, strain, loss, current, distance)
        shape = geometry.means.shape
        by_kind = current[:, :p].reshape(shape[0], -1, p)
        parts = np.einsum("cka,cba->kcb", geometry.axes(), by_kind).reshape(p, *shape)
        self.vector: _Vector = geometry.sort(parts)
        self.size = distance.reshape(shape)
        self.normal = _times(1.0 / self.size, self.vector)
        #: (n_c, L1, ..., Lp) differences h - y
        self.differences = geometry.means - loss.reshape(shape) / unit
        self.overlaps = overlap + self.differences

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

    def pull(self, forces: Array) -> Array:
        """Return the forces on balls (fields, L1, ..., Lp) by normal forces f of contacts."""
        return self.geometry.join(_times(forces, self.normal))

    @property
    def boundary(self) -> float:
        """Size of the cell's boundary, over that with y = 0."""
        return shrink_boundary(self.geometry.ratio, self.overlap, len(self.geometry.stencils.shape))

    def press(self, forces: Array) -> float:
        """Return the force whose work on dy is that of the load: the mean of f n.e over
        contacts.
        """
        return float(np.mean(forces * self.normal[0]))

    def press_sheared(self, forces: Array) -> float:
        """Return the force that the pressure on a cell of any shape stands for: the trace of the
        forces times their arms, over the size of the cell.
        """
        p = len(self.geometry.stencils.shape)
        size = (1.0 - self.geometry.ratio * self.overlap) ** p
        return float(np.mean(forces * self.size)) / size

    def stress(self, forces: Array) -> Array:
        """Return the (p, p) sum over contacts of the force on ball i times w, below zero where
        balls are pressed together.

        It is in units of stiffness times d^2.
        """
        push = _times(-forces, self.normal)
        axes = self.geometry.axes()
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

    def resist(self, rows: Array, acting: ActingForces) -> tuple[Array, Array]:
        """Return what :meth:`respond` does, contact by contact: forces against the small
        deformations of frames, and -df.

        Deformations and forces are (rows, n_c, L1, ..., Lp).
        """
        moved = self.geometry.sort(rows)
        n = self.normal
        loss = _dot(n, moved)
        normal = acting.stiffness * loss
        tilt = _times(self.geometry.ratio / self.size, _subtract(moved, _times(loss, n)))  # dn
        push = _subtract(_times(normal, n), _times(acting.forces, tilt))
        return self.geometry.stack(push), normal


def shrink_boundary(ratio: float, overlap: float, periods: int) -> float:
    """Return the size of a cell's boundary at an ``overlap`` y, over that with y = 0."""
    return (1.0 - ratio * overlap) ** (periods - 1)


class Loaded(Protocol):
    """Configuration of an array: the size of its boundary, and the force of the load by those of
    the contacts.
    """

    @property
    def boundary(self) -> float:
        """Size of the cell's boundary, over that with y = 0."""

    @property
    def press(self) -> Callable[..., float]:
        """The force whose work on dy is that of the load, of the forces of contacts."""


def find_boundary_force(place: Loaded, *forces: Array) -> float:
    """Return the mean contact force f* at which the pressure is the same where the cell keeps its
    size, by normal ``forces`` of contacts, and tangential ones with friction.
    """
    if isinstance(place, ExactPlace) and place.geometry.strain is not None:
        return place.press_sheared(*forces)
    return place.press(*forces) / place.boundary


def find_lack(load: ReducedLoad, place: Loaded, *forces: Array) -> float:
    """Return what the mean contact force lacks to a load; zero at a given overlap.

    ``forces`` are those of :func:`find_boundary_force`.
    """
    if load.overlap is not None:
        return 0.0
    if load.on_boundary:
        return load.force * place.boundary - place.press(*forces)
    return load.force - float(np.mean(forces[0]))


# -- vectors ---------------------------------------------------------------------------------------


def _scale(a: Any, b: Any) -> Any:
    return a * b if isinstance(b, np.ndarray) or b else 0.0


def _times(factor: Any, vector: _Vector) -> _Vector:
    if not isinstance(factor, np.ndarray) and not factor:
        return _ZERO
    return _scale(factor, vector[0]), _scale(factor, vector[1]), _scale(factor, vector[2])


def _add(first: _Vector, second: _Vector) -> _Vector:
    return first[0] + second[0], first[1] + second[1], first[2] + second[2]


def _subtract(first: _Vector, second: _Vector) -> _Vector:
    return first[0] - second[0], first[1] - second[1], first[2] - second[2]


def _product(a: Any, b: Any) -> Any:
    """Return a b, or 0.0 if either is a component that is not there."""
    if isinstance(a, float) and not a:
        return 0.0
    return _scale(a, b)


def _dot(first: _Vector, second: _Vector) -> Any:
    """Return the scalar product of two vectors, given by their components."""
    return (
        _product(first[0], second[0])
        + _product(first[1], second[1])
        + _product(first[2], second[2])
    )
