"""The bands of a packing as the JSON file of phononwebsite, a viewer of vibrations in the
browser.
"""

from __future__ import annotations

import json

import numpy as np
from ase import Atoms
from ase.data import atomic_numbers

from granphon.base.scales import HertzPrefix
from granphon.dynamics.compatibility import GYRATION
from granphon.phonons.bands import Bands
from granphon.phonons.phonopy_atoms import free_symbol, name_balls

#: diameter of a ball in the file, Angstrom: that of an atom, so that the viewer draws bonds between
#: balls that touch
_DIAMETER = 2.5
#: places of the marks of a ball that turns, in diameters from its centre: two that are not on one
#: axis show any rotation. A ball of another size has them as far as its radius of gyration says
_MARKS = np.array([[0.35, 0.0, 0.0], [0.0, 0.35, 0.0]])
#: empty length across a line or a layer, in diameters
_EMPTY = 6.0
#: cells along each period, for one, two and three periods
_REPETITIONS = {1: 10, 2: 6, 3: 3}


def write_phononwebsite(bands: Bands, name: str) -> str:
    """Return the text of a JSON file with bands in the layout that phononwebsite reads.

    Each ball is an atom, of the symbol of its kind (:func:`~granphon.atoms`), Fe if all are equal.
    A ball that turns carries two atoms more, H (He if a kind is called H), as marks: they move by u
    + phi x r, with r from the centre of the ball. Vectors are displacements, with the phase of the
    ball in its cell: in the cell n they are to be multiplied by exp(2 pi i q.n). Lengths are in
    Angstrom, a ball of one diameter having 2.5; ``eigenvalues`` are in the decimal unit of hertz
    that the name tells, where the viewer writes cm^-1.
    """
    unit = HertzPrefix.for_top(float(bands.frequencies.max()))
    p = bands.periods
    motions = bands.motions
    cell = bands.cell.copy()
    for axis in range(p, 3):
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
    s, points, b = bands.frequencies.shape
    moved = []
    for ball in range(len(centres)):
        # the displacements (s, points, b, 3) of a ball, and of the marks on it
        own = bands.motion[:, :, ball] / np.sqrt(bands.masses[ball])
        phase = np.exp(2j * np.pi * (bands.qpoints @ bands.positions[ball]))
        own = np.moveaxis(own * phase[:, :, None, None], 2, 3)
        shift, turn = (np.zeros((s, points, b, 3), complex) for _ in range(2))
        shift[..., list(motions.translations)] = own[..., motions.translating]
        turn[..., list(motions.rotations)] = own[..., motions.turning] / bands.gyration[ball]
        moved += [shift, *(shift + np.cross(turn, mark) for mark in marks[ball])]
    vectors = np.stack(moved, axis=3).reshape(s * points, b, -1, 3)
    places = np.concatenate([centres[:, None], centres[:, None] + marks], axis=1).reshape(-1, 3)
    labels = [
        (n * points, label)
        for n, label in enumerate(one.split("|")[-1] for one in bands.labels[:-1])
    ]
    ends = [(n * points + points - 1, one.split("|")[0]) for n, one in enumerate(bands.labels[1:])]
    data = {
        "name": f"{name} (frequencies in {unit.name})",
        "formula": Atoms(balls).get_chemical_formula(),
        "natoms": len(kinds),
        "lattice": (_DIAMETER * cell).tolist(),
        "atom_types": kinds,
        "atom_numbers": numbers,
        "atomic_numbers": sorted(set(numbers)),
        "atom_pos_car": (_DIAMETER * places).tolist(),
        "atom_pos_red": (places @ np.linalg.inv(cell)).tolist(),
        "repetitions": [_REPETITIONS[p] if axis < p else 1 for axis in range(3)],
        "qpoints": bands.qpoints.reshape(-1, 3).tolist(),
        "distances": bands.distances.ravel().tolist(),
        "eigenvalues": (bands.frequencies.reshape(-1, b) / unit.hertz).tolist(),
        "vectors": np.stack([vectors.real, vectors.imag], axis=-1).tolist(),
        "line_breaks": [[n * points, (n + 1) * points] for n in range(s)],
        "highsym_qpts": [
            [index, label] for index, label in sorted({**dict(ends), **dict(labels)}.items())
        ],
    }
    return json.dumps(data, allow_nan=False, separators=(",", ":")) + "\n"
