"""Densities of states and spectral functions of networks: against dense matrices, bands, sums, and
kwant.
"""

from __future__ import annotations

import dataclasses
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student

import granphon as gp
from granphon.balls.diameters import uniform_numbers
from granphon.base.errors import InputError, InstabilityError, PrecisionError
from granphon.figures.plot import plot
from granphon.networks.network import ContactNetwork
from granphon.waves.chebyshev import Kernel, Moments
from granphon.waves.path_spectra import find_packing_points
from granphon.waves.spectral_functions import (
    PeriodicCell,
    SpectralFunction,
    _find_shortest,
    find_ioffe_regel,
    find_lines,
    find_true_width,
    fold_wavevectors,
    nearest_wavevectors,
)

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
UNITS = gp.Units(8e-3, 3e6, 2e-3)
ETA = 0.8


def ideal(name="triangular", shape=(6, 5), eta=ETA, **more):
    """The lattice, and the network of its cells."""
    lattice = gp.ContactLattice.of(name, eta, **more)
    return lattice, lattice.contact_network(UNITS).repeat(shape)


def q_of(lattice, fractions):
    """Wave vectors, 1/m, of fractions of the reciprocal cell."""
    return lattice.wavevectors(np.atleast_2d(fractions)) / UNITS.length


class Dense:
    """All modes of a network: frequencies, Hz, and vectors."""

    def __init__(self, network):
        self.operator = gp.Waves(network).operator
        squares, self.vectors = np.linalg.eigh(self.operator.matrix.toarray())
        self.frequencies = np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)

    def density(self, kernel, *starts):
        """The spectrum seen from vectors: a line for each mode, by its share."""
        share = sum((self.vectors.T @ start) ** 2 for start in starts)
        return kernel.densities(share @ kernel.moments_of(self.frequencies))


@pytest.fixture(scope="module")
def disordered():
    """A sample with open contacts, friction and rotations."""
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))
    return (
        gp.DirectSimulation(packing, shape=(7, 6), seed=3, geometry="lattice")
        .at_force(0.05)
        .sample.network
    )


@pytest.fixture(scope="module")
def waves(disordered):
    return gp.Waves(disordered)


@pytest.fixture(scope="module")
def dense(disordered):
    return Dense(disordered)


@pytest.fixture
def estimated(monkeypatch):
    """Densities of states of small networks are found as those of large ones, by random vectors."""
    monkeypatch.setattr("granphon.waves.waves.MOST_DENSE_MOTIONS", 0)


# -- the kernel ------------------------------------------------------------------------------------


@pytest.mark.parametrize("moments", [2, 3, 17, 200])
def test_kernel_is_jacksons(moments):
    # the squares of a sum with the coefficients U_n(cos(pi / (N + 1))), of norm one, are the kernel
    # of N = 2 M - 1 moments
    order = 2 * moments - 1
    a = np.sin(np.pi * np.arange(1, order + 1) / (order + 1))
    a /= np.linalg.norm(a)
    twin = [a[: order - m] @ a[m:] for m in range(0, order, 2)]
    np.testing.assert_allclose(Kernel(7.0, moments).weights, twin, atol=1e-13)


def test_line_is_the_series_of_its_definition():
    kernel = Kernel(7.0, 9)
    line = 2.3
    x = kernel.frequencies / kernel.top
    y = line / kernel.top
    terms = [np.polynomial.chebyshev.Chebyshev.basis(2 * n) for n in range(9)]
    series = sum(
        (1 if n == 0 else 2) * kernel.weights[n] * one(x) * one(y) for n, one in enumerate(terms)
    )
    np.testing.assert_allclose(
        kernel.line(line), 2 * series / (np.pi * 7.0 * np.sqrt(1 - x**2)), rtol=1e-11, atol=1e-14
    )


@given(st.floats(0.0, 1.0), st.integers(2, 400), st.floats(1e-12, 1e12))
def test_line_has_the_integral_one_and_is_nowhere_negative(place, moments, top):
    kernel = Kernel(top, moments)
    line = kernel.line(place * top)
    assert kernel.integral(line) == pytest.approx(1.0, rel=1e-11)
    assert line.min() >= -1e-12 * line.max()
    assert kernel.frequencies[0] == 0.0
    assert np.all(np.diff(kernel.frequencies) > 0.0)
    assert kernel.frequencies[-1] < top


def test_line_is_as_wide_as_the_resolution():
    kernel = Kernel.of(30e3, resolution=100.0)
    assert kernel.resolution <= 100.0
    for line in (12e3, 20e3, 27e3):
        density = kernel.line(line)
        mean = kernel.integral(density * kernel.frequencies)
        spread = math.sqrt(kernel.integral(density * (kernel.frequencies - mean) ** 2))
        assert spread == pytest.approx(
            kernel.resolution * math.sqrt(1 - (line / 30e3) ** 2), rel=2e-2
        )
        # the trapezoidal sum, as users take it
        assert np.trapezoid(density, kernel.frequencies) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("moments", [4, 31, 201, 1000, 2**20])
def test_resolution_and_moments_belong_together(moments):
    assert Kernel.of(12345.6, resolution=Kernel(12345.6, moments).resolution).moments == moments


@pytest.mark.parametrize("top", [100.0, 123.4, 98765.4])
@pytest.mark.parametrize("resolution", [1e-12, 1e12])
def test_the_resolution_that_an_error_names_is_allowed(top, resolution):
    with pytest.raises(InputError) as error:
        Kernel.of(top, resolution)
    _, limit = str(error.value).rsplit("Give ", 1)
    moments = Kernel.of(top, float(limit.split()[0])).moments
    assert moments in (4, 5) or 0.99 * 2**20 < moments <= 2**20


@pytest.mark.parametrize("polarisation", ["longitudinal", "transverse"])
def test_the_longest_waves_along_an_open_axis_have_a_direction(polarisation):
    lattice = gp.ContactLattice.of("triangular", 0.8)
    strip = lattice.contact_network(gp.Units(8e-3, 3e6, 2e-3)).repeat((4, 1)).cut(1, 3)
    found = gp.Waves(strip).spectral_function([[0.0, 5e-324], [0.0, 1e-9]], polarisation)
    np.testing.assert_allclose(found.values[0], found.values[1], atol=1e-9 * found.values.max())
    assert not any(array.flags.writeable for array in (found.peak, found.width))


