"""The looks of figures, and the functions that save figures; this module does not load matplotlib.

Each polarisation has a colour, the same in every figure. The colours differ for every kind of
colour vision, and in grey.
"""

from __future__ import annotations

import itertools
import os
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.base.errors import FigureError, GranphonError
from granphon.base.scales import HertzPrefix
from granphon.base.staging import put_beside
from granphon.base.text import require_path

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.figure import Figure


#: settings of matplotlib for a column of 3.4 inches, for ``with matplotlib.rc_context(STYLE)``
STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "figure.titlesize": 8.5,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
}
#: width of a figure of one column, and of one across the page, in inches
COLUMN_WIDTH = 3.4
PAGE_WIDTH = 7.0
#: unit of letters and lines
POINTS_PER_INCH = 72.0
#: resolution of figures that are saved as pixels, in dots per inch
DPI = 300
#: colours that every eye tells apart, in grey too
BLUE = "#0072B2"
VERMILION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY_BLUE = "#56B4E9"
#: colours of lines, in the order in which they are used
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY_BLUE)
#: grey of lines to compare with, and of lines that separate parts of a panel
GUIDE = "0.6"
FRAME = "0.75"
#: colours of longitudinal and transverse waves, and of the branches that begin as such waves
LONGITUDINAL_COLOUR = "#0D0887"
TRANSVERSE_COLOUR = SKY_BLUE
#: colours of balls of several kinds, in the order of kinds, and colour of all further kinds: every
#: eye tells the colours apart, and black arrows stand out on them
KIND_COLOURS = (SKY_BLUE, ORANGE, "#1F8A63", "#F7C3DE", "#F4EFB0", "#8F55B5")
OTHER_KINDS = "#9A9A9A"


def shorten_error(error: Exception) -> str:
    """Return the message of an error of matplotlib on one line, of 300 characters at most; of an
    error without a message the name of its class.
    """
    return textwrap.shorten(str(error) or type(error).__name__, 300, placeholder=" ...")


def write_hertz(unit: HertzPrefix) -> str:
    """Return the name of a decimal unit of hertz as it stands in figures, "µHz" for "uHz"."""
    return unit.name.replace("uHz", "µHz")


def colour_kinds(kinds: Iterable[str]) -> dict[str, str]:
    """Return the colours of kinds of balls by the names of the kinds, in the order in which they
    first appear; ``kinds`` has the name of the kind of each ball. The mapping is empty if there are
    fewer than two kinds.
    """
    names = list(dict.fromkeys(kinds))  # each once, in order
    if len(names) < 2:
        return {}
    colours = itertools.chain(KIND_COLOURS, itertools.repeat(OTHER_KINDS))
    return dict(zip(names, colours, strict=False))


def pick_evenly(count: int, most: int) -> list[int]:
    """Return at most ``most`` of the numbers 0 to ``count`` - 1, ascending, at distances that are
    even but for rounding. The first and the last number are among them; if ``most`` is 1, the first
    alone. The list is empty if ``count`` or ``most`` is zero.
    """
    numbers = np.linspace(0, count - 1, min(count, most)).round().astype(int)
    indices: list[int] = np.unique(numbers).tolist()
    return indices


def save_figure(figure: Figure, path: str | os.PathLike[str], **options: Any) -> None:
    """Save a figure, in the format of the suffix of ``path``; ``options`` are those of
    ``Figure.savefig``. A ``path`` without a suffix gets that of matplotlib's ``savefig.format``,
    unless the options have a ``format``.

    The folder is made if need be. The figure keeps the places of its axes at which it is saved.

    Raises
    ------
    FigureError : matplotlib cannot draw the figure: a label with broken mathtext, ``text.usetex``
        without LaTeX, an unknown format or backend. What was at ``path`` stays as it was.
    InputError : ``path`` is no name of a file.
    OutputError : the file cannot be written; this is an OSError.
    """
    from matplotlib import rcParams

    target = _read_target(path)
    if target.name and not target.suffix and options.get("format") is None:
        target = target.with_name(f"{target.name}.{rcParams['savefig.format']}")
    suspects = "at the labels, and at the settings of matplotlib (matplotlibrc)"
    mend = f"Look {suspects}"
    if options.get("backend"):  # the backend may be missing, or lack a package
        mend = f"Leave --backend (backend) out or give another, or look {suspects}"
    with _explain_failure(target, mend) as file, _laid_out(figure):
        figure.savefig(file, **options)


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Lay out a figure, and take its layout engine away within the block: with an engine,
    matplotlib draws the figure twice to save it once, the first time for the layout alone.

    Within the block the figure is on a canvas for pixels, whose renderer measures texts once for
    the layout and for the picture.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    engine = figure.get_layout_engine()
    if engine is None:
        yield
        return
    canvas = figure.canvas
    FigureCanvasAgg(figure)  # becomes the canvas of the figure
    try:
        engine.execute(figure)
        # no engine, also where the settings of matplotlib name one for all figures
        with rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
            figure.set_layout_engine(None)
        yield
    finally:
        figure.set_layout_engine(engine)
        figure.set_canvas(canvas)


def save_animation(animation: FuncAnimation, path: str | os.PathLike[str]) -> None:
    """Save an animation in the format of the suffix of ``path``, such as a GIF, which repeats;
    raises what :func:`save_figure` raises.
    """
    mend = "Look at the settings of matplotlib (matplotlibrc), and at how Pillow is installed"
    with _explain_failure(_read_target(path), mend) as file:
        animation.save(file, writer="pillow")


def _read_target(path: str | os.PathLike[str]) -> Path:
    """Return the ``path`` of a picture; InputError for what is no name of a file."""
    require_path(path)
    return Path(path)


@contextmanager
def _explain_failure(target: Path, mend: str) -> Iterator[Path]:
    """Give to the block the path of a new file beside ``target``, with the same suffix, in which
    the block saves a picture; after the block the file takes the place of ``target``. The folder is
    made if need be.

    If the picture cannot be drawn, the file is removed, and FigureError is raised with the advice
    ``mend``. Errors of the file system become OutputError; a lack of memory and granphon's own
    errors pass as they are.
    """
    with put_beside(target) as temporary:
        file = temporary.with_name(f"{temporary.name}-drawn{target.suffix}")
        try:
            yield file
            file.replace(temporary)
        except Exception as error:
            # an OSError with a number comes from the file system, and the caller explains it
            is_of_file_system = isinstance(error, OSError) and error.errno is not None
            if is_of_file_system or isinstance(error, GranphonError | MemoryError):
                raise
            raise FigureError(
                f"{target.name} could not be drawn: {shorten_error(error)}", mend=mend
            ) from error
        finally:
            with suppress(OSError):
                file.unlink()


def draw(
    make_figure: Callable[[str], Figure], names: Sequence[str], folder: Path
) -> dict[str, str]:
    """Save the figures of the files ``names``, each made by ``make_figure`` from its name, in
    ``folder``; a figure that cannot be drawn does not stop the others.

    Returns a sentence for each figure that could not be drawn, by name. Raises OSError if a file
    cannot be written, or cannot be read by ``make_figure``.
    """
    failures = {}
    for name in names:
        try:
            save_figure(make_figure(name), folder / name)
        except OSError:
            raise
        except GranphonError as error:
            sentence = str(error)
            if not sentence.startswith(name):
                sentence = f"{name} could not be drawn: {sentence}"
            failures[name] = sentence
        except Exception as error:
            failures[name] = f"{name} could not be drawn: {type(error).__name__}: {error}"
    return failures
