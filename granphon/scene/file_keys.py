"""The keys of a scene file: how the values of each are read and written, one
:class:`~granphon.base.settings.Kind` for each sort of value.

A reader takes a value of the file and the :class:`Context` of the scene.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from granphon.balls.ball import Ball
from granphon.balls.contact_laws import LAWS, TabulatedLaw
from granphon.balls.diameters import CUTOFFS, Discrete, Measured, Normal, Uniform
from granphon.balls.lattices import (
    LATTICES,
    STRUCTURES,
    TRIANGULAR,
    Lattice,
    as_direction,
    find_lattice,
    name_structure,
)
from granphon.balls.loads import balls_on_side
from granphon.balls.material import Material
from granphon.balls.motions import allowed_motions
from granphon.balls.on_site import (
    DISPLACEMENTS,
    ON_SITE,
    ROTATION,
    ROTATIONS,
    SPRING_PARAMETERS,
    find_quantity,
)
from granphon.balls.packing import (
    LOSS_PARAMETERS,
    MINDLIN,
    PARAMETERS,
    Axis,
    find_double,
    find_unit,
)
from granphon.base.arrays import Array
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import (
    ACCELERATION,
    INERTIA,
    LENGTH,
    LOADS,
    MASS,
    TENSORS,
    WAY,
    WIDTH,
    Quantity,
    load_quantities,
    tensor_quantities,
)
from granphon.base.registry import Registry, list_added
from granphon.base.settings import (
    NEEDED,
    Kind,
    Setting,
    ValueContext,
    block_of,
    list_settings,
    listed,
    read_counts,
    read_values,
    whole_from,
    with_unit,
    with_unit_unless_zero,
    word_of,
    write_values,
)
from granphon.base.text import closest, counted, show
from granphon.base.validation import (
    Rule,
    above_zero,
    block,
    choice,
    each,
    fraction,
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
from granphon.dynamics.elasticity import voigt_pairs
from granphon.media.choice import MEDIA, MediumChoice, read_medium
from granphon.observables.catalogue import CATALOGUE
from granphon.phonons.paths import MESHES, BandPath, read_labels
from granphon.scene.outputs import DIAMETERS_FILE
from granphon.waves.settings import CUT, LOSS_KINDS, NETWORK_BLOCKS, REPEAT, is_of_wall

#: version number of the layout of a scene file, its key "schema"
SCENE_SCHEMA = 1
#: the observables of a scene, in the order in which a scene keeps them
OBSERVABLES = (
    "velocities",
    "bands",
    "gaps",
    "cutoffs",
    "onsets",
    "sensitivities",
    "dos",
    "surface",
    "spectrum",
    "pulse",
    *NETWORK_BLOCKS,
    "design",
)
#: the observables of which sensitivities are found beside those of velocities and moduli
DIFFERENTIATED_OBSERVABLES = frozenset({"cutoffs", "surface"})

#: greatest number of measured diameters that a scene file lists itself; more are written to a table
#: beside it
MOST_DIAMETERS = 1000

#: largest component of a direction, of a vector of a cell and of a site, in the units of each: a
#: larger one is a mistake
_LARGEST_COMPONENT = 1e3
#: words for the components of a direction, an example and the axes of a lattice, by the number of
#: its periods
_DIRECTION_WORDS = {
    1: ("one number", "[1]", "one axis"),
    2: ("two numbers", "[1, 1]", "two axes"),
    3: ("three numbers", "[1, 1, 0]", "three axes"),
}
#: two directions whose unit vectors differ by less than this in each component are the same
_DIRECTION_ROUNDING = 1e-12
#: where the balls of a lattice of one, two or three dimensions lie, in words
_POSITIONS = ("on a line", "in a plane", "in space")


@dataclass(frozen=True)
class Context(ValueContext):
    """The parts of a scene on which its values depend.

    Attributes
    ----------
    lattice : lattice of the packing, on which motions, pressures, samples, directions, paths and
        meshes depend.
    swept : the lattices of a sweep; motions must be allowed on each.
    parameters : names of the parameters of a crystal that a sweep may vary; empty of a packing.
    folder, written : see :class:`~granphon.base.settings.ValueContext`.
    """

    lattice: Lattice = TRIANGULAR
    swept: tuple[Lattice, ...] = ()
    parameters: tuple[str, ...] = ()


@contextmanager
def refusing(value: Any, allowed: str, *path: str) -> Iterator[None]:
    """Turn an InputError of the with-block into the refusal of the ``value`` at ``path``, the keys
    that lead to it; ``allowed`` are words for the values that are allowed there.
    """
    try:
        yield
    except InputError as error:
        raise Refused(show(value), allowed, str(error), path) from None


# -- spreads ---------------------------------------------------------------------------------------


_DIAMETERS = listed(with_unit(LENGTH), "diameters")


def _make_discrete_spread(lists: Mapping[str, Any]) -> Discrete:
    """Return the spread of the ``lists`` "diameters", m, and "fractions", both (n,); Refused for
    fractions that do not add up to 1, that are not one for each diameter, or that are too small.
    """
    allowed = "one fraction for each diameter, with the sum 1"
    with refusing(lists["fractions"], allowed, "fractions"):
        return Discrete(**lists)


def _read_normal_spread(value: Any, context: Context) -> Normal:
    """Return the normal spread that a ``value`` gives: its standard deviation alone, or a block
    {std, cutoff}. Refused for any other value.
    """
    if not isinstance(value, dict):
        return Normal(WIDTH.read(value))
    return Normal(**_NORMAL_SPREAD.read(value, context))


def _read_measured_spread(value: Any, context: Context) -> Measured:
    """Return the spread of measured diameters that a ``value`` gives: the name of a table, a block
    {file, column} about a table, a list, or a block {diameters} with a list. Tables are sought in
    the folder of the scene. Refused for any other value, and for a table without such a column.
    """
    if isinstance(value, list):
        return Measured(_DIAMETERS.read(value, context))
    if isinstance(value, dict) and "diameters" in value:
        return Measured(_MEASURED_SPREAD.read(value, context)["diameters"])
    column = None
    if isinstance(value, dict):
        settings = block(value, {"file": text, "column": text}, ("file",))
        name = settings["file"]
        column = settings.get("column")
    elif isinstance(value, str):
        name = text(value)
    else:
        raise Refused(show(value), "the name of a table, or a list such as [8 mm, 8.01 mm]")
    with refusing(name, "a table with a column of diameters"):
        return Measured.from_csv(context.folder / name, column, quoted=False)


_FRACTIONS = listed(Kind.plain(partial(number, low=0.0, high=1.0)), "fractions")
_NORMAL_SPREAD = block_of(
    {"std": with_unit(WIDTH), "cutoff": Kind.plain(partial(number, **CUTOFFS))}, ("std",)
)
_DISCRETE_SPREAD = block_of(
    {"diameters": _DIAMETERS, "fractions": _FRACTIONS}, ("diameters", "fractions")
)
_MEASURED_SPREAD = block_of({"diameters": _DIAMETERS})
#: the distributions of diameters by the key of their block
_SPREADS = {
    "uniform": Kind(
        lambda value, _: Uniform(WIDTH.read(value)), lambda spread, _: WIDTH.write(spread.width)
    ),
    "normal": _NORMAL_SPREAD._replace(read=_read_normal_spread),
    "discrete": _DISCRETE_SPREAD.made(_make_discrete_spread),
    "measured": _MEASURED_SPREAD._replace(read=_read_measured_spread),
}


def _read_spread(value: Any, context: Context) -> Any:
    """Return the spread of diameters that a ``value`` describes, a block of one key; the key names
    the distribution. Refused for any other value.
    """
    allowed = f"exactly one of {', '.join(_SPREADS)}"
    if not isinstance(value, dict):
        mend = "Leave spread out for equal balls."
        if isinstance(value, str):
            mend = f"Did you mean {{uniform: {value}}}?"
        raise Refused(show(value), allowed, mend)
    if len(value) != 1:
        names = " and ".join(map(str, value))
        raise Refused(names or "no spread", allowed)
    (spread,) = block_of(_SPREADS).read(value, context).values()
    return spread


def _write_spread(spread: Any, context: Context) -> dict[str, Any]:
    """Return a block whose only key is the name of the distribution of a ``spread`` of diameters,
    with the plain data of the spread under that key.
    """
    return {spread.kind: _SPREADS[spread.kind].write(spread, context)}


def find_table_name(value: Any) -> str | None:
    """Return the name of the table from which a spread takes its diameters; None for a spread
    without a table. The ``value`` is plain data of a valid scene file.
    """
    measured = value.get("measured") if isinstance(value, dict) else None
    # {measured: FILE}, {measured: {file: FILE, ...}}, or a list of diameters
    name = measured.get("file") if isinstance(measured, dict) else measured
    return name if isinstance(name, str) else None


def is_long(spread: Any) -> bool:
    """Return whether a ``spread`` has more measured diameters than a scene file lists itself."""
    return isinstance(spread, Measured) and len(spread.diameters) > MOST_DIAMETERS


# -- the parameters of the packing, which a sweep may vary -----------------------------------------


def read_lattice(value: Any) -> str | Lattice:
    """Return the name of a built-in or registered lattice, or the lattice that a block {name, cell,
    sites} describes. Refused for any other value; also for "hexagonal", as several lattices are
    called so.
    """
    if isinstance(value, dict):
        read_row = partial(each, rule=partial(fraction, largest=_LARGEST_COMPONENT), what="numbers")
        read_rows = partial(each, rule=read_row, what="lists of numbers")
        rules: dict[str, Rule] = {"name": label, "cell": read_rows, "sites": read_rows}
        # without sites the lattice has one ball, at the origin
        settings = block(value, rules, ("name", "cell"))
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
    """Return the name of a built-in or registered lattice, or for another lattice the block {name,
    cell, sites} that describes it; InputError for an unknown name.
    """
    structure = find_lattice(lattice)
    if LATTICES.peek(structure.name) == structure:
        return structure.name
    return {
        "name": structure.name,
        "cell": structure.vectors.tolist(),
        "sites": [list(site) for site in structure.sites],
    }


def read_lattices(value: Any) -> tuple[str | Lattice, ...]:
    """Return the lattices that a sweep takes in turn, from a list. Refused for a ``value`` that is
    no list of lattices, for lattices of different dimensions, and for a lattice that is given
    twice.
    """
    lattices: tuple[str | Lattice, ...] = each(value, read_lattice, "values")
    with refusing(value, "lattices of one dimension, each once"):
        Axis.of("lattice", lattices)
    return lattices


def choose_lattice(lattice: Lattice, swept: Sequence[str | Lattice]) -> Lattice:
    """Return the lattice to which the keys of a scene refer: the ``lattice`` of the packing, or the
    first of the ``swept`` lattices if these have another number of periods or dimension.
    """
    if not swept:
        return lattice
    first_swept = find_lattice(swept[0])
    has_same_periods = first_swept.periods == lattice.periods
    has_same_dimension = first_swept.dimension == lattice.dimension
    return lattice if has_same_periods and has_same_dimension else first_swept


def _read_motions(value: Any, context: Context) -> str:
    """Return the name of the motions of balls that a ``value`` is; Refused for any other value, and
    for motions that the lattice of the ``context`` or one of its swept lattices does not allow.
    """
    for lattice in context.swept or (context.lattice,):
        options = tuple(allowed_motions(lattice.dimension))
        if not is_one_of(value, options):
            position = _POSITIONS[lattice.dimension - 1]
            allowed = f"{', '.join(options)}; the {lattice.name} lattice lies {position}"
            closest_option = None
            if isinstance(value, str):
                closest_option = closest(value.replace(" ", "_"), options)
            mend = f"Did you mean {closest_option!r}?" if closest_option else ""
            raise Refused(show(value), allowed, mend)
    return str(value)


def _read_torsion(value: Any) -> float | str:
    """Return a torsional stiffness over k d^2, zero or above, or the word "mindlin", which stands
    for the torsional stiffness of a Hertz contact that does not slip. Refused for any other value.
    """
    if value == MINDLIN:
        return MINDLIN
    try:
        return zero_or_above(value)
    except Refused as refused:
        allowed = f"{refused.allowed}, or {MINDLIN}"
        mend = refused.mend
        if isinstance(value, str) and closest(value, (MINDLIN,)):
            mend = f"Did you mean {MINDLIN!r}?"
        raise Refused(refused.found, allowed, mend) from None


#: the keys of a material; the first three, its elastic constants and its density, are required
MATERIAL_KEYS = tuple(list_settings(Material))
#: the kind of each key of the blocks "material" and "packing", and of each parameter of a sweep
PARTS: dict[str, Kind] = {
    **{name: declared.kind for name, declared in list_settings(Material).items()},
    "mass": with_unit(MASS),
    "lattice": Kind.plain(read_lattice, write_lattice),
    "diameter": with_unit(LENGTH),
    "width": with_unit(WIDTH),
    "spread": Kind(_read_spread, _write_spread),
    "friction": Kind.plain(truth, bool),
    "finite_overlap": Kind.plain(truth),
    "motions": Kind(_read_motions),
    "torsion": Kind.plain(
        _read_torsion, lambda value: value if isinstance(value, str) else float(value)
    ),
    "bending": Kind.plain(zero_or_above, float),
}


def _write_packing_spread(spread: Any, context: Context) -> dict[str, Any]:
    """Return the block of the spread of a packing. If its measured diameters are too many for a
    scene file, the block names the table that a run writes beside the file.
    """
    return {"measured": DIAMETERS_FILE} if is_long(spread) else _write_spread(spread, context)


def _omit_zero(kind: Kind) -> Kind:
    """Return a kind of value that is read as ``kind`` reads it, and written likewise unless the
    value is zero, which is left out.
    """
    return Kind(kind.read, lambda value, context: kind.write(value, context) if value else None)


#: the keys of the block "packing"
PACKING: dict[str, Setting] = {
    "lattice": Setting(PARTS["lattice"], "how the balls are arranged, see [lattices](#lattices)"),
    "diameter": Setting(PARTS["diameter"], "diameter of a ball; the mean, if they differ", NEEDED),
    "spread": Setting(
        Kind(_read_spread, _write_packing_spread),
        "how diameters differ, see [spread](#spread)",
        "equal balls",
    ),
    "friction": Setting(
        PARTS["friction"],
        "whether contacts resist shear; without friction, torsion and bending balls do not rotate",
    ),
    "finite_overlap": Setting(
        PARTS["finite_overlap"],
        "keep the [terms of relative order"
        " overlap/diameter](../explanation/model.md#finite-overlap)",
    ),
    "motions": Setting(
        PARTS["motions"],
        "how each ball moves, see [lattices](#lattices)",
        "`longitudinal` on a chain, `in_plane` in the plane, `all` in space",
    ),
    "torsion": Setting(
        _omit_zero(PARTS["torsion"]),
        "stiffness of a contact against twist, over k d²; `mindlin`: that of Hertz contacts"
        " without slip",
    ),
    "bending": Setting(
        _omit_zero(PARTS["bending"]),
        "stiffness of a contact against rolling, over k d²",
    ),
}


def _read_parameters(value: Any, context: Context) -> tuple[tuple[str, tuple[Any, ...]], ...]:
    """Return the parameters of a sweep, in the order of their block, each as its name and its
    values; none for an empty block. Refused for a ``value`` that is no block, for an unknown name,
    and for values that the parameter cannot have.
    """
    names = [*(context.parameters or PARAMETERS), *LOSS_PARAMETERS]
    if isinstance(value, Mapping):
        # any wall is allowed here, as other blocks say which walls there are
        names += [name for name in value if isinstance(name, str) and is_of_wall(name)]
    # a scene without parameters of a crystal is that of a packing, whose lattices may be swept
    if not context.parameters and isinstance(value, Mapping) and "lattice" in value:
        # motions must be allowed on each of the lattices
        lattices = tuple(map(find_lattice, read_lattices(value["lattice"])))
        context = replace(context, swept=lattices)
    rules: dict[str, Rule] = {
        name: partial(_read_axis, name=name, context=context) for name in names
    }
    return tuple(block(value, rules).items())


def find_kind(name: str) -> Kind:
    """Return the kind of the values of the parameter ``name`` of a sweep, such as "width",
    "A.diameter" or "on_site.x". Any words may stand before a point, as the name of a kind of balls;
    KeyError if the name does not end in that of a parameter.
    """
    if name in SPRING_PARAMETERS:
        # "on_site.x" is that of one motion, "on_site" that of all displacements
        return _SPRING_KINDS.get(name.partition(".")[2], _SPRING)
    if name in LOSS_PARAMETERS:
        return LOSS_KINDS[LOSS_PARAMETERS[name]]
    # "A.diameter" is the diameter of the balls of kind A
    return PARTS[name.rpartition(".")[2]]


def _read_axis(value: Any, name: str, context: Context) -> tuple[Any, ...]:
    """Return the values of the parameter ``name`` of a sweep, numbers in SI units, from a list, or
    for numbers also from one number or a range. Refused for values that the parameter cannot have,
    and for a value that is given twice.
    """
    rule = find_kind(name).rule(context)
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
    """Return the block of the parameters of a sweep, pairs of a name and its values; None if there
    are no parameters.
    """

    def write(name: str, values: tuple[Any, ...]) -> Any:
        """Return plain data for the values of the parameter ``name``: a list, or for numbers alone
        what :func:`~granphon.base.settings.write_values` makes of them.
        """
        kind = find_kind(name)
        has_words = any(isinstance(value, str) for value in values)
        if find_unit(name) and not has_words:
            return write_values(values, lambda value: kind.write(value, context))
        return [kind.write(value, context) for value in values]

    return {name: write(name, values) for name, values in parameters} or None


SWEEP = Setting(
    Kind(_read_parameters, _write_parameters),
    "parameters of the packing, each with the values that it takes, see [sweep](#sweep)",
    "none",
)


#: rule of a correlation
_CORRELATION: Rule = partial(number, low=-1.0, high=1.0)


def _read_correlations(value: Any) -> tuple[tuple[str, str, float], ...]:
    """Return correlations as triples: the names of two parameters, and a number from -1 to 1. The
    ``value`` is a block whose keys are the two names with a comma between them; or a tuple of such
    triples, those of another scene. Refused for any other value.
    """
    if isinstance(value, tuple):
        return tuple(
            read_inside(index, _read_correlation, triple) for index, triple in enumerate(value)
        )
    example = "'young_modulus, diameter: 0.3'"
    if not isinstance(value, Mapping):
        raise Refused(show(value), f"a block of pairs of parameters, such as {example}")
    correlations = []
    for key, entry in value.items():
        names = [name.strip() for name in str(key).split(",")]
        if len(names) != 2 or not all(names):
            raise Refused(show(key), f"two parameters, such as {example}", path=(key,))
        correlations.append((*names, read_inside(key, _CORRELATION, entry)))
    return tuple(correlations)


def _read_correlation(triple: Any) -> tuple[str, str, float]:
    """Return the names of two parameters and the correlation of their errors, from a ``triple`` of
    these; Refused for any other value.
    """
    if not isinstance(triple, tuple) or len(triple) != 3:
        raise Refused(show(triple), "the names of two parameters and a correlation")
    first, second, correlation = triple
    return text(first), text(second), _CORRELATION(correlation)


def _write_correlations(correlations: Sequence[tuple[str, str, float]]) -> dict[str, float] | None:
    """Return the block of ``correlations``, numbers by the two names with a comma between them;
    None if there are none.
    """
    return {f"{first}, {second}": value for first, second, value in correlations} or None


CORRELATIONS = Setting(
    Kind.plain(_read_correlations, _write_correlations),
    "correlations of standard errors, by two parameters: `young_modulus, diameter: 0.3`, see"
    " [standard errors](../how-to/errors.md)",
    "none",
)
#: key of the block {fit: FILE} that stands for a value which the fit in the file has found
FIT = "fit"


# -- loads, media and observables ------------------------------------------------------------------


def _make_load_kind(name: str) -> Kind:
    """Return the kind of the values of a load of the kind ``name``, "force", "pressure", "overlap"
    or "side_force".

    Pressures are read and written in the unit of their lattice. The unit of the kind, which the
    reference of scenes shows, is that of a pressure in a plane.
    """

    def read(value: Any, context: Context) -> tuple[float, ...]:
        """Return the values of the load, SI, from one value, a list or a range."""
        return read_values(value, partial(_read_load, name=name, lattice=context.lattice))

    def write(load: Any, context: Context) -> Any:
        """Return the values of a ``load`` with units; None for a load of another kind, and for
        gravity alone, which is kept as a pressure of zero.
        """
        # a force or pressure of zero is none beside gravity; an overlap of zero is a load
        is_gravity_alone = name != "overlap" and not any(load.values)
        if load.kind != name or is_gravity_alone:
            return None
        quantity = load_quantities(context.lattice.pressed_axes)[name]
        return write_values(load.values, quantity.write)

    return Kind(read, write, LOADS[name].unit)


def _read_load(value: Any, name: str, lattice: Lattice) -> float:
    """Return one value, SI, of a load of the kind ``name`` from a text of a number and its unit.
    The refusal of a pressure that has the unit of a lattice of another dimension says which unit
    the pressure of this ``lattice`` has.
    """
    quantity = load_quantities(lattice.pressed_axes)[name]
    try:
        return quantity.read(value)
    except Refused as refused:
        if not _is_load_of_any_lattice(value, name):
            raise
        mend = f"The pressure of the {lattice.name} lattice is in {quantity.unit}. {refused.mend}"
        raise Refused(refused.found, refused.allowed, mend.rstrip()) from None


def _is_load_of_any_lattice(value: Any, name: str) -> bool:
    """Return whether a ``value`` is a valid load of the kind ``name`` on a lattice of some number
    of periods, one, two or three.
    """
    for periods in (1, 2, 3):
        with suppress(Refused):
            load_quantities(periods)[name].read(value)
            return True
    return False


def _read_media(value: Any, context: Context) -> tuple[MediumChoice, ...]:
    """Return the choices of media that a ``value`` describes, one medium or a list of media.
    Refused for an unknown medium, options that a medium does not have, an empty list, and a medium
    that is given twice with the same options.
    """
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
    """Return plain data for the ``choices`` of media: one medium, or a list of several. A medium is
    its name, or {NAME: options} if it has options.
    """
    settings = [(choice.name, choice.settings_on(context.lattice)) for choice in choices]
    media = [{name: options} if options else name for name, options in settings]
    return media if len(media) > 1 else media[0]


MEDIUM = Setting(
    Kind(_read_media, _write_media),
    "how a spread of diameters is averaged, see [media](#media)",
    "`ema`; `ala` for equal balls",
)


def _read_schema(value: Any) -> int:
    """Return the number of the schema of a scene file; Refused for any ``value`` but the number
    that this version of granphon reads.
    """
    if value == SCENE_SCHEMA and is_whole(value):
        return SCENE_SCHEMA
    mend = ""
    if isinstance(value, int) and value > SCENE_SCHEMA:
        mend = "The scene was written for a newer granphon."
    raise Refused(show(value), str(SCENE_SCHEMA), mend)


SCHEMA = Setting(Kind.plain(_read_schema), "version of this format", f"`{SCENE_SCHEMA}`")


def _read_observables(value: Any) -> tuple[str, ...]:
    """Return the names of the observables of a scene from a list, in the order of ``OBSERVABLES``;
    registered observables and outputs come behind those of the package. If a registered observable
    is found from velocities or an exponent, "velocities" is among the names too.

    Refused for a ``value`` that is no list, an empty list, an unknown name, and a name that is
    given twice.
    """
    added_costs = _list_added_costs()
    observables = (*OBSERVABLES, *added_costs)
    allowed = "a list of one or more of " + ", ".join(observables)
    if not isinstance(value, list | tuple) or not value:
        is_name = isinstance(value, str) and value in observables
        mend = f"Did you mean [{value}]?" if is_name else ""
        is_empty_list = isinstance(value, list) and not value
        raise Refused("an empty list" if is_empty_list else show(value), allowed, mend)
    for name in value:
        try:
            choice(name, observables)
        except Refused as refused:
            # a plugin that is missing, or failed to load, may be why a name is not known
            mend = (
                refused.mend
                or Registry.describe_failures()
                or "Install the plug-in that adds the name"
            )
            raise Refused(refused.found, refused.allowed, mend) from None
    names = list(value)
    for name in names:
        if names.count(name) > 1:
            raise Refused(f"{name!r} twice", allowed + ", each once")
    if any(added_costs.get(name, "state") != "state" for name in names):
        names.append("velocities")
    return tuple(name for name in observables if name in names)


def _list_added_costs() -> dict[str, str]:
    """Return what each registered observable and output is found from, by its name: the cost of an
    observable as the catalogue has it, and "state" for an output.
    """
    costs: dict[str, str] = {name: entry.cost for name, entry in CATALOGUE.added.items()}
    for name in list_added("output"):
        costs.setdefault(name, "state")
    return costs


OBSERVE = Setting(
    Kind.plain(_read_observables),
    "what to compute. Velocities and moduli are in `sweep.nc` and `sweep.csv` of any run whose long"
    " waves move all balls. `spectrum` and `pulse` are of simulations and of"
    " packings in files, `dos` of simulations where there are several states",
)


def _make_grid_kind(examples: Sequence[str], low: int, high: int, low_in_space: int) -> Kind:
    """Return the kind of whole numbers, one for each period of the lattice, from ``low`` to
    ``high``; on lattices of three periods from ``low_in_space``. The ``examples`` in messages are
    those for one, two and three periods.

    The numbers are written as phonopy writes them: three words, of which those beyond the periods
    are 1.
    """

    def read(value: Any, context: Context) -> tuple[int, ...]:
        """Return the numbers (p,) of a list or text; a chain may have its one number alone."""
        periods = context.lattice.periods
        numbers = [value] if periods == 1 and is_whole(value) else value
        least = low_in_space if periods == 3 else low
        return grid(numbers, least, high, examples[periods - 1], periods)

    return Kind(read, lambda numbers, _: write_grid(numbers))


def write_grid(numbers: Sequence[int]) -> str:
    """Return the text of whole numbers, (p,) one for each period, as phonopy writes them: three
    words, of which those beyond the periods are 1.
    """
    return " ".join(map(str, (*numbers, 1, 1)[:3]))


def _spell_by_periods(texts: Sequence[str]) -> str:
    """Return words, in Markdown, for a default that depends on the lattice, from the ``texts`` for
    one, two and three periods.
    """
    on_line, in_plane, in_space = texts
    return f"`{in_plane}`; `{on_line}` on a chain; `{in_space}` in space"


def read_directions(value: Any, lattice: Lattice) -> tuple[Any, ...]:
    """Return the direction of sound on a ``lattice``: its Cartesian components (p,), or for a list
    of directions a tuple (n, p).

    One direction is a text such as "1 1", a list or an array; ``value`` is one direction or a list
    of directions. Raises :class:`~granphon.base.errors.Refused` for anything else, for a direction
    of zeros, and for a direction that is given twice.
    """
    plain = value.tolist() if isinstance(value, np.ndarray) else value
    is_list = isinstance(plain, list | tuple) and any(map(_is_direction, plain))
    written_directions = plain if is_list else [plain]
    directions: list[tuple[float, ...]] = []
    unit_vectors: list[Array] = []
    for index, written in enumerate(written_directions):
        path = (index,) if is_list else ()
        components = _read_direction(written, lattice, path)
        # directions of different lengths may be the same, but for rounding
        unit_vector = as_direction(components, lattice.periods)
        if any(np.max(np.abs(unit_vector - other)) < _DIRECTION_ROUNDING for other in unit_vectors):
            raise Refused(f"{show(written)} twice", "each direction once", path=path)
        directions.append(components)
        unit_vectors.append(unit_vector)
    return tuple(directions) if is_list else directions[0]


def _read_direction(value: Any, lattice: Lattice, path: tuple[int, ...]) -> tuple[float, ...]:
    """Return the Cartesian components of one direction, (p,), from a text, a list or, on a lattice
    of one period, a number. Refused, at ``path``, for any other value and for zeros.
    """
    words = [value]
    if isinstance(value, str):
        words = value.split()
    elif isinstance(value, list | tuple):
        words = list(value)
    try:
        components = tuple(fraction(word, _LARGEST_COMPONENT) for word in words)
        as_direction(components, lattice.periods)
    except InputError:
        count, example, axes = _DIRECTION_WORDS[lattice.periods]
        allowed = f"{count}, not all zero, such as {example}; or a list of these"
        mend = f"The {lattice.name} lattice repeats along {axes}."
        raise Refused(show(value), allowed, mend, path) from None
    return components


def _is_direction(value: Any) -> bool:
    """Return whether a ``value`` in a list is written as a whole direction, a list or a text of
    several words, and not as one of the numbers of a direction.
    """
    return isinstance(value, list | tuple) or (isinstance(value, str) and len(value.split()) > 1)


DIRECTION = Setting(
    Kind(lambda value, context: read_directions(value, context.lattice)),
    "direction of sound, Cartesian, or a list of directions, see [direction](#direction)",
    "x",
)
#: examples of a supercell of one, two and three periods
_SUPERCELLS = tuple(write_grid((3,) * periods) for periods in (1, 2, 3))
#: the keys of the block "phonopy"
PHONOPY: dict[str, Setting] = {
    "dim": Setting(
        _make_grid_kind(_SUPERCELLS, 2, 100, 2),
        "cells of the supercell for force constants, along each period;"
        f" `{_SUPERCELLS[0]}` on a chain, `{_SUPERCELLS[2]}` in space",
        "the smallest that is large enough",
    ),
    "band": Setting(
        Kind(
            lambda value, context: BandPath.read(value, context.lattice), lambda path, _: str(path)
        ),
        "corners of the path: letters, or three numbers each, in fractions of the reciprocal cell",
        "Γ-K-M-Γ; Γ-X-M-Γ on the square lattice; Γ-X on a chain; in space ASE's",
    ),
    "band_labels": Setting(
        Kind.plain(read_labels),
        "a label for each corner",
        "the letters of the path; none for one in numbers",
    ),
    "band_points": Setting(whole_from(2, 100_000), "points on each segment, both ends counted"),
    "mesh": Setting(
        # in space a 1 would be the mesh of a plane
        _make_grid_kind(tuple(map(write_grid, MESHES)), 1, 4096, 2),
        "wave vectors for the density of states, along each period",
        _spell_by_periods(tuple(map(write_grid, MESHES))),
    ),
}


# -- crystals: balls of several kinds, how they are arranged, and their loads ----------------------


def _list_law_kinds(name: str) -> dict[str, Kind]:
    """Return the kind of each number of the contact law ``name``, by its key."""
    return {key: _make_number_kind(entry) for key, entry in LAWS[name].numbers.items()}


def _make_number_kind(entry: Any) -> Kind:
    """Return the kind of a number of a contact law from its ``entry`` in the table of laws: a
    quantity, a tuple of one quantity for a list of its values, or the rule of a number without a
    unit.
    """
    if isinstance(entry, Quantity):
        return with_unit(entry)
    if isinstance(entry, tuple):
        return listed(with_unit(*entry))
    return Kind.plain(entry, float)


def _read_balls(value: Any, context: Context) -> tuple[tuple[str, Ball], ...]:
    """Return the kinds of balls as pairs of a name and a ball, from a block of kinds by name.

    A kind has a material and a diameter; a mass and an inertia if these are not those of a solid
    ball; and a spread if the diameters differ. Refused for any other value, an empty block, and a
    name that has a point or a space, or is "floor".
    """
    if not isinstance(value, dict) or not value:
        allowed = "a block of kinds of balls by name, each with its material and diameter"
        raise Refused(show(value), allowed)
    kinds = list[tuple[str, Ball]]()
    for name, written in value.items():
        kind = read_inside(name, label, name)
        # these names have a meaning: "A.diameter" is a parameter, "A B" a pair of kinds, and
        # "floor" the other body of contacts with a floor
        if "." in kind or " " in kind or kind == "floor":
            allowed = "a name without a point or a space, and not 'floor'"
            raise Refused(show(name), allowed, path=(name,))
        settings = read_inside(name, _BALL.rule(context), written)
        kinds.append((kind, _make_ball(name, settings, written)))
    return tuple(kinds)


def _make_ball(name: Any, settings: Mapping[str, Any], written: Mapping[str, Any]) -> Ball:
    """Return the ball that has the ``settings`` of a kind, SI by key; the plain data ``written``
    under ``name`` say what the file has.

    Refused for what :class:`~granphon.balls.ball.Ball` refuses, such as a mass that is zero in
    double precision, an inertia above that of a thin shell, and a spread with another mean than the
    diameter. The error is at the mass or the inertia, or at the diameter if neither is at fault or
    the one at fault is not written.
    """
    arguments = dict(settings)
    material_numbers = arguments.pop("material")
    try:
        return Ball(Material(**material_numbers), **arguments)
    except InputError as error:
        # a message about a mass or an inertia begins with its name
        key = "diameter"
        for quantity_name in ("mass", "inertia"):
            if quantity_name in written and str(error).startswith(quantity_name):
                key = quantity_name
        allowed = "a ball that can be"
        raise Refused(show(written[key]), allowed, str(error), (name, key)) from None


_BALL = block_of(
    {
        "material": block_of({key: PARTS[key] for key in MATERIAL_KEYS}, MATERIAL_KEYS[:3]),
        "diameter": PARTS["diameter"],
        "mass": PARTS["mass"],
        "inertia": with_unit(INERTIA),
        "spread": PARTS["spread"],
    },
    ("material", "diameter"),
)
#: the block "balls"; mass and inertia are written also where they are those of a solid ball
BALLS = Setting(
    Kind(
        _read_balls,
        lambda kinds, context: {name: _BALL.write(ball, context) for name, ball in kinds},
    ),
    "kinds of balls by name, see [crystals](#crystals)",
    NEEDED,
)


def _read_structure(value: Any) -> Any:
    """Return the name of a structure such as NaCl, written in any case of letters, the name of a
    lattice, or the lattice that a block {name, cell, sites} describes; Refused for any other value.
    """
    structure = name_structure(value)
    if structure is not None:
        return structure
    if isinstance(value, dict):
        return read_lattice(value)  # its refusals say what a part of the block may be
    try:
        return read_lattice(value)
    except Refused as refused:
        allowed = f"{', '.join((*LATTICES, *STRUCTURES))}, or a block of name, cell and sites"
        # the reader of lattices has not compared the value with the names of structures
        guess = closest(value, (*LATTICES, *STRUCTURES)) if isinstance(value, str) else None
        mend = f"Did you mean {guess!r}?" if guess in STRUCTURES else refused.mend
        raise Refused(refused.found, allowed, mend) from None


def _read_removed_balls(value: Any) -> tuple[int, ...]:
    """Return the numbers of the balls that are removed, from a list, one number, or a text of
    numbers. Refused for any other value, and for a number that is given twice.
    """
    balls = read_counts(value, "numbers of balls", 0, 10_000_000)
    if len(set(balls)) < len(balls):
        repeated = Counter(balls).most_common(1)[0][0]
        raise Refused(f"ball {repeated} more than once", "the number of each ball once")
    return balls


def _read_replaced_balls(value: Any) -> tuple[tuple[int, str], ...]:
    """Return pairs of the number of a ball and the kind of ball that takes its place, from a block
    of kinds by number. Refused for any other value, an empty block, and a number that is given
    twice, also in two ways of writing, as 1 and "01".
    """
    if not isinstance(value, dict) or not value:
        allowed = "a block of numbers of balls and the kinds that take their places, as {12: S}"
        raise Refused(show(value), allowed)
    kinds: dict[int, str] = {}
    for key, kind in value.items():
        # a file may hold the number as a text
        is_text = isinstance(key, str) and re.fullmatch("[0-9]{1,9}", key)
        ball = whole(int(key) if is_text else key, 0)
        if ball in kinds:
            raise Refused(f"ball {ball} more than once", "the number of each ball once")
        kinds[ball] = read_inside(key, label, kind)
    return tuple(kinds.items())


def _read_law(value: Any) -> Any:
    """Return the law that a ``value`` describes by its name, or by the block of its numbers under
    the name. For a block of laws by pairs of kinds, "A B", return for each pair the two names and
    the law. Refused for any other value.
    """
    law = _read_single_law(value)
    if law is not None:
        return law
    is_block = isinstance(value, dict) and bool(value)
    if not is_block or not all(isinstance(key, str) and len(key.split()) == 2 for key in value):
        allowed = f"{_describe_laws()}, or a block of pairs of kinds, as {{A B: hertz}}"
        raise Refused(show(value), allowed, Registry.describe_failures())
    return tuple(
        (tuple(pair.split()), read_inside(pair, _read_law_of_pair, law_of_pair))
        for pair, law_of_pair in value.items()
    )


def _read_law_of_pair(value: Any) -> Any:
    """Return the law of a pair of kinds, from its name or the block of its numbers under the name;
    Refused for any other value.
    """
    law = _read_single_law(value)
    if law is None:
        raise Refused(show(value), _describe_laws(), Registry.describe_failures())
    return law


def _describe_laws() -> str:
    """Return words for a message: the laws by name."""
    return f"{', '.join(LAWS)}, with its numbers"


def _read_single_law(value: Any) -> Any:
    """Return the law that a ``value`` names: the name alone, for a law without numbers, or the name
    with the block of all its numbers; None if the value names no law. Refused for a number that is
    missing, that the law does not have, or that it does not accept.
    """
    name = value
    numbers: Any = None
    if isinstance(value, dict) and len(value) == 1:
        ((name, numbers),) = value.items()
    if not isinstance(name, str) or name not in LAWS:
        return None
    kinds = _list_law_kinds(name)
    read_numbers = block_of(kinds, tuple(kinds)).rule(Context())
    arguments = read_inside(name, read_numbers, {} if numbers is None else numbers)
    with refusing(numbers or name, f"numbers of the law {name}", name):
        law = LAWS[name].law
        # an entry is a class of laws, made with its numbers, or a law itself, which has none
        return law(**arguments) if isinstance(law, type) else law


def _write_law(law: Any) -> Any:
    """Return plain data for a ``law``: its name, or the block of its numbers under its name; for
    laws of pairs of kinds, a block by "A B". InputError for a law that no name stands for.
    """
    if isinstance(law, tuple):
        return {" ".join(pair): _write_law(law_of_pair) for pair, law_of_pair in law}
    for name, entry in LAWS.items():
        if law is entry.law:
            return name
        if type(law) is entry.law:
            # the keys of a table are singular, and its attributes plural
            plural = "s" if entry.law is TabulatedLaw else ""
            numbers = {
                key: kind.write(getattr(law, key + plural), Context())
                for key, kind in _list_law_kinds(name).items()
            }
            return {name: numbers} if numbers else name
    mend = f"Use {', '.join(LAWS)}, granphon.register_law for your own, or granphon.sweep"
    raise InputError(f"the law {law!r}", "A scene file has no words for it", mend)


def _write_structure(structure: Any) -> Any:
    """Return the name of a structure or lattice, or the block of a lattice without such a name;
    None for a crystal that has its cell and sites in place of a structure.
    """
    if structure is None or isinstance(structure, str):
        return structure
    return write_lattice(structure)


_VECTOR = listed(with_unit_unless_zero(WAY), "lengths")
_VECTORS = listed(_VECTOR, "vectors")
_SITE = block_of({"kind": Kind.plain(label), "at": _VECTOR}, ("kind", "at"))
_SITES = listed(_SITE.made(lambda site: (site["at"], site["kind"])), "sites")
_ALL_MOTIONS = tuple(
    dict.fromkeys(motions for dimension in (1, 2, 3) for motions in allowed_motions(dimension))
)
#: the spring to the ground of each motion, by name, and of all displacements
_SPRING_KINDS = {
    name: with_unit(find_quantity(name)) for name in (*DISPLACEMENTS, ROTATION, *ROTATIONS)
}
_SPRINGS = block_of(_SPRING_KINDS)
_SPRING = with_unit(find_quantity(ON_SITE))


def _read_on_site(value: Any, context: Context) -> Any:
    """Return the springs to the ground: one stiffness against all displacements, N/m, or from a
    block pairs of the name of a motion and its stiffness, N/m or N m; None for an empty block.
    Refused for any other value.
    """
    if isinstance(value, dict):
        return tuple(_SPRINGS.read(value, context).items()) or None
    return _SPRING.read(value, context)


def _write_on_site(springs: Any, context: Context) -> Any:
    """Return plain data for ``springs`` to the ground, with units: one stiffness against all
    displacements, or a block of stiffnesses by motion; None without springs.
    """
    if springs is None:
        return None
    if isinstance(springs, tuple):
        return _SPRINGS.write(dict(springs), context)
    return _SPRING.write(springs, context)


def _write_sites(sites: Sequence[Any], context: Context) -> Any:
    """Return the list of blocks {kind, at} for ``sites``, pairs of a place, m, and a kind; None
    without sites.
    """
    blocks = [{"kind": kind, "at": place} for place, kind in sites]
    return _SITES.write(blocks, context) or None


#: the keys of the block "crystal"
CRYSTAL: dict[str, Setting] = {
    "lattice": Setting(
        Kind.plain(_read_structure, _write_structure),
        "a lattice, or `NaCl`, `CsCl`, `zincblende`",
        "`cell` and `sites`",
    ),
    "kinds": Setting(
        Kind.plain(
            partial(each, rule=label, what="names of kinds"), lambda names: list(names) or None
        ),
        "names of kinds that follow each other on its sites",
        "all kinds in turn",
    ),
    "cell": Setting(
        Kind(
            # a crystal that repeats nowhere has no vectors
            lambda value, context: () if value == [] else _VECTORS.read(value, context),
            lambda rows, context: _VECTORS.write(rows, context) or None,
        ),
        "vectors along which the crystal repeats, each a list of lengths",
        "`lattice`",
    ),
    "sites": Setting(
        Kind(_SITES.read, _write_sites),
        "a block `kind`, `at` for each ball: its kind, and its place",
        "`lattice`",
    ),
    "repeat": Setting(REPEAT, "cells of the supercell along each period", "one cell"),
    "cut": Setting(
        CUT,
        "block `axis`, `layers`, `edges` of a strip, slab or column, or a list; an edge is a word,"
        " or `{wall: ...}` with a material, or the kind of balls that has it",
        "none",
    ),
    "replace": Setting(
        Kind.plain(_read_replaced_balls, lambda pairs: dict(pairs) or None),
        "numbers of balls, and the kinds that take their places",
        "none",
    ),
    "remove": Setting(
        Kind.plain(_read_removed_balls, lambda balls: list(balls) or None),
        "numbers of balls that are taken out",
        "none",
    ),
    "seed": Setting(
        whole_from(0),
        "of the diameters, where kinds have a spread: `repeat` is then a sample",
    ),
    "law": Setting(
        Kind.plain(_read_law, _write_law),
        "the law of contacts, or a block of pairs of kinds with a law for each",
        "`hertz`",
    ),
    "friction": Setting(PARTS["friction"], "whether contacts resist shear"),
    "motions": Setting(
        word_of(*_ALL_MOTIONS),
        "how each ball moves, see [lattices](#lattices)",
        "as in `packing`",
    ),
    **{name: PACKING[name]._replace(meaning="as in `packing`") for name in ("torsion", "bending")},
    "on_site": Setting(
        Kind(_read_on_site, _write_on_site),
        "springs to the ground: one stiffness of displacements, or a block of `x`, `y`, `z`,"
        " `rotation`, `rotation_x` and so on",
        "none",
    ),
    "finite_overlap": Setting(
        PARTS["finite_overlap"],
        "the true geometry: contacts turn, the cell deforms, and static forces enter the response",
    ),
}


def _make_tensor_kind(name: str) -> Kind:
    """Return the kind of the tensor ``name``, "stress" or "strain", along the periods: in a file a
    list in Voigt order, or a symmetric matrix.
    """

    def read(value: Any, context: Context) -> tuple[float, ...]:
        """Return the components in Voigt order, SI. Zero components of a stress need no unit."""
        periods = context.lattice.periods
        component = Kind.plain(partial(number, low=-1e300, high=1e300))
        if name == "stress":
            component = with_unit_unless_zero(tensor_quantities(periods)[name])
        return _read_tensor(value, name, periods, component.rule(context))

    def write(load: Any, context: Context) -> Any:
        """Return the components of the tensor of a ``load`` in Voigt order, those of a stress with
        units; None for a load of another kind. Of several loads it is the tensor that the factors
        multiply.
        """
        if load.kind != name:
            return None
        tensor = _join_tensor(load) or load.tensor
        if name == "strain":
            return [*tensor]
        quantity = tensor_quantities(context.lattice.periods)[name]
        return [quantity.write(component) for component in tensor]

    return Kind(read, write)


def _read_tensor(value: Any, name: str, periods: int, read_component: Rule) -> tuple[float, ...]:
    """Return the components of the tensor ``name`` in Voigt order: of a "stress" in N, N/m or Pa
    for 1, 2 or 3 ``periods``, or of a "strain".

    The ``value`` is a list in this order, for one period also the component alone, or the rows (p,
    p) of a symmetric matrix. Its entries are read by ``read_component``. Refused for any other
    value, and for a tensor of zeros.
    """
    n_components = len(voigt_pairs(periods))
    rows = list(value) if isinstance(value, list | tuple) else [value]
    are_rows = all(isinstance(row, list | tuple) and len(row) == periods for row in rows)
    if periods > 1 and len(rows) == periods and are_rows:
        tensor = _read_matrix(value, name, read_component)
    elif len(rows) == n_components:
        tensor = tuple(each(rows, read_component, "numbers"))
    else:
        tensor = ()
    if any(tensor):
        return tensor
    words = ("number", "numbers") if name == "strain" else ("quantity", "quantities")
    rows_allowed = f", or {periods} rows of {periods}" if periods > 1 else ""
    allowed = (
        f"{counted(n_components, *words)} in Voigt order{rows_allowed}; tension and extension are"
        " positive"
    )
    problem = f"{show(value)}, which is zero" if tensor else show(value)
    raise Refused(problem, allowed)


def _read_matrix(value: Sequence[Any], name: str, read_component: Rule) -> tuple[float, ...]:
    """Return the components, in Voigt order, of the tensor ``name``, "stress" or "strain", from the
    rows (p, p) of a matrix; Refused for a matrix that is not symmetric.
    """
    read_row = partial(each, rule=read_component, what="numbers")
    matrix = np.array(each(value, read_row, "rows"))
    if not np.array_equal(matrix, matrix.T):
        raise Refused(show(value), "a symmetric matrix")
    # in Voigt order a shear strain is that of the angle, xy + yx
    factor_of_shear = 2.0 if name == "strain" else 1.0
    return tuple(
        float(matrix[row, column]) * (1.0 if row == column else factor_of_shear)
        for row, column in voigt_pairs(len(matrix))
    )


def _join_tensor(load: Any) -> tuple[float, ...] | None:
    """Return the tensor of a single ``load`` times its factor, SI in Voigt order, so that a file
    needs no factors. None for several loads, and where :func:`split_tensor` would not give the
    tensor and the factor again to the last bit.
    """
    if load.size != 1:
        return None
    tensor = tuple(component * load.values[0] for component in load.tensor)
    is_split_again = split_tensor({load.kind: tensor})["tensor"] == load.tensor
    return tensor if is_split_again else None


def _write_times(load: Any) -> Any:
    """Return plain data for the factors of the tensor of a ``load``; None for a load without
    tensor, and for a tensor that is written as the product with its one factor.
    """
    if load.tensor is None or _join_tensor(load):
        return None
    return write_values(load.values, float)


def _declare_load(kind: str, meaning: str) -> Setting:
    """Return the declaration of the key of a ``kind`` of load, with the words ``meaning``."""
    make_kind = _make_tensor_kind if kind in TENSORS else _make_load_kind
    return Setting(make_kind(kind), meaning, "one load is required")


#: the keys of the block "load"
LOAD: dict[str, Setting] = {
    "force": _declare_load("force", "mean force between touching balls"),
    "pressure": _declare_load(
        "pressure",
        "force per length of the boundary; on a chain the force, N; in space the force per"
        " area, Pa",
    ),
    "overlap": _declare_load(
        "overlap",
        "how far touching balls are pressed into each other; may be negative if balls differ",
    ),
    "side_force": _declare_load(
        "side_force", "push F on each side of a hexagonal frame: the contact force is F/(n √3)"
    ),
    "balls_per_side": Setting(
        Kind.plain(balls_on_side),
        "the number n of balls that lean on a side of that frame",
        "required with `side_force`",
    ),
    "stress": _declare_load(
        "stress", "of a crystal: the stress in Voigt order, or as a matrix; tension is positive"
    ),
    "strain": _declare_load(
        "strain",
        "of a crystal: the strain of its periods from where balls touch; extension is positive",
    ),
    "times": Setting(
        Kind.plain(lambda value: read_values(value, above_zero), _write_times),
        "factors by which a stress or strain is multiplied",
        "`1`",
    ),
    "gravity": Setting(
        with_unit(ACCELERATION),
        "of a crystal with a floor or clamp: the acceleration towards it, with another load"
        " or alone",
        "none",
    ),
}


def split_tensor(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a :class:`~granphon.Load` from the ``values`` of a block with a
    stress or strain that is not zero, SI by key: the kind; the tensor divided by the magnitude of
    its greatest component; and as the array the factors that multiply this tensor, SI.
    """
    name = "stress" if "stress" in values else "strain"
    greatest = max(map(abs, values[name]))
    return {
        "kind": name,
        "array": tuple(greatest * factor for factor in values.get("times", (1.0,))),
        "tensor": tuple(component / greatest for component in values[name]),
    }
