r"""A granular chain that bends and twists
======================================

Each ball of a row of steel balls has six motions. Without stiffness against torsion and bending
three of the six branches have zero frequency: the balls twist freely about the row, and in two ways
they roll on one another while the row moves sideways. Small stiffnesses against both, as in glued
or sintered contacts, turn these branches into a torsional wave and two flexural ones.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.modes import plot_mode
from granphon.figures.style import STYLE

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
TORSION = 0.02
BENDING = 0.01
loose, glued = (
    gp.Phonons(
        gp.AveragedLattice(
            gp.Packing(steel, 8e-3, lattice="chain", motions="all", **extra)
        ).at_force(18.446)
    )
    for extra in ({}, {"torsion": TORSION, "bending": BENDING})
)

# %%
# Closed forms, with :math:`s=\sin(qd/2)`, :math:`c=\cos(qd/2)`, :math:`\tau` and :math:`\beta` the
# stiffness of torsion and
# bending over :math:`kd^2`, and frequencies in :math:`(k/M)^{1/2}`. The longitudinal branch is
# :math:`\omega^2=4s^2`, the
# torsional one :math:`40\tau s^2`. Displacement across the row and rotation about the other axis
# across it are coupled: the
# sum of the two :math:`\omega^2` is :math:`4\eta s^2+10(\eta c^2+4\beta s^2)`, and their product
# :math:`160\,\eta\beta s^4`. Without bending the product is zero: one of the two frequencies is
# zero.

fraction = np.linspace(0.0, 0.5, 101)
eta = steel.mindlin_ratio
s2 = np.sin(np.pi * fraction) ** 2


def closed_form(torsion, bending):
    half = 2.0 * eta * s2 + 5.0 * (eta * (1.0 - s2) + 4.0 * bending * s2)
    upper = half + np.sqrt(half**2 - 160.0 * eta * bending * s2**2)
    lower = 160.0 * eta * bending * s2**2 / upper
    return np.sqrt(np.stack([4.0 * s2, 40.0 * torsion * s2, lower, lower, upper, upper], axis=1))


for phonons, stiffness in ((loose, (0.0, 0.0)), (glued, (TORSION, BENDING))):
    frequencies = phonons.frequencies(fraction[:, None]) / phonons.scales.frequency
    assert np.allclose(
        frequencies, np.sort(closed_form(*stiffness), axis=1), rtol=1e-12, atol=1e-12
    )
branches = closed_form(TORSION, BENDING) * glued.scales.frequency / 1e3
print("top of the flexural branches (kHz):", round(branches[-1, 2], 2))

# %% Long flexural waves are those of a beam, :math:`\omega=\sqrt\beta\,(qd)^2`, with a frequency
# proportional to the square of q.

short = 1e-3
assert np.isclose(
    glued.lattice.frequencies([[short]])[0, 0], np.sqrt(BENDING) * short**2, rtol=1e-5
)

STYLES = {
    "longitudinal": (0, "#0D0887"),
    "torsional": (1, "#009E73"),
    "flexural (2)": (2, "#56B4E9"),
    "rotational (2)": (4, "#E69F00"),
}
with matplotlib.rc_context(STYLE):
    figure = plt.figure(figsize=(7.0, 3.0), dpi=300, layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=[1.0, 1.25])
    ax = left.subplots()
    for name, (branch, colour) in STYLES.items():
        ax.plot(2.0 * fraction, branches[:, branch], color=colour, linewidth=1.5, label=name)
    ax.set(xlabel=r"Wave vector $qd/\pi$", ylabel="Frequency (kHz)", xlim=(0, 1), ylim=(0, 42))
    left.legend(loc="outside upper center", ncols=2)
    for ax, branch in zip(right.subplots(2, 1), (0, 5), strict=True):
        plot_mode(glued, (1 / 8,), branch, ax, cells=(8,))
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
