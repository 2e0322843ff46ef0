"""What every result has in common: frozen, its arrays read-only, convertible to plain data, and
shown as a table.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import Field, dataclass, field, fields, is_dataclass
from html import escape
from types import FunctionType, NoneType, UnionType
from typing import Any, ClassVar, Self, TypeVar, cast, dataclass_transform

import numpy as np

from granphon.base.errors import GranphonError, InputError, brief
from granphon.base.text import (
    counted,
    damage_error,
    digest,
    list_names,
    require_schema,
    show,
    warn_unverified,
)

ResultT = TypeVar("ResultT", bound="Result")
#: most letters of a value, and most entries of an array or a tuple that are all written out
_MOST_LETTERS = 160
_MOST_ENTRIES = 6
#: share of the larger end of a range, below which the other end is taken for rounding
_ROUNDING = 1e-14
#: keys that the plain data of a result hold besides its class and its fields
_ABOUT = ("schema", "units", "digest")
#: the kinds of entries, as NumPy's letters have them, from which an array of a kind is made
_KINDS = {"b": "b", "i": "iu", "f": "iuf", "c": "c"}
#: these kinds in words
_KIND_WORDS = {"b": "truth values", "i": "whole numbers", "f": "numbers", "c": "complex numbers"}
#: the kinds of entries of arrays, by the classes of one entry
_DTYPES = {float: np.float64, int: np.intp, bool: np.bool_, complex: np.complex128}
#: product of the lengths of an empty array that are not zero, at most: NumPy makes no array, not
#: even an empty one, for which this product is beyond the addresses of the machine
_MOST_OF_EMPTY = 2**31
#: ranges of the numbers of a field, by the words of its declaration
_RANGES: dict[str, Callable[[Any], Any]] = {
    "finite": np.isfinite,
    "zero or above": lambda values: np.isfinite(values) & (values >= 0.0),
    "zero or above, or infinite": lambda values: values >= 0.0,
    "above zero": lambda values: np.isfinite(values) & (values > 0.0),
}
#: the kinds of entries that are numbers
_NUMBER_KINDS = "iufc"
#: types of values that plain data hold as they are
_SCALARS: frozenset[type] = frozenset({str, float, int, bool, NoneType})


def write_html(title: str, rows: Iterable[tuple[str, Any, str]]) -> str:
    """Return an HTML table of rows of a name, a value and its SI unit, headed by ``title``; every
    text is escaped.

    A value is described by :func:`describe_value`. The unit "1", of a number without a unit, is
    left blank.
    """
    html_rows = []
    for name, value, unit in rows:
        value_text = _escape_printable(describe_value(value))
        unit_text = "" if unit == "1" else _escape_printable(unit)
        cells = f"<th>{_escape_printable(name)}</th><td>{value_text}</td><td>{unit_text}</td>"
        html_rows.append(f"<tr>{cells}</tr>")
    body = "".join(html_rows)
    head = "<tr><th>name</th><th>value</th><th>unit</th></tr>"
    caption = f"<caption>{_escape_printable(title)}</caption>"
    return f"<table>{caption}<thead>{head}</thead><tbody>{body}</tbody></table>"


def _escape_printable(text: str) -> str:
    """Escape a text for HTML; a letter that :meth:`str.isprintable` refuses, such as a control
    character or a line feed, becomes a question mark.
    """
    return escape("".join(letter if letter.isprintable() else "?" for letter in text))


def describe_value(value: Any) -> str:
    """Return a short text of a value of any kind.

    A float has six digits; truth values are "yes" and "no"; None and an empty list or mapping are
    "none". A list is described by :func:`_describe_list`, an array by :func:`_describe_array`, or
    by its only entry if it has no axes; an object of a dataclass by its attribute ``name``, if that
    is a text, with spaces for underscores, or else by its class. Of a long text or mapping the
    beginning is returned, with dots behind it. Anything else is described by
    :func:`~granphon.base.errors.brief`.
    """
    # floats of NumPy are written below: the item of a long double is a long double again
    if isinstance(value, np.generic) and value.dtype.kind in "biuc":
        return describe_value(value.item())
    if isinstance(value, str):
        if len(value) <= _MOST_LETTERS:
            return value
        ellipsis = " ..."
        return value[: _MOST_LETTERS - len(ellipsis)] + ellipsis
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return f"{float(value):.6g}"
    if value is None:
        return "none"
    if isinstance(value, np.ndarray):
        return _describe_array(value) if value.ndim else describe_value(value.item())
    if isinstance(value, list | tuple):
        return _describe_list(value)
    if isinstance(value, Mapping):
        if not value:
            return "none"
        first_entries = list(value.items())[:_MOST_ENTRIES]
        texts = [f"{name}: {describe_value(entry)}" for name, entry in first_entries]
        return ", ".join(texts) + _count_more(len(value))
    if _is_object_of_dataclass(value):
        name = getattr(value, "name", None)
        return name.replace("_", " ") if isinstance(name, str) else type(value).__name__
    return brief(value, _MOST_LETTERS)


def _describe_list(values: Sequence[Any]) -> str:
    """Return the first ``_MOST_ENTRIES`` entries of a list as text, with the number of entries if
    more follow; "none" for an empty list.

    A longer list of numbers or truth values is described as an array. Several objects of one
    dataclass are described by their number.
    """
    if not values:
        return "none"
    count = len(values)
    if count > _MOST_ENTRIES and all(isinstance(entry, int | float) for entry in values):
        return _describe_array(np.asarray(values))
    classes = {type(entry) for entry in values}
    if count > 1 and len(classes) == 1 and _is_object_of_dataclass(values[0]):
        return f"{count} of {type(values[0]).__name__}"
    texts = [describe_value(entry) for entry in values[:_MOST_ENTRIES]]
    separator = "; " if any(", " in text for text in texts) else ", "
    return separator.join(texts) + _count_more(count)


def _count_more(count: int) -> str:
    """Return dots and the number ``count`` of all entries, for the end of a text that shows the
    first ``_MOST_ENTRIES``; an empty text if there are no more.
    """
    return f", ... ({count} in all)" if count > _MOST_ENTRIES else ""


def _describe_array(values: np.ndarray[Any, Any]) -> str:
    """Return the entries of a small array of one axis as text, unless they are complex; of any
    other array, which has one axis or more, the shape. The shape is followed by the range of the
    finite numbers, or of their magnitudes if they are complex, and by the number of those that are
    not finite; of truth values by how many are true.
    """
    kind = values.dtype.kind
    is_small = 0 < values.size <= _MOST_ENTRIES
    if is_small and values.ndim == 1 and kind != "c":
        return ", ".join(describe_value(entry) for entry in values.tolist())
    shape = " x ".join(map(str, values.shape))
    holds_numbers = kind in "biufc"
    if not values.size or not holds_numbers:
        return f"array {shape}"
    if kind == "b":
        return f"array {shape}, {np.count_nonzero(values)} of them true"
    numbers = np.abs(values) if kind == "c" else values
    finite = numbers[np.isfinite(numbers)]
    n_not_finite = numbers.size - finite.size
    ending = f", {n_not_finite} not finite" if n_not_finite else ""
    if not finite.size:
        return f"array {shape}{ending}"
    ends = np.array([finite.min(), finite.max()])
    if kind == "f":
        # an end that is no more than rounding beside the other end is written as zero
        is_rounding = np.abs(ends) < _ROUNDING * np.max(np.abs(ends))
        ends[is_rounding] = 0.0
    low = describe_value(ends[0].item())
    high = describe_value(ends[1].item())
    prefix = "magnitudes " if kind == "c" else ""
    if low == high:  # in the digits that are shown
        return f"array {shape}, all {prefix}{low}{ending}"
    return f"array {shape}, {prefix}{low} to {high}{ending}"


def read_only(values: Any, dtype: Any = None) -> np.ndarray[Any, Any]:
    """Return a copy of ``values`` as a read-only array, of ``dtype`` unless that is None."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def held(kind: Any, shape: str = "", unit: str = "", within: str = "", **options: Any) -> Any:
    """Declare a field of a result class, in place of :func:`dataclasses.field`.

    Parameters
    ----------
    kind : the type of the value, in the form that :func:`restore` takes. If there is a ``shape``,
        float, int, bool or complex is the type of the entries of an array.
    shape : the sizes of the axes, parted by spaces. A size is a number; a letter, which means the
        same size in all shapes of the class; or a letter plus a number, as "s+1". "..." at the
        beginning stands for the shape of the load, "|" parts shapes that are all allowed, "*" is
        any shape, and "?" at the end says that the field may be None. Arrays of truth values
        have "*": the shapes of other arrays than those of numbers are not checked. Without a shape
        the value is of the ``kind`` itself.
    unit : the SI unit.
    within : the range of the numbers, one of the keys of ``_RANGES``.
    options : ``default``, ``default_factory``, ``repr``, ``compare`` and the others of
        :func:`dataclasses.field` but ``metadata``.
    """
    layout = shape.rstrip("?")
    held_kind = np.dtype(_DTYPES[kind]) if layout and kind in _DTYPES else kind
    if layout != shape:
        held_kind = [NoneType, held_kind]
    checked_shape = shape if layout not in ("", "*") else ""
    metadata = {"kind": held_kind, "shape": checked_shape, "unit": unit, "range": within}
    return field(metadata=metadata, **options)


