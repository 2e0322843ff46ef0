"""The automatic medium: the cheapest that is within a tolerance, in every place where media are
named.
"""

from __future__ import annotations

import csv
import json
import pickle
import re
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.balls.lattices import find_lattice
from granphon.balls.loads import Load
from granphon.base.errors import InputError, SceneError
from granphon.base.scales import write_quantity
from granphon.cli.main import main
from granphon.media.accuracy import find_error, find_rows
from granphon.media.choice import SIDES, MediumChoice, choose_shape, list_candidates
from granphon.media.left_out import expect_shear_deficit
from granphon.runs.dataset import load_sweep
from granphon.runs.sweep import sweep
from granphon.scene.scene import Scene

WIDTH = 2.04e-6
KINDS = ("force", "pressure", "overlap")
AUTO = "tolerance, friction_history, friction_coefficient, shear_response"
SCENE = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 2.04 um}}
load: {force: 18.446 N}
medium: {auto: {tolerance: 2e-3}}
"""
SWEEP = SCENE.replace("18.446 N", "[6 N, 18.446 N, 90 N]").replace("2e-3", "5e-3")


@pytest.fixture
def work(work):
    """The working folder with a scene of one state, and one of a sweep."""
    (work / "sweep.yaml").write_text(SWEEP, encoding="utf-8")
    return work


def refused(work, capsys, text, *arguments):
    """The one line of an error of exit code 2, which leaves nothing behind."""
    (work / "scene.yaml").write_text(text, encoding="utf-8")
    before = {path.name for path in work.iterdir()}
    assert main([*arguments] or ["run", "scene.yaml", "-o", "out"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("granphon: error: ")
    assert err.count("\n") == 1
    assert {path.name for path in work.iterdir()} == before
    return err


# -- the choice ------------------------------------------------------------------------------------


@settings(max_examples=10)
@given(
    st.lists(st.floats(3.1e-3, 1e5), min_size=1, max_size=4),
    st.floats(-3.5, -0.02),
    st.booleans(),
    st.sampled_from(["force", "pressure"]),
)
def test_the_choice_is_the_first_of_all_that_is_within_the_tolerance(
    places, exponent, friction, kind
):
    packing = gp.Packing(gp.Material(70e9, 0.2, 2500.0), 1e-3, gp.Normal(3e-7), friction=friction)
    loads = np.array(places) * packing.law.coefficient * packing.width**1.5
    loads *= 3.0**0.5 / packing.diameter if kind == "pressure" else 1.0
    tolerance = 10.0**exponent
    candidates = list_candidates(packing)
    errors = np.array([one.expected_error(packing, Load(kind, loads)) for one in candidates])
    within = errors <= tolerance
    medium = gp.AutoMedium(packing, tolerance)
    if not np.all(np.any(within, axis=0)):
        with pytest.raises(InputError, match="expected error") as error:
            medium.choose(kind, loads)
        assert not np.any(within[:, error.value.load_index])
        return
    first = np.argmax(within, axis=0)
    found = medium.choose(kind, loads)
    assert sorted(np.concatenate([serving.loads for serving in found]).tolist()) == list(
        range(len(loads))
    )
    for serving in found:
        assert_array_equal(first[serving.loads], candidates.index(serving.medium))
        assert_array_equal(serving.errors, errors[first[serving.loads], serving.loads])
    # the one medium of all is the first that is within it everywhere
    serves_all = np.all(within, axis=1)
    expected = candidates[int(np.argmax(serves_all))] if np.any(serves_all) else candidates[-1]
    assert medium.serving(kind, loads) == expected


@pytest.mark.parametrize("lattice", ["triangular", "fcc", "hcp"])
def test_averages_come_before_arrays_of_more_and_more_balls(rough, lattice):
    packing = replace(rough, lattice=lattice)
    candidates = list_candidates(packing)
    assert [medium.label for medium in candidates[:3]] == ["ala", "afa", "ema"]
    balls = [medium.of(packing).balls for medium in candidates[3:]]
    assert balls == sorted(set(balls))
    assert len(balls) == len(SIDES[packing.structure.periods])


def test_at_one_per_cent_the_averaged_lattice_serves_high_loads_and_small_arrays_the_others(
    rough, unit
):
    """The rms error of v_T over 32 arrays of 24 x 24 balls would be 1 % with 16, 47 and 73 balls a
    side at f* = 0.1, 0.03 and 0.01.
    """
    forces = np.array([3.0, 1.0, 0.3, 0.1, 0.03, 0.01]) * unit
    chosen = gp.AutoMedium(rough, 0.01)
    labels = [chosen.serving("force", force).label for force in forces]
    assert labels[:2] == ["ala", "ala"]
    sides = [dict(chosen.serving("force", force).options)["shape"][0] for force in forces[2:]]
    assert sides == [16, 32, 80, 128]


@pytest.mark.parametrize("lattice", ["triangular", "fcc", "hcp"])
@pytest.mark.parametrize("side", [8, 16, 24, 40, 96])
def test_samples_are_as_wide_in_all_directions_as_their_cells_allow(lattice, side):
    structure = find_lattice(lattice)
    shape = choose_shape(structure, side)
    lengths = np.array(shape) * np.linalg.norm(structure.vectors, axis=1)
    assert np.all(np.abs(lengths - side) <= 0.5 * np.linalg.norm(structure.vectors, axis=1))
    if structure.n_balls == 1:
        assert shape == (side,) * structure.periods


@pytest.mark.parametrize("lattice", ["fcc", "hcp"])
@pytest.mark.parametrize("kind", KINDS)
def test_in_space_the_cheapest_that_is_within_the_tolerance_is_taken(rough, unit, lattice, kind):
    packing = replace(rough, lattice=lattice)
    places = np.array([30.0, 1.0, 0.1])
    force = {"force": 1.0, "pressure": 8.0**0.5 / packing.diameter**2}
    spacing = np.array([10.0, 1.49, 0.66])
    loads = (spacing - 0.5) * WIDTH if kind == "overlap" else places * unit * force[kind]
    found = gp.AutoMedium(packing, 0.01).choose(kind, loads)
    chosen = {int(place): serving for serving in found for place in serving.loads}
    assert [chosen[0].medium.label, chosen[2].medium.name] == ["ala", "simulation"]
    sizes = [gp.DirectSimulation(packing, chosen[2].medium.settings["shape"]).balls]
    for tolerance in (0.03, 3e-3):
        (serving,) = gp.AutoMedium(packing, tolerance).choose(kind, loads[2])
        sizes.append(serving.medium.of(packing).balls if serving.medium.simulates else 0)
    assert sizes[1] <= sizes[0] < sizes[2]
    # four times the balls for half of the error
    assert 4.0 < sizes[2] / sizes[0] < 40.0
    with pytest.raises(InputError, match=r"of a simulation of (884,736|1,087,488) balls"):
        gp.AutoMedium(packing, 1e-7).choose(kind, loads)


def test_on_a_line_every_medium_is_exact(rough, unit):
    chain = replace(rough, lattice="chain")
    for kind in KINDS:
        (serving,) = gp.AutoMedium(chain, 1e-12).choose(kind, [1e-9, 5e-7])
        assert (serving.medium, serving.errors.tolist()) == (MediumChoice("ala"), [0.0, 0.0])
    state = gp.AutoMedium(chain, 1e-12).at_force(3.0 * unit)
    samples = gp.DirectSimulation(chain, (64,)).at_force(3.0 * unit)
    assert_allclose(state.normal_stiffness, samples.normal_stiffness, rtol=1e-10)


def test_the_slow_effective_medium_of_a_long_list_is_no_candidate(unit):
    lot = gp.Measured(tuple((8e-3 + 2e-6 * np.random.default_rng(0).normal(size=300)).tolist()))
    packing = gp.Packing(gp.Material(70e9, 0.28, 2500.0), lot.mean, lot)
    assert [medium.name for medium in list_candidates(packing)[:3]] == ["ala", "afa", "simulation"]
    load = packing.law.coefficient * packing.width**1.5
    assert gp.AutoMedium(packing, 1e-3).serving("force", load).simulates


@pytest.mark.parametrize(
    "tolerance", [0.0, 1.0, -1e-3, np.nan, np.inf, "0.1", None, [0.1], np.array([0.1, 0.2])]
)
def test_a_tolerance_is_a_number_between_zero_and_one(rough, tolerance):
    with pytest.raises(InputError, match="tolerance: found"):
        gp.AutoMedium(rough, tolerance)


def test_kinds_of_loads_are_named_and_finite_overlap_is_refused(rough):
    with pytest.raises(InputError, match="a side_force needs it"):
        gp.AutoMedium(rough).choose("side_force", 2.0)
    with pytest.raises(InputError, match="takes no finite_overlap"):
        gp.AutoMedium(rough).at_force(40.0, finite_overlap=True)


@pytest.mark.parametrize("kind", KINDS)
def test_its_state_is_that_of_the_medium_that_was_chosen(rough, kind):
    load = {"force": 18.446, "pressure": 4e3, "overlap": 2.05e-6}[kind]
    for tolerance, expected in (
        (0.05, gp.AveragedLattice(rough)),
        (1.2e-3, gp.EffectiveMedium(rough)),
    ):
        state = getattr(gp.AutoMedium(rough, tolerance), f"at_{kind}")(load)
        right = getattr(expected, f"at_{kind}")(load)
        assert state.medium == right.medium
        assert (state.force, state.overlap, state.normal_stiffness) == (
            right.force,
            right.overlap,
            right.normal_stiffness,
        )
        assert np.shape(state.force) == ()


def test_a_simulation_is_chosen_and_carried_out(rough, unit):
    medium = gp.AutoMedium(rough, 0.01)
    state = medium.at_force([[0.3 * unit, 5.0 * unit]])
    (chosen,) = {serving.medium for serving in medium.choose("force", 0.3 * unit)}
    assert chosen.simulates
    assert state.samples[0].equilibrium.deviations.shape == dict(chosen.options)["shape"]
    assert state.shape == (1, 2)
    assert_array_equal(state.force, chosen.of(rough).at_force([[0.3 * unit, 5.0 * unit]]).force)


@pytest.mark.slow
def test_what_was_promised_is_kept_against_a_large_sample(rough, unit):
    forces = np.array([0.5, 2.0, 20.0]) * unit
    array = gp.sound_velocities(
        gp.DirectSimulation(rough, (160, 160), 5).at_force(forces)
    ).longitudinal
    for tolerance in (0.1, 0.02, 0.01):
        for serving in gp.AutoMedium(rough, tolerance).choose("force", forces):
            found = gp.sound_velocities(
                serving.medium.of(rough).at_force(forces[serving.loads])
            ).longitudinal
            assert np.all(np.abs(found / array[serving.loads] - 1.0) <= serving.errors)
            assert np.all(serving.errors <= tolerance)


def test_what_can_be_had_is_said_where_nothing_is_within(rough, unit):
    loads = np.array([50.0, 0.01, 3.0]) * unit
    with pytest.raises(InputError, match=r"no medium .* 1e-05") as error:
        gp.AutoMedium(rough, 1e-5).choose("force", loads)
    best = min(
        float(one.expected_error(rough, Load("force", loads[1]))) for one in list_candidates(rough)
    )
    assert f"{best:.2g}, of a simulation of 1,048,576 balls" in str(error.value)
    assert error.value.load_index == 1
    # and that much is indeed to be had
    assert gp.AutoMedium(rough, best).choose("force", loads[1])


def test_below_the_known_loads_it_says_from_where_they_are(rough, unit):
    least = write_quantity(0.003 * unit, "N", 4)
    with pytest.raises(InputError, match=f"not known at force = .* N.* {least} on"):
        gp.AutoMedium(rough, 0.9).at_force([1.0 * unit, 0.001 * unit])
    with pytest.raises(InputError, match=r"a\* = 0\.4\. .*a\* = 0\.42 on"):
        gp.AutoMedium(rough, 0.9).at_overlap(-0.1 * WIDTH)


# -- sweeps ----------------------------------------------------------------------------------------


def pieced(packing, kind, loads, tolerance):
    """(n_loads, 2) labels and errors, load by load."""
    out = []
    for load in loads:
        (serving,) = gp.AutoMedium(packing, tolerance).choose(kind, load)
        out.append((serving.medium.label, float(serving.errors[0])))
    return out


def test_every_load_of_a_sweep_has_its_own_choice(rough, unit):
    forces = (np.array([4.0, 0.3, 1.0, 0.5]) * unit).tolist()
    auto = {"auto": {"tolerance": 5e-3}}
    ds = sweep(rough, force=forces, media=[auto, "ema"])
    expected = pieced(rough, "force", forces, 5e-3)
    assert len({label for label, _ in expected}) >= 4
    chosen = ds.sel(medium="auto(tolerance=0.005)")
    assert chosen["choice"].values.tolist() == [label for label, _ in expected]
    assert_array_equal(chosen["expected_error"], [error for _, error in expected])
    for index, force in enumerate(forces):
        (serving,) = gp.AutoMedium(rough, 5e-3).choose("force", force)
        state = serving.medium.of(rough).at_force(force)
        assert_allclose(
            chosen["longitudinal"][index], gp.sound_velocities(state).longitudinal, rtol=1e-12
        )
        assert_allclose(chosen["exponent"][index], gp.local_exponent(state), rtol=1e-9)
    # another medium beside it has its own error
    other = ds.sel(medium="ema")
    assert set(other["choice"].values.tolist()) == {"ema"}
    assert_array_equal(
        other["expected_error"], MediumChoice("ema").expected_error(rough, Load("force", forces))
    )
    assert "contact_force_fluctuation" not in ds


@pytest.mark.parametrize("kind", KINDS)
def test_parameters_of_a_sweep_change_the_choice(rough, kind):
    loads = {"force": [100.0, 20.0], "pressure": [2e4, 4e3], "overlap": [6e-6, 2e-6]}[kind]
    widths = [0.0, 2e-6]
    frictions = [True, False]
    ds = sweep(
        rough,
        **{kind: loads},
        media={"auto": {"tolerance": 3e-3}},
        width=widths,
        friction=frictions,
    )
    assert ds["choice"].dims == ("load", "medium", "width", "friction")
    for width in widths:
        for friction in frictions:
            packing = gp.Packing(rough.material, 8e-3, gp.Uniform(width), friction=friction)
            point = ds.isel(medium=0).sel(width=width, friction=friction)
            expected = pieced(packing, kind, loads, 3e-3)
            assert (
                list(
                    zip(
                        point["choice"].values.tolist(),
                        point["expected_error"].values.tolist(),
                        strict=True,
                    )
                )
                == expected
            )
    assert ds["choice"].sel(width=0.0).values.ravel().tolist() == ["ala"] * 4
    assert not np.any(ds["expected_error"].sel(width=0.0))
    assert len(set(ds["choice"].values.ravel().tolist())) > 1


def test_a_choice_comes_back_from_its_files(rough, unit, tmp_path):
    forces = (np.array([4.0, 0.3, 0.5]) * unit).tolist()
    ds = sweep(
        rough,
        force=forces,
        media=["ala", {"auto": {"tolerance": 5e-3}}],
        path=tmp_path / "sweep.nc",
    )
    back = load_sweep(tmp_path / "sweep.nc")
    assert_array_equal(back["choice"], ds["choice"])
    assert_array_equal(back["expected_error"], ds["expected_error"])
    assert back["expected_error"].attrs["units"] == "1"
    assert json.loads(back.attrs["media"])[1] == {"auto": {"tolerance": 5e-3}}
    rows = list(csv.reader((tmp_path / "sweep.csv").read_text(encoding="utf-8").splitlines()))
    head = next(row for row in rows if not row[0].startswith("#"))
    place = {name.split(" ")[0]: index for index, name in enumerate(head)}
    table = rows[rows.index(head) + 1 :]
    assert [row[place["choice"]] for row in table] == ds["choice"].values.ravel().tolist()
    assert [float(row[place["expected_error"]]) for row in table] == ds[
        "expected_error"
    ].values.ravel().tolist()


def test_bands_of_a_sweep_are_those_of_what_was_chosen(rough, unit):
    forces = [0.3 * unit, 30.0 * unit]
    ds = sweep(rough, force=forces, media={"auto": {"tolerance": 0.05}}, bands="GKMG", npoints=3)
    for index, force in enumerate(forces):
        (serving,) = gp.AutoMedium(rough, 0.05).choose("force", force)
        right = gp.Phonons(serving.medium.of(rough).at_force(force)).bands("GKMG", npoints=3)
        assert_allclose(
            ds["frequencies"][index, 0],
            right.frequencies,
            rtol=1e-6,
            atol=1e-6 * right.frequencies.max(),
        )


def test_an_error_of_a_sweep_says_at_which_load(rough, unit):
    forces = [30.0 * unit, 1.0 * unit, 0.004 * unit]
    with pytest.raises(InputError, match=r"auto.*no medium .* 0\.001") as error:
        sweep(rough, force=forces, media=["ala", "auto"])
    assert error.value.load_index == 2


def test_a_simulated_piece_that_fails_says_at_which_load_of_the_sweep(rough, unit, monkeypatch):
    from granphon.base.errors import ConvergenceError
    from granphon.media import loading

    forces = (np.array([4.0, 0.3, 1.0, 0.35]) * unit).tolist()
    known = loading.bring_to_rest

    def failing(deviations, load, *rest):
        if load.force is not None and abs(load.force - 0.35) < 1e-6:
            raise ConvergenceError("it has not come to rest.")
        return known(deviations, load, *rest)

    monkeypatch.setattr(loading, "bring_to_rest", failing)
    with pytest.raises(ConvergenceError, match=r"simulation.*force = .*come to rest") as error:
        sweep(rough, force=forces, media={"auto": {"tolerance": 5e-3}})
    assert error.value.load_index == 3


# -- arrays loaded with friction -------------------------------------------------------------------

HISTORY = {"friction_history": True, "friction_coefficient": 0.2, "shear_response": "stick"}


@pytest.mark.parametrize("lattice", ["triangular", "fcc"])
@pytest.mark.parametrize("kind", KINDS)
def test_with_a_history_the_cheapest_against_loaded_arrays_is_taken(rough, unit, kind, lattice):
    """Of the averages, and of simulations that are loaded with friction."""
    packing = replace(rough, lattice=lattice)
    truth = gp.AutoMedium(packing, **HISTORY).truth
    assert re.search("friction, mu = 0.2, .*stick", str(truth))
    d = rough.diameter
    pressure = {"triangular": 3.0**0.5 / d, "fcc": 8.0**0.5 / d**2}[lattice] * unit
    loads = {"force": unit, "pressure": pressure, "overlap": rough.width}[kind]
    loads = loads * (np.array([0.1, 0.3, 0.8]) if kind == "overlap" else np.array([0.06, 0.3, 2.0]))
    candidates = list_candidates(packing, truth)
    errors = np.array([one.expected_error(packing, Load(kind, loads), truth) for one in candidates])
    media = set()
    for tolerance in (0.2, 0.05, 0.01, 2e-3):
        for serving in gp.AutoMedium(packing, tolerance, **HISTORY).choose(kind, loads):
            media.add(serving.medium.name)
            assert serving.truth == truth
            assert np.all(serving.errors <= tolerance)
            assert serving.medium.simulates == serving.medium.history.is_loaded
            first = np.argmax(errors <= tolerance, axis=0)[serving.loads]
            assert_array_equal(first, candidates.index(serving.medium))
    assert media >= {"ala", "afa", "simulation"}


def test_errors_against_loaded_arrays_are_those_of_media_with_the_same_history(rough, unit):
    load = Load("force", np.array([0.1, 1.0]) * unit)
    truth = gp.AutoMedium(rough, **HISTORY).truth
    loaded = MediumChoice.parse({"simulation": {"shape": (32, 32), **HISTORY}})
    assert_array_equal(
        loaded.expected_error(rough, load, truth),
        find_error("simulation", rough, load, 1024, truth),
    )
    # the arrays of the table had another W/d, and leave out another part of half of the shear
    # modulus
    ratio = find_rows(rough.structure, truth)["width_ratio"]
    deficits = [expect_shear_deficit(rough, load, True, one) for one in (None, ratio)]
    expected = find_error("ema", rough, load, truth=truth) + 0.5 * np.abs(np.subtract(*deficits))
    assert_allclose(MediumChoice("ema").expected_error(rough, load, truth), expected, rtol=1e-12)
    # one that is loaded in another way, or not at all, or is compared with arrays at rest without
    # friction, has no known error
    at_rest = MediumChoice.parse({"simulation": {"shape": (32, 32)}})
    assert np.all(np.isinf(at_rest.expected_error(rough, load, truth)))
    for option in (
        {"friction_coefficient": 0.3},
        {"shear_response": "slide"},
        {"start": 0.6},
        {"ordered": True},
        {"geometry": "lattice"},
    ):
        otherwise = MediumChoice.parse({"simulation": {"shape": (32, 32), **HISTORY, **option}})
        assert np.all(np.isinf(otherwise.expected_error(rough, load, truth)))
    assert np.all(np.isinf(loaded.expected_error(rough, load)))


def test_the_options_of_a_history_are_those_of_the_truth(rough):
    auto = gp.AutoMedium(rough, 0.01, **HISTORY)
    assert {name: getattr(auto, name) for name in HISTORY} == HISTORY
    assert {name: auto.truth.options[name] for name in HISTORY} == HISTORY
    assert repr(auto).endswith(
        "tolerance=0.01, friction_history=True, friction_coefficient=0.2, shear_response='stick')"
    )
    assert (
        replace(auto, tolerance=0.1).truth == pickle.loads(pickle.dumps(auto)).truth == auto.truth
    )
    assert replace(auto, tolerance=0.1) != auto == replace(auto)
    assert auto != replace(auto, shear_response="slide")
    assert not gp.AutoMedium(rough).friction_history
    with pytest.raises(FrozenInstanceError):
        auto.friction_coefficient = 0.3


@pytest.mark.parametrize(
    ("lattice", "shape", "place", "response"),
    [
        ("triangular", (6, 6), 0.05, "stick"),
        pytest.param("triangular", (16, 16), 0.05, "stick", marks=pytest.mark.slow),
        pytest.param("fcc", (8, 8, 8), 0.06, "slide", marks=pytest.mark.exhaustive),
    ],
)
def test_its_state_with_a_history_is_that_of_the_simulation(
    rough, unit, monkeypatch, lattice, shape, place, response
):
    """The smallest array of the triangular lattice that is chosen has 16 x 16 balls, but for the
    first case.
    """
    if shape == (6, 6):
        monkeypatch.setitem(SIDES, 2, (6, *SIDES[2]))
    packing = replace(rough, lattice=lattice)
    history = {"friction_history": True, "friction_coefficient": 0.2, "shear_response": response}
    state = gp.AutoMedium(packing, 0.1, **history).at_force(place * unit)
    own = {"shape": shape, **history}
    alone = gp.DirectSimulation(packing, **own).at_force(place * unit)
    assert state.chosen_automatically
    assert state.valid
    assert_array_equal(state.elastic_tensor, alone.elastic_tensor)


def test_what_can_be_had_with_a_history_says_against_what(rough, unit):
    auto = gp.AutoMedium(rough, 1e-6, **HISTORY)
    with pytest.raises(InputError, match=r"friction, mu = 0\.2.*1,.* balls"):
        auto.choose("force", 0.1 * unit)
    with pytest.raises(InputError, match=write_quantity(0.035 * unit, "N", 4)):
        auto.choose("force", 0.02 * unit)
    least = write_quantity(0.05 * unit, "N", 4)
    with pytest.raises(InputError, match=f"They are known from .* {least} on"):
        replace(auto, packing=replace(rough, lattice="fcc")).choose("force", 0.04 * unit)
    with pytest.raises(InputError, match=r"hcp lattice.*: triangular, fcc"):
        replace(auto, packing=replace(rough, lattice="hcp")).choose("force", unit)
    with pytest.raises(InputError, match="friction_coefficient: found -1"):
        replace(auto, friction_coefficient=-1.0)
    with pytest.raises(InputError, match="shear_response"):
        replace(auto, shear_response="slip")
    # if no medium serves both loads, the largest sample of the truth does
    best = auto.serving("force", 100.0 * unit).expected_error(
        rough, Load("force", 100.0 * unit), auto.truth
    )
    assert np.isfinite(best)


@pytest.mark.parametrize(
    ("truth", "medium"),
    [pytest.param("slide", "simulation", marks=pytest.mark.slow), ("stick", "afa")],
)
def test_a_scene_names_the_friction_of_the_truth(work, capsys, truth, medium):
    """At f* = 0.1 sound meets arrays that slide as no medium has it."""
    history = (
        f"friction_history: true, friction_coefficient: 0.2, shear_response: {truth}, tolerance:"
        f" 0.1"
    )
    text = SCENE.replace("18.446 N", "2.2 N").replace("tolerance: 2e-3", history)
    (work / "scene.yaml").write_text(text, encoding="utf-8")
    assert main(["check", "scene.yaml"]) == 0
    told = f"against arrays loaded with friction, mu = 0.2, shear_response {truth}"
    assert told in capsys.readouterr().out
    assert main(["run", "scene.yaml", "-o", "out", "-q", "--no-figures"]) == 0
    summary = yaml.safe_load((work / "out" / "summary.yaml").read_text(encoding="utf-8"))
    assert summary["choice"].startswith(medium)
    assert ("friction_history=true" in summary["choice"]) == (medium == "simulation")
    assert told.endswith(summary["truth"])
    assert summary["expected_error"] <= 0.1
    assert (
        Scene.from_yaml("out/scene.yaml").serving.medium
        == Scene.from_yaml("scene.yaml").serving.medium
    )


# -- scenes and the command line -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "tolerance"),
    [
        ("auto", 1e-3),
        ("{auto: }", 1e-3),
        ("{auto: {}}", 1e-3),
        ("[auto]", 1e-3),
        ("{auto: {tolerance: 1e-3}}", 1e-3),
        ("{auto: {tolerance: 0.02}}", 0.02),
        ("{auto: {tolerance: 1.0e-2}}", 0.01),
        ("[{auto: {tolerance: .05}}]", 0.05),
        ("\n  auto:\n    tolerance: 0.9", 0.9),
    ],
)
def test_spellings_of_a_scene(text, tolerance):
    scene = Scene.from_text(SCENE.replace("{auto: {tolerance: 2e-3}}", text))
    assert scene.media == (MediumChoice("auto", (("tolerance", tolerance),)),)
    again = Scene.from_text(scene.to_yaml())
    assert again.media == scene.media
    assert again.serving.medium == scene.serving.medium


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{auto: {tolerance: 0}}", "medium.auto.tolerance: found 0; allowed: "),
        (
            "{auto: {tol: 1e-3}}",
            f"medium.auto.tol: found an unknown key; allowed: {AUTO}.",
        ),
        (
            "{auto: 1e-3}",
            f"medium.auto: found 0.001; allowed: a block of keys: {AUTO}.",
        ),
    ],
)
def test_mistakes_in_a_scene(work, capsys, text, told):
    assert told in refused(work, capsys, SCENE.replace("{auto: {tolerance: 2e-3}}", text))


def test_a_run_says_what_was_chosen_and_what_is_expected(work, rough):
    assert main(["run", "scene.yaml", "-o", "out", "-q", "--no-figures"]) == 0
    summary = yaml.safe_load((work / "out" / "summary.yaml").read_text(encoding="utf-8"))
    (serving,) = gp.AutoMedium(rough, 2e-3).choose("force", 18.446)
    assert summary["medium"] == "auto(tolerance=0.002)"
    assert summary["choice"] == serving.medium.label == "ema"
    assert summary["expected_error"] == serving.errors[0]
    assert summary["units"]["expected_error"] == "1"
    assert summary["truth"] == "arrays at rest without friction"
    assert (
        summary["longitudinal"]
        == gp.sound_velocities(gp.EffectiveMedium(rough).at_force(18.446)).longitudinal
    )
    assert summary["local_field"]["xi"] == gp.EffectiveMedium(rough).local_field.xi
    # the scene beside it gives the same again
    Scene.from_yaml("out/scene.yaml").run("again", figures=False)
    again = yaml.safe_load((work / "again" / "summary.yaml").read_text(encoding="utf-8"))
    assert {k: v for k, v in again.items() if k != "source"} == {
        k: v for k, v in summary.items() if k != "source"
    }


@pytest.mark.slow
def test_a_run_that_chose_a_simulation_writes_its_sample(work):
    (work / "scene.yaml").write_text(
        SCENE.replace("18.446 N", "6 N").replace("2e-3", "0.01"), encoding="utf-8"
    )
    assert main(["run", "scene.yaml", "-o", "out", "-q"]) == 0
    summary = yaml.safe_load((work / "out" / "summary.yaml").read_text(encoding="utf-8"))
    assert summary["choice"] == "simulation(shape=16 16)"
    assert {"sample.extxyz", "forces.png"} <= {path.name for path in (work / "out").iterdir()}


def test_a_check_says_what_would_be_chosen(work, capsys):
    assert main(["check", "scene.yaml"]) == 0
    out = capsys.readouterr().out
    assert "ema, expected error 0.0" in out
    assert "against arrays at rest" in out
    (work / "scene.yaml").write_text(
        SCENE.replace("spread: {uniform: 2.04 um}", "friction: true"), encoding="utf-8"
    )
    assert main(["check", "scene.yaml"]) == 0
    assert "ala, exact for equal balls" in capsys.readouterr().out
    assert main(["check", "sweep.yaml"]) == 0
    assert "will take" in capsys.readouterr().out
    assert {path.name for path in work.iterdir()} == {"scene.yaml", "sweep.yaml"}


def test_the_states_of_a_scene_are_those_that_were_chosen(rough):
    scene = Scene.from_text(SWEEP)
    found = dict(scene.states())
    assert [label.partition(": ")[2] for label in found] == [
        serving.medium.label
        for serving in gp.AutoMedium(rough, 5e-3).choose("force", scene.load.values)
    ]
    assert sorted(float(f) for state in found.values() for f in state.force) == [6.0, 18.446, 90.0]
    without = dict(scene.states(quick=True))
    assert 0 < len(without) < len(found)


@pytest.mark.parametrize("text", [SCENE, SWEEP])
def test_a_tolerance_that_nothing_meets_is_one_line(work, capsys, text):
    tight = text.replace("2e-3", "1e-9").replace("5e-3", "1e-9")
    for arguments in ((), ("check", "scene.yaml"), ("tradeoff", "scene.yaml", "-o", "out")):
        told = refused(work, capsys, tight, *arguments)
        assert "scene.yaml:4: medium: found 'auto(tolerance=1e-09)'; allowed: " in told
        assert re.search("no medium .* 1e-09.* smallest", told)


def test_a_sweep_over_what_is_not_known_is_refused_before_it_begins(work, capsys):
    told = refused(work, capsys, SCENE + "sweep: {lattice: [triangular, square]}\n")
    assert "the square lattice" in told


def test_a_fit_does_not_take_it(work, capsys, rough):
    (work / "data.csv").write_text(
        "force (N),velocity (m/s)\n2,490\n5,600\n18,780\n", encoding="utf-8"
    )
    told = refused(work, capsys, SCENE, "fit", "scene.yaml", "data.csv", "-o", "out")
    assert "in a fit" in told
    with pytest.raises(InputError, match="Name a medium"):
        gp.fit_width(rough, [2.0, 5.0, 18.0], [490.0, 600.0, 780.0], medium="auto")


def test_a_scene_of_it_has_a_cost_only_if_it_simulates():
    assert Scene.from_text(SCENE).cost() is None
    cost = Scene.from_text(SWEEP).cost()
    # of the one load that is low, and two beside it for the exponent
    assert cost.equilibria == 3
    scene = Scene.from_text(SCENE.replace("18.446 N", "6 N").replace("2e-3", "0.01"))
    assert scene.cost().balls == 16**2


def test_a_scene_of_several_states_has_no_one_choice():
    with pytest.raises(InputError, match="sweep"):
        _ = Scene.from_text(SWEEP).serving
    with pytest.raises(SceneError, match="medium"):
        Scene.from_text(SCENE.replace("2e-3", "1e-9"))


def test_what_was_chosen_is_valid_and_its_medium_is_not_complained_of(rough, unit, tmp_path):
    medium = gp.AutoMedium(rough, tolerance=0.1)
    force = 0.3 * unit
    state = medium.at_force(force)
    assert state.medium == "ala"
    assert not gp.AveragedLattice(rough).at_force(force).valid
    assert state.valid
    assert state.least_valid_force == 0.0
    assert not gp.validity(state).warnings
    assert gp.validity(gp.AveragedLattice(rough).at_force(force)).warnings
    several = medium.at_force(np.array([0.3, 0.5]) * unit)
    assert several.valid.all()
    assert several[0].chosen_automatically
    ds = sweep(rough, force=[force, 0.5 * unit], media=["ala", {"auto": {"tolerance": 0.1}}])
    assert_array_equal(ds.valid, [[False, True], [False, True]])
    assert all("auto" not in text for text in json.loads(ds.attrs["warnings"]))
    text = SCENE.replace("18.446 N", f"{force!r} N").replace("2e-3", "0.1")
    result = Scene.from_text(text).run(tmp_path / "out", figures=False)
    assert result.summary()["valid"]
    assert result.validity.ok
    assert not result.warnings


def test_a_warning_of_loads_that_different_media_serve_is_one():
    """Soft balls: the loads of each medium are beyond the limits. What depends on the force alone
    is as in one medium.
    """
    packing = gp.Packing(gp.Material(70e6, 0.22, 2500.0), 1e-3, gp.Uniform(3e-5))
    ds = sweep(packing, force=[0.1, 0.5, 1.0, 4.0], media=({"auto": {"tolerance": 3e-3}}, "ala"))
    assert len(set(ds.choice.values[:, 0].tolist())) > 1
    told = json.loads(ds.attrs["warnings"])
    # both media are beyond these, which depend on the force alone: one warning of all states
    for words in ("the radius of a contact", "(f/E"):
        (text,) = [text for text in told if words in text]
        assert "8 states" in text
    # limits of a medium stand for the loads that it serves
    sentences = [re.sub(r"^At (\d|all \d)", "", text).partition(" is ")[0] for text in told]
    assert len(set(sentences)) == len(told)
