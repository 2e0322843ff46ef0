"""The guarded import of matplotlib, and the scales of axes, maps of colours and legends of figures.

Every module that draws imports this module before matplotlib. No backend of matplotlib and no
pyplot is loaded. Raises :class:`~granphon.base.errors.MissingPackageError` if matplotlib is not
installed, and :class:`~granphon.base.errors.FigureError` if its settings cannot be read.
"""

from __future__ import annotations

import logging
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from io import BytesIO
from logging.handlers import BufferingHandler
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array, Index
from granphon.base.errors import FigureError, InputError, MissingPackageError, brief, needing
from granphon.base.scales import HertzPrefix, prefixed
from granphon.base.validation import real_array
from granphon.figures.style import (
    COLUMN_WIDTH,
    DPI,
    FRAME,
    LONGITUDINAL_COLOUR,
    POINTS_PER_INCH,
    STYLE,
    TRANSVERSE_COLOUR,
    shorten_error,
    write_hertz,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

    from granphon.networks.network import ContactNetwork


#: relative error below which the band of a curve is hidden behind its line: on an axis of 150
#: points from zero the band is then narrower than about one point
_LEAST_VISIBLE_ERROR = 3e-3
#: part of the greatest value above which a value counts for the relative errors that a legend
#: tells: the relative error of a value near zero says nothing
_LEAST_VALUE = 1e-3
#: density of states, over the greatest of its curve, up to which a frequency counts as empty
_LEAST_DENSITY = 1e-6
#: label of bands of standard errors
STANDARD_ERROR = "standard error"
#: greatest number of records of the log of an import
_MOST_RECORDS = 1000


@contextmanager
def _guard_import() -> Iterator[None]:
    """Let the block import matplotlib, even if MPLBACKEND names a backend that does not exist:
    saving a figure needs no backend.

    MPLBACKEND is taken out of the environment during the block; afterwards it is put back, and if
    matplotlib was imported for the first time and knows the backend, matplotlib uses it. What
    matplotlib logs in the block is logged at its end, or stands in the error. Raises
    :class:`~granphon.base.errors.FigureError`, with what matplotlib has logged, if the import
    fails, and :class:`~granphon.base.errors.MissingPackageError` without matplotlib.
    """
    is_first_import = "matplotlib" not in sys.modules
    backend = os.environ.pop("MPLBACKEND", None)
    log = logging.getLogger("matplotlib")
    log_of_import = BufferingHandler(_MOST_RECORDS)
    log.addHandler(log_of_import)
    try:
        with needing("A figure"):
            yield
    except (MemoryError, MissingPackageError):
        raise
    except Exception as error:
        # the settings raise errors of many kinds: of the file system, of texts that are not UTF-8;
        # the log names the file at fault
        why = " ".join(record.getMessage() for record in log_of_import.buffer)
        log_of_import.buffer = []  # told here, and not logged again below
        mend = "Look at its settings (matplotlibrc, MATPLOTLIBRC) and how it is installed"
        raise FigureError(
            f"matplotlib cannot be imported: {shorten_error(error)}", why, mend
        ) from error
    finally:
        log.removeHandler(log_of_import)
        for record in log_of_import.buffer:
            log.handle(record)
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
    if is_first_import and backend:
        # the import of matplotlib would have set the backend too, but fails on an unknown name
        with suppress(ValueError):
            matplotlib.rcParams["backend"] = backend


with _guard_import():
    import matplotlib
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import EllipseCollection
    from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.ticker import AutoLocator, Locator, MaxNLocator, NullFormatter


#: colours from translation (0) to rotation (1): the uniform map "plasma" without its light end
ROTATION = LinearSegmentedColormap.from_list(
    "rotation", matplotlib.colormaps["plasma"](np.linspace(0.0, 0.8, 256))
)
#: colours from contacts that carry little, light, to those that carry much, dark: uniform to every
#: eye
FORCES = matplotlib.colormaps["cividis_r"]
#: colours of spectral functions, from none, white, to much, dark: uniform to every eye
SPECTRUM = matplotlib.colormaps["Blues"]
#: least limit of a scale of colours or of an axis, where nothing moves
LEAST_LIMIT = 1e-300
#: colours of velocities, from backward to forward
MOTION = matplotlib.colormaps["RdBu_r"]
#: colours from transverse (0) to longitudinal (1)
POLARISATION = LinearSegmentedColormap.from_list(
    "polarisation", [TRANSVERSE_COLOUR, LONGITUDINAL_COLOUR]
)
#: least and largest value of a logarithmic axis: squares of values beyond them are beyond floating
#: point
_LEAST_LOGARITHMIC = 1e-150
_LARGEST_LOGARITHMIC = 1e150
#: greatest number of letters of a label in a legend of this number of columns
_LETTERS_OF_COLUMNS = {3: 9, 2: 24}
#: values of an axis, or ticks and their limits, that differ by less than this part are equal
_ROUNDING = 1e-9
#: size of a figure in a notebook, pixels per inch
_PIXELS_PER_INCH = 120
#: least number of plain ticks of a logarithmic axis
_LEAST_TICKS = 4
#: least number of ticks of an axis in a small panel
_LEAST_TICKS_OF_PANEL = 3
#: mean width of a digit, as a part of the size of its font
_LETTER_WIDTH = 0.6
#: height of a row of a legend, in inches
ROW_HEIGHT = 0.16
_MM_PER_M = 1e3


def find_axis(ax: Axes, which: str) -> Axis:
    """Return the axis "x" or "y" of an Axes."""
    axis: Axis = {"x": ax.xaxis, "y": ax.yaxis}[which]
    return axis


def scale_axis(ax: Axes, which: str, values: Array, plain: float = 1e3) -> None:
    """Make the ``which`` axis, "x" or "y", logarithmic if all finite ``values`` are above zero, and
    leave the axis as it is otherwise, also if no value is finite.

    Ticks of a logarithmic axis are plain numbers if the ratio of the largest value to the smallest
    is below ``plain``.

    Raises :class:`~granphon.base.errors.InputError` for values that no logarithmic axis reaches.
    """
    finite_values = values[np.isfinite(values)]
    if not finite_values.size or np.any(finite_values <= 0.0):
        return
    lowest = finite_values.min()
    largest = finite_values.max()
    if lowest < _LEAST_LOGARITHMIC or largest > _LARGEST_LOGARITHMIC:
        problem = f"the {which} axis cannot reach from {lowest:.4g} to {largest:.4g}"
        why = f"An axis goes from {_LEAST_LOGARITHMIC:g} to {_LARGEST_LOGARITHMIC:g} at most"
        raise InputError(problem, why, "Look at the units of the data, and leave out what is wrong")
    ax.set(**{f"{which}scale": "log"})
    axis = find_axis(ax, which)
    if largest / lowest < plain:
        axis.set_major_locator(_PlainTicks())
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_locator(_PlainTicks(is_minor=True))
    axis.set_minor_formatter(NullFormatter())


def thin_ticks(ax: Axes) -> None:
    """Replace the ticks of an Axes that stands in a small panel: a logarithmic axis with plain
    numbers has fewer, whose texts do not overlap, and a linear axis has three at least where its
    values allow. Axes with ticks of their own keep them.
    """
    for axis in (ax.xaxis, ax.yaxis):
        if isinstance(axis.get_major_locator(), _PlainTicks):
            # texts of the axis of y stand above each other, so that their width does not count
            letter_width = _LETTER_WIDTH * STYLE["xtick.labelsize"] if axis is ax.xaxis else 0.0
            axis.set_major_locator(
                _PlainTicks(least=_LEAST_TICKS_OF_PANEL, letter_width=letter_width)
            )
            axis.set_minor_locator(_PlainTicks(is_minor=True, least=_LEAST_TICKS_OF_PANEL))
        elif isinstance(axis.get_major_locator(), AutoLocator):
            steps = [1, 2, 2.5, 5, 10]
            axis.set_major_locator(
                MaxNLocator("auto", steps=steps, min_n_ticks=_LEAST_TICKS_OF_PANEL)
            )


def widen_axis(ax: Axes, which: str, values: Array) -> None:
    """Widen the ``which`` axis, "x" or "y", if its ``values``, all above zero, differ by rounding
    at most: the axis then reaches a twentieth beyond the values to either side at least.

    The ticks of an axis as narrow as rounding would have no meaning.
    """
    lowest = float(values.min())
    largest = float(values.max())
    is_single_value = largest < lowest * (1.0 + _ROUNDING)
    if is_single_value:
        low, high = find_axis(ax, which).get_view_interval()
        wide_low = min(low, 0.95 * lowest)
        wide_high = max(high, 1.05 * largest)
        ax.set(**{f"{which}lim": (wide_low, wide_high)})


def name_axis(
    axis: Axis, most: float, label: str, unit: str, *, is_short: bool = False, more: str = ""
) -> None:
    """Label an axis, after its scale is set.

    ``most`` is the largest number of the axis, in the SI ``unit``. Lengths, forces, stiffnesses,
    pressures and frequencies (m, N, N/m, Pa, Hz) have a decimal prefix where ``most`` is below
    0.01, or 1e5 or more (of Hz: 1e4 or more); if ``is_short``, as in a narrow bar, they always have
    the prefix that suits ``most``. Other units stay as they are. ``more`` follows the unit in the
    label. The data of the axis stay in SI: only the texts at the ticks are divided. If
    ``is_short``, these texts are plain numbers or powers of ten, also without a prefix.
    """
    takes_prefix = unit in ("m", "N", "N/m", "Pa", "Hz")
    # numbers that are read well in the unit itself
    is_handy = 1e-2 <= most < (1e4 if unit == "Hz" else 1e5)
    size_of_unit = 1.0
    name_of_unit = unit
    if takes_prefix and (is_short or not is_handy):
        size_of_unit, name_of_unit = prefixed(most, unit)
    unit_in_print = name_of_unit.replace("u", "µ").replace("^2", "²").replace("^3", "³")
    ending = "" if name_of_unit in ("", "1") else f" ({unit_in_print})"
    axis.set_label_text(f"{label}{ending}{more}")
    if size_of_unit == 1.0 and not is_short:
        return  # nothing is divided, and the ticks keep the texts of their scale

    def write_power(value: float, _: float) -> str:
        """Return the text of a tick at a power of ten, in the chosen unit."""
        power = round(np.log10(value / size_of_unit))
        return f"$\\mathdefault{{10^{{{power}}}}}$"

    def write_number(value: float, _: float) -> str:
        """Return the text of a tick as a plain number, in the chosen unit."""
        return f"{value / size_of_unit:.10g}".replace("-", "\N{MINUS SIGN}")

    has_powers = axis.get_scale() == "log" and not isinstance(axis.get_major_locator(), _PlainTicks)
    axis.set_major_formatter(write_power if has_powers else write_number)


class NotebookFigure(Figure):
    """A figure with a PNG for notebooks; if pyplot's inline backend is loaded, the backend shows
    the figure instead.
    """

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return the bytes of a PNG, and the size, pixels, at which a notebook shows the PNG: its
        resolution is finer.
        """
        stream = BytesIO()
        self.savefig(stream, format="png")
        width, height = self.get_size_inches().tolist()
        size = {
            "width": round(_PIXELS_PER_INCH * width),
            "height": round(_PIXELS_PER_INCH * height),
        }
        return stream.getvalue(), size


@contextmanager
def styled_figure(height: float, width: float = COLUMN_WIDTH, dpi: float = DPI) -> Iterator[Figure]:
    """Make an empty figure of a height and a width, inches, and of ``dpi`` dots an inch, in the
    style of the project, which holds within the block.
    """
    with matplotlib.rc_context(STYLE):
        yield Figure((width, height), dpi=dpi, layout="constrained")


def draw_alone(plot: Callable[[Axes], Any], height: float) -> Figure:
    """Return a figure of one panel, one column wide and ``height`` inches high, on whose Axes the
    function ``plot`` has drawn.
    """
    with styled_figure(height) as figure:
        plot(figure.subplots())
    return figure


def add_bar(ax: Axes, mappable: Any, label: str) -> Any:
    """Draw above an Axes the bar that says what the colours of ``mappable`` mean, an artist with a
    map of colours, and return the bar.
    """
    figure: Any = ax.get_figure()
    bar = figure.colorbar(mappable, ax=ax, location="top", aspect=40, pad=0.02)
    bar.set_label(label)
    return bar


def add_part_bar(ax: Axes, colours: Colormap, label: str) -> None:
    """Draw above an Axes the bar of ``colours`` that stand for a part, which goes from 0 to 1."""
    mappable = ScalarMappable(Normalize(0.0, 1.0), colours)
    bar = add_bar(ax, mappable, label)
    bar.set_ticks([0.0, 0.5, 1.0], labels=["0", "0.5", "1"])


def draw_error_band(
    ax: Axes,
    x: Array,
    values: Array,
    errors: Array,
    colour: Any,
    gid: str,
    convert: Callable[[Array], Array] | None = None,
    *,
    is_upright: bool = False,
) -> None:
    """Draw the band of the standard errors of a curve, ``values`` (n,) over ``x`` (n,); for a
    single point a bar. If the curve ``is_upright``, ``x`` is on the axis of y, and values are to
    the right.

    ``errors`` are (n,), nan where unknown, or (2, n), below and above the curve; without an error
    above zero nothing is drawn. ``convert`` turns values into numbers on their axis. ``gid`` names
    the band in an SVG file.
    """
    below, above = np.broadcast_to(np.nan_to_num(errors), (2, values.size))
    if not np.any((below > 0.0) | (above > 0.0)):
        return
    edges = [values - below, values + above]
    lower, upper = edges if convert is None else map(convert, edges)
    if values.size == 1:
        bar = ax.hlines if is_upright else ax.vlines
        bar(x, lower, upper, color=colour, linewidth=0.8, gid=gid)
    else:
        fill = ax.fill_betweenx if is_upright else ax.fill_between
        fill(x, lower, upper, color=colour, alpha=0.3, linewidth=0.0, gid=gid)


def name_errors(errors: Any) -> Mapping[str, Any]:
    """Return ``errors``, a mapping from the names of quantities to their standard errors; an empty
    mapping for None. :class:`~granphon.base.errors.InputError` for what is no mapping.
    """
    if errors is None:
        return {}
    if not isinstance(errors, Mapping):
        mend = "Give a mapping, from the names of what has errors to the errors"
        raise InputError(f"errors are {brief(errors)}", mend=mend)
    return errors


def read_errors(errors: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return standard ``errors``, an argument of that name, as an array of a ``shape``, nan where
    unknown. :class:`~granphon.base.errors.InputError` for errors of another shape; axes of length 1
    may be more or fewer.
    """
    values = real_array("errors", errors)
    axes = [length for length in values.shape if length != 1]
    if axes != [length for length in shape if length != 1]:
        raise InputError(f"errors have the shape {values.shape}", mend=f"Give {shape}")
    return values.reshape(shape)


def make_error_handle(values: ArrayLike = (), errors: ArrayLike = ()) -> Line2D:
    """Return the entry of a legend for the bands of :func:`draw_error_band`.

    For ``values`` with standard ``errors``, arrays of one shape, the entry tells the least and the
    greatest relative error. Values that are near zero beside the greatest value do not count, nor
    errors of zero, nor what is not finite. The mark of the entry is empty if lines hide all bands.
    """
    magnitudes = np.nan_to_num(np.abs(np.ravel(values)), posinf=0.0)
    relative_errors = np.divide(
        np.nan_to_num(np.ravel(errors), posinf=0.0),
        magnitudes,
        out=np.zeros(magnitudes.shape),
        where=magnitudes > 0.0,
    )
    least_magnitude = _LEAST_VALUE * np.max(magnitudes, initial=0.0)
    is_told = (relative_errors > 0.0) & (magnitudes > least_magnitude)
    style: dict[str, Any] = {"color": "0.3", "alpha": 0.3, "linewidth": 5.0}
    label = STANDARD_ERROR
    if np.any(is_told):
        least = float(np.min(relative_errors[is_told]))
        greatest = float(np.max(relative_errors[is_told]))
        # of equal ends one is written
        ends = dict.fromkeys(f"{100.0 * end:.2g}" for end in (least, greatest))
        label = f"{label} {' to '.join(ends)} %"
        if greatest < _LEAST_VISIBLE_ERROR:
            style = {"linestyle": "none"}
    return Line2D([], [], label=label, **style)


def draw_densities(ax: Axes, curves: Iterable[tuple[Any, str, Array, Array, Array]]) -> None:
    """Draw densities of states per ball over the frequency, with their standard errors as bands.

    Each of ``curves`` is (colour, label, frequencies (n,) in Hz, densities (n,) in 1/Hz, standard
    errors (n,) in 1/Hz, nan where unknown). The axis ends a little above the highest frequency at
    which a density is above ``_LEAST_DENSITY`` times the greatest of its curve; a curve without any
    density counts with its last frequency.
    """
    all_curves = list(curves)
    tops = []
    for _, _, frequencies, densities, _ in all_curves:
        occupied = np.flatnonzero(densities > _LEAST_DENSITY * densities.max())
        tops.append(float(frequencies[occupied[-1] if occupied.size else -1]))
    top = max(tops)
    unit = HertzPrefix.for_top(top)
    for number, (colour, label, frequencies, densities, errors) in enumerate(all_curves):
        x = frequencies / unit.hertz
        y = densities * unit.hertz
        draw_error_band(ax, x, y, errors * unit.hertz, colour, f"errors-{number}")
        ax.plot(x, y, color=colour, linewidth=0.9, label=label)
    unit_name = write_hertz(unit)
    ax.set(xlabel=f"Frequency ({unit_name})", ylabel=f"DOS per ball (1/{unit_name})")
    ax.set(xlim=(0.0, 1.03 * top / unit.hertz), ylim=(0.0, None))


def order_balls(network: ContactNetwork) -> Index:
    """Return the indices of the balls of a network, without its flat walls, in the order in which
    they are drawn: in space by ascending z, as z points to the viewer, so that the nearest come
    last.
    """
    # the radius of a flat wall is infinite
    balls = np.flatnonzero(np.isfinite(network.radii))
    if network.dimension < 3:
        return balls
    return balls[np.argsort(network.positions[balls, 2], kind="stable")]


def draw_balls(
    network: ContactNetwork, values: Array, ax: Axes, colours: object, norm: Normalize
) -> EllipseCollection:
    """Draw the balls of a network, seen along z, coloured by their ``values`` (n,), one for each
    ball and wall, through a map of ``colours`` and its ``norm``; axes are in mm. Return the drawn
    balls, in the order of :func:`order_balls`.
    """
    numbers = order_balls(network)
    diameters = 2.0 * _MM_PER_M * network.radii[numbers]
    centres = _MM_PER_M * network.positions[numbers, :2]
    repeats_along_x = network.pbc[0] and not np.any(network.cell[0, 1:])
    if repeats_along_x:
        # an oblique cell is drawn as a rectangle
        centres[:, 0] = np.mod(centres[:, 0], _MM_PER_M * network.cell[0, 0])
    balls = EllipseCollection(
        diameters,
        diameters,
        np.zeros_like(diameters),
        units="xy",
        offsets=centres,
        offset_transform=ax.transData,
        array=values[numbers],
        cmap=colours,
        norm=norm,
        gid="balls",
        edgecolors=FRAME,
        linewidths=0.15,
    )
    ax.add_collection(balls, autolim=False)
    margin = 0.6 * diameters.max()  # a radius, and a little more
    low = centres.min(axis=0) - margin
    high = centres.max(axis=0) + margin
    ax.set(
        xlim=(low[0], high[0]),
        ylim=(low[1], high[1]),
        aspect="equal",
        xlabel="x (mm)",
        ylabel="y (mm)",
    )
    return balls


def add_legend(
    figure: Figure,
    handles: Sequence[Line2D],
    room: int = 0,
    title: str | None = None,
    **options: Any,
) -> None:
    """Draw the legend of a figure below its panels, in as many columns as its labels allow.

    The figure has room for ``room`` rows of the legend, and grows by all further rows, so that the
    panels keep their size. A ``room`` below zero is that of a figure which lacks rows for other
    texts, such as a title. ``options`` are those of ``Figure.legend``.
    """
    labels = [str(handle.get_label()) for handle in handles]
    columns = count_columns(labels)
    n_breaks = sum(text.count("\n") for text in (*labels, title or ""))
    rows = math.ceil(len(handles) / columns) + n_breaks
    added_height = max(0, rows - room) * ROW_HEIGHT
    figure.set_size_inches(figure.get_figwidth(), figure.get_figheight() + added_height)
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, title=title, **options
    )


