"""Figures of fits: the plotted data are read back."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.figures.curves import fit_figure, plot_fit
from granphon.fits.fit import fit_width
from granphon.media.medium import EffectiveMedium
from granphon.observables.velocities import pulse_velocities, sound_velocities
from tests.figures.conftest import drawn, texts

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
PACKING = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))


@pytest.fixture(scope="module")
def fit():
    force = np.geomspace(2.0, 18.446, 8)
    exact = sound_velocities(EffectiveMedium(PACKING).at_force(force)).longitudinal
    return fit_width(PACKING, force, exact + np.random.default_rng(4).normal(size=8) * 5.0)


def test_a_fit_is_drawn_with_data_ideal_lattice_and_residuals(fit, ax):
    below = Figure().subplots()
    assert plot_fit(fit, ax, below) == (ax, below)
    (curve,), (ideal,) = drawn(ax, "fit"), drawn(ax, "ideal")
    assert_allclose(curve[:, 1], fit.velocity_at(curve[:, 0]), rtol=1e-14)
    assert_allclose(
        np.diff(np.log(ideal[:, 1])) / np.diff(np.log(ideal[:, 0])), 1.0 / 6.0, rtol=1e-9
    )
    assert (curve[:, 1] < ideal[:, 1]).all()
    assert_array_equal([curve[0, 0], curve[-1, 0]], [fit.force[0], fit.force[-1]])
    points, bars = (below.containers[0][i] for i in (0, 2))
    assert_allclose(points.get_xydata(), np.column_stack([fit.force, fit.residuals / fit.sigma]))
    assert_allclose([np.ptp(segment[:, 1]) for segment in bars[0].get_segments()], 2.0, rtol=1e-12)
    data = ax.containers[0]
    assert_array_equal(data[0].get_xydata(), np.column_stack([fit.force, fit.velocity]))
    assert_allclose(
        [np.ptp(s[:, 1]) for s in data[2][0].get_segments()], 2.0 * fit.sigma, rtol=1e-9
    )
    assert (ax.get_ylabel(), below.get_ylabel()) == ("Longitudinal velocity (m/s)", "Residual / σ")
    assert below.get_xlabel() == "Contact force (N)"


def test_the_figure_of_a_fit_names_width_and_error(fit):
    figure = fit_figure(fit)
    upper, lower = figure.axes
    data, fitted, equal = texts(upper.get_legend())
    assert (data, equal) == ("data", "equal balls")
    assert (
        fitted == f"effective\u00a0medium:\nW = {fit.width * 1e6:.3f} ± {fit.stderr * 1e6:.3f} µm"
    )
    assert upper.get_xlim() == lower.get_xlim()


def test_pulses_of_many_frequencies_are_drawn_at_the_data():
    force = np.array([2.0, 6.0, 18.0])
    hertz = np.array([2e3, 3e3, 4e3])
    group = pulse_velocities(EffectiveMedium(PACKING).at_force(force), hertz, (0.0, 1.0)).group[0]
    fit = fit_width(PACKING, force, group, 1.0, hertz)
    upper, _ = fit_figure(fit).axes
    (marks,) = drawn(upper, "fit")
    assert_array_equal(marks, np.column_stack([force, fit.velocities]))
    assert drawn(upper, "ideal") == []
    assert upper.get_ylabel() == "Group velocity (m/s)"


def test_exact_data_have_a_figure_too(tmp_path):
    force = np.array([2.0, 6.0, 18.0])
    exact = sound_velocities(EffectiveMedium(PACKING).at_force(force)).longitudinal
    figure = fit_figure(fit_width(PACKING, force, exact))
    figure.savefig(tmp_path / "fit.png")
    # its error is not known
    assert texts(figure.axes[0].get_legend())[1] == "effective\u00a0medium:\nW = 2.04 µm"
