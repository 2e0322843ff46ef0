"""The fonts of matplotlib: which one it draws with, and whether the letters of our figures come out."""

from __future__ import annotations

import os
import warnings
from io import BytesIO
from pathlib import Path

import granphon.figures.scales  # noqa: F401

import matplotlib
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font

from granphon.figures.style import STYLE, shorten_error

#: texts that figures hold: letters outside ASCII, and formulas
_SAMPLES = {"Gamma": "Γ", "mu and plus-minus": "µ ±", "mathtext": r"$\mathrm{\Gamma}_{1}\ \omega/2\pi$"}


def describe_fonts() -> list[tuple[str, str]]:
    """Return rows of a name and a text: the font, whether the letters of figures are drawn, and matplotlib's folder.

    Each letter is drawn with the settings of matplotlib as they stand here; a glyph that the font lacks is a warning of
    matplotlib, which is told. A folder inside the home folder is told from "~" on, and another one by what names it.
    """
    rows = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            font = get_font(findfont(FontProperties()))
            rows.append(("font", f"{font.family_name}, {font.style_name}"))
        except (OSError, ValueError, RuntimeError) as error:
            rows.append(("font", f"none is found: {shorten_error(error)}"))
    rows += [("fonts", "; ".join({str(one.message): None for one in caught}))] * bool(caught)
    drawn = {name: _draw(text) for name, text in _SAMPLES.items()}
    fine = [name for name, fault in drawn.items() if not fault]
    rows += [("letters drawn", ", ".join(fine))] * bool(fine)
    rows += [(name, f"not drawn: {fault}") for name, fault in drawn.items() if fault]
    folder = Path(matplotlib.get_configdir())
    try:  # without the name of a user
        where = f"~/{folder.relative_to(Path.home()).as_posix()}"
    except (ValueError, RuntimeError):
        named = "MPLCONFIGDIR" in os.environ
        where = "the folder that MPLCONFIGDIR names" if named else "a folder outside the home folder"
    rows.append(("config folder", f"{where}, {'writable' if os.access(folder, os.W_OK) else 'not writable'}"))
    return rows


def _draw(text: str) -> str:
    """Draw a text; return what went wrong, an empty text if nothing did."""
    with warnings.catch_warnings(), matplotlib.rc_context(STYLE):
        warnings.simplefilter("error")
        try:
            figure = Figure(figsize=(1.0, 1.0))
            figure.text(0.1, 0.5, text)
            figure.savefig(BytesIO(), format="png", dpi=50)
        except Exception as error:  # whatever the settings of matplotlib lead to is what we are to tell
            return shorten_error(error)
    return ""
