"""The sample at rest against Newton's method with dense and sparse solvers, closed forms, and its
own symmetries.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import platform
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.sparse import coo_array, eye_array
from scipy.sparse.linalg import splu

import granphon as gp
from granphon.array.equilibrium import Equilibrium
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest
from granphon.array.sheared_equilibrium import equilibrate_sheared
from granphon.array.stencils import Stencils
from granphon.balls.diameters import UniformShape
from granphon.balls.lattices import SQUARE, TRIANGULAR
from granphon.base.errors import ConvergenceError, InputError
from granphon.dynamics.local_field import local_field
from granphon.laws.effective import EffectiveLaw
from granphon.statics.options import ResponseOptions, RestOptions
from tests.array.test_stencils import Explicit
from tests.conftest import only

#: a* of tests that go down to loads of few contacts
SPACINGS = (1.0, 0.7, 0.5, 0.42)
every_spacing = pytest.mark.parametrize("spacing", SPACINGS)


@functools.cache
def balls(shape, seed=0, lattice=TRIANGULAR):
    """x of uniformly spread balls, of mean zero."""
    x = gp.Uniform(1.0).sample(Stencils(shape, lattice=lattice).ball_shape, seed)
    x = x - np.mean(x)
    x.setflags(write=False)
    return x


@functools.cache
def at_rest(shape, seed, spacing):
    return bring_to_rest(balls(shape, seed), ReducedLoad(overlap=spacing - 0.5))


def close_forces(one, other, tolerance=1e-8):
    """Whether contact forces agree, in units of the mean."""
    np.testing.assert_allclose(
        one / np.mean(other), other / np.mean(other), rtol=0.0, atol=tolerance
    )


# -- an independent solution -----------------------------------------------------------------------


def by_lstsq(matrix, right):
    return np.linalg.lstsq(matrix.toarray(), right, rcond=1e-13)[0]


def by_sparse_lu(matrix, right):
    """The first ball is pinned; balls that nothing holds, by a spring of 1e-14."""
    free = matrix.tocsc()[2:, 2:]
    held = free + 1e-14 * abs(free).max() * eye_array(free.shape[0], format="csc")
    factors = splu(
        held.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.concatenate([np.zeros((2, right.shape[1])), factors.solve(right[2:])])


def newton(x, load, solve, strain=((0.0, 0.0), (0.0, 0.0))):
    """(3, L1, L2) forces, and y: Newton's method with a matrix, contacts and signs written anew; in
    a strained cell.
    """
    explicit = Explicit(x.shape)
    rows, columns, values = zip(*explicit.entries(), strict=True)
    c = coo_array((values, (rows, columns)), (3 * x.size, 2 * x.size)).tocsr()
    affine = [n @ np.asarray(strain) @ n for n in np.array(Explicit.normals)]
    means, u = explicit.means(x) - np.repeat(affine, x.size), np.zeros(2 * x.size)
    y = load.force ** (2.0 / 3.0) if load.overlap is None else load.overlap

    def gradient(u, y):
        h = np.maximum(y + means - c @ u, 0.0)
        return (
            -(c.T @ h**1.5),
            (np.sum(h**1.5) - h.size * load.force if load.overlap is None else 0.0),
            h,
        )

    for _ in range(200):
        by_u, by_y, h = gradient(u, y)
        force = h**1.5
        left = max(np.max(np.abs(by_u)) / np.mean(force), abs(by_y) / np.sum(force))
        if left < 1e-11:
            return force.reshape(3, *x.shape), y
        k = 1.5 * np.sqrt(h)
        k = k + 1e-2 * min(1.0, left) * np.mean(k)
        mixed = -(c.T @ k)
        turn, fall = solve(c.T @ c.multiply(k[:, None]), np.stack([mixed, by_u], axis=1)).T
        dy = -(by_y - mixed @ fall) / (np.sum(k) - mixed @ turn) if load.overlap is None else 0.0
        du = -fall - turn * dy

        def slope(length, u=u, y=y, du=du, dy=dy):
            by_u, by_y, _ = gradient(u + length * du, y + length * dy)
            return by_u @ du + by_y * dy

        end = 1.0
        while slope(end) < -0.1 * abs(slope(0.0)):
            end *= 2.0
        length = (
            end
            if abs(slope(end)) <= 0.1 * abs(slope(0.0))
            else brentq(slope, 0.0, end, xtol=1e-6, rtol=1e-3)
        )
        u = u + length * du
        y = y + length * dy
    raise AssertionError(f"Newton's method has left {left}")


@pytest.mark.claim("array-balance")
@pytest.mark.parametrize(
    ("solve", "shape"),
    [
        pytest.param(by_lstsq, (5, 7), id="dense 5x7"),
        pytest.param(by_sparse_lu, (1, 9), id="sparse 1x9"),
        pytest.param(by_sparse_lu, (12, 9), id="sparse 12x9"),
        pytest.param(by_sparse_lu, (24, 17), id="sparse 24x17", marks=pytest.mark.slow),
    ],
)
@every_spacing
def test_against_newtons_method_with_a_matrix(solve, shape, spacing):
    state = at_rest(shape, 1, spacing)
    forces, _ = newton(balls(shape, 1), ReducedLoad(overlap=spacing - 0.5), solve)
    close_forces(state.forces, forces, 1e-9)
    assert state.force == pytest.approx(np.mean(forces), rel=1e-11)
    # and the other way: the load given, the overlap found
    load = ReducedLoad(force=state.force)
    forces, y = newton(balls(shape, 1), load, solve)
    assert y == pytest.approx(spacing - 0.5, abs=1e-12)
    again = bring_to_rest(balls(shape, 1), load)
    assert again.overlap == pytest.approx(y, abs=1e-12)
    assert again.force == pytest.approx(load.force, rel=2e-13)
    close_forces(again.forces, forces, 1e-9)


# -- closed forms ----------------------------------------------------------------------------------


def projected(x):
    """r of a sample: 24 <h^2> with h the part of the (x_i + x_j)/2 that no motion takes away, from
    dense least squares.
    """
    explicit = Explicit(x.shape)
    c, means = explicit.dense(), explicit.means(x)
    left = means - c @ np.linalg.lstsq(c, means, rcond=1e-12)[0]
    return 24.0 * float(np.mean(left**2))


def expected(length):
    """r of uniformly spread balls on average over samples of L x L: the sum over their waves, but
    for the mean.

    A wave of x enters the contacts with cosines and the two projections of a motion with sines, for
    the three directions.
    """
    angles = np.pi * np.arange(length) / length
    p, q = (grid.ravel()[1:] for grid in np.meshgrid(angles, angles, indexing="ij"))
    half = np.stack([q, p, p + q])
    mean = np.cos(half)
    normals = np.array(Explicit.normals)
    strain = 2.0 * np.sin(half)[:, None] * normals[..., None]
    matrix = np.einsum("caq,cbq->qab", strain, strain)
    pull = np.einsum("caq,cq->qa", strain, mean)
    taken = np.einsum("qa,qa->q", pull, np.linalg.solve(matrix, pull[..., None])[..., 0])
    # <x x> = 1/12 of each wave; with its mean shifted to zero a sample lacks the first
    return 24.0 / 12.0 * float(np.sum(np.sum(mean**2, axis=0) - taken)) / (3.0 * length**2)


R = local_field(mindlin_ratio=0.0).xi / (1.0 + local_field(mindlin_ratio=0.0).xi)


def correction(state):
    """64 x^2 (f*/x^(3/2) - 1), which goes to r."""
    return 64.0 * state.overlap**2 * float(np.mean(state.excess)) / state.overlap**1.5


def test_high_loads_of_one_sample_meet_second_order_theory():
    # one sample has a third order as well; of the whole distribution it is zero
    x = balls((9, 7))
    r = projected(balls((9, 7)))
    overlaps = np.array([1e2, 1e3, 1e4])
    errors = np.abs(
        [correction(bring_to_rest(x, ReducedLoad(overlap=y))) - r for y in overlaps.tolist()]
    )
    order = -np.diff(np.log(errors)) / np.diff(np.log(overlaps))
    np.testing.assert_allclose(order, 1.0, atol=0.05)
    assert errors[-1] < 1e-4 * r


def test_second_order_is_that_of_the_local_field():
    # Green's function of the whole lattice, in the local field, and the waves of a finite array
    lengths = np.array([16, 32, 64])
    errors = np.array([R - expected(length) for length in lengths.tolist()])
    # the mean that is shifted
    np.testing.assert_allclose(errors * lengths**2, errors[0] * lengths[0] ** 2, rtol=1e-2)
    assert expected(64) + errors[1] / 4.0 == pytest.approx(R, rel=1e-6)
    # the effective medium, without friction, goes there with its second order
    law = EffectiveLaw(1.0, 1.0, UniformShape(), R / (1.0 - R))
    y = np.array([4.0, 16.0, 64.0])
    left = np.abs(64.0 * y**2 * (law.force(y) / y**1.5 - 1.0) - R)
    np.testing.assert_allclose(-np.diff(np.log(left)) / np.diff(np.log(y)), 2.0, atol=0.05)


@pytest.mark.claim("high-pressure-orders")
def test_high_loads_of_many_samples_meet_the_local_field():
    seeds = range(40)
    length = 16
    values = [
        correction(bring_to_rest(balls((length, length), seed), ReducedLoad(overlap=300.0)))
        for seed in seeds
    ]
    error = np.std(values, ddof=1) / math.sqrt(len(values))
    assert error < 0.01 * R
    assert np.mean(values) == pytest.approx(expected(length), abs=3.0 * error)
    assert expected(length) == pytest.approx(R, rel=0.01)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (4, 3)], ids=str)
def test_equal_balls_are_hertzs(shape):
    for load in (ReducedLoad(overlap=0.7), ReducedLoad(force=0.7**1.5)):
        state = bring_to_rest(np.zeros(shape), load)
        assert (state.overlap, state.force) == pytest.approx((0.7, 0.7**1.5), rel=1e-15)
        assert state.stiffness == pytest.approx(1.5 * 0.7**0.5, rel=1e-14)
        assert state.stiffness_slope == pytest.approx(0.75 * 0.7**-0.5, rel=1e-14)
        assert state.energy == pytest.approx(0.4 * 0.7**2.5, rel=1e-14)
        assert not np.any(state.balls)


def test_two_kinds_of_columns_by_hand():
    # x alternates along a2 (period two): contacts along a1 join like balls, the others unlike ones.
    # Nothing moves: every ball sits at a centre of symmetry
    x = np.tile([0.3, -0.3], (2, 1))
    y = 1.0
    state = bring_to_rest(x, ReducedLoad(overlap=y))
    h = np.array([np.full((2, 2), y), y + x, np.full((2, 2), y)])
    np.testing.assert_allclose(state.overlaps, h, rtol=1e-14)
    assert state.force == pytest.approx((2.0 + (1.3**1.5 + 0.7**1.5) / 2.0) / 3.0, rel=1e-14)
    assert state.stiffness == pytest.approx(
        1.5 * (2.0 + (1.3**0.5 + 0.7**0.5) / 2.0) / 3.0, rel=1e-13
    )
    assert state.energy == pytest.approx(0.4 * (2.0 + (1.3**2.5 + 0.7**2.5) / 2.0) / 3.0, rel=1e-13)


# -- derivatives -----------------------------------------------------------------------------------


def differences(of, at, step):
    """First derivative to fourth order."""
    one, two = (of(at + n * step) - of(at - n * step) for n in (1, 2))
    return (8.0 * one - two) / (12.0 * step)


@pytest.mark.parametrize("shape", [(6, 5), pytest.param((16, 16), marks=pytest.mark.slow)], ids=str)
@every_spacing
def test_derivatives_are_those_of_the_force(shape, spacing):
    state = at_rest(shape, 1, spacing)
    y = spacing - 0.5

    @functools.cache
    def there(overlap):
        return bring_to_rest(balls(shape, 1), ReducedLoad(overlap=overlap))

    # contacts open and close at some loads, where the third derivative of the force jumps
    step = 2e-5 * (1.0 if spacing > 0.6 else 0.2)
    assert state.stiffness == pytest.approx(
        differences(lambda y: there(y).force, y, step), rel=2e-6
    )
    assert state.stiffness_slope == pytest.approx(
        differences(lambda y: there(y).stiffness, y, step), rel=2e-5
    )
    assert state.force == pytest.approx(differences(lambda y: there(y).energy, y, step), rel=2e-6)


# -- which way it was reached, and what is left ----------------------------------------------------


def residual(state):
    """Largest force left on a ball over the mean contact force, one contact after the other."""
    x = state.deviations
    shape = state.deviations.shape
    u = np.moveaxis(state.stencils.displacements(state.balls), 0, -1)
    left, total = np.zeros((*shape, 2)), 0.0
    for p, q in np.ndindex(shape):
        for (a, b), normal in zip(Explicit.steps, Explicit.normals, strict=True):
            j = (p + a) % shape[0], (q + b) % shape[1]
            h = state.overlap + 0.5 * (x[p, q] + x[j]) - (u[j] - u[p, q]) @ normal
            force = max(h, 0.0) ** 1.5
            total += force
            left[p, q] -= force * np.array(normal)
            left[j] += force * np.array(normal)
    return np.max(np.linalg.norm(left, axis=-1)) / (total / (3.0 * x.size))


@pytest.mark.claim("array-balance")
@pytest.mark.parametrize("spacing", [1e3, 1.0, 0.7, 0.5, 0.42, 0.39, 0.363])
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_nothing_is_left_on_any_ball(spacing, seed):
    state = bring_to_rest(balls((32, 32), seed), ReducedLoad(overlap=spacing - 0.5))
    assert state.residual <= 1e-10
    assert residual(state) == pytest.approx(state.residual, rel=1e-2, abs=1e-14)


@pytest.mark.parametrize("spacing", [0.6, 0.5, 0.42, 0.37])
def test_contacts_that_carry_load_stand_out(spacing):
    # those of balls that nothing holds have less than what is left on a ball, those of the others
    # far more
    for seed in range(2):
        state = bring_to_rest(balls((32, 32), seed), ReducedLoad(overlap=spacing - 0.5))
        parts = state.forces[state.forces > 0.0] / (state.force * state.residual)
        assert not np.any((parts > 1.0) & (parts < 100.0))
        assert np.array_equal(
            state.stiffnesses > 0.0, state.forces > 10.0 * state.residual * state.force
        )
        assert np.array_equal(state.stiffness_slopes > 0.0, state.stiffnesses > 0.0)


@pytest.mark.claim("array-balance")
@pytest.mark.parametrize("side", [12, pytest.param(20, marks=pytest.mark.slow)])
def test_loading_unloading_and_cold_are_one(side):
    x = balls((side, side), 2)
    loads = [ReducedLoad(overlap=spacing - 0.5) for spacing in (2.0, 1.0, 0.7, 0.5, 0.42, 0.38)]
    stencils = Stencils(x.shape)
    runs = []
    for order in (loads, loads[::-1]):
        states: dict[ReducedLoad, Equilibrium] = {}
        last = None
        for load in order:
            last = states[load] = bring_to_rest(x, load, stencils, last)
        runs.append(states)
    for load in loads:
        cold = bring_to_rest(x, load)
        for states in runs:
            close_forces(states[load].forces, cold.forces)
            assert states[load].stiffness == pytest.approx(cold.stiffness, rel=1e-8)


@settings(max_examples=25)
@given(
    st.tuples(st.integers(1, 8), st.integers(1, 8)),
    st.sampled_from(["uniform", "few", "skewed"]),
    st.integers(0, 2**32 - 1),
    st.floats(-3.0, 6.0),
)
def test_any_balls_under_any_load(shape, kind, seed, decade):
    rng = np.random.default_rng(seed)
    x = {
        "uniform": lambda: rng.uniform(-0.5, 0.5, shape),
        "few": lambda: rng.choice([-0.4, 0.1, 0.3], shape),
        "skewed": lambda: rng.exponential(0.3, shape),
    }[kind]()
    x = x - np.mean(x)
    load = ReducedLoad(force=10.0**decade)
    state = bring_to_rest(x, load)
    assert state.force == pytest.approx(load.force, rel=2e-13)
    assert state.residual <= 1e-10
    assert residual(state) <= 1.1e-10
    assert np.min(state.forces) >= 0.0
    # f is convex in y: stiffness above zero, and forces on balls are in balance along each line of
    # contacts
    assert state.stiffness > 0.0
    again = bring_to_rest(x, ReducedLoad(overlap=state.overlap))
    close_forces(again.forces, state.forces)


# -- symmetries ------------------------------------------------------------------------------------


def symmetries():
    """The 12 of the triangular lattice, in cells: turns by 60 degrees, and each with a
    reflection.
    """
    turn = np.array([[1, -1], [1, 0]])
    mirror = np.array([[0, 1], [1, 0]])
    return [
        np.linalg.matrix_power(turn, n) @ other
        for n in range(6)
        for other in (np.eye(2, dtype=int), mirror)
    ]


def moved(x, matrix, shift):
    """The same balls at other cells: that of cell c at matrix c + shift."""
    out = np.empty_like(x)
    length = len(x)
    for cell in np.ndindex(x.shape):
        place = (matrix @ cell + shift) % length
        out[tuple(place)] = x[cell]
    return out


@pytest.mark.parametrize("spacing", [1.0, 0.5])
def test_symmetries_of_the_lattice(spacing):
    x = balls((8, 8), 3)
    load = ReducedLoad(overlap=spacing - 0.5)
    first = bring_to_rest(x, load)
    forces = np.sort(first.forces.ravel())
    for matrix, shift in itertools.zip_longest(
        symmetries(), [(0, 0), (3, 6), (1, 1)], fillvalue=(0, 5)
    ):
        other = bring_to_rest(moved(x, matrix, np.array(shift)), load)
        assert other.force == pytest.approx(first.force, rel=1e-11)
        assert other.stiffness == pytest.approx(first.stiffness, rel=1e-11)
        assert other.stiffness_slope == pytest.approx(first.stiffness_slope, rel=1e-9)
        close_forces(np.sort(other.forces.ravel()), forces)


@pytest.mark.parametrize(
    ("shape", "copies"), [((4, 5), (2, 3)), ((1, 6), (3, 1)), ((1, 1), (4, 2))]
)
def test_copies_side_by_side_are_the_sample_itself(shape, copies):
    x = balls(shape, 5)
    load = ReducedLoad(overlap=0.1)
    close_forces(
        bring_to_rest(np.tile(x, copies), load).forces,
        np.tile(bring_to_rest(x, load).forces, (1, *copies)),
        1e-8,
    )


def test_threads_of_the_fourier_transform_change_no_digit():
    x = balls((24, 20), 4)
    load = ReducedLoad(overlap=0.0)
    one, two = (bring_to_rest(x, load, Stencils(x.shape, workers=workers)) for workers in (1, 2))
    np.testing.assert_array_equal(one.balls, two.balls)
    assert one.stiffness == two.stiffness
    np.testing.assert_array_equal(one.find_elasticity(0.84), two.find_elasticity(0.84))


# -- statistics ------------------------------------------------------------------------------------


@pytest.mark.exhaustive
@pytest.mark.claim("error-root-n")
def test_scatter_of_the_force_falls_as_the_root_of_the_number_of_balls():
    lengths = (16, 32, 64)
    n = 48
    scatter = [
        np.std([at_rest((m, m), seed, 1.0).force for seed in range(n)], ddof=1) for m in lengths
    ]
    # each is known to 1/sqrt(2 n); so is the slope of three in log L
    slope = np.polyfit(np.log(lengths), np.log(scatter), 1)[0]
    error = 1.0 / math.sqrt(2.0 * n) / math.sqrt(2.0) / math.log(2.0)
    assert error < 0.11
    assert slope == pytest.approx(-1.0, abs=3.0 * error)


@pytest.mark.exhaustive
@pytest.mark.claim("threshold-contacts")
@pytest.mark.parametrize(("n", "most"), [(4, (3e-3, 0.07)), (8, (2e-3, 0.05))])
def test_threshold_of_rigidity(n, most):
    # Roux, as the paper cites: at a* = 0.343, with about 2.5 contacts per ball (here at f* = 1e-4).
    # Near it overlaps go as f^(2/3), as in a network that stays the same; that it does not is in
    # the next power. 24 samples of 64 x 64 down to f* = 3e-5 have 0.3425 +- 0.0005, and 2.37 +-
    # 0.013 contacts at no load
    forces = np.array([1e-2, 3e-3, 1e-3, 3e-4, 1e-4])
    at_no_load = []
    for seed in range(n):
        state = None
        rows = []
        for force in forces.tolist():
            state = bring_to_rest(balls((32, 32), seed), ReducedLoad(force=force), None, state)
            rows.append((state.overlap + 0.5, 6.0 * np.mean(state.forces > 1e-6 * state.force)))
        at_no_load.append(np.polynomial.polynomial.polyfit(forces ** (2.0 / 3.0), rows, 2)[0])
    values = np.mean(at_no_load, axis=0)
    errors = np.std(at_no_load, axis=0, ddof=1) / math.sqrt(n)
    assert np.all(errors < most)
    assert values[0] == pytest.approx(0.343, abs=3.0 * errors[0])
    assert values[1] == pytest.approx(2.37, abs=3.0 * errors[1])


# -- errors, and what comes of them ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "overlap"),
    [
        *((balls((16, 16)), y) for y in (-0.2, -0.5, -100.5)),
        *((np.zeros((3, 3)), y) for y in (0.0, -1.0)),
    ],
)
def test_below_the_threshold_there_is_no_load(x, overlap):
    with pytest.raises(InputError, match="no load") as error:
        bring_to_rest(x, ReducedLoad(overlap=overlap))
    assert f"{overlap:.6g} widths" in str(error.value)


@pytest.mark.claim("least-loads")
def test_what_is_reached_is_said(monkeypatch):
    few = functools.partial(RestOptions, steps=3)
    monkeypatch.setattr("granphon.array.rest.RestOptions", few)
    with pytest.raises(ConvergenceError, match="rest after 3 steps") as error:
        bring_to_rest(balls((16, 16)), ReducedLoad(overlap=0.0))
    left = float(str(error.value).split("a force of ")[1].split(" of the mean")[0])
    assert 1e-10 < left < 100.0
    assert "overlap of 0 widths" in str(error.value)


@pytest.mark.parametrize("strain", [None, np.zeros((2, 2))], ids=["even", "sheared"])
def test_balls_without_load_have_no_stiffness(strain):
    state = Equilibrium(np.zeros((3, 4)), -1.0, np.zeros((2, 3, 4)), strain=strain)
    assert np.all(state.response() == 1.0)
    assert state.stiffness == state.stiffness_slope == 0.0
    assert not np.any(state.find_elasticity(0.8))


def test_a_cell_with_a_shear_that_costs_nothing_has_no_response():
    deviations = balls((4, 4))
    state = equilibrate_sheared(
        deviations, ReducedLoad(overlap=1.0), 0.0, Stencils((4, 4), lattice=SQUARE)
    )
    with pytest.raises(ConvergenceError, match="square lattice costs nothing"):
        _ = state.stiffness


def test_response_that_is_not_found_is_said(monkeypatch):
    state = bring_to_rest(balls((16, 16)), ReducedLoad(overlap=0.0))
    few = functools.partial(ResponseOptions, most_iterations=1)
    monkeypatch.setattr("granphon.statics.response.ResponseOptions", few)
    with pytest.raises(ConvergenceError, match="linear response"):
        _ = state.stiffness


def test_tolerance_is_met_and_not_more_than_needed():
    rough, fine = (
        bring_to_rest(balls((24, 24)), ReducedLoad(overlap=0.2), tolerance=t) for t in (1e-4, 1e-12)
    )
    assert fine.residual <= 1e-12 < rough.residual <= 1e-4
    assert rough.conjugate < fine.conjugate


@pytest.mark.claim("least-loads")
@pytest.mark.parametrize("seed", only([1], [0, 1]))
def test_loads_next_to_nothing(seed):
    # overlaps of 2e-5 at y = -0.15: its last digit is 2e-12 of the force
    state = bring_to_rest(balls((16, 16), seed), ReducedLoad(force=1e-7))
    assert state.force == pytest.approx(1e-7, rel=1e-11)
    assert state.residual <= 1e-10
    assert residual(state) <= 1.1e-10
    assert 0.3 < state.overlap + 0.5 < 0.38


@pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc",
    reason="the memory of other C libraries is kept in other ways",
)
@pytest.mark.parametrize("force", [1e-7, 1e-6])
@pytest.mark.parametrize("shape", [(1, 2), (2, 2), (1, 3)])
def test_few_balls_rest_just_above_the_threshold(shape, force):
    """The spacing of doubles at the overlap, which is below zero, is as coarse as the load."""
    for seed in range(6):
        x = np.random.default_rng(seed).uniform(-0.5, 0.5, shape)
        state = bring_to_rest(x - np.mean(x), ReducedLoad(force=force))
        assert state.overlap < 0.0
        assert state.force == pytest.approx(force, rel=1e-9)
        assert state.residual <= 1e-10


def test_memory_of_arrays_is_kept_for_the_next_ones():
    """Pages that the system has to give again and again cost more than the arithmetic."""
    program = (
        "import resource, numpy as np, granphon.array\n"
        "def faults(): return resource.getrusage(resource.RUSAGE_SELF).ru_minflt\n"
        "x = np.ones(2**17)\n"
        "for turn in range(3): [x + 1.0 for _ in range(4)]\n"
        "before = faults()\n"
        "for turn in range(10): [x + 1.0 for _ in range(4)]\n"
        "print(faults() - before)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], check=True, stdout=subprocess.PIPE, text=True
    )
    assert int(done.stdout) < 1000  # of 10,240 pages


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"strain": np.zeros((3, 3))}, "strain of the shape"),
        ({"balls": np.zeros((1, 4, 4))}, "no array of the triangular"),
    ],
)
def test_arrays_that_belong_to_no_balls_on_the_lattice_are_refused(changes, said):
    state = bring_to_rest(balls((4, 4)), ReducedLoad(overlap=0.5))
    data = dataclasses.replace(state, **changes).to_dict()
    with pytest.raises(InputError, match=said):
        Equilibrium.from_dict(data)
