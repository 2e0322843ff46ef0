"""gp.atoms and HertzMindlin on a line, in a plane, in a plane that may bend, and in space:
energies, slopes, contacts.

The reference is an energy written here with vectors in space, contact by contact, from the
reference sites. It takes complex numbers, so that its slopes are exact (complex steps).
"""

from __future__ import annotations

import itertools

import ase.io
import numpy as np
import pytest
from ase import Atoms
from ase.build import make_supercell
from ase.calculators.calculator import PropertyNotImplementedError
from ase.calculators.fd import calculate_numerical_forces, calculate_numerical_stress
from ase.neighborlist import primitive_neighbor_list
from ase.optimize import BFGS
from hypothesis import given, settings
from hypothesis import strategies as st

import granphon as gp
import granphon.phonons.calculator
from granphon.base.errors import InputError, PrecisionError
from granphon.phonons.calculator import PairList
from tests.phonons.conftest import DIAMETER, ETA, SPACE, STEEL

GYRATION = 1.0 / np.sqrt(10.0)
#: a soft state, so that steps of a finite difference are small against the overlap and large
#: against rounding
SOFT = 0.02
TORSION = 0.07
BENDING = 0.03
#: length of a complex step
TINY = 1e-30


def at_overlap(lattice="fcc", finite_overlap=None, friction=True, relative=SOFT, **packing):
    balls = gp.Packing(STEEL, DIAMETER, lattice=lattice, friction=friction, **packing)
    return gp.AveragedLattice(balls).at_overlap(relative * DIAMETER, finite_overlap=finite_overlap)


@pytest.mark.parametrize("distance", [0.98, 0.6, 0.2])
def test_however_deep_balls_overlap_the_law_pushes_them_apart(distance):
    state = at_overlap("fcc", finite_overlap=True, friction=False)
    two = Atoms("Fe2", positions=[[0, 0, 0], [0, 0.6 * distance, 0.8 * distance]])
    pair = gp.HertzMindlin(state).adopt(two)
    unit = state.scales.force
    push = float(state.law.force((1.0 - distance) * DIAMETER)) / unit
    assert np.allclose(pair.get_forces()[1], [0.0, 0.6 * push, 0.8 * push], rtol=1e-12)
    pair.positions[1] = 0.0
    for calculator in (pair.calc, gp.HertzMindlin({"Fe": gp.Ball(STEEL, DIAMETER)})):
        with pytest.raises(InputError, match="one place"):
            calculator.get_property("forces", pair)


# -- cells -----------------------------------------------------------------------------------------


def repeated(*n):
    return lambda one: one.repeat(n)


def skewed(one):
    return make_supercell(one, [[2, 1, 0], [-1, 2, 1], [0, 0, 2]])


def slab(one):
    balls = one.repeat((2, 2, 2))
    balls.pbc = (True, True, False)
    return balls


def ribbon(one):
    balls = one.repeat((3, 3, 1))
    balls.pbc = (True, False, False)
    return balls


def cluster(*n):
    def build(one):
        balls = one.repeat(n)
        balls.pbc = False
        return balls

    return build


def vacancy(*n):
    def build(one):
        balls = one.repeat(n)
        del balls[len(balls) // 2]
        return balls

    return build


#: name -> (lattice, motions, function from one cell to the cell under test)
CELLS = {
    "fcc": ("fcc", None, repeated(2, 2, 2)),
    "fcc skewed": ("fcc", None, skewed),
    "fcc slab": ("fcc", None, slab),
    "fcc cluster": ("fcc", None, cluster(2, 2, 2)),
    "fcc vacancy": ("fcc", None, vacancy(2, 2, 2)),
    "hcp": ("hcp", None, repeated(2, 2, 1)),
    "bcc": ("bcc", None, repeated(2, 2, 2)),
    "membrane": ("triangular", "all", repeated(3, 2, 1)),
    "plane": ("triangular", "in_plane", repeated(3, 5, 1)),
    "plane 3x3": ("triangular", "in_plane", repeated(3, 3, 1)),
    "plane skewed": (
        "triangular",
        "in_plane",
        lambda one: make_supercell(one, [[2, 1, 0], [-1, 3, 0], [0, 0, 1]]),
    ),
    "plane vacancy": ("triangular", "in_plane", vacancy(3, 3, 1)),
    "plane small": ("triangular", "in_plane", repeated(2, 2, 1)),
    "plane cluster": ("triangular", "in_plane", cluster(3, 3, 1)),
    "ribbon": ("triangular", "in_plane", ribbon),
    "square": ("square", "in_plane", repeated(3, 3, 1)),
    "kagome": ("kagome", "in_plane", repeated(2, 2, 1)),
    "square out of plane": ("square", "out_of_plane", cluster(2, 2, 1)),
    "chain": ("chain", "all", repeated(4, 1, 1)),
    "chain in plane": ("chain", "in_plane", repeated(4, 1, 1)),
    "chain along x": ("chain", None, vacancy(5, 1, 1)),
}
COORDINATES = {"chain along x": 1} | {
    name: 2 for name, (_, motions, _) in CELLS.items() if motions == "in_plane"
}
#: cells whose second differences the default selection has
DIFFERENCED = ("membrane", "fcc", "plane skewed", "plane vacancy")
#: balls that are moved for these differences, where not all are
MOVED = {"membrane": [0, 4], "fcc": [0, 5]}
every_cell = pytest.mark.parametrize("name", CELLS)
both_frictions = pytest.mark.parametrize("friction", [False, True], ids=["smooth", "rough"])
both_overlaps = pytest.mark.parametrize("finite_overlap", [False, True], ids=["limit", "finite"])


def make(name, contact="stiff", finite_overlap=False, **more):
    """The state, the balls on their sites, the calculator. "stiff": contacts with torsion and
    bending too.
    """
    lattice, motions, build = CELLS[name]
    if contact == "stiff" and name != "chain along x":
        # balls that move in a plane turn across the contacts only, which twists none
        torsion = 0.0 if name in COORDINATES else TORSION
        more = {"torsion": torsion, "bending": BENDING} | more
    state = at_overlap(lattice, finite_overlap, contact != "smooth", motions=motions, **more)
    return state, build(gp.atoms(state)), gp.HertzMindlin(state)


def shaken(balls, seed=0, amplitude=2e-3, coordinates=None, deviations=True):
    """A generic configuration with every contact that was closed still closed."""
    rng = np.random.default_rng(seed)
    turned = balls.arrays["rotations"].shape
    # of balls that turn about z, or about all axes
    m = coordinates or (2 if len(turned) == 1 else 3)
    out = balls.copy()
    out.positions[:, :m] += amplitude * rng.uniform(-1, 1, (len(balls), m))
    out.arrays["rotations"] += amplitude * rng.uniform(-1, 1, turned)
    if deviations:
        out.arrays["diameter_deviations"] += amplitude * rng.uniform(-1, 1, len(balls))
    return out


# -- the twin --------------------------------------------------------------------------------------


class Twin:
    """The energy of balls near reference sites, by brute force over all images, with vectors in
    space.
    """

    def __init__(self, state, sites):
        self.rest = state.overlap / DIAMETER
        self.finite = state.finite_overlap
        self.spacing = 1.0 - self.rest if self.finite else 1.0
        packing = state.packing
        self.eta = ETA if packing.friction else 0.0
        self.torsion = float(state.torsion)
        self.bending = packing.bending
        # torsion over k d^2 is then as the overlap of the contact
        self.hertz = packing.torsion == "mindlin"
        self.turning = (
            bool(self.eta or self.torsion or self.bending) and packing.motions is not None
        )
        self.turning |= packing.structure.dimension == 3 and bool(self.eta or self.torsion)
        steps = [np.arange(-3, 4) if periodic else np.zeros(1, int) for periodic in sites.pbc]
        shifts = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 3)
        here = sites.positions
        self.cell = np.asarray(sites.cell)
        r = here[None, :, None] + (shifts @ self.cell)[None, None] - here[:, None, None]
        apart = np.linalg.norm(r, axis=-1)
        self.i, self.j, s = np.nonzero(np.abs(apart - self.spacing) < 1e-6)
        self.shift = shifts[s]
        self.normal = r[self.i, self.j, s] / self.spacing

    def energy(self, positions, phi, deviation, strain=0.0):
        i = self.i
        j = self.j
        n = self.normal
        r = positions[j] - positions[i] + self.shift @ self.cell
        r = r + r @ np.broadcast_to(strain, (3, 3))
        extra = 0.5 * (deviation[i] + deviation[j])
        along = np.sum(r * n, axis=1)
        delta = (
            1.0 + extra - np.sqrt(np.sum(r * r, axis=1))
            if self.finite
            else self.rest + extra - (along - 1.0)
        )
        total = 4.0 / 15.0 * delta**2.5 / np.sqrt(self.rest)
        if self.turning:
            arm_i, arm_j = (
                0.5 * self.spacing * (1.0 + deviation[ball])[:, None] for ball in (i, j)
            )
            moved = r - self.spacing * n
            turned = phi[j] - phi[i]
            slip = (
                moved
                - n * np.sum(moved * n, axis=1)[:, None]
                - np.cross(arm_i * phi[i] + arm_j * phi[j], n)
            )
            twist = np.sum(turned * n, axis=1)
            roll = turned - n * twist[:, None]
            stiffness = np.sqrt((self.rest + extra) / self.rest)
            torsion = self.torsion * ((self.rest + extra) / self.rest if self.hertz else 1.0)
            springs = (
                self.eta * np.sum(slip**2, axis=1)
                + torsion * twist**2
                + self.bending * np.sum(roll**2, axis=1)
            )
            total = total + 0.5 * stiffness * springs
        assert np.all(delta.real > 0.0)
        return 0.5 * np.sum(total)  # each contact is found from both of its ends

    def of(self, balls):
        """Arguments of the energy: positions, rotation vectors, deviations."""
        phi = balls.arrays["rotations"]
        if phi.ndim == 1:
            phi = np.stack([0.0 * phi, 0.0 * phi, phi], axis=1)
        return balls.positions, phi, balls.arrays["diameter_deviations"]

    def slopes(self, balls):
        """dE/d(position), dE/d(rotation), dE/d(strain), by complex steps."""
        x, phi, deviation = self.of(balls)
        found = np.zeros((2, len(balls), 3))
        for which, ball, axis in itertools.product(range(2), range(len(balls)), range(3)):
            step = np.zeros((2, len(balls), 3), complex)
            step[which, ball, axis] = 1j * TINY
            found[which, ball, axis] = (
                self.energy(x + step[0], phi + step[1], deviation).imag / TINY
            )
        strain = np.zeros((3, 3))
        for a, b in itertools.product(range(3), repeat=2):
            step = np.zeros((3, 3), complex)
            step[a, b] = 1j * TINY
            strain[a, b] = self.energy(x, phi, deviation, 0.5 * (step + step.T)).imag / TINY
        return *found, strain


