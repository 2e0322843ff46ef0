"""Bands of crystals in one, two and three dimensions with six motions: closed forms, then twins,
then properties.

Everything is in reduced units d = k = M = 1, rotations as w = phi/sqrt(10), the square root of 10
being 1/R_g. A contact of normal n, P = nn, T = 1 - nn, has the energy (1/2)[u P u + eta |T u + n x
(phi_i + phi_j)/2|^2 + tau (phi.n)^2
+ beta |T phi|^2], where u and phi are u_j - u_i and phi_j - phi_i. With one ball in the cell, contacts n and -n make

    D_uu = 4 Sum s^2 (P + eta T)        D_ww = 10 Sum [eta c^2 T + 4 s^2 (tau P + beta T)]        D_uw = -i v x

in which each contact counts once, s and c are the sine and cosine of half of theta = q.n, v =
sqrt(10) eta Sum sin(theta) n. The closed forms below follow from sums of P by hand. Where v is
along an axis, only the two motions across it couple.
"""

from __future__ import annotations

import functools
import itertools
import math

import mpmath
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.motions import ALL, IN_PLANE, LONGITUDINAL, OUT_OF_PLANE
from granphon.balls.neighbours import find_contacts
from granphon.dynamics.contact_lattice import ContactLattice

#: ratios of slip, twist and roll: shear alone, and all of them
SHEAR = (0.84, 0.0, 0.0)
EVERY = (0.84, 0.07, 0.03)
RATIOS = [SHEAR, EVERY]
ROOT2 = math.sqrt(2.0)
ROOT3 = math.sqrt(3.0)


def lattice_of(name, ratios, motions=ALL):
    eta, tau, beta = ratios
    return ContactLattice.of(name, eta, torsion=tau, bending=beta, motions=motions)


def squares(name, ratios, q, motions=ALL):
    """Squared frequencies at Cartesian wave vectors, ascending."""
    return lattice_of(name, ratios, motions).frequencies(q) ** 2


def pair(a, b, coupling):
    """Eigenvalues of ((a, x), (x*, b)), |x|^2 being the ``coupling``; the lower one from the
    determinant.
    """
    upper = 0.5 * (a + b) + np.sqrt(0.25 * (a - b) ** 2 + coupling)
    return [(a * b - coupling) / upper, upper]


def in_order(values):
    return np.sort(np.stack(np.broadcast_arrays(*map(np.asarray, values)), axis=-1), axis=-1)


def half_angles(theta):
    return np.sin(0.5 * theta) ** 2, np.cos(0.5 * theta) ** 2


# -- closed forms: one and two dimensions ----------------------------------------------------------

X = np.array([1e-3, 0.4, 1.3, 2.2, 3.1, math.pi])


@pytest.mark.parametrize("ratios", RATIOS)
def test_chain(ratios):
    # n = x: u_x and w_x alone; u_y with w_z, and u_z with w_y, coupled by v = sqrt(10) eta sin q
    eta, tau, beta = ratios
    s, c = half_angles(X)
    across = pair(4 * eta * s, 10 * (eta * c + 4 * beta * s), 40 * eta**2 * s * c)
    expected = in_order([4 * s, 40 * tau * s, *across, *across])
    assert_allclose(squares("chain", ratios, X[:, None]), expected, rtol=1e-12, atol=1e-15)
    for motions, part in (
        (LONGITUDINAL, [4 * s]),
        (IN_PLANE, [4 * s, *across]),
        (OUT_OF_PLANE, [40 * tau * s, *across]),
    ):
        assert_allclose(
            squares("chain", ratios, X[:, None], motions), in_order(part), rtol=1e-12, atol=1e-15
        )


@pytest.mark.claim("granular-graphene")
@pytest.mark.parametrize("ratios", RATIOS)
def test_triangular_out_of_plane_at_the_corner(ratios):
    # three n at 120 degrees, theta = -2 pi/3 for each: s^2 = 3/4, c^2 = 1/4, sin equal, so that v =
    # 0; Sum P = Sum T = 3/2. Beside K, D_ww changes by -sin(120) (5 eta - 20 beta + 20 tau) Sum P
    # (n.dq), whose eigenvalues are +-(3/4) |dq|
    eta, tau, beta = ratios
    turning = 15 * (0.25 * eta + 3 * (tau + beta))
    lattice = lattice_of("triangular", ratios, OUT_OF_PLANE)
    corner = lattice.wavevectors([1 / 3, 1 / 3])
    found = lattice.frequencies([corner])[0] ** 2
    assert_allclose(found, np.sort([9 * eta, turning, turning]), rtol=1e-14)
    step = 1e-5
    for angle in (0.0, 0.7, 2.0):
        beside = (
            lattice.frequencies([corner + step * np.array([math.cos(angle), math.sin(angle)])])[0]
            ** 2
        )
        two = np.sort(beside[np.argsort(np.abs(beside - turning))[:2]])
        slope = 0.75 * math.sin(2 * math.pi / 3) * abs(5 * eta + 20 * tau - 20 * beta)
        assert_allclose((two[1] - two[0]) / (2 * step), slope, rtol=1e-4)


@pytest.mark.claim("membranes-bend")
def test_membranes_bend():
    # phi = (u_,y, -u_,x) to leading order: omega^2 = q^4 Sum [beta (q.n)^4 + tau (q.n)^2 (q.t)^2]
    # with unit q. Without torsion and bending the product above, over 15 eta, leaves omega = sqrt(3
    # eta) q^3 |cos 3 angle| / 48
    size = 1e-2
    (eta, tau, beta) = EVERY
    for angle in (0.0, 0.2, 0.9):
        q = size * np.array([[math.cos(angle), math.sin(angle)]])
        for name, count in (("square", 2), ("triangular", 3)):
            between = angle - math.pi / count * np.arange(count)
            bend = beta * np.cos(between) ** 4 + tau * (np.cos(between) * np.sin(between)) ** 2
            low = lattice_of(name, EVERY, OUT_OF_PLANE).frequencies(q)[0, 0]
            assert_allclose(low, size**2 * math.sqrt(bend.sum()), rtol=2e-4)
        low = lattice_of("triangular", SHEAR, OUT_OF_PLANE).frequencies(q)[0, 0]
        assert_allclose(
            low, math.sqrt(3 * eta) / 48 * size**3 * abs(math.cos(3 * angle)), rtol=1e-4
        )


