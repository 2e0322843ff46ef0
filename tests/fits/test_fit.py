"""Fits of the width: exact on exact data, right on average on noisy ones, and refused where the
data do not say.
"""

from __future__ import annotations

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import curve_fit, minimize_scalar
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import kstest

import granphon as gp
from granphon.balls.packing import change_packing
from granphon.base.errors import FileExistsInRunError, InputError, UnreachableFrequencyError
from granphon.base.text import plain_yaml
from granphon.fits.fit import (
    FitProblem,
    WidthFit,
    _find_covariance,
    compute_leverages,
    convert_pressure,
    find_rounding,
    fit_width,
)
from granphon.fits.measurements import Measurements
from granphon.fits.velocity_model import VelocityModel, Waves
from granphon.media.choice import MediumChoice
from granphon.observables.velocities import pulse_velocities, sound_velocities
from tests.conftest import only

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
#: the fit of Section IV, at forces of its range
WIDTH = 2.04e-6
BALLS = gp.Packing(STEEL, 8e-3)
FORCE = np.geomspace(2.0, 18.446, 12)
KINDS = gp.Discrete((7.9985e-3, 8.0003e-3, 8.0009e-3), (0.3, 0.3, 0.4))


def velocities(packing, medium="ema", force=FORCE, branch="longitudinal", **options):
    state = MediumChoice.parse(medium).of(packing).at_force(force, **options)
    return np.asarray(getattr(sound_velocities(state, (0.0, 1.0)), branch))


def spread_over(width, spread=None, packing=BALLS):
    return change_packing(replace(packing, spread=spread), {"width": width})


TRUE = spread_over(WIDTH)
EXACT = {medium: velocities(TRUE, medium) for medium in ("afa", "ema")}


# -- exact data ------------------------------------------------------------------------------------


@given(
    st.floats(np.log(0.3e-6), np.log(20e-6)),
    st.sampled_from(["afa", "ema", {"ema": {"local_field": "paper"}}]),
)
@settings(max_examples=5)
def test_exact_data_give_the_width_to_rounding(log, medium):
    width = float(np.exp(log))
    fit = fit_width(BALLS, FORCE, velocities(spread_over(width), medium), medium=medium)
    assert_allclose(fit.width, width, rtol=1e-9)
    assert np.isnan(fit.stderr)  # it would rest on rounding alone
    assert any("rounding" in warning for warning in fit.warnings)
    assert fit.medium == MediumChoice.parse(medium).label


@pytest.mark.parametrize(
    "spread", [gp.Normal(1e-6), gp.Normal(1e-6, 1.5), gp.Discrete((7.999e-3, 8.001e-3), (0.5, 0.5))]
)
def test_the_shape_is_that_of_the_spread_and_its_width_does_not_matter(spread):
    truth = spread_over(WIDTH, spread)
    fit = fit_width(replace(BALLS, spread=spread), FORCE, velocities(truth, "afa"), medium="afa")
    assert_allclose(fit.width, WIDTH, rtol=1e-9)
    assert type(fit.packing.spread) is type(spread)
    assert_allclose(fit.packing.width, WIDTH, rtol=1e-9)


def test_errors_of_inputs_add_up_with_their_correlations_and_need_one_of_each():
    fit = gp.fit_width(BALLS, FORCE, velocities(spread_over(4e-6)), sigma=1.0)
    changes = np.array([[3e-7], [4e-7]])
    for correlation, variance in ((0.0, 25e-14), (-1.0, 1e-14)):
        matrix = [[1.0, correlation], [correlation, 1.0]]
        wider = fit.with_input_errors(changes, matrix)
        assert_allclose(wider.covariance - fit.covariance, variance, rtol=1e-6)
    for wrong_changes, wrong_correlation, words in (
        (3e-7, 1.0, "changes"),
        ([[3e-7, 1.0]], [[1.0]], "changes"),
        (changes, [[1.0]], "correlation"),
        (changes, [[1.0, 1.1], [1.1, 1.0]], "eigenvalue"),
        ("wide", [[1.0]], "changes"),
    ):
        with pytest.raises(InputError, match=words):
            fit.with_input_errors(wrong_changes, wrong_correlation)


@pytest.mark.parametrize("start", [1e-13, 1e-9, 1e-7, 1e-4])
def test_the_start_does_not_matter(start):
    fit = fit_width(spread_over(start), FORCE, EXACT["ema"])
    assert_allclose(fit.width, WIDTH, rtol=1e-9)


@pytest.mark.parametrize(
    ("width", "sigma", "lowest"),
    [(60e-6, (1.0, 3.0), 1), pytest.param(100e-6, (10.0, 50.0), 0, marks=pytest.mark.slow)],
)
def test_of_two_minima_the_deeper_is_found(width, sigma, lowest):
    # some data ask for a small width and many for a large one
    force = np.repeat([2.0, 30.0], [3, 40])
    sigmas = np.repeat(sigma, [3, 40])
    wanted = np.where(
        force < 3.0,
        velocities(spread_over(0.5e-6), force=force),
        velocities(spread_over(width), force=force),
    )

    def misfit(log):
        speeds = velocities(spread_over(np.exp(log)), force=[2.0, 30.0])
        return np.sum(((np.repeat(speeds, [3, 40]) - wanted) / sigmas) ** 2)

    logs = np.linspace(np.log(0.1e-6), np.log(300e-6), 30)
    squares = np.array([misfit(log) for log in logs])
    places = np.flatnonzero((squares[1:-1] < squares[:-2]) & (squares[1:-1] < squares[2:])) + 1
    minima = [minimize_scalar(misfit, logs[[at - 1, at, at + 1]], tol=1e-4) for at in places]
    assert len(minima) == 2
    assert np.argmin([minimum.fun for minimum in minima]) == lowest
    for start in (1e-6, 35e-6):
        fit = fit_width(spread_over(start), force, wanted, sigmas)
        assert_allclose(fit.width, np.exp(minima[lowest].x), rtol=4e-3)
        assert fit.chi2 <= minima[lowest].fun * (1.0 + 1e-9)


@pytest.mark.parametrize("name", ["young_modulus", "diameter"])
def test_a_second_parameter_is_found_from_far_away(name):
    truth = change_packing(TRUE, {name: {"young_modulus": 150e9, "diameter": 6e-3}[name]})
    fit = fit_width(BALLS, FORCE, velocities(truth), parameters=("width", name))
    assert_allclose(
        fit.values, [WIDTH, {"young_modulus": 150e9, "diameter": 6e-3}[name]], rtol=1e-8
    )
    assert_allclose(velocities(fit.packing), velocities(truth), rtol=1e-10)
    assert fit.parameters == ("width", name)


def test_listed_diameters_move_along_with_their_mean():
    balls = gp.Packing(STEEL, KINDS.mean, KINDS)
    fit = fit_width(
        balls,
        FORCE,
        velocities(balls, "afa") * 1.01,
        medium="afa",
        parameters=("diameter", "width"),
    )
    assert_allclose(fit.packing.diameter, fit.values[0], rtol=1e-14)
    assert_allclose(fit.packing.width, fit.width, rtol=1e-9)
    assert fit.packing.spread.fractions == KINDS.fractions
    assert_allclose(velocities(fit.packing, "afa"), fit.velocities, rtol=1e-9)


@pytest.mark.parametrize("options", [{"branch": "transverse"}, {"finite_overlap": True}])
def test_the_other_branch_and_finite_overlap(options):
    fit = fit_width(BALLS, FORCE, velocities(TRUE, **options), **options)
    assert_allclose(fit.width, WIDTH, rtol=1e-7)
    assert_allclose(fit.velocity_at(FORCE), fit.velocities, rtol=1e-12)


