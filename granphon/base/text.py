"""Files as text: bytes of regular files, text in UTF-8, plain YAML with its line numbers, and
digests.

Files are of unknown origin. Nothing in one is run, and only the named file is opened; whatever
cannot be read raises :class:`~granphon.base.errors.InputError`. Only plain YAML 1.2 is read: no
tags, no anchors, no merging, every key once.

Digests show whether a file, or plain data, has changed since granphon wrote it. They guard against
damage and mistaken edits. They are not signatures: whoever edits a file on purpose can make a new
digest.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import stat
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import lru_cache
from numbers import Integral
from typing import Any

from granphon.base.errors import (
    LEAST_TOO_LARGE,
    GranphonError,
    InputError,
    MissingFileError,
    MissingPackageError,
    MissingSceneError,
    Refused,
    SceneError,
    SchemaError,
    UnverifiedFileWarning,
    brief,
    message,
    needing,
)

#: the largest file that is read, bytes
MOST_FILE_BYTES = 256_000_000
#: the largest scene that is read or written as a text, bytes
MOST_SCENE_BYTES = 100_000
#: the deepest nesting of blocks and lists that is read
MAX_DEPTH = 12
#: what is found and allowed where the nesting is deeper
_NESTING_REFUSAL = f"found more than {MAX_DEPTH} levels of nesting", "plain data"
#: the most characters of a value that a message shows, and the most entries of a list
_MOST_SHOWN = 60
_MOST_ENTRIES = 8
#: longest name in a list of names of a message, in letters
_LONGEST_NAME = 60
#: the most digits of a whole number: as many as Python converts whatever its own limit is, and more
#: than a float has
_MOST_DIGITS = 640

#: characters that are refused in a scene, also as escapes: control characters and lone surrogates
_REFUSED_IN_SCENES = re.compile(
    r"[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"
)
#: characters that are refused in every text, though not as escapes: control characters, lone
#: surrogates, and what ends a line in YAML 1.1 alone
_REFUSED_IN_TEXTS = re.compile(_REFUSED_IN_SCENES.pattern + r"|[\x85\u2028\u2029]")
_NO_VALUE = re.compile(r"(?:|~|null|Null|NULL)")
_TRUTH_VALUE = re.compile(r"true|True|TRUE|false|False|FALSE")
_WHOLE_NUMBER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
#: the e of a float without a point, as Python writes 1e-06, after a space
_EXPONENT_SIGN = re.compile(r"(?<=[ -]\d)e")
_INFINITY_OR_NAN = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")

#: what writes texts and floats, which most entries of plain data are, as :func:`canonical` does
_CANONICAL: dict[type, Callable[[Any], str]] = {str: json.dumps, float: float.hex}
#: byte order marks of UTF-16
_MARKS_OF_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
#: the comment line of a file with the digest of the others
SEAL = "# sha256 of all other lines: "

#: keys and list indices that lead to a value of a document
KeyPath = tuple[str | int, ...]


# -- bytes and text --------------------------------------------------------------------------------


def read_bytes(path: str | os.PathLike[str], limit: int = MOST_FILE_BYTES) -> bytes:
    """Return the bytes of a regular file that holds no more than ``limit`` bytes.

    Raises
    ------
    MissingFileError : there is no such file.
    InputError : ``path`` is neither a text nor a path; or the file is a folder, a device or a pipe,
        is larger than ``limit``, grows while it is read, or cannot be read for another reason.
    """
    require_path(path)
    try:
        with open(path, "rb", opener=_open_at_once) as stream:
            status = os.fstat(stream.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise InputError(
                    f"{path} cannot be read: it is a device or a pipe", mend="Give a regular file"
                )
            # one byte more than the file holds shows whether it grows; no more, because Python
            # allocates the requested size at once
            raw = stream.read(status.st_size + 1) if status.st_size <= limit else b""
    except InputError:
        raise
    except FileNotFoundError:
        raise MissingFileError(f"{path} cannot be read: there is no such file") from None
    except IsADirectoryError:
        raise InputError(
            f"{path} cannot be read: it is a folder", mend="Give the file itself"
        ) from None
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path} cannot be read: {reason}") from None
    size = max(len(raw), status.st_size)
    if size > limit:
        fault = f"{path} holds more than {write_limit(limit)}"
        raise InputError(fault, mend="Is this the right file?")
    if len(raw) > status.st_size:
        raise InputError(
            f"{path} has grown while it was read", "Somebody is writing it", "Read it again"
        )
    return raw


def _open_at_once(name: str, flags: int) -> int:
    """Return the descriptor of the file ``name``, opened with ``flags``, and without waiting for a
    writer.
    """
    # without O_NONBLOCK, opening a pipe that nobody writes to would never return
    more_flags = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)
    return os.open(name, flags | more_flags)


def write_limit(limit: int) -> str:
    """Return the largest size of a file, ``limit`` bytes, as a message shows it: rounded down to
    whole MB or kB, such as 100 kB, or in bytes if it is below 1 kB.
    """
    for size, unit in ((1_000_000, "MB"), (1000, "kB")):
        if limit >= size:
            return f"{limit // size} {unit}"
    return counted(limit, "byte")


def require_path(path: str | os.PathLike[str]) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless ``path`` is a text or a path.

    A number is refused because ``open`` would take it for the descriptor of an open file.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(
            f"the path is {brief(path)}",
            mend="Give the name of a file, as a text or a pathlib.Path",
        )


def read_utf8(path: str | os.PathLike[str]) -> str:
    """Return the text of a file in UTF-8, in which CR LF at the ends of lines has become a line
    feed; errors are those of :func:`read_bytes` and :func:`decode`.
    """
    return decode(str(path), read_bytes(path)).replace("\r\n", "\n")


def join_numbers(numbers: Iterable[float]) -> str:
    """Return ``numbers`` of Python, not of NumPy, as text on one line, parted by spaces, with all
    of their digits.
    """
    return " ".join(map(repr, numbers))


def decode(name: str, raw: bytes) -> str:
    """Return the text of the bytes ``raw`` of a file called ``name`` that is in UTF-8, with or
    without a byte order mark.

    For bytes of another encoding, and for a null character,
    :class:`~granphon.base.errors.InputError` names the line, the byte, and a guess of the encoding
    if there is one.
    """
    if raw.startswith(_MARKS_OF_UTF_16):
        raise _make_encoding_error(name, raw, 0, "UTF-16")
    if b"\0" in raw:
        # UTF-16 without a mark has two bytes for each letter, about half of them zero in English
        is_wide = len(raw) % 2 == 0 and raw.count(b"\0") >= len(raw) // 3
        guess = "UTF-16" if is_wide else ""
        raise _make_encoding_error(name, raw, raw.find(b"\0"), guess)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # Latin-1 and related encodings have a letter or a sign for every byte that is no control
        # character
        has_controls = re.search(rb"[\x00-\x08\x0e-\x1f\x7f]", raw)
        guess = "" if has_controls else "Latin-1"
        # Python counts behind a byte order mark
        n_bytes_of_mark = len(raw) - len(error.object)
        raise _make_encoding_error(name, raw, n_bytes_of_mark + error.start, guess) from None


def _make_encoding_error(name: str, raw: bytes, position: int, guess: str) -> InputError:
    """Return the error of a file called ``name`` that is not in UTF-8: ``position`` is the index of
    the first byte that UTF-8 does not have there, and ``guess`` the probable encoding, or empty.
    """
    line = raw.count(b"\n", 0, position) + 1
    problem = (
        f"{name}:{line} cannot be read: found the byte 0x{raw[position]:02x} where text in UTF-8 is"
        f" needed"
    )
    if not guess:
        return InputError(problem, "The file does not look like text", "Is this the right file?")
    return InputError(
        problem,
        f"The file looks like {guess}",
        f"Save it as UTF-8 where it was made, or convert it: iconv -f {guess} -t UTF-8 FILE > NEW",
    )


# -- plain YAML ------------------------------------------------------------------------------------


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
    lines: Mapping[KeyPath, int] = field(repr=False)

    def line(self, path: Sequence[str | int]) -> int:
        """Return the number of the line of the key at ``path``, or of the nearest block around the
        key that has a line; 1 if there is none.
        """
        for length in range(len(path), -1, -1):
            outer_path = tuple(path[:length])
            if outer_path in self.lines:
                return self.lines[outer_path]
        return 1

    def error(self, path: Sequence[str | int], what: str) -> SceneError:
        """Return the error with the message ``what`` after the name of the document, and the line
        and the key of ``path``.
        """
        keys = [str(key) if str(key).isprintable() else repr(key) for key in path]
        joined_keys = ".".join(keys)
        place = f"{self.name}:{self.line(path)}: "
        if joined_keys:
            place += f"{joined_keys}: "
        return SceneError(f"{place}{what}")


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a scene file; raises :class:`~granphon.base.errors.SceneError` if the file
    cannot be read, is not in UTF-8, or holds more than ``MOST_SCENE_BYTES``.
    """
    try:
        return decode(str(path), read_bytes(path, MOST_SCENE_BYTES))
    except MissingFileError:
        raise MissingSceneError(
            f"{path}: there is no such file", mend="'granphon init' writes one"
        ) from None
    except InputError as error:
        raise SceneError(str(error)) from None


