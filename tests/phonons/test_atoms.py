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
from ase.vibrations import VibrationsData

import granphon as gp
from granphon.base.errors import InputError, OutputError
from tests.phonons import conftest
from tests.phonons.conftest import DIAMETER, STEEL

ARRAYS = (
    "diameter_deviations",
    "displacements",
    "slip_origin",
    "rotations",
    "radius",
    "granphon_scales",
    "granphon_kind",
)
SCALES = ("granphon_length_m", "granphon_stiffness_N_per_m", "granphon_mass_kg")


def at_overlap(relative=0.02, **options):
    return conftest.at_overlap(relative, **options)


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
    balls.set_array("slip_origin", 0.5 * shift)
    balls.set_array("radius", 0.5 * (1.0 + balls.arrays["diameter_deviations"]))
    balls.positions += shift
    balls.set_masses(1.0 + 0.1 * rng.uniform(size=n))
    return balls


# -- what gp.atoms makes ---------------------------------------------------------------------------


@pytest.mark.parametrize("finite_overlap", [False, True])
def test_one_cell_of_the_triangular_lattice(finite_overlap):
    state = at_overlap(finite_overlap=finite_overlap)
    balls = gp.atoms(state)
    spacing = 1.0 - 0.02 if finite_overlap else 1.0
    assert type(balls) is Atoms
    assert len(balls) == 1
    # in ASE's own orientation, and the special points are where the paper has them
    np.testing.assert_array_equal(balls.cell[0], [spacing, 0.0, 0.0])
    points = balls.cell.bandpath(npoints=0, pbc=balls.pbc).special_points
    np.testing.assert_allclose(points["K"], [1 / 3, 1 / 3, 0.0], atol=1e-15)
    np.testing.assert_allclose(points["M"], [1 / 2, 0.0, 0.0], atol=1e-15)
    np.testing.assert_array_equal(balls.pbc, [True, True, False])
    np.testing.assert_array_equal(balls.get_masses(), 1.0)
    assert isinstance(balls.calc, gp.HertzMindlin)
    assert balls.calc.finite_overlap is finite_overlap
    for name in ARRAYS:
        assert balls.arrays[name].dtype == (int if name == "granphon_kind" else float)
    np.testing.assert_array_equal(balls.arrays["radius"], 0.5)
    assert [balls.info[key] for key in SCALES] == [
        pytest.approx(DIAMETER),
        pytest.approx(state.normal_stiffness),
        pytest.approx(np.pi / 6.0 * 7840.0 * DIAMETER**3),
    ]
    assert gp.Units.from_info(balls.info) == state.scales


# -- copies ----------------------------------------------------------------------------------------

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
        assert out.get_potential_energy() == pytest.approx(
            6 * balls.get_potential_energy(), rel=1e-11
        )


def test_make_supercell_keeps_the_arrays():
    # ASE's make_supercell drops info, and with it the scales; the arrays say to which state the
    # balls belong
    state = at_overlap()
    out = make_supercell(gp.atoms(state), SEVEN)
    assert len(out) == 7
    assert set(ARRAYS) <= set(out.arrays)
    assert out.info == {}
    with pytest.raises(InputError, match=r"scales .* are missing"):
        gp.Units.from_info(out.info)
    out.calc = gp.HertzMindlin(state)
    assert out.get_potential_energy() == pytest.approx(
        7 * gp.atoms(state).get_potential_energy(), rel=1e-12
    )
    assert gp.Units.from_info(gp.HertzMindlin(state).adopt(out).info) == state.scales


SEVEN = [[2, 1, 0], [-1, 3, 0], [0, 0, 1]]
GUARDED = {
    "as made": lambda balls: balls,
    "make_supercell": lambda balls: make_supercell(balls, SEVEN),
    "repeat": lambda balls: balls.repeat((2, 2, 1)),
    "slice": lambda balls: balls.repeat((2, 2, 1))[1:3],
    "without info": lambda balls: (balls.info.clear(), balls)[1],
}


