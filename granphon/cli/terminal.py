"""Printing of lines, tables, warnings, errors and interruptions on the command line."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from granphon.base.errors import InputError, one_line

if TYPE_CHECKING:
    from granphon.scene.scene import Scene


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
        raise InputError(f"{option} is empty", mend="Name a file or folder; perhaps a shell variable is not set")


class Interrupted(Exception):
    """An interruption, whose message says what it has left in the folder of the results."""


@contextmanager
def write_of_scene(scene: str, out: str, endings: Sequence[str], force: bool, one: str = "") -> Iterator[tuple[Scene, Path]]:
    """Read a scene, and yield it with the place where the block writes the file ``out``, which arrives whole or not at all.

    Raises :class:`~granphon.base.errors.InputError` if the name has none of the ``endings``, or if the scene has several
    states and the block, as ``one`` says, takes a single one.
    """
    from granphon.base.staging import ResultFiles
    from granphon.scene.scene import Scene

    require_name("--out", out)
    target = Path(out)
    if target.suffix not in endings:
        what = f"--out is {out}, whose ending is not {' or '.join(endings)}"
        mend = f"Use {' or '.join(endings)}" if len(endings) > 1 else f"Give a name that ends in {endings[0]}"
        raise InputError(what, mend=mend)
    read = Scene.from_yaml(scene)
    with ResultFiles(target.parent, [target.name], force, inputs=read.origin.inputs).open() as locked:
        if one and not read.is_single:
            mend = "Keep one load, one medium, and no block 'sweep'"
            raise InputError(f"{scene} has many states", one, mend)
        with locked.staging() as place:
            yield read, place / target.name
    say(f"Wrote {out}")


@contextmanager
def tell_interruption(left: Callable[[], str]) -> Iterator[None]:
    """Turn an interruption of the block into :class:`Interrupted`, with the text that ``left`` returns then."""
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(left()) from None
