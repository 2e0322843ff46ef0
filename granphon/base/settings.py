"""Settings of a scene, each declared once.

A class of settings is a :class:`Block` whose attributes are made by :func:`setting`. From the
declaration follow the attribute and its default, the check of a value that Python gives, how the
key of a scene file is read, with its unit, and written, the line that ``granphon check`` prints,
the entry in the docstring of the class, and the row of the page of the reference.
"""

from __future__ import annotations

import dataclasses
import math
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from functools import partial
from inspect import cleandoc
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeVar, dataclass_transform

import numpy as np

from granphon.base.errors import Refused
from granphon.base.quantities import Quantity
from granphon.base.text import show
from granphon.base.validation import (
    Rule,
    above_zero,
    block,
    choice,
    each,
    number,
    read_words,
    require,
    whole,
    zero_or_above,
)

BlockClass = TypeVar("BlockClass", bound="Block")
#: the default of a key that has none, in words
NEEDED = "required"
#: how the points of a range may be spaced; the first is the default
SCALES = ("log", "linear")
#: the most points of a range, far above those of any sweep: a mistyped number does not fill the
#: memory
_MOST_POINTS = 200_000
#: size of the largest number that Python may give for a quantity of any sign, far above that of any
#: such quantity in SI
_LARGEST_NUMBER = 1e300
#: key of the metadata of an attribute under which its declaration stands
_DECLARATION_KEY = "setting"
#: characters in a line of a docstring, without the indentation of its class
_DOCSTRING_WIDTH = 96


@dataclass(frozen=True, kw_only=True)
class ValueContext:
    """Where a value comes from, on which depends how the value is read.

    Attributes
    ----------
    folder : the folder in which tables that a file names are sought.
    written : whether the value stands in a file, where quantities have units. Numbers that come
        from Python are in SI.
    """

    folder: Path = dataclasses.field(default_factory=Path)
    written: bool = True


#: the context of values that come from Python
IN_PYTHON = ValueContext(written=False)


class Kind(NamedTuple):
    """How values of one sort are read, from a file or from Python, and written into a file; and
    their SI unit, if all have one.

    A reader takes a value and a :class:`ValueContext`, and raises
    :class:`~granphon.base.errors.Refused` for a value that is not allowed, see
    :mod:`granphon.base.validation`. A writer returns plain data that the reader turns into the same
    value, to the last bit but for the sign of a zero; None for a value that is not written.
    """

    read: Callable[[Any, Any], Any]
    write: Callable[[Any, Any], Any] = lambda value, _: value
    unit: str = ""

    @classmethod
    def plain(cls, rule: Rule, write: Callable[[Any], Any] = lambda value: value) -> Kind:
        """Return the kind of values that a ``rule`` reads and ``write`` writes, wherever they come
        from.
        """
        return cls(lambda value, _: rule(value), lambda value, _: write(value))

    def made(self, make: Callable[[Any], Any]) -> Kind:
        """Return the kind of objects that ``make`` makes from the values of this kind. The objects
        are written by the same writer as the values.
        """
        return self._replace(read=lambda value, context: make(self.read(value, context)))

    def rule(self, context: ValueContext) -> Rule:
        """Return the rule that reads a value of this kind from where ``context`` says."""
        return lambda value: self.read(value, context)


def with_unit(kind: Quantity) -> Kind:
    """Return the kind of a number that has its unit in a file, as "8 mm", and is in SI in
    Python.
    """
    rule: Rule
    if kind.least == "any":
        rule = partial(number, low=-_LARGEST_NUMBER, high=_LARGEST_NUMBER)
    elif kind.least == "above zero":
        rule = partial(above_zero, unit=kind.unit)
    else:
        rule = partial(zero_or_above, unit=kind.unit)
    return Kind(
        lambda value, context: kind.read(value) if context.written else rule(value),
        lambda value, _: kind.write(value),
        kind.unit,
    )


def with_unit_unless_zero(kind: Quantity) -> Kind:
    """Return the kind of :func:`with_unit` of a quantity that may be zero, except that zero needs
    no unit.
    """
    number_kind = with_unit(kind)

    def read(value: Any, context: ValueContext) -> Any:
        """Return the number in SI; a plain zero is read in a file too."""
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return 0.0 if is_number and value == 0 else number_kind.read(value, context)

    return number_kind._replace(read=read)


def word_of(*options: str) -> Kind:
    """Return the kind of a word that is one of the ``options``."""
    return Kind.plain(partial(choice, options=options))


