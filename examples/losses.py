r"""What losses do: collisions, and modes of a chain
================================================

The same two balls of steel collide at velocities from 1 mm/s to 1 m/s. A dashpot in proportion to
the stiffness of the contact loses more the faster they are, a constant dashpot or a drag loses
less, and the dashpot of Tsuji, Tanaka and Ishida (Powder Technol. 71, 239, 1992) always the same:
that is what a restitution stands for. Where dashpots may not pull, as balls part, a collision loses
less than they would alone. In a pressed chain the same words damp modes: Q falls with the frequency
for all dashpots, stays for a loss factor, and rises for a drag.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import COLOURS, DPI, PAGE_WIDTH, STYLE

BALL = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
#: losses of which each has a restitution of 0.9 at 0.1 m/s
LOSSES = {
    "damping 0.73 µs": {"damping": 0.73e-6},
    "dashpot 5.15 N s/m": {"dashpot": 5.15},
    "drag 4880 1/s": {"drag": 4880.0},
    "restitution 0.9": {"restitution": 0.9},
}
LOOKS = ("-", "-", "--", "-")


def collide(speed, **losses):
    """The velocity of two balls after a collision over the one before, which is in m/s."""
    pair = gp.Crystal([BALL] * 2, [], [[0.0], [8e-3]], friction=False)
    duration = 200.0 * gp.NonlinearWaves(pair).find_step(0.5 * speed)
    velocities = [[0.5 * speed], [-0.5 * speed]]
    motion = gp.NonlinearWaves(pair, **losses).run(duration, velocities=velocities, frames=401)
    parted = int(np.flatnonzero(motion.forces[:, 0] > 0.0)[-1]) + 1
    return float(np.ptp(motion.velocities[parted])) / speed


speeds = np.geomspace(1e-3, 1.0, 13)
found = {
    name: [collide(speed, **losses) for speed in speeds.tolist()] for name, losses in LOSSES.items()
}
assert np.allclose(found["restitution 0.9"], 0.9, atol=0.01)
assert all(np.isclose(collide(0.1, **losses), 0.9, atol=0.01) for losses in LOSSES.values())

given = np.linspace(0.05, 1.0, 20)
pulls = {
    pull: [collide(0.1, restitution=e, viscous_pull=pull) for e in given.tolist()]
    for pull in ("limited", "whole")
}

# %% A chain of twelve balls between two that are held, pressed by 20 N. In a mode of frequency
# :math:`\omega` the energy of the springs is that of the balls, so that Q is :math:`1/(\omega\tau)`
# of a damping, :math:`1/\eta` of a loss factor, and :math:`\omega/\gamma` of a drag.

state = gp.Crystal.on("chain", [BALL]).at_force(20.0)
chain = gp.Waves(state.network.cut(0, 14, edges="clamped"))
in_modes = {
    "damping or dashpot": {"damping": 0.2e-6},
    "loss factor": {"loss_factor": 0.02},
    "drag": {"drag": 2e3},
}
modes = {name: chain.damped_modes(12, **losses) for name, losses in in_modes.items()}
omega = 2.0 * np.pi * np.abs(modes["loss factor"].frequencies)
assert np.allclose(modes["loss factor"].quality, 50.0, rtol=1e-3)
assert np.allclose(modes["drag"].quality, omega / 2e3, rtol=1e-2)
assert np.allclose(modes["damping or dashpot"].quality, 1.0 / (omega * 0.2e-6), rtol=1e-2)

with matplotlib.rc_context(STYLE):
    figure, axes = plt.subplots(1, 3, figsize=(PAGE_WIDTH, 2.6), dpi=DPI, layout="constrained")
    left, middle, right = axes
    colours = (COLOURS[0], COLOURS[2], "black", COLOURS[1])
    for (name, values), look, colour in zip(found.items(), LOOKS, colours, strict=True):
        left.semilogx(speeds, values, look, color=colour, label=name)
    left.set(xlabel="Velocity (m/s)", ylabel="Velocity after over before", ylim=(0.5, 1.0))
    left.legend(loc="lower right")
    for (pull, values), colour in zip(pulls.items(), COLOURS, strict=False):
        middle.plot(given, values, color=colour, label=f"{pull} pull")
    middle.set(xlabel="Restitution, as given", ylabel="Velocity after over before", ylim=(0.0, 1.0))
    middle.legend(loc="upper left")
    for (name, damped), look, colour in zip(
        modes.items(), (".-", ".-", ".--"), colours[:3], strict=True
    ):
        hertz = np.abs(damped.frequencies) / 1e3
        right.semilogy(hertz, damped.quality, look, color=colour, label=name)
    right.set(xlabel="Frequency of the mode (kHz)", ylabel="Q", ylim=(1.0, 1e3))
    right.legend(loc="lower right")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
