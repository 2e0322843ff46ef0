"""Short tables for notebooks: what ``_repr_html_`` of results, scenes, lattices and packings returns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import is_dataclass
from html import escape
from typing import Any

import numpy as np

from granphon.base.errors import brief

#: most letters of a value, and most entries of an array or a tuple that are all written out
_MOST_LETTERS, _MOST_ENTRIES = 160, 6
#: least over the largest end of a range, below which it is rounding
_ROUNDING = 1e-14


def write_html(title: str, rows: Iterable[tuple[str, Any, str]]) -> str:
    """Return an HTML table of rows of a name, a value and its SI unit, headed by ``title``; every text is escaped.

    A value is described by :func:`describe_value`. The unit "1", of a number without a unit, is left blank.
    """
    cells = ((name, describe_value(value), "" if unit == "1" else unit) for name, value, unit in rows)
    body = "".join(
        f"<tr><th>{_clean(name)}</th><td>{_clean(value)}</td><td>{_clean(unit)}</td></tr>" for name, value, unit in cells
    )
    head = "<tr><th>name</th><th>value</th><th>unit</th></tr>"
    return f"<table><caption>{_clean(title)}</caption><thead>{head}</thead><tbody>{body}</tbody></table>"


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
        if len(value) > _MOST_ENTRIES and all(isinstance(one, int | float) for one in value):
            return _describe_array(np.asarray(value))
        if len(value) > 1 and all(is_dataclass(one) for one in value):
            return f"{len(value)} of {type(value[0]).__name__}"
        words = [describe_value(one) for one in value[:_MOST_ENTRIES]]
        more = f", ... ({len(value)} in all)" if len(value) > _MOST_ENTRIES else ""
        return ("; " if any(", " in word for word in words) else ", ").join(words) + more or "none"
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {describe_value(one)}" for name, one in list(value.items())[:_MOST_ENTRIES])
    if is_dataclass(value):
        name = getattr(value, "name", None)
        return name.replace("_", " ") if isinstance(name, str) else type(value).__name__
    return brief(value, _MOST_LETTERS)


def _describe_array(values: np.ndarray[Any, Any]) -> str:
    """Return the entries of a small array in a row, else the shape, and the least and the greatest entry."""
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
    left = f", {size.size - finite.size} not finite" if finite.size < size.size else ""
    if not finite.size:
        return f"array {shape}{left}"
    ends = np.array([finite.min(), finite.max()])
    if kind == "f":  # an end that is rounding of the other is zero
        ends[np.abs(ends) < _ROUNDING * np.max(np.abs(ends))] = 0.0
    low, high = (describe_value(end) for end in ends.tolist())
    what = "magnitudes " if kind == "c" else ""
    return f"array {shape}, {what}{low} to {high}{left}" if low != high else f"array {shape}, all {what}{low}{left}"