def parse_yaml(text: str, name: str) -> Document:
    """Return the data of the YAML of a scene, read as by :func:`plain_yaml`, with the line of each
    key; ``name`` names the text in messages.

    Raises :class:`~granphon.base.errors.SceneError` where :func:`plain_yaml` raises an InputError,
    and for escapes that stand for control characters; and
    :class:`~granphon.base.errors.MissingPackageError` if PyYAML is not installed.
    """
    lines: dict[KeyPath, int] = {}
    builder = _Builder(text, name, lines)
    try:
        data = builder.build()
    except InputError as error:
        raise SceneError(str(error)) from None
    return Document(name, data, lines)


def read_yaml(path: str | os.PathLike[str]) -> Any:
    """Return the data of a YAML file; errors are those of :func:`read_utf8` and
    :func:`plain_yaml`.
    """
    return plain_yaml(read_utf8(path), path)


def plain_yaml(text: str, path: str | os.PathLike[str]) -> Any:
    """Return the data of a YAML text, of the file ``path``: mappings, lists, strings, numbers,
    booleans and None, nothing else.

    Plain values are those of YAML 1.2, see :func:`plain_scalar`. Raises
    :class:`~granphon.base.errors.InputError`, which names file and line, for broken YAML, an empty
    text, a second document, a key given twice, a list or block as a key, a tag
    (``!!python/object``), an anchor or alias, deep nesting, a whole number of too many digits, and
    control characters, also those that end a line in YAML 1.1 alone;
    :class:`~granphon.base.errors.MissingPackageError` if PyYAML is not installed.
    """
    return _Builder(text, str(path)).build()


