"""What the media are worth against arrays that were loaded with friction: the table of ``auto``
with ``friction_history``.

    python tests/benchmarks/accuracy_with_friction.py [--write] [--held-back] [--lattice NAME]
    [--keep FOLDER]

It goes with ``accuracy.py``, and measures the same errors of the same media, on the lattices of
:data:`SCOPES`. The truth is another: ``gp.DirectSimulation(..., friction_history=True)``, loaded
with some friction coefficient from rest without friction at a* = 1/2, with one of the three
responses to sound. Its contacts have their true directions, at one W/d, and media the terms of
finite overlap that go with them. Besides the media there is the simulation of the same samples at
rest without friction: its error is what the friction in the statics does. Without an option the
script measures the errors again (``--write`` puts them into ``granphon/data/accuracy.json``), and
then tries them on cases that were held back (``--held-back`` does this alone). ``--keep`` keeps
what was measured of each distribution and eta in a folder, to go on from there.
"""

from __future__ import annotations

import json
import math
import pickle
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from accuracy import (
    DATA,
    DIAMETER,
    FAMILIES,
    MEDIA,
    WIDTH,
    ReferenceModel,
    Trial,
    errors_of,
    falling,
    load_of,
    make_parser,
    numbers,
    other_shapes,
    packing,
    shapes,
    show_kept,
    squares,
    text,
    three_digits,
    try_tolerances,
    unit,
)
from numpy.typing import NDArray

import granphon as gp
from granphon.array.pressed_sample import SHEAR_RESPONSES, PressedSample
from granphon.balls.diameters import Spread
from granphon.balls.lattices import find_lattice
from granphon.balls.loads import Load
from granphon.media.accuracy import compute_form_coefficients
from granphon.media.choice import even_shape
from granphon.media.simulation import SimulatedState

Array = NDArray[np.float64]
#: friction coefficients of the table, and Poisson ratios, which give eta
COEFFICIENTS = (0.1, 0.2, 0.5, math.inf)
POISSON_RATIOS = (0.5, 0.0)
#: distributions of ``accuracy.shapes`` that are measured, unless a lattice leaves them out
DISTRIBUTIONS = (
    "uniform",
    "normal, cut at 2",
    "normal, cut at 6",
    "two kinds, 0.2 of them larger",
    "two kinds, 0.5 of them larger",
    "two kinds, 0.8 of them larger",
    "tail upwards",
    "tail downwards",
    "three kinds, 0.2 in the middle",
)
#: distributions of ``accuracy.other_shapes`` that are held back
HELD_BACK = (
    "uniform",
    "normal, cut at 2.5",
    "two kinds, 0.3 of them larger",
    "four kinds",
    "a lot of 40 balls, lognormal",
)
#: name of the simulation at rest without friction in the table, where "simulation" is a sample of
#: the truth
FRICTIONLESS = "frictionless"
#: of the rows of a table: friction coefficient, response, place of eta, kind of load, medium
Key = tuple[float, str, int, str, str]


class Scope(NamedTuple):
    """What is measured of a lattice.

    Attributes
    ----------
    forces, spacings : loads of the table, f* and a*; below them is the start of the loading. At the
        least force no distribution has a larger a* than the least spacing.
    left_out : distributions of :data:`DISTRIBUTIONS` that are not measured.
    responses : responses to sound that are measured.
    side, samples : of the samples: their sides in diameters, and their number.
    true_side, true_samples : the same of the truth of cases that are held back.
    tried : least and greatest f* of these cases.
    largest : the largest side of a simulation that is tried there: the truth has many times more
        balls.
    """

    forces: tuple[float, ...]
    spacings: tuple[float, ...]
    left_out: tuple[str, ...]
    responses: tuple[str, ...]
    side: int
    samples: int
    true_side: int
    true_samples: int
    tried: tuple[float, float]
    largest: int


SCOPES = {
    "triangular": Scope(
        three_digits(np.geomspace(0.035, 10.0, 18)),
        three_digits(np.geomspace(0.55, 5.0, 20)),
        (),
        SHEAR_RESPONSES,
        32,
        4,
        40,
        4,
        (0.045, 8.0),
        32,
    ),
    # above f* = 3 errors fall as powers of the load, for which its end is enough. With partial
    # slip, a sample that is loaded in one go differs from one on a path of loads, in shorter steps,
    # by more than its chance, which in space is small
    "fcc": Scope(
        three_digits([*np.geomspace(0.05, 3.0, 10), 10.0]),
        three_digits([*np.geomspace(0.57, 2.5, 11), 5.0]),
        ("three kinds, 0.2 in the middle",),
        ("slide", "stick"),
        10,
        4,
        10,
        4,
        (0.06, 8.0),
        8,
    ),
}


