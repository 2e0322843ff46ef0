r"""A membrane of balls, and granular graphene
==========================================

In one layer of steel balls the balls move out of the plane and roll. A triangular membrane whose
contacts resist bending has flexural waves, whose frequency is proportional to the square of the
wave vector. Without that stiffness it is proportional to the cube, and is zero along Γ-M. A
honeycomb of such balls is granular graphene: two of its branches cross at K in a Dirac point.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.figures.bands import plot_bands, plot_zone
from granphon.figures.modes import plot_mode
from granphon.figures.style import BLUE, STYLE, VERMILION

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
TORSION = 0.02
BENDING = 0.01


def membrane(lattice, **extra):
    packing = gp.Packing(steel, diameter=8e-3, lattice=lattice, motions="out_of_plane", **extra)
    return gp.Phonons(gp.AveragedLattice(packing).at_force(18.446))


loose = membrane("triangular")
glued = membrane("triangular", torsion=TORSION, bending=BENDING)
graphene = membrane("honeycomb")
eta = steel.mindlin_ratio

# %%
# Long flexural waves of the triangular membrane, with :math:`\tau` and :math:`\beta` the stiffness
# of torsion and bending over :math:`kd^2`: :math:`\omega^2=\frac38(3\beta+\tau)\,(qd)^4\,k/M` in
# every direction. With neither of the two,
# :math:`\omega=\sqrt{\eta/768}\,(qd)^3\,|\cos3\theta|\,(k/M)^{1/2}`, where :math:`\theta` is the
# angle from Γ-K.

q = 1e-2
angle = np.radians([0.0, 10.0, 20.0, 25.0])
wave_vectors = q * np.stack([np.cos(angle), np.sin(angle)], axis=1)
assert np.allclose(
    glued.lattice.frequencies(wave_vectors)[:, 0],
    np.sqrt(0.375 * (3.0 * BENDING + TORSION)) * q**2,
    rtol=1e-4,
)
cube = np.sqrt(eta / 768.0) * q**3 * np.abs(np.cos(3.0 * angle))
assert np.allclose(loose.lattice.frequencies(wave_vectors)[:, 0], cube, rtol=1e-4)

# %% Three branches of the honeycomb have zero frequency: two balls have six motions, and their
# three contacts resist three slips. At K two of the other branches meet at
# :math:`\omega^2=\frac{27}4\eta k/M`. Away from K they separate with the same slope in all
# directions, :math:`\pm d(\eta k/M)^{1/2}/(8\sqrt3)`.

K = graphene.lattice.wavevectors([1 / 3, 1 / 3])
assert np.allclose(
    graphene.lattice.frequencies(K[None])[0] ** 2,
    eta * np.array([0, 0, 0, 6.75, 6.75, 7.5]),
    rtol=1e-12,
    atol=1e-12,
)
cone = graphene.lattice.frequencies(K + 1e-3 * wave_vectors)[:, 3:5] - np.sqrt(6.75 * eta)
assert np.allclose(cone, 1e-3 * q * np.sqrt(eta / 192.0) * np.array([-1.0, 1.0]), rtol=1e-4)
bands = graphene.bands("GKMG", npoints=101)
print(f"Dirac point at {bands.frequencies[0, -1, 3] / 1e3:.2f} kHz")

with matplotlib.rc_context(STYLE):
    figure, (left, middle, right) = plt.subplots(
        1, 3, figsize=(7.0, 2.9), dpi=300, layout="constrained"
    )
    reach = np.logspace(-2.0, 0.0, 41)
    rays = reach[:, None] * [1.0, 0.0]
    for phonons, colour, power, name in (
        (glued, BLUE, 2, "with bending and torsion"),
        (loose, VERMILION, 3, "without"),
    ):
        hertz = phonons.lattice.frequencies(rays)[:, 0] * phonons.scales.frequency
        left.loglog(reach, hertz, color=colour, linewidth=1.5, label=f"{name}: $q^{power}$")
    left.set(
        xlabel="Wave vector $qd$, Γ-K", ylabel="Frequency (Hz)", xlim=(1e-2, 1.0), ylim=(1e-4, 1e6)
    )
    left.legend(loc="upper left")
    left.set_title("triangular, flexural wave")
    plot_bands(bands, middle)
    middle.set(ylim=(26.5, 33.2), title="honeycomb, upper three branches")
    middle.plot(
        bands.distances[0, -1],
        bands.frequencies[0, -1, 3] / 1e3,
        "o",
        color="black",
        markersize=4.0,
        fillstyle="none",
    )
    plot_zone(bands, middle.inset_axes((0.3, 0.03, 0.4, 0.4)))
    plot_mode(glued, (1 / 6, 0.0), 0, right, cells=(6, 4))
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
