"""Files packed by gzip or Zstandard, as programs write them: unpacked in memory, up to a limit."""

from __future__ import annotations

import zlib
from importlib import import_module
from typing import Any

from granphon.base.errors import InputError, MissingPackageError
from granphon.base.text import write_limit

#: first bytes of a file packed by gzip, and by Zstandard
_GZIP_HEAD = b"\x1f\x8b"
_ZSTANDARD_HEAD = b"\x28\xb5\x2f\xfd"
#: modules with a ZstdDecompressor of the standard library's form: from Python 3.14 on its own, and
#: the same for older ones
_ZSTANDARD_MODULES = ("compression.zstd", "backports.zstd")
#: the window bits by which zlib reads the head of gzip
_GZIP_WINDOW = 31


def unpack(name: str, raw: bytes, limit: int) -> tuple[bytes, bool]:
    """Return the content of the bytes ``raw`` of a file called ``name``, which may be packed, and
    whether the file is whole: of a packed file that is cut, the content before the cut. Bytes that
    are not packed are returned as they are, whatever their number, and count as whole.

    Raises
    ------
    InputError : a packed file holds more than ``limit`` bytes of content, or is damaged.
    MissingPackageError : the file is packed by Zstandard, and nothing is installed that reads it.
    """
    if raw.startswith(_GZIP_HEAD):
        return _unpack_members(name, raw, limit, lambda: zlib.decompressobj(_GZIP_WINDOW))
    if raw.startswith(_ZSTANDARD_HEAD):
        return _unpack_members(name, raw, limit, _find_zstandard(name).ZstdDecompressor)
    return raw, True


def _find_zstandard(name: str) -> Any:
    """Return a module that unpacks Zstandard; MissingPackageError, which calls the packed file
    ``name``, if there is none.
    """
    for module in _ZSTANDARD_MODULES:
        try:
            return import_module(module)
        except ImportError:
            continue
    fault = f"{name} is packed by Zstandard, which this Python does not read"
    mend = "Install it: pip install backports.zstd; or unpack the file: unzstd FILE"
    raise MissingPackageError(fault, mend=mend)


def _unpack_members(name: str, raw: bytes, limit: int, make_unpacker: Any) -> tuple[bytes, bool]:
    """Return the content of the packed bytes ``raw``, and whether the last of their members is
    whole. A packed file is one member, or several that follow each other; ``make_unpacker`` returns
    a new object that unpacks one member. The other arguments and the errors are those of
    :func:`unpack`.
    """
    parts: list[bytes] = []
    n_left = limit + 1  # a byte beyond the limit shows that the content is too large
    # zeros may fill up the file after its last member
    while raw.strip(b"\0") and n_left > 0:
        member = make_unpacker()
        try:
            content = member.decompress(raw, n_left)
        except Exception as error:  # each module has its own class
            fault = f"{name} cannot be unpacked: {error}"
            raise InputError(fault, "The packed file is damaged", "Make it again") from None
        parts.append(content)
        n_left -= len(content)
        # at the limit the unpacker stops before the end of a member, which need not be cut
        is_cut = not member.eof and n_left > 0
        if is_cut:
            return b"".join(parts), False
        raw = member.unused_data
    if n_left <= 0:
        fault = f"{name} holds more than {write_limit(limit)} when it is unpacked"
        raise InputError(fault, mend="Is this the right file?")
    return b"".join(parts), True
