"""Long waves, moduli, pulses and validity of chains, membranes and crystals in space."""

from __future__ import annotations

import itertools
import json
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.base.errors import (
    InputError,
    InstabilityError,
    MechanismError,
    UnreachableFrequencyError,
)
from granphon.observables.catalogue import CATALOGUE, Analysis, entry_of, find_all
from granphon.observables.velocities import Moduli, SoundVelocities

ETA = 2 * (1 - 0.276) / (2 - 0.276)
D = 8e-3
CUBIC = ("sc", "bcc", "fcc")
EXHAUSTIVE = pytest.mark.exhaustive
SLOW = pytest.mark.slow
#: corners of tetrahedra that share them
PYROCHLORE = gp.Lattice(
    "pyrochlore",
    tuple(map(tuple, 2.0 * gp.balls.lattices.FCC.vectors)),
    ((0, 0, 0), *map(tuple, np.eye(3) / 2)),
)
#: yields more one way than another
RHOMBIC = gp.Lattice("rhombic", ((1.0, 0.0), (0.3, math.sqrt(0.91))))


@pytest.fixture(scope="module")
def make(steel):
    """A state of a lattice under 10 N, or another load."""

    def build(lattice, force=10.0, finite_overlap=None, **more):
        return gp.AveragedLattice(gp.Packing(steel, D, lattice=lattice, **more)).at_force(
            force, finite_overlap=finite_overlap
        )

    return build


# -- moduli in closed form -------------------------------------------------------------------------


def cubic_constants(lattice, k, kappa):
    """C11, C12, C44 over 1/d: Duffy and Mindlin's of fcc, J. Appl. Mech. 24, 585 (1957), and their
    like for sc and bcc.
    """
    if lattice == "sc":
        return k, 0 * k, kappa / 2
    root = mpmath.sqrt(3) if isinstance(k, mpmath.mpf) else math.sqrt(3.0)
    if lattice == "bcc":
        return (k + 2 * kappa) / root, (k - kappa) / root, (k + kappa / 2) / root
    root = mpmath.sqrt(2) if isinstance(k, mpmath.mpf) else math.sqrt(2.0)
    return root * (k + kappa), (k - kappa) / root, (k + kappa) / root


def cubic_tensor(c11, c12, c44):
    tensor = np.diag([c11 - c12] * 3 + [c44] * 3)
    tensor[:3, :3] += c12
    return tensor


@pytest.mark.parametrize("friction", [True, False])
@pytest.mark.parametrize("lattice", CUBIC)
def test_moduli_of_cubic_lattices(make, lattice, friction):
    state = make(lattice, np.array([[1.0, 8.0]]), friction=friction)
    if lattice != "fcc" and not friction:
        with pytest.raises(MechanismError, match="costs no energy"):
            gp.moduli(state)
        return
    found = gp.moduli(state)
    k = state.normal_stiffness[0, 1]
    c11, c12, c44 = cubic_constants(lattice, k / D, state.packing.mindlin_ratio * k / D)
    assert found.tensor.shape == (1, 2, 6, 6)
    assert found.components == ("xx", "yy", "zz", "yz", "xz", "xy")
    assert found._field_units()["tensor"] == "Pa"
    assert_allclose(found.tensor[0, 1], cubic_tensor(c11, c12, c44), rtol=1e-14, atol=1e-14 * c11)
    assert_allclose(found.bulk[0, 1], (c11 + 2 * c12) / 3, rtol=1e-14)
    # the averages over directions of a cubic crystal (R. Hill, 1952)
    for bulk in (found.voigt.bulk, found.reuss.bulk, found.hill.bulk):
        assert_allclose(bulk, found.bulk, rtol=1e-13)
    voigt = (c11 - c12 + 3 * c44) / 5
    reuss = 5 * (c11 - c12) * c44 / (4 * c44 + 3 * (c11 - c12))
    assert_allclose(found.voigt.shear[0, 1], voigt, rtol=1e-14)
    assert_allclose(found.reuss.shear[0, 1], reuss, rtol=1e-13)
    assert_allclose(found.hill.shear[0, 1], (voigt + reuss) / 2, rtol=1e-13)
    assert not found.isotropic
    with pytest.raises(InputError, match=r"shear modulus.*voigt"):
        _ = found.shear


def test_an_isotropic_crystal_has_a_shear_modulus():
    # without a Poisson effect kappa is k, and C11 - C12 of fcc is 2 C44
    packing = gp.Packing(gp.Material(70e9, 0.0, 2500.0), D, lattice="fcc")
    state = gp.AveragedLattice(packing).at_force(3.0)
    found = gp.moduli(state)
    k = state.normal_stiffness
    assert found.isotropic
    assert_allclose([found.shear, found.reuss.shear], math.sqrt(2.0) * k / D, rtol=1e-13)
    assert_allclose(found.shears, np.full(5, found.shear), rtol=1e-13)
    v = gp.sound_velocities(state)  # no direction is needed
    assert_allclose(
        packing.effective_density * v.longitudinal**2, found.bulk + 4 / 3 * found.shear, rtol=1e-13
    )
    assert_allclose(packing.effective_density * v.transverse**2, [found.shear] * 2, rtol=1e-13)


def test_the_modulus_of_a_chain_is_a_force(make):
    for motions in ("longitudinal", "in_plane", "all"):
        state = make("chain", np.array([1.0, 8.0]), motions=motions)
        found = gp.moduli(state)
        assert (found.tensor.shape, found.components, found.isotropic) == ((2, 1, 1), ("xx",), True)
        assert {
            unit for name, unit in found._field_units().items() if "anisotropy" not in name
        } == {"N"}
        assert_allclose(found.bulk, state.normal_stiffness * D, rtol=1e-15)
        for name in ("shear", "shears", "voigt", "reuss", "hill"):
            with pytest.raises(InputError, match=r"shear modulus.*bulk"):
                getattr(found, name)
        v = gp.sound_velocities(state)
        assert_allclose(
            v.longitudinal, D * np.sqrt(state.normal_stiffness / state.packing.mass), rtol=1e-15
        )
        assert_allclose(state.effective_density * v.longitudinal**2, found.bulk, rtol=1e-14)


