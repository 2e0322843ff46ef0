"""Scenes whose balls move by the whole of their contact law: numbers, files, figures and
sweeps.
"""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import ConvergenceError, SceneError
from granphon.runs.wave_records import write_contacts
from granphon.scene.redraw import redraw
from granphon.waves.settings import DriveSettings, MotionSettings
from tests.waves.test_nonlinear_exact import meeting

CHAIN = """
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {lattice: chain, diameter: 8 mm, motions: longitudinal}
load: {force: FORCE}
observe: [motion]
motion:
  cut: {axis: 0, layers: LAYERS}
  drive: {balls: 0, impact: SPEED}
  duration: TIME
  frames: FRAMES
"""
PLANE = """
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm}
load: {force: 5 N}
observe: [motion]
motion:
  repeat: 5 1
  cut: {axis: 1, layers: 4, edges: floor free}
  drive: DRIVE
  friction_coefficient: 0.3
  damping: 1 us
  duration: 40 us
  frames: 21
"""
CRYSTAL = """
balls:
  A: {material: {young_modulus: 193 GPa, poisson_ratio: 0.30, density: 8000 kg/m^3}, diameter: 19.05 mm}
  B: {material: {young_modulus: 73.5 GPa, poisson_ratio: 0.33, density: 2700 kg/m^3}, diameter: 19.05 mm}
crystal: {lattice: chain, kinds: [B, A], law: LAW, motions: longitudinal}
load: {force: 10 N}
observe: [motion]
motion: {cut: {axis: 0, layers: 10}, drive: {balls: lower, impact: 0.1 m/s}, duration: 0.5 ms, frames: 41}
"""


LAW_OF_PAIRS = "{A A: hertz, A B: {jkr: {adhesion: 9 J/m^2}}, B B: hertz}"


def scene(text, **words):
    for name, word in words.items():
        text = text.replace(name, word)
    return gp.Scene.from_text(text)


def chain(force, layers, speed, time, frames, **words):
    words |= {
        "FORCE": force,
        "LAYERS": str(layers),
        "SPEED": speed,
        "TIME": time,
        "FRAMES": str(frames),
    }
    return scene(CHAIN, **words)


