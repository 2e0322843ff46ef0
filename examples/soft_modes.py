r"""From sound to soft modes
=========================

The density of states of an array of balls that differ, divided by the frequency: in the plane sound gives a constant at low
frequencies, as Debye has it. As the load falls towards the rigidity threshold the excess moves down, and close to it the
density of states itself is flat down to low frequencies: a plateau of soft modes, in which few balls take part.

Frequencies are over the top one of the lattice of mean contacts under the same load. Right: the part of all balls that take
part in the modes (participation ratio), against their frequency.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import COLOURS, STYLE
from granphon.media.acoustics import contact_lattice

LOADS = (3.0, 0.05, 0.002)  # f*
steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2.04e-6), friction=False)
states = gp.DirectSimulation(packing, shape=(36, 36)).at_force(np.array(LOADS) * packing.width_units.force)
density, modes, top = {}, {}, {}
for at, load in enumerate(LOADS):
    state = states[at]
    waves = gp.Waves(state.sample)
    top[load] = contact_lattice(state).top_frequency * state.scales.frequency
    density[load] = waves.dos(resolution=0.012 * top[load], vectors=3)
    modes[load] = waves.modes(24)

# %%
# The plateau: at a thirtieth of that frequency there are several times as many modes at the lowest load as at the highest.

share = {load: np.interp(0.033 * top[load], one.frequencies, one.total) * top[load] for load, one in density.items()}
print(
    share,
    {
        load: (one.frequencies[[0, 2, 3, 39]] / top[load], one.participation_ratio[[2, 10, 39]])
        for load, one in modes.items()
    },
)
assert print(share) or share[0.002] > 4.0 * share[3.0]

with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.0, 3.0), dpi=300, layout="constrained")
    for load, colour in zip(LOADS, COLOURS, strict=False):
        one, unit = density[load], top[load]
        left.plot(one.frequencies / unit, one.total * unit, color=colour, linewidth=1.0, label=f"$f^*={load:g}$")
        found = modes[load]
        moving = found.frequencies > 1e-6 * unit
        style = {"color": colour, "marker": ".", "linestyle": "", "markersize": 3.0}
        right.plot(found.frequencies[moving] / unit, found.participation_ratio[moving], **style)
    left.set(xlim=(0.0, 1.4), ylim=(0.0, None), xlabel="Frequency over the top of the mean lattice")
    left.set_ylabel("Density of states per ball,\ntimes that frequency")
    left.legend()
    right.set(xscale="log", ylim=(0.0, 0.8), xlabel="Frequency over the top of the mean lattice")
    right.set_ylabel("Participation ratio")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
