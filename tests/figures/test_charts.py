"""Figures over load: the plotted data are read back, not the pixels."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.array.sample import STEP
from granphon.balls.lattices import TRIANGULAR
from granphon.base.errors import FigureError, InputError
from granphon.figures import scales
from granphon.figures.fits import fit_figure, plot_fit
from granphon.figures.forces import forces_figure, plot_force_distribution, plot_forces
from granphon.figures.sweeps import plot_exponent, plot_sweep, sweep_figure
from granphon.fits.fit import fit_width
from granphon.media.mean_field import EffectiveMedium
from granphon.observables.pulses import pulse_velocities
from granphon.observables.velocities import sound_velocities
from granphon.sweeps.sweep import sweep
from tests import packings

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
PACKING = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))
FORCE = np.geomspace(0.5, 50.0, 9)


@pytest.fixture(scope="module")
def media():
    return sweep(PACKING, force=FORCE[::-1], media=("ala", "afa", "ema"))


@pytest.fixture(scope="module")
def widths():
    return sweep(PACKING, pressure=np.geomspace(200.0, 9000.0, 5), media=("ala", "ema"), width=[1e-6, 4e-6])


@pytest.fixture(scope="module")
def fit():
    force = np.geomspace(2.0, 18.446, 8)
    exact = sound_velocities(EffectiveMedium(PACKING).at_force(force)).longitudinal
    return fit_width(PACKING, force, exact + np.random.default_rng(4).normal(size=8) * 5.0)


@pytest.fixture
def ax():
    return Figure(layout="constrained").subplots()


def drawn(ax, gid):
    return [np.array(line.get_xydata()) for line in ax.lines if line.get_gid() == gid]


def texts(legend):
    return [text.get_text() for text in legend.get_texts()]


# -- sweeps ---------------------------------------------------------------------------------------------------------


def test_lines_are_the_variable_in_order_of_the_load(media, ax):
    assert plot_sweep(media, ax, "normal_stiffness") is ax
    lines = drawn(ax, "normal_stiffness-all")
    assert len(lines) == 3
    for line, name in zip(lines, ("ala", "afa", "ema"), strict=True):
        assert_array_equal(line[:, 0], FORCE)
        assert_array_equal(line[:, 1], media["normal_stiffness"].sel(medium=name).values[::-1])
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Contact force (N)", "Normal stiffness (MN/m)")
    assert texts(ax.get_legend()) == ["averaged lattice", "averaged force", "effective medium", "outside its range"]


def test_solid_lines_end_where_the_medium_is_no_longer_valid(media, ax):
    plot_sweep(media, ax)
    for line, name in zip(drawn(ax, "longitudinal-valid"), ("ala", "afa", "ema"), strict=True):
        assert_array_equal(np.isfinite(line[:, 1]), media["valid"].sel(medium=name).values[::-1])
    dashed = [line for line in ax.lines if line.get_gid() == "longitudinal-all"]
    assert all(line.is_dashed() for line in dashed)
    solid = [line.get_linewidth() for line in ax.lines if line.get_gid() == "longitudinal-valid"]
    assert min(solid) > max(line.get_linewidth() for line in dashed)
    assert solid == sorted(solid, reverse=True)


def test_values_of_a_parameter_are_shades_of_the_medium(widths, ax):
    plot_sweep(widths, ax, x="pressure")
    lines = [line for line in ax.lines if line.get_gid() == "longitudinal-all"]
    expected = widths["longitudinal"].values  # (load, medium, width)
    for n, line in enumerate(lines):
        assert_array_equal(np.array(line.get_xydata())[:, 1], expected[:, n // 2, n % 2])
    brightness = [sum(to_rgb(line.get_color())) for line in lines]
    assert brightness[0] < brightness[1]
    assert brightness[2] < brightness[3]
    assert texts(ax.get_legend())[2:] == ["width 1 µm", "width 4 µm", "outside its range"]
    assert ax.get_xlabel() == "Pressure (N/m)"


def test_other_combinations_of_parameters_are_lines_too(ax):
    dataset = sweep(PACKING, force=FORCE, media=("ema",), width=[1e-6, 2e-6], friction=[True, False], density=[7840.0])
    plot_sweep(dataset, ax, "transverse")
    assert len(drawn(ax, "transverse-all")) == 4
    labels = ["width 1 µm, friction True", "width 1 µm, friction False", "width 2 µm, friction True"]
    assert texts(ax.get_legend())[:3] == labels
    many = sweep(PACKING, force=[3.0], media=("ema",), width=np.linspace(1e-6, 2e-6, 30).tolist())
    *named, last = texts(plot_sweep(many, Figure().subplots()).get_legend())
    assert len(named) == 8
    assert re.fullmatch(r"8 of [0-9]+ are named", last)


def test_samples_of_a_simulation_have_bars_of_their_standard_error(ax):
    data = sweep(PACKING, force=[2.0, 9.0, 4.0], media=("ema", {"simulation": {"shape": (8, 8), "samples": 3}}))
    plot_sweep(data, ax, "transverse")
    (container,) = ax.containers  # none of the effective medium, which has no error
    _, caps, (bars,) = container.lines
    assert caps == ()  # which would make squares of the points
    there = data.isel(medium=1).sortby("force")
    ends = np.array(bars.get_segments())[..., 1]
    assert_allclose(np.diff(ends, axis=1)[:, 0], 2.0 * there.transverse_error, rtol=1e-9)
    assert_allclose(np.mean(ends, axis=1), there.transverse, rtol=1e-12)
    line, points = (one for one in ax.lines if one.get_gid() == "transverse-all")
    assert_array_equal(points.get_xydata(), np.stack([there.force, there.transverse], axis=1))
    # points are not joined, and lines have no points
    assert (line.get_linestyle(), line.get_marker()) == ("--", "")
    assert {one.get_linestyle() for one in ax.lines if one.get_color() == points.get_color()} == {"None"}
    assert points.get_marker() == "o"
    assert [one.get_linestyle() for one in ax.get_legend().get_lines()][:2] == ["-", "None"]


@pytest.mark.parametrize("variable", ["transverse", "exponent", "contact_fraction"])
def test_one_sample_of_a_simulation_is_points_without_bars(ax, variable):
    data = sweep(PACKING, force=[2.0, 9.0, 4.0], media=("ema", {"simulation": {"shape": (8, 8)}}))
    plot_sweep(data, ax, variable)
    assert not ax.containers
    line, points = (one for one in ax.lines if one.get_gid() == f"{variable}-all")
    assert (line.get_linestyle(), line.get_marker()) == ("--", "")
    assert {one.get_linestyle() for one in ax.lines if one.get_color() == points.get_color()} == {"None"}
    there = data.isel(medium=1).sortby("force")
    assert_array_equal(points.get_xydata(), np.stack([there.force, there[variable]], axis=1))
    assert points.get_marker() == "o"
    assert [one.get_linestyle() for one in ax.get_legend().get_lines()][:2] == ["-", "None"]


LOADED = {"shape": (4, 4), "friction_history": True, "friction_coefficient": 0.5, "seed": 3, "samples": 2}


@pytest.mark.parametrize(
    "media", [("ema", {"simulation": {"shape": (8, 8), "samples": 3}}), ({"simulation": LOADED},)], ids=["two", "a long one"]
)
def test_long_labels_stand_below_each_other(media):
    data = sweep(PACKING, force=[2.0, 9.0], media=media)
    figure = sweep_figure(data)
    figure.draw_without_rendering()
    (legend,) = figure.legends
    box, width = legend.get_window_extent(), figure.bbox.width
    assert box.x0 >= 0.0
    assert box.x1 <= width


def test_an_axis_with_zeros_or_negative_values_is_linear(media, ax):
    plot_sweep(media, ax, "force_fluctuation", "overlap")
    assert ax.get_yscale() == "linear"
    assert ax.get_ylabel() == "Force fluctuation Δf/f"


@pytest.mark.parametrize(
    ("variable", "words"),
    [("velocity", "no variable 'velocity'"), ("regime", "not one number"), ("medium", "not one number")],
)
def test_what_cannot_be_drawn_is_named(media, ax, variable, words):
    with pytest.raises(InputError, match=words):
        plot_sweep(media, ax, variable)


@pytest.mark.parametrize("ratio", [1.01, 1.3, 1.9, 2.4, 3.9, 4.1, 6.0, 20.0, 300.0])
@pytest.mark.parametrize("least", [0.013, 0.92, 1.01, 2.4, 351.0, 880.0])
def test_an_axis_of_loads_or_velocities_has_four_labels_or_more_and_few_with_ticks_between(ax, least, ratio):
    ax.plot([1.0, 2.0], [least, ratio * least])
    scales.scale_axis(ax, "y", np.array([least, ratio * least]))
    ax.set_ylim(least, ratio * least)
    ticks = ax.get_yticks()
    assert 4 <= np.sum((ticks >= least) & (ticks <= ratio * least)) <= 9
    minor = ax.get_yticks(minor=True)
    assert np.sum((minor >= least) & (minor <= ratio * least)) >= len(ticks)
    assert {label.get_text() for label in ax.get_yticklabels(minor=True)} == {""}
    labels = [label.get_text() for label in ax.get_yticklabels()]
    assert_allclose([float(label) for label in labels], ticks, rtol=1e-5)


@pytest.mark.parametrize("apart", [2e-16, 1e-14, 1e-10])
def test_an_axis_of_values_that_differ_by_rounding_goes_a_twentieth_to_either_side(ax, apart):
    values = 0.1 * np.array([1.0, 1.0 + apart])
    ax.plot([1.0, 2.0], values)
    ax.margins(0.1)
    scales.scale_axis(ax, "y", values)
    scales.widen_axis(ax, "y", values)
    assert_allclose(ax.get_ylim(), [0.095, 0.105], rtol=1e-9)
    ax.figure.draw_without_rendering()
    assert ax.get_tightbbox().height < 1.1 * ax.figure.bbox.height


@pytest.mark.parametrize(
    ("values", "unit", "label", "size"),
    [
        ([2e8, 3e9], "Pa", "y (GPa)", 1e9), ([1e3, 3e9], "Pa", "y (GPa)", 1e9), ([-1e-6, 2e-6], "m", "y (µm)", 1e-6),
        ([1e-5, 2e-4], "N", "y (µN)", 1e-6), ([0.2, 20.0], "N", "y (N)", 1.0), ([2.0, 9e4], "N/m", "y (N/m)", 1.0),
        ([2.0, 9e7], "Hz", "y (Hz)", 1.0), ([0.0, 0.0], "m", "y (m)", 1.0), ([1e6, 2e6], "", "y", 1.0),
    ],
)  # fmt: skip
def test_a_unit_with_a_prefix_divides_what_is_written_at_the_ticks(ax, values, unit, label, size):
    ax.plot([1.0, 2.0], values)
    scales.scale_axis(ax, "y", np.array(values))
    scales.name_axis(ax, "y", np.array(values), "y", unit)
    assert ax.get_ylabel() == label
    assert_array_equal(ax.lines[0].get_ydata(), values)
    ax.figure.canvas.draw()
    written = [text.get_text().replace("\N{MINUS SIGN}", "-") for text in ax.get_yticklabels()]
    powers = [re.fullmatch(r"\$\\mathdefault\{10\^\{([-\d]+)\}\}\$", one) for one in written]
    found = [10.0 ** int(power[1]) if power else float(one) for power, one in zip(powers, written, strict=True)]
    if size != 1.0:
        assert_allclose(np.array(found) * size, ax.get_yticks(), rtol=1e-9, atol=1e-15)
        assert max(map(len, written)) < 6 or all(powers)


@pytest.mark.parametrize("values", [[1.0, 1e300], [1e-300, 1.0]])
def test_an_axis_that_would_reach_beyond_floating_point_is_refused(ax, values):
    with pytest.raises(InputError, match=r"the x axis cannot reach from .* to .* Look at the units"):
        scales.scale_axis(ax, "x", np.array(values))


def test_the_exponent_is_that_of_the_longitudinal_velocity(ax):
    force = 4.0 * np.exp(STEP * np.array([-1.0, 0.0, 1.0]))
    data = sweep(PACKING, force=force, media=("ema", {"simulation": {"shape": (16, 16), "samples": 2}}))
    plot_exponent(data, ax)
    assert ax.get_ylabel() == "d log $v_L$ / d log $P$"
    longitudinal, transverse = (
        np.log(data[name][2] / data[name][0]).values / np.log(data.pressure[2] / data.pressure[0]).values
        for name in ("longitudinal", "transverse")
    )
    assert_allclose([line[1, 1] for line in drawn(ax, "exponent-all")], longitudinal, rtol=2e-3)
    # of a simulation the other one is not the same
    assert abs(transverse[0] - longitudinal[0]) < 1e-12
    assert transverse[1] - longitudinal[1] > 0.01
    # bars of the standard errors, of the simulation alone
    (bars,) = ax.containers
    low, high = np.array(bars.lines[2][0].get_segments())[..., 1].T
    assert_allclose(high - low, 2.0 * data.exponent_error.isel(medium=1), rtol=1e-6)
    assert np.all(high > low)


def test_what_is_infinite_everywhere_is_refused(ax):
    equal = sweep(gp.Packing(STEEL, 8e-3), force=FORCE)
    with pytest.raises(InputError, match="has no finite value"):
        plot_sweep(equal, ax, "reduced_force")


def test_what_matplotlib_cannot_draw_is_refused(ax):
    far = sweep(gp.Packing(STEEL, 8e-3), force=FORCE)
    far["pressure"] = far["pressure"] * 1e302
    with pytest.raises(FigureError, match=r"'pressure' has the value .*e\+30"):
        plot_sweep(far, ax, "pressure")


def test_the_figure_has_velocities_above_and_exponents_below(media):
    figure = sweep_figure(media)
    upper, lower = figure.axes
    assert len(drawn(upper, "longitudinal-all")) == len(drawn(upper, "transverse-all")) == 3
    for line, name in zip(drawn(lower, "exponent-all"), ("ala", "afa", "ema"), strict=True):
        assert_array_equal(line[:, 1], media["exponent"].sel(medium=name).values[::-1])
    assert lower.get_yscale() == "linear"
    assert upper.get_xlim() == lower.get_xlim()
    assert {text.get_text() for text in lower.texts} == {"1/6", "1/4"}
    assert all(text.xy[0] == 1.0 for text in lower.texts)  # beside the panel, where no point lies
    assert {text.get_text() for text in upper.texts} == {"$v_L$", "$v_T$"}
    assert len(texts(figure.legends[0])) == 4
    assert figure.get_size_inches()[0] == 3.4


def test_the_figure_of_one_variable_and_of_a_sweep_without_exponents(widths):
    (only,) = sweep_figure(widths, variable="contact_fraction").axes
    assert only.get_ylabel() == "Fraction of contacts"
    one = sweep(PACKING, force=3.0, media=("ema",), finite_overlap=True, width=[1e-6, 2e-6])
    figure = sweep_figure(one)
    (velocities,) = figure.axes
    assert {line.get_marker() for line in velocities.lines} == {"o"}
    assert figure.legends[0].get_title().get_text() == "effective medium"


@pytest.mark.parametrize(
    ("load", "label"),
    [({"force": [2.0, 9.0]}, "(N)"), ({"pressure": [1e5, 1e6]}, "(MPa)"), ({"overlap": [2e-6, 4e-6]}, "(µm)")],
)
def test_the_axis_of_a_sweep_is_the_load_that_was_given(load, label):
    data = sweep(gp.Packing(STEEL, 8e-3, lattice="fcc"), **load)
    ((kind, values),) = load.items()
    figure = sweep_figure(data)
    for ax in figure.axes:
        assert_array_equal(ax.lines[0].get_xdata(), values)
    assert figure.axes[-1].get_xlabel().endswith(label)
    assert kind in figure.axes[-1].get_xlabel().lower()
    assert_array_equal(sweep_figure(data, "normal_stiffness").axes[0].lines[0].get_xdata(), data.normal_stiffness[:, 0])
    assert_array_equal(plot_exponent(data, Figure().subplots()).lines[0].get_xdata(), values)


def test_names_of_a_path_stand_beside_the_right_ends_of_its_lines():
    history = {"shape": (4, 4), "friction_history": True, "friction_coefficient": 0.2, "ordered": True}
    data = sweep(PACKING, force=[2.0, 40.0, 5.0], media=[{"simulation": history}])
    upper, _ = sweep_figure(data).axes
    heights = {text.get_text(): text.xy[1] for text in upper.texts}
    greatest = data.isel(load=int(np.argmax(data["force"].values)), medium=0)
    assert heights == {"$v_L$": float(greatest["longitudinal"]), "$v_T$": float(greatest["transverse"])}


def test_slow_and_fast_transverse_waves_are_told_apart():
    packing = gp.Packing(STEEL, 8e-3, lattice="hcp")
    both = sweep(packing, force=[20.0, 40.0], media=("ala", {"simulation": {"shape": (2, 2, 2)}}), direction=(1, 0, 0.5))
    for media in ([0], [1], [0, 1]):
        figure = sweep_figure(both.isel(medium=media))
        lines = figure.axes[0].lines
        looks = [
            {(str(line._unscaled_dash_pattern), line.get_marker()) for line in lines if line.get_gid() == name}
            for name in ("transverse_slow-valid", "transverse_fast-valid")
        ]
        assert len(looks[0]) == len(looks[1]) == len(media)
        assert looks[0].isdisjoint(looks[1])
        assert {"$v_{T1}$", "$v_{T2}$"} <= set(texts(figure.legends[0]))
    assert not any("T1" in text for text in texts(sweep_figure(sweep(PACKING, force=[20.0, 40.0])).legends[0]))


# -- fits -----------------------------------------------------------------------------------------------------------


def test_a_fit_whose_error_is_not_known_is_drawn_without_one():
    unknown = fit_width(PACKING, [4.0] * 3, [480.0] * 3)
    figure = fit_figure(unknown)
    assert f"effective\u00a0medium:\nW = {unknown.width * 1e6:.5g} µm" in [
        text.get_text() for text in figure.axes[0].get_legend().get_texts()
    ]


def test_a_fit_is_drawn_with_data_ideal_lattice_and_residuals(fit, ax):
    below = Figure().subplots()
    assert plot_fit(fit, ax, below) == (ax, below)
    (curve,), (ideal,) = drawn(ax, "fit"), drawn(ax, "ideal")
    assert_allclose(curve[:, 1], fit.velocity_at(curve[:, 0]), rtol=1e-14)
    assert_allclose(np.diff(np.log(ideal[:, 1])) / np.diff(np.log(ideal[:, 0])), 1.0 / 6.0, rtol=1e-9)
    assert (curve[:, 1] < ideal[:, 1]).all()
    assert_array_equal([curve[0, 0], curve[-1, 0]], [fit.force[0], fit.force[-1]])
    points, bars = (below.containers[0][i] for i in (0, 2))
    assert_allclose(points.get_xydata(), np.column_stack([fit.force, fit.residuals / fit.sigma]))
    assert_allclose([np.ptp(segment[:, 1]) for segment in bars[0].get_segments()], 2.0, rtol=1e-12)
    data = ax.containers[0]
    assert_array_equal(data[0].get_xydata(), np.column_stack([fit.force, fit.velocity]))
    assert_allclose([np.ptp(s[:, 1]) for s in data[2][0].get_segments()], 2.0 * fit.sigma, rtol=1e-9)
    assert (ax.get_ylabel(), below.get_ylabel()) == ("Longitudinal velocity (m/s)", "Residual / σ")
    assert below.get_xlabel() == "Contact force (N)"


def test_the_figure_of_a_fit_names_width_and_error(fit):
    figure = fit_figure(fit)
    upper, lower = figure.axes
    data, fitted, equal = texts(upper.get_legend())
    assert (data, equal) == ("data", "equal balls")
    assert fitted == f"effective\u00a0medium:\nW = {fit.width * 1e6:.3f} ± {fit.stderr * 1e6:.3f} µm"
    assert upper.get_xlim() == lower.get_xlim()


def test_pulses_of_many_frequencies_are_drawn_at_the_data():
    force, hertz = np.array([2.0, 6.0, 18.0]), np.array([2e3, 3e3, 4e3])
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
    assert texts(figure.axes[0].get_legend())[1] == "effective\u00a0medium:\nW = 2.04 µm"  # its error is not known


# -- force chains ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def simulated():
    """Near the threshold: many contacts are open."""
    return gp.DirectSimulation(PACKING, (12, 10), seed=3, samples=3).at_overlap(2.04e-6 * (0.45 - 0.5))


def chains(ax):
    """Segments (n, 2, 2), forces and widths of the contacts drawn."""
    (lines,) = [c for c in ax.collections if c.get_gid() == "forces"]
    return np.array(lines.get_segments()), np.asarray(lines.get_array()), np.asarray(lines.get_linewidths())


def wrapped(places, shape):
    """The cell (p, q) of each place, which must be a site."""
    cells = places @ np.linalg.inv(TRIANGULAR.vectors)
    assert_allclose(cells, np.round(cells), atol=1e-9)
    return np.mod(np.round(cells).astype(int), shape)


def test_every_contact_that_carries_load_is_a_line_between_its_balls(simulated, ax):
    sample = simulated.sample
    assert plot_forces(sample, ax) is ax
    segments, values, widths = chains(ax)
    forces = sample.contact_forces / sample.force
    starts, ways = wrapped(segments[:, 0], (12, 10)), segments[:, 1] - segments[:, 0]
    kinds = np.argmax(ways @ TRIANGULAR.contacts.normal.T, axis=1)
    assert_allclose(ways, TRIANGULAR.contacts.normal[kinds], atol=1e-12)
    # each line has the force of its contact, and every closed contact has one line, or two if it crosses an edge
    assert_allclose(values, forces[starts[:, 0], starts[:, 1], kinds], rtol=1e-12)
    contacts, lines = np.unique(np.column_stack([starts, kinds]), axis=0, return_counts=True)
    assert len(contacts) == np.count_nonzero(forces) < 0.8 * forces.size
    assert set(lines.tolist()) == {1, 2}
    assert_allclose(widths / values, widths[0] / values[0], rtol=1e-12)
    assert np.all(np.diff(values) >= 0.0)  # the strong on top


def test_a_contact_across_an_edge_is_drawn_on_both_sides(simulated, ax):
    segments, _, _ = chains(plot_forces(simulated.sample, ax))
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    height = 10 * np.sqrt(0.75)
    assert (right - left, top - bottom) == pytest.approx((12.0, height))
    inside = np.all((segments > [left, bottom]) & (segments < [right, top]), axis=2)
    assert np.all(np.any(inside, axis=1))  # nothing is drawn wholly outside
    middles = segments[~np.all(inside, axis=1)].mean(axis=1)
    # of the two lines of a contact one is the other moved by a period: (12, 0), or (-5, 10 sqrt(3)/2), or both
    periods = np.array([(12.0, 0.0), (-5.0, height), (7.0, height), (-17.0, height)])
    moved = (middles[:, None, None] + np.concatenate([periods, -periods])[:, None])[:, :, 0]
    apart = np.linalg.norm(moved[:, :, None] - middles, axis=-1)
    assert np.all(np.sum(apart < 1e-9, axis=(1, 2)) == 1)
    assert len(middles) > 20


def test_the_map_says_what_it_shows(simulated):
    ax = plot_forces(simulated.sample)
    state, figure = simulated.sample.equilibrium, ax.get_figure()
    assert ax.get_title() == f"$f^*$ = {state.force:.3g}, $a^*$ = 0.45, $N_c$ = {simulated.sample.contact_fraction():.3f}"
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_aspect()) == ("$x/d$", "$y/d$", 1.0)
    assert figure.axes[1].get_xlabel() == "Contact force over its mean"
    assert figure.axes[1].get_xlim() == pytest.approx((0.0, chains(ax)[1].max()))
    assert figure.get_size_inches()[0] == 3.4
    assert len([c for c in ax.collections if c.get_gid() == "balls"]) == 1
    many = plot_forces(gp.DirectSimulation(PACKING, (40, 40)).at_force(20.0).sample)
    assert [c.get_gid() for c in many.collections] == ["forces"]


@pytest.fixture(scope="module")
def wide():
    return gp.DirectSimulation(PACKING, (64, 12), seed=2).at_overlap(2.04e-6 * (0.45 - 0.5))


def test_of_a_large_array_the_density_of_the_force_is_drawn(wide, ax):
    sample = wide.sample
    plot_forces(sample, ax)
    (mesh,) = ax.collections
    assert mesh.get_gid() == "density"
    corners = np.asarray(mesh.get_coordinates())
    x, y = corners[0, :, 0], corners[:, 0, 1]
    assert (len(x) - 1, len(y) - 1) == (16, 3)
    # each contact counts half at each of its balls, those that carry nothing too
    forces, table = sample.contact_forces / sample.force, TRIANGULAR.contacts
    sums = np.zeros((64, 12))
    for contact, (p, q) in enumerate(table.shift[:, :2]):
        for row, column in np.ndindex(64, 12):
            sums[row, column] += forces[row, column, contact]
            sums[(row + p) % 64, (column + q) % 12] += forces[row, column, contact]
    places = np.reshape(sample.sites, (64, 12, 2))
    where = (
        np.searchsorted(x, np.mod(places[..., 0] + 1e-9, 64.0), "right") - 1,
        np.searchsorted(y, places[..., 1], "right") - 1,
    )
    expected, count = np.zeros((16, 3)), np.zeros((16, 3))
    np.add.at(expected, where, sums)
    np.add.at(count, where, 6.0)
    assert_allclose(np.asarray(mesh.get_array()).T, expected / count, rtol=1e-9)
    assert "means over 4 x 3.5 $d$" in ax.get_figure().axes[1].get_xlabel().replace("3.5 x 4", "4 x 3.5")


def test_a_window_shows_the_contacts_inside_it(wide, ax):
    every = chains(plot_forces(wide.sample, Figure().subplots(), show="all"))
    plot_forces(wide.sample, ax, window=(20.0, 2.0, 30.0, 8.0))
    assert (ax.get_xlim(), ax.get_ylim()) == ((20.0, 30.0), (2.0, 8.0))
    inside = np.all((every[0] > [20.0, 2.0]) & (every[0] < [30.0, 8.0]), axis=2)
    lines = {tuple(np.round(one.ravel(), 9)) for one in chains(ax)[0]}
    assert {tuple(np.round(one.ravel(), 9)) for one in every[0][inside.any(axis=1)]} <= lines
    assert len(lines) < 0.3 * len(every[0])
    (balls,) = [c for c in ax.collections if c.get_gid() == "balls"]
    assert len(balls.get_offsets()) < 100
    middle = plot_forces(wide.sample, Figure().subplots(), show="window")
    assert np.ptp(middle.get_xlim()) == pytest.approx(24.0)


def test_the_figure_of_a_large_array_marks_its_window(wide, tmp_path):
    figure = forces_figure(wide)
    whole, window, distribution = figure.axes[:3]
    (marked,) = [patch for patch in whole.patches if patch.get_gid() == "window"]
    assert window.get_xlim() == pytest.approx((marked.get_x(), marked.get_x() + marked.get_width()))
    assert window.get_ylim() == pytest.approx((marked.get_y(), marked.get_y() + marked.get_height()))
    assert distribution.get_ylabel() == "Probability density"
    figure.savefig(tmp_path / "forces.png", dpi=50)
    tight, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    assert min(tight.x0, tight.y0) >= 0.0
    assert tight.x1 <= width
    assert tight.y1 <= height


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"show": "some"}, "Use all, window, density or auto"), ({"window": (3.0, 2.0, 1.0, 4.0)}, "left, lower, right"),
        ({"window": (1.0, 2.0)}, "left, lower, right"), ({"window": (500.0, 0.0, 510.0, 9.0)}, "no ball of the array"),
    ],
)  # fmt: skip
def test_forces_that_cannot_be_shown(simulated, ax, options, told):
    with pytest.raises(InputError, match=told):
        plot_forces(simulated.sample, ax, **options)


def of_packing(name):
    """A network of LAMMPS' disks in a periodic plane, or balls in a periodic space."""
    glass = gp.Material(young_modulus=70e9, poisson_ratio=0.2, density=2500.0)
    return gp.ContactNetwork.from_lammps(*(packings.FOLDER / f"{name}_{what}.dump" for what in ("atoms", "pairs")), glass)