@dataclass_transform(eq_default=False, frozen_default=True, field_specifiers=(held,))
def result_class(cls: type[ResultT]) -> type[ResultT]:
    """Make a subclass of :class:`Result` the dataclass of its fields, each declared by
    :func:`held`; TypeError names fields that are not.
    """
    new_class: type[ResultT] = dataclass(frozen=True, eq=False, repr=False)(cls)
    undeclared_names = [f.name for f in fields(new_class) if "kind" not in f.metadata]
    if undeclared_names:
        raise TypeError(f"{cls.__name__} does not declare by held: {', '.join(undeclared_names)}")
    return new_class


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """Base of the frozen result classes.

    Each field is declared by ``held``: what it holds, the shape, the SI unit, and the range of
    its numbers where plain data are read. The class keeps the last three in ``_shapes``, ``units``
    and ``_ranges``; a subclass writes the units of its properties into ``units`` itself. When the
    meaning of a field changes, a subclass has a higher ``_schema``. ``_notebook_fields`` names
    properties, quick to find, that a notebook shows after the fields. Arrays are made read-only;
    scalars stay floats. Two results are equal if all their compared fields are equal, array by
    array; ``repr`` shows a large array by its shape. ``class Spectrum(Result, array="values")``
    declares the field that ``np.asarray`` returns of a spectrum.
    """

    _schema: ClassVar[int] = 1
    units: ClassVar[dict[str, str]] = {}
    _shapes: ClassVar[dict[str, str]] = {}
    _ranges: ClassVar[dict[str, str]] = {}
    _notebook_fields: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, array: str = "", **options: Any) -> None:
        """Collect shapes, units and ranges from the fields that a subclass declares; ``array``
        names the field that ``np.asarray`` returns of a result, if any.
        """
        super().__init_subclass__(**options)
        declarations = {
            name: entry.metadata for name, entry in vars(cls).items() if isinstance(entry, Field)
        }

        def collect(key: str) -> dict[str, str]:
            """Return the words under ``key`` in the declaration of each field that has any, by the
            name of the field.
            """
            return {name: words[key] for name, words in declarations.items() if words.get(key)}

        cls._shapes = cls._shapes | collect("shape")
        cls.units = cls.units | collect("unit")
        cls._ranges = cls._ranges | collect("range")
        if array:

            def make_array(self: Result, dtype: Any = None, copy: bool | None = None) -> Any:
                """Return the field ``array`` for ``np.asarray``: a copy, or with ``copy`` False the
                read-only array itself. ValueError if ``copy`` is False and only a copy will do: for
                another ``dtype``, or for a field that is a single number.
                """
                return np.array(getattr(self, array), dtype, copy=copy is not False)

            cls.__array__ = make_array  # type: ignore[attr-defined]

    def __post_init__(self) -> None:
        """Make fields that are arrays read-only, and those that are NumPy's scalars or arrays
        without axes numbers of Python; arrays inside of tuples and mappings stay as they are.
        """
        for name, value in list(vars(self).items()):
            if type(value) in _SCALARS or type(value) is tuple:
                # most values are of these types, and are kept as they are
                continue
            has_one_number = isinstance(value, np.ndarray) and value.ndim == 0
            if isinstance(value, np.generic) or has_one_number:
                object.__setattr__(self, name, value.item())
            elif isinstance(value, np.ndarray):
                # a view is copied, as it would change with the array behind it; but an array that
                # stays in a file is read from there as it is used
                is_view = value.base is not None and not isinstance(value, np.memmap)
                if value.flags.writeable or is_view:
                    object.__setattr__(self, name, read_only(value))

    def __eq__(self, other: object) -> bool:
        """Whether ``other`` is of the same class, and all compared fields are equal."""
        if type(other) is not type(self):
            return NotImplemented
        names = [f.name for f in fields(self) if f.compare]
        return all(_are_equal(getattr(self, name), getattr(other, name)) for name in names)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the function and its arguments from which a copy or pickle is made: copies are
        made by the constructor, so that their arrays are read-only too.
        """
        return self._of_fields, tuple(getattr(self, f.name) for f in fields(self))

    @classmethod
    def _of_fields(cls, *values: Any) -> Self:
        """Build a result from the values of its fields, in their order; a class whose constructor
        takes other arguments overrides the method.
        """
        return cls(*values)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        """Return the result on one line: the class, and name, value and unit of each field."""
        parts = []
        for name, value, unit in self._list_values():
            text = describe_value(value)
            text = f"[{text}]" if ", " in text else text
            parts.append(f"{name}={text}" if unit in ("", "1") else f"{name}={text} {unit}")
        return f"{type(self).__name__}({', '.join(parts)})"

    def _repr_html_(self) -> str:
        """Return the table of fields that a notebook shows, in HTML."""
        return write_html(type(self).__name__, self._list_values())

    def _list_values(self) -> list[tuple[str, Any, str]]:
        """Return name, value and SI unit of each field and property that is shown of a result;
        those that are None or an empty tuple, and properties that the result lacks, are left out.
        """
        units = self._field_units()
        names = [f.name for f in fields(self) if f.repr]
        rows = []
        for name in (*names, *self._notebook_fields):
            # a property that the result lacks raises, as the pressure of some lattices does
            with suppress(GranphonError):
                value = getattr(self, name)
                is_empty = isinstance(value, tuple) and not value
                if value is not None and not is_empty:
                    rows.append((name, value, units.get(name, "")))
        return rows

    def to_dict(self) -> dict[str, Any]:
        """The result as plain data: class name, schema, the units of fields and properties, the
        fields, and a digest of all these.

        Complex arrays become a mapping of ``real`` and ``imag`` lists, empty arrays of several axes
        one of their ``shape``; objects in fields (a packing, its scales) become mappings of their
        own. The digest stays valid through JSON and YAML.
        """
        data = {**plain(self), "schema": self._schema, "units": self._field_units()}
        return data | {"digest": digest(data)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Build a result from plain data: the inverse of :meth:`to_dict`.

        Raises :class:`~granphon.base.errors.InputError` if the data are of another class, of
        another schema, in other units, or incomplete, if a field has another kind, shape or range
        than in the class, if there is a field that the class lacks, or if the ``digest`` is not
        that of the data. Without a digest, damage that passes the other checks is not noticed, and
        there is an :class:`~granphon.base.errors.UnverifiedFileWarning`.
        """
        is_mapping = isinstance(cast("object", data), Mapping)
        entries: dict[str, Any] = dict(data) if is_mapping else {}
        subject = f"a {cls.__name__} in plain data"
        if _read_class_name(entries) != cls.__name__:
            name = entries.get("class")
            described = "no class of results" if name is None else f"a {show(name)}"
            raise InputError(f"these data describe {described}, not a {cls.__name__!r}")
        require_schema(subject, entries.get("schema", cls._schema), cls._schema)
        try:
            content = {name: value for name, value in entries.items() if name not in _ABOUT}
            restored: Self = restore(content, cls)
            # the digest is checked after the content, whose errors say more
            _require_digest(entries, subject)
            # an array as a unit becomes a list, which is refused
            units = plain(entries.get("units", restored._field_units()))
        except RecursionError:
            raise InputError(
                f"the {cls.__name__} data are nested too deeply, or contain themselves"
            ) from None
        if units != restored._field_units():
            mend = "Use the units that to_dict gives: other units are not converted"
            raise InputError(
                f"the units of the {cls.__name__} data are not those of the class", mend=mend
            )
        if "digest" not in entries:
            warn_unverified(subject)
        return restored

    def _field_units(self) -> dict[str, str]:
        """Return the SI unit of each field and property that has one; a subclass in which units
        depend on the values overrides the method.
        """
        return dict(self.units)

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if fields in ``_shapes`` are not numbers,
        if their shapes disagree, or if numbers are out of their range in ``_ranges``.

        Called for results that were read; those that granphon computes pass by construction.
        """
        sizes: dict[str, Any] = {}
        for name, layout in self._shapes.items():
            self._check_shape(name, layout, sizes)
        for name, allowed_range in self._ranges.items():
            values = np.asarray(getattr(self, name))
            if values.dtype.kind not in _NUMBER_KINDS:  # None, of a field that may be None
                continue
            is_wrong = ~_RANGES[allowed_range](values)
            if np.any(is_wrong):
                number = describe_value(values[is_wrong].flat[0])
                problem = f"{name} of the {type(self).__name__} is {number}"
                raise InputError(problem, mend=f"Give numbers that are {allowed_range}")

    def _check_shape(self, name: str, layout: str, sizes: dict[str, Any]) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the field ``name`` does not hold
        numbers, or has another shape than its ``layout`` in ``_shapes``.

        ``sizes`` holds the sizes that letters of layouts stand for, and takes those of new letters.
        """
        value = getattr(self, name)
        if value is None and layout.endswith("?"):
            return
        if isinstance(value, tuple):  # of numbers or objects, which restore has checked
            shape: tuple[int, ...] = (len(value),)
        else:
            shape = np.shape(value)
            if np.asarray(value).dtype.kind not in _NUMBER_KINDS:
                raise InputError(f"{name} of the {type(self).__name__} does not hold numbers")
        layouts = layout.rstrip("?").split("|")
        if not any(_fits(words.split(), shape, sizes) for words in layouts):
            known_sizes = ", ".join(f"{letter} = {size}" for letter, size in sizes.items())
            allowed = ") or (".join(layouts)
            problem = (
                f"{name} of the {type(self).__name__} has the shape {shape} instead of ({allowed})"
            )
            raise InputError(problem, known_sizes and f"The other fields have {known_sizes}")

    def _require_finite(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if an array among ``_shapes`` holds an
        infinity or a nan.
        """
        for name in self._shapes:
            value = getattr(self, name)
            if isinstance(value, np.ndarray) and not np.all(np.isfinite(value)):
                raise InputError(
                    f"{name} of the {type(self).__name__} holds values that are not finite"
                    f" (nan or infinite)"
                )


def _require_digest(entries: Mapping[str, Any], subject: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the ``entries`` of plain data, which the
    message calls ``subject``, have a digest that is not that of the other entries.
    """
    if "digest" not in entries:
        return
    others = {name: value for name, value in entries.items() if name != "digest"}
    if plain(entries["digest"]) != digest(plain(others)):
        raise damage_error(subject, "under 'digest'")


def _fits(layout: list[str], shape: tuple[int, ...], sizes: dict[str, Any]) -> bool:
    """Whether a shape fits the words of ``layout``, as :func:`held` describes them. ``sizes`` holds
    the sizes that letters stand for, and takes those of new letters if the shape fits.
    """
    tried_sizes = dict(sizes)
    words = layout
    axes = shape
    if layout[:1] == ["..."]:
        words = layout[1:]
        n_load_axes = max(len(shape) - len(words), 0)
        load_shape = shape[:n_load_axes]
        axes = shape[n_load_axes:]
        if tried_sizes.setdefault("...", load_shape) != load_shape:
            return False
    if len(words) != len(axes):
        return False
    for word, size in zip(words, axes, strict=True):
        if word.isdigit():
            required_size = int(word)
        else:
            letter, _, digits = word.partition("+")
            margin = int(digits or 0)
            if size < margin:
                return False
            required_size = tried_sizes.setdefault(letter, size - margin) + margin
        if size != required_size:
            return False
    sizes.update(tried_sizes)
    return True


def _are_equal(value: Any, other: Any) -> bool:
    """Whether two values of a field are equal, entry by entry. A list equals a tuple of the same
    entries; so does an array, if none of them is nan. Otherwise nan, which stands for "not known",
    equals nan.
    """
    if isinstance(value, np.ndarray) or isinstance(other, np.ndarray):
        # NumPy cannot look for nan in arrays of other kinds
        may_hold_nan = all(
            isinstance(array, np.ndarray) and array.dtype.kind in "fc" for array in (value, other)
        )
        return bool(np.array_equal(value, other, equal_nan=may_hold_nan))
    if isinstance(value, list | tuple) and isinstance(other, list | tuple):
        return len(value) == len(other) and all(map(_are_equal, value, other))
    if isinstance(value, Mapping) and isinstance(other, Mapping):
        return value.keys() == other.keys() and all(
            _are_equal(value[name], other[name]) for name in value
        )
    if isinstance(value, float | complex) and isinstance(other, float | complex):
        return value == other or (cmath.isnan(value) and cmath.isnan(other))
    if _is_object_of_dataclass(value) and type(value) is type(other):
        # objects that hold arrays may differ from their own copies, or refuse to be compared:
        # their plain data decide then
        with suppress(ValueError):
            if value == other:
                return True
        return _are_equal(plain(value), plain(other))
    return bool(value == other)


def _is_object_of_dataclass(value: Any) -> bool:
    """Whether a value is an object of a dataclass: the class itself is none."""
    return is_dataclass(value) and not isinstance(value, type)


def plain(value: Any) -> Any:
    """Return a value as plain data: an object of a dataclass becomes a mapping of its class name
    and fields, an array a list, a complex array a mapping of its "real" and "imag" lists. An empty
    array of several axes, whose lists would not tell its shape, becomes a mapping of its "shape".

    A scalar of NumPy becomes one of Python. Lists, tuples and mappings become lists and mappings of
    plain data. Values of other kinds are returned as they are.
    """
    if type(value) in _SCALARS:
        return value
    if _is_object_of_dataclass(value):
        values_of_fields = {f.name: plain(getattr(value, f.name)) for f in fields(value)}
        return {"class": type(value).__name__, **values_of_fields}
    if isinstance(value, np.ndarray):
        if np.iscomplexobj(value):
            return {"real": plain(value.real), "imag": plain(value.imag)}
        return value.tolist() if value.size or value.ndim < 2 else {"shape": list(value.shape)}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, Mapping):
        return {name: plain(entry) for name, entry in value.items()}
    return value


