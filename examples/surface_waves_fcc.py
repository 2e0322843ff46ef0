r"""Surface waves of fcc (001) and (111)
====================================

Steel balls on fcc, pressed together, end at a free surface. The spectrum of the outer layer is
shown over the wave vector along the surface, with the edges of the crystal's bands (dashed) and the
waves of the surface outside of them (dots). The lowest is Rayleigh's wave, whose velocity at long
waves follows from the elastic tensor. The next one, just below the bands, moves the balls across
the direction in which it runs; the half space of an elastic continuum has no such wave.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import STYLE
from granphon.figures.waves import plot_surface

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(STEEL, diameter=8e-3, lattice="fcc", friction=True)
state = gp.AveragedLattice(packing).at_force(18.446)
q = np.linspace(0.01, 0.5, 50)[:, None] * [1.0, 0.0]
frequencies = np.linspace(0.0, 62e3, 320)

with matplotlib.rc_context(STYLE):
    figure, panels = plt.subplots(
        1, 2, figsize=(7.0, 3.2), dpi=300, layout="constrained", sharey=True
    )
    # Miller indices belong to the vectors of the primitive cell
    for ax, (name, axis) in zip(
        panels, {"(001)": (1, 1, 0), "(111)": (1, 1, 1)}.items(), strict=True
    ):
        surface = gp.Surface(state, axis)
        waves = surface.branches(q)
        plot_surface(surface.spectrum(q, frequencies, damping=400.0), ax, branches=waves)
        ax.set_title(f"fcc {name}")
        # %%
        # From the elastic tensor, and the slope of the lowest branch near Gamma:
        along = np.linalg.inv(surface.cell[:, :2]).T[0]  # of a wave vector (1, 0), over 2 pi
        limit = surface.velocity(along)
        slope = surface.branches([[1e-3, 0.0]])[0][0] / (1e-3 * np.linalg.norm(along))
        assert abs(slope / limit - 1.0) < 5e-3
        print(f"Rayleigh's wave on {name}: {limit:.2f} m/s, at q = 0.001 {slope:.2f} m/s")
panels[1].set_ylabel("")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
