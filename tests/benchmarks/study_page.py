"""How long the page takes for one redraw, in a real browser: ``python
tests/benchmarks/study_page.py [LATTICE ...]``.

For each lattice, with its own motions: the number of branches and of the points of the path while a
slider moves, the least and the median time of computing and drawing them, ms, and the redraws a
second that the median allows. A slider is moved a little before each redraw.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.balls.loads import Load
from granphon.media.choice import MediumChoice
from granphon.page.page import make_page

sys.path.append(str(Path(__file__).parent.parent / "page"))
import browser

BALLS = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
#: redraws that are measured, after as many that warm the browser up
REDRAWS = 60


def study(chromium, name: str) -> str:
    """Measure one lattice; return a line of the table."""
    page_text = make_page(
        replace(BALLS, lattice=name), [MediumChoice("afa")], Load("force", 18.446), title=name
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        path.write_text(page_text, encoding="utf-8")
        page = chromium.new_page(viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
        page.goto(path.as_uri())
        page.wait_for_function("() => document.getElementById('dos-help').textContent !== ''")
        times = page.evaluate(
            """(count) => Array.from({ length: 2 * count }, (_, n) => {
            granphon.state().eta = 0.5 + 0.2 * Math.sin(n);
            return granphon.redraw(); }).slice(count)""",
            REDRAWS,
        )
        branches, points = page.evaluate(
            "() => [current.lattice.branches, current.path.points.length]"
        )
        page.close()
    median = float(np.median(times))
    return (
        f"{name:<12}{branches:>9}{points:>8}{median:>11.1f}{min(times):>9.1f}{1e3 / median:>10.0f}"
    )


if __name__ == "__main__":
    if why := browser.explain_missing():
        sys.exit(why)
    print(
        f"{'lattice':<12}{'branches':>9}{'points':>8}{'median ms':>11}{'least':>9}{'a second':>10}"
    )
    with browser.open_browser() as found:
        for lattice in sys.argv[1:] or LATTICES:
            print(study(found, lattice), flush=True)
