"""Long waves: the compatibility matrix in the limit q -> 0, with rotations and inner motions
relaxed.

Elastic moduli, sound velocities and mechanisms follow from the same rows as the bands; all are in
reduced units.

Terms of finite overlap are of relative order e = delta/d, and so is their effect on sound: the
limit of small overlap comes before that of long waves. The order of limits matters for balls that
turn like gears. On a lattice without odd rings gears cost nothing; but where overlaps differ, so do
the lever arms of a ball, and gears then have an energy of order e^2 and a coupling with strain of
order e. If gears were relaxed, the square of the coupling over the energy would be of order one: a
strain would turn the balls by 1/e times the strain, and the crystal would be soft. Gears keep up
with sound only if the frequency of sound is below that of gears, about e (k/M)^1/2: at wavelengths
above d/e, hundreds of metres for balls of 8 mm at e = 1e-5. In all shorter waves gears stay behind,
and are an optical wave of their own, as the bands show. So inner motions relax if they cost an
energy of order one or e; motions that cost no energy to that order do not relax
(:meth:`LongWaves._find_relaxing`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.hertz import MOST_CONTACT_RADIUS
from granphon.balls.lattices import as_direction, one_direction
from granphon.base.arrays import Array
from granphon.base.errors import InputError, InstabilityError, MechanismError
from granphon.base.progress import Progress, silent
from granphon.base.results import read_only
from granphon.base.validation import real_array
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
from granphon.dynamics.sparse_relaxation import SparseRelaxation, compose_ends

#: ratio of the softest to the stiffest strain (singular values) below which a lattice is called a
#: mechanism
_SOFT = 1e-12
#: relative difference of the lever arms of a ball up to which it is rounding
_ROUNDED_ARM = 1e-14
#: relative difference of the lever arms of a ball up to which overlaps explain it: that at which
#: Hertz's law ends, as (contact radius / ball radius)^2 is overlap over diameter
_UNEVEN_ARM = MOST_CONTACT_RADIUS**2
#: coupling of free inner motions with sound, over its largest possible value, above which it counts
#: as coupling
_COUPLED = 1e-9
#: greatest difference, over the constant c_xxxx, between elastic constants that are equal in an
#: isotropic lattice; it allows for rounding
_ISOTROPIC = 1e-10
#: most motions of a cell in space that are relaxed by factors: 20,000 balls take 8 GB
MOST_RELAXED_BY_FACTORS = 120_000
#: numbers of directions up to which their long waves are kept
_FEW_NUMBERS = 12


class _SoundMass(NamedTuple):
    """What inner motions that cost no energy at Gamma do to sound.

    Attributes
    ----------
    couples : whether some of these motions take part in sound.
    moved : (n_u, n_u) part of the mass that sound moves, 1 of all mass.
    idle : (k, n_u + n_free) motions, as rows, that stay behind: their shifts of all balls, and
        their parts of the inner motions that cost no energy.
    """

    couples: bool
    moved: Array
    idle: Array


class LongWaves(Compatibility):
    """Elastic moduli and sound velocities of balls in contact on a periodic lattice, in reduced
    units.
    """

    def _deform_uniformly(self, rows: list[Row], root: Array) -> tuple[Array, Array]:
        """Return the deformations ``rows`` at q = 0, times ``root`` (kinds, n_c), under
        displacement gradients and under inner motions.

        Their shapes are (n_rows, n_u p), for the gradients u_a,b (in the plane u_x,x u_x,y u_y,x
        u_y,y), and (n_rows, n_inner). Inner motions are rotations, and the shifts of several balls
        in the cell.
        """
        vector = self.contacts.vector[:, : self.periods]
        gradients = [strain_rows(row, vector, self.motions) for row in rows]
        affine = root[..., None] * np.reshape(gradients, (*root.shape, self._n_gradients))
        inner = self._find_inner_ends(rows, root)[0]
        return affine.reshape(root.size, self._n_gradients), inner

    def _find_inner_ends(self, rows: list[Row], root: Array) -> tuple[Any, Any]:
        """Return the difference and the sum of the effects of inner motions on ``rows``, times
        ``root`` (kinds, n_c), at both ends of contacts, (n_rows, n_inner).

        In a cell of many balls they are sparse, and those of all motions of each ball, the shift of
        all balls among them.
        """
        if self._uses_sparse_matrices:
            head, tail = compose_ends(self, rows, root)
            return (head - tail).tocsr(), (head + tail).tocsr()
        difference, total = self._combine_ends(rows, root)
        return self._select_inner(difference), self._select_inner(total)

    @cached_property
    def _uses_sparse_matrices(self) -> bool:
        """Whether inner motions are relaxed by sparse matrices: in a cell of many motions, where
        they are faster, unless they find fewer free motions than the :attr:`_touching` lattice has.

        Sparse matrices relax every motion that deforms contacts, by however little. Gears whose
        lever arms differ within overlaps deform contacts as they turn, but the same turn is free
        in the :attr:`_touching` lattice, and is to stay behind; dense matrices leave it behind.
        """
        if self.n_branches <= MANY_COLUMNS:
            return False
        if self._touching is self:
            return True
        n_free = self._sparse.free.shape[1]
        return bool(n_free >= self._touching._free.shape[1])

    def relax_inner_motions(self, progress: Progress = silent) -> None:
        """Factorise the matrix of the inner motions, the long work that moduli and sound share, and
        report how far it has come; the lattice keeps the factors.

        Nothing is done in a cell of few motions, whose matrices are dense, and where bodies that do
        not move hold the balls.
        """
        is_large = self.n_branches > MANY_COLUMNS
        if is_large and not self.is_held and "_sparse" not in vars(self):
            # the value of the cached property, with reports
            vars(self)["_sparse"] = self._make_sparse(progress)

    @cached_property
    def _sparse(self) -> SparseRelaxation | IterativeRelaxation:
        """The relaxation of all inner motions by sparse factors, or by iteration."""
        return self._make_sparse(silent)

    def _make_sparse(self, progress: Progress) -> SparseRelaxation | IterativeRelaxation:
        head, tail = compose_ends(self, *self._weight_rows())
        if self.periods == 3 and self.n_branches > MOST_RELAXED_BY_FACTORS:
            return IterativeRelaxation(self, (head - tail).tocsr(), progress)
        return SparseRelaxation(self, (head - tail).tocsr(), (head + tail).tocsr(), _SOFT, progress)

    @property
    def _relaxation(self) -> SparseRelaxation | IterativeRelaxation | None:
        """The relaxation of many inner motions; None where matrices are dense."""
        return self._sparse if self._uses_sparse_matrices else None

    @property
    def _n_gradients(self) -> int:
        """Number of displacement gradients u_a,b: a any displacement of a ball, b along the
        periods.
        """
        return len(self.motions.translations) * self.periods

    def _select_inner(self, columns: Array) -> Array:
        """Return the columns (n_rows, n_inner) of inner motions, from all columns (kinds, n_c,
        n_branches).
        """
        return columns.reshape(-1, self.n_branches)[:, len(self.motions.translations) :]

    @cached_property
    def _strain_rows(self) -> tuple[Array, Array]:
        """:meth:`_deform_uniformly` of K^1/2 C."""
        return self._deform_uniformly(*self._weight_rows())

    @cached_property
    def _inner_sizes(self) -> Array:
        """(n_inner,) lengths that the columns of inner motions would have if nothing cancelled
        between the ends of contacts.

        Gears of nearly equal balls may be almost one column, whose length is a small difference.
        Divided by this length, the column would have large rounding, and gears a large energy.
        """
        difference, total = self._find_inner_ends(*self._weight_rows())
        return np.asarray(np.linalg.norm(np.hypot(difference, total), axis=0))

    @cached_property
    def _inner_modes(self) -> tuple[Array, Array]:
        """An orthonormal basis (n_rows, n_stiff) of the deformations that inner motions can make,
        and the inner motions (n_inner, n_free) that deform no contact.

        Inner motions are rotations, and the shifts of several balls in the cell.
        """
        _, inner = self._strain_rows
        count = inner.shape[1]
        if not count:
            return np.zeros((len(inner), 0)), np.zeros((0, 0))
        size = self._inner_sizes
        # a column that is only rounding, compared with others of its kind, belongs to a motion that
        # deforms nothing. Inner motions are the last of all motions: shifts of all balls come first
        is_turn = np.tile(self.motions.is_rotation, self.n_balls)[-count:]
        largest_turn = np.max(size, where=is_turn, initial=0.0)
        largest_shift = np.max(size, where=~is_turn, initial=0.0)
        is_rounding = size <= _SOFT * np.where(is_turn, largest_turn, largest_shift)
        deformations, free, scale = _split_columns(np.where(is_rounding, 0.0, inner), size)
        return deformations, free / scale[:, None]

    @cached_property
    def _free(self) -> Array:
        """(n_inner, n_free) orthonormal inner motions that deform no contact; Cholesky's factors
        tell if there are none.
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
    def _touching(self) -> Self:
        """The lattice as overlaps vanish, as far as it tells which inner motions are free: each
        ball whose lever arms differ by no more than overlaps explain has one lever arm.

        It is this lattice itself if there is no such ball.
        """
        table = self.contacts
        between = slice(0, self.n_between)  # springs to the ground have no arms
        balls = np.concatenate([table.i[between], table.j[between]])
        arms = np.concatenate([table.arm_i[between], table.arm_j[between]])
        mean = np.bincount(balls, arms) / np.maximum(np.bincount(balls), 1)
        deviation = np.zeros(len(mean))  # the largest of each ball
        np.maximum.at(deviation, balls, np.abs(arms - mean[balls]))
        is_evened = (deviation > _ROUNDED_ARM * mean) & (deviation <= _UNEVEN_ARM * mean)
        if not np.any(is_evened):
            return self
        arm_i = table.arm_i.copy()
        arm_j = table.arm_j.copy()
        evened = np.where(is_evened[balls], mean[balls], arms)
        arm_i[between], arm_j[between] = np.split(evened, 2)
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
        """Return an orthonormal basis (n_inner, n) of the inner motions that relax in a long wave.

        Inner motions that stay behind deform no contact of the :attr:`_touching` lattice, and
        static forces do not act on them: their energy under static forces is the form ``push``
        (n_inner, n_inner). Inner motions are in mass-weighted coordinates, so that the two kinds
        are not coupled by inertia.
        """
        n_shifts = len(self.motions.translations)
        idle = self._touching._free
        if self._touching._uses_sparse_matrices:
            # from motions of balls to those of the frame, of which the first are shifts of all
            in_frame = self._frame.T @ idle.reshape(self.n_balls, -1)
            idle = in_frame.reshape(idle.shape)[n_shifts:]
        if push is not None and idle.size:
            energies, vectors = np.linalg.eigh(idle.T @ push @ idle)
            is_unpushed = np.abs(energies) <= NO_ENERGY * np.linalg.norm(push)
            idle = idle @ vectors[:, is_unpushed]
        if not idle.size:
            return np.eye(self.n_branches - n_shifts)
        complete_basis = np.linalg.qr(idle, mode="complete")[0]
        return np.asarray(complete_basis[:, idle.shape[1] :])

    @cached_property
    def _relaxing(self) -> Array:
        """(n_rows, n) orthonormal basis of the deformations that inner motions can make in a long
        wave.
        """
        if self._touching is self:
            deformations, _ = self._inner_modes
            return deformations
        _, inner = self._strain_rows
        relaxing = self._find_relaxing()
        size = np.sqrt(self._inner_sizes**2 @ relaxing**2)
        basis, _, _ = _split_columns(inner @ relaxing, size)
        return basis

    def _relax(self, rows: Array) -> Array:
        """Return the part of deformations (n_rows, ...) that remains once the inner motions have
        relaxed.
        """
        if self._relaxation is not None:
            return self._relaxation.relax(rows)
        basis = self._relaxing
        amplitudes = np.tensordot(basis.T, rows, 1)
        return np.asarray(rows - np.tensordot(basis, amplitudes, 1))

    @cached_property
    def _relaxed_rows(self) -> Array:
        """(n_rows, n_u p) deformations under each displacement gradient, with the inner motions
        relaxed.

        A gradient of a displacement across the periods is a rotation of the whole lattice, which
        deforms no contact once the balls turn along: its column is exactly zero.
        """
        affine, _ = self._strain_rows
        relaxed = self._relax(affine)
        p = self.periods
        return np.where(np.repeat(self._is_across, p), 0.0, relaxed)

    @cached_property
    def _sound_rows(self) -> Array:
        """:attr:`_relaxed_rows`, or of a large cell a few rows (n_u p, n_u p) with the same lengths
        and products of columns.

        Products of very long columns are rounded too much to be made orthogonal by rotations.
        """
        relaxed = self._relaxed_rows
        if not self._uses_sparse_matrices:
            return relaxed
        return np.asarray(np.linalg.qr(relaxed, mode="r"))

    @property
    def _is_across(self) -> NDArray[np.bool_]:
        """(n_u,) whether each displacement is across the periods, so that its gradient turns the
        whole lattice and costs nothing; none where springs to the ground resist rotations.
        """
        is_across = np.array(self.motions.translations) >= self.periods
        return is_across & (self.on_site is None)

    @cached_property
    def is_twisted_by_sound(self) -> bool:
        """Whether a uniform strain twists contacts, or makes balls roll, once the inner motions
        have relaxed.

        If not, the elastic constants are the same at any torsion and bending above zero. So it is
        in cells of one ball, and where inversion exchanges both balls, as in hcp and diamond.
        """
        relaxed = self._relaxed_rows
        is_turning = [row.kind in ("twist", "roll") for row in self.rows]
        turning = np.abs(relaxed[np.repeat(is_turning, len(self.contacts))])
        largest = np.max(np.abs(relaxed), initial=0.0)
        return bool(np.max(turning, initial=0.0) > _COUPLED * largest)

    @cached_property
    def _sound_mass(self) -> _SoundMass:
        """What inner motions that cost no energy at Gamma, :attr:`_free`, do to sound.

        In a wave, the energy of such motions is of second order in q, as that of sound is. Motions
        that do not couple with sound to second order are separate waves; antiphase motions in a
        cell that holds several smaller cells never couple. Motions that deform nothing to second
        order stay behind, as a ball that touches no other: the part that they have of the shift of
        all balls is missing from the mass.
        """
        if self._touching is not self:
            return self._touching._sound_mass
        free = self._free
        count = len(self.motions.translations)
        none_idle = np.zeros((0, count + free.shape[1]))
        all_moves = _SoundMass(couples=False, moved=np.eye(count), idle=none_idle)
        if not free.size:
            return all_moves
        unrelaxed = self._deform_in_wave(free)
        waves = self._relax(unrelaxed)
        sound = self._relaxed_rows.reshape(-1, count, self.periods)
        # a wave that relaxes altogether leaves the rounding of the unrelaxed wave
        rounding = _COUPLED * np.linalg.norm(sound) * np.linalg.norm(unrelaxed)

        def couple(waves: Array) -> bool:
            """Return whether ``waves`` (n_rows, p, n) couple with sound to second order in q."""
            products = np.einsum("rij,rlm->ijlm", sound, waves)
            # q_j q_l is the same for j and l exchanged
            coupling = products + products.swapaxes(1, 2)
            return bool(np.max(np.abs(coupling), initial=0.0) > rounding)

        if not couple(waves):
            return all_moves
        # sound per root of mass, as inner motions are
        weighted_sound = sound.swapaxes(1, 2) / np.sqrt(self.masses.sum())
        all_waves = np.concatenate([weighted_sound, waves], axis=2)
        # motions, as rows, that deform nothing to second order: their parts in the shifts of all
        # balls come first, then those in the inner motions
        idle = _find_null(all_waves.reshape(-1, count + free.shape[1]))
        idle_shifts = idle[:, :count]
        idle_inner = idle[:, count:]
        # inner motions without a part in idle ones
        deforming = waves @ _find_null(idle_inner, 1.0).T
        mass = np.eye(count) - idle_shifts.T @ idle_shifts
        moved = np.where(np.abs(mass) > _COUPLED, mass, 0.0)
        return _SoundMass(couples=couple(deforming), moved=moved, idle=idle)

    def _deform_in_wave(self, free: Array) -> Array:
        """Return the deformations (n_rows, p, n_free), per component of q and over i, of inner
        motions ``free`` (n_inner, n_free) that deform no contact at q = 0.

        To first order in q the deformations of both sound and inner motions are i times real
        numbers.
        """
        rows, root = self._weight_rows()
        difference, total = self._find_inner_ends(rows, root)
        half = 0.5 * np.tile(self.contacts.vector[:, : self.periods], (len(rows), 1))
        # a motion that deforms nothing at any q, such as the spin of a ball between two others, is
        # left with rounding alone
        effects = abs(difference) + abs(total)
        size = np.sqrt(np.asarray((effects * effects).sum(axis=1)))[:, None]
        change = total @ free
        is_rounding = np.abs(change) <= _SOFT * size
        return np.asarray(half[:, :, None] * np.where(is_rounding, 0.0, change)[:, None, :])

    def require_rigid(self) -> None:
        """Raise :class:`~granphon.base.errors.MechanismError` if the lattice is a
        :attr:`mechanism`.

        Raises :class:`~granphon.base.errors.InputError` if bodies that do not move hold the balls.
        """
        if self.is_held:
            raise InputError(
                "the balls touch bodies that do not move",
                "Long waves move all balls together, which these bodies hold",
                "Use gp.Phonons or gp.Waves",
            )
        if self.mechanism:
            mend = "Use bending, or a lattice with more contacts"
            if not np.any(self.mindlin_ratio):
                mend = "Use friction, or a lattice with more contacts"
            raise MechanismError(f"the lattice {self.name} is a mechanism", self.mechanism, mend)

    @cached_property
    def mechanism(self) -> str:
        """The motion that costs no energy and that long waves meet, in words; empty if there is
        none.

        Such a motion is a uniform strain along the periods, or a motion inside the cell that
        couples with sound. A motion that does not couple, such as balls turning in opposite senses
        in a cell that holds several smaller cells, belongs to another wave vector of the smaller
        cell.
        """
        if self._touching is not self:
            return self._touching.mechanism
        can_turn = self.motions.rotate
        if self._sound_mass.couples:
            example = " (as gears do, on a lattice without odd rings)" if can_turn else ""
            return (
                f"The balls of a cell can shift or turn against each other without a cost in"
                f" energy{example}"
            )
        if not self._strains.size:
            return ""
        singular_values, strains = jacobi_svd(self._sound_rows @ self._strains)
        is_soft = singular_values <= _SOFT * singular_values[-1]
        if not is_soft[0]:
            return ""
        reason = "" if can_turn else "; without friction contacts resist compression only"
        return f"The strain {name_strain(strains[:, is_soft])} costs no energy{reason}"

    @cached_property
    def _strains(self) -> Array:
        """(n_u p, n_strains) matrix to displacement gradients from the strains xx, yy, xy sqrt 2,
        ... along the periods.

        There are none where the motions lack a displacement along a period.
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
        gradient, inner motions relaxed.

        Parameters
        ----------
        prestress : (...) compressive force over spacing, k, the same in every contact; by default
            the lattice's own.

        Returns
        -------
        (..., n_u, p, n_u, p), indices i, j, k, l of d2E / d(u_i,j) d(u_k,l), in units of k d^2.

        Raises :class:`~granphon.base.errors.InstabilityError` if prestress makes an inner motion
        unstable that the gradient moves.
        """
        n_u = len(self.motions.translations)
        p = self.periods
        shape = (n_u, p, n_u, p)
        if prestress is None and not self.is_prestressed:
            relaxed = self._relaxed_rows
            return (relaxed.T @ relaxed).reshape(shape)
        if prestress is not None and self._uses_sparse_matrices and np.ndim(prestress):
            # sparse factors are of one load
            return np.stack([self.gradient_stiffness(load) for load in np.asarray(prestress)])
        load, push_forms = self._find_load(prestress)
        *energy_forms, stress = push_forms
        forms = self._combine_forms(load, energy_forms)
        if self._relaxation is not None:
            relaxed_form = self._relaxation.eliminate(*forms)
        else:
            relaxed_form = self._eliminate(*forms, self._find_relaxing(energy_forms[2]))
        stiffness = np.asarray(relaxed_form.reshape(*relaxed_form.shape[:-2], *shape))
        is_across = self._is_across
        # a gradient of displacements across the periods costs the work of the static stress,
        # nothing else
        if is_across.any() and not self.lacks_potential:
            stiffness[..., is_across, :, :, :] = 0.0
            stiffness[..., :, :, is_across, :] = 0.0
            for axis in np.flatnonzero(is_across):
                stiffness[..., axis, :, axis, :] = -load * stress
        return stiffness

    def _combine_forms(self, load: Any, push_forms: Sequence[Any]) -> tuple[Any, Any, Any]:
        """Return the energy forms of two gradients, of an inner motion and a gradient, and of two
        inner motions: those of the springs less the ``load`` times the ``push_forms``.
        """
        gradients, mixed, inner = (
            spring - load * push
            for spring, push in zip(self._spring_forms, push_forms, strict=True)
        )
        return gradients, mixed, inner

    def _eliminate(self, form: Array, mixed: Array, block: Array, relaxing: Array) -> Array:
        """Return energy forms ``form`` (..., m, m) of gradients less the energy that the
        ``relaxing`` inner motions (n_inner, n) save.

        ``mixed`` (..., n_inner, m) are the forms of an inner motion and a gradient, and ``block``
        (..., n_inner, n_inner) those of two inner motions.
        """
        if not relaxing.size:
            return form
        _, pull, inverse = self._find_pulls(form, mixed, block, relaxing)
        return np.asarray(form - pull.swapaxes(-1, -2) @ (inverse[..., None] * pull))

    def _find_pulls(
        self, form: Array, mixed: Array, block: Array, relaxing: Array
    ) -> tuple[Array, Array, Array]:
        """Return the inner motions (..., n_inner, n) that are not coupled with each other, the
        pulls (..., n, m) of gradients on them, and the inverse (..., n) of their energies, zero of
        motions that cost none; the arguments are those of :meth:`_eliminate`.
        """
        energies, vectors = np.linalg.eigh(relaxing.T @ block @ relaxing)
        pull = vectors.swapaxes(-1, -2) @ relaxing.T @ mixed
        highest = np.max(np.abs(energies), axis=-1, keepdims=True)
        # no pull is larger than the root of the product of both energies
        largest_pull = np.sqrt(np.linalg.norm(form, axis=(-2, -1))[..., None] * highest)
        is_moved = np.max(np.abs(pull), axis=-1) > _SOFT * largest_pull
        motions = relaxing @ vectors
        self._require_stable_cell(energies, is_moved, motions)
        # D lacks the part of static forces without a potential, so that energies a little below
        # zero count as zero
        lowest = -max(NO_ENERGY, self.slack) * highest
        is_zero = (energies <= NO_ENERGY * highest) & (energies >= lowest)
        inverse = np.divide(1.0, energies, out=np.zeros_like(energies), where=~is_zero)
        return motions, pull, inverse

    def _require_stable_cell(
        self, energies: Array, is_moved: NDArray[np.bool_], vectors: Array
    ) -> None:
        """Raise :class:`~granphon.base.errors.InstabilityError` if a strain moves an inner motion
        of negative energy.

        ``energies`` (..., n) are those of ``vectors`` (..., n_inner, n), and ``is_moved``
        (..., n) says whether a gradient moves them. A motion that none moves belongs to another
        wave vector of a smaller cell, or is a wave of its own, whose frequency the bands have.
        """
        rounding = max(NO_ENERGY, self.slack) * np.max(np.abs(energies), axis=-1, keepdims=True)
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
        """Return a factor, a number or (..., 1, 1), and the forms that the factor multiplies: those
        of :meth:`_compute_push_forms`, and the sum (p, p) of f r r/a over the contacts.

        ``prestress`` is as for :meth:`gradient_stiffness`: for the lattice's own the factor is 1,
        and tangential forces add to the sum.
        """
        if prestress is None:
            rows, root = self._weight_rows(prestress=True)
            vector = self.contacts.vector[:, : self.periods]
            stress = vector.T @ (self.prestress[:, None] * vector)
            if self.has_tangential_force:
                tangential = self.tangential_force[:, : self.periods].T @ vector
                stress = stress + 0.5 * (tangential + tangential.T)
            forms = self._compute_push_forms(rows, self.static_signs * root**2)
            return 1.0, (*forms, stress)
        loads = real_array("prestress", prestress)
        factor = loads[..., None, None] if loads.ndim else float(loads)
        return factor, self._even_push_forms

    @cached_property
    def _spring_forms(self) -> tuple[Array, Array, Array]:
        """Energy of the springs as forms of two gradients, of an inner motion and a gradient, and
        of two inner motions.
        """
        affine, inner = self._strain_rows
        return affine.T @ affine, inner.T @ affine, inner.T @ inner

    @cached_property
    def _even_push_forms(self) -> tuple[Array, ...]:
        """The forms of :meth:`_find_load` of the same force over spacing, 1, in all contacts."""
        push = push_rows(self.contacts.normal, self.motions)
        vector = self.contacts.vector[:, : self.periods]
        forms = self._compute_push_forms(push, np.ones((len(push), len(self.contacts))))
        return (*forms, vector.T @ vector)

    def _compute_push_forms(self, rows: list[Row], load: Array) -> tuple[Array, ...]:
        """Return the energy, as the forms of :attr:`_spring_forms`, of ``rows`` on which static
        forces act, weighted by ``load`` (kinds, n_c).
        """
        affine, inner = self._deform_uniformly(rows, np.ones(load.shape))
        weight = load.reshape(-1, 1)
        return affine.T @ (weight * affine), inner.T @ (weight * affine), inner.T @ (inner * weight)

    # -- derivatives -------------------------------------------------------------------------------

    def _list_in_balls(self, inner: Array) -> Array:
        """Return the motions u and w (n_balls, motions, m) of balls in inner motions (n_inner, m),
        or, in a cell of many balls, in those of all balls.
        """
        m = inner.shape[1]
        if len(inner) == self.n_branches:
            weighted = inner.reshape(self.n_balls, -1)
        else:
            in_frame = np.zeros((self.n_branches, m))
            in_frame[self.n_branches - len(inner) :] = inner
            weighted = self._frame @ in_frame.reshape(self.n_balls, -1)
        return (weighted / np.sqrt(self.masses)[:, None]).reshape(self.n_balls, -1, m)

    @cached_property
    def gradient_motions(self) -> Array:
        """(n_balls, motions, n_u p) motions u and w of balls that go with each displacement
        gradient, beside the gradient itself.
        """
        if not self.is_prestressed:
            affine, inner = self._strain_rows
            if self._relaxation is not None:
                return self._list_in_balls(-self._relaxation.find_motions(affine))
            relaxing = self._find_relaxing()
            columns = inner @ relaxing
            # scaled as if nothing cancelled, so that the columns of gears have no digits too many
            size = np.sqrt(self._inner_sizes**2 @ relaxing**2)
            scale = np.where(size > 0.0, size, 1.0)
            amplitudes = np.linalg.lstsq(columns / scale, affine, rcond=_SOFT)[0]
            return self._list_in_balls(-relaxing @ (amplitudes / scale[:, None]))
        load, (*push_forms, _) = self._find_load(None)
        forms = self._combine_forms(load, push_forms)
        if self._relaxation is not None:
            return self._list_in_balls(-self._relaxation.respond(*forms))
        relaxing = self._find_relaxing(push_forms[2])
        motions, pull, inverse = self._find_pulls(*forms, relaxing)
        return self._list_in_balls(-motions @ (inverse[:, None] * pull))

    @cached_property
    def gradient_deformations(self) -> tuple[list[Row], Array]:
        """Rows of all deformations, :attr:`unit_rows`, and the deformations (rows, n_c, n_u, p) of
        contacts under each displacement gradient, with the inner motions relaxed.

        The second derivative of the energy by two gradients has, by the stiffness of a contact, the
        derivative that is the product of both deformations: the energy is least in the inner
        motions, so that their change does not matter. For a force over the distance it is minus the
        product of the displacements across the contact.
        """
        self.require_rigid()
        table = self.contacts
        vector = table.vector[:, : self.periods]
        rows = list(self.unit_rows)
        motions = np.pad(self.gradient_motions, ((0, 1), (0, 0), (0, 0)))
        shape = (len(table), len(self.motions.translations), self.periods)
        deformations = []
        for row in rows:
            ends = np.einsum("ca,cag->cg", row.head, motions[table.j])
            ends -= np.einsum("ca,cag->cg", row.tail, motions[table.i])
            deformations.append(strain_rows(row, vector, self.motions) + ends.reshape(shape))
        stack = np.array(deformations)
        if self.lacks_potential:
            return rows, stack
        # a gradient of a displacement across the periods turns the whole lattice: nothing deforms,
        # and the static stress alone does work
        stack[:, :, self._is_across] = 0.0
        for axis in np.flatnonzero(self._is_across) if self.is_prestressed else ():
            turned = np.zeros(shape)
            turned[:, axis] = vector
            rows.append(Row("push", 1.0, rows[-1].head, rows[-1].tail))
            stack = np.concatenate([stack, turned[None]])
        return rows, stack

    @cached_property
    def carried(self) -> Array:
        """(n_balls, n_u, n_u) displacement of each ball in sound, as columns, for a displacement of
        all balls by one along each axis: the unit matrix, but of balls that stay behind.
        """
        count = len(self.motions.translations)
        unit = np.broadcast_to(np.eye(count), (self.n_balls, count, count))
        idle = self._sound_mass.idle
        if not len(idle):
            return unit
        # the part of a displacement of all balls in the idle motions, which sound does not move:
        # a shift of all balls, and inner motions, which are mass-weighted
        shifts, inner = np.split(idle.T @ idle[:, :count], [count])
        stays = self._list_in_balls(self._touching._free @ inner)[:, self.motions.translating]
        return np.asarray(unit - shifts - np.sqrt(self.masses.sum()) * stays)

    def acoustic_tensor(self, direction: ArrayLike, prestress: ArrayLike | None = None) -> Array:
        """Return the acoustic tensor A(q^), (..., n_u, n_u), k d^2/M: the small-q limit of D/q^2
        with rotations eliminated.

        Its eigenvalues are the squared sound velocities. ``direction`` is (p,), or (n, p) for an
        axis of directions after the axes of ``prestress``, which is as in
        :meth:`gradient_stiffness`.
        """
        along = as_direction(direction, self.periods)
        directions = along.reshape(-1, self.periods)
        stiffness = self.gradient_stiffness(prestress)
        of_all_mass = np.einsum("...ijkl,nj,nl->...nik", stiffness, directions, directions)
        of_all_mass = of_all_mass / self.masses.sum()
        tensors = self._per_mass @ of_all_mass @ self._per_mass
        return np.asarray(tensors if along.ndim > 1 else tensors[..., 0, :, :])

    def sound_velocities(
        self, direction: ArrayLike, prestress: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Return the velocities of long waves along ``direction`` (p,) or (n, p), in the order of
        :attr:`wave_names`.

        Returns
        -------
        velocities : (..., n_u), d (k/M)^1/2; (..., n, n_u) for directions (n, p).
        polarisations : (..., n_u, n_u), or (..., n, n_u, n_u), unit vectors as columns. Where three
            displacements have two equal velocities, the first vector of the pair is along the
            direction as far as the pair has such a part, else along the first of the axes x, y, z
            that are farthest from the third vector.

        Raises
        ------
        InputError : bodies that do not move hold the balls.
        MechanismError : the lattice is a :attr:`mechanism`.
        InstabilityError : the prestress makes a squared velocity negative.
        """
        self.require_rigid()
        along = as_direction(direction, self.periods)
        if prestress is None and not self.is_prestressed:
            if along.size > _FEW_NUMBERS:
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
        """Return the error of a lattice whose acoustic ``tensor`` (..., n_u, n_u), or
        (..., n, n_u, n_u) of directions ``along`` (n, p), has an eigenvalue below zero.
        """
        squared, vectors = np.linalg.eigh(tensor)
        worst = np.unravel_index(np.argmin(squared[..., 0]), squared.shape[:-1])
        direction = along if along.ndim == 1 else along[worst[-1]]
        components = ", ".join(f"{component:.6g}" for component in direction)
        where = f"a squared sound velocity in direction ({components}) is negative"
        return self.explain_buckling(where, vectors[worst][:, 0])

    @lru_cache(maxsize=256)  # noqa: B019 (lattices are kept by a cache of their own)
    def _waves_along(
        self, shape: tuple[int, ...], numbers: tuple[float, ...]
    ) -> tuple[Array, Array]:
        """Return :meth:`sound_velocities` along a few unit vectors, without prestress, read-only.

        The components ``numbers`` and the ``shape`` of the vectors, (p,) or (n, p), are the key of
        the cache.
        """
        velocities, polarisations = self._compute_waves(np.reshape(numbers, shape))
        return read_only(velocities), read_only(polarisations)

    def _compute_waves(self, along: Array) -> tuple[Array, Array]:
        """Return velocities (..., b), ascending, and polarisations of sound in the directions
        ``along`` (..., p), from the deformations that sound makes over the root of its mass.
        """
        rows = self._sound_rows.reshape(-1, len(self.motions.translations), self.periods)
        factor = np.einsum("rij,...j->...ri", rows, along) @ self._per_mass
        factor = factor / np.sqrt(self.masses.sum())
        return decompose_waves(along, factor, self.motions.translations)

    @property
    def loose_warnings(self) -> tuple[str, ...]:
        """A sentence about balls that sound leaves behind, or none."""
        count = len(self.motions.translations)
        missing = count - float(np.trace(self._sound_mass.moved))
        if missing <= _COUPLED:
            return ()
        return (
            f"balls that are not held, {missing / count:.2g} of the mass, have no part in the"
            " moduli, and stay behind in sound waves",
        )

    @cached_property
    def _per_mass(self) -> Array:
        """(n_u, n_u) the root of all mass over that which sound moves; zero along displacements
        that move none of it.
        """
        mass_parts, vectors = np.linalg.eigh(self._sound_mass.moved)
        inverse = np.zeros_like(mass_parts)
        np.divide(1.0, mass_parts, out=inverse, where=mass_parts > _COUPLED)
        return np.asarray((vectors * np.sqrt(inverse)) @ vectors.T)

    @cached_property
    def wave_names(self) -> tuple[str, ...]:
        """Names of the long waves: "longitudinal", then "transverse", or "transverse_slow" and
        "transverse_fast".

        On a plane of balls that also move across it, "out_of_plane" is the last.
        """
        return name_waves(self.motions.translations, self.periods)

    @property
    def runs_twist(self) -> bool:
        """Whether balls of a straight chain turn about it, so that a twist runs along it where
        contacts resist torsion, and no spring to the ground holds it.
        """
        turns_about_line = self.periods == 1 and 0 in self.motions.rotations
        is_straight = not np.any(self.contacts.normal[:, 1:])
        return turns_about_line and is_straight and self.on_site is None

    def elastic_tensor(self, prestress: ArrayLike | None = None) -> Array:
        """Return the stiffness, change of stress over strain, in units of k d^(2-p); (..., 3, 3) in
        the plane.

        Its rows and columns are in Voigt order: xx, yy, xy in the plane; xx, yy, zz, yz, xz, xy in
        space, (..., 6, 6); xx on a line, (..., 1, 1).

        Under prestress these are the coefficients between Cauchy stress and strain (F. Birch, Phys.
        Rev. 71, 809, 1947; D. C. Wallace, Thermodynamics of Crystals, 1972), so that K and rho v^2
        keep their usual relation (equation 16).

        Raises :class:`~granphon.base.errors.InputError` if balls do not move along the periods,
        touch bodies that do not move, or hang on springs to the ground,
        :class:`~granphon.base.errors.MechanismError` if the lattice
        is a :attr:`mechanism`, and :class:`~granphon.base.errors.InstabilityError` if prestress
        leaves a strain that the stiffness does not resist.
        """
        self.require_rigid()
        has_no_prestress = prestress is None and not self.is_prestressed
        if has_no_prestress:
            return self._unstressed_tensor
        return self._find_elasticity(prestress)

    @cached_property
    def _unstressed_tensor(self) -> Array:
        """:meth:`elastic_tensor` without prestress, which every load of every state asks for;
        read-only.
        """
        return read_only(self._find_elasticity(None))

    def _find_elasticity(self, prestress: ArrayLike | None) -> Array:
        """Return :meth:`elastic_tensor` (..., n, n) of a lattice that is no mechanism."""
        p = self.periods
        axes = self.motions.translations
        if not set(range(p)) <= set(axes):
            raise InputError(
                f"the motions {self.motions.name!r} have no elastic moduli",
                "The balls do not move along the lattice",
            )
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
        """Whether a turn of the whole costs nothing: no spring to the ground resists rotations of
        the balls of a plane or of space.
        """
        return self.on_site is None or self.periods == 1

    @cached_property
    def is_isotropic(self) -> bool:
        """Whether the elastic tensor is the same in all directions; False if there is none."""
        if not self.has_symmetric_stress:
            return False
        c = self.elastic_tensor()
        p = self.periods
        if p == 1:
            return True
        # the isotropic tensor with the same c_xxxx and c_xxyy
        shear = (c[0, 0] - c[0, 1]) / 2.0
        isotropic = np.diag([c[0, 0]] * p + [shear] * (len(c) - p))
        isotropic[:p, :p][~np.eye(p, dtype=bool)] = c[0, 1]
        largest_difference = np.max(np.abs(c - isotropic))
        return bool(largest_difference <= _ISOTROPIC * c[0, 0])

    def optical_branch(self, direction: ArrayLike = (1.0, 0.0)) -> tuple[float, float]:
        """Return omega_0^2, k/M, and c, d^2, of the long-wave rotational branch omega^2 = omega_0^2
        (1 - c q^2), for one ball in the cell.

        ``direction`` is a vector (p,) of any length. On the triangular lattice omega_0^2 = 30 eta
        k/M and c = d^2/10; equation (15) prints d^2/20 (see the errata). Raises
        :class:`~granphon.base.errors.InputError` if a cell has more than one rotation, or none.
        """
        if self.n_balls != 1 or len(self.motions.rotations) != 1:
            raise InputError(
                "there is no single rotational branch", "It needs friction, and a cell of one ball"
            )
        ahead = self.contacts.vector[:, : self.periods] @ one_direction(direction, self.periods)
        rows, root = self._weight_rows()
        difference, total = self._combine_ends(rows, root)
        # effect on the contacts of the rotation (times cos of the half angle) and of the
        # displacements (times sin)
        turn = difference[..., self.motions.turning]
        shift = total[..., self.motions.translating]
        squared = float(np.sum(turn**2))
        # the cosine falls with the square of the half angle
        narrowing = float(np.sum(turn**2 * ahead[:, None] ** 2)) / 4.0
        # coupling with the displacements, which lowers the branch at second order
        coupling = 0.5 * np.sum(turn * shift * ahead[:, None], axis=(0, 1))
        curvature = (narrowing - float(coupling @ coupling) / squared) / squared
        return squared, curvature


def _find_null(matrix: Array, size: float = 0.0) -> Array:
    """Return an orthonormal basis (k, n), as rows, of the vectors that a ``matrix`` (m, n) takes to
    zero, but for rounding of its largest singular value, or of ``size`` if this is larger.
    """
    # with fewer rows than columns some vectors are free: add a row of zeros for each missing row
    lacking = max(0, matrix.shape[1] - len(matrix))
    padded = np.pad(matrix, ((0, lacking), (0, 0)))
    _, singular_values, right_vectors = np.linalg.svd(padded, full_matrices=False)
    is_null = singular_values <= _SOFT * np.max(singular_values, initial=size)
    return np.asarray(right_vectors[is_null])


def _split_columns(columns: Array, size: Array) -> tuple[Array, Array, Array]:
    """Return an orthonormal basis (m, rank) of columns (m, n), an orthonormal basis (n, n - rank)
    of the vectors that take the scaled columns to zero, and the scale (n,).

    The scaled columns are the columns over their scale. The lengths ``size`` (n,) are those that
    the columns would have if nothing cancelled in them.
    """
    scale = np.where(np.any(columns != 0.0, axis=0), size, 1.0)
    # with fewer rows than columns some vectors are free: add a row of zeros for each missing row
    lacking = max(0, columns.shape[1] - len(columns))
    padded = np.pad(columns / scale, ((0, lacking), (0, 0)))
    basis, singular_values, right_vectors = np.linalg.svd(padded, full_matrices=False)
    is_free = singular_values <= _SOFT * np.max(singular_values, initial=0.0)
    return np.asarray(basis[: len(columns), ~is_free]), np.asarray(right_vectors[is_free].T), scale
