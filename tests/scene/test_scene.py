import itertools
import math
import random
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import granphon as gp
from granphon.balls.loads import Load, force_of_frame
from granphon.base.errors import InputError, OutputError, PrecisionError, Refused, SceneError
from granphon.base.quantities import DENSITY, LENGTH, LOADS, MODULUS, WIDTH, Quantity
from granphon.base.settings import SCALES, space_evenly
from granphon.base.text import read_yaml
from granphon.media.choice import MediumChoice
from granphon.media.cost import estimate
from granphon.observables.catalogue import CATALOGUE, SUMMARY_KEYS
from granphon.phonons.paths import BandPath
from granphon.scene.file import write_preset
from granphon.scene.scene import Scene, is_complete
from tests import conftest

EXAMPLES = Path(__file__).parents[2] / "examples"
PRESETS = Path(gp.__file__).parent / "data"
NAMES = ("steel_hexagon", "glass", "hydrogel")
MINIMAL = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm}
load: {force: 18.446 N}
"""

# -- what a scene means ----------------------------------------------------------------------------


def test_defaults():
    scene = Scene.from_text(MINIMAL)
    assert scene.packing == gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
    assert scene.load == Load("force", 18.446) == Load("force", (18.446,))
    assert (scene.media, scene.finite_overlap, scene.observe) == (
        (MediumChoice("ala"),),
        False,
        ("velocities",),
    )
    assert (scene.parameters, scene.swept, scene.diameters) == ((), {}, None)
    assert (scene.band_points, scene.mesh, scene.dim, scene.source) == (101, (64, 64), None, None)
    assert scene.path == BandPath.parse("0 0 0 1/3 1/3 0 1/2 0 0 0 0 0", "G K M G")


@pytest.mark.parametrize("name", NAMES)
def test_examples_are_the_presets_and_are_valid(name):
    assert (EXAMPLES / f"{name}.yaml").read_text() == write_preset(name)
    scene = Scene.from_yaml(EXAMPLES / f"{name}.yaml")
    assert scene.observe == ("velocities", "bands", "dos")
    assert scene.source == EXAMPLES / f"{name}.yaml"
    assert gp.validity(scene.state()).ok


@pytest.mark.parametrize("name", NAMES)
def test_what_is_commented_out_in_a_preset_is_right_too(name):
    text = write_preset(name)
    chosen = next(line for line in text.splitlines() if line.split(":")[0].strip() in LOADS)
    others = [
        line
        for line in text.splitlines()
        if line.strip("# ").split(":")[0] in LOADS and line != chosen
    ]
    frame = next((line for line in text.splitlines() if "balls_per_side" in line), "")
    assert len(others) >= 2
    for line in others:
        tail = "\n" + frame.replace("# ", "", 1) if "side_force" in line else ""
        scene = Scene.from_text(text.replace(chosen, line.replace("# ", "", 1) + tail))
        # the alternatives are of the same size as what is chosen
        assert scene.state().force == pytest.approx(Scene.from_text(text).state().force, rel=0.2)
    rest = text.replace("# dim:", "dim:").replace("# yield_strength:", "yield_strength:")
    assert Scene.from_text(rest).dim == (3, 3)


def test_the_preset_of_a_sweep_and_what_is_commented_out_in_it():
    text = write_preset("steel_spread")
    assert (EXAMPLES / "steel_spread.yaml").read_text() == text
    scene = Scene.from_text(text)
    assert scene.swept
    assert [len(state.force) for _, state in scene.states()] == [60, 60, 60]
    assert all(gp.validity(state)["contact_radius"].ok.all() for _, state in scene.states())
    normal = Scene.from_text(
        text.replace("  spread: {uniform", "  # ").replace("# spread: {normal", "spread: {normal")
    )
    assert normal.packing.width == pytest.approx(2.04e-6, rel=0.01)
    framed = (
        text.replace("  force: {from", "  # ")
        .replace("# side_force", "side_force")
        .replace("# balls_per", "balls_per")
    )
    assert len(Scene.from_text(framed).load.values) == 3
    simulated = Scene.from_text(
        text.replace("medium: [", "# [").replace("# medium: {", "medium: {")
    )
    assert [choice.label for choice in simulated.media] == ["simulation(samples=4, shape=64 64)"]
    assert dict(Scene.from_text(text.replace("# sweep:", "sweep:")).parameters) == {
        "width": (1e-6, 2e-6, 4e-6)
    }


def test_presets_are_what_they_say():
    steel, glass, gel = (Scene.from_yaml(PRESETS / f"{name}.yaml") for name in NAMES)
    assert gp.sound_velocities(steel.state()).longitudinal == pytest.approx(791.0, abs=0.1)
    assert 65e9 < glass.packing.material.young_modulus < 75e9
    assert gel.packing.material.young_modulus < 1e5
    assert not gel.packing.friction


def test_the_frame_of_section_iv():
    # each of the n balls of a side passes F/n on to two contacts at 30 degrees
    assert 2.0 * math.cos(math.pi / 6) * force_of_frame(990.0, 31) * 31 == pytest.approx(
        990.0, rel=1e-15
    )
    # "~990 N" is 990.4 N: the printed force follows to the digits of the printed push
    assert force_of_frame(990.43, 31) == pytest.approx(18.446, abs=5e-4)
    scene = Scene.from_text(
        MINIMAL.replace("force: 18.446 N", "side_force: 990 N, balls_per_side: 31")
    )
    state = scene.state()
    assert state.force == force_of_frame(990.0, 31)
    assert state.pressure == pytest.approx(990.0 / (31 * 8e-3), rel=1e-15)


@pytest.mark.parametrize(
    ("kind", "text"), [("force", "3 N"), ("pressure", "4 kN/m"), ("overlap", "1 um")]
)
def test_loads_reach_the_medium(kind, text):
    scene = Scene.from_text(MINIMAL.replace("force: 18.446 N", f"{kind}: {text}"))
    assert getattr(scene.state(), kind) == pytest.approx(
        {"force": 3.0, "pressure": 4e3, "overlap": 1e-6}[kind], rel=1e-15
    )


def test_paths_and_grids():
    text = (
        MINIMAL
        + "phonopy: {dim: [4, 3, 1], band: '0 0 0 1/2 0 0, 1/3 1/3 0 -0.25 1e-3 0', mesh: 8 6 1}\n"
    )
    scene = Scene.from_text(text)
    assert (scene.dim, scene.mesh) == ((4, 3), (8, 6))
    assert scene.path.labels is None
    first, second = scene.path.arrays
    np.testing.assert_array_equal(first, [[0, 0, 0], [0.5, 0, 0]])
    np.testing.assert_array_equal(second, [[1 / 3, 1 / 3, 0], [-0.25, 1e-3, 0]])


def test_an_empty_phonopy_block_is_none():
    assert Scene.from_text(MINIMAL + "phonopy:\n  # mesh: 8 8 1\n") == Scene.from_text(MINIMAL)


def test_observables_come_in_one_order():
    assert Scene.from_text(MINIMAL + "observe: [dos, velocities]\n").observe == (
        "velocities",
        "dos",
    )


# -- simulations -----------------------------------------------------------------------------------

SIMULATION = MINIMAL.replace("8 mm", "8 mm, spread: {uniform: 2 um}").replace("18.446 N", "5 N")


def test_a_simulation_in_a_scene():
    for shape in ("16 12", "[16, 12]", '"16 12"'):
        scene = Scene.from_text(
            SIMULATION + f"medium: {{simulation: {{shape: {shape}, seed: 3, samples: 2}}}}\n"
        )
        assert scene.media == (
            MediumChoice("simulation", (("shape", (16, 12)), ("seed", 3), ("samples", 2))),
        )
    assert not scene.swept
    state = scene.state()
    assert state == gp.DirectSimulation(scene.packing, (16, 12), seed=3, samples=2).at_force(5.0)
    # what is written names every option, and is the same scene
    assert "shape: [16, 12]\n    seed: 3\n    samples: 2\n" in scene.to_yaml()
    assert Scene.from_text(scene.to_yaml()) == scene


def test_a_simulation_beside_other_media_and_over_parameters():
    text = (
        SIMULATION.replace("5 N", "[9 N, 5 N]")
        + "medium: [ema, {simulation: {shape: 8 8}}]\nsweep: {width: [1 um, 2 um]}\n"
    )
    scene = Scene.from_text(text)
    states = dict(scene.states())
    assert list(states) == [
        f"{m}, width = {w} um" for w in (1, 2) for m in ("ema", "simulation(shape=8 8)")
    ]
    found = states["simulation(shape=8 8), width = 1 um"]
    np.testing.assert_array_equal(
        found.overlap,
        gp.DirectSimulation(replace(scene.packing, spread=gp.Uniform(1e-6)), (8, 8))
        .at_force([9.0, 5.0])
        .overlap,
    )
    assert [label for label, _ in scene.states(quick=True)] == [
        "ema, width = 1 um",
        "ema, width = 2 um",
    ]
    assert Scene.from_text(scene.to_yaml()) == scene


def test_the_cost_of_a_scene_is_that_of_its_simulations():
    scene = Scene.from_text(
        SIMULATION.replace("5 N", "[9 N, 5 N]")
        + "medium: [ema, simulation]\nsweep: {width: [1 um, 2 um]}\n"
    )
    cost = scene.cost()
    # two loads of two packings, each with two more for the exponent
    assert (cost.balls, cost.equilibria) == (
        128 * 128,
        12,
    )
    load = Load("force", [9.0, 5.0])
    each = [
        estimate(
            gp.DirectSimulation(replace(scene.packing, spread=gp.Uniform(w))), load, exponents=True
        )
        for w in (1e-6, 2e-6)
    ]
    assert cost.work == sum(one.work for one in each) == 12 * 128**2
    assert cost.memory == max(one.memory for one in each)
    assert Scene.from_text(SIMULATION).cost() is None


def test_a_load_that_samples_cannot_carry_is_named():
    text = (
        SIMULATION.replace("force: 5 N", "overlap: -0.6 um")
        + "medium: {simulation: {shape: 8 8}}\n"
    )
    scene = Scene.from_text(text, "loose.yaml")
    told = r"loose.yaml:3: load.overlap: found '-0.6 um'; .*carries no load"
    with pytest.raises(SceneError, match=told):
        scene.state()
    several = Scene.from_text(text.replace("-0.6 um", "[1 um, -0.6 um]"), "loose.yaml")
    with pytest.raises(
        SceneError,
        match=r"loose.yaml:3: load.overlap.1: found '-0.6 um'; .*simulation\(shape=8 8\), overlap ="
        r" ",
    ):
        several.sweep()


# -- balls that differ, many loads, many media -----------------------------------------------------

#: as the design of the file has it
FULL = """\
schema: 1
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing:
  lattice: triangular
  diameter: 8 mm
  spread: {uniform: 2.04 um}
  friction: true
  finite_overlap: false