# -- what gp.atoms makes ---------------------------------------------------------------------------

BRAVAIS = {
    "chain": "LINE",
    "triangular": "HEX2D",
    "square": "SQR",
    "kagome": "HEX2D",
    "sc": "CUB",
    "bcc": "BCC",
    "fcc": "FCC",
    "hcp": "HEX",
    "diamond": "FCC",
}


@pytest.mark.parametrize("lattice", BRAVAIS)
@both_overlaps
def test_one_cell_of_each_lattice(lattice, finite_overlap):
    state = at_overlap(lattice, finite_overlap)
    balls = gp.atoms(state)
    structure = state.packing.structure
    spacing = 1.0 - SOFT if finite_overlap else 1.0
    p = structure.periods
    assert balls.cell.get_bravais_lattice(pbc=balls.pbc).name == BRAVAIS[lattice]
    np.testing.assert_array_equal(balls.pbc, np.arange(3) < p)
    np.testing.assert_array_equal(np.asarray(balls.cell)[p:], np.eye(3)[p:])
    many = balls.repeat(tuple(3 if axis < p else 1 for axis in range(3)))
    near = np.abs(many.get_all_distances(mic=True) - spacing) < 1e-9
    np.testing.assert_array_equal(near.sum(axis=1), structure.coordination)
    shape = (3,) if p == 3 else ()
    assert balls.arrays["rotations"].shape == (len(balls), *shape)
    assert balls.get_potential_energy() == pytest.approx(
        len(structure.contacts) * 4.0 / 15.0 * SOFT**2, rel=1e-12
    )
    np.testing.assert_allclose(balls.get_forces(), 0.0, atol=1e-15)
    assert balls.calc.get_torques(balls).shape == (len(balls), *shape)


def test_vectors_are_those_of_ase():
    from ase.build import bulk

    for lattice, edge in (
        ("fcc", np.sqrt(2.0)),
        ("bcc", 2.0 / np.sqrt(3.0)),
        ("sc", 1.0),
        ("diamond", 4.0 / np.sqrt(3.0)),
    ):
        own = gp.atoms(at_overlap(lattice))
        np.testing.assert_allclose(
            np.asarray(own.cell), np.asarray(bulk("Fe", lattice, a=edge).cell), atol=1e-15
        )
    np.testing.assert_allclose(np.asarray(gp.atoms(at_overlap("chain")).cell), np.eye(3), atol=0)


def test_a_layer_in_space_is_a_plane_with_all_motions():
    sheet = gp.Lattice("sheet", ((1.0, 0.0, 0.0), (-0.5, np.sqrt(0.75), 0.0)), ((0.0, 0.0, 0.5),))
    state = at_overlap(sheet, bending=BENDING)
    flat = at_overlap("triangular", motions="all", bending=BENDING)
    balls, plane = (gp.atoms(one).repeat((2, 2, 1)) for one in (state, flat))
    np.testing.assert_array_equal(balls.pbc, [True, True, False])
    np.testing.assert_array_equal(balls.positions[:, 2], 0.5)
    lattice = gp.HertzMindlin(state).contact_lattice(balls)
    assert (lattice.periods, lattice.dimension, lattice.cell.shape) == (2, 3, (2, 3))
    expected = gp.HertzMindlin(flat).get_force_constants(plane)
    np.testing.assert_allclose(
        gp.HertzMindlin(state).get_force_constants(balls), expected, atol=1e-14
    )
    np.testing.assert_allclose(
        gp.HertzMindlin(state).get_property("stress", balls),
        gp.atoms(flat).get_stress(),
        atol=1e-15,
    )


