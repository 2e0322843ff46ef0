"""The states of a sweep that a user chooses, and the panels of its figure: the plotted data are
read back, not the pixels.
"""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
import xarray
from numpy.testing import assert_array_equal

import granphon as gp
from granphon.base.errors import InputError
from granphon.cli.main import main
from granphon.figures.choices import arrange, choose_held, choose_states, read_wishes
from granphon.figures.curves import comparison_figure, sweep_figure
from granphon.runs.dataset import write_sweep
from granphon.runs.sweep import sweep
from tests.figures.conftest import assert_inside_page, drawn, texts

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
PACKING = gp.Packing(STEEL, 8e-3)
FORCE = np.geomspace(1.0, 16.0, 3)
MANY = {
    "width": [1e-6, 2e-6, 4e-6],
    "diameter": [4e-3, 8e-3, 12e-3],
    "poisson_ratio": [0.1, 0.3],
}


@pytest.fixture(scope="module")
def many():
    """Three parameters, two media, three loads: 36 curves."""
    return sweep(PACKING, force=FORCE, media=("ala", "ema"), **MANY)


@pytest.fixture(scope="module")
def folder(many, tmp_path_factory):
    place = tmp_path_factory.mktemp("many")
    write_sweep(many, place / "sweep.nc")
    return place


def panels(figure):
    return [ax for ax in figure.axes if ax.lines]


# -- the states that are chosen --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "chosen"),
    [
        ("width=2 um", {"width": [2e-6]}),
        ("width=2000nm,medium=ema", {"width": [2e-6], "medium": ["ema"]}),
        ("width=1 um, width=4 um", {"width": [1e-6, 4e-6]}),
        ("width=1 um to 2.001 um", {"width": [1e-6, 2e-6]}),
        ("force=4 N to 1 N, poisson_ratio=0.3", {"force": FORCE[:2], "poisson_ratio": [0.3]}),
        ("force=4.01 N", {"force": FORCE[1:2]}),
    ],
)
def test_states_are_chosen_by_values_with_units(many, text, chosen):
    states = choose_states(many, read_wishes(text), "the sweep")
    assert states["valid"].dims == many["valid"].dims
    for name in ("force", "medium", *MANY):
        assert_array_equal(states[name], chosen.get(name, many[name]))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("widht=2 um", "'widht'.*Did you mean width"),
        ("width=3 um", "no width 3 um.*1 um, 2 um, 4 um"),
        ("width=2", "without a unit.*1 um"),
        ("width=2 N", "width.*2 N"),
        ("width=1 um to 2 um to 3 um", "A to B"),
        ("width", "no NAME=VALUE"),
        ("=2 um", "no NAME=VALUE"),
        ("medium=eam", "no medium eam.*ala, ema"),
        ("poisson_ratio=third", "no number"),
        ("longitudinal=3 m/s", "not swept over 'longitudinal'"),
    ],
)
def test_states_that_are_none_are_named(many, text, words):
    with pytest.raises(InputError, match=words):
        choose_states(many, read_wishes(text), "the sweep")


def test_states_are_chosen_by_names_of_media_by_directions_and_by_friction():
    media = (
        "ema",
        {"simulation": {"shape": (3, 3), "samples": 2}},
        {"simulation": {"shape": (4, 4)}},
    )
    data = sweep(
        gp.Packing(STEEL, 8e-3, gp.Uniform(1e-6)),
        force=[9.0, 10.0],
        media=media[:1],
        friction=[True, False],
        direction=[(1, 0), (0, 1)],
    )
    wishes = read_wishes("direction=(0, 1), friction=no, medium=ema")
    states = choose_states(data, wishes, "it")
    assert states["direction"].values.tolist() == ["(0, 1)"]
    assert states["friction"].values.tolist() == [False]
    simulated = sweep(gp.Packing(STEEL, 8e-3, gp.Uniform(1e-6)), force=[9.0], media=media)
    (whole,) = simulated["medium"].values[2:3]
    for text, n_media in (("simulation", 2), (whole, 1)):
        chosen = choose_states(simulated, {"medium": [text]}, "it")
        assert chosen.sizes["medium"] == n_media


