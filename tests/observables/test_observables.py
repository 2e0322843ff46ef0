"""Pulses of finite frequency, and what the observables refuse."""

from __future__ import annotations

import itertools
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import minimize_scalar

import granphon as gp
from granphon.base.errors import InputError, UnreachableFrequencyError
from granphon.media.state import NetworkState

DIRECTIONS = [(1.0, 0.0), (0.0, 1.0), (0.3, 0.7)]
NAMES = ("longitudinal", "transverse")


def exact_pulse(twin, state, frequency, direction, name, finite_overlap=False):
    """Wavenumber, phase and group velocity in SI at 30 digits: the root of det(D(q) - omega^2) on
    the right branch.
    """
    packing = state.packing
    eta, d = mpmath.mpf(packing.mindlin_ratio), mpmath.mpf(packing.diameter)
    k = mpmath.mpf(state.normal_stiffness)
    mass = mpmath.mpf(packing.mass)
    unit = mpmath.sqrt(k / mass)
    terms = {}
    if finite_overlap:
        spacing = 1 - mpmath.mpf(state.overlap) / d
        terms = {"spacing": spacing, "prestress": mpmath.mpf(state.force) / (k * d * spacing)}
    length = mpmath.hypot(*(mpmath.mpf(x) for x in direction))
    along = [mpmath.mpf(x) / length for x in direction]
    omega = 2 * mpmath.pi * mpmath.mpf(frequency) / unit
    hexagon = twin.exact_hexagon()
    branch = {"longitudinal": 1, "transverse": 0}[name]

    def value(q):
        return mpmath.sqrt(
            twin.exact_squares(hexagon, [q * x for x in along], eta, **terms)[branch]
        )

    # the root on the branch, from its slope at long waves ...
    start = omega / (value(mpmath.mpf("1e-8")) * mpmath.mpf("1e8"))
    q = mpmath.findroot(
        lambda x: value(x) / omega - 1, (start, 1.01 * start), solver="secant", tol=1e-50
    )

    # ... where the determinant vanishes: its relative error is below 1e-20 of q
    def determinant(x):
        matrix = twin.exact_matrix(
            hexagon, [x * c for c in along], eta, **terms
        ) - omega**2 * mpmath.eye(2 + bool(eta))
        a = matrix[0, 0]
        b = matrix[0, 1]
        c = matrix[1, 0]
        d = matrix[1, 1]
        if not eta:
            return mpmath.re(a * d - b * c)
        e = matrix[0, 2]
        f = matrix[1, 2]
        g = matrix[2, 0]
        h = matrix[2, 1]
        i = matrix[2, 2]
        return mpmath.re(a * (d * i - f * h) - b * (c * i - f * g) + e * (c * h - d * g))

    step = mpmath.mpf("1e-12")
    before = determinant(q * (1 - step))
    after = determinant(q * (1 + step))
    assert before * after < 0
    assert abs(determinant(q) / (after - before)) * step < mpmath.mpf("1e-20")
    slope = (value(q * (1 + step)) - value(q * (1 - step))) / (2 * step * q)
    return (
        q / packing.diameter,
        omega / q * unit * packing.diameter,
        slope * unit * packing.diameter,
    )


#: with and without friction, direction, frequency in Hz
PULSES = list(itertools.product((True, False), DIRECTIONS, (65.0, 15000.0)))


@pytest.mark.claim("api-waves")
@pytest.mark.parametrize(
    ("friction", "direction", "frequency"),
    [
        pytest.param(*case, marks=[pytest.mark.slow] * (place not in (0, 3, 5, 10)))
        for place, case in enumerate(PULSES)
    ],
)
def test_pulses_solve_the_dispersion_relation(twin, steel, friction, direction, frequency):
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3, friction=friction)).at_force(18.446)
    pulse = gp.pulse_velocities(state, frequency, direction)
    with mpmath.workdps(40):
        for row, name in enumerate(NAMES):
            q, phase, group = exact_pulse(twin, state, frequency, direction, name)
            assert abs(pulse.wavenumber[row] / q - 1) < 1e-13
            assert abs(pulse.phase[row] / phase - 1) < 1e-13
            assert abs(pulse.group[row] / group - 1) < 1e-12


