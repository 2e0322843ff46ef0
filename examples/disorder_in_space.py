r"""Balls that differ, in the plane and in space
============================================

The sound velocity of balls that differ by a few microns rises faster with the load than the power
1/6 of Hertz. Does this survive in space, where each ball has twelve neighbours instead of six?

Arrays of steel balls, 8 mm with a uniform spread of 2.04 microns, are simulated on the fcc and on
the triangular lattice, and compared with the effective medium of each lattice. Forces are
:math:`f^*=f/cW^{3/2}`. Left: the local exponent :math:`\mathrm d\log v_L/\mathrm d\log P`. Right,
above: G/K over that of equal balls, where K and G are averages over all directions. Right, below:
the force of the medium over that of the array at the same overlap, both without friction. Points
are simulations, with standard errors over the samples; lines are the medium.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.dynamics.elasticity import bulk_and_shear
from granphon.figures.style import STYLE

FORCE = np.array([0.006, 0.012, 0.025, 0.05, 0.1, 0.2, 0.4, 0.8, 2.0])  # f*
SHAPES = {"fcc": (10, 10, 10), "triangular": (40, 40)}
steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)


def packing(lattice, friction=True):
    return gp.Packing(steel, 8e-3, spread=gp.Uniform(2.04e-6), lattice=lattice, friction=friction)


force = FORCE * packing("fcc").width_units.force
states = {
    name: gp.DirectSimulation(packing(name), shape, samples=3).at_force(force)
    for name, shape in SHAPES.items()
}
fine = np.geomspace(0.08, 2.5, 60) * packing("fcc").width_units.force
media = {name: gp.EffectiveMedium(packing(name)).at_force(fine) for name in SHAPES}

# %% It does, and the rise is even larger: near :math:`f^*=0.02` the exponent is 0.31 in fcc and
# 0.28 in the triangular array. At high load both are 1/6.

exponent = {name: gp.local_exponent(state) for name, state in states.items()}
assert np.all(exponent["fcc"][[2, 3]] > exponent["triangular"][[2, 3]])
assert np.all(np.abs(exponent["fcc"][[2, 3]] - 0.305) < 0.02)
assert np.all(np.abs(np.array([exponent[name][-1] for name in SHAPES]) - 1.0 / 6.0) < 0.003)

# %% In both lattices G/K begins to fall below that of equal balls at the same load, but it falls
# less in space.


def ratio(of):
    return of.voigt.shear / of.voigt.bulk


of_equal = {
    name: ratio(gp.moduli(gp.AveragedLattice(packing(name)).at_force(1.0))) for name in SHAPES
}
samples = {}
for name, state in states.items():
    bulk, shear = np.moveaxis(bulk_and_shear(state.sampled_tensors), -1, 0)
    samples[name] = shear / bulk / of_equal[name]
softer = {name: np.mean(one, axis=1) for name, one in samples.items()}
for one in softer.values():
    assert np.all(np.diff(one) > 0.0)
    assert abs(one[-1] - 1.0) < 0.005
assert np.all(softer["fcc"][:4] > softer["triangular"][:4])

# %% In space the medium is accurate down to lower loads, because each ball has more neighbours to
# average over.

medium = {}
for name, state in states.items():
    law = gp.EffectiveMedium(packing(name, friction=False)).law
    medium[name] = law.force(state.overlap) / state.force
assert np.all(np.abs(medium["fcc"][4:] - 1.0) < 0.02)
assert np.all(np.abs(medium["fcc"] - 1.0)[1:5] < np.abs(medium["triangular"] - 1.0)[1:5])

with matplotlib.rc_context(STYLE):
    bars = {"linestyle": "", "markersize": 3.5, "elinewidth": 0.7, "capsize": 1.5}
    figure = plt.figure(figsize=(7.0, 3.6), dpi=300, layout="constrained")
    axes = figure.subplot_mosaic([["exponent", "ratio"], ["exponent", "medium"]], sharex=True)
    for (name, state), colour, marker in zip(
        states.items(), ("#D55E00", "#0072B2"), "os", strict=True
    ):
        style = {"color": colour, "marker": marker, **bars}
        axes["exponent"].errorbar(
            FORCE, exponent[name], state.exponent_error, label=f"{name}, simulated", **style
        )
        axes["exponent"].plot(
            fine / force[0] * FORCE[0],
            gp.local_exponent(media[name]),
            color=colour,
            linewidth=0.8,
            label=f"{name}, medium",
        )
        error = np.std(samples[name], axis=1, ddof=1) / np.sqrt(3.0)
        axes["ratio"].errorbar(FORCE, softer[name], error, label=name, **style)
        error = state.standard_error("overlap") * state.normal_stiffness / state.force
        axes["medium"].errorbar(FORCE, medium[name], error, label=name, **style)
    axes["exponent"].axhline(1.0 / 6.0, color="0.6", linewidth=0.6, zorder=0.5)
    axes["exponent"].text(0.006, 1.0 / 6.0 + 0.002, "Hertz, 1/6")
    axes["exponent"].set(
        xscale="log", xlabel="$f^*$", ylabel=r"$\mathrm{d}\log v_L/\mathrm{d}\log P$"
    )
    axes["exponent"].legend(loc="upper right")
    for name, label in (
        ("ratio", "$G/K$ over that\nof equal balls"),
        ("medium", "Force of the medium\nover the simulated"),
    ):
        axes[name].axhline(1.0, color="0.6", linewidth=0.6, zorder=0.5)
        axes[name].set_ylabel(label)
        axes[name].legend(loc="lower right" if name == "ratio" else "upper right")
    axes["medium"].set_xlabel("$f^*$")
    axes["ratio"].tick_params(labelbottom=False)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
