"""Gaps, and waves of an edge, over loads and parameters: closed forms, tables, and figures."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.cli.main import main
from granphon.figures.gaps import (
    cutoffs_figure,
    modes_figure,
    sweep_gaps_figure,
    sweep_surface_figure,
)
from granphon.scene.redraw import redraw
from granphon.scene.scene import Scene

SCENE = """\
balls:
  S: {material: {young_modulus: 193 GPa, poisson_ratio: 0.30, density: 8000 kg/m^3}, diameter: 19 mm}
  A: {material: {young_modulus: 73.5 GPa, poisson_ratio: 0.33, density: 2700 kg/m^3}, diameter: 19 mm}
crystal: {lattice: chain, kinds: [A, S], friction: false}
load: {force: [1 N, 8 N, 27 N]}
observe: [velocities, gaps, surface]
surface: {axis: 0}
sweep: {A.density: [2000 kg/m^3, 4000 kg/m^3, 8000 kg/m^3]}
"""
DENSITIES = np.array([2000.0, 4000.0, 8000.0])
MASS_PER_DENSITY = np.pi / 6.0 * 19e-3**3


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gaps") / "out"
    return Scene.from_text(SCENE).run(folder)


def test_gaps_over_loads_and_parameters_are_those_of_the_chain_of_two_masses(result):
    """f = (2 k/m)^1/2/2 pi at both edges, and (2 k (1/m + 1/M))^1/2/2 pi at the top: balls of
    equal masses have no gap.
    """
    data = result.dataset
    light = MASS_PER_DENSITY * DENSITIES
    heavy = MASS_PER_DENSITY * 8000.0
    stiffness = data["normal_stiffness"].values[:, 0]  # (loads, densities)
    below = np.sqrt(2.0 * stiffness / heavy) / (2.0 * np.pi)
    above = np.sqrt(2.0 * stiffness / light) / (2.0 * np.pi)
    top = np.sqrt(2.0 * stiffness * (1.0 / light + 1.0 / heavy)) / (2.0 * np.pi)
    lower = data["gap_lower"].values[:, 0]  # (loads, densities, branches below)
    upper = data["gap_upper"].values[:, 0]
    assert_allclose(lower[:, :2, 1], below[:, :2], rtol=1e-9)
    assert_allclose(upper[:, :2, 1], above[:, :2], rtol=1e-9)
    assert_allclose(data["top_frequency"].values[:, 0], top, rtol=1e-9)
    # none below the first branch, and none between branches that touch
    assert np.all(np.isnan(lower[..., 0]))
    assert np.all(np.isnan(upper[:, 2]))
    assert data["gap_lower"].attrs["units"] == "Hz"
    extent = result.summary()["top_frequency"]
    assert_allclose(extent, [top.min(), top.max()], rtol=1e-9)


def test_the_gaps_of_one_state_are_the_same(result):
    one = Scene.from_text(
        SCENE.replace("[1 N, 8 N, 27 N]", "8 N").replace("surface]", "bands]")
        .replace("surface: {axis: 0}\n", "").replace("sweep:", "# ")
    )  # fmt: skip
    chain = one.state()
    (gap,) = gp.Phonons(chain).gaps()
    branches, gaps = gp.Phonons(chain).find_gaps()
    assert branches.tolist() == [1]
    assert_allclose(gaps, [gap], rtol=0.0)
    many = Scene.from_text(
        SCENE.replace("sweep: {A.density: [2000 kg/m^3, 4000 kg/m^3, 8000 kg/m^3]}\n", "")
    ).sweep()
    assert_allclose(
        [many["gap_lower"].values[1, 0, 1], many["gap_upper"].values[1, 0, 1]], gap, rtol=1e-9
    )


def test_the_table_has_a_row_for_each_state_and_gap(result):
    rows = list(
        csv.DictReader((result.folder / "sweep_gaps.csv").read_text(encoding="utf-8").splitlines())
    )
    data = result.dataset
    assert len(rows) == data["gap_lower"].size == 18
    row = rows[3]  # the second density
    assert (float(row["A.density (kg/m^3)"]), row["gap"]) == (4000.0, "1")
    assert float(row["gap_upper (Hz)"]) == data["gap_upper"].values[0, 0, 1, 1]
    waves = list(
        csv.DictReader(
            (result.folder / "sweep_surface.csv").read_text(encoding="utf-8").splitlines()
        )
    )
    # balls of equal masses have no wave of the edge, and no row
    assert len(waves) == np.isfinite(data["surface_frequency"]).sum() == 6
    again = gp.load_sweep(result.folder / "sweep.nc")
    assert again.identical(data)


def test_a_sweep_of_gaps_alone_shows_and_tells_nothing_of_sound(tmp_path, capsys):
    text = SCENE.replace("[velocities, gaps, surface]", "[gaps]").replace(
        "surface: {axis: 0}\n", ""
    )
    (tmp_path / "scene.yaml").write_text(text, encoding="utf-8")
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "scene.yaml"), "-o", str(out)]) == 0
    assert "velocity" not in capsys.readouterr().out
    assert {path.name for path in out.glob("*.png")} == {"sweep_gaps.png"}
    # what is asked for by name is drawn nevertheless
    assert redraw(out, tmp_path / "sweep.png").name == "sweep.png"


@pytest.mark.slow
def test_a_report_of_gaps_alone_tells_nothing_of_sound(tmp_path):
    text = SCENE.replace("[velocities, gaps, surface]", "[gaps]")
    out = tmp_path / "out"
    Scene.from_text(text.replace("surface: {axis: 0}\n", "")).run(out)
    assert main(["report", str(out)]) == 0
    assert "longitudinal" not in (out / "report.md").read_text(encoding="utf-8")
    assert redraw(out, force=True).name == "sweep_gaps.png"


def test_a_sweep_of_one_value_tells_what_one_state_tells(tmp_path):
    text = SCENE.replace("[1 N, 8 N, 27 N]", "1 N").replace("surface: {axis: 0}\n", "")
    text = text.replace("[velocities, gaps, surface]", "[gaps, sensitivities]")
    swept = text.replace("[2000 kg/m^3, 4000 kg/m^3, 8000 kg/m^3]", "[2700 kg/m^3]")
    alone = text[: text.index("sweep")]
    of_sweep = Scene.from_text(swept).run(tmp_path / "swept", figures=False).summary()
    of_state = Scene.from_text(alone).run(tmp_path / "alone", figures=False).summary()
    assert len(of_state["gaps"]) == 1
    for name in ("gaps", "matters_most"):
        assert of_sweep[name] == of_state[name]


def test_the_figure_has_the_gaps_as_fields_over_the_load(result):
    figure = sweep_gaps_figure(result.dataset)
    panels = [ax for ax in figure.axes if ax.lines]
    assert len(panels) == 3
    force = result.dataset["force"].values
    for number, ax in enumerate(panels):
        fields = [artist for artist in ax.collections if artist.get_gid() == "gap-1"]
        assert len(fields) == (number < 2)
        (top,) = [line for line in ax.lines if line.get_gid() == "top"]
        kilohertz = result.dataset["top_frequency"].values[:, 0, number] / 1e3
        assert_allclose(top.get_xydata(), np.transpose([force, kilohertz]))
        for field in fields:
            corners = field.get_paths()[0].vertices
            lower = result.dataset["gap_lower"].values[:, 0, number, 1] / 1e3
            assert_allclose(corners[:, 1].min(), lower.min())
            for x, y in zip(force, lower, strict=True):
                assert np.any(np.all(np.isclose(corners, [x, y]), axis=1))
        assert ax.get_ylim() == panels[0].get_ylim()
    assert ["2000" in panels[0].get_title(), "8000" in panels[2].get_title()] == [True, True]


def test_at_one_load_the_figure_is_over_the_parameter(result):
    alone = result.dataset.isel(load=[1])
    (ax,) = sweep_gaps_figure(alone).axes
    (top,) = [line for line in ax.lines if line.get_gid() == "top"]
    assert_allclose(top.get_xdata(), DENSITIES)
    # a gap that one value has alone is a bar
    (ax,) = sweep_gaps_figure(alone.isel({"A.density": [1, 2]})).axes
    (bar,) = [artist for artist in ax.collections if hasattr(artist, "get_segments")]
    (segment,) = bar.get_segments()
    assert_allclose(segment[:, 0], 4000.0)
    # its ends are drawn, or a narrow one would not be seen; those of a field are lines
    edges = [line for line in ax.lines if line.get_gid() == "gap-1-edge"]
    ends = [line.get_xydata()[line.get_markevery()][0] for line in edges]
    assert_allclose(ends, segment)


def test_a_single_state_is_drawn_over_the_numbers_of_gaps_branches_and_modes(result, found):
    single = result.dataset.isel({"load": [1], "A.density": [1]})
    (ax,) = sweep_gaps_figure(single).axes
    assert "ranches below" in ax.get_xlabel()
    (top,) = [line for line in ax.lines if line.get_gid() == "top"]
    assert_allclose(top.get_xdata(), ax.get_xlim())
    (bar,) = [artist for artist in ax.collections if hasattr(artist, "get_segments")]
    (segment,) = bar.get_segments()
    edges = [single[f"gap_{side}"].values.ravel()[1] for side in ("lower", "upper")]
    assert_allclose(segment, [[1.0, edge / 1e3] for edge in edges])
    one = found.isel({"load": [0], "A.density": [0]})
    (ax,) = cutoffs_figure(one).axes
    bars = [artist for artist in ax.collections if hasattr(artist, "get_segments")]
    upper = one["cutoff_upper"].values.ravel() / 1e3
    ends = [bar.get_segments()[0][1] for bar in bars]
    assert_allclose(ends, np.transpose([np.arange(upper.size), upper]))
    # modes are counted from 1, as in their table
    (ax,) = modes_figure(one).axes
    points = np.concatenate([line.get_xydata() for line in ax.lines if line.get_gid()])
    assert_allclose(points[:, 0], one["mode"].values)
    assert_allclose(points[:, 1], one["mode_frequency"].values.ravel() / 1e3)


def test_waves_of_an_edge_are_drawn_over_the_load(result):
    figure = sweep_surface_figure(result.dataset)
    waves = result.dataset["surface_frequency"]
    for number, ax in enumerate(figure.axes):
        drawn = [line.get_ydata() for line in ax.lines if line.get_gid().startswith("wave")]
        expected = waves.values[:, 0, number, -1].T / 1e3
        assert_allclose(drawn, expected)
        is_without = not np.any(np.isfinite(expected))
        assert [text.get_text() for text in ax.texts] == ["no wave"] * is_without


def test_the_command_draws_the_gaps_again(result, tmp_path, capsys):
    words = ["plot", str(result.folder), "--where", "force=8 N"]
    assert main([*words, "-o", str(tmp_path / "sweep_gaps.svg")]) == 0
    text = (tmp_path / "sweep_gaps.svg").read_text(encoding="utf-8")
    assert "top frequency" in text
    assert 'id="gap-1"' in text


@pytest.mark.slow
def test_the_command_draws_the_waves_of_an_edge_again(result, tmp_path, capsys):
    assert main(["plot", str(result.folder), "-o", str(tmp_path / "sweep_surface.png")]) == 0


def test_gaps_of_a_simulation_are_those_of_the_mean_lattice(tmp_path):
    text = """\