def test_a_lattice_with_velocities_of_its_own_in_each_direction():
    square = replace(BALLS, lattice="square")
    state = gp.EffectiveMedium(spread_over(WIDTH, packing=square)).at_force(FORCE)
    for direction in ((1.0, 0.0), (1.0, 1.0)):
        found = fit_width(
            square, FORCE, sound_velocities(state, direction).longitudinal, direction=direction
        )
        assert_allclose(found.width, WIDTH, rtol=1e-9)


# -- derivatives -----------------------------------------------------------------------------------


def require_derivatives(model, logs, step, rtol, atol):
    """Compare the derivatives of a model with differences of the logarithms of its velocities, of
    fourth order.
    """
    slopes = model(logs)[1]
    for column, move in enumerate(step * np.eye(len(logs))):
        logged = [np.log(model(logs + n * move)[0]) for n in (-2, -1, 1, 2)]
        twin = (8.0 * (logged[2] - logged[1]) - (logged[3] - logged[0])) / (12.0 * step)
        assert_allclose(slopes[:, column], twin, rtol=rtol, atol=atol)


@pytest.mark.parametrize(
    ("frequency", "finite", "rtol"),
    [(None, False, 2e-8), (6500.0, False, 2e-6), (None, True, 1e-3)],
)
@pytest.mark.parametrize("medium", ["afa", "ema"])
def test_derivatives_are_those_of_the_velocities(medium, frequency, finite, rtol):
    waves = Waves("longitudinal", np.array([0.0, 1.0]), frequency, finite)
    model = VelocityModel(
        TRUE, ("width", "young_modulus", "diameter"), MediumChoice(medium), FORCE[::5], waves
    )
    require_derivatives(model, model.find_start(WIDTH), 1e-4, rtol, 1e-8)


@pytest.mark.parametrize(
    ("name", "log"),
    [("width", -800.0), ("width", 800.0), ("diameter", -800.0), ("diameter", 800.0)],
)
def test_a_parameter_beyond_all_floats_is_refused(name, log):
    waves = Waves("longitudinal", np.array([0.0, 1.0]), None, False)
    model = VelocityModel(TRUE, (name,), MediumChoice("ema"), FORCE[:2], waves)
    with pytest.raises(InputError, match=name):
        model(np.array([log]))


# -- noisy data ------------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [np.linspace(2.0, 9.0, 12), None])
def test_width_and_error_are_those_of_a_second_engine(sigma):
    noisy = EXACT["ema"] + np.random.default_rng(5).normal(size=12) * 5.0

    def model(_, microns, gigapascal):
        return velocities(
            change_packing(BALLS, {"width": microns * 1e-6, "young_modulus": gigapascal * 1e9})
        )

    fit = fit_width(BALLS, FORCE, noisy, sigma, parameters=("width", "young_modulus"))
    best, covariance = curve_fit(
        model, FORCE, noisy, (2.0, 211.0), sigma, absolute_sigma=sigma is not None
    )
    units = np.array([1e-6, 1e9])
    assert_allclose(fit.values, best * units, rtol=1e-5)
    assert_allclose(fit.covariance, covariance * np.outer(units, units), rtol=1e-3)
    assert_allclose(fit.residuals, noisy - fit.velocities, rtol=1e-12)
    assert_allclose(fit.chi2, np.sum((fit.residuals / fit.sigma) ** 2), rtol=1e-9)


def repeated(count, errors, seed, **options):
    """(fit - truth) over its standard error, and the fits, of experiments that differ by their
    noise.
    """
    exact = EXACT[options["medium"]]
    noise = np.random.default_rng(seed).normal(size=(count, *FORCE.shape)) * errors
    fits = [fit_width(BALLS, FORCE, exact + one, **options) for one in noise]
    return np.array([(fit.width - WIDTH) / fit.stderr for fit in fits]), fits


@pytest.fixture
def remembered(monkeypatch):
    """What the model has said of some parameters is not computed again: experiments differ by their
    noise alone.
    """
    said = {}
    compute = VelocityModel.__call__

    def call(model, logs):
        key = (
            model.packing,
            model.names,
            model.choice.label,
            model.force.tobytes(),
            logs.tobytes(),
        )
        if key not in said:
            said[key] = compute(model, logs)
        return said[key]

    monkeypatch.setattr(VelocityModel, "__call__", call)


@pytest.mark.claim("tutorial-fit")
@pytest.mark.usefixtures("remembered")
@pytest.mark.parametrize(
    ("medium", "count"),
    [
        ("ema", 60),
        pytest.param("afa", 300, marks=pytest.mark.exhaustive),
    ],
)
def test_errors_of_given_sigma_are_right_in_repeated_experiments(medium, count):
    sigma = np.linspace(6.0, 2.0, 12)
    pulls, fits = repeated(count, sigma, 1, medium=medium, sigma=sigma)
    assert abs(pulls.mean()) < 3.0 / np.sqrt(count)
    assert abs(pulls.std(ddof=1) - 1.0) < 3.0 / np.sqrt(2.0 * count)
    assert kstest(pulls, "norm").pvalue > 0.01
    assert kstest([fit.chi2 for fit in fits], chi2_distribution(11).cdf).pvalue > 0.01
    # p is as likely to have any value, and so few fits are warned of
    assert kstest([fit.p for fit in fits], "uniform").pvalue > 0.01
    assert_allclose(fits[0].p, chi2_distribution(11).sf(fits[0].chi2), rtol=1e-10)
    assert (
        sum(bool(fit.warnings) for fit in fits) <= max(2, 0.01 * count) + (medium == "afa") * count
    )


@pytest.mark.claim("tutorial-fit")
@pytest.mark.usefixtures("remembered")
@pytest.mark.parametrize("count", [16, pytest.param(60, marks=pytest.mark.slow)])
def test_errors_from_the_scatter_follow_student(count):
    pulls = []
    fits = []
    noise = np.random.default_rng(2).normal(size=(count, 3)) * 4.0
    for one in noise:
        fits.append(fit_width(BALLS, FORCE[::4], EXACT["afa"][::4] + one, medium="afa"))
        pulls.append((fits[-1].width - WIDTH) / fits[-1].stderr)
    assert {fit.dof for fit in fits} == {2}
    assert kstest(pulls, "t", args=(2,)).pvalue > 0.01
    # a normal law, which three data are too few for, has 0.3 %
    assert np.mean(np.abs(pulls) > 3.0) > 0.05
    assert_allclose(
        np.mean([fit.sigma[0] ** 2 for fit in fits]), 16.0, rtol=3.0 * np.sqrt(2.0 / (2 * count))
    )


@pytest.mark.usefixtures("remembered")
@pytest.mark.parametrize("count", [6, pytest.param(40, marks=pytest.mark.slow)])
def test_the_covariance_of_two_parameters_is_their_scatter(count):
    sigma = 2.0
    _, fits = repeated(
        count, sigma, 3, medium="afa", sigma=sigma, parameters=("width", "young_modulus")
    )
    off = np.array([fit.values for fit in fits]) - [WIDTH, 211.65e9]
    distance = [x @ np.linalg.solve(fit.covariance, x) for x, fit in zip(off, fits, strict=True)]
    assert kstest(distance, chi2_distribution(2).cdf).pvalue > 0.01
    expected = fit_width(
        BALLS, FORCE, EXACT["afa"], sigma, medium="afa", parameters=("width", "young_modulus")
    ).covariance
    correlation = expected[0, 1] / np.sqrt(expected[0, 0] * expected[1, 1])
    assert abs(np.corrcoef(off.T)[0, 1] - correlation) < 4.0 * (1.0 - correlation**2) / np.sqrt(
        count
    )
    assert_allclose(off.std(axis=0), np.sqrt(np.diag(expected)), rtol=3.0 / np.sqrt(2.0 * count))


