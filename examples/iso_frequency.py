"""Sound in all directions
=======================

On the triangular lattice long waves are isotropic, and shorter ones nearly so: "the anisotropy of
the spectrum is small", the paper says of its Figure 2. This holds for longitudinal waves at all the
frequencies shown here. But transverse waves of 30 kHz, close to the top of their branch, are more
than 1.5 times as fast along Γ-M (30°) as along Γ-K (0°).
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.path import Path

import granphon as gp
from granphon.figures.style import LONGITUDINAL_COLOUR, STYLE, TRANSVERSE_COLOUR
from granphon.phonons.paths import zone_polygon

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
phonons = gp.Phonons(gp.AveragedLattice(gp.Packing(steel, diameter=8e-3)).at_force(18.446))
lattice = phonons.lattice

# %% Group velocities of pulses of three frequencies in directions from Γ-K to Γ-M, which lie 30°
# apart.

DEGREES = np.linspace(0.0, 30.0, 13)
KILOHERTZ = (6.5, 20.0, 30.0)
directions = np.stack([np.cos(np.radians(DEGREES)), np.sin(np.radians(DEGREES))], axis=1)
group = np.array(
    [
        [gp.pulse_velocities(phonons.state, 1e3 * f, direction).group for direction in directions]
        for f in KILOHERTZ
    ]
)
anisotropy = np.ptp(group, axis=1) / group.min(axis=1)
for f, (longitudinal, transverse) in zip(KILOHERTZ, 100.0 * anisotropy, strict=True):
    print(
        f"{f:4.1f} kHz: group velocities vary by {longitudinal:.2f} % (L) and"
        f" {transverse:.2f} % (T)"
    )
assert np.allclose(anisotropy[-1], [0.0168, 0.567], rtol=1e-2)
assert np.all(anisotropy[0] < 0.002)  # the pulses of the experiments

# %% The contours of constant frequency of the two lower branches over the Brillouin zone: they are
# circles near the centre, and deviate from circles towards the edge.

zone = zone_polygon(lattice.reciprocal)
x, y = np.meshgrid(*[np.linspace(-4.3, 4.3, 301)] * 2)
q = np.stack([x, y], axis=-1).reshape(-1, 2)
kilohertz = (
    np.where(Path(zone).contains_points(q), lattice.frequencies(q).T[:2], np.nan)
    * phonons.scales.frequency
    / 1e3
)

with matplotlib.rc_context(STYLE):
    figure, (*maps, ax) = plt.subplots(
        1, 3, figsize=(7.0, 2.5), dpi=300, layout="constrained", width_ratios=[1, 1, 1.2]
    )
    for panel, values, name in zip(
        maps, kilohertz.reshape(-1, *x.shape), ("lowest branch", "second branch"), strict=True
    ):
        filled = panel.contourf(x, y, values, np.arange(0.0, 41.0, 2.5), cmap="cividis")
        panel.contour(filled, levels=np.arange(5.0, 31.0, 5.0), colors="white", linewidths=0.8)
        panel.fill(*zone.T, fill=False, linewidth=0.8)
        panel.set(aspect="equal", title=name, xlabel="$q_xd$", xticks=[-4, 0, 4], yticks=[-4, 0, 4])
    maps[0].set_ylabel("$q_yd$", labelpad=-2.0)
    figure.colorbar(
        filled, ax=maps, shrink=0.75, label="Frequency (kHz)", ticks=np.arange(0.0, 41.0, 10.0)
    )
    for b, (name, colour) in enumerate((("L", LONGITUDINAL_COLOUR), ("T", TRANSVERSE_COLOUR))):
        for f, velocities, dashes in zip(
            KILOHERTZ, group, ("-", (0, (4, 1.5)), (0, (1, 1))), strict=True
        ):
            ax.plot(
                DEGREES,
                velocities[:, b],
                color=colour,
                linestyle=dashes,
                label=f"{name}, {f:g} kHz",
            )
    ax.set(
        xlabel="Direction from Γ-K (°)", ylabel="Group velocity (m/s)", xlim=(0, 30), ylim=(0, 830)
    )
    ax.legend(loc="lower center", ncols=2, columnspacing=1.0)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
