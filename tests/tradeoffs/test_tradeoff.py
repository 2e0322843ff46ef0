"""Speed against accuracy: errors that can be worked out by hand, a budget that is kept, and what is
written of it.
"""

from __future__ import annotations

import csv
import io
import math
import os
import re
import signal
import subprocess
import sys
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext, suppress
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.balls.loads import Load
from granphon.base.errors import FileExistsInRunError, GranphonError, InputError
from granphon.cli.main import main
from granphon.cli.terminal import describe_tradeoff
from granphon.figures.work_precision import tradeoff_figure
from granphon.runs.finished_tasks import encode, open_store
from granphon.tradeoffs import measure as tradeoffs
from granphon.tradeoffs.measure import (
    JUDGING_RATIO,
    Deadline,
    MeasuredPoint,
    MediaStudy,
    Point,
    Reference,
    Stopwatch,
    carry_out,
    observe,
    tradeoff,
)
from tests.conftest import only
from tests.waiting import HANGS

WIDTH = 2.04e-6
BUDGET = 40.0
FORCES = (10.0, 60.0)
SCENE = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 2.04 um}}
load: {force: [10 N, 60 N]}
medium: ema
"""


class WorkCounter(Stopwatch):
    """Counts work, so that no test depends on how busy the machine is.

    Time goes on a little whenever it is asked for, as the checks within long work do, and else by
    what is told: :meth:`work`, or each part of a piece of work that is named in ``parts``. It is a
    progress as well, to hear of these.
    """

    def __init__(self, **parts):
        self.time = 100.0
        self.asked = 0
        self.parts = parts
        self.label = ""

    def now(self):
        self.asked += 1
        self.time += 1e-6 * (1.0 + self.asked % 7)
        return self.time

    def predict(self, cost):
        """On a machine that works on a million balls in a second."""
        return 1e-6 * cost.work

    def work(self, seconds):
        self.time += seconds

    def step(self, label, total=None):
        self.label = label
        return nullcontext(self)

    def advance(self, amount=1.0):
        self.work(amount * self.parts.get(self.label, 0.0))


#: fewer and smaller samples than those of the study, and the least of them
SMALL = {"sides": (8,), "counts": (1, 2), "reference_side": 16}
LEAST = {"sides": (8,), "counts": (1,), "reference_side": 12}


@pytest.fixture(scope="module")
def measured():
    """``tradeoff`` with few knobs and counted work: a sample of the media's reference takes
    ``sample`` s.
    """

    def call(*arguments, sample=3.0, knobs=SMALL, **options):
        counter = WorkCounter(**{"media: reference": sample})
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                tradeoffs,
                "carry_out",
                lambda study, *rest: carry_out(replace(study, **knobs), *rest),
            )
            return tradeoff(*arguments, **options, progress=counter, stopwatch=counter)

    return call


@pytest.fixture(scope="module")
def found(rough, measured):
    """A trade-off of it."""
    return measured(rough, force=FORCES, observe=("velocities", "bands"), budget=BUDGET)


def point_of(result, method, knob):
    (point,) = (p for p in result.points if (p.method, p.knob) == (method, knob))
    return point


def media(packing, force=FORCES, **options):
    """A study of all quantities."""
    quantities = "longitudinal", "transverse", "frequency"
    return MediaStudy(packing, Load("force", force), quantities, WorkCounter(), **options)


@pytest.fixture
def asked(monkeypatch):
    """What :func:`carry_out` is asked for by a trade-off, which goes no further: a study, and what
    is to be done with it.
    """
    calls = []

    def refuse(*given):
        calls.append(given)
        raise InputError("enough")

    monkeypatch.setattr(tradeoffs, "carry_out", refuse)
    return calls


def whenever():
    """A deadline that never comes."""
    return Deadline(WorkCounter(), math.inf)


# -- counted work ----------------------------------------------------------------------------------


class FakeStudy:
    """Points that take so many seconds and have such errors, and a reference that takes its
    time.
    """

    name = "fake"
    quantities = ("longitudinal",)
    load = Load("force", (1.0, 2.0))
    condition = 1.0

    def __init__(self, clock, costs, reference=0.0, fails=(), estimated=False):
        self.stopwatch = clock
        self.costs = costs
        self.taken = reference
        self.fails = fails
        self.estimated = estimated
        self.solved = []

    def make_points(self):
        return [self._point(*one) for one in self.costs]

    def _point(self, method, knob, seconds, error):
        def prepare(run):
            self.stopwatch.work(0.1 * seconds)
            return run

        def solve(run):
            if knob in self.fails:
                raise GranphonError(f"{knob} does not converge.")
            self.stopwatch.work(0.9 * seconds * (1.0 + 0.1 * run))
            self.solved.append((knob, run))
            return 1.0 + error * np.array([[1.0], [0.5]])

        return Point(method, knob, prepare, solve, seconds if self.estimated else 0.0)

    def find_reference(self, deadline, better, step):
        self.until = deadline.until
        if self.taken is None:
            raise GranphonError("it cannot be found.")
        self.stopwatch.work(self.taken)
        found = Reference(np.ones((2, 1)), np.full((2, 1), 1e-6), "by hand")
        self.good = better(found)
        return found


@pytest.fixture
def clock():
    """For the trade-off and its studies."""
    return WorkCounter()


@pytest.mark.parametrize("by_executor", [False, True])
def test_a_finished_study_is_kept_until_its_trade_off_is(clock, tmp_path, by_executor):
    """It is not measured again; another trade-off is refused, and nothing is left at the end."""

    def run(study, store, budget=1000.0):
        with ThreadPoolExecutor(1) if by_executor else nullcontext() as executor:
            return carry_out(
                study, budget=budget, executor=executor, store=store, identity={"budget": budget}
            )

    first, other, again = (
        FakeStudy(clock, [("m", "a", 2.0, 1e-2), ("n", "b", 1.0, 1e-3)]) for _ in range(3)
    )
    with suppress(KeyboardInterrupt), open_store(tmp_path / "store") as store:
        expected = run(first, store)
        raise KeyboardInterrupt
    with (
        pytest.raises(FileExistsInRunError, match=r"1000\.0 .* 5\.0"),
        open_store(tmp_path / "store") as store,
    ):
        run(other, store, 5.0)
    with open_store(tmp_path / "store") as store:
        assert run(again, store) == expected
    assert [bool(study.solved) for study in (first, other, again)] == [True, False, False]
    assert list(tmp_path.iterdir()) == []
    assert [point.ran for point in expected.points] == [True] * 2
    assert expected.reference == "by hand"


def test_studies_of_another_friction_coefficient_are_those_of_another_trade_off(
    rough, asked, tmp_path
):
    for coefficient in (0.2, 0.2000001):
        with pytest.raises(InputError, match="enough"):
            tradeoff(rough, force=FORCES, friction_history=True, friction_coefficient=coefficient)
    with open_store(tmp_path / "store") as store:
        store.claim(asked[0][-1])
        store.append("study", encode("study", {"seconds": np.ones(1)}))
        with pytest.raises(
            FileExistsInRunError,
            match=r"against\.friction_coefficient .* 0\.2 .* 0\.2000001",
        ):
            store.claim(asked[1][-1])


class RandomStudy(FakeStudy):
    """Its points draw random errors."""

    def _point(self, method, knob, seconds, error):
        def solve(run):
            self.stopwatch.work(seconds)
            self.solved.append((knob, run))
            return 1.0 + error * np.random.default_rng(run).normal(size=(2, 1))

        return Point(method, knob, lambda run: run, solve, random=True)


def test_cheap_random_points_are_drawn_until_their_error_is_known(clock):
    """In half of the time that the timed runs leave: a hundred times at most, each with numbers of
    its own.
    """
    study = RandomStudy(clock, [("m", "cheap", 0.01, 0.1), ("m", "dear", 2.0, 0.01)])
    cheap, dear = carry_out(study, budget=100.0).points
    assert [run for knob, run in study.solved if knob == "cheap"] == [*range(6), 0, *range(6, 101)]
    # two fifths of the budget, less the timed runs, and half of that
    assert dear.draws == 5 + int((0.5 * (40.0 - 7 * 2.01) - 0.95 - 1.0) / 2.0)
    assert cheap.draws == 100
    for point, scale in ((cheap, 0.1), (dear, 0.01)):
        drawn = scale * np.array(
            [np.random.default_rng(run).normal(size=2) for run in range(1, point.draws + 1)]
        )
        assert_allclose(point.errors[:, 0], np.sqrt(np.mean(drawn**2, axis=0)), rtol=1e-12)
        # of the mean square s^2 the error is sqrt(2/n) s^2 in normal numbers, of its root half as
        # much
        assert_allclose(
            point.stderrs[:, 0], point.errors[:, 0] / np.sqrt(2.0 * point.draws), rtol=0.8
        )
        twin = [
            np.sqrt(np.mean(np.delete(drawn, i, axis=0) ** 2, axis=0)) for i in range(point.draws)
        ]
        # the jackknife
        assert_allclose(
            point.stderrs[:, 0], np.std(twin, axis=0) * np.sqrt(point.draws - 1), rtol=0.2
        )
        assert point.stderr == point.stderrs.flat[np.argmax(point.errors)]
    (one,) = carry_out(FakeStudy(clock, [("m", "a", 1.0, 1e-2)]), budget=1e3).points
    assert (one.draws, one.stderr) == (5, 0.0)


def test_a_random_point_without_an_error_has_no_error_of_it(clock):
    (point,) = carry_out(RandomStudy(clock, [("m", "exact", 0.01, 0.0)]), budget=10.0).points
    assert point.draws > 5
    assert (point.error, point.stderr, point.floor) == (0.0, 0.0, 0.0)


class FailingStudy(RandomStudy):
    """Its points fail in their eighth run."""

    def _point(self, method, knob, seconds, error):
        point = super()._point(method, knob, seconds, error)

        def solve(run):
            if run == 8:
                raise GranphonError("does not converge.")
            return point.solve(run)

        return replace(point, solve=solve)


def test_a_further_draw_that_fails_ends_the_draws_of_its_point_alone(clock):
    study = FailingStudy(clock, [("m", "1", 0.01, 0.1), ("m", "2", 0.01, 0.1)])
    points = carry_out(study, budget=100.0).points
    assert [(point.draws, point.failure) for point in points] == [(7, ""), (7, "")]


@pytest.mark.slow
def test_the_error_of_a_small_simulation_is_that_over_many_seeds(rough, found, reference):
    """Five runs of 8 x 8 balls told 2.6e-2 of what is 6.6e-2, without a word of how well that is
    known.
    """
    small = point_of(found, "simulation, 1 sample", "8 x 8")
    assert small.draws == 100
    states = (
        observe(gp.DirectSimulation(rough, (8, 8), seed).at_force(np.array(FORCES)))
        for seed in range(5000, 5100)
    )
    squares = np.array([(state / reference.values - 1.0) ** 2 for state in states])
    errors = np.sqrt(np.mean(squares, axis=0))
    own = np.std(squares, axis=0) / 10.0 / (2.0 * errors)
    known = np.hypot(
        np.hypot(small.stderrs, own), np.hypot(small.reference_errors, reference.errors)
    )
    assert np.all(np.abs(small.errors - errors) < 4.0 * known)
    assert np.all(small.stderrs < 0.25 * small.errors)


def test_times_are_medians_of_warm_runs_without_what_is_made_ready(clock):
    study = FakeStudy(clock, [("m", "a", 1.0, 1e-2)])
    (point,) = carry_out(study, budget=1e3, runs=5).points
    # one to warm up, five that are timed, one whose memory is watched
    assert study.solved == [("a", run) for run in (0, 1, 2, 3, 4, 5, 0)]
    assert_allclose(point.seconds, 0.9 * 1.3, rtol=1e-4)
    # quartiles of 1.1 ... 1.5
    assert_allclose(point.spread, 0.9 * 0.15, rtol=1e-3)
    assert_allclose(point.setup, 0.1, rtol=1e-4)
    assert_allclose(point.errors, [[1e-2], [5e-3]])
    assert (point.error, point.reference_error) == (pytest.approx(1e-2), 1e-6)
    assert (point.resolved, point.note, point.floor) == (True, "", np.finfo(float).eps)


def test_memory_is_that_of_the_run_also_under_a_trace_of_the_user():
    point = SimpleNamespace(prepare=lambda run: run, solve=lambda _: bytes(1_000_000))
    alone = tradeoffs._watch_memory(point)
    assert not tracemalloc.is_tracing()
    tracemalloc.start()
    try:
        held = bytes(20_000_000)
        traced = tradeoffs._watch_memory(point)
        assert tracemalloc.is_tracing()
        assert tracemalloc.get_traced_memory()[0] > len(held)
    finally:
        tracemalloc.stop()
    assert_allclose([alone, traced], 1_000_000, rtol=0.1)


@pytest.mark.claim("tradeoff-budget")
def test_what_does_not_fit_is_listed_and_the_rest_is_run(clock):
    costs = [
        ("m", "1", 0.1, 1e-2),
        ("m", "2", 50.0, 1e-3),
        ("m", "3", 0.1, 1e-4),
        ("n", "1", 0.2, 1e-2),
    ]
    study = FakeStudy(clock, [*costs, ("n", "2", 3.0, 0.1)])
    result = carry_out(study, budget=300.0)
    assert [bool(p.failure) for p in result.points] == [False, True, True, False, False]
    # of one method a knob that is turned further is not tried when one before it did not fit
    assert not [one for one in study.solved if one[0] == "3"]
    assert "5 runs of about 50 s" in result.points[1].failure
    assert result.points[2].failure == "not run, beyond the budget"


@pytest.mark.claim("tradeoff-budget")
@pytest.mark.parametrize("budget", [0.01, 1.0, 5.0, 30.0, 200.0])
@pytest.mark.parametrize("seconds", [1e-3, 0.03, 1.0])
@pytest.mark.parametrize("known", [False, True])
def test_a_budget_is_kept_but_for_one_run_that_shows_how_long_it_takes(
    clock, budget, seconds, known
):
    study = FakeStudy(
        clock, [(m, str(k), seconds * 2**k, 1e-3) for m in "ab" for k in range(6)], estimated=known
    )
    begun = clock.time
    result = carry_out(study, budget=budget)
    assert_allclose(result.seconds, clock.time - begun, atol=1e-3)
    # points that nothing is known of are begun: one in each method
    assert result.seconds <= budget + (0.0 if known else 2 * seconds * 2**5 * 1.1)
    assert result.seconds <= budget or any(p.failure for p in result.points)
    assert study.until if hasattr(study, "until") else all(p.failure for p in result.points)
    assert getattr(study, "until", 0.0) <= begun + budget + 1e-3


def test_failures_are_told_in_their_own_words(clock):
    study = FakeStudy(
        clock, [("m", "1", 0.1, 1e-2), ("m", "2", 0.1, 1e-2), ("m", "3", 0.1, 1e-2)], fails=("2",)
    )
    result = carry_out(study, budget=60.0)
    assert [point.failure for point in result.points] == ["", "2 does not converge.", ""]
    assert not result.points[1].resolved
    rows = list(csv.DictReader(io.StringIO(result.csv())))
    assert [(row["knob"], row["failure"], row["error (1)"]) for row in rows if row["failure"]] == [
        ("2", "2 does not converge.", "")
    ]
    assert any("2 does not converge." in line for line in describe_tradeoff(result, 2))


def test_without_a_reference_no_point_has_an_error(clock):
    study = FakeStudy(clock, [("m", "1", 0.1, 1e-2)], reference=None)
    result = carry_out(study, budget=60.0)
    assert "no reference" in result.points[0].failure
    assert result.reference == ""
    assert result.points[0].ran
    (ax,) = tradeoff_figure(result).axes
    assert [text.get_text() for text in ax.texts] == ["run, but without a reference"]
    assert [line.get_xdata() for line in ax.lines if line.get_gid() == "without-error"] == [
        [result.points[0].seconds]
    ]


def axes_of(result):
    """The axes of its figure, drawn, which have two or more tick labels inside each."""
    (ax,) = tradeoff_figure(result).axes
    ax.get_figure().draw_without_rendering()
    seen = []
    for axis, (low, high) in ((ax.xaxis, ax.get_xlim()), (ax.yaxis, ax.get_ylim())):
        ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
        seen.append(
            sum(bool(tick.label1.get_text()) and low <= tick.get_loc() <= high for tick in ticks)
        )
    assert min(seen) >= 2
    return ax


def test_labels_stay_inside_their_axes(clock):
    costs = [("m", "4 x 4 x 4", 0.1, 5e-3), ("m", "10 x 10 x 10", 0.3, 1e-4)]
    ax = axes_of(carry_out(FakeStudy(clock, costs), budget=100.0))
    frame = ax.get_window_extent()
    labels = [text.get_window_extent() for text in ax.texts if "×" in text.get_text()]
    assert len(labels) == 2
    assert all(
        frame.x0 < one.x0 and one.x1 < frame.x1 and frame.y0 < one.y0 and one.y1 < frame.y1
        for one in labels
    )


CLOSE = [("m", str(k), 0.3 + 0.01 * k, 2e-3 + 1e-4 * k) for k in range(3)]
WITHOUT_RUNS = {"nothing was run", "not run: 1 of m"}


@pytest.mark.parametrize(
    ("costs", "budget", "marks", "words"),
    [
        (CLOSE, 100.0, [], set()),
        pytest.param(
            [("m", "1", 0.1, 0.0), ("m", "2", 0.2, 1e-2)], 100.0, [1], set(), marks=pytest.mark.slow
        ),
        pytest.param([("m", "1", 9.0, 1e-2)], 1.0, [], WITHOUT_RUNS, marks=pytest.mark.slow),
    ],
    ids=["close", "without error", "not run"],
)
def test_axes_have_tick_labels_where_points_lie_close_have_no_error_or_were_not_run(
    clock, costs, budget, marks, words
):
    """An error of nothing is a mark at the bottom."""
    ax = axes_of(carry_out(FakeStudy(clock, costs, estimated=True), budget=budget))
    numbers = [len(line.get_xdata()) for line in ax.lines if line.get_gid() == "without-error"]
    assert numbers == marks
    assert {text.get_text() for text in ax.texts} & WITHOUT_RUNS == words


def test_an_error_that_is_nan_is_not_judged():
    for reference_error in (0.0, 1e-3, math.nan):
        numbers = (np.array([[math.nan]]), np.array([[reference_error]]))
        point = MeasuredPoint("m", "1", *numbers, draws=1)
        assert not point.resolved
        assert "not above that of the reference" in point.note


def test_a_point_that_the_reference_does_not_judge_says_so(clock):
    study = FakeStudy(
        clock, [("m", "good", 0.1, 3e-5), ("m", "better", 0.1, 5e-7), ("m", "bad", 0.1, 1e-3)]
    )
    result = carry_out(study, budget=60.0)
    good, better, bad = result.points
    assert not good.resolved
    assert "30 times" in good.note
    assert not better.resolved
    assert "of the reference" in better.note
    assert (bad.resolved, bad.note) == (True, "")
    assert not study.good
    # the legend of the figure tells open from full markers, where there are open ones
    (ax,) = tradeoff_figure(result).axes
    entries = {text.get_text().partition(":")[0] for text in ax.get_legend().get_texts()}
    assert entries == {"m", "full", "open"}
    resolved = carry_out(FakeStudy(clock, [("m", "bad", 0.1, 1e-3)]), budget=60.0)
    (ax,) = tradeoff_figure(resolved).axes
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["m"]


# -- what is refused -------------------------------------------------------------------------------


def test_there_is_nothing_to_trade_for_equal_balls(packing):
    with pytest.raises(InputError, match="equal balls"):
        tradeoff(packing, force=1.0)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({}, "there is no load"),
        ({"force": 1.0, "overlap": 1e-6}, "force and overlap"),
        ({"force": 1.0, "runs": 4}, "runs: found 4; allowed: a whole number from 5"),
        ({"force": 1.0, "budget": 0.0}, "budget: found 0.0"),
        ({"force": 1.0, "budget": "5"}, "budget: found '5'"),
        ({"force": 1.0, "budget": math.inf}, "budget: found"),
        ({"force": 1.0, "budget": math.nan}, "budget: found"),
        ({"force": 1.0, "most_loads": 0}, "most_loads: found 0"),
        ({"force": 1.0, "observe": ("foo",)}, "observe.0: found 'foo'"),
        ({"force": 1.0, "finite_overlap": True}, "with finite overlap"),
        ({"force": 1.0, "executor": 3}, "executor is 3"),
        ({"force": -1.0}, "tensile"),
    ],
)
def test_what_cannot_be_asked(rough, options, told):
    with pytest.raises(InputError, match=told):
        tradeoff(rough, **options)


@pytest.mark.parametrize(
    ("lattice", "finite", "told"),
    [
        ("square", False, "on the square lattice"),
        ("kagome", False, "on the kagome lattice"),
        ("chain", False, "on the chain lattice.*every medium is exact"),
        ("bcc", False, "on the bcc lattice.*without friction"),
        ("fcc", True, "with finite overlap.*geometry is exact"),
    ],
)
def test_where_media_have_no_reference(steel, lattice, finite, told):
    with pytest.raises(InputError, match=f"media are not compared {told}"):
        tradeoff(
            gp.Packing(steel, 8e-3, gp.Uniform(WIDTH), lattice), force=1.0, finite_overlap=finite
        )


@pytest.mark.parametrize(
    ("lattice", "shape", "counted"),
    only(
        [("fcc", "4 x 4 x 4", "balls")],
        [
            ("fcc", "4 x 4 x 4", "balls"),
            ("hcp", "4 x 4 x 2", "cells"),
        ],
    ),
)
def test_media_in_space_are_judged_by_samples_in_space(
    steel, measured, monkeypatch, lattice, shape, counted
):
    monkeypatch.setattr(tradeoffs, "_MOST_DRAWS", 6)
    packing = gp.Packing(steel, 8e-3, gp.Uniform(WIDTH), lattice)
    knobs = {"sides": (4,), "counts": (1,), "reference_side": 5}
    found = measured(
        packing, force=20.0, observe=("velocities", "dos"), knobs=knobs, budget=60.0, sample=1.8
    )
    run = {(point.method, point.knob): point for point in found.points if not point.failure}
    assert {
        ("averaged lattice", "ala"),
        ("averaged force", "afa"),
        ("simulation, 1 sample", shape),
    } <= set(run)
    assert not any("paper" in point.method for point in found.points)
    assert f"{counted} at rest without friction" in found.reference
    # the error of the averaged lattice, from samples of another size and seed
    state = gp.DirectSimulation(packing, (6, 6, 4), seed=7, samples=4).at_force(20.0)
    off = observe(gp.AveragedLattice(packing).at_force(20.0)) / observe(state) - 1.0
    assert_allclose(run["averaged lattice", "ala"].errors[0], np.abs(off), rtol=0.15)


@pytest.mark.parametrize("name", ["progress", "stopwatch", "store", "executor"])
def test_what_measures_and_keeps_is_named_if_it_is_of_another_kind(rough, name):
    with pytest.raises(InputError, match=f"{name}.* is '?three"):
        tradeoff(rough, force=1.0, **{name: "three"})


def test_quantities_are_those_that_are_observed(rough, asked):
    for words in (["velocities"], ["bands"], ["dos"], ["dos", "velocities"]):
        with pytest.raises(InputError, match="enough"):
            tradeoff(rough, force=1.0, observe=words)
    both = "longitudinal", "transverse"
    assert [study.quantities for study, *_ in asked] == [
        both,
        ("frequency",),
        ("frequency",),
        (*both, "frequency"),
    ]


@pytest.mark.parametrize(
    ("given", "most", "taken"),
    [
        ([5.0, 1.0, 3.0, 1.0], 3, (1.0, 3.0, 5.0)),
        (range(1, 102), 3, (1.0, 51.0, 101.0)),
        (range(1, 102), 1, (1.0,)),
        (range(1, 102), 5, (1.0, 26.0, 51.0, 76.0, 101.0)),
        (7.0, 3, (7.0,)),
    ],
)
def test_many_loads_are_thinned_to_the_least_the_greatest_and_some_between(
    rough, asked, given, most, taken
):
    with pytest.raises(InputError, match="enough"):
        tradeoff(rough, overlap=given, most_loads=most)
    assert asked[0][0].load == Load("overlap", taken)


# -- the numbers -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_every_point_is_there_once_and_has_its_costs(found):
    assert len({(p.method, p.knob) for p in found.points}) == len(found.points)
    assert found.observed == ("longitudinal", "transverse", "frequency")
    assert found.loads == FORCES
    assert found.budget == BUDGET
    assert found.runs == 5
    run = [point for point in found.points if not point.failure]
    assert len(run) >= 6
    for point in run:
        assert point.errors.shape == point.reference_errors.shape == (2, 3)
        assert np.all(np.isfinite(point.errors))
        assert np.all(point.errors >= 0.0)
        assert point.seconds > 0.0 < point.memory
        assert point.spread >= 0.0 <= point.setup
        # of a random point an rms of five draws and their standard deviation
        assert (
            0.3 * point.error < point.floor < 3.0 * point.error
            if point.random
            else 0.0 < point.floor < 1e-14
        )
    assert {p.method for p in run} >= {"averaged lattice", "averaged force", "effective medium"}


@pytest.fixture(scope="module")
def reference(rough):
    """That of the media, of as few samples as are looked at."""
    return media(rough, reference_side=32).find_reference(
        whenever(), lambda one: True, WorkCounter()
    )


@pytest.mark.slow
def test_with_a_history_media_are_judged_by_arrays_loaded_with_friction(rough, monkeypatch):
    """Of a few balls, just above the start of the loading: the reference is the mean of the same
    samples, loaded so.
    """
    monkeypatch.setattr("granphon.tradeoffs.measure._CHECKED_SIDES", {2: 4})
    monkeypatch.setattr("granphon.tradeoffs.measure._SAMPLES_BETWEEN_LOOKS", 3)
    force = 0.05 * rough.law.coefficient * rough.width**1.5
    truth = gp.AutoMedium(
        rough, friction_history=True, friction_coefficient=0.5, shear_response="stick"
    ).truth
    study = media(rough, (force,), truth=truth, sides=(6,), counts=(1,), reference_side=6)
    made = study.find_reference(whenever(), lambda one: True, WorkCounter())
    assert re.search("3 samples of 6 x 6 .*mu = 0.5, .*stick.* tenth of the tolerance", made.made)
    with pytest.raises(GranphonError, match="budget"):  # the shorter steps are not begun
        study.compare(Deadline(WorkCounter(), -1.0))
    loaded = gp.DirectSimulation(rough, (6, 6), 1_000_000, 3, **truth.options).at_force(force)
    assert_allclose(made.values[0], observe(loaded), rtol=1e-3)
    methods = {point.method: point for point in study.make_points()}
    assert {"simulation, 1 sample", "simulation with friction, 1 sample"} < set(methods)
    assert methods["simulation with friction, 1 sample"].prepare(0).friction_coefficient == 0.5
    assert not methods["simulation, 1 sample"].prepare(0).friction_history
    rest = media(rough, (force,), reference_side=6).find_reference(
        whenever(), lambda one: True, WorkCounter()
    )
    assert "at rest without friction" in rest.made


def test_a_scene_with_a_history_names_the_truth_of_a_trade_off(tmp_path, asked, rough):
    scene = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 2.04 um}}
load: {force: 6 N}
medium: [ema, {simulation: {%s}}, {auto: {tolerance: 0.1, friction_history: true, friction_coefficient: 0.2}}]
"""
    file = tmp_path / "scene.yaml"
    for mu in ("0.2", "0.5"):
        file.write_text(
            scene % f"friction_history: true, friction_coefficient: {mu}", encoding="utf-8"
        )
        assert main(["tradeoff", str(file)]) == 2
    # media that are loaded in two ways leave two truths
    ((study, *_),) = asked
    assert study.truth.options["friction_coefficient"] == 0.2
    with pytest.raises(InputError, match="found no friction_coefficient"):
        tradeoff(rough, force=1.0, friction_history=True)


