"""Benchmarks of the ordered lattice: ratios, each measured side by side in one run."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from side_by_side import Part, Row, alternate, over

#: points on a segment where what does not depend on their number matters little
MANY = 2001
HEAD = "import phonopy, matplotlib.pyplot"

#: what a user without granphon would write: force constants of the contacts by hand, then phonopy
BARE = """
import numpy as np
from phonopy import Phonopy
from phonopy.structure.atoms import PhonopyAtoms

def bare(eta=0.839907192575406, n=101, mesh=64, dos=True):
    cell = np.array([[1, 0, 0], [-0.5, np.sqrt(0.75), 0], [0, 0, 1.0]])
    ph = Phonopy(PhonopyAtoms(symbols=["Fe"], cell=cell, scaled_positions=[[0, 0, 0]], masses=[1.0]),
                 np.diag([3, 3, 1]), primitive_matrix="P", is_symmetry=False)
    ph.unit_conversion_factor = 1.0
    positions = ph.supercell.positions
    inverse = np.linalg.inv(ph.supercell.cell)
    fc = np.zeros((9, 9, 3, 3))
    for angle in np.arange(6) * np.pi / 3:
        normal = np.array([np.cos(angle), np.sin(angle), 0]); tangent = np.array([-normal[1], normal[0], 0])
        e_i, e_j = -normal, normal
        s_i, s_j = -tangent - [0, 0, np.sqrt(2.5)], tangent - [0, 0, np.sqrt(2.5)]
        for i in range(9):
            gap = (positions - positions[i] - normal) @ inverse
            j = int(np.argmin(np.abs(gap - np.rint(gap)).sum(axis=1)))
            fc[i, i] += np.outer(e_i, e_i) + eta * np.outer(s_i, s_i)
            fc[i, j] += np.outer(e_i, e_j) + eta * np.outer(s_i, s_j)
    ph.force_constants = fc
    corners = np.array([[0, 0, 0], [1/3, 1/3, 0], [1/2, 0, 0], [0, 0, 0]])
    paths = [a + (b - a) * np.linspace(0, 1, n)[:, None] for a, b in zip(corners[:-1], corners[1:])]
    bands = ph.run_band_structure(paths, with_eigenvectors=True, with_group_velocities=True)
    if dos:
        ph.run_mesh([mesh, mesh, 1], is_gamma_center=True, with_eigenvectors=True, is_mesh_symmetry=False)
        ph.run_projected_dos(xyz_projection=True)
    return ph, bands
