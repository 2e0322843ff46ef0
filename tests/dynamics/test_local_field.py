"""The local-field factor: closed form, three independent routes, the order of each, and what the
paper prints.
"""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import splu

from granphon.balls.lattices import KAGOME, SQUARE, TRIANGULAR, Lattice, find_lattice
from granphon.base.errors import InputError, MechanismError
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.local_field import (
    LocalField,
    _find_operations,
    _Response,
    compute_xi,
    local_field,
    paper_local_field,
)
from granphon.dynamics.zone_means import divide_zone
from tests.dynamics.test_local_field_space import Supercell

ROOT3 = np.sqrt(3.0)
DIVISOR = 4.0 * np.pi - 3.0 * ROOT3
#: alpha, beta, Xi at eta = 0
CLOSED = (
    np.array(
        [(12.0 * np.pi - 19.5 * ROOT3), (18.0 - 8.0 * np.pi / ROOT3), (2.0 * np.pi + 3.0 * ROOT3)]
    )
    / DIVISOR
)
ETAS = (0.0, 0.84, 1.0, 4.0 / 3.0)


def triple(field: LocalField) -> np.ndarray:
    return np.array([field.alpha, field.beta, field.xi])


def unit(degrees: float) -> np.ndarray:
    return np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))])


def from_displacements(u: float, u_alpha: float, u_beta: float) -> np.ndarray:
    return np.array([u_alpha / u, u_beta / u, 1.0 / u - 1.0])


def extrapolated(sizes, values, order=2):
    """Limit of a series in 1/size^order, 1/size^(order + 2), ..., by as many terms as there are
    sizes.
    """
    exponents = np.array([0, *range(order, order + 2 * len(sizes) - 2, 2)])
    powers = (np.array(sizes, float)[:, None] / sizes[0]) ** -exponents
    return np.linalg.solve(powers, np.array(values))[0]


# -- the closed form -------------------------------------------------------------------------------


@pytest.mark.claim("local-field-values", "api-local-field")
def test_closed_form_without_friction():
    # Write c_p = cot(q.n_p / 2), n_1 + n_2 + n_3 = 0: c_1 c_2 + c_2 c_3 + c_3 c_1 = 1. The one
    # self-stress at q has
    # tensions 1/sin, so u_1 = 1 - (2/3) <S^2 / (S^2 + 1)> with S = c_1 + c_2 + c_3, and S turns out
    # to be distributed as
    # (6/pi) / (S^2 + 1) on S >= sqrt(3): u_1 = 2/3 - sqrt(3)/(2 pi).
    field = local_field("triangular", 0.0)
    np.testing.assert_allclose(triple(field), CLOSED, rtol=3e-13)
    assert field.compliance == pytest.approx(2.0 / 3.0 - ROOT3 / (2.0 * np.pi), rel=1e-13)


def test_closed_form_at_equal_stiffnesses():
    # found by an integer relation, not derived
    assert local_field("triangular", 1.0).compliance == pytest.approx(
        5.0 / 6.0 - ROOT3 / np.pi, rel=1e-13
    )


@pytest.mark.claim("local-field-values")
def test_reference_values():
    expected = {
        0.0: (0.532429433355, 0.473473782646, 1.557530242848),
        0.84: (0.498276954177, 0.546484295993, 2.390907564921),
        1.0: (0.496760828547, 0.552637186826, 2.546043485719),
        4.0 / 3.0: (0.494834197854, 0.562759641612, 2.867982795139),
    }
    for eta, values in expected.items():
        np.testing.assert_allclose(triple(local_field("triangular", eta)), values, rtol=2e-12)


# -- second route: the definition that opens the appendix, by D(q)^-1 on a mesh --------------------


