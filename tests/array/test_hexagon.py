"""A hexagon of balls between six walls: against closed forms, and against a general minimiser of
the same energy.
"""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

import granphon as gp
from granphon.base.errors import ConvergenceError
from granphon.waves.operator import WaveOperator

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
SPREAD = gp.Uniform(2.04e-6)


def add_up(network, balls):
    """Return the static forces (n, 3) of the contacts on each body."""
    pull = np.zeros((balls, 3))
    np.add.at(pull, network.j, network.normal * network.normal_force[:, None])
    np.add.at(pull, network.i, -network.normal * network.normal_force[:, None])
    return pull


@pytest.mark.claim("hexagon-force")
@pytest.mark.parametrize("side_force", [990.0, 30.0, 0.1])
@pytest.mark.parametrize("spread", [None, SPREAD])
def test_balls_and_walls_are_in_balance(spread, side_force):
    pressed = gp.Hexagon(gp.Packing(STEEL, 8e-3, spread), 7, seed=2).at_side_force(side_force)
    count = 3 * 7 * 6 + 1
    assert len(pressed.sites) == count
    pull = add_up(pressed.network, count + 6)
    assert np.max(np.abs(pull[:count])) <= 1e-9 * pressed.force
    np.testing.assert_allclose(np.linalg.norm(pull[count:], axis=1), side_force, rtol=1e-10)
    # the work of the walls in a compression of all is the sum of forces times distances: exact,
    # with or without a spread
    assert pressed.force == pytest.approx(side_force / (math.sqrt(3.0) * (7 - 2 / 3)), rel=1e-10)
    assert pressed.force == pytest.approx(pressed.nominal_force * 7 / (7 - 2 / 3), rel=1e-10)


def test_equal_balls_far_from_walls_share_the_load_evenly():
    pressed = gp.Hexagon(gp.Packing(STEEL, 8e-3), 25).at_side_force(990.0)
    inner = np.linalg.norm(pressed.sites, axis=1)[pressed.i] < 5 * 8e-3
    np.testing.assert_allclose(pressed.forces[inner], pressed.force, rtol=3e-4)
    # the state scales with the load: overlaps as its power 2/3
    less = gp.Hexagon(gp.Packing(STEEL, 8e-3), 25).at_side_force(99.0)
    np.testing.assert_allclose(
        less.displacements, pressed.displacements * 0.1 ** (2 / 3), atol=1e-17
    )