def test_kernel_refuses():
    with pytest.raises(InputError, match="follows"):
        Kernel.of(1.0, resolution=0.1, moments=10)
    with pytest.raises(InputError, match=r"1.57e\+10 moments.*1.5e-06 Hz"):
        Kernel.of(1.0, resolution=1e-10)
    for coarse in (0.5, Fraction(1, 2)):
        with pytest.raises(InputError, match=r"of 0\.5 Hz .*apart.* 0\.392 Hz"):
            Kernel.of(1.0, resolution=coarse)
    for bad in (0.0, -1.0, math.nan, "3 Hz"):
        with pytest.raises(InputError, match="resolution"):
            Kernel.of(1.0, resolution=bad)
    for bad in (1, 2.5, True):
        with pytest.raises(InputError, match="moments"):
            Kernel.of(1.0, moments=bad)


# -- moments ---------------------------------------------------------------------------------------


def test_moments_are_those_of_the_matrix(waves, dense):
    vectors = np.random.default_rng(4).normal(size=(13, waves.operator.size))
    kernel = Kernel(waves.operator.top / (2 * np.pi), 43)
    exact = (vectors @ dense.vectors) ** 2 @ kernel.moments_of(dense.frequencies)
    starts = [vector.copy for vector in vectors]
    for keep in (True, False):
        moments = Moments(waves.operator, starts, is_kept=keep)
        np.testing.assert_allclose(moments.first(43), exact, atol=1e-11 * exact[0, 0])
        parts = Moments(waves.operator, starts, is_kept=keep)
        for count in (1, 2, 10, 11, 5, 43):
            np.testing.assert_array_equal(parts.first(count), moments.first(count))


def buckled():
    """A chain under load that moves across itself too, without friction: nothing resists that."""
    count = 12
    i = np.arange(count)
    normal = np.tile([1.0, 0.0, 0.0], (count, 1))
    return ContactNetwork(
        cell=np.diag([count * 1e-2, 0, 0]),
        pbc=(True, False, False),
        positions=1e-2 * i[:, None] * normal,
        radii=np.full(count, 5e-3),
        masses=np.full(count, 1e-3),
        inertias=np.full(count, 1e-8),
        i=i,
        j=(i + 1) % count,
        shift=np.where(i[:, None] == count - 1, [1, 0, 0], [0, 0, 0]),
        normal=normal,
        normal_force=np.full(count, 50.0),
        normal_stiffness=np.full(count, 1e5),
        shear_stiffness=np.zeros(count),
        torsion_stiffness=np.zeros(count),
        bending_stiffness=np.zeros(count),
        arm_i=np.full(count, 5e-3),
        arm_j=np.full(count, 5e-3),
        motions="in_plane",
        dimension=1,
        prestress=True,
    )


def test_network_that_buckles_is_an_error():
    network = buckled()
    waves = gp.Waves(network)
    for call in (waves.dos, waves.modes, lambda: waves.spectral_function([0.0], direction=(1, 0))):
        with pytest.raises(InstabilityError, match="prestress=False"):
            call()
    # polynomials grow, which is noticed where factors would be too large
    start = np.random.default_rng(0).normal(size=waves.operator.size)
    with pytest.raises(InstabilityError):
        Moments(waves.operator, [start.copy]).first(200)


# -- density of states -----------------------------------------------------------------------------


@pytest.mark.usefixtures("estimated")
def test_dos_is_that_of_its_random_vectors(waves, dense):
    dos = waves.dos(moments=60, vectors=3, seed=5)
    kernel = Kernel(dos.top, 60)
    operator = waves.operator
    parts = []
    for number in range(3):
        own = int(uniform_numbers(3, 5)[number] * 2**52)
        signs = np.where(uniform_numbers((42, 3), own) > 0.5, 1.0, -1.0)
        moved = signs.copy()
        turned = signs.copy()
        moved[:, 2] = 0.0
        turned[:, :2] = 0.0
        parts.append([dense.density(kernel, operator.vector(one)) / 42 for one in (moved, turned)])
    mean = np.mean(parts, axis=0)
    np.testing.assert_allclose([dos.translational, dos.rotational], mean, atol=1e-10 * mean.max())
    total = np.sum(parts, axis=1)
    np.testing.assert_allclose(dos.total, total.mean(axis=0), atol=1e-10 * mean.max())
    np.testing.assert_allclose(
        dos.error, total.std(axis=0, ddof=1) / math.sqrt(3), atol=1e-10 * mean.max()
    )
    assert dos.integral == pytest.approx(3.0, rel=1e-12)
    assert Kernel(dos.top, 60).integral(dos.rotational) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.usefixtures("estimated")
@pytest.mark.claim("spectra-errors")
def test_error_of_the_dos_is_honest(waves, dense):
    """Student's t of the deviation from the exact trace: 95 % of all points are within its
    bounds.
    """
    inside = []
    for seed in range(40):
        dos = waves.dos(moments=24, vectors=8, seed=seed)
        exact = (
            Kernel(dos.top, 24)
            .densities(Kernel(dos.top, 24).moments_of(dense.frequencies))
            .sum(axis=0)
            / 42
        )
        there = exact > 1e-3 * exact.max()
        inside.append(
            np.mean(np.abs(dos.total - exact)[there] <= student.ppf(0.975, 7) * dos.error[there])
        )
    # points of one seed are related: over 40 seeds the mean scatters by 0.02
    assert 0.89 < np.mean(inside) < 0.99


@pytest.mark.usefixtures("estimated")
def test_dos_refines_to_the_same_bits(waves):
    whole = waves.dos(moments=81, vectors=4, seed=2)
    first = waves.dos(moments=20, vectors=2, seed=2)
    assert first.with_moments(81).with_vectors(4) == whole
    assert first.with_vectors(4).with_moments(81) == whole
    assert whole.with_moments(20).with_vectors(2) == first
    assert first.with_resolution(whole.resolution).moments == 81
    assert waves.dos(resolution=whole.resolution, vectors=4, seed=2) == whole
    assert waves.dos(moments=20, vectors=2, seed=3) != first


