"""Figures of sweeps over the load: the plotted data are read back, not the pixels."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.array.sample import STEP
from granphon.base.errors import FigureError, InputError
from granphon.figures.curves import plot_exponent, plot_sweep, sweep_figure
from granphon.figures.gaps import cutoffs_figure
from granphon.figures.waves import _draw_decibel_map, _find_decibels
from granphon.figures.words import describe_parameter, write_value
from granphon.runs.sweep import sweep
from tests.figures.conftest import PATH, drawn, texts

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
PACKING = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))
FORCE = np.geomspace(0.5, 50.0, 9)


@pytest.fixture(scope="module")
def media():
    return sweep(PACKING, force=FORCE[::-1], media=("ala", "afa", "ema"))


@pytest.fixture(scope="module")
def widths():
    return sweep(
        PACKING, pressure=np.geomspace(200.0, 9000.0, 5), media=("ala", "ema"), width=[1e-6, 4e-6]
    )


def test_titles_of_columns_of_panels_stay_apart():
    data = sweep(PACKING, force=[1.0, 9.0], media=("ala", "afa", "ema"), friction=[True, False])
    figure = sweep_figure(data, variable="longitudinal", columns="medium", rows="friction")
    figure.draw_without_rendering()
    boxes = [ax.title.get_window_extent() for ax in figure.axes[:3]]
    letter = figure.dpi * 4.0 / 72.0  # about half the size of the font
    assert all(left.x1 + letter < right.x0 for left, right in itertools.pairwise(boxes))


def test_curves_over_a_parameter_tell_the_one_load(widths):
    one = widths.isel(load=[0])
    title = sweep_figure(one, variable="bulk").get_suptitle()
    assert title.replace("\N{NO-BREAK SPACE}", " ") == "pressure 200 N/m"
    assert "pressure" not in sweep_figure(widths, variable="bulk").get_suptitle()


def test_lines_are_the_variable_in_order_of_the_load(media, ax):
    assert plot_sweep(media, ax, "normal_stiffness") is ax
    lines = drawn(ax, "normal_stiffness-all")
    assert len(lines) == 3
    for line, name in zip(lines, ("ala", "afa", "ema"), strict=True):
        assert_array_equal(line[:, 0], FORCE)
        assert_array_equal(line[:, 1], media["normal_stiffness"].sel(medium=name).values[::-1])
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Contact force (N)", "Normal stiffness (MN/m)")
    assert texts(ax.get_legend()) == [
        "averaged lattice",
        "averaged force",
        "effective medium",
        "outside its range",
    ]


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
    assert texts(ax.get_legend())[2:] == ["W = 1 µm", "W = 4 µm", "outside its range"]
    assert ax.get_xlabel() == "Pressure (N/m)"


def test_other_combinations_of_parameters_are_lines_too(ax):
    dataset = sweep(
        PACKING,
        force=FORCE,
        media=("ema",),
        width=[1e-6, 2e-6],
        friction=[True, False],
        density=[7840.0],
    )
    plot_sweep(dataset, ax, "transverse")
    assert len(drawn(ax, "transverse-all")) == 4
    # widths have the colours, and what is with friction or without the shades
    assert texts(ax.get_legend())[:4] == [
        "W = 1 µm",
        "W = 2 µm",
        "with friction",
        "without friction",
    ]


def test_of_many_parameters_some_are_named(ax):
    many = sweep(
        PACKING, force=[3.0, 4.0], media=("ema",), width=np.linspace(1e-6, 2e-6, 30).tolist()
    )
    *named, last = texts(plot_sweep(many, ax).get_legend())
    assert len(named) == 8
    assert re.fullmatch(r"8 of [0-9]+ are named", last)
    # at one load alone they lie over the parameter
    (line,) = [
        one
        for one in plot_sweep(many.isel(load=[0]), Figure().subplots()).lines
        if one.get_gid() == "longitudinal-all"
    ]
    assert_array_equal(
        line.get_xydata(), np.stack([many["width"], many["longitudinal"][0, 0]], axis=1)
    )


@pytest.mark.parametrize(
    ("variable", "samples"),
    [
        ("transverse", 2),
        ("exponent", 1),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (("transverse", 3), ("transverse", 1), ("contact_fraction", 1))
        ),
    ],
)
def test_a_simulation_is_points_and_several_samples_have_bars_of_their_standard_error(
    ax, variable, samples
):
    data = sweep(
        PACKING,
        force=[2.0, 9.0, 4.0],
        media=("ema", {"simulation": {"shape": (4, 4), "samples": samples}}),
    )
    plot_sweep(data, ax, variable)
    there = data.isel(medium=1).sortby("force")
    if samples == 1:
        assert not ax.containers
    else:
        (container,) = ax.containers  # none of the effective medium, which has no error
        _, caps, (bars,) = container.lines
        assert caps == ()  # which would make squares of the points
        ends = np.array(bars.get_segments())[..., 1]
        assert_allclose(np.diff(ends, axis=1)[:, 0], 2.0 * there.transverse_error, rtol=1e-9)
        assert_allclose(np.mean(ends, axis=1), there.transverse, rtol=1e-12)
    line, points = (one for one in ax.lines if one.get_gid() == f"{variable}-all")
    assert_array_equal(points.get_xydata(), np.stack([there.force, there[variable]], axis=1))
    # points are not joined, and lines have no points
    assert (line.get_linestyle(), line.get_marker()) == ("--", "")
    assert {one.get_linestyle() for one in ax.lines if one.get_color() == points.get_color()} == {
        "None"
    }
    assert points.get_marker() == "o"
    assert [one.get_linestyle() for one in ax.get_legend().get_lines()][:2] == ["-", "None"]


LOADED = {
    "shape": (4, 4),
    "friction_history": True,
    "friction_coefficient": 0.5,
    "seed": 3,
    "samples": 2,
    "step_tolerance": 1.0,
}


@pytest.mark.parametrize(
    "media",
    [
        ("ema", {"simulation": {"shape": (3, 3), "samples": 2}}),
        pytest.param(({"simulation": LOADED},), marks=pytest.mark.slow),
    ],
    ids=["two", "a long one"],
)
def test_long_labels_stand_below_each_other(media):
    data = sweep(PACKING, force=[20.0, 30.0], media=media)
    figure = sweep_figure(data)
    figure.draw_without_rendering()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    width = figure.bbox.width
    assert box.x0 >= 0.0
    assert box.x1 <= width


def test_an_axis_with_zeros_or_negative_values_is_linear(media, ax):
    plot_sweep(media, ax, "force_fluctuation", "overlap")
    assert ax.get_yscale() == "linear"
    assert ax.get_ylabel() == "Force fluctuation Δf/f"


@pytest.mark.parametrize(
    ("variable", "words"),
    [
        ("velocity", "no variable 'velocity'"),
        ("regime", "not one number"),
        ("medium", "not one number"),
    ],
)
def test_what_cannot_be_drawn_is_named(media, ax, variable, words):
    with pytest.raises(InputError, match=words):
        plot_sweep(media, ax, variable)


@pytest.mark.slow
def test_the_exponent_is_that_of_the_longitudinal_velocity(ax):
    force = 4.0 * np.exp(STEP * np.array([-1.0, 0.0, 1.0]))
    data = sweep(
        PACKING, force=force, media=("ema", {"simulation": {"shape": (16, 16), "samples": 2}})
    )
    plot_exponent(data, ax)
    assert ax.get_ylabel() == "d log $v_L$ / d log $P$"
    longitudinal, transverse = (
        np.log(data[name][2] / data[name][0]).values
        / np.log(data.pressure[2] / data.pressure[0]).values
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


def test_what_is_infinite_everywhere_or_beyond_matplotlib_is_refused(ax):
    equal = sweep(gp.Packing(STEEL, 8e-3), force=FORCE)
    with pytest.raises(InputError, match="has no finite value"):
        plot_sweep(equal, ax, "reduced_force")
    equal["pressure"] = equal["pressure"] * 1e302
    with pytest.raises(FigureError, match=r"'pressure' .*e\+30"):
        plot_sweep(equal, ax, "pressure")


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
    # at one load the curves lie over the parameter
    assert velocities.get_xlabel() == "Width (µm)"
    assert all(list(line.get_xdata()) == [1e-6, 2e-6] for line in velocities.lines)
    assert figure.legends[0].get_texts()[0].get_text() == "effective medium"


@pytest.mark.parametrize(
    ("load", "label"),
    [
        ({"force": [2.0, 9.0]}, "(N)"),
        pytest.param({"pressure": [1e5, 1e6]}, "(MPa)", marks=pytest.mark.slow),
        ({"overlap": [2e-6, 4e-6]}, "(µm)"),
    ],
)
def test_the_axis_of_a_sweep_is_the_load_that_was_given(load, label):
    data = sweep(gp.Packing(STEEL, 8e-3, lattice="fcc"), **load)
    ((kind, values),) = load.items()
    figure = sweep_figure(data)
    for ax in figure.axes:
        assert_array_equal(ax.lines[0].get_xdata(), values)
    assert figure.axes[-1].get_xlabel().endswith(label)
    assert kind in figure.axes[-1].get_xlabel().lower()
    assert_array_equal(
        sweep_figure(data, "normal_stiffness").axes[0].lines[0].get_xdata(),
        data.normal_stiffness[:, 0],
    )
    assert_array_equal(plot_exponent(data, Figure().subplots()).lines[0].get_xdata(), values)


@pytest.mark.slow
def test_names_of_a_path_stand_beside_the_right_ends_of_its_lines():
    data = sweep(PACKING, force=[2.0, 8.0, 5.0], media=[{"simulation": PATH}])
    upper, _ = sweep_figure(data).axes
    heights = {text.get_text(): text.xy[1] for text in upper.texts}
    greatest = data.isel(load=int(np.argmax(data["force"].values)), medium=0)
    assert heights == {
        "$v_L$": float(greatest["longitudinal"]),
        "$v_T$": float(greatest["transverse"]),
    }


@pytest.mark.slow
def test_slow_and_fast_transverse_waves_are_told_apart():
    packing = gp.Packing(STEEL, 8e-3, lattice="hcp")
    both = sweep(
        packing,
        force=[20.0, 40.0],
        media=("ala", {"simulation": {"shape": (2, 2, 2)}}),
        direction=(1, 0, 0.5),
    )
    for media in ([0], [1], [0, 1]):
        figure = sweep_figure(both.isel(medium=media))
        lines = figure.axes[0].lines
        looks = [
            {
                (str(line._unscaled_dash_pattern), line.get_marker())
                for line in lines
                if line.get_gid() == name
            }
            for name in ("transverse_slow-valid", "transverse_fast-valid")
        ]
        assert len(looks[0]) == len(looks[1]) == len(media)
        assert looks[0].isdisjoint(looks[1])
        assert {"$v_{T1}$", "$v_{T2}$"} <= set(texts(figure.legends[0]))
    assert not any(
        "T1" in text for text in texts(sweep_figure(sweep(PACKING, force=[20.0, 40.0])).legends[0])
    )


@pytest.fixture(scope="module")
def directions():
    fcc = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6), lattice="fcc")
    long_name = {"simulation": {"shape": (1, 1, 1), "samples": 2}}
    return sweep(
        fcc, force=FORCE[:3], media=("ala", "afa", long_name), direction=[(1, 0, 0), (1, 1, 0)]
    )


@pytest.mark.parametrize(
    "options", [{}, pytest.param({"variable": "bulk"}, marks=pytest.mark.slow)], ids=str
)
def test_what_is_the_same_in_all_directions_has_the_colours_of_the_media(directions, options):
    figure = sweep_figure(directions, **options)
    ax = figure.axes[-1]
    legend = figure.legends[0]
    named = {
        text.get_text(): line.get_color()
        for text, line in zip(legend.get_texts(), legend.get_lines(), strict=True)
    }
    media = ("averaged lattice", "averaged force", "simulation, 2 samples of 1 x 1 x 1 balls")
    wanted = [to_rgb(named[name]) for name in media]
    drawn = [
        to_rgb(line.get_color()) for line in ax.lines if (line.get_gid() or "").endswith("-all")
    ]
    assert drawn == wanted
    # directions are named where they are drawn
    assert any(name.startswith("along") for name in named) == (len(figure.axes) == 2)


@pytest.mark.parametrize("variable", ["longitudinal", pytest.param("bulk", marks=pytest.mark.slow)])
def test_a_long_legend_leaves_the_panels_their_room(directions, variable):
    figure = sweep_figure(directions, variable=variable)
    figure.draw_without_rendering()
    (ax,) = figure.axes
    assert ax.yaxis.label.get_window_extent().y1 < figure.bbox.y1
    assert ax.get_window_extent().height > 1.2 * figure.dpi


def test_a_map_of_responses_that_are_zero_has_no_colours():
    ax = Figure(layout="constrained").subplots()
    magnitudes = np.zeros((2, 3))  # of a receiver that nothing moves
    _draw_decibel_map(ax, np.arange(2.0), np.arange(3.0), _find_decibels(magnitudes), "receptance")
    ax.figure.draw_without_rendering()
    (mesh,) = ax.collections
    assert np.ma.getmaskarray(mesh.get_array()).all()
    assert all(np.isfinite(mesh.get_clim()))


def test_numbers_of_unit_one_have_no_unit_in_legends():
    assert write_value(0.0125, "1") == "0.0125"
    assert write_value(2.04e-6, "m") == "2.04 µm"


@pytest.mark.parametrize("name", ["torsion", "bending"])
def test_whole_ratios_are_numbers_in_legends(name):
    assert describe_parameter(name, 1) == (name, f"{name} 1")
    assert describe_parameter(name, 0.25) == (name, f"{name} 0.25")
    assert describe_parameter(name, "mindlin") == (name, f"{name} of Mindlin")


# -- edges -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["", " ", 0, [], ["force"], 3])
def test_what_is_no_name_is_refused(widths, ax, name):
    with pytest.raises(InputError, match=r"x: .*a name"):
        plot_sweep(widths, ax, x=name)
    for option in ("rows", "columns"):
        with pytest.raises(InputError, match=f"{option}: .*a name"):
            sweep_figure(widths, **{option: name})


def test_an_unknown_variable_is_told_with_the_names_that_can_be_drawn(widths, ax):
    with pytest.raises(InputError, match="Did you mean pressure"):
        plot_sweep(widths, ax, x="presure")
    with pytest.raises(InputError, match=r"Use .*pressure") as refusal:
        plot_sweep(widths, ax, "nothing")
    assert "regime" not in str(refusal.value)  # a word, which is no curve


def test_a_direction_that_a_variable_does_not_have_is_not_told():
    data = sweep(PACKING, force=FORCE[:2], media=("ala", "ema"), direction=[(1, 0), (0, 1)])
    one = data.isel(direction=[0])
    assert "along (1, 0)" in sweep_figure(one).get_suptitle().replace("\xa0", " ")
    for columns in (None, "medium"):
        assert sweep_figure(one, variable="bulk", columns=columns).get_suptitle() == ""


def test_velocities_and_exponents_that_are_known_nowhere_are_left_out(media):
    unknown = media["transverse"] * np.nan
    upper, _ = sweep_figure(media.assign(transverse=unknown)).axes
    gids = {line.get_gid() for line in upper.lines}
    assert "longitudinal-all" in gids
    assert "transverse-all" not in gids
    (alone,) = sweep_figure(media.assign(exponent=unknown)).axes
    assert len(drawn(alone, "longitudinal-all")) == 3
    (stiffness,) = sweep_figure(media.assign(longitudinal=unknown, transverse=unknown)).axes
    assert len(drawn(stiffness, "normal_stiffness-all")) == 3


def test_single_loads_are_points_in_the_legend_too(media, ax):
    plot_sweep(media.isel(load=[0]), ax)
    handles = ax.get_legend().legend_handles[:3]
    assert [handle.get_marker() for handle in handles] == ["o"] * 3
    assert [handle.get_linestyle() for handle in handles] == ["None"] * 3


def test_states_of_one_value_of_x_stand_above_each_other():
    """Equal balls keep all contacts at each load."""
    data = sweep(gp.Packing(STEEL, 8e-3), force=FORCE[:3], media=("ala",), cutoffs=True)
    (ax,) = cutoffs_figure(data, x="contact_fraction").axes
    assert_array_equal(drawn(ax, "branch-2-edge")[0][:, 0], [1.0, 1.0, 1.0])
    (alone,) = cutoffs_figure(data.isel(load=[0]), x="contact_fraction").axes
    assert alone.get_xlabel() == "Branch"


def test_a_sweep_without_an_axis_of_loads_or_media_is_refused(media, ax):
    for name in ("load", "medium"):
        chosen = media.isel({name: 0})
        for draw in (sweep_figure, lambda data: plot_sweep(data, ax)):
            with pytest.raises(InputError, match=f"no dimension {name!r}"):
                draw(chosen)
