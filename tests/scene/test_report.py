"""The report of a folder of results."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import granphon as gp
from granphon.base.errors import InputError
from granphon.base.text import dump_yaml, read_yaml
from granphon.cli.main import main
from granphon.page.document import Picture, Rows, write_markdown
from granphon.scene import report
from granphon.scene.report import PAPER, read_report
from granphon.scene.scene import Scene

SCENE = """\
material: {young_modulus: 70 GPa, poisson_ratio: 0.22, density: 2500 kg/m^3}
packing: {diameter: 1 mm, spread: {uniform: 4 um}}
"""
SWEEP = (
    SCENE
    + """\
load: {force: [0.05 N, 10 N]}
medium: [ala, ema]
sweep: {poisson_ratio: [0.1, 0.2, 0.3]}
"""
)
ONE = SCENE + "load: {force: 5 N}\nmedium: ema\n"


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Runs of a sweep and of one state."""
    place = tmp_path_factory.mktemp("runs")
    for name, text in (("sweep", SWEEP), ("one", ONE)):
        (place / f"{name}.yaml").write_text(text, encoding="utf-8")
        Scene.from_yaml(place / f"{name}.yaml").run(place / name, figures=name == "sweep")
    return place


def collect(folder):
    title, sections = read_report(folder)
    return title, {section.title: section.blocks for section in sections}


def test_the_report_of_a_sweep_has_its_numbers_figures_and_warnings(folders):
    title, parts = collect(folders / "sweep")
    assert "sweep.yaml" in title
    assert list(parts) == [part.title for part in report.PARTS if part.title in parts]
    data = gp.load_sweep(folders / "sweep" / "sweep.nc")
    (states,) = parts["States"]
    assert isinstance(states, Rows)
    assert len(states.rows) == data["valid"].size == 12
    heading = next(name for name in states.headings if name.startswith("longitudinal"))
    size = {"(km/s)": 1e3, "(m/s)": 1.0}[heading.split()[-1]]
    column = states.headings.index(heading)
    velocities = [float(row[column]) * size for row in states.rows]
    assert velocities == pytest.approx(data["longitudinal"].values.ravel(), rel=1e-5)
    assert [row[1] for row in states.rows[:6]] == ["ala"] * 3 + ["ema"] * 3
    (warnings,) = parts["Warnings"]
    assert len(warnings.items) == 2
    (figure,) = parts["Figures"]
    assert isinstance(figure, Picture)
    assert figure.data == (folders / "sweep" / "sweep.png").read_bytes()
    assert ("granphon", gp.__version__) in parts["Versions"][0].rows
    assert "Fit" not in parts


def test_the_report_of_one_state_has_its_numbers_and_limits(folders):
    _, parts = collect(folders / "one")
    rows = dict(parts["Numbers"][0].rows)
    state = gp.EffectiveMedium(
        gp.Packing(gp.Material(70e9, 0.22, 2500.0), 1e-3, gp.Uniform(4e-6))
    ).at_force(5.0)
    velocity = gp.sound_velocities(state).longitudinal
    number, unit = rows["longitudinal velocity"].split()
    assert float(number) * {"km/s": 1e3, "m/s": 1.0}[unit] == pytest.approx(velocity, rel=1e-4)
    assert rows["contact force"] == "5 N"
    assert any("radius" in row[0] for row in parts["Limits of the model"][0].rows)
    # no figure was drawn, and a state alone is no table
    assert "granphon plot" in parts["Figures"][0].text
    assert "States" not in parts


