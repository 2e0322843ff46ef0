"""Entries of a store: results of tasks as bytes, each with a mark, its length and the SHA-256 of its body.

The body is the name of the entry, then the layout of some arrays, compressed, and their bytes. Nothing that is read is ever
executed.
Sound entries before and behind a damaged place are found by their marks.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import zlib
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from io import FileIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "HEAD", "IDENTITY", "MARK", "TaskResult", "decode", "encode", "name_of", "read_body", "read_bytes_at", "read_entries",
    "read_part", "scan", "wrap",
]  # fmt: skip

#: the result of a task, or of its first steps; no array holds Python objects
TaskResult = dict[str, NDArray[Any]]
#: what every entry begins with: the line ends show whether a transfer as a text has changed the file
MARK = b"\x93granphon\r\n\x1a\n\0\0\0"
#: bytes before the body of an entry: the mark, the length of the body and its SHA-256
HEAD = len(MARK) + 8 + 32
#: name of the entry that holds the identity of the work, which no task has
IDENTITY = ""
#: bytes to which each array in an entry is padded, so that arrays can be used where they are
_ALIGNMENT = 8
#: bytes before the layout, which hold its length; and the greatest length of a layout before it is compressed
_LENGTH, _MOST_LAYOUT = 4, 1_000_000
#: kinds of numpy's types that an entry may hold: truth, numbers and texts, but no Python objects
_KINDS = "biufcSU"
#: bytes that are searched for a mark at once
_CHUNK = 1_000_000


def encode(name: str, part: TaskResult) -> bytes:
    """Return the entry of a result. Equal results give equal bytes."""
    layout = tuple([(key, one.dtype.str, one.shape) for key, one in part.items()])
    pieces = [f"{name}\n".encode(), _write_layout(layout)]
    for one in part.values():
        pieces.append(one.tobytes())
        if rest := one.nbytes % _ALIGNMENT:
            pieces.append(bytes(_ALIGNMENT - rest))
    return wrap(b"".join(pieces))


def wrap(body: bytes) -> bytes:
    """Return the entry with this body."""
    return b"".join((MARK, len(body).to_bytes(8, "little"), hashlib.sha256(body).digest(), body))


@lru_cache(1024)
def _write_layout(layout: tuple[tuple[str, str, tuple[int, ...]], ...]) -> bytes:
    for key, kind, _ in layout:
        if kind[1] not in _KINDS:
            raise TypeError(f"the array {key!r} of a result holds {np.dtype(kind)}")
    data = zlib.compress(json.dumps(layout).encode())
    return len(data).to_bytes(_LENGTH, "little") + data


def decode(entry: bytes) -> TaskResult:
    """Return the result that :func:`encode` has made an entry of; its arrays are read-only."""
    part = read_part(entry[HEAD:])
    if part is None:
        raise ValueError("this is no entry of a result")
    return part


def read_part(body: bytes) -> TaskResult | None:
    """Return the arrays in the body of an entry; None if they are not there. Nothing in it is ever executed."""
    _, _, rest = body.partition(b"\n")
    start = _LENGTH + int.from_bytes(rest[:_LENGTH], "little")
    data = rest[start:]  # a copy, which begins at an aligned address
    with suppress(ValueError, TypeError, KeyError, RecursionError, zlib.error):
        places, size = _read_layout(rest[_LENGTH:start])
        if size == len(data):
            return {name: np.ndarray(shape, kind, data, start) for name, kind, shape, start in places}
    return None


@lru_cache(1024)
def _read_layout(compressed: bytes) -> tuple[list[tuple[str, np.dtype[Any], tuple[int, ...], int]], int]:
    """Return name, type, shape and first byte of each array, and the number of bytes of all."""
    places, start = list[tuple[str, np.dtype[Any], tuple[int, ...], int]](), 0
    for name, kind, shape in json.loads(zlib.decompressobj().decompress(compressed, _MOST_LAYOUT)):
        dtype = np.dtype(str(kind))
        if dtype.kind not in _KINDS or dtype.names is not None or any(type(n) is not int or n < 0 for n in shape):
            raise ValueError
        places.append((str(name), dtype, tuple(shape), start))
        length = dtype.itemsize * math.prod(shape)
        start += length + -length % _ALIGNMENT
    return places, start


def scan(stream: FileIO) -> Iterator[tuple[int, bytes]]:
    """Yield place and body of each sound entry of a file; what is damaged is passed over."""
    size, place = stream.seek(0, os.SEEK_END), 0
    while place + HEAD <= size:
        body = read_body(stream, place, size)
        if body is not None:
            yield place, body
            place += HEAD + len(body)
        else:
            place = _find_mark(stream, place + 1, size)


def read_body(stream: FileIO, place: int, size: int) -> bytes | None:
    """Return the body of the entry that begins at a place; None if no sound one does."""
    head = read_bytes_at(stream, place, HEAD)
    length = int.from_bytes(head[len(MARK) : len(MARK) + 8], "little")
    if not head.startswith(MARK) or length > size - place - HEAD:
        return None
    body = read_bytes_at(stream, place + HEAD, length)
    return body if len(body) == length and hashlib.sha256(body).digest() == head[-32:] else None


def _find_mark(stream: FileIO, place: int, size: int) -> int:
    """Return the place of the next mark, or the size of the file."""
    while place < size:
        found = read_bytes_at(stream, place, _CHUNK).find(MARK)
        if found >= 0:
            return place + found
        place += _CHUNK - len(MARK) + 1  # a mark may reach from one chunk into the next
    return size


def read_bytes_at(stream: FileIO, place: int, length: int) -> bytes:
    """Return so many bytes of a file from a place on, fewer if it ends before."""
    stream.seek(place)
    pieces = list[bytes]()
    while length > 0 and (piece := stream.read(length)):
        pieces.append(piece)
        length -= len(piece)
    return b"".join(pieces)


def name_of(body: bytes) -> str:
    """Return the name of the entry that has this body."""
    return body.partition(b"\n")[0].decode("utf-8", "replace")


def read_entries(path: str | os.PathLike[str]) -> Iterator[tuple[str, TaskResult]]:
    """Yield name and result of every sound entry of a store, in the order in which they were found.

    The store may be growing meanwhile: entries that are not complete yet are left out. Of a task that is done in steps,
    each step is one entry, with those before it.
    """
    with open(path, "rb", buffering=0) as stream:
        for _, body in scan(stream):
            if (name := name_of(body)) != IDENTITY and (part := read_part(body)) is not None:
                yield name, part
