r"""Two close packings of steel balls
=================================

Face-centred cubic and hexagonal close-packed crystals of steel balls under pressure are the same
layers in another order. Sound along the stacking axis does not depend on the order: the twelve
branches of hcp along Γ-A are the six of fcc along Γ-L, folded. In other directions the two differ.
"""

import sys

from granphon.figures.scales import scale_axis

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.bands import plot_bands, plot_zone
from granphon.figures.style import BLUE, LONGITUDINAL_COLOUR, STYLE, TRANSVERSE_COLOUR, VERMILION

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
media = {
    name: gp.AveragedLattice(gp.Packing(steel, diameter=8e-3, lattice=name))
    for name in ("fcc", "hcp")
}
pressure = np.logspace(4.0, 7.0, 31)  # Pa
states = {name: medium.at_pressure(pressure) for name, medium in media.items()}

# %% At the same pressure the contacts carry the same force: in both packings a ball has twelve
# contacts, and both are equally dense. Sound velocities are proportional to the sixth root of the
# pressure. Along the stacking axis they are equal.

stacking = {"fcc": (1, 1, 1), "hcp": (0, 0, 1)}
sound = {name: gp.sound_velocities(state, stacking[name]) for name, state in states.items()}
assert np.allclose(states["fcc"].force, states["hcp"].force, rtol=1e-12)
assert np.allclose(sound["fcc"].velocities, sound["hcp"].velocities, rtol=1e-12)
assert np.allclose(
    sound["fcc"].longitudinal,
    sound["fcc"].longitudinal[0] * (pressure / 1e4) ** (1 / 6),
    rtol=1e-12,
)
megapascal = gp.sound_velocities(media["fcc"].at_pressure(1e6), (1, 1, 1))
print(
    f"along the stacking axis at 1 MPa: {megapascal.longitudinal:.1f} and"
    f" {megapascal.transverse[0]:.1f} m/s"
)

# %% Two layers make a period of hcp. So two wave vectors of fcc whose sum is the edge of the zone
# of fcc are one wave vector in hcp.

phonons = {name: gp.Phonons(medium.at_pressure(1e6)) for name, medium in media.items()}
fraction = np.linspace(0.0, 0.5, 11)[1:, None]
first, second = (
    phonons["fcc"].frequencies(q * np.ones(3)) for q in (0.5 * fraction, 0.5 - 0.5 * fraction)
)
folded = np.sort(np.concatenate([first, second], axis=1), axis=1)
assert np.allclose(phonons["hcp"].frequencies(fraction * [0, 0, 1]), folded, rtol=1e-9, atol=1e-6)

with matplotlib.rc_context(STYLE):
    figure = plt.figure(figsize=(7.0, 4.6), dpi=300, layout="constrained")
    grid = figure.add_gridspec(2, 3, height_ratios=[1.9, 1.0], width_ratios=[1.0, 1.0, 0.7])
    for column, (name, path) in enumerate((("fcc", "GXWKGL"), ("hcp", "GMKGALHA"))):
        bands = phonons[name].bands(path, npoints=51)
        ax = figure.add_subplot(grid[0, column])
        plot_bands(bands, ax).set_title(f"{name}, 1 MPa")
        plot_zone(bands, figure.add_subplot(grid[1, column]))
    ax = figure.add_subplot(grid[0, 2])
    dense = np.linspace(0.0, 0.5, 101)[:, None]
    ax.plot(
        2.0 * dense, phonons["hcp"].frequencies(dense * [0, 0, 1]) / 1e3, color=BLUE, linewidth=1.2
    )
    ax.plot(2.0 * fraction, folded / 1e3, "o", color=VERMILION, markersize=3.0, fillstyle="none")
    ax.set(
        xticks=[0, 1],
        xticklabels=["Γ", "A"],
        xlim=(0, 1),
        xlabel="Wave vector",
        ylabel="Frequency (kHz)",
    )
    ax.set(ylim=(0, 82), title="hcp (lines), fcc folded")
    ax = figure.add_subplot(grid[1, 2])
    for values, colour, label in (
        (sound["hcp"].longitudinal, LONGITUDINAL_COLOUR, "L"),
        (sound["hcp"].transverse[:, 0], TRANSVERSE_COLOUR, "T"),
    ):
        ax.plot(pressure / 1e6, values, color=colour, label=label)
    scale_axis(ax, "y", np.array([250.0, 1600.0]))
    ax.set(
        xscale="log",
        xticks=[0.01, 0.1, 1, 10],
        xticklabels=["0.01", "0.1", "1", "10"],
        xlabel="Pressure (MPa)",
    )
    ax.set(ylim=(250, 1600), ylabel="Velocity (m/s)")
    ax.legend(loc="upper left", ncols=2)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
