"""The command line: all commands, and what becomes of errors and interruptions."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import typer

from granphon.base.errors import GranphonError, InputError, UnverifiedFileWarning
from granphon.cli import scenes, studies  # noqa: F401  each adds its commands
from granphon.cli.app import app
from granphon.cli.terminal import NOTHING_WRITTEN, Interrupted, fail, warn

__all__ = ["app", "main"]

#: the base of typer's usage errors, wherever this version of typer keeps it
_USAGE_ERROR = next(one for one in typer.BadParameter.__mro__ if one.__name__ == "ClickException")


@contextmanager
def _take_termination_for_interruption() -> Iterator[None]:
    """Let SIGTERM (a batch system's time limit, ``kill``) clean up as an interruption does."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _tell_unverified_files() -> Iterator[None]:
    """Say in one line of a file that carries no digest that it does; other warnings stay as they are."""
    with warnings.catch_warnings():
        show = warnings.showwarning

        def tell(
            message: Warning | str, category: type[Warning], filename: str, lineno: int, file: Any = None, line: Any = None
        ) -> None:
            if issubclass(category, UnverifiedFileWarning):
                warn([str(message)])
            else:
                show(message, category, filename, lineno, file, line)

        warnings.simplefilter("always", UnverifiedFileWarning)
        warnings.showwarning = tell
        yield


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code, listed in ``granphon --help``. Raises nothing but bugs."""
    try:
        with _take_termination_for_interruption(), _tell_unverified_files():
            code = app(args=None if argv is None else list(argv), prog_name="granphon", standalone_mode=False)
        if sys.stdout is not None:  # closed before we started
            sys.stdout.flush()
        if code == 130:  # typer has caught the interruption
            raise KeyboardInterrupt
        return int(code or 0)
    except InputError as error:
        return fail(str(error), 2)
    except GranphonError as error:
        return fail(str(error), 1)
    except MemoryError:
        return fail(
            "there is not enough memory for this scene. Take a coarser mesh, or fewer points, loads, balls or samples.", 1
        )
    except Interrupted as interrupted:
        return fail(f"interrupted; {interrupted}", 130)
    except (KeyboardInterrupt, typer.Abort):
        return fail(f"interrupted; {NOTHING_WRITTEN}", 130)
    except BrokenPipeError:
        # whoever read our output has gone: keep the interpreter from writing into the pipe again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return fail(f"{error.filename or 'output'}: {error.strerror or error}", 1)
    except Exception as error:
        if isinstance(error, _USAGE_ERROR):
            return fail(f"{error.format_message()} See 'granphon --help'.", 2)  # type: ignore[attr-defined]
        raise
