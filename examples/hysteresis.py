r"""Hysteresis of a pressed array
=============================

Press balls of steel together, and unload them again: with friction between them the force is
smaller on the way back. The missing work is lost by contacts that slide, and by slip at a stiffness
that falls with the force. Diameters differ by 2.04 microns. The arrays come to rest without
friction at :math:`a^*=1/2`. From there on friction acts, up to :math:`a^*=0.9`, back, and up again.

Left: the increase of the mean contact force by friction, as a fraction of the force of the same
balls without friction. Right: the distribution of contacts, at the top of the first loading, over
the ratio of their tangential force to Coulomb's limit. Bars are standard errors over three arrays
of 24 x 24 balls.
"""

import sys
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import BLUE, GUIDE, PAGE_WIDTH, STYLE, VERMILION

packing = gp.Scene.from_yaml(Path(sys.argv[0]).with_name("paper_ladder.yaml")).packing
balls = {"shape": (24, 24), "seed": 0, "samples": 3, "geometry": "exact"}
up = np.array([0.55, 0.6, 0.65, 0.7, 0.8, 0.9])
spacing = np.concatenate([up, up[-2::-1], up[1:]])  # a*, there and back and there again
overlap = (spacing - 0.5) * packing.width
smooth = (
    gp.DirectSimulation(packing, **balls)
    .at_overlap(overlap)
    .over_samples(lambda sample: sample.force)
)

states = {}
for mu in (0.1, 0.3):
    simulation = gp.DirectSimulation(
        packing, friction_history=True, friction_coefficient=mu, **balls
    )
    states[mu] = simulation.path(overlap=overlap)
rise = {
    mu: state.over_samples(lambda sample: sample.force) / smooth - 1.0
    for mu, state in states.items()
}

# %% Friction raises the force on the way up. On the way back it raises it less, and with a small
# coefficient the force even falls below that without friction. The second loading does not repeat
# the first.

top = len(up) - 1
for mu, values in rise.items():
    first_rise, unloading, second_rise = (
        np.mean(part, axis=1)
        for part in (values[:top], values[2 * top : top : -1], values[2 * top : -1])
    )
    print(
        f"mu = {mu}: {100.0 * np.max(first_rise):.1f} % more force at most; back"
        f" {100.0 * np.max(first_rise - unloading):.1f} % less"
    )
    assert np.all(first_rise > 0.0)
    assert np.all(unloading < first_rise)
    assert np.all(second_rise < first_rise)
assert np.mean(rise[0.1][2 * top]) < 0.0
dissipated = {
    mu: state.over_samples(lambda sample: sample.dissipated_energy) for mu, state in states.items()
}
assert all(np.all(np.diff(values, axis=0) > 0.0) for values in dissipated.values())

# %% With a small coefficient of friction more contacts slide. These are the fractions, of the
# contacts closed at the top, that are at Coulomb's limit.

sliding = {
    mu: np.mean([sample.sliding_fraction for sample in state[top].samples])
    for mu, state in states.items()
}
print(", ".join(f"mu = {mu}: {100.0 * part:.1f} % slide" for mu, part in sliding.items()))
assert sliding[0.1] > 5.0 * sliding[0.3]

with matplotlib.rc_context(STYLE):
    figure, (ax, right) = plt.subplots(
        1, 2, figsize=(PAGE_WIDTH, 3.1), dpi=300, layout="constrained"
    )
    legs = (
        (slice(0, top + 1), "o", "up"),
        (slice(top, 2 * top + 1), "v", "back"),
        (slice(2 * top, None), "^", "up again"),
    )
    for (mu, values), colour in zip(rise.items(), (BLUE, VERMILION), strict=True):
        mean = 100.0 * np.mean(values, axis=1)
        error = 100.0 * np.std(values, axis=1, ddof=1) / np.sqrt(values.shape[1])
        for part, marker, leg_name in legs:
            fill = "white" if leg_name == "back" else colour
            ax.errorbar(
                spacing[part],
                mean[part],
                error[part],
                marker=marker,
                color=colour,
                mfc=fill,
                markersize=3.5,
                linewidth=0.8,
                linestyle=":" if leg_name == "up again" else "-",
                elinewidth=0.6,
                capsize=1.5,
                label=rf"$\mu$ = {mu}, {leg_name}",
            )
        edges, density, _ = states[mu][top].mobilisation_distribution(20)
        right.stairs(density, edges, color=colour, label=rf"$\mu$ = {mu}")
    ax.axhline(0.0, color=GUIDE, linewidth=0.6, zorder=0.5)
    ax.set(xlabel="$a^*$", ylabel="Force over that without friction, less 1 (%)")
    ax.legend(ncols=2, loc="upper right", columnspacing=1.0)
    ax.set_ylim(top=1.75 * ax.get_ylim()[1])
    right.set(
        xlabel=r"Tangential force over Coulomb's limit, $T/\mu f$",
        ylabel="Probability density",
        xlim=(0.0, 1.0),
    )
    right.set_ylim(bottom=0.0)
    right.legend(loc="upper center")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