load: {force: 18.446 N}
medium: ema
observe: [velocities, bands, dos]
phonopy: {dim: 3 3 1, band: 0 0 0 1/3 1/3 0 1/2 0 0 0 0 0, band_labels: G K M G, band_points: 101, mesh: 64 64 1}
"""


def with_spread(spread: str) -> Scene:
    return Scene.from_text(MINIMAL.replace("8 mm", f"8 mm, spread: {spread}"))


def with_load(load: str, spread: str = "{uniform: 2 um}") -> Scene:
    return Scene.from_text(
        MINIMAL.replace("8 mm", f"8 mm, spread: {spread}").replace("force: 18.446 N", load)
    )


@pytest.mark.parametrize(
    ("text", "spread"),
    [
        ("{uniform: 2.04 um}", gp.Uniform(2.04e-6)),
        ("{uniform: 0 um}", gp.Uniform(0.0)),
        ("{normal: 0.6 um}", gp.Normal(0.6e-6)),
        ("{normal: {std: 0.6 um}}", gp.Normal(0.6e-6)),
        ("{normal: {std: 0.6 um, cutoff: 2}}", gp.Normal(0.6e-6, 2.0)),
        (
            "{discrete: {diameters: [7 mm, 9 mm], fractions: [0.5, 0.5]}}",
            gp.Discrete((7e-3, 9e-3), (0.5, 0.5)),
        ),
        ("{measured: {diameters: [7.999 mm, 8.001 mm]}}", gp.Measured((7.999e-3, 8.001e-3))),
        ("{measured: [7.999 mm, 8.001 mm]}", gp.Measured((7.999e-3, 8.001e-3))),
    ],
)
def test_spreads(text, spread):
    scene = with_spread(text)
    assert scene.packing.spread == spread
    # equal balls need no more than the averaged lattice
    assert scene.media == (MediumChoice("ema" if spread.width else "ala"),)
    assert Scene.from_text(scene.to_yaml()) == scene


def test_measured_diameters_are_looked_for_where_the_scene_is(tmp_path, monkeypatch):
    (tmp_path / "lot").mkdir()
    (tmp_path / "lot" / "balls.csv").write_text("ball,size (mm)\n1,7.999\n2,8.001\n")
    (tmp_path / "lot" / "one.csv").write_text("diameter (um)\n7999\n8001\n")
    scene = tmp_path / "lot" / "scene.yaml"
    monkeypatch.chdir(tmp_path)
    for text in ("{file: balls.csv, column: size}", "one.csv", "{file: one.csv}"):
        scene.write_text(MINIMAL.replace("8 mm", f"8 mm, spread: {{measured: {text}}}"))
        assert Scene.from_yaml("lot/scene.yaml").packing.spread == gp.Measured((7.999e-3, 8.001e-3))
    scene.write_text(
        MINIMAL.replace("8 mm", "8 mm, spread: {measured: {file: balls.csv, column: sice}}")
    )
    with pytest.raises(
        SceneError, match=r"scene.yaml:2: packing.spread.measured: found 'balls.csv'; .* 'size'"
    ):
        Scene.from_yaml("lot/scene.yaml")


@pytest.mark.parametrize(
    "given", ["secret.txt", "{file: secret.txt}", "{file: secret.txt, column: size}"]
)
@pytest.mark.parametrize(
    "text",
    ["root:hunter2:0:0::/root:/bin/sh\n", "hunter2,b\n", "hunter2\nhunter2\n", "size\nhunter2\n"],
)
def test_a_scene_does_not_show_what_is_in_a_file_that_is_no_table(tmp_path, given, text):
    (tmp_path / "secret.txt").write_text(text, encoding="utf-8")
    (tmp_path / "scene.yaml").write_text(
        MINIMAL.replace("8 mm", f"8 mm, spread: {{measured: {given}}}"), encoding="utf-8"
    )
    with pytest.raises(
        SceneError, match=r"packing\.spread\.measured: found 'secret\.txt'"
    ) as error:
        Scene.from_yaml(tmp_path / "scene.yaml")
    assert "hunter2" not in str(error.value)


def test_many_measured_diameters_go_into_a_table(tmp_path, steel):
    # thirds: all digits are needed
    diameters = tuple(8e-3 + (n % 7 - 3) * 1e-6 / 3.0 for n in range(7 * 143))
    spread = gp.Measured(diameters)
    scene = Scene(gp.Packing(steel, 8e-3, spread), Load("force", 3.0), media="afa")
    assert 'measured: "diameters.csv"' in scene.to_yaml()
    (tmp_path / "scene.yaml").write_text(scene.to_yaml())
    (tmp_path / "diameters.csv").write_text(scene.diameters)
    assert Scene.from_yaml(tmp_path / "scene.yaml") == scene
    fewer = Scene(
        gp.Packing(steel, 8e-3, gp.Measured(diameters[:994])), Load("force", 3.0), media="afa"
    )
    assert fewer.diameters is None
    assert Scene.from_text(fewer.to_yaml()) == fewer


def test_lists_and_ranges_of_loads():
    assert with_load("force: [3 N, 1 N, 3 N]").load == Load("force", (3.0, 1.0, 3.0))
    assert not with_load("force: [3 N]").swept
    assert (
        with_load("force: [3 N]")
        == with_load("force: 3 N")
        == with_load("force: {from: 3 N, to: 3 N, points: 1}")
    )
    log, linear, down = (
        with_load(f"pressure: {{{ends}, points: 5}}").load.values
        for ends in (
            "from: 1 N/m, to: 1 kN/m",
            "from: 1 N/m, to: 1 kN/m, scale: linear",
            "from: 1 kN/m, to: 1 N/m",
        )
    )
    np.testing.assert_allclose(log, 10.0 ** np.array([0.0, 0.75, 1.5, 2.25, 3.0]), rtol=1e-15)
    np.testing.assert_allclose(linear, [1.0, 250.75, 500.5, 750.25, 1000.0], rtol=1e-15)
    np.testing.assert_allclose(down, log[::-1], rtol=1e-15)
    assert (down[0], down[-1]) == (1e3, 1.0)


def test_a_frame_may_be_pressed_many_times():
    scene = with_load("side_force: {from: 100 N, to: 990 N, points: 3}, balls_per_side: 31")
    assert scene.load.applied == Load(
        "force", [force_of_frame(push, 31) for push in scene.load.values]
    )
    ((label, state),) = scene.states()
    assert label == "ema"
    np.testing.assert_array_equal(state.force, scene.load.applied.array)


def test_an_overlap_may_be_negative_where_balls_differ():
    scene = with_load("overlap: {from: -0.3 um, to: 0.3 um, points: 7, scale: linear}")
    ((_, state),) = scene.states()
    np.testing.assert_array_equal(state.overlap, np.linspace(-0.3e-6, 0.3e-6, 7))
    assert np.all(state.force > 0.0)
    at_touch = with_load("overlap: 0 um")
    assert at_touch.state().force > 0.0
    assert Scene.from_text(at_touch.to_yaml()).load == at_touch.load


def test_a_ladder_of_media_at_every_combination_of_parameters():
    text = MINIMAL.replace("18.446 N", "[2 N, 9 N]") + (
        "medium: [ema, {ema: {local_field: paper}}, ala]\n"
        "sweep: {friction: [true, false], width: [1 um, 2 um], poisson_ratio: {from: 0.1, to:"
        " 0.2, points: 2}}\n"
    )
    scene = Scene.from_text(text)
    assert [choice.label for choice in scene.media] == ["ema", "ema(local_field=paper)", "ala"]
    assert [name for name, _ in scene.parameters] == ["friction", "width", "poisson_ratio"]
    states = dict(scene.states())
    assert len(states) == 3 * 2 * 2 * 2
    packing = gp.Packing(gp.Material(211.65e9, 0.2, 7840.0), 8e-3, gp.Uniform(1e-6), friction=False)
    expected = gp.EffectiveMedium(packing, local_field="paper").at_force([2.0, 9.0])
    assert (
        states["ema(local_field=paper), friction = False, width = 1 um, poisson_ratio = 0.2"]
        == expected
    )
    with pytest.raises(InputError, match="is a sweep"):
        scene.state()
    again = Scene.from_text(scene.to_yaml())
    assert again == scene


def test_what_is_swept_decides_what_a_medium_must_average(packing):
    for name, value, medium in (
        ("width", 1e-6, "ema"),
        ("spread", gp.Normal(1e-6), "ema"),
        ("density", 1.0, "ala"),
    ):
        scene = Scene(packing, Load("force", 1.0), parameters={name: [value]})
        assert (scene.media, scene.balls_differ) == ((MediumChoice(medium),), medium == "ema")
    assert not Scene(packing, Load("force", 1.0), media="ema").balls_differ
    assert Scene(
        replace(packing, spread=gp.Uniform(1e-6)), Load("force", 1.0), media="ala"
    ).balls_differ
    # the load is carried by the packings of the sweep, not by equal balls
    text = MINIMAL.replace("force: 18.446 N", "overlap: -0.1 um")
    assert Scene.from_text(text + "sweep: {width: [1 um, 2 um]}\n").swept == {"width": 2}


LISTED = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {discrete: {diameters: [7.999 mm, 8.001 mm], fractions: [0.5, 0.5]}}}
load:
  force:
    - 5 N
    - 9 N
medium: [ala, ema]
sweep: {width: [1 um, 2 um]}
"""