material: {young_modulus: 70 GPa, poisson_ratio: 0.22, density: 2500 kg/m^3}
packing: {lattice: triangular, diameter: 1 mm, spread: {uniform: 0.1 um}}
load: {force: [5 N, 6 N]}
medium: [ala, {simulation: {shape: 3 3, geometry: lattice}}]
observe: [gaps]
"""
    data = Scene.from_text(text).sweep()
    assert any("samples" in sentence for sentence in json.loads(data.attrs["warnings"]))
    top = data["top_frequency"].values
    assert_allclose(top[:, 1], top[:, 0], rtol=1e-2)
    assert data["gap_lower"].shape == (2, 2, 3)


CUTOFFS = SCENE.replace("gaps, surface]", "cutoffs, modes]").replace(
    "surface: {axis: 0}", "modes: {count: 3, repeat: 2}"
)


@pytest.fixture(scope="module")
def found():
    return Scene.from_text(CUTOFFS).sweep()


@pytest.mark.claim("cutoffs")
def test_cutoffs_over_loads_and_parameters_are_those_of_the_chain_of_two_masses(found):
    """Of the acoustic branch 0 and (2 k/M)^1/2, of the optical one (2 k/m)^1/2 and
    (2 k (1/m + 1/M))^1/2, over 2 pi.
    """
    light = MASS_PER_DENSITY * DENSITIES
    heavy = MASS_PER_DENSITY * 8000.0
    stiffness = found["normal_stiffness"].values[:, 0]  # (loads, densities)
    of_masses = [0.0 * light, 1.0 / heavy + 0.0 * light, 1.0 / light, 1.0 / light + 1.0 / heavy]
    edges = [np.sqrt(2.0 * stiffness * inverse) / (2.0 * np.pi) for inverse in of_masses]
    lower = found["cutoff_lower"].values[:, 0]  # (loads, densities, branches)
    upper = found["cutoff_upper"].values[:, 0]
    top = edges[3].max()
    assert_allclose(lower[..., 0], edges[0], atol=1e-9 * top)
    assert_allclose(upper[..., 0], edges[1], rtol=1e-9)
    assert_allclose(lower[..., 1], edges[2], rtol=1e-9)
    assert_allclose(upper[..., 1], edges[3], rtol=1e-9)
    assert found["cutoff_upper"].attrs["units"] == "Hz"


def test_lowest_modes_are_those_of_the_network_of_each_state(found):
    # two cells: q = 0 and the end of the zone, where each kind of balls moves alone
    lower, upper = found["cutoff_upper"][..., 0], found["cutoff_lower"][..., 1]
    top = found["cutoff_upper"][..., 1]
    expected = np.stack([lower.values, upper.values, top.values], axis=-1)
    assert_allclose(found["mode_frequency"].values, expected, rtol=1e-9)
    assert np.all(found["mode_rotation"].values == 0.0)
    assert_allclose(found["mode_participation"].values[..., :2], 0.5, rtol=1e-9)
    one = Scene.from_text(CUTOFFS.replace("sweep:", "# ").replace("[1 N, 8 N, 27 N]", "8 N"))
    modes = gp.Waves(one.state().network.repeat((2,))).modes(3)
    assert_allclose(one.sweep()["mode_frequency"].values.ravel(), modes.frequencies, rtol=1e-12)


def test_one_state_has_its_cutoffs_and_modes_as_tables(tmp_path):
    text = CUTOFFS.replace("sweep:", "# ").replace("[1 N, 8 N, 27 N]", "8 N")
    result = Scene.from_text(text).run(tmp_path / "out")
    assert {"cutoffs.csv", "modes.csv"} <= {path.name for path in result.files}
    rows = (tmp_path / "out" / "modes.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 4
    assert rows[0].startswith("force (N),medium,mode,mode_frequency (Hz)")
    assert Scene.from_text(result.scene.to_yaml()) == result.scene


def test_modes_of_an_array_have_errors_over_its_samples():
    text = """\
