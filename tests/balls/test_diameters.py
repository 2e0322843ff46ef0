"""Distributions of diameters: closed forms, mpmath and adaptive quadrature, limits, convergence,
samples and errors.
"""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from functools import cache

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from granphon.balls.diameters import (
    MOST_POINTS,
    Discrete,
    Measured,
    Normal,
    NormalShape,
    Uniform,
    UniformShape,
    uniform_numbers,
)
from granphon.base.errors import InputError

POWERS = (-0.5, 0.0, 0.5, 1.5, 3.0)
UNIFORM = UniformShape()
NORMALS = {cutoff: NormalShape(cutoff) for cutoff in (0.5, 3.0, 6.0)}
TWO = Discrete([7.999e-3, 8.001e-3], [0.5, 0.5])
SKEW = Discrete([7.998e-3, 8.0e-3, 8.004e-3], [0.5, 0.3, 0.2])
SHAPES = {"uniform": UNIFORM, "normal": NORMALS[3.0], "two": TWO.shape, "skew": SKEW.shape}
SPREADS = {"uniform": Uniform(2e-6), "normal": Normal(1e-6, 2.0), "two": TWO, "skew": SKEW}
#: the first numbers of seeds 0 and 7
LITERAL_NUMBERS = [
    [0.6524484863740322, 0.7012121095215252],
    [0.27623358227789463, 0.21586845960432577],
]
LITERAL_UNIFORM = [-2.2034050321745702e-07, -9.664234109436874e-07, 8.015213612137668e-07]
LITERAL_NORMAL = [-2.789875604794831e-07, -2.0948341841304606e-06, 1.2797229705949622e-06]


def difference(y, power, step, order):
    """Repeated differences of one-sided powers with 40 digits left: the printed closed forms of the
    uniform distribution.
    """
    with mpmath.workdps(80):
        total = mpmath.mpf(0)
        for k in range(order + 1):
            base = mpmath.mpf(y) + (mpmath.mpf(order) / 2 - k) * mpmath.mpf(step)
            if base > 0:
                total += (-1) ** k * mpmath.binomial(order, k) * base ** (mpmath.mpf(power) + order)
        for k in range(1, order + 1):
            total /= (mpmath.mpf(power) + k) * mpmath.mpf(step)
        return total


def normal_reference(y, powers, cutoff, pair):
    """Averages of powers over the cut normal distribution by tanh-sinh in the root of the overlap,
    40 digits.
    """
    with mpmath.workdps(40):
        c = mpmath.mpf(cutoff)
        y = mpmath.mpf(y)
        kept = mpmath.erf(c / mpmath.sqrt(2))
        std = 1 / mpmath.sqrt(12 * (1 - 2 * c * mpmath.npdf(c) / kept))
        b, height = c * std, 2 * mpmath.npdf(0, 0, std) / kept
        both = height**2 / 2 * std * mpmath.sqrt(mpmath.pi)
        ends = (-b, 0, b) if pair else (-b / 2, b / 2)

        @cache
        def density(u):  # of the overlap u^2, at nodes that the powers have in common
            t = u * u - y
            if pair:
                return both * mpmath.exp(-((t / std) ** 2)) * mpmath.erf((b - abs(t)) / std)
            return height * mpmath.exp(-2 * (t / std) ** 2)

        totals = [mpmath.mpf(0) for _ in powers]
        for start, end in itertools.pairwise(ends):
            first = max(start, -y)
            if first < end:
                low = mpmath.sqrt(y + first)
                high = mpmath.sqrt(y + end)
                nodes = mpmath.linspace(low, high, 3 + int(cutoff))
                for n, p in enumerate(map(mpmath.mpf, powers)):
                    totals[n] += mpmath.quad(
                        lambda u, p=p: 2 * u ** (2 * p + 1) * density(u), nodes
                    )
        return totals