@pytest.mark.parametrize("lattice", ["triangular", "square", "kagome"])
def test_a_membrane_has_the_moduli_of_its_plane(make, lattice):
    plane = make(lattice)
    membrane = make(lattice, motions="all")
    one, other = gp.moduli(plane), gp.moduli(membrane)
    assert_allclose(other.tensor, one.tensor, rtol=1e-12, atol=1e-13 * one.tensor.max())
    assert other.isotropic == one.isotropic
    along = np.array([[1.0, 0.0], [0.3, 0.7]])
    v = gp.sound_velocities(plane, along)
    w = gp.sound_velocities(membrane, along)
    assert_allclose(w.longitudinal, v.longitudinal, rtol=1e-12)
    assert_allclose(w.transverse, v.transverse, rtol=1e-12)
    assert (v.out_of_plane, v.transverse_slow) == (None, None)
    # a wave across the plane bends it: its velocity is exactly zero, and its displacement along z
    assert_array_equal(w.out_of_plane, [0.0, 0.0])
    assert_array_equal(w.velocities[:, 0], [0.0, 0.0])
    assert_array_equal(w.polarisations[..., 0], [[0.0, 0.0, 1.0]] * 2)


def test_the_averages_of_a_square_lattice(make):
    state = make("square")
    found = gp.moduli(state)
    k = state.normal_stiffness
    c11 = k / D
    c66 = ETA * k / D / 2
    assert_allclose([found.bulk, found.voigt.bulk, found.reuss.bulk], c11 / 2, rtol=1e-14)
    assert_allclose(found.voigt.shear, (c11 / 2 + c66) / 2, rtol=1e-14)
    assert_allclose(found.reuss.shear, 2 / (2 / c11 + 1 / c66), rtol=1e-14)


def test_a_lattice_that_yields_more_one_way_has_no_single_bulk_modulus(make):
    found = gp.moduli(make(RHOMBIC))
    with pytest.raises(InputError, match=r"bulk modulus.*voigt"):
        _ = found.bulk
    assert found.reuss.bulk < found.hill.bulk < found.voigt.bulk


# -- hcp against a dense relaxation ----------------------------------------------------------------


def test_a_crystal_of_close_packed_layers_yields_evenly(make):
    # equal contact forces in equilibrium: an even strain moves nothing inside, and K is that of
    # fcc, 2 sqrt(2)/3 k/d
    for lattice, more in (
        ("hcp", {}),
        ("hcp", {"torsion": 0.1, "bending": 0.2}),
        ("fcc", {"friction": False}),
    ):
        state = make(lattice, **more)
        assert_allclose(
            gp.moduli(state).bulk, math.sqrt(8.0) / 3.0 * state.normal_stiffness / D, rtol=1e-13
        )
    assert_allclose(
        gp.moduli(make("diamond", torsion=0.1)).bulk,
        state.normal_stiffness / D / math.sqrt(48.0),
        rtol=1e-12,
    )


# -- velocities ------------------------------------------------------------------------------------


@given(
    load=st.floats(-30.0, -5.0),
    way=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    lattice=st.sampled_from(CUBIC),
)
@settings(max_examples=15)
def test_velocities_in_any_direction_at_any_load_at_forty_digits(load, way, lattice):
    if max(map(abs, way)) < 1e-3:
        way = (0.3, -0.5, 0.8)
    material = gp.Material(7e10, 0.3, 2500.0)
    packing = gp.Packing(material, 1e-3, lattice=lattice)
    force = 10.0**load * 7e10 * 1e-6
    found = gp.sound_velocities(gp.AveragedLattice(packing).at_force(force), way).velocities
    with mpmath.workdps(40):
        e, nu, rho, d, f = (mpmath.mpf(x) for x in (7e10, 0.3, 2500.0, 1e-3, force))
        k = mpmath.cbrt(mpmath.mpf(3) / 2 * (e / (2 * (1 - nu**2))) ** 2 * d * f)
        c11, c12, c44 = cubic_constants(lattice, k / d, 2 * (1 - nu) / (2 - nu) * k / d)
        q = mpmath.matrix([mpmath.mpf(x) for x in way])
        q /= mpmath.norm(q)
        christoffel = mpmath.matrix(3, 3)
        for a, b in itertools.product(range(3), repeat=2):
            even = (c11 * q[a] ** 2 + c44 * (1 - q[a] ** 2)) if a == b else 0
            christoffel[a, b] = even or (c12 + c44) * q[a] * q[b]
        volume = {"sc": mpmath.mpf(1), "bcc": 4 / (3 * mpmath.sqrt(3)), "fcc": 1 / mpmath.sqrt(2)}[
            lattice
        ]
        density = mpmath.pi * rho / 6 / volume
        exact = sorted(mpmath.eigsy(christoffel, eigvals_only=True))
        for value, square in zip(found, exact, strict=True):
            assert abs(value / mpmath.sqrt(square / density) - 1) < 3e-15


