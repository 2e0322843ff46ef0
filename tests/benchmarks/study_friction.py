"""What the page on friction says of arrays loaded with friction, from runs too long for the tests,
and its figures.

    python tests/benchmarks/study_friction.py [--json FILE] [--only PART ...]

Half an hour on one processor. Seeds are given: numbers are the same on any machine. The part
``figures`` draws the page's figures into docs/images. Balls of steel of 8 mm, spread uniformly over
2.04 um, at rest without friction at a* = 1/2 and then pressed with friction, in the exact geometry;
four arrays of 64 x 64, or of 32 x 32 where they are let go again. The part ``truth`` has what the
directions of the lattice leave out. Brackets hold the standard error of the last digits. A line of
numbers is over the loads that its row names.
"""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from accuracy import packing, shapes, unit
from numpy.typing import NDArray
from scipy.integrate import simpson
from side_by_side import Part, Row, bracketed, command_line, measured
from study_simulation import PACKINGS, UNIT, WIDTH, mean_and_error

import granphon as gp
from granphon.array.equilibrium import Equilibrium
from granphon.array.history import LoadingHistory
from granphon.array.options import ReducedLoad
from granphon.array.pressed_array import PressedArray
from granphon.array.pressed_place import PressedGeometry
from granphon.array.pressed_sample import PressedEquilibrium
from granphon.array.rest import bring_to_rest
from granphon.array.stencils import Stencils
from granphon.balls.hertz import COUNTED_FORCE
from granphon.base.errors import ConvergenceError
from granphon.dynamics.elasticity import bulk_and_shear
from granphon.figures.style import (
    BLUE,
    DPI,
    GREEN,
    GUIDE,
    PAGE_WIDTH,
    SKY_BLUE,
    STYLE,
    VERMILION,
    save_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"
PACKING = PACKINGS[True]
ETA = PACKING.mindlin_ratio
#: W/d
RATIO = WIDTH / PACKING.diameter
#: of the steps; with the default of 1e-4 up to a fifth more contacts slide at the end of a step
TOLERANCE = 1e-5
#: of the steps of cycles
CYCLE_TOLERANCE = 1e-4
SHAPE = (64, 64)
SAMPLES = 4
#: of arrays that are let go again, or begin elsewhere
SMALLER = (32, 32)
#: friction coefficients of the contacts under load; zero is today's simulation, whose statics have
#: no friction
FRICTIONS = (0.0, 0.1, 0.2, 0.5, math.inf)
#: reduced spacings of a path up, from the start at a* = 1/2
SPACINGS = (0.525, 0.55, 0.575, 0.6, 0.65, 0.7, 0.75, 0.8, 0.9, 1.0, 1.25, 1.5)
#: where a path turns, to come back
TURN = 1.0
#: f* of a path up: from 0.08 to 0.9, the range of Gilles and Coste, and beyond
FORCES = (0.03, 0.05, 0.08, 0.12, 0.18, 0.27, 0.4, 0.6, 0.9, 1.5, 3.0)
RANGE = slice(FORCES.index(0.08), FORCES.index(0.9) + 1)
#: what contacts resist slip with in sound
SPRINGS = ("stick", "slide", "partial_slip")


#: friction coefficient, colour and marker in figures
LOOKS = tuple(zip(FRICTIONS, ("0.45", VERMILION, GREEN, SKY_BLUE, BLUE), "xosD^", strict=True))
#: names of what sliding does
SLIDING = "part of the closed contacts that slides"
TANGENTIAL = "mean tangential over mean normal force"


def label(mu: float) -> str:
    return (
        "no friction in the statics"
        if not mu
        else rf"$\mu$ = {mu:g}"
        if mu < math.inf
        else r"$\mu=\infty$"
    )


def named(mu: float) -> str:
    return "no friction" if not mu else f"mu = {mu:g}"


@cache
def deviations(seed: int, shape: tuple[int, int] = SHAPE) -> Array:
    x = gp.Uniform(1.0).sample(shape, seed)
    return np.asarray(x - np.mean(x))


def press(
    mu: float,
    seed: int,
    shape: tuple[int, int],
    tolerance: float = TOLERANCE,
    start: ReducedLoad | None = None,
    exact: bool = True,
) -> LoadingHistory:
    """History of an array in its exact geometry, or in the directions of the lattice."""
    x = deviations(seed, shape)
    stencils = Stencils(shape, ETA)
    return LoadingHistory(
        x,
        stencils,
        mu,
        tolerance,
        start,
        geometry=PressedGeometry(stencils, x, RATIO) if exact else None,
    )


def follow(mu: float, seed: int, loads: Sequence[ReducedLoad], exact: bool) -> list[Equilibrium]:
    """States under loads that grow; without friction each is found from the one before."""
    x = deviations(seed)
    bare = Stencils(SHAPE)
    found = list[Equilibrium]()
    if mu:
        paths = press(mu, seed, SHAPE, exact=exact)
        return [
            PressedEquilibrium.of(one, x, paths.stencils, paths.ratio).share(x, bare)
            for one in paths.path(loads)
        ]
    for load in loads:
        start = found[-1] if found else None
        found.append(
            bring_to_rest(x, load, bare, start, ratio=RATIO)
            if exact
            else bring_to_rest(x, load, bare, start)
        )
    return found


@cache
def upwards(mu: float, seed: int, exact: bool = True) -> tuple[Any, ...]:
    """States at :data:`SPACINGS` on a way up."""
    return tuple(follow(mu, seed, [ReducedLoad(overlap=a - 0.5) for a in SPACINGS], exact))


@cache
def cycle(mu: float, seed: int) -> tuple[PressedArray, ...]:
    """States on the way up to :data:`TURN`, and back to the first load: not all arrays come to rest
    on from there.
    """
    up = [a for a in SPACINGS if a <= TURN]
    paths = press(mu, seed, SMALLER, CYCLE_TOLERANCE)
    return tuple(paths.path(ReducedLoad(overlap=a - 0.5) for a in (*up, *up[-2::-1])))


@cache
def by_force(mu: float, seed: int, exact: bool = True) -> tuple[Any, ...]:
    """States under :data:`FORCES`."""
    return tuple(follow(mu, seed, [ReducedLoad(force=f) for f in FORCES], exact))


def find_moduli(state: Any, springs: str) -> tuple[float, float]:
    """K and G, in units of c W^(1/2)/d."""
    ratios = state.shear_ratios(springs) if isinstance(state, PressedEquilibrium) else ETA
    return bulk_and_shear(state.find_elasticity(ratios))


@cache
def moduli(mu: float, seed: int, springs: str, exact: bool = True) -> Array:
    """(loads, 2) K and G, in units of c W^(1/2)/d, at :data:`FORCES`."""
    return np.array([find_moduli(state, springs) for state in by_force(mu, seed, exact)])


def over_samples(found: list[Array]) -> tuple[Array, Array]:
    return mean_and_error(np.array(found))


def row_of(what: str, kind: str, loads: Sequence[float], values: tuple[Array, Array]) -> Row:
    """Numbers over loads, with their errors; the value is the one farthest from zero."""
    note = ", ".join(with_error(v, e) for v, e in zip(*values, strict=True))
    return Row(
        f"{what}, {over(kind, loads)}", float(values[0][np.argmax(np.abs(values[0]))]), note=note
    )


def row_of_medium(what: str, kind: str, loads: Sequence[float], values: Array) -> Row:
    """The same of the effective medium, whose numbers have no error."""
    return Row(
        f"{what} of the medium, {over(kind, loads)}",
        float(np.max(values)),
        note=", ".join(f"{v:.4f}" for v in values),
    )


def with_error(value: float, error: float) -> str:
    """Such as 0.3423(5), and the number alone if there is no error."""
    return bracketed(float(value), float(error)) if error > 1e-9 else f"{value:g}"


def over(kind: str, loads: Sequence[float]) -> str:
    return f"{kind}* = {', '.join(f'{load:g}' for load in loads)}"


# -- force over spacing ----------------------------------------------------------------------------


def forces_over(
    found: Callable[[int], Sequence[Any]], base: Callable[[int], Sequence[Any]]
) -> tuple[Array, Array]:
    """f* of some states over that of others, less 1, for each seed."""
    return over_samples(
        [
            np.array(
                [
                    one.force / other.force - 1.0
                    for one, other in zip(found(seed), base(seed), strict=True)
                ]
            )
            for seed in range(SAMPLES)
        ]
    )


@cache
def rises(mu: float, exact: bool = True) -> tuple[Array, Array]:
    """What friction adds to f* at :data:`SPACINGS`, as a part of it."""
    return forces_over(
        lambda seed: upwards(mu, seed, exact), lambda seed: upwards(0.0, seed, exact)
    )


def medium_rise(spacings: Sequence[float] | Array = SPACINGS) -> Array:
    """The same of the effective medium."""
    overlap = WIDTH * (np.array(spacings) - 0.5)
    with_friction, without = (
        gp.EffectiveMedium(PACKINGS[f]).at_overlap(overlap).force for f in (True, False)
    )
    return np.asarray(with_friction / without - 1.0)


@cache
def carried(mu: float) -> tuple[Array, Array]:
    """Part of the contacts that carries load, at :data:`FORCES`."""
    return over_samples(
        [
            np.array(
                [np.mean(one.forces > COUNTED_FORCE * one.force) for one in by_force(mu, seed)]
            )
            for seed in range(SAMPLES)
        ]
    )


def force(repeats: int) -> list[Row]:
    """f*(a*) without friction, what friction adds to it, in arrays and in the medium, and the
    contacts that carry load.
    """
    bare = over_samples(
        [np.array([one.force for one in upwards(0.0, seed)]) for seed in range(SAMPLES)]
    )
    rows = [row_of("f* without friction", "a", SPACINGS, bare)]
    for mu in FRICTIONS[1:]:
        rows.append(row_of(f"what friction adds to f*, {named(mu)}", "a", SPACINGS, rises(mu)))
    rows.append(row_of_medium("what friction adds to f*", "a", SPACINGS, medium_rise()))
    for mu in FRICTIONS:
        rows.append(
            row_of(f"part of the contacts that carries load, {named(mu)}", "f", FORCES, carried(mu))
        )
    ideal = gp.EffectiveMedium(PACKING).at_force(np.array(FORCES) * UNIT)
    rows.append(
        row_of_medium(
            "part of the contacts that carries load",
            "f",
            FORCES,
            np.asarray(ideal.contact_fraction),
        )
    )
    return rows


# -- sound -----------------------------------------------------------------------------------------


def medium_moduli() -> Array:
    """(loads, 2) K and G of the effective medium with friction, in units of c W^(1/2)/d."""
    found = gp.moduli(gp.EffectiveMedium(PACKING).at_force(np.array(FORCES) * UNIT))
    return np.stack([found.bulk, found.shear], axis=-1) / (
        PACKING.width_units.stiffness / PACKING.diameter
    )


@cache
def sound(mu: float, springs: str = "stick") -> dict[str, tuple[Array, Array]]:
    """By name, (loads,) quantities of sound and their standard errors."""
    ideal = medium_moduli()
    every = [moduli(mu, seed, springs) for seed in range(SAMPLES)]
    base = [moduli(0.0, seed, "stick") for seed in range(SAMPLES)]
    ratio = [m[:, 1] / m[:, 0] for m in every]
    return {
        "k": over_samples([2.0 * m[:, 0] / math.sqrt(3.0) for m in every]),
        "2G/(1 + eta)K": over_samples([2.0 * r / (1.0 + ETA) for r in ratio]),
        "kappa/eta k": over_samples([(2.0 * r - 1.0) / ETA for r in ratio]),
        "v_L of the medium": over_samples(
            [np.sqrt(ideal.sum(axis=1) / m.sum(axis=1)) for m in every]
        ),
        "v_T of the medium": over_samples([np.sqrt(ideal[:, 1] / m[:, 1]) for m in every]),
        "v_L without friction": over_samples(
            [np.sqrt(b.sum(1) / m.sum(1)) for m, b in zip(every, base, strict=True)]
        ),
        "v_T without friction": over_samples(
            [np.sqrt(b[:, 1] / m[:, 1]) for m, b in zip(every, base, strict=True)]
        ),
    }


def velocities(repeats: int) -> list[Row]:
    """k, G/K, and velocities of the medium and of statics without friction over those of arrays
    with friction.
    """
    rows = [row_of_medium("k", "f", FORCES, 2.0 * medium_moduli()[:, 0] / math.sqrt(3.0))]
    for mu in FRICTIONS:
        for springs in SPRINGS if 0.0 < mu < math.inf else SPRINGS[:1]:
            for name, found in sound(mu, springs).items():
                rows.append(row_of(f"{name}, {named(mu)}, springs: {springs}", "f", FORCES, found))
    for mu in FRICTIONS:
        worst = {
            name: float(np.max(np.abs(sound(mu)[f"{name} of the medium"][0][RANGE] - 1.0)))
            for name in ("v_L", "v_T")
        }
        rows += [
            Row(f"{name} of the medium, f* = 0.08 to 0.9, {named(mu)}: largest error", w)
            for name, w in worst.items()
        ]
    return rows


# -- sliding ---------------------------------------------------------------------------------------


@cache
def sliding_at(mu: float) -> dict[str, tuple[Array, Array]]:
    """By name, (loads,) what sliding does on the way up, at :data:`SPACINGS`."""
    ways, free = ([upwards(m, seed) for seed in range(SAMPLES)] for m in (mu, math.inf))

    def of(find: Callable[[PressedArray], float]) -> tuple[Array, Array]:
        return over_samples([np.array([find(one) for one in way]) for way in ways])

    borne = [
        np.array(
            [
                np.mean(a.contacts.shear_sizes) / np.mean(b.contacts.shear_sizes)
                for a, b in zip(way, other, strict=True)
            ]
        )
        for way, other in zip(ways, free, strict=True)
    ]
    return {
        SLIDING: of(lambda one: one.law.sliding_fraction(one.contacts)),
        TANGENTIAL: of(lambda one: np.mean(one.contacts.shear_sizes) / one.force),
        "tangential force over that without sliding": over_samples(borne),
        "work lost by sliding": of(lambda one: one.slid / one.work),
        "work lost by the law": of(lambda one: one.loosened / one.work),
    }


def sliding(repeats: int) -> list[Row]:
    """How much of the tangential force is lost by sliding."""
    return [
        row_of(f"{name}, {named(mu)}", "a", SPACINGS, found)
        for mu in FRICTIONS[1:]
        for name, found in sliding_at(mu).items()
    ]


# -- loading and unloading -------------------------------------------------------------------------


#: a* that a cycle meets twice
BETWEEN = tuple(a for a in SPACINGS if a < TURN)


@cache
def gaps(mu: float) -> tuple[Array, Array]:
    """f* on the way back over f* on the way up, less 1, at :data:`BETWEEN`."""
    found = []
    count = len(BETWEEN)
    for seed in range(SAMPLES):
        force = np.array([state.force for state in cycle(mu, seed)])
        found.append(force[:count:-1] / force[:count] - 1.0)
    return over_samples(found)


@cache
def losses(mu: float) -> tuple[Array, Array]:
    """Work that a cycle loses over that on the way up, and the part of it lost by sliding."""
    found = []
    for seed in range(SAMPLES):
        states = cycle(mu, seed)
        top = states[len(BETWEEN)]
        end = states[-1]
        found.append(np.array([end.dissipated / top.work, end.slid / end.dissipated]))
    return over_samples(found)


def hysteresis(repeats: int) -> list[Row]:
    """f* on the way back over f* on the way up; the work that a cycle loses."""
    rows = []
    for mu in FRICTIONS[1:]:
        rows.append(
            row_of(
                f"f* on the way back over that on the way up, less 1, {named(mu)}",
                "a",
                BETWEEN,
                gaps(mu),
            )
        )
        names = "work lost in a cycle, of that on the way up", "part of it lost by sliding"
        for name, value, error in zip(names, *losses(mu), strict=True):
            rows.append(Row(f"{name}, {named(mu)}", float(value), note=with_error(value, error)))
    return rows


# -- where a history begins ------------------------------------------------------------------------

#: a* of the beginning, and where forces are compared
STARTS = (0.45, 0.5, 0.6, 0.7)
COMPARED = (0.8, 1.0, 1.5)


def starts(repeats: int) -> list[Row]:
    """f* at a given a* by where the history begins, over that of a beginning at 1/2."""
    rows = []
    for mu in (0.2, math.inf):
        found = []
        for seed in range(SAMPLES):
            forces = []
            for a in STARTS:
                paths = press(mu, seed, SMALLER, start=ReducedLoad(overlap=a - 0.5))
                way = [b for b in SPACINGS if b > a]
                states = zip(
                    way, paths.path(ReducedLoad(overlap=b - 0.5) for b in way), strict=True
                )
                forces.append([state.force for b, state in states if b in COMPARED])
            found.append(np.array(forces) / np.array(forces)[STARTS.index(0.5)] - 1.0)
        value, error = over_samples(found)
        for place, a in enumerate(STARTS):
            if a != 0.5:
                what = (
                    f"f* of a history from a* = {a:g} over that of one from 0.5, less 1,"
                    f" {named(mu)}"
                )
                rows.append(row_of(what, "a", COMPARED, (value[place], error[place])))
    return rows


#: arrays of hcp, from which single balls may be squeezed out: distribution, and a* of the start
CELLS = (10, 10, 6)
SQUEEZED = (
    ("uniform", 0.5),
    ("tail downwards", 0.5),
    ("tail downwards", 0.55),
    ("tail downwards", 0.6),
)


def squeezed(repeats: int) -> list[Row]:
    """How many arrays of hcp with mu = 0.1 reach f* = 0.1 in one go on the lattice, by where the
    history begins.
    """
    rows = []
    for name, start in SQUEEZED:
        balls = packing(shapes()[name], 0.0, "hcp")
        reached = []
        for seed in range(SAMPLES):
            given: Any = {
                "friction_history": True,
                "friction_coefficient": 0.1,
                "start": start,
                "geometry": "lattice",
            }
            with contextlib.suppress(ConvergenceError):
                gp.DirectSimulation(balls, CELLS, seed, **given).at_force(0.1 * unit(balls))
                reached.append(seed)
        what = f"arrays of hcp, {name}, that reach f* = 0.1 from a* = {start:g}, of {SAMPLES}"
        rows.append(Row(what, len(reached), note=f"seeds {', '.join(map(str, reached))}"))
    return rows


# -- the length of the steps -----------------------------------------------------------------------

#: f* of loads that are each reached in one go from the start; friction coefficients with which
#: contacts slide
LONE_FORCES = (0.1, 0.3, 1.0)
FINITE = FRICTIONS[1:-1]
#: tolerances of the steps: the default, a smaller one, and that of the velocities with which both
#: are compared
TOLERANCES = (1e-4, 1e-5)
FINE = 1e-6


def reach(mu: float, seed: int, force: float, tolerance: float) -> tuple[Array, int]:
    """(springs, 2) velocities v_L and v_T, up to a factor, at a load reached in one go, and the
    number of steps.
    """
    paths = press(mu, seed, SMALLER, tolerance)
    (state,) = paths.path([ReducedLoad(force=force)])
    pressed = PressedEquilibrium.of(state, paths.deviations, paths.stencils, paths.ratio)
    found = np.array(
        [
            find_moduli(pressed.share(paths.deviations, Stencils(SMALLER)), springs)
            for springs in SPRINGS
        ]
    )
    return np.sqrt(np.column_stack([np.sum(found, axis=1), found[:, 1]])), state.steps


@cache
def lone(mu: float, tolerance: float) -> tuple[Array, Array]:
    """(samples, loads, springs, 2) velocities at :data:`LONE_FORCES`, and (loads,) mean numbers of
    steps.
    """
    found = [
        [reach(mu, seed, force, tolerance) for force in LONE_FORCES] for seed in range(SAMPLES)
    ]
    counts = [[count for _, count in one] for one in found]
    return np.array([[velocities for velocities, _ in one] for one in found]), np.mean(
        counts, axis=0
    )


def steps(repeats: int) -> list[Row]:
    """What steps leave of error in velocities, rms over the arrays, in %, and the number of
    steps.
    """
    rows = []
    at = over("f", LONE_FORCES)
    for mu in FINITE:
        for tolerance in TOLERANCES:
            errors = 100.0 * np.sqrt(
                np.mean((lone(mu, tolerance)[0] / lone(mu, FINE)[0] - 1.0) ** 2, axis=0)
            )
            for place, springs in enumerate(SPRINGS):
                note = "; ".join(f"{long:.2f}, {across:.2f}" for long, across in errors[:, place])
                what = (
                    f"error of v_L and v_T in %, {named(mu)}, steps to {tolerance:g}, springs:"
                    f" {springs}, {at}"
                )
                rows.append(Row(what, float(np.max(errors[:, place])), note=note))
        for tolerance in (*TOLERANCES, FINE):
            note = ", ".join(f"{count:.3g}" for count in lone(mu, tolerance)[1])
            rows.append(
                Row(
                    f"number of steps to {tolerance:g}, {named(mu)}, {at}",
                    float(lone(mu, tolerance)[1][-1]),
                    note=note,
                )
            )
    return rows


# -- the true geometry -----------------------------------------------------------------------------

#: friction coefficients for which both geometries are compared, zero being statics without friction
TRUE_FRICTIONS = (0.0, 0.2, math.inf)


def apart(one: Any, other: Any) -> float:
    """Rms difference of the contact forces of two states, of both components, over the mean
    force.
    """
    squares = (one.forces - other.forces) ** 2
    if isinstance(one, PressedEquilibrium):
        squares = np.append(squares, (one.shears - other.shears) ** 2)
    return math.sqrt(float(np.sum(squares)) / one.forces.size) / one.force


def truth(repeats: int) -> list[Row]:
    """What the directions of the lattice leave out of forces, sliding and moduli, with a history
    and without.
    """
    rows = []
    for mu in TRUE_FRICTIONS:
        left = forces_over(
            lambda seed, mu=mu: upwards(mu, seed, False), lambda seed, mu=mu: upwards(mu, seed)
        )
        rows.append(
            row_of(
                f"f* on the lattice over that in true directions, less 1, {named(mu)}",
                "a",
                SPACINGS,
                left,
            )
        )
        pairs = [
            list(zip(upwards(mu, seed), upwards(mu, seed, False), strict=True))
            for seed in range(SAMPLES)
        ]
        far = over_samples([np.array([apart(*pair) for pair in way]) for way in pairs])
        rows.append(
            row_of(f"rms difference of single contact forces, {named(mu)}", "a", SPACINGS, far)
        )
        if mu:
            rows.append(
                row_of(
                    f"what friction adds to f* on the lattice, {named(mu)}",
                    "a",
                    SPACINGS,
                    rises(mu, False),
                )
            )
    for mu in TRUE_FRICTIONS:
        found = {
            exact: np.array([moduli(mu, seed, "stick", exact) for seed in range(SAMPLES)])
            for exact in (False, True)
        }
        for exact, m in found.items():
            ratio = over_samples(list(2.0 * m[..., 1] / m[..., 0] / (1.0 + ETA)))
            rows.append(
                row_of(
                    f"2G/(1 + eta)K, {named(mu)}, {'exact' if exact else 'lattice'}",
                    "f",
                    FORCES,
                    ratio,
                )
            )
        for place, name in enumerate("KG"):
            missing = over_samples(list(1.0 - found[False][..., place] / found[True][..., place]))
            rows.append(
                row_of(
                    f"part of {name} that the lattice's directions leave out, {named(mu)}",
                    "f",
                    FORCES,
                    missing,
                )
            )
    return rows


#: sizes of arrays, and f*, at which they come to rest without friction in the true geometry; with
#: seeds from 0
REST_SIZES = (16, 24, 32)
REST_FORCES = (0.1, 0.05, 0.025, 0.012, 0.005)
REST_SEEDS = range(10)


def rest(repeats: int) -> list[Row]:
    """How many arrays come to rest at a minimum of the energy in the true geometry, where they
    resist every strain.
    """
    rows = []
    for size in REST_SIZES:
        stable = 0
        residual = 0.0
        for seed in REST_SEEDS:
            stencils = Stencils((size, size))
            for load in REST_FORCES:
                state = bring_to_rest(
                    deviations(seed, (size, size)),
                    ReducedLoad(force=load),
                    stencils,
                    ratio=WIDTH / PACKING.diameter,
                )
                stable += bool(np.all(np.linalg.eigvalsh(state.find_elasticity(0.0)) > 0.0))
                residual = max(residual, state.residual)
        count = len(REST_FORCES) * len(REST_SEEDS)
        what = f"{count} arrays of {size} x {size}, {over('f', REST_FORCES)}"
        rows.append(Row(f"at a minimum, of {what}", stable))
        rows.append(Row(f"force left, {what}", residual, "", 1e-10))
    return rows


#: spacings near the threshold, and widths over the diameter, at which arrays of 32 x 32 balls come
#: to rest; their seeds
NARROW_SPACINGS = (0.4, 0.37)
RATIOS = (2.55e-4, 2.55e-6, 2.55e-8, 2.55e-9)
NARROW_SEEDS = range(6)


def narrow(repeats: int) -> list[Row]:
    """How many arrays of balls that hardly differ come to rest in the true geometry near the
    threshold.
    """
    rows = []
    for spacing in NARROW_SPACINGS:
        for ratio in RATIOS:
            reached = []
            for seed in NARROW_SEEDS:
                with contextlib.suppress(ConvergenceError):
                    bring_to_rest(
                        deviations(seed, SMALLER), ReducedLoad(overlap=spacing - 0.5), ratio=ratio
                    )
                    reached.append(seed)
            what = (
                f"arrays of 32 x 32 at rest at a* = {spacing:g}, W/d = {ratio:g}, of"
                f" {len(NARROW_SEEDS)}"
            )
            rows.append(Row(what, len(reached), note=f"seeds {', '.join(map(str, reached))}"))
    return rows


# -- the gas ---------------------------------------------------------------------------------------

#: lattices that only friction holds, cells, and the friction coefficient, of arrays that are
#: pressed from the gas
FROM_GAS = (
    ("square", (16, 16), 0.3), ("kagome", (6, 6), 0.3), ("honeycomb", (5, 5), 0.3), ("sc", (3, 3, 3), 0.5),
    ("bcc", (3, 3, 3), 0.5), ("diamond", (3, 3, 3), 0.5),
)  # fmt: skip


def gas(repeats: int) -> list[Row]:
    """How many arrays that are pressed from the gas reach f* = 1 in one go, in both geometries, and
    in which time.
    """
    rows = []
    for lattice, cells, mu in FROM_GAS:
        balls = replace(PACKING, lattice=lattice)
        for geometry in ("lattice", "exact"):
            given: Any = {
                "friction_history": True,
                "friction_coefficient": mu,
                "start": "gas",
                "geometry": geometry,
            }
            reached = []
            start = time.process_time()
            for seed in range(SAMPLES):
                with contextlib.suppress(ConvergenceError):
                    gp.DirectSimulation(balls, cells, seed, **given).at_force(UNIT)
                    reached.append(seed)
            what = f"arrays of {lattice}, {geometry}, that reach f* = 1 from the gas, of {SAMPLES}"
            note = (
                f"seeds {', '.join(map(str, reached))};"
                f" {(time.process_time() - start) / SAMPLES:.1f} s each"
            )
            rows.append(Row(what, len(reached), note=note))
    return rows


def numbering(repeats: int) -> list[Row]:
    """Parts by which overlap, work and v_T of arrays from the gas change where the same balls are
    numbered otherwise.

    Arrays of sc, 3 x 3 x 3, mu = 0.3, at f* = 0.1. The numbers begin at another ball; the most of
    four.
    """
    rows = []
    shape = (3, 3, 3)
    balls = replace(PACKING, lattice="sc")
    for geometry in ("lattice", "exact"):
        given: Any = {
            "friction_history": True,
            "friction_coefficient": 0.3,
            "start": "gas",
            "geometry": geometry,
        }
        for seed in range(2):
            diameters = balls.diameter + WIDTH * gp.Uniform(1.0).sample(shape, seed)
            found = []
            for shift in ((0, 0, 0), (0, 1, 1), (0, 0, 1), (0, 1, 0), (1, 1, 1)):
                simulation = gp.DirectSimulation(
                    balls, diameters=np.roll(diameters, shift, (0, 1, 2)), **given
                )
                state = simulation.at_force(0.1 * UNIT)
                found.append(
                    (
                        float(state.overlap),
                        float(state.work),
                        float(np.min(state.long_waves([[1.0, 0.0, 0.0]]))),
                    )
                )
            most = np.max(np.abs(np.array(found) / found[0] - 1.0), axis=0)
            for name, part in zip(("overlap", "work", "v_T"), most, strict=True):
                rows.append(
                    Row(
                        f"{geometry}, seed {seed}: change of {name} by the numbering of balls",
                        float(part),
                    )
                )
    return rows


# -- the width of a fit ----------------------------------------------------------------------------


@cache
def widths_of(mu: float) -> tuple[float, float]:
    """Width over the balls' own that the medium finds by the longitudinal sound of arrays, f* =
    0.08 to 0.9.
    """
    ideal = gp.EffectiveMedium(PACKING).at_force(np.array(FORCES)[RANGE] * UNIT)
    stiff = medium_moduli()[RANGE].sum(axis=1)
    velocity = gp.sound_velocities(ideal).longitudinal
    found = [
        gp.fit_width(
            PACKING,
            ideal.force,
            velocity * np.sqrt(moduli(mu, seed, "stick")[RANGE].sum(axis=1) / stiff),
        ).width
        for seed in range(SAMPLES)
    ]
    value, error = over_samples(found)
    return float(value) / WIDTH, float(error) / WIDTH


def widths(repeats: int) -> list[Row]:
    """The width that the medium finds from the sound of arrays, and the balls' own where it finds
    that of the paper.
    """
    rows = []
    for mu in FRICTIONS:
        value, error = widths_of(mu)
        own = 1e6 * WIDTH / value
        rows += [
            measured(f"width that the medium finds over the balls' own, {named(mu)}", value, error),
            Row(
                f"width of balls in which the medium finds {1e6 * WIDTH:g} um, {named(mu)}",
                own,
                "um",
                note=bracketed(own, own * error / value),
            ),
        ]
    return rows


# -- energy ----------------------------------------------------------------------------------------


def energy(repeats: int) -> list[Row]:
    """Integral of f* over the overlap, less what contacts store and lose, over it, by the number of
    steps to a* = 1.
    """
    rows = []
    for mu in (0.2, math.inf):
        for steps in (5, 10, 20, 40):
            paths = press(mu, 0, SMALLER, math.inf)
            spacings = np.linspace(0.5, 1.0, steps + 1)[1:]
            states = [
                paths.begin(),
                *paths.path(ReducedLoad(overlap=float(a) - 0.5) for a in spacings),
            ]
            last = states[-1]
            work = simpson([state.force for state in states], x=[state.overlap for state in states])
            left = work - last.dissipated - (last.stored - states[0].stored)
            what = (
                f"integral of the force that is neither stored nor lost, of the work,"
                f" {named(mu)}, {steps} steps"
            )
            rows.append(
                Row(
                    what,
                    abs(left) / work,
                    "",
                    2e-4 / steps,
                    note=f"lost: {last.dissipated / work:.3g}",
                )
            )
    return rows


# -- figures ---------------------------------------------------------------------------------------


#: lines with error bars
BARS = {"markersize": 3.5, "linewidth": 0.8, "elinewidth": 0.6, "capsize": 1.5}


def draw_forces(figure: Figure) -> None:
    """What friction adds to the force, the hysteresis, tangential forces and sliding."""
    axes = figure.subplot_mosaic([["rise", "gap"], ["shear", "slide"]])
    for mu, colour, marker in LOOKS[1:]:
        look: Any = {"color": colour, "marker": marker, "label": label(mu), **BARS}
        for name, spacings, found in (
            ("rise", SPACINGS, rises(mu)),
            ("gap", BETWEEN, gaps(mu)),
            ("shear", SPACINGS, sliding_at(mu)[TANGENTIAL]),
            ("slide", SPACINGS, sliding_at(mu)[SLIDING]),
        ):
            axes[name].errorbar(spacings, 100.0 * found[0], 100.0 * found[1], **look)
    fine = np.linspace(0.5, SPACINGS[-1], 81)
    axes["rise"].plot(
        fine,
        100.0 * medium_rise(fine),
        color="black",
        linewidth=1.0,
        dashes=(3.5, 1.8),
        label="medium",
    )
    axes["rise"].set(ylabel="What friction adds to the force (%)", ylim=(0.0, 9.5))
    axes["gap"].set(ylabel="Force on the way back over that\non the way up, less 1 (%)")
    axes["shear"].set(ylabel="Mean tangential over mean\nnormal force (%)", ylim=(0.0, None))
    axes["slide"].set(ylabel="Closed contacts that slide (%)", ylim=(0.0, None))
    axes["rise"].legend(ncols=2)
    for name, letter in zip(axes, "abcd", strict=True):
        axes[name].set_xlabel("$a^*$")
        axes[name].set_title(letter, loc="left", fontweight="bold")


def draw_sound(figure: Figure) -> None:
    """G/K, and velocities of the medium, over those of arrays with friction."""
    axes = figure.subplot_mosaic(
        [["ratio", "v_L of the medium"], ["ratio", "v_T of the medium"]], sharex=True
    )
    for mu, colour, marker in LOOKS:
        for springs in ("stick", "slide") if mu in (0.1, 0.2) else ("stick",):
            look: Any = {
                "color": colour,
                "marker": marker,
                "linestyle": "-" if springs == "stick" else ":",
                **BARS,
            }
            if springs == "slide":
                look["mfc"] = "white"
            found = sound(mu, springs)
            what = label(mu) if springs == "stick" else f"{label(mu)}, no spring\nwhere it slides"
            axes["ratio"].errorbar(FORCES, *found["2G/(1 + eta)K"], label=what, **look)
            if springs == "stick":
                for name in ("v_L of the medium", "v_T of the medium"):
                    value, error = found[name]
                    axes[name].errorbar(
                        FORCES, 100.0 * (value - 1.0), 100.0 * error, label=label(mu), **look
                    )
    axes["ratio"].set(ylabel=r"$2G/(1+\eta)K$", ylim=(0.55, 1.02))
    axes["ratio"].legend(loc="lower right")
    for name, ax in axes.items():
        ax.set(xscale="log", xlim=(0.025, 3.6))
        ax.axvspan(0.08, 0.9, color="0.93", zorder=0)
        ax.axhline(1.0 if name == "ratio" else 0.0, color=GUIDE, linewidth=0.6, zorder=0.5)
        if name != "ratio":
            ax.set_ylabel(f"${name[:3]}$ of the medium over\nthat of the array, less 1 (%)")
    axes["ratio"].set_xlabel("$f^*$")
    axes["v_T of the medium"].set_xlabel("$f^*$")
    axes["v_L of the medium"].tick_params(labelbottom=False)
    axes["v_L of the medium"].legend(loc="lower right")
    for name, letter in zip(axes, "abc", strict=True):
        axes[name].set_title(letter, loc="left", fontweight="bold")


def figures(repeats: int) -> list[Row]:
    """Draw the figures of the page."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        for name, draw, height in (
            ("friction_forces", draw_forces, 4.8),
            ("friction_sound", draw_sound, 4.2),
        ):
            figure = Figure(figsize=(PAGE_WIDTH, height), dpi=DPI, layout="constrained")
            draw(figure)
            save_figure(figure, IMAGES / f"{name}.png")
    return []


PARTS: dict[str, Part] = {
    "force": force,
    "velocities": velocities,
    "sliding": sliding,
    "hysteresis": hysteresis,
    "starts": starts,
    "squeezed": squeezed,
    "steps": steps,
    "truth": truth,
    "rest": rest,
    "narrow": narrow,
    "gas": gas,
    "numbering": numbering,
    "widths": widths,
    "energy": energy,
    "figures": figures,
}

if __name__ == "__main__":
    sys.exit(command_line("Study of friction in the statics", PARTS))