def test_one_sigma_is_as_many_and_scales_the_error():
    noisy = EXACT["afa"] + np.random.default_rng(7).normal(size=12)
    one, many, double = (
        fit_width(BALLS, FORCE, noisy, s, medium="afa") for s in (3.0, np.full(12, 3.0), 6.0)
    )
    assert one == many
    assert_allclose(
        [double.width, double.stderr, double.chi2],
        [one.width, 2.0 * one.stderr, one.chi2 / 4.0],
        rtol=1e-6,
    )
    assert one.dof == 11


def test_without_sigma_the_units_of_the_scatter_do_not_matter():
    noisy = EXACT["afa"] + np.random.default_rng(8).normal(size=12) * 3.0
    fit = fit_width(BALLS, FORCE, noisy, medium="afa")
    given = fit_width(BALLS, FORCE, noisy, fit.sigma, medium="afa")
    assert_allclose(
        [given.width, given.stderr, given.chi2], [fit.width, fit.stderr, 11.0], rtol=1e-6
    )
    assert fit.chi2 == 11.0


# -- pulses ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pulses():
    return pulse_velocities(gp.EffectiveMedium(TRUE).at_force(FORCE), 6500.0, (0.0, 1.0)).group[0]


def test_the_frequency_of_the_pulses_shifts_the_width(pulses):
    fit = fit_width(BALLS, FORCE, pulses, frequency=6500.0)
    assert_allclose(fit.width, WIDTH, rtol=1e-9)
    assert fit.waves.frequency == 6500.0
    assert_allclose(fit.velocity_at(FORCE[3]), pulses[3], rtol=1e-9)
    # at the 6.5 kHz of the experiment a pulse is up to 4 % slower than long waves are: taken for
    # one, it costs a quarter
    assert_allclose(1.0 - (pulses / EXACT["ema"])[[0, -1]], [0.0435, 0.0163], atol=5e-5)


def test_a_fit_without_the_frequency_of_its_data_finds_another_width(pulses):
    """And so does one with the frequency of pulses of data that are long waves."""
    naive = fit_width(BALLS, FORCE, pulses)
    assert_allclose(naive.width, 2.61e-6, rtol=5e-3)
    other_way = fit_width(BALLS, FORCE[::4], EXACT["ema"][::4], frequency=6500.0)
    assert_allclose(other_way.width, 1.56e-6, rtol=5e-3)


def test_a_frequency_in_another_unit_is_told(pulses):
    """6.5 for 6.5 kHz: a wave of some 75 m, thousands of balls."""
    warnings, right = (
        fit_width(BALLS, FORCE[::6], pulses[::6], frequency=hertz).warnings
        for hertz in (6.5, 6500.0)
    )
    assert len([line for line in warnings if "6.5 Hz" in line]) == 1
    assert not any("Is the frequency" in line for line in right)


def test_every_pulse_may_have_a_frequency_of_its_own():
    hertz = np.linspace(500.0, 5000.0, 3)
    group = pulse_velocities(
        gp.EffectiveMedium(TRUE).at_force(FORCE[::4]), hertz, (1.0, 0.0)
    ).group[0]
    fit = fit_width(BALLS, FORCE[::4], group, frequency=hertz, direction=(1.0, 0.0))
    assert_allclose(fit.width, WIDTH, rtol=1e-9)
    with pytest.raises(InputError, match="many frequencies"):
        fit.velocity_at(3.0)


def test_an_empty_medium_is_none():
    fit = fit_width(BALLS, FORCE[::4], velocities(TRUE, force=FORCE[::4]))
    with pytest.raises(InputError, match="medium"):
        fit.velocity_at(3.0, "")


def test_a_frequency_above_the_band_is_named():
    state = gp.AveragedLattice(BALLS).at_force(4.0)
    hertz = np.full(12, 6500.0)
    hertz[[2, 4]] = 1e6, 1e5
    words = r"2 of 12 data.* Datum 3 has 1e\+06 Hz at 2\.995 N"
    with pytest.raises(UnreachableFrequencyError, match=words):
        fit_width(BALLS, FORCE, EXACT["ema"], frequency=hertz)
    # just below the top that is named a pulse goes, and just above it none
    waves = Waves("longitudinal", np.array([0.0, 1.0]), None, False)
    top = float(waves.find_tops(state))
    pulse_velocities(state, 0.9999 * top, (0.0, 1.0), branches="longitudinal")
    with pytest.raises(UnreachableFrequencyError):
        pulse_velocities(state, 1.0001 * top, (0.0, 1.0), branches="longitudinal")
    with pytest.raises(UnreachableFrequencyError, match=f"ends at {top:.6g} Hz"):
        fit_width(BALLS, [4.0, 9.0], [500.0, 600.0], frequency=1.0001 * top)


@pytest.mark.parametrize(
    ("names", "remedy"),
    [(("young_modulus",), "Young modulus"), (("width", "diameter"), "diameter")],
)
def test_a_fit_that_starts_below_the_frequency_says_how_to_start(names, remedy):
    top = Waves("longitudinal", np.array([0.0, 1.0]), None, False).find_tops(
        gp.AveragedLattice(BALLS).at_force(4.0)
    )
    force = [4.0, 9.0, 16.0]
    velocity = [500.0, 600.0, 700.0]
    with pytest.raises(UnreachableFrequencyError, match=remedy):
        fit_width(BALLS, force, velocity, 5.0, 1.01 * float(top), parameters=names)


def test_a_pressure_on_a_line_is_the_force_whatever_the_diameter():
    chain = gp.Packing(BALLS.material, BALLS.diameter, lattice="chain")
    assert convert_pressure(chain, False, "ala", ("diameter",), 18.0) == pytest.approx(18.0)
    with pytest.raises(InputError, match="diameter"):
        convert_pressure(BALLS, False, "ala", ("diameter",), 18.0)


def test_the_top_of_each_load_with_finite_overlap():
    force = np.array([2.0, 18.0])
    waves = Waves("transverse", np.array([0.0, 1.0]), None, True)
    soft = change_packing(BALLS, {"young_modulus": 1e8})
    tops = waves.find_tops(gp.AveragedLattice(soft).at_force(force, finite_overlap=True))
    for top, one in zip(tops, force, strict=True):
        state = gp.AveragedLattice(soft).at_force(one, finite_overlap=True)
        pulse_velocities(state, 0.9999 * top, (0.0, 1.0), branches="transverse")
        with pytest.raises(UnreachableFrequencyError):
            pulse_velocities(state, 1.0001 * top, (0.0, 1.0), branches="transverse")


def test_a_frequency_too_high_for_the_velocities_is_blamed_and_not_the_material():
    # long waves of the balls, taken for pulses near the top of the branch, are faster than such
    # pulses can be
    with pytest.raises(InputError, match=r"pulses .*Datum 1 has 22000 Hz at 2 N") as error:
        fit_width(BALLS, FORCE, EXACT["ema"], 3.0, frequency=22e3)
    assert "modulus" not in str(error.value)


def test_a_spread_that_does_not_carry_the_frequency_is_named():
    """Slow pulses ask for so wide a spread that it carries their frequency no longer."""
    with pytest.raises(InputError, match=r"carry .*Datum 1 has 20000 Hz at 2 N") as error:
        fit_width(BALLS, FORCE[::2], 0.1 * IDEAL[::2], 5.0, frequency=20e3)
    assert "modulus" not in str(error.value)


def test_velocities_too_fast_for_long_waves_too_are_those_of_another_material():
    with pytest.raises(InputError, match="Check the Young modulus"):
        fit_width(BALLS, FORCE[::3], 1.1 * IDEAL[::3], 3.0, frequency=6.5e3)


# -- data that do not say --------------------------------------------------------------------------

