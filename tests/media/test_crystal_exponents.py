"""The local exponent of simulated arrays and its standard error, on a line, in the plane and in
space.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.array.sample import STEP

WIDTH = 2.04e-6
SHAPES = {"fcc": (4, 4, 4), "hcp": (3, 4, 2), "triangular": (6, 6)}
SMALL = {"fcc": (2, 2, 2), "triangular": (4, 4)}
LARGE = [
    (lattice, shape, kind, friction)
    for (lattice, shape), kind, friction in itertools.product(
        SHAPES.items(), ["force", "pressure", "overlap"], [False, True]
    )
]


def balls(steel, lattice, friction=False):
    return gp.Packing(steel, 8e-3, gp.Uniform(WIDTH), lattice, friction=friction)


def longitudinal(simulation, kind, load):
    """The mean of c_11 over all directions for each sample at a load; with its force and stiffness;
    (n_samples, 3).
    """
    state = getattr(simulation, f"at_{kind}")(load)
    c = np.array([sample.elastic_tensor for sample in state.samples])
    p = {3: 2, 6: 3}[c.shape[1]]
    along, across, shear = (
        np.mean([c[:, a, b] for a, b in pairs], axis=0)
        for pairs in (
            [(a, a) for a in range(p)],
            itertools.combinations(range(p), 2),
            [(a, a) for a in range(p, c.shape[1])],
        )
    )
    # the means of cos^4 and cos^2 sin^2 of an angle to an axis, over the plane and over space
    modulus = (
        along * 0.75 + across * 0.25 + shear * 0.5
        if p == 2
        else 0.6 * along + 0.4 * across + 0.8 * shear
    )
    return np.stack(
        [modulus, [s.force for s in state.samples], [s.normal_stiffness for s in state.samples]],
        axis=-1,
    )


@pytest.mark.parametrize(
    ("lattice", "shape", "kind", "friction"),
    [
        ("fcc", SMALL["fcc"], "force", False),
        ("triangular", SMALL["triangular"], "force", True),
        ("triangular", SMALL["triangular"], "overlap", True),
        *(pytest.param(*case, marks=pytest.mark.exhaustive) for case in LARGE),
    ],
)
def test_exponent_and_error_are_those_of_samples_left_out_one_by_one(
    steel, lattice, shape, kind, friction
):
    packing = balls(steel, lattice, friction)
    simulation = gp.DirectSimulation(packing, shape, seed=3, samples=3)
    force = 0.3 * packing.width_units.force
    pressure = 3.0**0.5 * force / 8e-3 if lattice == "triangular" else 8.0**0.5 * force / 8e-3**2
    load = {"force": force, "pressure": pressure, "overlap": 0.43 * WIDTH}[kind]
    state = getattr(simulation, f"at_{kind}")(load)
    here = longitudinal(simulation, kind, load)
    beside = []
    for index, (_, own, _) in enumerate(here):
        alone = gp.DirectSimulation(packing, shape, seed=3 + index)
        low, high = (
            longitudinal(alone, "force", own * math.exp(step))[0, 0] for step in (-STEP, STEP)
        )
        beside.append(math.log(high / low) / (2.0 * STEP))

    def exponent(kept):
        modulus, force, stiffness = here[kept].T
        rise = modulus * np.array(beside)[kept]
        if kind != "overlap":
            return 0.5 * np.mean(rise) / np.mean(modulus)
        return (
            0.5
            * np.mean(force)
            * np.mean(rise * stiffness / force)
            / (np.mean(stiffness) * np.mean(modulus))
        )

    without = [exponent([j for j in range(3) if j != i]) for i in range(3)]
    assert_allclose(state.exponent, exponent([0, 1, 2]), rtol=1e-6)
    assert_allclose(
        state.exponent_error,
        math.sqrt(2.0 / 3.0 * np.sum((without - np.mean(without)) ** 2)),
        rtol=1e-4,
    )
    assert gp.local_exponent(state) == state.exponent
    alone = gp.DirectSimulation(packing, shape, seed=3).at_force(force)
    assert math.isnan(alone.exponent_error)


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("kind", ["force", "overlap"])
def test_on_a_line_the_exponent_is_that_of_equal_balls_and_has_no_error(steel, samples, kind):
    packing = balls(steel, "chain")
    load = {"force": packing.width_units.force, "overlap": WIDTH}[kind]
    state = getattr(gp.DirectSimulation(packing, (32,), samples=samples), f"at_{kind}")(
        np.array([load, 2.0 * load])
    )
    assert_allclose(state.exponent, 1.0 / 6.0, rtol=1e-14)
    assert np.all(state.exponent_error == 0.0)


@pytest.mark.exhaustive
@pytest.mark.parametrize("place", [0.05, 0.3])
def test_deviations_over_errors_in_space_are_those_of_a_sample_mean(steel, place):
    """60 simulations of five samples against all 300: their variance is that of Student's t."""
    packing = balls(steel, "fcc")
    force = place * packing.width_units.force
    states = [
        gp.DirectSimulation(packing, (4, 4, 4), 5 * index, 5).at_force(force) for index in range(60)
    ]
    found = np.array([(state.exponent, state.exponent_error) for state in states])
    pulls = (found[:, 0] - np.mean(found[:, 0])) / found[:, 1]
    # of four degrees of freedom the variance is two, and its scatter is wide: half of the values
    # are within 0.74
    assert 0.55 < np.median(np.abs(pulls)) < 0.98
    assert np.mean(np.abs(pulls) > 2.78) < 0.15
