"""Results are frozen, read-only, and go to plain data and back."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import granphon as gp
from granphon.errors import InputError
from granphon.lattice import Modes
from granphon.limits import Check, Validity
from granphon.observables import Moduli, PulseVelocities, SoundVelocities
from granphon.results import Result, read_only


def same(one, two):
    """Equal down to the type, arrays entry by entry."""
    assert type(one) is type(two)
    if dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            same(getattr(one, field.name), getattr(two, field.name))
    elif isinstance(one, np.ndarray):
        assert one.dtype == two.dtype
        assert_array_equal(one, two)
    elif isinstance(one, tuple):
        assert len(one) == len(two)
        for first, second in zip(one, two, strict=True):
            same(first, second)
    else:
        assert one == two


@pytest.fixture(scope="module")
def results(packing):
    medium = gp.AveragedLattice(packing)
    one, many, hard = medium.at_force(18.446), medium.at_force([[1.0, 2.0], [3.0, 4.0]]), medium.at_overlap(8e-4)
    lattice = gp.ContactLattice.of("triangular", packing.mindlin_ratio)
    smooth = gp.ContactLattice.of("triangular", 0.0)
    return {
        "velocities": gp.sound_velocities(one),
        "velocities over loads": gp.sound_velocities(many),
        "velocities with warnings": gp.sound_velocities(hard),
        "moduli": gp.moduli(one),
        "moduli over loads": gp.moduli(many),
        "moduli with warnings": gp.moduli(hard),
        "pulses": gp.pulse_velocities(one, 6500.0),
        "pulses over loads": gp.pulse_velocities(many, np.array([100.0, 6500.0]), (0.3, 0.7)),
        "one pulse": gp.pulse_velocities(hard, 100.0, branches=("transverse",)),
        "modes": lattice.modes([[0.3, 0.4], [1.0, 0.2]]),
        "modes without friction": smooth.modes([[0.3, 0.4]]),
        "modes of three balls": gp.ContactLattice.of("kagome", 0.8).modes([[0.3, 0.4]]),
        "state": one,
        "states": many,
        "validity": gp.validity(one),
        "validity over loads": gp.validity(many),
        "check": gp.validity(hard)["load"],
    }


NAMES = [
    "velocities", "velocities over loads", "velocities with warnings", "moduli", "moduli over loads", "moduli with warnings",
    "pulses", "pulses over loads", "one pulse", "modes", "modes without friction", "modes of three balls", "state", "states",
    "validity", "validity over loads", "check",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_round_trip_through_json(results, name):
    result = results[name]
    data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert data["class"] == type(result).__name__
    assert data["schema"] == type(result).schema
    assert data["units"] == dict(type(result).units)
    same(type(result).from_dict(data), result)
    same(type(result).from_dict(result.to_dict()), result)


@pytest.mark.parametrize("name", NAMES)
def test_results_are_frozen_and_their_arrays_read_only(results, name):
    result = results[name]
    for field in dataclasses.fields(result):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(result, field.name, 0.0)
        value = getattr(result, field.name)
        if isinstance(value, np.ndarray):
            with pytest.raises(ValueError, match="read-only"):
                value.flat[0] = 0.0
        restored = getattr(type(result).from_dict(result.to_dict()), field.name)
        if isinstance(restored, np.ndarray):
            assert not restored.flags.writeable


@pytest.mark.parametrize(
    ("cls", "units"),
    [
        (SoundVelocities, dict.fromkeys(["longitudinal", "transverse", "longitudinal_error", "transverse_error"], "m/s")),
        (Moduli, dict.fromkeys(["tensor", "bulk", "shear", "shears", "bulk_error", "shear_error"], "Pa")),
        (PulseVelocities, {"phase": "m/s", "group": "m/s", "group_vector": "m/s", "wavenumber": "rad/m", "frequency": "Hz"}),
        (Modes, {"wavevectors": "1/d", "frequencies": "(k/M)^1/2", "group_velocities": "d (k/M)^1/2"}),
    ],
)
def test_every_quantity_says_its_unit(cls, units):
    assert dict(cls.units) == units
    assert issubclass(cls, Result)
    assert issubclass(Check, Result)
    assert issubclass(Validity, Result)


def test_scalars_are_floats(results):
    for name, fields in (("velocities", ("longitudinal", "transverse")), ("moduli", ("bulk", "shear"))):
        for field in fields:
            assert isinstance(getattr(results[name], field), float)
    assert type(results["pulses"].frequency) is float


def test_moduli_come_back_with_bulk_and_shear(results):
    again = Moduli.from_dict(json.loads(json.dumps(results["moduli over loads"].to_dict())))
    assert_array_equal(again.bulk, results["moduli over loads"].bulk)
    assert_array_equal(again.shear, results["moduli over loads"].shear)


def test_data_of_another_class_a_newer_schema_or_incomplete(results):
    data = results["velocities"].to_dict()
    with pytest.raises(InputError, match=r"SoundVelocities.*Moduli"):
        Moduli.from_dict(data)
    with pytest.raises(InputError, match="newer"):
        SoundVelocities.from_dict(data | {"schema": SoundVelocities.schema + 1})
    del data["transverse"]
    with pytest.raises(InputError, match="lack transverse"):
        SoundVelocities.from_dict(data)
    with pytest.raises(InputError, match="describe"):
        SoundVelocities.from_dict({})


def test_state_comes_back_whole(results):
    again = gp.ContactState.from_dict(json.loads(json.dumps(results["state"].to_dict())))
    assert again.packing == results["state"].packing
    assert again.law == results["state"].law
    assert gp.sound_velocities(again).longitudinal == gp.sound_velocities(results["state"]).longitudinal


def test_state_on_a_lattice_of_ones_own_comes_back(steel):
    mine = gp.Lattice("mine", ((1.0, 0.0), (0.5, math.sqrt(0.75))))
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice=mine)).at_force(1.0)
    again = gp.ContactState.from_dict(json.loads(json.dumps(state.to_dict())))
    assert again.packing.structure == mine
    assert gp.sound_velocities(again).transverse == gp.sound_velocities(state).transverse


def test_read_only_copies():
    values = np.array([1.0, 2.0])
    kept = read_only(values)
    values[0] = 5.0
    assert kept.tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        kept[0] = 0.0


def test_copies_and_pickles_are_equal_and_read_only():
    import copy
    import pickle

    steel = gp.Material(211.65e9, 0.276, 7840.0)
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3)).at_force([1.0, 2.0])
    for other in (copy.deepcopy(state), pickle.loads(pickle.dumps(state))):
        assert other == state
        assert not other.force.flags.writeable
    assert state != gp.AveragedLattice(gp.Packing(steel, 8e-3)).at_force([1.0, 3.0])
    assert state != 3
    assert len(repr(gp.Phonons(state[0]).bands(npoints=51))) < 1000