@pytest.mark.parametrize(
    ("friction", "direction"),
    [
        (True, DIRECTIONS[2]),
        (False, DIRECTIONS[0]),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                (True, DIRECTIONS[0]),
                (True, DIRECTIONS[1]),
                (False, DIRECTIONS[1]),
                (False, DIRECTIONS[2]),
            )
        ),
    ],
)
def test_pulses_at_finite_overlap(twin, steel, friction, direction):
    medium = gp.AveragedLattice(gp.Packing(steel, 8e-3, friction=friction))
    bare = gp.pulse_velocities(medium.at_overlap(0.01 * 8e-3), 30000.0, direction)
    state = medium.at_overlap(0.01 * 8e-3, finite_overlap=True)
    pulse = gp.pulse_velocities(state, 30000.0, direction)
    assert np.all(np.abs(pulse.phase / bare.phase - 1) > 1e-3)
    with mpmath.workdps(40):
        for row, name in enumerate(NAMES):
            q, phase, group = exact_pulse(
                twin, state, 30000.0, direction, name, finite_overlap=True
            )
            assert abs(pulse.wavenumber[row] / q - 1) < 1e-12
            assert abs(pulse.phase[row] / phase - 1) < 1e-12
            assert abs(pulse.group[row] / group - 1) < 1e-11


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_pulses_of_the_experiment_are_slower_than_long_waves(state, direction):
    # 6.5 kHz on the steel array: the limit is not what a pulse shows
    limit = gp.sound_velocities(state)
    pulse = gp.pulse_velocities(state, 6500.0, direction)
    assert np.all(pulse.group < 0.99 * np.array([limit.longitudinal, limit.transverse]))
    assert np.all(pulse.group < pulse.phase)
    assert_allclose(2 * math.pi * 6500.0 / pulse.wavenumber, pulse.phase, rtol=1e-15)


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("finite_overlap", [False, True])
def test_pulses_tend_to_long_waves_at_second_order(packing, direction, finite_overlap):
    state = gp.AveragedLattice(packing).at_force(18.446, finite_overlap=finite_overlap)
    limit = gp.sound_velocities(state)
    limit = np.array([limit.longitudinal, limit.transverse])
    frequencies = 2000.0 / 2.0 ** np.arange(4)
    if finite_overlap:
        pulses = [gp.pulse_velocities(state, f, direction) for f in frequencies]
        phase, group = (
            np.stack([getattr(p, name) for p in pulses], axis=1) for name in ("phase", "group")
        )
    else:
        pulses = gp.pulse_velocities(state, frequencies, direction)
        phase = pulses.phase
        group = pulses.group
    for velocity in (phase, group):
        error = 1 - velocity / limit[:, None]
        assert_allclose(np.log2(error[:, :-1] / error[:, 1:]), 2.0, atol=0.01)
    # omega = v q (1 - c q^2): the group velocity falls three times as fast
    assert_allclose(
        (limit[:, None] - group)[:, -1] / (limit[:, None] - phase)[:, -1], 3.0, rtol=1e-2
    )


@given(part=st.floats(-12.0, -8.0), angle=st.floats(0.0, 7.0))
def test_pulses_are_long_waves_down_to_a_trillionth_of_the_top(state, part, angle):
    limit = gp.sound_velocities(state)
    top = 5.02 * state.scales.frequency
    pulse = gp.pulse_velocities(state, 10.0**part * top, (math.cos(angle), math.sin(angle)))
    expected = [limit.longitudinal, limit.transverse]
    assert_allclose(pulse.phase, expected, rtol=1e-14)
    assert_allclose(pulse.group, expected, rtol=1e-13)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_frequency_out_of_reach_names_the_top_of_the_branch(twin, state, direction, name):
    along = np.asarray(direction) / np.hypot(*direction)
    hexagon = twin.hexagon()
    # off the mirrors branches do not cross: transverse is the lowest and longitudinal the second;
    # along them they may, and the longitudinal one is known by its motion
    mixed = direction == (0.3, 0.7)

    def value(q):
        squares, vectors = np.linalg.eigh(
            twin.matrix(hexagon, q * along, state.packing.mindlin_ratio)
        )
        if mixed:
            return np.sqrt(squares[1 if name == "longitudinal" else 0])
        ahead = np.abs(along @ vectors[:2]) ** 2
        pick = np.argmax(ahead) if name == "longitudinal" else np.flatnonzero(ahead < 0.5)[0]
        return np.sqrt(squares[pick])

    edge = np.pi * 4 / 3 if direction == (1.0, 0.0) else None
    if edge is None:
        # the nearest edge of the hexagon of inner radius 2 pi/sqrt(3)
        sides = [
            np.array(
                [math.cos(p * math.pi / 3 + math.pi / 6), math.sin(p * math.pi / 3 + math.pi / 6)]
            )
            for p in range(6)
        ]
        edge = 2 * math.pi / math.sqrt(3) / max(side @ along for side in sides)
    grid = np.linspace(1e-3, edge, 100)
    values = np.array([value(q) for q in grid])
    first = np.flatnonzero(np.diff(values) < 0.0)
    if first.size:
        near = grid[max(first[0] - 1, 0)], grid[first[0] + 1]
        top = value(
            minimize_scalar(
                lambda q: -value(q), bounds=near, method="bounded", options={"xatol": 1e-10}
            ).x
        )
    else:
        top = values[-1]
    hertz = top * state.scales.frequency
    with pytest.raises(
        UnreachableFrequencyError,
        match=f"{name} branch .* {hertz:.6g} Hz",
    ):
        gp.pulse_velocities(state, 1.001 * hertz, direction, branches=(name,))
    gp.pulse_velocities(state, 0.999999 * hertz, direction, branches=(name,))


