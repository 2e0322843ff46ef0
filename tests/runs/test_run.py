"""Scenes of many states, carried out: the data set, the files, workers, interruptions."""

import errno
import json
import math
import multiprocessing
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import BrokenExecutor
from pathlib import Path

import ase.io
import numpy as np
import pytest
import xarray as xr
import yaml
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.base.errors import FileExistsInRunError, InputError
from granphon.base.staging import LIST, LOCK, ResultFiles
from granphon.cli.main import main
from granphon.cli.terminal import warn, write_uncertain
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.runs.dataset import load_sweep
from granphon.runs.finished_tasks import read_entries
from granphon.runs.sweep import sweep
from granphon.runs.workers import Workers
from granphon.scene.outputs import every_file, expected_files
from granphon.scene.scene import WORK_FILE, RunResult, Scene, is_complete
from tests.conftest import one_error, only
from tests.runs.calls import end_within_a_result, raise_unpicklable
from tests.runs.conftest import full_disk
from tests.waiting import HANGS, wait_for

SWEEP = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 2.04 um}}
load: {force: {from: 2 N, to: 20 N, points: 3}}
medium: [ala, afa, ema]
sweep: {width: [1 um, 2 um]}
"""
ONE = (
    SWEEP.replace("{from: 2 N, to: 20 N, points: 3}", "3 N")
    .replace("[ala, afa, ema]", "ema")
    .replace("sweep", "# sweep")
)
NUMBERS = {"scene.yaml", "summary.yaml", "sweep.nc", "sweep.csv"}
ALL = NUMBERS | {"sweep.png"}


@pytest.fixture
def work(chdir: Path) -> Path:
    """An empty working folder with a scene in it."""
    (chdir / "scene.yaml").write_text(SWEEP, encoding="utf-8")
    return chdir


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of that scene, carried out in one go."""
    folder = tmp_path_factory.mktemp("whole")
    Scene.from_text(SWEEP).run(folder / "out")
    assert listed(folder / "out") == ALL
    assert (folder / "out" / "sweep.png").read_bytes().startswith(b"\x89PNG")
    return folder / "out"


def summary(folder: str) -> dict:
    return yaml.safe_load((Path(folder) / "summary.yaml").read_text())


def listed(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} - {LIST, LOCK}


def count_parts(folder: Path) -> int:
    """The number of results in the store of a folder."""
    return len(dict(read_entries(folder / WORK_FILE))) if (folder / WORK_FILE).exists() else 0


