"""What every result has in common: frozen, its arrays read-only, convertible to plain data, and
shown as a table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from html import escape
from inspect import get_annotations
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Self, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from granphon.base.errors import GranphonError, InputError, brief
from granphon.base.text import (
    damage_error,
    digest,
    list_names,
    require_schema,
    show,
    warn_unverified,
)

#: most letters of a value, and most entries of an array or a tuple that are all written out
_MOST_LETTERS = 160
_MOST_ENTRIES = 6
#: keys that the plain data of a result hold besides its class and its fields
_ABOUT = ("schema", "units", "digest")
#: the kinds of entries, as NumPy's letters have them, from which an array of a kind is made
_KINDS = {"b": "b", "i": "iu", "f": "iuf", "c": "c"}
#: ranges of the numbers of a field, by the words that an annotation has
_RANGES: dict[str, Callable[[Any], Any]] = {
    "finite": np.isfinite,
    "zero or above": lambda values: np.isfinite(values) & (values >= 0.0),
    "zero or above, or infinite": lambda values: values >= 0.0,
    "above zero": lambda values: np.isfinite(values) & (values > 0.0),
}
#: types of values that plain data hold as they are
_SCALARS = frozenset({str, float, int, bool, NoneType})


def write_html(title: str, rows: Iterable[tuple[str, Any, str]]) -> str:
    """Return an HTML table of rows of a name, a value and its SI unit, headed by ``title``; every
    text is escaped.

    A value is described by :func:`describe_value`. The unit "1", of a number without a unit, is
    left blank.
    """
    lines = []
    for name, value, unit in rows:
        shown = _clean(describe_value(value))
        shown_unit = "" if unit == "1" else _clean(unit)
        lines.append(f"<tr><th>{_clean(name)}</th><td>{shown}</td><td>{shown_unit}</td></tr>")
    body = "".join(lines)
    head = "<tr><th>name</th><th>value</th><th>unit</th></tr>"
    caption = f"<caption>{_clean(title)}</caption>"
    return f"<table>{caption}<thead>{head}</thead><tbody>{body}</tbody></table>"


def _clean(text: str) -> str:
    """Escape a text; what cannot be printed, which HTML may not hold, becomes a question mark."""
    return escape("".join(letter if letter.isprintable() else "?" for letter in text))


def describe_value(value: Any) -> str:
    """Return a short text of a value: a number with six digits, an array by its shape and range."""
    if isinstance(value, str):
        return value if len(value) <= _MOST_LETTERS else f"{value[: _MOST_LETTERS - 4]} ..."
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return f"{float(value):.6g}"
    if value is None:
        return "none"
    if isinstance(value, np.ndarray):
        return _describe_array(value)
    if isinstance(value, list | tuple):
        return _describe_list(value)
    if isinstance(value, Mapping):
        entries = list(value.items())[:_MOST_ENTRIES]
        return ", ".join(f"{name}: {describe_value(entry)}" for name, entry in entries)
    if is_dataclass(value):
        name = getattr(value, "name", None)
        return name.replace("_", " ") if isinstance(name, str) else type(value).__name__
    return brief(value, _MOST_LETTERS)


def _describe_list(values: Sequence[Any]) -> str:
    """Return the first entries of a list, and how many there are; of a long list of numbers what is
    returned of an array.
    """
    if not values:
        return "none"
    count = len(values)
    if count > _MOST_ENTRIES and all(isinstance(entry, int | float) for entry in values):
        return _describe_array(np.asarray(values))
    if count > 1 and all(is_dataclass(entry) for entry in values):
        return f"{count} of {type(values[0]).__name__}"
    words = [describe_value(entry) for entry in values[:_MOST_ENTRIES]]
    mark = "; " if any(", " in word for word in words) else ", "
    ending = f", ... ({count} in all)" if count > _MOST_ENTRIES else ""
    return mark.join(words) + ending or "none"


def _describe_array(values: np.ndarray[Any, Any]) -> str:
    """Return the entries of a small array in a row, else the shape, and the least and the greatest
    entry.
    """
    kind = values.dtype.kind
    if values.ndim <= 1 and 0 < values.size <= _MOST_ENTRIES and kind != "c":
        return ", ".join(describe_value(one) for one in np.ravel(values).tolist())
    shape = " x ".join(map(str, values.shape))
    if not values.size or kind not in "biufc":
        return f"array {shape}"
    if kind == "b":
        return f"array {shape}, {np.count_nonzero(values)} of them true"
    size = np.abs(values) if kind == "c" else values
    finite = size[np.isfinite(size)]
    ending = f", {size.size - finite.size} not finite" if finite.size < size.size else ""
    if not finite.size:
        return f"array {shape}{ending}"
    ends = np.array([finite.min(), finite.max()])
    if kind == "f":  # an end that is rounding of the other is zero
        ends[np.abs(ends) < 1e-14 * np.max(np.abs(ends))] = 0.0
    low = describe_value(ends[0].item())
    high = describe_value(ends[1].item())
    prefix = "magnitudes " if kind == "c" else ""
    if low == high:
        return f"array {shape}, all {prefix}{low}{ending}"
    return f"array {shape}, {prefix}{low} to {high}{ending}"


def read_only(values: Any, dtype: Any = None) -> np.ndarray[Any, Any]:
    """A copy of ``values`` as a read-only array."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """Base of the frozen result classes.

    An annotation ``Annotated[Array, "f n 3", "m/s", "finite"]`` says the shape of a field, its SI
    unit, and the range of its numbers where plain data are read, one of ``_RANGES``. What there is
    none of is left out at the end, and "" before; of a number the shape is "". They are in
    ``_shapes``, ``units`` and ``_ranges`` of the class; the units of properties are written there.
    When the meaning of a field changes, a subclass has a higher ``_schema``. ``_notebook_fields``
    names properties, quick to find, that a notebook shows after the fields. Arrays are made
    read-only; scalars stay floats. Two results are equal if all their compared fields are equal,
    array by array; ``repr`` shows a large array by its shape. ``class Spectrum(Result,
    array="values")`` has a field that ``np.asarray`` of it is.

    A shape is a text of sizes parted by spaces: a number; a letter, which means the same size in
    all shapes of the class; or a letter plus a number, "s+1". "..." at the beginning stands for the
    shape of the load, "|" parts layouts that are both allowed, and "?" at the end marks a field
    that may be None.
    """

    _schema: ClassVar[int] = 1
    units: ClassVar[dict[str, str]] = {}
    _shapes: ClassVar[dict[str, str]] = {}
    _ranges: ClassVar[dict[str, str]] = {}
    _notebook_fields: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, array: str = "", **options: Any) -> None:
        super().__init_subclass__(**options)
        shapes = {}
        units = {}
        ranges = {}
        for name, hint in get_annotations(cls, eval_str=True).items():
            words = [word for word in _list_remarks(hint) if isinstance(word, str)]
            shape, unit, within = (*words, "", "", "")[:3]  # words may be left out at the end
            if shape:
                shapes[name] = shape
            if unit:
                units[name] = unit
            if within:
                ranges[name] = within
        cls._shapes = cls._shapes | shapes
        cls.units = cls.units | units
        cls._ranges = cls._ranges | ranges
        if array:

            def make_array(self: Result, dtype: Any = None, copy: Any = None) -> Any:
                return np.array(getattr(self, array), dtype)

            cls.__array__ = make_array  # type: ignore[attr-defined]

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if type(value) in _SCALARS or type(value) is tuple:
                # most values, which are kept as they are
                continue
            has_one_number = isinstance(value, np.ndarray) and value.ndim == 0
            if isinstance(value, np.generic) or has_one_number:
                object.__setattr__(self, name, value.item())
            elif isinstance(value, np.ndarray):
                # a view would change with the array behind it; what stays in a file is read as it
                # is used
                is_view = value.base is not None and not isinstance(value, np.memmap)
                if value.flags.writeable or is_view:
                    object.__setattr__(self, name, read_only(value))

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        names = [f.name for f in fields(self) if f.compare]
        return all(_are_equal(getattr(self, name), getattr(other, name)) for name in names)

    def __reduce__(self) -> tuple[Any, ...]:
        # built by the constructor, so that the arrays of copies and pickles are read-only too
        return self._of_fields, tuple(getattr(self, f.name) for f in fields(self))

    @classmethod
    def _of_fields(cls, *values: Any) -> Self:
        """Build a result from its fields; a class whose constructor takes other arguments has its
        own.
        """
        return cls(*values)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        parts = []
        for name, value, unit in self._list_values():
            text = describe_value(value)
            text = f"[{text}]" if ", " in text else text
            parts.append(f"{name}={text}" if unit in ("", "1") else f"{name}={text} {unit}")
        return f"{type(self).__name__}({', '.join(parts)})"

    def _repr_html_(self) -> str:
        return write_html(type(self).__name__, self._list_values())

    def _list_values(self) -> list[tuple[str, Any, str]]:
        """Name, value and unit of what is shown of a result: no field that is None or empty."""
        units = self._field_units()
        rows = []
        for name in (*(f.name for f in fields(self) if f.repr), *self._notebook_fields):
            with suppress(GranphonError):
                # a property that this result does not have, such as the pressure of some lattices
                value = getattr(self, name)
                if value is not None and not (isinstance(value, tuple) and not value):
                    rows.append((name, value, units.get(name, "")))
        return rows

    def to_dict(self) -> dict[str, Any]:
        """The result as plain data: class name, schema, the unit of each field, the fields, and a
        digest of all these.

        Complex arrays become a mapping of ``real`` and ``imag`` lists; objects in fields (a
        packing, its scales) become mappings of their own. The digest stays valid through JSON and
        YAML.
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
        given: dict[str, Any] = {}
        if isinstance(cast("object", data), Mapping):
            given = dict(data)
        if _read_class_name(given) != cls.__name__:
            raise InputError(
                f"these data describe a {show(given.get('class'))}, not a {cls.__name__!r}"
            )
        require_schema(
            f"a {cls.__name__} in plain data", given.get("schema", cls._schema), cls._schema
        )
        try:
            content = {name: value for name, value in given.items() if name not in _ABOUT}
            restored: Self = restore(content, cls)
            # after the other checks, whose errors say more
            if "digest" in given and plain(given.pop("digest")) != digest(plain(given)):
                raise damage_error(f"a {cls.__name__} in plain data", "under 'digest'")
            # an array as a unit becomes a list, which is refused
            units = plain(given.get("units", restored._field_units()))
        except RecursionError:
            raise InputError(
                f"the {cls.__name__} data are nested too deeply, or contain themselves"
            ) from None
        if units != restored._field_units():
            mend = "Use the units that to_dict gives: other units are not converted"
            raise InputError(
                f"the units of the {cls.__name__} data are not those of the class", mend=mend
            )
        if "digest" not in data:
            warn_unverified(f"a {cls.__name__} in plain data")
        return restored

    def _field_units(self) -> dict[str, str]:
        """The SI unit of each field that has one, as :meth:`to_dict` gives them."""
        return dict(self.units)

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if fields in ``_shapes`` are not numbers
        or their shapes disagree.

        Called for results that were read; those that granphon computes pass by construction.
        """
        sizes: dict[str, Any] = {}
        for name, layout in self._shapes.items():
            value = getattr(self, name)
            if value is None and layout.endswith("?"):
                continue
            shape = (len(value),) if isinstance(value, tuple) else np.shape(value)
            if not isinstance(value, tuple) and np.asarray(value).dtype.kind not in "iufc":
                raise InputError(f"{name} of the {type(self).__name__} does not hold numbers")
            layouts = layout.rstrip("?").split("|")
            if not any(_fits(words.split(), shape, sizes) for words in layouts):
                so_far = ", ".join(f"{letter} = {size}" for letter, size in sizes.items())
                allowed = layout.replace("|", ") or (")
                problem = (
                    f"{name} of the {type(self).__name__} has the shape {shape} instead of"
                    f" ({allowed})"
                )
                raise InputError(problem, so_far and f"The other fields have {so_far}")
        for name, within in self._ranges.items():
            values = np.asarray(getattr(self, name))
            if values.dtype.kind not in "iufc":
                continue
            is_wrong = ~_RANGES[within](values)
            if np.any(is_wrong):
                number = describe_value(values[is_wrong].flat[0])
                problem = f"{name} of the {type(self).__name__} is {number}"
                raise InputError(problem, mend=f"Give numbers that are {within}")

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


def _fits(layout: list[str], shape: tuple[int, ...], sizes: dict[str, Any]) -> bool:
    """Whether a shape fits the words of ``layout``; ``sizes`` collects the sizes that the letters
    stand for.
    """
    if layout[:1] == ["..."]:
        layout = layout[1:]
        head = shape[: max(len(shape) - len(layout), 0)]
        shape = shape[len(head) :]
        if sizes.setdefault("...", head) != head:
            return False
    if len(layout) != len(shape):
        return False
    for word, size in zip(layout, shape, strict=True):
        if word.isdigit():
            length = int(word)
        else:
            letter, _, digits = word.partition("+")
            margin = int(digits or 0)
            length = sizes.setdefault(letter, size - margin) + margin
        if size != length:
            return False
    return True


def _are_equal(value: Any, other: Any) -> bool:
    """Whether two values of a field are equal, array by array; nan, which stands for "not known",
    equals nan.
    """
    if not isinstance(value, np.ndarray) and not isinstance(other, np.ndarray):
        # objects that hold arrays are compared by what they hold
        return not (value != other and plain(value) != plain(other))
    may_be_nan = all(
        isinstance(array, np.ndarray) and array.dtype.kind in "fc" for array in (value, other)
    )
    return bool(np.array_equal(value, other, equal_nan=may_be_nan))


def plain(value: Any) -> Any:
    """A value as plain data: a dataclass becomes a mapping of its class and fields, an array a
    list.

    Values of other kinds are returned as they are.
    """
    if type(value) in _SCALARS:
        return value
    if is_dataclass(value) and not isinstance(value, type):
        return {
            "class": type(value).__name__,
            **{f.name: plain(getattr(value, f.name)) for f in fields(value)},
        }
    if isinstance(value, np.ndarray):
        if np.iscomplexobj(value):
            return {"real": value.real.tolist(), "imag": value.imag.tolist()}
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, Mapping):
        return {name: plain(v) for name, v in value.items()}
    return value


def _list_remarks(hint: Any) -> tuple[Any, ...]:
    """What an annotation says beside the type: the kind of the entries of an array, the shape and
    the unit of a field.
    """
    return get_args(hint)[1:] if get_origin(hint) is Annotated else ()


def restore(value: Any, hint: Any, name: str = "the data") -> Any:
    """Build an object of the type ``hint`` from plain data.

    The type is a dataclass, tuple, mapping, scalar or array of :mod:`granphon.base.arrays`, or a
    union of these; Any is a scalar, or an array. Raises :class:`~granphon.base.errors.InputError`,
    which calls the value ``name``, if the data are of another kind.
    """
    remarks = _list_remarks(hint)
    hint = get_args(hint)[0] if remarks else hint
    dtype = next((remark for remark in remarks if isinstance(remark, np.dtype)), None)
    origin = get_origin(hint)
    inner = get_args(hint)
    expected = str(hint) if inner else getattr(hint, "__name__", str(hint))
    if origin in (Union, UnionType):
        return _restore_union(value, inner, name)
    may_be_array = hint is Any and isinstance(value, Mapping | list | tuple | np.ndarray)
    if dtype is not None or may_be_array:
        expected = "an array of numbers"
        array = _make_array(value, dtype)
        if array is not None:
            return array
    elif origin is tuple and isinstance(value, list | tuple):
        kinds = [inner[0]] * len(value) if inner[1:] == (...,) else inner
        if len(kinds) == len(value):
            return tuple(restore(v, kind, name) for v, kind in zip(value, kinds, strict=True))
    elif origin is dict and isinstance(value, Mapping):
        return {
            restore(key, inner[0], name): restore(v, inner[1], f"{name}.{key}")
            for key, v in value.items()
        }
    elif is_dataclass(hint):
        if isinstance(value, hint):  # type: ignore[arg-type]  # a class
            return value
        if isinstance(value, Mapping) and _read_class_name(value) == expected:
            return _restore_object(value, hint)
    elif hint is Any or hint in _SCALARS:
        # a whole number is a float too, and a truth value is no number
        allowed = {Any: (*_SCALARS, np.generic), float: (float, int)}.get(hint, (hint,))
        if isinstance(value, allowed) and (not isinstance(value, bool) or bool in allowed):
            return value
    raise InputError(f"{name}: found {_name_kind(value)} where {expected} is needed")


def _restore_union(value: Any, hints: tuple[Any, ...], name: str) -> Any:
    """Build an object of the first of the types ``hints`` that takes plain data."""
    if isinstance(value, Mapping):
        # if the value names a class among the types, it must be that one
        class_name = _read_class_name(value)
        named = tuple(hint for hint in hints if getattr(hint, "__name__", None) == class_name)
        hints = named or hints
    for hint in hints[:-1]:
        with suppress(InputError):
            return restore(value, hint, name)
    return restore(value, hints[-1], name)


def _restore_object(data: Mapping[str, Any], kind: Any) -> Any:
    """Build an object of the dataclass ``kind`` from the mapping of its fields."""
    if issubclass(kind, Result) and not set(_ABOUT).isdisjoint(data):
        return kind.from_dict(data)  # a field written by its own to_dict
    names = [f.name for f in fields(kind)]
    problem = f"the {kind.__name__} data"
    hints = get_type_hints(kind, include_extras=True)
    missing = [name for name in names if name not in data]
    if missing:
        raise InputError(f"{problem} lack {', '.join(missing)}")
    unknown = [show(name) for name in data if name not in (*names, "class")]
    if unknown:
        raise InputError(f"{problem} have {list_names(unknown)}, which the class does not have")
    values = {name: restore(data[name], hints[name], f"{kind.__name__}.{name}") for name in names}
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
    raise InputError(f"no {kind.__name__} can be made from {problem}", why)


def _name_kind(value: Any) -> str:
    """Return what plain data are, in words for a message."""
    if isinstance(value, Mapping):
        return f"data of a {show(value.get('class'))}" if "class" in value else "a mapping"
    kind = f"a {type(value).__name__}"
    return kind if isinstance(value, list | tuple) else f"{kind}, {show(value)},"


def _read_class_name(data: Mapping[str, Any]) -> str:
    """The class name in plain data; "" if there is none, or if it is not a text."""
    name = data.get("class")
    return name if isinstance(name, str) else ""


def _make_array(value: Any, dtype: np.dtype[Any] | None) -> np.ndarray[Any, Any] | None:
    """Return plain data as an array of a type, or of any with None; None if they are ragged, or no
    such numbers.
    """
    if (dtype is None or dtype.kind == "c") and isinstance(value, Mapping):
        return _make_complex_array(value)
    if not isinstance(value, list | tuple | np.ndarray):
        return None
    try:
        array = np.asarray(value)
        if not isinstance(value, np.ndarray) and array.dtype.kind != "b":
            # NumPy takes truth values among numbers for numbers
            entries = np.asarray(value, object).ravel()
            if any(isinstance(entry, bool) for entry in entries):
                return None
    except (ValueError, OverflowError):  # ragged, or too large
        return None
    kinds = "biufc" if dtype is None else _KINDS[dtype.kind]
    if array.size and array.dtype.kind not in kinds:
        return None
    return array if dtype is None or array.dtype == dtype else array.astype(dtype)


def _make_complex_array(data: Mapping[str, Any]) -> np.ndarray[Any, Any] | None:
    """Return the complex array of a mapping of its real and imaginary numbers; None if it has other
    keys, or the two are no such arrays of one shape.
    """
    real = _make_array(data.get("real"), np.dtype(float))
    imaginary = _make_array(data.get("imag"), np.dtype(float))
    if len(data) != 2 or real is None or imaginary is None or real.shape != imaginary.shape:
        return None
    array = np.empty(real.shape, complex)
    array.real = real
    array.imag = imaginary
    return array