def brute(spread, y, power, x=None):
    """All pairs, one by one, from the diameters as they were given."""
    fractions = getattr(spread, "fractions", [1 / len(spread.diameters)] * len(spread.diameters))
    mean = math.fsum(c * d for c, d in zip(fractions, spread.diameters, strict=True))
    width = math.sqrt(
        12
        * math.fsum(c * (d - mean) ** 2 for c, d in zip(fractions, spread.diameters, strict=True))
    )
    sizes = [((d - mean) / width, c) for c, d in zip(fractions, spread.diameters, strict=True)]
    others = sizes if x is None else [(x, 1.0)]
    gaps = [(y + 0.5 * (a + b), v * w) for a, v in sizes for b, w in others]
    return math.fsum(w * g**power for g, w in gaps if g > 0)


# --- averages
# ---------------------------------------------------------------------------------------------------------


@pytest.mark.claim("averaged-force-right")
@pytest.mark.parametrize("power", POWERS)
def test_uniform_averages_are_the_closed_forms_at_every_load(power):
    rng = np.random.default_rng(1)
    y = np.concatenate(
        [
            -0.5 + 10.0 ** -np.arange(1.0, 16.0),
            [-1e-12, 0.0, 1e-12, 0.5 - 1e-12, 0.5, 0.5 + 1e-12],
            rng.uniform(-0.5, 1.0, 40),
            10.0 ** np.linspace(-0.2, 8.0, 60),
        ]
    )
    pairs = [
        float(v / difference(float(t), power, 0.5, 2) - 1)
        for v, t in zip(UNIFORM.average(y, power), y, strict=True)
    ]
    assert np.max(np.abs(pairs)) < 4e-15
    s = np.concatenate([-0.25 + 10.0 ** -np.arange(1.0, 16.0), y[y > -0.2]])
    singles = UNIFORM.average(s, power, 0.0)
    assert (
        np.max(
            np.abs(
                [
                    float(v / difference(float(t), power, 0.5, 1) - 1)
                    for v, t in zip(singles, s, strict=True)
                ]
            )
        )
        < 4e-15
    )


@pytest.mark.claim("averaged-force-right")
@pytest.mark.parametrize("pair", [True, False])
@pytest.mark.parametrize(
    ("cutoff", "places", "powers"),
    [
        (0.5, (-0.95, 1.01), (1.5,)),
        (3.0, (-0.95, 1.01), (0.5,)),
        pytest.param(3.0, (-0.95, 1.01), (0.5, 1.5), marks=pytest.mark.slow),
        *(
            pytest.param(
                one,
                (-0.95, -0.5, -0.01, 0.0, 0.3, 0.99, 1.01, 2.0),
                (-0.5, 0.5, 1.5),
                marks=pytest.mark.exhaustive,
            )
            for one in NORMALS
        ),
    ],
)
def test_normal_averages_against_mpmath(cutoff, pair, places, powers):
    shape = NORMALS[cutoff]
    reach = shape.bounds[1] if pair else 0.5 * shape.bounds[1]
    # relative to the threshold, which is itself known to a rounding, and off the point where a
    # slope is vertical
    for y in (*(reach * np.array(places)), 30.0, 1e8):
        for power, exact in zip(
            powers, normal_reference(float(y), powers, cutoff, pair), strict=True
        ):
            found = shape.average(y, power, None if pair else 0.0)
            assert abs(float(found / exact - 1)) < 1e-12, (y, power)


@pytest.mark.parametrize("name", ["uniform", pytest.param("normal", marks=pytest.mark.slow)])
def test_averages_over_both_are_means_of_those_over_one_by_adaptive_quadrature(name):
    shape = SHAPES[name]
    b = shape.bounds[1]
    for y in (-0.4, -0.1, 0.0, 0.2, 0.7, 5.0):
        kinks = [x for x in (-2 * y - b, -2 * y + b) if -b < x < b]
        for power in (0.0, 0.5, 1.5):
            value, _ = quad(
                lambda x, y=y, power=power: (
                    shape.average(y, power, x) * float(shape._compute_density(np.array(x)))
                ),
                -b,
                b,
                points=kinks or None,
                epsabs=0.0,
                epsrel=1e-11,
                limit=200,
            )
            assert shape.average(y, power) == pytest.approx(value, rel=1e-10)
        inner, _ = quad(
            lambda x, y=y: max(y + x / 2, 0.0) ** 1.5 * float(shape._compute_density(np.array(x))),
            -b,
            b,
            points=[-2 * y] if abs(2 * y) < b else None,
            epsabs=0.0,
            epsrel=1e-11,
        )
        assert shape.force(y, 0.0) == pytest.approx(inner, rel=1e-10)


