"""Long waves: the compatibility matrix in the limit q -> 0, with rotations and inner motions relaxed; and elastic tensors.

Elastic moduli, sound velocities and mechanisms follow from the same rows as the bands; all are in reduced units. Tensors are
in Voigt order: their symmetry, and the moduli that are their averages over all directions, are found here too.
"""

from __future__ import annotations

import itertools
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.contact_table import steps_within
from granphon.balls.lattices import Lattice, as_direction, one_direction
from granphon.base.arrays import Array
from granphon.base.errors import InputError, InstabilityError, MechanismError
from granphon.base.results import read_only
from granphon.base.validation import real_array
from granphon.dynamics.compatibility import Compatibility
from granphon.dynamics.linalg import cholesky_factor, jacobi_svd
from granphon.dynamics.rows import Row, push_rows, strain_rows

#: ratio of the softest to the stiffest strain (singular values) below which a lattice is called a mechanism
_SOFT = 1e-12
#: coupling of free inner motions with sound, over its largest possible value, above which it counts as coupling
_COUPLED = 1e-9
#: greatest difference, over the constant c_xxxx, between elastic constants that are equal in an isotropic lattice; it allows
#: for rounding
_ISOTROPIC = 1e-10
#: relative difference of velocities below which they are equal but for rounding
_TIED = 1e-12
#: the same of the parts of polarisations along q
_TIED_ALONG = 1e-9
#: numbers of directions up to which their long waves are kept
_FEW_NUMBERS = 12
#: pairs of axes in Voigt order, for one, two and three periods
_VOIGT = {1: ((0, 0),), 2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))}


def voigt_pairs(periods: int) -> tuple[tuple[int, int], ...]:
    """Return the pairs of axes of the strains in Voigt order."""
    return _VOIGT[periods]


def voigt_names(periods: int) -> tuple[str, ...]:
    """Return the names of the strains in Voigt order: xx; xx, yy, xy; or xx, yy, zz, yz, xz, xy."""
    return tuple("xyz"[a] + "xyz"[b] for a, b in _VOIGT[periods])


def _take_voigt(c: Array) -> Array:
    """Return c_ijkl (..., p, p, p, p), made symmetric in i, j and in k, l, as (..., n, n) in Voigt order."""
    c = 0.5 * (c + c.swapaxes(-4, -3))
    c = 0.5 * (c + c.swapaxes(-2, -1))
    i, j = np.transpose(_VOIGT[c.shape[-1]])
    return np.asarray(c[..., i[:, None], j[:, None], i[None, :], j[None, :]])


def find_stress_part(stress: Array) -> Array:
    """Return what a Cauchy stress (..., p, p) adds to the second derivatives of the energy by strain, (..., n, n).

    The sums are the coefficients between stress and strain (F. Birch, Phys. Rev. 71, 809, 1947).
    """
    one = np.eye(stress.shape[-1])
    return _take_voigt(np.einsum("...ik,jl->...ijkl", stress, one) - np.einsum("...ij,kl->...ijkl", stress, one))


