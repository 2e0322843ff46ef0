"""How figures look, and the one door through which they are saved. matplotlib is not loaded for it.

Polarisations have a colour each, the same in every figure; they are told apart by every eye, and in grey.
"""

from __future__ import annotations

import os
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granphon.base.errors import FigureError, GranphonError, message
from granphon.base.scales import HertzPrefix, prefixed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "BLUE", "COLOURS", "COLUMN_WIDTH", "FRAME", "GREEN", "GUIDE", "LONGITUDINAL_COLOUR", "ORANGE", "PAGE_WIDTH", "PURPLE",
    "DPI", "SKY_BLUE", "STYLE", "TRANSVERSE_COLOUR", "VERMILION", "draw", "print_hertz", "readable_unit", "save_figure",
    "shorten_error",
]  # fmt: skip

#: settings for a column of 3.4 inches, for ``with matplotlib.rc_context(plot.STYLE)``
STYLE: dict[Any, Any] = {
    "font.size": 8.0, "axes.titlesize": 8.0, "axes.labelsize": 8.0, "xtick.labelsize": 7.5, "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5, "figure.titlesize": 8.5, "axes.linewidth": 0.6, "xtick.major.width": 0.6,
    "ytick.major.width": 0.6, "xtick.direction": "in", "ytick.direction": "in", "legend.frameon": False,
    "legend.handlelength": 1.6, "svg.fonttype": "none", "pdf.fonttype": 42,
}  # fmt: skip
#: width of a figure of one column, and of one across the page, in inches
COLUMN_WIDTH = 3.4
PAGE_WIDTH = 7.0
#: of figures that are saved as pictures, in dots per inch
DPI = 300
#: colours that every eye tells apart, in grey too
BLUE = "#0072B2"
VERMILION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY_BLUE = "#56B4E9"
#: in the order in which lines take them
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY_BLUE)
#: grey of lines to compare with, and of lines that part panels
GUIDE = "0.6"
FRAME = "0.75"
#: of longitudinal and transverse waves, and of the branches that begin as they do
LONGITUDINAL_COLOUR = "#0D0887"
TRANSVERSE_COLOUR = SKY_BLUE
#: letters of what matplotlib says that are handed on
_REASON = 300


def shorten_error(error: Exception) -> str:
    """What an error of matplotlib says, for one line of a terminal."""
    return textwrap.shorten(str(error) or type(error).__name__, _REASON, placeholder=" ...")


def readable_unit(largest: float, unit: str) -> tuple[float, str]:
    """The decimal multiple of ``unit`` that suits a value: its size in that unit, and its name as it is printed."""
    if unit not in ("m", "Pa", "N", "Hz"):
        return 1.0, "" if unit == "1" else unit
    size, name = prefixed(largest, unit)
    return size, name.replace("u", "µ")


def print_hertz(unit: HertzPrefix) -> str:
    """The name of a decimal unit of hertz as it is printed."""
    return unit.name.replace("uHz", "µHz")


def save_figure(figure: Figure, path: str | os.PathLike[str], **options: Any) -> None:
    """Save a figure, in the format of the ending of ``path``; ``options`` are those of ``Figure.savefig``.

    Raises
    ------
    FigureError : matplotlib cannot draw it: a label with broken mathtext, ``text.usetex`` without LaTeX, a format or a
        backend that is not there. Nothing is left at ``path`` then.
    OSError : the file cannot be written.
    """
    target = Path(path)
    new = not target.exists()
    try:
        figure.savefig(target, **options)
    except Exception as error:
        # one with a number is of the file system, of which the caller tells
        if isinstance(error, (GranphonError, MemoryError)) or (isinstance(error, OSError) and error.errno is not None):
            raise
        if new:
            target.unlink(missing_ok=True)
        mend = "look at the labels, and at the settings of matplotlib (matplotlibrc)"
        # a backend that was asked for comes first: it may not be there, or lack what it needs
        mend = f"Leave --backend (backend) out or give another, or {mend}" if options.get("backend") else mend.capitalize()
        raise FigureError(message(f"{target.name} could not be drawn: {shorten_error(error)}", mend=mend)) from error


def draw(figure: Callable[[str], Figure], names: Sequence[str], folder: Path) -> dict[str, str]:
    """Save the figures ``names``, each made by ``figure``, beside numbers that are worth more than a picture of them.

    Returns the names of those that could not be drawn, with a sentence each. OSError if a file cannot be written.
    """
    failures = {}
    for name in names:
        try:
            save_figure(figure(name), folder / name)
        except OSError:
            raise
        except FigureError as error:
            told = str(error)
            failures[name] = told if told.startswith(name) else f"{name} could not be drawn: {told}"
        except Exception as error:
            failures[name] = f"{name} could not be drawn: {type(error).__name__}: {error}"
    return failures