@pytest.mark.parametrize("spread", [TWO, SKEW])
@pytest.mark.parametrize("power", POWERS)
def test_listed_diameters_are_summed_exactly(spread, power):
    for y in (-0.31, 0.05, 0.4, 3.0, 1e4):
        assert spread.shape.average(y, power) == pytest.approx(brute(spread, y, power), rel=1e-10)
        assert spread.shape.average(y, power, 0.2) == pytest.approx(
            brute(spread, y, power, 0.2), rel=1e-10
        )


def test_a_measured_lot_is_a_discrete_distribution_in_any_order():
    lot = Measured([8.001e-3, 7.999e-3, 8.0e-3, 8.001e-3])
    kinds = Discrete([7.999e-3, 8.0e-3, 8.001e-3], [0.25, 0.25, 0.5])
    assert lot.shape == kinds.shape == Measured(sorted(lot.diameters)).shape
    assert lot.width == pytest.approx(kinds.width, rel=1e-13)
    assert lot.mean == pytest.approx(kinds.mean, rel=1e-15)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_shapes_have_mean_zero_and_unit_width(shape):
    x, w = shape.nodes(0.1, 40)
    assert np.sum(w) == pytest.approx(1.0, abs=1e-14)
    assert np.sum(w * x) == pytest.approx(0.0, abs=1e-12)
    assert 12 * np.sum(w * x**2) == pytest.approx(1.0, rel=1e-11)
    assert shape.force(-shape.bounds[1]) == 0.0
    assert shape.average(1e-9 - shape.bounds[0], 0.0) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_scalars_in_scalars_out_and_any_array_shape(shape):
    assert isinstance(shape.force(0.3), float)
    assert isinstance(shape.stiffness(0.3, 0.1), float)
    y = np.linspace(-1.0, 2.0, 12).reshape(3, 4)
    assert shape.force(y).shape == (3, 4)
    nodes = shape.nodes(y, 6)
    assert nodes.positions.shape == nodes.weights.shape
    assert nodes.positions.shape[:2] == (3, 4)
    np.testing.assert_array_equal(shape.force(y)[1, 2], shape.force(y[1, 2]))
    assert shape.force(np.empty((0, 2))).shape == (0, 2)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_derivatives_are_those_of_the_force_to_second_order_in_the_step(shape):
    for y, x in ((0.41, None), (3.0, None), (0.13, 0.2), (-0.08, 0.27)):
        for function, slope in (
            (shape.force, shape.stiffness),
            (shape.stiffness, shape.stiffness_slope),
        ):
            steps = np.array([4e-3, 2e-3, 1e-3])
            errors = [
                (function(y + h, x) - function(y - h, x)) / (2 * h) - slope(y, x) for h in steps
            ]
            if np.max(np.abs(errors)) > 1e-9:
                # else the third derivative is zero, as for a contact that is open
                orders = np.log2(np.abs(np.array(errors[:-1]) / errors[1:]))
                np.testing.assert_allclose(orders, 2.0, atol=0.15)


