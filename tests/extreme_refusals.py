"""What is refused at the edges, and the page of both: ``python -m tests.extreme_refusals --write``
makes its tables.

A :class:`Refusal` holds calls that must end in an error of the package, with nothing else said or
returned.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import granphon as gp
from granphon.base import errors
from granphon.dynamics.local_field import local_field
from tests.extreme_cases import CASES, STEEL, TAILS, D, K, M, worst
from tests.extreme_crystals import CRYSTALS

PAGE = Path(__file__).parent.parent / "docs" / "reference" / "extremes.md"
BEGIN = "<!-- table: python -m tests.extreme_refusals --write -->"
END = "<!-- end -->"


@dataclass(frozen=True)
class Refusal:
    """Each of ``attempts`` over ``reach`` raises ``error``, with nothing else said or returned.

    ``slow``: it takes more than half a second, and a test beside it shows the like.
    """

    name: str
    reach: str
    error: type[errors.GranphonError]
    attempts: Callable[[], Iterable[Callable[[], Any]]]
    slow: bool = False


def unusable_balls() -> Iterable[Callable[[], Any]]:
    yield lambda: gp.Packing(gp.Material(5e-324, 0.3, 1.0), 1.0)
    for young, density, d in itertools.product(
        (1e-308, 1.0, 1.7e308), (5e-324, 1e3, 1.7e308), (5e-324, 1e-2, 1.7e308)
    ):
        if (young, density, d) != (1.0, 1e3, 1e-2):
            yield lambda young=young, density=density, d=d: gp.Packing(
                gp.Material(young, 0.3, density), d
            )


def _loads(values: Iterable[float], medium: Any) -> Iterable[Callable[[], Any]]:
    for value, name in itertools.product(values, ("at_force", "at_pressure", "at_overlap")):
        yield lambda value=value, name=name: getattr(medium, name)(value)


def unusable_loads() -> Iterable[Callable[[], Any]]:
    spread = gp.Packing(STEEL, D, gp.Uniform(2e-6))
    for medium in (
        gp.AveragedLattice(gp.Packing(STEEL, D)),
        gp.AveragedForce(spread),
        gp.EffectiveMedium(spread),
    ):
        yield from _loads((math.nan, math.inf, -math.inf, 1.7e308, -1.0, 1e13), medium)
    yield from _loads((5e-324, 1e-320, 0.0, -0.0), gp.AveragedLattice(gp.Packing(STEEL, D)))
    yield from _loads((math.nan, math.inf, 1.7e308, -1.0), gp.DirectSimulation(spread, (3, 3)))


def too_low_loads() -> Iterable[Callable[[], Any]]:
    packing = gp.Packing(STEEL, D, gp.Uniform(2e-6))
    unit = float(packing.law.force(packing.width))
    yield lambda: gp.EffectiveMedium(packing).at_force(0.99e-6 * unit)
    yield lambda: gp.EffectiveMedium(packing).at_overlap(-0.499 * packing.width)
    yield lambda: gp.EffectiveMedium(packing).at_force([unit, 5e-324])
    yield lambda: gp.AveragedForce(packing).at_force(1e-40 * unit)
    tail = gp.Packing(STEEL, TAILS[0].mean or D, TAILS[0])
    yield lambda: gp.EffectiveMedium(tail).at_force(5e-4 * float(tail.law.force(tail.width)))


def loose_samples() -> Iterable[Callable[[], Any]]:
    simulation = gp.DirectSimulation(gp.Packing(STEEL, D, gp.Uniform(2e-6)), (16, 16))
    unit = float(simulation.packing.law.force(2e-6))
    yield lambda: simulation.at_overlap((0.3 - 0.5) * 2e-6)
    yield lambda: gp.DirectSimulation(simulation.packing, (32, 32), seed=3).at_overlap(
        (0.345 - 0.5) * 2e-6
    )
    yield lambda: simulation.at_force(0.99e-8 * unit)
    yield lambda: simulation.at_pressure(1e-300)
    yield lambda: gp.DirectSimulation(gp.Packing(STEEL, D, gp.Uniform(0.99e-20 * D)))
    yield lambda: gp.DirectSimulation(gp.Packing(STEEL, D, gp.Uniform(1e-300)))
    yield lambda: gp.DirectSimulation(simulation.packing, (0, 5))
    for lattice, cell in (("fcc", (4, 5, 6)), ("hcp", (3, 4, 3))):
        space = gp.DirectSimulation(gp.Packing(STEEL, D, gp.Uniform(2e-6), lattice=lattice), cell)
        yield lambda space=space: space.at_overlap((0.05 - 0.5) * 2e-6)
        yield lambda space=space: space.at_force(0.99e-8 * unit)
        yield lambda space=space: gp.DirectSimulation(space.packing, (0, 5, 5))
        yield lambda space=space: gp.DirectSimulation(space.packing, (5, 5))


def buckled_lattices() -> Iterable[Callable[[], Any]]:
    smooth = gp.AveragedLattice(gp.Packing(STEEL, D, friction=False)).at_overlap(
        0.9 * D, finite_overlap=True
    )
    yield lambda: gp.sound_velocities(smooth)
    yield lambda: gp.moduli(smooth)
    yield lambda: gp.ContactLattice.of("triangular", 0.0, 0.1, 6.0).frequencies([K, M])
    yield lambda: gp.Phonons(smooth).frequencies([[0.1, 0.2]])


def unusable_wavevectors() -> Iterable[Callable[[], Any]]:
    lattice = gp.ContactLattice.of("triangular", 0.84)
    state = gp.AveragedLattice(gp.Packing(STEEL, D)).at_force(18.0)
    for q in (math.nan, math.inf, 1.1e15, 1e200, -1.7e308):
        # a wave vector of the lattice, 1/d, has up to two pi times the number of reciprocal vectors
        yield lambda q=q: lattice.frequencies([[2.0 * math.pi * q, 0.0]])
        yield lambda q=q: gp.Phonons(state).frequencies([[q, 0.0]])
    yield lambda: lattice.modes([[0.0, 0.0]])
    yield lambda: lattice.modes([[1.0, 0.0]], (0.0, 0.0))
    yield lambda: gp.pulse_velocities(state, 0.0)


def unusable_spreads() -> Iterable[Callable[[], Any]]:
    for fraction in (5e-324, 1e-300, 0.99e-12):
        yield lambda fraction=fraction: gp.Discrete((D, 2 * D), (1.0, fraction))
    yield lambda: gp.Uniform(math.nan)
    yield lambda: gp.Packing(STEEL, D, gp.Uniform(2.0 * D))
    yield lambda: gp.Packing(STEEL, D, gp.Uniform(1.7e308))
    yield lambda: gp.Measured((D, 5e-324, math.inf))


def unusable_crystals() -> Iterable[Callable[[], Any]]:
    """Motions and stiffnesses that a lattice does not have, cells that hold no balls, waves that
    leave the lattice.
    """
    for stiffness in (-1.0, -5e-324, math.nan, math.inf):
        yield lambda x=stiffness: gp.Packing(STEEL, D, lattice="fcc", torsion=x)
        yield lambda x=stiffness: gp.Packing(STEEL, D, lattice="chain", motions="all", bending=x)
    yield lambda: gp.Packing(STEEL, D, lattice="fcc", motions="in_plane")
    yield lambda: gp.Packing(STEEL, D, lattice="chain", torsion=0.1)
    yield lambda: gp.Lattice("crushed", np.eye(3).tolist(), [[0, 0, 0], [0.5, 0.5, 0.5 + 1e-5]])
    yield lambda: gp.Lattice("flat", [[1, 0, 0], [0, 1, 0], [1, 1, 1e-9]])
    fcc = gp.AveragedLattice(gp.Packing(STEEL, D, lattice="fcc")).at_force(18.0)
    for direction in ((0.0, 0.0, 0.0), (1.0, math.nan, 0.0), (1.0, 0.0)):
        yield lambda along=direction: gp.sound_velocities(fcc, along)
    yield lambda: gp.Phonons(fcc).frequencies([[0.1, 0.2]])
    yield lambda: gp.Phonons(fcc).dos((8, 8))
    yield lambda: gp.Phonons(gp.AveragedLattice(gp.Packing(STEEL, D)).at_force(18.0)).bands(
        [[0, 0, 0], [0, 0, 0.5]]
    )


def fast_pulses() -> Iterable[Callable[[], Any]]:
    state = gp.AveragedLattice(gp.Packing(STEEL, D)).at_force(18.0)
    for factor in (3.0, 1e30, 1e300, 1e304):
        yield lambda factor=factor: gp.pulse_velocities(state, factor * state.scales.frequency)


def loose_fields() -> Iterable[Callable[[], Any]]:
    yield lambda: local_field("kagome", 1e-18)
    yield lambda: local_field("sc", 1e8)


def unheld_balls() -> Iterable[Callable[[], Any]]:
    """Lattices in which nothing holds the neighbours of a ball."""
    for lattice in ("square", "kagome", "sc", "bcc", "diamond"):
        yield lambda lattice=lattice: local_field(lattice)
    yield lambda: local_field("diamond", 0.84)
    yield lambda: gp.EffectiveMedium(
        gp.Packing(STEEL, D, gp.Uniform(1e-6), "bcc", friction=False)
    ).at_force(1.0)


REFUSALS = [
    Refusal(
        "balls beyond double precision",
        "E, ρ or d near 5e-324 or 1.7e308",
        errors.InputError,
        unusable_balls,
    ),
    Refusal(
        "loads that cannot be",
        "not finite, zero, tensile, subnormal, or an overlap of d or more",
        errors.InputError,
        unusable_loads,
    ),
    Refusal(
        "loads too low for a medium",
        "f* < 1e-6 in the effective medium, or where (36) has no solution (rare large balls);"
        " first contact, averaged force",
        errors.PrecisionError,
        too_low_loads,
    ),
    Refusal(
        "samples that nothing holds, or that cannot be",
        "a* below the rigidity threshold, f* < 1e-8, W < 1e-20 d, no balls",
        errors.InputError,
        loose_samples,
        slow=True,
    ),
    Refusal(
        "lattices that buckle",
        "finite overlap of 0.9 d without friction",
        errors.InstabilityError,
        buckled_lattices,
    ),
    Refusal(
        "wave vectors that cannot be",
        "not finite, or beyond 1e15 reciprocal vectors; Γ without a direction; a direction of"
        " no length; no frequency",
        errors.InputError,
        unusable_wavevectors,
    ),
    Refusal(
        "pulses that no branch carries",
        "a frequency above the top",
        errors.UnreachableFrequencyError,
        fast_pulses,
    ),
    Refusal(
        "local fields without digits",
        "kagome lattice, η of 1e-18; sc, η of 1e8",
        errors.PrecisionError,
        loose_fields,
        slow=True,
    ),
    Refusal(
        "effective media of lattices that hold no ball",
        "sc, bcc, square, kagome without friction; diamond with friction alone",
        errors.MechanismError,
        unheld_balls,
    ),
    Refusal(
        "spreads that cannot be",
        "not finite, a ball of no size, a kind rarer than 1e-12",
        errors.InputError,
        unusable_spreads,
    ),
    Refusal(
        "crystals that cannot be",
        "motions that a lattice lacks, stiffness below zero or not finite, balls that"
        " overlap, waves of another dimension",
        errors.InputError,
        unusable_crystals,
    ),
]


# -- the page --------------------------------------------------------------------------------------


def tables(seen: Sequence[str]) -> str:
    """The two tables of the page, the last column of the first one given."""
    lines = ["| case | range | claimed error | worst seen |", "|---|---|---|---|"]
    lines += [
        f"| {escaped(c.name)} | {escaped(c.reach)} | {c.claim:.0e} | {found} |"
        for c, found in zip([*CASES, *CRYSTALS], seen, strict=True)
    ]
    lines += ["", "| refused | range | error |", "|---|---|---|"]
    lines += [f"| {r.name} | {escaped(r.reach)} | `{r.error.__name__}` |" for r in REFUSALS]
    return "\n".join(lines)


def escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("*", "\\*")


def printed() -> str:
    """What the page has between its marks."""
    return PAGE.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0].strip()


if __name__ == "__main__":
    found = [f"{worst(case):.1e}" for case in (*CASES, *CRYSTALS)]
    text = tables(found)
    print(text)
    if "--write" in sys.argv:
        before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
        PAGE.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.split(END)[1]}", encoding="utf-8")
