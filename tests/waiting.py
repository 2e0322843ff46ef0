"""How tests wait for what a process, a thread or a page is to do: for the thing itself, never for a
time in which it should be done.
"""

from __future__ import annotations

import time
from collections.abc import Callable

#: time after which what is waited for counts as hanging, s: a test that fails takes as long, and no
#: machine that works is so slow
HANGS = 600.0


def wait_for(
    condition: Callable[[], object],
    explain: Callable[[], str] = lambda: "what was waited for did not happen",
) -> None:
    """Wait until a ``condition`` holds; fail with the words of ``explain`` if that hangs."""
    end = time.monotonic() + HANGS
    while not condition():
        assert time.monotonic() < end, explain()
        time.sleep(0.01)
