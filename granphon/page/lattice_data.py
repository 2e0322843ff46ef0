"""The data of a lattice for a page: balls, rows of contacts, motions, path and zone."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.lattices import Lattice
from granphon.balls.layers import find_outer
from granphon.balls.motions import ALL, Motions, allowed_motions, select_motions
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.deformation_rows import Row, push_rows
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
    :mod:`granphon.dynamics.deformation_rows`, for all six motions of each ball and stiffnesses of
    1: a page takes the motions that the page shows, and weights each kind by the root of its
    stiffness. ``motions`` has an entry for each set of motions. The ``statements`` of an entry name
    the free branches and the mechanism of the lattice for each choice of the kinds of stiffness.
    """
    structure = packing.structure
    lattice = ContactLattice.of(structure, 1.0, torsion=1.0, bending=1.0, motions=ALL)
    rows = [*lattice.rows, *push_rows(lattice.contacts.normal, ALL)]
    all_motions = allowed_motions(structure.dimension).values()
    return {
        **_describe_cell(lattice, structure.name, path),
        "gyration": float(lattice.gyration[0]),
        "rows": [_describe_row(row) for row in rows],
        "motions": [_describe_motions(structure, motions) for motions in all_motions],
    }


def describe_network(lattice: ContactLattice, name: str) -> dict[str, Any]:
    """Return the data of the lattice of a network for a page, with the entries of
    :func:`describe_lattice`, in the units of the ``lattice``.

    The network is called ``name``. Rows have ``weights``, see :func:`_list_weighted_rows`, so that
    the page takes a stiffness of 1 for each kind; each ball has its own mass and radius of
    gyration. ``complex`` says whether C(q) is complex, as it always is for a cell of several balls.
    In a cut, ``sides`` are -1 for balls in the lower quarter, 1 for balls in the upper quarter, and
    0 for all other balls; ``sides`` is None without a cut, and in one of a single layer.

    Raises :class:`~granphon.base.errors.InputError` for static tangential forces or torques, and
    for slip by levers that exceed the arms.
    """
    if lattice.lacks_potential:
        raise InputError(
            "a page draws no bands under static tangential forces or torques, nor of slip by the"
            " radii",
            mend="Give a network without prestress",
        )
    motions = lattice.named_motions
    periods = lattice.periods
    holder = "Springs to the ground" if lattice.is_anchored else "Bodies that do not move"
    mechanism = f"{holder} hold the balls" if lattice.is_held else lattice.mechanism
    statement = {
        "rotate": lattice.motions.rotate,
        "free": lattice.free_branches,
        "warnings": list(lattice.free_branch_warnings),
        "mechanism": mechanism,
    }
    kinds = _write_key(lattice.mindlin_ratio, lattice.torsion, lattice.bending)
    heights = np.zeros(1)  # without a cut no ball is at an edge
    is_cut = periods < lattice.dimension
    if is_cut:
        heights = lattice.positions[:, periods]
    lower, upper = find_outer(heights).astype(int)
    sides = upper - lower
    rows = []
    for row, weights in _list_weighted_rows(lattice):
        rows.append({**_describe_row(row), "weights": weights.tolist()})
    return {
        **_describe_cell(lattice, name, _find_default_path(lattice)),
        "sides": sides.tolist() if np.any(sides) else None,
        "gyration": lattice.gyration.tolist(),
        "masses": lattice.masses.tolist(),
        "complex": np.iscomplexobj(lattice.compatibility(np.zeros((1, periods)))),
        "rows": rows,
        "motions": [_describe_axes(lattice, motions) | {"statements": {kinds: statement}}],
    }


def _list_weighted_rows(lattice: ContactLattice) -> list[tuple[Row, Array]]:
    """Return the rows of the contacts and of springs to the ground, for all six motions of each
    ball, each with its stiffness (n_c,) in units of k, of twist and roll in units of k d^2.

    Under static forces rows of the kind "push" follow, with f/(k l) of each contact, where f is the
    normal force and l the distance between the two centres: above zero where f presses the balls
    together, below where it pulls. The page subtracts the squares of these rows from D, as a force
    that presses weakens a lattice.
    """
    table = lattice.contacts
    rows = lattice.make_rows(ALL)
    weighted_rows = []
    for row in rows:
        ratio = np.broadcast_to(row.stiffness, len(table))
        weighted_rows.append((row, ratio * lattice.stiffness))
    if lattice.is_prestressed:
        weighted_rows += [(row, lattice.prestress) for row in push_rows(table.normal, ALL)]
    return weighted_rows


