"""Standard errors of scenes: powers of Hertz's law, random scenes, files, refusals."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import ConvergenceError, GranphonError, InputError
from granphon.base.text import read_yaml
from granphon.cli.main import main
from granphon.figures.motions import motions_figure
from granphon.fits.measurements import Measurements
from granphon.observables.catalogue import CATALOGUE
from granphon.runs.plan import Plan
from granphon.scene.outputs import OUTPUTS, Results
from granphon.scene.report import read_report
from granphon.scene.scene import WORK_FILE
from granphon.scene.uncertainty import ErrorPropagation
from tests.conftest import one_error
from tests.figures.conftest import read_edges, with_gid
from tests.scene.mistakes import BALLS

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
    units = read_yaml(result.files[0].parent / "summary.yaml")["units"]
    assert units["normal_stiffness_error"] == "N/m"
    for name in numbers["errors_from"]:
        assert units.get(f"{name}_error") == units.get(name)
    assert "mindlin_ratio_error" not in numbers
    assert numbers["errors_from"]["longitudinal"] == "material.young_modulus"
    assert numbers["errors_from"]["pressure"] == "load.force"


@pytest.mark.claim("errors-hertz")
def test_errors_are_those_of_many_random_scenes(result):
    """The spread of 400 states at random values of the parameters is known to 3.5 %."""
    numbers = result.summary()
    draws = np.random.default_rng(4).normal(size=(400, 3))
    factors = 1.0 + ERRORS * draws
    velocities = []
    for young, force, diameter in factors:
        steel = gp.Material(211.65e9 * young, 0.276, 7840.0)
        state = gp.AveragedLattice(gp.Packing(steel, 8e-3 * diameter)).at_force(18.4 * force)
        velocities.append(gp.sound_velocities(state).longitudinal)
    assert_allclose(numbers["longitudinal_error"], np.std(velocities), rtol=0.1)


@pytest.mark.claim("errors-correlated")
@pytest.mark.slow
@pytest.mark.parametrize("count", [60, 400])
def test_correlated_errors_are_those_of_many_random_scenes(tmp_path, count):
    """Velocities, moduli and frequencies of bands: of 400 states to 10 %, and of fewer whose
    parameters have exactly these errors and correlations to 1 %.
    """
    text = SCENE.replace("0.276", "0.276 +- 0.01").replace("FORCE", "18.4 +- 0.2 N")
    text = text.replace("[velocities]", "[velocities, bands]") + (
        "phonopy: {band: 0 0 0 1/2 0 0, band_points: 3, mesh: 2 2 1}\n"
        "correlations: {'young_modulus, poisson_ratio': -0.8, 'young_modulus, force': 0.5}\n"
    )
    result = gp.Scene.from_text(text).run(tmp_path, figures=False)
    data = result.dataset.squeeze()
    sizes = np.array([2e9, 0.01, 4e-6, 0.2])
    correlations = np.eye(4)
    for row, column, value in ((0, 1, -0.8), (0, 3, 0.5)):
        correlations[row, column] = correlations[column, row] = value
    draws = np.random.default_rng(7).normal(size=(count, 4))
    if count < 400:
        draws = np.sqrt(count) * np.linalg.qr(draws - draws.mean(axis=0))[0]
    draws = draws @ np.linalg.cholesky(correlations).T
    found = []
    for young, poisson, diameter, force in np.array([211.65e9, 0.276, 8e-3, 18.4]) + draws * sizes:
        packing = gp.Packing(gp.Material(young, poisson, 7840.0), diameter)
        state = gp.AveragedLattice(packing).at_force(force)
        frequencies = gp.Phonons(state).frequencies([[0.25, 0.0], [0.5, 0.0]])
        moduli = gp.moduli(state)
        found.append([gp.sound_velocities(state).transverse, moduli.shear, *frequencies.ravel()])
    errors = [data["transverse_error"], data["shear_error"], *data["frequencies_error"].values[1:]]
    expected = np.concatenate([np.ravel(error) for error in errors])
    assert_allclose(expected, np.std(found, axis=0), rtol=0.1 if count == 400 else 0.01)


def test_numbers_whose_count_changes_have_no_errors_and_a_warning():
    propagation = ErrorPropagation(["p"], [({"x": [1.0]}, {"x": [1.0, 2.0]})], np.eye(1))
    assert propagation.find("x", [1.0]) is None
    assert list(propagation.lacking) == ["x"]


def test_a_number_that_a_shifted_scene_does_not_have_is_told():
    propagation = ErrorPropagation(["p"], [({"x": [np.nan]}, {"x": [1.0]})], np.eye(1))
    assert propagation.find("x", [1.0]) is None
    assert [*propagation.lacking] == ["x"]
    # what has no number in the scene itself lacks no error
    propagation = ErrorPropagation(["p"], [({"x": [np.nan]}, {"x": [1.0]})], np.eye(1))
    assert propagation.find("x", [np.nan]) is None
    assert not propagation.lacking


def test_angles_change_by_no_turns():
    ends = {"phase": np.array([3.1, 1.0])}, {"phase": np.array([-3.1, 1.2])}
    errors, source = ErrorPropagation(["p"], [ends], np.eye(1)).find(
        "phase", [np.pi, 1.1], unit="rad"
    )
    assert_allclose(errors, [np.pi - 3.1, 0.1], rtol=1e-12)
    assert source == "p"


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
    "force",
    ["18.4 N +- 200 mN", "(18.4 +- 0.2) N", "18.4 ± 0.2 N", "18.4 N +/- 20e-2 N"],
)
def test_errors_are_written_in_several_ways(force):
    scene = gp.Scene.from_text(SCENE.replace("FORCE", force))
    assert dict(scene.errors)["load", "force"] == 0.2
    relative = gp.Scene.from_text(SCENE.replace("FORCE", "18.4 N +- 1 %"))
    assert_allclose(dict(relative.errors)["load", "force"], 0.184, rtol=1e-15)


SPREAD = (
    "material: {young_modulus: 211 +- 5 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
    "packing: {diameter: 8 mm, spread: {normal: 0.6 +- 0.05 um}}\n"
    "load: {force: 18.4 +- 1 N}\n"
)


@pytest.mark.claim("errors-correlated")
def test_correlated_errors_add_up_by_their_matrix(tmp_path):
    """The variance is that of the linear combination, between the difference and the sum of two
    errors that are of one source.
    """
    variances = {}
    for number in (-1, 0, 0.5):
        block = f"correlations: {{'young_modulus, force': {number}}}\n"
        text = SCENE.replace("FORCE", "18.4 N +- 2 %").replace(" +- 4 um", "")
        scene = gp.Scene.from_text(text + block)
        assert gp.Scene.from_text(scene.to_yaml()) == scene
        result = scene.run(tmp_path / str(number), figures=False)
        variances[number] = result.summary()["normal_stiffness_error"] ** 2
    parts = np.array([2 / 3 * 2 / 211.65, 1 / 3 * 0.02])
    stiffness = result.summary()["normal_stiffness"]
    assert_allclose(variances[0], np.sum(parts**2) * stiffness**2, rtol=1e-3)
    for number in (-1, 0.5):
        cross = 2.0 * number * parts[0] * parts[1] * stiffness**2
        assert_allclose(variances[number] - variances[0], cross, rtol=1e-3)


def test_numbers_of_a_fit_have_its_errors_and_correlations(tmp_path):
    steel = gp.Material(205e9, 0.276, 7840.0)
    packing = gp.Packing(steel, 8e-3, spread=gp.Normal(0.6e-6))
    force = np.geomspace(2.0, 200.0, 9)
    velocity = gp.sound_velocities(gp.AveragedForce(packing).at_force(force)).longitudinal
    noise = 1.0 + 2e-3 * np.cos(3.0 * np.arange(9))
    parameters = ("width", "young_modulus")
    options = {"medium": "afa", "parameters": parameters, "sigma": 2e-3 * velocity}
    fit = gp.fit_width(packing, force, velocity * noise, **options)
    fit.write(tmp_path)
    text = SPREAD.replace("211 +- 5 GPa", "{fit: fit.yaml}").replace(
        "0.6 +- 0.05 um", "{fit: fit.yaml}"
    )
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    scene = gp.Scene.from_yaml(path)
    assert tmp_path / "fit.yaml" in scene.origin.inputs
    assert scene.packing.spread.std == fit.packing.spread.std
    errors = dict(scene.errors)
    assert_allclose(errors["material", "young_modulus"], fit.stderrs[1], rtol=1e-12)
    relative = errors["packing", "spread", "normal", "std"] / scene.packing.spread.std
    assert_allclose(relative, fit.stderr / fit.width, rtol=1e-12)
    ((first, second, correlation),) = scene.correlations
    assert (first, second) == ("material.young_modulus", "packing.spread.normal.std")
    assert_allclose(correlation, fit.correlation[0, 1], rtol=1e-12)
    assert gp.Scene.from_text(scene.to_yaml()) == scene
    path.write_text(SPREAD.replace(" +- 0.05", "") + "sweep: {width: [1 um, {fit: fit.yaml}]}\n")
    swept = gp.Scene.from_yaml(path)
    assert swept.parameters == (("width", (1e-6, fit.width)),)
    assert_allclose(dict(swept.errors)["sweep", "width", 1], fit.stderr, rtol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("8 mm", "{fit: fit.yaml}", "diameter.*width"),
        ("{normal: 0.6 +- 0.05 um}", "{uniform: {fit: fit.yaml}}", "spread.uniform.*normal"),
        ("211 +- 5 GPa", "{fit: scene.yaml}", "young_modulus.*scene.yaml"),
        ("18.4 +- 1 N", "[5 N, {fit: fit.yaml}]", "force.1.*a fit of width.*a fit of force"),
        ("{normal: 0.6 +- 0.05 um}", "{discrete: {fit: fit.yaml}}", "spread.discrete.*normal"),
    ],
)
def test_fits_without_a_value_are_refused(tmp_path, old, new, place):
    packing = gp.Packing(gp.Material(205e9, 0.276, 7840.0), 8e-3, spread=gp.Normal(0.6e-6))
    force = np.geomspace(2.0, 200.0, 9)
    velocity = gp.sound_velocities(gp.AveragedForce(packing).at_force(force)).longitudinal
    gp.fit_width(packing, force, velocity, 1e-3 * velocity, medium="afa").write(tmp_path)
    path = tmp_path / "scene.yaml"
    path.write_text(SPREAD.replace(old, new))
    with pytest.raises(GranphonError, match=place):
        gp.Scene.from_yaml(path)


@pytest.mark.parametrize(
    ("covariance", "word"),
    [
        ([[1e-16, 3e1], [3e1, 1e18]], "eigenvalue"),
        ([[1e-16, 1e0], [2e0, 1e18]], "not symmetric"),
        ([[1e-16, 0.0], [0.0, 0.0]], "variance"),
    ],
)
def test_fits_whose_covariance_no_errors_have_are_refused(tmp_path, covariance, word):
    packing = gp.Packing(gp.Material(205e9, 0.276, 7840.0), 8e-3, spread=gp.Normal(0.6e-6))
    force = np.geomspace(2.0, 200.0, 4)
    velocity = gp.sound_velocities(gp.AveragedForce(packing).at_force(force)).longitudinal
    options = {"medium": "afa", "parameters": ("width", "young_modulus")}
    fit = gp.fit_width(packing, force, velocity, 1e-3 * velocity, **options)
    replace(fit, covariance=np.array(covariance)).write(tmp_path)
    path = tmp_path / "scene.yaml"
    path.write_text(SPREAD.replace("211 +- 5 GPa", "{fit: fit.yaml}"))
    with pytest.raises(GranphonError, match=f"young_modulus.*{word}"):
        gp.Scene.from_yaml(path)


YOUNG = ("material", "young_modulus")
DIAMETER = ("packing", "diameter")


@pytest.mark.parametrize(
    ("errors", "word"),
    [
        ({YOUNG: "abc"}, "'abc'"),
        ({YOUNG: None}, "nothing"),
        ({YOUNG: [1.0, 2.0]}, "[1.0, 2.0]"),
        ({YOUNG: math.inf}, "inf"),
        ({YOUNG: "1e400 Pa"}, "inf"),
        ({"material.young_modulus": 1e9}, "path 'material.young_modulus'"),
        ({5: 1.0}, "path 5"),
        ({(): 1.0}, "path ()"),
        ({("load", "force", -1): 1.0}, "-1"),
        ({("load", "force", True): 1.0}, "True"),
        (((YOUNG, 1e9), (YOUNG, 2e9)), "twice"),
        # what is no list has no index
        ({("material", 0): 1.0}, "standard error"),
        ({(*YOUNG, 0, 1): 1.0}, "standard error"),
    ],
)
def test_errors_in_python_are_refused_by_what_is_wrong(errors, word):
    scene = gp.Scene.from_text(SPREAD.replace("+- 5 ", "").replace("+- 1 ", ""))
    with pytest.raises(InputError) as caught:
        gp.Scene(scene.packing, scene.load, errors=errors)
    assert word in str(caught.value)


@pytest.mark.parametrize(
    "correlations", [5, (1, 2), (("young_modulus", "diameter"),), (("young_modulus", 8, 0.5),)]
)
def test_correlations_in_python_are_refused_by_name(correlations):
    scene = gp.Scene.from_text(SPREAD.replace("+- 5 ", "").replace("+- 1 ", ""))
    errors = {YOUNG: 1e9, DIAMETER: 1e-5}
    with pytest.raises(InputError, match="correlations"):
        gp.Scene(scene.packing, scene.load, errors=errors, correlations=correlations)


def test_correlations_in_python_may_be_a_mapping():
    scene = gp.Scene.from_text(SPREAD.replace("+- 5 ", "").replace("+- 1 ", ""))
    errors = {YOUNG: 1e9, DIAMETER: "8 um"}
    correlations = {"young_modulus, diameter": 0.5}
    changed = gp.Scene(scene.packing, scene.load, errors=errors, correlations=correlations)
    assert changed.correlations == (("material.young_modulus", "packing.diameter", 0.5),)
    assert dict(changed.errors) == {YOUNG: 1e9, DIAMETER: 8.0 * 1e-6}
    assert gp.Scene.from_text(changed.to_yaml()) == changed


def test_check_and_run_tell_errors_and_where_they_come_from(work, capsys):
    """Values of the command line stand in place of those of the file."""
    plain = SCENE.replace("FORCE", "5 N").replace(" +- 2 GPa", " GPa").replace(" +- 4 um", "")
    text = plain.replace("[velocities]", "[gaps, dos]") + "phonopy: {mesh: 4 4 1}\n"
    (work / "scene.yaml").write_text(text)
    values = ["--set", "load.force=18.4 +- 0.2 N", "--set", "material.young_modulus=211 +- 2 GPa"]
    assert main(["check", "scene.yaml", *values]) == 0
    told = capsys.readouterr().out
    assert "error of load.force" in told
    assert "0.95 %" in told
    assert "without errors" not in told  # the table of the density has them
    assert "force 18.40 +/- 0.20 N" in told
    assert "material.young_modulus gives most" in told
    assert main(["run", "scene.yaml", "-o", "out", "--no-figures", *values]) == 0
    assert "load.force gives most" in capsys.readouterr().out
    _, sections = read_report(work / "out")
    blocks = {section.title: section.blocks for section in sections}
    rows = dict(blocks["Standard errors"][0].rows)
    assert "normal stiffness" in rows["material.young_modulus"]
    assert dict(blocks["Numbers"][0].rows)["contact force"] == "18.40 +/- 0.20 N"


@pytest.mark.parametrize(
    ("value", "place"),
    [
        ("load.force", "load.force"),
        ("load.force.x.y=2 N", "load.force.x.y"),
        ("load.forse=2 N", "load.forse.*force"),
        ("load.force=[", "load.force"),
        ("load.force= ", "load.force"),
        ("=2 N", "no key"),
        ("load..force=2 N", "no key"),
    ],
)
def test_values_of_the_command_line_that_are_none_are_refused(work, capsys, value, place):
    (work / "scene.yaml").write_text(SCENE.replace("FORCE", "5 N"))
    assert main(["check", "scene.yaml", "--set", value]) == 2
    assert re.search(place, one_error(capsys))


@pytest.mark.parametrize(
    ("value", "line"),
    [
        ("load.force=[5 N +- 1 %]", 'force: ["5.0 N +- 0.05 N"]'),
        ("sweep.density=[7 g/cm^3 +- 1 %]", 'density: ["7000.0 kg/m^3 +- 70.0 kg/m^3"]'),
        ("direction=[0.5 +- 0.1, 1]", 'direction: ["0.5 +- 0.1", 1.0]'),
    ],
)
def test_lists_of_one_value_and_vectors_have_errors(work, value, line):
    (work / "scene.yaml").write_text(SCENE.replace("FORCE", "5 N"))
    key, _, text = value.partition("=")
    scene = gp.Scene.from_yaml("scene.yaml", {key: text})
    assert len(scene.shifted) == 3
    assert line in scene.to_yaml()
    assert gp.Scene.from_text(scene.to_yaml()).to_yaml() == scene.to_yaml()


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("7840 kg/m^3", "7840 kg/m^3 +- 1 %", "material.density.*sweep of density"),
        ("8 mm", "8 mm, spread: {uniform: 2 +- 0.1 um}", "spread.uniform.*sweep of width"),
    ],
)
def test_errors_of_what_a_sweep_replaces_are_refused(old, new, place):
    plain = SCENE.replace("FORCE", "5 N").replace(" +- 4 um", "") + (
        "sweep: {density: [7 g/cm^3, 8 g/cm^3], width: [1 um, 2 um]}\nmedium: afa\n"
    )
    with pytest.raises(GranphonError, match=place):
        gp.Scene.from_text(plain.replace(old, new))
    scene = gp.Scene.from_text(plain.replace("8 g/cm^3", "8 +- 0.1 g/cm^3"))
    assert [keys[-1] for keys, _ in scene.errors] == ["young_modulus", 1]


@pytest.mark.slow
def test_the_report_has_errors_of_sweeps_gaps_and_tensors(tmp_path):
    text = (
        "balls:\n"
        "  S: {material: {young_modulus: 193 +- 4 GPa, poisson_ratio: 0.3, density: 8000 kg/m^3},"
        " diameter: 19.05 mm}\n"
        "  A: {material: {young_modulus: 73.5 GPa, poisson_ratio: 0.33, density: 2700 kg/m^3},"
        " diameter: 19.05 mm}\n"
        "crystal: {lattice: chain, kinds: [A, S]}\nload: {force: LOAD}\nobserve: [velocities, gaps]\n"
    )
    for name, load in (("one", "20 N"), ("many", "[20 N, 40 N]")):
        scene = gp.Scene.from_text(text.replace("LOAD", load))
        result = scene.run(tmp_path / name, figures=False)
        assert result.summary()["errors_from"]["overlap"] == "balls.S.material.young_modulus"
    _, sections = read_report(tmp_path / "one")
    numbers = dict(next(part for part in sections if part.title == "Numbers").blocks[0].rows)
    assert re.fullmatch(r".* \+/- .* kHz to .* \+/- .* kHz", numbers["gaps"])
    assert "+/-" in numbers["tensor"]
    _, sections = read_report(tmp_path / "many")
    states = next(part for part in sections if part.title == "States").blocks[0]
    assert "+/-" in states.rows[1][2]


OSCILLATOR = (
    BALLS + "crystal: {lattice: chain, kinds: [S], cut: {axis: 0, layers: 3, edges: clamped}}\n"
    "load: {force: 20 N}\nobserve: [response]\n"
    "response: {frequencies: {from: 4 kHz, to: 8 kHz, points: 10}, source: 1 x, receiver: 1 x,"
    " drag: 400 +- 8 1/s}\n"
)
HIT = OSCILLATOR.replace("[response]", "[motion]") + (
    "motion: {duration: 20 us, frames: 3, drive: {balls: [1], impact: 10 +- 0.2 mm/s}}\n"
)


def test_a_second_run_into_a_folder_has_the_same_errors(tmp_path):
    text = SCENE.replace("FORCE", "18.4 N +- 0.2 N").replace(" +- 2 GPa", " GPa")
    scene = gp.Scene.from_text(text.replace(" +- 4 um", ""))
    runs = [scene.run(tmp_path, force=again, figures=False) for again in (False, True)]
    assert runs[0].summary() == runs[1].summary()


@pytest.mark.claim("errors-waves")
def test_the_q_and_the_height_of_a_peak_go_as_one_over_the_drag(tmp_path):
    numbers = gp.Scene.from_text(OSCILLATOR).run(tmp_path, figures=False).summary()
    (peak,) = numbers["peaks"]["1 x"]
    for name in ("quality", "height"):
        assert_allclose(peak[f"{name}_error"] / peak[name], 0.02, rtol=2e-3)
    assert numbers["peak_quality_error"] == peak["quality_error"]


@pytest.mark.claim("errors-edges")
def test_a_peak_that_leaves_the_frequencies_has_the_error_of_its_derivative(tmp_path):
    """A frequency goes as f^(1/6): at both ends of this error the peak of 5.715 kHz is out of
    sight.
    """
    text = OSCILLATOR.replace("20 N", "20 +- 8 N").replace("400 +- 8", "4")
    near = "from: 5.55 kHz, to: 5.88 kHz"
    narrow = gp.Scene.from_text(text.replace("from: 4 kHz, to: 8 kHz", near))
    numbers = narrow.run(tmp_path, figures=False).summary()
    (peak,) = numbers["peaks"]["1 x"]
    assert_allclose(peak["frequency_error"] / peak["frequency"], 0.4 / 6.0, rtol=1e-5)
    assert numbers["peak_frequency_error"] == peak["frequency_error"]
    assert numbers["errors_from"]["peak_frequency"] == "load.force"


@pytest.mark.claim("errors-edges")
def test_a_gap_that_closes_has_the_errors_of_its_derivative(tmp_path):
    """The edges of a chain are (2 k/m)^1/2 of both masses, here equal at one end of the error."""
    steel = "material: {young_modulus: 193 GPa, poisson_ratio: 0.3, density:"
    text = (
        f"balls:\n  S: {{{steel} 8 g/cm^3}}, diameter: 19 mm}}\n"
        f"  A: {{{steel} 7 +- 1 g/cm^3}}, diameter: 19 mm}}\n"
        "crystal: {lattice: chain, kinds: [A, S]}\nload: {force: FORCE}\nobserve: [gaps]\n"
    )
    run = gp.Scene.from_text(text.replace("FORCE", "20 N")).run(tmp_path / "one", figures=False)
    numbers = run.summary()
    ((_, upper),) = numbers["gaps"]
    assert_allclose(numbers["gaps_error"], [[0.0, 0.5 / 7.0 * upper]], rtol=1e-6)
    assert numbers["errors_from"]["gaps"] == "balls.A.material.density"
    loads = gp.Scene.from_text(text.replace("FORCE", "[20 N, 40 N]"))
    data = loads.run(tmp_path / "many", figures=False).dataset
    relative = (data["gap_upper_error"] / data["gap_upper"]).values
    assert_allclose(relative[np.isfinite(relative)], [0.5 / 7.0] * 2, rtol=1e-6)
    assert "no standard errors" not in data.attrs["warnings"]


@pytest.mark.slow
@pytest.mark.claim("errors-waves")
def test_energies_of_a_motion_go_as_the_square_of_the_impact(tmp_path):
    result = gp.Scene.from_text(HIT).run(tmp_path)
    kinetic = result.dataset["motion_kinetic"]
    errors = result.dataset["motion_kinetic_error"]
    assert_allclose(errors.values.ravel()[0] / kinetic.values.ravel()[0], 0.04, rtol=1e-9)
    for figure in (result.figure("motion.png"), motions_figure(result.dataset), gp.plot(result)):
        bands = [band for ax in figure.axes for band in ax.collections]
        assert any("errors" in str(band.get_gid()) for band in bands)


def test_receivers_with_more_peaks_at_one_end_have_no_errors_of_peaks():
    def make(*rows):
        return xr.Dataset({"peaks_frequency": (("receiver", "response_peak"), np.array(rows))})

    propagation = ErrorPropagation(
        ["p"],
        [(make([1.0, 3.0], [2.0, np.nan]), make([1.2, 3.2], [2.1, 4.0]))],
        np.eye(1),
    )
    found = propagation.add_to(make([1.1, 3.1], [2.05, np.nan]))["peaks_frequency_error"]
    assert_allclose(found.values, [[0.1, 0.1], [np.nan, np.nan]])
    assert list(propagation.lacking) == ["peaks_frequency"]


STATE = (
    SCENE.replace("FORCE", "18 N").replace(" +- 4 um", "").replace("[velocities]", "[bands, dos]")
    + "phonopy: {mesh: 8 8 1, band_points: 3}\n"
)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    return gp.Scene.from_text(STATE).run(folder, figures=False).folder


@pytest.mark.claim("errors-files")
def test_bands_and_densities_of_one_state_have_errors_in_their_files(files):
    """All frequencies go as E^(1/3), and so do not cross: a density g(f) goes as g(f/s)/s."""
    relative = ERRORS[0] / 3.0
    data = read_yaml(files / "band.yaml")
    modes = [mode for point in data["phonon"] for mode in point["band"]]
    table = np.array([[mode["frequency"], mode["frequency_error"]] for mode in modes])
    assert_allclose(table[:, 1], relative * table[:, 0], rtol=1e-4)
    assert gp.Bands.read(files / "band.yaml").frequencies.shape == (3, 3, 3)
    density = gp.DensityOfStates.read_csv(files / "dos.csv")
    found = np.genfromtxt(files / "dos.csv", delimiter=",", names=True)
    frequencies = density.frequencies
    scaled = [
        np.interp(frequencies, factor * frequencies, density.total / factor, right=np.nan)
        for factor in ((1.0 - ERRORS[0]) ** (1.0 / 3.0), (1.0 + ERRORS[0]) ** (1.0 / 3.0))
    ]
    known = np.isfinite(found["total_error_per_Hz"])
    assert np.count_nonzero(~known) < 0.01 * len(frequencies)
    expected = 0.5 * np.abs(scaled[1] - scaled[0])
    largest = np.max(expected[known])
    assert_allclose(found["total_error_per_Hz"][known], expected[known], atol=1e-6 * largest)


def test_a_density_that_is_drawn_again_has_the_band_of_its_table(files):
    results = Results(files)
    errors = results.find_errors("dos")["total"]
    dos = results["dos"]
    row = OUTPUTS["bands"]
    _, beside, *_ = row.make_figure(results).axes
    corners = with_gid(beside, "errors").get_paths()[0].vertices
    widths = [np.ptp(corners[corners[:, 1] == y, 0]) for y in dos.frequencies / 1e3]
    assert_allclose(widths, 2e3 * np.nan_to_num(errors), rtol=1e-9, atol=1e-12)
    assert "total_error" not in results["dos"].to_dict()


ARRAY = """
material: {young_modulus: 211 +- 4 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 4 um}}
load: {force: 18.4 N}
medium: {simulation: {shape: 3 6, samples: 1, seed: 1}}
observe: [dos, spectrum, pulse]
spectrum: {points: 3, polarisation: [longitudinal, transverse]}
pulse: {frequency: 6 kHz, distance: 15 mm}
"""


def test_densities_of_a_sweep_have_the_difference_of_both_ends(tmp_path):
    """Of two loads, each at the frequencies of its own density."""
    swept = re.sub("(spectrum|pulse): {.*}\n", "", ARRAY).replace("18.4 N", "[2 N, 20 N]")
    swept = swept.replace("dos, spectrum, pulse", "dos")
    run = gp.Scene.from_text(swept).run(tmp_path, figures=False)
    data = run.dataset
    names = ["dos_frequency", "dos_total"]
    ends = [
        gp.Scene.from_text(swept.replace("211 +- 4", young)).sweep()[names]
        for young in ("207", "215")
    ]
    for load in range(2):
        frequencies, _ = (data[name].values[load, 0] for name in names)
        lower, upper = (
            np.interp(frequencies, *(end[name].values[load, 0] for name in names), right=np.nan)
            for end in ends
        )
        errors = data["dos_total_error"].values[load, 0]
        assert_allclose(errors, 0.5 * np.abs(upper - lower), rtol=1e-9, atol=1e-18)
        assert np.nanmax(errors) > 0.0
    assert "dos_total_error (1/Hz)" in (tmp_path / "sweep_dos.csv").read_text().split("\n")[0]
    (panel,) = OUTPUTS["sweep_dos"].make_figure(Results(tmp_path)).axes
    bands = [part for part in panel.collections if (part.get_gid() or "").startswith("errors-")]
    both = np.hypot(data["dos_error"], np.nan_to_num(data["dos_total_error"])).values[:, 0]
    for band, errors in zip(bands, both, strict=True):
        widths = np.diff(read_edges(band))[:, 0]
        assert_allclose(widths, 2e3 * errors, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_figures_of_arrays_have_bands_of_errors_also_when_they_are_drawn_again(tmp_path):
    run = gp.Scene.from_text(ARRAY).run(tmp_path, figures=False)
    for results in (run, Results(tmp_path)):
        pulse = results.find_errors("pulse")
        above, below = OUTPUTS["pulse"].make_figure(results).axes
        for name in ("envelope", "speckle"):
            edges = read_edges(with_gid(below, f"{name}-errors"))
            expected = 2.0 * np.nan_to_num(pulse[name])
            assert_allclose(np.diff(edges)[:, 0], expected * 1e3, atol=1e-9)
        assert with_gid(above, "errors").get_paths()
        (density,) = OUTPUTS["sample_dos"].make_figure(results).axes
        bands = [
            part for part in density.collections if (part.get_gid() or "").startswith("errors-")
        ]
        assert len(bands) == 3
        of_lines = results.find_errors("spectrum")["attenuation"].reshape(2, -1)
        expected = []
        for line, errors in zip(results["spectrum"].spectra, of_lines, strict=True):
            is_drawn = line.resolved & (line.width > 0.0)
            above_line = errors[is_drawn]
            # the axis is logarithmic: bars do not reach zero
            expected.extend(above_line + np.minimum(above_line, 0.9 * line.attenuation[is_drawn]))
        bars = [
            np.ptp(segment[:, 1])
            for part in OUTPUTS["spectrum"].make_figure(results).axes[2].collections
            for segment in part.get_segments()
            if np.ptp(segment[:, 0]) == 0.0
        ]
        assert len(bars) > 1
        assert_allclose(np.sort(bars), np.sort(expected), rtol=1e-9)


@pytest.mark.claim("errors-files")
@pytest.mark.slow
def test_contacts_of_a_motion_have_errors_in_their_table(tmp_path):
    result = gp.Scene.from_text(HIT).run(tmp_path, figures=False)
    table = np.genfromtxt(tmp_path / "motion_contacts.csv", delimiter=",", names=True)
    errors = table["greatest_force_error_N"]
    ends = [
        gp.Scene.from_text(HIT.replace("10 +- 0.2", text)).run(tmp_path / text, figures=False)
        for text in ("9.8", "10.2")
    ]
    lower, upper = (end["balls_in_motion"].peaks()[1] for end in ends)
    assert_allclose(errors, 0.5 * np.abs(upper - lower), rtol=1e-12)
    assert np.max(errors) > 0.0
    assert "motion.nc" in OUTPUTS["balls_in_motion"].files_without_errors
    assert result.column_errors["balls_in_motion"]["greatest_force"].tolist() == errors.tolist()


def test_derivatives_that_are_constant_powers_have_no_errors():
    """Differences of them are their own rounding."""
    powers = xr.Dataset({"sensitivity": (("sensitivity_to",), np.array([1.0 / 3.0]))})
    propagation = ErrorPropagation(
        ["p"], [(powers * (1.0 - 1e-11), powers * (1.0 + 1e-11))], np.eye(1)
    )
    assert "sensitivity_error" not in propagation.add_to(powers)


def test_tables_along_a_time_are_compared_at_equal_times():
    """Signals that only run faster have the error of their slope."""
    times = np.linspace(0.0, 1.0, 11)
    propagation = ErrorPropagation(
        ["p"],
        [({"time": 1.01 * times, "a": times}, {"time": 0.99 * times, "a": times})],
        np.eye(1),
    )
    errors = propagation.find_along({"time": times, "a": times}, "time")
    assert list(errors) == ["a"]
    assert_allclose(errors["a"][:-1], 0.01 * times[:-1], rtol=1e-3)
    assert np.isnan(errors["a"][-1])  # one of the two has ended


def test_peaks_that_another_one_replaces_have_no_errors():
    """One enters below as another leaves above: their number stays, and the second jumps."""

    def make(*row):
        return xr.Dataset({"peaks_frequency": (("receiver", "response_peak"), np.array([row]))})

    propagation = ErrorPropagation(["p"], [(make(0.9, 1.9), make(1.1, 3.4))], np.eye(1))
    found = propagation.add_to(make(1.0, 2.0))["peaks_frequency_error"]
    assert_allclose(found.values, [[0.1, np.nan]])
    assert list(propagation.lacking) == ["peaks_frequency"]


def test_waves_of_an_edge_have_errors_where_their_number_stays():
    """An end may have a wave more at one wave vector, and so a longer row at all of them."""

    def make(*rows):
        dims = ("surface_point", "surface_wave")
        return xr.Dataset({"surface_frequency": (dims, np.array(rows))})

    propagation = ErrorPropagation(
        ["p"],
        [(make([1.0, np.nan], [2.0, np.nan]), make([1.2, np.nan, np.nan], [0.5, 2.2, 4.0]))],
        np.eye(1),
    )
    found = propagation.add_to(make([1.1], [2.1]))["surface_frequency_error"]
    assert_allclose(found.values, [[0.1], [np.nan]])
    assert list(propagation.lacking) == ["surface_frequency"]


@pytest.mark.claim("errors-edges")
@pytest.mark.slow
def test_waves_of_an_edge_have_the_error_of_their_derivative(tmp_path):
    """The end of the chain has a wave where its ball is the lighter one, here not within the whole
    error: at one end of the error there is none.
    """
    text = """
