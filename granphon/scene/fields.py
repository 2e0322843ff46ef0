"""Rules for those values of a scene file that are not single quantities: ranges, spreads, media, parameters, grids.

A rule reads a value or raises :class:`~granphon.base.errors.Refused`, see :mod:`granphon.base.validation`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from granphon.balls.diameters import Discrete, Measured, Normal, Uniform
from granphon.balls.lattices import LATTICES, TRIANGULAR, Lattice, as_direction, find_lattice
from granphon.balls.material import read_poisson_ratio
from granphon.balls.motions import allowed_motions
from granphon.balls.packing import MINDLIN
from granphon.balls.parameters import PARAMETERS, Axis, find_double
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import DENSITY, LENGTH, MODULUS, NUMBER, WIDTH, Quantity, load_quantities
from granphon.base.tables import Heading, table_text
from granphon.base.text import closest, show
from granphon.base.validation import (
    Rule,
    block,
    choice,
    each,
    grid,
    is_whole,
    label,
    number,
    text,
    truth,
    whole,
    zero_or_above,
)
from granphon.media.choice import MEDIA, MediumChoice, read_medium

#: version number of the layout of a scene file, its key "schema"
SCENE_SCHEMA = 1
#: what a scene may compute, in the order in which a scene keeps it
OBSERVABLES = ("velocities", "bands", "dos", "spectrum", "pulse")
#: how the points of a range may be spaced; the first is the default
SCALES = ("log", "linear")

#: greatest number of measured diameters that a scene file lists itself; more are written to a table beside it
MOST_DIAMETERS = 1000
#: name of that table
DIAMETERS_FILE = "diameters.csv"

AnySpread = Uniform | Normal | Discrete | Measured
#: where the balls of a lattice of one, two or three dimensions lie
_PLACES = ("on a line", "in a plane", "in space")
#: the block of a lattice that has no name of its own
_OWN_LATTICE = "a block of name, cell (vectors, in spacings of touching balls) and sites (fractions)"


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


def read_media(value: Any, lattice: Lattice, written: bool = False) -> tuple[MediumChoice, ...]:
    """Read one medium, or a list of them, on a lattice: its number of periods says what the shape of a sample is.

    What is ``written`` in a file has units.
    """
    rule = partial(read_medium, lattice=lattice, written=written)
    if not isinstance(value, list | tuple):
        return (rule(value),)
    found: tuple[MediumChoice, ...] = each(value, rule, "media")
    labels = [one.label for one in found]
    double = [label for label in labels if labels.count(label) > 1]
    if double:
        raise Refused(f"{double[0]!r} twice", f"{', '.join(MEDIA)}, each once")
    return found


def read_parameters(value: Any, folder: Path, lattice: Lattice = TRIANGULAR) -> tuple[tuple[str, tuple[Any, ...]], ...]:
    """Read the parameters of the packing that a sweep varies, each with its values, in the order given.

    If the lattice is not swept, it is ``lattice``. Motions must be those of every lattice.
    """
    swept = read_lattices(value["lattice"]) if isinstance(value, Mapping) and "lattice" in value else (lattice,)
    lattices = tuple(map(find_lattice, swept))
    numbers: dict[str, Rule] = {name: kind.read for name, kind in _QUANTITIES.items()} | _PLAIN
    others: dict[str, Rule] = {
        "spread": partial(read_spread, folder=folder), "friction": truth,
        "motions": partial(read_motions, lattices=lattices),
    }  # fmt: skip
    rules: dict[str, Rule] = {name: partial(read_values, rule=rule) for name, rule in numbers.items()}
    rules |= {name: partial(each, rule=rule, what="values") for name, rule in others.items()}
    rules["lattice"] = read_lattices
    return tuple(block(value, {name: partial(_read_once, rule=rules[name]) for name in PARAMETERS}).items())


def _read_once(value: Any, rule: Rule) -> tuple[Any, ...]:
    """Read the values of a parameter by a rule, and refuse one that stands there twice."""
    found: tuple[Any, ...] = rule(value)
    if (double := find_double(found)) is not None:
        told = show(value[double]) if isinstance(value, list | tuple) else "a value"
        raise Refused(f"{told} twice", "each value once", path=(double,) if isinstance(value, list | tuple) else ())
    return found


def write_parameter(name: str, given: Sequence[Any]) -> Any:
    """Write the values of one parameter so that :func:`read_parameters` reads them back to the last bit."""
    if name in _QUANTITIES:
        return write_values(given, _QUANTITIES[name].write)
    if name in _PLAIN and not any(isinstance(value, str) for value in given):
        return write_values(given, float)
    others: dict[str, Rule] = {"spread": write_spread, "lattice": write_lattice, "friction": bool}
    others |= {"motions": str, "torsion": write_torsion}
    return [others[name](value) for value in given]


# -- single values --------------------------------------------------------------------------------------------------


def read_lattice(value: Any) -> str | Lattice:
    """Read the name of a built-in lattice, or the block of another; "hexagonal" is refused, as several are called so."""
    if isinstance(value, dict):
        return _read_own_lattice(value)
    allowed = f"{', '.join(LATTICES)}, or {_OWN_LATTICE}"
    if value == "hexagonal":
        raise Refused("'hexagonal'", allowed, "Did you mean 'triangular', with six neighbours?")
    try:
        return choice(value, tuple(LATTICES))
    except Refused as refused:
        raise Refused(refused.found, allowed, refused.mend) from None


def _read_own_lattice(value: dict[str, Any]) -> Lattice:
    """Read a block {name, cell, sites}; one ball at the origin if the sites are left out."""
    rows = partial(each, rule=partial(each, rule=_read_fraction, what="numbers"), what="lists of numbers")
    given = block(value, {"name": label, "cell": rows, "sites": rows}, ("name", "cell"))
    try:
        return Lattice(**given)
    except InputError as error:
        raise Refused(show(given["name"]), "a lattice of balls that touch and do not overlap", str(error)) from None


def _read_fraction(value: Any) -> float:
    """Read a plain number, or a fraction such as "1/3"."""
    if isinstance(value, str) and (parts := re.fullmatch(r"([-+]?[0-9]{1,9})/(0*[1-9][0-9]{0,8})", value)):
        return int(parts[1]) / int(parts[2])
    return number(value, -1e3, 1e3)


def read_lattices(value: Any) -> tuple[str | Lattice, ...]:
    """Read a list of lattices of one dimension, which a sweep takes in turn."""
    found: tuple[str | Lattice, ...] = each(value, read_lattice, "values")
    try:
        Axis.of("lattice", found)
    except InputError as error:
        raise Refused(show(value), "lattices of one dimension, each once", str(error)) from None
    return found


def choose_lattice(own: Lattice, swept: Sequence[str | Lattice]) -> Lattice:
    """Return the lattice to which the keys of a scene refer: its packing's, or the first of a sweep in another dimension."""
    first = find_lattice(swept[0]) if swept else own
    return own if (first.periods, first.dimension) == (own.periods, own.dimension) else first