def measured_shapes(lattice: str) -> dict[str, Spread]:
    """Distributions of the table of a lattice."""
    return {
        label: shapes()[label] for label in DISTRIBUTIONS if label not in SCOPES[lattice].left_out
    }


class LoadedReference(ReferenceModel):
    """Samples loaded with friction: what :class:`accuracy.ReferenceModel` has of samples at rest
    without.
    """

    def __init__(
        self,
        lattice: str,
        spread: Spread,
        poisson_ratio: float,
        mu: float,
        forces: Sequence[float],
        shape: tuple[int, ...],
        seed: int,
        samples: int,
    ) -> None:
        self.lattice = lattice
        self.spread = spread
        self.forces = np.array(forces)
        self.balls = packing(spread, poisson_ratio, lattice)
        self.simulation = gp.DirectSimulation(
            self.balls,
            shape,
            seed,
            samples,
            friction_history=True,
            friction_coefficient=mu,
            geometry="exact",
        )
        self.state = self.simulation.at_force(self.forces * unit(self.balls))
        self.pressed = self.state.samples

    def respond(self, response: str) -> None:
        """Take another response to sound, of the same samples under the same forces."""
        if response == self.simulation.shear_response:
            return
        self.simulation = replace(self.simulation, shear_response=response)
        taken = tuple(
            PressedSample(self.balls, one.seed, one.equilibrium, response) for one in self.pressed
        )
        self.state = SimulatedState.of(
            self.simulation, taken, Load("force", self.forces * unit(self.balls))
        )

    def state_of(self, poisson_ratio: float | None) -> SimulatedState:
        """The statics depend on eta: there are those of one."""
        return self.state


def measured(
    lattice: str,
    spread: Spread,
    forces: Sequence[float],
    shape: tuple[int, ...],
    samples: int,
    coefficients: Sequence[float],
    places: Sequence[int] = range(len(POISSON_RATIOS)),
) -> Iterator[tuple[Key, Array, Array]]:
    """Loads (f* or a*) and largest errors there (or chance times root of balls), as
    ``accuracy.measured``.

    ``places`` are those of eta.
    """
    for place in places:
        ratio = POISSON_RATIOS[place]
        balls = packing(spread, ratio, lattice)
        rest = gp.DirectSimulation(balls, shape, 10_000, samples, geometry="exact")
        at_force = rest.at_force(np.array(forces) * unit(balls))
        for mu in coefficients:
            truth = LoadedReference(lattice, spread, ratio, mu, forces, shape, 10_000, samples)
            # the same samples at the spacing that they have with friction
            still = {"force": at_force, "overlap": rest.at_overlap(truth.state.overlap)}
            for response in SCOPES[lattice].responses:
                truth.respond(response)
                chances, right = truth.of(ratio)
                mine = squares(truth.state)
                for kind, (chance, error) in chances.items():
                    loads = truth.forces if kind == "force" else truth.spacings
                    for name, medium in MEDIA.items():
                        found = errors_of(
                            medium(balls),
                            kind,
                            load_of(kind, truth, balls),
                            right,
                            finite_overlap=True,
                        )
                        yield (
                            (mu, response, place, kind, name),
                            loads,
                            np.max(found + 2.0 * error, axis=1),
                        )
                    # most of the chance is that of the diameters, which are the same
                    apart = (
                        0.5 * (squares(still[kind]) - mine) / np.mean(mine, axis=1, keepdims=True)
                    )
                    apart_error = np.std(apart, axis=1, ddof=1) / np.sqrt(samples)
                    found = np.abs(numbers(still[kind]) / right - 1.0) + 2.0 * apart_error
                    yield (mu, response, place, kind, FRICTIONLESS), loads, np.max(found, axis=1)
                    known = 1.0 + 1.0 / np.sqrt(2.0 * samples)
                    chance_of_ball = (
                        known * np.max(chance, axis=1) * np.sqrt(truth.simulation.balls)
                    )
                    yield (mu, response, place, kind, "simulation"), loads, chance_of_ball


def measure_all(lattice: str, keep: Path | None) -> dict[str, list[tuple[Key, Array, Array]]]:
    """Measure each distribution on a lattice, or take what was kept of it."""
    scope = SCOPES[lattice]
    found = {}
    shape = even_shape(find_lattice(lattice), scope.side)
    for label, spread in measured_shapes(lattice).items():
        found[label] = []
        for place, ratio in enumerate(POISSON_RATIOS):
            file = keep / f"{lattice}, {label}, {ratio:g}.pickle" if keep else None
            if file is not None and file.is_file():
                found[label] += pickle.loads(file.read_bytes())
                continue
            rows = list(
                measured(lattice, spread, scope.forces, shape, scope.samples, COEFFICIENTS, [place])
            )
            if file is not None:
                file.write_bytes(pickle.dumps(rows))
            found[label] += rows
            print(
                lattice, label, f"Poisson ratio {ratio:g}", "measured", file=sys.stderr, flush=True
            )
    return found


