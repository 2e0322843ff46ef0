"""Arrays near the rigidity threshold: the interior-point method, and preconditioners that know which contacts are open.

With friction, patches of balls that little holds: their matrix by a dense one, and the equations of a step.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granphon.array import equilibrium as module
from granphon.array import linear_response, load_step, preconditioners
from granphon.array.equilibrium import equilibrate
from granphon.array.friction import Tangent
from granphon.array.geometry import ReducedLoad, multiply
from granphon.array.interior import split
from granphon.array.linear_response import find_linear_response
from granphon.array.load_step import LinearSteps
from granphon.array.preconditioners import Patches, Preconditioners
from granphon.array.sparse_matrices import factorise_contacts
from granphon.array.stencils import Motion, Stencils
from granphon.balls.lattices import FCC, HONEYCOMB, TRIANGULAR
from tests.array.test_equilibrium import balls, close_forces, residual
from tests.array.test_stencils import ETA, Explicit


def by_newton(x, load, **more):
    """The equilibrium by Newton's method alone, with Green's function."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_CLOSED_ON_SITES", 0.0)
        patch.setattr(module, "_MOST_INTERIOR", 0.0)
        return equilibrate(x, load, **more)


# -- the equilibrium ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spacing", [0.45, 0.4, 0.37])
def test_equilibrium_is_that_of_newtons_method(spacing):
    x, load = balls((24, 22), 5), ReducedLoad(overlap=spacing - 0.5)
    found, expected = equilibrate(x, load), by_newton(x, load)
    close_forces(found.forces, expected.forces, 1e-9)
    assert residual(found) <= 1.1e-10
    assert found.stiffness == pytest.approx(expected.stiffness, rel=1e-6)


@pytest.mark.parametrize("force", [1e-2, 1e-3, 1e-4])
def test_force_and_overlap_given_are_one(force):
    x = balls((16, 15), 1)
    by_force = equilibrate(x, ReducedLoad(force=force))
    assert by_force.force == pytest.approx(force, rel=2e-13)
    assert residual(by_force) <= 1.1e-10
    close_forces(equilibrate(x, ReducedLoad(overlap=by_force.overlap)).forces, by_force.forces)
    # from another load too
    near = equilibrate(x, ReducedLoad(force=1.3 * force))
    close_forces(equilibrate(x, ReducedLoad(force=force), start=near).forces, by_force.forces)
    close_forces(by_newton(x, ReducedLoad(force=force)).forces, by_force.forces)


@settings(max_examples=12)
@given(st.tuples(st.integers(2, 9), st.integers(2, 9)), st.integers(0, 2**32 - 1), st.floats(-4.0, -2.0))
def test_small_arrays_of_any_balls(shape, seed, decade):
    x = np.random.default_rng(seed).uniform(-0.5, 0.5, shape)
    x -= np.mean(x)
    load = ReducedLoad(force=10.0**decade)
    found = equilibrate(x, load)
    assert found.force == pytest.approx(load.force, rel=2e-13)
    assert residual(found) <= 1.1e-10
    close_forces(equilibrate(x, ReducedLoad(overlap=found.overlap)).forces, found.forces)
    close_forces(by_newton(x, load).forces, found.forces)


def test_balls_that_nothing_holds_touch_no_other():
    # they rest inside their cages: no contact has a trace of force
    x = balls((32, 32), 2)
    state = equilibrate(x, ReducedLoad(overlap=-0.13))
    forces = state.forces / state.force
    assert np.all((forces == 0.0) | (forces > 1e-6))
    held = Stencils(x.shape).around((forces > 0.0).astype(float))
    assert np.mean(held == 0.0) > 0.1
    # Newton's method leaves some where they touch
    others = by_newton(x, ReducedLoad(overlap=-0.13)).forces / state.force
    assert np.any((others > 0.0) & (others < 1e-6))


def test_it_takes_far_fewer_iterations():
    x, load = balls((64, 64)), ReducedLoad(overlap=-0.137)
    found, expected = equilibrate(x, load), by_newton(x, load)
    assert 3 * found.conjugate < expected.conjugate
    assert found.newton < expected.newton
    close_forces(found.forces, expected.forces)


