"""The compatibility matrix of a large periodic array of balls, as stencils on lattice arrays.

The array is L1 x ... x Lp cells of a lattice with p periods. Motions are arrays (fields, L1, ...,
Lp): for each ball of the cell first the projections of its displacement on p normals of the contact
table, so that many elongations are plain differences; then, if contacts resist them, its rotations.
Deformations of contacts are arrays (rows, L1, ..., Lp): the elongation of each kind of contact,
then its slips, twist and rolls, stored at the cell of ball i, from which the contact starts. No
matrix is stored: C and its transpose are shifts of whole arrays
(:mod:`granphon.contacts.shift_product`). The inverse of C^T C for equal contacts, the lattice
Green's function, is a product in Fourier space.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from itertools import combinations, combinations_with_replacement, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from granphon.balls.lattices import TRIANGULAR, Lattice
from granphon.balls.motions import default_motions, select_motions
from granphon.base.arrays import Array
from granphon.contacts.shift_product import ContactHessian, ContactOperator
from granphon.dynamics.deformation_rows import contact_rows, strain_rows
from granphon.dynamics.linalg import invert_hermitian
from granphon.statics.green import multiply_waves
from granphon.statics.options import RestOptions

#: number of elements of one array that are worked on at a time, so that they stay in the
#: processor's cache
CACHED = 2**15
#: numbers of preconditioners on a grid, which have one table with those of the search for rest
OPTIONS = RestOptions()
#: difference of a coefficient of C from a whole number that is rounding
_ROUNDED = 1e-12
#: least sine of the angle between a normal and those before it, for displacements to be projected
#: on it
_INDEPENDENT = 0.1


class Motion(NamedTuple):
    """Periodic motion ``balls`` (fields, L1, ..., Lp), and ``compression``, which adds to the
    overlap of every contact.
    """

    balls: Array
    compression: float


class Stencils:
    """Compatibility matrix C of an array of ``shape`` (L1, ..., Lp) cells of a lattice; the unit of
    length is the diameter.

    With a ``mindlin_ratio`` eta, a ``torsion`` or a ``bending`` (over k d^2) above zero, C also has
    slips, twists or rolls, and rotations. The stiffness against a slip, twist or roll is that
    number times the normal stiffness of the contact. ``workers`` threads share each Fourier
    transform.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        mindlin_ratio: float = 0.0,
        workers: int = 1,
        lattice: Lattice = TRIANGULAR,
        torsion: float = 0.0,
        bending: float = 0.0,
    ) -> None:
        self.shape = tuple(shape)
        self.mindlin_ratio = mindlin_ratio
        self.torsion = torsion
        self.bending = bending
        self.workers = workers
        self.lattice = lattice
        table = lattice.contacts
        p = lattice.periods
        normal = table.normal[:, :p]
        self.motions = select_motions(mindlin_ratio, torsion, bending, default_motions(p))
        self.n_contacts = len(table)
        self.n_balls = lattice.n_balls
        self.n_fields = self.n_balls * self.motions.count
        #: indices (i, j) of the balls of the cell that each kind of contact joins
        self.ends = list(zip(table.i.tolist(), table.j.tolist(), strict=True))
        #: number of cells, along each lattice vector, from ball i to ball j of each kind of contact
        self.shifts: list[tuple[int, ...]] = [tuple(steps) for steps in table.shift.tolist()]
        #: (p, p) unit vectors, as rows, on which displacements are projected
        self.basis = _choose_independent(normal)
        #: rows of each kind of deformation: elongation, then slips, twist and rolls
        self._rows = contact_rows(
            normal,
            table.arm_i,
            table.arm_j,
            self.motions,
            slip=mindlin_ratio,
            twist=torsion,
            roll=bending,
        )
        #: (n_c, p) vectors from ball i to ball j of each kind of contact
        self._vector = table.vector[:, :p]
        #: tables of Green's function, by the precision of the motions that they give
        self._green_tables: dict[Any, NDArray[Any]] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickles the stencils without Green's function, which is large and quickly
        computed again.
        """
        return Stencils, (
            self.shape,
            self.mindlin_ratio,
            self.workers,
            self.lattice,
            self.torsion,
            self.bending,
        )

    def forget(self) -> None:
        """Free the memory of Green's function, and of the operator with its buffers; both are
        computed again when they are needed.
        """
        self._green_tables.clear()
        for name in ("_green", "operator"):
            vars(self).pop(name, None)

    @cached_property
    def coefficients(self) -> Array:
        """(2, rows, fields) coefficients in each kind of deformation: first those of the motions
        of ball j, then those of the motions of ball i.
        """
        p = len(self.basis)
        n = self.n_contacts
        m = self.motions.count
        coefficients = np.zeros((2, self.n_rows, self.n_fields))
        to_space = np.eye(m)  # from the coordinates of motions to the axes of space
        to_space[:p, :p] = np.linalg.inv(self.basis)
        balls_i, balls_j = zip(*self.ends, strict=True)
        for number, row in enumerate(self._rows):
            for end, balls, in_space in ((0, balls_j, row.head), (1, balls_i, row.tail)):
                of_contacts = in_space @ to_space
                # whole numbers without rounding, so that motions of the whole deform nothing
                whole = np.rint(of_contacts)
                of_contacts = np.where(np.abs(of_contacts - whole) < _ROUNDED, whole, of_contacts)
                for contact, ball in enumerate(balls):
                    fields = slice(m * ball, m * (ball + 1))
                    coefficients[end, number * n + contact, fields] = of_contacts[contact]
        return coefficients

    @cached_property
    def operator(self) -> ContactOperator:
        """C and its transpose."""
        return ContactOperator(self.shape, self.shifts, *self.coefficients)

    @property
    def n_rows(self) -> int:
        """Number of deformations of the contacts that start in one cell."""
        return len(self._rows) * self.n_contacts

    @property
    def ball_shape(self) -> tuple[int, ...]:
        """Shape of an array with one number for each ball: (L1, ..., Lp), or (balls, L1, ..., Lp)
        of several in the cell.
        """
        return self.shape if self.n_balls == 1 else (self.n_balls, *self.shape)

    def by_ball(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return an array of :attr:`ball_shape` with the ball of the cell as its first axis,
        (balls, L1, ..., Lp).
        """
        return values.reshape(self.n_balls, *self.shape)

    def weights(self, stiffness: Array, **ratios: Any) -> Array:
        """Return the stiffnesses (rows, L1, ..., Lp) against all deformations, from the
        ``stiffness`` against elongations (contacts, L1, ..., Lp).

        A stiffness is that against elongation times the ratio with which the stencils were made:
        eta, the torsion or the bending. ``ratios``, by the name of the deformation ("slip",
        "twist"), take the place of these, each a number or (contacts, L1, ..., Lp); the ratio of a
        deformation that C does not have is not used.
        """
        if self.n_rows == self.n_contacts:
            return stiffness
        return np.concatenate(
            [ratios.get(row.kind, float(row.stiffness)) * stiffness for row in self._rows]
        )

    def sort_springs(self, springs: Array) -> list[Array]:
        """Return four arrays (contacts, L1, ..., Lp), the stiffnesses against elongation, slip,
        twist and roll, from the stiffnesses ``springs`` (rows, L1, ..., Lp) against all
        deformations; zeros for deformations that C does not have. The two slips of a contact in
        space have the same stiffness, and so have its two rolls.
        """
        by_kind = {
            row.kind: of_row
            for row, of_row in zip(self._rows, np.split(springs, len(self._rows)), strict=True)
        }
        zeros = np.zeros_like(springs[: self.n_contacts])
        return [by_kind.get(kind, zeros) for kind in ("elongation", "slip", "twist", "roll")]

    def strains(self) -> Array:
        """Return the deformations (rows, p, p) of the contacts that start in one cell under unit
        displacement gradients u_a,b = du_a/dx_b, without rotation.
        """
        return np.concatenate([strain_rows(row, self._vector, self.motions) for row in self._rows])

    # -- C and its transpose -----------------------------------------------------------------------

    def deformations(self, motion: Motion) -> Array:
        """Return the deformations C u (rows, L1, ..., Lp) by the balls of a ``motion``, with its
        compression subtracted from elongations, which are then losses of overlap.
        """
        out = self.operator.deform(motion.balls)
        if motion.compression:
            out[: self.n_contacts] -= motion.compression
        return out

    def forces(self, *tensions: Array) -> Array:
        """Return the forces C^T f (fields, L1, ..., Lp) on balls, in the coordinates of their
        motions, for tensions f whose rows are given in parts (n, L1, ..., Lp), one after the other.
        """
        return self.operator.pull(*tensions)

    def hessian(self, stiffness: Array) -> ContactHessian:
        """Return the product of C^T K C with motions, where the diagonal of K is ``stiffness``
        (rows, L1, ..., Lp); it is computed in the precision of the stiffness.
        """
        return ContactHessian(self.operator, [stiffness], precision=stiffness.dtype)

    def sum_around(self, contacts: Array) -> Array:
        """Return the sum over the contacts of each ball, an array of :attr:`ball_shape`, of values
        of ``contacts`` (contacts, L1, ..., Lp).
        """
        out = np.zeros((self.n_balls, *self.shape), contacts.dtype)
        axes = tuple(range(len(self.shape)))
        for values, shift, (i, j) in zip(contacts, self.shifts, self.ends, strict=True):
            out[i] += values
            out[j] += np.roll(values, shift, axes)  # ball j lies ``shift`` cells ahead of ball i
        return out.reshape(self.ball_shape)

    def average_around(self, contacts: Array) -> Array:
        """Return the mean over the contacts of each ball, an array of :attr:`ball_shape`, of values
        of ``contacts`` (contacts, L1, ..., Lp).
        """
        counts = np.bincount(np.ravel(self.ends), minlength=self.n_balls).astype(float)
        counts_of_balls = counts.reshape(-1, *(1,) * len(self.shape))
        means = self.by_ball(self.sum_around(contacts)) / counts_of_balls
        return np.asarray(means.reshape(self.ball_shape))

    def average_pairs(self, values: Array) -> Array:
        """Return the mean (contacts, L1, ..., Lp) over the two balls of each contact of ``values``
        of balls, of :attr:`ball_shape`.
        """
        balls = self.by_ball(values)
        axes = tuple(range(len(self.shape)))
        means = []
        for shift, (i, j) in zip(self.shifts, self.ends, strict=True):
            # ball j of a contact lies ``shift`` cells ahead of ball i
            partners = np.roll(balls[j], [-step for step in shift], axes)
            means.append(0.5 * (balls[i] + partners))
        return np.stack(means)

    def displacements(self, balls: Array) -> Array:
        """Return the displacements (p, *ball_shape) along the axes of space, from motions ``balls``
        (fields, L1, ..., Lp).
        """
        from_coordinates = np.asarray(np.linalg.inv(self.basis), float)
        by_ball = balls.reshape(self.n_balls, self.motions.count, *self.shape)
        # the sum over coordinates a of balls b: along each axis k of space
        in_space = np.einsum(
            "ka,ba...->kb...", from_coordinates, by_ball[:, self.motions.translating]
        )
        return np.asarray(in_space.reshape(len(from_coordinates), *self.ball_shape))

    def spread(self, displacements: Array, rotations: Array | None = None) -> Array:
        """Return the motions (fields, L1, ..., Lp) that combine ``displacements`` (n p, L1, ...,
        Lp), in the coordinates of motions, and ``rotations`` (n r, L1, ..., Lp), zeros if None.
        """
        fields = np.zeros((self.n_balls, self.motions.count, *self.shape))
        fields[:, self.motions.translating] = displacements.reshape(self.n_balls, -1, *self.shape)
        if rotations is not None:
            fields[:, self.motions.turning] = rotations.reshape(self.n_balls, -1, *self.shape)
        return fields.reshape(self.n_fields, *self.shape)

    def centre(self, balls: Array) -> Array:
        """Return motions less the mean displacement, or forces less the mean force, (fields, L1,
        ..., Lp): nothing resists translations of the whole array.
        """
        fields = balls.reshape(self.n_balls, self.motions.count, *self.shape).copy()
        moved = fields[:, self.motions.translating]
        moved -= np.mean(moved, axis=(0, *range(2, moved.ndim)), keepdims=True)
        return fields.reshape(balls.shape)

    def list_forces(self, forces: Array) -> Array:
        """Return the forces (n_balls cells, motions) along the axes of space on balls one after
        the other, from ``forces`` (fields, L1, ..., Lp) in the coordinates of motions.
        """
        return self._list(self.basis.T, forces)

    def list_motions(self, motions: Array) -> Array:
        """Return the motions (n_balls cells, motions) along the axes of space of balls one after
        the other, from ``motions`` (fields, L1, ..., Lp) in their coordinates.
        """
        return self._list(np.asarray(np.linalg.inv(self.basis), float), motions)

    def gather_forces(self, forces: Array) -> Array:
        """Return the forces (fields, L1, ..., Lp) in the coordinates of motions, from ``forces``
        (n_balls cells, motions) along the axes of space on balls one after the other.
        """
        return self._gather(np.asarray(np.linalg.inv(self.basis).T, float), forces)

    def gather_motions(self, motions: Array) -> Array:
        """Return the motions (fields, L1, ..., Lp) in their coordinates, from ``motions`` (n_balls
        cells, motions) along the axes of space of balls one after the other.
        """
        return self._gather(self.basis, motions)

    def _list(self, matrix: Array, fields: Array) -> Array:
        """Return the numbers of balls one after the other, (n_balls cells, motions), of the
        ``fields`` (fields, L1, ..., Lp); ``matrix`` (p, p) multiplies those of displacements.
        """
        values = fields.reshape(self.n_balls, self.motions.count, -1).copy()
        moved = self.motions.translating
        # the sum over components a, of each ball b of each cell c
        values[:, moved] = np.einsum("ka,bac->bkc", matrix, values[:, moved])
        return values.swapaxes(1, 2).reshape(-1, self.motions.count)

    def _gather(self, matrix: Array, values: Array) -> Array:
        """Return the fields (fields, L1, ..., Lp) of ``values`` (n_balls cells, motions) of balls
        one after the other; ``matrix`` (p, p) multiplies those of displacements.
        """
        fields = values.reshape(self.n_balls, -1, self.motions.count).swapaxes(1, 2).copy()
        moved = self.motions.translating
        # the sum over components a, of each ball b of each cell c
        fields[:, moved] = np.einsum("ka,bac->bkc", matrix, fields[:, moved])
        return fields.reshape(self.n_fields, *self.shape)

    # -- solving -----------------------------------------------------------------------------------

    @cached_property
    def _green(self) -> NDArray[Any]:
        """The lattice Green's function: the inverse of C^T K C of equal contacts of stiffness one,
        in Fourier space.

        Entries [a][b] over pairs of fields have the shape (L1, ..., Lp/2 + 1) of the waves of real
        arrays. They are zero for translations of the whole array, and for other waves that deform
        no contact: where no ring of contacts is odd, balls can turn like gears, each against its
        neighbours. With one ball in the cell entries are real: rotations are multiplied by i. With
        several they are complex.
        """
        shape = self.shape
        fields = self.n_fields
        real = self.n_balls == 1
        waves = (*shape[:-1], shape[-1] // 2 + 1)
        entries = np.zeros((fields, fields, *waves), float if real else complex)
        still = self._project_on_translations()
        # layers of waves along the first axis, which together have about OPTIONS.grid.batch
        step = max(1, OPTIONS.grid.batch * shape[0] // math.prod(waves))
        for first in range(0, waves[0], step):
            ticks = [np.arange(count) for count in waves]  # numbers of the waves along each axis
            ticks[0] = ticks[0][first : first + step]
            half_phases = np.meshgrid(
                *(np.pi / length * tick for length, tick in zip(shape, ticks, strict=True)),
                indexing="ij",
            )
            matrix = self._find_wave_matrices(half_phases)
            # at wave vector zero the matrix is singular: a projection makes it regular, and is
            # subtracted from the inverse again
            if first == 0:
                matrix[(0,) * len(shape)] += still
            inverse = invert_hermitian(matrix)
            if first == 0:
                inverse[(0,) * len(shape)] -= still
            entries[:, :, first : first + step] = np.moveaxis(inverse, (-2, -1), (0, 1))
        if real:  # symmetric, to the last digit
            for a, b in combinations(range(fields), 2):
                entries[b, a] = entries[a, b]
        return entries

    @property
    def _ratios(self) -> Array:
        """(rows,) stiffnesses against each deformation over that against elongation."""
        return np.repeat([float(row.stiffness) for row in self._rows], self.n_contacts)

    def _project_on_translations(self) -> Array:
        """Return the matrix (fields, fields) that projects motions at wave vector zero on
        translations of the whole array.
        """
        per_ball = self.motions.count
        projection = np.zeros((self.n_fields, self.n_fields))
        is_rotation = np.tile(self.motions.is_rotation, self.n_balls)
        for field in np.flatnonzero(~is_rotation):
            projection[field, field % per_ball :: per_ball] = 1.0 / self.n_balls
        return projection

    def _find_wave_matrices(self, half_phases: Sequence[Array]) -> NDArray[Any]:
        """Return the matrices C^T K C (L1, ..., fields, fields) of equal contacts for waves, with
        the real entries of :attr:`_green` if the cell has one ball.

        ``half_phases`` are, for each axis, half of the phases (L1, ...) of the waves from cell to
        cell.
        """
        real = self.n_balls == 1
        is_rotation = np.tile(self.motions.is_rotation, self.n_balls)
        size = (self.n_fields, self.n_fields)
        matrix = np.zeros((*half_phases[0].shape, *size), float if real else complex)
        deformations = zip(*self.coefficients, self._ratios, strict=True)
        for number, (head, tail, ratio) in enumerate(deformations):
            shift = self.shifts[number % self.n_contacts]
            # half of the phase from the cell of ball i to that of ball j
            angle: Any = sum(
                steps * half_phase for steps, half_phase in zip(shift, half_phases, strict=True)
            )
            moved: list[int] = np.flatnonzero((head != 0.0) | (tail != 0.0)).tolist()
            if real:
                # the deformation about the middle of the contact, by a wave z exp(i q r) of
                # each field, less a common phase. A displacement deforms by 2i sin. A rotation
                # deforms by 2 cos in a slip, which becomes 2i cos as rotations are multiplied
                # by i, and by 2i sin in twist and roll
                sine = 2.0 * np.sin(angle)
                cosine = 2.0 * np.cos(angle)
                factors = {
                    field: head[field]
                    * (cosine if is_rotation[field] and head[field] == -tail[field] else sine)
                    for field in moved
                }
            else:  # the deformation by a wave exp(i q R), R being the site of the cell of a ball
                ahead = np.exp(2.0j * angle)
                factors = {field: head[field] * ahead - tail[field] for field in moved}
            for a, factor_a in factors.items():
                for b, factor_b in factors.items():
                    matrix[..., a, b] += ratio * np.conj(factor_a) * factor_b
        return matrix

    def preconditioner(self, stiffness: Array) -> Callable[[Array], Array]:
        """Return an approximate inverse of C^T K C, a function of a force that returns the motion,
        both (fields, L1, ..., Lp), in the precision of ``stiffness`` (rows, L1, ..., Lp).

        Green's function of the mean stiffness carries stress across the array; the motion of each
        ball while its neighbours are held takes account of contacts that differ. The inverse is the
        sum of both; where contacts are nearly alike, it is Green's function alone.
        """
        normal = stiffness[: self.n_contacts]
        mean = float(np.mean(normal))
        green = self.green_preconditioner(stiffness.dtype, mean)
        if float(np.std(normal)) <= OPTIONS.stiffness_spread * mean:
            return green
        alone = self.block_jacobi(stiffness)

        def add(force: Array) -> Array:
            """Return the sum of both motions under a ``force``."""
            motion = green(force)
            alone(force, motion)
            return motion

        return add

    def green_preconditioner(
        self, precision: DTypeLike, stiffness: float
    ) -> Callable[[NDArray[Any]], NDArray[Any]]:
        """Return the inverse of C^T K C for contacts of equal ``stiffness``, Green's function, as
        a function of a force that returns the motion, both (fields, L1, ..., Lp) in a
        ``precision``. The table of each precision is kept for further calls.
        """
        from scipy import fft  # imported here: media that are not simulated do not need it

        real_type: np.dtype[Any] = np.dtype(precision)
        if real_type not in self._green_tables:
            entries = self._green.astype(np.result_type(real_type, 1j))
            if self.n_balls == 1:  # in the real entries, rotations are multiplied by i
                entries[self.motions.turning] *= 1j
                entries[:, self.motions.turning] *= -1j
            flat = entries.reshape(self.n_fields, self.n_fields, -1)
            flat.flags.writeable = False
            self._green_tables[real_type] = flat
        table = self._green_tables[real_type]
        softness = np.asarray(1.0 / stiffness, real_type)[()]
        axes = tuple(range(1, len(self.shape) + 1))

        def apply(force: NDArray[Any]) -> NDArray[Any]:
            """Return the motion under a ``force``, both (fields, L1, ..., Lp), wave by wave."""
            waves = fft.rfftn(force, axes=axes, workers=self.workers)
            moved = multiply_waves(table, softness, waves)
            return np.asarray(
                fft.irfftn(moved, self.shape, axes=axes, workers=self.workers, overwrite_x=True)
            )

        return apply

    def block_jacobi(self, stiffness: Array) -> Callable[[Array, Array], None]:
        """Return a function of a ``force`` and ``out``, both (fields, L1, ..., Lp), that adds to
        ``out`` the motion of each ball while its neighbours are held.

        Displacements and rotations of a ball do not couple in it. ``stiffness`` (rows, L1, ..., Lp)
        is the diagonal of K.
        """
        inverses = self._invert_blocks(stiffness)
        slabs = list(self._slabs())

        def add(force: Array, out: Array) -> None:
            """Add to ``out`` the motions of single balls under a ``force``, both (fields, L1, ...,
            Lp).
            """
            for layers in slabs:
                for fields, inverse in inverses:
                    # the product of the block (a, b) of each ball with its forces b
                    motion = np.einsum(
                        "ab...,b...->a...", inverse[:, :, layers], force[fields, layers]
                    )
                    out[fields, layers] += motion

        return add

    def _invert_blocks(self, stiffness: Array) -> list[tuple[slice, Array]]:
        """Return, for each group of fields that couple, its slice of the fields and the inverses
        (size, size, L1, ..., Lp) of the blocks of C^T K C of single balls, in the precision of the
        ``stiffness`` (rows, L1, ..., Lp), the diagonal of K.
        """
        # the entries of the upper triangles of all blocks, group after group, row after row
        pairs_of_groups = [
            list(combinations_with_replacement(range(group.start, group.stop), 2))
            for group in self._groups
        ]
        first_fields, second_fields = np.concatenate(pairs_of_groups).T
        ends = np.array([self.operator.head, self.operator.tail])
        products = ends[..., first_fields] * ends[..., second_fields]  # (2, rows, entries)
        # inverted in double precision: where few contacts hold a ball, its block is nearly singular
        entries = self.operator.collect(np.concatenate(products).T, [stiffness]).astype(float)
        # weak springs at all contacts, so that no block is singular: the sum over both ends e and
        # all deformations r
        spring = OPTIONS.grid.spring * float(np.mean(stiffness[: self.n_contacts]))
        held = np.einsum("r,erp->p", spring * self._ratios, products)
        entries += held.reshape(-1, *(1,) * len(self.shape))
        inverses = []
        first_entries = np.cumsum([len(pairs) for pairs in pairs_of_groups])[:-1]
        entries_of_groups = np.split(entries, first_entries)
        for group, pairs, triangle in zip(
            self._groups, pairs_of_groups, entries_of_groups, strict=True
        ):
            size = group.stop - group.start
            _invert_symmetric(triangle, size)
            inverse = np.empty((size, size, *self.shape), stiffness.dtype)
            for entry, (a, b) in zip(triangle, pairs, strict=True):
                row = a - group.start
                column = b - group.start
                inverse[row, column] = entry
                inverse[column, row] = entry
            inverses.append((group, inverse))
        return inverses

    def _slabs(self) -> Iterator[slice]:
        """Yield slices of layers along the first axis, of :data:`CACHED` elements at most where a
        layer has no more: in space in all fields together, on a line or in a plane in each field.
        """
        n_fields = self.n_fields if len(self.shape) == 3 else 1
        step = max(1, CACHED // (n_fields * math.prod(self.shape[1:])))
        for first, end in pairwise([*range(0, self.shape[0], step), self.shape[0]]):
            yield slice(first, end)

    @cached_property
    def _groups(self) -> list[slice]:
        """Slices of the fields that couple in the blocks of single balls: for each ball of the cell
        those of its displacements, and those of its rotations if it has any.
        """
        count = self.motions.count
        n_translations = len(self.motions.translations)
        groups = []
        for first in range(0, self.n_fields, count):
            first_rotation = first + n_translations
            end = first + count
            groups += [slice(first, first_rotation), slice(first_rotation, end)]
        return [group for group in groups if group.start < group.stop]


def dot(first: Array, second: Array) -> float:
    """Return the sum of the products of the elements of two arrays of one shape.

    BLAS is not used: its threads wait for each other, and their number changes the last digit.
    """
    axes = "abcde"[: first.ndim]
    return float(np.einsum(f"{axes},{axes}->", first, second))


def number_cells(shape: Sequence[int], shifts: Sequence[Sequence[int]]) -> NDArray[np.intp]:
    """Return the numbers (shifts, cells) of the cells that lie, from each cell of a periodic array
    of ``shape`` (L1, ..., Lp) cells, ahead by each of the ``shifts``, p numbers of cells.
    """
    cells = np.arange(math.prod(shape)).reshape(shape)
    # an array rolled back by a shift has, at each cell, what lies ahead by the shift
    ahead = [np.roll(cells, [-steps for steps in shift], range(cells.ndim)) for shift in shifts]
    return np.stack([numbers.ravel() for numbers in ahead])


def _invert_symmetric(entries: Array, size: int) -> None:
    """Invert symmetric matrices of ``size`` one to three in place; the first axis of ``entries``
    runs over the upper triangle, row after row.
    """
    if size == 1:
        entries[0] = 1.0 / entries[0]
    elif size == 2:
        xx, xy, yy = entries
        one_over = 1.0 / (xx * yy - xy * xy)
        inverse_xx = yy * one_over
        yy[...] = xx * one_over
        xx[...] = inverse_xx
        xy *= -one_over
    else:
        xx, xy, xz, yy, yz, zz = entries
        cofactors = (
            yy * zz - yz * yz,
            xz * yz - xy * zz,
            xy * yz - xz * yy,
            xx * zz - xz * xz,
            xy * xz - xx * yz,
            xx * yy - xy * xy,
        )
        one_over = 1.0 / (xx * cofactors[0] + xy * cofactors[1] + xz * cofactors[2])
        for entry, cofactor in zip(entries, cofactors, strict=True):
            entry[...] = cofactor * one_over


def _choose_independent(normals: Array) -> Array:
    """Return the first p of the ``normals`` (n_c, p), as rows (p, p), of which each makes an angle
    with the space of those chosen before whose sine is above :data:`_INDEPENDENT`. The normals of a
    rigid lattice contain as many.
    """
    p = normals.shape[1]
    basis = np.empty((0, p))
    for normal in normals:
        chosen = np.linalg.qr(basis.T)[0].T  # orthonormal vectors of the space of those chosen
        across = normal - (chosen @ normal) @ chosen
        if len(basis) < p and np.linalg.norm(across) > _INDEPENDENT:
            basis = np.append(basis, [normal], axis=0)
    return basis