@pytest.mark.parametrize("name", ["disks", "balls"])
def test_every_contact_of_a_network_is_a_line_as_wide_and_dark_as_its_force(name, ax):
    network = of_packing(name)
    assert plot_forces(network, ax) is ax
    segments, values, widths = chains(ax)
    inside = np.all(network.shift == 0, axis=1)
    assert len(values) == np.count_nonzero(inside) + 2 * np.count_nonzero(~inside)
    # in the order of the forces: whole lines inside, and across an edge two pieces that end where the balls touch
    start, end = network.positions[network.i, :2], network.positions[network.j, :2]
    at_i = (network.positions[network.i] + network.arm_i[:, None] * network.normal)[:, :2]
    at_j = (network.positions[network.j] - network.arm_j[:, None] * network.normal)[:, :2]
    pieces = [
        np.stack(pair, axis=1)
        for pair in ((start[inside], end[inside]), (start[~inside], at_i[~inside]), (end[~inside], at_j[~inside]))
    ]
    force = network.normal_force
    forces = np.concatenate([force[inside], force[~inside], force[~inside]])
    order = np.argsort(forces, kind="stable")
    assert_allclose(values, forces[order], rtol=1e-12)
    assert_allclose(segments, np.concatenate(pieces)[order], atol=1e-15)
    assert_allclose(widths / widths[0], np.clip(values / force.mean(), 0.2, 4.0) / 0.2, rtol=1e-12)
    (balls,) = [c for c in ax.collections if c.get_gid() == "balls"]
    lowest = np.argsort(network.positions[:, 2], kind="stable")  # what is nearer hides what is farther
    assert_allclose(balls.get_offsets(), network.positions[lowest, :2])
    assert_allclose(balls.get_widths(), 2.0 * network.radii[lowest])
    assert ax.get_aspect() == 1.0
    assert ax.get_title() == f"{network.n_balls} balls, {network.n_contacts} contacts" + ", seen along $z$" * (
        name == "balls"
    )