balls:
  A: {material: {young_modulus: 193 GPa, poisson_ratio: 0.3, density: DENSITY}, diameter: 19 mm}
  B: {material: {young_modulus: 73 GPa, poisson_ratio: 0.3, density: 2.7 g/cm^3}, diameter: 19 mm}
crystal: {lattice: chain, kinds: [A, B], friction: false}
load: {force: 8 N}
observe: [OBSERVED]
surface: {axis: 0}
"""
    plain = text.replace("DENSITY", "2 g/cm^3").replace("OBSERVED", "sensitivities, surface")
    power = (
        gp.Scene.from_text(plain)
        .sweep()["sensitivity"]
        .sel(sensitivity_of="surface_frequency 0", sensitivity_to="A.density")
    )
    heavier = text.replace("DENSITY", "3 g/cm^3").replace("OBSERVED", "surface")
    assert not np.any(np.isfinite(gp.Scene.from_text(heavier).sweep()["surface_frequency"]))
    uncertain = text.replace("DENSITY", "2 +- 1 g/cm^3").replace("OBSERVED", "surface")
    run = gp.Scene.from_text(uncertain).run(tmp_path, figures=False)
    data = run.dataset
    for figure in (gp.plot(run), run.figure("surface.png")):
        assert with_gid(figure.axes[0], "error 0").get_width() > 0.0
    relative = data["surface_frequency_error"] / data["surface_frequency"]
    assert_allclose(relative.values.ravel(), 0.5 * np.abs(power.values.ravel()), rtol=1e-5)
    assert "surface_frequency" not in data.attrs["warnings"]
    # the motions fall by the ratio of the masses from layer to layer
    ratio = (2.0 / 2.7) ** 2
    assert_allclose(data["surface_weight"].values.ravel(), 1.0 - ratio, rtol=1e-9)
    table = np.genfromtxt(tmp_path / "surface.csv", delimiter=",", names=True)
    assert_allclose(table["weight_error"], 2.0 * ratio * 0.5, rtol=1e-5)


def test_a_wall_of_a_kind_without_balls_has_the_error_of_this_kind():
    text = """
