"""The examples run, with the numbers they assert, and draw what they say."""

from __future__ import annotations

import ast
import itertools
import runpy
import sys
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.testing import assert_allclose
from PIL import Image

from granphon.tradeoffs.measure import Stopwatch

EXAMPLES = Path(__file__).parent.parent / "examples"
SCRIPTS = sorted(path.stem for path in EXAMPLES.glob("*.py"))
#: of those that do not write a picture that stands still
SUFFIX = {"rolling_wave": ".gif", "wave_crossing": ".gif"}
#: what takes more than half a second of processor; the documentation runs these too
LONG = {
    "modes_K_M",
    "paper_figure5",
    "rolling_modes",
    "cluster",
    "coherent_speckle",
    "column",
    "conjecture",
    "defect_mode",
    "diatomic_chain",
    "disorder_in_space",
    "dos",
    "fcc_and_hcp",
    "fit_width",
    "force_chains",
    "friction",
    "granular_chain",
    "hexagon_pulse",
    "hysteresis",
    "impact_on_hexagon",
    "iso_frequency",
    "ladder",
    "losses",
    "magnetic_chain",
    "membrane",
    "paper_figures6_7_8",
    "paper_figures9_10_11",
    "poisson_ratio",
    "pressed_along_one_axis",
    "pressure_sweep",
    "random_packing",
    "rolling_wave",
    "second_harmonic",
    "several_runs",
    "slowness_fcc",
    "soft_modes",
    "solitary_wave",
    "sound_filter",
    "spectral_function",
    "steel_bands",
    "surface_waves_fcc",
    "time_of_flight",
    "transfer_function",
    "transmission",
    "true_directions",
    "wave_crossing",
    "work_precision",
    "zigzag_edge",
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Runs an example as the command line does with -o, once: its names, its figure and the file it
    has written.
    """

    @cache
    def once(name):
        folder = tmp_path_factory.mktemp(name)
        out = folder / f"figure{SUFFIX.get(name, '.png')}"
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", [f"{name}.py", "-o", str(out)])
            patch.chdir(folder)
            # budgets count looks at the stopwatch, not seconds of a machine that may be busy
            looks = itertools.count()
            patch.setattr(Stopwatch, "now", lambda stopwatch: 0.1 * next(looks))
            names = runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        figure = names["figure"]
        assert isinstance(figure, Figure)
        plt.close("all")
        return SimpleNamespace(names=names, figure=figure, out=out)

    return once


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.exhaustive] * (name in LONG)) for name in SCRIPTS],
)
def test_an_example_runs_and_writes_its_figure(run, name):
    figure, out = run(name).figure, run(name).out
    assert [path.name for path in out.parent.iterdir()] == [out.name]
    with Image.open(out) as image:
        assert image.format == out.suffix[1:].upper()
        assert_allclose(image.size, figure.get_size_inches() * figure.dpi, atol=1.0)
    tight = figure.get_tightbbox()
    (width, height) = figure.get_size_inches()
    assert min(tight.x0, tight.y0) >= 0.0
    assert tight.x1 <= width
    assert tight.y1 <= height
    assert min(text.get_fontsize() for text in figure.findobj(Text) if text.get_text()) >= 7.0


@pytest.mark.parametrize("name", SCRIPTS)
def test_an_example_is_a_page_of_the_gallery_and_asserts_a_number(name):
    tree = ast.parse((EXAMPLES / f"{name}.py").read_text(encoding="utf-8"))
    title, line, *text = (ast.get_docstring(tree) or "").splitlines()
    assert line == "=" * len(title)
    assert text
    assert any(isinstance(node, ast.Assert) for node in ast.walk(tree))


@pytest.mark.exhaustive
def test_the_wave_runs_to_the_right_and_comes_back_after_a_period(run):
    names = run("rolling_wave").names
    with Image.open(run("rolling_wave").out) as image:
        assert image.n_frames == 16
    for e in names["mixed"].values():
        now = names["motion"](e, 0.0)
        later = names["motion"](e, 2.0 * np.pi)
        assert_allclose(later[0], now[0], atol=1e-12)
        assert_allclose(later[1], now[1], atol=1e-12)
        # four balls to a wave: after a quarter of a period each ball of a row moves as the one to
        # the left of it did
        quarter = names["motion"](e, 0.5 * np.pi)
        row = np.flatnonzero(names["sites"][:, 1] == 0.0)
        assert np.all(np.diff(names["sites"][row, 0]) == 1.0)
        assert_allclose(quarter[0][row[1:]], now[0][row[:-1]], atol=1e-12)
        assert np.ptp(now[1]) > 0.1


def test_figure_2_is_in_the_units_of_the_paper(run):
    first, second = run("paper_figure2").figure.axes[:2]
    for ax, top in (
        (first, np.sqrt(30.0 * 2.0 * (1.0 - 0.276) / (2.0 - 0.276))),
        (second, np.sqrt(6.0)),
    ):
        y = np.concatenate([c.get_segments() for c in ax.collections])[..., 1]
        assert y.max() == pytest.approx(top, rel=1e-9)
        left, right = ax.get_xlim()
        assert right - left == pytest.approx(2.0 / 3.0 + 1.0 / np.sqrt(3.0), rel=1e-12)
        assert [t.get_text() for t in ax.get_xticklabels()] == [
            "0.6",
            "0.4",
            "0.2",
            "0.0",
            "0.2",
            "0.4",
        ]
        assert ax.get_xticks()[3] == pytest.approx(2.0 / 3.0)


def test_the_pulse_figure_starts_at_the_velocities_of_long_waves(run):
    (ax,) = run("pulse_dispersion").figure.axes
    lines = {line.get_label(): line.get_data() for line in ax.lines}
    for kind in ("phase", "group"):
        assert lines[f"longitudinal, {kind}"][1][0] == pytest.approx(790.96, rel=1e-4)
        assert lines[f"transverse, {kind}"][1][0] == pytest.approx(547.51, rel=1e-4)
    assert np.all(lines["longitudinal, group"][1] <= lines["longitudinal, phase"][1])


@pytest.mark.exhaustive
@pytest.mark.claim("cluster-second-order")
def test_the_cluster_is_exact_at_high_load(run):
    """f* = y^(3/2) (1 + r/(64 y^2)), r = 0.608998; the next order is the fourth, of 1/(64 y^2)^2."""
    names = run("cluster").names
    y = np.array([8.0, 4.0])
    order = (names["descend"](y) / y**1.5 - 1.0) * 64.0 * y**2
    assert_allclose(order, 0.608998, rtol=2e-3)


@pytest.mark.exhaustive
def test_the_clusters_have_the_moments_of_the_array(run):
    names = run("cluster").names
    misfits, pushes = (names[which] for which in ("misfits", "pushes"))
    assert_allclose(misfits.mean(axis=0), 0.0, atol=1e-15)
    assert_allclose(misfits.T @ pushes / len(misfits), 0.0, atol=1e-15)
    assert_allclose(24.0 * np.mean(misfits[:, names["central"]] ** 2), 0.608998, rtol=1e-3)
    # P is a projection, and the ball in the middle moves in both directions without the lattice
    values = np.linalg.eigvalsh(names["response"])
    assert_allclose(values[-2:], 1.0, atol=1e-12)
    assert values[0] > -1e-12


@pytest.mark.exhaustive
def test_the_points_of_the_simulation_are_in_the_figures_of_the_paper(run):
    six, seven, eight = run("paper_figures6_7_8").figure.axes
    points = [ax.containers[0][0].get_xydata() for ax in (six, seven, eight)]
    assert_allclose(points[1][:, 0], points[0][:, 0] + 0.343, rtol=1e-12)
    assert_allclose(points[1][:, 1] ** 1.5, points[0][:, 1], rtol=1e-12)
    assert_allclose(points[2][:, 0], points[0][:, 1], rtol=1e-12)
    # the last is at a force where the array is nearly ideal: f* = (a* - 1/2)^(3/2), k* = (3/2) (a*
    # - 1/2)^(1/2)
    y = points[0][-1, 0] - 0.157
    assert points[0][-1, 1] == pytest.approx(y**1.5, rel=1e-3)
    assert points[2][-1, 1] == pytest.approx(np.sqrt(1.5 * np.sqrt(y)), rel=1e-3)
    for ax in (six, seven, eight):
        bars = np.concatenate(
            [np.ptp(np.array(c.get_segments())[..., 1], axis=1) for c in ax.containers[0][2][-1:]]
        )
        assert np.all(bars > 0.0)
