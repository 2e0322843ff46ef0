"""Sweeps over what is not of the balls themselves: losses, walls and springs to the ground; and the
onsets of bands, which springs give.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError, SceneError
from granphon.cli.terminal import describe_result
from granphon.waves.settings import BandsSettings, PulseSettings, require_losses
from tests.scene.mistakes import BALLS

STEEL = gp.Material(193e9, 0.30, 8000.0)
BEAD = gp.Ball(STEEL, 19.05e-3)
SOFT = gp.Material(3e9, 0.35, 1200.0)
FREQUENCIES = np.array([1e3, 3e3, 5e3])
#: one ball of three that are held but for it
ONE_BALL = gp.Crystal.on("chain", [BEAD]).cut(0, 3, edges="clamped")
HEARD = {"frequencies": FREQUENCIES, "source": "1 x", "receiver": "1 x"}
DRIVEN = {"duration": 1e-4, "frames": 5, "drive": {"balls": [1], "impact": 0.01}}

ROW = (
    BALLS + "crystal: {lattice: chain, kinds: [S], repeat: 3, on_site: {x: 1 MN/m}, cut: {axis: 0,"
    " layers: 1, edges: [{wall: S}, free]}}\nload: {force: 20 N}\nobserve: [response]\n"
    "response: {frequencies: [1 kHz, 2 kHz], source: 2 x, receiver: 0 x, damping: 1 us}\n"
    "sweep: {drag: [0 1/s, 40 1/ms], on_site.x: [0 N/m, 3 MN/m],"
    " wall.young_modulus: [3 GPa, 193 GPa]}\n"
)
HELD = (
    BALLS + "crystal: {lattice: chain, kinds: [S], on_site: 1 MN/m}\nload: {force: 20 N}\n"
    "observe: [onsets]\n"
)


def complex_response(data):
    """The response of a data set, m/N."""
    return data["receptance"].values * np.exp(1j * data["response_phase"].values)


@pytest.mark.claim("sweep-losses")
@pytest.mark.parametrize(
    ("name", "values"), [("drag", [0.0, 2e3]), ("dashpot", [0.0, 5.0]), ("damping", [1e-7, 1e-6])]
)
def test_a_sweep_over_a_loss_is_the_damped_oscillator_at_each_value(name, values):
    data = gp.sweep(ONE_BALL, force=20.0, response=HEARD, **{name: values})
    stiffness = data["normal_stiffness"].values.ravel()
    mass = BEAD.mass
    omega = 2.0 * np.pi * FREQUENCIES
    for number, (loss, k) in enumerate(zip(values, stiffness, strict=True)):
        viscosity = {"drag": mass * loss, "dashpot": 2.0 * loss, "damping": 2.0 * k * loss}[name]
        expected = 1.0 / (2.0 * k - mass * omega**2 + 1j * omega * viscosity)
        found = complex_response(data)[0, 0, number, :, 0]
        assert_allclose(found, expected, rtol=1e-9)
    assert data[name].attrs["units"] in ("1/s", "N s/m", "s")


@pytest.mark.claim("sweep-losses")
@pytest.mark.parametrize("given", [{"dashpot": 3.0}, {"drag": 500.0}, {}])
def test_a_sweep_over_both_of_a_pair_moves_the_ball_by_the_second_across(given):
    crystal = gp.Crystal.on("chain", [BEAD], motions="in_plane").cut(0, 3, edges="clamped")
    heard = {"frequencies": FREQUENCIES, "source": "1 y", "receiver": "1 y", **given}
    axes = {} if "dashpot" in given else {"dashpot": [7.0]}
    data = gp.sweep(crystal, force=20.0, response=heard, tangential_dashpot=[0.0, 2.0], **axes)
    found = np.squeeze(complex_response(data))
    omega = 2.0 * np.pi * FREQUENCIES
    for number, across in enumerate((0.0, 2.0)):
        viscosity = 2.0 * across + BEAD.mass * given.get("drag", 0.0)
        k = data["shear_stiffness"].values.ravel()[number]
        expected = 1.0 / (2.0 * k - BEAD.mass * omega**2 + 1j * omega * viscosity)
        assert_allclose(found[number], expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("losses", "swept"),
    [
        ({"drag": 2.0}, "drag"),
        ({"dashpot": (2.0, 1.0)}, "tangential_dashpot"),
        ({"restitution": 0.9}, "restitution"),
    ],
)
def test_a_loss_that_is_given_is_not_swept(losses, swept):
    with pytest.raises(InputError, match=f"{swept} is swept.* response"):
        gp.sweep(ONE_BALL, force=20.0, response=HEARD | losses, **{swept: [0.5, 0.6]})


def test_a_sweep_varies_the_losses_of_response_and_motion_together():
    values = [0.5, 0.9]
    data = gp.sweep(ONE_BALL, force=20.0, response=HEARD, motion=DRIVEN, restitution=values)
    for number, value in enumerate(values):
        one = gp.sweep(
            ONE_BALL,
            force=20.0,
            response=HEARD | {"restitution": value},
            motion=DRIVEN | {"restitution": value},
        )
        for name in ("receptance", "energy_translation"):
            assert_allclose(data[name].isel(restitution=number), one[name], rtol=1e-12)


def test_a_sweep_finds_modes_in_python():
    data = gp.sweep(ONE_BALL, force=[10.0, 20.0], modes={"count": 1})
    k = data["normal_stiffness"].values.ravel()
    expected = np.sqrt(2.0 * k / BEAD.mass) / (2.0 * np.pi)
    assert_allclose(data["mode_frequency"].values.ravel(), expected, rtol=1e-12)


@pytest.mark.claim("sweep-walls")
def test_a_sweep_over_a_wall_has_hertz_of_each_material():
    moduli = np.array([3e9, 50e9, 193e9])
    row = gp.Crystal.on("chain", [BEAD]).cut(0, 1, edges=(gp.Wall(SOFT), "free"))
    data = gp.sweep(row, force=20.0, **{"wall.young_modulus": moduli})
    compliance = (1.0 - 0.30**2) / 193e9 + (1.0 - SOFT.poisson_ratio**2) / moduli
    # f = (4/3) E* R^(1/2) delta^(3/2)
    expected = (0.75 * 20.0 * compliance / np.sqrt(BEAD.radius)) ** (2.0 / 3.0)
    assert_allclose(data["overlap"].values.ravel(), expected, rtol=1e-12)
    assert data["wall.young_modulus"].attrs["long_name"] == "Young modulus of wall"


@pytest.mark.claim("sweep-walls")
def test_a_sweep_over_a_wall_of_a_response_is_that_of_one_ball_on_each_material():
    moduli = np.array([3e9, 50e9])
    cut = [(0, 2, (gp.Wall(SOFT), "clamped"))]
    heard = {"frequencies": FREQUENCIES, "source": "0 x", "receiver": "0 x", "cut": cut}
    chain = gp.Crystal.on("chain", [BEAD])
    data = gp.sweep(chain, force=20.0, response=heard, **{"response.wall.young_modulus": moduli})
    compliance = (1.0 - 0.30**2) / 193e9 + (1.0 - SOFT.poisson_ratio**2) / moduli
    at_wall = (6.0 * BEAD.radius * 20.0 / compliance**2) ** (1.0 / 3.0)  # (6 E*^2 R f)^(1/3)
    k = data["normal_stiffness"].values.ravel() + at_wall
    omega = 2.0 * np.pi * FREQUENCIES
    expected = 1.0 / (k[:, None] - BEAD.mass * omega**2)
    assert_allclose(np.squeeze(complex_response(data)), expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("response.wall_2.young_modulus", "walls are response.wall"),
        ("motion.wall.young_modulus", "no.* wall motion.wall"),
        ("response.wall.density", "no parameter"),
    ],
)
def test_walls_of_a_response_that_are_not_there_are_refused(name, message):
    heard = HEARD | {"cut": [(0, 3, (gp.Wall(SOFT), "free"))]}
    with pytest.raises(InputError, match=message):
        gp.sweep(gp.Crystal.on("chain", [BEAD]), force=20.0, response=heard, **{name: [1e9]})


@pytest.mark.claim("sweep-springs")
@pytest.mark.parametrize("kind", ["crystal", pytest.param("repeated", marks=pytest.mark.slow)])
def test_a_sweep_over_springs_begins_at_their_cut_off(kind):
    springs = np.array([0.0, 1e6, 4e6])
    crystal = gp.Crystal.on("chain", [BEAD], motions="in_plane", on_site={"y": 2e6})
    if kind == "repeated":
        crystal = crystal.repeat((2,))
    data = gp.sweep(crystal, force=20.0, onsets=True, **{"on_site.x": springs})
    found = data["onset_frequency"].values[0, 0]  # (springs, branches)
    roots = np.sqrt(springs / BEAD.mass) / (2.0 * np.pi)
    distance = np.min(np.abs(found - roots[:, None]), axis=1)
    # the frequency of sound, zero, is the root of rounding
    assert np.all(distance < 1e-5 * np.max(roots))
    assert np.all(np.min(np.abs(found - np.sqrt(2e6 / BEAD.mass) / 2.0 / np.pi), axis=1) < 2e3)
    assert data["on_site.x"].attrs["units"] == "N/m"


@pytest.mark.claim("onsets")
def test_onsets_of_a_chain_over_springs_and_loads():
    springs = np.array([1e6, 4e6])
    forces = np.array([5.0, 20.0])
    crystal = gp.Crystal.on("chain", [BEAD])
    data = gp.sweep(crystal, force=forces, onsets=True, on_site=springs)
    omega = np.sqrt(springs / BEAD.mass)
    k = data["normal_stiffness"].values[:, 0]  # (loads, springs)
    frequencies = data["onset_frequency"].values[:, 0, :, 0]
    assert_allclose(frequencies, np.tile(omega / (2.0 * np.pi), (2, 1)), rtol=1e-12)
    expected = k * BEAD.diameter**2 / (BEAD.mass * omega)
    assert_allclose(data["onset_curvature"].values[:, 0, :, 0], expected, rtol=1e-9)
    assert_allclose(data["onset_gap"].values[:, 0], frequencies, rtol=1e-12)
    assert data["onset_curvature"].attrs["units"] == "m^2/s"


def test_a_scene_of_one_state_tells_its_onsets(tmp_path):
    result = gp.Scene.from_text(HELD).run(tmp_path / "out")
    summary = result.summary()
    expected = np.sqrt(1e6 / 28.84e-3) / (2.0 * np.pi)  # the mass of the kind S
    assert_allclose(summary["onset_gap"], expected, rtol=1e-12)
    assert_allclose(summary["onset_frequency"], [expected], rtol=1e-12)
    assert {"onsets.csv", "onsets.png"} <= {path.name for path in result.files}


@pytest.mark.parametrize(
    ("springs", "text"), [("", "none"), (", on_site: 1 MN/m", "937.18 Hz")], ids=["free", "held"]
)
def test_a_gap_below_all_branches_is_printed_where_there_is_one(tmp_path, springs, text):
    scene = gp.Scene.from_text(HELD.replace(", on_site: 1 MN/m", springs))
    result = scene.run(tmp_path / "out", figures=False)
    assert ("gap below all branches", text) in describe_result(result)


def test_a_scene_with_a_sweep_over_a_loss(tmp_path):
    text = ROW.replace(", on_site.x: [0 N/m, 3 MN/m], wall.young_modulus: [3 GPa, 193 GPa]", "")
    text = text.replace("repeat: 3", "repeat: 1").replace("source: 2 x", "source: 0 x")
    data = gp.Scene.from_text(text).run(tmp_path / "out", figures=False).dataset
    found = complex_response(data)[0, 0, :, :, 0]
    omega = 2.0 * np.pi * np.array([1e3, 2e3])
    # 1/(h(gamma)) - 1/(h(0)) = i omega m gamma
    difference = 1.0 / found[1] - 1.0 / found[0]
    assert_allclose(difference.imag, omega * 28.84e-3 * 4e4, rtol=1e-9)


@pytest.mark.slow
def test_a_scene_with_a_sweep_over_losses_walls_and_springs(tmp_path):
    scene = gp.Scene.from_text(ROW)
    assert gp.Scene.from_text(scene.to_yaml()).parameters == scene.parameters
    data = scene.run(tmp_path / "out", figures=False).dataset
    ball = gp.Ball(STEEL, 19.05e-3, mass=28.84e-3)
    wall = gp.Wall(gp.Material(3e9, 0.30, 8000.0))
    row = gp.Crystal.on("chain", [ball], on_site=3e6).repeat((3,)).cut(0, 1, (wall, "free"))
    waves = gp.Waves(row.at_force(20.0))
    expected = waves.response([1e3, 2e3], (2, "x"), (0, "x"), damping=1e-6, drag=4e4)
    found = complex_response(data)[0, 0, 1, 1, 0]
    assert_allclose(found, expected.values, rtol=1e-10)


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("40 1/ms", "-1 1/s", "sweep.drag.1"),
        ("40 1/ms", "40", "sweep.drag.1"),
        ("40 1/ms", "0 1/s", "sweep.drag.1"),
        ("3 MN/m", "3 GPa", "sweep.on_site.x.1"),
        ("on_site.x", "on_site.y", "sweep.on_site.y"),
        ("wall.young_modulus", "wall_2.young_modulus", "sweep.wall_2"),
        ("wall.young_modulus", "wall.density", "sweep.wall.density"),
        ("drag: [0 1/s, 40 1/ms]", "restitution: [0, 1]", "sweep.restitution.0"),
        ("drag: [0 1/s, 40 1/ms]", "drag: [[1 1/s, 2 1/s]]", "sweep.drag.0"),
        ("observe: [response]", "observe: [modes]", "sweep: .*drag"),
        ("damping: 1 us", "drag: 1 1/s", "sweep: .*drag"),
        ("wall.young_modulus", "response.wall.young_modulus", "sweep: .*wall"),
    ],
)
def test_mistakes_of_such_sweeps_are_told_with_their_place(old, new, place):
    with pytest.raises(SceneError, match=place):
        gp.Scene.from_text(ROW.replace(old, new))


def test_velocities_over_springs_are_refused_before_anything_runs():
    text = HELD.replace(", on_site: 1 MN/m", "").replace("[onsets]", "[velocities]")
    with pytest.raises(SceneError, match="held"):
        gp.Scene.from_text(text + "sweep: {on_site: [0 N/m, 1 MN/m]}\n")


def test_onsets_have_one_direction():
    text = HELD.replace("lattice: chain", "lattice: square")
    with pytest.raises(SceneError, match="directions"):
        gp.Scene.from_text(text + "direction: [[1, 0], [1, 1]]\n")


@pytest.mark.parametrize(
    ("parameters", "word"),
    [
        ({"drag": [1.0]}, "drag"),
        ({"drag": [-1.0]}, "drag"),
        ({"restitution": [1.5]}, "restitution"),
        ({"restitution": [0.0]}, "restitution"),
        ({"on_site.z": [1.0]}, "on_site.z"),
        ({"on_site": [-1.0]}, "on_site"),
        ({"on_site": [np.nan]}, "on_site"),
        ({"wall.young_modulus": [1e9]}, "wall"),
        ({"drgg": [1.0]}, "Did you mean drag"),
    ],
)
def test_wrong_parameters_are_refused(parameters, word):
    motion = None if parameters == {"drag": [1.0]} else DRIVEN
    with pytest.raises(InputError, match=word):
        gp.sweep(ONE_BALL, force=20.0, motion=motion, **parameters)


def test_a_pulse_has_no_loss_factor_and_is_not_said_to_have_one():
    pulse = PulseSettings(frequency=1e4)
    require_losses(["drag", "damping"], [None, pulse])
    require_losses(["tangential_loss_factor"], [pulse, BandsSettings()])
    with pytest.raises(InputError) as caught:
        require_losses(["loss_factor"], [None, pulse])
    assert "response" in str(caught.value)
    assert "pulse" not in str(caught.value)
    with pytest.raises(InputError, match="pulse"):
        require_losses(["drag"], [None])


def test_a_packing_with_springs_says_to_use_a_crystal():
    with pytest.raises(InputError, match="Crystal"):
        gp.sweep(gp.Packing(STEEL, 8e-3), force=20.0, on_site=[1e6])
