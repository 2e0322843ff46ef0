"""Sections of docstrings as lists of fields: ``name : what it is``, where types are those of the signature."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from granphon.base import errors

#: a section's title, underlined
_TITLES = ("Parameters", "Attributes", "Returns", "Raises", "Warns", "Notes")
#: one name or several, and the first line of what they are
_ENTRY = re.compile(r"^(?P<names>\*{0,2}\w+(?:, \*{0,2}\w+)*) : (?P<text>.*)$")


def process(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """For ``autodoc-process-docstring``."""
    lines[:] = rendered(lines)


def rendered(lines: list[str]) -> list[str]:
    """The lines of a docstring as reStructuredText."""
    out: list[str] = []
    title, at = "", 0
    while at < len(lines):
        if lines[at] in _TITLES and at + 1 < len(lines) and re.fullmatch("-+", lines[at + 1]):
            title, at = lines[at], at + 2
            out += ["", f":{title}:", ""]
        elif title and lines[at].strip():
            end = next(_ends(lines, at))
            entry, rest = _ENTRY.match(lines[at]), lines[at + 1 : end]
            if entry:
                names = [_exception(n) if title in ("Raises", "Warns") else _bold(n) for n in entry["names"].split(", ")]
                out += [f"    - {', '.join(names)} – {entry['text']}", *(f"      {line.strip()}" for line in rest), ""]
            elif not lines[at - 1].strip() and title != "Notes":  # a paragraph after the section
                title = ""
                continue
            else:
                out += [f"    {line}" for line in lines[at:end]]
            at = end
        else:
            out.append(lines[at])
            at += 1
    return out


def _ends(lines: list[str], at: int) -> Iterator[int]:
    """Where the entry or the paragraph that begins ``at`` may end."""
    for end in range(at + 1, len(lines)):
        if not lines[end].startswith(" ") and (not lines[end].strip() or _ENTRY.match(lines[end])):
            yield end
    yield len(lines)


def _bold(name: str) -> str:
    return f"**{name.replace('*', chr(92) + '*')}**"


def _exception(name: str) -> str:
    return f":exc:`~granphon.base.errors.{name}`" if hasattr(errors, name) else f":exc:`{name}`"