IDEAL = velocities(BALLS)
NOISY = EXACT["ema"] + 4.0 * np.random.default_rng(11).normal(size=12)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"velocity": EXACT["ema"][:3]}, "12 of force, 3 of velocity"),
        ({"sigma": [1.0, 2.0]}, "2 of sigma"),
        ({"frequency": [1.0, 2.0]}, "2 of frequency"),
        ({"velocity": np.where(FORCE > 10, np.nan, 500.0)}, "velocity: found nan"),
        ({"force": -FORCE}, "force: found -2.0"),
        ({"sigma": 0.0}, "sigma: found 0.0"),
        ({"force": FORCE.reshape(3, 4)}, "force: found"),
        ({"force": [], "velocity": []}, "force: found"),
        (
            {"force": 2.0, "velocity": 500.0},
            r"1 measurement.* sigma",
        ),
        (
            {"force": 2.0, "velocity": 500.0, "sigma": 1.0, "parameters": ("width", "diameter")},
            "width and diameter",
        ),
        ({"parameters": ("width", "young_modulu")}, "young_modulus"),
        ({"parameters": ()}, "Give one or more"),
        ({"parameters": ("width", "width")}, "at most once"),
        ({"branch": "L"}, r"branch: .*'L'.*longitudinal"),
        ({"direction": (0.0, 0.0)}, "direction"),
        ({"medium": "eam"}, r"found 'eam'; .*'ema'"),
        ({"medium": "ala"}, r"'ala' .*width"),
        ({"velocity": IDEAL}, "width .*from zero"),
        ({"velocity": IDEAL, "sigma": 5.0}, "width .*from zero"),
        ({"velocity": 1.1 * IDEAL}, r" 10 % above"),
        ({"velocity": 1.001 * IDEAL, "sigma": 5.0}, r"0\.1 % above"),
        (
            {"velocity": EXACT["ema"] / 20.0},
            r"no width fits.* [mu]m.* units",
        ),
        (
            {"velocity": EXACT["ema"] / 1e3},
            r"0\.000888 to 0\.000996 .* units",
        ),
        (
            {"force": EXACT["ema"], "velocity": FORCE},
            "columns .*swapped",
        ),
        ({"velocity": EXACT["ema"][::-1]}, "width .*from zero"),
        (
            {"sigma": 200.0, "parameters": ("width", "young_modulus")},
            "standard error|from zero",
        ),
        (
            {"parameters": ("width", "young_modulus", "diameter"), "sigma": 1.0},
            "long waves depend",
        ),
        ({"force": np.full(12, 4.0), "parameters": ("width", "diameter")}, "told from zero"),
    ],
)
def test_data_that_cannot_determine_the_parameters_are_refused(options, words):
    given = {"force": FORCE, "velocity": EXACT["ema"], **options}
    with pytest.raises(InputError, match=words):
        fit_width(BALLS, **given)


@pytest.mark.usefixtures("remembered")
@pytest.mark.parametrize("sigma", [None, pytest.param(0.01, marks=pytest.mark.slow)])
def test_data_above_the_velocity_of_equal_balls_are_told(sigma):
    """10 % too fast, at loads so low that a width is found all the same."""
    force = np.geomspace(1.0, 18.446, 12)
    truth = spread_over(1.5 * WIDTH)
    exact = velocities(truth, force=force)
    ideal = velocities(BALLS, "ala", force=force)
    fast = 1.1 * exact
    fit = fit_width(BALLS, force, fast, None if sigma is None else sigma * fast)
    (told,) = [text for text in fit.warnings if "not a width" in text]
    most = int(np.argmax(fast / ideal))
    assert re.match(r"[4-7] of 12 data .*8\.9 % \(datum 12, ", told)
    assert f"{100.0 * (fast[most] / ideal[most] - 1.0):.2g} %" == "8.9 %"
    assert "young_modulus" in told
    both = fit_width(
        BALLS,
        force,
        fast,
        None if sigma is None else sigma * fast,
        parameters=("width", "young_modulus"),
    )
    assert not any("not a width" in text for text in both.warnings)
    # noise that puts data above equal balls is not told of
    noise = 1.0 + 0.01 * np.random.default_rng(7).normal(size=(10, 12))
    noisy = [
        fit_width(BALLS, FORCE, EXACT["ema"] * one, None if sigma is None else sigma * EXACT["ema"])
        for one in noise
    ]
    assert sum(bool(np.any(one.velocity > velocities(BALLS, "ala"))) for one in noisy) > 2
    assert sum(any("not a width" in text for text in one.warnings) for one in noisy) <= 1


def test_a_narrow_range_of_force_does_not_tell_two_parameters():
    force = np.linspace(4.0, 4.2, 12)
    with pytest.raises(InputError, match=r"from zero|determine"):
        fit_width(
            BALLS, force, velocities(TRUE, force=force), 5.0, parameters=("width", "young_modulus")
        )
    assert fit_width(BALLS, force, velocities(TRUE, force=force), 5.0).stderr < 0.05 * WIDTH


def test_at_high_pressure_only_the_ideal_lattice_is_heard():
    force = FORCE * 1e3
    exact = velocities(TRUE, force=force)
    with pytest.raises(InputError, match="no slowing of sound"):
        fit_width(BALLS, force, exact, 5.0)
    assert_allclose(fit_width(BALLS, force, exact, 1e-3).width, WIDTH, rtol=1e-4)


def test_balls_of_one_listed_size_have_no_shape_to_widen():
    with pytest.raises(InputError, match="depend on the width"):
        fit_width(replace(BALLS, spread=gp.Measured((8e-3, 8e-3))), FORCE, EXACT["ema"])


def test_loads_outside_the_range_of_the_medium_are_counted():
    force = np.append(FORCE, [0.5, 1.0])
    fit = fit_width(BALLS, force, velocities(TRUE, force=force))
    assert any(re.search(r"2 of the 14 .* 0\.5 N", warning) for warning in fit.warnings)
    assert (
        fit_width(BALLS, FORCE, NOISY, 4.0).warnings
        == fit_width(BALLS, FORCE, NOISY).warnings
        == ()
    )


def test_a_model_that_does_not_fit_and_loads_too_high_are_said():
    wrong = EXACT["ema"] * (1.0 - 0.05 * np.sin(np.arange(12.0)))
    assert any(
        "times what sigma says" in warning
        for warning in fit_width(BALLS, FORCE, wrong, 1.0).warnings
    )
    soft = change_packing(BALLS, {"young_modulus": 1e6})
    force = FORCE * 1e-2
    heavy = velocities(spread_over(100e-6, packing=soft), force=force)
    assert any(
        "radius of a contact" in warning for warning in fit_width(soft, force, heavy).warnings
    )


# -- how far a fit is to be trusted ----------------------------------------------------------------


def test_with_no_degrees_of_freedom_nothing_is_said_of_the_fit():
    fit = fit_width(BALLS, 4.0, 550.0, 5.0)
    assert fit.dof == 0
    assert np.isnan(fit.p)
    assert any("0 degrees of freedom" in warning for warning in fit.warnings)
    assert not any("times what sigma says" in warning for warning in fit.warnings)
    assert_allclose(fit.velocities, 550.0, rtol=1e-9)
    # the derivative of the velocity takes the error of the datum to that of the width
    near = [velocities(spread_over(fit.width + step), force=4.0) for step in (-1e-9, 1e-9)]
    assert_allclose(fit.stderr, 5.0 * 2e-9 / (near[0] - near[1]), rtol=1e-4)


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_residuals_too_large_or_too_small_for_sigma_are_said_with_p(factor):
    fit = fit_width(BALLS, FORCE, NOISY, 4.0 * factor)
    p = chi2_distribution(11).sf(fit.chi2)
    assert_allclose(fit.p, p, rtol=1e-9)
    assert not 1e-3 < p < 0.999
    words = "sigma is too small" if factor < 1.0 else "sigma is too large"
    (warning,) = fit.warnings
    assert f"p = {p:.2g}" in warning
    assert words in warning
    assert np.isnan(fit_width(BALLS, FORCE, NOISY).p)


