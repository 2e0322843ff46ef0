"""Benchmarks of derivatives: modes of samples of some ten thousand contacts with their derivatives
by all contacts and balls, over the modes alone.
"""

from __future__ import annotations

import statistics

from side_by_side import Part, Row, spend

import granphon as gp

#: number of modes
COUNT = 10
#: lattices and cells of samples of some ten thousand contacts
SAMPLES = {"triangular": (58, 58), "fcc": (12, 12, 12)}


def sensitivities(repeats: int) -> list[Row]:
    """Modes with derivatives, over modes alone, by the processor's time."""
    rows = []
    for lattice, shape in SAMPLES.items():
        steel = gp.Material(211.65e9, 0.276, 7840.0)
        packing = gp.Packing(steel, 8e-3, gp.Uniform(2.04e-6), lattice=lattice)
        network = gp.DirectSimulation(packing, shape, seed=3).at_force(10.0).sample.network
        runs = []
        for _ in range(max(1, repeats // 2)):
            modes, alone = spend(lambda network=network: gp.Waves(network).modes(COUNT))
            found, more = spend(lambda modes=modes: modes.sensitivities)
            assert found.normal_stiffness.shape == (COUNT, network.n_contacts)
            runs.append((alone["busy"], more["busy"]))
        alone, more = (statistics.median(times) for times in zip(*runs, strict=True))
        cells = " x ".join(map(str, shape))
        what = (
            f"{COUNT} modes of {cells} cells in {lattice} with rotations, derivatives by"
            f" {network.n_contacts:,} contacts: over the modes alone"
        )
        note = f"{alone:.3g} s, and {more:.2g} s for derivatives"
        rows.append(Row(what, 1.0 + more / alone, bound=2.0, note=note))
    return rows


PARTS: dict[str, Part] = {"sensitivities": sensitivities}
