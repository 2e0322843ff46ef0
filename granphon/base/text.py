"""Reading YAML together with its line numbers, and writing plain data as YAML.

Only plain YAML 1.2 is read: no tags, no anchors, no merging, every key once.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from numbers import Integral
from typing import Any

from granphon.base.errors import (
    InputError,
    MissingFileError,
    MissingSceneError,
    Refused,
    SceneError,
    SchemaError,
    brief,
    message,
)
from granphon.base.reading import plain_scalar, read_bytes

__all__ = [
    "Document",
    "closest",
    "counted",
    "dump_yaml",
    "parse_yaml",
    "read_text",
    "require_schema",
    "show",
    "versions",
]

#: the largest scene that is read or written as a text, bytes
MOST_SCENE_BYTES = 100_000
#: the deepest nesting of blocks and lists that is read
MAX_DEPTH = 12

#: characters that are refused in a text: control characters and lone surrogates
_ODD = re.compile(r"[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

#: words that readers of YAML 1.1 or 1.2 do not take for a text
_NO_TEXTS = {"true", "false", "yes", "no", "on", "off", "y", "n", "null"}

Path_ = tuple[str | int, ...]


# -- reading --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Document:
    """Plain data read from a text, and where in the text each key stands.

    Attributes
    ----------
    name : the name of the text in messages.
    data : mappings, lists, strings, numbers, booleans and None.
    lines : for the path of each key or list item its line, counted from 1.
    """

    name: str
    data: Any
    lines: Mapping[Path_, int] = field(repr=False)

    def line(self, path: Sequence[str | int]) -> int:
        """Line number of the key at ``path``, or of the nearest block around it."""
        for length in range(len(path), -1, -1):
            if tuple(path[:length]) in self.lines:
                return self.lines[tuple(path[:length])]
        return 1

    def error(self, path: Sequence[str | int], what: str) -> SceneError:
        """The error with the message ``what``, preceded by file, line and key."""
        key = ".".join(str(part) if str(part).isprintable() else repr(part) for part in path)
        return SceneError(f"{self.name}:{self.line(path)}: {key + ': ' if key else ''}{what}")


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a scene file; raises :class:`~granphon.base.errors.SceneError` if it cannot be read or exceeds 100 kB."""
    try:
        raw = read_bytes(path, MOST_SCENE_BYTES)
    except MissingFileError:
        raise MissingSceneError(message(f"{path}: there is no such file", mend="'granphon init' writes one")) from None
    except InputError as error:
        raise SceneError(str(error)) from None
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise SceneError(
            f"{path}:{line}: found the byte 0x{raw[error.start]:02x}, which is not text; allowed: text in UTF-8. "
            "Is this the right file?"
        ) from None


def parse_yaml(text: str, name: str) -> Document:
    """Read a YAML text.

    Only mappings, lists and plain values are taken; booleans are ``true`` and ``false`` (YAML 1.2), numbers have no
    underscores. Raises :class:`~granphon.base.errors.SceneError`, which names file and line, for broken YAML, an empty text,
    a second document, a key given twice, a tag (``!!python/object``), an anchor or alias, deep nesting, and control
    characters.
    """
    odd = _ODD.search(text)
    if odd:
        line = text.count("\n", 0, odd.start()) + 1
        raise SceneError(f"{name}:{line}: found the character {odd[0]!r}; allowed: printable text. Is this the right file?")
    return _Builder(text, name).build()


class _Builder:
    """Builds plain data from the events of the YAML parser; nothing in the text can name what is constructed."""

    def __init__(self, text: str, name: str) -> None:
        self.text, self.name = text, name
        self.lines: dict[Path_, int] = {}
        self.at = 1

    def build(self) -> Document:
        self.events = self._read_events()
        _, first = next(self.events), next(self.events)
        if type(first).__name__ == "StreamEndEvent":
            raise self._make_error("found an empty text", "a scene", "'granphon init' writes one")
        data = self._build_value((), 0)
        next(self.events)
        if type(next(self.events)).__name__ != "StreamEndEvent":
            raise self._make_error(
                "found a second document ('---')", "one document", "Put the second into a file of its own"
            )
        return Document(self.name, data, self.lines)

    def _read_events(self) -> Iterator[Any]:
        from ruamel.yaml import YAML
        from ruamel.yaml.error import MarkedYAMLError

        try:
            for event in YAML(typ="safe", pure=True).parse(self.text):
                self.at = event.start_mark.line + 1
                yield event
        except MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            self.at = mark.line + 1 if mark is not None else self.at
            raise self._make_error(
                f"broken YAML, {error.problem or error.context}", "YAML", _explain_problem(str(error.problem))
            ) from None
        except Exception as error:  # any other error of the parser is due to the text too
            raise self._make_error(f"broken YAML ({error})", "YAML") from None

    def _make_error(self, what: str, allowed: str, mend: str = "", at: int | None = None) -> SceneError:
        return SceneError(f"{self.name}:{at or self.at}: {what}; allowed: {allowed}." + (f" {mend}." if mend else ""))

    def _build_value(self, path: Path_, depth: int, event: Any = None) -> Any:
        event = event or next(self.events)
        kind = type(event).__name__
        self.lines.setdefault(path, self.at)
        where = ".".join(str(p) for p in path)
        where = f"{where}: " if where.isprintable() and where else ""
        if kind == "AliasEvent" or getattr(event, "anchor", None) is not None:
            raise self._make_error(f"{where}found an anchor or alias (& or *)", "plain values", "Write the value out")
        if getattr(event, "tag", None) is not None:
            raise self._make_error(f"{where}found the tag {show(str(event.tag))}", "plain values", "Leave the tag out")
        if depth > MAX_DEPTH:
            raise self._make_error(f"{where}found more than {MAX_DEPTH} levels of nesting", "the levels of a scene")
        if kind == "ScalarEvent":
            if odd := _ODD.search(event.value):
                raise self._make_error(f"{where}found the character {odd[0]!r}", "printable text")
            try:
                return plain_scalar(event.value) if event.implicit[0] else event.value
            except Refused as refused:
                raise self._make_error(f"{where}found {refused.found}", refused.allowed) from None
        if kind == "SequenceStartEvent":
            items: list[Any] = []
            while type(event := next(self.events)).__name__ != "SequenceEndEvent":
                items.append(self._build_value((*path, len(items)), depth + 1, event))
            return items
        mapping: dict[str, Any] = {}
        while type(event := next(self.events)).__name__ != "MappingEndEvent":
            if type(event).__name__ != "ScalarEvent":
                raise self._make_error(f"{where}found a list or block as a key", "a word")
            key, here = event.value, (*path, event.value)
            if key in mapping:
                raise self._make_error(
                    f"{'.'.join(map(str, here))}: found the key twice (first on line {self.lines[here]})",
                    "each key once", "Remove one of the two",
                )  # fmt: skip
            self._build_value(here, depth + 1, event)  # notes the key's line, and refuses a tag or anchor on the key
            mapping[key] = self._build_value(here, depth + 1)
        return mapping


