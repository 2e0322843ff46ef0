"""The calculator of a network of contacts: slopes of its energy, its vibrations, and two other ways
to the same numbers.
"""

from dataclasses import replace

import ase.vibrations
import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError

STEEL = gp.Material(193e9, 0.30, 8000.0)
A = gp.Ball(STEEL, 8e-3, name="A")
B = gp.Ball(STEEL, 8e-3, mass=1e-3, name="B")


def square(**options):
    large = gp.Ball(STEEL, 8e-3)
    small = gp.Ball(STEEL, (np.sqrt(2.0) - 1.0) * 8e-3)
    return gp.Crystal(
        [large, small], np.diag([8e-3, 8e-3]), [[0, 0], [4e-3, 4e-3]], **options
    ).at_pressure(10.0)


def tilted(network):
    """The network turned about z: its periods leave x and the plane of x and y stays."""
    c = np.cos(0.4)
    s = np.sin(0.4)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    fields = {name: getattr(network, name) @ turn for name in ("cell", "positions", "normal")}
    return replace(network, lattice=None, shape=None, **fields)


def strip():
    return (
        gp.Crystal.on("triangular", [A])
        .repeat((2, 1))
        .replace(1, B)
        .cut(1, 3, ("floor", "clamped"))
        .at_pressure(10.0)
    )


def anchored():
    """Balls in the plane with springs to the ground against each of their motions."""
    network = square(friction=True).network
    springs = [[1e6, 2e6, 3.0], [4e6, 5e6, 6.0]]
    return replace(network, on_site=springs)


CASES = {
    "chain": lambda: gp.Crystal.on("chain", [A, B]).at_force(20.0),
    "plane": square,
    "bending": lambda: square(motions="all", bending=0.01, torsion=0.02),
    "out of plane": lambda: square(motions="out_of_plane"),
    "salt": lambda: gp.Crystal.on("NaCl", [A, B]).at_pressure(1e5),
    "finite overlap": lambda: (
        gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="fcc", friction=False))
        .at_overlap(4e-6, finite_overlap=True)
        .network.repeat((2, 1, 1))
    ),
    "turned": lambda: tilted(square().network),
    "held": strip,
    "springs to the ground": anchored,
}
#: cases whose balls are held, so that they have no stress
HELD = ("held", "springs to the ground")


def shaken(case, size=1e-3):
    """The Atoms of a case with small displacements, rotations and, where nothing holds it, a
    strain.
    """
    atoms, rng = gp.atoms(CASES[case]()), np.random.default_rng(5)
    if case not in HELD:
        strain = np.zeros((3, 3))
        p = int(np.sum(atoms.pbc))
        strain[:p, :p] = size * rng.normal(size=(p, p))
        atoms.set_cell(atoms.cell @ (np.eye(3) + strain), scale_atoms=True)
    atoms.positions += size * rng.normal(size=(len(atoms), 3))
    if atoms.has("rotations"):
        atoms.arrays["rotations"] += size * rng.normal(size=atoms.arrays["rotations"].shape)
    return atoms


def slope(atoms, change, step=1e-4):
    """Central difference of the energy; of a quadratic one it has the error of rounding alone."""
    energies = []
    for sign in (step, -step):
        one = atoms.copy()
        one.calc = atoms.calc
        change(one, sign)
        energies.append(one.get_potential_energy())
    return (energies[0] - energies[1]) / (2.0 * step)


@pytest.mark.parametrize("case", CASES)
def test_forces_torques_and_stress_are_slopes_of_the_energy(case):
    atoms = shaken(case)
    forces = atoms.get_forces()
    torques = atoms.calc.get_torques(atoms)
    for ball, axis in np.ndindex(len(atoms), 3):

        def shift(one, step, at=(ball, axis)):
            one.positions[at] += step

        assert -slope(atoms, shift) == pytest.approx(forces[ball, axis], abs=1e-10)
        if atoms.has("rotations") and (atoms.arrays["rotations"].ndim == 2 or axis == 2):

            def turn(one, step, at=(ball, axis) if atoms.arrays["rotations"].ndim == 2 else ball):
                one.arrays["rotations"][at] += step

            assert -slope(atoms, turn) == pytest.approx(torques[ball, axis], abs=1e-10)
    p = int(np.sum(atoms.pbc))
    volume = abs(np.linalg.det(atoms.cell.array[:p, :p]))
    if case in HELD:
        fresh = shaken(case)
        with pytest.raises(InputError, match=r"no stress .*springs to the ground"):
            fresh.get_stress()
        assert not fresh.calc.results  # nothing was found before
        return
    stress = atoms.get_stress(voigt=False)
    for axes in np.ndindex(p, p):

        def strain(one, step, axes=axes):
            e = np.zeros((3, 3))
            e[axes] = e[axes[::-1]] = step if axes[0] == axes[1] else 0.5 * step
            one.set_cell(one.cell @ (np.eye(3) + e), scale_atoms=True)

        assert slope(atoms, strain) / volume == pytest.approx(stress[axes], abs=1e-9)


