r"""Figures 9 to 11 of the paper: who carries the load
==================================================

How unevenly the contacts share the load, and how many of them do, as in B. Velický and C. Caroli,
Phys. Rev. E 65, 021307
(2002), with points of our own simulation.

Figures 9 and 10 have the relative fluctuation of the contact force and the fraction of active
contacts over the reduced spacing. Lines are thick from :math:`f^*=0.08` on, the limit of validity
of the effective medium, and thin below it. Figure 11 has both over the force, with friction, and
also the stiffness over that of the ideal lattice. Points are four arrays of 64 x 64 balls, with
standard errors, in place of Roux's simulations in the paper, and in Figure 11 as well. They come to
rest without friction.
"""

import sys
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import STYLE

# a*
SPACING = np.array(
    [0.373, 0.4, 0.45, 0.5, 0.55, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 1.9, 3.0, 6.0, 12.0]
)
scene = gp.Scene.from_yaml(Path(sys.argv[0]).with_name("paper_ladder.yaml"))
sweep = scene.sweep()
packing = scene.packing
simulation = gp.DirectSimulation(packing, (64, 64), samples=4, geometry="lattice")
simulated = simulation.at_overlap(packing.width * (SPACING - 0.5))
smooth, rough = (
    gp.EffectiveMedium(
        gp.Packing(packing.material, packing.diameter, packing.spread, friction=friction)
    ).at_overlap(simulated.overlap)
    for friction in (False, True)
)

# %% At high load the fluctuation in the frictionless medium is that of the array; with friction in
# the statics it is 15 % larger. Where contacts are open, the fluctuation in both media is larger
# than in the array, which spreads the load beyond a ball and its neighbours.

high = SPACING >= 1.5
fluctuation = simulated.force_fluctuation
assert np.all(np.abs(smooth.force_fluctuation / fluctuation - 1.0)[high] < 0.015)
assert np.all(np.abs(rough.force_fluctuation / fluctuation - 1.15)[high] < 0.015)
assert np.all((smooth.force_fluctuation > fluctuation)[SPACING < 1.2])

# %% The paper says that the medium "systematically underestimates" :math:`N_c`. It does, except
# near saturation. In the simulation 87 % of the contacts carry load at :math:`f^*=0.08`; this is
# what the paper's "the validity of the mean field extends down to 85 %" refers to.

contacts = simulated.contact_fraction
assert np.all((smooth.contact_fraction < contacts)[SPACING <= 0.7])
assert np.all((smooth.contact_fraction > contacts)[(SPACING >= 0.8) & (SPACING <= 1.0)])
at_limit = simulation.at_force(0.08 * packing.law.coefficient * packing.width**1.5)
print(f"contacts that carry load at f* = 0.08: {at_limit.contact_fraction:.3f}")
assert abs(at_limit.contact_fraction - 0.873) < 0.003

# %%
# In the medium with friction the fluctuation is near 0.6 at the limit of validity, and no contact
# is open above :math:`f^*=0.3`. There is no change of regime there: the stiffness is still 4 %
# below that of the ideal lattice. The averaged force gives too large fluctuations, and balls
# without friction give way most.

LINES = (
    ("afa", True, "averaged force", "#009E73"),
    ("ema", False, "effective medium, no friction", "#D55E00"),
    ("ema", True, "effective medium, friction", "#0072B2"),
)
medium = sweep.sel(medium="ema", friction=True)
force = medium.reduced_force.values
assert round(float(np.interp(0.08, force, medium.force_fluctuation)), 1) == 0.6
saturated = float(force[medium.contact_fraction.values > 1.0 - 1e-9].min())
assert 0.25 < saturated < 0.35
assert round(float(np.interp(saturated, force, medium.stiffness_ratio)), 2) == 0.96
most, least, middle = (
    sweep.force_fluctuation.sel(medium=m, friction=f).values for m, f, _, _ in LINES
)
assert np.all(most > middle)
assert np.all((middle > least)[force > 1e-2])

CURVES = (
    ("stiffness_ratio", r"$\tilde k/k_\mathrm{ala}$", "#0072B2", "-", "o"),
    ("contact_fraction", r"$N_c$", "#D55E00", "--", "s"),
    ("force_fluctuation", r"$\Delta f^*/f^*$", "#009E73", ":", "^"),
)
POINTS = {
    "linestyle": "",
    "mfc": "white",
    "markersize": 3.2,
    "mew": 0.7,
    "elinewidth": 0.7,
    "zorder": 3,
}
with matplotlib.rc_context(STYLE):
    figure, (figure9, figure10, figure11) = plt.subplots(
        1, 3, figsize=(7.0, 2.9), dpi=300, layout="constrained"
    )
    panels = (
        (figure9, "force_fluctuation", lambda sample: sample.force_fluctuation),
        (figure10, "contact_fraction", lambda sample: sample.contact_fraction()),
    )
    for ax, name, of in panels:
        for which, friction, label, colour in LINES:
            curve = sweep.sel(medium=which, friction=friction)
            valid = curve.isel(load=curve.reduced_force.values >= 0.08)
            ax.plot(curve.reduced_spacing, curve[name], color=colour, linewidth=0.6)
            ax.plot(valid.reduced_spacing, valid[name], color=colour, linewidth=1.5, label=label)
        error = simulated.standard_error(of)
        assert np.max(error / getattr(simulated, name)) < 0.02
        ax.errorbar(
            SPACING,
            getattr(simulated, name),
            error,
            color="black",
            marker="o",
            label="simulation",
            **POINTS,
        )
    for name, label, colour, dashes, marker in CURVES:
        figure11.semilogx(force, medium[name], color=colour, linestyle=dashes, label=label)
        figure11.errorbar(
            simulated.reduced_force, getattr(simulated, name), color=colour, marker=marker, **POINTS
        )
    figure9.set(
        xlabel="$a^*$",
        ylabel=r"$\Delta f^*/f^*$",
        xlim=(0.3, 2.0),
        ylim=(0.0, 1.6),
        title="Figure 9",
    )
    figure10.set(
        xlabel="$a^*$", ylabel=r"$N_c$", xlim=(0.3, 2.0), ylim=(0.0, 1.05), title="Figure 10"
    )
    figure11.axvline(0.08, color="0.6", linewidth=0.6)
    figure11.text(0.09, 1.12, "valid from here", color="0.3")
    figure11.set(
        xlabel="$f^*$",
        ylabel="Ratio or fraction",
        xlim=(1e-2, 50.0),
        ylim=(0.0, 1.2),
        title="Figure 11",
    )
    figure11.legend(loc="center right")
    figure.legend(*figure9.get_legend_handles_labels(), loc="outside lower center", ncols=4)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
