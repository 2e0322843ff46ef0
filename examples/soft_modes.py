r"""From sound to soft modes
========================

The figure shows the density of states of an array of balls that differ, divided by the frequency.
In the plane sound gives a constant at low frequencies, by Debye's law; what is above it is an
excess of modes. As the load falls towards the rigidity threshold this excess moves to lower
frequencies. Close to the threshold the density of states itself is constant down to low
frequencies: a plateau of soft modes, in which few balls take part.

Frequencies are divided by the top frequency of the lattice of mean contacts under the same load.
Right: the fraction of the balls that take part in a mode (participation ratio), over its frequency.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import COLOURS, STYLE

LOADS = (3.0, 0.05, 0.002)  # f*
steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2.04e-6), friction=False)
states = gp.DirectSimulation(packing, shape=(36, 36)).at_force(
    np.array(LOADS) * packing.width_units.force
)
density = {}
modes = {}
top = {}
for number, load in enumerate(LOADS):
    state = states[number]
    waves = gp.Waves(state.sample.network.without_rattlers())
    top[load] = state.contact_lattice().top_frequency * state.scales.frequency
    density[load] = waves.dos(resolution=0.012 * top[load], vectors=3)
    modes[load] = waves.modes(24)

# %% The plateau: at a thirtieth of the top frequency there are several times as many modes at the
# lowest load as at the highest.

share = {
    load: np.interp(0.033 * top[load], dos.frequencies, dos.total) * top[load]
    for load, dos in density.items()
}
assert share[0.002] > 4.0 * share[3.0]

with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.0, 3.0), dpi=300, layout="constrained")
    for load, colour in zip(LOADS, COLOURS, strict=False):
        dos = density[load]
        unit = top[load]
        # below, the resolution of the kernel, and the two motions of the whole
        is_seen = dos.frequencies > 0.02 * unit
        left.plot(
            dos.frequencies[is_seen] / unit,
            dos.total[is_seen] * unit,
            color=colour,
            linewidth=1.0,
            label=f"$f^*={load:g}$",
        )
        network_modes = modes[load]
        style = {"color": colour, "marker": ".", "linestyle": "", "markersize": 3.0}
        right.plot(network_modes.frequencies / unit, network_modes.participation_ratio, **style)
    left.set(
        xscale="log",
        yscale="log",
        xlim=(0.02, 2.0),
        ylim=(0.03, 10.0),
        xlabel="Frequency over the top of the mean lattice",
    )
    left.set_ylabel("Density of states per ball,\ntimes that frequency")
    left.legend()
    right.set(
        xlim=(0.0, 0.12), ylim=(0.0, 0.8), xlabel="Frequency over the top of the mean lattice"
    )
    right.set_ylabel("Participation ratio")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
