"""Bands of standard errors about curves: what is drawn is read back from the figure."""

from __future__ import annotations

from types import SimpleNamespace

from granphon.figures.scales import draw_error_band, make_error_handle, read_errors

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.figures.bands import bands_figure, plot_bands, plot_dos
from granphon.figures.curves import plot_sweep
from granphon.figures.gaps import cutoffs_figure
from granphon.figures.waves import plot_sample_dos, responses_figure, spectrum_figure
from tests.figures.conftest import read_edges

STEEL = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
FORCE = np.array([2.0, 8.0, 32.0])


def find(ax, gid):
    """The one collection of an Axes with a group id."""
    (drawn,) = [part for part in ax.collections if part.get_gid() == gid]
    return drawn


def test_a_band_reaches_from_curve_minus_error_to_curve_plus_error():
    ax = Figure().subplots()
    x, y = np.arange(3.0), np.array([1.0, 2.0, 4.0])
    draw_error_band(ax, x, y, np.array([0.1, np.nan, 0.5]), "k", "errors")
    assert_allclose(read_edges(find(ax, "errors")), [[0.9, 1.1], [2.0, 2.0], [3.5, 4.5]])


def test_without_an_error_nothing_is_drawn_and_a_single_point_has_a_bar():
    ax = Figure().subplots()
    draw_error_band(ax, FORCE, FORCE, np.array([0.0, np.nan, 0.0]), "k", "none")
    assert not ax.collections
    draw_error_band(ax, FORCE[:1], FORCE[:1], FORCE[:1] / 4.0, "k", "bar")
    bar = find(ax, "bar")
    assert isinstance(bar, LineCollection)
    assert_allclose(bar.get_segments()[0][:, 1], [1.5, 2.5])


def test_lines_of_a_sweep_have_bands_of_the_errors_of_the_data_set():
    data = gp.sweep(STEEL, force=FORCE)
    dims = data["longitudinal"].dims
    data["longitudinal_error"] = dims, 0.02 * data["longitudinal"].values
    ax = plot_sweep(data, Figure().subplots())
    velocities = data["longitudinal"].values[:, 0]
    edges = read_edges(find(ax, "longitudinal-errors"))
    assert_allclose(edges, np.outer(velocities, [0.98, 1.02]), rtol=1e-12)
    assert "standard error 2 %" in [text.get_text() for text in ax.get_legend().get_texts()]


def test_the_legend_tells_the_size_of_errors_and_has_no_mark_of_those_that_hide():
    small = make_error_handle([100.0, 200.0, 1e-4, 0.0], [0.1, 0.5, 1.0, 1.0])
    assert small.get_label() == "standard error 0.1 to 0.25 %"
    assert small.get_linestyle() == "None"
    large = make_error_handle([100.0, -200.0, np.nan], [1.0, np.nan, 1.0])
    assert large.get_label() == "standard error 1 %"
    assert large.get_linewidth() > 1.0
    assert make_error_handle().get_label() == "standard error"


def test_branches_have_bands_also_where_they_cross():
    bands = gp.Phonons(gp.AveragedLattice(STEEL).at_force(18.4)).bands(npoints=9)
    errors = np.arange(bands.frequencies.size, dtype=float).reshape(bands.frequencies.shape)
    ax = plot_bands(bands, Figure().subplots(), errors=errors)
    connected = np.take_along_axis(errors, bands.connection, 2)
    for s, b in np.ndindex(len(bands.distances), bands.n_branches):
        edges = read_edges(find(ax, f"errors-{s}-{b}"))
        assert_allclose(np.diff(edges)[:, 0], 2e-3 * connected[s, :, b], atol=1e-9)
    with pytest.raises(InputError, match="errors have the shape"):
        plot_bands(bands, Figure().subplots(), errors=errors[..., :1])
    legend = bands_figure(bands, errors=errors).legends[0]
    assert any(text.get_text().startswith("standard error") for text in legend.get_texts())


def test_errors_of_another_shape_are_refused_by_every_figure():
    phonons = gp.Phonons(gp.AveragedLattice(STEEL).at_force(8.0))
    ax = Figure().subplots()
    dos = phonons.dos((4, 4))
    samples = gp.Waves(phonons.state.network.repeat((4, 4))).dos(3e3, vectors=2)
    for draw in (
        lambda errors: plot_dos(dos, ax, errors={"total": errors}),
        lambda errors: plot_sample_dos(samples, ax, errors={"total": errors}),
    ):
        with pytest.raises(InputError, match=r"shape \(3,\)"):
            draw(np.ones(3))
    with pytest.raises(InputError, match=r"shape \(1,\)"):
        read_errors([1.0], (0,))  # one error of no wave
    assert read_errors([[1.0, 2.0]], (2, 1)).shape == (2, 1)


@pytest.mark.slow
def test_edges_of_branches_and_responses_have_bands(tmp_path):
    text = (
        "material: {young_modulus: 211.65 +- 2 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
        "packing: {diameter: 8 mm, lattice: chain}\n"
        "load: {force: [5 N, 10 N]}\nobserve: [cutoffs, response]\n"
        "response: {source: plane, receiver: plane, repeat: 8, distance: 32 mm, damping: 2 us,"
        " frequencies: {from: 1 kHz, to: 30 kHz, points: 30}}\n"
    )
    data = gp.Scene.from_text(text).run(tmp_path, figures=False).dataset
    (ax,) = cutoffs_figure(data).axes
    gids = [part.get_gid() for part in ax.collections]
    assert gids.count("branch-0-errors") == 1  # the lower edge is zero, without an error
    above, below = responses_figure(data).axes[:2]
    for panel in (above, below):
        assert [part.get_gid() for part in panel.collections].count("errors-0") == 2


def test_errors_of_spectra_that_are_no_array_are_refused():
    spectra = SimpleNamespace(spectra=[], distances=[])
    with pytest.raises(InputError, match="errors"):
        spectrum_figure(spectra, {"peak": [[1.0], [1.0, 2.0]]})
