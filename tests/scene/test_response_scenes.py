"""Scenes with a response in frequency: closed forms, the calls of Python, sweeps, samples and
figures.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.cli.main import main
from granphon.runs.dataset import load_sweep
from granphon.scene.redraw import redraw
from granphon.waves.peaks import find_peaks
from tests.runs.conftest import Meter

CHAIN = """
balls:
  S: {material: {young_modulus: 193 GPa, poisson_ratio: 0.30, density: 8000 kg/m^3}, diameter: 19.05 mm}
crystal: {lattice: chain}
load: {force: FORCE}
observe: [response]
response:
  frequencies: {from: 400 Hz, to: 14 kHz, points: 30, scale: linear}
  source: plane
  receiver: [19 x, 0 x]
  quantity: transmissibility
  cut: {axis: 0, layers: 20, edges: floor free}
"""
ARRAY = """
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 2 um}}
load: {force: FORCE}
medium: {simulation: {shape: 4 8, samples: 3}}
observe: [response]
response:
  frequencies: [2 kHz, 5 kHz, 9 kHz]
  source: plane
  receiver: plane
  damping: [2 us, 1 us]
  loss_factor: 0.01
  quantity: velocity
  cut: {axis: 1, layers: 1, edges: free}
"""
FREQUENCIES = np.linspace(400.0, 14000.0, 30)


def scene(text, **words):
    for name, word in words.items():
        text = text.replace(name, word)
    return gp.Scene.from_text(text)


def complex_of(dataset, name):
    """Return the response as complex numbers, (loads, media, n_f, receivers)."""
    return (dataset[name] * np.exp(1j * dataset["response_phase"])).values


def test_the_driven_chain_has_its_closed_form(tmp_path):
    one = scene(CHAIN, FORCE="20 N")
    result = one.run(tmp_path, figures=False)
    network = one.state().network
    found = complex_of(result.dataset, "transmissibility")[0, 0]
    rate = np.sqrt(network.normal_stiffness[0] / network.masses[0])
    t = 2.0 * np.arcsin((np.pi * FREQUENCIES / rate).astype(complex))  # above the band t is complex
    # u_n = A cos((N + 1/2 - n) t), and the floor is twice as stiff as the contact of two balls that
    # ends at a ball 0
    floor = 0.5 * (np.cos(20.5 * t) + np.cos(19.5 * t))
    for column, place in ((0, 20), (1, 1)):
        exact = (np.cos((20.5 - place) * t) / floor).real
        assert_allclose(found[:, column], exact, rtol=1e-9, atol=1e-10 * np.max(np.abs(exact)))
    assert FREQUENCIES[-1] > rate / np.pi
    # files, and the scene that was run
    assert "response.csv" in {path.name for path in result.files}
    table = np.genfromtxt(tmp_path / "response.csv", delimiter=",", names=True)
    assert_allclose(table["transmissibility_1"], np.abs(found).ravel(), rtol=1e-15)
    assert load_sweep(tmp_path / "sweep.nc").identical(result.dataset)
    assert gp.plot(result).axes[0].get_ylabel() == "Transmissibility (dB)"
    assert gp.Scene.from_text(one.to_yaml()) == one


LOSSY = CHAIN.replace("quantity:", "loss_factor: 0.02\n  quantity:")
SHORT = LOSSY.replace("points: 30", "points: 12").replace("19 x", "5 x").replace("20,", "6,")


def test_a_sweep_over_loads_has_the_numbers_of_python():
    swept = scene(SHORT, FORCE="[2 N, 128 N]")
    found = complex_of(swept.sweep(), "transmissibility")[:, 0]
    networks = [
        swept.packing.crystal.at_force(force).network.cut(0, 6, ("floor", "free"))
        for force in (2.0, 128.0)
    ]
    call = (np.linspace(400.0, 14000.0, 12), "plane", [(5, "x"), (0, "x")])
    options = {"quantity": "transmissibility", "loss_factor": 0.02}
    for network, values in zip(networks, found, strict=True):
        assert_allclose(values, gp.Waves(network).response(*call, **options).values, rtol=1e-12)
    # Hertz: frequencies go as f^(1/6), so that twice the frequency has the response at 64 times the
    # load
    doubled = gp.Scene.from_text(
        swept.to_yaml().replace("400.0 Hz", "800.0 Hz").replace("14000.0 Hz", "28000.0 Hz")
    )
    again = complex_of(doubled.sweep(), "transmissibility")[:, 0]
    assert_allclose(again[-1], found[0], rtol=1e-8)


@pytest.mark.parametrize(
    ("quantity", "source", "name"),
    [
        ("force", "0 x", "force_transmissibility"),
        pytest.param("force", "floor", "dynamic_stiffness", marks=pytest.mark.slow),
        pytest.param("stiffness", "plane", "dynamic_stiffness", marks=pytest.mark.slow),
    ],
)
def test_sensors_of_force_are_those_of_python(quantity, source, name):
    """Of contacts, of the floor and of a ball, in two states."""
    text = SHORT.replace("source: plane", f"source: {source}").replace("floor free", "free floor")
    text = text.replace("quantity: transmissibility", f"quantity: {quantity}")
    text = text.replace("[5 x, 0 x]", "[2-3, floor, 3 x]")
    swept = scene(text, FORCE="[2 N, 128 N]")
    assert gp.Scene.from_text(swept.to_yaml()) == swept
    dataset = swept.sweep()
    found = complex_of(dataset, name)[:, 0]
    place = {"0 x": (0, "x")}.get(source, source)
    for force, values in zip((2.0, 128.0), found, strict=True):
        network = swept.packing.crystal.at_force(force).network.cut(0, 6, ("free", "floor"))
        expected = gp.Waves(network).response(
            np.linspace(400.0, 14000.0, 12),
            place,
            [(2, 3), "floor", (3, "x")],
            loss_factor=0.02,
            quantity=quantity,
        )
        assert_allclose(values, expected.values, rtol=1e-12)
    assert dataset[name].attrs["units"] == ("1" if "force" in name else "N/m")


@pytest.mark.slow
def test_files_that_hold_the_default_polarisation_of_planes_are_read():
    """Earlier versions wrote it in every file of a response, also between balls."""
    balls = CHAIN.replace("source: plane", "source: 3 x").replace("transmissibility", "velocity")
    balls = balls.replace("points: 30", "points: 3")
    held = balls.replace("quantity:", "polarisation: longitudinal\n  quantity:")
    response = scene(held, FORCE="20 N").response
    assert response.polarisation == "longitudinal"
    ours = scene(balls, FORCE="20 N").sweep()
    theirs = scene(held, FORCE="20 N").sweep()
    assert_allclose(ours["mobility"], theirs["mobility"], rtol=0.0, atol=0.0)


def test_a_sensor_of_force_has_a_figure(tmp_path):
    text = SHORT.replace("transmissibility", "stiffness").replace("[5 x, 0 x]", "[2-3, 3 x]")
    result = scene(text, FORCE="[2 N, 128 N]").run(tmp_path)
    assert "response.png" in {path.name for path in result.files}


def test_accelerance_in_a_scene():
    text = SHORT.replace("plane", "5 x").replace("transmissibility", "acceleration")
    found = scene(text, FORCE="2 N").sweep()
    assert found["accelerance"].attrs["units"] == "1/kg"
    receptance = scene(text.replace("acceleration", "displacement"), FORCE="2 N").sweep()
    omega = 2.0 * np.pi * found["response_frequency"].values[:, None]
    values = complex_of(receptance, "receptance")[0, 0]
    assert_allclose(complex_of(found, "accelerance")[0, 0], -(omega**2) * values, rtol=1e-12)


@pytest.mark.slow
def test_a_sweep_over_loads_has_a_map(tmp_path):
    result = scene(LOSSY, FORCE="{from: 2 N, to: 128 N, points: 3}").run(tmp_path)
    assert "response.png" in {path.name for path in result.files}
    assert redraw(tmp_path, tmp_path / "response.pdf").name == "response.pdf"


TWO_KINDS = """
balls:
  S: {material: {young_modulus: 193 GPa, poisson_ratio: 0.30, density: 7958 kg/m^3}, diameter: 19.05 mm}
  A: {material: {young_modulus: 73.5 GPa, poisson_ratio: 0.33, density: 2694 kg/m^3}, diameter: 19.05 mm}
