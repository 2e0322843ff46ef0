"""The table of outputs: what each row says, and that whatever is written is read and drawn again."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import granphon as gp
from granphon.base.errors import InputError
from granphon.cli.main import main
from granphon.figures import plot
from granphon.figures.style import save_figure
from granphon.scene.outputs import (
    OUTPUTS,
    Results,
    every_file,
    expected_files,
    list_figures,
    list_outputs,
)
from granphon.scene.redraw import View, redraw
from granphon.scene.scene import Scene

STEEL = (
    "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
    "packing: {diameter: 8 mm, lattice: square}\nload: {force: 5 N}\n"
)
ALL = (
    "observe: [velocities, bands, gaps, dos, surface]\nsurface: {axis: 1, points: 3}\n"
    "phonopy: {band_points: 3, mesh: 6 6 1, dim: 4 3 1}\n"
)
#: the commands that write files of results
COMMANDS = ("run", "report", "fit", "tradeoff")


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A run of a single state that has bands, gaps, a density of states and an edge."""
    return Scene.from_text(STEEL + ALL).run(tmp_path_factory.mktemp("all") / "out", figures=False)


@pytest.mark.parametrize("name", OUTPUTS)
def test_every_row_says_what_it_writes_and_has_the_functions_for_it(name):
    row = OUTPUTS[name]
    assert row.name == name
    assert row.command in COMMANDS
    assert row.words or not row.files
    assert row.occasion or not row.files
    # the run itself writes the summary, which names the other files, and those of a path that ends
    # early; a report is written where its user says
    is_of_command = name in ("summary", "sweep_incomplete", "report")
    assert (row.write is not None) == (bool(row.numbers) and not is_of_command)
    assert (row.draw is not None) == bool(row.figure)
    assert row.caption or not row.figure
    assert set(row.files) == {*row.numbers, *filter(None, [row.figure])}


def test_a_file_is_of_one_row_and_a_fit_is_no_earlier_result_of_a_run():
    counts = Counter(name for row in OUTPUTS.values() for name in row.files)
    assert set(counts.values()) == {1}
    assert set(counts) - set(every_file()) == {*OUTPUTS["fit"].files, *OUTPUTS["tradeoff"].files}


def test_values_are_those_of_the_files(done):
    assert {path.name for path in done.files} == set(expected_files(done.scene, figures=False))
    read = Results(done.folder)
    kept = [row for row in list_outputs(done.scene) if row.find is not None and row.read]
    assert [row.name for row in kept] == ["limits", "surface", "bands", "dos"]
    assert read["surface"] == done.surface
    np.testing.assert_array_equal(read["gaps"], done.gaps)
    for name in ("bands", "dos"):
        frequencies = done[name].frequencies
        np.testing.assert_allclose(
            read[name].frequencies, frequencies, atol=1e-8 * frequencies.max()
        )
    assert read.dataset.identical(done.dataset)
    assert read["pulse"] is None  # which the run did not observe


def test_a_result_that_is_read_has_what_was_written(done):
    read = done.scene.run(done.folder, resume=True)
    assert read.surface == done.surface
    assert read.phonons.dim == done.phonons.dim == (4, 3)
    told = read.summary()
    for name, value in done.summary().items():
        if name == "top_frequency":  # from band.yaml, which has ten decimals
            assert told[name] == pytest.approx(value, rel=1e-9)
        else:
            np.testing.assert_array_equal(told[name], value, name)


@pytest.mark.slow
def test_every_figure_of_a_folder_is_drawn_by_its_name(done, tmp_path):
    rows = list_figures(done.folder)
    assert {row.stem for row in rows} == {"sweep", "surface", "bands", "dos"}
    read = Results(done.folder)
    for row in rows:
        target = redraw(done.folder, tmp_path / row.figure)
        save_figure(row.make_figure(read), tmp_path / "again.png")
        assert target.read_bytes() == (tmp_path / "again.png").read_bytes()
    assert redraw(done.folder, tmp_path / "any.pdf").exists()


