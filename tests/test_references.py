"""The references against closed forms, against each other's ways, and against what they are to judge."""

from __future__ import annotations

import math

import numpy as np
import pytest

import granphon as gp
from granphon.balls.lattices import SQUARE, TRIANGULAR, Lattice
from granphon.base.errors import PrecisionError
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.local_field import _average_response, _divide_by_symmetry, local_field
from granphon.dynamics.zone_quadrature import grid_zone
from granphon.laws.effective import effective_curve
from granphon.laws.spread import FORCE
from tests.laws.test_effective import FLAT, LOTS, NORMAL, UNIFORM, XI, evaluated
from tests.references import count_modes, integrate_curve, integrate_local_field

ROOT3 = math.sqrt(3.0)
#: Xi in closed form: derived, and found by an integer relation
CLOSED = {
    0.0: (2.0 * math.pi + 3.0 * ROOT3) / (4.0 * math.pi - 3.0 * ROOT3),
    1.0: 1.0 / (5.0 / 6.0 - ROOT3 / math.pi) - 1.0,
}

# -- the local field ----------------------------------------------------------------------------------------------------


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


def local_field_on(points, eta, graded):
    """Xi of the triangular lattice from one fixed quadrature: graded triangles, or a uniform grid half a step off Gamma."""
    medium = ContactLattice.of(TRIANGULAR, eta)
    grid, counts = grid_zone(medium.reciprocal, points)
    zone = _divide_by_symmetry(medium, points) if graded else iter([(grid, counts / points**2)])
    return float(1.0 / _average_response(medium, zone)[0] - 1.0)


@pytest.mark.parametrize("eta", [0.0, 0.84, 1.0])
def test_graded_grids_converge_geometrically(eta):
    exact, orders = integrate_local_field(eta)[0], [4, 5, 6, 7, 8, 9]
    errors = [abs(local_field_on(n, eta, True) / exact - 1.0) for n in orders]
    assert np.exp(np.polyfit(orders, np.log(errors), 1)[0]) < 0.2
    assert local_field_on(16, eta, True) == pytest.approx(exact, rel=1e-13)


@pytest.mark.parametrize(("eta", "order"), [(0.0, 4.0), (0.84, 4.0), (1.0, 6.0)])
def test_uniform_grids_converge_algebraically(eta, order):
    exact = integrate_local_field(eta)[0]
    for sizes in ([16, 32, 64], [15, 31, 63]):
        errors = [abs(local_field_on(n, eta, False) / exact - 1.0) for n in sizes]
        slopes = -np.diff(np.log(errors)) / np.diff(np.log(sizes))
        np.testing.assert_allclose(slopes, order, atol=0.15)


def test_uniform_grid_is_the_mean_over_all_its_points():
    # half of them are enough, q and -q being one; by the definition, with a dense inverse at every one
    eta, corona = 0.84, np.array([[np.cos(a), np.sin(a)] for a in np.pi / 3.0 * np.arange(6)])
    medium = ContactLattice.of(TRIANGULAR, eta)
    for n in (2, 4, 5):
        ticks = (np.arange(n) + 0.5) / n
        q = medium.wavevectors(np.stack(np.meshgrid(ticks, ticks), -1).reshape(-1, 2))
        force = np.zeros((len(q), 3), complex)
        force[:, :2] = np.exp(-1j * q @ corona.T) @ corona
        motion = np.linalg.solve(medium.dynamical_matrix(q), force[..., None])[..., 0]
        compliance = float(np.mean(np.sum(force.conj() * motion, axis=1)).real) / 6.0
        assert local_field_on(n, eta, False) == pytest.approx(1.0 / compliance - 1.0, rel=1e-12)


# -- the effective medium -----------------------------------------------------------------------------------------------

FORCES = np.geomspace(1e-4, 100.0, 13)
SHAPES = {"uniform": UNIFORM, "normal": NORMAL, **{name: LOTS[name] for name in ("three", "0.5 large", "ten")}}


@pytest.mark.claim("tradeoff-references")
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.exhaustive] * (name in ("normal", "ten"))) for name in SHAPES]
)
def test_integration_and_collocation_agree(name):
    xi, order = XI[0.84], np.random.default_rng(0).permutation(len(FORCES))
    y, k = integrate_curve(SHAPES[name], xi, FORCES[order])
    force, stiffness = evaluated(effective_curve(SHAPES[name], xi), y)
    np.testing.assert_allclose(force, FORCES[order], rtol=1e-11)
    np.testing.assert_allclose(stiffness, k, rtol=1e-11)


def test_integration_gains_with_its_tolerance():
    forces = np.geomspace(0.05, 10.0, 5)
    best = integrate_curve(UNIFORM, XI[0.0], forces)
    for method, tolerance, bound in (("Radau", 1e-6, 1e-6), ("LSODA", 1e-8, 1e-6), ("LSODA", 1e-11, 2e-10)):
        y, k = integrate_curve(UNIFORM, XI[0.0], forces, tolerance, method)
        assert 1e-13 < np.max(np.abs(k / best[1] - 1.0)) < bound
        np.testing.assert_allclose(y, best[0], rtol=0.0, atol=bound)


def test_integration_starts_high_enough():
    # equation (36) has the series as its one smooth solution: a higher start leads to the same curve
    y, k = integrate_curve(LOTS["three"], XI[0.0], [1.0, 1e5])
    low = integrate_curve(LOTS["three"], XI[0.0], [1.0])
    np.testing.assert_allclose([y[0], k[0]], np.ravel(low), rtol=1e-12)
    assert (y[1], k[1]) == pytest.approx((1e5 ** (2.0 / 3.0), 1.5 * 1e5 ** (1.0 / 3.0)), rel=1e-4)


