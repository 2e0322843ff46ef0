r"""Bands that dissolve
===================

In an array of balls that differ a plane wave is not a mode: it is scattered, and its line has a
width. The spectral function :math:`A(\mathbf q,f)` is the spectrum of a wave of wave vector q in
the array itself. The kernel polynomial method computes it for the whole network of contacts at
once.

The figure has the same 4,096 steel balls, with a uniform spread, under two loads. Where the overlap
is far above the spread (left, :math:`f^*=3`), the lines follow the bands of the lattice of mean
contacts, dashed. Near the rigidity threshold (right, :math:`f^*=0.003`) only long waves are left:
from a tenth of the top frequency on the width of a line is as large as its frequency, and the bands
have no meaning.
"""

import sys
from statistics import median

import matplotlib
import matplotlib.pyplot as plt

import granphon as gp
from granphon.figures.style import STYLE
from granphon.figures.waves import plot_spectrum
from granphon.phonons.paths import BandPath
from granphon.waves.path_spectra import find_path_spectra

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2.04e-6))
simulation = gp.DirectSimulation(packing, shape=(64, 64))
path = BandPath.default(packing.structure)
spectra = {}
for load in (3.0, 0.003):  # f*
    state = simulation.at_force(load * packing.width_units.force)
    spectra[load] = find_path_spectra(
        gp.Waves(state.sample),
        state.contact_lattice(),
        state.scales,
        path.arrays,
        path.labels,
        points=17,
        polarisations=["longitudinal"],
    )

# %%
# At high load the width is a few hundredths of the frequency, at low load a third of it or more.

lines = {load: one.spectra[0] for load, one in spectra.items()}
top = {load: float(one.bands.max()) for load, one in spectra.items()}
assert median(lines[3.0].width / lines[3.0].peak) < 0.05
assert median(lines[0.003].width / lines[0.003].peak) > 0.3

with matplotlib.rc_context(STYLE):
    figure, panels = plt.subplots(1, 2, figsize=(7.0, 3.3), dpi=300, layout="constrained")
    for (load, one), ax in zip(spectra.items(), panels, strict=True):
        plot_spectrum(one, ax)
        ax.text(0.03, 0.93, f"$f^*={load:g}$", transform=ax.transAxes)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
