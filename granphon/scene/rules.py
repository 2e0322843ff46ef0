"""How values of a scene file are read and written, one :class:`Kind` for each sort of value.

A reader takes a value of the file and the :class:`Context` of the scene, and raises
:class:`~granphon.base.errors.Refused` for a value that is not allowed, see
:mod:`granphon.base.validation`. A writer returns plain data that the reader turns into the same
value, to the last bit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from granphon.balls.ball import Ball
from granphon.balls.contact_laws import LAWS, TabulatedLaw
from granphon.balls.diameters import Discrete, Measured, Normal, Uniform
from granphon.balls.lattices import (
    LATTICES,
    STRUCTURES,
    TRIANGULAR,
    Lattice,
    as_direction,
    find_lattice,
    name_structure,
)
from granphon.balls.layers import read_axis, read_edges
from granphon.balls.material import Material, read_poisson_ratio
from granphon.balls.motions import allowed_motions
from granphon.balls.packing import (
    KIND_PARAMETERS,
    MINDLIN,
    PARAMETERS,
    Axis,
    find_double,
    find_unit,
)
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import (
    DENSITY,
    FREQUENCY,
    INERTIA,
    LENGTH,
    MASS,
    MODULUS,
    WAY,
    WIDTH,
    Quantity,
    load_quantities,
    tensor_quantities,
)
from granphon.base.text import closest, show
from granphon.base.validation import (
    Rule,
    above_zero,
    block,
    choice,
    each,
    fraction,
    frequencies,
    grid,
    is_one_of,
    is_whole,
    label,
    number,
    read_inside,
    text,
    truth,
    whole,
    zero_or_above,
)
from granphon.media.choice import MEDIA, MediumChoice, read_medium
from granphon.observables.catalogue import CATALOGUE
from granphon.waves.settings import NETWORK_BLOCKS, read_drives, write_drives

#: version number of the layout of a scene file, its key "schema"
SCENE_SCHEMA = 1
#: the observables of a scene, in the order in which a scene keeps them
OBSERVABLES = (
    "velocities",
    "bands",
    "gaps",
    "dos",
    "surface",
    "spectrum",
    "pulse",
    *NETWORK_BLOCKS,
)
#: how the points of a range may be spaced; the first is the default
SCALES = ("log", "linear")

#: greatest number of measured diameters that a scene file lists itself; more are written to a table
#: beside it
MOST_DIAMETERS = 1000
#: name of that table
DIAMETERS_FILE = "diameters.csv"

#: where the balls of a lattice of one, two or three dimensions lie, in words
_POSITIONS = ("on a line", "in a plane", "in space")


@dataclass(frozen=True)
class Context:
    """The parts of a scene on which its values depend.

    Attributes
    ----------
    lattice : lattice of the packing, on which motions, pressures, samples, directions, paths and
        meshes depend.
    swept : the lattices of a sweep; motions must be allowed on each.
    kinds : names of the kinds of balls of a crystal.
    folder : in which tables named in the file are sought.
    written : whether values stand in a file, where quantities have units; in Python plain numbers
        are in SI.
    """

    lattice: Lattice = TRIANGULAR
    swept: tuple[Lattice, ...] = ()
    kinds: tuple[str, ...] = ()
    folder: Path = field(default_factory=Path)
    written: bool = True


class Kind(NamedTuple):
    """How values of one sort are read from a file, and written into it."""

    read: Callable[[Any, Context], Any]
    write: Callable[[Any, Context], Any] = lambda value, _: value

    @classmethod
    def plain(cls, rule: Rule, write: Callable[[Any], Any] = lambda value: value) -> Kind:
        """Return the kind of values that do not depend on the scene."""
        return cls(lambda value, _: rule(value), lambda value, _: write(value))

    def rule(self, context: Context) -> Rule:
        """Return the rule that reads such a value of a scene."""
        return lambda value: self.read(value, context)


def quantity(kind: Quantity) -> Kind:
    """Return the kind of a number with its unit."""
    return Kind.plain(kind.read, kind.write)


@contextmanager
def refusing(value: Any, allowed: str, *path: str) -> Iterator[None]:
    """Turn an error of the block into the refusal of the value at ``path``."""
    try:
        yield
    except InputError as error:
        raise Refused(show(value), allowed, str(error), path) from None


# -- lists and ranges ------------------------------------------------------------------------------


def read_values(value: Any, rule: Rule) -> tuple[float, ...]:
    """Read a number or quantity, a list of them, or a range {from, to, points, scale}, evenly
    spaced on that scale.
    """
    if isinstance(value, list | tuple):
        return each(value, rule, "values")
    if not isinstance(value, dict):
        return (rule(value),)
    points = partial(whole, low=1, high=200_000)
    rules: dict[str, Rule] = {
        "from": rule,
        "to": rule,
        "points": points,
        "scale": partial(choice, options=SCALES),
    }
    settings = block(value, rules, ("from", "to", "points"))
    first = settings["from"]
    last = settings["to"]
    count = settings["points"]
    scale = settings.get("scale", SCALES[0])
    words = f"range from {value['from']} to {value['to']}"
    if (first == last) != (count == 1):
        allowed = "1 if both ends are the same, 2 or more if they are not"
        raise Refused(f"{count} for the {words}", allowed, path=("points",))
    if scale == "log" and min(first, last) <= 0.0:
        raise Refused(f"a log {words}", "values above zero", "Write scale: linear.")
    return space_evenly(first, last, count, scale)


def space_evenly(first: float, last: float, count: int, scale: str) -> tuple[float, ...]:
    """Return ``count`` numbers, evenly spaced on a log or a linear scale, from exactly ``first`` to
    exactly ``last``.
    """
    space = np.geomspace if scale == "log" else np.linspace
    with np.errstate(all="ignore"):
        # the ends may be the smallest and the largest numbers of double precision
        return tuple(space(first, last, count).tolist())


def write_values(values: Sequence[float], write: Callable[[float], Any]) -> Any:
    """Write values as one number, as a range if that gives the same values, or else as a list."""
    first = values[0]
    last = values[-1]
    count = len(values)
    if count == 1:
        return write(first)
    for scale in SCALES if count > 2 and first != last else ():
        positive = scale == "linear" or min(first, last) > 0.0
        if positive and space_evenly(first, last, count, scale) == tuple(values):
            return {"from": write(first), "to": write(last), "points": count, "scale": scale}
    return [write(value) for value in values]


DRIVE = Kind(
    lambda value, context: read_drives(value, folder=context.folder),
    lambda drives, _: write_drives(drives),
)
FREQUENCIES = Kind.plain(
    lambda value: tuple(frequencies(read_values(value, FREQUENCY.read)).tolist()),
    lambda values: write_values(values, FREQUENCY.write),
)


# -- spreads ---------------------------------------------------------------------------------------


#: reads a list of diameters, m
_read_diameters = partial(each, rule=LENGTH.read, what="diameters")


def _read_normal(value: Any) -> Normal:
    """Read a standard deviation, or a block {std, cutoff}."""
    if not isinstance(value, dict):
        return Normal(WIDTH.read(value))
    rules: dict[str, Rule] = {"std": WIDTH.read, "cutoff": partial(number, low=1e-3, high=10.0)}
    return Normal(**block(value, rules, ("std",)))


def _read_discrete(value: Any) -> Discrete:
    """Read a block {diameters, fractions} of two lists of the same length."""
    read_fractions = partial(each, rule=partial(number, low=0.0, high=1.0), what="fractions")
    rules: dict[str, Rule] = {"diameters": _read_diameters, "fractions": read_fractions}
    lists = block(value, rules, ("diameters", "fractions"))
    allowed = "one fraction for each diameter, with the sum 1"
    with refusing(lists["fractions"], allowed, "fractions"):
        return Discrete(**lists)


def _read_measured(value: Any, folder: Path) -> Measured:
    """Read the name of a table, a block {file, column}, or a block {diameters}; tables are sought
    in ``folder``.
    """
    if isinstance(value, dict) and "diameters" in value:
        return Measured(block(value, {"diameters": _read_diameters})["diameters"])
    column = None
    if isinstance(value, dict):
        settings = block(value, {"file": text, "column": text}, ("file",))
        name = settings["file"]
        column = settings.get("column")
    else:
        name = text(value)
    with refusing(name, "a table with a column of diameters"):
        return Measured.from_csv(folder / name, column, quoted=False)


def _read_spread(value: Any, context: Context) -> Any:
    """Read a spread of diameters: a block of one key, the name of the distribution."""
    rules: dict[str, Rule] = {
        "uniform": lambda value: Uniform(WIDTH.read(value)),
        "normal": _read_normal,
        "discrete": _read_discrete,
        "measured": partial(_read_measured, folder=context.folder),
    }
    allowed = f"exactly one of {', '.join(rules)}"
    if not isinstance(value, dict):
        mend = "Leave spread out for equal balls."
        if isinstance(value, str):
            mend = f"Did you mean {{uniform: {value}}}?"
        raise Refused(show(value), allowed, mend)
    if len(value) != 1:
        raise Refused(" and ".join(map(str, value)) or "no spread", allowed)
    (spread,) = block(value, rules).values()
    return spread


def _write_spread(spread: Any, context: Context) -> dict[str, Any]:
    if isinstance(spread, Uniform):
        return {"uniform": WIDTH.write(spread.width)}
    if isinstance(spread, Normal):
        return {"normal": {"std": WIDTH.write(spread.std), "cutoff": spread.cutoff}}
    diameters = {"diameters": [LENGTH.write(diameter) for diameter in spread.diameters]}
    if isinstance(spread, Discrete):
        return {"discrete": diameters | {"fractions": spread.fractions}}
    return {"measured": diameters}


def table_named(value: Any) -> str | None:
    """Name of the table from which a spread of a valid scene file takes its diameters; None for a
    spread without a table.
    """
    measured = value.get("measured") if isinstance(value, dict) else None
    return measured.get("file") if isinstance(measured, dict) else measured


def is_long(spread: Any) -> bool:
    """Whether a spread has more measured diameters than a scene file lists itself."""
    return isinstance(spread, Measured) and len(spread.diameters) > MOST_DIAMETERS


# -- the parameters of the packing, which a sweep may vary -----------------------------------------


def read_lattice(value: Any) -> str | Lattice:
    """Read the name of a built-in lattice, or the block of another; "hexagonal" is refused, as
    several are called so.
    """
    if isinstance(value, dict):  # one ball at the origin if the sites are left out
        row = partial(each, rule=partial(fraction, largest=1e3), what="numbers")
        rows = partial(each, rule=row, what="lists of numbers")
        settings = block(value, {"name": label, "cell": rows, "sites": rows}, ("name", "cell"))
        with refusing(settings["name"], "a lattice of balls that touch and do not overlap"):
            return Lattice(**settings)
    keys = "a block of name, cell (vectors, in spacings of touching balls) and sites (fractions)"
    allowed = f"{', '.join(LATTICES)}, or {keys}"
    if value == "hexagonal":
        raise Refused("'hexagonal'", allowed, "Did you mean 'triangular', with six neighbours?")
    try:
        return choice(value, LATTICES)
    except Refused as refused:
        raise Refused(refused.found, allowed, refused.mend) from None


def write_lattice(lattice: str | Lattice) -> str | dict[str, Any]:
    """Return the name of a built-in lattice, or the block of another."""
    structure = find_lattice(lattice)
    if LATTICES.peek(structure.name) == structure:
        return structure.name
    return {
        "name": structure.name,
        "cell": structure.vectors.tolist(),
        "sites": [list(site) for site in structure.sites],
    }


def read_lattices(value: Any) -> tuple[str | Lattice, ...]:
    """Read a list of lattices of one dimension, which a sweep takes in turn."""
    lattices: tuple[str | Lattice, ...] = each(value, read_lattice, "values")
    with refusing(value, "lattices of one dimension, each once"):
        Axis.of("lattice", lattices)
    return lattices


def choose_lattice(lattice: Lattice, swept: Sequence[str | Lattice]) -> Lattice:
    """Return the lattice to which the keys of a scene refer: the ``lattice`` of the packing, or the
    first of a sweep in another dimension.
    """
    first = find_lattice(swept[0]) if swept else lattice
    is_alike = (first.periods, first.dimension) == (lattice.periods, lattice.dimension)
    return lattice if is_alike else first


def _read_motions(value: Any, context: Context) -> str:
    for lattice in context.swept or (context.lattice,):
        options = tuple(allowed_motions(lattice.dimension))
        if not is_one_of(value, options):
            allowed = (
                f"{', '.join(options)}; the {lattice.name} lattice lies"
                f" {_POSITIONS[lattice.dimension - 1]}"
            )
            meant = closest(value.replace(" ", "_"), options) if isinstance(value, str) else None
            raise Refused(show(value), allowed, f"Did you mean {meant!r}?" if meant else "")
    return str(value)


def _read_torsion(value: Any) -> float | str:
    """Read a torsional stiffness over k d^2, zero or above, or the word for the stiffness of a
    contact that does not slip.
    """
    if value == MINDLIN:
        return MINDLIN
    try:
        return zero_or_above(value)
    except Refused as refused:
        meant = closest(value, (MINDLIN,)) if isinstance(value, str) else None
        allowed = f"{refused.allowed}, or {MINDLIN}"
        raise Refused(
            refused.found, allowed, f"Did you mean {meant!r}?" if meant else refused.mend
        ) from None


#: the kind of each key of the blocks "material" and "packing", and of each parameter of a sweep
PARTS: dict[str, Kind] = {
    "mass": quantity(MASS),
    "young_modulus": quantity(MODULUS),
    "poisson_ratio": Kind.plain(read_poisson_ratio, float),
    "density": quantity(DENSITY),
    "yield_strength": quantity(MODULUS),
    "lattice": Kind.plain(read_lattice, write_lattice),
    "diameter": quantity(LENGTH),
    "width": quantity(WIDTH),
    "spread": Kind(_read_spread, _write_spread),
    "friction": Kind.plain(truth, bool),
    "finite_overlap": Kind.plain(truth),
    "motions": Kind(_read_motions),
    "torsion": Kind.plain(
        _read_torsion, lambda value: value if isinstance(value, str) else float(value)
    ),
    "bending": Kind.plain(zero_or_above, float),
}


def _write_own_spread(spread: Any, context: Context) -> dict[str, Any]:
    return {"measured": DIAMETERS_FILE} if is_long(spread) else _write_spread(spread, context)


#: the spread of a packing: if its diameters are too many, the scene names a table of them
OWN_SPREAD = Kind(_read_spread, _write_own_spread)


def _read_parameters(value: Any, context: Context) -> tuple[tuple[str, tuple[Any, ...]], ...]:
    names = list(PARAMETERS)
    if context.kinds:
        names = [f"{kind}.{name}" for kind in context.kinds for name in KIND_PARAMETERS]
    elif isinstance(value, Mapping) and "lattice" in value:
        context = replace(context, swept=tuple(map(find_lattice, read_lattices(value["lattice"]))))
    rules: dict[str, Rule] = {
        name: partial(_read_axis, name=name, context=context) for name in names
    }
    return tuple(block(value, rules).items())


def _read_axis(value: Any, name: str, context: Context) -> tuple[Any, ...]:
    rule = PARTS[name.rpartition(".")[2]].rule(context)
    values: tuple[Any, ...]
    if find_unit(name):
        values = read_values(value, rule)
    elif name == "lattice":
        values = read_lattices(value)
    else:
        values = each(value, rule, "values")
    index = find_double(values)
    if index is not None and isinstance(value, list | tuple):
        raise Refused(f"{show(value[index])} twice", "each value once", path=(index,))
    if index is not None:
        raise Refused("a value twice", "each value once")
    return values


def _write_parameters(
    parameters: Sequence[tuple[str, tuple[Any, ...]]], context: Context
) -> dict[str, Any] | None:
    def write(name: str, values: tuple[Any, ...]) -> Any:
        if find_unit(name) and not any(isinstance(value, str) for value in values):
            kind = PARTS[name.rpartition(".")[2]]
            return write_values(values, lambda value: kind.write(value, context))
        return [PARTS[name].write(value, context) for value in values]

    return {name: write(name, values) for name, values in parameters} or None


PARAMETERS_SWEPT = Kind(_read_parameters, _write_parameters)


# -- loads, media and observables ------------------------------------------------------------------


def load_kind(name: str) -> Kind:
    """Return the kind of the values of a load; the unit of a pressure depends on the lattice."""

    def has_unit_of_other_lattices(value: Any) -> bool:
        """Whether a value is such a load of a lattice of one, two or three periods."""
        for periods in (1, 2, 3):
            with suppress(Refused):
                load_quantities(periods)[name].read(value)
                return True
        return False

    def read_load(value: Any, context: Context) -> float:
        """Read one number with its unit, N, N/m, Pa or m."""
        quantity = load_quantities(context.lattice.pressed_axes)[name]
        try:
            return quantity.read(value)
        except Refused as refused:
            if not has_unit_of_other_lattices(value):
                raise
            mend = (
                f"The pressure of the {context.lattice.name} lattice is in {quantity.unit}."
                f" {refused.mend}"
            )
            raise Refused(refused.found, refused.allowed, mend.rstrip()) from None

    def read(value: Any, context: Context) -> tuple[float, ...]:
        return read_values(value, lambda number: read_load(number, context))

    def write(load: Any, context: Context) -> Any:
        # gravity alone is a pressure of zero
        if load.kind != name or not any(load.values):
            return None
        return write_values(load.values, load_quantities(context.lattice.pressed_axes)[name].write)

    return Kind(read, write)


def _read_media(value: Any, context: Context) -> tuple[MediumChoice, ...]:
    rule = partial(read_medium, lattice=context.lattice, written=context.written)
    if not isinstance(value, list | tuple):
        return (rule(value),)
    choices: tuple[MediumChoice, ...] = each(value, rule, "media")
    labels = [choice.label for choice in choices]
    for name in labels:
        if labels.count(name) > 1:
            raise Refused(f"{name!r} twice", f"{', '.join(MEDIA)}, each once")
    return choices


def _write_media(choices: Sequence[MediumChoice], context: Context) -> Any:
    settings = [(choice.name, choice.settings_on(context.lattice)) for choice in choices]
    media = [{name: options} if options else name for name, options in settings]
    return media if len(media) > 1 else media[0]


MEDIUM = Kind(_read_media, _write_media)


def read_schema(value: Any) -> int:
    """Read the number of the schema of a scene file, which must be the one that this granphon
    reads.
    """
    if value == SCENE_SCHEMA and is_whole(value):
        return SCENE_SCHEMA
    newer = isinstance(value, int) and value > SCENE_SCHEMA
    raise Refused(
        show(value),
        str(SCENE_SCHEMA),
        "The scene was written for a newer granphon." if newer else "",
    )


def read_observables(value: Any) -> tuple[str, ...]:
    """Read the names of the observables of a scene, each once, and return them in the order of
    ``OBSERVABLES``.

    Registered observables come behind those of the package, and bring the velocities with them if
    they are found from velocities.
    """
    added = {name: entry.cost for name, entry in CATALOGUE.items() if CATALOGUE.is_added(name)}
    observables = (*OBSERVABLES, *added)
    allowed = "a list of one or more of " + ", ".join(observables)
    if not isinstance(value, list | tuple) or not value:
        is_name = isinstance(value, str) and value in observables
        mend = f"Did you mean [{value}]?" if is_name else ""
        raise Refused(show(value) if value != [] else "an empty list", allowed, mend)
    for name in value:
        try:
            choice(name, observables)
        except Refused as refused:
            mend = refused.mend or CATALOGUE.failures
            raise Refused(refused.found, refused.allowed, mend) from None
    names = list(value)
    for name in names:
        if names.count(name) > 1:
            raise Refused(f"{name!r} twice", allowed + ", each once")
    if any(added.get(name, "state") != "state" for name in names):
        names.append(OBSERVABLES[0])
    return tuple(name for name in observables if name in names)


def grid_kind(examples: Sequence[str], low: int, high: int, low_in_space: int) -> Kind:
    """Return the kind of whole numbers for each period, written as phonopy writes them: three
    words, of which those beyond the periods are 1.
    """

    def read(value: Any, context: Context) -> tuple[int, ...]:
        p = context.lattice.periods
        numbers = [value] if p == 1 and is_whole(value) else value
        return grid(numbers, low_in_space if p == 3 else low, high, examples[p - 1], p)

    return Kind(read, lambda numbers, _: write_grid(numbers))


def write_grid(numbers: Sequence[int]) -> str:
    """Return whole numbers for each period as three words."""
    return " ".join(map(str, (*numbers, 1, 1)[:3]))


def read_directions(value: Any, lattice: Lattice) -> tuple[Any, ...]:
    """Read the direction of sound on a lattice, Cartesian: the numbers of one direction, or a tuple
    of such numbers for many directions.

    ``value`` is a text such as "1 1", a list, an array, or a list of these. Raises
    :class:`~granphon.base.errors.Refused` for anything else, and for a direction of zeros.
    """
    p = lattice.periods
    example = ("[1]", "[1, 1]", "[1, 1, 0]")[p - 1]
    allowed = (
        f"{('one number', 'two numbers', 'three numbers')[p - 1]}, not all zero, such as"
        f" {example}; or a list of these"
    )
    plain = value.tolist() if isinstance(value, np.ndarray) else value
    is_list = isinstance(plain, list | tuple) and any(map(_has_numbers, plain))
    directions: list[tuple[float, ...]] = []
    unit_vectors: list[list[float]] = []
    for index, direction in enumerate(plain if is_list else [plain]):
        path = (index,) if is_list else ()
        words = [direction]
        if isinstance(direction, str):
            words = direction.split()
        elif isinstance(direction, list | tuple):
            words = list(direction)
        try:
            numbers = tuple(fraction(word, 1e3) for word in words)
            unit_vector = as_direction(numbers, p).tolist()
        except InputError:
            mend = f"The {lattice.name} lattice lies {_POSITIONS[p - 1]}."
            raise Refused(show(direction), allowed, mend, path) from None
        if unit_vector in unit_vectors:
            raise Refused(f"{show(direction)} twice", "each direction once", path=path)
        directions.append(numbers)
        unit_vectors.append(unit_vector)
    return tuple(directions) if is_list else directions[0]


def _has_numbers(value: Any) -> bool:
    """Whether a value holds the numbers of a direction, rather than being one of them."""
    return isinstance(value, list | tuple) or (isinstance(value, str) and len(value.split()) > 1)


# -- crystals: balls of several kinds, how they are arranged, and their loads ----------------------


#: the keys of a material, of which all but the last are required
MATERIAL_KEYS = ("young_modulus", "poisson_ratio", "density", "yield_strength")


def _law_numbers(name: str) -> dict[str, Kind]:
    """Return the kind of each number of a contact law: a quantity, a list of values of a quantity,
    or a number without a unit, for which the law has a rule.
    """

    def make_kind(number_kind: Any) -> Kind:
        if isinstance(number_kind, Quantity):
            return quantity(number_kind)
        if isinstance(number_kind, tuple):
            (listed,) = number_kind
            return Kind.plain(
                partial(each, rule=listed.read, what="values"),
                lambda values: [listed.write(value) for value in values],
            )
        return Kind.plain(number_kind, float)

    return {key: make_kind(number_kind) for key, number_kind in LAWS[name].numbers.items()}


def _read_balls(value: Any, context: Context) -> tuple[tuple[str, Ball], ...]:
    """Read kinds of balls: a block of names, each with a material, a diameter, and a mass and
    inertia if these differ.
    """
    if not isinstance(value, dict) or not value:
        raise Refused(
            show(value), "a block of kinds of balls by name, each with its material and diameter"
        )
    material = partial(
        block,
        rules={name: PARTS[name].rule(context) for name in MATERIAL_KEYS},
        needed=MATERIAL_KEYS[:3],
    )
    rules: dict[str, Rule] = {
        "material": material,
        "diameter": LENGTH.read,
        "mass": MASS.read,
        "inertia": INERTIA.read,
        "spread": PARTS["spread"].rule(context),
    }
    out = []
    read_kind = partial(block, rules=rules, needed=("material", "diameter"))
    for name, written in value.items():
        kind = label(name)
        if "." in kind or " " in kind or kind == "floor":
            allowed = "a name without a point or a space, and not 'floor'"
            raise Refused(show(name), allowed, path=(name,))
        settings = read_inside(name, read_kind, written)
        material_numbers = settings.pop("material")
        try:
            out.append((kind, Ball(Material(**material_numbers), **settings)))
        except InputError as error:
            # the message begins with the name of the quantity at fault
            key = "diameter"
            for quantity_name in ("mass", "inertia"):
                if quantity_name in written and str(error).startswith(quantity_name):
                    key = quantity_name
            allowed = "a ball that double precision can hold"
            raise Refused(show(written[key]), allowed, str(error), (name, key)) from None
    return tuple(out)


def _write_balls(kinds: Any, context: Context) -> dict[str, Any]:
    out = {}
    for name, ball in kinds:
        material = {key: getattr(ball.material, key) for key in MATERIAL_KEYS}
        out[name] = {
            "material": {
                key: PARTS[key].write(number, context)
                for key, number in material.items()
                if number is not None
            },
            "diameter": LENGTH.write(ball.diameter),
            "mass": MASS.write(ball.mass),
            "inertia": INERTIA.write(ball.inertia),
        }
        if ball.spread:
            out[name]["spread"] = PARTS["spread"].write(ball.spread, context)
    return out


BALLS = Kind(_read_balls, _write_balls)


def _read_structure(value: Any) -> Any:
    structure = name_structure(value)
    if structure is not None:
        return structure
    try:
        return read_lattice(value)
    except Refused as refused:
        allowed = f"{', '.join((*LATTICES, *STRUCTURES))}, or a block of name, cell and sites"
        raise Refused(refused.found, allowed, refused.mend, refused.path) from None


def _read_vectors(value: Any) -> tuple[tuple[float, ...], ...]:
    def length(component: Any) -> float:
        return 0.0 if is_whole(component) and component == 0 else WAY.read(component)

    if value == []:
        return ()
    return each(value, partial(each, rule=length, what="lengths"), "vectors")


def _read_site(value: Any) -> tuple[tuple[float, ...], str]:
    rules: dict[str, Rule] = {"kind": label, "at": lambda vector: _read_vectors([vector])[0]}
    site = block(value, rules, ("kind", "at"))
    return site["at"], site["kind"]


def _read_counts(value: Any, meaning: str, high: int, low: int = 1) -> tuple[int, ...]:
    counts = value if isinstance(value, list | tuple) else [value]
    if isinstance(value, str):
        counts = [int(word) if word.isdecimal() else word for word in value.split()]
    return each(counts, partial(whole, low=low, high=high), meaning)


def _read_removed(value: Any) -> tuple[int, ...]:
    balls = _read_counts(value, "numbers of balls", 10_000_000, 0)
    if len(set(balls)) < len(balls):
        repeated = Counter(balls).most_common(1)[0][0]
        raise Refused(f"ball {repeated} more than once", "the number of each ball once")
    return balls


def _read_cut(value: Any) -> tuple[Any, int, tuple[str, str]]:
    rules: dict[str, Rule] = {
        "axis": read_axis,
        "layers": partial(whole, low=1, high=1_000_000),
        "edges": read_edges,
    }
    settings = block(value, rules, ("axis", "layers"))
    return settings["axis"], settings["layers"], settings.get("edges", ("free", "free"))


def _write_cuts(cuts: Any) -> Any:
    out = [
        {
            "axis": list(axis) if isinstance(axis, tuple) else axis,
            "layers": layers,
            "edges": " ".join(edges),
        }
        for axis, layers, edges in cuts
    ]
    if not out:
        return None
    return out if len(out) > 1 else out[0]


def _read_replaced(value: Any) -> tuple[tuple[int, str], ...]:
    if not isinstance(value, dict) or not value:
        raise Refused(
            show(value),
            "a block of numbers of balls and the kinds that take their places, as {12: S}",
        )
    numbers = [
        int(index) if isinstance(index, str) and index.isdecimal() else index for index in value
    ]
    kinds = [read_inside(index, label, kind) for index, kind in value.items()]
    return tuple(zip([whole(number, 0) for number in numbers], kinds, strict=True))


def _read_law(value: Any) -> Any:
    """Read a law, or a block of pairs of kinds with a law for each; returns the law, or items of
    pairs.
    """
    name = value
    numbers: Any = {}
    if isinstance(value, dict) and len(value) == 1:
        ((name, numbers),) = value.items()
    if isinstance(name, str) and name in LAWS:
        return _read_single_law(name, numbers)
    has_pairs = isinstance(value, dict) and all(
        isinstance(pair, str) and len(pair.split()) == 2 for pair in value
    )
    if not has_pairs:
        allowed = (
            f"{', '.join(LAWS)}, with its numbers, or a block of pairs of kinds, as {{A B: hertz}}"
        )
        raise Refused(show(value), allowed, LAWS.failures)
    return tuple(
        (tuple(pair.split()), read_inside(pair, _read_law, law)) for pair, law in value.items()
    )


def _read_single_law(name: str, numbers: Any) -> Any:
    """Return the law of a name, made of the block of its ``numbers``, which may be empty."""
    rules = {key: kind.rule(Context()) for key, kind in _law_numbers(name).items()}
    read_numbers = partial(block, rules=rules, needed=tuple(rules))
    arguments = read_inside(name, read_numbers, numbers or {})
    with refusing(numbers or name, f"numbers of the law {name}", name):
        law = LAWS[name].law
        return law(**arguments) if isinstance(law, type) else law


def _write_law(law: Any) -> Any:
    if isinstance(law, tuple):
        return {" ".join(pair): _write_law(law_of_pair) for pair, law_of_pair in law}
    for name, entry in LAWS.items():
        if law is entry.law:
            return name
        if type(law) is entry.law:
            plural = "s" if entry.law is TabulatedLaw else ""
            attributes = {key: key + plural for key in entry.numbers}
            numbers = {
                key: kind.write(getattr(law, attributes[key]), Context())
                for key, kind in _law_numbers(name).items()
            }
            return {name: numbers} if numbers else name
    mend = f"Use {', '.join(LAWS)}, granphon.register_law for your own, or granphon.sweep"
    raise InputError(f"the law {law!r}", "A scene file has no words for it", mend)


def _write_structure(structure: Any) -> Any:
    if structure is None or isinstance(structure, str):
        return structure
    return write_lattice(structure)


def _write_sites(sites: Any) -> Any:
    out = [{"kind": kind, "at": [WAY.write(x) for x in position]} for position, kind in sites]
    return out or None


STRUCTURE = Kind.plain(_read_structure, _write_structure)
ORDER = Kind.plain(
    partial(each, rule=label, what="names of kinds"), lambda names: list(names) or None
)
CELL = Kind.plain(_read_vectors, lambda rows: [[WAY.write(x) for x in row] for row in rows] or None)
SITES = Kind.plain(partial(each, rule=_read_site, what="sites"), _write_sites)
REPEAT = Kind.plain(
    lambda value: _read_counts(value, "numbers of cells", 1_000_000),
    lambda counts: list(counts) or None,
)
CUT = Kind.plain(
    lambda value: (
        each(value, _read_cut, "cuts") if isinstance(value, list) else (_read_cut(value),)
    ),
    _write_cuts,
)
REPLACE = Kind.plain(_read_replaced, lambda pairs: dict(pairs) or None)
REMOVE = Kind.plain(_read_removed, lambda balls: list(balls) or None)
SEED = Kind.plain(partial(whole, low=0))
LAW = Kind.plain(_read_law, _write_law)
_ALL_MOTIONS = tuple(
    dict.fromkeys(motions for dimension in (1, 2, 3) for motions in allowed_motions(dimension))
)
MOTIONS = Kind.plain(partial(choice, options=_ALL_MOTIONS))


#: axes of the components of a symmetric tensor of 2 and 3 periods in Voigt order
_VOIGT_PAIRS = {
    2: ((0, 0), (1, 1), (0, 1)),
    3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)),
}


def tensor_kind(name: str) -> Kind:
    """Return the kind of a stress or strain: a list in Voigt order, or a symmetric matrix, along
    the periods.
    """

    def read_component(value: Any, unit: Quantity) -> float:
        if name == "strain":
            return number(value, -1e300, 1e300)
        return 0.0 if is_whole(value) and value == 0 else unit.read(value)

    def read_matrix(rows_of_file: Sequence[Any], component: Rule) -> tuple[float, ...]:
        """Read rows (p, p) of a symmetric matrix; return its components in Voigt order."""
        p = len(rows_of_file)
        read_row = partial(each, rule=component, what="numbers")
        rows = np.array(each(list(rows_of_file), read_row, "rows"))
        if not np.array_equal(rows, rows.T):
            raise Refused(show(rows_of_file), "a symmetric matrix")
        # in Voigt order a shear strain is that of the angle, xy + yx
        shear = 2.0 if name == "strain" else 1.0
        return tuple(float(rows[a, b]) * (shear if a != b else 1.0) for a, b in _VOIGT_PAIRS[p])

    def read(value: Any, context: Context) -> tuple[float, ...]:
        p = context.lattice.periods
        component = partial(read_component, unit=tensor_quantities(p)[name])
        size = {1: 1, 2: 3, 3: 6}.get(p, 0)
        listed = list(value) if isinstance(value, list | tuple) else [value]
        has_rows = all(isinstance(row, list | tuple) and len(row) == p for row in listed)
        if p > 1 and len(listed) == p and has_rows:
            tensor = read_matrix(value, component)
        elif len(listed) == size:
            tensor = tuple(each(listed, component, "numbers"))
        else:
            tensor = ()
        if any(tensor):
            return tensor
        unit = "numbers" if name == "strain" else "quantities"
        allowed = (
            f"{size} {unit} in Voigt order, or {p} rows of {p}; tension and extension are positive"
        )
        raise Refused(f"{show(value)}, which is zero" if tensor else show(value), allowed)

    def write(load: Any, context: Context) -> Any:
        if load.kind != name:
            return None
        tensor = _join_tensor(load) or load.tensor
        if name == "strain":
            return [*tensor]
        quantity = tensor_quantities(context.lattice.periods)[name]
        return [quantity.write(component) for component in tensor]

    return Kind(read, write)


def _join_tensor(load: Any) -> tuple[float, ...] | None:
    """Return the tensor of a single load; None for several, and where the tensor would not be split
    again to the last bit.
    """
    tensor = tuple(component * load.values[0] for component in load.tensor)
    most = max(map(abs, tensor))
    is_split_again = tuple(component / most for component in tensor) == load.tensor
    return tensor if load.size == 1 and is_split_again else None


def _write_times(load: Any) -> Any:
    if load.tensor is None or _join_tensor(load):
        return None
    return write_values(load.values, float)


TIMES = Kind.plain(lambda value: read_values(value, above_zero), _write_times)


def split_tensor(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a :class:`~granphon.Load` from the values of a block with a stress or
    strain.
    """
    name = "stress" if "stress" in values else "strain"
    size = max(map(abs, values[name]))
    return {
        "kind": name,
        "array": tuple(size * factor for factor in values.get("times", (1.0,))),
        "tensor": tuple(component / size for component in values[name]),
    }