def test_a_sigma_far_below_the_scatter_is_accepted_as_the_minimum_is_found():
    noisy = EXACT["ema"] + 20.0 * np.random.default_rng(0).normal(size=12)
    fit, plain = (fit_width(BALLS, FORCE, noisy, sigma) for sigma in (1e-9, None))
    assert_allclose(fit.width, plain.width, rtol=1e-6)
    assert any("p = 0" in warning for warning in fit.warnings)
    with pytest.raises(InputError, match=r"small .*1e-12"):
        fit_width(BALLS, FORCE, noisy, 1e-10)
    with pytest.raises(InputError, match=r"sigma .*large"):
        fit_width(BALLS, FORCE, noisy, 1e16)


@pytest.mark.parametrize("name", ["young_modulus", "width"])
def test_a_place_off_the_minimum_is_not_blamed_on_the_data(name):
    waves = fit_width(BALLS, FORCE, EXACT["ema"], 5.0).waves
    model = VelocityModel(TRUE, (name,), MediumChoice("ema"), FORCE, waves)
    problem = FitProblem.of(model, Measurements(FORCE, EXACT["ema"], 5.0))
    minimum = np.log([TRUE.width if name == "width" else STEEL.young_modulus])
    assert _find_covariance(problem, minimum).shape == (1, 1)
    for factor in (0.9, 1.1):
        with pytest.raises(InputError, match=f"search for {name} has not ended at a minimum"):
            _find_covariance(problem, minimum + np.log(factor))


@pytest.mark.parametrize("speeds", [[480.0] * 3, [480.123456] * 3, [480.0, 480.0, 480.0 + 1e-12]])
def test_errors_that_rest_on_rounding_are_not_known(speeds, tmp_path):
    fit = fit_width(BALLS, [4.0] * 3, speeds)
    assert np.isnan(fit.stderr)
    assert np.isnan(fit.std_stderr)
    assert not fit.errors_are_known
    assert any("rounding" in warning for warning in fit.warnings)
    assert WidthFit.from_dict(fit.to_dict()) == fit
    fit.write(tmp_path)
    assert "stderr: .nan\n" in (tmp_path / "fit.yaml").read_text(encoding="utf-8")
    known = fit_width(BALLS, [4.0] * 3, speeds, 5.0)
    assert np.isfinite(known.stderr)
    assert_allclose(known.width, fit.width, rtol=1e-6)


def test_the_unit_of_the_last_decimal():
    for values, unit in (
        ([480.0, 490.0], 10.0),
        ([480.12, 480.1], 0.01),
        ([1.5e-3, 2e-3], 1e-4),
        ([1e3, 2e3], 1e3),
        ([0.3048 * 1601, 0.3048 * 1603], 1e-4),
        ([np.pi, 3.0], 1e-11 * np.pi),
        ([2e-307, 3e-307], 1e-307),
        ([5e-324], 0.0),
    ):
        assert_allclose(find_rounding(np.array(values)), unit, rtol=1e-12)


def test_leverages_are_the_diagonal_of_the_projection():
    matrix = np.random.default_rng(4).normal(size=(9, 2)) * [1.0, 1e6]
    projection = matrix @ np.linalg.inv(matrix.T @ matrix) @ matrix.T
    assert_allclose(compute_leverages(matrix), np.diag(projection), rtol=1e-9)
    assert_allclose(compute_leverages(np.array([[3.0], [4.0]])), [0.36, 0.64], rtol=1e-14)


def test_one_far_load_decides_alone():
    """Of loads so high that hardly a width is heard, and one low: its leverage is its part of the
    squares of derivatives.
    """
    force = np.append(np.linspace(400.0, 500.0, 6), 3.0)
    noise = np.array([1.0, -0.5, 0.7, -1.1, 0.3, -0.4, 0.0])
    fit = fit_width(BALLS, force, velocities(TRUE, force=force) + 2.0 * noise, 2.0)
    low, high = (
        velocities(spread_over(fit.width * factor), force=force) for factor in (0.999, 1.001)
    )
    leverage = ((high - low) ** 2 / np.sum((high - low) ** 2))[-1]
    assert leverage > 0.9
    assert [
        w
        for w in fit.warnings
        if w.startswith("datum 7") and f"its leverage is {leverage:.4g}"[:-1] in w
    ]
    several = fit_width(BALLS, FORCE, NOISY, 4.0)
    assert not any("leverage" in warning for warning in several.warnings)


@pytest.mark.parametrize(
    ("sigma", "factor", "rtol"), [(None, 0.95, 0.02), (4.0, 0.9, 0.05), (0.4, 0.9, 0.05)]
)
def test_a_wild_datum_is_named(sigma, factor, rtol):
    """By its sigma where the others agree with theirs, else by the scatter of the others."""
    wild = NOISY.copy()
    others = np.arange(12) != 5
    wild[5] *= factor
    fit = fit_width(BALLS, FORCE, wild, sigma)
    assert sigma is None or fit.p < 1e-3
    (warning,) = [w for w in fit.warnings if "off the fit" in w]
    assert warning.startswith("datum 6")
    # its t is the distance from a fit that leaves it out, over the standard error of that distance
    left = fit_width(BALLS, FORCE[others], wild[others], sigma)
    assert sigma is None or (left.p > 0.05) == (sigma == 4.0)
    error = np.sqrt(left.chi2 / left.dof) if sigma == 0.4 else 1.0
    slope = (
        np.ptp(
            [velocities(spread_over(left.width + step), force=FORCE[5]) for step in (-1e-9, 1e-9)]
        )
        / 2e-9
    )
    distance = (
        (left.velocity_at(FORCE[5]) - wild[5])
        / np.hypot(left.sigma[0], slope * left.stderr)
        / error
    )
    assert float(re.search(r"lies (\S+)", warning)[1]) == pytest.approx(distance, rel=rtol)


def test_an_error_as_large_as_the_width_is_said():
    large = fit_width(BALLS, FORCE, EXACT["ema"] * (1.0 + 0.15 * np.array([1.0, -1.0] * 6)))
    part = large.stderr / large.width
    assert part > 0.5
    assert any(f"width is {part:.2g}" in warning for warning in large.warnings)


@pytest.mark.usefixtures("remembered")
@pytest.mark.parametrize("sigma", [None, 4.0])
def test_a_datum_is_seldom_called_wild_by_chance(sigma):
    fits = [
        fit_width(
            BALLS,
            FORCE,
            EXACT["afa"] + 4.0 * np.random.default_rng(s).normal(size=12),
            sigma,
            medium="afa",
        )
        for s in range(8)
    ]
    assert sum("off the fit" in w for fit in fits for w in fit.warnings) <= 1


@pytest.mark.parametrize("spread", [None, gp.Uniform(1e-6), gp.Normal(1e-6), KINDS])
def test_the_standard_deviation_is_that_of_the_fitted_spread(spread):
    packing = (
        BALLS if spread is None else replace(BALLS, spread=spread, diameter=spread.mean or 8e-3)
    )
    fit = fit_width(packing, FORCE, NOISY, 4.0, medium="afa")
    assert_allclose(
        [fit.std, fit.std_stderr], np.array([fit.width, fit.stderr]) / np.sqrt(12.0), rtol=1e-14
    )
    assert_allclose(fit.packing.spread.rms, fit.std, rtol=1e-9)


# -- the result ------------------------------------------------------------------------------------


