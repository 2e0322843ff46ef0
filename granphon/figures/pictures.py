"""A figure that a notebook shows without pyplot."""

from __future__ import annotations

from io import BytesIO

# before matplotlib, whose import this module guards
import granphon.figures.scales  # noqa: F401

# isort: split
from matplotlib.figure import Figure

#: pixels of a screen for an inch of a figure; the picture itself has the resolution of the figure
_SCREEN = 120


class Picture(Figure):
    """A figure with the PNG that a notebook asks for; with pyplot's inline backend loaded, that backend shows it instead."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        stream = BytesIO()
        self.savefig(stream, format="png")
        width, height = (round(_SCREEN * inches) for inches in self.get_size_inches().tolist())
        return stream.getvalue(), {"width": width, "height": height}