@pytest.mark.usefixtures("estimated")
def test_one_vector_has_no_error(waves):
    dos = waves.dos(moments=20, vectors=1)
    assert np.all(np.isnan(dos.error))
    back = type(dos).from_dict(dos.to_dict())
    assert back == dos
    assert back.integral == dos.integral
    with pytest.raises(InputError, match="was read from data"):
        back.with_moments(30)
    with pytest.raises(InputError, match="was read from data"):
        back.with_vectors(2)


@pytest.mark.parametrize("moments", [24, 800, pytest.param(4000, marks=pytest.mark.slow)])
def test_dos_of_a_small_network_is_that_of_its_modes(waves, dense, moments):
    found = waves.dos(moments=moments, vectors=1)
    kernel = Kernel(found.top, moments)
    turning = np.sum(dense.vectors[waves.operator.is_rotation] ** 2, axis=0)
    for values, weight in ((found.rotational, turning), (found.translational, 1.0 - turning)):
        exact = kernel.densities(weight @ kernel.moments_of(dense.frequencies)) / 42
        np.testing.assert_allclose(values, exact, atol=1e-6 * exact.max())
    assert not np.any([found.error, found.translational_error, found.rotational_error])
    assert found.vectors == 0
    assert found == waves.dos(moments=moments, vectors=9, seed=0)
    assert found.with_vectors(3) == found
    assert found.with_moments(80) == waves.dos(moments=80)
    assert type(found).from_dict(found.to_dict()) == found
    assert found.integral == pytest.approx(3.0, rel=1e-12)


