"""Force chains near the rigidity threshold
========================================

How does an array of balls of different diameters carry its load? Lines are contact forces in
periodic arrays of 48 x 48 steel balls; the larger the force, the wider and darker the line. On the
left nearly all contacts are closed; on the right the load is just above that at which the array
loses its rigidity. Below, the distribution of the forces in four such arrays.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import granphon as gp
from granphon.balls.lattices import TRIANGULAR
from granphon.figures.forces import plot_force_distribution, plot_forces
from granphon.figures.style import STYLE

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, diameter=8e-3, spread=gp.Uniform(2.04e-6), friction=False)
simulation = gp.DirectSimulation(packing, shape=(48, 48), samples=4)
# a*; it fails at 0.343
packed, loose = (simulation.at_overlap(packing.width * (spacing - 0.5)) for spacing in (1.0, 0.38))
SHIFTS = TRIANGULAR.contacts.shift.tolist()

# %% Close to the threshold half of the contacts and one ball in eight carry no load, and a tenth of
# the contacts carries nearly half of it.

idle = loose.over_samples(lambda sample: np.mean(sample.atoms().arrays["contacts"] == 0))
print(
    f"contacts that carry: {packed.contact_fraction:.3f}, {loose.contact_fraction:.2f}; idle"
    f" balls: {np.mean(idle):.2f}"
)
assert packed.contact_fraction > 0.99
assert all(np.all(sample.atoms().arrays["contacts"] > 0) for sample in packed.samples)
assert abs(loose.contact_fraction - 0.51) < 0.01
assert 0.11 < np.mean(idle) < 0.14
for state, share in ((packed, 0.18), (loose, 0.47)):
    forces = np.sort(state.over_samples(lambda sample: sample.contact_forces.ravel()), axis=-1)
    assert abs(np.sum(forces[:, -forces.shape[-1] // 10 :]) / np.sum(forces) - share) < 0.01

# %% Chains of large forces are short, though longer near the threshold. The forces of two contacts
# on one straight line, three balls apart, have a correlation of 0.1, and of 0.3 near the threshold.
# Every ball is in balance: the forces on it add up to zero.


def along(sample, steps):
    """Correlation of the forces of contacts on one line, at a distance in balls; mean of the three
    directions.
    """
    forces = sample.contact_forces
    pairs = [
        (forces[..., c], np.roll(forces[..., c], (-p * steps, -q * steps), (0, 1)))
        for c, (p, q) in enumerate(SHIFTS)
    ]
    return np.mean([np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in pairs])


def unbalanced(sample):
    """The largest force left on a ball, over the mean contact force."""
    pushes = [
        sample.contact_forces[..., c, None] * normal
        for c, normal in enumerate(TRIANGULAR.contacts.normal)
    ]
    total = sum(
        np.roll(push, (p, q), (0, 1)) - push for push, (p, q) in zip(pushes, SHIFTS, strict=True)
    )
    return np.max(np.linalg.norm(total, axis=-1)) / sample.force


for state, expected in ((packed, [0.50, 0.22, 0.10, 0.01]), (loose, [0.69, 0.45, 0.29, 0.02])):
    correlations = state.over_samples(
        lambda sample: [along(sample, steps) for steps in (1, 2, 3, 8)]
    )
    assert np.allclose(np.mean(correlations, axis=0), expected, atol=0.03)
    assert max(map(unbalanced, state.samples)) < 1e-9

with matplotlib.rc_context(STYLE):
    figure, axes = plt.subplots(
        2, 2, figsize=(7.0, 5.4), dpi=300, layout="constrained", height_ratios=[2.2, 1.0]
    )
    for state, chains, forces in zip((packed, loose), *axes, strict=True):
        plot_forces(state.sample, chains)
        plot_force_distribution(state, forces)
if "-o" in sys.argv:
    figure.savefig(sys.argv[-1])
