"""The cluster medium: closed forms, twins by sparse matrices, the simulated array, and its
quadrature.
"""

import os

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse
from scipy.sparse.linalg import splu

import granphon as gp
from granphon.balls.diameters import UniformShape
from granphon.balls.lattices import FCC, HCP, KAGOME, LATTICES, TRIANGULAR
from granphon.base import threads
from granphon.base.errors import InputError, MechanismError, PrecisionError, SceneError
from granphon.dynamics.cluster_response import ClusterResponse, cluster_response, cluster_sizes
from granphon.dynamics.local_field import local_field
from granphon.laws import cluster as curves
from granphon.laws import cluster_balance as balances
from granphon.laws import cluster_descent as descents
from granphon.laws.cluster import VALID_FORCE
from granphon.laws.cluster_balance import ClusterBalance, PointSource
from granphon.laws.cluster_descent import ClusterDescent
from granphon.media.choice import MediumChoice
from granphon.runs.workers import Workers

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
WIDTH = 2.04e-6
PACKING = gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH), friction=False)
FORCE = PACKING.law.coefficient * WIDTH**1.5
FLAT = UniformShape()
SKEWED = gp.Discrete((7.999e-3, 8.004e-3), (0.8, 0.2))


#: what says how many realisations there are: by default, and for tests
FULL = {
    (module, name): getattr(module, name)
    for module, name in (
        (curves, "_POINTS"),
        (curves, "_ERROR"),
        (descents, "_FIRST"),
        (descents, "_LEAST_SET"),
    )
}
FEW = dict(zip(FULL, (128, 1e-3, 1, 2**8), strict=True))


def set_points(values):
    """Set them for a while, and keep no curve that was found with others."""
    with pytest.MonkeyPatch.context() as patch:
        for (module, name), value in values.items():
            patch.setattr(module, name, value)
        curves.cluster_curve.cache_clear()
        yield
    curves.cluster_curve.cache_clear()


@pytest.fixture(scope="module", autouse=True)
def few_points():
    """Fewer realisations than by default: a medium then takes two seconds instead of thirty, at ten
    times the error.
    """
    yield from set_points(FEW)


@pytest.fixture
def full_points(few_points):
    yield from set_points(FULL)


@pytest.fixture(scope="module")
def medium(few_points):
    return gp.ClusterMedium(PACKING)


def draw(response, points, scrambles, first=0):
    """Sets of realisations of a flat distribution."""
    return PointSource(response, FLAT).draw(range(first, first + scrambles), points)


#: f, kappa and tau at y = 0.3, about
START = (0.19, 0.63, 0.08)


# -- the lattice around the cluster ----------------------------------------------------------------


def test_clusters_are_whole_shells():
    assert cluster_sizes(TRIANGULAR) == [7, 19, 37]
    assert cluster_sizes(FCC) == cluster_sizes(HCP) == [13]
    contacts = [len(cluster_response(TRIANGULAR, 0.0, balls).response) for balls in (7, 19, 37)]
    assert contacts == [12, 42, 90]
    assert np.count_nonzero(cluster_response(FCC, 0.0).central) == 12


@pytest.mark.claim("cluster-second-order")
@pytest.mark.parametrize(
    ("lattice", "eta", "bending"),
    [
        (TRIANGULAR, 0.0, 0.0),
        (TRIANGULAR, 0.84, 0.0),
        (TRIANGULAR, 0.84, 0.1),
        (KAGOME, 0.84, 0.0),
        (FCC, 0.0, 0.0),
        (HCP, 0.0, 0.0),
    ],
)
def test_a_unit_tension_of_the_star_gives_the_local_field(lattice, eta, bending):
    found = cluster_response(lattice, eta, bending=bending)
    star = found.response[np.ix_(found.central, found.central)].sum() / np.count_nonzero(
        found.central
    )
    if lattice.periods == 2:
        assert_allclose(1.0 / star - 1.0, local_field(lattice, eta, bending).xi, rtol=1e-6)
    if not eta:
        # P is a projection, and the misfit of the star is that of the second order: 2 <s^2> = 1 -
        # u_1
        assert_allclose(2.0 * np.mean(np.diag(found.misfit)[found.central]), 1.0 - star, rtol=1e-5)
        # all directions are alike: each contact is hindered by the d motions of its ball, shared
        # with z/2 others
        if (
            len(lattice.contacts) * 2 == lattice.n_balls * found.central.sum()
            and lattice is not HCP
        ):
            assert_allclose(
                np.diag(found.response),
                2.0 * lattice.dimension / found.central.sum(),
                rtol=0.0,
                atol=5e-6,
            )
        # the ball in the middle can move in all directions without the lattice
        assert (
            np.count_nonzero(np.linalg.eigvalsh(found.response) > 1.0 - 1e-9) == lattice.dimension
        )
    values = np.linalg.eigvalsh(found.response)
    assert values[0] > -1e-9
    assert values[-1] < 1.0 + 1e-6
    assert np.linalg.eigvalsh(found.remote)[0] > -1e-5
    near = found.influence
    assert np.linalg.eigvalsh(found.misfit - near @ near.T)[0] > -1e-5


