r"""A wave that crosses the array
=============================

One ball in the middle of a disordered array is pushed by a burst of three periods. The wave runs
outward as a ring, and leaves the speckle behind: balls that continue to move after the ring has
passed. Colours are velocities along the push, red forward and blue backward.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.waves import animate_pulse

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2.04e-6))
waves = gp.Waves(gp.DirectSimulation(packing, shape=(60, 70)).at_force(2.0).sample)
length = waves.network.cell[0, 0]
places = waves.network.positions[:, :2].copy()
places[:, 0] %= length  # as the picture shows the oblique cell
ball = int(
    np.argmin(np.sum((places - [0.5 * length, 0.5 * waves.network.cell[1, 1]]) ** 2, axis=1))
)
frames = np.linspace(0.1e-3, 1.0e-3, 16)
pulse = waves.transmit(9000.0, (0, 1), 0.1, cycles=3, source=ball, ends="periodic", frames=frames)

# %%
# The front does not exceed the sound velocity: balls farther away than that are still at rest.

front = (
    gp.sound_velocities(gp.DirectSimulation(packing, shape=(60, 70)).at_force(2.0)).longitudinal
    * frames[2]
)
away = np.linalg.norm(places - places[ball], axis=1)
moving = np.linalg.norm(pulse.velocities[2], axis=1)
assert np.max(moving[(away > 1.3 * front) & (away < 0.2)]) < 0.02 * np.max(moving)

figure = plt.figure(figsize=(3.4, 3.4), dpi=150, layout="constrained")
animation = animate_pulse(waves.network, pulse, figure=figure)
if "-o" in sys.argv:
    animation.save(sys.argv[-1], writer="pillow")
else:
    figure.canvas.draw()  # the animation begins, also where no window can show it
    plt.show()
