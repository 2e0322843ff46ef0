"""The lattice of contacts and its vibrations.

The frequencies are the singular values of K^1/2 C(q) M^-1/2. Everything is in reduced units: length d, stiffness k, mass M.
"""

from __future__ import annotations

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
from granphon.dynamics.free_motions import FreeMotions

Array = NDArray[np.float64]
#: |q|d at which modes are computed for their limits at Gamma; nearer to it, each branch is a power of |q|
_NEAR_GAMMA = 1e-30


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
        direction).
    out_of_plane_fraction : (n_q, n_branches), the part of the kinetic energy that moves across a plane of balls; 0 on a line
        and in space. The transverse part is the rest.
    """

    units = {"wavevectors": "1/d", "frequencies": "(k/M)^1/2", "group_velocities": "d (k/M)^1/2"}
    _shapes = {
        "wavevectors": "q p", "frequencies": "q b", "eigenvectors": "q m b", "group_velocities": "q b p",
        "rotational_fraction": "q b", "longitudinal_fraction": "q b", "out_of_plane_fraction": "q b",
    }  # fmt: skip

    wavevectors: Array
    frequencies: Array
    eigenvectors: NDArray[np.complex128]
    group_velocities: Array
    rotational_fraction: Array
    longitudinal_fraction: Array
    out_of_plane_fraction: Array

    @property
    def transverse_fraction(self) -> Array:
        """(n_q, n_branches), the part of the kinetic energy that moves perpendicular to q; in a plane, within it."""
        rest = self.rotational_fraction + self.longitudinal_fraction + self.out_of_plane_fraction
        return np.clip(1.0 - rest, 0.0, 1.0)


class ContactLattice(FreeMotions):
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
        """Make the contact lattice of equal balls on ``lattice``, whose contacts have the ``mindlin_ratio`` eta.

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

        ``wavevectors`` are (n_q, p), 1/d. Branches that vanish at every q, and modes that vanish at this one, are exactly
        zero.

        Raises :class:`~granphon.base.errors.InstabilityError` if prestress makes a squared frequency negative.
        """
        q, _ = self._fold(wavevectors)
        values = np.concatenate([self._solve(q[part]) for part in self._split(len(q))])
        faint = _is_faint(q)
        if np.any(faint):
            near = _NEAR_GAMMA * as_direction(q[faint], self.periods)
            values[faint] = _follow_powers(q[faint], near, *self._solve_with_velocities(near, near / _NEAR_GAMMA))[0]
        return values

    @cached_property
    def top_frequency(self) -> float:
        """Highest frequency of all branches, (k/M)^1/2, on a coarse mesh that holds Gamma, K, M and X.

        In a large cell the mesh is coarser, because other points of the smaller zone fold onto its own.
        """
        fractions = np.arange(12) / 12.0 if self.n_balls <= 8 else np.array([0.0, 1.0 / 3.0, 0.5, 2.0 / 3.0])
        grid = np.stack(np.meshgrid(*[fractions] * self.periods), axis=-1).reshape(-1, self.periods)
        return float(self.frequencies(self.wavevectors(grid)).max())

    def modes(self, wavevectors: ArrayLike, direction: ArrayLike | None = None) -> Modes:
        """Find frequencies, eigenvectors and group velocities at each wave vector.

        Parameters
        ----------
        wavevectors : (n_q, p), 1/d.
        direction : (p,) or (n_q, p). Where branches touch, the modes are those that a path in this direction follows; at
            Gamma, and wherever a mode vanishes, velocities are the limit along it. By default, the direction of q.

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
        near = np.where(at_gamma[:, None], _NEAR_GAMMA * along, q)
        if np.any(faint):
            near[faint] = _NEAR_GAMMA * as_direction(q[faint], self.periods)
        parts = [self._solve_with_velocities(near[part], along[part]) for part in self._split(len(q))]
        values, vectors, velocities = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        limit = at_gamma | faint
        if np.any(limit):
            found = _follow_powers(q[limit], near[limit], values[limit], vectors[limit], velocities[limit])
            values[limit], vectors[limit], velocities[limit] = found
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
        beside = np.zeros_like(values)
        if self.periods == 2 and 2 in self.motions.translations:
            beside = kinetic[:, :, self.motions.translations.index(2)].sum(axis=1)
        physical = motion.reshape(len(q), self.n_branches, -1)
        return Modes(asked, values, physical, velocities, rotation, parallel.sum(axis=1), beside)

    def _solve(self, q: Array) -> Array:
        """Find frequencies."""
        try:
            values = [block.solve(q)[0] for block in self._blocks]
        except InstabilityError:
            raise self._find_buckling(q) from None
        return values[0] if len(values) == 1 else np.sort(np.concatenate(values, axis=1), axis=1)

    def _solve_with_velocities(self, q: Array, along: Array) -> tuple[Array, NDArray[Any], Array]:
        """Find frequencies, eigenvectors in the frame, and group velocities; resolve degenerate sets along ``along``."""
        try:
            found = self._join([block.solve_with_velocities(q, along) for block in self._blocks])
        except InstabilityError:
            raise self._find_buckling(q) from None
        if len(self._blocks) > 1:  # modes of zero frequency in the order that they have beside the point
            values, vectors, velocities = found
            zeros = np.count_nonzero(values == 0.0, axis=1)
            for at in np.flatnonzero(zeros > self.free_branches).tolist():
                order = np.argsort(velocities[at, : zeros[at]] @ along[at], kind="stable")
                vectors[at, :, : zeros[at]] = vectors[at][:, order]
                velocities[at, : zeros[at]] = velocities[at, order]
        return found

    def _find_buckling(self, q: Array) -> InstabilityError:
        """Return the error that names the wave vector, among ``q``, of the lowest squared frequency, which is negative."""
        squared, vectors = np.linalg.eigh(self._compute_frame_matrix(q))
        place = int(np.argmin(squared[:, 0]))
        where = f"a squared frequency at {self.name_place(q[place])} is negative, {squared[place, 0]:.3g} k/M"
        motion = (self._to_balls @ vectors[place, :, 0]).reshape(self.n_balls, -1)[:, self.motions.translating]
        return self.explain_buckling(where, motion.T)

    def _join(self, found: list[tuple[Array, NDArray[Any], Array]]) -> tuple[Array, NDArray[Any], Array]:
        """Return the frequencies, eigenvectors and velocities of all blocks as those of the lattice, ascending."""
        if len(found) == 1:
            return found[0]
        values, velocities = (np.concatenate([one[i] for one in found], axis=1) for i in (0, 2))
        vectors = np.zeros((len(values), self.n_branches, self.n_branches), np.result_type(*(one[1] for one in found)))
        first = 0
        for block, (_, own, _) in zip(self._blocks, found, strict=True):
            vectors[:, block.columns, first : first + block.size] = own
            first += block.size
        return _sort_branches(values, vectors, velocities)

    def _split(self, count: int) -> list[slice]:
        """Return slices of ``count`` wave vectors, each small enough for the memory (about 64 MB an array)."""
        size = max(1, int(4e6 / (2 * len(self.contacts) * self.n_branches)))
        return [slice(start, start + size) for start in range(0, max(count, 1), size)]


