"""Logarithmic derivatives by named parameters: Hertz's law in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
PACKING = gp.Packing(STEEL, 8e-3, lattice="triangular")


def find(state):
    return gp.Phonons(state).frequencies([[0.2, 0.3]])[0]


@pytest.mark.claim("parameters-hertz")
@pytest.mark.parametrize(
    ("load", "modulus", "diameter"),
    [
        # at a given force k goes as (E^2 f d)^(1/3), at a given overlap as E d^(1/2)
        ({"force": 18.0}, 1.0 / 3.0, 1.0 / 6.0),
        ({"overlap": 1e-6}, 0.5, 0.25),
    ],
)
def test_frequencies_of_one_kind_go_as_powers(load, modulus, diameter):
    names = ("young_modulus", "density", "diameter", *load)
    found = gp.parameter_sensitivities(PACKING, find, names, **load)
    assert_allclose(found["young_modulus"], modulus, rtol=1e-9)
    assert_allclose(found["density"], -0.5, rtol=1e-9)
    assert_allclose(found["diameter"], diameter - 1.5, rtol=1e-9)
    power = 1.0 / 6.0 if "force" in load else 0.25
    assert_allclose(found[next(iter(load))], power, rtol=1e-9)
    again = type(found).from_dict(found.to_dict())
    assert again == found


def test_the_ratio_of_stiffnesses_is_that_of_all_contacts():
    found = gp.parameter_sensitivities(PACKING, find, "mindlin_ratio", force=18.0)
    network = gp.AveragedLattice(PACKING).at_force(18.0).network
    by_contact = gp.Phonons(network).sensitivities([[0.2, 0.3]])
    wanted = by_contact.shear_stiffness[0] @ network.shear_stiffness / by_contact.frequencies[0]
    assert_allclose(found["mindlin_ratio"], wanted, rtol=1e-9)


def test_kinds_of_a_crystal_share_the_power_of_one():
    balls = [gp.Ball(STEEL, 8e-3), gp.Ball(gp.Material(73.5e9, 0.33, 2700.0), 8e-3)]
    crystal = gp.Crystal.on("chain", balls)

    def find_edge(state):
        return gp.Phonons(state).frequencies([[0.5]])[0, -1]

    found = gp.parameter_sensitivities(crystal, find_edge, force=20.0)
    assert_allclose(found["A.young_modulus"] + found["B.young_modulus"], 1.0 / 3.0, rtol=1e-9)
    assert_allclose([found["A.density"], found["B.density"]], [0.0, -0.5], atol=1e-9)
    assert_allclose(found["force"], 1.0 / 6.0, rtol=1e-9)
    assert "A.diameter" not in found.names


def test_springs_to_the_ground_and_given_masses_are_parameters():
    """A chain over springs begins at (k_g/m)^1/2, whatever the contacts."""
    ball = gp.Ball(STEEL, 8e-3, mass=3e-3)
    chain = gp.Crystal.on("chain", [ball], friction=False, on_site=2e6)
    found = gp.parameter_sensitivities(
        chain, lambda state: gp.Phonons(state).frequencies([[0.0]])[0], force=18.0
    )
    assert "A.density" not in found.names
    assert_allclose([found["on_site"], found["A.mass"]], [[0.5], [-0.5]], rtol=1e-9)
    assert_allclose(found["A.young_modulus"], 0.0, atol=1e-9)
    several = gp.Crystal.on("chain", [ball], on_site={"x": 2e6}, motions="in_plane", friction=False)
    names = gp.parameter_sensitivities(several, lambda state: state.force, force=18.0).names
    assert [name for name in names if "on_site" in name] == ["on_site.x"]


def test_all_parameters_of_a_packing_by_default():
    found = gp.parameter_sensitivities(
        PACKING, lambda state: gp.sound_velocities(state).velocities, pressure=4e3
    )
    assert found.names[-2:] == ("pressure", "mindlin_ratio")
    assert found.slopes.shape == (len(found.names), 2)
    assert np.all(np.isfinite(found.slopes))
    for name in ("colour", "A.density"):
        with pytest.raises(InputError, match="no parameter"):
            gp.parameter_sensitivities(PACKING, find, name, force=1.0)


@pytest.mark.parametrize(
    ("attribute", "power"), [("force", 1.0), ("pressure", 1.0), ("normal_stiffness", 1.0 / 3.0)]
)
def test_what_networks_lack_has_no_derivative_by_the_ratio(attribute, power):
    """A network has no force, and a stiffness of each contact."""

    def read(state):
        return getattr(state, attribute)

    found = gp.parameter_sensitivities(PACKING, read, force=18.0)
    assert found.names[-1] == "force"
    assert_allclose(found["force"], power, rtol=1e-9)
    with pytest.raises(InputError, match="mindlin_ratio"):
        gp.parameter_sensitivities(PACKING, read, "mindlin_ratio", force=18.0)


@pytest.mark.parametrize(
    "read", [gp.local_exponent, lambda state: gp.validity(state)["load"].value]
)
def test_what_is_refused_of_networks_has_no_derivative_by_the_ratio(read):
    """A network has no law, of which an exponent follows, and other limits."""
    assert gp.parameter_sensitivities(PACKING, read, force=18.0).names[-1] == "force"
    with pytest.raises(InputError):
        gp.parameter_sensitivities(PACKING, read, "mindlin_ratio", force=18.0)


@pytest.mark.parametrize(
    ("word", "options"),
    [
        ("no load", {}),
        ("2 values", {"force": [1.0, 2.0]}),
        ("find is 3.0", {"find": 3.0, "force": 1.0}),
        ("what find returns", {"find": lambda _: None, "force": 1.0}),
        ("finite_overlap: found 0", {"finite_overlap": 0, "force": 1.0}),
        ("what find returns", {"find": lambda _: 1j, "force": 1.0}),
        ("no number", {"parameters": "lattice", "force": 1.0}),
        ("no number", {"parameters": "friction", "force": 1.0}),
        ("no number", {"parameters": "spread", "force": 1.0}),
        # before any array comes to rest
        ("samples?", {"parameters": "mindlin_ratio", "medium": "simulation", "force": 1.0}),
    ],
)
def test_mistakes_are_refused(word, options):
    with pytest.raises(InputError, match=word):
        gp.parameter_sensitivities(PACKING, **({"find": find} | options))


def test_arrays_whose_shape_changes_are_refused():
    """As gaps that open or close with a parameter."""

    def list_forces(state):
        return np.full(1 + (state.force > 18.0), state.force)

    with pytest.raises(InputError, match="force"):
        gp.parameter_sensitivities(PACKING, list_forces, "force", force=18.0)


def test_a_parameter_at_the_end_of_its_range_is_left_out():
    """A Poisson ratio that has no room for the steps of a difference."""
    nearly = gp.Packing(gp.Material(1e9, 0.4999, 1000.0), 1e-3)
    found = gp.parameter_sensitivities(nearly, lambda s: gp.moduli(s).bulk, force=1.0)
    assert "poisson_ratio" not in found.names
    assert "young_modulus" in found.names