@pytest.mark.parametrize(
    ("load", "last", "first"),
    [
        ("[5 N, 1e-15 N]", r"load\.force\.1: found '1e-15 N'", r"load\.force\.1: found '1e-15 N'"),
        # before the sweep the least load is tried, and in it the first that fails is named
        pytest.param(
            "{from: 5 N, to: 1e-15 N, points: 9}",
            r"load\.force\.to: found '1e-15 N'",
            r"load\.force: found value 4 of 9 from '5 N' to '1e-15 N'",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_load_that_shows_in_the_sweep_is_named_as_one_that_shows_before(load, last, first):
    text = LISTED.replace("\n    - 5 N\n    - 9 N\n", f" {load}\n")
    scene = Scene.from_text(text, "lot.yaml")
    allowed = "; allowed: .*; "
    with pytest.raises(SceneError, match=rf"^lot\.yaml:4: {last}{allowed}afa, width = 1 um: "):
        Scene.from_text(text.replace("ala", "afa"), "lot.yaml")
    where = rf"^lot\.yaml:4: ({last}|{first}){allowed}ema, width = 1 um"
    with pytest.raises(SceneError, match=where + ": .*Raise the load"):
        list(scene.states())
    where = rf"^lot\.yaml:4: {first}{allowed}ema, width = 1 um"
    with pytest.raises(SceneError, match=where + r", force = \d.* N: .*Raise the load"):
        scene.sweep()
    with (
        ProcessPoolExecutor(1) as executor,
        pytest.raises(SceneError, match=where + r", force = \d.* N: "),
    ):
        scene.sweep(executor=executor)
    # a scene that was made, or changed, has no file to be named
    for other in (
        replace(scene),
        Scene(scene.packing, scene.load, media=scene.media, parameters=scene.parameters),
    ):
        with pytest.raises(PrecisionError, match=r"^ema, width = 1 um, force = "):
            other.sweep()


def test_the_line_is_that_of_the_load():
    scene = Scene.from_text(LISTED.replace("9 N", "1e-15 N"), "lot.yaml")
    with pytest.raises(SceneError, match=r"^lot\.yaml:6: load\.force\.1: "):
        scene.sweep()


def test_other_errors_of_a_sweep_are_their_own(tmp_path):
    scene = Scene.from_text(LISTED)
    with pytest.raises(InputError, match=r"^sweep\.csv .*\.nc"):
        scene.sweep(path="sweep.csv")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        scene.sweep(path=tmp_path / "file" / "sweep.nc")


def test_spreads_and_lattices_are_swept():
    scene = Scene.from_text(
        MINIMAL
        + "sweep: {spread: [{uniform: 0 um}, {normal: 1 um}], lattice: [kagome, triangular]}\n"
    )
    assert dict(scene.parameters) == {
        "spread": (gp.Uniform(0.0), gp.Normal(1e-6)),
        "lattice": ("kagome", "triangular"),
    }
    assert Scene.from_text(scene.to_yaml()) == scene


def test_what_makes_no_sweep(packing):
    load = Load("force", (1.0, 2.0))
    with pytest.raises(
        InputError,
        match="found 'dos'",
    ):
        Scene(packing, load, observe=("dos",))
    with pytest.raises(InputError, match="found 'bands'"):
        Scene(packing, load, observe=("bands",), parameters={"lattice": ["kagome"]})
    with pytest.raises(InputError, match=r"no parameter 'widht'.*width"):
        Scene(packing, load, parameters={"widht": [1.0]})


def test_a_scene_that_no_file_can_hold(packing):
    rng = np.random.default_rng(0)
    scene = Scene(packing, Load("force", rng.uniform(1.0, 2.0, 6_000)))
    with pytest.raises(InputError, match="100 kB"):
        scene.to_yaml()
    ranged = Scene(packing, Load("force", space_evenly(1.0, 2.0, 20_000, "log")))
    assert len(ranged.to_yaml()) < 1000
    assert Scene.from_text(ranged.to_yaml()) == ranged


@pytest.mark.slow
def test_more_loads_than_the_points_of_a_range_are_no_text(packing):
    scene = Scene(packing, Load("force", space_evenly(1.0, 2.0, 200_001, "linear")))
    with pytest.raises(InputError, match="100 kB"):
        scene.to_yaml()


# -- quantities ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (LENGTH, "8 mm", 8e-3),
        (LENGTH, "8mm", 8e-3),
        (LENGTH, "+8.0e0 mm", 8e-3),
        (LENGTH, "2.04 um", 2.04e-6),
        (LENGTH, "2.04 µm", 2.04e-6),
        (LENGTH, "2.04 μm", 2.04e-6),
        (LENGTH, "1 inch", 0.0254),
        (LENGTH, ".5 m", 0.5),
        (MODULUS, "211.65 GPa", 211.65e9),
        (MODULUS, "1 N/m^2", 1.0),
        (MODULUS, "1 N/m²", 1.0),
        (MODULUS, "1 N*m^-2", 1.0),
        (MODULUS, "1 psi", 6894.757293168362),
        (MODULUS, "2 bar", 2e5),
        (DENSITY, "7.84 g/cm^3", 7840.0),
        (DENSITY, "7840 kg/m3", 7840.0),
        (DENSITY, "7840 kg/m**3", 7840.0),
        (DENSITY, "7840 kg/m³", 7840.0),
        (LOADS["pressure"], "4 kN/m", 4e3),
        (LOADS["pressure"], "4 N/mm", 4e3),
        (LOADS["pressure"], "4 Pa*m", 4.0),
        (LOADS["force"], "1 kgf", 9.80665),
        (LOADS["force"], "5e-324 N", 5e-324),
    ],
)
def test_quantities(kind: Quantity, text, value):
    assert kind.read(text) == value


def test_zero_and_below_where_they_are_allowed():
    for text in ("0 um", "-0.0 um", "0e9 m"):
        assert WIDTH.read(text) == LOADS["overlap"].read(text) == 0.0
    assert LOADS["overlap"].read("-0.1 um") == -1e-7
    with pytest.raises(Refused, match=r"negative.*length"):
        WIDTH.read("-1 um")
    with pytest.raises(Refused, match=r"tensile.*force"):
        LOADS["force"].read("-1 N")
    with pytest.raises(Refused, match="length"):
        LOADS["overlap"].read("-1e-330 m")


@given(st.floats(allow_nan=False, allow_infinity=False).filter(bool))
def test_a_written_quantity_is_read_to_the_last_bit(value):
    assert LOADS["overlap"].read(LOADS["overlap"].write(value)) == value


@given(
    st.floats(1e-300, 1e290).map(repr),
    st.sampled_from([("mm", 3), ("um", 6), ("nm", 9), ("m", 0), ("pm", 12)]),
)
def test_a_quantity_is_the_float_nearest_to_what_is_written(number, unit):
    from fractions import Fraction

    assert LENGTH.read(f"{number} {unit[0]}") == float(Fraction(number) / 10 ** unit[1])


@pytest.mark.parametrize(
    "text",
    [
        "8 m m",
        "8 mm mm",
        "8*9 mm",
        "8/2 mm",
        "(8) mm",
        "8 mm + 1 mm",
        "8,5 mm",
        "8 e mm",
        "0x8 mm",
        "８ mm",
        "1_000 mm",
        "8 PA",
        "8 k",
        "8 c",
        "8 m^",
        "8 m^99",
        "8 m^0.5",
        "8 m/m",
        "8 1/m",
        "8 m^2",
        "8 s",
        "8 K",
        "8 degC",
        "8 %",
        "8 mm.",
        "8 parsnip",
        "8 __import__('os')",
        "mm",
        "eight mm",
        "",
        " ",
        "nan mm",
        "inf mm",
        "-inf mm",
        "1e999 mm",
        "1e-999 mm",
        "1e999999999999 mm",
        "1e-999999999999 mm",
        "5e-324 pm",
        "0 mm",
        "-0.0 mm",
        "-8 mm",
        "8" * 200 + " mm",
        "8 " + "m*" * 90 + "m",
        8,
        8.0,
        0,
        True,
        None,
        [],
        ["8 mm"],
        {},
        {"mm": 8},
        math.nan,
        math.inf,
        10**400,
    ],
)
def test_what_is_no_length(text):
    with pytest.raises(Refused, match=r"^found .*length .*'8 mm'"):
        LENGTH.read(text)


# -- written and read back -------------------------------------------------------------------------

sizes = st.floats(1e-12, 1e12)
fractions = st.integers(-9, 9).map(lambda n: n / 7) | st.floats(-3, 3)
points = st.tuples(fractions, fractions, st.just(0.0))
#: of one overlap over another in a scene
factors = st.floats(0.5, 2.0)


@st.composite
def spreads(
    draw: st.DrawFn, diameter: float
) -> gp.Uniform | gp.Normal | gp.Discrete | gp.Measured | None:
    """Of no more than 2e-4 of the diameter."""
    width = draw(st.floats(1e-9, 2e-4)) * diameter
    few = [diameter - width / 2, diameter + width / 2]
    listed = [gp.Discrete(few, (0.5, 0.5)), gp.Measured(few)]
    return draw(
        st.sampled_from(
            [None, gp.Uniform(0.0), gp.Uniform(width), gp.Normal(width / 4, 2.0), *listed]
        )
    )


@st.composite
def loads(draw: st.DrawFn, packing: gp.Packing) -> Load:
    """Overlaps from 3e-4 to 4e-2 of the diameter, given as one kind or another."""
    first, factor = draw(st.floats(6e-4, 2e-2)), draw(factors)
    several = st.integers(3, 60).map(
        lambda n: space_evenly(first, factor * first, n, draw(st.sampled_from(SCALES)))
    )
    overlaps = draw(
        st.just((first,))
        | st.lists(factors, min_size=2, max_size=5).map(lambda fs: [f * first for f in fs])
        | (several if factor != 1.0 else st.nothing())
    )
    states = gp.AveragedLattice(packing).at_overlap(np.array(overlaps) * packing.diameter)
    kind = draw(
        st.sampled_from(
            [kind for kind in LOADS if packing.lattice == "triangular" or kind != "side_force"]
        )
    )
    if kind != "side_force":
        return Load(kind, getattr(states, kind))
    return Load(kind, states.force, draw(st.integers(1, 3)))


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    material = gp.Material(
        draw(sizes),
        draw(st.floats(-0.9, 0.5)),
        draw(sizes),
        draw(st.none() | st.floats(1e-3, 1e12)),
    )
    lattice = draw(st.sampled_from(["triangular", "square", "kagome"]))
    diameter = draw(st.floats(1e-6, 1e3))
    friction = lattice != "triangular" or draw(st.booleans())
    packing = gp.Packing(
        material, diameter, draw(spreads(diameter)), lattice=lattice, friction=friction
    )
    several = st.lists(factors, min_size=1, max_size=2, unique_by=lambda factor: f"{factor:.6g}")
    parameters = draw(
        st.just({})
        | st.fixed_dictionaries(
            {},
            optional={
                "young_modulus": several.map(lambda fs: [f * material.young_modulus for f in fs]),
                "poisson_ratio": st.just(space_evenly(0.1, 0.3, 3, "linear")),
                "density": several.map(lambda fs: [f * material.density for f in fs]),
                "spread": st.just([gp.Uniform(1e-5 * diameter), gp.Normal(1e-6 * diameter)]),
                "friction": st.just([friction]),
                "lattice": st.just([lattice]),
            },
        )
    )
    media = ["ala", "afa", "ema", ("ema", "ala"), ()] + [{"ema": {"local_field": "paper"}}] * (
        lattice == "triangular"
    )
    finite_overlap = draw(st.booleans())
    if lattice == "triangular" and not finite_overlap:
        options = {
            "shape": st.tuples(*[st.integers(1, 20_000)] * 2),
            "seed": st.integers(0, 10**18),
            "samples": st.integers(1, 99),
        }
        media.append({"simulation": draw(st.fixed_dictionaries({}, optional=options))})
    load = draw(loads(packing))
    choice = draw(st.sampled_from(media))
    swept = parameters or len(load.values) > 1 or choice == ("ema", "ala")
    observables = (
        ["velocities"]
        if "lattice" in parameters or "friction" in parameters
        else ["velocities", "bands"]
    )
    paths = draw(
        st.none() | st.lists(st.lists(points, min_size=2, max_size=4), min_size=1, max_size=3)
    )
    band = None
    if paths is not None:
        assume(all(a != b for path in paths for a, b in itertools.pairwise(path)))
        count = sum(map(len, paths))
        label = st.text(
            st.characters(categories=["L", "N", "S", "P"], exclude_characters="'\"|"),
            min_size=1,
            max_size=6,
        )
        labels = draw(st.none() | st.lists(label, min_size=count, max_size=count).map(tuple))
        band = BandPath(tuple(map(tuple, paths)), labels)
    return Scene(
        packing,
        load,
        media=choice,
        parameters=parameters,
        finite_overlap=finite_overlap,
        observe=tuple(
            draw(st.sets(st.sampled_from(observables + ["dos"] * (not swept)), min_size=1))
        ),
        band=band,
        band_points=draw(st.integers(2, 1000)),
        mesh=(draw(st.integers(1, 200)), draw(st.integers(1, 200))),
        dim=draw(st.none() | st.tuples(st.integers(3, 9), st.integers(3, 9))),
    )


@pytest.mark.claim("files-all-digits")
@settings(max_examples=conftest.EXAMPLES // 3)
@given(scenes())
def test_a_written_scene_is_the_same_scene_to_the_last_bit(scene):
    again = Scene.from_text(scene.to_yaml())
    assert again == scene
    assert again.to_yaml() == scene.to_yaml()


def test_motions_that_a_scene_names_are_written_also_where_they_are_the_default():
    named = Scene.from_text(MINIMAL.replace("8 mm", "8 mm, motions: in_plane"))
    assert Scene.from_text(named.to_yaml()) == named
    assert "motions" not in Scene.from_text(MINIMAL).to_yaml()


# -- mistakes in Python ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("media", "simulaton"),
        ("media", {"simulation": {"shape": (16.0, 16)}}),
        ("media", {"simulation": {"seed": True}}),
        ("media", ("ala", "emma")),
        ("media", ("ala", "ala")),
        ("finite_overlap", 1),
        ("observe", ()),
        ("observe", ("bands", "bands")),
        ("observe", ("noise",)),
        ("band_points", 1),
        ("band_points", 2.0),
        ("mesh", (0, 1)),
        ("mesh", 8),
        ("mesh", (8, 8, 2)),
        ("dim", (2, 3)),
        ("dim", (3,)),
    ],
)
def test_values_that_a_scene_does_not_take(packing, name, value):
    with pytest.raises(InputError, match=r"found .*allowed: "):
        Scene(packing, Load("force", 1.0), **{name: value})


