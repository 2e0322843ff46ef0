"""Pulses through networks of contacts: against closed forms of chains, dense matrices, another
integrator, and the bands.
"""

import inspect
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import jv

import granphon as gp
from granphon.balls.motions import allowed_motions
from granphon.base.errors import InputError, InstabilityError, UnreachableFrequencyError
from granphon.dynamics.damping import GivenLosses, Losses
from granphon.waves.estimates import WaveEstimate
from granphon.waves.modes import is_stable
from granphon.waves.operator import WaveOperator, make_operator
from granphon.waves.propagation import Propagation, Spans, ToneBurst, ViscousPropagation
from granphon.waves.pulses import (
    Course,
    Pulse,
    PulseSource,
    average_pulses,
    drop_falling,
    find_arrivals,
    transmit,
)
from granphon.waves.settings import PulseSettings
from tests.packings import balance

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
UNITS = gp.Units(8e-3, 3e6, 2e-3)
D = UNITS.length
OMEGA = UNITS.angular_frequency
#: (k/M)^1/2 / 2 pi, Hz
HERTZ = OMEGA / (2.0 * np.pi)


def ideal(name, shape, mindlin_ratio=0.8, **more):
    return gp.ContactLattice.of(name, mindlin_ratio, **more).contact_network(UNITS).repeat(shape)


def chain(count):
    return ideal("chain", (count,), 0.0)


def slower(quick, cases):
    """Cases, each a tuple, of which all but those of ``quick`` are slow."""
    return [
        case if case in quick else pytest.param(*case, marks=pytest.mark.slow) for case in cases
    ]


@pytest.fixture(scope="module")
def disordered():
    """A triangular array whose contacts have stiffnesses from a third to five thirds of the
    mean.
    """
    network = ideal("triangular", (5, 12))
    factor = np.random.default_rng(5).uniform(1 / 3, 5 / 3, network.n_contacts)
    return replace(
        network,
        normal_stiffness=factor * network.normal_stiffness,
        shear_stiffness=factor * network.shear_stiffness,
    )


