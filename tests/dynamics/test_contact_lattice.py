"""Bands, eigenvectors and group velocities of lattices of contacts, against explicit sums over the
neighbours.
"""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.motions import OUT_OF_PLANE
from granphon.base.errors import (
    GranphonError,
    InputError,
    InstabilityError,
    MechanismError,
    PrecisionError,
)
from granphon.dynamics.branches import connect_branches

ETA = 2 * (1 - 0.276) / (2 - 0.276)
UNITS = gp.Units(1.0, 1.0, 1.0)
HEXAGON = ((1.0, 0.0), (-0.5, math.sqrt(0.75)))
KAGOME = ((2.0, 0.0), (-1.0, math.sqrt(3.0))), ((0.5, 0.0), (0.0, 0.5), (0.5, 0.5))
HONEYCOMB = gp.Lattice(
    "honeycomb",
    ((math.sqrt(3.0), 0.0), (-math.sqrt(3.0) / 2, 1.5)),
    ((1 / 3, 2 / 3), (2 / 3, 1 / 3)),
)

wavevectors = st.tuples(st.floats(-7, 7), st.floats(-7, 7))
ratios = st.one_of(st.just(0.0), st.floats(0.05, 4.0 / 3.0))


# -- the dynamical matrix and the bands ------------------------------------------------------------


#: cells and sites of the twin, and the numbers of neighbours in them
TWINS = {
    "triangular": (HEXAGON, ((0, 0),), 6),
    "square": (((1, 0), (0, 1)), ((0, 0),), 4),
    "kagome": (*KAGOME, 12),
}


@pytest.mark.parametrize("name", TWINS)
@given(
    q=wavevectors,
    eta=st.floats(0.05, 4 / 3) | st.just(0.0),
    overlap=st.just(0.0) | st.floats(1e-6, 0.1),
)
def test_bands_and_modes_against_the_sums_over_the_neighbours(twin, name, q, eta, overlap):
    # at Gamma modes are a limit along the direction
    assume(q != (0.0, 0.0) and (eta or name == "triangular"))
    # f/(k a) = (2/3) delta/(d - delta) for Hertz's law
    terms = {"spacing": 1 - overlap, "prestress": 2 / 3 * overlap / (1 - overlap)}
    cell, sites, count = TWINS[name]
    neighbours = twin.neighbours(cell, sites)
    lattice = gp.ContactLattice.of(name, eta, **terms)
    assert len(neighbours) == count
    matrix = twin.matrix(neighbours, q, eta, **terms)
    assert_allclose(lattice.dynamical_matrix([q])[0], matrix, atol=3e-14)
    try:
        squares = lattice.frequencies([q])[0] ** 2
    except InstabilityError:
        assert np.linalg.eigvalsh(matrix)[0] < 1e-14
        return
    assert squares.shape == ((3 if eta else 2) * lattice.n_balls,)
    assert_allclose(squares, np.linalg.eigvalsh(matrix), atol=1e-13)
    modes = lattice.modes([q], (1.0, 0.0))
    vectors = modes.eigenvectors[0]
    assert_allclose(matrix @ vectors, vectors * modes.frequencies[0] ** 2, atol=2e-13)
    assert_allclose(vectors.conj().T @ vectors, np.eye(len(vectors)), atol=2e-14)


def test_points_of_high_symmetry_in_closed_form():
    # Gamma: 30 eta. K: translations 9/2 (1 + eta) twice, pure rotation 15/2 eta.
    # M: 6 + 2 eta along q, 2 + 6 eta across it, pure rotation 10 eta
    lattice = gp.ContactLattice.of("triangular", ETA)
    gamma, k, m = (
        lattice.frequencies(lattice.wavevectors([[0, 0], [1 / 3, 1 / 3], [1 / 2, 0]])) ** 2
    )
    assert_allclose(gamma, [0, 0, 30 * ETA], rtol=1e-15)
    assert_allclose(k, sorted([4.5 * (1 + ETA), 4.5 * (1 + ETA), 7.5 * ETA]), rtol=3e-15)
    assert_allclose(m, sorted([6 + 2 * ETA, 2 + 6 * ETA, 10 * ETA]), rtol=3e-15)


def test_pure_rotation_is_the_top_branch_at_m_and_the_bottom_one_at_k(hexagonal):
    modes = hexagonal.modes(hexagonal.wavevectors([[1 / 2, 0], [1 / 3, 1 / 3]]))
    assert_allclose(modes.rotational_fraction, [[0, 0, 1], [1, 0, 0]], atol=1e-15)


