"""What a page knows of a lattice: its balls, the rows of its contacts, its motions, its path and its zone."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.lattices import Lattice
from granphon.balls.motions import ALL, Motions, allowed_motions, select_motions
from granphon.balls.packing import Packing
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.rows import push_rows
from granphon.phonons.paths import BandPath
from granphon.phonons.zones import zone_faces, zone_polygon

Array = NDArray[np.float64]


def describe_lattice(packing: Packing, path: BandPath) -> dict[str, Any]:
    """Return what a page needs of the lattice of a packing, as plain numbers and texts.

    Lengths are in spacings of touching balls. ``rows`` are those of :mod:`granphon.dynamics.rows`, for all six motions of
    each ball and stiffnesses of one: a page takes the motions that it shows, and weights each kind by the root of its
    stiffness. ``statements`` say, for each set of motions and each choice of the kinds of stiffness, what the lattice is
    then called: its free branches, and the mechanism that it is.
    """
    structure = packing.structure
    whole = ContactLattice.of(structure, 1.0, torsion=1.0, bending=1.0, motions=ALL)
    table, p = whole.contacts, structure.periods
    reciprocal = whole.reciprocal
    labels, pieces = list(path.labels or ()), []
    for points in path.arrays:
        names = [labels.pop(0) for _ in points] if path.labels else [" ".join(f"{x:.3g}" for x in q) for q in points]
        pieces.append({"points": points.tolist(), "labels": names})
    if p == 3:
        faces = [face.tolist() for face in zone_faces(reciprocal)]
    else:  # one, in the plane
        faces = [_pad(zone_polygon(reciprocal) if p == 2 else np.array([[-0.5], [0.5]]) * reciprocal[0]).tolist()]
    return {
        "name": structure.name,
        "periods": p,
        "dimension": structure.dimension,
        "cell": _pad(structure.vectors).tolist(),
        "reciprocal": _pad(reciprocal).tolist(),
        "measure": structure.measure,
        "positions": _pad(structure.positions).tolist(),
        "contacts": {
            "i": table.i.tolist(), "j": table.j.tolist(), "shift": table.shift.tolist(),
            "vector": _pad(table.vector).tolist(),
        },
        "gyration": float(whole.gyration[0]),
        "rows": [
            {"kind": row.kind, "head": row.head.tolist(), "tail": row.tail.tolist()}
            for row in (*whole.rows, *push_rows(table.normal, ALL))
        ],
        "motions": [_describe_motions(structure, motions) for motions in allowed_motions(structure.dimension).values()],
        "path": pieces,
        "zone": faces,
    }  # fmt: skip


def _pad(vectors: Array) -> Array:
    """Return vectors (n, d) as vectors (n, 3)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def _describe_motions(structure: Lattice, motions: Motions) -> dict[str, Any]:
    """Return the axes of a set of motions, and what the lattice is with each choice of the kinds of stiffness."""
    statements = {}
    for kinds in itertools.product((False, True), repeat=3):
        eta, torsion, bending = map(float, kinds)
        lattice = ContactLattice.of(structure, eta, torsion=torsion, bending=bending, motions=motions)
        statements["".join(str(int(one)) for one in kinds)] = {
            "rotate": select_motions(eta, torsion, bending, motions).rotate,
            "free": lattice.free_branches,
            "warnings": list(lattice.free_branch_warnings),
            "mechanism": lattice.mechanism,
        }
    return {
        "name": motions.name, "translations": list(motions.translations), "rotations": list(motions.rotations),
        "twist": motions.twist, "waves": list(lattice.wave_names), "statements": statements,
    }  # fmt: skip
