"""The ladder of media against the array itself
============================================

Three media approximate an array of balls of different diameters. The averaged lattice takes all
balls to be equal. The averaged force averages over pairs of balls that are held in place. The
effective medium lets each ball give way. We compare them with the simulation, which finds the
equilibrium of every ball without an average. All are with friction, for 8 mm steel balls whose
diameters differ by 2.04 microns; points are means of four arrays of 48 x 48 balls.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import STYLE

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, diameter=8e-3, spread=gp.Uniform(2.04e-6))
force = np.geomspace(0.3, 60.0, 12)  # N
array = gp.DirectSimulation(packing, shape=(48, 48), samples=4, geometry="lattice").at_force(force)
truth = gp.sound_velocities(array)
media = {
    "averaged lattice": (gp.AveragedLattice(packing), "0.3", (0, (4, 1.5))),
    "averaged force": (gp.AveragedForce(packing), "#009E73", (0, (1, 1))),
    "effective medium": (gp.EffectiveMedium(packing), "#0072B2", "-"),
}

# %% The errors of the media. The longitudinal velocity of the effective medium is right above
# :math:`f^*=0.15`, and its transverse velocity at all loads (by chance: two errors cancel, as
# :ref:`another example <sphx_glr_gallery_conjecture.py>` shows).

valid = array.reduced_force > 0.15
error = {}
for name, (medium, _, _) in media.items():
    velocities = gp.sound_velocities(medium.at_force(force))
    error[name] = (
        np.array(
            [velocities.longitudinal / truth.longitudinal, velocities.transverse / truth.transverse]
        )
        - 1.0
    )
    print(
        f"{name}: off by {error[name][0, 2]:.1%} (L) and {error[name][1, 2]:.1%} (T) at"
        f" {force[2]:.2g} N"
    )
assert np.all(np.abs(error["effective medium"][0, valid]) < 0.01)
assert np.all(np.abs(error["effective medium"][1]) < 0.015)
assert np.allclose(error["averaged lattice"][:, 2], [0.21, 0.29], atol=0.01)
assert np.allclose(error["averaged force"][:, 2], [-0.10, -0.05], atol=0.01)

with matplotlib.rc_context(STYLE):
    figure, axes = plt.subplots(
        2,
        2,
        figsize=(7.0, 4.0),
        dpi=300,
        layout="constrained",
        sharex=True,
        sharey="row",
        height_ratios=[1.5, 1.0],
    )
    fine = np.geomspace(force[0], force[-1], 121)
    for row, (name, (above, below)) in enumerate(
        zip(("longitudinal", "transverse"), axes.T, strict=True)
    ):
        for label, (medium, colour, dashes) in media.items():
            style = {"color": colour, "linestyle": dashes, "linewidth": 1.2}
            above.loglog(
                fine,
                getattr(gp.sound_velocities(medium.at_force(fine)), name),
                label=label,
                **style,
            )
            below.plot(force, 100.0 * error[label][row], **style)
        values = getattr(truth, name)
        errors = getattr(truth, f"{name}_error")
        points = {
            "fmt": "o",
            "color": "black",
            "mfc": "white",
            "markersize": 3.5,
            "elinewidth": 0.7,
            "zorder": 3,
        }
        above.errorbar(force, values, errors, label="simulation", **points)
        below.errorbar(force, 0.0 * force, 100.0 * errors / values, **points)
        above.set_title(name)
        below.set(xlabel="Contact force (N)", ylim=(-25.0, 65.0))
    axes[0, 0].set(ylabel="Sound velocity (m/s)", xticks=[1, 10], xticklabels=["1", "10"])
    axes[0, 0].set_yticks([200, 500, 1000], ["200", "500", "1000"])
    axes[0, 0].tick_params(axis="y", which="minor", labelleft=False)
    axes[0, 0].legend(loc="lower right")
    axes[1, 0].set_ylabel("Medium over\nsimulation − 1 (%)")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
