"""Bands and density of states of steel balls, 8 mm in diameter, pressed together with 18.4 N.

The picture: the three branches along Gamma-K-M-Gamma, coloured by the part of the kinetic energy that is rotation; dashed,
the long waves (equations 13 to 15, with the corrected d^2/10); inset, the Brillouin zone and the path; right, the density of
states per ball and what translation and rotation contribute to it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import granphon as gp
from granphon.plot import bands_figure


def main(out: Path | None = None) -> Figure:
    """Compute, check, draw; write the figure to ``out`` if it is given."""
    steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    state = gp.AveragedLattice(gp.Packing(steel, diameter=8e-3)).at_force(18.446)
    phonons = gp.Phonons(state)
    bands, dos = phonons.bands("GKMG"), phonons.dos((64, 64))

    # the longitudinal velocity that the paper quotes (Section IV), and the top of the rotational branch, 30 eta k/M
    assert round(gp.sound_velocities(state).longitudinal) == 791
    top = np.sqrt(30.0 * state.packing.mindlin_ratio) * state.scales.frequency
    assert np.isclose(bands.frequencies.max(), top, rtol=1e-12)
    assert 65.8e3 < top < 65.9e3

    figure = bands_figure(bands, dos, asymptotes=phonons.lattice)
    if out is not None:
        figure.savefig(out)
    return figure


if __name__ == "__main__":
    main(Path("bands.png"))
