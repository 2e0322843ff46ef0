"""Reading files of unknown origin: bytes of regular files, and text.

Nothing in a file is run, and only the named file is opened. Whatever cannot be read raises
:class:`~granphon.base.errors.InputError`.
"""

from __future__ import annotations

import os
import re
import stat

from granphon.base.errors import InputError, MissingFileError, brief, message

#: the largest file that is read, bytes
MOST_FILE_BYTES = 256_000_000


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
        # without O_NONBLOCK, opening a pipe that nobody writes to would never return
        flags = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)
        with open(path, "rb", opener=lambda name, mode: os.open(name, mode | flags)) as stream:
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


def read_utf8(path: str | os.PathLike[str]) -> str:
    """The text of a file in UTF-8, with line feeds as the ends of lines; errors as of :func:`read_bytes`, :func:`decode`."""
    return decode(str(path), read_bytes(path)).replace("\r\n", "\n")


def decode(name: str, raw: bytes) -> str:
    """The text of a file called ``name`` that is in UTF-8, with or without a byte order mark.

    For another encoding :class:`~granphon.base.errors.InputError` names the line, the byte, and a guess of the encoding.
    """
    at = raw.find(b"\0")
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        at, guess = 0, "UTF-16"
    elif at >= 0:
        guess = "UTF-16" if len(raw) % 2 == 0 and raw.count(b"\0") >= len(raw) // 3 else ""
    else:
        try:
            return raw.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            # in Latin-1 and related encodings every byte but the control characters is a letter or a sign
            at, guess = error.start, "" if re.search(rb"[\x00-\x08\x0e-\x1f\x7f]", raw) else "Latin-1"
    line = raw.count(b"\n", 0, at) + 1
    what = f"{name}:{line} cannot be read: found the byte 0x{raw[at]:02x} where text in UTF-8 is needed"
    if not guess:
        raise InputError(message(what, "The file does not look like text", "Is this the right file?"))
    mend = f"Save it as UTF-8 where it was made, or convert it: iconv -f {guess} -t UTF-8 FILE > NEW"
    raise InputError(message(what, f"The file looks like {guess}", mend))
