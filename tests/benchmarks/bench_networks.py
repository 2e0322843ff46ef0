"""Benchmarks of readers: contacts of LAMMPS' dumps and of tables, over ``numpy.loadtxt`` of the
same numbers.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path

import numpy as np
from side_by_side import Part, Row, alternate, over, run_alone, spend

import granphon as gp

GLASS = gp.Material(young_modulus=70e9, poisson_ratio=0.2, density=2500.0)
DIAMETER = 2e-3
#: balls along each axis: three times the cube of it are the contacts
SIDE = 40
MANY = 69


def write_files(folder: Path, side: int) -> None:
    """Write balls of a simple cubic lattice, a little off their sites, as dumps and as tables."""
    spacing = 0.999 * DIAMETER
    sites = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), -1).reshape(-1, 3)
    rng = np.random.default_rng(0)
    places = (sites + 0.5) * spacing + rng.normal(size=sites.shape) * 1e-7
    index = np.arange(len(places)).reshape(side, side, side)
    i = np.tile(index.ravel(), 3)
    j = np.concatenate([np.roll(index, -1, axis).ravel() for axis in range(3)])
    length = side * spacing
    vector = places[i] - places[j]
    vector -= np.rint(vector / length) * length
    modulus = GLASS.young_modulus / (2.0 * (1.0 - GLASS.poisson_ratio**2))
    overlap = DIAMETER - np.linalg.norm(vector, axis=1)
    force = 4.0 / 3.0 * modulus * np.sqrt(DIAMETER / 4.0) * overlap**1.5
    across = 1e-2 * np.cross(vector, rng.normal(size=vector.shape))
    mass = GLASS.ball_mass(DIAMETER)
    sizes = np.tile([0.5 * DIAMETER, mass], (len(places), 1))
    balls = np.column_stack([np.arange(1, len(places) + 1), places, sizes])
    contacts = np.column_stack([i + 1, j + 1, force, vector, across])
    box = f"ITEM: BOX BOUNDS pp pp pp\n{3 * f'0 {length!r}{chr(10)}'}"
    for name, kind, names, rows in (
        ("atoms", "ATOMS", "id x y z radius mass", balls),
        ("pairs", "ENTRIES", "i j force dx dy dz tx ty tz", contacts),
    ):
        head = f"ITEM: TIMESTEP\n0\nITEM: NUMBER OF {kind}\n{len(rows)}\n{box}ITEM: {kind} {names}"
        np.savetxt(folder / f"{name}.dump", rows, fmt="%.16g", header=head, comments="")
    for name, heads, rows in (
        ("balls", "id,x (m),y (m),z (m),radius (m),mass (kg)", balls),
        ("contacts", "i,j,normal_force (N)", contacts[:, :3]),
    ):
        path = folder / f"{name}.csv"
        np.savetxt(path, rows, fmt="%.16g", delimiter=",", header=heads, comments="")


def read_dumps(folder: Path) -> gp.ContactNetwork:
    return gp.ContactNetwork.from_lammps(folder / "atoms.dump", folder / "pairs.dump", GLASS)


def read_tables(folder: Path, side: int) -> gp.ContactNetwork:
    tables = folder / "balls.csv", folder / "contacts.csv"
    cell = [side * 0.999 * DIAMETER] * 3
    return gp.ContactNetwork.from_table(*tables, material=GLASS, cell=cell)


def read(repeats: int) -> list[Row]:
    """Time over that of NumPy's reader of the same numbers, and the peak of memory."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_files(folder, SIDE)
        seconds = alternate(
            repeats,
            time.process_time,
            dumps=lambda: read_dumps(folder),
            numbers=lambda: [
                np.loadtxt(folder / name, skiprows=9) for name in ("atoms.dump", "pairs.dump")
            ],
            tables=lambda: read_tables(folder, SIDE),
            cells=lambda: [
                np.loadtxt(folder / name, skiprows=1, delimiter=",")
                for name in ("balls.csv", "contacts.csv")
            ],
        )
        count = f"{3 * SIDE**3:,} contacts"
        rows = [
            over(
                f"{count} of a dump, over loadtxt of its numbers", seconds, "dumps", "numbers", 6.0
            ),
            over(
                f"{count} of a table, over loadtxt of its numbers", seconds, "tables", "cells", 20.0
            ),
        ]
        write_files(folder, MANY)
        used = run_alone(f"bench_networks.tell_peak({str(folder)!r})")
        rows.append(Row(f"{3 * MANY**3:,} contacts of a dump", used["GiB"], "GiB", 1.0))
    return rows


def tell_peak(folder: str) -> None:
    """Print the cost of reading the dumps of a folder, for a process of its own."""
    _network, used = spend(lambda: read_dumps(Path(folder)))
    print(json.dumps(used))


PARTS: dict[str, Part] = {"read": read}
