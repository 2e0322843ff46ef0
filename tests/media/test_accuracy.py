"""The table of accuracy: what it covers, that it bounds what it did not see, and how it goes on
above its loads.
"""

from __future__ import annotations

import importlib
import math
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.balls.lattices import find_lattice
from granphon.balls.loads import Load
from granphon.base.errors import InputError
from granphon.media.accuracy import (
    AVERAGES,
    DEVIATIONS,
    SIMULATION,
    compute_form_coefficients,
    explain_uncovered,
    find_error,
    find_least_load,
    find_rows,
    read_table,
)
from granphon.media.array_options import REST, FrictionHistory
from granphon.media.choice import choose_shape
from granphon.tradeoffs.measure import Ensemble, observe

WIDTH = 2e-6
FACES = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.5, 0.0, 0.5), (0.0, 0.5, 0.5))
KINDS = ("force", "pressure", "overlap")
MEDIA = (*AVERAGES, SIMULATION)
#: lattices of the table, at rest and loaded with friction
PARTS = [
    *(("rest", lattice) for lattice in ("triangular", "fcc", "hcp")),
    *(("loaded", lattice) for lattice in ("triangular", "fcc")),
]
every_part = pytest.mark.parametrize(("arrays", "lattice"), PARTS)
BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture(scope="module")
def maker():
    """The script that makes the table."""
    sys.path.insert(0, str(BENCHMARKS))
    try:
        return importlib.import_module("accuracy")
    finally:
        sys.path.remove(str(BENCHMARKS))


def balls(spread=None, poisson_ratio=0.276, diameter=8e-3, friction=True, lattice="triangular"):
    material = gp.Material(211.65e9, poisson_ratio, 7840.0)
    return gp.Packing(
        material, diameter, spread=spread or gp.Uniform(WIDTH), friction=friction, lattice=lattice
    )


def unit(packing):
    """Of f*, N."""
    return packing.law.coefficient * packing.width**1.5


def load(packing, kind, place):
    """The load (SI) at a place of the table: f*, or a*."""
    if kind == "overlap":
        return Load(kind, (np.asarray(place) - 0.5) * packing.width)
    d = packing.diameter
    per_force = {
        "triangular": math.sqrt(3.0) / d,
        "fcc": math.sqrt(8.0) / d**2,
        "hcp": math.sqrt(8.0) / d**2,
    }
    factor = per_force[packing.structure.name] if kind == "pressure" else 1.0
    return Load(kind, np.asarray(place) * unit(packing) * factor)


# -- the form of a distribution --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spread", "skewness", "kurtosis"),
    [
        (gp.Uniform(3e-6), 0.0, -1.2),
        (gp.Discrete((7.999e-3, 8.001e-3), (0.5, 0.5)), 0.0, -2.0),
        # p, q: (q - p)/(pq)^(1/2), 1/(pq) - 6
        (gp.Discrete((7.999e-3, 8.004e-3), (0.8, 0.2)), 0.6 / 0.4, 1 / 0.16 - 6.0),
        (gp.Discrete((7.996e-3, 8.001e-3), (0.2, 0.8)), -0.6 / 0.4, 1 / 0.16 - 6.0),
        (gp.Measured((7.999e-3, 8e-3, 8.001e-3)), 0.0, -1.5),
        (gp.Normal(1e-6, cutoff=10.0), 0.0, 0.0),
        (gp.Normal(1e-6, cutoff=0.001), 0.0, -1.2),
    ],
)
def test_skewness_and_kurtosis_have_closed_forms(spread, skewness, kurtosis):
    assert_allclose(compute_form_coefficients(spread.shape), (skewness, kurtosis), atol=1e-6)


def test_the_kurtosis_of_a_cut_normal_distribution_is_an_integral():
    from scipy.integrate import quad

    second, fourth = (
        quad(lambda x, n=n: x**n * math.exp(-0.5 * x * x), -2.0, 2.0)[0] for n in (2, 4)
    )
    zeroth = quad(lambda x: math.exp(-0.5 * x * x), -2.0, 2.0)[0]
    assert_allclose(
        compute_form_coefficients(gp.Normal(1e-6, 2.0).shape)[1],
        zeroth * fourth / second**2 - 3.0,
        rtol=1e-7,
    )


# -- the table itself ------------------------------------------------------------------------------


def list_rows(part):
    """(friction, diameters, kind, medium, errors) of each row of a part of the table."""
    return [
        (friction, diameters, kind, medium, np.array(errors))
        for friction, kinds_of_diameters in part["errors"].items()
        for diameters, kinds in kinds_of_diameters.items()
        for kind, media in kinds.items()
        for medium, errors in media.items()
    ]


