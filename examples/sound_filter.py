r"""A crystal that stops sound below 20 kHz
=======================================

Which crystal of two kinds of balls of real materials stops most of what can be heard? Heavy balls
of tungsten carbide and light ones of PTFE on the sites of NaCl have a complete gap between their
branches, rotations included. :func:`granphon.design` finds the diameters and the load for which
the part of the gap below 20 kHz is widest. It is the best of five starts, one in the middle of the
bounds and four at random from a seed: all end at the same width, which speaks for it, but nothing
proves that no other crystal within the bounds is better. Other crystals are as good: all
frequencies stay if the load grows as the eighth power of the diameters. The gap is certified on a
mesh with four times as many wave vectors along each period as that of the search. The whole contact
law in time then shows that a slab of eight layers is a filter: below the gap it passes the motion
of a shaker on, within the gap the far face stays still. (The branches above the gap are so flat
that hardly anything passes there, too.)
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.bands import plot_bands
from granphon.figures.style import BLUE, PAGE_WIDTH, STYLE, VERMILION

carbide = gp.Material(young_modulus=600e9, poisson_ratio=0.22, density=15600.0)
ptfe = gp.Material(young_modulus=0.5e9, poisson_ratio=0.46, density=2200.0)
LIMIT = 20e3
axis = np.arange(4) / 4.0
zone = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)[:40]


def press(diameter, ratio, force):
    """The crystal of heavy balls of a diameter, m, and light ones that are smaller by a ratio,
    under a mean contact force, N.
    """
    balls = [gp.Ball(carbide, diameter, name="WC"), gp.Ball(ptfe, ratio * diameter, name="PTFE")]
    return gp.Crystal.on("NaCl", balls).at_force(force)


class StopBand:
    """The part of the gap between the lower and the upper half of the branches below a limit."""

    largest = True
    unit = "Hz"

    def evaluate(self, network):
        frequencies = gp.Phonons(network).frequencies(zone)
        half = frequencies.shape[1] // 2
        upper = min(frequencies[:, half:].min(), LIMIT)
        return upper - frequencies[:, :half].max(), {}

    def certify(self, network):
        gaps = np.minimum(gp.Phonons(network).gaps((16, 16, 16)), LIMIT)
        return float(np.max(np.diff(gaps, axis=1)))


# smaller light balls would not keep the heavy ones apart, and larger forces dent PTFE
bounds = {"diameter": (4e-3, 12e-3), "ratio": (0.42, 1.0), "force": (0.1, 1.0)}
best = gp.design(press, StopBand(), tuple(bounds), bounds, restarts=4, seed=1, steps=20)
diameter, ratio, force = best.variables
print(
    f"{best.value:.1f} Hz below 20 kHz are certified, the best of {len(best.starts)} starts,"
    f" which differ by {np.ptp(best.starts):.2g} Hz; the middle of the bounds has"
    f" {best.start_value:.1f} Hz"
)
assert np.ptp(best.starts) < 1.0
state = press(diameter, ratio, force)
gaps = gp.Phonons(state).gaps()
lower, upper = max(gaps, key=lambda gap: min(gap[1], LIMIT) - gap[0])
print(
    f"tungsten carbide of {1e3 * diameter:.3g} mm, PTFE of {1e3 * ratio * diameter:.3g} mm,"
    f" {force:.3g} N on each contact: no waves from {lower:.0f} to {upper:.0f} Hz"
)

# the whole contact law in time: one face of a slab of eight layers is shaken
slab = state.network.cut((1, 1, 0), 8)
waves = gp.NonlinearWaves(slab)
amplitude = 1e-3 * waves.overlap.min()
light_balls = np.flatnonzero(np.array(slab.kinds) == "PTFE")
face, *_, far = light_balls[np.argsort(slab.positions[light_balls, 2])].tolist()
frequencies = [0.5 * lower, 0.5 * (lower + upper)]
signals = []
for frequency in frequencies:

    def shake(time, frequency=frequency):
        """A sine that rises over the first periods."""
        rise = 0.5 - 0.5 * np.cos(np.pi * min(frequency * time / 10.0, 1.0))
        return amplitude * rise * np.sin(2.0 * np.pi * frequency * time)

    shaker = gp.Drive(face, (0.0, 0.0, 1.0), displacement=shake)
    motion = waves.run(40.0 / frequency, drive=shaker, frames=40 * 16 + 1)
    signals.append((motion.times * frequency, motion.displacements[:, far, 2] / amplitude))
    passed = np.max(np.abs(signals[-1][1][-160:]))
    print(f"at {frequency:.0f} Hz the far face moves {passed:.2g} times as far as the shaker")
    assert (passed < 1e-3) == (frequency > lower)

bands = gp.Phonons(state).bands()
with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(PAGE_WIDTH, 2.8), dpi=300, layout="constrained"
    )
    plot_bands(bands, left, gaps=gaps)
    left.set_title("NaCl of tungsten carbide and PTFE")
    for (turns, motion_of_far), frequency, colour in zip(
        signals, frequencies, (BLUE, VERMILION), strict=True
    ):
        right.plot(
            turns, motion_of_far, color=colour, linewidth=0.6, label=f"{frequency / 1e3:.1f} kHz"
        )
    right.set_yscale("symlog", linthresh=1e-3)
    right.set(xlabel="Time (periods)", ylabel="Far face over shaker")
    right.legend(title="Shaken at", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
