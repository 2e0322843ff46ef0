"""Benchmarks of crystals in space: ratios, each measured side by side in one run, and the largest
density of states.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from side_by_side import Part, Row, alternate, over, run_alone, spend

Array = NDArray[np.float64]
#: points on a segment of a path
POINTS = 101


def contacts_by_hand(
    cell: Array, sites: Array, eta: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array, Array]:
    """Balls i and j of each contact, its normal, and its rows typed out: elongation and two slips
    of six motions each.

    Rows are (3, n_c, 6), of ball i and of ball j: displacements, then rotations w = R_g phi.
    """
    steps = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3), axis=-1).reshape(-1, 3) @ cell
    apart = sites[None, :, None] + steps - sites[:, None, None]  # (ball i, ball j, step, 3)
    first, second, step = np.nonzero(np.abs(np.linalg.norm(apart, axis=-1) - 1.0) < 1e-9)
    normal = apart[first, second, step]
    once = normal @ [0.7, 0.11, 0.013] > 0.0  # each contact from one of its ends
    first = first[once]
    second = second[once]
    normal = normal[once]
    tangent = np.cross(
        normal, np.where(np.abs(normal[:, 2:]) > 0.9, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    )
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    spin = 0.5 * np.sqrt(10.0)
    still = np.zeros_like(normal)
    across = np.cross(normal, tangent)
    moved = np.stack([normal, np.sqrt(eta) * tangent, np.sqrt(eta) * across])
    turned = spin * np.stack([still, -np.sqrt(eta) * across, np.sqrt(eta) * tangent])
    return (
        first,
        second,
        normal,
        np.concatenate([-moved, turned], axis=2),
        np.concatenate([moved, turned], axis=2),
    )


def by_hand_in_space(
    cell: Array, sites: Array, q: Array, eta: float, masses: Array | None = None
) -> Callable[[], list[NDArray[Any]]]:
    """What finds all modes at once, D(q) of six motions a ball typed out: frequencies, vectors,
    velocities, fractions.

    Units are those of one contact and one ball; ``masses`` (n,) are those of balls that differ in
    it.
    """
    first, second, normal, own, other = contacts_by_hand(cell, sites, eta)
    n, c = len(sites), len(normal)
    near, far = np.zeros((3, c, n, 6)), np.zeros((3, c, n, 6))
    near[:, np.arange(c), first] = own
    far[:, np.arange(c), second] = other
    if masses is not None:
        near, far = (side / np.sqrt(masses)[:, None] for side in (near, far))
    near, far, ahead = near.reshape(3 * c, -1), far.reshape(3 * c, -1), np.tile(normal, (3, 1))

    def solve() -> list[NDArray[Any]]:
        phase = np.tile(np.exp(1j * q @ normal.T), 3)[..., None]
        rows = phase * far + near
        squared, modes = np.linalg.eigh(rows.conj().swapaxes(1, 2) @ rows)
        values = np.sqrt(np.maximum(squared, 0.0))
        half = ((rows @ modes).conj() * ((1j * phase * far) @ modes)).real
        motion = modes.reshape(len(q), n, 6, -1)
        with np.errstate(divide="ignore", invalid="ignore"):  # at Gamma they have no value
            velocities = (ahead.T @ half).swapaxes(1, 2) / values[..., None]
            toward = q / np.linalg.norm(q, axis=1)[:, None]
            longitudinal = np.sum(
                np.abs(np.einsum("qiab,qa->qib", motion[:, :, :3], toward)) ** 2, axis=1
            )
        return [
            values,
            modes,
            velocities,
            np.sum(np.abs(motion[:, :, 3:]) ** 2, axis=(1, 2)),
            longitudinal,
        ]

    return solve


def bare_phonopy(cell: Array, sites: Array, eta: float) -> Any:
    """What a user without granphon would write: phonopy with two atoms a ball, force constants of
    the contacts by hand.

    The first atom of a ball has its displacement, the second, a little aside, its rotation w = R_g
    phi.
    """
    from phonopy import Phonopy
    from phonopy.structure.atoms import PhonopyAtoms

    n = len(sites)
    atoms = np.concatenate([sites, sites + 1e-3]) @ np.linalg.inv(cell)
    unit = PhonopyAtoms(
        symbols=["Fe"] * n + ["O"] * n, cell=cell, scaled_positions=atoms, masses=[1.0] * (2 * n)
    )
    ph = Phonopy(unit, 3 * np.eye(3, dtype=int), primitive_matrix="P", is_symmetry=False)
    ph.unit_conversion_factor = 1.0
    # the images of an atom of the cell follow each other, in the same order for each
    images = len(ph.supercell) // (2 * n)
    inverse = np.linalg.inv(ph.supercell.cell)
    places = ph.supercell.positions.reshape(2 * n, images, 3)
    constants = np.zeros((2, n, images, 2, n, images, 3, 3))
    first, second, normals, own, others = contacts_by_hand(cell, sites, eta)
    for c, (i, j, normal) in enumerate(zip(first, second, normals, strict=True)):
        near = own[:, c]
        far = others[:, c]
        for image in range(images):
            gap = (places[j] - places[i, image] - normal) @ inverse
            there = int(np.argmin(np.abs(gap - np.rint(gap)).sum(axis=1)))
            ends = ((i, image, near), (j, there, far))
            for one, here, left in ends:
                for other, beyond, right in ends:
                    block = (left.T @ right).reshape(2, 3, 2, 3).swapaxes(1, 2)
                    constants[:, one, here, :, other, beyond] += block
    ph.force_constants = constants.reshape(len(ph.supercell), len(ph.supercell), 3, 3)
    return ph


#: crystals in space, and paths through their zones
SPACE = {
    "fcc": (
        "Γ-X-W-L",
        [[0, 0, 0], [1 / 2, 0, 1 / 2], [1 / 2, 1 / 4, 3 / 4], [1 / 2, 1 / 2, 1 / 2]],
    ),
    "hcp": ("Γ-M-K-A", [[0, 0, 0], [1 / 2, 0, 0], [1 / 3, 1 / 3, 0], [0, 0, 1 / 2]]),
}
#: wave vectors along each axis of the mesh of a density of states
MESH = 64


def space(repeats: int) -> list[Row]:
    """Modes and bands of crystals in space against D(q) typed out and against bare phonopy, and a
    density of states.
    """
    import granphon as gp

    steel = gp.Material(211.65e9, 0.276, 7840.0)
    found = []
    for name, (path, corners) in SPACE.items():
        state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice=name)).at_force(18.446)
        eta = state.packing.mindlin_ratio
        lattice = gp.ContactLattice.of(name, eta)
        fractions = np.array(corners, float)
        ends = lattice.wavevectors(fractions)
        step = np.linspace(0.0, 1.0, POINTS)[:, None]
        paths = [a + (b - a) * step for a, b in pairwise(fractions)]
        q = lattice.wavevectors(np.concatenate(paths))
        along = np.repeat(np.diff(ends, axis=0), POINTS, axis=0)
        typed = by_hand_in_space(lattice.cell, lattice.positions, q, eta)
        bare = bare_phonopy(lattice.cell, lattice.positions, eta)
        modes, (values, _, velocities, rotation, _) = lattice.modes(q, along), typed()

        def run(bare: Any = bare, paths: Any = paths) -> Any:
            return bare.run_band_structure(
                paths, with_eigenvectors=True, with_group_velocities=True
            )

        run()
        theirs = np.concatenate(bare.band_structure.frequencies)
        for other in (values, theirs):
            assert np.max(np.abs(modes.frequencies - other)) < 1e-6, (
                f"the others disagree on {name}"
            )
        # where branches touch, velocities are those of a direction
        apart = np.min(np.diff(values, axis=1), axis=1) > 1e-3
        apart &= values[:, 0] > 1e-2
        assert np.max(np.abs(modes.group_velocities - velocities)[apart]) < 1e-9, (
            "group velocities disagree"
        )
        assert np.max(np.abs(modes.rotational_fraction - rotation)[apart]) < 1e-9, (
            "rotational fractions disagree"
        )

        def solve(lattice: Any = lattice, q: Any = q, along: Any = along) -> object:
            return lattice.modes(q, along)

        def bands(state: Any = state, corners: Any = corners) -> object:
            return gp.Phonons(state).bands([corners], npoints=POINTS)

        seconds = alternate(repeats, granphon=solve, numpy=typed, phonopy=run, bands=bands)
        points = (
            f"{name} ({lattice.n_branches} branches) along {path}, {len(q)} q points, velocities"
            f" and polarisation"
        )
        found += [
            over(
                f"modes of {points}: over batched numpy, D(q) typed",
                seconds,
                "granphon",
                "numpy",
                3.0,
            ),
            over(
                f"`Phonons.bands` of {points}: over bare phonopy, two atoms a ball",
                seconds,
                "bands",
                "phonopy",
                0.5,
            ),
        ]
    return found + densities(repeats)


# -- density of states, alone in a process ---------------------------------------------------------


def alone(points: int) -> None:
    """Print what the density of states of fcc on a mesh takes."""
    import granphon as gp

    state = gp.AveragedLattice(
        gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, lattice="fcc")
    ).at_force(18.446)
    dos, spent = spend(lambda: gp.Phonons(state).dos(mesh=(points,) * 3))
    print(json.dumps({**spent, "modes": float(np.trapezoid(dos.total, dos.frequencies))}))


def densities(repeats: int) -> list[Row]:
    """The density of states of fcc on 64^3 wave vectors."""
    runs = [run_alone(f"bench_crystals.alone({MESH})") for _ in range(min(repeats, 3))]
    assert all(abs(run["modes"] - 6.0) < 1e-6 for run in runs), (
        "some modes are missing: the time would mean nothing"
    )
    what = f"density of states of fcc (6 branches) on {MESH}x{MESH}x{MESH} wave vectors"
    return [
        Row(f"{what}: time", float(np.median([run["s"] for run in runs])), "s", 10.0),
        Row(f"{what}: peak memory of the process", max(run["GiB"] for run in runs), "GiB", 1.0),
    ]


# -- balls of several kinds, and networks ----------------------------------------------------------


def kinds(repeats: int) -> list[Row]:
    """Bands of NaCl against D(q) typed out, of a network against its lattice, and of a packing
    against the dense matrix.
    """
    import granphon as gp
    from granphon.waves.operator import WaveOperator

    steel = gp.Material(193e9, 0.30, 8000.0)
    glass = gp.Material(70e9, 0.22, 2500.0)
    state = gp.Crystal.on("NaCl", [gp.Ball(steel, 8e-3), gp.Ball(glass, 8e-3)]).at_pressure(1e5)
    network = state.network
    lattice = gp.ContactLattice.from_network(network)
    fractions = np.array(SPACE["fcc"][1], float)
    step = np.linspace(0.0, 1.0, POINTS)[:, None]
    q = lattice.wavevectors(np.concatenate([a + (b - a) * step for a, b in pairwise(fractions)]))
    along = np.repeat(np.diff(lattice.wavevectors(fractions), axis=0), POINTS, axis=0)
    d = 8e-3
    eta = float(network.shear_stiffness[0] / network.normal_stiffness[0])
    masses = (
        network.masses
        / network.scales.mass
        * network.scales.stiffness
        / network.normal_stiffness[0]
    )
    scale = d / network.scales.length
    typed = by_hand_in_space(network.cell / d, network.positions / d, scale * q, eta, masses)
    modes, values = lattice.modes(q, along), typed()[0]
    assert np.max(np.abs(modes.frequencies - values)) < 1e-6 * np.max(values), (
        "the others disagree on NaCl"
    )
    balls = gp.AveragedLattice(gp.Packing(steel, d, lattice="hcp")).at_force(18.446)
    of_lattice = gp.Phonons(balls)
    of_network = gp.Phonons(balls.network)
    fractions_of_hcp = np.array(SPACE["hcp"][1], float)

    def bands_of(phonons: Any) -> Callable[[], Any]:
        return lambda: phonons.bands([fractions_of_hcp], npoints=POINTS).frequencies

    both = [bands_of(one)() for one in (of_lattice, of_network)]
    assert np.max(np.abs(both[0] - both[1])) < 1e-6 * np.max(both[0]), (
        "a network disagrees with its lattice"
    )
    packing = (
        gp.DirectSimulation(gp.Packing(steel, d, spread=gp.Uniform(2e-6)), (6, 6), 0)
        .at_force(20.0)
        .sample.network
    )
    of_packing, dense = gp.Phonons(packing), WaveOperator(packing).matrix.toarray()
    points = np.linspace(0.0, 0.5, 21)[:, None] * np.array([1.0, 0.5])
    squares = np.linalg.eigvalsh(dense)
    least = of_packing.frequencies(points[:1])[0] ** 2 * (2.0 * np.pi) ** 2
    assert np.max(np.abs(least - squares)) < 1e-9 * squares[-1], (
        "a packing disagrees with its matrix"
    )
    seconds = alternate(
        repeats,
        granphon=lambda: lattice.modes(q, along),
        numpy=typed,
        lattice=bands_of(of_lattice),
        network=bands_of(of_network),
        packing=lambda: of_packing.frequencies(points),
        dense=lambda: [np.linalg.eigvalsh(dense + 0j) for _ in points],
    )
    what = (
        f"NaCl of two kinds (12 branches) along {SPACE['fcc'][0]}, {len(q)} q points, velocities"
        f" and polarisation"
    )
    hcp = f"a network of hcp along {SPACE['hcp'][0]}"
    n = f"a packing of 36 balls ({len(dense)} branches) at {len(points)} q points"
    return [
        over(f"modes of {what}: over batched numpy, D(q) typed", seconds, "granphon", "numpy", 3.0),
        over(f"`Phonons.bands` of {hcp}: over its lattice", seconds, "network", "lattice", 1.5),
        over(
            f"frequencies of {n}: over numpy's eigenvalues of matrices that are there",
            seconds,
            "packing",
            "dense",
            8.0,
        ),
    ]


PARTS: dict[str, Part] = {"space": space, "kinds": kinds}
