"""What every result has in common: frozen, its arrays read-only, and convertible to plain data and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, ClassVar, Self, get_args, get_origin, get_type_hints

import numpy as np

from granphon.errors import InputError, message

__all__ = ["Result", "plain", "read_only", "restore"]


def read_only(values: Any, dtype: Any = None) -> np.ndarray[Any, Any]:
    """A copy of ``values`` as an array that refuses to be written to."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """Base of the frozen result classes.

    A subclass declares its fields, ``units`` (the SI unit of each field that has one) and, when the meaning
    of a field changes, a higher ``schema``. Arrays are made read-only; scalars stay floats. Two results are equal if all
    their fields that are compared are, array by array; ``repr`` gives large arrays by their shape.
    """

    schema: ClassVar[int] = 1
    units: ClassVar[Mapping[str, str]] = {}

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.generic):
                object.__setattr__(self, field.name, value.item())
            elif isinstance(value, np.ndarray):
                if value.ndim == 0:
                    object.__setattr__(self, field.name, value.item())
                elif value.flags.writeable or value.base is not None:  # a view would show changes of what it views
                    object.__setattr__(self, field.name, read_only(value))

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self) if f.compare)
        return all(_same(a, b) for a, b in pairs)

    def __reduce__(self) -> tuple[Any, ...]:
        # made anew, so that copies and pickles are read-only too
        return type(self), tuple(getattr(self, f.name) for f in fields(self))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        values = ((f.name, getattr(self, f.name)) for f in fields(self) if f.repr)
        shown = (f"{n}=<array {v.shape}>" if isinstance(v, np.ndarray) and v.size > 8 else f"{n}={v!r}" for n, v in values)
        return f"{type(self).__name__}({', '.join(shown)})"

    def to_dict(self) -> dict[str, Any]:
        """Plain data: the class's name, its schema, the unit of each field, and the fields.

        Complex arrays become a mapping of ``real`` and ``imag`` lists; what a result holds (a packing, its scales) becomes a
        mapping of its own.
        """
        return {**plain(self), "schema": self.schema, "units": dict(self.units)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The inverse of :meth:`to_dict`.

        Raises :class:`~granphon.errors.InputError` if the data are of another class, of a newer schema, or incomplete.
        """
        if data.get("class") != cls.__name__:
            raise InputError(message(f"these data describe a {data.get('class')!r}, not a {cls.__name__!r}"))
        if data.get("schema", 0) > cls.schema:
            raise InputError(
                message(
                    f"{cls.__name__} data of schema {data['schema']} are newer than this granphon knows ({cls.schema})",
                    mend="Update granphon",
                )
            )
        restored: Self = restore(data, cls)
        return restored


def _same(a: Any, b: Any) -> bool:
    """Whether two fields are equal; in arrays a nan, what is not known, equals another."""
    if not isinstance(a, np.ndarray):
        return bool(a == b)
    nan = isinstance(b, np.ndarray) and a.dtype.kind in "fc" and b.dtype.kind in "fc"
    return bool(np.array_equal(a, b, equal_nan=nan))


def plain(value: Any) -> Any:
    """Plain data of a value: of a dataclass its class and its fields, of arrays lists; other values as they are."""
    if is_dataclass(value) and not isinstance(value, type):
        return {"class": type(value).__name__, **{f.name: plain(getattr(value, f.name)) for f in fields(value)}}
    if isinstance(value, np.ndarray):
        if np.iscomplexobj(value):
            return {"real": value.real.tolist(), "imag": value.imag.tolist()}
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple):
        return [plain(v) for v in value]
    if isinstance(value, Mapping):
        return {name: plain(v) for name, v in value.items()}
    return value


def restore(value: Any, hint: Any) -> Any:
    """Build what ``hint`` says from plain data: a dataclass, perhaps in a union, tuple or dict; else arrays and scalars."""
    if isinstance(value, Mapping):
        if get_origin(hint) is dict:
            return {name: restore(v, get_args(hint)[1]) for name, v in value.items()}
        if set(value) == {"real", "imag"}:
            return np.asarray(value["real"]) + 1j * np.asarray(value["imag"])
        for candidate in (hint, *get_args(hint)):
            if is_dataclass(candidate) and getattr(candidate, "__name__", "") == value.get("class"):
                build: Any = candidate
                hints = get_type_hints(build)
                missing = [f.name for f in fields(build) if f.name not in value]
                if missing:
                    raise InputError(message(f"the {value['class']} data lack {', '.join(missing)}"))
                return build(**{f.name: restore(value[f.name], hints[f.name]) for f in fields(build)})
        raise InputError(message(f"data of a {value.get('class')!r} stand where {hint} belongs"))
    if isinstance(value, list):
        inner = get_args(hint)
        if inner and getattr(hint, "__origin__", None) is tuple:
            return tuple(restore(v, inner[0]) for v in value)
        return np.asarray(value)
    return value