class LongWaves(Compatibility):
    """Elastic moduli and sound velocities of balls in contact on a periodic lattice, in reduced units."""

    def _deform_uniformly(self, rows: list[Row], root: Array) -> tuple[Array, Array]:
        """Return the deformations at q = 0, times ``root``, under displacement gradients and under inner motions.

        Their shapes are (n_rows, n_u p), for the gradients u_a,b (in the plane u_x,x u_x,y u_y,x u_y,y), and (n_rows,
        n_inner). Inner motions are rotations, and the shifts of several balls in the cell.
        """
        gradient = [strain_rows(row, self.contacts.vector[:, : self.periods], self.motions) for row in rows]
        affine = root[..., None] * np.reshape(gradient, (*root.shape, self._n_gradients))
        return affine.reshape(root.size, self._n_gradients), self._select_inner(self._combine_ends(rows, root)[0])

    @property
    def _n_gradients(self) -> int:
        """Number of displacement gradients u_a,b: a any displacement of a ball, b along the periods."""
        return len(self.motions.translations) * self.periods

    def _select_inner(self, columns: Array) -> Array:
        """Return the columns (n_rows, n_inner) of inner motions, from all columns (kinds, n_c, n_branches)."""
        return columns.reshape(-1, self.n_branches)[:, len(self.motions.translations) :]

    @cached_property
    def _strain_rows(self) -> tuple[Array, Array]:
        """:meth:`_deform_uniformly` of K^1/2 C."""
        return self._deform_uniformly(*self._weight_rows())

    @cached_property
    def _inner_modes(self) -> tuple[Array, Array]:
        """Effect on the contacts of the inner motions: rotations, and the shifts of several balls in the cell.

        The first array (n_rows, n_stiff) is an orthonormal basis of the deformations that they can make; the second
        (n_inner, n_free) holds the inner motions that deform no contact.
        """
        _, inner = self._strain_rows
        count = inner.shape[1]
        if not count:
            return np.zeros((len(inner), 0)), np.zeros((0, 0))
        size = np.linalg.norm(inner, axis=0)
        # a column that is only rounding, compared with others of its kind, belongs to a motion that deforms nothing
        turns = np.tile(self.motions.is_rotation, self.n_balls)[-count:]
        of_kind = np.where(turns, np.max(size, where=turns, initial=0.0), np.max(size, where=~turns, initial=0.0))
        still = size <= _SOFT * of_kind
        scale = np.where(still, 1.0, size)
        # with fewer rows than motions some motions are free: add a row of zeros for each missing row
        columns = np.pad(np.where(still, 0.0, inner / scale), ((0, max(0, count - len(inner))), (0, 0)))
        left, values, right = np.linalg.svd(columns, full_matrices=False)
        free = values <= _SOFT * values[0]
        return np.asarray(left[: len(inner), ~free]), np.asarray(right[free].T / scale[:, None])

    def _relax(self, rows: Array) -> Array:
        """Return the part of deformations (n_rows, ...) that remains once the inner motions have relaxed."""
        left, _ = self._inner_modes
        return np.asarray(rows - np.tensordot(left, np.tensordot(left.T, rows, 1), 1))

    @cached_property
    def _relaxed_rows(self) -> Array:
        """(n_rows, n_u p) deformations under each displacement gradient, with the inner motions relaxed.

        A gradient of a displacement across the periods is a rotation of the whole lattice, which deforms no contact once the
        balls turn along: its column is exactly zero.
        """
        relaxed, p = self._relax(self._strain_rows[0]), self.periods
        return np.where(np.repeat(self._is_across, p), 0.0, relaxed)

    @property
    def _is_across(self) -> NDArray[np.bool_]:
        """(n_u,) whether each displacement is across the periods."""
        return np.array(self.motions.translations) >= self.periods

    @cached_property
    def is_twisted_by_sound(self) -> bool:
        """Whether a uniform strain twists contacts, or makes balls roll, once the inner motions have relaxed.

        If not, the elastic constants are the same at any torsion and bending above zero. So it is in cells of one ball, and
        where inversion exchanges both balls, as in hcp and diamond.
        """
        relaxed = self._relaxed_rows
        turning = np.repeat([row.kind in ("twist", "roll") for row in self.rows], len(self.contacts))
        return bool(np.max(np.abs(relaxed[turning]), initial=0.0) > _COUPLED * np.max(np.abs(relaxed), initial=0.0))

    @cached_property
    def _with_sound(self) -> tuple[bool, Array]:
        """Whether inner motions that cost no energy at Gamma take part in sound, and the part of the mass that sound moves.

        In a wave, their energy is of second order in q, as that of sound is. Where they do not couple with sound to that
        order, they are separate waves; this is always so for antiphase motions in a cell that holds several smaller cells.
        Motions that deform nothing to this order stay behind: a ball that touches no other shifts against the rest. What
        they have of the shift of all balls is missing from the mass, (n_u, n_u) of one if none do.
        """
        inner, count = self._inner_modes[1], len(self.motions.translations)
        if not inner.shape[1]:
            return False, np.eye(count)
        # to first order in q the deformations of both sound and inner motions are i times real numbers
        gap, total = self._combine_ends(*self._weight_rows())
        half = 0.5 * np.tile(self.contacts.vector[:, : self.periods], (len(total), 1))
        # a motion that deforms nothing at any q, such as the spin of a ball between two others, is left with rounding alone
        rows = np.linalg.norm(self._select_inner(np.abs(gap) + np.abs(total)), axis=1, keepdims=True)
        sound = self._relaxed_rows.reshape(-1, count, self.periods)

        def make_waves(free: Array) -> Array:
            change = self._select_inner(total) @ free
            change = np.where(np.abs(change) <= _SOFT * rows * np.linalg.norm(free, axis=0), 0.0, change)
            return self._relax(half[:, :, None] * change[:, None, :])

        def couple(waves: Array) -> bool:
            coupling = np.einsum("rij,rlm->ijlm", sound, waves)
            coupling = coupling + coupling.swapaxes(1, 2)
            return bool(np.max(np.abs(coupling), initial=0.0) > _COUPLED * np.linalg.norm(sound) * np.linalg.norm(waves))

        if not couple(make_waves(inner)):
            return False, np.eye(count)
        free = np.linalg.qr(inner)[0]
        waves = make_waves(free)
        moved = sound.swapaxes(1, 2) / np.sqrt(self.masses.sum())  # as inner motions are, per root of mass
        together = np.concatenate([moved, waves], axis=2).reshape(-1, count + free.shape[1])
        still = _find_null(together)
        rest = waves @ _find_null(still[:, count:], 1.0).T
        part = np.eye(count) - still[:, :count].T @ still[:, :count]
        return couple(rest), np.where(np.abs(part) > _COUPLED, part, 0.0)

    def require_rigid(self) -> None:
        """Raise :class:`~granphon.base.errors.MechanismError` if the lattice is a :attr:`mechanism`.

        Raises :class:`~granphon.base.errors.InputError` if bodies that do not move hold the balls.
        """
        if self.is_held:
            why = "Long waves move all balls together, which these bodies hold"
            raise InputError("the balls touch bodies that do not move", why, "Use gp.Phonons or gp.Waves")
        if self.mechanism:
            mend = "Use bending, or a lattice with more contacts"
            if not np.any(self.mindlin_ratio):
                mend = "Use friction, or a lattice with more contacts"
            raise MechanismError(f"the lattice {self.name} is a mechanism", self.mechanism, mend)

    @cached_property
    def mechanism(self) -> str:
        """The motion that costs no energy and that long waves meet, in words; empty if there is none.

        Such a motion is a uniform strain along the periods, or a motion inside the cell that couples with sound. A motion
        that does not couple, such as balls turning in opposite senses in a cell that holds several smaller cells, belongs to
        another wave vector of the smaller cell.
        """
        if self._with_sound[0]:
            how = " (as gears do, on a lattice without odd rings)" if self.motions.rotate else ""
            return f"The balls of a cell can shift or turn against each other without a cost in energy{how}"
        if not self._strains.size:
            return ""
        values, right = jacobi_svd(self._relaxed_rows @ self._strains)
        if values[0] <= _SOFT * values[-1]:
            # where several strains cost nothing, so do their sums: shown is what they have of the one that is most theirs
            pairs, soft = _VOIGT[self.periods], right[:, values <= _SOFT * values[-1]]
            most = np.argmax(np.round(np.sum(soft**2, axis=1), 6))
            strain = soft @ soft[most] * [1.0 if a == b else np.sqrt(2.0) for a, b in pairs]
            shown = ", ".join(f"{one:g}" for one in np.round(strain / strain[np.argmax(np.abs(strain))], 6) + 0.0)
            names = ", ".join(("" if a == b else "2") + "xyz"[a] + "xyz"[b] for a, b in pairs)
            why = "" if self.motions.rotate else "; without friction contacts resist compression only"
            return f"The strain ({names}) = ({shown}) costs no energy{why}"
        return ""

    @cached_property
    def _strains(self) -> Array:
        """(n_u p, n_strains) matrix to displacement gradients from the strains xx, yy, xy sqrt 2, ... along the periods.

        There are none where the motions lack a displacement along a period.
        """
        if not set(range(self.periods)) <= set(self.motions.translations):
            return np.zeros((self._n_gradients, 0))
        found = []
        for a, b in _VOIGT[self.periods]:
            gradient = np.zeros((len(self.motions.translations), self.periods))
            for one, other in ((a, b), (b, a)):
                gradient[self.motions.translations.index(one), other] = 1.0 if a == b else np.sqrt(0.5)
            found.append(gradient.ravel())
        return np.stack(found, axis=1)

    def gradient_stiffness(self, prestress: ArrayLike | None = None) -> Array:
        """Return the second derivative of a cell's energy with respect to the displacement gradient, inner motions relaxed.

        Parameters
        ----------
        prestress : (...) compressive force over spacing, the same in every contact; by default the lattice's own.

        Returns
        -------
        (..., n_u, p, n_u, p), indices i, j, k, l of d2E / d(u_i,j) d(u_k,l), in units of k.
        """
        shape = (len(self.motions.translations), self.periods) * 2
        if prestress is None and not self.is_prestressed:
            relaxed = self._relaxed_rows
            return (relaxed.T @ relaxed).reshape(shape)
        each, push = self._find_load(prestress)
        own, mixed, block = (spring - each * held for spring, held in zip(self._spring_forms, push[:3], strict=True))
        if block.size:
            own = own - mixed.swapaxes(-1, -2) @ np.linalg.pinv(block, rcond=1e-13, hermitian=True) @ mixed
        stiffness = np.asarray(own.reshape(*own.shape[:-2], *shape))
        across = self._is_across
        if across.any():  # a gradient of displacements across the periods costs the work of the static stress, nothing else
            stiffness[..., across, :, :, :] = 0.0
            stiffness[..., :, :, across, :] = 0.0
            for axis in np.flatnonzero(across):
                stiffness[..., axis, :, axis, :] = -each * push[3]
        return stiffness

    def _find_load(self, prestress: ArrayLike | None) -> tuple[Any, tuple[Array, ...]]:
        """Return a factor (..., 1, 1) and the :meth:`_compute_push_forms` that it multiplies."""
        if prestress is None:
            return 1.0, self._compute_push_forms(self.prestress)
        return real_array("prestress", prestress)[..., None, None], self._even_push_forms

    @cached_property
    def _spring_forms(self) -> tuple[Array, Array, Array]:
        """Energy of the springs as forms of two gradients, of an inner motion and a gradient, and of two inner motions."""
        affine, inner = self._strain_rows
        return affine.T @ affine, inner.T @ affine, inner.T @ inner

    @cached_property
    def _even_push_forms(self) -> tuple[Array, ...]:
        return self._compute_push_forms(np.ones(len(self.contacts)))

    def _compute_push_forms(self, prestress: Array) -> tuple[Array, ...]:
        """Return the forms of :attr:`_spring_forms` for displacements across contacts, weighted by ``prestress`` (n_c,).

        The fourth is the sum over contacts of the vector along the periods with itself, (p, p).
        """
        push, vector = push_rows(self.contacts.normal, self.motions), self.contacts.vector[:, : self.periods]
        across, inner = self._deform_uniformly(push, np.ones((len(push), len(self.contacts))))
        load = np.tile(prestress, len(push))[:, None]
        return (
            across.T @ (load * across), inner.T @ (load * across), inner.T @ (load * inner),
            vector.T @ (prestress[:, None] * vector),
        )  # fmt: skip

    def acoustic_tensor(self, direction: ArrayLike, prestress: ArrayLike | None = None) -> Array:
        """Return the acoustic tensor A(q^), (..., n_u, n_u), k d^2/M: the small-q limit of D/q^2 with rotations eliminated.

        Its eigenvalues are the squared sound velocities. ``direction`` is (p,), or (n, p) for an axis of directions after
        the axes of ``prestress``, which is as in :meth:`gradient_stiffness`.
        """
        along = as_direction(direction, self.periods)
        many = along.reshape(-1, self.periods)
        tensor = np.einsum("...ijkl,nj,nl->...nik", self.gradient_stiffness(prestress), many, many) / self.masses.sum()
        tensor = self._per_mass @ tensor @ self._per_mass
        return np.asarray(tensor if along.ndim > 1 else tensor[..., 0, :, :])

    def sound_velocities(self, direction: ArrayLike, prestress: ArrayLike | None = None) -> tuple[Array, Array]:
        """Find the velocities of long waves along ``direction`` (p,) or (n, p), in the order of :attr:`wave_names`.

        Returns
        -------
        velocities : (..., n_u), d (k/M)^1/2; (..., n, n_u) for directions (n, p).
        polarisations : (..., n_u, n_u), or (..., n, n_u, n_u), unit vectors as columns. Where three displacements have two
            equal velocities, the first vector of the pair is along the direction as far as the pair has such a part, else
            along the first of the axes x, y, z that are farthest from the third vector.

        Raises
        ------
        MechanismError : the lattice is a :attr:`mechanism`.
        InstabilityError : the prestress makes a squared velocity negative.
        """
        self.require_rigid()
        along = as_direction(direction, self.periods)
        if prestress is None and not self.is_prestressed:
            # at every load of every state the same few directions are asked for
            few = along.size <= _FEW_NUMBERS
            return self._waves_along(along.shape, tuple(along.ravel().tolist())) if few else self._compute_waves(along)
        tensor = self.acoustic_tensor(along, prestress)
        try:
            factor = cholesky_factor(tensor)
        except np.linalg.LinAlgError:
            squared, vectors = np.linalg.eigh(tensor)
            worst = np.unravel_index(np.argmin(squared[..., 0]), squared.shape[:-1])
            way = along if along.ndim == 1 else along[worst[-1]]
            where = f"a squared sound velocity in direction ({', '.join(f'{one:.6g}' for one in way)}) is negative"
            raise self.explain_buckling(where, vectors[worst][:, 0]) from None
        return decompose_waves(along, factor, self.motions.translations)

    @lru_cache(maxsize=256)  # noqa: B019 (lattices are kept by a cache of their own)
    def _waves_along(self, shape: tuple[int, ...], numbers: tuple[float, ...]) -> tuple[Array, Array]:
        """Return :meth:`sound_velocities` along a few unit vectors, without prestress; read-only."""
        values, vectors = self._compute_waves(np.reshape(numbers, shape))
        return read_only(values), read_only(vectors)

    def _compute_waves(self, along: Array) -> tuple[Array, Array]:
        rows = self._relaxed_rows.reshape(-1, len(self.motions.translations), self.periods)
        factor = np.einsum("rij,...j->...ri", rows, along) @ self._per_mass / np.sqrt(self.masses.sum())
        return decompose_waves(along, factor, self.motions.translations)

    @property
    def loose_warnings(self) -> tuple[str, ...]:
        """A sentence about balls that sound leaves behind, or none."""
        left = len(self.motions.translations) - float(np.trace(self._with_sound[1]))
        if left <= _COUPLED:
            return ()
        part = left / len(self.motions.translations)
        return (
            f"balls that are not held, {part:.2g} of the mass, have no part in the moduli, and stay behind in sound waves",
        )

    @cached_property
    def _per_mass(self) -> Array:
        """(n_u, n_u) the root of all mass over that which sound moves; zero along displacements that move none of it."""
        values, vectors = np.linalg.eigh(self._with_sound[1])
        inverse = np.divide(1.0, values, out=np.zeros_like(values), where=values > _COUPLED)
        return np.asarray((vectors * np.sqrt(inverse)) @ vectors.T)

    @cached_property
    def wave_names(self) -> tuple[str, ...]:
        """Names of the long waves: "longitudinal", then "transverse", or "transverse_slow" and "transverse_fast".

        On a plane of balls that also move across it, "out_of_plane" is the last.
        """
        return name_waves(self.motions.translations, self.periods)

    @property
    def runs_twist(self) -> bool:
        """Whether balls of a straight chain turn about it, so that a twist runs along it where contacts resist torsion."""
        return self.periods == 1 and 0 in self.motions.rotations and not np.any(self.contacts.normal[:, 1:])

    def elastic_tensor(self, prestress: ArrayLike | None = None) -> Array:
        """Return the stiffness, change of stress over strain, in units of k d^(2-p); (..., 3, 3) in the plane.

        Its rows and columns are in Voigt order: xx, yy, xy in the plane; xx, yy, zz, yz, xz, xy in space, (..., 6, 6); xx on
        a line, (..., 1, 1).

        Under prestress these are the coefficients between Cauchy stress and strain (F. Birch, Phys. Rev. 71, 809, 1947;
        D. C. Wallace, Thermodynamics of Crystals, 1972), so that K and rho v^2 keep their usual relation (equation 16).

        Raises :class:`~granphon.base.errors.InputError` if balls do not move along the periods, and
        :class:`~granphon.base.errors.MechanismError` if the lattice is a :attr:`mechanism`.
        """
        self.require_rigid()
        plain = prestress is None and not self.is_prestressed
        return self._own_tensor if plain else self._find_elasticity(prestress)

    @cached_property
    def _own_tensor(self) -> Array:
        """:meth:`elastic_tensor` without prestress, which every load of every state asks for; read-only."""
        return read_only(self._find_elasticity(None))

    def _find_elasticity(self, prestress: ArrayLike | None) -> Array:
        p, axes = self.periods, self.motions.translations
        if not set(range(p)) <= set(axes):
            raise InputError(
                f"the motions {self.motions.name!r} have no elastic moduli", "The balls do not move along the lattice"
            )
        own = [axes.index(axis) for axis in range(p)]
        c = self.gradient_stiffness(prestress)[..., own, :, :, :][..., own, :] / self.measure
        if prestress is not None or self.is_prestressed:
            each, push = self._find_load(prestress)
            return _take_voigt(c) + find_stress_part(-each * push[3] / self.measure)
        return _take_voigt(c)

    @cached_property
    def is_isotropic(self) -> bool:
        """Whether the elastic tensor is the same in all directions."""
        c, p = self.elastic_tensor(), self.periods
        alike = np.diag([c[0, 0]] * p + [(c[0, 0] - c[0, -1 if p == 1 else 1]) / 2.0] * (len(c) - p))
        alike[:p, :p][~np.eye(p, dtype=bool)] = c[0, 1] if p > 1 else 0.0
        return bool(np.max(np.abs(c - alike)) <= _ISOTROPIC * c[0, 0])

    def optical_branch(self, direction: ArrayLike = (1.0, 0.0)) -> tuple[float, float]:
        """Return (omega_0^2, c) of the long-wave rotational branch omega^2 = omega_0^2 (1 - c q^2), one ball in the cell.

        ``direction`` is a vector (p,) of any length. On the triangular lattice omega_0^2 = 30 eta k/M and c = d^2/10;
        equation (15) prints d^2/20 (see the errata).
        """
        if self.n_balls != 1 or len(self.motions.rotations) != 1:
            raise InputError("there is no single rotational branch", "It needs friction, and a cell of one ball")
        ahead = self.contacts.vector[:, : self.periods] @ one_direction(direction, self.periods)
        rows, root = self._weight_rows()
        gap, total = self._combine_ends(rows, root)
        # effect on the contacts of the rotation (times cos of the half angle) and of the displacements (times sin)
        turn, shift = gap[..., self.motions.turning], total[..., self.motions.translating]
        squared = float(np.sum(turn**2))
        narrowing = float(np.sum(turn**2 * ahead[:, None] ** 2)) / 4.0
        # coupling with the displacements, which lowers the branch at second order
        coupling = 0.5 * np.sum(turn * shift * ahead[:, None], axis=(0, 1))
        return squared, (narrowing - float(coupling @ coupling) / squared) / squared


