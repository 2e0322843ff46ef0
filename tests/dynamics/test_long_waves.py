"""Long waves: acoustic tensor, velocities, moduli, the optical branch; the paper's limit and the
finite overlap.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.motions import allowed_motions
from granphon.balls.neighbours import freeze_contacts
from granphon.base.errors import InputError, InstabilityError, MechanismError

ETA = 2 * (1 - 0.276) / (2 - 0.276)

diameters = st.floats(-9.0, 2.0).map(lambda x: 10.0**x)
angles = st.floats(0.0, 7.0)


# -- equations 13, 14, 16, 17, 49 over every size and load -----------------------------------------


@given(angle=angles, eta=st.floats(0.0, 4 / 3))
def test_acoustic_tensor_is_isotropic(angle, eta):
    lattice = gp.ContactLattice.of("triangular", eta)
    along = np.array([math.cos(angle), math.sin(angle)])
    expected = 9 / 8 * (1 + eta / 3) * np.outer(along, along) + 3 / 8 * (1 + eta) * (
        np.eye(2) - np.outer(along, along)
    )
    assert_allclose(lattice.acoustic_tensor(along), expected, atol=2e-15)
    velocities, polarisations = lattice.sound_velocities(along)
    assert_allclose(velocities**2, [9 / 8 * (1 + eta / 3), 3 / 8 * (1 + eta)], rtol=2e-15)
    assert_allclose(np.abs(along @ polarisations), [1, 0], atol=1e-14)


# -- near Gamma ------------------------------------------------------------------------------------


@pytest.mark.claim("digits-near-gamma")
@given(
    exponent=st.floats(-12.0, -6.0),
    angle=angles,
    eta=st.one_of(st.just(0.0), st.floats(0.05, 4 / 3)),
)
def test_acoustic_branches_keep_their_digits(exponent, angle, eta):
    q = 10.0**exponent
    lattice = gp.ContactLattice.of("triangular", eta)
    along = np.array([math.cos(angle), math.sin(angle)])
    modes = lattice.modes([q * along])
    expected = np.sqrt([3 / 8 * (1 + eta), 9 / 8 * (1 + eta / 3)])
    # dispersion takes q^2 times less than one
    assert_allclose(modes.frequencies[0, :2] / q, expected, rtol=4e-15 + q * q)
    assert_allclose(modes.group_velocities[0, :2] @ along, expected, rtol=1e-14 + 3 * q * q)


@pytest.mark.claim("digits-near-gamma")
def test_dense_eigenvalues_have_no_digit_left_near_gamma(hexagonal):
    angles = np.linspace(0.1, 1.0, 7)
    along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    exact = np.sqrt([3 / 8 * (1 + ETA), 9 / 8 * (1 + ETA / 3)])
    for q in (1e-8, 1e-9):
        dense = np.sqrt(np.abs(np.linalg.eigvalsh(hexagonal.dynamical_matrix(q * along))[:, :2]))
        assert np.min(np.max(np.abs(dense / q / exact - 1), axis=1)) > 0.05
        assert np.max(np.abs(hexagonal.frequencies(q * along)[:, :2] / q / exact - 1)) < 4e-15


# -- the rotational branch -------------------------------------------------------------------------


@pytest.mark.parametrize("eta", [0.4, ETA, 4 / 3])
@pytest.mark.parametrize("angle", [0.0, 0.4, math.pi / 2])
def test_optical_branch_is_a_series_with_one_tenth(eta, angle):
    # omega^2 = 30 eta (1 - q^2/10) + O(q^4): the remainder falls sixteenfold as q halves
    lattice = gp.ContactLattice.of("triangular", eta)
    along = np.array([math.cos(angle), math.sin(angle)])
    q = np.array([0.2, 0.1, 0.05, 0.025])
    modes = lattice.modes(q[:, None] * along)
    assert np.all(modes.rotational_fraction[:, 2] > 0.99)
    remainder = modes.frequencies[:, 2] ** 2 - 30 * eta * (1 - q**2 / 10)
    assert_allclose(np.log2(remainder[:-1] / remainder[1:]), 4.0, atol=0.02)
    assert_allclose(lattice.optical_branch(along), [30 * eta, 0.1], rtol=3e-15)


@pytest.mark.parametrize(
    ("lattice", "spacing", "bending"),
    [("square", 1.0, 0.0), ("triangular", 0.9, 0.0), ("triangular", 1.0, 0.1)],
)
def test_optical_branch_of_other_lattices(lattice, spacing, bending):
    contacts = gp.ContactLattice.of(lattice, 0.7, spacing, bending=bending)
    for angle in (0.0, 0.5):
        along = np.array([math.cos(angle), math.sin(angle)])
        squared, narrowing = contacts.optical_branch(along)
        q = np.array([0.1, 0.05, 0.025])
        remainder = contacts.frequencies(q[:, None] * along)[:, 2] ** 2 - squared * (
            1 - narrowing * q**2
        )
        assert_allclose(np.log2(remainder[:-1] / remainder[1:]), 4.0, atol=0.02)


def test_no_single_optical_branch():
    for lattice, eta in (("kagome", ETA), ("triangular", 0.0)):
        with pytest.raises(InputError, match="rotational branch"):
            gp.ContactLattice.of(lattice, eta).optical_branch()


def test_the_strain_of_a_pressed_lattice_without_inner_motions_deforms_its_contacts():
    chain = gp.ContactLattice.of("chain", 0.0, prestress=1e-3)
    assert chain.gradient_motions.shape == (1, 1, 1)
    rows, deformations = chain.gradient_deformations
    assert [row.kind for row in rows] == ["elongation"]
    assert_allclose(deformations, np.ones((1, 1, 1, 1)))


def test_a_rotational_branch_that_begins_at_zero_has_no_series():
    rolling = gp.ContactLattice.of("triangular", 0.0, bending=0.1)
    assert rolling.frequencies([[0.0, 0.0]])[0, 2] == 0.0
    with pytest.raises(InputError, match="begins at zero"):
        rolling.optical_branch()


def test_springs_of_no_stiffness_leave_stress_symmetric(hexagonal):
    table = hexagonal.contacts
    with_spring = freeze_contacts(
        np.append(table.i, 0),
        np.append(table.j, 1),
        np.vstack([table.shift, [[0, 0]]]),
        np.vstack([table.normal, [[1.0, 0.0]]]),
        np.vstack([table.vector, [[0.0, 0.0]]]),
        np.append(table.arm_i, 0.0),
        np.append(table.arm_j, 0.0),
    )
    anchored = gp.ContactLattice(
        hexagonal.cell, hexagonal.positions, with_spring, ETA, on_site=np.zeros((1, 3))
    )
    assert_allclose(anchored.elastic_tensor(), hexagonal.elastic_tensor(), atol=1e-14)
    assert anchored.is_isotropic


def test_optical_branch_of_a_held_ball_is_refused():
    """A spring on the displacements changes their coupling with the rotation: the series without
    this would say that the branch falls by 0.09 q^2, but it falls by 0.29 q^2.
    """
    network = gp.ContactLattice.of("triangular", 0.8).contact_network(gp.Units(1.0, 1.0, 1.0))
    held = dataclasses.replace(network, on_site=np.array([[30.0, 30.0, 0.3]]))
    with pytest.raises(InputError, match="hold the ball"):
        gp.ContactLattice.from_network(held).optical_branch()


def test_optical_branch_of_a_chain_is_along_it_by_default():
    chain = gp.ContactLattice.of("chain", 0.8, motions=allowed_motions(2)["in_plane"])
    assert chain.optical_branch() == chain.optical_branch((1.0,))
    q = 1e-2
    frequencies = chain.frequencies([[0.0], [q]])[:, -1]
    squared, curvature = chain.optical_branch()
    assert_allclose(frequencies[0] ** 2, squared, rtol=1e-14)
    assert_allclose(1.0 - (frequencies[1] / frequencies[0]) ** 2, curvature * q**2, rtol=1e-4)


# -- the square and the kagome lattice -------------------------------------------------------------


@given(eta=st.floats(0.05, 4 / 3), angle=angles)
def test_square_lattice_with_friction_in_closed_form(eta, angle):
    # along an axis the row resists by k alone; in shear the ball turns by half the angle, so half
    # of kappa is left
    lattice = gp.ContactLattice.of("square", eta)
    assert_allclose(lattice.sound_velocities((1, 0))[0] ** 2, [1.0, eta / 2], rtol=3e-15)
    assert_allclose(lattice.sound_velocities((0, -1))[0] ** 2, [1.0, eta / 2], rtol=3e-15)
    # along a diagonal both rows are pressed and sheared; across it they are only pressed,
    # alternately
    pair = np.sort(lattice.sound_velocities((1, 1))[0] ** 2)
    assert_allclose(pair, [0.5, (1 + eta) / 2], rtol=3e-15)
    # in between: A = [[c^2 + eta s^2/2, eta sc/2], [., s^2 + eta c^2/2]]
    c, s = math.cos(angle), math.sin(angle)
    tensor = [
        [c * c + eta * s * s / 2, eta * s * c / 2],
        [eta * s * c / 2, s * s + eta * c * c / 2],
    ]
    assert_allclose(lattice.acoustic_tensor((c, s)), tensor, atol=2e-15)


@pytest.mark.claim("digits-near-gamma", "api-waves")
@pytest.mark.parametrize("lattice", ["triangular", "kagome"])
@pytest.mark.parametrize("size", [1e-3, 1e-6, 1e-12])
def test_every_branch_near_gamma_at_forty_digits(twin, lattice, size):
    cell = ((2.0, 0.0), (-1.0, math.sqrt(3.0)))
    sites = ((0.5, 0.0), (0.0, 0.5), (0.5, 0.5))
    contacts = gp.ContactLattice.of(lattice, ETA)
    with mpmath.workdps(40 + 2 * 12):
        neighbours = twin.exact_hexagon()
        if lattice == "kagome":
            angle = [
                (i, j, round(math.atan2(y, x) / (math.pi / 3)))
                for i, j, (x, y) in twin.neighbours(cell, sites)
            ]
            neighbours = [
                (i, j, (mpmath.cos(p * mpmath.pi / 3), mpmath.sin(p * mpmath.pi / 3)))
                for i, j, p in angle
            ]
        for way in (0.3, 2.0):
            q = [size * math.cos(way), size * math.sin(way)]
            exact = twin.exact_squares(neighbours, [mpmath.mpf(x) for x in q], mpmath.mpf(ETA))
            # the same from a list of its own, of many, and with velocities
            for found in (
                contacts.frequencies([q])[0],
                contacts.frequencies([[0.9, 0.4], q, [0.0, 0.0]])[1],
                contacts.modes([[0.9, 0.4], q]).frequencies[1],
            ):
                for value, square in zip(found, exact, strict=True):
                    assert abs(value / mpmath.sqrt(square) - 1) < 4e-15


# -- finite overlap --------------------------------------------------------------------------------


@given(
    diameter=diameters,
    overlap=st.floats(-12, -0.6),
    sigma=st.floats(-0.99, 0.5),
    friction=st.booleans(),
    angle=angles,
)
def test_prestressed_velocities_in_closed_form(diameter, overlap, sigma, friction, angle):
    packing = gp.Packing(gp.Material(7e10, sigma, 2500.0), diameter, friction=friction)
    state = gp.AveragedLattice(packing).at_overlap(10.0**overlap * diameter, finite_overlap=True)
    velocities = gp.sound_velocities(state, (math.cos(angle), math.sin(angle)))
    with mpmath.workdps(40):
        f = mpmath.mpf(state.force)
        k = mpmath.mpf(state.normal_stiffness)
        d = mpmath.mpf(diameter)
        a = d - mpmath.mpf(state.overlap)
        p = f / a
        kappa = mpmath.mpf(packing.mindlin_ratio) * k
        mass = mpmath.mpf(packing.mass)
        longitudinal = mpmath.sqrt((9 * k / 8 + 3 * (kappa - p) / 8) / mass) * a
        transverse = mpmath.sqrt((3 * (k + kappa) / 8 - 9 * p / 8) / mass) * a
        assert abs(velocities.longitudinal / longitudinal - 1) < 1e-13
        assert abs(velocities.transverse / transverse - 1) < 1e-13


@pytest.mark.parametrize("friction", [True, False])
@pytest.mark.parametrize("overlap", [1e-9, 1e-5, 1e-2, 0.1])
def test_bulk_modulus_is_minus_area_dp_by_da(steel, friction, overlap):
    packing = gp.Packing(steel, 8e-3, friction=friction)
    state = gp.AveragedLattice(packing).at_overlap(overlap * 8e-3, finite_overlap=True)
    found = gp.moduli(state)
    with mpmath.workdps(40):
        c, d = mpmath.mpf(packing.law.coefficient), mpmath.mpf(8e-3)

        def pressure(
            area,
        ):
            # per layer one diameter thick: sqrt(3) f / a / d at area sqrt(3)/2 a^2 of a ball
            a = mpmath.sqrt(2 * area / mpmath.sqrt(3))
            return mpmath.sqrt(3) * c * (d - a) ** mpmath.mpf("1.5") / a / d

        a = d - mpmath.mpf(state.overlap)
        area = mpmath.sqrt(3) / 2 * a * a
        exact = -area * mpmath.diff(pressure, area, h=mpmath.mpf("1e-25"))
        assert abs(found.bulk / exact - 1) < 1e-13
        k = mpmath.mpf(state.normal_stiffness)
        p = mpmath.mpf(state.force) / a
        assert abs(found.bulk / (mpmath.sqrt(3) / 2 * (k + p) / d) - 1) < 1e-14
        # and equation 16 holds at the density of the compressed layer
        velocities = gp.sound_velocities(state)
        density = mpmath.mpf(packing.mass) / (area * d)
        difference = (
            mpmath.mpf(velocities.longitudinal) ** 2 - mpmath.mpf(velocities.transverse) ** 2
        )
        assert abs(found.bulk / (density * difference) - 1) < 1e-13
        assert abs(found.shear / (density * mpmath.mpf(velocities.transverse) ** 2) - 1) < 1e-13


@pytest.mark.claim("finite-overlap-exact")
@pytest.mark.parametrize("friction", [True, False])
def test_finite_overlap_tends_to_the_paper_at_first_order(steel, friction):
    packing = gp.Packing(steel, 8e-3, friction=friction)
    overlaps = np.array([1e-3, 5e-4, 2.5e-4, 1.25e-4]) * 8e-3
    limit, state = (
        gp.AveragedLattice(packing).at_overlap(overlaps, finite_overlap=finite)
        for finite in (False, True)
    )
    here = gp.sound_velocities(limit)
    there = gp.sound_velocities(state)
    for name in ("longitudinal", "transverse"):
        error = np.abs(getattr(there, name) / getattr(here, name) - 1)
        assert_allclose(np.log2(error[:-1] / error[1:]), 1.0, atol=2e-3)
    error = np.abs(gp.moduli(state).bulk / gp.moduli(limit).bulk - 1)
    # sqrt(3)/2 (k + f/a): the difference is (2/3) delta/a
    assert_allclose(error, 2 / 3 * overlaps / (8e-3 - overlaps), rtol=1e-11)


def test_overlap_that_buckles_the_lattice(smooth, packing):
    # frictionless: p > k/3 beyond delta = d/3; with friction v_T^2 = 0 at p = (1 + eta)/3, that is
    # delta/d = p/(2/3 + p)
    gp.sound_velocities(gp.AveragedLattice(smooth).at_overlap(0.333 * 8e-3, finite_overlap=True))
    with pytest.raises(
        InstabilityError,
        match=r"triangular buckles.* load",
    ):
        gp.sound_velocities(
            gp.AveragedLattice(smooth).at_overlap(0.334 * 8e-3, finite_overlap=True)
        )
    p = (1 + ETA) / 3
    critical = p / (2 / 3 + p)
    gp.sound_velocities(
        gp.AveragedLattice(packing).at_overlap((critical - 1e-3) * 8e-3, finite_overlap=True)
    )
    with pytest.raises(InstabilityError):
        gp.sound_velocities(
            gp.AveragedLattice(packing).at_overlap((critical + 1e-3) * 8e-3, finite_overlap=True)
        )


# -- mechanisms ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lattice", "strain"),
    [
        ("honeycomb", "(xx, yy, 2xy) = (0, 0, 1)"),
        ("square", "(xx, yy, 2xy) = (0, 0, 1)"),
        ("sc", "(xx, yy, zz, 2yz, 2xz, 2xy) = (0, 0, 0, 1, 0, 0)"),
        ("bcc", "(xx, yy, zz, 2yz, 2xz, 2xy) = (1, -0.5, -0.5, 0, 0, 0)"),
        ("diamond", "(xx, yy, zz, 2yz, 2xz, 2xy) = (0, 0, 0, 1, 0, 0)"),
    ],
)
def test_of_several_strains_that_cost_nothing_a_plain_one_is_told(lattice, strain):
    assert f"The strain {strain} costs no energy" in gp.ContactLattice.of(lattice, 0.0).mechanism


def test_a_mechanism_without_friction_is_mended_by_friction_where_contacts_bend():
    with pytest.raises(MechanismError, match="Use friction"):
        gp.ContactLattice.of("square", 0.0, bending=0.03).sound_velocities([1.0, 0.0])


@pytest.mark.parametrize("torsion", [1e-5, 1e-3])
def test_balls_of_the_honeycomb_that_turn_like_gears_take_part_in_sound(torsion):
    # torsion does not resist them, and displacements across the plane, which cost nothing either,
    # are no part of them
    motions = allowed_motions(2)["all"]
    for eta in np.linspace(0.7, 1.0, 31):
        lattice = gp.ContactLattice.of("honeycomb", eta, torsion=torsion, motions=motions)
        assert "turn" in lattice.mechanism


# -- balls of two sizes that turn like gears -------------------------------------------------------

STEEL_BALL = gp.Ball(gp.Material(193e9, 0.30, 8000.0), 8e-3, name="A")
ALU_BALL = gp.Ball(gp.Material(73.5e9, 0.33, 2700.0), 6e-3, name="B")


def of_two_sizes(name):
    """Crystals without odd rings, of balls of 8 and 6 mm."""
    if name == "checkerboard":
        cell = 7e-3 * np.array([[1.0, 1.0], [1.0, -1.0]])
        return gp.Crystal([STEEL_BALL, ALU_BALL], cell, 7e-3 * np.array([[0.0, 0.0], [1.0, 0.0]]))
    return gp.Crystal.on(name, [STEEL_BALL, ALU_BALL])


@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_pressed_rock_salt_of_two_sizes_is_as_stiff_as_in_lammps(scale):
    """C44 / C33 of granular pairs with mindlin friction, all forces from LAMMPS; gears have radii
    for arms there.
    """
    state = of_two_sizes("NaCl").at_strain(
        scale * np.array([-2e-5, -2e-5, -3e-5, 0.0, 0.0, 0.0]), finite_overlap=True
    )
    tensor = gp.moduli(state).tensor
    assert_allclose(tensor[3, 3] / tensor[2, 2], 0.36327, rtol=scale * 3e-5)
    found = gp.sound_velocities(state, (1, 0, 0)).velocities
    assert_allclose(found, scale**0.25 * np.array([172.46, 180.96, 271.29]), rtol=scale * 6e-5)


def test_sheared_caesium_chloride_of_two_sizes_has_the_sound_of_its_bands():
    state = of_two_sizes("CsCl").at_strain(
        [-2e-5, -2e-5, -2e-5, 6e-6, 8e-6, 4e-6], finite_overlap=True
    )
    assert_allclose(
        gp.sound_velocities(state, (1, 0, 0)).velocities, [209.77, 216.77, 292.03], rtol=3e-5
    )


@pytest.mark.claim("gears-stay-behind")
@pytest.mark.parametrize("name", ["checkerboard", "NaCl", "CsCl"])
@settings(max_examples=3, deadline=None)
@given(
    size=st.floats(-7.0, -4.0),
    angle=angles,
    shares=st.lists(st.floats(-0.3, 0.3), min_size=6, max_size=6),
    data=st.data(),
)
def test_gears_of_uneven_arms_stay_behind_in_sound(name, size, angle, shares, data):
    """Their frequency is of order e; at |q|d = e^1/2 the bands are those of sound to order e."""
    crystal = of_two_sizes(name)
    e = 10.0**size
    p = crystal.periods
    strain = e * (np.diag(shares[:p]) - np.eye(p))
    for (a, b), shear in zip(itertools.combinations(range(p), 2), shares[3:], strict=False):
        strain[a, b] = strain[b, a] = e * shear
    state = crystal.at_strain(strain, finite_overlap=True)
    along = np.array([math.cos(angle), math.sin(angle), data.draw(st.floats(-1.0, 1.0))])[:p]
    along /= np.linalg.norm(along)
    lattice = gp.Phonons(state).lattice
    found = np.sort(lattice.sound_velocities(along)[0])
    q = math.sqrt(e)
    modes = lattice.modes([q * along])
    # waves that move all balls together, of all with the same frequency the slowest first
    still = np.sum(np.abs(lattice._to_balls[:, :p].conj().T @ modes.eigenvectors[0]) ** 2, axis=0)
    sound = np.sort(np.argsort(-still, kind="stable")[:p])
    assert_allclose(modes.frequencies[0, sound] / q, found, rtol=20.0 * e)
    # the limit of small overlap is reached at first order
    pressed = crystal.at_strain(strain)
    limit = gp.sound_velocities(pressed, along).velocities
    assert_allclose(gp.sound_velocities(state, along).velocities, limit, rtol=3.0 * e)
    # lever arms that differ do the same where static forces are left out
    network = dataclasses.replace(state.network, prestress=False)
    assert_allclose(gp.sound_velocities(network, along).velocities, limit, rtol=3.0 * e)
    tensor = gp.moduli(pressed).tensor
    for near in (state, network):
        assert_allclose(gp.moduli(near).tensor, tensor, rtol=0.0, atol=4.0 * e * np.max(tensor))


@pytest.mark.parametrize(
    ("name", "ratio"),
    [
        ("NaCl", 1e-12),
        ("NaCl", 1e-5),
        ("CsCl", 1e-9),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("NaCl", 1e-9),
                ("NaCl", 1e-7),
                ("CsCl", 1e-12),
                ("CsCl", 1e-7),
                ("CsCl", 1e-5),
            )
        ),
    ],
)
def test_gears_of_nearly_equal_balls_are_those_of_equal_ones(name, ratio):
    """At a given strain sound does not depend on the size of balls; by symmetry their difference
    acts at second order.
    """
    aluminium = ALU_BALL.material
    near = ratio**2 + 1e-13
    for strain in (
        [-3.194e-5, -3.353e-5, -3.547e-5, 4.4e-7, -2.61e-6, -2.33e-6],
        [-1.773e-5, -1.765e-5, -2.268e-5, 0.0, 0.0, 0.0],
        [-3.32e-6, -3.64e-6, -4.38e-6, 6.3e-8, 3.43e-7, -4.41e-7],
    ):
        equal, nearly = (
            gp.Crystal.on(
                name, [gp.Ball(aluminium, 8e-3), gp.Ball(aluminium, 8e-3 * (1.0 - part))]
            ).at_strain(strain, finite_overlap=True)
            for part in (0.0, ratio)
        )
        expected = gp.sound_velocities(equal, (1, 2, 3)).velocities
        tensor = gp.moduli(equal).tensor
        for medium in (nearly, nearly.network.repeat((2, 1, 1))):
            assert_allclose(gp.sound_velocities(medium, (1, 2, 3)).velocities, expected, rtol=near)
            assert_allclose(gp.moduli(medium).tensor, tensor, rtol=0.0, atol=near * np.max(tensor))


@pytest.mark.parametrize("ratio", [0.0, 1e-9, 1e-5])
def test_gears_of_nearly_equal_balls_that_couple_with_sound_remain_a_mechanism(ratio):
    balls = [gp.Ball(ALU_BALL.material, 8e-3), gp.Ball(ALU_BALL.material, 8e-3 * (1.0 - ratio))]
    state = gp.Crystal.on("honeycomb", balls).at_strain([-3e-5, -3.3e-5, 2e-6], finite_overlap=True)
    with pytest.raises(MechanismError, match="gears"):
        gp.sound_velocities(state, (1, 2))


def test_moduli_that_are_not_positive_are_an_error(steel):
    packing = gp.Packing(steel, 8e-3)
    p = (1 + packing.mindlin_ratio) / 3
    critical = p / (2 / 3 + p)
    gp.moduli(gp.AveragedLattice(packing).at_overlap((critical - 1e-3) * 8e-3, finite_overlap=True))
    states = gp.AveragedLattice(packing).at_overlap(
        np.array([0.01, critical + 1e-3]) * 8e-3, finite_overlap=True
    )
    with pytest.raises(InstabilityError, match=r"\(0, 0, 1\)"):
        _ = gp.moduli(states).tensor


def test_inner_motions_that_buckle_are_an_error_where_a_strain_moves_them():
    # of diamond the two balls of the cell shift against each other with the stiffness 4/3 (1 + 2
    # eta - 2 p), p the prestress
    with pytest.raises(InstabilityError, match=r"q = \(0, 0, 0\)"):
        gp.ContactLattice.of("diamond", 0.5, prestress=1.01, bending=0.1).gradient_stiffness()
    gp.ContactLattice.of("diamond", 0.5, prestress=0.99, bending=0.1).gradient_stiffness()


loads = st.floats(-30.0, -5.0).map(lambda x: 10.0**x)


def exact_longwave(packing, force):
    """v_L, v_T, K, G from the printed formulas, in the present precision of mpmath."""
    material = packing.material
    e, s, rho, d, f = (
        mpmath.mpf(x)
        for x in (
            material.young_modulus,
            material.poisson_ratio,
            material.density,
            packing.diameter,
            force,
        )
    )
    eta = 2 * (1 - s) / (2 - s) if packing.friction else mpmath.mpf(0)
    k = mpmath.cbrt(mpmath.mpf(3) / 2 * (e / (2 * (1 - s**2))) ** 2 * d * f)
    mass = mpmath.pi * rho * d**3 / 6
    bulk = mpmath.sqrt(3) / 2 * k / d
    longitudinal = mpmath.sqrt(mpmath.mpf(9) / 8 * (1 + eta / 3) * k / mass) * d
    transverse = mpmath.sqrt(mpmath.mpf(3) / 8 * (1 + eta) * k / mass) * d
    return longitudinal, transverse, bulk, (1 + eta) / 2 * bulk, eta


@pytest.mark.claim("readme-range")
@given(
    diameter=diameters,
    load=loads,
    sigma=st.floats(-0.99, 0.5),
    friction=st.booleans(),
    angle=angles,
)
def test_velocities_and_moduli_at_every_size_and_load(diameter, load, sigma, friction, angle):
    packing = gp.Packing(gp.Material(7e10, sigma, 2500.0), diameter, friction=friction)
    force = load * 7e10 * diameter**2
    state = gp.AveragedLattice(packing).at_force(force)
    velocities = gp.sound_velocities(state)
    moduli = gp.moduli(state)
    turned = gp.sound_velocities(state, (math.cos(angle), math.sin(angle)))
    with mpmath.workdps(40):
        longitudinal, transverse, bulk, shear, eta = exact_longwave(packing, force)
        density = mpmath.pi * 2500 / (3 * mpmath.sqrt(3))
        for found, exact in (
            (velocities.longitudinal, longitudinal),  # equation 13
            (velocities.transverse, transverse),  # 14
            (turned.longitudinal, longitudinal),
            (turned.transverse, transverse),
            (moduli.bulk, bulk),  # 17
            (moduli.shear, shear),
            (velocities.longitudinal, mpmath.sqrt((bulk + shear) / density)),  # 16
            (velocities.transverse, mpmath.sqrt(shear / density)),
            (packing.effective_density, density),
            ((velocities.longitudinal / velocities.transverse) ** 2, (3 + eta) / (1 + eta)),  # 49
        ):
            assert abs(found / exact - 1) < 1e-13


@pytest.mark.parametrize("eta", [ETA, 0.0])
@pytest.mark.parametrize("q", [1e-12, 1e-9, 1e-6])
def test_acoustic_branches_at_finite_overlap_keep_eight_digits(eta, q):
    terms = {"spacing": 0.99, "prestress": 2 / 3 * 0.01 / 0.99}
    contacts = gp.ContactLattice.of("triangular", eta, **terms)
    along = np.array([0.6, 0.8])
    expected = np.sort(contacts.sound_velocities(along)[0])
    assert_allclose(contacts.frequencies([q * along])[0, :2] / q, expected, rtol=1e-8)


@pytest.mark.parametrize("lattice", ["square", "kagome"])
def test_prestress_of_other_lattices_against_the_bands(steel, lattice):
    # the slope of the bands at Gamma is the sound velocity
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice=lattice)).at_overlap(
        0.02 * 8e-3, finite_overlap=True
    )
    delta = 0.02
    contacts = gp.ContactLattice.of(lattice, ETA, 1 - delta, 2 / 3 * delta / (1 - delta))
    unit = 8e-3 * math.sqrt(state.normal_stiffness / state.packing.mass)
    for angle in (0.0, 0.4, math.pi / 4):
        along = np.array([math.cos(angle), math.sin(angle)])
        found = gp.sound_velocities(state, along)
        slopes = contacts.frequencies([1e-6 * along])[0, :2] / 1e-6 * unit
        assert_allclose(np.sort([found.longitudinal, found.transverse]), slopes, rtol=1e-8)
