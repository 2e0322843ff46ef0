r"""The transfer function of a chain
================================

A shaker moves the wall at which a chain of steel and aluminium balls ends, and a sensor listens at
its free end. Below the gap of the chain each mode is a peak, and its phase falls by :math:`\pi`. In
the gap little arrives, except where the light ball at the free end has a mode of its own; above it
the light balls swing. Dashpots at the contacts damp the upper modes most.
"""

import sys

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import granphon as gp
from granphon.figures.style import COLOURS, COLUMN_WIDTH, DPI, GUIDE, STYLE
from granphon.figures.waves import plot_response

STEEL = gp.Ball(gp.Material(193e9, 0.30, 8000.0), 19.05e-3, mass=28.84e-3, name="steel")
ALUMINIUM = gp.Ball(gp.Material(73.5e9, 0.33, 2700.0), 19.05e-3, mass=9.75e-3, name="aluminium")
state = gp.Crystal.on("chain", [STEEL, ALUMINIUM]).at_force(20.0)
chain = state.network.cut(0, 8, edges=("floor", "free"))
waves = gp.Waves(chain)
gap = gp.Phonons(state).gaps()[0]
frequencies = np.linspace(20.0, 10e3, 1500)
dampings = (2e-7, 2e-6)  # s
responses = [
    waves.response(frequencies, "plane", "plane", damping, quantity="transmissibility")
    for damping in dampings
]

# %% At rest the chain moves with the wall. The mode of the free end is at
# :math:`\omega^2=k(1/M+1/m)`, halfway between the squares of the edges of the gap.

modes = waves.damped_modes(3, damping=dampings[0])
print("Q of the lowest modes:", np.round(modes.quality))
peaks = responses[0].peaks[0].frequencies
peak = peaks[np.argmin(np.abs(peaks - np.mean(gap)))]
assert abs(peak - np.sqrt(np.mean(gap**2))) < 10.0
assert np.allclose(waves.response([0.0], "plane", "plane", quantity="transmissibility"), 1.0)

with matplotlib.rc_context(STYLE):
    figure = Figure((1.4 * COLUMN_WIDTH, 3.8), dpi=DPI, layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
    for response, damping, colour in zip(responses, dampings, COLOURS, strict=False):
        plot_response(response, above, below)
        for ax in (above, below):
            ax.lines[-1].set(color=colour, label=f"{1e6 * damping:g} µs")
    for ax in (above, below):
        ax.axvspan(*gap / 1e3, color=GUIDE, alpha=0.3, linewidth=0.0)
    above.legend(title="damping c/k", loc="lower left")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