@pytest.mark.claim("solitary-wave")
@pytest.mark.parametrize(
    "layers", [30, *(pytest.param(one, marks=pytest.mark.slow) for one in (40, 80))]
)
def test_a_solitary_wave_through_a_scene(layers, tmp_path):
    """V = 0.90553 d A^(1/3) m^(-1/2) F_m^(1/6), from the summary and the table of contacts."""
    tested = chain("1 nN", layers, "0.1 m/s", f"{25 * layers} us", 10 * layers + 1)
    result = tested.run(tmp_path, figures=False)
    table = np.genfromtxt(tmp_path / "motion_contacts.csv", delimiter=",", names=True)
    force = table["greatest_force_N"][layers // 2]
    state = tested.state()
    numbers = result.summary()
    coefficient = state.force / state.overlap**1.5
    wanted = 0.90553 * 8e-3 * coefficient ** (1 / 3) * state.packing.mass**-0.5 * force ** (1 / 6)
    assert_allclose([numbers["front_velocity"], numbers["peak_velocity"]], wanted, rtol=1e-4)
    middle = slice(layers // 4, 3 * layers // 4)
    rise = np.polyfit(table["peak_s"][middle], table["distance_m"][middle], 1)[0]
    assert_allclose(rise, wanted, rtol=1e-4)
    assert (
        numbers["greatest_force"] == table["greatest_force_N"].max()
        or numbers["greatest_force"] > force
    )
    assert_allclose(
        numbers["energy_translation"] + numbers["energy_stored"],
        numbers["energy_supplied"],
        rtol=1e-4,
    )
    assert numbers["energy_lost"] == 0.0


@pytest.mark.claim("solitary-wave")
@pytest.mark.parametrize(
    ("layers", "speed", "low", "high"),
    [
        (56, "0.3 m/s", 2.5, 4.5),
        pytest.param(80, "0.3 m/s", 2.5, 4.5, marks=pytest.mark.slow),
        pytest.param(140, None, 1.045, 1.055, marks=pytest.mark.slow),
        pytest.param(140, "0.12 m/s", 1.5, 2.0, marks=pytest.mark.slow),
        pytest.param(140, "0.3 m/s", 2.5, 4.5, marks=pytest.mark.slow),
    ],
)
def test_pulses_of_a_pressed_chain_through_scenes(layers, speed, low, high, tmp_path):
    """V/c of the long-wave theory at r = F_m/F_0, within 0.5 %; a weak pulse is sent by the
    displacement of its soliton.
    """
    one = chain("10 N", layers, speed or "1 m/s", f"{12 * layers} us", 6 * layers + 1)
    sound = gp.sound_velocities(one.state()).longitudinal
    overlap = one.state().overlap
    if speed is None:
        size = 1.05 ** (2.0 / 3.0) - 1.0  # compression over the overlap at rest
        length = 8e-3 * np.sqrt(2.0 / size)
        velocity = sound * np.sqrt(1.0 + size / 6.0)
        times = np.linspace(0.0, 8.0 * length / velocity, 81)
        way = (
            size
            * overlap
            * length
            / 8e-3
            * (np.tanh(velocity * times / length - 4.0) + np.tanh(4.0))
        )
        lists = {
            "time": [f"{t!r} s" for t in times.tolist()],
            "displacement": [f"{u!r} m" for u in way.tolist()],
        }
        text = one.to_yaml()
        text = (
            text[: text.index("  drive:")]
            + f"  drive: {{balls: 0, displacement: {lists}}}"
            + text[text.index("\n  damping") :]
        )
        one = gp.Scene.from_text(text.replace("'", ""))
    result = one.run(tmp_path, figures=False)
    table = np.genfromtxt(tmp_path / "motion_contacts.csv", delimiter=",", names=True)
    r = table["greatest_force_N"][3 * layers // 7] / 10.0
    wanted = np.sqrt(4.0 / 15.0 * (3.0 + 2.0 * r ** (5.0 / 3.0) - 5.0 * r ** (2.0 / 3.0))) / (
        r ** (2.0 / 3.0) - 1.0
    )
    assert low < r < high
    assert_allclose(result.summary()["peak_velocity"] / sound, wanted, rtol=5e-3)


def test_a_single_state_has_its_balls_and_tables(tmp_path):
    one = scene(PLANE, DRIVE="{balls: 2, impact: 0.2 m/s, direction: 0 1}")
    result = one.run(tmp_path, figures=False)
    files = {path.name for path in result.files}
    assert {"motion.nc", "motion.csv", "motion_contacts.csv"} <= files
    network = one.state().network.repeat((5, 1)).cut(1, 4, ("floor", "free"))
    velocities = np.zeros((network.n_balls, 3))
    velocities[2, 1] = 0.2
    waves = gp.NonlinearWaves(network, friction_coefficient=0.3, damping=1e-6)
    assert result["balls_in_motion"] == waves.run(4e-5, velocities=velocities, frames=21)
    table = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    energies = [table[f"motion_{name}_J"] for name in ("translation", "rotation", "stored", "lost")]
    assert_allclose(np.sum(energies, axis=0), table["motion_supplied_J"], rtol=2e-3)
    assert result.summary()["energy_lost"] == energies[3][-1] > 0.0
    assert gp.Scene.from_text(one.to_yaml()) == one
    assert gp.Scene.from_yaml(tmp_path / "scene.yaml") == one


@pytest.mark.slow
def test_a_single_state_has_a_figure(tmp_path):
    one = scene(PLANE, DRIVE="{balls: 2, impact: 0.2 m/s, direction: 0 1}")
    result = one.run(tmp_path)
    assert "motion.png" in {path.name for path in result.files}
    assert redraw(tmp_path, force=True).name == "motion.png"
    # and not velocities
    assert 'id="balls"' in redraw(tmp_path, tmp_path / "other.svg").read_text()
    assert len(gp.plot(result).axes) == 5


@pytest.mark.slow
def test_the_figure_of_a_single_state_is_drawn_from_its_files(tmp_path):
    chain("10 N", 4, "0.1 m/s", "20 us", 5).run(tmp_path, figures=False)
    assert redraw(tmp_path, tmp_path / "other.svg").stat().st_size > 5000


def test_balls_that_may_go_anywhere_by_steps_that_keep_the_energy(tmp_path):
    """Block ``motion`` reaches the true directions, the implicit scheme and all losses; they are
    those of the call.
    """
    words = (
        "geometry: exact\n  scheme: midpoint\n  viscous_pull: limited\n  coulomb: total\n"
        "  drag: [40 1/s, 20 1/s]\n  dashpot: 0.3 N*s/m\n  restitution: 0.95"
    )
    text = PLANE.replace("frames: 21", f"frames: 3\n  {words}")
    text = text.replace("repeat: 5 1", "repeat: 2 1").replace("duration: 40 us", "duration: 4 us")
    one = scene(text, DRIVE="{balls: 2, impact: 2 m/s, direction: 0 1}")
    result = one.run(tmp_path, figures=False)
    network = one.state().network.repeat((2, 1)).cut(1, 4, ("floor", "free"))
    velocities = np.zeros((network.n_balls, 3))
    velocities[2, 1] = 2.0
    waves = gp.NonlinearWaves(
        network,
        friction_coefficient=0.3,
        damping=1e-6,
        drag=(40.0, 20.0),
        dashpot=0.3,
        restitution=0.95,
        viscous_pull="limited",
        coulomb="total",
        geometry="exact",
    )
    assert result["balls_in_motion"] == waves.run(
        4e-6, velocities=velocities, frames=3, scheme="midpoint"
    )
    numbers = result.summary()
    kept = sum(numbers[f"energy_{name}"] for name in ("translation", "rotation", "stored", "lost"))
    assert_allclose(kept, numbers["energy_supplied"], rtol=1e-9)
    assert gp.Scene.from_text(one.to_yaml()) == one


def test_balls_that_have_met_are_in_the_table_of_contacts(tmp_path):
    waves, start = meeting()
    motion = waves.run(0.03 * 8e-3 / 2.0, **start, frames=101)
    drive = DriveSettings(balls=(2,), impact=2.0)
    write_contacts(
        motion, tmp_path / "contacts.csv", MotionSettings(duration=1.2e-4, drive=(drive,))
    )
    table = np.genfromtxt(tmp_path / "contacts.csv", delimiter=",", names=True)
    assert_allclose(np.stack([table["ball_i"], table["ball_j"]]), [[0, 1, 0], [1, 2, 2]])
    assert_allclose(table["greatest_force_N"], motion.peaks()[1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("layers", "time", "figures"),
    [(12, "0.2 ms", False), pytest.param(30, "0.5 ms", True, marks=pytest.mark.slow)],
)
def test_a_sweep_has_the_numbers_of_single_states(layers, time, figures, tmp_path):
    loads = chain("[1 N, 20 N]", layers, "0.1 m/s", time, 401)
    result = loads.run(tmp_path, figures=figures)
    data = result.dataset
    for index, force in enumerate(("1 N", "20 N")):
        alone = chain(force, layers, "0.1 m/s", time, 401).sweep()
        for name in (
            "front_velocity",
            "peak_velocity",
            "greatest_force",
            "energy_supplied",
            "motion_force",
        ):
            np.testing.assert_array_equal(data[name].values[index], alone[name].values[0])
    files = {path.name for path in tmp_path.iterdir()}
    assert "motion.csv" in files
    assert ({"sweep.png", "motion.png"} <= files) == figures
    if figures:
        assert redraw(tmp_path, tmp_path / "motion.pdf").exists()
        assert result.figure("sweep.png").axes[0].get_ylabel() == "Peak velocity (m/s)"


def test_a_sweep_compares_balls_with_friction_and_without():
    """The coefficient of friction has a use in one of the states: it is taken there. The states
    without friction are those of a scene without a coefficient.
    """
    words = {"DRIVE": "{balls: 2, impact: 2 m/s, direction: 1 1}", "40 us": "4 us", ": 21": ": 3"}
    limit = "  friction_coefficient: 0.3\n"
    total = PLANE.replace(limit, f"{limit}  coulomb: total\n")
    swept = scene(f"{total}sweep: {{friction: [true, false]}}\n", **words)
    data = swept.sweep()
    rough = scene(total, **words).sweep()
    plane = PLANE.replace("diameter: 8 mm", "diameter: 8 mm, friction: false")
    smooth = scene(plane.replace(limit, ""), **words).sweep()
    for friction, alone in ((True, rough), (False, smooth)):
        for name in ("energy_translation", "energy_rotation", "energy_lost"):
            values = data[name].sel(friction=friction).values
            np.testing.assert_array_equal(np.ravel(values), np.ravel(alone[name].values))
    assert rough["energy_rotation"].values > 0.0
    assert smooth["energy_rotation"].values == 0.0


def test_a_sweep_in_which_nothing_slips_has_no_coefficient_of_friction():
    text = PLANE.replace(
        "diameter: 8 mm", "diameter: 8 mm, friction: false, spread: {uniform: 1 um}"
    )
    text += "sweep: {width: [1 um, 2 um]}\n"
    with pytest.raises(SceneError, match=r"motion\.friction_coefficient"):
        scene(text, DRIVE="{balls: 2, impact: 2 m/s}")


def test_what_diffuses_has_no_velocity():
    """Dashpots that are far stronger than springs let the force diffuse, t ~ x^2: no front is read
    from that.
    """
    one = chain("10 N", 6, "1 mm/s", "3 us", 31)
    text = re.sub(r"(\n  damping: ).*", r"\g<1>1 ms", one.to_yaml())
    data = gp.Scene.from_text(text).sweep()
    assert "front_velocity" not in data
    assert "straight" in data.attrs["warnings"]


def test_a_force_pushes_and_tables_give_the_work(tmp_path):
    """A force over time, from a table or as lists; the work is what the balls have."""
    times = np.linspace(0.0, 2e-5, 51)
    push = 3.0 * np.sin(np.pi * times / 2e-5) ** 2
    (tmp_path / "push.csv").write_text(
        "time (us), force (N)\n"
        + "".join(f"{1e6 * t}, {f}\n" for t, f in zip(times, push, strict=True))
    )
    (tmp_path / "scene.yaml").write_text(
        PLANE.replace("DRIVE", "{balls: [1, 3], force: push.csv, direction: 0 1}")
    )
    one = gp.Scene.from_yaml(tmp_path / "scene.yaml")
    result = one.run(tmp_path / "out", figures=False)
    listed = gp.Scene.from_yaml(tmp_path / "out" / "scene.yaml")
    assert listed == one
    assert_allclose(listed.motion.drive[0].force.values, push, atol=1e-15)
    numbers = result.summary()
    kept = sum(numbers[f"energy_{name}"] for name in ("translation", "rotation", "stored", "lost"))
    assert_allclose(kept, numbers["energy_supplied"], rtol=2e-3)


def test_a_shaken_floor_moves_the_balls(tmp_path):
    floor = scene(
        PLANE,
        DRIVE="{balls: lower, shaker: {amplitude: 20 nm, frequency: 50 kHz, ramp: 1}, direction: 0"
        " 1}",
    )
    motion = floor.run(tmp_path / "floor", figures=False)["balls_in_motion"]
    # the floor comes after the balls
    assert_allclose(np.abs(motion.displacements[:, 20, 1]).max(), 2e-8, rtol=0.05)
    assert motion.work[-1] > 0.0
    table = np.genfromtxt(tmp_path / "floor" / "motion_contacts.csv", delimiter=",", names=True)
    # of the whole floor, wherever it is touched
    assert_allclose(table["distance_m"], table["y_m"] + 4e-3, rtol=1e-12)


@pytest.mark.parametrize(
    ("law", "same", "layers"),
    [
        ("hertz", gp.Hertz(), 5),
        (LAW_OF_PAIRS, None, 4),
        *(
            pytest.param(*case, 10, marks=pytest.mark.slow)
            for case in (
                ("hertz", gp.Hertz()),
                ("{power: {exponent: 2, coefficient: 1e12}}", gp.PowerLaw(2.0, 1e12)),
                ("{dmt: {adhesion: 0.5 J/m^2}}", None),
                (LAW_OF_PAIRS, None),
            )
        ),
    ],
)
def test_crystals_move_by_their_own_law(law, same, layers, tmp_path):
    milliseconds = 0.02 * layers if layers == 10 else 0.01 * layers
    text = CRYSTAL.replace("0.5 ms", f"{milliseconds} ms").replace(
        "layers: 10", f"layers: {layers}"
    )
    one = scene(text, LAW=law)
    motion = one.run(tmp_path / "run", figures=False)["balls_in_motion"]
    crystal = one.packing.crystal
    network = one.state().network.cut(0, layers)
    velocities = np.zeros((2 * layers, 3))
    velocities[0, 0] = 0.1
    duration = 1e-3 * milliseconds
    start = {"velocities": velocities, "frames": 41}
    assert motion == gp.NonlinearWaves(network, crystal).run(duration, **start)
    if same is not None:
        found = gp.NonlinearWaves(network, same).run(duration, **start)
        assert_allclose(motion.forces, found.forces, rtol=1e-9, atol=1e-9)
    own = crystal.law_of(0, 1)[0]
    moved = motion.displacements[:, :, 0]
    overlap = own.overlap(10.0) + network.normal[:, 0] * (moved[:, network.i] - moved[:, network.j])
    # contacts that have parted pull again once the balls have touched
    closed = (overlap > own.least_overlap) & ((overlap > 0.0) | (motion.forces != 0.0))
    assert_allclose(motion.forces, np.where(closed, own.force(overlap), 0.0), rtol=1e-6, atol=1e-6)
    assert not np.any((motion.forces != 0.0) & (overlap < own.least_overlap * (1.0 + 1e-6)))


@pytest.mark.parametrize("edges", ["free", pytest.param("clamped free", marks=pytest.mark.slow)])
def test_what_repeats_nowhere_moves_and_responds(edges):
    """A chain that is cut in the crystal, under two loads, with the law of the crystal."""
    text = CRYSTAL.replace(
        "motions:", f"cut: {{axis: 0, layers: 5, edges: {edges}}}, motions:"
    ).replace("10 N", "[5 N, 10 N]")
    text = text.replace("0.5 ms", "0.2 ms")
    text = text.replace("cut: {axis: 0, layers: 10}, drive: {balls: lower", "drive: {balls: upper")
    text = text.replace("[motion]", "[motion, response]")
    text += "response: {frequencies: [1 kHz, 2 kHz], source: 9 x, receiver: 4 x}\n"
    one = scene(text, LAW="{power: {exponent: 2, coefficient: 1e12}}")
    data = one.sweep()
    state = one.packing.crystal.at_force([5.0, 10.0])[1]
    assert not any(state.network.pbc)
    velocities = np.zeros((10, 3))
    velocities[-1, 0] = 0.1
    motion = gp.NonlinearWaves(state.network, gp.PowerLaw(2.0, 1e12)).run(
        2e-4, velocities=velocities, frames=41
    )
    assert_allclose(data["greatest_force"].values[1, 0], motion.forces.max(), rtol=1e-12)
    response = gp.Waves(state.network).response([1e3, 2e3], [(9, "x")], [(4, "x")])
    assert_allclose(data["receptance"].values[1, 0], np.abs(response.values), rtol=1e-12)
    with pytest.raises(SceneError, match="'bands'"):
        scene(text.replace("[motion, response]", "[bands]"), LAW="hertz")


def test_samples_of_a_simulation_move_and_are_averaged(tmp_path):
    text = PLANE.replace(
        "repeat: 5 1\n  cut: {axis: 1, layers: 4, edges: floor free}", "cut: {axis: 1, layers: 1}"
    )
    text = text.replace("diameter: 8 mm", "diameter: 8 mm, spread: {uniform: 1 um}")
    text += "medium: {simulation: {shape: 4 6, samples: 2}}\n"
    one = scene(text, DRIVE="{balls: lower, impact: 0.1 m/s, direction: 0 1}")
    result = one.run(tmp_path, figures=False)
    numbers = result.summary()
    assert numbers["greatest_force_error"] > 0.0
    alone = one.to_yaml().replace("samples: 2", "samples: 1").replace("seed: 0", "seed: 1")
    second = gp.Scene.from_text(alone).sweep()["greatest_force"].item()
    first = result["balls_in_motion"].forces.max()
    assert first != second
    assert_allclose(numbers["greatest_force"], 0.5 * (first + second), rtol=1e-12)


def test_a_clamped_layer_of_several_balls_is_moved_as_a_whole():
    """The cell of a honeycomb has two balls, of which the upper one touches the balls that move;
    both faces.
    """
    crystal = gp.Crystal.on("honeycomb", [gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)])
    array = crystal.at_force(10.0).network.cut(1, 4, "clamped")
    for word, wanted in (("lower", [0, 1]), ("upper", [6, 7])):
        np.testing.assert_array_equal(
            DriveSettings(balls=word, impact=1.0).find_balls(array), wanted
        )


def test_an_impact_beyond_hertz_law_is_noted(tmp_path):
    result = scene(
        CHAIN + "  geometry: exact\n",
        FORCE="1 N",
        LAYERS="4",
        SPEED="300 m/s",
        TIME="20 us",
        FRAMES="11",
    ).run(tmp_path, figures=False)
    assert any("radius" in one and "motion" in one for one in result.warnings)


def test_a_ball_that_flies_away_ends_the_run(tmp_path):
    with pytest.raises(ConvergenceError, match="left"):
        chain("1 N", 4, "40 m/s", "2 ms", 11).run(tmp_path)


def test_a_wave_that_is_not_through_has_no_velocity(tmp_path):
    """A run that ends while most forces still rise: half of what they ever do is not known."""
    text = PLANE.replace("layers: 4, edges: floor free", "layers: 8").replace(
        "duration: 40 us", "duration: 20 us"
    )
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = scene(text, DRIVE="{balls: lower, impact: 0.5 m/s, direction: 0 1}").run(
            tmp_path, figures=False
        )
    assert "front_velocity" not in found.dataset
    assert any("front velocity" in one for one in found.warnings)
    assert not [one for one in said if "Polyfit" in str(one.message)]
