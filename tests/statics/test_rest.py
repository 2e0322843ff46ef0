"""Balls, walls and a cell at rest: against closed forms, a general minimiser, and finite
differences; factors against iterations.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from scipy.optimize import minimize

import granphon as gp
from granphon.balls.hertz import HertzLaw
from granphon.base.errors import ConvergenceError, InputError, MechanismError
from granphon.contacts.assembly import Assembly
from granphon.contacts.laws import ContactLaws
from granphon.statics.configuration import AppliedLoad, Problem, list_shears
from granphon.statics.explanation import explain
from granphon.statics.find_rest import find_rest
from granphon.statics.krylov import conjugate_gradients
from granphon.statics.loose_balls import find_way_down
from granphon.statics.newton import Equations, IteratedEquations, find_strongest_push
from granphon.statics.options import RestOptions
from granphon.statics.rest import Rest
from granphon.statics.turning_descent import TurningDescent

STEEL = gp.Material(211.65e9, 0.276, 7840.0)

D = 8e-3
BALL = gp.Ball(STEEL, D, spread=gp.Uniform(4e-6))
NEVER = {1: 2**62, 2: 2**62, 3: 2**62}
ALWAYS = {1: 0, 2: 0, 3: 0}


def make_sample(lattice="triangular", shape=(5, 4), seed=2):
    return gp.Crystal.on(lattice, [BALL]).sample(shape, seed=seed)


def make_slab():
    """Balls that differ between a floor and a wall that moves, in a cell that strains."""
    return make_sample(shape=(4, 1)).cut(1, 4, edges=("floor", "clamped"))


def press(assembly, pressure):
    """Return the load of a pressure on the cell and on walls."""
    p = assembly.periods
    on_walls = np.full(assembly.n_walls, -pressure * D)
    force = np.append(np.zeros(assembly.n_balls * assembly.dimension), on_walls)
    stress = -pressure * np.eye(p)
    return AppliedLoad(force, "a pressure", stress, np.zeros((p, p)), force)


def find_energy(problem, x):
    """The energy of the contacts less the work of the load, where the cell keeps its measure."""
    configuration = problem.start_at(x)
    energy = np.sum(problem.assembly.laws.energy(configuration.overlap))
    return energy - problem.force @ x


@pytest.mark.parametrize(("periods", "count"), [(0, 0), (1, 0), (2, 2), (3, 5)])
def test_shears_keep_the_size_of_a_cell_and_are_orthogonal(periods, count):
    shears = list_shears(periods)
    assert shears.shape == (count, periods, periods)
    assert_allclose(np.trace(shears, axis1=1, axis2=2), 0.0, atol=0.0)
    products = np.einsum("sab,tab->st", shears, shears)
    assert_allclose(products, np.diag(np.diagonal(products)), atol=0.0)


@pytest.mark.parametrize("law", [gp.DMT(1e-9), gp.JKR(1e-9)])
def test_contacts_that_adhere_do_not_keep_others_closed(law):
    """Adhesion that is next to nothing leaves the forces as they are, where contacts open too."""
    kinds = [replace(BALL, name="A"), replace(BALL, name="B")]
    cell = np.diag([D, 2.0 * D])
    sites = [[0.0, 0.0], [0.0, D]]
    forces = []
    for between in (gp.Hertz(), law):
        laws = {("A", "A"): gp.Hertz(), ("B", "B"): gp.Hertz(), ("A", "B"): between}
        sample = gp.Crystal(kinds, cell, sites, law=laws, friction=False).sample((6, 3), seed=1)
        assembly = sample._assembly
        rest = find_rest(assembly, press(assembly, 100.0))
        forces.append(assembly.laws.force(rest.overlap))
    without, with_adhesion = forces
    assert 0 < np.count_nonzero(without > 0.0) < len(without)
    assert_allclose(with_adhesion, without, atol=1e-6 * np.max(without))


@pytest.mark.parametrize("geometry", ["lattice", "exact"])
def test_forces_left_are_derivatives_of_the_energy_and_the_tangent_theirs(geometry):
    assembly = make_slab()._assembly
    load = press(assembly, 1e3)
    # the work of a stress on a cell that deforms is none of an energy that is linear in strains
    free = AppliedLoad(load.force, "", 0.0 * load.stress, load.strain, 0.0 * load.force)
    problem = Problem(assembly, free, geometry, "stress")
    rng = np.random.default_rng(0)
    x = 1e-6 * rng.normal(size=problem.size)
    x[-len(problem.unit_strains) :] = -1e-5 * math.sqrt(assembly.n_contacts)
    step = 1e-9
    directions = step * rng.normal(size=(6, problem.size))
    here = problem.start_at(x)
    linear = Equations(problem, RestOptions()).linearise(here, here.stiffness)
    n = problem.n_ball_unknowns
    whole = np.block([[linear.matrix.toarray(), linear.border], [linear.border.T, linear.corner]])
    for direction in directions:
        change = find_energy(problem, x + direction) - find_energy(problem, x - direction)
        assert -2.0 * here.pull @ direction == pytest.approx(change, rel=1e-6)
        turn = problem.start_at(x - direction).pull - problem.start_at(x + direction).pull
        scale = np.max(np.abs(turn))
        assert_allclose(2.0 * whole @ direction, turn, rtol=0.0, atol=1e-5 * scale)
    assert n == 2 * assembly.n_balls


def test_losses_and_forces_are_products_of_one_matrix():
    """The matrix, which linear programs take, against the loops over contacts."""
    assembly = make_slab()._assembly
    problem = Problem(assembly, press(assembly, 1e3), "lattice", "stress")
    losses = problem.make_losses()
    rng = np.random.default_rng(0)
    motion = rng.normal(size=problem.size)
    loss = problem.measure_losses(motion)
    assert_allclose(losses @ motion, loss, rtol=0.0, atol=1e-14 * np.max(np.abs(loss)))
    force = rng.normal(size=assembly.n_contacts)
    on_unknowns = problem.collect_forces(assembly.normal, force)
    assert_allclose(losses.T @ force, on_unknowns, rtol=0.0, atol=1e-13)


def test_products_without_a_matrix_are_those_of_the_matrix():
    assembly = make_slab()._assembly
    problem = Problem(assembly, press(assembly, 1e3), "lattice", "stress")
    here = problem.start_at(np.random.default_rng(1).normal(scale=1e-6, size=problem.size))
    stiffness = here.stiffness + np.max(here.stiffness)
    pull = np.random.default_rng(2).normal(size=problem.size)
    by_factors = Equations(problem, RestOptions()).solve(here, stiffness, pull)
    iterated = IteratedEquations(problem, RestOptions())
    by_iteration, has_converged = iterated.solve(here, stiffness, pull, 1e-13, 1000)
    assert has_converged
    limit = 1e-8 * np.max(np.abs(by_factors))
    assert_allclose(by_iteration, by_factors, rtol=0.0, atol=limit)


@pytest.mark.parametrize(
    ("lattice", "shape", "pressure"), [("triangular", (8, 8), 300.0), ("fcc", (3, 3, 3), 1e5)]
)
def test_factors_and_iterations_come_to_the_same_rest(lattice, shape, pressure):
    assembly = make_sample(lattice, shape)._assembly
    load = press(assembly, pressure)
    forces = []
    for options in (
        RestOptions(fewest_balls=NEVER),
        RestOptions(most_balls=ALWAYS),
        RestOptions(fewest_balls=ALWAYS, patience_of_iterations=ALWAYS),
    ):
        rest = find_rest(assembly, load, options=options)
        assert rest.residual <= 1e-12
        forces.append(assembly.laws.force(rest.overlap))
    limit = 1e-11 * np.max(forces[0])
    assert_allclose(forces[1], forces[0], rtol=0.0, atol=limit)
    assert_allclose(forces[2], forces[0], rtol=0.0, atol=limit)
    assert np.any(forces[0] == 0.0)


def test_that_a_crystal_stands_is_noted_only_where_it_is_tested():
    assembly = make_sample()._assembly
    problem = Problem(assembly, press(assembly, 1e3), "exact", "stress")
    start = Rest.of(problem.start_at(np.zeros(problem.size)))
    none = dict.fromkeys((1, 2, 3), 0)
    TurningDescent(problem, RestOptions(most_balls=none)).begin(start)
    assert assembly.standing == set()
    TurningDescent(problem, RestOptions()).begin(start)
    assert assembly.standing == {len(problem.unit_strains)}


@pytest.mark.parametrize("finite_overlap", [False, True])
def test_balls_that_differ_come_to_rest_in_a_cell_that_is_not_strained(finite_overlap):
    sample = make_sample().remove([3])
    state = sample.at_strain(np.zeros((2, 2)), finite_overlap=finite_overlap)
    assert state.network.imbalance[2] < 1e-10
    assert np.any(state.normal_force > 0.0)


@pytest.mark.parametrize("geometry", ["lattice", "exact"])
def test_a_cell_that_keeps_its_shape_takes_the_pressure(geometry):
    assembly = make_sample()._assembly
    load = press(assembly, 2e3)
    rest = find_rest(assembly, load, geometry, "isotropic")
    assert_allclose(rest.strain, rest.strain[0, 0] * np.eye(2), rtol=0.0, atol=1e-18)
    deformed = np.eye(2) + (rest.strain if geometry == "exact" else 0.0)
    force = assembly.laws.force(rest.overlap)[:, None] * rest.normal
    virial = force.T @ assembly.vector[:, :2] @ deformed.T
    measure = assembly.measure * np.linalg.det(deformed)
    assert np.trace(virial) / measure == pytest.approx(2.0 * 2e3, rel=1e-12)
    # the shape resists: the stress differs from a pressure
    assert abs(virial[0, 0] - virial[1, 1]) > 1e-4 * virial[0, 0]
    # the same strain, given
    given = AppliedLoad(load.force, "", None, rest.strain, load.force)
    again = find_rest(assembly, given, geometry)
    assert_allclose(again.overlap, rest.overlap, rtol=0.0, atol=1e-10 * np.max(rest.overlap))


@pytest.mark.claim("rest-is-minimum")
def test_exact_rest_is_the_minimum_that_scipy_finds():
    assembly = make_sample(shape=(3, 3))._assembly
    strain = -2e-3 * np.array([[1.0, 0.1], [0.1, 0.7]])
    nothing = np.zeros(2 * assembly.n_balls)
    load = AppliedLoad(nothing, "a strain", None, strain, nothing)
    rest = find_rest(assembly, load, "exact")
    problem = Problem(assembly, load, "exact", "stress")
    length = float(np.mean(rest.overlap))
    unit = float(np.mean(assembly.laws.force(rest.overlap)))

    def energy(x):
        place = problem.start_at(length * x)
        value = np.sum(assembly.laws.energy(place.overlap)) / (unit * length)
        return value, -place.pull / unit

    answer = minimize(energy, nothing, jac=True, method="BFGS", options={"gtol": 1e-10})
    overlap = problem.start_at(length * answer.x).overlap
    assert_allclose(overlap, rest.overlap, rtol=0.0, atol=1e-6 * length)


def make_triangle():
    """A ball on two that are held, of equal Hertz contacts."""
    angles = np.radians([60.0, 120.0])
    vector = np.zeros((2, 3))
    vector[:, 0] = D * np.cos(angles)
    vector[:, 1] = -D * np.sin(angles)
    return Assembly(
        n_balls=1,
        i=np.zeros(2, np.int64),
        j=np.ones(2, np.int64),
        vector=vector,
        is_flat=np.zeros(2, bool),
        offset=np.full(2, 1e-9),
        laws=ContactLaws([(HertzLaw(1e9), np.arange(2))], 2),
        cell=np.zeros((0, 0)),
        dimension=2,
        directions=np.zeros((0, 2)),
        wall_balls=np.zeros(0),
    )


def test_a_ball_leans_on_two_that_are_held():
    load = AppliedLoad(np.array([0.0, -3.0]), "a weight", None, np.zeros((0, 0)), np.zeros(2))
    assembly = make_triangle()
    rest = find_rest(assembly, load)
    assert_allclose(assembly.laws.force(rest.overlap), 3.0 / math.sqrt(3.0), rtol=1e-13)
    exact = find_rest(assembly, load, "exact")
    height = D * math.sqrt(0.75) + exact.displacement[0, 1]
    slope = height / math.hypot(0.5 * D, height)
    assert_allclose(2.0 * slope * assembly.laws.force(exact.overlap), 3.0, rtol=1e-12)
    sideways = AppliedLoad(np.array([3.0, 0.0]), "a push", None, np.zeros((0, 0)), np.zeros(2))
    with pytest.raises(InputError, match="cannot bear a push"):
        find_rest(assembly, sideways)


def test_balls_leave_a_saddle_of_the_energy():
    """A ball pressed between two that are held, in line with it, is at a saddle."""
    vector = np.zeros((2, 3))
    vector[:, 0] = [D, -D]
    assembly = Assembly(
        n_balls=1,
        i=np.zeros(2, np.int64),
        j=np.ones(2, np.int64),
        vector=vector,
        is_flat=np.zeros(2, bool),
        offset=np.full(2, 1e-6),
        laws=ContactLaws([(HertzLaw(1e9), np.arange(2))], 2),
        cell=np.zeros((0, 0)),
        dimension=2,
        directions=np.zeros((0, 2)),
        wall_balls=np.zeros(0),
    )
    load = AppliedLoad(np.zeros(2), "", None, np.zeros((0, 0)), np.zeros(2))
    problem = Problem(assembly, load, "exact", "stress")
    saddle = problem.start_at(np.zeros(2))
    assert saddle.residual == 0.0
    below = find_way_down(saddle, Equations(problem, RestOptions()))
    assert below is not None
    energies = [np.sum(assembly.laws.energy(place.overlap)) for place in (saddle, below)]
    assert energies[1] < energies[0]
    assert abs(below.x[1]) > 1e3 * abs(below.x[0])
    minimum = make_sample(shape=(3, 3))._assembly
    pressed = press(minimum, 1e4)
    at_rest = find_rest(minimum, pressed, "exact")
    problem = Problem(minimum, pressed, "exact", "stress")
    strains = at_rest.strain[[0, 0, 1], [0, 1, 1]] * problem.length
    place = problem.start_at(np.concatenate([at_rest.displacement.ravel(), strains]))
    assert find_way_down(place, Equations(problem, RestOptions())) is None


def test_a_square_lattice_that_differs_is_a_mechanism():
    assembly = make_sample("square", (3, 3))._assembly
    with pytest.raises(MechanismError):
        find_rest(assembly, press(assembly, 1e3), "exact")


def test_conjugate_gradients_solve_and_say_whether_they_do():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(12, 12))
    matrix = root @ root.T + np.eye(12)
    right = rng.normal(size=12)
    diagonal = np.diagonal(matrix)
    solve = (matrix.__matmul__, lambda vector: vector / diagonal)
    solution, has_converged = conjugate_gradients(*solve, right, 1e-13, 0.0, 100)
    assert has_converged
    assert_allclose(solution, np.linalg.solve(matrix, right), rtol=1e-10)
    _, has_converged = conjugate_gradients(*solve, right, 1e-13, 0.0, 3)
    assert not has_converged
    # three different eigenvalues take three iterations, of which the last counts
    scales = np.array([1.0, 2.0, 3.0])
    by_scales = (scales.__mul__, np.copy)
    assert not conjugate_gradients(*by_scales, np.ones(3), 1e-12, 0.0, 2)[1]
    solution, has_converged = conjugate_gradients(*by_scales, np.ones(3), 1e-12, 0.0, 3)
    assert has_converged
    assert_allclose(solution, 1.0 / scales, rtol=1e-12)


def make_ring():
    """Four balls of different radii on a line that repeats: all contacts carry the same force."""
    ends = np.arange(4)
    return Assembly(
        n_balls=4,
        i=ends,
        j=(ends + 1) % 4,
        vector=np.tile([1.0, 0.0, 0.0], (4, 1)),
        is_flat=np.zeros(4, bool),
        offset=np.array([0.0, 0.01, -0.005, 0.002]),
        laws=ContactLaws([(HertzLaw(1.0), ends)], 4),
        cell=np.array([[4.0]]),
        dimension=1,
        directions=np.zeros((0, 1)),
        wall_balls=np.zeros(0),
    )


def test_a_list_goes_on_from_a_rest_at_another_strain_and_takes_a_mean_force():
    """The mean overlap is that on the sites, and what the strain adds."""
    ring = make_ring()
    none = np.zeros(4)

    def strain(size):
        return AppliedLoad(none, "a strain", None, np.array([[-size]]), none)

    start = find_rest(ring, strain(0.05))
    for begin in (None, start):
        rest = find_rest(ring, strain(0.1), start=begin)
        assert_allclose(rest.overlap, 0.1 + np.mean(ring.offset), rtol=1e-12)
    load = AppliedLoad(none, "a mean force", None, np.zeros((1, 1)), none, mean_force=0.01)
    assert_allclose(ring.laws.force(find_rest(ring, load).overlap), 0.01, rtol=1e-9)


@pytest.mark.parametrize(("status", "kind"), [(2, InputError), (4, ConvergenceError)])
def test_a_load_counts_as_too_much_only_where_that_is_proven(monkeypatch, status, kind):
    """A linear programme may end without an answer: 4 is the status of numerical difficulties."""
    answer = SimpleNamespace(status=status, success=False)
    monkeypatch.setattr("scipy.optimize.linprog", lambda *_, **__: answer)
    force = np.array([1.0, -1.0, 0.0, 0.0])
    load = AppliedLoad(force, "two forces", None, np.zeros((1, 1)), np.zeros(4))
    problem = Problem(make_ring(), load, "lattice", "stress")
    assert isinstance(explain(problem, RestOptions()), kind)


def test_contacts_that_pull_do_not_lower_the_bound_of_pushes():
    """A ball between one that presses and one that pulls as much is pushed by the first alone."""
    none = np.zeros(4)
    load = AppliedLoad(none, "no load", None, np.zeros((1, 1)), none)
    problem = Problem(make_ring(), load, "exact", "stress")
    configuration = problem.start_at(np.zeros(4))
    configuration.force = np.array([2.0, -2.0, 0.0, 0.0])
    assert find_strongest_push(configuration) == 4.0


@pytest.mark.claim("sample-is-array")
@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize(("lattice", "shape"), [("triangular", (10, 10)), ("fcc", (4, 4, 4))])
def test_a_sample_of_a_crystal_is_the_array_of_the_same_balls(lattice, shape, exact):
    """On a boundary that keeps its shape; where the whole stress is hydrostatic it changes."""
    spread = gp.Uniform(2.04e-6)
    packing = gp.Packing(STEEL, 8e-3, spread=spread, lattice=lattice)
    pressure = 5.0 * packing.pressure_per_force
    geometry = "exact" if exact else "lattice"
    array = gp.DirectSimulation(packing, shape, seed=3, geometry=geometry).at_pressure(pressure)
    sample = gp.Crystal.on(lattice, [gp.Ball(STEEL, 8e-3, spread=spread)]).sample(shape, seed=3)
    state = sample.at_pressure(pressure, finite_overlap=exact, boundary="isotropic")
    forces = np.sort(np.ravel(array.sample.contact_forces))
    assert np.any(forces == 0.0)
    atol = 1e-10 * np.mean(forces)
    np.testing.assert_allclose(np.sort(state.normal_force), forces, rtol=0.0, atol=atol)
    np.testing.assert_allclose(np.trace(state.stress) / len(shape), -pressure, rtol=1e-12)
    sheared = sample.at_pressure(pressure, finite_overlap=exact)
    np.testing.assert_allclose(sheared.stress, -pressure * np.eye(len(shape)), atol=1e-9 * pressure)
    assert np.max(np.abs(np.sort(sheared.normal_force) - forces)) > 1e-4 * np.mean(forces)
    by_force = sample.at_force(array.force, finite_overlap=exact, boundary="isotropic")
    np.testing.assert_allclose(by_force.normal_force, state.normal_force, atol=10.0 * atol)


@pytest.mark.claim("sample-is-array")
@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize(("lattice", "shape"), [("triangular", (10, 10)), ("fcc", (4, 4, 4))])
def test_an_array_that_shears_is_the_sample_of_a_crystal(lattice, shape, exact):
    """By default the stress of a crystal is hydrostatic; so is that of an array that asks for it,
    under a given pressure, mean force or overlap.
    """
    spread = gp.Uniform(2.04e-6)
    packing = gp.Packing(STEEL, 8e-3, spread=spread, lattice=lattice)
    pressure = 5.0 * packing.pressure_per_force
    geometry = "exact" if exact else "lattice"
    simulation = gp.DirectSimulation(packing, shape, 3, geometry=geometry, boundary="stress")
    array = simulation.at_pressure(pressure)
    assert array.pressure == pytest.approx(pressure, rel=1e-11)
    sample = gp.Crystal.on(lattice, [gp.Ball(STEEL, 8e-3, spread=spread)]).sample(shape, seed=3)
    expected = np.sort(sample.at_pressure(pressure, finite_overlap=exact).normal_force)
    assert np.any(expected == 0.0)
    for state in (
        array,
        simulation.at_force(array.force),
        simulation.at_overlap(array.overlap),
    ):
        forces = np.sort(np.ravel(state.sample.contact_forces))
        np.testing.assert_allclose(forces, expected, rtol=0.0, atol=1e-10 * np.mean(expected))
    # the network has the cell and the stress of the sample
    network = array.sample.network
    stress = np.einsum("c,ca,cb->ab", network.normal_force, network.normal, network.vector)
    p = len(shape)
    measure = abs(np.linalg.det(network.cell[:p, :p]))
    hydrostatic = pressure * measure * np.eye(p)
    np.testing.assert_allclose(stress[:p, :p], hydrostatic, rtol=0.0, atol=1e-9 * hydrostatic[0, 0])


@pytest.mark.parametrize("geometry", ["lattice", "exact"])
@pytest.mark.parametrize(("lattice", "shape"), [("triangular", (6, 5)), ("fcc", (3, 3, 3))])
def test_stiffnesses_of_an_array_that_shears_are_derivatives(lattice, shape, geometry):
    """Of the mean force by the overlap, as the cell shears on the way."""
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-4), lattice=lattice)
    simulation = gp.DirectSimulation(packing, shape, 1, geometry=geometry, boundary="stress")
    overlap = 1.5 * packing.width
    change = 1e-4 * packing.width
    below, state, above = simulation.at_overlap(overlap + change * np.array([-1.0, 0.0, 1.0]))
    sample = state.sample
    assert np.all(sample.contact_forces > 0.0)
    rise = (above.force - below.force) / (2.0 * change)
    assert sample.normal_stiffness == pytest.approx(rise, rel=1e-7)
    rise = (above.normal_stiffness - below.normal_stiffness) / (2.0 * change)
    assert sample.stiffness_slope == pytest.approx(rise, rel=1e-6)
    kept = gp.DirectSimulation(packing, shape, 1, geometry=geometry).at_overlap(overlap)
    assert sample.stiffness_slope != pytest.approx(kept.sample.stiffness_slope, rel=1e-6)


def test_a_calculator_does_not_take_a_cell_that_sheared():
    """Its contacts have slipped nowhere, which the Atoms cannot say."""
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2.04e-6))
    simulation = gp.DirectSimulation(packing, (4, 4), geometry="lattice", boundary="stress")
    state = simulation.at_force(1.0)
    balls = state.sample.atoms()
    balls.calc = gp.HertzMindlin(state)
    with pytest.raises(InputError, match="sheared"):
        balls.get_forces()


def test_a_run_keeps_an_array_that_shears(tmp_path):
    """A folder of one state has the sample itself, and is drawn anew from it."""
    text = """
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 2 um}}
load: {pressure: 3 kN/m}
medium: {simulation: {shape: 4 4, boundary: stress}}
"""
    scene = gp.Scene.from_text(text)
    scene.run(tmp_path, figures=False)
    summary = yaml.safe_load((tmp_path / "summary.yaml").read_text())
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))
    state = gp.DirectSimulation(packing, (4, 4), boundary="stress").at_pressure(3e3)
    assert summary["normal_stiffness"] == pytest.approx(state.normal_stiffness, rel=1e-9)
    kept = gp.DirectSimulation(packing, (4, 4)).at_pressure(3e3)
    assert state.normal_stiffness != pytest.approx(kept.normal_stiffness, rel=1e-7)


def test_a_boundary_has_one_of_two_words():
    crystal = gp.Crystal.on("triangular", [gp.Ball(STEEL, 8e-3)])
    with pytest.raises(InputError, match="isotropic, stress"):
        crystal.at_pressure(1.0, boundary="isotropc")
    with pytest.raises(InputError, match="isotropic, stress"):
        crystal.at_force(1.0, boundary=["stress"])
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))
    with pytest.raises(InputError, match="isotropic, stress"):
        gp.DirectSimulation(packing, boundary="shear")
    with pytest.raises(InputError, match="friction_history"):
        gp.DirectSimulation(
            packing, friction_history=True, friction_coefficient=0.2, boundary="stress"
        )


def test_a_search_that_stops_early_names_the_contact_that_is_nearest_to_breaking():
    """A ball that hangs on two, by less than the contacts bear, after one step of many."""
    law = gp.JKR(0.05).between(*[gp.Ball(gp.Material(1e6, 0.49, 1100.0), D)] * 2)
    assembly = replace(make_triangle(), laws=ContactLaws([(law, np.arange(2))], 2))
    most = -law.force(law.least_overlap)
    weight = np.array([0.1 * most, 1.5 * most])
    load = AppliedLoad(weight, "a weight", None, np.zeros((0, 0)), np.zeros(2))
    pulls = -assembly.laws.force(find_rest(assembly, load).overlap)
    assert np.all(pulls < most)
    with pytest.raises(ConvergenceError, match=r"weight.*Contact 1.*breaking") as caught:
        find_rest(assembly, load, options=RestOptions(steps=1))
    assert f"{most:.6g} N" in str(caught.value)
    pressed = replace(load, force=-weight)
    with pytest.raises(ConvergenceError, match="weight") as caught:
        find_rest(assembly, pressed, options=RestOptions(steps=1))
    assert "breaking" not in str(caught.value)
