"""Designs with known answers: a gap, stiffnesses, a load; and what is refused or said."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.dynamics.sensitivities import list_inertias
from granphon.inverse.search import Parameters
from tests.dynamics.test_network_lattice import random_network
from tests.dynamics.test_sensitivities import changes, difference

BALL = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 19e-3)


@pytest.fixture(scope="module")
def chain():
    """A chain whose cell has two equal balls."""
    return gp.Crystal.on("chain", [BALL, BALL], friction=False).at_force(20.0).network


@pytest.mark.claim("design-gap")
def test_the_widest_gap_of_a_chain_of_two_masses_of_given_sum(chain):
    """The gap is from (2k/m)^1/2 of the larger mass to that of the smaller one: the extreme ratio
    is best.
    """
    mass = chain.masses[0]
    bounds = (0.3 * mass, 1.8 * mass)
    best = gp.design(chain, gp.WidestGap(), bounds=bounds, constraints={"mass": 2.0 * mass})
    assert_allclose(np.sort(best.variables), [0.3 * mass, 1.7 * mass], rtol=1e-9)
    k = chain.normal_stiffness[0]
    gap = (math.sqrt(2.0 * k / (0.3 * mass)) - math.sqrt(2.0 * k / (1.7 * mass))) / (2.0 * math.pi)
    assert_allclose(best.value, gap, rtol=1e-9)
    assert best.warnings == ()
    assert len(best.history) <= best.evaluations
    assert_allclose(best.network.inertias / best.network.masses, chain.inertias / chain.masses)
    again = type(best).from_dict(best.to_dict())
    assert again == best


@pytest.mark.claim("design-match")
def test_stiffnesses_are_recovered_from_the_twenty_lowest_frequencies():
    """Twelve contacts of eight balls, which move and turn in a plane."""
    wanted = random_network("honeycomb", (2, 2), seed=1)
    measured = gp.Waves(wanted).modes(20).frequencies
    k = wanted.normal_stiffness
    assert k.size == 12
    wrong = k * np.random.default_rng(2).uniform(0.8, 1.25, k.size)
    start = replace(wanted, normal_stiffness=wrong)
    bounds = (0.5 * np.min(k), 2.0 * np.max(k))
    goal = gp.MatchFrequencies(measured)
    found = gp.design(start, goal, "normal_stiffness", bounds, restarts=0)
    assert found.value < 1e-20
    assert found.warnings == ()
    assert_allclose(found.variables, k, rtol=1e-7)


@pytest.mark.claim("design-shapes")
def test_shapes_tell_which_mode_a_frequency_belongs_to():
    """From stiffnesses that are up to four times off, in any order and scale of the modes."""
    wanted = random_network("honeycomb", (2, 2), seed=1)
    modes = gp.Waves(wanted).modes(20)
    random = np.random.default_rng(3)
    k = wanted.normal_stiffness
    start = replace(wanted, normal_stiffness=k * 4.0 ** random.uniform(-1.0, 1.0, k.size))
    order = random.permutation(20)
    shapes = modes.vectors / np.sqrt(list_inertias(wanted))
    goal = gp.MatchFrequencies(modes.frequencies[order], shapes=-2.0 * shapes[order])
    bounds = (0.2 * np.min(k), 5.0 * np.max(k))
    found = gp.design(start, goal, "normal_stiffness", bounds, restarts=0)
    assert found.warnings == ()
    assert_allclose(found.variables, k, rtol=1e-7)
    # without shapes modes are told apart by their order alone
    by_order = gp.MatchFrequencies(modes.frequencies)
    (warning,) = gp.design(start, by_order, "normal_stiffness", bounds, restarts=0).warnings
    assert "not reached" in warning


def test_shapes_of_other_balls_are_refused_and_strange_ones_said(chain):
    network = chain.cut(0, 2, edges=("clamped", "free"))
    frequencies = gp.Waves(network).modes(2).frequencies
    with pytest.raises(InputError, match="shapes"):
        gp.MatchFrequencies(frequencies, shapes=np.ones((2, 3, 1))).evaluate(network)
    alike = gp.MatchFrequencies(frequencies, shapes=np.ones((2, 4, 1)))
    assert "shape" in alike.judge(network, 0.0)


@pytest.mark.claim("design-load")
def test_a_load_puts_a_band_edge_at_a_given_frequency():
    """k goes as f^(1/3), and the edge as the root of k."""
    crystal = gp.Crystal.on("chain", [BALL, BALL], friction=False)
    edge = gp.Phonons(crystal.at_force(20.0)).frequencies([[0.0]])[0, -1]
    goal = gp.MatchFrequencies([1.3 * edge], q=[[0.0]], branches=[1])
    found = gp.design(
        lambda force: crystal.at_force(force), goal, "force", (1.0, 300.0), restarts=0
    )
    assert_allclose(found.variables, 20.0 * 1.3**6, rtol=1e-7)
    assert found.labels == ("force",)


def test_the_lowest_velocity_has_the_softest_springs_and_the_heaviest_balls(chain):
    k = chain.normal_stiffness[0]
    mass = chain.masses[0]
    bounds = {"mass": (mass, 3.0 * mass), "normal_stiffness": (0.5 * k, 2.0 * k)}
    names = ("mass", "normal_stiffness")
    best = gp.design(chain, gp.LowestVelocity(), names, bounds, restarts=0)
    assert_allclose(best.variables, [3.0 * mass] * 2 + [0.5 * k] * 2, rtol=1e-6)
    v = gp.sound_velocities(best.network).longitudinal
    assert_allclose(best.value, v, rtol=1e-12)
    start = gp.sound_velocities(chain).longitudinal
    assert_allclose(best.value, start / math.sqrt(6.0), rtol=1e-6)


def test_a_response_is_least_where_a_ball_beside_it_resonates(chain):
    """A ball on a spring at the driven ball, whose own frequency is that of the drive, stills it
    (Frahm's damper, 1909): the search finds its mass.
    """
    network = chain.cut(0, 2, edges=("clamped", "free"))
    first, damper = 2, 3  # the first layer, of two balls, is held
    frequency = 5e3
    goal = gp.ResponseAt(frequency, (first, "x"), (first, "x"))
    mass = network.masses[first]
    best = gp.design(network, goal, "mass", (0.2 * mass, 3.0 * mass), restarts=0, steps=10)
    k = network.normal_stiffness[-1]
    own = math.sqrt(k / best.network.masses[damper]) / (2.0 * math.pi)
    assert abs(own / frequency - 1.0) < 1e-3
    assert best.unit == "m/N"


@pytest.mark.parametrize("lattice", ["chain", pytest.param("triangular", marks=pytest.mark.slow)])
def test_the_smooth_gap_has_exact_derivatives(lattice):
    network = random_network(lattice, (3,) if lattice == "chain" else (2, 1), seed=4)
    goal = gp.WidestGap(branches=2, mesh=(6,) * sum(network.pbc), smoothing=200.0)
    value, slopes = goal.evaluate(network)
    for name in ("normal_stiffness", "mass"):
        change = changes(network, name)
        wanted = difference(lambda one: goal.evaluate(one)[0], network, name, change)
        assert_allclose(slopes[name] @ change, wanted, rtol=1e-6, atol=1e-7 * abs(value))


def test_kinds_have_one_variable():
    balls = [BALL, gp.Ball(gp.Material(73.5e9, 0.33, 2700.0), 19e-3)]
    network = gp.Crystal.on("chain", balls, friction=False).at_force(20.0).network.repeat((2,))
    bounds = (0.5 * network.masses.min(), 2.0 * network.masses.max())
    best = gp.design(network, gp.WidestGap(near=6e3), bounds=bounds, per="kind", restarts=0)
    assert best.labels == ("mass of A", "mass of B")
    assert np.unique(best.network.masses).size == 2
    assert_allclose(np.sort(best.variables), bounds, rtol=1e-6)


def test_a_spring_to_the_ground_puts_the_lowest_branch_where_it_is_wanted(chain):
    """omega^2 = g/m at Gamma, of all balls on the same spring."""
    frequency = 2e3
    goal = gp.MatchFrequencies([frequency], q=[[0.0]])
    best = gp.design(chain, goal, "on_site", (0.0, 1e8), per="kind", restarts=1)
    wanted = chain.masses[0] * (2.0 * math.pi * frequency) ** 2
    assert_allclose(best.variables, [wanted], rtol=1e-7)
    assert_allclose(best.network.on_site, wanted, rtol=1e-7)
    assert best.labels == ("on_site of A",)
    assert best.start_variables == [0.0]
    assert_allclose(best.start_value, 1.0, rtol=1e-2)
    assert best.starts.size == 2


@pytest.mark.parametrize("at_start", [0.0, 5e3])
def test_springs_to_the_ground_vary_where_balls_do_not_turn(at_start):
    """omega^2 = g/m at Gamma, of both displacements: the motions of the network have rotations,
    which nothing resists.
    """
    network = gp.Crystal.on("triangular", BALL, friction=False).at_force(20.0).network
    start = replace(network, on_site=np.array([[at_start, at_start, 0.0]]))
    assert start.ball_motions.count == 2
    frequency = 2e3
    goal = gp.MatchFrequencies([frequency, frequency], q=[[0.0, 0.0]])
    best = gp.design(start, goal, "on_site", (0.0, 1e8), restarts=0)
    wanted = network.masses[0] * (2.0 * math.pi * frequency) ** 2
    assert_allclose(best.network.on_site, [[wanted, wanted, 0.0]], rtol=1e-7)
    assert best.start_variables == [at_start]


def test_equal_starts_do_not_depend_on_their_number(chain):
    mass = chain.masses[0]
    goal = gp.ResponseAt(5e3, (0, "x"), (1, "x"), loss_factor=0.1)
    bounds = (0.5 * mass, 2.0 * mass)
    few = gp.design(chain, goal, bounds=bounds, restarts=1, steps=5)
    many = gp.design(chain, goal, bounds=bounds, restarts=3, steps=5)
    assert many.starts[:2].tolist() == few.starts.tolist()
    assert many.value == many.starts.min()


# -- what is refused, or said ----------------------------------------------------------------------


class Fixed:
    """A goal that returns what it was made with, whatever the network."""

    largest = False

    def __init__(self, found):
        self.found = found

    def evaluate(self, _network):
        return self.found


@pytest.mark.parametrize(
    ("words", "options"),
    [
        ("outside of its bounds", {"bounds": (1.0, 2.0)}),
        ("mass of A", {"bounds": (1.0, 2.0), "per": "kind"}),
        ("out of reach", {"constraints": {"mass": 1e3}}),
        ("constraints", {"constraints": {"inertia": 1.0}}),
        ("vary", {"vary": "colour"}),
        (
            "same numbers",
            {"vary": ("mass", "inertia"), "bounds": {"mass": (0, 1), "inertia": (0, 1)}},
        ),
        ("bounds", {"vary": ("mass", "stiffness")}),
        ("bounds", {"bounds": (2.0, 1.0)}),
        ("none of the variables", {"vary": "shear_stiffness", "bounds": (0.0, 1e7)}),
        ("no gap", {"goal": gp.WidestGap(near=1e6)}),
        ("the goal is", {"goal": 3.0}),
        ("the goal is", {"goal": gp.WidestGap}),
        ("the goal returns", {"goal": Fixed(1.0)}),
        ("nan", {"goal": Fixed((math.nan, {"mass": [1.0, 1.0]}))}),
        ("one number", {"goal": Fixed(([1.0, 2.0], {"mass": [1.0, 1.0]}))}),
        ("the shape", {"goal": Fixed((np.eye(2), {"mass": [1.0, 1.0]}))}),
        ("by mass", {"goal": Fixed((1.0, {"mass": [1.0, math.nan]}))}),
        ("by mass", {"goal": Fixed((1.0, {"mass": [1.0] * 3}))}),
        ("Did you mean 'mass'", {"goal": Fixed((1.0, {"masses": [1.0, 1.0]}))}),
        ("begin at zero", {"bounds": (0.0, 1.0)}),
        ("constraints", {"constraints": {"mass": [0.1, 0.2]}}),
        ("mesh", {"goal": gp.WidestGap(mesh=(0,))}),
        ("branches", {"goal": gp.WidestGap(branches=2)}),
        ("wave", {"goal": gp.LowestVelocity(wave=1)}),
        ("one direction", {"goal": gp.LowestVelocity([[1.0], [1.0]])}),
    ],
)
def test_mistakes_are_refused_in_one_line(chain, words, options):
    mass = chain.masses[0]
    arguments = {"goal": gp.WidestGap(), "bounds": (0.5 * mass, 2.0 * mass)} | options
    with pytest.raises(InputError, match=words) as error:
        gp.design(chain, **arguments)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("goal", "options", "word"),
    [
        (gp.WidestGap, {"near": -1.0}, "near"),
        (gp.WidestGap, {"smoothing": 0.0}, "smoothing"),
        (gp.WidestGap, {"branches": 0}, "branches"),
        (gp.WidestGap, {"near": 5e5, "branches": 1}, "near and branches"),
        (gp.MatchFrequencies, {"measured": [2.0, 1.0]}, "ascend"),
        (gp.MatchFrequencies, {"measured": [[1.0], [2.0]]}, "ascend"),
        (gp.MatchFrequencies, {"measured": [0.0, 1.0]}, "measured"),
        (gp.MatchFrequencies, {"measured": [1.0], "sigma": 0.0}, "sigma"),
        (gp.MatchFrequencies, {"measured": [1.0], "sigma": [1.0, 1.0]}, "sigma"),
        (gp.MatchFrequencies, {"measured": [1.0], "branches": [0]}, "without q"),
        (gp.MatchFrequencies, {"measured": [1.0], "shapes": [[1.0]]}, "shapes"),
        (gp.MatchFrequencies, {"measured": [1.0], "shapes": [[[0.0]]]}, "zero"),
        (gp.MatchFrequencies, {"measured": [1.0], "q": [[0.1]], "shapes": [[[1.0]]]}, "with q"),
        (gp.MatchFrequencies, {"measured": [[1.0, 2.0]], "q": [[0.1], [0.2]]}, "2 wave vectors"),
        (gp.ResponseAt, {"frequency": -1.0, "source": 0, "receiver": 0}, "frequency"),
    ],
)
def test_goals_refuse_what_they_are_made_of(goal, options, word):
    with pytest.raises(InputError, match=word):
        goal(**options)


@pytest.mark.parametrize("vary", ["load", ("force", "load")])
def test_names_that_a_function_of_parameters_lacks_are_refused(vary):
    with pytest.raises(InputError, match="load"):
        gp.design(lambda force: force, gp.WidestGap(), vary, {"load": (1, 2), "force": (1, 2)})


@pytest.mark.parametrize(("per", "words"), [("kind", "no kinds"), ("all", "per: .*all")])
def test_a_function_of_parameters_has_no_kinds(per, words):
    with pytest.raises(InputError, match=words):
        gp.design(lambda force: force, gp.WidestGap(), "force", (1.0, 2.0), per=per)


@pytest.mark.parametrize("name", ["progress", "constraints"])
def test_arguments_of_another_kind_are_refused(chain, name):
    goal = gp.LowestVelocity()
    with pytest.raises(InputError, match=name):
        gp.design(chain, goal, "mass", (1e-9, 1.0), restarts=0, steps=1, **{name: np.ones(2)})


def test_what_cannot_vary_is_refused(chain):
    still = replace(chain, masses=np.full(2, np.inf), inertias=np.full(2, np.inf))
    with pytest.raises(InputError, match="no mass to vary"):
        gp.design(still, Fixed((1.0, {})), bounds=(0.1, 1.0))
    alone = gp.Crystal.on("chain", [BALL], friction=False).at_force(20.0).network
    with pytest.raises(InputError, match="one branch"):
        gp.design(alone, gp.WidestGap(), bounds=(1e-3, 1.0))
    for names in ([], ["force", "force"]):
        with pytest.raises(InputError, match="vary"):
            gp.design(lambda force: chain, gp.WidestGap(), names, {"force": (1.0, 2.0)})


def test_a_gap_is_evaluated_without_a_search(chain):
    heavy = replace(chain, masses=chain.masses * np.array([1.0, 3.0]))
    (settled,) = gp.WidestGap(near=5e3).choose(heavy, 1)
    assert gp.WidestGap().evaluate(heavy)[0] == settled.evaluate(heavy)[0]
    assert_allclose(gp.WidestGap().certify(heavy), np.diff(gp.Phonons(heavy).gaps())[0], rtol=1e-9)


def test_a_goal_without_a_value_at_random_masses_is_searched_from_the_network(chain):
    class Narrow:
        largest = False

        def evaluate(self, network):
            if np.ptp(network.masses) > 1e-9 * network.masses[0]:
                raise InputError("no such network")
            return float(network.masses.sum()), {"mass": np.ones(network.n_balls)}

    mass = chain.masses[0]
    best = gp.design(chain, Narrow(), bounds=(0.5 * mass, 2.0 * mass), restarts=1)
    assert_allclose(best.value, mass, rtol=1e-9)


def test_a_goal_out_of_reach_is_said_and_the_best_kept(chain):
    mass = chain.masses[0]
    goal = gp.MatchFrequencies([1.0], q=[[0.5]], branches=[0])
    best = gp.design(chain, goal, bounds=(0.5 * mass, 2.0 * mass), restarts=0)
    (warning,) = best.warnings
    assert "not reached" in warning
    assert_allclose(np.max(best.variables), 2.0 * mass, rtol=1e-3)
    k = chain.normal_stiffness[0]
    closed = gp.design(chain, gp.WidestGap(), "stiffness", (0.999999 * k, k), restarts=0)
    assert closed.value >= 0.0


def test_a_gap_that_closes_on_the_way_is_said_and_the_widest_is_kept(chain):
    """The masses are equal at both ends of the parameter, and most unlike at a quarter of it."""
    mass = chain.masses[0]

    def make(place):
        excess = 4.0 * place * (1.0 - place) ** 3
        return replace(chain, masses=mass * np.array([1.0, 1.0 + excess]))

    best = gp.design(make, gp.WidestGap(branches=1), "place", (0.0, 1.0), restarts=0)
    assert np.min(best.history) <= 0.0
    assert_allclose(best.variables, 0.25, rtol=1e-3)
    (warning,) = best.warnings
    assert "closes on the way" in warning
    assert best.value > best.start_value > 0.0


def test_a_gap_that_is_closed_on_the_finer_mesh_is_passed_over(chain):
    """At Gamma alone equal light masses have the widest distance of branches, and no gap."""
    mass = chain.masses[0]
    unlike = replace(chain, masses=mass * np.array([1.0, 2.0]))
    goal = gp.WidestGap(branches=1, mesh=(1,))
    best = gp.design(unlike, goal, bounds=(0.5 * mass, 2.0 * mass), restarts=1)
    (warning,) = best.warnings
    assert "given network" in warning
    assert best.best_start == 0
    assert best.value == best.start_value > 0.0
    assert best.network.masses.tolist() == unlike.masses.tolist()
    closed = gp.design(chain, goal, bounds=(0.5 * mass, 2.0 * mass), restarts=0)
    assert closed.value == 0.0
    (warning,) = closed.warnings
    assert "finer" in warning
    assert closed.history.max() > 0.0
    assert "no gap opens" in goal.judge_history(np.array([-1.0]), 0.0)


def test_a_response_of_an_unknown_quantity_is_refused_at_once():
    with pytest.raises(InputError, match="largest"):
        gp.ResponseAt(1e3, (0, "x"), (1, "x"), largest="yes")
    with pytest.raises(InputError, match="velocity"):
        gp.ResponseAt(1e3, (0, "x"), (1, "x"), quantity="speed")


class _First:
    """The least number of the first ball, or of the first contact."""

    largest = False

    def __init__(self, field, name):
        self.field = field
        self.name = name

    def evaluate(self, network):
        values = getattr(network, self.field)
        return float(values[0]), {self.name: np.eye(values.size)[0]}


def test_a_given_network_without_the_sums_is_not_kept():
    """It has a better value than any network with the sums. Of two, one has the rest of the sum."""
    chain = gp.Crystal.on("chain", [BALL, BALL], friction=True).at_force(20.0).network
    mass = chain.masses[0]
    bounds = (0.5 * mass, 2.0 * mass)
    light = replace(chain, masses=np.array([0.5, 0.5]) * mass)
    best = gp.design(
        light, _First("masses", "mass"), bounds=bounds, constraints={"mass": 3.0 * mass}
    )
    assert_allclose(best.variables, [mass, 2.0 * mass], rtol=1e-9)
    assert_allclose([best.start_value, best.value], [0.5 * mass, mass], rtol=1e-9)
    k = chain.shear_stiffness[0]
    goal = _First("shear_stiffness", "shear_stiffness")
    sums = {"shear_stiffness": 0.0}
    best = gp.design(chain, goal, "shear_stiffness", (0.0, 2.0 * k), sums, restarts=0)
    assert_allclose(best.network.shear_stiffness, 0.0, atol=1e-9 * k)


def test_a_given_network_without_the_sum_does_not_outdo_the_gaps_with_it(chain):
    """Its gap is wider than any with the sum: (2k/m)^1/2 of both masses, of which it has less."""
    mass = chain.masses[0]
    wide = replace(chain, masses=mass * np.array([0.3, 1.8]))
    bounds = (0.3 * mass, 2.0 * mass)
    best = gp.design(
        wide, gp.WidestGap(), bounds=bounds, constraints={"mass": 3.0 * mass}, restarts=0
    )
    assert_allclose(np.sort(best.variables), [mass, 2.0 * mass], rtol=1e-9)
    k = chain.normal_stiffness[0]
    edges = np.sqrt(2.0 * k / (mass * np.array([[1.0, 2.0], [0.3, 1.8]]))) / (2.0 * math.pi)
    assert_allclose([best.value, best.start_value], edges[:, 0] - edges[:, 1], rtol=1e-9)
    assert best.warnings == ()


def test_variables_without_effect_are_named(chain):
    mass = chain.masses[0]
    bounds = {"mass": (0.5 * mass, 2.0 * mass), "shear_stiffness": (0.0, 1e6)}
    goal = gp.MatchFrequencies([5e3], q=[[0.5]], branches=[0])
    best = gp.design(chain, goal, ("mass", "shear_stiffness"), bounds, restarts=0)
    (warning,) = (one for one in best.warnings if "depend" in one)
    assert ", ".join(f"shear_stiffness of contact {number}" for number in (0, 1)) in warning


def test_a_search_that_meets_an_impossible_network_keeps_its_best(chain):
    class Fragile:
        largest = False

        def __init__(self):
            self.count = 0

        def evaluate(self, network):
            self.count += 1
            if self.count > 3:
                raise InputError("no such network")
            size = float(network.masses.sum())
            return size, {"mass": np.ones(network.n_balls)}

    mass = chain.masses[0]
    best = gp.design(chain, Fragile(), bounds=(0.5 * mass, 2.0 * mass), restarts=0)
    (warning,) = best.warnings
    assert "no such network" in warning
    assert best.value <= chain.masses.sum() * (1.0 + 1e-12)


def test_derivatives_by_a_load_hold_over_decades_of_bounds():
    """A frequency goes as the sixth root of the force, however far the bounds are apart."""
    ball = gp.Ball(gp.Material(193e9, 0.3, 8e3), 19e-3)
    crystal = gp.Crystal.on("chain", [ball, ball], friction=False)

    def make(values):
        return crystal.at_force(float(values[0])).network

    ends = np.array([1e-3]), np.array([1e5])
    space = Parameters(make, ["force"], *ends, np.array([20.0]))
    for force in (0.1, 20.0, 1e4):
        value, (slope,) = space.differentiate(
            lambda network: (gp.Phonons(network).frequencies([[0.0]])[0, 1], {}), np.array([force])
        )
        assert_allclose(slope * force / value, 1.0 / 6.0, rtol=1e-6)


def test_a_goal_with_residuals_may_leave_out_derivatives(chain):
    class Wanted:
        """That each mass is 0.8 of what it was."""

        largest = False

        def find_residuals(self, network):
            wanted = 0.8 * chain.masses
            return network.masses / wanted - 1.0, {"mass": np.diag(1.0 / wanted)}

        def evaluate(self, network):
            residuals, slopes = self.find_residuals(network)
            return float(residuals @ residuals), {"mass": 2.0 * residuals @ slopes["mass"]}

    mass = chain.masses[0]
    k = chain.normal_stiffness[0]
    bounds = {"mass": (0.5 * mass, mass), "normal_stiffness": (0.5 * k, 2.0 * k)}
    best = gp.design(chain, Wanted(), ("mass", "normal_stiffness"), bounds, restarts=0)
    assert_allclose(best.variables, [0.8 * mass] * 2 + [k] * 2, rtol=1e-7)
    (warning,) = best.warnings
    assert warning.endswith(", ".join(best.labels[2:]))


@pytest.mark.parametrize(
    ("name", "shape"),
    [("mass", (3, 2)), ("mass", ()), ("on_site", ()), ("on_site", (2,)), ("on_site", (2, 7))],
)
def test_derivatives_of_another_shape_than_the_goal_are_refused(chain, name, shape):
    class Wrong:
        largest = False

        def evaluate(self, network):
            return 1.0, {name: np.ones(shape)}

    mass = chain.masses[0]
    bounds = (0.5 * mass, 2.0 * mass) if name == "mass" else (0.0, 1e6)
    with pytest.raises(InputError, match=f"derivatives by {name}"):
        gp.design(chain, Wrong(), name, bounds)


def test_the_start_value_is_that_of_the_given_network_at_its_bounds(chain):
    """Least squares begin a little inside of the bounds."""
    mass = chain.masses[0]
    goal = gp.MatchFrequencies([5e3, 6e3], q=0.1)
    best = gp.design(chain, goal, "mass", (mass, 2.0 * mass), restarts=0, steps=2)
    assert best.start_value == goal.evaluate(chain)[0] != best.history[0]


def test_goals_that_a_network_cannot_have_are_refused_in_one_line(chain):
    for goal in (gp.WidestGap(branches=7, smoothing=1.0), gp.WidestGap(branches=7)):
        for call in (goal.evaluate, goal.certify):
            with pytest.raises(InputError, match="branches"):
                call(chain)
    held = chain.cut(0, 2, edges=("clamped", "free"))
    shapes = np.where(held.moving[:, None], 0.0, np.ones((1, held.n_balls, 1)))
    with pytest.raises(InputError, match="shape moves no ball"):
        gp.MatchFrequencies([1e3], shapes=shapes).evaluate(held)
    with pytest.raises(InputError, match="cannot be called"):
        gp.design(min, gp.LowestVelocity(), "force", (1.0, 2.0))
    assert "touch" in gp.WidestGap().tell_closed(0.0)


def test_the_frequency_that_is_advised_in_place_of_one_without_a_gap_is_taken():
    """Also where branches overlap, and the middle of their edges is below both means."""
    frequencies = np.array([[0.0, 0.0], [4.0, 4.2], [4.0, 4.2]])
    goal = gp.WidestGap(near=100.0)
    with pytest.raises(InputError, match="no gap") as told:
        goal._count_below(100.0, frequencies)
    advised = float(re.search(r"as ([\d.]+) Hz", str(told.value))[1])
    assert goal._count_below(advised, frequencies) == 1
