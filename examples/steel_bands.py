"""Bands of steel balls
====================

Steel balls, 8 mm in diameter, lie in a triangular array and are pressed together with 18.4 N at
each contact. The three branches along Γ-K-M-Γ are coloured by the fraction of the kinetic energy
that is rotation. Dashed lines are the limit of long waves (equations 13 to 15 of the paper, with
the corrected d²/10); the inset shows the Brillouin zone and the path. On the right is the density
of states per ball, with the contributions of translation and rotation.
"""

import sys

import numpy as np

import granphon as gp
from granphon.figures.bands import bands_figure

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
state = gp.AveragedLattice(gp.Packing(steel, diameter=8e-3)).at_force(18.446)

# the longitudinal velocity that Section IV of the paper quotes for these balls
velocity = gp.sound_velocities(state).longitudinal
print(f"v_L = {velocity:.0f} m/s")
assert round(velocity) == 791

# %%
# The rotational branch has its top at Γ, :math:`\omega^2=30\eta k/M`.

phonons = gp.Phonons(state)
bands = phonons.bands("GKMG")
dos = phonons.dos((64, 64))
top = bands.frequencies.max()
print(f"top of the rotational branch: {top / 1e3:.2f} kHz")
assert np.isclose(
    top, np.sqrt(30.0 * state.packing.mindlin_ratio) * state.scales.frequency, rtol=1e-12
)
assert round(top / 1e3, 2) == 65.82

figure = bands_figure(bands, dos, asymptotes=phonons.lattice)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