@pytest.mark.parametrize("name", ["parameters", "errors", "pulse", "surface", "design", "modes"])
def test_a_number_is_neither_a_block_nor_pairs(packing, name):
    with pytest.raises(InputError, match=name):
        Scene(packing, Load("force", 1.0), **{name: 3})


def test_a_scene_takes_blocks_as_mappings(packing):
    scene = Scene(packing, Load("force", 1.0), observe=["modes"], modes={"count": 3})
    assert scene.modes == gp.ModesSettings(count=3)


@pytest.mark.parametrize("arguments", [(3, Load("force", 1.0)), (None, 1.0)], ids=["balls", "load"])
def test_a_scene_needs_balls_and_a_load(packing, arguments):
    balls, load = arguments
    with pytest.raises(InputError, match="Give a granphon"):
        Scene(balls or packing, load)


def test_values_that_a_load_does_not_take(steel):
    for arguments in (
        ("weight", 1.0),
        ("force", 0.0),
        ("force", math.nan),
        ("force", 1.0, 31),
        ("side_force", 1.0),
        ("force", ()),
        ("force", (1.0, -1.0)),
        ("force", "1 N"),
        ("overlap", math.inf),
        ("overlap", (1.0, math.nan)),
    ):
        with pytest.raises(InputError):
            Load(*arguments)
    with pytest.raises(InputError, match="whole number"):
        Load("side_force", 1.0, 0)
    with pytest.raises(InputError, match=r"shape \(1, 1\)"):
        Scene(gp.Packing(steel, 8e-3), Load("force", [[1.0]]))
    with pytest.raises(InputError, match="hexagon"):
        Scene(gp.Packing(steel, 8e-3, lattice="square"), Load("side_force", 990.0, 31))
    with pytest.raises(InputError, match="2 labels; allowed: 3"):
        BandPath.parse("0 0 0 1/2 0 0 0 0 0", "G M")


