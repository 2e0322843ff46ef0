"""The effective medium's curve against solutions of equation (36) that owe nothing to the package.

F^Q, K^Q and the average over Q are written anew; the equation is integrated by scipy, and its
residual taken at many places, and at thirty digits at some. If rho(y) = G(y, f') - f is the
residual of a curve f, its error e obeys e' = (e + rho)/G_k with dG/dk = G_k > 0: downwards it is
forgotten, and |e| is nowhere above the largest |rho| at higher y.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import granphon as gp
from granphon.balls.diameters import NormalShape, UniformShape
from granphon.balls.hertz import ENERGY, FORCE, SLOPE, STIFFNESS
from granphon.base.differences import differentiate
from granphon.base.errors import PrecisionError
from granphon.dynamics.local_field import local_field
from granphon.laws import effective
from granphon.laws.effective import LEAST_SOLVED_FORCE, VALID_FORCE, EffectiveLaw, effective_curve
from tests.conftest import only
from tests.references import balance, integrate_curve

#: without friction, and that of steel
XI = {eta: local_field(mindlin_ratio=eta).xi for eta in (0.0, 0.84)}
UNIFORM, NORMAL = UniformShape(), NormalShape(3.0)
DENSITIES = {"uniform": UNIFORM, "normal": NORMAL}
every_xi = pytest.mark.parametrize("xi", XI.values(), ids=["smooth", "rough"])


def kinds(diameters, fractions):
    """The shape of a lot of few kinds of balls, from relative diameters."""
    sizes = 1.0 + 1e-3 * np.asarray(diameters, float)
    return gp.Discrete(tuple(sizes), tuple(np.asarray(fractions) / np.sum(fractions))).shape


RARE = (0.5, 0.1, 1e-3, 1e-6, 1e-9)
LOTS = {
    **{f"{part:g} large": kinds([0.0, 1.0], [1.0 - part, part]) for part in RARE},
    **{f"{part:g} small": kinds([0.0, 1.0], [part, 1.0 - part]) for part in RARE[1:]},
    "three": kinds([-1.0, 0.0, 2.0], [0.5, 0.3, 0.2]),
    **{
        f"two of {part:g}": kinds([-1.0, 0.0, 0.7], [part, 1.0 - 2.0 * part, part])
        for part in (1e-2, 1e-3, 1e-4)
    },
    "0.01 near a large": kinds([0.0, 0.7, 1.0], [0.98, 0.01, 0.01]),
    "ten": kinds(np.random.default_rng(0).normal(size=10), np.ones(10)),
}

# -- the equation, written anew --------------------------------------------------------------------


def double_exponential(n=97, reach=3.4):
    """Parts of an interval, and weights: the trapezium rule in t of (1 + tanh(pi/2 sinh t))/2."""
    t = np.linspace(-reach, reach, n)
    small = np.exp(-np.pi * np.sinh(t))
    weight = np.cosh(t) * small / (1.0 + small) ** 2
    return 1.0 / (1.0 + small), weight / weight.sum()


PART, WEIGHT = double_exponential()


def uniform_ball(s):
    """F^Q, K^Q and the slope of K^Q at s = y + x/2, by the printed powers."""
    upper = np.maximum(s + 0.25, 0.0)
    lower = np.maximum(s - 0.25, 0.0)
    return tuple(c * (upper**p - lower**p) for c, p in ((0.8, 2.5), (2.0, 1.5), (3.0, 0.5)))


STD = NORMAL.bounds[1] / 3.0


def normal_density(x):
    return np.exp(-0.5 * (x / STD) ** 2) / (
        STD * math.sqrt(2.0 * math.pi) * math.erf(3.0 / math.sqrt(2.0))
    )


def normal_ball(s):
    """The same of the normal distribution cut at three std, by quadrature over the other ball."""
    half = 0.5 * NORMAL.bounds[1]
    low = np.maximum(s - half, 0.0)[..., None]
    length = np.maximum(s + half, 0.0)[..., None] - low
    gap = low + length * PART
    weight = 2.0 * length * WEIGHT * normal_density(2.0 * (gap - s[..., None]))
    root = np.sqrt(gap)
    powers = (
        gap * root,
        1.5 * root,
        np.divide(0.75, root, out=np.zeros_like(root), where=root > 0.0),
    )
    return tuple(np.sum(weight * p, axis=-1) for p in powers)


def density(ball, edge, of_x) -> Callable:
    """(origin, root) -> weights, F^Q, K^Q and slope for a continuous distribution, at y = origin +
    root^2.
    """

    def mixture(origin, root):
        y = np.asarray(origin + root * root)[..., None]
        half = 0.5 * edge
        cuts = [
            y - half,
            np.clip(-half, y - half, y + half),
            np.clip(half, y - half, y + half),
            y + half,
        ]
        s = np.concatenate([a + (b - a) * PART for a, b in itertools.pairwise(cuts)], axis=-1)
        weights = np.concatenate([(b - a) * WEIGHT for a, b in itertools.pairwise(cuts)], axis=-1)
        return weights * 2.0 * of_x(2.0 * (s - y)), *ball(s)

    return mixture


def listed(shape) -> Callable:
    """The same for listed diameters; a contact is open or closed by the interval, not by
    rounding.
    """
    x, weights = np.array(shape.positions), np.array(shape.weights)
    opening = -0.5 * (x[:, None] + x)

    def mixture(origin, root):
        rise = np.where(np.abs(origin - opening) < 1e-11, 0.0, origin - opening)
        gap = np.where(opening < origin + 1e-11, rise + root * root, 0.0)
        side = np.sqrt(gap)
        slope = np.divide(0.75, side, out=np.zeros_like(side), where=side > 0.0)
        return weights, (gap * side) @ weights, 1.5 * side @ weights, slope @ weights

    return mixture


def mixture_of(shape):
    if shape == UNIFORM:
        return density(uniform_ball, 0.5, np.ones_like)
    return (
        density(normal_ball, NORMAL.bounds[1], normal_density) if shape == NORMAL else listed(shape)
    )


def evaluated(curve, y):
    """f and k of the package's curve at y, by the series beyond its start."""
    law = EffectiveLaw(1.0, 1.0, curve.shape, curve.xi)
    return law.force(y), law.stiffness(y)


