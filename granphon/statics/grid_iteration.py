"""Conjugate gradients for the small motions of balls on a grid, preconditioned in Fourier space.

Where most contacts of an array are closed, its matrix is near that of equal contacts, whose
inverse, the Green's function of the lattice, is a product in Fourier space. It carries forces
across the array. Each ball alone, before and after, takes account of contacts that differ. Some ten
iterations for all right sides at once then take less time than factors.

The method stands once, in :class:`GridIteration`. A class below it brings the operator, which
makes the forces against motions, and the preconditioner, which finds approximate motions under
forces. :class:`TangentIteration` is that of the tangent of a list that is spelled out.

Motions and forces are arrays (f, k, cells) here, of f motions of the balls of a cell and k right
sides: loops and Fourier transforms go through cells that follow each other in memory. The blocks of
the tangent are multiplied as they are; no sparse matrix is made.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls.hertz import LEAST_NORMAL
from granphon.balls.motions import Motions
from granphon.base.arrays import Array
from granphon.base.compiled import compiled
from granphon.contacts.contact_list import ContactList
from granphon.contacts.grid_loops import find_scalar_product
from granphon.contacts.grid_product import (
    GridProduct,
    invert_blocks,
    multiply,
    relax_balls,
    relax_balls_after,
)
from granphon.contacts.tangent import Tangent, find_tangent
from granphon.dynamics.linalg import bound_lowest
from granphon.statics.green import (
    find_table_memory,
    list_phases,
    multiply_waves,
)
from granphon.statics.options import GridOptions
from granphon.statics.transforms import count_waves, find_transform

Values = NDArray[Any]


class GridSolution(NamedTuple):
    """What conjugate gradients have found.

    Attributes
    ----------
    motions, remaining : (n, m, k) motions, and the forces that the motions leave.
    has_arrived : whether the error has fallen as far as it should.
    way_down : (n, m) a motion along which the curvature of the energy is below zero; None if none
        was met.
    iterations : number of iterations, in sum over right sides that are solved one after the other.
    """

    motions: Array
    remaining: Array
    has_arrived: bool
    way_down: Array | None
    iterations: int


class GridIteration(ABC):
    """Conjugate gradients for the small motions of the n balls of a grid, with m motions each,
    under forces.

    A class below this one brings the operator, a symmetric A, and an approximate inverse of it.

    Attributes
    ----------
    level : mean stiffness of contacts, to which rounding refers.
    solves_together : whether all right sides are solved for together, and share transforms. Those
        of a large grid are solved for one after the other, which takes less memory.
    """

    level: float
    solves_together: bool

    @abstractmethod
    def lay_forces(self, forces: Array) -> Array:
        """Return forces (n, m, k) of balls in the order (f, k, cells), in an array of their own and
        in the unit in which the class has forces, such as the mean stiffness.
        """

    @abstractmethod
    def list_forces(self, fields: Array) -> Array:
        """Return forces (f, k, cells), in the unit of the class, in the order (n, m, k) of balls,
        as :meth:`lay_forces` takes them.
        """

    @abstractmethod
    def list_motions(self, fields: Array) -> Array:
        """Return motions (f, k, cells) in the order (n, m, k) of balls."""

    @abstractmethod
    def multiply(self, motions: Array, forces: Array) -> None:
        """Set ``forces`` (f, k, cells) to A times the ``motions`` (f, k, cells)."""

    @abstractmethod
    def find_motions(self, forces: Array) -> Values:
        """Return approximate motions (f, k, cells) under ``forces`` (f, k, cells), in single
        precision.
        """

    @abstractmethod
    def find_way_down(self, search: Array | None) -> Array | None:
        """Return a motion (n, m) along which the curvature of the energy is below zero: the
        direction of a ``search`` (f, cells) along which the curvature seems to be below zero, or,
        if that is None, a motion of a single ball. None if the energy has no curvature below zero,
        so that what seems to be one is rounding.
        """

    def solve(self, forces: Array, reduction: float, most: int, noise: float) -> GridSolution:
        """Return the motions under ``forces`` (n, m, k), of k >= 1 right sides.

        Iterations end where the error of the motions has fallen to the part ``reduction``, and
        after ``most`` of them at the latest. The error is that in the norm of the energy, summed
        over the right sides that are solved together; the preconditioner estimates it. Forces
        below ``noise`` times the mean stiffness are rounding.
        """
        sides = forces.shape[-1]
        if self.solves_together or sides == 1:
            return self._solve_together(forces, reduction, most, noise)
        solutions = [
            self._solve_together(forces[..., side : side + 1], reduction, most, noise)
            for side in range(sides)
        ]
        ways = [solution.way_down for solution in solutions if solution.way_down is not None]
        return GridSolution(
            motions=np.concatenate([solution.motions for solution in solutions], axis=-1),
            remaining=np.concatenate([solution.remaining for solution in solutions], axis=-1),
            has_arrived=all(solution.has_arrived for solution in solutions),
            way_down=ways[0] if ways else None,
            iterations=sum(solution.iterations for solution in solutions),
        )

    def _solve_together(
        self, forces: Array, reduction: float, most: int, noise: float
    ) -> GridSolution:
        """Return the motions under ``forces`` (n, m, k), whose k right sides share each transform;
        the arguments are those of :meth:`solve`.

        Iterations end early where the curvature of the energy is below zero, along a motion of a
        single ball or along a direction of the search. Iterations also end early where nothing
        resists the direction of the search. :meth:`find_way_down` then judges. If the energy has no
        curvature below zero, the forces that are left are rounding, or along motions that cost
        nothing, and the motions have arrived.
        """
        remaining = self.lay_forces(forces)
        motions = np.zeros_like(remaining)
        direction = np.zeros_like(remaining)
        # squares (k,) of the errors of the right sides in the norm of the energy: the products of
        # the forces that are left and the motions that the preconditioner finds under these forces
        squares = np.zeros(remaining.shape[1])
        # what forces of ``noise`` times the mean stiffness on each ball add to the square
        square_of_rounding = noise**2 * self.level * remaining.size
        largest_square = square_of_rounding
        has_arrived = False
        way_down = None
        for count in range(most + 1):
            preconditioned = self.find_motions(remaining)
            last_squares = squares
            squares, least_square, square = multiply_columns(remaining, preconditioned)
            if least_square < 0.0:
                # blocks of single balls are not positive: some ball falls by itself
                way_down = self.find_way_down(None)
                has_arrived = way_down is None
                break
            if count == 0:
                largest_square = max(reduction**2 * square, square_of_rounding)
            has_arrived = square <= largest_square
            if has_arrived or count == most:
                break
            _set_direction(squares, last_squares, preconditioned, direction)
            change = np.empty_like(direction)
            self.multiply(direction, change)
            curvatures, least_curvature, sum_of_curvatures = multiply_columns(direction, change)
            if least_curvature < 0.0 or sum_of_curvatures == 0.0:
                judged_way = self.find_way_down(direction[:, int(np.argmin(curvatures))])
                has_arrived = judged_way is None
                # a direction that nothing resists leads up no more than down
                way_down = judged_way if least_curvature < 0.0 else None
                break
            _step_along(squares, curvatures, direction, change, motions, remaining)
            del preconditioned, change  # the preconditioner needs the memory
        return GridSolution(
            motions=self.list_motions(motions),
            remaining=self.list_forces(remaining),
            has_arrived=has_arrived,
            way_down=way_down,
            iterations=count,
        )

    def precondition(self, forces: Array) -> Array:
        """Return approximate motions (n, m, k) under ``forces`` (n, m, k), with the digits of
        single precision.
        """
        return self.list_motions(self.find_motions(self.lay_forces(forces)).astype(float))


class TangentIteration(GridIteration):
    """Conjugate gradients with the tangent of a list that is a grid.

    Parameters
    ----------
    tangent : of the list, symmetric.
    is_uniform : whether Green's function is that of contacts that are all alike, which is the same
        for all loads and steps, and not that of contacts that have the mean stiffness of their
        kind.
    earlier : a uniform iteration on the same grid, whose Green's function serves; ``is_uniform`` is
        then not asked for.
    options : numbers of the iterations.
    """

    def __init__(
        self,
        tangent: Tangent,
        is_uniform: bool = False,
        earlier: TangentIteration | None = None,
        options: GridOptions | None = None,
    ) -> None:
        contacts = tangent.contacts
        numbers = options or GridOptions()
        self.solves_together = contacts.n_balls <= numbers.small_array
        self._transform = find_transform(contacts.grid, np.dtype(np.float32))
        self._cells = math.prod(contacts.grid)
        self._n_motions = len(contacts.axes)
        # contacts without a stiffness have no level: their forces are zero
        self.level = float(np.mean(contacts.normal_stiffness)) or 1.0
        self._softness = np.float32(1.0 / self.level)
        if earlier is not None:
            product = earlier._product
            green = earlier._green
        else:
            product = GridProduct.of(contacts.i, contacts.j, contacts.grid)
            green = _find_green(contacts, self.level, is_uniform, numbers)
        blocks = tangent.blocks
        forward = blocks.forward
        self._product: GridProduct = product.fill(blocks.diagonal, forward, forward)
        self._coarse = self._product.round()
        self._green: NDArray[Any] = green
        self._alone = np.empty_like(self._coarse.diagonal)
        spring = numbers.spring * self.level
        invert_blocks(self._product.diagonal, spring, numbers.damping, self._alone)

    def multiply(self, motions: Array, forces: Array) -> None:
        """Set ``forces`` to the tangent times the ``motions``, both (f, k, cells)."""
        multiply(self._product, motions, forces)

    def find_way_down(self, search: Array | None) -> Array:
        """Return the ``search`` (f, cells) as a motion (n, m); without one, of all motions of a
        single ball, the others held, that along which the curvature of the energy is lowest.
        """
        if search is not None:
            return self.list_motions(search[:, None])[..., 0]
        blocks = self._product.diagonal
        # the lowest eigenvalue of a block is at most its least entry on the diagonal, and at least
        # its bound: so most balls cannot have the lowest eigenvalue of all
        on_diagonal = np.einsum("aan->an", blocks)
        bounds = bound_lowest(blocks)
        candidates = np.flatnonzero(bounds <= np.min(on_diagonal))
        values, vectors = np.linalg.eigh(np.moveaxis(blocks[:, :, candidates], -1, 0))
        lowest = int(np.argmin(values[:, 0]))
        motion = np.zeros((blocks.shape[2], len(blocks)))
        motion[candidates[lowest]] = vectors[lowest, :, 0]
        return motion

    def find_motions(self, forces: Array) -> Values:
        """Return approximate motions (f, k, cells) under ``forces`` (f, k, cells), in single
        precision: each ball moves as if its neighbours were held, then all by Green's function
        under the forces that are left, then each ball again under those left by then.
        """
        single = forces.astype(np.float32)
        motions = np.empty_like(single)
        remaining = np.empty_like(single)
        relax_balls(self._coarse, self._alone, single, motions, remaining)
        motions += self._apply_green(remaining)
        relax_balls_after(self._coarse, self._alone, single, motions, remaining)
        return motions

    def _apply_green(self, forces: Values) -> Values:
        """Return the motions (f, k, cells) that Green's function makes of forces (f, k, cells)."""
        waves = self._transform.find_waves(forces)
        return self._transform.find_fields(multiply_waves(self._green, self._softness, waves))

    def lay_forces(self, forces: Array) -> Array:
        """Return ``forces`` (n, m, k) in the order (f, k, cells)."""
        return lay(forces, self._cells)

    def list_forces(self, fields: Array) -> Array:
        """Return forces (f, k, cells) in the order (n, m, k)."""
        return list_balls(fields, self._n_motions)

    def list_motions(self, fields: Array) -> Array:
        """Return motions (f, k, cells) in the order (n, m, k)."""
        return list_balls(fields, self._n_motions)


