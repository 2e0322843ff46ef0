"""Figure 5 of the paper: root of the effective normal stiffness against the contact force, for steel balls.

B. Velicky and C. Caroli, Phys. Rev. E 65, 021307 (2002). Effective medium with friction and without, and the ideal lattice;
the measured points of Gilles and Coste are not published as numbers, and left out. Friction hardly changes the
stiffness: what it changes, the velocities, it changes through the shear stiffness. Checked here: the numbers that Section IV
quotes for this array.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import granphon as gp
from granphon.plot import STYLE

SCENE = Path(__file__).with_name("paper_ladder.yaml")


def check(scene: gp.Scene) -> None:
    """The numbers of Section IV."""
    packing = scene.packing
    # 19.89 N, the unit of f*: (2/3) E* d^(1/2) W^(3/2)
    unit = packing.law.coefficient * packing.width**1.5
    assert abs(unit - 19.89) < 0.02
    # 791 m/s at 18.446 N, on the ideal lattice
    pressed = gp.AveragedLattice(packing).at_force(18.446)
    v = gp.sound_velocities(pressed)
    assert round(v.longitudinal) == 791
    # v_L^2/v_T^2 = (3 + eta)/(1 + eta), at any load and width (equation 49)
    eta = packing.mindlin_ratio
    assert np.isclose((v.longitudinal / v.transverse) ** 2, (3.0 + eta) / (1.0 + eta), rtol=1e-14)
    # what friction adds: without it v_L is 11.6 % lower ("11 %", counted from the value with friction), and with it v_T is
    # 35.6 % higher ("35 %", counted from the value without)
    frictionless = gp.Packing(packing.material, packing.diameter, friction=False)
    smooth = gp.sound_velocities(gp.AveragedLattice(frictionless).at_force(18.446))
    assert round(100.0 * (1.0 - smooth.longitudinal / v.longitudinal), 1) == 11.6
    assert round(100.0 * (v.transverse / smooth.transverse - 1.0), 1) == 35.6


def main(out: Path | None = None) -> Figure:
    """Compute, check, draw; write the figure to ``out`` if it is given."""
    scene = gp.Scene.from_yaml(SCENE)
    check(scene)
    sweep = scene.sweep().isel(load=slice(60, None))
    # friction changes the stiffness by no more than 2.1 % where the medium is valid, and by no more than 0.3 % above 10 N
    rough, smooth = (sweep.normal_stiffness.sel(medium="ema", friction=friction).values for friction in (True, False))
    valid, change = sweep.valid.sel(medium="ema").all("friction").values, np.abs(smooth / rough - 1.0)
    assert round(100.0 * change[valid].max(), 1) == 2.1
    assert round(100.0 * change[sweep.force.values > 10.0].max(), 1) == 0.3

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4, 2.9), dpi=300, layout="constrained")
        ax = figure.subplots()
        lines = (
            ("ala", True, "ideal lattice", {"color": "0.3", "linewidth": 0.8}),
            ("ema", False, "effective medium, no friction", {"color": "#D55E00", "dashes": (3.5, 1.8), "linewidth": 1.2}),
            ("ema", True, "effective medium, friction", {"color": "#0072B2", "linewidth": 1.6}),
        )
        for medium, friction, label, style in lines:
            stiffness = sweep.normal_stiffness.sel(medium=medium, friction=friction)
            inside = sweep.valid.sel(medium="ema", friction=friction)  # the ideal line too: where the figure of the paper is
            ax.loglog(sweep.force[inside], np.sqrt(stiffness[inside]) / 1e3, label=label, **style)
        ax.set(xlabel="Contact force $f$ (N)", ylabel=r"$\sqrt{\tilde k}$ (10$^3$ (N/m)$^{1/2}$)")
        ax.set(xlim=(1.5, 30), ylim=(1.9, 4.3))
        ax.set_xticks([2, 5, 10, 20], ["2", "5", "10", "20"])
        ax.set_yticks([2, 3, 4], ["2", "3", "4"])
        ax.minorticks_off()
        ax.legend(loc="lower right")
    if out is not None:
        figure.savefig(out)
    return figure


if __name__ == "__main__":
    main(Path("paper_figure5.png"))
