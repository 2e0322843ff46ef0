r"""Figures 6 to 8 of the paper: equation of state
==============================================

The force and the stiffness of the disordered array in its own units, as in B. Velický and C.
Caroli, Phys. Rev. E 65, 021307 (2002), with points of our own simulation.

Forces are in units of :math:`\frac23E^*d^{1/2}W^{3/2}`, lengths in the width W: the curves are then
the same for all materials, sizes and widths. Figure 6 has the force over the distance from the
rigidity threshold :math:`a^*=0.343` on logarithmic scales, Figure 7 the force to the power 2/3,
which is a straight line for the ideal lattice, and Figure 8 the root of the stiffness. Points are
four arrays of 64 x 64 balls, with standard errors, in place of Roux's simulations in the paper.
Like Roux's they come to rest without friction, as in the medium that the paper compares with them.
With friction the medium resists local rearrangement more, and is nearer to the averaged force. Thin
lines are the effective medium with the printed :math:`\alpha` and :math:`\beta`, which the paper
drew.
"""

import sys
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import STYLE

THRESHOLD = 0.343  # of a*
ABOVE = np.array([0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.45, 0.65, 1.0, 1.65, 3.0, 9.0])
scene = gp.Scene.from_yaml(Path(sys.argv[0]).with_name("paper_ladder.yaml"))
sweep = scene.sweep()
packing = scene.packing
simulated = gp.DirectSimulation(packing, (64, 64), samples=4, geometry="lattice").at_overlap(
    packing.width * (THRESHOLD + ABOVE - 0.5)
)
smooth, rough = (
    gp.EffectiveMedium(
        gp.Packing(packing.material, packing.diameter, packing.spread, friction=friction)
    )
    for friction in (False, True)
)

# %% We divide the force of both media by that of the simulation, at the same spacing. At high load
# all agree, first the frictionless medium, which is exact there to second order in :math:`1/a^*`.
# From 0.3 above the threshold ("appears to agree") the force of both media is right to 3 %; at 0.1
# above it is 1.5 times too large.

force, rough_force = (
    simulated.force / medium.at_overlap(simulated.overlap).force - 1.0 for medium in (smooth, rough)
)
assert np.all(np.abs(force[ABOVE >= 1.0]) < 5e-4)
assert 1e-3 < abs(rough_force[10]) < 3e-3
assert abs(rough_force[-1]) < 1e-4
assert np.all(np.abs([force[ABOVE >= 0.3], rough_force[ABOVE >= 0.3]]) < 0.03)
assert np.allclose([force[4], rough_force[4]], [-0.32, -0.40], atol=0.03)

# %%
# At a given force that few contacts carry, the array is stiffer than either medium predicts: by
# half at :math:`f^*=0.011`.

stiffness = [
    simulated.normal_stiffness / medium.at_force(simulated.force).normal_stiffness
    for medium in (smooth, rough)
]
assert np.allclose([each[4] for each in stiffness], [1.51, 1.57], atol=0.05)
assert np.all(np.abs(np.array(stiffness)[:, ABOVE >= 0.4] - 1.0) < 0.02)

# %% Near the threshold :math:`f^{*2/3}` is again nearly a straight line, as for Hertz's law. A
# parabola through it vanishes at 0.343.

first = simulated.over_samples(lambda sample: sample.equilibrium.force)[:4] ** (2.0 / 3.0)
zero = np.array([np.max(np.roots(np.polyfit(ABOVE[:4], curve, 2))) for curve in first.T])
error = np.std(zero, ddof=1) / np.sqrt(zero.size)
print(f"threshold: a* = {THRESHOLD + np.mean(zero):.4f} ± {error:.4f}")
assert error < 1.5e-3
assert abs(np.mean(zero)) < 3.0 * error

# %%
# The effective medium is between the averaged lattice and the averaged force. At high pressure all
# agree, with :math:`x=a^*-\frac12` as :math:`f^*=x^{3/2}(1+r/64x^2)`, where r is 0, 1, and
# :math:`\Xi/(1+\Xi)` for the effective medium.