def paths_of_honeycomb(q):
    """|Sum exp(i q.n)| over the three contacts of a ball of the honeycomb."""
    angles = math.pi / 2 + 2 * math.pi / 3 * np.arange(3)
    return np.abs(
        np.exp(1j * np.asarray(q) @ np.array([np.cos(angles), np.sin(angles)])).sum(axis=-1)
    )


@pytest.mark.claim("granular-graphene")
@given(q=st.tuples(st.floats(-9, 9), st.floats(-9, 9)), eta=st.floats(0.01, 2.0))
def test_honeycomb_out_of_plane_is_graphene(q, eta):
    # three slips a cell: C C^H = eta [15/2 - (e e^H + f f^H)/4], e = (1, 1, 1), f = (exp(i q.n)): 7
    # on the diagonal (2 and 10/2), and (1 + f_m f_m'*)(1 - 5/4) off it, where n.n' = -1/2. So three
    # branches vanish and one is flat
    hop = paths_of_honeycomb(q)
    expected = eta * np.array([0.0, 0.0, 0.0, 6.75 - 0.25 * hop, 6.75 + 0.25 * hop, 7.5])
    assert_allclose(
        squares("honeycomb", (eta, 0, 0), [q], OUT_OF_PLANE)[0], expected, rtol=1e-12, atol=1e-15
    )


@pytest.mark.claim("granular-graphene")
@pytest.mark.parametrize("ratios", RATIOS)
def test_dirac_point_of_the_honeycomb(ratios):
    # at K, exp(i q.n) = 1, w, w^2: u of one ball couples with one circular rotation of the other,
    # |x|^2 = 45 eta^2/4, and so the other way round; the two rotations that are left couple by 15
    # (eta/4 + tau - beta)
    eta, tau, beta = ratios
    turning = 15 * (0.25 * eta + tau + beta)
    cone = pair(3 * eta, turning, 11.25 * eta**2)
    lattice = lattice_of("honeycomb", ratios, OUT_OF_PLANE)
    corner = lattice.wavevectors([1 / 3, 1 / 3])
    found = lattice.frequencies([corner])[0] ** 2
    assert_allclose(
        found, np.sort([*cone, *cone, 30 * beta, 7.5 * eta + 30 * tau]), rtol=1e-13, atol=1e-14
    )
    if ratios == SHEAR:  # |Sum exp(i q.n)| is (3/2) |dq| beside K
        step = 1e-6
        for angle in (0.0, 0.7, 2.0):
            beside = (
                lattice.frequencies([corner + step * np.array([math.cos(angle), math.sin(angle)])])[
                    0
                ]
                ** 2
            )
            assert_allclose(
                beside[3:5], 6.75 * eta + 0.375 * eta * step * np.array([-1, 1]), rtol=1e-11
            )


# -- closed forms: space ---------------------------------------------------------------------------


def sums_of(ratios, stretched, still=(0, 0, 0), n_still=0):
    """u and w at a point where each theta is pi (P adds up to ``stretched``) or 0 (to ``still``),
    on common axes: no v.
    """
    eta, tau, beta = ratios
    p = np.asarray(stretched, float)
    n = sum(stretched)
    rest = n_still - np.asarray(still, float)
    return [*(4 * (p + eta * (n - p))), *(10 * (eta * rest + 4 * (tau * p + beta * (n - p))))]


#: points at which every contact has s or c = 0: fractions of the reciprocal cell, and the principal
#: values of Sum P for contacts with theta = pi, then for those with theta = 0
CORNERS = {
    # x; x and y; x, y and z turn by pi
    ("sc", "X"): ((0, 0.5, 0), (1, 0, 0), (0, 1, 1)),
    ("sc", "M"): ((0.5, 0.5, 0), (1, 1, 0), (0, 0, 1)),
    ("sc", "R"): ((0.5, 0.5, 0.5), (1, 1, 1), (0, 0, 0)),
    # all four diagonals; [111] and [11-1], on the axes [110], [1-10], [001]
    ("bcc", "H"): ((0.5, -0.5, 0.5), (4 / 3, 4 / 3, 4 / 3), (0, 0, 0)),
    ("bcc", "N"): ((0, 0, 0.5), (4 / 3, 0, 2 / 3), (0, 4 / 3, 2 / 3)),
    # the four contacts with a part along x; the three that are not across [111]
    ("fcc", "X"): ((0.5, 0, 0.5), (2, 1, 1), (0, 1, 1)),
    ("fcc", "L"): ((0.5, 0.5, 0.5), (2, 0.5, 0.5), (0, 1.5, 1.5)),
}  # fmt: skip


@pytest.mark.parametrize("ratios", RATIOS)
@pytest.mark.parametrize("where", CORNERS, ids="-".join)
def test_corners_of_cubic_crystals(where, ratios):
    fractions, stretched, still = CORNERS[where]
    lattice = lattice_of(where[0], ratios)
    expected = np.sort(sums_of(ratios, stretched, still, sum(still)))
    found = lattice.frequencies(lattice.wavevectors([fractions]))[0] ** 2
    assert_allclose(found, expected, rtol=1e-13, atol=1e-28)


def fcc_along_an_edge(x, ratios):
    # theta = q/sqrt(2) for four contacts, Sum P = (2, 1, 1), Sum T = (2, 3, 3), and zero for two,
    # Sum T = (2, 1, 1); v = sqrt(10) eta 2 sqrt(2) sin(theta)
    eta, tau, beta = ratios
    s, c = half_angles(x / ROOT2)
    across = pair(
        4 * (1 + 3 * eta) * s,
        10 * (eta * (1 + 3 * c) + 4 * (tau + 3 * beta) * s),
        320 * eta**2 * s * c,
    )
    return in_order(
        [8 * (1 + eta) * s, 20 * (eta * (1 + c) + 4 * (tau + beta) * s), *across, *across]
    )