def test_branches_that_reach_are_given_in_the_order_asked(state):
    both = gp.pulse_velocities(state, 6500.0)
    turned = gp.pulse_velocities(state, 6500.0, branches=("transverse", "longitudinal"))
    assert_allclose(turned.phase[::-1], both.phase, rtol=1e-14)
    assert turned.branches == ("transverse", "longitudinal")
    alone = gp.pulse_velocities(state, 6500.0, branches=("transverse",))
    assert alone.phase.shape == (1,)
    # 35 kHz is above the transverse branch, and below the longitudinal one
    assert gp.pulse_velocities(state, 35000.0, branches=("longitudinal",)).phase.shape == (1,)
    with pytest.raises(UnreachableFrequencyError, match="transverse"):
        gp.pulse_velocities(state, 35000.0)


def test_the_error_names_a_frequency_that_is_out_of_reach(packing):
    """Not the higher one of another load, at which the branch reaches it."""
    states = gp.AveragedLattice(packing).at_force([0.01, 1000.0])
    gp.pulse_velocities(states[1], 25000.0)
    with pytest.raises(UnreachableFrequencyError, match="does not reach 10000 Hz"):
        gp.pulse_velocities(states, [10000.0, 25000.0])


@pytest.mark.parametrize("frequency", [1e300, 1e308, [1.0, 1.7e308]])
def test_frequencies_near_the_largest_number_are_out_of_reach(state, frequency):
    with pytest.raises(UnreachableFrequencyError, match=r"branch .*e\+30"):
        gp.pulse_velocities(state, frequency)


@pytest.mark.parametrize("frequency", [5e-324, [1.0, 1e-306]])
def test_frequencies_without_digits_are_refused(state, frequency):
    with pytest.raises(InputError, match="has lost digits"):
        gp.pulse_velocities(state, frequency)


def test_a_wide_spread_is_warned_of():
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    for width, fine in ((2.04e-6, True), (0.8e-3, True), (0.9e-3, False), (7e-3, False)):
        medium = gp.AveragedForce(gp.Packing(steel, 8e-3, gp.Uniform(width)))
        state = medium.at_overlap(np.array([4.0, 5.0]) * width if width < 1e-3 else 1e-4)
        check = gp.validity(state)["spread"]
        assert np.all(check.ok == fine)
        np.testing.assert_allclose(check.value, width / np.sqrt(12.0) / 8e-3, rtol=1e-14)
        assert np.shape(check.value) == state.shape
    assert "spread" not in [
        check.name
        for check in gp.validity(gp.AveragedLattice(gp.Packing(steel, 8e-3)).at_force(1.0)).checks
    ]


# -- many directions -------------------------------------------------------------------------------

ANGLES = np.linspace(0.0, 2.0 * np.pi, 13)
MANY = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)


def test_many_directions_of_a_simulation(steel):
    packing = gp.Packing(steel, 8e-3, gp.Uniform(2.04e-6))
    state = gp.DirectSimulation(packing, (6, 6), samples=2).at_force([5.0, 18.0])
    one = gp.sound_velocities(state)
    many = gp.sound_velocities(state, MANY)
    for name in (*NAMES, "longitudinal_error", "transverse_error"):
        assert_allclose(
            getattr(many, name), np.repeat(getattr(one, name)[:, None], 13, axis=1), rtol=1e-15
        )
    pulses = gp.pulse_velocities(state, 3000.0, MANY)
    assert_allclose(
        pulses.group[:, 1, 3], gp.pulse_velocities(state[1], 3000.0, MANY[3]).group, rtol=1e-12
    )


