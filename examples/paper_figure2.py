r"""Figure 2 of the paper: dispersion
=================================

The dispersion of a triangular lattice of equal balls, with friction (left) and without (right), as
in B. Velický and C. Caroli, Phys. Rev. E 65, 021307 (2002).

Frequency is angular, in :math:`(k/M)^{1/2}`, and the wave vector in :math:`2\pi/d`, along two
principal directions, Γ-K to the left and Γ-M to the right. Full lines are exact; dashed lines are
the limit of long waves (equations 13 to 15, the rotational branch with :math:`d^2/10` where the
paper prints :math:`d^2/20`). Branches are named after their motion in that limit: longitudinal,
transverse, rotational.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.base.scales import HertzPrefix
from granphon.figures.bands import plot_bands, plot_zone
from granphon.figures.style import STYLE

# in units of d, k and M the load does not matter
steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
rough, smooth = (
    gp.Phonons(
        gp.AveragedLattice(gp.Packing(steel, diameter=8e-3, friction=friction)).at_force(18.446)
    )
    for friction in (True, False)
)
bands = rough.bands("KGM", npoints=151)

# %% We check the lengths of Γ-K and Γ-M, how much friction raises the slopes at Γ (equations 13 and
# 14), and the frequency at which the rotational branch starts.

assert np.allclose(
    np.diff(bands.distances[:, [0, -1]], axis=1).ravel(), [2.0 / 3.0, 1.0 / np.sqrt(3.0)]
)
eta = steel.mindlin_ratio
assert round(eta, 2) == 0.84
ratio = rough.lattice.sound_velocities((1, 0))[0] / smooth.lattice.sound_velocities((1, 0))[0]
assert np.allclose(ratio, np.sqrt([1.0 + eta / 3.0, 1.0 + eta]))
assert np.isclose(bands.frequencies.max() / bands.scales.frequency, np.sqrt(30.0 * eta))

#: panel, branch, and where its name goes
NAMES = (
    (0, "R", 0.42, 4.0),
    (0, "L", 0.38, 2.7),
    (0, "T", 0.42, 1.72),
    (1, "L", 0.38, 2.3),
    (1, "T", 0.42, 1.12),
)

with matplotlib.rc_context(STYLE):
    figure, axes = plt.subplots(1, 2, figsize=(7.0, 3.2), dpi=300, layout="constrained")
    for ax, one, title in (
        (axes[0], rough, rf"friction, $\eta = {eta:.2f}$"),
        (axes[1], smooth, "no friction"),
    ):
        # a reduced angular frequency of one is scales.frequency in hertz
        unit = HertzPrefix("reduced", one.scales.frequency)
        plot_bands(
            one.bands("KGM", npoints=151), ax, asymptotes=one.lattice, unit=unit, colorbar=False
        )
        gamma = bands.distances[1, 0]
        values = np.array([-0.6, -0.4, -0.2, 0.0, 0.2, 0.4])
        ax.secondary_xaxis("top").set_xticks(
            ax.get_xticks(), [t.get_text() for t in ax.get_xticklabels()]
        )
        ax.set_xticks(gamma + values, [f"{abs(v):.1f}" for v in values])
        ax.tick_params(axis="x", length=3)
        ax.set(xlabel=r"$q$  $[2\pi/d]$", ylabel=r"$\omega$  $[(k/M)^{1/2}]$")
        ax.text(0.03, 0.95, title, transform=ax.transAxes, va="top")
    for ax, name, q, omega in NAMES:
        axes[ax].text(gamma + q, omega, name, ha="center", va="center")
    axes[1].legend(loc="lower right")
    inset = axes[0].inset_axes((0.396, 0.53, 0.28, 0.28))
    inset.set_in_layout(False)
    plot_zone(bands, inset)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
