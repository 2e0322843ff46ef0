"""A document of headings, texts, tables and pictures, as one page of HTML and as Markdown."""

from __future__ import annotations

import base64
import mimetypes
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from urllib.parse import quote

#: what is allowed on the page: its own style, and pictures that it holds
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
_STYLE = """\
body { font: 15px/1.45 system-ui, sans-serif; color: #1a1a1a; max-width: 60rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .15rem .8rem .15rem 0; text-align: left; vertical-align: top; }
th { border-bottom: 1px solid #999; font-weight: 600; }
.wide { overflow-x: auto; }
pre { background: #f4f4f4; padding: .7rem; overflow-x: auto; }
figure { margin: 1rem 0; } img { max-width: min(100%, 34rem); height: auto; }
figcaption { color: #444; }
@media print { body { margin: 0; max-width: none; } figure, tr { break-inside: avoid; } }"""
#: letters that have a meaning within a cell or a text of Markdown, each with the backslash that
#: takes the meaning away
_ESCAPES = str.maketrans({letter: f"\\{letter}" for letter in "\\`*_[]<>|#~"})
#: an "&" that begins a letter written as its name, such as "&lt;"
_ENTITY = re.compile(r"&(?=\w+;)")


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str

    def write_html(self) -> str:
        """Return the paragraph as HTML."""
        return f"<p>{escape(self.text)}</p>"

    def write_markdown(self) -> str:
        """Return the paragraph as Markdown."""
        return _mark(self.text)


@dataclass(frozen=True)
class Items:
    """A list of sentences."""

    items: tuple[str, ...]

    def write_html(self) -> str:
        """Return the list as HTML."""
        return "<ul>" + "".join(f"<li>{escape(item)}</li>" for item in self.items) + "</ul>"

    def write_markdown(self) -> str:
        """Return the list as Markdown."""
        return "\n".join(f"- {_mark(item)}" for item in self.items)


@dataclass(frozen=True)
class Code:
    """A text that stands as it is, such as a file, but for blanks and blank lines at its end."""

    text: str

    def write_html(self) -> str:
        """Return the text as HTML."""
        return f"<pre>{escape(self.text.rstrip())}</pre>"

    def write_markdown(self) -> str:
        """Return the text as Markdown, in a fence that is longer than any in the text."""
        fence = "```"
        while fence in self.text:
            fence += "`"
        return f"{fence}\n{self.text.rstrip()}\n{fence}"


@dataclass(frozen=True)
class Rows:
    """A table: its headings, and rows of as many cells."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def write_html(self) -> str:
        """Return the table as HTML."""
        head = _write_cells(self.headings, "th")
        body = "".join(f"<tr>{_write_cells(row, 'td')}</tr>" for row in self.rows)
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        return f'<div class="wide">{table}</div>'

    def write_markdown(self) -> str:
        """Return the table as Markdown."""
        lines = [_write_row(map(_mark, self.headings)), _write_row(["---"] * len(self.headings))]
        lines += [_write_row(map(_mark, row)) for row in self.rows]
        return "\n".join(lines)


@dataclass(frozen=True)
class Picture:
    """A picture: the name of its file, the bytes of the file, and what it shows."""

    name: str
    data: bytes
    caption: str

    def write_html(self) -> str:
        """Return the picture as HTML that holds its bytes."""
        # a browser tells the kind of a picture by the bytes, whatever is said of an unknown name
        kind = mimetypes.guess_type(self.name)[0] or "image/png"
        content = base64.b64encode(self.data).decode("ascii")
        caption = escape(self.caption)
        image = f'<img src="data:{kind};base64,{content}" alt="{escape(self.caption)}">'
        return f"<figure>{image}<figcaption>{caption} ({escape(self.name)})</figcaption></figure>"

    def write_markdown(self, folder: str = "") -> str:
        """Return the picture as Markdown, which names its file in a ``folder``."""
        return f"![{_mark(self.caption)}]({_join_path(folder, self.name)})"


@dataclass(frozen=True)
class Link:
    """A sentence that ends in the name of a file beside the results, with a link to it."""

    text: str
    name: str

    def write_html(self, folder: str = "") -> str:
        """Return the sentence as HTML, whose link leads to the file in a ``folder``."""
        link = f'<a href="{_join_path(folder, self.name)}">{escape(self.name)}</a>'
        return f"<p>{escape(self.text)} {link}.</p>"

    def write_markdown(self, folder: str = "") -> str:
        """Return the sentence as Markdown, whose link leads to the file in a ``folder``."""
        return f"{_mark(self.text)} [{_mark(self.name)}]({_join_path(folder, self.name)})."


#: a part of a section
Block = Text | Items | Code | Rows | Picture | Link


@dataclass(frozen=True)
class Section:
    """A heading, and the blocks below it."""

    title: str
    blocks: Sequence[Block]


def write_html(title: str, sections: Iterable[Section], folder: str = "") -> str:
    """Return the sections as one page of HTML, which needs no other file and runs no program. Links
    lead to files in a ``folder``: a path from the page, empty for files beside the page.
    """
    pieces = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{escape(title)}</h1>",
    ]
    for section in sections:
        pieces.append(f"<h2>{escape(section.title)}</h2>")
        for block in section.blocks:
            if isinstance(block, Link):
                pieces.append(block.write_html(folder))
            else:
                pieces.append(block.write_html())
    return "\n".join([*pieces, "</body></html>", ""])


def write_markdown(title: str, sections: Iterable[Section], folder: str = "") -> str:
    """Return the sections as Markdown. Pictures and links lead to files in a ``folder``: a path
    from the text, empty for files beside the text. The text holds no bytes of pictures.
    """
    pieces = [f"# {_mark(title)}"]
    for section in sections:
        pieces.append(f"## {_mark(section.title)}")
        for block in section.blocks:
            if isinstance(block, Picture | Link):
                pieces.append(block.write_markdown(folder))
            else:
                pieces.append(block.write_markdown())
    return "\n\n".join(pieces) + "\n"


def _join_path(folder: str, name: str) -> str:
    """Return the address of a file in a ``folder``, which may be empty."""
    return quote("/".join(filter(None, [folder, name])))


def _mark(text: str) -> str:
    """Return a text of Markdown on one line, in which the letters that mark emphasis, code, links,
    headings and cells, and names of letters such as "&lt;", stand for themselves.
    """
    return _ENTITY.sub(r"\\&", " ".join(text.split()).translate(_ESCAPES))


def _write_cells(cells: Sequence[str], tag: str) -> str:
    """Return the cells of one row of a table as HTML, each in the element ``tag``, th or td."""
    return "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells)


def _write_row(cells: Iterable[str]) -> str:
    """Return one row of a table as Markdown; ``cells`` are texts of Markdown."""
    return f"| {' | '.join(cells)} |"
