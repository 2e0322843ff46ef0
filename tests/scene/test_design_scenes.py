"""Scenes that seek a design: closed forms, files and resumed runs."""

from __future__ import annotations

import csv
import dataclasses
import math
import pickle
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.cli.main import main
from granphon.inverse.search import Problem
from granphon.media import cost as costs
from granphon.page.document import Rows
from granphon.scene.report import read_report

BALLS = """\
balls:
  S: {material: {young_modulus: 193 GPa, poisson_ratio: 0.30, density: 8000 kg/m^3}, diameter: 19 mm}
  A: {material: {young_modulus: 73.5 GPa, poisson_ratio: 0.33, density: 2700 kg/m^3}, diameter: 19 mm}
"""
CHAIN = (
    BALLS
    + "crystal: {lattice: chain, kinds: [S, S], friction: false}\n"
    + "load: {force: 20 N}\n"
    + "observe: [design]\n"
)
MASSES = CHAIN + (
    "design:\n"
    "  goal: widest_gap\n"
    "  vary: {mass: [9 g, 50 g]}\n"
    "  constraints: {mass: 57 g}\n"
    "  restarts: 2\n"
)
EDGE = CHAIN.replace("[S, S]", "[A, S]") + (
    "design:\n"
    "  goal: {match_frequencies: {measured: [8 kHz], sigma: 1 Hz, q: [[0]], branches: [1]}}\n"
    "  vary: {load.force: [1 N, 300 N]}\n"
    "  restarts: 0\n"
)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("design") / "out"
    return gp.Scene.from_text(MASSES).run(folder)


@pytest.mark.claim("design-scene")
def test_two_masses_of_given_sum_have_the_widest_gap_at_the_extreme_ratio(result):
    design = result.design
    assert_allclose(np.sort(design.variables), [9e-3, 48e-3], rtol=1e-9)
    k = result.state.network.normal_stiffness[0]
    edges = [math.sqrt(2.0 * k / mass) / (2.0 * math.pi) for mass in (48e-3, 9e-3)]
    assert_allclose(design.value, edges[1] - edges[0], rtol=1e-9)
    assert result.summary()["design"]["value"] == design.value
    assert result.warnings == ()


def read_rows(path):
    """The rows of a table."""
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_the_folder_has_the_design_its_tables_and_its_figure(result):
    read = gp.Scene.from_text(MASSES).run(result.folder, resume=True)
    assert read.design == result.design
    rows = read_rows(result.folder / "design.csv")
    assert [row["variable"] for row in rows] == list(result.design.labels)
    assert [float(row["best"]) for row in rows] == result.design.variables.tolist()
    assert {row["unit"] for row in rows} == {"kg"}
    history = read_rows(result.folder / "design_history.csv")
    assert [float(row["goal (Hz)"]) for row in history] == result.design.history.tolist()
    assert (result.folder / "design.png").is_file()
    titles = [section.title for section in read_report(result.folder)[1]]
    assert "Design" in titles


def test_the_report_rounds_the_numbers_of_the_design(result):
    (section,) = (part for part in read_report(result.folder)[1] if part.title == "Design")
    (table,) = (block for block in section.blocks if isinstance(block, Rows))
    assert table.headings == ("variable", "unit", "start", "best", "low", "high")
    for shown, row in zip(table.rows, read_rows(result.folder / "design.csv"), strict=True):
        label, unit, *numbers = row.values()
        assert shown == (label, unit, *(f"{float(number):.6g}" for number in numbers))


def test_the_figure_has_the_history_and_the_bands_at_both_ends(result):
    left, start, best = result.figure("design.png").axes
    assert_allclose(left.lines[0].get_ydata(), result.design.history)
    assert not [patch for patch in start.patches if patch.get_height() > 1.0]
    lower, upper = gp.Phonons(result.design.network).gaps()[0] / 1e3
    assert any(np.allclose(patch.get_bbox().intervaly, (lower, upper)) for patch in best.patches)
    network = gp.Scene.from_text(CHAIN.replace("[design]", "[velocities]")).state().network
    wall = network.cut(0, 2, edges=("clamped", "free"))
    goal = gp.MatchFrequencies(0.9 * gp.Waves(wall).modes(2).frequencies)
    finite = gp.design(wall, goal, bounds=(9e-3, 50e-3), restarts=0)
    _left, right = gp.plot(finite).axes
    assert len(right.lines) == 2