@pytest.mark.parametrize("load", [ReducedLoad(overlap=-0.1), ReducedLoad(force=1e-3)])
def test_newtons_method_goes_on_from_the_start_where_it_does_not_come_near(load, monkeypatch):
    x = balls((16, 15), 1)
    expected = equilibrate(x, load)
    monkeypatch.setattr("granphon.array.interior._STEPS", 5)
    found = equilibrate(x, load)
    assert found.newton > expected.newton
    close_forces(found.forces, expected.forces)


@pytest.mark.parametrize("seed", range(4))
def test_least_loads_of_few_balls(seed):
    # next to the threshold itself, where a contact more or less decides
    found = equilibrate(balls((5, 5), seed), ReducedLoad(force=1.01e-8))
    assert found.force == pytest.approx(1.01e-8, rel=2e-13)
    assert found.residual <= 1e-10


@pytest.mark.parametrize("width", [1.0, 1e-8])
def test_force_and_gap_of_every_overlap(width):
    h = np.concatenate([-np.logspace(3, -12, 31), [0.0], np.logspace(-12, 3, 31)])
    f, s = split(h, width)
    assert np.all((f > 0.0) & (s > 0.0))
    closed = f ** (2.0 / 3.0)
    np.testing.assert_allclose(closed * s, width**2, rtol=1e-13)
    np.testing.assert_allclose(closed - s, h, rtol=0.0, atol=1e-15 * (closed + s).max())


@pytest.mark.parametrize("seed", [0, 2])
def test_steps_at_low_loads_in_space(seed):
    # without centring 51 and 58 steps
    x = np.random.default_rng(seed).uniform(-0.5, 0.5, (12, 12, 12))
    x -= np.mean(x)
    state = equilibrate(x, ReducedLoad(force=1e-4), Stencils(x.shape, lattice=FCC))
    assert state.newton < 45  # 42 or less, as it is rounded
    assert state.residual <= 1e-10


# -- factors of the contacts that are closed ----------------------------------------------------------------------------


def dense_inverse(inverse, fields, n):
    columns = [inverse(one.reshape(n, fields).T.copy()).T.ravel() for one in np.eye(fields * n)]
    return np.array(columns).T


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_factors_are_the_inverse_of_any_network(dimension):
    # contacts in no order, in one to three dimensions, with more of them than motions
    rng = np.random.default_rng(dimension)
    n, kinds, each = 12, 5, 24
    i, j = rng.integers(0, n, (kinds, each)), rng.integers(0, n, (kinds, each))
    j = np.where(i == j, (j + 1) % n, j)
    i[0, :n], j[0, :n] = np.arange(n), (np.arange(n) + 1) % n
    head, tail = rng.normal(size=(2, kinds, dimension))
    stiffness = rng.uniform(0.5, 1.5, (kinds, each))
    c = np.zeros((kinds, each, n, dimension))
    for kind in range(kinds):
        for contact in range(each):
            c[kind, contact, j[kind, contact]] += head[kind]
            c[kind, contact, i[kind, contact]] -= tail[kind]
    c = c.reshape(kinds * each, n * dimension)
    expected = np.linalg.inv(c.T @ (stiffness.reshape(-1, 1) * c))
    found = dense_inverse(factorise_contacts(i, j, head, tail, stiffness), dimension, n)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-3 * abs(expected).max())


@pytest.mark.parametrize("eta", [0.0, ETA])
def test_factors_are_symmetric_and_positive_where_contacts_are_open(eta):
    stencils, n = Stencils((6, 5), eta), 30
    stiffness = np.random.default_rng(1).uniform(0.5, 1.0, (3, 6, 5))
    stiffness[np.random.default_rng(2).random((3, 6, 5)) < 0.6] = 0.0
    stiffness[:, 2, 2] = 1e-6  # soft: on the diagonal only
    inverse = Preconditioners(stencils).choose(stencils.weights(stiffness), hard=True)
    found = dense_inverse(lambda force: inverse(force.reshape(-1, 6, 5)).reshape(-1, n), stencils.n_fields, n)
    assert np.min(np.linalg.eigvalsh(found + found.T)) > 0.0

    # seen by the contacts' energy, to which motions that cost nothing do not count
    def deform(motion):
        return stencils.deformations(Motion(motion.reshape(n, -1).T.reshape(-1, 6, 5), 0.0)).ravel()

    c = np.array([deform(one) for one in np.eye(found.shape[0])]).T
    rows = np.sqrt(stencils.weights(stiffness)).reshape(-1, 1) * c
    energy = rows @ found @ rows.T
    # rounding of single precision, 6e-8, over the least eigenvalue, 1e-5
    np.testing.assert_allclose(energy, energy.T, rtol=0.0, atol=6e-3)


