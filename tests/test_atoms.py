"""gp.atoms among ASE's own tools: what copies and files keep, optimisers, dynamics, vibrations."""

from __future__ import annotations

import json

import ase.io
import numpy as np
import pytest
from ase import Atoms
from ase.build import make_supercell
from ase.calculators.calculator import compare_atoms
from ase.db import connect
from ase.io.jsonio import decode, encode
from ase.md.verlet import VelocityVerlet
from ase.optimize import BFGS, FIRE
from ase.vibrations import Vibrations, VibrationsData

import granphon as gp
from granphon.errors import InputError

DIAMETER = 8e-3
STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ARRAYS = ("diameter_deviations", "displacements", "rotations", "radius")
SCALES = ("granphon_length_m", "granphon_stiffness_N_per_m", "granphon_mass_kg")


def at_overlap(relative=0.02, friction=True, lattice="triangular", finite_overlap=None):
    packing = gp.Packing(STEEL, DIAMETER, lattice=lattice, friction=friction)
    return gp.AveragedLattice(packing).at_overlap(relative * DIAMETER, finite_overlap=finite_overlap)


def marked(state, shape=(3, 2, 1)):
    """A cell whose arrays are all different, so that nothing can be lost or reordered unseen."""
    balls = gp.atoms(state).repeat(shape)
    rng = np.random.default_rng(1)
    n = len(balls)
    balls.set_array("diameter_deviations", 1e-3 * rng.normal(size=n))
    balls.set_array("rotations", 1e-4 * rng.normal(size=n))
    shift = np.zeros((n, 3))
    shift[:, :2] = 1e-4 * rng.normal(size=(n, 2))
    balls.set_array("displacements", shift)
    balls.set_array("radius", 0.5 * (1.0 + balls.arrays["diameter_deviations"]))
    balls.positions += shift
    balls.set_masses(1.0 + 0.1 * rng.uniform(size=n))
    return balls


# -- what gp.atoms makes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("finite_overlap", [False, True])
def test_one_cell_of_the_triangular_lattice(finite_overlap):
    state = at_overlap(finite_overlap=finite_overlap)
    balls = gp.atoms(state)
    spacing = 1.0 - 0.02 if finite_overlap else 1.0
    assert type(balls) is Atoms
    assert len(balls) == 1
    # ASE itself recognises the HEX2D cell, in its own orientation, and has the special points where the paper has them
    assert balls.cell.get_bravais_lattice(pbc=balls.pbc).name == "HEX2D"
    np.testing.assert_allclose(balls.cell.lengths(), [spacing, spacing, 1.0], rtol=1e-15)
    np.testing.assert_allclose(balls.cell.angles(), [90.0, 90.0, 120.0], rtol=1e-14)
    np.testing.assert_array_equal(balls.cell[0], [spacing, 0.0, 0.0])
    points = balls.cell.bandpath(npoints=0, pbc=balls.pbc).special_points
    np.testing.assert_allclose(points["K"], [1 / 3, 1 / 3, 0.0], atol=1e-15)
    np.testing.assert_allclose(points["M"], [1 / 2, 0.0, 0.0], atol=1e-15)
    np.testing.assert_array_equal(balls.pbc, [True, True, False])
    np.testing.assert_array_equal(balls.get_masses(), 1.0)
    assert isinstance(balls.calc, gp.HertzMindlin)
    assert balls.calc.finite_overlap is finite_overlap
    for name in ARRAYS:
        assert balls.arrays[name].dtype == float
    np.testing.assert_array_equal(balls.arrays["radius"], 0.5)
    assert [balls.info[key] for key in SCALES] == [
        pytest.approx(DIAMETER),
        pytest.approx(state.normal_stiffness),
        pytest.approx(np.pi / 6.0 * 7840.0 * DIAMETER**3),
    ]
    assert gp.Units.from_info(balls.info) == state.scales


@pytest.mark.parametrize(("lattice", "count", "neighbours"), [("square", 1, 4), ("kagome", 3, 4)])
def test_other_lattices(lattice, count, neighbours):
    balls = gp.atoms(at_overlap(lattice=lattice))
    assert len(balls) == count
    many = balls.repeat((3, 3, 1))
    distance = many.get_all_distances(mic=True)
    touching = np.sum(np.abs(distance - 1.0) < 1e-9, axis=1)
    np.testing.assert_array_equal(touching, neighbours)