# -- the panels ------------------------------------------------------------------------------------


def test_few_curves_have_one_panel(many):
    few = many.isel(diameter=[0], width=[0, 1])
    assert not arrange(few, "longitudinal").has_panels
    said = []
    upper, lower = sweep_figure(few, tell=said.append).axes
    assert not said
    assert len(drawn(upper, "longitudinal-all")) == 8
    assert lower.get_ylabel().startswith("d log")
    # the value that a parameter has alone is told above
    assert "d = 4 mm" in upper.figure.get_suptitle().replace("\u00a0", " ")


@pytest.mark.slow
def test_too_many_curves_are_shared_out_among_panels(many):
    said = []
    figure = sweep_figure(many, tell=said.append)
    assert len(panels(figure)) == 6
    expected = many["longitudinal"].transpose(
        "diameter", "poisson_ratio", "medium", "width", "load"
    )
    places = itertools.product(range(3), range(2))
    for ax, (row, column) in zip(panels(figure), places, strict=True):
        lines = drawn(ax, "longitudinal-all")
        for line, velocities in zip(lines, expected.values[row, column].reshape(6, 3), strict=True):
            assert_array_equal(line, np.transpose([FORCE, velocities]))
        assert ax.get_ylim() == panels(figure)[0].get_ylim()
    assert [ax.get_title().replace("\u00a0", " ") for ax in panels(figure)[:2]] == [
        "ν = 0.1",
        "ν = 0.3",
    ]
    rows = [text.get_text().replace("\u00a0", " ") for ax in panels(figure) for text in ax.texts]
    assert rows == ["d = 4 mm", "d = 8 mm", "d = 12 mm"]
    assert texts(figure.legends[0])[:5] == [
        "averaged lattice",
        "effective medium",
        "W = 1 µm",
        "W = 2 µm",
        "W = 4 µm",
    ]
    assert figure.get_size_inches()[0] == 3.4
    figure.draw_without_rendering()
    assert_inside_page(figure)
    (sentence,) = said
    for words in ("columns [^,]*poisson_ratio", "rows [^,]*diameter", "--where"):
        assert re.search(words, sentence)


def test_rows_and_columns_are_those_that_a_user_names(many):
    data = many.isel(poisson_ratio=[0])
    figure = sweep_figure(data, variable="bulk", rows="medium", columns="width")
    assert len(panels(figure)) == 6
    expected = data["bulk"].transpose("medium", "width", "diameter", "load", "poisson_ratio")
    for number, ax in enumerate(panels(figure)):
        lines = drawn(ax, "bulk-all")
        for line, moduli in zip(lines, expected.values[divmod(number, 3)], strict=True):
            assert_array_equal(line[:, 1], moduli[:, 0])
    labels = {ax.get_ylabel().strip() for ax in panels(figure)}
    assert labels == {"", "Bulk modulus (GPa)"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rows": "widht"}, "--rows is widht.*width"),
        ({"columns": "force"}, "--columns is force"),
        ({"rows": "width", "columns": "width"}, "both width"),
    ],
)
def test_panels_that_are_not_swept_are_refused(many, options, words):
    with pytest.raises(InputError, match=words):
        sweep_figure(many, **options)


def test_panels_of_one_parameter_stand_in_lines():
    data = sweep(PACKING, force=FORCE[:2], width=[1e-6, 2e-6, 3e-6, 4e-6, 5e-6])
    figure = sweep_figure(data, columns="width")
    assert len(panels(figure)) == 5
    assert len(figure.axes) == 6
    figure.draw_without_rendering()
    assert_inside_page(figure)


