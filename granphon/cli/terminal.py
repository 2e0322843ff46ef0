"""What the command line prints, and what it says of an interruption."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from granphon.base.errors import InputError, message

__all__ = ["NOTHING_WRITTEN", "Interrupted", "fail", "require_name", "say", "say_table", "tell_interruption", "warn"]

#: what an interruption says where no result has been written
NOTHING_WRITTEN = "no result was written."


def say_table(rows: Sequence[tuple[str, str]]) -> None:
    """Print rows of names and texts, the texts below each other."""
    for name, text in rows:
        say(f"  {name:<22}{text}")


def say(text: str) -> None:
    """Print a line; characters that the output cannot show are printed as their codes."""
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    print(text.encode(encoding, "backslashreplace").decode(encoding))


def warn(warnings: Sequence[str], most: int = 10) -> None:
    """Print warnings on standard error, ``most`` of them and how many more there are."""
    more = [f"and {len(warnings) - most} more"] if len(warnings) > most else []
    for warning in (*warnings[:most], *more):
        print(f"granphon: warning: {warning}", file=sys.stderr)


def fail(text: str, code: int) -> int:
    """Print an error on standard error as one line; returns the exit ``code``."""
    print("granphon: error: " + " ".join(text.split()), file=sys.stderr)
    return code


def require_name(option: str, path: str | None) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the file or folder of an option is an empty text."""
    if path == "":
        raise InputError(message(f"{option} is empty", mend="Name a file or folder; was a shell variable not set"))


class Interrupted(Exception):
    """An interruption; says what it has left."""


@contextmanager
def tell_interruption(left: Callable[[], str]) -> Iterator[None]:
    """Let an interruption of the block say what it has ``left``."""
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(left()) from None
