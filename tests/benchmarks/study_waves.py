"""What the page on waves in arrays says of attenuation, from runs too long for the tests.

    python tests/benchmarks/study_waves.py [--json FILE] [--only PART ...]

Some minutes on one processor. Seeds are given: numbers are the same on any machine. The exit code
is 1 if a number is not what the page claims. Balls of steel of 8 mm, spread uniformly over 2.04 um,
with friction.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from side_by_side import Part, Row, command_line
from study_simulation import DIAMETER, STEEL, WIDTH

import granphon as gp

#: lattice, cells, samples, wave vectors along one period in units of 2 pi over the array,
#: resolution in Hz, f*
CASES: dict[str, tuple[tuple[int, ...], int, tuple[int, ...], float, float]] = {
    "triangular": ((160, 160), 3, (10, 12, 15, 18), 15.0, 0.1),
    "fcc": ((30, 30, 30), 2, (4, 5, 6, 7), 40.0, 0.1),
}
#: power of the frequency that Rayleigh's scattering has, and how far from it a fit over these wave
#: vectors may lie
RAYLEIGH = {"triangular": 3.0, "fcc": 4.0}
NEAR = 0.8


def spectra(lattice: str, polarisation: str) -> tuple[Any, Any]:
    """(samples, waves) peaks, Hz, and attenuations, 1/m."""
    shape, samples, numbers, resolution, force = CASES[lattice]
    packing = gp.Packing(STEEL, DIAMETER, gp.Uniform(WIDTH), lattice=lattice)
    state = gp.DirectSimulation(
        packing, shape, seed=1, samples=samples, geometry="lattice"
    ).at_force(force * packing.width_units.force)
    vectors = packing.structure.vectors
    reciprocal = 2.0 * np.pi * np.linalg.inv(vectors).T / DIAMETER
    # along Gamma-K in the plane, along a cube's edge in space
    along = (
        np.array([1.0, 0.0]) * 2.0 * np.pi / DIAMETER
        if lattice == "triangular"
        else reciprocal[0] + reciprocal[1]
    )
    found = []
    for sample in state.samples:
        waves = gp.Waves(sample)
        q = waves.nearest_wavevectors(np.array(numbers)[:, None] / shape[0] * along)
        one = waves.spectral_function(q, polarisation, resolution)
        found.append((one.peak, np.pi * one.width / one.phase_velocity))
    peaks, attenuation = np.moveaxis(found, 1, 0)
    return peaks, attenuation


def attenuation(repeats: int) -> list[Row]:
    """Power of the frequency with which the attenuation grows."""
    rows = []
    for lattice, polarisation in (
        ("triangular", "longitudinal"),
        ("triangular", "transverse"),
        ("fcc", "longitudinal"),
    ):
        peaks, found = spectra(lattice, polarisation)
        x = np.log(peaks.mean(axis=0))
        y = np.log(found.mean(axis=0))
        power = float(np.polyfit(x, y, 1)[0])
        single = [np.polyfit(np.log(f), np.log(a), 1)[0] for f, a in zip(peaks, found, strict=True)]
        error = float(np.std(single, ddof=1) / np.sqrt(len(single)))
        of = f"{lattice}, {polarisation}, {np.exp(x[0]) / 1e3:.2g} to {np.exp(x[-1]) / 1e3:.2g} kHz"
        rows += [
            Row(
                f"{of}: power of the frequency",
                power,
                note=f"± {error:.2g} over {len(single)} samples",
            ),
            Row(
                f"{of}: distance from {RAYLEIGH[lattice]:g}",
                abs(power - RAYLEIGH[lattice]),
                "",
                NEAR,
            ),
            Row(
                f"{of}: mean free path of the slowest wave",
                float(0.5 / found.mean(axis=0)[0] / DIAMETER),
                "diameters",
            ),
        ]
    return rows


PARTS: dict[str, Part] = {"attenuation": attenuation}

if __name__ == "__main__":
    sys.exit(command_line("Study of waves in arrays", PARTS))