def lay(values: Array, cells: int) -> Array:
    """Return ``values`` (n, m, k) of the balls of an array of ``cells`` cells in the order
    (f, k, cells), in an array of their own.
    """
    by_cell = values.reshape(-1, cells, *values.shape[1:]).transpose(0, 2, 3, 1)
    return np.array(by_cell, order="C").reshape(-1, values.shape[-1], cells)


def list_balls(fields: Array, n_motions: int) -> Array:
    """Return ``fields`` (f, k, cells) in the order (n, m, k) of balls with m = ``n_motions``
    motions each.
    """
    by_ball = fields.reshape(-1, n_motions, *fields.shape[1:])
    return by_ball.transpose(0, 3, 1, 2).reshape(-1, n_motions, fields.shape[1])


def _find_green(
    contacts: ContactList, level: float, is_uniform: bool, options: GridOptions
) -> NDArray[Any]:
    """Return the inverses (f, f, waves) in Fourier space of the tangent of contacts that are equal
    within each kind, with the mean stiffnesses of the kind over ``level``; f are the motions of the
    balls of a cell.

    If ``is_uniform`` is true, all contacts have the normal stiffness one and no other, along the
    directions of the first contact of each kind. Inverses that take at most
    ``options.green_memory`` are kept for further calls.
    """
    shape = contacts.grid
    cells = math.prod(shape)
    kinds = contacts.n_contacts // cells
    step = options.green_step

    def average(values: Array) -> tuple[Any, ...]:
        """Return the means of ``values`` for each kind of contact, flattened and rounded, so that
        those of most samples of a packing are equal.
        """
        # a product sums three columns at once, many times faster than their mean is found
        means = np.ones(cells) @ values.reshape(kinds, cells, -1) / cells
        return tuple((step * np.round(means / step)).ravel().tolist())

    def average_stiffness(values: Array) -> tuple[Any, ...]:
        """Return the mean of the stiffnesses ``values`` (n_c,) for each kind of contact over
        ``level``, rounded so that those of most samples and loads are equal.
        """
        means = np.mean(values.reshape(kinds, cells), axis=1) / level
        # stiffnesses of zero have no logarithm, and stay zero
        n_steps = np.round(np.log(np.maximum(means, LEAST_NORMAL)) / step)
        return tuple(np.where(means > 0.0, np.exp(step * n_steps), 0.0).tolist())

    if is_uniform:
        directions = contacts.normal.reshape(kinds, cells, 3)[:, 0]
        zeros = (0.0,) * kinds
        springs = (zeros, zeros, (1.0,) * kinds, zeros, zeros, zeros)
    else:
        directions = np.array(average(contacts.normal))
        springs = (
            average(contacts.arm_i),
            average(contacts.arm_j),
            average_stiffness(contacts.normal_stiffness),
            average_stiffness(contacts.shear_stiffness),
            average_stiffness(contacts.torsion_stiffness),
            average_stiffness(contacts.bending_stiffness),
        )
    n_fields = contacts.motions.count * contacts.n_balls // cells
    is_kept = find_table_memory(shape, n_fields, np.complex64) <= options.green_memory
    find = _find_equal_green if is_kept else _find_equal_green.__wrapped__
    return find(
        shape,
        options.spring,
        contacts.motions,
        tuple(divmod(ball, cells) for ball in contacts.i[::cells].tolist()),
        tuple(divmod(ball, cells) for ball in contacts.j[::cells].tolist()),
        tuple(directions.ravel().tolist()),
        *springs,
    )