crystal: {lattice: chain}
load: {force: 20 N}
observe: [response, motion]
response:
  frequencies: {from: 50 Hz, to: 11 kHz, points: POINTS, scale: linear}
  source: plane
  receiver: BALL x
  damping: 1 us
  quantity: transmissibility
  cut: {axis: 0, layers: LAYERS, edges: floor floor}
motion:
  duration: 100 us
  frames: 11
  cut: {axis: 0, layers: LAYERS, edges: floor floor}
  drive: {balls: 0, impact: 1 um/s}
"""


@pytest.mark.claim("floor")
def test_the_floor_is_one_in_response_in_motion_and_in_the_crystal(tmp_path):
    chain = scene(TWO_KINDS, LAYERS="5", POINTS="8", BALL="9")
    result = chain.run(tmp_path, figures=False)
    network = chain.packing.crystal.cut(0, 5, "floor").at_force(20.0).network
    expected = gp.Waves(network).response(
        np.linspace(50.0, 11e3, 8), "plane", (9, "x"), damping=1e-6, quantity="transmissibility"
    )
    assert_allclose(result.dataset["transmissibility"].values[0, 0], expected.magnitude, rtol=1e-9)
    motion = result["balls_in_motion"]
    is_floor = (motion.network.i == 0) & np.isinf(motion.network.radii[motion.network.j])
    (floor,) = np.flatnonzero(is_floor)[:1]
    change = motion.forces[:, floor] - motion.forces[0, floor]
    moved = np.abs(motion.displacements[:, 0, 0]) > 1e-12
    (stiffness,) = network.normal_stiffness[(network.i == 0) & np.isinf(network.radii[network.j])]
    assert np.any(moved)
    assert_allclose(change[moved] / -motion.displacements[moved, 0, 0], stiffness, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.claim("response-peaks")
def test_a_peak_that_is_narrower_than_the_step_is_told_in_full(tmp_path):
    """As frequencies close to each other have it."""
    chain = scene(TWO_KINDS, LAYERS="20", POINTS="1500", BALL="39")
    numbers = chain.run(tmp_path, figures=False).summary()
    network = chain.packing.crystal.cut(0, 20, "floor").at_force(20.0).network
    frequencies = np.linspace(50.0, 11e3, 1500)
    near = numbers["peak_frequency"] * (1.0 + np.linspace(-1e-3, 1e-3, 2001))
    coarse, dense = (
        gp.Waves(network)
        .response(places, "plane", (39, "x"), damping=1e-6, quantity="transmissibility")
        .magnitude
        for places in (frequencies, near)
    )
    assert_allclose(numbers["peak_transmissibility"], dense.max(), rtol=1e-5)
    assert_allclose(numbers["peak_frequency"], near[np.argmax(dense)], rtol=2e-6)
    assert numbers["peak_transmissibility"] > 1.2 * coarse.max()
    step = frequencies[1] - frequencies[0]
    assert numbers["peaks"]["39 x"][0]["quality"] > 2.0 * numbers["peak_frequency"] / step


def test_a_peak_that_is_not_resolved_has_no_height(tmp_path):
    """Without losses."""
    lossless = scene(CHAIN, FORCE="20 N").run(tmp_path / "chain", figures=False)
    assert "peak_transmissibility" not in lossless.summary()
    assert any("narrower" in text for text in lossless.warnings)


def test_a_peak_of_a_mean_over_samples_has_no_height(tmp_path):
    """Their networks have peaks of their own."""
    text = ARRAY.replace(
        "[2 kHz, 5 kHz, 9 kHz]", "{from: 1 kHz, to: 12 kHz, points: 16, scale: linear}"
    )
    text = text.replace("samples: 3", "samples: 2")
    text = text.replace("[2 us, 1 us]\n  loss_factor: 0.01", "0 us\n  loss_factor: 1e-4")
    samples = scene(text, FORCE="20 N").run(tmp_path / "samples", figures=False)
    assert any("narrower" in said for said in samples.warnings)
    heights = [peak["height"] for peak in samples.summary()["peaks"]["plane"]]
    assert np.any(np.isnan(heights))


def test_peaks_are_those_of_the_damped_modes(tmp_path):
    text = CHAIN.replace(
        "from: 400 Hz, to: 14 kHz, points: 30", "from: 100 Hz, to: 3 kHz, points: 300"
    )
    one = gp.Scene.from_text(
        text.replace("quantity:", "loss_factor: 0.03\n  quantity:").replace("FORCE", "20 N")
    )
    result = one.run(tmp_path, figures=False)
    modes = gp.Waves(one.state().network.cut(0, 20, ("floor", "free"))).damped_modes(
        4, loss_factor=0.03
    )
    peaks = result.summary()["peaks"]["19 x"]
    for peak, frequency, quality in zip(
        peaks[:4], np.abs(modes.frequencies), modes.quality, strict=True
    ):
        assert abs(peak["frequency"] / frequency - 1.0) < 1e-3
        assert abs(peak["quality"] / quality - 1.0) < 0.03
    assert result.summary()["peak_frequency"] == peaks[0]["frequency"]
    assert result.dataset["peak_transmissibility"].item() == peaks[0]["height"]


def test_a_mode_by_itself_has_its_closed_form():
    # B + R/(p - f^2): a single mode over a background, of which three frequencies are enough
    f = np.linspace(90.0, 110.0, 41)
    pole = 100.0**2 * (1.0 + 0.02j)
    response = 0.3 - 0.1j + (40.0 + 300.0j) / (pole - f**2)
    (peak,) = zip(*find_peaks(f, response[:, None])[0], strict=True)
    assert_allclose(
        peak, [100.0, np.abs(0.3 - 0.1j + (40.0 + 300.0j) / (1j * pole.imag)), 50.0], rtol=1e-3
    )


def test_a_peak_between_two_equal_values_has_their_height():
    # no mode with a pole passes through the values, and the peak is no narrow line
    values = np.array([1.0, 2.0, 2.0, 1.0], complex)[:, None]
    (peaks,) = find_peaks(np.array([1.0, 2.0, 3.0, 4.0]), values)
    assert_allclose(peaks.frequencies, [2.0])
    assert_allclose(peaks.heights, [2.0])
    assert np.all(np.isnan(peaks.quality))


def test_samples_are_averaged_with_their_standard_error():
    one = scene(ARRAY, FORCE="[20 N, 40 N]")
    data = one.sweep()
    found = complex_of(data, "mobility")[..., 0]
    error = data["mobility_error"].values[..., 0]
    every = []
    for sample in one.plan.cases[0].case.medium.of(one.packing).at_force(40.0).samples:
        waves = gp.Waves(sample.network.cut(1, 1, "free"))
        options = {"damping": (2e-6, 1e-6), "loss_factor": 0.01, "quantity": "velocity"}
        every.append(waves.response([2e3, 5e3, 9e3], "plane", "plane", **options).coherent)
    assert_allclose(found[1, 0], np.mean(every, axis=0), rtol=1e-9)
    assert_allclose(error[1, 0], np.std(every, axis=0, ddof=1) / np.sqrt(3.0), rtol=1e-7)


def test_a_lattice_that_is_cut_has_the_response_of_its_medium():
    text = ARRAY.replace("{simulation: {shape: 4 8, samples: 3}}", "[ala, ema]").replace(
        "layers: 1", "layers: 4"
    )
    one = scene(text, FORCE="[20 N, 40 N]")
    found = complex_of(one.sweep(), "mobility")[..., 0]
    network = gp.EffectiveMedium(one.packing).at_force(40.0).network.cut(1, 4, "free")
    options = {"damping": (2e-6, 1e-6), "loss_factor": 0.01, "quantity": "velocity"}
    exact = gp.Waves(network).response([2e3, 5e3, 9e3], "plane", "plane", **options).coherent
    assert_allclose(found[1, 1], exact, rtol=1e-12)
    assert not np.allclose(found[1, 0], found[1, 1], rtol=1e-3)


@pytest.mark.slow
def test_a_sweep_that_was_cut_off_goes_on(tmp_path):
    one = scene(
        CHAIN.replace("load:", "sweep: {S.young_modulus: [150 GPa, 210 GPa]}\nload:"),
        FORCE="20 N",
    )
    whole = one.sweep()
    with pytest.raises(KeyboardInterrupt):
        one.run(tmp_path / "parts", figures=False, progress=Meter(stop=1))
    rest = Meter()
    assert one.run(tmp_path / "parts", figures=False, progress=rest).dataset.identical(whole)
    assert ("states", 2) in rest.steps


BANDS = (
    CHAIN[: CHAIN.index("observe:")].replace("chain", "triangular")
    + """