class Array2D:
    """A periodic triangular array of L x L balls with sparse matrices of its own."""

    normals = np.array([[1.0, 0.0], [-0.5, np.sqrt(0.75)], [0.5, np.sqrt(0.75)]])
    steps = np.array([[1, 0], [0, 1], [1, 1]])

    def __init__(self, side):
        self.side = side
        cells = np.stack(
            np.meshgrid(np.arange(side), np.arange(side), indexing="ij"), axis=-1
        ).reshape(-1, 2)
        self.i = np.repeat(np.arange(side**2), 3)
        ends = (cells[:, None] + self.steps) % side
        self.j = (ends[..., 0] * side + ends[..., 1]).ravel()
        self.normal = np.tile(self.normals, (side**2, 1))
        rows = np.arange(3 * side**2)
        entries = [
            (rows, 2 * ball + axis, sign * self.normal[:, axis])
            for ball, sign in ((self.i, -1.0), (self.j, 1.0))
            for axis in (0, 1)
        ]
        row, column, value = (np.concatenate(parts) for parts in zip(*entries, strict=True))
        self.c = sparse.csr_matrix((value, (row, column)), shape=(3 * side**2, 2 * side**2))
        # one ball is held, as uniform motions cost nothing
        self.free = self.c[:, 2:].tocsc()
        self.solver = splu((self.free.T @ self.free).tocsc())

    def project(self, tensions):
        """C (C^T C)^-1 C^T."""
        return self.free @ self.solver.solve(self.free.T @ tensions)

    def misfit(self, deviations):
        strain = 0.5 * (deviations[self.i] + deviations[self.j])
        return strain - self.project(strain)

    def find_cluster(self, shells):
        """Contacts inside the cluster around the ball in the middle, and those of that ball."""
        middle = (self.side // 2) * (self.side + 1)
        balls = {middle}
        for _ in range(shells):
            balls |= {int(b) for a, b in zip(self.i, self.j, strict=True) if a in balls} | {
                int(a) for a, b in zip(self.i, self.j, strict=True) if b in balls
            }
        inside = np.flatnonzero(
            [a in balls and b in balls for a, b in zip(self.i, self.j, strict=True)]
        )
        return inside, (self.i[inside] == middle) | (self.j[inside] == middle)

    def response(self, inside):
        unit = np.zeros((len(self.i), inside.size))
        unit[inside, np.arange(inside.size)] = 1.0
        return self.project(unit)


def test_response_is_that_of_large_periodic_arrays():
    """A periodic array differs by a part that falls as its area; two of them give the infinite
    one.
    """
    found = cluster_response(TRIANGULAR, 0.0, 7)
    tables = []
    for side in (20, 40):
        array = Array2D(side)
        inside, _ = array.find_cluster(1)
        columns = array.response(inside)
        squares = columns.T @ columns  # of a projection: P again
        p = columns[inside]
        assert_allclose(squares, p, atol=1e-12)
        # s = (1 - P) T x for every ball: its covariance over all x, with T the mean of two ends
        means = sparse.csr_matrix(
            (
                np.full(2 * array.i.size, 0.5),
                (np.tile(np.arange(array.i.size), 2), np.concatenate([array.i, array.j])),
            )
        )
        whole = means[inside].toarray() - columns.T @ means
        tables.append(
            [np.sort(p.ravel()), np.sort((whole @ whole.T).ravel()), np.sort((p - p @ p).ravel())]
        )
    for mine, coarse, fine in zip(
        (found.response, found.misfit, found.remote), *tables, strict=True
    ):
        assert_allclose(np.sort(mine.ravel()), (4.0 * fine - coarse) / 3.0, atol=3e-5)


def test_reduced_equilibrium_is_that_of_the_whole_array():
    """One realisation: a periodic array of which only the cluster is not linear, with given
    tensions outside.
    """
    rng = np.random.default_rng(4)
    array = Array2D(12)
    f = 0.06
    kappa = 0.3
    y = 0.1
    inside, central = array.find_cluster(1)
    x = rng.uniform(-0.5, 0.5, array.side**2)
    outer = 0.05 * rng.normal(size=array.i.size)
    outer[inside] = 0.0
    strain = 0.5 * (x[array.i] + x[array.j])
    u = np.zeros(array.free.shape[1])
    within = np.zeros(array.i.size, bool)
    within[inside] = True
    for _ in range(100):
        h = y + strain - array.free @ u
        closed = np.maximum(h, 0.0)
        force = np.where(within, closed**1.5, f + kappa * (h - y) + outer)
        slope = np.where(within, 1.5 * np.sqrt(closed), kappa)
        pull = array.free.T @ force
        if np.max(np.abs(pull)) < 1e-13:
            break
        u += splu((array.free.T @ sparse.diags(slope) @ array.free).tocsc()).solve(pull)
    assert np.min(h[inside]) < 0.0 < np.max(h[inside])
    # the reduced problem, of the same array
    columns = array.response(inside)
    pushes = -array.project(outer)[inside] / kappa
    p = 0.5 * (columns[inside] + columns[inside].T)
    response = ClusterResponse(7, p, np.zeros((12, 7)), np.eye(12), p - p @ p, central)
    balance = ClusterBalance(response, [(array.misfit(x)[inside][None], pushes[None])])
    found = balance.relax(y, (f, kappa, 1.0))[0]
    assert_allclose(found, h[inside], atol=3e-6)  # balls are held by 1e-6 of the stiffness


@pytest.mark.claim("cluster-push")
@pytest.mark.parametrize(("spacing", "variance"), [(0.7, 1.3e-3), (0.5, 5.4e-3)])
def test_tensions_outside_push_as_if_they_were_independent(spacing, variance):
    """In the simulated array itself: what is assumed of contacts outside a cluster, for clusters
    around all balls.
    """
    side = 48
    y = spacing - 0.5
    sample = gp.DirectSimulation(PACKING, shape=(side, side), seed=2).at_overlap(y * WIDTH).sample
    order = [1, 0, 2]  # of the three contacts of a ball
    h, force = (
        values[..., order].ravel()
        for values in (sample.contact_overlaps / WIDTH, sample.contact_forces / FORCE)
    )
    array = Array2D(side)
    misfit = array.misfit(((sample.diameters - 8e-3) / WIDTH).ravel())
    kappa = np.mean((force - force.mean()) * misfit) / np.mean(misfit**2)
    phi = force - force.mean() - kappa * (h - y)
    answer = array.project(phi)
    # the equilibrium, in the words of the theory
    assert_allclose(h, y + misfit - answer / kappa, atol=1e-6)
    inside, central = array.find_cluster(1)
    p = array.response(inside)[inside]
    place = np.stack(np.meshgrid(np.arange(side), np.arange(side), indexing="ij"), axis=-1).reshape(
        -1, 1, 2
    )
    cells = (np.stack([inside // 3 // side, inside // 3 % side], axis=-1) + place) % side
    found = 3 * (cells[..., 0] * side + cells[..., 1]) + inside % 3
    push = -(answer[found] - phi[found] @ p) / kappa
    push = push[:, central]
    with_it = misfit[found][:, central]
    assert_allclose(np.mean(push**2), variance, rtol=0.1)
    independent = np.mean(phi**2) / kappa**2 * np.diag(p - p @ p)[central].mean()
    assert_allclose(independent, np.mean(push**2), rtol=0.2)
    assert abs(np.mean(push * with_it)) < 0.05 * np.sqrt(np.mean(push**2) * np.mean(with_it**2))


# -- the balance -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("many", "room"), [(False, 1e-7), (True, 2e-6)])
@pytest.mark.parametrize("shape", [FLAT, SKEWED.shape], ids=["flat", "skew"])
def test_sets_have_the_moments_of_the_array_and_share_no_point(shape, many, room):
    """Scrambles, or many shifts of one net, in single precision."""
    response = cluster_response(TRIANGULAR, 0.0)
    sets = PointSource(response, shape, many).draw([1, 2], 512)
    for s, m in sets:
        assert s.dtype == m.dtype == (np.float32 if many else np.float64)
        assert_allclose(s.mean(axis=0), 0.0, atol=room)
        assert_allclose(s.T @ s / 512, response.misfit / 12.0, atol=room)
        assert_allclose(m.T @ m / 512, response.remote, atol=room)
        assert_allclose(s.T @ m / 512, 0.0, atol=room)
    (s, one), (_, other) = sets
    assert np.min(np.max(np.abs(one[:, None] - other), axis=2)) > 1e-4
    # the third moment: zero of the one, and not of the other
    third = np.mean(s**3) / np.mean(s**2) ** 1.5
    assert abs(third) < 1e-6 if shape is FLAT else third > 0.01
    for part, again in zip(
        sets[0], PointSource(response, shape, many).draw([1], 512)[0], strict=True
    ):
        assert_array_equal(part, again)


def test_slopes_are_differences_of_solutions():
    response = cluster_response(TRIANGULAR, 0.0)
    balance = ClusterBalance(response, draw(response, 64, 2))
    start = balance.solve(0.6, (0.48, 1.13, 0.05))
    step = 1e-4
    low, middle, high = (balance.solve(y, start.effective) for y in (0.6 - step, 0.6, 0.6 + step))
    difference = (np.array(high.effective) - np.array(low.effective)) / (2.0 * step)
    assert_allclose(middle.slopes, difference, rtol=2e-5)
    assert_allclose(middle.stiffness, (high.force - low.force) / (2.0 * step), rtol=2e-5)


def test_the_conditions_hold():
    response = cluster_response(TRIANGULAR, 0.0)
    balance = ClusterBalance(response, draw(response, 64, 2))
    found = balance.solve(0.2, (0.12, 0.5, 0.1))
    f, kappa, tau = found.effective
    h = balance.relax(0.2, found.effective)
    force = np.maximum(h, 0.0) ** 1.5
    phi = force - f - kappa * (h - 0.2)
    assert_allclose([force.mean(), h.mean()], [f, 0.2], rtol=1e-6)  # no mean breathing either
    assert abs(np.mean(phi * balance.misfits)) < 1e-7
    assert_allclose(np.sqrt(np.mean(phi**2)), kappa * tau, rtol=1e-5)
    assert_allclose(found.force, force[:, response.central].mean(), rtol=1e-6)
    assert found.force < f  # the rim carries more


@pytest.mark.claim("cluster-second-order")
@pytest.mark.parametrize(
    ("lattice", "balls", "shape"),
    [(TRIANGULAR, 7, FLAT), (TRIANGULAR, 7, SKEWED.shape), (TRIANGULAR, 19, FLAT), (FCC, 13, FLAT)],
)
def test_second_order_at_high_load_is_exact(lattice, balls, shape):
    """f* = y^(3/2) (1 + r/(64 y^2)), r = Xi/(1 + Xi), whatever the number of points."""
    response = cluster_response(lattice, 0.0, balls)
    star = response.response[np.ix_(response.central, response.central)].sum() / np.count_nonzero(
        response.central
    )
    if lattice is TRIANGULAR:
        r = local_field(mindlin_ratio=0.0).xi / (1.0 + local_field(mindlin_ratio=0.0).xi)
        assert_allclose(1.0 - star, r, rtol=1e-6)
    balance = ClusterBalance(response, PointSource(response, shape).draw([0], 64))
    rest = []
    for y in (8.0, 16.0):
        found = balance.solve(y, (y**1.5, 1.5 * y**0.5, 0.01))
        rest.append((found.force / y**1.5 - 1.0) * 64.0 * y**2 / (1.0 - star) - 1.0)
    if shape is FLAT:  # the fourth order is next
        assert abs(rest[1]) < 1e-3
        assert abs(rest[1]) < 0.3 * abs(rest[0])
    else:  # the third, which goes with the skewness
        assert abs(rest[1]) < 0.03
        assert rest[1] / rest[0] == pytest.approx(0.5, abs=0.1)


@pytest.mark.claim("cluster-quadrature")
def test_quadrature_error_is_that_of_the_points():
    """Twice: the scatter between scrambles says how far a mean is off, and it falls with the number
    of points.
    """
    response = cluster_response(TRIANGULAR, 0.0)

    def solve(points):
        balance = ClusterBalance(response, draw(response, points, 8))
        found = [balance.solve(0.3, START)]
        return [found[0], balance.step(found[0], 0.1)]

    few, more, most = (solve(points) for points in (64, 256, 1024))
    for one, two, best in zip(few, more, most, strict=True):
        for found in (one, two):
            assert abs(found.force / best.force - 1.0) < 4.0 * (found.error + best.error)
        assert best.error < 0.5 * one.error
        assert best.error < 1e-3


def test_descent_comes_near_the_equilibrium():
    response = cluster_response(TRIANGULAR, 0.0)
    balance = ClusterBalance(response, draw(response, 256, 2))
    descent = ClusterDescent(balance, FLAT)
    found = balance.solve(0.3, START)
    for y, steps, near in ((0.3, 15, 1e-3), (0.3, 50, 2e-5), (0.1, 15, 0.01), (0.1, 50, 1e-4)):
        found = balance.step(found, y)
        h = balance.relax(y, found.effective)
        (after,) = descent._descend(y, found.effective, *descent._few, (steps,))
        closed = np.maximum(h, 0.0) ** 1.5
        assert np.sqrt(np.mean((after - h)[h > 0.0] ** 2)) < near
        # what the balance is a mean of is the same after the descent, but for a constant
        after = descent._evaluate(found, found.effective, descent._few, (steps,))[0]
        assert np.std(found.realisations - after[:, 0]) < 2.0 * near * np.std(
            closed[:, response.central].mean(axis=1)
        )
        means = [found.force, found.force**2 * (1.0 + found.fluctuation**2), found.contacts]
        assert_allclose(after[:, 1:4].mean(axis=0), means, rtol=0.01)
        assert_allclose(after[:, 4:].mean(axis=0), 0.0, atol=2.0 * near * found.force)


@pytest.mark.claim("cluster-quadrature")
@pytest.mark.parametrize("lattice", [TRIANGULAR, pytest.param(FCC, marks=pytest.mark.exhaustive)])
def test_many_realisations_take_the_quadrature_error_off(lattice):
    """Two runs that share no point: they are as far apart as their errors say, which are those that
    were asked for.
    """
    response = cluster_response(lattice, 0.0)

    def solve(first):
        balance = ClusterBalance(response, draw(response, 64, 16, first))
        descent = ClusterDescent(balance, FLAT, first)
        found = [balance.solve(0.3, START)]
        found.append(balance.step(found[0], 0.1))
        return found, [descent.refine(one, 4e-4, number) for number, one in enumerate(found, 1)]

    (few, one), (_, other) = solve(0), solve(100)
    for before, (means, error, _), (again, chance, _) in zip(few, one, other, strict=True):
        force, ball, square, contacts = means
        assert error <= 4e-4 * before.force
        assert abs(force - again[0]) < 4.0 * np.hypot(error, chance)
        assert abs(force - before.force) < 4.0 * np.hypot(error, before.error * before.force)
        assert_allclose(ball, force, rtol=3e-3)
        assert_allclose([square, contacts], again[2:], rtol=5e-3)
        assert_allclose(square, force**2 * (1.0 + before.fluctuation**2), rtol=0.02)


@pytest.fixture
def processors(monkeypatch):
    """How many there are said to be, in a list that a test may change."""
    found = [3]
    monkeypatch.setattr(threads, "count_processors", lambda: found[0])
    return found


def test_the_number_of_threads_changes_no_digit(processors, monkeypatch):
    monkeypatch.setattr(balances, "_AT_ONCE", 2**11)
    response = cluster_response(TRIANGULAR, 0.0)

    def solve(count):
        processors[0] = count
        balance = ClusterBalance(response, draw(response, 64, 2))
        found = balance.solve(0.3, START)
        means, error, _ = ClusterDescent(balance, FLAT).refine(found, 1e-3, 1)
        return found.effective, found.realisations, means, error

    for one, other in zip(solve(1), solve(5), strict=True):
        assert_array_equal(one, other)


@pytest.mark.usefixtures("processors")
def test_work_is_shared_out_in_order_and_its_errors_are_raised():
    assert threads.share_out(lambda n: n * n, range(20)) == [n * n for n in range(20)]
    assert threads.share_out(abs, []) == []
    with pytest.raises(ZeroDivisionError):
        threads.share_out(lambda n: 1 // (n - 3), range(8))


def test_a_worker_process_has_one_processor():
    """Others work beside it."""
    with Workers(2) as executor:
        assert executor.submit(threads.count_processors).result() == 1
    assert 1 <= threads.count_processors() <= (os.cpu_count() or 1)


def test_products_are_held_to_one_thread():
    from threadpoolctl import threadpool_info

    before = [one["num_threads"] for one in threadpool_info()]
    with threads.single_products():
        assert {one["num_threads"] for one in threadpool_info()} == {1}
    assert [one["num_threads"] for one in threadpool_info()] == before


@pytest.mark.exhaustive
@pytest.mark.claim("cluster-quadrature")
def test_curves_that_share_no_point_are_as_far_apart_as_their_errors():
    """At the overlaps where it is solved and at those between."""
    curves_of = [
        curves.cluster_curve(FLAT, TRIANGULAR, 0.0, 7, seed=seed) for seed in (0, 100, 200)
    ]
    y = np.linspace(-0.05, 1.5, 32)
    force = np.array([curve.value(y, curves.FORCE) for curve in curves_of])
    errors = np.array([np.interp(y, curve.nodes, curve.errors) for curve in curves_of])
    off = (force / force.mean(axis=0) - 1.0) / np.sqrt(np.mean(errors**2, axis=0))
    assert np.max(errors[:, y >= 0.0]) < 2e-3
    assert np.max(np.abs(off)) < 4.0
    # not too large either
    assert 0.3 < np.sqrt(np.mean(off**2)) < 1.5


@pytest.mark.exhaustive
@pytest.mark.claim("cluster-quadrature")
@pytest.mark.parametrize(("lattice", "balls"), [(TRIANGULAR, 7), (FCC, 13)])
def test_quadrature_leaves_less_than_a_ten_thousandth_of_the_force(lattice, balls, full_points):
    curve = curves.cluster_curve(FLAT, lattice, 0.0, balls)
    assert np.max(curve.errors[curve.nodes >= 0.0]) < 1e-4
    assert np.interp(0.0, curve.nodes, curve.errors) < 1e-4


@pytest.mark.claim("cluster-without-push")
def test_without_the_push_from_outside_the_force_is_too_small():
    response = cluster_response(TRIANGULAR, 0.0)
    off = []
    for push in (1.0, 0.0):
        balance = ClusterBalance(response, [(s, push * m) for s, m in draw(response, 256, 4)])
        found = [balance.solve(0.5, (0.37, 1.02, 0.02))]
        for y in (0.2, 0.0):
            found.append(balance.step(found[-1], y))
        off.append([one.force for one in found[1:]])
    assert_allclose(np.divide(off[1], off[0]) - 1.0, [-0.0105, -0.124], rtol=0.15)


# -- the medium ------------------------------------------------------------------------------------


def test_equal_balls_and_chains_follow_hertz():
    equal = gp.Packing(STEEL, 8e-3, friction=False)
    chain = gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH), lattice="chain")
    for packing in (equal, chain):
        medium = gp.ClusterMedium(packing)
        state = medium.at_force([1.0, 20.0])
        assert_array_equal(state.overlap, packing.law.overlap(np.array([1.0, 20.0])))
        assert_array_equal(state.contact_fraction, 1.0)
        assert medium.quadrature_error == 0.0


def test_law_is_the_derivative_of_its_energy(medium):
    law = medium.law
    join = law.curve.far.start
    start = law.curve.start
    y = np.concatenate([np.linspace(start + 0.01, 0.9 * join, 9), [1.1 * join, 30.0]])
    delta = WIDTH * y
    step = 1e-5 * WIDTH * np.maximum(1.0, y)
    for one, other in (
        (law.energy, law.force),
        (law.force, law.stiffness),
        (law.stiffness, law.stiffness_slope),
    ):
        slope = (one(delta + step) - one(delta - step)) / (2.0 * step)
        assert_allclose(slope, other(delta), rtol=3e-6)
    assert_allclose(law.overlap(law.force(delta)), delta, rtol=1e-10, atol=1e-13 * WIDTH)
    # where the polynomial and the series meet
    below = WIDTH * join * (1.0 - 1e-12)
    for one in (law.energy, law.force, law.stiffness, law.stiffness_slope):
        assert_allclose(one(below), one(WIDTH * join), rtol=1e-7)
    assert_allclose(law.force_fluctuation(below), law.force_fluctuation(WIDTH * join), rtol=1e-6)


def test_scales_follow_the_width(medium):
    """The reduced law is one for all widths and materials."""
    soft = gp.Material(young_modulus=70e9, poisson_ratio=0.3, density=2500.0)
    other = gp.ClusterMedium(gp.Packing(soft, 3e-3, gp.Uniform(5e-7), friction=False))
    spacing = np.array([0.5, 0.7, 3.0])
    states = [m.at_overlap((spacing - 0.5) * m.packing.width) for m in (medium, other)]
    assert_allclose(states[0].reduced_force, states[1].reduced_force, rtol=1e-12)
    assert other.law.curve is medium.law.curve


@pytest.mark.claim("cluster-errors")
def test_force_is_near_that_of_the_simulated_array(medium):
    """At a* = 0.7 and 0.5 the error is at most a third of the single site's, or 1 %, quadrature
    included.
    """
    delta = np.array([0.2, 0.0]) * WIDTH
    array = gp.DirectSimulation(PACKING, shape=(64, 64), seed=3, samples=4).at_overlap(delta)
    cluster, site = (m.at_overlap(delta) for m in (medium, gp.EffectiveMedium(PACKING)))
    error, single = (np.abs(s.force / array.force - 1.0) for s in (cluster, site))
    chance = 3.0 * (
        array.mean_errors["force_error"] / array.force + medium.law.quadrature_error(delta)
    )
    assert np.all(error < np.maximum(single / 3.0, 0.01) + chance)
    assert np.all(single > [0.015, 0.1])
    assert_allclose(cluster.force_fluctuation, array.force_fluctuation, rtol=0.05)
    assert_allclose(cluster.contact_fraction, array.contact_fraction, atol=0.03)
    assert_allclose(cluster.normal_stiffness, array.normal_stiffness, rtol=0.05)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "spread", [gp.Normal(0.6e-6), gp.Discrete((7.999e-3, 8.001e-3), (0.5, 0.5)), SKEWED]
)
def test_other_distributions_agree_with_the_effective_medium_at_high_load(spread):
    packing = gp.Packing(STEEL, 8e-3, spread, friction=False)
    delta = packing.width * np.array([6.0, 40.0])
    cluster, site = (
        m.at_overlap(delta) for m in (gp.ClusterMedium(packing), gp.EffectiveMedium(packing))
    )
    assert_allclose(cluster.force, site.force, rtol=2e-6)
    assert_allclose(cluster.force_fluctuation, site.force_fluctuation, rtol=0.02)


@pytest.mark.exhaustive
def test_friction_stiffens_the_lattice_around_a_cluster():
    state = gp.ClusterMedium(gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH))).at_overlap(0.2 * WIDTH)
    site = gp.EffectiveMedium(gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH))).at_overlap(0.2 * WIDTH)
    without = gp.ClusterMedium(PACKING).at_overlap(0.2 * WIDTH)
    assert without.force_fluctuation < state.force_fluctuation < 1.2 * site.force_fluctuation
    assert_allclose(state.force, site.force, rtol=0.05)


