"""How values of a scene file are read and written, one :class:`Kind` for each sort of value.

A reader takes what stands in the file and the :class:`Context` of the scene, and raises
:class:`~granphon.base.errors.Refused` for what it does not take, see
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
#: what a scene may compute, in the order in which a scene keeps it
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

#: where the balls of a lattice of one, two or three dimensions lie
_PLACES = ("on a line", "in a plane", "in space")


@dataclass(frozen=True)
class Context:
    """What the values of a scene depend on.

    Attributes
    ----------
    lattice : of the packing; it says what motions, pressures, samples, directions, paths and meshes
        there are.
    swept : the lattices of a sweep; motions must be those of each.
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

    def rule(self, at: Context) -> Rule:
        """Return the rule that reads such a value of a scene."""
        return lambda value: self.read(value, at)


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
    given = block(value, rules, ("from", "to", "points"))
    first = given["from"]
    last = given["to"]
    count = given["points"]
    scale = given.get("scale", SCALES[0])
    if (first == last) != (count == 1):
        found = f"{count} for the range from {value['from']} to {value['to']}"
        raise Refused(
            found, "1 if both ends are the same, 2 or more if they are not", path=("points",)
        )
    if scale == "log" and min(first, last) <= 0.0:
        raise Refused(
            f"a log range from {value['from']} to {value['to']}",
            "values above zero",
            "Write scale: linear.",
        )
    return space_evenly(first, last, count, scale)


def space_evenly(first: float, last: float, count: int, scale: str) -> tuple[float, ...]:
    """Return ``count`` numbers, evenly spaced on a log or a linear scale, from exactly ``first`` to
    exactly ``last``.
    """
    between = np.geomspace if scale == "log" else np.linspace
    with np.errstate(all="ignore"):
        # the ends may be the smallest and the largest numbers of double precision
        return tuple(between(first, last, count).tolist())


def write_values(given: Sequence[float], write: Callable[[float], Any]) -> Any:
    """Write values as one number, as a range if that gives the same values, or else as a list."""
    first = given[0]
    last = given[-1]
    count = len(given)
    if count == 1:
        return write(first)
    for scale in SCALES if count > 2 and first != last else ():
        positive = scale == "linear" or min(first, last) > 0.0
        if positive and space_evenly(first, last, count, scale) == tuple(given):
            return {"from": write(first), "to": write(last), "points": count, "scale": scale}
    return [write(value) for value in given]


DRIVE = Kind(
    lambda value, at: read_drives(value, folder=at.folder), lambda drives, _: write_drives(drives)
)
FREQUENCIES = Kind.plain(
    lambda value: tuple(frequencies(read_values(value, FREQUENCY.read)).tolist()),
    lambda found: write_values(found, FREQUENCY.write),
)


# -- spreads ---------------------------------------------------------------------------------------


def _read_spread(value: Any, at: Context) -> Any:
    diameters = partial(each, rule=LENGTH.read, what="diameters")
    fractions = partial(each, rule=partial(number, low=0.0, high=1.0), what="fractions")

    def normal(value: Any) -> Normal:
        """Read a standard deviation, or a block {std, cutoff}."""
        rules: dict[str, Rule] = {"std": WIDTH.read, "cutoff": partial(number, low=1e-3, high=10.0)}
        return (
            Normal(**block(value, rules, ("std",)))
            if isinstance(value, dict)
            else Normal(WIDTH.read(value))
        )

    def discrete(value: Any) -> Discrete:
        """Read a block {diameters, fractions} of two lists of the same length."""
        given = block(
            value, {"diameters": diameters, "fractions": fractions}, ("diameters", "fractions")
        )
        with refusing(
            given["fractions"], "one fraction for each diameter, with the sum 1", "fractions"
        ):
            return Discrete(**given)

    def measured(value: Any) -> Measured:
        """Read the name of a table, a block {file, column}, or a block {diameters}."""
        if isinstance(value, dict) and "diameters" in value:
            return Measured(block(value, {"diameters": diameters})["diameters"])
        given = (
            block(value, {"file": text, "column": text}, ("file",))
            if isinstance(value, dict)
            else {"file": text(value)}
        )
        with refusing(given["file"], "a table with a column of diameters"):
            return Measured.from_csv(at.folder / given["file"], given.get("column"), quoted=False)

    rules: dict[str, Rule] = {
        "uniform": lambda value: Uniform(WIDTH.read(value)),
        "normal": normal,
        "discrete": discrete,
        "measured": measured,
    }
    allowed = f"exactly one of {', '.join(rules)}"
    if not isinstance(value, dict):
        mend = (
            f"Did you mean {{uniform: {value}}}?"
            if isinstance(value, str)
            else "Leave spread out for equal balls."
        )
        raise Refused(show(value), allowed, mend)
    if len(value) != 1:
        raise Refused(" and ".join(map(str, value)) or "no spread", allowed)
    (found,) = block(value, rules).values()
    return found