def _find_null(matrix: Array, size: float = 0.0) -> Array:
    """Return an orthonormal basis, as rows, of the vectors that a matrix, of this ``size`` or larger, takes to zero."""
    _, values, right = np.linalg.svd(
        np.pad(matrix, ((0, max(0, matrix.shape[1] - len(matrix))), (0, 0))), full_matrices=False
    )
    return np.asarray(right[values <= _SOFT * np.max(values, initial=size)])


# -- polarisations ----------------------------------------------------------------------------------------------------


def name_waves(axes: tuple[int, ...], periods: int) -> tuple[str, ...]:
    """Return the names of the long waves of balls that move along these ``axes``, on a lattice with ``periods``.

    They are "longitudinal", then "transverse", or "transverse_slow" and "transverse_fast"; on a plane of balls that also
    move across it, "out_of_plane" is the last.
    """
    ahead = ("longitudinal",) * (set(range(periods)) <= set(axes))
    across = ("out_of_plane",) * (periods == 2 and 2 in axes)
    rest = len(axes) - len(ahead) - len(across)
    return (*ahead, *(("transverse",) if rest == 1 else ("transverse_slow", "transverse_fast")[:rest]), *across)


def decompose_waves(along: Array, factor: Array, axes: tuple[int, ...]) -> tuple[Array, Array]:
    """Return velocities (..., n_u) and polarisations (..., n_u, n_u), columns, in the order of :func:`name_waves`.

    ``along`` (..., p) are the directions, unit vectors; ``factor`` (..., n, n_u) are factors of the acoustic tensors, whose
    eigenvalues are the squares of velocities.
    """
    values, right = jacobi_svd(factor)
    periods = along.shape[-1]
    if len(axes) == 3:
        right = _settle_vectors(np.pad(along, [(0, 0)] * (along.ndim - 1) + [(0, 3 - periods)]), values, right)
    names = name_waves(axes, periods)
    toward = np.zeros((*along.shape[:-1], len(axes)))
    for axis in set(range(periods)) & set(axes):
        toward[..., axes.index(axis)] = along[..., axis]
    rank = np.zeros(right.shape[:-2] + right.shape[-1:])
    if names[0] == "longitudinal":
        part = np.abs(np.einsum("...i,...ib->...b", toward, right))
        # of two that are equally longitudinal, the fast one
        tied = part >= (1.0 - _TIED_ALONG) * np.max(part, axis=-1, keepdims=True)
        ahead = len(axes) - 1 - np.argmax(tied[..., ::-1], axis=-1)
        np.put_along_axis(rank, ahead[..., None], -1.0, -1)
    if names[-1] == "out_of_plane":
        across = np.argmax(np.where(rank < 0.0, -1.0, np.abs(right[..., axes.index(2), :])), axis=-1)
        np.put_along_axis(rank, across[..., None], 1.0, -1)
    order = np.argsort(rank, axis=-1, kind="stable")
    return np.take_along_axis(values, order, -1), np.take_along_axis(right, order[..., None, :], -1)


