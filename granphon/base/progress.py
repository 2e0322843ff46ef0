"""Reports of how far long work has come.

A function that does long work takes a :class:`Progress` and reports to it; by default the reports
are ignored. The command line passes one that draws on stderr, if stderr is a terminal.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any, Protocol

from granphon.base.errors import InputError, brief


class Step(Protocol):
    """A piece of work that is under way."""

    def advance(self, amount: float = 1.0) -> None:
        """Report that ``amount`` more of this step, a number of pieces, is complete."""
        ...


class Progress(Protocol):
    """A receiver of reports: which work begins, how far it has come, and that it is over."""

    def step(self, label: str, total: float | None = None) -> AbstractContextManager[Step]:
        """Begin a step of ``total`` pieces of work (None: not known), called ``label``; the step is
        over when the context is left.
        """
        ...


class Silent:
    """A progress that ignores all reports; it is its own step."""

    def step(self, label: str, total: float | None = None) -> AbstractContextManager[Step]:
        """Begin a step, whose reports are ignored too; the arguments are those of
        :meth:`Progress.step`.
        """
        return nullcontext(self)

    def advance(self, amount: float = 1.0) -> None:
        """Ignore a report that ``amount`` more of this step is complete."""


#: the default progress, which ignores all reports
silent = Silent()


def require_progress(progress: Any) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a ``progress``, the argument of a public
    call, that has no method ``step``.
    """
    if not callable(getattr(progress, "step", None)):
        mend = "Give an object with the method step of granphon.base.progress.Progress"
        raise InputError(f"progress is {brief(progress)}", mend=mend)


class Terminal:
    """A progress that draws a line on stderr for the work under way, and wipes the line when the
    work is over.

    For work of known size, the line shows how many pieces are complete, and the time that the
    remaining pieces will take at the average rate so far. ``clock`` returns the time, s. Steps need
    the package rich, see :func:`on_stderr`.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Set the ``clock``; nothing is drawn before a step begins."""
        self._clock = clock

    @contextmanager
    def step(self, label: str, total: float | None = None) -> Iterator[Step]:
        """Begin a step of ``total`` pieces of work (None: not known), called ``label`` on the line;
        give the object whose ``advance`` moves the line.
        """
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            SpinnerColumn,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        columns = [SpinnerColumn(), TextColumn("{task.description}"), BarColumn()]
        if total is None:
            columns += [TimeElapsedColumn()]
        else:
            columns += [
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TextColumn("left"),
                TimeRemainingColumn(),
            ]
        drawing = Progress(
            *columns,
            console=Console(stderr=True),
            transient=True,  # the line is wiped at the end
            get_time=self._clock,
            # the rate is averaged since the work began: a single piece may take longer than any
            # shorter averaging period
            speed_estimate_period=math.inf,
        )
        with drawing:
            task = drawing.add_task(label, total=total)
            step: Any = SimpleNamespace(advance=lambda amount=1.0: drawing.advance(task, amount))
            yield step


def on_stderr(quiet: bool = False) -> Progress:
    """Return a :class:`Terminal` if stderr is a terminal, rich is installed and ``quiet`` is false,
    else :data:`silent`.
    """
    is_terminal = sys.stderr is not None and sys.stderr.isatty()
    can_draw = is_terminal and find_spec("rich") is not None
    return Terminal() if can_draw and not quiet else silent
