"""What accuracy costs
===================

How good is each medium at a load, and how long does it take? And inside the effective medium, what do the grid of the
Green's function and the tolerance of the solution cost? ``granphon tradeoff`` measures it for a scene; here it is called
from Python, for 8 mm steel balls that differ by 2.04 microns. Errors are those of the sound velocities, against references
that other algorithms have made; open points are those whose reference is less than a hundred times better.
"""

import sys

import granphon as gp
from granphon.cli.wording import work_and_precision
from granphon.figures.work_precision import tradeoff_figure

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, diameter=8e-3, spread=gp.Uniform(2.04e-6))
result = gp.tradeoff(packing, force=19.9, budget=20.0)  # f* = 1, where all contacts are closed
print("\n".join(work_and_precision(result)))

# %%
# Each rung of the ladder is some three to eight times better than the one below. A simulation is better than the effective
# medium from 8 x 8 balls on, and its error falls as the root of the number of balls.

error = {point.knob: point.error for point in result.of("media")}
assert abs(error["ala"] - 4.3e-3) < 1e-4
assert abs(error["afa"] - 1.65e-3) < 5e-5
assert abs(error["computed field"] - 5.1e-4) < 2e-5
assert all(point.resolved for point in result.of("media") if not point.random and not point.failure)

# %%
# Inside the effective medium nothing is left to gain: its grid and its tolerance are finer than any use by many orders.

figure = tradeoff_figure(result)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