def test_a_load_puts_a_band_edge_where_the_scene_wants_it(tmp_path, capsys):
    """At Gamma the optical frequency goes as the sixth root of the force."""
    path = tmp_path / "scene.yaml"
    path.write_text(EDGE, encoding="utf-8")
    assert main(["check", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "1: force" in printed
    assert main(["run", str(path), "-o", str(tmp_path / "out"), "--no-figures"]) == 0
    assert "1 unknown" in capsys.readouterr().out
    design = gp.Scene.from_yaml(path).run(tmp_path / "out", resume=True, figures=False).design
    edge = gp.Phonons(design.start).frequencies([[0.0]])[0, 1]
    assert_allclose(design.variables, 20.0 * (8e3 / edge) ** 6, rtol=1e-7)


def test_measured_frequencies_may_stand_in_a_table(tmp_path):
    table = tmp_path / "measured.csv"
    table.write_text("frequency (kHz),sigma (Hz)\n8,1\n", encoding="utf-8")
    path = tmp_path / "scene.yaml"
    text = EDGE.replace("[8 kHz]", "measured.csv").replace("1 Hz", "measured.csv")
    path.write_text(text, encoding="utf-8")
    scene = gp.Scene.from_yaml(path)
    assert scene.design.goal == gp.Scene.from_text(EDGE.replace("1 Hz", "[1 Hz]")).design.goal
    assert table in scene.origin.inputs


def test_a_table_may_have_a_name_that_begins_with_a_digit(tmp_path):
    table = tmp_path / "2024.csv"
    table.write_text("frequency (kHz)\n8\n", encoding="utf-8")
    path = tmp_path / "scene.yaml"
    path.write_text(EDGE.replace("[8 kHz]", "2024.csv"), encoding="utf-8")
    scene = gp.Scene.from_yaml(path)
    assert scene.design.goal == gp.Scene.from_text(EDGE).design.goal
    assert table in scene.origin.inputs


@pytest.mark.parametrize("sigma", [".5 Hz", " 0.5 Hz", "+0.5 Hz"])
def test_a_standard_error_is_a_quantity_however_it_begins(sigma):
    design = gp.Scene.from_text(EDGE.replace("1 Hz", f"'{sigma}'")).design
    assert dict(design.goal[1])["sigma"] == 0.5


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"goal": ("widest_gap", 5)}, "goal.widest_gap: found 5"),
        ({"goal": {"widest_gap": False}}, "goal.widest_gap: found false"),
        ({"vary": (1, 2)}, "vary: found"),
        ({"vary": {"mass": (0.0, math.inf)}}, "vary.mass: found"),
        ({"constraints": (1, 2)}, "constraints: found"),
    ],
)
def test_settings_of_a_design_in_python_are_refused_by_name(changes, words):
    with pytest.raises(InputError) as caught:
        gp.DesignSettings(**{"goal": "widest_gap", "vary": {"mass": (0.01, 0.04)}} | changes)
    assert words in str(caught.value)


def test_a_tensor_of_a_load_does_not_vary():
    text = CHAIN.replace("{force: 20 N}", "{stress: [-20 N]}").replace("[design]", "[velocities]")
    scene = gp.Scene.from_text(text)
    settings = gp.DesignSettings(goal="widest_gap", vary={"stress": (-30.0, -10.0)})
    with pytest.raises(InputError, match="'stress'"):
        dataclasses.replace(scene, observe=("design",), design=settings)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (MASSES, "touch"),
        (MASSES.replace("chain", "triangular").replace("[S, S]", "[S]"), "overlap"),
        (MASSES.replace("[S, S]", "[A, S]"), ""),
    ],
)
def test_a_gap_that_is_closed_at_the_start_is_told_so(text, told):
    text = text.partition("  constraints")[0]
    posed = gp.Scene.from_text(text).posed_design
    _, (_, value, unit) = posed.describe()
    assert (told in value) if told else (value > 1e3 and unit == "Hz")


@pytest.mark.parametrize(
    "design",
    [
        "goal: {widest_gap: {near: 5 kHz, mesh: [24]}}\n  vary: {S.density: [7000 kg/m^3, 9 g/cm^3]}",
        "goal: lowest_velocity\n  vary: {stiffness: [1 MN/m, 30 MN/m], mass: [1 g, 40 g]}",
        "goal: {response_at: {frequency: 5 kHz, source: 2 x, receiver: [3 x], loss_factor: 0.1}}\n"
        "  vary: {on_site: [0 N/m, 1 MN/m]}\n  per: kind\n  repeat: 4",
        EDGE.partition("design:\n  ")[2].strip(),
    ],
)
def test_a_design_is_written_as_it_is_read(design):
    scene = gp.Scene.from_text(f"{CHAIN}design:\n  {design}\n")
    assert gp.Scene.from_text(scene.to_yaml()) == scene