@pytest.mark.parametrize("stem", ["pulse", "forces", "tradeoff", "response", "sweep_dos"])
def test_a_figure_that_a_folder_cannot_give_is_named(done, tmp_path, stem):
    with pytest.raises(InputError, match=f"holds no {stem}"):
        redraw(done.folder, tmp_path / f"{stem}.png")


def test_results_of_a_folder_that_is_named_are_read(done):
    results = gp.Results(str(done.folder))
    assert results.dataset.identical(done.dataset)
    limits = results["limits"]
    assert limits == done["limits"]
    assert [check["name"] for check in limits["validity"]] == [
        check.name for check in done.validity.checks
    ]
    with pytest.raises(InputError, match="path is 5"):
        gp.Results(5)


@pytest.mark.parametrize("flag", ["force", "figures", "resume"])
def test_a_flag_of_a_run_that_is_no_truth_value_is_named(tmp_path, flag):
    with pytest.raises(InputError, match=f"{flag}: found 'no'"):
        Scene.from_text(STEEL).run(tmp_path / "out", **{flag: "no"})
    assert not (tmp_path / "out").exists()


def test_a_name_that_no_figure_has_is_no_figure(done):
    with pytest.raises(InputError, match=r"'band\.png'.*bands\.png"):
        done.figure("band.png")


def test_a_folder_without_states_says_so(tmp_path):
    with pytest.raises(InputError, match=r"holds no sweep\.nc"):
        _ = Results(tmp_path).dataset


def test_a_folder_without_a_summary_has_no_limits_and_no_errors(tmp_path):
    assert [Results(tmp_path)[name] for name in ("limits", "errors")] == [None, None]


def test_a_summary_whose_errors_have_no_names_is_refused(tmp_path):
    (tmp_path / "summary.yaml").write_text("schema: 1\nerrors_from: 5\n")
    with pytest.raises(InputError, match="errors_from is 5"):
        _ = Results(tmp_path)["errors"]


def test_a_folder_in_place_of_a_file_of_json_is_named(tmp_path):
    (tmp_path / "surface.json").mkdir()
    with pytest.raises(InputError, match=r"surface\.json cannot be read"):
        _ = Results(tmp_path)["surface"]


@pytest.mark.parametrize(
    ("name", "files", "word"),
    [
        (["mine"], ["mine.csv"], "name"),
        ("mine", ["mine.csv", "mine.csv"], "twice"),
        ("mine", ["mi\0ne.csv"], "no file of an output"),
    ],
)
def test_names_that_no_output_can_have_are_refused(name, files, word):
    with pytest.raises(InputError, match=word):
        gp.register_output(name, files, "a table", write=write_mine)


def test_several_states_have_the_same_rows_but_those_of_one():
    one = {row.name for row in list_outputs(Scene.from_text(STEEL + "observe: [bands, dos]"))}
    loads = STEEL.replace("5 N", "[5 N, 9 N]")
    many = {row.name for row in list_outputs(Scene.from_text(loads + "observe: [bands]"))}
    assert one - many == {"numbers", "limits", "bands", "force_constants", "dos"}
    assert many - one == {"sweep", "ranges"}


@pytest.mark.parametrize("name", OUTPUTS)
def test_what_is_of_one_state_and_what_of_many_its_row_alone_says(name):
    row = OUTPUTS[name]
    assert row.is_of_number({}) == (row.states != "many")
    assert row.is_of_number({"load": 2}) == (row.states != "one")


def test_a_run_draws_nothing_of_an_earlier_run_in_its_folder(tmp_path, monkeypatch):
    """The density of states of other balls stood beside the bands, if both runs had one folder."""
    drawn = []

    def draw(bands, dos, **_options):
        drawn.append((bands, dos))
        return Figure()

    monkeypatch.setattr("granphon.figures.bands.bands_figure", draw)
    short = "phonopy: {band_points: 3, mesh: 6 6 1}\n"
    soft = STEEL.replace("211.65", "2.1165")
    Scene.from_text(soft + short + "observe: [bands, dos]").run(tmp_path, figures=False)
    result = Scene.from_text(STEEL + short + "observe: [bands]").run(tmp_path, force=True)
    assert drawn == [(result.bands, None)]