@pytest.mark.claim("atoms-refused")
@pytest.mark.parametrize("how", GUARDED)
def test_atoms_of_another_state_are_refused_wherever_they_went(how):
    # twice the overlap is 2^(5/2) = 5.66 times the energy
    state, finite = at_overlap(), at_overlap(finite_overlap=True)
    cases = [
        (state, at_overlap(0.04), "units of another state|granphon_stiffness"),
        (state, finite, "made without finite overlap"),
        (finite, state, "made with finite overlap"),
    ]
    for theirs, other, words in cases:
        balls = GUARDED[how](gp.atoms(theirs))
        balls.calc = calc = gp.HertzMindlin(other)
        asked = [Atoms.get_potential_energy, calc.get_force_constants, calc.adopt]
        for ask in (*asked, lambda one, other=other: gp.Phonons(other, one)):
            with pytest.raises(InputError, match=words):
                ask(balls)


def test_balls_put_together():
    state = at_overlap()
    three = gp.atoms(state).repeat((3, 1, 1))
    three.pbc = False
    three.calc = gp.HertzMindlin(state)
    more = three[:2] + three[2:]
    more.calc = gp.HertzMindlin(state)
    assert more.get_potential_energy() == three.get_potential_energy()
    # an atom without arrays gets zeros from ASE, and the mass of iron
    more = three[:2] + Atoms("Fe", positions=[[2, 0, 0]])
    more.calc = gp.HertzMindlin(state)
    with pytest.raises(InputError, match=r"no masses\."):
        more.get_potential_energy()
    more.set_masses(np.ones(3))
    more.calc = gp.HertzMindlin(state)
    with pytest.raises(InputError, match=r"ball 2 .*added without any"):
        more.get_potential_energy()
    mixed = gp.atoms(state).repeat((2, 1, 1))
    mixed.arrays["granphon_kind"][0] = gp.atoms(at_overlap(finite_overlap=True)).arrays[
        "granphon_kind"
    ][0]
    with pytest.raises(InputError, match="different lattices"):
        gp.HertzMindlin(state).get_force_constants(mixed)


# -- atoms from elsewhere --------------------------------------------------------------------------


def bare(state):
    one = gp.atoms(state)
    return Atoms("Fe", positions=one.positions, cell=one.cell, pbc=one.pbc)


def test_iron_is_not_taken_for_a_ball():
    state = at_overlap()
    with pytest.raises(InputError, match=r"adopt\(atoms\)"):
        gp.Phonons(state, bare(state))
    expected = gp.Phonons(state).frequencies([[0.1, 0.0]])
    adopted = gp.HertzMindlin(state).adopt(bare(state))
    np.testing.assert_allclose(
        gp.Phonons(state, adopted).frequencies([[0.1, 0.0]]), expected, rtol=1e-12
    )
    assert gp.Units.from_info(adopted.info) == state.scales


def test_adopted_balls_keep_what_they_have():
    state = at_overlap()
    balls = bare(state).repeat((2, 1, 1))
    balls.set_array("diameter_deviations", np.array([1e-3, -1e-3]))
    adopted = gp.HertzMindlin(state).adopt(balls)
    np.testing.assert_array_equal(adopted.arrays["diameter_deviations"], [1e-3, -1e-3])
    np.testing.assert_allclose(adopted.get_masses(), [1.001**3, 0.999**3], rtol=1e-15)
    np.testing.assert_array_equal(adopted.arrays["radius"], [0.5005, 0.4995])
    assert isinstance(adopted.calc, gp.HertzMindlin)
    assert adopted.get_potential_energy() > 0.0
    assert not balls.has("masses")
    assert balls.info == {}
    heavy = bare(state)
    heavy.set_masses([2.0])
    assert gp.HertzMindlin(state).adopt(heavy).get_masses() == [2.0]
    with pytest.raises(InputError, match=r"1 balls.* 2"):
        gp.HertzMindlin(state).adopt(balls, like=gp.atoms(state))
    # like of another state
    with pytest.raises(InputError, match="units of another state"):
        gp.HertzMindlin(state).adopt(bare(state), like=gp.atoms(at_overlap(0.04)))