def frame(**counts):
    """A data set of sweeps over so many values of parameters, which holds no numbers of states."""
    sizes = {"load": 2, "medium": 1, **counts}
    coordinates = {name: np.arange(1.0, count + 1.0) for name, count in counts.items()}
    coordinates |= {"force": ("load", [1.0, 2.0]), "medium": ["ala"]}
    values = (tuple(sizes), np.zeros(tuple(sizes.values())))
    data = xarray.Dataset({"valid": values, "longitudinal": values}, coordinates)
    data["density"].attrs["units"] = "kg/m^3"
    return data


def test_of_many_values_some_have_panels_and_what_has_no_place_is_held():
    data = frame(width=12, diameter=6, density=5, poisson_ratio=10)
    layout = arrange(data, "longitudinal", "force")
    assert (layout.columns, layout.rows) == ("density", "diameter")
    assert layout.shown == {"density": [0, 2, 4], "diameter": [0, 2, 3, 5], "poisson_ratio": [0]}
    sentence = layout.describe(data)
    for words in (
        "3 of 5 values of density",
        "4 of 6 values of diam",
        "poisson_ratio is held at 1",
    ):
        assert words in sentence
    panel = layout.select(data, 2, 0)
    assert panel["diameter"].values.tolist() == [3.0]
    assert dict(panel.sizes) == {
        "load": 2,
        "medium": 1,
        "width": 12,
        "diameter": 1,
        "density": 1,
        "poisson_ratio": 1,
    }
    with pytest.raises(InputError, match="60 panels"):
        arrange(data, "longitudinal", "force", rows="poisson_ratio", columns="diameter")


def test_too_many_panels_name_the_options_that_ask_for_them():
    data = frame(width=41, density=2)
    with pytest.raises(InputError, match=r"^--columns asks for 41 panels"):
        arrange(data, "longitudinal", "force", columns="width")
    with pytest.raises(InputError, match=r"^--rows and --columns ask for 82 panels"):
        arrange(data, "longitudinal", "force", rows="density", columns="width")


@pytest.mark.parametrize(
    ("counts", "columns"),
    [
        # shades of one parameter have an order, those of combinations none
        ({"width": 8, "density": 1}, None),
        ({"width": 2, "density": 2}, None),
        ({"width": 3, "density": 2}, "density"),
    ],
)
def test_combinations_have_panels_before_an_eye_must_find_them_among_shades(counts, columns):
    layout = arrange(frame(**counts), "longitudinal", "force")
    assert (layout.columns, layout.rows) == (columns, None)


def test_panels_of_one_combination_each_share_out_media_too():
    data = frame(width=3, density=3, diameter=3).isel(medium=[0, 0])
    layout = arrange(data, "longitudinal", "force", wants_single_curves=True)
    assert (layout.columns, layout.rows) == ("medium", "diameter")
    assert layout.shown == {"density": [0], "width": [0]}
    assert not arrange(
        data.isel(width=[0], density=[0]), "longitudinal", wants_single_curves=True
    ).shown
    named = arrange(data, "longitudinal", "force", columns="width", wants_single_curves=True)
    assert (named.columns, named.rows) == ("width", "medium")


@pytest.mark.parametrize(
    ("counts", "held"),
    [
        ({"load": 2, "medium": 1, "width": 4}, []),
        ({"load": 2, "medium": 1, "width": 3, "diameter": 3}, ["diameter"]),
        ({"load": 20, "width": 2}, ["width"]),
        ({"load": 4, "width": 12, "diameter": 9}, ["diameter", "load"]),
        ({"load": 40}, []),
    ],
)
def test_states_that_are_too_many_are_held_where_most_remain(counts, held):
    assert choose_held(counts, 8) == held


