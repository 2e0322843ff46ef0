"""What all tests of scenes share."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def brief_estimates(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scene of waves estimates its time from a small piece of work, which is repeated for a
    fifth of the usual time.
    """
    monkeypatch.setattr("granphon.media.cost._REPEATED_SECONDS", 0.01)