class _Builder:
    """Builds plain data from the events of PyYAML's parser: no text can have an object of another
    class made.

    ``name`` names the text in messages. ``lines``, which a scene alone has, takes the line of each
    key and list item by its path; None elsewhere, because the lines of millions of numbers cost
    time.
    """

    def __init__(self, text: str, name: str, lines: dict[KeyPath, int] | None = None) -> None:
        """Set the text, which is not read before :meth:`build`."""
        self.text = text
        self.name = name
        self.lines = lines
        #: keys and list indices that lead to the value that is being built
        self.path: list[str | int] = []
        #: line of an error, where the error is not on the line of the last event
        self.error_line: int | None = None
        #: the event that was read last
        self.event: Any = None

    def build(self) -> Any:
        """Return the data of the text; raises :class:`InputError`, with file and line, for a text
        that is not one document of plain YAML, and MissingPackageError without PyYAML.
        """
        with needing("A YAML file"):
            import yaml

        self._refuse_characters()
        # libyaml, where it is installed, reads the same events about ten times faster
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        self.events = yaml.parse(self.text, loader)
        # the classes of events that values and keys begin and end with
        self.scalar = yaml.ScalarEvent
        self.list_start = yaml.SequenceStartEvent
        self.list_end = yaml.SequenceEndEvent
        self.mapping_end = yaml.MappingEndEvent
        try:
            return self._build_document(yaml.DocumentStartEvent, yaml.StreamEndEvent)
        except InputError:
            raise
        except Exception as error:  # an error of the parser, which is due to the text
            raise self._make_parser_error(error) from None

    def _refuse_characters(self) -> None:
        """Raise :class:`InputError` if the text has a character that is refused in every text;
        ``error_line`` is then the line of the character.
        """
        refused_character = _REFUSED_IN_TEXTS.search(self.text)
        if refused_character:
            self.error_line = self.text.count("\n", 0, refused_character.start()) + 1
            raise self._make_error(
                f"found the character {refused_character[0]!r}",
                "printable text",
                "Is this the right file?",
            )

    def _build_document(self, document_start: type[Any], stream_end: type[Any]) -> Any:
        """Return the data of the only document of the text; ``document_start`` and ``stream_end``
        are the classes of the events with which a document begins and the text ends.

        Raises :class:`InputError` for a text of no document or of two, and as :meth:`_build_value`
        does.
        """
        self._read_event()  # the start of the stream
        if not isinstance(self._read_event(), document_start):
            is_scene = self.lines is not None
            allowed = "a scene" if is_scene else "plain data"
            mend = "'granphon init' writes one" if is_scene else ""
            raise self._make_error("found an empty text", allowed, mend)
        data = self._build_value(self._read_event())
        self._read_event()  # the end of the document
        if not isinstance(self._read_event(), stream_end):
            mend = "Put the second into a file of its own"
            raise self._make_error("found a second document ('---')", "one document", mend)
        return data

    def _make_parser_error(self, error: Exception) -> InputError:
        """Return the error of a text that the parser does not understand. What is wrong, and in
        which line, is taken from the ``error`` of the parser.

        ``error_line`` is set to that line, and ``path`` is emptied: the message names no key, as
        the parser may have read on to another one.
        """
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        if mark is not None:
            self.error_line = mark.line + 1
        self.path.clear()
        problem = " ".join(str(getattr(error, "problem", None) or error).split())
        if "nesting depth" in problem:
            # libyaml has a limit of its own, which it meets before the events come to MAX_DEPTH,
            # because it reads ahead
            return self._make_error(*_NESTING_REFUSAL)
        mend = self._suggest_mend(problem)
        return self._make_error(f"broken YAML, {problem}", "YAML", mend)

    def _suggest_mend(self, problem: str) -> str:
        """Return how to mend a text in which the parser met a ``problem``; empty if that is not
        known.
        """
        if "mapping values are not allowed" in problem:
            return "Check the indentation, and that each key has a line of its own"
        lines = self.text.splitlines()
        if not self.error_line or self.error_line > len(lines):  # the text ends before the line
            return ""
        line = lines[self.error_line - 1]
        indent = line[: len(line) - len(line.lstrip())]
        return "Indent with spaces" if "\t" in indent else ""

    def _read_event(self) -> Any:
        """Return the next event of the parser, and keep it as ``event``, whose line errors name."""
        self.event = next(self.events)
        return self.event

    def _make_error(self, found: str, allowed: str, mend: str = "") -> InputError:
        """Return the error with the line of the event that was read last, or the ``error_line`` if
        there is one, and with the key; ``found`` and ``allowed`` are the content of its message.
        """
        event_line = 1 if self.event is None else self.event.start_mark.line + 1
        place = f"{self.name}:{self.error_line or event_line}: "
        key = ".".join(map(str, self.path))
        if key and key.isprintable():
            place += f"{key}: "
        return InputError(f"{place}{found}; allowed: {allowed}", mend=mend)

    def _build_value(self, event: Any) -> Any:
        """Return the data that begin with an ``event``: a scalar, a list or a mapping. Lists and
        mappings read on to the event that ends them.

        Raises :class:`InputError` for anchors, aliases and tags, for a whole number of too many
        digits, for a list or mapping that stands in ``MAX_DEPTH`` others, and in a scene for
        characters that cannot be printed.
        """
        self._refuse_special(event)
        self._note_line(event)
        if type(event) is self.scalar:
            is_without_quotes = event.implicit[0]
            if not is_without_quotes:
                return event.value
            try:
                return plain_scalar(event.value)
            except Refused as refused:
                raise self._make_error(f"found {refused.found}", refused.allowed) from None
        if len(self.path) >= MAX_DEPTH:
            raise self._make_error(*_NESTING_REFUSAL)
        return self._build_list() if type(event) is self.list_start else self._build_mapping()

    def _build_list(self) -> list[Any]:
        """Return the list whose first event was read; errors are those of :meth:`_build_value`."""
        items: list[Any] = []
        while type(event := self._read_event()) is not self.list_end:
            self.path.append(len(items))
            items.append(self._build_value(event))
            self.path.pop()
        return items

    def _build_mapping(self) -> dict[str, Any]:
        """Return the mapping whose first event was read.

        Raises :class:`InputError` for a key that is a list or block, and for one that is given
        twice; other errors are those of :meth:`_build_value`.
        """
        mapping: dict[str, Any] = {}
        while type(event := self._read_event()) is not self.mapping_end:
            if type(event) is not self.scalar:
                raise self._make_error("found a list or block as a key", "a word")
            key = event.value
            self.path.append(key)
            if key in mapping:
                first_line = ""
                if self.lines is not None:
                    first_line = f" (first on line {self.lines[tuple(self.path)]})"
                raise self._make_error(
                    f"found the key twice{first_line}", "each key once", "Remove one of the two"
                )
            self._refuse_special(event)
            self._note_line(event)  # that of the key, where the value begins on another line
            mapping[key] = self._build_value(self._read_event())
            self.path.pop()
        return mapping

    def _note_line(self, event: Any) -> None:
        """Note, in a scene, the line of an ``event`` as that of the present path, unless the path
        has a line.
        """
        if self.lines is not None:
            self.lines.setdefault(tuple(self.path), event.start_mark.line + 1)

    def _refuse_special(self, event: Any) -> None:
        """Raise the error if the key or value that begins with an ``event`` has an anchor or a tag,
        or is an alias, or in a scene has characters that cannot be printed.
        """
        if event.anchor is not None:
            raise self._make_error(
                "found an anchor or alias (& or *)", "plain values", "Write the value out"
            )
        if event.tag is not None:
            raise self._make_error(
                f"found the tag {show(event.tag)}", "plain values", "Leave the tag out"
            )
        if self.lines is not None and type(event) is self.scalar:
            refused_character = _REFUSED_IN_SCENES.search(event.value)
            if refused_character:
                raise self._make_error(
                    f"found the character {refused_character[0]!r}", "printable text"
                )


