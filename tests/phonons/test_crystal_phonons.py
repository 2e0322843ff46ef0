"""Phonons of every lattice and set of motions: bands, densities of states, phonopy's object, files for other programs."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from phonopy.phonon.spectrum import TetrahedronDOSAccumulator

import granphon as gp
from granphon.balls.lattices import find_lattice
from granphon.base.errors import InputError, UnsupportedError
from granphon.phonons.phonopy_atoms import OFFSET
from granphon.phonons.phonopy_bridge import REFUSED
from tests.phonons.test_dos import WholeMesh
from tests.phonons.test_phonopy_bridge import (
    EUPHONIC,
    euphonic_terahertz,
    head,
    run,
    script,
    tools,  # noqa: F401  (a fixture is used by name)
    without_flat_bands,
)

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ETA = STEEL.mindlin_ratio
PLANES = ("square", "triangular", "honeycomb", "kagome")
SPACE = ("sc", "bcc", "fcc", "hcp", "diamond")


def phonons(lattice="fcc", motions=None, friction=True, finite_overlap=None, **options):
    packing = gp.Packing(STEEL, 8e-3, lattice=lattice, motions=motions, friction=friction, **options)
    return gp.Phonons(gp.AveragedLattice(packing).at_overlap(1e-2 * 8e-3, finite_overlap=finite_overlap))


RESISTED = {"torsion": 0.07, "bending": 0.03}
CASES = [
    ("chain", "longitudinal", {}), ("chain", "in_plane", {}), ("chain", "out_of_plane", {"bending": 0.03}),
    ("chain", "all", {}), ("chain", "all", RESISTED),
    *((plane, motions, {}) for plane in PLANES for motions in ("out_of_plane", "all")),
    ("triangular", "all", RESISTED), *((lattice, "all", {}) for lattice in SPACE), ("hcp", "all", RESISTED),
    ("fcc", "all", {"friction": False}), ("fcc", "all", {"torsion": 0.1, "friction": False}),
    ("fcc", "all", {"finite_overlap": True, **RESISTED}),
]  # fmt: skip
every_case = pytest.mark.parametrize(("lattice", "motions", "options"), CASES, ids=str)


def random_points(ph, count=5, seed=3):
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (count, ph.lattice.periods))


def padded(q):
    return np.pad(q, ((0, 0), (0, 3 - q.shape[1])))


# -- frequencies and modes ----------------------------------------------------------------------------------------------


def twin(ph, q):
    """Squared frequencies from forces and torques of each neighbour, one by one, with the motions that the balls have."""
    state, motions = ph.state, ph.lattice.motions
    packing, structure = state.packing, find_lattice(state.packing.lattice)
    follows = state.finite_overlap
    spacing = 1.0 - state.relative_overlap if follows else 1.0
    push = state.force / state.normal_stiffness / packing.diameter / spacing if follows else 0.0
    eta, twist, roll = packing.mindlin_ratio, packing.torsion, packing.bending
    centres = np.zeros((structure.n_balls, 3))
    centres[:, : structure.dimension] = structure.positions
    cell = np.zeros((structure.periods, 3))
    cell[:, : structure.dimension] = structure.vectors
    wave = np.linalg.pinv(cell) @ q * 2.0 * np.pi
    matrix = np.zeros((6 * len(centres), 6 * len(centres)), complex)
    for i, j in itertools.product(range(len(centres)), repeat=2):
        for steps in itertools.product(range(-2, 3), repeat=len(cell)):
            n = centres[j] + np.array(steps) @ cell - centres[i]
            if abs(np.linalg.norm(n) - 1.0) > 1e-9:
                continue
            phase, across = np.exp(1j * wave @ n), np.eye(3) - np.outer(n, n)
            for ball, factor, sign in ((i, 1.0, -1.0), (j, phase, 1.0)):
                for dof in range(6):
                    u, phi = np.zeros((2, 3), complex)
                    (u if dof < 3 else phi)[dof % 3] = factor if dof < 3 else factor * np.sqrt(10.0)
                    slip = across @ (sign * u) - 0.5 * spacing * np.cross(phi, n)
                    pull = n * (n @ (sign * u)) + eta * slip - push * across @ (sign * u)
                    torque = 0.5 * spacing * eta * np.cross(n, slip) + sign * (twist * n * (n @ phi) + roll * across @ phi)
                    matrix[6 * i : 6 * i + 3, 6 * ball + dof] -= pull
                    matrix[6 * i + 3 : 6 * i + 6, 6 * ball + dof] -= np.sqrt(10.0) * torque
    moving = [*motions.translations, *(3 + axis for axis in motions.rotations)]
    keep = [6 * ball + one for ball in range(len(centres)) for one in moving]
    return np.linalg.eigvalsh(matrix[np.ix_(keep, keep)])


@every_case
def test_frequencies_are_those_of_forces_and_torques(lattice, motions, options):
    ph = phonons(lattice, motions, **options)
    q = random_points(ph)
    found = ph.frequencies(q) / ph.scales.frequency
    expected = np.array([twin(ph, one) for one in q])
    assert found.shape == (len(q), ph.lattice.motions.count * len(ph.atoms))
    np.testing.assert_allclose(found**2, expected, atol=1e-12 * expected.max())
    np.testing.assert_array_equal(ph.frequencies(padded(q)), ph.frequencies(q))


@every_case
def test_phonopys_object_has_the_same_frequencies(lattice, motions, options):
    ph = phonons(lattice, motions, **options)
    q = random_points(ph)
    ours = (ph.frequencies(q) / ph.scales.frequency) ** 2
    theirs = ph.phonopy.run_qpoints(padded(q)).frequencies
    theirs = np.sort(theirs * np.abs(theirs), axis=1)
    # coordinates that hold no motion are flat bands at zero
    still = len(ph.atoms) * len(ph.lattice.motions.still_slots)
    assert len(ph.phonopy.unitcell) == len(ph.atoms) * ph.lattice.motions.atoms_per_ball
    np.testing.assert_allclose(theirs, np.sort(np.pad(ours, ((0, 0), (still, 0))), axis=1), atol=1e-13 * ours.max())


def test_closed_forms_of_a_chain():
    ph = phonons("chain", "all")
    q = np.linspace(0.0, 0.5, 7)
    half = np.pi * q
    found = (ph.frequencies(q[:, None]) / ph.scales.frequency) ** 2
    # sound; twice the pair of transverse motion and rolling, of which one rolls without slip; torsion, without a cost
    pair = ETA * (4.0 * np.sin(half) ** 2 + 10.0 * np.cos(half) ** 2)
    expected = np.sort([4.0 * np.sin(half) ** 2, pair, pair, 0.0 * q, 0.0 * q, 0.0 * q], axis=0).T
    np.testing.assert_allclose(found, expected, atol=1e-14)


def test_closed_forms_of_cubic_crystals():
    for lattice, spin in (("sc", 20.0), ("bcc", 80.0 / 3.0), ("fcc", 40.0)):
        ph = phonons(lattice)
        at_gamma = (ph.frequencies([[0, 0, 0]]) / ph.scales.frequency) ** 2
        np.testing.assert_allclose(at_gamma[0], [0.0, 0.0, 0.0, *[spin * ETA] * 3], atol=1e-12)
    simple = phonons("sc")
    at_corner = (simple.frequencies([[0.5, 0.5, 0.5]]) / simple.scales.frequency) ** 2
    np.testing.assert_allclose(at_corner[0], [0.0, 0.0, 0.0, *[4.0 + 8.0 * ETA] * 3], atol=1e-12)
    smooth = phonons("fcc", friction=False)
    points = smooth.special_points
    found = (smooth.frequencies([points["X"], points["L"]]) / smooth.scales.frequency) ** 2
    np.testing.assert_allclose(found, [[4.0, 4.0, 8.0], [2.0, 2.0, 8.0]], rtol=1e-13)


@pytest.mark.parametrize("lattice", ["chain", "triangular", "fcc", "hcp"])
def test_group_velocities_are_slopes(lattice):
    ph = phonons(lattice, "all", **RESISTED)
    q, p, step = random_points(ph, 3), ph.lattice.periods, 1e-5
    modes = ph.modes(q)
    assert modes.group_velocities.shape == (3, ph.lattice.n_branches, p)
    for axis in np.eye(p):
        rise = ph.frequencies(q + step * axis) - ph.frequencies(q - step * axis)
        run_of = ph.lattice.wavevectors(2.0 * step * axis) / ph.scales.length
        slopes = 2.0 * np.pi * rise / np.linalg.norm(run_of)
        along = modes.group_velocities @ (run_of / np.linalg.norm(run_of))
        np.testing.assert_allclose(along, slopes, atol=1e-6 * ph.scales.velocity)


# -- bands --------------------------------------------------------------------------------------------------------------

PATHS = {
    "chain": ("G", "X"), "square": ("G", "X", "M", "G"), "kagome": ("G", "K", "M", "G"),
    "sc": ("G", "X", "M", "G", "R", "X|M", "R"), "bcc": ("G", "H", "N", "G", "P", "H|P", "N"),
    "fcc": ("G", "X", "W", "K", "G", "L"), "diamond": ("G", "X", "W", "K", "G", "L"),
    "hcp": ("G", "M", "K", "G", "A", "L", "H", "A|L", "M|K", "H"),
}  # fmt: skip


@pytest.mark.parametrize("lattice", PATHS)
def test_each_lattice_has_a_path(lattice):
    ph = phonons(lattice, "all")
    bands = ph.bands(npoints=4)
    s, b, p = len(bands.labels) - 1, ph.lattice.n_branches, ph.lattice.periods
    assert bands.labels == PATHS[lattice]
    assert bands.frequencies.shape == (s, 4, b)
    assert bands.group_velocities.shape == (s, 4, b, p)
    assert bands.periods == p
    for name in ("rotational", "longitudinal", "transverse", "out_of_plane"):
        part = getattr(bands, f"{name}_fraction")
        assert part.shape == (s, 4, b)
        assert part.min() >= 0.0
        assert part.max() <= 1.0 + 1e-12
    total = bands.rotational_fraction + bands.longitudinal_fraction + bands.out_of_plane_fraction + bands.transverse_fraction
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)
    np.testing.assert_allclose(bands.frequencies[0], ph.frequencies(bands.qpoints[0]), atol=1e-12 * bands.frequencies.max())


def test_path_of_letters_and_numbers_in_space():
    ph = phonons("fcc")
    named = ph.bands("GXWKGL", 5)
    points = ph.special_points
    numbered = ph.bands([points[letter] for letter in "GXWKGL"], 5, labels=list("GXWKGL"))
    assert named.labels == numbered.labels
    np.testing.assert_array_equal(named.frequencies, numbered.frequencies)
    assert ph.bands([[0, 0, 0], [0.5, 0.25, 0.75]], 2).labels == ("(0 0 0)", "(0.5 0.25 0.75)")
    # X lies at 2 pi / cube edge, edge 2^1/2
    np.testing.assert_allclose(named.distances[0, -1], np.sqrt(0.5), rtol=1e-12)


def test_cells_of_the_plane_that_are_neither_square_nor_hexagonal_have_ases_path():
    oblong = gp.Lattice("oblong", ((1.0, 0.0), (0.0, np.sqrt(3.0))), ((0.0, 0.0), (0.5, 0.5)))
    assert phonons(oblong).bands(npoints=2).labels == ("G", "X", "S", "Y", "G", "S")


def test_polarisation_along_a_cube_axis():
    # along [100] of fcc: a longitudinal branch without rotation, and waves of transverse displacements and spins
    bands = phonons("fcc").bands("GX", 9)
    inside = slice(1, 8)
    along = bands.longitudinal_fraction[0, inside]
    np.testing.assert_allclose(np.sort(along, axis=1)[:, -1], 1.0, rtol=1e-10)
    np.testing.assert_allclose(np.sort(along, axis=1)[:, :-1], 0.0, atol=1e-10)
    np.testing.assert_allclose(bands.rotational_fraction[0, inside].sum(axis=1), 3.0, rtol=1e-10)
    assert not bands.out_of_plane_fraction.any()


def test_waves_out_of_a_plane():
    bands = phonons("triangular", "all").bands(npoints=9)
    out = bands.out_of_plane_fraction
    apart = phonons("triangular", "out_of_plane").bands(npoints=9)
    np.testing.assert_allclose(out.sum(axis=2), 1.0, rtol=1e-10)
    np.testing.assert_array_equal(apart.longitudinal_fraction, 0.0)
    np.testing.assert_allclose(apart.out_of_plane_fraction + apart.rotational_fraction, 1.0, rtol=1e-12)
    inside = phonons("triangular", "in_plane").bands(npoints=9)
    assert not inside.out_of_plane_fraction.any()
    both = np.sort(np.concatenate([inside.frequencies, apart.frequencies], axis=2), axis=2)
    np.testing.assert_allclose(bands.frequencies, both, atol=1e-7 * both.max())


def test_warnings_of_what_costs_nothing():
    ph = phonons("sc")
    assert ph.bands("GX", 2).warnings == gp.validity(ph.state).warnings
    (soft,) = ph.bands("GM", 2).warnings[len(gp.validity(ph.state).warnings) :]
    assert soft.startswith("1 mode vanishes at 1 of 2 wave vectors, the first at q = (0.5, 0.5, 0)")
    free = phonons("chain", "all")
    for found in (free.bands("GX", 2), free.dos((4,))):
        assert any(one.startswith("3 of 6 branches vanish at every wave vector") for one in found.warnings)


# -- densities of states ------------------------------------------------------------------------------------------------


@every_case
def test_a_density_of_states_counts_every_motion(lattice, motions, options):
    ph = phonons(lattice, motions, **options)
    mesh = (9, 9, 5)[: ph.lattice.periods]
    count, turns = ph.lattice.motions.count, len(ph.lattice.motions.rotations)
    for method, tolerance in (("tetrahedron", 1e-12), ("smearing", 1e-5)):
        dos = ph.dos(mesh, method=method)
        assert dos.mesh == mesh
        assert np.trapezoid(dos.total, dos.frequencies) == pytest.approx(count, abs=tolerance)
        assert np.trapezoid(dos.rotational, dos.frequencies) == pytest.approx(turns, abs=1e-5)


@pytest.mark.parametrize(
    ("lattice", "mesh"), [("chain", (40,)), ("triangular", (12, 12)), ("fcc", (8, 8, 8)), ("hcp", (6, 6, 4))], ids=str
)
def test_integrals_are_phonopys(lattice, mesh):
    """Only modes near a frequency are asked of phonopy; here it is asked for the weights of all modes at all frequencies."""
    ph = phonons(lattice, "all", **RESISTED)
    dos, grid = ph.dos(mesh, points=101), ph._make_mesh(mesh)
    modes = ph.lattice.modes(ph.lattice.wavevectors(grid.qpoints), np.eye(len(mesh))[0])
    at = dos.frequencies / ph.scales.frequency
    edges = np.concatenate([at[:1], 0.5 * (at[1:] + at[:-1]), at[-1:]])
    parts = np.stack([1.0 - modes.rotational_fraction, modes.rotational_fraction], axis=-1)
    whole = TetrahedronDOSAccumulator(
        modes.frequencies, grid.bz_grid, mode_property=parts[None], ir_grid_points=grid.ir_grid_points,
        ir_grid_weights=grid.weights, ir_grid_map=grid.grid_mapping_table, sampling_points=edges,
    ).result.cumulative[0].T  # fmt: skip
    whole[:, 0] = 0.0
    expected = np.diff(whole, axis=1) / np.diff(edges) / len(ph.atoms)
    found = np.stack([dos.translational, dos.rotational]) * ph.scales.frequency
    np.testing.assert_allclose(found, expected, atol=1e-12 * expected.max())


@pytest.mark.parametrize(("lattice", "mesh"), [("fcc", (16, 16, 16)), ("hcp", (12, 12, 8))], ids=str)
def test_a_reduced_mesh_has_the_states_of_the_whole(lattice, mesh):
    ph = phonons(lattice)
    unreduced = WholeMesh(ph.state)
    reduced, whole = (one.dos(mesh, method="smearing") for one in (ph, unreduced))
    assert len(unreduced._make_mesh(mesh).qpoints) == np.prod(mesh)
    np.testing.assert_allclose(reduced.translational, whole.translational, rtol=1e-9, atol=1e-12 * whole.total.max())
    np.testing.assert_allclose(reduced.rotational, whole.rotational, rtol=1e-9, atol=1e-12 * whole.total.max())


def test_the_point_group_reduces_the_mesh():
    for lattice, mesh, order in (
        ("fcc", (24, 24, 24), 48),
        ("sc", (24, 24, 24), 48),
        ("hcp", (24, 24, 12), 24),
        ("chain", (24,), 1),
    ):
        ph = phonons(lattice, "all")
        full, reduced = (len(ph._make_mesh(mesh, reduce=some).qpoints) for some in (False, True))
        assert full == np.prod(mesh)
        assert full / order <= reduced <= 2.6 * full / order
    # a mesh that a rotation does not map on itself is not reduced
    assert len(phonons("fcc")._make_mesh((4, 4, 6)).qpoints) == 96


def test_states_of_a_chain_in_closed_form():
    ph = phonons("chain")
    dos = ph.dos((4000,), points=201)
    x = dos.frequencies / ph.scales.frequency
    edges = np.clip(np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]]), 0.0, 2.0)
    expected = np.diff(2.0 / np.pi * np.arcsin(edges / 2.0))
    widths = np.diff(np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]]))
    np.testing.assert_allclose(dos.total * ph.scales.frequency * widths, expected, atol=2e-5)
    assert not dos.rotational.any()


def test_low_states_of_a_crystal_are_those_of_sound():
    """Debye's law, N(omega) = V omega^3 / (6 pi^2) times the mean of 1/v^3 over directions and branches."""
    ph = phonons("fcc")
    dos = ph.dos((48, 48, 48))
    z, angle = np.meshgrid((np.arange(40) + 0.5) / 20.0 - 1.0, (np.arange(40) + 0.5) * np.pi / 20.0)
    rho = np.sqrt(1.0 - z**2)
    directions = np.stack([rho * np.cos(angle), rho * np.sin(angle), z], axis=-1).reshape(-1, 3)
    velocities, _ = ph.lattice.sound_velocities(directions)
    slow = float(np.sum(np.mean(velocities**-3.0, axis=0)))
    low = dos.frequencies < 0.1 * dos.frequencies[-1]
    counted = np.trapezoid(dos.total[low], dos.frequencies[low])
    top = dos.frequencies[low][-1] / ph.scales.frequency
    assert counted == pytest.approx(ph.lattice.measure * slow * top**3 / (6.0 * np.pi**2), rel=0.03)


