"""Links that no page has to write: from a word to its row of the glossary, and from a claim to its
place on a page.

A claim is marked on its page by a comment, ``<!-- claim: ID -->``, and listed by its id in the page
on validation.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_GLOSSARY = "reference/glossary"
_VALIDATION = "reference/validation"
_HERE = Path(__file__).resolve().parent
_CLAIM = re.compile(r"<!-- claim: ([a-z0-9-]+) -->")
#: pages whose words are not linked: they are lists, or made by a program
_PLAIN = (
    _GLOSSARY,
    _VALIDATION,
    "gallery/",
    "reference/api",
    "index",
    "genindex",
    "development",
    "errata",
)


def terms(text: str) -> list[str]:
    """The terms of the glossary, in its order."""
    (table,) = re.findall(r"<!-- glossary -->\n(.*?)<!-- end -->", text, re.DOTALL)
    return re.findall(r"^\| ([^|]+?) \|", table, re.MULTILINE)[1:]


def slug(term: str) -> str:
    """The anchor of a term."""
    return "term-" + term.lower().replace(" ", "-")


def read(app: Any, page: str, source: list[str]) -> None:
    """For ``source-read``: put an anchor at each term and each claim, and link each row of the
    validation to its claim.
    """
    if page == _GLOSSARY:
        for term in terms(source[0]):
            source[0] = source[0].replace(
                f"\n| {term} |", f'\n| <span id="{slug(term)}"></span>{term} |', 1
            )
    elif page == _VALIDATION:
        source[0] = link_claims(source[0])
    else:
        source[0] = _CLAIM.sub(r'<span id="claim-\1"></span>', source[0])


def link_claims(text: str) -> str:
    """Link the id of each row to where the claim stands; the heading above it links to the page."""
    page = ""
    lines = []
    for line in text.splitlines():
        if line.startswith("### "):
            target = re.search(r"\]\(([^)]+)\.md\)", line)
            page = f"{target[1]}.html" if target else ""
        row = re.match(r"\| ([a-z0-9-]+) (\|.*)", line)
        linked = page and row and row[1] != "id"
        lines.append(
            f'| <a href="{page}#claim-{row[1]}">{row[1]}</a> {row[2]}' if linked and row else line
        )
    return "\n".join(lines) + "\n"


def link_terms(app: Any, tree: Any, page: str) -> None:
    """For ``doctree-resolved``: link the first place of each term in the paragraphs of a page to
    its row.
    """
    if page.startswith(_PLAIN):
        return
    from docutils import nodes

    words = sorted(
        terms((_HERE / f"{_GLOSSARY}.md").read_text(encoding="utf-8")), key=len, reverse=True
    )
    address = app.builder.get_relative_uri(page, _GLOSSARY)
    for text in list(tree.findall(nodes.Text)):
        above = list(_above(text))
        kinds = (
            nodes.reference,
            nodes.literal,
            nodes.title,
            nodes.literal_block,
            nodes.math,
            nodes.table,
            nodes.image,
        )
        if (
            not words
            or not any(isinstance(node, nodes.paragraph) for node in above)
            or any(isinstance(node, kinds) for node in above)
        ):
            continue
        parts: list[Any] = []
        remaining = str(text)
        while words:
            match = re.search(_pattern(words), remaining, re.IGNORECASE)
            if match is None:
                break
            phrase = " ".join(match[0].lower().split())
            word = next(word for word in words if phrase.startswith(word.lower()))
            words.remove(word)
            link = nodes.reference(
                "",
                match[0],
                refuri=f"{address}#{slug(word)}",
                classes=["glossary-term"],
                internal=True,
            )
            parts += [nodes.Text(remaining[: match.start()]), link]
            remaining = remaining[match.end() :]
        if parts:
            text.parent.replace(text, [*parts, nodes.Text(remaining)])


def _pattern(words: list[str]) -> str:
    """One of the words, or its plural; a line may end between two parts of a word."""
    patterns = [re.escape(word).replace("\\ ", "\\s+") for word in words]
    return rf"\b(?:{'|'.join(patterns)})(?:s|es)?\b"


def _above(node: Any) -> Iterator[Any]:
    while node.parent is not None:
        node = node.parent
        yield node
