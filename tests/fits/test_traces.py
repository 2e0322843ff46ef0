"""Velocities and transfer functions from traces of sensors."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.signal import lfilter

import granphon as gp
from granphon.base.errors import InputError
from granphon.cli.main import main

VELOCITY = 500.0
STEP = 1e-6
N_TIMES = 1500


def make_traces(
    seed: int,
    noise: float = 0.01,
    places: tuple[float, ...] = (0.0, 0.2),
    signs: tuple[float, ...] | None = None,
) -> gp.Traces:
    """Traces of half a wave that travels at 500 m/s, with white noise."""
    rng = np.random.default_rng(seed)
    times = STEP * np.arange(N_TIMES)
    rows = []
    for place, sign in zip(places, signs or (1.0,) * len(places), strict=True):
        phase = np.clip((times - 4e-4 - place / VELOCITY) * 5e3, 0.0, 1.0)
        rows.append(sign * np.sin(np.pi * phase) ** 2)
    signals = np.array(rows)
    return gp.Traces(times, signals + noise * rng.standard_normal(signals.shape), places)


METHODS = {
    "threshold": {},
    "peak": {},
    "correlation": {},
    "phase": {"frequency": 4e3},
}


@pytest.mark.parametrize("method", METHODS)
def test_without_noise_the_velocity_is_that_of_the_pulse(method: str) -> None:
    found = make_traces(0, noise=0.0).velocity(method, **METHODS[method])
    assert found.velocity == pytest.approx(VELOCITY, rel=1e-4)
    assert found.stderr < 1e-6 * VELOCITY


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("periods", [-0.5, 0.5, 7.25])
def test_the_time_at_which_a_record_begins_does_not_count(method: str, periods: float) -> None:
    """Half a period of the phase before the trigger moves no sensor by a period."""
    places = (0.0, 0.1, 0.2, 0.3)
    traces = make_traces(3, 0.01, places)
    start = periods / METHODS["phase"]["frequency"]
    later = gp.Traces(traces.times + start, traces.signals, traces.distances)
    options = METHODS[method]
    found, moved = (one.velocity(method, **options) for one in (traces, later))
    assert moved.velocity == pytest.approx(found.velocity, rel=1e-9)
    assert moved.chi2 == pytest.approx(found.chi2, rel=1e-6)
    delay = 0.0 if method == "correlation" else start
    np.testing.assert_allclose(moved.arrivals, found.arrivals + delay, atol=1e-12)


def find_pulls(method: str, n_draws: int, noise: float, places: tuple[float, ...]) -> list[float]:
    """Errors of the velocity over its standard error, for several draws of the noise."""
    pulls = []
    for seed in range(n_draws):
        found = make_traces(seed, noise, places).velocity(method, **METHODS[method])
        pulls.append((found.velocity - VELOCITY) / found.stderr)
    return pulls


@pytest.mark.claim("traces-errors")
@pytest.mark.parametrize("method", METHODS)
def test_standard_errors_are_those_of_the_noise(method: str) -> None:
    pulls = find_pulls(method, 40, 0.01, (0.0, 0.2))
    # 40 draws know their own deviation to eleven per cent
    assert np.std(pulls) == pytest.approx(1.0, abs=0.3)


@pytest.mark.claim("traces-errors")
@pytest.mark.slow
@pytest.mark.parametrize("places", [(0.0, 0.2), (0.0, 0.05, 0.2)])
@pytest.mark.parametrize("noise", [0.005, 0.02])
@pytest.mark.parametrize("method", METHODS)
def test_standard_errors_hold_over_many_draws(
    method: str, noise: float, places: tuple[float, ...]
) -> None:
    pulls = find_pulls(method, 200, noise, places)
    # 200 draws know their own deviation to five per cent
    assert np.std(pulls) == pytest.approx(1.0, abs=0.2)
    assert abs(np.mean(pulls)) < 0.25


def test_three_sensors_judge_the_straight_line() -> None:
    found = make_traces(1, places=(0.0, 0.1, 0.25)).velocity()
    assert found.dof == 1
    assert found.p > 1e-3
    assert not found.warnings
    wrong = make_traces(1, places=(0.0, 0.1, 0.25))
    moved = gp.Traces(wrong.times, wrong.signals, (0.0, 0.12, 0.25)).velocity()
    assert moved.p < 1e-3
    assert "scatter" in moved.warnings[0]


# of a phase, a sign is half a period
@pytest.mark.parametrize("method", ["threshold", "peak", "correlation"])
def test_a_sensor_of_the_other_polarity_gives_the_same_velocity(method: str) -> None:
    same = make_traces(3).velocity(method)
    other = make_traces(3, signs=(1.0, -1.0)).velocity(method)
    assert other.velocity == pytest.approx(same.velocity, rel=1e-2)


def test_the_filter_is_named() -> None:
    traces = make_traces(2)
    assert "Hz" in traces.velocity().filter
    assert "12000" in traces.velocity(lowpass=12e3).filter.replace("1.2e+04", "12000")
    assert traces.velocity("correlation", lowpass=None).filter == "none"


def test_a_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    traces = make_traces(4, places=(0.0, 0.2))
    stream = io.StringIO()
    stream.write("time (us),near at 0 mm (V),far at 200 mm (V)\n")
    rows = np.column_stack([traces.times * 1e6, traces.signals.T])
    np.savetxt(stream, rows, delimiter=",", fmt="%.9g")
    (tmp_path / "traces.csv").write_text(stream.getvalue())
    read = gp.Traces.read(tmp_path / "traces.csv")
    assert read.names == ("near", "far")
    np.testing.assert_allclose(read.distances, [0.0, 0.2], rtol=1e-15)
    np.testing.assert_allclose(read.times, traces.times, atol=1e-14)
    np.testing.assert_allclose(read.signals, traces.signals, atol=1e-8)
    assert read.velocity().velocity == pytest.approx(traces.velocity().velocity, rel=1e-6)


def test_several_files_with_a_step_of_time_are_one_record(tmp_path: Path) -> None:
    traces = make_traces(4)
    for name, signal in zip(("near", "far"), traces.signals, strict=True):
        lines = ["Model,A 1", "Sample Interval,1e-6,s", name, *map(repr, signal.tolist())]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines))
    paths = [tmp_path / "near.csv", tmp_path / "far.csv"]
    read = gp.Traces.read(paths, distances={"near": 0.0, "far": 0.2})
    np.testing.assert_allclose(read.times, traces.times, atol=1e-15)
    np.testing.assert_array_equal(read.signals, traces.signals)


def test_hdf5_is_read(tmp_path: Path) -> None:
    traces = make_traces(5)
    with h5py.File(tmp_path / "traces.h5", "w") as file:
        file["signals"] = traces.signals
        file["time"] = traces.times * 1e3
        file["time"].attrs["units"] = "ms"
        file["distance"] = traces.distances * 1e3
        file["distance"].attrs["units"] = "mm"
    read = gp.Traces.read(tmp_path / "traces.h5")
    np.testing.assert_allclose(read.times, traces.times, atol=1e-15)
    np.testing.assert_allclose(read.distances, traces.distances)
    with h5py.File(tmp_path / "traces.h5", "a") as file:
        file["names"] = np.array(["drive", "5 µm"], object)
    assert gp.Traces.read(tmp_path / "traces.h5").names == ("drive", "5 µm")
    with h5py.File(tmp_path / "traces.h5", "a") as file:
        file.attrs["time_step"] = STEP
    with pytest.raises(InputError, match="time_step"):  # times are given twice
        gp.Traces.read(tmp_path / "traces.h5")


def test_one_distance_is_that_of_one_sensor(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "one.h5", "w") as file:
        file["signals"] = make_traces(5).signals[:1]
        file.attrs["time_step"] = STEP
    assert gp.Traces.read(tmp_path / "one.h5", distances=0.04).distances.tolist() == [0.04]
    with pytest.raises(InputError, match="2 distances"):
        gp.Traces.read(tmp_path / "one.h5", distances=[0.0, 0.04])


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("time (us),a at 0 mm\n1,2\n", "16"),
        ("a at 0 mm,b at 40 mm\n1,2\n", "times"),
        ("time (us)\n1\n", "no trace"),
        ("time (kg),a at 0 mm\n1,2\n", "kg"),
        ("# time step: 3 V\na at 0 mm\n1\n", "time step"),
        ("# time step: 1 us\nIncrement,2e-6,s\na at 0 mm\n1\n", "1e-06 s in a line above"),
        ("time (us),a at 0 mm\n1,x\n", "line 2"),
        ("time (us);a at 0 mm\n1;0,5\n", "'0,5'.* point"),
        ("time (us),a at 0 mm,a at 0 mm\n1,2,3\n", "two columns"),
        ("time (us),a,b\n" + "".join(f"{k},{k % 3},{k % 5}\n" for k in range(20)), "'a'"),
    ],
)
def test_a_table_that_cannot_be_read_says_why(tmp_path: Path, text: str, word: str) -> None:
    (tmp_path / "traces.csv").write_text(text)
    with pytest.raises(InputError, match=word):
        gp.Traces.read(tmp_path / "traces.csv")


def test_bad_traces_are_refused() -> None:
    traces = make_traces(6)
    times, signals, places = traces.times, traces.signals, traces.distances
    with pytest.raises(InputError, match="samples"):
        gp.Traces(times[:-1], signals, places)
    with pytest.raises(InputError, match="samples"):
        gp.Traces(times, [signals[0], signals[1][:-1]], places)
    swapped = times.copy()
    swapped[5] = swapped[3]
    with pytest.raises(InputError, match="sample 6"):
        gp.Traces(swapped, signals, places)
    stretched = times.copy()
    stretched[700:] += 10 * STEP
    with pytest.raises(InputError, match="evenly"):
        gp.Traces(stretched, signals, places)
    with pytest.raises(InputError, match="order"):
        gp.Traces(times, signals, places[::-1])
    with pytest.raises(InputError, match="cut off"):
        gp.Traces(times, np.minimum(signals, 0.6), places)
    with pytest.raises(InputError, match="1 distance"):
        gp.Traces(times, signals, [0.0])
    with pytest.raises(InputError, match=rf"shape \(1, {len(places)}\)"):
        gp.Traces(times, signals, [places])


def test_digits_of_an_oscilloscope_are_no_cut() -> None:
    traces = make_traces(7, noise=0.0)
    eight_bits = np.round(traces.signals * 127.0) / 127.0
    gp.Traces(traces.times, eight_bits, traces.distances)


def test_what_gives_no_velocity_is_refused() -> None:
    traces = make_traces(8)
    times, signals, places = traces.times, traces.signals, traces.distances
    rng = np.random.default_rng(0)
    silent = gp.Traces(times, [signals[0], 0.01 * rng.standard_normal(N_TIMES)], places)
    with pytest.raises(InputError, match="sensor 2"):
        silent.velocity()
    with pytest.raises(InputError, match="sensor 2"):
        silent.velocity(quiet=3e-4)
    with pytest.raises(InputError, match="later"):
        gp.Traces(times, signals[::-1], places).velocity()
    with pytest.raises(InputError, match="one trace"):
        gp.Traces(times, signals[:1], places[:1]).velocity()
    with pytest.raises(InputError, match="period"):
        traces.velocity("phase", frequency=4e5)
    with pytest.raises(InputError, match="nothing above its noise"):
        traces.velocity("phase", frequency=6e4)
    with pytest.raises(InputError, match="frequency"):
        traces.velocity("phase")
    with pytest.raises(InputError, match="noise"):
        traces.velocity(threshold=0.01)
    with pytest.raises(InputError, match="correlation"):
        traces.velocity("corelation")
    with pytest.raises(InputError, match="quiet"):
        traces.velocity(quiet="early")
    with pytest.raises(InputError, match="later quiet"):
        traces.velocity(quiet=float(times[1]))
    # too high, too low for the record, and no number
    for lowpass in (6e5, 1.0, 1e-300, np.array([1e4, 2e4])):
        with pytest.raises(InputError, match="lowpass"):
            traces.velocity(lowpass=lowpass)
    with pytest.raises(InputError, match="method 'peak'"):
        traces.velocity("peak", threshold=0.2)
    with pytest.raises(InputError, match="method 'threshold'"):
        traces.velocity(frequency=4e3)


def test_a_record_that_ends_before_the_pulse_is_refused() -> None:
    """Of each part of the rise; a record that ends behind the top is taken."""
    whole = make_traces(11)
    top = int(np.argmax(whole.signals[1]))
    for share in (0.3, 0.6, 0.9, 0.97):
        n = int(top - (1.0 - share) * 100e-6 / STEP)
        cut = gp.Traces(whole.times[:n], whole.signals[:, :n], whole.distances)
        for method in ("threshold", "peak", "correlation"):
            with pytest.raises(InputError, match=r"at its end|no quiet|no pulse"):
                cut.velocity(method)
    n = int(top + 60e-6 / STEP)
    cut = gp.Traces(whole.times[:n], whole.signals[:, :n], whole.distances)
    assert cut.velocity("threshold").velocity == pytest.approx(VELOCITY, rel=0.02)


@pytest.mark.parametrize("unit", [1e-300, 1e-12, 1e300])
def test_the_unit_of_a_trace_does_not_count(unit: float) -> None:
    traces = make_traces(12)
    scaled = gp.Traces(traces.times, unit * traces.signals, traces.distances)
    same = traces.velocity()
    found = scaled.velocity()
    assert found.velocity == pytest.approx(same.velocity, rel=1e-9)
    assert found.stderr == pytest.approx(same.stderr, rel=1e-9)


def test_traces_without_a_signal_are_refused() -> None:
    traces = make_traces(13)
    for still in (0.0, 0.3):
        signals = [traces.signals[0], np.full(N_TIMES, still)]
        with pytest.raises(InputError, match="does not change"):
            gp.Traces(traces.times, signals, traces.distances).velocity()


@pytest.mark.parametrize(
    ("name", "data", "word"),
    [
        ("signals", np.array([b"a", b"b"]), "signals"),
        ("time_step", "fast", "time_step"),
        ("time_step", -1.0, "above zero"),
    ],
)
def test_hdf5_that_cannot_be_read_says_why(tmp_path: Path, name: str, data: Any, word: str) -> None:
    path = tmp_path / "traces.h5"
    with h5py.File(path, "w") as file:
        file["signals"] = data if name == "signals" else make_traces(14).signals
        file.attrs["time_step"] = data if name == "time_step" else STEP
    with pytest.raises(InputError, match=word):
        gp.Traces.read(path)


@pytest.mark.parametrize(
    ("name", "data"),
    [("time_step", [STEP, STEP]), ("names", np.array([b"\xb5", b"b"]))],
)
def test_messages_on_hdf5_name_the_file(tmp_path: Path, name: str, data: Any) -> None:
    path = tmp_path / "traces.h5"
    with h5py.File(path, "w") as file:
        file["signals"] = make_traces(14).signals[:2]
        if name == "names":
            file["names"] = data
            file.attrs["time_step"] = STEP
        else:
            file.attrs[name] = data
    with pytest.raises(InputError, match=f"traces.h5: {name}"):
        gp.Traces.read(path, distances=[0.0, 0.04])


def test_the_command_prints_and_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    traces = make_traces(9)
    rows = np.column_stack([traces.times * 1e6, traces.signals.T])
    head = "time (us),1 at 0 mm (V),2 at 20 cm (V)"
    np.savetxt("traces.csv", rows, delimiter=",", header=head, comments="")
    assert main(["velocity", "traces.csv"]) == 0
    printed = capsys.readouterr().out
    found = gp.Traces.read("traces.csv").velocity()
    assert f"{found.velocity:.1f}"[:4] in printed
    assert Path("velocity.png").stat().st_size > 1000
    # what may not be written is told before anything is read
    assert main(["velocity", "none.csv"]) == 1
    assert "already holds velocity.png" in capsys.readouterr().err
    assert main(["velocity", "traces.csv", "--lowpass", "6 MHz", "--force"]) == 2
    assert "lowpass" in capsys.readouterr().err
    # two distances with errors make a relative error of their difference
    places = "0 +- 4 mm, 20 +- 0.3 cm"
    assert main(["velocity", "traces.csv", "--distances", places, "--force"]) == 0
    told = re.search(r"velocity +([0-9.]+) \+/- ([0-9.]+) (k?)m/s", capsys.readouterr().out)
    expected = math.hypot(5.0 / 200.0, found.stderr / found.velocity)
    assert float(told[2]) / float(told[1]) == pytest.approx(expected, rel=0.05)
    assert main(["velocity", "traces.csv", "--time-step", "1 +- 0.1 us", "--force"]) == 2
    assert "standard error" in capsys.readouterr().err


@pytest.mark.claim("traces-transfer")
def test_welch_finds_a_filter_within_its_errors() -> None:
    rng = np.random.default_rng(10)
    n, step = 32768, 1e-5
    drive = rng.standard_normal(n)
    response = lfilter([0.2], [1.0, -1.2, 0.6], drive) + 0.3 * rng.standard_normal(n)
    times = step * np.arange(n)
    measured = gp.TransferFunction.from_traces(
        gp.Traces(times, drive, 0.0), gp.Traces(times, response, 0.0), segment=512 * step
    )
    z = np.exp(-2j * np.pi * measured.frequencies * step)
    exact = 0.2 / (1.0 - 1.2 * z + 0.6 * z**2)
    assert measured.phase is not None
    magnitude_pulls = (measured.magnitude - np.abs(exact)) / measured.sigma
    turns = np.angle(np.exp(1j * (measured.phase - np.angle(exact))))
    assert np.std(magnitude_pulls) == pytest.approx(1.0, abs=0.2)
    assert np.std(turns / measured.phase_sigma) == pytest.approx(1.0, abs=0.2)
    assert abs(np.mean(magnitude_pulls)) < 0.3


def test_the_edges_of_a_band_belong_to_it() -> None:
    drive = np.random.default_rng(12).standard_normal(4096)
    times = 1e-5 * np.arange(4096)
    pair = gp.Traces(times, drive, 0.0), gp.Traces(times, np.roll(drive, 2), 0.0)
    all_frequencies = gp.TransferFunction.from_traces(*pair).frequencies
    low, high = all_frequencies[[5, 9]].tolist()
    measured = gp.TransferFunction.from_traces(*pair, band=(low, high))
    np.testing.assert_array_equal(measured.frequencies, all_frequencies[5:10])


def test_what_gives_no_transfer_function_is_refused() -> None:
    rng = np.random.default_rng(11)
    times = 1e-5 * np.arange(4096)
    drive = gp.Traces(times, rng.standard_normal(4096), 0.0)
    response = gp.Traces(times, rng.standard_normal(4096), 0.0)
    for segment in (1e-5, 1.0, 1e305):
        with pytest.raises(InputError, match="segment"):
            gp.TransferFunction.from_traces(drive, response, segment=segment)
    for band in ((1e3, 1e3), (2e3, 1e3), (-1.0, 1e3), (1e3,), "a"):
        with pytest.raises(InputError, match="band"):
            gp.TransferFunction.from_traces(drive, response, band=band)
    for band in ((0.0, 100.0), (1e3, 1.01e3), (1e6, 1e7)):  # between and beyond the frequencies
        with pytest.raises(InputError, match="holds no frequency"):
            gp.TransferFunction.from_traces(drive, response, band=band)
    with pytest.raises(InputError, match="connects"):  # noise, at any frequency
        gp.TransferFunction.from_traces(drive, response)
    with pytest.raises(InputError, match="Traces"):
        gp.TransferFunction.from_traces(drive.signals, response)
    silent = gp.Traces(times, np.zeros(4096), 0.0)
    for pair, word in (((silent, response), "drive"), ((drive, silent), "response")):
        with pytest.raises(InputError, match=word):
            gp.TransferFunction.from_traces(*pair)
    later = gp.Traces(times + 1.0, response.signals[0], 0.0)
    with pytest.raises(InputError, match="times"):
        gp.TransferFunction.from_traces(drive, later)


def test_a_fit_takes_traces(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    traces = make_traces(12)
    rows = np.column_stack([traces.times * 1e6, traces.signals.T])
    data = tmp_path / "traces.csv"
    np.savetxt(data, rows, delimiter=",", header="time (us),a at 0 mm,b at 20 cm", comments="")
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
        "packing: {lattice: triangular, diameter: 8 mm, spread: {uniform: 2 um}}\n"
        "load: {force: 2 N}\nmedium: ema\n"
    )
    words = ["fit", str(scene), str(data)]
    assert main(words) == 0
    from_traces = capsys.readouterr().out
    found = gp.Traces.read(data).velocity()
    table = tmp_path / "velocity.csv"
    table.write_text(
        f"force (N),velocity (m/s),sigma (m/s)\n2,{found.velocity!r},{found.stderr!r}\n"
    )
    assert main(["fit", str(scene), str(table)]) == 0
    assert capsys.readouterr().out == from_traces
    scene.write_text(scene.read_text().replace("2 N", "[2 N, 3 N]"))
    assert main(words) == 2
    assert "loads" in capsys.readouterr().err
    assert main([*words, "--sigma", "5 m/s"]) == 2
    assert "--sigma" in capsys.readouterr().err


def test_arguments_of_another_kind_are_named():
    times = 1e-6 * np.arange(100)
    traces = gp.Traces(times, np.sin(1e5 * times), 0.0)
    with pytest.raises(InputError, match="method"):
        traces.velocity(5)
    with pytest.raises(InputError, match="names"):
        gp.Traces(times, np.sin(1e5 * times), 0.0, 5)
    for path in (5, None, [5]):
        with pytest.raises(InputError, match="path"):
            gp.Traces.read(path)