# -- copies -------------------------------------------------------------------------------------------------------------

COPIES = {
    "copy": lambda balls: (balls.copy(), np.arange(6)),
    "slice": lambda balls: (balls[1:4], np.arange(1, 4)),
    "index array": lambda balls: (balls[[4, 0, 2]], np.array([4, 0, 2])),
    "mask": lambda balls: (balls[np.arange(6) % 2 == 1], np.array([1, 3, 5])),
    "repeat": lambda balls: (balls.repeat((2, 3, 1)), np.tile(np.arange(6), 6)),
    "multiply": lambda balls: (balls * (2, 1, 1), np.tile(np.arange(6), 2)),
    "todict": lambda balls: (Atoms.fromdict(balls.todict()), np.arange(6)),
}


@pytest.mark.parametrize("how", COPIES)
def test_copies_keep_everything_but_the_calculator(how):
    state = at_overlap()
    balls = marked(state)
    balls.calc = gp.HertzMindlin(state)
    out, order = COPIES[how](balls)
    assert out.calc is None
    for name in (*ARRAYS, "masses"):
        np.testing.assert_array_equal(out.arrays[name], balls.arrays[name][order], err_msg=name)
    assert {key: out.info[key] for key in SCALES} == {key: balls.info[key] for key in SCALES}
    assert gp.Units.from_info(out.info) == state.scales
    np.testing.assert_array_equal(out.pbc, balls.pbc)
    # what a copy holds is its own (a dictionary holds the arrays themselves)
    assert np.shares_memory(out.arrays["rotations"], balls.arrays["rotations"]) is (how == "todict")
    # taken up again, the calculator reads the arrays
    out.calc = gp.HertzMindlin(state)
    if how in ("copy", "todict"):
        assert out.get_potential_energy() == balls.get_potential_energy()
    if how == "repeat":
        assert out.get_potential_energy() == pytest.approx(6 * balls.get_potential_energy(), rel=1e-11)


def test_make_supercell_keeps_the_arrays():
    # ASE's make_supercell drops info: Phonons takes the scales from the state, and so does the calculator
    state = at_overlap()
    out = make_supercell(gp.atoms(state), [[2, 1, 0], [-1, 3, 0], [0, 0, 1]])
    assert len(out) == 7
    assert set(ARRAYS) <= set(out.arrays)
    assert out.info == {}
    with pytest.raises(InputError, match=r"scales .* are missing"):
        gp.Units.from_info(out.info)
    out.calc = gp.HertzMindlin(state)
    assert out.get_potential_energy() == pytest.approx(7 * gp.atoms(state).get_potential_energy(), rel=1e-12)


def test_two_atoms_do_not_share_arrays():
    state = at_overlap()
    first, second = gp.atoms(state), gp.atoms(state)
    first.arrays["rotations"][0] = 1.0
    assert second.arrays["rotations"][0] == 0.0


# -- files --------------------------------------------------------------------------------------------------------------


def test_extxyz_keeps_everything_to_eight_decimals(tmp_path):
    state = at_overlap()
    balls = marked(state)
    path = tmp_path / "balls.extxyz"
    ase.io.write(path, balls)
    back = ase.io.read(path)
    for name in (*ARRAYS, "masses", "positions"):
        np.testing.assert_allclose(back.arrays[name], balls.arrays[name], rtol=0.0, atol=5.000001e-9, err_msg=name)
    # the scales and the cell keep every digit: they are in the header
    assert gp.Units.from_info(back.info) == state.scales
    np.testing.assert_array_equal(np.asarray(back.cell), np.asarray(balls.cell))
    np.testing.assert_array_equal(back.pbc, balls.pbc)
    # eight decimals and no more
    assert np.abs(back.arrays["rotations"] - balls.arrays["rotations"]).max() > 1e-10
    assert "radius" in path.read_text().splitlines()[1], "viewers find the radius by its name"
    back.calc = gp.HertzMindlin(state)
    balls.calc = gp.HertzMindlin(state)
    assert back.get_potential_energy() == pytest.approx(balls.get_potential_energy(), rel=1e-6)
    again = tmp_path / "again.extxyz"
    ase.io.write(again, back)
    np.testing.assert_array_equal(ase.io.read(again).arrays["rotations"], back.arrays["rotations"])