# -- independent solutions -------------------------------------------------------------------------


def exact_ball(s):
    """F^Q and K^Q of the uniform distribution in the present precision of mpmath."""
    upper, lower = (
        mpmath.sqrt(max(s + side, mpmath.mpf(0)))
        for side in (mpmath.mpf(1) / 4, -mpmath.mpf(1) / 4)
    )
    return 4 * (upper**5 - lower**5) / 5, 2 * (upper**3 - lower**3)


def exact_normal_ball(s):
    """The same of the normal distribution cut at three std."""
    std, half = mpmath.mpf(STD), mpmath.mpf(NORMAL.bounds[1]) / 2
    kept = std * mpmath.sqrt(2 * mpmath.pi) * mpmath.erf(3 / mpmath.sqrt(2))
    low, high = (mpmath.sqrt(max(s + side, mpmath.mpf(0))) for side in (-half, half))

    def average(n):
        cuts = [low, (low + high) / 2, high]
        return mpmath.quad(
            lambda u: 4 * u**n * mpmath.exp(-2 * ((u * u - s) / std) ** 2) / kept, cuts
        )

    return average(4), mpmath.mpf(3) / 2 * average(2)


@pytest.mark.claim("medium-1e-8")
@pytest.mark.parametrize(
    ("shape", "ball", "places", "digits", "room"),
    [
        (
            UNIFORM,
            exact_ball,
            [-0.2, -0.05, 1e-6, 0.1, 0.3, 0.499, 0.501, 0.8, 2.0, 5.9],
            30,
            3e-13,
        ),
        pytest.param(
            NORMAL, exact_normal_ball, [-0.3, 0.2], 16, 1e-12, marks=pytest.mark.exhaustive
        ),
    ],
    ids=["uniform", "normal"],
)
def test_residual_at_thirty_digits(shape, ball, places, digits, room):
    xi = XI[0.84]
    with mpmath.workdps(digits):
        for y in places:
            f, k = (mpmath.mpf(float(v)) for v in evaluated(effective_curve(shape, xi), y))
            half = mpmath.mpf(shape.bounds[1]) / 2
            cuts = sorted(
                {
                    mpmath.mpf(y) - half,
                    mpmath.mpf(y) + half,
                    *(c for c in (-half, half) if abs(c - y) < half),
                }
            )

            def moved(s, f=f, k=k, y=y):
                force, stiffness = ball(s)
                std = mpmath.mpf(STD)
                weight = (
                    1 if shape == UNIFORM else mpmath.exp(-2 * ((s - mpmath.mpf(y)) / std) ** 2)
                )
                part = weight / (stiffness + mpmath.mpf(xi) * k)
                return part * (force - f) + 1j * part

            both = mpmath.quad(moved, cuts, maxdegree=6 if shape == NORMAL else 8)
            assert abs(both.real / both.imag / f) < room