def _settle_vectors(along: Array, values: Array, vectors: Array) -> Array:
    """Return polarisations (..., 3, 3), columns, that rounding does not decide: those of equal velocities, and their signs.

    ``along`` (..., 3) is the direction; ``values`` (..., 3) are the velocities, ascending.
    """
    vectors = vectors.copy()
    along = np.broadcast_to(along, vectors.shape[:-1])
    tied = np.diff(values, axis=-1) <= _TIED * values[..., 1:]
    triple = np.all(tied, axis=-1)
    vectors[triple, :, 2] = along[triple]
    for pair, third in ((0, 2), (1, 0)):
        here = tied[..., pair] & (~triple if pair else True)
        apart = vectors[here][..., third]
        # the first vector, without its part along the third: the direction, or an axis far from the third vector
        ahead = along[here] - np.sum(along[here] * apart, axis=-1, keepdims=True) * apart
        axis = np.eye(3)[np.argmin(np.round(np.abs(apart), 9), axis=-1)]
        aside = axis - np.sum(axis * apart, axis=-1, keepdims=True) * apart
        first = np.where(np.linalg.norm(ahead, axis=-1, keepdims=True) > _TIED_ALONG, ahead, aside)
        first /= np.linalg.norm(first, axis=-1, keepdims=True)
        vectors[here, :, pair], vectors[here, :, pair + 1] = first, np.cross(apart, first)
    # longitudinal parts point ahead; of a vector without one, the largest component is above zero
    part = np.einsum("...i,...ib->...b", along, vectors)
    largest = np.argmax(np.round(np.abs(vectors), 9), axis=-2)
    own = np.take_along_axis(vectors, largest[..., None, :], -2)[..., 0, :]
    return vectors * np.where(np.where(np.abs(part) > _TIED_ALONG, part, own) < 0.0, -1.0, 1.0)[..., None, :]