@pytest.mark.parametrize(
    ("lattice", "more"),
    [
        ("fcc", {}),
        ("bcc", {"torsion": 0.1}),
        ("hcp", {}),
        ("hcp", {"torsion": 0.02, "bending": 0.1}),
        ("fcc", {"friction": False}),
        ("diamond", {"torsion": 0.1}),
        ("sc", {"finite_overlap": True}),
        ("hcp", {"finite_overlap": True, "torsion": "mindlin"}),
        pytest.param(PYROCHLORE, {}, marks=SLOW),
    ],
)
def test_velocities_are_the_slopes_of_the_bands(make, lattice, more):
    state = make(lattice, 50.0, **more)
    contacts = state.contact_lattice()
    along = np.random.default_rng(4).normal(size=(12, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    unit = D * math.sqrt(state.normal_stiffness / state.packing.mass)
    slopes = contacts.frequencies(1e-5 * along)[:, :3] / 1e-5 * unit
    found = gp.sound_velocities(state, along)
    assert_allclose(found.velocities, slopes, rtol=1e-8)
    # each wave solves Christoffel's equation with its polarisation
    tensor = contacts.acoustic_tensor(along) * unit**2
    vectors = found.polarisations
    assert_allclose(
        tensor @ vectors,
        vectors * found.velocities[:, None] ** 2,
        atol=1e-11 * found.velocities.max() ** 2,
    )
    assert_allclose(
        vectors.swapaxes(1, 2) @ vectors, np.broadcast_to(np.eye(3), (12, 3, 3)), atol=1e-13
    )
    # the longitudinal one is nearest to the direction, and points ahead
    ahead = np.einsum("ni,nib->nb", along, vectors)
    assert_array_equal(
        np.argmax(np.abs(ahead), axis=1),
        np.argmin(np.abs(found.velocities - found.longitudinal[:, None]), axis=1),
    )
    assert np.all(ahead.max(axis=1) > 0.8)


@pytest.mark.parametrize("lattice", ["fcc", "bcc", "sc", "hcp"])
def test_equal_velocities_have_polarisations_that_rounding_does_not_choose(make, lattice):
    state = make(lattice)
    root2 = math.sqrt(0.5)
    root6 = math.sqrt(1.0 / 6.0)
    cases = {
        (1.0, 0.0, 0.0): [[0, 1, 0], [0, 0, 1]],
        (0.0, 0.0, -1.0): [[1, 0, 0], [0, 1, 0]],
        (1.0, 1.0, 1.0): [[2 * root6, -root6, -root6], [0, root2, -root2]],
    }
    if lattice == "hcp":  # along c
        cases = {(0.0, 0.0, -1.0): cases[0.0, 0.0, -1.0]}
    for way, pair in cases.items():
        for scale in (1.0, 0.3, 7.1e-9):
            found = gp.sound_velocities(state, scale * np.array(way))
            assert_allclose(found.transverse[1], found.transverse[0], rtol=1e-14)
            assert_allclose(
                np.abs(found.polarisations[:, :2]), np.abs(np.transpose(pair)), atol=1e-12
            )
            assert_allclose(
                found.polarisations[:, 2], np.array(way) / np.linalg.norm(way), atol=1e-12
            )
            assert_allclose(
                np.abs(found.polarisations[:, :2].T @ np.transpose(pair)), np.eye(2), atol=1e-12
            )


def test_many_directions_are_each_of_them(make):
    along = np.random.default_rng(1).normal(size=(40, 3))
    along[:3] = np.eye(3)
    for lattice, more in (
        ("fcc", {}),
        ("hcp", {"torsion": "mindlin"}),
        ("fcc", {"finite_overlap": True}),
    ):
        states = make(lattice, np.array([1.0, 30.0]), **more)
        every = gp.sound_velocities(states, along)
        assert every.velocities.shape == (2, 40, 3)
        assert every.polarisations.shape == (2, 40, 3, 3)
        for load, way in ((0, 1), (1, 0), (1, 17), (0, 39)):
            single = gp.sound_velocities(states[load], along[way])
            assert_allclose(every.velocities[load, way], single.velocities, rtol=1e-14)
            assert_allclose(every.transverse[load, way], single.transverse, rtol=1e-14)
            assert_allclose(every.polarisations[load, way], single.polarisations, atol=1e-10)


@pytest.mark.parametrize(
    ("lattice", "friction", "finite"),
    [
        ("hcp", True, True),
        ("hcp", False, False),
        ("diamond", True, True),
        pytest.param(PYROCHLORE, True, False, marks=pytest.mark.slow),
        pytest.param("hcp", True, False, marks=SLOW),
        pytest.param("hcp", False, True, marks=SLOW),
        pytest.param("diamond", True, False, marks=SLOW),
        pytest.param(PYROCHLORE, True, True, marks=SLOW),
    ],
)
def test_torsion_of_hertz_contacts_at_many_loads(make, lattice, friction, finite):
    forces = np.array([[0.1, 900.0]])
    states = make(lattice, forces, finite, friction=friction, torsion="mindlin")
    found = gp.moduli(states)
    velocities = gp.sound_velocities(states, (0.2, 0.5, 0.9))
    for place in np.ndindex(forces.shape):
        single = make(lattice, forces[place], finite, friction=friction, torsion="mindlin")
        push = single.force / single.normal_stiffness / (D - single.overlap) if finite else 0.0
        contacts = gp.ContactLattice.of(
            lattice,
            single.packing.mindlin_ratio,
            1.0 - single.relative_overlap if finite else 1.0,
            push,
            torsion=float(single.torsion),
        )
        tensor = contacts.elastic_tensor() * single.normal_stiffness / D
        assert_allclose(found.tensor[place], tensor, rtol=1e-10, atol=1e-11 * tensor.max())
        unit = D * math.sqrt(single.normal_stiffness / single.packing.mass)
        assert_allclose(
            velocities.velocities[place],
            np.sort(contacts.sound_velocities((0.2, 0.5, 0.9))[0]) * unit,
            rtol=1e-10,
        )
    if not finite:
        # a strain twists contacts where balls are centres of inversion, and not between them
        ratio = found.tensor / states.normal_stiffness[..., None, None]
        assert (np.max(np.abs(ratio[0, 1] / ratio[0, 0] - 1)[:3, :3]) > 1e-9) == (
            lattice is PYROCHLORE
        )


def test_sound_says_which_branches_cost_nothing(make):
    def said(lattice, **more):
        state = make(lattice, np.array([1.0, 10.0]), **more)
        return [
            text
            for text in gp.sound_velocities(state, np.eye(state.packing.structure.periods)).warnings
            if "vanish" in text
        ]

    (chain,), (square,) = said("chain", motions="all"), said("square", motions="all")
    assert chain.startswith("3 of 6 branches vanish")
    assert chain.endswith("add torsion and bending")
    assert square.startswith("1 of 6 branches vanishes")
    (bent,) = said("chain", motions="all", bending=0.1)
    assert bent.startswith("1 of 6 branches vanishes")
    # flexural waves have no velocity either, and cost something
    for lattice, more in (
        ("chain", {"bending": 0.1, "torsion": 0.1}),
        ("triangular", {}),
        ("honeycomb", {"bending": 0.1}),
    ):
        assert said(lattice, motions="all", **more) == []
    for lattice in ("chain", "fcc", "triangular"):
        assert said(lattice) == []


# -- finite overlap --------------------------------------------------------------------------------


def hertz_coefficients(lattice, law, diameter, spacing):
    """Cauchy stress against strain of balls of the exact Hertz energy: inner shifts relaxed,
    differences of the stress.

    The stress is the derivative of the energy with respect to strain, by a complex step.
    """
    contacts = lattice.contacts
    vectors = contacts.vector * spacing
    volume = lattice.measure * spacing**3
    n = lattice.n_balls

    def energy(strain, shift):
        r = vectors @ (np.eye(3) + strain).T + (shift[contacts.j] - shift[contacts.i])
        overlap = diameter - np.sqrt(np.sum(r**2, axis=1))
        return 0.4 * law.coefficient * np.sum(overlap**2.5)

    def slopes(of, size):
        return np.array([of(1e-25j * one).imag / 1e-25 for one in np.eye(size)])

    def relax(strain):
        shift = np.zeros((n, 3))
        step = 1e-7 * spacing
        for _ in range(4 if n > 1 else 0):

            def force(moved, strain=strain):
                return slopes(
                    lambda other: energy(
                        strain, moved + np.concatenate([np.zeros(3), other]).reshape(n, 3)
                    ),
                    3 * n - 3,
                )

            ways = [
                np.concatenate([np.zeros(3), step * one]).reshape(n, 3) for one in np.eye(3 * n - 3)
            ]
            stiffness = np.array(
                [(force(shift + way) - force(shift - way)) / (2 * step) for way in ways]
            )
            shift = shift - np.concatenate(
                [np.zeros(3), np.linalg.solve(stiffness, force(shift))]
            ).reshape(n, 3)
        return shift

    def stress(strain):
        shift, frame = relax(strain), np.eye(3) + strain
        first = slopes(lambda other: energy(strain + other.reshape(3, 3), shift), 9).reshape(3, 3)
        return first @ frame.T / np.linalg.det(frame) / volume

    pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    step = 1e-6
    found = np.zeros((6, 6))
    for column, (a, b) in enumerate(pairs):
        strain = np.zeros((3, 3))
        strain[a, b] += 0.5 * step
        strain[b, a] += 0.5 * step
        change = (stress(strain) - stress(-strain)) / (2 * step)
        found[:, column] = [change[i, j] for i, j in pairs]
    return found


@pytest.mark.parametrize("lattice", ["fcc", "hcp"])
def test_finite_overlap_is_that_of_the_exact_energy(steel, lattice):
    packing = gp.Packing(steel, D, lattice=lattice, friction=False)
    state = gp.AveragedLattice(packing).at_overlap(0.02 * D, finite_overlap=True)
    expected = hertz_coefficients(packing.structure, packing.law, D, 0.98 * D)
    found = gp.moduli(state)
    assert_allclose(found.tensor, expected, rtol=1e-6, atol=1e-6 * expected.max())
    # without its terms it is another tensor
    limit = gp.moduli(gp.AveragedLattice(packing).at_overlap(0.02 * D)).tensor
    assert np.max(np.abs(limit - expected)) > 1e-3 * expected.max()
    # the bulk modulus is that of the equation of state, -V dP/dV
    with mpmath.workdps(30):
        c, d = mpmath.mpf(packing.law.coefficient), mpmath.mpf(D)

        def pressure(a):
            return 2 * mpmath.sqrt(2) * c * (d - a) ** mpmath.mpf("1.5") / a**2

        a = d * (1 - mpmath.mpf("0.02"))
        exact = -a / 3 * mpmath.diff(pressure, a)
        assert abs(found.bulk / exact - 1) < 1e-12


def test_static_forces_push_a_membrane_and_a_chain_aside(make):
    for lattice, motions in (
        ("triangular", "all"),
        ("triangular", "out_of_plane"),
        ("chain", "in_plane"),
    ):
        for force in (1e-20, 10.0):
            state = make(lattice, force, True, motions=motions)
            line = "line" if lattice == "chain" else "plane"
            told = (
                rf"lattice {lattice} buckles: .* direction \(.*1.*\) is negative.* at any load:"
                rf" .* leave the {line} farther"
            )
            with pytest.raises(InstabilityError, match=told):
                gp.sound_velocities(state)
    assert gp.sound_velocities(make("chain", 10.0, True)).longitudinal > 0.0


def test_an_average_over_directions_needs_a_positive_tensor():
    unstable = Moduli(np.diag([1.0, 1.0, -0.1]), False, ())
    assert unstable.voigt.shear == pytest.approx(0.2)
    with pytest.raises(InstabilityError, match="not positive"):
        _ = unstable.reuss


@given(seed=st.integers(0, 2**31))
@settings(max_examples=30)
def test_averages_are_in_order(seed):
    rng = np.random.default_rng(seed)
    size = (1, 3, 6)[rng.integers(1, 3)]
    factor = rng.normal(size=(2, size, size))
    found = Moduli(factor @ factor.swapaxes(1, 2) + 0.1 * np.eye(size), False, ())
    for name in ("bulk", "shear"):
        voigt, hill, reuss = (getattr(one, name) for one in (found.voigt, found.hill, found.reuss))
        assert np.all(reuss > 0.0)
        assert np.all(voigt >= hill)
        assert np.all(hill >= reuss)
    with pytest.raises(InputError, match="no single bulk modulus"):
        _ = found.bulk


# -- pulses ----------------------------------------------------------------------------------------


def test_pulses_on_a_chain_in_closed_form(make):
    state = make("chain", np.array([1.0, 10.0]))
    rate = np.sqrt(state.normal_stiffness / state.packing.mass)
    for part in (1e-9, 0.1, 0.9, 0.999):
        frequency = part * rate / math.pi  # of the top, 2 (k/M)^1/2
        found = gp.pulse_velocities(state, frequency)
        q = 2 * math.asin(part) / D
        assert found.branches == ("longitudinal",)
        assert (found.phase.shape, found.group_vector.shape) == ((1, 2), (1, 2, 1))
        assert_allclose(found.wavenumber[0], q, rtol=1e-12)
        assert_allclose(found.phase[0], 2 * math.pi * frequency / q, rtol=1e-12)
        assert_allclose(found.group[0], D * rate * math.cos(q * D / 2), rtol=1e-10)
        back = gp.pulse_velocities(state, frequency, (-1.0,))
        assert_allclose(
            [back.phase, back.group, -back.group_vector[..., 0]],
            [found.phase, found.group, found.group],
            rtol=1e-13,
        )
    with pytest.raises(UnreachableFrequencyError, match="longitudinal branch"):
        gp.pulse_velocities(state, 1.001 * rate / math.pi)


CRYSTALS = [
    ("fcc", {}),
    ("bcc", {}),
    ("hcp", {}),
    ("fcc", {"friction": False}),
    ("hcp", {"torsion": 0.1, "bending": 0.1}),
    ("fcc", {"finite_overlap": True}),
]


@pytest.mark.parametrize(("lattice", "more"), CRYSTALS)
def test_pulses_in_space_solve_the_dispersion_relation(make, lattice, more):
    state = make(lattice, 40.0, **more)
    contacts = state.contact_lattice()
    rate = math.sqrt(state.normal_stiffness / state.packing.mass)
    along = np.random.default_rng(7).normal(size=(2, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    frequency = 0.9 * rate / (2 * math.pi)
    found = gp.pulse_velocities(state, frequency, along)
    assert found.branches == ("longitudinal", "transverse_slow", "transverse_fast")
    assert (found.phase.shape, found.group_vector.shape) == ((3, 2), (3, 2, 3))
    step = 1e-5
    for branch, way in np.ndindex(3, 2):
        q = found.wavenumber[branch, way] * D * along[way]
        every = contacts.frequencies([q])[0]
        place = int(np.argmin(np.abs(every - 0.9)))
        assert abs(every[place] - 0.9) < 1e-12
        moved = contacts.frequencies(np.concatenate([q + step * np.eye(3), q - step * np.eye(3)]))[
            :, place
        ]
        gradient = (moved[:3] - moved[3:]) / (2 * step) * rate * D
        assert_allclose(
            found.group_vector[branch, way], gradient, atol=1e-6 * np.linalg.norm(gradient)
        )
        assert_allclose(found.group[branch, way], gradient @ along[way], rtol=1e-6)
    # long pulses are sound
    sound = gp.sound_velocities(state, along)
    long = gp.pulse_velocities(state, 1e-6 * frequency, along)
    expected = [sound.longitudinal, sound.transverse_slow, sound.transverse_fast]
    assert_allclose(long.phase, expected, rtol=1e-9)
    assert_allclose(long.group, expected, rtol=1e-8)


@pytest.mark.parametrize(
    ("lattice", "way"),
    [
        ("sc", (1, 0, 0)),
        ("bcc", (0, 0, -1)),
        ("fcc", (1, 1, 1)),
        ("fcc", (0, 0, -1)),
        ("bcc", (-1, 1, -1)),
        *(
            pytest.param(*case, marks=SLOW)
            for case in (
                ("sc", (0, 0, -1)),
                ("sc", (1, 1, 1)),
                ("sc", (-1, 1, -1)),
                ("bcc", (1, 0, 0)),
                ("bcc", (1, 1, 1)),
                ("fcc", (1, 0, 0)),
                ("fcc", (-1, 1, -1)),
            )
        ),
    ],
)
def test_branches_that_coincide_are_both_followed(make, lattice, way):
    state = make(lattice)
    rate = math.sqrt(state.normal_stiffness / state.packing.mass)
    along = np.array(way) / np.linalg.norm(way)
    for part in (1e-4, 0.8):
        found = gp.pulse_velocities(state, part * rate / (2 * math.pi), way)
        assert_allclose(found.phase[2], found.phase[1], rtol=1e-13)
        assert found.phase[0] > 1.1 * found.phase[1]
        # the mean of both flows along the axis
        assert_allclose(
            found.group_vector, found.group[:, None] * along, atol=1e-7 * found.group[0]
        )
    one = gp.pulse_velocities(state, 0.3 * rate / (2 * math.pi), way, branches="transverse_fast")
    two = gp.pulse_velocities(
        state, 0.3 * rate / (2 * math.pi), way, branches=["transverse_fast", "longitudinal"]
    )
    assert_allclose(two.phase[0], one.phase[0], rtol=1e-13)


def test_slow_and_fast_keep_their_names_along_the_branch(make):
    # along [110] of fcc the slow wave moves along [1-10] and the fast one along z, which the
    # mirrors keep apart
    state = make("fcc")
    contacts, along = state.contact_lattice(), np.array([1.0, 1.0, 0.0]) / math.sqrt(2.0)
    rate = math.sqrt(state.normal_stiffness / state.packing.mass)
    for part in (0.2, 0.6, 1.0):
        found = gp.pulse_velocities(state, part * rate / (2 * math.pi), (1, 1, 0))
        for branch, axis in (
            ("longitudinal", along),
            ("transverse_slow", [along[0], -along[1], 0]),
            ("transverse_fast", [0, 0, 1]),
        ):
            modes = contacts.modes([found.wavenumber[found.branches.index(branch)] * D * along])
            here = np.argmin(np.abs(modes.frequencies[0] - part))
            vector = modes.eigenvectors[0, :3, here]
            assert abs(abs(np.asarray(axis) @ vector) / np.linalg.norm(vector) - 1) < 1e-9


@pytest.mark.parametrize(
    ("lattice", "more", "along", "branch", "remedy"),
    [
        pytest.param(
            "chain", {"motions": "all"}, (1,), "transverse_slow", "Add bending, or", marks=SLOW
        ),
        pytest.param(
            "square",
            {"motions": "out_of_plane"},
            (1, 0),
            "out_of_plane",
            "Add bending, or",
            marks=EXHAUSTIVE,
        ),
        (
            "square",
            {"motions": "out_of_plane"},
            (1, 1),
            "out_of_plane",
            "Add torsion, or bending, or",
        ),
        pytest.param(
            "triangular",
            {"motions": "all"},
            (0, 1),
            "out_of_plane",
            "Add torsion, or bending, or",
            marks=EXHAUSTIVE,
        ),
        pytest.param(
            "triangular",
            {"motions": "all", "friction": False},
            (1, 0),
            "out_of_plane",
            "Add friction, or",
            marks=SLOW,
        ),
    ],
)
def test_branches_that_cost_nothing_have_no_pulses(make, lattice, more, along, branch, remedy):
    told = f"{branch} .*pulses .*{remedy}"
    with pytest.raises(UnreachableFrequencyError, match=told):
        gp.pulse_velocities(make(lattice, **more), 10.0, along, branches=branch)
    # with what is said to stop it, the branch has pulses
    more = more | (
        {"friction": True}
        if "friction" in remedy
        else {remedy.split(",")[0].removeprefix("Add "): 0.1}
    )
    assert gp.pulse_velocities(make(lattice, **more), 10.0, along, branches=branch).phase[0] > 0.0


@pytest.mark.parametrize(
    "more",
    [pytest.param({"finite_overlap": True}, marks=pytest.mark.slow), {"torsion": "mindlin"}, {}],
)
def test_pulses_over_loads_and_frequencies_are_each_of_them(make, more):
    states = make("hcp", np.array([1.0, 20.0]), **more)
    along = np.array([[0.0, 0.0, 1.0], [0.3, 0.2, 0.8]])
    frequencies = np.array([[100.0], [2000.0]])
    every = gp.pulse_velocities(
        states, frequencies, along, branches=("transverse_fast", "longitudinal")
    )
    assert every.phase.shape == (2, 2, 2, 2)
    assert every.group_vector.shape == (2, 2, 2, 2, 3)
    for m, load, way in ((0, 0, 0), (1, 1, 1), (0, 1, 1)):
        single = gp.pulse_velocities(
            states[load],
            frequencies[m, 0],
            along[way],
            branches=("transverse_fast", "longitudinal"),
        )
        for name in ("phase", "group", "wavenumber"):
            assert_allclose(
                getattr(every, name)[:, m, load, way], getattr(single, name), rtol=1e-11
            )


@pytest.mark.parametrize(
    ("lattice", "motions", "names"),
    [
        ("triangular", "all", ("longitudinal", "transverse", "out_of_plane")),
        ("square", "out_of_plane", ("out_of_plane",)),
        ("chain", "in_plane", ("longitudinal", "transverse")),
        ("chain", "all", ("longitudinal", "transverse_slow", "transverse_fast")),
    ],
)
def test_bending_waves_have_pulses(make, lattice, motions, names):
    state = make(
        lattice, motions=motions, torsion=0.1 if motions != "in_plane" else 0.0, bending=0.2
    )
    contacts, rate = state.contact_lattice(), math.sqrt(state.normal_stiffness / state.packing.mass)
    along = np.array([0.8, 0.6])[: contacts.periods]
    along = along / np.linalg.norm(along)
    found = gp.pulse_velocities(state, 0.2 * rate / (2 * math.pi), along, branches=names)
    for branch, q in enumerate(found.wavenumber * D):
        around = contacts.frequencies(q * np.array([[1.0], [1 + 1e-5], [1 - 1e-5]]) * along)
        place = np.argmin(np.abs(around[0] - 0.2))
        assert abs(around[0, place] - 0.2) < 1e-12
        assert_allclose(
            found.group[branch] / (rate * D),
            (around[1, place] - around[2, place]) / (2e-5 * q),
            rtol=1e-7,
        )
    # across the lattice the frequency goes as q^2 at first: the group is twice as fast as the phase
    low = gp.pulse_velocities(state, 1e-3 * rate / (2 * math.pi), along, branches=names)
    bent = [n for n, v in zip(names, state.long_waves(along), strict=True) if v == 0.0]
    assert bent
    for name in bent:
        place = names.index(name)
        assert_allclose(low.group[place] / low.phase[place], 2.0, rtol=5e-3)
    # by default those that are sound, or all if none is
    by_default = gp.pulse_velocities(state, 0.2 * rate / (2 * math.pi), along).branches
    assert by_default == (tuple(n for n in names if n not in bent) or names)


def test_branches_that_are_not_there(make):
    for lattice, more, bad in (
        ("fcc", {}, "transverse"),
        ("fcc", {}, "out_of_plane"),
        ("chain", {}, "transverse"),
        ("triangular", {}, "transverse_slow"),
        ("triangular", {"motions": "out_of_plane"}, "longitudinal"),
        ("fcc", {}, []),
        ("triangular", {}, ("rotational",)),
        ("triangular", {}, ()),
        ("triangular", {}, ("longitudinal", "shear")),
    ):
        state = make(lattice, **more)
        with pytest.raises(InputError, match=r"unknown branch|branches is an empty list"):
            gp.pulse_velocities(
                state, 100.0, np.eye(state.packing.structure.periods)[0], branches=bad
            )
    with pytest.raises(InputError, match="longitudinal, transverse_slow, transverse_fast"):
        gp.pulse_velocities(make("fcc"), 100.0, (1, 0, 0), branches="transverse")
    for lattice, bad in (("fcc", (1.0, 0.0)), ("chain", (1.0, 0.0)), ("square", (1.0, 0.0, 0.0))):
        for find in (
            gp.sound_velocities,
            lambda state, way: gp.pulse_velocities(state, 100.0, way),
        ):
            with pytest.raises(InputError, match="direction is"):
                find(make(lattice), bad)
    with pytest.raises(UnreachableFrequencyError, match=r"direction \(0, 0, 1\)"):
        gp.pulse_velocities(make("fcc"), 1e6, (0, 0, 1))
    with pytest.raises(MechanismError):
        gp.pulse_velocities(make("sc", friction=False), 100.0)


@pytest.mark.parametrize(
    ("lattice", "motions", "needed"),
    [
        ("chain", "longitudinal", False),
        ("chain", "all", False),
        ("triangular", "in_plane", False),
        ("triangular", "all", False),
        ("kagome", "in_plane", False),
        ("square", "in_plane", True),
        ("fcc", "all", True),
        ("hcp", "all", True),
        ("square", "out_of_plane", True),
        ("triangular", "out_of_plane", True),
    ],
)
def test_a_pulse_has_a_direction_where_it_depends_on_one(make, lattice, motions, needed):
    state = make(lattice, motions=motions, bending=0.0 if motions == "longitudinal" else 0.02)
    along = np.eye(state.packing.structure.periods)[0]
    given = gp.pulse_velocities(state, 100.0, along)
    if needed:
        with pytest.raises(InputError, match=rf"{lattice} .*direction=\(x, y"):
            gp.pulse_velocities(state, 100.0)
    else:
        assert_allclose(gp.pulse_velocities(state, 100.0).phase, given.phase, rtol=1e-15)
        assert_allclose(gp.pulse_velocities(state, 100.0).direction, along, rtol=0)


# -- validity, the catalogue, and plain data -------------------------------------------------------


@pytest.mark.parametrize(
    ("lattice", "more"),
    [
        ("chain", {}),
        ("chain", {"motions": "all", "torsion": 0.1}),
        ("square", {"motions": "all"}),
        ("fcc", {}),
        ("hcp", {}),
        ("square", {"motions": "out_of_plane", "bending": 0.1}),
        ("diamond", {}),
    ],
)
def test_validity_in_every_dimension(make, lattice, more):
    states = make(lattice, np.array([1e-3, 1e6]), **more)
    found = gp.validity(states)
    material = states.packing.material
    assert_array_equal(found.ok, [True, False])
    contacts = states.contact_lattice()
    rate = np.sqrt(states.normal_stiffness / states.packing.mass) / (2 * math.pi)
    assert_allclose(
        found["resonance"].value,
        contacts.top_frequency * rate / material.lowest_resonance(D),
        rtol=1e-13,
    )
    if lattice == "diamond":  # a mechanism has no sound
        assert "velocity" not in [check.name for check in found.checks]
        return
    if lattice == "square":  # in the plane along (1, 0)
        bulk = [
            {"longitudinal": material.longitudinal_velocity}.get(n, material.transverse_velocity)
            for n in states.wave_names
        ]
        assert_allclose(
            found["velocity"].value, np.max(states.long_waves((1, 0)) / bulk, axis=-1), rtol=1e-14
        )
        return
    along = np.random.default_rng(2).normal(size=(200, contacts.periods))
    bulk = [
        material.longitudinal_velocity if n == "longitudinal" else material.transverse_velocity
        for n in states.wave_names
    ]
    largest = np.max(states.long_waves(along) / bulk, axis=(-2, -1))
    assert np.all(found["velocity"].value >= 0.97 * largest)
    if lattice == "fcc":  # the fastest wave of a cubic lattice is along an axis
        assert np.all(found["velocity"].value >= largest)


def test_torsion_of_a_hertz_contact_warns_of_what_is_left_out(make):
    states = make("hcp", np.array([1e-3, 1.0]), torsion="mindlin")
    check = gp.validity(states)["torsion"]
    # the torsion is (1 - nu)/3 of the overlap over the diameter
    assert_allclose(check.value, 3 / (1 - 0.276), rtol=1e-12)
    assert not np.any(check.ok)
    for result in (
        gp.sound_velocities(states, (1, 0, 0)),
        gp.moduli(states),
        gp.pulse_velocities(states, 10.0, (1, 0, 0)),
    ):
        assert [text for text in result.warnings if "finite_overlap=True" in text]
    for other in (make("hcp", torsion="mindlin", finite_overlap=True), make("hcp", torsion=1e-3)):
        assert "torsion" not in [check.name for check in gp.validity(other).checks]
        assert gp.validity(other).warnings == ()


def test_torsion_warns_where_the_mean_overlap_of_balls_that_differ_is_negative(steel):
    packing = gp.Packing(steel, D, spread=gp.Uniform(2.04e-6), motions="all", torsion="mindlin")
    states = gp.AveragedForce(packing).at_overlap([-1e-6, -1e-8, 1e-5])
    check = gp.validity(states)["torsion"]
    # the static force over the torsion, as of equal balls
    assert_allclose(check.value, 3 / (1 - 0.276), rtol=1e-12)
    assert not np.any(check.ok)


def test_the_top_frequency_follows_the_torsion_of_each_load(make):
    # without friction only torsion resists rotations, whose branch is the highest at no load but a
    # large torsion
    forces = np.array([1.0, 1e3, 1e5])
    states = make("hcp", forces, friction=False, torsion="mindlin")
    found = gp.validity(states)["resonance"].value
    for place, force in enumerate(forces):
        single = make("hcp", float(force), friction=False, torsion="mindlin")
        value = gp.validity(single)["resonance"].value
        assert found[place] >= value * (1 - 1e-13)
        assert_allclose(found[place], value, rtol=1e-3)
    assert_allclose(found[-1], value, rtol=1e-14)


def test_units_and_titles_of_a_packing(make):
    for lattice, pressure, density, modulus in (
        ("chain", "N", "kg/m", "N"),
        ("square", "N/m", "kg/m^3", "Pa"),
        ("fcc", "Pa", "kg/m^3", "Pa"),
    ):
        packing = make(lattice).packing
        assert [
            entry_of(name, packing).unit for name in ("pressure", "effective_density", "force")
        ] == [
            pressure,
            density,
            "N",
        ]
        for name in ("bulk", "shear", "tensor", "bulk_error"):
            assert entry_of(name, packing).unit == modulus
            assert ("layer" in entry_of(name, packing).title) == (
                lattice == "square" and name != "bulk_error"
            )
    assert entry_of("pressure", make("fcc").packing).title == "force per area of boundary"
    assert all(entry_of(name, make("square").packing) is CATALOGUE[name] for name in CATALOGUE)


@pytest.mark.parametrize(
    ("lattice", "more", "names"),
    [
        ("chain", {}, {"longitudinal", "bulk", "tensor"}),
        ("square", {}, {"longitudinal", "transverse", "direction", "bulk", "tensor", "anisotropy"}),
        ("triangular", {}, {"longitudinal", "transverse", "bulk", "shear", "tensor"}),
        ("triangular", {"motions": "out_of_plane"}, {"out_of_plane"}),
        (
            "fcc",
            {},
            {
                "longitudinal",
                "transverse_slow",
                "transverse_fast",
                "direction",
                "bulk",
                "tensor",
                "anisotropy",
            },
        ),
        (RHOMBIC, {}, {"longitudinal", "transverse", "direction", "tensor"}),
    ],
)
def test_observables_of_each_dimension(make, lattice, more, names):
    states = make(lattice, np.array([1.0, 8.0]), **more)
    found = find_all(Analysis(states), ("velocities",))
    assert set(found) == names
    assert all(np.shape(found[name])[:1] == (2,) for name in names - {"direction"})
    # whose stress is none
    assert ("pressure" in find_all(Analysis(states), ("state",))) is (lattice != RHOMBIC)


def test_results_come_back_from_plain_data(make):
    for lattice, more in (
        ("chain", {}),
        ("chain", {"motions": "all", "bending": 0.1}),
        ("square", {"motions": "all"}),
        ("square", {"motions": "out_of_plane", "bending": 0.1}),
        ("hcp", {"torsion": "mindlin"}),
    ):
        for force in (3.0, np.array([1.0, 2.0])):
            state = make(lattice, force, **more)
            way = np.eye(state.packing.structure.periods)[-1:]
            results = [
                state,
                gp.sound_velocities(state, way),
                gp.validity(state),
                gp.pulse_velocities(state, 20.0, way),
            ]
            if "longitudinal" in state.wave_names:
                results.append(gp.moduli(state))
            for result in results:
                data = json.loads(json.dumps(result.to_dict()))
                assert type(result).from_dict(data) == result
    data = gp.moduli(make("chain")).to_dict()
    assert data["units"]["tensor"] == "N"
    data["units"]["tensor"] = "Pa"
    del data["digest"]
    with pytest.raises(InputError, match="units"):
        Moduli.from_dict(data)


def test_velocities_that_lack_a_wave_are_refused(make):
    state = make("triangular", np.array([1.0, 2.0]))
    data = gp.sound_velocities(state).to_dict()
    del data["digest"], data["transverse"]
    with pytest.raises(InputError, match="lack transverse"):
        SoundVelocities.from_dict(data)
    for changed in ({"transverse": None}, {"transverse": [[1.0, 2.0]] * 2}, {"longitudinal": None}):
        with pytest.raises(InputError, match="SoundVelocities"):
            SoundVelocities.from_dict({**data, "transverse": [1.0, 2.0]} | changed)


# -- the twist wave of a chain ---------------------------------------------------------------------

#: two balls in a cell of a chain
PAIR = gp.Lattice("pair", ((2.0,),), ((0.0,), (0.5,)))


@pytest.mark.parametrize("torsion", [1e-6, pytest.param(0.02, marks=SLOW), "mindlin"])
@pytest.mark.parametrize("lattice", ["chain", PAIR], ids=["chain", "pair"])
@pytest.mark.parametrize("motions", ["all", "out_of_plane"])
def test_twist_wave_of_a_chain_is_the_slope_of_its_branch(lattice, torsion, motions):
    packing = gp.Packing(
        gp.Material(211.65e9, 0.276, 7840.0), D, lattice=lattice, motions=motions, torsion=torsion
    )
    state = gp.AveragedLattice(packing).at_force([10.0, 300.0])
    found = gp.sound_velocities(state)
    assert found.twist.shape == (2,)
    assert gp.sound_velocities(state, [[1.0], [-1.0]]).twist.shape == (2, 2)
    for load, one in enumerate(found.twist):
        lattice_of = state[load].contact_lattice()
        units = state[load].scales
        modes = lattice_of.modes([[1e-4]])
        turns = np.abs(
            modes.eigenvectors[0][
                lattice_of.motions.rotations.index(0) + len(lattice_of.motions.translations)
            ]
        )
        branch = int(np.argmax(np.where(modes.frequencies[0] < 0.5, turns, 0.0)))
        slope = modes.frequencies[0, branch] / 1e-4 * units.velocity
        assert one == pytest.approx(slope, rel=1e-6)
    assert SoundVelocities.from_dict(found.to_dict()) == found


def test_twist_wave_is_there_where_balls_turn_about_a_chain():
    steel = gp.Material(211.65e9, 0.276, 7840.0)

    packing = gp.Packing(steel, D, lattice="chain", motions="all", torsion=0.0, bending=0.1)
    assert gp.sound_velocities(gp.AveragedLattice(packing).at_force(10.0)).twist == 0.0
    assert CATALOGUE["twist"].find(Analysis(gp.AveragedLattice(packing).at_force(10.0))) == 0.0
    for more in ({"lattice": "chain"}, {"lattice": "chain", "motions": "in_plane", "bending": 0.1}):
        assert (
            gp.sound_velocities(
                gp.AveragedLattice(gp.Packing(steel, D, **more)).at_force(10.0)
            ).twist
            is None
        )
    plane = gp.Packing(steel, D, motions="all", torsion=0.1)
    assert gp.sound_velocities(gp.AveragedLattice(plane).at_force(10.0)).twist is None


def relaxed_tensor(lattice, eta, torsion=0.0, bending=0.0):
    """Elastic tensor in units of k/d by a dense energy in strains, shifts and rotations of the
    balls of a cell.

    Each contact is written out in vectors; every pair is met from both ends, and counts half.
    """
    cell = np.array(lattice.cell)
    sites = np.array(lattice.positions)
    n = len(sites)
    rows = []
    units = np.zeros((6, 3, 3))
    for c, (a, b) in enumerate([(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]):
        units[c, a, b] += 0.5
        units[c, b, a] += 0.5
    for i, j in itertools.product(range(n), repeat=2):
        for steps in itertools.product(range(-2, 3), repeat=3):
            r = sites[j] + np.array(steps) @ cell - sites[i]
            if abs(np.linalg.norm(r) - 1.0) > 1e-9:
                continue
            shift, turn_i, turn_j = (
                np.zeros((3, 6 + 6 * n)),
                np.zeros((3, 6 + 6 * n)),
                np.zeros((3, 6 + 6 * n)),
            )
            shift[:, :6] = np.einsum("cab,b->ac", units, r)
            shift[:, 6 + 3 * j : 9 + 3 * j] += np.eye(3)
            shift[:, 6 + 3 * i : 9 + 3 * i] -= np.eye(3)
            turn_i[:, 6 + 3 * n + 3 * i : 9 + 3 * n + 3 * i] = np.eye(3)
            turn_j[:, 6 + 3 * n + 3 * j : 9 + 3 * n + 3 * j] = np.eye(3)
            across = np.eye(3) - np.outer(r, r)
            along = r[None]
            spin = np.cross((turn_i + turn_j).T / 2.0, r).T
            for weight, deformation in (
                (1.0, along @ shift),
                (eta, across @ shift - spin),
                (torsion, along @ (turn_j - turn_i)),
                (bending, across @ (turn_j - turn_i)),
            ):
                rows.append(math.sqrt(0.5 * weight) * deformation)
    c = np.concatenate(rows)
    strain = c[:, :6]
    inner = c[:, 6:]
    rest = strain - inner @ np.linalg.lstsq(inner, strain, rcond=1e-12)[0]
    return rest.T @ rest / abs(np.linalg.det(cell))


@pytest.mark.parametrize(
    ("lattice", "eta", "torsion", "bending"),
    [
        ("hcp", ETA, 0.0, 0.0),
        ("hcp", 0.0, 0.0, 0.0),
        ("hcp", 0.4, 0.05, 0.2),
        ("hcp", 0.0, 0.3, 0.0),
        ("bcc", 0.7, 0.1, 0.1),
        ("fcc", 0.0, 0.0, 0.0),
        ("diamond", ETA, 0.02, 0.0),
        ("diamond", ETA, 0.3, 0.7),
    ],
)
def test_inner_motions_are_relaxed(lattice, eta, torsion, bending):
    contacts = gp.ContactLattice.of(lattice, eta, torsion=torsion, bending=bending)
    expected = relaxed_tensor(gp.balls.lattices.find_lattice(lattice), eta, torsion, bending)
    assert_allclose(contacts.elastic_tensor(), expected, atol=3e-13)
    if lattice == "hcp":
        # hexagonal: five constants
        c11 = expected[0, 0]
        c12 = expected[0, 1]
        c13 = expected[0, 2]
        c33 = expected[2, 2]
        c44 = expected[3, 3]
        tensor = np.diag([c11, c11, c33, c44, c44, (c11 - c12) / 2])
        tensor[0, 1] = tensor[1, 0] = c12
        tensor[:2, 2] = tensor[2, :2] = c13
        assert_allclose(contacts.elastic_tensor(), tensor, atol=3e-13)