@pytest.mark.slow
def test_errors_of_the_media_are_those_from_the_same_reference_by_hand(rough, found, reference):
    for method, knob, medium in (
        ("averaged lattice", "ala", gp.AveragedLattice),
        ("averaged force", "afa", gp.AveragedForce),
        ("effective medium", "computed field", gp.EffectiveMedium),
    ):
        point = point_of(found, method, knob)
        assert not point.failure
        by_hand = np.abs(observe(medium(rough).at_force(np.array(FORCES))) / reference.values - 1.0)
        assert np.all(
            np.abs(point.errors - by_hand)
            <= 5.0 * np.hypot(point.reference_errors, reference.errors)
        )


@pytest.mark.slow
@pytest.mark.claim("tradeoff-references")
def test_the_reference_of_the_media_is_two_algorithms_that_agree(rough, reference):
    few = reference
    assert "8 samples of 32 x 32 balls" in few.made
    assert np.max(media(rough, FORCES[:1]).compare(whenever())[1]) < 1e-9
    # an independent large sample
    array = observe(gp.DirectSimulation(rough, (64, 64), 5).at_force(np.array(FORCES)))
    chance = (
        few.errors
        + np.std(
            [
                observe(gp.DirectSimulation(rough, (32, 32), s).at_force(np.array(FORCES)))
                for s in range(6)
            ],
            axis=0,
            ddof=1,
        )
        / few.values
        / 4.0
    )
    assert np.all(np.abs(array / few.values - 1.0) < 4.0 * chance)