@pytest.mark.usefixtures("estimated")
@pytest.mark.parametrize("vectors", [2**26 // 256 + 1, 10**9, 10**400])
def test_too_many_random_vectors_are_refused(waves, vectors):
    with pytest.raises(InputError, match="vectors"):
        waves.dos(vectors=vectors)
    with pytest.raises(InputError, match="vectors"):
        waves.dos(vectors=1).with_vectors(vectors)


def test_dos_of_a_large_array_is_that_of_its_bands():
    packing = gp.Packing(STEEL, 8e-3)
    state = gp.AveragedLattice(packing).at_force(18.446)
    lattice = gp.ContactLattice.of("triangular", packing.mindlin_ratio)
    units = gp.Units(8e-3, state.normal_stiffness, packing.mass)
    waves = gp.Waves(lattice.contact_network(units).repeat((48, 48)))
    dos = waves.dos(moments=64, vectors=6)
    bands = gp.Phonons(state).dos(mesh=(96, 96), points=4000)
    kernel = Kernel(dos.top, 64)
    lines = kernel.moments_of(bands.frequencies)
    inside = []
    for found, error, exact in (
        (dos.total, dos.error, bands.total),
        (dos.translational, dos.translational_error, bands.translational),
        (dos.rotational, dos.rotational_error, bands.rotational),
    ):
        expected = kernel.densities(exact * np.gradient(bands.frequencies) @ lines)
        assert np.max(np.abs(found - expected)) < 0.1 * expected.max()
        inside.append(np.mean(np.abs(found - expected) < student.ppf(0.995, 5) * error))
    # of 99 %; neighbouring points are related
    assert np.mean(inside) > 0.94


def test_dos_near_zero_frequency_is_debyes():
    """In the plane the density is proportional to the frequency near zero; polynomials of omega^2
    would not resolve that.
    """
    lattice, network = ideal(shape=(60, 60))
    dos = gp.Waves(network).dos(moments=80, vectors=20)
    q = lattice.wavevectors([[1e-4, 0.0]])
    velocities = lattice.frequencies(q)[0][:2] / np.linalg.norm(q) * UNITS.velocity
    slope = 2 * math.pi * UNITS.length**2 * math.sqrt(3) / 2 * np.sum(1 / velocities**2)
    low = (dos.frequencies > 3 * dos.resolution) & (dos.frequencies < 8 * dos.resolution)
    assert np.mean(dos.total[low] / dos.frequencies[low]) == pytest.approx(slope, rel=0.05)


# -- spectral functions ----------------------------------------------------------------------------


def plane_wave(waves, q, polarisation):
    """cos and sin of a plane wave by hand, (2, size), of norm one together; balls that touch none
    left out.
    """
    network = waves.network
    operator = waves.operator
    touching = np.bincount(np.concatenate([network.i, network.j]), minlength=network.n_balls) > 0
    phase = network.positions[:, : len(q)] @ q
    values = np.stack([np.cos(phase), np.sin(phase)]) * np.sqrt(network.masses) * touching
    vectors = [operator.vector(one[:, None] * polarisation) for one in values]
    return np.array(vectors) / math.sqrt(np.sum(np.square(vectors)))


@pytest.mark.claim("spectra-exact")
@pytest.mark.parametrize(
    ("polarisation", "row"),
    [("longitudinal", 0), ("transverse", 1), ("rotational", 2), ([0.6, 0.0, 0.8], None)],
)
def test_spectral_function_is_that_of_the_matrix(waves, dense, polarisation, row):
    q = waves.nearest_wavevectors([[110.0, 40.0], [-20.0, 300.0]])
    found = waves.spectral_function(q, polarisation, moments=90)
    kernel = Kernel(found.top, 90)
    for one, values in zip(q, found.values, strict=True):
        ahead = one / np.linalg.norm(one)
        frame = np.array([[*ahead, 0.0], [-ahead[1], ahead[0], 0.0], [0.0, 0.0, 1.0]])
        start = plane_wave(waves, one, np.array(polarisation) if row is None else frame[row])
        exact = dense.density(kernel, *start)
        np.testing.assert_allclose(values, exact, atol=1e-10 * exact.max())
        # the mean of omega^2 is the diagonal of D between plane waves
        diagonal = sum(x @ (waves.operator @ x) for x in start)
        plain = (
            sum((dense.vectors.T @ x) ** 2 for x in start) @ (2 * np.pi * dense.frequencies) ** 2
        )
        assert plain == pytest.approx(diagonal, rel=1e-10)
        second = 0.5 * waves.operator.top**2 * (1.0 + _second_moment(found, values))
        assert second == pytest.approx(diagonal, rel=1e-9)
    np.testing.assert_allclose(found.integral, 1.0, rtol=1e-12)
    assert found == waves.spectral_function(q, polarisation, moments=31).with_moments(90)
    assert type(found).from_dict(found.to_dict()) == found


def _second_moment(found, values):
    """The moment of T_2, out of the values, without the factor of the kernel."""
    kernel = Kernel(found.top, found.moments)
    x = kernel.frequencies / kernel.top
    return kernel.integral(values * (2 * x**2 - 1)) / kernel.weights[1]


@pytest.mark.parametrize(
    ("name", "shape", "motions"),
    [
        ("triangular", (8, 6), "in_plane"),
        ("square", (6, 6), "all"),
        ("fcc", (4, 4, 4), None),
        ("chain", (12,), None),
    ],
)
def test_ideal_array_has_the_lines_of_its_bands(name, shape, motions):
    """Each wave is made of the bands at its q, each with the width of the kernel alone."""
    from granphon.balls.motions import allowed_motions

    p = len(shape)
    among = allowed_motions(p)[motions] if motions else None
    lattice, network = ideal(
        name, shape, 0.0 if name == "chain" else ETA, **({"motions": among} if among else {})
    )
    waves = gp.Waves(network)
    n = np.array([2, 1, 1][:p]) / np.array(shape)
    q = q_of(lattice, n)
    found = waves.spectral_function(q, moments=120)
    modes = lattice.modes(lattice.wavevectors(np.atleast_2d(n)))
    vectors = np.asarray(modes.eigenvectors[0])
    ahead = np.zeros(3)
    ahead[:p] = q[0] / np.linalg.norm(q[0])
    start = np.zeros(len(vectors))
    start[: len(waves.operator.motions.translations)] = ahead[
        list(waves.operator.motions.translations)
    ]
    share = np.abs(vectors.conj().T @ start) ** 2
    kernel = Kernel(found.top, 120)
    exact = share @ kernel.line(np.asarray(modes.frequencies[0]) * UNITS.frequency)
    np.testing.assert_allclose(found.values[0], exact, atol=1e-9 * exact.max())
    assert not found.resolved[0]
    assert found.width[0] <= 0.02 * found.resolution


def test_transverse_waves_in_space_are_two():
    lattice, network = ideal("fcc", (4, 4, 4))
    waves = gp.Waves(network)
    q = q_of(lattice, [1 / 4, 1 / 4, 1 / 2])  # along (1, 1, 0)
    ahead = q[0] / np.linalg.norm(q[0])
    np.testing.assert_allclose(
        np.sort(np.abs(ahead)), [0.0, math.sqrt(0.5), math.sqrt(0.5)], atol=1e-12
    )
    first = np.eye(3)[np.argmin(np.abs(ahead))]
    ways = [
        waves.spectral_function(q, "transverse", direction=way, moments=40)
        for way in (first, np.cross(ahead, first))
    ]
    mean = waves.spectral_function(q, "transverse", moments=40)
    np.testing.assert_allclose(
        mean.values, 0.5 * (ways[0].values + ways[1].values), atol=1e-12 * mean.values.max()
    )
    assert abs(ways[0].peak[0] - ways[1].peak[0]) > 0.5 * mean.resolution
    turns = [
        waves.spectral_function(q, "rotational", direction=way, moments=40).values
        for way in np.eye(3)
    ]
    whole = waves.spectral_function(q, "rotational", moments=40)
    np.testing.assert_allclose(
        whole.values, np.mean(turns, axis=0), atol=1e-12 * whole.values.max()
    )


def test_uniform_motion_is_a_line_at_zero(waves):
    found = waves.spectral_function([0.0, 0.0], direction=(3, 1), moments=50)
    line = Kernel(found.top, 50).line(0.0)
    np.testing.assert_allclose(found.values[0], line, atol=1e-9 * line.max())
    assert found.peak[0] == 0.0
    with pytest.raises(InputError, match="q = 0 has no velocity"):
        _ = found.phase_velocity


def test_wave_vectors_are_those_of_the_cell(waves):
    network = waves.network
    with pytest.raises(InputError, match=r"periodic cell.*nearest is \(") as caught:
        waves.spectral_function([100.0, 3.0])
    named = [
        float(one) for one in str(caught.value).split("nearest is (")[1].split(")")[0].split(",")
    ]
    nearest = waves.nearest_wavevectors([100.0, 3.0])
    np.testing.assert_allclose(named, nearest, rtol=1e-7)
    whole = network.cell[:2, :2] @ nearest / (2 * np.pi)
    np.testing.assert_allclose(whole, np.rint(whole), atol=1e-9)
    # no other one is nearer
    grid = np.stack(np.meshgrid(*[np.arange(-15, 16)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    others = 2 * np.pi * grid @ np.linalg.inv(network.cell[:2, :2]).T
    assert (
        np.linalg.norm(nearest - [100.0, 3.0])
        <= np.min(np.linalg.norm(others - [100.0, 3.0], axis=1)) + 1e-9
    )
    np.testing.assert_array_equal(
        waves.nearest_wavevectors(nearest), waves.nearest_wavevectors([nearest])[0]
    )
    waves.spectral_function(np.round(nearest, 6), moments=4)  # rounded to a few digits, as printed
    assert gp.Waves(network).spectral_function([nearest, -nearest], moments=4).values.shape == (
        2,
        17,
    )


@given(numbers=st.tuples(*[st.integers(-9, 9)] * 3))
def test_wave_vectors_of_the_cell_have_the_same_digits_whoever_asks(numbers):
    # those that are found are found again to the last bit, and what rounds to Gamma is zero: it has
    # no direction
    _, network = ideal("fcc", (6, 6, 4))
    waves = gp.Waves(network)
    q = 2.0 * np.pi * np.array(numbers) @ np.linalg.inv(network.cell).T
    found = waves.nearest_wavevectors(q)
    np.testing.assert_allclose(found, q, rtol=1e-12, atol=1e-12 * 2.0 * np.pi / UNITS.length)
    np.testing.assert_array_equal(waves.nearest_wavevectors(found), found)
    np.testing.assert_array_equal(waves.nearest_wavevectors([21.2, 21.2, 0.0]), 0.0)


def test_a_wave_vector_shorter_than_those_of_the_cell_is_told_the_shortest():
    _, network = ideal("square", (8, 8))
    waves = gp.Waves(network)
    shortest = 2.0 * np.pi / np.linalg.norm(network.cell[0])
    short = np.array([0.3 * shortest, 0.0])
    assert not np.any(waves.nearest_wavevectors(short))
    for q in (short, waves.nearest_wavevectors(short)):
        with pytest.raises(InputError, match=f"{shortest:.6g}"):
            waves.spectral_function(q, moments=4)


def test_network_with_ends_has_any_wave_vector(disordered):
    from dataclasses import replace

    inside = ~np.any(disordered.shift, axis=1)
    cut = {
        name: getattr(disordered, name)[inside]
        for name in ContactNetwork._shapes
        if np.shape(getattr(disordered, name))[:1] == inside.shape
    }
    free = replace(disordered, pbc=(False, False, False), lattice=None, shape=None, **cut)
    waves = gp.Waves(free)
    q = [103.4, -17.0]
    np.testing.assert_array_equal(waves.nearest_wavevectors(q), q)
    found = waves.spectral_function(q, moments=40)
    ahead = np.array(q) / np.linalg.norm(q)
    exact = Dense(free).density(
        Kernel(found.top, 40), *plane_wave(waves, np.array(q), np.array([*ahead, 0.0]))
    )
    np.testing.assert_allclose(found.values[0], exact, atol=1e-10 * exact.max())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"q": [0.0, 0.0]}, "q = 0 has no direction"),
        ({"q": [1.0]}, "shape"),
        ({"q": [[[0.0, 0.0]]]}, "shape"),
        ({"q": [math.nan, 0.0]}, "q"),
        ({"polarisation": "shear"}, "transverse, rotational"),
        ({"polarisation": [1.0]}, "2 .*3 motions x, y, w"),
        ({"polarisation": [0.0, 0.0]}, "not all zero"),
        ({"polarisation": []}, "polarisation"),
        ({"polarisation": [1.0, 0.0], "direction": (1, 0)}, "Leave the direction out"),
        ({"polarisation": "transverse", "direction": "q"}, "is along q"),
        ({"polarisation": "transverse", "direction": (0, 0, 1)}, "x, y, w alone"),
        ({"polarisation": "rotational", "direction": (1, 0, 0)}, "do not turn"),
        ({"direction": (0, 0), "polarisation": "transverse"}, "direction"),
        ({"direction": (0, 1)}, "moves along q"),
        ({"resolution": 1.0, "moments": 3}, "Each follows"),
    ],
)
def test_what_is_no_wave_is_refused(waves, arguments, words):
    q = waves.nearest_wavevectors([100.0, 0.0])
    if arguments.get("direction") == "q":
        arguments = arguments | {"direction": tuple(q)}
    with pytest.raises(InputError, match=words):
        waves.spectral_function(**{"q": q, **arguments})


def test_waves_out_of_the_plane_are_transverse():
    from granphon.balls.motions import allowed_motions

    lattice, network = ideal(shape=(6, 6), motions=allowed_motions(2)["out_of_plane"], bending=0.02)
    waves, q = gp.Waves(network), q_of(lattice, [1 / 6, 0.0])
    found = waves.spectral_function(q, "transverse", moments=60)
    np.testing.assert_allclose(
        found.values, waves.spectral_function(q, [1.0, 0.0, 0.0], moments=60).values, rtol=1e-12
    )
    with pytest.raises(InputError, match="no longitudinal wave"):
        waves.spectral_function(q)
    lattice, network = ideal(
        shape=(6, 6), motions=allowed_motions(2)["all"], bending=0.02, torsion=0.02
    )
    waves = gp.Waves(network)
    inside = waves.spectral_function(q, "transverse", moments=60)
    np.testing.assert_allclose(
        waves.spectral_function(q, "transverse", direction=(0, 0, 1), moments=60).values.shape,
        (1, 241),
    )
    across = np.array([-q[0, 1], q[0, 0], 0.0])
    np.testing.assert_allclose(
        inside.values, waves.spectral_function(q, across, moments=60).values, rtol=1e-9, atol=1e-15
    )


# -- lines -----------------------------------------------------------------------------------------


def lorentz(kernel, peak, width):
    """The density of a Lorentz curve that the kernel has broadened, and continued evenly; of a line
    for each 15 Hz.
    """
    f = np.linspace(0.0, 0.5 * kernel.top, 1001)
    weights = sum(0.5 * width / ((f - way * peak) ** 2 + 0.25 * width**2) for way in (1.0, -1.0))
    return kernel.densities(weights / weights.sum() @ kernel.moments_of(f))


@pytest.mark.claim("spectra-width")
@pytest.mark.parametrize(("width", "accuracy"), [(600.0, 2e-2), (150.0, 2e-2), (60.0, 5e-2)])
def test_width_of_a_line_is_found_without_that_of_the_kernel(width, accuracy):
    kernel = Kernel.of(30e3, resolution=75.0)
    density = lorentz(kernel, 9e3, width)[None]
    ((peak,), seen), (_, own) = find_lines(kernel, density), find_lines(kernel, kernel.line([9e3]))
    assert peak == pytest.approx(9e3, abs=0.05 * kernel.resolution)
    assert own[0] == pytest.approx(2.355 * kernel.resolution * math.sqrt(1 - 0.3**2), rel=0.03)
    assert find_true_width(seen, own)[0] == pytest.approx(width, rel=accuracy)


def test_a_line_as_broad_as_all_frequencies_is_refused():
    """The kernel of four moments alone makes it so broad: the spectrum is a line of no width."""
    kernel = Kernel(30e3, 4)
    with pytest.raises(InputError, match="half its height"):
        find_lines(kernel, kernel.line([0.565 * kernel.top]))


def of_lines(peaks, widths, moments=300):
    """A spectral function with Lorentz curves, at wave vectors on a straight band."""
    kernel = Kernel(30e3, moments)
    values = np.array([lorentz(kernel, p, w) for p, w in zip(peaks, widths, strict=True)])
    q = np.stack([np.asarray(peaks) / 80.0, 0.0 * np.asarray(peaks)], axis=1)
    return SpectralFunction(q, "longitudinal", (), kernel.frequencies, values, 30e3, moments)


def test_mean_free_path_and_ioffe_regel():
    """A velocity of 2 pi 80 m/s, and widths that grow with the fourth power of the frequency: width
    = f at 5 kHz.
    """
    peaks = np.arange(2e3, 6e3, 5e2)
    found = of_lines(peaks, 5e3 * (peaks / 5e3) ** 4)
    np.testing.assert_allclose(found.phase_velocity[:2], 2 * np.pi * 80.0, rtol=2e-2)
    np.testing.assert_allclose(
        found.mean_free_path, found.phase_velocity / (2 * np.pi * found.width), rtol=1e-12
    )
    np.testing.assert_allclose(
        found.attenuation, np.pi * found.width / found.phase_velocity, rtol=1e-12
    )
    np.testing.assert_allclose(found.width[1], 5e3 * 0.5**4, rtol=2e-2)
    assert found.resolved.tolist()[1:] == [True] * 7
    limit = found.ioffe_regel()
    n = np.flatnonzero(found.width > found.peak)[0]
    assert found.peak[n - 1] < limit < found.peak[n]
    # at the limit the mean free path is the wavelength over 2 pi
    path = np.interp(
        limit, found.peak[n - 1 : n + 1], (found.wavenumber * found.mean_free_path)[n - 1 : n + 1]
    )
    assert path == pytest.approx(1.0, abs=0.1)
    assert found.ioffe_regel(math.pi) < limit
    assert of_lines(peaks, 50.0 + 0 * peaks).ioffe_regel() is None
    with pytest.raises(InputError, match="already beyond"):
        of_lines(peaks, 5e3 + 0 * peaks).ioffe_regel(10.0)


def perfect(name, shape):
    """The lattice at its default stiffness, and the waves of a perfect array that knows its
    lattice.
    """
    state = gp.AveragedLattice(gp.Packing(STEEL, UNITS.length, lattice=name)).at_force(1.0)
    return ideal(name, shape)[0], gp.Waves(state.network.repeat(shape))


#: the triangular lattice, in a cell so skewed that the shortest wave vectors are far from the
#: corners around a point of it
SKEWED = gp.Lattice("skewed triangular", ((1.0, 0.0), (5.5, math.sqrt(0.75))))


@pytest.mark.parametrize(
    ("name", "shape", "across"),
    [
        ("chain", (12,), (1,)),
        ("triangular", (6, 5), (1, -2)),
        ("fcc", (4, 3, 5), (1, -2, 2)),
        (SKEWED, (6, 5), (1, 2)),
        ("kagome", (4, 3), (2, -4)),
        ("honeycomb", (4, 3), (1, -2)),
        ("hcp", (3, 2, 4), (1, 1, 2)),
    ],
)
def test_wave_beyond_the_first_zone_is_the_wave_in_it(name, shape, across):
    """Its length is that of the shortest wave vector with the same motions of all balls, found here
    among thousands.
    """
    (lattice, waves), periods = perfect(name, shape), len(shape)
    inside = np.array([2.0, 1.0, 1.0][:periods]) / shape
    q = q_of(lattice, [inside, inside + across])[:, :periods]
    motion = np.arange(1.0, 1.0 + len(waves.operator.motions.translations))
    found = waves.spectral_function(q, motion, moments=64)
    np.testing.assert_allclose(found.values[1], found.values[0], atol=1e-12 * np.max(found.values))
    numbers = np.stack(
        np.meshgrid(*[np.arange(-n, n + 1) for n in [30, 30, 6][-periods:]]), axis=-1
    ).reshape(-1, periods)
    reciprocal = q_of(lattice, numbers)[:, :periods]
    balls = waves.network.positions[: waves.network.lattice.n_balls, :periods]
    same = np.all(np.abs(np.exp(1j * reciprocal @ (balls - balls[0]).T) - 1.0) < 1e-3, axis=1)
    shortest = np.min(np.linalg.norm(q[:, None] - reciprocal[same], axis=2), axis=1)
    np.testing.assert_allclose(found.wavenumber, shortest, rtol=1e-12)
    np.testing.assert_allclose(
        found.phase_velocity, 2.0 * np.pi * found.peak / shortest, rtol=1e-12
    )
    assert np.linalg.norm(found.q[1]) > 1.5 * shortest[1]
    assert SpectralFunction.from_dict(found.to_dict()) == found
    still = waves.spectral_function(q_of(lattice, across)[:, :periods], motion, moments=64)
    with pytest.raises(InputError, match="together, as at q = 0"):
        _ = still.phase_velocity


def test_wave_at_a_reciprocal_vector_at_which_the_balls_of_a_cell_move_against_each_other():
    """Along the axis of hcp the layers are a chain of period c/2; in kagome a reciprocal vector has
    a mode of its own.
    """
    lattice, waves = perfect("hcp", (1, 1, 10))
    k = np.arange(1, 13)
    found = waves.spectral_function(
        q_of(lattice, k[:, None] / 10.0 * [0.0, 0.0, 1.0]), moments=1000
    )
    first = np.minimum(k, 20 - k)
    np.testing.assert_allclose(found.wavenumber, np.linalg.norm(found.q[0]) * first, rtol=1e-12)
    limit = found.phase_velocity / np.sinc(first / 20.0)
    np.testing.assert_allclose(limit, np.mean(limit), rtol=2e-3)
    lattice, waves = perfect("kagome", (4, 3))
    found = waves.spectral_function(q_of(lattice, (1.0, 0.0)), moments=200)
    assert found.peak[0] > 10.0 * found.resolution
    assert found.wavenumber[0] == pytest.approx(np.linalg.norm(found.q))
    assert found.phase_velocity[0] == pytest.approx(
        2.0 * np.pi * found.peak[0] / np.linalg.norm(found.q)
    )


def test_lattice_whose_sites_are_no_simple_fractions_has_the_wave_vectors_as_given(monkeypatch):
    _, waves = perfect("honeycomb", (4, 3))
    q = waves.nearest_wavevectors([[900.0, 700.0]])
    assert np.linalg.norm(fold_wavevectors(waves.network, q)) < np.linalg.norm(q)
    monkeypatch.setitem(
        vars(waves.network.lattice), "positions", np.array([[0.0, 0.0], [1.0, 0.618]])
    )
    assert fold_wavevectors(waves.network, q) is None
    found = waves.spectral_function(q, moments=64)
    np.testing.assert_allclose(found.wavenumber, np.linalg.norm(q), rtol=1e-14)


@given(
    st.lists(st.floats(-0.3, 0.3), min_size=9, max_size=9),
    st.lists(st.integers(-4, 4), min_size=3, max_size=3),
    st.lists(st.floats(-50.0, 50.0), min_size=3, max_size=3),
    st.integers(1, 3),
    st.floats(-6.0, 6.0),
)
def test_nearest_wave_vector_of_a_skewed_cell(tilts, skews, q, p, power):
    """Against all wave vectors around q, taken from the same periods in a cell that is nearly a
    cube.
    """
    straight = (np.eye(3) + np.reshape(tilts, (3, 3)))[:p, :p] + np.diag([0.5, 0.0, 1.0][:p])
    a, b, c = skews
    change = np.array([[1, 0, 0], [a, 1, 0], [b, c, 1]])[:p, :p]
    cell = np.eye(3)
    cell[:p, :p] = change @ straight
    scale = 10.0**power
    found = (
        nearest_wavevectors(
            PeriodicCell(cell / scale, (True, p > 1, p > 2), p), np.array(q[:p]) * scale
        )
        / scale
    )
    whole = cell[:p, :p] @ found / (2.0 * np.pi)
    np.testing.assert_allclose(whole, np.round(whole), atol=1e-8)
    middle = np.round(straight @ q[:p] / (2.0 * np.pi))
    around = middle + np.stack(np.meshgrid(*[np.arange(-4, 5)] * p), axis=-1).reshape(-1, p)
    least = np.min(np.linalg.norm(2.0 * np.pi * around @ np.linalg.inv(straight).T - q[:p], axis=1))
    assert np.linalg.norm(found - q[:p]) == pytest.approx(least, rel=1e-8, abs=1e-8)


def test_curves_are_labelled_with_the_wavenumber_of_the_velocities():
    lattice, waves = perfect("triangular", (6, 5))
    found = waves.spectral_function(q_of(lattice, [(1.0 / 6.0, 0.0), (7.0 / 6.0, 0.0)]), moments=64)
    labels = [line.get_label() for line in plot(found).axes[0].get_lines()]
    assert labels == [f"|q| = {one:.4g} /m" for one in found.wavenumber]
    assert labels[0] == labels[1]


def test_wave_in_a_network_of_no_lattice_has_the_length_of_its_wave_vector(disordered):
    whole = gp.Waves(disordered)
    plain = gp.Waves(dataclasses.replace(disordered, lattice=None, shape=None))
    q = whole.nearest_wavevectors([[500.0, 700.0]])
    found = plain.spectral_function(q, moments=64)
    assert found.shortest is None
    np.testing.assert_allclose(found.wavenumber, np.linalg.norm(q), rtol=1e-14)
    assert whole.spectral_function(q, moments=64).wavenumber < found.wavenumber


@pytest.mark.parametrize("period", [None, 0])
def test_an_array_that_is_open_has_no_zone(period):
    _, network = ideal()
    is_kept = ~np.any(np.delete(network.shift, [] if period is None else period, axis=1), axis=1)
    contacts = {name: getattr(network, name)[is_kept] for name in network.contact_fields}
    pbc = tuple(axis == period for axis in range(3))
    waves = gp.Waves(dataclasses.replace(network, pbc=pbc, **contacts))
    q = waves.nearest_wavevectors([[300.0, 100.0]])
    found = waves.spectral_function(q, moments=64)
    assert found.shortest is None
    assert found.wavenumber == pytest.approx(np.linalg.norm(q))


def test_average_over_arrays():
    """The mean of spectra is that of the mean moments, on one scale; tops differ from array to
    array.
    """
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))
    every = [
        gp.Waves(
            gp.DirectSimulation(packing, shape=(8, 8), seed=seed, geometry="lattice")
            .at_force(0.5)
            .sample
        )
        for seed in (1, 2, 3)
    ]
    q = every[0].nearest_wavevectors([[100.0, 0.0], [0.0, 200.0]])
    found = [one.spectral_function(q, resolution=500.0) for one in every]
    mean = SpectralFunction.average(found)
    assert len({one.top for one in found}) == 3
    assert mean.top == max(one.top for one in found)
    np.testing.assert_allclose(mean.integral, 1.0, rtol=1e-12)
    kernel = Kernel(mean.top, mean.moments)
    exact = []
    for waves in every:
        dense = Dense(waves.network)
        for one in q:
            ahead = one / np.linalg.norm(one)
            exact.append(dense.density(kernel, *plane_wave(waves, one, np.array([*ahead, 0.0]))))
    exact = np.mean(np.reshape(exact, (3, 2, -1)), axis=0)
    np.testing.assert_allclose(mean.values, exact, atol=0.02 * exact.max())
    np.testing.assert_allclose(
        SpectralFunction.average(found[:1]).values, found[0].values, rtol=1e-12
    )
    with pytest.raises(InputError, match="or is a mean"):
        mean.with_moments(30)
    with pytest.raises(InputError, match="same resolution"):
        SpectralFunction.average([found[0], every[1].spectral_function(q, resolution=200.0)])
    with pytest.raises(InputError, match="other wave vectors"):
        SpectralFunction.average([found[0], every[1].spectral_function(q[:1], resolution=500.0)])
    with pytest.raises(InputError, match="no spectral functions"):
        SpectralFunction.average([])
    with pytest.raises(InputError, match="no spectral function"):
        SpectralFunction.average([found[0], None])
    for what in (found[0], 5, None, iter(found)):
        with pytest.raises(InputError, match="no list of spectral functions"):
            SpectralFunction.average(what)