# -- energy, forces, torques, stress ---------------------------------------------------------------


@pytest.mark.claim("forces-are-slopes")
@pytest.mark.parametrize(
    ("name", "contact"),
    [
        pytest.param(
            name,
            contact,
            # a contact that is stiff has all that a rough one has
            marks=[pytest.mark.slow] * (contact == "rough" and name not in DIFFERENCED),
        )
        for name in CELLS
        for contact in ("smooth", "rough", "stiff")
    ],
)
@both_overlaps
def test_slopes_of_the_energy(name, contact, finite_overlap):
    state, sites, calc = make(name, contact, finite_overlap)
    m = COORDINATES.get(name, 3)
    balls, twin = shaken(sites, seed=3, coordinates=m), Twin(state, sites)
    assert calc.get_property("energy", balls) == pytest.approx(
        twin.energy(*twin.of(balls)), rel=1e-12
    )
    force, torque, strain = twin.slopes(balls)
    np.testing.assert_allclose(calc.get_property("forces", balls), -force, atol=1e-14)
    assert np.abs(force).max() > 1e-4
    torques = calc.get_torques(balls)
    np.testing.assert_allclose(torques, -torque if m == 3 else -torque[:, 2], atol=1e-14)
    assert bool(np.abs(torques).max() > 1e-5) is (contact != "smooth" and name != "chain along x")
    periods = state.packing.structure.periods
    volume = abs(np.linalg.det(np.asarray(balls.cell)[:periods, :periods]))
    expected = strain[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]] / volume
    np.testing.assert_allclose(calc.get_property("stress", balls), expected, atol=1e-14)


@pytest.mark.parametrize(
    ("lattice", "motions"),
    [
        ("chain", None),
        ("triangular", "all"),
        ("triangular", None),
        ("square", None),
        ("kagome", None),
        ("sc", None),
        ("bcc", None),
        ("fcc", None),
        ("hcp", None),
    ],
)
@pytest.mark.parametrize("relative", [1e-9, 1e-2])
@both_overlaps
def test_stress_is_the_pressure(lattice, motions, relative, finite_overlap):
    state = at_overlap(lattice, finite_overlap, relative=relative, motions=motions)
    balls = gp.atoms(state)
    p = state.packing.structure.periods
    pascal = -balls.get_stress() * balls.calc.scales.modulus * DIAMETER ** (3 - p)
    tolerance = 1e-14 + 1e-15 / relative  # positions hold 1e-16/relative of the overlap
    np.testing.assert_allclose(pascal[:p], state.pressure, rtol=tolerance)
    np.testing.assert_allclose(pascal[p:], 0.0, atol=tolerance * state.pressure)


@both_overlaps
@pytest.mark.parametrize("friction", [True, False])
def test_mindlin_torsion_is_that_of_each_contact(finite_overlap, friction):
    state, sites, calc = make(
        "fcc", "rough" if friction else "smooth", finite_overlap, torsion="mindlin"
    )
    assert state.torsion == pytest.approx((1.0 - 0.276) / 3.0 * SOFT, rel=1e-12)
    rng, balls, twin = np.random.default_rng(0), sites.copy(), Twin(state, sites)
    balls.arrays["rotations"][:] = 1e-3 * rng.normal(size=(len(balls), 3))
    for spread in (
        0.0,
        0.4 * SOFT,
    ):
        # balls that are all alike, and contacts whose overlaps differ by half
        balls.arrays["diameter_deviations"][:] = spread * rng.uniform(-1.0, 1.0, len(balls))
        assert calc.get_property("energy", balls) == pytest.approx(
            twin.energy(*twin.of(balls)), rel=1e-12
        )
        np.testing.assert_allclose(calc.get_torques(balls), -twin.slopes(balls)[1], atol=1e-14)
        # the energy is quadratic in the rotations, by the force constants
        x, phi, deviation = twin.of(balls)
        turned = np.zeros((len(balls), 6))
        turned[:, 3:] = phi * GYRATION * (1.0 + deviation)[:, None]
        work = 0.5 * np.einsum("ia,ijab,jb->", turned, calc.get_force_constants(balls), turned)
        assert work == pytest.approx(
            twin.energy(x, phi, deviation) - twin.energy(x, 0.0 * phi, deviation), rel=1e-9
        )


@pytest.mark.parametrize("name", ["fcc", "chain along x"])
@both_overlaps
def test_no_balls_and_balls_apart(name, finite_overlap):
    _, balls, calc = make(name, "stiff", finite_overlap)
    balls.pbc = False
    apart = balls[:2]
    apart.positions[1, 0] += 9.0
    for few in (balls[[]], apart):
        assert calc.get_property("energy", few) == 0.0
        assert calc.get_property("forces", few).shape == (len(few), 3)
        np.testing.assert_array_equal(calc.get_torques(few), np.zeros_like(few.arrays["rotations"]))
        np.testing.assert_array_equal(calc.get_force_constants(few), 0.0)


# -- invariance ------------------------------------------------------------------------------------


@every_cell
@both_overlaps
def test_energy_does_not_know_where_the_lattice_is(name, finite_overlap):
    _, sites, calc = make(name, "stiff", finite_overlap)
    balls = shaken(sites, 6, coordinates=COORDINATES.get(name, 3))
    energy = calc.get_property("energy", balls)
    forces = calc.get_property("forces", balls).copy()
    balls.positions += [0.371, -0.777, 5.1]
    assert calc.get_property("energy", balls) == pytest.approx(energy, rel=1e-12)
    balls.wrap()
    np.testing.assert_allclose(calc.get_property("forces", balls), forces, atol=1e-13)
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-14)


@pytest.mark.parametrize(
    "name", ["fcc cluster", "square out of plane", "plane cluster", "fcc vacancy", "chain"]
)
def test_a_rigid_motion_costs_nothing(name):
    """Turned with their lattice, rough balls neither slip nor twist nor roll, to first order."""
    state = at_overlap(*CELLS[name][:1], motions="all", torsion=TORSION, bending=BENDING)
    balls, calc = CELLS[name][2](gp.atoms(state)), gp.HertzMindlin(state)
    balls.pbc = False
    n = len(balls)
    matrix = calc.get_force_constants(balls).transpose(0, 2, 1, 3).reshape(6 * n, 6 * n)
    rigid = np.zeros((6, n, 6))
    for axis, unit in enumerate(np.eye(3)):
        rigid[axis, :, :3] = unit
        rigid[3 + axis] = np.hstack(
            [np.cross(unit, balls.positions), np.tile(GYRATION * unit, (n, 1))]
        )
    np.testing.assert_allclose(matrix @ rigid.reshape(6, -1).T, 0.0, atol=1e-13)
    values = np.linalg.eigvalsh(matrix)
    np.testing.assert_allclose(values[:6], 0.0, atol=1e-13)
    assert values[6] > 1e-4


# -- force constants -------------------------------------------------------------------------------


