"""Laws of contacts that differ: the series of high pressure, derivatives, inverses and statistics,
against closed forms.
"""

from __future__ import annotations

import itertools
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import granphon as gp
from granphon.balls.diameters import NormalShape, UniformShape
from granphon.base.errors import InputError, PrecisionError
from granphon.laws.effective import EffectiveLaw
from granphon.laws.spread import AveragedLaw, high_pressure_series
from tests.laws.test_effective import exact_ball

SKEW = gp.Discrete([7.998e-3, 8.0e-3, 8.004e-3], [0.5, 0.3, 0.2]).shape
SHAPES = {"uniform": UniformShape(), "normal": NormalShape(3.0), "skew": SKEW}
#: Xi without friction and with that of steel, a soft and a hard one
FACTORS = [0.25, 1.5575302428478541, 2.390908, 40.0]
every_shape = pytest.mark.parametrize("name", SHAPES)
every_kind = pytest.mark.parametrize("kind", [0, 1], ids=["averaged", "effective"])


def laws(name, xi=FACTORS[1], coefficient=1.0, width=1.0):
    shape = SHAPES[name]
    return AveragedLaw(coefficient, width, shape), EffectiveLaw(coefficient, width, shape, xi)


def cube(shape):
    """<x^3>, by quadrature."""
    nodes = shape.nodes(100.0, 40)
    return float(np.sum(nodes.weights * nodes.positions**3))


# -- high pressure ---------------------------------------------------------------------------------


@pytest.mark.claim("high-pressure-orders")
@every_shape
@pytest.mark.parametrize("xi", [*FACTORS, math.inf])
def test_second_and_third_order_by_hand(name, xi):
    # (36) with F^Q and K^Q expanded in s = x/2 to third order in 1/y, p = 1/(1 + Xi):
    # f* = y^(3/2) (1 + (1 - p)/(64 y^2) + <x^3> (3 p^2 - 1)/(64 y^3) + ...)
    series = high_pressure_series(SHAPES[name], xi)
    p = 1.0 / (1.0 + xi)
    found = series.mean[:4] * series.scale ** np.arange(4.0)
    exact = [1.0, 0.0, (1.0 - p) / 64.0, cube(SHAPES[name]) * (3.0 * p * p - 1.0) / 64.0]
    np.testing.assert_allclose(found, exact, rtol=1e-12, atol=1e-15)


def sum_series(y, xi):
    """f, k and the ends of s = y + x/2 of the uniform distribution, from its series, in the
    precision of mpmath.
    """
    series = high_pressure_series(UniformShape(), xi)
    here = mpmath.mpf(y)
    quarter = mpmath.mpf(1) / 4
    mean = [
        mpmath.mpf(c) * (mpmath.mpf(series.scale) / here) ** n for n, c in enumerate(series.mean)
    ]
    f = here ** mpmath.mpf(1.5) * sum(mean)
    k = mpmath.sqrt(here) * sum((mpmath.mpf(1.5) - n) * term for n, term in enumerate(mean))
    return f, k, [here - quarter, here, here + quarter]


@pytest.mark.parametrize(
    ("xi", "y"),
    [
        *((xi, 6.0) for xi in FACTORS),
        (FACTORS[1], 30.0),
        (FACTORS[2], 1e6),
        *(
            pytest.param(xi, y, marks=pytest.mark.slow)
            for xi in FACTORS
            for y in (30.0, 1e3, 1e6)
            if (xi, y) not in ((FACTORS[1], 30.0), (FACTORS[2], 1e6))
        ),
    ],
)
def test_the_series_solves_the_equation_at_forty_digits(xi, y):
    with mpmath.workdps(60):
        f, k, parts = sum_series(y, xi)

        def miss(s):
            # <(F - f)/(K + Xi k)> and <1/(K + Xi k)>: their ratio is by how much f misses equation
            # (36)
            force, stiffness = exact_ball(s)
            return ((force - f) + 1j) / (stiffness + xi * k)

        both = mpmath.quad(miss, parts)
        # coefficients in doubles, of powers of scale/y from the first on
        assert (
            abs(both.real / both.imag / f)
            < 1e-15 * high_pressure_series(UniformShape(), xi).scale / y
        )


