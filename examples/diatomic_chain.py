r"""A chain of two kinds of balls
=============================

Steel and aluminium balls of one size follow each other in a chain under a static force. The chain
has two branches, with a gap between them: at the end of the zone the light balls rest in the lower
one, and the heavy balls in the upper one. All frequencies grow as the sixth root of the force, and
so does the gap. The balls are those of an experiment on such chains: 19.05 mm, 28.84 g and 9.75 g.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import COLOURS, STYLE

STEEL = gp.Ball(gp.Material(193e9, 0.30, 8000.0), 19.05e-3, mass=28.84e-3, name="steel")
ALUMINIUM = gp.Ball(gp.Material(73.5e9, 0.33, 2700.0), 19.05e-3, mass=9.75e-3, name="aluminium")
chain = gp.Crystal.on("chain", [STEEL, ALUMINIUM])
forces = np.geomspace(1.0, 100.0, 25)
gaps = np.array([gp.Phonons(state).gaps()[0] for state in chain.at_force(forces)])

# %%
# Closed forms, with the stiffness k of all contacts: the edges of the gap are :math:`\omega^2=2k/M`
# of the heavy ball and :math:`2k/m` of the light one, and the top is :math:`2k(1/M+1/m)`.

state = chain.at_force(20.0)
k = state.normal_stiffness[0]
edges = [np.sqrt(2.0 * k / STEEL.mass), np.sqrt(2.0 * k / ALUMINIUM.mass)]
phonons = gp.Phonons(state)
assert np.allclose(phonons.gaps(), [np.array(edges) / (2.0 * np.pi)], rtol=1e-12)
assert np.allclose(gaps / gaps[0], (forces / forces[0])[:, None] ** (1 / 6), rtol=1e-12)
print("gap at 20 N (Hz):", np.round(phonons.gaps()[0], 2))

fraction = np.linspace(0.0, 0.5, 201)
branches = phonons.frequencies(fraction[:, None]) / 1e3
with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.0, 3.0), dpi=300, layout="constrained")
    left.plot(2.0 * fraction, branches, color=COLOURS[0], linewidth=1.5)
    left.axhspan(*phonons.gaps()[0] / 1e3, color="0.85", label="gap at 20 N")
    left.set(
        xlabel=r"Wave vector $q\,(d_1+d_2)/\pi$",
        ylabel="Frequency (kHz)",
        xlim=(0, 1),
        ylim=(0, 10.5),
    )
    left.legend(loc="lower right")
    right.fill_between(forces, *(gaps.T / 1e3), color="0.85")
    for edge, (name, colour) in enumerate(
        (("heavy balls move", COLOURS[1]), ("light balls move", COLOURS[2]))
    ):
        right.plot(forces, gaps[:, edge] / 1e3, color=colour, linewidth=1.5, label=name)
    right.set(
        xscale="log",
        xlabel="Force (N)",
        ylabel="Edges of the gap (kHz)",
        xlim=(1, 100),
        ylim=(0, 12),
    )
    right.legend(loc="upper left")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