def test_a_network_is_drawn_with_its_units():
    figure = gp.plot(of_packing("disks"))
    ax, bar = figure.axes
    assert figure.get_size_inches()[0] == 3.4
    assert (ax.get_xlabel(), ax.get_ylabel(), bar.get_xlabel()) == ("$x$ (mm)", "$y$ (mm)", "Contact force (N)")
    figure.canvas.draw()
    written = dict(zip([one.get_text() for one in ax.get_xticklabels()], ax.get_xticks(), strict=True))
    assert [written[one] for one in ("0", "5", "10")] == pytest.approx([0.0, 5e-3, 10e-3])
    assert bar.get_xlim() == pytest.approx((0.0, of_packing("disks").normal_force.max()))


def test_walls_and_a_row_of_balls_are_drawn(ax):
    pressed = gp.Hexagon(PACKING, 3).at_side_force(30.0)
    plot_forces(pressed.network, ax)
    (walls,) = [c for c in ax.collections if c.get_gid() == "walls"]
    assert len(walls.get_segments()) == np.count_nonzero(pressed.wall_forces)
    assert ax.get_title().startswith("19 balls, ")
    chain = gp.DirectSimulation(gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6), lattice="chain"), shape=(9,)).at_force(2.0)
    row = plot_forces(chain.sample.network)
    assert (row.get_xlabel(), row.get_ylabel(), row.get_yticks().tolist()) == ("$x$ (mm)", "", [0.0])
    assert_allclose(chains(row)[1], 2.0)
    assert row.get_figure().get_figheight() < 2.0


