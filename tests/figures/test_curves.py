"""Several runs in one figure: what is plotted is read back, and so are the words of legends and of
errors.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.base.errors import InputError, MissingFileError
from granphon.cli.main import main
from granphon.figures.curves import (
    MOST_LOOKS,
    Curve,
    Look,
    _write_legend,
    comparison_figure,
    draw_curve,
    make_looks,
    plot_sweep,
    plot_together,
    read_curve,
)
from granphon.figures.words import describe_medium, join_facts
from granphon.fits.fit import fit_width
from granphon.fits.measurements import Measurements
from granphon.media.choice import MediumChoice
from granphon.scene.redraw import draw_together, read_run
from granphon.scene.scene import Scene
from tests.figures.conftest import PATH, drawn

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
GLASS = gp.Material(70e9, 0.22, 2500.0)
SPREAD = gp.Uniform(2.04e-6)
FORCE = np.geomspace(2.0, 50.0, 5)
ARRAYS = {"simulation": {"shape": (4, 4), "samples": 2}}


def balls(material=STEEL, **more):
    return gp.Packing(material, 8e-3, **{"spread": SPREAD, **more})


@pytest.fixture(scope="module")
def steel():
    return gp.sweep(balls(), force=FORCE, media=["ema", ARRAYS])


@pytest.fixture(scope="module")
def glass():
    return gp.sweep(balls(GLASS), force=FORCE, media="ema")


@pytest.fixture(scope="module")
def fcc():
    return gp.sweep(gp.Packing(STEEL, 8e-3, lattice="fcc"), force=FORCE)


@pytest.fixture(scope="module")
def fit():
    exact = gp.sound_velocities(gp.EffectiveMedium(balls()).at_force(FORCE)).longitudinal
    return fit_width(balls(), FORCE, exact * (1.0 + 0.01 * np.array([1, -1, 1, -1, 1])), 5.0)


def texts(ax):
    (legend,) = ax.legends if isinstance(ax, Figure) else [ax.get_legend()]
    return [
        text.get_text().replace("\u00a0", " ").replace("\n", " ") for text in legend.get_texts()
    ]


# -- curves ----------------------------------------------------------------------------------------


def test_curves_of_several_sweeps_are_their_numbers(steel, glass, ax):
    assert plot_together([steel, glass], ax) is ax
    lines = drawn(ax, "longitudinal-all")
    for line, (data, medium) in zip(lines, ((steel, 0), (steel, 1), (glass, 0)), strict=True):
        assert_array_equal(line, np.stack([FORCE, data.longitudinal[:, medium]], axis=1))
    assert (ax.get_xlabel(), ax.get_ylabel()) == (
        "Contact force (N)",
        "Longitudinal velocity (m/s)",
    )
    colours = [line.get_color() for line in ax.lines if line.get_gid() == "longitudinal-all"]
    assert len(set(colours)) == 3
    # the legend says what differs, the title what is shared
    # what has no heading does not stand below that of another
    assert texts(ax)[0] == "E = 70 GPa, ν = 0.22, ρ = 2500 kg/m³, effective medium"
    assert texts(ax)[-3:] == [
        "E = 211.65 GPa, ν = 0.276, ρ = 7840 kg/m³:",
        "effective medium",
        "simulation, 2 samples of 4 x 4 balls",
    ]
    assert (
        ax.get_title().replace("\u00a0", " ")
        == "triangular lattice, d = 8 mm, W = 2.04 µm, with friction"
    )


def test_a_run_of_one_curve_stands_below_the_heading_that_it_shares(steel, glass, ax):
    again = gp.sweep(balls(), force=FORCE, media="ala")
    plot_together([again, steel, glass], ax)
    assert texts(ax)[-4:] == [
        "E = 211.65 GPa, ν = 0.276, ρ = 7840 kg/m³:",
        "averaged lattice",
        "effective medium",
        "simulation, 2 samples of 4 x 4 balls",
    ]
    assert "E = 70 GPa, ν = 0.22, ρ = 2500 kg/m³, effective medium" in texts(ax)[:-4]


@pytest.mark.slow
def test_a_medium_of_a_sweep_is_drawn_as_it_is_alone():
    media = ["ema", {"simulation": PATH}]
    both = gp.sweep(balls(), force=[2.0, 8.0, 5.0], media=media)
    for number, medium in enumerate(media):
        curves = [
            read_curve(both.isel(medium=[number]), "longitudinal", "force", {"medium": 0}),
            read_curve(both, "longitudinal", "force", {"medium": number}),
            read_curve(
                gp.sweep(balls(), force=[2.0, 8.0, 5.0], media=[medium]),
                "longitudinal",
                "force",
                {"medium": 0},
            ),
        ]
        assert [curve.is_path for curve in curves] == [bool(number)] * 3
        for curve in curves:
            assert_array_equal(curve.x, [2.0, 8.0, 5.0] if number else [2.0, 5.0, 8.0])
            assert_array_equal(curve.y, curves[0].y)


def test_names_and_results_of_another_kind_are_told(steel, ax):
    for name, junk in {"x": 1, "y": ["bulk"], "data": 1.0}.items():
        with pytest.raises(InputError, match=name):
            plot_together([steel], ax, **{name: junk})
    with pytest.raises(InputError, match="results are 3"):
        plot_together(3, ax)


def test_any_quantity_has_its_standard_errors(steel, ax):
    plot_together([steel], ax, y="bulk", x="pressure")
    (bars,) = ax.containers
    ends = np.array(bars.lines[2][0].get_segments())[..., 1]
    assert_allclose(np.ptp(ends, axis=1), 2.0 * steel.bulk_error[:, 1], rtol=1e-6)
    assert_array_equal(drawn(ax, "bulk-all")[0][:, 0], steel.pressure[:, 0])
    assert ax.get_xlabel() == "Pressure (N/m)"


def test_names_stand_for_what_the_curves_of_a_run_share(steel, glass, ax):
    plot_together({"first": steel, "second": glass}, ax)
    assert texts(ax)[0] == "second"
    assert texts(ax)[-3:] == ["first:", "effective medium", "simulation, 2 samples of 4 x 4 balls"]


def test_runs_that_are_alike_are_told_apart_by_their_names(glass, ax):
    plot_together([glass, glass], ax)
    assert texts(ax) == ["result 1", "result 2"]


def test_parameters_of_a_sweep_are_facts_like_those_of_a_packing(ax):
    widths = gp.sweep(balls(), force=FORCE, media="ema", width=[1e-6, 0.0])
    one = gp.sweep(balls(spread=gp.Uniform(1e-6)), force=FORCE, media="afa", friction=[False])
    plot_together([widths, one], ax)
    own = "W = 1 µm, without friction, averaged force"
    assert texts(ax)[0] == own
    assert texts(ax)[-3:] == ["with friction, effective medium:", "W = 1 µm", "equal balls"]


def test_a_parameter_takes_the_place_of_the_load(ax):
    kinds = [
        gp.Ball(gp.Material(193e9, 0.3, 8000.0), d, name=name)
        for d, name in ((8e-3, "A"), (6e-3, "B"))
    ]
    values = {"A.mass": [1e-3, 2e-3, 3e-3], "B.mass": [1e-3, 2e-3]}
    data = gp.sweep(gp.Crystal.on("chain", kinds), force=[1.0, 10.0], **values)
    for draw in (
        lambda: plot_together([data], ax, x="A.mass"),
        lambda: plot_sweep(data, ax, x="A.mass"),
    ):
        ax.clear()
        draw()
        assert ax.get_xlabel() == "Mass of A (kg)"
        lines = [line for line in ax.lines if str(line.get_gid()).endswith("-valid")]
        assert len(lines) == 4
        for line, (mass, force) in zip(
            lines, [(m, f) for f in range(2) for m in range(2)], strict=True
        ):
            assert_array_equal(line.get_xdata(), values["A.mass"])
            wanted = data["longitudinal"].isel({"load": force, "B.mass": mass, "medium": 0})
            assert_array_equal(line.get_ydata(), wanted)
    assert {"force 10 N", "m = 0.002 kg of B"} <= {
        text.get_text() for text in ax.get_legend().get_texts()
    }
    with pytest.raises(InputError, match=r"'bulk' .*force, .*, A.mass, B.mass"):
        plot_together([data], ax, x="bulk")


def test_beyond_the_colours_dashes_tell_lines_apart(ax):
    looks = make_looks(MOST_LOOKS)
    assert len({(look.colour, look.dashes) for look in looks}) == MOST_LOOKS
    assert len({(look.colour, look.marker) for look in looks}) == MOST_LOOKS
    assert all(look.dashes != (3.0, 1.5) for look in looks)  # which are those outside the range
    many = gp.sweep(
        balls(), force=[3.0, 4.0], width=np.linspace(1e-6, 2e-6, MOST_LOOKS + 1).tolist()
    )
    with pytest.raises(InputError, match="25 curves"):
        plot_together([many], ax)


def test_dashes_are_not_filled_by_the_line_outside_the_range(ax):
    curve = Curve(
        "",
        {},
        np.arange(1.0, 7.0),
        np.arange(1.0, 7.0),
        np.full(6, np.nan),
        np.arange(6) > 2,
        np.zeros(6, bool),
    )
    draw_curve(ax, curve, make_looks(7)[-1], "y")
    assert_array_equal(
        np.isfinite(drawn(ax, "y-outside")[0][:, 1]), [True, True, True, True, False, False]
    )
    assert_array_equal(np.isfinite(drawn(ax, "y-valid")[0][:, 1]), curve.valid)
    (carrier,) = (line for line in ax.lines if line.get_gid() == "y-all")
    assert carrier.get_linestyle() == "None"


def test_states_that_differ_in_their_load_are_one_set_of_points(tmp_path, glass, ax):
    results = [run_scene(tmp_path, f"at{force}", f"force: {force} N") for force in (9, 4)]
    plot_together([*results, glass], ax)
    (points, _) = drawn(ax, "longitudinal-all")
    assert_array_equal(points[:, 0], [4.0, 9.0])
    assert_allclose(
        points[:, 1],
        gp.sound_velocities(gp.EffectiveMedium(balls()).at_force([4.0, 9.0])).longitudinal,
    )
    assert len(texts(ax)) == 2


def test_fits_bring_their_data(steel, fit, ax):
    plot_together([steel, fit], ax)
    (points,) = drawn(ax, "measured-0")
    assert_array_equal(points, np.stack([FORCE, fit.velocity], axis=1))
    line = drawn(ax, "longitudinal-all")[2]
    assert_allclose(line[:, 1], fit.velocity_at(line[:, 0]), rtol=1e-14)
    assert any(text.startswith("fitted W = ") and "±" in text for text in texts(ax))
    assert "data" in texts(ax)


# -- measured points -------------------------------------------------------------------------------


@pytest.mark.parametrize(("heading", "unit"), [("force (N)", 1.0), ("pressure (kN/m)", 1e-3)])
@pytest.mark.parametrize("x", ["force", "pressure", "reduced force"])
def test_data_stand_where_their_load_is(tmp_path, glass, ax, heading, unit, x):
    known = {
        "force": glass.force,
        "pressure": glass.pressure[:, 0],
        "reduced force": glass.reduced_force[:, 0],
    }
    given = np.asarray(known[heading.split()[0]]) * unit
    rows = [f"{load!r},{400 + n} m/s,2 %" for n, load in enumerate(given.tolist())]
    text = (
        "\n".join([f"{heading},velocity (m/s),sigma (%)", *rows])
        .replace(" m/s,", ",")
        .replace(" %\n", "\n")
    )
    (tmp_path / "mine.csv").write_text(text.removesuffix(" %"), encoding="utf-8")
    plot_together([glass], ax, x=x, data=tmp_path / "mine.csv")
    points, _, (bars,) = ax.containers[0].lines
    assert_allclose(points.get_xydata()[:, 0], known[x], rtol=1e-12)
    assert_allclose(points.get_xydata()[:, 1], 400.0 + np.arange(5))
    assert_allclose(
        [np.ptp(one[:, 1]) for one in bars.get_segments()], 0.04 * (400.0 + np.arange(5)), rtol=1e-9
    )
    assert points.get_color() == "black"


def test_two_fits_of_one_table_show_its_points_once(fit, ax):
    again = fit_width(balls(), fit.force, fit.velocity, fit.sigma, medium="afa")
    plot_together([fit, again], ax)
    assert len(ax.containers) == 1
    assert [text for text in texts(ax) if text.startswith("data")] == ["data"]
    other = fit_width(balls(), fit.force, fit.velocity * 1.001, fit.sigma)
    plot_together([fit, again, other], Figure().subplots())
    ax.clear()
    plot_together([fit, again, other], ax)
    assert len(ax.containers) == 2


def test_data_that_no_axis_holds(steel, fcc, ax):
    data = Measurements([2.0, 3.0], [400.0, 500.0])
    for results, options, told in (
        ([steel], {"y": "bulk"}, "share no axis with bulk"),
        ([steel], {"x": "overlap"}, "overlap .*not measured"),
        (
            [gp.sweep(balls(), force=[2.0], width=[1e-6, 2e-6])],
            {"x": "reduced_force"},
            "not the same multiple",
        ),
    ):
        with pytest.raises(InputError, match=told):
            plot_together(results, ax, data=data, **options)
    assert not ax.lines


def test_pressures_of_other_balls_are_asked_for_as_forces(tmp_path, steel, ax):
    (tmp_path / "mine.csv").write_text("pressure (N/m),velocity (m/s)\n400,500\n", encoding="utf-8")
    small = gp.sweep(gp.Packing(STEEL, 1e-3, SPREAD), force=FORCE, media="ala")
    with pytest.raises(
        InputError,
        match=r"multiple .*file",
    ):
        plot_together([steel, small], ax, data=tmp_path / "mine.csv")


# -- what cannot share an axis ---------------------------------------------------------------------


def test_what_cannot_share_an_axis_is_named(steel, fcc, fit, ax):
    chain = gp.sweep(gp.Packing(STEEL, 8e-3, lattice="chain"), force=FORCE)
    bands = gp.Phonons(gp.AveragedLattice(balls()).at_force(3.0)).bands("GK", npoints=3)
    square = gp.Phonons(gp.AveragedLattice(balls(lattice="square")).at_force(3.0)).bands(
        "GX", npoints=3
    )
    for results, options, told in (
        (
            {"a": steel, "b": fcc},
            {"x": "pressure"},
            "^a and b .*pressure.* N/m; b .* Pa",
        ),
        (
            {"a": steel, "b": fcc, "c": chain},
            {"y": "transverse"},
            "^b and c hold no transverse.*longitudinal",
        ),
        (
            {"a": steel, "b": bands},
            {},
            "^b holds bands.* a is a sweep",
        ),
        (
            {"a": bands, "b": square},
            {},
            "^the bands of a and b .*paths.*G-K.*G-X",
        ),
        ({"a": steel, "b": fit}, {"y": "bulk"}, "^b holds no bulk"),
        ({"a": steel}, {"y": "receptance"}, "^a holds no receptance. It has (?!.*receptance)"),
        ({"a": steel}, {"y": "longitudnal"}, "Did you mean longitudinal"),
        ({"a": steel}, {"x": "presure"}, "Did you mean pressure"),
        (
            {"a": fcc},
            {"x": "reduced_force"},
            "^reduced_force of a .*finite",
        ),
        ({"a": "text"}, {}, "'text' shares no figure with others"),
        ({}, {}, "nothing to draw"),
    ):
        with pytest.raises(InputError, match=told):
            plot_together(results, ax, **options)
    assert not ax.lines


# -- bands, and densities of states ----------------------------------------------------------------


def test_bands_of_which_nothing_is_known_leave_the_names_of_all(tmp_path, ax):
    result = run_scene(
        tmp_path, "bands", "force: 3 N", "medium: ala\nobserve: [bands]\nphonopy: {band_points: 3}"
    )
    alone = comparison_figure([result])
    assert drawn(alone.axes[0], "bands-0")
    plot_together([result, result.bands], ax)
    assert texts(ax) == ["result 1", "result 2"]
    assert ax.get_title() == ""


def test_bands_are_drawn_one_over_the_other(ax):
    phonons = [
        gp.Phonons(gp.AveragedLattice(balls(friction=one)).at_force(3.0)) for one in (True, False)
    ]
    bands = [one.bands("GKMG", npoints=5) for one in phonons]
    plot_together({"rough": bands[0], "smooth": bands[1]}, ax)
    for n, one in enumerate(bands):
        found = drawn(ax, f"bands-{n}")
        assert len(found) == 3 * one.n_branches
        assert_allclose(np.max([line[:, 1].max() for line in found]), one.frequencies.max() / 1e3)
    assert texts(ax) == ["rough", "smooth"]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["Γ", "K", "M", "Γ"]
    densities = [one.dos((4, 4)) for one in phonons]
    figure = comparison_figure(densities)
    assert_allclose(drawn(figure.axes[0], "dos-1")[0][:, 1], densities[1].total * 1e3)
    assert texts(figure) == ["result 1", "result 2"]


# -- gp.plot ---------------------------------------------------------------------------------------


def test_plot_takes_several_results_and_an_axes(steel, glass, ax):
    figure = gp.plot([steel, glass], y="transverse")
    assert len(drawn(figure.axes[0], "transverse-all")) == 3
    assert figure._repr_png_()[0].startswith(b"\x89PNG")
    own = ax.get_figure()
    assert gp.plot([steel, glass], axes=ax) is own
    assert type(own) is Figure
    assert gp.plot(glass, axes=ax) is own
    assert len(drawn(ax, "longitudinal-all")) == 4
    assert gp.plot([steel, glass], legend=False).legends == []
    with pytest.raises(InputError, match="option variable"):
        gp.plot([steel, glass], variable="bulk")


# -- words -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("medium", "words"),
    [
        ("ala", "averaged lattice"),
        ({"ema": {"local_field": "paper"}}, "effective medium, local field of the paper"),
        (
            {"simulation": {"shape": (32, 32), "samples": 4}},
            "simulation, 4 samples of 32 x 32 balls",
        ),
        ("simulation", "simulation, a sample of 128 x 128 balls"),
        (
            {"simulation": {"shape": (8, 8), "seed": 3, "geometry": "exact"}},
            "simulation, a sample of 8 x 8 balls, exact geometry, seed 3",
        ),
        (
            {
                "simulation": {
                    "shape": (8, 8),
                    "friction_history": True,
                    "friction_coefficient": 0.2,
                    "ordered": True,
                }
            },
            "simulation, a sample of 8 x 8 balls, friction coefficient 0.2, loaded with"
            " friction, as a path",
        ),
        (
            {
                "simulation": {
                    "shape": (8, 8),
                    "friction_history": True,
                    "friction_coefficient": 0.2,
                    "start": "gas",
                }
            },
            "simulation, a sample of 8 x 8 balls, friction coefficient 0.2, loaded with"
            " friction, from the gas",
        ),
        (
            {
                "simulation": {
                    "shape": (8, 8),
                    "friction_history": True,
                    "friction_coefficient": 0.2,
                    "start": 0.6,
                }
            },
            "simulation, a sample of 8 x 8 balls, friction coefficient 0.2, loaded with"
            " friction, from a* of 0.6",
        ),
        ({"auto": {"tolerance": 1e-2}}, "automatic medium, error below 1 %"),
    ],
)
def test_media_are_named_in_words(medium, words):
    label = MediumChoice.parse(medium).label
    found = describe_medium(label)
    assert found == words
    assert "=" not in found


def test_cells_of_several_balls_are_called_cells():
    assert describe_medium("simulation", 3, 2) == "simulation, a sample of 24 x 24 x 24 cells"


def test_lines_of_a_legend_break_between_facts():
    assert (
        join_facts(["E = 1 GPa", "ρ = 2500 kg/m³"], 12).replace("\u00a0", " ")
        == "E = 1 GPa,\nρ = 2500 kg/m³"
    )


def test_an_automatic_medium_shows_which_medium_served(ax):
    data = gp.sweep(balls(), force=[3.0, 10.0, 200.0], media={"auto": {"tolerance": 0.02}})
    served = [str(label).partition("(")[0] for label in data["choice"].values[:, 0]]
    assert len(set(served)) == 2
    data["valid"].values[-1] = False  # its mark is hollow
    plot_sweep(data, ax)
    names = [line.get_gid() for line in ax.lines if "longitudinal-served" in line.get_gid()]
    assert len(names) == len(set(names)) == 3  # names are ids in an SVG, of one line each
    for name in set(served):
        is_served = np.array(served) == name
        gid = f"longitudinal-served-{name}"
        marked = [*drawn(ax, gid), *drawn(ax, f"{gid}-hollow")]
        points = np.stack([data.force, data.longitudinal[:, 0]], axis=1)
        assert_array_equal(np.concatenate(marked), points[is_served])
    assert len({line.get_marker() for line in ax.lines if "served" in line.get_gid()}) == len(
        set(served)
    )
    assert {f"{describe_medium(name)} served" for name in served} <= set(texts(ax))


# -- the command -----------------------------------------------------------------------------------


def run_scene(place: Path, name: str, load: str, more: str = "medium: ema"):
    text = f"""material: {{young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}}