@lru_cache(maxsize=8)
def _find_equal_green(
    shape: tuple[int, ...],
    spring: float,
    motions: Motions,
    ends_i: tuple[tuple[int, int], ...],
    ends_j: tuple[tuple[int, int], ...],
    normal: tuple[float, ...],
    *springs: tuple[float, ...],
) -> NDArray[Any]:
    """Return the inverses (f, f, waves) in Fourier space of the tangent of contacts of these kinds
    on a grid of the ``shape``, in single precision; f are the motions of the balls of a cell, and
    the waves are those of a real transform: about half of all along the last axis.

    ``ends_i`` and ``ends_j`` are the ball of the cell, and the number of the cell, at either end of
    one contact of each kind, and ``normal`` the directions of the kinds, flattened. ``springs`` are
    six tuples with a number for each kind: the arms at i and at j, and the stiffnesses along the
    normal, by shear, torsion and bending. All arguments are hashable, as inverses are kept.

    So that it has an inverse, the tangent is stiffened: each motion of all waves by ``spring``, of
    :class:`GridOptions`, times the mean of the diagonals of the tangents of single contacts, and
    each motion of the wave that moves all cells alike further by this mean itself.
    """
    kinds = len(ends_i)
    m = motions.count
    directions = np.array(normal).reshape(kinds, 3)
    pairs = _find_pair_blocks(motions, directions, springs, len(shape))
    phases = list_phases(shape, [np.arange(count) for count in count_waves(shape)])
    n_fields = m * (1 + max(ball for ball, _ in ends_i + ends_j))
    matrix = np.zeros((*phases[0].shape, n_fields, n_fields), complex)
    for pair, (i, start), (j, end) in zip(pairs, ends_i, ends_j, strict=True):
        # from the cell of ball i to that of ball j, along each axis
        cells = np.subtract(np.unravel_index(end, shape), np.unravel_index(start, shape))
        angle = sum(count * phase for count, phase in zip(cells, phases, strict=True))
        _add_pair(pair, i, j, angle, matrix)
    level = float(np.mean(np.diagonal(pairs, axis1=1, axis2=2).ravel()))
    matrix += spring * level * np.eye(n_fields)
    # nothing resists translations of the whole, which are among the motions of this wave
    matrix[(0,) * len(shape)] += level * np.eye(n_fields)
    inverses = np.linalg.inv(matrix).reshape(-1, n_fields, n_fields)
    table = np.ascontiguousarray(np.moveaxis(inverses, 0, -1).astype(np.complex64))
    table.flags.writeable = False
    return table


