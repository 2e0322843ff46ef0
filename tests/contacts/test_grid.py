"""Loops over the contacts of a grid against the same contacts spelled out, and Green's function
against the inverse of a matrix.
"""

from __future__ import annotations

import numpy as np
import pytest

from granphon.balls.lattices import find_lattice
from granphon.contacts import grid_loops
from granphon.contacts.grid import Grid
from granphon.contacts.grid_product import (
    GridProduct,
    find_residual,
    relax_balls,
    relax_balls_after,
)
from granphon.statics.green import GreenFunction

#: shapes that wrap once, that touch themselves, and that are one cell wide
SHAPES = [
    ("chain", (1,)),
    ("chain", (2,)),
    ("chain", (7,)),
    ("triangular", (1, 1)),
    ("triangular", (1, 6)),
    ("triangular", (2, 2)),
    ("triangular", (5, 4)),
    ("honeycomb", (3, 4)),
    ("fcc", (1, 2, 3)),
    ("fcc", (3, 2, 4)),
    ("hcp", (2, 3, 2)),
    ("diamond", (2, 2, 3)),
]
every_shape = pytest.mark.parametrize(("name", "shape"), SHAPES)


def make_grid(name, shape):
    lattice = find_lattice(name)
    return Grid.of(lattice.contacts, shape, lattice.n_balls)


def compatibility(grid):
    """C (n_c, f cells): losses of overlap by displacements, contact by contact."""
    d = len(grid.shape)
    cells = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), -1).reshape(-1, d)
    fields = d * grid.n_balls
    matrix = np.zeros((grid.n_kinds, len(cells), fields, len(cells)))
    for kind in range(grid.n_kinds):
        for start, cell in enumerate(cells):
            end = np.ravel_multi_index(tuple((cell + grid.shift[kind]) % grid.shape), grid.shape)
            for axis in range(d):
                component = grid.vector[kind, axis] / np.linalg.norm(grid.vector[kind])
                matrix[kind, start, d * grid.i[kind] + axis, start] -= component
                matrix[kind, start, d * grid.j[kind] + axis, end] += component
    return matrix.reshape(grid.n_kinds * len(cells), fields * len(cells))


@every_shape
def test_runs_name_every_contact_once(name, shape):
    grid = make_grid(name, shape)
    table = grid.runs.table
    i, j = grid.ends
    seen = []
    for kind, start, end, count in table.tolist():
        for step in range(count):
            contact = kind * grid.n_cells + start + step
            assert i[contact] == grid.i[kind] * grid.n_cells + start + step
            assert j[contact] == grid.j[kind] * grid.n_cells + end + step
            seen.append(contact)
    assert sorted(seen) == list(range(grid.n_kinds * grid.n_cells))


@every_shape
@pytest.mark.parametrize("precision", [np.float64, np.float32])
def test_loops_are_products_with_a_matrix(name, shape, precision):
    grid = make_grid(name, shape)
    c = compatibility(grid)
    rng = np.random.default_rng(1)
    runs = grid.runs if precision is np.float64 else grid.runs.round()
    size = (grid.n_balls * len(shape), grid.n_cells)
    motions = rng.normal(size=size).astype(precision)
    stiffness = rng.uniform(0.5, 2.0, (grid.n_kinds, grid.n_cells)).astype(precision)
    digits = {"rtol": 0.0, "atol": 60.0 * float(np.finfo(precision).eps)}
    loss = np.full(stiffness.shape, np.nan, precision)
    grid_loops.measure_losses(runs, motions, loss)
    np.testing.assert_allclose(loss.ravel(), c @ motions.ravel(), **digits)
    force = np.zeros_like(motions)
    grid_loops.add_forces(runs, stiffness, force)
    np.testing.assert_allclose(force.ravel(), c.T @ stiffness.ravel(), **digits)
    strained = rng.normal(size=grid.n_kinds).astype(precision)
    tensions = np.zeros_like(strained)
    force[:] = 0.0
    grid_loops.resist(runs, stiffness, motions, strained, force, tensions)
    elongation = c @ motions.ravel() + np.repeat(strained, grid.n_cells)
    tension = stiffness.ravel() * elongation
    np.testing.assert_allclose(force.ravel(), c.T @ tension, **digits)
    sums = tension.reshape(grid.n_kinds, -1).sum(axis=1)
    np.testing.assert_allclose(tensions, sums, rtol=0.0, atol=10.0 * digits["atol"])


