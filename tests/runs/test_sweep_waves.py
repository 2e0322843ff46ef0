"""Sweeps of simulations that find waves in the arrays: means over samples, files, figures, what is
refused or not known.
"""

import dataclasses
from functools import partial

import numpy as np
import pytest

import granphon as gp
from granphon.balls.lattices import find_lattice
from granphon.media.array_options import DEFAULT_SHAPES
from granphon.media.choice import MediumChoice
from granphon.media.state import ideal_lattice
from granphon.runs.dataset import load_sweep
from granphon.runs.finished_tasks import read_entries
from granphon.runs.tasks import SampleRecord, require_arrays
from granphon.scene.outputs import expected_files
from granphon.scene.redraw import redraw
from granphon.scene.scene import WORK_FILE
from granphon.waves.path_spectra import find_path_points
from tests.runs.conftest import Meter

HEAD = (
    "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
    "packing: {diameter: 8 mm, spread: {uniform: 2.04 um}}\nload: {force: [2 N, 40"
    " N]}\ndirection: [0, 1]\n"
    "medium: {simulation: {shape: [4, 18], samples: 2}}\n"
)
PULSE = "pulse: {frequency: 8 kHz, cycles: 1.5, distance: 40 mm}\n"
ALL = HEAD + (
    "observe: [dos, spectrum, pulse]\nspectrum: {polarisation: [longitudinal, rotational],"
    " points: 3}\n" + PULSE
)
ONE = HEAD.replace("[2 N, 40 N]", "40 N").replace(", samples: 2", "")


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A sweep of all that waves in samples give, and its folder."""
    folder = tmp_path_factory.mktemp("waves") / "out"
    scene = gp.Scene.from_text(ALL)
    return scene, scene.run(folder, figures=False), folder


@pytest.fixture(scope="module")
def samples(done):
    """The two samples at each load, which one simulation of both finds."""
    return [
        gp.DirectSimulation(done[0].packing, (4, 18), samples=2).at_force(force).samples
        for force in (2.0, 40.0)
    ]


def _mean_and_error(values):
    """Mean of two values, and its standard error: half their difference."""
    return np.mean(values, axis=0), 0.5 * np.abs(values[0] - values[1])


def test_lines_are_means_over_samples(done, samples):
    scene = done[0]
    data = done[1].dataset
    assert data.line_frequency.dims == ("load", "medium", "polarisation", "wavevector")
    for at, pair in enumerate(samples):
        way = find_path_points(
            pair[0].network, ideal_lattice(scene.packing), 8e-3, scene.path.arrays, 3
        )
        np.testing.assert_allclose(data.path_distance[at, 0], way.distances)
        for number, name in enumerate(("longitudinal", "rotational")):
            lines = [gp.Waves(one).spectral_function(way.q, name) for one in pair]
            found = data.isel(load=at, medium=0, polarisation=number)
            assert str(found.polarisation.values) == name
            for variable, of in (
                ("line_frequency", "peak"),
                ("line_width", "width"),
                ("phase_velocity", "phase_velocity"),
            ):
                mean, error = _mean_and_error([getattr(one, of) for one in lines])
                np.testing.assert_allclose(found[variable], mean, rtol=1e-5)
                np.testing.assert_allclose(
                    found[f"{variable}_error"], error, rtol=1e-3, atol=1e-5 * np.max(mean)
                )
            alpha = np.pi * found.line_width.values / found.phase_velocity.values
            np.testing.assert_allclose(found.attenuation, alpha)
            there = alpha > 0.0
            np.testing.assert_allclose(found.mean_free_path.values[there], 0.5 / alpha[there])
            assert np.all(np.isinf(found.mean_free_path.values[~there]))


def test_densities_are_means_over_samples_with_random_vectors_of_their_own(done, samples):
    data = done[1].dataset
    for at, pair in enumerate(samples):
        found = data.isel(load=at, medium=0)
        each = [gp.Waves(one).dos(seed=seed) for seed, one in enumerate(pair)]
        f = found.dos_frequency.values
        np.testing.assert_allclose(f, max((one.frequencies for one in each), key=max))
        mean, error = _mean_and_error(
            [np.interp(f, one.frequencies, one.total, right=0.0) for one in each]
        )
        scale = float(mean.max())
        # splines there, straight lines here
        np.testing.assert_allclose(found.dos_total, mean, atol=0.02 * scale)
        np.testing.assert_allclose(found.dos_error, error, atol=0.02 * scale)
        np.testing.assert_allclose(
            found.dos_total, found.dos_translational + found.dos_rotational, rtol=1e-12
        )
        # three motions of a ball
        assert float(np.sum(found.dos_total.values[1:] * np.diff(f))) == pytest.approx(
            3.0, rel=0.02
        )


def test_pulses_are_means_over_samples(done, samples):
    for at, pair in enumerate(samples):
        sent = [gp.Waves(one).transmit(8000.0, (0, 1), 0.04, 1.5, ends="free") for one in pair]
        found = done[1].dataset.isel(load=at, medium=0)
        mean, error = _mean_and_error([one.velocity for one in sent])
        np.testing.assert_allclose(
            [found.pulse_velocity, found.pulse_velocity_error], [mean, error], rtol=1e-4
        )
        np.testing.assert_allclose(
            found.time_of_flight, np.mean([one.time_of_flight for one in sent]), rtol=1e-6
        )


def test_quantities_have_units_and_stand_in_tables(done):
    data = done[1].dataset
    folder = done[2]
    units = {
        "line_width": "Hz",
        "attenuation": "1/m",
        "mean_free_path": "m",
        "dos_total": "1/Hz",
        "pulse_velocity": "m/s",
    }
    assert {name: data[name].attrs["units"] for name in units} == units
    rows = (folder / "sweep_dos.csv").read_text().splitlines()
    assert rows[0].startswith("force (N),medium,dos_frequency (Hz),dos_total (1/Hz)")
    assert len(rows) == 1 + data.dos_total.size
    rows = (folder / "sweep_spectra.csv").read_text().splitlines()
    assert rows[0].startswith(
        "force (N),medium,polarisation,path_distance (1/m),wavenumber (1/m),line_frequency (Hz)"
    )
    assert len(rows) == 1 + data.line_frequency.size
    again = load_sweep(folder / "sweep.nc")
    assert again.identical(data)


@pytest.mark.slow
def test_figures_are_drawn_and_drawn_again(done, tmp_path):
    scene, result, folder = done
    assert {path.name for path in result.files} == set(expected_files(scene, figures=False))
    assert set(expected_files(scene)) - set(expected_files(scene, figures=False)) == {
        "sweep.png",
        "sweep_dos.png",
        "sweep_spectra.png",
    }
    assert redraw(folder, out=tmp_path / "sweep_dos.svg").stat().st_size > 5000
    spectra = result.figure("sweep_spectra.png")
    assert [ax.get_ylabel() for ax in spectra.axes] == [
        f"{what}, {name} ({unit})"
        for name in ("longitudinal", "rotational")
        for what, unit in (("Frequency", "kHz"), ("Attenuation", "1/m"))
    ]
    assert [text.get_text() for text in spectra.legends[0].get_texts()] == ["2 N", "40 N"]
    assert "velocity of pulses" in [
        text.get_text() for text in result.figure("sweep.png").legends[0].get_texts()
    ]


@pytest.mark.slow
def test_sweep_finds_what_it_observes_alone(done, tmp_path):
    assert "exponent" not in done[1].dataset  # two more equilibria at each load
    data = (
        gp.Scene.from_text(HEAD + "observe: [velocities, pulse]\n" + PULSE)
        .run(tmp_path / "out", figures=False)
        .dataset
    )
    assert {"exponent", "pulse_velocity"} <= set(data)
    assert not [name for name in data if name.startswith(("dos", "line", "ioffe"))]


@pytest.mark.exhaustive
def test_interrupted_sweep_goes_on_with_the_waves_that_it_has(done, tmp_path):
    scene, result, _ = done
    with pytest.raises(KeyboardInterrupt):
        scene.run(tmp_path / "out", figures=False, progress=Meter(stop=2))
    kept = [part for _, part in read_entries(tmp_path / "out" / WORK_FILE)]
    assert sum(len(part["force"]) for part in kept) == 2
    data = scene.run(tmp_path / "out", figures=False).dataset
    assert data.drop_attrs().identical(result.dataset.drop_attrs())


def test_ioffe_regel_frequency_is_that_of_the_mean_lines():
    from granphon.runs.wave_records import average_waves
    from granphon.waves.settings import SpectrumSettings, WaveSettings

    q, wanted = np.array([1.0, 2.0, 3.0]), WaveSettings(spectrum=SpectrumSettings())

    def record(widths):
        lines = np.array([[[10.0, 20.0, 30.0], widths, [1.0, 1.0, 1.0]]])
        return {"path_corners": q, "path_distance": q, "wavenumber": q, "lines": lines}

    # the logarithm of peak/width, 20/10 and then 30/60, passes zero halfway
    found, notes = average_waves([record([1.0, 8.0, 50.0]), record([1.0, 12.0, 70.0])], wanted)
    assert float(found["ioffe_regel_longitudinal"]) == pytest.approx(25.0)
    assert not notes
    each = [
        20.0 + 10.0 * np.log(20.0 / a) / (np.log(20.0 / a) - np.log(30.0 / b))
        for a, b in ((8.0, 50.0), (12.0, 70.0))
    ]
    assert float(found["ioffe_regel_longitudinal_error"]) == pytest.approx(
        0.5 * abs(each[0] - each[1])
    )
    found, notes = average_waves([record([1.0, 1.0, 1.0])], wanted)
    assert "ioffe_regel_longitudinal" not in found
    assert "longer" in notes[0]
    _, notes = average_waves([record([11.0, 1.0, 1.0])], wanted)
    assert "already beyond" in notes[0]


def test_python_takes_the_same_as_mappings(done):
    packing = done[0].packing
    data = gp.sweep(
        packing,
        force=[40.0],
        media={"simulation": {"shape": (4, 18), "samples": 2}},
        direction=(0, 1),
        dos=True,
        spectrum={"polarisation": ["longitudinal", "rotational"], "points": 3, "path": "GKMG"},
        pulse={"frequency": 8e3, "cycles": 1.5, "distance": 0.04},
    )
    for name in ("dos_total", "line_width", "pulse_velocity_error", "mean_free_path"):
        np.testing.assert_allclose(data[name], done[1].dataset[name][1:], rtol=1e-9)
    assert "exponent" in data
    for more, said in (
        ({"pulse": {"frequncy": 1.0}}, "frequency"),
        ({"pulse": {"cycles": 3.0}}, "frequency"),
        ({"spectrum": {"points": 1}}, "points"),
        ({"dos": True, "media": "ema"}, "simulation"),
        ({"dos": 1}, "dos"),
    ):
        with pytest.raises(gp.GranphonError, match=said):
            gp.sweep(packing, force=[1.0], **({"media": {"simulation": {"shape": (4, 18)}}} | more))


# -- what cannot be found --------------------------------------------------------------------------


def _with_pulse(text, **more):
    given = {"frequency": "8 kHz", "cycles": "1.5", "distance": "40 mm"} | more
    return (
        text
        + "observe: [pulse]\npulse: {"
        + ", ".join(f"{key}: {value}" for key, value in given.items())
        + "}\n"
    )


BEFORE = {
    "shorter than a ball": ({"distance": "1 nm"}, "distance.*source itself"),
    "beyond the array": ({"distance": "5 m"}, "would meet itself"),
    "behind the last plane": ({"distance": "123 mm", "ends": "periodic"}, "other way round"),
    "a record that ends too soon": ({"ends": "periodic", "cycles": "9"}, "before the burst"),
    "far above the top": ({"frequency": "900 kHz"}, "above the top"),
    "so damped that nothing moves": ({"damping": "1e9 s"}, "nothing moves"),
    "losses that differ, of too many steps": (
        {"damping": "[1 s, 2 s]"},
        "products with the matrix",
    ),
}


@pytest.mark.parametrize("text", [ONE, HEAD], ids=["state", "sweep"])
@pytest.mark.parametrize(("more", "said"), BEFORE.values(), ids=BEFORE.keys())
def test_pulse_that_cannot_be_is_refused_before_a_simulation(text, more, said):
    with pytest.raises(gp.GranphonError, match=said) as caught:
        gp.Scene.from_text(_with_pulse(text, **more))
    assert "pulse" in str(caught.value)


def test_large_arrays_are_checked_when_they_are_run(monkeypatch, tmp_path):
    monkeypatch.setattr("granphon.runs.plan.QUICK_BALLS", 50)
    scene = gp.Scene.from_text(_with_pulse(ONE, distance="1 nm"))
    with pytest.raises(gp.GranphonError, match="source itself"):
        scene.run(tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD.replace("4, 18", "1, 1") + "observe: [spectrum]\n", "no wave vector"),
        (
            HEAD.replace("um}}", "um}, friction: false}")
            + "observe: [spectrum]\nspectrum: {polarisation: rotational}\n",
            "rotational",
        ),
        (HEAD + "observe: [spectrum]\nspectrum: {resolution: 1 mHz}\n", "moments"),
        (HEAD + "sweep: {lattice: [triangular, square]}\nobserve: [spectrum]\n", "lattice"),
        (
            HEAD.replace("{simulation", "[ema, {simulation").replace("2}}", "2}}]")
            + "observe: [dos]\n",
            "simulation",
        ),
        (
            HEAD.replace(
                "{simulation: {shape: [4, 18], samples: 2}}",
                "[{simulation: {shape: [6, 6]}}, {simulation: {shape: [8, 8]}}]",
            )
            + "observe: [spectrum]\n",
            "shape",
        ),
    ],
    ids=["small", "rotational", "fine", "lattices", "a medium beside", "shapes"],
)
def test_spectra_that_cannot_be_are_refused_before_a_simulation(text, said):
    with pytest.raises(gp.GranphonError, match=said) as caught:
        gp.Scene.from_text(text)
    assert "<scene>:" in str(caught.value)


def test_loads_may_have_unequal_numbers_of_peaks_of_the_response():
    """In one sample, whose loads share a task, as in a sweep of each load."""
    material = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    packing = gp.Packing(material, 8e-3, spread=gp.Uniform(2.04e-6), friction=True)
    settings = {
        "frequencies": np.linspace(500.0, 6e4, 60).tolist(),
        "source": ["0 x"],
        "receiver": ["5 y"],
        "damping": 1e-6,
    }
    find = partial(gp.sweep, packing, media={"simulation": {"shape": (3, 3)}}, response=settings)
    joint = find(force=[2.0, 100.0])["peaks_frequency"].values[:, 0, 0]
    first, second = (find(force=force)["peaks_frequency"].values[0, 0, 0] for force in (2.0, 100.0))
    assert len(second) < len(first) == joint.shape[1]
    np.testing.assert_allclose(joint[0], first, rtol=1e-6)
    np.testing.assert_allclose(joint[1, : len(second)], second, rtol=1e-6)
    assert np.all(np.isnan(joint[1, len(second) :]))


def test_the_records_of_one_task_may_have_unequal_numbers_of_peaks():
    """As those of a history of friction, whose loads are one step."""
    tables = [np.ones((3, 1, n_peaks)) for n_peaks in (2, 0, 1)]
    records = [SampleRecord(force=1.0, of_waves={"response_peaks": table}) for table in tables]
    result = SampleRecord.to_result(records)
    assert result["force"].shape == (3,)
    for index, table in enumerate(tables):
        peaks = SampleRecord.from_result(result, index).of_waves["response_peaks"]
        assert peaks.shape == (3, 1, 2)
        np.testing.assert_array_equal(peaks[..., : table.shape[-1]], table)
        assert np.all(np.isnan(peaks[..., table.shape[-1] :]))


def test_spectra_of_a_shape_that_is_named_once_and_the_default_once_fit_into_one_array():
    lattice = find_lattice("triangular")
    default = MediumChoice("simulation")
    named = MediumChoice("simulation", (("shape", DEFAULT_SHAPES[2]), ("samples", 2)))
    require_arrays([default, named], lattice, [], ["spectrum"])
    other = MediumChoice("simulation", (("shape", (8, 8)),))
    with pytest.raises(gp.GranphonError, match="shape"):
        require_arrays([default, other], lattice, [], ["spectrum"])


#: the echo from the far end comes before it is at its height
LATE = {"cycles": "4", "distance": "60 mm"}


def test_pulse_that_cannot_be_read_is_told_and_all_else_is_written(tmp_path):
    result = gp.Scene.from_text(_with_pulse(ONE, **LATE)).run(tmp_path / "out", figures=False)
    assert not result.failures
    assert any("arrival" in text for text in result.warnings)
    assert {"pulse.json", "sample.extxyz"} <= {path.name for path in result.files}
    assert {"coherent_fraction", "pulse_distance"} <= set(result.summary())
    assert not {"time_of_flight", "pulse_velocity"} & set(result.summary())
    assert redraw(tmp_path / "out", out=tmp_path / "pulse.svg").stat().st_size > 5000


def test_pulse_that_cannot_be_sent_is_told_and_all_else_is_written(tmp_path):
    # the top of the modes is known once the forces are, and margins before
    scene = gp.Scene.from_text(_with_pulse(ONE, frequency="100 kHz"))
    result = scene.run(tmp_path / "out", figures=False)
    assert any("arrival" in text and "above the top" in text for text in result.warnings)
    assert (tmp_path / "out" / "summary.yaml").exists()
    assert not list((tmp_path / "out").glob("pulse.*"))
    assert not {"coherent_fraction", "pulse_velocity"} & set(result.summary())


def test_load_at_which_no_pulse_is_read_is_nan_with_a_warning(tmp_path):
    one = HEAD.replace(", samples: 2", "")
    text = _with_pulse(one.replace("2 N, 40 N", "0.02 N, 40 N"), frequency="30 kHz", cycles="3")
    result = gp.Scene.from_text(text).run(tmp_path / "out", figures=False)
    velocity = result.dataset.pulse_velocity.values[:, 0]
    assert np.isnan(velocity[0])
    assert np.isfinite(velocity[1])
    (told,) = [text for text in result.warnings if "arrival of the pulse" in text]
    assert "force = 0.02 N" in told
    assert "above the top" in told
    assert not result.failures
    assert result.summary()["pulse_velocity"] == [velocity[1], velocity[1]]


def test_loads_at_which_no_pulse_is_read_have_no_velocity():
    text = HEAD.replace(", samples: 2", "").replace("2 N, 40 N", "39 N, 40 N")
    data = gp.Scene.from_text(_with_pulse(text, frequency="100 kHz")).sweep()
    assert not {"pulse_velocity", "pulse_velocity_error", "time_of_flight"} & set(data)


def test_mean_of_samples_leaves_out_those_that_cannot_be_read():
    from granphon.runs.wave_records import average_waves
    from granphon.waves.settings import PulseSettings, WaveSettings

    def record(velocity, note="", fraction=0.5):
        numbers = {
            "pulse_velocity": velocity,
            "time_of_flight": 1.0 / velocity,
            "coherent_fraction": fraction,
        }
        return {name: np.array(one) for name, one in numbers.items()} | {
            "pulse_note": note,
            "pulse_echo": "",
        }

    wanted = WaveSettings(pulse=PulseSettings(1e3))
    unread = record(np.nan, "too late", fraction=0.2)
    found, notes = average_waves([record(3.0), unread, record(5.0)], wanted)
    assert (float(found["pulse_velocity"]), float(found["pulse_velocity_error"])) == pytest.approx(
        (4.0, 1.0)
    )
    assert float(found["coherent_fraction"]) == pytest.approx(0.4)  # a pulse was heard in all
    (note,) = notes
    assert " 1 of 3 samples" in note
    assert "velocity" in note
    assert note.endswith("too late")


def test_array_too_large_for_the_memory_is_refused_with_an_estimate(memory, monkeypatch):
    shape = "[3000, 3000], geometry: lattice"
    text = ALL.replace("[4, 18]", shape).replace("points: 3", "points: 5")
    scene = gp.Scene.from_text(text)
    # 27 million contacts
    memory(1e12)  # whatever this machine has
    cost = scene.cost()
    assert "waves in 9,000,000 balls" in cost.text
    waves = next(work for *_, work in scene.plan.parts if "waves" in "".join(work.parts))
    assert waves.memory > 1.5e10  # of the waves alone: those of the balls are found before
    memory(1.2e10)
    with pytest.raises(gp.GranphonError, match=r"GB.*memory"):
        scene.cost()
    few = dataclasses.replace(scene, observe=("dos",))
    monkeypatch.undo()

    def count(scene):
        """Products with a vector times balls."""
        waves = next(work for *_, work in scene.plan.parts if "waves" in "".join(work.parts))
        return sum(units.number for units in waves.units)

    # spectra and pulses, at two loads and in two samples
    assert count(scene) > 3.0 * count(few)
    once = gp.Scene.from_text(
        text.replace("[2 N, 40 N]", "40 N").replace("[dos, spectrum, pulse]", "[dos]")
    )
    assert count(few) == pytest.approx(2.0 * count(once), rel=0.01)
