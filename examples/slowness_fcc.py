r"""Slowness of a crystal in space
==============================

Slowness is the inverse of the sound velocity. The figure shows it over all directions, in a
face-centred cubic crystal of steel balls, without friction on the left and with it on the right.
Three waves travel in each direction, one of them nearly longitudinal (dark). Friction makes sound
not only faster but almost the same in all directions. Dashed lines are polarised across the cut.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.slowness import plot_slowness, plot_slowness_surface
from granphon.figures.style import STYLE

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
smooth, rough = (
    gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice="fcc", friction=friction)).at_pressure(1e6)
    for friction in (False, True)
)

# %%
# The squared velocities follow from three elastic constants,
# :math:`C_{11}=2C_{44}=\sqrt2\,k(1+\eta)/d` and :math:`C_{12}=k(1-\eta)/(\sqrt2\,d)`. The ratio
# :math:`2C_{44}/(C_{11}-C_{12})=2(1+\eta)/(1+3\eta)` is 1 where sound is isotropic: it is 2 without
# friction, and 1.05 for rough steel.

directions = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
for name, state in (("smooth", smooth), ("rough", rough)):
    along_edge, along_diagonal = gp.sound_velocities(state, directions).velocities
    eta = state.packing.mindlin_ratio
    zener = (along_edge[0] / along_diagonal[0]) ** 2
    print(f"{name}: {along_edge[[0, 2]].round(1)} m/s along [100], anisotropy {zener:.3f}")
    assert np.isclose(zener, 2.0 * (1.0 + eta) / (1.0 + 3.0 * eta), rtol=1e-12)
    assert np.isclose(along_edge[2], np.sqrt(2.0) * along_edge[0], rtol=1e-12)

with matplotlib.rc_context(STYLE):
    figure = plt.figure(figsize=(7.0, 4.6), dpi=300, layout="constrained")
    above, beneath = figure.subfigures(2, 1, height_ratios=[1.5, 1.0])
    surfaces = above.subplots(1, 2)
    for state, ax, name in zip(
        (smooth, rough), surfaces, ("without friction", "with friction"), strict=True
    ):
        plot_slowness_surface(state, ax).set_title(name)
    cuts = beneath.subplots(1, 4)
    for k, state in enumerate((smooth, rough)):
        plot_slowness(state, cuts[2 * k], colorbar=False)
        plot_slowness(state, cuts[2 * k + 1], plane=((1, 1, 0), (0, 0, 1)), colorbar=False)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