def test_extxyz_stores_the_results_with_the_balls(tmp_path):
    state = at_overlap()
    balls = marked(state)
    balls.calc = gp.HertzMindlin(state)
    energy, forces, stress = balls.get_potential_energy(), balls.get_forces(), balls.get_stress()
    ase.io.write(tmp_path / "balls.extxyz", balls)
    back = ase.io.read(tmp_path / "balls.extxyz")
    assert not isinstance(back.calc, gp.HertzMindlin)
    assert back.get_potential_energy() == pytest.approx(energy, rel=1e-12)
    np.testing.assert_allclose(back.get_forces(), forces, atol=5.1e-9)
    np.testing.assert_allclose(back.get_stress(), stress, rtol=1e-12)


def test_json_of_todict_keeps_every_digit(tmp_path):
    # the one way through ASE without loss; a file holds the text
    state = at_overlap()
    balls = marked(state)
    path = tmp_path / "balls.json"
    path.write_text(encode(balls.todict()))
    assert set(ARRAYS) <= set(json.loads(path.read_text()))
    back = Atoms.fromdict(decode(path.read_text()))
    assert compare_atoms(balls, back, tol=0.0) == []
    for name in (*ARRAYS, "masses"):
        np.testing.assert_array_equal(back.arrays[name], balls.arrays[name])
    assert back.info == balls.info
    back.calc, balls.calc = gp.HertzMindlin(state), gp.HertzMindlin(state)
    assert back.get_potential_energy() == balls.get_potential_energy()


@pytest.mark.parametrize(
    ("name", "keeps_info"), [("balls.traj", True), ("balls_json.json", False), ("balls.db", False), ("balls.bundle", False)]
)
def test_formats_that_keep_positions_only(tmp_path, name, keeps_info):
    # ASE's own formats drop arrays they do not know; one that begins to keep them should be recommended
    state = at_overlap()
    balls = marked(state)
    form = {"bundle": "bundletrajectory"}.get(name.rsplit(".", 1)[1])
    ase.io.write(tmp_path / name, balls, format=form)
    back = ase.io.read(tmp_path / name, format=form)
    np.testing.assert_array_equal(back.positions, balls.positions)
    np.testing.assert_array_equal(back.get_masses(), balls.get_masses())
    assert not set(ARRAYS) & set(back.arrays)
    assert (set(SCALES) <= set(back.info)) is keeps_info


def test_database_rows_carry_the_arrays_as_data(tmp_path):
    state = at_overlap()
    balls = marked(state)
    with connect(tmp_path / "balls.db") as rows:
        rows.write(balls, data={**{name: balls.arrays[name] for name in ARRAYS}, **balls.info})
        row = rows.get(1)
    back = row.toatoms()
    for name in ARRAYS:
        back.set_array(name, row.data[name])
    for name in ARRAYS:
        np.testing.assert_array_equal(back.arrays[name], balls.arrays[name])
    assert gp.Units.from_info(row.data) == state.scales


@pytest.mark.parametrize("arrays", [("rotations", "diameter_deviations", "radius", "displacements")])
# ASE warns that the height of a cell that is not periodic has no place in this format
@pytest.mark.filterwarnings("ignore:Atoms have nonperiodic directions:UserWarning")
def test_netcdf_keeps_named_arrays(tmp_path, arrays):
    from ase.io.netcdftrajectory import NetCDFTrajectory

    balls = marked(at_overlap())
    with NetCDFTrajectory(tmp_path / "balls.nc", "w") as file:
        file.write(balls, arrays=list(arrays))
    with NetCDFTrajectory(tmp_path / "balls.nc", "r") as file:
        back = file[0]
    for name in arrays:
        np.testing.assert_array_equal(back.arrays[name], balls.arrays[name], err_msg=name)
    # positions go through cell lengths and angles in single precision, and masses and scales are lost
    np.testing.assert_allclose(back.positions, balls.positions, atol=1e-6)
    assert not set(SCALES) & set(back.info)


# -- optimisers, dynamics, vibrations -----------------------------------------------------------------------------------


