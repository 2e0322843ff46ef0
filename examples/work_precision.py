"""What accuracy costs
===================

How accurate is each medium at a given load, and how long does it take? ``granphon tradeoff``
measures this for a scene. Here we call it from Python, for 8 mm steel balls whose diameters differ
by 2.04 microns.

Errors are those of the sound velocities, against an ensemble of simulated arrays. A point is open
if this reference is less than a hundred times more accurate than the point itself.
"""

import sys

import granphon as gp
from granphon.cli.terminal import describe_tradeoff
from granphon.figures.work_precision import tradeoff_figure

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, diameter=8e-3, spread=gp.Uniform(2.04e-6))
# twenty seconds, at f* = 1, where all contacts are closed
result = gp.tradeoff(packing, force=19.9, budget=20.0)
print("\n".join(describe_tradeoff(result, packing.structure.periods)))

# %% The averaged force is about three times more accurate than the averaged lattice, and the
# effective medium three times more than that. A simulation is better than the effective medium from
# 8 x 8 balls on; its error falls with the inverse root of the number of balls. (On a slower machine
# the reference has fewer samples, and is less accurate.)

expected = {"ala": 4.3e-3, "afa": 1.65e-3, "computed field": 5.1e-4}
for point in result.points:
    if point.knob in expected and not point.failure:
        assert (
            abs(point.error / expected[point.knob] - 1.0)
            < 0.03 + 4.0 * point.reference_error / expected[point.knob]
        )

figure = tradeoff_figure(result)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