# -- fractions and polarisation --------------------------------------------------------------------


@pytest.mark.parametrize(
    "direction", [(1.0, 0.0), (0.0, 1.0), (0.5, math.sqrt(0.75)), (math.sqrt(0.75), 0.5)]
)
def test_waves_along_mirrors_are_pure(hexagonal, direction):
    modes = hexagonal.modes(np.linspace(0.1, 3.0, 9)[:, None] * np.asarray(direction))
    longitudinal = modes.longitudinal_fraction
    assert_allclose(
        np.sort(longitudinal, axis=1), np.broadcast_to([0, 0, 1], longitudinal.shape), atol=1e-13
    )


def test_waves_off_the_mirrors_mix(hexagonal):
    modes = hexagonal.modes([3.0 * np.array([math.cos(0.2), math.sin(0.2)])])
    assert np.max(np.minimum(modes.longitudinal_fraction, 1 - modes.longitudinal_fraction)) > 1e-3


# -- group velocities ------------------------------------------------------------------------------


@pytest.mark.claim("bands-and-group-velocities")
@pytest.mark.parametrize("case", ["triangular", "smooth", "square", "kagome", "overlap"])
def test_group_velocities_are_the_gradient_at_second_order(case):
    lattice = {
        "triangular": lambda: gp.ContactLattice.of("triangular", ETA),
        "smooth": lambda: gp.ContactLattice.of("triangular", 0.0),
        "square": lambda: gp.ContactLattice.of("square", 0.7),
        "kagome": lambda: gp.ContactLattice.of("kagome", 0.7),
        "overlap": lambda: gp.ContactLattice.of("triangular", ETA, 0.95, 0.03),
    }[case]()
    q = np.array([0.9, 0.37])
    exact = lattice.modes([q]).group_velocities[0]
    errors = []
    for h in (1e-2, 5e-3, 2.5e-3):
        steps = h * np.eye(2)
        difference = (lattice.frequencies(q + steps) - lattice.frequencies(q - steps)).T / (2 * h)
        errors.append(np.linalg.norm(difference - exact))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert_allclose(orders, 2.0, atol=0.03)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (math.cos(0.4), math.sin(0.4)), (0.0, -1.0)])
@pytest.mark.parametrize("eta", [ETA, 0.0])
def test_velocities_at_the_corner_of_the_zone_are_limits_along_the_path(eta, direction):
    # two branches touch at K in a cone; the path meets them with the slopes of its own direction,
    # from either side
    lattice = gp.ContactLattice.of("triangular", eta)
    corner = np.array([4 * math.pi / 3, 0.0])
    along = np.asarray(direction)
    slopes = lattice.modes([corner], direction).group_velocities[0] @ along
    assert np.ptp(slopes) > 0.05
    errors = []
    for h in (1e-3, 5e-4):
        before, at, after = lattice.frequencies(corner + np.array([[-h], [0], [h]]) * along)
        # ascending order is one branch after K and the other before it: compare as sets, each side
        # at first order ...
        one_sided = [
            np.sort((after - at) / h) - np.sort(slopes),
            np.sort((at - before) / h) - np.sort(slopes),
        ]
        errors.append([np.abs(side).max() for side in one_sided])
    assert np.max(errors) < 1e-3
    assert_allclose(np.log2(np.divide(*errors)), 1.0, atol=0.02)
    # ... and each branch follows through: the eigenvectors at K are those of the path on both sides
    path = lattice.modes(corner + np.array([[-1e-5], [0], [1e-5]]) * along, direction).eigenvectors
    order = connect_branches(path)
    overlaps = [
        np.abs(np.sum(path[p].conj()[:, order[p]] * path[p + 1][:, order[p + 1]], axis=0))
        for p in (0, 1)
    ]
    assert_allclose(overlaps, 1.0, atol=1e-8)


def test_velocities_at_gamma_are_the_sound_velocities_in_any_direction(hexagonal):
    for angle in (0.0, 0.3, 1.2, 4.0):
        along = np.array([math.cos(angle), math.sin(angle)])
        modes = hexagonal.modes([[0.0, 0.0]], along)
        expected = np.sqrt([3 / 8 * (1 + ETA), 9 / 8 * (1 + ETA / 3), 0.0])[:, None] * along
        assert_allclose(modes.group_velocities[0], expected, atol=2e-9)
        assert_allclose(modes.frequencies[0], [0, 0, math.sqrt(30 * ETA)], atol=1e-15)
        assert_allclose(modes.longitudinal_fraction[0], [0, 1, 0], atol=1e-15)
        assert_allclose(modes.rotational_fraction[0], [0, 0, 1], atol=1e-15)


