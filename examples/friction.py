r"""What friction does to the bands
===============================

Without friction (left) the contacts resist compression only: balls slide on each other, nothing
makes them turn, and there are two branches. With friction (right) the same steel balls under the
same load have a third branch, the rotational one, which starts near 66 kHz, far above the others.

Friction makes both kinds of sound faster. The transverse one gains a third: it is
:math:`\sqrt{1+\eta}` times as fast, with Mindlin's ratio :math:`\eta`. Dashed lines are the limit
of long waves.
"""

import sys

from granphon.figures.scales import ROTATION

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.cm import ScalarMappable

import granphon as gp
from granphon.base.scales import HertzPrefix
from granphon.figures.bands import plot_bands
from granphon.figures.style import STYLE

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
smooth, rough = (
    gp.Phonons(
        gp.AveragedLattice(gp.Packing(steel, diameter=8e-3, friction=friction)).at_force(18.446)
    )
    for friction in (False, True)
)

# %%
# Equations 13 to 15 of the paper: :math:`v_L^2=\frac98(1+\eta/3)`, :math:`v_T^2=\frac38(1+\eta)`
# and :math:`\omega_R^2=30\eta`, in units of :math:`d`, :math:`k` and :math:`M`.

eta = steel.mindlin_ratio
(slow_l, slow_t), (fast_l, fast_t) = (
    one.lattice.sound_velocities((1, 0))[0] for one in (smooth, rough)
)
assert np.isclose(fast_l / slow_l, np.sqrt(1.0 + eta / 3.0), rtol=1e-12)
assert np.isclose(fast_t / slow_t, np.sqrt(1.0 + eta), rtol=1e-12)
print(
    f"eta = {eta:.3f}: v_L is {100.0 * (fast_l / slow_l - 1.0):.1f} %, v_T"
    f" {100.0 * (fast_t / slow_t - 1.0):.1f} % faster"
)

bands = [one.bands("GKMG") for one in (smooth, rough)]
top = bands[1].frequencies.max()
assert np.isclose(top, np.sqrt(30.0 * eta) * rough.scales.frequency, rtol=1e-12)

#: panel, branch, and where its name goes
NAMES = (
    (0, "L", 1.4, 22.0),
    (0, "T", 1.24, 9.5),
    (1, "R", 1.19, 57.0),
    (1, "L", 1.4, 28.0),
    (1, "T", 1.22, 17.0),
)

with matplotlib.rc_context(STYLE):
    figure, axes = plt.subplots(
        1, 2, figsize=(7.0, 3.6), dpi=300, layout="constrained", sharey=True
    )
    for ax, one, found, title in zip(
        axes, (smooth, rough), bands, ("without friction", "with friction"), strict=True
    ):
        plot_bands(found, ax, asymptotes=one.lattice, unit=HertzPrefix.for_top(top), colorbar=False)
        ax.set_title(title)
    for ax, name, q, kilohertz in NAMES:
        axes[ax].text(q, kilohertz, name)
    axes[1].set_ylabel("")
    figure.colorbar(
        ScalarMappable(cmap=ROTATION),
        ax=axes,
        label="Rotational part of the kinetic energy",
        ticks=[0, 0.5, 1],
    )
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