def differenced(calc, balls, m, rotates, step, chosen=None):
    """Minus the central differences of forces and torques; lengths w = R_g phi for rotations.

    (N, N, m, m), or (N, n, m, m) where ``chosen`` balls are moved.
    """
    n = len(balls)
    radius = GYRATION * (1.0 + balls.arrays["diameter_deviations"])
    width = balls.arrays["rotations"].reshape(n, -1).shape[1] * rotates

    def pull(ball, axis, by):
        other = balls.copy()
        if axis < m:
            other.positions[ball, axis] += by
        else:
            other.arrays["rotations"].reshape(n, -1)[ball, axis - m] += by / radius[ball]
        torques = calc.get_torques(other).reshape(n, -1)[:, :width] / radius[:, None]
        return np.hstack([calc.get_property("forces", other)[:, :m], torques])

    chosen = range(n) if chosen is None else chosen
    out = np.zeros((n, len(chosen), m + width, m + width))
    for (place, ball), axis in itertools.product(enumerate(chosen), range(m + width)):
        out[:, place, :, axis] = -(pull(ball, axis, step) - pull(ball, axis, -step)) / (2.0 * step)
    return out


def check_force_constants(calc, balls, name, contact, atol):
    """Compare force constants with central differences (Richardson), whose order two is asserted;
    return them.
    """
    m = COORDINATES.get(name, 3)
    chosen = MOVED.get(name, range(len(balls)))
    exact = calc.get_force_constants(balls)[:, chosen]
    coarse, fine = (
        differenced(calc, balls, m, contact != "smooth", SOFT / parts, chosen)
        for parts in (40.0, 80.0)
    )
    if name == "chain along x":
        coarse = coarse[..., :1, :1]
        fine = fine[..., :1, :1]
    elif contact == "smooth" and m == 2:
        np.testing.assert_array_equal(exact[..., 2, :], 0.0)
        exact = exact[..., :2, :2]
    np.testing.assert_allclose((4.0 * fine - coarse) / 3.0, exact, atol=atol)
    wide = np.abs(coarse - exact).max()
    narrow = np.abs(fine - exact).max()
    assert wide / narrow == pytest.approx(4.0, rel=0.02)
    return calc.get_force_constants(balls)


@pytest.mark.claim("forces-are-slopes")
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.exhaustive] * (name not in DIFFERENCED))
        for name in CELLS
        if name not in ("fcc skewed", "square out of plane")
    ],
)
@pytest.mark.parametrize("contact", ["smooth", "stiff"])
@both_overlaps
def test_force_constants_are_second_differences(name, contact, finite_overlap):
    _, balls, calc = make(name, contact, finite_overlap)
    exact = check_force_constants(calc, balls, name, contact, 1e-6)
    np.testing.assert_allclose(exact, exact.transpose(1, 0, 3, 2), atol=1e-15)
    sparse = calc.get_force_constants(balls, format="csr")
    assert sparse.has_canonical_format
    np.testing.assert_allclose(
        exact.transpose(0, 2, 1, 3).reshape(sparse.shape), sparse.toarray(), atol=1e-15
    )


@pytest.mark.parametrize(
    ("name", "contact"),
    [
        ("fcc", "stiff"),
        ("membrane", "stiff"),
        ("plane vacancy", "rough"),
        *(
            pytest.param(*case, marks=pytest.mark.exhaustive)
            for case in (
                ("hcp", "stiff"),
                ("plane", "smooth"),
                ("kagome", "rough"),
                ("square", "stiff"),
            )
        ),
    ],
)
@both_overlaps
def test_force_constants_of_balls_displaced(name, contact, finite_overlap):
    """Displacements and diameters are part of the state; with finite overlap they turn contacts,
    also out of a membrane.
    """
    _, sites, calc = make(name, contact, finite_overlap)
    balls, rng, m = sites.copy(), np.random.default_rng(11), COORDINATES.get(name, 3)
    balls.arrays["diameter_deviations"] += 0.1 * SOFT * rng.uniform(-1, 1, len(balls))
    balls.arrays["displacements"][:, :m] += 0.1 * SOFT * rng.uniform(-1, 1, (len(balls), m))
    balls.positions += balls.arrays["displacements"]
    exact = check_force_constants(calc, balls, name, contact, 4e-6)
    lattice = calc.contact_lattice(balls)
    assert lattice.dimension == (3 if m == 3 and (finite_overlap or name != "membrane") else 2)
    assert lattice.periods == (3 if name in ("fcc", "hcp") else 2)
    # positions alone do not enter: moved back without a word, the balls have the same force
    # constants
    balls.positions[:, :m] += 0.1
    np.testing.assert_allclose(calc.get_force_constants(balls), exact, atol=1e-12)


def test_one_contact_in_closed_form():
    _, balls, calc = make("chain", "stiff")
    pair = balls[:2]
    pair.pbc = False
    lever = 0.5 / GYRATION
    slip = ETA
    twist = TORSION / GYRATION**2
    roll = BENDING / GYRATION**2
    own = np.diag([1.0, slip, slip, twist, slip * lever**2 + roll, slip * lever**2 + roll])
    own[1, 5] = own[5, 1] = slip * lever
    own[2, 4] = own[4, 2] = -slip * lever
    other = np.diag([-1.0, -slip, -slip, -twist, slip * lever**2 - roll, slip * lever**2 - roll])
    other[1, 5], other[5, 1] = slip * lever, -slip * lever
    other[2, 4], other[4, 2] = -slip * lever, slip * lever
    constants = calc.get_force_constants(pair)
    np.testing.assert_allclose(constants[0, 0], own, atol=1e-14)
    np.testing.assert_allclose(constants[0, 1], other, atol=1e-14)


@pytest.mark.parametrize(
    ("lattice", "motions"),
    [
        ("chain", "all"),
        ("triangular", "all"),
        ("honeycomb", "out_of_plane"),
        *((name, None) for name in SPACE[1:]),
    ],
)
@both_overlaps
def test_the_lattice_of_the_atoms_is_that_of_the_state(lattice, motions, finite_overlap):
    more = {} if finite_overlap else {"torsion": TORSION, "bending": BENDING}
    state = at_overlap(lattice, finite_overlap, relative=1e-3, motions=motions, **more)
    balls = gp.atoms(state)
    found = balls.calc.contact_lattice(balls)
    own = state.contact_lattice()
    assert (found.motions, found.periods, found.dimension) == (
        own.motions,
        own.periods,
        own.dimension,
    )
    assert found.cell.shape == own.cell.shape
    q = np.random.default_rng(0).normal(size=(3, own.periods))
    np.testing.assert_allclose(found.dynamical_matrix(q), own.dynamical_matrix(q), atol=1e-10)
    # a supercell has the branches of the cell at all wave vectors that fold onto its own
    many = balls.repeat(tuple(2 if axis < own.periods else 1 for axis in range(3)))
    folded = [
        own.wavevectors(np.array(step) / 2.0)
        for step in itertools.product(range(2), repeat=own.periods)
    ]
    expected = np.linalg.eigvalsh(own.dynamical_matrix(np.array(folded))).ravel()
    matrix = balls.calc.contact_lattice(many).dynamical_matrix(np.zeros((1, own.periods)))
    np.testing.assert_allclose(np.linalg.eigvalsh(matrix[0]), np.sort(expected), atol=1e-10)


