"""From traces of sensors to the modulus of the balls
==================================================

An experimenter pushes the end of a pressed chain, and records what three beads do. Traces with
noise, as an oscilloscope writes them, give the velocity of sound at each load, with its standard
error; a fit to these velocities gives the Young modulus. The traces are computed here, by the
motion of a chain of known modulus, and two per cent of noise are added: the fit finds the modulus
within its standard error.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.curves import plot_fit
from granphon.figures.style import PAGE_WIDTH, STYLE
from granphon.figures.traces import plot_traces

TRUE_MODULUS = 205e9  # Pa
DIAMETER = 8e-3  # m
SENSORS = [20, 60, 100]
FORCES = np.array([5.0, 10.0, 20.0, 40.0])  # N


def make_chain(young_modulus):
    """A chain of steel balls that move along it."""
    steel = gp.Material(young_modulus, poisson_ratio=0.276, density=7840.0)
    return gp.Packing(steel, DIAMETER, lattice="chain", motions="longitudinal")


def record(force, rng):
    """Push the first ball for a millisecond, by a small part of the load, and read the beads."""
    cell = gp.AveragedLattice(make_chain(TRUE_MODULUS)).at_force(force)
    chain = cell.network.repeat((180,)).cut(0, 1)

    def push(time):
        return 0.002 * force * np.sin(np.pi * np.clip(time / 1e-3, 0.0, 1.0)) ** 2

    drive = gp.Drive(0, direction=(1, 0, 0), force=push)
    motion = gp.NonlinearWaves(chain).run(2.8e-3, drive=drive, frames=1401)
    signals = motion.velocities[:, SENSORS, 0].T
    noise = 0.02 * signals.max() * rng.standard_normal(signals.shape)
    return gp.Traces(motion.times, signals + noise, np.multiply(SENSORS, DIAMETER))


rng = np.random.default_rng(1)
traces = [record(force, rng) for force in FORCES]
found = [trace.velocity() for trace in traces]
for force, velocity in zip(FORCES, found, strict=True):
    print(f"{force:4.0f} N: {velocity.velocity:.1f} ± {velocity.stderr:.1f} m/s")

fit = gp.fit_width(
    make_chain(211.65e9),
    FORCES,
    [velocity.velocity for velocity in found],
    [velocity.stderr for velocity in found],
    parameters=("young_modulus",),
)
modulus = float(fit.values[0])
stderr = float(fit.stderrs[0])
print(f"E = {modulus / 1e9:.1f} ± {stderr / 1e9:.1f} GPa")
assert abs(modulus - TRUE_MODULUS) < 2.0 * stderr
assert stderr < 0.01 * TRUE_MODULUS

with matplotlib.rc_context(STYLE):
    figure = plt.figure(figsize=(PAGE_WIDTH, 3.0), layout="constrained")
    panels = figure.subplot_mosaic(
        [["traces", "fit"], ["traces", "residuals"]], height_ratios=[3, 1]
    )
    plot_traces(traces[0], panels["traces"], found[0])
    plot_fit(fit, panels["fit"], panels["residuals"])
    panels["fit"].legend(loc="lower right")
    panels["fit"].tick_params(labelbottom=False)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
