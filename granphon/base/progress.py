"""Saying how far long work has come.

Whoever does long work takes a :class:`Progress` and tells it; by default nobody listens. The command line passes in one that
draws on stderr, and does so only if stderr is a terminal.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rich.progress import Progress as Drawing
    from rich.progress import TaskID

__all__ = ["Progress", "Silent", "Step", "Terminal", "on_stderr", "silent"]


class Step(Protocol):
    """One piece of work that is under way."""

    def advance(self, amount: float = 1.0) -> None:
        """So much more of it is done."""
        ...


class Progress(Protocol):
    """Is told what work begins, how far it has come, and that it is over."""

    def step(self, label: str, total: float | None = None) -> AbstractContextManager[Step]:
        """Begin a piece of work of size ``total`` (None: not known); it is over when the context is left."""
        ...


class Silent:
    """Says nothing."""

    def step(self, label: str, total: float | None = None) -> AbstractContextManager[Step]:
        """Begin a piece of work."""
        return nullcontext(self)

    def advance(self, amount: float = 1.0) -> None:
        """So much more of it is done."""


#: the progress that is used unless another is given
silent = Silent()


class Terminal:
    """Draws a line on stderr for the work under way, and wipes it when the work is over.

    Of work whose size is known: how many parts of it are done, and the time that the others take if they take what these
    have on average. Time is that of ``clock``, s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock

    def step(self, label: str, total: float | None = None) -> AbstractContextManager[Step]:
        """Begin a piece of work."""
        return self._drawn(label, total)

    @contextmanager
    def _drawn(self, label: str, total: float | None) -> Iterator[Step]:
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
            columns += [MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn()]
        # the rate is that since the work began: one part may well take longer than any shorter time to look back on
        with Progress(
            *columns, console=Console(stderr=True), transient=True, get_time=self._clock, speed_estimate_period=math.inf
        ) as drawing:
            yield _DrawnStep(drawing, drawing.add_task(label, total=total))


class _DrawnStep:
    def __init__(self, drawing: Drawing, task: TaskID) -> None:
        self._drawing, self._task = drawing, task

    def advance(self, amount: float = 1.0) -> None:
        self._drawing.advance(self._task, amount)


def on_stderr(quiet: bool = False) -> Progress:
    """A :class:`Terminal` if stderr is one and ``quiet`` is off, else :data:`silent`."""
    return Terminal() if not quiet and sys.stderr is not None and sys.stderr.isatty() else silent
