r"""Several runs in one figure
==========================

Steel and glass balls, by the effective medium and by a simulation, and a fit to pulses that crossed
steel balls.

The legend says what differs between the curves, and the title what all share. Data are black: they
are computed, not measured, as in the example of the fit. Points of a simulation have bars, the
standard errors over its samples; a line is thin and dashed where the load is outside the range of
its medium. From folders of runs the command makes the same figure: ``granphon plot steel glass fit
-o figure.png``.
"""

import sys
from pathlib import Path

import numpy as np

import granphon as gp
from granphon.fits.measurements import Measurements

HERE = Path(
    globals().get("__file__", "several_runs.py")
).parent  # the gallery runs this in its folder, without a name

forces = np.geomspace(1.0, 100.0, 9)
spread = gp.Uniform(2.04e-6)
media = ["ema", {"simulation": {"shape": (32, 32), "samples": 4}}]
steel = gp.Packing(
    gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0), 8e-3, spread
)
glass = gp.Packing(
    gp.Material(young_modulus=70e9, poisson_ratio=0.22, density=2500.0), 8e-3, spread
)
data = Measurements.read(HERE / "steel_pulses.csv")
runs = {
    "steel": gp.sweep(steel, force=forces, media=media),
    "glass": gp.sweep(glass, force=forces, media=media),
    "fit to pulses of 6.5 kHz": gp.fit_width(
        steel, data.force, data.velocity, data.sigma, frequency=6500.0
    ),
}

# %% Glass is softer than steel, by a factor of three in the Young modulus, and lighter by the same
# factor: under one force sound is faster in it. Pulses are slower than long waves, because they are
# dispersed.

faster = (runs["glass"].longitudinal / runs["steel"].longitudinal).sel(medium="ema").values
print("glass over steel:", np.round(faster, 3))
assert np.all(faster > 1.2)

figure = gp.plot(runs)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