@pytest.mark.parametrize("side", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_forces_are_those_of_a_general_minimiser(side):
    hexagon = gp.Hexagon(gp.Packing(STEEL, 8e-3, SPREAD), side, seed=4)
    pressed = hexagon.at_side_force(5.0)
    law = hexagon.packing.law
    count = 3 * side * (side - 1) + 1
    unit = law.overlap(pressed.nominal_force)
    x = pressed.deviations / unit
    ratio = pressed.wall_coefficient / law.coefficient
    assert ratio == pytest.approx(2 * math.sqrt(2))
    normals = np.array([[math.cos(a), math.sin(a)] for a in np.radians(range(30, 390, 60))])
    close = [
        (a, b)
        for a in range(count)
        for b in range(a)
        if np.linalg.norm(pressed.sites[a] - pressed.sites[b]) < 8.1e-3
    ]
    assert len(close) == len(pressed.forces)
    leaning = [
        (a, w)
        for a in range(count)
        for w in range(6)
        if pressed.sites[a] @ normals[w] > (side - 1) * 8e-3 * 0.86
    ]

    def energy(z):
        u = z[: 2 * count].reshape(-1, 2)
        y = z[2 * count :]
        total = side * math.sqrt(3.0) * np.sum(y)
        for a, b in close:
            n = (pressed.sites[b] - pressed.sites[a]) / 8e-3
            total += 0.4 * max(0.5 * (x[a] + x[b]) - n @ (u[b] - u[a]), 0.0) ** 2.5
        for a, w in leaning:
            total += 0.4 * ratio * max(0.5 * x[a] + normals[w] @ u[a] - y[w], 0.0) ** 2.5
        return total

    start = np.append(-pressed.sites.ravel() / 8e-3, np.full(6, -2.0))
    found = minimize(energy, start, method="BFGS", options={"gtol": 1e-6, "maxiter": 2000})
    own = np.append(pressed.displacements.ravel(), pressed.retreats) / unit
    assert energy(own) == pytest.approx(found.fun, rel=1e-9)
    assert energy(own) <= found.fun + 1e-9
    moved = found.x[: 2 * count].reshape(-1, 2)
    forces = [
        max(
            0.5 * (x[a] + x[b])
            - (pressed.sites[b] - pressed.sites[a]) @ (moved[b] - moved[a]) / 8e-3,
            0.0,
        )
        ** 1.5
        for a, b in zip(pressed.i.tolist(), pressed.j.tolist(), strict=True)
    ]
    np.testing.assert_allclose(pressed.forces / pressed.nominal_force, forces, atol=1e-5)


def test_network_of_the_hexagon_is_solid_and_its_walls_are_still():
    pressed = gp.Hexagon(gp.Packing(STEEL, 8e-3, SPREAD), 4, seed=1).at_side_force(990.0)
    operator = WaveOperator(pressed.network)
    assert operator.size == 3 * 37
    squares = np.linalg.eigvalsh(operator.matrix.toarray())
    assert squares[0] > 1e-4 * squares[-1]
    # stiffness of a contact: the derivative of its force
    network = pressed.network
    law = pressed.packing.law
    between = network.j < 37
    h = law.overlap(network.normal_force[between])
    np.testing.assert_allclose(network.normal_stiffness[between], law.stiffness(h), rtol=1e-12)
    at_wall = (network.normal_force[~between] / pressed.wall_coefficient) ** (2 / 3)
    np.testing.assert_allclose(
        network.normal_stiffness[~between],
        1.5 * pressed.wall_coefficient * at_wall**0.5,
        rtol=1e-12,
    )


def test_walls_of_the_same_material_are_softer():
    packing = gp.Packing(STEEL, 8e-3)
    rigid = gp.Hexagon(packing, 3)
    steel = gp.Hexagon(packing, 3, wall_material=STEEL)
    assert rigid.wall_coefficient == pytest.approx(2 * steel.wall_coefficient)
    assert steel.wall_coefficient == pytest.approx(
        gp.HertzLaw.between(STEEL, 8e-3, 1e12).coefficient, rel=1e-9
    )


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3, lattice="square"), 5), "triangular"),
        # three contacts in a cell, as the triangular lattice, of two balls
        (lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3, lattice="honeycomb"), 5), "triangular"),
        (lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3, motions="out_of_plane"), 5), "plane"),
        (lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3), 1), "2 or more"),
        (lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3), 2.5), "balls_per_side"),
        (lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3), 3, diameters=np.full(7, 8e-3)), "19"),
        (lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3), 2, diameters=np.full(7, 8.1e-3)), "mean"),
        (lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3), 2).at_side_force(-1.0), "side_force"),
        (lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3), 2).at_force(math.nan), "force"),
        (
            lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3), 3).at_force(1e7),
            r"1\.612 diameters",
        ),
        (
            lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3), 3).at_side_force(1e300),
            r"e\+195 dia",
        ),
        (
            lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3), 3).at_force(3.2e6),
            "wall by 1",
        ),
        (lambda: gp.Hexagon(STEEL), "^packing is Material"),
        (
            lambda: gp.Hexagon(gp.Packing(STEEL, 8e-3), 3, wall_material="steel"),
            "^wall_material is 'steel'",
        ),
    ],
)
def test_bad_input_is_one_clear_error(make, said):
    with pytest.raises(gp.GranphonError, match=said):
        make()


@pytest.mark.parametrize("wall", [None, gp.Material(5e9, 0.3, 1000.0)])
def test_a_contact_that_is_no_small_spot_is_a_warning(wall):
    hexagon = gp.Hexagon(gp.Packing(STEEL, 8e-3, SPREAD), 3, wall_material=wall)
    assert hexagon.at_side_force(2.0).warnings == ()
    pressed = hexagon.at_side_force(2e4)
    # (3 f R / 4 E*)^(1/3) over d/2, with the radius R = d/4 of two balls, d/2 of a ball and a wall
    soft = 0.0 if wall is None else 1.0 / wall.contact_modulus
    between = np.cbrt(0.75 * np.max(pressed.forces) * 2e-3 / STEEL.contact_modulus) / 4e-3
    leant = (
        np.cbrt(
            0.75 * np.max(pressed.wall_forces) * 4e-3 * 0.5 * (1.0 / STEEL.contact_modulus + soft)
        )
        / 4e-3
    )
    assert pressed.contact_radius == pytest.approx(max(between, leant), rel=1e-6)
    assert f"contact is {100 * pressed.contact_radius:.4g} %" in pressed.warnings[0]


def test_a_hexagon_that_does_not_come_to_rest_says_what_helps():
    """Overlaps of 1e-16 m beside differences of 1e-6 m: hardly a ball is held."""
    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, spread=gp.Uniform(2e-6))
    with pytest.raises(ConvergenceError, match="Raise the side force"):
        gp.Hexagon(packing, 3).at_side_force(1e-12)
