"""Digests: by them a file, or plain data, that changed after granphon had written it is told from one that did not.

They guard against damage and mistaken edits. They are no signature: whoever edits a file on purpose can make another digest.
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

from granphon.base.errors import GranphonError, InputError, UnverifiedFileWarning, message
from granphon.base.reading import read_utf8

__all__ = ["canonical", "damage_error", "digest", "own_file", "read_sealed", "seal", "warn_unverified"]

_SEAL = "# sha256 of all other lines: "


def seal(lines: list[str], place: int = 0) -> str:
    """The text of ``lines``, and a line of comment that holds their digest, before the line number ``place``."""
    return "\n".join([*lines[:place], _SEAL + _of_lines([*lines, ""]), *lines[place:], ""])


def read_sealed(path: str | os.PathLike[str]) -> tuple[str, bool]:
    """The text of a file without the line that :func:`seal` gave it, and whether it had one.

    :class:`~granphon.base.errors.InputError` if the text does not have that digest, or cannot be read.
    """
    lines = read_utf8(path).split("\n")
    places = [n for n, line in enumerate(lines) if line.startswith("#") and "sha256" in line]
    if not places:
        return "\n".join(lines), False
    line = lines.pop(places[0])
    if not re.fullmatch(_SEAL + "[0-9a-f]{64}", line) or line != _SEAL + _of_lines(lines):
        raise damage_error(path, f"sha256 in line {places[0] + 1}")
    return "\n".join(lines), True


def _of_lines(lines: list[str]) -> str:
    # line by line: a text of millions of them is not held once more
    found, between = hashlib.sha256(), ""
    for line in lines:
        found.update(f"{between}{line}".encode("utf-8", "surrogatepass"))
        between = "\n"
    return found.hexdigest()


def damage_error(path: str | os.PathLike[str], where: str) -> InputError:
    """The error that says so: ``where`` holds a digest, which is not that of the data."""
    return InputError(
        message(
            f"{path} was damaged, or edited after granphon wrote it",
            f"Its digest ({where}) is not that of its data",
            "Make it again; or remove the digest to read it as it is",
        )
    )


def warn_unverified(path: str | os.PathLike[str]) -> None:
    """Warn the caller of the function that calls this (:class:`~granphon.base.errors.UnverifiedFileWarning`): no digest."""
    text = message(
        f"{path} carries no digest", "Another program, or an older granphon, wrote it: damage would not be noticed",
        "Make it again if in doubt",
    )  # fmt: skip
    warnings.warn(text, UnverifiedFileWarning, stacklevel=3)


@contextmanager
def own_file(path: str | os.PathLike[str], kind: str) -> Iterator[None]:
    """Whatever fails in the block shows that the file at ``path`` is no ``kind`` of granphon's: one error that says so."""
    try:
        yield
    except Exception as error:  # numbers of the wrong kind, size or shape, and whatever they trip over
        why = str(error) if isinstance(error, GranphonError) else f"{type(error).__name__}: {error}"
        raise InputError(message(f"{path} is not a {kind} written by granphon", why)) from None


def digest(data: Any) -> str:
    """The sha256 of plain data, the same after a round trip through JSON or YAML: see :func:`canonical`."""
    return hashlib.sha256(canonical(data).encode("utf-8", "surrogatepass")).hexdigest()


def canonical(data: Any) -> str:
    """Plain data as one text: mappings sorted, tuples as lists, whole numbers as the floats that they equal.

    Mappings, lists, tuples, arrays, strings, numbers, booleans and None; :class:`~granphon.base.errors.InputError` for
    others.
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
        # beyond 2^1024, and between the floats, a whole number is itself
        return float(data).hex() if abs(data) < 2**1023 and float(data) == data else str(data)
    if isinstance(data, float):
        return data.hex()
    raise InputError(message(f"found a {type(data).__name__} among plain data"))
