"""Motions that cost nothing, and flexural branches: closed forms, then a twin of many digits."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.motions import ALL, IN_PLANE, OUT_OF_PLANE
from granphon.balls.neighbours import find_contacts

ETA = 2 * (1 - 0.276) / (2 - 0.276)
#: directions without symmetry
GENERIC = {1: [0.7], 2: [0.6, 0.8], 3: [0.36, 0.48, 0.8]}

sizes = st.floats(-29.0, 0.5).map(lambda exponent: 10.0**exponent)
angles = st.floats(0.0, 2.0 * math.pi)


def make(name, motions=ALL, eta=ETA, **terms):
    return gp.ContactLattice.of(name, eta, motions=motions, **terms)


def scatter(lattice, count=30):
    return np.random.default_rng(1).normal(size=(count, lattice.periods)) * 2.0


# -- the twin: energies of contacts as vectors in space, at many digits ----------------------------


def exact_matrix(lattice, q):
    """D(q) in the present precision of mpmath, (u, w) of ball after ball: no tangents, no rows, no
    frame.
    """
    table = lattice.contacts
    moving = lattice.motions
    width = moving.count
    root = mpmath.sqrt(10)
    found = mpmath.matrix(lattice.n_branches)

    def vector(values):
        return [mpmath.mpf(float(x)) for x in values] + [mpmath.mpf(0)] * (3 - len(values))

    def cross(a, b):
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    for c in range(len(table)):
        n = vector(table.normal[c])
        r = vector(table.vector[c])
        phase = mpmath.exp(1j * sum((a * b for a, b in zip(q, r, strict=False)), mpmath.mpf(0)))
        columns = {}
        for ball, factor, arm, sign in (
            (table.i[c], 1, table.arm_i[c], -1),
            (table.j[c], phase, table.arm_j[c], 1),
        ):
            for place, axis in enumerate((*moving.translations, *moving.rotations)):
                one = [mpmath.mpf(int(k == axis)) for k in range(3)]
                if place < len(moving.translations):
                    moved = [sign * x for x in one]
                    turned = [mpmath.mpf(0)] * 3
                else:
                    one = [root * x for x in one]
                    moved = [-mpmath.mpf(float(arm)) * x for x in cross(one, n)]
                    turned = [sign * x for x in one]
                along, twist = (
                    sum(a * b for a, b in zip(part, n, strict=True)) for part in (moved, turned)
                )
                slip, roll = (
                    [a - b * size for a, b in zip(part, n, strict=True)]
                    for part, size in ((moved, along), (turned, twist))
                )
                rows = [along, *(mpmath.sqrt(lattice.mindlin_ratio) * x for x in slip)]
                rows += [
                    mpmath.sqrt(lattice.torsion) * twist,
                    *(mpmath.sqrt(lattice.bending) * x for x in roll),
                ]
                key = int(ball) * width + place
                columns[key] = [
                    a + factor * b for a, b in zip(columns.get(key, [0] * 8), rows, strict=True)
                ]
        for a, left in columns.items():
            for b, right in columns.items():
                found[a, b] += sum(mpmath.conj(x) * y for x, y in zip(left, right, strict=True))
    return found


def exact_frequencies(lattice, q, digits):
    """Frequencies of the twin, ascending, at ``digits`` digits; zero where they are below its
    rounding.
    """
    with mpmath.workdps(digits):
        squares = mpmath.eighe(
            exact_matrix(lattice, [mpmath.mpf(float(x)) for x in q]), eigvals_only=True
        )
        return sorted(
            float(mpmath.sqrt(x)) if x > mpmath.mpf(10) ** (8 - digits) else 0.0 for x in squares
        )


# -- branches that vanish at every wave vector -----------------------------------------------------


@pytest.mark.claim("free-branches")
@pytest.mark.parametrize(
    ("name", "motions", "terms", "free", "branches", "remedy"),
    [
        ("chain", ALL, {}, 3, 6, "add torsion and bending"),
        ("chain", ALL, {"torsion": 0.1}, 2, 6, "add bending"),
        ("chain", ALL, {"bending": 0.1}, 1, 6, "add torsion"),
        ("chain", ALL, {"bending": 0.1, "torsion": 0.1}, 0, 6, ""),
        ("chain", ALL, {"eta": 0.0}, 2, 3, "add friction, torsion and bending"),
        ("chain", IN_PLANE, {}, 1, 3, "add bending"),
        ("square", OUT_OF_PLANE, {}, 1, 3, "add torsion, or bending"),
        ("square", ALL, {}, 1, 6, "add torsion, or bending"),
        ("square", OUT_OF_PLANE, {"bending": 0.1}, 0, 3, ""),
        ("honeycomb", OUT_OF_PLANE, {}, 3, 6, "add bending"),
        ("honeycomb", ALL, {}, 3, 12, "add bending"),
        ("honeycomb", IN_PLANE, {}, 0, 6, ""),
        ("honeycomb", IN_PLANE, {"eta": 0.0}, 1, 4, "add friction"),
        ("kagome", OUT_OF_PLANE, {}, 3, 9, "add torsion, or bending"),
        ("kagome", IN_PLANE, {"eta": 0.0}, 0, 6, ""),
        ("triangular", OUT_OF_PLANE, {}, 0, 3, ""),
        ("triangular", ALL, {"eta": 0.0}, 1, 3, "add friction"),
        ("triangular", ALL, {"eta": 0.0, "torsion": 0.1}, 2, 6, "add friction"),
        ("sc", ALL, {"eta": 0.0}, 0, 3, ""),
        ("fcc", ALL, {}, 0, 6, ""),
        ("hcp", ALL, {}, 0, 12, ""),
        ("diamond", ALL, {}, 0, 12, ""),
        ("diamond", ALL, {"eta": 0.0}, 2, 6, "add friction"),
    ],
)
def test_free_branches_are_exactly_zero_and_counted(name, motions, terms, free, branches, remedy):
    lattice = make(name, motions, **terms)
    assert (lattice.free_branches, lattice.n_branches) == (free, branches)
    q = scatter(lattice)
    values = lattice.frequencies(q)
    assert np.all(np.count_nonzero(values == 0.0, axis=1) == free)
    assert free == branches or np.min(values[:, free:]) > 1e-6
    squares = np.linalg.eigvalsh(lattice.dynamical_matrix(q))
    assert_allclose(values**2, squares, atol=2e-13)
    modes = lattice.modes(q)
    vectors = modes.eigenvectors
    assert_allclose(
        vectors.conj().swapaxes(1, 2) @ vectors,
        np.broadcast_to(np.eye(branches), vectors.shape),
        atol=2e-14,
    )
    assert_allclose(
        lattice.dynamical_matrix(q) @ vectors, vectors * values[:, None] ** 2, atol=5e-13
    )
    assert np.all(modes.group_velocities[:, :free] == 0.0)
    if not free:
        assert lattice.free_branch_warnings == ()
        return
    (sentence,) = lattice.free_branch_warnings
    assert sentence.startswith(f"{free} of {branches} branches vanish")
    assert sentence.endswith(remedy)


def test_a_tiny_stiffness_is_not_none():
    # found from the rank of rows scaled to one, not from the size of a frequency
    for terms in ({"bending": 1e-25}, {"torsion": 1e-25}):
        lattice = make("square", OUT_OF_PLANE, **terms)
        assert lattice.free_branches == 0
        assert np.all(lattice.frequencies([[0.9, 0.4]])[0] > 1e-14)


# -- closed forms ----------------------------------------------------------------------------------


@pytest.mark.claim("membranes-bend")
@given(size=sizes, angle=angles, eta=st.floats(0.05, 1.3))
def test_product_of_the_triangular_branches_out_of_plane(size, angle, eta):
    # det C(q) = 10 sqrt(3) eta^(3/2) sin h_1 sin h_2 sin h_3
    q = size * np.array([math.cos(angle), math.sin(angle)])
    half = [
        0.5 * float(q @ [math.cos(turn), math.sin(turn)])
        for turn in (0.0, math.pi / 3, 2 * math.pi / 3)
    ]
    assume(min(abs(h) for h in half) > 1e-3 * size)
    values = make("triangular", OUT_OF_PLANE, eta).frequencies([q])[0]
    expected = 10 * math.sqrt(3) * eta**1.5 * abs(math.prod(math.sin(h) for h in half))
    assert np.prod(values) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("angle", [0.0, 0.2, 0.5, 1.0, 2.5])
def test_triangular_flexural_branch_is_cubic_with_threefold_angle(angle):
    lattice = make("triangular")
    along = np.array([math.cos(angle), math.sin(angle)])
    factor = math.sqrt(ETA) / (16 * math.sqrt(3)) * abs(math.cos(3 * angle))
    for size in (1e-4, 1e-6, 1e-12, 1e-30, 1e-60):
        modes = lattice.modes([size * along])
        assert modes.frequencies[0, 0] == pytest.approx(factor * size**3, rel=2 * size**2 + 1e-13)
        assert modes.group_velocities[0, 0] @ along == pytest.approx(
            3 * factor * size**2, rel=4 * size**2 + 1e-13
        )
        assert modes.out_of_plane_fraction[0, 0] == pytest.approx(1.0, abs=size**2)
    assert modes.frequencies[0, 0] == lattice.frequencies([size * along])[0, 0]
    assert lattice.frequencies([1e-200 * along])[0, 0] == 0.0  # below the smallest number


@pytest.mark.parametrize("terms", [{}, {"eta": 0.3}])
def test_triangular_flexural_branch_is_exactly_zero_from_gamma_to_m(terms):
    # q is across the contacts of rows of balls, which roll
    lattice = make("triangular", OUT_OF_PLANE, **terms)
    for turn in range(6):
        angle = math.pi / 6 + turn * math.pi / 3
        for size in (1e-30, 1e-12, 1e-6, 1e-3, 0.1, 1.0, 3.0):
            values = lattice.frequencies([[size * math.cos(angle), size * math.sin(angle)]])[0]
            assert values[0] == 0.0
            assert values[1] > 0.5
    # beside the line it is not
    assert (
        lattice.frequencies(
            [[1e-6 * math.cos(math.pi / 6 + 1e-9), 1e-6 * math.sin(math.pi / 6 + 1e-9)]]
        )[0, 0]
        > 0.0
    )


@given(q=st.tuples(st.floats(-7, 7), st.floats(-7, 7)))
def test_square_out_of_plane_in_closed_form(q):
    (a, b), (c, d) = np.sin(np.array(q) / 2), np.cos(np.array(q) / 2)
    one = 4 * a**2 + 10 * c**2
    other = 4 * b**2 + 10 * d**2
    mixed = 4 * a * b
    root = math.hypot((one - other) / 2, mixed)
    high = (one + other) / 2 + root
    values = make("square", OUT_OF_PLANE).frequencies([q])[0]
    assert values[0] == 0.0
    assert_allclose(
        values[1:] ** 2, [ETA * (one * other - mixed**2) / high, ETA * high], atol=2e-14
    )


# -- modes that vanish at points and lines ---------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "motions", "point", "soft"),
    [
        ("bcc", ALL, (0.5, -0.5, 0.5), 3),
        ("bcc", ALL, (0.5, -0.5, 0.4), 0),
        ("sc", ALL, (0.5, 0.5, 0.0), 1),
        ("sc", ALL, (0.5, 0.5, 0.3), 1),
        ("sc", ALL, (0.5, 0.5, 0.5), 3),
        ("sc", ALL, (0.5, 0.4, 0.5), 1),
        ("sc", ALL, (0.5, 0.0, 0.0), 0),
        ("square", IN_PLANE, (0.5, 0.5), 1),
        ("honeycomb", IN_PLANE, (0.0, 0.0), 1),
        ("honeycomb", IN_PLANE, (0.2, 0.0), 1),
        ("honeycomb", IN_PLANE, (0.0, 0.37), 1),
        ("honeycomb", IN_PLANE, (0.5, 0.0), 1),
        ("honeycomb", IN_PLANE, (1 / 3, 1 / 3), 0),
        ("honeycomb", IN_PLANE, (0.2, 0.1), 0),
        ("diamond", ALL, (0.0, 0.0, 0.0), 3),
        ("diamond", ALL, (0.5, 0.5, 0.5), 3),
        ("diamond", ALL, (0.2, 0.1, 0.3), 0),
        ("triangular", OUT_OF_PLANE, (0.3, 0.0), 1),
        ("kagome", OUT_OF_PLANE, (0.0, 0.0), 1),
        ("square", OUT_OF_PLANE, (0.5, 0.5), 1),
        ("chain", ALL, (0.0,), 0),
        ("fcc", ALL, (0.5, 0.0, 0.5), 0),
        ("hcp", ALL, (0.0, 0.0, 0.5), 0),
        ("diamond", ALL, (0.25, 0.0, 0.25), 2),
        ("diamond", ALL, (0.2, 0.2, 0.2), 3),
        ("diamond", ALL, (0.1, 0.2, 0.2), 1),
    ],
)
@pytest.mark.parametrize("eta", [ETA, 1e-3])
@pytest.mark.claim("free-points")
def test_modes_that_vanish_at_a_point_are_zero_and_said(name, motions, point, soft, eta):
    lattice = make(name, motions, eta)
    generic = lattice.wavevectors([GENERIC[lattice.periods]])
    q = np.concatenate([generic, lattice.wavevectors([point])])
    values = lattice.frequencies(q)
    squares = np.linalg.eigvalsh(lattice.dynamical_matrix(q))
    assert_allclose(values**2, squares, atol=1e-13)
    zeros = np.count_nonzero(values == 0.0, axis=1)
    assert zeros[0] == lattice.free_branches
    assert np.all(values[1, zeros[1] :] > 1e-3)
    told = lattice.soft_mode_warnings(q, values)
    if not soft:
        assert told == ()
        return
    (sentence,) = told
    shown = ", ".join(f"{one:.6g}" for one in point)
    assert sentence.startswith(f"{soft} mode")
    assert f"q = ({shown})" in sentence
    along = np.array(GENERIC[lattice.periods]) / np.linalg.norm(GENERIC[lattice.periods])
    modes = lattice.modes(q, along)
    assert np.all(modes.frequencies[1, : zeros[1]] == 0.0)
    assert np.all(modes.group_velocities[1, : lattice.free_branches] == 0.0)
    # beside the point their frequencies are cones, whose slope is the velocity at the point
    beside = lattice.modes(q[1:] + 1e-6 * along, along)
    soft_ones = slice(lattice.free_branches, zeros[1])
    assert_allclose(
        modes.group_velocities[1, soft_ones] @ along,
        beside.frequencies[0, soft_ones] / 1e-6,
        rtol=1e-5,
    )
    assert_allclose(
        modes.group_velocities[1, soft_ones], beside.group_velocities[0, soft_ones], atol=2e-5
    )
    overlap = np.abs(np.einsum("mb,mb->b", modes.eigenvectors[1].conj(), beside.eigenvectors[0]))
    assert_allclose(overlap[soft_ones], 1.0, atol=1e-5)


@pytest.mark.claim("soft-cones")
def test_cones_at_soft_points_in_closed_form():
    # antiphase rotations turn w at M or R, with the displacements that their slip moves: D_ww = 5
    # eta x^2/2 for each contact across the axis, D_uw = sqrt 10 eta x, and D_uu = 4 (1 + eta) in
    # the square lattice, 4 (1 + 2 eta) in sc
    square = make("square", IN_PLANE)
    sc = make("sc", ALL)
    corner = square.wavevectors([[0.5, 0.5]])
    for direction in ((1.0, 0.0), (0.6, -0.8)):
        v = square.modes(corner, direction).group_velocities[0, 0]
        assert_allclose(
            v, math.sqrt(2.5 * ETA / (1 + ETA)) * np.array(direction), rtol=1e-14, atol=1e-15
        )
    v = sc.modes(sc.wavevectors([[0.5, 0.5, 0.5]]), (0.0, 1.0, 0.0)).group_velocities[0, :3]
    speed = math.sqrt(2.5 * ETA * (1 + ETA) / (1 + 2 * ETA))
    assert_allclose(v, [[0, 0, 0], [0, speed, 0], [0, speed, 0]], rtol=1e-14, atol=1e-14)
    # with all motions of a plane, branches stand in the order that they have beside the point
    every = make("square", ALL)
    at, beside = (every.modes(np.add(corner, [[step, 0.0]]), (1.0, 0.0)) for step in (0.0, 1e-6))
    assert_allclose(at.group_velocities[0, :3], beside.group_velocities[0, :3], atol=1e-5)
    # a branch that vanishes on a line has no slope along it
    line = sc.modes(sc.wavevectors([[0.5, 0.5, 0.2]]), (0.0, 0.0, 1.0))
    assert np.all(line.group_velocities[0, 0] == 0.0)
    assert line.frequencies[0, 0] == 0.0


def test_soft_modes_are_found_under_prestress():
    lattice = make("bcc", spacing=0.99, prestress=0.01)
    q = lattice.wavevectors([[0.5, -0.5, 0.5], [0.1, 0.2, 0.3], [0.0, 0.0, 0.0]])
    values = lattice.frequencies(q)
    assert np.count_nonzero(values == 0.0, axis=1).tolist() == [3, 0, 3]
    assert lattice.soft_mode_warnings(q, values)[0].startswith("3 modes vanish at 1 of 3")
    along = np.array(GENERIC[3])
    at = lattice.modes(q[:1], along)
    beside = lattice.modes(q[:1] + 1e-4 * along, along)
    assert_allclose(at.group_velocities[0, :3] @ along, beside.frequencies[0, :3] / 1e-4, rtol=1e-6)
    assert_allclose(at.group_velocities[0, :3], beside.group_velocities[0, :3], atol=1e-4)


def test_sound_at_gamma_and_its_copies_is_no_soft_mode():
    for name in ("chain", "square", "triangular", "fcc", "hcp"):
        lattice = make(name, ALL, bending=0.1, torsion=0.1)
        q = np.concatenate([np.zeros((1, lattice.periods)), lattice.reciprocal])
        values = lattice.frequencies(q)
        # on a line the torsional wave is sound too
        assert np.all(np.count_nonzero(values == 0.0, axis=1) == (4 if name == "chain" else 3))
        assert lattice.soft_mode_warnings(q, values) == ()
    assert lattice.soft_mode_warnings(1e-20 * q[1:], lattice.frequencies(1e-20 * q[1:])) == ()


# -- flexural branches against many digits ---------------------------------------------------------

FLEXURAL = [
    ("chain", ALL, {"bending": 0.03}),
    ("chain", IN_PLANE, {"bending": 1e-12}),
    ("square", OUT_OF_PLANE, {"bending": 0.03}),
    ("square", OUT_OF_PLANE, {"torsion": 0.03}),
    ("triangular", OUT_OF_PLANE, {}),
    ("triangular", ALL, {"bending": 1e-8}),
    ("honeycomb", OUT_OF_PLANE, {"bending": 0.03}),
    ("kagome", OUT_OF_PLANE, {"bending": 0.03, "torsion": 0.01}),
    ("kagome", OUT_OF_PLANE, {"torsion": 0.01}),
]


@pytest.mark.parametrize(
    ("name", "motions", "terms"),
    [
        *FLEXURAL,
        ("honeycomb", IN_PLANE, {}),
        ("diamond", ALL, {}),
        ("diamond", ALL, {"eta": 0.0}),
        ("honeycomb", IN_PLANE, {"eta": 0.0}),
        ("kagome", IN_PLANE, {"eta": 0.0}),
    ],
)
@pytest.mark.parametrize(
    ("size", "digits"),
    [pytest.param(1e-6, 60, marks=pytest.mark.slow), (1e-25, 180), (0.8, 40)],
)
def test_every_branch_keeps_its_digits(name, motions, terms, size, digits):
    lattice = make(name, motions, **terms)
    q = size * np.array(GENERIC[lattice.periods])
    values, exact = lattice.frequencies([q])[0], exact_frequencies(lattice, q, digits)
    free = lattice.free_branches
    assert np.all(values[:free] == 0.0)
    assert_allclose(values[free:], exact[free:], rtol=2e-13)


def slab(terms, masses=1.0):
    """Two square layers on top of each other: contacts need not balance here."""
    cell = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    positions = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return gp.ContactLattice(
        cell,
        positions,
        find_contacts(cell, positions, "slab"),
        ETA,
        motions=ALL,
        masses=masses,
        **terms,
    )


@pytest.mark.parametrize("masses", [1.0, (1.0, 2.5)])
def test_a_slab_bends_as_a_plate(masses):
    lattice = slab({}, masses)
    near, far = (lattice.modes([[0.6 * size, 0.8 * size]]) for size in (1e-9, 1e-5))
    assert near.frequencies[0, 0] / far.frequencies[0, 0] == pytest.approx(1e-8, rel=1e-9)
    assert far.group_velocities[0, 0] @ [0.6, 0.8] == pytest.approx(
        2 * far.frequencies[0, 0] / 1e-5, rel=1e-9
    )
    if masses == 1.0:
        q = [6e-6, 8e-6]
        assert_allclose(lattice.frequencies([q])[0], exact_frequencies(lattice, q, 60), rtol=1e-11)


# -- velocities and polarisation -------------------------------------------------------------------


def test_motions_in_and_out_of_the_plane_do_not_mix_where_they_cross():
    lattice = make("triangular", ALL, bending=0.05)
    q = scatter(lattice, 200)
    modes = lattice.modes(q)
    across = modes.eigenvectors.reshape(len(q), 6, 6)[:, [2, 3, 4]]
    part = np.sum(np.abs(across) ** 2, axis=1)
    assert np.all((part == 0.0) | (np.abs(part - 1.0) < 1e-14))
    parts = [
        modes.rotational_fraction,
        modes.longitudinal_fraction,
        modes.transverse_fraction,
        modes.out_of_plane_fraction,
    ]
    assert_allclose(np.sum(parts, axis=0), 1.0, atol=1e-14)
    assert_allclose(
        np.sum(parts, axis=2), np.array([3.0, 1.0, 1.0, 1.0])[:, None] * np.ones(len(q)), atol=1e-13
    )
    assert np.all(modes.out_of_plane_fraction[part == 0.0] == 0.0)
    assert np.all(modes.longitudinal_fraction[part > 0.5] == 0.0)


def test_at_gamma_a_flexural_wave_stands_still():
    modes = make("triangular", ALL).modes([[0.0, 0.0]], (0.6, 0.8))
    assert_allclose(modes.frequencies[0, :3], 0.0, atol=0)
    assert np.count_nonzero(np.linalg.norm(modes.group_velocities[0], axis=1)) >= 2
    bent = int(np.argmax(modes.out_of_plane_fraction[0]))
    assert modes.out_of_plane_fraction[0, bent] == pytest.approx(1.0)
    assert np.all(modes.group_velocities[0, bent] == 0.0)


def test_frequencies_of_blocks_alone_are_those_of_their_modes():
    # displacements along x and along y have no contact in common
    lattice = make("square", IN_PLANE, eta=0.0)
    q = np.random.default_rng(0).normal(size=(20, 2))
    expected = lattice.modes(q).frequencies
    np.testing.assert_array_equal(lattice.frequencies(q), expected)
    assert_allclose(expected, np.sort(2.0 * np.abs(np.sin(0.5 * q)), axis=1), rtol=1e-13)


def test_the_spin_of_a_ball_between_two_others_is_free_along_any_line():
    # triangular layers, a third of whose balls carry struts of two contacts: the middle ball may
    # spin about its strut, which is along no axis. That takes no part in sound; the layers shift on
    # their struts
    layer = np.array([[1.5, math.sqrt(0.75), 0.0], [0.0, math.sqrt(3.0), 0.0]])
    tall = np.array([0.4, 0.2, 0.0])
    tall[2] = math.sqrt(4.0 - tall @ tall)
    cell = np.array([*layer, tall])
    centres = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, math.sqrt(0.75), 0.0], 0.5 * tall])
    lattice = make(gp.Lattice("struts", cell, centres @ np.linalg.inv(cell)))
    assert lattice.free_branches == 1
    values = lattice.frequencies(scatter(lattice, 5))
    assert np.all(values[:, 0] == 0.0)
    assert np.all(values[:, 1] > 0.0)
    assert "strain" in lattice.mechanism


@pytest.mark.claim("membranes-bend")
@given(
    size=sizes, bending=st.floats(1e-3, 1.0), torsion=st.floats(1e-3, 1.0), eta=st.floats(0.05, 1.3)
)
def test_chain_in_closed_form_at_every_size(size, bending, torsion, eta):
    s = math.sin(size / 2)
    c = math.cos(size / 2)
    trace = eta * (4 * s**2 + 10 * c**2) + 40 * bending * s**2
    determinant = 160 * eta * bending * s**4
    high = math.sqrt((trace + math.sqrt(trace**2 - 4 * determinant)) / 2)
    low = math.sqrt(160 * eta * bending) * s**2 / high
    expected = sorted([2 * s, 2 * s * math.sqrt(10 * torsion), low, low, high, high])
    lattice = make("chain", ALL, eta, bending=bending, torsion=torsion)
    assert_allclose(lattice.frequencies([[size]])[0], expected, rtol=2e-14)
    without = make("chain", ALL, eta).frequencies([[size]])[0]
    pair = math.sqrt(eta * (4 * s**2 + 10 * c**2))
    assert_allclose(without, [0.0, 0.0, 0.0, *sorted([2 * s, pair, pair])], rtol=4e-15)


@pytest.mark.parametrize("name", ["chain", "square", "honeycomb"])
def test_a_larger_cell_has_as_many_free_branches_for_each_ball(name):
    one = make(name)
    cell = one.cell.copy()
    cell[0] *= 2.0
    lattice = gp.Lattice("double", cell.tolist(), double_sites(one).tolist())
    two = make(lattice)
    assert two.free_branches == 2 * one.free_branches
    q = scatter(one, 5)
    folded = np.sort(
        np.concatenate([one.frequencies(q), one.frequencies(q + two.reciprocal[0])], axis=1), axis=1
    )
    assert_allclose(two.frequencies(q), folded, atol=2e-14)
    assert np.all(np.count_nonzero(two.frequencies(q) == 0.0, axis=1) == two.free_branches)


def double_sites(lattice):
    fractions = lattice.positions[:, : lattice.periods] @ np.linalg.inv(
        lattice.cell[:, : lattice.periods]
    )
    shift = np.eye(lattice.periods)[0]
    return np.concatenate([fractions, fractions + shift]) / (1.0 + shift)


def test_a_line_and_a_crystal_have_no_plane():
    for name in ("chain", "fcc"):
        modes = make(name, ALL).modes([GENERIC[1 if name == "chain" else 3]])
        assert np.all(modes.out_of_plane_fraction == 0.0)
