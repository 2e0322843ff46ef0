"""The pages do what they say: every block runs, every value in a comment is the value, every link
leads somewhere.

The blocks of a page are carried out in order, in one folder, which holds nothing but ``examples``
at the start:

``python``   where a line is an expression, and the comment that ends it starts with a number, the numbers there (parted by
             commas, up to the first word) are all of the expression's, rounded to the digits that
             are printed. A comment that is a Python literal of another kind (a text, tuple, list,
             True or False), up to a colon, is the value.
``yaml``     is a scene. If its first line is a comment with a name, such as ``# scene.yaml``, it is written there. One that
             is called wrong.yaml need not be right.
``text``     likewise, if its first line is such as ``# table.csv``; else it is not looked at.
``console``  commands after ``$``, and what they print: a line ``...`` stands for any number of lines, ``...``
             in a line for any text, and nothing for whatever it is.
``sh``       commands alone.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tokenize
import warnings
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout, suppress
from decimal import Decimal
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

import granphon as gp
from granphon.base import errors
from granphon.cli.main import main
from granphon.fits import measurements
from granphon.media import simulation
from granphon.observables import velocities as observables

ROOT = Path(__file__).parent.parent
PACKAGE = Path(gp.__file__).parent
DOCS = ROOT / "docs"
#: made by the build, and not pages of ours
MADE = ("_build", "gallery")
PAGES = [
    ROOT / "README.md",
    *sorted(p for p in DOCS.rglob("*.md") if p.relative_to(DOCS).parts[0] not in MADE),
]
#: commands that a page may have and that are not run here: they install, or run this very suite
NOT_RUN = (
    "python -m pip install",
    "python -m pytest",
    "python tests/benchmarks",
    "python -m tests.record",
)

#: characters for which the column of a page has room
COLUMN = 88
#: languages of blocks that the style of the pages wraps, as a terminal does: what commands print
WRAPPED = ("console", "text")

#: pages that take more than half a second of processor
LONG = (
    "explanation/cluster.md",
    "explanation/experiment.md",
    "explanation/friction.md",
    "explanation/ladder.md",
    "explanation/pulses.md",
    "explanation/waves.md",
    "how-to/design.md",
    "how-to/edges.md",
    "how-to/errors.md",
    "how-to/extend.md",
    "how-to/figure.md",
    "how-to/impact.md",
    "how-to/kinds.md",
    "how-to/losses.md",
    "how-to/material.md",
    "how-to/network.md",
    "how-to/page.md",
    "how-to/paper.md",
    "how-to/phonopy.md",
    "how-to/report.md",
    "how-to/response.md",
    "how-to/sensitivities.md",
    "how-to/simulation.md",
    "how-to/sweep.md",
    "how-to/traces.md",
    "how-to/tradeoff.md",
    "how-to/transmission.md",
    "how-to/velocities.md",
    "how-to/walls.md",
    "how-to/waves.md",
    "index.md",
    "tutorial/steel.md",
)

_FENCE = re.compile(r"^```(\S+)[^\n]*\n(.*?)^```\s*$", re.MULTILINE | re.DOTALL)
_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?"
_NUMBERS = re.compile(rf"{_NUMBER}(?:,\s+{_NUMBER})*(?=[\s:,;]|$)")


def name_of(page: Path) -> str:
    return page.relative_to(DOCS if page.is_relative_to(DOCS) else ROOT).as_posix()


def blocks(page: Path, *languages: str) -> list[tuple[int, str, str]]:
    """The fenced blocks of some languages: line number of the first line, language, and text."""
    text = page.read_text(encoding="utf-8")
    found = [m for m in _FENCE.finditer(text) if m[1] in languages]
    return [(text.count("\n", 0, m.start(2)) + 1, m[1], m[2]) for m in found]


def having(*languages: str) -> list[Any]:
    return [pytest.param(page, id=name_of(page)) for page in PAGES if blocks(page, *languages)]


# -- values in comments ----------------------------------------------------------------------------


def comments(code: str) -> dict[int, str]:
    """The comment on each line."""
    tokens = tokenize.generate_tokens(io.StringIO(code).readline)
    return {t.start[0]: t.string.lstrip("#").strip() for t in tokens if t.type == tokenize.COMMENT}


def flat(value: Any) -> list[float]:
    if isinstance(value, tuple | list):
        return [x for part in value for x in flat(part)]
    return np.asarray(value, float).ravel().tolist()


def check(value: Any, comment: str) -> Iterator[str | None]:
    """What is wrong with a comment on a value, None if nothing is; nothing of a comment that states
    no value.
    """
    numbers = _NUMBERS.match(comment)
    if numbers:
        printed = re.findall(_NUMBER, numbers[0])
        values = flat(value)
        half = [0.5 * 10.0 ** int(Decimal(p).as_tuple().exponent) * (1.0 + 1e-9) for p in printed]
        right = len(printed) == len(values)
        right = right and all(
            abs(float(p) - v) <= h for p, v, h in zip(printed, values, half, strict=True)
        )
        yield None if right else f"the comment says {numbers[0]}, the value is {values}"
        return
    value = value.item() if isinstance(value, np.generic) else value
    for text in (comment, comment.partition(": ")[0]):
        with suppress(SyntaxError, ValueError):
            said = ast.literal_eval(text)
            right = type(said) is type(value) and said == value
            yield None if right else f"the comment says {said!r}, the value is {value!r}"
            return


def run(code: str, names: dict[str, Any], where: str, first: int = 1) -> Iterator[str | None]:
    """Execute a block statement by statement; for each value that a comment states, what is wrong
    with it.
    """
    said = comments(code)
    for statement in ast.parse(code).body:
        place = f"{where}:{first + statement.lineno - 1}"
        comment = said.get(statement.end_lineno or 0, "")
        if isinstance(statement, ast.Expr):
            value = eval(compile(ast.Expression(statement.value), place, "eval"), names)
            yield from (wrong and f"{place}: {wrong}" for wrong in check(value, comment))
        else:
            exec(compile(ast.Module([statement], []), place, "exec"), names)


# -- commands --------------------------------------------------------------------------------------


def commands(text: str, prompt: str) -> Iterator[tuple[str, list[str]]]:
    """Each command of a block, continued lines joined, and the lines that it is said to print."""
    command = ""
    printed = []
    for line in text.replace("\\\n", " ").splitlines():
        if line.startswith(prompt) and line.strip():
            if command:
                yield command, printed
            command = line.removeprefix(prompt).strip()
            printed = []
        else:
            printed.append(line.rstrip())
    if command:
        yield command, printed


def carried_out(command: str) -> tuple[int, list[str]]:
    """Exit code and output of a command; granphon's own in this process."""
    words = shlex.split(command)
    if words[0] == "granphon":
        said = io.StringIO()
        with redirect_stdout(said), redirect_stderr(said):
            code = main(words[1:])
        return code, [line.rstrip() for line in said.getvalue().splitlines()]
    assert words[0] in ("phonopy", "phonopy-bandplot") or command.startswith("python examples/"), (
        f"{command}: not run"
    )
    program = (
        [sys.executable]
        if words[0] == "python"
        else [str(Path(sys.executable).with_name(words[0]))]
    )
    quiet = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [*program, *words[1:]], capture_output=True, text=True, check=False, env=quiet
    )
    return done.returncode, [line.rstrip() for line in (done.stdout + done.stderr).splitlines()]


