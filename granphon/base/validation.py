"""Blocks of keys, lists and plain values, as a scene has them: the rules that know nothing of balls.

Each rule takes what stood in the file, or the value itself, and returns the value; or it raises
:class:`~granphon.base.errors.Refused`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from granphon.base.errors import InputError, Refused
from granphon.base.text import closest, shown

__all__ = ["Rule", "block", "choice", "each", "grid", "inside", "number", "ruled", "text", "truth", "unknown_key", "whole"]

Rule = Callable[[Any], Any]


def inside(key: str | int, rule: Rule, value: Any) -> Any:
    """``rule(value)`` for what stands at ``key``; a refusal says so."""
    try:
        return rule(value)
    except Refused as refused:
        raise refused.under(key) from None


def ruled(name: str, rule: Rule, value: Any) -> Any:
    """``rule(value)`` for what is given in Python: :class:`~granphon.base.errors.InputError`, which calls it ``name``."""
    try:
        return rule(value)
    except Refused as refused:
        raise InputError(f"{'.'.join(map(str, (name, *refused.path)))}: {refused}") from None


def unknown_key(key: str, known: Iterable[str], mend: str = "") -> Refused:
    """The refusal of a key that is not one of ``known``."""
    meant = closest(key, known)
    return Refused(
        "an unknown key", ", ".join(known) or "none", mend or (f"Did you mean '{meant}'?" if meant else ""), (key,)
    )


def block(value: Any, rules: Mapping[str, Rule], needed: Sequence[str] = ()) -> dict[str, Any]:
    """A block of keys, each read by its rule; those that are ``needed`` have no default."""
    allowed = f"a block of keys: {', '.join(rules) or 'none'}"
    if not isinstance(value, Mapping):
        raise Refused(shown(value), allowed)
    for key in value:
        if key not in rules:
            raise unknown_key(key, rules)
    read = {key: inside(key, rules[key], item) for key, item in value.items()}
    for key in needed:
        if key not in value:
            raise Refused("nothing, and it has no default", _allowed(rules[key]), path=(key,))
    return read


def _allowed(rule: Rule) -> str:
    """What a rule that does not take None allows, in words."""
    try:
        rule(None)
    except Refused as refused:
        return refused.allowed
    return "a value"


def each(value: Any, rule: Rule, what: str) -> tuple[Any, ...]:
    """A list of one or more values of one kind."""
    if not isinstance(value, list | tuple) or not value:
        raise Refused(shown(value) if value != [] else "an empty list", f"a list of one or more {what}")
    return tuple(inside(n, rule, one) for n, one in enumerate(value))


def choice(value: Any, options: Sequence[str]) -> str:
    """One of some words."""
    if isinstance(value, str) and value in options:
        return value
    meant = closest(value, options) if isinstance(value, str) else None
    raise Refused(shown(value), ", ".join(options), f"Did you mean {meant!r}?" if meant else "")


def text(value: Any) -> str:
    """A text that is not empty."""
    if isinstance(value, str) and value.strip() and "\0" not in value:
        return value
    raise Refused(shown(value), "a name")


def truth(value: Any) -> bool:
    """True or false, and no other word for them."""
    if isinstance(value, bool):
        return value
    word = value.strip().lower() if isinstance(value, str) else None
    meant = "true" if word in ("yes", "on", "y", "true") else "false" if word in ("no", "off", "n", "false") else ""
    raise Refused(shown(value), "true or false", f"Did you mean {meant}?" if meant else "")


def number(value: Any, low: float, high: float) -> float:
    """A plain number, without a unit, within two bounds."""
    if isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high:
        return float(value)
    mend = "Write it without quotes or unit." if isinstance(value, str) else ""
    raise Refused(shown(value), f"a plain number from {low:g} to {high:g}", mend)


def whole(value: Any, low: int, high: int) -> int:
    """A whole number within two bounds."""
    if isinstance(value, int) and not isinstance(value, bool) and low <= value <= high:
        return value
    raise Refused(shown(value), f"a whole number from {low} to {high}")


def grid(value: Any, low: int, high: int, example: str) -> tuple[int, int]:
    """Two whole numbers, from "64 64", [64, 64], (64, 64) or an array; if the ``example`` has a third, a 1 may follow."""
    count = len(example.split())
    allowed = f"two whole numbers from {low} to {high}{' and a 1' if count > 2 else ''}, such as {example}"
    words: Any = value.split() if isinstance(value, str) else value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(words, list | tuple) or not 2 <= len(words) <= count:
        raise Refused(shown(value), allowed)
    if isinstance(value, str):
        words = [int(w) if re.fullmatch(r"[0-9]{1,9}", w) else w for w in words]
    if not all(isinstance(w, int) and not isinstance(w, bool) for w in words):
        raise Refused(shown(value), allowed)
    if len(words) == 3 and words[2] != 1:
        raise Refused(f"{shown(value)}, whose third number is {words[2]}", allowed, "The packing is one layer.")
    if not all(low <= w <= high for w in words[:2]):
        raise Refused(shown(value), allowed)
    return words[0], words[1]
