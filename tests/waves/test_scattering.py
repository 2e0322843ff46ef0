"""Transmission between half-infinite crystals: closed forms, transfer matrices, conservation,
disorder, refusals.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import t as student

import granphon as gp
from granphon.base.errors import InputError, PrecisionError
from granphon.dynamics.bloch_waves import BlochWaves
from granphon.dynamics.half_space import HalfSpace
from granphon.waves.scattering import TransmissionWork, _require_balance
from granphon.waves.slices import find_slices
from tests.networks.test_cuts import D, bulk, chain
from tests.waves.test_estimates import Counter

K = 2e7
MASS = 9.75e-3
#: frequencies up to the top of a chain of K and MASS, Hz
TOP = np.sqrt(K / MASS) / np.pi
F = np.linspace(1e-3, 1.2, 60) * TOP


def phases(mass, frequencies=F):
    """q d of the wave towards higher balls in a chain; a complex one decays."""
    return 2.0 * np.arcsin(np.pi * frequencies * np.sqrt(mass / K) + 0j).conj()


def even(mass):
    """A chain of equal balls and springs K, two of each in the cell."""
    return chain([mass, mass], (K, K))


def strip(masses, springs):
    """A chain of so many balls, with free ends."""
    n = len(masses)
    found = even(MASS).cut(0, n // 2 + 1).select(range(n))
    order = np.minimum(found.i, found.j)
    return replace(found, masses=np.array(masses), normal_stiffness=np.array(springs)[order])


@pytest.mark.claim("transmission")
def test_an_interface_of_light_and_heavy_balls():
    """Both chains go on across the contact as if it were their own: r = (1 - exp(i(q1 -
    q2)))/(exp(-i(q1 + q2)) - 1).
    """
    light, heavy = (even(mass) for mass in (MASS, 4.0 * MASS))
    frequencies = F[::3]
    q1 = phases(MASS, frequencies)
    q2 = phases(4.0 * MASS, frequencies)
    sent = np.abs((1.0 - np.exp(1j * (q1 - q2))) / (np.exp(-1j * (q1 + q2)) - 1.0)) ** 2
    found = gp.transmission(light, None, heavy, frequencies)
    runs = frequencies < TOP
    assert_allclose(found.reflected[runs], sent[runs], atol=1e-10)
    assert_allclose((found.transmitted + found.reflected)[runs], 1.0, atol=1e-10)
    assert_allclose(found.transmitted[0], 8.0 / 9.0, rtol=1e-5)
    assert np.all(found.transmitted[frequencies > 0.5 * TOP] == 0.0)
    assert not np.any(found.modes[~runs, 0])
    assert not np.any(found.reflected[~runs])
    # the way back lets as much through
    back = gp.transmission(heavy, None, light, frequencies)
    assert_allclose(back.transmitted, found.transmitted, atol=1e-10)
    # very long waves keep all digits: T = 8/9 (1 - omega^2 m/(8 k)) to the next order
    part = np.array([3e-8, 1e-7, 1e-6, 1e-5, 1e-4])
    long = gp.transmission(light, None, heavy, 0.5 * TOP * part)
    assert_allclose(long.transmitted, 8.0 / 9.0 * (1.0 - part**2 / 8.0), rtol=1e-13)
    assert_allclose(long.transmitted + long.reflected, 1.0, rtol=1e-14)


@pytest.mark.claim("transmission")
@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(one, marks=pytest.mark.slow) for one in (2, 3, 4))]
)
def test_a_strip_of_any_balls_and_springs_by_transfer_matrices(seed):
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 12))
    own = random.uniform(0.3, 3.0, 2)
    masses = MASS * random.uniform(0.3, 3.0, n)
    springs = K * random.uniform(0.3, 3.0, n - 1)
    leads = [even(MASS * m) for m in own]
    at = F[: np.searchsorted(F, 0.6 * TOP)]
    found = gp.transmission(leads[0], strip(masses, springs), leads[1], at)
    q1, q2 = (phases(MASS * m, at) for m in own)
    for place, f in enumerate(at):
        # (u, force across the next contact) from ball to ball, from the last ball of the left lead
        # to the right one's first
        step = np.eye(2, dtype=complex)
        for spring, mass in zip((K, *springs), masses, strict=True):
            step = np.array([[1.0, 1.0 / spring], [0.0, 1.0]]) @ step
            step = np.array([[1.0, 0.0], [-mass * (2.0 * np.pi * f) ** 2, 1.0]]) @ step
        step = np.array([[1.0, 1.0 / K], [0.0, 1.0]]) @ step
        # forces K (u_1 - u_0) behind the last ball of the left lead, of the waves in, back and on
        shape = [np.array([1.0, K * (np.exp(1j * q) - 1.0)]) for q in (q1[place], -q1[place])]
        on = np.array([1.0, K * (1.0 - np.exp(-1j * q2[place]))])
        r, t = np.linalg.solve(np.stack([step @ shape[1], -on], axis=1), -step @ shape[0])
        assert_allclose(found.reflected[place], abs(r) ** 2, atol=1e-10)
        flux = np.sin(q2[place].real) / np.sin(q1[place].real)
        assert_allclose(found.transmitted[place], abs(t) ** 2 * flux, atol=1e-10)
    assert_allclose(found.transmitted + found.reflected, 1.0, atol=1e-10)


@pytest.mark.claim("transmission")
@pytest.mark.parametrize(
    ("lattice", "axis", "cells"),
    [
        pytest.param("triangular", 1, 4, marks=pytest.mark.slow),
        ("triangular", (1, 1), 4),
        ("honeycomb", 1, 3),
        pytest.param("fcc", (1, 1, 0), 4, marks=pytest.mark.slow),
        ("fcc", (1, 1, 1), 4),
        pytest.param("hcp", 2, 3, marks=pytest.mark.slow),
    ],
)
def test_energy_is_conserved_whatever_the_strip(lattice, axis, cells):
    """A crystal passes all of its own waves; what a strip of random balls and contacts does not
    pass, it sends back.
    """
    network, random = bulk(lattice), np.random.default_rng(3)
    q = random.uniform(-0.5, 0.5, network.dimension - 1)
    at = (
        np.linspace(0.1, 0.9, 9)
        * gp.Phonons(network).lattice.top_frequency
        * network.scales.frequency
    )
    same = network.cut(axis, cells)
    through = gp.transmission(network, same, network, at, axis=axis, q=q)
    runs = through.modes[:, 0] > 0
    assert np.any(runs)
    assert_allclose(through.transmitted[runs], 1.0, atol=1e-10)
    factor = random.uniform(0.5, 2.0, same.n_balls)
    spring = random.uniform(0.5, 2.0, same.n_contacts)
    odd = replace(
        same,
        masses=factor * same.masses,
        inertias=factor**2 * same.inertias,
        normal_stiffness=spring * same.normal_stiffness,
        shear_stiffness=spring**2 * same.shear_stiffness,
    )
    on = gp.transmission(network, odd, network, at, axis=axis, q=q)
    assert_allclose((on.transmitted + on.reflected)[runs], 1.0, atol=1e-10)
    assert np.all(on.transmitted[runs] < 0.99)
    assert_allclose(on.total, np.sum(np.abs(on.amplitudes) ** 2, axis=(1, 2)), rtol=1e-12)


def test_the_period_of_a_strip_may_be_any_vector_of_its_cell():
    network = bulk("triangular")
    first = network.cut(1, 3)
    order = [1, 0, 2]
    second = replace(
        first, cell=first.cell[order], pbc=(False, True, False), shift=first.shift[:, order]
    )
    top = gp.Phonons(network).lattice.top_frequency * network.scales.frequency
    at = [0.4 * top, 0.7 * top]
    found = gp.transmission(network, second, network, at, axis=1, q=[0.13])
    assert_allclose(found.transmitted, 1.0, atol=1e-10)


@pytest.mark.claim("transmission-slices")
@pytest.mark.parametrize(("lattice", "axis", "cells"), [("honeycomb", 1, 5), ("fcc", (1, 1, 1), 4)])
def test_a_strip_slice_by_slice_is_that_of_factors(lattice, axis, cells, monkeypatch):
    """Of random balls, with and without losses, also where the two ends overlap."""
    network = bulk(lattice)
    random = np.random.default_rng(4)
    q = random.uniform(-0.5, 0.5, network.dimension - 1)
    at = np.array([0.2, 0.45, 0.7]) * gp.Phonons(network).lattice.top_frequency
    at *= network.scales.frequency
    same = network.cut(axis, cells)
    odd = replace(same, masses=random.uniform(0.5, 2.0, same.n_balls) * same.masses)
    pairs = [(odd, {}), (odd, {"loss_factor": 0.1}), (None, {})]
    by_factors = [
        gp.transmission(network, middle, network, at, axis=axis, q=q, **losses)
        for middle, losses in pairs
    ]
    monkeypatch.setattr("granphon.waves.scattering.LARGEST_UNSYMMETRIC", {2: 0, 3: 0})
    monkeypatch.setattr("granphon.waves.scattering._ENTRIES_AT_ONCE", 0)  # one frequency at a time
    for (middle, losses), wanted in zip(pairs, by_factors, strict=True):
        found = gp.transmission(network, middle, network, at, axis=axis, q=q, **losses)
        assert_allclose(found.amplitudes, wanted.amplitudes, atol=1e-10)
        assert_allclose(found.reflected, wanted.reflected, atol=1e-10)
        assert_allclose(found.wavenumbers, wanted.wavenumbers, rtol=1e-12)


def test_the_edge_of_a_band_is_refused_and_its_sides_are_not():
    """At frequencies that gaps() and frequencies() return rounding decides which waves run, and how
    fast they are.
    """
    network = gp.Crystal.on(
        "chain", [gp.Ball(gp.Material(193e9, 0.3, density), D) for density in (8000.0, 2700.0)]
    )
    network = network.at_force(20.0).network
    odd = network.cut(0, 3)
    odd = replace(odd, masses=odd.masses * [1.0, 2.0, 1.3, 0.7, 1.2, 1.0])
    phonons = gp.Phonons(network)
    (low, high), top = phonons.gaps()[0], phonons.frequencies([[0.0]])[0, -1]
    for edge, inwards in ((low, -1.0), (high, 1.0), (top, -1.0)):
        with pytest.raises(PrecisionError, match="edge"):
            gp.transmission(network, odd, network, [edge])
        for rounded in (-2e-15, 0.0, 2e-15):
            with pytest.raises(PrecisionError, match="edge"):
                phonons.complex_bands([edge * (1.0 + rounded)])
        part = np.array([1e-12, 1e-8])
        inside, outside = (np.sort(edge * (1.0 + sign * inwards * part)) for sign in (1.0, -1.0))
        found = gp.transmission(network, odd, network, inside)
        assert_allclose(found.transmitted + found.reflected, 1.0, rtol=1e-7)
        # near an edge a strip that differs passes a part that goes with the distance
        assert_allclose(np.ptp(np.log10(found.transmitted)), 4.0, atol=0.1)
        assert not gp.transmission(network, odd, network, outside).modes.any()


@pytest.mark.parametrize(
    ("lattice", "axis"),
    [
        ("triangular", 1),
        ("fcc", (1, 1, 0)),
        pytest.param("honeycomb", 1, marks=pytest.mark.slow),
    ],
)
def test_energy_is_conserved_or_refused_at_all_edges(lattice, axis):
    """Bands of several motions, some alike: each end of each, where waves of others may run."""
    network = bulk(lattice)
    q = np.full(network.dimension - 1, 0.13)
    space = HalfSpace(network, axis)
    edges = np.sqrt(space.bands(q[None])[0].ravel().clip(0.0)) * space.units.frequency
    same = network.cut(axis, 4)
    refused = 0
    for frequency in edges[edges > 1.0]:
        try:
            found = gp.transmission(network, same, network, [frequency], axis=axis, q=q)
        except PrecisionError:
            refused += 1
            continue
        assert_allclose(found.transmitted[found.modes[:, 0] > 0], 1.0, atol=1e-6)
    assert refused > 0.5 * edges.size


def test_energy_that_does_not_add_up_is_an_error(monkeypatch):
    network = even(MASS)
    monkeypatch.setattr(
        BlochWaves, "find_parts", lambda self, motion: 1.01 * motion[: self.n_running]
    )
    with pytest.raises(PrecisionError, match="of it"):
        gp.transmission(network, network.cut(0, 3), network, [0.3 * TOP])


@pytest.mark.parametrize(
    ("lattice", "axis"),
    [
        ("square", 1),
        pytest.param("honeycomb", 1, marks=pytest.mark.slow),
        pytest.param("sc", 2, marks=pytest.mark.slow),
    ],
)
def test_a_ribbon_or_slab_guides_waves(lattice, axis):
    """Its balls may stand one above another across the way; those of a strip may be listed in any
    order.
    """
    guide = bulk(lattice).cut(axis, 3)
    random = np.random.default_rng(5)
    q = random.uniform(-0.5, 0.5, guide.dimension - 2)
    at = (
        np.linspace(0.11, 0.83, 7)
        * gp.Phonons(guide).lattice.top_frequency
        * guide.scales.frequency
    )
    same = guide.cut(0, 4)
    through = gp.transmission(guide, same, guide, at, q=q)
    assert np.any(through.modes[:, 0] > 1)
    assert_allclose(through.total, through.modes[:, 0], atol=1e-9)
    odd = replace(same, masses=random.uniform(0.5, 2.0, same.n_balls) * same.masses)
    on = gp.transmission(guide, odd, guide, at, q=q)
    assert_allclose(on.transmitted + on.reflected, on.modes[:, 0] > 0, atol=1e-9)
    assert np.any(on.total < 0.9 * through.total)
    mixed = gp.transmission(guide, odd.select(random.permutation(same.n_balls)), guide, at, q=q)
    assert_allclose(mixed.total, on.total, atol=1e-9)


def test_kinds_in_turn_go_on_in_turn():
    """In a checkerboard either kind stands where the other would, if all is moved; a strip is taken
    where it stands.
    """
    light, heavy = (gp.Ball(gp.Material(70e9, 0.3, density), D) for density in (2500.0, 7500.0))
    board = (
        gp.Crystal([light, heavy], [[D, D], [D, -D]], [[0.0, 0.0], [D, 0.0]]).at_force(1.0).network
    )
    at = np.array([0.21, 0.37]) * gp.Phonons(board).lattice.top_frequency * board.scales.frequency
    same = board.cut((1, 1), 4)
    random = np.random.default_rng(0)
    for _ in range(4):
        mixed = same.select(random.permutation(same.n_balls))
        through = gp.transmission(board, mixed, board, at, axis=(1, 1), q=[0.13])
        assert_allclose(through.total, through.modes[:, 0], atol=1e-9)


def test_losses_of_the_strip_are_what_is_missing():
    """To first order they go with the loss factor, or with frequency times damping."""
    network = bulk("triangular")
    at, strip_of = np.array([5e3, 20e3]), network.cut(1, 5)

    def missing(**losses):
        found = gp.transmission(network, strip_of, network, at, axis=1, q=[0.05], **losses)
        return 1.0 - found.transmitted - found.reflected

    loss = [missing(loss_factor=one) for one in (1e-3, 1e-4)]
    assert np.all(loss[1] > 0.0)
    assert_allclose(loss[0] / loss[1], 10.0, rtol=0.02)
    assert_allclose(missing(damping=1e-4 / (2.0 * np.pi * 5e3))[0], loss[1][0], rtol=1e-9)
    slip = missing(damping=(0.0, 1e-8))
    assert np.all((slip > 0.0) & (slip < missing(damping=1e-8)))


@pytest.mark.exhaustive
@pytest.mark.claim("transmission-disorder")
def test_the_mean_free_path_is_that_of_the_spectral_function():
    """Of transverse waves in strips four balls wide, between leads of the effective medium, at two
    frequencies.
    """
    steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    packing = gp.Packing(steel, diameter=8e-3, spread=gp.Uniform(6e-6))
    wide = 4
    force = 18.446

    def samples(length, count):
        simulation = gp.DirectSimulation(
            packing, shape=(wide, length), samples=count, geometry="lattice"
        )
        return [one.network for one in simulation.at_force(force).samples]

    q = 2.0 * np.pi * np.array([14, 24]) / (96 * 8e-3 * np.sqrt(0.75))
    lines = []
    for network in samples(96, 10):
        waves = gp.Waves(network)
        lines.append(
            waves.spectral_function(
                waves.nearest_wavevectors(np.stack([0.0 * q, q], axis=1)), "transverse"
            )
        )
    rate = np.array([1.0 / one.mean_free_path for one in lines])
    at = np.mean([one.peak for one in lines], axis=0)
    lead = gp.EffectiveMedium(packing).at_force(force).network.repeat((wide, 1))
    runs = [
        gp.transmission(lead, network.cut(1, 1), lead, at, axis=1)
        for length in (16, 32, 48, 64)
        for network in samples(length, 12)
    ]
    found = gp.scattering_lengths(runs)
    # the wave along the strip, without a wave vector across it, with the largest wave number
    for place, mode in enumerate(
        found.mean_free_path.shape[1] - 1 - np.argmax(runs[0].wavenumbers[:, ::-1] > 0.0, axis=1)
    ):
        path = found.mean_free_path[place, mode]
        error = found.mean_free_path_error[place, mode]
        other = 1.0 / rate[:, place].mean()
        its = other * rate[:, place].std(ddof=1) / np.sqrt(len(rate)) / rate[:, place].mean()
        assert abs(path - other) < 2.5 * np.hypot(error, its)
        assert error < 0.3 * path
    logs = [
        np.mean([-np.log(one.total[1]) for one in runs[12 * n : 12 * n + 12]]) for n in range(4)
    ]
    assert np.all(np.diff(logs) > 0.0)
    assert np.all(
        found.localisation_length_error
        < [0.3 * found.localisation_length[0], 0.2 * found.localisation_length[1]]
    )


def test_scattering_lengths_of_exact_falls():
    """Amplitudes exp(-L/2l) with small random parts give l and, of one wave, xi = 2 l."""
    light = even(MASS)
    first = gp.transmission(light, strip([MASS] * 2, [K]), light, [0.3 * TOP])
    runs = []
    random = np.random.default_rng(0)
    for length in (1.0, 2.0, 3.0):
        for _ in range(4):
            t = np.exp(-length / 2.0 / 0.8) * (1.0 + 1e-4 * random.standard_normal())
            runs.append(
                replace(
                    first,
                    length=length,
                    amplitudes=np.array([[[t]]], complex),
                    transmitted_by_mode=np.array([[t * t]]),
                )
            )
    found = gp.scattering_lengths(runs)
    assert_allclose(
        [found.mean_free_path[0, 0], found.localisation_length[0]], [0.8, 1.6], rtol=1e-3
    )
    assert abs(found.mean_free_path[0, 0] - 0.8) < 4.0 * found.mean_free_path_error[0, 0]


def pass_chains(length, count, spread, random):
    """Amplitudes (count,) through chains of masses 1 +- spread between even ones, at omega^2 = K/M,
    by transfer matrices.
    """
    masses = 1.0 + random.uniform(-spread, spread, (length, count))
    phase = np.pi / 3.0
    # from the wave that leaves, exp(i n phase) from the first site behind the chain on, back to
    # that before it
    here = np.exp(1j * phase * length)
    ahead = np.exp(1j * phase * (length + 1))
    here, ahead = here - ahead, here
    for mass in masses[::-1]:
        here, ahead = (2.0 - mass) * here - ahead, here
    return (np.exp(-1j * phase) - np.exp(1j * phase)) / (here - ahead * np.exp(1j * phase))


@pytest.mark.claim("transmission-errors")
@pytest.mark.parametrize(
    ("count", "spread"),
    [
        (12, 0.25),
        pytest.param(12, 0.45, marks=pytest.mark.slow),
        pytest.param(24, 0.45, marks=pytest.mark.slow),
    ],
)
def test_errors_of_lengths_are_the_scatter_over_samples(count, spread):
    """Of chains; in place of frequencies there are repetitions, each with samples of its own."""
    light = even(MASS)
    repeats = 300
    random = np.random.default_rng(count)
    assert_allclose(np.abs(pass_chains(5, 1, 0.0, random)), 1.0, rtol=1e-12)
    first = gp.transmission(light, strip([MASS] * 2, [K]), light, [0.3 * TOP])
    lengths = np.array([16, 32, 48, 64])
    runs = []
    energies = []
    logs = []
    for length in lengths:
        runs += [
            replace(
                first,
                length=float(length),
                frequencies=np.arange(1.0, repeats + 1.0),
                modes=np.ones((repeats, 2), int),
                amplitudes=row[:, None, None],
                transmitted_by_mode=np.abs(row[:, None]) ** 2,
            )
            for row in pass_chains(length, count * repeats, spread, random).reshape(count, repeats)
        ]
        many = pass_chains(length, 10_000, spread, random)
        energies.append(np.abs(many.mean()) ** 2)
        logs.append(np.mean(np.log(np.abs(many) ** 2)))
    found = gp.scattering_lengths(runs)
    fall = -np.polyfit(lengths, np.log(energies), 1, w=np.sqrt(energies))[0]
    path = (found.mean_free_path[:, 0], found.mean_free_path_error[:, 0], fall)
    far = (
        0.5 * found.localisation_length,
        0.5 * found.localisation_length_error,
        -np.polyfit(lengths, logs, 1)[0],
    )
    for value, error, true in (path, far):
        known = np.isfinite(error)
        rate = 1.0 / value[known]
        its = error[known] / value[known] ** 2
        # errors that are known from so many samples leave out what Student's distribution has
        # beyond two of them
        missed = np.mean(np.abs(rate - true) > 2.0 * its) * np.mean(known)
        share = 2.0 * student.sf(2.0, count - 1)
        assert missed < share + 3.0 * np.sqrt(share * (1.0 - share) / repeats)
        assert_allclose(np.median(1.0 / value), true, rtol=0.06)
    # and errors are not larger than need be
    assert_allclose(np.sqrt(np.mean(its**2)), np.std(rate), rtol=0.2)


def test_a_wave_that_only_the_shortest_strips_let_through_has_no_error():
    light = even(MASS)
    random = np.random.default_rng(0)
    first = gp.transmission(light, strip([MASS] * 2, [K]), light, [0.3 * TOP])
    runs = []
    for length, mean in ((1.0, 0.5), (2.0, 0.0), (3.0, 0.0)):
        for sign in (1.0, -1.0, 1.0j, -1.0j):
            t = mean + 0.1 * sign * (1.0 + 0.1 * random.standard_normal())
            runs.append(
                replace(
                    first,
                    length=length,
                    amplitudes=np.array([[[t]]], complex),
                    transmitted_by_mode=np.array([[abs(t) ** 2]]),
                )
            )
    found = gp.scattering_lengths(runs)
    assert found.mean_free_path[0, 0] < 1.0
    assert found.mean_free_path_error[0, 0] == np.inf
    alike = [
        replace(one, amplitudes=np.full((1, 1, 1), np.exp(-0.5 * one.length), complex))
        for one in runs
    ]
    exact = gp.scattering_lengths(alike)
    assert_allclose(
        [exact.mean_free_path[0, 0], exact.mean_free_path_error[0, 0]], [1.0, 0.0], atol=1e-9
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frequencies": [2e3, 1e3]}, "ascending"),
        ({"frequencies": [0.0, 1e3]}, "frequencies"),
        ({"frequencies": [1j]}, "frequencies"),
        ({"axis": 5}, "axis"),
        ({"q": [0.1, 0.2]}, "q has the shape"),
        ({"loss_factor": -0.1}, "loss_factor"),
        ({"damping": -1.0}, "damping"),
        ({"left": 3}, "no network"),
        ({"right": "fcc"}, "motions"),
        ({"middle": "wide"}, "does not fit"),
        ({"middle": "periodic"}, "does not fit"),
        ({"middle": "smooth"}, "motions"),
        ({"middle": "shifted"}, "do not stand"),
        ({"frequencies": [1e300]}, "up to"),
        ({"middle": "floor"}, "stand between"),
        ({"middle": "clamped"}, "stand between"),
        ({"middle": "wider"}, "does not fit"),
    ],
)
def test_bad_input_is_one_error(change, words):
    network = bulk("honeycomb")
    strip_of = network.cut(1, 4)
    smooth = replace(strip_of, shear_stiffness=0.0 * strip_of.shear_stiffness)
    moved = replace(strip_of, positions=strip_of.positions * [1.0, 1.24, 1.0])
    wide = network.repeat((2, 1)).cut(1, 4)
    wider = replace(strip_of, cell=1.05 * strip_of.cell)
    named = {
        "floor": network.cut(1, 4, ("floor", "free")),
        "clamped": network.cut(1, 5, ("free", "clamped")),
        "wider": wider,
    }
    named |= {
        "fcc": bulk("fcc"),
        "wide": wide,
        "periodic": network,
        "smooth": smooth,
        "shifted": moved,
    }
    given = {
        "left": network,
        "middle": strip_of,
        "right": network,
        "frequencies": [1e3, 2e3],
        "axis": 1,
        **change,
    }
    given = {
        name: named.get(value, value) if isinstance(value, str) else value
        for name, value in given.items()
    }
    with pytest.raises(InputError, match=words):
        gp.transmission(**given)


def test_a_damping_that_was_meant_as_a_loss_factor():
    """A strip whose dashpots resist more than its springs at the highest frequency is told, as a
    damping has a unit.
    """
    lead = even(MASS)
    middle = strip([MASS] * 4, [K] * 3)
    at = [0.1 * TOP, 0.5 * TOP]
    found = gp.transmission(lead, middle, lead, at, damping=0.02)
    assert f"{0.02 * np.pi * TOP:.3g} times" in found.warnings[0]
    assert len(found.warnings) == 1
    for losses in (
        {"damping": 0.9 / (np.pi * TOP)},
        {"loss_factor": 0.02},
        {"loss_factor": 5.0},
        {},
    ):
        assert not gp.transmission(lead, middle, lead, at, **losses).warnings


# -- what it costs ---------------------------------------------------------------------------------


def test_work_is_estimated_and_told(monkeypatch):
    lead = bulk("fcc")
    strip = lead.cut(2, 6)
    top = gp.Phonons(lead).lattice.top_frequency * lead.scales.frequency
    at = np.linspace(0.1, 0.3, 5) * top
    waves = gp.Waves(strip)
    cost = waves.estimate("transmission", lead, lead, at, axis=2)
    assert [unit.number for unit in cost.units] == [5.0]
    assert cost.seconds > 0.0
    assert f"{strip.n_balls} balls" in cost.text
    progress = Counter()
    gp.transmission(lead, strip, lead, at, axis=2, progress=progress)
    assert progress.done["transmission"] == progress.expected["transmission"] == 5.0
    # strips twice as long and leads as wide take twice the time, and the same memory beside D
    monkeypatch.setattr("granphon.waves.scattering.LARGEST_UNSYMMETRIC", {3: 0})
    monkeypatch.setattr("granphon.waves.estimates._EIGEN_TIME", 0.0)
    costs = [
        gp.Waves(lead.cut(2, cells)).estimate("transmission", lead, lead, at, axis=2)
        for cells in (10, 20)
    ]
    assert costs[1].seconds == pytest.approx(2.0 * costs[0].seconds)


@pytest.mark.parametrize(
    ("lattice", "cells", "depth"), [("triangular", 8, 0.3), ("honeycomb", 4, 0.8)]
)
def test_the_slices_that_are_estimated_are_those_that_are_solved(
    lattice, cells, depth, monkeypatch
):
    """A crack leaves one contact at some depth below the upper end, in diameters, so that the last
    lead alone couples most of the layer above. Of a honeycomb not all balls of that layer touch it.
    """
    lead = bulk(lattice).repeat((cells, 1))
    whole = lead.cut(1, 6)
    heights = whole.positions[:, 1]
    is_above = heights > heights.max() - depth * D
    kept = np.flatnonzero(is_above[whole.i] == is_above[whole.j])
    crossing = np.flatnonzero(is_above[whole.i] != is_above[whole.j])
    kept = np.append(kept, crossing[0])
    cracked = replace(whole, **{name: getattr(whole, name)[kept] for name in whole.contact_fields})
    monkeypatch.setattr("granphon.waves.scattering.LARGEST_UNSYMMETRIC", {2: 0})
    solved_widths = []

    def record_slices(*arguments):
        found = find_slices(*arguments)
        solved_widths.extend(map(len, found))
        return found

    monkeypatch.setattr("granphon.waves.slices.find_slices", record_slices)
    top = gp.Phonons(lead).lattice.top_frequency * lead.scales.frequency
    gp.transmission(lead, cracked, lead, [0.2 * top], axis=1)
    work = TransmissionWork.of(lead, cracked, lead, [0.2 * top], 1, [0.0])
    assert work.widths.tolist() == solved_widths


def test_leads_and_strips_too_wide_for_the_memory_are_refused(monkeypatch):
    lead = bulk("fcc").repeat((3, 3, 1))
    strip = lead.cut(2, 4)
    at = [0.2 * gp.Phonons(bulk("fcc")).lattice.top_frequency * lead.scales.frequency]
    monkeypatch.setattr("granphon.base.memory._ASSUMED_MEMORY", 0.0)
    for module, fault in (
        ("granphon.dynamics.half_space.available_memory", "or fewer in each layer"),
        ("granphon.dynamics.bloch_waves.count_bloch_bytes", "fewer balls in a layer"),
        ("granphon.waves.slices.count_slice_bytes", "narrower strip"),
    ):
        with monkeypatch.context() as changed:
            changed.setattr("granphon.waves.scattering.LARGEST_UNSYMMETRIC", {3: 0})
            if "available" in module:
                changed.setattr("granphon.base.memory.available_memory", lambda: 1e6)
                changed.setattr(module, lambda: 1e6)
            else:
                changed.setattr(module, lambda *_sizes: 1e15)
            with pytest.raises(InputError, match=fault):
                gp.transmission(lead, strip, lead, at, axis=2)
    # a system that does not tell its memory refuses nothing
    monkeypatch.setattr("granphon.dynamics.half_space.available_memory", lambda: np.inf)
    monkeypatch.setattr("granphon.base.memory.available_memory", lambda: np.inf)
    assert HalfSpace(lead, 2).size == 3 * 2 * lead.n_balls


def test_a_strip_that_does_not_fit_is_refused_before_waves_of_leads_are_found(monkeypatch):
    def refuse(*_arguments):
        raise AssertionError("waves of leads were found first")

    monkeypatch.setattr("granphon.waves.scattering.find_bloch_waves", refuse)
    lead = bulk("square")
    strip = bulk("square").repeat((1, 2)).cut(0, 4)  # twice as wide as the lead
    with pytest.raises(InputError, match="does not fit"):
        gp.transmission(lead, strip, lead, [100.0])
    with pytest.raises(InputError, match="does not fit"):
        gp.Waves(strip).estimate("transmission", lead, lead, [100.0])


def test_a_wave_vector_along_the_layers_without_digits_is_refused():
    lead = bulk("square")
    with pytest.raises(PrecisionError, match="1e\\+20 reciprocal vectors from Gamma"):
        gp.transmission(lead, None, lead, [100.0], q=[1e20])


@pytest.mark.parametrize("largest", [10**6, 3])
def test_a_mode_of_the_strip_that_no_wave_reaches_is_told(monkeypatch, largest):
    """A ball on one spring to a held ball, which the rest of the chain does not touch: by factors
    and slice by slice.
    """
    monkeypatch.setattr("granphon.waves.scattering.LARGEST_UNSYMMETRIC", {1: largest})
    lead = gp.ContactLattice.of("chain", 0.0).contact_network(gp.Units(1.0, 1.0, 1.0))
    chain_of_balls = lead.repeat((8,)).cut(0, 1)
    is_left = ~np.isin(np.minimum(chain_of_balls.i, chain_of_balls.j), [2, 4])
    contacts = {
        name: getattr(chain_of_balls, name)[is_left] for name in chain_of_balls.contact_fields
    }
    masses = np.where(np.arange(8) == 3, np.inf, chain_of_balls.masses)
    strip_with_mode = replace(chain_of_balls, masses=masses, **contacts)
    frequency = 1.0 / (2.0 * np.pi)
    with pytest.raises(PrecisionError, match=r"159\.15494\d* mHz .*mode of exactly"):
        gp.transmission(lead, strip_with_mode, lead, [frequency])
    found = gp.transmission(lead, strip_with_mode, lead, [frequency * 1.000001])
    assert_allclose([found.transmitted[0], found.reflected[0]], [0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("excess", [1e-5, -1e-5, np.nan, np.inf])
def test_energy_that_is_not_conserved_or_not_known_is_refused(excess):
    hertz = np.array([1.0, 2.0])
    _require_balance(hertz, np.array([[1e-7, 0.0], [0.0, 0.0]]))
    _require_balance(hertz, np.zeros((2, 0)))  # no wave runs in
    with pytest.raises(PrecisionError, match="2 Hz"):
        _require_balance(hertz, np.array([[1e-7, 0.0], [0.0, excess]]))
