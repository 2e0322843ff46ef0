r"""Sound under pressure
====================

In an ideal array of Hertz contacts the velocity of sound is proportional to the power 1/6 of the
pressure. The diameters of real balls differ by a few microns, and the velocity rises faster.

Under a low load some of the balls do not touch; as the load grows, one contact after another
closes. The velocity follows :math:`P^{1/6}` again when the overlap is large against the spread. The
figure is for 8 mm steel balls with spreads of 1, 2 and 4 microns, by the effective medium; lines
are thin and dashed where the load is below its range of validity.
"""

import sys

import numpy as np

import granphon as gp
from granphon.figures.curves import sweep_figure

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, diameter=8e-3)
sweep = gp.sweep(
    packing, force=np.geomspace(0.5, 500.0, 121), media="ema", width=[1e-6, 2e-6, 4e-6]
)

# %% The local exponent :math:`\mathrm{d}\log v/\mathrm{d}\log P` is a function of the reduced force
# :math:`f^*` alone, whose unit is proportional to the power 3/2 of the width. So the three curves
# are one curve, shifted. The exponent passes through 1/4, and is not constant there.

exponent, reduced = (sweep[name].squeeze().values.T for name in ("exponent", "reduced_force"))
quarter = [
    float(np.interp(-0.25, -each, force)) for each, force in zip(exponent, reduced, strict=True)
]
print("the exponent is 1/4 at f* =", *np.round(quarter, 3))
assert np.allclose(quarter, 0.195, atol=1e-3)
assert np.allclose(exponent[0, -1], 1 / 6, rtol=1e-4)

figure = sweep_figure(sweep)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
