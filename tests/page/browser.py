"""A real browser for the tests and studies of the page: Chromium, driven by playwright (the extra
``browser``).
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

#: the browser of the system; nothing is downloaded
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))),
    None,
)
#: WebGL without a graphics card
_ARGUMENTS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
]


def explain_missing() -> str:
    """Why there is no browser to drive; an empty text if there is one."""
    try:
        import playwright  # noqa: F401
    except ImportError:
        return "playwright is not installed: pip install granphon[browser]"
    return "" if CHROMIUM else "there is no Chromium on this machine"


@contextmanager
def open_browser() -> Iterator[Any]:
    """Start a browser, and close it at the end of the block."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=_ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()