def count_columns(labels: Sequence[str]) -> int:
    """Return the number of columns of a legend with these ``labels`` in a column of a page: as many
    as have room for the longest label.
    """
    longest = max(map(len, labels))
    most_columns = 1
    for columns, most_letters in _LETTERS_OF_COLUMNS.items():
        if longest <= most_letters:
            most_columns = columns
            break
    return min(len(labels), most_columns)


def add_title(ax: Axes, title: str, kinds: Mapping[str, str]) -> None:
    """Set the title of an Axes, and below the title a legend of ``kinds`` of balls, colours by
    their names, if there are kinds.
    """
    labels: dict[str, str] = {}  # by colour
    for name, colour in kinds.items():
        # of many kinds the last ones have one colour
        labels[colour] = name if colour not in labels else "others"
    rows = 0
    if labels:
        columns = count_columns(list(labels.values()))
        rows = math.ceil(len(labels) / columns)
        look: dict[str, Any] = {
            "marker": "o",
            "linestyle": "",
            "markeredgecolor": "0.35",
            "markeredgewidth": 0.5,
        }
        handles = [
            Line2D([], [], color=colour, label=label, **look) for colour, label in labels.items()
        ]
        ax.legend(
            handles=handles,
            ncols=columns,
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            borderaxespad=0.2,
            handletextpad=0.2,
            labelspacing=0.3,
        )
    # 6 points are matplotlib's own distance of a title
    points_per_row = 11.0
    ax.set_title(title, pad=6.0 + points_per_row * rows)