@pytest.mark.parametrize(
    "paths",
    [
        (),
        [],
        None,
        "GKMG",
        3,
        ((),),
        (((0.0, 0.0, 0.0),),),
        (((0.0, 0.0), (0.5, 0.0)),),
        ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0)),
        (((0.0, 0.0, 0.0), (math.nan, 0.0, 0.0)),),
        (((0.0, 0.0, 0.0), (0.5, 0.0)),),
    ],
)
@pytest.mark.parametrize("labels", [None, ()])
def test_a_band_is_a_path_of_two_points_or_more(paths, labels):
    with pytest.raises(InputError, match="band"):
        BandPath(paths, labels)


def test_a_path_keeps_plain_numbers():
    path = BandPath([np.array([[0, 0, 0], [0.5, 0, 0]]), [(0, 0, 0), (1, 1, 0)]], None)
    assert path.paths == (((0.0, 0.0, 0.0), (0.5, 0.0, 0.0)), ((0.0, 0.0, 0.0), (1.0, 1.0, 0.0)))
    assert (str(path), hash(path)) == (
        "0 0 0 1/2 0 0, 0 0 0 1 1 0",
        hash(BandPath.parse("0 0 0 1/2 0 0, 0 0 0 1 1 0")),
    )


# -- anything at all -------------------------------------------------------------------------------