# -- symmetry and averages of elastic tensors ----------------------------------------------------------------------------


#: tolerance of positions, in spacings
_TOLERANCE = 1e-6
#: greatest difference, over the largest constant, between elastic constants that are equal but for rounding
_ROUNDED = 1e-10
#: number of periods of a lattice whose elastic tensor has so many rows
_PERIODS = {1: 1, 3: 2, 6: 3}


@lru_cache(maxsize=64)
def point_group(lattice: Lattice) -> Array:
    """Return the rotations and reflections (n, p, p) that, with some shift, carry a lattice with its balls into itself."""
    p = lattice.periods
    cell, balls = lattice.vectors[:, :p], lattice.positions
    gram = cell @ cell.T
    # lattice vectors onto which each vector of the cell may be carried: they are as long
    reach = steps_within(cell, float(np.sqrt(gram.diagonal().max())) + _TOLERANCE) @ cell
    lengths = np.linalg.norm(reach, axis=1)
    images = [reach[np.abs(lengths - np.sqrt(gram[axis, axis])) < _TOLERANCE] for axis in range(p)]
    chosen = np.array([np.stack(rows) for rows in itertools.product(*images)])
    kept = chosen[np.max(np.abs(chosen @ chosen.swapaxes(1, 2) - gram), axis=(1, 2)) < _TOLERANCE]
    found = []
    for turn in (np.linalg.inv(cell) @ kept).swapaxes(1, 2):  # carries each row of the cell to its image
        turned = np.concatenate([balls[:, :p] @ turn.T, balls[:, p:]], axis=1)
        for shift in balls - turned[0]:  # along the periods: it carries balls to balls, up to lattice vectors
            apart = (turned + shift)[:, None] - balls
            along = apart[..., :p] @ np.linalg.inv(cell)
            apart[..., :p] = (along - np.rint(along)) @ cell
            if np.all(np.min(np.linalg.norm(apart, axis=-1), axis=1) < _TOLERANCE):
                found.append(turn)
                break
    return read_only(found)