packing: {{diameter: 8 mm, spread: {{uniform: 2.04 um}}}}
load: {{{load}}}
{more}
"""
    (place / f"{name}.yaml").write_text(text, encoding="utf-8")
    return Scene.from_yaml(place / f"{name}.yaml").run(place / name, figures=False)


@pytest.fixture(scope="module")
def folders(tmp_path_factory, fit):
    place = tmp_path_factory.mktemp("runs")
    run_scene(place, "sweep", "force: [2 N, 5 N, 20 N]")
    run_scene(place, "one", "side_force: 300 N, balls_per_side: 7")
    (place / "bands").mkdir()
    bands = gp.Phonons(gp.AveragedLattice(balls()).at_force(3.0)).bands(npoints=3)
    bands.write(place / "bands" / "band.yaml")
    fit.write(place / "fit")
    rows = ["side_force (N),velocity (m/s)", "300,500", "600,600"]
    (place / "side.csv").write_text("\n".join(rows), encoding="utf-8")
    return place


@pytest.mark.slow
def test_the_command_draws_folders_and_measurements_in_one_figure(folders, monkeypatch):
    monkeypatch.chdir(folders)
    words = "plot sweep one fit --data side.csv --x pressure -o all.pdf"
    assert main(words.split()) == 0
    assert (folders / "all.pdf").read_bytes().startswith(b"%PDF")


def test_the_command_draws_files_in_one_figure(folders, monkeypatch, capsys):
    monkeypatch.chdir(folders)
    assert main(["plot", "sweep/sweep.nc", "fit/fit.yaml", "one/summary.yaml"]) == 0
    assert "Wrote comparison.png" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "label"),
    [
        ("fit", b"Residual"),
        pytest.param(
            "sweep --x overlap --y contact_fraction",
            b"Fraction of contacts",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_command_draws_one_folder_over_another_load(
    folders, tmp_path, monkeypatch, words, label
):
    monkeypatch.chdir(folders)
    assert main(["plot", *words.split(), "-o", str(tmp_path / "one.svg")]) == 0
    assert label in (tmp_path / "one.svg").read_bytes()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        pytest.param("sweep bands/band.yaml", "bands/band.yaml.* share", marks=pytest.mark.slow),
        ("sweep nowhere", "nowhere"),
        ("sweep sweep", "sweep .*twice"),
        pytest.param("sweep one --y exponnt", "exponent", marks=pytest.mark.slow),
        ("sweep one -o x.txt", "x.txt.* format"),
        pytest.param("sweep fit --data side.csv", "side.csv.* side", marks=pytest.mark.slow),
        ("sweep one --asymptotes", "--asymptotes"),
        ("sweep side.csv", "side.csv .*results"),
        ("fit sweep/sweep.csv", "sweep/sweep.csv .*results"),
        ("sweep sweep.yaml", "sweep.yaml .*results"),
    ],
)
def test_the_command_says_in_one_line_what_is_wrong_and_writes_nothing(
    folders, monkeypatch, capsys, words, told
):
    monkeypatch.chdir(folders)
    before = sorted(folders.rglob("*"))
    assert main(["plot", *words.split(), *["-o", "new.png"] * ("-o" not in words)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert re.search(told, err)
    assert sorted(folders.rglob("*")) == before


def test_a_summary_of_another_schema_is_refused(folders, tmp_path):
    shutil.copytree(folders / "one", tmp_path / "one")
    text = (tmp_path / "one" / "summary.yaml").read_text()
    (tmp_path / "one" / "summary.yaml").write_text(text.replace("schema: 1", "schema: 2"))
    with pytest.raises(InputError, match=r"summary\.yaml .*schema 2\..* schema 1"):
        read_run(tmp_path / "one" / "summary.yaml")
    # a summary stands for the data set beside it
    (tmp_path / "one" / "summary.yaml").write_text(text)
    (tmp_path / "one" / "sweep.nc").unlink()
    with pytest.raises(MissingFileError, match=r"no .*sweep\.nc"):
        read_run(tmp_path / "one" / "summary.yaml")


def test_a_run_that_is_exchanged_while_it_is_read_is_not_drawn(folders, tmp_path, monkeypatch):
    from granphon.figures import curves

    def exchange(*_, **__):
        rewrite(tmp_path)
        return Figure()

    run_scene(tmp_path, "other", "force: 3 N")
    monkeypatch.setattr(curves, "comparison_figure", exchange)
    with pytest.raises(InputError, match="while it was read"):
        draw_together([tmp_path / "other", folders / "sweep"], tmp_path / "x.png")
    assert not (tmp_path / "x.png").exists()
    with pytest.raises(MissingFileError):
        draw_together([tmp_path / "none"], tmp_path / "x.png")
    with pytest.raises(InputError, match="twice"):  # one folder, written in two ways
        draw_together([folders / "sweep", f"{folders}/./sweep/"], tmp_path / "x.png")


def rewrite(place: Path) -> None:
    text = (place / "other.yaml").read_text(encoding="utf-8")
    (place / "other.yaml").write_text(text.replace("3 N", "4 N"), encoding="utf-8")
    Scene.from_yaml(place / "other.yaml").run(place / "other", force=True, figures=False)


def test_two_sweeps_in_one_figure_have_a_legend_of_their_values_and_not_of_their_curves(ax):
    """12 curves: 3 widths, 2 media, 2 runs, of which each pair looks different."""
    widths = [1e-6, 2e-6, 4e-6]
    sweeps = {
        name: gp.sweep(balls(material), force=[20.0, 30.0], width=widths, media=["ala", "afa"])
        for name, material in (("mine", STEEL), ("yours", GLASS))
    }
    plot_together(sweeps, ax)
    texts = [text.get_text().replace("\xa0", " ") for text in ax.get_legend().get_texts()]
    assert {"averaged lattice", "averaged force", "W = 2 µm", "mine", "yours"} <= set(texts)
    assert len(texts) <= 3 + 2 + 2 + 1
    carriers = [line for line in ax.lines if str(line.get_gid()).endswith("-all")]
    lines = [line for line in ax.lines if str(line.get_gid()).endswith("-valid")]
    assert len(carriers) == len(lines) == 12
    looks = {(tuple(line.get_color()), str(line._dash_pattern)) for line in lines}
    assert len(looks) == 12


# -- edges -----------------------------------------------------------------------------------------


def test_a_result_that_is_in_no_list_is_refused(steel, ax):
    for results in (steel, "steel"):
        with pytest.raises(InputError, match="Give a list"):
            plot_together(results, ax)
    for axes in (3, [ax]):
        with pytest.raises(InputError, match="axes"):
            gp.plot(steel, axes=axes)


def test_a_parameter_of_one_of_two_runs_is_no_common_axis(steel, ax):
    widths = gp.sweep(balls(), force=[20.0, 30.0], width=[1e-6, 2e-6])
    with pytest.raises(InputError, match=r"result 2 is not swept over .*width"):
        plot_together([widths, steel], ax, x="width")
    with pytest.raises(InputError, match="medium"):
        plot_together([widths, steel], ax, x="medium")


def test_measured_points_have_no_place_over_a_parameter(ax):
    data = Measurements(np.array([1.0, 2.0]), np.array([300.0, 310.0]))
    alone = gp.sweep(balls(), force=[1.0], width=[1e-6])
    with pytest.raises(InputError, match="width of measured points"):
        plot_together([alone], ax, x="width", data=data)


def test_falls_along_a_path_are_marked_where_the_medium_is_not_valid_too(ax):
    x = np.array([1.0, 3.0, 2.0, 1.0])
    is_valid = np.array([True, True, True, False])
    all_true = np.ones(4, bool)
    curve = Curve("run", {}, x, 2.0 * x, np.nan * x, is_valid, all_true, is_path=True)
    draw_curve(ax, curve, Look("black"), "path")
    (hollow,) = drawn(ax, "path-falling-all")
    (full,) = drawn(ax, "path-falling")
    assert_array_equal(hollow[:, 0], [2.0, 1.0])
    assert_array_equal(full[:, 1], [4.0, np.nan])


def test_a_curve_stands_below_the_heading_of_another_run_that_holds_for_it():
    def curve(run, medium, width):
        facts = {"medium": medium, "spread": width}
        return Curve(run, facts, *(np.ones(2) for _ in range(3)), *(np.ones(2, bool),) * 2)

    curves = [curve("a", "ala", "1"), curve("a", "ala", "2"), curve("b", "ala", "3")]
    curves.append(curve("b", "ema", "4"))
    labels, shared = _write_legend(curves)
    assert labels == [("ala:", "1"), ("ala:", "2"), ("ala:", "3"), ("", "ema, 4")]
    assert shared == []
    assert _write_legend(curves[:1]) == ([("", "ala")], ["1"])


def test_more_bands_than_looks_are_refused(ax):
    phonons = gp.Phonons(gp.AveragedLattice(balls()).at_force(3.0))
    bands = phonons.bands("GM", npoints=3)
    with pytest.raises(InputError, match="too many"):
        plot_together([bands] * (MOST_LOOKS + 1), ax)
    without_vectors = phonons.bands("GM", npoints=3, eigenvectors=False)
    plot_together([bands, without_vectors], ax)
    for lines, these in zip(("bands-0", "bands-1"), (bands, without_vectors), strict=True):
        heights = np.sort([line[:, 1] for line in drawn(ax, lines)], axis=None)
        assert_allclose(heights, np.sort(these.frequencies, axis=None) / 1e3)
