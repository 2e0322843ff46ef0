r"""Figure 5 of the paper: stiffness against force
==============================================

The square root of the effective normal stiffness of steel balls whose diameters differ by 2.04
microns, as in B. Velický and C. Caroli, Phys. Rev. E 65, 021307 (2002): effective medium with
friction and without, and the ideal lattice. The measured points of Gilles and Coste are left out,
as they are not published as numbers. Friction hardly changes the normal stiffness; it changes the
velocities through the shear stiffness.
"""

import sys
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import STYLE

scene = gp.Scene.from_yaml(Path(sys.argv[0]).with_name("paper_ladder.yaml"))
packing = scene.packing

# %% We check the numbers that Section IV quotes for this array: the unit of :math:`f^*`, the
# velocity, and the effect of friction. Without friction :math:`v_L` is 11.6 % lower (the paper's
# "11 %" is relative to the value with friction); with friction :math:`v_T` is 35.6 % higher (its
# "35 %" is relative to the value without).

unit = packing.law.coefficient * packing.width**1.5
frictionless = gp.Packing(packing.material, packing.diameter, friction=False)
v, smooth = (
    gp.sound_velocities(gp.AveragedLattice(each).at_force(18.446))
    for each in (packing, frictionless)
)
print(f"unit of force {unit:.2f} N, v_L = {v.longitudinal:.0f} m/s")
assert abs(unit - 19.89) < 0.02
assert round(v.longitudinal) == 791
eta = packing.mindlin_ratio
# equation 49
assert np.isclose((v.longitudinal / v.transverse) ** 2, (3.0 + eta) / (1.0 + eta), rtol=1e-14)
assert round(100.0 * (1.0 - smooth.longitudinal / v.longitudinal), 1) == 11.6
assert round(100.0 * (v.transverse / smooth.transverse - 1.0), 1) == 35.6

# %% Friction changes the stiffness by no more than 2.1 % where the medium is valid, and by no more
# than 0.3 % above 10 N.

sweep = scene.sweep().isel(load=slice(60, None))
stiffness = sweep.normal_stiffness.sel(medium="ema")
valid = sweep.valid.sel(medium="ema")
change = np.abs(stiffness.sel(friction=False) / stiffness.sel(friction=True) - 1.0).values
assert round(100.0 * change[valid.all("friction").values].max(), 1) == 2.1
assert round(100.0 * change[sweep.force.values > 10.0].max(), 1) == 0.3

LINES = (
    ("ala", True, "ideal lattice", {"color": "0.3", "linewidth": 0.8}),
    (
        "ema",
        False,
        "effective medium, no friction",
        {"color": "#D55E00", "dashes": (3.5, 1.8), "linewidth": 1.2},
    ),
    ("ema", True, "effective medium, friction", {"color": "#0072B2", "linewidth": 1.6}),
)
with matplotlib.rc_context(STYLE):
    figure, ax = plt.subplots(figsize=(3.4, 2.9), dpi=300, layout="constrained")
    for medium, friction, label, style in LINES:
        # the ideal line too: in the range of the paper's figure
        inside = valid.sel(friction=friction)
        values = sweep.normal_stiffness.sel(medium=medium, friction=friction)[inside]
        ax.loglog(sweep.force[inside], np.sqrt(values) / 1e3, label=label, **style)
    ax.set(xlabel="Contact force $f$ (N)", ylabel=r"$\sqrt{\tilde k}$ (10$^3$ (N/m)$^{1/2}$)")
    ax.set(xlim=(1.5, 30), ylim=(1.9, 4.3))
    ax.set_xticks([2, 5, 10, 20], ["2", "5", "10", "20"])
    ax.set_yticks([2, 3, 4], ["2", "3", "4"])
    ax.minorticks_off()
    ax.legend(loc="lower right")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