def test_a_run_that_was_cut_off_goes_on_with_the_starts_that_are_missing(
    result, tmp_path, monkeypatch
):
    searched = []
    search = Problem.search

    def stop(problem, number):
        searched.append(number)
        if searched == [0, 1]:
            raise KeyboardInterrupt
        return search(problem, number)

    monkeypatch.setattr(Problem, "search", stop)
    scene = gp.Scene.from_text(MASSES)
    with pytest.raises(KeyboardInterrupt):
        scene.run(tmp_path / "out", figures=False)
    assert not list((tmp_path / "out").glob("design*"))
    again = gp.Scene.from_text(MASSES).run(tmp_path / "out", figures=False)
    assert searched == [0, 1, 1, 2]
    assert again.design == result.design


def test_a_worker_searches_as_this_process_does():
    (task,) = gp.Scene.from_text(EDGE).posed_design.tasks
    sent = pickle.loads(pickle.dumps(task))
    assert sent.name == task.name
    result = sent.solve()
    assert_allclose(result["best"], task.solve()["best"], rtol=1e-12)


def test_the_cost_counts_all_steps_of_all_starts():
    cost = gp.Scene.from_text(MASSES).posed_design.cost
    assert cost.units[0].number == 3 * 200
    assert "2 unknowns" in cost.parts[0]


def test_the_cost_of_few_slow_evaluations_is_told_and_one_is_timed_once(monkeypatch):
    design = gp.Scene.from_text(EDGE + "  steps: 2\n").posed_design
    timed = []

    def time_slow(evaluate):
        timed.append(evaluate())
        return 0.9

    monkeypatch.setattr(costs, "time_once", time_slow)
    assert design.cost.tells
    assert design.cost.seconds == 2 * 0.9
    ((value, derivatives),) = timed
    assert value == design.problem.start_value
    assert derivatives.shape == (1,)


#: a crystal whose factors are large
LARGE = (
    BALLS
    + "crystal: {lattice: fcc, kinds: [S], friction: true, repeat: 8 8 8, replace: {12: A}}\n"
    + "load: {force: 20 N}\n"
)
OF_LARGE = LARGE + (
    "observe: [design]\n"
    "design:\n"
    "  goal: {GOAL}\n"
    "  vary: {mass: [1 g, 100 g]}\n"
    "  per: kind\n"
    "  restarts: 0\n"
    "  steps: 1\n"
)
GOALS = {
    "velocity": "lowest_velocity: {direction: [1, 0, 0]}",
    "modes": "match_frequencies: {measured: [3 kHz, 3.1 kHz, 3.2 kHz]}",
    "response": "response_at: {frequency: 5 kHz, source: [0 x], receiver: [300 x]}",
}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the peak memory is in kilobytes on Linux")
@pytest.mark.parametrize("case", ["sensitivities", *GOALS])
def test_a_run_takes_the_memory_that_check_tells(tmp_path, case):
    text = LARGE + "observe: [sensitivities]\n"
    if case in GOALS:
        text = OF_LARGE.replace("GOAL", GOALS[case])
    scene = gp.Scene.from_text(text)
    told = scene.posed_design.cost if case in GOALS else scene.cost()
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    # ru_maxrss would be that of the process that starts this one, where that is larger
    code = (
        "import re, sys, granphon as gp\n"
        "gp.Scene.from_yaml(sys.argv[1]).run(sys.argv[2], figures=False)\n"
        "print(re.search(r'VmHWM:\\s*(\\d+) kB', open('/proc/self/status').read())[1])\n"
    )
    command = [sys.executable, "-c", code, str(path), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    peak = 1024.0 * float(done.stdout.split()[-1])
    assert 0.5 * peak < told.memory < 2.0 * peak


def test_the_certificate_of_a_gap_is_in_the_cost():
    design = gp.Scene.from_text(MASSES).posed_design
    search, *certificates = design.cost.units
    # q and -q of a mesh four times finer, and the edges of a gap, at both ends of the search
    assert certificates[0].number > 2 * 0.5 * 4 * 48
    assert search.number == 3 * 200
    # the frequencies of six branches, on a mesh finer than that of the search
    space = design.problem.space
    network = space.make_network(space.start)
    certificate = design.problem.goals[0].estimate_certificate(network)
    assert design.cost.memory >= costs.NUMBA_BYTES + certificate.working > costs.NUMBA_BYTES
