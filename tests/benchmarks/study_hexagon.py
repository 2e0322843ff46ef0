"""What the page on the experiment says of pulses through a hexagon of balls, from runs too long for
the tests.

    python tests/benchmarks/study_hexagon.py [--json FILE] [--only PART ...]

Some minutes on one processor. Seeds are given: numbers are the same on any machine. The exit code
is 1 if a number is not what the page claims. Balls of steel of 8 mm, 31 on a side, spread uniformly
over 2.04 um; the pulse of five periods of 6.5 kHz goes from one side to the opposite one. Brackets
hold the standard error of the last digits.
"""

from __future__ import annotations

import math
import sys
from functools import cache

import numpy as np
from side_by_side import Part, Row, bracketed, command_line, measured
from study_simulation import DIAMETER, PACKINGS, STEEL, WIDTH, judged, mean_and_error

import granphon as gp

SIDE_FORCE = np.geomspace(100.0, 990.0, 7)
N = 31
SAMPLES = 16
FREQUENCY = 6500.0
ALONG = (0.0, 1.0)
LENGTH = 2 * (N - 1) * math.sqrt(0.75) * DIAMETER
METHODS = ("envelope", "first", "correlation")
#: velocity by the envelope, and its standard error, m/s, at SIDE_FORCE
CLAIMED = (
    (432.0, 2.0),
    (488.0, 1.0),
    (542.0, 1.0),
    (597.7, 0.7),
    (648.9, 0.4),
    (695.9, 0.3),
    (743.6, 0.3),
)
#: widths of fits, um, by what is taken for the measured velocity
WIDTHS = {
    "the envelope, as a long wave": 4.94,
    "the envelope, as a group": 3.86,
    "the envelope, calibrated": 2.25,
}


@cache
def pulses(force: float, seed: int | None) -> tuple[float, gp.Pulse]:
    """The mean contact force, and the pulse through a hexagon; equal balls without a seed."""
    packing = gp.Packing(STEEL, DIAMETER) if seed is None else PACKINGS[True]
    pressed = gp.Hexagon(packing, N, seed=seed or 0).at_side_force(force)
    return pressed.force, gp.Waves(pressed).transmit(FREQUENCY, ALONG, LENGTH)


@cache
def velocities(method: str) -> tuple[np.ndarray, np.ndarray]:
    """(loads, samples) velocities through hexagons of balls that differ, and (loads,) of equal
    balls, m/s.
    """
    forces = SIDE_FORCE.tolist()
    found = [
        [one.distance / one.arrival(method) for one in (pulses(f, s)[1] for s in range(SAMPLES))]
        for f in forces
    ]
    equal = [one.distance / one.arrival(method) for one in (pulses(f, None)[1] for f in forces)]
    return np.array(found), np.array(equal)


def contact_forces() -> np.ndarray:
    return np.array([pulses(f, None)[0] for f in SIDE_FORCE.tolist()])


def group(medium: type[gp.Medium], packing: gp.Packing) -> np.ndarray:
    """Group velocities of the pulse in a medium, m/s."""
    of = medium(packing)
    return np.array(
        [
            gp.pulse_velocities(of.at_force(f), FREQUENCY, ALONG).group[0]
            for f in contact_forces().tolist()
        ]
    )


def arrivals(repeats: int) -> list[Row]:
    """Velocities by time of flight, beside those of the lattice and of the medium."""
    rows = []
    equal = gp.Packing(STEEL, DIAMETER)
    media = {
        "ideal": (gp.AveragedLattice, equal),
        "effective medium": (gp.EffectiveMedium, PACKINGS[True]),
    }
    for name, (medium, packing) in media.items():
        long = gp.sound_velocities(medium(packing).at_force(contact_forces()), ALONG).longitudinal
        for force, v, g in zip(
            SIDE_FORCE.tolist(), long.tolist(), group(medium, packing).tolist(), strict=True
        ):
            rows += [
                Row(f"{force:.4g} N: {name}, long waves", v, "m/s"),
                Row(f"{force:.4g} N: {name}, group", g, "m/s"),
            ]
    for method in METHODS:
        found, alike = velocities(method)
        value, error = mean_and_error(found.T)
        for at, force in enumerate(SIDE_FORCE.tolist()):
            of = f"{force:.4g} N: by {method}"
            if method == "envelope":
                rows += judged(of, value[at], error[at], CLAIMED[at][0])
            else:
                rows.append(measured(of, value[at], error[at], "m/s"))
            rows.append(Row(f"{of}, equal balls", alike[at], "m/s"))
    for force in SIDE_FORCE.tolist():
        every = [pulses(force, seed)[1] for seed in range(SAMPLES)]
        scatter = np.mean([np.std(one.arrivals()) / one.time_of_flight for one in every])
        coherent = np.mean([one.coherent_fraction for one in every])
        rows.append(
            Row(f"{force:.4g} N: scatter of single balls over the time of flight", float(scatter))
        )
        rows.append(Row(f"{force:.4g} N: coherent part of the signal's energy", float(coherent)))
    return rows


def widths(repeats: int) -> list[Row]:
    """The width that a fit of the effective medium finds from these velocities."""
    rows = []
    ideal = group(gp.AveragedLattice, gp.Packing(STEEL, DIAMETER))
    for method in METHODS:
        found, alike = velocities(method)
        value, error = mean_and_error(found.T)
        name = {
            "envelope": "the envelope",
            "first": "the first arrival",
            "correlation": "the correlation",
        }[method]
        for words, v, s, f in (
            ("as a long wave", value, error, None),
            ("as a group", value, error, FREQUENCY),
            ("calibrated", value / alike * ideal, error / alike * ideal, FREQUENCY),
        ):
            fit = gp.fit_width(PACKINGS[True], contact_forces(), v, s, f)
            width = 1e6 * fit.values[0]
            uncertain = 1e6 * math.sqrt(fit.covariance[0, 0])
            of = f"{name}, {words}"
            note = f"{bracketed(width, uncertain)}, chi2 {fit.chi2:.3g} of {fit.dof}"
            rows.append(Row(f"width by {of}", float(width), "um", note=note))
            if of in WIDTHS:
                far = abs(width - WIDTHS[of])
                rows.append(
                    Row(f"width by {of}: distance from {WIDTHS[of]}", float(far), "um", 0.1)
                )
    return [*rows, Row("width of the balls", 1e6 * WIDTH, "um")]


PARTS: dict[str, Part] = {"arrivals": arrivals, "widths": widths}

if __name__ == "__main__":
    sys.exit(command_line("Study of pulses through a hexagon", PARTS))
