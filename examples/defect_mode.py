r"""A light ball in a chain
=======================

One light ball in a chain of equal balls vibrates faster than the chain can follow: its mode lies
above the band, and dies away from ball to ball. With the mass :math:`(1-e)M` of that ball the
frequency is that of the top of the band over :math:`(1-e^2)^{1/2}`, and neighbouring amplitudes
have the ratio :math:`(1-e)/(1+e)`, with changing signs.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import COLOURS, STYLE

LENGTH = 81
PLACE = 40
steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ball = gp.Ball(steel, 8e-3)
chain = gp.Crystal.on("chain", [ball]).repeat((LENGTH,))
top = np.sqrt(4.0 * chain.at_force(10.0).normal_stiffness[0] / ball.mass) / (2.0 * np.pi)
lighter = np.linspace(0.1, 0.9, 9)
frequencies = []
shapes = []
for e in lighter:
    with_defect = chain.replace(PLACE, gp.Ball(steel, 8e-3, mass=(1.0 - e) * ball.mass))
    modes = gp.Waves(with_defect.at_force(10.0)).modes(1, nearest=top / np.sqrt(1.0 - e * e))
    frequencies.append(modes.frequencies[0] / top)
    shapes.append(modes.vectors[0, :, 0])
assert np.allclose(frequencies, 1.0 / np.sqrt(1.0 - lighter**2), rtol=1e-6)

with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.0, 3.0), dpi=300, layout="constrained")
    e = np.linspace(0.0, 0.93, 200)
    left.plot(e, 1.0 / np.sqrt(1.0 - e**2), color="0.5", linewidth=1.0, label=r"$(1-e^2)^{-1/2}$")
    left.plot(lighter, frequencies, "o", color=COLOURS[0], markersize=4, label="chain of 81 balls")
    left.axhspan(0.0, 1.0, color="0.9")
    left.text(0.03, 0.93, "band", va="top")
    left.set(
        xlabel="Missing part of the mass, e",
        ylabel="Frequency over the top of the band",
        xlim=(0, 1),
        ylim=(0.8, 2.6),
    )
    left.legend(loc="upper left")
    for number, colour in ((1, COLOURS[0]), (4, COLOURS[1])):
        shape = shapes[number] / shapes[number][PLACE]
        near = np.arange(PLACE - 10, PLACE + 11)
        right.plot(
            near - PLACE,
            shape[near],
            "o-",
            color=colour,
            markersize=3,
            linewidth=1.0,
            label=f"$e={lighter[number]:.1f}$",
        )
    right.axhline(0.0, color="0.7", linewidth=0.5)
    right.set(xlabel="Balls from the light one", ylabel="Displacement over its own", xlim=(-10, 10))
    right.legend()
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
