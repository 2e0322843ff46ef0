r"""An impact on a hexagonal array
==============================

A ball at the lower edge of a triangular array of steel balls gets a velocity of 0.5 m/s upwards. Behind the front balls
spin, and some contacts open. Shown are the speeds of all balls at three times, and where the energy is.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import BLUE, GREEN, PAGE_WIDTH, STYLE, VERMILION

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
network = gp.AveragedLattice(gp.Packing(steel, diameter=8e-3)).at_force(5.0).network
array = network.repeat((31, 1)).cut(1, 30)
velocities = np.zeros((array.n_balls, 3))
velocities[15, 1] = 0.5
motion = gp.NonlinearWaves(array, friction_coefficient=0.3).run(2.6e-4, velocities=velocities, frames=81)
kept = (motion.energy + motion.lost) / motion.energy[0]
print(f"energy and losses: 1 within {np.max(np.abs(kept - 1.0)):.0e}; lost {motion.lost[-1] / motion.energy[0]:.3f}")
assert np.max(np.abs(kept - 1.0)) < 2e-3

with matplotlib.rc_context(STYLE):
    figure, panels = plt.subplots(1, 4, figsize=(PAGE_WIDTH, 2.1), dpi=300, layout="constrained")
    x, y = np.mod(array.positions[:, 0], array.cell[0, 0]) * 1e3, array.positions[:, 1] * 1e3
    for ax, frame in zip(panels, (20, 50, 80), strict=False):
        speed = np.linalg.norm(motion.velocities[frame], axis=1) * 1e3
        drawn = ax.scatter(x, y, c=speed, s=5, cmap="magma_r", vmin=0.0, vmax=40.0, linewidths=0.0)
        ax.set(title=f"{motion.times[frame] * 1e6:.0f} µs", aspect="equal", xticks=[], yticks=[])
    figure.colorbar(drawn, ax=panels[2], location="right", label="Speed (mm/s)", extend="max")
    for values, colour, label in (
        (motion.translation, BLUE, "translation"),
        (motion.rotation, VERMILION, "rotation"),
        (motion.stored, GREEN, "contacts"),
        (motion.lost, "0.4", "lost"),
    ):
        panels[3].plot(motion.times * 1e6, values / motion.energy[0], color=colour, linewidth=0.9, label=label)
    panels[3].set(xlabel="Time (µs)", ylabel="Part of the energy", ylim=(0.0, 1.0))
    panels[3].legend(fontsize=7, handlelength=1.0)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