def by_green_function(
    eta: float, size: int, bending: float = 0.0, turning: bool = True
) -> np.ndarray:
    """(alpha, beta, Xi) from the displacements under unit radial forces, half-shifted mesh of
    size^2 wave vectors.
    """
    medium = ContactLattice.of(TRIANGULAR, eta, bending=bending)
    ticks = (np.arange(size) + 0.5) / size
    q = medium.wavevectors(np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2))
    corona = np.array([unit(60.0 * i) for i in range(6)])
    force = np.zeros((len(q), medium.motions.count), complex)
    force[:, :2] = np.exp(-1j * q @ corona.T) @ corona
    free = slice(None) if turning else slice(0, 2)
    motion = np.linalg.solve(medium.dynamical_matrix(q)[:, free, free], force[:, free, None])[
        :, :2, 0
    ]

    def along(places):
        # the mean over the six, as in (A7): a shifted mesh lacks the symmetry of the lattice, and
        # one alone has order two
        return (np.exp(1j * q @ places.T) * (motion @ places.T)).mean().real / np.linalg.norm(
            places[0]
        )

    return from_displacements(
        along(corona), along(2.0 * corona), along(corona + np.roll(corona, -1, axis=0))
    )


@pytest.mark.parametrize("eta", [0.0, 4.0 / 3.0])
def test_green_function_on_a_mesh_has_its_order_and_extrapolates(eta):
    exact = triple(local_field("triangular", eta))
    sizes = [20, 24, 32, 48, 64, 96]
    values = [by_green_function(eta, size) for size in sizes]
    # on the half-shifted mesh the term in N^-2 vanishes: orders 4, 6, 8, ...; at eta = 1 that in
    # N^-4 vanishes too
    orders = np.log2((values[3] - exact) / (values[5] - exact))
    np.testing.assert_allclose(orders, 6.0 if eta == 1.0 else 4.0, atol=0.15)
    np.testing.assert_allclose(extrapolated(sizes, values, order=4), exact, rtol=1e-10)


def test_bending_hinders_the_balls_from_turning():
    sizes = [16, 24, 32, 48]
    field = local_field("triangular", 0.84, 0.3)
    values = [by_green_function(0.84, size, 0.3) for size in sizes]
    np.testing.assert_allclose(triple(field), extrapolated(sizes, values, order=4), rtol=1e-8)
    assert abs(field.xi - local_field("triangular", 0.84).xi) > 1e-6
    # the balls do not turn at all if bending is large; they do not without friction, whatever the
    # bending
    still = extrapolated(
        sizes, [by_green_function(0.84, size, turning=False) for size in sizes], order=4
    )
    np.testing.assert_allclose(triple(local_field("triangular", 0.84, 1e6)), still, rtol=1e-8)
    assert local_field("triangular", 0.0, 0.3).xi == local_field("triangular", 0.0).xi
    # the honeycomb, whose balls roll like gears, has a local field with bending only
    assert local_field("honeycomb", 0.84, 0.1).xi > 0.0
    with pytest.raises(MechanismError):
        local_field("honeycomb", 0.84)


# -- third route: a finite cluster in real space ---------------------------------------------------


def by_cluster(structure: Lattice, eta: float, size: int):
    """Displacement of every ball of size x size periodic cells under unit tension in the contacts
    of one that is held.
    """
    cell = Supercell(structure, size)
    middle = size // 2
    centre = structure.n_balls * (middle * size + middle)
    free = np.zeros((cell.balls, 6), bool)
    free[:, [0, 1, 5] if eta else [0, 1]] = True  # u_x, u_y and phi_z
    free[centre] = False
    free = free.ravel()
    rows = cell.elongations
    star = ((cell.i == centre) | (cell.j == centre)).astype(float)
    motion = np.zeros(free.size)
    load = rows.T @ star
    motion[free] = splu(cell.stiffness(eta)[:, free][free], permc_spec="MMD_AT_PLUS_A").solve(
        load[free]
    )
    return motion.reshape(-1, 6), float((rows @ motion) @ star / star.sum())