def test_branches_that_cost_nothing_are_counted_at_zero():
    # three of the six motions of a chain: all in the first interval
    dos = phonons("chain", "all").dos((64,))
    first = 0.5 * dos.frequencies[1]
    assert dos.total[0] * first == pytest.approx(3.0, abs=0.02)
    assert np.trapezoid(dos.total, dos.frequencies) == pytest.approx(6.0, abs=1e-12)


@pytest.mark.parametrize(("lattice", "mesh"), [("chain", (16,)), ("fcc", (4, 4, 4)), ("hcp", (4, 4, 2))], ids=str)
def test_tables_of_densities_of_states(lattice, mesh, tmp_path):
    dos = phonons(lattice, "all").dos(mesh)
    dos.write_csv(tmp_path / "dos.csv")
    assert gp.DensityOfStates.read_csv(tmp_path / "dos.csv") == dos
    assert gp.DensityOfStates.from_dict(json.loads(json.dumps(dos.to_dict()))) == dos
    assert f"mesh {' '.join(map(str, mesh))}\n" in (tmp_path / "dos.csv").read_text()


# -- other cells of the same balls --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lattice", "repeat"), [("chain", (3, 1, 1)), ("triangular", (2, 3, 1)), ("fcc", (2, 1, 3)), ("hcp", (1, 2, 1))], ids=str
)
def test_a_supercell_has_the_folded_bands(lattice, repeat):
    one = phonons(lattice, "all", **RESISTED)
    big = gp.Phonons(one.state, gp.atoms(one.state).repeat(repeat))
    q = random_points(one, 1)[0]
    cells = itertools.product(*map(range, repeat[: len(q)]))
    expected = np.sort(one.frequencies([(q + n) / repeat[: len(q)] for n in np.array(list(cells))]).ravel())
    np.testing.assert_allclose(big.frequencies([q])[0], expected, atol=1e-12 * expected.max())
    theirs = big.phonopy.run_qpoints(padded(q[None])).frequencies[0]
    ours = (expected / one.scales.frequency) ** 2
    np.testing.assert_allclose(np.sort(theirs * np.abs(theirs)), ours, atol=1e-12 * ours.max())