def plain_scalar(text: str) -> Any:
    """Return the value of a text written without quotes, by the core schema of YAML 1.2: a decimal
    number, infinity or nan (".inf", ".nan"), a truth value, None, or the text itself. The numbers
    of this schema that are not decimal, 0x1F and 0o17, stay texts. A number with a point or an
    exponent that is too large for a float is infinite.

    Raises :class:`~granphon.base.errors.Refused` for a whole number of more than ``_MOST_DIGITS``
    digits.
    """
    if _WHOLE_NUMBER.fullmatch(text):
        n_digits = len(text.lstrip("+-"))
        if n_digits > _MOST_DIGITS:
            raise Refused(
                f"a whole number of {n_digits} digits",
                f"whole numbers of {_MOST_DIGITS} digits at most",
            )
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _NO_VALUE.fullmatch(text):
        return None
    if _TRUTH_VALUE.fullmatch(text):
        return text.lower() == "true"
    if _INFINITY_OR_NAN.fullmatch(text):  # Python writes .inf and .nan without the point
        return float(text.replace(".", "", 1))
    return text


# -- writing ---------------------------------------------------------------------------------------


def dump_yaml(data: Mapping[str, Any], indent: str = "") -> str:
    """Return ``data`` as YAML that readers of version 1.1 and 1.2 understand alike, each line after
    the ``indent``; without an entry the text is empty.

    The values may be mappings, lists, strings, numbers that are not complex, booleans, None and
    objects with ``tolist`` (numpy); TypeError for any other, and ValueError for a whole number of
    more digits than Python writes. Floats are written so that reading them gives the same bits.
    """
    # PyYAML's own writer, even in C, takes more than twice the time, and writes the text "1e5"
    # without quotes, which YAML 1.2 reads as a number
    blocks = []
    for key, value in data.items():
        entry = value.tolist() if hasattr(value, "tolist") else value
        head = f"{indent}{_write_key(key)}:"
        if isinstance(entry, Mapping) and entry:
            blocks.append(f"{head}\n{dump_yaml(entry, indent + '  ')}")
        elif isinstance(entry, list | tuple) and _is_nested(entry):
            items = [f"{indent}  - {_write_flow(item)}\n" for item in entry]
            blocks.append(f"{head}\n{''.join(items)}")
        else:
            blocks.append(f"{head} {_write_flow(entry)}\n")
    return "".join(blocks)