def hide_axes(ax: Axes, low: Array, high: Array) -> None:
    """Limit the axes to the rectangle from ``low`` (2,) to ``high`` (2,), with equal scales and
    without a frame.
    """
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    ax.set_axis_off()


def _keep_inside(ticks: Array, low: float, high: float) -> Array:
    """Return those of the ``ticks`` (n,) that lie between ``low`` and ``high``, both above zero, or
    beyond them by no more than rounding.
    """
    is_inside = (ticks >= low * (1.0 - _ROUNDING)) & (ticks <= high * (1.0 + _ROUNDING))
    return ticks[is_inside]


def _keep_apart(ticks: Array, axis: Any, letter_width: float) -> Array:
    """Return every tick, or every second, third and so on of the ``ticks`` (n,), so that the texts
    beside an ``axis`` x, as wide as it is drawn, do not overlap; letters are ``letter_width``
    points wide.
    """
    format_tick = axis.get_major_formatter()
    longest = max((len(format_tick(tick, None)) for tick in ticks), default=0)
    pixels_per_point = axis.axes.get_figure().dpi / POINTS_PER_INCH
    width = (longest + 1) * letter_width * pixels_per_point
    pixels = axis.axes.transData.transform(np.stack([ticks, ticks], axis=-1))[:, 0]
    stride = 1
    while stride < ticks.size and np.any(np.diff(pixels[::stride]) < width):
        stride += 1
    return ticks[::stride]