def test_adopted_balls_keep_their_masses_beside_balls_without_any():
    state = at_overlap()
    balls = bare(state).repeat((2, 1, 1))
    masses = balls.get_masses()  # ASE's, of its element
    masses[0] = 2.0
    balls.set_masses(masses)
    calculator = gp.HertzMindlin(state)
    np.testing.assert_array_equal(calculator.adopt(balls).get_masses(), [2.0, 1.0])
    like = gp.atoms(state).repeat((2, 1, 1))
    like.set_masses([3.0, 4.0])
    np.testing.assert_array_equal(calculator.adopt(balls, like=like).get_masses(), [2.0, 4.0])


def test_two_atoms_do_not_share_arrays():
    state = at_overlap()
    first = gp.atoms(state)
    second = gp.atoms(state)
    first.arrays["rotations"][0] = 1.0
    assert second.arrays["rotations"][0] == 0.0


# -- files -----------------------------------------------------------------------------------------


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
    back.calc = gp.HertzMindlin(state)
    balls.calc = gp.HertzMindlin(state)
    assert back.get_potential_energy() == balls.get_potential_energy()


@pytest.mark.parametrize(
    ("name", "keeps_info", "keeps_masses"),
    [
        ("balls.traj", True, True),
        ("balls_json.json", False, True),
        ("balls.db", False, True),
        ("balls.bundle", False, True),
        ("balls.xsf", False, False),
        ("balls.vasp", False, False),
        ("balls.dlp4", False, False),
        ("balls.nc", False, False),
    ],
)
# ASE warns that the height of a cell that is not periodic has no place in netCDF
@pytest.mark.claim("atoms-refused")
@pytest.mark.filterwarnings("ignore:Atoms have nonperiodic directions:UserWarning")
def test_formats_that_lose_arrays_are_refused_and_mended(tmp_path, name, keeps_info, keeps_masses):
    # ASE's own formats drop arrays they do not know; one that begins to keep them should be
    # recommended
    state = at_overlap()
    balls = marked(state)
    form = {"bundle": "bundletrajectory", "nc": "netcdftrajectory"}.get(name.rsplit(".", 1)[1])
    ase.io.write(tmp_path / name, balls, format=form)
    back = ase.io.read(tmp_path / name, format=form)
    assert not set(ARRAYS) & set(back.arrays)
    assert (set(SCALES) <= set(back.info)) is keeps_info
    assert bool(np.all(back.get_masses() == balls.get_masses())) is keeps_masses
    back.pbc = (True, True, False)  # not all keep this either
    calc = gp.HertzMindlin(state)
    for ask in (
        calc.get_force_constants,
        lambda one: calc.get_property("forces", one),
        lambda one: gp.Phonons(state, one),
    ):
        with pytest.raises(InputError, match=r"like=other"):
            ask(back)
    again = calc.adopt(back, like=balls)
    for array in (*ARRAYS, "masses"):
        np.testing.assert_array_equal(again.arrays[array], balls.arrays[array])
    np.testing.assert_allclose(
        calc.get_force_constants(again), calc.get_force_constants(balls), atol=1e-12
    )
    # positions and cell keep what the format has of digits
    exact = keeps_masses
    np.testing.assert_allclose(
        again.get_potential_energy(),
        calc.get_property("energy", balls),
        rtol=1e-12 if exact else 1e-3,
    )


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
    assert gp.HertzMindlin(state).get_property("energy", back) == gp.HertzMindlin(
        state
    ).get_property("energy", balls)


# ASE warns that the height of a cell that is not periodic has no place in this format
@pytest.mark.filterwarnings("ignore:Atoms have nonperiodic directions:UserWarning")
def test_netcdf_keeps_named_arrays(tmp_path):
    from ase.io.netcdftrajectory import NetCDFTrajectory

    balls = marked(at_overlap())
    with NetCDFTrajectory(tmp_path / "balls.nc", "w") as file:
        file.write(balls, arrays=list(ARRAYS))
    with NetCDFTrajectory(tmp_path / "balls.nc", "r") as file:
        back = file[0]
    for name in ARRAYS:
        np.testing.assert_array_equal(back.arrays[name], balls.arrays[name], err_msg=name)
    # positions go through cell lengths and angles in single precision, and masses and scales are
    # lost
    np.testing.assert_allclose(back.positions, balls.positions, atol=1e-6)
    assert not set(SCALES) & set(back.info)
    # and the height of the cell: with the masses they are balls again
    np.testing.assert_array_equal(back.cell[2], 0.0)
    state = at_overlap()
    with pytest.raises(InputError, match=r"no masses\."):
        gp.Phonons(state, back)
    again = gp.HertzMindlin(state).adopt(back, like=balls)
    expected = gp.HertzMindlin(state).get_property("energy", balls)
    assert again.get_potential_energy() == pytest.approx(expected, rel=1e-3)
    q = [[0.1, 0.2]]
    np.testing.assert_allclose(
        gp.Phonons(state, again).frequencies(q), gp.Phonons(state, balls).frequencies(q), rtol=1e-5
    )


