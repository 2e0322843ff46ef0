"""Scenes that observe the waves of an edge: their numbers, files and figures."""

from __future__ import annotations

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import SceneError
from granphon.dynamics.half_space import HalfSpace
from granphon.scene.redraw import redraw

PACKING = """
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {lattice: LATTICE, diameter: 8 mm}
load: {force: FORCE}
observe: [surface]
surface: {axis: AXIS, points: 3}
"""
CRYSTAL = """
balls:
  A: {material: {young_modulus: 193 GPa, poisson_ratio: 0.30, density: 8000 kg/m^3}, diameter: 19.05 mm}
  B: {material: {young_modulus: 73.5 GPa, poisson_ratio: 0.33, density: 2700 kg/m^3}, diameter: 19.05 mm}
crystal: {lattice: chain, kinds: [B, A]}
load: {force: FORCE}
observe: [surface]
surface: {axis: 0}
"""


def scene(text, **words):
    for name, word in words.items():
        text = text.replace(name, word)
    return gp.Scene.from_text(text)


@pytest.mark.slow
def test_a_single_state_has_a_figure(tmp_path):
    files = scene(PACKING, LATTICE="square", AXIS="1", FORCE="18 N").run(tmp_path).files
    assert "surface.png" in {path.name for path in files}
    assert redraw(tmp_path, force=True).name == "surface.png"


def test_a_single_state_has_a_map_and_a_table(tmp_path):
    one = scene(PACKING, LATTICE="square", AXIS="1", FORCE="18 N")
    result = one.run(tmp_path, figures=False)
    edge = gp.Surface(one.state(), 1)
    assert result.surface == edge.map(3)
    assert {"surface.json", "surface.csv"} <= {path.name for path in result.files}
    read = gp.SurfaceSpectrum.from_dict(json.loads((tmp_path / "surface.json").read_text()))
    assert read == result.surface
    waves = np.genfromtxt(tmp_path / "surface.csv", delimiter=",", names=True)
    assert_allclose(waves["frequency_Hz"], read.waves.frequencies, rtol=1e-15)
    assert result.summary()["surface_velocity"] == edge.velocity()
    found = result.dataset["surface_frequency"].values.ravel()
    assert_allclose(found[np.isfinite(found)], read.waves.frequencies, rtol=1e-15)
    assert gp.plot(result).axes[0].get_ylabel() == "Frequency (kHz)"
    again = gp.Scene.from_text(one.to_yaml())
    assert again == one


def test_the_waves_of_an_edge_are_in_the_cost():
    """Along the path at each load, and for one state the spectra of the map."""
    counts = []
    for force in ("18 N", "[5 N, 18 N, 30 N]"):
        one = scene(PACKING, LATTICE="triangular", AXIS="1", FORCE=force)
        costs = [cost for place, _, cost in one.parts if place == ("surface", "points")]
        assert all("3 wave vectors" in cost.parts[0] for cost in costs)
        counts.append([number for cost in costs for number, *_ in cost.units])
    assert counts[0][1] == 3 * 241
    assert counts[1] == [3 * counts[0][0]]
    uncertain = scene(PACKING, LATTICE="triangular", AXIS="1", FORCE="18 +- 1 N")
    units = [
        unit for place, _, cost in uncertain.parts if place[0] == "surface" for unit in cost.units
    ]
    # the waves at both ends of the error, and of a small change; the map once
    *numbers, number_of_map = (number for number, *_ in units)
    assert (sum(numbers), number_of_map) == (5 * counts[0][0], 3 * 241)
    large = scene(
        CRYSTAL.replace("chain, kinds: [B, A]", "chain, kinds: [B, A], repeat: 40"), FORCE="1 N"
    )
    told = large.cost()
    assert told.seconds > 5.0
    assert "of an edge" in told.text
    assert scene(CRYSTAL, FORCE="1 N").cost() is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PACKING, {"LATTICE": "square", "AXIS": "1"}),
        pytest.param(CRYSTAL, {}, marks=pytest.mark.slow),
    ],
)
def test_a_run_searches_the_waves_of_a_state_once(text, words, tmp_path, monkeypatch):
    searches = []
    find = HalfSpace.find_waves
    monkeypatch.setattr(
        HalfSpace, "find_waves", lambda half, q: searches.append(q) or find(half, q)
    )
    scene(text, FORCE="18 N", **words).run(tmp_path, figures=False)
    assert len(searches) == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        pytest.param(PACKING, {"LATTICE": "square", "AXIS": "1"}, marks=pytest.mark.slow),
        pytest.param(PACKING, {"LATTICE": "fcc", "AXIS": "1 1 0"}, marks=pytest.mark.slow),
        (CRYSTAL, {}),
    ],
)
def test_a_sweep_has_the_waves_of_every_state(text, words, tmp_path):
    result = scene(text, FORCE="[2 N, 128 N]", **words).run(tmp_path, figures=False)
    data = result.dataset["surface_frequency"].values[:, 0]
    # Hertz: stiffnesses go as f^(1/3), frequencies as f^(1/6)
    assert_allclose(data[1], 2.0 * data[0], rtol=1e-13)
    assert result.surface is None
    alone = scene(text, FORCE="128 N", **words)
    edge = gp.Surface(alone.state(), alone.surface.axis)
    waves = edge.branches(edge.path(3)[0][:, : len(edge.cell)])
    here = data[1]
    assert_allclose(here[np.isfinite(here)], waves.frequencies, rtol=1e-13)
    q, distances, *_ = edge.path(3)
    table = np.genfromtxt(tmp_path / "sweep_surface.csv", delimiter=",", names=True)
    rows = table[table["force_N"] == 128.0]
    assert_allclose(rows["surface_frequency_Hz"], waves.frequencies, rtol=1e-13)
    assert_allclose(rows["distance_1d"], distances[waves.place])
    assert_allclose(np.stack([rows["q1"], rows["q2"], rows["q3"]], axis=1), q[waves.place])
    assert ("surface_velocity" in result.dataset) == (text == PACKING)


