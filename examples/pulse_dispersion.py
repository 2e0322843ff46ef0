"""Pulses are slower than long waves
=================================

Phase velocity (full lines) and group velocity (dashed lines) of sound in steel balls along Γ-K
against frequency, up to the first maximum of each branch. The vertical line marks 6.5 kHz, the main
frequency of the pulses of Gilles and Coste. There the group velocities are already 1.5 % below
those of long waves, which are the values at zero frequency.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.dynamics.branches import follow_acoustic_branches
from granphon.figures.style import LONGITUDINAL_COLOUR, STYLE, TRANSVERSE_COLOUR

PULSE = 6500.0
ALONG = (1.0, 0.0)  # Hz, Gamma-K
steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
state = gp.AveragedLattice(gp.Packing(steel, diameter=8e-3)).at_force(18.446)

# %% Near zero frequency the phase velocity falls as :math:`1-c(qd)^2`, and the group velocity three
# times as fast.

limit = gp.sound_velocities(state)
pulse = gp.pulse_velocities(state, PULSE, ALONG)
deficit = 1.0 - pulse.group / [limit.longitudinal, limit.transverse]
print("group velocities below those of long waves, L and T (%):", *np.round(100.0 * deficit, 2))
assert 0.016 < deficit[0] < 0.017
assert np.allclose(deficit[0] / (1.0 - pulse.phase[0] / limit.longitudinal), 3.0, rtol=0.02)

with matplotlib.rc_context(STYLE):
    figure, ax = plt.subplots(figsize=(3.4, 2.7), dpi=300, layout="constrained")
    colours = {"longitudinal": LONGITUDINAL_COLOUR, "transverse": TRANSVERSE_COLOUR}
    for name, branch in follow_acoustic_branches(state.contact_lattice(), ALONG).items():
        # crowded at the top, where the group velocity falls steeply to zero
        hertz = (
            branch.top * state.scales.frequency * np.sin(np.linspace(0.01, 0.5 * np.pi - 1e-4, 120))
        )
        velocities = gp.pulse_velocities(state, hertz, ALONG, branches=[name])
        ax.plot(hertz / 1e3, velocities.phase[0], color=colours[name], label=f"{name}, phase")
        ax.plot(
            hertz / 1e3,
            velocities.group[0],
            color=colours[name],
            dashes=(3.5, 1.5),
            label=f"{name}, group",
        )
    ax.axvline(PULSE / 1e3, color="0.5", linewidth=0.6, zorder=0.5)
    ax.set(xlabel="Frequency (kHz)", ylabel="Velocity (m/s)", xlim=(0.0, None), ylim=(0.0, 900.0))
    ax.annotate("6.5 kHz", (PULSE / 1e3, 850.0), (3.0, 0.0), textcoords="offset points")
    ax.legend(loc="lower left", bbox_to_anchor=(0.18, 0.0))
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
