r"""Waves that a gap lets through
=============================

A chain of steel and aluminium balls in turn has a gap, in which a wave decays from cell to cell.
The left panel shows how fast, from the complex bands: zero in the bands. The right panel shows what
part of the energy passes pieces of 2, 4 and 8 cells between chains of aluminium balls. In the gap
it falls with the length as the decay says; in the bands it has a maximum of one wherever a standing
wave fits.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import COLOURS, PAGE_WIDTH, STYLE

VOLUME = np.pi * 19.05e-3**3 / 6.0
steel, aluminium = (
    gp.Ball(gp.Material(modulus, poisson, mass / VOLUME), 19.05e-3)
    for modulus, poisson, mass in ((193e9, 0.30, 28.84e-3), (73.5e9, 0.33, 9.75e-3))
)
crystal = gp.Crystal.on("chain", [steel, aluminium]).at_force(20.0).network
lead = gp.Crystal.on("chain", [aluminium]).at_force(20.0).network
f = np.linspace(50.0, 11e3, 800)
bands = gp.Phonons(crystal).complex_bands(f)

with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(PAGE_WIDTH, 2.6), dpi=300, layout="constrained"
    )
    left.plot(f / 1e3, bands.attenuation, color="black")
    left.set(
        xlabel="Frequency (kHz)", ylabel="Decay (dB per cell)", xlim=(0.0, 11.0), ylim=(0.0, None)
    )
    passed = {}
    for cells, colour in zip((2, 4, 8), COLOURS, strict=False):
        through = gp.transmission(lead, crystal.cut(0, cells), lead, f)
        passed[cells] = through.transmitted
        right.semilogy(
            f / 1e3, through.transmitted, color=colour, linewidth=0.9, label=f"{cells} cells"
        )
    right.set(
        xlabel="Frequency (kHz)", ylabel="Transmitted energy", xlim=(0.0, 11.0), ylim=(1e-9, 2.0)
    )
    right.legend(loc="lower left")

# %%
# In the middle of the gap four cells more cost four times the decay of a cell.

middle = np.argmax(np.where((f > 4.8e3) & (f < 8e3), bands.attenuation, 0.0))
fall = 10.0 * np.log10(passed[4][middle] / passed[8][middle])
print(
    f"{f[middle]:.0f} Hz: {bands.attenuation[middle]:.2f} dB per cell; four cells more cost"
    f" {fall:.2f} dB"
)
assert abs(fall / 4.0 / bands.attenuation[middle] - 1.0) < 0.02
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
