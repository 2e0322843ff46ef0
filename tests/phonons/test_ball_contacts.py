"""Any balls in ASE, in SI: relaxed to a crystal's equilibrium, and what ASE itself finds by the
entry points.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
import warnings
from dataclasses import replace
from pathlib import Path

import ase
import numpy as np
import pytest
from ase.filters import FrechetCellFilter
from ase.optimize import BFGS

import granphon as gp
from granphon.base.errors import InconsistencyWarning, InputError
from granphon.phonons.ball_contacts import read_granphon_lammps, read_granphon_tables

ROOT = Path(__file__).parents[2]
STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
BRASS = gp.Material(young_modulus=103e9, poisson_ratio=0.34, density=8500.0)
BALLS = {"A": gp.Ball(STEEL, 8e-3, name="A"), "B": gp.Ball(BRASS, 8e-3, name="B")}


def atoms_of(network, cell=None):
    """The balls of a network, in m, with their kinds and radii, and a cell whose other vectors have
    one diameter.
    """
    cell = np.array(network.cell if cell is None else cell)
    open_sides = ~np.array(network.pbc)
    cell[open_sides] = 8e-3 * np.eye(3)[open_sides]
    balls = ase.Atoms(
        "X" * network.n_balls, positions=network.positions, cell=cell, pbc=network.pbc
    )
    balls.set_array("radius", np.array(network.radii))
    balls.set_array("kinds", np.array(network.kinds))
    return balls


@pytest.mark.parametrize(
    "law",
    [None, gp.JKR(10.0), {("A", "A"): gp.Hertz(), ("A", "B"): gp.JKR(5.0), ("B", "B"): "hertz"}],
)
def test_forces_and_stress_are_slopes_of_the_energy(law):
    rng = np.random.default_rng(7)
    balls = ase.Atoms("X" * 8, cell=np.diag([15.98e-3] * 3), pbc=True)
    balls.positions = 7.99e-3 * np.stack(np.meshgrid(*[[0, 1]] * 3), -1).reshape(-1, 3)
    balls.positions += 1e-6 * rng.standard_normal((8, 3))
    balls.set_array("radius", 4e-3 + 2e-6 * rng.standard_normal(8))
    balls.set_array("kinds", rng.choice(["A", "B"], 8))
    balls.calc = gp.HertzMindlin(BALLS, law=law)
    forces = balls.get_forces()
    stress = balls.get_stress(voigt=False)
    step = 1e-9
    assert np.abs(forces.sum(axis=0)).max() < 1e-12 * np.abs(forces).max()
    places = balls.positions.copy()
    energies = []
    for sign in (1.0, -1.0):
        balls.positions = places + sign * step * np.eye(3)[1] * (np.arange(8) == 5)[:, None]
        energies.append(balls.get_potential_energy())
    assert forces[5, 1] == pytest.approx(
        -(energies[0] - energies[1]) / (2.0 * step), rel=1e-6, abs=1e-4
    )
    energies = []
    cell = balls.cell.array.copy()
    strain = 1e-7
    for sign in (1.0, -1.0):
        bend = np.eye(3) + sign * strain * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]])
        balls.set_cell(cell @ bend)
        balls.positions = places @ bend
        energies.append(balls.get_potential_energy())
    slope = (energies[0] - energies[1]) / (2.0 * strain) / np.linalg.det(cell)
    assert 2.0 * stress[0, 1] + stress[2, 2] == pytest.approx(slope, rel=1e-6)


def test_a_chain_relaxes_to_the_crystal():
    crystal = gp.Crystal.on("chain", [BALLS["A"], BALLS["B"], BALLS["B"]])
    state = crystal.at_force(20.0)
    network = state.network
    span = float(crystal.cell[0, 0] - np.sum(state.overlap))
    balls = atoms_of(network, np.diag([span, 8e-3, 8e-3]))
    balls.positions[:, 0] *= span / crystal.cell[0, 0]
    balls.calc = gp.HertzMindlin(BALLS)
    assert np.ptp(balls.calc.contact_network(balls).normal_force) > 1.0
    BFGS(balls, alpha=3e7, maxstep=1e-6, logfile=None).run(fmax=1e-9, steps=100)
    found = balls.calc.contact_network(balls, dimension=1)
    np.testing.assert_allclose(found.normal_force, 20.0, rtol=1e-8)
    np.testing.assert_allclose(
        np.sort(found.normal_stiffness), np.sort(state.normal_stiffness), rtol=1e-8
    )
    waves = [np.sort(gp.Phonons(one).frequencies([[0.3]]).ravel()) for one in (found, state)]
    np.testing.assert_allclose(waves[0], waves[1], rtol=1e-6)


def test_a_plane_of_two_kinds_relaxes_to_the_crystal_at_its_pressure():
    crystal = gp.Crystal.on("square", [BALLS["A"]]).repeat((2, 2)).replace(3, BALLS["B"])
    state = crystal.at_pressure(4e3)
    balls = atoms_of(state.network)
    balls.calc = gp.HertzMindlin(BALLS)
    pressed = FrechetCellFilter(
        balls, mask=[1, 1, 0, 0, 0, 0], scalar_pressure=4e3 / 8e-3, exp_cell_factor=16e-3
    )
    BFGS(pressed, alpha=2e7, maxstep=2e-6, logfile=None).run(fmax=1e-7, steps=300)
    found = balls.calc.contact_network(balls, dimension=2)
    # delta/d is 1e-3
    np.testing.assert_allclose(np.sort(found.normal_force), np.sort(state.normal_force), rtol=2e-3)
    np.testing.assert_allclose(found.normal_force.mean(), 4e3 * 8e-3, rtol=2e-3)


def test_networks_have_mindlins_stiffness_and_the_masses_of_the_balls():
    crystal = gp.Crystal.on(
        "CsCl", [gp.Ball(STEEL, 8e-3, name="A"), gp.Ball(BRASS, 8e-3, name="B")]
    )
    state = crystal.at_force(5.0)
    scale = 1.0 - float(state.overlap[0]) / 8e-3
    balls = atoms_of(state.network)
    balls.set_cell(balls.cell.array * scale, scale_atoms=True)
    balls.calc = gp.HertzMindlin(BALLS)
    found = balls.calc.contact_network(balls)
    np.testing.assert_allclose(found.normal_force, 5.0, rtol=1e-8)
    np.testing.assert_allclose(found.shear_stiffness, state.shear_stiffness, rtol=1e-8)
    np.testing.assert_allclose(found.masses, state.network.masses, rtol=1e-14)
    assert gp.Waves(balls).network.n_contacts == len(state.overlap)
    smooth = gp.HertzMindlin(BALLS, friction=False).contact_network(balls)
    assert not smooth.shear_stiffness.any()


@pytest.mark.parametrize("law", [None, gp.PowerLaw(1.4, 2e8)])
def test_networks_are_judged_by_the_materials_of_their_kinds_and_their_law(law):
    pair = {"A": gp.Ball(STEEL, 8e-3, name="A"), "B": gp.Ball(BRASS, 6e-3, name="B")}
    state = gp.Crystal.on("CsCl", list(pair.values()), law=law).at_force(5.0)
    balls = atoms_of(state.network)
    touch = float(np.linalg.norm(state.network.vector[0]))
    scale = 1.0 - float(state.overlap[0]) / touch
    balls.set_cell(balls.cell.array * scale, scale_atoms=True)
    network = gp.HertzMindlin(pair, law=law).contact_network(balls)
    checks = {check.name: check.value for check in gp.validity(network).checks}
    assert checks["masses"] < 1e-12
    if law is None:
        assert max(checks[name] for name in ("stiffness", "law", "scatter")) < 1e-8
        softer = replace(network, normal_stiffness=0.8 * network.normal_stiffness)
        failed = {check.name: check.value for check in gp.validity(softer).checks}
        assert failed["stiffness"] == pytest.approx(0.2, abs=1e-8)
    else:  # forces of another law cannot be compared with Hertz's
        assert not {"stiffness", "law", "scatter"} & {*checks}


def test_what_cannot_be_served():
    balls = ase.Atoms("X2", positions=[[0, 0, 0], [7.999e-3, 0, 0]])
    for calc, told in (
        (gp.HertzMindlin(BALLS), "no ball for the kind X"),
        (gp.HertzMindlin({"X": STEEL}), "no array 'radius'"),
        (
            gp.HertzMindlin({"X": BALLS["A"]}, law={("A", "A"): gp.Hertz()}),
            r"law has none for contacts of \('X', 'X'\)",
        ),
    ):
        with pytest.raises(InputError, match=told):
            calc.get_property("energy", balls)
    with pytest.raises(InputError, match="no volume"):
        gp.HertzMindlin({"X": BALLS["A"]}).get_property("stress", balls)
    with pytest.raises(InputError, match=r"Give a granphon\.Ball"):
        gp.HertzMindlin({})
    with pytest.raises(InputError, match="friction"):  # it is no factor of the shear stiffness
        gp.HertzMindlin(BALLS, friction=0.3)
    assert gp.HertzMindlin(BALLS).get_property("energy", ase.Atoms()) == 0.0
    one = gp.HertzMindlin({"X": BALLS["A"]})
    pushed = abs(one.get_property("forces", balls)[0, 0])
    assert pushed == pytest.approx(
        float(gp.Hertz().between(BALLS["A"], BALLS["A"]).force(1e-6)), rel=1e-8
    )
    balls.set_array("radius", np.array([4.001e-3, 4e-3]))
    assert abs(one.get_property("forces", balls)[0, 0]) > 2.0 * pushed  # a change of radii is seen


def test_places_that_are_not_in_metres_are_told():
    pair = ase.Atoms("X2", positions=[[0, 0, 0], [7.999, 0, 0]])
    calculator = gp.HertzMindlin({"X": BALLS["A"]})
    with warnings.catch_warnings(record=True) as told:  # ASE's own warnings stay as they are
        warnings.simplefilter("always", InconsistencyWarning)
        assert calculator.get_property("energy", pair) == 0.0
    (warning,) = (each for each in told if each.category is InconsistencyWarning)
    assert "8 m" in str(warning.message)
    apart = ase.Atoms("X2", positions=2e-3 * pair.positions)  # by two diameters, as balls that fly
    assert calculator.get_property("energy", apart) == 0.0
    # networks, and a ball that would touch its own image
    alone = ase.Atoms("X", cell=[7.999, 1, 1], pbc=(True, False, False))
    for balls in (pair, alone):
        with pytest.warns(InconsistencyWarning, match="8 m"), pytest.raises(InputError):
            calculator.contact_network(balls)
    # radii in mm
    pair.positions *= 1e-3
    pair.set_array("radius", np.full(2, 4.0))
    with pytest.warns(InconsistencyWarning, match="8 m wide"):
        calculator.find_contacts(pair)
    pair.set_cell([16e-3, 1.0, 1.0])
    pair.pbc = (True, False, False)
    with pytest.raises(InputError, match="period"):
        calculator.get_property("energy", pair)


@pytest.mark.filterwarnings("ignore:.*disks_pairs.dump.* law")  # forces are of another material
@pytest.mark.parametrize("program", ["lammps", "tables"])
def test_readers_for_viewers_keep_balls_without_load(program, tmp_path):
    """A viewer shows all balls of a file; one of these 30 is a rattler."""
    files = tuple(
        ROOT / "examples" / "packings" / f"disks_{what}.dump" for what in ("atoms", "pairs")
    )
    glass = gp.Material(70e9, 0.2, 2500.0)
    read = read_granphon_lammps
    if program == "tables":
        whole, read = (
            gp.ContactNetwork.from_lammps(*files, glass, keep_rattlers=True),
            read_granphon_tables,
        )
        files = tmp_path / "balls.csv", tmp_path / "contacts.csv"
        whole.write_tables(*files)
    assert len(read(files[0])) == len(read(*files, material=glass)) == 30
    assert len(read(files[0], keep_rattlers=False)) == 29
    balls = read(*files, material=glass)
    assert np.flatnonzero(balls.arrays["rattler"]).tolist() == [26]  # LAMMPS' ball 27


def test_the_reader_of_dumps_for_viewers_ignores_no_stiffness():
    files = [ROOT / "examples" / "packings" / f"disks_{what}.dump" for what in ("atoms", "pairs")]
    with pytest.raises(InputError, match="shear_stiffness"):
        read_granphon_lammps(*files, shear_stiffness=-1.0)


def test_readers_for_viewers_keep_balls_that_are_held(tmp_path):
    """A ball on a ball that is held, above a flat wall: a wall has no size, and is none of the
    Atoms.
    """
    (tmp_path / "balls.csv").write_text(
        "x (m),y (m),radius (m),mass (kg)\n0,0,1,1\n0,-2,1,inf\n1,0,inf,inf\n"
    )
    (tmp_path / "contacts.csv").write_text(
        "i,j,nx,ny,normal_force (N),normal_stiffness (N/m)\n0,1,0,-1,1,1\n0,2,1,0,1,1\n"
    )
    balls = read_granphon_tables(tmp_path / "balls.csv", dimension=2, friction=False)
    assert balls.arrays["radius"].tolist() == [0.5, 0.5]
    assert balls.get_masses().tolist() == [1.0, np.inf]


def test_ase_finds_calculator_and_formats_by_itself(tmp_path):
    """In a process in which granphon is installed, as its entry points say."""
    points = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "entry-points"
    ]
    lines = [
        line
        for group, own in points.items()
        for line in (f"[{group}]", *(f"{k} = {v}" for k, v in own.items()))
    ]
    info = tmp_path / "granphon-0.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: granphon\nVersion: 0.1.0\n")
    (info / "entry_points.txt").write_text("\n".join(lines))
    crystal = gp.Crystal.on(
        "NaCl", [gp.Ball(STEEL, 8e-3, name="A"), gp.Ball(BRASS, 8e-3, name="B")]
    ).at_force(5.0)
    crystal.network.write_tables(tmp_path / "salt_balls.csv", tmp_path / "salt_contacts.csv")
    crystal.network.write_tables(tmp_path / "first.csv", tmp_path / "second.csv")
    code = f"""
