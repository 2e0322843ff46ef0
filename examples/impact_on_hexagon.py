r"""An impact on a hexagonal array
==============================

A ball at the lower edge of a triangular array of steel balls gets a velocity of 0.5 m/s upwards.
Behind the front balls spin, and some contacts open. Shown are the speeds of all balls at three
times, and where the energy is.
"""

import sys

import numpy as np

import granphon as gp
from granphon.figures.motions import motion_figure

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
network = gp.AveragedLattice(gp.Packing(steel, diameter=8e-3)).at_force(5.0).network
array = network.repeat((31, 1)).cut(1, 30)
velocities = np.zeros((array.n_balls, 3))
velocities[15, 1] = 0.5
motion = gp.NonlinearWaves(array, friction_coefficient=0.3).run(
    2.6e-4, velocities=velocities, frames=81
)
kept = (motion.energy + motion.lost) / motion.energy[0]
print(
    f"energy and losses: 1 within {np.max(np.abs(kept - 1.0)):.0e}; lost"
    f" {motion.lost[-1] / motion.energy[0]:.3f}"
)
assert np.max(np.abs(kept - 1.0)) < 2e-3

figure = motion_figure(motion)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