def _write_spread(given: Any, at: Context) -> dict[str, Any]:
    if isinstance(given, Uniform):
        return {"uniform": WIDTH.write(given.width)}
    if isinstance(given, Normal):
        return {"normal": {"std": WIDTH.write(given.std), "cutoff": given.cutoff}}
    diameters = {"diameters": [LENGTH.write(diameter) for diameter in given.diameters]}
    if isinstance(given, Discrete):
        return {"discrete": diameters | {"fractions": given.fractions}}
    return {"measured": diameters}


def table_named(value: Any) -> str | None:
    """Name of the table that a spread of a valid scene file takes its diameters from; None if it
    names no table.
    """
    measured = value.get("measured") if isinstance(value, dict) else None
    return measured.get("file") if isinstance(measured, dict) else measured


def is_long(given: Any) -> bool:
    """Whether a spread has more measured diameters than a scene file lists itself."""
    return isinstance(given, Measured) and len(given.diameters) > MOST_DIAMETERS


# -- what the packing is made of, which a sweep may vary -------------------------------------------


def read_lattice(value: Any) -> str | Lattice:
    """Read the name of a built-in lattice, or the block of another; "hexagonal" is refused, as
    several are called so.
    """
    if isinstance(value, dict):  # one ball at the origin if the sites are left out
        rows = partial(
            each,
            rule=partial(each, rule=partial(fraction, largest=1e3), what="numbers"),
            what="lists of numbers",
        )
        given = block(value, {"name": label, "cell": rows, "sites": rows}, ("name", "cell"))
        with refusing(given["name"], "a lattice of balls that touch and do not overlap"):
            return Lattice(**given)
    own = "a block of name, cell (vectors, in spacings of touching balls) and sites (fractions)"
    allowed = f"{', '.join(LATTICES)}, or {own}"
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
    found: tuple[str | Lattice, ...] = each(value, read_lattice, "values")
    with refusing(value, "lattices of one dimension, each once"):
        Axis.of("lattice", found)
    return found


def choose_lattice(own: Lattice, swept: Sequence[str | Lattice]) -> Lattice:
    """Return the lattice to which the keys of a scene refer: its packing's, or the first of a sweep
    in another dimension.
    """
    first = find_lattice(swept[0]) if swept else own
    return own if (first.periods, first.dimension) == (own.periods, own.dimension) else first


def _read_motions(value: Any, at: Context) -> str:
    for lattice in at.swept or (at.lattice,):
        options = tuple(allowed_motions(lattice.dimension))
        if not is_one_of(value, options):
            allowed = (
                f"{', '.join(options)}; the {lattice.name} lattice lies"
                f" {_PLACES[lattice.dimension - 1]}"
            )
            meant = closest(value.replace(" ", "_"), options) if isinstance(value, str) else None
            raise Refused(show(value), allowed, f"Did you mean {meant!r}?" if meant else "")
    return str(value)


