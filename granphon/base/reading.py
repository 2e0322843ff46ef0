"""Reading files of unknown origin: bytes of regular files, text, and YAML that is plain data.

Nothing in a file is run, and only the named file is opened. Whatever cannot be read raises
:class:`~granphon.base.errors.InputError`.
"""

from __future__ import annotations

import os
import re
import stat
from typing import Any

from granphon.base.errors import InputError, MissingFileError, Refused, brief, message

__all__ = ["MOST_FILE_BYTES", "plain_scalar", "plain_yaml", "read_bytes", "read_utf8", "require_path"]

#: the largest file that is read, bytes
MOST_FILE_BYTES = 256_000_000
#: the deepest nesting of blocks and lists in YAML
_MAX_DEPTH = 12
_TOO_DEEP = f"more than {_MAX_DEPTH} levels of nesting"
#: the most digits of a whole number: as many as Python converts whatever its own limit is, and more than a float has
_MOST_DIGITS = 640


def read_bytes(path: str | os.PathLike[str], limit: int = MOST_FILE_BYTES) -> bytes:
    """Read the bytes of a regular file that holds no more than ``limit`` of them.

    Raises
    ------
    MissingFileError : there is no such file.
    InputError : the file is a folder, a device or a pipe, is larger than ``limit``, grows while it is read, or may not be
        read; or ``path`` is not a path.
    """
    require_path(path)
    try:
        with open(path, "rb", opener=_without_waiting) as stream:
            about = os.fstat(stream.fileno())
            if not stat.S_ISREG(about.st_mode):
                what = f"{path} cannot be read: it is a device or a pipe"
                raise InputError(message(what, mend="Give a regular file"))
            # ask for little more than the file holds, as Python allocates the requested size at once
            raw = stream.read(about.st_size + 1) if about.st_size <= limit else b""
    except InputError:
        raise
    except FileNotFoundError:
        raise MissingFileError(message(f"{path} cannot be read: there is no such file")) from None
    except IsADirectoryError:
        raise InputError(message(f"{path} cannot be read: it is a folder", mend="Give the file itself")) from None
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        raise InputError(message(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}")) from None
    if max(len(raw), about.st_size) > limit:
        size = f"{limit // 1_000_000} MB" if limit >= 1_000_000 else f"{limit // 1000} kB"
        raise InputError(message(f"{path} holds more than {size}", mend="Is this the right file?"))
    if len(raw) > about.st_size:
        raise InputError(message(f"{path} has grown while it was read", "Somebody is writing it", "Read it again"))
    return raw


def require_path(path: str | os.PathLike[str]) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless ``path`` is a text or a path.

    A number is refused because ``open`` would take it for the descriptor of an open file.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(message(f"the path is {brief(path)}", mend="Give the name of a file, as a text or a pathlib.Path"))


def _without_waiting(path: str, flags: int) -> int:
    # without O_NONBLOCK, opening a pipe that nobody writes to would never return
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0))


def read_utf8(path: str | os.PathLike[str]) -> str:
    """The text of a file in UTF-8, with line feeds as the ends of lines.

    Raises the errors of :func:`read_bytes`, and :class:`~granphon.base.errors.InputError` for bytes that are not UTF-8.
    """
    raw = read_bytes(path)
    try:
        return raw.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        what = f"{path}:{line} cannot be read: found the byte 0x{raw[error.start]:02x}, which is not text in UTF-8"
        raise InputError(message(what, mend="Is this the right file?")) from None


def plain_yaml(text: str, path: str | os.PathLike[str]) -> Any:
    """The data of a YAML text: mappings, lists, strings, numbers, booleans and None, nothing else.

    The data are built here from the events of the parser, so that no tag can choose which objects are made. Raises
    :class:`~granphon.base.errors.InputError` for broken YAML, tags, anchors and aliases, a key given twice, lists or blocks
    as keys, a second document, deep nesting, and an empty text. Scalars are those of YAML 1.2, see :func:`plain_scalar`.
    """
    import yaml

    # libyaml, where it is installed, reads the same events about ten times faster
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    root: list[Any] = []
    stack: list[Any] = [root]  # lists and mappings that are still open
    keys: list[str | None] = [None]  # for each of them the key whose value comes next
    line = 1
    try:
        for event in yaml.parse(text, loader):
            line = event.start_mark.line + 1
            if isinstance(event, yaml.NodeEvent):
                _check_node(event)
                scalar = isinstance(event, yaml.ScalarEvent)
                here = stack[-1]
                if isinstance(here, dict) and keys[-1] is None:
                    if not scalar:
                        raise _Refused("a list or block as a key")
                    if event.value in here:
                        raise _Refused(f"the key {event.value[:40]!r} twice")
                    keys[-1] = event.value
                    continue
                if scalar:
                    value = plain_scalar(event.value) if event.implicit[0] else event.value
                else:
                    value = [] if isinstance(event, yaml.SequenceStartEvent) else {}
                if isinstance(here, dict):
                    here[keys[-1]] = value
                    keys[-1] = None
                else:
                    here.append(value)
                if not scalar:
                    stack.append(value)
                    keys.append(None)
                    if len(stack) > _MAX_DEPTH + 1:
                        raise _Refused(_TOO_DEEP)
            elif isinstance(event, yaml.CollectionEndEvent):
                stack.pop()
                keys.pop()
            elif isinstance(event, yaml.DocumentStartEvent) and root:
                raise _Refused("a second document ('---')")
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f":{mark.line + 1}" if mark is not None else ""
        problem = " ".join(str(getattr(error, "problem", None) or error).split())
        if "nesting depth" in problem:  # libyaml has a limit of its own, and reads ahead of the events
            what = f"{path}{where} cannot be read: found {_TOO_DEEP}"
            raise InputError(message(what, "Only plain data are taken")) from None
        raise InputError(message(f"{path}{where} cannot be read: broken YAML, {problem}")) from None
    except _Refused as refused:
        raise InputError(message(f"{path}:{line} cannot be read: found {refused}", "Only plain data are taken")) from None
    except Refused as refused:
        raise InputError(f"{path}:{line} cannot be read: {refused}") from None
    if not root:
        raise InputError(message(f"{path} cannot be read: it is empty"))
    return root[0]


class _Refused(Exception):
    """A part of a YAML text that is not plain data."""


def _check_node(event: Any) -> None:
    if event.anchor is not None:
        raise _Refused("an anchor or alias (& or *)")
    if getattr(event, "tag", None) is not None:
        raise _Refused(f"the tag {event.tag[:60]!r}")


def plain_scalar(text: str) -> Any:
    """The value of a text written without quotes, by the core schema of YAML 1.2.

    Raises :class:`~granphon.base.errors.Refused` for a whole number of more than 640 digits.
    """
    if text in ("", "~", "null", "Null", "NULL"):
        return None
    if text.lower() in ("true", "false") and text in (text.lower(), text.upper(), text.title()):
        return text.lower() == "true"
    if re.fullmatch(r"[-+]?[0-9]+", text):
        if (digits := len(text.lstrip("+-"))) > _MOST_DIGITS:
            raise Refused(f"a whole number of {digits} digits", f"whole numbers of {_MOST_DIGITS} digits at most")
        return int(text)
    if re.fullmatch(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", text):
        return float(text)
    if re.fullmatch(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", text):
        return float(text.replace(".", "", 1))
    return text
