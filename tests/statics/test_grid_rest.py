"""A grid at rest against the same contacts as a list, which other equations bring to rest."""

from __future__ import annotations

import numpy as np
import pytest

from granphon.balls.hertz import HertzLaw
from granphon.balls.lattices import find_lattice
from granphon.base.errors import InputError
from granphon.contacts.assembly import Assembly, GridAssembly
from granphon.contacts.grid import Grid
from granphon.statics.configuration import AppliedLoad
from granphon.statics.find_rest import find_rest

#: N/m^(3/2), of a law, and spread of overlaps, m
STIFF = 7e9
SPREAD = 2e-6
SHAPES = [("chain", (9,)), ("triangular", (6, 5)), ("fcc", (3, 4, 3)), ("hcp", (3, 2, 3))]


def make(name, shape, seed=0):
    """The assembly of 8 mm balls on a grid, and as a list."""
    lattice = find_lattice(name)
    p = lattice.periods
    grid = Grid.of(lattice.contacts, shape, lattice.n_balls).scale(8e-3)
    rng = np.random.default_rng(seed)
    deviations = rng.uniform(-SPREAD, SPREAD, lattice.n_balls * grid.n_cells)
    deviations -= np.mean(deviations)
    i, j = grid.ends
    offset = 0.5 * (deviations[i] + deviations[j])
    cell = 8e-3 * lattice.vectors[:, :p] * np.array(shape)[:, None]
    on_grid = GridAssembly(grid, offset, HertzLaw(STIFF), cell)
    listed = Assembly(
        n_balls=on_grid.n_balls,
        i=i,
        j=j,
        vector=on_grid.vector,
        is_flat=on_grid.is_flat,
        offset=offset,
        laws=on_grid.laws,
        cell=cell,
        dimension=p,
        directions=np.zeros((0, p)),
        wall_balls=np.zeros(0),
    )
    return on_grid, listed


def apply(assembly, stress=None, strain=0.0, mean_force=None):
    p = assembly.periods
    nothing = np.zeros(assembly.n_balls * p)
    tensor = None if stress is None else stress * np.eye(p)
    return AppliedLoad(
        nothing, "the load", tensor, strain * np.eye(p), nothing, mean_force=mean_force
    )


def press(assembly, overlap):
    """The stress of equal contacts with an overlap, m."""
    force = STIFF * overlap**1.5
    virial = assembly.n_contacts * assembly.mean_distance * force
    return -virial / (assembly.periods * assembly.measure)


@pytest.mark.parametrize(("name", "shape"), SHAPES)
@pytest.mark.parametrize("boundary", ["isotropic", "stress"])
@pytest.mark.parametrize("overlap", [3e-6, 3e-7])
def test_a_grid_is_at_rest_where_the_list_is(name, shape, boundary, overlap):
    on_grid, listed = make(name, shape)
    load = apply(on_grid, stress=press(on_grid, overlap))
    here = find_rest(on_grid, load, "lattice", boundary)
    there = find_rest(listed, load, "lattice", boundary)
    law = HertzLaw(STIFF)
    forces = law.force(there.overlap)
    apart = np.max(np.abs(law.force(here.overlap) - forces))
    assert apart <= 1e-9 * np.mean(forces)
    np.testing.assert_allclose(here.strain, there.strain, rtol=0.0, atol=1e-9 * overlap / 8e-3)
    assert here.residual <= 1e-10


@pytest.mark.parametrize(("name", "shape"), SHAPES[1:3])
def test_strain_and_mean_force_given_are_one(name, shape):
    on_grid, _ = make(name, shape, seed=3)
    force = STIFF * 1e-6**1.5
    by_force = find_rest(on_grid, apply(on_grid, mean_force=force), "lattice", "isotropic")
    forces = HertzLaw(STIFF).force(by_force.overlap)
    assert np.mean(forces) == pytest.approx(force, rel=1e-10)
    strain = apply(on_grid, strain=by_force.strain[0, 0])
    again = find_rest(on_grid, strain, "lattice", "isotropic")
    apart = np.max(np.abs(HertzLaw(STIFF).force(again.overlap) - forces))
    assert apart <= 1e-9 * force
    # from the state itself no step is left
    kept = find_rest(on_grid, strain, "lattice", "isotropic", again)
    assert kept.steps <= 1


def test_balls_that_do_not_touch_carry_nothing():
    on_grid, _ = make("triangular", (5, 5))
    with pytest.raises(InputError, match="open"):
        find_rest(on_grid, apply(on_grid, strain=1e-3), "lattice", "isotropic")
