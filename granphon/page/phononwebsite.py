"""Bands of a packing as the JSON file of phononwebsite, a viewer of vibrations in a browser."""

from __future__ import annotations

import json

import numpy as np
from ase import Atoms
from ase.data import atomic_numbers

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
#: empty length across a line or a layer, in diameters
_EMPTY = 6.0
#: cells along each period, for one, two and three periods
_REPETITIONS = {1: 10, 2: 6, 3: 3}


def write_phononwebsite(bands: Bands, name: str) -> str:
    """Return the text of a JSON file with bands in the layout that phononwebsite reads.

    Each ball is an atom, of the symbol of its kind (:func:`~granphon.atoms`), Fe if all are equal.
    A ball that turns carries two more atoms as marks, of the symbol H (He if a kind is called H).
    A mark at r from the centre of its ball moves by u + phi x r. Vectors are displacements, with
    the phase of the ball in its cell; the viewer multiplies the vectors of cell n by
    exp(2 pi i q.n). Lengths are in Angstrom, and a ball of one diameter is 2.5 Angstrom wide.
    ``eigenvalues`` are in the decimal unit of hertz that stands in the name of the file's data;
    the viewer writes cm^-1 in its place.
    """
    unit = HertzPrefix.for_top(float(bands.frequencies.max()))
    periods = bands.periods
    motions = bands.motions
    cell = bands.cell.copy()
    for axis in range(periods, 3):
        cell[axis] = _EMPTY * np.eye(3)[axis]
    centres = bands.positions @ bands.cell
    marks = (bands.gyration / GYRATION)[:, None, None] * (
        _MARKS if motions.rotate else np.zeros((0, 3))
    )
    balls = name_balls(bands.masses, bands.kinds)
    kinds = [
        symbol for ball in balls for symbol in (ball, *[free_symbol("H", balls)] * marks.shape[1])
    ]
    numbers = [atomic_numbers[symbol] for symbol in kinds]
    segments, points, branches = bands.frequencies.shape
    displacements = []
    for ball in range(len(centres)):
        # displacements (segments, points, branches, 3) of the ball, and of the marks on the ball
        motion = bands.motion[:, :, ball] / np.sqrt(bands.masses[ball])
        phase = np.exp(2j * np.pi * (bands.qpoints @ bands.positions[ball]))
        motion = np.moveaxis(motion * phase[:, :, None, None], 2, 3)
        shift = np.zeros((segments, points, branches, 3), complex)
        turn = np.zeros_like(shift)
        shift[..., list(motions.translations)] = motion[..., motions.translating]
        turn[..., list(motions.rotations)] = motion[..., motions.turning] / bands.gyration[ball]
        displacements += [shift, *(shift + np.cross(turn, mark) for mark in marks[ball])]
    vectors = np.stack(displacements, axis=3).reshape(segments * points, branches, -1, 3)
    atoms_of_balls = np.concatenate([centres[:, None], centres[:, None] + marks], axis=1)
    atom_positions = atoms_of_balls.reshape(-1, 3)
    # a jump of the path has the labels of its two corners: "K|M"
    starts = {n * points: label.split("|")[-1] for n, label in enumerate(bands.labels[:-1])}
    ends = {(n + 1) * points - 1: label.split("|")[0] for n, label in enumerate(bands.labels[1:])}
    data = {
        "name": f"{name} (frequencies in {unit.name})",
        "formula": Atoms(balls).get_chemical_formula(),
        "natoms": len(kinds),
        "lattice": (_DIAMETER * cell).tolist(),
        "atom_types": kinds,
        "atom_numbers": numbers,
        "atomic_numbers": sorted(set(numbers)),
        "atom_pos_car": (_DIAMETER * atom_positions).tolist(),
        "atom_pos_red": (atom_positions @ np.linalg.inv(cell)).tolist(),
        "repetitions": [_REPETITIONS[periods] if axis < periods else 1 for axis in range(3)],
        "qpoints": bands.qpoints.reshape(-1, 3).tolist(),
        "distances": bands.distances.ravel().tolist(),
        "eigenvalues": (bands.frequencies.reshape(-1, branches) / unit.hertz).tolist(),
        "vectors": np.stack([vectors.real, vectors.imag], axis=-1).tolist(),
        "line_breaks": [[n * points, (n + 1) * points] for n in range(segments)],
        "highsym_qpts": [[index, label] for index, label in sorted((ends | starts).items())],
    }
    return json.dumps(data, allow_nan=False, separators=(",", ":")) + "\n"
