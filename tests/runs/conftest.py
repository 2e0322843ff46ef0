"""Shared by the tests of runs: a working folder, and disks that are full or keep no locks."""

import math
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest


@pytest.fixture
def chdir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@contextmanager
def connecting(kind: type[sqlite3.Connection]):
    """Let connections to stores be of this kind."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sqlite3, "connect", partial(sqlite3.connect, factory=kind))
        yield


@contextmanager
def full_disk(most: int = 0):
    """A disk on which so many results find room."""
    calls = []

    class Full(sqlite3.Connection):
        def execute(self, order, *values):
            found = super().execute(order, *values)
            if order == "BEGIN IMMEDIATE":
                calls.append(order)
                # no more than it has
                super().execute(f"PRAGMA max_page_count = {1 if len(calls) > most else 999}")
            return found

    with connecting(Full):
        yield


class Meter:
    """Counts what it is told; interrupts when ``stop`` tasks are done."""

    def __init__(self, stop=math.inf, error=KeyboardInterrupt):
        self.steps = []
        self.done = 0.0
        self.stop = stop
        self.error = error

    @contextmanager
    def step(self, label, total=None):
        self.steps.append((label, total))
        yield self

    def advance(self, amount=1.0):
        self.done += amount
        if self.done >= self.stop:
            raise self.error


class Counted(ThreadPoolExecutor):
    """Threads, and where the steps stand that they have done."""

    def __init__(self, most=2):
        super().__init__(most)
        self.begun = []

    def submit(self, call, orders, *more):
        def note(done):
            self.begun.extend(
                task.where for (task, _), _ in zip(orders, done.result(), strict=False)
            )

        future = super().submit(call, orders, *more)
        future.add_done_callback(lambda done: done.cancelled() or done.exception() or note(done))
        return future