balls:
  S: {material: {young_modulus: 211 GPa, poisson_ratio: 0.28, density: 7840 kg/m^3}, diameter: 19 mm}
  A: {material: {young_modulus: 73 +- 20 GPa, poisson_ratio: 0.33, density: 2700 kg/m^3}, diameter: 19 mm}
crystal: {lattice: chain, kinds: [S]}
load: {force: 20 N}
observe: [surface]
surface: {axis: 0, edge: {wall: A}}
"""
    scene = gp.Scene.from_text(text)
    pair = [end.observed_settings("surface").edge.material for end in scene.shifted[0]]
    assert_allclose([material.young_modulus for material in pair], [53e9, 93e9])
    assert 'wall: "A"' in scene.to_yaml()


def test_evenly_spaced_values_of_a_list_have_their_own_errors():
    text = SCENE.replace("FORCE", "[10 +- 1 N, 20 +- 2 N, 30 +- 3 N]")
    scene = gp.Scene.from_text(text)
    loads = [[end.load.array.tolist() for end in pair] for pair in scene.shifted[-3:]]
    assert loads[1] == [[10.0, 18.0, 30.0], [10.0, 22.0, 30.0]]
    assert gp.Scene.from_text(scene.to_yaml()) == scene


def test_losses_of_a_fit_have_its_errors_and_correlations(tmp_path):
    """Both of each pair, a number, and a restitution."""
    names = ("drag", "rotational_drag", "dashpot", "tangential_dashpot", "loss_factor")
    names += ("damping", "tangential_damping", "restitution")
    values = np.array([400.0, 900.0, 2.0, 1.0, 0.02, 2e-7, 3e-7, 0.95])
    correlation = 0.5 * np.eye(len(names)) + 0.5
    scale = 0.01 * values
    gp.DampingFit(
        parameters=names,
        values=values,
        covariance=correlation * np.outer(scale, scale),
        damping=values[5:7],
        loss_factor=np.full(2, 0.02),
        measured=gp.TransferFunction(np.ones(1), np.ones(1), sigma=np.ones(1)),
        quantity="displacement",
        sigma_given=True,
        magnitude=np.ones(1),
        phase=np.zeros(1),
        chi2=0.0,
        dof=0,
        warnings=(),
    ).write(tmp_path)
    fitted = "{fit: fit.yaml}"
    pair = f"[{fitted}, {fitted}]"
    losses = f"drag: {pair}, dashpot: {pair}, damping: {pair}, loss_factor: {fitted}"
    text = OSCILLATOR.replace("drag: 400 +- 8 1/s", f"{losses}, restitution: {fitted}")
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    scene = gp.Scene.from_yaml(path)
    assert scene.response.losses == {
        "drag": (400.0, 900.0),
        "dashpot": (2.0, 1.0),
        "damping": (2e-7, 3e-7),
        "loss_factor": 0.02,
        "restitution": 0.95,
    }
    errors = dict(scene.errors)
    assert_allclose(errors["response", "drag", 1], 9.0, rtol=1e-12)
    assert_allclose(errors["response", "restitution"], 0.0095, rtol=1e-12)
    assert len(errors) == len(names)
    assert_allclose([value for *_, value in scene.correlations], 0.5, rtol=1e-12)


TIMES = "force (N),time (us)\n4,500\n8,446\n16,397\n32,354\n"
CHAIN = (
    "material: {young_modulus: 211 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
    "packing: {lattice: chain, diameter: 8 mm}\nload: {force: [4 N, 16 N]}\n"
)


@pytest.mark.claim("errors-fit")
@pytest.mark.parametrize(
    ("density", "distance", "relative"),
    [
        pytest.param("7840 kg/m^3 +- 2 %", "0.3 m", 3.0 / 2.0 * 0.02, marks=pytest.mark.slow),
        pytest.param("7840 kg/m^3", "300 +- 6 mm", 3.0 * 0.02, marks=pytest.mark.slow),
        ("7840 kg/m^3 +- 2 %", "0.3 m +- 2 %", 3.0 * np.hypot(0.02, 0.01)),
    ],
)
def test_a_fit_holds_the_errors_of_its_inputs(work, capsys, density, distance, relative):
    """E of a chain goes as v^3 rho^(3/2), and a velocity as the distance of the sensors."""
    (work / "times.csv").write_text(TIMES)
    words = ["--no-width", "--parameter", "young_modulus", "--sigma", "1 %", "-o", "out"]
    covariances = []
    for changed, way in (("7840 kg/m^3", "0.3 m"), (density, distance)):
        (work / "scene.yaml").write_text(CHAIN.replace("7840 kg/m^3", changed))
        command = ["fit", "scene.yaml", "times.csv", "--distance", way, *words, "--force"]
        assert main(command) == 0
        fit = gp.WidthFit.from_dict(read_yaml(work / "out" / "fit.yaml"))
        covariances.append(fit.covariance[0, 0] / fit.values[0] ** 2)
    assert_allclose(np.sqrt(covariances[1] - covariances[0]), relative, rtol=2e-3)
    assert "of inputs" in capsys.readouterr().out


def test_times_of_flight_have_the_error_of_their_distance(work):
    (work / "times.csv").write_text(TIMES)
    measured = Measurements.read(work / "times.csv", distance=(0.3, 0.003))
    assert_allclose(measured.sigma, 0.01 * measured.velocity)
    (work / "scene.yaml").write_text(CHAIN)
    assert main(["run", "scene.yaml", "-o", "out", "--no-figures"]) == 0
    words = ["plot", "out", "--data", "times.csv", "-o", "drawn.svg"]
    assert main([*words, "--distance", "0.3 m +- 1 %"]) == 0
    assert (work / "drawn.svg").exists()
    assert main([*words, "--force", "--distance", "0.3 m +- -1 mm"]) == 2


def test_cost_of_errors_is_that_of_what_shifted_scenes_compute():
    text = (
        "balls: {A: {material: {young_modulus: 193 GPa, poisson_ratio: 0.3, density: 8 g/cm^3},"
        " diameter: 10 mm}}\ncrystal: {lattice: triangular, kinds: [A]}\nload: {force: 20 N}\n"
        "observe: [surface]\nsurface: {axis: 1, points: 1001}\n"
    )
    costs = [
        gp.Scene.from_text(text.replace("193 GPa", modulus)).cost()
        for modulus in ("193 GPa", "193 GPa +- 1 GPa")
    ]
    (searches, *_), (spectra, *_) = costs[0].units
    numbers = {searches: 0.0, spectra: 0.0}
    for number, *_ in costs[1].units:
        numbers[spectra if number == spectra else searches] += number
    # the map is that of the scene itself; its waves are found in two scenes of the error, and again
    # in two of a small change
    assert numbers == {searches: 5.0 * searches, spectra: spectra}


def test_the_error_of_a_wave_of_an_edge_is_one_number(tmp_path):
    text = """\
