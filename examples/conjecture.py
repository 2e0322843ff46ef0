"""Does friction stiffen a disordered array as it stiffens the ideal lattice? The conjecture kappa = eta k, put to the test.

B. Velicky and C. Caroli, Phys. Rev. E 65, 021307 (2002), equation 41, "not susceptible of direct verification", and its
consequence G/K = (1 + eta)/2 at any load (47). Here arrays of steel balls that differ by 2.04 um are simulated, with shear
springs eta k at every contact that carries load. The stiffnesses of an effective contact are those that the bulk and shear
modulus ask for by (17): k = 2K/sqrt(3) and kappa = 4G/sqrt(3) - k, per diameter.

The picture, against the force in the units of Section IV: above, kappa/k, and dashed the conjecture, with friction (eta) and
without (0). Below, the sound velocities of the simulation over those of the effective medium at the same force; the thin
line is the same medium with the frictionless law f(a) and the same eta, as the samples have it. Bars are standard errors.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import granphon as gp
from granphon.plot import STYLE

SCENE = Path(__file__).with_name("paper_ladder.yaml")
FORCE = np.array([0.008, 0.02, 0.04, 0.08, 0.15, 0.25, 0.4, 0.5, 0.6, 1.0, 3.0])  # f*
SHAPE, SAMPLES = (64, 64), 4
COLOURS = {True: "#0072B2", False: "#D55E00"}


class Study(NamedTuple):
    """Simulation and effective medium at the same forces; ``ratio`` (loads, samples) is 2G/K over 1 + eta."""

    eta: float
    state: gp.SimulatedState
    medium: gp.ContactState
    ratio: np.ndarray

    def holds(self, part: float) -> tuple[float, float]:
        """f* above which the conjecture holds to this part, and its standard error."""
        found = [np.exp(np.interp(-np.log(part), -np.log(1.0 - one), np.log(FORCE))) for one in self.ratio.T]
        return float(np.mean(found)), float(np.std(found, ddof=1) / np.sqrt(SAMPLES))


def ratio_of_moduli(sample: gp.Sample) -> float:
    """G/K, with G the mean of the two orientations of shear."""
    c = sample.elasticity.tensor
    bulk, shears = np.sum(c[:2, :2]) / 4.0, [(c[0, 0] + c[1, 1] - 2.0 * c[0, 1]) / 4.0, c[2, 2]]
    return float(np.mean(shears) / bulk)


def study(friction: bool) -> Study:
    """Arrays with the diameters of seeds 0 to 3 under all loads."""
    packing = gp.Scene.from_yaml(SCENE).packing
    packing = gp.Packing(packing.material, packing.diameter, packing.spread, friction=friction)
    force = FORCE * packing.law.coefficient * packing.width**1.5
    state, eta = gp.DirectSimulation(packing, SHAPE, samples=SAMPLES).at_force(force), packing.mindlin_ratio
    ratio = state.over_samples(ratio_of_moduli) / (0.5 * (1.0 + eta))
    return Study(eta, state, gp.EffectiveMedium(packing).at_force(force), ratio)


def check(rough: Study, smooth: Study) -> None:
    """Where the conjecture holds, and what it does to the velocities."""
    for one, limits in ((rough, {0.01: 0.38, 0.05: 0.15}), (smooth, {0.01: 0.525, 0.05: 0.25})):
        # it is the limit of high load, and fails gradually: G is too small, and the more so the less the load
        assert np.all(np.diff(np.mean(one.ratio, axis=1)) > 0.0)
        assert np.all(one.ratio < 1.0)
        for part, force in limits.items():
            found, error = one.holds(part)
            assert abs(found - force) < 0.01
            assert error < 0.01
    # at f* = 0.08, the limit of validity of the effective medium, kappa is 23 % less than eta k; at f* = 0.008 none is left
    kappa = np.mean(rough.ratio, axis=1) * (1.0 + rough.eta) - 1.0
    assert np.allclose(kappa[[0, 3]] / rough.eta, [0.0, 0.77], atol=0.02)
    # friction stiffens the array against compression too, where contacts are open: at f* = 0.08 by 4 to 5 %
    stiffer = gp.moduli(rough.state).bulk / gp.moduli(smooth.state).bulk - 1.0
    assert 0.04 < stiffer[3] < 0.05
    assert stiffer[-1] < 1e-5
    # that, and at low load a k above the medium's, makes up for the lack of kappa: the medium's v_T is right at all loads.
    # Its v_L is right down to f* = 0.15, and then too low
    (longitudinal, transverse), _ = velocities(rough)
    assert np.all(np.abs(transverse - 1.0) < 0.015)
    assert np.all(np.abs(longitudinal[FORCE > 0.1] - 1.0) < 0.01)
    assert np.allclose(longitudinal[[1, 3]], [1.12, 1.03], atol=0.01)
    # without friction nothing makes up for it
    _, transverse = velocities(smooth)[0]
    assert round(float(transverse[3]), 2) == 0.88


def velocities(one: Study) -> tuple[np.ndarray, np.ndarray]:
    """(2, loads) v_L and v_T over those of the effective medium, and their standard errors."""
    found, ideal = gp.sound_velocities(one.state), gp.sound_velocities(one.medium)
    scale = np.array([ideal.longitudinal, ideal.transverse])
    errors = np.array([found.longitudinal_error, found.transverse_error])
    return np.array([found.longitudinal, found.transverse]) / scale, errors / scale


def main(out: Path | None = None) -> Figure:
    """Compute, check, draw; write the figure to ``out`` if it is given."""
    both = {friction: study(friction) for friction in (True, False)}
    check(both[True], both[False])
    statics = np.sqrt(both[False].medium.normal_stiffness / both[True].medium.normal_stiffness)

    bars = {"linestyle": "", "markersize": 3.5, "elinewidth": 0.7, "capsize": 1.5}
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4, 5.6), dpi=300, layout="constrained")
        above, *below = figure.subplots(3, 1, sharex=True, height_ratios=[1.5, 1.0, 1.0])
        for (friction, one), ax, name in zip(both.items(), below, ("with friction", "without friction"), strict=True):
            colour, kappa = COLOURS[friction], one.ratio * (1.0 + one.eta) - 1.0
            error = np.std(kappa, axis=1, ddof=1) / np.sqrt(SAMPLES)
            above.errorbar(FORCE, np.mean(kappa, axis=1), error, marker="o", color=colour, label=name, **bars)
            above.axhline(one.eta, color=colour, linewidth=0.8, dashes=(3.5, 1.8))
            if friction:
                ax.plot(FORCE, statics, color=colour, linewidth=0.6, label="medium, frictionless $f(a)$")
            for values, errors, marker, label in zip(*velocities(one), "os", ("$v_L$", "$v_T$"), strict=True):
                fill = colour if marker == "o" else "white"
                ax.errorbar(FORCE, values, errors, marker=marker, color=colour, mfc=fill, label=label, **bars)
            ax.axhline(1.0, color="0.6", linewidth=0.6, zorder=0.5)
            ax.legend(loc="upper right" if friction else "lower right", title=name)
            ax.set_ylabel("Velocity over that of\nthe effective medium")
        above.text(0.0075, both[True].eta - 0.03, r"conjecture, $\tilde\kappa=\eta\tilde k$", va="top")
        above.set(xscale="log", xlim=(0.006, 4.0), ylabel=r"$\tilde\kappa/\tilde k$", ylim=(-0.85, 1.0))
        above.legend(loc="lower right")
        below[-1].set_xlabel("$f^*$")
    if out is not None:
        figure.savefig(out)
    return figure


if __name__ == "__main__":
    main(Path("conjecture.png"))