def convolve(kernel, burst, times, count=160):
    """The integral of kernel(t - t') s(t') over t' up to t, by Gauss and Legendre's rule on each
    half period.
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    found = np.zeros(np.shape(times))
    for place, t in np.ndenumerate(times):
        end = min(t, burst.duration)
        past = 0.5 * end * (nodes + 1.0)
        found[place] = 0.5 * end * np.sum(weights * kernel(t - past) * burst(past))
    return found


# -- closed forms ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ends", "image"), [("periodic", None), ("free", (1.0, 1)), ("walls", (-1.0, 2))]
)
def test_chain_responds_with_the_bessel_functions_of_schroedinger(ends, image):
    # ball n answers to a unit of momentum of ball 0 with J_2n(2 (k/M)^1/2 t)/M; a free end adds the
    # image in phase of a ball one behind the source, a wall that holds the ball there the image out
    # of phase of a ball two behind
    pulse = gp.Waves(chain(60)).transmit(
        0.6 * HERTZ,
        (1,),
        8.4 * D,
        cycles=2,
        source="ball",
        ends=ends,
        duration=14.0 / HERTZ / (2 * np.pi) * 2.0,
    )
    assert pulse.distance == pytest.approx(8.0 * D)
    times = pulse.times[:: len(pulse.times) // 9]

    def kernel(t):
        found = jv(16, 2.0 * OMEGA * t)
        return found if image is None else found + image[0] * jv(16 + 2 * image[1], 2.0 * OMEGA * t)

    expected = convolve(kernel, ToneBurst(pulse.frequency, 2.0), times) / UNITS.mass
    np.testing.assert_allclose(
        pulse.signals[0, :: len(pulse.times) // 9],
        expected,
        atol=1e-12 * np.max(np.abs(pulse.signals)),
    )
    assert np.max(np.abs(expected)) > 0.1 * np.max(np.abs(pulse.signals))


@pytest.mark.claim("pulses-bandwidth")
def test_envelope_travels_with_the_group_velocity_to_second_order_in_the_bandwidth():
    lattice = gp.ContactLattice.of("triangular", 0.8)
    height = np.sqrt(0.75)
    q = np.linspace(0.0, np.pi / height, 400)[1:-1]
    modes = lattice.modes(q[:, None] * [0.0, 1.0])
    branch = np.argmax(modes.longitudinal_fraction, axis=1)
    omega = np.take_along_axis(modes.frequencies, branch[:, None], 1)[:, 0]
    at = int(np.argmin(np.abs(omega - 1.0)))
    group = modes.group_velocities[at, branch[at], 1] * D * OMEGA
    errors = []
    for cycles in (10, 20, 40):
        lasting = cycles / (omega[at] * HERTZ)
        network = ideal("triangular", (1, int(60.0 + 1.5 * group * lasting / D)))
        pulse = gp.Waves(network).transmit(
            omega[at] * HERTZ,
            (0, 1),
            20.0 * D,
            cycles,
            ends="periodic",
            duration=lasting + 1.6 * 20.0 * D / group,
        )
        errors.append(abs(pulse.velocity / group - 1.0))
    assert errors[2] < 1e-4
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.1)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("name", "shape", "direction", "polarisation", "hertz"),
    [
        ("fcc", (1, 1, 260), (1, 1, -1), "longitudinal", 0.9),
        ("square", (300, 1), (1, 0), "transverse", 0.5),
        ("chain", (500,), (1,), "longitudinal", 1.2),
        ("kagome", (1, 150), (0, 1), "longitudinal", 0.5),
    ],
)
def test_envelope_travels_with_the_group_velocity_in_other_lattices(
    name, shape, direction, polarisation, hertz
):
    lattice = gp.ContactLattice.of(name, 0.0 if name == "chain" else 0.8)
    network = lattice.contact_network(UNITS).repeat(shape)
    along = np.array(direction) / np.linalg.norm(direction)
    pulse = gp.Waves(network).transmit(
        hertz * HERTZ,
        direction,
        25.0 * D,
        20,
        polarisation,
        ends="periodic",
        duration=40.0 / (hertz * HERTZ),
    )
    # of the branches at this frequency the one whose balls move along the polarisation
    q = np.linspace(0.01, 3.0, 3000)
    modes = lattice.modes(q[:, None] * along)
    axes = list(lattice.motions.translations)
    part = (
        np.abs(np.einsum("i,qib->qb", pulse.polarisation[axes], modes.eigenvectors[:, : len(axes)]))
        ** 2
    )
    near = np.where(part > 0.3, np.abs(modes.frequencies - hertz), np.inf)
    at = np.unravel_index(np.argmin(near), near.shape)
    group = modes.group_velocities[at] @ along * D * OMEGA
    assert pulse.velocity == pytest.approx(group, rel=3e-3)


def test_long_waves_arrive_alike_by_all_three_readings():
    lattice = gp.ContactLattice.of("triangular", 0.8)
    sound = lattice.sound_velocities((0.0, 1.0))[0] * D * OMEGA
    for name, velocity in zip(lattice.wave_names, sound, strict=True):
        pulse = gp.Waves(ideal("triangular", (1, 640))).transmit(
            0.06 * HERTZ,
            (0, 1),
            150.0 * D,
            1.5,
            name,
            ends="periodic",
            duration=1.5 / (0.06 * HERTZ) + 1.3 * 150.0 * D / velocity,
        )
        for method in ("envelope", "first", "correlation"):
            assert pulse.distance / pulse.arrival(method) == pytest.approx(velocity, rel=4e-3)
        assert pulse.velocity == pytest.approx(pulse.distance / pulse.time_of_flight)


# -- twins -----------------------------------------------------------------------------------------


def integrate(waves, pulse, burst, viscous, times, method="DOP853", rtol=1e-11, atol=1e-15):
    """Displacements and velocities of all motions at ``times``, mass-weighted, (2, size, n_t), by
    an integrator of scipy.
    """
    matrix = waves.operator.matrix
    size = waves.operator.size
    push = np.zeros((waves.network.n_balls, 3))
    push[pulse.sources, :2] = pulse.polarisation[:2] / np.sqrt(UNITS.mass)

    def change(t, state):
        x = state[:size]
        v = state[size:]
        return np.concatenate([v, push.ravel() * burst(np.array(t)) - matrix @ x - viscous @ v])

    order = np.argsort(times)
    options = {"rtol": rtol, "atol": atol}
    if method == "Radau":
        whole = [[np.zeros((size, size)), np.eye(size)], [-matrix.toarray(), -viscous.toarray()]]
        options["jac"] = np.block(whole)
    found = solve_ivp(
        change, (0.0, np.max(times)), np.zeros(2 * size), method, times[order], **options
    )
    states = np.empty_like(found.y)
    states[:, order] = found.y
    return states.reshape(2, size, -1)


@pytest.mark.parametrize("damping", [0.0, 0.02, pytest.param(3.0, marks=pytest.mark.slow)])
def test_signals_and_states_are_those_of_another_integrator(disordered, damping):
    tau = damping / OMEGA
    waves = gp.Waves(disordered)
    burst = ToneBurst(0.5 * HERTZ, 2.0)
    pulse = waves.transmit(
        0.5 * HERTZ,
        (0, 1),
        4.0 * D,
        2,
        "transverse",
        source=[3, 17],
        ends="periodic",
        damping=tau,
        duration=30.0 / OMEGA,
        frames=[5.0 / OMEGA, 29.0 / OMEGA],
    )
    matrix, few = waves.operator.matrix, np.arange(0, pulse.times.size, 10)
    when = np.concatenate([pulse.times[few], [burst.duration, *pulse.frames]])
    # the second one is for stiff equations
    how = ("DOP853", 1e-11, 1e-15) if damping < 1.0 else ("Radau", 1e-8, 1e-12)
    displaced, moving = integrate(waves, pulse, burst, tau * matrix, when, *how)
    tolerance = 1e-9 if damping < 1.0 else 1e-6
    largest = np.max(np.abs(pulse.signals))
    heard = moving[3 * pulse.receivers][:, : few.size] * pulse.polarisation[0] / np.sqrt(UNITS.mass)
    np.testing.assert_allclose(pulse.signals[:, few], heard, atol=tolerance * largest)
    for frame, state in zip(pulse.velocities, moving[:, few.size + 1 :].T, strict=True):
        expected = state.reshape(-1, 3)[:, :2] / np.sqrt(UNITS.mass)
        np.testing.assert_allclose(
            frame[:, :2], expected, atol=tolerance * np.max(np.abs(expected))
        )
    x = displaced[:, few.size]
    v = moving[:, few.size]
    assert pulse.energies[0] == pytest.approx(0.5 * (v @ v + x @ (matrix @ x)), rel=10 * tolerance)
    if damping:
        assert pulse.loss > 0.02
    else:
        assert abs(pulse.loss) < 1e-9


@pytest.mark.parametrize("name", ["chain", "fcc"])
def test_energies_keep_their_digits_where_the_network_drifts(name):
    """A burst far below all frequencies moves a free block as a whole, by thousands of times what
    contacts are deformed.
    """
    network = ideal(name, (8,) if name == "chain" else (3, 3, 3), 0.0 if name == "chain" else 0.8)
    along = (1.0, 0.0, 0.0)[: network.dimension]
    pulse = gp.Waves(network).transmit(
        0.02 * HERTZ, along, 2.0 * D, 1, source="ball", duration=400.0 * np.pi / OMEGA
    )
    assert abs(pulse.loss) < 1e-6


def test_stored_energy_is_that_of_the_matrix(disordered):
    """With normal and tangential static forces, of stencils too, and after a drift of all balls."""
    rng = np.random.default_rng(3)
    across = np.cross(disordered.normal, [0.0, 0.0, 1.0]) * rng.uniform(
        -1.0, 1.0, (disordered.n_contacts, 1)
    )
    force = 1e-2 * D * disordered.normal_stiffness
    pressed = replace(
        disordered,
        normal_force=force,
        tangential_force=0.3 * force[:, None] * across,
        prestress=True,
    )
    array = ideal("triangular", (50, 60))
    for network in (disordered, pressed, array):
        operator = make_operator(network)
        x = rng.normal(size=(operator.balls.size, operator.motions.count)) * 1e-3
        expected = 0.5 * operator.vector(x) @ (operator @ operator.vector(x))
        assert operator.store(operator.vector(x)) == pytest.approx(expected, rel=1e-12)
        x[:, 0] += 1e3
        assert operator.store(operator.vector(x)) == pytest.approx(expected, rel=1e-8)


def test_static_forces_have_no_dashpots(disordered):
    """Where they act, damping alike in all motions of a contact is that of its springs, not of the
    whole of D.
    """
    pressed = balance(
        replace(disordered, normal_force=1e-3 * D * disordered.normal_stiffness, prestress=True)
    )
    waves = gp.Waves(pressed)
    burst = ToneBurst(0.5 * HERTZ, 2.0)
    tau = 0.2 / OMEGA
    pulse = waves.transmit(
        0.5 * HERTZ, (0, 1), 4.0 * D, 2, ends="periodic", damping=tau, duration=25.0 / OMEGA
    )
    few = np.arange(0, pulse.times.size, 7)
    springs = WaveOperator(disordered).matrix
    _, moving = integrate(waves, pulse, burst, tau * springs, pulse.times[few])
    heard = moving.reshape(-1, 3, few.size)[pulse.receivers, 1] / np.sqrt(UNITS.mass)
    np.testing.assert_allclose(
        pulse.signals[:, few], heard, atol=1e-9 * np.max(np.abs(pulse.signals))
    )


@pytest.mark.parametrize("ends", ["free", "walls", "periodic"])
@pytest.mark.parametrize("kind", ["damping", "dashpot", "restitution"])
def test_losses_of_each_contact_are_those_of_the_network_before_its_ends_are_cut(ends, kind):
    """Where the contacts that ends cut have losses of their own, these do not count."""
    network = chain(24)
    value = {"damping": 0.02 / OMEGA, "dashpot": 0.02 * UNITS.mass * OMEGA, "restitution": 0.9}
    losses = np.full(network.n_contacts, value[kind])
    is_cut = Course.along(network, np.array([1.0, 0.0, 0.0])).crossings != 0
    if ends == "free":
        losses[is_cut] *= 1.1
    pulse = (0.5 * HERTZ, (1,), 5.0 * D, 1)
    options = {"ends": ends, "duration": 20.0 / OMEGA}
    waves = gp.Waves(network)
    of_each = waves.transmit(*pulse, **options, **{kind: losses})
    of_all = waves.transmit(*pulse, **options, **{kind: value[kind]})
    np.testing.assert_array_equal(of_each.signals, of_all.signals)
    cost = waves.estimate("transmit", *pulse, **options, **{kind: losses})
    assert cost.text == waves.estimate("transmit", *pulse, **options, **{kind: value[kind]}).text
    with pytest.raises(InputError, match=r"24"):
        waves.transmit(*pulse, **options, **{kind: losses[:-1]})


def test_source_and_receiver_may_be_exchanged(disordered):
    waves = gp.Waves(disordered)
    there = waves.transmit(
        0.5 * HERTZ,
        (0, 1),
        4.0 * D,
        2,
        "longitudinal",
        source=12,
        ends="periodic",
        duration=40.0 / OMEGA,
    )
    ball = int(there.receivers[1])
    back = waves.transmit(
        0.5 * HERTZ,
        (0, -1),
        4.0 * D,
        2,
        "longitudinal",
        source=ball,
        ends="periodic",
        duration=40.0 / OMEGA,
    )
    place = int(np.flatnonzero(back.receivers == 12)[0])
    np.testing.assert_allclose(
        back.signals[place], there.signals[1], atol=1e-12 * np.max(np.abs(there.signals))
    )


@pytest.mark.parametrize("tau", [0.05, 1.1, 4.0])
def test_modes_decay_in_proportion_to_their_squared_frequency(disordered, tau):
    operator = WaveOperator(disordered)
    squares, vectors = np.linalg.eigh(operator.matrix.toarray())
    mode, omega = vectors[:, 100], np.sqrt(squares[100])
    burst = ToneBurst(0.5 * HERTZ, 2.0)
    damping = tau / OMEGA
    walk = Propagation(operator, mode, burst, 40.0 / OMEGA, damping)
    times = np.arange(0.0, 40.0 / OMEGA, 0.2 / OMEGA)
    (heard,), *_ = walk.follow(lambda vector: np.array([mode @ vector]), times, np.zeros(0))
    later = heard[times > burst.duration + 0.2 / OMEGA]
    decay = 0.5 * damping * omega**2
    step = 0.2 / OMEGA
    turn = np.emath.sqrt(omega**2 - decay**2)
    factor = 2.0 * np.exp(-decay * step) * np.real(np.cos(turn * step))
    rest = later[2:] - factor * later[1:-1] + np.exp(-2.0 * decay * step) * later[:-2]
    assert np.max(np.abs(rest)) < 1e-12 * np.max(np.abs(heard))
    assert np.max(np.abs(later)) > 1e-6 * np.max(np.abs(heard))


@pytest.mark.parametrize("taus", [(0.03, 0.2), (0.4, 0.0)])
def test_contacts_may_be_damped_more_in_one_way_than_in_another(disordered, taus):
    more = {"cycles": 2, "ends": "periodic", "duration": 25.0 / OMEGA, "frames": [11.0 / OMEGA]}
    waves = gp.Waves(disordered)
    burst = ToneBurst(0.5 * HERTZ, 2.0)
    pulse = waves.transmit(
        0.5 * HERTZ,
        (0, 1),
        4.0 * D,
        damping=taus[0] / OMEGA,
        tangential_damping=taus[1] / OMEGA,
        **more,
    )
    whole = waves.operator.matrix
    normal = WaveOperator(
        replace(disordered, shear_stiffness=1e-30 * disordered.shear_stiffness)
    ).matrix
    few = np.arange(0, pulse.times.size, 7)
    viscous = (taus[0] * normal + taus[1] * (whole - normal)) / OMEGA
    _, moving = integrate(
        waves, pulse, burst, viscous, np.concatenate([pulse.times[few], pulse.frames])
    )
    balls = moving.reshape(-1, 3, few.size + 1)[:, 1] / np.sqrt(UNITS.mass)
    largest = np.max(np.abs(pulse.signals))
    np.testing.assert_allclose(
        pulse.signals[:, few], balls[pulse.receivers][:, :-1], atol=1e-9 * largest
    )
    np.testing.assert_allclose(pulse.velocities[0, :, 1], balls[:, -1], atol=1e-9 * largest)


# -- coherent, speckle, samples --------------------------------------------------------------------


def test_ideal_array_has_no_speckle_and_a_disordered_one_has(disordered):
    even = gp.Waves(ideal("triangular", (5, 12))).transmit(0.5 * HERTZ, (0, 1), 4.0 * D, 2)
    silent = replace(even, signals=0.0 * even.signals, energies=np.zeros(2))
    assert silent.loss == 0.0
    assert silent.coherent_fraction == 0.0
    assert np.max(np.abs(even.speckle)) < 1e-13 * np.max(np.abs(even.signals))
    assert even.coherent_fraction == pytest.approx(1.0)
    other = gp.Waves(disordered).transmit(
        0.5 * HERTZ, (0, 1), 4.0 * D, 2, planes=[2.0 * D, 4.0 * D]
    )
    assert 0.3 < other.coherent_fraction < 0.999
    np.testing.assert_allclose(other.coherent + other.speckle, other.signals)
    np.testing.assert_allclose(
        other.speckle_amplitude**2 + other.coherent**2, np.mean(other.signals**2, axis=0)
    )
    np.testing.assert_allclose(other.planes[1], other.coherent)
    assert other.plane_distances[0] == pytest.approx(2.5 * np.sqrt(0.75) * D)
    assert other.arrivals().shape == (5,)
    assert Pulse.from_dict(other.to_dict()) == other


def test_pulses_of_several_samples_have_one_coherent_part():
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))
    found = []
    for seed in (1, 2):
        network = (
            gp.DirectSimulation(packing, shape=(6, 40), seed=seed).at_force(20.0).sample.network
        )
        found.append(gp.Waves(network).transmit(12e3, (0, 1), 0.15, 3))
    both = average_pulses(found)
    count = both.times.size
    np.testing.assert_allclose(
        both.coherent, 0.5 * (found[0].coherent[:count] + found[1].coherent[:count])
    )
    assert both.samples.tolist() == [0] * 6 + [1] * 6
    assert both.velocity == pytest.approx(0.5 * (found[0].velocity + found[1].velocity), rel=0.02)
    with pytest.raises(InputError, match="no pulse"):
        average_pulses([found[0], 1.0])
    with pytest.raises(InputError, match="no list of pulses"):
        average_pulses(found[0])
    with pytest.raises(InputError, match="differ in frequency"):
        average_pulses([found[0], gp.Waves(network).transmit(11e3, (0, 1), 0.15, 3)])


@pytest.fixture(scope="module")
def pressed_networks():
    """Samples of unlike balls in the exact geometry, without their static forces."""
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(8e-5))
    arrays = (gp.DirectSimulation(packing, (3, 8), seed=seed, geometry="exact") for seed in (1, 2))
    return [replace(array.at_force(20.0).sample.network, prestress=False) for array in arrays]


@pytest.mark.parametrize("ends", ["free", "walls", "periodic"])
def test_the_default_distance_leads_to_the_same_plane_in_all_samples(ends, pressed_networks):
    """Half of a length lies as far from one plane as from the next, and samples of the exact
    geometry differ a little.
    """
    settings = PulseSettings(4e4, cycles=1.0, ends=ends)
    pulses = [
        transmit(network, PulseSource.of(settings, network, (0, 1))) for network in pressed_networks
    ]
    assert len({tuple(pulse.receivers) for pulse in pulses}) == 1
    mean = np.mean([pulse.distance for pulse in pulses])
    assert average_pulses(pulses).distance == pytest.approx(mean)


def test_open_network_has_the_ends_that_it_has():
    whole = chain(40)
    kept = ~np.any(whole.shift, axis=1)
    names = [
        name
        for name, layout in whole._shapes.items()
        if layout.startswith("c") and "?" not in layout
    ]
    fields = {name: getattr(whole, name)[kept] for name in names}
    fields |= {
        "cell": np.zeros((3, 3)),
        "pbc": (False, False, False),
        "lattice": None,
        "shape": None,
    }
    opened = gp.Waves(replace(whole, **fields))
    one = gp.Waves(whole).transmit(0.4 * HERTZ, (1,), 20.4 * D, 3)
    other = opened.transmit(0.4 * HERTZ, (1,), 19.9 * D, 3, duration=one.times[-1])
    assert one.receivers.tolist() == other.receivers.tolist() == [20]
    np.testing.assert_allclose(other.signals, one.signals, atol=1e-12 * np.max(np.abs(one.signals)))
    with pytest.raises(InputError, match="no place for walls"):
        opened.transmit(0.4 * HERTZ, (1,), 20.0 * D, ends="walls")
    with pytest.raises(InputError, match="between the walls"):
        gp.Waves(chain(1)).transmit(0.4 * HERTZ, (1,), 0.9 * D, ends="walls")
    # a network whose contacts across the period are gone, and that has its period still
    uncrossed = replace(whole, **{name: fields[name] for name in names})
    with pytest.raises(InputError, match="no balls for walls"):
        gp.Waves(uncrossed).transmit(0.4 * HERTZ, (1,), 20.0 * D, ends="walls")
    with pytest.raises(InputError, match="no distance"):
        PulseSource.of(PulseSettings(0.4 * HERTZ), opened.network)


#: lattice and its array, whether it is as a large one, ends
BUCKLING = [
    (*array, large, ends)
    for array in (("square", (3, 24)), ("kagome", (3, 16)), ("sc", (3, 3, 16)))
    for large in (False, True)
    for ends in ("periodic", "free", "walls")
]
#: each lattice, and each end with and without factors
FEW_BUCKLING = BUCKLING[0], BUCKLING[4], BUCKLING[8], BUCKLING[9], BUCKLING[13], BUCKLING[17]


@pytest.mark.parametrize(("lattice", "shape", "large", "ends"), slower(FEW_BUCKLING, BUCKLING))
def test_lattices_that_buckle_under_their_load_send_no_pulse(
    lattice, shape, large, ends, monkeypatch
):
    if large:  # as networks are that are too large to be factorised
        monkeypatch.setattr("granphon.waves.modes.LARGEST_FACTORS", {2: 0, 3: 0})
    along = np.eye(len(shape))[-1]
    for friction, unstable in ((False, True), (True, False)):
        packing = gp.Packing(STEEL, 8e-3, lattice=lattice, friction=friction)
        state = gp.AveragedLattice(packing).at_overlap(1e-6, finite_overlap=True)
        waves = gp.Waves(state.network.repeat(shape))
        if unstable:
            with pytest.raises(InstabilityError, match="frequency is below"):
                waves.transmit(12e3, along, 0.03, 1, ends=ends)
        else:
            assert np.isfinite(
                waves.transmit(12e3, along, 0.03, 1, ends=ends, duration=1e-4).energies
            ).all()


# -- ends under load -------------------------------------------------------------------------------


def press(force, shape, seed, friction=True):
    """A sample of balls that differ, in its true geometry, so that it has static forces."""
    packing = gp.Packing(STEEL, D, spread=gp.Uniform(2.04e-6), friction=friction)
    return gp.DirectSimulation(packing, shape=shape, seed=seed, geometry="exact").at_force(force)


def find_squares(network):
    """Squares of frequencies over that of the top, by a dense matrix."""
    operator = make_operator(network)
    return np.linalg.eigvalsh(operator.matrix.toarray()) / operator.top**2


def cut_freely(network, along):
    """The network with all contacts across its beginning cut, and nothing left out."""
    course = Course.along(network, np.array(along, float))
    kept = {name: getattr(network, name)[course.crossings == 0] for name in network.contact_fields}
    return course, replace(network, **kept)


@pytest.mark.claim("pulses-free-ends")
@pytest.mark.parametrize(
    ("force", "seed"),
    slower([(0.1, 1), (2.0, 11)], itertools.product([0.1, 0.5, 2.0], [1, 11])),
)
def test_balls_that_a_free_end_leaves_hanging_are_left_out(force, seed):
    network = press(force, (10, 20), seed).samples[0].network
    course, cut = cut_freely(network, (1.0, 0.0, 0.0))
    held = course.with_ends("free").network
    assert find_squares(network).min() > -1e-12
    assert find_squares(held).min() > -1e-12
    dropped = np.flatnonzero(~held.moving)
    assert dropped.size
    assert find_squares(cut).min() < -1e-9
    # with any of them the rest would fall, and contacts of all others are there
    for ball in dropped:
        gone = np.setdiff1d(dropped, ball)
        kept = ~(np.isin(cut.i, gone) | np.isin(cut.j, gone))
        of_ball = int(np.sum((cut.i[kept] == ball) | (cut.j[kept] == ball)))
        assert of_ball < 2
    np.testing.assert_array_equal(
        held.i, cut.i[~(np.isin(cut.i, dropped) | np.isin(cut.j, dropped))]
    )
    losses = course.with_ends("free").find_losses(
        Losses.of(network, GivenLosses(np.arange(float(network.n_contacts))))
    )
    kept = losses.damping[0].astype(int)
    np.testing.assert_array_equal(network.i[kept], held.i)
    np.testing.assert_array_equal(network.normal[kept], held.normal)
    # the front and the rear of the sample alone are touched
    away = np.minimum(course.places[dropped], course.period - course.places[dropped])
    assert np.max(away) < 2.5 * D


@pytest.mark.parametrize(
    ("friction", "shape", "along", "seed", "count"),
    [
        (True, (8, 24), (0.0, 1.0, 0.0), 40, 2),
        pytest.param(False, (12, 24), (1.0, 0.0, 0.0), 5, 10, marks=pytest.mark.slow),
    ],
)
def test_groups_of_balls_that_hang_as_a_whole_are_left_out(friction, shape, along, seed, count):
    # each ball has contacts enough, and some together have not
    network = press(0.1, shape, seed, friction).samples[0].network
    course, cut = cut_freely(network, along)
    assert not is_stable(make_operator(cut))
    held = course.with_ends("free").network
    assert find_squares(held).min() > -1e-12
    assert np.count_nonzero(~held.moving) == count


@pytest.mark.parametrize(
    ("seed", "along"), [(1, (1, 0)), pytest.param(3, (0, 1), marks=pytest.mark.slow)]
)
def test_an_array_without_friction_may_not_hold_with_free_ends(seed, along):
    # it has about as many contacts as it needs, so that each ball that falls leaves others without
    waves = gp.Waves(press(0.1, (8, 16), seed, friction=False).samples[0])
    with pytest.raises(InstabilityError, match="walls"):
        waves.transmit(3000.0, along, 4.0 * D, 2)
    assert np.isfinite(waves.transmit(3000.0, along, 4.0 * D, 2, ends="walls").energies).all()


def test_what_falls_as_far_inside_as_the_receivers_is_told():
    waves = gp.Waves(press(0.1, (10, 20), 5, friction=False).samples[0])
    pulse = waves.transmit(3000.0, (0, 1), 4.0 * D, 2)
    assert pulse.left_out > 50
    assert f"{pulse.left_out} balls" in pulse.warnings[0]
    assert average_pulses([pulse, pulse]).left_out == 2 * pulse.left_out


def test_arrays_too_large_to_be_factorised_leave_out_single_balls_alone(monkeypatch):
    monkeypatch.setattr("granphon.waves.modes.LARGEST_FACTORS", {2: 0, 3: 0})
    network = press(0.1, (10, 20), 1).samples[0].network
    cut = cut_freely(network, (1.0, 0.0, 0.0))[1]
    unseen = [id(cut), id(network)]
    monkeypatch.setattr(
        "granphon.waves.pulses.is_stable",
        lambda operator, fall=None: id(operator.network) in unseen[1:],
    )
    with pytest.raises(InstabilityError, match="below zero"):
        drop_falling(cut, network)
    monkeypatch.setattr(
        "granphon.waves.pulses.is_stable",
        lambda operator, fall=None: id(operator.network) != unseen[0],
    )
    assert np.count_nonzero(~drop_falling(cut, network).moving) == 2


@pytest.mark.claim("pulses-free-ends")
@pytest.mark.parametrize(
    "seed", [pytest.param(2, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow), 7]
)
def test_velocities_with_free_ends_and_walls_agree_at_low_load(seed):
    state = press(2.0, (20, 40), seed)
    sound = float(gp.sound_velocities(state, direction=(1, 0)).longitudinal)
    waves = gp.Waves(state.samples[0])
    hertz = sound / (12.0 * D)
    free = waves.transmit(hertz, (1, 0), 10.0 * D, 2)
    walls = waves.transmit(hertz, (1, 0), 10.0 * D, 2, ends="walls")
    assert abs(free.velocity - walls.velocity) < np.hypot(free.velocity_error, walls.velocity_error)
    # waves of twelve balls are by the bands of equal balls 3 % slower than long ones; disorder
    # takes some more
    assert 0.9 < free.velocity / sound < 0.97
    assert walls.left_out == 0
    assert (free.left_out > 0) == (seed != 7)


@pytest.mark.parametrize(
    ("force", "seed"), slower([(0.1, 1), (0.5, 0)], itertools.product([0.1, 0.5], range(2)))
)
def test_pulses_arrive_at_still_lower_loads(force, seed):
    state = press(force, (20, 40), seed)
    sound = float(gp.sound_velocities(state, direction=(1, 0)).longitudinal)
    pulse = gp.Waves(state.samples[0]).transmit(sound / (12.0 * D), (1, 0), 10.0 * D, 2)
    assert 0.85 < pulse.velocity / sound < 1.05
    assert pulse.left_out > 0


# -- planes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "shape", "direction", "period"),
    [
        ("triangular", (5, 12), (0, 1), 12 * np.sqrt(0.75)),
        ("triangular", (8, 2), (1, 0), 1.0),
        ("square", (4, 6), (1, 0), 4.0),
        ("fcc", (3, 3, 3), (1, 1, 1), 3 * np.sqrt(2.0 / 3.0)),
        ("chain", (9,), (1, 0), 9.0),
    ],
)
def test_planes_close_after_the_period_of_the_cell(name, shape, direction, period):
    network = ideal(name, shape, 0.0 if name == "chain" else 0.8)
    along = np.pad(np.array(direction, float), (0, 3 - len(direction)))
    course = Course.along(network, along / np.linalg.norm(along))
    assert course.period == pytest.approx(period * D)
    # a way around the array crosses its beginning once a period
    full = network.vector @ course.direction
    np.testing.assert_allclose(
        full - course.places[network.j] + course.places[network.i],
        course.period * course.crossings,
        atol=1e-9 * D,
    )
    assert np.min(course.places) > 0.1 * D


def test_cut_array_keeps_all_but_one_plane_of_contacts():
    network = ideal("triangular", (5, 12))
    course = Course.along(network, np.array([0.0, 1.0, 0.0]))
    assert course.with_ends("free").network.n_contacts == network.n_contacts - 10
    walls = course.with_ends("walls")
    assert np.count_nonzero(~walls.network.moving) == 5
    assert walls.face == pytest.approx(-np.sqrt(0.75) / 2 * D)
    assert gp.Waves(walls.network).operator.size == 3 * 55


@pytest.mark.parametrize("seed", range(4))
def test_source_and_receivers_of_a_packing_without_planes_are_apart(seed):
    whole = ideal("square", (20, 6))
    moved = np.random.default_rng(seed).uniform(-0.5, 0.5, 120) * D
    places = whole.positions + moved[:, None] * [1.0, 0.0, 0.0]
    apart = places[whole.j] + whole.shift @ whole.cell - places[whole.i]
    size = np.linalg.norm(apart, axis=1)
    network = replace(
        whole,
        positions=places,
        normal=apart / size[:, None],
        arm_i=0.5 * size,
        arm_j=0.5 * size,
        lattice=None,
        shape=None,
    )
    course = Course.along(network, np.array([1.0, 0.0, 0.0])).with_ends("free")
    source = course.find_plane(0.0, "source")
    heard = course.find_plane(8.0 * D, "receivers")
    assert np.max(course.places[source]) <= np.min(course.places) + 0.9 * D
    assert np.ptp(course.places[heard]) <= 0.9 * D
    assert course.find_distance(0.0, heard) == pytest.approx(8.0 * D, abs=0.5 * D)
    pulse = gp.Waves(network).transmit(0.5 * HERTZ, (1, 0), 8.0 * D, 2)
    assert pulse.sources.tolist() == source.tolist()
    assert pulse.velocity > 0.0


# -- what is refused -------------------------------------------------------------------------------


def test_bad_pulses_are_refused(disordered):
    waves = gp.Waves(disordered)
    with pytest.raises(
        UnreachableFrequencyError,
        match=rf"above .*, {2 * np.cos(np.pi / 80) * HERTZ:.6g} Hz",
    ):
        gp.Waves(chain(40)).transmit(2.1 * HERTZ, (1,), 8 * D)
    with pytest.raises(InputError, match="come back"):
        waves.transmit(0.5 * HERTZ, (0, 1), 7.0 * D, ends="periodic")
    with pytest.raises(InputError, match=r"direction .*\(0.866025, 0.5\)"):
        gp.Waves(ideal("triangular", (8, 3))).transmit(
            0.5 * HERTZ, (1, 0), 1.0 * D, ends="periodic"
        )
    with pytest.raises(InputError, match="do not close"):
        waves.transmit(0.5 * HERTZ, (0.3, 1), 2.0 * D)
    with pytest.raises(InputError, match="no contact resists"):
        gp.Waves(ideal("square", (3, 12), 0.0)).transmit(
            0.5 * HERTZ, (0, 1), 4.0 * D, polarisation="transverse"
        )
    with pytest.raises(InputError, match="no transverse waves"):
        gp.Waves(chain(40)).transmit(0.5 * HERTZ, (1,), 8 * D, polarisation="transverse")
    with pytest.raises(InputError, match="method: found 'ear'"):
        waves.transmit(0.5 * HERTZ, (0, 1), 4.0 * D).arrival("ear")


def test_what_does_not_travel_has_no_time_of_flight():
    # without bending, waves across a plane of balls do not run at this frequency; what is heard is
    # the near field
    lattice = gp.ContactLattice.of("triangular", 0.8, motions=allowed_motions(2)["out_of_plane"])
    network = lattice.contact_network(UNITS).repeat((1, 300))
    pulse = gp.Waves(network).transmit(
        0.4 * HERTZ, (0, 1), 25.0 * D, 20, "out_of_plane", duration=140 / HERTZ
    )
    require_unknown(pulse, "after the burst")


def test_signal_that_comes_at_once_has_no_time_of_flight():
    # an array that is far shorter than the wave moves as a whole: a hundredth of a reading is no
    # time of flight
    burst = ToneBurst(1.0, 5.0)
    times = np.arange(400) / 24.0

    def find(*delays):
        return find_arrivals(
            times,
            np.array([burst(times - one) for one in delays]),
            burst(times),
            5.0,
            "envelope",
            0.1,
        )

    found, reasons = find(0.01 / 24.0, 2.0 / 24.0, 12.0)
    assert np.isnan(found).tolist() == [True, False, True]
    assert "shorter" in reasons[0]
    assert reasons[1] == ""
    assert "record ends" in reasons[2]
    np.testing.assert_allclose(found[1], 2.0 / 24.0, rtol=1e-3)


def require_unknown(pulse, why):
    """The pulse has no time of flight by any reading, and its warnings say why."""
    assert np.isnan([pulse.time_of_flight, pulse.velocity, pulse.velocity_error]).all()
    assert np.isnan(
        [pulse.arrival(method) for method in ("envelope", "first", "correlation")]
    ).all()
    assert why in pulse.why_unknown
    assert any(pulse.why_unknown in text for text in pulse.warnings)


@pytest.mark.claim("pulses-record")
@pytest.mark.parametrize("cycles", [3.0, 5.0])
@pytest.mark.parametrize("distance", [0.1, 0.15, 0.2, 0.25])
def test_a_periodic_network_without_room_for_burst_and_flight_is_refused(cycles, distance):
    packing = gp.Packing(STEEL, 8e-3)
    network = gp.AveragedLattice(packing).at_force(5.0).network.repeat((2, 80))
    sound = gp.sound_velocities(gp.AveragedLattice(packing).at_force(5.0), (0, 1)).longitudinal
    period = 80 * np.sqrt(0.75) * 8e-3
    waves = gp.Waves(network)
    refused = 0
    for hertz in (4e3, 6e3, 8e3, 10e3, 12e3):
        away = np.rint(distance / np.sqrt(0.75) / 8e-3) * np.sqrt(0.75) * 8e-3
        needed = 2.0 * away + cycles / hertz * sound
        if needed > period:
            refused += 1
            with pytest.raises(InputError, match=rf"are over.* {needed:.4g} m "):
                waves.transmit(hertz, (0, 1), distance, cycles, ends="periodic")
        else:
            group = gp.pulse_velocities(
                gp.AveragedLattice(packing).at_force(5.0), hertz, (0, 1)
            ).group[0]
            assert waves.transmit(
                hertz, (0, 1), distance, cycles, ends="periodic"
            ).velocity == pytest.approx(group, rel=0.01)
    assert 0 < refused < 5 or distance > 0.1


@pytest.mark.claim("pulses-none")
def test_a_record_that_is_cut_has_no_time_of_flight():
    whole = gp.Waves(chain(200)).transmit(0.5 * HERTZ, (1,), 40.0 * D, 5)
    last = whole.time_of_flight + 5.0 / (0.5 * HERTZ)  # burst and flight
    assert whole.velocity == pytest.approx(np.sqrt(1.0 - 0.25**2) * D * OMEGA, rel=1e-3)
    for part in (0.3, 0.6, 0.8, 0.95):  # a ripple of the cut envelope is no arrival
        cut = gp.Waves(chain(200)).transmit(0.5 * HERTZ, (1,), 40.0 * D, 5, duration=part * last)
        require_unknown(cut, "ends before the pulse")
        assert np.isnan(cut.arrivals()).all()
    held = gp.Waves(chain(200)).transmit(0.5 * HERTZ, (1,), 40.0 * D, 5, duration=1.02 * last)
    assert held.velocity == pytest.approx(whole.velocity, rel=1e-4)


@pytest.mark.claim("pulses-none")
@pytest.mark.parametrize("cycles", [5, 20])
@pytest.mark.parametrize(
    "hertz", [1.5, *(pytest.param(one, marks=pytest.mark.slow) for one in (1.6, 1.8)), 2.0]
)
def test_a_pulse_in_a_gap_has_no_time_of_flight(cycles, hertz):
    # heavy and light balls in turn: no wave between (2 k/M)^1/2 and (2 k/m)^1/2
    whole = chain(200)
    masses = np.where(np.arange(200) % 2, 0.4, 1.0) * whole.masses
    waves = gp.Waves(replace(whole, masses=masses, lattice=None, shape=None))
    require_unknown(waves.transmit(hertz * HERTZ, (1,), 50.0 * D, cycles), "")
    inside = waves.transmit(0.8 * HERTZ, (1,), 50.0 * D, cycles)
    assert inside.velocity == pytest.approx(330.0, rel=0.05)
    assert not inside.warnings


@pytest.mark.claim("pulses-none")
def test_a_velocity_above_that_of_the_fastest_wave_is_none():
    arrived = gp.Waves(chain(200)).transmit(0.5 * HERTZ, (1,), 40.0 * D, 5)
    faster = replace(arrived, distance=1.1 * arrived.distance)
    require_unknown(replace(faster, warnings=faster.judge()), "take longer")


@pytest.mark.claim("pulses-none")
@pytest.mark.parametrize("heavy", [0.1, 10.0])
def test_balls_that_no_contact_holds_do_not_slow_the_fastest_wave(heavy):
    """A pulse through a chain between loose balls has its time of flight, and beside a chain of
    softer contacts too.
    """
    alone = chain(120)
    ways = {"direction": (1,), "distance": 40.0 * D, "duration": 90.0 / OMEGA}
    wanted = gp.Waves(alone).transmit(0.5 * HERTZ, source=0, **ways)
    n = alone.n_balls
    more = {name: np.kron([1.0, heavy], getattr(alone, name)) for name in ("masses", "inertias")}
    more |= {
        "positions": np.concatenate(
            [alone.positions, alone.positions + np.array([0.5 * D, 0.0, 0.0])]
        )
    }
    loose = replace(alone, radii=np.kron([1.0, 0.4], alone.radii), lattice=None, shape=None, **more)
    soft = {name: np.concatenate([getattr(alone, name)] * 2) for name in alone.contact_fields}
    soft |= {"i": np.append(alone.i, alone.i + n), "j": np.append(alone.j, alone.j + n)}
    soft |= {
        "normal_stiffness": np.kron([1.0, 0.1 * heavy], alone.normal_stiffness),
        "radii": np.tile(alone.radii, 2),
    }
    for network, source in ((loose, 0), (replace(loose, **soft), [0, n])):
        found = gp.Waves(network).transmit(0.5 * HERTZ, source=source, **ways)
        np.testing.assert_allclose(found.fastest, wanted.fastest, rtol=1e-12)
        here = found.receivers < n
        np.testing.assert_allclose(found.arrivals()[here], wanted.time_of_flight, rtol=1e-3)


@pytest.mark.claim("pulses-error")
@pytest.mark.parametrize(
    ("hertz", "cycles", "low", "high"),
    [(0.6, 1, 0.04, 0.06), (0.6, 5, 0.0, 0.005), (0.3, 1, 0.0, 0.015)],
)
def test_a_pulse_says_how_sure_its_velocity_is(hertz, cycles, low, high):
    pulse = gp.Waves(chain(120)).transmit(hertz * HERTZ, (1,), 16.0 * D, cycles)
    group = np.sqrt(1.0 - 0.25 * hertz**2) * D * OMEGA
    away = abs(pulse.velocity - group)
    assert low * group <= away <= high * group
    assert pulse.velocity_error == pytest.approx(away, rel=0.15, abs=0.003 * group)
    assert any("changes its shape" in text for text in pulse.warnings) == (low > 0.0)


@pytest.mark.claim("pulses-scatter")
@pytest.mark.parametrize("hertz", [1.2, pytest.param(1.4, marks=pytest.mark.slow), 1.6])
@pytest.mark.parametrize(
    ("cycles", "distance", "ends"),
    [(5, 6, "periodic"), (5, 6, "free"), (5, 20, "free"), (5, 40, "free"), (10, 20, "free")],
)
def test_errors_near_the_top_of_a_band_cover_the_group_velocity(hertz, cycles, distance, ends):
    # of a chain, whose top is at 2 (k/M)^1/2 / 2 pi
    pulse = gp.Waves(chain(120)).transmit(hertz * HERTZ, (1,), distance * D, cycles, ends=ends)
    group = np.sqrt(1.0 - 0.25 * hertz**2) * D * OMEGA
    assert abs(pulse.velocity - group) < 2.0 * pulse.velocity_error + 0.002 * group


@pytest.mark.claim("pulses-scatter")
def test_a_pulse_near_the_top_of_a_band_of_balls_that_differ():
    packing = gp.Packing(STEEL, D, spread=gp.Uniform(2.04e-6))
    group = gp.pulse_velocities(gp.EffectiveMedium(packing).at_force(10.0), 26e3, (0, 1)).group[0]
    for sample in gp.DirectSimulation(packing, shape=(12, 80), samples=3).at_force(10.0).samples:
        pulse = gp.Waves(sample).transmit(26e3, (0, 1), 0.05, ends="periodic")
        assert abs(pulse.velocity - group) < 2.0 * pulse.velocity_error
        assert pulse.velocity_error < 0.1 * pulse.velocity


@pytest.mark.claim("pulses-scatter")
@pytest.mark.parametrize(
    ("force", "hertz", "samples", "seed", "shape"),
    [
        (2.0, 5160.0, 3, 1, (22, 22)),
        *(
            pytest.param(*one, 16, 0, (20, 40), marks=pytest.mark.exhaustive)
            for one in ((0.5, 3590.0), (2.0, 5160.0))
        ),
    ],
)
def test_velocities_scatter_by_no_more_than_their_errors(force, hertz, samples, seed, shape):
    # waves of twelve balls
    packing = gp.Packing(STEEL, D, spread=gp.Uniform(2.04e-6))
    medium = gp.DirectSimulation(packing, shape=shape, samples=samples, seed=seed)
    state = medium.at_force(force)
    pulses = [gp.Waves(one).transmit(hertz, (1, 0), 10.0 * D, 2) for one in state.samples]
    scatter = np.std([one.velocity for one in pulses], ddof=1)
    error = np.sqrt(np.mean([one.velocity_error**2 for one in pulses]))
    # neighbours do not hear quite independently, and the scatter of n samples is known to 1 in (2
    # n)^1/2
    assert scatter < (1.25 + 1.0 / np.sqrt(2.0 * samples)) * error
    assert error < 3.0 * scatter


def test_errors_are_those_of_the_mean_over_balls():
    alone = gp.Waves(press(0.5, (20, 40), 0).samples[0]).transmit(3590.0, (1, 0), 10.0 * D, 2)
    shared = average_pulses([alone] * 4)
    ones = replace(alone, signals=np.tile(alone.coherent, (len(alone.signals), 1)))
    by_shape = ones.velocity_error
    by_ball = np.sqrt(alone.velocity_error**2 - by_shape**2)
    n = len(alone.signals)
    assert by_ball > 0.0
    wanted = np.hypot(by_shape, by_ball * np.sqrt((n - 1) / (4 * n - 1)))
    assert shared.velocity_error == pytest.approx(wanted, rel=1e-9)


@pytest.mark.claim("pulses-none")
def test_echo_within_the_pulse_is_a_warning():
    network = ideal("triangular", (4, 48))
    waves = gp.Waves(network)
    velocity = D * OMEGA * np.sqrt((9.0 + 3.0 * 0.8) / 8.0)
    way = 2.0 * 24 * D * np.sqrt(0.75)  # to the far end and back
    least = 2.5 * velocity / way  # five cycles rise to their maximum in half of their time
    assert not waves.transmit(1.05 * least, (0, 1), 24 * D * np.sqrt(0.75)).warnings
    early = waves.transmit(0.95 * least, (0, 1), 24 * D * np.sqrt(0.75))
    require_unknown(early, "an echo from an end")
    assert len(average_pulses([early, early]).warnings) == 1
    assert Pulse.from_dict(early.to_dict()) == early
    # in a ring what runs the other way comes as an echo
    around = waves.transmit(0.95 * least, (0, 1), 16 * D, ends="periodic", duration=early.times[-1])
    require_unknown(around, "an echo from an end")
    # it comes as the pulse is at its height, and no sample is without it
    soon = gp.Waves(chain(12)).transmit(
        1.001 * OMEGA / 6.0, (1,), 3.0 * D, 2, ends="periodic", duration=40.0 / OMEGA
    )
    require_unknown(soon, "an echo from an end")
    # at the end itself the first is the one that has crossed the array twice more
    assert not waves.transmit(0.6 * least, (0, 1), 47.5 * D * np.sqrt(0.75)).warnings
    # of a ball in the middle, one end is as near behind it as the other is ahead of the receivers
    course = Course.along(network, np.array([0.0, 1.0, 0.0])).with_ends("free")
    middle, after = (course.find_plane(n * D * np.sqrt(0.75), "test") for n in (10.5, 30.5))
    assert course.find_echo(course.find_place(middle), after) == pytest.approx(
        2 * 10.5 * D * np.sqrt(0.75)
    )


def test_what_is_damped_too_much_to_swing_is_a_warning(disordered):
    waves = gp.Waves(disordered)
    quiet, loud = (
        waves.transmit(0.5 * HERTZ, (0, 1), 4.0 * D, 1, damping=ratio / (0.5 * np.pi * HERTZ))
        for ratio in (0.29, 0.31)
    )
    assert not any("damped" in one for one in quiet.warnings)
    assert any("damped" in one for one in loud.warnings)
    stuck = waves.transmit(0.5 * HERTZ, (0, 1), 4.0 * D, 1, damping=1e9 / HERTZ)
    assert np.isnan(stuck.arrival())


@pytest.mark.parametrize(
    ("given", "wrong"),
    [
        ({"source": "side"}, "source"),
        ({"source": 600}, "source"),
        ({"ends": "soft"}, "ends"),
        ({"polarisation": "odd"}, "polarisation"),
        ({"cycles": 0.5}, "cycles"),
        ({"cycles": True}, "cycles"),
        ({"damping": -1.0}, "damping"),
        ({"duration": 0.0}, "duration"),
        ({"duration": math.inf}, "duration"),
        ({"planes": [-1.0]}, "planes"),
        ({"planes": [[], 1.0]}, "planes"),
        ({"planes": [[1.0, 2.0], [3.0, 4.0]]}, "planes has the shape"),
        ({"frames": [[0.0], [1e-6]]}, "frames has the shape"),
        ({"frames": [[], 1.0]}, "frames"),
        ({"frequency": 10**400}, "frequency"),
        ({"frequency": 1e308}, "is read more than"),
        ({"frequency": 5e-324}, "is read more than"),
        ({"frequency": 1e12 * HERTZ}, "is read .* times"),
        ({"cycles": 1e308}, "is read more than"),
        ({"duration": 1e308}, "is read more than"),
        ({"frequency": 1e-7 * HERTZ}, "products with the matrix"),
        ({"damping": 0.0, "tangential_damping": 1e6 / HERTZ}, "record of .* products"),
        ({"damping": 1e200}, "damping up to"),
        ({"damping": (1e-6, 2e-6), "tangential_damping": 1e-6}, "and tangential_damping is"),
        ({"damping": 1e30, "tangential_damping": 0.0}, "nothing moves"),
        ({"distance": 1e308}, "would meet itself"),
        ({"planes": [1e308]}, "would meet itself"),
        ({"planes": 1e308, "ends": "periodic"}, "Take a shorter distance"),
    ],
)
def test_numbers_that_no_pulse_has_are_refused(given, wrong):
    waves = gp.Waves(ideal("triangular", (4, 24)))
    with pytest.raises(InputError, match=wrong):
        waves.transmit(
            **({"frequency": 0.5 * HERTZ, "direction": (0, 1), "distance": 8 * D} | given)
        )


@pytest.mark.parametrize(
    ("args", "options", "wrong"),
    [
        (
            (),
            {},
            r"transmit.* 3 .*'frequency'.*'distance'",
        ),
        ((1.0, (0, 1)), {}, "'distance'"),
        ((1.0, (0, 1), D), {"length": D}, "'length'"),
        (
            (1.0, (0, 1), D, 5.0, "longitudinal", "ball"),
            {},
            "from 4 to 6 .* 7 ",
        ),
    ],
)
def test_transmit_says_which_arguments_it_needs(args, options, wrong):
    with pytest.raises(TypeError, match=wrong):
        gp.Waves(chain(4)).transmit(*args, **options)


def test_waves_say_in_a_line_what_they_are():
    assert repr(gp.Waves(ideal("triangular", (4, 3)))) == (
        "Waves(12 balls, 36 contacts, x, y, w of each ball; frequencies in Hz)"
    )


def test_error_of_planes_names_the_lengths_of_the_cell():
    # along [1, 1, 0] the vectors of 6 x 6 x 8 cells go 3, 3 and 8 diameters far: planes meet
    # themselves after one
    with pytest.raises(InputError, match=r"0\.024 and 0\.024 and 0\.064 m long"):
        gp.Waves(ideal("fcc", (6, 6, 8))).transmit(HERTZ, (1, 1, 0), 3 * D)


def test_network_that_is_not_joined_is_refused():
    whole = chain(40)
    cut = (whole.i == 3) | (whole.i == 30)
    names = [
        name
        for name, layout in whole._shapes.items()
        if layout.startswith("c") and "?" not in layout
    ]
    parted = replace(
        whole, **{name: getattr(whole, name)[~cut] for name in names}, lattice=None, shape=None
    )
    with pytest.raises(InputError, match=r"source .* 3 parts"):
        gp.Waves(parted).transmit(0.5 * HERTZ, (1,), 8 * D)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("ends", ["free", "walls", "periodic"])
def test_pulse_runs_forward_from_the_first_plane_of_a_sample(ends, seed):
    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, gp.Uniform(2.04e-6))
    state = gp.DirectSimulation(packing, shape=(6, 130), seed=seed).at_force(18.4)
    waves = gp.Waves(state.sample)
    pulse = waves.transmit(6500.0, (0, 1), 0.14, ends=ends)
    heights = waves.network.positions[:, 1]
    period = waves.network.cell[1, 1]
    ahead = np.mod(heights[pulse.receivers].mean() - heights[pulse.sources].mean(), period)
    assert ahead == pytest.approx(pulse.distance, abs=0.9 * 8e-3)
    assert pulse.velocity == pytest.approx(
        gp.pulse_velocities(state, 6500.0, (0, 1)).group[0], rel=0.08
    )


@pytest.mark.parametrize("function", [gp.Waves.transmit, WaveEstimate._find_sent_pulse])
def test_transmit_and_its_estimate_take_the_arguments_of_a_sending(function):
    """The signature that help and editors show has the names and the defaults of the class."""
    given = inspect.signature(PulseSource).parameters
    _, *parameters = inspect.signature(function).parameters.values()
    assert [one.name for one in parameters] == list(given)
    for one in parameters:
        assert one.default == given[one.name].default, one.name
        assert one.kind == given[one.name].kind, one.name


def test_contacts_that_pull_carry_transverse_waves_as_strings_do():
    network = ideal("square", (60, 6), 0.0)
    pull = 0.05 * network.normal_stiffness * D
    stretched = replace(network, adhesive=True, normal_force=-pull, prestress=True)
    pulse = gp.Waves(stretched).transmit(
        0.1 * HERTZ, (1, 0), 20.0 * D, 2, polarisation="transverse", ends="walls"
    )
    velocity = math.sqrt(pull[0] * D / network.masses[0])
    # of 60 planes one is the wall, whose mass does not count
    assert np.isclose(pulse.fastest[0], velocity * math.sqrt(60.0 / 59.0), rtol=1e-12)
    # the branch of the string is sin(q d/2) times its top, of which the frequency is this share
    share = 0.1 / math.sqrt(0.05 * 4.0)
    assert np.isclose(pulse.velocity, velocity * math.sqrt(1.0 - share**2), rtol=0.01)


def test_pulses_with_planes_at_other_distances_have_no_mean():
    waves = gp.Waves(chain(60))
    near, far = (
        waves.transmit(0.3 * HERTZ, (1,), 20.0 * D, 2, planes=[distance * D]) for distance in (5, 9)
    )
    with pytest.raises(InputError, match="plane_distances"):
        average_pulses([near, far])


def test_correlation_at_the_first_shift_says_that_the_signal_comes_too_early():
    times = np.arange(200) / (24.0 * HERTZ)
    sent = ToneBurst(HERTZ, 2.0)(times)
    flights, reasons = find_arrivals(times, sent[None], sent, 2.0 / HERTZ, "correlation", 0.1)
    assert np.isnan(flights[0])
    assert "after the burst" in reasons[0]


@pytest.mark.parametrize(
    "losses",
    [
        pytest.param({"damping": (1.0 / HERTZ, 0.0)}, marks=pytest.mark.slow),
        {"damping": (1e-3 / HERTZ, 0.0)},
        {"drag": (3.0 * HERTZ, 0.0)},
    ],
)
def test_products_of_uneven_losses_are_counted_by_the_rule_of_the_propagation(losses, monkeypatch):
    network = ideal("square", (12, 4))
    operator = make_operator(network)
    network_losses = Losses.of(network, GivenLosses(**losses))
    burst = ToneBurst(0.3 * HERTZ, 2.0)
    propagation = ViscousPropagation(operator, np.ones(operator.size), burst, network_losses)
    count = 0
    apply = propagation._apply

    def count_and_apply(z):
        nonlocal count
        count += 1
        return apply(z)

    monkeypatch.setattr(propagation, "_apply", count_and_apply)
    end = 2.0 * burst.duration
    propagation.follow(lambda v: v[:1], np.linspace(0.0, end, 50), np.zeros(0))
    expected = Spans.of(operator.top, burst, network_losses).count_products(end)
    assert 0.5 * expected <= count <= expected


def test_what_cannot_be_sent_is_refused_before_the_network_is_found_stable(monkeypatch):
    def refuse(_operator):
        raise AssertionError("stability was examined first")

    monkeypatch.setattr("granphon.waves.waves.require_stable", refuse)
    waves = gp.Waves(ideal("square", (12, 4)))
    with pytest.raises(InputError, match="distance"):
        waves.transmit(0.3 * HERTZ, (1, 0), -1.0, ends="periodic")


def test_a_network_without_a_ball_that_moves_sends_no_pulse():
    network = ideal("square", (12, 4))
    held = replace(network, masses=np.full(network.n_balls, np.inf))
    with pytest.raises(InputError, match="no ball"):
        gp.Waves(held).transmit(0.3 * HERTZ, (1, 0), 4.0 * D)


def on_floor(layers=2):
    """A strip of 24 balls along x on a floor, whose index is the last."""
    ball = gp.Ball(STEEL, D)
    cell = gp.Crystal.on("square", [ball]).at_force(10.0).network
    return cell.repeat((24, 1)).cut(1, layers, ("floor", "free"))


def test_a_pulse_along_a_floor_does_not_depend_on_the_position_of_the_floor():
    """A flat wall may have any position, and the contacts with it do not pass from cell to cell."""
    network = on_floor()
    pulses = []
    for x in (0.0, 7.3 * D, -40.6 * D):
        positions = network.positions.copy()
        positions[-1] = (x, 0.3 * D, 0.0)
        moved = replace(network, positions=positions)
        course = Course.along(moved, np.array([1.0, 0.0, 0.0])).with_ends("free")
        is_at_floor = np.isinf(course.network.radii[course.network.j])
        assert np.count_nonzero(is_at_floor) == 24
        pulses.append(gp.Waves(moved).transmit(2e4, (1, 0), 8.0 * D, 2))
    for pulse in pulses[1:]:
        np.testing.assert_array_equal(pulse.signals, pulses[0].signals)
        np.testing.assert_array_equal(pulse.fastest, pulses[0].fastest)
    # only contacts along the rows make long waves fast: (k/m)^1/2 d
    fastest = np.sqrt(np.max(network.normal_stiffness[:-24]) / network.masses[0]) * D
    assert pulses[0].fastest[0] <= 1.01 * fastest
