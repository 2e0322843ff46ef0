"""The width of the balls from times of flight
===========================================

How much do the diameters of the balls differ? A fit to the velocity of sound gives the answer. The
data here are computed, not measured, because the published ones are not available as numbers. They
are group velocities of 6.5 kHz pulses across a frame of steel balls whose diameters differ by 2.04
microns, with 0.4 % of noise. The fit recovers this width within its standard error.
"""

import sys
from pathlib import Path

import granphon as gp
from granphon.figures.curves import fit_figure
from granphon.fits.measurements import Measurements

HERE = Path(sys.argv[0]).parent
TRUE = 2.04e-6  # m

packing = gp.Scene.from_yaml(HERE / "steel_spread.yaml").packing
data = Measurements.read(HERE / "steel_pulses.csv")
fit = gp.fit_width(packing, data.force, data.velocity, data.sigma, frequency=6500.0)
print(f"W = {fit.width * 1e6:.3f} ± {fit.stderr * 1e6:.3f} microns")
assert abs(fit.width - TRUE) < 2.0 * fit.stderr
assert fit.stderr < 0.02 * TRUE

# %% If the frequency is left out, the fit takes the pulses for long waves, and finds a width that
# is a quarter too large.

long = gp.fit_width(packing, data.force, data.velocity, data.sigma)
print(f"as long waves: W = {long.width * 1e6:.3f} microns")
assert 1.2 < long.width / TRUE < 1.3

figure = fit_figure(fit)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