@pytest.mark.parametrize(
    ("shape", "xi"),
    [
        (UNIFORM, XI[0.0]),
        (NORMAL, XI[0.84]),
        pytest.param(UNIFORM, XI[0.84], marks=pytest.mark.slow),
        pytest.param(NORMAL, XI[0.0], marks=pytest.mark.slow),
    ],
    ids=["uniform-smooth", "normal-rough", "uniform-rough", "normal-smooth"],
)
def test_no_seam_between_steps(shape, xi):
    curve = effective_curve(shape, xi)
    for order, room in ((FORCE, 1e-14), (STIFFNESS, 1e-14), (ENERGY, 1e-12)):
        lower, upper = curve.ends(order)
        np.testing.assert_allclose(lower[1:], upper[:-1], rtol=room)
    origin, middle, half = curve.steps
    seams = (origin + (middle - half) ** 2)[1:]
    inside = seams[middle[1:] > half[1:]]  # on the far side of an opening the slope is a limit
    slopes = [curve.value(inside + side, SLOPE) for side in (0.0, 1e-13)]
    np.testing.assert_allclose(*slopes, rtol=1e-8)


# -- convergence -----------------------------------------------------------------------------------


def solved(shape, stages=16, n_nodes=32, tolerance=1e-12, most=np.inf):
    return effective.solve_curve(shape, XI[0.0], stages, tolerance, most, n_nodes)


@pytest.mark.parametrize(
    ("shape", "stages", "length"),
    [
        pytest.param(UNIFORM, 2, 0.05, marks=pytest.mark.slow),
        pytest.param(NORMAL, 3, 0.05, marks=pytest.mark.slow),
        (LOTS["0.5 large"], 4, 0.1),
    ],
    ids=["uniform", "normal", "two kinds"],
)
def test_order_at_the_ends_of_steps_is_2s_minus_1(shape, stages, length):
    # at an opening, the end of a step: lengths are halved, and no other tolerance acts. The
    # equation is stiff at high pressure only, where the solution is so smooth that no order is lost
    place = np.array([-0.5 * sum(shape.bounds)])
    exact = solved(shape, 20, 64, 1e-13).value(place, STIFFNESS)
    coarse, fine = (
        solved(shape, stages, 32, np.inf, most).value(place, STIFFNESS)
        for most in (length, 0.5 * length)
    )
    order = float(np.log2(np.abs(coarse / exact - 1.0) / np.abs(fine / exact - 1.0))[0])
    assert abs(order - (2 * stages - 1)) < 0.8


@pytest.mark.parametrize(
    "shape", [UNIFORM, pytest.param(NORMAL, marks=pytest.mark.slow)], ids=DENSITIES
)
def test_convergence_in_the_nodes_is_exponential(shape):
    place = np.array([-0.2])
    exact = solved(shape, n_nodes=64).value(place, FORCE)
    orders = np.array([8, 10, 12, 14])
    errors = np.array(
        [
            np.max(np.abs(solved(shape, n_nodes=int(n)).value(place, FORCE) / exact - 1.0))
            for n in orders
        ]
    )
    assert np.polyfit(orders, np.log10(errors), 1)[0] < -0.4  # decimal digits per node
    np.testing.assert_allclose(solved(shape, n_nodes=32).value(place, FORCE), exact, rtol=1e-13)