def restore(value: Any, kind: Any, name: str = "the data") -> Any:
    """Build an object of a ``kind`` from plain data, the ``value``.

    A ``kind`` is one of these:

    - a dataclass, whose objects are mappings in plain data;
    - a scalar type: str, float, int, bool or NoneType; whole numbers become floats for float;
    - a NumPy dtype, for an array of such entries;
    - a tuple of kinds, for a tuple whose entries have these kinds in turn, or a tuple of one kind
      and ``...``, for a tuple of any length;
    - a list or a union of kinds, for an object of the class among them that the data name, or else
      of the first of them that takes the data;
    - Any, for a scalar or an array;
    - object, for a scalar, or a list of such objects, which becomes a tuple;
    - a function without arguments that returns a kind, for a class that is defined later.

    An object that is of the dataclass ``kind`` already is returned as it is. Raises
    :class:`~granphon.base.errors.InputError` if the data are of another kind, which calls the value
    ``name``, or if an object of a dataclass cannot be made from its fields.
    """
    if isinstance(kind, FunctionType):
        kind = kind()
    if isinstance(kind, UnionType):
        kind = list(kind.__args__)
    if isinstance(kind, list):
        return _restore_one_of(value, kind, name)
    if isinstance(kind, np.dtype):
        return _restore_array(value, kind, name)
    if isinstance(kind, tuple):
        return _restore_tuple(value, kind, name)
    if is_dataclass(kind):
        return _restore_object(value, kind, name)
    if kind is Any and isinstance(value, list | tuple | Mapping | np.ndarray):
        return _restore_array(value, None, name)
    if kind is object and isinstance(value, list | tuple):
        return tuple(restore(entry, object, name) for entry in value)
    return _restore_scalar(value, kind, name)