def triangular_cluster(eta: float, size: int) -> np.ndarray:
    motion, u = by_cluster(TRIANGULAR, eta, size)
    h = size // 2
    # in the 120-degree cell (2, 0) is on top of (1, 0), and (2, 1) is the bridge of (1, 0) and (1,
    # 1)
    top = motion[(h + 2) * size + h]
    bridge = motion[(h + 2) * size + h + 1]
    assert motion[(h + 1) * size + h, 0] == pytest.approx(u, rel=1e-9)
    return from_displacements(u, top[0], bridge[:2] @ unit(30.0))


@pytest.mark.claim("local-field-values")
@pytest.mark.parametrize("eta", [0.0, pytest.param(0.84, marks=pytest.mark.slow)])
def test_periodic_cluster_has_order_two_and_extrapolates(eta):
    exact = triple(local_field("triangular", eta))
    sizes = [12, 16, 24, 32, 48, 64]
    values = [triangular_cluster(eta, size) for size in sizes]
    orders = np.log2((values[3] - exact) / (values[5] - exact))
    np.testing.assert_allclose(orders, 2.0, atol=0.05)
    np.testing.assert_allclose(extrapolated(sizes, values), exact, rtol=1e-9)


RHOMBIC = Lattice("rhombic", ((1.0, 0.0), tuple(unit(75.0))))


@pytest.mark.parametrize(
    "structure",
    [SQUARE, *(pytest.param(one, marks=pytest.mark.slow) for one in (KAGOME, RHOMBIC))],
    ids=lambda structure: structure.name,
)
def test_other_lattices_agree_with_a_cluster(structure):
    sizes = [12, 16, 20, 24, 32, 40, 48]
    compliances = [by_cluster(structure, 0.84, size)[1] for size in sizes]
    field = local_field(structure, 0.84)
    assert field.alpha is None
    assert field.beta is None
    assert extrapolated(sizes, compliances) == pytest.approx(field.compliance, rel=1e-9)


# -- identities ------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=8)
@given(st.one_of(st.just(0.0), st.floats(1e-9, 1e4)))
def test_equilibrium_of_the_corona(eta):
    # (45) is the balance of forces on a corona ball; Xi itself comes from the energy of the star
    field = local_field("triangular", eta)
    assert field.xi == pytest.approx(compute_xi(field.alpha, field.beta, eta), rel=1e-11)
    # stiffer contacts cannot make the lattice softer
    assert field.xi < local_field("triangular", eta * 1.01 + 1e-3).xi
    assert 0.49 < field.alpha < 0.54
    assert 0.47 < field.beta < 0.64


def test_continuous_at_zero_friction():
    field = local_field("triangular", 0.0)
    for eta in (1e-12, 1e-9, 1e-6):
        # slope 1.04
        np.testing.assert_allclose(
            triple(local_field("triangular", eta)), triple(field), atol=1.1 * eta + 1e-12
        )


@pytest.mark.claim("api-local-field")
@pytest.mark.parametrize(
    ("name", "eta"),
    [
        ("triangular", 0.0),
        ("triangular", 0.84),
        ("square", 0.84),
        ("kagome", 0.84),
        pytest.param("sc", 0.84, marks=pytest.mark.slow),
    ],
)
def test_quadrature_converges_geometrically(name, eta):
    medium = ContactLattice.of(name, eta)

    def respond(order):
        zone = divide_zone(medium.reciprocal, order, _find_operations(medium))
        return sum(weights @ _Response(medium)(q) for q, weights in zone)

    exact = respond(24)
    errors = [np.max(np.abs(respond(order) - exact)) for order in (4, 6, 8, 10, 12)]
    assert errors[-1] < 1e-9
    assert errors[1] / errors[0] < 0.1
    assert np.exp(np.polyfit([4, 6, 8, 10, 12], np.log(errors), 1)[0]) < 0.2
    assert np.max(np.abs(respond(18) - exact)) < 1e-14