def test_over_a_parameter_some_of_many_loads_have_a_curve():
    data = sweep(PACKING, force=np.geomspace(1.0, 50.0, 30), width=[1e-6, 2e-6], media="ala")
    said = []
    figure = sweep_figure(data, "width", tell=said.append)
    (ax,) = figure.axes
    expected = data["longitudinal"].values[[0, 7, 14, 22, 29], 0]
    assert_array_equal([line[:, 1] for line in drawn(ax, "longitudinal-all")], expected)
    assert "5 of 30 values of force" in said[0]


def test_measured_points_stand_in_every_panel(many):
    measured = gp.Measurements([2.0, 20.0], [500.0, 700.0])
    data = many.isel(poisson_ratio=[0])
    figure = comparison_figure([data], columns="diameter", data=measured)
    assert len(panels(figure)) == 3
    for ax in panels(figure):
        (bars,) = ax.containers
        assert_array_equal(bars.lines[0].get_xydata(), [[2.0, 500.0], [20.0, 700.0]])
    with pytest.raises(InputError, match="one sweep"):
        comparison_figure([data, data.isel(load=[0])], rows="width")


def test_a_parameter_that_is_the_axis_stands_in_no_title(many):
    data = many.isel(diameter=[0], width=[0], medium=[0], load=[1])
    figure = comparison_figure([data], x="poisson_ratio")
    assert "ν" not in figure.get_suptitle()
    assert "d = 4 mm" in figure.get_suptitle().replace("\u00a0", " ")


# -- the command -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "content", "said"),
    [
        pytest.param(
            [],
            b"Longitudinal velocity",
            "columns of panels are poisson_ratio",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ["--where", "width=2 um, diameter=4mm", "--where", "poisson_ratio=0.1"],
            b"d log",
            "",
            marks=pytest.mark.slow,
        ),
        (
            [
                *("--x", "poisson_ratio", "--y", "bulk"),
                *("--where", "diameter=4 mm, width=1 um, medium=ala, force=1 N"),
            ],
            b"Bulk",
            "",
        ),
        pytest.param(
            [
                *("--columns", "poisson_ratio", "--y", "bulk"),
                *("--where", "diameter=4 mm, width=1 um, medium=ala"),
            ],
            b"Bulk",
            "",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ["--x", "width", "--rows", "medium", "--where", "force=1 N, diameter=4 mm"],
            b"Width",
            "",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ["--data", "times.csv", "--distance", "400 mm", "--columns", "medium"],
            b"data",
            "rows",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_command_draws_some_states_and_panels(
    folder, tmp_path, monkeypatch, capsys, words, content, said
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "times.csv").write_text("force (N),time (us)\n2,800\n8,600\n", encoding="utf-8")
    assert main(["plot", str(folder), "-o", "new.svg", *words]) == 0
    out, err = capsys.readouterr()
    *remarks, last = out.splitlines()
    assert (last, err) == ("Wrote new.svg", "")
    assert len(remarks) == bool(said)
    assert all(said in remark for remark in remarks)
    assert content in (tmp_path / "new.svg").read_bytes()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        pytest.param(["--where", "width=3 um"], "no width 3 um", marks=pytest.mark.slow),
        (["--where", "width=3"], "unit"),
        pytest.param(["--rows", "force"], "--rows is force", marks=pytest.mark.slow),
        pytest.param(["--distance", "1 m"], "--distance .*--data", marks=pytest.mark.slow),
        (["--distance", "1 N", "--data", "times.csv"], "--distance"),
        (["other", "--where", "spin=3"], "none of the runs"),
        pytest.param(["other", "--rows", "width"], "one sweep", marks=pytest.mark.slow),
    ],
)
def test_the_command_says_what_cannot_be_chosen_and_writes_nothing(
    folder, tmp_path, monkeypatch, capsys, many, words, told
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other").mkdir()
    write_sweep(many.isel(load=[0]), tmp_path / "other" / "sweep.nc")
    assert main(["plot", str(folder), "-o", "new.svg", *words]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert told.split(" .*")[0] in err
    assert not (tmp_path / "new.svg").exists()
