r"""Poisson's ratio orders the branches
===================================

Which branch is the highest? At the point M of the Brillouin zone one mode is transverse, one
longitudinal and one purely rotational, and Poisson's ratio decides their order.

The reduced frequencies depend only on the ratio of the shear to the normal stiffness of a contact,
which is Mindlin's :math:`\eta=2(1-\nu)/(2-\nu)` with Poisson's ratio :math:`\nu`. The rotational
mode crosses the transverse one at :math:`\eta=1/2` and the longitudinal one at 3/4. So it is the
highest in steel and glass, but not in gold, whose :math:`\nu` is above 0.4. No Poisson's ratio
gives :math:`\eta=1/2`; contacts reach it only under a tangential load, which softens them in shear.
At K the rotational mode is the lowest in every material.
"""

import sys

from granphon.figures.scales import ROTATION

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq

import granphon as gp
from granphon.figures.style import LONGITUDINAL_COLOUR, STYLE, TRANSVERSE_COLOUR

POINTS = {"M": (1 / 2, 0), "K": (1 / 3, 1 / 3)}


def mode(name, point, eta):
    """Angular frequency, (k/M)^1/2, of the mode at a point of the zone whose motion is most of the
    named kind.
    """
    lattice = gp.ContactLattice.of("triangular", eta)
    modes = lattice.modes(
        lattice.wavevectors([POINTS[point]]), direction=lattice.wavevectors(POINTS[point])
    )
    return modes.frequencies[0, np.argmax(getattr(modes, f"{name}_fraction")[0])]


# %% We find where branches cross, following each by its motion and not by its order, and compare
# with the closed forms at M and K.


def crossing(first, second, point, low, high):
    return brentq(
        lambda eta: mode(first, point, eta) - mode(second, point, eta), low, high, xtol=1e-12
    )


crossings = [
    crossing("rotational", "transverse", "M", 0.4, 0.6),
    crossing("rotational", "longitudinal", "M", 0.7, 0.9),
    crossing("transverse", "longitudinal", "M", 0.9, 1.2),
    crossing("rotational", "longitudinal", "K", 1.4, 1.6),
]
print("crossings at eta =", *np.round(crossings, 7))
assert np.allclose(crossings, [1 / 2, 3 / 4, 1, 3 / 2], rtol=0, atol=1e-8)
gold = gp.Material(young_modulus=79e9, poisson_ratio=0.42, density=19300.0)
assert mode("rotational", "M", gold.mindlin_ratio) < mode("longitudinal", "M", gold.mindlin_ratio)
for eta in (0.3, 0.84):
    squares = [mode(name, "M", eta) ** 2 for name in ("transverse", "longitudinal", "rotational")]
    assert np.allclose(squares, [2 + 6 * eta, 6 + 2 * eta, 10 * eta], rtol=1e-12)
    assert np.allclose(mode("rotational", "K", eta) ** 2, 7.5 * eta, rtol=1e-12)
    assert np.allclose(mode("longitudinal", "K", eta) ** 2, 4.5 * (1 + eta), rtol=1e-12)

# %% The white range of the figure holds all values of :math:`\eta` that Poisson's ratio of a
# material can give.

NU = (0.5, 0.4, 0.2, 0.0, -0.5, -1.0)
ETA = np.linspace(0.303, 1.403, 120)
STYLES = {
    "transverse": (TRANSVERSE_COLOUR, 2.0),
    "longitudinal": (LONGITUDINAL_COLOUR, 1.2),
    "rotational": (ROTATION(1.0), 2.0),
}

with matplotlib.rc_context(STYLE):
    figure, axes = plt.subplots(
        1, 2, figsize=(7.0, 3.4), dpi=300, layout="constrained", sharey=True
    )
    for ax, point in zip(axes, POINTS, strict=True):
        for name, (colour, width) in STYLES.items():
            ax.plot(
                ETA,
                [mode(name, point, eta) for eta in ETA],
                color=colour,
                linewidth=width,
                label=name,
            )
        for low, high in ((0.3, 2 / 3), (4 / 3, 1.4)):
            ax.axvspan(low, high, color="0.92", zorder=0)
        ax.set(xlim=(0.3, 1.4), ylim=(1.4, 3.9), xlabel=r"Mindlin ratio $\eta$")
        ax.text(0.03, 0.96, point, transform=ax.transAxes, va="top", fontsize=10.0)
        above = ax.secondary_xaxis("top")
        above.set_xticks([2 * (1 - nu) / (2 - nu) for nu in NU], [f"{nu:g}" for nu in NU])
        above.set_xlabel(r"Poisson's ratio $\nu$")
    for eta, square, label in ((0.5, 5.0, "1/2"), (0.75, 7.5, "3/4"), (1.0, 8.0, "1")):
        axes[0].plot(eta, np.sqrt(square), "o", color="black", markersize=4)
        axes[0].annotate(
            label, (eta, np.sqrt(square)), (0, 5), textcoords="offset points", ha="center"
        )
    axes[0].set_ylabel(r"Angular frequency $[(k/M)^{1/2}]$")
    axes[0].legend(loc="lower right")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