def test_limits_say_on_which_side_they_are(folders):
    _, parts = collect(folders / "one")
    (limits,) = parts["Limits of the model"]
    bounds = {(row[0], row[2].rsplit(" ", 1)[0]) for row in limits.rows}
    assert ("contact force in N", "at least") in bounds
    assert {side for _, side in bounds} == {"at least", "at most"}


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        ([7.05e9, 15.3e9], [3.02e7, 6.04e7], "7.05 GPa to 15.3 GPa +/- 0.03 GPa to 0.06 GPa"),
        ([950.0, 1250.0], [1.0, 2.0], "950 m/s to 1.25 km/s +/- 0.001 km/s to 0.002 km/s"),
        # numbers in no order, such as those of branches, are no range, nor are their errors
        ([950.0, 1250.0, 3.0], [1.0, 2.0, 0.5], "950, 1250, 3 m/s +/- 1, 2, 0.5 m/s"),
        ([[950.0, 1250.0]], [[1.0, 2.0]], "950.0 +/- 1.0 m/s to 1.2500 +/- 0.0020 km/s"),
        (
            [[2e9, 1e9, 0.0], [1e9, 2e9, 0.0], [0.0, 0.0, 5e8]],
            [[2e6, 1e6, 0.0], [1e6, 2e6, 0.0], [0.0, 0.0, 5e5]],
            "2, 1, 0; 1, 2, 0; 0, 0, 0.5 +/- 0.002, 0.001, 0; 0.001, 0.002, 0; 0, 0, 0.0005 GPa",
        ),
    ],
)
def test_an_error_has_the_unit_of_its_value(value, error, text):
    unit = "Pa" if "GPa" in text else "m/s"
    is_range = isinstance(value[0], float) and " to " in text
    assert report._write_value(value, unit, error, is_range=is_range) == text


@pytest.mark.parametrize(
    ("force", "longitudinal"),
    [("20 N", re.compile(r"\d+\.\d+, \d+\.\d+ m/s")), ("[10 N, 20 N]", re.compile(r".* to .*"))],
)
def test_directions_and_what_they_have_are_no_ranges(tmp_path, force, longitudinal):
    """Velocities along two directions of one state stand beside each other in ascending order too;
    of several states they have a least and a greatest one.
    """
    text = SCENE.replace("1 mm", "1 mm, lattice: square") + f"load: {{force: {force}}}\n"
    Scene.from_text(text + "direction: [[1, 0], [0.6, 0.8]]\n").run(tmp_path / "out", figures=False)
    (table,) = collect(tmp_path / "out")[1]["Numbers"]
    numbers = dict(table.rows)
    assert numbers["direction"] == "1, 0; 0.6, 0.8"
    for branch in ("longitudinal", "transverse"):
        assert longitudinal.fullmatch(numbers[f"{branch} velocity"])


def test_a_direction_in_ascending_order_is_no_range(tmp_path):
    text = SCENE.replace("1 mm", "1 mm, lattice: square") + "load: {force: [5 N, 9 N]}\n"
    Scene.from_text(text + "direction: [0, 1]\n").run(tmp_path / "out", figures=False)
    (table,) = collect(tmp_path / "out")[1]["Numbers"]
    assert dict(table.rows)["direction"] == "0, 1"


def test_a_folder_that_is_no_path_is_refused():
    with pytest.raises(InputError, match="path is 5"):
        read_report(5)


def test_the_citation_is_that_of_the_project(folders):
    citation = (Path(__file__).parents[2] / "CITATION.cff").read_text(encoding="utf-8")
    for key in ("title", "journal", "volume", "start", "year"):
        (value,) = re.findall(rf"    {key}: \"?(.+?)\"?$", citation, re.MULTILINE)
        short = {"Physical Review E": "Phys. Rev. E"}.get(value, value)
        assert short in PAPER
    assert all(name in PAPER for name in re.findall(r"family-names: (.+)", citation))
    _, parts = collect(folders / "one")
    assert PAPER in parts["How to cite"][1].items[0]


@pytest.mark.slow
def test_figures_that_a_user_has_drawn_into_the_folder_are_in_the_report(folders, capsys):
    folder = folders / "sweep"
    words = ["plot", str(folder), "--y", "bulk", "-o", str(folder / "stiff.svg"), "--force"]
    assert main(words) == 0
    (folder / "mine.png").write_bytes(b"not granphon's")
    _, parts = collect(folder)
    assert [picture.name for picture in parts["Figures"]] == ["sweep.png", "stiff.svg"]


def test_the_command_writes_a_supplement_that_finds_the_figures(folders, tmp_path):
    figures = folders / "sweep"
    assert main(["report", str(figures), "-o", str(tmp_path / "more" / "supplement.md")]) == 0
    text = (tmp_path / "more" / "supplement.md").read_text(encoding="utf-8")
    (path,) = re.findall(r"\]\((.*sweep\.png)\)", text)
    assert (tmp_path / "more" / path).resolve() == (figures / "sweep.png").resolve()