def _is_faint(q: Array) -> NDArray[np.bool_]:
    """Return (n_q,) whether each wave vector is nearly, but not exactly, Gamma."""
    size = np.max(np.abs(q), axis=1)
    return np.asarray((size > 0.0) & (size < _NEAR_GAMMA))


def _sort_branches(values: Array, vectors: NDArray[Any], velocities: Array) -> tuple[Array, NDArray[Any], Array]:
    """Return frequencies, eigenvectors and velocities with the frequencies ascending."""
    order = np.argsort(values, axis=1, kind="stable")
    return (
        np.take_along_axis(values, order, 1), np.take_along_axis(vectors, order[:, None], 2),
        np.take_along_axis(velocities, order[..., None], 1),
    )  # fmt: skip


def _follow_powers(
    q: Array, near: Array, values: Array, vectors: NDArray[Any], velocities: Array
) -> tuple[Array, NDArray[Any], Array]:
    """Return frequencies, eigenvectors and velocities at ``q`` (n_q, p), from those at ``near``, longer but as directed.

    There each branch is a power of |q|: the first for sound, the second or third for a flexural branch, none for others.
    """
    slope = np.einsum("qa,qba->qb", near, velocities)
    power = np.maximum(np.rint(np.divide(slope, values, out=np.zeros_like(values), where=values > 0.0)), 0.0)
    ratio = (np.max(np.abs(q), axis=1) / np.max(np.abs(near), axis=1))[:, None]
    return _sort_branches(values * ratio**power, vectors, velocities * (ratio ** np.maximum(power - 1.0, 0.0))[..., None])