# -- a second engine -------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore")
def test_kwant_finds_the_same_density(waves):
    kpm = pytest.importorskip("kwant.kpm")
    start = np.random.default_rng(8).choice([-1.0, 1.0], waves.operator.size)
    top = waves.operator.top
    moments = 50
    kernel = Kernel(top / (2 * np.pi), moments)
    theirs = kpm.SpectralDensity(
        waves.operator.matrix.astype(complex),
        num_moments=moments,
        vector_factory=[start.astype(complex)],
        num_vectors=1,
        bounds=(0.0, top**2),
        eps=1e-13,
        kernel=lambda found: np.transpose(found.T * kernel.weights),
    )
    ours = kernel.densities(Moments(waves.operator, [start.copy]).first(moments)[0])
    inner = slice(1, -1)
    omega = 2 * np.pi * kernel.frequencies[inner]
    np.testing.assert_allclose(
        theirs(omega**2) * 2 * omega * 2 * np.pi, ours[inner], atol=1e-9 * ours.max()
    )


@pytest.mark.parametrize("far", [1e19, 1e160, -1.7e308])
def test_wave_vectors_without_digits_are_refused(waves, far):
    for find in (waves.nearest_wavevectors, waves.spectral_function):
        with pytest.raises(PrecisionError, match=r"digits .* lost"):
            find([far, 0.0])


