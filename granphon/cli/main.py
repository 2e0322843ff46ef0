"""The command line: it runs a subcommand and turns errors and interruptions into messages and exit
codes.
"""

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

from granphon.base.errors import (
    CacheWarning,
    GranphonError,
    InconsistencyWarning,
    InputError,
    MissingPackageError,
    UnverifiedFileWarning,
)
from granphon.cli import (  # noqa: F401  importing them adds their commands to app
    doctor,
    pictures,
    report,
    scenes,
    studies,
    velocity,
)
from granphon.cli.app import GROUPS, app
from granphon.cli.terminal import (
    NOTHING_WRITTEN,
    Interrupted,
    fail,
    forget_warnings,
    warn_of_file,
)

# by groups, whatever the order in which the modules were imported
app.registered_commands.sort(key=lambda command: GROUPS.index(command.rich_help_panel))

#: the class ClickException, base of typer's usage errors; found by its name, as its module depends
#: on the version of typer
_USAGE_ERROR = next(
    base for base in typer.BadParameter.__mro__ if base.__name__ == "ClickException"
)


@contextmanager
def _take_signals_and_warnings() -> Iterator[None]:
    """Within the with-block, treat SIGTERM (a batch system's time limit, ``kill``) as an
    interruption, so that the work is cleaned up. Only the main thread can set a handler: in any
    other thread signals are left as they are.

    Each of these warnings is printed once, as one line: about a file that carries no digest, about
    a file whose numbers contradict each other, and about the folder in which numba keeps compiled
    loops. Other warnings are shown as usual. Which warnings were printed before the block is
    forgotten.
    """
    show_as_usual = warnings.showwarning

    def show_warning(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: Any = None,
        line: Any = None,
    ) -> None:
        """Print a warning of files or of numba's folder in one line, and show another one as usual;
        the arguments are those of :func:`warnings.showwarning`.
        """
        if issubclass(category, UnverifiedFileWarning | InconsistencyWarning | CacheWarning):
            warn_of_file(str(message))
        else:
            show_as_usual(message, category, filename, lineno, file, line)

    earlier_handler = None
    # Python lets no other thread set a handler
    if threading.current_thread() is threading.main_thread():
        earlier_handler = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with warnings.catch_warnings():
            # Python would show once what one line of code says of several files
            for category in (UnverifiedFileWarning, InconsistencyWarning):
                warnings.simplefilter("always", category)
            warnings.showwarning = show_warning
            forget_warnings()
            yield
    finally:
        # None in another thread, and of a handler that Python has not set and cannot set again
        if earlier_handler is not None:
            signal.signal(signal.SIGTERM, earlier_handler)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line ``argv``, by default that of the process, and return the exit code, one
    of those listed in ``granphon --help``.

    Errors of the input, of the command line, of the file system and of the computation, a lack of
    memory and interruptions become one line on standard error. If the program that reads the output
    has ended, the exit code is 1, without a message. Any other exception is a bug and is raised.
    """
    try:
        with _take_signals_and_warnings():
            code = app(
                args=None if argv is None else list(argv),
                prog_name="granphon",
                standalone_mode=False,
            )
        if sys.stdout is not None:  # None if it was closed before Python started
            sys.stdout.flush()
        if code == 130:  # typer returns this code when it has caught the interruption
            raise KeyboardInterrupt
        return int(code or 0)
    except (InputError, MissingPackageError) as error:
        return fail(str(error), 2)
    except GranphonError as error:
        return fail(str(error), 1)
    except MemoryError:
        mend = "Take a coarser mesh, or fewer points, loads, balls or samples"
        return fail(f"there is not enough memory. {mend}.", 1)
    except Interrupted as interrupted:
        return fail(f"interrupted; {interrupted}", 130)
    except (KeyboardInterrupt, typer.Abort):
        return fail(f"interrupted; {NOTHING_WRITTEN}", 130)
    except BrokenPipeError:
        # The interpreter flushes stdout once more at exit, which would fail again: from here on the
        # output goes to the null device.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        name = error.filename or "output"
        return fail(f"{name}: {error.strerror or error}", 1)
    except Exception as error:
        if isinstance(error, _USAGE_ERROR):
            return fail(_explain_usage(error), 2)
        raise


def _explain_usage(error: Any) -> str:
    """Return the message of a usage ``error`` of typer, and behind it the command that prints the
    help of the subcommand at fault, or of granphon if no subcommand is.
    """
    message = error.format_message().rstrip(".")
    if not message.endswith("?"):
        message += "."
    context = getattr(error, "ctx", None)
    command = context.command_path if context else "granphon"
    return f"{message} See '{command} --help'."
