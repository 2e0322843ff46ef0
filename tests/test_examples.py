"""The examples run, with the numbers they assert, and draw what they say."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.testing import assert_allclose

EXAMPLES = Path(__file__).parent.parent / "examples"
SCRIPTS = (
    "conjecture", "fit_width", "force_chains", "modes_K_M", "paper_figure2", "paper_figure5", "paper_figures6_7_8",
    "paper_figures9_10_11", "pulse_dispersion", "steel_bands",
)  # fmt: skip


def figure_of(name: str, out: Path | None = None) -> Figure:
    spec = importlib.util.spec_from_file_location(f"example_{name}", EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    figure = module.main(out)
    assert isinstance(figure, Figure)
    return figure


@pytest.mark.parametrize("name", SCRIPTS)
def test_an_example_runs_and_writes_its_figure(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "figure.png"
    figure = figure_of(name, out)
    assert out.read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in tmp_path.iterdir()] == ["figure.png"]
    tight, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    assert min(tight.x0, tight.y0) >= 0.0
    assert tight.x1 <= width
    assert tight.y1 <= height
    assert min(text.get_fontsize() for text in figure.findobj(Text) if text.get_text()) >= 7.0


def test_figure_2_is_in_the_units_of_the_paper():
    above, below = figure_of("paper_figure2").axes[:2]
    for ax, top in ((above, np.sqrt(30.0 * 2.0 * (1.0 - 0.276) / (2.0 - 0.276))), (below, np.sqrt(6.0))):
        y = np.concatenate([c.get_segments() for c in ax.collections])[..., 1]
        assert y.max() == pytest.approx(top, rel=1e-9)
        left, right = ax.get_xlim()
        assert right - left == pytest.approx(2.0 / 3.0 + 1.0 / np.sqrt(3.0), rel=1e-12)
        assert [t.get_text() for t in ax.get_xticklabels()] == ["0.6", "0.4", "0.2", "0.0", "0.2", "0.4"]
        assert ax.get_xticks()[3] == pytest.approx(2.0 / 3.0)


def test_the_pulse_figure_starts_at_the_velocities_of_long_waves():
    (ax,) = figure_of("pulse_dispersion").axes
    lines = {line.get_label(): line.get_data() for line in ax.lines}
    for kind in ("phase", "group"):
        assert lines[f"longitudinal, {kind}"][1][0] == pytest.approx(790.96, rel=1e-4)
        assert lines[f"transverse, {kind}"][1][0] == pytest.approx(547.51, rel=1e-4)
    assert np.all(lines["longitudinal, group"][1] <= lines["longitudinal, phase"][1])


def test_the_points_of_the_simulation_are_in_the_figures_of_the_paper():
    six, seven, eight = figure_of("paper_figures6_7_8").axes
    points = [ax.containers[0][0].get_xydata() for ax in (six, seven, eight)]
    assert_allclose(points[1][:, 0], points[0][:, 0] + 0.343, rtol=1e-12)
    assert_allclose(points[1][:, 1] ** 1.5, points[0][:, 1], rtol=1e-12)
    assert_allclose(points[2][:, 0], points[0][:, 1], rtol=1e-12)
    # the last is at a force where the array is nearly ideal: f* = (a* - 1/2)^(3/2), k* = (3/2) (a* - 1/2)^(1/2)
    y = points[0][-1, 0] - 0.157
    assert points[0][-1, 1] == pytest.approx(y**1.5, rel=1e-3)
    assert points[2][-1, 1] == pytest.approx(np.sqrt(1.5 * np.sqrt(y)), rel=1e-3)
    for ax in (six, seven, eight):
        bars = np.concatenate([np.ptp(np.array(c.get_segments())[..., 1], axis=1) for c in ax.containers[0][2][-1:]])
        assert np.all(bars > 0.0)