def _is_nested(values: Sequence[Any]) -> bool:
    """Whether a list holds lists or mappings."""
    return any(isinstance(value, list | tuple | Mapping) for value in values)


@lru_cache(1024)  # states of a sweep have the same keys
def _write_key(key: Any) -> str:
    """Return a key as a text, in quotes unless it is a word that every reader takes for a text."""
    # readers of YAML 1.1 or 1.2 take these words for other values
    is_text = str(key).lower() not in ("true", "false", "yes", "no", "on", "off", "y", "n", "null")
    is_word = is_text and re.fullmatch(r"[A-Za-z_][A-Za-z0-9_.-]*", str(key))
    return str(key) if is_word else _write_flow(str(key))


def _write_flow(value: Any) -> str:
    """Return a value as YAML on one line: lists in brackets, mappings in braces, texts in quotes.
    TypeError and ValueError as of :func:`dump_yaml`.
    """
    content = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(content, Mapping):
        entries = [f"{_write_key(key)}: {_write_flow(entry)}" for key, entry in content.items()]
        return "{" + ", ".join(entries) + "}"
    if isinstance(content, list | tuple):
        return "[" + ", ".join(map(_write_flow, content)) + "]"
    if isinstance(content, float):
        return write_float(content)
    # JSON is YAML, but for letters that cannot be printed, which YAML takes as escapes alone
    text = json.dumps(content, ensure_ascii=False)
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() else f"\\U{ord(sign):08x}" for sign in text)


