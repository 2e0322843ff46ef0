"""The geometry that simulations have if none is named: that of the lattice where it leaves out next
to nothing.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.balls.loads import Load
from granphon.cli.main import main
from granphon.media.choice import MediumChoice
from granphon.media.left_out import (
    EXACT,
    LATTICE,
    choose_geometries,
    estimate_open_contacts,
    expect_shear_deficit,
)

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
REAL = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))
HISTORY = {"friction_history": True, "friction_coefficient": 0.2}
#: f* from where nearly a third of the contacts is open to where all are closed
FORCES = np.array([0.02, 0.06, 0.2, 0.5, 1.5])


def unit(packing: gp.Packing) -> float:
    return packing.width_units.force


def narrow(ratio: float, **given: object) -> gp.Packing:
    """Balls of a W/d so small that terms of the order of the overlap over the diameter do not
    matter.
    """
    return gp.Packing(STEEL, 8e-3, gp.Uniform(ratio * 8e-3), **given)


def test_each_load_has_its_own_geometry_whatever_the_others_are():
    force = FORCES[[1, 2, 4]] * unit(REAL)
    together = gp.DirectSimulation(REAL, (6, 6)).at_force(force)
    assert [sample.is_exact for sample in together.samples] == [True, False, False]
    assert together.finite_overlap
    velocities = gp.sound_velocities(together)
    for place, load in enumerate(force.tolist()):
        alone = gp.DirectSimulation(REAL, (6, 6)).at_force(load)
        assert alone.finite_overlap == (place < 1) == together[place].finite_overlap
        for name in ("overlap", "normal_stiffness", "pressure", "effective_density", "exponent"):
            assert_allclose(
                np.asarray(getattr(together, name))[place], getattr(alone, name), rtol=1e-7
            )
        of_one = gp.sound_velocities(alone)
        assert_allclose(velocities.transverse[place], of_one.transverse, rtol=1e-9)
        assert_allclose(velocities.longitudinal[place], of_one.longitudinal, rtol=1e-9)


@pytest.mark.slow
def test_the_states_are_those_of_the_geometries_by_word():
    force = FORCES * unit(REAL)
    found = gp.DirectSimulation(REAL, (8, 8), samples=2).at_force(force)
    for word, places in ((EXACT, [0, 1]), (LATTICE, [2, 3, 4])):
        named = gp.DirectSimulation(REAL, (8, 8), samples=2, geometry=word).at_force(force[places])
        assert_array_equal(found.overlap[places], named.overlap)
        assert_allclose(
            gp.sound_velocities(found[places]).transverse,
            gp.sound_velocities(named).transverse,
            rtol=1e-13,
        )
        assert_allclose(found.pressure[places], named.pressure, rtol=1e-13)


@pytest.mark.parametrize("lattice", ["triangular", "fcc"])
def test_where_the_lattice_is_chosen_it_leaves_out_less_than_a_thousandth(lattice):
    """The claim itself, against the exact geometry of the same balls, just above the load from
    which it is chosen.
    """
    packing = narrow(1e-5, lattice=lattice)
    forces = np.geomspace(0.02, 2.0, 60) * unit(packing)
    words = choose_geometries(packing, Load("force", forces))
    change = words.index(LATTICE)
    assert words == [EXACT] * change + [LATTICE] * (len(words) - change)
    assert change > 0
    shape = (16, 16) if lattice == "triangular" else (5, 5, 5)
    simulation = gp.DirectSimulation(packing, shape)
    here = simulation.at_force(forces[change])
    true = gp.DirectSimulation(packing, shape, geometry=EXACT).at_force(forces[change])
    assert not here.finite_overlap
    for name in ("normal_stiffness", "overlap"):
        assert_allclose(getattr(here, name), getattr(true, name), rtol=1e-3)
    assert_allclose(
        here.elastic_tensor, true.elastic_tensor, rtol=1e-3, atol=1e-3 * np.max(true.elastic_tensor)
    )


def test_nothing_is_left_out_without_slip_or_differences():
    loads = Load("force", FORCES * unit(REAL))
    assert choose_geometries(narrow(1e-3, friction=False), loads) == [LATTICE] * 5
    assert choose_geometries(gp.Packing(STEEL, 8e-3), loads) == [LATTICE] * 5
    assert choose_geometries(narrow(1e-3, lattice="chain"), loads) == [LATTICE] * 5
    assert not gp.DirectSimulation(gp.Packing(STEEL, 8e-3), (4, 4)).at_force(2.0).finite_overlap
    assert choose_geometries(REAL, loads, finite_overlap=True) == [EXACT] * 5
    assert gp.DirectSimulation(REAL, (8, 8)).at_force(20.0, finite_overlap=True).finite_overlap


def test_a_history_is_exact_unless_it_is_named_otherwise():
    given = {"packing": REAL, "shape": (3, 3), **HISTORY}
    assert gp.DirectSimulation(**given).geometry == EXACT
    assert gp.DirectSimulation(**given, geometry=LATTICE).geometry == LATTICE
    state = gp.DirectSimulation(**given).at_force(2.0)
    assert state.finite_overlap
    assert state.valid
    assert gp.DirectSimulation(**{**given, "packing": gp.Packing(STEEL, 8e-3)}).geometry == LATTICE


def test_a_modulus_that_is_too_small_is_not_valid_and_says_so():
    force = FORCES * unit(REAL)
    lattice = gp.DirectSimulation(REAL, (8, 8), geometry=LATTICE).at_force(force)
    assert lattice.valid.tolist() == [False, True, True, True, True]
    assert_array_equal(lattice.valid, lattice.shear_deficit <= 0.01)
    (warning,) = gp.validity(lattice).warnings
    assert re.search("1 of 5 loads .*shear modulus", warning)
    assert gp.DirectSimulation(REAL, (8, 8)).at_force(force[::2]).valid.all()
    assert gp.DirectSimulation(REAL, (8, 8)).at_force(force[:1]).shear_deficit is None


@pytest.mark.parametrize("seed", [0, 1])
def test_contacts_are_expected_to_be_open_rather_too_often_than_too_seldom(seed):
    loads = FORCES * unit(REAL)
    found = gp.DirectSimulation(REAL, (32, 32), seed=seed, geometry=LATTICE).at_force(loads)
    expected = estimate_open_contacts(REAL, Load("force", loads))
    opened = 1.0 - found.contact_fraction
    assert np.all(expected >= opened - 0.02)
    assert np.all(expected <= opened + 0.06)


def test_below_the_known_loads_open_contacts_are_not_expected_to_be_too_few():
    loads = np.array([1e-4, 3e-4]) * unit(REAL)
    state = gp.DirectSimulation(REAL, (16, 16), geometry=LATTICE).at_force(loads)
    known = float(estimate_open_contacts(REAL, Load("force", 0.003 * unit(REAL)))[0])
    opened = 1.0 - state.contact_fraction
    assert np.all(opened > known)
    assert np.all(estimate_open_contacts(REAL, Load("force", loads)) >= opened)


SCENE = """
material: {young_modulus: 70 GPa, poisson_ratio: 0.22, density: 2500 kg/m^3}
packing: {diameter: 0.5 mm, spread: {uniform: 4 um}}
load: {force: [0.05 N, 5 N]}
medium: {simulation: {shape: 6 6%s}}
"""


def test_check_warns_before_anything_is_simulated_and_tables_mark_it(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE % ", geometry: lattice")
    assert main(["check", str(scene)]) == 0
    words = "shear modulus is too small"
    assert words in " ".join(capsys.readouterr().err.split())
    assert main(["run", str(scene), "-o", str(tmp_path / "out"), "-q", "--no-figures"]) == 0
    assert words in " ".join(capsys.readouterr().err.split())
    header, low, high = (tmp_path / "out" / "sweep.csv").read_text().splitlines()
    place = header.split(",").index("valid")
    assert (
        low.split('"')[2].split(",")[place - 1] == "False"
        if '"' in low
        else low.split(",")[place] == "False"
    )
    assert (
        high.split('"')[2].split(",")[place - 1] == "True"
        if '"' in high
        else high.split(",")[place] == "True"
    )
    scene.write_text(SCENE % "")
    assert main(["check", str(scene)]) == 0
    assert "too small" not in capsys.readouterr().err


def test_what_a_geometry_leaves_out_belongs_to_the_expected_error():
    load = Load("force", 0.01 * unit(REAL))
    shape = ("shape", (1024, 1024))
    by_word = [MediumChoice("simulation", (shape, ("geometry", word))) for word in (LATTICE, EXACT)]
    lattice, exact, chosen = (
        float(one.expected_error(REAL, load))
        for one in (*by_word, MediumChoice("simulation", (shape,)))
    )
    deficit = float(expect_shear_deficit(REAL, load)[0])
    assert deficit > 0.02
    assert exact == chosen
    assert_allclose(lattice - exact, 0.5 * deficit, rtol=1e-12)
    # the truth has true directions: those of the medium are as far from it
    wide, fine = (
        float(MediumChoice("ema").expected_error(narrow(r), Load("force", 0.01 * unit(narrow(r)))))
        for r in (1e-3, 1e-9)
    )
    assert wide > fine + 0.04


@pytest.mark.parametrize(
    ("geometry", "told"),
    [
        pytest.param(LATTICE, True, marks=pytest.mark.slow),
        (EXACT, False),
        pytest.param(None, False, marks=pytest.mark.slow),
    ],
)
def test_from_the_gas_in_the_directions_of_the_lattice_velocities_depend_on_the_numbering(
    geometry, told
):
    given = {**HISTORY, "start": "gas", "step_tolerance": 1.0, "geometry": geometry}
    state = gp.DirectSimulation(REAL, (2, 3), **given).at_force(0.15 * unit(REAL))
    warnings = [text for text in gp.validity(state).warnings if "numbering" in text]
    assert len(warnings) == told
    assert state.valid == (not told)
    if told:
        assert re.search("numbering .* 8 %: loose", warnings[0])


@pytest.mark.slow
@pytest.mark.claim("friction-numbering")
def test_reduced_balls_of_another_material_and_size_have_the_same_history():
    """Rounding differs; that of the way is left."""
    found = []
    for material, diameter in (
        (STEEL, 8e-3),
        (gp.Material(7.3e10, STEEL.poisson_ratio, 2450.0), 1.37e-3),
    ):
        packing = gp.Packing(material, diameter, gp.Uniform(2.55e-4 * diameter))
        state = gp.DirectSimulation(packing, (8, 8), **HISTORY).at_force(
            np.array([0.1, 0.4]) * unit(packing)
        )
        energy = unit(packing) * packing.width
        found.append(
            (state.overlap / packing.width, state.work / energy, state.dissipated_energy / energy)
        )
    for one, other, within in zip(*found, (1e-9, 1e-7, 1e-5), strict=True):
        assert_allclose(one, other, rtol=within)


@pytest.mark.exhaustive
@pytest.mark.claim("friction-numbering")
def test_in_the_exact_geometry_the_numbering_of_the_balls_changes_nothing():
    """An array from the gas, whose balls are numbered from another one on."""
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6), lattice="sc")
    diameters = packing.diameter + packing.width * gp.Uniform(1.0).sample((3, 3, 3), 0)
    given = {
        "friction_history": True,
        "friction_coefficient": 0.3,
        "start": "gas",
        "geometry": EXACT,
    }
    one, other = (
        gp.DirectSimulation(
            packing, diameters=np.roll(diameters, shift, (0, 1, 2)), **given
        ).at_force(0.1 * unit(packing))
        for shift in ((0, 0, 0), (0, 1, 1))
    )
    assert_allclose(other.overlap, one.overlap, rtol=1e-8)
    for name in ("work", "dissipated_energy"):
        assert_allclose(
            getattr(other, name), getattr(one, name), rtol=0.0, atol=1e-8 * float(one.work)
        )
    assert_allclose(
        other.elastic_tensor, one.elastic_tensor, rtol=0.0, atol=1e-8 * np.max(one.elastic_tensor)
    )