def test_equal_balls_have_one_velocity_in_every_medium():
    """As in the fit of their modulus, every medium of equal balls is the averaged lattice."""
    equal = replace(BALLS, spread=None)
    velocity = gp.sound_velocities(gp.AveragedLattice(equal).at_force(FORCE)).longitudinal
    fit = fit_width(equal, FORCE, velocity, 1.0, parameters=("young_modulus",))
    for medium in ("ala", "ema", "simulation"):
        assert_allclose(fit.velocity_at(FORCE, medium), velocity, rtol=1e-9)


def test_a_fit_is_written_whole_or_not_at_all(tmp_path):
    """The files of a fit with the same columns are replaced; if fit.csv has other columns, fit.yaml
    is left as well.
    """
    force, velocity = FORCE[::4], EXACT["ema"][::4]
    fit = fit_width(BALLS, force, velocity, 2.0)
    fit_of_pulses = fit_width(BALLS, force, velocity, 2.0, frequency=6500.0)
    shifted_fit = fit_width(BALLS, force, velocity + 1.0, 2.0)
    paths = [tmp_path / "fit.yaml", tmp_path / "fit.csv"]
    fit.write(tmp_path)
    before = [path.read_bytes() for path in paths]
    with pytest.raises(FileExistsInRunError, match=r"fit\.csv"):
        fit_of_pulses.write(tmp_path)
    assert [path.read_bytes() for path in paths] == before
    assert sorted(tmp_path.iterdir()) == sorted(paths)
    shifted_fit.write(tmp_path)
    assert all(path.read_bytes() != old for path, old in zip(paths, before, strict=True))


def test_the_result_is_plain_data_and_frozen(tmp_path):
    fit = fit_width(
        BALLS,
        FORCE,
        EXACT["ema"] + 1.0,
        2.0,
        parameters=("width", "young_modulus"),
        medium={"ema": None},
    )
    assert WidthFit.from_dict(fit.to_dict()) == fit
    with pytest.raises(ValueError, match="read-only"):
        fit.values[0] = 1.0
    assert_allclose(fit.stderr, np.sqrt(fit.covariance[0, 0]))
    assert_allclose(fit.velocity_at(FORCE, "ala"), velocities(fit.packing, "ala"), rtol=1e-14)
    fit.write(tmp_path)
    again = Measurements.read(tmp_path / "fit.csv")
    np.testing.assert_array_equal(again.velocity, fit.velocity)
    np.testing.assert_array_equal(again.sigma, fit.sigma)
    text = (tmp_path / "fit.yaml").read_text(encoding="utf-8")
    for name in ("width", "stderr", "std", "std_stderr", "p"):
        assert re.search(
            rf"^{name}: {getattr(fit, name)!r}$".replace("+", r"\+"), text, re.MULTILINE
        )
    data = yaml.safe_load(text)
    assert WidthFit.from_dict(data) == WidthFit.from_dict(plain_yaml(text, "fit.yaml")) == fit
    data["velocity"][3] *= 1.0000001
    with pytest.raises(InputError, match="was damaged"):
        WidthFit.from_dict(data)
    for wrong in ([], {"class": "WidthFit"}, data | {"parameters": ["mass", "x"], "digest": None}):
        with pytest.raises(InputError):
            WidthFit.from_dict(wrong)
    assert '  values: "m, Pa"\n  covariance: "m^2, m Pa; Pa m, Pa^2"\n' in text


# -- simulations -----------------------------------------------------------------------------------

#: of balls on each side of a sample
SIDES = [12, pytest.param(32, marks=pytest.mark.slow)]


def take_samples(side):
    """A medium of simulated samples."""
    return {"simulation": {"shape": (side, side), "seed": 1, "geometry": "lattice"}}


def simulate(side, force=FORCE):
    """The state of the samples with the true width."""
    return gp.DirectSimulation(TRUE, (side, side), seed=1, geometry="lattice").at_force(force)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("branch", "frequency"), [("longitudinal", None), ("transverse", 6500.0)])
def test_the_width_of_simulated_samples(branch, frequency):
    """Found again from the same samples, but for the cusps of their moduli, which the model leaves
    out.
    """
    waves = Waves(branch, np.array([0.0, 1.0]), frequency, False)
    data = waves.velocity(simulate(32))[0]
    fit = fit_width(BALLS, FORCE, data, medium=take_samples(32), branch=branch, frequency=frequency)
    assert fit.medium == "simulation(geometry=lattice, seed=1, shape=32 32)"
    assert_allclose(fit.width, WIDTH, rtol=3e-3)
    # about what samples of this size differ by
    assert np.max(np.abs(fit.residuals / data)) < 1.5e-3
    assert_allclose(fit.velocity_at(FORCE), fit.velocities, rtol=1e-9)
    assert fit.velocity_at(FORCE[3]) == pytest.approx(fit.velocities[3], rel=1e-9)
    assert WidthFit.from_dict(fit.to_dict()) == fit
    assert fit.warnings == ()


@pytest.mark.parametrize("side", SIDES)
def test_samples_tell_two_parameters(side):
    force = FORCE[::4]
    data = sound_velocities(simulate(side, force)).longitudinal
    soft = replace(BALLS, material=replace(STEEL, young_modulus=150e9))
    medium = take_samples(side)
    fit = fit_width(soft, force, data, medium=medium, parameters=("width", "young_modulus"))
    assert_allclose(fit.values, (WIDTH, STEEL.young_modulus), rtol=5e-3)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("branch", ["longitudinal", "transverse"])
def test_the_model_of_samples_is_theirs_and_has_its_own_derivatives(branch, side):
    names = ("width", "young_modulus", "diameter")
    waves = Waves(branch, np.array([0.0, 1.0]), None, False)
    model = VelocityModel(
        replace(BALLS, spread=gp.Uniform(1e-7)),
        names,
        MediumChoice.parse(take_samples(side)),
        FORCE[::5],
        waves,
    )
    logs = model.find_start(WIDTH)
    assert_allclose(
        model(logs)[0], getattr(sound_velocities(simulate(side, FORCE[::5])), branch), rtol=1.5e-3
    )
    require_derivatives(model, logs, 1e-5, 2e-4, 1e-6)
    # at its own places the curve is the simulation itself
    unit = TRUE.law.coefficient * WIDTH**1.5
    places = unit * 10.0 ** (np.arange(0, 5, 2) / 8.0)
    exact = replace(model, force=places)(logs)[0]
    state = simulate(side, places)
    assert_allclose(exact, getattr(sound_velocities(state), branch), rtol=1e-7)


def test_samples_of_listed_diameters_move_in_proportion():
    """Of more diameters than the shape of a list keeps, each ball has its own at every width."""
    diameters = tuple((8e-3 + 1e-6 * np.random.default_rng(3).standard_normal(600)).tolist())
    lot = gp.Measured(diameters)
    packing = gp.Packing(STEEL, lot.mean, lot)
    choice = {"simulation": {"shape": (8, 8)}}
    model = VelocityModel(
        packing,
        ("width",),
        MediumChoice.parse(choice),
        FORCE,
        Waves("longitudinal", np.array([0.0, 1.0]), None, False),
    )
    simulation = model._curve.medium
    own = gp.DirectSimulation(packing, (8, 8))
    assert_allclose(simulation.deviations(0), own.deviations(0), rtol=0, atol=1e-8)


PRESSED = {
    "friction_history": True,
    "friction_coefficient": 0.3,
    "shear_response": "stick",
    "step_tolerance": 1e-2,
}
WIDE = spread_over(0.02 * 8e-3)
HIGH = WIDE.width_units.force * 10.0 ** (np.arange(-4, 5) / 8.0)


EXACT_SAMPLES = {"simulation": {"shape": (4, 4), "geometry": "exact"}}