ORDER = ("x", "y", "z", "w_x", "w_y", "w_z")


@pytest.mark.parametrize("name", ["fcc", "membrane", "chain"])
@both_overlaps
def test_some_of_the_motions(name, finite_overlap):
    _, balls, calc = make(name, "stiff", finite_overlap)
    n, whole = len(balls), calc.get_force_constants(balls)
    subsets = {
        "longitudinal": [0],
        "in_plane": [0, 1, 5],
        "out_of_plane": [2, 3, 4],
        "all": list(range(6)),
    }
    for motions, own in subsets.items():
        dense = calc.get_force_constants(balls, motions=motions)
        np.testing.assert_allclose(dense, whole[:, :, own][..., own], atol=1e-15)
        sparse = calc.get_force_constants(balls, "csr", motions)
        assert (sparse.format, sparse.shape) == ("csr", (len(own) * n, len(own) * n))
        np.testing.assert_allclose(
            dense.transpose(0, 2, 1, 3).reshape(sparse.shape), sparse.toarray(), atol=1e-15
        )
        lattice = calc.contact_lattice(balls, motions)
        assert lattice.motions.letters == tuple(
            "w" if motions == "in_plane" and k == 5 else ORDER[k] for k in own
        )


@pytest.mark.parametrize(
    ("lattice", "motions", "friction", "more", "size"),
    [
        ("chain", None, True, {}, 1),
        ("chain", "in_plane", True, {}, 3),
        ("chain", "out_of_plane", True, {}, 3),
        ("chain", "all", True, {}, 6),
        ("chain", "all", False, {}, 3),
        ("square", None, False, {}, 3),
        ("square", "all", False, {}, 3),
        ("square", "all", False, {"torsion": 0.1}, 6),
        ("fcc", None, False, {}, 3),
        ("fcc", None, False, {"bending": 0.1}, 6),
        ("fcc", None, True, {}, 6),
    ],
)
def test_rotations_that_nothing_resists_are_left_out(lattice, motions, friction, more, size):
    balls = gp.atoms(at_overlap(lattice, None, friction, motions=motions, **more))
    assert balls.calc.get_force_constants(balls).shape == (1, 1, size, size)
    assert balls.calc.get_force_constants(balls, "csr").shape == (size, size)


def test_motions_that_the_state_does_not_have():
    for lattice, motions, asked in (
        ("triangular", None, "all"),
        ("triangular", None, "out_of_plane"),
        ("chain", None, "in_plane"),
        ("triangular", "out_of_plane", "in_plane"),
        ("fcc", None, "transverse"),
        ("fcc", None, ["all"]),
    ):
        balls = gp.atoms(at_overlap(lattice, motions=motions))
        with pytest.raises(InputError, match="no motions"):
            balls.calc.get_force_constants(balls, motions=asked)


# -- neighbours ------------------------------------------------------------------------------------


def listed(pairs):
    return list(
        zip(*(column.tolist() for column in (pairs.i, pairs.j, *pairs.shift.T)), strict=True)
    )


@given(
    seed=st.integers(0, 2**32 - 1),
    m=st.sampled_from([1, 2, 3]),
    skew=st.sampled_from([0.0, 0.5, 3.0]),
)
def test_pairs_are_those_of_ase(seed, m, skew):
    rng = np.random.default_rng(seed)
    cell = (np.eye(m) + skew * np.triu(rng.normal(size=(m, m)), 1)) * rng.uniform(0.7, 3.0, m)[
        :, None
    ]
    positions = rng.uniform(-4.0, 4.0, (rng.integers(1, 9), m))
    periodic = tuple(bool(axis) for axis in rng.integers(0, 2, m))
    cutoff = 1.25
    found = PairList().near(positions, cell, periodic, cutoff)
    box = np.eye(3)
    there = np.zeros((len(positions), 3))
    box[:m, :m], there[:, :m] = cell, positions
    pbc = (*periodic, *(False,) * (3 - m))
    i, j, shift, vector = primitive_neighbor_list("ijSD", pbc, box, there, cutoff)
    keys = zip(i.tolist(), j.tolist(), map(tuple, shift[:, :m].tolist()), strict=True)
    expected = {
        (a, b, *s): v[:m]
        for (a, b, s), v in zip(keys, vector, strict=True)
        if a < b or (a == b and s > (0,) * m)
    }
    own = listed(found)
    assert own == sorted(own)
    assert len(set(own)) == len(own)
    assert set(own) == set(expected)
    for key, v in zip(own, found.vector, strict=True):
        np.testing.assert_allclose(v, expected[key], atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1), m=st.sampled_from([1, 2, 3]))
@settings(max_examples=35, deadline=None)
def test_a_kept_list_is_a_new_one(seed, m):
    rng = np.random.default_rng(seed)
    cell = 2.0 * np.eye(m) + 0.1 * rng.normal(size=(m, m))
    positions = rng.uniform(-1.0, 3.0, (6, m))
    periodic = tuple(bool(a) for a in rng.integers(0, 2, m))
    kept = PairList()
    for _ in range(12):
        cutoff = 1.25 + 0.05 * rng.uniform()
        found, fresh = (one.near(positions, cell, periodic, cutoff) for one in (kept, PairList()))
        for one, other in zip(found, fresh, strict=True):
            np.testing.assert_array_equal(one, other)
        change = rng.integers(0, 5)
        if change == 0 and len(positions) > 2:
            positions = np.delete(positions, rng.integers(len(positions)), axis=0)
        elif change == 1:  # strained with all that is in it
            strain = np.eye(m) + 0.03 * rng.normal(size=(m, m))
            positions = positions @ strain
            cell = cell @ strain
        elif change == 2:
            cell = cell + 0.01 * rng.normal(size=(m, m))
        elif change == 3 and len(positions) > 2:  # as many balls, and not the same
            positions = np.roll(positions, 1, axis=0)
        else:
            positions = positions + rng.choice([0.01, 0.1, 1.0]) * rng.normal(size=positions.shape)


def test_a_large_cluster_without_a_cell():
    """The number of contacts of n x n x n balls in fcc; its cell tells nothing about where the
    balls are.
    """
    state = at_overlap("fcc", friction=False)
    n = 12
    balls = gp.atoms(state).repeat((n, n, n))
    balls.pbc = False
    balls.cell[:] = 0.0
    contacts = 3 * n**2 * (n - 1) + 3 * n * (n - 1) ** 2
    energy = gp.HertzMindlin(state).get_property("energy", balls)
    assert energy == pytest.approx(contacts * 4.0 / 15.0 * SOFT**2, rel=1e-11)


@pytest.mark.parametrize(
    ("name", "last", "extent"), [("fcc", 2, "a volume"), ("membrane", 1, "an area")]
)
def test_periods_that_depend_on_each_other_are_refused(name, last, extent):
    _, balls, calc = make(name)
    balls.cell[last] = 2.0 * balls.cell[0]
    with pytest.raises(InputError, match=f"cell without {extent}"):
        calc.get_property("energy", balls)
    balls.cell[last] = 0.0
    with pytest.raises(InputError, match="zero length"):
        calc.get_property("energy", balls)