def write_float(value: float) -> str:
    """Return a float with all its digits, in a form that every reader of YAML takes for a float:
    readers of 1.1 need a point, as in 1.0e-06.
    """
    text = repr(float(value))  # as the repr of NumPy's float64 is no text of a number
    is_finite = "n" not in text  # neither nan nor inf
    if not is_finite:
        return text.replace("inf", ".inf").replace("nan", ".nan")
    needs_point = "e" in text and "." not in text
    return text.replace("e", ".0e") if needs_point else text


def fill_floats(template: str, rows: Iterable[list[float]]) -> list[str]:
    """Return one text for each of the ``rows`` of finite floats: the ``template``, in which each
    %r, always after a space, is replaced by the next float of the row in the form of
    :func:`write_float`.

    All floats of a row are written at once, because files of bands hold millions.
    """
    return [_EXPONENT_SIGN.sub(".0e", template % tuple(row)) for row in rows]


def versions(*packages: str) -> dict[str, str]:
    """Return the installed versions of granphon and of each of ``packages`` by their names, found
    without importing them.
    """
    from granphon import __version__

    return {"granphon": __version__} | {package: find_version(package) for package in packages}


def find_version(package: str) -> str:
    """Return the installed version of a package, "not installed" without it; nothing is
    imported.
    """
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def require_schema(what: object, found: Any, known: int) -> None:
    """Raise :class:`~granphon.base.errors.SchemaError` unless the schema ``found`` in ``what``, a
    file or data, is the whole number ``known``.
    """
    is_whole_number = isinstance(found, Integral) and not isinstance(found, bool)
    if not is_whole_number or found != known:
        why = f"granphon {versions()['granphon']} reads and writes schema {known}"
        mend = "Read it with the version that wrote it, or make it again"
        raise SchemaError(f"{what} has the schema {show(found)}", why, mend)


# -- values in messages ----------------------------------------------------------------------------


def show(value: Any) -> str:
    """Return a value as messages show it: at most 60 characters, on one line, without control
    characters; of a long list the first entries, and three dots. A mapping is "a block of keys",
    None "nothing" and True "true"; in a list they are written as Python writes them.
    """
    if isinstance(value, Mapping):
        return "a block of keys"
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, list | tuple):
        return brief(value, _MOST_SHOWN)
    entries = value[:_MOST_ENTRIES]
    words = [brief(entry) for entry in entries]
    ellipsis = "..."
    if len(value) > _MOST_ENTRIES:
        words.append(ellipsis)
    text = f"[{', '.join(words)}]"
    return text if len(text) <= _MOST_SHOWN else text[: _MOST_SHOWN - len(ellipsis)] + ellipsis