def test_gamma_needs_a_direction(hexagonal):
    with pytest.raises(InputError, match="direction"):
        hexagonal.modes([[0.1, 0.2], [0.0, 0.0]])
    with pytest.raises(InputError, match="not both zero"):
        hexagonal.modes([[0.0, 0.0]], (0.0, 0.0))


def test_modes_take_one_direction_or_one_for_each_wave_vector(hexagonal):
    q = [[0.1, 0.2], [0.2, 0.3]]
    with pytest.raises(InputError, match="2 wave vectors"):
        hexagonal.modes(q, np.ones((3, 2)))
    repeated = hexagonal.modes(q, np.ones((2, 2)))
    assert_allclose(hexagonal.modes(q, (1.0, 1.0)).frequencies, repeated.frequencies, rtol=1e-15)
    with pytest.raises(InputError, match="no wave vector"):
        hexagonal.modes(np.zeros((0, 2)))


# -- mechanisms ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lattice", "eta"), [("kagome", 0.0), (HONEYCOMB, 0.84), (HONEYCOMB, 0.0)])
def test_other_mechanisms(lattice, eta):
    with pytest.raises(MechanismError, match="mechanism"):
        gp.ContactLattice.of(lattice, eta).elastic_tensor()


def test_honeycomb_turns_like_gears(twin):
    # the twin agrees: opposite rotations of the two balls cost nothing
    neighbours = twin.neighbours(HONEYCOMB.cell, HONEYCOMB.sites)
    squares = np.linalg.eigvalsh(twin.matrix(neighbours, (0.0, 0.0), 0.84))
    assert np.sum(np.abs(squares) < 1e-14) == 3
    with pytest.raises(MechanismError, match="gears"):
        gp.ContactLattice.of(HONEYCOMB, 0.84).sound_velocities((1.0, 0.0))


def test_matrices_at_a_wave_vector_that_is_not_finite_are_refused(hexagonal):
    for find in (hexagonal.dynamical_matrix, hexagonal.compatibility, hexagonal.modes):
        with pytest.raises(InputError, match="not finite"):
            find([[math.nan, 0.1]])
    with pytest.raises(InputError, match="not finite"):
        hexagonal.wavevectors([0.0, 0.0, math.nan])


@pytest.mark.parametrize(
    "cell", [[[1.0, 0.0], [2.0, 0.0]], [[0.0, 1.0]], [[1.0, 0.5]], np.zeros((0, 2))]
)
def test_cells_of_dependent_vectors_or_other_axes_are_refused(hexagonal, cell):
    with pytest.raises(InputError, match="cell"):
        gp.ContactLattice(cell, hexagonal.positions, hexagonal.contacts, 0.8)


@pytest.mark.parametrize(
    "branches", [[[3]], [[-1]], [[0], [1]], [0], [[0.5]], [[]], [[0], [0, 1]], "a"]
)
def test_energies_of_branches_that_there_are_not_are_refused(hexagonal, branches):
    with pytest.raises(InputError, match="branches is"):
        hexagonal.mode_energies([[0.1, 0.2]], branches)


def test_energies_at_no_wave_vector_ask_for_one(hexagonal):
    with pytest.raises(InputError, match="there is no wave vector"):
        hexagonal.mode_energies(np.zeros((0, 2)))


def test_frequencies_that_memory_does_not_hold_need_fewer_wave_vectors_alone(hexagonal):
    with pytest.raises(InputError, match=r"Take fewer wave vectors\.$"):
        hexagonal._require_memory_of_results(10**15, has_vectors=False)
    with pytest.raises(InputError, match=r"or frequencies alone\.$"):
        hexagonal._require_memory_of_results(10**15, has_vectors=True)


def test_motions_out_of_the_plane_lengthen_no_contact(hexagonal):
    out_of_plane = gp.ContactLattice.of("triangular", 0.8, motions=OUT_OF_PLANE)
    assert out_of_plane.elongating_blocks == []
    assert len(hexagonal.elongating_blocks) == 1


def test_buckling_is_an_error():
    # frictionless, 3/8 - 9/8 p < 0 beyond p = 1/3
    stable, unstable = (gp.ContactLattice.of("triangular", 0.0, 0.7, p) for p in (0.33, 0.34))
    assert np.all(stable.frequencies([[1e-3, 0.0]]) > 0.0)
    with pytest.raises(InstabilityError, match="negative"):
        unstable.frequencies([[1e-3, 0.0]])
    with pytest.raises(InstabilityError, match="negative"):
        unstable.sound_velocities((1, 0))
    with pytest.raises(RuntimeError):
        unstable.modes([[1e-3, 0.0]])


