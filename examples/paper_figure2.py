"""Figure 2 of the paper: dispersion of a triangular lattice of equal balls, with friction (above) and without (below).

B. Velicky and C. Caroli, Phys. Rev. E 65, 021307 (2002). Frequency is angular, in (k/M)^1/2, and the wave vector in 2 pi/d,
along two principal directions, Gamma-K to the left and Gamma-M to the right. Full lines are exact, dashed lines the long
waves (equations 13 to 15; the rotational branch with d^2/10 where the paper prints d^2/20). Branches are named after what
they are for long waves: longitudinal, transverse, rotational.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import granphon as gp
from granphon.plot import STYLE, plot_bands, plot_zone
from granphon.units import HertzPrefix

#: panel, branch, and where its name goes: q in 2 pi/d, omega in (k/M)^1/2
NAMES = ((0, "R", 0.42, 4.0), (0, "L", 0.38, 2.7), (0, "T", 0.42, 1.72), (1, "L", 0.38, 2.3), (1, "T", 0.42, 1.12))


def bands_of(friction: bool) -> tuple[gp.Bands, gp.ContactLattice]:
    """Bands along K-Gamma-M, and the lattice whose long waves go with them."""
    # in units of d, k and M the load does not matter
    steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    state = gp.AveragedLattice(gp.Packing(steel, diameter=8e-3, friction=friction)).at_force(18.446)
    phonons = gp.Phonons(state)
    return phonons.bands("KGM", npoints=151), phonons.lattice


def panel(bands: gp.Bands, lattice: gp.ContactLattice, ax: Axes) -> None:
    """One panel in the paper's units, with the wave vector counted from Gamma."""
    # a reduced angular frequency of one is scales.frequency in hertz
    plot_bands(bands, ax, asymptotes=lattice, unit=HertzPrefix("reduced", bands.scales.frequency))
    ax.set_ylabel(r"$\omega$  $[(k/M)^{1/2}]$")
    gamma = bands.distances[1, 0]
    values = np.array([-0.6, -0.4, -0.2, 0.0, 0.2, 0.4])
    ax.secondary_xaxis("top").set_xticks(ax.get_xticks(), [t.get_text() for t in ax.get_xticklabels()])
    ax.set_xticks(gamma + values, [f"{abs(v):.1f}" for v in values])
    ax.tick_params(axis="x", length=3)
    ax.set_xlabel(r"$q$  $[2\pi/d]$")


def main(out: Path | None = None) -> Figure:
    """Compute, check, draw; write the figure to ``out`` if it is given."""
    with_friction, without = bands_of(True), bands_of(False)

    bands, lattice = with_friction
    assert np.allclose(np.diff(bands.distances[:, [0, -1]], axis=1).ravel(), [2.0 / 3.0, 1.0 / np.sqrt(3.0)])
    eta = lattice.mindlin_ratio
    assert round(eta, 2) == 0.84
    # eta raises v_L by 13 % (without friction it is 11 % lower) and v_T by 36 %: the slopes at Gamma (equations 13 and 14)
    ratio = np.array(lattice.sound_velocities((1, 0))[0]) / without[1].sound_velocities((1, 0))[0]
    assert np.allclose(ratio, np.sqrt([1.0 + eta / 3.0, 1.0 + eta]))
    # the rotational branch starts at (30 eta)^1/2
    assert np.isclose(bands.frequencies.max() / bands.scales.frequency, np.sqrt(30.0 * eta))

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4, 5.4), dpi=300, layout="constrained")
        axes = figure.subplots(2, 1)
        panel(*with_friction, axes[0])
        panel(*without, axes[1])
        axes[0].text(0.03, 0.95, rf"friction, $\eta = {eta:.2f}$", transform=axes[0].transAxes, va="top")
        axes[1].text(0.03, 0.95, "no friction", transform=axes[1].transAxes, va="top")
        gamma = bands.distances[1, 0]
        for ax, name, q, omega in NAMES:
            axes[ax].text(gamma + q, omega, name, ha="center", va="center")
        axes[1].legend(loc="lower right")
        inset = axes[0].inset_axes((0.396, 0.53, 0.28, 0.28))
        inset.set_in_layout(False)
        plot_zone(bands, inset)
    if out is not None:
        figure.savefig(out)
    return figure


if __name__ == "__main__":
    main(Path("paper_figure2.png"))