def interrupted_after(
    count: int, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> list[str]:
    """Let the step after ``count`` others fail; the names of the tasks of those that were begun."""
    from granphon.runs.tasks import MediumTask, SampleTask

    begun: list[str] = []

    def counted(solve):
        def solved(task, before=None):
            begun.append(task.where)
            if len(begun) > count:
                raise error
            return solve(task, before)

        return solved

    for kind in (MediumTask, SampleTask):
        monkeypatch.setattr(kind, "solve", counted(kind.solve))
    return begun


# -- one state -------------------------------------------------------------------------------------


def test_balls_that_differ_have_a_summary_of_their_own(work, capsys):
    text = ONE.replace("medium: ema", "medium: {ema: {local_field: paper}}")
    (work / "scene.yaml").write_text(text)
    assert main(["run", "scene.yaml", "-o", "out", "-q"]) == 0
    medium = gp.EffectiveMedium(Scene.from_text(text).packing, local_field="paper")
    state = medium.at_force(3.0)
    got = summary("out")
    for name in state.units:
        assert got[name] == getattr(state, name)
    assert (got["medium"], got["regime"], got["valid"]) == (
        "ema(local_field=paper)",
        "intermediate",
        True,
    )
    assert got["exponent"] == gp.local_exponent(state)
    assert got["width"] == 2.04e-6
    assert got["local_field"] == {
        name: getattr(medium.local_field, name) for name in ("alpha", "beta", "xi")
    }
    assert got["longitudinal"] == gp.sound_velocities(state).longitudinal
    assert capsys.readouterr() == ("", "")
    for other in (ONE.replace("2.04 um", "0 um"), ONE.replace("medium: ema", "medium: afa")):
        assert "local_field" not in Scene.from_text(other).run("out", force=True).summary()


def test_a_load_below_the_range_of_the_medium_is_a_warning(work, capsys):
    (work / "scene.yaml").write_text(ONE.replace("3 N", "1 N"))
    assert main(["check", "scene.yaml"]) == 0
    told = capsys.readouterr().err
    assert told.startswith("granphon: warning: ema ")
    assert "1.592 N" in told
    assert told.count("\n") == 1
    assert main(["run", "scene.yaml", "-o", "out"]) == 0
    assert capsys.readouterr().err == told
    got = summary("out")
    assert (got["valid"], got["ok"]) == (False, False)
    assert [check["name"] for check in got["validity"] if not check["ok"]] == ["medium"]
    assert got["warnings"] == [told.removeprefix("granphon: warning: ").strip()]


# -- simulations -----------------------------------------------------------------------------------

SAMPLES = ONE.replace("medium: ema", "medium: {simulation: {shape: 4 4, samples: 2}}")
SIMULATED = ONE.replace("medium: ema", "medium: {simulation: {shape: 16 16, seed: 4, samples: 3}}")


@pytest.mark.parametrize(
    ("kind", "value", "figures"),
    [
        ("overlap", "0.4 um", []),
        pytest.param("force", "3 N", ["forces.png"], marks=pytest.mark.slow),
        pytest.param("pressure", "600 N/m", ["forces.png"], marks=pytest.mark.slow),
    ],
)
def test_a_simulation_has_a_summary_a_sample_and_a_figure(
    work, capsys, monkeypatch, kind, value, figures
):
    # on a busy machine the time that is measured may be long enough to be announced
    monkeypatch.setattr("granphon.media.cost.time_once", lambda _: 1e-4)
    text = SIMULATED.replace("force: 3 N", f"{kind}: {value}")
    text = text.replace("16 16", "8 8").replace("samples: 3", "samples: 2")
    (work / "scene.yaml").write_text(text)
    words = [] if figures else ["--no-figures"]
    assert main(["run", "scene.yaml", "-o", "out", *words]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert listed(work / "out") == {*NUMBERS, "sample.extxyz", *figures}
    assert set(expected_files(Scene.from_text(text))) == listed(work / "out") | {"forces.png"}
    scene = Scene.from_yaml("out/scene.yaml")
    assert scene == Scene.from_text(text)
    medium = gp.DirectSimulation(scene.packing, (8, 8), seed=4, samples=2)
    state = getattr(medium, f"at_{kind}")(scene.load.values[0])
    got = summary("out")
    velocities = gp.sound_velocities(state)
    constants = gp.moduli(state)
    expected = {
        name: value
        for name in (*state.units, "regime")
        if (value := getattr(state, name)) is not None
    }
    for name in ("longitudinal", "transverse"):
        expected |= {
            name: getattr(velocities, name),
            f"{name}_error": getattr(velocities, f"{name}_error"),
        }
        assert write_uncertain(expected[name], expected[f"{name}_error"], "m/s") in out
    for name in ("bulk", "shear"):
        expected |= {
            name: getattr(constants, name),
            f"{name}_error": getattr(constants, f"{name}_error"),
        }
    found, given = ("force", "overlap") if kind == "overlap" else ("overlap", "force")
    expected |= {
        f"{found}_error": state.standard_error(found),
        "exponent": gp.local_exponent(state),
    }
    expected["exponent_error"] = state.exponent_error
    # the load is the one that was given; the state has it but for rounding
    assert expected[kind] == pytest.approx(scene.load.values[0], rel=1e-13)
    expected[kind] = scene.load.values[0]
    assert {name: got[name] for name in expected} == expected
    assert f"{given}_error" not in got
    assert "contact_force_fluctuation" in got
    assert set(got["units"]) >= set(expected) - {"regime"}
    assert got["medium"] == "simulation(samples=2, seed=4, shape=8 8)"
    assert (got["ok"], got["warnings"]) == (True, [])
    assert "ase" in got["versions"]
    for name in figures:
        assert (work / "out" / name).read_bytes().startswith(b"\x89PNG")
    # the sample is read by ASE
    atoms = ase.io.read("out/sample.extxyz")
    sample = state.sample
    d = scene.packing.diameter
    assert (sample.seed, len(atoms), atoms.pbc.tolist()) == (4, 64, [True, True, False])
    np.testing.assert_allclose(
        2.0 * d * atoms.get_array("radius"), sample.diameters.ravel(), atol=1e-14 * d
    )
    np.testing.assert_array_equal(atoms.positions, sample.atoms().positions)
    assert atoms.info["granphon_length_m"] == d
    assert np.mean(atoms.get_array("contact_force")) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("drawn", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_spectra_of_a_simulation_say_what_they_are(work, capsys, drawn):
    text = SAMPLES + "observe: [bands, dos]\nphonopy: {band_points: 3, mesh: 4 4 1}\n"
    (work / "scene.yaml").write_text(text)
    assert main(["run", "scene.yaml", "-o", "out", "-q", "--no-figures"]) == 0
    (warning,) = summary("out")["warnings"]
    assert "regular lattice" in warning
    assert "sample_dos" in warning
    assert warning in capsys.readouterr().err
    assert "longitudinal" not in summary("out")
    state = Scene.from_text(text).state()
    result = gp.Bands.read("out/band.yaml")
    expected = gp.Phonons(state).bands("GKMG", npoints=3).frequencies
    np.testing.assert_allclose(result.frequencies, expected, atol=1e-8 * expected.max())
    if drawn:  # the long waves of the scene, without simulating it
        assert main(["plot", "out", "--asymptotes", "--force"]) == 0


def test_without_friction_or_of_one_sample_there_is_no_error(work):
    text = SIMULATED.replace(", samples: 3", "").replace("8 mm,", "8 mm, friction: false,")
    result = Scene.from_text(text).run("out", figures=False)
    assert [name for name in result.summary() if name.endswith("_error")] == ["exponent_error"]
    # but for one that is said not to be known
    assert math.isnan(result.summary()["exponent_error"])
    (warning,) = result.warnings
    assert "exponent" in warning
    assert "nan" in warning
    assert math.isnan(summary("out")["exponent_error"])
    equal = Scene.from_text(text.replace(", spread: {uniform: 2.04 um}", "")).run(
        "equal", figures=False
    )
    assert (equal.summary()["exponent_error"], equal.warnings) == (0.0, ())
    assert result.summary()["contact_force_fluctuation"] > result.summary()["force_fluctuation"]


def test_check_says_what_a_simulation_will_take(work, capsys, monkeypatch):
    # the time is measured twice, and might be other words on a busy machine
    monkeypatch.setattr("granphon.media.cost.time_once", lambda _: 1e-2)
    many = (
        SIMULATED.replace("3 N", "[3 N, 1 N]")
        .replace("medium: {", "medium: [ema, {")
        .replace("3}}", "3}}]")
    )
    for text, count in (
        (SIMULATED, 9),
        (many, 18),
    ):
        # three samples at each load, each with two equilibria more for the exponent
        (work / "scene.yaml").write_text(text)
        cost = Scene.from_text(text).cost()
        assert cost.equilibria == count
        assert main(["check", "scene.yaml"]) == 0
        out, err = capsys.readouterr()
        assert re.search(rf"  will take +{re.escape(cost.text)} on one processor\n", out)
        sizes = rf"simulation of 256 balls, {count} equilibria: about \d+ MB and "
        assert re.search(sizes, out)
    # of the medium that is solved in a moment, limits are told
    assert err.startswith("granphon: warning: ema ")
    assert err.count("\n") == 1


def test_a_long_simulation_is_announced(work, capsys, monkeypatch):
    text = SIMULATED.replace("16 16", "1000 1000")
    (work / "scene.yaml").write_text(text)
    monkeypatch.setattr("granphon.media.cost._measure_ball", lambda *_: 1e-4)  # a slow machine
    interrupted_after(0, monkeypatch, KeyboardInterrupt())
    for quiet in ([], ["-q"]):
        assert main(["run", "scene.yaml", "-o", "out", *quiet]) == 130
        *told, last = capsys.readouterr().err.splitlines()
        assert last.startswith("granphon: error: interrupted")
        assert told == (
            [] if quiet else [f"granphon: {Scene.from_text(text).cost().text} on one processor"]
        )


SAMPLED = SIMULATED.replace("3 N", "[9 N, 5 N]")


@pytest.mark.slow
def test_samples_of_a_sweep_are_shared_by_workers(work):
    (work / "scene.yaml").write_text(SAMPLED.replace("16 16", "8 8"))
    run = ["run", "scene.yaml", "-q", "--no-figures", "-o"]
    assert main([*run, "one"]) == 0
    assert main([*run, "two", "--workers", "2"]) == 0
    assert load_sweep("one/sweep.nc").identical(load_sweep("two/sweep.nc"))
    assert (work / "one" / "sweep.csv").read_text() == (work / "two" / "sweep.csv").read_text()


FEW_SAMPLED = SAMPLED.replace("16 16", "2 4").replace("samples: 3", "samples: 2")


@pytest.fixture(scope="module")
def few_sampled() -> xr.Dataset:
    """The sweep of few samples, carried out in one go."""
    return Scene.from_text(FEW_SAMPLED).sweep()


def test_a_sweep_goes_on_in_the_midst_of_a_sample(work, few_sampled, monkeypatch, capsys):
    (work / "scene.yaml").write_text(FEW_SAMPLED)
    run = ["run", "scene.yaml", "-q", "--no-figures", "-o", "out"]
    with monkeypatch.context() as patch:
        begun = interrupted_after(1, patch, KeyboardInterrupt())
        assert main(run) == 130
    sample = "simulation(samples=2, seed=4, shape=2 4), seed "
    assert begun == [f"{sample}{seed}" for seed in (4, 4)]
    assert "kept" in one_error(capsys)
    with monkeypatch.context() as patch:
        begun = interrupted_after(99, patch, KeyboardInterrupt())
        assert main(run) == 0
    assert begun == [f"{sample}{seed}" for seed in (4, 5, 5)]
    assert load_sweep("out/sweep.nc").identical(few_sampled)
    head = (work / "out" / "sweep.csv").read_text().splitlines()[0]
    assert "longitudinal_error (m/s)" in head


# -- many ------------------------------------------------------------------------------------------


def test_a_sweep_is_the_data_set_of_the_library(work, capsys):
    assert main(["run", "scene.yaml", "-o", "new/out", "--no-figures"]) == 0
    out, err = capsys.readouterr()
    assert "18" in out
    assert "sweep.csv into new/out" in out
    assert listed(work / "new" / "out") == NUMBERS
    scene = Scene.from_yaml("scene.yaml")
    assert Scene.from_yaml("new/out/scene.yaml") == scene
    saved = load_sweep("new/out/sweep.nc")
    force = np.geomspace(2.0, 20.0, 3)
    direct = sweep(scene.packing, force=force, media=("ala", "afa", "ema"), width=[1e-6, 2e-6])
    assert saved.identical(direct)
    for width, packing in ((1e-6, gp.Uniform(1e-6)), (2e-6, gp.Uniform(2e-6))):
        state = gp.EffectiveMedium(gp.Packing(scene.packing.material, 8e-3, packing)).at_force(
            force
        )
        one = saved.sel(medium="ema", width=width)
        np.testing.assert_array_equal(one["longitudinal"], gp.sound_velocities(state).longitudinal)
    got = summary("new/out")
    assert got["sizes"] == {"load": 3, "medium": 3, "width": 2}
    assert (got["states"], got["medium"]) == (18, ["ala", "afa", "ema"])
    assert got["force"] == [2.0, 20.0]
    assert got["longitudinal"] == [
        float(direct["longitudinal"].min()),
        float(direct["longitudinal"].max()),
    ]
    assert got["units"]["longitudinal"] == "m/s"
    assert got["valid"] is False
    told = [f"granphon: warning: {text}" for text in got["warnings"]]
    assert err.splitlines() == told
    assert re.search(r"ala .* of 6 states .*width 2 um", told[0])
    assert set(got["versions"]) == {"granphon", "numpy", "scipy", "xarray", "h5netcdf"}


def result_material(result: RunResult) -> gp.Material:
    return gp.Material(
        **{
            k: v
            for k, v in json.loads(result.dataset.attrs["packing"])["material"].items()
            if k != "class"
        }
    )


def test_a_parameter_with_one_value_makes_a_sweep_of_one(work):
    text = SWEEP.replace("[1 um, 2 um]", "[2 um]").replace(
        "{from: 2 N, to: 20 N, points: 3}", "3 N"
    )
    text = text.replace("[ala, afa, ema]", "ema")
    result = Scene.from_text(text).run("out", figures=False)
    assert listed(work / "out") == NUMBERS
    assert result.dataset["longitudinal"].shape == (1, 1, 1)
    assert result.summary()["sizes"] == {"load": 1, "medium": 1, "width": 1}
    with pytest.raises(InputError, match=r"sweep.*dataset"):
        _ = result.state


def test_finite_overlap_and_bands_reach_a_sweep(work):
    text = SWEEP.replace("{uniform: 2.04 um}", "{uniform: 2.04 um}, finite_overlap: true").replace(
        "points: 3", "points: 2"
    )
    text += (
        "observe: [velocities, bands]\nphonopy: {band: 0 0 0 1/3 1/3 0, band_labels: Gamma K,"
        " band_points: 3}\n"
    )
    result = Scene.from_text(text).run("out", figures=False)
    packing = gp.Packing(result_material(result), 8e-3, gp.Uniform(2e-6))
    state = gp.EffectiveMedium(packing).at_force(20.0, finite_overlap=True)
    expected = gp.Phonons(state).frequencies([[0, 0, 0], [1 / 6, 1 / 6, 0], [1 / 3, 1 / 3, 0]])
    got = result.dataset["frequencies"].sel(medium="ema", width=2e-6).isel(load=1, segment=0)
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-9)
    assert result.dataset["labels"].values.tolist() == ["Gamma", "K"]
    # the path was given in numbers, and the frequencies are those of C(q)
    assert set(summary("out")["versions"]) == {"granphon", "numpy", "scipy", "xarray", "h5netcdf"}
    assert set(json.loads(result.dataset.attrs["versions"])) == set(summary("out")["versions"])


@pytest.mark.parametrize("medium", only(["ala"], ["ala", "{simulation: {shape: [4, 4]}}"]))
def test_bands_of_one_state_are_found_once_for_both_of_its_files(work, monkeypatch, medium):
    wave_vectors = Counter()
    for name in ("modes", "frequencies"):
        solve = getattr(ContactLattice, name)

        def counted(lattice, q, *rest, _name=name, _solve=solve, **named):
            wave_vectors[_name] += len(q)
            return _solve(lattice, q, *rest, **named)

        monkeypatch.setattr(ContactLattice, name, counted)
    text = SWEEP[: SWEEP.index("medium:")].replace("{from: 2 N, to: 20 N, points: 3}", "3 N")
    text += f"medium: {medium}\nobserve: [bands]\nphonopy: {{band_points: 101}}\n"
    result = Scene.from_text(text).run("out", figures=False)
    assert wave_vectors["modes"] == 3 * 101
    assert wave_vectors["frequencies"] < 3 * 101  # those of the limits of the model
    assert_array_equal(result.dataset["frequencies"][0, 0], result.bands.frequencies)
    assert_allclose(
        RunResult(work / "out", result.scene).bands.frequencies, result.bands.frequencies, rtol=1e-9
    )


def test_a_sweep_over_two_parameters_has_a_figure_of_both(work):
    text = SWEEP.replace("sweep: {", "sweep: {friction: [true, false], ")
    result = Scene.from_text(text).run("out", figures=False)
    texts = [text.get_text() for text in gp.plot(result).legends[0].get_texts()]
    assert (
        sum("W = 1 µm" in text for text in texts)
        == sum("without friction" in text for text in texts)
        == 2
    )
    # at one load the parameter in numbers is the axis
    one = result.dataset.isel(load=[0], medium=[0])
    (above, *_) = gp.plot(one).axes
    width = max((line.get_xdata() for line in above.lines), key=len)
    np.testing.assert_allclose(width, one["width"].values, rtol=1e-12)


def test_many_measured_diameters_are_kept_with_the_result(work):
    rows = [7.999, 8.000, 8.001] * 400
    (work / "balls.csv").write_text("size (mm)\n" + "".join(f"{row}\n" for row in rows))
    text = ONE.replace("{uniform: 2.04 um}", "{measured: balls.csv}").replace(
        "medium: ema", "medium: afa"
    )
    (work / "scene.yaml").write_text(text)
    scene = Scene.from_yaml("scene.yaml")
    assert expected_files(scene) == (
        "scene.yaml",
        "summary.yaml",
        "diameters.csv",
        "sweep.nc",
        "sweep.csv",
    )
    result = scene.run("out")
    assert listed(work / "out") == {*NUMBERS, "diameters.csv"}
    assert Scene.from_yaml("out/scene.yaml") == scene
    assert Scene.from_yaml("out/scene.yaml").run("again").state == result.state
    # a later result without it removes it
    Scene.from_text(ONE).run("out", force=True)
    assert listed(work / "out") == NUMBERS


def measured_scene(folder: Path) -> bytes:
    """A scene in its own result folder, with a table that has the name of a result file."""
    rows = [7.999, 8.000, 8.001] * 400
    (folder / "diameters.csv").write_text("size (mm)\n" + "".join(f"{row}\n" for row in rows))
    (folder / "scene.yaml").write_text(
        "# mine\n"
        + ONE.replace("{uniform: 2.04 um}", "{measured: diameters.csv}").replace(
            "medium: ema", "medium: afa"
        )
    )
    return (folder / "scene.yaml").read_bytes() + (folder / "diameters.csv").read_bytes()


def test_force_never_replaces_what_the_run_reads(work, capsys):
    before = measured_scene(work)
    for words in (["-o", "."], ["-o", ".", "--force"], ["-o", str(work), "--force"]):
        assert main(["run", "scene.yaml", *words]) == 1
        assert "is read" in capsys.readouterr().err
    assert (work / "scene.yaml").read_bytes() + (work / "diameters.csv").read_bytes() == before
    assert listed(work) == {"scene.yaml", "diameters.csv"}


def test_a_result_that_is_read_again_is_not_removed_as_old(work):
    measured_scene(work)
    Scene.from_yaml("scene.yaml").run("out")
    (work / "again.yaml").write_text(
        ONE.replace("{uniform: 2.04 um}", "{measured: {file: out/diameters.csv}}")
    )
    again = Scene.from_yaml("again.yaml")
    assert [path.name for path in again.origin.inputs] == ["again.yaml", "diameters.csv"]
    with pytest.raises(FileExistsInRunError, match="is read"):
        again.run("out", force=True)
    swept = Scene.from_text(
        SWEEP.replace("width: [1 um, 2 um]", "spread: [{measured: out/diameters.csv}]")
    )
    assert swept.origin.inputs == (Path("out/diameters.csv"),)


def test_a_folder_has_one_run_at_a_time(work, capsys):
    with ResultFiles("out", ["x"]).open():
        assert main(["run", "scene.yaml", "-o", "out"]) == 1
    assert "writing into out" in capsys.readouterr().err
    assert not (work / "out").exists()
    Scene.from_text(ONE).run("out")
    with ResultFiles(
        "out", [], force=True
    ).open():  # nor is a figure drawn beside a result that is being written
        assert main(["plot", "out", "--force"]) == 1
    assert "writing into out" in capsys.readouterr().err
    # the working folder is named by its path
    (work / "scene.yaml").rename(work / "one.yaml")
    with ResultFiles(".", ["x"]).open():
        assert main(["run", "one.yaml", "-o", "."]) == 1
    assert f"writing into {work.resolve()}" in capsys.readouterr().err
    (work / "summary.yaml").write_text("mine")
    assert main(["run", "one.yaml", "-o", "."]) == 1
    assert f"{work.resolve()} already holds summary.yaml" in capsys.readouterr().err


@pytest.mark.slow
def test_a_figure_that_fails_is_a_warning_and_the_numbers_are_there(work, capsys):
    labels = (
        "observe: [bands]\nphonopy: {band: 0 0 0 1/3 1/3 0, band_labels: [$\\Gama$, K],"
        " band_points: 3}\n"
    )
    (work / "wrong.yaml").write_text(ONE.replace("medium: ema", "medium: afa") + labels)
    assert main(["check", "wrong.yaml"]) == 0
    Scene.from_text(ONE + labels.replace("$\\Gama$", "G")).run("out")
    assert "bands.png" in listed(work / "out")
    capsys.readouterr()
    # nor does the picture of an earlier run stay beside other numbers
    assert main(["run", "wrong.yaml", "-o", "out", "--force"]) == 0
    out, err = capsys.readouterr()
    assert "bands.png" in err
    assert "bands.png" not in out
    assert listed(work / "out") == {*NUMBERS, "band.yaml", "phonopy_params.yaml"}
    written = summary("out")
    assert any("bands.png" in warning for warning in written["warnings"])
    assert set(written["files"]) == listed(work / "out")
    assert main(["plot", "out"]) == 1
    out, err = capsys.readouterr()
    assert err.startswith("granphon: error: bands.png ")
    assert err.count("\n") == 1


FIT = "force (N),velocity (m/s)\n" + "".join(
    f"{f},{v}\n" for f, v in ((2, 460), (4, 550), (9, 668), (18, 772))
)


@pytest.mark.parametrize(
    ("words", "numbers"),
    [
        pytest.param(("run", "scene.yaml", "-o", "out", "-q"), "dos.csv", marks=pytest.mark.slow),
        pytest.param(
            ("fit", "scene.yaml", "data.csv", "-o", "out"), "fit.yaml", marks=pytest.mark.exhaustive
        ),
        pytest.param(
            ("tradeoff", "scene.yaml", "-o", "out", "--budget", "1 s", "-q"),
            "tradeoff.csv",
            marks=pytest.mark.exhaustive,
        ),
    ],
)
def test_settings_that_keep_matplotlib_from_being_imported_leave_the_numbers(work, words, numbers):
    (work / "scene.yaml").write_text(ONE + "observe: [dos]\nphonopy: {mesh: 4 4 1}\n")
    (work / "data.csv").write_text(FIT)
    (work / "rc").write_bytes(b"\xff\xfe\x00")
    environment = os.environ | {"MATPLOTLIBRC": str(work / "rc")}

    def granphon(*words):
        call = [sys.executable, "-m", "granphon", *words]
        return subprocess.run(call, env=environment, capture_output=True, text=True)

    done = granphon(*words)
    assert done.returncode == 0
    (warning,) = [line for line in done.stderr.splitlines() if "drawn" in line]
    assert warning.startswith("granphon: warning: ")
    assert str(work / "rc") in warning
    assert "Traceback" not in done.stderr
    assert (work / "out" / numbers).is_file()
    assert not list((work / "out").glob("*.png"))
    if words[0] == "run":
        done = granphon("plot", "out")
        assert (done.returncode, done.stderr.count("\n")) == (1, 1)
        assert done.stderr.startswith("granphon: error: matplotlib ")


def test_settings_that_keep_matplotlib_from_being_imported_are_named(work):
    (work / "rc").write_bytes(b"\xff\xfe\x00")
    done = subprocess.run(
        [sys.executable, "-c", "import granphon.figures.scales"],
        env=os.environ | {"MATPLOTLIBRC": str(work / "rc")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    error = done.stderr.splitlines()[-1]
    assert "FigureError" in error
    assert str(work / "rc") in error


#: kinds of scenes with their files and pictures
KINDS_OF_RESULTS = {
    "samples": (SAMPLES, {*NUMBERS, "sample.extxyz"}, {"forces.png"}),
    "one state": (ONE, NUMBERS, set()),
    "sweep": (SWEEP, NUMBERS, {"sweep.png"}),
}


@pytest.mark.parametrize(
    ("kinds", "figures"),
    [
        pytest.param(["samples"], False, marks=pytest.mark.slow),
        (["one state"], False),
        pytest.param([*KINDS_OF_RESULTS], True, marks=pytest.mark.slow),
    ],
)
def test_a_result_of_another_kind_is_replaced_as_a_whole(work, whole, kinds, figures):
    shutil.copytree(whole, "out")
    for kind in kinds:
        text, files, pictures = KINDS_OF_RESULTS[kind]
        Scene.from_text(text).run("out", force=True, figures=figures)
        assert listed(work / "out") == (files | pictures if figures else files)
        assert set(every_file()) >= files | pictures


# -- side by side, and cut off ---------------------------------------------------------------------


def test_the_number_of_workers_has_limits(work, capsys):
    for count, limit in (("0", "1"), ("1000000", "1024")):
        assert main(["run", "scene.yaml", "-o", "three", "--workers", count]) == 2
        err = capsys.readouterr().err
        assert "--workers" in err
        assert limit in err
    assert not (work / "three").exists()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs a pipe with a name")
def test_there_are_no_more_workers_than_calls(work):
    os.mkfifo("pipe")  # who opens it for reading waits for who opens it for writing
    with Workers(1024) as executor:
        assert not multiprocessing.active_children()
        assert executor.submit(abs, -1).result() == 1
        assert len(multiprocessing.active_children()) == 1
        both = [executor.submit(os.open, "pipe", mode) for mode in (os.O_RDONLY, os.O_WRONLY)]
        assert len(multiprocessing.active_children()) == 2
        assert all(future.result() > 0 for future in both)
    assert not multiprocessing.active_children()


def test_a_worker_that_cannot_be_started_is_an_error(work, monkeypatch, capsys):
    def start(process):
        raise BlockingIOError(errno.EAGAIN, "no more processes")

    monkeypatch.setattr("multiprocessing.process.BaseProcess.start", start)
    assert main(["run", "scene.yaml", "-o", "out", "--workers", "2"]) == 1
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    for words in ("process 1 ", "no more processes", "--workers"):
        assert words in err
    assert listed(work) == {"scene.yaml"}


def test_errors_come_back_from_workers_as_they_are():
    with Workers(2) as executor:
        assert list(executor.map(math.sqrt, [4.0, 9.0])) == [2.0, 3.0]
        with pytest.raises(ValueError, match="domain") as caught:
            executor.submit(math.sqrt, -1.0).result()
        assert "Traceback" in str(caught.value.__cause__)  # that of the worker process
        with pytest.raises(pickle.PicklingError, match="pickle"):  # what cannot come back
            executor.submit(eval, "lambda: 0").result()
        with pytest.raises(RuntimeError, match=r"UnpicklableError: .*none"):
            # an error that cannot
            executor.submit(raise_unpicklable).result()
        with pytest.raises((AttributeError, pickle.PicklingError), match="local object"):
            # what cannot go there
            executor.submit(lambda: 0).result()
        assert executor.submit(abs, -1).result() == 1
    assert not multiprocessing.active_children()


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs signals")
def test_a_worker_that_is_killed_in_the_middle_of_its_result_holds_nothing_up():
    with Workers(2) as executor:
        futures = [executor.submit(time.sleep, 0.2), executor.submit(end_within_a_result)]
        assert futures[0].result(60) is None
        with pytest.raises(BrokenExecutor):
            # a pool of several would wait for the other half for ever
            futures[1].result(60)
        assert [executor.submit(abs, -number).result(60) for number in (1, 2)] == [1, 2]


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(
    "moment", ["Process.start", pytest.param("Process.kill", marks=pytest.mark.slow)]
)
def test_an_interruption_while_workers_come_and_go(work, monkeypatch, capsys, moment):
    before = signal.getsignal(signal.SIGTERM)
    name = moment.removeprefix("Process.")
    method = getattr(multiprocessing.process.BaseProcess, name)

    def signalled(process):
        method(process)
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(f"multiprocessing.process.BaseProcess.{name}", signalled)
    assert main(["run", "scene.yaml", "-o", "out", "--workers", "2", "--no-figures"]) == 130
    assert not multiprocessing.active_children()
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, ()) & {signal.SIGINT, signal.SIGTERM}
    assert signal.getsignal(signal.SIGTERM) is before
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("granphon: error: interrupted")
    assert ("whole result" in err) == (name == "kill")
    assert listed(work) == {"scene.yaml"} | ({"out"} if name == "kill" else set())


@pytest.mark.parametrize(
    ("error", "options"),
    [
        (KeyboardInterrupt(), ["--resume", "--force"]),
        pytest.param(MemoryError(), ["--resume"], marks=pytest.mark.slow),
    ],
)
def test_an_interrupted_sweep_goes_on(work, whole, monkeypatch, capsys, error, options):
    with monkeypatch.context() as patch:
        interrupted_after(2, patch, error)
        assert main(["run", "scene.yaml", "-o", "out", *options]) == (
            130 if isinstance(error, KeyboardInterrupt) else 1
        )
    assert capsys.readouterr().err.count("\n") == 1
    # the finished tasks and nothing else
    assert listed(work / "out") == {WORK_FILE}
    assert count_parts(work / "out") == 2
    with monkeypatch.context() as patch:
        begun = interrupted_after(99, patch, error)
        assert main(["run", "scene.yaml", "-o", "out", "-q", "--no-figures", *options]) == 0
    assert len(begun) == 6 - 2
    assert listed(work / "out") == NUMBERS
    assert load_sweep("out/sweep.nc").identical(load_sweep(whole / "sweep.nc"))
    assert (work / "out" / "sweep.csv").read_bytes() == (whole / "sweep.csv").read_bytes()


def test_a_file_that_is_missing_is_named(work, whole, capsys):
    shutil.copytree(whole, "out")
    (work / "out" / "sweep.csv").unlink()
    for option in ([], ["--resume"]):
        assert main(["run", "scene.yaml", "-o", "out", *option]) == 1
        err = capsys.readouterr().err
        assert "but not sweep.csv" in err
    assert (
        main(["run", "scene.yaml", "-o", "out", "--resume", "--force", "-q", "--no-figures"]) == 0
    )
    assert listed(work / "out") == NUMBERS
    assert main(["run", "scene.yaml", "-o", "out"]) == 1
    assert "but not" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (
            SWEEP.replace("20 N", "21 N").replace("7840", "7841"),
            "force[1] is 6.32455",
        ),
        pytest.param(ONE, "other work", marks=pytest.mark.slow),
    ],
)
def test_another_scene_does_not_discard_what_a_sweep_has_finished(
    work, monkeypatch, capsys, other, told
):
    with monkeypatch.context() as patch:
        interrupted_after(4, patch, KeyboardInterrupt())
        assert main(["run", "scene.yaml", "-o", "out"]) == 130
    kept = {path: path.read_bytes() for path in (work / "out").rglob("*") if path.is_file()}
    (work / "other.yaml").write_text(other)
    capsys.readouterr()
    for option in ([], ["--resume"]):
        assert main(["run", "other.yaml", "-o", "out", *option]) == 1
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        for words in ("out/.granphon-sweep ", told, "--force"):
            assert words in err
        assert {
            path: path.read_bytes() for path in (work / "out").rglob("*") if path.is_file()
        } == kept
    assert main(["run", "other.yaml", "-o", "out", "--force", "-q", "--no-figures"]) == 0
    assert listed(work / "out") == NUMBERS
    assert load_sweep("out/sweep.nc")["force"][-1] == (3.0 if other == ONE else 21.0)


@pytest.mark.parametrize("is_sweep", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_complete_folder_is_left_as_it_is(work, whole, monkeypatch, capsys, is_sweep):
    if is_sweep:
        shutil.copytree(whole, "out")
    else:
        (work / "scene.yaml").write_text(ONE)
        assert main(["run", "scene.yaml", "-o", "out", "-q"]) == 0
    capsys.readouterr()
    before = {
        path: (path.read_bytes(), path.stat().st_mtime_ns)
        for path in work.rglob("*")
        if path.is_file()
    }
    begun = interrupted_after(99, monkeypatch, KeyboardInterrupt())
    assert main(["run", "scene.yaml", "-o", "out", "--resume"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("out is complete")
    assert (out.count("\n"), err) == (1, "")
    assert main(["run", "scene.yaml", "-o", "out", "--resume", "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["run", "scene.yaml", "-o", "out"]) == 1
    assert "already holds" in capsys.readouterr().err
    assert not begun
    assert {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in before} == before


def test_a_complete_result_is_read_again(work, whole, monkeypatch):
    shutil.copytree(whole, "out")
    begun = interrupted_after(99, monkeypatch, KeyboardInterrupt())
    result = Scene.from_yaml("scene.yaml").run("out", resume=True)
    assert not begun
    assert result.dataset.identical(load_sweep(whole / "sweep.nc"))
    assert {path.name for path in result.files} == ALL


def test_a_complete_folder_of_another_scene_or_version_is_not_this_scenes(work, whole, monkeypatch):
    shutil.copytree(whole, "out")
    (work / "one.yaml").write_text(ONE)
    before = {path: path.read_bytes() for path in (work / "out").iterdir()}
    begun = interrupted_after(99, monkeypatch, KeyboardInterrupt())
    (work / "other.yaml").write_text(SWEEP.replace("20 N", "21 N"))
    assert main(["run", "other.yaml", "-o", "out", "--resume"]) == 1
    assert main(["run", "one.yaml", "-o", "out", "--resume"]) == 1
    monkeypatch.setattr("granphon.scene.scene.packages", lambda: {"granphon": "0.0.9"})
    assert main(["run", "scene.yaml", "-o", "out", "--resume"]) == 1
    assert not begun
    assert {path: path.read_bytes() for path in before} == before


def test_a_resumed_sweep_replaces_an_older_result_only_if_told(work, monkeypatch, capsys):
    scene = Scene.from_yaml("scene.yaml")
    Scene.from_text(ONE).run("out")
    with monkeypatch.context() as patch:
        interrupted_after(2, patch, KeyboardInterrupt())
        with pytest.raises(KeyboardInterrupt):
            scene.run("out", force=True)
    # the older result is still whole
    assert listed(work / "out") == {*NUMBERS, WORK_FILE}
    assert Scene.from_yaml("out/scene.yaml") == Scene.from_text(ONE)
    assert main(["run", "scene.yaml", "-o", "out", "--resume"]) == 1
    assert "already holds scene.yaml, summary.yaml" in capsys.readouterr().err
    assert (
        main(["run", "scene.yaml", "-o", "out", "--resume", "--force", "-q", "--no-figures"]) == 0
    )
    assert listed(work / "out") == NUMBERS


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "error", "code"),
    [
        pytest.param(
            "granphon.figures.curves.sweep_figure",
            KeyboardInterrupt(),
            130,
            marks=pytest.mark.slow,
        ),
        ("granphon.runs.dataset._write_rows", OSError(28, "No space left on device"), 1),
    ],
)
def test_a_sweep_that_cannot_be_written_is_not_computed_again(
    work, whole, monkeypatch, capsys, where, error, code
):

    def fail(*_: object, **__: object) -> None:
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(where, fail)
        assert main(["run", "scene.yaml", "-o", "out"]) == code
    assert capsys.readouterr().err.count("\n") == 1
    # the finished tasks and nothing else
    assert listed(work / "out") == {WORK_FILE}
    begun = interrupted_after(0, monkeypatch, error)
    assert main(["run", "scene.yaml", "-o", "out", "--resume", "-q", "--no-figures"]) == 0
    assert not begun
    assert listed(work / "out") == NUMBERS
    assert load_sweep("out/sweep.nc").identical(load_sweep(whole / "sweep.nc"))


#: the command, whose workers never come to an end with the averaged force
HELD = """
import os, sys, time
from granphon.runs import tasks

solved = tasks.MediumTask.solve

def solve(self, begun=None):
    if "afa" in self.where:
        os.write(1, b"held\\n")  # at once: two workers may write at the same time
        time.sleep(3600)
    return solved(self, begun)

tasks.MediumTask.solve = solve
if __name__ == "__main__":
    from granphon.cli.main import main
    sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(
    "kind",
    ["SIGKILL", *(pytest.param(name, marks=pytest.mark.slow) for name in ("SIGINT", "SIGTERM"))],
)
@pytest.mark.claim("machines-lost")
def test_workers_end_with_the_command_and_what_they_have_finished_is_kept(work, kind):
    # more tasks than are under way
    scene = SWEEP.replace("[ala, afa, ema]", "[ala, afa]").replace(
        "[1 um, 2 um]", "{from: 1 um, to: 2 um, points: 6}"
    )
    (work / "scene.yaml").write_text(scene)
    (work / "held.py").write_text(HELD)
    command = [sys.executable, "held.py", "run", "scene.yaml", "-o", "out", "--workers=2"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as running:
        try:
            assert [running.stdout.readline() for _ in range(2)] == [
                "held\n"
            ] * 2  # both have begun what has no end
            wait_for(
                lambda: count_parts(work / "out") >= 2 or running.poll() is not None,
                lambda: f"{count_parts(work / 'out')} results",
            )
            if kind == "SIGINT":  # as a terminal does, to the workers as well
                os.killpg(running.pid, signal.SIGINT)
            else:
                running.send_signal(signal.Signals[kind])
            # that is over when all who hold its ends are gone, the workers too
            out, err = running.communicate(timeout=HANGS)
        except BaseException:
            os.killpg(running.pid, signal.SIGKILL)
            raise
    assert out == ""
    if kind == "SIGKILL":
        assert running.returncode == -signal.SIGKILL
        assert err == ""  # nothing is said of semaphores left behind
    else:
        assert running.returncode == 130
        assert err.startswith("granphon: error: interrupted")
        assert "kept" in err
        assert err.count("\n") == 1
    # it may be killed while it writes
    assert listed(work / "out") - {f"{WORK_FILE}-journal"} == {WORK_FILE}
    with pytest.MonkeyPatch.context() as patch:
        begun = interrupted_after(99, patch, KeyboardInterrupt())
        assert main(["run", "scene.yaml", "-o", "out", "-q", "--no-figures"]) == 0
    media = [where.split(",")[0] for where in begun]
    assert media == ["afa"] * 2 + ["ala", "afa"] * 4


#: the command, interrupted when a module is imported, in the middle of exec() of a text, or at the
#: end of the interpreter
MOMENT = """
import atexit, os, signal, sys

def stop(*_):
    os.kill(os.getpid(), signal.{which})

class Finder:
    def find_spec(self, name, *_):
        if name == "{moment}":
            exec("stop()")

sys.meta_path.insert(0, Finder())
if "{moment}" == "end":
    atexit.register(stop)
from granphon.__main__ import main
sys.exit(main())
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(
    ("moment", "which", "code", "told"),
    [
        ("granphon.cli.main", "SIGINT", 130, "interrupted"),
        ("typer", "SIGTERM", 130, "interrupted"),
        pytest.param("granphon.scene.scene", "SIGINT", 130, "interrupted", marks=pytest.mark.slow),
        pytest.param("end", "SIGTERM", 2, None, marks=pytest.mark.slow),
    ],
)
def test_an_interruption_at_the_ends_of_the_process(work, moment, which, code, told):
    (work / "moment.py").write_text(MOMENT.format(moment=moment, which=which))
    command = [sys.executable, "moment.py", "check", "scene.yaml" if told else "not there.yaml"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANGS)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (code, "", 1)
    assert told is None or done.stderr.startswith(f"granphon: error: {told}")


@pytest.mark.parametrize(
    "moment",
    [
        "granphon.base.staging._finish",
        pytest.param("granphon.runs.finished_tasks.Store.clear", marks=pytest.mark.slow),
        pytest.param("granphon.cli.scenes.say_table", marks=pytest.mark.slow),
    ],
)
def test_an_interruption_after_the_exchange_says_that_the_result_is_there(
    work, monkeypatch, capsys, moment
):
    from granphon.base import staging
    from granphon.cli import scenes
    from granphon.runs import finished_tasks

    places = {"_finish": staging, "clear": finished_tasks.Store, "say_table": scenes}
    name = moment.rpartition(".")[2]
    before = getattr(places[name], name)

    def then(*arguments, **options):
        before(*arguments, **options)
        if name != "_finish" or not options:
            # another argument: before the result is written
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(places[name], name, then)
        assert main(["run", "scene.yaml", "-o", "out", "--no-figures"]) == 130
    err = capsys.readouterr().err.splitlines()[-1]
    assert err.startswith("granphon: error: interrupted; out ")
    assert "whole" in err
    assert main(["run", "scene.yaml", "-o", "out", "--no-figures", "--resume"]) == 0
    assert "out is complete" in capsys.readouterr().out


@pytest.fixture(scope="module")
def whole_samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of the samples of one state, carried out in one go."""
    folder = tmp_path_factory.mktemp("samples")
    (folder / "scene.yaml").write_text(SAMPLES)
    scene, out = str(folder / "scene.yaml"), folder / "out"
    assert main(["run", scene, "-q", "--no-figures", "-o", str(out)]) == 0
    return out


@pytest.fixture
def interrupted_samples(
    work: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Path:
    """The same, interrupted after the first sample."""
    (work / "scene.yaml").write_text(SAMPLES)
    with monkeypatch.context() as patch:
        interrupted_after(1, patch, KeyboardInterrupt())
        assert main(["run", "scene.yaml", "-q", "--no-figures", "-o", "out"]) == 130
    assert "kept" in one_error(capsys)
    return work / "out"


def test_the_samples_of_one_state_are_tasks(whole_samples, interrupted_samples, monkeypatch):
    """Interrupted and gone on with, they have the files of what went through."""
    assert listed(interrupted_samples) == {WORK_FILE}
    assert count_parts(interrupted_samples) == 1
    begun = interrupted_after(99, monkeypatch, KeyboardInterrupt())
    assert main(["run", "scene.yaml", "-q", "--no-figures", "-o", "out"]) == 0
    *samples, _state = (where.rpartition(", ")[2] for where in begun)
    assert samples == ["seed 1"]
    for name in listed(whole_samples):
        assert (interrupted_samples / name).read_bytes() == (whole_samples / name).read_bytes()


def test_the_samples_of_another_state_are_refused(interrupted_samples, capsys):
    Path("other.yaml").write_text(SAMPLES.replace("3 N", "4 N"))
    assert main(["run", "other.yaml", "-o", "out", "-q"]) == 1
    assert re.search(r"force\[0\] is 3\.0 .*4\.0 ", capsys.readouterr().err)
    assert (listed(interrupted_samples), count_parts(interrupted_samples)) == ({WORK_FILE}, 1)


def test_what_is_no_mistake_in_the_scene_is_not_told_as_one(work, capsys):
    """A disk that is full in the midst of the samples of one state is not a load that the balls
    cannot carry.
    """
    (work / "scene.yaml").write_text(SAMPLES)
    with full_disk():
        assert main(["run", "scene.yaml", "-o", "out", "-q"]) == 1
    error = one_error(capsys)
    assert error.startswith("out/.granphon-sweep ")
    assert "No space left" in error
    assert not (work / "out").exists()
    (work / "scene.yaml").write_text(SAMPLES.replace("force: 3 N", "overlap: -1.05 um"))
    assert main(["run", "scene.yaml", "-o", "out", "-q"]) == 2
    assert "'-1.05 um'" in one_error(capsys)


HISTORY = ", seed: 5, friction_history: true, friction_coefficient: 0.3, step_tolerance: 1"


@pytest.mark.parametrize(
    ("packing", "medium"),
    [
        ("", "samples: 1"),
        ("finite_overlap: true, ", ", geometry: exact"),
        pytest.param("", HISTORY + ", shear_response: partial_slip", marks=pytest.mark.slow),
        pytest.param(
            "finite_overlap: true, ", HISTORY + ", geometry: exact", marks=pytest.mark.exhaustive
        ),
        pytest.param("lattice: fcc, ", ", shape: 2 2 2" + HISTORY, marks=pytest.mark.exhaustive),
        ("equal", HISTORY),
        pytest.param("", HISTORY + ", start: gas", marks=pytest.mark.exhaustive),
    ],
)
def test_samples_solved_as_tasks_are_those_of_the_medium(packing, medium):
    from granphon.runs.dataset import SweepRun

    text = SAMPLES.replace("samples: 2", medium if "samples" in medium else "samples: 2" + medium)
    text = text.replace("shape: 4 4, ", "") if "shape" in medium else text
    text = (
        text.replace(", spread: {uniform: 2.04 um}", "")
        if packing == "equal"
        else text.replace("{diam", f"{{{packing}diam")
    )
    scene = Scene.from_text(text)
    assert scene.has_tasks
    expected = scene.state()
    run = SweepRun.of(scene.plan.grid)
    run.join(run.do())
    state = scene.state()
    assert state is not expected
    for name in (
        "force",
        "overlap",
        "normal_stiffness",
        "exponent",
        "exponent_error",
        "medium",
        "finite_overlap",
    ):
        assert_array_equal(getattr(state, name), getattr(expected, name))
    for one, other in zip(state.samples, expected.samples, strict=True):
        assert type(one) is type(other)
        names = [
            "seed",
            "elastic_tensor",
            "diameters",
            "contact_forces",
            "displacements",
            "residual",
            "energy",
        ]
        names += ["elastic_tensors_beside"] * scene.packing.spread_matters
        names += ["tangential_forces", "rotations", "work", "dissipated_energy"] * (
            "history" in medium
        )
        for name in names:
            assert_array_equal(getattr(one, name), getattr(other, name))
        assert_array_equal(one.network.shear_stiffness, other.network.shear_stiffness)


@pytest.mark.parametrize(
    ("name", "damage"),
    [("sweep.csv", b""), ("sweep.nc", None), ("summary.yaml", b"junk"), ("scene.yaml", None)],
)
def test_what_is_damaged_is_not_complete(work, whole, capsys, name, damage):
    shutil.copytree(whole, "out")
    path = work / "out" / name
    path.write_bytes(path.read_bytes()[:-1] if damage is None else damage)
    capsys.readouterr()
    assert not is_complete(Scene.from_yaml("scene.yaml"), "out")
    assert main(["run", "scene.yaml", "-o", "out", "--resume"]) == 1
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert f"out already holds {name}: " in err


# -- check and plot --------------------------------------------------------------------------------


def test_check_describes_a_sweep(work, capsys):
    assert main(["check", "scene.yaml"]) == 0
    out, err = capsys.readouterr()
    for expected in (
        "uniform\n",
        "2.04 um\n",
        "2 N to 20 N\n",
        "averaged lattice, averaged force, effective medium\n",
        "3 loads x 3 media x 2 values of width = 18 states",
        "scene.yaml, summary.yaml, sweep.nc, sweep.csv, sweep.png",
    ):
        assert expected in out
    assert re.search(r"ala .* of 6 states .*width 2 um", err)
    assert listed(work) == {"scene.yaml"}


def test_check_says_that_the_media_agree_for_equal_balls(work, capsys):
    (work / "scene.yaml").write_text(SWEEP.replace("2.04 um", "0 um").replace("sweep", "# sweep"))
    assert main(["check", "scene.yaml"]) == 0
    out, err = capsys.readouterr()
    assert "same for equal balls" in out
    assert err == ""


def test_many_warnings_are_cut_short(capsys):
    warn([f"warning {number}" for number in range(15)])
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 11
    assert lines[-1] == "granphon: warning: and 5 more"


def test_plot_draws_a_sweep_again(work, whole):
    shutil.copytree(whole, "out")
    assert main(["plot", "out", "--variable", "contact_fraction", "-o", "contacts.png"]) == 0
    drawn = (work / "contacts.png").read_bytes()
    assert drawn.startswith(b"\x89PNG")
    assert drawn != (work / "out" / "sweep.png").read_bytes()


def test_what_cannot_be_plotted_is_one_line(work, whole, capsys):
    shutil.copytree(whole, "out")
    for words, found in (
        (["--variable", "contact_fracton"], "no variable 'contact_fracton'"),
        (["--asymptotes"], "asymptotes"),
        (["-o", "x.xyz"], "names no figure format"),
    ):
        assert main(["plot", "out", "--force", *words]) == 2
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        assert found in err
    (work / "out" / "sweep.nc").write_bytes(b"broken")
    assert main(["plot", "out", "--force"]) == 2
    assert "cannot be read" in capsys.readouterr().err


def test_a_data_set_of_one_state_has_variables(work):
    Scene.from_text(ONE).run("out", figures=False)
    assert main(["plot", "out", "--variable", "bulk", "-o", "bulk.svg"]) == 0


def test_only_a_data_set_has_variables(work, capsys):
    state = Scene.from_text(ONE.replace("ema", "ala")).state()
    (work / "alone").mkdir()
    gp.Phonons(state).dos((4, 4), points=12).write_csv(work / "alone" / "dos.csv")
    assert main(["plot", "alone", "--variable", "bulk", "--force"]) == 2
    assert "with variable" in capsys.readouterr().err
    # nor has it bands, beside which long waves are drawn
    assert main(["plot", "alone", "--asymptotes", "--force"]) == 2
    assert "with asymptotes" in capsys.readouterr().err