@pytest.mark.claim("high-pressure-orders")
def test_order_of_contact_after_40():
    # of second order, as F_ave - F is: (40) does not say that the two agree to a higher one
    for name in ("uniform", "normal"):
        for xi in FACTORS:
            averaged, effective = laws(name, xi)
            r = xi / (1.0 + xi)
            y = 30.0 * 2.0 ** np.arange(4.0)
            square = 1.0 / 12.0 / y**2  # Delta_rms^2 / (d - a)^2
            contact = (effective.force(y) / averaged.force(y) - 1.0) / square
            limit = (4.0 * contact[-1] - contact[-2]) / 3.0  # the next order is the fourth
            assert limit == pytest.approx(-3.0 / 16.0 / (1.0 + xi), rel=1e-6)
            # (27): at equal force, 1/8 becomes r/8
            for law, part in ((averaged, 1.0), (effective, r)):
                hertz = 1.5 * np.cbrt(law.force(y))
                departure = (law.stiffness(y) / hertz - 1.0) / square
                assert (4.0 * departure[-1] - departure[-2]) / 3.0 == pytest.approx(
                    -part / 8.0, rel=1e-6
                )


@every_shape
def test_averaged_series_is_the_average_at_large_overlaps(name):
    averaged = laws(name)[0]
    shape = SHAPES[name]
    series = high_pressure_series(shape, math.inf)
    y = series.start * np.array([1.0, 1.5, 10.0, 1e4, 1e8])
    for values, exact in (
        (averaged.force(y), shape.force(y)),
        (averaged.stiffness(y), shape.stiffness(y)),
        (averaged.stiffness_slope(y), shape.stiffness_slope(y)),
        (averaged.energy(y), 0.4 * shape.average(y, 2.5)),
    ):
        np.testing.assert_allclose(values, exact, rtol=1e-14)


# -- derivatives and seams -------------------------------------------------------------------------


def central(f, y, step):
    """First derivative, of eighth order in the step."""
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
    return sum(w * f(y + n * step) for n, w in zip(range(-4, 5), weights, strict=True) if w) / step


@every_shape
@every_kind
def test_each_is_the_derivative_of_the_one_before(name, kind):
    law = laws(name)[kind]
    # between openings and beyond the start of the series, away from kinks
    ends = [*SHAPES[name].openings, high_pressure_series(SHAPES[name], law.xi).start, 40.0]
    for low, high in itertools.pairwise(ends[1:]):
        y = low + (high - low) * np.array([0.4, 0.5, 0.7])
        step = 0.02 * (high - low)
        for below, above in (
            (law.energy, law.force),
            (law.force, law.stiffness),
            (law.stiffness, law.stiffness_slope),
        ):
            np.testing.assert_allclose(central(below, y, step), above(y), rtol=2e-8)


@every_shape
@every_kind
def test_no_seam_where_the_series_begins(name, kind):
    law = laws(name)[kind]
    start = high_pressure_series(SHAPES[name], law.xi).start
    y = np.array([np.nextafter(start, 0.0), start])
    for of, room in (
        (law.energy, 2e-14),
        (law.force, 2e-15),
        (law.stiffness, 4e-15),
        (law.stiffness_slope, 1e-10),
    ):
        below, above = of(y)
        assert below == pytest.approx(above, rel=room)


# -- inverses --------------------------------------------------------------------------------------


@every_shape
@every_kind
def test_overlap_inverts_force(name, kind):
    law = laws(name)[kind]
    force = np.logspace(-5, 12, 3001)
    y = law.overlap(force)
    assert np.all(np.diff(y) > 0.0)
    # an overlap is known to rounding of itself: that is what the force comes back to
    room = 4e-15 + 4.0 * np.finfo(float).eps * np.abs(y) * law.stiffness(y) / force
    assert np.all(np.abs(law.force(y) / force - 1.0) < room)


