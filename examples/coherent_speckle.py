r"""Coherent and speckle
====================

The motion of a ball in a disordered array, when a pulse arrives, has two parts. The mean over a
plane of balls, and over arrays, is the coherent wave, which travels with the sound velocity and
fades. The rest is the speckle, which differs from ball to ball, arrives later and lasts longer.

Five periods of 6.5 kHz run through 220 rows of 40 balls, under two loads. Left: the coherent
amplitude (lines) and the rms of the speckle (dashed) at two distances. Right: the balls' velocities
at one moment, under the lower load.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt

import granphon as gp
from granphon.figures.style import BLUE, STYLE, VERMILION
from granphon.figures.waves import plot_frame

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2.04e-6))
simulation = gp.DirectSimulation(packing, shape=(40, 220))
pulses = {}
networks = {}
for force in (18.4, 1.8):  # N
    waves = gp.Waves(simulation.at_force(force).sample)
    pulses[force] = [
        waves.transmit(6500.0, (0, 1), distance, ends="free", duration=3.0e-3, frames=[1.6e-3])
        for distance in (0.2, 0.7)
    ]
    networks[force] = waves.network

# %% At high load nearly all of the energy that reaches the far plane is coherent, at low load less
# than half of it.

coherent = {force: [pulse.coherent_fraction for pulse in both] for force, both in pulses.items()}
assert coherent[18.4][1] > 0.95
assert all(one < 0.5 for one in coherent[1.8])

with matplotlib.rc_context(STYLE):
    figure = plt.figure(figsize=(7.0, 4.6), dpi=300, layout="constrained")
    axes = figure.subplot_mosaic([["high", "picture"], ["low", "picture"]], width_ratios=[2.6, 1.0])
    for (force, both), name in zip(pulses.items(), ("high", "low"), strict=True):
        most = float(both[0].envelope.max())
        for pulse, colour in zip(both, (BLUE, VERMILION), strict=True):
            label = f"{pulse.distance:.2g} m"
            axes[name].plot(
                1e3 * pulse.times,
                pulse.envelope / most,
                color=colour,
                linewidth=1.0,
                label=f"{label}, coherent",
            )
            style = {"color": colour, "linewidth": 1.0, "linestyle": "--"}
            axes[name].plot(
                1e3 * pulse.times,
                pulse.speckle_amplitude / most,
                label=f"{label}, speckle",
                **style,
            )
        axes[name].set(
            xlabel="Time (ms)", ylim=(0.0, None), xlim=(0.0, 3.0), title=f"$f={force:g}$ N"
        )
        axes[name].set_ylabel("Velocity over the greatest\ncoherent one at 0.2 m")
    axes["high"].legend(fontsize=7.0)
    plot_frame(networks[1.8], pulses[1.8][1], 0, axes["picture"])
    axes["picture"].set_title("Velocity upwards after 1.6 ms:\nred up, blue down")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