def test_polarisation_by_large_numbers_is_a_direction(waves):
    q = waves.nearest_wavevectors([500.0, 0.0])
    large, plain = (
        waves.spectral_function(q, [size, size], moments=16).values for size in (1e308, 1.0)
    )
    np.testing.assert_array_equal(large, plain)


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_the_boson_peak_is_the_greatest_reduced_density(dimension):
    """Of a density made by hand: f^(d-1) times 1 + x exp(1 - x), x = (f/f_0)^2, which is greatest
    at f_0; and of one that falls from zero on, none.
    """
    network = gp.ContactLattice.of("triangular", 0.8).contact_network(UNITS).repeat((4, 4))
    dos = gp.Waves(network).dos(moments=256)
    f = dos.frequencies
    x = (f / (0.3 * dos.top)) ** 2
    shape = f ** (dimension - 1.0) * (1.0 + x * np.exp(1.0 - x))
    made = dataclasses.replace(
        dos, translational=shape, rotational=np.zeros_like(f), dimension=dimension
    )
    spacing = np.max(np.diff(f))
    assert made.boson_peak == pytest.approx(0.3 * dos.top, abs=spacing)
    assert np.max(made.reduced[1:]) == pytest.approx(2.0, rel=1e-3)
    falling = dataclasses.replace(made, translational=f ** (dimension - 1.0) * np.exp(-x))
    assert np.isnan(falling.boson_peak)
    assert np.isnan(dos.with_moments(2).boson_peak)