def find_truth(arrays, friction):
    """The truth whose errors stand in the rows of a friction."""
    return FrictionHistory(0.2, friction) if arrays == "loaded" else REST


@every_part
def test_the_table_is_complete_and_falls_with_the_load(arrays, lattice):
    part = read_table()[arrays][lattice]
    rows = list_rows(part)
    frictions = ["none", "slip"] if arrays == "rest" else ["stick", "slide", "partial_slip"]
    assert {row[0] for row in rows} == set(frictions[: 2 if lattice == "fcc" else None])
    assert len({row[:4] for row in rows}) == len(part["errors"]) * 2 * 2 * len(MEDIA)
    for _, diameters, kind, medium, errors in rows:
        assert diameters in ("smooth", "listed")
        assert medium in MEDIA
        assert errors.shape == np.shape(part["loads"][kind])
        assert np.all(errors > 0.0)
        assert np.all(np.diff(errors) <= 0.0)
    for loads in part["loads"].values():
        assert loads == sorted(set(loads))


@every_part
def test_listed_diameters_are_no_better_than_smooth_ones(arrays, lattice):
    for kinds_of_diameters in read_table()[arrays][lattice]["errors"].values():
        for kind, media in kinds_of_diameters["smooth"].items():
            for medium, errors in media.items():
                assert np.all(np.array(kinds_of_diameters["listed"][kind][medium]) >= errors)


@every_part
def test_the_table_knows_the_script_that_made_it(maker, arrays, lattice):
    part = read_table()[arrays][lattice]
    scope = {"rest": maker.REST_SCOPES, "loaded": maker.LOADED_SCOPES}[arrays][lattice]
    assert (BENCHMARKS.parents[1] / read_table()["made_by"]).samefile(maker.__file__)
    assert part["distributions"] == list(scope.distributions)
    assert part["loads"] == {"force": list(scope.forces), "overlap": list(scope.spacings)}
    assert part["shape"] == list(choose_shape(find_lattice(lattice), scope.side))
    assert part["samples"] == scope.samples
    assert maker.text(read_table()) == maker.DATA.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_script_makes_a_part_in_the_form_of_the_table(maker, monkeypatch):
    """A table of one distribution, few loads and small samples has the keys of the package's."""
    scope = maker.REST_SCOPES["fcc"]._replace(
        forces=(1.0, 3.0, 10.0), spacings=(1.5, 3.0), distributions=("uniform",), side=4, samples=2
    )
    monkeypatch.setitem(maker.REST_SCOPES, "fcc", scope)
    monkeypatch.setattr(maker, "ProcessPoolExecutor", ThreadPoolExecutor)
    part = maker.tabulate("fcc", loaded=False)
    known = read_table()["rest"]["fcc"]
    assert list(part) == list(known)
    assert [row[:4] for row in list_rows(part)] == [row[:4] for row in list_rows(known)]


@pytest.mark.exhaustive
@pytest.mark.claim("accuracy-table")
@pytest.mark.parametrize(
    ("lattice", "shape"), [("triangular", (20, 20)), ("fcc", (8, 8, 8)), ("hcp", (6, 6, 4))]
)
def test_the_script_measures_what_the_table_bounds(maker, lattice, shape):
    """One distribution, few loads and small samples, anew."""
    samples = maker.Samples(shape, 10_000, 4)
    ratios = (None, *maker.POISSON_RATIOS[lattice])
    truths = maker.rest_truths(
        lattice, maker.shapes()["uniform"], (0.1, 0.3, 10.0), samples, ratios
    )
    check_bounds(maker.measure(truths, finite_overlap=False), read_table()["rest"][lattice])


@pytest.mark.exhaustive
@pytest.mark.claim("accuracy-with-friction")
@pytest.mark.parametrize(("lattice", "shape"), [("triangular", (20, 20)), ("fcc", (6, 6, 6))])
def test_the_script_measures_what_the_table_with_friction_bounds(maker, lattice, shape):
    """One distribution and friction coefficient, few loads and small samples, anew."""
    samples = maker.Samples(shape, 10_000, 4)
    for ratio in maker.LOADED_POISSON_RATIOS:
        truths = maker.loaded_truths(
            lattice, maker.shapes()["uniform"], (0.1, 0.3, 3.0), samples, ratio, 0.2
        )
        check_bounds(maker.measure(truths, finite_overlap=True), read_table()["loaded"][lattice])


def check_bounds(rows, part):
    """Errors of few samples are at most 2.5 times those of the table."""
    for row in rows:
        known = part["errors"][row.friction]["smooth"][row.kind][row.medium]
        bound = np.interp(np.log(row.loads), np.log(part["loads"][row.kind]), np.log(known))
        assert np.all(row.errors <= 2.5 * np.exp(bound)), row