@every_shape
def test_each_ball_alone_moves_by_its_block(name, shape):
    grid = make_grid(name, shape)
    d = len(shape)
    rng = np.random.default_rng(2)
    stiffness = rng.uniform(0.5, 2.0, (grid.n_kinds, grid.n_cells))
    balls = grid.n_balls * grid.n_cells
    blocks = np.zeros((d, d, balls))
    grid_loops.add_blocks(grid.runs, stiffness, blocks)
    i, j = grid.ends
    normal = np.repeat(grid.normal[:, :d], grid.n_cells, axis=0)
    expected = np.zeros((balls, d, d))
    for k, n, one, another in zip(stiffness.ravel(), normal, i, j, strict=True):
        if one != another:
            expected[one] += k * np.outer(n, n)
            expected[another] += k * np.outer(n, n)
    lower = np.tril_indices(d)
    np.testing.assert_allclose(blocks[lower].T, expected[:, lower[0], lower[1]], atol=1e-14)
    inverses = np.empty_like(blocks)
    grid_loops.invert_blocks(blocks, 0.1, 0.8, inverses)
    wanted = 0.8 * np.linalg.inv(expected + 0.1 * np.eye(d))
    np.testing.assert_allclose(np.moveaxis(inverses, -1, 0), wanted, rtol=1e-10, atol=1e-12)
    forces = rng.normal(size=(grid.n_balls * d, grid.n_cells))
    motions = np.empty_like(forces)
    residual = np.empty_like(forces)
    grid_loops.relax_balls(grid.runs, stiffness, inverses, forces, motions, residual)
    by_ball = forces.reshape(grid.n_balls, d, -1).swapaxes(1, 2).reshape(balls, d)
    moved = np.einsum("bij,bj->bi", wanted, by_ball).reshape(grid.n_balls, -1, d).swapaxes(1, 2)
    np.testing.assert_allclose(motions, moved.reshape(motions.shape), rtol=1e-9, atol=1e-11)

    # all contacts against motions, as they are moved one after the other
    def resist(moves):
        against = np.zeros_like(moves)
        none = np.zeros(0)
        grid_loops.resist(grid.runs, stiffness, moves, none, against, none)
        return against

    digits = {"rtol": 0.0, "atol": 1e-10}
    np.testing.assert_allclose(residual, forces - resist(motions), **digits)
    change = rng.normal(size=forces.shape)
    after = motions + change
    grid_loops.relax_balls_after(grid.runs, stiffness, inverses, forces, after, residual)
    np.testing.assert_allclose(residual, forces - resist(motions + change), **digits)
    alone = np.empty_like(forces)
    grid_loops.relax_balls(grid.runs, stiffness, inverses, residual, alone, np.empty_like(forces))
    np.testing.assert_allclose(after, motions + change + alone, **digits)


@every_shape
@pytest.mark.parametrize("precision", [np.float64, np.float32])
@pytest.mark.parametrize("is_symmetric", [True, False])
def test_blocks_of_contacts_are_multiplied_as_each_contact_alone(
    name, shape, precision, is_symmetric
):
    grid = make_grid(name, shape)
    i, j = grid.ends
    m = 2
    n_balls = grid.n_balls * grid.n_cells
    rng = np.random.default_rng(4)
    diagonal = rng.normal(size=(m, m, n_balls)).astype(precision)
    forward, backward = rng.normal(size=(2, m, m, len(i))).astype(precision)
    if is_symmetric:
        backward = forward
    product = GridProduct.of(i, j, shape).fill(diagonal, forward, backward)
    assert (product.backward is product.forward) == is_symmetric
    motions, forces = rng.normal(size=(2, m * grid.n_balls, 3, grid.n_cells)).astype(precision)
    # (n, m, 3) motions of balls, and forces against them, contact by contact
    by_ball = motions.reshape(grid.n_balls, m, 3, -1).transpose(0, 3, 1, 2).reshape(n_balls, m, 3)
    against = np.einsum("abn,nbk->nak", diagonal, by_ball)
    for contact, (ball_i, ball_j) in enumerate(zip(i, j, strict=True)):
        against[ball_i] += forward[..., contact] @ by_ball[ball_j]
        against[ball_j] += backward[..., contact].T @ by_ball[ball_i]
    expected = against.reshape(grid.n_balls, -1, m, 3).transpose(0, 2, 3, 1).reshape(motions.shape)
    left = np.full_like(motions, np.nan)
    find_residual(product, forces, motions, left)
    digits = {"rtol": 0.0, "atol": 100.0 * float(np.finfo(precision).eps)}
    np.testing.assert_allclose(left, forces - expected, **digits)
    inverses = rng.normal(size=diagonal.shape).astype(precision)
    alone = np.full_like(motions, np.nan)
    relax_balls(product, inverses, forces, alone, left)
    by_ball = forces.reshape(grid.n_balls, m, 3, -1).transpose(0, 3, 1, 2).reshape(n_balls, m, 3)
    moved = np.einsum("abn,nbk->nak", inverses, by_ball)
    moved = moved.reshape(grid.n_balls, -1, m, 3).transpose(0, 2, 3, 1).reshape(motions.shape)
    np.testing.assert_allclose(alone, moved, **digits)
    expected = np.full_like(motions, np.nan)
    find_residual(product, forces, alone, expected)
    np.testing.assert_array_equal(left, expected)
    after = alone + motions
    relax_balls_after(product, inverses, forces, after, left)
    find_residual(product, forces, alone + motions, expected)
    np.testing.assert_allclose(left, expected, **digits)
    last = np.full_like(motions, np.nan)
    relax_balls(product, inverses, left, last, expected)
    np.testing.assert_allclose(after, alone + motions + last, **digits)
    chosen = rng.permutation(len(i))[:5]
    for found, blocks in zip(product.list_blocks(chosen), (forward, backward), strict=True):
        np.testing.assert_array_equal(found, blocks[..., chosen])


@pytest.mark.parametrize("count", [0, 1, 15, 16, 17, 100])
def test_sums_of_products(count):
    first, second = np.random.default_rng(3).normal(size=(2, count))
    assert grid_loops.find_scalar_product(first, second) == pytest.approx(
        float(first @ second), abs=1e-13
    )


@every_shape
def test_greens_function_is_the_inverse_of_equal_contacts(name, shape):
    # square and other lattices that do not stand have waves that deform no contact
    grid = make_grid(name, shape)
    c = compatibility(grid)
    inverse = np.linalg.pinv(c.T @ c, rcond=1e-10, hermitian=True)
    forces = np.random.default_rng(4).normal(size=(grid.n_balls * len(shape), grid.n_cells))
    motions = GreenFunction(grid, 1).apply(forces, 3.0)
    expected = 3.0 * (inverse @ forces.ravel()).reshape(forces.shape)
    np.testing.assert_allclose(motions, expected, rtol=0.0, atol=1e-5 * np.max(np.abs(expected)))