@given(
    part=st.floats(-4.0, 14.0),
    width=st.floats(-30.0, 2.0),
    coefficient=st.floats(-30.0, 30.0),
    name=st.sampled_from(sorted(SHAPES)),
    kind=st.integers(0, 1),
)
def test_laws_scale_with_width_and_coefficient(part, width, coefficient, name, kind):
    width = 10.0**width
    coefficient = 10.0**coefficient
    reduced = 10.0**part
    law, unit = laws(name, coefficient=coefficient, width=width)[kind], laws(name)[kind]
    y = unit.overlap(reduced)
    scale = coefficient * math.sqrt(width) ** 3
    assert law.overlap(reduced * scale) == pytest.approx(width * y, rel=2e-14)
    assert law.force(width * y) == pytest.approx(scale * unit.force(y), rel=2e-14)
    assert law.stiffness(width * y) == pytest.approx(
        coefficient * math.sqrt(width) * unit.stiffness(y), rel=2e-13
    )
    assert law.energy(width * y) == pytest.approx(scale * width * unit.energy(y), rel=2e-13)


@every_kind
def test_scalars_are_floats_and_arrays_keep_their_shape(kind):
    law = laws("uniform")[kind]
    derivatives = law.energy, law.force, law.stiffness, law.stiffness_slope
    for call in (*derivatives, law.overlap, law.force_fluctuation, law.contact_fraction):
        assert np.ndim(call(0.3)) == 0
        values = np.array([[0.1, 0.3, 5.9], [6.1, 9.0, 1e3]])
        table = call(values)
        assert table.shape == (2, 3)
        for index in np.ndindex(2, 3):
            assert table[index] == pytest.approx(float(call(values[index])), rel=1e-13)


@every_kind
def test_forces_that_cannot_be(kind):
    law = laws("uniform")[kind]
    with pytest.raises(InputError, match="tension"):
        law.overlap(-1.0)
    with pytest.raises(PrecisionError):
        law.overlap([1.0, 1e-40])


@pytest.mark.parametrize("kind", [0, 1, 2], ids=["averaged", "effective", "hertz"])
@pytest.mark.parametrize(
    "method",
    [
        "energy",
        "force",
        "stiffness",
        "stiffness_slope",
        "force_fluctuation",
        "contact_fraction",
        "overlap",
    ],
)
def test_what_is_no_number_is_refused_by_every_method(kind, method):
    law = (*laws("uniform"), gp.HertzLaw(1.0))[kind]
    for wrong in ("x", 1j, True, math.nan, [1.0, math.nan]):
        with pytest.raises(InputError):
            getattr(law, method)(wrong)
    if method != "overlap":  # balls may be as far apart as they like
        assert getattr(law, method)(-math.inf) == 0.0


def test_open_contacts_exert_nothing():
    for law in laws("skew"):
        y = law.least_overlap + np.array([-1.0, -1e-9, 0.0])
        for of in (law.energy, law.force, law.stiffness):
            np.testing.assert_array_equal(of(y), 0.0)


# -- statistics ------------------------------------------------------------------------------------


def brute_statistics(law, y, n=20_000):
    """Delta f / f and N_c / 6 as Section IV prints them, with u^Q of (34), by dense sums over Q;
    closed form over Q'.
    """
    shape = law.shape
    edge = law.shape.bounds[1]
    if hasattr(shape, "positions"):
        x = np.array(shape.positions)
        weights = np.array(shape.weights)
    else:
        x = edge * ((2.0 * np.arange(n) + 1.0) / n - 1.0)
        weights = (
            np.full(n, 1.0 / n)
            if isinstance(shape, UniformShape)
            else np.exp(-0.5 * (x * shape.cutoff / edge) ** 2)
        )
        weights /= weights.sum()
    force, stiffness = shape.force(y, x), shape.stiffness(y, x)
    f, k = law.force(y), law.stiffness(y)
    moved = (force - f) / (stiffness + law.xi * k)
    fluctuation = (
        math.sqrt(
            np.sum(weights * (force - (stiffness * moved if np.any(moved) else 0.0) - f) ** 2)
        )
        / f
    )
    return fluctuation, float(np.sum(weights * shape.average(y - moved, 0.0, x)))


