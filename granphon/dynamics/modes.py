"""The lattice of contacts and its vibrations.

The frequencies are the singular values of K^1/2 C(q) M^-1/2. Everything is in reduced units: length d, stiffness k, mass M.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import Lattice, as_direction, find_lattice
from granphon.balls.motions import Motions, allowed_motions
from granphon.base.arguments import not_negative, positive
from granphon.base.errors import InputError, InstabilityError, message
from granphon.base.results import Result
from granphon.dynamics.compatibility import as_wavevectors
from granphon.dynamics.linalg import cholesky_factor, graded_eigh, graded_svd, lapack_svd
from granphon.dynamics.long_waves import LongWaves

__all__ = ["ContactLattice", "Modes"]

Array = NDArray[np.float64]
#: relative difference of frequencies below which branches are treated as one degenerate set
_DEGENERATE = 1e-9
#: |q|d at which modes are computed for their limits at Gamma
_NEAR_GAMMA = 1e-30
#: |q|d below which acoustic columns are so small that they might be taken for rounding
_FAINT = 1e-80
#: |dq|d at which branches that touch with one slope are told apart
_STEP_BESIDE = 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Result):
    """Vibrations at a list of wave vectors, branches in ascending frequency; reduced units.

    Attributes
    ----------
    wavevectors : (n_q, p), 1/d.
    frequencies : (n_q, n_branches), angular, (k/M)^1/2.
    eigenvectors : (n_q, n_dof, n_branches), complex, mass-weighted, orthonormal. Degrees of freedom run over the motions of
        ball after ball: (x, y, w) in the plane, or (x, y) without friction; (x, y, z, w_x, w_y, w_z) in space. The
        displacement of a ball at r is its eigenvector times exp(i q.r).
    group_velocities : (n_q, n_branches, p), d (k/M)^1/2.
    rotational_fraction : (n_q, n_branches), the part of the kinetic energy that is rotation.
    longitudinal_fraction : (n_q, n_branches), the part of the kinetic energy that moves along q (at Gamma, along the given
        direction); the transverse part is the rest.
    """

    units = {"wavevectors": "1/d", "frequencies": "(k/M)^1/2", "group_velocities": "d (k/M)^1/2"}
    shapes = {
        "wavevectors": "q p", "frequencies": "q b", "eigenvectors": "q m b", "group_velocities": "q b p",
        "rotational_fraction": "q b", "longitudinal_fraction": "q b",
    }  # fmt: skip

    wavevectors: Array
    frequencies: Array
    eigenvectors: NDArray[np.complex128]
    group_velocities: Array
    rotational_fraction: Array
    longitudinal_fraction: Array

    @property
    def transverse_fraction(self) -> Array:
        """(n_q, n_branches), the part of the kinetic energy that moves perpendicular to q."""
        return np.clip(1.0 - self.rotational_fraction - self.longitudinal_fraction, 0.0, 1.0)


class ContactLattice(LongWaves):
    """Balls in contact on a periodic lattice, in reduced units: bands, velocities, moduli.

    :meth:`of` makes the lattice of equal balls; the constructor takes any table of contacts.
    """

    @classmethod
    def of(
        cls,
        lattice: str | Lattice,
        mindlin_ratio: float,
        spacing: float = 1.0,
        prestress: float = 0.0,
        *,
        torsion: float = 0.0,
        bending: float = 0.0,
        motions: Motions | None = None,
    ) -> ContactLattice:
        """Make the contact lattice of equal balls on ``lattice``.

        ``spacing`` a/d and ``prestress`` f/(k a) keep the terms of relative order delta/d that the paper drops: the spacing
        itself, the lever arm a/2 and the sideways push of the static force. With the default values these terms are dropped.
        ``torsion`` and ``bending`` are the stiffness of a contact against twist and rolling over k d^2. ``motions`` are
        those of each ball, by default the first that the lattice has.

        Raises :class:`~granphon.base.errors.InputError` for a number that is not finite, or out of range.
        """
        apart = positive("spacing", spacing)
        if apart >= 2.0:
            raise InputError(
                message(f"spacing is {apart:g}", "The distance of touching balls, in diameters, must be below 2")
            )
        eta, load = not_negative("mindlin_ratio", mindlin_ratio), not_negative("prestress", prestress)
        structure = find_lattice(lattice)
        moving = next(iter(allowed_motions(structure.dimension).values())) if motions is None else motions
        twist, roll = not_negative("torsion", torsion), not_negative("bending", bending)
        return cls._make_of_equal_balls(structure, eta, apart, load, twist, roll, moving)

    @classmethod
    @lru_cache(maxsize=128)
    def _make_of_equal_balls(
        cls,
        structure: Lattice,
        mindlin_ratio: float,
        spacing: float,
        prestress: float,
        torsion: float,
        bending: float,
        motions: Motions,
    ) -> ContactLattice:
        # cached, because velocities, moduli and validity of one state all start from it; it is never changed
        return cls(
            structure.vectors * spacing, structure.positions * spacing, structure.contacts.scale(spacing),
            mindlin_ratio, prestress=prestress, torsion=torsion, bending=bending, motions=motions,
            name=structure.name,
        )  # fmt: skip

    # -- vibrations -------------------------------------------------------------------------------------------------

    def frequencies(self, wavevectors: ArrayLike) -> Array:
        """Angular frequencies (n_q, n_branches), (k/M)^1/2, ascending; accurate to rounding near Gamma.

        Raises :class:`~granphon.base.errors.InstabilityError` if prestress makes a squared frequency negative.
        """
        q, _ = self._fold(wavevectors)
        values = np.concatenate([self._solve(q[part])[0] for part in self._split(len(q))])
        faint = _is_faint(q)
        if np.any(faint):
            # here sound is linear in q; its modes are displacements of the centre of mass, which come first in the frame
            size = np.max(np.abs(q[faint]), axis=1, keepdims=True)
            near, vectors = self._solve(_FAINT * (q[faint] / size))
            sound = np.sum(np.abs(vectors[:, self.motions.translating]) ** 2, axis=1) > 0.5
            values[faint] = np.sort(np.where(sound, near * (size / _FAINT), near), axis=1)
        return values

    @cached_property
    def top_frequency(self) -> float:
        """Highest frequency of all branches, (k/M)^1/2, on a coarse mesh that holds Gamma, K, M and X.

        In a large cell the mesh is coarser, because other points of the smaller zone fold onto its own.
        """
        fractions = np.arange(12) / 12.0 if self.n_balls <= 8 else np.array([0.0, 1.0 / 3.0, 0.5, 2.0 / 3.0])
        grid = np.stack(np.meshgrid(*[fractions] * self.periods), axis=-1).reshape(-1, self.periods)
        return float(self.frequencies(self.wavevectors(grid)).max())

    def _fold(self, wavevectors: ArrayLike) -> tuple[Array, Array]:
        """Return the wave vectors (n_q, p) moved near Gamma, and the reciprocal vectors that were subtracted.

        At a copy of Gamma the half angles are multiples of pi, whose sines are rounding errors.
        """
        q = as_wavevectors(wavevectors, self.periods)
        if not np.all(np.isfinite(q)):
            raise InputError(message("a wave vector is not finite"))
        taken = np.rint(q @ self.cell[:, : self.periods].T / (2.0 * np.pi)) @ self.reciprocal
        near = q - taken
        # for a copy of Gamma only the rounding of the reciprocal vector is left: set it to zero
        rounded = np.linalg.norm(near, axis=1) <= 1e-15 * np.linalg.norm(taken, axis=1)
        near[rounded & np.any(taken != 0.0, axis=1)] = 0.0
        return near, taken

    def modes(self, wavevectors: ArrayLike, direction: ArrayLike | None = None) -> Modes:
        """Find frequencies, eigenvectors and group velocities at each wave vector.

        Parameters
        ----------
        wavevectors : (n_q, p), 1/d.
        direction : (p,) or (n_q, p). Where branches touch, the modes are those that a path in this direction follows; at
            Gamma, velocities are the limit along it. By default, the direction of q.

        Raises
        ------
        InputError : q is Gamma and no direction is given: sound has no velocity without one.
        InstabilityError : prestress makes a squared frequency negative.
        """
        asked = as_wavevectors(wavevectors, self.periods)
        if direction is not None:
            along = np.broadcast_to(as_direction(direction, self.periods), asked.shape)
        elif np.all(np.any(asked != 0.0, axis=1)):
            along = as_direction(asked, self.periods)
        else:
            raise InputError(
                message("modes at Gamma need a direction", "Group velocities there depend on it", "Give direction")
            )
        q, taken = self._fold(asked)
        # at Gamma itself everything is its limit along the direction, and very near it the limit along q
        at_gamma, faint = np.all(q == 0.0, axis=1), _is_faint(q)
        limit = at_gamma | faint
        near = np.where(at_gamma[:, None], _NEAR_GAMMA * along, q)
        if np.any(faint):
            near[faint] = _NEAR_GAMMA * as_direction(q[faint], self.periods)
        parts = [self._solve_with_velocities(near[part], along[part]) for part in self._split(len(q))]
        values, vectors, velocities = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        if np.any(limit):
            values[limit] = self.frequencies(q[limit])
        # the phase of a displacement is that of the wave vector asked for
        phase = np.exp(-1j * (taken @ self.positions[:, : self.periods].T))[:, :, None, None]
        motion = (self._to_balls @ vectors).reshape(len(q), self.n_balls, self.motions.count, -1) * phase
        kinetic = np.abs(motion) ** 2
        rotation = kinetic[:, :, self.motions.turning].sum(axis=(1, 2))
        ahead = np.where(at_gamma[:, None], along, asked)
        toward = np.zeros((len(q), 3))
        toward[:, : self.periods] = as_direction(ahead, self.periods)
        displacement = motion[:, :, self.motions.translating]
        parallel = np.abs(np.einsum("qiab,qa->qib", displacement, toward[:, list(self.motions.translations)])) ** 2
        physical = motion.reshape(len(q), self.n_branches, -1)
        return Modes(asked, values, physical, velocities, rotation, parallel.sum(axis=1))

    def _solve(self, wavevectors: Array, waves: NDArray[Any] | None = None) -> tuple[Array, NDArray[Any]]:
        """Find frequencies and eigenvectors in the frame, from ``waves`` K^1/2 C M^-1/2; with prestress, from D."""
        if self.is_prestressed:
            return graded_eigh(self._compute_frame_matrix(wavevectors), self._factorise)
        return graded_svd(self._compute_real_rows(wavevectors) if waves is None else waves)

    def _factorise(self, matrices: NDArray[Any]) -> NDArray[Any]:
        """Return L^H of D = L L^H.

        Raises :class:`~granphon.base.errors.InstabilityError` if a squared frequency is negative.
        """
        try:
            return cholesky_factor(matrices)
        except np.linalg.LinAlgError:
            lowest = float(np.linalg.eigvalsh(matrices).min())
            raise InstabilityError(
                message(
                    f"a squared frequency is negative ({lowest:.3g} k/M)",
                    "The contact forces push the balls sideways more than the contacts hold them",
                    "Lower the load, or leave finite_overlap off",
                )
            ) from None

    def _solve_with_velocities(self, q: Array, along: Array) -> tuple[Array, NDArray[Any], Array]:
        """Find frequencies, eigenvectors in the frame, and group velocities; resolve degenerate sets along ``along``."""
        waves = self._compute_real_rows(q)
        values, vectors = self._solve(q, waves)
        slopes = self._make_slope_function(q, waves)
        alike: list[tuple[int, slice]] = []
        for point, start, stop in _find_runs(np.diff(values, axis=1) <= _DEGENERATE * values[:, 1:]):
            block = vectors[point][:, start:stop]
            slope, turn = np.linalg.eigh(np.einsum("abc,a->bc", slopes(point, block), along[point]))
            vectors[point][:, start:stop] = block @ turn
            alike += [(point, slice(start + a, start + b)) for _, a, b in _find_runs((np.diff(slope) <= 1e-9)[None])]
        if alike:
            # branches of equal slope separate at second order only: use the modes one step further on, where the length of
            # the step, not LAPACK's error, limits the accuracy
            points, place = np.unique([point for point, _ in alike], return_inverse=True)
            near = q[points] + _STEP_BESIDE * along[points]
            _, further = lapack_svd(
                self._factorise(self._compute_frame_matrix(near)) if self.is_prestressed else self._compute_real_rows(near)
            )
            for (point, part), there in zip(alike, place.tolist(), strict=True):
                u, _, vh = np.linalg.svd(vectors[point][:, part].conj().T @ further[there][:, part])
                vectors[point][:, part] = vectors[point][:, part] @ u @ vh
        # d(omega^2)/dq over 2 omega; a mode of zero frequency does not travel
        twice = np.where(values > 0.0, 2.0 * values, np.inf)
        diagonal = slopes(slice(None), vectors, diagonal=True)
        return values, vectors, diagonal.swapaxes(1, 2) / twice[..., None]

    def _make_slope_function(self, q: Array, waves: NDArray[Any]) -> Callable[..., NDArray[Any]]:
        """Return a function for <v_b| dD/dq_a |v_c>, D = C^H C, as 2 Re <C v_b| dC/dq_a v_c>, which is exact near Gamma too.

        The term of the prestress is subtracted.
        """
        kinds: list[tuple[NDArray[Any], NDArray[Any], Array]] = []
        for prestress in (False, True)[: 1 + self.is_prestressed]:
            rows = self._compute_real_rows(q, prestress=True) if prestress else waves
            half = self._find_half_vectors(rows)
            if prestress:
                half = -self._find_push_signs(rows) * half
            kinds.append((rows, self._compute_real_rows(q, derivative=True, prestress=prestress), half))

        def slopes(point: Any, v: NDArray[Any], diagonal: bool = False) -> NDArray[Any]:
            total: Any = 0.0
            for rows, slope, half in kinds:
                left, right = (rows[point] @ v).conj(), slope[point] @ v
                if diagonal:
                    total = total + 2.0 * half.T @ (left * right).real
                else:
                    one = np.einsum("rb,ra,rc->abc", left, half, right)
                    total = total + one + one.conj().swapaxes(-1, -2)
            return np.asarray(total)

        return slopes

    def _split(self, count: int) -> list[slice]:
        """Return slices of ``count`` wave vectors, each small enough for the memory (about 64 MB an array)."""
        size = max(1, int(4e6 / (2 * len(self.contacts) * self.n_branches)))
        return [slice(start, start + size) for start in range(0, max(count, 1), size)]


def _is_faint(q: Array) -> NDArray[np.bool_]:
    """Return (n_q,) whether each wave vector is nearly, but not exactly, Gamma."""
    size = np.max(np.abs(q), axis=1)
    return np.asarray((size > 0.0) & (size < _FAINT))


def _find_runs(joined: NDArray[np.bool_]) -> list[tuple[int, int, int]]:
    """Return (row, start, stop) of each run of items; ``joined`` (n, m - 1) says whether item j + 1 belongs with item j."""
    found = []
    for row in np.flatnonzero(joined.any(axis=1)):
        edges = np.flatnonzero(~np.concatenate([[False], joined[row], [False]]))
        found += [(int(row), int(a), int(b)) for a, b in itertools.pairwise(edges) if b - a > 1]
    return found