"""


def by_hand(
    corners: NDArray[np.float64], eta: float, n: int = 101
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies and group velocities along the path, all q at once: D(q) of three contacts typed
    out, and eigh.
    """
    reciprocal = 2.0 * np.pi * np.linalg.inv(np.array([[1.0, 0.0], [-0.5, np.sqrt(0.75)]])).T
    ends = corners @ reciprocal
    step = np.linspace(0.0, 1.0, n)[:, None]
    q = np.concatenate([a + (b - a) * step for a, b in pairwise(ends)])
    angle = np.arange(3) * np.pi / 3.0
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    phase = np.exp(1j * q @ normal.T)  # (n_q, 3 contacts)
    spin = np.full(3, np.sqrt(2.5))
    along = np.column_stack([normal, 0.0 * spin])
    across = np.column_stack([-normal[:, 1], normal[:, 0], 0.0 * spin])
    turn = np.column_stack([np.zeros((3, 2)), spin])
    rows = np.concatenate(
        [
            (phase - 1.0)[..., None] * along,
            np.sqrt(eta) * ((phase - 1.0)[..., None] * across - (phase + 1.0)[..., None] * turn),
        ],
        axis=1,
    )
    slopes = np.concatenate(
        [1j * phase[..., None] * along, np.sqrt(eta) * 1j * phase[..., None] * (across - turn)],
        axis=1,
    )
    slopes = slopes[:, None] * np.tile(normal, (2, 1)).T[None, :, :, None]  # (n_q, 2, 6, 3)
    adjoint = rows.conj().swapaxes(1, 2)
    squared, modes = np.linalg.eigh(adjoint @ rows)
    values = np.sqrt(np.maximum(squared, 0.0))
    half = (rows @ modes).conj()[:, None] * (slopes @ modes[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):  # at Gamma they have no value
        velocities = np.moveaxis(np.sum(half, axis=2).real / values[:, None], 1, 2)
    return values, velocities


def rotate_all(
    matrices: NDArray[np.complex128],
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Singular values and right vectors by plane rotations alone, one pair of columns after the
    other, at all points.
    """
    n = matrices.shape[2]
    columns = matrices.copy()
    right = np.broadcast_to(np.eye(n, dtype=complex), (len(matrices), n, n)).copy()
    turned = True
    while turned:
        turned = False
        for p in range(n - 1):
            for r in range(p + 1, n):
                one = columns[..., p]
                other = columns[..., r]
                alpha, beta = (np.einsum("bm,bm->b", c.conj(), c).real for c in (one, other))
                gamma = np.einsum("bm,bm->b", one.conj(), other)
                size = np.abs(gamma)
                active = size > 1e-15 * np.sqrt(alpha * beta)
                if not np.any(active):
                    continue
                turned = True
                safe = np.where(active, size, 1.0)
                zeta = 0.5 * (beta - alpha) / safe
                tangent = np.where(
                    active,
                    np.where(zeta >= 0.0, 1.0, -1.0) / (np.abs(zeta) + np.hypot(1.0, zeta)),
                    0.0,
                )
                cosine = (1.0 / np.hypot(1.0, tangent))[:, None]
                tangent = tangent[:, None]
                phase = np.where(active, gamma / safe, 1.0).conj()[:, None]
                for array in (columns, right):
                    first = array[..., p].copy()
                    second = array[..., r] * phase
                    array[..., p], array[..., r] = (
                        cosine * (first - tangent * second),
                        cosine * (tangent * first + second),
                    )
    norms = np.linalg.norm(columns, axis=1)
    order = np.argsort(norms, axis=1)
    return np.take_along_axis(norms, order, 1), np.take_along_axis(right, order[:, None], 2)


def bands(repeats: int) -> list[Row]:
    """Bands with eigenvectors and group velocities on the same q points."""
    import granphon as gp
    from granphon.dynamics.blocks import Block

    scope: dict[str, Callable[..., object]] = {}
    exec(BARE, scope)  # the text is also run as a script of its own below
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    packing = gp.Packing(steel, 8e-3)
    state = gp.AveragedLattice(packing).at_force(18.446)
    phonons = gp.Phonons(state)
    ours = phonons.bands("GKMG", npoints=101)
    corners = np.array([[0.0, 0.0], [1 / 3, 1 / 3], [0.5, 0.0], [0.0, 0.0]])
    lattice = phonons.lattice
    eta = packing.mindlin_ratio
    q = lattice.wavevectors(ours.qpoints.reshape(-1, 3))
    towards = np.repeat(q.reshape(3, -1, 2)[:, -1] - q.reshape(3, -1, 2)[:, 0], 101, axis=0)
    scale = phonons.scales
    top = float(ours.frequencies.max())
    _, theirs = scope["bare"](dos=False)  # type: ignore[misc]
    hand, speeds = by_hand(corners, eta)
    # and apart: where branches touch, velocities are those of a chosen direction
    generic = hand[:, 0] > 1e-2
    generic &= np.min(np.diff(hand, axis=1), axis=1) > 1e-3
    found = ours.group_velocities.reshape(-1, 3, 2)[generic] / scale.velocity
    for name, other in (
        ("phonopy", np.array(theirs.frequencies)),
        ("numpy", hand.reshape(3, -1, 3)),
    ):
        worst = np.max(np.abs(other * scale.frequency - ours.frequencies))
        assert worst < 1e-7 * top, f"{name} disagrees: the ratio would mean nothing"
    assert np.max(np.abs(found - speeds[generic])) < 1e-6, (
        "group velocities disagree: the ratio would mean nothing"
    )

    class Turned(Block):
        """Plane rotations at all wave vectors, which keep all digits and take their time."""

        def _decompose(self, point: Any) -> Any:
            return rotate_all(point.rows)

    class Rotated(gp.ContactLattice):
        """Complex numbers, and plane rotations."""

        _images = None

        @cached_property
        def _blocks(self) -> list[Block]:
            return [Turned(block.columns, block.deforming) for block in super()._blocks]

    kagome, rotated = gp.ContactLattice.of("kagome", eta), Rotated.of("kagome", eta)
    balls = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice="kagome")).at_force(18.446)
    nine = kagome.wavevectors(ours.qpoints.reshape(-1, 3))
    path = np.repeat(nine.reshape(3, -1, 2)[:, -1] - nine.reshape(3, -1, 2)[:, 0], 101, axis=0)
    rows = kagome.compatibility(nine)
    lapack = np.linalg.svd(rows, compute_uv=False)[:, ::-1]
    worst = np.max(np.abs(lapack - kagome.frequencies(nine)))
    assert worst < 1e-13 * lapack.max(), "LAPACK disagrees on kagome: the ratio would mean nothing"
    gamma = np.all(nine == 0.0, axis=1)
    slow = rotated.modes(nine[~gamma], path[~gamma])
    fast = kagome.modes(nine[~gamma], path[~gamma])
    worst = np.max(np.abs(fast.frequencies / slow.frequencies - 1.0))
    assert worst < 2e-14, "plane rotations disagree on kagome: the ratio would mean nothing"
    seconds = alternate(
        repeats,
        granphon=lambda: gp.Phonons(state).bands("GKMG", npoints=101),
        phonopy=lambda: scope["bare"](dos=False),
        modes=lambda: lattice.modes(q, towards),
        numpy=lambda: by_hand(corners, eta),
        granphon_many=lambda: gp.Phonons(state).bands("GKMG", npoints=MANY),
        numpy_many=lambda: by_hand(corners, eta, MANY),
        kagome=lambda: kagome.modes(nine, path),
        lapack=lambda: np.linalg.svd(rows, full_matrices=False),
        rotated=lambda: rotated.modes(nine, path),
        frequencies=lambda: kagome.frequencies(nine),
        rotated_frequencies=lambda: rotated.frequencies(nine),
        kagome_bands=lambda: gp.Phonons(balls).bands("GKMG", npoints=101),
    )
    what = "bands along Γ-K-M-Γ with eigenvectors and group velocities"
    points = "303 q points"
    return [
        over(f"{what}, {points}: over bare phonopy", seconds, "granphon", "phonopy", 0.5),
        over(
            f"{what}, {points}: over batched numpy, D(q) typed", seconds, "granphon", "numpy", 25.0
        ),
        over(
            f"{what}, {3 * MANY} q points: over batched numpy, D(q) typed",
            seconds,
            "granphon_many",
            "numpy_many",
            6.0,
        ),
        over(
            f"modes of C(q) alone, {points}: over batched numpy, D(q) typed",
            seconds,
            "modes",
            "numpy",
            6.0,
        ),
        over(
            f"modes of kagome (nine branches), {points}: over numpy's SVD of the same C(q) alone",
            seconds,
            "kagome",
            "lapack",
            5.0,
        ),
        over(
            f"modes of kagome, {points}: plane rotations at all of them over granphon",
            seconds,
            "rotated",
            "kagome",
            5.0,
            least=True,
        ),
        over(
            f"frequencies of kagome, {points}: plane rotations at all of them over granphon",
            seconds,
            "rotated_frequencies",
            "frequencies",
            5.0,
            least=True,
        ),
        over(
            f"bands of kagome, {points}: modes by plane rotations alone over `Phonons.bands`",
            seconds,
            "rotated",
            "kagome_bands",
            3.0,
            least=True,
        ),
    ]


def command(repeats: int) -> list[Row]:
    """The command on the steel example, against the imports and the bare computation, as whole
    processes.
    """
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, "MPLBACKEND": "Agg"}

    def process(*arguments: str) -> Callable[[], object]:
        return lambda: subprocess.run(
            arguments, check=True, capture_output=True, env=environment, cwd=root
        )

    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "out")
        granphon = [
            sys.executable,
            "-m",
            "granphon",
            "run",
            "examples/steel_hexagon.yaml",
            "-o",
            out,
            "--force",
        ]
        velocities = Path(folder) / "velocities.yaml"
        text = (root / "examples" / "steel_hexagon.yaml").read_text(encoding="utf-8")
        velocities.write_text(
            text.replace("[velocities, bands, dos]", "[velocities]"), encoding="utf-8"
        )
        seconds = alternate(
            repeats,
            granphon=process(*granphon),
            imports=process(sys.executable, "-c", HEAD),
            bare=process(sys.executable, "-c", f"{HEAD}\n{BARE}\nbare()"),
            velocities=process(*granphon[:4], str(velocities), "-o", f"{out}.v", "--force"),
            own=process(
                sys.executable,
                "-c",
                "import granphon.cli.main, granphon.scene.scene, yaml, xarray, h5netcdf",
            ),
        )
    what = "`granphon run examples/steel_hexagon.yaml`, a process"
    return [
        over(f"{what}: over bare phonopy for the same", seconds, "granphon", "bare", 2.0),
        over(
            f"{what}: over the imports of phonopy and pyplot", seconds, "granphon", "imports", 4.0
        ),
        over(
            "the same with velocities alone: over its own imports",
            seconds,
            "velocities",
            "own",
            2.0,
        ),
        *imports(repeats),
    ]


def imports(repeats: int) -> list[Row]:
    """What ``import granphon`` takes, as a whole process, and how many modules it loads."""
    count = (
        "import sys; before = len(sys.modules); import granphon; print(len(sys.modules) - before)"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", count], check=True, capture_output=True, text=True
    )
    seconds = alternate(
        repeats,
        granphon=lambda: subprocess.run([sys.executable, "-c", "import granphon"], check=True),
        others=lambda: subprocess.run([sys.executable, "-c", "import numpy, ase"], check=True),
    )
    return [
        over(
            "`import granphon`, a process: over the imports of numpy and ASE",
            seconds,
            "granphon",
            "others",
            0.5,
        ),
        Row("`import granphon`: modules that it loads", float(loaded.stdout), "", 12.0),
    ]


def directions(repeats: int) -> list[Row]:
    """A polar plot of 543 directions: one call against a call for each."""
    import granphon as gp

    state = gp.AveragedLattice(gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)).at_force(
        18.446
    )
    angle = np.linspace(0.0, 2.0 * np.pi, 543)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = []
    finders: dict[str, Callable[[NDArray[np.float64]], object]] = {
        "sound velocities": lambda way: gp.sound_velocities(state, way),
        "pulse velocities at 6.5 kHz": lambda way: gp.pulse_velocities(state, 6500.0, way),
    }
    for name, find in finders.items():
        seconds = alternate(
            min(repeats, 3),
            at_once=lambda find=find: find(along),  # type: ignore[misc]
            each=lambda find=find: [find(way) for way in along],  # type: ignore[misc]
        )
        found.append(
            over(
                f"{name} in 543 directions: a call for each over one call",
                seconds,
                "each",
                "at_once",
                20.0,
                least=True,
            )
        )
    return found


def edges(repeats: int) -> list[Row]:
    """A map of a surface, 200 wave vectors by 400 frequencies with six motions, and a slab of 100
    layers.
    """
    import granphon as gp

    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, lattice="fcc", friction=True)
    network = gp.AveragedLattice(packing).at_force(18.446).network
    surface, slab = gp.Surface(network, (1, 1, 0)), gp.Phonons(network.cut((1, 1, 0), 100))
    q, f = np.linspace(0.01, 0.5, 200)[:, None] * [1.0, 0.0], np.linspace(0.0, 8e4, 400)
    blocks = np.random.default_rng(0).normal(size=(len(q) * len(f), 6, 12)).view(complex)
    few = np.array([[0.11, 0.23], [0.41, 0.07]])
    matrices = slab.lattice.dynamical_matrix(slab.lattice.wavevectors(few))
    times = alternate(
        min(repeats, 3),
        map=lambda: surface.spectrum(q, f),
        inverses=lambda: np.linalg.inv(blocks),
        slab=lambda: slab.frequencies(few),
        values=lambda: np.linalg.eigvalsh(matrices),
        modes=lambda: slab.modes(few),
        vectors=lambda: np.linalg.eigh(matrices),
    )
    return [
        over(
            "surface of fcc, 200 q x 400 frequencies: the map over one inverse of each block",
            times,
            "map",
            "inverses",
            60.0,
        ),
        over(
            "slab of fcc, 100 layers: its frequencies over eigenvalues of D(q) that is there",
            times,
            "slab",
            "values",
            3.0,
        ),
        over(
            "slab of fcc, 100 layers: modes and velocities over eigenvectors of D(q)",
            times,
            "modes",
            "vectors",
            4.0,
        ),
    ]


PARTS: dict[str, Part] = {
    "bands": bands,
    "command": command,
    "directions": directions,
    "edges": edges,
}