class _PlainTicks(Locator):
    """Ticks at round numbers on a logarithmic axis, few but at least ``least``; or its minor
    ticks.
    """

    def __init__(
        self, is_minor: bool = False, least: int = _LEAST_TICKS, letter_width: float = 0.0
    ) -> None:
        """Give the ticks of an axis, or if ``is_minor`` its minor ticks, with ``least`` ticks or
        more; fewer if their texts, whose letters are ``letter_width`` points wide, would overlap. A
        width of zero is for axes of y, whose texts stand above each other and never overlap.
        """
        self._is_minor = is_minor
        self._least = least
        self._letter_width = letter_width

    def __call__(self) -> Any:
        """Return the ticks of the axis as far as it is shown; if the width of a letter is known,
        those alone whose texts do not overlap.
        """
        axis: Any = self.axis
        ticks = self.tick_values(*axis.get_view_interval())
        return _keep_apart(ticks, axis, self._letter_width) if self._letter_width > 0.0 else ticks

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Return the ticks, or the minor ticks, of an axis between ``vmin`` and ``vmax``: see
        :func:`_choose_round_numbers`.
        """
        low, high = sorted((float(vmin), float(vmax)))
        major, minor = _choose_round_numbers(low, high, self._least)
        return minor if self._is_minor else major


@lru_cache(maxsize=32)
def _choose_round_numbers(low: float, high: float, least: int) -> tuple[Array, Array]:
    """Return the ticks and the minor ticks of an axis from ``low`` to ``high``: those of the first
    set of :func:`_list_round_numbers` with at least ``least`` ticks, or of the last set. The arrays
    are read-only, and kept for further calls: matplotlib asks some twenty times to draw an axis.
    """
    major = minor = np.empty(0)
    for ticks, finer_ticks in _list_round_numbers(low, high, is_sparse=least < _LEAST_TICKS):
        major = _keep_inside(ticks, low, high)
        minor = _keep_inside(finer_ticks, low, high)
        if major.size >= least:
            break
    major.flags.writeable = False
    minor.flags.writeable = False
    return major, minor


def _list_round_numbers(
    low: float, high: float, *, is_sparse: bool
) -> Iterator[tuple[Array, Array]]:
    """Yield pairs of ticks and finer minor ticks, both round numbers from about ``low`` to
    ``high``, both above zero.

    If ``high`` is at least four times ``low``, the first sets have the same digits in all decades.
    The others, which follow or are alone, are evenly spaced. Of both kinds the sets with the fewest
    numbers come first; if ``is_sparse``, one number in each decade, and at most three intervals.
    """
    span = high / low
    if span >= 4.0:
        if span < 30.0:
            # the digits of logarithmic paper, from 1.0 to 9.5
            tenths = [np.arange(10, 20), np.arange(20, 50, 2), np.arange(50, 100, 5)]
            minor_digits = np.concatenate(tenths) / 10.0
        else:
            minor_digits = np.arange(1.0, 10.0)
        decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1.0)
        minor_ticks = np.outer(decades, minor_digits).ravel()
        if is_sparse:
            yield decades, minor_ticks
        if span > 50.0:
            yield np.outer(decades, (1.0, 3.0)).ravel(), minor_ticks
        for digits in (
            (1.0, 2.0, 5.0),
            (1.0, 2.0, 3.0, 5.0),
            (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0),
        ):
            yield np.outer(decades, digits).ravel(), minor_ticks
    for n_intervals in (3, 5, 8, 12) if is_sparse else (5, 8, 12):
        ticks = np.asarray(MaxNLocator(n_intervals, steps=[1, 2, 5, 10]).tick_values(low, high))
        step = ticks[1] - ticks[0]
        # a step of 2 has four parts, a step of 1, 5 or 10 has five: their ends are round
        is_step_of_two = f"{step:.0e}".startswith("2")
        n_parts = 4 if is_step_of_two else 5
        n_minor_steps = n_parts * (ticks.size - 1)
        yield ticks, ticks[0] + step / n_parts * np.arange(n_minor_steps + 1)
