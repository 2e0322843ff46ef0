"""What workers call in tests: a module that a new process loads in a moment."""

from __future__ import annotations

import os
import signal
from multiprocessing.connection import Connection


class UnpicklableError(Exception):
    """An error that cannot be made again from what it says."""

    def __init__(self, words: str, place: int) -> None:
        super().__init__(f"{words} at {place}")


def raise_unpicklable() -> None:
    """Raise an error that cannot come back from a worker as it is."""
    raise UnpicklableError("none", 3)


def end_within_a_result() -> bytes:
    """End this process by force when half of the result is on its way."""

    def write_half(pipe: Connection, data: bytes) -> None:
        os.write(pipe.fileno(), bytes(data[: len(data) // 2]))
        os.kill(os.getpid(), signal.SIGKILL)

    Connection._send = write_half  # type: ignore[attr-defined]
    return bytes(1000)