@pytest.mark.parametrize(
    ("branch", "frequency", "force"),
    [
        pytest.param("longitudinal", None, HIGH[::4], marks=pytest.mark.slow),
        ("transverse", 4e4, HIGH[5:6]),
    ],
)
def test_the_model_in_the_exact_geometry_is_the_samples_there(branch, frequency, force):
    """At the places of its own curve; of pulses but for terms of the order of W/d in how they
    disperse.
    """
    waves = Waves(branch, np.array([0.0, 1.0]), frequency, True)
    model = VelocityModel(WIDE, ("width",), MediumChoice.parse(EXACT_SAMPLES), force, waves)
    state = gp.DirectSimulation(WIDE, (4, 4), geometry="exact").at_force(force)
    found = model(model.find_start(WIDE.width))[0]
    assert_allclose(found, waves.velocity(state)[0], rtol=1e-3 if frequency else 1e-10)


@pytest.mark.parametrize(
    ("medium", "frequency"),
    only(
        [("ema", None), (EXACT_SAMPLES, None)],
        itertools.product(("ema", EXACT_SAMPLES), (None, 2e4)),
    ),
)
def test_derivatives_with_finite_overlap(medium, frequency):
    """At overlaps of 4 % of the diameter; of pulses but for terms of this order in how they
    disperse.
    """
    waves = Waves("longitudinal", np.array([0.0, 1.0]), frequency, True)
    between = 1.1 * HIGH  # the curve of samples bends at its own places
    model = VelocityModel(
        WIDE, ("width", "young_modulus", "diameter"), MediumChoice.parse(medium), between, waves
    )
    require_derivatives(
        model, model.find_start(WIDE.width), 1e-3, 1e-5 if frequency is None else 1e-2, 1e-6
    )


def test_two_parameters_are_fitted_with_finite_overlap():
    """At overlaps of 4 % of the diameter, to data that scatter."""
    force = HIGH[::4]
    clean = velocities(WIDE, "ema", force, finite_overlap=True)
    noisy = clean * (1.0 + 0.004 * np.random.default_rng(0).standard_normal(len(force)))
    fit = fit_width(
        WIDE,
        force,
        noisy,
        0.004 * clean,
        parameters=("width", "young_modulus"),
        finite_overlap=True,
    )
    assert np.all(np.abs(fit.values - (WIDE.width, STEEL.young_modulus)) < 3.0 * fit.stderrs)


@pytest.mark.parametrize(
    "options",
    [
        {"geometry": "exact"},
        pytest.param({"geometry": "exact", **PRESSED}, marks=pytest.mark.exhaustive),
        {
            **PRESSED,
            "geometry": "lattice",
            "start": {"force": float(0.08 * WIDE.width_units.force)},
        },
    ],
    ids=["exact", "exact with friction", "from a load"],
)
def test_samples_that_belong_to_one_width_give_it(options):
    """In the exact geometry of balls this different another width than theirs is found in the limit
    of small ones.
    """
    given = {"simulation": {"shape": (4, 4), **options}}
    force = HIGH[2::3]
    data = velocities(WIDE, given, force)
    fit = fit_width(BALLS, force, data, 1.0, medium=given)
    assert_allclose(fit.width, WIDE.width, rtol=1e-2)  # but for the cusps of so few balls
    exact = options["geometry"] == "exact"
    assert fit.waves.finite_overlap == exact
    assert_allclose(fit.velocity_at(force), fit.velocities, rtol=1e-4)
    assert WidthFit.from_dict(fit.to_dict()) == fit
    if exact:
        limit = {"simulation": {"shape": (4, 4), **options, "geometry": "lattice"}}
        assert fit_width(BALLS, force, data, 1.0, medium=limit).width > 1.15 * WIDE.width
        assert not np.allclose(fit.velocity_at(force, limit), fit.velocities, rtol=5e-3)


@pytest.mark.parametrize(
    ("factor", "parameters", "words"),
    [
        (1.02, ("width",), "% above"),
        pytest.param(1.0, ("width", "young_modulus"), "told from zero", marks=pytest.mark.slow),
    ],
)
def test_samples_of_no_width_are_not_simulated_in_the_exact_geometry(factor, parameters, words):
    medium = {"simulation": {"shape": (4, 4), "geometry": "exact"}}
    force = HIGH[::2]
    ideal = velocities(BALLS, "ala", force, finite_overlap=True)
    with pytest.raises(InputError, match=words):
        fit_width(BALLS, force, factor * ideal, 1.0, medium=medium, parameters=parameters)


def test_parameters_that_do_not_settle_are_refused(monkeypatch):
    monkeypatch.setattr("granphon.fits.fit._MOST_SIMULATED", 1)
    given = {"simulation": {"shape": (3, 3), "geometry": "exact"}}
    force = HIGH[4::2]
    with pytest.raises(InputError, match=r"width .*1 .*more balls"):
        fit_width(BALLS, force, velocities(WIDE, given, force), 1.0, medium=given)


def test_pressures_in_the_exact_geometry():
    given = EXACT_SAMPLES
    state = MediumChoice.parse(given).of(WIDE).at_force(HIGH[4])
    assert convert_pressure(WIDE, False, given, ("width",), state.pressure) == pytest.approx(
        HIGH[4], rel=2e-4
    )
    assert (
        abs(convert_pressure(WIDE, False, "ala", ("width",), state.pressure) / HIGH[4] - 1.0) > 1e-2
    )


def test_what_a_simulation_is_not_fitted_to():
    data = EXACT["ema"]
    with pytest.raises(InputError, match=r"simulation.*overlap"):
        fit_width(
            BALLS, FORCE, data, medium={"simulation": {"geometry": "lattice"}}, finite_overlap=True
        )
    with pytest.raises(InputError, match="square"):
        fit_width(
            replace(BALLS, lattice="square"), FORCE, data, medium="simulation", direction=(1, 0)
        )
    with pytest.raises(InputError, match=r"simulation\.samples: .*0"):
        fit_width(BALLS, FORCE, data, medium={"simulation": {"samples": 0}})


# -- the command -----------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    material = "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
    for name, spread, load in (
        ("scene", ", spread: {uniform: 3 um}", "{force: 10 N}"),
        ("frame", "", "{side_force: 990 N, balls_per_side: 31}"),
    ):
        text = f"{material}packing: {{diameter: 8 mm{spread}}}\nload: {load}\n"
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    swept = (tmp_path / "scene.yaml").read_text(encoding="utf-8") + "sweep: {width: [1 um, 2 um]}\n"
    (tmp_path / "swept.yaml").write_text(swept, encoding="utf-8")
    rows = list(zip(FORCE.tolist(), EXACT["ema"].tolist(), strict=True))
    table = "\n".join(["force (N),velocity (km/s)", *(f"{f!r},{v / 1e3!r}" for f, v in rows)])
    flight = "\n".join(
        ["F [kN];t (us)", *(f"{f * 31 * 3**0.5 / 1e3!r};{0.43e6 / v!r}" for f, v in rows)]
    )
    (tmp_path / "data.csv").write_text(table, encoding="utf-8")
    (tmp_path / "flight.csv").write_text(flight, encoding="utf-8")
    (tmp_path / "bare.csv").write_text("force,velocity\n2,500\n4,600\n", encoding="utf-8")
    return tmp_path


def command(*words):
    from granphon.cli.main import main

    return main(["fit", *words])


def test_the_command_never_replaces_what_it_reads(folder, capsys):
    (folder / "data.csv").rename(folder / "fit.csv")
    before = (folder / "fit.csv").read_bytes()
    for words in ([], ["--force"]):
        assert command("scene.yaml", "fit.csv", "-o", ".", *words) == 1
        assert "fit.csv is read" in capsys.readouterr().err
    (folder / "fit.yaml").write_text("mine")
    assert command("scene.yaml", "flight.csv", "-o", ".", "--force") == 1
    assert "no record" in capsys.readouterr().err
    assert ((folder / "fit.csv").read_bytes(), (folder / "fit.yaml").read_text()) == (
        before,
        "mine",
    )


