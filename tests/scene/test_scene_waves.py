"""Scenes that observe the waves in a simulated array: files, figures, and what is read
back.
"""

import dataclasses

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError
from granphon.phonons.paths import BandPath
from granphon.scene.outputs import OUTPUTS, expected_files
from granphon.scene.redraw import redraw
from granphon.waves.path_spectra import find_path_points, find_path_spectra
from granphon.waves.pulses import PulseSource

HEAD = (
    "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
    "packing: {diameter: 8 mm, spread: {uniform: 2.04 um}}\nload: {force: 5 N}\n"
)
ARRAY = HEAD + "medium: {simulation: {shape: [6, 18]}}\ndirection: [0, 1]\n"
ALL = (
    ARRAY + "observe: [dos, spectrum, pulse]\nspectrum: {polarisation: [longitudinal, rotational],"
    " points: 4, resolution: 1 kHz}\n"
    "pulse: {frequency: 9 kHz, cycles: 1.5, distance: 45 mm}\nphonopy: {mesh: 6 6 1}\n"
)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A run of all that waves in samples give, and its folder."""
    folder = tmp_path_factory.mktemp("waves") / "out"
    scene = gp.Scene.from_text(ALL)
    return scene, scene.run(folder, figures=False), folder


def test_files_hold_what_the_library_finds(done):
    scene, result, folder = done
    names = {path.name for path in result.files}
    for stem in ("sample_dos", "spectrum", "pulse"):
        assert {f"{stem}.json", f"{stem}.csv"} <= names
        assert f"{stem}.png" in expected_files(scene)
        assert OUTPUTS[stem].read(folder / f"{stem}.json") == result[stem]
    waves = gp.Waves(scene.state().sample)
    assert waves.dos() == result["sample_dos"]
    assert waves.transmit(9000.0, (0, 1), 0.045, 1.5, ends="free") == result["pulse"]
    spectra = result["spectrum"]
    assert [one.polarisation for one in spectra.spectra] == ["longitudinal", "rotational"]
    again = waves.spectral_function(spectra.spectra[0].q, resolution=1e3)
    np.testing.assert_array_equal(again.values, spectra.spectra[0].values)
    summary = result.summary()
    assert summary["pulse_velocity"] == pytest.approx(result["pulse"].velocity, rel=1e-13)
    text = (folder / "summary.yaml").read_text()
    assert 'pulse_velocity: "m/s"' in text.split("units:")[1]
    assert 'pulse_distance: "m"' in text.split("units:")[1]


@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_scene_at_a_low_load_gives_its_pulse(seed):
    text = (
        HEAD.replace("5 N", "2 N") + f"medium: {{simulation: {{shape: [20, 40], seed: {seed}}}}}\n"
    )
    scene = gp.Scene.from_text(
        text + "observe: [velocities, pulse]\npulse: {frequency: 5200 Hz, cycles: 2}\n"
    )
    data = scene.sweep()
    assert 0.9 < (data["pulse_velocity"] / data["longitudinal"]).item() < 0.97


def test_tables_are_those_of_the_results(done):
    _, result, folder = done
    dos = np.loadtxt(folder / "sample_dos.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(dos[:, 1], result["sample_dos"].total)
    pulse = np.loadtxt(folder / "pulse.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(pulse[:, 2], result["pulse"].coherent)
    rows = (folder / "spectrum.csv").read_text().splitlines()
    assert rows[0].startswith("polarisation,distance (1/m),qx (1/m),qy (1/m),peak (Hz),width (Hz)")
    assert len(rows) == 1 + 2 * len(result["spectrum"].distances)
    place = rows[0].split(",").index("resolved")
    told = [row.split(",")[place] for row in rows[1:]]
    assert told == [
        str(int(one)) for spectrum in result["spectrum"].spectra for one in spectrum.resolved
    ]


def test_scene_with_waves_is_written_and_read_back(done):
    scene, _, folder = done
    again = gp.Scene.from_yaml(folder / "scene.yaml")
    assert again.spectrum == scene.spectrum
    assert again.pulse == scene.pulse
    assert again == scene


def test_a_spectrum_that_is_not_observed_is_written_unless_all_of_it_is_default():
    scene = gp.Scene.from_text(HEAD + "spectrum: {points: 5}\n")
    again = gp.Scene.from_text(scene.to_yaml())
    assert again == scene
    assert again.spectrum.points == 5
    assert "spectrum" not in gp.Scene.from_text(HEAD + "spectrum: {points: 21}\n").to_yaml()


@pytest.mark.parametrize("waves", [{"spectrum": {"points": 5}}, {"pulse": {"frequency": 9e3}}])
def test_a_crystal_refuses_waves_of_arrays_that_its_file_could_not_hold(waves):
    material = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    crystal = gp.Crystal.on("triangular", gp.Ball(material, 8e-3))
    gp.Scene(crystal, gp.Load("force", 5.0), spectrum={"points": 21})
    with pytest.raises(InputError, match="of a crystal"):
        gp.Scene(crystal, gp.Load("force", 5.0), **waves)


@pytest.mark.parametrize("stem", ["sample_dos", pytest.param("spectrum", marks=pytest.mark.slow)])
def test_figures_are_drawn_again(done, tmp_path, stem):
    _, _, folder = done
    assert redraw(folder, out=tmp_path / f"{stem}.svg").stat().st_size > 5000


def test_both_axes_of_a_pulse_have_numbers_and_labels(done):
    figure = done[1].figure("pulse.png")
    figure.draw_without_rendering()
    for axes in figure.axes:
        assert axes.get_xlabel() == "Time (µs)"
        assert axes.get_ylabel() in ("", "Velocity (mm/s)")
        assert any(label.get_visible() and label.get_text() for label in axes.get_xticklabels())


def test_a_name_of_a_figure_that_is_not_there_is_refused(done, tmp_path):
    _, _, folder = done
    for stem in ("sweep_dos", "sweep_spectra"):
        with pytest.raises(InputError, match=f"no {stem}"):
            redraw(folder, out=tmp_path / f"{stem}.png")
    for name in ("pulse.json", "scene.yaml"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    with pytest.raises(InputError, match="no spectrum"):
        redraw(tmp_path, out=tmp_path / "spectrum.png")
    assert redraw(tmp_path, out=tmp_path / "pulse.png").exists()


def test_path_to_a_vector_of_the_reciprocal_lattice_leaves_out_gamma_at_both_ends():
    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, gp.Uniform(2.04e-6))
    waves = gp.Waves(gp.DirectSimulation(packing, shape=(6, 6)).at_force(50.0).sample)
    lattice = gp.ContactLattice.of("triangular", packing.mindlin_ratio)
    found = find_path_points(waves.network, lattice, packing.diameter, [[(0, 0, 0), (1, 0, 0)]], 7)
    assert len(found.q) == 5


def test_path_of_an_array_has_the_wave_vectors_of_its_cell(tmp_path):
    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, gp.Uniform(2.04e-6))
    state = gp.DirectSimulation(packing, shape=(12, 12)).at_force(50.0)
    waves = gp.Waves(state.sample)
    path = BandPath.default(packing.structure)
    lattice = gp.ContactLattice.of("triangular", packing.mindlin_ratio)
    found = find_path_spectra(
        waves,
        lattice,
        state.scales,
        path.arrays,
        path.labels,
        points=13,
        polarisations=["longitudinal"],
    )
    assert found.labels == ("G", "K", "M", "G")
    q = found.spectra[0].q
    np.testing.assert_allclose(waves.nearest_wavevectors(q), q, rtol=1e-12)
    assert len(np.unique(q.round(6), axis=0)) == len(q) > 8
    assert np.all(np.any(q != 0.0, axis=1))
    # far above the spread, the coherent wave has the frequency of the lattice's branch
    first = np.argmin(found.spectra[0].wavenumber)
    bands = lattice.frequencies(q[first : first + 1] * packing.diameter)[0] * state.scales.frequency
    assert np.min(np.abs(bands / found.spectra[0].peak[first] - 1.0)) < 0.02
    table = tmp_path / "spectra.csv"
    for errors, words in (
        ({"height": found.numbers["peak"]}, "height"),
        ({"peak": found.spectra[0].peak}, "shape"),
    ):
        with pytest.raises(gp.GranphonError, match=words):
            found.write_csv(table, errors)
        assert not table.exists()


def test_settings_are_checked_in_python_too():
    scene = gp.Scene.from_text(ALL)
    with pytest.raises(gp.GranphonError, match="cycles"):
        dataclasses.replace(scene.pulse, cycles=0.0)
    with pytest.raises(gp.GranphonError, match="points"):
        dataclasses.replace(scene.spectrum, points=1)


def count_products(text):
    """Products with a vector times balls, of the waves of a scene."""
    return gp.Scene.from_text(text).plan.parts[-1][-1].units[0].number


def test_cost_of_waves_grows_with_what_is_asked():
    def count(text):
        return count_products(ARRAY.replace("[6, 18]", "[1000, 1000]") + text)

    alone = count("observe: [spectrum]\nspectrum: {points: 11}\n")
    assert alone > 1e6 * 256  # a million balls, and two moments from each product
    twice = count(
        "observe: [spectrum]\nspectrum: {points: 11, polarisation: [longitudinal, transverse]}\n"
    )
    assert twice == pytest.approx(2.0 * alone)
    assert count("observe: [spectrum]\nspectrum: {points: 11, resolution: 20 Hz}\n") > 5.0 * alone
    short = count("observe: [pulse]\npulse: {frequency: 10 kHz, distance: 0.5 m}\n")
    assert count("observe: [pulse]\npulse: {frequency: 10 kHz, distance: 5 m}\n") > 5.0 * short
    assert (
        count("observe: [pulse]\npulse: {frequency: 10 kHz, distance: 0.5 m, cycles: 5000}\n")
        > 50.0 * short
    )


def test_cost_of_a_spectrum_counts_each_wave_vector_of_the_cell_once():
    large = ARRAY.replace("[6, 18]", "[60, 60]")
    few, many = (
        count_products(large + f"observe: [spectrum]\nspectrum: {{points: {points}}}\n")
        for points in (300, 3000)
    )
    assert many == pytest.approx(few, rel=0.2)


def test_cost_of_a_pulse_of_low_frequency_counts_its_readings():
    def count(frequency, cycles):
        pulse = (
            f"observe: [pulse]\npulse: {{frequency: {frequency} Hz, distance: 20 mm, cycles:"
            f" {cycles}}}\n"
        )
        return count_products(ARRAY + pulse)

    # of the same duration, the one with more periods is read more often
    assert count(1000, 10) > 1.5 * count(100, 1)


@pytest.mark.parametrize("direction", [(1, 0), (0, 1)])
def test_cost_of_a_pulse_is_that_of_its_way_along_the_direction(direction):
    text = ARRAY.replace("[0, 1]", str([*direction])).replace("[6, 18]", "[12, 200]")
    scene = gp.Scene.from_text(text + "observe: [pulse]\npulse: {frequency: 9 kHz}\n")
    network = gp.AveragedLattice(scene.packing).at_force(1.0).network.repeat((12, 200))
    way = PulseSource.of(scene.pulse, network, direction).distance
    given = f"observe: [pulse]\npulse: {{frequency: 9 kHz, distance: {way!r} m}}\n"
    assert scene.plan.parts[-1][-1].units[0].number == pytest.approx(
        count_products(text + given), rel=1e-9
    )


def test_the_time_of_a_product_is_that_of_a_network_of_the_same_kind(steel):
    from granphon.runs.plan import _measure_product

    network = gp.AveragedLattice(gp.Packing(steel, 8e-3)).at_force(5.0).network
    assert 0.0 < _measure_product(network, 10**9) < 1e-3


def test_echo_in_a_scene_is_a_warning(tmp_path):
    scene = gp.Scene.from_text(
        ARRAY.replace("[6, 18]", "[6, 24]")
        + "observe: [pulse]\npulse: {frequency: 4 kHz, distance: 80 mm}\n"
    )
    result = scene.run(tmp_path / "out", figures=False)
    assert any("echo" in text for text in result.warnings)
    assert "echo" in (tmp_path / "out" / "summary.yaml").read_text()


def test_damaged_results_are_named_with_their_file(done, tmp_path):
    _, _, folder = done
    for text, said in (
        ("{}", "describe no class"),
        ("[1", "not JSON"),
        ((folder / "pulse.json").read_text().replace("9000.0", "9001.0"), "pulse.json"),
    ):
        (tmp_path / "pulse.json").write_text(text)
        with pytest.raises(gp.GranphonError, match=said) as caught:
            OUTPUTS["pulse"].read(tmp_path / "pulse.json")
        assert "pulse.json" in str(caught.value)


def test_corners_of_a_path_in_numbers_are_labelled_with_their_numbers(tmp_path):
    text = (
        ARRAY
        + "observe: [spectrum]\nspectrum: {points: 3}\nphonopy: {band: 0 0 0 1/3 1/3 0 1/2 0 0}\n"
    )
    labels = gp.Scene.from_text(text).run(tmp_path / "out", figures=False)["spectrum"].labels
    assert labels == ("0 0 0", "0.3333 0.3333 0", "0.5 0 0")
