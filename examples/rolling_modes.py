r"""Rolling that costs nothing
==========================

Balls that roll on one another without slip cost no energy, unless contacts resist bending or
torsion. If the balls can be divided into two kinds so that every ball touches only balls of the
other kind, all balls of one kind can turn one way and those of the other kind the opposite way, as
gears do. Such modes have zero frequency at points of the Brillouin zone, on lines, or everywhere.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.modes import plot_mode
from granphon.figures.style import STYLE
from granphon.figures.views import View

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)


def crystal(lattice, **extra):
    return gp.Phonons(
        gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice=lattice, **extra)).at_force(18.446)
    )


def count(phonons, q):
    """Number of modes of zero frequency at each q point."""
    return np.sum(phonons.frequencies(q) < 1e-9 * phonons.scales.frequency, axis=1)


# %% Everywhere in the zone these branches are zero: three of the six of the chain, and, for balls
# that move out of the plane, one of the square lattice and three of six of the honeycomb. There the
# balls have more motions than their contacts resist.

rng = np.random.default_rng(0)
chain, square, honeycomb = (
    crystal(name, motions=motions)
    for name, motions in (
        ("chain", "all"),
        ("square", "out_of_plane"),
        ("honeycomb", "out_of_plane"),
    )
)
assert np.all(count(chain, rng.uniform(0.05, 0.45, (9, 1))) == 3)
assert np.all(count(square, rng.uniform(0.05, 0.45, (9, 2))) == 1)
assert np.all(count(honeycomb, rng.uniform(0.05, 0.45, (9, 2))) == 3)

# %% At points and on lines these modes are zero: in the body-centred cubic crystal three at H,
# where neighbours turn against one another about any axis; in the simple cubic crystal one from M
# to R, and three at R. The face-centred cubic crystal has none, because its balls touch in
# triangles: three gears in a ring cannot turn.

bcc = crystal("bcc")
sc = crystal("sc")
fcc = crystal("fcc")
M = np.array([0.5, 0.5, 0.0])
R = np.array([0.5, 0.5, 0.5])
assert list(count(bcc, [[0.5, -0.5, 0.5]])) == [3]
assert list(count(sc, [M, 0.7 * M + 0.3 * R, R])) == [1, 1, 3]
assert np.all(count(fcc, rng.uniform(0.05, 0.45, (99, 3))) == 0)

# %%
# A little stiffness against bending and torsion is enough: with a hundredth of :math:`kd^2` of
# each, the gears of the body-centred crystal have a frequency of 17 kHz. If neighbours spin in
# opposite directions, a third of the squared difference of their rotations is twist, and the rest
# is roll; with the moment of inertia :math:`Md^2/10`,
# :math:`\omega^2=\frac{160}3(\tau+2\beta)\,k/M`.

glued = crystal("bcc", torsion=0.01, bending=0.01)
gears = glued.frequencies([[0.5, -0.5, 0.5]])[0, :3]
assert np.allclose((gears / glued.scales.frequency) ** 2, 160.0 / 3.0 * 0.03, rtol=1e-12)
print("gears of glued balls (kHz):", (gears / 1e3).round(2))

with matplotlib.rc_context(STYLE):
    figure, axes = plt.subplots(
        1, 3, figsize=(7.0, 3.0), dpi=300, layout="constrained", width_ratios=[1.25, 1.0, 1.0]
    )
    plot_mode(chain, (0.25,), 2, axes[0], cells=(5,))
    plot_mode(sc, R, 0, axes[1])
    plot_mode(bcc, (0.5, -0.5, 0.5), 0, axes[2], view=View(-62.0, 24.0))
    for ax, name in zip(axes, ("chain", "simple cubic, R", "body-centred cubic, H"), strict=True):
        ax.set_title(f"{name}\n{ax.get_title().splitlines()[1]}")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