def layers_along_their_axis(x, ratios):
    # close-packed layers, q along their axis, theta = sqrt(2/3) q: three contacts between layers
    # have Sum P = (1/2, 1/2, 2), Sum T = (5/2, 5/2, 1) and v = sqrt(10) eta sqrt(6) sin(theta),
    # those in a layer Sum T = (3/2, 3/2, 3)
    eta, tau, beta = ratios
    s, c = half_angles(x * math.sqrt(2 / 3))
    turned = 10 * (eta * (1.5 + 2.5 * c) + (2 * tau + 10 * beta) * s)
    across = pair((2 + 10 * eta) * s, turned, 240 * eta**2 * s * c)
    return in_order(
        [4 * (2 + eta) * s, 10 * (eta * (3 + c) + 4 * (2 * tau + beta) * s), *across, *across]
    )


def fcc_along_a_contact(x, ratios):
    # [110] at theta = q (index 1), four contacts at q/2 (index 2) with Sum P = (1, 1, 2), Sum T =
    # (3, 3, 2) along [110], [1-10], [001], and [1-10] at zero; v = sqrt(10) eta (sin q + 2
    # sin(q/2))
    eta, tau, beta = ratios
    (s1, c1), (s2, c2) = half_angles(x), half_angles(0.5 * x)
    coupling = 10 * eta**2 * (np.sin(x) + 2 * np.sin(0.5 * x)) ** 2
    # w_001, which couples with u_1-10, and w_1-10, which couples with u_001
    spin = [
        10 * (eta * (c1 + 1 + 2 * c2) + 4 * (beta * s1 + 2 * (tau + beta) * s2)),
        10 * (eta * (c1 + 3 * c2) + 4 * (beta * s1 + (tau + 3 * beta) * s2)),
    ]
    in_layer = pair(4 * (eta * s1 + (1 + 3 * eta) * s2), spin[0], coupling)
    upright = pair(4 * (eta * s1 + 2 * (1 + eta) * s2), spin[1], coupling)
    turned = 10 * (eta * (1 + 3 * c2) + 4 * tau * (s1 + s2) + 12 * beta * s2)
    return in_order([4 * (s1 + (1 + 3 * eta) * s2), turned, *in_layer, *upright])


FCC_LINES = {
    (1, 0, 0): fcc_along_an_edge,
    (1, 1, 1): layers_along_their_axis,
    (1, 1, 0): fcc_along_a_contact,
}