def _make_kind_error(name: str, value: Any, needed: str) -> InputError:
    """Return the error of a ``value``, called ``name``, that is of another kind than what is
    ``needed``, in words.
    """
    return InputError(f"{name}: found {_name_kind(value)} where {needed} is needed")


def _restore_array(value: Any, dtype: np.dtype[Any] | None, name: str) -> np.ndarray[Any, Any]:
    """Return the array that :func:`_make_array` makes of a ``value``, called ``name``; InputError
    if it makes none.
    """
    array = _make_array(value, dtype)
    if array is None:
        entries = "numbers" if dtype is None else _KIND_WORDS[dtype.kind]
        raise _make_kind_error(name, value, f"an array of {entries}")
    return array


def _restore_tuple(value: Any, kinds: tuple[Any, ...], name: str) -> tuple[Any, ...]:
    """Return the list ``value``, called ``name``, as a tuple. Each entry is restored by the kind at
    its place in ``kinds``, or all by the first kind if ``...`` follows it. InputError for what is
    no list, and for a list that has not one entry for each kind.
    """
    if not isinstance(value, list | tuple):
        raise _make_kind_error(name, value, "a list")
    kinds_of_entries = (kinds[0],) * len(value) if kinds[1:] == (...,) else kinds
    if len(kinds_of_entries) != len(value):
        needed = f"a list of {counted(len(kinds), 'entry', 'entries')}"
        raise _make_kind_error(name, value, needed)
    pairs = zip(value, kinds_of_entries, strict=True)
    return tuple(restore(entry, kind, name) for entry, kind in pairs)