def test_observables_come_from_the_state(medium):
    state = medium.at_force([FORCE, 0.1 * FORCE])
    assert state.medium == "cluster"
    assert_array_equal(state.valid, [True, True])
    assert not medium.at_force(0.9 * VALID_FORCE * FORCE).valid
    assert np.all(gp.sound_velocities(state).longitudinal > 0.0)
    assert type(state).from_dict(state.to_dict()) == state
    assert medium.quadrature_error < 0.02


# -- bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize("balls", [6, 8, 38, 0, -7, True, 7.5, "seven", [7]])
def test_no_shell_completes_other_numbers_of_balls(balls):
    with pytest.raises(InputError, match=r"7 or 19 or 37|whole number|2 or more") as caught:
        gp.ClusterMedium(PACKING, balls)
    assert "balls" in str(caught.value)


def test_the_first_shell_is_the_default():
    assert gp.ClusterMedium(PACKING, 7) == gp.ClusterMedium(PACKING)
    assert gp.ClusterMedium(PACKING).n_balls == 7
    assert MediumChoice("cluster", (("balls", 19),)).of(PACKING) == gp.ClusterMedium(PACKING, 19)
    assert MediumChoice("cluster", (("balls", 19),)).label == "cluster(balls=19)"


@pytest.mark.parametrize(
    "name", [name for name in LATTICES if name in ("square", "kagome", "sc", "bcc", "diamond")]
)
def test_mechanisms_are_refused(name):
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH), lattice=name, friction=False)
    with pytest.raises(MechanismError, match="mechanism"):
        gp.ClusterMedium(packing).at_force(1.0)


