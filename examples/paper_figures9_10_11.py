"""Figures 9 to 11 of the paper: how unevenly the contacts share the load, and how many of them do.

B. Velicky and C. Caroli, Phys. Rev. E 65, 021307 (2002). Above, the relative fluctuation of the contact force (Figure 9)
and the fraction of active contacts (Figure 10) against the reduced spacing, with thick lines from f* = 0.08, the limit of
validity of the effective medium, and thin ones below it; below, both with the stiffness over that of the ideal lattice,
against the force, with friction (Figure 11). Points, where the paper has Roux's and in the other two figures as well, are
four samples of 64 x 64 balls of our own simulation, with standard errors. Its statics have no friction.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import granphon as gp
from granphon.plot import STYLE

SCENE = Path(__file__).with_name("paper_ladder.yaml")
#: a* of the simulation
SPACING = np.array([0.373, 0.4, 0.45, 0.5, 0.55, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 1.9, 3.0, 6.0, 12.0])
POINTS = {"linestyle": "", "mfc": "white", "markersize": 3.2, "mew": 0.7, "elinewidth": 0.7, "zorder": 3}
LINES = (
    ("afa", True, "averaged force", "#009E73"),
    ("ema", False, "effective medium, no friction", "#D55E00"),
    ("ema", True, "effective medium, friction", "#0072B2"),
)


def check(simulation: gp.DirectSimulation, simulated: gp.SimulatedState) -> None:
    """The simulation against both effective media, at the same spacing."""
    packing = simulation.packing
    smooth, rough = (
        gp.EffectiveMedium(gp.Packing(packing.material, packing.diameter, packing.spread, friction=friction)).at_overlap(
            simulated.overlap
        )
        for friction in (False, True)
    )
    # at high load the frictionless medium fluctuates as the array does; friction in the statics adds 15 %
    high = SPACING >= 1.5
    assert np.all(np.abs(smooth.force_fluctuation / simulated.force_fluctuation - 1.0)[high] < 0.015)
    assert np.all(np.abs(rough.force_fluctuation / simulated.force_fluctuation - 1.15)[high] < 0.015)
    # with open contacts both fluctuate more than the array, which spreads the load beyond a ball and its neighbours
    assert np.all((smooth.force_fluctuation > simulated.force_fluctuation)[SPACING < 1.2])
    # "systematically underestimates": N_c of the medium is too small, though not near saturation
    assert np.all((smooth.contact_fraction < simulated.contact_fraction)[SPACING <= 0.7])
    assert np.all((smooth.contact_fraction > simulated.contact_fraction)[(SPACING >= 0.8) & (SPACING <= 1.0)])
    # 87 % of the contacts carry load at f* = 0.08: "the validity of the mean field extends down to 85 %" is the simulation's
    at_limit = simulation.at_force(0.08 * packing.law.coefficient * packing.width**1.5)
    assert abs(at_limit.contact_fraction - 0.873) < 0.003
    assert np.max(simulated.standard_error("force_fluctuation") / simulated.force_fluctuation) < 0.02
    assert np.max(simulated.standard_error(lambda sample: sample.contact_fraction())) < 0.01


def main(out: Path | None = None) -> Figure:
    """Compute, check, draw; write the figure to ``out`` if it is given."""
    scene = gp.Scene.from_yaml(SCENE)
    sweep, packing = scene.sweep(), scene.packing
    simulation = gp.DirectSimulation(packing, shape=(64, 64), samples=4)
    simulated = simulation.at_overlap(packing.width * (SPACING - 0.5))
    check(simulation, simulated)
    medium = sweep.sel(medium="ema", friction=True)
    force = medium.reduced_force.values
    # near 0.6 at the limit of validity, and no contact is open above f* = 0.3
    at_limit = float(np.interp(0.08, force, medium.force_fluctuation))
    assert round(at_limit, 1) == 0.6
    saturated = float(force[medium.contact_fraction.values > 1.0 - 1e-9].min())
    assert 0.25 < saturated < 0.35
    # the averaged force overstates the fluctuations, and balls without friction give way most
    fluctuation = [sweep.force_fluctuation.sel(medium=m, friction=f).values for m, f, _, _ in LINES]
    assert np.all(fluctuation[0] > fluctuation[2])
    assert np.all((fluctuation[2] > fluctuation[1])[force > 1e-2])
    # no change of regime where the contacts saturate: the stiffness is still 4 % below that of the ideal lattice
    assert round(float(np.interp(saturated, force, medium.stiffness_ratio)), 2) == 0.96

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4, 7.2), dpi=300, layout="constrained")
        figure9, figure10, figure11 = figure.subplots(3, 1)
        for name, friction, label, colour in LINES:
            one = sweep.sel(medium=name, friction=friction)
            valid = one.reduced_force.values >= 0.08
            for ax, values in ((figure9, one.force_fluctuation), (figure10, one.contact_fraction)):
                ax.plot(one.reduced_spacing, values, color=colour, linewidth=0.6)
                ax.plot(one.reduced_spacing[valid], values[valid], color=colour, linewidth=1.5, label=label)
        for ax, values, of in (
            (figure9, simulated.force_fluctuation, lambda sample: sample.force_fluctuation),
            (figure10, simulated.contact_fraction, lambda sample: sample.contact_fraction()),
        ):
            error = simulated.standard_error(of)
            ax.errorbar(SPACING, values, error, color="black", marker="o", label="simulation", **POINTS)
        figure9.set(xlabel="$a^*$", ylabel=r"$\Delta f^*/f^*$", xlim=(0.3, 2.0), ylim=(0.0, 1.6))
        figure9.legend(loc="upper right")
        figure10.set(xlabel="$a^*$", ylabel=r"$N_c$", xlim=(0.3, 2.0), ylim=(0.0, 1.05))
        curves = (
            ("stiffness_ratio", r"$\tilde k/k_\mathrm{ala}$", "#0072B2", "-", "o"),
            ("contact_fraction", r"$N_c$", "#D55E00", "--", "s"),
            ("force_fluctuation", r"$\Delta f^*/f^*$", "#009E73", ":", "^"),
        )
        for name, label, colour, dashes, marker in curves:
            figure11.semilogx(force, medium[name], color=colour, linestyle=dashes, label=label)
            figure11.errorbar(simulated.reduced_force, getattr(simulated, name), color=colour, marker=marker, **POINTS)
        figure11.axvline(0.08, color="0.6", linewidth=0.6)
        figure11.text(0.09, 1.12, "valid from here", color="0.3")
        figure11.set(xlabel="$f^*$", ylabel="Ratio or fraction", xlim=(1e-2, 50.0), ylim=(0.0, 1.2))
        figure11.legend(loc="center right")
        for ax, number in ((figure9, 9), (figure10, 10), (figure11, 11)):
            ax.set_title(f"Figure {number}", loc="left")
    if out is not None:
        figure.savefig(out)
    return figure


if __name__ == "__main__":
    main(Path("paper_figures9_10_11.png"))
