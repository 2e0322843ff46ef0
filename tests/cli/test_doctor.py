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
from granphon.cli.main import main

PYPROJECT = Path(__file__).parents[2] / "pyproject.toml"


def rows(text: str) -> dict[str, str]:
    """The rows of the text of ``doctor``."""
    return {m[1]: m[2] for m in re.finditer(r"^  (\S.*?)  +(\S.*)$", text, re.MULTILINE)}


def test_doctor_tells_versions_cores_memory_and_caches(capsys, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert main(["doctor"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    told = rows(out)
    for name in ("granphon", "numpy", "scipy", "phonopy", "PyYAML"):
        assert told[name] == version(name)
    assert told["Python"].startswith(".".join(map(str, sys.version_info[:3])))
    assert told["cores"].startswith(f"{os.cpu_count()}, ")
    assert "OMP_NUM_THREADS=3" in told["threads"]
    assert told["memory"].endswith("B")
    assert "writable caches" in told


def test_doctor_tells_a_package_that_is_absent(capsys, monkeypatch):
    monkeypatch.setattr(doctor, "PACKAGES", ["absent-package"])
    assert main(["doctor"]) == 0
    assert rows(capsys.readouterr().out)["absent-package"] == "not installed"


def test_doctor_tells_nothing_personal(capsys, monkeypatch, tmp_path):
    home = tmp_path / "jane doe"
    (home / "settings").mkdir(parents=True)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("MPLCONFIGDIR", str(home / "settings"))
    monkeypatch.setenv("OMP_NUM_THREADS", str(home / "four"))
    failed = f"ImportError: {home / 'plug' / 'lib.so'}: no such file"
    monkeypatch.setattr(doctor, "load_plugins", lambda: {"the plug-in x": failed})
    assert main(["doctor"]) == 0
    out = capsys.readouterr().out
    assert "lib.so" in out
    for name in ("jane", str(tmp_path), socket.gethostname(), f"/{getpass.getuser()}/"):
        assert name not in out


@pytest.mark.parametrize("variable", ["NUMBA_CACHE_DIR", "MPLCONFIGDIR"])
def test_a_cache_can_be_kept_where_its_folder_can_be_made(capsys, monkeypatch, tmp_path, variable):
    """A file in the place of a folder stands for whatever cannot hold a cache."""
    cache = {"NUMBA_CACHE_DIR": "compiled loops", "MPLCONFIGDIR": "matplotlib"}[variable]
    occupied = tmp_path / "file"
    occupied.write_text("")
    for folder, is_writable in ((tmp_path / "new" / "folder", True), (occupied / "folder", False)):
        monkeypatch.setenv(variable, str(folder))
        assert main(["doctor"]) == 0
        assert (cache in rows(capsys.readouterr().out)["writable caches"]) == is_writable
        assert not folder.exists()


def test_doctor_needs_no_home(capsys, monkeypatch):
    def find_no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", find_no_home)
    monkeypatch.delenv("MPLCONFIGDIR", raising=False)
    assert main(["doctor"]) == 0
    assert "matplotlib" not in rows(capsys.readouterr().out)["writable caches"]


def test_doctor_lists_what_the_project_depends_on():
    project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    needed = [*project["dependencies"], *extras["scenes"], *extras["distributed"]]
    names = {Requirement(requirement).name for requirement in needed}
    assert names <= {*doctor.PACKAGES, "granphon"}


def test_doctor_loads_no_library():
    code = (
        "import sys\nfrom granphon.cli.main import main\n"
        "assert main(['doctor']) == 0\nprint('loaded', *sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.rpartition("loaded")[2].split())
    assert not {"numpy", "phonopy", "xarray", "h5py", "pandas", "matplotlib"} & loaded


# -- the help --------------------------------------------------------------------------------------


def test_commands_stand_in_groups(capsys):
    assert main(["--help"]) == 0
    sections = re.findall(r"^(\w[\w ]*):\n((?:  .*\n)+)", capsys.readouterr().out, re.MULTILINE)
    listed = {name: re.findall(r"^  (\w+) ", text, re.MULTILINE) for name, text in sections}
    assert list(listed) == ["Options", *GROUPS]
    assert listed["Scenes"] == ["init", "check", "run"]
    pictures = ["mode", "animate", "page", "export", "report", "plot"]
    assert listed["Pictures"] == pictures
    assert listed["Comparisons"] == ["fit", "tradeoff", "velocity"]


def test_options_of_a_run_stand_in_groups(capsys):
    assert main(["run", "--help"]) == 0
    parts = re.split(
        r"^(Arguments|Options|Files|Work):\n", capsys.readouterr().out, flags=re.MULTILINE
    )
    assert parts[1::2] == ["Arguments", "Options", "Files", "Work"]
    options = [re.findall(r"^  (?:-\w, )?(--[\w-]+)", text, re.MULTILINE) for text in parts[2::2]]
    work = ["--resume", "--workers", "--scheduler", "--quiet"]
    assert options == [[], ["--set", "--help"], ["--out", "--force", "--figures"], work]


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
