r"""A chain of beads over magnets
=============================

Magnets below a chain of steel beads pull each bead back to its place: springs to the ground,
against displacements along and across the chain and against rotation. Bands then begin at cut-off
frequencies, and the balls that turn against each other like gears, which cost nothing in a free
chain, have a frequency of their own. Below the lowest cut-off no wave passes a row of beads.
Magneto-granular chains with rotation are those of F. Allein et al., Appl. Phys. Lett. 108, 161903
(2016).
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import COLOURS, STYLE

BEAD = gp.Ball(gp.Material(210e9, 0.30, 7780.0), 15.875e-3)
SPRINGS = {"x": 2e6, "y": 4e6, "rotation": 60.0}  # N/m, N/m, N m
FORCE = 2.0  # N
free = gp.Crystal.on("chain", [BEAD], motions="in_plane").at_force(FORCE)
held = gp.Crystal.on("chain", [BEAD], motions="in_plane", on_site=SPRINGS).at_force(FORCE)

# %%
# Closed forms: at q = 0 beads move along and across the chain at :math:`(k_x/m)^{1/2}` and
# :math:`(k_y/m)^{1/2}`, and turn together at :math:`((k_\phi+4\kappa R^2)/I)^{1/2}`. At the end of
# the zone gears turn at :math:`(k_\phi/I)^{1/2}`.

kappa = held.shear_stiffness[0]
turning = (SPRINGS["rotation"] + 4.0 * kappa * BEAD.radius**2) / BEAD.inertia
squares = np.sort([SPRINGS["x"] / BEAD.mass, SPRINGS["y"] / BEAD.mass, turning])
onset = gp.Phonons(held).onset()
assert np.allclose(onset.frequencies, np.sqrt(squares) / (2.0 * np.pi), rtol=1e-12)
gears = np.sqrt(SPRINGS["rotation"] / BEAD.inertia) / (2.0 * np.pi)
assert np.isclose(gp.Phonons(held).frequencies([[0.5]])[0, 0], gears, rtol=1e-9)
print("cut-off frequencies (Hz):", np.round(onset.frequencies, 1))

# %%
# A row of twenty beads is shaken along itself at one end. What arrives at the other end begins at
# the cut-off frequency of motion along the chain.

fractions = np.linspace(0.0, 0.5, 201)
hertz = np.linspace(20.0, 9000.0, 600)
arriving = {}
for name, state in (("free", free), ("held", held)):
    row = gp.Waves(state.network.cut(0, 20))
    arriving[name] = np.abs(np.asarray(row.response(hertz, (0, "x"), (19, "x"), loss_factor=0.02)))
with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.0, 3.0), dpi=300, layout="constrained")
    for state, look, label in (
        (free, {"color": "0.65", "linewidth": 1.0, "linestyle": "--"}, "without magnets"),
        (held, {"color": COLOURS[0], "linewidth": 1.5}, "over magnets"),
    ):
        bands = gp.Phonons(state).frequencies(fractions[:, None]) / 1e3
        lines = left.plot(2.0 * fractions, bands, **look)
        lines[0].set_label(label)
    left.set(xlabel=r"Wave vector $qd/\pi$", ylabel="Frequency (kHz)", xlim=(0, 1), ylim=(0, 14))
    left.legend(loc="upper right")
    right.semilogy(
        hertz / 1e3, arriving["free"], color="0.65", linewidth=1.0, linestyle="--", label="without"
    )
    right.semilogy(
        hertz / 1e3, arriving["held"], color=COLOURS[0], linewidth=1.2, label="over magnets"
    )
    cutoff = float(np.sqrt(SPRINGS["x"] / BEAD.mass) / (2.0 * np.pi))
    right.axvline(cutoff / 1e3, color=COLOURS[1], linewidth=0.8, label="cut-off frequency")
    right.set(
        xlabel="Frequency (kHz)",
        ylabel="Displacement at the end (m/N)",
        xlim=(0, 9),
        ylim=(1e-13, 1e-4),
    )
    right.legend(loc="upper right")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
