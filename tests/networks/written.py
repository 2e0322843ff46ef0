"""Files in the formats of LAMMPS, LIGGGHTS and MercuryDPM, as their documentation has them, of any
network.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import granphon as gp
from tests import packings


def glass_packing() -> gp.ContactNetwork:
    """Thirty-five glass balls of three sizes in a periodic box, with tangential forces under which
    they are at rest.
    """
    folder = packings.FOLDER
    network = gp.ContactNetwork.from_lammps(
        folder / "balls_atoms.dump", folder / "balls_pairs.dump", packings.MATERIAL
    )
    rng = np.random.default_rng(3)
    across = np.cross(network.normal, rng.normal(size=network.normal.shape))
    network = replace(network, tangential_force=0.1 * network.normal_force[:, None] * across)
    return replace(network, tangential_force=across_at_rest(network))


def across_at_rest(network: gp.ContactNetwork) -> np.ndarray:
    """The tangential forces (n_c, 3), nearest to those of the network, whose sums and torques on
    balls are zero.
    """
    contacts = np.arange(network.n_contacts)
    first = np.cross(network.normal, np.roll(network.normal, 1, axis=1))
    first /= np.linalg.norm(first, axis=1)[:, None]
    axes = np.stack([first, np.cross(network.normal, first)], axis=1)  # (n_c, 2, 3)
    turning = np.cross(network.normal[:, None], axes)
    sums = np.zeros((network.n_balls, 2, 3, network.n_contacts, 2))
    for balls, sign, arms in (
        (network.j, 1.0, network.arm_j),
        (network.i, -1.0, network.arm_i),
    ):
        for axis in range(2):
            sums[balls, 0, :, contacts, axis] += sign * axes[:, axis]
            sums[balls, 1, :, contacts, axis] -= arms[:, None] * turning[:, axis]
    matrix = sums.reshape(6 * network.n_balls, -1)
    given = np.einsum("ca,cka->ck", network.tangential_force, axes).ravel()
    change = np.linalg.lstsq(matrix, -matrix @ given, rcond=None)[0]
    return np.einsum("ck,cka->ca", (given + change).reshape(-1, 2), axes)


#: the modulus of a contact of two bodies of the material, Pa
MODULUS = packings.MATERIAL.young_modulus / (2.0 * (1.0 - packings.MATERIAL.poisson_ratio**2))


def layer_on_floor() -> gp.ContactNetwork:
    """A few rows of balls in a plane on a line of the same material."""
    state = gp.AveragedLattice(gp.Packing(packings.MATERIAL, 2e-3)).at_force(
        100.0, finite_overlap=True
    )
    network = state.network.repeat((4, 1)).cut(1, 3, ("floor", "free"))
    on_floor = (6.0 * MODULUS**2 * network.radii[network.i] * network.normal_force) ** (1.0 / 3.0)
    at_wall = np.isinf(network.radii[network.j])
    stiffness = np.where(at_wall, on_floor, network.normal_stiffness)
    return replace(
        network,
        labels=None,
        tangential_force=np.zeros_like(network.normal),
        normal_stiffness=stiffness,
        shear_stiffness=packings.MATERIAL.mindlin_ratio * stiffness,
    )


def force_on_i(network: gp.ContactNetwork) -> np.ndarray:
    """The force on ball i of each contact, (n_c, 3), N."""
    across = network.tangential_force
    return -(network.normal_force[:, None] * network.normal + across)


def overlaps(network: gp.ContactNetwork) -> np.ndarray:
    """The overlap of each contact, (n_c,), m: of Hertz's law at a flat wall."""
    touch = network.radii[network.i] + network.radii[network.j]
    at_wall = (0.75 * network.normal_force / (MODULUS * network.radii[network.i] ** 0.5)) ** (2 / 3)
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(touch), at_wall, touch - network.distance)


def dump(step: int, kind: str, box: np.ndarray, pbc, names: str, rows) -> str:
    """One frame of a dump as text."""
    lines = ["ITEM: TIMESTEP", str(step), f"ITEM: NUMBER OF {kind}", str(len(rows))]
    lines.append("ITEM: BOX BOUNDS " + " ".join("pp" if flag else "ff" for flag in pbc))
    lines += [f"0 {side!r}" for side in box.tolist()]
    lines.append(f"ITEM: {kind} {names}")
    lines += [" ".join(f"{number:.16g}" for number in row) for row in rows]
    return "\n".join([*lines, ""])


def box_of(network: gp.ContactNetwork) -> np.ndarray:
    sides = np.diag(network.cell).copy()
    return np.where(sides > 0.0, sides, 1.0)