@pytest.mark.parametrize("case", ["plane", "salt", "turned", "held"])
def test_at_rest_there_is_no_force_and_the_stress_is_that_of_the_state(case):
    state = CASES[case]()
    atoms = gp.atoms(state)
    assert atoms.get_potential_energy() == 0.0
    assert not np.any(atoms.get_forces())
    if case != "held":
        p = int(np.sum(atoms.pbc))
        pressure = {"plane": 10.0, "turned": 10.0, "salt": 1e5}[case]
        unit = atoms.calc.state.scales.modulus * (atoms.calc.state.scales.length if p == 2 else 1.0)
        assert_allclose(
            atoms.get_stress(voigt=False)[:p, :p] * unit,
            -pressure * np.eye(p),
            atol=1e-9 * pressure,
        )


def test_springs_to_the_ground_pull_balls_that_move_and_turn_together_back():
    """No contact deforms where all balls move alike: the springs alone act, as in SI."""
    network = anchored()
    atoms = gp.atoms(network)
    scales = atoms.calc.state.scales
    shift = np.array([1e-4, -2e-4, 0.0])
    atoms.positions += shift
    force = -network.on_site[:, :2] / scales.stiffness * shift[:2]
    assert_allclose(atoms.get_forces()[:, :2], force, rtol=1e-9)
    energy = -0.5 * np.sum(force * shift[:2])
    assert atoms.get_potential_energy() == pytest.approx(energy, rel=1e-9)


def test_vibrations_of_ase_are_the_modes_of_a_supercell(tmp_path):
    """ase.vibrations moves the balls; the waves of two by two cells are the phonons at four wave
    vectors.
    """
    state = square(friction=False)
    atoms = gp.atoms(state.network.repeat((2, 2)))
    vibrations = ase.vibrations.Vibrations(atoms, name=str(tmp_path / "vib"), delta=1e-3)
    vibrations.run()
    squares = np.linalg.eigvalsh(
        vibrations.get_vibrations().get_hessian_2d()
        / np.sqrt(np.outer(*[np.repeat(atoms.get_masses(), 3)] * 2))
    )
    found = np.sqrt(np.maximum(squares, 0.0))[len(atoms) :]  # balls do not move along z
    wanted = (
        gp.Phonons(state).frequencies([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [0.5, 0.5]])
        / state.scales.frequency
    )
    assert_allclose(found, np.sort(wanted.ravel()), atol=1e-6)


def test_small_displacements_have_the_forces_of_the_contact_law():
    """Hertz's law of a packing, by the other calculator: equal but for the square of displacement
    over overlap.
    """
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="hcp")).at_overlap(8e-5)
    own = gp.atoms(state)
    network = gp.atoms(state.network)
    move = np.random.default_rng(2).normal(size=own.positions.shape)
    errors = []
    for size in (1e-5, 1e-6):
        forces = []
        for atoms in (own.copy(), network.copy()):
            atoms.calc = own.calc if len(forces) == 0 else network.calc
            atoms.positions += size * move
            atoms.arrays["rotations"] = atoms.arrays["rotations"] + size * move[::-1]
            forces.append(np.stack([atoms.get_forces(), atoms.calc.get_torques(atoms)]))
        errors.append(np.max(np.abs(forces[0] - forces[1])) / np.max(np.abs(forces[0])))
    assert errors[0] < 2e-2
    assert errors[1] == pytest.approx(errors[0] / 10.0, rel=0.1)


def test_whole_periods_count_nothing_and_other_balls_are_refused():
    atoms = gp.atoms(square())
    atoms.positions[1] += 1e-3
    energy = atoms.get_potential_energy()
    moved = atoms.copy()
    moved.calc = atoms.calc
    moved.positions[0] += 2.0 * atoms.cell[0] - atoms.cell[1]
    assert moved.get_potential_energy() == pytest.approx(energy, rel=1e-9)
    assert gp.Waves(atoms).network == square().network
    two = gp.atoms(square().network.repeat((1, 2)))
    other = two[[2, 1, 0, 3]]  # the order of two equal balls is another
    other.calc = two.calc
    with pytest.raises(InputError, match=r"0\.5 diameters.*order"):
        other.get_forces()
    for wrong in (atoms.repeat((2, 1, 1)), atoms[[0]], atoms[::-1]):
        wrong.calc = atoms.calc
        with pytest.raises(InputError, match=r"2 balls .*network\.repeat"):
            wrong.get_potential_energy()


def test_numbers_that_are_not_finite_and_rotations_of_another_shape_are_refused():
    at_rest = gp.atoms(square())
    for name in ("positions", "rotations"):
        balls = at_rest.copy()
        balls.calc = at_rest.calc
        balls.arrays[name][0] = np.nan
        with pytest.raises(InputError, match="not finite"):
            balls.get_potential_energy()
    balls = at_rest.copy()
    balls.calc = at_rest.calc
    balls.arrays["rotations"] = np.zeros((len(balls), 2))
    with pytest.raises(InputError, match="shape"):
        balls.get_potential_energy()
    flat = at_rest.copy()
    flat.calc = at_rest.calc
    flat.set_cell([flat.cell[0], 2.0 * flat.cell[0], flat.cell[2]])
    with pytest.raises(InputError, match="not independent"):
        flat.get_potential_energy()
    for no_atoms in (5, [balls]):
        with pytest.raises(InputError, match="Atoms"):
            balls.calc.contact_network(no_atoms)
        with pytest.raises(InputError, match="Atoms"):
            balls.calc.get_torques(no_atoms)
