"""Scenes with walls of a material and springs to the ground: what is read, written, checked, run
and drawn.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.cli.commands import main
from tests.scene.mistakes import HELD, ROW, WALL

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
