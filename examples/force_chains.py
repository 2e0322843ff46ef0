"""How does an array of balls that differ carry its load? Force chains, far from the rigidity threshold and close to it.

The picture: contact forces in a periodic array of 48 x 48 steel balls, as wide and as dark as their part of the mean force,
when nearly all contacts are closed (left) and just above the load at which the array gives way (right). Below them, how the
forces of four such arrays are distributed. Close to the threshold half of the contacts and one ball in eight carry
nothing, and a tenth of the contacts carries nearly half of the load, along lines some balls long.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import granphon as gp
from granphon.charts import plot_force_distribution, plot_forces
from granphon.geometry import TRIANGULAR
from granphon.plot import STYLE

SPACING = np.array([1.0, 0.38])  # a*; the threshold is 0.343


def unbalanced(sample: gp.Sample) -> float:
    """The largest force left on a ball, over the mean contact force, summed contact by contact."""
    table, forces = TRIANGULAR.contacts, sample.contact_forces
    total = np.zeros((*forces.shape[:2], 2))
    for c, (p, q) in enumerate(table.shift.tolist()):
        push = forces[..., c, None] * table.normal[c]
        total += np.roll(push, (p, q), (0, 1)) - push
    return float(np.max(np.hypot(*np.moveaxis(total, -1, 0))) / sample.force)


def idle(sample: gp.Sample) -> float:
    """The part of the balls that carry nothing."""
    return float(np.mean(sample.atoms().arrays["contacts"] == 0))


def along(sample: gp.Sample, steps: int) -> float:
    """Correlation of the forces of contacts on one straight line, so many balls apart; mean of the three directions."""
    forces, shifts = sample.contact_forces, TRIANGULAR.contacts.shift.tolist()
    pairs = [(forces[..., c], np.roll(forces[..., c], (-p * steps, -q * steps), (0, 1))) for c, (p, q) in enumerate(shifts)]
    return float(np.mean([np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in pairs]))


def check(packed: gp.SimulatedState, loose: gp.SimulatedState) -> None:
    """The balance of every ball, and the numbers above."""
    assert max(map(unbalanced, (*packed.samples, *loose.samples))) < 1e-9
    assert packed.contact_fraction > 0.99
    assert max(map(idle, packed.samples)) == 0.0
    assert abs(loose.contact_fraction - 0.51) < 0.01
    assert 0.11 < np.mean(loose.over_samples(idle)) < 0.14
    for state, part in ((packed, 0.18), (loose, 0.47)):
        forces = np.sort(state.over_samples(lambda sample: sample.contact_forces.ravel()), axis=-1)
        assert abs(np.sum(forces[:, -forces.shape[-1] // 10 :]) / np.sum(forces) - part) < 0.01
    # chains are short, and longer near the threshold: three balls away a correlation of 0.1 is left, and there of 0.3
    for state, expected in ((packed, [0.50, 0.22, 0.10, 0.01]), (loose, [0.69, 0.45, 0.29, 0.02])):
        found = state.over_samples(lambda sample: [along(sample, steps) for steps in (1, 2, 3, 8)])
        assert np.allclose(np.mean(found, axis=0), expected, atol=0.03)


def main(out: Path | None = None) -> Figure:
    """Compute, check, draw; write the figure to ``out`` if it is given."""
    steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    packing = gp.Packing(steel, diameter=8e-3, spread=gp.Uniform(2.04e-6))
    simulation = gp.DirectSimulation(packing, shape=(48, 48), samples=4)
    packed, loose = (simulation.at_overlap(packing.width * (spacing - 0.5)) for spacing in SPACING)
    check(packed, loose)

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 5.4), dpi=300, layout="constrained")
        above, below = figure.subplots(2, 2, height_ratios=[2.2, 1.0])
        for state, chains, forces in zip((packed, loose), above, below, strict=True):
            plot_forces(state.sample, chains)
            plot_force_distribution(state, forces)
    if out is not None:
        figure.savefig(out)
    return figure


if __name__ == "__main__":
    main(Path("force_chains.png"))