@pytest.mark.parametrize(
    ("eta", "spacing", "prestress"),
    [(-0.1, 1, 0), (math.nan, 1, 0), (1, 0, 0), (1, 2.0, 0), (1, 1, -1), (1, 1, math.inf)],
)
def test_lattices_that_cannot_be(eta, spacing, prestress):
    with pytest.raises(InputError):
        gp.ContactLattice.of("triangular", eta, spacing, prestress)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gyration", 0.0),
        ("gyration", -0.3),
        ("masses", math.inf),
        ("masses", 0.0),
        ("stiffness", math.inf),
        ("prestress", math.nan),
    ],
)
def test_numbers_out_of_range_are_named(name, value):
    lattice = gp.ContactLattice.of("triangular", 0.5)
    of_cell = (lattice.cell, lattice.positions, lattice.contacts)
    with pytest.raises(InputError, match=name):
        gp.ContactLattice(*of_cell, 0.5, **{name: value})


def test_springs_are_a_copy_that_nothing_changes():
    lattice = gp.ContactLattice.of("triangular", 0.5)
    springs = np.ones((1, 3))
    held = gp.ContactLattice(
        lattice.cell, lattice.positions, lattice.contacts, 0.5, on_site=springs
    )
    springs[:] = 7.0
    assert np.all(held.on_site == 1.0)
    assert not held.on_site.flags.writeable


@pytest.mark.parametrize(
    "on_site", [np.ones(3), np.ones((1, 2)), np.ones((9, 3)), -np.ones((1, 3))]
)
def test_springs_of_another_shape_or_below_zero_are_refused(on_site):
    lattice = gp.ContactLattice.of("triangular", 0.5)
    of_cell = (lattice.cell, lattice.positions, lattice.contacts)
    with pytest.raises(InputError, match="on_site"):
        gp.ContactLattice(*of_cell, 0.5, on_site=on_site)
    with pytest.raises(InputError, match="contacts"):
        gp.ContactLattice(lattice.cell, lattice.positions, None, 0.5)


@pytest.mark.parametrize(
    ("cell", "positions"),
    [([1.0, 0.0], [[0.0, 0.0]]), (np.eye(2), [[0.0]]), (np.eye(3)[:, :2], [[0.0, 0.0]])],
)
def test_cells_and_positions_of_other_shapes_are_refused(cell, positions):
    contacts = gp.ContactLattice.of("triangular", 0.5).contacts
    with pytest.raises(InputError, match="shape"):
        gp.ContactLattice(cell, positions, contacts, 0.5)


def test_contacts_of_another_lattice_are_refused(hexagonal):
    contacts = hexagonal.contacts
    tilted_cell = np.pad(hexagonal.cell, ((0, 0), (0, 1)))
    for cell, positions, problem in (
        ([[1.0, 0.0]], hexagonal.positions, "shifts"),
        (tilted_cell, np.zeros((1, 3)), "normals"),
        (hexagonal.cell, np.zeros((0, 2)), "does not have"),
    ):
        with pytest.raises(InputError, match=problem):
            gp.ContactLattice(cell, positions, contacts, 0.5)


def test_ratios_of_stiffnesses_may_be_lists(hexagonal):
    of_cell = (hexagonal.cell, hexagonal.positions, hexagonal.contacts)
    ratios = [0.5, 0.6, 0.7]
    q = [[0.3, 0.4]]
    from_list = gp.ContactLattice(*of_cell, ratios, torsion=ratios, bending=tuple(ratios))
    from_array = gp.ContactLattice(*of_cell, np.array(ratios), torsion=0.1, bending=0.1)
    assert_allclose(from_list.mindlin_ratio, from_array.mindlin_ratio)
    assert_allclose(from_list.bending, ratios)
    assert np.all(from_list.frequencies(q) > 0.0)
    with pytest.raises(InputError, match=r"mindlin_ratio .*\(2,\)"):
        gp.ContactLattice(*of_cell, [0.5, 0.6])