@pytest.mark.parametrize("optimiser", [BFGS, FIRE])
@pytest.mark.parametrize("finite_overlap", [False, True], ids=["limit", "finite"])
@pytest.mark.parametrize("friction", [False, True], ids=["smooth", "rough"])
def test_rattled_balls_relax_to_the_lattice(optimiser, finite_overlap, friction):
    state = at_overlap(friction=friction, finite_overlap=finite_overlap)
    balls = gp.atoms(state).repeat((3, 3, 1))
    lattice = balls.positions.copy()
    rest = 9 * gp.atoms(state).get_potential_energy()
    rng = np.random.default_rng(2)
    balls.positions[:, :2] += 2e-3 * rng.normal(size=(9, 2))
    balls.calc = gp.HertzMindlin(state)
    assert balls.get_potential_energy() > rest * 1.001
    # reduced forces are of the size of the overlap, and the time step of FIRE in units of (M/k)^1/2
    options = {"dt": 0.1, "dtmax": 0.5, "maxstep": 0.01} if optimiser is FIRE else {"alpha": 5.0, "maxstep": 0.01}
    with optimiser(balls, logfile=None, **options) as search:
        assert search.run(fmax=1e-10, steps=2000)
    away = balls.positions - lattice
    np.testing.assert_allclose(away - away.mean(axis=0), 0.0, atol=1e-9)
    assert balls.get_potential_energy() == pytest.approx(rest, rel=1e-12)


@pytest.mark.parametrize("finite_overlap", [False, True], ids=["limit", "finite"])
def test_dynamics_conserves_energy_to_second_order(finite_overlap):
    state = at_overlap(friction=False, finite_overlap=finite_overlap)
    start = gp.atoms(state).repeat((3, 3, 1))
    rng = np.random.default_rng(3)
    momenta = np.zeros((9, 3))
    momenta[:, :2] = 2e-3 * rng.normal(size=(9, 2))
    momenta -= momenta.mean(axis=0)

    def drift(step):
        balls = start.copy()
        balls.calc = gp.HertzMindlin(state)
        balls.set_momenta(momenta)
        energies = [balls.get_total_energy()]
        with VelocityVerlet(balls, timestep=step) as run:
            for _ in range(round(8.0 / step)):
                run.run(1)
                energies.append(balls.get_total_energy())
        np.testing.assert_allclose(balls.get_momenta().sum(axis=0), 0.0, atol=1e-14)
        return np.abs(np.array(energies) - energies[0]).max(), balls.get_kinetic_energy()

    (coarse, kinetic), (fine, _) = drift(0.1), drift(0.05)
    assert coarse / fine == pytest.approx(4.0, rel=0.02)
    assert fine < 2e-3 * np.sum(momenta**2) / 2.0
    assert kinetic != pytest.approx(np.sum(momenta**2) / 2.0, rel=0.05), "energy went to and fro"


@pytest.mark.parametrize("name", ["lattice", "vacancy"])
def test_vibrations_data_from_force_constants(name):
    # VibrationsData takes (N, 3, N, 3) and masses; its energies are hbar omega with k in eV/A^2 and M in amu
    state = at_overlap()
    balls = gp.atoms(state).repeat((3, 3, 1))
    balls.set_masses(np.linspace(1.0, 2.0, 9))
    if name == "vacancy":
        del balls[4]
    calc = gp.HertzMindlin(state)
    data = VibrationsData(balls, calc.get_force_constants(balls).transpose(0, 2, 1, 3))
    lattice = calc.contact_lattice(balls)
    expected = lattice.frequencies([[0.0, 0.0]])[0]
    np.testing.assert_allclose(expected[:2], 0.0, atol=1e-15)
    energies = data.get_energies()
    unit = VibrationsData(Atoms("H", masses=[1.0]), np.eye(3).reshape(1, 3, 1, 3)).get_energies()[0].real
    np.testing.assert_allclose((energies / unit).real[2:], expected[2:], rtol=1e-12)
    np.testing.assert_allclose(np.abs(energies / unit)[:2], 0.0, atol=1e-7)


def test_ase_vibrations_runs_its_own_differences(tmp_path):
    # frictionless: ASE displaces x, y and z, and z has neither force nor stiffness, as w has none
    state = at_overlap(friction=False, finite_overlap=True)
    balls = gp.atoms(state).repeat((3, 3, 1))
    balls.calc = gp.HertzMindlin(state)
    run = Vibrations(balls, name=str(tmp_path / "vib"), delta=1e-4)
    run.run()
    hessian = run.get_vibrations().get_hessian()
    exact = balls.calc.get_force_constants(balls).transpose(0, 2, 1, 3)
    # relative error (delta / 2 overlap)^2 / 24 of the stiffest contact
    np.testing.assert_allclose(hessian, exact, atol=1e-5)
    np.testing.assert_array_equal(hessian[:, 2], 0.0)
