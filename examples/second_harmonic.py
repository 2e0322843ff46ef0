r"""The second harmonic of a shaker
===============================

The end of a pressed chain is shaken at one frequency. Hertz's law makes a second harmonic, which
runs with another wave number than the product of the first with itself: 2 q is not q(2 f). The two
beat, and the second harmonic grows and falls over the distance as A^2/(4 delta) cot(q d/2)
\|sin((q(2 f) - 2 q) n d/2)\|, with the amplitude A of the shaker and the overlap delta.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.motions import plot_ball_spectrum, plot_harmonics
from granphon.figures.style import PAGE_WIDTH, STYLE

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, diameter=8e-3, lattice="chain", motions="longitudinal")
chain = gp.AveragedLattice(packing).at_force(10.0).network.cut(0, 500)
waves = gp.NonlinearWaves(chain)

qd = 0.8
overlap = waves.overlap[0]
omega_of_contact = np.sqrt(chain.normal_stiffness[0] / chain.masses[0])
frequency = omega_of_contact * np.sin(qd / 2.0) / np.pi
amplitude = 3e-3 * overlap
ramp = 30.0


def shake(time):
    """A sine that rises over the first periods."""
    turns = frequency * time
    rise = 0.5 - 0.5 * np.cos(np.pi * min(turns / ramp, 1.0))
    return amplitude * rise * np.sin(2.0 * np.pi * turns)


shaker = gp.Drive(0, (1.0, 0.0, 0.0), displacement=shake)
motion = waves.run(
    90.0 / frequency, drive=shaker, frames=90 * 24 + 1, step=1.0 / (400.0 * frequency)
)
harmonic = np.abs(motion.harmonics(frequency, count=2))[1]
ball = np.arange(61)
beat = 2.0 * np.arcsin(2.0 * np.sin(qd / 2.0)) - 2.0 * qd
theory = amplitude**2 / (4.0 * overlap) / np.tan(qd / 2.0) * np.abs(np.sin(beat * ball / 2.0))
error = np.max(np.abs(harmonic[:61] - theory)) / theory.max()
print(
    f"second harmonic: at most {theory.max() / amplitude:.1e} of the shaker, as in theory to"
    f" {error:.0e}"
)
assert error < 4e-3

with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(PAGE_WIDTH, 2.6), dpi=300, layout="constrained"
    )
    plot_harmonics(motion, left, frequency, count=2)
    left.plot(
        8.0 * ball[1:],
        1e9 * theory[1:],
        color="black",
        linewidth=0.8,
        dashes=(3, 2),
        label="theory",
    )
    left.set(xlim=(0.0, 480.0), ylim=(1e-3, 30.0))
    left.legend()
    plot_ball_spectrum(motion, right, 17)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