def test_balls_without_contacts_have_no_waves(hexagonal):
    rows = np.zeros(0, np.intp)
    contacts = hexagonal.contacts.take(rows, rows, rows, np.zeros((0, 2), np.intp))
    loose = gp.ContactLattice(hexagonal.cell, hexagonal.positions, contacts, 0.5)
    for find in (
        lambda: loose.frequencies([[0.1, 0.2]]),
        lambda: loose.modes([[0.1, 0.2]]),
        lambda: loose.free_branch_warnings,
        lambda: loose.compatibility([[0.1, 0.2]]),
        lambda: loose.acoustic_tensor((1.0, 0.0)),
        lambda: loose.sound_velocities((1.0, 0.0)),
        loose.elastic_tensor,
    ):
        with pytest.raises(InputError, match="no contacts"):
            find()


def test_a_lattice_with_fixed_bodies_is_no_network_of_its_balls():
    network = gp.ContactLattice.of("square", 0.8).contact_network(UNITS).repeat((2, 4))
    strip = gp.ContactLattice.from_network(network.cut(1, 2, ("clamped", "free")))
    with pytest.raises(InputError, match="do not move"):
        strip.contact_network(UNITS)
    with pytest.raises(InputError, match=r"normal_force .*\(7,\)"):
        gp.ContactLattice.of("square", 0.8).contact_network(UNITS, np.ones(7))


@pytest.mark.parametrize("name", ["stiffness", "masses", "prestress"])
def test_numbers_of_another_count_are_named(name):
    lattice = gp.ContactLattice.of("triangular", 0.5)
    of_cell = (lattice.cell, lattice.positions, lattice.contacts)
    with pytest.raises(InputError, match=rf"{name} .*\(5,\)"):
        gp.ContactLattice(*of_cell, 0.5, **{name: np.ones(5)})


# -- lattices as data ------------------------------------------------------------------------------


def test_modes_at_copies_of_gamma_are_those_at_gamma(hexagonal):
    along = (0.6, 0.8)
    home, copy = (
        hexagonal.modes([q], along)
        for q in ([0.0, 0.0], hexagonal.reciprocal[0] - hexagonal.reciprocal[1])
    )
    assert_allclose(copy.group_velocities, home.group_velocities, atol=1e-8)


@pytest.mark.parametrize("length", [1, 30])
def test_the_digits_of_a_wave_vector_count_in_reciprocal_vectors(length):
    """In a long cell reciprocal vectors are short, and digits are lost nearer to Gamma."""
    row = gp.Lattice("row", ((length,),), [(n / length,) for n in range(length)])
    chain = gp.ContactLattice.of(row, 0.0)
    with pytest.raises(PrecisionError, match="from Gamma"):
        chain.frequencies(2e15 * chain.reciprocal)
    assert chain.frequencies(1e14 * chain.reciprocal).shape == (1, length)
    for infinite in (np.inf, 1e308):
        with pytest.raises(GranphonError):
            chain.frequencies([[infinite]])
    for no_number in (np.nan, np.inf):
        with pytest.raises(InputError, match="not finite"):
            chain.wavevectors([no_number])


# -- one lattice in several cells ------------------------------------------------------------------

#: the square lattice, and the triangular one, in their own cells and in larger ones
CELLS = {
    "square": {
        "1": gp.Lattice("1", ((1, 0), (0, 1))),
        "2x1": gp.Lattice("2x1", ((2, 0), (0, 1)), ((0, 0), (0.5, 0))),
        "sqrt2": gp.Lattice("sqrt2", ((1, 1), (-1, 1)), ((0, 0), (0.5, 0.5))),
        "2x2": gp.Lattice("2x2", ((2, 0), (0, 2)), ((0, 0), (0.5, 0), (0, 0.5), (0.5, 0.5))),
    },
    "triangular": {
        "1": gp.Lattice("1", ((1, 0), (-0.5, 3**0.5 / 2))),
        "sqrt3": gp.Lattice(
            "sqrt3",
            ((1.5, 3**0.5 / 2), (-1.5, 3**0.5 / 2)),
            ((0, 0), (1 / 3, 2 / 3), (2 / 3, 1 / 3)),
        ),
        "2x2": gp.Lattice("2x2", ((2, 0), (-1, 3**0.5)), ((0, 0), (0.5, 0), (0, 0.5), (0.5, 0.5))),
    },
}
LARGER = [(lattice, cell) for lattice, cells in CELLS.items() for cell in cells if cell != "1"]


