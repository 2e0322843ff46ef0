r"""A random packing
================

Waves can also be computed without a lattice. LAMMPS has pressed together 400 balls of glass, of
three sizes, at random places in a periodic plane. We read its dumps as a network of contacts.

Left: contacts that carry load, as lines whose width is proportional to the force, and the balls
that carry none. Right: the density of states, and the part of it that is rotation. It has none of
the peaks of a lattice.
"""

import sys
from pathlib import Path

from granphon.figures.scales import FORCES

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection

import granphon as gp
from granphon.figures.style import STYLE
from granphon.figures.waves import plot_sample_dos

folder_of_script = Path(
    globals().get("__file__", "random_packing.py")
).parent  # the gallery runs this here, without __file__
folder = folder_of_script / "packings"
glass = gp.Material(young_modulus=70e9, poisson_ratio=0.2, density=2500.0)
files = folder / "glass_atoms.dump", folder / "glass_pairs.dump"
network = gp.ContactNetwork.from_lammps(*files, glass)
every = gp.ContactNetwork.from_lammps(*files, glass, keep_rattlers=True)
waves = gp.Waves(network)
density = waves.dos(vectors=20)
modes = waves.modes(8)

# %% Every ball that carries load is held: the only motions of zero frequency are the two
# displacements of the whole packing.

assert network.left_out == every.n_balls - network.n_balls > 0
assert modes.zero_modes == 2
assert abs(density.integral - 3.0) < 1e-9

with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.0, 3.2), dpi=300, layout="constrained")
    size = 2e3 * every.radii
    outlines = {"facecolors": "none", "edgecolors": "0.7", "linewidths": 0.4}
    place = {"offsets": 1e3 * every.positions[:, :2], "offset_transform": left.transData}
    left.add_collection(
        EllipseCollection(size, size, 0.0 * size, units="xy", **outlines, **place), autolim=False
    )
    start = network.positions[network.i]
    lines = 1e3 * np.stack([start, start + network.vector], axis=1)[:, :, :2]
    strength = network.normal_force / network.normal_force.mean()
    left.add_collection(
        LineCollection(
            list(lines), linewidths=0.8 * strength, array=strength, cmap=FORCES, capstyle="round"
        )
    )
    span = 1e3 * network.cell[0, 0]
    left.set(xlim=(0.0, span), ylim=(0.0, span), aspect="equal", xlabel="x (mm)", ylabel="y (mm)")
    plot_sample_dos(density, right)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
