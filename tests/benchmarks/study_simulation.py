"""What the pages say of the simulated array and of the effective medium, from runs too long for the
tests.

    python tests/benchmarks/study_simulation.py [--json FILE] [--only PART ...]

Half an hour on one processor. Seeds are given, so that all but the seconds of ``loads`` and
``lists`` is the same on any machine; the exit code is 1 if a number is not what the pages
claim. Balls of steel, spread uniformly unless it is said; brackets hold the standard error of the
last digits.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from side_by_side import Part, Row, bracketed, command_line, measured

import granphon as gp
from granphon.array.equilibrium import Equilibrium
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest
from granphon.balls.loads import Load
from granphon.dynamics.elasticity import bulk_and_shear
from granphon.dynamics.local_field import local_field
from granphon.laws.effective import effective_curve
from granphon.media.simulation import SimulatedState

Array = NDArray[np.float64]
STEEL = gp.Material(211.65e9, 0.276, 7840.0)
DIAMETER = 8e-3
WIDTH = 2.04e-6
#: friction, and without
PACKINGS = {f: gp.Packing(STEEL, DIAMETER, gp.Uniform(WIDTH), friction=f) for f in (True, False)}
#: N, of f*
UNIT = float(PACKINGS[True].law.coefficient * WIDTH**1.5)
#: standard errors within which two numbers agree
AGREE = 3.0
#: rigidity threshold that the paper quotes, a*, and how near to it ours must be
THRESHOLD = 0.343
NEAR = 2e-3
#: of random diameters
LISTS = 500


def seeds(first: int, count: int) -> range:
    """Samples share balls where they share a seed: each size has its own."""
    return range(1000 * first, 1000 * first + count)


def at_rest(length: int, seed: int, loads: Sequence[ReducedLoad]) -> list[Equilibrium]:
    """One sample under some loads, each found from the one before."""
    x = gp.Uniform(1.0).sample((length, length), seed)
    x -= np.mean(x)
    states: list[Equilibrium] = []
    for load in loads:
        states.append(bring_to_rest(x, load, None, states[-1] if states else None))
    return states


def mean_and_error(values: Array) -> tuple[Array, Array]:
    """Over the first axis."""
    return np.mean(values, axis=0), np.std(values, axis=0, ddof=1) / math.sqrt(len(values))


def judged(what: str, value: float, error: float, claimed: float) -> list[Row]:
    """A number, and how far it is from what is claimed."""
    apart = abs(value - claimed) / error
    return [
        measured(what, value, error),
        Row(f"{what}: distance from {claimed:g} in standard errors", float(apart), "", AGREE),
    ]


def threshold_by(what: str, value: float, error: float) -> Row:
    """An estimate of the threshold: how far it is from the one quoted."""
    far = abs(float(value) - THRESHOLD)
    return Row(
        f"threshold by {what}: distance from {THRESHOLD}",
        far,
        "",
        NEAR,
        note=bracketed(float(value), float(error)),
    )


# -- how large an array must be --------------------------------------------------------------------

#: balls along a side, and samples
SIZES = {24: 48, 48: 24, 96: 8, 128: 8}


def sizes(repeats: int) -> list[Row]:
    """Bulk and shear moduli of small arrays against those of 128 x 128, with friction and
    without.
    """
    force = np.array([3.0, 1.0, 0.3, 0.08, 0.02]) * UNIT
    worst = 0.0
    pairs = 0
    rows = []
    for friction, packing in PACKINGS.items():
        found = []
        for length, samples in SIZES.items():
            simulation = gp.DirectSimulation(
                packing, (length, length), 1000 * length, samples, geometry="lattice"
            )
            moduli = simulation.at_force(force).over_samples(
                lambda one: bulk_and_shear(one.elastic_tensor)
            )
            found.append(mean_and_error(np.moveaxis(moduli, 1, 0)))
        *small, (large, error) = found
        for mean, own in small:
            apart = np.abs(mean - large) / np.hypot(own, error)
            worst = max(worst, float(np.max(apart)))
            pairs = pairs + apart.size
        rows.append(
            Row(
                f"G of {128}x{128} balls at f* = 0.02,"
                f" {'friction' if friction else 'no friction'}: its standard error",
                float(error[-1, 1] / large[-1, 1]),
            )
        )
    what = (
        "K and G of 24x24, 48x48, 96x96 balls against 128x128, f* = 0.02 to 3: largest difference"
        " in standard errors"
    )
    return [Row(what, worst, "", AGREE, note=f"of {pairs}"), *rows]


def scatter(repeats: int) -> list[Row]:
    """f* at given a* from one sample to another, relative."""
    rows = []
    for length, spacing, count, claimed in (
        (64, 1.0, 64, 7e-4),
        (64, 0.36, 64, 0.17),
        (128, 0.36, 24, 0.08),
    ):
        force = np.array(
            [
                at_rest(length, seed, [ReducedLoad(overlap=spacing - 0.5)])[0].force
                for seed in seeds(length, count)
            ]
        )
        part = float(np.std(force, ddof=1) / np.mean(force))
        what = (
            f"f* at a* = {spacing:g} of {length}x{length} balls: standard deviation of {count}"
            f" samples, of the mean"
        )
        rows += judged(what, part, part / math.sqrt(2.0 * count), claimed)
    return rows


# -- the threshold of rigidity ---------------------------------------------------------------------


def zero_of(spacing: Array, power: Array, order: int) -> float:
    """a* at which f*^(2/3) vanishes: the root next to the points."""
    roots = np.polynomial.Polynomial.fit(spacing, power, order).roots()
    below = roots[np.isreal(roots) & (roots.real < spacing.min())].real
    return float(np.max(below))


def threshold(repeats: int) -> list[Row]:
    """By fits to f*^(2/3) over a* at 128 x 128, a sample at a time."""
    spacing = np.arange(0.380, 0.3545, -0.0025)
    zeros = []
    for seed in seeds(128, 6):
        states = at_rest(
            128,
            seed,
            [ReducedLoad(overlap=0.0), *(ReducedLoad(overlap=a - 0.5) for a in spacing.tolist())],
        )[1:]
        power = np.array([state.force for state in states]) ** (2.0 / 3.0)
        near = spacing < 0.3701
        zeros.append((zero_of(spacing, power, 2), zero_of(spacing[near], power[near], 1)))
    names = "a parabola through f*^(2/3) from 0.355 to 0.38", "a straight line from 0.355 to 0.37"
    return [
        threshold_by(f"{name}, six samples of 128x128", value, error)
        for name, value, error in zip(names, *mean_and_error(np.array(zeros)), strict=True)
    ]


def contacts(repeats: int) -> list[Row]:
    """Overlap and contacts of a ball at no load: polynomials in f*^(2/3), which overlaps go as; 64
    x 64.
    """
    forces = np.array([1e-2, 3e-3, 1e-3, 3e-4, 1e-4])
    kept = []
    at_no_load = []
    for seed in seeds(64, 40):
        states = at_rest(64, seed, [ReducedLoad(force=f) for f in forces.tolist()])
        rows = [
            (state.overlap + 0.5, 6.0 * np.mean(state.forces > 1e-6 * state.force))
            for state in states
        ]
        kept.append(rows)
        at_no_load.append(np.polynomial.polynomial.polyfit(forces ** (2.0 / 3.0), rows, 2)[0])
    (spacing, number), (error, uncertain) = mean_and_error(np.array(at_no_load))
    low, low_error = mean_and_error(np.array(kept)[:, -1, 1])
    of = "40 samples of 64x64"
    return [
        threshold_by(f"a polynomial down to f* = 1e-4, {of}", spacing, error),
        *judged(f"contacts of a ball at no load, {of}", number, uncertain, 2.37),
        *judged(f"contacts of a ball at f* = 1e-4, {of}", low, low_error, 2.46),
    ]


# -- the conjecture on friction --------------------------------------------------------------------

#: the velocity that the medium has to 1.1 %
KEPT = (True, "transverse")
FORCES = np.array([0.008, 0.02, 0.04, 0.08, 0.15, 0.25, 0.4, 0.6, 1.0, 3.0])


#: up to where the moduli in the directions of the lattice and in true ones agree
LOW_FORCES = FORCES[FORCES < 0.2]


def ratios(state: SimulatedState, of: str) -> list[Row]:
    """2G/(1 + eta)K of the samples at each load."""
    moduli = state.over_samples(lambda one: bulk_and_shear(one.elastic_tensor))
    ratio = 2.0 / (1.0 + state.packing.mindlin_ratio) * moduli[..., 1] / moduli[..., 0]
    return [
        measured(f"2G/(1 + η)K at f* = {f:.3g}, {of}", mean, error)
        for f, mean, error in zip(state.reduced_force, *mean_and_error(ratio.T), strict=True)
    ]


def conjecture(repeats: int) -> list[Row]:
    """The table of the page: 2G/(1 + eta)K over f*, also in true directions, and what it says of
    velocities.
    """
    rows = []
    bulk = {}
    for friction, packing in PACKINGS.items():
        state = gp.DirectSimulation(packing, (64, 64), 0, 4, geometry="lattice").at_force(
            FORCES * UNIT
        )
        true = gp.DirectSimulation(packing, (64, 64), 0, 4, geometry="exact").at_force(
            LOW_FORCES * UNIT
        )
        of = "steel" if friction else "no friction"
        rows += [*ratios(state, of), *ratios(true, f"{of}, in true directions")]
        bulk[friction] = gp.moduli(state).bulk
        found = gp.sound_velocities(state)
        ideal = gp.sound_velocities(gp.EffectiveMedium(packing).at_force(state.force))
        for name in ("longitudinal", "transverse"):
            parts = np.asarray(getattr(ideal, name) / getattr(found, name)) - 1.0
            what = f"{name} velocity of the medium over that of the array, less 1, {of}: largest"
            note = ", ".join(f"{part:+.4f}" for part in parts)
            bound = 0.0115 if (friction, name) == KEPT else math.inf
            rows.append(Row(what, float(np.max(np.abs(parts))), "", bound, note=note))
    stiffer = bulk[True] / bulk[False] - 1.0
    rows.append(
        Row(
            "what friction adds to K: largest",
            float(np.max(stiffer)),
            note=", ".join(f"{part:.3f}" for part in stiffer),
        )
    )
    return rows


# -- what the directions of the lattice leave out --------------------------------------------------

#: a* and W/d, the last but one that of the page's balls; arrays of 32 x 32
SPACINGS = (0.4, 0.45, 0.5, 0.6, 0.7)
WIDTHS = (2.55e-6, 2.55e-5, WIDTH / DIAMETER, 2.55e-3)
ARRAYS = 8
#: a* up to which the part of G is large enough for its power of W/d
LAST_POWER = 0.5
#: eta of the sound
ETAS = {"steel": PACKINGS[True].mindlin_ratio, "no friction": 0.0}


def left_out(limit: Equilibrium) -> Array:
    """(etas, 2, widths) parts of K and G that the limit of small width leaves out."""
    load = ReducedLoad(overlap=limit.overlap)
    low = [bulk_and_shear(limit.find_elasticity(eta)) for eta in ETAS.values()]
    states = [
        bring_to_rest(limit.deviations, load, limit.stencils, limit, ratio=width)
        for width in WIDTHS
    ]
    true = [
        [bulk_and_shear(state.find_elasticity(eta)) for eta in ETAS.values()] for state in states
    ]
    return np.asarray(1.0 - np.moveaxis(low / np.array(true), 0, -1))


def deficits(repeats: int) -> list[Row]:
    """What the limit of small width leaves out of K and G over a* and W/d, and the power of W/d by
    which that of G grows.
    """
    rows = []
    at = f"W/d = {', '.join(f'{width:.3g}' for width in WIDTHS)}"
    for spacing in SPACINGS:
        limits = [
            at_rest(32, seed, [ReducedLoad(overlap=spacing - 0.5)])[0] for seed in range(ARRAYS)
        ]
        force, chance = mean_and_error(np.array([limit.force for limit in limits]))
        rows.append(measured(f"f* at a* = {spacing:g}", force, chance))
        found = np.array([left_out(limit) for limit in limits])
        mean, error = mean_and_error(100.0 * found)
        for kind, of in enumerate(ETAS):
            for place, name in enumerate("KG"):
                note = ", ".join(
                    bracketed(*pair)
                    for pair in zip(mean[kind, place], error[kind, place], strict=True)
                )
                what = f"{name} too small by, %, {of}, a* = {spacing:g}, {at}"
                rows.append(Row(what, float(mean[kind, place, -2]), note=note))
        if spacing > LAST_POWER:
            continue
        narrow = found[:, 0, 1, 0]
        wide = found[:, 0, 1, -2]
        power, chance = mean_and_error(np.log(wide / narrow) / math.log(WIDTHS[-2] / WIDTHS[0]))
        what = (
            f"power of W/d of the part of G, a* = {spacing:g}, from {WIDTHS[0]:.3g} to"
            f" {WIDTHS[-2]:.3g}"
        )
        rows.append(measured(what, power, chance))
    return rows


# -- the local exponent ----------------------------------------------------------------------------

#: f*, and experiments of so many samples each
EXPONENT_LOADS = np.array([0.03, 0.1, 0.3, 1.0])
EXPERIMENTS = 60
EACH = 4


def exponents(repeats: int) -> list[Row]:
    """Exponents of large arrays; and of many small experiments, how often the truth is within their
    errors.
    """
    large = gp.DirectSimulation(PACKINGS[True], (96, 96), 9000, 24, geometry="lattice").at_force(
        EXPONENT_LOADS * UNIT
    )
    small = gp.DirectSimulation(
        PACKINGS[True], (8, 8), 20_000, EXPERIMENTS * EACH, geometry="lattice"
    ).at_force(EXPONENT_LOADS * UNIT)
    rows = []
    for place, f in enumerate(EXPONENT_LOADS.tolist()):
        value = float(large.exponent[place])
        error = float(large.exponent_error[place])
        rows.append(measured(f"exponent at f* = {f:g}", value, error))
        samples = small[place].samples
        force = np.array(small.force[place])
        found = [
            SimulatedState.of(
                small.law.simulation, samples[first : first + EACH], Load("force", force)
            )
            for first in range(0, len(samples), EACH)
        ]
        # of what they share, a size that is not infinite, nothing is counted
        mean = float(small.exponent[place])
        t = np.abs(np.array([(one.exponent - mean) / one.exponent_error for one in found]))
        for part, quantile in (
            (0.68, 1.189),
            (0.95, 3.182),
        ):
            # of Student's t with three degrees of freedom
            rows.append(
                Row(
                    f"within the errors at f* = {f:g}, of {EXPERIMENTS} experiments, {part:g}"
                    f" expected",
                    float(np.mean(t < quantile)),
                )
            )
        off = (mean - value) / math.hypot(error, float(small.exponent_error[place]))
        rows.append(
            Row(
                f"exponent of 8x8 balls at f* = {f:g} less that of 96x96, in standard errors",
                abs(off),
                "",
                AGREE,
            )
        )
    return rows


# -- time ------------------------------------------------------------------------------------------


def processor_time(call: Callable[[], object]) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start


def loads(repeats: int) -> list[Row]:
    """What lower loads add to the time of an equilibrium: medians of five samples of 128 x 128
    balls, three of 256 x 256.
    """
    rows = []
    for length, samples in ((128, 5), (256, 3)):
        seconds = {
            spacing: np.median(
                [
                    processor_time(
                        lambda seed=seed, y=spacing - 0.5, n=length: at_rest(
                            n, seed, [ReducedLoad(overlap=y)]
                        )
                    )
                    for seed in seeds(7, samples)
                ]
            )
            for spacing in (1.0, 0.5, THRESHOLD + 0.02)
        }
        rows += [
            Row(
                f"time at rest at a* = {a:g} over that at 1, {length}x{length}",
                s / seconds[1.0],
                note=f"{s:.3g} s",
            )
            for a, s in seconds.items()
            if a < 1.0
        ]
    return rows


def lists(repeats: int) -> list[Row]:
    """The curve of random balls, each diameter another: processor time."""
    rows = []
    xi = local_field(mindlin_ratio=0.84).xi
    for count in (64, 100, 256):
        shape = gp.Measured(
            tuple(DIAMETER + 1e-6 * np.random.default_rng(count).normal(size=count))
        ).shape
        seconds = processor_time(lambda shape=shape: effective_curve(shape, xi))
        rows.append(Row(f"the curve of {count} balls, each diameter another", seconds, "s"))
    return rows


# -- the media -------------------------------------------------------------------------------------


def saturation(repeats: int) -> list[Row]:
    """Fraction of contacts of the media less that of the array, between f* = 0.2 and 0.4."""
    state = gp.DirectSimulation(PACKINGS[True], (64, 64), 0, 4, geometry="lattice").at_force(
        np.linspace(0.2, 0.4, 9) * UNIT
    )
    rows = []
    for friction, packing in PACKINGS.items():
        more = (
            gp.EffectiveMedium(packing).at_force(state.force).contact_fraction
            - state.contact_fraction
        )
        rows.append(
            Row(
                f"contacts of the medium less the array's, f* = 0.2 to 0.4,"
                f" {'' if friction else 'no '}friction: most",
                float(np.max(more)),
                "",
                0.02,
                note=", ".join(f"{part:+.4f}" for part in more),
            )
        )
    return rows


def fits(repeats: int) -> list[Row]:
    """The fit of docs/how-to/velocities.md by samples of other seeds: spread of the widths."""
    packing = PACKINGS[True]
    force = np.geomspace(2.0, 18.446, 12)
    clean = gp.pulse_velocities(gp.EffectiveMedium(packing).at_force(force), 6500.0, (0, 1)).group[
        0
    ]
    velocity = (1.0 + 0.004 * np.random.default_rng(1).standard_normal(12)) * clean
    widths = np.array(
        [
            gp.fit_width(
                packing,
                force,
                velocity,
                frequency=6500.0,
                medium={"simulation": {"shape": (64, 64), "seed": seed, "geometry": "lattice"}},
            ).width
            for seed in range(6)
        ]
    )
    note = ", ".join(f"{1e6 * width:.3f}" for width in widths)
    return [
        Row(
            "width fitted by one sample of 64x64, six seeds: largest distance from the mean, of it",
            float(np.max(np.abs(widths / np.mean(widths) - 1.0))),
            "",
            0.01,
            note=f"{note} um",
        )
    ]


def ends(repeats: int) -> list[Row]:
    """Random lists of two to five kinds, rare ones among them: f* where the equation of the medium
    ends.
    """
    draw = np.random.default_rng(1)
    found = []
    rarest = 0.0
    for _ in range(LISTS):
        count = int(draw.integers(2, 6))
        off = draw.uniform(-1.0, 1.0, count)
        shares = 10.0 ** draw.uniform(-6.0, 0.0, count)
        shares /= np.sum(shares)
        xi = local_field(mindlin_ratio=float(draw.uniform(0.0, 4.0 / 3.0))).xi
        curve = effective_curve(gp.Discrete(tuple(DIAMETER + 1e-6 * off), tuple(shares)).shape, xi)
        if curve.has_zero_stiffness:
            found.append(curve.least_force)
            if curve.least_force > 1e-4:
                rarest = max(rarest, float(np.min(shares)))
    return [
        Row(
            f"end of the medium's equation, {LISTS} random lists: largest f*",
            max(found),
            "",
            1e-2,
            note=f"{len(found)} lists have one",
        ),
        Row(
            "share of the rarest kind where there is an end above f* = 1e-4: largest",
            rarest,
            "",
            0.01,
        ),
    ]


PARTS: dict[str, Part] = {
    "sizes": sizes,
    "scatter": scatter,
    "threshold": threshold,
    "contacts": contacts,
    "conjecture": conjecture,
    "deficits": deficits,
    "exponents": exponents,
    "saturation": saturation,
    "fits": fits,
    "ends": ends,
    "loads": loads,
    "lists": lists,
}

if __name__ == "__main__":
    sys.exit(command_line("Study of the simulated array", PARTS))