def write_lattice(lattice: str | Lattice) -> str | dict[str, Any]:
    """Return the name of a built-in lattice, or the block of another; :func:`read_lattice` reads it back to the last bit."""
    structure = find_lattice(lattice)
    if LATTICES.get(structure.name) == structure:
        return structure.name
    return {"name": structure.name, "cell": structure.vectors.tolist(), "sites": [list(site) for site in structure.sites]}


def read_motions(value: Any, lattices: Sequence[Lattice]) -> str:
    """Read the name of motions that the balls of each of the lattices can have."""
    for lattice in lattices:
        options = tuple(allowed_motions(lattice.dimension))
        if not (isinstance(value, str) and value in options):
            allowed = f"{', '.join(options)}; the {lattice.name} lattice lies {_PLACES[lattice.dimension - 1]}"
            meant = closest(value.replace(" ", "_"), options) if isinstance(value, str) else None
            raise Refused(show(value), allowed, f"Did you mean {meant!r}?" if meant else "")
    return str(value)


def read_torsion(value: Any) -> float | str:
    """Read a torsional stiffness over k d^2, zero or above, or the word for that of a contact that does not slip."""
    if value == MINDLIN:
        return MINDLIN
    try:
        return zero_or_above(value)
    except Refused as refused:
        meant = closest(value, (MINDLIN,)) if isinstance(value, str) else None
        allowed = f"{refused.allowed}, or {MINDLIN}"
        raise Refused(refused.found, allowed, f"Did you mean {meant!r}?" if meant else refused.mend) from None


