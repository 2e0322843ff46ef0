"""Density of states, and where its peaks come from
================================================

The density of states of steel balls has sharp peaks and steps. By van Hove's theorem for two
dimensions they are at the frequencies at which the group velocity of a branch is zero. At a saddle
of the branch the density of states has a logarithmic peak, at a maximum or minimum a step.
"""

import sys
from itertools import product

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import root

import granphon as gp
from granphon.figures.bands import plot_dos
from granphon.figures.style import STYLE

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
phonons = gp.Phonons(gp.AveragedLattice(gp.Packing(steel, diameter=8e-3)).at_force(18.446))
dos = phonons.dos((192, 192), points=1001)

# %% We search for zeros of the group velocity from a coarse mesh of points in the triangle Γ-K-M.
# The curvatures of the branch at each zero tell saddles from maxima and minima.

lattice = phonons.lattice
unit = phonons.scales.frequency / 1e3  # kHz
K, M = lattice.wavevectors([[1 / 3, 1 / 3], [1 / 2, 0]])
saddles = set()
extrema = set()


def velocity(q, branch):
    return lattice.modes([q], direction=(1, 0)).group_velocities[0, branch]


triangle = [(i, j) for i in range(5) for j in range(5 - i)]
for (i, j), branch in product(triangle, range(3)):
    solution = root(velocity, (i * M + j * K) / 4 + [1e-3, 2e-3], branch, tol=1e-12)
    if np.abs(solution.fun).max() < 1e-9:
        steps = 1e-3 * np.eye(2)
        slopes = [
            (velocity(solution.x + step, branch) - velocity(solution.x - step, branch)) / 2e-3
            for step in steps
        ]
        kind = saddles if np.linalg.det(slopes) < 0.0 else extrema
        kind.add(round(lattice.frequencies(solution.x)[0, branch] * unit, 3))
print("saddles (kHz):", *sorted(saddles), "\nmaxima and minima (kHz):", *sorted(extrema))

# %% Every tall peak is at a saddle. (The two saddles at 37.7 kHz lie so close to the cone at K that
# their peaks are too narrow to be seen.) The step at the top comes from the rotational branch at Γ,
# :math:`\omega^2=30\eta(1-q^2/10)`. Its height is :math:`5\sqrt3/2\pi\omega` per ball, which the
# density of states reaches from below.

kilohertz = dos.frequencies / 1e3
density = dos.total * 1e3
peaks = kilohertz[1:-1][
    (density[1:-1] > np.maximum(density[:-2], density[2:])) & (density[1:-1] > 0.11)
]
assert len(peaks) == 4
assert all(min(abs(peak - saddle) for saddle in saddles) < np.diff(kilohertz)[0] for peak in peaks)
top = max(extrema)
step = 5.0 * np.sqrt(3.0) / (2.0 * np.pi) / (top / unit) / unit
assert np.isclose(np.interp(top - 0.1, kilohertz, density), step, rtol=0.01)

with matplotlib.rc_context(STYLE):
    figure, axes = plt.subplots(
        1, 2, figsize=(7.0, 3.0), dpi=300, layout="constrained", sharey=True
    )
    for ax in axes:
        plot_dos(dos, ax, horizontal=False)
    axes[1].set(xlim=(31.5, 40.0), ylim=(0.0, 0.46), ylabel="")
    for name, places, marker, style in (
        ("saddle", saddles, "v", "-"),
        ("maximum or minimum", extrema, "o", ":"),
    ):
        axes[1].vlines(list(places), 0.0, 0.43, color="0.4", linewidth=0.5, linestyle=style)
        axes[1].plot(
            list(places),
            [0.43] * len(places),
            marker,
            color="black",
            mfc="white",
            markersize=4,
            label=name,
        )
    axes[0].legend(handles=[*axes[0].lines, *axes[1].lines[-2:]], loc="upper left")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