material: {young_modulus: 70 GPa, poisson_ratio: 0.22, density: 2500 kg/m^3}
packing: {diameter: 1 mm, spread: {uniform: 0.1 um}}
load: {force: [5 N, 6 N]}
medium: {simulation: {shape: 3 3, samples: 2}}
observe: [modes]
"""
    data = Scene.from_text(text).sweep()
    assert data["mode_frequency"].shape == data["mode_frequency_error"].shape == (2, 1, 6)
    assert np.all(data["mode_frequency_error"] > 0.0)


def test_branches_are_fields_and_modes_lines_over_the_load(found):
    for number, ax in enumerate(cutoffs_figure(found).axes):
        fields = [artist for artist in ax.collections if artist.get_gid() == "branch-1"]
        (field,) = fields
        upper = found["cutoff_upper"].values[:, 0, number, 1] / 1e3
        assert_allclose(field.get_paths()[0].vertices[:, 1].max(), upper.max())
    for number, ax in enumerate(modes_figure(found).axes):
        drawn = [line.get_ydata() for line in ax.lines if line.get_gid().startswith("wave")]
        assert_allclose(drawn, found["mode_frequency"].values[:, 0, number].T / 1e3)


def test_a_sweep_in_python_has_gaps_and_cutoffs(found, tmp_path):
    scene = Scene.from_text(CUTOFFS)
    words = {"force": [1.0, 8.0, 27.0], "path": tmp_path / "sweep.nc"}
    plain = gp.sweep(scene.packing, **words)
    assert "gap_lower" not in plain
    data = gp.sweep(scene.packing, gaps=True, cutoffs=True, overwrite=True, **words)
    density = {"A.density": np.argmin(np.abs(DENSITIES - 2000.0))}
    first = found.isel(density)
    ratio = np.sqrt(2700.0 / 2000.0)  # the scene's own density of A
    assert_allclose(data["cutoff_upper"][..., 0], first["cutoff_upper"][..., 0], rtol=1e-9)
    assert_allclose(data["cutoff_lower"][..., 1] * ratio, first["cutoff_lower"][..., 1], rtol=1e-9)
    assert_allclose(data["gap_lower"][..., 1], data["cutoff_upper"][..., 0], rtol=1e-9)
    # a sweep that observes less is another one
    assert "gap_lower" not in gp.sweep(scene.packing, overwrite=True, **words)
    again = gp.sweep(scene.packing, gaps=True, resume=True, overwrite=True, **words)
    assert "gap_lower" in again


def test_the_legend_names_gaps_only_where_there_are_some(result):
    def labels(data):
        (legend,) = sweep_gaps_figure(data).legends
        return [text.get_text() for text in legend.get_texts()]

    assert labels(result.dataset) == ["gap", "top frequency"]
    assert labels(result.dataset.isel({"A.density": [2]})) == ["top frequency"]


def test_a_sweep_without_gaps_says_so(result):
    data = result.dataset.drop_vars(["gap_lower", "surface_frequency"])
    with pytest.raises(InputError, match=r"no gaps.*Observe gaps"):
        sweep_gaps_figure(data)
    with pytest.raises(InputError, match="of an edge"):
        sweep_surface_figure(data)