observe: [bands]
bands: {damping: [1 us, 2 us], loss_factor: LOSS}
phonopy: {band_points: 4}
"""
)


def test_bands_have_the_damped_modes_of_python(tmp_path):
    one = scene(BANDS, FORCE="[2 N, 128 N]", LOSS="0.01")
    data = one.run(tmp_path, figures=False).dataset
    q = data["qpoints"].values
    for row, force in enumerate((2.0, 128.0)):
        modes = gp.Phonons(one.packing.crystal.at_force(force)).damped(
            q.reshape(-1, 3), (1e-6, 2e-6), 0.01
        )
        for name, exact in (
            ("frequency", modes.frequencies.real),
            ("decay", modes.decay),
            ("quality", modes.quality),
        ):
            assert_allclose(
                data[f"damped_{name}"].values[row, 0], exact.reshape(*q.shape[:2], -1), rtol=1e-13
            )
    table = np.genfromtxt(tmp_path / "damped_bands.csv", delimiter=",", names=True)
    assert_allclose(table["damped_decay_1s"], data["damped_decay"].values.ravel(), rtol=1e-15)
    assert gp.Scene.from_text(one.to_yaml()) == one


def test_a_loss_factor_of_all_contacts_is_the_inverse_of_q():
    text = BANDS.replace("damping: [1 us, 2 us], ", "")
    data = scene(text, FORCE="20 N", LOSS="0.02").sweep()
    # omega^2 = omega_0^2 (1 + i eta): Q is 1/eta but for a part of second order, (eta/4)^2
    moving = data["frequencies"].values > 1.0
    assert_allclose(data["damped_quality"].values[moving], 50.0, rtol=1e-3)


def test_check_says_what_is_driven_and_heard(tmp_path, capsys):
    (tmp_path / "scene.yaml").write_text(ARRAY.replace("FORCE", "20 N"))
    assert main(["check", str(tmp_path / "scene.yaml")]) == 0
    said = capsys.readouterr().out
    assert all(
        word in said
        for word in ("velocity", "2 kHz to 9 kHz", "2e-06, 1e-06 s", "response.csv", "response.png")
    )


def test_losses_of_a_scene_reach_from_none_to_a_bound():
    chain = scene(CHAIN, FORCE="10 N")
    assert scene(CHAIN + "  damping: [0 us, 0 s]\n", FORCE="10 N").response.damping == (0.0, 0.0)
    assert chain.response.damping == 0.0


def test_drag_dashpots_and_restitutions_of_a_scene_are_those_of_python():
    words = "  drag: [2000 1/s, 10 1/s]\n  dashpot: 3 N*s/m\n  restitution: 0.9\n"
    one = scene(CHAIN + words, FORCE="10 N")
    losses = {"drag": (2000.0, 10.0), "dashpot": 3.0, "restitution": 0.9}
    assert {name: one.response.losses[name] for name in losses} == losses
    assert gp.Scene.from_text(one.to_yaml()) == one
    amplitudes = complex_of(one.sweep(), "transmissibility")[0, 0]
    response = one.response
    waves = gp.Waves(response.shape(one.state().network))
    found = waves.response(
        FREQUENCIES, "plane", [(19, "x"), (0, "x")], quantity="transmissibility", **losses
    )
    assert_allclose(amplitudes, found.values, rtol=1e-9)