def _restore_scalar(value: Any, kind: Any, name: str) -> Any:
    """Return the scalar ``value``, called ``name``: a float for the ``kind`` float, and as it is
    for others; InputError if it is none of the ``kind``, or too large for a float.
    """
    if _is_scalar_of(value, kind):
        # for float, a whole number that is too large is no float
        with suppress(OverflowError):
            return float(value) if kind is float else value
    needed = {Any: "a scalar or an array", object: "a scalar or a list", NoneType: "nothing"}
    raise _make_kind_error(name, value, needed.get(kind) or kind.__name__)


def _is_scalar_of(value: Any, kind: Any) -> bool:
    """Whether a value is a scalar of a ``kind``: one of ``_SCALARS``, or Any or object for all of
    these and for scalars of NumPy; false for any other ``kind``. A whole number is a float too, and
    a truth value no number.
    """
    if kind in (Any, object):
        return isinstance(value, (*_SCALARS, np.generic))
    if isinstance(value, bool):  # which isinstance takes for a whole number
        return kind is bool
    if kind not in _SCALARS:
        return False
    return isinstance(value, float | int if kind is float else kind)


def _restore_one_of(value: Any, kinds: list[Any], name: str) -> Any:
    """Build an object of the first of the ``kinds`` that takes the plain data ``value``. If none
    does, the InputError of the last is raised, which calls the value ``name``. Data that name a
    class among the ``kinds`` are taken by that class alone.
    """
    candidates = kinds
    if isinstance(value, Mapping):
        # the error of this class says more than those of the others
        class_name = _read_class_name(value)
        namesakes = [kind for kind in kinds if getattr(kind, "__name__", None) == class_name]
        candidates = namesakes or kinds
    for kind in candidates[:-1]:
        with suppress(InputError):
            return restore(value, kind, name)
    return restore(value, candidates[-1], name)


