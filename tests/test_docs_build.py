"""The pages as they are built: types are links, names can be searched for, formulas need no
network.
"""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.page.browser import explain_missing, open_browser
from tests.test_docs import DOCS, ROOT, interface

#: a build takes some twenty seconds
pytestmark = [
    pytest.mark.exhaustive,
    pytest.mark.skipif(
        not all(
            map(
                find_spec,
                ("sphinx", "furo", "myst_parser", "sphinx_gallery", "sphinx-mathjax-offline"),
            )
        ),
        reason="the extra docs is not installed",
    ),
]

#: types that are no names of the package: of Python, numpy, ASE, xarray, matplotlib
_FOREIGN = {
    "Any",
    "Atoms",
    "Axes",
    "Callable",
    "Collection",
    "Dataset",
    "Executor",
    "False",
    "Figure",
    "FuncAnimation",
    "Iterable",
    "Iterator",
    "Literal",
    "Mapping",
    "None",
    "Path",
    "PathLike",
    "Self",
    "Sequence",
    "True",
    "AbstractContextManager",
    "Step",
    "Array",
    "ArrayLike",
    "BinaryIO",
    "ClassVar",
    "DataArray",
    "Warning",
    # of results that granphon alone makes
    "Faces",
    "Means",
    "Units",
}


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The pages, without running the examples."""
    folder = tmp_path_factory.mktemp("docs")
    shutil.copytree(
        DOCS, folder / "docs", ignore=shutil.ignore_patterns("gallery", "_build", "__pycache__")
    )
    (folder / "examples").symlink_to(ROOT / "examples", target_is_directory=True)
    for file in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff", "LICENSE"):
        shutil.copy(ROOT / file, folder)
    plain = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    for git in (
        (["init", "-q"], ["remote", "add", "origin", str(folder / "bare.git")])
        if shutil.which("git")
        else ()
    ):
        subprocess.run(["git", *git], cwd=folder, check=True, env=plain)
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-W",
        "--keep-going",
        "-D",
        "plot_gallery=0",
        "docs",
        "site",
    ]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, env=plain
    )
    assert done.returncode == 0, done.stderr
    return folder / "site"


def signatures(page: str) -> Iterator[tuple[str, str]]:
    """The name of each entry of a page, and its signature, in which what is a link is left out."""
    for entry, text in re.findall(r'<dt class="sig[^>]*? id="([^"]+)">(.*?)</dt>', page, re.DOTALL):
        text = re.sub(r"<a class=\"(?:reference|headerlink).*?</a>", "", text, flags=re.DOTALL)
        text = re.sub(
            r'<span class="default_value">.*?</span></span>|<span'
            r' class="sig-(?:pre)?name.*?</span></span>',
            "",
            text,
        )
        yield entry, html.unescape(re.sub(r"<[^>]+>", "", text))


@pytest.mark.skipif(shutil.which("git") is None, reason="there is no git on this machine")
def test_the_first_page_links_to_the_repository_that_it_was_built_from(site):
    address = (site.parent / "bare.git").as_uri()
    assert (site / "index.html").read_text(encoding="utf-8").count(
        f'<a class="reference external" href="{address}">'
    ) == 2


def interface_pages(site: Path) -> list[str]:
    """The text of the pages of the interface."""
    pages = [site / "reference" / "api.html", *sorted((site / "reference" / "api").glob("*.html"))]
    return [page.read_text(encoding="utf-8") for page in pages]


def test_types_of_the_interface_are_links(site):
    found = [one for page in interface_pages(site) for one in signatures(page)]
    assert len(found) > 700
    unknown = {}
    for name, signature in found:
        plain = re.sub(r"'[^']*'|= [\w.]+(?:\([^)]*\))?", "", signature)
        names = set(re.findall(r"(?<![\w.])[A-Z]\w+", plain)) - _FOREIGN - {name.rpartition(".")[2]}
        if names or re.search(r"~|ndarray|granphon\.\w+\.\w+\.\w+.*\(.*granphon\.", signature):
            unknown[name] = names or signature
    assert not unknown, "\n".join(f"{name}: {what}" for name, what in unknown.items())


def test_the_interface_has_no_markup_that_was_not_read(site):
    text = re.sub(r"<[^>]+>", "", "\n".join(interface_pages(site)))
    assert not re.search(r":\w+:`|``|:raises|:param|Parameters\n---", text)


def test_every_name_of_the_interface_can_be_searched_for(site, monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    objects = json.loads(index.removeprefix("Search.setIndex(").rstrip().removesuffix(")"))[
        "objects"
    ]
    listed = {f"{prefix}.{entry[4]}" for prefix, entries in objects.items() for entry in entries}
    ends = {".".join(name.split(".")[-2:]) for name in listed} | {
        name.rpartition(".")[2] for name in listed
    }
    assert "granphon.DirectSimulation.path" in listed
    assert "granphon.ContactState.force" in listed  # a field
    missing = [
        name
        for name, one, owner in interface()
        if name not in ends and (owner is None or callable(one) or isinstance(one, property))
    ]
    assert missing == []


def test_rows_of_the_validation_lead_to_their_claims(site):
    page = site / "reference" / "validation.html"
    links = re.findall(r'<a href="([^"#]+)#(claim-[a-z0-9-]+)">', page.read_text(encoding="utf-8"))
    assert links
    for target, anchor in links:
        assert f'id="{anchor}"' in (page.parent / target).read_text(encoding="utf-8"), (
            f"{target}#{anchor}"
        )


def test_terms_lead_to_their_rows(site):
    rows = set(
        re.findall(
            r'id="(term-[^"]+)"', (site / "reference" / "glossary.html").read_text(encoding="utf-8")
        )
    )
    linked = set()
    for page in site.rglob("*.html"):
        linked |= set(re.findall(r"glossary\.html#(term-[^\"]+)", page.read_text(encoding="utf-8")))
    assert linked <= rows
    assert linked


@pytest.mark.skipif(bool(explain_missing()), reason=explain_missing() or "-")
def test_pages_fit_the_screen_and_the_patience_of_a_reader(site):
    """No block of code is cut at its edge, no name in the first column of a table is broken, and no
    page is endless.
    """
    pages = [
        page
        for page in sorted(site.rglob("*.html"))
        if not {"_static", "gallery"} & set(page.parts)
    ]
    measure = """() => { const all = (chosen) => [...document.querySelectorAll(`article ${chosen}`)];
        return { blocks: all("pre").length, names: all("td:first-child code").length,
          cut: all("pre").filter((one) => one.scrollWidth > one.clientWidth).map((one) => one.textContent),
          broken: all("td:first-child code").filter((one) => one.getClientRects().length > 1).map((one) => one.textContent),
          height: document.documentElement.scrollHeight }; }"""
    with open_browser() as browser:
        tab = browser.new_page(viewport={"width": 1440, "height": 900})
        found = {}
        for page in pages:
            tab.goto(page.as_uri(), wait_until="load")
            found[page.relative_to(site).as_posix()] = tab.evaluate(measure)
    assert {name: one["cut"] for name, one in found.items() if one["cut"]} == {}
    assert {name: one["broken"] for name, one in found.items() if one["broken"]} == {}
    # the indices, and the table of all claims, are for searching in them
    indices = {"genindex.html", "py-modindex.html", "reference/validation.html"}
    assert {name for name, one in found.items() if one["height"] > 30_000} <= indices
    assert all(sum(one[part] for one in found.values()) for part in ("blocks", "names"))


@pytest.mark.skipif(bool(explain_missing()), reason=explain_missing() or "-")
def test_pages_and_their_formulas_need_no_network(site):
    pages = [page for page in sorted(site.rglob("*.html")) if "_static" not in page.parts]
    asked = set()
    errors = []
    formulas = 0
    with open_browser() as browser:
        tab = browser.new_context(offline=True).new_page()
        tab.on(
            "request",
            lambda request: asked.add(request.url) if request.url.startswith("http") else None,
        )
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on("requestfailed", lambda request: errors.append(f"{request.url}: {request.failure}"))
        for page in pages:
            tab.goto(page.as_uri(), wait_until="load")
            count = tab.locator(".math").count()
            if count:
                tab.evaluate("MathJax.startup.promise")
                assert tab.locator("mjx-container").count() == count, page.name
                assert tab.locator("mjx-merror, [data-mjx-error]").count() == 0, page.name
                formulas += count
            # the next page would break off what this one still loads; fonts are asked for when the
            # page is laid out
            tab.evaluate("[document.body.offsetHeight, document.fonts.ready.then(() => true)][1]")
    assert not asked
    assert not errors
    assert formulas