@given(st.sampled_from(sorted(SHAPES)), st.floats(-1.5, 5.0), st.floats(1e-3, 1.0))
def test_mean_force_is_increasing_convex_and_above_that_of_mean_balls(name, y, step):
    shape = SHAPES[name]
    low, middle, high = (float(shape.force(y + k * step)) for k in (-1, 0, 1))
    assert low <= middle <= high
    assert low + high - 2 * middle >= -1e-14 * high
    # Jensen: the averaged lattice lies below the averaged force
    assert middle >= max(y, 0.0) ** 1.5 * (1 - 1e-14)
    assert middle <= max(y + shape.bounds[1], 0.0) ** 1.5
    assert shape.stiffness(y) >= 0.0
    if high > low:
        assert (
            shape.stiffness(y - step) * (1 - 1e-12)
            <= (high - low) / (2 * step) * (1 + 1e-12) + 1e-300
        )
        assert (high - low) / (2 * step) <= shape.stiffness(y + step) * (1 + 1e-12)


@given(
    st.lists(
        st.tuples(st.integers(7_990, 8_010), st.integers(1, 9)),
        min_size=2,
        max_size=6,
        unique_by=lambda t: t[0],
    ),
    st.floats(1e-3, 1e3),
)
def test_shape_and_width_of_any_list(kinds, scale):
    parts = np.array([part for _, part in kinds], float)
    diameters = np.array([d for d, _ in kinds]) * 1e-6
    spread = Discrete(diameters, parts / parts.sum())
    x, w = np.array(spread.shape.positions), np.array(spread.shape.weights)
    assert 12 * np.sum(w * x**2) == pytest.approx(1.0, rel=1e-10)
    assert spread.smallest == pytest.approx(min(diameters) - spread.mean, rel=1e-8, abs=1e-15)
    assert spread.largest == pytest.approx(max(diameters) - spread.mean, rel=1e-8, abs=1e-15)
    assert spread.mean == pytest.approx(np.average(diameters, weights=parts), rel=1e-14)
    assert spread.rms**2 == pytest.approx(
        np.average((diameters - spread.mean) ** 2, weights=parts), rel=1e-9
    )
    other = Discrete(diameters * scale, parts / parts.sum())
    assert other.width == pytest.approx(scale * spread.width, rel=1e-9)
    np.testing.assert_allclose(other.shape.positions, x, rtol=0, atol=1e-10)


@pytest.mark.claim("api-normal-cut")
def test_normal_cut_hard_is_uniform_and_cut_late_is_normal():
    y = np.linspace(-0.45, 3.0, 20)
    np.testing.assert_allclose(NormalShape(1e-3).force(y), UNIFORM.force(y), rtol=2e-6)
    assert Normal(1e-6, 10.0).rms == pytest.approx(1e-6, rel=1e-15)
    assert Normal(1e-6, 1e-3).rms == pytest.approx(1e-9 / math.sqrt(3), rel=1e-6)
    with mpmath.workdps(40):
        for cutoff in (0.01, 0.7, 3.0):
            c = mpmath.mpf(cutoff)
            rms = mpmath.sqrt(1 - 2 * c * mpmath.npdf(c) / mpmath.erf(c / mpmath.sqrt(2)))
            assert float(Normal(1.0, cutoff).rms / rms - 1) == pytest.approx(0.0, abs=2e-15)


def test_units_and_widths():
    assert Uniform(2.04e-6).rms == pytest.approx(2.04e-6 / math.sqrt(12), rel=1e-15)
    assert (Uniform(2e-6).smallest, Uniform(2e-6).largest, Uniform(2e-6).mean) == (
        -1e-6,
        1e-6,
        None,
    )
    assert Normal(1e-6).largest == pytest.approx(3e-6, rel=1e-15)
    assert Normal(1e-6).width == pytest.approx(math.sqrt(12) * Normal(1e-6).rms, rel=1e-15)
    assert TWO.width == pytest.approx(math.sqrt(12) * 1e-6, rel=1e-11)
    assert (
        Uniform(0.0).width,
        Normal(0.0).width,
        Measured([8e-3] * 3).width,
        Discrete([8e-3], [1.0]).width,
    ) == (0, 0, 0, 0)
    assert Measured([8e-3] * 3).shape.positions == (0.0,)
    assert Measured([8e-3]).shape.force(4.0) == 8.0


