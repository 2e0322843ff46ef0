"""The pages do what they say: every block runs, every value in a comment is the value, every link leads somewhere.

The convention: where a line of a block is an expression, and the comment that ends it starts with a number, the numbers
there (parted by commas, up to the first word) are all of the expression's, rounded to the digits that are printed. A comment
that is a Python literal of another kind (a text, tuple, list, True or False), up to a colon, is the value.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
import warnings
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from pydantic import BaseModel

import granphon as gp
from granphon import schema

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

_FENCE = re.compile(r"^```(\S+)[^\n]*\n(.*?)^```\s*$", re.MULTILINE | re.DOTALL)
_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?"
_NUMBERS = re.compile(rf"{_NUMBER}(?:,\s+{_NUMBER})*(?=[\s:,;]|$)")


def blocks(page: Path, language: str) -> list[tuple[int, str]]:
    """The fenced blocks of a language: line number of the first line, and text."""
    text = page.read_text(encoding="utf-8")
    found = [m for m in _FENCE.finditer(text) if m[1] == language]
    return [(text.count("\n", 0, m.start(2)) + 1, m[2]) for m in found]


def having(language: str) -> list[Any]:
    return [pytest.param(page, id=page.name) for page in PAGES if blocks(page, language)]


def comments(code: str) -> dict[int, str]:
    """The comment on each line."""
    tokens = tokenize.generate_tokens(io.StringIO(code).readline)
    return {t.start[0]: t.string.lstrip("#").strip() for t in tokens if t.type == tokenize.COMMENT}


def flat(value: Any) -> list[float]:
    if isinstance(value, tuple | list):
        return [x for part in value for x in flat(part)]
    return np.asarray(value, float).ravel().tolist()


def mismatch(value: Any, comment: str) -> str | None:
    """What is wrong with a comment on a value; None if nothing is."""
    numbers = _NUMBERS.match(comment)
    if numbers is None:
        said, value = literal(comment), value.item() if isinstance(value, np.generic) else value
        return None if type(said) is type(value) and said == value else f"the comment says {said!r}, the value is {value!r}"
    printed = re.findall(_NUMBER, numbers[0])
    values = flat(value)
    half = [0.5 * 10.0 ** int(Decimal(p).as_tuple().exponent) for p in printed]
    if len(printed) == len(values) and all(
        abs(float(p) - v) <= h * (1.0 + 1e-9) for p, v, h in zip(printed, values, half, strict=True)
    ):
        return None
    return f"the comment says {numbers[0]}, the value is {values}"


def literal(comment: str) -> Any:
    """The value that a comment other than a number states."""
    try:
        return ast.literal_eval(comment)
    except (SyntaxError, ValueError):
        return ast.literal_eval(comment.partition(": ")[0])


def states_a_value(comment: str) -> bool:
    if _NUMBERS.match(comment):
        return True
    try:
        literal(comment)
    except (SyntaxError, ValueError):
        return False
    return True


def run(code: str, names: dict[str, Any], where: str, first: int = 1) -> Iterator[str | None]:
    """Execute a block statement by statement; for each value that a comment states, what is wrong with it."""
    said = comments(code)
    for statement in ast.parse(code).body:
        place = f"{where}:{first + statement.lineno - 1}"
        comment = said.get(statement.end_lineno or 0, "")
        if isinstance(statement, ast.Expr):
            value = eval(compile(ast.Expression(statement.value), place, "eval"), names)
            if states_a_value(comment):
                wrong = mismatch(value, comment)
                yield wrong and f"{place}: {wrong}"
        else:
            exec(compile(ast.Module([statement], []), place, "exec"), names)


@pytest.fixture
def folder(tmp_path, monkeypatch, state):
    """Where a page runs; the files that docs/phonopy.md is about are there."""
    monkeypatch.chdir(tmp_path)
    phonons = gp.Phonons(state)
    phonons.save("phonopy_params.yaml")
    phonons.bands("GKMG", npoints=3).write("band.yaml")
    return tmp_path


@pytest.mark.parametrize("page", having("python"))
def test_every_block_runs_and_gives_the_values_in_its_comments(page, folder):
    if page.name == "phonopy.md":
        pytest.importorskip("euphonic")
    before = matplotlib.get_backend()
    matplotlib.use("Agg")
    names: dict[str, Any] = {"__name__": page.stem}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # phonopy and numpy bring an OpenMP library each: Euphonic says that it will use one thread
            warnings.filterwarnings("ignore", "More than one OpenMP library", UserWarning)
            checks = [c for first, code in blocks(page, "python") for c in run(code, names, page.name, first)]
    finally:
        import matplotlib.pyplot as plt

        plt.close("all")
        matplotlib.use(before)
    problems = "\n".join(wrong for wrong in checks if wrong)
    assert not problems, problems
    # the convention has not silently come to mean nothing
    assert len(checks) >= {"README.md": 2, "python.md": 40}.get(page.name, 0)


def test_the_convention_finds_what_is_wrong():
    right = ("x  # 790.96 m/s", "x  # 791", "[x, -1.0]  # 790.96, -1.0 m/s, both", "'a'  # 'a'", "x > 0  # True")
    for line in right:
        assert list(run(line, {"x": 790.9588}, "here")) == [None]
    assert list(run("x = 1.0  # 2.0\nx  # in m/s\nx", {}, "here")) == []
    for wrong in ("7.96  # 7.95", "7.96  # 7.9", "[1.0, 2.0]  # 1.0", "1.0  # 1.0, 2.0", "1e-6  # 1.1e-6", "'a'  # 'b'"):
        (found,) = run(wrong, {}, "here")
        assert found is not None
        assert found.startswith("here:1: the comment says")


@pytest.mark.parametrize("page", having("yaml"))
def test_every_scene_is_one(page):
    for first, text in blocks(page, "yaml"):
        for _, state in gp.Scene.from_text(text, f"{page.name}:{first}").states():
            assert np.all(np.asarray(state.force) > 0.0)


def links(page: Path) -> list[str]:
    """Targets of links and images that are neither on the web nor in the same page."""
    text = _FENCE.sub("", page.read_text(encoding="utf-8"))
    text = re.sub(r"`[^`\n]*`|\$\$.*?\$\$|\$[^$\n]*\$", "", text, flags=re.DOTALL)
    found = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r"^\[[^\]]+\]:\s*(\S+)", text, re.MULTILINE)
    return [t for t in found if not re.match(r"[a-z]+:|#", t)]


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings."""
    heads = re.findall(r"^#+ (.+)$", _FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_to_a_file(page):
    for target in links(page):
        path, _, anchor = target.partition("#")
        there = page.parent / path
        assert there.is_file(), f"{page.name} links to {target}"
        assert not anchor or anchor in anchors(there), f"{page.name} links to {target}"


def test_there_are_links_to_check():
    assert {"docs/scene.md", "docs/images/bands.png", "CITATION.cff"} <= set(links(ROOT / "README.md"))


def test_the_readme_starts_with_the_commands_that_install_run_and_test():
    (_, install), (_, test) = blocks(ROOT / "README.md", "sh")[:2]
    scene_file = "examples/steel_hexagon.yaml"
    assert install.strip().split(" && ") == ["python -m pip install .", f"granphon run {scene_file} -o out"]
    assert test.strip().split(" && ") == ['python -m pip install ".[test]"', "python -m pytest -q"]
    assert (ROOT / scene_file).is_file()


def keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    """Every key of a scene file, blocks written out."""
    found = []
    for name, info in model.model_fields.items():
        key = prefix + (info.alias or name)
        kind = info.annotation
        inner = isinstance(kind, type) and issubclass(kind, BaseModel)
        found += keys(kind, f"{key}.") if inner else [key]
    return found


def test_the_table_of_keys_lists_those_of_the_schema():
    text = (ROOT / "docs" / "scene.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"^\| key \|.*\n\|[-|]+\|\n((?:\|.*\n)+)", text, re.MULTILINE)
    listed = [key for row in table.splitlines() for key in re.findall(r"`([^`]+)`", row.split("|")[1])]
    assert sorted(listed) == sorted(keys(schema.SceneFile))


def test_every_page_is_in_the_table_of_contents():
    (_, tree) = blocks(ROOT / "docs" / "index.md", "{toctree}")[0]
    listed = [line for line in tree.splitlines() if line and not line.startswith(":")]
    assert sorted(listed) == sorted(page.stem for page in PAGES[1:] if page.stem != "index")
