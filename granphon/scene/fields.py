"""Rules for those values of a scene file that are not single quantities: ranges, spreads, media, parameters, grids.

A rule reads a value or raises :class:`~granphon.base.errors.Refused`, see :mod:`granphon.base.validation`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from granphon.balls.diameters import Discrete, Measured, Normal, Uniform
from granphon.balls.lattices import LATTICES, Lattice, find_lattice
from granphon.balls.material import read_poisson_ratio
from granphon.balls.parameters import PARAMETERS
from granphon.base.errors import InputError, Refused, message
from granphon.base.quantities import DENSITY, LENGTH, MODULUS, WIDTH
from granphon.base.tables import Heading, table_text
from granphon.base.text import show
from granphon.base.validation import Rule, block, choice, each, grid, number, text, truth, whole
from granphon.media.choice import MEDIA, MediumChoice, medium

__all__ = ["OBSERVABLES", "SCALES", "SCENE_SCHEMA", "read_values", "space_evenly"]

#: version number of the layout of a scene file, its key "schema"
SCENE_SCHEMA = 1
#: what a scene may compute, in the order in which a scene keeps it
OBSERVABLES = ("velocities", "bands", "dos")
#: how the points of a range may be spaced; the first is the default
SCALES = ("log", "linear")

#: greatest number of measured diameters that a scene file lists itself; more are written to a table beside it
MOST_DIAMETERS = 1000

AnySpread = Uniform | Normal | Discrete | Measured


# -- lists and ranges -----------------------------------------------------------------------------------------------


def read_values(value: Any, rule: Rule) -> tuple[float, ...]:
    """Read a number or quantity, a list of them, or a range {from, to, points, scale}, evenly spaced on that scale."""
    if isinstance(value, list | tuple):
        return each(value, rule, "values")
    if not isinstance(value, dict):
        return (rule(value),)
    points = partial(whole, low=1, high=200_000)
    rules: dict[str, Rule] = {"from": rule, "to": rule, "points": points, "scale": partial(choice, options=SCALES)}
    given = block(value, rules, ("from", "to", "points"))
    first, last, count, scale = given["from"], given["to"], given["points"], given.get("scale", SCALES[0])
    if (first == last) != (count == 1):
        found = f"{count} for the range from {value['from']} to {value['to']}"
        raise Refused(found, "1 if both ends are the same, 2 or more if they are not", path=("points",))
    if scale == "log" and min(first, last) <= 0.0:
        raise Refused(f"a log range from {value['from']} to {value['to']}", "values above zero", "Write scale: linear.")
    return space_evenly(first, last, count, scale)


def space_evenly(first: float, last: float, count: int, scale: str) -> tuple[float, ...]:
    """Return ``count`` numbers, evenly spaced on a log or a linear scale, from exactly ``first`` to exactly ``last``."""
    between = np.geomspace if scale == "log" else np.linspace
    with np.errstate(all="ignore"):  # the ends may be the smallest and the largest numbers of double precision
        return tuple(between(first, last, count).tolist())


def write_values(given: Sequence[float], write: Callable[[float], Any]) -> Any:
    """Write values as one number, as a range if that gives the same values, or else as a list.

    :func:`read_values` reads them back to the last bit.
    """
    first, last, count = given[0], given[-1], len(given)
    if count == 1:
        return write(first)
    for scale in SCALES:
        if (
            count > 2
            and first != last
            and (scale == "linear" or min(first, last) > 0.0)
            and space_evenly(first, last, count, scale) == tuple(given)
        ):
            return {"from": write(first), "to": write(last), "points": count, "scale": scale}
    return [write(value) for value in given]


# -- spreads --------------------------------------------------------------------------------------------------------


def read_spread(value: Any, folder: Path) -> AnySpread:
    """Read the distribution of diameters, one of uniform, normal, discrete, measured; its file is sought in ``folder``."""
    measured = partial(_read_measured, folder=folder)
    kinds: dict[str, Rule] = {
        "uniform": _read_uniform,
        "normal": _read_normal,
        "discrete": _read_discrete,
        "measured": measured,
    }
    allowed = f"exactly one of {', '.join(kinds)}"
    if not isinstance(value, dict):
        mend = f"Did you mean {{uniform: {value}}}?" if isinstance(value, str) else "Leave spread out for equal balls."
        raise Refused(show(value), allowed, mend)
    if len(value) != 1:
        raise Refused(" and ".join(map(str, value)) or "no spread", allowed)
    (found,) = block(value, kinds).values()
    return found  # type: ignore[no-any-return]


def _read_uniform(value: Any) -> Uniform:
    return Uniform(WIDTH.read(value))


def _read_normal(value: Any) -> Normal:
    """Read a standard deviation, or a block {std, cutoff}."""
    if not isinstance(value, dict):
        return Normal(WIDTH.read(value))
    cutoff = partial(number, low=1e-3, high=10.0)
    return Normal(**block(value, {"std": WIDTH.read, "cutoff": cutoff}, ("std",)))


def _read_discrete(value: Any) -> Discrete:
    """Read a block {diameters, fractions} of two lists of the same length."""
    rules = {
        "diameters": _read_diameters,
        "fractions": partial(each, rule=partial(number, low=0.0, high=1.0), what="fractions"),
    }
    given = block(value, rules, tuple(rules))
    try:
        return Discrete(**given)
    except InputError as error:
        allowed = "one fraction for each diameter, with the sum 1"
        raise Refused(show(given["fractions"]), allowed, str(error), ("fractions",)) from None


def _read_measured(value: Any, folder: Path) -> Measured:
    """Read the name of a table, a block {file, column}, or a block {diameters}."""
    if isinstance(value, dict) and "diameters" in value:
        return Measured(block(value, {"diameters": _read_diameters})["diameters"])
    given = block(value, {"file": text, "column": text}, ("file",)) if isinstance(value, dict) else {"file": text(value)}
    try:
        return Measured.from_csv(folder / given["file"], given.get("column"), quoted=False)
    except InputError as error:
        raise Refused(show(given["file"]), "a table with a column of diameters", str(error)) from None


def table_named(value: Any) -> str | None:
    """Name of the table that a spread of a valid scene file takes its diameters from; None if it names no table."""
    measured = value.get("measured") if isinstance(value, dict) else None
    return measured.get("file") if isinstance(measured, dict) else measured


_read_diameters = partial(each, rule=LENGTH.read, what="diameters")


def write_spread(given: Any, table: str = "") -> dict[str, Any]:
    """Write a spread so that :func:`read_spread` reads it back to the last bit.

    More than :data:`MOST_DIAMETERS` measured diameters are written as the name ``table`` of their table, if one is given.
    """
    if isinstance(given, Uniform):
        return {"uniform": WIDTH.write(given.width)}
    if isinstance(given, Normal):
        return {"normal": {"std": WIDTH.write(given.std), "cutoff": given.cutoff}}
    if table and _is_long(given):
        return {"measured": table}
    diameters = [LENGTH.write(diameter) for diameter in given.diameters]
    if isinstance(given, Discrete):
        return {"discrete": {"diameters": diameters, "fractions": given.fractions}}
    return {"measured": {"diameters": diameters}}


def _is_long(given: Any) -> bool:
    """Whether a spread has more measured diameters than a scene file lists itself."""
    return isinstance(given, Measured) and len(given.diameters) > MOST_DIAMETERS


def diameters_table(given: Any) -> str | None:
    """Text of a table of the measured diameters, m, if they are too many for a scene file; else None."""
    if not _is_long(given):
        return None
    return table_text([Heading("diameter", LENGTH.unit)], ([diameter] for diameter in given.diameters))


# -- media, and what a sweep goes over ------------------------------------------------------------------------------


def read_media(value: Any) -> tuple[MediumChoice, ...]:
    """Read one medium, or a list of them."""
    if not isinstance(value, list | tuple):
        return (medium(value),)
    found: tuple[MediumChoice, ...] = each(value, medium, "media")
    labels = [one.label for one in found]
    double = [label for label in labels if labels.count(label) > 1]
    if double:
        raise Refused(f"{double[0]!r} twice", f"{', '.join(MEDIA)}, each once")
    return found


_QUANTITIES = {"young_modulus": MODULUS, "density": DENSITY, "diameter": LENGTH, "width": WIDTH}


def read_parameters(value: Any, folder: Path) -> tuple[tuple[str, tuple[Any, ...]], ...]:
    """Read the parameters of the packing that a sweep varies, each with its values, in the order given."""
    numbers: dict[str, Rule] = {name: kind.read for name, kind in _QUANTITIES.items()} | {
        "poisson_ratio": read_poisson_ratio
    }
    others: dict[str, Rule] = {"spread": partial(read_spread, folder=folder), "friction": truth, "lattice": read_lattice}
    rules = {name: partial(read_values, rule=rule) for name, rule in numbers.items()}
    rules |= {name: partial(each, rule=rule, what="values") for name, rule in others.items()}
    return tuple(block(value, {name: rules[name] for name in PARAMETERS}).items())


def write_parameter(name: str, given: Sequence[Any]) -> Any:
    """Write the values of one parameter so that :func:`read_parameters` reads them back to the last bit."""
    if name in _QUANTITIES:
        return write_values(given, _QUANTITIES[name].write)
    if name == "poisson_ratio":
        return write_values(given, float)
    others: dict[str, Rule] = {"spread": write_spread, "lattice": write_lattice, "friction": bool}
    return [others[name](value) for value in given]


# -- single values --------------------------------------------------------------------------------------------------


def read_lattice(value: Any) -> str:
    """Read the name of a built-in lattice; "hexagonal" is refused, as several lattices are called so."""
    if value == "hexagonal":
        raise Refused("'hexagonal'", ", ".join(LATTICES), "Did you mean 'triangular', with six neighbours?")
    return choice(value, tuple(LATTICES))


def write_lattice(lattice: str | Lattice) -> str:
    """Return the name of a lattice, as a scene file gives it.

    Raises :class:`~granphon.base.errors.InputError` if no built-in lattice has that name, or the one that has it is
    different.
    """
    structure = find_lattice(lattice)
    if LATTICES.get(structure.name) != structure:
        raise InputError(message("a scene file can name a built-in lattice only", mend="Use one of " + ", ".join(LATTICES)))
    return structure.name


def read_schema(value: Any) -> int:
    """Read the number of the schema of a scene file, which must be the one that this granphon reads."""
    if value == SCENE_SCHEMA and isinstance(value, int) and not isinstance(value, bool):
        return SCENE_SCHEMA
    newer = isinstance(value, int) and value > SCENE_SCHEMA
    raise Refused(show(value), str(SCENE_SCHEMA), "The scene was written for a newer granphon." if newer else "")


def read_observables(value: Any) -> tuple[str, ...]:
    """Read the names of what a scene observes, each once; they are returned in the order of ``OBSERVABLES``."""
    allowed = "a list of one or more of " + ", ".join(OBSERVABLES)
    if not isinstance(value, list | tuple) or not value:
        mend = f"Did you mean [{value}]?" if isinstance(value, str) and value in OBSERVABLES else ""
        raise Refused(show(value) if value != [] else "an empty list", allowed, mend)
    names = tuple(choice(name, OBSERVABLES) for name in value)
    double = [name for name in names if names.count(name) > 1]
    if double:
        raise Refused(f"{double[0]!r} twice", allowed + ", each once")
    return tuple(name for name in OBSERVABLES if name in names)


supercell = partial(grid, low=2, high=100, example="3 3 1")
mesh_numbers = partial(grid, low=1, high=4096, example="64 64 1")
segment_points = partial(whole, low=2, high=100_000)