def _explain_problem(problem: str) -> str:
    if "\\t" in problem or "tab" in problem:
        return "Indent with spaces"
    if "mapping values are not allowed" in problem:
        return "Check the indentation, and that each key has a line of its own"
    return ""


def show(value: Any) -> str:
    """A value as messages show it: at most 60 characters, on one line, without control characters."""
    if isinstance(value, Mapping):
        return "a block of keys"
    if isinstance(value, list | tuple):
        text = "[" + ", ".join(str(v) if isinstance(v, float) else brief(v) for v in value[:8]) + "]"
    elif value is None:
        return "nothing"
    elif isinstance(value, bool):
        return str(value).lower()
    else:
        return brief(value, 60)
    return text if len(text) <= 60 else text[:57] + "..."


def closest(word: str, options: Iterable[str]) -> str | None:
    """The one of ``options`` that was probably meant by ``word``; None if none is close."""
    known = list(options)
    same = [option for option in known if option.lower() == word.lower()]
    found = same or get_close_matches(word[:100], known, n=1, cutoff=0.6)
    return found[0] if found else None


def counted(number: int, one: str, many: str = "") -> str:
    """A number of things in words: "1 ball", "2 balls"; ``many`` is the plural if it is more than an s."""
    return f"{number} {one if number == 1 else many or one + 's'}"


# -- writing --------------------------------------------------------------------------------------------------------


def dump_yaml(data: Mapping[str, Any], indent: str = "") -> str:
    """Write ``data`` as YAML that readers of version 1.1 and 1.2 understand alike.

    Takes mappings, lists, strings, numbers, booleans, None and objects with ``tolist`` (numpy). Floats are written so that
    reading them gives the same bits.
    """
    out = []
    for key, value in data.items():
        plain = value.tolist() if hasattr(value, "tolist") else value
        if isinstance(plain, Mapping) and plain:
            out.append(f"{indent}{_write_key(key)}:\n{dump_yaml(plain, indent + '  ')}")
        elif isinstance(plain, list | tuple) and any(isinstance(v, list | tuple | Mapping) for v in plain):
            out.append(f"{indent}{_write_key(key)}:\n" + "".join(f"{indent}  - {_write_flow(v)}\n" for v in plain))
        else:
            out.append(f"{indent}{_write_key(key)}: {_write_flow(plain)}\n")
    return "".join(out)


def _write_key(key: Any) -> str:
    """A key, in quotes unless it is a word that is a text to every reader."""
    is_word = re.fullmatch(r"[A-Za-z_][A-Za-z0-9_.-]*", str(key)) and str(key).lower() not in _NO_TEXTS
    return str(key) if is_word else _write_flow(str(key))


def _write_flow(value: Any) -> str:
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_write_key(key)}: {_write_flow(v)}" for key, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_write_flow(v) for v in value) + "]"
    if isinstance(value, float):
        if not math.isfinite(value):
            return ".nan" if math.isnan(value) else (".inf" if value > 0 else "-.inf")
        text = repr(value)
        return text.replace("e", ".0e") if "e" in text and "." not in text else text
    text = json.dumps(value, ensure_ascii=False)
    return "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in text)


def versions(*packages: str) -> dict[str, str]:
    """The installed versions of granphon and of each of ``packages``, found without importing them."""
    from importlib.metadata import version

    from granphon import __version__

    return {"granphon": __version__} | {package: version(package) for package in packages}


def require_schema(what: object, found: Any, known: int) -> None:
    """Raise :class:`~granphon.base.errors.SchemaError` unless the schema ``found`` in ``what`` is the one ``known``."""
    if isinstance(found, bool) or not isinstance(found, Integral) or found != known:
        why = f"granphon {versions()['granphon']} reads and writes schema {known}"
        mend = "Read it with the version that wrote it, or make it again"
        raise SchemaError(message(f"{what} has the schema {show(found)}", why, mend))