# -- files -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["fcc", "hcp", "membrane", "chain"])
def test_files_keep_rotation_vectors(name, tmp_path):
    state, sites, calc = make(name, "stiff", True)
    balls = shaken(sites, 1)
    gp.write_extxyz(tmp_path / "balls.extxyz", balls)
    back = ase.io.read(tmp_path / "balls.extxyz")
    for array, values in balls.arrays.items():
        np.testing.assert_array_equal(back.arrays[array], values, err_msg=array)
    assert calc.get_property("energy", back) == calc.get_property("energy", balls)
    ase.io.write(tmp_path / "ase.extxyz", balls)
    back = ase.io.read(tmp_path / "ase.extxyz")
    np.testing.assert_allclose(back.arrays["rotations"], balls.arrays["rotations"], atol=5.1e-9)
    assert gp.Units.from_info(back.info) == state.scales
    # one ball keeps its three angles too
    gp.write_extxyz(tmp_path / "one.extxyz", balls[:1])
    assert ase.io.read(tmp_path / "one.extxyz").arrays["rotations"].shape == (1, 3)


@pytest.mark.parametrize("name", ["fcc", "chain", "membrane", "chain along x"])
def test_bare_atoms_are_adopted(name):
    _, balls, calc = make(name)
    bare = Atoms("Fe" * len(balls), positions=balls.positions, cell=balls.cell, pbc=balls.pbc)
    adopted = calc.adopt(bare)
    assert adopted.arrays["rotations"].shape == balls.arrays["rotations"].shape
    assert adopted.get_potential_energy() == pytest.approx(
        calc.get_property("energy", balls), rel=1e-12
    )


# -- what cannot be --------------------------------------------------------------------------------


def refused(calc, balls, match):
    for ask in (
        lambda: calc.get_property("energy", balls),
        lambda: calc.get_force_constants(balls),
    ):
        with pytest.raises(InputError, match=match):
            ask()


def test_balls_of_another_dimension():
    fcc, flat, row = (at_overlap(lattice) for lattice in ("fcc", "triangular", "chain"))
    bent = at_overlap("triangular", motions="all")
    refused(
        gp.HertzMindlin(fcc),
        gp.atoms(flat),
        r"rotations .* \(1,\).*x, y and z.*\(1, 3\)",
    )
    refused(
        gp.HertzMindlin(flat),
        gp.atoms(fcc),
        r"rotations .* \(1, 3\).* z only.*\(1,\)",
    )
    refused(gp.HertzMindlin(bent), gp.atoms(flat), r"rotations has the shape \(1,\)")
    refused(gp.HertzMindlin(bent), gp.atoms(fcc), "tilted out of the plane")
    refused(gp.HertzMindlin(row), gp.atoms(flat), "periodic across the line")
    refused(gp.HertzMindlin(at_overlap("sc")), gp.atoms(bent), "not those of the lattice")
    refused(gp.HertzMindlin(at_overlap("hcp")), gp.atoms(fcc), "not those of the lattice")
    # the same balls under another load, or with the other overlap
    refused(
        gp.HertzMindlin(at_overlap("fcc", relative=1e-3)), gp.atoms(fcc), "units of another state"
    )
    refused(gp.HertzMindlin(at_overlap("fcc", True)), gp.atoms(fcc), "finite overlap")


def test_cells_out_of_place():
    for name, axis, vector, where in (
        ("chain", 0, [1.0, 0.1, 0.0], "line"),
        ("chain along x", 0, [1.0, 0.0, 0.1], "line"),
        ("membrane", 1, [-0.5, 0.8, 0.1], "plane"),
    ):
        _, balls, calc = make(name)
        tilted = balls.copy()
        tilted.cell[axis] = vector
        refused(calc, tilted, f"tilted out of the {where}")
        balls.pbc = True
        refused(calc, balls, f"periodic across the {where}.*Set pbc")


@pytest.mark.parametrize("name", ["fcc", "hcp", "membrane", "fcc cluster"])
@pytest.mark.parametrize("axis", ["x", "z", (1, 1, 1)])
def test_contacts_of_fixed_direction_are_not_turned(name, axis):
    _, balls, calc = make(name, "rough", True)
    balls.pbc = False
    balls.cell[:] = 0.0
    balls.rotate(0.1, axis)
    assert calc.get_property("energy", balls) > 0.0
    balls.rotate(4.9, axis)
    refused(
        calc,
        balls,
        r"turned .* by (4\.9\d?|5) degrees",
    )


@pytest.mark.parametrize(
    ("name", "what"), [("fcc", "volume"), ("membrane", "area"), ("chain", "length")]
)
def test_stress_needs_a_cell(name, what):
    _, balls, calc = make(name)
    balls.pbc = False
    balls.cell[:] = 0.0
    assert calc.get_property("energy", balls) > 0.0
    with pytest.raises(InputError, match=f"the cell has no {what}"):
        calc.get_property("stress", balls)


# -- one-sided contacts ----------------------------------------------------------------------------


@both_frictions
@both_overlaps
def test_separated_balls_exert_nothing(friction, finite_overlap):
    state = at_overlap("triangular", friction=friction, finite_overlap=finite_overlap)
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
    # the ball is half the size it needs to touch anything: the state says so, whatever the
    # positions are
    _state, balls, calc = make("plane 3x3", "rough" if friction else "smooth")
    balls.arrays["diameter_deviations"][4] = -2.5 * SOFT
    constants = calc.get_force_constants(balls)
    np.testing.assert_array_equal(constants[4], 0.0)
    np.testing.assert_array_equal(constants[:, 4], 0.0)
    assert np.abs(constants[0]).max() > 1.0


def test_a_ball_displaced_out_of_reach_has_no_force_constants_there():
    _state, balls, calc = make("plane 3x3", "rough")
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
    _state, balls, calc = make("plane cluster", "rough" if friction else "smooth", finite_overlap)
    if friction or not finite_overlap:
        # beyond it a pair is turned too far for contacts of fixed direction
        amplitude = min(amplitude, 0.01)
    pair = shaken(balls, seed, amplitude)[[0, 3]]
    energy = calc.get_property("energy", pair)
    forces = calc.get_property("forces", pair)
    assert energy >= 0.0
    np.testing.assert_allclose(forces[0], -forces[1], atol=1e-18)
    if not friction:
        assert forces[1] @ (pair.positions[1] - pair.positions[0]) >= 0.0


# -- force constants in a plane --------------------------------------------------------------------


def test_force_constants_scale_with_the_contacts():
    # 3 contacts a ball at most: a sparse matrix of 21 numbers in each row, whatever the size
    state = at_overlap("triangular")
    balls = gp.atoms(state).repeat((40, 40, 1))
    sparse = gp.HertzMindlin(state).get_force_constants(balls, format="csr")
    assert np.diff(sparse.indptr).max() <= 21


