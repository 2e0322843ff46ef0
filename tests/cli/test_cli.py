import io
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import granphon as gp
from granphon.base import text as files
from granphon.base.errors import FileExistsInRunError
from granphon.base.progress import Silent, Terminal, on_stderr, silent
from granphon.base.staging import LIST
from granphon.cli.main import main
from granphon.cli.terminal import write_range
from granphon.scene.outputs import expected_files
from granphon.scene.scene import Scene
from tests.conftest import one_error
from tests.scene.mistakes import MISTAKES, SCENE
from tests.waiting import HANGS

SPECTRA = SCENE.replace("[velocities]", "[velocities, bands, dos]")


def command(*arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "granphon", *arguments], capture_output=True, text=True, **options
    )


@pytest.fixture(scope="module")
def spectra(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of that scene without its figure."""
    folder = tmp_path_factory.mktemp("spectra")
    (folder / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    scene, out = str(folder / "scene.yaml"), folder / "out"
    assert main(["run", scene, "-o", str(out), "--quiet", "--no-figures"]) == 0
    return out


def tree(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.name != LIST}


# -- every mistake in a scene is one clear error --------------------------------------------------------------------


@pytest.mark.parametrize("name", ["misspelt block", "no unit", "mechanism"])
def test_mistakes_in_a_scene(work, capsys, name):
    text, place, *words = MISTAKES[name]
    (work / "scene.yaml").write_text(text, encoding="utf-8")
    before = tree(work)
    assert main(["run", "scene.yaml", "-o", "out"]) == 2
    error = one_error(capsys)
    assert error.startswith(f"scene.yaml:{place}: ")
    for word in words:
        assert word in error
    assert tree(work) == before


def test_scenes_that_cannot_be_read(work, capsys):
    (work / "binary.yaml").write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00")
    (work / "large.yaml").write_text("# " + "x" * 200_000)
    (work / "folder.yaml").mkdir()
    before = tree(work)
    for name, expected in (
        ("binary.yaml", r"binary\.yaml:3 .*byte 0x00.* text"),
        ("large.yaml", r"large\.yaml .*100 kB"),
        ("folder.yaml", r"folder\.yaml .*folder"),
        ("missing.yaml", r"missing\.yaml: .*'granphon init'"),
        ("scene.yaml/x", r"scene\.yaml/x .*Not a directory"),
    ):
        assert main(["run", name, "-o", "out"]) == 2
        assert re.search(expected, one_error(capsys))
    assert tree(work) == before


# -- run ------------------------------------------------------------------------------------------------------------

#: the files of every run
ALONE = ("scene.yaml", "summary.yaml", "sweep.nc", "sweep.csv")


def test_run_writes_velocities(work, capsys):
    assert main(["run", "scene.yaml", "-o", "new/out"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "longitudinal velocity 790.96 m/s" in out
    assert f"{', '.join(ALONE)} into new/out" in out
    assert tree(work / "new") == {"out", *(f"out/{name}" for name in ALONE)}
    assert Scene.from_yaml("new/out/scene.yaml") == Scene.from_yaml("scene.yaml")
    summary = yaml.safe_load(Path("new/out/summary.yaml").read_text())
    state = Scene.from_yaml("scene.yaml").state()
    velocities = gp.sound_velocities(state)
    moduli = gp.moduli(state)
    for name, unit in state.units.items():
        assert summary[name] == getattr(state, name)
        assert summary["units"][name] == unit
    assert (summary["longitudinal"], summary["transverse"]) == (
        velocities.longitudinal,
        velocities.transverse,
    )
    assert (summary["bulk"], summary["shear"]) == (moduli.bulk, moduli.shear)
    assert summary["mindlin_ratio"] == state.packing.mindlin_ratio
    assert summary["tensor"] == moduli.tensor.tolist()
    assert summary["versions"] == files.versions("numpy", "scipy", "xarray", "h5netcdf")
    assert (summary["valid"], summary["ok"]) == (True, True)
    assert [check["name"] for check in summary["validity"]] == [
        "contact_radius",
        "load",
        "velocity",
        "resonance",
        "young_modulus",
        "density",
        "high_density",
        "diameter",
        "large_diameter",
    ]
    assert summary["files"] == ["scene.yaml", "summary.yaml", "sweep.nc", "sweep.csv"]
    numbers = {key for key, value in summary.items() if isinstance(value, float)}
    assert numbers <= set(summary["units"])


def test_run_computes_only_what_is_observed(work):
    (work / "scene.yaml").write_text(SCENE.replace("[velocities]", "[dos]"), encoding="utf-8")
    result = Scene.from_yaml("scene.yaml").run("out", figures=False)
    assert (result.velocities, result.moduli, result.bands) == (None, None, None)
    assert tree(work / "out") == {*ALONE, "dos.csv"}
    assert "longitudinal" not in (work / "out/summary.yaml").read_text()


def test_run_writes_spectra_that_are_read_back(work):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    result = Scene.from_yaml("scene.yaml").run("out", figures=False)
    assert tree(work / "out") == {*ALONE, "band.yaml", "phonopy_params.yaml", "dos.csv"}
    assert {str(p) for p in result.files} == {f"out/{name}" for name in tree(work / "out")}
    bands, dos = gp.Bands.read("out/band.yaml"), gp.DensityOfStates.read_csv("out/dos.csv")
    phonons = gp.Phonons(result.state)
    expected = phonons.bands("GKMG", npoints=11)
    np.testing.assert_allclose(bands.frequencies, expected.frequencies, rtol=1e-12, atol=1e-9)
    assert bands.labels == ("G", "K", "M", "G")
    np.testing.assert_allclose(dos.total, phonons.dos((8, 8)).total, rtol=1e-12)
    summary = yaml.safe_load((work / "out/summary.yaml").read_text())
    assert summary["top_frequency"] == expected.frequencies.max()
    # and what was expected
    plan = Scene.from_yaml("scene.yaml")
    assert tuple(path.name for path in result.files) == expected_files(plan, figures=False)
    assert set(expected_files(plan)) - set(expected_files(plan, figures=False)) == {"bands.png"}
    alone = Scene.from_text(SPECTRA.replace("[velocities, bands, dos]", "[dos]"))
    assert expected_files(alone) == (*ALONE, "dos.csv", "dos.png")
    assert set(summary["versions"]) == {
        "granphon",
        "numpy",
        "scipy",
        "xarray",
        "h5netcdf",
        "ase",
        "phonopy",
        "spglib",
    }


def test_finite_overlap_reaches_every_result(work):
    text = SPECTRA.replace("friction: true", "friction: true\n  finite_overlap: true").replace(
        "force: 18.446 N", "overlap: 40 um"
    )
    (work / "scene.yaml").write_text(text, encoding="utf-8")
    result = Scene.from_yaml("scene.yaml").run("out", figures=False)
    state = result.state
    assert result.velocities.longitudinal == gp.sound_velocities(state).longitudinal
    limit = gp.AveragedLattice(state.packing).at_overlap(state.overlap)
    assert result.velocities.longitudinal != gp.sound_velocities(limit).longitudinal
    assert result.moduli.bulk == gp.moduli(state).bulk
    expected = gp.Phonons(state).bands("GKMG", npoints=11)
    np.testing.assert_array_equal(result.bands.frequencies, expected.frequencies)


def test_plot_draws_the_figure_of_a_run(work, spectra, capsys):
    shutil.copytree(spectra, work / "out")
    assert main(["plot", "out"]) == 0
    assert (work / "out" / "bands.png").read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    assert main(["plot", "out"]) == 1
    assert "already holds bands.png" in one_error(capsys)
    assert main(["plot", "out", "-o", "both.xyz"]) == 2
    assert "format" in one_error(capsys)
    (work / "out" / "band.yaml").write_text("broken: [")
    assert main(["plot", "out", "-o", "again.pdf"]) == 2
    assert "band.yaml" in one_error(capsys)
    assert tree(work) == {"scene.yaml", "out"} | {f"out/{name}" for name in tree(work / "out")}


@pytest.mark.slow
def test_runs_and_plots_draw_figures_of_several_formats(work, capsys):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    assert main(["run", "scene.yaml", "-o", "out", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert {name for name in tree(work / "out") if name.endswith(".png")} == {"bands.png"}
    assert main(["plot", "out", "--force"]) == 0
    assert (work / "out" / "bands.png").read_bytes().startswith(b"\x89PNG")
    assert main(["plot", "out", "--asymptotes", "-o", "figures/both.pdf"]) == 0
    assert (work / "figures" / "both.pdf").read_bytes().startswith(b"%PDF")


def test_plot_of_nothing(work, capsys):
    for folder, words in (
        (".", r"\. holds no result"),
        ("missing", "no folder missing"),
        ("scene.yaml", r"scene\.yaml is no file of results"),
    ):
        assert main(["plot", folder]) == 2
        assert re.search(words, one_error(capsys))


@pytest.mark.skipif(os.name != "posix", reason="links and pipes of POSIX")
def test_plot_leaves_out_nothing_that_the_run_wrote(work, spectra, capsys):
    shutil.copytree(spectra, work / "out")
    bands = work / "out" / "band.yaml"
    told = "band.yaml cannot be read: "
    whole = bands.read_bytes()
    for make, why in (
        (lambda: None, "out holds no band.yaml"),
        (bands.mkdir, told + "it is a folder"),
        (lambda: os.mkfifo(bands), told + "it is a device"),
        (lambda: bands.symlink_to("nowhere"), told + "there is no such file"),
        (lambda: bands.symlink_to("band.yaml"), told + "Too many levels of symbolic links"),
    ):
        bands.rmdir() if bands.is_dir() else bands.unlink(missing_ok=True)
        make()
        assert main(["plot", "out"]) == 2
        assert why in one_error(capsys)
    (work / "copy").mkdir()
    for name in ("summary.yaml", "dos.csv", "sweep.nc"):  # as a copy without hidden files
        (work / "copy" / name).write_bytes((work / "out" / name).read_bytes())
    assert main(["plot", "copy"]) == 2
    assert "no band.yaml" in one_error(capsys)
    (work / "copy" / "band.yaml").write_bytes(whole)
    assert main(["plot", "copy"]) == 0
    assert tree(work / "copy") == {"summary.yaml", "dos.csv", "sweep.nc", "band.yaml", "bands.png"}


def test_an_existing_result_is_not_overwritten(work, capsys):
    assert main(["run", "scene.yaml", "-o", "out"]) == 0
    capsys.readouterr()
    before = (work / "out" / "summary.yaml").stat().st_mtime_ns
    assert main(["run", "scene.yaml", "-o", "out"]) == 1
    text = one_error(capsys)
    assert "out already holds scene.yaml" in text
    assert "--force" in text
    assert (work / "out" / "summary.yaml").stat().st_mtime_ns == before
    with pytest.raises(FileExistsInRunError):
        Scene.from_yaml("scene.yaml").run("out")
    assert main(["run", "scene.yaml", "-o", "out", "--force"]) == 0
    assert (work / "out" / "summary.yaml").stat().st_mtime_ns > before
    capsys.readouterr()
    (work / "out" / "summary.yaml").write_text("mine")
    assert main(["run", "scene.yaml", "-o", "out", "--force"]) == 1
    assert "changed" in one_error(capsys)
    assert (work / "out" / "summary.yaml").read_text() == "mine"


def test_a_failing_computation_leaves_nothing(work, capsys):
    # a large overlap with the prestress kept: the lattice buckles
    text = SPECTRA.replace("friction: true", "friction: false\n  finite_overlap: true").replace(
        "force: 18.446 N", "overlap: 6 mm"
    )
    (work / "scene.yaml").write_text(text, encoding="utf-8")
    for words in (["run", "scene.yaml", "-o", "new/out"], ["check", "scene.yaml"]):
        assert main(words) == 2
        told = one_error(capsys)
        assert "negative" in told
        assert ": packing.finite_overlap: found true" in told
        assert tree(work) == {"scene.yaml"}


def test_folders_that_cannot_be_written(work, capsys):
    for folder, found in (
        ("scene.yaml", "scene.yaml is not"),
        ("scene.yaml/out", "scene.yaml is not"),
        ("a\0b", "a null character"),
        ("x" * 300, "File name too long"),
    ):
        assert main(["run", "scene.yaml", "-o", folder]) == 1
        assert found in one_error(capsys)
    assert tree(work) == {"scene.yaml"}


def test_warnings_go_to_stderr_and_into_the_summary(work, capsys):
    (work / "scene.yaml").write_text(SCENE.replace("18.446 N", "200 kN"), encoding="utf-8")
    assert main(["check", "scene.yaml"]) == 0
    expected = [
        f"granphon: warning: {w}"
        for w in gp.validity(Scene.from_yaml("scene.yaml").state()).warnings
    ]
    assert expected
    assert capsys.readouterr().err.splitlines() == expected
    assert main(["run", "scene.yaml", "-o", "out", "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == expected
    summary = yaml.safe_load((work / "out/summary.yaml").read_text())
    assert [f"granphon: warning: {w}" for w in summary["warnings"]] == expected
    # the load is within the range of the medium, as for equal balls every load is, and beyond that
    # of the contact law
    assert (summary["valid"], summary["ok"]) == (True, False)


# -- init and check -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", ["steel_hexagon", "glass", "hydrogel"])
def test_init_writes_a_scene_that_check_accepts(tmp_path, monkeypatch, capsys, preset):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "--preset", preset]) == 0
    assert "granphon check scene.yaml" in capsys.readouterr().out
    assert main(["check", "scene.yaml"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("scene.yaml can be run.")
    assert err == ""
    assert tree(tmp_path) == {"scene.yaml"}


def test_init_does_not_overwrite(work, capsys):
    assert main(["init"]) == 1
    assert "already holds scene.yaml" in one_error(capsys)
    # nor with --force, unless it is as another "init" has written it
    assert main(["init", "--force"]) == 1
    assert "no record" in one_error(capsys)
    assert (work / "scene.yaml").read_text() == SCENE
    (work / "scene.yaml").unlink()
    assert main(["init", "--preset", "hydrogel"]) == 0
    assert main(["init", "--force", "--preset", "glass"]) == 0
    assert "glass" in (work / "scene.yaml").read_text()
    capsys.readouterr()
    assert main(["init", "other.yaml", "--preset", "hidrogel"]) == 2
    assert "'hydrogel'" in one_error(capsys)
    assert tree(work) == {"scene.yaml"}


def test_check_tells_what_will_be_done(work, capsys):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    assert main(["check", "scene.yaml"]) == 0
    out = capsys.readouterr().out
    for expected in (
        "211.65 GPa",
        "0.276",
        "7840 kg/m^3",
        "triangular",
        "8 mm",
        "force 18.446 N",
        "overlap 1.9392 um",
        "G K M G",
        "11",
        "8 x 8",
        "velocities, bands, dos",
        "scene.yaml, summary.yaml, sweep.nc, sweep.csv, band.yaml, phonopy_params.yaml, dos.csv, bands.png",
    ):
        assert expected in out
    assert tree(work) == {"scene.yaml"}


def test_check_tells_the_ranges_of_a_sweep_and_what_is_chosen(work, capsys):
    """The overlap goes as the force to 2/3, and the stiffness to 1/3: of eight times the force
    four times, and twice.
    """
    text = SPECTRA.replace("18.446 N", "[147.568 N, 18.446 N]").replace(", dos", "")
    (work / "scene.yaml").write_text(text, encoding="utf-8")
    assert main(["check", "scene.yaml"]) == 0
    out = capsys.readouterr().out
    assert "force 18.446 N to 147.57 N" in out
    for word, unit, ratio in (("overlap", "um", 4.0), ("normal", "MN/m", 2.0)):
        (ends,) = re.findall(rf"{word} ([\d.]+) {unit} to ([\d.]+) {unit}", out)
        assert float(ends[1]) == pytest.approx(ratio * float(ends[0]), rel=1e-4)
    assert "chosen" not in out
    text = re.sub("medium: .*", "medium: [ala, auto]", text)
    (work / "scene.yaml").write_text(text, encoding="utf-8")
    assert main(["check", "scene.yaml"]) == 0
    assert re.search("chosen +ala, exact", capsys.readouterr().out)


# -- the command itself ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", [[], ["init"], ["check"], ["run"], ["plot"]])
def test_help_has_examples(capsys, verb):
    assert main([*verb, "--help"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "Example" in out
    assert "granphon " + " ".join(verb) in out
    if not verb:
        assert main(["--version"]) == 0
        assert capsys.readouterr().out == f"granphon {gp.__version__}\n"
        assert "Exit codes:" in out
        for name in ("init", "check", "run", "plot"):
            assert f"\n  {name} " in out


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (["rum"], "No such command 'rum'"),
        (["nonsense"], "'nonsense'. See 'granphon --help'."),
        (["run", "scene.yaml"], "--out"),
        *(
            (words, "is empty")
            for words in (["run", "scene.yaml", "-o", ""], ["init", ""], ["plot", ".", "-o", ""])
        ),
        *(
            (words, "'-'")
            for words in (["run", "scene.yaml", "-o", "-"], ["init", "-"], ["plot", ".", "-o", "-"])
        ),
        (["run", "scene.yaml", "-o", "--"], "'--'"),
        (["run", "scene.yaml", "-o", "---"], "'---'"),
        (["run"], "Missing argument 'SCENE'"),
        (["run", "scene.yaml", "--out"], "See 'granphon run --help'."),
        (["mode", "s.yaml", "--at", "K", "-o", "m.png", "--branch", "-1"], "'--branch'"),
        (["run", "scene.yaml", "-o", "out", "--forse"], "No such option"),
        (["check", "a", "b"], "unexpected extra argument"),
        (["--nonsense"], "No such option"),
    ],
)
def test_wrong_usage(work, capsys, arguments, found):
    assert main(arguments) == 2
    assert found in one_error(capsys)
    assert tree(work) == {"scene.yaml"}


def test_without_a_word_the_command_shows_its_help(capsys):
    assert main([]) == 0
    alone = capsys.readouterr().out
    assert main(["--help"]) == 0
    assert capsys.readouterr().out.strip() == alone.strip()


def test_the_module_is_the_command(work):
    failed = command("run", "scene.yaml", "--nothing")
    assert failed.returncode == 2
    assert failed.stderr.startswith("granphon: error: ")
    assert "--nothing" in failed.stderr
    assert failed.stderr.count("\n") == 1
    assert failed.stdout == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
def test_output_that_cannot_be_printed(work):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "granphon", "doctor"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 1
    assert done.stderr.startswith("granphon: error: ")
    assert done.stderr.count("\n") == 1


def test_a_reader_that_goes_away(work):
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-m", "granphon", "doctor"],
        stdout=writing,
        stderr=subprocess.PIPE,
    )
    os.close(writing)
    assert done.stderr == b""
    assert done.returncode == 1


def test_help_says_each_command_in_one_whole_line_and_no_types(capsys):
    main(["--help"])
    text = capsys.readouterr().out
    assert "..." not in text.partition("Scenes:")[2]
    for verb in re.findall(
        r"^  (\w+)  ", text.partition("Scenes:")[2].partition("Exit codes:")[0], re.MULTILINE
    ):
        main([verb, "--help"])
        assert not re.search(r"<\w", capsys.readouterr().out), verb


def test_help_loads_no_library_of_the_computation():
    code = (
        "import sys\nfrom granphon.cli.main import main\nmain(['run', '--help'])\n"
        "assert not {'numpy', 'scipy', 'ase', 'phonopy', 'pint', 'yaml', 'matplotlib', 'rich'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


# -- progress -------------------------------------------------------------------------------------------------------


class Listener(Silent):
    def __init__(self, stop=None):
        self.labels = []
        self.left = {}
        self.stop = stop

    def step(self, label, total=None):
        self.labels.append(label)
        self.left[label] = total or 0
        if label == self.stop:
            raise KeyboardInterrupt
        return super().step(label, total)

    def advance(self, amount=1.0):
        self.left[self.labels[-1]] -= amount


def test_progress_is_told_of_long_work(work):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    listener = Listener()
    Scene.from_yaml("scene.yaml").run("out", progress=listener, figures=False)
    assert listener.labels == ["bands", "force constants", "density of states", "writing"]
    assert listener.left["writing"] == 0


@pytest.mark.parametrize("moment", ["density of states", "writing"])
def test_interruption_is_clean(work, moment):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    with pytest.raises(KeyboardInterrupt):
        Scene.from_yaml("scene.yaml").run("new/out", progress=Listener(stop=moment))
    assert tree(work) == {"scene.yaml"}


@pytest.mark.parametrize(
    ("before", "each", "told"),
    [
        (0, [7.0, 7.0, 7.0], "3/10 0:00:21 left 0:00:49"),
        (0, [200.0, 400.0], "2/10 0:10:00 left 0:40:00"),
        (4, [60.0], "5/10 0:01:00 left 0:05:00"),  # what was there when it began has taken no time
        (10, [], "10/10 0:00:00 left 0:00:00"),
    ],
)
def test_progress_tells_the_time_that_is_left(monkeypatch, before, each, told):
    class Screen(io.StringIO):
        def isatty(self):
            return True

    now, screen = [1e4], Screen()
    assert on_stderr() is silent
    monkeypatch.setattr(sys, "stderr", screen)
    assert on_stderr(quiet=True) is silent
    assert isinstance(on_stderr(), Terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    with Terminal(lambda: now[0]).step("sweep", 10) as step:
        step.advance(before)
        for duration in each:
            now[0] += duration
            step.advance()
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue())
    last = re.findall(r"sweep[^\r\n]*", shown)[-1]
    assert " ".join(last.split()).endswith(told)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a pseudo-terminal")
def test_progress_on_a_real_terminal_leaves_stdout_alone(work):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    ours, theirs = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "granphon", "run", "scene.yaml", "-o", "out", "--no-figures"],
        stdout=subprocess.PIPE,
        stderr=theirs,
    )
    os.close(theirs)
    seen = b""
    try:
        while piece := os.read(ours, 4096):
            seen += piece
    except OSError:  # the other side has closed
        pass
    out, _ = process.communicate(timeout=HANGS)
    os.close(ours)
    assert process.returncode == 0
    assert b"density of states" in seen
    assert b"\x1b" not in out
    assert b"longitudinal velocity" in out


def test_ends_of_a_range_that_read_alike_are_written_once():
    assert write_range([1.0, 1.0 + 1e-9], "N") == "1 N"
    assert write_range([[2.0], [1.0]], "N") == "1 N to 2 N"


def test_a_handler_of_sigterm_that_python_has_not_set_is_no_failure(monkeypatch):
    handlers = []
    monkeypatch.setattr(signal, "signal", lambda _number, handler: handlers.append(handler))
    assert main(["--version"]) == 0
    assert handlers == [signal.default_int_handler]


def test_a_closed_stdout_is_no_failure(work, monkeypatch, capsys):
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", None)
        assert main(["check", "scene.yaml"]) == 0
    assert capsys.readouterr().err == ""


def test_names_of_files_do_not_command_the_terminal(work, capsys):
    name = "red\x1b[31m\u202e.yaml"
    Path(name).write_text(SCENE, encoding="utf-8")
    assert main(["check", name]) == 0
    out, _ = capsys.readouterr()
    assert out.startswith("red\\x1b[31m\\u202e.yaml can be run.\n")
    assert out.replace("\n", "").isprintable()
    Path(name).write_text("colour: 1\n", encoding="utf-8")
    assert main(["check", name]) == 2
    assert one_error(capsys).startswith("red\\x1b[31m\\u202e.yaml:1: colour: ")