def is_as_printed(found: list[str], printed: list[str]) -> bool:
    lines = (
        "(?:.*\n)*?" if line == "..." else re.escape(line).replace(r"\.\.\.", ".*") + "\n"
        for line in printed
    )
    pattern = "".join(lines)
    return re.fullmatch(pattern, "".join(f"{line}\n" for line in found)) is not None


def at_the_prompt(text: str, prompt: str, where: str) -> Iterator[str | None]:
    """Carry out the commands of a block; for each, what is wrong."""
    for command, printed in commands(text, prompt):
        if command.startswith(NOT_RUN):
            continue
        code, found = carried_out(command)
        refused = any("error:" in line for line in printed)
        if bool(code) != refused or (printed and not is_as_printed(found, printed)):
            yield f"{where}: {command}: exit code {code}, it prints\n" + "\n".join(found)
        else:
            yield None


# -- pages -----------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where a page runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples", target_is_directory=True)
    return tmp_path


def performed(page: Path, folder: Path) -> Iterator[str | None]:
    """Carry out a page from top to bottom; for each thing that it states, what is wrong with it."""
    names: dict[str, Any] = {"__name__": page.stem}
    shells = 0
    for first, language, text in blocks(page, "python", "yaml", "text", "console", "sh"):
        where = f"{name_of(page)}:{first}"
        shells += language == "sh"
        if language in ("yaml", "text"):
            named = re.match(rf"# ([\w-]+\.{'yaml' if language == 'yaml' else 'csv'})\n", text)
            if named:
                (folder / named[1]).write_text(text, encoding="utf-8")
            if language == "yaml" and not (named and named[1] == "wrong.yaml"):
                scene = gp.Scene.from_yaml(named[1]) if named else gp.Scene.from_text(text, where)
                assert all(
                    np.all(np.asarray(state.force) > 0.0) for _, state in scene.states(quick=True)
                ), where
        elif language == "python":
            yield from run(text, names, name_of(page), first)
        # the README's first two are those of a clean environment: .ci/run has them
        elif not (page.name == "README.md" and language == "sh" and shells <= 2):
            yield from at_the_prompt(text, "$ " if language == "console" else "", where)


