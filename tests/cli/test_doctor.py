"""The command ``doctor``, the groups of the help, and the completion of a shell."""

import getpass
import os
import re
import shutil
import socket
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from granphon.cli import doctor
from granphon.cli.app import GROUPS
from granphon.cli.commands import main

PYPROJECT = Path(__file__).parents[2] / "pyproject.toml"


def rows(text: str) -> dict[str, str]:
    """The rows of the text of ``doctor``."""
    return {m[1]: m[2] for m in re.finditer(r"^  (\S.*?)  +(\S.*)$", text, re.MULTILINE)}


@pytest.fixture
def quick(request, monkeypatch):
    """Try one optional package, or those that a test names."""
    monkeypatch.setattr(
        doctor, "OPTIONAL", getattr(request, "param", {"threadpoolctl": "threadpoolctl"})
    )


def test_doctor_tells_versions_threads_memory_and_fonts(quick, capsys, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert main(["doctor"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    found = rows(out)
    for name in doctor.REQUIRED:
        assert found[name] == version(name)
    assert found["Python"].startswith(".".join(map(str, sys.version_info[:3])))
    assert found["processors"].startswith(f"{os.cpu_count()}, of which ")
    assert "OMP_NUM_THREADS=3" in found["threads are set by"]
    assert found["BLAS of numpy"]
    assert found["memory available"].endswith("B")
    assert found["letters drawn"] == "Gamma, mu and plus-minus, mathtext"
    assert "writable" in found["config folder"]


def test_what_shares_a_sweep_among_machines_is_told():
    extra = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]["distributed"]
    assert {Requirement(one).name for one in extra} <= {*doctor.OPTIONAL, "granphon"}


def test_doctor_tells_nothing_personal(quick, capsys, monkeypatch, tmp_path):
    home = tmp_path / "jane"
    (home / "settings").mkdir(parents=True)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("MPLCONFIGDIR", str(home / "settings"))
    monkeypatch.setenv("OMP_NUM_THREADS", str(home / "four"))
    assert main(["doctor"]) == 0
    out = capsys.readouterr().out
    assert "OMP_NUM_THREADS=~/four" in out
    for name in ("jane", str(tmp_path), socket.gethostname(), f"/{getpass.getuser()}/"):
        assert name not in out


def test_doctor_lists_what_the_project_depends_on():
    project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
    needed = [*project["dependencies"], *project["optional-dependencies"]["scenes"]]
    assert [re.split(r"[>=<~ ]", one)[0] for one in needed] == list(doctor.REQUIRED)


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (
            "raise OSError('/opt/vendor/lib/libsome.so: no such file')",
            "cannot be imported: OSError: libsome.so: no such file",
        ),
        ("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)", "its import ends by signal 11"),
        ("import sys\nsys.exit(3)", "cannot be imported: no reason is given"),
    ],
)
@pytest.mark.parametrize(
    "quick", [{"a broken one": "brokenpackage", "an absent one": "absentpackage"}], indirect=True
)
def test_doctor_says_which_optional_package_is_broken(
    code, said, quick, tmp_path, monkeypatch, capsys
):
    (tmp_path / "brokenpackage.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    )
    assert main(["doctor"]) == 0
    found = rows(capsys.readouterr().out)
    assert (
        found["a broken one"]
        == f"there, its version is not known, but {'it ' if 'cannot' in said else ''}{said}"
    )
    assert found["an absent one"] == "not installed"


def test_doctor_works_without_numpy_and_matplotlib():
    code = (
        "import sys\nsys.modules['numpy'] = sys.modules['matplotlib'] = None\n"
        "from granphon.cli import doctor\nfrom granphon.cli.commands import main\n"
        "doctor.OPTIONAL.clear()\nsys.exit(main(['doctor']))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
    found = rows(run.stdout)
    assert found["numpy"] == f"{version('numpy')}, but the module numpy is missing"
    for name in ("BLAS", "matplotlib"):
        assert "not known (" in found[name] or found[name].endswith("is missing")


def test_doctor_loads_no_library_that_it_does_not_ask():
    code = (
        "import sys\nfrom granphon.cli import doctor\nfrom granphon.cli.commands import main\n"
        "doctor.OPTIONAL.clear()\nassert main(['doctor']) == 0\nprint('loaded', *sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.rpartition("loaded")[2].split())
    assert "matplotlib" in loaded
    assert not {"phonopy", "spglib", "xarray", "h5py", "pandas", "matplotlib.pyplot"} & loaded


# -- the help --------------------------------------------------------------------------------------


def test_commands_stand_in_groups(capsys):
    assert main(["--help"]) == 0
    sections = re.findall(r"^(\w[\w ]*):\n((?:  .*\n)+)", capsys.readouterr().out, re.MULTILINE)
    listed = {name: re.findall(r"^  (\w+) ", text, re.MULTILINE) for name, text in sections}
    assert list(listed) == ["Options", *GROUPS]
    assert listed["Scenes"] == ["init", "check", "run"]
    assert listed["Pictures"] == ["mode", "animate", "page", "export", "plot"]
    assert listed["Comparisons"] == ["fit", "tradeoff"]


def test_options_of_a_run_stand_in_groups(capsys):
    assert main(["run", "--help"]) == 0
    parts = re.split(
        r"^(Arguments|Options|Files|Work):\n", capsys.readouterr().out, flags=re.MULTILINE
    )
    assert parts[1::2] == ["Arguments", "Options", "Files", "Work"]
    options = [re.findall(r"^  (?:-\w, )?(--[\w-]+)", text, re.MULTILINE) for text in parts[2::2]]
    work = ["--resume", "--workers", "--scheduler", "--quiet"]
    assert options == [[], ["--help"], ["--out", "--force", "--figures"], work]


# -- the completion of a shell ---------------------------------------------------------------------


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_a_shell_gets_its_script_of_completion():
    line = f'"{sys.executable}" -m granphon --show-completion; exit $?'
    run = subprocess.run(["bash", "-c", line], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
    assert "complete -o default -F _granphon_completion granphon" in run.stdout
    assert (
        subprocess.run(["bash", "-n"], input=run.stdout, text=True, capture_output=True).stderr
        == ""
    )


@pytest.mark.parametrize(
    ("words", "place", "expected"),
    [
        ("granphon d", 1, {"doctor"}),
        ("granphon run --re", 2, {"--resume"}),
        ("granphon ", 1, {"init", "run", "fit", "doctor"}),
    ],
)
def test_a_shell_completes_commands_and_options(words, place, expected):
    asked = {"_GRANPHON_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(place)}
    run = subprocess.run(
        [sys.executable, "-m", "granphon"], capture_output=True, text=True, env=os.environ | asked
    )
    assert run.returncode == 0
    found = set(run.stdout.split())
    assert expected <= found
    assert len(expected) > 1 or found == expected
