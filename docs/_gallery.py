"""How the gallery takes the figures of the examples, and in which order it shows them."""

from __future__ import annotations

from typing import Any
from weakref import WeakSet

from matplotlib import pyplot
from matplotlib.animation import Animation
from sphinx_gallery.scrapers import figure_rst

_ORDER = (
    "steel_bands", "friction", "dos", "modes_K_M", "rolling_wave", "iso_frequency", "pulse_dispersion", "poisson_ratio",
    "granular_chain", "membrane", "fcc_and_hcp", "slowness_fcc", "rolling_modes", "pressure_sweep", "ladder",
    "work_precision", "force_chains", "conjecture", "true_directions", "hysteresis", "disorder_in_space",
    "fit_width", "several_runs",
    "spectral_function", "soft_modes", "coherent_speckle", "wave_crossing", "hexagon_pulse", "random_packing",
)  # fmt: skip
_shown: WeakSet[Any] = WeakSet()


def order(filename: str) -> tuple[int, str]:
    """From equal balls to those that differ; then by name, the figures of the paper last."""
    name = filename.removesuffix(".py")
    return (_ORDER.index(name) if name in _ORDER else len(_ORDER)), name


def scraper(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Take ``figure`` once a script has made it. Those of granphon.figures.bands are not pyplot's, where sphinx-gallery
    looks.

    An animation is left to sphinx-gallery.
    """
    names = block_vars["example_globals"]
    figure = names.get("figure")
    if figure is None or figure in _shown or any(isinstance(value, Animation) for value in names.values()):
        return ""
    _shown.add(figure)
    path = next(block_vars["image_path_iterator"])
    figure.savefig(path, dpi=200)
    pyplot.close(figure)
    return str(figure_rst([path], gallery_conf["src_dir"]))