def _add_pair(pair: Array, i: int, j: int, angle: Any, matrix: NDArray[Any]) -> None:
    """Add to the ``matrix`` (..., f, f) of all waves the tangent ``pair`` (2 m, 2 m) of a contact
    from ball ``i`` of a cell to ball ``j``, both of m motions; ``angle`` (...), rad, is the phase
    of each wave from the cell of the first to that of the second.
    """
    m = len(pair) // 2
    ahead = np.exp(1j * angle)[..., None, None]
    at_i = slice(m * i, m * (i + 1))
    at_j = slice(m * j, m * (j + 1))
    matrix[..., at_i, at_i] += pair[:m, :m]
    matrix[..., at_i, at_j] += ahead * pair[:m, m:]
    matrix[..., at_j, at_i] += np.conj(ahead) * pair[m:, :m]
    matrix[..., at_j, at_j] += pair[m:, m:]


def _find_pair_blocks(
    motions: Motions, directions: Array, springs: tuple[tuple[float, ...], ...], dimension: int
) -> Array:
    """Return the tangent (kinds, 2 m, 2 m) of each kind of contact between two balls of its own,
    with the m motions of ball i before those of ball j. Contacts have ``directions`` (kinds, 3) and
    the arms and stiffnesses ``springs`` of :func:`_find_equal_green`.
    """
    kinds = len(directions)
    m = motions.count
    arm_i, arm_j, stiffness, shear, torsion, bending = (np.array(values) for values in springs)
    balls = 2 * np.arange(kinds)
    contacts = ContactList(
        n_balls=2 * kinds,
        motions=motions,
        i=balls,
        j=balls + 1,
        vector=directions,
        normal=directions / np.linalg.norm(directions, axis=1)[:, None],
        arm_i=arm_i,
        arm_j=arm_j,
        normal_stiffness=stiffness,
        shear_stiffness=shear,
        torsion_stiffness=torsion,
        bending_stiffness=bending,
        normal_force=np.zeros(kinds),
        measure=1.0,
        dimension=dimension,
    )
    matrix = find_tangent(contacts, np.zeros((0, 3, 3))).matrix.toarray()
    # the blocks on the diagonal: different kinds have no ball in common
    blocks = matrix.reshape(kinds, 2 * m, kinds, 2 * m)
    return np.asarray(blocks[np.arange(kinds), :, np.arange(kinds)])