def closest(word: str, options: Iterable[str]) -> str | None:
    """Return the one of ``options`` that was probably meant by ``word``: the first that differs in
    the case of letters at most, or else the most similar; None if none is close.
    """
    candidates = list(options)
    namesakes = [option for option in candidates if option.lower() == word.lower()]
    if namesakes:
        return namesakes[0]
    # a long word of unknown origin is cut, as the comparison takes the square of its length
    similar = get_close_matches(word[:100], candidates, n=1)
    return similar[0] if similar else None


def suggest(word: str, options: Iterable[str]) -> str:
    """Return what to write in place of an unknown ``word``: the option that was probably meant, or
    else any of the ``options``; empty without options.
    """
    candidates = list(options)
    meant = closest(word, candidates)
    if meant:
        return f"Did you mean {meant}?"
    return f"Use {', '.join(candidates)}" if candidates else ""


def spell(name: str) -> str:
    """Return a name in words, such as "Young modulus" for "young_modulus": the names of Young and
    Poisson begin with capitals.
    """
    return name.replace("_", " ").replace("young", "Young").replace("poisson", "Poisson")


def join_alike(pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the different values of ``pairs`` of a name and a value, in the order in which they
    first stand, each before the names that have it, parted by commas.
    """
    names_by_value = dict[str, list[str]]()
    for name, value in pairs:
        names_by_value.setdefault(value, []).append(name)
    return [(value, ", ".join(names)) for value, names in names_by_value.items()]


def counted(number: int, one: str, many: str = "") -> str:
    """Return the ``number`` of things that are called ``one`` each, "1 ball" or "2 balls"; ``many``
    is the plural if that is not ``one`` with an s.
    """
    noun = one if number == 1 else (many or f"{one}s")
    return f"{number} {noun}"


def list_names(names: Iterable[object], most_names: int = 10) -> str:
    """Return names from a file as a message lists them: the first ``most_names``, one at least, and
    how many more there are; "none" if there are none. A name of more than ``_LONGEST_NAME`` letters
    is cut, and ends with three dots.
    """
    texts = [str(name) for name in names]
    if not texts:
        return "none"
    ellipsis = "..."
    shown = []
    for text in texts[:most_names]:
        is_short = len(text) <= _LONGEST_NAME
        shown.append(text if is_short else text[: _LONGEST_NAME - len(ellipsis)] + ellipsis)
    ending = f" and {len(texts) - most_names} more" if len(texts) > most_names else ""
    return ", ".join(shown) + ending


# -- digests ---------------------------------------------------------------------------------------


def seal(lines: list[str], place: int = 0) -> str:
    """Return the text of ``lines``, with a line feed at its end, and with a comment line that holds
    their digest, inserted before ``lines[place]``. Before that place there must be no comment line
    with the word sha256, which :func:`open_seal` would take for the seal.
    """
    comment = SEAL + digest_lines([*lines, ""])  # the last line ends with a line feed too
    return "\n".join([*lines[:place], comment, *lines[place:], ""])


def read_sealed(path: str | os.PathLike[str]) -> tuple[str, bool]:
    """Read a file: return its text without the line that :func:`seal` gave it, and whether there
    was such a line.

    Raises :class:`~granphon.base.errors.InputError` as :func:`read_utf8` and :func:`open_seal` do.
    """
    return open_seal(path, read_utf8(path))


def open_seal(path: str | os.PathLike[str], text: str) -> tuple[str, bool]:
    """Return the ``text`` of the file at ``path`` without its seal, and whether there was a seal:
    the first comment line with the word sha256, which holds the digest of all other lines. Line
    feeds end the lines of the text.

    Raises :class:`~granphon.base.errors.InputError` if that line does not hold this digest.
    """
    lines = text.split("\n")
    places = [n for n, line in enumerate(lines) if line.startswith("#") and "sha256" in line]
    if not places:
        return text, False
    seal_line = lines.pop(places[0])
    # the pattern first: a line that is no seal needs no digest of millions of lines
    is_seal = re.fullmatch(SEAL + "[0-9a-f]{64}", seal_line)
    if not is_seal or seal_line != SEAL + digest_lines(lines):
        raise damage_error(path, f"sha256 in line {places[0] + 1}")
    return "\n".join(lines), True


def digest_lines(lines: list[str]) -> str:
    """Return the sha256, as hexadecimal digits, of lines joined by line feeds."""
    # line by line, so that a text of millions of lines is not held in memory a second time
    digest = hashlib.sha256()
    separator = ""
    for line in lines:
        digest.update(f"{separator}{line}".encode("utf-8", "surrogatepass"))
        separator = "\n"
    return digest.hexdigest()


def damage_error(path: str | os.PathLike[str], where: str) -> InputError:
    """Return the error for a damaged file ``path``, or data that are called so: the digest that
    stands ``where`` is not that of the data.
    """
    problem = f"{path} was damaged, or edited after granphon wrote it"
    why = f"Its digest ({where}) does not match its data"
    return InputError(problem, why, "Make it again, or remove the digest to read it as it is")


def warn_unverified(path: str | os.PathLike[str]) -> None:
    """Issue :class:`~granphon.base.errors.UnverifiedFileWarning` for a file ``path``, or data that
    are called so, without a digest: at the line that called the function that calls this one.
    """
    text = message(
        f"{path} carries no digest",
        "Another program wrote it, or the digest was removed: damage would not be noticed",
        "Make it again if in doubt",
    )
    warnings.warn(text, UnverifiedFileWarning, stacklevel=3)


@contextmanager
def require_own_file(path: str | os.PathLike[str], kind: str) -> Iterator[None]:
    """Turn an exception of the block into an ``InputError``: the file at ``path`` is not a ``kind``
    written by granphon.

    A :class:`~granphon.base.errors.SchemaError` passes as it is, and so do a package that is not
    installed, and a lack of memory.
    """
    try:
        yield
    except (SchemaError, MissingPackageError, MemoryError):
        raise
    except Exception as error:
        problem = f"{path} is not a {kind} written by granphon"
        mend = "Make it again, or give the right file"
        raise InputError(problem, _explain_content(error), mend) from None


def _explain_content(error: Exception) -> str:
    """Return the sentence of a message that says why reading a file led to an ``error``."""
    if isinstance(error, GranphonError):
        return str(error)
    if isinstance(error, KeyError):
        return f"It lacks the key {show(error.args[0])}"
    # numbers of the wrong kind, size or shape raise errors of many kinds, whose texts say little
    return "A number, a list or a block of keys stands where another of them is needed"


def digest(data: Any) -> str:
    """Return the sha256 of plain data, as hexadecimal digits. It is the same after a round trip
    through JSON or YAML: see :func:`canonical`, whose errors it has.
    """
    return hashlib.sha256(canonical(data).encode("utf-8", "surrogatepass")).hexdigest()


def canonical(data: Any) -> str:
    """Return plain data as one text: mappings sorted, tuples as lists, whole numbers as the floats
    that they equal.

    Takes mappings, lists, tuples, arrays, strings, whole numbers, floats, complex numbers, booleans
    and None; raises :class:`~granphon.base.errors.InputError` for anything else, as long doubles of
    NumPy, and for a whole number of more digits than Python writes. RecursionError for data that
    contain themselves.
    """
    if isinstance(data, Mapping):
        entries = []
        for key, value in data.items():
            write = _CANONICAL.get(type(value), canonical)
            entries.append(f"{json.dumps(str(key))}:{write(value)}")
        return "{" + ",".join(sorted(entries)) + "}"
    if hasattr(data, "tolist"):
        # arrays and numbers of NumPy, which the command's help does without
        listed = data.tolist()
        if type(listed) is type(data):  # a long double, which Python has not
            raise InputError(f"plain data cannot hold a {type(data).__name__}")
        return canonical(listed)
    if isinstance(data, list | tuple):
        entries = [_CANONICAL.get(type(value), canonical)(value) for value in data]
        return "[" + ",".join(entries) + "]"
    if isinstance(data, complex):
        return canonical({"real": data.real, "imag": data.imag})
    if data is None or isinstance(data, bool | str):
        return json.dumps(data)
    if isinstance(data, int):
        if abs(data) < LEAST_TOO_LARGE and float(data) == data:
            return float(data).hex()
        try:
            return str(data)
        except ValueError:
            raise InputError(f"plain data cannot hold {brief(data)}") from None
    if isinstance(data, float):
        return data.hex()
    raise InputError(f"plain data cannot hold a {type(data).__name__}")