def test_the_reduced_density_of_long_waves_is_that_of_debye():
    """Of a triangular lattice: f over that of two sound velocities, below the van Hove points."""
    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, friction=False)
    state = gp.AveragedLattice(packing).at_force(1.0)
    network = state.network.repeat((48, 48))
    dos = gp.Waves(network).dos(moments=256, vectors=4)
    v = gp.sound_velocities(state)
    area = 8e-3**2 * math.sqrt(3.0) / 2.0
    debye = 2.0 * math.pi * area * (v.longitudinal**-2 + v.transverse**-2)
    is_low = (dos.frequencies > 0.12 * dos.top) & (dos.frequencies < 0.25 * dos.top)
    np.testing.assert_allclose(np.mean(dos.reduced[is_low]), debye, rtol=0.05)


def test_a_wave_vector_nearest_to_zero_is_told_the_shortest_of_the_cell():
    network = square_array((40, 4))
    lengths = np.diag(network.cell)[:2]
    shortest = 2.0 * np.pi / np.max(lengths)
    # longer than the shortest wave vector, and yet nearest to zero
    q = (0.0, 0.45 * 2.0 * np.pi / np.min(lengths))
    assert q[1] > shortest
    with pytest.raises(InputError) as caught:
        gp.Waves(network).spectral_function(q)
    assert f"{shortest:.6g}" in str(caught.value)
    assert "shorter" not in str(caught.value)


