import math
import re
import sys
from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from granphon.base.errors import InputError, MissingPackageError, SceneError
from granphon.base.text import (
    closest,
    dump_yaml,
    parse_yaml,
    plain_yaml,
    read_text,
    require_own_file,
    show,
    versions,
    write_float,
)
from tests.conftest import EXAMPLES

# -- reading ---------------------------------------------------------------------------------------


def test_parsed_data_and_lines() -> None:
    document = parse_yaml("a: 1\nb:\n  c: [x, 2.5, true]\n  'd e': ~\n", "t.yaml")
    assert document.data == {"a": 1, "b": {"c": ["x", 2.5, True], "d e": None}}
    assert document.line(("a",)) == 1
    assert document.line(("b", "c")) == 3
    assert document.line(("b", "d e")) == 4
    assert document.line(("b", "missing")) == 2
    assert str(document.error(("b", "c"), "found it")) == "t.yaml:3: b.c: found it."


@pytest.fixture(params=["libyaml", "Python"])
def parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """PyYAML with the parser of libyaml, and with its own, which it has where libyaml is not
    installed.
    """
    if request.param == "Python":
        monkeypatch.delattr("yaml.CSafeLoader")


def read_both(text: str, name: str = "t") -> object:
    """The data of a text, which a scene and a result must have alike."""
    data = parse_yaml(text, name).data
    assert repr(plain_yaml(text, name)) == repr(data)
    return data


#: what YAML 1.1 and 1.2, or its readers, take for different things
VALUES = {
    "1e-3": 1e-3,
    "1e5": 1e5,
    "1E5": 1e5,
    "1.": 1.0,
    ".5": 0.5,
    "-.5e3": -500.0,
    "1e400": math.inf,
    "0.0": 0.0,
    "-0": 0,
    "-0.0": -0.0,
    "-7": -7,
    "+7": 7,
    "007": 7,
    "010": 10,
    "9" * 400: 10**400 - 1,
    "9" * 640: 10**640 - 1,
    "0x10": "0x10",
    "0o17": "0o17",
    "0b11": "0b11",
    "1_000": "1_000",
    "1,000": "1,000",
    "12:30": "12:30",
    "12:30:45": "12:30:45",
    "12:30:45.5": "12:30:45.5",
    "1/3": "1/3",
    "e5": "e5",
    "1e": "1e",
    "0.1.2": "0.1.2",
    "--1": "--1",
    "1 2": "1 2",
    "2002-01-01": "2002-01-01",
    "2001-01-01 10:00:00": "2001-01-01 10:00:00",
    "true": True,
    "False": False,
    "TRUE": True,
    "tRue": "tRue",
    "yes": "yes",
    "No": "No",
    "on": "on",
    "OFF": "OFF",
    "y": "y",
    "n": "n",
    "null": None,
    "Null": None,
    "NULL": None,
    "nUll": "nUll",
    "~": None,
    ".inf": math.inf,
    "-.INF": -math.inf,
    "+.Inf": math.inf,
    ".nan": math.nan,
    ".NaN": math.nan,
    "+.nan": "+.nan",
    "<<": "<<",
    "=": "=",
    "'1'": "1",
    '"1e3"': "1e3",
    "'it''s'": "it's",
    "''": "",
    '"\\u00b5m"': "µm",
    '"\\x41\\/\\t"': "A/\t",
    '"\\U0001f600"': "\U0001f600",
    "8 mm # of steel": "8 mm",
    "a#b": "a#b",
    "{u: http://x/y}": {"u": "http://x/y"},
    "[a, b: c]": ["a", {"b": "c"}],
    "[1, 2,]": [1, 2],
    "[12:30, a:b]": ["12:30", "a:b"],
    "{a: 12:30}": {"a": "12:30"},
    '{"a":1}': {"a": 1},
    "{a, b}": {"a": None, "b": None},
    "{a: , b: }": {"a": None, "b": None},
    "{1: 2, yes: no}": {"1": 2, "yes": "no"},
    "{<<: {a: 1}}": {"<<": {"a": 1}},
    "[[], {}]": [[], {}],
    "|\n  x\n  y\n": "x\ny\n",
    "|2\n   x\n": " x\n",
    "|-\n  1\n": "1",
    ">\n  x\n  y\n\n  z\n": "x y\nz\n",
    "x\n  y": "x y",
    "'x\n\n  y'": "x\ny",
    "\u20ac \U0001f600": "\u20ac \U0001f600",
}


@pytest.mark.usefixtures("parser")
@pytest.mark.parametrize("text", VALUES)
def test_values_follow_yaml_12(text: str) -> None:
    value = VALUES[text]
    for document, data in (
        (f"a: {text}\nb: 1", {"a": value, "b": 1}),
        (f"a:\n- {text}\n- 2\n", {"a": [value, 2]}),
        (f"{text}\n", value),
    ):
        assert repr(read_both(document)) == repr(data)