def whole_from(low: int, high: int | None = None) -> Kind:
    """Return the kind of a whole number from ``low`` to ``high``; without an upper limit if
    ``high`` is None.
    """
    return Kind.plain(partial(whole, low=low, high=high))


def listed(kind: Kind, what: str = "values") -> Kind:
    """Return the kind of a list of one or more values, each of a ``kind``, which are read as a
    tuple; ``what`` is the plural for the values in messages.
    """
    return Kind(
        lambda values, context: each(values, kind.rule(context), what),
        lambda values, context: [kind.write(value, context) for value in values],
    )


def one_or_more(kind: Kind, what: str, once: str = "") -> Kind:
    """Return the kind of a tuple of one or more values, each of a ``kind``. In a file a tuple of
    one value is written as this value, and a longer tuple as a list.

    ``what`` is the plural for the values in messages. Unless ``once`` is empty, a list that has a
    value twice is refused, and ``once`` says in the message what is allowed.
    """
    several = listed(kind, what)

    def read(value: Any, context: ValueContext) -> tuple[Any, ...]:
        """Return the values of a list, or the only value as a tuple."""
        if not isinstance(value, list | tuple):
            return (kind.read(value, context),)
        values: tuple[Any, ...] = several.read(value, context)
        if once and len(set(values)) < len(values):
            raise Refused(show(value), once)
        return values

    def write(values: Sequence[Any], context: ValueContext) -> Any:
        """Return the list of the values as a file has them, or the only one."""
        entries = several.write(values, context)
        return entries if len(entries) > 1 else entries[0]

    return Kind(read, write)


def block_of(kinds: Mapping[str, Kind], needed: Sequence[str] = ()) -> Kind:
    """Return the kind of a block of keys, each of its own kind, of which some are ``needed``.

    A block is read as a mapping. It is written from a mapping, or from the attributes of an object,
    under the same names; a key whose value is None, or is not written by its kind, is left out.
    """

    def read(value: Any, context: ValueContext) -> dict[str, Any]:
        """Return the entries of the block by key, each read by the rule of its kind."""
        rules = {key: kind.rule(context) for key, kind in kinds.items()}
        return block(value, rules, needed)

    def write(values: Any, context: ValueContext) -> dict[str, Any]:
        """Return the entries of a mapping or an object as a file has them, without those that are
        None and those that their kinds do not write.
        """
        entries = {}
        for key, kind in kinds.items():
            value = values.get(key) if isinstance(values, Mapping) else getattr(values, key)
            plain_value = None if value is None else kind.write(value, context)
            if plain_value is not None:
                entries[key] = plain_value
        return entries

    return Kind(read, write)


def read_counts(value: Any, what: str, low: int, high: int) -> tuple[int, ...]:
    """Return the whole numbers, from ``low`` to ``high``, that ``value`` holds: one number, a list
    of numbers, or a text of numbers of at most nine digits, parted by spaces. ``what`` is the
    plural for the numbers in messages.
    """
    if isinstance(value, str):
        counts: Sequence[Any] = read_words(value)
    elif isinstance(value, list | tuple):
        counts = value
    else:
        counts = [value]
    return each(counts, partial(whole, low=low, high=high), what)


# -- lists and ranges ------------------------------------------------------------------------------


def read_values(value: Any, rule: Rule) -> tuple[float, ...]:
    """Return the numbers, in SI units, that ``value`` holds: one number, a list of numbers, or a
    range {from, to, points, scale}. The ``rule`` reads each number and both ends of a range; the
    points of a range, 1 to 200 000 with both ends, are evenly spaced on its scale, "log" (the
    default) or "linear".

    Raises :class:`~granphon.base.errors.Refused` for another value; for a range whose number of
    points does not fit its ends, which are one value or two; for a log range that is not above
    zero; and for a range too wide for a float.
    """
    if isinstance(value, list | tuple):
        return each(value, rule, "values")
    if not isinstance(value, dict):
        return (rule(value),)
    rules: dict[str, Rule] = {
        "from": rule,
        "to": rule,
        "points": partial(whole, low=1, high=_MOST_POINTS),
        "scale": partial(choice, options=SCALES),
    }
    entries = block(value, rules, ("from", "to", "points"))
    first = entries["from"]
    last = entries["to"]
    n_points = entries["points"]
    scale = entries.get("scale", SCALES[0])
    words = f"range from {value['from']} to {value['to']}"
    is_one_value = first == last
    if is_one_value != (n_points == 1):
        allowed = "1 if both ends are the same, 2 or more if they are not"
        raise Refused(f"{n_points} for the {words}", allowed, path=("points",))
    if scale == "log" and min(first, last) <= 0.0:
        raise Refused(f"a log {words}", "values above zero", "Write scale: linear.")
    if not math.isfinite(last - first):
        raise Refused(f"a {words}", "ends whose difference double precision can hold")
    return space_evenly(first, last, n_points, scale)