def test_of_a_large_network_the_density_or_a_window_is_drawn(wide, ax):
    network = wide.sample.network
    plot_forces(network, ax)
    (mesh,) = ax.collections
    assert mesh.get_gid() == "density"
    corners, mean = np.asarray(mesh.get_coordinates()), np.ma.filled(mesh.get_array(), np.nan)
    # each contact counts half at each of its balls
    places, force = network.positions, network.normal_force
    sums, counts = np.zeros(mean.shape), np.zeros(mean.shape)
    for ball, one in [*zip(network.i, force, strict=True), *zip(network.j, force, strict=True)]:
        column = np.searchsorted(corners[0, :, 0], places[ball, 0], "right") - 1
        row = np.searchsorted(corners[:, 0, 1], places[ball, 1], "right") - 1
        sums[row, column] += one
        counts[row, column] += 1.0
    assert_allclose(mean[counts > 0], sums[counts > 0] / counts[counts > 0], rtol=1e-9)
    assert np.all(np.isnan(mean[counts == 0]))
    window = plot_forces(network, window=(0.1, 0.02, 0.2, 0.06))
    assert (*window.get_xlim(), *window.get_ylim()) == pytest.approx((0.1, 0.2, 0.02, 0.06))
    with pytest.raises(InputError, match="Give edges inside the array, in m"):
        plot_forces(network, window=(10.0, 0.0, 11.0, 1.0))


