r"""A column under its own weight
=============================

A column of N equal balls stands on a floor. Its contacts bear the weight of what is above them, so
that sound is slow at the top and fast at the bottom, and the modes crowd towards the top. For many
balls the frequencies are those of a continuum,
:math:`\omega_n=\frac56\,(k_1/m)^{1/2}\,j_n\,N^{-5/6}`: :math:`k_1` is the stiffness of a contact
that bears one ball, and :math:`j_n` are the zeros of the Bessel function :math:`J_{-2/5}`.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import COLOURS, STYLE

ZEROS = np.array([1.7509754, 4.8785160, 8.0166324])
GRAVITY = 9.81  # m/s^2
steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ball = gp.Ball(steel, 8e-3)
contact = gp.Hertz().between(ball, ball)
k1 = contact.stiffness(contact.overlap(ball.mass * GRAVITY))
chain = gp.Crystal.on("chain", [ball])
numbers = np.array([10, 20, 50, 100, 200, 500, 1000])
off = []
for number in numbers:
    column = chain.cut(0, int(number), edges=("floor", "free"))
    modes = gp.Waves(column.at_pressure(0.0, gravity=-GRAVITY)).modes(3)
    continuum = 5 / 6 * np.sqrt(k1 / ball.mass) * ZEROS * number ** (-5 / 6) / (2.0 * np.pi)
    off.append(np.abs(modes.frequencies / continuum - 1.0))
off = np.array(off)
# of second order in 1/N
assert np.allclose(off[-1] * numbers[-1] ** 2, off[3] * numbers[3] ** 2, rtol=0.3)
print("lowest modes of 1000 balls (Hz):", np.round(modes.frequencies, 3))

with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.0, 3.2), dpi=300, layout="constrained")
    height = (np.arange(numbers[-1]) + 0.5) * ball.diameter
    for mode, colour in enumerate(COLOURS[:3]):
        shape = modes.vectors[mode, : numbers[-1], 0]
        frequency = modes.frequencies[mode]
        left.plot(
            shape / shape[-1], height, color=colour, linewidth=1.5, label=f"{frequency:.1f} Hz"
        )
        right.plot(
            numbers,
            off[:, mode],
            "o-",
            color=colour,
            markersize=4,
            linewidth=1.0,
            label=f"mode {mode + 1}",
        )
    left.axvline(0.0, color="0.7", linewidth=0.5)
    left.set(
        xlabel="Displacement over that of the top ball",
        ylabel="Height (m)",
        ylim=(0, 8),
        title="1000 steel balls",
    )
    left.legend(loc="upper left")
    right.set(
        xscale="log",
        yscale="log",
        xlabel="Balls N",
        ylabel="Frequency over the continuum's, less 1",
    )
    right.legend()
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
