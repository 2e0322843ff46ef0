"""Digests: they show whether a file, or plain data, has changed since granphon wrote it.

They guard against damage and mistaken edits. They are not signatures: whoever edits a file on purpose can make a new digest.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from granphon.base.errors import TOO_LARGE, GranphonError, InputError, SchemaError, UnverifiedFileWarning, message
from granphon.base.reading import read_utf8
from granphon.base.text import show

_SEAL = "# sha256 of all other lines: "


def seal(lines: list[str], place: int = 0) -> str:
    """The text of ``lines`` with a comment line that holds their digest, inserted before ``lines[place]``."""
    return "\n".join([*lines[:place], _SEAL + _digest_lines([*lines, ""]), *lines[place:], ""])


def read_sealed(path: str | os.PathLike[str]) -> tuple[str, bool]:
    """Read a file: return its text without the line that :func:`seal` gave it, and whether there was such a line.

    Raises :class:`~granphon.base.errors.InputError` if the digest is not that of the text, or the file cannot be read.
    """
    return open_seal(path, read_utf8(path))


def open_seal(path: str | os.PathLike[str], text: str) -> tuple[str, bool]:
    """Return the ``text`` of a file as :func:`read_sealed` does; line feeds end its lines."""
    lines = text.split("\n")
    places = [n for n, line in enumerate(lines) if line.startswith("#") and "sha256" in line]
    if not places:
        return text, False
    line = lines.pop(places[0])
    if not re.fullmatch(_SEAL + "[0-9a-f]{64}", line) or line != _SEAL + _digest_lines(lines):
        raise damage_error(path, f"sha256 in line {places[0] + 1}")
    return "\n".join(lines), True


def _digest_lines(lines: list[str]) -> str:
    # line by line, so that a text of millions of lines is not held in memory a second time
    found, between = hashlib.sha256(), ""
    for line in lines:
        found.update(f"{between}{line}".encode("utf-8", "surrogatepass"))
        between = "\n"
    return found.hexdigest()


def damage_error(path: str | os.PathLike[str], where: str) -> InputError:
    """The error for a damaged file: the digest that is found at ``where`` is not that of the data."""
    return InputError(
        message(
            f"{path} was damaged, or edited after granphon wrote it",
            f"Its digest ({where}) does not match its data",
            "Make it again, or remove the digest to read it as it is",
        )
    )


def warn_unverified(path: str | os.PathLike[str]) -> None:
    """Issue :class:`~granphon.base.errors.UnverifiedFileWarning`, for a file without a digest, two callers up the stack."""
    text = message(
        f"{path} carries no digest", "Another program wrote it: damage would not be noticed",
        "Make it again if in doubt",
    )  # fmt: skip
    warnings.warn(text, UnverifiedFileWarning, stacklevel=3)


@contextmanager
def require_own_file(path: str | os.PathLike[str], kind: str) -> Iterator[None]:
    """Turn any exception of the block into an ``InputError``: the file at ``path`` is not a ``kind`` written by granphon.

    Only a :class:`~granphon.base.errors.SchemaError` passes as it is.
    """
    try:
        yield
    except SchemaError:
        raise
    except Exception as error:  # numbers of the wrong kind, size or shape, and whatever they trip over
        why = "A part of it has another form: a number, a list or a block of keys stands where another of them is needed"
        if isinstance(error, GranphonError):
            why = str(error)
        elif isinstance(error, KeyError):
            why = f"It lacks the key {show(error.args[0])}"
        what = f"{path} is not a {kind} written by granphon"
        raise InputError(message(what, why, "Make it again, or give the right file")) from None


def digest(data: Any) -> str:
    """The sha256 of plain data, the same after a round trip through JSON or YAML: see :func:`canonical`."""
    return hashlib.sha256(canonical(data).encode("utf-8", "surrogatepass")).hexdigest()


def canonical(data: Any) -> str:
    """Plain data as one text: mappings sorted, tuples as lists, whole numbers as the floats that they equal.

    Takes mappings, lists, tuples, arrays, strings, numbers, booleans and None; raises
    :class:`~granphon.base.errors.InputError` for anything else.
    """
    if isinstance(data, Mapping):
        return "{" + ",".join(sorted(f"{json.dumps(str(key))}:{canonical(value)}" for key, value in data.items())) + "}"
    if isinstance(data, np.ndarray | np.generic):
        return canonical(data.tolist())
    if isinstance(data, list | tuple):
        return "[" + ",".join(map(canonical, data)) + "]"
    if isinstance(data, complex):
        return canonical({"real": data.real, "imag": data.imag})
    if data is None or isinstance(data, bool | str):
        return json.dumps(data)
    if isinstance(data, int):
        # where no float equals it, a whole number is written with its own digits
        return float(data).hex() if abs(data) < TOO_LARGE and float(data) == data else str(data)
    if isinstance(data, float):
        return data.hex()
    raise InputError(message(f"plain data cannot hold a {type(data).__name__}"))
