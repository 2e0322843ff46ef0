"""Figures 6 to 8 of the paper: the equation of state and the stiffness of the disordered array, in its own units.

B. Velicky and C. Caroli, Phys. Rev. E 65, 021307 (2002). Forces are in units of (2/3) E* d^(1/2) W^(3/2), lengths in W: the
curves are then the same for all materials, sizes and widths. Above, the force on logarithmic scales from the rigidity
threshold a* = 0.343 (Figure 6) and to the power 2/3, in which the ideal lattice is straight (Figure 7); below, the root of
the stiffness (Figure 8). Points, where the paper has Roux's, are four samples of 64 x 64 balls of our own simulation, with
standard errors. Its statics have no friction, as Roux's; nor has the medium that the paper compares with them. With
friction the medium is stiffer to local rearrangement, and nearer to the averaged force. Thin lines: the effective medium
with the printed alpha and beta, which the paper drew.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import granphon as gp
from granphon.plot import STYLE

SCENE = Path(__file__).with_name("paper_ladder.yaml")
#: below it the disordered array cannot sustain compression (Section IV)
THRESHOLD = 0.343
LINES = (
    ("ala", False, "averaged lattice", {"color": "0.3", "linewidth": 0.8}),
    ("afa", False, "averaged force", {"color": "#009E73", "linewidth": 1.2, "linestyle": (0, (1, 1))}),
    ("ema", True, "effective medium, friction", {"color": "#0072B2", "linewidth": 1.0, "linestyle": (0, (4, 1.5))}),
    ("ema", False, "effective medium", {"color": "#D55E00", "linewidth": 1.5}),
    (
        "ema(local_field=paper)",
        False,
        "the same, printed local field",
        {"color": "black", "linewidth": 0.6, "linestyle": "--"},
    ),
)
#: a* less the threshold, of the simulation
ABOVE = np.array([0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.45, 0.65, 1.0, 1.65, 3.0, 9.0])
POINTS = {"fmt": "o", "color": "black", "mfc": "white", "markersize": 3.2, "mew": 0.7, "elinewidth": 0.7, "zorder": 3}


def check(simulated: gp.SimulatedState, packing: gp.Packing) -> None:
    """The simulation against both effective media, at the same spacing and at the same force."""
    smooth, rough = (
        gp.EffectiveMedium(gp.Packing(packing.material, packing.diameter, packing.spread, friction=friction))
        for friction in (False, True)
    )
    # at high load all agree, and the frictionless medium, which is exact there to second order in 1/a*, first
    force = {medium: simulated.force / medium.at_overlap(simulated.overlap).force - 1.0 for medium in (smooth, rough)}
    assert np.all(np.abs(force[smooth][ABOVE >= 1.0]) < 5e-4)
    assert 1e-3 < abs(force[rough][10]) < 3e-3
    assert abs(force[rough][-1]) < 1e-4
    # from 0.3 above the threshold ("appears to agree") either medium has the force to 3 %; at 0.1 it has 1.5 times too much
    assert np.all(np.abs(np.array([force[smooth], force[rough]])[:, ABOVE >= 0.3]) < 0.03)
    assert np.allclose([force[smooth][4], force[rough][4]], [-0.32, -0.40], atol=0.03)
    # at a given force the array is stiffer than either medium says, where few contacts carry it: by half at f* = 0.011
    stiffness = [
        simulated.normal_stiffness / medium.at_force(simulated.force).normal_stiffness for medium in (smooth, rough)
    ]
    assert np.allclose([stiffness[0][4], stiffness[1][4]], [1.51, 1.57], atol=0.05)
    assert np.all(np.abs(np.array(stiffness)[:, ABOVE >= 0.4] - 1.0) < 0.02)
    # a quasi-Hertz regime at the threshold: f*^(2/3) is nearly straight, a parabola through it vanishes at 0.343
    first = simulated.over_samples(lambda sample: sample.equilibrium.force)[:4] ** (2.0 / 3.0)
    parabolas = np.polynomial.polynomial.polyfit(ABOVE[:4], first, 2).T
    zero = np.array([np.max(np.polynomial.polynomial.polyroots(one)) for one in parabolas])
    error = np.std(zero, ddof=1) / np.sqrt(zero.size)
    assert error < 1.5e-3
    assert abs(np.mean(zero)) < 3.0 * error


def main(out: Path | None = None) -> Figure:
    """Compute, check, draw; write the figure to ``out`` if it is given."""
    scene = gp.Scene.from_yaml(SCENE)
    sweep, packing = scene.sweep(), scene.packing
    unit = packing.law.coefficient * packing.width**0.5  # of k*
    simulation = gp.DirectSimulation(packing, shape=(64, 64), samples=4)
    simulated = simulation.at_overlap(packing.width * (THRESHOLD + ABOVE - 0.5))
    check(simulated, packing)
    # the averaged lattice and the averaged force frame the effective medium: at a given force it is closer packed than the
    # one and less than the other
    smooth = sweep.sel(friction=False)
    spacing = {medium: smooth.reduced_spacing.sel(medium=medium).values for medium in ("ala", "ema", "afa")}
    force = smooth.reduced_force.sel(medium="ema").values
    assert np.all((spacing["ala"] > spacing["ema"])[force < 10.0])
    assert np.all((spacing["ema"] > spacing["afa"])[force < 10.0])
    # at high pressure all merge: f* = (a* - 1/2)^(3/2) (1 + r/(64 (a* - 1/2)^2)), with r of 0, Xi/(1 + Xi), 1
    x = spacing["ema"][-1] - 0.5
    xi = gp.EffectiveMedium(gp.Packing(packing.material, packing.diameter, packing.spread, friction=False)).local_field.xi
    assert np.isclose(force[-1] / x**1.5 - 1.0, xi / (1.0 + xi) / (64.0 * x**2), rtol=1e-2)

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4, 7.6), dpi=300, layout="constrained")
        figure6, figure7, figure8 = figure.subplots(3, 1)
        for medium, friction, label, style in LINES:
            one = sweep.sel(medium=medium, friction=friction)
            above = one.reduced_spacing.values - THRESHOLD
            figure6.loglog(above[above > 0.0], one.reduced_force[above > 0.0], **style)
            figure7.plot(one.reduced_spacing, one.reduced_force ** (2.0 / 3.0), label=label, **style)
            figure8.loglog(one.reduced_force, np.sqrt(one.normal_stiffness / unit), **style)
        f, root_k = simulated.reduced_force, np.sqrt(simulated.normal_stiffness / unit)
        error = simulated.standard_error("force") / simulated.force
        error_k = 0.5 * simulated.standard_error("normal_stiffness") / simulated.normal_stiffness
        figure6.errorbar(ABOVE, f, f * error, **POINTS)
        straight = f ** (2.0 / 3.0)
        figure7.errorbar(THRESHOLD + ABOVE, straight, straight * error / 1.5, **POINTS, label="simulation")
        figure8.errorbar(f, root_k, root_k * error_k, f * error, **POINTS)
        figure6.set(xlabel=r"$a^*-0.343$", ylabel="$f^*$", xlim=(0.025, 11.0), ylim=(1e-3, 40.0))
        figure7.set(xlabel="$a^*$", ylabel="$(f^*)^{2/3}$", xlim=(0.0, 2.1), ylim=(0.0, 1.6))
        figure7.legend(loc="upper left")
        figure8.set(xlabel="$f^*$", ylabel=r"$\sqrt{k^*}$", xlim=(1e-3, 40.0), ylim=(0.2, 2.7))
        figure8.set_yticks([0.2, 0.5, 1.0, 2.0], ["0.2", "0.5", "1", "2"])
        figure8.tick_params(axis="y", which="minor", labelleft=False)
        for ax, number in ((figure6, 6), (figure7, 7), (figure8, 8)):
            ax.set_title(f"Figure {number}", loc="left")
    if out is not None:
        figure.savefig(out)
    return figure


if __name__ == "__main__":
    main(Path("paper_figures6_7_8.png"))