@pytest.mark.parametrize("eta", [0.0, ETA])
def test_linear_response_where_half_of_the_contacts_are_open(eta):
    state = equilibrate(balls((12, 11), 4), ReducedLoad(overlap=-0.12))
    stencils, normal = Stencils((12, 11), eta), state.stiffnesses
    assert np.mean(normal > 0.0) < 0.6
    stiffness = stencils.weights(normal)
    tensions = [stiffness * a for a in np.random.default_rng(0).normal(size=(2, *stiffness.shape))]
    found = find_linear_response(stencils, stiffness, tensions, 1e-7)
    explicit = Explicit((12, 11), eta)
    c, k = explicit.dense(), stiffness.ravel()
    matrix, strain = c.T @ (k[:, None] * c), [stencils.deformations(Motion(one, 0.0)) for one in found]
    for tension, one in zip(tensions, strain, strict=True):
        expected = c @ np.linalg.lstsq(matrix, c.T @ tension.ravel(), rcond=1e-12)[0]
        # what contacts without stiffness do is not unique
        np.testing.assert_allclose((stiffness * one).ravel(), k * expected, rtol=0.0, atol=1e-5 * abs(k * expected).max())


@pytest.mark.parametrize("overlap", [0.4, -0.12])
def test_linear_response_is_the_same_where_single_precision_does_not_serve(monkeypatch, overlap):
    state = equilibrate(balls((12, 11), 4), ReducedLoad(overlap=overlap))
    stencils = Stencils((12, 11), ETA)
    stiffness = stencils.weights(state.stiffnesses)
    tension = stiffness * np.random.default_rng(0).normal(size=stiffness.shape)
    found = find_linear_response(stencils, stiffness, [tension], 1e-8)[0]
    monkeypatch.setattr(linear_response, "_STALLED", 0.0)
    double = find_linear_response(stencils, stiffness, [tension], 1e-8)[0]
    assert not np.array_equal(double, found)
    one, other = (stencils.deformations(Motion(motion, 0.0)) for motion in (found, double))
    assert np.sum(stiffness * (one - other) ** 2) <= 1e-14 * np.sum(stiffness * one**2)


# -- the choice ---------------------------------------------------------------------------------------------------------


def opened(shape, fraction, seed=0):
    rng = np.random.default_rng(seed)
    return np.where(rng.random((3, *shape)) < fraction, 0.0, rng.uniform(0.5, 1.0, (3, *shape)))


def is_factors(chosen, stiffness, **more):
    return chosen.choose(stiffness, **more) is chosen._factors


def test_factors_are_chosen_by_state_and_size(monkeypatch):
    stencils = Stencils((16, 16))
    assert is_factors(Preconditioners(stencils), opened((16, 16), 0.5), hard=True)
    assert not is_factors(Preconditioners(stencils), opened((16, 16), 0.1), hard=True)
    assert not is_factors(Preconditioners(stencils), opened((16, 16), 0.5))
    monkeypatch.setattr("granphon.array.preconditioners.MOST_BALLS", (256, 255, 256))
    assert not is_factors(Preconditioners(stencils), opened((16, 16), 0.5), hard=True)


# -- patches of balls that little holds, with friction ------------------------------------------------------------------


