r"""fcc pressed along one axis
==========================

If an fcc crystal is strained along [001] alone, as between two plates in a stiff box, eight of the
twelve contacts of a ball carry the load; the four within the layers across that axis only touch,
and have no stiffness. So the sound velocities are no longer those of a cube: the figure shows them
for all directions in the plane of [100] and [001], against those of the same crystal under
hydrostatic pressure. Both states have the same force in the contacts that carry.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import COLOURS, STYLE

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ball = gp.Ball(steel, 8e-3)
fcc = gp.Crystal.on("fcc", [ball])
pressed = fcc.at_strain([0.0, 0.0, -5e-4, 0.0, 0.0, 0.0])
even = fcc.at_force(pressed.normal_force.max())
angle = np.linspace(0.0, 2.0 * np.pi, 361)
direction = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
uniaxial, hydrostatic = (
    gp.sound_velocities(state, direction).velocities for state in (pressed, even)
)

# %% Closed forms along [001], in units of :math:`d^2/m`: a longitudinal wave with
# :math:`v^2=k+\kappa`, and two transverse ones with :math:`k/2+\kappa/6`. The sixth is the work of
# the rotations: under unequal contacts balls turn in a shear.

k = pressed.normal_stiffness.max()
kappa = pressed.shear_stiffness.max()
unit = ball.diameter**2 / ball.mass
assert np.allclose(
    uniaxial[90] ** 2 / unit, [k / 2 + kappa / 6, k / 2 + kappa / 6, k + kappa], rtol=1e-12
)

with matplotlib.rc_context(STYLE):
    figure, axes = plt.subplots(
        1, 2, figsize=(7.0, 3.6), dpi=300, layout="constrained", subplot_kw={"projection": "polar"}
    )
    names = ("slow transverse", "fast transverse", "longitudinal")
    for ax, velocities, title in zip(
        axes, (hydrostatic, uniaxial), ("Hydrostatic", "Strained along [001]"), strict=True
    ):
        for branch, name in enumerate(names):
            ax.plot(angle, velocities[:, branch], color=COLOURS[branch], linewidth=1.5, label=name)
        ax.set_title(title)
        ax.set_xticks([0.0, np.pi / 2.0, np.pi, 1.5 * np.pi], ["[100]", "[001]", "", ""])
        ax.set(rlim=(0.0, 1.05 * max(hydrostatic.max(), uniaxial.max())), rlabel_position=200)
    figure.legend(
        *axes[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=3,
        title="Sound velocity (m/s)",
    )
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
