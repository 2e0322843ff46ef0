r"""Waves at the zigzag edge of granular graphene
=============================================

Balls on a honeycomb, in contact with three neighbours each, turn as they move. A ribbon that is cut
out of them along a zigzag edge has branches that its bulk does not have: waves that run along its
free edges. They lie in the gaps of the bulk's bands (light grey), projected on the wave vector
along the edge. Blue ones are at the lower edge and red ones at the upper; where both coincide one
covers the other, and where the two edges feel each other the colours are mixed.

The waves of one edge of a half space (dots) are poles of its Green's function. The ribbon has each
of them twice.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.bands import plot_bands
from granphon.figures.style import STYLE

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(STEEL, diameter=8e-3, lattice="honeycomb", friction=True)
network = gp.AveragedLattice(packing).at_force(18.446).network
ribbon = network.cut(axis=1, layers=16)
edge = gp.Surface(network, axis=1)

bands = gp.Phonons(ribbon).bands(npoints=61)
bulk = [edge.continuum(segment) for segment in bands.qpoints]
q = np.linspace(0.02, 0.5, 25)
waves = edge.branches(q[:, None])

# %% At q = 0.35, of the modes of the ribbon nearly all of whose energy is in its outer quarter,
# there is one at each edge for each wave of the half space.

is_near = np.abs(waves.place - np.argmin(np.abs(q - 0.34))) < 1
lone = waves.frequencies[is_near & (waves.weight > 0.3)]
near = gp.Phonons(ribbon).frequencies([[0.34]])[0]
assert lone.size == 2
assert all(np.sum(np.abs(near / frequency - 1.0) < 1e-5) == 2 for frequency in lone)
print("waves of the edge at q = 0.34 (Hz):", np.round(lone, 1))

with matplotlib.rc_context(STYLE):
    figure, ax = plt.subplots(figsize=(4.2, 3.6), dpi=300, layout="constrained")
    plot_bands(bands, ax, bulk=bulk, edges=True)
    x = q[waves.place] / 0.5 * bands.distances[-1, -1]
    ax.plot(x, waves.frequencies / 1e3, "k.", markersize=3, label="half space", zorder=5)
    figure.legend(loc="outside lower center", ncols=4)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