def test_a_network_without_force_and_what_is_no_network(ax):
    network = of_packing("disks")
    still = replace(network, normal_force=0.0 * network.normal_force)
    plot_forces(still, ax)
    assert len(ax.get_figure().axes) == 1  # without a scale of forces
    with pytest.raises(InputError, match=r"Give a sample, such as .*, or a gp.ContactNetwork"):
        plot_forces(STEEL)


def test_the_distribution_is_that_of_all_samples_and_integrates_to_one(simulated, ax):
    plot_force_distribution(simulated, ax)
    (steps,) = [p for p in ax.patches if p.get_gid() == "density"]
    density, edges, _ = steps.get_data()
    assert np.sum(density * np.diff(edges)) == pytest.approx(1.0, rel=1e-12)
    each = [s.contact_forces[s.contact_forces > 1e-6 * s.force] / s.force for s in simulated.samples]
    expected = [np.histogram(one, edges)[0] / one.size / np.diff(edges) for one in each]
    assert_allclose(density, np.mean(expected, axis=0), rtol=1e-9)
    assert edges[-2] < max(one.max() for one in each) < edges[-1]
    assert np.diff(edges)[0] == pytest.approx(0.25 * simulated.contact_force_fluctuation, rel=0.1)
    assert ax.get_yscale() == "log"