@pytest.mark.parametrize("ratios", [*RATIOS, (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("axis", FCC_LINES)
def test_face_centred_cubic_along_its_axes(axis, ratios):
    expected = FCC_LINES[axis](X, ratios)
    if not any(ratios):
        # without friction balls do not turn: 8 s^2 and twice 4 s^2 along [100], and so on
        expected = expected[:, 3:]
    found = squares("fcc", ratios, X[:, None] * (np.array(axis) / np.linalg.norm(axis)))
    assert found.shape == expected.shape
    assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("ratios", RATIOS)
def test_hexagonal_close_packing_along_c_is_fcc_along_111_folded(ratios):
    # layers see three contacts up and three down in either packing; two of them make a cell: q and
    # q + 2 pi/c
    expected = [
        layers_along_their_axis(X + shift, ratios) for shift in (0.0, math.pi / math.sqrt(2 / 3))
    ]
    found = squares("hcp", ratios, X[:, None] * [0, 0, 1])
    assert_allclose(
        found, np.sort(np.concatenate(expected, axis=1), axis=1), rtol=1e-12, atol=1e-14
    )


@pytest.mark.claim("free-points")
def test_linear_rotational_branch_of_kagome():
    # At Gamma neighbours on each of three rows turn by psi_m and -psi_m, about the normal of the
    # row in the plane. At q the three u undo these slips but for Sum theta_m psi_m around a
    # triangle: the energy is eta (Sum theta psi)^2/12, the kinetic energy (1/15)(2 Sum psi^2 - Sum
    # psi_m psi_n) of the rates, as each ball is in two rows. As Sum theta = 0, omega^2 = (eta/2)
    # Sum theta^2 = (3/4) eta q^2
    for angle in (0.0, 0.4, 1.1):
        q = 1e-4 * np.array([[math.cos(angle), math.sin(angle)]])
        found = lattice_of("kagome", SHEAR, OUT_OF_PLANE).frequencies(q)[0, 3]
        assert_allclose(found, 1e-4 * math.sqrt(0.75 * SHEAR[0]), rtol=1e-7)


# -- sums and curvatures ---------------------------------------------------------------------------

NAMED = [
    "chain",
    "square",
    "triangular",
    "honeycomb",
    "kagome",
    "sc",
    "bcc",
    "fcc",
    "hcp",
    "diamond",
]


@pytest.mark.claim("mean-square")
@pytest.mark.parametrize("ratios", RATIOS)
@pytest.mark.parametrize("name", NAMED)
def test_mean_squared_frequency_of_the_zone(name, ratios):
    # the trace of a ball's own block, from each of its z contacts: 1 + 2 eta of displacements, 10
    # (2 eta/4 + tau + 2 beta) of rotations; in plane 1 + eta and 10 (eta/4 + beta). Any mesh of two
    # or more points a side sums up the zone exactly
    eta, tau, beta = ratios
    inside = 1 + 3.5 * eta + 10 * beta
    outside = 3.5 * eta + 10 * (tau + beta)
    for motions, share in (
        (ALL, inside + outside),
        (IN_PLANE, inside),
        (OUT_OF_PLANE, outside),
        (LONGITUDINAL, 1.0),
    ):
        structure = gp.balls.lattices.LATTICES[name]
        if motions.name not in gp.balls.motions.allowed_motions(structure.dimension):
            continue
        lattice = lattice_of(name, ratios, motions)
        axes = [np.arange(3) / 3 + 0.1 * (axis + 1) for axis in range(lattice.periods)]
        mesh = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, lattice.periods)
        mean = (
            np.mean(np.sum(lattice.frequencies(lattice.wavevectors(mesh)) ** 2, axis=1))
            / lattice.n_balls
        )
        assert mean == pytest.approx(structure.coordination * share, rel=1e-13)


@pytest.mark.claim("rotations-curve-down")
@pytest.mark.parametrize(
    ("ratios", "curvatures"),
    # series of the closed forms along [100], s^2 = q^2/8: w_x loses 20 eta s^2 and gains 80 (tau +
    # beta) s^2; w_y loses 30 eta s^2, gains 40 (tau + 3 beta) s^2, and eta q^2 from v^2 = 40 eta^2
    # q^2 over the distance 40 eta of u_z
    [
        (SHEAR, (-2.5 * 0.84, -2.75 * 0.84, -2.75 * 0.84)),
        ((0.84, 0.1, 0.2), (-2.5 * 0.84 + 3.0, -2.75 * 0.84 + 3.5, -2.75 * 0.84 + 3.5)),
    ],
)
def test_curvature_of_the_rotational_branches_of_fcc(ratios, curvatures):
    q = 1e-3
    found = squares("fcc", ratios, [[q, 0, 0]])[0, 3:]
    assert_allclose((found - 40 * 0.84) / q**2, np.sort(curvatures), rtol=1e-4)


# -- the twin: energies of one contact, neighbours one by one --------------------------------------


def crystal(name, sqrt=math.sqrt):
    """Cell and places of the balls in the arithmetic of ``sqrt``, each crystal in its own words."""
    one = sqrt(1)
    h = sqrt(3) / 2
    two = sqrt(2)
    edge = {"bcc": 2 / sqrt(3), "fcc": two, "diamond": 4 / sqrt(3)}.get(name, one) / 2
    cubic = {"bcc": [[-1, 1, 1], [1, -1, 1], [1, 1, -1]], "fcc": [[0, 1, 1], [1, 0, 1], [1, 1, 0]]}
    cubic["diamond"] = cubic["fcc"]
    if name in cubic:
        cell = [[edge * x for x in row] for row in cubic[name]]
        return cell, [[0, 0, 0]] + [[edge / 2] * 3] * (name == "diamond")
    hexagonal = [[one, 0], [-one / 2, h]]
    if name == "honeycomb":  # the centre of a hexagon at the origin, a ball above it
        return [[2 * h, 0], [-h, 3 * one / 2]], [[0, one], [h, one / 2]]
    if name == "kagome":
        return [[2 * x for x in row] for row in hexagonal], [[one, 0], [-one / 2, h], [one / 2, h]]
    if name == "hcp":
        up = two * 2 / sqrt(3)
        return [[*row, 0] for row in hexagonal] + [[0, 0, up]], [
            [0, 1 / sqrt(3), up / 4],
            [one / 2, 1 / sqrt(12), 3 * up / 4],
        ]
    return {
        "chain": ([[one]], [[0]]), "square": ([[one, 0], [0, one]], [[0, 0]]), "triangular": (hexagonal, [[0, 0]]),
        "sc": ([[one, 0, 0], [0, one, 0], [0, 0, one]], [[0, 0, 0]]),
        "zigzag": ([[one * 6 / 5, 0]], [[0, 0], [one * 3 / 5, one * 4 / 5]]),
        "bilayer": ([[one, 0, 0], [0, one, 0]], [[0, 0, 0], [one / 2, one / 2, 1 / two]]),
    }[name]  # fmt: skip


def contacts_of(cell, places):
    """(i, j, n) of each contact once: every pair of balls at distance one."""
    found = []
    for i, j in itertools.product(range(len(places)), repeat=2):
        for steps in itertools.product(range(-2, 3), repeat=len(cell)):
            n = [
                b - a + sum(m * row[k] for m, row in zip(steps, cell, strict=True))
                for k, (a, b) in enumerate(zip(places[i], places[j], strict=True))
            ]
            if (i, steps) < (j, tuple(-m for m in steps)) and abs(sum(x * x for x in n) - 1) < 1e-9:
                found.append((i, j, n))
    return found


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def energy(n, ratios, x):
    """Energy of one contact for motions ``x`` of its two balls, (u, phi) of i and then of j."""
    eta, tau, beta = ratios
    u, phi = [[b - a for a, b in zip(x[k : k + 3], x[k + 6 : k + 9], strict=True)] for k in (0, 3)]
    mean = [(a + b) / 2 for a, b in zip(x[3:6], x[9:12], strict=True)]

    def along(v):
        return sum(a * b for a, b in zip(n, v, strict=True))

    def across(v):
        return [a - along(v) * b for a, b in zip(v, n, strict=True)]

    slip = [a - b for a, b in zip(across(u), cross(mean, n), strict=True)]
    roll = sum(a * a for a in across(phi))
    return (
        along(u) ** 2 + eta * sum(a * a for a in slip) + tau * along(phi) ** 2 + beta * roll
    ) / 2


def second_derivatives(n, ratios, gyration):
    """12 x 12 second derivatives of the energy by displacements and w = phi times ``gyration``,
    from differences: it is quadratic.
    """
    n = [*n, *[0 * n[0]] * (3 - len(n))]
    size = [1, 1, 1, *[1 / gyration] * 3] * 2

    def at(*moved):
        return energy(n, ratios, [0 * gyration + (size[k] * moved.count(k)) for k in range(12)])

    single = [at(k) for k in range(12)]
    return [[at(a, b) - single[a] - single[b] for b in range(12)] for a in range(12)]


@functools.cache
def exact_crystal(name):
    with mpmath.workdps(40):
        cell, places = crystal(name, mpmath.sqrt)
        exact = [mpmath.mpf(str(ratio)) for ratio in EVERY]
        gyration = 1 / mpmath.sqrt(10)
        return len(places), [
            (i, j, n, second_derivatives(n, exact, gyration))
            for i, j, n in contacts_of(cell, places)
        ]


def exact_matrix(name, q):
    """D(q) at 40 digits as nested lists, six motions a ball."""
    count, found = exact_crystal(name)
    total = [[mpmath.mpc(0)] * (6 * count) for _ in range(6 * count)]
    for i, j, n, block in found:
        phase = mpmath.expj(sum(mpmath.mpf(a) * b for a, b in zip(q, n, strict=False)))
        place = [6 * i + k for k in range(6)] + [6 * j + k for k in range(6)]
        factor = [1] * 6 + [phase] * 6
        for a, b in itertools.product(range(12), repeat=2):
            total[place[a]][place[b]] += mpmath.conj(factor[a]) * block[a][b] * factor[b]
    return total


def made_of(name, ratios, motions):
    """The package's lattice, also of those that equal forces do not hold."""
    if name in NAMED:
        return lattice_of(name, ratios, motions)
    cell, places = (np.array(part, float) for part in crystal(name))
    table = find_contacts(cell, places, name)
    return ContactLattice(
        cell,
        places,
        table,
        ratios[0],
        torsion=ratios[1],
        bending=ratios[2],
        motions=motions,
        name=name,
    )


def kept(motions, count):
    """Places of ``motions`` among six of each ball."""
    return [
        6 * ball + k
        for ball in range(count)
        for k in (*motions.translations, *(3 + axis for axis in motions.rotations))
    ]


GENERIC = [0.73, -1.19, 2.31]
OPEN = ["zigzag", "bilayer"]


@pytest.mark.claim("crystal-bands")
@pytest.mark.parametrize(
    "name",
    [
        "chain",
        "honeycomb",
        "kagome",
        "fcc",
        "diamond",
        "zigzag",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("square", "triangular", "sc", "bcc", "bilayer")
        ),
        pytest.param("hcp", marks=pytest.mark.exhaustive),
    ],
)
def test_bands_at_forty_digits_of_every_crystal(name):
    with mpmath.workdps(40):
        count, found = exact_crystal(name)
        periods = len(crystal(name)[0])
        q = GENERIC[:periods]
        full = exact_matrix(name, q)
        for motions in gp.balls.motions.allowed_motions(len(crystal(name)[0][0])).values():
            if name in OPEN and motions is not ALL:
                continue
            keep = kept(motions, count)
            part = [[full[a][b] for b in keep] for a in keep]
            ratios = (0.0, 0.0, 0.0) if motions is LONGITUDINAL else EVERY
            lattice = made_of(name, ratios, motions)
            matrix = lattice.dynamical_matrix([q])[0]
            assert len(lattice.contacts) == len(found)
            assert_allclose(np.array(part, complex), matrix, rtol=0, atol=2e-14)
            if len(keep) <= 12:
                values = sorted(mpmath.eighe(mpmath.matrix(part), eigvals_only=True))
                roots = [float(mpmath.sqrt(one)) for one in values]
                assert_allclose(lattice.frequencies([q])[0], roots, rtol=3e-13)


@pytest.mark.claim("crystal-bands")
@pytest.mark.parametrize("name", [*NAMED, *OPEN])
def test_bands_against_a_supercell_in_real_space(name):
    # dense eigenvalues of 2 x 3 x 2 cells (2 x 3, 4), neighbours one by one across their borders
    cell, places = crystal(name)
    shape = {1: (5,), 2: (2, 3), 3: (2, 3, 2)}[len(cell)]
    cells, count = list(itertools.product(*map(range, shape))), len(places)
    number = {index: k for k, index in enumerate(cells)}
    derivatives = {}
    total = np.zeros((6 * count * len(cells),) * 2)
    for i, j in itertools.product(range(count), repeat=2):
        for steps in itertools.product(range(-2, 3), repeat=len(cell)):
            n = (
                np.asarray(places[j], float)
                - places[i]
                + np.asarray(steps) @ np.asarray(cell, float)
            )
            if (i, steps) >= (j, tuple(-m for m in steps)) or abs(n @ n - 1) > 1e-9:
                continue
            block = derivatives.setdefault(
                tuple(n), np.array(second_derivatives(list(n), EVERY, 1 / math.sqrt(10)))
            )
            for index in cells:
                other = tuple(
                    (a + m) % size for a, m, size in zip(index, steps, shape, strict=True)
                )
                where = np.concatenate(
                    [
                        6 * (count * number[index] + i) + np.arange(6),
                        6 * (count * number[other] + j) + np.arange(6),
                    ]
                )
                np.add.at(total, (where[:, None], where[None, :]), block)
    lattice = made_of(name, EVERY, ALL)
    found = lattice.frequencies(lattice.wavevectors(np.array(cells) / shape)) ** 2
    expected = np.linalg.eigvalsh(total)
    assert_allclose(np.sort(found, axis=None), expected, rtol=0, atol=1e-12)


@pytest.mark.claim("finite-overlap-exact")
@pytest.mark.parametrize(
    ("name", "overlap"),
    [*((name, 0.03) for name in NAMED), ("triangular", 0.2), ("triangular", 1e-5)],
)
def test_finite_overlap_is_that_of_the_exact_energy_on_every_lattice(steel, name, overlap):
    # without friction: second derivatives, at 40 digits, of U = (4/15) (1 - r)^(5/2)/rest^(1/2):
    # stiffness 1 at rest
    packing = gp.Packing(steel, 8e-3, lattice=name, friction=False, motions="all")
    state = gp.AveragedLattice(packing).at_overlap(overlap * 8e-3, finite_overlap=True)
    lattice = state.contact_lattice()
    (cell, places) = crystal(name)
    rest = float(state.relative_overlap)
    q = np.array(GENERIC)[: len(cell)]
    count = len(places)
    expected = np.zeros((count, 3, count, 3), complex)
    with mpmath.workdps(40):

        def energy(*r):
            return (
                mpmath.mpf(4)
                / 15
                * (1 - mpmath.sqrt(sum(x * x for x in r))) ** 2.5
                / mpmath.sqrt(mpmath.mpf(rest))
            )

        for i, j, n in contacts_of(*crystal(name, mpmath.sqrt)):
            apart = [(1 - mpmath.mpf(rest)) * x for x in (*n, 0, 0)[:3]]
            block = np.zeros((3, 3))
            for a, b in itertools.product(range(3), repeat=2):
                block[a, b] = mpmath.diff(
                    energy, apart, tuple((axis == a) + (axis == b) for axis in range(3))
                )
            phase = np.exp(1j * (1 - rest) * np.dot(q, np.array(n, float)[: len(cell)]))
            for ball, other, factor in (
                (i, i, 1),
                (j, j, 1),
                (i, j, -phase),
                (j, i, -phase.conj()),
            ):
                expected[ball, :, other] += factor * block
    assert_allclose(
        lattice.dynamical_matrix([q])[0], expected.reshape(3 * count, -1), rtol=0, atol=2e-14
    )


@pytest.mark.parametrize(
    ("name", "fractions", "counts"),
    [
        ("fcc", (0, 0, 0), [3, 3]),
        ("fcc", (0.5, 0.5, 0.5), [1, 1, 2, 2]),
        ("fcc", (0.5, 0, 0.5), [1, 1, 2, 2]),
        ("fcc", (0.5, 0.25, 0.75), [1, 1, 2, 2]),
        ("fcc", (0.2, 0, 0.2), [1, 1, 2, 2]),
        ("fcc", (0.1, 0.2, 0.4), [1] * 6),
        ("bcc", (0.25, 0.25, 0.25), [3, 3]),
        ("bcc", (0.5, -0.5, 0.5), [3, 3]),
        ("bcc", (0, 0, 0.5), [1] * 6),
        ("sc", (0.5, 0.5, 0.5), [3, 3]),
        ("sc", (0.5, 0.5, 0), [1, 1, 2, 2]),
        ("hcp", (0, 0, 0.5), [2, 2, 4, 4]),
        ("hcp", (0, 0, 0), [1, 1, 2, 2, 3, 3]),
        ("diamond", (0, 0, 0), [3, 3, 3, 3]),
        ("diamond", (0.5, 0, 0.5), [2] * 6),
    ],
)
def test_degenerate_branches(name, fractions, counts):
    # dimensions of the representations of the group of q: cubic points in threes, faces across an
    # axis of order 4 or 3 in twos, and twice as many where a screw or glide makes two balls of a
    # cell alike. In hcp the balls that turn together at Gamma do so in threes, too, because Sum P
    # of its contacts is isotropic
    lattice = lattice_of(name, EVERY)
    values = lattice.frequencies(lattice.wavevectors([fractions]))[0] ** 2
    ends = np.flatnonzero(np.concatenate([[True], np.diff(values) > 1e-9, [True]]))
    assert sorted(np.diff(ends).tolist()) == counts


# -- properties ------------------------------------------------------------------------------------

fractions_of = st.tuples(*[st.floats(-1, 1)] * 3)
some_ratios = st.tuples(*[st.just(0.0) | st.floats(1e-12, top) for top in (2.0, 0.5, 0.5)])
some_name = st.sampled_from(NAMED)


@given(
    name=some_name, q=fractions_of, steps=st.tuples(*[st.integers(-3, 3)] * 3), ratios=some_ratios
)
def test_frequencies_repeat_and_do_not_know_the_sign_of_q(name, q, steps, ratios):
    lattice = lattice_of(name, ratios)
    part = np.array(q)[: lattice.periods]
    one, other, back = lattice.frequencies(
        lattice.wavevectors([part, part + steps[: lattice.periods], -part])
    )
    # in the square: the root of a square that vanishes has half its digits
    assert_allclose(other**2, one**2, rtol=0, atol=2e-13)
    assert_allclose(back**2, one**2, rtol=0, atol=2e-13)


@given(name=some_name, q=fractions_of, ratios=some_ratios)
def test_dynamical_matrix_is_hermitian_and_its_eigenvalues_are_the_squares(name, q, ratios):
    lattice = lattice_of(name, ratios)
    at = lattice.wavevectors([np.array(q)[: lattice.periods]])
    matrix = lattice.dynamical_matrix(at)[0]
    assert_allclose(matrix, matrix.conj().T, rtol=0, atol=1e-13)
    values = np.linalg.eigvalsh(matrix)
    top = max(1.0, values[-1])
    assert values[0] >= -1e-14 * top
    assert_allclose(lattice.frequencies(at)[0] ** 2, values, rtol=0, atol=1e-13 * top)


@st.composite
def turns(draw):
    """A rotation in space."""
    axis = np.add(draw(fractions_of), (0, 0, 1.5))
    x, y, z = axis / np.linalg.norm(axis)
    angle = draw(st.floats(0, 6.3))
    one = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * one + (1 - math.cos(angle)) * one @ one


@given(
    name=st.sampled_from(["sc", "bcc", "fcc", "hcp", "diamond"]),
    turn=turns(),
    q=fractions_of,
    ratios=some_ratios,
)
def test_a_crystal_turned_in_space_vibrates_alike(name, turn, q, ratios):
    structure = gp.balls.lattices.LATTICES[name]
    turned = gp.Lattice(f"{name}, turned", structure.vectors @ turn.T, structure.sites)
    straight = lattice_of(name, ratios)
    slanted = lattice_of(turned, ratios)
    at = straight.wavevectors([q])
    assert_allclose(
        slanted.frequencies(at @ turn.T) ** 2, straight.frequencies(at) ** 2, rtol=0, atol=1e-12
    )


@example(name="diamond", q=(0.0, 0.0, 0.5), ratios=(1e-12, 0.0, 0.0), shape=(1, 1, 2), shear=0)
@example(
    name="diamond",
    q=(0.25, 0.0, 0.5),
    ratios=(3.3822589606919387e-12, 0.0, 0.0),
    shape=(2, 1, 1),
    shear=-1,
)
@given(
    name=some_name,
    q=fractions_of,
    ratios=some_ratios,
    shape=st.tuples(*[st.integers(1, 2)] * 3),
    shear=st.integers(-1, 1),
)
def test_larger_cells_fold_the_bands(name, q, ratios, shape, shear):
    structure = gp.balls.lattices.LATTICES[name]
    p = structure.periods
    steps = np.diag(shape[:p])
    if p > 1:
        steps[0, 1] = shear
    corners = [np.array(one) for one in itertools.product(range(-1, 3), repeat=p)]
    inside = [
        one
        for one in corners
        if np.all(np.linalg.solve(steps.T, one) % 1.0 == np.linalg.solve(steps.T, one))
    ]
    sites = [
        (np.asarray(site)[:p] + one) @ np.linalg.inv(steps)
        for one in inside
        for site in (structure.positions[:, :p] @ np.linalg.inv(structure.vectors[:, :p]))
    ]
    large = lattice_of(gp.Lattice("larger", steps @ structure.vectors, sites), ratios)
    small = lattice_of(name, ratios)
    copies = np.array(list(itertools.product(*map(range, shape[:p]))))
    part = np.array(q)[:p]
    expected = small.frequencies(small.wavevectors((part + copies) @ np.linalg.inv(steps).T)) ** 2
    found = large.frequencies(large.wavevectors([part]))[0] ** 2
    assert_allclose(
        found, np.sort(expected, axis=None), rtol=0, atol=5e-14 * max(1.0, np.max(expected))
    )


@given(name=some_name, q=fractions_of, ratios=some_ratios, factor=st.floats(1e-6, 1e6))
def test_frequencies_scale_with_stiffness_and_mass(name, q, ratios, factor):
    one = lattice_of(name, ratios)
    eta, tau, beta = ratios
    other = ContactLattice(
        one.cell,
        one.positions,
        one.contacts,
        eta,
        stiffness=factor,
        masses=4.0,
        torsion=tau,
        bending=beta,
        motions=ALL,
    )
    at = one.wavevectors([np.array(q)[: one.periods]])
    assert_allclose(
        4.0 / factor * other.frequencies(at) ** 2, one.frequencies(at) ** 2, rtol=0, atol=2e-13
    )


@given(name=some_name, q=fractions_of, ratios=some_ratios, more=some_ratios)
def test_stiffer_contacts_lower_no_frequency(name, q, ratios, more):
    # D grows by a positive semidefinite matrix, if rotations move in both
    ratios = (ratios[0] + 1e-3, *ratios[1:])
    soft = lattice_of(name, ratios)
    stiff = lattice_of(name, tuple(np.add(ratios, more)))
    at = soft.wavevectors([np.array(q)[: soft.periods]])
    assert np.all(stiff.frequencies(at) ** 2 >= soft.frequencies(at) ** 2 - 1e-12)


# -- modes -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratios", RATIOS)
@pytest.mark.parametrize("name", NAMED)
def test_modes_are_eigenvectors_that_travel_with_the_slope(name, ratios):
    lattice = lattice_of(name, ratios)
    q = np.array(GENERIC)[: lattice.periods]
    modes = lattice.modes([q])
    vectors = modes.eigenvectors[0]
    squares_of = modes.frequencies[0] ** 2
    assert_allclose(vectors.conj().T @ vectors, np.eye(lattice.n_branches), atol=1e-13)
    assert_allclose(lattice.dynamical_matrix([q])[0] @ vectors, vectors * squares_of, atol=2e-13)
    fractions = modes.rotational_fraction + modes.longitudinal_fraction + modes.transverse_fraction
    assert_allclose(fractions + modes.out_of_plane_fraction, 1.0, rtol=1e-13)
    turned = np.abs(vectors.reshape(lattice.n_balls, 6, -1)[:, 3:]) ** 2
    assert_allclose(modes.rotational_fraction[0], turned.sum(axis=(0, 1)), atol=1e-14)
    # slopes of squares: those of branches that vanish, and that touch (the chain's pairs do at
    # every q), are the same
    h = 1e-5
    for axis in range(lattice.periods):
        step = h * np.eye(lattice.periods)[axis]
        ends = lattice.frequencies([q + step, q - step]) ** 2
        slope = 2 * modes.frequencies[0] * modes.group_velocities[0, :, axis]
        assert_allclose(slope, (ends[0] - ends[1]) / (2 * h), atol=3e-9)


@pytest.mark.parametrize("name", ["sc", "bcc", "fcc", "hcp"])
def test_modes_at_gamma_are_the_limits_of_sound(name):
    lattice = lattice_of(name, EVERY)
    for direction in ((1, 0, 0), (1, 2, 3), (0, 0, -1)):
        modes = lattice.modes([[0.0, 0.0, 0.0]], direction)
        along = np.array(direction) / np.linalg.norm(direction)
        sound = np.sort(lattice.sound_velocities(direction)[0])
        assert_allclose(modes.group_velocities[0, :3] @ along, sound, rtol=1e-12)
        assert np.all(modes.frequencies[0, :3] == 0.0)
        # inversion leaves optical modes their sign or turns it, in each set alike, so that none has
        # a slope
        assert_allclose(modes.group_velocities[0, 3:], 0.0, atol=1e-12)
        if name != "hcp":
            assert_allclose(modes.rotational_fraction[0], [0, 0, 0, 1, 1, 1], atol=1e-14)


@pytest.mark.parametrize("name", NAMED)
def test_modes_in_the_next_zone_have_the_phase_of_their_wave_vector(name):
    lattice = lattice_of(name, EVERY)
    q = np.array(GENERIC)[: lattice.periods]
    shift = lattice.reciprocal.sum(axis=0)
    matrix = lattice.dynamical_matrix([q + shift])[0]
    modes = lattice.modes([q + shift])
    vectors = modes.eigenvectors[0]
    assert_allclose(matrix @ vectors, vectors * modes.frequencies[0] ** 2, atol=1e-12)


@pytest.mark.parametrize("ratios", RATIOS)
@pytest.mark.parametrize(("name", "contacts"), [("sc", 6), ("bcc", 8), ("fcc", 12)])
def test_rotations_of_cubic_crystals_at_gamma(name, contacts, ratios):
    # s = 0, c = 1: 10 eta Sum T, and Sum T is 2/3 of half the contacts by cubic symmetry; twist and
    # roll do not matter
    expected = [0, 0, 0, *[10 * ratios[0] * contacts / 3] * 3]
    assert_allclose(squares(name, ratios, np.zeros((1, 3)))[0], expected, rtol=1e-14, atol=1e-28)


@pytest.mark.parametrize("ratios", RATIOS)
def test_corners_with_quarter_turns(ratios):
    # bcc at P: theta = 3 pi/2, and pi/2 three times: s^2 = c^2 = 1/2, Sum P = 4/3, and Sum
    # sin(theta) n = 0.
    # fcc at W: s^2 = 1/2 for [1, +-1, 0] (sin = -1, 1) and [0, 1, +-1] (sin = 1), 1 for [1, 0,
    # +-1]. Sum s^2 P =
    # (3/2, 1, 3/2), Sum c^2 P = (1/2, 1, 1/2), Sum s^2 = 4, Sum c^2 = 2, and Sum sin(theta) n = 0
    eta, tau, beta = ratios
    for name, fractions, sines, total, cosines, rest in (
        ("bcc", (0.25, 0.25, 0.25), [2 / 3] * 3, 2, [2 / 3] * 3, 2),
        ("fcc", (0.5, 0.25, 0.75), [1.5, 1, 1.5], 4, [0.5, 1, 0.5], 2),
    ):
        p = np.array(sines)
        c = np.array(cosines)
        moved = 4 * (p + eta * (total - p))
        turned = 10 * (eta * (rest - c) + 4 * (tau * p + beta * (total - p)))
        lattice = lattice_of(name, ratios)
        found = lattice.frequencies(lattice.wavevectors([fractions]))[0] ** 2
        assert_allclose(found, np.sort([*moved, *turned]), rtol=1e-13)


@pytest.mark.parametrize("ratios", RATIOS)
def test_simple_cubic_along_an_edge(ratios):
    # n = x moves, y and z do not: u_x, w_x alone, and u_y with w_z: v = sqrt(10) eta sin q
    eta, tau, beta = ratios
    s, c = half_angles(X)
    across = pair(4 * eta * s, 10 * (eta + eta * c + 4 * beta * s), 40 * eta**2 * s * c)
    expected = in_order([4 * s, 20 * eta + 40 * tau * s, *across, *across])
    assert_allclose(squares("sc", ratios, X[:, None] * [0, 0, 1]), expected, rtol=1e-12)


@pytest.mark.parametrize("ratios", RATIOS)
def test_body_centred_cubic_along_an_edge(ratios):
    # theta = q/sqrt(3) for all four, Sum P = 4/3, Sum T = 8/3, v = sqrt(10) eta (4/sqrt(3))
    # sin(theta)
    eta, tau, beta = ratios
    s, c = half_angles(X / ROOT3)
    moved = 16 / 3 * (1 + 2 * eta) * s
    turned = 80 / 3 * (eta * c + 2 * (tau + 2 * beta) * s)
    across = pair(moved, turned, 640 / 3 * eta**2 * s * c)
    assert_allclose(
        squares("bcc", ratios, X[:, None] * [0, 1, 0]),
        in_order([moved, turned, *across, *across]),
        rtol=1e-12,
    )


def test_corner_k_of_face_centred_cubic():
    lattice = lattice_of("fcc", EVERY)
    found = lattice.frequencies(lattice.wavevectors([(3 / 8, 3 / 8, 3 / 4)]))[0] ** 2
    assert_allclose(found, fcc_along_a_contact(np.array([1.5 * math.pi]), EVERY)[0], rtol=1e-13)


def test_curvature_of_the_rotational_branches_elsewhere():
    # s^2 = q^2/4 in sc, where w_x does not change, and w_y loses 10 eta s^2 and gains 40 eta^2 s^2
    # over 20 eta; s^2 = q^2/12 in bcc, where both lose 80/3 eta s^2, and w_y gains 640/3 eta^2 s^2
    # over 80/3 eta
    q = 1e-3
    eta = SHEAR[0]
    for name, level, expected in (
        ("sc", 20, (-2.0, -2.0, 0.0)),
        ("bcc", 80 / 3, (-20 / 9, -14 / 9, -14 / 9)),
    ):
        found = squares(name, SHEAR, [[q, 0, 0]])[0, 3:]
        assert_allclose((found - level * eta) / (eta * q**2), expected, atol=3e-4)


@given(
    q=fractions_of,
    ratios=some_ratios,
    order=st.permutations([0, 1, 2]),
    signs=st.tuples(*[st.sampled_from([-1, 1])] * 3),
)
def test_cubic_crystals_have_cubic_symmetry(q, ratios, order, signs):
    cartesian = 3.0 * np.array(q)
    image = (np.array(signs) * cartesian)[list(order)]
    for name in ("sc", "bcc", "fcc", "diamond"):
        one, other = squares(name, ratios, [cartesian, image])
        assert_allclose(other, one, rtol=0, atol=1e-12)


@pytest.mark.parametrize("ratios", RATIOS)
def test_share_of_rotation_along_an_axis_of_fcc(ratios):
    # of the pair ((a, x), (x*, b)) the mode of the square z has |w|^2 = |x|^2 / (|x|^2 + (z - b)^2)
    eta, tau, beta = ratios
    s, c = half_angles(X / ROOT2)
    a = 4 * (1 + 3 * eta) * s
    b = 10 * (eta * (1 + 3 * c) + 4 * (tau + 3 * beta) * s)
    coupling = 320 * eta**2 * s * c
    shares = [(z - a) ** 2 / (coupling + (z - a) ** 2) for z in pair(a, b, coupling)]
    lattice = lattice_of("fcc", ratios)
    for x, *expected in zip(X[:-1], *shares, strict=False):
        modes = lattice.modes([[x, 0, 0]])
        both = np.array([expected[0]] * 2 + [expected[1]] * 2)
        assert_allclose(np.sort(modes.rotational_fraction[0]), np.sort([0, 1, *both]), atol=1e-12)
        # one branch is longitudinal, 8 (1 + eta) s^2, and one a spin about [100]
        ahead = int(np.argmax(modes.longitudinal_fraction[0]))
        assert modes.longitudinal_fraction[0, ahead] == pytest.approx(1.0, rel=1e-12)
        assert modes.longitudinal_fraction[0].sum() == pytest.approx(1.0, rel=1e-12)
        top = 8 * (1 + eta) * math.sin(x / math.sqrt(8)) ** 2
        assert modes.frequencies[0, ahead] ** 2 == pytest.approx(top, rel=1e-12)
