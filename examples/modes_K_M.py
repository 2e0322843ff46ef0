"""The modes of steel balls at K and M: what moves, and what turns.

The picture: the three modes at K (above) and at M (below), frequency rising to the right. Arrows are displacements; the
sector of each ball is the angle through which it has turned, in vermilion against the clock and in blue with it, on the
scale of the arrows (phi = w/R_g). The highest branch is not always the rotational one: the pure rotation is the lowest
branch at K and the highest at M.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import granphon as gp
from granphon.plot import STYLE, plot_mode

POINTS = {"K": (1 / 3, 1 / 3), "M": (1 / 2, 0.0)}


def main(out: Path | None = None) -> Figure:
    """Compute, check, draw; write the figure to ``out`` if it is given."""
    steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    state = gp.AveragedLattice(gp.Packing(steel, diameter=8e-3)).at_force(18.446)
    phonons = gp.Phonons(state)

    modes = phonons.modes(list(POINTS.values()))
    assert np.allclose(modes.rotational_fraction, [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], atol=1e-12)
    # pure rotations: omega^2 = 5 eta (3 + sum of cos q.a_p) k/M, 7.5 eta at K and 10 eta at M
    eta = state.packing.mindlin_ratio
    pure = modes.frequencies[[0, 1], [0, 2]] / state.scales.frequency
    assert np.allclose(pure**2, [7.5 * eta, 10.0 * eta], rtol=1e-12)

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 3.9), dpi=300, layout="constrained")
        for row, (name, q) in zip(figure.subplots(2, 3), POINTS.items(), strict=True):
            for branch, ax in enumerate(row):
                plot_mode(phonons, q, branch, ax)
                ax.set_title(f"{name}, branch {branch + 1}: {ax.get_title().split('), ')[1]}")
    if out is not None:
        figure.savefig(out)
    return figure


if __name__ == "__main__":
    main(Path("modes_K_M.png"))
