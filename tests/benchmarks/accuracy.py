"""What the media are worth: the table that ``medium: auto`` chooses by, and whether ``auto`` keeps
what it promises.

    python tests/benchmarks/accuracy.py [--write] [--held-back] [--loaded] [--lattice NAME]

Without an option the script measures the errors again, against arrays at rest without friction and
against arrays loaded with friction, on every lattice of the table (``--write`` puts them into
``granphon/data/accuracy.json``). ``--held-back`` instead tries the table of the package: on other
distributions, loads, Poisson ratios and friction coefficients the script counts how often the
medium that ``auto`` takes is within its tolerance. ``--lattice`` and ``--loaded`` choose a part.
Everything is relative, and in reduced units: one diameter, width and modulus stand for all.

Errors are those of the sound velocities and of the scale of frequencies (k/M)^(1/2): the largest of
them counts. In the plane the velocities are the longitudinal and the transverse one; in space they
are all three along each of :data:`DIRECTIONS`.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import math
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import granphon as gp
from granphon.array.options import SHEAR_RESPONSES
from granphon.array.pressed_sample import PressedSample
from granphon.array.sample import Sample
from granphon.balls.diameters import Spread
from granphon.balls.lattices import find_lattice
from granphon.balls.loads import Load
from granphon.dynamics.elasticity import (
    bulk_and_shear,
    longitudinal_modulus,
    symmetrise,
    waves_of_tensor,
)
from granphon.media.accuracy import SIMULATION, compute_form_coefficients
from granphon.media.choice import choose_shape
from granphon.media.simulation import SimulatedState
from granphon.media.state import ContactState
from granphon.tradeoffs.measure import observe

Array = NDArray[np.float64]
DIAMETER = 8e-3
WIDTH = 2e-6
DATA = Path(gp.__file__).parent / "data" / "accuracy.json"
#: media with the names of scenes, the cheapest first
MEDIA = {"ala": gp.AveragedLattice, "afa": gp.AveragedForce, "ema": gp.EffectiveMedium}
#: in space, Cartesian: in fcc along the edges, the diagonals of faces and of the cube; in hcp in
#: the layers, across them, and between
DIRECTIONS = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0))
#: kinds of distributions in the table, with the part by which errors of media are above the
#: measured ones: for loads, ratios and distributions between those of the table
MARGINS = {"smooth": 1.15, "listed": 1.3}
#: stands for the error of a medium that has no answer
FAILED = 10.0
#: friction coefficients of loaded arrays, and the Poisson ratios of their balls
COEFFICIENTS = (0.1, 0.2, 0.5, math.inf)
LOADED_POISSON_RATIOS = (0.5, 0.0)
#: seeds of the samples of the table, and of what is held back
SEED = 10_000
HELD_BACK_SEED = 20_000
TOLERANCES = (0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4)


# -- distributions ---------------------------------------------------------------------------------


def listed(deviations: Sequence[float], fractions: Sequence[float] | None = None) -> Spread:
    """A list of deviations in arbitrary units, of mean zero and the width of all."""
    shares = np.full(len(deviations), 1.0 / len(deviations))
    if fractions is not None:
        shares = np.array(fractions)
    centred = np.array(deviations, float) - np.sum(shares * np.array(deviations))
    centred *= WIDTH / np.sqrt(12.0 * np.sum(shares * centred**2))
    return gp.Discrete(tuple((DIAMETER + centred).tolist()), tuple(shares.tolist()))


def quantiles(count: int) -> Array:
    return (np.arange(count) + 0.5) / count


def normal(cutoff: float) -> Spread:
    return gp.Normal(WIDTH / np.sqrt(12.0), cutoff)


def two_kinds(larger: float) -> Spread:
    """Balls of two diameters, of which a fraction is the larger one."""
    return listed([0.0, 1.0], [1.0 - larger, larger])


def three_kinds(middle: float) -> Spread:
    """Balls of three diameters, of which a fraction is the middle one."""
    return listed([-1.0, 0.0, 1.0], [0.5 - 0.5 * middle, middle, 0.5 - 0.5 * middle])


def shapes() -> dict[str, Spread]:
    """Distributions of the table."""
    larger = (0.2, 0.25, 0.33, 0.4, 0.5, 0.6, 0.67, 0.75, 0.8)
    return {
        "uniform": gp.Uniform(WIDTH),
        **{f"normal, cut at {cutoff:g}": normal(cutoff) for cutoff in (2.0, 3.0, 6.0)},
        **{f"two kinds, {part:g} of them larger": two_kinds(part) for part in larger},
        **{
            f"three kinds, {part:g} in the middle": three_kinds(part)
            for part in (0.2, 0.5, 0.65, 0.8)
        },
        "tail upwards": listed(-np.log(1.0 - quantiles(12))),
        "tail downwards": listed(np.log(1.0 - quantiles(12))),
    }


def other_shapes() -> dict[str, Spread]:
    """Distributions that are held back."""
    lot = np.random.default_rng(5).lognormal(0.0, 0.3, 40)
    halves = np.sqrt(quantiles(8))
    return {
        "uniform": gp.Uniform(WIDTH),
        "normal, cut at 2.5": normal(2.5),
        "normal, cut at 4": normal(4.0),
        "three kinds, as many of each": listed([-1.0, 0.0, 1.0]),
        "three kinds, 0.7 in the middle": three_kinds(0.7),
        "three kinds, uneven": listed([-1.0, 0.3, 1.0], [0.2, 0.5, 0.3]),
        "four kinds": listed([0.0, 1.0, 2.0, 3.0], [0.4, 0.3, 0.2, 0.1]),
        "two kinds, 0.3 of them larger": two_kinds(0.3),
        "two kinds, 0.65 of them larger": two_kinds(0.65),
        "triangle": listed(np.concatenate([halves - 1.0, 1.0 - halves])),
        "a lot of 40 balls, lognormal": listed(lot),
    }


# -- what is measured ------------------------------------------------------------------------------


def three_digits(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(float(f"{value:.3g}") for value in values)


class Scope(NamedTuple):
    """What is measured of a lattice against one kind of arrays.

    Attributes
    ----------
    forces, spacings : loads of the table, f* and a*. At the least force no distribution has a
        larger a* than the least spacing.
    distributions : those of :func:`shapes` that are measured.
    side, samples : of the samples: their sides in diameters, and their number.
    held_back : distributions of :func:`other_shapes` that are held back.
    true_side, true_samples : the sides and number of samples for these.
    tried : least and greatest f* at which they are tried.
    largest : the largest side of a simulation that is tried: its truth has many times more balls.
    responses : responses to sound of loaded arrays.
    """

    forces: tuple[float, ...]
    spacings: tuple[float, ...]
    distributions: tuple[str, ...]
    side: int
    samples: int
    held_back: tuple[str, ...]
    true_side: int
    true_samples: int
    tried: tuple[float, float]
    largest: int
    responses: tuple[str, ...] = ()


_ALL = tuple(shapes())
_ALL_OTHERS = tuple(other_shapes())
#: what is measured in fcc; the neighbours of a ball are as many in hcp, and errors much the same,
#: so that fewer distributions show the errors there
_FCC = (
    "uniform",
    "normal, cut at 2",
    "normal, cut at 6",
    "two kinds, 0.2 of them larger",
    "two kinds, 0.33 of them larger",
    "two kinds, 0.5 of them larger",
    "two kinds, 0.67 of them larger",
    "two kinds, 0.8 of them larger",
    "three kinds, 0.2 in the middle",
    "three kinds, 0.65 in the middle",
    "tail upwards",
    "tail downwards",
)
_FEW = tuple(name for name in _FCC if "0.33" not in name and "0.6" not in name)
_HCP = tuple(name for name in _FEW if name != "normal, cut at 2")
_LOADED = tuple(name for name in _FEW if not name.startswith("three"))
_LOADED_HELD_BACK = (
    "uniform",
    "normal, cut at 2.5",
    "two kinds, 0.3 of them larger",
    "four kinds",
    "a lot of 40 balls, lognormal",
)
_SPACE_FORCES = three_digits([*np.geomspace(3e-3, 3.0, 13), 10.0, 30.0])
_SPACE_SPACINGS = three_digits([*np.geomspace(0.4, 1.6, 15), 2.95, 5.43, 10.0])
#: against arrays at rest without friction
REST_SCOPES = {
    "triangular": Scope(
        three_digits(np.geomspace(3e-3, 30.0, 37)),
        three_digits([*np.geomspace(0.42, 1.6, 28)[:-1], *np.geomspace(1.6, 10.0, 10)]),
        _ALL,
        36,
        4,
        _ALL_OTHERS,
        48,
        6,
        (3.1e-3, 60.0),
        32,
    ),
    "fcc": Scope(
        _SPACE_FORCES, _SPACE_SPACINGS, _FCC, 8, 6, _ALL_OTHERS[::2], 14, 3, (3.1e-3, 60.0), 10
    ),
    "hcp": Scope(
        _SPACE_FORCES, _SPACE_SPACINGS, _HCP, 8, 4, _ALL_OTHERS[::2], 14, 3, (3.1e-3, 60.0), 10
    ),
}
#: against arrays loaded with friction; below the least loads is the start of the loading
LOADED_SCOPES = {
    "triangular": Scope(
        three_digits(np.geomspace(0.035, 10.0, 18)),
        three_digits(np.geomspace(0.55, 5.0, 20)),
        (*_LOADED, "three kinds, 0.2 in the middle"),
        32,
        4,
        _LOADED_HELD_BACK,
        40,
        4,
        (0.045, 8.0),
        32,
        SHEAR_RESPONSES,
    ),
    # above f* = 3 errors fall as powers of the load, for which its end is enough. With partial
    # slip, a sample that is loaded in one go differs from one on a path of loads, in shorter steps,
    # by more than its chance, which in space is small
    "fcc": Scope(
        three_digits([*np.geomspace(0.05, 3.0, 10), 10.0]),
        three_digits([*np.geomspace(0.57, 2.5, 11), 5.0]),
        _LOADED,
        10,
        4,
        _LOADED_HELD_BACK,
        10,
        4,
        (0.06, 8.0),
        8,
        ("slide", "stick"),
    ),
}
#: Poisson ratios of arrays at rest, which have friction in their sound; their Mindlin ratios reach
#: from the least to the greatest
POISSON_RATIOS = {
    "triangular": (0.5, 0.3, 0.0, -0.999999999),
    "fcc": (0.5, 0.0, -0.999999999),
    "hcp": (0.5, 0.0, -0.999999999),
}


def packing(spread: Spread, poisson_ratio: float | None, lattice: str = "triangular") -> gp.Packing:
    """The balls; without friction for None."""
    material = gp.Material(70e9, 0.25 if poisson_ratio is None else poisson_ratio, 2500.0)
    diameter = DIAMETER if spread.mean is None else spread.mean
    return gp.Packing(
        material, diameter, spread=spread, lattice=lattice, friction=poisson_ratio is not None
    )


def unit(balls: gp.Packing) -> float:
    """Of f*, N."""
    return float(balls.law.coefficient * balls.width**1.5)


def numbers(state: ContactState) -> Array:
    """Return what errors are measured of, (..., n): velocities, m/s, and the scale of frequencies,
    1/s.
    """
    if state.packing.structure.periods == 2:
        return observe(state)
    velocities = gp.sound_velocities(state, DIRECTIONS).velocities
    return np.concatenate([velocities.reshape(*state.shape, -1), observe(state)[..., 2:]], axis=-1)


def squares(state: SimulatedState) -> Array:
    """Return the squares of the :func:`numbers` of each sample, (n_loads, n_samples, n), in units
    of their own.
    """
    tensors = state.over_samples(lambda sample: sample.elastic_tensor)
    k = state.over_samples(lambda sample: sample.normal_stiffness)[..., None]
    if state.packing.structure.periods == 2:
        moduli = [longitudinal_modulus(tensors)[..., None], bulk_and_shear(tensors)[..., 1:]]
        return np.concatenate([*moduli, k], axis=-1)
    velocities, _ = waves_of_tensor(symmetrise(tensors, state.packing.structure), DIRECTIONS)
    waves = np.sort(velocities, axis=-1) ** 2
    return np.concatenate([waves.reshape(*waves.shape[:2], -1), k], axis=-1)


class Samples(NamedTuple):
    """How the samples of a truth are made: cells along each period, first seed, and number."""

    shape: tuple[int, ...]
    seed: int
    count: int


class Truth(NamedTuple):
    """Simulated arrays at some loads, with which media are compared.

    Attributes
    ----------
    friction : word of the table for the friction of the arrays.
    forces : the loads, f*.
    state : the arrays at these loads.
    """

    friction: str
    forces: Array
    state: SimulatedState

    @property
    def balls(self) -> gp.Packing:
        return self.state.packing

    def loads(self, kind: str) -> Array:
        """The loads of a kind, "force" or "overlap", in SI."""
        if kind == "force":
            return np.asarray(self.forces * unit(self.balls))
        return np.asarray(self.state.overlap)

    def reduced(self, kind: str) -> Array:
        """The loads of a kind, f* or a*."""
        return self.forces if kind == "force" else np.asarray(self.state.reduced_spacing)

    def chances(self, kind: str) -> Array:
        """Relative standard deviation of the :func:`numbers` of a sample at given loads of a kind,
        (n_loads, n).
        """
        values = squares(self.state)
        means = np.mean(values, axis=1)
        if kind == "overlap":
            # moved to the mean overlap of the samples by the slopes along the loads
            overlap = self.state.over_samples(lambda sample: sample.overlap)
            log_force = np.log(self.forces)
            slopes = np.gradient(means, log_force, axis=0)
            slopes /= np.gradient(np.mean(overlap, axis=1), log_force)[:, None]
            missing = np.mean(overlap, axis=1, keepdims=True) - overlap
            values = values + slopes[:, None] * missing[..., None]
        return np.asarray(0.5 * np.std(values, axis=1, ddof=1) / np.mean(values, axis=1))


def rest_truths(
    lattice: str,
    spread: Spread,
    forces: Sequence[float],
    samples: Samples,
    poisson_ratios: Iterable[float | None],
    geometry: str = "lattice",
) -> Iterator[Truth]:
    """Arrays at rest without friction, as balls of each Poisson ratio; without friction in their
    sound for None.

    The table is measured in the directions of the lattice, the limit of small width. ``auto`` adds
    what these leave out, so that what it promises is held against the exact ``geometry``.
    """
    frictionless = packing(spread, None, lattice)
    simulation = gp.DirectSimulation(
        frictionless, samples.shape, samples.seed, samples.count, geometry=geometry
    )
    at_rest = simulation.at_force(np.array(forces) * unit(frictionless))
    for ratio in poisson_ratios:
        # the statics are the same in reduced units, whatever the friction
        balls = packing(spread, ratio, lattice)
        taken = tuple(Sample(balls, one.seed, one.equilibrium) for one in at_rest.samples)
        load = Load("force", np.array(forces) * unit(balls))
        state = SimulatedState.of(replace(simulation, packing=balls), taken, load)
        yield Truth("none" if ratio is None else "slip", np.array(forces), state)


def loaded_truths(
    lattice: str,
    spread: Spread,
    forces: Sequence[float],
    samples: Samples,
    poisson_ratio: float,
    coefficient: float,
) -> Iterator[Truth]:
    """Arrays loaded with a friction coefficient, with each response to sound that is measured."""
    balls = packing(spread, poisson_ratio, lattice)
    simulation = gp.DirectSimulation(
        balls,
        samples.shape,
        samples.seed,
        samples.count,
        friction_history=True,
        friction_coefficient=coefficient,
        geometry="exact",
    )
    load = Load("force", np.array(forces) * unit(balls))
    loaded = simulation.at(load)
    for response in LOADED_SCOPES[lattice].responses:
        taken = tuple(
            PressedSample(balls, one.seed, one.equilibrium, response) for one in loaded.samples
        )
        state = SimulatedState.of(replace(simulation, shear_response=response), taken, load)
        yield Truth(response, np.array(forces), state)


# -- the table -------------------------------------------------------------------------------------


class Row(NamedTuple):
    """Errors of a medium, or for a simulation the standard deviation of one ball, at loads f* or
    a*.
    """

    friction: str
    kind: str
    medium: str
    loads: Array
    errors: Array


def errors_of(medium: gp.LawMedium, kind: str, loads: Array, right: Array, finite: bool) -> Array:
    """(n_loads, n) relative; :data:`FAILED` where the medium knows no such load."""
    errors = np.full(right.shape, FAILED)
    for index, load in enumerate(loads.tolist()):
        with contextlib.suppress(gp.GranphonError):
            values = numbers(medium.at(Load(kind, load), finite_overlap=finite))
            errors[index] = np.abs(values / right[index] - 1.0)
    return errors


def measure(truths: Iterable[Truth], finite_overlap: bool) -> Iterator[Row]:
    """The rows of each truth: the largest error, with twice the standard error of the truth."""
    for truth in truths:
        right = numbers(truth.state)
        count = truth.state.n_samples
        for kind in ("force", "overlap"):
            chances = truth.chances(kind)
            for name, medium in MEDIA.items():
                errors = errors_of(
                    medium(truth.balls), kind, truth.loads(kind), right, finite_overlap
                )
                errors = np.max(errors + 2.0 * chances / math.sqrt(count), axis=1)
                yield Row(truth.friction, kind, name, truth.reduced(kind), errors)
            balls = truth.state.samples[0].equilibrium.deviations.size
            of_one_ball = np.max(chances, axis=1) * math.sqrt(balls)
            yield Row(truth.friction, kind, SIMULATION, truth.reduced(kind), of_one_ball)


def measure_shape(label: str, lattice: str, loaded: bool) -> list[Row]:
    """All rows of one distribution."""
    scope = (LOADED_SCOPES if loaded else REST_SCOPES)[lattice]
    spread = shapes()[label]
    samples = Samples(choose_shape(find_lattice(lattice), scope.side), SEED, scope.samples)
    if not loaded:
        ratios = (None, *POISSON_RATIOS[lattice])
        return list(measure(rest_truths(lattice, spread, scope.forces, samples, ratios), False))
    rows = []
    for ratio, mu in itertools.product(LOADED_POISSON_RATIOS, COEFFICIENTS):
        rows += measure(loaded_truths(lattice, spread, scope.forces, samples, ratio, mu), True)
    return rows


def falling(errors: Array, diameters: str, medium: str) -> tuple[float, ...]:
    """With the margin, at each load no less than at any higher one, and to three digits.

    With listed diameters errors peak where the contacts between two of the diameters open: each
    error counts at the loads next to its own as well. The standard deviation of a simulation has no
    margin.
    """
    most = errors if medium == SIMULATION else MARGINS[diameters] * errors
    if diameters == "listed":
        padded = np.pad(most, 1, mode="edge")
        most = np.max([padded[:-2], padded[1:-1], padded[2:]], axis=0)
    return three_digits(np.maximum.accumulate(most[::-1])[::-1].tolist())


def tabulate(lattice: str, loaded: bool) -> dict[str, Any]:
    """The part of a lattice in the data."""
    scope = (LOADED_SCOPES if loaded else REST_SCOPES)[lattice]
    axes = {"force": np.array(scope.forces), "overlap": np.array(scope.spacings)}
    with ProcessPoolExecutor() as pool:
        rows_of_shapes = list(
            pool.map(partial(measure_shape, lattice=lattice, loaded=loaded), scope.distributions)
        )
    largest: dict[tuple[str, ...], Array] = {}
    for label, rows in zip(scope.distributions, rows_of_shapes, strict=True):
        is_smooth = label == "uniform" or label.startswith("normal")
        for row in rows:
            axis = np.log(axes[row.kind])
            errors = np.exp(np.interp(axis, np.log(row.loads), np.log(row.errors)))
            for diameters in ("smooth", "listed") if is_smooth else ("listed",):
                key = (row.friction, diameters, row.kind, row.medium)
                largest[key] = np.maximum(largest.get(key, 0.0), errors)
    errors: dict[str, Any] = {}
    for (friction, diameters, kind, medium), values in largest.items():
        kinds = errors.setdefault(friction, {}).setdefault(diameters, {})
        kinds.setdefault(kind, {})[medium] = falling(values, diameters, medium)
    forms = np.abs(
        [compute_form_coefficients(shapes()[name].shape) for name in scope.distributions]
    )
    skewness, kurtosis = forms.max(axis=0)
    mindlin_ratios = [packing(gp.Uniform(WIDTH), nu).mindlin_ratio for nu in LOADED_POISSON_RATIOS]
    of_history = {"mindlin_ratios": mindlin_ratios, "friction_coefficient": min(COEFFICIENTS)}
    return {
        "shape": choose_shape(find_lattice(lattice), scope.side),
        "samples": scope.samples,
        "distributions": scope.distributions,
        "most": {"skewness": float(skewness) + 1e-6, "kurtosis": float(kurtosis) + 1e-6},
        "width_ratio": WIDTH / DIAMETER if loaded else 0.0,
        **(of_history if loaded else {}),
        "loads": {"force": scope.forces, "overlap": scope.spacings},
        "errors": errors,
    }


def text(data: Mapping[str, Any]) -> str:
    """JSON with a row of numbers in a line."""
    spread_out = json.dumps(data, indent=1)
    rows = re.sub(
        r"\[\s+([-0-9.e+,\s]+?)\s+\]", lambda m: "[" + " ".join(m[1].split()) + "]", spread_out
    )
    return rows + "\n"


# -- held back -------------------------------------------------------------------------------------


class Trial(NamedTuple):
    """What ``auto`` took in one case, what it promised, and what came out."""

    medium: str
    promised: float
    realised: float
    tolerance: float

    @property
    def is_met(self) -> bool:
        return self.realised <= self.tolerance


def try_tolerances(truth: Truth, largest: int, history: Mapping[str, Any]) -> Iterator[Trial]:
    """Try what ``auto`` takes at each load of a truth, for each tolerance.

    A simulation with a larger side than ``largest`` diameters is left out: the truth has not enough
    more balls to judge it.
    """
    right = numbers(truth.state)
    most_cells = choose_shape(truth.balls.structure, largest)[0]
    for kind in ("force", "overlap"):
        loads = truth.loads(kind)
        realised: dict[Any, float] = {}
        for index, tolerance in itertools.product(range(len(loads)), TOLERANCES):
            auto = gp.AutoMedium(truth.balls, tolerance, **history)
            try:
                (serving,) = auto.choose(kind, loads[index])
            except gp.GranphonError:
                continue
            medium = serving.medium.of(truth.balls)
            if isinstance(medium, gp.DirectSimulation) and medium.cells[0] > most_cells:
                continue
            # one medium serves several tolerances
            case = (index, serving.medium)
            if case not in realised:
                load = Load(kind, float(loads[index]))
                values = numbers(medium.at(load, finite_overlap=True))
                realised[case] = float(np.max(np.abs(values / right[index] - 1.0)))
            promised = float(serving.errors[0])
            yield Trial(serving.medium.name, promised, realised[case], tolerance)


def rest_trials(
    lattice: str, seed: int, samples: Samples, loads: int, ratios: int, spreads: Iterable[str]
) -> Iterator[Trial]:
    """Random loads and Poisson ratios, for each distribution that is held back, against arrays at
    rest.
    """
    draw = np.random.default_rng(seed)
    scope = REST_SCOPES[lattice]
    for label in spreads:
        forces = np.exp(draw.uniform(*np.log(scope.tried), loads)).tolist()
        poisson_ratios = (None, *draw.uniform(-0.9, 0.5, ratios - 1).tolist())
        spread = other_shapes()[label]
        for truth in rest_truths(lattice, spread, forces, samples, poisson_ratios, "exact"):
            yield from try_tolerances(truth, scope.largest, {})


def loaded_trials(
    lattice: str, seed: int, samples: Samples, loads: int, spreads: Iterable[str]
) -> Iterator[Trial]:
    """Random loads, Poisson ratios and friction coefficients, for each distribution that is held
    back, against arrays loaded with friction.
    """
    draw = np.random.default_rng(seed)
    scope = LOADED_SCOPES[lattice]
    for label in spreads:
        for low, high in ((0.1, 0.2), (0.2, 0.5), (0.5, 2.0)):
            ratio = float(draw.uniform(0.0, 0.5))
            mu = float(draw.uniform(low, high))
            forces = np.sort(np.exp(draw.uniform(*np.log(scope.tried), loads))).tolist()
            spread = other_shapes()[label]
            history = {"friction_history": True, "friction_coefficient": mu}
            for truth in loaded_truths(lattice, spread, forces, samples, ratio, mu):
                response = {"shear_response": truth.friction}
                yield from try_tolerances(truth, scope.largest, history | response)


def show(lattice: str, trials: Iterable[Trial]) -> None:
    """Print how often the tolerance was met."""
    cases = list(trials)
    print(f"| chosen ({lattice}) | cases | error within the tolerance | median of error over it |")
    print("|---|---|---|---|")
    for medium in (*MEDIA, SIMULATION, None):
        chosen = [case for case in cases if medium in (None, case.medium)]
        if chosen:
            met = sum(case.is_met for case in chosen)
            ratio = np.median([case.realised / case.tolerance for case in chosen])
            print(f"| {medium or 'all'} | {len(chosen)} | {met} | {ratio:.2g} |", flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="What the media are worth")
    parser.add_argument("--write", action="store_true", help="write the table into the package")
    parser.add_argument("--held-back", action="store_true", help="try the table of the package")
    parser.add_argument("--loaded", action="store_true", help="arrays loaded with friction alone")
    parser.add_argument("--lattice", choices=tuple(REST_SCOPES), help="one lattice alone")
    options = parser.parse_args(argv)
    data = json.loads(DATA.read_text(encoding="utf-8"))
    for loaded, scopes in ((False, REST_SCOPES), (True, LOADED_SCOPES)):
        for lattice, scope in scopes.items():
            if options.lattice not in (None, lattice) or (options.loaded and not loaded):
                continue
            if options.held_back:
                side = choose_shape(find_lattice(lattice), scope.true_side)
                samples = Samples(side, HELD_BACK_SEED, scope.true_samples)
                ratios = 3 if lattice == "triangular" else 2
                loads = 8 if lattice == "triangular" else 6
                show(
                    lattice,
                    loaded_trials(lattice, 1, samples, 4, scope.held_back)
                    if loaded
                    else rest_trials(lattice, 1, samples, loads, ratios, scope.held_back),
                )
                continue
            part = tabulate(lattice, loaded)
            data["loaded" if loaded else "rest"][lattice] = part
            if options.write:
                DATA.write_text(text(data), encoding="utf-8")
            else:
                print(text({lattice: part}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