def draw_tangent(stencils, seed=0):
    """The tangent of contacts of which some slide, and whose tangential forces follow their overlaps."""
    draw = np.random.default_rng(seed)
    contacts = (stencils.n_contacts, *stencils.shape)
    slips = (stencils.n_rows // stencils.n_contacts - 1, *contacts)
    stiffness = draw.uniform(0.5, 1.5, contacts)
    way = draw.normal(size=slips)
    sliding = way / np.linalg.norm(way, axis=0) * (draw.random(contacts) < 0.3)
    return Tangent(stiffness, ETA * stiffness, 0.2 * draw.normal(size=slips), sliding)


def find_matrix(stencils, tangent):
    """C^T D C as a dense matrix, ball after ball: rows and columns are (balls, cells, fields), column by column."""
    columns = []
    for unit in np.eye(stencils.n_fields * math.prod(stencils.shape)):
        rows = stencils.deformations(Motion(unit.reshape(stencils.n_fields, *stencils.shape), 0.0))
        loss, slips = (
            rows[: stencils.n_contacts],
            rows[stencils.n_contacts :].reshape(-1, stencils.n_contacts, *stencils.shape),
        )
        normal, shear = tangent.apply(loss, slips)
        columns.append(stencils.forces(np.concatenate([normal, shear.reshape(-1, *stencils.shape)])).ravel())
    by_field = (stencils.n_balls, stencils.motions.count, math.prod(stencils.shape))
    order = np.arange(len(columns)).reshape(by_field).swapaxes(1, 2).ravel()
    return np.transpose(columns)[np.ix_(order, order)]


@pytest.mark.parametrize("lattice", [TRIANGULAR, HONEYCOMB, FCC])
def test_balls_of_a_patch_move_as_if_all_others_were_held(lattice):
    shape = (4, 5) if lattice.periods == 2 else (2, 3, 2)
    stencils = Stencils(shape, ETA, lattice=lattice)
    tangent = draw_tangent(stencils)
    draw, fields, cells = np.random.default_rng(1), stencils.motions.count, math.prod(shape)
    chosen = np.sort(draw.choice(stencils.n_balls * cells, 5, replace=False))
    put = Patches(stencils).invert(chosen, tangent)
    force = draw.normal(size=(stencils.n_fields, *shape)).astype(np.float32)
    motion = np.full_like(force, 7.0)
    put(force, motion)
    force, motion = (
        np.moveaxis(one.reshape(stencils.n_balls, fields, cells), 1, 2).reshape(-1, fields) for one in (force, motion)
    )
    own = (fields * chosen[:, None] + np.arange(fields)).ravel()
    matrix = find_matrix(stencils, tangent)[np.ix_(own, own)]
    assert np.max(np.abs(matrix - matrix.T)) > 0.01  # it is not symmetric
    expected = np.linalg.solve(matrix + preconditioners._HOLDING * np.eye(len(own)), force[chosen].ravel())
    np.testing.assert_allclose(motion[chosen].ravel(), expected, rtol=0.0, atol=1e-5 * np.max(np.abs(expected)))
    others = np.setdiff1d(np.arange(len(motion)), chosen)
    np.testing.assert_array_equal(motion[others], 7.0)


#: balls that hold the next one, while the rest of the array hardly holds the two
PAIRS = {(4, 4): 3e-2, (12, 20): 1e-2, (25, 9): 5e-3, (20, 28): 2e-3, (9, 14): 1e-3}


def weaken(stencils):
    """A tangent in which pairs of balls are held by a small part of what the two hold each other by."""
    draw = np.random.default_rng(2)
    stiffness = draw.uniform(0.8, 1.2, (stencils.n_contacts, *stencils.shape))
    for (row, column), factor in PAIRS.items():
        pair = np.zeros(stencils.shape)
        pair[row : row + 2, column] = 1.0
        stiffness *= np.where(stencils.average_pairs(pair) == 0.5, factor * draw.uniform(0.5, 2.0, stiffness.shape), 1.0)
    return Tangent(stiffness, ETA * stiffness, 0.1 * stiffness[None], np.zeros((1, *stiffness.shape)))


@pytest.mark.parametrize("push", [None, 30.0])
def test_weakly_held_balls_are_found_and_save_iterations(push, monkeypatch):
    stencils = Stencils((32, 32), ETA)
    tangent = weaken(stencils)
    product = multiply(stencils, tangent)
    pull = np.random.default_rng(3).normal(size=(3, 32, 32))
    pull -= np.mean(pull, axis=(1, 2), keepdims=True)

    def solve(few):
        monkeypatch.setattr(load_step, "_FEW", few)
        steps = LinearSteps(Patches(stencils), damped=False)
        way, taken = steps.solve(product, tangent, pull, push, 1e-3)
        back, force = product(way.balls.astype(np.float32), None if push is None else way.compression)
        left = np.hypot(np.linalg.norm(back - pull), 0.0 if push is None else force - push)
        assert left <= 1.1e-3 * np.hypot(np.linalg.norm(pull), push or 0.0)  # vectors are in single precision
        return taken, steps._weak

    taken, weak = solve(10)
    weakest = [at for at, factor in PAIRS.items() if factor <= 5e-3]
    assert {32 * (row + one) + column for row, column in weakest for one in (0, 1)} <= set(weak.tolist())
    assert weak.size < 150
    without, none = solve(300)
    assert none.size == 0
    assert taken < 0.75 * without
