r"""A pulse through the hexagon of the experiment
=============================================

Gilles and Coste pressed 2,791 steel balls, 31 on a side, into a hexagon between walls, sent pulses
from one side to the opposite one, and computed the sound velocity from the time of flight. Here the
balls are simulated one by one, with a uniform spread of 2.04 microns; six rigid walls press them,
and five periods of 6.5 kHz are sent.

Left: the velocity by the time of flight of the envelope, through balls that differ (points, with
the standard error over samples) and through equal balls (crosses). Lines are the velocity of long
waves and the group velocity of the pulse at the same forces, in the effective medium and in the
ideal lattice. Right: the motion of single balls of the far side, and its mean.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.style import BLUE, GUIDE, STYLE, VERMILION
from granphon.figures.waves import plot_seismogram

FREQUENCY = 6500.0
ALONG = (0.0, 1.0)
SAMPLES = 2
side_force = np.geomspace(100.0, 990.0, 4)  # N
steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
differ = gp.Packing(steel, 8e-3, spread=gp.Uniform(2.04e-6))
alike = gp.Packing(steel, 8e-3)
length = 60 * np.sqrt(0.75) * 8e-3  # m, from the first row of balls to the last


def send(hexagon, force):
    pressed = hexagon.at_side_force(force)
    return pressed.force, gp.Waves(pressed).transmit(FREQUENCY, ALONG, length)


equal = gp.Hexagon(alike)
through_equal = [send(equal, force) for force in side_force]
force = np.array([force_of_contact for force_of_contact, _ in through_equal])
hexagons = [gp.Hexagon(differ, seed=seed) for seed in range(SAMPLES)]
sent = [[send(array, load)[1] for array in hexagons] for load in side_force]
measured = np.array([[pulse.velocity for pulse in of_load] for of_load in sent])

# %% Walls and ends cost time: even in equal balls the pulse arrives later than its group velocity
# says. The ratio of the velocities in balls that differ and in equal balls is that of the effective
# medium.

medium = gp.EffectiveMedium(differ)
ideal = gp.AveragedLattice(alike)
group = {
    of: [gp.pulse_velocities(of.at_force(f), FREQUENCY, ALONG).group[0] for f in force]
    for of in (medium, ideal)
}
late = np.array([pulse.velocity for _, pulse in through_equal]) / group[ideal]
assert np.all((late > 0.95) & (late < 0.975))
assert np.all(np.abs(measured.mean(axis=1) / (late * group[medium]) - 1.0)[1:] < 0.02)

# %% At low load the motions of single balls differ: the coherent part of the energy falls to about
# a half.

coherent = [np.mean([pulse.coherent_fraction for pulse in of_load]) for of_load in sent]
assert coherent[0] < 0.75 < coherent[-1]

fine = np.geomspace(force[0], force[-1], 40)
with matplotlib.rc_context(STYLE):
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.0, 3.2), dpi=300, layout="constrained")
    for of, colour, name in ((ideal, GUIDE, "equal balls"), (medium, BLUE, "effective medium")):
        waves = gp.sound_velocities(of.at_force(fine), ALONG).longitudinal
        groups = [gp.pulse_velocities(of.at_force(f), FREQUENCY, ALONG).group[0] for f in fine]
        left.plot(fine, waves, color=colour, linewidth=0.9, label=f"{name}, long waves")
        left.plot(
            fine,
            groups,
            color=colour,
            linewidth=0.9,
            linestyle="--",
            label=f"{name}, group at 6.5 kHz",
        )
    error = np.std(measured, axis=1, ddof=1) / np.sqrt(SAMPLES)
    left.plot(
        force,
        [pulse.velocity for _, pulse in through_equal],
        "x",
        color=GUIDE,
        label="equal balls, time of flight",
    )
    left.errorbar(
        force,
        measured.mean(axis=1),
        error,
        fmt="o",
        markersize=3.5,
        color=VERMILION,
        label="time of flight",
    )
    left.set(
        xscale="log", yscale="log", xlabel="Mean contact force $f$ (N)", ylabel="Velocity (m/s)"
    )
    left.set_xticks([2, 5, 10, 20], ["2", "5", "10", "20"])
    left.set_yticks([400, 500, 600, 700, 800], ["400", "500", "600", "700", "800"])
    left.minorticks_off()
    left.legend(fontsize=7.0)
    plot_seismogram(sent[0][0], right)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
