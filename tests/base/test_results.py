"""Results are frozen, read-only, and go to plain data and back."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import json
import math
import pickle
import pkgutil
import random
from functools import cache
from types import FunctionType, GenericAlias, NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import granphon
import granphon as gp
from granphon.balls.loads import Load
from granphon.base.arrays import Array, Complex, Flags, Index
from granphon.base.errors import InputError, MissingFileError, Refused, UnverifiedFileWarning
from granphon.base.results import (
    Result,
    describe_value,
    held,
    read_only,
    restore,
    result_class,
)
from granphon.dynamics.contact_lattice import Modes
from granphon.dynamics.local_field import LocalField
from granphon.dynamics.sensitivities import Sensitivities
from granphon.fits.fit import Fitted
from granphon.fits.measurements import Measurements
from granphon.observables.validity import Check, Validity
from granphon.observables.velocities import AveragedModuli, Moduli, PulseVelocities, SoundVelocities
from granphon.runs.tasks import SampleRecord
from granphon.tradeoffs.measure import MeasuredPoint, TradeOff
from granphon.waves.chebyshev import Refinable
from granphon.waves.path_spectra import find_path_spectra


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
    one, many, hard = (
        medium.at_force(18.446),
        medium.at_force([[1.0, 2.0], [3.0, 4.0]]),
        medium.at_overlap(8e-4),
    )
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
        "non-affine motion": gp.find_nonaffine(one.network.repeat((3, 3))),
        "validity of a network": gp.validity(one.network.repeat((3, 3))),
    }


def test_round_trip_through_json(results):
    for result in results.values():
        data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
        assert data["class"] == type(result).__name__
        assert data["schema"] == type(result)._schema
        assert data["units"] == dict(type(result).units)
        same(type(result).from_dict(data), result)
        same(type(result).from_dict(result.to_dict()), result)
    moduli = results["moduli over loads"]
    again = Moduli.from_dict(json.loads(json.dumps(moduli.to_dict())))
    assert_array_equal([again.bulk, again.shear], [moduli.bulk, moduli.shear])


def test_results_are_frozen_and_their_arrays_read_only(results):
    for result in results.values():
        again = type(result).from_dict(result.to_dict())
        for name in (field.name for field in dataclasses.fields(result)):
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(result, name, 0.0)
            for value in (getattr(result, name), getattr(again, name)):
                if isinstance(value, np.ndarray):
                    with pytest.raises(ValueError, match="read-only"):
                        value.flat[0] = 0.0


VELOCITIES = "longitudinal", "transverse", "longitudinal_error", "transverse_error"
MODULI = "tensor", "bulk", "shear", "shears", "bulk_error", "shear_error", "tensor_error"


@pytest.mark.parametrize(
    ("cls", "units"),
    [
        (
            SoundVelocities,
            dict.fromkeys([*VELOCITIES, "out_of_plane", "twist", "velocities"], "m/s"),
        ),
        (Moduli, dict.fromkeys(MODULI, "Pa") | {"anisotropy_error": "1"}),
        (AveragedModuli, {"bulk": "Pa", "shear": "Pa"}),
        (
            PulseVelocities,
            {
                "phase": "m/s",
                "group": "m/s",
                "group_vector": "m/s",
                "wavenumber": "rad/m",
                "frequency": "Hz",
            },
        ),
        (
            Modes,
            {"wavevectors": "1/d", "frequencies": "(k/M)^1/2", "group_velocities": "d (k/M)^1/2"},
        ),
    ],
)
def test_every_quantity_says_its_unit(cls, units):
    assert dict(cls.units) == units
    assert issubclass(cls, Result)
    assert issubclass(Check, Result)
    assert issubclass(Validity, Result)


def test_a_result_shows_what_a_user_calls_alone():
    assert {name for name in dir(Result) if not name.startswith("_")} == {
        "from_dict",
        "to_dict",
        "units",
    }


def test_scalars_are_floats(results):
    for name, fields in (
        ("velocities", ("longitudinal", "transverse")),
        ("moduli", ("bulk", "shear")),
    ):
        for field in fields:
            assert isinstance(getattr(results[name], field), float)
    assert type(results["pulses"].frequency) is float


def test_data_of_another_class_or_schema_or_incomplete(results):
    data = results["velocities"].to_dict()
    with pytest.raises(InputError, match=r"SoundVelocities.*Moduli"):
        Moduli.from_dict(data)
    with pytest.raises(InputError, match=r"schema 2.*schema 1"):
        SoundVelocities.from_dict(data | {"schema": SoundVelocities._schema + 1})
    del data["transverse"]
    with pytest.raises(InputError, match="lack transverse"):
        SoundVelocities.from_dict(data)
    with pytest.raises(InputError, match="describe"):
        SoundVelocities.from_dict({})


def test_data_of_other_kinds_shapes_and_units_are_refused(results):
    def refused(name, words, **changes):
        data = results[name].to_dict() | changes
        del data["digest"]
        with pytest.raises(InputError, match=words):
            type(results[name]).from_dict(data)

    good = results["state"].to_dict()["packing"]
    refused(
        "velocities",
        "longitudinal .*numbers",
        longitudinal="790",
    )
    refused("velocities", "lack a wave", longitudinal=None)
    refused("velocities", "warnings: found a str, 'none', where", warnings="none")
    refused(
        "velocities",
        r"direction .*\(1, 1, 3\) .*\(p\) or \(n p\)",
        direction=[[[1.0, 0.0, 0.0]]],
    )
    refused(
        "velocities over loads",
        r"transverse .* has the shape \(2,\) instead of \(...\)",
        transverse=[1.0, 2.0],
    )
    refused("velocities", "have 'more'", more=1)
    refused(
        "velocities",
        "units of the SoundVelocities",
        units={"longitudinal": "km/s"},
    )
    refused("velocities", "schema '1'", schema="1")
    refused("velocities", "schema true", schema=True)
    refused("moduli", "isotropic: found an int, 1", isotropic=1)
    refused(
        "moduli",
        "tensor: found a list",
        tensor=[[1.0, 2.0], [3.0]],
    )
    refused("moduli", "tensor: found a list", tensor=[["1"] * 3] * 3)
    refused("moduli", "tensor: found a list", tensor=[[True] * 3] * 3)
    refused("moduli", r"\(3, 3, 1\) instead of \(... 3 3\)", tensor=[[[1.0]] * 3] * 3)
    refused("modes", "eigenvectors: found a mapping", eigenvectors={"real": [[1.0]], "imag": [1.0]})
    refused("modes", "eigenvectors: found a list", eigenvectors=[[1.0]])
    refused("modes", r"b = 3", rotational_fraction=[[1.0], [1.0]])
    refused("state", "lack diameter", packing={k: v for k, v in good.items() if k != "diameter"})
    refused("state", "diameter: found '8 mm'", packing=good | {"diameter": "8 mm"})
    refused("state", "diameter", packing=good | {"diameter": -1.0})
    refused("state", "Packing.lattice: found an int", packing=good | {"lattice": 3})
    refused("state", "data of a 'Popen'", packing={"class": "Popen"})
    refused("state", "ContactState.packing: found nothing", packing=None)
    refused(
        "validity", "Check.limit: found a str", checks=[results["check"].to_dict() | {"limit": "1"}]
    )


def deep(data, path, value):
    """A copy of plain data with another value at a path; ``...`` removes it."""
    if not path:
        return value
    copied = dict(data) if isinstance(data, dict) else list(data)
    if len(path) == 1 and value is ...:
        del copied[path[0]]
    else:
        copied[path[0]] = deep(copied[path[0]], path[1:], value)
    return copied


def places(data, path=()):
    """Paths of everything in plain data."""
    if path:
        yield path
    pairs = (
        data.items()
        if isinstance(data, dict)
        else enumerate(data)
        if isinstance(data, list)
        else ()
    )
    for key, value in pairs:
        yield from places(value, (*path, key))


def make_states(packing, results):
    medium = gp.DirectSimulation(spread_of(packing), (4, 8), seed=1, samples=2, geometry="lattice")
    simulated = medium.at_force([1.0, 5.0])
    records = [SampleRecord.of(sample) for sample in simulated.samples]
    recorded = gp.SimulatedState.of(medium, records, Load("force", (1.0, 5.0)))
    assert recorded.n_samples == 2
    assert recorded.exponent_error.tolist() == simulated.exponent_error.tolist()
    # records stand where samples do, at all loads and at one
    assert recorded.samples == tuple(records)
    assert recorded[1].samples == tuple(records[2:])
    assert recorded.sample[1] == records[2]
    sample = simulated.samples[0]
    found = [*results.values(), results["moduli"].hill, simulated]
    return [*found, sample, sample.equilibrium, sample.network]


def make_equilibria(packing, results):
    spread = spread_of(packing)
    history = {"friction_history": True, "friction_coefficient": 0.3, "step_tolerance": 1.0}
    pressed = gp.DirectSimulation(spread, (4, 4), seed=1, **history).at_force(5.0).sample
    exact = gp.DirectSimulation(spread, (4, 4), seed=1, geometry="exact").at_force(5.0).sample
    hexagon = gp.Hexagon(spread, 2).at_side_force(5.0)
    local_field = LocalField(2.0, 0.5, 0.3, 0.8, "triangular")
    return [pressed, pressed.equilibrium, exact.equilibrium, hexagon, local_field]


def make_fits(packing, results):
    force = np.array([1.0, 5.0, 20.0])
    spread = spread_of(packing)
    velocities = gp.sound_velocities(gp.EffectiveMedium(spread).at_force(force)).longitudinal
    point = MeasuredPoint(
        "ema", "", np.array([[0.1]]), np.array([[1e-3]]), 1.0, 0.1, 0.2, 3, 1e-9, True
    )
    strip = surface_of(packing).network.cut(1, 3)
    hertz = [2e3, 5e3, 7e3]
    places = {"direction": (0, 1), "polarisation": (0, 1)}
    response = gp.Waves(strip).response(hertz, (0, "y"), "plane", damping=1e-6, **places)
    measured = np.abs(response.coherent)
    transfer = gp.TransferFunction(hertz, measured, None, 0.01 * measured)
    times = 1e-6 * np.arange(600)
    phase = np.clip((times - np.array([[2e-4], [3e-4]])) * 5e3, 0.0, 1.0)
    traces = gp.Traces(times, np.sin(np.pi * phase) ** 2, [0.0, 0.05])
    return [
        traces,
        traces.velocity(),
        Measurements(force, 500.0 * force ** (1 / 6), 1.0),
        gp.fit_width(spread, force, velocities, 2.0),
        point,
        TradeOff((point,), "force", (1.0,), ("velocities",), "x", 5, 1.0, 2.0),
        transfer,
        gp.fit_damping(strip, transfer, (0, "y"), "plane", **places),
    ]


def make_spectra(packing, results):
    phonons = gp.Phonons(results["state"])
    surface = surface_of(packing)
    bands = phonons.bands([[0, 0], [0.5, 0]], npoints=2)
    found = [bands, phonons.dos(mesh=(4, 4), points=12), phonons.modes([[0.1, 0.2]])]
    found += [surface.spectrum([[0.3]], [1e3, 2e3]), surface.branches([[0.3]])]
    found.append(surface.sensitivities([[0.3]]))
    in_plane = gp.Phonons(surface.network)
    return [*found, in_plane.complex_bands([1e3, 2e3], 1), in_plane.onset()]


def make_crystals(packing, results):
    balls = [gp.Ball(packing.material, 8e-3), gp.Ball(packing.material, 6e-3)]
    chain = gp.Crystal.on("chain", balls)
    return [chain, chain.at_force(5.0)]


def make_waves_in_samples(packing, results):
    state = gp.DirectSimulation(spread_of(packing), (4, 8), seed=1).at_force(1.0)
    waves = gp.Waves(state.sample)
    path = find_path_spectra(
        waves,
        gp.ContactLattice.of("triangular", packing.mindlin_ratio),
        state.scales,
        [np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])],
        ["G", "M"],
        points=3,
        polarisations=["longitudinal"],
        resolution=1e4,
    )
    return [
        waves.dos(moments=4, vectors=2),
        waves.spectral_function(waves.nearest_wavevectors([100.0, 0.0]), moments=4),
        waves.modes(1),
        waves.network,
        waves.transmit(6.5e3, direction=(0, 1), distance=0.03, cycles=1),
        path,
    ]


def make_waves_in_strips(packing, results):
    network = surface_of(packing).network
    strip = network.cut(1, 3)
    runs = [gp.transmission(network, strip, network, [1e3, 2e3], axis=1)] * 2
    longer = gp.transmission(network, network.cut(1, 4), network, [1e3, 2e3], axis=1)
    waves = gp.Waves(strip)
    velocities = np.tile([1e-3, 1e-3, 0.0], (strip.n_balls, 1))
    return [
        runs[0],
        gp.scattering_lengths([*runs, longer, longer]),
        waves.response([1e3, 2e3], (0, "x"), (1, "x"), 1e-6),
        waves.local_dos(0, [1e3]),
        waves.damped_modes(2, damping=1e-6),
        gp.NonlinearWaves(strip).run(1e-5, velocities=velocities, frames=2),
    ]


def make_derivatives(packing, results):
    state = results["state"]
    network = surface_of(packing).network
    response = gp.Waves(network.cut(1, 3)).response([1e3], (0, "x"), (1, "x"), 1e-6)
    mass = network.masses[0]
    goal = gp.MatchFrequencies([5e3], q=[[0.5, 0.0]], branches=[0])
    return [
        gp.Phonons(network).sensitivities([[0.1, 0.2]]),
        gp.moduli(state).sensitivities,
        gp.sound_velocities(state).sensitivities,
        response.sensitivities,
        gp.parameter_sensitivities(packing, lambda one: one.force, "density", force=1.0),
        gp.design(network, goal, "mass", (0.5 * mass, 2.0 * mass), restarts=0),
    ]


def spread_of(packing):
    return gp.Packing(packing.material, packing.diameter, gp.Uniform(2e-6))


def surface_of(packing):
    return gp.Surface(gp.AveragedLattice(packing).at_force(5.0), 1)


#: what makes results of each class that comes back from plain data
GROUPS = {
    "states": make_states,
    "equilibria": make_equilibria,
    "fits": make_fits,
    "spectra": make_spectra,
    "crystals": make_crystals,
    "waves in samples": make_waves_in_samples,
    "waves in strips": make_waves_in_strips,
    "derivatives": make_derivatives,
}


@pytest.fixture(scope="module")
def made(packing, results):
    """Makes the results of a group, by their classes, once."""

    @cache
    def make(group):
        found = GROUPS[group](packing, results)
        held = [getattr(result, "waves", None) for result in found]
        found += [waves for waves in held if waves is not None]
        return {type(result): result for result in found}

    return make


def test_every_class_of_results_is_made(made):
    def below(cls):
        return {cls, *(one for sub in cls.__subclasses__() for one in below(sub))}

    for module in pkgutil.walk_packages(granphon.__path__, "granphon."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    ours = {cls for cls in below(Result) if cls.__module__.startswith("granphon.")} - {
        Result,
        Refinable,
        Fitted,
        Sensitivities,
    }
    assert ours == {cls for group in GROUPS for cls in made(group)}


#: what plain data hold where an annotation has a type of arrays
KINDS_OF_ARRAYS = ((Array, float), (Index, np.intp), (Flags, bool), (Complex, complex))


def list_kinds(kind):
    """The kinds that a declaration or an annotation allows, each as far as both tell it apart."""
    for array, entries in KINDS_OF_ARRAYS:
        if isinstance(kind, GenericAlias) and kind == array:
            return {np.dtype(entries)}
    if isinstance(kind, FunctionType):
        kind = kind()
    if isinstance(kind, list | UnionType) or get_origin(kind) is Union:
        parts = kind if isinstance(kind, list) else get_args(kind)
        kinds = set().union(*map(list_kinds, parts))
        return {Any} if kinds == {NoneType, Any} else kinds
    if isinstance(kind, tuple) or get_origin(kind) is tuple:
        parts = kind if isinstance(kind, tuple) else get_args(kind)
        return {tuple(part if part is ... else frozenset(list_kinds(part)) for part in parts)}
    return {Any if kind is object else kind}


def test_a_field_is_declared_to_hold_what_its_annotation_says(made):
    def walk(cls):
        """A class, and those of the objects in its fields."""
        if not dataclasses.is_dataclass(cls) or cls in declared:
            return
        declared[cls] = {field.name: field.metadata for field in dataclasses.fields(cls)}
        hints[cls] = get_type_hints(cls)
        for metadata in declared[cls].values():
            for kind in flatten(list_kinds(metadata.get("kind", Any))):
                walk(kind)

    def flatten(kinds):
        for kind in kinds:
            yield from flatten(kind) if isinstance(kind, tuple | frozenset) else (kind,)

    declared, hints = {}, {}
    for group in GROUPS:
        for cls in made(group):
            walk(cls)
    assert len(declared) > 70
    for cls, fields in declared.items():
        for name, metadata in fields.items():
            said = list_kinds(hints[cls][name])
            if "kind" in metadata:
                assert list_kinds(metadata["kind"]) == said, (cls, name)
            else:  # plain data, in a class whose constructor checks them
                assert not any(map(dataclasses.is_dataclass, flatten(said))), (cls, name)


def test_a_result_declares_each_of_its_fields():
    with pytest.raises(TypeError, match=r"Bare .*value"):

        @result_class
        class Bare(Result):
            value: float


@pytest.mark.parametrize("group", GROUPS)
def test_every_result_comes_back_from_plain_data(made, group):
    for cls, result in made(group).items():
        same(cls.from_dict(json.loads(json.dumps(result.to_dict()))), result)


@pytest.mark.parametrize(
    "group",
    [pytest.param(group, marks=[pytest.mark.slow] * (group == "states")) for group in GROUPS],
)
@pytest.mark.filterwarnings("ignore::granphon.base.errors.UnverifiedFileWarning")
def test_damaged_plain_data_are_refused(made, group):
    rng = random.Random(0)
    wrongs = (
        ...,
        None,
        "x",
        True,
        -1,
        math.nan,
        [],
        {},
        [[1.0], 2.0],
        {"class": "Popen"},
        10**400,
        b"",
    )
    for cls, result in made(group).items():
        data = json.loads(json.dumps(result.to_dict()))
        assert cls.from_dict(data) == result
        paths = list(places(data))
        for path in rng.sample(paths, min(len(paths), 20)):
            damaged = deep(data, path, rng.choice(wrongs))
            if damaged == data or (path == ("digest",) and "digest" not in damaged):
                continue
            if path[0] in ("units", "schema") and len(path) == 1 and path[0] not in damaged:
                continue
            with pytest.raises(InputError):
                cls.from_dict(damaged)
            damaged.pop("digest", None)
            # not every wrong number is noticed then, but what is, is said as it should be
            with contextlib.suppress(InputError):
                assert type(cls.from_dict(damaged)) is cls


def spoil(value, number):
    """Plain data with another number in the first place; None if there is none."""
    if isinstance(value, float | int) and not isinstance(value, bool):
        return number
    parts = list(enumerate(value)) if isinstance(value, list) else []
    parts = (
        list(value.items())
        if isinstance(value, dict) and value.keys() == {"real", "imag"}
        else parts
    )
    found = next(
        ((key, put) for key, part in parts if (put := spoil(part, number)) is not None), None
    )
    return None if found is None else deep(value, found[:1], found[1])


@pytest.mark.parametrize("group", GROUPS)
def test_numbers_out_of_range_are_refused_without_a_digest_too(made, group):
    for cls, result in made(group).items():
        data = json.loads(json.dumps(result.to_dict()))
        del data["digest"]
        for name, within in cls._ranges.items():
            wrongs = {math.nan} | ({math.inf} if "infinite" not in within else set())
            wrongs |= {-1.0} if "zero" in within else set()
            wrongs |= {0.0} if within == "above zero" else set()
            for wrong in (
                wrongs if data[name] is not None and np.size(getattr(result, name)) else ()
            ):
                with pytest.raises(InputError, match=name):
                    cls.from_dict(data | {name: spoil(data[name], wrong)})


#: states, and what holds one
STATES = (
    ("states", gp.ContactState),
    ("states", gp.SimulatedState),
    ("states", gp.ContactNetwork),
    ("crystals", gp.CrystalState),
    ("crystals", gp.Crystal),
    ("equilibria", gp.PressedHexagon),
)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -1.0])
def test_a_state_takes_no_stiffness_that_is_none(made, wrong):
    """Bands would follow from it."""
    for group, cls in STATES:
        data = json.loads(json.dumps(made(group)[cls].to_dict()))
        for name in {
            "normal_stiffness",
            "shear_stiffness",
            "torsion",
            "wall_coefficient",
        } & data.keys():
            spoiled = {**data, name: spoil(data[name], wrong)}
            del spoiled["digest"]
            with pytest.raises(InputError, match=name):
                cls.from_dict(spoiled)


@pytest.mark.parametrize(
    ("path", "wrong"),
    [
        (("kind", 0), 7),
        (("kind", 0), -1),
        (("names",), ["A"]),
        (("bending",), -1.0),
        (("motions",), "sideways"),
        (("contacts", "i", 0), -1),
        (("contacts", "j", 0), 9),
        (("contacts", "vector", 0, 0), 1e-3),
        (("contacts", "normal", 0, 0), math.nan),
        (("contacts", "arm_i", 0), -4e-3),
        (("contacts", "arm_j", 0), math.nan),
    ],
)
def test_a_crystal_takes_what_its_constructor_could_have_made(made, path, wrong):
    data = json.loads(json.dumps(made("crystals")[gp.Crystal].to_dict()))
    del data["digest"]
    with pytest.raises(InputError):
        gp.Crystal.from_dict(deep(data, path, wrong))
    with pytest.warns(UnverifiedFileWarning):
        assert gp.Crystal.from_dict(data) == made("crystals")[gp.Crystal]


@pytest.mark.parametrize(
    "wrong", [np.array([1.0, 2.0]), np.array(["a", "b"]), np.ma.array([1, 2], mask=[0, 1]), [[]]]
)
def test_arrays_where_names_and_digests_belong_are_refused(results, wrong):
    data = results["state"].to_dict()
    bare = {name: value for name, value in data.items() if name != "digest"}
    for name in ("class", "digest", "units", "schema"):
        with pytest.raises(InputError):
            gp.ContactState.from_dict(data | {name: wrong})
    parts = [{name: bare[name] | {"class": wrong}} for name in ("packing", "law")]
    for part in ({"units": dict.fromkeys(bare["units"], wrong)}, *parts):
        with pytest.raises(InputError) as error:
            gp.ContactState.from_dict(bare | part)
        assert "\n" not in str(error.value)


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

    steel = gp.Material(211.65e9, 0.276, 7840.0)
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3)).at_force([1.0, 2.0])
    for other in (copy.deepcopy(state), pickle.loads(pickle.dumps(state))):
        assert other == state
        assert not other.force.flags.writeable
    assert state != gp.AveragedLattice(gp.Packing(steel, 8e-3)).at_force([1.0, 3.0])
    assert state != 3
    assert len(repr(gp.Phonons(state[0]).bands(npoints=51))) < 1000


def test_a_result_prints_its_numbers_and_their_units():
    state = gp.AveragedLattice(gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)).at_force(
        18.446
    )
    moduli = gp.moduli(state)
    assert repr(moduli).endswith(
        f"isotropic=yes, cubic=no, bulk={moduli.bulk:.6g} Pa, shear={moduli.shear:.6g} Pa)"
    )
    assert repr(state).startswith(
        "ContactState(packing=Packing, medium=ala, force=18.446 N, overlap=1.93925e-06 m, "
    )


def test_a_refusal_goes_on_with_what_is_no_sentence_of_its_own():
    assert (
        str(Refused("1", "a word", "the table is empty."))
        == "found 1; allowed: a word; the table is empty."
    )
    assert (
        str(Refused("1", "a word", "Did you mean 'one'?"))
        == "found 1; allowed: a word. Did you mean 'one'?"
    )
    assert str(Refused("1", "a word")) == "found 1; allowed: a word."


@pytest.mark.parametrize(
    "error",
    [InputError("short"), Refused("1", "a word", "mend it", ("key", 2)), MissingFileError("gone")],
)
def test_an_error_that_is_restated_keeps_all_but_its_text(error):
    error.load_index = 3
    error.option = "start"
    error.reached = {"force": 1.0}
    told = str(error)
    other = error.restate("elsewhere: short")
    for one in (other, pickle.loads(pickle.dumps(other))):
        assert (type(one), str(one)) == (type(error), "elsewhere: short.")
        assert vars(one) == vars(error)
    assert str(error) == told


@result_class
class Spot(Result, array="places"):
    """Of no use but to be a result: points in the plane, each with a weight, or in space."""

    places: Array = held(float, "m 2|n 3", default_factory=lambda: np.zeros((1, 3)))
    weights: Array = held(float, "m", default_factory=lambda: np.zeros(4))
    mass: float = held(float, default=1.0)
    about: Any = held(object, default=None)


def test_results_whose_numbers_are_not_known_are_equal():
    def make(mass=math.nan, more=math.nan):
        return Spot(mass=mass, about=({"error": more}, [more]))

    assert make() == make()
    assert make(float("nan"), float("nan")) == make()
    assert make() == pickle.loads(pickle.dumps(make()))
    assert make() != make(1.0)
    assert make() != make(more=1.0)


def test_results_that_hold_objects_with_arrays_are_compared_entry_by_entry():
    @dataclasses.dataclass
    class Holder:
        places: Any

    def make(last):
        return Spot(about=Holder(np.array([0.0, last])))

    assert make(1.0) == make(1.0)
    assert make(1.0) != make(2.0)
    assert Spot(about=Holder) == Spot(about=Holder)


def test_a_shape_that_does_not_fit_says_nothing_of_the_others():
    # the first layout takes 5 for m, and fails: m is free for the weights
    spot = Spot(places=np.zeros((5, 3)))
    spot._check()
    with pytest.raises(InputError, match="weights"):
        Spot(places=np.zeros((5, 2)))._check()


def test_whole_numbers_that_an_array_cannot_hold_are_refused():
    assert restore([2**62], np.dtype(np.int64)).tolist() == [2**62]
    for wrong in ([2**63], [1, 2**64 - 1], [2**64]):
        with pytest.raises(InputError, match="array of whole numbers"):
            restore(wrong, np.dtype(np.int64))


def test_whole_numbers_become_floats_where_floats_are_asked_for():
    for large in ([10**20], [2**64, -1.5], [[10**20, 1], [2, 3]]):
        for kind in (np.dtype(float), Any):
            restored = restore(large, kind)
            assert restored.dtype == float
            assert_array_equal(restored, np.array(large, float))
    one = restore(3, float)
    assert type(one) is float
    assert one == 3.0
    for wrong, kind in ((10**400, float), ([10**400], np.dtype(float)), ([2**64, True], Any)):
        with pytest.raises(InputError, match="needed"):
            restore(wrong, kind)


def test_an_empty_array_of_more_axes_than_numpy_has_is_refused():
    with pytest.raises(InputError, match="needed"):
        restore({"shape": [0] * 100}, np.dtype(float))


def test_a_size_is_not_below_what_its_word_adds():
    @result_class
    class Steps(Result):
        ends: Any = held(float, "s+1")

    Steps(ends=np.zeros(1))._check()
    with pytest.raises(InputError, match="shape"):
        Steps(ends=np.zeros(0))._check()


def test_complex_numbers_that_are_not_known_are_equal():
    @dataclasses.dataclass(frozen=True)
    class Holder:
        value: Any

    assert Spot(about=complex(np.nan, 1.0)) == Spot(about=complex(np.nan, 1.0))
    assert Spot(about=complex(1.0, 2.0)) != Spot(about=complex(1.0, np.nan))
    assert describe_value(np.array(1.0 + 2.0j)) == "(1+2j)"
    assert "Holder" in describe_value([Holder, Holder])


def test_the_array_of_a_result_is_a_copy_unless_that_is_refused():
    spot = Spot()
    copied = np.asarray(spot)
    copied[0] = 1.0
    assert_array_equal(spot.places, 0.0)
    assert spot.__array__(copy=False) is not copied
    assert np.shares_memory(spot.__array__(copy=False), spot.places)
    assert not spot.__array__(copy=False).flags.writeable
