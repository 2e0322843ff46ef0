"""The data of a lattice for a page: balls, rows of contacts, motions, path and zone."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from granphon.balls.lattices import Lattice
from granphon.balls.layers import find_outer
from granphon.balls.motions import ALL, Motions, allowed_motions, select_motions
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.rows import Row, contact_rows, push_rows
from granphon.phonons.paths import (
    BandPath,
    default_letters,
    special_points,
    split_letters,
    zone_faces,
    zone_polygon,
)


def describe_lattice(packing: Packing, path: BandPath) -> dict[str, Any]:
    """Return the data of the lattice of a packing for a page, as plain numbers and texts.

    Lengths are in spacings of touching balls. ``rows`` are the rows of
    :mod:`granphon.dynamics.rows`, for all six motions of each ball and stiffnesses of 1: a page
    takes the motions that the page shows, and weights each kind by the root of its stiffness.
    ``statements`` name, for each set of motions and each choice of the kinds of stiffness, the free
    branches of the lattice and its mechanism.
    """
    structure = packing.structure
    whole = ContactLattice.of(structure, 1.0, torsion=1.0, bending=1.0, motions=ALL)
    return {
        **_describe_cell(whole, structure.name, path),
        "gyration": float(whole.gyration[0]),
        "rows": [
            _describe_row(row) for row in (*whole.rows, *push_rows(whole.contacts.normal, ALL))
        ],
        "motions": [
            _describe_motions(structure, motions)
            for motions in allowed_motions(structure.dimension).values()
        ],
    }


def describe_network(lattice: ContactLattice, name: str) -> dict[str, Any]:
    """Return the data of the lattice of a network for a page, as :func:`describe_lattice` does.

    Rows have ``weights``, the stiffness of each contact, so that the page takes a stiffness of 1
    for each kind; each ball has its own mass and radius of gyration. ``complex`` says whether the
    rows of a single ball are complex. In a cut, ``sides`` are -1 for balls in the lower quarter, 1
    for balls in the upper quarter, and 0 for all other balls; without a cut ``sides`` is None.
    """
    if lattice.has_tangential_force:
        problem = "a page draws no bands under static tangential forces"
        mend = "Give a network without prestress"
        raise InputError(problem, mend=mend)
    table = lattice.contacts
    motions = lattice.named_motions
    periods = lattice.periods
    vectors = lattice.cell[:, :periods]
    repeats = (True,) * periods
    corners = special_points(vectors, repeats)
    pieces = [list(piece) for piece in split_letters(default_letters(vectors, repeats))]
    points: Any = [[corners[letter].tolist() for letter in piece] for piece in pieces]
    path = BandPath(points, tuple(itertools.chain.from_iterable(pieces)))
    gyration = np.append(lattice.gyration, 1.0)  # the last value is that of a body at rest
    ratios = {"slip": lattice.mindlin_ratio, "twist": lattice.torsion, "roll": lattice.bending}
    rows = contact_rows(
        table.normal,
        table.arm_i,
        table.arm_j,
        ALL,
        **ratios,
        gyration_i=gyration[table.i],
        gyration_j=gyration[table.j],
    )
    weights = [
        (row, np.broadcast_to(row.stiffness, len(table)) * lattice.stiffness) for row in rows
    ]
    if lattice.is_prestressed:
        weights += [(row, lattice.prestress) for row in push_rows(table.normal, ALL)]
    mechanism = "Bodies that do not move hold the balls" if lattice.is_held else lattice.mechanism
    statement = {
        "rotate": lattice.motions.rotate,
        "free": lattice.free_branches,
        "warnings": list(lattice.free_branch_warnings),
        "mechanism": mechanism,
    }
    kinds = "".join(str(int(np.any(ratio))) for ratio in ratios.values())
    heights = lattice.positions[:, periods] if periods < lattice.dimension else np.zeros(1)
    lower, upper = find_outer(heights).astype(int)
    return {
        **_describe_cell(lattice, name, path),
        "sides": (upper - lower).tolist() if np.any(upper != lower) else None,
        "gyration": lattice.gyration.tolist(),
        "masses": lattice.masses.tolist(),
        "complex": np.iscomplexobj(lattice.compatibility(np.zeros((1, periods)))),
        "rows": [{**_describe_row(row), "weights": weight.tolist()} for row, weight in weights],
        "motions": [
            {
                "name": motions.name,
                "translations": list(motions.translations),
                "rotations": list(motions.rotations),
                "twist": motions.twist,
                "waves": list(lattice.wave_names),
                "statements": {kinds: statement},
            }
        ],
    }


def _describe_row(row: Row) -> dict[str, Any]:
    return {"kind": row.kind, "head": row.head.tolist(), "tail": row.tail.tolist()}


def _describe_cell(lattice: ContactLattice, name: str, path: BandPath) -> dict[str, Any]:
    table = lattice.contacts
    p = lattice.periods
    reciprocal = lattice.reciprocal
    labels = list(path.labels or ())
    pieces = []
    for points in path.arrays:
        if path.labels:
            names = [labels.pop(0) for _ in points]
        else:
            names = [" ".join(f"{x:.3g}" for x in q) for q in points]
        pieces.append({"points": points.tolist(), "labels": names})
    if p == 3:
        faces = zone_faces(reciprocal)
    elif p == 2:
        faces = [_pad(zone_polygon(reciprocal))]
    else:
        faces = [_pad(np.array([[-0.5], [0.5]]) * reciprocal[0])]
    return {
        "name": name,
        "periods": p,
        "dimension": lattice.dimension,
        "cell": _pad(lattice.cell).tolist(),
        "reciprocal": _pad(reciprocal).tolist(),
        "measure": lattice.measure,
        "positions": _pad(lattice.positions).tolist(),
        "contacts": {
            "i": table.i.tolist(),
            "j": table.j.tolist(),
            "shift": table.shift.tolist(),
            "vector": _pad(table.vector).tolist(),
        },
        "path": pieces,
        "zone": [face.tolist() for face in faces],
    }


def _pad(vectors: Array) -> Array:
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def _describe_motions(structure: Lattice, motions: Motions) -> dict[str, Any]:
    """Return the axes of a set of motions, and the statements for each choice of the kinds of
    stiffness.
    """
    statements = {}
    for kinds in itertools.product((False, True), repeat=3):
        eta, torsion, bending = map(float, kinds)
        lattice = ContactLattice.of(
            structure, eta, torsion=torsion, bending=bending, motions=motions
        )
        statements["".join(str(int(kind)) for kind in kinds)] = {
            "rotate": select_motions(eta, torsion, bending, motions).rotate,
            "free": lattice.free_branches,
            "warnings": list(lattice.free_branch_warnings),
            "mechanism": lattice.mechanism,
        }
    return {
        "name": motions.name,
        "translations": list(motions.translations),
        "rotations": list(motions.rotations),
        "twist": motions.twist,
        "waves": list(lattice.wave_names),
        "statements": statements,
    }