@pytest.mark.slow
def test_the_command_replaces_a_report_if_told_and_a_later_run_removes_it(tmp_path, capsys):
    (tmp_path / "one.yaml").write_text(ONE, encoding="utf-8")
    Scene.from_yaml(tmp_path / "one.yaml").run(tmp_path / "out", figures=False)
    assert main(["report", str(tmp_path / "out")]) == 0
    assert main(["report", str(tmp_path / "out")]) == 1
    assert "already holds report.html" in capsys.readouterr().err
    assert main(["report", str(tmp_path / "out"), "--force"]) == 0
    assert (tmp_path / "out" / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE")
    Scene.from_text(ONE.replace("5 N", "6 N")).run(tmp_path / "out", force=True, figures=False)
    assert not list((tmp_path / "out").glob("report.*"))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["nowhere"], "no folder nowhere"),
        (["one.yaml"], "is no folder"),
        (["."], "holds no results"),
        (["one", "-o", "report.pdf"], "report.pdf.*html"),
        (["one", "-o", ""], "--out is empty"),
    ],
)
def test_what_has_no_report_is_one_line(folders, monkeypatch, capsys, words, told):
    monkeypatch.chdir(folders)
    before = sorted(folders.rglob("*"))
    assert main(["report", *words]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert re.search(told, err)
    assert sorted(folders.rglob("*")) == before


def test_a_damaged_summary_is_refused(folders, tmp_path):
    text = (folders / "one" / "summary.yaml").read_text(encoding="utf-8")
    for damaged in ("- 1\n", text.replace("schema: 1", "schema: 7"), "a: [\n"):
        (tmp_path / "summary.yaml").write_text(damaged, encoding="utf-8")
        with pytest.raises(InputError, match=r"summary\.yaml"):
            read_report(tmp_path)


def test_data_of_another_kind_in_a_summary_are_named(folders, tmp_path):
    summary = read_yaml(folders / "one" / "summary.yaml")
    for key, part in (("observe", "Numbers"), ("files", "Files"), ("validity", "Limits")):
        assert key in summary
        (tmp_path / "summary.yaml").write_text(dump_yaml(summary | {key: 5}), encoding="utf-8")
        with pytest.raises(InputError, match=f"damaged.*{part}"):
            read_report(tmp_path)
    summary |= {"force": 10**400}
    (tmp_path / "summary.yaml").write_text(dump_yaml(summary), encoding="utf-8")
    with pytest.raises(InputError, match=r"damaged.*Numbers"):
        read_report(tmp_path)


def test_words_of_a_summary_are_written_as_texts_whatever_they_are(folders, tmp_path):
    summary = read_yaml(folders / "one" / "summary.yaml")
    check = {"meaning": 5, "value": 1.0, "limit": 2.0, "ok": True}
    wrong = {"warnings": [5], "errors_from": {"force": 6}, "validity": [check]}
    (tmp_path / "summary.yaml").write_text(dump_yaml(summary | wrong), encoding="utf-8")
    text = write_markdown(*read_report(tmp_path))
    for words in ("- 5", "6 | contact force", "| 5 | 1 | at most 2 |"):
        assert words in text


def test_results_that_are_exchanged_while_they_are_read_have_no_report(folders, monkeypatch):
    records = iter([{"a": "1"}, {"a": "1"}, {"a": "2"}])
    monkeypatch.setattr(report, "read_written_files", lambda _: next(records))
    with pytest.raises(InputError, match="while it was read"):
        read_report(folders / "one")


def test_of_very_many_states_some_are_listed_with_a_link_to_all(folders, monkeypatch):
    monkeypatch.setattr(report, "MOST_STATES", 5)
    _, parts = collect(folders / "sweep")
    remark, states = parts["States"]
    assert len(states.rows) == 5
    assert "5 of 12 states" in remark.text
    assert remark.write_html().count('href="sweep.csv"') == 1
    assert remark.write_markdown("my out").endswith("[sweep.csv](my%20out/sweep.csv).")
    monkeypatch.setattr(report, "MOST_STATES", 12)
    (whole,) = collect(folders / "sweep")[1]["States"]
    assert (states.rows[0], states.rows[-1]) == (whole.rows[0], whole.rows[-1])
