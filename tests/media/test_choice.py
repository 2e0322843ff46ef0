"""Media by name: what may be asked of each, and when two choices are the same."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

import granphon as gp
from granphon.balls.lattices import TRIANGULAR
from granphon.balls.loads import Load
from granphon.base.errors import InputError
from granphon.media.choice import MEDIA, MediumChoice

CLASSES = {
    "ala": gp.AveragedLattice,
    "afa": gp.AveragedForce,
    "ema": gp.EffectiveMedium,
    "simulation": gp.DirectSimulation,
    "auto": gp.AutoMedium,
}


@pytest.mark.parametrize("name", CLASSES)
def test_a_name_is_the_medium_of_that_class(packing, name):
    assert MEDIA[name] is CLASSES[name]
    assert MediumChoice(name).of(packing) == CLASSES[name](packing)
    assert (
        MediumChoice.parse(name)
        == MediumChoice.parse({name: None})
        == MediumChoice.parse({name: {}})
        == MediumChoice(name)
    )
    assert MediumChoice(name).label == name


@pytest.mark.parametrize("name", CLASSES)
def test_defaults_are_those_of_the_class_and_are_not_kept(packing, name):
    defaults = {option: known.default for option, known in MEDIA[name].options.items()}
    said = {option: value for option, value in defaults.items() if value is not None}
    given = MediumChoice.parse({name: said})
    assert given == MediumChoice(name)
    assert given.options == ()
    assert given.settings == defaults
    assert CLASSES[name](packing, **defaults) == CLASSES[name](packing)


@given(st.integers(1, 64), st.integers(1, 64), st.integers(0, 10**18), st.integers(1, 9))
def test_a_simulation_is_that_of_its_options_however_they_are_given(first, second, seed, samples):
    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, gp.Uniform(2e-6))
    shapes = (f"{first} {second}", [first, second], (first, second), np.array([first, second]))
    found = [
        MediumChoice.parse({"simulation": {"shape": s, "seed": seed, "samples": samples}})
        for s in shapes
    ]
    assert len({hash(one) for one in found}) == 1
    for one in found:
        assert one == found[0] == MediumChoice.parse({"simulation": one.settings})
        assert one.of(packing) == gp.DirectSimulation(
            packing, (first, second), seed=seed, samples=samples
        )
        assert one.simulates


def test_labels_say_what_is_not_the_default():
    given = {"simulation": {"shape": "16 16", "samples": 4, "seed": 0}}
    assert MediumChoice.parse(given).label == "simulation(samples=4, shape=16 16)"
    assert MediumChoice.parse({"simulation": {"samples": 4}}).label == "simulation(samples=4)"
    assert MediumChoice.parse({"ema": {"local_field": "paper"}}).label == "ema(local_field=paper)"


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (
            "simulaton",
            "medium: found 'simulaton'; .* auto.*'simulation'",
        ),
        (
            {"ala": None, "ema": None},
            "medium: found a block.* ala, .* auto",
        ),
        (3, "medium: found 3; .* ala, .* auto"),
        ("cluster", "simulation: {shape: 64 64}"),
        ({"cluster": {"balls": 7}}, "simulation: {shape: 64 64}"),
        ({"afa": {"seed": 1}}, "medium.afa.seed: found an unknown key"),
        (
            {"simulation": {"sampels": 1}},
            "medium.simulation.sampels: found an unknown key; .* samples",
        ),
        (
            {"simulation": {"samples": 1.0}},
            "medium.simulation.samples: found 1.0; .* from 1 to 10000",
        ),
        (
            {"simulation": {"shape": (16, 16, 1, 1)}},
            r"shape: found \[16, 16, 1, 1\]; .* from 1 to 20000",
        ),
        (
            {"simulation": 4},
            "medium.simulation: found 4; .* shape, seed, samples",
        ),
        (
            {"ema": {"local_field": None}},
            "medium.ema.local_field: found nothing; .* computed, paper",
        ),
    ],
)
def test_what_is_no_medium(value, told):
    with pytest.raises(InputError, match=told):
        MediumChoice.parse(value)


@pytest.mark.parametrize("options", [3, None, ("local_field",)])
def test_options_of_a_choice_are_pairs(options):
    with pytest.raises(InputError, match=r"medium\.ema: found"):
        MediumChoice("ema", options)


@pytest.mark.parametrize("name", CLASSES)
def test_a_medium_takes_a_load(packing, name):
    with pytest.raises(InputError, match="load is 3"):
        CLASSES[name](packing).at(3)


def test_what_is_taken_in_place_of_a_cluster_is_a_medium():
    with pytest.raises(InputError) as error:
        MediumChoice.parse("cluster")
    replacement = yaml.safe_load(str(error.value).partition("Take ")[2].partition(", one")[0])
    assert MediumChoice.parse(replacement) == MediumChoice.parse(
        {"simulation": {"shape": (64, 64)}}
    )


def test_only_one_of_them_leaves_the_choice_to_the_load():
    for name in MEDIA.keys() - {"auto"}:
        MediumChoice(name).require_fixed("a fit")
    with pytest.raises(InputError, match=r"'auto' cannot .* a fit"):
        MediumChoice("auto").require_fixed("a fit")
    assert MediumChoice.parse({"auto": {"tolerance": 1e-3}}) == MediumChoice("auto")
    assert MediumChoice.parse({"auto": {"tolerance": 0.02}}).label == "auto(tolerance=0.02)"


@pytest.mark.parametrize("shape", [(2,), (2, 2)])
def test_a_named_medium_serves_all_loads_and_its_error_is_what_the_table_says(steel, shape):
    from granphon.media.accuracy import find_error

    packing = gp.Packing(steel, 8e-3, gp.Uniform(2e-6))
    loads = np.linspace(20.0, 40.0, int(np.prod(shape))).reshape(shape)
    for name in ("ala", "afa", "ema"):
        (serving,) = MediumChoice(name).choose(packing, Load("force", loads))
        assert serving.medium == MediumChoice(name)
        assert serving.loads.tolist() == list(range(loads.size))
        assert (
            serving.errors.tolist()
            == find_error(name, packing, Load("force", loads)).ravel().tolist()
        )
    # that of a simulation is of all its balls
    several = MediumChoice.parse({"simulation": {"shape": (8, 16), "samples": 3}})
    expected = find_error("simulation", packing, Load("force", loads), 3 * 8 * 16)
    assert np.array_equal(several.expected_error(packing, Load("force", loads)), expected)


def test_of_the_paper_s_local_field_nothing_is_known(steel):
    packing = gp.Packing(steel, 8e-3, gp.Uniform(2e-6))
    choice = MediumChoice.parse({"ema": {"local_field": "paper"}})
    assert choice.expected_error(packing, Load("force", [10.0, 20.0])).tolist() == [np.inf, np.inf]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"friction_coefficient": -1}, "friction_coefficient: found -1"),
        ({"friction_coefficient": np.nan}, "friction_coefficient: found"),
        ({"friction_coefficient": "rough"}, "friction_coefficient: found 'rough'"),
        ({"shear_response": "roll"}, "shear_response: found 'roll'"),
        ({"start": "liquid"}, "start: found 'liquid'"),
        ({"step_tolerance": 0.0}, "step_tolerance: found"),
        ({"ordered": 1}, "ordered: found 1"),
    ],
)
def test_no_history_of_wrong_options(options, told):
    with pytest.raises(InputError, match=told):
        gp.FrictionHistory(**{"friction_coefficient": 0.2, **options})


def test_starts_that_differ_have_labels_that_differ():
    loaded = (("friction_history", True), ("friction_coefficient", 0.2))
    sizes = (1.0, [1.0], 1.0000001)
    first, listed, other = (
        MediumChoice("simulation", (*loaded, ("start", Load("force", size)))) for size in sizes
    )
    assert first == listed
    assert first.settings_on(TRIANGULAR) == listed.settings_on(TRIANGULAR)
    assert "force 1" in first.label
    assert "force 1.0000001" in other.label