# the commands of the page for developers are those of .ci/run
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(*one.values, id=one.id, marks=pytest.mark.exhaustive if one.id in LONG else ())
        for one in having("python", "yaml", "text", "console", "sh")
        if one.id != "development.md"
    ],
)
def test_every_block_runs_and_gives_what_the_page_says(page, folder):
    if "from euphonic" in page.read_text(encoding="utf-8"):
        pytest.importorskip("euphonic")
    before = matplotlib.get_backend()
    matplotlib.use("Agg")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # phonopy and numpy bring an OpenMP library each: Euphonic says that it will use one
            # thread
            warnings.filterwarnings(
                "ignore", "Setting the shape on a NumPy array", DeprecationWarning, r"ase\."
            )
            warnings.filterwarnings("ignore", "More than one OpenMP library", UserWarning)
            checks = list(performed(page, folder))
    finally:
        import matplotlib.pyplot as plt

        plt.close("all")
        matplotlib.use(before)
    problems = "\n".join(wrong for wrong in checks if wrong)
    assert not problems, problems


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_column_has_room_for_every_block(page):
    text = page.read_text(encoding="utf-8")
    code = [
        (text.count("\n", 0, found.start(2)) + 1, found[2])
        for found in _FENCE.finditer(text)
        if not found[0].startswith(
            (*(f"```{kind}\n" for kind in WRAPPED), "```{code-block} text", "```{eval-rst}")
        )
    ]
    wide = [
        first + n
        for first, block in code
        for n, line in enumerate(block.splitlines())
        if len(line) > COLUMN
    ]
    assert wide == [], f"{name_of(page)}: lines of more than {COLUMN} characters"


def test_the_convention_finds_what_is_wrong(folder):
    right = (
        "x  # 790.96 m/s",
        "x  # 791",
        "[x, -1.0]  # 790.96, -1.0 m/s, both",
        "'a'  # 'a'",
        "x > 0  # True",
    )
    for line in right:
        assert list(run(line, {"x": 790.9588}, "here")) == [None]
    assert list(run("x = 1.0  # 2.0\nx  # in m/s\nx", {}, "here")) == []
    for wrong in (
        "7.96  # 7.95",
        "7.96  # 7.9",
        "[1.0, 2.0]  # 1.0",
        "1.0  # 1.0, 2.0",
        "1e-6  # 1.1e-6",
        "'a'  # 'b'",
    ):
        (found,) = run(wrong, {}, "here")
        assert found is not None
        assert found.startswith("here:1: the comment says")
    version = f"granphon {gp.__version__}"
    for said in (version, "...", "gran...", f"...\n{version}\n..."):
        assert list(at_the_prompt(f"$ granphon --version\n{said}\n", "$ ", "here")) == [None]
    assert list(at_the_prompt("$ granphon \\\n  --version\n", "$ ", "here")) == [None]
    for said in ("granphon 0", "...\nno", f"{version}\nmore"):
        (found,) = at_the_prompt(f"$ granphon --version\n{said}\n", "$ ", "here")
        assert found == f"here: granphon --version: exit code 0, it prints\n{version}"
    (found,) = at_the_prompt("granphon check nothing.yaml\n", "", "here")
    assert found is not None
    assert "exit code 2" in found
    with pytest.raises(AssertionError, match="not run"):
        list(at_the_prompt("rm scene.yaml", "", "here"))


