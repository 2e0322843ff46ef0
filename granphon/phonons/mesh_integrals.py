"""Integrals over the Brillouin zone by the linear tetrahedron method, on a mesh that symmetry reduces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from phonopy.phonon.mesh import Mesh
from phonopy.phonon.tetrahedron_method import get_integration_weights

Array = NDArray[np.float64]
#: number of wave vectors, of similar frequencies, whose weights are computed together
_POINTS_TOGETHER = 128


def integrate_tetrahedra(grid: Mesh, frequencies: Array, parts: Array, limits: Array) -> Array:
    """Return the number of modes per cell below each limit, (n_parts, n), each mode counted with its parts.

    Parameters
    ----------
    grid : the mesh, whose ``qpoints`` have the ``frequencies``.
    frequencies : (n_q, n_branches).
    parts : (n_parts, n_q, n_branches), what of each mode is counted.
    limits : (n,), ascending.

    Notes
    -----
    Phonopy computes a weight for each mode and limit. It is zero below all frequencies of the neighbouring points and one
    above them; only what lies between is asked of phonopy, which saves most of the time and of the memory.
    """
    zone = grid.bz_grid
    reduced = np.searchsorted(grid.ir_grid_points, grid.grid_mapping_table)
    counted = np.zeros((len(parts), len(limits)))
    for branch in range(frequencies.shape[1]):
        values, share = frequencies[:, [branch]], parts[:, :, branch] * grid.weights
        low, high = (bound[grid.ir_grid_points] for bound in _find_bounds(values[reduced, 0], zone.D_diag))
        order = np.argsort(low, kind="stable")
        for points in np.array_split(order, -(-len(order) // _POINTS_TOGETHER)):
            first = int(np.searchsorted(limits, low[points].min()))
            last = int(np.searchsorted(limits, high[points].max(), side="right"))
            if last > first:
                weights = get_integration_weights(
                    limits[first:last], values, zone, grid_points=zone.grg2bzg[grid.ir_grid_points[points]],
                    bzgp2irgp_map=reduced[zone.bzg2grg], function="J",
                )  # fmt: skip
                counted[:, first:last] += np.einsum("pq,qn->pn", share[:, points], weights[:, :, 0])
            counted[:, last:] += share[:, points].sum(axis=1)[:, None]
    return np.asarray(counted / np.prod(zone.D_diag))


def _find_bounds(values: Array, numbers: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return the least and the greatest of the values (n,) of each mesh point and its neighbours along the three axes."""
    whole = values.reshape(numbers[::-1])
    low = high = whole
    for axis in range(3):
        low = np.minimum(low, np.minimum(np.roll(low, 1, axis), np.roll(low, -1, axis)))
        high = np.maximum(high, np.maximum(np.roll(high, 1, axis), np.roll(high, -1, axis)))
    return low.ravel(), high.ravel()
