"""The Brillouin zone of a lattice: a polygon in the plane, faces in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
#: corners of the zone that are closer than this part of its size are one corner
_SAME = 1e-6


def zone_polygon(reciprocal: ArrayLike) -> Array:
    """Find the corners (n, 2), anticlockwise, of the Brillouin zone: the Wigner-Seitz cell of the rows of ``reciprocal``.

    ``reciprocal`` is (2, 2); the corners have its unit.
    """
    a, b = short = _reduce(reciprocal)
    b = -b if a @ b > 0.0 else b
    # the angle of a and b is at least 90 degrees, so that these are the neighbours of the origin in turn; each corner of the
    # zone is as far from two successive neighbours as from the origin
    g = np.array([a, a + b, b, -a, -a - b, -b])
    both = np.stack([g, np.roll(g, -1, axis=0)], axis=1)
    found = np.linalg.solve(both, 0.5 * np.sum(both**2, axis=2)[..., None])[..., 0]
    found = found[np.argsort(np.arctan2(found[:, 1], found[:, 0]))]
    apart = np.linalg.norm(found - np.roll(found, 1, axis=0), axis=1) > _SAME * np.linalg.norm(short)
    return np.asarray(found[apart])


def zone_faces(reciprocal: ArrayLike) -> list[Array]:
    """Find the faces of the Brillouin zone in space: the Wigner-Seitz cell of the rows of ``reciprocal``.

    ``reciprocal`` is (3, 3). Each face is (n, 3), its corners in turn, anticlockwise as seen from outside, in the same unit.
    """
    # imported here, as only a zone in space needs it
    from ase.dft.bz import bz_vertices

    short, faces = _reduce(reciprocal), []
    size = float(np.linalg.norm(short, axis=1).max())
    for ring, outward in bz_vertices(short / size):
        # a neighbour that the zone touches in an edge or a corner only gives a face without area
        corners = ring[np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1) > _SAME]
        area = np.sum(np.cross(corners[1:-1] - corners[0], corners[2:] - corners[0]), axis=0) if len(corners) > 2 else 0.0
        if np.linalg.norm(area) > _SAME:
            faces.append(np.asarray(corners[:: 1 if area @ outward > 0.0 else -1] * size))
    return faces


def _reduce(reciprocal: ArrayLike) -> Array:
    """Return the shortest vectors (p, p) of the lattice of the rows of ``reciprocal``, p = 2 or 3."""
    # imported here, as only a figure with a zone needs it
    from ase.geometry.minkowski_reduction import minkowski_reduce

    given = np.asarray(reciprocal, dtype=np.float64)
    p, cell = len(given), np.eye(3)
    cell[:p, :p] = given
    return np.asarray(minkowski_reduce(cell, pbc=np.arange(3) < p)[0][:p, :p])