def test_the_condition_bounds_what_small_changes_of_load_and_width_do(rough, steel):
    for force in (3.0, 18.446, 100.0):
        one = media(rough, (force,))
        step = 1e-6

        def velocity(packing, load):
            return float(
                gp.sound_velocities(gp.EffectiveMedium(packing).at_force(load)).longitudinal
            )

        here = velocity(rough, force)
        by_load = abs(velocity(rough, force * (1.0 + step)) / here - 1.0) / step
        wider = replace(rough, spread=gp.Uniform(WIDTH * (1.0 + step)))
        by_width = abs(velocity(wider, force) / here - 1.0) / step
        assert_allclose(one.condition, 1.0 + by_load + by_width, rtol=1e-3)


def test_the_condition_does_not_depend_on_how_fast_the_machine_is(steel, monkeypatch):
    """With many diameters it is that of the averaged force, though no time passes."""
    diameters = 7.999e-3 + 2e-6 * np.linspace(0.0, 1.0, 9) ** 2  # of 45 openings
    spread = gp.Discrete(tuple(diameters.tolist()), (1.0 / 9.0,) * 9)
    study = media(gp.Packing(steel, spread.mean, spread))
    expected = study.condition
    still = WorkCounter()
    still.now = lambda: 0.0
    monkeypatch.setattr(tradeoffs, "EffectiveMedium", lambda packing: pytest.fail("was solved"))
    again = replace(study, stopwatch=still)
    assert again.solving_time == 0.0
    assert again.condition == expected