@pytest.mark.usefixtures("parser")
@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("--- \na: 1\n...\n", {"a": 1}),
        ("---\n...\n", None),
        ("%YAML 1.1\n---\na: on\nb: 010\n", {"a": "on", "b": 10}),
        ("%YAML 1.2\n---\na: on\n", {"a": "on"}),
        ("a:\n- 1\n- 2\nb: 3", {"a": [1, 2], "b": 3}),
        ("- - 1\n  - 2\n", [[1, 2]]),
        ("- a: 1\n  b: 2\n", [{"a": 1, "b": 2}]),
        ("? a\n: 1\n", {"a": 1}),
        ("'a' : 1\n", {"a": 1}),
        ("a:1", "a:1"),
        ("\ufeffa: 1", {"a": 1}),
        ("a: 1\r\nb: 2\r\n", {"a": 1, "b": 2}),
        ("a: 1\rb: 2", {"a": 1, "b": 2}),
        ("<<: {a: 1}\nb: 2", {"<<": {"a": 1}, "b": 2}),
        ("on: 1\n010: 2\n1e3: 3\n~: 4\n", {"on": 1, "010": 2, "1e3": 3, "~": 4}),
        ("a:\n\n\n", {"a": None}),
        ("a:\nb: [c: ]", {"a": None, "b": [{"c": None}]}),
        ("a: b'c\"d\n", {"a": "b'c\"d"}),
        ("[" * 12 + "]" * 12, [[[[[[[[[[[[]]]]]]]]]]]]),
    ],
)
def test_documents(text: str, data: object) -> None:
    assert repr(read_both(text)) == repr(data)


@pytest.mark.usefixtures("parser")
def test_lines_of_keys_and_items() -> None:
    text = (
        "# c\n\na: 1 # d\nb:\n\n  # e\n  c: |\n    x\n\n    y\n  d: {e: 1,\n    f: [2,\n 3]}\ng:"
        " 'x\n\n  y'\n"
    )
    text += "h:\n- 1\n- i: 2\n  j:\nk:\n"
    assert parse_yaml(text, "t").lines == {
        (): 3,
        ("a",): 3,
        ("b",): 4,
        ("b", "c"): 7,
        ("b", "d"): 11,
        ("b", "d", "e"): 11,
        ("b", "d", "f"): 12,
        ("b", "d", "f", 0): 12,
        ("b", "d", "f", 1): 13,
        ("g",): 14,
        ("h",): 17,
        ("h", 0): 18,
        ("h", 1): 19,
        ("h", 1, "i"): 19,
        ("h", 1, "j"): 20,
        ("k",): 21,
    }


@pytest.mark.usefixtures("parser")
@pytest.mark.parametrize(
    ("text", "line", "found"),
    [
        ("", 1, "empty text"),
        ("# only a comment\n", None, "empty text"),
        ("a: 1\na: 2", 2, "twice (first on line 1)"),
        ("a: 1\nb:\n  c: 1\n  d: 2\n  c: 3", 5, "b.c: found the key twice"),
        ("a: 1\nb: [1, 2\nc: 3\n", None, "broken YAML"),
        ("a: 1\nb: c: d", 2, "broken YAML, mapping values"),
        ("a: 1\n\tb: 2", 2, "broken YAML"),
        ("a: 'x", None, "broken YAML"),
        ('a: "\\q"', 1, "broken YAML"),
        ('a: "\\U00110000"', 1, "broken YAML"),
        (
            "a: 1\nb: !!python/object:os.system echo",
            2,
            "b: found the tag 'tag:",
        ),
        ("a: !foo 1", 1, "a: found the tag '!foo'"),
        ("a: !!str 1", 1, "a: found the tag"),
        ("!!map {a: 1}", 1, "found the tag"),
        ("!x a: 1", 1, "found the tag"),
        ("%TAG ! tag:x,2000:\n---\na: !foo 1\n", 3, "a: found the tag"),
        ("a: &x 1", 1, "a: found an anchor"),
        ("a: 1\nb: *a", 2, "b: found an anchor"),
        ("a: &x [&y [&z [1, 1], *z], *y]", 1, "found an anchor"),
        ("a: &a [*a]", 1, "found an anchor"),
        ("a: 1\n---\nb: 2", 2, "second document"),
        ("? [a]\n: 1", 1, "found a list"),
        ("[a]: 1\n", 1, "found a list"),
        ("a: {[b]: 1}\n", 1, "a: found a list"),
        ("a: 1\nb: \x00", 2, "found the character '\\x00'"),
        ("a: \x1b[31m", 1, "found the character '\\x1b'"),
        ("a: \ud800", 1, "found the character '\\ud800'"),
        ("a: 1 # \u2028 b: 2", 1, "found the character '\\u2028'"),
        ("a: 1\nb: 1 # \x85c: 2", 2, "found the character '\\x85'"),
        ("a: " + "[" * 40 + "]" * 40, 1, "levels of nesting"),
        ("a: " + "[" * 20_000, 1, "levels of nesting"),
        ("a: " + "{b: " * 40, 1, "levels of nesting"),
        ("[" * 13 + "]" * 13, 1, "12 levels"),
        ("[" * 100_000, 1, "12 levels"),
    ],
)
def test_refused_text(text: str, line: int | None, found: str) -> None:
    with pytest.raises(SceneError) as caught:
        parse_yaml(text, "t.yaml")
    message = str(caught.value)
    assert found in message
    assert "allowed: " in message
    assert message.startswith("t.yaml:" if line is None else f"t.yaml:{line}: ")
    assert "\n" not in message
    # and of a result in the same words, but for where a key stands first, and what there should be
    with pytest.raises(InputError) as caught:
        plain_yaml(text, "t.yaml")
    assert (
        str(caught.value).split("; ")[0] == re.sub(r" \(first on .*?\)", "", message).split("; ")[0]
    )


