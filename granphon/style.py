"""How figures look, and the one door through which they are saved. No backend of matplotlib and no pyplot is loaded.

Polarisations have a colour each, the same in every figure; they are told apart by every eye, and in grey.
"""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.errors import FigureError, GranphonError, message

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextmanager
def _whatever_backend() -> Iterator[None]:
    """Import matplotlib although MPLBACKEND names a backend that is not there: a figure that is saved needs none."""
    first = "matplotlib" not in sys.modules
    given = os.environ.pop("MPLBACKEND", None)
    try:
        yield
    finally:
        if given is not None:
            os.environ["MPLBACKEND"] = given
    if first and given:
        with suppress(ValueError):  # as matplotlib itself does, which refuses to be imported on a name it does not know
            matplotlib.rcParams["backend"] = given


with _whatever_backend():
    import matplotlib
    from matplotlib.colors import LinearSegmentedColormap

__all__ = ["LONGITUDINAL", "POLARISATION", "ROTATION", "STYLE", "TRANSVERSE", "draw", "save_figure"]

#: settings for a column of 3.4 inches, for ``with matplotlib.rc_context(plot.STYLE)``
STYLE: dict[Any, Any] = {
    "font.size": 8.0, "axes.titlesize": 8.0, "axes.labelsize": 8.0, "xtick.labelsize": 7.5, "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5, "figure.titlesize": 8.5, "axes.linewidth": 0.6, "xtick.major.width": 0.6,
    "ytick.major.width": 0.6, "xtick.direction": "in", "ytick.direction": "in", "legend.frameon": False,
    "legend.handlelength": 1.6, "svg.fonttype": "none", "pdf.fonttype": 42,
}  # fmt: skip
#: from translation (0) to rotation (1): the uniform map "plasma" without its light end
ROTATION = LinearSegmentedColormap.from_list("rotation", matplotlib.colormaps["plasma"](np.linspace(0.0, 0.8, 256)))
#: of waves, and of the branches that begin as they do
LONGITUDINAL, TRANSVERSE = "#0D0887", "#56B4E9"
#: from transverse (0) to longitudinal (1)
POLARISATION = LinearSegmentedColormap.from_list("polarisation", [TRANSVERSE, LONGITUDINAL])
#: letters of what matplotlib says that are handed on
_REASON = 300


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
        reason = textwrap.shorten(str(error) or type(error).__name__, _REASON, placeholder=" ...")
        mend = "Look at the labels, and at the settings of matplotlib (matplotlibrc)"
        raise FigureError(message(f"{target.name} could not be drawn: {reason}", mend=mend)) from error


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
            failures[name] = str(error)
        except Exception as error:
            failures[name] = f"{name} could not be drawn: {type(error).__name__}: {error}"
    return failures