PIECES = [
    "",
    " ",
    "\n",
    "\n  ",
    ":",
    ": ",
    "- ",
    "[",
    "]",
    "{",
    "}",
    ",",
    "'",
    '"',
    "#",
    "&a ",
    "*a",
    "!x ",
    "|",
    ">",
    "?",
    "%",
    "@",
    "!!python/object:a.b ",
    "~",
    "null",
    "true",
    "yes",
    "nan",
    ".inf",
    "-1",
    "0",
    "1e999",
    "1e-320",
    "9" * 50,
    "8 mm",
    "µ",
    "\t",
    "\x00",
    "\x85",
    "\ufeff",
    "\U0001f600",
    "<<: ",
    "---",
    "...",
    "1/0",
    "m m",
    "^2",
    "1:2:3",
    "simulation",
    "kagome",
    "square",
]


SWEPT = (
    FULL.replace("18.446 N", "{from: 2 N, to: 20 N, points: 40, scale: log}")
    .replace(", dos", "")
    .replace(
        "medium: ema",
        "medium: [afa, {ema: {local_field: paper}}]\nsweep: {width: [1 um], spread: [{normal:"
        " {std: 1 um}}]}",
    )
)


SIMULATED = FULL.replace(
    "medium: ema", "medium:\n  simulation:\n    shape: 64 64\n    seed: 7\n    samples: 4"
)


