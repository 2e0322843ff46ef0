"""docs/development.md, and what makes a release, kept true.

``python -m tests.test_development`` prints what tests/lowest.txt must hold.
"""

from __future__ import annotations

import email
import re
import tomllib
import zipfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import yaml

import granphon
from tests.test_structure import PACKAGE

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "development.md"
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))[
    "project"
]
#: what is needed at run time, scenes included
NEEDED = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["scenes"]]


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


# -- what is named ---------------------------------------------------------------------------------


@pytest.mark.parametrize("page", ["docs/development.md", "CONTRIBUTING.md"])
def test_every_file_that_is_named_exists(page):
    named = re.findall(r"`((?:[\w.-]+/)+[\w.-]*|[\w-]+\.(?:toml|md|cff))`", read(page))
    assert named
    for name in named:
        # the package itself is where it is installed
        home = PACKAGE.parent if name.startswith("granphon/") else ROOT
        assert (home / name).exists(), f"{page} names {name}"


# -- versions --------------------------------------------------------------------------------------


def lowest() -> str:
    """The text of tests/lowest.txt: the least version of everything that is needed at run time and
    in the tests.
    """
    lines = [
        "# The least versions that pyproject.toml allows: python -m tests.test_development >"
        " tests/lowest.txt"
    ]
    for requirement in (*NEEDED, *PROJECT["optional-dependencies"]["test"]):
        if requirement == "granphon[scenes]":  # it is among those needed at run time
            continue
        found = re.fullmatch(r"([\w.-]+)>=([\w.]+)(?:,<[\d.]+)?", requirement)
        assert found, f"{requirement!r} is not of the form name>=version"
        lines.append(f"{found[1]}=={found[2]}")
    return "\n".join(lines) + "\n"


def test_the_lowest_versions_are_those_of_the_project():
    assert read("tests/lowest.txt") == lowest(), (
        "run: python -m tests.test_development > tests/lowest.txt"
    )


def test_every_dependency_says_who_needs_it():
    rows = re.findall(
        r"^\| ([\w-]+) \| [\d.]+ \| .+ \| .+ \| .+ \|$", read("docs/development.md"), re.MULTILINE
    )
    assert sorted(rows) == sorted(re.split("[<>=]", one)[0] for one in NEEDED)


def test_the_wheel_has_the_package_its_licences_and_its_command(tmp_path):
    wheel = pytest.importorskip("hatchling.builders.wheel")
    (file,) = wheel.WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    assert Path(file).name == f"granphon-{granphon.__version__}-py3-none-any.whl"
    assert 1e6 < Path(file).stat().st_size < 3e6
    with zipfile.ZipFile(file) as archive:
        names = archive.namelist()
        about = next(name.partition("/")[0] for name in names if name.endswith("/METADATA"))
        metadata = email.message_from_bytes(archive.read(f"{about}/METADATA"))
        commands = archive.read(f"{about}/entry_points.txt").decode()
    assert {name.partition("/")[0] for name in names} == {"granphon", about}
    assert {one for one in names if one.startswith("granphon/")} >= {
        file.relative_to(ROOT).as_posix()
        for ending in ("*.py", "*.pyi", "*.js", "*.yaml", "py.typed")
        for file in (ROOT / "granphon").rglob(ending)
    }
    assert sorted(metadata.get_all("License-File")) == sorted(
        [
            "LICENSE",
            *(f"granphon/page/assets/vendor/{name}.LICENSE" for name in ("plotly", "three")),
        ]
    )
    assert all(f"{about}/licenses/{one}" in names for one in metadata.get_all("License-File"))
    assert metadata["License-Expression"] == PROJECT["license"]
    assert "granphon = granphon.__main__:main" in commands
    needed = [one for one in metadata.get_all("Requires-Dist") if "extra ==" not in one]
    assert {re.split("[<>=]", one)[0].lower() for one in needed} == {
        re.split("[<>=]", one)[0].lower() for one in PROJECT["dependencies"]
    }


def test_the_versions_of_a_release_agree():
    cited = yaml.safe_load(read("CITATION.cff"))
    latest = re.search(r"^## (\S+) \((.+)\)$", read("CHANGELOG.md"), re.MULTILINE)
    assert latest is not None
    assert granphon.__version__ == version("granphon") == cited["version"] == latest[1]
    dated = "unreleased" if "date-released" not in cited else str(cited["date-released"])
    assert latest[2] == dated, "CHANGELOG.md and CITATION.cff give different dates"
    assert re.fullmatch(r"unreleased|\d{4}-\d\d-\d\d", dated)


def test_the_conda_recipe_says_what_the_project_says():
    """Rendered as conda-build does it, with the data of files that its recipes may load."""
    templates = pytest.importorskip("jinja2")
    place = ROOT / ".ci" / "conda"

    def load_data(name: str, *, from_recipe_dir: bool) -> dict[str, Any]:
        assert from_recipe_dir
        return tomllib.loads((place / name).read_text(encoding="utf-8"))

    def load_regex(name: str, pattern: str, *, from_recipe_dir: bool) -> re.Match[str] | None:
        assert from_recipe_dir
        return re.search(pattern, (place / name).read_text(encoding="utf-8"))

    template = templates.Environment(undefined=templates.StrictUndefined).from_string(
        read(".ci/conda/meta.yaml")
    )
    recipe = yaml.safe_load(
        template.render(load_file_data=load_data, load_file_regex=load_regex, PYTHON="python")
    )
    assert recipe["package"] == {"name": "granphon", "version": granphon.__version__}
    run = [
        re.fullmatch(r"([a-z0-9-]+) >=([\d.]+(?:,<[\d.]+)?)", one)
        for one in recipe["requirements"]["run"]
    ]
    assert all(run), recipe["requirements"]["run"]
    needed = {one[1].removesuffix("-base"): one[2] for one in run if one}
    wanted = dict(one.lower().split(">=") for one in NEEDED)
    assert needed == wanted | {"python": PROJECT["requires-python"].removeprefix(">=")}
    assert recipe["build"]["entry_points"] == ["granphon = granphon.__main__:main"]
    assert recipe["about"]["license"] == PROJECT["license"]
    assert all(
        list((place / recipe["source"]["path"]).glob(one))
        for one in recipe["about"]["license_file"]
    )
    hatchling = next(one for one in recipe["requirements"]["host"] if one.startswith("hatchling"))
    assert (
        hatchling.replace(" ", "")
        in tomllib.loads(read("pyproject.toml"))["build-system"]["requires"]
    )


if __name__ == "__main__":
    print(lowest(), end="")