def links(page: Path) -> list[str]:
    """Targets of links and images that are neither on the web nor in the same page."""
    text = _FENCE.sub("", page.read_text(encoding="utf-8"))
    text = re.sub(r"`[^`\n]*`|\$\$.*?\$\$|\$[^$\n]*\$", "", text, flags=re.DOTALL)
    found = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(
        r"^\[[^\]]+\]:\s*(\S+)", text, re.MULTILINE
    )
    return [t for t in found if not re.match(r"[a-z]+:|#", t)]


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings."""
    heads = re.findall(r"^#+ (.+)$", _FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", [ROOT / "CHANGELOG.md", *PAGES], ids=name_of)
def test_every_link_leads_to_a_file(page):
    for target in links(page):
        path, _, anchor = target.partition("#")
        there = page.parent / path
        if there.is_relative_to(DOCS / "gallery"):
            continue  # the build makes it, and says what is missing
        # a folder is shown as a list of its files where the README is read
        assert there.is_file() or (page.name == "README.md" and there.is_dir()), (
            f"{name_of(page)} links to {target}"
        )
        assert not anchor or anchor in anchors(there), f"{name_of(page)} links to {target}"


def test_the_picture_of_the_readme_is_what_its_command_draws(tmp_path):
    from PIL import Image

    picture = next(target for target in links(ROOT / "README.md") if target.endswith(".png"))
    result = gp.Scene.from_yaml(ROOT / "examples" / "steel_hexagon.yaml").run(tmp_path / "out")
    drawn = Image.open(tmp_path / "out" / "bands.png").convert("L")
    held = Image.open(ROOT / picture).convert("L").resize(drawn.size)
    shades = np.array([np.asarray(one, np.int16) for one in (drawn, held)])
    assert np.mean(np.abs(shades[0] - shades[1]) > 100.0) < 3e-3  # dashed lines are 8e-3
    assert result.failures == ()


def test_the_readme_starts_with_the_commands_that_install_run_and_test():
    (_, _, install), (_, _, test) = blocks(ROOT / "README.md", "sh")[:2]
    scene_file = "examples/steel_hexagon.yaml"
    assert install.strip().split(" && ") == [
        'python -m pip install ".[scenes]"',
        f"granphon run {scene_file} -o out",
    ]
    assert test.strip().split(" && ") == ['python -m pip install ".[test]"', "python -m pytest -q"]
    assert (ROOT / scene_file).is_file()


@pytest.fixture
def repository(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    return import_module("_repository")


@pytest.mark.parametrize(
    ("remote", "there"),
    [
        ("git@host.org:owner/name.git", "https://host.org/owner/name"),
        ("ssh://git@host.org:2222/owner/name.git", "https://host.org/owner/name"),
        ("https://host.org:8443/owner/name.git", "https://host.org:8443/owner/name"),
        ("https://someone:secret@host.org/owner/name.git", "https://host.org/owner/name"),
        ("file:///somewhere/name.git", "file:///somewhere/name.git"),
        ("/somewhere/my name.git", "file:///somewhere/my%20name.git"),
        ("../name.git", "file:///top/name.git"),
        ("./odd:name", "file:///top/clone/odd%3Aname"),
        ("ext::sh -c something://", None),
    ],
)
def test_a_remote_has_an_address_that_a_browser_opens(repository, remote, there):
    assert repository.web_address(remote, Path("/top/clone")) == there


@pytest.mark.skipif(shutil.which("git") is None, reason="there is no git on this machine")
def test_the_address_of_the_project_goes_before_that_of_the_clone(
    repository, tmp_path, monkeypatch
):
    for name in [name for name in os.environ if name.startswith("GIT_")]:
        monkeypatch.delenv(name)  # a hook of git names the repository that it runs for

    def address(*urls: str, root: Path = tmp_path) -> str | None:
        return repository.address(urls, root)

    assert address() is None  # no clone
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    assert address() is None  # of nothing
    subprocess.run(
        ["git", "remote", "add", "origin", "git@host.org:owner/name.git"], cwd=tmp_path, check=True
    )
    assert address("Home, https://host.org") == "https://host.org/owner/name"
    assert address("Home, https://host.org", "Repository, https://a.org/b") == "https://a.org/b"
    (tmp_path / "inner").mkdir()
    # the pages of a project that lies in another's repository
    assert address(root=tmp_path / "inner") is None
    monkeypatch.setenv("PATH", str(tmp_path))
    assert address() is None  # no git
    # where the page is no built one: headings are left as they are
    made = repository.linked(
        "## The repository\n\nThe repository holds the code.\n", "https://host.org/a?b&c"
    )
    assert made.startswith("## The repository\n")
    assert (
        '<a class="reference external" href="https://host.org/a?b&amp;c">The repository</a> holds'
        in made
    )
    assert repository.linked("The repository", None) == "The repository"


# -- the reference ---------------------------------------------------------------------------------


@cache
def interface_text() -> str:
    """The pages of the interface, one after the other."""
    import _generate

    return "\n".join(page.read_text(encoding="utf-8") for page in _generate.interface_pages())


@pytest.mark.parametrize("those", ["PLAIN", pytest.param("READ", marks=pytest.mark.exhaustive)])
def test_the_tables_of_the_reference_are_made_from_the_code(monkeypatch, those):
    """The plain ones, and those for which scenes are run."""
    monkeypatch.syspath_prepend(DOCS)
    import _generate

    made = _generate.texts([one.__name__ for one in getattr(_generate, those)])
    every = {one.__name__ for one in (*_generate.PLAIN, *_generate.READ)}
    assert every == {
        name
        for page in _generate.PAGES
        for name in _generate.marks(page.read_text(encoding="utf-8"))
    }
    for page, text in made.items():
        assert page.read_text(encoding="utf-8") == text, (
            f"{page.name} is out of date: run python docs/_generate.py"
        )


@pytest.mark.parametrize(
    "page", sorted((DOCS / "reference" / "api").glob("*.txt")), ids=lambda page: page.stem
)
def test_the_text_of_the_interface_is_that_of_the_code(monkeypatch, page):
    monkeypatch.syspath_prepend(DOCS)
    import _generate

    text = _generate.write_interface(page.with_suffix(".md"))
    assert page.read_text(encoding="utf-8") == text, (
        f"{page.name} is out of date: run python docs/_generate.py"
    )
    assert not re.search(r" at 0x|:\w+:`|<factory>", text)


def test_every_name_of_the_interface_is_in_its_text(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    import _generate

    pages = [page.with_suffix(".txt") for page in _generate.interface_pages()]
    whole = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    entries = set(re.findall(r"^granphon\.(?:\w+\.)*(\w+)\b", whole, re.MULTILINE))
    members = set(re.findall(r"^    \.(\w+)\b", whole, re.MULTILINE))
    for name, value, owner in interface():  # as the pages have them
        if owner is None or callable(value) or hasattr(value, "__get__"):
            assert name.rpartition(".")[2] in (members if owner else entries), name


def test_every_public_name_is_on_a_page_of_the_interface(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    listed = re.findall(
        r"^\.\. auto(?:class|function|exception):: granphon\.(\w+)$", interface_text(), re.MULTILINE
    )
    assert sorted(listed) == sorted(set(gp.__all__) - {"__version__"})


def test_every_column_of_measurements_is_in_the_page_on_fits():
    page = (DOCS / "how-to" / "velocities.md").read_text(encoding="utf-8")
    assert set(re.findall(r"`(\w+) \(", page)) >= set(measurements.COLUMNS)


def test_every_quantity_of_a_result_is_in_the_page_of_files():
    units = {
        **simulation.SimulatedState.units,
        **observables.SoundVelocities.units,
        **observables.Moduli.units,
    }
    del units["shears"], units["velocities"]  # of Python only
    page = (DOCS / "reference" / "files.md").read_text(encoding="utf-8")
    cells = re.findall(r"^\| (`\w+`[^|]*) \|", page.partition("## band.yaml")[0], re.MULTILINE)
    listed = dict(re.findall(r"`(\w+)`(?: \(([^)`]+)\))?", "\n".join(cells)))
    for name, unit in units.items():
        if name.endswith("_error") and name.removesuffix("_error") in units:
            unit = ""  # that of the quantity
        assert listed.get(name) == unit.removeprefix("1"), name
    for row in re.findall(r"^\| `.*", page, re.MULTILINE):
        assert row.count("|") >= 3, row  # none without a meaning


# -- the pages of the interface --------------------------------------------------------------------


def sections(text: str) -> dict[str, list[str]]:
    """The entries ``names : what`` of each section of a docstring, by its title."""
    parts = re.split(r"^(\w+)\n-+$", text, flags=re.MULTILINE)
    return {
        title: re.findall(r"^(\*{0,2}\w[\w*, ]*) : ", body, re.MULTILINE)
        for title, body in zip(parts[1::2], parts[2::2], strict=True)
    }


def definitions(node: ast.Module | ast.ClassDef | ast.FunctionDef) -> Iterator[Any]:
    """A module, or a class or function, and the classes and functions in it."""
    yield node
    for statement in node.body:
        if isinstance(statement, ast.ClassDef | ast.FunctionDef):
            yield from definitions(statement)


ROOMS = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))
ROOMS_WITHOUT_SECTIONS = ("cli", "laws")


@pytest.mark.parametrize("room", ROOMS)
def test_sections_of_docstrings_become_fields_whose_entries_are_all_there(monkeypatch, room):
    monkeypatch.syspath_prepend(DOCS)
    import _docstrings

    def role(error: str) -> str:
        return (
            f":exc:`~granphon.base.errors.{error}`" if hasattr(errors, error) else f":exc:`{error}`"
        )

    documented = [
        (f"{path.stem}.{getattr(node, 'name', '')}", ast.get_docstring(node))
        for path in sorted((PACKAGE / room).rglob("*.py"))
        if "---" in (source := path.read_text(encoding="utf-8"))
        for node in definitions(ast.parse(source))
        if "---" in (ast.get_docstring(node) or "")
    ]
    assert documented or room in ROOMS_WITHOUT_SECTIONS
    for name, text in documented:
        made = "\n".join(_docstrings.rendered(text.splitlines()))
        assert re.findall(r"^:(\w+):$", made, re.MULTILINE) == list(sections(text)), name
        assert not re.search(r"^-{3,}$|:raises", made, re.MULTILINE), name
        drawn = [
            line.partition(" – ")[0].strip(" -")
            for line in made.splitlines()
            if line.startswith("    - ")
        ]
        expected = [
            ", ".join(
                role(n) if title in ("Raises", "Warns") else f"**{n}**" for n in names.split(", ")
            )
            for title, entries in sections(text).items()
            for names in entries
        ]
        assert [line.replace("\\*", "*") for line in drawn] == expected, name


#: what an entry of these pages may say of a quantity: its unit, its shape, or that it is a pure
#: number
_UNIT = r"N|m|Pa|Hz|s|kg|J|rad|SI|k|d|W|M|x|y|q|eta|0|1|zero|one|bytes|degrees"
_PURE = (
    r"[Ff]ractions?|[Pp]art|[Rr]atio|[Nn]umbers?|reduced|relative|divided by|over the"
    r" mean|probability|without a unit|"
    r"standard error|pieces|units?|matplotlib|shape"
)
_QUANTITY = re.compile(
    rf"\b(?:{_UNIT}|{_PURE})\b|\(\w+(?:, ?[\w.]+)*,?\)|\(\.\.\.|:(?:meth|attr|func):"
)
_HAS_NUMBERS = re.compile(r"\b(?:Array|ArrayLike|Values|NDArray|float|Any)\b")


def interface() -> Iterator[tuple[str, Any, Any]]:
    """Names of the pages of the interface as autodoc takes them: where, the name itself, and what
    owns it, or None.
    """
    import _docstrings
    import conf

    cut = set(conf.autodoc_default_options["inherited-members"].split(", "))
    entry = r"^\.\. auto(?:class|function|exception):: (\S+)\.(\w+)\n((?:   :.*\n)*)"
    for module, name, options in re.findall(entry, interface_text(), re.MULTILINE):
        one = getattr(import_module(module), name)
        left_out = {
            word
            for words in re.findall(r":exclude-members: (.*)", options)
            for word in words.split(", ")
        }
        yield name, one, None
        for member in dir(one) if isinstance(one, type) else ():
            owner = next(base for base in one.__mro__ if member in vars(base))
            inner = member.startswith("_") or member in _docstrings.INNER | left_out
            if (
                not inner
                and owner.__module__.startswith("granphon")
                and (owner is one or owner.__name__ not in cut)
            ):
                yield f"{name}.{member}", inspect.getattr_static(one, member), one


def lacks(where: str, one: Any, owner: Any) -> Iterator[str]:
    """What the entry of a name of the interface does not say."""
    function = (
        one.fget
        if isinstance(one, property)
        else getattr(one, "func", getattr(one, "__func__", one))
    )
    if isinstance(one, type):
        texts = [base.__doc__ or "" for base in one.__mro__ if base is not object]
        entries = [
            each
            for text in texts
            for names in sections(inspect.cleandoc(text)).values()
            for each in names
        ]
        said = {name for each in entries for name in each.split(", ")}
        for field in inspect.signature(one).parameters if dataclasses.is_dataclass(one) else ():
            if not field.startswith("_") and field not in said:
                yield f"{where} does not say what its field {field} is"
    elif inspect.isfunction(function):
        text = (
            inspect.getdoc(getattr(owner, where.split(".")[1]))
            if owner
            else inspect.getdoc(function)
        )
        hints = {
            name: str(hint)
            for name, hint in function.__annotations__.items()
            if _HAS_NUMBERS.search(str(hint))
        }
        if not text:
            yield f"{where} has no docstring"
        elif hints and not _QUANTITY.search(text):
            yield f"{where} says neither the unit nor the shape of {', '.join(hints)}"
        for name in hints.keys() - {"return"}:
            if not re.search(rf"\b{name}\b", f"{text} {inspect.getdoc(owner) if owner else ''}"):
                yield f"{where} does not say what {name} is"


def test_every_name_of_the_interface_says_shapes_or_units(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    names = list(interface())
    assert len(names) > 500
    assert "\n".join(wrong for name in names for wrong in lacks(*name)) == ""


#: types that are returned as one that is listed: the same attributes, found in another way
STAND_INS = {"PressedEquilibrium", "TrueEquilibrium"}


def test_every_type_that_is_returned_is_on_a_page(monkeypatch):
    """Return annotations of functions and properties, and the fields of results."""
    monkeypatch.syspath_prepend(DOCS)
    listed = (
        set(re.findall(r"^\.\. (?:auto|py:)\w+:: \S+\.(\w+)$", interface_text(), re.MULTILINE))
        | STAND_INS
    )
    ours = {
        name
        for path in PACKAGE.rglob("*.py")
        for name in re.findall(r"^\s*class ([^_]\w*)", path.read_text(), re.MULTILINE)
    }
    for name in interface_text().split(".. automodule:: ")[1:]:
        listed |= set(vars(import_module(name.split()[0])))
    left_out = {
        word
        for words in re.findall(r":exclude-members: (.*)", interface_text())
        for word in words.split(", ")
    }
    missing = set()
    for where, one, _ in interface():
        function = (
            one.fget
            if isinstance(one, property)
            else getattr(one, "func", getattr(one, "__func__", one))
        )
        returned = getattr(function, "__annotations__", {}).get("return", "")
        missing |= {
            (where, name) for name in re.findall(r"\w+", str(returned)) if name in ours - listed
        }
        for field in (
            dataclasses.fields(one)
            if dataclasses.is_dataclass(one) and isinstance(one, type)
            else ()
        ):
            if field.name not in left_out and not field.name.startswith("_"):
                missing |= {
                    (f"{where}.{field.name}", n)
                    for n in re.findall(r"\w+", str(field.type))
                    if n in ours - listed
                }
    assert missing == set()


def test_a_name_without_shapes_and_units_is_found():
    def speak(force: float) -> float:
        """Return the velocity."""
        return force

    @dataclasses.dataclass
    class State:
        """A state.

        Attributes
        ----------
        force : of a contact, N.
        """

        force: float
        overlap: float

    assert list(lacks("speak", speak, None)) == [
        "speak says neither the unit nor the shape of force, return",
        "speak does not say what force is",
    ]
    assert list(lacks("State", State, None)) == ["State does not say what its field overlap is"]


# -- pictures ------------------------------------------------------------------------------------


def test_every_picture_has_its_source_and_is_on_a_page():
    source = ast.parse((DOCS / "_images.py").read_text(encoding="utf-8"))
    (made,) = [
        one.value
        for one in source.body
        if isinstance(one, ast.AnnAssign) and ast.unparse(one.target) == "IMAGES"
    ]
    assert isinstance(made, ast.Dict)
    there = sorted(path.stem for path in (DOCS / "images").iterdir())
    assert sorted(ast.literal_eval(key) for key in made.keys if key) == there
    shown = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert [name for name in there if f"images/{name}.png)" not in shown] == []
