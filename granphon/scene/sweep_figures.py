"""The figures of a sweep, by the names of their files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from granphon.scene.result_files import SWEEP_FIGURES

__all__ = ["draw_sweep"]


def draw_sweep(dataset: Any, name: str, variable: str | None = None) -> Any:
    """Draw the figure of a sweep that the ``name`` of its file means, or that of one ``variable``."""
    stem = Path(name).stem
    if variable is None and f"{stem}.png" in SWEEP_FIGURES:
        from granphon.figures.sweep_waves import sweep_dos_figure, sweep_spectra_figure

        return sweep_dos_figure(dataset) if stem == "sweep_dos" else sweep_spectra_figure(dataset)
    from granphon.figures.sweeps import sweep_figure

    return sweep_figure(dataset) if variable is None else sweep_figure(dataset, variable=variable)
