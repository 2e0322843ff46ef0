"""What the media are worth: the table that ``medium: auto`` chooses by, and whether it keeps what
it promises.

    python tests/benchmarks/accuracy.py [--write] [--held-back] [--lattice NAME] [--side N]
    [--samples N]

Without an option it does both: measures the errors again over the distributions and loads of the
table (``--write`` writes them into ``granphon/data/accuracy.json``), then, on other distributions,
loads and Poisson ratios, counts how often the error of what ``auto`` takes is within the one it
expects (``--held-back`` does this alone). Everything is relative, and in reduced units: one
diameter, width and modulus stand for all.

Each lattice has a part of the table. In the plane errors are those of the longitudinal and
transverse velocity, and of the scale of frequencies (k/M)^(1/2). In space they are those of all
three velocities along each of :data:`DIRECTIONS`, and of that scale: the largest of them counts.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
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
from granphon.media.accuracy import compute_form_coefficients
from granphon.media.choice import even_shape
from granphon.media.simulation import SimulatedState
from granphon.media.state import ContactState
from granphon.tradeoffs.measure import observe

Array = NDArray[np.float64]
DIAMETER = 8e-3
WIDTH = 2e-6
DATA = Path(gp.__file__).parent / "data" / "accuracy.json"
#: media with the names of scenes, the cheapest first; a simulation is last
MEDIA = {"ala": gp.AveragedLattice, "afa": gp.AveragedForce, "ema": gp.EffectiveMedium}
#: in space, Cartesian: in fcc along the edges, the diagonals of faces and of the cube; in hcp in
#: the layers, across them, and between
DIRECTIONS = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0))
#: of two kinds of balls the part of the larger ones; of three, a step apart, that of the middle
#: ones
LARGER = (0.2, 0.25, 0.33, 0.4, 0.5, 0.6, 0.67, 0.75, 0.8)
MIDDLE = (0.2, 0.5, 0.65, 0.8)
#: of distributions: two of their own, and whatever else
FAMILIES = ("uniform", "normal", "any")
#: part by which the table is above what was measured: loads, ratios and distributions between those
#: of the table. Of listed diameters errors peak where contacts of a pair of kinds open: each counts
#: at the loads next to its own as well
MARGINS = {"uniform": 1.15, "normal": 1.15, "any": 1.3}
#: stands for the error of a medium that has no answer
FAILED = 10.0


#: distributions that are held back, see :func:`other_shapes`
OTHERS = (
    "uniform",
    "normal, cut at 2.5",
    "normal, cut at 4",
    "three kinds, as many of each",
    "three kinds, 0.7 in the middle",
    "three kinds, uneven",
    "four kinds",
    "two kinds, 0.3 of them larger",
    "two kinds, 0.65 of them larger",
    "triangle",
    "a lot of 40 balls, lognormal",
)


def three_digits(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(float(f"{x:.3g}") for x in values)


class Scope(NamedTuple):
    """What is measured of a lattice.

    Attributes
    ----------
    forces, spacings : loads of the table, f* and a*.
    poisson_ratios : that have the Mindlin ratios of the table, after zero: without friction.
    left_out : distributions of :func:`shapes` that are not measured.
    side, samples : of the samples: their sides in diameters, and their number.
    held_back : distributions that are held back.
    true_side, true_samples : the sides and number of samples for these.
    loads, ratios : the number of loads and of ratios of stiffness at which they are tried.
    largest : the largest side of a simulation that is tried there: its truth has many times more
        balls.
    """

    forces: tuple[float, ...]
    spacings: tuple[float, ...]
    poisson_ratios: tuple[float, ...]
    left_out: tuple[str, ...]
    side: int
    samples: int
    held_back: tuple[str, ...]
    true_side: int
    true_samples: int
    loads: int
    ratios: int
    largest: int


_PLANE = Scope(
    three_digits(np.geomspace(3e-3, 30.0, 37)),
    three_digits(np.concatenate([np.geomspace(0.42, 1.6, 28)[:-1], np.geomspace(1.6, 10.0, 10)])),
    (0.5, 0.3, 0.0, -0.999999999),
    (),
    36,
    4,
    OTHERS,
    48,
    6,
    8,
    3,
    32,
)
_SPACE = Scope(
    three_digits([*np.geomspace(3e-3, 3.0, 13), 10.0, 30.0]),
    three_digits([*np.geomspace(0.4, 1.6, 15), 2.95, 5.43, 10.0]),
    (0.5, 0.0, -0.999999999),
    (
        "normal, cut at 3",
        "two kinds, 0.25 of them larger",
        "two kinds, 0.4 of them larger",
        "two kinds, 0.6 of them larger",
        "two kinds, 0.75 of them larger",
        "three kinds, 0.5 in the middle",
        "three kinds, 0.8 in the middle",
    ),
    8,
    6,
    OTHERS[::2],
    14,
    3,
    6,
    2,
    10,
)
#: the neighbours of a ball are as many in hcp as in fcc, and errors much the same: fewer
#: distributions show this
_LIKE_FCC = _SPACE._replace(
    left_out=(
        *_SPACE.left_out,
        "normal, cut at 2",
        "two kinds, 0.33 of them larger",
        "two kinds, 0.67 of them larger",
        "three kinds, 0.65 in the middle",
    ),
    samples=4,
)
SCOPES = {"triangular": _PLANE, "fcc": _SPACE, "hcp": _LIKE_FCC}


def listed(x: Sequence[float], fractions: Sequence[float] | None = None) -> Spread:
    """A list of deviations in arbitrary units, of mean zero and the width of all."""
    shares = np.full(len(x), 1.0 / len(x)) if fractions is None else np.array(fractions)
    off = np.array(x, float) - np.sum(shares * np.array(x))
    off *= WIDTH / np.sqrt(12.0 * np.sum(shares * off**2))
    return gp.Discrete(tuple((DIAMETER + off).tolist()), tuple(shares.tolist()))


def quantiles(count: int) -> Array:
    return (np.arange(count) + 0.5) / count


def normal(cutoff: float) -> Spread:
    return gp.Normal(WIDTH / np.sqrt(12.0), cutoff)


def shapes() -> dict[str, Spread]:
    """Distributions of the table; the first word is the family that they stand for, beside that of
    "any".
    """
    return {
        "uniform": gp.Uniform(WIDTH),
        "normal, cut at 2": normal(2.0),
        "normal, cut at 3": normal(3.0),
        "normal, cut at 6": normal(6.0),
        **{
            f"two kinds, {part:g} of them larger": listed([0.0, 1.0], [1.0 - part, part])
            for part in LARGER
        },
        **{
            f"three kinds, {part:g} in the middle": listed(
                [-1.0, 0.0, 1.0], [0.5 - 0.5 * part, part, 0.5 - 0.5 * part]
            )
            for part in MIDDLE
        },
        "tail upwards": listed(-np.log(1.0 - quantiles(12))),
        "tail downwards": listed(np.log(1.0 - quantiles(12))),
    }


def other_shapes() -> dict[str, Spread]:
    """Distributions that are held back."""
    lot = np.random.default_rng(5).lognormal(0.0, 0.3, 40)
    spreads = {
        "uniform": gp.Uniform(WIDTH),
        "normal, cut at 2.5": normal(2.5),
        "normal, cut at 4": normal(4.0),
        "three kinds, as many of each": listed([-1.0, 0.0, 1.0]),
        "three kinds, 0.7 in the middle": listed([-1.0, 0.0, 1.0], [0.15, 0.7, 0.15]),
        "three kinds, uneven": listed([-1.0, 0.3, 1.0], [0.2, 0.5, 0.3]),
        "four kinds": listed([0.0, 1.0, 2.0, 3.0], [0.4, 0.3, 0.2, 0.1]),
        "two kinds, 0.3 of them larger": listed([0.0, 1.0], [0.7, 0.3]),
        "two kinds, 0.65 of them larger": listed([0.0, 1.0], [0.35, 0.65]),
        "triangle": listed(
            np.concatenate([np.sqrt(quantiles(8)) - 1.0, 1.0 - np.sqrt(quantiles(8))])
        ),
        "a lot of 40 balls, lognormal": listed(lot),
    }
    return {label: spreads[label] for label in OTHERS}


def measured_shapes(lattice: str) -> dict[str, Spread]:
    """Distributions of the table of a lattice."""
    return {
        label: spread for label, spread in shapes().items() if label not in SCOPES[lattice].left_out
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


class ReferenceModel:
    """Samples of a distribution at some f*: mean, error and chance for each Poisson ratio, at given
    force and overlap.

    ``shape`` are the numbers of cells of a sample. The table is measured in the directions of the
    lattice, the limit of small width; ``auto`` adds what these leave out, so that what it promises
    is held against the exact ``geometry``.
    """

    def __init__(
        self,
        lattice: str,
        spread: Spread,
        forces: Sequence[float],
        shape: tuple[int, ...],
        seed: int,
        samples: int,
        geometry: str = "lattice",
    ) -> None:
        self.lattice = lattice
        self.spread = spread
        self.forces = np.array(forces)
        still = packing(spread, None, lattice)
        self.simulation = gp.DirectSimulation(still, shape, seed, samples, geometry=geometry)
        self.state = self.simulation.at_force(self.forces * unit(still))

    @property
    def spacings(self) -> Array:
        """a*."""
        return np.asarray(self.state.reduced_spacing)

    def state_of(self, poisson_ratio: float | None) -> SimulatedState:
        """The samples as balls of this Poisson ratio; without friction for None."""
        balls = packing(self.spread, poisson_ratio, self.lattice)
        # the statics are the same in reduced units, whatever the friction
        taken = tuple(Sample(balls, one.seed, one.equilibrium) for one in self.state.samples)
        simulation = replace(self.simulation, packing=balls)
        return SimulatedState.of(simulation, taken, Load("force", self.forces * unit(balls)))

    def of(self, poisson_ratio: float | None) -> tuple[dict[str, tuple[Array, Array]], Array]:
        """At given "force" and "overlap": relative chance of a sample and standard error, (n_loads,
        n); and mean values.
        """
        state = self.state_of(poisson_ratio)
        at_force = squares(state)
        overlap = state.over_samples(lambda sample: sample.overlap)
        # slopes by the overlap along the loads, of the means of samples
        log_force = np.log(self.forces)
        slopes = np.gradient(np.mean(at_force, axis=1), log_force, axis=0)
        slopes /= np.gradient(np.mean(overlap, axis=1), log_force)[:, None]
        moved = (
            at_force
            + slopes[:, None] * (np.mean(overlap, axis=1, keepdims=True) - overlap)[..., None]
        )
        chance = {
            kind: 0.5 * np.std(values, axis=1, ddof=1) / np.mean(values, axis=1)
            for kind, values in (("force", at_force), ("overlap", moved))
        }
        count = np.sqrt(state.n_samples)
        return {kind: (c, c / count) for kind, c in chance.items()}, numbers(state)


def load_of(kind: str, truth: ReferenceModel, balls: gp.Packing) -> Array:
    return truth.forces * unit(balls) if kind == "force" else np.asarray(truth.state.overlap)


def errors_of(
    medium: gp.AveragedLattice | gp.AveragedForce | gp.EffectiveMedium,
    kind: str,
    loads: Array,
    right: Array,
    finite_overlap: bool = False,
) -> Array:
    """(n_loads, n) relative; :data:`FAILED` where the medium knows no such load."""
    out = np.full(right.shape, FAILED)
    for index, load in enumerate(loads.tolist()):
        with contextlib.suppress(gp.GranphonError):
            found = numbers(getattr(medium, f"at_{kind}")(load, finite_overlap=finite_overlap))
            out[index] = np.abs(found / right[index] - 1.0)
    return out


def measured(
    lattice: str, spread: Spread, forces: Sequence[float], shape: tuple[int, ...], samples: int
) -> Iterator[tuple[int, str, str, Array, Array]]:
    """Place of eta, kind of load, medium, loads (f* or a*) and the largest error (or chance times
    root of balls) there.
    """
    truth = ReferenceModel(lattice, spread, forces, shape, 10_000, samples)
    for place, ratio in enumerate((None, *SCOPES[lattice].poisson_ratios)):
        balls = packing(spread, ratio, lattice)
        chances, right = truth.of(ratio)
        for kind, (chance, error) in chances.items():
            loads = truth.forces if kind == "force" else truth.spacings
            for name, medium in MEDIA.items():
                found = errors_of(medium(balls), kind, load_of(kind, truth, balls), right)
                yield place, kind, name, loads, np.max(found + 2.0 * error, axis=1)
            # a standard deviation of n samples is uncertain by 1/sqrt(2 n)
            known = 1.0 + 1.0 / np.sqrt(2.0 * samples)
            yield (
                place,
                kind,
                "simulation",
                loads,
                known * np.max(chance, axis=1) * np.sqrt(truth.simulation.balls),
            )


def _measured(
    spread: Spread, lattice: str, shape: tuple[int, ...], samples: int
) -> list[tuple[int, str, str, Array, Array]]:
    """Of one distribution of the table, in a process of its own."""
    return list(measured(lattice, spread, SCOPES[lattice].forces, shape, samples))


def table(lattice: str, side: int, samples: int) -> dict[str, Any]:
    """The part of a lattice in the data: errors by kind of load, medium, eta and load."""
    scope = SCOPES[lattice]
    places = {"force": np.array(scope.forces), "overlap": np.array(scope.spacings)}
    ratios = (None, *scope.poisson_ratios)
    worst = {
        family: {
            kind: {name: np.zeros((len(ratios), at.size)) for name in (*MEDIA, "simulation")}
            for kind, at in places.items()
        }
        for family in FAMILIES
    }
    spreads = measured_shapes(lattice)
    shape = even_shape(find_lattice(lattice), side)
    with ProcessPoolExecutor() as pool:
        found = pool.map(
            partial(_measured, lattice=lattice, shape=shape, samples=samples), spreads.values()
        )
        for label, rows_found in zip(spreads, found, strict=True):
            for row, kind, name, loads, errors in rows_found:
                here = np.exp(np.interp(np.log(places[kind]), np.log(loads), np.log(errors)))
                for family in {label.partition(",")[0], "any"} & set(FAMILIES):
                    kept = worst[family][kind][name]
                    kept[row] = np.maximum(kept[row], here)
    forms = np.abs([compute_form_coefficients(spread.shape) for spread in spreads.values()]).max(
        axis=0
    )
    return {
        "shape": shape,
        "samples": samples,
        "distributions": list(spreads),
        "most": {"skewness": float(forms[0]) + 1e-6, "kurtosis": float(forms[1]) + 1e-6},
        "mindlin_ratios": [packing(gp.Uniform(WIDTH), ratio).mindlin_ratio for ratio in ratios],
        "loads": {kind: at.tolist() for kind, at in places.items()},
        "errors": {
            family: {
                kind: {name: falling(values, family) for name, values in media.items()}
                for kind, media in kinds.items()
            }
            for family, kinds in worst.items()
        },
    }


def falling(errors: Array, family: str) -> list[list[float]]:
    """With the margin, at each load no less than at any higher one, and to three digits."""
    most = MARGINS[family] * errors
    if family == "any":
        below, above = (np.roll(most, by, axis=1) for by in (1, -1))
        below[:, 0], above[:, -1] = most[:, 0], most[:, -1]
        most = np.maximum(most, np.maximum(below, above))
    most = np.maximum.accumulate(most[:, ::-1], axis=1)[:, ::-1]
    return [list(three_digits(row)) for row in most.tolist()]


def text(data: Mapping[str, Any]) -> str:
    """JSON with a row of numbers in a line."""
    out = json.dumps(data, indent=1)
    return (
        re.sub(r"\[\s+([-0-9.e+,\s]+?)\s+\]", lambda m: "[" + " ".join(m[1].split()) + "]", out)
        + "\n"
    )


# -- held back -------------------------------------------------------------------------------------

#: name of a simulation that was loaded with friction
LOADED = "simulation, loaded with friction"
TOLERANCES = (0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4)


class Trial(NamedTuple):
    """What ``auto`` took in one case, what it promised, and what came out."""

    medium: str
    promised: float
    realised: float
    tolerance: float
    distribution: str = ""

    @property
    def kept(self) -> bool:
        return self.realised <= self.promised


def try_tolerances(
    truth: ReferenceModel, balls: gp.Packing, right: Array, side: int, **options: Any
) -> Iterator[Trial]:
    """Try what ``auto`` with these options takes at each load of a truth, whose numbers are
    ``right``, for each tolerance.

    A simulation with a larger side than ``side`` diameters is left out: the truth has not enough
    more balls to judge it.
    """
    largest = even_shape(balls.structure, side)[0]
    for kind in ("force", "overlap"):
        given = load_of(kind, truth, balls)
        tried = {}
        for index, tolerance in itertools.product(range(len(given)), TOLERANCES):
            try:
                (serving,) = gp.AutoMedium(balls, tolerance, **options).choose(kind, given[index])
            except gp.GranphonError:
                continue
            medium = serving.medium.of(balls)
            if isinstance(medium, gp.DirectSimulation) and medium.cells[0] > largest:
                continue
            # one medium serves several tolerances
            if (index, serving.medium) not in tried:
                found = numbers(
                    getattr(medium, f"at_{kind}")(float(given[index]), finite_overlap=True)
                )
                tried[index, serving.medium] = float(np.max(np.abs(found / right[index] - 1.0)))
            loaded = isinstance(medium, gp.DirectSimulation) and medium.friction_history
            name = LOADED if loaded else serving.medium.name
            yield Trial(name, float(serving.errors[0]), tried[index, serving.medium], tolerance)


def trials(
    lattice: str,
    seed: int,
    side: int,
    samples: int,
    loads: int,
    ratios: int,
    spreads: Sequence[str],
) -> Iterator[Trial]:
    """Random loads between f* = 0.003 and 60 and Poisson ratios, for each of the distributions that
    were held back.

    Truths are ``samples`` samples with sides of ``side`` diameters.
    """
    draw = np.random.default_rng(seed)
    shape = even_shape(find_lattice(lattice), side)
    for label in spreads:
        spread = other_shapes()[label]
        forces = np.exp(draw.uniform(np.log(3.1e-3), np.log(60.0), loads)).tolist()
        truth = ReferenceModel(lattice, spread, forces, shape, 20_000, samples, geometry="exact")
        for ratio in (None, *draw.uniform(-0.9, 0.5, ratios - 1).tolist()):
            balls = packing(spread, ratio, lattice)
            right = numbers(truth.state_of(ratio))
            for one in try_tolerances(truth, balls, right, SCOPES[lattice].largest):
                yield one._replace(distribution=label)


def show_kept(lattice: str, trials: Iterable[Trial]) -> None:
    """Print how often the promise was kept."""
    found = list(trials)
    print(
        f"| chosen ({lattice}) | cases | error within the expected one | median of error over"
        f" expected |\n|---|---|---|---|"
    )
    for medium in (*MEDIA, "simulation", LOADED, None):
        some = [one for one in found if medium in (None, one.medium)]
        if some:
            kept = np.mean([one.kept for one in some])
            ratio = np.median([one.realised / one.promised for one in some])
            print(f"| {medium or 'all'} | {len(some)} | {100.0 * kept:.1f} % | {ratio:.2g} |")


def make_parser(description: str, lattices: Iterable[str]) -> argparse.ArgumentParser:
    """The options that this script and that of arrays loaded with friction have."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--write", action="store_true", help="write the table into the package")
    parser.add_argument(
        "--held-back", action="store_true", help="try the table of the package alone"
    )
    parser.add_argument("--lattice", choices=tuple(lattices), help="one lattice alone")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser("What the media are worth", SCOPES)
    parser.add_argument("--side", type=int, help="diameters along a side of a sample")
    parser.add_argument("--samples", type=int, help="samples of each distribution")
    options = parser.parse_args(argv)
    data = json.loads(DATA.read_text(encoding="utf-8"))
    for lattice in [options.lattice] if options.lattice else SCOPES:
        scope = SCOPES[lattice]
        if not options.held_back:
            made = table(lattice, options.side or scope.side, options.samples or scope.samples)
            data["lattices"][lattice] = made
            if options.write:
                DATA.write_text(text(data), encoding="utf-8")
            else:
                print(text({lattice: made}))
        side = options.side or scope.true_side
        samples = options.samples or scope.true_samples
        show_kept(
            lattice, trials(lattice, 1, side, samples, scope.loads, scope.ratios, scope.held_back)
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