def space_evenly(first: float, last: float, count: int, scale: str) -> tuple[float, ...]:
    """Return ``count`` numbers, one or more, evenly spaced on a ``scale``, "log" or "linear", from
    exactly ``first`` to exactly ``last``, which on "log" are both above zero; of one number,
    ``first``. Where the difference of the ends is beyond double precision, all but the last may be
    nan or infinite on "linear".
    """
    space = np.geomspace if scale == "log" else np.linspace
    with np.errstate(all="ignore"):
        # the ends may be the smallest and the largest numbers of double precision
        return tuple(space(first, last, count).tolist())


def write_values(values: Sequence[float], write: Callable[[float], Any]) -> Any:
    """Return plain data that :func:`read_values` reads as the same one or more ``values``: a single
    value, a range whose points are the values to the last bit but for the sign of a zero, or else a
    list, as of more values than a range may have points. ``write`` returns the plain data of one
    value.
    """
    first = values[0]
    last = values[-1]
    count = len(values)
    if count == 1:
        return write(first)
    # a list of two is shorter than their range; a range of equal ends has one point
    may_be_range = 2 < count <= _MOST_POINTS and first != last
    for scale in SCALES if may_be_range else ():
        has_scale = scale == "linear" or min(first, last) > 0.0
        if has_scale and space_evenly(first, last, count, scale) == tuple(values):
            return {"from": write(first), "to": write(last), "points": count, "scale": scale}
    return [write(value) for value in values]


# -- blocks ----------------------------------------------------------------------------------------


class Setting(NamedTuple):
    """The declaration of an attribute of a :class:`Block`, or of another key of a scene file.

    Attributes
    ----------
    kind : how its value is read and written.
    meaning : in words, for the reference.
    default : of a key that is left out, in words; :data:`NEEDED` where it has none, and empty for
        that of the class.
    title : its name in the lines of ``granphon check``, in which {block} stands for the name of the
        block; without one it is not listed.
    is_optional : whether its value may be None, as its default is.
    """

    kind: Kind
    meaning: str
    default: str = ""
    title: str = ""
    is_optional: bool = False


def setting(
    kind: Kind, meaning: str, *, default: Any = MISSING, absent: str = "", title: str = ""
) -> Any:
    """Declare an attribute of a :class:`Block`; ``kind``, ``meaning`` and ``title`` are those of
    :class:`Setting`.

    ``default`` is the value of the attribute if none is given; without a default a value is
    required. With None as default the value may be None. ``absent`` describes the default in words,
    for a default that would not explain itself in a table, such as None.
    """
    words = absent or NEEDED
    if default is not MISSING and not absent:
        values = default if isinstance(default, tuple) else (default,)
        texts = [f"{value:g}" if isinstance(value, float) else str(value) for value in values]
        quantity = f"{', '.join(texts)} {kind.unit}".rstrip()
        words = f"`{quantity}`"
    declared = Setting(kind, meaning, words, title, is_optional=default is None)
    return dataclasses.field(default=default, metadata={_DECLARATION_KEY: declared})


def _add_attributes(docstring: str, settings: Mapping[str, Setting]) -> str:
    """Return a ``docstring`` with a list of the attributes that ``settings`` declare, by name,
    before its section about errors, or at its end.
    """
    entries = []
    for name, declared in settings.items():
        words = ", ".join(filter(None, [declared.meaning, declared.kind.unit]))
        if declared.default != NEEDED:
            words += f"; by default {declared.default}"
        # the words are Markdown, for the page: links are left out, and code has two quotes
        words = re.sub(r", see \[[^]]*\]\([^)]*\)", "", words).replace("`", "``")
        entries.append(f"{name} : {words}.")
    wrapped = [
        textwrap.fill(entry, _DOCSTRING_WIDTH, subsequent_indent="    ", break_long_words=False)
        for entry in entries
    ]
    section = "\n".join(["Attributes", "----------", *wrapped])
    head, title_of_errors, errors = docstring.partition("\nRaises\n------\n")
    return f"{head.rstrip()}\n\n{section}\n{title_of_errors}{errors}"


