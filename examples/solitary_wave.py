r"""A solitary wave
===============

The end of a chain of steel balls is hit at 0.3 m/s. The chain is hardly pressed, so that contacts
bear next to nothing but the wave, which is a few balls long and keeps its form. Its velocity goes
with the sixth root of its greatest force: lines in the right panel are 0.90553 d c^(1/3) m^(-1/2)
F^(1/6), with c of Hertz's law f = c overlap^(3/2).
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.motions import plot_motion
from granphon.figures.style import BLUE, PAGE_WIDTH, STYLE

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, diameter=8e-3, lattice="chain", motions="longitudinal")
chain = gp.AveragedLattice(packing).at_force(1e-6).network.cut(0, 60)
waves = gp.NonlinearWaves(chain)


def hit(speed, duration, frames):
    """Balls of the chain after the first one got a velocity, m/s."""
    velocities = np.zeros((chain.n_balls, 3))
    velocities[0, 0] = speed
    return waves.run(duration, velocities=velocities, frames=frames)


speeds = []
forces = []
for speed in (0.02, 0.1, 0.5, 2.0):
    motion = hit(speed, 1.5e-3 * speed**-0.2 * 0.7, 2001)
    speeds.append(motion.pulse_velocity(range(20, 46)))
    forces.append(motion.peaks()[1][30])
coefficient = float(chain.normal_force[0] / waves.overlap[0] ** 1.5)
unit = 0.90553 * 8e-3 * coefficient ** (1 / 3) * chain.masses[0] ** -0.5
print(
    "velocity over the law:", np.round(np.array(speeds) / (unit * np.array(forces) ** (1 / 6)), 5)
)
assert np.allclose(speeds, unit * np.array(forces) ** (1 / 6), rtol=1e-4)

with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(PAGE_WIDTH, 2.8), dpi=300, layout="constrained"
    )
    plot_motion(hit(0.3, 1.0e-3, 201), left, show="forces")
    span = np.geomspace(0.5 * forces[0], 2.0 * forces[-1], 50)
    right.loglog(span, unit * span ** (1 / 6), color="0.5", linewidth=1.0, label="law")
    right.loglog(forces, speeds, "o", color=BLUE, markersize=4, label="runs")
    right.set(xlabel="Greatest force (N)", ylabel="Velocity of the wave (m/s)")
    right.set_yticks([300, 400, 500, 600, 800], ["300", "400", "500", "600", "800"])
    right.minorticks_off()
    right.legend()
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
