"""Bands of a packing as the JSON file of phononwebsite, a viewer of vibrations in a browser."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from ase import Atoms
from ase.data import atomic_numbers

from granphon.base.arrays import Array, Complex
from granphon.base.scales import HertzPrefix
from granphon.dynamics.compatibility import GYRATION
from granphon.phonons.bands import Bands
from granphon.phonons.phonopy_atoms import free_symbol, name_balls

#: diameter of a ball in the file, Angstrom: the size of an atom, with which the viewer draws bonds
#: between balls in contact
_DIAMETER = 2.5
#: positions of the marks of a ball that turns, from its centre, in diameters of a homogeneous ball:
#: two marks that are not on one axis show any rotation
_MARKS = np.array([[0.35, 0.0, 0.0], [0.0, 0.35, 0.0]])
#: empty length across a line or a layer, beside its own extent, in diameters
_EMPTY_LENGTH = 6.0
#: cells along each period, for one, two and three periods
_REPETITIONS = {1: 10, 2: 6, 3: 3}


def write_phononwebsite(bands: Bands, name: str) -> str:
    """Return the text of a JSON file with bands in the layout that phononwebsite reads; ``name`` is
    what the viewer calls them.

    Each ball is an atom with the symbol of its kind (:func:`~granphon.atoms`) or, where balls have
    no kinds, of its mass: Fe if all are equal. A ball that turns carries two more atoms as marks,
    with the symbol H, or another that no ball has if a kind is called H. A mark at r from the
    centre of its ball moves by u + phi x r, for the displacement u and the rotation phi of the
    ball. Vectors are displacements, with the phase of the ball in its cell. For the wave vector q,
    in fractions, the viewer multiplies the vectors of the cell l steps away by exp(2 pi i q.l).
    Lengths are in Angstrom, and a ball of one diameter is 2.5 Angstrom wide. ``eigenvalues`` are in
    the decimal unit of hertz that stands in the name of the file's data; the viewer writes cm^-1 in
    its place.

    Raises :class:`~granphon.base.errors.InputError` for bands without eigenvectors.
    """
    unit = HertzPrefix.for_top(float(bands.frequencies.max()))
    periods = bands.periods
    segments, points, branches = bands.frequencies.shape
    cell = _widen_cell(bands)
    marks = _place_marks(bands)
    balls = name_balls(bands.masses, bands.kinds)
    mark_symbols = [free_symbol("H", balls)] * marks.shape[1]
    symbols = []
    for ball in balls:
        symbols += [ball, *mark_symbols]
    numbers = [atomic_numbers[symbol] for symbol in symbols]
    centres = (bands.positions @ bands.cell)[:, None]  # (n, 1, 3)
    positions = np.concatenate([centres, centres + marks], axis=1).reshape(-1, 3)
    vectors = _displace_atoms(bands, marks).reshape(segments * points, branches, -1, 3)
    data = {
        "name": f"{name} (frequencies in {unit.name})",
        "formula": Atoms(balls).get_chemical_formula(),
        "natoms": len(symbols),
        "lattice": (_DIAMETER * cell).tolist(),
        "atom_types": symbols,
        "atom_numbers": numbers,
        "atomic_numbers": sorted(set(numbers)),
        "atom_pos_car": (_DIAMETER * positions).tolist(),
        "atom_pos_red": (positions @ np.linalg.inv(cell)).tolist(),
        "repetitions": [_REPETITIONS[periods] if axis < periods else 1 for axis in range(3)],
        "qpoints": bands.qpoints.reshape(-1, 3).tolist(),
        "distances": bands.distances.ravel().tolist(),
        "eigenvalues": (bands.frequencies.reshape(-1, branches) / unit.hertz).tolist(),
        "vectors": np.stack([vectors.real, vectors.imag], axis=-1).tolist(),
        "line_breaks": [[n * points, (n + 1) * points] for n in range(segments)],
        "highsym_qpts": _list_corners(bands.labels, points),
    }
    return json.dumps(data, allow_nan=False, separators=(",", ":")) + "\n"


def _widen_cell(bands: Bands) -> Array:
    """Return the vectors (3, 3) of the cell, in diameters; those across a line or a layer are so
    long that the viewer has empty space beside the balls.
    """
    cell = bands.cell.copy()
    extent = np.ptp(bands.positions @ bands.cell, axis=0)
    for axis in range(bands.periods, 3):
        cell[axis] = (extent[axis] + _EMPTY_LENGTH) * np.eye(3)[axis]
    return cell


def _place_marks(bands: Bands) -> Array:
    """Return the positions (n, m, 3) of the m marks of each of n balls from its centre, in
    diameters; m is zero if balls do not turn. Marks of a ball are farther from the centre the
    larger its radius of gyration is.
    """
    marks = _MARKS if bands.motions.rotate else np.zeros((0, 3))
    return np.asarray((bands.gyration / GYRATION)[:, None, None] * marks)


def _displace_atoms(bands: Bands, marks: Array) -> Complex:
    """Return the displacements (segments, points, branches, atoms, 3) of the atoms: each of n balls
    is followed by its m ``marks`` (n, m, 3), positions from its centre in diameters.
    """
    motions = bands.motions
    displacements = []
    for ball in range(len(bands.positions)):
        amplitude = bands.motion[:, :, ball] / np.sqrt(bands.masses[ball])
        phase = np.exp(2j * np.pi * (bands.qpoints @ bands.positions[ball]))
        # (segments, points, branches, motions)
        motion = np.moveaxis(amplitude * phase[:, :, None, None], 2, 3)
        shift = np.zeros((*bands.frequencies.shape, 3), complex)
        turn = np.zeros_like(shift)
        shift[..., list(motions.translations)] = motion[..., motions.translating]
        # rotations come as w = R_g phi, with the radius of gyration R_g
        turn[..., list(motions.rotations)] = motion[..., motions.turning] / bands.gyration[ball]
        displacements.append(shift)
        for mark in marks[ball]:
            displacements.append(shift + np.cross(turn, mark))
    return np.stack(displacements, axis=3)


def _list_corners(labels: Sequence[str], points: int) -> list[list[Any]]:
    """Return pairs of the number of a wave vector that is a corner, ascending, and its label.

    Each segment has as many wave vectors as ``points``; a jump of the path has the labels of its
    two corners, "K|M".
    """
    labels_by_number = {}
    for segment, (start, end) in enumerate(itertools.pairwise(labels)):
        first = segment * points
        last = first + points - 1
        labels_by_number[last] = end.split("|")[0]
        labels_by_number[first] = start.split("|")[-1]
    return [[number, label] for number, label in sorted(labels_by_number.items())]