def lot(n, seed, kind):
    """The shape of a random lot of n balls."""
    rng = np.random.default_rng(seed)
    off = {
        "flat": rng.uniform(-1.0, 1.0, n),
        "normal": rng.normal(size=n),
        "skewed": rng.exponential(size=n),
    }[kind]
    return gp.Measured(tuple(8e-3 + 1e-6 * off)).shape


FINER = {
    **{name: (shape, 24, 64, 1e-13, 0.1) for name, shape in DENSITIES.items()},
    "ten": (LOTS["ten"], 24, 64, 1e-13, 0.1),
    **{
        f"{kind} {n}": (lot(n, 5, kind), 16, 32, 1e-13, 0.01)
        for kind in ("flat", "normal", "skewed")
        for n in (66, 100)
    },
    "flat 128": (lot(128, 5, "flat"), 16, 32, 1e-13, 0.01),
}


@pytest.mark.claim("medium-1e-8")
@pytest.mark.parametrize(
    "name",
    [
        "uniform",
        "ten",
        pytest.param("normal", marks=pytest.mark.slow),
        *(pytest.param(name, marks=pytest.mark.exhaustive) for name in list(FINER)[3:]),
    ],
)
def test_more_stages_shorter_steps_and_more_nodes_change_nothing(name):
    shape, *setting = FINER[name]
    curve, finer = effective_curve(shape, XI[0.0]), solved(shape, *setting)
    assert curve.least_force == LEAST_SOLVED_FORCE
    y = finer.overlap(
        np.geomspace(1e-4, 0.99 * curve.series.value(curve.series.start, FORCE), 5001)
    )
    np.testing.assert_allclose(curve.value(y, FORCE), finer.value(y, FORCE), rtol=1e-11)
    np.testing.assert_allclose(curve.value(y, STIFFNESS), finer.value(y, STIFFNESS), rtol=1e-9)


# -- stability -------------------------------------------------------------------------------------


@pytest.mark.claim("iteration-diverges")
def test_plain_iteration_amplifies_noise():
    # f <- F_ave + F(f') = G(y, f'), as below (40): a wave of small amplitude is multiplied by i q
    # dG/dk each round
    xi, mixture = XI[0.0], mixture_of(UNIFORM)
    spacing = 1e-3
    y = 0.2 + spacing * np.arange(257)
    f, k = evaluated(effective_curve(UNIFORM, xi), y)
    balls = mixture(0.0, np.sqrt(y))
    _, _, by_k = balance(balls, k, xi)
    assert np.all(by_k > 0.0)

    def grown(wavenumber, rounds):
        """Amplitudes in the middle of the grid, where its ends are not felt yet."""
        wave = 1e-9 * np.sin(wavenumber * y)
        out = [1e-9]
        for _ in range(rounds):
            slope = (wave[2:] - wave[:-2]) / (2.0 * spacing)
            wave = np.pad(balance(balls, k + np.pad(slope, 1), xi)[0] - f, 0)
            out.append(float(np.max(np.abs(wave[100:157]))))
        return np.array(out[1:]) / np.array(out[:-1])

    middle = float(np.abs(by_k[128]))
    waves = np.array([150.0, 400.0, 1200.0])
    for q in waves:
        # what a centred difference makes of the wavenumber
        expected = middle * np.sin(q * spacing) / spacing
        np.testing.assert_allclose(grown(q, 3), expected, rtol=0.3)
    # noise on the grid has waves of all lengths down to two spacings: the finer the grid, the
    # faster it grows
    assert middle * waves[-1] > 5.0
    assert np.all(grown(1200.0, 3) > 5.0)