def _restore_object(value: Any, kind: Any, name: str) -> Any:
    """Return the object of the dataclass ``kind`` that the plain data ``value``, called ``name``,
    describe, or ``value`` itself if it is such an object; InputError if the value is neither, or if
    no object can be made from the data.
    """
    if isinstance(value, kind):
        return value
    if not isinstance(value, Mapping) or _read_class_name(value) != kind.__name__:
        raise _make_kind_error(name, value, kind.__name__)
    # a result in the field of another one is stored without these keys: it has no schema, units and
    # digest of its own, which from_dict would check
    is_from_to_dict = any(key in value for key in _ABOUT)
    if is_from_to_dict and issubclass(kind, Result):
        return kind.from_dict(value)
    return _build_object(value, kind)


def _build_object(data: Mapping[str, Any], kind: Any) -> Any:
    """Return the object of the dataclass ``kind`` with the fields in ``data``, a mapping of the
    class name and each field; InputError if no such object can be made.
    """
    names = [f.name for f in fields(kind)]
    subject = f"the {kind.__name__} data"
    missing = [name for name in names if name not in data]
    if missing:
        raise InputError(f"{subject} lack {', '.join(missing)}")
    unknown = [show(name) for name in data if name not in (*names, "class")]
    if unknown:
        raise InputError(f"{subject} have {list_names(unknown)}, which the class does not have")
    values = {
        f.name: restore(data[f.name], f.metadata.get("kind", object), f"{kind.__name__}.{f.name}")
        for f in fields(kind)
    }
    try:
        if not issubclass(kind, Result):
            return kind(**values)
        result = kind._of_fields(*values.values())
        result._check()
        return result
    except InputError:
        raise
    except GranphonError as error:
        why = str(error)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        why = f"{type(error).__name__}: {error}"
    raise InputError(f"no {kind.__name__} can be made from {subject}", why)