def symmetrise(tensor: Array, lattice: Lattice) -> Array:
    """Return the mean of elastic tensors (..., n, n) in Voigt order over the :func:`point_group` of a lattice."""
    a, b = np.transpose(voigt_pairs(lattice.periods))
    place = np.empty((lattice.periods,) * 2, int)
    place[a, b] = place[b, a] = np.arange(len(a))
    whole = tensor[..., place[:, :, None, None], place[None, None]]
    turns = point_group(lattice)
    mean = np.einsum("gia,gjb,gkc,gld,...abcd->...ijkl", turns, turns, turns, turns, whole, optimize=True) / len(turns)
    return np.asarray(mean[..., a[:, None], b[:, None], a[None], b[None]])


@lru_cache(maxsize=64)
def has_cubic_axes(lattice: Lattice) -> bool:
    """Whether the symmetry of a lattice is that of a square or cube with edges along x, y, z, so that C11, C12, C44 are all.

    False of a line, and of the triangular lattice, on which an elastic tensor is isotropic.
    """
    n = len(voigt_pairs(lattice.periods))
    if n == 1:
        return False
    each = np.arange(1.0, n * n + 1.0).reshape(n, n) ** 2
    return is_cubic(symmetrise(each + each.T, lattice), _TOLERANCE)