def test_a_slab_and_a_cluster_have_no_images_across():
    whole = phonons("fcc")
    slab, cluster = (gp.atoms(whole.state).repeat(repeat) for repeat in ((1, 1, 3), (2, 2, 2)))
    slab.pbc, cluster.pbc = (True, True, False), False
    for balls, dim, q in ((slab, (3, 3, 1), [[0.1, 0.2, 0.0], [0.1, 0.2, 0.4]]), (cluster, (1, 1, 1), [[0.1, 0.2, 0.3]])):
        ph = gp.Phonons(whole.state, balls)
        assert ph.dim == dim
        ours = (ph.frequencies(q) / ph.scales.frequency) ** 2
        np.testing.assert_allclose(ours, ours[[0] * len(q)], atol=1e-12 * ours.max())
        theirs = ph.phonopy.run_qpoints(q).frequencies
        np.testing.assert_allclose(np.sort(theirs * np.abs(theirs)), ours, atol=1e-12 * ours.max())


# -- what is refused ----------------------------------------------------------------------------------------------------

BAD = {
    "path in space for a plane": ("square", lambda ph: ph.bands([[0, 0, 0], [0, 0, 0.5]]), r"leaves the plane.*one layer"),
    "path in the plane for a chain": ("chain", lambda ph: ph.bands([[0, 0, 0], [0.5, 0.5, 0]]), r"leaves the line.*one row"),
    "corners of two numbers in space": ("fcc", lambda ph: ph.bands([[0, 0], [0.5, 0]]), "corners of three finite numbers"),
    "letter of another zone": ("chain", lambda ph: ph.bands("GM"), r"no special point M.*Use G, X"),
    "q points of two numbers in space": ("fcc", lambda ph: ph.frequencies([[0.1, 0.2]]), r"Give \(n, 3\) finite"),
    "q points out of a line": ("chain", lambda ph: ph.frequencies([[0.1, 0.2, 0.0]]), "leaves the line"),
    "mesh of two numbers in space": ("fcc", lambda ph: ph.dos((8, 8)), r"three whole numbers from 1.*such as 64 64 64"),
    "mesh in space for a plane": ("square", lambda ph: ph.dos((8, 8, 8)), r"third number is 8.*one layer"),
    "mesh of a plane for a chain": ("chain", lambda ph: ph.dos((8, 8)), r"second number is 8.*and two ones.*one row"),
    "dim of two numbers in space": ("fcc", lambda ph: gp.Phonons(ph.state, dim=(3, 3)), "three whole numbers"),
    "dim too small": ("fcc", lambda ph: gp.Phonons(ph.state, dim=(3, 2, 3)), r"3 x 2 x 3 cells is too small.*3 x 3 x 3"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_the_dimension_does_not_allow(case):
    lattice, call, words = BAD[case]
    with pytest.raises(InputError, match=words):
        call(phonons(lattice))


def test_numbers_padded_with_ones():
    chain, plane = phonons("chain"), phonons("triangular", "all")
    assert chain.dos((8, 1, 1)) == chain.dos((8,)) == chain.dos("8 1 1")
    assert plane.dos((8, 8, 1)) == plane.dos((8, 8))
    assert gp.Phonons(chain.state, dim=(4, 1, 1)).dim == (4,)
    assert gp.Phonons(plane.state, dim="4 5 1").dim == (4, 5)
    assert phonons("fcc").dim == (3, 3, 3)
    assert phonons("hcp").dim == (3, 3, 2)


def test_reasons_do_not_speak_of_a_layer_alone():
    ph = phonons("fcc")
    for name in ("symmetrize_force_constants", "auto_band_structure", "run_thermal_properties", "get_Debye_frequency"):
        with pytest.raises(UnsupportedError) as caught:
            getattr(ph.phonopy, name)()
        assert "third coordinate" not in str(caught.value)
        assert "treats the layer" not in str(caught.value)
    assert not any("three translations" in reason for reason in REFUSED.values())


# -- files --------------------------------------------------------------------------------------------------------------

EXPORTS = {
    "chain": ("chain", "all", {}), "row": ("chain", "longitudinal", {}), "membrane": ("triangular", "all", RESISTED),
    "out of plane": ("honeycomb", "out_of_plane", {}), "fcc": ("fcc", "all", {}), "hcp": ("hcp", "all", RESISTED),
    "smooth fcc": ("fcc", "all", {"friction": False}), "finite fcc": ("fcc", "all", {"finite_overlap": True}),
}  # fmt: skip
LINE = {1: "0 0 0 1/2 0 0", 2: "0 0 0 1/3 1/3 0 1/2 0 0 0.1 0.3 0", 3: "0 0 0 1/2 0 1/2 1/2 1/4 3/4 0.1 0.2 0.35"}


#: the rest takes the same ways
FEW = ("row", "membrane", "fcc", "finite fcc")


@pytest.fixture(
    scope="module", params=[pytest.param(one, marks=[pytest.mark.exhaustive] * (one not in FEW)) for one in EXPORTS]
)
def exported(request, tmp_path_factory):
    """Phonons, and a folder that holds nothing but their file."""
    lattice, motions, options = EXPORTS[request.param]
    ph, folder = phonons(lattice, motions, **options), tmp_path_factory.mktemp("crystal")
    ph.save(folder / "phonopy_params.yaml")
    return ph, folder


def test_the_phonopy_command_without_options(exported):
    ph, folder = exported
    assert [one.name for one in folder.iterdir()] == ["phonopy_params.yaml"]
    own = head(folder / "phonopy_params.yaml")
    run(folder, "phonopy", "phonopy_params.yaml", "--band", LINE[ph.lattice.periods])
    out = yaml.safe_load((folder / "band.yaml").read_text())
    for path in folder.iterdir():
        if path.name != "phonopy_params.yaml":
            path.unlink()
    q = np.array([point["q-position"] for point in out["phonon"]])
    found = np.array([[mode["frequency"] for mode in point["band"]] for point in out["phonon"]])
    expected = ph.frequencies(q) / own["hertz"]
    found, flat = without_flat_bands(found, own["zero_bands"])
    assert found.shape == expected.shape
    assert 1.0 <= expected.max() < 1000.0
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * expected.max())
    assert flat < 1e-6 * expected.max()


def test_euphonic_reads_the_force_constants(exported):
    ph, folder = exported
    q = padded(random_points(ph, 3))
    found = euphonic_terahertz(folder, q)
    own = head(folder / "phonopy_params.yaml")
    found, flat = without_flat_bands(np.array(found), own["zero_bands"])
    expected = ph.frequencies(q) / own["hertz"]
    np.testing.assert_allclose(found, expected, rtol=2e-7, atol=1e-6 * expected.max())
    assert flat < 1e-6 * expected.max()


def test_load_phonopy_restores_the_object(exported):
    ph, folder = exported
    again, scales = gp.load_phonopy(folder / "phonopy_params.yaml")
    assert scales == ph.scales
    assert again.unitcell.symbols == ph.phonopy.unitcell.symbols
    np.testing.assert_allclose(again.unitcell.positions, ph.phonopy.unitcell.positions, atol=1e-14)
    np.testing.assert_allclose(again.force_constants, ph.phonopy.force_constants, rtol=0.0, atol=5.1e-16 / 2**30)
    np.testing.assert_array_equal(again.masses, ph.phonopy.masses)
    np.testing.assert_array_equal(again.supercell_matrix, ph.phonopy.supercell_matrix)


def test_bands_go_through_their_file(exported, tmp_path):
    ph, _ = exported
    bands = ph.bands(npoints=5)
    bands.write(tmp_path / "band.yaml")
    again = gp.Bands.read(tmp_path / "band.yaml")
    assert again.motions == bands.motions
    assert (again.labels, again.scales, again.warnings) == (bands.labels, bands.scales, bands.warnings)
    for name in ("qpoints", "distances", "cell", "positions", "masses"):
        np.testing.assert_array_equal(getattr(again, name), getattr(bands, name))
    for name in ("frequencies", "group_velocities", "eigenvectors"):
        ours = getattr(bands, name)
        np.testing.assert_allclose(getattr(again, name), ours, rtol=1e-14, atol=1e-15 * np.abs(ours).max())
    run(tmp_path, "phonopy-bandplot", "band.yaml", "-o", "x.png")
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")
    # what another program sees: the modes of phonopy's own matrix, with the phases of the places of its atoms
    out = yaml.safe_load((tmp_path / "band.yaml").read_text())
    q = bands.qpoints.reshape(-1, 3)
    vectors = np.array([[mode["eigenvector"] for mode in point["band"]] for point in out["phonon"]])
    vectors = (vectors[..., 0] + 1j * vectors[..., 1]).reshape(len(q), bands.n_branches, -1)
    matrices = ph.phonopy.run_qpoints(q, with_dynamical_matrices=True).dynamical_matrices
    squares = (bands.frequencies.reshape(len(q), -1, 1) / bands.scales.frequency) ** 2
    np.testing.assert_allclose(np.einsum("qab,qkb->qka", matrices, vectors), squares * vectors, atol=1e-12)
    assert out["natom"] == len(ph.phonopy.unitcell)
    assert [point["symbol"] for point in out["points"]] == ph.phonopy.unitcell.symbols
    assert gp.Bands.from_dict(json.loads(json.dumps(bands.to_dict()))) == bands


def test_euphonic_reads_bands_with_two_atoms_a_ball(tmp_path):
    bands = phonons("fcc").bands([[0.1, 0.0, 0.0], [0.3, 0.2, 0.4]], npoints=4)
    bands.write(tmp_path / "band.yaml")
    found = script(
        tmp_path,
        EUPHONIC.format(names="QpointPhononModes")
        + """
modes = QpointPhononModes.from_phonopy(path=".", phonon_name="band.yaml")
print(json.dumps([terahertz(modes), modes.eigenvectors.real.tolist(), modes.eigenvectors.imag.tolist()]))
""",
    )
    vectors = np.array(found[1]) + 1j * np.array(found[2])  # (q, branch, atom, 3)
    hertz = head(tmp_path / "band.yaml")["hertz"] if "\nphonopy:" in (tmp_path / "band.yaml").read_text() else 1e3
    np.testing.assert_allclose(found[0], bands.frequencies[0] / hertz, rtol=1e-13, atol=1e-13)
    spins = np.sum(np.abs(vectors[:, :, 1]) ** 2, axis=2)
    np.testing.assert_allclose(spins, bands.rotational_fraction[0], atol=1e-12)
    # Euphonic's phases are those of the cell: the displacement and the spin of a ball then have the phase of the ball
    ours = bands.eigenvectors[0].reshape(4, 2, 3, 6).transpose(0, 3, 1, 2)
    apart = np.einsum("qmai,qmai->qm", vectors.conj(), ours)
    np.testing.assert_allclose(np.abs(apart), 1.0, rtol=1e-2)


def test_what_the_head_of_a_file_says(tmp_path):
    ph = phonons("fcc")
    ph.save(tmp_path / "phonopy_params.yaml")
    own = head(tmp_path / "phonopy_params.yaml")
    assert own["schema"] == 1
    assert own["coordinates"] == ["x", "y", "z", *(f"w_{x} = R_g phi_{x}" for x in "xyz")]
    assert (own["motions"], own["rotations"], own["periods"]) == ("all", True, 3)
    assert own["masses"] == [1.0, 1.0]
    phonons("square", "out_of_plane").save(tmp_path / "membrane.yaml")
    assert head(tmp_path / "membrane.yaml")["coordinates"] == ["w_x = R_g phi_x", "w_y = R_g phi_y", "z"]
    phonons("chain").save(tmp_path / "chain.yaml")
    assert head(tmp_path / "chain.yaml")["coordinates"] == ["x", 0, 0]
    assert head(tmp_path / "chain.yaml")["zero_bands"] == 5
    phonons("square").save(tmp_path / "plane.yaml")
    plane = head(tmp_path / "plane.yaml")
    assert (plane["motions"], plane["rotations"], plane["periods"]) == ("in_plane", True, 2)
    assert plane["coordinates"] == ["x", "y", "w = R_g phi"]


def test_the_second_atom_stands_a_little_aside():
    cell = phonons("hcp").phonopy.unitcell
    assert cell.symbols == ["Fe", "Sn"] * 2
    np.testing.assert_allclose(cell.positions[1::2] - cell.positions[::2], [OFFSET] * 2, atol=1e-15)
    assert 2e-3 <= np.abs(OFFSET).min() <= np.abs(OFFSET).max() <= 1e-2


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("motions: all", "motions: some"), ("periods: 3", "periods: 4"), ("rotations: true", "rotations: 1"),
        ("rotations: true", "rotations: false"), ("symbol: Sn", "symbol: Fe"),
    ],
)  # fmt: skip
def test_bands_that_were_edited_are_refused(old, new, tmp_path):
    phonons("fcc").bands("GX", 2).write(tmp_path / "band.yaml")
    text = (tmp_path / "band.yaml").read_text()
    # without the digest, which would be the first to notice
    lines = [line for line in text.replace(old, new).splitlines() if "digest" not in line and "sha256" not in line]
    assert "\n".join(lines) != text
    (tmp_path / "band.yaml").write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError):
        gp.Bands.read(tmp_path / "band.yaml")


