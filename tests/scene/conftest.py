"""Shared by the tests of scenes: a machine of little memory, on which nothing may be run."""

from collections.abc import Callable

import pytest


@pytest.fixture
def memory(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Let the machine have so much memory, in B."""
    return lambda amount: monkeypatch.setattr("granphon.media.cost.available_memory", lambda: amount)