@pytest.mark.parametrize(
    ("packing", "shape"),
    [
        (PACKING, (2, 3)),
        (PACKING, (7, 40)),
        (gp.Packing(STEEL, 8e-3), (1, 1)),
        (gp.Packing(STEEL, 8e-3), (40, 7)),
        *(pytest.param(PACKING, shape, marks=pytest.mark.exhaustive) for shape in [(1, 1), (8, 5), (40, 7)]),
        *(pytest.param(gp.Packing(STEEL, 8e-3), s, marks=pytest.mark.exhaustive) for s in [(2, 3), (8, 5), (7, 40)]),
    ],
)
def test_a_figure_of_forces_fits_its_page(shape, packing, tmp_path):
    state = gp.DirectSimulation(packing, shape).at_force(2.0)
    figure = forces_figure(state)
    figure.savefig(tmp_path / "forces.png")
    tight, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    assert width == 7.0
    assert min(tight.x0, tight.y0) >= 0.0
    assert tight.x1 <= width
    assert tight.y1 <= height
    (left, right), bar = figure.axes[:2], figure.axes[2]
    assert right.get_ylabel() == "Probability density"
    assert bar.get_xlabel() == right.get_xlabel()
    closed = np.count_nonzero(state.sample.contact_forces)
    assert len(chains(left)[0]) >= closed
    if not packing.width:
        assert left.get_title() == "$f$ = 2 N, $N_c$ = 1.000"
        assert_allclose(chains(left)[1], 1.0, rtol=1e-12)