def test_integration_says_where_a_curve_ends():
    curve = effective_curve(FLAT, XI[0.0])
    y, _ = integrate_curve(FLAT, XI[0.0], [1.1 * curve.least_force], 1e-9)
    assert float(curve.value(y, FORCE)[0]) == pytest.approx(1.1 * curve.least_force, rel=1e-7)
    with pytest.raises(PrecisionError, match="not followed down"):
        integrate_curve(FLAT, XI[0.0], [0.5 * curve.least_force], 1e-9)


# -- density of states --------------------------------------------------------------------------------------------------


def test_balls_on_square_rows_are_chains():
    # without friction D = diag(4 sin^2(q_1/2), 4 sin^2(q_2/2)): steps in one direction, square roots in the other
    lattice = ContactLattice(SQUARE.vectors, SQUARE.positions, SQUARE.contacts, 0.0)
    edges = np.array([-1.0, 0.0, 1e-3, 0.3, 1.0, 1.7, 1.999, 2.1])
    expected = 4.0 / np.pi * np.arcsin(np.clip(edges, 0.0, 2.0) / 2.0)
    np.testing.assert_allclose(count_modes(lattice, edges, 64), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("eta", [0.0, 0.84])
def test_long_waves_are_those_of_debye(eta):
    lattice = ContactLattice.of(TRIANGULAR, eta)
    velocities, _ = lattice.sound_velocities((1.0, 0.0))
    edges = np.array([0.02, 0.04])
    found = count_modes(lattice, edges) / (lattice.measure / (4.0 * np.pi) * np.sum(velocities**-2.0) * edges**2)
    # what is left is dispersion, in even powers
    np.testing.assert_allclose(found, 1.0, atol=1e-3)
    assert (found[1] - 1.0) / (found[0] - 1.0) == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize(
    ("name", "eta", "branches"), [("triangular", 0.0, 2), ("triangular", 0.84, 3), ("square", 0.84, 3), ("kagome", 0.84, 3)]
)
def test_totals_are_exact(name, eta, branches):
    lattice = ContactLattice.of(name, eta)
    found = count_modes(lattice, np.array([-1.0, 0.0, 1.0001, 3.0]) * lattice.top_frequency, 32)
    np.testing.assert_allclose(found, [0.0, 0.0, branches, branches], rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("eta", [0.0, 0.84])
def test_any_cell_of_the_lattice_gives_the_same(eta):
    # other lines of wave vectors, and other contours that they touch
    turned = np.array([[0.6, 0.8], [-0.8, 0.6]])
    cells = [
        Lattice("sixty", ((1.0, 0.0), (0.5, ROOT3 / 2.0))),
        Lattice("skewed", ((2.0, ROOT3), (3.5, 1.5 * ROOT3))),
        Lattice("turned", TRIANGULAR.vectors @ turned),
        Lattice("two balls", ((1.0, 0.0), (0.0, ROOT3)), ((0.0, 0.0), (0.5, 0.5))),
    ]
    plain = ContactLattice.of(TRIANGULAR, eta)
    edges = np.array([0.1, 0.35, 0.55, 0.8, 0.95]) * plain.top_frequency
    expected = count_modes(plain, edges)
    for cell in cells:
        np.testing.assert_allclose(count_modes(ContactLattice.of(cell, eta), edges), expected, rtol=0.0, atol=1e-6)


def test_convergence_in_points():
    lattice = ContactLattice.of(TRIANGULAR, 0.84)
    edges = np.random.default_rng(1).uniform(0.0, lattice.top_frequency, 24)
    exact = count_modes(lattice, edges, 1024)
    errors = np.array([np.abs(count_modes(lattice, edges, points) - exact) for points in (16, 64, 256)])
    # at most frequencies nothing is missed, and contours that nearly touch a line decide
    medians = np.median(errors, axis=1)
    assert np.all(np.log2(medians[:-1] / medians[1:]) / 2.0 > 1.0)
    assert medians[-1] < 1e-9
    for points, error in zip((16, 64, 256), errors, strict=True):
        assert np.max(error) < 5.0 / points**2


@pytest.mark.claim("tradeoff-references")
@pytest.mark.parametrize("friction", [False, True], ids=["smooth", "rough"])
@pytest.mark.parametrize("finite_overlap", [False, True])
def test_against_tetrahedra(steel, friction, finite_overlap):
    medium = gp.AveragedLattice(gp.Packing(steel, 8e-3, friction=friction))
    state = medium.at_force(5e3 if finite_overlap else 18.446, finite_overlap=finite_overlap)
    phonons, lattice = gp.Phonons(state), state.contact_lattice()
    errors = []
    for size in (32, 128):
        dos = phonons.dos(mesh=(size, size), points=101)
        at = dos.frequencies
        edges = np.concatenate([at[:1], 0.5 * (at[1:] + at[:-1]), at[-1:]])
        cumulated = np.concatenate([[0.0], np.cumsum(dos.total * np.diff(edges))])
        exact = count_modes(lattice, edges / phonons.scales.frequency, 128)
        errors.append(float(np.mean(np.abs(cumulated - exact))))
    # linear interpolation has order two: 2e-5 for 256 points along a side
    assert errors[1] < 8e-5
    assert np.log2(errors[0] / errors[1]) / 2.0 == pytest.approx(2.0, abs=0.25)
