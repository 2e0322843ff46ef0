"""Simulations of every lattice that stands without friction, through scenes, sweeps, files, fits
and calculators.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.balls.lattices import LATTICES, Lattice, one_direction
from granphon.base.errors import InputError, SceneError
from granphon.base.text import parse_yaml
from granphon.dynamics.elasticity import has_cubic_axes
from granphon.fits.velocity_model import VelocityModel, Waves
from granphon.media.choice import MediumChoice
from granphon.observables.velocities import Moduli
from granphon.scene.scene import Scene
from tests.conftest import only

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
WIDTH = 2.04e-6
D = 8e-3
#: in the directions of the lattice, the limit of small width
simulate = partial(gp.DirectSimulation, geometry="lattice")
#: small samples of each lattice
SHAPES = {"chain": (9,), "triangular": (6, 5), "fcc": (3, 2, 2), "hcp": (2, 2, 2)}
#: fcc in its cube of four balls
CUBE = Lattice(
    "cube of fcc",
    tuple(map(tuple, np.sqrt(2.0) * np.eye(3))),
    ((0, 0, 0), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5)),
)
every_lattice = pytest.mark.parametrize("lattice", SHAPES)
SCENE = """\
material: {{young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}}
packing: {{diameter: 8 mm, spread: {{uniform: 2.04 um}}, lattice: {}}}
load: {{force: 10 N}}
medium: {}
"""


def packing(lattice, **more):
    return gp.Packing(STEEL, D, spread=gp.Uniform(WIDTH), lattice=lattice, **more)


def simulation(lattice, samples=1, **more):
    return simulate(packing(lattice, **more), SHAPES[lattice], samples=samples)


# -- scenes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lattice", "shape", "told"),
    [
        ("chain", "12 12", "one .*1 to 20000.* 16384"),
        ("triangular", "12", "two .*1 to 20000.* 128 128"),
        ("triangular", "12 12 12", "two .*1 to 20000.* 128 128"),
        ("fcc", "128 128", "three .*1 to 20000.* 24 24 24"),
        ("fcc", "[12, 12, 0]", "three .*1 to 20000.* 24 24 24"),
        ("hcp", "12", "three .*1 to 20000.* 24 24 24"),
    ],
)
def test_a_shape_has_a_length_for_each_period(lattice, shape, told):
    text = SCENE.format(lattice, f"{{simulation: {{shape: {shape}, samples: 2}}}}")
    with pytest.raises(SceneError, match=rf"own.yaml:4: medium\.simulation\.shape: .*{told}"):
        Scene.from_text(text, "own.yaml")
    given = {"simulation": {"shape": tuple(map(int, shape.strip("[]").replace(",", " ").split()))}}
    with pytest.raises(InputError, match=rf"simulation\.shape: .*{told}"):
        gp.sweep(packing(lattice), force=1.0, media=given)
    with pytest.raises(InputError, match=rf"simulation\.shape: .*{told}"):
        gp.fit_width(packing(lattice), [1.0, 2.0, 3.0], [400.0, 450.0, 480.0], medium=given)
    # where the lattice is swept, it is the lattices of the sweep that count
    swept = (
        SCENE.format("kagome", f"{{simulation: {{shape: {shape}}}}}")
        + f"sweep: {{lattice: [{lattice}]}}\n"
    )
    with pytest.raises(SceneError, match=told):
        Scene.from_text(swept)


@pytest.mark.parametrize(
    ("lattice", "default"),
    [("chain", (16384,)), ("triangular", (128, 128)), ("fcc", (24, 24, 24)), ("hcp", (24, 24, 24))],
)
def test_the_default_shape_is_that_of_the_dimension(lattice, default):
    scene = Scene.from_text(SCENE.format(lattice, "simulation"))
    written = scene.to_yaml()
    shape = f"[{', '.join(map(str, default))}]"
    assert f"medium:\n  simulation:\n    shape: {shape}\n    seed: 0\n    samples: 1\n" in written
    # to write the default out is to say the same
    assert Scene.from_text(written) == scene
    assert scene.media == (MediumChoice("simulation"),)
    assert scene.plan.case.case.medium.label == "simulation"
    assert scene.cost().balls == np.prod(default) * (2 if lattice == "hcp" else 1)
    # the default of one dimension is no default of another
    assert (
        MediumChoice.parse({"simulation": {"shape": (128, 128)}}).label
        == "simulation(shape=128 128)"
    )


@pytest.mark.parametrize("lattice", ["sc", "bcc", "diamond", "square", "kagome", "honeycomb"])
def test_a_mechanism_is_one_error_at_the_medium(lattice):
    with pytest.raises(SceneError, match=r"own\.yaml:4: medium: .*friction") as error:
        Scene.from_text(SCENE.format(lattice, "simulation") + "observe: [bands]\n", "own.yaml")
    assert str(error.value).count(f"the {lattice} lattice is not simulated") == 1
    assert "triangular or fcc" in str(error.value)


@pytest.mark.parametrize(
    "lattice",
    [
        "chain",
        "triangular",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("fcc", "hcp")),
    ],
)
def test_a_scene_writes_and_reads_its_simulation(tmp_path, lattice):
    import ase.io

    shape = " ".join(map(str, SHAPES[lattice]))
    text = SCENE.format(lattice, f"{{simulation: {{shape: {shape}, samples: 2, seed: 4}}}}")
    scene = Scene.from_text(text + ("direction: [0, 0, 1]\n" if len(SHAPES[lattice]) == 3 else ""))
    assert Scene.from_text(scene.to_yaml()) == scene
    result = scene.run(tmp_path / "out", figures=False)
    state = gp.DirectSimulation(scene.packing, SHAPES[lattice], 4, 2).at_force(10.0)
    assert result.state == state
    summary = parse_yaml((tmp_path / "out" / "summary.yaml").read_text(), "summary.yaml").data
    moduli = gp.moduli(state)
    assert_array_equal(summary["tensor"], moduli.tensor)
    assert_array_equal(summary["tensor_error"], moduli.tensor_error)
    assert summary["units"]["tensor_error"] == ("N" if lattice == "chain" else "Pa")
    assert summary["exponent_error"] == pytest.approx(state.exponent_error)
    cubic = lattice == "fcc"
    assert ("anisotropy" in summary, "anisotropy_error" in summary) == (cubic, cubic)
    assert ("bulk" in summary) == ("bulk_error" in summary) == (lattice != "hcp")
    assert ("shear" in summary) == ("shear_error" in summary) == (lattice == "triangular")
    slow = len(SHAPES[lattice]) == 3
    assert ("transverse_slow_error" in summary) == ("transverse_fast_error" in summary) == slow
    assert ("transverse_error" in summary) == (lattice == "triangular")
    assert set(summary["units"]) >= {name for name in summary if name.endswith("_error")}
    balls = ase.io.read(tmp_path / "out" / "sample.extxyz")
    first = state.sample
    assert len(balls) == first.diameters.size
    assert_allclose(balls.arrays["radius"], 0.5 * first.diameters.ravel() / D, rtol=1e-7)
    assert_array_equal(balls.pbc, np.arange(3) < len(SHAPES[lattice]))
    lines = (tmp_path / "out" / "sample.extxyz").read_text().splitlines()
    assert "pos:R:3" in lines[1]  # the names that OVITO knows
    assert "radius:R:1" in lines[1]


# -- moduli ----------------------------------------------------------------------------------------


def test_what_is_cubic():
    found = {name for name, lattice in LATTICES.items() if has_cubic_axes(lattice)}
    assert has_cubic_axes(CUBE)
    assert found == {"square", "sc", "bcc", "fcc", "diamond"}
    turned = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    assert not has_cubic_axes(Lattice("turned", tuple(map(tuple, turned)), ((0.0, 0.0, 0.0),)))


@pytest.mark.parametrize("lattice", ["square", "sc", "bcc", "fcc"])
def test_anisotropy_of_ideal_lattices(lattice):
    state = gp.AveragedLattice(gp.Packing(STEEL, D, lattice=lattice)).at_force([1.0, 10.0])
    moduli = gp.moduli(state)
    c = moduli.tensor
    shear = c[:, -1, -1]
    assert moduli.cubic
    assert not moduli.isotropic
    assert_allclose(moduli.anisotropy, 2.0 * shear / (c[:, 0, 0] - c[:, 0, 1]), rtol=1e-12)
    assert moduli.anisotropy_error is moduli.tensor_error is None
    if lattice == "fcc":
        # every ball is a centre of symmetry and stays where the strain takes it: sums over 12
        # contacts
        eta = state.packing.mindlin_ratio
        assert_allclose(moduli.anisotropy, (1.0 + eta) / (0.5 + 1.5 * eta), rtol=1e-12)
    equal = gp.moduli(gp.AveragedLattice(gp.Packing(STEEL, D)).at_force(1.0))
    assert equal.anisotropy == pytest.approx(1.0, abs=1e-12)
    assert not equal.cubic


def test_anisotropy_and_errors_over_samples():
    state = simulation("fcc", 5).at_force([4.0, 40.0])
    moduli = gp.moduli(state)
    every = state.over_samples(lambda sample: sample.elastic_tensor)
    assert_allclose(moduli.tensor_error, np.std(every, axis=1, ddof=1) / np.sqrt(5.0), rtol=1e-12)
    upper = every[..., [3, 4, 5], [3, 4, 5]].mean(-1)
    lower = _axial(every)
    assert_allclose(moduli.anisotropy, upper.mean(1) / lower.mean(1), rtol=1e-12)
    left = [np.delete(upper, i, 1).mean(1) / np.delete(lower, i, 1).mean(1) for i in range(5)]
    assert_allclose(moduli.anisotropy_error, np.sqrt(4.0) * np.std(left, axis=0), rtol=1e-9)
    assert np.all(moduli.anisotropy_error > 0.0)
    # samples of finite size are not cubic; their means are taken to be, so that there is one bulk
    # modulus
    assert_allclose(moduli.bulk, moduli.voigt.bulk, rtol=1e-14)
    assert moduli.cubic
    alone = gp.moduli(simulation("fcc").at_force(4.0))
    assert alone.tensor_error is alone.anisotropy_error is None
    assert Moduli.from_dict(json.loads(json.dumps(moduli.to_dict()))) == moduli


def _axial(tensors):
    """(C11 - C12)/2 of cubic tensors: the mean over x, y, z."""
    c = tensors
    return (
        c[..., 0, 0] + c[..., 1, 1] + c[..., 2, 2] - c[..., 0, 1] - c[..., 0, 2] - c[..., 1, 2]
    ) / 6.0


@pytest.mark.parametrize("lattice", ["hcp", "chain"])
def test_no_single_anisotropy(lattice):
    moduli = gp.moduli(simulation(lattice, 2).at_force(10.0))
    with pytest.raises(InputError, match=r"anisotropy|shear modulus"):
        _ = moduli.anisotropy
    assert moduli.anisotropy_error is None
    assert moduli.tensor_error.shape == moduli.tensor.shape


# -- sweeps ----------------------------------------------------------------------------------------


LOADS = [("force", [20.0, 5.0]), ("pressure", [1e3, 500.0]), ("overlap", [2e-6, 1e-6])]


@pytest.mark.parametrize(
    ("lattice", "load"),
    [
        ("chain", LOADS[0]),
        ("triangular", LOADS[1]),
        pytest.param("fcc", LOADS[2], marks=pytest.mark.slow),
        *(
            pytest.param(lattice, load, marks=pytest.mark.exhaustive)
            for lattice, load in itertools.product(SHAPES, LOADS)
            if (lattice, load)
            not in (("chain", LOADS[0]), ("triangular", LOADS[1]), ("fcc", LOADS[2]))
        ),
    ],
)
def test_samples_apart_are_samples_together(lattice, load):
    """Samples are cut from each other and put together again: to the last bit what one simulation
    gives.
    """
    media = {"simulation": {"shape": SHAPES[lattice], "seed": 2, "samples": 2}}
    (kind, values) = load
    ds = gp.sweep(packing(lattice), **{kind: values}, media=media)
    p = len(SHAPES[lattice])
    state = getattr(gp.DirectSimulation(packing(lattice), SHAPES[lattice], 2, 2), f"at_{kind}")(
        values
    )
    found = [gp.sound_velocities(state, np.eye(p)[0]), gp.moduli(state), state]
    for name, variable in ds.data_vars.items():
        assert_array_equal(
            variable[:, 0], next(getattr(one, name) for one in found if hasattr(one, name)), name
        )
    names = {"longitudinal_error", "exponent_error", "contact_force_fluctuation"}
    names |= (
        {"transverse_slow_error", "transverse_fast_error", "tensor", "tensor_error"}
        if p == 3
        else {"bulk_error"}
    )
    names |= {"bulk_error", "anisotropy", "anisotropy_error"} if lattice == "fcc" else set()
    names |= {"transverse_error", "shear_error"} if lattice == "triangular" else set()
    assert names <= set(ds)
    assert ("anisotropy" in ds, "transverse_error" in ds) == (
        lattice == "fcc",
        lattice == "triangular",
    )
    if p == 3:  # M = K + 4G/3 with the averages over directions
        assert np.all(ds["exponent_error"] > 0.0)
        assert ds["tensor_error"].dims[-2:] == ("voigt_row", "voigt_column")


@pytest.mark.parametrize(
    ("shape", "forces"),
    [((1, 2, 1), [10.0]), pytest.param((3, 2, 2), [10.0, 30.0], marks=pytest.mark.slow)],
)
def test_directions_lattices_and_media_together(shape, forces):
    media = [
        "ala",
        {"simulation": {"shape": shape, "samples": 2}},
        {"simulation": {"shape": (1, 1, 2)}},
    ]
    ways = [[1, 0, 0], [1, 1, 0]]
    ds = gp.sweep(
        packing("fcc", friction=False),
        force=forces,
        media=media,
        lattice=["fcc", "hcp"],
        direction=ways,
    )
    for lattice in ("fcc", "hcp"):
        state = simulate(packing(lattice, friction=False), shape, samples=2).at_force(forces)
        v = gp.sound_velocities(state, ways)
        there = ds.sel(lattice=lattice)
        for name in ("longitudinal_error", "transverse_slow_error", "transverse_fast_error"):
            assert_array_equal(there[name][:, 1], getattr(v, name), name)
            assert np.all(there[name][:, 0] == 0.0)  # sampling nothing
            # one sample has an error, which is not known
            assert np.all(np.isnan(there[name][:, 2]))
        assert_array_equal(there["tensor_error"][:, 1], gp.moduli(state).tensor_error)
    # hcp has no single bulk modulus in samples of finite size, and no anisotropy: they are left out
    # with their errors
    assert not {"bulk", "bulk_error", "shear", "anisotropy", "anisotropy_error"} & set(ds)


@pytest.mark.slow
def test_errors_of_directions_come_back_from_their_file(tmp_path):
    ds = gp.sweep(
        packing("fcc", friction=False),
        force=[10.0],
        media=["ala", {"simulation": {"shape": (1, 1, 2), "samples": 2}}],
        direction=[[1, 0, 0], [1, 1, 0]],
        path=tmp_path / "sweep.nc",
    )
    again = gp.load_sweep(tmp_path / "sweep.nc")
    assert again.identical(ds)
    heading = (tmp_path / "sweep.csv").read_text().splitlines()[0]
    assert "transverse_slow_error (m/s)" in heading


# -- fits ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lattice", "branch", "direction"),
    only(
        [("fcc", "transverse_slow", (1, 1, 0))],
        [
            ("fcc", "longitudinal", (1, 1, 1)),
            ("fcc", "transverse_slow", (1, 1, 0)),
            ("hcp", "transverse_fast", (1, 0, 1)),
        ],
    ),
)
def test_the_model_of_a_fit_is_that_of_the_samples_along_its_direction(lattice, branch, direction):
    choice = MediumChoice.parse({"simulation": {"shape": (2, 2, 2), "seed": 1}})
    waves = Waves(branch, one_direction(direction, 3), None, False)
    unit = packing(lattice).width_units.force
    places = unit * np.array([1.0])  # a node of the curve
    model = VelocityModel(packing(lattice), ("width", "young_modulus"), choice, places, waves)
    logs = model.find_start(WIDTH)
    found, slopes = model(logs)
    state = simulate(packing(lattice), (2, 2, 2), seed=1).at_force(places)
    wanted = getattr(gp.sound_velocities(state, direction), branch)
    assert_allclose(found, wanted, rtol=1e-7)
    difference = [
        (np.log(model(logs + s)[0]) - np.log(model(logs - s)[0])) / 2e-5 for s in 1e-5 * np.eye(2)
    ]
    assert_allclose(slopes.T, difference, rtol=2e-4, atol=1e-6)


# -- calculators -----------------------------------------------------------------------------------


@every_lattice
@pytest.mark.parametrize("friction", [False, True])
def test_force_constants_of_a_sample_are_differences_of_its_forces(lattice, friction):
    shapes = {"chain": (7,), "triangular": (4, 4), "fcc": (4, 3, 3), "hcp": (3, 3, 2)}
    state = simulate(packing(lattice, friction=friction), shapes[lattice]).at_force(10.0)
    balls = gp.HertzMindlin(state).adopt(state.sample.atoms())
    balls.calc = gp.HertzMindlin(state)
    constants = balls.calc.get_force_constants(balls)
    p = len(shapes[lattice])
    assert_allclose(constants, constants.transpose(1, 0, 3, 2), rtol=0.0, atol=1e-12)
    step = 1e-4 * 10.0 / (state.normal_stiffness * D)  # a small part of an overlap
    for axis in range(p):
        ball = len(balls) // 2
        sides = []
        for sign in (1.0, -1.0):
            moved = balls.copy()
            moved.calc = gp.HertzMindlin(state)
            moved.positions[ball, axis] += sign * step
            sides.append(moved.get_forces())
        difference = (sides[1] - sides[0]) / (2.0 * step)
        assert_allclose(
            constants[:, ball, :p, axis], difference[:, :p], rtol=0.0, atol=1e-6 * np.max(constants)
        )


@every_lattice
def test_atoms_and_phonons_of_a_mean_over_samples(lattice):
    state = simulation(lattice, 2).at_force(10.0)
    p = len(SHAPES[lattice])
    balls = gp.atoms(state)
    balls.calc = gp.HertzMindlin(state)
    assert np.max(np.abs(balls.get_forces())) < 1e-14
    q = np.full((1, p), 0.01) / p
    # long waves of the bands: those of a regular lattice with the mean stiffness
    lattice_waves = gp.Phonons(state).frequencies(q)[0][:p]
    regular = gp.Phonons(
        gp.AveragedLattice(dataclasses.replace(state.packing, spread=None)).at_force(10.0)
    ).frequencies(q)
    assert_allclose(lattice_waves, regular[0][:p] * np.sqrt(state.stiffness_ratio), rtol=1e-9)


# -- extremes --------------------------------------------------------------------------------------


def test_rows_that_close_around_the_period_carry_load_where_no_large_sample_does():
    state = simulate(packing("fcc"), (4, 5, 6)).at_overlap((0.2 - 0.5) * WIDTH)
    assert 0.0 < state.contact_fraction < 0.02
    carrying = state.sample.contact_forces > 1e-6 * state.force
    assert set(state.sample.atoms().arrays["contacts"].tolist()) == {0, 2}
    assert np.count_nonzero(np.any(carrying, axis=(0, 1, 2))) < 3  # of the six directions


@pytest.mark.slow
def test_a_lattice_given_as_data_runs_from_a_scene(tmp_path):
    block = (
        "{name: cube, cell: [[1.4142135623730951, 0, 0], [0, 1.4142135623730951, 0], [0, 0,"
        " 1.4142135623730951]], "
    )
    block += "sites: [[0, 0, 0], [1/2, 1/2, 0], [1/2, 0, 1/2], [0, 1/2, 1/2]]}"
    scene = Scene.from_text(SCENE.format(block, "{simulation: {shape: 2 2 2, samples: 2}}"))
    assert Scene.from_text(scene.to_yaml()) == scene
    assert scene.cost().balls == 32
    result = scene.run(tmp_path / "out", figures=False)
    moduli = gp.moduli(result.state)
    assert moduli.cubic
    # near that of fcc, which it is, from other samples
    fcc = gp.moduli(simulate(packing("fcc"), (3, 3, 3), samples=2).at_force(10.0))
    assert moduli.anisotropy == pytest.approx(fcc.anisotropy, abs=0.02)


@pytest.mark.parametrize("load", [{"force": 1e-300}, {"force": 1e-9}, {"overlap": 1e-30}])
def test_a_chain_at_a_load_that_is_not_simulated_knows_of_no_threshold(load):
    ((kind, value),) = load.items()
    chain = simulate(packing("chain"), shape=(5,))
    with pytest.raises(InputError, match="line") as error:
        getattr(chain, f"at_{kind}")(value)
    assert "threshold" not in str(error.value)
    # where it is simulated it is right down to that load
    state = chain.at_force(1e-5)
    assert state.overlap == pytest.approx(float(chain.packing.law.overlap(1e-5)), rel=1e-12)


def test_a_chain_that_is_not_pressed_is_told_so_by_every_medium():
    for medium in (gp.AveragedForce(packing("chain")), simulate(packing("chain"), shape=(5,))):
        with pytest.raises(InputError, match="overlap is zero"):
            medium.at_overlap(0.0)
        with pytest.raises(InputError, match="tensile"):
            medium.at_overlap(-1e-7)


@pytest.mark.parametrize(
    ("lattice", "shape"), [("fcc", (10**9,) * 3), ("triangular", (2**31, 2**31))]
)
def test_a_shape_beyond_all_arrays_is_one_clear_error(lattice, shape):
    with pytest.raises(InputError, match=r"shape is .*2\.81e\+14"):
        simulate(packing(lattice), shape=shape)