def write_torsion(value: float | str) -> float | str:
    """Return a torsional stiffness as :func:`read_torsion` reads it."""
    return value if isinstance(value, str) else float(value)


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


# -- what depends on the dimension ---------------------------------------------------------------------------


#: the mesh of a density of states for one, two and three periods, if a scene gives none
MESHES = ((1024,), (64, 64), (32, 32, 32))


def supercell(value: Any, lattice: Lattice) -> tuple[int, ...]:
    """Read the cells of a supercell along each period of a lattice."""
    return _read_grid(value, lattice, ("3 1 1", "3 3 1", "3 3 3"), 2, 100)


def mesh_numbers(value: Any, lattice: Lattice) -> tuple[int, ...]:
    """Read the wave vectors of a mesh along each period of a lattice; in space a 1 would be the mesh of a plane."""
    return _read_grid(value, lattice, ("1024 1 1", "64 64 1", "32 32 32"), 2 if lattice.periods == 3 else 1, 4096)


def _read_grid(value: Any, lattice: Lattice, examples: Sequence[str], low: int, high: int) -> tuple[int, ...]:
    p = lattice.periods
    given = [value] if p == 1 and is_whole(value) else value
    return grid(given, low, high, examples[p - 1], p)


def write_grid(numbers: Sequence[int]) -> str:
    """Return whole numbers for each period as three words, as phonopy writes them: 1 beyond the periods."""
    return " ".join(map(str, (*numbers, 1, 1)[:3]))


def read_directions(value: Any, lattice: Lattice) -> tuple[Any, ...]:
    """Read the direction of sound on a lattice, Cartesian: one as its numbers, many as a tuple of these."""
    p = lattice.periods
    example = ("[1]", "[1, 1]", "[1, 1, 0]")[p - 1]
    allowed = f"{('one number', 'two numbers', 'three numbers')[p - 1]}, not all zero, such as {example}; or a list of these"
    plain = value.tolist() if isinstance(value, np.ndarray) else value
    many = isinstance(plain, list | tuple) and any(
        isinstance(one, list | tuple) or (isinstance(one, str) and len(one.split()) > 1) for one in plain
    )
    found: list[tuple[float, ...]] = []
    seen = []
    for place, one in enumerate(plain if many else [plain]):
        path = (place,) if many else ()
        try:
            found.append(_read_direction(one))
            seen.append(as_direction(found[-1], p).tolist())
        except InputError:
            raise Refused(show(one), allowed, f"The {lattice.name} lattice lies {_PLACES[p - 1]}.", path) from None
        if seen[-1] in seen[:-1]:
            raise Refused(f"{show(one)} twice", "each direction once", path=path)
    return tuple(found) if many else found[0]


def _read_direction(value: Any) -> tuple[float, ...]:
    """Read the numbers of one direction, as a list or as a text such as "1 1 0"; a single number is that of a line."""
    words = value.split() if isinstance(value, str) else value if isinstance(value, list | tuple) else [value]
    return tuple(_read_fraction(float(one) if isinstance(one, str) and re.fullmatch(NUMBER, one) else one) for one in words)


def read_load(value: Any, kind: str, lattice: Lattice) -> float:
    """Read a load of a ``kind`` on a lattice: its number of periods says what a pressure is."""
    quantity = load_quantities(lattice.periods)[kind]
    try:
        return quantity.read(value)
    except Refused as refused:
        if kind != "pressure" or not _measures_another(value, quantity):
            raise
        mend = f"The pressure of the {lattice.name} lattice is in {quantity.unit}."
        raise Refused(refused.found, refused.allowed, f"{mend} {refused.mend}".rstrip()) from None


def _measures_another(value: Any, wanted: Quantity) -> bool:
    """Whether a text holds a pressure of a lattice with another number of periods."""
    for other in (load_quantities(p)["pressure"] for p in (1, 2, 3)):
        if other.unit != wanted.unit:
            with suppress(Refused):
                other.read(value)
                return True
    return False


_QUANTITIES = {"young_modulus": MODULUS, "density": DENSITY, "diameter": LENGTH, "width": WIDTH}
#: the parameters that are plain numbers
_PLAIN: dict[str, Rule] = {"poisson_ratio": read_poisson_ratio, "torsion": read_torsion, "bending": zero_or_above}
segment_points = partial(whole, low=2, high=100_000)