@pytest.mark.parametrize("eta", [0.0, 0.84])
def test_any_cell_of_the_lattice_gives_the_same(eta):
    turn = np.array([unit(17.0), unit(107.0)])
    cells = [
        Lattice("skewed", ((1.0, 0.0), (3.5, ROOT3 / 2.0))),
        Lattice("sixty", ((1.0, 0.0), (0.5, ROOT3 / 2.0))),
        Lattice("turned", TRIANGULAR.vectors @ turn),
        Lattice("two balls", ((1.0, 0.0), (0.0, ROOT3)), ((0.0, 0.0), (0.5, 0.5))),
    ]
    for cell in cells:
        field = local_field(cell, eta)
        assert field.lattice == cell.name
        np.testing.assert_allclose(
            triple(field), triple(local_field("triangular", eta)), rtol=1e-11
        )


# -- the interface ---------------------------------------------------------------------------------


def test_result():
    field = local_field("triangular", 0.84)
    assert local_field(find_lattice("triangular"), np.float64(0.84)) is field
    assert local_field() == local_field("triangular", 0.0)


@pytest.mark.parametrize("eta", [-0.1, np.nan, np.inf])
def test_mindlin_ratio_that_cannot_be(eta):
    with pytest.raises(InputError, match="zero or above"):
        paper_local_field(eta)
    with pytest.raises(InputError, match="unknown lattice"):
        local_field("cubic", 0.0)


# -- the paper -------------------------------------------------------------------------------------


def test_paper_constants():
    field = paper_local_field(0.84)
    assert (field.alpha, field.beta) == (0.585405, 0.232971)
    assert field.xi == pytest.approx(
        2.5 - 0.585405 - 0.232971 * ROOT3 / 2 + 0.84 * (1.5 - 0.232971 * ROOT3 / 2), rel=1e-15
    )
    assert paper_local_field(0.0).xi == pytest.approx(1.712836, abs=1e-6)
    assert paper_local_field(0.0).xi / local_field("triangular", 0.0).xi == pytest.approx(
        1.0997, abs=1e-4
    )
    assert field.xi / local_field("triangular", 0.84).xi == pytest.approx(1.1725, abs=1e-4)


@cache
def sextants(order: int = 30):
    """Six parts of the zone, between neighbouring K at 0 and 60, 60 and 120, ... degrees."""
    points, weights = np.polynomial.legendre.leggauss(order)
    points = 0.5 + 0.5 * points
    corners = 4.0 * np.pi / 3.0 * np.array([unit(60.0 * i) for i in range(7)])
    s, t = np.meshgrid(points, points, indexing="ij")
    weight = np.outer(weights * points, weights).ravel()
    parts = [
        (s[..., None] * (a + t[..., None] * (b - a))).reshape(-1, 2)
        for a, b in itertools.pairwise(corners)
    ]
    return parts, weight


def a11_and_a13(angles, parts, reach, printed=False):
    """(A11) and (A13) with n_p at ``angles``, T_p = sin(reach d q.t_p), over some parts of the
    zone.

    ``printed``: the last factor of (A13) as it stands there.
    """
    sectors, weight = sextants()
    alpha = beta = below = 0.0
    for part in parts:
        phases = np.array([sectors[part] @ unit(angle) for angle in angles])
        across = np.array([sectors[part] @ unit(angle + 90.0) for angle in angles])
        gamma = 1.0 - np.cos(phases)
        one = np.sin(phases)
        two = np.sin(2.0 * phases)
        t = np.sin(reach * across)
        ahead = [1, 2, 0]
        behind = [2, 0, 1]
        weighted = weight * gamma / np.sum(gamma * gamma[ahead], axis=0)
        difference = one[ahead] - one[behind]
        last = one[ahead] - two[ahead] if printed else difference
        below += np.sum(weighted * difference**2)
        alpha += np.sum(weighted * (two[ahead] - two[behind]) * difference)
        beta += 2.0 / ROOT3 * np.sum(weighted * (t - 0.5 * (t[ahead] + t[behind])) * last)
    return alpha / below, beta / below


