"""What the page on disorder in space says of simulated crystals, from runs too long for the tests.

    python tests/benchmarks/study_space.py [--json FILE] [--only PART ...]

Some ten minutes on one processor. Seeds are given: numbers are the same on any machine. The exit
code is 1 if a number is not what the page claims. Balls of steel of 8 mm, spread uniformly over
2.04 um; brackets hold the standard error of the last digits.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray
from side_by_side import Part, Row, bracketed, command_line, measured
from study_simulation import DIAMETER, STEEL, UNIT, WIDTH, judged, mean_and_error

import granphon as gp
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest
from granphon.array.stencils import Stencils
from granphon.balls.lattices import Lattice, find_lattice
from granphon.dynamics.elasticity import bulk_and_shear

Array = NDArray[np.float64]
#: cells along each axis, and samples
SHAPES = {"triangular": ((64, 64), 8), "fcc": ((14, 14, 14), 4), "hcp": ((11, 11, 11), 3)}
#: f*
FORCE = np.array([0.003, 0.01, 0.04, 0.15, 0.6, 3.0])
#: exponents with friction and their errors, by lattice, at FORCE
EXPONENTS = {
    "triangular": (
        (0.263, 7e-3),
        (0.289, 7e-3),
        (0.278, 2e-3),
        (0.2376, 5e-4),
        (0.17853, 1e-4),
        (0.167807, 5e-6),
    ),
    "fcc": (
        (0.274, 4e-3),
        (0.290, 6e-3),
        (0.305, 2e-3),
        (0.2618, 8e-4),
        (0.18039, 2e-4),
        (0.168018, 2e-5),
    ),
}
#: G/K with friction over that of equal balls, by lattice, at FORCE
RATIOS = {
    "triangular": (
        (0.403, 7e-3),
        (0.571, 3e-3),
        (0.802, 2e-3),
        (0.9484, 2e-4),
        (0.99581, 3e-5),
        (0.999571, 2e-6),
    ),
    "fcc": (
        (0.582, 4e-3),
        (0.702, 4e-3),
        (0.860, 2e-3),
        (0.9640, 6e-4),
        (0.99727, 5e-5),
        (0.999719, 4e-6),
    ),
}
#: arrays of which the threshold is found: cells along each axis, and samples
THRESHOLDS = {
    "fcc": (((8, 8, 8), 32), ((12, 12, 12), 16), ((16, 16, 16), 16), ((20, 20, 20), 10)),
    "hcp": (((8, 8, 5), 24), ((12, 12, 7), 12), ((16, 16, 10), 6)),
}
#: cells along the side of an array in which rows carry the least of :data:`LOW_FORCES`
LEAST_SIDE = 8
#: f* near the threshold
LOW_FORCES = np.array([1e-2, 3e-3, 1e-3, 3e-4, 1e-4])
#: a* and contacts of a ball at no load
NO_LOAD = {"fcc": (0.2727, 3.291), "hcp": (0.2778, 4.404)}


def packing(lattice: str, friction: bool = True) -> gp.Packing:
    return gp.Packing(STEEL, DIAMETER, gp.Uniform(WIDTH), lattice=lattice, friction=friction)


def loads(repeats: int) -> list[Row]:
    """Exponent, G/K, contacts, and the medium, against the load."""
    rows = []
    for lattice, (shape, samples) in SHAPES.items():
        state = gp.DirectSimulation(
            packing(lattice), shape, samples=samples, geometry="lattice"
        ).at_force(FORCE * UNIT)
        equal = gp.moduli(gp.AveragedLattice(packing(lattice)).at_force(1.0)).voigt
        moduli = state.over_samples(lambda one: bulk_and_shear(one.elastic_tensor))
        ratio = mean_and_error(
            np.moveaxis(moduli[..., 1] / moduli[..., 0], 1, 0) * equal.bulk / equal.shear
        )
        contacts = mean_and_error(
            np.moveaxis(state.over_samples(lambda one: one.contact_fraction()), 1, 0)
        )
        medium = (
            gp.EffectiveMedium(packing(lattice, friction=False)).law.force(state.overlap)
            / state.force
        )
        medium_error = state.standard_error("overlap") * state.normal_stiffness / state.force
        for at, force in enumerate(FORCE.tolist()):
            of = f"{lattice}, f* = {force:g}"
            exponent = state.exponent[at]
            error = state.exponent_error[at]
            if lattice in EXPONENTS:
                rows += judged(f"{of}: exponent", exponent, error, EXPONENTS[lattice][at][0])
                rows += judged(
                    f"{of}: G/K over that of equal balls",
                    ratio[0][at],
                    ratio[1][at],
                    RATIOS[lattice][at][0],
                )
            else:
                rows.append(measured(f"{of}: exponent", exponent, error))
                rows.append(
                    measured(f"{of}: G/K over that of equal balls", ratio[0][at], ratio[1][at])
                )
            found = contacts[0][at], max(contacts[1][at], 1e-9)
            rows.append(
                Row(
                    f"{of}: part of the contacts that carries load",
                    found[0],
                    note=bracketed(*found),
                )
            )
            found = float(medium[at]), float(medium_error[at])
            rows.append(
                Row(
                    f"{of}: force of the medium over the simulated",
                    found[0],
                    note=bracketed(*found),
                )
            )
    return rows


def at_no_load(lattice: Lattice, shape: tuple[int, ...], seed: int) -> tuple[Array, Array]:
    """a* and the contacts of a ball in a sample: at no load, by polynomials in f*^(2/3), as
    overlaps go; and at each f*.
    """
    stencils = Stencils(shape, lattice=lattice)
    state = None
    found = []
    balls = (*shape, lattice.n_balls) if lattice.n_balls > 1 else shape
    x = gp.Uniform(1.0).sample(balls, seed).reshape(stencils.ball_shape)
    x -= np.mean(x)
    # in a small array rows of balls that touch themselves across the edges, and cannot give way,
    # carry the least load alone
    forces = LOW_FORCES[:-1] if shape[0] <= LEAST_SIDE else LOW_FORCES
    for force in forces.tolist():
        state = bring_to_rest(x, ReducedLoad(force=force), stencils, state)
        found.append(
            (state.overlap + 0.5, lattice.coordination * np.mean(state.forces > 1e-6 * state.force))
        )
    return np.polynomial.polynomial.polyfit(forces ** (2.0 / 3.0), found, 2)[0], np.array(found)


def threshold(repeats: int) -> list[Row]:
    """Overlap and contacts of a ball at no load, for arrays of several sizes, and what they tend
    to.
    """
    rows = []
    for name, sizes in THRESHOLDS.items():
        lattice = find_lattice(name)
        large = []
        for shape, samples in sizes:
            every = [at_no_load(lattice, shape, 1000 + seed) for seed in range(samples)]
            means, errors = mean_and_error(np.array([limit for limit, _ in every]))
            of = f"{name}, {samples} samples of {'x'.join(map(str, shape))}"
            rows.append(measured(f"{of}: a* at no load", means[0], errors[0]))
            rows.append(measured(f"{of}: contacts of a ball at no load", means[1], errors[1]))
            low, low_error = mean_and_error(np.array([found[-1, 1] for _, found in every]))
            if shape[0] > LEAST_SIDE:
                what = f"{of}: contacts of a ball at f* = {LOW_FORCES[-1]:g}"
                rows.append(measured(what, low, low_error))
                large.append((1.0 / shape[0], means, errors))
        sides, means, errors = (np.array(part) for part in zip(*large, strict=True))
        for at, (what, claimed) in enumerate(
            zip(("a*", "contacts of a ball"), NO_LOAD[name], strict=True)
        ):
            weights = errors[:, at] ** -2
            mean = float(weights @ means[:, at] / weights.sum())
            error = float(weights.sum() ** -0.5)
            rows += judged(f"{name}, all but the smallest: {what} at no load", mean, error, claimed)
            # a line in the inverse side, by weighted least squares
            line, covariance = np.polyfit(
                sides, means[:, at], 1, w=1.0 / errors[:, at], cov="unscaled"
            )
            note = bracketed(float(line[1]), float(covariance[1, 1] ** 0.5))
            rows.append(
                Row(f"{name}, by a line in 1/L: {what} at no load", float(line[1]), note=note)
            )
    return rows


PARTS: dict[str, Part] = {"loads": loads, "threshold": threshold}

if __name__ == "__main__":
    sys.exit(command_line("Study of disorder in space", PARTS))
