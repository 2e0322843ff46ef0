"""Reading YAML that is plain data, with its line numbers, and writing plain data as YAML.

Only plain YAML 1.2 is read: no tags, no anchors, no merging, every key once.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
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
from granphon.base.reading import decode, read_bytes, read_utf8

#: the largest scene that is read or written as a text, bytes
MOST_SCENE_BYTES = 100_000
#: the deepest nesting of blocks and lists that is read
MAX_DEPTH = 12
#: what is found and allowed where the nesting is deeper
_TOO_DEEP = f"found more than {MAX_DEPTH} levels of nesting", "plain data"
#: the most digits of a whole number: as many as Python converts whatever its own limit is, and more than a float has
_MOST_DIGITS = 640

#: characters that are refused in a scene: control characters and lone surrogates
_ODD = re.compile(r"[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
#: and, where they are no escapes, in every text: also what ends a line in YAML 1.1 alone
_ODD_IN_TEXTS = re.compile(_ODD.pattern + r"|[\x85\u2028\u2029]")
_NULL = re.compile(r"(?:|~|null|Null|NULL)")
_TRUTH = re.compile(r"true|True|TRUE|false|False|FALSE")
_WHOLE = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")

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
        return decode(str(path), read_bytes(path, MOST_SCENE_BYTES))
    except MissingFileError:
        raise MissingSceneError(message(f"{path}: there is no such file", mend="'granphon init' writes one")) from None
    except InputError as error:
        raise SceneError(str(error)) from None


def parse_yaml(text: str, name: str) -> Document:
    """Read the YAML of a scene, as :func:`plain_yaml` does, with the line of each key.

    Raises :class:`~granphon.base.errors.SceneError`, also for escapes that stand for control characters.
    """
    lines: dict[Path_, int] = {}
    try:
        return Document(name, _Builder(text, name, lines).build(), lines)
    except InputError as error:
        raise SceneError(str(error)) from None


def read_yaml(path: str | os.PathLike[str]) -> Any:
    """The data of a YAML file, read as :func:`plain_yaml` does."""
    return plain_yaml(read_utf8(path), path)


def plain_yaml(text: str, path: str | os.PathLike[str]) -> Any:
    """The data of a YAML text: mappings, lists, strings, numbers, booleans and None, nothing else.

    Plain values are those of YAML 1.2, see :func:`plain_scalar`. Raises :class:`~granphon.base.errors.InputError`, which
    names file and line, for broken YAML, an empty text, a second document, a key given twice, a list or block as a key, a
    tag (``!!python/object``), an anchor or alias, deep nesting, and control characters.
    """
    return _Builder(text, str(path)).build()


class _Builder:
    """Builds plain data from the events of PyYAML's parser; nothing in the text can name what is constructed.

    ``lines`` is given for a scene, and takes the line of each key and item; it costs time where there are millions.
    """

    def __init__(self, text: str, name: str, lines: dict[Path_, int] | None = None) -> None:
        self.text, self.name, self.lines = text, name, lines
        self.path: list[str | int] = []
        self.at: int | None = None
        self.event: Any = None

    def build(self) -> Any:
        import yaml

        if odd := _ODD_IN_TEXTS.search(self.text):
            self.at = self.text.count("\n", 0, odd.start()) + 1
            raise self._make_error(f"found the character {odd[0]!r}", "printable text", "Is this the right file?")
        # libyaml, where it is installed, reads the same events about ten times faster
        self.events = yaml.parse(self.text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        self.kinds = yaml.ScalarEvent, yaml.SequenceStartEvent, yaml.SequenceEndEvent, yaml.MappingEndEvent
        try:
            self._read_event()
            if not isinstance(self._read_event(), yaml.DocumentStartEvent):
                scene = ("a scene", "'granphon init' writes one") if self.lines is not None else ("plain data",)
                raise self._make_error("found an empty text", *scene)
            data = self._build_value(self._read_event())
            self._read_event()
            if not isinstance(self._read_event(), yaml.StreamEndEvent):
                mend = "Put the second into a file of its own"
                raise self._make_error("found a second document ('---')", "one document", mend)
        except InputError:
            raise
        except Exception as error:  # of the parser, which is due to the text
            mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
            if mark is not None:
                self.at = mark.line + 1
            self.path.clear()
            problem = " ".join(str(getattr(error, "problem", None) or error).split())
            if "nesting depth" in problem:  # libyaml has a limit of its own, and reads ahead of the events
                raise self._make_error(*_TOO_DEEP) from None
            line = "".join(self.text.splitlines()[self.at - 1 : self.at]) if self.at else ""
            mend = "Indent with spaces" if "\t" in line[: len(line) - len(line.lstrip())] else ""
            if "mapping values are not allowed" in problem:
                mend = "Check the indentation, and that each key has a line of its own"
            raise self._make_error(f"broken YAML, {problem}", "YAML", mend) from None
        return data

    def _read_event(self) -> Any:
        self.event = next(self.events)
        return self.event

    def _make_error(self, found: str, allowed: str, mend: str = "") -> InputError:
        line = self.at or (self.event.start_mark.line + 1 if self.event is not None else 1)
        key = ".".join(map(str, self.path))
        where = f"{self.name}:{line}: " + (f"{key}: " if key.isprintable() and key else "")
        return InputError(message(f"{where}{found}; allowed: {allowed}", mend=mend))

    def _build_value(self, event: Any) -> Any:
        scalar, sequence, sequence_end, mapping_end = self.kinds
        self._check_node(event)
        if type(event) is scalar:
            try:
                return plain_scalar(event.value) if event.implicit[0] else event.value
            except Refused as refused:
                raise self._make_error(f"found {refused.found}", refused.allowed) from None
        path = self.path
        if len(path) >= MAX_DEPTH:
            raise self._make_error(*_TOO_DEEP)
        if type(event) is sequence:
            items: list[Any] = []
            while type(event := self._read_event()) is not sequence_end:
                path.append(len(items))
                items.append(self._build_value(event))
                path.pop()
            return items
        mapping: dict[str, Any] = {}
        while type(event := self._read_event()) is not mapping_end:
            if type(event) is not scalar:
                raise self._make_error("found a list or block as a key", "a word")
            key = event.value
            path.append(key)
            if key in mapping:
                first = f" (first on line {self.lines[tuple(path)]})" if self.lines is not None else ""
                raise self._make_error(f"found the key twice{first}", "each key once", "Remove one of the two")
            self._check_node(event)  # notes the key's line
            mapping[key] = self._build_value(self._read_event())
            path.pop()
        return mapping

    def _check_node(self, event: Any) -> None:
        """Note the line of a node; refuse an anchor, an alias, a tag, and in a scene odd characters."""
        if event.anchor is not None:
            raise self._make_error("found an anchor or alias (& or *)", "plain values", "Write the value out")
        if event.tag is not None:
            raise self._make_error(f"found the tag {show(event.tag)}", "plain values", "Leave the tag out")
        if self.lines is not None:
            self.lines.setdefault(tuple(self.path), event.start_mark.line + 1)
            if type(event) is self.kinds[0] and (odd := _ODD.search(event.value)):
                raise self._make_error(f"found the character {odd[0]!r}", "printable text")


def plain_scalar(text: str) -> Any:
    """The value of a text written without quotes, by the core schema of YAML 1.2.

    Raises :class:`~granphon.base.errors.Refused` for a whole number of more than 640 digits.
    """
    if _FLOAT.fullmatch(text):
        if not _WHOLE.fullmatch(text):
            return float(text)
        if (digits := len(text.lstrip("+-"))) > _MOST_DIGITS:
            raise Refused(f"a whole number of {digits} digits", f"whole numbers of {_MOST_DIGITS} digits at most")
        return int(text)
    if _NULL.fullmatch(text):
        return None
    if _TRUTH.fullmatch(text):
        return text.lower() == "true"
    return float(text.replace(".", "", 1)) if _NOT_FINITE.fullmatch(text) else text


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
    # PyYAML's own, whose C part is used, takes more than twice the time, and leaves "1e5" as a text without quotes
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
        return write_float(value)
    text = json.dumps(value, ensure_ascii=False)
    return "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in text)


def write_float(value: float) -> str:
    """A float with all its digits, as every reader of YAML takes it for one: those of 1.1 need a point in 1.0e-06."""
    text = repr(value)
    if "n" in text:  # nan, inf
        return text.replace("inf", ".inf").replace("nan", ".nan")
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


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