def test_masses_do_not_enter_force_constants_and_do_enter_the_lattice():
    _, balls, calc = make("plane 3x3", "rough")
    equal = calc.get_force_constants(balls)
    masses = np.linspace(0.5, 3.0, 9)
    balls.set_masses(masses)
    np.testing.assert_array_equal(calc.get_force_constants(balls), equal)
    lattice = calc.contact_lattice(balls)
    np.testing.assert_array_equal(lattice.masses, masses)
    root = np.sqrt(np.repeat(masses, 3))
    matrix = equal.transpose(0, 2, 1, 3).reshape(27, 27) / np.outer(root, root)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(lattice.dynamical_matrix([[0.0, 0.0]])[0]),
        np.linalg.eigvalsh(matrix),
        atol=1e-13,
    )


# -- precision -------------------------------------------------------------------------------------


@pytest.mark.claim("api-positions")
@pytest.mark.parametrize("relative", [1e-20, 9e-11])
@both_overlaps
def test_below_precision_only_what_needs_positions_raises(relative, finite_overlap):
    state = at_overlap("triangular", relative=relative, finite_overlap=finite_overlap)
    balls = gp.atoms(state)
    for ask in (
        balls.get_potential_energy,
        balls.get_forces,
        balls.get_stress,
        lambda: balls.calc.get_torques(balls),
    ):
        with pytest.raises(PrecisionError, match="too few digits"):
            ask()
    many = balls.repeat((3, 3, 1))
    plain = at_overlap("triangular", relative=1e-2)
    reference = gp.HertzMindlin(plain).get_force_constants(gp.atoms(plain).repeat((3, 3, 1)))
    given_constants = balls.calc.get_force_constants(many)
    if finite_overlap:
        np.testing.assert_allclose(given_constants, reference, atol=30.0 * relative + 1e-15)
    else:
        np.testing.assert_array_equal(given_constants, reference)


def test_a_stress_that_is_not_there_is_refused_before_anything_is_found():
    balls = gp.atoms(at_overlap("triangular", relative=1e-20))
    balls.set_cell(np.zeros((3, 3)))
    with pytest.raises(PrecisionError):
        balls.get_forces()
    with pytest.raises(InputError, match="no area"):
        balls.get_stress()


@pytest.mark.claim("api-positions")
def test_just_above_precision_energy_has_the_digits_promised():
    state = at_overlap("triangular", relative=1e-10)
    balls = gp.atoms(state).repeat((3, 3, 1))
    balls.calc = gp.HertzMindlin(state)
    # six digits of the overlap: 2.5e-6 of the energy
    assert balls.get_potential_energy() == pytest.approx(27.0 * 4.0 / 15.0 * 1e-20, rel=1e-5)


# -- ASE's conventions -----------------------------------------------------------------------------


class Counting(gp.HertzMindlin):
    """HertzMindlin that counts its calculations."""

    count = 0

    def calculate(self, *args, **kwargs):
        self.count += 1
        super().calculate(*args, **kwargs)


def counted():
    state = at_overlap("triangular")
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


@pytest.mark.parametrize(
    "name", ["masses", "diameter_deviations", "rotations", "displacements", "slip_origin"]
)
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
    state = at_overlap("triangular")
    with pytest.raises(InputError, match="'finite_overlp'"):
        gp.HertzMindlin(state, finite_overlp=True)
    with pytest.raises(InputError, match=r"no keyword 'label'"):
        gp.HertzMindlin(state).set(label="x")
    with pytest.raises(InputError, match="format: found 'coo'"):
        gp.HertzMindlin(state).get_force_constants(gp.atoms(state), format="coo")


def test_state_at_several_loads_is_refused():
    several = gp.AveragedLattice(gp.Packing(STEEL, DIAMETER)).at_force([1.0, 2.0])
    for make_one in (gp.HertzMindlin, gp.atoms, gp.Phonons):
        with pytest.raises(InputError, match="the state holds 2 loads"):
            make_one(several)


@both_overlaps
@both_frictions
def test_a_cell_without_a_third_vector_is_one_of_any_height(friction, finite_overlap):
    # as ASE's reader of netCDF leaves it
    _, balls, calc = make("plane 3x3", "rough" if friction else "smooth", finite_overlap)
    balls = shaken(balls, seed=11)
    flat = balls.copy()
    flat.cell[2] = 0.0
    for name in ("energy", "forces", "stress"):
        np.testing.assert_array_equal(calc.get_property(name, flat), calc.get_property(name, balls))
    np.testing.assert_array_equal(calc.get_force_constants(flat), calc.get_force_constants(balls))
    state = calc.state
    q = [[0.1, 0.2]]
    padded, lying = (gp.Phonons(state, one) for one in (balls, flat))
    np.testing.assert_array_equal(lying.frequencies(q), padded.frequencies(q))
    assert lying.bands(npoints=3).frequencies.shape == (3, 3, 9 * (3 if friction else 2))


# -- a lattice that is turned ----------------------------------------------------------------------


def test_balls_moved_among_each_other_are_refused():
    # a ball in the hollow between others touches them in directions that are no contact's
    _, balls, calc = make("plane 3x3", "rough")
    balls.positions[4, :2] += [0.0, -np.sqrt(1.0 / 3.0)]
    with pytest.raises(InputError, match="of the lattice"):
        calc.get_property("energy", balls)


@pytest.mark.parametrize("name", ["plane vacancy", "kagome", "fcc cluster", "membrane"])
def test_smooth_balls_of_finite_overlap_turn_with_their_lattice(name):
    state, sites, calc = make(name, "smooth", True)
    balls = shaken(sites, seed=12)
    balls.set_array("displacements", balls.positions - sites.positions)
    flat = name in COORDINATES
    balls.pbc &= flat
    energy = calc.get_property("energy", balls)
    forces = calc.get_property("forces", balls).copy()
    constants = calc.get_force_constants(balls)
    c = np.cos(3.7)
    s = np.sin(3.7)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    if not flat:
        turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
    turned = balls.copy()
    turned.positions = balls.positions @ turn.T
    turned.arrays["displacements"] = balls.arrays["displacements"] @ turn.T
    turned.cell = balls.cell @ turn.T if flat else np.eye(3)  # the cell of a cluster tells nothing
    assert calc.get_property("energy", turned) == pytest.approx(energy, rel=1e-12)
    np.testing.assert_allclose(calc.get_property("forces", turned), forces @ turn.T, atol=1e-14)
    np.testing.assert_allclose(
        calc.get_force_constants(turned), turn @ constants @ turn.T, atol=1e-12
    )
    if name == "plane vacancy":  # the others have no vibrations, or no periods
        expected = gp.Phonons(state, balls).frequencies([[0.1, 0.3]])
        np.testing.assert_allclose(
            gp.Phonons(state, turned).frequencies([[0.1, 0.3]]), expected, rtol=1e-9
        )


# -- force constants of balls that are displaced, with finite overlap ------------------------------