@pytest.mark.parametrize("medium", [pytest.param("[ala, ema]", marks=pytest.mark.slow), "ema"])
def test_balls_that_differ_have_the_waves_of_their_mean_lattice(medium):
    text = (
        PACKING.replace("diameter: 8 mm", "diameter: 8 mm, spread: {uniform: 2 um}")
        + f"medium: {medium}\n"
    )
    data = scene(text, LATTICE="triangular", AXIS="1", FORCE="[20 N, 40 N]").sweep()
    assert np.all(data["surface_velocity"] > 0.0)


CUTS = {
    "zigzag": ("honeycomb", "1"),
    "armchair": ("honeycomb", "1 1"),
    "square": ("square", "1"),
    "along a bond": ("triangular", "1"),
    "across a bond": ("triangular", "1 1"),
    "001": ("fcc", "1 1 0"),
    "110": ("fcc", "1 1 2"),
    "111": ("fcc", "1 1 1"),
    "0001": ("hcp", "2"),
    "sc": ("sc", "2"),
}


#: of a plane and of space, with one ball in the cell and several
FEW = "zigzag", "armchair", "across a bond", "001", "111"


@pytest.mark.parametrize(
    ("lattice", "axis"),
    [
        pytest.param(*cut, id=name, marks=() if name in FEW else pytest.mark.slow)
        for name, cut in CUTS.items()
    ],
)
def test_scenes_of_each_cut(lattice, axis):
    words = {"LATTICE": lattice, "AXIS": axis}
    one = scene(PACKING, FORCE="18 N", **words)
    # the long wave is slower than sound in the crystal, as is every wave of the edge below the
    # lowest band
    edge = gp.Surface(one.state(), one.surface.axis)
    q = edge.path(3)[0][1:2, : len(edge.cell)]
    waves = edge.branches(q)
    continuum = edge.continuum(q)
    assert np.all(waves.frequencies < continuum.max())
    text = CRYSTAL.replace(
        "lattice: chain, kinds: [B, A]",
        f"lattice: {lattice}, kinds: [A], cut: {{axis: {axis}, layers: 4}}",
    )
    text = text.replace("[surface]", "[bands]").replace(
        "surface: {axis: 0}", "phonopy: {band_points: 2}"
    )
    if (lattice, axis) == (
        "honeycomb",
        "1 1",
    ):
        # a ball of that edge has two contacts, which cannot balance
        with pytest.raises(SceneError, match="add up"):
            scene(text, FORCE="20 N")
        return
    ribbon = scene(text, FORCE="20 N")
    assert ribbon.packing.structure.periods == len(edge.cell)
    assert gp.Phonons(ribbon.state()).frequencies(np.full((1, len(edge.cell)), 0.2)).max() > 0.0


@pytest.mark.parametrize(
    "text",
    [pytest.param(PACKING.replace("points: 3", "points: 3, edge: floor"), id="plane"), CRYSTAL],
)
def test_errors_of_a_force_are_bars_about_the_waves(text, tmp_path):
    """Frequencies go as f^(1/6): an error of 6 % of the force is one of 1 % of each wave."""
    words = {"LATTICE": "square", "AXIS": "1", "FORCE": "18 +- 1.08 N"}
    result = scene(text, **words).run(tmp_path, figures=False)
    waves = result.surface.waves
    ax = result.figure("surface.png").axes[0]
    if text == CRYSTAL:
        widths = [patch.get_width() for patch in ax.patches if "error" in (patch.get_gid() or "")]
    else:
        (bars,) = [item for item in ax.collections if item.get_gid() == "errors"]
        widths = [end[1, 1] - end[0, 1] for end in bars.get_segments()]
    assert_allclose(widths, 2e-2 * waves.frequencies / 1e3, rtol=2e-3)