def places_outside_comments(text):
    """Indices of the characters that count."""
    places = []
    start = 0
    for line in text.split("\n"):
        code = f"{line}\n".partition("#")[0]
        places.extend(range(start, min(start + len(code), len(text))))
        start += len(line) + 1
    return places


@pytest.mark.parametrize(
    "name", ["steel_hexagon", pytest.param("swept", marks=pytest.mark.slow), "simulated"]
)
def test_mutated_scenes_are_read_or_refused(name):
    ours = {"swept": SWEPT, "simulated": SIMULATED}
    base = ours[name] if name in ours else write_preset(name)
    rng = random.Random(f"a {name}")
    messages = []
    for _ in range(120):
        text = base
        for _ in range(rng.randint(1, 3)):
            start = rng.choice(places_outside_comments(text) or [0])
            length = rng.choice([0, 0, 1, 2, 5, 20])
            piece = rng.choice([*PIECES, chr(rng.randrange(1, 0x3000))])
            text = text[:start] + piece + text[start + length :]
        try:
            scene = Scene.from_text(text, "mutant.yaml")
        except SceneError as error:
            messages.append(str(error))
        else:
            assert Scene.from_text(scene.to_yaml()) == scene
    assert 30 < len(messages) < 120
    for message in messages:
        assert message.startswith("mutant.yaml:")
        assert "\n" not in message


@given(
    st.text(max_size=40),
    st.sampled_from(["8 mm", "211.65 GPa", "0.276", "18.446 N", "diameter", "load"]),
)
def test_any_value_is_taken_or_refused(text, instead_of):
    with suppress(SceneError):
        Scene.from_text(MINIMAL.replace(instead_of, text))


# -- counted before it is enumerated ---------------------------------------------------------------