def is_cubic(tensor: Array, tolerance: float = _ROUNDED) -> bool:
    """Whether an elastic tensor (n, n) is that of a square or cube with edges along x, y, z, and not isotropic.

    ``tolerance`` is relative to its largest entry.
    """
    n, p = len(tensor), _PERIODS[len(tensor)]
    if n == 1:
        return False
    wanted = np.zeros((n, n))
    wanted[:p, :p] = tensor[0, 1]
    wanted[np.arange(p), np.arange(p)] = tensor[0, 0]
    wanted[np.arange(p, n), np.arange(p, n)] = tensor[p, p]
    most = tolerance * np.max(tensor)
    turned = abs(tensor[0, 0] - tensor[0, 1] - 2.0 * tensor[p, p]) < most  # isotropic
    return bool(np.max(np.abs(tensor - wanted)) < most and not turned)


def shears(tensor: Array) -> Array:
    """Return the shear moduli of an elastic tensor under an orthonormal set of shears.

    They are (..., 2), of xx - yy and xy, of tensors (..., 3, 3); and (..., 5), of 2zz - xx - yy, xx - yy, yz, xz, xy, of
    tensors (..., 6, 6). A line has none: (..., 0).
    """
    c = tensor
    if c.shape[-1] == 1:
        return np.zeros((*c.shape[:-2], 0))
    across = (c[..., 0, 0] + c[..., 1, 1] - 2.0 * c[..., 0, 1]) / 4.0
    if c.shape[-1] == 3:
        return np.stack([across, c[..., 2, 2]], axis=-1)
    along_z = (c[..., 0, 0] + c[..., 1, 1] + 4.0 * c[..., 2, 2] + 2.0 * c[..., 0, 1]) / 12.0
    along_z = along_z - (c[..., 0, 2] + c[..., 1, 2]) / 3.0
    return np.stack([along_z, across, c[..., 3, 3], c[..., 4, 4], c[..., 5, 5]], axis=-1)