spacing = {
    medium: sweep.reduced_spacing.sel(friction=False, medium=medium).values
    for medium in ("ala", "ema", "afa")
}
reduced = sweep.reduced_force.sel(friction=False, medium="ema").values
assert np.all(
    np.diff([spacing[medium][reduced < 10.0] for medium in ("afa", "ema", "ala")], axis=0) > 0.0
)
x = spacing["ema"][-1] - 0.5
xi = smooth.local_field.xi
assert np.isclose(reduced[-1] / x**1.5 - 1.0, xi / (1.0 + xi) / (64.0 * x**2), rtol=1e-2)

LINES = (
    ("ala", False, "averaged lattice", {"color": "0.3", "linewidth": 0.8}),
    (
        "afa",
        False,
        "averaged force",
        {"color": "#009E73", "linewidth": 1.2, "linestyle": (0, (1, 1))},
    ),
    (
        "ema",
        True,
        "effective medium, friction",
        {"color": "#0072B2", "linewidth": 1.0, "linestyle": (0, (4, 1.5))},
    ),
    ("ema", False, "effective medium", {"color": "#D55E00", "linewidth": 1.5}),
    (
        "ema(local_field=paper)",
        False,
        "printed local field",
        {"color": "black", "linewidth": 0.6, "linestyle": "--"},
    ),
)
POINTS = {
    "fmt": "o",
    "color": "black",
    "mfc": "white",
    "markersize": 3.2,
    "mew": 0.7,
    "elinewidth": 0.7,
    "zorder": 3,
}
unit = packing.law.coefficient * packing.width**0.5  # of k*
with matplotlib.rc_context(STYLE):
    figure, (figure6, figure7, figure8) = plt.subplots(
        1, 3, figsize=(7.0, 3.0), dpi=300, layout="constrained"
    )
    for medium, friction, label, style in LINES:
        curve = sweep.sel(medium=medium, friction=friction)
        above = curve.reduced_spacing.values - THRESHOLD
        figure6.loglog(above[above > 0.0], curve.reduced_force[above > 0.0], label=label, **style)
        figure7.plot(curve.reduced_spacing, curve.reduced_force ** (2.0 / 3.0), **style)
        figure8.loglog(curve.reduced_force, np.sqrt(curve.normal_stiffness / unit), **style)
    f = simulated.reduced_force
    root_k = np.sqrt(simulated.normal_stiffness / unit)
    error = simulated.standard_error("force") / simulated.force
    error_k = 0.5 * simulated.standard_error("normal_stiffness") / simulated.normal_stiffness
    straight = f ** (2.0 / 3.0)
    figure6.errorbar(ABOVE, f, f * error, **POINTS, label="simulation")
    figure7.errorbar(THRESHOLD + ABOVE, straight, straight * error / 1.5, **POINTS)
    figure8.errorbar(f, root_k, root_k * error_k, f * error, **POINTS)
    figure6.set(
        xlabel=r"$a^*-0.343$",
        ylabel="$f^*$",
        xlim=(0.025, 11.0),
        ylim=(1e-3, 40.0),
        title="Figure 6",
    )
    figure7.set(
        xlabel="$a^*$", ylabel="$(f^*)^{2/3}$", xlim=(0.0, 2.1), ylim=(0.0, 1.6), title="Figure 7"
    )
    figure8.set(
        xlabel="$f^*$", ylabel=r"$\sqrt{k^*}$", xlim=(1e-3, 40.0), ylim=(0.2, 2.7), title="Figure 8"
    )
    figure8.set_yticks([0.2, 0.5, 1.0, 2.0], ["0.2", "0.5", "1", "2"])
    figure8.tick_params(axis="y", which="minor", labelleft=False)
    figure.legend(loc="outside lower center", ncols=3)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