@pytest.mark.parametrize("finite", [False, True])
@pytest.mark.parametrize(("name", "cell"), LARGER)
def test_a_lattice_is_the_same_in_every_cell(steel, name, cell, finite):
    one, other = (
        gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice=CELLS[name][which])).at_overlap(
            8e-5, finite_overlap=finite
        )
        for which in ("1", cell)
    )
    tensors = gp.moduli(one).tensor, gp.moduli(other).tensor
    np.testing.assert_allclose(tensors[1], tensors[0], rtol=0.0, atol=1e-12 * tensors[0].max())
    for direction in ((1.0, 0.0), (0.6, 0.8), (1.0, 1.0)):
        here, there = (gp.sound_velocities(state, direction) for state in (one, other))
        for branch in ("longitudinal", "transverse"):
            assert getattr(there, branch) == pytest.approx(getattr(here, branch), rel=1e-12)
    if cell in ("sqrt2", "sqrt3"):
        here, there = (gp.pulse_velocities(state, 3000.0, (0.6, 0.8)) for state in (one, other))
        np.testing.assert_allclose(there.group, here.group, rtol=1e-8 if finite else 1e-11)


def test_what_decouples_in_a_larger_cell_is_no_mechanism_and_what_couples_is():
    gears = CELLS["square"]["sqrt2"]
    assert np.sum(gp.ContactLattice.of(gears, 0.84).frequencies([[0.0, 0.0]]) < 1e-14) == 3
    for cell in CELLS["square"].values():
        with pytest.raises(MechanismError, match=r"\(0, 0, 1\)"):
            gp.ContactLattice.of(cell, 0.0).require_rigid()
    double = ((2 * 3**0.5, 0.0), (-(3**0.5) / 2, 1.5))
    honeycomb = gp.Lattice(
        "double", double, ((1 / 6, 2 / 3), (2 / 3, 2 / 3), (1 / 3, 1 / 3), (5 / 6, 1 / 3))
    )
    with pytest.raises(MechanismError, match="gears"):
        gp.ContactLattice.of(honeycomb, 0.84).require_rigid()


@pytest.mark.claim("bands-and-group-velocities")
def test_bands_at_forty_digits(twin):
    rng = np.random.default_rng(0)
    lattice = gp.ContactLattice.of("triangular", ETA)
    with mpmath.workdps(40):
        for q in rng.uniform(-7, 7, (20, 2)):
            exact = twin.exact_squares(
                twin.exact_hexagon(), [mpmath.mpf(x) for x in q], mpmath.mpf(ETA)
            )
            for value, square in zip(lattice.frequencies([q])[0], exact, strict=True):
                assert abs(value / mpmath.sqrt(square) - 1) < 3e-15


def test_square_without_friction_shears_at_no_cost():
    with pytest.raises(MechanismError, match=r"square .*2xy\) = \(0, 0, 1\)"):
        gp.ContactLattice.of("square", 0.0).require_rigid()


def test_mechanism_is_an_error_of_the_observables(steel):
    loose = gp.Packing(steel, 8e-3, lattice="square", friction=False)
    with pytest.raises(MechanismError):
        gp.sound_velocities(gp.AveragedLattice(loose).at_force(1.0), direction=(1, 0))


def test_two_ball_supercell_folds_velocities_and_prestress():
    pair = gp.Lattice("pairs", ((2.0, 0.0), HEXAGON[1]), ((0.0, 0.0), (0.5, 0.0)))
    q = np.array([0.83, 0.41])
    for terms in ((1.0, 0.0), (0.95, 0.02)):
        one, two = (
            gp.ContactLattice.of("triangular", ETA, *terms),
            gp.ContactLattice.of(pair, ETA, *terms),
        )
        singles = one.modes([q, q + two.reciprocal[0]])
        order = np.argsort(singles.frequencies.ravel())
        modes = two.modes([q])
        assert_allclose(modes.frequencies[0], singles.frequencies.ravel()[order], rtol=1e-13)
        assert_allclose(
            modes.group_velocities[0], singles.group_velocities.reshape(-1, 2)[order], atol=1e-12
        )
        assert_allclose(
            modes.rotational_fraction[0], singles.rotational_fraction.ravel()[order], atol=1e-12
        )
        assert_allclose(two.gradient_stiffness() / 2, one.gradient_stiffness(), atol=1e-13)


@pytest.mark.parametrize("name", ["masses", "shift", "no_field"])
def test_a_network_of_a_lattice_takes_further_fields_only(name):
    lattice = gp.ContactLattice.of("square", 0.8)
    units = gp.Units(8e-3, 1e6, 2e-3)
    assert lattice.contact_network(units, left_out=2).left_out == 2
    with pytest.raises(InputError, match=name):
        lattice.contact_network(units, **{name: 1.0})