def test_a11_is_right_and_a13_needs_two_corrections():
    third = (0.0, 120.0, 240.0)
    whole = range(6)
    np.testing.assert_allclose(a11_and_a13(third, whole, ROOT3), CLOSED[:2], rtol=1e-12)
    # either misprint of (A12) and (A13) alone spoils beta
    assert a11_and_a13(third, whole, ROOT3, printed=True)[1] == pytest.approx(0.0026, abs=1e-4)
    assert a11_and_a13(third, whole, 1.0)[1] == pytest.approx(0.9714, abs=1e-4)
    assert a11_and_a13(third, whole, 1.0, printed=True)[1] == pytest.approx(0.2858, abs=1e-4)
    # the integrand has the symmetry of the lattice: with T_p right, one sixth of the zone is enough
    np.testing.assert_allclose(a11_and_a13(third, [0], ROOT3), CLOSED[:2], rtol=1e-11)


def test_printed_a14_comes_from_directions_sixty_degrees_apart_and_one_sixth_of_the_zone():
    sixty = (0.0, 60.0, 120.0)
    alpha, beta = a11_and_a13(sixty, [2], 1.0)
    assert round(alpha, 6) == 0.585405
    assert round(beta, 6) == 0.232971
    # such an integrand differs from one sixth to the next: no part of the zone stands for the whole
    np.testing.assert_allclose(a11_and_a13(sixty, [0], 1.0), (0.531937, 0.874118), atol=1e-6)
    np.testing.assert_allclose(a11_and_a13(sixty, [1], 1.0), (0.531937, 0.874118), atol=1e-6)
    np.testing.assert_allclose(a11_and_a13(sixty, range(6), 1.0), (0.554309, 0.605851), atol=1e-6)


@pytest.mark.parametrize("eta", [0.0, 0.84])
def test_forces_31_and_42_with_signs_mended(eta):
    # u = 1, k = 1; the change of the force on ball 1 by each neighbour, from the energy of the
    # contact
    field = local_field("triangular", eta)
    n = {p: unit(60.0 * (p - 1)) for p in range(1, 7)}
    displaced = {
        "alpha": field.alpha * n[1],
        "beta": field.beta * (n[1] + n[2]) / ROOT3,
        "2": n[2],
        "0": 0.0 * n[1],
    }
    contact = {"alpha": n[1], "beta": n[2], "2": n[3], "0": n[4]}
    force = {}
    for ball, normal in contact.items():
        gap = displaced[ball] - n[1]
        tangent = np.array([-normal[1], normal[0]])
        force[ball] = (gap @ normal) * normal + eta * (gap @ tangent) * tangent
    # (31): from the on-top ball -k (u - u_alpha) n_1, printed n_4; from ball 2 the direction is
    # n_6, printed n_3
    np.testing.assert_allclose(force["alpha"], -(1.0 - field.alpha) * n[1], atol=1e-13)
    np.testing.assert_allclose(force["2"], -1.0 * n[6], atol=1e-13)
    # the second and third lines of (42) as printed
    t_2 = unit(150.0)
    gap = n[1] - field.beta * (n[1] + n[2]) / ROOT3
    np.testing.assert_allclose(
        force["beta"], -(gap @ n[2]) * n[2] - eta * (gap @ t_2) * t_2, atol=1e-13
    )
    # equilibrium, and with it (35) and (45), which are right: unit load over u_1, two bridges, two
    # of the corona
    balance = (
        1.0 / field.compliance
        + force["0"] @ n[1]
        + force["alpha"] @ n[1]
        + 2.0 * (force["beta"] + force["2"]) @ n[1]
    )
    assert balance == pytest.approx(0.0, abs=1e-11)
