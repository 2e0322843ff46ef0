"""Figures 6 to 8 of the paper: the equation of state and the stiffness of the frictionless array, in its own units.

B. Velicky and C. Caroli, Phys. Rev. E 65, 021307 (2002). Forces are in units of (2/3) E* d^(1/2) W^(3/2), lengths in W: the
curves are then the same for all materials, sizes and widths. Above, the force on logarithmic scales from the rigidity
threshold a* = 0.343 (Figure 6) and to the power 2/3, in which the ideal lattice is straight (Figure 7); below, the root of
the stiffness (Figure 8). The simulated points of Roux are not published as numbers, and left out. Thin
lines: the effective medium with the printed alpha and beta, which the paper drew.
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
    ("ala", "averaged lattice", {"color": "0.3", "linewidth": 0.8}),
    ("afa", "averaged force", {"color": "#009E73", "linewidth": 1.2, "linestyle": (0, (1, 1))}),
    ("ema", "effective medium", {"color": "#D55E00", "linewidth": 1.5}),
    ("ema(local_field=paper)", "the same, printed local field", {"color": "black", "linewidth": 0.6, "linestyle": "--"}),
)


def main(out: Path | None = None) -> Figure:
    """Compute, check, draw; write the figure to ``out`` if it is given."""
    sweep = gp.Scene.from_yaml(SCENE).sweep().sel(friction=False)
    packing = gp.Scene.from_yaml(SCENE).packing
    unit = packing.law.coefficient * packing.width**0.5  # of k*
    force = sweep.reduced_force
    # the averaged lattice and the averaged force frame the effective medium: at a given force it is closer packed than the
    # one and less than the other
    spacing = {medium: sweep.reduced_spacing.sel(medium=medium).values for medium, _, _ in LINES}
    low = force.sel(medium="ema").values < 10.0
    assert np.all((spacing["ala"] > spacing["ema"])[low])
    assert np.all((spacing["ema"] > spacing["afa"])[low])
    # at high pressure all merge: f* = (a* - 1/2)^(3/2) (1 + r/(64 (a* - 1/2)^2)), with r of 0, Xi/(1 + Xi), 1
    x = spacing["ema"][-1] - 0.5
    xi = gp.EffectiveMedium(gp.Packing(packing.material, packing.diameter, packing.spread, friction=False)).local_field.xi
    assert np.isclose(force.sel(medium="ema").values[-1] / x**1.5 - 1.0, xi / (1.0 + xi) / (64.0 * x**2), rtol=1e-2)

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4, 7.2), dpi=300, layout="constrained")
        figure6, figure7, figure8 = figure.subplots(3, 1)
        for medium, label, style in LINES:
            one = sweep.sel(medium=medium)
            above = one.reduced_spacing.values - THRESHOLD
            figure6.loglog(above[above > 0.0], one.reduced_force[above > 0.0], **style)
            figure7.plot(one.reduced_spacing, one.reduced_force ** (2.0 / 3.0), label=label, **style)
            figure8.loglog(one.reduced_force, np.sqrt(one.normal_stiffness / unit), **style)
        figure6.set(xlabel=r"$a^*-0.343$", ylabel="$f^*$", xlim=(0.03, 10.0), ylim=(1e-3, 30.0))
        figure7.set(xlabel="$a^*$", ylabel="$(f^*)^{2/3}$", xlim=(0.0, 2.0), ylim=(0.0, 1.5))
        figure7.legend(loc="upper left")
        figure8.set(xlabel="$f^*$", ylabel=r"$\sqrt{k^*}$", xlim=(1e-3, 30.0), ylim=(0.2, 2.5))
        figure8.set_yticks([0.2, 0.5, 1.0, 2.0], ["0.2", "0.5", "1", "2"])
        figure8.tick_params(axis="y", which="minor", labelleft=False)
        for ax, number in ((figure6, 6), (figure7, 7), (figure8, 8)):
            ax.set_title(f"Figure {number}", loc="left")
    if out is not None:
        figure.savefig(out)
    return figure


if __name__ == "__main__":
    main(Path("paper_figures6_7_8.png"))