# -- references keep the time ----------------------------------------------------------------------


def test_a_reference_that_does_not_fit_is_said_to(rough):
    with pytest.raises(GranphonError, match=r"samples .*budget"):
        media(rough).find_reference(Deadline(WorkCounter(), 99.0), lambda one: False, WorkCounter())
    # the check by another algorithm ends when the time is up
    with pytest.raises(GranphonError, match=r"not fit .*budget"):
        media(rough).compare(Deadline(WorkCounter(), 99.0))


@pytest.mark.parametrize(
    ("load", "least"),
    [
        ({"force": 1e-9}, 0),
        pytest.param({"force": 0.02}, 1, marks=pytest.mark.exhaustive),
        pytest.param({"overlap": 0.0}, 4, marks=pytest.mark.exhaustive),
        pytest.param({"pressure": 4e3}, 4, marks=pytest.mark.exhaustive),
        pytest.param({"force": 1e5}, 4, marks=pytest.mark.exhaustive),
        ({"force": 1e7}, 0),
    ],
)
def test_extreme_and_other_loads_list_what_fails(rough, measured, load, least):
    result = measured(rough, **load, budget=20.0, knobs=LEAST)
    assert sum(not point.failure for point in result.points) >= least
    assert result.kind == next(iter(load))
    for point in result.points:
        assert bool(point.failure) == (not point.errors.size)
    describe_tradeoff(result, 2)