def _name_kind(value: Any) -> str:
    """Return the kind of plain data in words for a message, and the value itself unless it is a
    list, a mapping or None.
    """
    if isinstance(value, Mapping):
        return f"data of a {show(value['class'])}" if "class" in value else "a mapping"
    if value is None:
        return "nothing"
    name = type(value).__name__
    kind = f"an {name}" if name[0] in "aeiou" else f"a {name}"
    return kind if isinstance(value, list | tuple) else f"{kind}, {show(value)},"


def _read_class_name(data: Mapping[str, Any]) -> str:
    """Return the class name in plain data; "" if there is none, or if the name is no text."""
    name = data.get("class")
    return name if isinstance(name, str) else ""


def _make_array(value: Any, dtype: np.dtype[Any] | None) -> np.ndarray[Any, Any] | None:
    """Return a ``value`` of plain data as an array of ``dtype``, or of the type of its entries if
    ``dtype`` is None.

    The value is an array; lists of any depth; {"shape": ...} of an empty array; or {"real": ...,
    "imag": ...}. Any other value gives None. So do ragged lists, entries of another kind than
    ``dtype``, truth values among numbers, and whole numbers that ``dtype``, or without one a float,
    cannot hold. A list with a whole number beyond 64 bits becomes an array of floats.
    """
    if isinstance(value, Mapping) and set(value) == {"shape"}:
        return _make_empty_array(value["shape"], dtype)
    may_be_complex = dtype is None or dtype.kind == "c"
    if may_be_complex and isinstance(value, Mapping):
        return _make_complex_array(value)
    if not isinstance(value, list | tuple | np.ndarray):
        return None
    array = value if isinstance(value, np.ndarray) else _make_array_of_lists(value)
    if array is None:
        return None
    allowed_kinds = "biufc" if dtype is None else _KINDS[dtype.kind]
    if array.size and array.dtype.kind not in allowed_kinds:
        return None
    if dtype is None or array.dtype == dtype:
        return array
    converted = array.astype(dtype)
    is_wrapped = dtype.kind == "i" and np.any(converted != array)
    return None if is_wrapped else converted