def test_below_the_curve_is_an_error(medium):
    for ask in (lambda: medium.at_force(1e-3 * FORCE), lambda: medium.at_overlap(-0.3 * WIDTH)):
        with pytest.raises(PrecisionError, match=r"valid from f\* = 0.03"):
            ask()
    with pytest.raises(InputError):
        medium.at_overlap(-0.6 * WIDTH)
    with pytest.raises(InputError):
        medium.at_force(-1.0)


@pytest.mark.exhaustive
def test_kinds_too_rare_for_the_realisations_are_an_error():
    mean = 8e-3 + 1e-4 * 5e-6
    packing = gp.Packing(
        STEEL, mean, gp.Discrete((8e-3, 8.005e-3), (0.9999, 0.0001)), friction=False
    )
    with pytest.raises(PrecisionError, match="so rare a kind"):
        gp.ClusterMedium(packing).at_force(1.0)


SCENE = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 2.04 um}, friction: false}
load: {force: 18.446 N}
medium: {cluster: {balls: NUMBER}}
"""


def test_scenes_take_it(tmp_path, medium):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE.replace("NUMBER", "7"))
    scene = gp.Scene.from_yaml(path)
    assert scene.cost().seconds >= 20.0
    states, left = scene.survey()
    assert list(states) == []
    assert left == "the cluster medium"
    summary = scene.run(tmp_path / "out", figures=False).summary()
    assert summary["medium"] == "cluster(balls=7)"
    assert summary["longitudinal"] == gp.sound_velocities(medium.at_force(18.446)).longitudinal
    path.write_text(SCENE.replace("NUMBER", "8"))
    with pytest.raises(SceneError, match="7 or 19 or 37"):
        gp.Scene.from_yaml(path)


def test_sweeps_take_it_beside_other_media(medium):
    data = gp.sweep(PACKING, force=[FORCE, 0.1 * FORCE], media=("ema", "cluster"))
    found, state = data.sel(medium="cluster"), medium.at_force([FORCE, 0.1 * FORCE])
    assert_array_equal(found["overlap"], state.overlap)
    assert_array_equal(found["exponent"], state.exponent)


@pytest.mark.parametrize("lattice", ["triangular", "fcc", "hcp"])
def test_automatic_media_leave_it_out(lattice):
    """At all loads and tolerances: where one law of 40 s would do, a simulation is cheaper, and
    better at low load.
    """
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH), friction=False, lattice=lattice)
    chosen = set()
    for tolerance in (0.01, 0.02, 0.05):
        for load in np.geomspace(0.1, 3.0, 5) * FORCE:
            chosen |= {
                serving.medium.name
                for serving in gp.AutoMedium(packing, tolerance).choose("force", load)
            }
    assert "cluster" not in chosen
    assert "simulation" in chosen
