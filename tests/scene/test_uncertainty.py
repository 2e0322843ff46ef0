"""Standard errors of scenes: powers of Hertz's law, random scenes, files, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import GranphonError

SCENE = (
    "material: {young_modulus: 211.65 +- 2 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
    "packing: {diameter: 8 mm +- 4 um}\n"
    "load: {force: FORCE}\n"
    "observe: [velocities]\n"
)
#: relative errors of the Young modulus, the force and the diameter
ERRORS = np.array([2.0 / 211.65, 0.2 / 18.4, 4e-3 / 8.0])


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    scene = gp.Scene.from_text(SCENE.replace("FORCE", "18.4 N +- 0.2 N"))
    return scene.run(tmp_path_factory.mktemp("errors"), figures=False)


@pytest.mark.claim("errors-hertz")
def test_errors_of_velocities_follow_from_powers(result):
    """v goes as E^(1/3) f^(1/6) d^(-1/3) at a given force, k as E^(2/3) f^(1/3) d^(1/3)."""
    numbers = result.summary()
    powers = {
        "longitudinal": (1 / 3, 1 / 6, -1 / 3),
        "transverse": (1 / 3, 1 / 6, -1 / 3),
        "normal_stiffness": (2 / 3, 1 / 3, 1 / 3),
        "pressure": (0.0, 1.0, -1.0),
    }
    for name, of_name in powers.items():
        expected = np.linalg.norm(np.array(of_name) * ERRORS)
        found = numbers[f"{name}_error"] / numbers[name]
        assert_allclose(found, expected, rtol=1e-4, err_msg=name)
        in_dataset = result.dataset[f"{name}_error"]
        assert_allclose(in_dataset.values.ravel(), numbers[f"{name}_error"], rtol=1e-12)
        assert in_dataset.attrs["units"] == result.dataset[name].attrs["units"]
    assert "mindlin_ratio_error" not in numbers
    assert numbers["errors_from"]["longitudinal"] == "material.young_modulus"
    assert numbers["errors_from"]["pressure"] == "load.force"


@pytest.mark.claim("errors-hertz")
@pytest.mark.parametrize("count", [100, pytest.param(400, marks=pytest.mark.slow)])
def test_errors_are_those_of_many_random_scenes(result, count):
    """The spread at random values of the parameters: of 400 states to 3.5 %, and of fewer whose
    parameters have exactly these errors and no correlation.
    """
    numbers = result.summary()
    draws = np.random.default_rng(4).normal(size=(count, 3))
    if count < 400:
        draws = np.sqrt(count) * np.linalg.qr(draws - draws.mean(axis=0))[0]
    factors = 1.0 + ERRORS * draws
    velocities = []
    for young, force, diameter in factors:
        steel = gp.Material(211.65e9 * young, 0.276, 7840.0)
        state = gp.AveragedLattice(gp.Packing(steel, 8e-3 * diameter)).at_force(18.4 * force)
        velocities.append(gp.sound_velocities(state).longitudinal)
    assert_allclose(numbers["longitudinal_error"], np.std(velocities), rtol=0.1)


@pytest.mark.slow
def test_gaps_have_errors_as_random_scenes_have(tmp_path):
    text = (
        "balls:\n"
        "  S: {material: {young_modulus: 193 +- 4 GPa, poisson_ratio: 0.3, density: 8000 kg/m^3},"
        " diameter: 19.05 mm}\n"
        "  A: {material: {young_modulus: 73.5 GPa, poisson_ratio: 0.33, density: 2700 +- 30 kg/m^3},"
        " diameter: 19.05 mm}\n"
        "crystal: {lattice: chain, kinds: [A, S]}\nload: {force: 20 +- 0.5 N}\nobserve: [gaps]\n"
    )
    scene = gp.Scene.from_text(text)
    numbers = scene.run(tmp_path, figures=False).summary()
    assert gp.Scene.from_text(scene.to_yaml()) == scene
    rng = np.random.default_rng(3)
    edges = []
    for young, density, force in rng.normal(size=(400, 3)):
        aluminium = gp.Ball(gp.Material(73.5e9, 0.33, 2700.0 + 30.0 * density), 19.05e-3)
        steel = gp.Ball(gp.Material(193e9 + 4e9 * young, 0.3, 8000.0), 19.05e-3)
        state = gp.Crystal.on("chain", [aluminium, steel]).at_force(20.0 + 0.5 * force)
        edges.append(gp.Phonons(state).frequencies([[0.5]])[0][-2:])
    assert_allclose(numbers["gaps_error"][-1], np.std(edges, axis=0), rtol=0.1)


def test_scenes_with_errors_are_read_again(result):
    scene = result.scene
    again = gp.Scene.from_text(scene.to_yaml())
    assert again == scene
    assert dict(again.errors)["packing", "diameter"] == 4e-6
    plain = gp.Scene.from_text(SCENE.replace("FORCE", "18.4 N"))
    assert plain != scene
    kept = scene.run(result.folder, figures=False, resume=True)
    assert kept.summary() == result.summary()


def test_states_of_a_sweep_have_errors(tmp_path):
    text = SCENE.replace("FORCE", "[2 N, 18.4 N]").replace(" +- 4 um", "")
    data = gp.Scene.from_text(text).run(tmp_path, figures=False).dataset
    relative = data["longitudinal_error"] / data["longitudinal"]
    assert_allclose(relative, ERRORS[0] / 3.0, rtol=1e-4)
    assert data["longitudinal_error"].attrs["mostly_from"] == "material.young_modulus"
    assert "force_error" not in data
    assert_allclose(gp.load_sweep(tmp_path / "sweep.nc")["bulk_error"], data["bulk_error"])


@pytest.mark.parametrize(
    ("force", "word"),
    [
        ("18.4 +- 2 mm", "unit of force"),
        ("18.4 N +- 2 mm", "two kinds"),
        ("18.4 N +- 0 N", "above zero"),
        ("18.4 +- 20 N", "as large"),
        ("18.4 +- two N", "18.4"),
    ],
)
def test_errors_that_are_none_are_refused(force, word):
    with pytest.raises(GranphonError, match=word):
        gp.Scene.from_text(SCENE.replace("FORCE", force))