@pytest.mark.parametrize("direction", [(1.0, 0.3), (0.2, 1.0), (1.0, 0.0)])
def test_the_group_velocity_is_the_gradient_of_the_frequency(steel, direction):
    """By differences of the bands across the wave vector; on the square lattice it points
    elsewhere.
    """
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice="square")).at_force(18.446)
    pulse = gp.pulse_velocities(state, 6000.0, direction)
    lattice = gp.ContactLattice.of("square", state.packing.mindlin_ratio)
    d = 8e-3
    for row, branch in enumerate((1, 0)):
        q = pulse.wavenumber[row] * pulse.direction * d
        step = 1e-4
        ends = np.array([q + sign * step * axis for axis in np.eye(2) for sign in (1.0, -1.0)])
        omega = lattice.frequencies(ends)[:, branch] * state.scales.frequency * 2.0 * np.pi
        expected = (omega[::2] - omega[1::2]) / (2.0 * step / d)
        assert_allclose(pulse.group_vector[row], expected, rtol=1e-6, atol=1e-6 * pulse.group[row])
    across = np.abs(pulse.group_vector @ [-pulse.direction[1], pulse.direction[0]]) / pulse.group
    assert np.all(across < 1e-12) if direction[1] == 0.0 else np.all(across > 0.02)


@pytest.mark.parametrize(
    "direction",
    [
        (0.0, 0.0),
        [(1, 0), (0, 0)],
        (np.nan, 1.0),
        (np.inf, 1.0),
        (1, 0, 0),
        3.0,
        "x",
        np.zeros((0, 2)),
        np.ones((2, 2, 2)),
        [(1, 0), (1,)],
    ],
)
def test_a_direction_that_is_none_is_one_error(state, direction):
    for find in (
        gp.sound_velocities,
        lambda state, along: gp.pulse_velocities(state, 6500.0, along),
    ):
        with pytest.raises(InputError, match=r"^direction(: found| is)") as told:
            find(state, direction)
        # what is no array of numbers is told so, as of any argument
        assert ("x and y, not both zero" in str(told.value)) != ("a real number" in str(told.value))


@pytest.mark.parametrize(
    ("lattice", "finite"),
    [
        ("triangular", False),
        pytest.param("triangular", True, marks=pytest.mark.slow),
        ("square", False),
        ("square", True),
        pytest.param("kagome", False, marks=pytest.mark.slow),
    ],
)
def test_many_directions_are_each_of_them(steel, lattice, finite):
    medium = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice=lattice))
    loads = np.array([[18.446], [2000.0]])
    frequencies = np.array([900.0, 3000.0, 5000.0])
    state = medium.at_force(loads, finite_overlap=finite)
    many = gp.sound_velocities(state, 7.0 * MANY)
    pulses = gp.pulse_velocities(state, frequencies, 7.0 * MANY)
    assert many.longitudinal.shape == many.transverse.shape == (2, 1, 13)
    assert pulses.group.shape == pulses.phase.shape == pulses.wavenumber.shape == (2, 2, 3, 13)
    assert pulses.group_vector.shape == (2, 2, 3, 13, 2)
    assert_allclose(many.direction, MANY, atol=1e-15)
    for place in (2, 9):
        direction = MANY[place]
        one = gp.sound_velocities(state, direction)
        pulse = gp.pulse_velocities(state, frequencies, direction)
        for name in NAMES:
            assert getattr(one, name).shape == (2, 1)
            assert_allclose(getattr(many, name)[..., place], getattr(one, name), rtol=1e-13)
        for name in ("phase", "group", "wavenumber"):
            assert_allclose(getattr(pulses, name)[..., place], getattr(pulse, name), rtol=1e-12)
        assert_allclose(
            pulses.group_vector[..., place, :],
            pulse.group_vector,
            rtol=1e-9,
            atol=1e-9 * pulse.group.max(),
        )
        assert_allclose(pulse.group_vector @ pulse.direction, pulse.group, rtol=1e-13)


@pytest.mark.parametrize(
    ("density", "told"), [(7.84, True), (19.3, True), (22.6, False), (7840.0, False)]
)
def test_a_density_in_grams_per_cubic_centimetre_is_told(density, told):
    state = gp.AveragedLattice(gp.Packing(gp.Material(200e9, 0.3, density), 8e-3)).at_force(1.0)
    warning = gp.validity(state)["density"].warning
    assert (warning is not None) == told
    assert not told or f"{density:g} kg/m^3" in warning


def test_a_wrong_direction_is_refused_before_many_balls_are_relaxed(packing, monkeypatch):
    def relax(*_):
        raise AssertionError("the relaxation has begun")

    network = gp.AveragedLattice(packing).at_force(1.0).network
    monkeypatch.setattr(NetworkState, "relax_inner_motions", relax)
    with pytest.raises(InputError, match="direction"):
        gp.sound_velocities(network, [1.0, 0.0, 0.0])


@pytest.mark.parametrize("find", [gp.sound_velocities, gp.moduli, gp.find_nonaffine])
def test_a_progress_of_another_kind_is_named(find):
    state = gp.AveragedLattice(gp.Packing(gp.Material(70e9, 0.22, 2500.0), 1e-3)).at_force(1.0)
    with pytest.raises(InputError, match="progress is 3"):
        find(state, progress=3)