@pytest.mark.parametrize(
    ("lattice", "path", "periods", "said"),
    [
        ("fcc", "GX", 2, "a group_velocity across its 2 periods"),
        ("fcc", "XW", 1, "a group_velocity across its 1 period"),
        ("sc", [[0, 0, 0.1], [0, 0, 0.5]], 2, "a group_velocity across its 2 periods"),
        ("sc", [[0.5, 0, 0], [0.5, 0.5, 0]], 1, "a group_velocity across its 1 period"),
    ],
)
def test_bands_with_fewer_periods_than_their_lattice_are_refused(lattice, path, periods, said, tmp_path):
    phonons(lattice).bands(path, 2).write(tmp_path / "band.yaml")
    text = (tmp_path / "band.yaml").read_text().replace("periods: 3", f"periods: {periods}")
    (tmp_path / "band.yaml").write_text(text.partition("\n")[2])
    with pytest.raises(InputError, match=said):
        gp.Bands.read(tmp_path / "band.yaml")
    # of numbers in memory, velocities along the periods alone are left
    bands = phonons(lattice).bands(path, 2)
    with pytest.raises(InputError, match=f"leaves the (line|plane) of {periods} period"):
        replace(bands, group_velocities=bands.group_velocities[..., :periods])._check()


def test_a_mesh_beyond_all_memory_is_refused():
    with pytest.raises(InputError, match="1000000 x 1000000 x 1000000 wave vectors is too large"):
        phonons("fcc").dos((10**6,) * 3)