def _make_array_of_lists(lists: Sequence[Any]) -> np.ndarray[Any, Any] | None:
    """Return lists of any depth as an array of the type that NumPy finds for the entries, or of
    floats if there is a whole number beyond 64 bits; None for ragged lists, for truth values among
    numbers, and for a whole number that is too large for a float.
    """
    try:
        array = np.asarray(lists)
        if array.dtype.kind == "b":
            return array
        # NumPy would make numbers of truth values that stand among numbers
        entries = np.asarray(lists, object).ravel()
        if any(isinstance(entry, bool) for entry in entries):
            return None
        # NumPy keeps whole numbers of more than 64 bits as objects
        holds_large_numbers = array.dtype.kind == "O" and all(
            isinstance(entry, int | float) for entry in entries
        )
        return array.astype(float) if holds_large_numbers else array
    except (ValueError, OverflowError):  # the lists are ragged, or a number is too large
        return None


def _make_empty_array(shape: Any, dtype: np.dtype[Any] | None) -> np.ndarray[Any, Any] | None:
    """Return the empty array of a ``shape`` and ``dtype``, float if that is None; None if the
    ``shape`` is no list of lengths, or not that of an empty array that NumPy can make.
    """
    is_shape = isinstance(shape, list | tuple) and all(
        type(length) is int and 0 <= length < _MOST_OF_EMPTY for length in shape
    )
    if not is_shape or 0 not in shape or math.prod(filter(None, shape)) >= _MOST_OF_EMPTY:
        return None
    with suppress(ValueError):  # more axes than NumPy has
        return np.zeros(shape, dtype or float)
    return None


def _make_complex_array(data: Mapping[str, Any]) -> np.ndarray[Any, Any] | None:
    """Return the complex array of the lists "real" and "imag" of a mapping; None if the mapping has
    other keys, or if its two lists are no arrays of real numbers of one shape.
    """
    if len(data) != 2:
        return None
    real = _make_array(data.get("real"), np.dtype(float))
    imaginary = _make_array(data.get("imag"), np.dtype(float))
    if real is None or imaginary is None or real.shape != imaginary.shape:
        return None
    # not real + 1j * imaginary: infinite imaginary parts would make real parts nan, and -0 become 0
    array = np.empty(real.shape, complex)
    array.real = real
    array.imag = imaginary
    return array