@every_shape
@pytest.mark.parametrize(
    ("kind", "overlaps"),
    [
        (1, (-0.2, 0.25)),
        pytest.param(1, (0.0, 0.49, 1.3, 8.0), marks=pytest.mark.slow),
        pytest.param(0, (-0.2, 0.0, 0.25, 0.49, 1.3, 8.0), marks=pytest.mark.exhaustive),
    ],
)
def test_statistics_of_section_4_by_brute_force(name, kind, overlaps):
    law = laws(name)[kind]
    for y in overlaps:
        fluctuation, closed = brute_statistics(law, y)
        assert law.force_fluctuation(y) == pytest.approx(fluctuation, rel=1e-8)
        # a count has a kink at the ball whose corona just touches: 128 nodes on either side leave
        # 1e-6
        assert law.contact_fraction(y) == pytest.approx(closed, abs=2e-6)


@every_shape
@every_kind
def test_fluctuation_keeps_its_digits_at_any_load(name, kind):
    # to leading order F^Q - f = (3/4) x y^(1/2), and a fraction 1/(1 + Xi) of the contact's
    # stiffness gives way
    law = laws(name)[kind]
    y = np.array([1e4, 1e6, 1e8, 1e12])
    r = 1.0 if math.isinf(law.xi) else law.xi / (1.0 + law.xi)
    leading = 0.75 * r / math.sqrt(12.0) / y
    np.testing.assert_allclose(law.force_fluctuation(y[1:]), leading[1:], rtol=1e-5)
    np.testing.assert_allclose(law.force_fluctuation(y[2:]), leading[2:], rtol=1e-7)
    np.testing.assert_allclose(law.force_fluctuation(y[3:]), leading[3:], rtol=1e-11)


@pytest.mark.parametrize("y", [6.5, pytest.param(40.0, marks=pytest.mark.slow), 1e8])
def test_fluctuation_at_forty_digits(y):
    law = laws("uniform")[1]
    with mpmath.workdps(50):
        f, k, parts = sum_series(y, law.xi)

        def square(s):
            force, stiffness = exact_ball(s)
            return ((force - f) / (1 + stiffness / (mpmath.mpf(law.xi) * k))) ** 2

        exact = mpmath.sqrt(2 * mpmath.quad(square, parts)) / f
        assert abs(law.force_fluctuation(y) / exact - 1) < 1e-13


@every_shape
@every_kind
def test_all_contacts_close_at_high_pressure_and_disorder_fades(name, kind):
    law = laws(name)[kind]
    y = np.linspace(-0.2, 4.0, 22)
    fluctuation = law.force_fluctuation(y)
    closed = law.contact_fraction(y)
    if name != "skew":  # where contacts of few kinds open at once, it may rise
        assert np.all(np.diff(fluctuation) < 0.0)
    assert fluctuation[-1] < 0.1 < fluctuation[0]
    assert np.all(np.diff(closed) > -1e-6)
    assert np.all((closed > 0.0) & (closed < 1.0 + 1e-14))
    # no more are closed than there are
    assert np.max(law.contact_fraction(np.geomspace(0.4, 1e3, 40))) == 1.0


@given(
    st.lists(st.tuples(st.floats(-1e-4, 1e-4), st.floats(-11.0, 0.0)), min_size=2, max_size=6),
    st.floats(-9.0, 9.0),
)
def test_averaged_force_of_any_list_is_inverted(balls, load):
    offs, weights = np.array(balls).T
    parts = 10.0**weights
    shape = gp.Discrete(8e-3 + offs, parts / parts.sum()).shape
    if shape.bounds[0] == shape.bounds[1]:
        return
    law = AveragedLaw(1.0, 1.0, shape)
    force = 10.0**load
    assert law.force(law.overlap(force)) == pytest.approx(force, rel=1e-10)


def test_a_medium_tells_a_force_that_is_too_small_in_newtons():
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    medium = gp.AveragedForce(gp.Packing(steel, 8e-3, gp.Uniform(2e-6)))
    with pytest.raises(PrecisionError, match="N is too small") as refused:
        medium.at_force(1e-30)
    assert "W^" not in str(refused.value)