def test_shapes_are_compared_without_the_width():
    assert Uniform(1e-6).shape == Uniform(2e-6).shape
    assert hash(Normal(1e-6, 2.5).shape) == hash(Normal(3e-6, 2.5).shape)
    assert Normal(1e-6).shape != Normal(1e-6, 2.0).shape
    assert Uniform(1e-6).shape != Normal(1e-6).shape
    assert Discrete([7e-3, 9e-3], [0.5, 0.5]).shape == Discrete([14e-3, 18e-3], [0.5, 0.5]).shape
    assert hash(Uniform(1e-6)) == hash(Uniform(1e-6))
    assert len(set(SHAPES.values())) == len(SHAPES)


def test_openings_bound_the_smooth_stretches():
    np.testing.assert_allclose(UNIFORM.openings, [-0.5, 0.0, 0.5])
    half = 1 / math.sqrt(12)
    np.testing.assert_allclose(TWO.shape.openings, [-half, 0.0, half], atol=1e-11)
    assert SKEW.shape.openings.size == 6


# --- quadrature over the central ball
# ---------------------------------------------------------------------------------


def medium_average(shape, y, order):
    nodes = shape.nodes(y, order)
    force, stiffness = (f(y[:, None], nodes.positions) for f in (shape.force, shape.stiffness))
    mean, slope = 0.9 * shape.force(y)[:, None], 0.9 * shape.stiffness(y)[:, None]
    return np.sum(nodes.weights * (force - mean) / (stiffness + 1.05 * slope), axis=-1)


@pytest.mark.parametrize(
    ("shape", "digits"), [(UNIFORM, 0.5), (NORMALS[3.0], 0.4), (NORMALS[6.0], 0.4)]
)
def test_averages_of_the_medium_converge_exponentially(shape, digits):
    b = shape.bounds[1]
    y = np.concatenate(
        [
            b * np.array([-0.9, -0.5, -1e-6, 0.0, 1e-6, 0.1, 0.5, 0.999, 1.0, 1.001, 2.0]),
            [20.0, 1e4],
        ]
    )
    exact = medium_average(shape, y, 100)
    orders = np.array([8, 12, 16, 20])
    errors = np.array([np.max(np.abs(medium_average(shape, y, n) / exact - 1)) for n in orders])
    assert np.polyfit(orders, np.log10(errors), 1)[0] < -digits  # decimal digits per node
    assert np.max(np.abs(medium_average(shape, y, 32) / exact - 1)) < 5e-12
    assert np.max(np.abs(shape.nodes(y, 32).weights.sum(axis=-1) - 1)) < 1e-14


def test_nodes_give_the_averages_over_pairs():
    for shape in SHAPES.values():
        y = np.array([-0.3, 0.0, 0.2, 0.5, 3.0, 1e8])
        x, w = shape.nodes(y, 40)
        for power in (0.5, 1.5):
            np.testing.assert_allclose(
                np.sum(w * shape.average(y[:, None], power, x), -1),
                shape.average(y, power),
                rtol=1e-12,
            )


def test_medium_average_by_adaptive_quadrature():
    y = np.array([0.17])
    mean, slope = 0.9 * UNIFORM.force(y[0]), 0.9 * UNIFORM.stiffness(y[0])
    value, _ = quad(
        lambda x: (UNIFORM.force(y[0], x) - mean) / (UNIFORM.stiffness(y[0], x) + 1.05 * slope),
        -0.5,
        0.5,
        points=[-2 * y[0] - 0.5 + 1e-300, 0.5 - 2 * y[0]],
        epsabs=1e-13,
        epsrel=1e-12,
    )
    assert medium_average(UNIFORM, y, 32)[0] == pytest.approx(value, rel=1e-10)


# --- large lots
# -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spread", SPREADS.values(), ids=SPREADS)
def test_averages_at_a_place_that_is_no_number_are_no_numbers(spread):
    for power in (-0.5, 0.0, 1.5):
        assert math.isnan(spread.shape.average(math.nan, power))
        assert math.isnan(spread.shape.average(0.1, power, math.nan))


