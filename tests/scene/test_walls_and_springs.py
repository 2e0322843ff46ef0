"""Scenes with walls of a material and springs to the ground: what is read, written, checked, run
and drawn.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import SceneError
from granphon.cli.main import main
from tests.scene.mistakes import BALLS, HELD, ROW, WALL

STEEL = gp.Material(193e9, 0.30, 8000.0)
BRASS = gp.Material(103e9, 0.34, 8500.0)


def steel_ball():
    """The ball of the kind S."""
    return gp.Ball(STEEL, 19.05e-3, mass=28.84e-3)


@pytest.mark.parametrize(
    "text", [HELD, ROW, *(ROW.replace(WALL, f"{{wall: {kind}}}") for kind in "SA")]
)
def test_a_scene_is_written_as_it_was_read(text):
    scene = gp.Scene.from_text(text)
    again = gp.Scene.from_text(scene.to_yaml())
    assert again.packing == scene.packing
    assert again.to_yaml() == scene.to_yaml()


def test_a_wall_may_be_of_a_kind_that_the_crystal_does_not_have():
    scene = gp.Scene.from_text(ROW.replace(WALL, "{wall: A}"))
    aluminium = next(ball.material for name, ball in scene.packing.kinds if name == "A")
    assert scene.packing.kind_names == ("S",)
    assert scene.state().network.wall.material == aluminium


def top_of_bands(force):
    """The highest frequency of the balls of HELD, Hz, at Gamma or at the end of the zone."""
    springs = {"x": 1e6, "rotation": 30.0}
    crystal = gp.Crystal.on("chain", [steel_ball()], motions="in_plane", on_site=springs)
    return np.max(gp.Phonons(crystal.at_force(force)).frequencies([[0.0], [0.5]]))


def test_a_scene_has_the_bands_of_its_crystal(tmp_path):
    text = HELD.replace("[10 N, 20 N]", "20 N").replace("[bands, gaps]", "[bands]")
    result = gp.Scene.from_text(text).run(tmp_path / "out", figures=False)
    assert_allclose(result.summary()["top_frequency"], top_of_bands(20.0), rtol=1e-9)


@pytest.mark.slow
def test_a_sweep_has_the_bands_of_its_crystals(tmp_path):
    result = gp.Scene.from_text(HELD).run(tmp_path / "out")
    tops = [top_of_bands(force) for force in (10.0, 20.0)]
    assert_allclose(result.dataset["top_frequency"].values.ravel(), tops, rtol=1e-9)
    assert {"sweep_gaps.csv", "sweep_gaps.png"} <= {path.name for path in result.files}


def test_a_row_on_a_wall_has_the_response_of_its_crystal(tmp_path):
    result = gp.Scene.from_text(ROW).run(tmp_path / "out", figures=False)
    row = gp.Crystal.on("chain", [steel_ball()], on_site=2e4).repeat((4,))
    network = row.cut(0, 1, (gp.Wall(BRASS), "free")).at_force(20.0).network
    expected = gp.Waves(network).response([1e3, 2e3], (3, "x"), (0, "x"), damping=1e-6)
    values = result.dataset["receptance"] * np.exp(1j * result.dataset["response_phase"])
    assert_allclose(values.values.ravel(), expected.values.ravel(), rtol=1e-12)


def test_check_tells_walls_and_springs(tmp_path, capsys):
    (tmp_path / "scene.yaml").write_text(ROW)
    assert main(["check", str(tmp_path / "scene.yaml")]) == 0
    told = capsys.readouterr().out
    assert "wall with E = 103 GPa and free" in told
    assert "springs to the ground" in told


CUT = "  cut: {axis: 0, layers: 4, edges: [{wall: A}, free]}\n"
RESPONSE = (
    BALLS + "crystal: {lattice: chain, kinds: [S]}\nload: {force: 20 N}\nobserve: [response]\n"
    "response:\n  {frequencies: [1 kHz, 2 kHz], source: 3 x, receiver: 0 x, damping: 1 us,\n"
    f"{CUT.rstrip()}}}\n"
)
SURFACE = (
    BALLS + "crystal: {lattice: triangular, kinds: [S], motions: in_plane}\nload: {force: 20 N}\n"
    "observe: [surface]\nsurface: {axis: 1, points: 2, edge: {wall: A}}\n"
)


def test_a_wall_of_a_response_may_be_of_a_kind_that_the_crystal_does_not_have(tmp_path):
    data = gp.Scene.from_text(RESPONSE).run(tmp_path / "out", figures=False).dataset
    aluminium = dict(gp.Scene.from_text(RESPONSE).packing.kinds)["A"].material
    network = gp.Crystal.on("chain", [steel_ball()]).at_force(20.0).network
    row = network.cut(0, 4, edges=(gp.Wall(aluminium), "free"))
    expected = gp.Waves(row).response([1e3, 2e3], (3, "x"), (0, "x"), damping=1e-6)
    assert_allclose(data["receptance"].values.ravel(), expected.magnitude.ravel(), rtol=1e-12)


def test_check_and_run_take_a_surface_at_a_wall_of_another_kind(tmp_path, capsys):
    path = tmp_path / "scene.yaml"
    path.write_text(SURFACE)
    assert main(["check", str(path)]) == 0
    assert "wall with E = " in capsys.readouterr().out
    assert main(["run", str(path), "-o", str(tmp_path / "out"), "--no-figures"]) == 0


@pytest.mark.parametrize(
    ("text", "place"), [(RESPONSE, "response.cut: .*'X'"), (SURFACE, "surface.edge: .*'X'")]
)
@pytest.mark.parametrize("sweep", ["", "sweep: {S.young_modulus: [190 GPa, 200 GPa]}\n"])
def test_a_wall_of_no_kind_is_refused_at_its_edge(text, place, sweep):
    with pytest.raises(SceneError, match=place):
        gp.Scene.from_text(sweep + text.replace("{wall: A}", "{wall: X}"))


def test_a_sweep_varies_the_wall_of_a_cut_across_that_on_which_the_crystal_rests():
    wall = {"young_modulus": 70e9, "poisson_ratio": 0.33, "density": 2700.0}
    crystal = gp.Crystal.on("triangular", [steel_ball()], motions="in_plane")
    held = crystal.cut(1, 2, edges=(gp.Wall(BRASS), "free"))
    response = {"frequencies": [1e3], "source": "3 x", "receiver": "4 x", "loss_factor": 0.02}
    cut = {"axis": 0, "layers": 2, "edges": [{"wall": wall}, "free"]}
    moduli = {"response.wall.young_modulus": [3e9, 70e9]}
    data = gp.sweep(held, force=5.0, response=response | {"cut": cut}, **moduli)
    network = held.at_force(5.0).network
    for modulus, swept in zip((3e9, 70e9), data["receptance"].values.ravel(), strict=True):
        row = network.cut(0, 2, edges=(gp.Wall(gp.Material(modulus, 0.33, 2700.0)), "free"))
        expected = gp.Waves(row).response([1e3], (3, "x"), (4, "x"), loss_factor=0.02)
        assert_allclose(swept, expected.magnitude[0, 0], rtol=1e-12)
