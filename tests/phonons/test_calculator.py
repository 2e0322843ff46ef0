"""HertzMindlin: energy, forces, stress, torques and force constants of one-sided contacts.

Energies and their slopes are compared with a twin in ``test_crystal_atoms.py``. Here derivatives are checked by central
differences, whose second order is itself asserted.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from ase import Atoms
from ase.build import make_supercell
from ase.calculators.calculator import PropertyNotImplementedError
from ase.calculators.fd import calculate_numerical_forces, calculate_numerical_stress
from ase.optimize import BFGS
from hypothesis import given, settings
from hypothesis import strategies as st

import granphon as gp
import granphon.phonons.contacts
from granphon.base.errors import InputError, PrecisionError

DIAMETER = 8e-3
STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ETA = 2.0 * (1.0 - 0.276) / (2.0 - 0.276)
GYRATION = 1.0 / np.sqrt(10.0)
#: a soft state, so that steps of a finite difference are small against the overlap and large against rounding
SOFT = 0.02


def at_overlap(relative=SOFT, friction=True, lattice="triangular", finite_overlap=None):
    packing = gp.Packing(STEEL, DIAMETER, lattice=lattice, friction=friction)
    return gp.AveragedLattice(packing).at_overlap(relative * DIAMETER, finite_overlap=finite_overlap)


def reference_cells():
    """Name -> (lattice, function from one cell to the cell under test)."""

    def repeat(*n):
        return lambda one: one.repeat((*n, 1))

    def skewed(one):
        return make_supercell(one, [[2, 1, 0], [-1, 3, 0], [0, 0, 1]])

    def vacancy(one):
        balls = one.repeat((3, 3, 1))
        del balls[4]
        return balls

    def cluster(one):
        balls = one.repeat((3, 3, 1))
        balls.pbc = False
        return balls

    def ribbon(one):
        balls = one.repeat((3, 3, 1))
        balls.pbc = (True, False, False)
        return balls

    return {
        "2x2": ("triangular", repeat(2, 2)),
        "3x3": ("triangular", repeat(3, 3)),
        "3x5": ("triangular", repeat(3, 5)),
        "skewed": ("triangular", skewed),
        "vacancy": ("triangular", vacancy),
        "cluster": ("triangular", cluster),
        "ribbon": ("triangular", ribbon),
        "square 3x3": ("square", repeat(3, 3)),
        "kagome 2x2": ("kagome", repeat(2, 2)),
    }


CELLS = reference_cells()
every_cell = pytest.mark.parametrize("name", CELLS)
both_overlaps = pytest.mark.parametrize("finite_overlap", [False, True], ids=["limit", "finite"])
both_frictions = pytest.mark.parametrize("friction", [False, True], ids=["smooth", "rough"])


def make(name, friction=True, finite_overlap=False, relative=SOFT):
    lattice, build = CELLS[name]
    state = at_overlap(relative, friction, lattice, finite_overlap)
    balls = build(gp.atoms(state))
    return state, balls, gp.HertzMindlin(state)


def shaken(balls, seed=0, amplitude=2e-3, deviations=True):
    """A generic configuration with every contact that was closed still closed."""
    rng = np.random.default_rng(seed)
    out = balls.copy()
    out.positions[:, :2] += amplitude * rng.uniform(-1, 1, (len(balls), 2))
    out.set_array("rotations", amplitude * rng.uniform(-1, 1, len(balls)))
    if deviations:
        out.set_array("diameter_deviations", amplitude * rng.uniform(-1, 1, len(balls)))
    return out


def gyrations(balls):
    return GYRATION * (1.0 + balls.arrays["diameter_deviations"])


def moved(balls, ball, axis, step):
    """The balls with one coordinate (x, y, w) displaced by ``step``."""
    out = balls.copy()
    if axis < 2:
        out.positions[ball, axis] += step
    else:
        out.arrays["rotations"][ball] += step / gyrations(balls)[ball]
    return out


def differenced_force_constants(calc, balls, step, chosen=None):
    """Minus the central differences of forces and torques, (N, N, 3, 3), or (N, n, 3, 3) of ``chosen`` balls."""
    n, radius = len(balls), gyrations(balls)
    out = np.zeros((n, n, 3, 3))
    for ball, axis in itertools.product(range(n) if chosen is None else chosen, range(3)):
        sides = []
        for sign in (1.0, -1.0):
            other = moved(balls, ball, axis, sign * step)
            pull = calc.get_property("forces", other)[:, :2]
            sides.append(np.column_stack([pull, calc.get_torques(other) / radius]))
        out[:, ball, :, axis] = -(sides[0] - sides[1]) / (2.0 * step)
    return out if chosen is None else out[:, chosen]


def check_force_constants(calc, balls, atol, steps=(SOFT / 40.0, SOFT / 80.0), rel=None):
    """Compare force constants with central differences (Richardson), whose order two is asserted to ``rel``; return them."""
    exact = calc.get_force_constants(balls)
    coarse, fine = (differenced_force_constants(calc, balls, step) for step in steps)
    np.testing.assert_allclose((4.0 * fine - coarse) / 3.0, exact, atol=atol)
    if rel is not None:
        wide, narrow = np.abs(coarse - exact).max(), np.abs(fine - exact).max()
        assert wide / narrow == pytest.approx(4.0, rel=rel), "the central difference is of second order"
    return exact


def displaced(balls, amplitude, seed):
    """Displace balls from their sites, in place."""
    shift = np.zeros((len(balls), 3))
    shift[:, :2] = amplitude * SOFT * np.random.default_rng(seed).uniform(-1, 1, (len(balls), 2))
    balls.positions += shift
    balls.set_array("displacements", shift)


# -- energy, forces, torques, stress ------------------------------------------------------------------------------------


@both_overlaps
def test_energy_of_a_cell_is_extensive_and_known(finite_overlap):
    # three contacts a ball, each (4/15) delta^2 in units of k d^2
    state = at_overlap(finite_overlap=finite_overlap)
    one = gp.atoms(state)
    assert one.get_potential_energy() == pytest.approx(3.0 * 4.0 / 15.0 * SOFT**2, rel=1e-12)
    many = one.repeat((4, 3, 1))
    many.calc = gp.HertzMindlin(state)
    assert many.get_potential_energy() == pytest.approx(12.0 * one.get_potential_energy(), rel=1e-12)
    np.testing.assert_allclose(many.get_forces(), 0.0, atol=1e-14)


@pytest.mark.parametrize("name", ["3x3", "skewed", "vacancy", "kagome 2x2"])
@both_frictions
@both_overlaps
def test_ase_numerical_forces_and_stress(name, friction, finite_overlap):
    _, balls, calc = make(name, friction, finite_overlap)
    balls.set_cell(np.asarray(balls.cell) @ [[0.998, 0.003, 0], [-0.001, 1.002, 0], [0, 0, 1]], scale_atoms=True)
    balls = shaken(balls, seed=4)
    balls.calc = calc
    np.testing.assert_allclose(balls.get_forces(), calculate_numerical_forces(balls, eps=1e-5), atol=1e-8)
    numerical = calculate_numerical_stress(balls, eps=1e-6)
    # the cell is one diameter thick, so that ASE's volume is the layer's
    np.testing.assert_allclose(balls.get_stress(), numerical, atol=1e-8)
    assert np.abs(balls.get_stress()[[0, 1, 5]]).min() > 1e-4


@pytest.mark.parametrize("name", CELLS)
@both_overlaps
def test_newton_and_the_balance_of_torques(name, finite_overlap):
    _state, balls, calc = make(name, True, finite_overlap)
    balls = shaken(balls, seed=5, deviations=False)
    forces, torques = calc.get_property("forces", balls), calc.get_torques(balls)
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-15)
    # a slip force acts at arm a/2 from each centre: both ends are turned alike, so torques do not sum to zero
    assert abs(torques.sum()) > 1e-5


@both_overlaps
def test_free_cluster_in_equilibrium_of_torques(finite_overlap):
    # balls turned on their reference sites: spin torques and the moment of the forces cancel
    _state, balls, calc = make("cluster", True, finite_overlap)
    balls.arrays["rotations"][:] = np.linspace(-1e-3, 2e-3, len(balls))
    forces, torques = calc.get_property("forces", balls), calc.get_torques(balls)
    x, y = balls.positions[:, 0], balls.positions[:, 1]
    moment = x * forces[:, 1] - y * forces[:, 0]
    assert np.abs(torques).max() > 1e-4
    assert torques.sum() + moment.sum() == pytest.approx(0.0, abs=1e-16)


def test_frictionless_cluster_turns_freely():
    # with finite overlap the energy is exact, so a turn by any angle costs nothing
    _, balls, calc = make("cluster", False, True)
    before = calc.get_property("energy", balls)
    balls.rotate(17.0, "z", rotate_cell=True)
    assert calc.get_property("energy", balls) == pytest.approx(before, rel=1e-13)


@pytest.mark.parametrize("relative", [1e-9, 1e-6, 1e-4, 1e-2])
@both_overlaps
def test_stress_is_the_pressure(relative, finite_overlap):
    state = at_overlap(relative, finite_overlap=finite_overlap)
    balls = gp.atoms(state)
    pascal = -balls.get_stress() * balls.calc.scales.modulus
    boundary = DIAMETER * (1.0 - relative) if finite_overlap else DIAMETER
    expected = np.sqrt(3.0) * state.force / boundary / DIAMETER
    # positions hold 1e-16/relative of the overlap
    tolerance = 1e-14 + 1e-15 / relative
    np.testing.assert_allclose(pascal[:2], expected, rtol=tolerance)
    np.testing.assert_allclose(pascal[2:], 0.0, atol=1e-14 * expected + tolerance * expected)
    if not finite_overlap:
        np.testing.assert_allclose(pascal[0], state.pressure / DIAMETER, rtol=tolerance)


@pytest.mark.parametrize(("lattice", "factor"), [("square", 1.0), ("kagome", np.sqrt(3.0) / 2.0)])
def test_stress_on_other_lattices(lattice, factor):
    state = at_overlap(1e-3, lattice=lattice)
    balls = gp.atoms(state)
    pascal = -balls.get_stress()[:2] * balls.calc.scales.modulus
    np.testing.assert_allclose(pascal, factor * state.force / DIAMETER**2, rtol=1e-12)
    assert state.pressure == pytest.approx(factor * state.force / DIAMETER, rel=1e-14)


def test_stress_of_a_layer_does_not_depend_on_the_height_of_the_cell():
    state = at_overlap()
    balls = gp.atoms(state)
    thin = balls.get_stress()
    balls.cell[2, 2] = 7.0
    np.testing.assert_array_equal(balls.get_stress(), thin)


# -- one-sided contacts -------------------------------------------------------------------------------------------------


@both_frictions
@both_overlaps
def test_separated_balls_exert_nothing(friction, finite_overlap):
    state = at_overlap(friction=friction, finite_overlap=finite_overlap)
    one = gp.atoms(state)
    balls = one.repeat((2, 1, 1))
    balls.pbc = False
    gap = 1e-9
    balls.positions[1, 0] = 1.0 + SOFT + gap if not finite_overlap else 1.0 + gap
    balls.set_array("rotations", np.array([0.1, 0.2]))
    balls.calc = gp.HertzMindlin(state)
    assert balls.get_potential_energy() == 0.0
    np.testing.assert_array_equal(balls.get_forces(), 0.0)
    np.testing.assert_array_equal(balls.get_stress(), 0.0)
    np.testing.assert_array_equal(balls.calc.get_torques(balls), 0.0)
    # pressed by as little as the gap they do
    balls.positions[1, 0] -= 2.0 * gap
    assert balls.get_potential_energy() > 0.0
    assert balls.get_forces()[1, 0] > 0.0


@both_frictions
def test_an_open_contact_has_no_force_constants(friction):
    # the ball is half the size it needs to touch anything: the state says so, whatever the positions are
    _state, balls, calc = make("3x3", friction)
    balls.arrays["diameter_deviations"][4] = -2.5 * SOFT
    constants = calc.get_force_constants(balls)
    np.testing.assert_array_equal(constants[4], 0.0)
    np.testing.assert_array_equal(constants[:, 4], 0.0)
    assert np.abs(constants[0]).max() > 1.0


def test_a_ball_displaced_out_of_reach_has_no_force_constants_there():
    _state, balls, calc = make("3x3")
    balls.positions[4, 0] += 1.5 * SOFT
    balls.arrays["displacements"][4, 0] = 1.5 * SOFT
    constants = calc.get_force_constants(balls)
    # ball 4 of the 3 x 3 cell touches 1 (behind, along -a1) no more, and 7 (ahead) all the closer
    np.testing.assert_array_equal(constants[4, 1], 0.0)
    assert constants[4, 7][0, 0] == pytest.approx(-np.sqrt(2.5), rel=1e-12)


@given(
    seed=st.integers(0, 2**32 - 1),
    amplitude=st.floats(1e-6, 0.1),
    friction=st.booleans(),
    finite_overlap=st.booleans(),
)
@settings(max_examples=40, deadline=None)
def test_forces_only_push(seed, amplitude, friction, finite_overlap):
    # whatever the configuration, energy is not negative, and without friction every pair repels
    _state, balls, calc = make("cluster", friction, finite_overlap)
    if friction or not finite_overlap:
        amplitude = min(amplitude, 0.01)  # beyond it a pair is turned too far for contacts of fixed direction
    pair = shaken(balls, seed, amplitude)[[0, 3]]
    energy, forces = calc.get_property("energy", pair), calc.get_property("forces", pair)
    assert energy >= 0.0
    np.testing.assert_allclose(forces[0], -forces[1], atol=1e-18)
    if not friction:
        assert forces[1] @ (pair.positions[1] - pair.positions[0]) >= 0.0


# -- force constants ----------------------------------------------------------------------------------------------------


@pytest.mark.claim("forces-are-slopes")
@every_cell
@both_frictions
@both_overlaps
def test_force_constants_are_second_differences_of_order_two(name, friction, finite_overlap):
    _, balls, calc = make(name, friction, finite_overlap)
    exact = check_force_constants(calc, balls, 1e-5, (SOFT / 20.0, SOFT / 40.0), rel=0.01)
    np.testing.assert_allclose(exact, exact.transpose(1, 0, 3, 2), atol=1e-15)


@both_overlaps
def test_one_ball_cell(finite_overlap):
    # all images move together: translations cost nothing, and the rotation 30 eta k/M (a/d)^2
    state = at_overlap(finite_overlap=finite_overlap)
    balls = gp.atoms(state)
    constants = balls.calc.get_force_constants(balls)
    arm = 1.0 - SOFT if finite_overlap else 1.0
    expected = np.zeros((1, 1, 3, 3))
    expected[0, 0, 2, 2] = 30.0 * ETA * arm**2
    np.testing.assert_allclose(constants, expected, atol=1e-13)
    np.testing.assert_allclose(differenced_force_constants(balls.calc, balls, 1e-4), expected, atol=1e-9)


def test_contacts_of_a_small_cell_add():
    # 2 x 2: each pair touches through two images, whose contacts add up to those of a larger cell folded on it
    _, small, calc = make("2x2")
    large = small.repeat((2, 2, 1))
    fine = calc.get_force_constants(large)
    folded = fine[:4].reshape(4, 4, 4, 3, 3).sum(axis=1)
    np.testing.assert_allclose(calc.get_force_constants(small), folded, atol=1e-14)


@both_overlaps
@both_frictions
@pytest.mark.parametrize("name", ["3x3", "vacancy", "kagome 2x2", "square 3x3"])
def test_balls_of_unequal_diameter(name, friction, finite_overlap):
    # the slip of each contact costs eta times that contact's own stiffness, and w = R_g phi with each ball's own R_g
    _, balls, calc = make(name, friction, finite_overlap)
    balls.arrays["diameter_deviations"][:] = 0.2 * SOFT * np.random.default_rng(7).uniform(-1, 1, len(balls))
    exact = check_force_constants(calc, balls, 1e-6)
    assert np.ptp(np.diagonal(exact[:, :, 0, 0])) > 1e-3


@both_frictions
def test_displacements_are_part_of_the_state(friction):
    # in the paper's limit n is fixed, and the harmonic expansion about displaced balls is exact too
    _, balls, calc = make("3x3", friction)
    displaced(balls, 0.1, 8)
    exact = check_force_constants(calc, balls, 1e-6)
    # and positions alone do not enter: moved back without a word, the balls have the same force constants
    elsewhere = balls.copy()
    elsewhere.positions += [0.1, 0.2, 0.0]
    np.testing.assert_allclose(calc.get_force_constants(elsewhere), exact, atol=1e-12)


@every_cell
@both_frictions
@both_overlaps
def test_dense_equals_sparse(name, friction, finite_overlap):
    _, balls, calc = make(name, friction, finite_overlap)
    dense, sparse = calc.get_force_constants(balls), calc.get_force_constants(balls, format="csr")
    n = len(balls)
    assert dense.shape == (n, n, 3, 3)
    assert (sparse.format, sparse.shape) == ("csr", (3 * n, 3 * n))
    assert sparse.has_canonical_format
    np.testing.assert_allclose(dense.transpose(0, 2, 1, 3).reshape(3 * n, 3 * n), sparse.toarray(), atol=1e-15)


def test_force_constants_scale_with_the_contacts():
    # 3 contacts a ball at most: a sparse matrix of 21 numbers in each row, whatever the size
    state = at_overlap()
    balls = gp.atoms(state).repeat((40, 40, 1))
    sparse = gp.HertzMindlin(state).get_force_constants(balls, format="csr")
    assert np.diff(sparse.indptr).max() <= 21


@every_cell
@both_frictions
@both_overlaps
def test_sum_rule_of_translations_and_not_of_rotation(name, friction, finite_overlap):
    _, balls, calc = make(name, friction, finite_overlap)
    total = calc.get_force_constants(balls).sum(axis=1)
    np.testing.assert_allclose(total[:, :, :2], 0.0, atol=1e-14)
    if friction:
        arm = 1.0 - SOFT if finite_overlap else 1.0
        lattice = CELLS[name][0]
        if name not in ("vacancy", "cluster", "ribbon"):
            # each of z contacts has the lever (a/2 + a/2)/R_g on one of its ends: 5 eta z
            coordination = {"triangular": 6, "square": 4, "kagome": 4}[lattice]
            np.testing.assert_allclose(total[:, 2, 2], 5.0 * ETA * coordination * arm**2, rtol=1e-13)
        assert np.all(total[:, 2, 2] > 5.0 * ETA * arm**2)
    else:
        np.testing.assert_array_equal(total[:, 2], 0.0)


def test_a_cluster_turns_as_a_whole_at_no_cost():
    _, balls, calc = make("cluster")
    matrix = calc.get_force_constants(balls).transpose(0, 2, 1, 3).reshape(27, 27)
    turn = np.zeros((9, 3))
    turn[:, 0], turn[:, 1], turn[:, 2] = -balls.positions[:, 1], balls.positions[:, 0], GYRATION
    np.testing.assert_allclose(matrix @ turn.ravel(), 0.0, atol=1e-13)
    # three free motions of the whole, and no more
    values = np.linalg.eigvalsh(matrix)
    np.testing.assert_allclose(values[:3], 0.0, atol=1e-13)
    assert values[3] > 0.01
    # balls that are carried round without turning do pay: eta of half a slip of one at each of the 16 contacts
    turn[:, 2] = 0.0
    assert turn.ravel() @ matrix @ turn.ravel() == pytest.approx(16.0 * ETA, rel=1e-12)


def test_masses_do_not_enter_force_constants_and_do_enter_the_lattice():
    _, balls, calc = make("3x3")
    equal = calc.get_force_constants(balls)
    masses = np.linspace(0.5, 3.0, 9)
    balls.set_masses(masses)
    np.testing.assert_array_equal(calc.get_force_constants(balls), equal)
    lattice = calc.contact_lattice(balls)
    np.testing.assert_array_equal(lattice.masses, masses)
    root = np.sqrt(np.repeat(masses, 3))
    matrix = equal.transpose(0, 2, 1, 3).reshape(27, 27) / np.outer(root, root)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(lattice.dynamical_matrix([[0.0, 0.0]])[0]), np.linalg.eigvalsh(matrix), atol=1e-13
    )


@both_overlaps
def test_frictionless_rows_of_rotation_are_zero(finite_overlap):
    _, balls, calc = make("3x3", False, finite_overlap)
    constants = calc.get_force_constants(balls)
    np.testing.assert_array_equal(constants[..., 2, :], 0.0)
    np.testing.assert_array_equal(constants[..., :, 2], 0.0)


def test_one_contact_in_closed_form():
    # two balls along x: k, eta k, and the lever R_g^-1/2 = sqrt(10)/2 of each
    state = at_overlap()
    balls = gp.atoms(state).repeat((2, 1, 1))
    balls.pbc = False
    lever = np.sqrt(10.0) / 2.0
    expected = np.array([[1.0, 0.0, 0.0], [0.0, ETA, ETA * lever], [0.0, ETA * lever, ETA * lever**2]])
    off = np.array([[-1.0, 0.0, 0.0], [0.0, -ETA, ETA * lever], [0.0, -ETA * lever, ETA * lever**2]])
    constants = gp.HertzMindlin(state).get_force_constants(balls)
    np.testing.assert_allclose(constants[0, 0], expected, rtol=1e-14)
    np.testing.assert_allclose(constants[0, 1], off, rtol=1e-14)
    # with finite overlap: arms a/2 and -f/a across, f/k d = 2 delta/3 d
    spacing = 1.0 - SOFT
    state = at_overlap(finite_overlap=True)
    squeezed = gp.atoms(state).repeat((2, 1, 1))
    squeezed.pbc = False
    expected = expected * np.array([[1, 1, 1], [1, 1, spacing], [1, spacing, spacing**2]])
    expected[1, 1] -= 2.0 / 3.0 * SOFT / spacing
    constants = gp.HertzMindlin(state).get_force_constants(squeezed)
    np.testing.assert_allclose(constants[0, 0], expected, rtol=1e-13)


# -- precision ----------------------------------------------------------------------------------------------------------


@pytest.mark.claim("api-positions")
@pytest.mark.parametrize("relative", [1e-20, 9e-11])
@both_overlaps
def test_below_precision_only_what_needs_positions_raises(relative, finite_overlap):
    state = at_overlap(relative, finite_overlap=finite_overlap)
    balls = gp.atoms(state)
    for ask in (
        balls.get_potential_energy,
        balls.get_forces,
        balls.get_stress,
        lambda: balls.calc.get_torques(balls),
    ):
        with pytest.raises(PrecisionError, match="positions hold too few digits"):
            ask()
    many = balls.repeat((3, 3, 1))
    plain = at_overlap(1e-2)
    reference = gp.HertzMindlin(plain).get_force_constants(gp.atoms(plain).repeat((3, 3, 1)))
    given_constants = balls.calc.get_force_constants(many)
    if finite_overlap:
        np.testing.assert_allclose(given_constants, reference, atol=30.0 * relative + 1e-15)
    else:
        np.testing.assert_array_equal(given_constants, reference)


@pytest.mark.claim("api-positions")
def test_just_above_precision_energy_has_the_digits_promised():
    state = at_overlap(1e-10)
    balls = gp.atoms(state).repeat((3, 3, 1))
    balls.calc = gp.HertzMindlin(state)
    # six digits of the overlap: 2.5e-6 of the energy
    assert balls.get_potential_energy() == pytest.approx(27.0 * 4.0 / 15.0 * 1e-20, rel=1e-5)


# -- ASE's conventions --------------------------------------------------------------------------------------------------


class Counting(gp.HertzMindlin):
    """HertzMindlin that counts its calculations."""

    count = 0

    def calculate(self, *args, **kwargs):
        self.count += 1
        super().calculate(*args, **kwargs)


def counted():
    state = at_overlap()
    balls = gp.atoms(state).repeat((3, 3, 1))
    balls.calc = Counting(state)
    return balls


def test_one_calculation_serves_every_property():
    balls = counted()
    balls.get_potential_energy()
    balls.get_forces()
    balls.get_stress()
    balls.calc.get_torques(balls)
    balls.get_potential_energy(force_consistent=True)
    assert balls.calc.count == 1
    assert balls.calc.get_property("energy", balls) == balls.get_potential_energy()
    # a copy of the Atoms is the same configuration
    balls.calc.get_property("forces", balls.copy())
    assert balls.calc.count == 1


def _set(name, value):
    def change(balls):
        balls.arrays[name][2] = value

    return change


CHANGES = {
    "a position": lambda balls: balls.positions.__setitem__((2, 0), balls.positions[2, 0] + 1e-3),
    "the cell": lambda balls: balls.set_cell(np.asarray(balls.cell) * 1.001, scale_atoms=True),
    "pbc": lambda balls: balls.set_pbc(False),
    "a diameter": _set("diameter_deviations", 1e-3),
    "a rotation": _set("rotations", 1e-3),
    "an origin of slip": lambda balls: balls.arrays["slip_origin"].__setitem__((2, 0), 1e-3),
    "a displacement": lambda balls: balls.arrays["displacements"].__setitem__((2, 0), 1e-3),
    "new rotations": lambda balls: balls.set_array("rotations", np.full(len(balls), 1e-3)),
    "fewer balls": lambda balls: balls.__delitem__(4),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_changes_the_energy_is_noticed(change):
    balls = counted()
    # slip, so that the shear stiffness of every contact counts
    balls.positions[:, 0] += 1e-3 * np.arange(9)
    before = balls.get_potential_energy()
    CHANGES[change](balls)
    assert balls.calc.calculation_required(balls, ["energy"])
    after = balls.get_potential_energy()
    assert after != before
    assert balls.calc.count == 2
    fresh = balls.copy()
    fresh.calc = gp.HertzMindlin(balls.calc.state)
    assert fresh.get_potential_energy() == after
    balls.get_forces()
    assert balls.calc.count == 2


def test_what_does_not_change_the_energy_is_not():
    balls = counted()
    balls.get_potential_energy()
    balls.arrays["radius"][:] = 3.0
    balls.set_masses(np.full(9, 2.0))
    balls.set_momenta(np.ones((9, 3)))
    balls.info["note"] = 1
    balls.get_potential_energy()
    assert balls.calc.count == 1


@pytest.mark.parametrize("name", ["masses", "diameter_deviations", "rotations", "displacements", "slip_origin"])
def test_what_is_absent_is_not_zero(name):
    balls = counted()
    energy = balls.get_potential_energy()
    balls.set_array(name, None)
    for ask in (balls.get_potential_energy, lambda: balls.calc.get_force_constants(balls)):
        with pytest.raises(InputError, match=rf"have no {name}\..*adopt\(atoms\)"):
            ask()
    assert balls.calc.adopt(balls).get_potential_energy() == energy
    # the size that is drawn is not that of the contacts
    balls = counted()
    balls.set_array("radius", None)
    assert balls.get_potential_energy() == energy


@pytest.mark.parametrize("name", ["diameter_deviations", "displacements", "granphon_scales"])
def test_an_array_of_another_shape_is_refused(name):
    balls = counted()
    values = balls.arrays[name]
    balls.set_array(name, None)
    balls.set_array(name, np.zeros((9, 2)))
    with pytest.raises(InputError, match=rf"array {name} has the shape \(9, 2\)"):
        balls.get_potential_energy()
    balls.set_array(name, None)
    balls.set_array(name, values)
    assert balls.get_potential_energy() > 0.0


def test_torques_follow_the_atoms_they_are_asked_for():
    balls = counted()
    balls.arrays["rotations"][0] = 1e-3
    first = balls.calc.get_torques(balls)
    assert np.abs(first).max() > 0.0
    still = balls.copy()
    still.arrays["rotations"][0] = 0.0
    np.testing.assert_allclose(balls.calc.get_torques(still), 0.0, atol=1e-17)
    np.testing.assert_array_equal(balls.calc.get_torques(balls), first)
    first[:] = 99.0
    assert balls.calc.get_torques(balls).max() < 1.0, "a copy is handed out"


def test_results_are_ase_properties():
    balls = counted()
    balls.get_potential_energy()
    properties = balls.calc.export_properties()
    assert set(properties) == {"energy", "free_energy", "natoms", "forces", "stress"}
    assert properties["stress"].shape == (6,)
    assert properties["forces"].shape == (9, 3)
    assert set(balls.calc.implemented_properties) == {"energy", "free_energy", "forces", "stress"}
    for missing in ("stresses", "energies", "magmom", "dipole"):
        with pytest.raises(PropertyNotImplementedError):
            balls.calc.get_property(missing, balls)
    assert balls.calc.get_property("energy", counted(), allow_calculation=False) is not None
    balls.calc.reset()
    assert balls.calc.get_property("energy", balls, allow_calculation=False) is None


def test_unknown_keywords_and_formats_are_refused():
    state = at_overlap()
    with pytest.raises(InputError, match=r"no keyword 'finite_overlp'"):
        gp.HertzMindlin(state, finite_overlp=True)
    with pytest.raises(InputError, match=r"no keyword 'label'"):
        gp.HertzMindlin(state).set(label="x")
    with pytest.raises(InputError, match="format is 'coo'"):
        gp.HertzMindlin(state).get_force_constants(gp.atoms(state), format="coo")


def test_state_at_several_loads_is_refused():
    several = gp.AveragedLattice(gp.Packing(STEEL, DIAMETER)).at_force([1.0, 2.0])
    for make_one in (gp.HertzMindlin, gp.atoms, gp.Phonons):
        with pytest.raises(InputError, match="the state holds 2 loads"):
            make_one(several)


def test_balls_periodic_across_the_plane_are_refused():
    balls = counted()
    balls.pbc = True
    for ask in (balls.calc.get_potential_energy, balls.calc.get_force_constants):
        with pytest.raises(InputError, match="periodic across the plane"):
            ask(balls)


def test_only_stress_needs_a_cell():
    pair = gp.HertzMindlin(at_overlap()).adopt(Atoms("Fe2", positions=[[0, 0, 0], [1, 0, 0]]))
    with pytest.raises(InputError, match="the cell has no area"):
        pair.get_stress()
    assert pair.calc.get_force_constants(pair)[0, 1, 0, 0] == -1.0
    assert pair.get_potential_energy() == pytest.approx(4.0 / 15.0 * SOFT**2, rel=1e-12)
    assert pair.get_forces()[1, 0] == pytest.approx(2.0 / 3.0 * SOFT, rel=1e-12)


@both_overlaps
@both_frictions
def test_a_cell_without_a_third_vector_is_one_of_any_height(friction, finite_overlap):
    # as ASE's reader of netCDF leaves it
    _, balls, calc = make("3x3", friction, finite_overlap)
    balls = shaken(balls, seed=11)
    flat = balls.copy()
    flat.cell[2] = 0.0
    for name in ("energy", "forces", "stress"):
        np.testing.assert_array_equal(calc.get_property(name, flat), calc.get_property(name, balls))
    np.testing.assert_array_equal(calc.get_force_constants(flat), calc.get_force_constants(balls))
    state, q = calc.state, [[0.1, 0.2]]
    padded, lying = (gp.Phonons(state, one) for one in (balls, flat))
    np.testing.assert_array_equal(lying.frequencies(q), padded.frequencies(q))
    assert lying.bands(npoints=3).frequencies.shape == (3, 3, 9 * (3 if friction else 2))


# -- a lattice that is turned -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [30.0, 10.0, -5.0])
@pytest.mark.parametrize(("friction", "finite_overlap"), [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize("name", ["3x3", "cluster", "kagome 2x2"])
def test_contacts_of_fixed_direction_are_not_turned(name, angle, friction, finite_overlap):
    # at 30 degrees no pair would be a contact, and the energy zero; at 10 all would be, with overlaps of 1 - cos 10
    state, balls, calc = make(name, friction, finite_overlap)
    balls.rotate(angle, "z", rotate_cell=True)
    for ask in (calc.get_potential_energy, calc.get_force_constants, lambda turned: gp.Phonons(state, turned)):
        with pytest.raises(InputError, match="turned against the lattice"):
            ask(balls)


def test_balls_moved_among_each_other_are_refused():
    # a ball in the hollow between others touches them in directions that are no contact's
    _, balls, calc = make("3x3")
    balls.positions[4, :2] += [0.0, -np.sqrt(1.0 / 3.0)]
    with pytest.raises(InputError, match="not those of the lattice"):
        calc.get_property("energy", balls)


@pytest.mark.parametrize("angle", [30.0, 10.0, 211.0])
@pytest.mark.parametrize("name", ["3x3", "vacancy", "kagome 2x2"])
def test_smooth_balls_of_finite_overlap_turn_with_their_lattice(name, angle):
    state, balls, calc = make(name, False, True)
    balls = shaken(balls, seed=12)
    balls.set_array("displacements", balls.positions - make(name, False, True)[1].positions)
    energy, forces = calc.get_property("energy", balls), calc.get_property("forces", balls).copy()
    constants = calc.get_force_constants(balls)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = balls.copy()
    turned.rotate(angle, "z", rotate_cell=True)
    turned.set_array("displacements", balls.arrays["displacements"] @ turn.T)
    assert calc.get_property("energy", turned) == pytest.approx(energy, rel=1e-12)
    np.testing.assert_allclose(calc.get_property("forces", turned), forces @ turn.T, atol=1e-14)
    np.testing.assert_allclose(calc.get_force_constants(turned), turn @ constants @ turn.T, atol=1e-12)
    if name == "kagome 2x2":
        return  # without friction it has no vibrations
    q = [[0.1, 0.3]]
    expected = gp.Phonons(state, balls).frequencies(q)
    np.testing.assert_allclose(gp.Phonons(state, turned).frequencies(q), expected, rtol=1e-9)


# -- force constants of balls that are displaced, with finite overlap -----------------------------------------------------


@both_frictions
def test_force_constants_of_finite_overlap_know_where_balls_are(friction):
    # directions and distances of contacts change with displacements of the order of the overlap
    _, balls, calc = make("vacancy", friction, True)
    balls.arrays["diameter_deviations"][:] = 0.1 * SOFT * np.random.default_rng(13).uniform(-1, 1, len(balls))
    displaced(balls, 0.2, 14)
    check_force_constants(calc, balls, 2e-6, rel=0.02)


@pytest.mark.claim("finite-overlap-exact")
def test_force_constants_around_a_relaxed_vacancy():
    state = at_overlap(5e-3, friction=False, finite_overlap=True)
    balls = gp.atoms(state).repeat((5, 5, 1))
    del balls[12]
    balls.calc = calc = gp.HertzMindlin(state)
    sites = balls.positions.copy()
    with BFGS(balls, alpha=6.0, maxstep=0.01, logfile=None) as search:
        assert search.run(fmax=1e-9 * state.force / state.scales.force, steps=500)
    balls.set_array("displacements", balls.positions - sites)
    assert np.abs(balls.arrays["displacements"]).max() > 0.1 * 5e-3
    chosen = [0, 6, 12, 17]
    exact = calc.get_force_constants(balls)[:, chosen]
    coarse, fine = (differenced_force_constants(calc, balls, 5e-3 / m, chosen) for m in (40.0, 80.0))
    assert np.abs(coarse - exact).max() / np.abs(fine - exact).max() == pytest.approx(4.0, rel=0.02)
    np.testing.assert_allclose((4.0 * fine - coarse) / 3.0, exact, atol=2e-6)


def test_the_origin_of_slip_is_where_there_is_no_torque():
    _, balls, calc = make("3x3")
    balls = shaken(balls, seed=15)
    balls.set_array("rotations", np.zeros(9))
    assert np.abs(calc.get_torques(balls)).max() > 1e-4
    stiff = differenced_force_constants(calc, balls, 1e-4)
    balls.set_array("slip_origin", balls.positions - make("3x3")[1].positions)
    np.testing.assert_allclose(calc.get_torques(balls), 0.0, atol=1e-16)
    # what is counted from it is as stiff
    np.testing.assert_allclose(differenced_force_constants(calc, balls, 1e-4), stiff, atol=1e-8)


# -- samples of a simulation --------------------------------------------------------------------------------------------


def simulated(friction, overlap=0.05, width=2.04e-6, **more):
    spread = gp.Uniform(width)
    packing = gp.Packing(STEEL, DIAMETER, spread, friction=friction)
    simulation = gp.DirectSimulation(packing, (9, 8), seed=3, **{"geometry": "lattice"} | more)
    return simulation.at_overlap(np.asarray(overlap) * width)


@pytest.mark.claim("sample-at-rest")
@both_frictions
@pytest.mark.parametrize("overlap", [0.5, 0.05, -0.05])
def test_a_sample_comes_back_at_rest(friction, overlap):
    state = simulated(friction, overlap)
    balls, sample, scales = state.sample.atoms(), state.sample, state.scales
    balls.calc = gp.HertzMindlin(state)
    # the equilibrium's own residual, and what is left of overlaps when they are differences of positions
    least = (1e-10 + 72 * 2e-16 * DIAMETER / sample.overlap) if overlap > 0.0 else 1e-8
    assert np.abs(balls.get_forces()).max() * scales.force < least * sample.force
    assert np.abs(balls.calc.get_torques(balls)).max() * scales.energy < least * sample.force * DIAMETER
    assert balls.get_potential_energy() * scales.energy == pytest.approx(sample.energy * 3 * 72, rel=1e-9)
    pressure = -np.mean(balls.get_stress()[:2]) * scales.modulus
    assert pressure == pytest.approx(np.sqrt(3.0) * sample.force / DIAMETER**2, rel=1e-9)
    # the mean lattice of the same state is still its own
    assert -np.mean(gp.atoms(state).get_stress()[:2]) * scales.modulus == pytest.approx(pressure, rel=1e-9)


@pytest.mark.claim("sample-at-rest")
@both_frictions
def test_force_constants_of_a_sample(friction):
    state = simulated(friction, 0.3)
    balls, calc = state.sample.atoms(), gp.HertzMindlin(state)
    lattice = calc.contact_lattice(balls)
    tensor = lattice.elastic_tensor() * state.scales.modulus
    np.testing.assert_allclose(tensor, state.sample.elastic_tensor, rtol=0.0, atol=1e-9 * tensor.max())
    exact, delta = calc.get_force_constants(balls)[:, [0, 37]], state.relative_overlap
    errors = [np.abs(differenced_force_constants(calc, balls, delta / m, [0, 37]) - exact).max() for m in (200.0, 400.0)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    assert errors[1] < 1e-3


def test_samples_of_several_loads_by_index():
    states = simulated(True, [0.5, 0.05])
    for index in range(2):
        balls = states[index].sample.atoms()
        balls.calc = gp.HertzMindlin(states[index])
        assert np.abs(balls.get_forces()).max() * states[index].scales.force < 1e-8 * states[index].force
    with pytest.raises(InputError, match="reduced units of another state"):
        gp.HertzMindlin(states[0]).get_force_constants(balls)


def test_a_sample_of_several_is_not_their_mean():
    state = simulated(True, 0.05, samples=2)
    with pytest.raises(InputError, match="of one sample, and the state is the mean over 2"):
        gp.HertzMindlin(state).get_force_constants(state.sample.atoms())


def test_a_slice_of_a_sample_keeps_the_law_of_two_balls():
    # even of balls that happen to be alike
    state = simulated(False, 0.5)
    pair = state.sample.atoms()[[0, 8]]
    pair.calc = gp.HertzMindlin(state)
    pair.arrays["diameter_deviations"][:] = 0.0
    pair.positions[1] = pair.positions[0] + [1.0, 0.0, 0.0]
    pair.pbc = False
    expected = state.packing.law.energy(state.overlap) / state.scales.energy
    assert pair.get_potential_energy() == pytest.approx(expected, rel=1e-9)


def test_small_moves_search_once(monkeypatch):
    searched = []

    def counting(*args):
        searched.append(len(args[0]))
        return real(*args)

    real = granphon.phonons.contacts._search
    monkeypatch.setattr(granphon.phonons.contacts, "_search", counting)
    _, balls, calc = make("3x5")
    for seed in range(5):
        calc.get_property("energy", shaken(balls, seed))
        balls.set_cell(np.asarray(balls.cell) * 1.0001, scale_atoms=True)
    calc.get_force_constants(balls)
    assert searched == [15]
    balls.positions[0, 0] += 0.2
    calc.get_property("energy", balls)
    assert searched == [15, 15]


def test_separated_balls_have_zero_force_constants():
    _state, balls, calc = make("3x3")
    balls.arrays["diameter_deviations"][:] = -2.0 * SOFT
    assert calc.get_property("energy", balls) == 0.0
    assert calc.get_force_constants(balls, format="csr").nnz == 0
    np.testing.assert_array_equal(calc.get_force_constants(balls), 0.0)


# -- the law of a medium -----------------------------------------------------------------------------------------------

SPREAD = gp.Uniform(0.1 * DIAMETER)  # wide, so that steps of a finite difference are small against it
#: overlaps over the width; contacts of the mean ball are open at the last
MEAN_OVERLAPS = (0.6, 0.2, -0.1)
every_medium = pytest.mark.parametrize("medium", [gp.AveragedForce, gp.EffectiveMedium])


def medium_state(medium, part, friction=False):
    packing = gp.Packing(STEEL, DIAMETER, spread=SPREAD, friction=friction)
    return medium(packing).at_overlap(part * packing.width)


@every_medium
@pytest.mark.parametrize("part", MEAN_OVERLAPS)
@both_frictions
def test_forces_and_stress_are_slopes_of_the_energy_of_a_medium(medium, part, friction):
    state = medium_state(medium, part, friction)
    balls = shaken(gp.atoms(state).repeat((3, 3, 1)), deviations=False)
    balls.calc = gp.HertzMindlin(state)
    np.testing.assert_allclose(balls.get_forces(), calculate_numerical_forces(balls, eps=1e-5), rtol=0.0, atol=2e-8)
    one = gp.atoms(state).repeat((2, 2, 1))
    one.calc = gp.HertzMindlin(state)
    differences = calculate_numerical_stress(one, eps=1e-5)
    np.testing.assert_allclose(one.get_stress()[[0, 1, 5]], differences[[0, 1, 5]], rtol=0.0, atol=2e-8)


@every_medium
@pytest.mark.parametrize("part", MEAN_OVERLAPS)
def test_stress_and_force_constants_of_a_medium_are_those_of_its_state(medium, part):
    state = medium_state(medium, part)
    balls = gp.atoms(state)
    pressure = -balls.get_stress()[:2] * state.scales.modulus
    np.testing.assert_allclose(pressure, state.pressure / DIAMETER, rtol=1e-12)
    assert medium(state.packing).at_pressure(state.pressure).overlap == pytest.approx(state.overlap, rel=1e-12)
    big = balls.repeat((3, 3, 1))
    constants = gp.HertzMindlin(state).get_force_constants(big)
    equal = at_overlap(friction=False)
    np.testing.assert_allclose(
        constants, gp.HertzMindlin(equal).get_force_constants(gp.atoms(equal).repeat((3, 3, 1))), rtol=0.0, atol=1e-13
    )
    # a difference of the forces at an overlap that may be below zero
    differenced = differenced_force_constants(gp.HertzMindlin(state), big, 1e-5)
    np.testing.assert_allclose(constants[..., :2, :2], differenced[..., :2, :2], rtol=0.0, atol=1e-6)


@every_medium
def test_bands_of_a_medium_scale_with_the_root_of_its_stiffness(medium):
    qpoints = np.array([[0.1, 0.0, 0.0], [1 / 3, 1 / 3, 0.0], [0.21, -0.13, 0.0]])
    states = [medium_state(medium, part, friction=True) for part in MEAN_OVERLAPS]
    scaled = [gp.Phonons(state).frequencies(qpoints) / np.sqrt(state.normal_stiffness) for state in states]
    for other in scaled[1:]:
        np.testing.assert_allclose(other, scaled[0], rtol=1e-11)


@every_medium
def test_balls_with_diameters_of_their_own_have_no_mean_law(medium):
    balls = gp.atoms(medium_state(medium, 0.6)).repeat((3, 3, 1))
    balls.calc = gp.HertzMindlin(medium_state(medium, 0.6))
    balls.arrays["diameter_deviations"][0] = 1e-3
    for ask in (balls.calc.get_potential_energy, balls.calc.get_force_constants):
        with pytest.raises(InputError, match="count twice"):
            ask(balls)