BALLS = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 2 um}}
load: {force: 5 N}
"""
WIDTHS = (
    "sweep: {width: {from: 1 um, to: 3 um, points: 1000}, density: {from: 7 g/cm^3, to: 8 g/cm^3,"
    " points: 100}}\n"
)


@pytest.mark.parametrize("medium", ["ema", "simulation", "auto"])
def test_of_very_many_packings_the_ends_are_looked_at(medium):
    scene = Scene.from_text(BALLS.replace("5 N", "50 N") + f"medium: {medium}\n" + WIDTHS)
    cost = scene.cost()
    states, left = scene.plan.survey()
    assert len(list(states)) == (0 if medium == "simulation" else 4)
    assert "100,000 states" in left
    assert "100,000 states" in cost.text
    if medium == "simulation":
        assert cost.equilibria == 300_000
        (dearest,) = {
            estimate(
                gp.DirectSimulation(replace(scene.packing, spread=gp.Uniform(3e-6))),
                Load("force", 50.0),
                exponents=True,
            ).work
        }
        assert cost.work == pytest.approx(1e5 * dearest)


@pytest.mark.claim("memory-refused")
@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            BALLS.replace("5 N", "{from: 1 N, to: 9 N, points: 200000}") + WIDTHS,
            "4: sweep: 20,000,000,000 states: about ",
        ),
        (
            BALLS.replace("5 N", "{from: 1 N, to: 9 N, points: 200000}"),
            "3: load.force: 200,000 states: about 625 MB",
        ),
        (
            BALLS.replace("5 N", "{from: 1 N, to: 9 N, points: 100}")
            + "observe: [bands]\nphonopy: {band_points: 100000}",
            "5: phonopy.band_points: 100 states with 900,000 frequencies each: about ",
        ),
        (
            BALLS + "observe: [bands]\nphonopy: {band_points: 100000}",
            "5: phonopy.band_points: bands at 300,000 wave vectors",
        ),
        (
            BALLS + "observe: [dos]\nphonopy: {mesh: 4096 4096 1}",
            "5: phonopy.mesh: density of states on 4096 x 4096 ",
        ),
        (
            BALLS + "observe: [bands]\nphonopy: {dim: 100 100 1}",
            "5: phonopy.dim: force constants of 100 x 100 cells: ",
        ),
        (
            BALLS + "medium: {simulation: {shape: 4096 4096}}",
            r"4: medium: simulation of 16,777,216 balls, 3 equilibria: about .*",
        ),
    ],
)
def test_what_needs_more_memory_than_is_available_is_refused_before_anything_is_done(
    text, words, memory, tmp_path
):
    scene = Scene.from_text(text)
    memory(4e8)
    with pytest.raises(SceneError, match=f"<scene>:{words}.*0.4 GB"):
        scene.run(tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "observe: [spectrum]\nspectrum: {resolution: 0.06 Hz, points: 1000}\nmedium:"
            " {simulation: {shape: 4096 4096}}",
            r"6: medium: simulation of .*; waves in 16,777,216 balls: about .* days,"
            r" %s.*fewer wave vectors",
        ),
        (
            "medium: {simulation: {shape: 16384 16384, samples: 10000}}",
            "4: medium: simulation of 268,435,456 balls, .* days, %s.*Take fewer balls",
        ),
    ],
)
def test_what_takes_longer_than_any_run_is_refused_before_anything_is_done(
    text, words, memory, monkeypatch, tmp_path
):
    monkeypatch.setattr("granphon.media.cost._time_array", lambda *_: (1.0, 0.0))
    monkeypatch.setattr("granphon.runs.plan._measure_product", lambda *_: 1e-7)
    scene = Scene.from_text(BALLS + text)
    memory(math.inf)
    with pytest.raises(
        SceneError,
        match="<scene>:" + words % "and .*10,000 days",
    ):
        scene.run(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_long_lists_are_left_to_the_run(tmp_path):
    sizes = 8e-3 + 1e-6 * np.random.default_rng(1).normal(size=1000)
    (tmp_path / "lot.csv").write_text(
        "diameter (m)\n" + "".join(f"{size!r}\n" for size in sizes.tolist())
    )
    mean = gp.Measured(sizes).mean
    text = BALLS.replace("8 mm", f"{mean!r} m").replace("uniform: 2 um", "measured: lot.csv")
    for medium, few in (("ema", 0), ("[ala, ema]", 1)):
        (tmp_path / "scene.yaml").write_text(text + f"medium: {medium}\n")
        states, left = Scene.from_yaml(tmp_path / "scene.yaml").plan.survey()
        assert len(list(states)) == few
        assert "long lists" in left


def test_measured_diameters_say_the_diameter_of_the_packing(tmp_path):
    (tmp_path / "lot.csv").write_text("diameter (mm)\n8.001\n7.999\n8.006\n", encoding="utf-8")
    text = BALLS.replace("diameter: 8 mm, ", "").replace("uniform: 2 um", "measured: lot.csv")
    (tmp_path / "scene.yaml").write_text(text, encoding="utf-8")
    scene = Scene.from_yaml(tmp_path / "scene.yaml")
    assert scene.packing.diameter == scene.packing.spread.mean
    assert scene.packing.diameter == pytest.approx(8.002e-3, rel=1e-15)
    assert Scene.from_text(scene.to_yaml()) == replace(scene)
    # any other spread does not know the mean
    with pytest.raises(SceneError, match=r"packing\.diameter.* no default"):
        Scene.from_text(BALLS.replace("diameter: 8 mm, ", ""))


def test_a_scene_prints_itself_in_three_short_lines():
    scene = Scene.from_text(
        BALLS + "sweep: {width: [1 um, 2 um], poisson_ratio: [0.1, 0.2, 0.3]}\n"
    )
    lines = str(scene).splitlines()
    assert len(lines) == 3
    assert max(map(len, lines)) < 100
    for words in ("triangular", "8 mm", "5 N", "2 values of width", "3 values of poisson_ratio"):
        assert words in str(scene)
    frame = "{side_force: {from: 10 N, to: 1 kN, points: 4}, balls_per_side: 31}"
    text = str(Scene.from_text(BALLS.replace("{force: 5 N}", frame)))
    assert "side force 10 N to 1 kN (4 loads)" in text


@pytest.mark.parametrize(
    "arguments", [{"observe": None}, {"parameters": {5: [1.0]}}, {"finite_overlap": None}]
)
def test_arguments_of_another_kind_are_refused(arguments):
    packing = gp.Packing(gp.Material(2.1e11, 0.28, 7840.0), 8e-3)
    with pytest.raises(InputError, match=r"observe|parameter|finite_overlap"):
        Scene(packing, Load("force", 1.0), **arguments)


def test_a_mesh_may_be_an_array_and_media_may_be_none():
    packing = gp.Packing(gp.Material(2.1e11, 0.28, 7840.0), 8e-3)
    load = Load("force", 1.0)
    scene = Scene(packing, load, mesh=np.array([16, 8]), media=None)
    assert scene == Scene(packing, load, mesh=(16, 8))


@pytest.mark.parametrize("observe", [np.array(["velocities"]), np.array([]), (), {"velocities"}])
def test_observables_in_python_stand_in_a_list(observe):
    packing = gp.Packing(gp.Material(2.1e11, 0.28, 7840.0), 8e-3)
    with pytest.raises(InputError, match="observe"):
        Scene(packing, Load("force", 1.0), observe=observe)


@pytest.mark.parametrize("values", [["load.force"], {5: "21 N"}, {"load.force": 21}])
def test_values_in_place_of_those_of_a_file_are_texts(tmp_path, values):
    path = tmp_path / "scene.yaml"
    path.write_text(MINIMAL)
    with pytest.raises(InputError, match="mapping of texts"):
        Scene.from_yaml(path, values)


def test_the_keys_of_a_summary_are_known(tmp_path):
    text = MINIMAL.replace("8 mm", "8 mm, spread: {uniform: 2 um}") + "observe: [sensitivities]\n"
    summary = Scene.from_text(text).run(tmp_path, figures=False).folder / "summary.yaml"
    assert set(read_yaml(summary)) <= SUMMARY_KEYS | set(CATALOGUE)


def test_results_of_what_was_not_observed(tmp_path):
    result = Scene.from_text(MINIMAL).run(tmp_path / "one", figures=False)
    assert result.records == []
    with pytest.raises(InputError, match="no figure"):
        result.figure(["bands.png"])
    with pytest.raises(InputError, match="path"):
        is_complete(result.scene, 5)
    # each value of the width has a local field of its own
    widths = Scene.from_text(MINIMAL + "sweep: {width: [1 um, 2 um]}\n")
    with pytest.raises(InputError, match="sweep"):
        _ = widths.run(tmp_path / "widths", figures=False).local_field
    assert widths.packing.width == 0.0


@pytest.mark.parametrize("progress", [5, None])
def test_a_progress_of_another_kind_is_refused_before_a_folder_is_made(tmp_path, progress):
    with pytest.raises(InputError, match="progress"):
        Scene.from_text(MINIMAL).run(tmp_path / "out", progress=progress)
    assert not (tmp_path / "out").exists()


def test_a_spectrum_without_settings_has_the_default_ones(packing):
    assert Scene(packing, Load("force", 1.0), spectrum=None) == Scene(packing, Load("force", 1.0))


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"band": "0 0 0 1/2 0 0"}, "BandPath"),
        ({"source": 5}, "path is 5"),
        ({"parameters": [("width", [1e-6]), ("width", [2e-6])]}, "swept twice"),
        ({"parameters": [(["width"], [1e-6])]}, "name of a parameter"),
    ],
)
def test_a_path_a_source_and_parameters_of_another_kind_are_refused(packing, arguments, word):
    with pytest.raises(InputError, match=word):
        Scene(packing, Load("force", 1.0), **arguments)


def test_the_source_of_a_scene_may_be_a_text(packing):
    assert str(Scene(packing, Load("force", 1.0), source="of/lot.yaml")).startswith(
        "Scene lot.yaml"
    )