# -- what is written -------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_table_has_every_number(found):
    rows = list(csv.DictReader(io.StringIO(found.csv())))
    run = [point for point in found.points if not point.failure]
    assert len(rows) == 6 * len(run) + len(found.points) - len(run)
    for point in run:
        mine = [row for row in rows if (row["method"], row["knob"]) == (point.method, point.knob)]
        errors = np.array([float(row["error (1)"]) for row in mine]).reshape(2, 3)
        assert_array_equal(errors, point.errors)
        assert [float(row["force"]) for row in mine] == [
            force for force in FORCES for _ in range(3)
        ]
        assert [row["observed"] for row in mine] == ["longitudinal", "transverse", "frequency"] * 2
        assert {float(row["seconds (s)"]) for row in mine} == {point.seconds}
        assert {int(row["memory (B)"]) for row in mine} == {point.memory}
        limits = np.array([float(row["reference_error (1)"]) for row in mine]).reshape(2, 3)
        assert [row["resolved"] == "True" for row in mine] == (
            errors >= JUDGING_RATIO * limits
        ).ravel().tolist()


@pytest.mark.slow
def test_a_table_for_the_terminal_lists_every_point_and_its_reference(found):
    lines = describe_tradeoff(found, 2)
    assert re.search("2 loads, 10 N to 60 N; 5 warm", lines[0])
    for point in found.points:
        assert (
            sum(
                line.startswith(f"  {point.method} ") and f" {point.knob} " in line
                for line in lines
            )
            >= 1
        )
    assert sum(line.startswith("  reference: ") for line in lines) == 1
    assert lines[-1].startswith("took ")


