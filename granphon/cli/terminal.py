"""Printing of lines, tables, warnings, errors and interruptions on the command line."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from granphon.base.errors import InputError, message, one_line

#: end of the message of an interruption that comes before a result is written
NOTHING_WRITTEN = "no result was written."
#: what it adds if tasks have been finished
GO_ON = "The finished parts are kept: run the same command again to continue."


def say_table(rows: Sequence[tuple[str, str]]) -> None:
    """Print rows of a name and a text each, in two columns."""
    width = max(22, *(len(name) + 1 for name, _ in rows)) if rows else 0
    for name, text in rows:
        say(f"  {name:<{width}}{text}")


def say(text: str) -> None:
    """Print a line; what cannot be printed, and characters that the encoding of stdout lacks, are backslash escapes."""
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    print(one_line(text).encode(encoding, "backslashreplace").decode(encoding))


def warn(warnings: Sequence[str], most: int = 10) -> None:
    """Print at most ``most`` warnings on standard error, and then how many more there are."""
    more = [f"and {len(warnings) - most} more"] if len(warnings) > most else []
    for warning in (*warnings[:most], *more):
        print(f"granphon: warning: {one_line(warning)}", file=sys.stderr)


def fail(text: str, code: int) -> int:
    """Print an error on standard error as one line, and return the exit ``code``."""
    print("granphon: error: " + one_line(" ".join(text.split())), file=sys.stderr)
    return code


def require_name(option: str, path: str | None) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the path given for ``option`` is an empty text."""
    if path == "":
        raise InputError(message(f"{option} is empty", mend="Name a file or folder; perhaps a shell variable is not set"))


class Interrupted(Exception):
    """An interruption, whose message says what it has left in the folder of the results."""


@contextmanager
def tell_interruption(left: Callable[[], str]) -> Iterator[None]:
    """Turn an interruption of the block into :class:`Interrupted`, with the text that ``left`` returns then."""
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(left()) from None