import ase.io
from ase.io.formats import filetype, get_ioformat, ioformats
assert get_ioformat("granphon-tables").can_read and get_ioformat("granphon-lammps").can_read
assert filetype("salt_balls.csv") == filetype("first.csv") == "granphon-tables"
balls = ase.io.read("salt_balls.csv")
again = ase.io.read("first.csv", contacts="second.csv")
assert (balls.positions == again.positions).all() and balls.get_chemical_symbols() == again.get_chemical_symbols()
print(len(balls), balls.arrays["radius"].round(12).tolist(), balls.arrays["kinds"].tolist(), balls.pbc.all())
dump = ase.io.read({str(ROOT / "examples" / "packings" / "balls_atoms.dump")!r}, format="granphon-lammps")
print(len(dump) > 10, abs(dump.arrays["radius"].mean() - 0.5) < 1e-12)
from ase.gui.images import Images
images = Images()
images.read(["salt_balls.csv"])
print(len(images))
try:
    from ase._4.plugins import plugins
except ImportError:
    print("none")
else:
    (one,) = [one for one in plugins.calculators if one.package == "granphon"]
    print(one.name, one.implementation.__name__, one.version)
"""
    paths = os.pathsep.join([str(tmp_path), str(ROOT)])
    run = subprocess.run(
        [sys.executable, "-W", "error:Failed to register", "-c", code],
        cwd=tmp_path,
        text=True,
        capture_output=True,
        check=False,
        env=os.environ | {"PYTHONPATH": paths},
    )
    assert run.returncode == 0, run.stderr
    *lines, plugin = run.stdout.splitlines()
    assert lines == ["2 [0.5, 0.5] ['A', 'B'] True", "True True", "1"]
    if plugin == "none":
        pytest.skip("this ASE has no plug-ins")
    assert plugin.split() == ["hertz-mindlin", "HertzMindlin", "0.1.0"]


@pytest.mark.parametrize("radius", [np.ones((2, 2)), np.array(["a", "b"]), np.array([1.0, 0.0])])
def test_radii_are_numbers_above_zero_for_each_ball(radius):
    pair = ase.Atoms("X2", positions=[[0.0, 0.0, 0.0], [0.0, 0.0, 0.9]])
    pair.set_array("radius", radius)
    with pytest.raises(InputError, match="radius"):
        gp.HertzMindlin({"X": STEEL}).find_radii(pair)


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ([np.inf, 1.0, 1.0], "not finite"),
        ([np.nan, 1.0, 1.0], "not finite"),
        ([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "without a volume"),
    ],
)
def test_cells_that_span_no_space_are_refused(cell, words):
    balls = ase.Atoms("X", cell=cell, pbc=True)
    balls.set_array("kinds", np.array(["A"]))
    balls.calc = gp.HertzMindlin(BALLS)
    with pytest.raises(InputError, match=words):
        balls.get_potential_energy()


def test_readers_for_viewers_refuse_what_is_no_path():
    for read in (read_granphon_tables, read_granphon_lammps):
        with pytest.raises(InputError, match="path"):
            read(5)