@pytest.mark.parametrize("disturbed", [pytest.param(0.5, marks=pytest.mark.slow), 1.5])
def test_a_disturbed_start_is_forgotten_downwards(disturbed):
    """Half as much, or half as much again, at y = 6 leaves nothing at y = 5."""
    xi = XI[0.0]
    mixture = mixture_of(UNIFORM)

    def slope(y, k):
        _, by_y, by_k = balance(mixture(0.0, np.sqrt(y)), k[0], xi)
        return [(k[0] - by_y) / by_k]

    _, exact = evaluated(effective_curve(UNIFORM, xi), np.array([6.0, 5.0]))
    out = solve_ivp(
        slope, (6.0, 5.0), [disturbed * exact[0]], method="Radau", rtol=1e-10, atol=1e-16
    )
    np.testing.assert_allclose(out.y[0, -1], exact[1], rtol=1e-8)


# -- listed diameters ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", only(["1e-06 small", "0.01 near a large"], LOTS))
def test_lots_against_an_integration_split_at_the_openings(name):
    curve = effective_curve(LOTS[name], XI[0.0])
    forces = np.geomspace(1e-4, 10.0, 13)
    assert curve.least_force == LEAST_SOLVED_FORCE
    # LSODA cannot begin where the rarest kind opens
    how = (1e-10, "Radau") if name.startswith("1e-09") else (1e-11, "LSODA")
    y, k = integrate_curve(curve.shape, curve.xi, forces, *how)
    np.testing.assert_allclose(evaluated(curve, y), [forces, k], rtol=1e-9)


@pytest.mark.claim("api-medium")
@given(
    data=st.lists(
        st.tuples(st.integers(-99, 99), st.floats(-6.0, 0.0)),
        min_size=2,
        max_size=5,
        unique_by=lambda x: x[0],
    ),
    xi=st.floats(0.2, 8.0),
)
@settings(max_examples=4, deadline=None)
def test_any_few_kinds_have_a_curve_that_satisfies_the_equation(data, xi):
    shape = kinds([0.01 * d for d, _ in data], [10.0**c for _, c in data])
    curve = effective_curve(shape, xi)
    mixture = listed(shape)

    def state(y, k):
        origin = max(o for o in shape.openings if o <= y)
        return balance(mixture(origin, np.sqrt(y - origin)), k, xi)

    if curve.least_force > LEAST_SOLVED_FORCE:
        # only where the equation itself has no more: k' > 0 at k = 0
        assert curve.has_zero_stiffness
        assert curve.least_force < VALID_FORCE
        _, by_y, by_k = state(curve.start, 0.0)
        assert by_y < 0.0 < by_k
    for y in curve.overlap(
        np.geomspace(
            curve.least_force * 1.01, 0.99 * curve.series.value(curve.series.start, FORCE), 13
        )
    ):
        f, _, by_k = state(y, curve.value(np.array([y]), STIFFNESS)[0])
        assert by_k > 0.0
        if f > 1e-4:
            assert curve.value(np.array([y]), FORCE)[0] == pytest.approx(f, rel=1e-8)


@pytest.mark.parametrize(
    "count",
    [17, pytest.param(33, marks=pytest.mark.slow), pytest.param(66, marks=pytest.mark.slow)],
)
def test_the_medium_takes_every_diameter_of_a_lot(steel, count):
    sizes = 8e-3 + 1e-6 * np.random.default_rng(2).normal(size=count)
    law = gp.EffectiveMedium(
        gp.Packing(steel, float(np.mean(sizes)), spread=gp.Measured(tuple(sizes)))
    ).law
    assert len(law.shape.positions) == count
    assert law.curve.steps.shape[1] >= count * (count + 1) // 2


