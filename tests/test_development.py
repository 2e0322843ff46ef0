"""docs/development.md, and what makes a release, kept true.

``python -m tests.test_development`` prints what tests/lowest.txt must hold.
"""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import yaml

import granphon
from tests.test_structure import PACKAGE

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "development.md"
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


# -- what is named --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", ["docs/development.md", "CONTRIBUTING.md"])
def test_every_file_that_is_named_exists(page):
    named = re.findall(r"`((?:[\w.-]+/)+[\w.-]*|[\w-]+\.(?:toml|md|cff))`", read(page))
    assert named
    for name in named:
        # the package itself is where it is installed
        home = PACKAGE.parent if name.startswith("granphon/") else ROOT
        assert (home / name).exists(), f"{page} names {name}"


# -- versions -------------------------------------------------------------------------------------------------------


def lowest() -> str:
    """The text of tests/lowest.txt: the least version of everything that is needed at run time and in the tests."""
    lines = ["# The least versions that pyproject.toml allows: python -m tests.test_development > tests/lowest.txt"]
    for requirement in (*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["test"]):
        found = re.fullmatch(r"([\w.-]+)>=([\w.]+)", requirement)
        assert found, f"{requirement!r} is not of the form name>=version"
        lines.append(f"{found[1]}=={found[2]}")
    return "\n".join(lines) + "\n"


def test_the_lowest_versions_are_those_of_the_project():
    assert read("tests/lowest.txt") == lowest(), "run: python -m tests.test_development > tests/lowest.txt"


def test_the_versions_of_a_release_agree():
    cited = yaml.safe_load(read("CITATION.cff"))
    latest = re.search(r"^## (\S+) \((.+)\)$", read("CHANGELOG.md"), re.MULTILINE)
    assert latest is not None
    assert granphon.__version__ == version("granphon") == cited["version"] == latest[1]
    dated = "unreleased" if "date-released" not in cited else str(cited["date-released"])
    assert latest[2] == dated, "CHANGELOG.md and CITATION.cff give different dates"
    assert re.fullmatch(r"unreleased|\d{4}-\d\d-\d\d", dated)


if __name__ == "__main__":
    print(lowest(), end="")
