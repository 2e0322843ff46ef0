"""The compatibility matrix of a large periodic array of balls, as stencils on lattice arrays.

The array is L1 x ... x Lp cells of a lattice with p periods. Motions are arrays (fields, L1, ...,
Lp): for each ball of the cell first the projections of its displacement on p normals of the contact
table, so that many elongations are plain differences; then, if contacts resist them, its rotations.
Deformations of contacts are arrays (rows, L1, ..., Lp): first the elongations of all kinds of
contacts, then their slips, twists and rolls, each stored at the cell of ball i, where the contact
starts. No matrix is stored: C and its transpose are shifts of whole arrays
(:mod:`granphon.contacts.shift_product`). K is the diagonal matrix of the stiffnesses against all
deformations. The inverse of C^T K C for equal contacts, the lattice Green's function, is a product
in Fourier space.
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
from granphon.statics.transforms import find_transform

#: number of elements of one array that are worked on at a time, so that they stay in the
#: processor's cache
_CACHE_ELEMENTS = 2**15
#: numbers of preconditioners on a grid, which have one table with those of the search for rest
OPTIONS = RestOptions()
#: difference of a coefficient of C from a whole number up to which it is rounding
_ROUNDING = 1e-12
#: least sine of the angle between a normal and the space of the normals chosen before, for
#: displacements to be projected on this normal too
_LEAST_SINE = 0.1


class Motion(NamedTuple):
    """Periodic motion ``balls`` (fields, L1, ..., Lp), and ``compression``, which adds to the
    overlap of every contact.
    """

    balls: Array
    compression: float


class Stencils:
    """Compatibility matrix C of an array of ``shape`` (L1, ..., Lp) cells of a lattice; the unit of
    length is the diameter.

    C also has slips, twists or rolls if ``mindlin_ratio`` eta, ``torsion`` or ``bending`` is above
    zero, and then balls have rotations; on a line they have none, and in a plane nothing twists.
    The stiffness against a slip, twist or roll is that number times the normal stiffness k of the
    contact, for ``torsion`` and ``bending`` times k d^2. ``workers`` threads share each Fourier
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
        """Return the class and the arguments from which the stencils are made again when they are
        unpickled. Green's function is large and quickly computed again, and is not pickled.
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
        """(2, rows, fields) coefficients of the motions of all balls of a cell in each deformation:
        first those in the cell of ball j, then those in the cell of ball i.
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
                values = in_space @ to_space  # (n_c, m)
                # whole numbers without rounding, so that motions of the whole deform nothing
                rounded = np.rint(values)
                values = np.where(np.abs(values - rounded) < _ROUNDING, rounded, values)
                for contact, ball in enumerate(balls):
                    fields = slice(m * ball, m * (ball + 1))
                    coefficients[end, number * n + contact, fields] = values[contact]
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
        with several balls in the cell.
        """
        return self.shape if self.n_balls == 1 else (self.n_balls, *self.shape)

    def by_ball(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return ``values`` of :attr:`ball_shape` with the ball of the cell as their first axis,
        (balls, L1, ..., Lp), also if there is only one.
        """
        return values.reshape(self.n_balls, *self.shape)

    def weights(self, stiffness: Array, **ratios: Any) -> Array:
        """Return the stiffnesses (rows, L1, ..., Lp) against all deformations, from the
        ``stiffness`` against elongations (contacts, L1, ..., Lp). If C has elongations alone, the
        result is ``stiffness`` itself.

        The stiffness against a slip, twist or roll is that against elongation times eta, the
        torsion or the bending of the stencils. ``ratios`` by the kind of the deformation ("slip",
        "twist", "roll") take the place of these; each is a number or (contacts, L1, ..., Lp). The
        ratio of a deformation that C does not have is not read.
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
        springs_of_rows = np.split(springs, len(self._rows))
        by_kind = {
            row.kind: row_springs
            for row, row_springs in zip(self._rows, springs_of_rows, strict=True)
        }
        zeros = np.zeros_like(springs[: self.n_contacts])
        return [by_kind.get(kind, zeros) for kind in ("elongation", "slip", "twist", "roll")]

    def strains(self) -> Array:
        """Return the deformations (rows, p, p) of the contacts that start in one cell by each
        component of a displacement gradient, du_a/dx_b = 1, while balls do not rotate.
        """
        return np.concatenate([strain_rows(row, self._vector, self.motions) for row in self._rows])

    # -- C and its transpose -----------------------------------------------------------------------

    def deformations(self, motion: Motion) -> Array:
        """Return the deformations C u (rows, L1, ..., Lp) by a ``motion``: u are the motions of its
        balls. The compression is subtracted from elongations, which are then losses of overlap.
        """
        out = self.operator.deform(motion.balls)
        if motion.compression:
            out[: self.n_contacts] -= motion.compression
        return out

    def forces(self, *tensions: Array) -> Array:
        """Return the forces C^T f (fields, L1, ..., Lp) on balls, in the coordinates of their
        motions, that hold them against the ``tensions`` f; contacts exert the opposite ones. The
        rows of f are given in parts (n, L1, ..., Lp), one after the other.
        """
        return self.operator.pull(*tensions)

    def hessian(self, stiffness: Array) -> ContactHessian:
        """Return the product of C^T K C with motions, where the diagonal of K is ``stiffness``
        (rows, L1, ..., Lp); it is computed in the precision of the stiffness.
        """
        return ContactHessian(self.operator, [stiffness], precision=stiffness.dtype)

    def sum_around(self, contacts: Array) -> Array:
        """Return, for each ball, the sum over its contacts of the values ``contacts`` (contacts,
        L1, ..., Lp), in an array of :attr:`ball_shape`.
        """
        out = np.zeros((self.n_balls, *self.shape), contacts.dtype)
        axes = tuple(range(len(self.shape)))
        for values, shift, (i, j) in zip(contacts, self.shifts, self.ends, strict=True):
            out[i] += values
            out[j] += np.roll(values, shift, axes)  # ball j lies ``shift`` cells ahead of ball i
        return out.reshape(self.ball_shape)

    def average_around(self, contacts: Array) -> Array:
        """Return, for each ball, the mean over its contacts of the values ``contacts`` (contacts,
        L1, ..., Lp), in an array of :attr:`ball_shape`. Open contacts count.
        """
        counts = np.bincount(np.ravel(self.ends), minlength=self.n_balls).astype(float)
        counts_of_balls = counts.reshape(-1, *(1,) * len(self.shape))
        means = self.by_ball(self.sum_around(contacts)) / counts_of_balls
        return np.asarray(means.reshape(self.ball_shape))

    def average_pairs(self, values: Array) -> Array:
        """Return, for each contact, the mean over its two balls of ``values`` of balls: (contacts,
        L1, ..., Lp). ``values`` have :attr:`ball_shape`.
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
        """Return the motions (fields, L1, ..., Lp) with these ``displacements`` (n p, L1, ..., Lp),
        in the coordinates of motions, and these ``rotations`` (n r, L1, ..., Lp), of n balls in a
        cell with p displacements and r rotations each. Without ``rotations`` these are zeros.
        """
        fields = np.zeros((self.n_balls, self.motions.count, *self.shape))
        fields[:, self.motions.translating] = displacements.reshape(self.n_balls, -1, *self.shape)
        if rotations is not None:
            fields[:, self.motions.turning] = rotations.reshape(self.n_balls, -1, *self.shape)
        return fields.reshape(self.n_fields, *self.shape)

    def centre(self, balls: Array) -> Array:
        """Return motions ``balls`` less the mean displacement of all balls, or forces ``balls``
        less the mean force, (fields, L1, ..., Lp): nothing resists translations of the whole array.
        Rotations and torques stay as they are.
        """
        fields = balls.reshape(self.n_balls, self.motions.count, *self.shape).copy()
        translations = fields[:, self.motions.translating]
        translations -= np.mean(translations, axis=(0, *range(2, translations.ndim)), keepdims=True)
        return fields.reshape(balls.shape)

    def list_forces(self, forces: Array) -> Array:
        """Return the forces on balls along the axes of space, (n_balls cells, motions), from
        ``forces`` (fields, L1, ..., Lp) in the coordinates of motions. The line of ball b of cell c
        is b cells + c.
        """
        return self._list(self.basis.T, forces)

    def list_motions(self, motions: Array) -> Array:
        """Return the motions of balls along the axes of space, (n_balls cells, motions), from
        ``motions`` (fields, L1, ..., Lp) in the coordinates of motions; lines are those of
        :meth:`list_forces`.
        """
        return self._list(np.asarray(np.linalg.inv(self.basis), float), motions)

    def gather_forces(self, forces: Array) -> Array:
        """Return the forces (fields, L1, ..., Lp) in the coordinates of motions: the inverse of
        :meth:`list_forces`.
        """
        return self._gather(np.asarray(np.linalg.inv(self.basis).T, float), forces)

    def gather_motions(self, motions: Array) -> Array:
        """Return the motions (fields, L1, ..., Lp) in the coordinates of motions: the inverse of
        :meth:`list_motions`.
        """
        return self._gather(self.basis, motions)

    def _list(self, matrix: Array, fields: Array) -> Array:
        """Return ``fields`` (fields, L1, ..., Lp) with a line for each ball, (n_balls cells,
        motions); ``matrix`` (p, p) multiplies the components of its displacement or force.
        """
        values = fields.reshape(self.n_balls, self.motions.count, -1).copy()
        translating = self.motions.translating
        # the sum over components a, of each ball b of each cell c
        values[:, translating] = np.einsum("ka,bac->bkc", matrix, values[:, translating])
        return values.swapaxes(1, 2).reshape(-1, self.motions.count)

    def _gather(self, matrix: Array, values: Array) -> Array:
        """Return ``values`` (n_balls cells, motions), a line for each ball, as fields (fields, L1,
        ..., Lp); ``matrix`` (p, p) multiplies the components of displacements or forces.
        """
        fields = values.reshape(self.n_balls, -1, self.motions.count).swapaxes(1, 2).copy()
        translating = self.motions.translating
        # the sum over components a, of each ball b of each cell c
        fields[:, translating] = np.einsum("ka,bac->bkc", matrix, fields[:, translating])
        return fields.reshape(self.n_fields, *self.shape)

    # -- solving -----------------------------------------------------------------------------------

    @cached_property
    def _green(self) -> NDArray[Any]:
        """(fields, fields, L1, ..., Lp // 2 + 1) the lattice Green's function: the inverse of C^T K
        C of equal contacts of stiffness one, for each of the waves of a real Fourier transform.

        Entries are zero for translations of the whole array, and for other waves that deform no
        contact: where no ring of contacts is odd, balls can turn like gears, each against its
        neighbours. With one ball in the cell entries are real, as rotations are multiplied by i.
        With several balls they are complex.
        """
        shape = self.shape
        fields = self.n_fields
        is_real = self.n_balls == 1
        counts = (*shape[:-1], shape[-1] // 2 + 1)  # of waves along each axis
        entries = np.zeros((fields, fields, *counts), float if is_real else complex)
        translations = self._project_on_translations()
        # layers of waves along the first axis: one, or as many as have OPTIONS.grid.batch waves
        step = max(1, OPTIONS.grid.batch * counts[0] // math.prod(counts))
        for first in range(0, counts[0], step):
            waves = [np.arange(count) for count in counts]  # numbers of the waves along each axis
            waves[0] = waves[0][first : first + step]
            half_phases = np.meshgrid(
                *(np.pi / length * numbers for length, numbers in zip(shape, waves, strict=True)),
                indexing="ij",
            )
            matrix = self._find_wave_matrices(half_phases)
            # at wave vector zero the matrix is singular: the projection on translations makes it
            # regular, and is its own inverse among translations
            if first == 0:
                matrix[(0,) * len(shape)] += translations
            inverse = invert_hermitian(matrix)
            if first == 0:
                inverse[(0,) * len(shape)] -= translations
            entries[:, :, first : first + step] = np.moveaxis(inverse, (-2, -1), (0, 1))
        if is_real:  # symmetric, to the last digit
            for a, b in combinations(range(fields), 2):
                entries[b, a] = entries[a, b]
        return entries

    @property
    def _ratios(self) -> Array:
        """(rows,) ratio of the stiffness against each deformation to that against elongation."""
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
        """Return the matrices C^T K C (L1, ..., fields, fields) of equal contacts of stiffness one,
        for some waves. They are real if the cell has one ball, as those of :attr:`_green`.

        ``half_phases`` are, for each axis, half of the phases (L1, ...) of the waves from one cell
        to the next along this axis.
        """
        is_real = self.n_balls == 1
        size = (self.n_fields, self.n_fields)
        matrix = np.zeros((*half_phases[0].shape, *size), float if is_real else complex)
        deformations = zip(*self.coefficients, self._ratios, strict=True)
        for number, (head, tail, ratio) in enumerate(deformations):
            shift = self.shifts[number % self.n_contacts]
            # half of the phase from the cell of ball i to that of ball j
            angle: Any = sum(
                steps * half_phase for steps, half_phase in zip(shift, half_phases, strict=True)
            )
            if is_real:
                factors = self._find_real_factors(head, tail, angle)
            else:
                factors = _find_complex_factors(head, tail, angle)
            for a, factor_a in factors.items():
                for b, factor_b in factors.items():
                    matrix[..., a, b] += ratio * np.conj(factor_a) * factor_b
        return matrix

    def _find_real_factors(self, head: Array, tail: Array, angle: Array) -> dict[int, Array]:
        """Return, by the numbers of the fields that deform a contact, its deformation by a wave of
        that field with amplitude one, over i and a phase that all fields share: that of the wave in
        the middle of the contact. The cell has one ball.

        ``head`` and ``tail`` (fields,) are the coefficients of balls j and i in the deformation,
        and ``angle`` (L1, ...) is half of the phase from ball i to ball j. A displacement deforms
        by 2i sin(angle), and so does a rotation in twist and roll. In a slip, where the two
        coefficients are opposite, a rotation deforms by 2 cos(angle): this becomes 2i cos(angle),
        as rotations are multiplied by i.
        """
        sine = 2.0 * np.sin(angle)
        cosine = 2.0 * np.cos(angle)
        is_slip_by_rotation = self.motions.is_rotation & (head == -tail)
        return {
            field: head[field] * (cosine if is_slip_by_rotation[field] else sine)
            for field in _list_moving_fields(head, tail)
        }

    def preconditioner(self, stiffness: Array) -> Callable[[Array], Array]:
        """Return an approximate inverse of C^T K C: a function of a force (fields, L1, ..., Lp)
        that returns the motion (fields, L1, ..., Lp). ``stiffness`` (rows, L1, ..., Lp) is the
        diagonal of K; force and motion have its precision.

        The motion is the sum of two. Green's function of the mean stiffness carries stress across
        the array; the motion of each ball while its neighbours are held takes account of contacts
        that differ. If contacts are nearly alike, it is that by Green's function alone.
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
        """Return Green's function, the pseudo-inverse of C^T K C for contacts of equal
        ``stiffness``: a function of a force (fields, L1, ..., Lp) that returns the motion (fields,
        L1, ..., Lp), both in a ``precision``, single or double. The table of each precision is kept
        for further calls.
        """
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
        transform = find_transform(self.shape, real_type, self.workers)

        def apply(force: NDArray[Any]) -> NDArray[Any]:
            """Return the motion under a ``force``, both (fields, L1, ..., Lp), wave by wave."""
            waves = transform.find_waves(force.reshape(len(force), -1))
            motion = transform.find_fields(multiply_waves(table, softness, waves))
            return motion.reshape(force.shape)

        return apply

    def block_jacobi(self, stiffness: Array) -> Callable[[Array, Array], None]:
        """Return a function of a ``force`` and ``out``, both (fields, L1, ..., Lp), that adds to
        ``out`` the motion of each ball under the force while its neighbours are held.

        The displacement of a ball is found as if it did not rotate, and the rotation as if it did
        not move. ``stiffness`` (rows, L1, ..., Lp) is the diagonal of K.
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
        """Return, for each group of :attr:`_groups`, the group and the inverses (size, size, L1,
        ..., Lp) of the blocks of C^T K C of its fields, with weak springs added; they have the
        precision of the ``stiffness`` (rows, L1, ..., Lp), the diagonal of K.
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
        spring_entries = np.einsum("r,erp->p", spring * self._ratios, products)
        entries += spring_entries.reshape(-1, *(1,) * len(self.shape))
        inverses = []
        first_entries = np.cumsum([len(pairs) for pairs in pairs_of_groups])[:-1]
        triangles = np.split(entries, first_entries)
        for group, triangle in zip(self._groups, triangles, strict=True):
            size = group.stop - group.start
            _invert_symmetric(triangle, size)
            inverses.append((group, _unfold(triangle, size, stiffness.dtype)))
        return inverses

    def _slabs(self) -> Iterator[slice]:
        """Yield slices of layers along the first axis. A slice has one layer, or as many as have
        :data:`_CACHE_ELEMENTS` elements at most: those of all fields together in space, and those
        of one field on a line or in a plane.
        """
        n_fields = self.n_fields if len(self.shape) == 3 else 1
        step = max(1, _CACHE_ELEMENTS // (n_fields * math.prod(self.shape[1:])))
        for first, end in pairwise([*range(0, self.shape[0], step), self.shape[0]]):
            yield slice(first, end)

    @cached_property
    def _groups(self) -> list[slice]:
        """Slices of the fields that the motion of single balls couples: for each ball of the cell
        that of its displacements, and that of its rotations if it has any.
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
    """Return the scalar product of two arrays of one shape, with at most five axes.

    BLAS is not used: its threads wait for each other, and their number changes the last digit.
    """
    axes = "abcde"[: first.ndim]
    return float(np.einsum(f"{axes},{axes}->", first, second))


def number_cells(shape: Sequence[int], shifts: Sequence[Sequence[int]]) -> NDArray[np.intp]:
    """Return the numbers (shifts, cells) of the cells that lie ahead of each cell by each of the
    ``shifts``, p numbers of cells each, in a periodic array of ``shape`` (L1, ..., Lp) cells.
    """
    cells = np.arange(math.prod(shape)).reshape(shape)
    # an array rolled back by a shift has, at each cell, what lies ahead by the shift
    ahead = [np.roll(cells, [-steps for steps in shift], range(cells.ndim)) for shift in shifts]
    return np.stack([numbers.ravel() for numbers in ahead])


def _list_moving_fields(head: Array, tail: Array) -> list[int]:
    """Return the numbers of the fields with a coefficient in a deformation: ``head`` and ``tail``
    (fields,) are those of balls j and of balls i.
    """
    fields: list[int] = np.flatnonzero((head != 0.0) | (tail != 0.0)).tolist()
    return fields


def _find_complex_factors(head: Array, tail: Array, angle: Array) -> dict[int, Array]:
    """Return, by the numbers of the fields that deform a contact, its deformation by a wave of that
    field with the phase zero in the cell of ball i.

    ``head`` and ``tail`` (fields,) are the coefficients of balls j and of balls i in the
    deformation, and ``angle`` (L1, ...) is half of the phase from the cell of ball i to that of
    ball j.
    """
    phase_factor = np.exp(2.0j * angle)
    return {
        field: head[field] * phase_factor - tail[field] for field in _list_moving_fields(head, tail)
    }


def _invert_symmetric(entries: Array, size: int) -> None:
    """Replace symmetric matrices of ``size`` one to three by their inverses; the first axis of
    ``entries`` runs over the upper triangle, row after row.
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


def _unfold(triangle: Array, size: int, precision: DTypeLike) -> NDArray[Any]:
    """Return symmetric matrices (size, size, ...) in a ``precision``; the first axis of
    ``triangle`` (entries, ...) runs over their upper triangle, row after row.
    """
    matrices = np.empty((size, size, *triangle.shape[1:]), precision)
    places = combinations_with_replacement(range(size), 2)
    for entry, (row, column) in zip(triangle, places, strict=True):
        matrices[row, column] = entry
        matrices[column, row] = entry
    return matrices


def _choose_independent(normals: Array) -> Array:
    """Return p independent ones of the ``normals`` (n_c, p), as rows (p, p).

    A normal is chosen if the sine of its angle with the space of those chosen before is above
    :data:`_LEAST_SINE`. The normals of a rigid lattice contain p such normals; of normals that do
    not, fewer are returned.
    """
    p = normals.shape[1]
    basis = np.empty((0, p))
    for normal in normals:
        orthonormal = np.linalg.qr(basis.T)[0].T  # vectors of the space of the normals chosen
        across = normal - (orthonormal @ normal) @ orthonormal
        if len(basis) < p and np.linalg.norm(across) > _LEAST_SINE:
            basis = np.append(basis, [normal], axis=0)
    return basis
