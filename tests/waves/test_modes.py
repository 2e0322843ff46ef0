"""Modes of networks: dense, factorised, filtered, against bands and each other; counts of modes
without energy.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError
from granphon.waves import modes as mode_finder
from tests.dynamics.test_network_lattice import by_radii, random_network
from tests.networks.test_network import make
from tests.packings import balance

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
UNITS = gp.Units(8e-3, 3e6, 2e-3)


def ideal(name="triangular", shape=(6, 5), eta=0.8):
    """The network of cells of a lattice, and all its frequencies, Hz, ascending."""
    lattice = gp.ContactLattice.of(name, eta)
    mesh = np.stack(
        np.meshgrid(*(np.arange(n) / n for n in shape), indexing="ij"), axis=-1
    ).reshape(-1, len(shape))
    bands = (
        np.sort(np.asarray(lattice.frequencies(lattice.wavevectors(mesh))).ravel())
        * UNITS.frequency
    )
    return lattice.contact_network(UNITS).repeat(shape), bands


def nearest(bands, count, target):
    """Distances to ``target`` of the nearest frequencies that cost energy."""
    cost = bands[bands > 1e-6 * bands[-1]]
    return np.sort(np.abs(cost - target))[:count]


#: greatest sizes of networks whose matrices are dense, and are factorised
METHODS = {"dense": (10**6, 10**6), "factorised": (1, 10**6), "filtered": (1, 1)}


def exhaustive(*case):
    return pytest.param(*case, marks=pytest.mark.exhaustive)


def slow(*case):
    return pytest.param(*case, marks=pytest.mark.slow)


@pytest.fixture
def limits(monkeypatch):
    """Set the limits of the methods: those of ``METHODS``, or a constant of the filters by its
    name.
    """

    # its module takes the limits when it is first loaded: before they are changed here
    assert gp.Waves

    def set_limits(method=None, **constants):
        if method is not None:
            constants |= {
                "MOST_DENSE_MOTIONS": METHODS[method][0],
                "LARGEST_FACTORS": dict.fromkeys((1, 2, 3), METHODS[method][1]),
            }
        for name, value in constants.items():
            monkeypatch.setattr(mode_finder, name, value)
        if method == "filtered":
            # what is filtered is not found among all modes by the dense matrix after all
            monkeypatch.delattr(mode_finder, "_find_dense")

    return set_limits


@pytest.fixture(params=["dense", "factorised"])
def method(request, limits):
    """Each of the two methods of networks that are not too large, for any size."""
    limits(request.param)
    return request.param


@pytest.mark.parametrize("target", [None, 12e3, 30.1e3])
def test_modes_are_those_of_the_bands(method, target):
    network, bands = ideal(shape=(9, 8))
    modes = gp.Waves(network).modes(14, target)
    found = np.sort(np.abs(modes.frequencies - (target or 0.0)))
    np.testing.assert_allclose(found, nearest(bands, 14, target or 0.0), atol=1e-7 * bands[-1])
    assert np.all(np.diff(modes.frequencies) >= 0.0)
    assert modes.zero_modes == np.sum(bands < 1e-6 * bands[-1]) == 2
    flat = modes.vectors.reshape(14, -1)
    np.testing.assert_allclose(flat @ flat.T, np.eye(14), atol=1e-9)
    assert modes.residual <= 1e-8
    operator = gp.Waves(network).operator
    one = operator.vector(modes.vectors[5])
    left = operator @ one - (2 * np.pi * modes.frequencies[5]) ** 2 * one
    assert np.linalg.norm(left) <= 1e-7 * operator.top**2
    assert np.all(flat[np.arange(14), np.argmax(np.abs(flat), axis=1)] > 0.0)


def test_methods_agree_on_disorder(limits):
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))
    waves = gp.Waves(gp.DirectSimulation(packing, shape=(10, 10), seed=3).at_force(0.2).sample)
    found = []
    for method in ("dense", "factorised"):
        limits(method)
        found.append(waves.modes(6))
    for other in found[1:]:
        assert other.zero_modes == found[0].zero_modes
        np.testing.assert_allclose(other.frequencies, found[0].frequencies, rtol=1e-6)
        np.testing.assert_allclose(
            other.participation_ratio, found[0].participation_ratio, rtol=1e-3
        )
        np.testing.assert_allclose(
            other.rotational_fraction, found[0].rotational_fraction, atol=1e-4
        )
    touching = np.union1d(waves.network.i, waves.network.j).size
    assert found[0].zero_modes >= 2 + 3 * (100 - touching) > 2


@pytest.mark.claim("count-modes")
@pytest.mark.parametrize(
    ("name", "shape"), [("triangular", (6, 5)), ("kagome", (4, 3)), slow("fcc", (4, 4, 4))]
)
def test_modes_below_a_frequency_are_those_of_the_bands(name, shape):
    """Between and below all frequencies of a lattice, of which many are degenerate."""
    network, bands = ideal(name, shape)
    waves = gp.Waves(network)
    steps = np.flatnonzero(np.diff(bands) > 1e-6 * bands[-1])
    between = 0.5 * (bands[steps] + bands[steps + 1])
    np.testing.assert_array_equal(waves.count_modes(between), steps + 1)
    n_zeros = int(np.sum(bands < 1e-6 * bands[-1]))
    assert waves.count_modes(1e-9) == n_zeros == waves.modes(2).zero_modes
    assert waves.count_modes(1.01 * waves.operator.top) == bands.size
    assert isinstance(waves.count_modes(1.0), int)
    for wrong in (0.0, -1.0, math.nan, "1"):
        with pytest.raises(InputError, match="frequencies"):
            waves.count_modes(wrong)


def test_modes_are_not_counted_without_factors(limits):
    network, _ = ideal()
    limits("filtered")
    with pytest.raises(InputError, match=r"density of states"):
        gp.Waves(network).count_modes(1.0)


@pytest.mark.claim("count-modes")
def test_modes_of_a_packing_with_balls_that_turn_freely(limits):
    """Balls with two contacts in space turn about the line through both: Lanczos's vectors are free
    of these, and none is missed.
    """
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="fcc")).at_force(1.0)
    whole = state.network.repeat((3, 3, 3))
    turning = np.array([3, 11, 20])
    # of each of these balls two contacts stay, which are no straight line
    is_kept = np.ones(whole.n_contacts, bool)
    for ball in turning:
        is_kept[np.flatnonzero((whole.i == ball) | (whole.j == ball))[2:]] = False
    fields = {name: getattr(whole, name)[is_kept] for name in whole.contact_fields}
    loose = replace(whole, **fields, lattice=None, shape=None)
    limits("factorised")
    waves = gp.Waves(loose)
    modes = waves.modes(12)
    squares = np.linalg.eigvalsh(waves.operator.matrix.toarray())
    frequencies = np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)
    n_zeros = int(np.sum(frequencies < 1e-6 * frequencies[-1]))
    assert modes.zero_modes == n_zeros >= 3 + len(turning)
    np.testing.assert_allclose(modes.frequencies, frequencies[n_zeros:][:12], rtol=1e-7)
    middle = 0.5 * (modes.frequencies[-1] + modes.frequencies[-2])
    assert waves.count_modes(middle) == np.sum(frequencies < middle)
    problem = mode_finder.Problem.of(waves.operator)
    free = problem.free_motions
    assert free.shape[1] >= len(turning)
    forces = problem.shifted(0.0) @ free.toarray()
    assert np.max(np.abs(forces)) < 1e-14 * problem.top**2


def test_mechanisms_are_counted(method):
    """The kagome lattice without friction has lines of balls that move at no cost: as many as A
    lacks in rank.
    """
    network, bands = ideal("kagome", (5, 4), 0.0)
    modes = gp.Waves(network).modes(4)
    rank = np.linalg.matrix_rank(gp.Waves(network).operator.root.toarray())
    assert modes.zero_modes == 2 * network.n_balls - rank > 2
    np.testing.assert_allclose(modes.frequencies, nearest(bands, 4, 0.0), rtol=1e-8)


def test_modes_are_found_where_the_fast_method_of_singular_values_fails(monkeypatch):
    network, _ = ideal(shape=(9, 8))
    known = gp.Waves(network).modes(14)

    def fail(matrix):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", fail)
    found = gp.Waves(network).modes(14)
    np.testing.assert_allclose(found.frequencies, known.frequencies, rtol=1e-12)
    assert found.residual <= 1e-8


def test_low_frequencies_lose_no_digits():
    """A chain with one weak spring: of squares of frequencies few digits would be left."""
    network, _ = ideal("chain", (40,), 0.0)
    stiffness = network.normal_stiffness.copy()
    stiffness[3] *= 1e-9
    stiffness[20] *= 1e-9
    weak = replace(network, normal_stiffness=stiffness, lattice=None, shape=None)
    modes = gp.Waves(weak).modes(1)
    # two rigid halves of 17 and 23 balls, between two springs
    reduced = UNITS.mass * 17 * 23 / 40
    exact = math.sqrt(2 * 1e-9 * UNITS.stiffness / reduced) / (2 * np.pi)
    assert modes.frequencies[0] == pytest.approx(exact, rel=1e-8)


def line(masses, stiffness):
    """Balls on a line, each touching the next."""
    n = len(masses)
    return make(
        2.0 * np.arange(n)[:, None],
        zip(range(n - 1), range(1, n), strict=True),
        0.0,
        dimension=1,
        motions="longitudinal",
        masses=masses,
        normal_stiffness=np.broadcast_to(stiffness, n - 1),
    )


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e25])
def test_two_balls(scale):
    modes = gp.Waves(line([2.0 * scale, 3.0 * scale], 7.0)).modes(1)
    assert modes.frequencies[0] == pytest.approx(
        math.sqrt(7.0 / (1.2 * scale)) / (2 * np.pi), rel=1e-12
    )
    assert modes.zero_modes == 1
    # energies are as the inverse masses
    energy = np.array([0.6, 0.4])
    assert modes.participation_ratio[0] == pytest.approx(1.0 / (2 * np.sum(energy**2)), rel=1e-12)
    assert modes.rotational_fraction[0] == 0.0
    assert not modes.contact_shares.flags.writeable


def test_balls_between_walls():
    """Walls have an infinite mass: they take no part, and no motion is free."""
    waves = gp.Waves(line([math.inf, 1.0, 1.0, 1.0, math.inf], 5.0))
    modes = waves.modes(3)
    exact = 2 * math.sqrt(5.0) * np.sin(np.pi * np.arange(1, 4) / 8) / (2 * np.pi)
    np.testing.assert_allclose(modes.frequencies, exact, rtol=1e-12)
    assert modes.zero_modes == 0
    assert modes.vectors.shape == (3, 5, 1)
    assert not np.any(modes.vectors[:, [0, 4]])
    # sines: the participation ratio is (sum s^2)^2 / (3 sum s^4)
    s = np.sin(np.pi * np.arange(1, 4) / 4)
    assert modes.participation_ratio[0] == pytest.approx(
        np.sum(s**2) ** 2 / (3 * np.sum(s**4)), rel=1e-10
    )
    dos = waves.dos(moments=30, vectors=2)
    assert dos.integral == pytest.approx(1.0, rel=1e-12)  # per ball that moves
    assert type(modes).from_dict(modes.to_dict()) == modes


def test_heavy_ball_is_a_mode_of_its_own():
    """A light ball among heavy ones: the highest mode is that ball alone."""
    network, _ = ideal(shape=(8, 8))
    masses = network.masses.copy()
    inertias = network.inertias.copy()
    masses[10] *= 1e-4
    inertias[10] *= 1e-4
    light = replace(network, masses=masses, inertias=inertias, lattice=None, shape=None)
    waves = gp.Waves(light)
    modes = waves.modes(3, nearest=0.99 * waves.operator.top / (2 * np.pi))
    assert np.argmax(np.sum(modes.vectors**2, axis=2), axis=1).tolist() == [10, 10, 10]
    np.testing.assert_allclose(modes.participation_ratio, 1 / 64, rtol=1e-3)
    # two translations of the one ball, and its rotation, which has none
    assert sorted(np.round(modes.rotational_fraction).tolist()) == [0.0, 0.0, 1.0]


def test_what_has_no_modes_is_refused():
    waves = gp.Waves(line([1.0, 1.0, 1.0], 1.0))
    with pytest.raises(InputError, match=r"3 modes .* only 2 "):
        waves.modes(3)
    with pytest.raises(InputError, match="frequencies are below"):
        waves.modes(1, nearest=1e9)
    for bad in (0, 1.5, -1, 10**5000):
        with pytest.raises(InputError, match="count"):
            waves.modes(bad)
        with pytest.raises(InputError, match="count"):
            waves.damped_modes(bad)
    with pytest.raises(InputError, match=f"{waves.operator.shape[0]} motions"):
        waves.modes(10**6)
    for bad in (-1.0, math.nan, "5"):
        with pytest.raises(InputError, match="nearest"):
            waves.modes(1, nearest=bad)


def test_a_ball_that_touches_its_images_alone_has_no_mode():
    ball = gp.Ball(gp.Material(70e9, 0.2, 2500.0), 8e-3)
    one = gp.Crystal.on("chain", [ball]).at_force(20.0)
    with pytest.raises(InputError, match="images"):
        gp.Waves(one).modes(1)


def test_factors_miss_no_mode(limits, monkeypatch):
    """Where Lanczos has found too few of a set of equal modes, the count of the factors shows it,
    and more are asked for.
    """
    import scipy.sparse.linalg as linear

    limits("factorised")
    network, bands = ideal(shape=(12, 12))
    plain = linear.eigsh
    asked = []

    def forgetful(*args, **more):
        values, vectors = plain(*args, **more)
        asked.append(more["k"])
        return (
            (values, vectors)
            if len(asked) > 1
            else (np.delete(values, 4), np.delete(vectors, 4, axis=1))
        )

    monkeypatch.setattr(linear, "eigsh", forgetful)
    modes = gp.Waves(network).modes(12)
    assert len(asked) == 2
    np.testing.assert_allclose(modes.frequencies, nearest(bands, 12, 0.0), rtol=1e-8)


def test_static_forces_lower_frequencies(method):
    """With static forces D is no longer a square: modes, and the count of those without energy, are
    those of the matrix.
    """
    network, _ = ideal(shape=(7, 6))
    force = 0.02 * UNITS.force * np.random.default_rng(2).uniform(0.5, 1.0, network.n_contacts)
    pressed = balance(
        replace(network, prestress=True, normal_force=force, lattice=None, shape=None)
    )
    squares = np.linalg.eigvalsh(gp.Waves(pressed).operator.matrix.toarray())
    exact = np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)
    modes = gp.Waves(pressed).modes(5)
    np.testing.assert_allclose(modes.frequencies, nearest(exact, 5, 0.0), rtol=1e-6)
    assert modes.zero_modes == 2
    assert modes.frequencies[0] < gp.Waves(network).modes(1).frequencies[0]


@pytest.mark.parametrize(
    ("method", "friction"),
    [
        pytest.param("factorised", True, marks=pytest.mark.slow),
        ("dense", False),
        slow("dense", True),
        slow("factorised", False),
    ],
    indirect=["method"],
)
def test_tension_raises_frequencies(method, friction):
    """Spectra of rubber balls that adhere and are pulled apart are the bands of the crystal, and
    below the bound of all.
    """
    rubber = gp.Ball(gp.Material(5e6, 0.49, 1100.0), 2e-3)
    cells = np.arange(4) / 4
    state = gp.Crystal.on("fcc", [rubber], law=gp.JKR(0.1), friction=friction).at_pressure(
        -20.0, finite_overlap=True
    )
    assert np.all(state.normal_force < 0.0)
    q = np.stack(np.meshgrid(cells, cells, cells), axis=-1).reshape(-1, 3)
    bands = np.sort(gp.Phonons(state).frequencies(q).ravel())
    waves = gp.Waves(state.network.repeat((4, 4, 4)))
    for target in (0.0, bands[-1]):
        modes = waves.modes(6, target)
        np.testing.assert_allclose(
            np.sort(np.abs(modes.frequencies - target)),
            nearest(bands, 6, target),
            atol=1e-8 * bands[-1],
        )
    assert waves.modes(1).zero_modes == np.sum(bands < 1e-6 * bands[-1])
    assert waves.operator.top > 2.0 * np.pi * bands[-1]
    density = waves.dos(moments=512)
    mean = np.trapezoid(density.frequencies * density.total, density.frequencies)
    assert mean == pytest.approx(np.sum(bands) / 64, rel=1e-4)


def test_modes_are_counted_below_an_entry_of_the_diagonal():
    """D less the value has no diagonal there, and the places of its entries stay."""
    operator = gp.Waves(ideal("chain", (40,), 0.0)[0]).operator
    squares = np.linalg.eigvalsh(operator.matrix.toarray())
    value = float(operator.matrix.diagonal()[0])
    near = np.isclose(squares, value, rtol=1e-6)
    count = mode_finder.Problem.of(operator).count_below(value)
    assert np.sum(squares[~near] < value) <= count <= np.sum((squares < value) | near)


def test_all_modes_are_below_a_frequency_whose_square_is_no_number():
    waves = gp.Waves(ideal("chain", (5,), 0.0)[0])
    assert list(waves.count_modes([1e300, 1e-300])) == [5, 1]


# -- networks too large to be factorised -----------------------------------------------------------


@pytest.fixture
def filters(limits):
    """Modes are filtered, with fewer random vectors than usual, as the networks are small; sets
    constants of the filters.
    """
    limits("filtered", _START_COUNTS=(6, 4))
    return limits


@pytest.fixture(scope="module", params=[False, True], ids=["free of forces", "prestress"])
def disordered(request):
    """A triangular array whose springs differ, with and without static forces, and all its modes by
    the dense matrix.
    """
    network, _ = ideal(shape=(36, 9))
    random = np.random.default_rng(4)
    factor, force = random.uniform(0.5, 1.5, (2, network.n_contacts))
    network = replace(
        network,
        normal_stiffness=factor * network.normal_stiffness,
        shear_stiffness=factor * network.shear_stiffness,
        normal_force=0.01 * UNITS.force * force,
        prestress=request.param,
        lattice=None,
        shape=None,
    )
    waves = gp.Waves(balance(network))
    squares, vectors = np.linalg.eigh(waves.operator.matrix.toarray())
    return waves, np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi), vectors


#: amid the spectrum, where modes are dense; at its ends; and above all modes, below the bound of
#: them
@pytest.mark.parametrize("target", [None, exhaustive(900.0), slow(12.3e3), exhaustive(21e3), "top"])
def test_filters_find_what_the_dense_matrix_has(filters, disordered, target):
    waves, exact, vectors = disordered
    top = waves.operator.top / (2.0 * np.pi)
    where = 0.5 * (exact[-1] + top) if target == "top" else target or 0.0
    modes = waves.modes(9, None if target is None else where)
    cost = np.flatnonzero(exact > 1e-6 * top)
    chosen = np.sort(cost[np.argsort(np.abs(exact[cost] - where))[:9]])
    np.testing.assert_allclose(modes.frequencies, exact[chosen], rtol=1e-10)
    overlap = np.abs(
        waves.operator.vector(np.moveaxis(modes.vectors, 0, -1)).T @ vectors[:, chosen]
    )
    np.testing.assert_allclose(overlap, np.eye(9), atol=1e-6)
    assert modes.residual <= 1e-8
    assert modes.zero_modes == (2 if target is None else None)


@pytest.mark.exhaustive
def test_filters_find_all_modes_of_one_frequency(filters):
    """The ideal crystal has twelve modes of most frequencies."""
    network, bands = ideal(shape=(24, 24))
    modes = gp.Waves(network).modes(14, 12e3)
    np.testing.assert_allclose(
        np.sort(np.abs(modes.frequencies - 12e3)), nearest(bands, 14, 12e3), rtol=1e-10, atol=1e-6
    )


@pytest.mark.exhaustive
def test_filters_find_the_modes_at_a_gap(filters):
    """Two masses in turn, springs that differ a little: between the bands there is nothing but a
    mode of an end.
    """
    from scipy.linalg import eigvalsh_tridiagonal

    filters(_START_COUNTS=(12,))  # many modes lie close to the end of a band
    masses = np.tile([1.0, 2.0], 1000)
    springs = np.random.default_rng(1).uniform(0.95, 1.05, 1999)
    held = np.pad(springs, 1)
    squares = eigvalsh_tridiagonal((held[:-1] + held[1:]) / masses, -springs / 2.0**0.5)
    exact = np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)
    target = 1.35 / (2.0 * np.pi)
    found = gp.Waves(line(masses, springs)).modes(5, target).frequencies
    assert np.min(np.abs(exact - target)) > 0.04 * target
    np.testing.assert_allclose(
        np.sort(np.abs(found - target)), nearest(exact, 5, target), rtol=1e-10
    )


def test_filters_leave_out_modes_without_energy(filters, disordered):
    """Random vectors A^T y, and D x where there are static forces, have no part of them."""
    waves, exact, _ = disordered
    filters(_MOST_ZEROS=0)
    modes = waves.modes(5)
    np.testing.assert_allclose(modes.frequencies, nearest(exact, 5, 0.0), rtol=1e-9)
    assert modes.zero_modes is None


@pytest.mark.exhaustive
def test_filters_leave_out_many_modes_without_energy(filters):
    """The kagome lattice without friction has lines of balls that move at no cost, which are no
    modes of the result.
    """
    network, bands = ideal("kagome", (19, 18), 0.0)
    filters(_MOST_ZEROS=24)
    assert np.sum(bands < 1e-6 * bands[-1]) > 30
    modes = gp.Waves(network).modes(4)
    np.testing.assert_allclose(modes.frequencies, nearest(bands, 4, 0.0), rtol=1e-10)
    assert modes.zero_modes is None


@pytest.mark.parametrize("disordered", [False], indirect=True, ids=["free of forces"])
def test_filters_miss_no_mode(filters, disordered):
    """Where one mode is forgotten, what fresh vectors have left over shows it."""
    waves, exact, _ = disordered
    plain, lost, counted = mode_finder._find_ritz_modes, np.argmin(np.abs(exact - 12.3e3)), []

    def forgetful(*arguments):
        found = plain(*arguments)
        kept = np.ones(found.omega.size, bool)
        kept[np.argmin(np.abs(found.omega / (2.0 * np.pi) - exact[lost]))] = bool(counted)
        return mode_finder._FoundModes(*(part[..., kept] for part in found))

    def count(*arguments):
        counted.append(missing(*arguments))
        return counted[-1]

    missing = mode_finder._estimate_missing
    filters(_find_ritz_modes=forgetful, _estimate_missing=count)
    modes = waves.modes(5, 12.3e3)
    assert 0.1 < counted[0] < 5.0
    assert counted[1] < 1e-6
    np.testing.assert_allclose(
        np.sort(np.abs(modes.frequencies - 12.3e3)), nearest(exact, 5, 12.3e3), rtol=1e-8
    )


@pytest.mark.parametrize(("limit", "value"), [("_MOST_BYTES", 10**6), ("_MOST_PRODUCTS", 5000)])
@pytest.mark.parametrize("disordered", [False], indirect=True, ids=["free of forces"])
def test_filters_say_beforehand_what_is_too_much(filters, disordered, monkeypatch, limit, value):
    filters(**{limit: value})
    monkeypatch.delattr(mode_finder._Window, "apply")
    with pytest.raises(InputError, match=r"9 modes of 972 .* GB.*density"):
        disordered[0].modes(9, 12.3e3)


@pytest.mark.exhaustive
@pytest.mark.parametrize("target", [None, 20e3])
def test_filters_find_what_factors_do_in_space(target, limits):
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6), lattice="fcc")
    waves = gp.Waves(gp.DirectSimulation(packing, shape=(12, 12, 12), seed=3).at_force(0.2).sample)
    exact = waves.modes(6, target)
    limits("filtered")
    modes = waves.modes(6, target)
    # a residual of 1e-8 of the top frequency squared is 1e-4 of the lowest one: its square is left
    rtol = 1e-10 if target else 1e-9
    np.testing.assert_allclose(modes.frequencies, exact.frequencies, rtol=rtol)
    np.testing.assert_allclose(modes.participation_ratio, exact.participation_ratio, rtol=1e-4)


# -- forces without a potential --------------------------------------------------------------------


@pytest.mark.parametrize("target", [None, 1.0])
def test_modes_of_the_whole_are_the_eigenvalues_of_a_dense_matrix(target, limits):
    """Of tangential forces and of slip by the radii: also where the matrix is factorised."""
    network = by_radii(random_network("triangular", (4, 3)))
    waves = gp.Waves(network)
    squares = np.linalg.eigvals(waves.operator.whole.toarray())
    omega = np.sqrt(squares[np.abs(squares) > 1e-12 * np.max(np.abs(squares))].astype(complex))
    hertz = omega / (2.0 * np.pi)
    target = target and target * np.median(hertz.real)
    wanted = np.sort(hertz.real[np.argsort(np.abs(hertz.real - (target or 0.0)))[:4]])
    for method in ("dense", "factorised"):
        limits(method)
        found = waves.whole_modes(4, target)
        np.testing.assert_allclose(found.frequencies.real, wanted, rtol=1e-9)
        shapes = found.vectors[:, network.moving].reshape(4, -1).T
        pulled = waves.operator.whole @ shapes
        own = (2.0 * np.pi * found.frequencies) ** 2
        np.testing.assert_allclose(pulled, own * shapes, atol=1e-9 * np.max(np.abs(squares)))
    limits("dense")
    with pytest.raises(InputError, match="cost energy"):
        waves.whole_modes(omega.size + 1)


def test_without_static_forces_modes_of_the_whole_are_the_modes():
    network, _ = ideal(shape=(4, 3))
    waves = gp.Waves(network)
    found = waves.whole_modes(5)
    assert not np.any(found.frequencies.imag)
    np.testing.assert_allclose(found.frequencies.real, waves.modes(5).frequencies, rtol=1e-9)


@pytest.mark.parametrize("name", ["modes", "damped_modes", "whole_modes"])
def test_no_modes_are_near_a_frequency_above_the_top(name):
    waves = gp.Waves(gp.ContactLattice.of("square", 0.8).contact_network(UNITS).repeat((4, 4)))
    options = {"damping": (1e-7, 0.0)} if name == "damped_modes" else {}
    top = waves.operator.top / (2.0 * np.pi)
    with pytest.raises(InputError, match="no modes near"):
        getattr(waves, name)(2, 2.0 * top, **options)
    with pytest.raises(InputError, match=r"no modes near 1e\+20 Hz"):
        getattr(waves, name)(2, Fraction(10**20), **options)


@pytest.mark.parametrize("name", ["modes", "damped_modes", "whole_modes"])
def test_modes_that_memory_does_not_hold_are_refused(name, memory, monkeypatch):
    waves = gp.Waves(gp.ContactLattice.of("square", 0.8).contact_network(UNITS).repeat((4, 4)))
    monkeypatch.setattr("granphon.base.memory._ASSUMED_MEMORY", 0.0)
    memory(48 * 48 * 8.0)  # eight modes, six copies of each
    getattr(waves, name)(8)
    with pytest.raises(InputError, match=r"9 modes of 48 motions take .* Ask for fewer"):
        getattr(waves, name)(9)
