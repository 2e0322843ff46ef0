"""The cluster that the paper proposes
===================================

The effective medium gives one ball a diameter of its own. The paper ends with the next step: a
cluster of a ball and its six neighbours, all of which differ. This script solves that cluster and
draws its stiffness beside those of the effective medium and of simulated arrays, for 8 mm steel
balls without friction whose diameters differ by 2.04 microns.

Lengths are in units of the width W of the diameters, forces in units of :math:`f^*`. All contacts
of the lattice have a mean force f and one stiffness κ. The force of a contact differs from this
line by a tension φ. The balance of forces on all balls then says that the overlaps are

.. math:: h = y + s - P\\varphi/\\kappa .

P is the projection on the elongations that motions of the balls can make. The misfit s is the part
of the differences of diameters that no motion removes. Contacts outside the cluster push at it as
if their tensions were independent, with the mean square that tensions have inside. Three conditions
on means over many clusters find the lattice: the mean force is f, tensions and misfits are not
correlated, and the rms tension is κτ. :doc:`/explanation/cluster` says what the cluster gains.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import CubicSpline

import granphon as gp
from granphon.figures.style import STYLE

SIDE = 96  # balls along each side of the periodic array from which the clusters are taken
APART = 4  # diameters between the middles of clusters, which then share no ball
SWEEPS = 100  # steps of descent at each overlap
MOMENTUM = 0.7  # part of a step of descent that is added to the next step
LATTICE_SHARE = 0.3  # part of the change of κ and τ that a step makes: the whole change oscillates

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, diameter=8e-3, spread=gp.Uniform(2.04e-6), friction=False)
unit = packing.law.coefficient * packing.width**1.5  # N, of f*

# %% Each ball has three contacts: along two periods, and along the difference of the periods. In
# Fourier space the compatibility matrix C (3, 2) gives the elongations of these contacts, and
# :math:`P=CC^+`.

steps = np.array([[1, 0], [0, 1], [-1, 1]])  # cells from a ball to its neighbours
directions = np.array([[1.0, 0.0], [0.5, 0.75**0.5], [-0.5, 0.75**0.5]])
ticks = 2.0 * np.pi * np.arange(SIDE) / SIDE
waves = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1)
phases = np.exp(1j * waves @ steps.T)  # (SIDE, SIDE, 3)
compatibility = (phases - 1.0)[..., None] * directions
projection = compatibility @ np.linalg.pinv(compatibility)  # (SIDE, SIDE, 3, 3)

# %% The cluster has seven balls and twelve contacts. Six contacts belong to the ball in the middle.

middle = (0, 0)
balls = {middle, *(tuple(step) for step in steps.tolist()), *(tuple(-step) for step in steps)}
contacts = [
    (ball, kind)
    for ball in sorted(balls)
    for kind, step in enumerate(steps)
    if tuple(step + ball) in balls
]
cells, kinds = (np.array(column) for column in zip(*contacts, strict=True))
central = np.all(cells == middle, axis=1) | np.all(cells + steps[kinds] == middle, axis=1)
between = cells[:, None] - cells


def in_cluster(symbol):
    """Return the (12, 12) table of a quantity that is (3, 3) at each wave vector."""
    table = np.fft.ifft2(symbol, axes=(0, 1)).real
    return table[between[..., 0], between[..., 1], kinds[:, None], kinds]


response = in_cluster(projection)
values, vectors = np.linalg.eigh(response)
movable = values > 1e-6
values = values[movable]
modes = vectors[:, movable] * np.sqrt(values)  # B, P = B B^T
# the second order in 1/y is that of the effective medium, but for the finite side of the array
xi = gp.EffectiveMedium(packing).local_field.xi
yielding = np.sum(response[np.ix_(central, central)]) / np.count_nonzero(central)
assert np.isclose(1.0 - yielding, xi / (1.0 + xi), rtol=5e-4)

# %% Random diameters of the whole array give the misfits of the clusters in it. Each cluster has a
# mirror image, whose diameters differ from the mean by the opposite amount.

generator = np.random.default_rng(0)
diameters = generator.permutation((np.arange(SIDE**2) + 0.5) / SIDE**2 - 0.5).reshape(SIDE, SIDE)
means = 0.5 * (1.0 + phases)  # of the two balls of each contact
remainders = means - np.einsum("xykl,xyl->xyk", projection, means)
misfits = np.fft.ifft2(remainders * np.fft.fft2(diameters)[..., None], axes=(0, 1)).real
moved = [np.roll(misfits[..., k], -cell, axis=(0, 1)) for cell, k in zip(cells, kinds, strict=True)]
misfits = np.stack([array[::APART, ::APART].ravel() for array in moved], axis=-1)


def root(covariance):
    """Return the symmetric square root of a matrix."""
    squares, axes = np.linalg.eigh(covariance)
    return (axes * np.sqrt(np.maximum(squares, 0.0))) @ axes.T


def stretch(samples, covariance):
    """Return samples (n, 12) that have a covariance exactly."""
    present = root(samples.T @ samples / len(samples))
    return samples @ np.linalg.pinv(present, rcond=1e-5, hermitian=True) @ root(covariance)


covariance = in_cluster(remainders[..., :, None] * remainders[..., None, :].conj()) / 12.0
misfits = stretch(misfits, covariance)
# the push of independent tensions outside is normal, with the covariance PP - P_in P_in; PP = P
pushes = stretch(generator.normal(size=misfits.shape), response - response @ response)
misfits = np.concatenate([misfits, misfits, -misfits, -misfits])
pushes = np.concatenate([pushes, -pushes, pushes, -pushes])

# %% The balls of a cluster are in equilibrium where :math:`\kappa w=B^T\varphi`, with the overlaps
# :math:`h=y+s+\tau m-Bw`. Each step of a descent moves all clusters towards equilibrium; then the
# three conditions give a better lattice.


def descend(overlaps):
    """Return the mean force on the ball in the middle at overlaps y, given in descending order."""
    lattice_force = overlaps[0] ** 1.5
    stiffness = 1.5 * overlaps[0] ** 0.5
    tension = 0.02
    motion = np.zeros((len(misfits), len(values)))
    forces = []
    for y in overlaps:
        previous = motion
        for sweep in range(SWEEPS):
            unrelaxed = misfits + tension * pushes
            overlap = y + unrelaxed - motion @ modes.T
            force = np.maximum(overlap, 0.0) ** 1.5
            beyond_line = force - lattice_force - stiffness * (overlap - y)
            # a step as if all contacts had the stiffness of a large overlap
            typical = 1.5 * np.sqrt(max(y, 0.0) + 0.25 * np.std(unrelaxed))
            step = (stiffness * motion - beyond_line @ modes) / (
                stiffness * (1.0 - values) + typical * values
            )
            momentum = MOMENTUM * sweep / (sweep + 3.0) * (motion - previous)
            previous, motion = motion, motion - step + momentum
            lattice_force = np.mean(force)
            slope = np.mean((force - lattice_force) * misfits) / np.mean((overlap - y) * misfits)
            rms = np.sqrt(np.mean(beyond_line**2))
            stiffness += LATTICE_SHARE * (slope - stiffness)
            tension += LATTICE_SHARE * (rms / stiffness - tension)
        forces.append(np.mean(force[:, central]))
    return np.array(forces)


# %% :math:`f^{*2/3}` is nearly linear in y. A cubic spline through it gives the stiffness
# :math:`k^*=\mathrm df^*/\mathrm dy`.

overlaps = np.array([2.0, 1.4, 1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.1, 0.05, 0.02, 0.0, -0.02])
roots = CubicSpline(overlaps[::-1], descend(overlaps)[::-1] ** (2.0 / 3.0))
y = np.linspace(overlaps[-1], overlaps[0], 2001)
cluster_force = roots(y) ** 1.5
cluster_stiffness = 1.5 * np.sqrt(roots(y)) * roots(y, 1)

loads = np.geomspace(0.02, 2.0, 11)  # f*
simulation = gp.DirectSimulation(packing, shape=(64, 64), samples=4, geometry="lattice")
arrays = simulation.at_force(loads * unit)
reference = arrays.normal_stiffness * packing.width / unit
chance = arrays.standard_error("normal_stiffness") / arrays.normal_stiffness
medium = gp.EffectiveMedium(packing).at_force(loads * unit)
errors = {
    "effective medium": medium.normal_stiffness / arrays.normal_stiffness - 1.0,
    "cluster of seven balls": np.interp(loads, cluster_force, cluster_stiffness) / reference - 1.0,
}
for name, error in errors.items():
    print(f"{name}: off by {error[0]:.1%} at f* = {loads[0]:.2g}, {error[3]:.1%} at {loads[3]:.2g}")
    assert np.all(np.abs(error[loads > 0.5]) < 0.005)

# many more clusters, each at rest, have 0.57347; the effective medium has 0.5590
stiffness = np.interp(0.1, cluster_force, cluster_stiffness)
print(f"k* of the cluster at f* = 0.1: {stiffness:.4f}")
assert np.isclose(stiffness, 0.57347, rtol=5e-3)
assert np.all(np.abs(errors["cluster of seven balls"][loads > 0.07]) < 0.01)
assert np.isclose(errors["cluster of seven balls"][0], 0.04, atol=0.01)
assert np.isclose(errors["effective medium"][0], -0.24, atol=0.01)

with matplotlib.rc_context(STYLE):
    figure, (upper, lower) = plt.subplots(
        2, figsize=(3.6, 4.0), dpi=300, layout="constrained", sharex=True
    )
    equal = 1.5 * np.cbrt(loads)  # k* of equal balls
    looks = (("#0072B2", "--"), ("#D55E00", "-"))
    for (name, error), (colour, dashes) in zip(errors.items(), looks, strict=True):
        line = {"color": colour, "linestyle": dashes, "linewidth": 1.2, "label": name}
        upper.semilogx(loads, (1.0 + error) * reference / equal, **line)
        lower.semilogx(loads, 100.0 * error, **line)
    points = {"fmt": "o", "color": "black", "mfc": "white", "markersize": 3.5, "zorder": 3}
    upper.errorbar(loads, reference / equal, chance * reference / equal, label="arrays", **points)
    lower.errorbar(loads, 0.0 * loads, 100.0 * chance, **points)
    upper.set(ylabel="Stiffness over that\nof equal balls")
    upper.legend(loc="lower right")
    lower.set(xlabel="Reduced force $f^*$", ylabel="Medium over\narrays − 1 (%)")
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