def test_the_shortest_wave_vector_of_an_oblique_cell_is_no_vector_of_its_basis():
    network = square_array((6, 6))
    cell = np.array(network.cell)
    oblique = PeriodicCell(
        np.array([cell[0], cell[1] + 3.0 * cell[0], cell[2]]), (True, True, False), 2
    )
    expected = 2.0 * np.pi / np.max(np.diag(cell)[:2])
    assert np.isclose(_find_shortest(oblique), expected, rtol=1e-12)


def test_waves_of_zero_wave_vector_have_no_ioffe_regel_frequency():
    network = square_array((12, 4))
    wavevectors = [(0.0, 0.0), (2.0 * np.pi / network.cell[0, 0], 0.0)]
    found = gp.Waves(network).spectral_function(wavevectors, (1.0, 0.0), moments=64)
    with pytest.raises(InputError, match="q = 0"):
        found.ioffe_regel()


def test_a_line_at_zero_is_beyond_the_ioffe_regel_frequency():
    """As that of a reciprocal vector is, at which all balls move together, in a network that does
    not know its lattice.
    """
    wavenumber = np.array([1.0, 2.0])
    for width in (0.0, 1.0):
        limit = find_ioffe_regel(wavenumber, np.array([2.0, 0.0]), np.array([1.0, width]))
        assert limit == 2.0
        with pytest.raises(InputError, match="already beyond"):
            find_ioffe_regel(wavenumber, np.array([0.0, 2.0]), np.array([width, 1.0]))


def square_array(shape):
    """A periodic array of a square lattice."""
    return (
        gp.ContactLattice.of("square", 0.8).contact_network(gp.Units(8e-3, 3e6, 2e-3)).repeat(shape)
    )


def test_wave_vectors_along_a_path_are_the_nearest_in_an_oblique_cell():
    lattice = gp.ContactLattice.of("triangular", 0.8)
    network = lattice.contact_network(gp.Units(8e-3, 3e6, 2e-3)).repeat((5, 5))
    reciprocal = 2.0 * np.pi * np.linalg.pinv(network.cell[:2, :2]).T
    corners = np.array([[0.4, 0.4], [3.4, -2.6]])
    start, end = corners @ reciprocal
    leg = end - start
    points = start + np.linspace(0.0, 1.0, 4)[:, None] * leg
    numbers = np.stack(np.meshgrid(*[np.arange(-8, 9)] * 2), axis=-1).reshape(-1, 2)
    of_cell = numbers @ reciprocal
    distances = np.linalg.norm(points[:, None] - of_cell, axis=2)
    nearest = np.unique(np.argmin(distances, axis=1))
    along = np.clip((of_cell[nearest] - start) @ leg / (leg @ leg), 0.0, 1.0)
    off_path = np.linalg.norm(of_cell[nearest] - start - along[:, None] * leg, axis=1)
    expected = of_cell[nearest][off_path <= np.linalg.norm(leg) / 6.0]
    found = find_packing_points(network, [corners], 4)
    assert len(expected) > 2
    in_order = [np.lexsort(np.round(q, 6).T) for q in (found.q, expected)]
    np.testing.assert_allclose(found.q[in_order[0]], expected[in_order[1]], atol=1e-9)