def test_the_command_writes_table_numbers_and_figure(folder, capsys):
    assert command("scene.yaml", "data.csv", "-o", "out") == 0
    assert sorted(path.name for path in (folder / "out").iterdir()) == [
        ".granphon-files",
        "fit.csv",
        "fit.png",
        "fit.yaml",
    ]
    printed = capsys.readouterr().out
    assert "width                 2.04 um, error not known" in printed
    assert "standard deviation    588.9 nm, error not known" in printed
    assert f"velocities            {len(FORCE)}, error not known\n" in printed
    assert "chi^2" not in printed  # it is the degrees of freedom, whatever the data
    assert command("scene.yaml", "data.csv", "-o", "out") == 1
    assert "already holds" in capsys.readouterr().err


def test_errors_that_are_given_are_printed_with_how_well_they_fit(folder, capsys):
    assert command("scene.yaml", "data.csv", "--sigma", "2 m/s") == 0
    printed = capsys.readouterr().out
    assert "each +/- 2 m/s (given)" in printed
    assert "width                 2.040 +/- 0.021 um" in printed
    assert "standard deviation    588.9 +/- 6.2 nm" in printed
    assert re.search(rf"chi\^2 .* for {len(FORCE) - 1} degrees of freedom, p = 1", printed)


def test_the_range_of_errors_is_said_and_none_of_one_datum(folder, capsys):
    assert command("scene.yaml", "data.csv", "--sigma", "1 %") == 0
    least = EXACT["ema"].min() / 100.0
    most = EXACT["ema"].max() / 100.0
    assert f"each +/- {least:.3g} to {most:.3g} m/s (given)" in capsys.readouterr().out
    (folder / "one.csv").write_text(
        "force (N),velocity (ft/s),sigma (%)\n4,1800,1\n", encoding="utf-8"
    )
    assert command("scene.yaml", "one.csv") == 0
    printed = capsys.readouterr()
    assert "each +/- 5.49 m/s (given)" in printed.out
    assert "chi^2                 none" in printed.out
    assert "how well" in printed.err


def test_pressures_are_contact_forces_of_the_packing(folder, capsys):
    scene = folder / "pressed.yaml"
    scene.write_text(
        "material: {young_modulus: 1 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
        "packing: {diameter: 8 mm, spread: {uniform: 20 um}, finite_overlap: true}\n"
        "load: {force: 10 N}\n",
        encoding="utf-8",
    )
    packing = change_packing(spread_over(20e-6), {"young_modulus": 1e9})
    pressure = np.geomspace(600.0, 4000.0, 2)
    state = gp.EffectiveMedium(packing).at_pressure(pressure, finite_overlap=True)
    speeds = sound_velocities(state, (0.0, 1.0)).longitudinal
    rows = "".join(
        f"{p!r},{v!r}\n" for p, v in zip(pressure.tolist(), speeds.tolist(), strict=True)
    )
    (folder / "pressures.csv").write_text(
        "pressure (N/m),velocity (m/s)\n" + rows, encoding="utf-8"
    )
    assert command("pressed.yaml", "pressures.csv", "--sigma", "0.1 %", "-o", "out") == 0
    assert "width                 20.0" in capsys.readouterr().out
    np.testing.assert_allclose(
        Measurements.read(folder / "out" / "fit.csv").force, state.force, rtol=1e-12
    )
    assert command("pressed.yaml", "pressures.csv", "--parameter", "diameter") == 2
    assert "diameter is fitted" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_fits_a_simulated_medium(folder, capsys):
    with (folder / "scene.yaml").open("a", encoding="utf-8") as scene:
        scene.write("medium: {simulation: {shape: 8 8}}\n")
    force = FORCE[::2]
    speeds = velocities(TRUE, {"simulation": {"shape": (8, 8)}}, force)
    rows = zip(force.tolist(), speeds.tolist(), strict=True)
    (folder / "data.csv").write_text(
        "\n".join(["force (N),velocity (m/s)", *(f"{f!r},{v!r}" for f, v in rows)])
    )
    assert command("scene.yaml", "data.csv") == 0
    printed = capsys.readouterr().out
    assert "shape=8 8" in printed
    assert re.search(r"width                 2\.0[345]\d* \+/- [\d.]+ um", printed)


def test_what_a_fit_does_not_take_from_the_scene_is_said(folder, capsys):
    scene = (folder / "frame.yaml").read_text(encoding="utf-8")
    loads = ("load: {side_force: 990 N, balls_per_side: 31}", "load: {force: [10 N, 20 N, 30 N]}")
    for medium, several in (("ala", False), ("ema", True), ("ala", True)):
        text = scene.replace(*loads) if several else scene
        (folder / "equal.yaml").write_text(f"{text}medium: {medium}\n", encoding="utf-8")
        assert command("equal.yaml", "data.csv", "--sigma", "2 m/s") == 0
        captured = capsys.readouterr()
        assert "medium                ema\n" in captured.out
        assert ("medium ala" in captured.err) == (medium == "ala")
        assert ("3 loads" in captured.err) == several


def test_side_forces_and_times_of_flight(folder, capsys):
    columns = ("--column", "side_force=F", "--column", "time=t")
    assert (
        command(
            "frame.yaml",
            "flight.csv",
            *columns,
            "--distance",
            "43 cm",
            "--parameter",
            "young_modulus",
        )
        == 0
    )
    printed = capsys.readouterr().out
    assert "2.04 um" in printed
    assert "Young modulus         211.65 GPa" in printed
    assert list(folder.glob("*.png")) == []


def test_the_width_may_be_named_among_the_parameters(folder, capsys):
    for more in ((), ("--parameter", "width")):
        assert command("scene.yaml", "data.csv", "--parameter", "young_modulus", *more) == 0
        assert "width                 2.04 um" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("scene.yaml", "none.csv"), "none.csv cannot be read"),
        (("none.yaml", "data.csv"), "no such file"),
        (("scene.yaml", "flight.csv"), "no column named 'force'"),
        (
            ("scene.yaml", "flight.csv", "--column", "side_force=F"),
            "side_force",
        ),
        (("scene.yaml", "data.csv", "--column", "forse=F"), "Did you mean force"),
        (("scene.yaml", "data.csv", "--column", "velocity"), "is no KIND=NAME"),
        (("scene.yaml", "data.csv", *2 * ("--column", "force=F")), "is given twice"),
        (
            ("scene.yaml", "data.csv", "--frequency", "6.5"),
            "'6.5', without a unit",
        ),
        (("scene.yaml", "data.csv", "--parameter", "density"), "'density' cannot"),
        (
            ("scene.yaml", "data.csv", *2 * ("--parameter", "diameter")),
            "diameter is given 2 times",
        ),
        (("scene.yaml", "data.csv", "--no-width", "--parameter", "width"), "Leave one out."),
        (("scene.yaml", "bare.csv"), "no unit for 'force'"),
        (("scene.yaml", "data.csv", "-o", ""), "--out is empty"),
        (
            ("scene.yaml", "data.csv", "--sigma", "1 N"),
            "--sigma: found '1 N'",
        ),
        (
            ("swept.yaml", "data.csv"),
            "swept.yaml sweeps width",
        ),
        (
            ("scene.yaml", "data.csv", "--column", "velocity=velocity (mm/s)", "-o", "out"),
            "equal balls",
        ),
    ],
)
def test_one_error_and_nothing_written(folder, capsys, words, told):
    before = sorted(folder.iterdir())
    assert command(*words) == 2
    captured = capsys.readouterr()
    assert told in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""
    assert sorted(folder.iterdir()) == before


def test_a_folder_that_is_no_path_is_refused():
    with pytest.raises(InputError, match="path"):
        fit_width(BALLS, [4.0] * 3, [480.0] * 3, 5.0).write(5)
