r"""Modes at K and M: how balls move and turn
=========================================

The three modes of steel balls at K (upper row) and at M (lower row), in order of frequency from
left to right. Arrows are displacements. The sector on each ball is the angle through which it has
turned, vermilion anticlockwise and blue clockwise, on the same scale as the arrows.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.modes import plot_mode
from granphon.figures.style import STYLE

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
phonons = gp.Phonons(gp.AveragedLattice(gp.Packing(steel, diameter=8e-3)).at_force(18.446))
points = {"K": (1 / 3, 1 / 3), "M": (1 / 2, 0.0)}
modes = phonons.modes(list(points.values()))

# %% At both points one mode is a pure rotation. It is not always the highest: at K it is the
# lowest, at M the highest. Its frequency is :math:`\omega^2=5\eta(3+\sum_p\cos\mathbf q\cdot\mathbf
# a_p)k/M`.

assert np.allclose(modes.rotational_fraction, [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], atol=1e-12)
eta = steel.mindlin_ratio
pure = modes.frequencies[[0, 1], [0, 2]]
print("pure rotations (kHz):", *np.round(pure / 1e3, 2))
assert np.allclose((pure / phonons.scales.frequency) ** 2, [7.5 * eta, 10.0 * eta], rtol=1e-12)

with matplotlib.rc_context(STYLE):
    figure, axes = plt.subplots(2, 3, figsize=(7.0, 3.9), dpi=300, layout="constrained")
    for row, (name, q) in zip(axes, points.items(), strict=True):
        for branch, ax in enumerate(row):
            plot_mode(phonons, q, branch, ax)
            frequency_words = ax.get_title().splitlines()[1]
            ax.set_title(f"{name}, branch {branch + 1}: {frequency_words}")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