material: {young_modulus: 70 +- 1 GPa, poisson_ratio: 0.22, density: 2500 kg/m^3}
packing: {diameter: 1 mm}
load: {force: 5 N}
observe: [surface]
surface: {axis: 1, points: 3}
"""
    result = gp.Scene.from_text(text).run(tmp_path / "out", figures=False)
    error = result.dataset["surface_velocity_error"]
    summary = read_yaml(tmp_path / "out" / "summary.yaml")
    assert summary["surface_velocity_error"] == error.item()
    assert summary["errors_from"]["surface_velocity"] == "material.young_modulus"
    # velocities grow as the power 1/3 of E at a given force, to first order
    expected = summary["surface_velocity"] / 3.0 / 70.0
    assert error.item() == pytest.approx(expected, rel=1e-5)


def test_names_of_registered_observables_do_not_say_how_errors_are_found(tmp_path):
    """Names that begin as those of gaps and of waves of an edge are those of plain numbers."""
    name = "gap_between_centres"
    observables = [
        gp.observables.register(name, "m", "a length", lambda analysis: analysis.state.overlap),
        gp.observables.register("surface_load", "N", "a load", lambda of: 2.0 * of.state.force),
    ]
    try:
        scene = gp.Scene.from_text(SCENE.replace("FORCE", "20 N +- 2 N"))
        numbers = scene.run(tmp_path, figures=False).summary()
    finally:
        for observable in observables:
            CATALOGUE.remove(observable.name)
    assert numbers["surface_load_error"] == pytest.approx(4.0, rel=1e-12)
    assert numbers[f"{name}_error"] == numbers["overlap_error"]


def test_a_path_that_ends_early_in_a_shifted_scene_leaves_no_loads(tmp_path, monkeypatch):
    """They would be those of another value of the parameter."""
    scene = gp.Scene.from_text(SCENE.replace("FORCE", "[18 N, 20 N]"))
    sweep = Plan.sweep

    def fail_if_shifted(plan, *arguments, **options):
        dataset = sweep(plan, *arguments, **options)
        if plan is not scene.plan:
            error = ConvergenceError("the path ends")
            error.reached = dataset.isel(load=[0])
            raise error
        return dataset

    monkeypatch.setattr(Plan, "sweep", fail_if_shifted)
    with pytest.raises(ConvergenceError, match="the path ends"):
        scene.run(tmp_path / "out", figures=False)
    # finished states stay
    assert [path.name for path in (tmp_path / "out").iterdir()] == [WORK_FILE]