def bounds(curve, points=5):
    """f and bounds of the relative errors of f and k from f* = 1e-4 on, from the residual rho
    alone.

    (e + rho)/G_k is the error of k, and e is forgotten downwards as the head of this file says.
    """
    t = np.linspace(-0.98, 0.98, points)
    origin, middle, half = (values[::-1, None] for values in curve.steps)
    root = (middle + half * t[::-1]).ravel()
    origin = np.repeat(origin, points)
    y = origin + root * root
    f, k = curve.value(y, FORCE), curve.value(y, STIFFNESS)
    mixture = mixture_of(curve.shape)
    rho = np.empty(y.size)
    by_k = np.empty(y.size)
    for i, (o, u) in enumerate(zip(origin, root, strict=True)):
        exact, _, by_k[i] = balance(mixture(o, u), k[i], curve.xi)
        rho[i] = abs(exact - f[i])
    assert np.all(by_k > 0.0)
    rest = rho[0]
    errors = []
    for worst, part in zip(rho, np.exp(-np.abs(np.diff(y, prepend=y[0])) / by_k), strict=True):
        rest = part * rest + (1.0 - part) * worst
        errors.append(max(rest, worst))
    keep = f > 1e-4
    return tuple(
        (values / size)[keep]
        for values, size in ((np.array(errors), f), ((np.array(errors) + rho) / by_k, k))
    )


@pytest.mark.claim("medium-1e-8", "api-medium")
@every_xi
@pytest.mark.parametrize(
    "shape",
    only([UNIFORM, NORMAL], [UNIFORM, NORMAL, lot(66, 2, "normal"), lot(100, 2, "skewed")]),
    ids=["uniform", "normal", "66", "100"],
)
def test_residuals_bound_the_errors(shape, xi):
    curve = effective_curve(shape, xi)
    assert curve.least_force == LEAST_SOLVED_FORCE
    force, stiffness = bounds(curve)
    assert np.max(force) < 1e-10
    assert np.max(stiffness) < 1e-8


#: two rare kinds, the second near the middle of the first and the rest
FLAT = kinds([0.0, 0.7, 1.0], [0.998, 1e-3, 1e-3])


@pytest.mark.claim("rare-kinds-end")
def test_where_rare_kinds_open_the_stiffness_may_fall_to_zero():
    # k' = (k - G_y)/G_k: at the end of the curve G_y < 0 at k = 0, so that k passes through zero,
    # with a force left
    xi, curve = XI[0.0], effective_curve(FLAT, XI[0.0])
    assert curve.has_zero_stiffness
    assert 1e-3 < curve.least_force < 2e-3
    with mpmath.workdps(30):
        x, w = ([mpmath.mpf(v) for v in values] for values in (FLAT.positions, FLAT.weights))

        def mean(y, k):
            rows = [[max(y + (a + b) / 2, mpmath.mpf(0)) for b in x] for a in x]
            force, stiffness = (
                [c * sum(v * gap**p for v, gap in zip(w, row, strict=True)) for row in rows]
                for c, p in ((1, 1.5), (1.5, 0.5))
            )
            part = [v / (one + mpmath.mpf(xi) * k) for v, one in zip(w, stiffness, strict=True)]
            return sum(p * f for p, f in zip(part, force, strict=True)) / sum(part)

        y = mpmath.mpf(curve.start)
        assert float(mean(y, mpmath.mpf(0))) == pytest.approx(curve.least_force, rel=1e-9)
        assert mpmath.diff(lambda v: mean(v, mpmath.mpf(0)), y, h=1e-12) < -1e-4
        assert mpmath.diff(lambda v: mean(y, v), mpmath.mpf(0), h=1e-12, direction=1) > 1e-4
    with pytest.raises(PrecisionError, match="stiffness is zero"):
        EffectiveLaw(1.0, 1.0, FLAT, xi).overlap(1e-3)


def test_loads_one_by_one_and_all_at_once_are_the_same():
    # many loads are sorted by step, few bring the coefficients of each
    for shape in (UNIFORM, LOTS["ten"]):
        curve = effective_curve(shape, XI[0.0])
        force = np.random.default_rng(3).permutation(np.geomspace(1e-5, 10.0, 8_000))
        y = curve.overlap(force)
        few = np.concatenate([curve.overlap(part) for part in np.split(force, 80)])
        np.testing.assert_allclose(few, y, rtol=1e-13, atol=1e-15)
        for order in (ENERGY, FORCE, STIFFNESS, SLOPE):
            parts = np.concatenate([curve.value(part, order) for part in np.split(y, 80)])
            np.testing.assert_allclose(parts, curve.value(y, order), rtol=1e-13)
        np.testing.assert_allclose(
            curve.value(y, FORCE), force, rtol=2e-15 * len(curve.tables[FORCE])
        )


