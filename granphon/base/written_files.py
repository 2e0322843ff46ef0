"""The list of the files that granphon wrote into a folder, which tells them from the user's own files.

A file that is not in the list, or has changed since granphon wrote it, counts as the user's.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from granphon.base.errors import GranphonError
from granphon.base.reading import read_bytes

__all__ = ["LIST", "digest_file", "read_written_files", "is_written", "write_list_text", "read_record"]

#: the list of the files that granphon wrote into a folder, each with its SHA-256
LIST = ".granphon-files"
#: version of the layout of the list; a list of another version counts as empty
LIST_SCHEMA = 1


def read_written_files(folder: str | os.PathLike[str]) -> dict[str, str]:
    """Name and SHA-256 of each file that granphon wrote into ``folder``, from its list; empty if there is no list."""
    data = read_record(Path(folder) / LIST)
    files = data.get("files") if data.get("schema") == LIST_SCHEMA else None
    return {name: digest for name, digest in files.items() if isinstance(digest, str)} if isinstance(files, dict) else {}


def read_record(path: Path) -> dict[str, Any]:
    """Read one of granphon's hidden files, a mapping in JSON; empty if it is missing or is not a mapping."""
    with suppress(GranphonError, ValueError, RecursionError):
        data = json.loads(read_bytes(path))
        return data if isinstance(data, dict) else {}
    return {}


def write_list_text(files: Mapping[str, str]) -> str:
    """The text of a list of ``files``, which maps the name of each file to its SHA-256."""
    return json.dumps({"schema": LIST_SCHEMA, "files": files}, indent=1) + "\n"


def digest_file(path: Path) -> str:
    """The SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def is_written(path: Path, *digests: str) -> bool:
    """Whether ``path`` is a regular file, not a link, whose SHA-256 is one of ``digests``."""
    return bool(digests) and path.is_file() and not path.is_symlink() and digest_file(path) in digests