def _read_torsion(value: Any) -> float | str:
    """Read a torsional stiffness over k d^2, zero or above, or the word for that of a contact that
    does not slip.
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
#: the spread of a packing: if its diameters are too many, the scene names a table of them
OWN_SPREAD = Kind(
    _read_spread,
    lambda given, at: {"measured": DIAMETERS_FILE} if is_long(given) else _write_spread(given, at),
)


def _read_parameters(value: Any, at: Context) -> tuple[tuple[str, tuple[Any, ...]], ...]:
    if at.kinds:
        names = [f"{kind}.{name}" for kind in at.kinds for name in KIND_PARAMETERS]
        return tuple(
            block(value, {name: partial(_read_axis, name=name, at=at) for name in names}).items()
        )
    if isinstance(value, Mapping) and "lattice" in value:
        at = replace(at, swept=tuple(map(find_lattice, read_lattices(value["lattice"]))))
    return tuple(
        block(value, {name: partial(_read_axis, name=name, at=at) for name in PARAMETERS}).items()
    )


def _read_axis(value: Any, name: str, at: Context) -> tuple[Any, ...]:
    rule = PARTS[name.rpartition(".")[2]].rule(at)
    found: tuple[Any, ...] = (
        read_values(value, rule)
        if find_unit(name)
        else read_lattices(value)
        if name == "lattice"
        else each(value, rule, "values")
    )
    if (double := find_double(found)) is not None:
        told = show(value[double]) if isinstance(value, list | tuple) else "a value"
        raise Refused(
            f"{told} twice",
            "each value once",
            path=(double,) if isinstance(value, list | tuple) else (),
        )
    return found


def _write_parameters(
    given: Sequence[tuple[str, tuple[Any, ...]]], at: Context
) -> dict[str, Any] | None:
    def write(name: str, values: tuple[Any, ...]) -> Any:
        if find_unit(name) and not any(isinstance(value, str) for value in values):
            return write_values(
                values, lambda value: PARTS[name.rpartition(".")[2]].write(value, at)
            )
        return [PARTS[name].write(value, at) for value in values]

    return {name: write(name, values) for name, values in given} or None


PARAMETERS_SWEPT = Kind(_read_parameters, _write_parameters)


# -- loads, media, and what is observed ------------------------------------------------------------


def load_kind(name: str) -> Kind:
    """Return the kind of the values of a load: the lattice says what a pressure is."""

    def read_one(value: Any, at: Context) -> float:
        own = load_quantities(at.lattice.pressed_axes)[name]
        try:
            return own.read(value)
        except Refused as refused:
            for others in map(load_quantities, (1, 2, 3)):
                with suppress(Refused):
                    others[name].read(value)
                    break
            else:
                raise
            mend = (
                f"The pressure of the {at.lattice.name} lattice is in {own.unit}. {refused.mend}"
            ).rstrip()
            raise Refused(refused.found, refused.allowed, mend) from None

    return Kind(
        lambda value, at: read_values(value, lambda one: read_one(one, at)),
        lambda load, at: (
            # gravity alone is a pressure of zero
            write_values(load.values, load_quantities(at.lattice.pressed_axes)[name].write)
            if load.kind == name and any(load.values)
            else None
        ),
    )


def _read_media(value: Any, at: Context) -> tuple[MediumChoice, ...]:
    rule = partial(read_medium, lattice=at.lattice, written=at.written)
    if not isinstance(value, list | tuple):
        return (rule(value),)
    found: tuple[MediumChoice, ...] = each(value, rule, "media")
    labels = [one.label for one in found]
    if double := [label for label in labels if labels.count(label) > 1]:
        raise Refused(f"{double[0]!r} twice", f"{', '.join(MEDIA)}, each once")
    return found


def _write_media(given: Sequence[MediumChoice], at: Context) -> Any:
    settings = [(one.name, one.settings_on(at.lattice)) for one in given]
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
    """Read the names of what a scene observes, each once; they are returned in the order of
    ``OBSERVABLES``.

    Registered observables come behind these, and bring the velocities with them if they are found
    from these.
    """
    added = {name: one.cost for name, one in CATALOGUE.items() if CATALOGUE.is_added(name)}
    every = (*OBSERVABLES, *added)
    allowed = "a list of one or more of " + ", ".join(every)
    if not isinstance(value, list | tuple) or not value:
        mend = f"Did you mean [{value}]?" if isinstance(value, str) and value in every else ""
        raise Refused(show(value) if value != [] else "an empty list", allowed, mend)
    for name in value:
        try:
            choice(name, every)
        except Refused as refused:
            raise Refused(
                refused.found, refused.allowed, refused.mend or CATALOGUE.failures
            ) from None
    names = list(value)
    if double := [name for name in names if names.count(name) > 1]:
        raise Refused(f"{double[0]!r} twice", allowed + ", each once")
    if any(added.get(name, "state") != "state" for name in names):
        names.append(OBSERVABLES[0])
    return tuple(name for name in every if name in names)


def grid_kind(examples: Sequence[str], low: int, high: int, low_in_space: int) -> Kind:
    """Return the kind of whole numbers for each period, written as three words as phonopy writes
    them: 1 beyond those.
    """

    def read(value: Any, at: Context) -> tuple[int, ...]:
        p = at.lattice.periods
        given = [value] if p == 1 and is_whole(value) else value
        return grid(given, low_in_space if p == 3 else low, high, examples[p - 1], p)

    return Kind(read, lambda numbers, _: write_grid(numbers))


def write_grid(numbers: Sequence[int]) -> str:
    """Return whole numbers for each period as three words."""
    return " ".join(map(str, (*numbers, 1, 1)[:3]))


def read_directions(value: Any, lattice: Lattice) -> tuple[Any, ...]:
    """Read the direction of sound on a lattice, Cartesian: one as its numbers, many as a tuple of
    these.
    """
    p = lattice.periods
    example = ("[1]", "[1, 1]", "[1, 1, 0]")[p - 1]
    allowed = (
        f"{('one number', 'two numbers', 'three numbers')[p - 1]}, not all zero, such as"
        f" {example}; or a list of these"
    )
    plain = value.tolist() if isinstance(value, np.ndarray) else value
    many = isinstance(plain, list | tuple) and any(
        isinstance(one, list | tuple) or (isinstance(one, str) and len(one.split()) > 1)
        for one in plain
    )
    found: list[tuple[float, ...]] = []
    seen = []
    for place, one in enumerate(plain if many else [plain]):
        path = (place,) if many else ()
        words = (
            one.split() if isinstance(one, str) else one if isinstance(one, list | tuple) else [one]
        )
        try:
            found.append(tuple(fraction(word, 1e3) for word in words))
            seen.append(as_direction(found[-1], p).tolist())
        except InputError:
            raise Refused(
                show(one), allowed, f"The {lattice.name} lattice lies {_PLACES[p - 1]}.", path
            ) from None
        if seen[-1] in seen[:-1]:
            raise Refused(f"{show(one)} twice", "each direction once", path=path)
    return tuple(found) if many else found[0]


# -- crystals: balls of several kinds, how they are arranged, and their loads ----------------------


_MATERIAL = ("young_modulus", "poisson_ratio", "density", "yield_strength")


def _law_numbers(name: str) -> dict[str, Kind]:
    def kind(given: Any) -> Kind:
        if isinstance(given, Quantity):
            return quantity(given)
        if isinstance(given, tuple):
            (one,) = given
            return Kind.plain(
                partial(each, rule=one.read, what="values"),
                lambda values: [one.write(value) for value in values],
            )
        return Kind.plain(given, float)

    return {key: kind(given) for key, given in LAWS[name].numbers.items()}


def _read_balls(value: Any, at: Context) -> tuple[tuple[str, Ball], ...]:
    """Read kinds of balls: a block of names, each with a material, a diameter, and a mass and
    inertia if these differ.
    """
    if not isinstance(value, dict) or not value:
        raise Refused(
            show(value), "a block of kinds of balls by name, each with its material and diameter"
        )
    material = partial(
        block, rules={name: PARTS[name].rule(at) for name in _MATERIAL}, needed=_MATERIAL[:3]
    )
    rules: dict[str, Rule] = {
        "material": material,
        "diameter": LENGTH.read,
        "mass": MASS.read,
        "inertia": INERTIA.read,
        "spread": PARTS["spread"].rule(at),
    }
    out = []
    for name, given in value.items():
        kind = label(name)
        if "." in kind or " " in kind or kind == "floor":
            raise Refused(
                show(name), "a name without a point or a space, and not 'floor'", path=(name,)
            )
        found = read_inside(
            name, partial(block, rules=rules, needed=("material", "diameter")), given
        )
        try:
            out.append((kind, Ball(Material(**found.pop("material")), **found)))
        except InputError as error:
            key = next(
                (key for key in ("mass", "inertia") if key in given and str(error).startswith(key)),
                "diameter",
            )
            raise Refused(
                show(given[key]), "a ball that double precision can hold", str(error), (name, key)
            ) from None
    return tuple(out)


def _write_balls(kinds: Any, at: Context) -> dict[str, Any]:
    out = {}
    for name, ball in kinds:
        material = {
            key: PARTS[key].write(one, at)
            for key in _MATERIAL
            if (one := getattr(ball.material, key)) is not None
        }
        out[name] = {
            "material": material,
            "diameter": LENGTH.write(ball.diameter),
            "mass": MASS.write(ball.mass),
            "inertia": INERTIA.write(ball.inertia),
        } | ({"spread": PARTS["spread"].write(ball.spread, at)} if ball.spread else {})
    return out


BALLS = Kind(_read_balls, _write_balls)


def _read_structure(value: Any) -> Any:
    if (known := name_structure(value)) is not None:
        return known
    try:
        return read_lattice(value)
    except Refused as refused:
        allowed = f"{', '.join((*LATTICES, *STRUCTURES))}, or a block of name, cell and sites"
        raise Refused(refused.found, allowed, refused.mend, refused.path) from None


def _read_vectors(value: Any) -> tuple[tuple[float, ...], ...]:
    def length(one: Any) -> float:
        return 0.0 if is_whole(one) and one == 0 else WAY.read(one)

    if value == []:
        return ()
    return each(value, partial(each, rule=length, what="lengths"), "vectors")


def _read_site(value: Any) -> tuple[tuple[float, ...], str]:
    given = block(value, {"kind": label, "at": lambda one: _read_vectors([one])[0]}, ("kind", "at"))
    return given["at"], given["kind"]


def _read_counts(value: Any, what: str, high: int, low: int = 1) -> tuple[int, ...]:
    words = (
        [int(one) if one.isdecimal() else one for one in value.split()]
        if isinstance(value, str)
        else value
    )
    return each(
        words if isinstance(words, list | tuple) else [words],
        partial(whole, low=low, high=high),
        what,
    )


def _read_removed(value: Any) -> tuple[int, ...]:
    found = _read_counts(value, "numbers of balls", 10_000_000, 0)
    if len(set(found)) < len(found):
        raise Refused(
            f"ball {Counter(found).most_common(1)[0][0]} more than once",
            "the number of each ball once",
        )
    return found


def _read_cut(value: Any) -> tuple[Any, int, tuple[str, str]]:
    rules: dict[str, Rule] = {
        "axis": read_axis,
        "layers": partial(whole, low=1, high=1_000_000),
        "edges": read_edges,
    }
    given = block(value, rules, ("axis", "layers"))
    return given["axis"], given["layers"], given.get("edges", ("free", "free"))


def _write_cuts(cuts: Any) -> Any:
    out = [
        {"axis": list(a) if isinstance(a, tuple) else a, "layers": n, "edges": " ".join(edges)}
        for a, n, edges in cuts
    ]
    return (out if len(out) > 1 else out[0]) if out else None


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
    name, given = (
        next(iter(value.items())) if isinstance(value, dict) and len(value) == 1 else (value, {})
    )
    if isinstance(name, str) and name in LAWS:
        rules = {key: one.rule(Context()) for key, one in _law_numbers(name).items()}
        found = read_inside(name, partial(block, rules=rules, needed=tuple(rules)), given or {})
        with refusing(given or name, f"numbers of the law {name}", name):
            made = LAWS[name].law
            return made(**found) if isinstance(made, type) else made
    if not isinstance(value, dict) or not all(
        isinstance(pair, str) and len(pair.split()) == 2 for pair in value
    ):
        allowed = (
            f"{', '.join(LAWS)}, with its numbers, or a block of pairs of kinds, as {{A B: hertz}}"
        )
        raise Refused(show(value), allowed, LAWS.failures)
    return tuple(
        (tuple(pair.split()), read_inside(pair, _read_law, one)) for pair, one in value.items()
    )


def _write_law(law: Any) -> Any:
    if isinstance(law, tuple):
        return {" ".join(pair): _write_law(one) for pair, one in law}
    for name, known in LAWS.items():
        if law is known.law:
            return name
        if type(law) is known.law:
            fields = {key: f"{key}s" if known.law is TabulatedLaw else key for key in known.numbers}
            kinds = _law_numbers(name)
            numbers = {
                key: kinds[key].write(getattr(law, field), Context())
                for key, field in fields.items()
            }
            return {name: numbers} if numbers else name
    what = f"the law {law!r}"
    mend = f"Use {', '.join(LAWS)}, granphon.register_law for your own, or granphon.sweep"
    raise InputError(what, "A scene file has no words for it", mend)


STRUCTURE = Kind.plain(
    _read_structure,
    lambda one: None if one is None else one if isinstance(one, str) else write_lattice(one),
)
ORDER = Kind.plain(partial(each, rule=label, what="names of kinds"), lambda one: list(one) or None)
CELL = Kind.plain(_read_vectors, lambda rows: [[WAY.write(x) for x in row] for row in rows] or None)
SITES = Kind.plain(
    partial(each, rule=_read_site, what="sites"),
    lambda sites: (
        [{"kind": kind, "at": [WAY.write(x) for x in place]} for place, kind in sites] or None
    ),
)
REPEAT = Kind.plain(
    lambda value: _read_counts(value, "numbers of cells", 1_000_000), lambda one: list(one) or None
)
CUT = Kind.plain(
    lambda one: each(one, _read_cut, "cuts") if isinstance(one, list) else (_read_cut(one),),
    _write_cuts,
)
REPLACE = Kind.plain(_read_replaced, lambda pairs: dict(pairs) or None)
REMOVE = Kind.plain(_read_removed, lambda one: list(one) or None)
SEED = Kind.plain(partial(whole, low=0))
LAW = Kind.plain(_read_law, _write_law)
MOTIONS = Kind.plain(
    partial(
        choice, options=tuple(dict.fromkeys(one for d in (1, 2, 3) for one in allowed_motions(d)))
    )
)


def tensor_kind(name: str) -> Kind:
    """Return the kind of a stress or strain: a list in Voigt order, or a symmetric matrix, along
    the periods.
    """

    def read(value: Any, at: Context) -> tuple[float, ...]:
        quantity = tensor_quantities(at.lattice.periods)[name]
        p = at.lattice.periods
        size = {1: 1, 2: 3, 3: 6}.get(p, 0)
        unit = "numbers" if name == "strain" else "quantities"
        allowed = (
            f"{size} {unit} in Voigt order, or {p} rows of {p}; tension and extension are positive"
        )

        def one(value: Any) -> float:
            if name == "strain":
                return number(value, -1e300, 1e300)
            return 0.0 if is_whole(value) and value == 0 else quantity.read(value)

        listed = value if isinstance(value, list | tuple) else [value]
        if (
            len(listed) == p
            and p > 1
            and all(isinstance(row, list | tuple) and len(row) == p for row in listed)
        ):
            rows = np.array(each(list(listed), partial(each, rule=one, what="numbers"), "rows"))
            if not np.array_equal(rows, rows.T):
                raise Refused(show(value), "a symmetric matrix")
            pairs = (
                ((0, 0), (1, 1), (0, 1))
                if p == 2
                else ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
            )
            shear = 2.0 if name == "strain" else 1.0
            found = tuple(float(rows[a, b]) * (shear if a != b else 1.0) for a, b in pairs)
        elif len(listed) == size:
            found = tuple(each(list(listed), one, "numbers"))
        else:
            raise Refused(show(value), allowed)
        if not any(found):
            raise Refused(f"{show(value)}, which is zero", allowed)
        return found

    def write(load: Any, at: Context) -> Any:
        if load.kind != name:
            return None
        plain = _join_tensor(load) or load.tensor
        return (
            [*plain]
            if name == "strain"
            else [tensor_quantities(at.lattice.periods)[name].write(one) for one in plain]
        )

    return Kind(read, write)


def _join_tensor(load: Any) -> tuple[float, ...] | None:
    """Return the tensor of a single load; None for several, and where it would not be split again
    to the last bit.
    """
    plain = tuple(one * load.values[0] for one in load.tensor)
    most = max(map(abs, plain))
    return plain if load.size == 1 and tuple(one / most for one in plain) == load.tensor else None


TIMES = Kind.plain(
    lambda value: read_values(value, above_zero),
    lambda load: (
        None if load.tensor is None or _join_tensor(load) else write_values(load.values, float)
    ),
)


def split_tensor(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a :class:`~granphon.Load` from the keys of a block with a stress or
    strain.
    """
    name = next(one for one in ("stress", "strain") if one in found)
    size = max(map(abs, found[name]))
    return {
        "kind": name,
        "array": tuple(size * one for one in found.get("times", (1.0,))),
        "tensor": tuple(one / size for one in found[name]),
    }
