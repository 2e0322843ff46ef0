"""States that follow a parameter, against states that are found anew at each of its values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.loads import Load
from granphon.balls.packing import change_packing
from granphon.base.differences import differentiate
from granphon.media import crystal as crystals
from granphon.media.arrangement import given_balls
from granphon.media.choice import MediumChoice
from granphon.media.medium import Medium
from granphon.observables.parameters import find_parameter_sensitivities, read_number
from granphon.statics import rest_courses
from granphon.statics.options import RestOptions

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ALUMINIUM = gp.Material(young_modulus=73.5e9, poisson_ratio=0.33, density=2700.0)
PACKING = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))
KINDS = [gp.Ball(STEEL, 8e-3), gp.Ball(ALUMINIUM, 8e-3)]


def find_sound(state):
    return gp.sound_velocities(state).velocities


def find_frequencies(state):
    network = state.network
    return gp.Phonons(network).frequencies([[0.2, 0.3, 0.1][: sum(network.pbc)]])[0]


def compare(choice, balls, load, find, names, step, finite_overlap=None):
    """Compare derivatives with differences of states that are found anew, to 1e-8."""
    ((kind, number),) = load.items()
    found = find_parameter_sensitivities(
        choice,
        balls,
        Load.only(**load),
        find,
        (*names, kind),
        finite_overlap,
    )

    def find_anew(name, change):
        changed = balls
        load_there = {kind: number}
        if name == kind:
            load_there[kind] *= 1.0 + change
        else:
            value = read_number(balls, name)
            changed = change_packing(balls, {name: (1.0 + change) * value})
        medium = choice.of(changed)
        applied = Load(kind, load_there[kind])
        return np.asarray(find(medium.at(applied, finite_overlap=finite_overlap)))

    for name in found.names:
        wanted = differentiate(lambda change, name=name: find_anew(name, change), step)
        scale = np.max(np.abs(found.value))
        assert_allclose(found[name] * found.value, wanted, atol=1e-8 * scale, err_msg=name)


@pytest.mark.claim("parameters-differences")
@pytest.mark.parametrize(
    ("medium", "load", "finite_overlap"),
    [
        ("ala", {"pressure": 4e3}, True),
        ("afa", {"pressure": 4e3}, True),
        ("ema", {"pressure": 4e3}, None),
        ("ema", {"pressure": 4e3}, True),
        ("auto", {"force": 1e3}, None),
    ],
)
def test_laws_follow_all_parameters(medium, load, finite_overlap):
    """The effective medium too, whose equation depends on the Poisson ratio by its local field."""
    names = ("young_modulus", "poisson_ratio", "diameter", "width")
    compare(MediumChoice(medium), PACKING, load, find_sound, names, 2e-3, finite_overlap)


@pytest.mark.parametrize("kind", ["force", "overlap"])
def test_laws_follow_a_force_and_an_overlap(kind):
    load = {"force": 5.0} if kind == "force" else {"overlap": -2e-7}
    compare(MediumChoice("ema"), PACKING, load, find_sound, ("poisson_ratio", "width"), 2e-3)


CRYSTALS = {
    "NaCl": lambda: gp.Crystal.on("NaCl", KINDS),
    "hcp": lambda: gp.Crystal.on("hcp", KINDS),
    "floor and wall": lambda: gp.Crystal.on("triangular", KINDS[:1]).cut(
        1, 3, edges=("floor", gp.Wall(ALUMINIUM))
    ),
    "springs": lambda: gp.Crystal.on("chain", KINDS, on_site=3e5),
    "sample": lambda: gp.Crystal.on(
        "triangular", [gp.Ball(STEEL, 8e-3, spread=gp.Uniform(1e-6))]
    ).sample((3, 3), seed=1),
}


@pytest.mark.claim("parameters-differences")
@pytest.mark.parametrize(
    ("name", "load", "finite_overlap"),
    [
        ("NaCl", {"force": 5.0}, None),
        ("hcp", {"pressure": 2e5}, True),
        ("floor and wall", {"pressure": 1e4}, None),
        ("springs", {"overlap": 2e-6}, None),
        ("sample", {"force": 10.0}, None),
        pytest.param("NaCl", {"overlap": 1e-6}, True, marks=pytest.mark.slow),
        pytest.param("sample", {"pressure": 5e3}, True, marks=pytest.mark.slow),
        pytest.param("floor and wall", {"force": 10.0}, True, marks=pytest.mark.slow),
    ],
)
def test_crystals_follow_all_parameters(name, load, finite_overlap):
    balls = given_balls(CRYSTALS[name]())
    names = ("A.young_modulus", "A.poisson_ratio")
    step = 1e-4 if name == "sample" else 2e-3
    compare(MediumChoice("crystal"), balls, load, find_frequencies, names, step, finite_overlap)


def test_weights_follow_the_density():
    """Balls in a column bear the weight of those above: forces go as the density."""
    column = gp.Crystal.on("triangular", KINDS[:1]).cut(1, 3, edges=("floor", "free"))
    load = Load("pressure", 0.0, gravity=9.81)
    (found,) = find_parameter_sensitivities(
        MediumChoice("crystal"),
        given_balls(column),
        load,
        lambda state: state.source.normal_force,
        ("A.density",),
    ).slopes
    assert np.count_nonzero(np.isfinite(found)) >= 5  # balls side by side do not press
    assert_allclose(found[np.isfinite(found)], 1.0, rtol=1e-9)


@pytest.mark.claim("parameters-differences")
@pytest.mark.parametrize(
    ("geometry", "boundary", "load"),
    [
        pytest.param("lattice", "isotropic", {"force": 18.0}, marks=pytest.mark.slow),
        ("exact", "isotropic", {"pressure": 4e3}),
        ("lattice", "stress", {"force": 18.0}),
        pytest.param("lattice", "stress", {"overlap": 1e-6}, marks=pytest.mark.slow),
        pytest.param("exact", "stress", {"force": 18.0}, marks=pytest.mark.slow),
        pytest.param("exact", "stress", {"overlap": 1e-6}, marks=pytest.mark.slow),
        pytest.param("exact", "isotropic", {"overlap": 1e-6}, marks=pytest.mark.slow),
    ],
)
def test_arrays_follow_all_parameters(geometry, boundary, load):
    options = {"shape": (3, 3), "seed": 1, "geometry": geometry, "boundary": boundary}
    choice = MediumChoice("simulation", tuple(options.items()))

    def find(state):
        return state.sample.network.normal_stiffness

    compare(choice, PACKING, load, find, ("young_modulus", "diameter", "width"), 1e-4)


def test_contacts_that_are_open_stay_open():
    """At low load, where a difference of two states may close a contact."""
    options = {"shape": (6, 6), "seed": 0, "geometry": "lattice"}
    choice = MediumChoice("simulation", tuple(options.items()))
    load = Load("force", 1.0)

    def change(step):
        return choice.of(PACKING), replace(load, array=(1.0 + step) * load.array)

    state, (course,) = choice.of(PACKING).follow(load, [change])
    sample = state.sample
    assert np.any(sample.contact_forces == 0.0)
    moved = course.at(course.step).sample
    assert np.array_equal(moved.network.i, sample.network.i)
    assert_allclose(
        course.differentiate(lambda one: one.sample.force) / sample.force, 1.0, rtol=1e-9
    )


@pytest.mark.parametrize("geometry", ["lattice", "exact"])
def test_what_is_too_large_for_factors_is_iterated(monkeypatch, geometry):
    options = {"shape": (4, 4), "seed": 1, "geometry": geometry}
    medium = MediumChoice("simulation", tuple(options.items())).of(PACKING)
    load = Load("force", 18.0)

    def change(step):
        return medium, replace(load, array=(1.0 + step) * load.array)

    def find_slope():
        _, (course,) = medium.follow(load, [change])
        return course.differentiate(lambda state: state.sample.network.normal_stiffness)

    by_factors = find_slope()
    none = dict.fromkeys((1, 2, 3), 0)
    monkeypatch.setattr(rest_courses, "RestOptions", lambda: RestOptions(most_balls=none))
    assert_allclose(find_slope(), by_factors, rtol=1e-9)


def test_states_of_another_medium_are_found_anew():
    """As those that depend on the way to the load."""

    class Own(Medium):
        name = "own"

        def __init__(self, packing):
            self.packing = packing

        def at(self, load, *, finite_overlap=None):
            return gp.AveragedLattice(self.packing).at(load, finite_overlap=finite_overlap)

    load = Load("force", 18.0)

    def change(step):
        return Own(PACKING), replace(load, array=(1.0 + step) * load.array)

    state, (course,) = Own(PACKING).follow(load, [change])
    assert_allclose(
        course.differentiate(lambda one: one.overlap), 2.0 / 3.0 * state.overlap, rtol=1e-9
    )


def test_no_rest_is_searched_for_but_the_first(monkeypatch):
    """Whatever the number of parameters."""
    searches = []
    find_rest = crystals.find_rest

    def count(*arguments, **options):
        searches.append(1)
        return find_rest(*arguments, **options)

    monkeypatch.setattr(crystals, "find_rest", count)
    crystal = gp.Crystal.on("NaCl", KINDS)
    crystal.at_force(5.0)
    once = len(searches)
    names = ("A.young_modulus", "B.young_modulus", "A.density", "force")
    gp.parameter_sensitivities(crystal, lambda state: state.force, names, force=5.0)
    assert len(searches) == 2 * once


def test_parameters_that_cannot_change_alone_are_left_out():
    spread = gp.Discrete((7.999e-3, 8.001e-3), (0.5, 0.5))
    packing = gp.Packing(STEEL, 8e-3, spread=spread)
    found = gp.parameter_sensitivities(packing, find_sound, force=18.0)
    assert "diameter" not in found.names
    assert "width" in found.names


def test_all_parameters_of_samples_are_those_without_the_ratio(monkeypatch):
    """Each sample has a network of its own, so that the state has no ratio to change."""
    monkeypatch.setattr(
        MediumChoice, "of", lambda _, balls: gp.DirectSimulation(balls, (4, 4), seed=1)
    )
    found = gp.parameter_sensitivities(PACKING, find_sound, medium="simulation", force=6.0)
    assert found.names == (
        "young_modulus",
        "poisson_ratio",
        "density",
        "diameter",
        "width",
        "force",
    )
    assert_allclose(found["density"], -0.5, atol=1e-8)


def test_an_empty_list_of_parameters_is_refused():
    with pytest.raises(gp.GranphonError, match="parameters"):
        gp.parameter_sensitivities(PACKING, find_sound, [], force=6.0)