@pytest.mark.claim("finite-overlap-exact")
def test_force_constants_around_a_relaxed_vacancy():
    state = at_overlap("triangular", relative=5e-3, friction=False, finite_overlap=True)
    balls = gp.atoms(state).repeat((5, 5, 1))
    del balls[12]
    balls.calc = calc = gp.HertzMindlin(state)
    sites = balls.positions.copy()
    with BFGS(balls, alpha=6.0, maxstep=0.01, logfile=None) as search:
        assert search.run(fmax=1e-9 * state.force / state.scales.force, steps=500)
    balls.set_array("displacements", balls.positions - sites)
    assert np.abs(balls.arrays["displacements"]).max() > 0.1 * 5e-3
    chosen = [0, 6, 12, 17]
    exact = calc.get_force_constants(balls)[:, chosen][..., :2, :2]
    coarse, fine = (differenced(calc, balls, 2, False, 5e-3 / m, chosen) for m in (40.0, 80.0))
    assert np.abs(coarse - exact).max() / np.abs(fine - exact).max() == pytest.approx(4.0, rel=0.02)
    np.testing.assert_allclose((4.0 * fine - coarse) / 3.0, exact, atol=2e-6)


def test_the_origin_of_slip_is_where_there_is_no_torque():
    _, balls, calc = make("plane 3x3", "rough")
    balls = shaken(balls, seed=15)
    balls.set_array("rotations", np.zeros(9))
    assert np.abs(calc.get_torques(balls)).max() > 1e-4
    stiff = differenced(calc, balls, 2, True, 1e-4)
    balls.set_array("slip_origin", balls.positions - make("plane 3x3", "rough")[1].positions)
    np.testing.assert_allclose(calc.get_torques(balls), 0.0, atol=1e-16)
    # what is counted from it is as stiff
    np.testing.assert_allclose(differenced(calc, balls, 2, True, 1e-4), stiff, atol=1e-8)


# -- samples of a simulation -----------------------------------------------------------------------


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
    balls = state.sample.atoms()
    sample = state.sample
    scales = state.scales
    balls.calc = gp.HertzMindlin(state)
    # the equilibrium's own residual, and what is left of overlaps when they are differences of
    # positions
    least = (1e-10 + 72 * 2e-16 * DIAMETER / sample.overlap) if overlap > 0.0 else 1e-8
    assert np.abs(balls.get_forces()).max() * scales.force < least * sample.force
    assert (
        np.abs(balls.calc.get_torques(balls)).max() * scales.energy
        < least * sample.force * DIAMETER
    )
    assert balls.get_potential_energy() * scales.energy == pytest.approx(
        sample.energy * 3 * 72, rel=1e-9
    )
    pressure = -np.mean(balls.get_stress()[:2]) * scales.modulus
    assert pressure == pytest.approx(np.sqrt(3.0) * sample.force / DIAMETER**2, rel=1e-9)
    # the mean lattice of the same state is still its own
    assert -np.mean(gp.atoms(state).get_stress()[:2]) * scales.modulus == pytest.approx(
        pressure, rel=1e-9
    )


@pytest.mark.claim("sample-at-rest")
@both_frictions
def test_force_constants_of_a_sample(friction):
    state = simulated(friction, 0.3)
    balls, calc = state.sample.atoms(), gp.HertzMindlin(state)
    lattice = calc.contact_lattice(balls)
    tensor = lattice.elastic_tensor() * state.scales.modulus
    np.testing.assert_allclose(
        tensor, state.sample.elastic_tensor, rtol=0.0, atol=1e-9 * tensor.max()
    )
    width = 3 if friction else 2
    exact = calc.get_force_constants(balls)[:, [0, 37], :width, :width]
    delta = state.relative_overlap
    errors = [
        np.abs(differenced(calc, balls, 2, friction, delta / m, [0, 37]) - exact).max()
        for m in (200.0, 400.0)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    assert errors[1] < 1e-3


def test_a_sample_of_several_is_not_their_mean():
    state = simulated(True, 0.05, samples=2)
    with pytest.raises(InputError, match=r"one sample.* 2"):
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


# -- the law of a medium ---------------------------------------------------------------------------

# wide, so that steps of a finite difference are small against it
SPREAD = gp.Uniform(0.1 * DIAMETER)
#: overlaps over the width; contacts of the mean ball are open at the last
MEAN_OVERLAPS = (0.6, pytest.param(0.2, marks=pytest.mark.slow), -0.1)
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
    np.testing.assert_allclose(
        balls.get_forces(), calculate_numerical_forces(balls, eps=1e-5), rtol=0.0, atol=2e-8
    )
    one = gp.atoms(state).repeat((2, 2, 1))
    one.calc = gp.HertzMindlin(state)
    differences = calculate_numerical_stress(one, eps=1e-5)
    np.testing.assert_allclose(
        one.get_stress()[[0, 1, 5]], differences[[0, 1, 5]], rtol=0.0, atol=2e-8
    )


@every_medium
@pytest.mark.parametrize("part", MEAN_OVERLAPS)
def test_stress_and_force_constants_of_a_medium_are_those_of_its_state(medium, part):
    state = medium_state(medium, part)
    balls = gp.atoms(state)
    pressure = -balls.get_stress()[:2] * state.scales.modulus
    np.testing.assert_allclose(pressure, state.pressure / DIAMETER, rtol=1e-12)
    assert medium(state.packing).at_pressure(state.pressure).overlap == pytest.approx(
        state.overlap, rel=1e-12
    )
    big = balls.repeat((3, 3, 1))
    constants = gp.HertzMindlin(state).get_force_constants(big)
    equal = at_overlap("triangular", friction=False)
    np.testing.assert_allclose(
        constants,
        gp.HertzMindlin(equal).get_force_constants(gp.atoms(equal).repeat((3, 3, 1))),
        rtol=0.0,
        atol=1e-13,
    )
    # a difference of the forces at an overlap that may be below zero
    slopes = differenced(gp.HertzMindlin(state), big, 2, False, 1e-5)
    np.testing.assert_allclose(constants[..., :2, :2], slopes, rtol=0.0, atol=1e-6)


@every_medium
def test_balls_with_diameters_of_their_own_have_no_mean_law(medium):
    balls = gp.atoms(medium_state(medium, 0.6)).repeat((3, 3, 1))
    balls.calc = gp.HertzMindlin(medium_state(medium, 0.6))
    balls.arrays["diameter_deviations"][0] = 1e-3
    for ask in (balls.calc.get_potential_energy, balls.calc.get_force_constants):
        with pytest.raises(InputError, match="count twice"):
            ask(balls)


def test_only_atoms_are_atoms():
    calculator = gp.HertzMindlin(gp.AveragedLattice(gp.Packing(STEEL, DIAMETER)).at_force(18.4))
    for take in (
        calculator.contact_lattice,
        calculator.adopt,
        calculator.get_torques,
        gp.HertzMindlin({"A": STEEL}).find_radii,
    ):
        with pytest.raises(InputError, match="atoms"):
            take("Fe")
    with pytest.raises(InputError, match="atoms"):
        calculator.get_torques(None)


def test_diameters_that_are_not_above_zero_are_refused():
    state = at_overlap()
    balls = gp.atoms(state)
    balls.arrays["diameter_deviations"][0] = -1.0
    with pytest.raises(InputError, match="diameter"):
        balls.get_potential_energy()
    with pytest.raises(InputError, match="like"):
        gp.HertzMindlin(state).adopt(gp.atoms(state), 5)