def write_liggghts(network: gp.ContactNetwork, folder: Path, keywords: str = "id force delta"):
    """Write the dumps of atoms, of pairs and of walls; ids are those of the balls, or the indices
    from 1 on.
    """
    has_size = np.isfinite(network.radii)
    ids = np.arange(1, network.n_balls + 1) if network.labels is None else network.labels
    box = box_of(network)
    atoms = np.column_stack([ids, network.positions, network.radii, network.masses])[has_size]
    (folder / "atoms.liggghts").write_text(
        dump(7, "ATOMS", box, network.pbc, "id x y z radius mass", atoms)
    )
    force = force_on_i(network)
    at_wall = np.isinf(network.radii[network.j])
    place = network.positions[network.i]
    columns = {
        "pos": np.column_stack([place, network.positions[network.j]]),
        "vel": np.zeros((len(force), 6)),
        "id": np.column_stack([ids[network.i], ids[network.j], np.any(network.shift, axis=1)]),
        "force": force,
        "torque": np.zeros((len(force), 3)),
        "history": np.zeros((len(force), 4)),
        "contactArea": np.ones((len(force), 1)),
        "delta": overlaps(network)[:, None],
    }
    chosen = keywords.split() if keywords else [name for name in columns if name != "delta"]
    pairs = np.hstack([columns[name] for name in columns if name in chosen])
    names = " ".join(f"c_1[{n + 1}]" for n in range(pairs.shape[1]))
    (folder / "pairs.liggghts").write_text(
        dump(7, "ENTRIES", box, network.pbc, names, pairs[~at_wall])
    )
    on_wall = place + (network.radii[network.i] - overlaps(network))[:, None] * network.normal
    walls = np.column_stack(
        [on_wall, place, np.zeros(len(force)), np.full(len(force), 12), ids[network.i], force]
    )
    names = " ".join(f"c_2[{n + 1}]" for n in range(walls.shape[1]))
    (folder / "walls.liggghts").write_text(
        dump(7, "ENTRIES", box, network.pbc, names, walls[at_wall])
    )
    return [folder / f"{name}.liggghts" for name in ("atoms", "pairs", "walls")]


def write_mercury(network: gp.ContactNetwork, folder: Path, time: float = 0.25):
    """Write the files .fstat, .data and .restart; balls go by their indices."""
    has_size = np.isfinite(network.radii)
    count = int(np.count_nonzero(has_size))
    assert np.all(has_size[:count])
    box = box_of(network)
    force = -force_on_i(network)
    rows = []
    for contact in range(network.n_contacts):
        i, j = int(network.i[contact]), int(network.j[contact])
        normal = network.normal[contact]
        along = force[contact] @ normal
        across = force[contact] - along * normal
        size = float(np.linalg.norm(across))
        direction = across / size if size else np.zeros(3)
        numbers = [0.0, 0.0, 0.0, overlaps(network)[contact], 0.0, along, size]
        if j >= count:
            rows.append([time, i, count - 1 - j, *numbers, *normal, *direction])
            continue
        if np.isfinite(network.masses[i]):
            rows.append([time, i, j, *numbers, *-normal, *-direction])
        if np.isfinite(network.masses[j]):
            rows.append([time, j, i, *numbers, *normal, *direction])
    head = [f"# {time} 1", "# 0 0 0 " + " ".join(map(repr, box.tolist())), "# 1 1 0 0 0 0"]
    body = [" ".join(f"{number:.16g}" for number in row) for row in rows]
    earlier = ["# 0 1", *head[1:]]
    (folder / "run.fstat").write_text("\n".join([*earlier, *head, *body, ""]))
    bounds = "0 0 0 " + " ".join(map(repr, box.tolist()))
    data = []
    for moment in (0.0, time):
        data.append(f"{count} {moment} {bounds}")
        for ball in range(count):
            x = network.positions[ball]
            numbers = [*x, 0, 0, 0, network.radii[ball], *[0] * 6, 0]
            data.append(" ".join(f"{number:.16g}" for number in numbers))
    (folder / "run.data").write_text("\n".join([*data, ""]))
    restart = [
        "MercuryDPM 0.14 name run",
        f"timeStep 1e-4 time {time!r} ntimeSteps 1 timeMax 1",
        "systemDimensions 3 particleDimensions 3 gravity 0 0 0",
        "Boundaries 3",
    ]
    for axis in np.flatnonzero(network.pbc).tolist():
        shift = " ".join(map(repr, network.cell[axis].tolist()))
        restart.append(f"PeriodicBoundary id {axis} normal 1 0 0 distanceLeft 0 shift {shift}")
    restart.append(f"Particles {count}")
    for ball in range(count):
        place = " ".join(f"{number:.16g}" for number in network.positions[ball])
        inverse = 0.0 if np.isinf(network.masses[ball]) else 1.0 / network.masses[ball]
        restart.append(
            f"SphericalParticle id {ball} indSpecies 0 position {place} orientation 1 0 0 0"
            f" radius {network.radii[ball]:.17g} invMass {inverse:.17g}"
        )
    (folder / "run.restart").write_text(
        "\n".join([*restart, f"Interactions {network.n_contacts}", ""])
    )
    return [folder / f"run.{name}" for name in ("fstat", "data", "restart")]


def eigenvalues(network: gp.ContactNetwork) -> np.ndarray:
    """All squares of the angular frequencies of a network without periods, ascending, 1/s^2."""
    matrix = gp.Waves(network).operator.matrix.toarray()
    return np.linalg.eigvalsh(matrix)
