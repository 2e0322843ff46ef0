"""An Axes to draw on, and what is read back from it."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

#: a small simulation along a path of loads
PATH = {
    "shape": (4, 4),
    "friction_history": True,
    "friction_coefficient": 0.2,
    "ordered": True,
    "step_tolerance": 1.0,
}


@pytest.fixture
def ax():
    return Figure(layout="constrained").subplots()


def drawn(ax, gid):
    """The points (n, 2) of each line of a group."""
    return [np.array(line.get_xydata()) for line in ax.lines if line.get_gid() == gid]


def texts(legend):
    return [text.get_text() for text in legend.get_texts()]


def with_gid(ax, gid):
    """The artist of that group."""
    return next(artist for artist in ax.get_children() if artist.get_gid() == gid)


def read_edges(band):
    """The least and the greatest y of a band at each x, (n, 2)."""
    corners = band.get_paths()[0].vertices
    return np.array(
        [[f(corners[corners[:, 0] == x, 1]) for f in (min, max)] for x in np.unique(corners[:, 0])]
    )


def assert_inside_page(figure):
    """Nothing sticks out of the page."""
    tight = figure.get_tightbbox()
    (width, height) = figure.get_size_inches()
    assert min(tight.x0, tight.y0) >= 0.0
    assert tight.x1 <= width
    assert tight.y1 <= height