@pytest.mark.claim("places-of-a-lot")
@pytest.mark.parametrize(
    ("kind", "count"),
    [
        ("normal", 1500),
        pytest.param("normal", 3000, marks=pytest.mark.slow),
        pytest.param("uniform", 3000, marks=pytest.mark.exhaustive),
    ],
)
def test_a_large_lot_is_condensed_far_below_its_sampling_noise(kind, count):
    rng = np.random.default_rng(2)
    off = rng.uniform(-1.0, 1.0, count) if kind == "uniform" else rng.normal(size=count)
    lot = Measured(8e-3 + 1e-6 * off)
    x, w = np.array(lot.shape.positions), np.array(lot.shape.weights)
    assert x.size <= MOST_POINTS
    assert np.all(w > 0.0)
    exact = (np.array(lot.diameters) - lot.mean) / lot.width
    for moment in range(4):
        assert np.sum(w * x**moment) == pytest.approx(np.mean(exact**moment), rel=1e-9, abs=1e-11)
    assert lot.shape.bounds == pytest.approx((exact.min(), exact.max()), rel=1e-9)
    sums = 0.5 * (exact[:, None] + exact)
    for y, tolerances in ((-0.3, (1e-5, 1e-3)), (0.1, (1e-6, 3e-4)), (3.0, (1e-12, 1e-12))):
        gap = np.maximum(y + sums, 0.0)
        root = np.sqrt(gap)
        assert lot.shape.average(y, 1.5) == pytest.approx(np.mean(gap * root), rel=tolerances[0])
        assert lot.shape.average(y, 0.5) == pytest.approx(np.mean(root), rel=tolerances[1])


