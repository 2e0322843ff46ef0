"""Branches followed through crossings, and the zone they end in."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import granphon as gp
from granphon.balls.motions import IN_PLANE
from granphon.base.errors import InputError, UnreachableFrequencyError
from granphon.dynamics.branches import (
    connect_branches,
    find_zone_boundary,
    follow_acoustic_branches,
)

ETA = 2 * (1 - 0.276) / (2 - 0.276)
CORNER = 4 * math.pi / 3


def squares_along_the_row(q, eta):
    """Along Gamma-K the mirror y -> -y leaves u_x alone and mixes u_y with the rotation: L, lower,
    upper in closed form.
    """
    longitudinal = 2 * (1 - np.cos(q)) + (1 + 3 * eta) * (1 - np.cos(q / 2))
    shear = 2 * eta * (1 - np.cos(q)) + (3 + eta) * (1 - np.cos(q / 2))
    turning = 5 * eta * ((1 + np.cos(q)) + 2 * (1 + np.cos(q / 2)))
    coupling = math.sqrt(10.0) * eta * (np.sin(q) + np.sin(q / 2))
    root = np.hypot((shear - turning) / 2, coupling)
    return np.stack(
        [longitudinal, (shear + turning) / 2 - root, (shear + turning) / 2 + root], axis=-1
    )


def path(lattice, angle, n, stop=None):
    along = np.array([math.cos(angle), math.sin(angle)])
    return np.linspace(0.01, stop or find_zone_boundary(lattice, along), n), along


@pytest.mark.parametrize("eta", [0.2, 0.3, 0.5, ETA])
@pytest.mark.parametrize("points", [37, 301])
def test_branches_go_straight_through_the_crossing_on_the_mirror(eta, points):
    lattice = gp.ContactLattice.of("triangular", eta)
    # the crossing of L with the upper of the mixed pair
    crossing = brentq(
        lambda q: np.diff(squares_along_the_row(q, eta)[[2, 0]])[0], 1.0, 0.99 * CORNER, xtol=1e-15
    )
    wavenumbers, along = path(lattice, 0.0, points, 0.995 * CORNER)
    modes = lattice.modes(wavenumbers[:, None] * along)
    order = connect_branches(modes.eigenvectors)
    followed = np.take_along_axis(modes.frequencies, order, 1) ** 2
    lower, longitudinal, upper = followed.T
    assert_allclose(
        np.stack([longitudinal, lower, upper], axis=1),
        squares_along_the_row(wavenumbers, eta),
        atol=3e-14,
    )
    # L was second, and is third beyond the crossing; the lowest stays
    assert np.array_equal(order[:, 1], np.where(wavenumbers < crossing, 1, 2))
    assert np.all(order[:, 0] == 0)
    character = np.take_along_axis(modes.longitudinal_fraction, order, 1)
    assert_allclose(character, np.broadcast_to([0, 1, 0], character.shape), atol=1e-12)


def test_branches_touch_without_crossing_at_the_avoided_one():
    # three degrees off the mirror the pair repels: the order stays, the character is exchanged
    lattice = gp.ContactLattice.of("triangular", 0.3)
    wavenumbers, along = path(lattice, math.radians(3.0), 2001)
    modes = lattice.modes(wavenumbers[:, None] * along)
    gap = modes.frequencies[:, 2] - modes.frequencies[:, 1]
    nearest = np.argmin(gap)
    assert 0.01 < gap[nearest] < 0.03
    assert 2.5 < wavenumbers[nearest] < 2.7
    assert np.array_equal(
        connect_branches(modes.eigenvectors), np.broadcast_to([0, 1, 2], (2001, 3))
    )
    before, after = np.searchsorted(wavenumbers, wavenumbers[nearest] + np.array([-0.3, 0.3]))
    assert_allclose(modes.longitudinal_fraction[[before, after], 1], [1, 0], atol=0.05)
    assert_allclose(modes.longitudinal_fraction[[before, after], 2], [0, 1], atol=0.05)
    # steps much longer than the gap jump it, as a wave packet would
    coarse = connect_branches(modes.eigenvectors[::200])
    assert coarse[-1].tolist() == [0, 2, 1]


@given(seed=st.integers(0, 2**31))
def test_order_of_the_columns_does_not_matter(seed):
    lattice = gp.ContactLattice.of("triangular", ETA)
    wavenumbers, along = path(lattice, 0.0, 40, 0.99 * CORNER)
    modes = lattice.modes(wavenumbers[:, None] * along)
    shuffled = np.random.default_rng(seed).permuted(np.tile(np.arange(3), (40, 1)), axis=1)
    shuffled[0] = [0, 1, 2]
    vectors = np.take_along_axis(modes.eigenvectors, shuffled[:, None], 2)
    values = np.take_along_axis(modes.frequencies, shuffled, 1)
    followed = np.take_along_axis(values, connect_branches(vectors), 1)
    expected = np.take_along_axis(modes.frequencies, connect_branches(modes.eigenvectors), 1)
    assert_allclose(followed, expected, atol=0)


@pytest.mark.parametrize(
    ("lattice", "angle", "edge"),
    [
        ("triangular", 0.0, 4 * math.pi / 3),
        ("triangular", math.pi / 2, 2 * math.pi / math.sqrt(3)),
        ("triangular", math.pi / 6, 2 * math.pi / math.sqrt(3)),
        ("triangular", 0.1, 2 * math.pi / math.sqrt(3) / math.cos(math.pi / 6 - 0.1)),
        ("square", 0.0, math.pi),
        ("square", math.pi / 4, math.pi * math.sqrt(2)),
        ("kagome", 0.0, 2 * math.pi / 3),
    ],
)
def test_edge_of_the_zone(lattice, angle, edge):
    contacts = gp.ContactLattice.of(lattice, ETA)
    assert_allclose(
        find_zone_boundary(contacts, (math.cos(angle), math.sin(angle))), edge, rtol=1e-14
    )


def test_edge_of_the_zone_of_a_skewed_cell():
    skewed = gp.ContactLattice.of(gp.Lattice("skewed", ((1.0, 0.0), (2.5, math.sqrt(0.75)))), ETA)
    straight = gp.ContactLattice.of("triangular", ETA)
    for angle in np.linspace(0, math.pi, 9):
        along = (math.cos(angle), math.sin(angle))
        assert_allclose(
            find_zone_boundary(skewed, along), find_zone_boundary(straight, along), rtol=1e-13
        )


@pytest.mark.parametrize("eta", [0.0, ETA])
@pytest.mark.parametrize("direction", [(1, 0), (0, 1), (0.3, 0.7), (-1, 0.2)])
def test_acoustic_branches_rise_to_their_top(twin, eta, direction):
    lattice = gp.ContactLattice.of("triangular", eta)
    along = np.asarray(direction) / np.hypot(*direction)
    branches = follow_acoustic_branches(lattice, direction)
    assert set(branches) == {"longitudinal", "transverse"}
    for branch in branches.values():
        assert np.all(np.diff(branch.frequencies) > 0.0)
        assert branch.top == branch.frequencies[-1]
        # every point is a frequency of the twin
        for q, value in zip(branch.wavenumbers[::16], branch.frequencies[::16], strict=True):
            assert np.min(np.abs(twin.frequencies(twin.hexagon(), q * along, eta) - value)) < 1e-13
    slow = branches["transverse"]
    fast = branches["longitudinal"]
    assert_allclose(
        slow.frequencies[0] / slow.wavenumbers[0], math.sqrt(3 / 8 * (1 + eta)), rtol=1e-3
    )
    assert_allclose(
        fast.frequencies[0] / fast.wavenumbers[0], math.sqrt(9 / 8 * (1 + eta / 3)), rtol=1e-3
    )


def test_top_of_the_longitudinal_branch_along_the_row():
    # the first maximum of L in closed form: it lies before K
    for eta in (0.0, ETA):
        grid = np.linspace(0.01, CORNER, 200001)
        top = np.sqrt(squares_along_the_row(grid, eta)[:, 0].max())
        branch = follow_acoustic_branches(gp.ContactLattice.of("triangular", eta), (1, 0))[
            "longitudinal"
        ]
        assert_allclose(branch.top, top, rtol=1e-9)


@pytest.fixture(scope="module")
def along_the_row():
    return follow_acoustic_branches(gp.ContactLattice.of("triangular", ETA), (1, 0))


@given(part=st.floats(-12.0, -1e-9), name=st.sampled_from(["longitudinal", "transverse"]))
def test_wavenumber_inverts_the_branch(along_the_row, part, name):
    branch = along_the_row[name]
    target = 10.0**part * branch.top
    q, velocities = branch.find_pulse(target)
    with mpmath.workdps(60):
        x = mpmath.mpf(q[0])
        eta = mpmath.mpf(ETA)
        cos = mpmath.cos
        sin = mpmath.sin
        longitudinal = 2 * (1 - cos(x)) + (1 + 3 * eta) * (1 - cos(x / 2))
        shear = 2 * eta * (1 - cos(x)) + (3 + eta) * (1 - cos(x / 2))
        turning = 5 * eta * (3 + cos(x) + 2 * cos(x / 2))
        coupling = mpmath.sqrt(10) * eta * (sin(x) + sin(x / 2))
        lower = (shear + turning) / 2 - mpmath.sqrt((shear - turning) ** 2 / 4 + coupling**2)
        exact = mpmath.sqrt(longitudinal if name == "longitudinal" else lower)
        assert abs(exact / target - 1) < 1e-14
    assert velocities[0] @ branch.direction > 0.0


def test_wavenumber_above_the_top():
    branch = follow_acoustic_branches(gp.ContactLattice.of("triangular", ETA), (0, 1))["transverse"]
    assert branch.find_pulse(branch.top)[0][0] <= branch.wavenumbers[-1] * (1 + 1e-15)
    with pytest.raises(UnreachableFrequencyError, match="branch ends"):
        branch.find_pulse([0.1, branch.top * (1 + 1e-12)])


@pytest.mark.parametrize("frequency", [-0.1, math.nan, [0.1, math.inf]])
def test_frequencies_of_pulses_are_finite_and_not_below_zero(hexagonal, frequency):
    branch = follow_acoustic_branches(hexagonal, (1.0, 0.0))["longitudinal"]
    with pytest.raises(InputError, match="frequency"):
        branch.find_pulse(frequency)


@pytest.mark.parametrize("shape", [(3, 3), (0, 3, 3)])
def test_branches_are_connected_from_eigenvectors_at_points(shape):
    with pytest.raises(InputError, match="shape"):
        connect_branches(np.zeros(shape))


@pytest.mark.parametrize("vectors", [np.full((2, 2, 2), np.nan), [[["a"]], [["b"]]]])
def test_branches_are_connected_from_finite_numbers(vectors):
    with pytest.raises(InputError, match="finite numbers"):
        connect_branches(vectors)


def test_a_branch_that_stays_at_zero_has_pulses_of_frequency_zero():
    chain = gp.ContactLattice.of("chain", 0.8, motions=IN_PLANE)
    branch = follow_acoustic_branches(chain, (1.0,))["transverse"]
    assert branch.top == 0.0
    wavenumbers, velocities = branch.find_pulse([0.0])
    assert wavenumbers == 0.0
    assert velocities == 0.0


def test_frequencies_of_pulses_have_one_axis(hexagonal):
    branch = follow_acoustic_branches(hexagonal, (1.0, 0.0))["transverse"]
    with pytest.raises(InputError, match="shape"):
        branch.find_pulse([[0.1, 0.2]])


def test_branches_need_one_direction(hexagonal):
    with pytest.raises(InputError, match="one direction"):
        follow_acoustic_branches(hexagonal, [(1, 0), (0, 1)])
