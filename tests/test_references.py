"""The references against closed forms, against each other's ways, and against what they are to
judge.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import granphon as gp
from granphon.balls.hertz import FORCE
from granphon.balls.lattices import SQUARE, TRIANGULAR
from granphon.base.errors import PrecisionError
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.local_field import local_field
from granphon.laws.effective import effective_curve
from tests.laws.test_effective import FLAT, LOTS, NORMAL, UNIFORM, XI, evaluated
from tests.references import count_modes, integrate_curve, integrate_local_field

ROOT3 = math.sqrt(3.0)
#: Xi in closed form: derived, and found by an integer relation
CLOSED = {
    0.0: (2.0 * math.pi + 3.0 * ROOT3) / (4.0 * math.pi - 3.0 * ROOT3),
    1.0: 1.0 / (5.0 / 6.0 - ROOT3 / math.pi) - 1.0,
}

# -- the local field -------------------------------------------------------------------------------


@pytest.mark.parametrize("eta", CLOSED)
def test_cubature_gives_the_closed_forms(eta):
    xi, error = integrate_local_field(eta)
    assert xi == pytest.approx(CLOSED[eta], rel=1e-14)
    assert 0.0 < error < 1e-13 * xi


@pytest.mark.claim("tradeoff-references", "api-local-field")
@pytest.mark.parametrize("eta", [0.0, 1e-9, 0.05, 0.84, 4.0 / 3.0, 1e3])
def test_cubature_and_projection_agree(eta):
    xi, error = integrate_local_field(eta)
    expected = local_field(mindlin_ratio=eta).xi
    assert xi == pytest.approx(expected, rel=1e-13)
    assert error < 1e-13 * xi * (1.0 + xi)


# -- the effective medium --------------------------------------------------------------------------

FORCES = np.geomspace(1e-4, 100.0, 13)
SHAPES = {
    "uniform": UNIFORM,
    "normal": NORMAL,
    **{name: LOTS[name] for name in ("three", "0.5 large", "ten")},
}


@pytest.mark.claim("tradeoff-references")
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.exhaustive] * (name in ("uniform", "normal", "ten")))
        for name in SHAPES
    ],
)
def test_integration_and_collocation_agree(name):
    xi = XI[0.84]
    order = np.random.default_rng(0).permutation(len(FORCES))
    y, k = integrate_curve(SHAPES[name], xi, FORCES[order])
    force, stiffness = evaluated(effective_curve(SHAPES[name], xi), y)
    np.testing.assert_allclose(force, FORCES[order], rtol=1e-11)
    np.testing.assert_allclose(stiffness, k, rtol=1e-11)


@pytest.mark.parametrize(
    ("shape", "forces", "ways"),
    [
        (LOTS["0.5 large"], (1.0, 10.0), [("LSODA", 1e-8, 1e-6)]),
        pytest.param(
            UNIFORM,
            np.geomspace(0.05, 10.0, 5),
            [("Radau", 1e-6, 1e-6), ("LSODA", 1e-8, 1e-6), ("LSODA", 1e-11, 2e-10)],
            marks=pytest.mark.slow,
        ),
    ],
    ids=["two kinds", "uniform"],
)
def test_integration_gains_with_its_tolerance(shape, forces, ways):
    best = integrate_curve(shape, XI[0.0], forces)
    for method, tolerance, bound in ways:
        y, k = integrate_curve(shape, XI[0.0], forces, tolerance, method)
        assert 1e-13 < np.max(np.abs(k / best[1] - 1.0)) < bound
        np.testing.assert_allclose(y, best[0], rtol=0.0, atol=bound)


def test_integration_starts_high_enough():
    # equation (36) has the series as its one smooth solution: a higher start leads to the same
    # curve
    y, k = integrate_curve(LOTS["three"], XI[0.0], [1.0, 1e5])
    low = integrate_curve(LOTS["three"], XI[0.0], [1.0])
    np.testing.assert_allclose([y[0], k[0]], np.ravel(low), rtol=1e-12)
    assert (y[1], k[1]) == pytest.approx((1e5 ** (2.0 / 3.0), 1.5 * 1e5 ** (1.0 / 3.0)), rel=1e-4)


def test_integration_says_where_a_curve_ends():
    curve = effective_curve(FLAT, XI[0.0])
    y, _ = integrate_curve(FLAT, XI[0.0], [1.1 * curve.least_force], 1e-9)
    assert float(curve.value(y, FORCE)[0]) == pytest.approx(1.1 * curve.least_force, rel=1e-7)


def test_integration_beyond_the_end_of_a_curve_is_refused():
    curve = effective_curve(FLAT, XI[0.0])
    with pytest.raises(PrecisionError, match="down"):
        integrate_curve(FLAT, XI[0.0], [0.5 * curve.least_force], 1e-9)


# -- density of states -----------------------------------------------------------------------------


def test_balls_on_square_rows_are_chains():
    # without friction D = diag(4 sin^2(q_1/2), 4 sin^2(q_2/2)): steps in one direction, square
    # roots in the other
    lattice = ContactLattice(SQUARE.vectors, SQUARE.positions, SQUARE.contacts, 0.0)
    edges = np.array([-1.0, 0.0, 1e-3, 0.3, 1.0, 1.7, 1.999, 2.1])
    expected = 4.0 / np.pi * np.arcsin(np.clip(edges, 0.0, 2.0) / 2.0)
    np.testing.assert_allclose(count_modes(lattice, edges, 64), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("eta", [0.0, 0.84])
def test_long_waves_are_those_of_debye(eta):
    lattice = ContactLattice.of(TRIANGULAR, eta)
    velocities, _ = lattice.sound_velocities((1.0, 0.0))
    edges = np.array([0.02, 0.04])
    found = count_modes(lattice, edges) / (
        lattice.measure / (4.0 * np.pi) * np.sum(velocities**-2.0) * edges**2
    )
    # what is left is dispersion, in even powers
    np.testing.assert_allclose(found, 1.0, atol=1e-3)
    assert (found[1] - 1.0) / (found[0] - 1.0) == pytest.approx(4.0, rel=0.01)


@pytest.mark.slow
@pytest.mark.claim("tradeoff-references")
@pytest.mark.parametrize(
    ("friction", "finite_overlap", "sizes"),
    [
        (False, True, (16, 64)),
        pytest.param(False, True, (32, 128), marks=pytest.mark.slow),
        pytest.param(True, False, (32, 128), marks=pytest.mark.slow),
    ],
    ids=["smooth", "smooth, fine", "rough, fine"],
)
def test_against_tetrahedra(steel, friction, finite_overlap, sizes):
    medium = gp.AveragedLattice(gp.Packing(steel, 8e-3, friction=friction))
    state = medium.at_force(5e3 if finite_overlap else 18.446, finite_overlap=finite_overlap)
    phonons = gp.Phonons(state)
    lattice = state.contact_lattice()
    errors = []
    for size in sizes:
        dos = phonons.dos(mesh=(size, size), points=101)
        at = dos.frequencies
        edges = np.concatenate([at[:1], 0.5 * (at[1:] + at[:-1]), at[-1:]])
        cumulated = np.concatenate([[0.0], np.cumsum(dos.total * np.diff(edges))])
        exact = count_modes(lattice, edges / phonons.scales.frequency, sizes[1])
        errors.append(float(np.mean(np.abs(cumulated - exact))))
    # linear interpolation has order two: 2e-5 for 256 points along a side
    assert errors[1] < 2e-5 * (256 / sizes[1]) ** 2
    assert np.log2(errors[0] / errors[1]) / 2.0 == pytest.approx(2.0, abs=0.25)