def test_folders_are_made_by_all_that_writes(tmp_path):
    from matplotlib.figure import Figure

    from granphon.figures.style import save_figure

    state = gp.AveragedLattice(gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)).at_force(1.0)
    phonons = gp.Phonons(state)
    for name, write in (
        ("phonopy_params.yaml", phonons.save),
        ("band.yaml", phonons.bands("GK", npoints=2).write),
        ("dos.csv", phonons.dos(mesh=(4, 4), points=12).write_csv),
        ("balls.xyz", lambda path: gp.write_extxyz(path, gp.atoms(state))),
        ("figure.png", lambda path: save_figure(Figure(), path)),
    ):
        write(tmp_path / name / "made" / name)
        assert (tmp_path / name / "made" / name).is_file()


@pytest.mark.parametrize(
    "values",
    [
        np.zeros((1, 3, 3)),
        np.array([1j]),
        np.array(["two words"]),
        np.array([""]),
        np.array([None]),
        np.array([2**31]),
        np.array([1], np.uint8),
        np.zeros((1, 0)),
    ],
    ids=["tensor", "complex", "blank", "empty", "object", "long", "unsigned", "narrow"],
)
def test_write_extxyz_refuses_what_no_reader_reads(tmp_path, values):
    balls = gp.atoms(at_overlap())
    balls.set_array("extra", values)
    with pytest.raises(InputError, match="extra"):
        gp.write_extxyz(tmp_path / "balls.extxyz", balls)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["", "a b", "a:b", 'a"b', "a[b", "a\\b", "symbols", "pos", "Z"])
def test_write_extxyz_refuses_names_of_arrays_that_no_reader_finds(tmp_path, name):
    balls = gp.atoms(at_overlap())
    balls.arrays[name] = np.ones(len(balls))
    with pytest.raises(InputError, match="of the name"):
        gp.write_extxyz(tmp_path / "balls.extxyz", balls)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *[("", 1), (3, 1), ("pbc", "x"), ("a=b", 1), ("a\nb", 1)],
        *[("a", ""), ("a", "b\nc"), ("a", "\\"), ("a", np.array([])), ("a", 1j), ("a", b"b")],
        *[("stress", np.zeros(6)), ("virial", [[0.0] * 3] * 3)],
    ],
)
def test_write_extxyz_refuses_info_that_would_not_be_read_back(tmp_path, key, value):
    balls = gp.atoms(at_overlap())
    balls.info[key] = value
    with pytest.raises(InputError, match="read back"):
        gp.write_extxyz(tmp_path / "balls.extxyz", balls)
    assert not list(tmp_path.iterdir())


def test_write_extxyz_keeps_words_and_truth_values(tmp_path):
    balls = gp.atoms(at_overlap()).repeat((2, 1, 1))
    balls.set_array("word", np.array(["long", "s"]))
    balls.set_array("flag", np.array([True, False]))
    balls.set_array("number", np.array([2**31 - 1, -(2**31)]))
    gp.write_extxyz(tmp_path / "balls.extxyz", balls)
    back = ase.io.read(tmp_path / "balls.extxyz")
    for name in ("word", "flag", "number"):
        assert back.arrays[name].tolist() == balls.arrays[name].tolist()


