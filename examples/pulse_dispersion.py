"""How much slower than long waves is a pulse? Phase and group velocity of sound in steel balls against frequency.

The picture: phase (full) and group velocity (dashed) of the longitudinal and the transverse branch along Gamma-K, up to the
first maximum of each branch. The vertical line marks 6.5 kHz, the ground frequency of the pulses of Gilles and Coste; at it
group velocities are already 1.5 % below those of long waves, which are the values at zero frequency.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import granphon as gp
from granphon.branches import acoustic_branches
from granphon.observables import contact_lattice
from granphon.plot import STYLE

PULSE = 6500.0  # Hz
ALONG = (1.0, 0.0)  # Gamma-K
COLOURS = {"longitudinal": "#0072B2", "transverse": "#D55E00"}


def main(out: Path | None = None) -> Figure:
    """Compute, check, draw; write the figure to ``out`` if it is given."""
    steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    state = gp.AveragedLattice(gp.Packing(steel, diameter=8e-3)).at_force(18.446)
    limit = gp.sound_velocities(state)

    pulse = gp.pulse_velocities(state, PULSE, ALONG)
    deficit = 1.0 - pulse.group / [limit.longitudinal, limit.transverse]
    assert 0.016 < deficit[0] < 0.017  # the longitudinal pulse: more than one percent
    # long waves bend down as 1 - c (qd)^2 in the phase and three times that in the group velocity
    assert np.allclose(deficit[0] / (1.0 - pulse.phase[0] / limit.longitudinal), 3.0, rtol=0.02)

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4, 2.7), dpi=300, layout="constrained")
        ax = figure.subplots()
        for name, branch in acoustic_branches(contact_lattice(state), ALONG).items():
            top = branch.top * state.scales.frequency
            # crowded at the top, where the group velocity falls steeply to zero
            hertz = top * np.sin(np.linspace(0.01, 0.5 * np.pi - 1e-4, 120))
            found = gp.pulse_velocities(state, hertz, ALONG, branches=[name])
            ax.plot(hertz / 1e3, found.phase[0], color=COLOURS[name], label=f"{name}, phase")
            ax.plot(hertz / 1e3, found.group[0], color=COLOURS[name], dashes=(3.5, 1.5), label=f"{name}, group")
        ax.axvline(PULSE / 1e3, color="0.5", linewidth=0.6, zorder=0.5)
        ax.set(xlabel="Frequency (kHz)", ylabel="Velocity (m/s)", xlim=(0.0, None), ylim=(0.0, 900.0))
        ax.annotate("6.5 kHz", (PULSE / 1e3, 850.0), (3.0, 0.0), textcoords="offset points")
        ax.legend(loc="lower left", bbox_to_anchor=(0.18, 0.0))
    if out is not None:
        figure.savefig(out)
    return figure


if __name__ == "__main__":
    main(Path("pulse_dispersion.png"))