@pytest.mark.slow
def test_the_diagrams_are_log_log_with_a_curve_for_each_method_and_can_be_read(found):
    result = found
    figure = tradeoff_figure(result)
    figure.canvas.draw()
    (ax,) = figure.axes
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert ax.get_xlabel() == "Time (s)"
    drawn = [p for p in result.points if not p.failure and p.error > 0.0]
    curves = {h.get_label(): h.lines[0] for h in ax.containers}
    assert set(curves) == {p.method for p in drawn}
    for method, line in curves.items():
        mine = [p for p in drawn if p.method == method]
        assert_array_equal(line.get_xdata(), [p.seconds for p in mine])
        assert_array_equal(line.get_ydata(), [p.error for p in mine])
    assert any("not run" in text.get_text() for text in ax.texts) == any(
        p.failure for p in result.points
    )
    from matplotlib.text import Text

    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    assert min(text.get_fontsize() for text in texts) >= 7.0


# -- the command line ------------------------------------------------------------------------------


def test_a_command_writes_table_and_picture(work, capsys):
    assert main(["tradeoff", "scene.yaml", "-o", "out", "--budget", "100 ms", "--loads", "1"]) == 0
    assert sorted(path.name for path in (work / "out").iterdir()) == [
        ".granphon-files",
        "tradeoff.csv",
        "tradeoff.png",
    ]
    out, err = capsys.readouterr()
    assert "media (of longitudinal, transverse)" in out
    assert "tradeoff.csv, tradeoff.png into out" in out
    assert err == ""
    rows = list(
        csv.DictReader(io.StringIO((work / "out" / "tradeoff.csv").read_text(encoding="utf-8")))
    )
    assert {row["force"] for row in rows} <= {"10.0", ""}
    # an existing one is kept, and that is found out before anything is measured
    before = (work / "out" / "tradeoff.csv").read_bytes()
    assert main(["tradeoff", "scene.yaml", "-o", "out", "--budget", "20 minutes"]) == 1
    assert "--force" in capsys.readouterr().err
    assert (work / "out" / "tradeoff.csv").read_bytes() == before
    assert main(["tradeoff", "scene.yaml", "-o", "scene.yaml", "--budget", "20 minutes"]) == 1
    assert "is not a folder" in capsys.readouterr().err
    assert main(["tradeoff", "scene.yaml", "-o", "out", "--budget", "1 ms", "-q", "--force"]) == 0
    assert (work / "out" / "tradeoff.csv").read_bytes() != before


