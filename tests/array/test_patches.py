"""Few balls that are moved together: their matrix by a dense one, and the equations of a step with weakly held balls."""

import math

import numpy as np
import pytest

from granphon.array import load_step
from granphon.array import preconditioners as patches
from granphon.array.friction import Tangent
from granphon.array.geometry import multiply
from granphon.array.load_step import LinearSteps
from granphon.array.preconditioners import Patches
from granphon.array.stencils import Motion, Stencils
from granphon.balls.lattices import FCC, HONEYCOMB, TRIANGULAR

ETA = 0.8


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
    expected = np.linalg.solve(matrix + patches._HOLDING * np.eye(len(own)), force[chosen].ravel())
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