@dataclass_transform(frozen_default=True, field_specifiers=(setting,))
class Block:
    """Settings that stand together in a block of a scene: a frozen dataclass, whose attributes are
    declared by :func:`setting`, and whose values are checked when an object is made. The docstring
    of a subclass, if it has one, gets a list of the attributes that the subclass declares and its
    docstring does not tell; a value with a unit is in SI.

    ``block`` is the name of the block in messages. The attributes of a subclass with ``kw_only``
    are given by name alone, and are listed behind the others.
    """

    block: ClassVar[str] = ""
    _settings: ClassVar[Mapping[str, Setting]]

    def __init_subclass__(cls, kw_only: bool = False) -> None:
        """Make a frozen dataclass of the subclass, whose constructor takes its settings by name
        alone if ``kw_only`` is true; collect its settings, and add those that its docstring does
        not tell to the docstring.
        """
        super().__init_subclass__()
        new_class: Any = dataclass(frozen=True, kw_only=kw_only)(cls)
        ordered_fields = sorted(fields(new_class), key=lambda field: bool(field.kw_only))
        # a subclass of a user may have fields that are declared nowhere
        cls._settings = {
            field.name: field.metadata[_DECLARATION_KEY]
            for field in ordered_fields
            if _DECLARATION_KEY in field.metadata
        }
        docstring = cleandoc(cls.__doc__ or "")
        unsaid_settings = {
            name: declared
            for name, declared in cls._settings.items()
            if name in cls.__annotations__ and f"\n{name} : " not in docstring
        }
        if docstring and unsaid_settings:
            cls.__doc__ = _add_attributes(docstring, unsaid_settings)

    def __post_init__(self) -> None:
        """Check each value by the rule of its setting, and keep what the rule returns; InputError
        names the block and the setting. An optional setting may be None.
        """
        for name, declared in self._settings.items():
            value = getattr(self, name)
            if value is None and declared.is_optional:
                continue
            key = f"{self.block}.{name}" if self.block else name
            object.__setattr__(self, name, require(key, declared.kind.rule(IN_PYTHON), value))


# functions and not methods, as a user of the settings needs none of them


def list_settings(block_class: type[Block]) -> Mapping[str, Setting]:
    """Return the declarations of the settings of a block, by name."""
    return block_class._settings


def make_rules(block_class: type[Block], context: ValueContext) -> dict[str, Rule]:
    """Return for each setting of a block, by name, the rule that reads the value of the setting
    from a file or from Python, as ``context`` says.
    """
    settings = list_settings(block_class)
    return {name: declared.kind.rule(context) for name, declared in settings.items()}


def read_block(block_class: type[BlockClass], value: Any, context: ValueContext) -> BlockClass:
    """Return the settings of a ``block_class`` that a ``value`` gives: a block of keys, or the
    settings themselves, which are returned as they are. Refused for another value, and errors of
    the ``block_class``.
    """
    if isinstance(value, block_class):
        return value
    return block_class(**_keys_of(block_class).read(value, context))


def _keys_of(block_class: type[Block]) -> Kind:
    """Return the kind of the block of keys as which a file holds the settings of a class."""
    settings = list_settings(block_class)
    required = [name for name, declared in settings.items() if declared.default == NEEDED]
    return block_of({name: declared.kind for name, declared in settings.items()}, required)


def write_block(settings: Block, context: ValueContext) -> dict[str, Any]:
    """Return settings as a block of keys of a scene file, without those that are None."""
    entries: dict[str, Any] = _keys_of(type(settings)).write(settings, context)
    return entries


def block_kind(block_class: type[Block]) -> Kind:
    """Return the kind of a block of settings that is the value of a key of another block."""
    return Kind(partial(read_block, block_class), write_block)


def describe_settings(settings: Block) -> list[tuple[str, Any, str]]:
    """Return title, value and SI unit of each setting that has a title and whose value is not None;
    a value with a method ``describe``, such as a wall, is replaced by what that returns.
    """
    rows = []
    for name, declared in list_settings(type(settings)).items():
        value = getattr(settings, name)
        if declared.title and value is not None:
            description = value.describe() if hasattr(value, "describe") else value
            title = declared.title.format(block=settings.block)
            rows.append((title, description, declared.kind.unit))
    return rows