def test_many_equal_kinds_become_the_uniform_distribution():
    y = np.array([0.1, 0.3, 1.0, 3.0])
    exact = effective_curve(UNIFORM, XI[0.0]).value(y, FORCE)
    errors = []
    for n in (4, 8, 16):
        shape = kinds(np.arange(n), np.ones(n))
        errors.append(np.max(np.abs(effective_curve(shape, XI[0.0]).value(y, FORCE) / exact - 1.0)))
    # second order on the whole: where the kinks lie makes single ratios uneven
    assert np.log2(errors[0] / errors[-1]) / 2.0 == pytest.approx(2.0, abs=0.5)


# -- what is kept, and where the curve ends --------------------------------------------------------


def test_one_curve_serves_every_packing_of_a_shape_and_friction(steel):
    effective_curve.cache_clear()
    glass = gp.Material(7e10, steel.poisson_ratio, 2500.0)
    for material, diameter, width in ((steel, 8e-3, 2e-6), (glass, 1e-3, 1e-9), (steel, 1.0, 1e-2)):
        medium = gp.EffectiveMedium(gp.Packing(material, diameter, spread=gp.Uniform(width)))
        unit = medium.packing.law.coefficient * math.sqrt(width) ** 3
        state = medium.at_force(unit * np.array([0.1, 1.0, 10.0]))
        np.testing.assert_allclose(state.reduced_spacing, [0.67, 1.5, 5.1], atol=0.1)
    assert effective_curve.cache_info().misses == 1
    gp.EffectiveMedium(gp.Packing(steel, 8e-3, spread=gp.Uniform(2e-6), friction=False)).at_force(
        1.0
    )
    assert effective_curve.cache_info().misses == 2


@pytest.mark.claim("curve-ends")
def test_below_the_start_of_the_curve_there_is_an_error():
    law = EffectiveLaw(1.0, 1.0, UNIFORM, XI[0.0])
    start = law.curve.start
    assert law.force(start * (1.0 - 1e-12)) == pytest.approx(LEAST_SOLVED_FORCE, rel=1e-9)
    for values in (start - 1e-6, [0.3, start - 1e-6], -0.499):
        with pytest.raises(PrecisionError, match="1e-06"):
            law.force(values)
    with pytest.raises(PrecisionError, match=r"valid from f\* = 0\.08"):
        law.overlap([1.0, 0.99e-6])


def test_a_curve_that_does_not_settle_ends_above(monkeypatch):
    # steps that cannot be solved: below the limit of validity the curve ends there, above it there
    # is none
    whole = effective._relax
    least = 1e-2

    def step(*given):
        out = whole(*given)
        return None if out is None or out[1][-1] < least else out

    monkeypatch.setattr(effective, "_relax", step)
    for shape in (UNIFORM, LOTS["three"]):
        curve = solved(shape)
        assert 1e-2 <= curve.least_force < 1.01e-2
        assert not curve.has_zero_stiffness
        assert float(curve.value(np.array([curve.start]), FORCE)[0]) == pytest.approx(
            curve.least_force, rel=1e-12
        )
    least = 1.0
    with pytest.raises(PrecisionError, match="does not converge"):
        solved(UNIFORM)


@pytest.mark.parametrize("name", ["uniform", "normal", "three"])
def test_the_derivative_by_xi_is_that_of_curves_solved_anew(name):
    shape = DENSITIES[name] if name in DENSITIES else LOTS[name]
    xi = XI[0.84]
    y = np.array([-0.1, 0.2, 0.7, 3.0])
    curve = effective_curve(shape, xi)
    for order in (FORCE, STIFFNESS):
        slope = differentiate(
            lambda step, order=order: curve.follow(xi + step).value(y, order), 1.0
        )
        anew = differentiate(
            lambda step, order=order: effective_curve(shape, xi + step).value(y, order), 1e-2
        )
        np.testing.assert_allclose(slope, anew, rtol=1e-7)