def test_a_sweep_in_python_and_a_scene_refuse_waves_with_the_case(steel):
    packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2e-6))
    media = [{"simulation": {"shape": (4, 4), "seed": seed}} for seed in (0, 1)]
    with pytest.raises(InputError, match=r"^simulation\(shape=4 4\): "):
        gp.sweep(packing, force=[5.0], media=media, pulse={"frequency": 1e9})


@pytest.mark.slow
def test_a_figure_is_drawn_with_what_its_function_takes_and_nothing_else(tmp_path, monkeypatch):
    text = STEEL.replace("5 N", "[1 N, 5 N]") + "observe: [gaps]\nsweep: {diameter: [4 mm, 8 mm]}\n"
    folder = Scene.from_text(text).run(tmp_path / "out", figures=False).folder
    diameters = []

    def draw(dataset, stem, **options):
        diameters.append((stem, dataset["diameter"].values.tolist(), options.get("rows")))
        return draw_dataset(dataset, stem, **options)

    draw_dataset = plot.draw_dataset
    monkeypatch.setattr(plot, "draw_dataset", draw)
    figure = tmp_path / "sweep_gaps.pdf"
    redraw(folder, figure)
    redraw(folder, figure, force=True, view=View({"diameter": ["8 mm"]}))
    redraw(folder, figure, force=True, view=View(rows="diameter"))
    both = [4e-3, 8e-3]
    assert diameters == [
        ("sweep_gaps", both, None),
        ("sweep_gaps", [8e-3], None),
        ("sweep_gaps", both, "diameter"),
    ]
    before = figure.read_bytes()
    with pytest.raises(InputError, match="variable"):
        redraw(folder, figure, force=True, variable="top_frequency")
    assert figure.read_bytes() == before
    assert redraw(folder, tmp_path / "top.pdf", variable="top_frequency").exists()


def test_a_figure_of_a_plug_in_may_take_the_choice_of_states(tmp_path, monkeypatch):
    wishes = []

    def draw(results, where=None):
        wishes.append(where)
        return figure_of(results)

    gp.register_output("mine", ["mine.csv", "mine.png"], "a table", write=write_mine, draw=draw)
    scene = Scene.from_text(STEEL.replace("5 N", "[1 N, 5 N]") + "observe: [mine]\n")
    folder = scene.run(tmp_path / "out").folder
    redraw(folder, tmp_path / "mine.pdf", view=View({"force": ["1 N"]}))
    assert wishes == [None, {"force": ["1 N"]}]


def write_mine(_results, folder):
    (folder / "mine.csv").write_text("1\n", encoding="utf-8")


def figure_of(_results):
    figure = Figure()
    figure.subplots()
    return figure


@pytest.mark.parametrize(
    ("observed", "name"),
    [
        ("cutoffs", "cutoffs.csv"),
        pytest.param("sensitivities", "sensitivities.csv", marks=pytest.mark.slow),
        pytest.param("cutoffs", "sweep.csv", marks=pytest.mark.slow),
    ],
)
def test_a_file_that_is_not_drawn_by_itself_names_the_command_that_draws_it(
    tmp_path, capsys, observed, name
):
    text = f"""\
material: {{young_modulus: 70 GPa, poisson_ratio: 0.22, density: 2500 kg/m^3}}
packing: {{diameter: 1 mm}}
load: {{force: 5 N}}
observe: [{observed}]
"""
    folder = tmp_path / "out"
    Scene.from_text(text).run(folder, figures=False)
    assert main(["plot", str(folder / name)]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    (command,) = re.findall(r"'granphon (plot [^']+)'", message)
    words = command.split(" ")
    out = [] if "-o" in words else ["-o", str(tmp_path / f"{name}.png")]
    assert main([*words, *out]) == 0
    drawn = Path((words + out)[-1])
    assert drawn.stat().st_size > 1000