@pytest.mark.parametrize(
    ("change", "arguments", "told"),
    [
        ("", ["--budget", "10"], "found '10', without a unit"),
        *(
            ("", ["--budget", given], "--budget")
            for given in ("-3 s", "0 s", "3 m", "", "nan s", "inf s")
        ),
        ("", ["--runs", "4"], "--runs"),
        ("", ["--loads", "0"], "--loads"),
        ("", ["-o", ""], "--out is empty"),
        ("", ["--wrkers", "2"], "--wrkers"),
        (", spread: {uniform: 2.04 um}|", ["-o", "out"], "equal balls"),
        ("8 mm|8 mm, lattice: square", ["-o", "out"], "on the square lattice"),
        ("8 mm|8 mm, finite_overlap: true", ["-o", "out"], "with finite overlap"),
        ("medium: ema|sweep: {width: [1 um, 2 um]}", ["-o", "out"], "scene.yaml sweeps width"),
    ],
)
def test_mistakes_on_the_command_line_and_scenes_that_have_no_trade_off(
    work, capsys, change, arguments, told
):
    (work / "scene.yaml").write_text(
        SCENE.replace(*change.split("|")) if change else SCENE, encoding="utf-8"
    )
    assert main(["tradeoff", "scene.yaml", *arguments]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert told in err
    assert [path.name for path in work.iterdir()] == ["scene.yaml"]


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(
    "which", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_an_interruption_leaves_nothing(work, which):
    # it says when it begins to measure, and only then is it interrupted
    code = (
        "import sys\n"
        "from granphon.cli.main import main\n"
        "from granphon.tradeoffs import measure\n"
        "carry_out = measure.carry_out\n"
        "def tell(*arguments): print('measuring', flush=True); return carry_out(*arguments)\n"
        "measure.carry_out = tell\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    command = [
        sys.executable,
        "-c",
        code,
        "tradeoff",
        "scene.yaml",
        "-o",
        "out",
        "--budget",
        "1 hour",
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stdout.readline() == "measuring\n"
        for _ in range(6):
            # one that falls into a finaliser or a callback of compiled code may be lost
            running.send_signal(which)
            try:
                out, err = running.communicate(timeout=HANGS / 6.0)
                break
            except subprocess.TimeoutExpired:
                continue
        else:
            running.kill()
    assert running.returncode == 130
    assert out == ""
    assert err.startswith("granphon: error: interrupted; no result")
    assert err.count("\n") == 1
    assert [path.name for path in work.iterdir()] == ["scene.yaml"]


@pytest.mark.parametrize(
    ("change", "more", "told"),
    [
        ({"motions": "all"}, {}, "motions 'all' are not simulated"),
        (
            {"friction": False},
            {"friction_history": True, "friction_coefficient": 0.2},
            "needs contacts with friction",
        ),
    ],
)
def test_what_is_wrong_with_balls_is_not_said_of_their_lattice(steel, change, more, told):
    packing = gp.Packing(steel, 8e-3, gp.Uniform(WIDTH), **change)
    with pytest.raises(InputError, match=told) as refused:
        tradeoff(packing, force=1.0, **more)
    assert "triangular" not in str(refused.value)