@pytest.mark.claim("places-of-a-lot")
@pytest.mark.parametrize(
    ("kind", "overlaps"),
    [
        ("normal", 2),
        ("skewed", 2),
        *(pytest.param(kind, 9, marks=pytest.mark.slow) for kind in ("normal", "skewed")),
        *(pytest.param(kind, 9, marks=pytest.mark.exhaustive) for kind in ("flat", "two kinds")),
    ],
)
def test_the_places_of_a_large_lot_hold_force_and_stiffness(kind, overlaps):
    rng = np.random.default_rng(5)
    n = 2500
    off = {
        "flat": rng.random(n),
        "normal": rng.normal(size=n),
        "skewed": np.exp(0.5 * rng.normal(size=n)),
        "two kinds": np.concatenate(
            [0.1 * rng.normal(size=n // 2), 1.0 + 0.2 * rng.normal(size=n // 2)]
        ),
    }[kind]
    lot = Measured(8e-3 + 1e-6 * off)
    x = np.array(lot._table[1]) / lot.width
    sums = 0.5 * (x[:, None] + x)
    for y in np.linspace(0.9 * lot.shape.bounds[0], 1.0, overlaps):
        root = np.sqrt(np.maximum(y + sums, 0.0))
        force = float(np.mean(root * root * root))
        stiffness = float(np.mean(root))
        if force > 1e-3:
            assert lot.shape.average(y, 1.5) == pytest.approx(
                force, rel=2e-7 if force > 0.08 else 4e-6
            )
            assert lot.shape.average(y, 0.5) == pytest.approx(
                stiffness, rel=5e-5 if force > 0.08 else 4e-4
            )


# --- samples
# ----------------------------------------------------------------------------------------------------------


def test_the_generator_is_splitmix64():
    published = [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]
    expected = [((n >> 12) + 0.5) / 2**52 for n in published]
    np.testing.assert_array_equal(uniform_numbers(5, 1234567), expected)


def test_samples_are_these_numbers_on_every_machine():
    np.testing.assert_array_equal(uniform_numbers((2, 2), 0), LITERAL_NUMBERS)
    np.testing.assert_allclose(Uniform(2e-6).sample(3, seed=7), LITERAL_UNIFORM, rtol=1e-15)
    np.testing.assert_allclose(Normal(1e-6).sample(3, seed=7), LITERAL_NORMAL, rtol=1e-13)
    np.testing.assert_allclose(TWO.sample(3, seed=7), [-1e-6, -1e-6, 1e-6], rtol=1e-11)


@pytest.mark.parametrize("spread", SPREADS.values(), ids=SPREADS)
def test_a_larger_sample_keeps_the_balls_of_a_smaller_one(spread):
    np.testing.assert_array_equal(spread.sample(10, 3), spread.sample(25, 3)[:10])
    small = spread.sample((4, 6), 3)
    large = spread.sample((9, 8), 3)
    np.testing.assert_array_equal(small, large[:4, :6])
    np.testing.assert_array_equal(
        spread.sample((4, 6), 3).ravel(), spread.sample((7, 6), 3).ravel()[:24]
    )
    assert spread.sample((0, 3), 1).shape == (0, 3)


@pytest.mark.parametrize("spread", SPREADS.values(), ids=SPREADS)
def test_samples_follow_the_distribution(spread):
    n = 200
    sample = np.sort(spread.sample((n, n), seed=11).ravel())
    assert sample.min() >= spread.smallest * (1 + 1e-10)
    assert sample.max() <= spread.largest * (1 + 1e-10)
    assert abs(np.mean(sample)) < 4 * spread.rms / n
    kurtosis = np.mean((sample / spread.rms) ** 4)
    assert abs(np.mean(sample**2) / spread.rms**2 - 1) < 4 * math.sqrt(kurtosis) / n
    # Kolmogorov and Smirnov: P(x' <= x) is the part of contacts open at y = 0 about a partner that
    # mirrors x
    x = np.unique(sample)[:: max(1, np.unique(sample).size // 200)] / spread.width
    part = np.searchsorted(sample / spread.width, x + 1e-9, side="right") / sample.size
    below = 1 - np.array([spread.shape.average(-0.5 * v - 5e-10, 0.0, 0.0) for v in x])
    assert np.max(np.abs(part - below)) < 1.63 / n  # 1 %


def test_neighbouring_sites_and_seeds_are_independent():
    u = uniform_numbers((300, 300), 5) - 0.5
    error = 4 / 12 / 300
    for other in (
        np.roll(u, 1, 0),
        np.roll(u, 1, 1),
        np.roll(u, (1, 1), (0, 1)),
        u.T,
        uniform_numbers((300, 300), 6) - 0.5,
    ):
        pairs = u * other
        if other.base is u:
            pairs = np.triu(pairs, 1)
        assert abs(np.mean(pairs)) < error
    assert 0.0 < uniform_numbers(100_000, 0).min() < 1e-4
    assert 1 - 1e-4 < uniform_numbers(100_000, 0).max() < 1.0


def test_quantiles_invert_the_distribution():
    for cutoff, shape in NORMALS.items():
        u = np.array([1e-12, 1e-3, 0.3, 0.5, 0.9, 1 - 1e-9])
        x = shape.quantile(u)
        with mpmath.workdps(40):
            c = mpmath.mpf(cutoff)
            kept = mpmath.erf(c / mpmath.sqrt(2))
            for value, part in zip(x, u, strict=True):
                below = (
                    mpmath.ncdf(mpmath.mpf(float(value)) * c / shape.bounds[1]) - mpmath.ncdf(-c)
                ) / kept
                assert float(below) == pytest.approx(part, rel=1e-9, abs=1e-15)
    assert UNIFORM.quantile(0.75) == 0.25
    assert TWO.shape.quantile([0.1, 0.49, 0.51]).tolist() == [
        TWO.shape.positions[k] for k in (0, 0, 1)
    ]


def test_a_sample_that_memory_does_not_hold_is_refused():
    with pytest.raises(InputError, match="of memory"):
        Uniform(2e-6).sample((2**20, 2**26), seed=0)


# --- what cannot be
# ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("diameters", "fractions", "words"),
    [
        ([], [], "diameters"),
        ([8e-3, 9e-3], [1.0], "2 diameters and 1 fraction "),
        ([8e-3, 9e-3], [0.5, 0.4], "sum to 0.9, 0.1 below 1"),
        ([8e-3, 9e-3], [1.5, -0.5], "fractions: .*-0.5"),
        ([8e-3, -1e-3], [0.5, 0.5], "above zero"),
        ([8e-3, math.nan], [0.5, 0.5], "finite"),
        ([[8e-3]], [1.0], "diameters"),
    ],
)
def test_lists_that_cannot_be(diameters, fractions, words):
    with pytest.raises(InputError, match=words):
        Discrete(diameters, fractions)


@pytest.mark.claim("api-diameters")
def test_fractions_within_rounding_are_divided_by_their_sum():
    spread = Discrete([7e-3, 8e-3, 9e-3], [0.3333333333] * 3)
    assert sum(spread.shape.weights) == pytest.approx(1.0, rel=1e-15)
    assert spread.mean == pytest.approx(8e-3, rel=1e-15)
    assert (
        Discrete([7e-3, 8e-3, 9e-3], [0.5, 0.0, 0.5]).shape
        == Discrete([7e-3, 9e-3], [0.5, 0.5]).shape
    )


def test_a_width_at_which_a_ball_has_no_size():
    with pytest.raises(InputError, match="smaller width"):
        Measured((1e-3, 1.1e-3)).with_width(1e-2)


def test_balls_of_no_size():
    for spread in (Uniform(2.1e-3), Normal(0.4e-3)):
        with pytest.raises(InputError, match="smallest ball"):
            spread.check_diameter(1e-3)
        spread.check_diameter(1.0)
    with pytest.raises(InputError, match="diameter"):
        Uniform(1e-6).check_diameter(-1.0)


@pytest.mark.claim("api-diameters")
def test_the_mean_must_be_the_diameter_of_the_packing():
    TWO.check_diameter(8e-3)
    TWO.check_diameter(Fraction(8, 1000))
    TWO.check_diameter(8e-3 * (1 + 5e-10))
    Uniform(1e-6).check_diameter(5.0)
    with pytest.raises(InputError, match=r"mean .*0.008 m.* 0.00801 m"):
        TWO.check_diameter(8.01e-3)
    with pytest.raises(InputError, match="diameter"):
        TWO.check_diameter(math.nan)


def test_samples_of_no_shape_and_of_no_seed():
    for shape in (-1, 2.5, True, "ab", (), (3, -1), (2, 2.0)):
        with pytest.raises(InputError, match="shape"):
            Uniform(1e-6).sample(shape, 0)
    for seed in (-1, 1.0, True, 2**64, None):
        with pytest.raises(InputError, match="seed"):
            Uniform(1e-6).sample(2, seed)


def test_powers_that_cannot_be():
    for power in (-1.0, 0.3, 4.0):
        with pytest.raises(InputError, match="power"):
            UNIFORM.average(0.1, power)


# --- tables
# -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "column"),
    [
        ("\ufeffball,Diameter [um],note\n# a lot\n1,7999,\n\n2,8001,round\n", None),
        ('"d (m)";"mass"\n7.999e-3;1,2\n8.001e-3;1,3\n', "d"),
        ("\tdiameter (cm)\nx\t0.7999\n\t0.8001\n", "diameter"),
    ],
)
def test_reading_a_table(tmp_path, text, column):
    path = tmp_path / "lot.csv"
    path.write_text(text, encoding="utf-8")
    np.testing.assert_allclose(
        Measured.from_csv(path, column).diameters, [7.999e-3, 8.001e-3], rtol=1e-14
    )


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("a,b\n1,2\n", None, "no column named 'diameter'"),
        ("a,b\n1,2\n", "c", "named 'c'"),
        ("diameter (kg)\n1\n", None, "unit of length"),
        ("diameter (mm)\n-8.0\n", None, "csv:2: diameter: .*'-8.0 mm'"),
    ],
)
def test_tables_that_cannot_be_read(tmp_path, text, column, words):
    path = tmp_path / "lot.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        Measured.from_csv(path, column)