def _find_default_path(lattice: ContactLattice) -> BandPath:
    """Return the path around the irreducible zone of a lattice, with the letters of
    :func:`~granphon.phonons.paths.default_letters`.
    """
    periods = lattice.periods
    vectors = lattice.cell[:, :periods]
    repeats = (True,) * periods
    corners = special_points(vectors, repeats)
    pieces = split_letters(default_letters(vectors, repeats))
    points: Any = [[corners[letter].tolist() for letter in piece] for piece in pieces]
    return BandPath(points, tuple(itertools.chain.from_iterable(pieces)))


def _write_key(eta: ArrayLike, torsion: ArrayLike, bending: ArrayLike) -> str:
    """Return the key of the statements on a lattice: three digits, for shear stiffness (``eta``),
    torsion and bending. A digit is 1 if a number of its kind is not zero, else 0: "101" has shear
    and bending, but no torsion.
    """
    return "".join(str(int(np.any(ratio))) for ratio in (eta, torsion, bending))


def _describe_axes(lattice: ContactLattice, motions: Motions) -> dict[str, Any]:
    """Return the axes of a set of ``motions``, and the names of the waves of the ``lattice``."""
    return {
        "name": motions.name,
        "translations": list(motions.translations),
        "rotations": list(motions.rotations),
        "twist": motions.twist,
        "waves": list(lattice.wave_names),
    }


def _describe_row(row: Row) -> dict[str, Any]:
    """Return the kind of a row, and its coefficients (n_c, 6) of balls j and i, as plain lists."""
    return {"kind": row.kind, "head": row.head.tolist(), "tail": row.tail.tolist()}


def _describe_cell(lattice: ContactLattice, name: str, path: BandPath) -> dict[str, Any]:
    """Return the data of cell, balls, contacts, path and zone of a lattice called ``name``, in
    units of d and 2 pi/d. Vectors have three components, and so have the points of the path, which
    are in fractions of the reciprocal cell. Shifts of contacts have one number of cells for each
    period.
    """
    table = lattice.contacts
    p = lattice.periods
    reciprocal = lattice.reciprocal
    if p == 3:
        faces = zone_faces(reciprocal)
    elif p == 2:
        faces = [_pad(zone_polygon(reciprocal))]
    else:  # the zone of a line is a segment about Gamma
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
        "path": _describe_path(path),
        "zone": [face.tolist() for face in faces],
    }


def _describe_path(path: BandPath) -> list[dict[str, Any]]:
    """Return for each piece of a path its "points", (n, 3) fractions of the reciprocal cell, and
    their "labels"; of a path without labels the fractions as texts.
    """
    pieces = []
    first = 0
    for points in path.arrays:
        if path.labels:
            labels = list(path.labels[first : first + len(points)])
        else:
            labels = [" ".join(f"{x:.3g}" for x in q) for q in points]
        pieces.append({"points": points.tolist(), "labels": labels})
        first += len(points)
    return pieces


def _pad(vectors: Array) -> Array:
    """Return vectors (n, d) with zeros for the components that they lack, (n, 3)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def _describe_motions(structure: Lattice, motions: Motions) -> dict[str, Any]:
    """Return the axes of a set of motions, and the statements for each choice of the kinds of
    stiffness: whether balls rotate, the free branches, their warnings and the mechanism.
    """
    statements = {}
    for eta, torsion, bending in itertools.product((0.0, 1.0), repeat=3):
        lattice = ContactLattice.of(
            structure, eta, torsion=torsion, bending=bending, motions=motions
        )
        statements[_write_key(eta, torsion, bending)] = {
            "rotate": select_motions(eta, torsion, bending, motions).rotate,
            "free": lattice.free_branches,
            "warnings": list(lattice.free_branch_warnings),
            "mechanism": lattice.mechanism,
        }
    # waves are named on a lattice that resists all deformations
    stiff_lattice = ContactLattice.of(structure, 1.0, torsion=1.0, bending=1.0, motions=motions)
    return _describe_axes(stiff_lattice, motions) | {"statements": statements}
