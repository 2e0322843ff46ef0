"""A document as HTML and as Markdown."""

from __future__ import annotations

import base64
from html.parser import HTMLParser

import pytest

from granphon.page.document import (
    Code,
    Items,
    Picture,
    Rows,
    Section,
    Text,
    write_html,
    write_markdown,
)

ROUGH = "a < b & *c* | `d` [e](f) <script>alert(1)</script> \\ #"
SECTIONS = [
    Section("one & two", [Text(ROUGH), Items((ROUGH, "plain"))]),
    Section("three", [Rows(("head | er", "x"), ((ROUGH, "1"), ("y", "2"))), Code("a: ```\n<b>\n")]),
    Section("four", [Picture("my figure.png", b"\x89PNG bytes", 'said "so"')]),
]


class Reader(HTMLParser):
    """What a browser finds on a page: names of elements, texts, and pictures."""

    def __init__(self):
        super().__init__()
        self.elements = []
        self.texts = []
        self.pictures = []

    def handle_starttag(self, tag, attrs):
        self.elements.append(tag)
        if tag == "img":
            self.pictures.append(dict(attrs))

    def handle_data(self, data):
        self.texts.append(data)


def test_the_page_holds_all_texts_and_pictures_and_runs_nothing():
    page = write_html("title <1>", SECTIONS)
    reader = Reader()
    reader.feed(page)
    assert "script" not in reader.elements
    assert reader.texts.count(ROUGH) == 3
    assert "title <1>" in reader.texts
    assert "a: ```\n<b>" in reader.texts
    (picture,) = reader.pictures
    kind, _, content = picture["src"].partition(",")
    assert kind == "data:image/png;base64"
    assert base64.b64decode(content) == b"\x89PNG bytes"
    assert picture["alt"] == 'said "so"'
    assert "default-src 'none'" in page
    assert reader.elements.count("td") == 4


def test_markdown_has_no_marks_from_texts_and_names_pictures():
    text = write_markdown("title", SECTIONS, "../out")
    lines = text.splitlines()
    assert lines[0] == "# title"
    assert "## one & two" in lines
    rows = [line for line in lines if line.startswith("| ")]
    # bars in cells are no borders
    assert {row.replace("\\|", "").count("|") for row in rows} == {3}
    assert "\\`d\\`" in text
    assert write_markdown("a &lt; ~~b~~", []) == "# a \\&lt; \\~\\~b\\~\\~\n"
    assert '![said "so"](../out/my%20figure.png)' in lines
    # the fence of a text is longer than those in the text
    assert lines.count("````") == 2


@pytest.mark.parametrize("write", [write_html, write_markdown])
def test_a_document_without_sections_has_its_title(write):
    assert "alone" in write("alone", [])