def test_the_forces_of_several_loads_are_not_one_figure():
    states = gp.DirectSimulation(PACKING, (4, 4)).at_force([2.0, 3.0])
    for draw in (forces_figure, lambda state: plot_force_distribution(state, Figure().subplots())):
        with pytest.raises(InputError, match="2 loads"):
            draw(states)


def test_the_global_state_of_matplotlib_is_left_alone():
    code = (
        "import matplotlib\nbefore = dict(matplotlib.rcParams)\nimport numpy as np, granphon as gp\n"
        "from granphon.figures.sweeps import sweep_figure\nfrom granphon.sweeps.sweep import sweep\n"
        "packing = gp.Packing(gp.Material(70e9, 0.22, 2500.0), 1e-3, gp.Uniform(1e-6))\n"
        "sweep_figure(sweep(packing, force=[1.0, 2.0], media=('afa',))).canvas.draw()\n"
        "assert dict(matplotlib.rcParams) == before"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


# -- directions, and cells of several balls -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def directions():
    fcc = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6), lattice="fcc")
    long_name = {"simulation": {"shape": (1, 1, 1), "samples": 2}}
    return sweep(fcc, force=FORCE[:3], media=("ala", "afa", long_name), direction=[(1, 0, 0), (1, 1, 0)])


def test_what_is_the_same_in_all_directions_has_the_colours_of_the_media(directions):
    for figure in (sweep_figure(directions, variable="bulk"), sweep_figure(directions)):
        ax, legend = figure.axes[-1], figure.legends[0]
        named = {
            text.get_text(): line.get_color() for text, line in zip(legend.get_texts(), legend.get_lines(), strict=True)
        }
        media = ("averaged lattice", "averaged force", "simulation, 2 samples of 1 x 1 x 1 balls")
        wanted = [to_rgb(named[name]) for name in media]
        drawn = [to_rgb(line.get_color()) for line in ax.lines if (line.get_gid() or "").endswith("-all")]
        assert drawn == wanted
        # directions are named where they are drawn
        assert any(name.startswith("direction") for name in named) == (len(figure.axes) == 2)


def test_a_long_legend_leaves_the_panels_their_room(directions):
    for variable in ("bulk", "longitudinal"):
        figure = sweep_figure(directions, variable=variable)
        figure.draw_without_rendering()
        (ax,) = figure.axes
        assert ax.yaxis.label.get_window_extent().y1 < figure.bbox.y1
        assert ax.get_window_extent().height > 1.2 * figure.dpi


def test_the_layer_that_is_drawn_of_hcp_is_whole():
    hcp = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6), lattice="hcp")
    ax = plot_forces(gp.DirectSimulation(hcp, (3, 4, 2)).at_force(20.0).sample)
    (balls,) = [one for one in ax.collections if one.get_gid() == "balls"]
    rows, (low, high) = np.asarray(balls.get_offsets())[:, 1], ax.get_ylim()
    assert len(rows) == 12
    # half a row is left below the lowest and above the highest
    assert_allclose([rows.min() - low, high - rows.max()], 0.25 * 3.0**0.5, rtol=1e-12)