def bulk_and_shear(tensor: Array) -> Array:
    """Return (..., 2) K and G of elastic tensors (..., n, n): averages over all directions (W. Voigt, 1889).

    Of a line K is its modulus, and G is zero.
    """
    p = _PERIODS[tensor.shape[-1]]
    bulk, each = np.sum(tensor[..., :p, :p], axis=(-2, -1)) / p**2, shears(tensor)
    return np.stack([bulk, np.mean(each, axis=-1) if p > 1 else np.zeros_like(bulk)], axis=-1)


def anisotropy(shear: Array) -> Array:
    """Return the anisotropy (...) of cubic elastic constants from :func:`shears` (..., 2) or (..., 5): 2 C44/(C11 - C12).

    In the plane it is 2 C33/(C11 - C12), of xy over xx - yy; it is 1 of an isotropic tensor (C. Zener, Phys. Rev. 71, 846,
    1947).
    """
    axial = shear.shape[-1] // 2  # shears along the axes come first
    return np.asarray(np.mean(shear[..., axial:], axis=-1) / np.mean(shear[..., :axial], axis=-1))


def longitudinal_modulus(tensor: Array) -> Array:
    """Return the modulus of longitudinal waves over all directions, (...): K + G in the plane, K + 4G/3 in space."""
    p = _PERIODS[tensor.shape[-1]]
    bulk, shear = np.moveaxis(bulk_and_shear(tensor), -1, 0)
    return np.asarray(bulk + 2.0 * (p - 1) / p * shear)


def waves_of_tensor(tensor: Array, direction: ArrayLike) -> tuple[Array, Array]:
    """Find the long waves of elastic tensors (..., n, n) along ``direction`` (p,) or (n, p), without prestress.

    Returns
    -------
    velocities : (..., p), or (..., n, p), in the order of :func:`~granphon.dynamics.long_waves.name_waves`, in the root
        of the tensor's unit: over the root of the density they are velocities.
    polarisations : (..., p, p), or (..., n, p, p), unit vectors as columns.

    Raises :class:`~granphon.base.errors.InstabilityError` if a tensor is not positive.
    """
    periods = _PERIODS[tensor.shape[-1]]
    along, pairs = as_direction(direction, periods), voigt_pairs(periods)
    strain = np.zeros((*along.shape, len(pairs)))  # of a wave with a unit displacement along each axis
    for place, (a, b) in enumerate(pairs):
        strain[..., a, place] += along[..., b]
        if a != b:
            strain[..., b, place] += along[..., a]
    stiffness = np.asarray(tensor)[(..., *(None,) * (along.ndim - 1), slice(None), slice(None))]
    try:
        factor = cholesky_factor(strain @ stiffness @ strain.swapaxes(-1, -2))
    except np.linalg.LinAlgError:
        what = "a squared sound velocity is negative"
        raise InstabilityError(what, "The elastic tensor is not positive", "Raise the load") from None
    return decompose_waves(along, factor, tuple(range(periods)))