# -- what is read from it --------------------------------------------------------------------------


@every_part
@pytest.mark.parametrize("kind", KINDS)
def test_errors_at_its_own_loads_are_those_of_the_table(kind, arrays, lattice):
    part = find_rows(find_lattice(lattice), find_truth(arrays, "stick"))
    axis = "overlap" if kind == "overlap" else "force"
    reduced = np.array(part["loads"][axis][1:-1])
    for friction, media in part["errors"].items():
        packing = balls(poisson_ratio=0.3, friction=friction != "none", lattice=lattice)
        truth = find_truth(arrays, friction)
        for medium, errors in media["smooth"][axis].items():
            found = find_error(medium, packing, load(packing, kind, reduced), 900, truth)
            factor = DEVIATIONS / 30.0 if medium == SIMULATION else 1.0
            assert_allclose(found, factor * np.array(errors[1:-1]), rtol=1e-6)


@pytest.mark.parametrize("lattice", ["triangular", "fcc", "hcp"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("medium", AVERAGES)
def test_errors_do_not_depend_on_the_scale(kind, medium, lattice):
    """One diameter, width and modulus stand for all."""
    small, large = (
        balls(gp.Uniform(width), diameter=d, lattice=lattice)
        for width, d in ((3e-9, 1e-5), (1e-3, 4.0))
    )
    reduced = np.array([0.5, 1.0, 5.0, 500.0])
    errors = [find_error(medium, one, load(one, kind, reduced)) for one in (small, large)]
    assert_allclose(errors[0], errors[1], rtol=1e-9)


@pytest.mark.parametrize(
    ("spread", "diameters"),
    [
        (gp.Uniform(WIDTH), "smooth"),
        (gp.Normal(WIDTH, 3.0), "smooth"),
        (gp.Normal(WIDTH, 1.0), "listed"),
        (gp.Discrete((7.999e-3, 8.001e-3), (0.5, 0.5)), "listed"),
    ],
)
def test_the_kind_of_a_distribution_decides_the_rows(spread, diameters):
    packing = balls(spread)
    part = find_rows(packing.structure)
    expected = part["errors"]["slip"][diameters]["force"]["ala"][10]
    force = load(packing, "force", part["loads"]["force"][10])
    assert_allclose(find_error("ala", packing, force), expected, rtol=1e-9)


@every_part
@pytest.mark.parametrize("kind", KINDS)
def test_below_the_least_load_the_error_is_infinite(kind, arrays, lattice):
    packing = balls(lattice=lattice)
    truth = find_truth(arrays, "stick")
    least = find_least_load(packing, Load(kind, 1.0), truth)
    loads = load(packing, kind, [[0.5 * least, 0.99 * least, 1.01 * least]])
    errors = find_error("ema", packing, loads, truth=truth)
    assert errors.shape == (1, 3)
    assert_array_equal(np.isinf(errors), [[True, True, False]])


@pytest.mark.parametrize("kind", KINDS)
def test_equal_balls_and_balls_on_a_line_have_no_error(steel, kind):
    two_kinds = gp.Discrete((7.999e-3, 8.009e-3), (0.9, 0.1))
    for packing in (
        *(gp.Packing(steel, 8e-3, lattice=name) for name in ("triangular", "square", "bcc")),
        balls(lattice="chain"),
        balls(two_kinds, lattice="chain"),
    ):
        assert_array_equal(find_error("ala", packing, Load(kind, [1e-300, 1.0])), [0.0, 0.0])
        assert_array_equal(find_error("ema", packing, Load(kind, [[2.0]])), [[0.0]])
        assert explain_uncovered(packing) is None
        assert find_least_load(packing, Load(kind, 1.0)) == 0.0


SKEW = gp.Discrete((7.999e-3, 8.009e-3), (0.9, 0.1))


@pytest.mark.parametrize(
    ("packing", "truth", "words"),
    [
        (balls(lattice="square"), REST, ("square", "hcp")),
        (balls(lattice=gp.Lattice("cube", np.sqrt(2.0) * np.eye(3), FACES)), REST, ("cube",)),
        (replace(balls(lattice="fcc"), torsion=0.1), REST, ("twist",)),
        (replace(balls(), bending=0.1), REST, ("rolling",)),
        (replace(balls(), motions="all"), REST, ("plane",)),
        (balls(SKEW), REST, ("skewness 2.67",)),
        (balls(gp.Discrete((7.991e-3, 8.001e-3), (0.1, 0.9))), REST, ("skewness -2.67",)),
        (
            balls(gp.Discrete((7.99e-3, 8e-3, 8.01e-3), (0.05, 0.9, 0.05))),
            REST,
            ("excess kurtosis 7",),
        ),
        (balls(), FrictionHistory(0.05), ("0.1", "0.05")),
        (balls(), FrictionHistory(0.0), ("0.1", "not for 0")),
        (balls(lattice="hcp"), FrictionHistory(0.2), ("hcp", "fcc")),
        (balls(friction=False), FrictionHistory(0.2), ("0.667 to 1", "not for 0")),
        (balls(poisson_ratio=-0.5), FrictionHistory(0.2), ("0.667 to 1", "1.2")),
        (balls(SKEW), FrictionHistory(0.2), ("skewness 2.67",)),
        (balls(lattice="fcc"), FrictionHistory(0.2, "partial_slip"), ("partial_slip", "stick")),
    ],
)
def test_what_is_not_covered_says_why_and_has_an_infinite_error(packing, truth, words):
    reason = explain_uncovered(packing, truth)
    assert all(word in reason for word in words)
    loads = Load("force", [10.0, 1e4])
    assert_array_equal(find_error("ema", packing, loads, truth=truth), [np.inf, np.inf])
    history = {name: truth.options[name] for name in ("friction_history", "friction_coefficient")}
    auto = gp.AutoMedium(packing, 0.5, **history, shear_response=truth.shear_response)
    with pytest.raises(InputError, match="not known"):
        auto.at_force(10.0)


@pytest.mark.parametrize("lattice", ["triangular", "fcc", "hcp"])
def test_what_the_table_was_made_of_is_covered(maker, lattice):
    labels = maker.REST_SCOPES[lattice].distributions
    measured = [maker.shapes()[label] for label in labels]
    for spread in (*measured, *maker.other_shapes().values()):
        assert explain_uncovered(maker.packing(spread, 0.3, lattice)) is None


@pytest.mark.filterwarnings("error")
@given(
    st.floats(1e-300, 1e-6),
    st.sampled_from(KINDS),
    st.floats(1e-300, 1e300),
    st.sampled_from(MEDIA),
)
def test_no_load_and_no_width_make_it_stumble(width, kind, value, medium):
    error = find_error(medium, balls(gp.Uniform(width)), Load(kind, value))
    assert error.shape == ()
    assert error >= 0.0


# -- against the array -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lattice", "truth", "power"),
    [
        ("triangular", REST, 4.0 / 3.0),
        ("triangular", FrictionHistory(0.2, "slide"), 4.0 / 3.0),
        ("triangular", FrictionHistory(0.2, "partial_slip"), 2.0 / 3.0),
        ("fcc", FrictionHistory(0.2, "slide"), 4.0 / 3.0),
    ],
)
def test_above_the_table_errors_fall_as_the_response_does(lattice, truth, power):
    """(W/delta)^2, and the overlap goes as f^(2/3); slipping stiffness is lost in proportion to
    |T|/f, which is of the first order in the spread over the overlap.
    """
    packing = balls(lattice=lattice)
    forces = load(packing, "force", [30.0, 300.0])
    errors = find_error("ema", packing, forces, truth=truth)
    assert_allclose(errors[0] / errors[1], 10.0**power, rtol=1e-9)


def test_above_the_table_errors_fall_as_the_second_order_does():
    """f* = 300 and 3000: the measured error of the averages has the same power, and is within the
    expected one.
    """
    packing = balls()
    forces = load(packing, "force", [300.0, 3000.0])
    array = Ensemble(packing, forces, (8, 8), 3)
    array.add(30)
    values, chance = array.means()
    for name, medium in (("ala", gp.AveragedLattice), ("afa", gp.AveragedForce)):
        errors = np.abs(observe(medium(packing).at(forces)) / values - 1.0)
        assert np.all(chance[:, :2] < 0.03 * errors[:, :2])
        # (W/delta)^2, and the overlap goes as f^(2/3)
        assert_allclose(errors[0, :2] / errors[1, :2], 10.0 ** (4.0 / 3.0), rtol=0.05)
        expected = find_error(name, packing, forces)
        assert_allclose(expected[0] / expected[1], 10.0 ** (4.0 / 3.0), rtol=1e-9)
        assert np.all(np.max(errors, axis=1) <= expected)
        assert np.all(expected < 3.0 * np.max(errors, axis=1))


def test_chance_above_the_table_falls_so_too():
    packing = balls()
    forces = load(packing, "force", [30.0, 300.0])
    array = Ensemble(packing, forces, (8, 8))
    array.add(16)
    # of a velocity half of that of a modulus, of one ball eight times that of a sample
    noise = np.max(
        4.0 * np.std(array.moduli, axis=0, ddof=1) / np.mean(array.moduli, axis=0), axis=1
    )
    expected = find_error(SIMULATION, packing, forces) / DEVIATIONS
    assert np.all(noise < expected)
    assert np.all(expected < 2.5 * noise)


@pytest.mark.claim("accuracy-held-back", "api-automatic")
@pytest.mark.exhaustive
@pytest.mark.parametrize("lattice", ["triangular", "fcc", "hcp"])
def test_on_what_was_held_back_the_tolerance_is_met(maker, lattice):
    """Other distributions, loads and Poisson ratios than those of the table; truths of fewer balls
    than it was made with.
    """
    side, loads, most = (40, 4, 200) if lattice == "triangular" else (14, 3, 100)
    spreads = (
        "uniform",
        "normal, cut at 2.5",
        "two kinds, 0.3 of them larger",
        "a lot of 40 balls, lognormal",
    )
    samples = maker.Samples(choose_shape(find_lattice(lattice), side), 20_000, 3)
    trials = list(maker.rest_trials(lattice, 3, samples, loads, 2, spreads))
    assert {trial.medium for trial in trials} == set(MEDIA)
    check_trials(trials, most)


@pytest.mark.exhaustive
@pytest.mark.claim("accuracy-with-friction-held-back")
@pytest.mark.parametrize("lattice", ["triangular", "fcc"])
def test_with_friction_the_tolerance_is_met_on_what_was_held_back(maker, lattice):
    side = maker.LOADED_SCOPES[lattice].true_side
    samples = maker.Samples(choose_shape(find_lattice(lattice), side), 20_000, 3)
    spreads = ["two kinds, 0.3 of them larger"]
    trials = list(maker.loaded_trials(lattice, 3, samples, 2, spreads))
    assert {trial.medium for trial in trials} >= {"ala", SIMULATION}
    check_trials(trials, 50)


def check_trials(trials, least):
    """The tolerance is met in 66 of 67 cases, though not by promising next to nothing."""
    assert len(trials) >= least
    assert np.mean([trial.is_met for trial in trials]) >= 66.0 / 67.0
    assert np.median([trial.realised / trial.promised for trial in trials]) > 0.1
    assert all(trial.promised <= trial.tolerance for trial in trials)


@pytest.mark.parametrize(
    ("larger", "place"),
    [
        (0.2, 0.0755),
        pytest.param(0.33, 0.117, marks=pytest.mark.slow),
        pytest.param(0.25, 0.101, marks=pytest.mark.slow),
        (0.4, 0.136),
    ],
)
def test_errors_of_two_kinds_are_bounded_where_they_peak(maker, larger, place):
    """Where contacts of the two kinds open a medium may err by a fifth, and next to it by half of
    that.
    """
    packing = maker.packing(maker.listed([0.0, 1.0], [1.0 - larger, larger]), 0.28)
    force = place * maker.unit(packing)
    truth = gp.DirectSimulation(packing, (32, 32), seed=7, samples=2).at_force(force)
    right = observe(truth)
    for kind, load in (("force", force), ("overlap", truth.overlap)):
        for name, medium in maker.MEDIA.items():
            error = np.max(
                np.abs(observe(getattr(medium(packing), f"at_{kind}")(load)) / right - 1.0)
            )
            assert error <= find_error(name, packing, Load(kind, load))


# -- the pages ------------------------------------------------------------------------------------


@every_part
def test_the_page_has_the_errors_of_the_table(arrays, lattice):
    """Loads from which each average is within 1 %, as the page tells them."""
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "tradeoff.md").read_text("utf-8")
    part = read_table()[arrays][lattice]
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in page.split("\n")
        if line.startswith(f"| {lattice} | {'loaded' if arrays == 'loaded' else 'at rest'}")
    ]
    assert [row[2] for row in rows] == list(part["errors"])
    for _, _, friction, *cells in rows:
        kinds = part["errors"][friction]["smooth"]["force"]
        loads = np.log(part["loads"]["force"])
        expected = [
            math.exp(np.interp(-math.log(0.01), -np.log(kinds[medium]), loads))
            for medium in AVERAGES
        ]
        assert_allclose([float(cell) for cell in cells[:3]], expected, rtol=0.05)
        deviations = np.exp(np.interp(np.log([0.1, 0.3, 1.0]), loads, np.log(kinds[SIMULATION])))
        told = [float(cell) for cell in cells[3:]]
        assert_allclose(told, 100.0 * deviations, rtol=0.05)