@pytest.mark.usefixtures("parser")
@pytest.mark.parametrize("escape", ["\\0", "\\x07", "\\ud800"])
def test_a_scene_holds_no_odd_characters_as_escapes_either(escape: str) -> None:
    for text, where in ((f'b: 1\na: "{escape}"', "2: (a: )?"), (f'b: 1\n"{escape}": 1', "2: ")):
        with pytest.raises(
            SceneError,
            match=rf"^t:{where}(found the character|broken YAML)",
        ):
            parse_yaml(text, "t")


@given(
    st.text(alphabet=st.sampled_from(list("ab:-[]{}&*!|>'\"%@`#,? \n\t0.~\\xu\x85<=")), max_size=60)
)
def test_any_text_is_read_or_refused(text: str) -> None:
    with suppress(SceneError):
        parse_yaml(text, "t")


def test_read_text_takes_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\n")
    assert parse_yaml(read_text(path), "s").data == {"a": 1}


def test_a_missing_package_is_no_fault_of_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "yaml", None)
    missing = pytest.raises(MissingPackageError, match="needs yaml")
    with missing, require_own_file("band.yaml", "band.yaml"):
        plain_yaml("a: 1\n", "band.yaml")


def test_closest() -> None:
    assert closest("diametre", ["diameter", "density"]) == "diameter"
    assert closest("GPA", ["MPa", "GPa"]) == "GPa"
    assert closest("zzz", ["diameter"]) is None


# -- writing ---------------------------------------------------------------------------------------

#: words, and any other text
keys = st.from_regex(r"k[a-z]{0,5}", fullmatch=True) | st.text(
    st.characters(codec="utf-8"), max_size=8
)
plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text(st.characters(codec="utf-8"), max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner, max_size=3),
    max_leaves=10,
)


@settings(max_examples=EXAMPLES // 3)
@example({"a: b": 1, "yes": {"#": [{"": None}]}})
@given(st.dictionaries(keys, plain, min_size=1, max_size=4))
def test_dumped_yaml_is_read_back_by_another_reader(data: dict[str, object]) -> None:
    text = dump_yaml(data)
    assert yaml.safe_load(text) == plain_yaml(text, "x") == data


@pytest.mark.parametrize("value", [1e-5, 1e22, -1.5e300, 5e-324, 0.1])
def test_dumped_floats_are_floats_to_readers_of_yaml_11(value: float) -> None:
    read = yaml.safe_load(dump_yaml({"a": value}))["a"]
    assert isinstance(read, float)
    assert read == value


@given(st.floats())
@example(1e-6)
@example(-0.0)
def test_a_float_is_that_float_to_readers_of_yaml_11_and_12(value: float) -> None:
    text = write_float(value)
    assert repr(yaml.safe_load(text)) == repr(plain_yaml(text, "x")) == repr(value)


def test_versions_name_the_packages() -> None:
    import numpy as np

    assert versions("numpy")["numpy"] == np.__version__
    assert list(versions("numpy")) == ["granphon", "numpy"]


@pytest.mark.parametrize("count", [0, 8, 9, 1000])
def test_a_list_in_a_message_says_whether_more_follows(count):
    text = show([1] * count)
    assert text.count("1") == min(count, 8)
    assert ("..." in text) == (count > 8)