def table(lattice: str, found: Mapping[str, list[tuple[Key, Array, Array]]]) -> dict[str, Any]:
    """The part of a lattice: for each friction coefficient and response, errors as in a part of
    ``accuracy.table``.
    """
    scope = SCOPES[lattice]
    places = {"force": np.array(scope.forces), "overlap": np.array(scope.spacings)}
    # the same order of media as without friction, with the simulation of the truth last
    names = (*MEDIA, FRICTIONLESS, "simulation")

    def collect(mu: float, response: str, family: str) -> dict[str, dict[str, list[list[float]]]]:
        worst = {
            kind: {name: np.zeros((len(POISSON_RATIOS), at.size)) for name in names}
            for kind, at in places.items()
        }
        for label, rows in found.items():
            if family not in (label.partition(",")[0], "any"):
                continue
            for (one, said, row, kind, name), loads, errors in rows:
                if (one, said) == (mu, response):
                    here = np.exp(np.interp(np.log(places[kind]), np.log(loads), np.log(errors)))
                    worst[kind][name][row] = np.maximum(worst[kind][name][row], here)
        return {
            kind: {name: falling(rows, family) for name, rows in media.items()}
            for kind, media in worst.items()
        }

    forms = np.abs([compute_form_coefficients(shapes()[label].shape) for label in found]).max(
        axis=0
    )
    return {
        "made_by": "tests/benchmarks/accuracy_with_friction.py",
        "shape": even_shape(find_lattice(lattice), scope.side),
        "samples": scope.samples,
        "ratio": WIDTH / DIAMETER,
        "distributions": list(found),
        "most": {"skewness": float(forms[0]) + 1e-6, "kurtosis": float(forms[1]) + 1e-6},
        "mindlin_ratios": [
            packing(gp.Uniform(2e-6), ratio).mindlin_ratio for ratio in POISSON_RATIOS
        ],
        "loads": {kind: at.tolist() for kind, at in places.items()},
        "truths": [
            {
                # infinity is no number of JSON
                "friction_coefficient": mu if math.isfinite(mu) else str(mu),
                "shear_response": response,
                "errors": {family: collect(mu, response, family) for family in FAMILIES},
            }
            for mu in COEFFICIENTS
            for response in scope.responses
        ],
    }


# -- held back -------------------------------------------------------------------------------------


def trials(
    lattice: str, seed: int, samples: int, loads: int, spreads: Sequence[str]
) -> Iterator[Trial]:
    """Random Poisson ratios, friction coefficients, responses and loads, for each of the
    distributions that were held back.

    Seeds, Poisson ratios and friction coefficients are others than those of the table. Width and
    modulus scale the units. Truths are ``samples`` samples of the size that the scope of the
    lattice has.
    """
    draw = np.random.default_rng(seed)
    scope = SCOPES[lattice]
    shape = even_shape(find_lattice(lattice), scope.true_side)
    (least, greatest) = scope.tried
    for label in spreads:
        spread = other_shapes()[label]
        for low, high in ((0.1, 0.2), (0.2, 0.5), (0.5, 2.0)):
            ratio = float(draw.uniform(0.0, 0.5))
            mu = float(draw.uniform(low, high))
            forces = np.sort(
                np.exp(draw.uniform(math.log(least), math.log(greatest), loads))
            ).tolist()
            truth = LoadedReference(lattice, spread, ratio, mu, forces, shape, 20_000, samples)
            for response in scope.responses:
                truth.respond(response)
                options = {
                    "friction_history": True,
                    "friction_coefficient": mu,
                    "shear_response": response,
                }
                yield from try_tolerances(
                    truth, truth.balls, numbers(truth.state), scope.largest, **options
                )


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser("What the media are worth against arrays loaded with friction", SCOPES)
    parser.add_argument(
        "--keep", type=Path, help="folder to keep what was measured of each distribution"
    )
    options = parser.parse_args(argv)
    data = json.loads(DATA.read_text(encoding="utf-8"))
    for lattice in [options.lattice] if options.lattice else SCOPES:
        if not options.held_back:
            made = table(lattice, measure_all(lattice, options.keep))
            data["loaded"][lattice] = made
            if options.write:
                DATA.write_text(text(data), encoding="utf-8")
            else:
                print(text({"loaded": {lattice: made}}))
        show_kept(lattice, trials(lattice, 1, SCOPES[lattice].true_samples, 4, HELD_BACK))
    return 0


if __name__ == "__main__":
    sys.exit(main())
