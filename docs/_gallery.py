"""How the gallery takes the figures of the examples, in which order it shows them, and what stands
for each in its list.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from weakref import WeakSet

from matplotlib import pyplot
from matplotlib.animation import Animation
from matplotlib.collections import LineCollection
from matplotlib.legend import Legend
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator, NullFormatter, ScalarFormatter

_ORDER = (
    "steel_bands",
    "friction",
    "dos",
    "modes_K_M",
    "rolling_wave",
    "iso_frequency",
    "pulse_dispersion",
    "poisson_ratio",
    "granular_chain",
    "diatomic_chain",
    "magnetic_chain",
    "defect_mode",
    "sound_filter",
    "column",
    "pressed_along_one_axis",
    "membrane",
    "fcc_and_hcp",
    "slowness_fcc",
    "rolling_modes",
    "zigzag_edge",
    "surface_waves_fcc",
    "transfer_function",
    "losses",
    "time_of_flight",
    "transmission",
    "pressure_sweep",
    "ladder",
    "cluster",
    "work_precision",
    "force_chains",
    "conjecture",
    "true_directions",
    "hysteresis",
    "disorder_in_space",
    "fit_width",
    "several_runs",
    "spectral_function",
    "soft_modes",
    "coherent_speckle",
    "wave_crossing",
    "hexagon_pulse",
    "solitary_wave",
    "second_harmonic",
    "impact_on_hexagon",
    "random_packing",
)
_shown: WeakSet[Any] = WeakSet()
#: which panel stands for an example, counted as the figure does, where it is not the largest one
_PANELS = {
    "coherent_speckle": 0,
    "dos": 1,
    "friction": 1,
    "membrane": 2,
    "random_packing": 0,
    "slowness_fcc": 0,
    "work_precision": 0,
}
#: size of a thumbnail, in inches and in dots per inch; of its letters, in points; and the longest
#: label of an axis, and the longest text in a panel, in letters
_THUMB_SIZE = (2.0, 1.4)
_THUMB_DPI = 200
_LETTERS = 8.0
_LONGEST = 18
_LONGEST_TEXT = 4
#: lines from which on they are a net, whose lines are drawn thinner
_MANY = 200


def order(filename: str) -> tuple[int, str]:
    """From equal balls to those that differ; then by name, the figures of the paper last."""
    name = filename.removesuffix(".py")
    return (_ORDER.index(name) if name in _ORDER else len(_ORDER)), name


def scraper(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Take ``figure`` once a script has made it. Those of granphon.figures.bands are not pyplot's,
    where sphinx-gallery looks.

    An animation is left to sphinx-gallery.
    """
    from sphinx_gallery.scrapers import figure_rst

    names = block_vars["example_globals"]
    figure = names.get("figure")
    if (
        figure is None
        or figure in _shown
        or any(isinstance(value, Animation) for value in names.values())
    ):
        return ""
    _shown.add(figure)
    path = next(block_vars["image_path_iterator"])
    figure.savefig(path, dpi=200)
    name = Path(block_vars["src_file"]).stem
    draw_panel(figure, name, _panel_of(Path(path).parent, name))
    pyplot.close(figure)
    return str(figure_rst([path], gallery_conf["src_dir"]))


def _panel_of(images: Path, name: str) -> Path:
    return images / f"{name}_panel.png"


def draw_panel(figure: Any, name: str, path: Path) -> None:
    """Save one panel of a figure, with letters that can be read when it is as small as in the list
    of the gallery.
    """
    areas = [ax.get_position().width * ax.get_position().height for ax in figure.axes]
    chosen = figure.axes[_PANELS.get(name, areas.index(max(areas)))]
    figure.set_layout_engine("none")
    figure.set_size_inches(_THUMB_SIZE)
    for part in (
        *(ax for ax in figure.axes if ax is not chosen),
        *figure.texts,
        *figure.findobj(Legend),
    ):
        part.set_visible(False)
    if figure.get_suptitle():
        figure.suptitle("")
    for side in ("left", "center", "right"):
        chosen.set_title("", loc=side)
    for text in chosen.texts:
        text.set_visible(len(text.get_text()) <= _LONGEST_TEXT)
    labelled = chosen.axison
    chosen.set_position((0.28, 0.28, 0.69, 0.67) if labelled else (0.02, 0.02, 0.96, 0.96))
    for text in chosen.findobj(Text):
        text.set_fontsize(_LETTERS)
    for lines in chosen.findobj(LineCollection):
        if len(lines.get_linewidths()) > _MANY:
            lines.set_linewidths([0.3 * width for width in lines.get_linewidths()])
    for axis in (chosen.xaxis, chosen.yaxis):
        if len(axis.get_label_text()) > _LONGEST:
            axis.set_label_text("")
        if isinstance(axis.get_major_locator(), FixedLocator):
            if any(len(label.get_text()) > _LONGEST_TEXT for label in axis.get_ticklabels()):
                axis.set_ticks([])
            continue
        axis.set_minor_formatter(NullFormatter())
        low, high = sorted(axis.get_view_interval())
        if axis.get_scale() != "log":
            axis.set_major_locator(MaxNLocator(3))
        elif high < 30.0 * low:
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(ScalarFormatter())
        else:
            axis.set_major_locator(LogLocator(numticks=4))
    figure.savefig(path, dpi=_THUMB_DPI)


def take_panels(app: Any) -> None:
    """Put the panels where sphinx-gallery has put a reduced picture of all; those of scripts that
    did not run are there.
    """
    images = Path(app.srcdir) / "gallery" / "images"
    for panel in images.glob("*_panel.png"):
        panel.replace(images / "thumb" / f"sphx_glr_{panel.stem.removesuffix('_panel')}_thumb.png")
