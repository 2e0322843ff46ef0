"""Branches followed along a path by the overlap of their eigenvectors, and the pulses that travel on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.arguments import real_array
from granphon.errors import GranphonError, InputError, UnreachableFrequencyError, message
from granphon.geometry import as_direction
from granphon.lattice import ContactLattice

__all__ = ["AcousticBranch", "acoustic_branches", "connect_branches", "zone_boundary"]

Array = NDArray[np.float64]
#: points along the path on which the branches are told apart
_POINTS = 128


def connect_branches(eigenvectors: ArrayLike) -> NDArray[np.intp]:
    """Follow branches along a path by the overlap of their eigenvectors, through crossings.

    Parameters
    ----------
    eigenvectors : (n_q, n_dof, n_branches), columns in any order at each point. Points where branches touch must carry the
        eigenvectors of the limit along the path, as :meth:`ContactLattice.modes` gives them.

    Returns
    -------
    (n_q, n_branches): ``np.take_along_axis(frequencies, order, 1)`` is smooth; the first row counts up.
    """
    vectors = np.asarray(eigenvectors)
    overlap = np.abs(np.einsum("qma,qmb->qab", vectors[:-1].conj(), vectors[1:])) ** 2
    order = np.empty(vectors.shape[::2], np.intp)
    order[0] = np.arange(vectors.shape[2])
    # where each branch has a continuation of its own that overlaps most, that is the best assignment
    best = np.argmax(overlap, axis=2)
    clear = np.all(np.sort(best, axis=1) == order[0], axis=1)
    for point, matrix in enumerate(overlap):
        columns = best[point]
        if not clear[point]:
            from scipy.optimize import linear_sum_assignment

            _, columns = linear_sum_assignment(matrix, maximize=True)
        order[point + 1] = columns[order[point]]
    return order


def zone_boundary(lattice: ContactLattice, direction: ArrayLike) -> float:
    """Distance from Gamma to the edge of the Brillouin zone in ``direction``, 1/d."""
    along = as_direction(direction)
    steps = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    vectors = steps[np.any(steps != 0, axis=1)] @ lattice.reciprocal
    ahead = vectors @ along
    forward = ahead > 1e-9 * np.linalg.norm(vectors, axis=1)
    return float(np.min(np.sum(vectors[forward] ** 2, axis=1) / (2.0 * ahead[forward])))


@dataclass(frozen=True)
class AcousticBranch:
    """One acoustic branch along a direction, from Gamma up to its first maximum or the zone edge.

    Attributes
    ----------
    name : "longitudinal" or "transverse" (of the polarisation at long waves).
    wavenumbers, frequencies : (n,) ascending, 1/d and (k/M)^1/2; the last is the top of the branch.
    vectors : (n, n_dof) eigenvectors, by which the branch is recognised between the points.
    """

    lattice: ContactLattice
    direction: Array
    name: str
    wavenumbers: Array
    frequencies: Array
    vectors: NDArray[np.complex128]

    @property
    def top(self) -> float:
        """Highest frequency a pulse on this branch can have, (k/M)^1/2."""
        return float(self.frequencies[-1])

    def at(self, wavenumbers: Array, references: NDArray[np.complex128]) -> tuple[Array, Array]:
        """Frequency and group velocity along the direction of the branch nearest to the reference eigenvectors."""
        modes = self.lattice.modes(wavenumbers[:, None] * self.direction, self.direction)
        overlap = np.abs(np.einsum("qm,qmb->qb", references.conj(), modes.eigenvectors))
        pick = np.argmax(overlap, axis=1)[:, None]
        ahead = modes.group_velocities @ self.direction
        return np.take_along_axis(modes.frequencies, pick, 1)[:, 0], np.take_along_axis(ahead, pick, 1)[:, 0]

    def wavenumber(self, frequency: ArrayLike) -> tuple[Array, Array]:
        """Wavenumber (1/d) and group velocity at each angular frequency (n,), to rounding.

        Raises :class:`~granphon.errors.UnreachableFrequencyError` above the top of the branch.
        """
        target = np.atleast_1d(real_array("frequency", frequency))
        if np.any(target > self.top):
            raise UnreachableFrequencyError(
                message(f"the {self.name} branch ends at {self.top:.10g} (k/M)^1/2, below {float(target.max()):.10g}")
            )
        right = np.searchsorted(self.frequencies, target).clip(max=len(self.frequencies) - 1)
        low = np.where(right > 0, self.wavenumbers[right - 1], 0.0)
        low_f = np.where(right > 0, self.frequencies[right - 1], 0.0)
        high = np.array(self.wavenumbers[right])
        reference = self.vectors[right]
        # the branch is nearly straight below the first point, so that interpolation starts close at any scale
        x = low + (high - low) * (target - low_f) / (self.frequencies[right] - low_f)
        value, slope = self.at(x, reference)
        going = np.arange(x.size)
        for _ in range(200):
            goal, here, at = target[going], x[going], value[going]
            high[going] = np.where(at >= goal, here, high[going])
            low[going] = np.where(at <= goal, here, low[going])
            step = np.divide(at - goal, slope[going], out=np.full_like(here, np.inf), where=slope[going] > 0.0)
            inside = (here - step >= low[going]) & (here - step <= high[going])
            x[going] = np.where(inside, here - step, 0.5 * (low[going] + high[going]))
            value[going], slope[going] = self.at(x[going], reference[going])
            # Newton's steps halve their exponents: after one as small as this only rounding is left
            going = going[np.abs(x[going] - here) > 1e-13 * here]
            if not going.size:
                break
        if np.any(np.abs(value - target) > 1e-11 * target):
            raise GranphonError(
                message(
                    f"the {self.name} branch could not be followed along {self.direction}",
                    "It changes its character too fast, at an avoided crossing",
                    "Choose another direction",
                )
            )
        return x, slope


def acoustic_branches(lattice: ContactLattice, direction: ArrayLike) -> dict[str, AcousticBranch]:
    """The longitudinal and the transverse branch along ``direction``, followed through crossings."""
    along = as_direction(direction)
    if along.shape != (2,):
        raise InputError(message("a branch is followed in one direction", mend="Give two numbers (x, y)"))
    edge = zone_boundary(lattice, along)
    grid = np.linspace(0.0, edge, _POINTS + 1)[1:]
    modes = lattice.modes(grid[:, None] * along, along)
    order = connect_branches(modes.eigenvectors)
    _, polarisations = lattice.sound_velocities(along)
    start = lattice.modes([1e-6 * grid[0] * along], along)
    first = np.argmax(np.abs(np.einsum("ma,mb->ab", start.eigenvectors[0].conj(), modes.eigenvectors[0])), axis=1)
    # sound moves the centre of mass; what else has no frequency at Gamma, as gears that turn, does not
    motion = start.eigenvectors[0].reshape(lattice.n_balls, lattice.dofs_per_ball, -1)[:, :2]
    drift = np.abs(polarisations.T @ np.einsum("i,iab->ab", np.sqrt(lattice.masses), motion))
    longitudinal, transverse = np.argmax(drift, axis=1).tolist()
    branches = {}
    for name, column in (("longitudinal", longitudinal), ("transverse", transverse)):
        pick = order[:, int(first[column])][:, None]
        values = np.take_along_axis(modes.frequencies, pick, 1)[:, 0]
        slopes = np.take_along_axis(modes.group_velocities @ along, pick, 1)[:, 0]
        vectors = np.take_along_axis(modes.eigenvectors, pick[:, None], 2)[:, :, 0]
        branch = AcousticBranch(lattice, along, name, grid, values, vectors)
        falling = np.flatnonzero(slopes <= 0.0)
        if falling.size:
            branch = _cut_at_maximum(branch, int(falling[0]))
        branches[name] = branch
    return branches


def _cut_at_maximum(branch: AcousticBranch, falling: int) -> AcousticBranch:
    """The part of ``branch`` below the maximum that lies before its point ``falling``."""
    reference = branch.vectors[falling][None]
    low = branch.wavenumbers[falling - 1] if falling else 0.0
    high = branch.wavenumbers[falling]
    while high - low > 4e-16 * high:
        points = np.linspace(low, high, 34)[1:-1]
        rising = branch.at(points, np.broadcast_to(reference, (32, reference.shape[1])))[1] > 0.0
        first = int(np.argmin(np.append(rising, False)))
        edges = np.concatenate([[low], points, [high]])
        if (edges[first], edges[first + 1]) == (low, high):
            break
        low, high = float(edges[first]), float(edges[first + 1])
    top = branch.at(np.array([low]), reference)[0]
    return AcousticBranch(
        branch.lattice, branch.direction, branch.name,
        np.append(branch.wavenumbers[:falling], low), np.append(branch.frequencies[:falling], top),
        np.concatenate([branch.vectors[:falling], reference]),
    )  # fmt: skip