@pytest.mark.claim("extxyz-every-digit", "files-all-digits")
def test_write_extxyz_keeps_every_digit(tmp_path):
    # a spread of 1 nm in diameters of 8 mm: the eighth decimal of a diameter is 8 % of it
    packing = gp.Packing(STEEL, DIAMETER, gp.Uniform(1e-9))
    state = gp.DirectSimulation(packing, (6, 5), seed=2).at_overlap(0.3e-9)
    balls = state.sample.atoms()
    path = tmp_path / "sample.extxyz"
    gp.write_extxyz(path, balls)
    back = ase.io.read(path)
    assert set(back.arrays) - {"mass"} == set(balls.arrays)  # for OVITO
    for name, values in balls.arrays.items():
        np.testing.assert_array_equal(back.arrays[name], values, err_msg=name)
    assert back.info == balls.info
    np.testing.assert_array_equal(np.asarray(back.cell), np.asarray(balls.cell))
    np.testing.assert_array_equal(back.pbc, balls.pbc)
    back.calc = gp.HertzMindlin(state)
    assert np.abs(back.get_forces()).max() * state.scales.force < 1e-6 * state.force
    # what a viewer takes for a vector is not there, and what it takes for the size is
    header = path.read_text().splitlines()[1]
    assert ":radius:R:1:" in header
    assert ":force:" not in header
    assert ":contact_force:R:1:" in header
    with pytest.raises(OutputError, match="is a folder"):
        gp.write_extxyz(tmp_path, balls)
    # ASE's own writer keeps the eight digits that the guard needs, and not those of forces
    ase.io.write(tmp_path / "ase.extxyz", balls)
    rough = ase.io.read(tmp_path / "ase.extxyz")
    rough.calc = gp.HertzMindlin(state)
    assert np.abs(rough.get_forces()).max() * state.scales.force > 1e-2 * state.force


# -- optimisers, dynamics, vibrations --------------------------------------------------------------


@pytest.mark.parametrize(
    ("optimiser", "finite_overlap", "friction"),
    [
        *((BFGS, finite, friction) for finite in (False, True) for friction in (False, True)),
        (FIRE, True, True),
        *(
            pytest.param(FIRE, *case, marks=pytest.mark.slow)
            for case in ((False, False), (False, True), (True, False))
        ),
    ],
)
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
    options = (
        {"dt": 0.1, "dtmax": 0.5, "maxstep": 0.01}
        if optimiser is FIRE
        else {"alpha": 5.0, "maxstep": 0.01}
    )
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
            for _ in range(round(4.0 / step)):
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
    # VibrationsData takes (N, 3, N, 3) and masses; its energies are hbar omega with k in eV/A^2 and
    # M in amu
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
    unit = (
        VibrationsData(Atoms("H", masses=[1.0]), np.eye(3).reshape(1, 3, 1, 3))
        .get_energies()[0]
        .real
    )
    np.testing.assert_allclose((energies / unit).real[2:], expected[2:], rtol=1e-12)
    np.testing.assert_allclose(np.abs(energies / unit)[:2], 0.0, atol=1e-7)


@pytest.mark.parametrize("like", [3, "x", [None]])
def test_adopt_refuses_like_that_is_no_atoms(like):
    state = at_overlap()
    with pytest.raises(InputError, match=r"like is .* ase\.Atoms"):
        gp.HertzMindlin(state).adopt(gp.atoms(state), like=like)


@pytest.mark.parametrize(
    ("name", "entry", "said"),
    [
        ("granphon_kind", 5, "entry 5"),
        ("granphon_kind", 0.5, "entry 0.5"),
        ("diameter_deviations", "a", "of the type"),
    ],
)
def test_arrays_that_no_balls_have_are_refused(name, entry, said):
    state = at_overlap()
    balls = gp.atoms(state)
    balls.set_array(name, None)
    balls.set_array(name, np.array([entry]))
    balls.calc = gp.HertzMindlin(state)
    with pytest.raises(InputError, match=said):
        balls.get_potential_energy()


def test_scales_that_are_no_numbers_are_refused():
    state = at_overlap()
    balls = gp.atoms(state)
    balls.info["granphon_length_m"] = "long"
    with pytest.raises(InputError, match="'long'"):
        gp.HertzMindlin(state).adopt(balls)