@compiled
def multiply_columns(one: Array, another: Values) -> tuple[Array, float, float]:
    """Return, for two arrays (f, k, cells), the sums (k,) of the products of their entries for each
    right side, the least of these sums (inf for none), and the sum over all right sides.
    """
    sums = np.zeros(one.shape[1])
    for field in range(len(one)):
        for k in range(one.shape[1]):
            sums[k] += find_scalar_product(one[field, k], another[field, k])
    least = np.inf
    whole = 0.0
    for k in range(len(sums)):
        least = min(least, sums[k])
        whole += sums[k]
    return sums, least, whole


@compiled
def _set_direction(products: Array, last: Array, preconditioned: Values, direction: Values) -> None:
    """Set the search ``direction`` (f, k, cells) of conjugate gradients to the ``preconditioned``
    residual (f, k, cells) plus the direction before times ``products`` over ``last``, the products
    (k,) of residual and preconditioned residual of this step and of the one before. Where a last
    product is zero, as at first, the direction before does not count.
    """
    for field in range(len(direction)):
        for k in range(direction.shape[1]):
            factor = products[k] / last[k] if last[k] > 0.0 else 0.0
            along = direction[field, k]
            added = preconditioned[field, k]
            for cell in range(len(along)):
                along[cell] = factor * along[cell] + added[cell]


@compiled
def _step_along(
    products: Array, curvatures: Array, way: Array, change: Array, motions: Array, remaining: Array
) -> None:
    """Add to ``motions`` the search direction ``way``, and take from ``remaining`` the forces
    ``change`` against it, all (f, k, cells), both times the length at which the energy is least:
    ``products`` over ``curvatures`` (k,), or zero where there is no curvature.
    """
    for field in range(len(way)):
        for k in range(way.shape[1]):
            length = products[k] / curvatures[k] if curvatures[k] > 0.0 else 0.0
            along = way[field, k]
            pushing = change[field, k]
            moved = motions[field, k]
            pull = remaining[field, k]
            for cell in range(len(along)):
                moved[cell] += length * along[cell]
                pull[cell] -= length * pushing[cell]
