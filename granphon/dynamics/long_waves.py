"""Long waves: the compatibility matrix in the limit q -> 0, with rotations and inner motions
relaxed.

Elastic moduli, sound velocities and mechanisms follow from the same rows as the bands; all are in
reduced units.

Terms of finite overlap are of relative order e = delta/d, and so is their effect on sound: the
limit of small overlap is taken before that of long waves. The order of the limits matters for balls
that turn like gears. On a lattice without odd rings gears cost nothing. But where the overlaps of a
ball differ, so do its lever arms, and gears then have an energy of order e^2 and a coupling with
strain of order e. If gears were relaxed, the square of the coupling over the energy would be of
order one: a strain would turn the balls by 1/e times the strain, and the crystal would be soft. But
gears follow a wave only if its frequency is below theirs, about e (k/M)^1/2. That is so at
wavelengths above d/e, hundreds of metres for balls of 8 mm at e = 1e-5. In all shorter waves gears
stay behind, and are an optical wave of their own, as the bands show. So inner motions relax if they
cost an energy of order one or e. Motions that cost no energy to that order do not relax
(:meth:`LongWaves._find_relaxing`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.hertz import MOST_CONTACT_RADIUS
from granphon.balls.lattices import as_direction, one_direction
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, InstabilityError, MechanismError
from granphon.base.progress import Progress, silent
from granphon.base.results import read_only
from granphon.base.validation import finite_array
from granphon.dynamics.compatibility import Compatibility
from granphon.dynamics.deformation_rows import Row, push_rows, strain_rows
from granphon.dynamics.elasticity import (
    decompose_waves,
    find_stress_part,
    find_unstable_strains,
    name_strain,
    name_waves,
    take_voigt,
    voigt_pairs,
)
from granphon.dynamics.iterative_relaxation import IterativeRelaxation
from granphon.dynamics.linalg import (
    MANY_COLUMNS,
    NO_ENERGY,
    cholesky_factor,
    is_independent,
    jacobi_svd,
)
from granphon.dynamics.sparse_relaxation import (
    SparseRelaxation,
    compose_ends,
    find_rounded_columns,
)

#: singular value, over the largest, up to which a deformation costs nothing: that of the softest
#: strain of a mechanism, and that of an inner motion that deforms no contact
_FREE_LIMIT = 1e-12
#: relative difference of the lever arms of a ball up to which the difference is rounding
_ARM_ROUNDING = 1e-14
#: relative difference of the lever arms of a ball up to which different overlaps may be its cause.
#: Overlap over diameter is (contact radius / ball radius)^2, and Hertz's law ends at this value
_LARGEST_ARM_DIFFERENCE = MOST_CONTACT_RADIUS**2
#: part of sound, over its largest possible value, up to which it is rounding: a coupling with free
#: inner motions, a mass that stays behind or moves, a twist of contacts
_SOUND_ROUNDING = 1e-9
#: greatest difference, over the constant c_xxxx, between an elastic tensor and an isotropic one up
#: to which the difference is rounding
_ISOTROPY_ROUNDING = 1e-10
#: largest number of motions of a cell in space that are relaxed by factors: 20,000 balls take 8 GB
MOST_RELAXED_BY_FACTORS = 120_000
#: largest number of motions of a cell in space that are relaxed by factors where iteration finds
#: all that is loose. With 4.3 contacts, little more than the four that hold a ball, iteration takes
#: 1.6 times as long as factors of 2,240 balls, and as long at 4,375; with 7.1 contacts a quarter
MOST_FIRM_RELAXED_BY_FACTORS = 27_000
#: largest number of motions of a cell that are relaxed by dense matrices where gears are to stay
#: behind: 3,072 motions take 20 s and 1.3 GB, by iteration 0.2 s
MOST_DENSE_WITH_GEARS = 3_000
#: largest force over spacing, k, whose products stay within the range of floats
_LARGEST_PRESTRESS = 1e100
#: number of components of directions up to which their long waves are cached
_MOST_CACHED_COMPONENTS = 12
#: largest number of directions whose long waves a lattice caches
_MOST_DIRECTIONS = 256


class _SoundMass(NamedTuple):
    """How inner motions that cost no energy at Gamma change sound.

    Attributes
    ----------
    is_coupled : whether some of these motions take part in sound.
    moving_mass : (n_u, n_u) the mass that sound moves, over all mass: the unit matrix if sound
        moves all mass.
    staying_motions : (k, n_u + n_free) orthonormal motions, as rows, that stay behind: their
        amplitudes in the n_u shifts of all balls, then those in the n_free inner motions that cost
        no energy.
    """

    is_coupled: bool
    moving_mass: Array
    staying_motions: Array


class LongWaves(Compatibility):
    """Elastic moduli and sound velocities of balls in contact on a periodic lattice, in reduced
    units.

    A ball has n_u displacements, the lattice p periods and n_c contacts, and n_rows are the rows of
    all kinds of deformations of all contacts. The n_inner inner motions are mass-weighted: the
    rotations of balls, and the displacements of balls of the cell against each other. In a cell
    whose matrices are sparse (:attr:`_uses_sparse_matrices`) they are the n_branches motions of all
    balls, so that the shifts of all balls are contained; else they are the motions of the frame
    (:attr:`_frame`) but for these shifts.

    Whatever relaxes the inner motions raises the errors of :meth:`relax_inner_motions` too.
    """

    def _deform_uniformly(self, rows: list[Row], root: Array) -> tuple[Array, Array]:
        """Return the deformations ``rows`` at q = 0, multiplied by ``root`` (kinds, n_c): those
        under displacement gradients, (n_rows, n_u p), and those under inner motions,
        (n_rows, n_inner), which are sparse if :attr:`_uses_sparse_matrices`.

        The gradients are u_a,b, in the plane u_x,x u_x,y u_y,x u_y,y.
        """
        vector = self.contacts.vector[:, : self.periods]
        gradients = [strain_rows(row, vector, self.motions) for row in rows]
        affine_deformations = root[..., None] * np.reshape(
            gradients, (*root.shape, self._n_gradients)
        )
        inner, _ = self._find_inner_ends(rows, root)
        return affine_deformations.reshape(root.size, self._n_gradients), inner

    def _find_inner_ends(self, rows: list[Row], root: Array) -> tuple[Any, Any]:
        """Return the difference and the sum, each (n_rows, n_inner), of the effects that inner
        motions have on ``rows`` at the two ends of contacts, multiplied by ``root`` (kinds, n_c).
        Both are sparse if :attr:`_uses_sparse_matrices`.
        """
        if self._uses_sparse_matrices:
            head, tail = compose_ends(self, rows, root)
            return (head - tail).tocsr(), (head + tail).tocsr()
        difference, total = self._combine_ends(rows, root)
        return self._select_inner(difference), self._select_inner(total)

    @cached_property
    def _uses_sparse_matrices(self) -> bool:
        """Whether inner motions are relaxed by sparse matrices: in a cell of many motions, where
        they are faster, unless gears are to stay behind (:attr:`_leaves_gears`) in a cell of up to
        :data:`MOST_DENSE_WITH_GEARS` motions.
        """
        if self.n_branches <= MANY_COLUMNS:
            return False
        if self.n_branches > MOST_DENSE_WITH_GEARS or self._touching_lattice is self:
            return True
        return not self._leaves_gears(self._sparse_relaxation)

    def _leaves_gears(self, relaxation: SparseRelaxation | IterativeRelaxation) -> bool:
        """Whether motions are to stay behind that a ``relaxation`` by sparse matrices relaxes: it
        finds fewer free motions than the :attr:`_touching_lattice` has.

        Sparse matrices relax every motion that deforms contacts, by however little. Gears whose
        lever arms differ within overlaps deform contacts as they turn, but the same turn is free
        in the :attr:`_touching_lattice`, and is to stay behind; dense matrices leave it behind, and
        so does iteration to which the motions are given (:meth:`IterativeRelaxation.keep_back`).
        """
        touching_lattice = self._touching_lattice
        # without such arms no gear costs a little, and gears that are kept back stay behind
        if touching_lattice is self or relaxation.keeps_back:
            return False
        sparse_relaxation = touching_lattice._relaxation
        if sparse_relaxation is not None and not sparse_relaxation.finds_gears:
            return False
        return bool(relaxation.n_free < touching_lattice._free_motions.shape[1])

    def relax_inner_motions(self, progress: Progress = silent) -> None:
        """Make the relaxation of the inner motions, the long work that moduli and sound share, and
        keep it in the lattice. The work is to factorise the matrix of the inner motions, or in a
        large cell in space to prepare an iteration (:attr:`tries_iteration`).

        ``progress`` is told how far the work has come; an iteration keeps it, and tells it of each
        later relaxation too. Nothing is done if the work has been done, if the cell has few
        motions, whose matrices are dense, or if the balls are held.

        Raises :class:`~granphon.base.errors.InputError` for factors that do not fit into memory,
        and for loose motions that an iteration does not find (:attr:`IterativeRelaxation.loose`);
        :class:`~granphon.base.errors.ConvergenceError` for an iteration that does not end.
        """
        is_large = self.n_branches > MANY_COLUMNS
        if is_large and not self.is_held and "_sparse_relaxation" not in vars(self):
            # the cached property gets its value here, because it cannot report progress itself
            vars(self)["_sparse_relaxation"] = self._make_sparse(progress)

    @cached_property
    def _sparse_relaxation(self) -> SparseRelaxation | IterativeRelaxation:
        """The relaxation of all inner motions by sparse factors, or by iteration."""
        return self._make_sparse(silent)

    def _make_sparse(self, progress: Progress) -> SparseRelaxation | IterativeRelaxation:
        """Return a new relaxation of all inner motions: by iteration where this takes less time and
        memory (:meth:`_find_iteration`), or where gears are to stay behind in a cell too large for
        dense matrices, else by sparse factors. ``progress`` is told of the work.
        """
        head, tail = compose_ends(self, *self._weight_rows())
        difference = (head - tail).tocsr()
        iteration = self._find_iteration(difference, progress)
        if iteration is not None:
            return iteration
        relaxation = SparseRelaxation(
            self, difference, (head + tail).tocsr(), _FREE_LIMIT, progress
        )
        if self.n_branches > MOST_DENSE_WITH_GEARS and self._leaves_gears(relaxation):
            iteration = IterativeRelaxation(self, difference, progress)
            return iteration.keep_back(self._touching_lattice._free_motions)
        return relaxation

    def _find_iteration(self, difference: Any, progress: Progress) -> IterativeRelaxation | None:
        """Return the relaxation by iteration of a large cell in space (:attr:`tries_iteration`);
        None where factors are to be made.

        Cells whose factors would not fit into memory are iterated in any case: motions that cost
        nothing in the :attr:`_touching_lattice`, such as gears, then stay behind. Smaller cells are
        iterated only if no motion of several balls costs nothing, or nearly so: factors find such
        motions in less time. The arguments are those of :class:`IterativeRelaxation`.
        """
        if not self.tries_iteration:
            return None
        iteration = IterativeRelaxation(self, difference, progress)
        if not self._is_too_large_for_factors:
            return None if iteration.leaves_loose else iteration
        if self._touching_lattice is not self:
            self._touching_lattice.relax_inner_motions(progress)
        if self._leaves_gears(iteration):
            return iteration.keep_back(self._touching_lattice._free_motions)
        return iteration

    @property
    def tries_iteration(self) -> bool:
        """Whether iteration is tried to relax the inner motions of the cell. A cell whose factors
        would fit into memory is relaxed by factors nevertheless if several of its balls turn out to
        be loose together.
        """
        is_large = self.periods == 3 and self.n_branches > MOST_FIRM_RELAXED_BY_FACTORS
        return is_large and (self._is_too_large_for_factors or self._holds_rotations)

    @property
    def _is_too_large_for_factors(self) -> bool:
        """Whether the factors of the cell would not fit into the memory of most machines, so that
        its inner motions are relaxed by iteration alone.
        """
        return self.periods == 3 and self.n_branches > MOST_RELAXED_BY_FACTORS

    @cached_property
    def _holds_rotations(self) -> bool:
        """Whether contacts that resist slip keep all balls from turning against each other as gears
        do: each set of several balls that such contacts join has an odd ring. True if balls do not
        rotate. What torsion and bending hold does not count.

        To find odd rings, take two copies of a set, and let each contact join a ball of one copy
        with a ball of the other. Without an odd ring the copies fall into two parts; with an odd
        ring they are one part.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        if not self.motions.rotate:
            return True
        table = self.contacts
        count = self.n_balls
        is_joint = np.broadcast_to(self.mindlin_ratio, len(table)) > 0.0
        # springs to the ground, and bodies that do not move, join no balls
        is_joint &= (np.arange(len(table)) < self.n_between) & (table.j < count)
        i = table.i[is_joint]
        j = table.j[is_joint]

        def count_sets(balls_i: Index, balls_j: Index, n_balls: int) -> int:
            """Return the number of sets into which contacts between ``balls_i`` (m,) and
            ``balls_j`` (m,) join ``n_balls`` balls.
            """
            graph = coo_array((np.ones(len(balls_i)), (balls_i, balls_j)), shape=(n_balls, n_balls))
            return int(connected_components(graph, directed=False)[0])

        n_sets = count_sets(i, j, count)
        # ball n of the second copy has the number n + count
        n_parts = count_sets(np.append(i, i + count), np.append(j + count, j), 2 * count)
        n_without_odd_ring = n_parts - n_sets
        # a ball without such a contact is a set without an odd ring, but no gear
        n_single_balls = count - np.unique([i, j]).size
        return n_without_odd_ring == n_single_balls

    @property
    def _relaxation(self) -> SparseRelaxation | IterativeRelaxation | None:
        """The relaxation of the inner motions by sparse matrices; None if matrices are dense."""
        return self._sparse_relaxation if self._uses_sparse_matrices else None

    def _relax_under(self, push: Any) -> SparseRelaxation | IterativeRelaxation:
        """Return the :attr:`_relaxation` of a cell of many balls under static forces, of which the
        sparse ``push`` (n_branches, n_branches) is the form of their energy: motions on which they
        act do not stay behind.
        """
        relaxation = self._sparse_relaxation
        has_limit = self._touching_lattice is not self
        if has_limit and isinstance(relaxation, IterativeRelaxation):
            return relaxation.keep_back(_leave_pushed(relaxation.staying, push))
        return relaxation

    @property
    def _n_gradients(self) -> int:
        """Number of displacement gradients u_a,b: a any displacement of a ball, b along the
        periods.
        """
        return len(self.motions.translations) * self.periods

    def _select_inner(self, columns: Array) -> Array:
        """Return the columns (n_rows, n_inner) of the inner motions from those of all motions of
        the frame, (kinds, n_c, n_branches), of which the shifts of all balls come first.
        """
        return columns.reshape(-1, self.n_branches)[:, len(self.motions.translations) :]

    @cached_property
    def _strain_rows(self) -> tuple[Array, Array]:
        """What :meth:`_deform_uniformly` returns for the rows of K^1/2 C."""
        return self._deform_uniformly(*self._weight_rows())

    @cached_property
    def _inner_sizes(self) -> Array:
        """(n_inner,) lengths that the columns of inner motions would have if the two ends of
        contacts did not cancel each other.

        The column of gears of nearly equal balls is a small difference of both ends. Divided by its
        own length it would be made of rounding, and gears would have a large energy.
        """
        difference, total = self._find_inner_ends(*self._weight_rows())
        return np.asarray(np.linalg.norm(np.hypot(difference, total), axis=0))

    @cached_property
    def _inner_modes(self) -> tuple[Array, Array]:
        """An orthonormal basis (n_rows, n_stiff) of the deformations that inner motions can make,
        and independent inner motions (n_inner, n_free) that deform no contact.
        """
        _, inner = self._strain_rows
        count = inner.shape[1]
        if not count:
            return np.zeros((len(inner), 0)), np.zeros((0, 0))
        size = self._inner_sizes
        # inner motions are the last of all motions: shifts of all balls come first
        is_turn = np.tile(self.motions.is_rotation, self.n_balls)[-count:]
        is_rounding = find_rounded_columns(size, is_turn, _FREE_LIMIT)
        deformations, free_motions, scale = _split_columns(np.where(is_rounding, 0.0, inner), size)
        # combinations of the scaled columns become motions by the division by the scale
        return deformations, free_motions / scale[:, None]

    @cached_property
    def _free_motions(self) -> Array:
        """(n_inner, n_free) orthonormal inner motions that deform no contact. If matrices are
        sparse, they are the ``free`` motions of :attr:`_relaxation`.
        """
        if self._relaxation is not None:
            return self._relaxation.free
        _, inner = self._strain_rows
        size = self._inner_sizes
        if is_independent(inner / np.where(size > 0.0, size, 1.0)):
            return np.zeros((inner.shape[1], 0))
        _, free_motions = self._inner_modes
        return np.linalg.qr(free_motions)[0]

    @cached_property
    def _touching_lattice(self) -> Self:
        """The lattice in the limit of vanishing overlaps, by which free inner motions are
        recognised: no static forces act, and the lever arms of a ball are replaced by their mean if
        they differ by no more than overlaps explain.

        If there is no ball with such arms, the limit is this lattice itself.
        """
        table = self.contacts
        joints = slice(0, self.n_between)  # springs to the ground have no arms
        balls = np.concatenate([table.i[joints], table.j[joints]])
        arms = np.concatenate([table.arm_i[joints], table.arm_j[joints]])
        mean_arm = np.bincount(balls, arms) / np.maximum(np.bincount(balls), 1)
        deviation = np.zeros(len(mean_arm))  # largest deviation from the mean, of each ball
        np.maximum.at(deviation, balls, np.abs(arms - mean_arm[balls]))
        is_evened = (deviation > _ARM_ROUNDING * mean_arm) & (
            deviation <= _LARGEST_ARM_DIFFERENCE * mean_arm
        )
        if not np.any(is_evened):
            return self
        arm_i = table.arm_i.copy()
        arm_j = table.arm_j.copy()
        even_arms = np.where(is_evened[balls], mean_arm[balls], arms)
        arm_i[joints], arm_j[joints] = np.split(even_arms, 2)
        return type(self)(
            self.cell,
            self.positions,
            replace(table, arm_i=read_only(arm_i), arm_j=read_only(arm_j)),
            self.mindlin_ratio,
            stiffness=self.stiffness,
            masses=self.masses,
            gyration=self.gyration,
            torsion=self.torsion,
            bending=self.bending,
            motions=self.named_motions,
            on_site=self.on_site,
            name=self.name,
        )

    def _find_relaxing(self, push: Array | None = None) -> Array:
        """Return an orthonormal basis R (n_inner, n) of the inner motions that relax in a long
        wave: R^T Z = 0, where the columns of Z (n_inner, k) are the motions that stay behind, and
        n = n_inner - k.

        The motions Z deform no contact of the :attr:`_touching_lattice`. If static forces act, of
        which ``push`` P (n_inner, n_inner) is the form of their energy, then Z^T P Z = 0 too. As
        inner motions are mass-weighted, R^T Z = 0 says that inertia does not couple R and Z.
        """
        n_shifts = len(self.motions.translations)
        staying_motions = self._touching_lattice._free_motions
        if self._touching_lattice._uses_sparse_matrices:
            # motions of balls become motions of the frame, of which the shifts of all balls, the
            # first ones, are left out
            in_frame = self._frame.T @ staying_motions.reshape(self.n_balls, -1)
            staying_motions = in_frame.reshape(staying_motions.shape)[n_shifts:]
        if push is not None:
            staying_motions = _leave_pushed(staying_motions, push)
        if not staying_motions.size:
            return np.eye(self.n_branches - n_shifts)
        # Q of the complete decomposition of Z: its first k columns span Z, the others are R
        complete_basis = np.linalg.qr(staying_motions, mode="complete")[0]
        return np.asarray(complete_basis[:, staying_motions.shape[1] :])

    @cached_property
    def _relaxing_deformations(self) -> Array:
        """(n_rows, n) orthonormal basis of the deformations that inner motions can make in a long
        wave.
        """
        if self._touching_lattice is self:
            deformations, _ = self._inner_modes
            return deformations
        _, inner = self._strain_rows
        relaxing_motions = self._find_relaxing()
        size = np.sqrt(self._inner_sizes**2 @ relaxing_motions**2)
        basis, _, _ = _split_columns(inner @ relaxing_motions, size)
        return basis

    def _relax(self, deformations: Array) -> Array:
        """Return the part of the ``deformations`` (n_rows, ...) that remains once the inner motions
        have relaxed.
        """
        if self._relaxation is not None:
            return self._relaxation.relax(deformations)
        basis = self._relaxing_deformations
        amplitudes = np.tensordot(basis.T, deformations, 1)
        return np.asarray(deformations - np.tensordot(basis, amplitudes, 1))

    @cached_property
    def _relaxed_rows(self) -> Array:
        """(n_rows, n_u p) deformations under each displacement gradient, with the inner motions
        relaxed.

        A gradient of a displacement across the periods is a rotation of the whole lattice. Such a
        rotation deforms no contact once the balls turn along, and its column is set to exactly
        zero.
        """
        affine_deformations, _ = self._strain_rows
        relaxed_rows = self._relax(affine_deformations)
        p = self.periods
        return np.where(np.repeat(self._is_across, p), 0.0, relaxed_rows)

    @cached_property
    def _sound_rows(self) -> Array:
        """:attr:`_relaxed_rows`; if matrices are sparse only n_u p rows, (n_u p, n_u p), whose
        columns have the same lengths and products.

        The rounding of products of very long columns would keep plane rotations from making the
        columns orthogonal.
        """
        relaxed_rows = self._relaxed_rows
        if not self._uses_sparse_matrices:
            return relaxed_rows
        return np.asarray(np.linalg.qr(relaxed_rows, mode="r"))

    @property
    def _accuracy(self) -> float:
        """Error of deformations that have relaxed, over the largest. By dense matrices it is below
        :data:`_FREE_LIMIT`, which stands for it.
        """
        return _FREE_LIMIT if self._relaxation is None else self._relaxation.accuracy

    @property
    def _is_across(self) -> NDArray[np.bool_]:
        """(n_u,) whether each displacement is across the periods, so that its gradient turns the
        whole lattice and deforms no contact; all false if springs to the ground resist a motion, as
        they may resist the turn.
        """
        is_across = np.array(self.motions.translations) >= self.periods
        return is_across & (not self.has_springs)

    @cached_property
    def is_twisted_by_sound(self) -> bool:
        """Whether a uniform strain twists contacts that resist torsion, or makes balls roll whose
        contacts resist bending, once the inner motions have relaxed.

        A resistance of zero is not examined: strains of kagome make its balls roll and twist no
        contact, so that it is False with torsion alone, and True with bending.

        If False, the elastic constants are the same at any values above zero of the resistances
        that are above zero. That is so in cells of one ball, and in cells of two that an inversion
        exchanges, as in hcp and diamond.
        """
        relaxed_rows = self._relaxed_rows
        is_turning = [row.kind in ("twist", "roll") for row in self.rows]
        turning = np.abs(relaxed_rows[np.repeat(is_turning, len(self.contacts))])
        largest = np.max(np.abs(relaxed_rows), initial=0.0)
        return bool(np.max(turning, initial=0.0) > _SOUND_ROUNDING * largest)

    @cached_property
    def _sound_mass(self) -> _SoundMass:
        """How inner motions that cost no energy at Gamma, :attr:`_free_motions`, change sound.

        Let u (n_u,) be the amplitudes of the shifts of all balls, mass-weighted, and a (n_free,)
        those of the free motions. Once all other inner motions have relaxed, a wave of small q
        deforms the contacts by i sum_j q_j (S_j u + W_j a), with a matrix S_j (n_rows, n_u) of
        sound and a matrix W_j (n_rows, n_free) of the free motions for each component q_j. The
        energy is the square of this, of second order in q for u and a alike. So there are three
        kinds of free motions:

        - Waves of their own, if u and a are not coupled: S_j^T W_l + S_l^T W_j = 0 for all j and l.
          So are antiphase motions in a cell that contains several smaller cells.
        - Motions (u, a) that stay behind, as they deform nothing: S_j u + W_j a = 0 for all j. A
          ball that touches no other has such motions. If they are orthonormal, the mass that sound
          moves, over all mass, is 1 less the sum of u u^T over these motions.
        - Motions that take part in sound, if amplitudes a that are perpendicular to those of all
          motions that stay behind are still coupled with u.
        """
        if self._touching_lattice is not self:
            return self._touching_lattice._sound_mass
        free_motions = self._free_motions
        n_free = free_motions.shape[1]
        n_u = len(self.motions.translations)
        whole_mass = _SoundMass(
            is_coupled=False,
            moving_mass=np.eye(n_u),
            staying_motions=np.zeros((0, n_u + n_free)),
        )
        if not free_motions.size:
            return whole_mass
        unrelaxed_waves = self._deform_in_wave(free_motions)
        waves = self._relax(unrelaxed_waves)  # W_j, (n_rows, p, n_free)
        sound = self._relaxed_rows.reshape(-1, n_u, self.periods)
        sound = sound.swapaxes(1, 2) / np.sqrt(self.masses.sum())  # S_j, (n_rows, p, n_u)
        # a wave whose deformations relax altogether leaves the rounding of the unrelaxed ones
        largest_coupling = float(np.linalg.norm(sound) * np.linalg.norm(unrelaxed_waves))
        rounding = _SOUND_ROUNDING * largest_coupling
        if not _are_coupled(sound, waves, rounding):
            return whole_mass
        all_waves = np.concatenate([sound, waves], axis=2)
        staying_motions = _find_null(all_waves.reshape(-1, n_u + n_free), limit=self._accuracy)
        staying_shifts = staying_motions[:, :n_u]
        staying_inner = staying_motions[:, n_u:]
        # W_j of the free motions that are perpendicular to those that stay behind
        other_waves = waves @ _find_null(staying_inner, 1.0).T
        mass = np.eye(n_u) - staying_shifts.T @ staying_shifts
        return _SoundMass(
            is_coupled=_are_coupled(sound, other_waves, rounding),
            moving_mass=np.where(np.abs(mass) > _SOUND_ROUNDING, mass, 0.0),
            staying_motions=staying_motions,
        )

    def _deform_in_wave(self, free_motions: Array) -> Array:
        """Return the derivatives (n_rows, p, n_free) with respect to q, at q = 0, of the
        deformations by inner ``free_motions`` (n_inner, n_free), which deform no contact at q = 0.

        The derivatives are divided by i: to first order in q the deformations in sound and in inner
        motions are i times real numbers.
        """
        rows, root = self._weight_rows()
        difference, total = self._find_inner_ends(rows, root)
        half = 0.5 * np.tile(self.contacts.vector[:, : self.periods], (len(rows), 1))
        # the effects of a motion that deforms nothing at any q, such as the spin of a ball between
        # two others, are rounding alone
        effects = abs(difference) + abs(total)
        size = np.sqrt(np.asarray((effects * effects).sum(axis=1)))[:, None]
        change = total @ free_motions
        is_rounding = np.abs(change) <= _FREE_LIMIT * size
        return np.asarray(half[:, :, None] * np.where(is_rounding, 0.0, change)[:, None, :])

    def require_rigid(self) -> None:
        """Raise :class:`~granphon.base.errors.MechanismError` if the lattice has a
        :attr:`mechanism`, and :class:`~granphon.base.errors.InputError` if bodies that do not move,
        or springs to the ground, hold the balls, and if there are no contacts.
        """
        self._require_contacts()
        if self.is_held:
            raise InputError(
                "the balls touch bodies that do not move: a floor, a wall, or a clamped layer",
                "Long waves move all balls together, which these bodies hold",
                "For the waves between them use gp.Phonons(...).bands() or gp.Waves(...), for"
                " velocities the lattice before it was cut, or free edges",
            )
        if self.mechanism:
            mend = "Use a lattice with more contacts"
            if not np.any(self.mindlin_ratio):
                mend = "Use friction, or a lattice with more contacts"
            elif not np.any(self.bending):
                mend = "Use bending, or a lattice with more contacts"
            raise MechanismError(f"the lattice {self.name} is a mechanism", self.mechanism, mend)

    @cached_property
    def mechanism(self) -> str:
        """Words for a motion that costs no energy and takes part in long waves; empty if there is
        none.

        Such a motion is a uniform strain along the periods, or a motion inside the cell that
        couples with sound. A motion that does not couple, such as balls that turn in opposite
        senses in a cell that contains several smaller cells, belongs to another wave vector of the
        smaller cell.
        """
        if self._touching_lattice is not self:
            return self._touching_lattice.mechanism
        can_turn = self.motions.rotate
        if self._sound_mass.is_coupled:
            example = " (as gears do, on a lattice without odd rings)" if can_turn else ""
            return (
                f"The balls of a cell can shift or turn against each other without a cost in"
                f" energy{example}"
            )
        if not self._strains.size:
            return ""
        singular_values, strains = jacobi_svd(self._sound_rows @ self._strains)
        is_soft = singular_values <= self._accuracy * np.max(np.abs(self._strain_rows[0]))
        if not is_soft[0]:
            return ""
        reason = "" if can_turn else "; without friction contacts resist compression only"
        return f"The strain {name_strain(strains[:, is_soft])} costs no energy{reason}"

    @cached_property
    def _strains(self) -> Array:
        """(n_u p, n_strains) displacement gradients, as columns, of the strains xx, yy, xy sqrt 2,
        ... along the periods.

        There are no strains, (n_u p, 0), if balls do not move along some period.
        """
        if not set(range(self.periods)) <= set(self.motions.translations):
            return np.zeros((self._n_gradients, 0))
        translations = self.motions.translations
        strains = []
        for a, b in voigt_pairs(self.periods):
            gradient = np.zeros((len(translations), self.periods))
            weight = 1.0 if a == b else np.sqrt(0.5)
            gradient[translations.index(a), b] = weight
            gradient[translations.index(b), a] = weight
            strains.append(gradient.ravel())
        return np.stack(strains, axis=1)

    def gradient_stiffness(self, prestress: ArrayLike | None = None) -> Array:
        """Return the second derivative of a cell's energy with respect to the displacement
        gradient, with the inner motions relaxed.

        Parameters
        ----------
        prestress : (...) compressive force over spacing, k, the same in every contact; by default
            the forces of the lattice itself.

        Returns
        -------
        (..., n_u, p, n_u, p), d2E / d(u_i,j) d(u_k,l) with the indices i, j, k, l, in units of k
        d^2.

        Raises
        ------
        InputError : ``prestress`` holds no number, or one that is not finite or far too large; or
            the lattice has no contacts.
        InstabilityError : static forces make an inner motion unstable that a gradient moves.
        """
        n_u = len(self.motions.translations)
        p = self.periods
        shape = (n_u, p, n_u, p)
        if prestress is None and not self.is_prestressed:
            relaxed_rows = self._relaxed_rows
            return (relaxed_rows.T @ relaxed_rows).reshape(shape)
        loads = None if prestress is None else _read_prestress(prestress)
        if loads is not None and loads.ndim and self._uses_sparse_matrices:
            # sparse factors belong to one load
            return np.stack([self.gradient_stiffness(load) for load in loads])
        load, push_forms = self._find_load(loads)
        *energy_forms, stress = push_forms
        forms = self._combine_forms(load, energy_forms)
        if self._relaxation is not None:
            relaxed_form = self._relax_under(energy_forms[2]).eliminate(*forms)
        else:
            relaxed_form = self._eliminate(*forms, self._find_relaxing(energy_forms[2]))
        stiffness = np.asarray(relaxed_form.reshape(*relaxed_form.shape[:-2], *shape))
        is_across = self._is_across
        # a gradient of displacements across the periods turns the whole lattice, and costs the work
        # of the static stress alone
        if is_across.any() and not self.lacks_potential:
            stiffness[..., is_across, :, :, :] = 0.0
            stiffness[..., :, :, is_across, :] = 0.0
            for axis in np.flatnonzero(is_across):
                stiffness[..., axis, :, axis, :] = -load * stress
        return stiffness

    def _combine_forms(self, load: Any, push_forms: Sequence[Any]) -> tuple[Any, Any, Any]:
        """Return the forms of :attr:`_spring_forms` less ``load`` times the ``push_forms``: the
        energy forms of two gradients (..., m, m), of an inner motion and a gradient
        (..., n_inner, m), and of two inner motions (..., n_inner, n_inner), of m = n_u p gradients.

        ``load`` and ``push_forms`` are those of :meth:`_find_load`.
        """
        gradients, mixed, inner = self._spring_forms
        push_gradients, push_mixed, push_inner = push_forms
        return (
            gradients - load * push_gradients,
            mixed - load * push_mixed,
            inner - load * push_inner,
        )

    def _eliminate(self, form: Array, mixed: Array, block: Array, relaxing_motions: Array) -> Array:
        """Return the energy forms ``form`` (..., m, m) of gradients, less what the inner
        ``relaxing_motions`` (n_inner, n) save.

        ``mixed`` (..., n_inner, m) are the forms of an inner motion and a gradient, and ``block``
        (..., n_inner, n_inner) those of two inner motions.
        """
        if not relaxing_motions.size:
            return form
        _, pull, inverse = self._find_pulls(form, mixed, block, relaxing_motions)
        return np.asarray(form - pull.swapaxes(-1, -2) @ (inverse[..., None] * pull))

    def _find_pulls(
        self, form: Array, mixed: Array, block: Array, relaxing_motions: Array
    ) -> tuple[Array, Array, Array]:
        """Return combinations (..., n_inner, n) of the inner ``relaxing_motions`` that are not
        coupled with each other, the forces (..., n, m) with which gradients pull on them, and the
        inverse (..., n) of their energies, zero for motions that cost none.

        The arguments are those of :meth:`_eliminate`. Raises
        :class:`~granphon.base.errors.InstabilityError` if a gradient moves an inner motion of
        negative energy.
        """
        energies, vectors = np.linalg.eigh(relaxing_motions.T @ block @ relaxing_motions)
        pull = vectors.swapaxes(-1, -2) @ relaxing_motions.T @ mixed
        # a lattice may have no inner motions
        highest_energy = np.max(np.abs(energies), axis=-1, keepdims=True, initial=0.0)
        # no pull is larger than the root of the product of both energies
        largest_pull = np.sqrt(np.linalg.norm(form, axis=(-2, -1))[..., None] * highest_energy)
        is_moved = np.max(np.abs(pull), axis=-1) > _FREE_LIMIT * largest_pull
        motions = relaxing_motions @ vectors
        self._require_stable_cell(energies, is_moved, motions)
        # energies a little below zero are zero: D lacks the part of static forces that has no
        # potential
        lowest_energy = -max(NO_ENERGY, self.slack) * highest_energy
        is_zero = (energies <= NO_ENERGY * highest_energy) & (energies >= lowest_energy)
        inverse = np.divide(1.0, energies, out=np.zeros_like(energies), where=~is_zero)
        return motions, pull, inverse

    def _require_stable_cell(
        self, energies: Array, is_moved: NDArray[np.bool_], vectors: Array
    ) -> None:
        """Raise :class:`~granphon.base.errors.InstabilityError` if a strain moves an inner motion
        of negative energy.

        ``energies`` (..., n) are those of ``vectors`` (..., n_inner, n), and ``is_moved``
        (..., n) says whether a gradient moves them. A motion that no gradient moves belongs to
        another wave vector of a smaller cell, or is a wave of its own, which the bands show.
        """
        highest_energy = np.max(np.abs(energies), axis=-1, keepdims=True, initial=0.0)
        rounding = max(NO_ENERGY, self.slack) * highest_energy
        is_unstable = is_moved & (energies < -rounding)
        if not np.any(is_unstable):
            return
        # the first columns of the frame are shifts of all balls
        motion_of_frame = np.zeros(self.n_branches)
        first_unstable = vectors.swapaxes(-1, -2)[is_unstable][0]
        motion_of_frame[len(self.motions.translations) :] = first_unstable
        motion = self._frame @ motion_of_frame.reshape(self.n_balls, -1)
        where = f"a squared frequency at {self.name_wavevector(np.zeros(self.periods))} is negative"
        raise self.explain_buckling(where, motion[:, self.motions.translating].T)

    def _find_load(self, prestress: ArrayLike | None) -> tuple[Any, tuple[Array, ...]]:
        """Return a load, a number or (..., 1, 1), and the four forms that the load multiplies:
        those of :meth:`_compute_push_forms`, and the sum (p, p) of f r r/a over the contacts.

        ``prestress`` is that of :meth:`gradient_stiffness`. If it is None, the load is 1, and the
        forms are those of the lattice's own forces f; tangential forces then add to the sum. Raises
        what :func:`_read_prestress` raises.
        """
        if prestress is None:
            rows, root = self._weight_rows(are_static=True)
            vector = self.contacts.vector[:, : self.periods]
            stress = vector.T @ (self.prestress[:, None] * vector)
            if self.has_tangential_force:
                tangential = self.tangential_force[:, : self.periods].T @ vector
                stress = stress + 0.5 * (tangential + tangential.T)
            forms = self._compute_push_forms(rows, self.static_signs * root**2)
            return 1.0, (*forms, stress)
        loads = _read_prestress(prestress)
        factor = loads[..., None, None] if loads.ndim else float(loads)
        return factor, self._uniform_push_forms

    @cached_property
    def _spring_forms(self) -> tuple[Array, Array, Array]:
        """Energy of the springs as three forms: of two gradients (m, m), of an inner motion and a
        gradient (n_inner, m), and of two inner motions (n_inner, n_inner), of m = n_u p gradients.
        """
        affine_deformations, inner = self._strain_rows
        return (
            affine_deformations.T @ affine_deformations,
            inner.T @ affine_deformations,
            inner.T @ inner,
        )

    @cached_property
    def _uniform_push_forms(self) -> tuple[Array, ...]:
        """Energies that a force over spacing of 1 in all contacts contributes, as four forms: of
        two gradients (m, m), of an inner motion and a gradient (n_inner, m), of two inner motions
        (n_inner, n_inner), and the sum (p, p) of r r over the contacts; m = n_u p.
        """
        push = push_rows(self.contacts.normal, self.motions)
        vector = self.contacts.vector[:, : self.periods]
        forms = self._compute_push_forms(push, np.ones((len(push), len(self.contacts))))
        return (*forms, vector.T @ vector)

    def _compute_push_forms(self, rows: list[Row], load: Array) -> tuple[Array, ...]:
        """Return three forms, as those of :attr:`_spring_forms`, of the energy of ``rows`` on which
        static forces act, each weighted by its ``load`` (kinds, n_c).
        """
        affine_deformations, inner = self._deform_uniformly(rows, np.ones(load.shape))
        weight = load.reshape(-1, 1)
        return (
            affine_deformations.T @ (weight * affine_deformations),
            inner.T @ (weight * affine_deformations),
            inner.T @ (inner * weight),
        )

    # -- derivatives -------------------------------------------------------------------------------

    def _list_in_balls(self, amplitudes: Array) -> Array:
        """Return the motions u and w (n_balls, motions, m) of balls from mass-weighted
        ``amplitudes``: (n_inner, m) of inner motions, or in a cell of many balls (n_branches, m) of
        the motions of each ball.
        """
        n_inner, m = amplitudes.shape
        if n_inner == self.n_branches:
            weighted_motions = amplitudes.reshape(self.n_balls, -1)
        else:
            # shifts of all balls, which come first in the frame, are zero
            in_frame = np.zeros((self.n_branches, m))
            in_frame[self.n_branches - n_inner :] = amplitudes
            weighted_motions = self._frame @ in_frame.reshape(self.n_balls, -1)
        motions = weighted_motions / np.sqrt(self.masses)[:, None]
        return motions.reshape(self.n_balls, -1, m)

    @cached_property
    def gradient_motions(self) -> Array:
        """(n_balls, motions, n_u p) motions u and w by which the balls relax under each
        displacement gradient, in addition to their displacements by the gradient itself.

        Raises :class:`~granphon.base.errors.InstabilityError` if a gradient moves an inner motion
        of negative energy.
        """
        if not self.is_prestressed:
            affine_deformations, inner = self._strain_rows
            if self._relaxation is not None:
                return self._list_in_balls(-self._relaxation.find_motions(affine_deformations))
            relaxing_motions = self._find_relaxing()
            columns = inner @ relaxing_motions
            # each column is divided by the length that it would have if nothing cancelled, so that
            # the rounding of small columns, such as those of gears, does not count
            size = np.sqrt(self._inner_sizes**2 @ relaxing_motions**2)
            scale = np.where(size > 0.0, size, 1.0)
            amplitudes = np.linalg.lstsq(columns / scale, affine_deformations, rcond=_FREE_LIMIT)[0]
            return self._list_in_balls(-relaxing_motions @ (amplitudes / scale[:, None]))
        load, (*push_forms, _) = self._find_load(None)
        forms = self._combine_forms(load, push_forms)
        if self._relaxation is not None:
            return self._list_in_balls(-self._relax_under(push_forms[2]).respond(*forms))
        relaxing_motions = self._find_relaxing(push_forms[2])
        motions, pull, inverse = self._find_pulls(*forms, relaxing_motions)
        return self._list_in_balls(-motions @ (inverse[:, None] * pull))

    @cached_property
    def gradient_deformations(self) -> tuple[list[Row], Array]:
        """Rows of all deformations, :attr:`unit_rows`, and the deformations (rows, n_c, n_u, p) of
        contacts under each displacement gradient, with the inner motions relaxed.

        Raises the errors of :meth:`require_rigid`, and
        :class:`~granphon.base.errors.InstabilityError` if a gradient moves an inner motion of
        negative energy.

        The deformations give the derivatives of :meth:`gradient_stiffness`, the energy form of two
        gradients. The derivative with respect to the stiffness of a contact is the product of the
        deformations of that contact under both gradients: the inner motions make the energy least,
        so that their change does not matter. The derivative with respect to a force over the
        distance is minus the product of the displacements across the contact.
        """
        self.require_rigid()
        table = self.contacts
        vector = table.vector[:, : self.periods]
        rows = list(self.unit_rows)
        motions = np.pad(self.gradient_motions, ((0, 1), (0, 0), (0, 0)))
        shape = (len(table), len(self.motions.translations), self.periods)
        deformations = []
        for row in rows:
            # of each contact c under each gradient g: the sums over the motions a of its two balls
            relaxation = np.einsum("ca,cag->cg", row.head, motions[table.j])
            relaxation -= np.einsum("ca,cag->cg", row.tail, motions[table.i])
            affine_deformations = strain_rows(row, vector, self.motions)
            deformations.append(affine_deformations + relaxation.reshape(shape))
        stack = np.array(deformations)
        if self.lacks_potential:
            return rows, stack
        # a gradient of a displacement across the periods turns the whole lattice. No contact
        # deforms, and the work is that of the static stress, for which a row is added
        stack[:, :, self._is_across] = 0.0
        if not self.is_prestressed:
            return rows, stack
        # the balls turn along, so that the row has no coefficients of their motions
        zeros = np.zeros((len(table), self.motions.count))
        for axis in np.flatnonzero(self._is_across):
            push = np.zeros(shape)
            push[:, axis] = vector
            rows.append(Row("push", 1.0, zeros, zeros))
            stack = np.concatenate([stack, push[None]])
        return rows, stack

    @cached_property
    def carried(self) -> Array:
        """(n_balls, n_u, n_u) displacements of each ball in sound, as columns, for a displacement
        of one along each axis: the unit matrix, except for balls that stay behind.
        """
        count = len(self.motions.translations)
        unit = np.broadcast_to(np.eye(count), (self.n_balls, count, count))
        staying_motions = self._sound_mass.staying_motions
        if not len(staying_motions):
            return unit
        # the projection of a displacement of all balls on the motions that stay behind: a shift of
        # all balls, and mass-weighted inner motions
        shifts, inner = np.split(staying_motions.T @ staying_motions[:, :count], [count])
        motions = self._list_in_balls(self._touching_lattice._free_motions @ inner)
        displacements = motions[:, self.motions.translating]
        return np.asarray(unit - shifts - np.sqrt(self.masses.sum()) * displacements)

    def acoustic_tensor(self, direction: ArrayLike, prestress: ArrayLike | None = None) -> Array:
        """Return the acoustic tensor (..., n_u, n_u), k d^2/M: the limit of D/q^2 for small q along
        a ``direction``, with the inner motions relaxed. Its eigenvalues are the squares of the
        sound velocities.

        ``direction`` is (p,), or (n, p), with the result (..., n, n_u, n_u). ``prestress`` (...) is
        that of :meth:`gradient_stiffness`, with the same errors. A direction of another shape, one
        that is not finite, and one of length zero raise
        :class:`~granphon.base.errors.InputError`. Whether the lattice is rigid is not checked
        (:meth:`require_rigid`).
        """
        along = as_direction(direction, self.periods)
        directions = along.reshape(-1, self.periods)
        stiffness = self.gradient_stiffness(prestress)
        # sums over the components j and l of each direction n
        of_all_mass = np.einsum("...ijkl,nj,nl->...nik", stiffness, directions, directions)
        of_all_mass = of_all_mass / self.masses.sum()
        tensors = self.root_mass_ratio @ of_all_mass @ self.root_mass_ratio
        return np.asarray(tensors if along.ndim > 1 else tensors[..., 0, :, :])

    def sound_velocities(
        self, direction: ArrayLike, prestress: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Return the velocities of long waves along ``direction`` (p,) or (n, p), in the order of
        :attr:`wave_names`, under a ``prestress`` (...) as in :meth:`gradient_stiffness`.

        Returns
        -------
        velocities : (..., n_u), d (k/M)^1/2; (..., n, n_u) for directions (n, p).
        polarisations : (..., n_u, n_u), or (..., n, n_u, n_u), unit vectors as columns. If two of
            three velocities are equal, the first vector of the pair is as near to the direction as
            can be. If the direction is perpendicular to the pair, the first vector is as near as
            can be to the axis x, y or z that is farthest from the third vector.

        Both arrays are read-only where the lattice keeps them.

        Raises
        ------
        InputError : bodies that do not move, or springs to the ground, hold the balls; there are no
            contacts; or an argument that :meth:`acoustic_tensor` refuses.
        MechanismError : the lattice has a :attr:`mechanism`.
        InstabilityError : static forces make a squared velocity negative, or an inner motion
            unstable that a gradient moves.
        """
        self.require_rigid()
        along = as_direction(direction, self.periods)
        if prestress is None and not self.is_prestressed:
            if along.size > _MOST_CACHED_COMPONENTS:
                return self._compute_waves(along)
            # every load of every state needs the same few directions
            return self._waves_along(along.shape, tuple(along.ravel().tolist()))
        tensor = self.acoustic_tensor(along, prestress)
        try:
            factor = cholesky_factor(tensor)
        except np.linalg.LinAlgError:
            raise self._explain_unstable_sound(along, tensor) from None
        return decompose_waves(along, factor, self.motions.translations)

    def _explain_unstable_sound(self, along: Array, tensor: Array) -> InstabilityError:
        """Return the error of a lattice whose acoustic ``tensor`` has an eigenvalue below zero; it
        names the direction of the lowest.

        ``tensor`` is (..., n_u, n_u) for a direction ``along`` (p,), or (..., n, n_u, n_u) for n
        directions (n, p).
        """
        squares, vectors = np.linalg.eigh(tensor)  # the squares of velocities
        lowest_place = np.unravel_index(np.argmin(squares[..., 0]), squares.shape[:-1])
        direction = along if along.ndim == 1 else along[lowest_place[-1]]
        components = ", ".join(f"{component:.6g}" for component in direction)
        where = f"a squared sound velocity in direction ({components}) is negative"
        return self.explain_buckling(where, vectors[lowest_place][:, 0])

    def _waves_along(
        self, shape: tuple[int, ...], numbers: tuple[float, ...]
    ) -> tuple[Array, Array]:
        """Return what :meth:`sound_velocities` returns, as read-only arrays, for a few directions
        without prestress; the results are cached.

        The directions are unit vectors of this ``shape``, (p,) or (n, p), with the components
        ``numbers``; both are the key of the cache, which is emptied when it is full. The cache is
        one of the lattice: a cache of the method would keep the lattice, with its factors.
        """
        key = shape, numbers
        if key not in self._cached_waves:
            if len(self._cached_waves) == _MOST_DIRECTIONS:
                self._cached_waves.clear()
            velocities, polarisations = self._compute_waves(np.reshape(numbers, shape))
            self._cached_waves[key] = read_only(velocities), read_only(polarisations)
        return self._cached_waves[key]

    @cached_property
    def _cached_waves(self) -> dict[Any, tuple[Array, Array]]:
        """The results of :meth:`_waves_along`, by the shapes and components of directions."""
        return {}

    def _compute_waves(self, along: Array) -> tuple[Array, Array]:
        """Return the velocities (..., n_u), d (k/M)^1/2, and polarisations (..., n_u, n_u) of sound
        without prestress, in the order of :attr:`wave_names`, along unit vectors ``along``
        (..., p).
        """
        # the factor F (..., n_rows, n_u) of the acoustic tensor F^T F, whose eigenvalues are the
        # squared velocities: the deformations by a wave over the root of the mass that sound moves
        rows = self._sound_rows.reshape(-1, len(self.motions.translations), self.periods)
        factor = np.einsum("rij,...j->...ri", rows, along) @ self.root_mass_ratio
        factor = factor / np.sqrt(self.masses.sum())
        return decompose_waves(along, factor, self.motions.translations)

    @property
    def loose_warnings(self) -> tuple[str, ...]:
        """One sentence about balls that sound leaves behind; empty if there are none."""
        count = len(self.motions.translations)
        missing_parts = count - float(np.trace(self._sound_mass.moving_mass))
        if missing_parts <= _SOUND_ROUNDING:
            return ()
        return (
            f"balls that are not held, {missing_parts / count:.2g} of the mass, have no part in the"
            " moduli, and stay behind in sound waves",
        )

    @cached_property
    def root_mass_ratio(self) -> Array:
        """(n_u, n_u) square root of the ratio of all mass to the mass that sound moves; zero along
        displacements that move no mass.
        """
        mass_parts, vectors = np.linalg.eigh(self._sound_mass.moving_mass)
        inverse = np.zeros_like(mass_parts)
        np.divide(1.0, mass_parts, out=inverse, where=mass_parts > _SOUND_ROUNDING)
        return read_only((vectors * np.sqrt(inverse)) @ vectors.T)

    @cached_property
    def wave_names(self) -> tuple[str, ...]:
        """Names of the n_u long waves. "longitudinal" is the first, if balls move along all
        periods. Then follows "transverse", or "transverse_slow" and "transverse_fast", for the
        other displacements. If balls in a plane leave it, "out_of_plane" is the last.
        """
        return name_waves(self.motions.translations, self.periods)

    @property
    def runs_twist(self) -> bool:
        """Whether a wave of twist runs along the lattice, if contacts resist torsion: the lattice
        is a straight chain whose balls turn about it, and no springs to the ground act.
        """
        turns_about_line = self.periods == 1 and 0 in self.motions.rotations
        is_straight = not np.any(self.contacts.normal[:, 1:])
        return turns_about_line and is_straight and not self.has_springs

    def elastic_tensor(self, prestress: ArrayLike | None = None) -> Array:
        """Return the elastic tensor (..., n, n), the change of stress over strain, in units of k
        d^(2-p).

        Rows and columns are in Voigt order: xx, yy, xy in the plane (n = 3), xx, yy, zz, yz, xz, xy
        in space (n = 6), and xx on a line (n = 1). If no ``prestress`` is given, and the lattice
        has no static forces of its own, the array is read-only, as the lattice keeps it.

        Under ``prestress`` (...), that of :meth:`gradient_stiffness`, the entries are the
        coefficients between Cauchy stress and strain (F. Birch, Phys. Rev. 71, 809, 1947; D. C.
        Wallace, Thermodynamics of Crystals, 1972), so that K and rho v^2 keep their usual relation
        (equation 16 of Velicky and Caroli, 2002).

        Raises
        ------
        InputError : balls do not move along the periods, touch nothing or touch bodies that do not
            move; springs to the ground resist their displacements, or with two or three periods
            their rotations; or a prestress that :meth:`gradient_stiffness` refuses.
        MechanismError : the lattice has a :attr:`mechanism`.
        InstabilityError : under prestress some strain has a modulus below zero, or moves an inner
            motion of negative energy.
        """
        self.require_rigid()
        has_no_prestress = prestress is None and not self.is_prestressed
        if has_no_prestress:
            return self._unstressed_tensor
        return self._find_elasticity(prestress)

    @cached_property
    def _unstressed_tensor(self) -> Array:
        """What :meth:`elastic_tensor` returns without prestress, read-only; it is kept because
        every load of every state asks for it.
        """
        return read_only(self._find_elasticity(None))

    def require_motions_along(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless balls move along all periods, as
        they do under a strain.
        """
        if not set(range(self.periods)) <= set(self.motions.translations):
            raise InputError(
                f"the motions {self.motions.name!r} have no elastic moduli",
                "The balls do not move along the lattice, as a strain moves them",
                "Give motions along the periods, such as 'in_plane'",
            )

    def _find_elasticity(self, prestress: ArrayLike | None) -> Array:
        """Return what :meth:`elastic_tensor` returns, (..., n, n), for a lattice without mechanism;
        with the same errors, except for those of :meth:`require_rigid`.
        """
        p = self.periods
        axes = self.motions.translations
        self.require_motions_along()
        if not self.has_symmetric_stress:
            raise InputError(
                "springs to the ground resist rotations",
                "A turn of the whole then costs energy: stress is not symmetric, nor a function of"
                " strain alone",
                "Use gp.sound_velocities along a direction, or gp.Phonons",
            )
        along = [axes.index(axis) for axis in range(p)]
        stiffness = self.gradient_stiffness(prestress)
        c = stiffness[..., along, :, :, :][..., along, :] / self.measure
        if prestress is None and not self.is_prestressed:
            return take_voigt(c)
        load, push_forms = self._find_load(prestress)
        stress = -load * push_forms[3] / self.measure
        tensor = take_voigt(c) + find_stress_part(stress)
        strains = find_unstable_strains(tensor)
        if strains is not None:
            where = f"the strain {name_strain(strains)} has a modulus below zero"
            raise self.explain_buckling(where, [])
        return tensor

    @property
    def has_symmetric_stress(self) -> bool:
        """Whether stress is symmetric: no springs to the ground act, so that a rotation of the
        whole lattice costs nothing, or the lattice has one period, along which stress is one
        number.
        """
        return not self.has_springs or self.periods == 1

    @cached_property
    def is_isotropic(self) -> bool:
        """Whether the elastic tensor is the same in all directions; False if springs to the ground
        make stress asymmetric. Raises what :meth:`elastic_tensor` raises.
        """
        if not self.has_symmetric_stress:
            return False
        c = self.elastic_tensor()  # also on a line: its errors are those of this property
        p = self.periods
        if p == 1:
            return True
        # the isotropic tensor with the same c_xxxx and c_xxyy
        shear = (c[0, 0] - c[0, 1]) / 2.0
        isotropic = np.diag([c[0, 0]] * p + [shear] * (len(c) - p))
        isotropic[:p, :p][~np.eye(p, dtype=bool)] = c[0, 1]
        largest_difference = np.max(np.abs(c - isotropic))
        return bool(largest_difference <= _ISOTROPY_ROUNDING * c[0, 0])

    def optical_branch(self, direction: ArrayLike | None = None) -> tuple[float, float]:
        """Return omega_0^2, k/M, and c, d^2, of the rotational branch omega^2 = omega_0^2 (1 - c
        q^2) of long waves, for one ball in the cell.

        ``direction`` is a vector (p,) of any length, by default along x. On the triangular lattice
        omega_0^2 = 30 eta k/M and c = d^2/10; equation (15) of Velicky and Caroli (2002) prints
        d^2/20 (see the errata). Static forces are left out.

        Raises :class:`~granphon.base.errors.InputError` if a cell has more than one rotation, or
        none; if there are no contacts; if bodies that do not move, or springs to the ground, hold
        the ball, as long waves of its displacements then have frequencies above zero too; if
        nothing resists the rotation at Gamma, as contacts that resist only rolling do not; and for
        a direction that is not p finite numbers, or zero.
        """
        if self.n_balls != 1 or len(self.motions.rotations) != 1:
            raise InputError(
                "there is no single rotational branch",
                "It is that of one ball in the cell, which turns about one axis",
                "Use a lattice in the plane, with friction and one ball in its cell",
            )
        if self.is_held:
            raise InputError(
                "bodies that do not move, or springs to the ground, hold the ball",
                "The series of the rotational branch is that of a lattice with sound",
                "Use gp.Phonons(...).onset()",
            )
        along = np.eye(self.periods)[0] if direction is None else direction
        distance_ahead = self.contacts.vector[:, : self.periods] @ one_direction(
            along, self.periods
        )
        rows, root = self._weight_rows()
        difference, total = self._combine_ends(rows, root)
        # deformations of contacts by the rotation: the difference of its effects at both ends is
        # multiplied by the cosine of the half angle, and their sum, as in rolling, by the sine. The
        # displacements have a sum alone
        turn = difference[..., self.motions.turning]
        turn_total = total[..., self.motions.turning]
        shift = total[..., self.motions.translating]
        square = float(np.sum(turn**2))
        if square == 0.0:
            raise InputError(
                "the rotational branch begins at zero",
                "Balls that all turn alike deform no contact that has only rolling or twist",
                "Give contacts friction, or use gp.Phonons(...).bands()",
            )
        # the square of the cosine falls by the square of the half angle, and that of the sine rises
        # by it
        change = (turn**2 - turn_total**2) * distance_ahead[:, None] ** 2
        narrowing = float(np.sum(change)) / 4.0
        # coupling with the displacements, which lowers the branch at second order
        coupling = 0.5 * np.sum(turn * shift * distance_ahead[:, None], axis=(0, 1))
        curvature = (narrowing - float(coupling @ coupling) / square) / square
        return square, curvature


def _read_prestress(prestress: ArrayLike) -> Array:
    """Return the compressive forces over spacings ``prestress`` (...), k, as an array.

    Raises :class:`~granphon.base.errors.InputError` for what is no number or array of numbers, for
    an empty array, and for a number that is not finite or larger than :data:`_LARGEST_PRESTRESS`.
    """
    loads = finite_array("prestress", prestress)
    largest = float(np.max(np.abs(loads)))
    if largest > _LARGEST_PRESTRESS:
        raise InputError(
            f"prestress is {largest:.3g}",
            "It is the force of a contact over the spacing and the stiffness, below one for balls"
            " that touch",
        )
    return loads


def _are_coupled(sound: Array, waves: Array, rounding: float) -> bool:
    """Return whether S_j^T W_l + S_l^T W_j has an entry above ``rounding`` for some components j
    and l of q: sound, with the matrices S_j of ``sound`` (n_rows, p, n_u), and motions with the
    matrices W_j of ``waves`` (n_rows, p, n) then share an energy of second order in q. False if
    there are no motions.
    """
    # the sum of both orders of j and l, as q_j q_l is the same for j and l exchanged
    products = np.einsum("rji,rlm->jlim", sound, waves)
    coupling = products + products.swapaxes(0, 1)
    return bool(np.max(np.abs(coupling), initial=0.0) > rounding)


def _leave_pushed(staying_motions: Array, push: Any) -> Array:
    """Return an orthonormal basis (n, m) of those combinations z of orthonormal
    ``staying_motions`` Z (n, k) to which static forces give no energy. ``push`` P (n, n), dense or
    sparse, is the form of the energy of these forces: Z^T P z = 0, but for rounding.
    """
    if not staying_motions.size:
        return staying_motions
    energies, vectors = np.linalg.eigh(staying_motions.T @ (push @ staying_motions))
    is_sparse = hasattr(push, "power")  # NumPy has no norm of a sparse matrix
    norm = np.sqrt(push.power(2).sum()) if is_sparse else np.linalg.norm(push)
    return np.asarray(staying_motions @ vectors[:, np.abs(energies) <= NO_ENERGY * norm])


def _find_null(matrix: Array, size: float = 0.0, limit: float = _FREE_LIMIT) -> Array:
    """Return an orthonormal basis (k, n), as rows, of the vectors that a ``matrix`` (m, n) takes to
    zero, but for rounding: the singular values of these vectors are at most ``limit`` times the
    largest one, or times ``size`` if that is larger.
    """
    # rows of zeros make n singular values also if there are fewer rows than columns
    n_lacking = max(0, matrix.shape[1] - len(matrix))
    padded_matrix = np.pad(matrix, ((0, n_lacking), (0, 0)))
    _, singular_values, right_vectors = np.linalg.svd(padded_matrix, full_matrices=False)
    is_null = singular_values <= limit * np.max(singular_values, initial=size)
    return np.asarray(right_vectors[is_null])


def _split_columns(columns: Array, size: Array) -> tuple[Array, Array, Array]:
    """Return an orthonormal basis (m, rank) of the space of ``columns`` (m, n), an orthonormal
    basis (n, n - rank) of the combinations of the scaled columns that are zero, and the scale (n,)
    of each column.

    A column is divided by its scale, the length ``size`` (n,) that it would have if nothing
    cancelled in it, or one if it is zero.
    """
    scale = np.where(np.any(columns != 0.0, axis=0), size, 1.0)
    # rows of zeros make n singular values also if there are fewer rows than columns
    n_lacking = max(0, columns.shape[1] - len(columns))
    padded_columns = np.pad(columns / scale, ((0, n_lacking), (0, 0)))
    basis, singular_values, right_vectors = np.linalg.svd(padded_columns, full_matrices=False)
    is_free = singular_values <= _FREE_LIMIT * np.max(singular_values, initial=0.0)
    return np.asarray(basis[: len(columns), ~is_free]), np.asarray(right_vectors[is_free].T), scale
