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
from numpy.typing import NDArray

from granphon.errors import FigureError, GranphonError, message

if TYPE_CHECKING:
    from matplotlib.axes import Axes
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
    from matplotlib.ticker import Locator, MaxNLocator, NullFormatter

__all__ = ["LONGITUDINAL", "POLARISATION", "ROTATION", "STYLE", "TRANSVERSE", "draw", "save_figure", "scale_axis"]

Array = NDArray[np.float64]

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


def scale_axis(ax: Axes, which: str, values: Array, plain: float = 1e3) -> None:
    """Make the x or y axis logarithmic where all values are above zero, with plain numbers up to that ratio of them."""
    there = values[np.isfinite(values)]
    if there.min() <= 0.0:
        return
    ax.set(**{f"{which}scale": "log"})
    axis, span = getattr(ax, f"{which}axis"), there.max() / there.min()
    if span < plain:
        axis.set_major_locator(_PlainTicks())
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_locator(_PlainTicks(minor=True))
    axis.set_minor_formatter(NullFormatter())


class _PlainTicks(Locator):
    """Ticks at round numbers on a logarithmic axis, four at least, and few; and the minor ones between them."""

    def __init__(self, minor: bool = False) -> None:
        self._minor = minor

    def __call__(self) -> Any:
        return self.tick_values(*self.axis.get_view_interval())  # type: ignore[union-attr]

    def tick_values(self, vmin: float, vmax: float) -> Any:
        low, high = sorted((vmin, vmax))
        inside = finer = np.empty(0)
        for ticks, between in _round_numbers(low, high):
            inside, finer = (t[(t >= low * (1.0 - 1e-9)) & (t <= high * (1.0 + 1e-9))] for t in (ticks, between))
            if inside.size >= 4:
                break
        return finer if self._minor else inside


def _round_numbers(low: float, high: float) -> Iterator[tuple[Array, Array]]:
    """Sets of round numbers about ``low`` to ``high``, of each decade, or evenly spaced in less; and finer ones of each."""
    if high / low >= 4.0:
        # as on logarithmic paper, of one decade or of several
        one = np.concatenate([np.arange(10, 20), np.arange(20, 50, 2), np.arange(50, 100, 5)]) / 10.0
        finer = one if high / low < 30.0 else np.arange(1.0, 10.0)
        decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1.0)
        coarse = [(1.0, 3.0)] if high / low > 50.0 else []
        for parts in (*coarse, (1.0, 2.0, 5.0), (1.0, 2.0, 3.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)):
            yield np.outer(decades, parts).ravel(), np.outer(decades, finer).ravel()
    for count in (5, 8, 12):
        ticks = np.asarray(MaxNLocator(count, steps=[1, 2, 5, 10]).tick_values(low, high))
        step = ticks[1] - ticks[0]
        within = 4 if f"{step:.0e}".startswith("2") else 5  # of a step of one or five, which stays round
        yield ticks, ticks[0] + step / within * np.arange(within * (ticks.size - 1) + 1)


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
