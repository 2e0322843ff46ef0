"""Rules: functions that check a value of any kind and return it in its proper type.

Scenes, command lines and Python calls are checked by the same rules. A rule raises
:class:`~granphon.base.errors.Refused`, which says what was found, what is allowed, and what was
probably meant; :func:`require` adds the name of an argument, and the reader of scenes the place of
a key. The checks of arguments, such as :data:`positive`, take the name of an argument, its value
and the options of a rule. They return the value as a plain number, array or tuple, or raise
:class:`~granphon.base.errors.InputError`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence
from decimal import Decimal
from numbers import Real
from typing import Any, Concatenate, Literal, ParamSpec, TypeVar
from unicodedata import normalize

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import InputError, Refused, brief
from granphon.base.quantities import NUMBER, is_si
from granphon.base.text import closest, show

Rule = Callable[[Any], Any]
Value = TypeVar("Value")
Options = ParamSpec("Options")
#: bound of numbers from below; empty for any sign
Low = Literal["", "above zero", "zero or above"]
#: highest frequency, Hz, far above that of any contact: its powers stay within the range of floats
HIGHEST_FREQUENCY = 1e30
#: the deepest nesting of lists: NumPy's arrays have no more dimensions
_DEEPEST = 64


def read_inside(key: str | int, rule: Rule, value: Any) -> Any:
    """Read the value at ``key`` by its rule; if it is refused, put the key into the path of the
    refusal.
    """
    try:
        return rule(value)
    except Refused as refused:
        raise refused.under(key) from None


def require(name: str, rule: Rule, value: Any) -> Any:
    """Read an argument of a Python call by a rule; raise :class:`~granphon.base.errors.InputError`
    with its ``name``.
    """
    try:
        return rule(value)
    except Refused as refused:
        raise InputError(f"{'.'.join(map(str, (name, *refused.path)))}: {refused}") from None


def refuse_unknown_key(key: str, known: Iterable[str], mend: str = "") -> Refused:
    """The refusal of a key that is not one of ``known``."""
    guess = closest(key, known)
    if guess and not mend:
        mend = f"Did you mean '{guess}'?"
    return Refused("an unknown key", ", ".join(known) or "none", mend, (key,))


def block(value: Any, rules: Mapping[str, Rule], needed: Sequence[str] = ()) -> dict[str, Any]:
    """Read a block of keys, each value by the rule of its key; the keys in ``needed`` must be
    given.
    """
    allowed = f"a block of keys: {', '.join(rules) or 'none'}"
    if not isinstance(value, Mapping):
        raise Refused(show(value), allowed)
    for key in value:
        if key not in rules:
            raise refuse_unknown_key(key, rules)
    read = {key: read_inside(key, rules[key], item) for key, item in value.items()}
    for key in needed:
        if key not in value:
            allowed = _describe_allowed(rules[key])
            raise Refused("nothing, and it has no default", allowed, path=(key,))
    return read


def _describe_allowed(rule: Rule) -> str:
    """Return what a rule allows, in words: the rule refuses None, and says so."""
    try:
        rule(None)
    except Refused as refused:
        return refused.allowed
    return "a value"


def each(value: Any, rule: Rule, what: str) -> tuple[Any, ...]:
    """Read a list of one or more values, each by the same ``rule``; ``what`` is their name in
    messages.
    """
    if not isinstance(value, list | tuple) or not value:
        content = "an empty list" if value == [] else show(value)
        raise Refused(content, f"a list of one or more {what}")
    return tuple(read_inside(n, rule, item) for n, item in enumerate(value))


def is_one_of(value: object, options: Container[str]) -> bool:
    """Whether a value is text, and one of ``options``: what cannot be hashed or compared is not."""
    return isinstance(value, str) and value in options


def choice(value: Any, options: Collection[str]) -> str:
    """Read a word that must be one of the ``options``; those of a registry say which plug-ins have
    failed.
    """
    if is_one_of(value, options):
        return str(value)
    tips = []
    failures = getattr(options, "failures", "")
    if failures:
        tips.append(failures)
    guess = closest(value, options) if isinstance(value, str) else None
    if guess:
        tips.append(f"Did you mean {guess!r}?")
    raise Refused(show(value), ", ".join(options), ". ".join(tips))


def text(value: Any) -> str:
    """A text that is not blank and has no null character."""
    if isinstance(value, str) and value.strip() and "\0" not in value:
        return value
    raise Refused(show(value), "a name")


def label(value: Any) -> str:
    """A name that stands in tables: printable, without letters that have no width, and no formula
    to a spreadsheet.
    """
    word = text(value)
    if not word.isprintable():
        raise Refused(show(value), "a name of letters that can be seen")
    if normalize("NFKC", word).strip()[:1] in ("=", "+", "-", "@"):
        raise Refused(
            show(value),
            "a name that does not begin with =, +, - or @",
            "Spreadsheets would compute it",
        )
    return word


def text_list(given: Any) -> tuple[str, ...]:
    """One text, or a list or array of texts, as a tuple."""
    if isinstance(given, str):
        return (given,)
    # masked entries become None, refused below
    plain: Any = given.tolist() if isinstance(given, np.ndarray) else given
    if not isinstance(plain, Sequence) or not all(isinstance(one, str) for one in plain):
        raise Refused(brief(given), "a text, or a list of texts")
    return tuple(plain)


def truth(value: Any) -> bool:
    """A truth value of Python or NumPy, as a bool; words such as "yes" are refused."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    word = value.strip().lower() if isinstance(value, str) else None
    for meant, words in (
        ("true", ("yes", "on", "y", "true")),
        ("false", ("no", "off", "n", "false")),
    ):
        if word in words:
            raise Refused(show(value), "true or false", f"Did you mean {meant}?")
    raise Refused(show(value), "true or false")


def real_number(value: Any) -> float:
    """``value`` as a float; nan if it is not a real number, or is too large for a float.

    Real numbers are those of Python and NumPy, fractions and decimals, and arrays without
    dimensions that hold one. Texts and truth values do not count, though ``float`` takes them.
    """
    if type(value) is float:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if not _is_real(value):
        return math.nan
    try:
        return float(value)
    except (OverflowError, ValueError):  # ValueError: a signalling nan among decimals
        return math.nan


def _number_where(value: Any, allowed: str, holds: Callable[[float], bool]) -> float:
    """Return a real number that meets a condition; Refused says what is ``allowed``."""
    number = real_number(value)
    if holds(number):
        return number
    mend = "Write it without quotes or unit." if isinstance(value, str) else ""
    raise Refused(show(value), allowed, mend)


def number(value: Any, low: float, high: float) -> float:
    """A plain number, without a unit, from ``low`` to ``high``."""
    return _number_where(
        value, f"a plain number from {low:g} to {high:g}", lambda x: low <= x <= high
    )


def fraction(value: Any, largest: float) -> float:
    """Read a plain number, or a text of one or of a fraction such as "1/3", of up to a ``largest``
    size.
    """
    if isinstance(value, str):
        parts = re.fullmatch(r"([-+]?[0-9]{1,9})/(0*[1-9][0-9]{0,8})", value)
        if parts:
            return int(parts[1]) / int(parts[2])
        value = float(value) if re.fullmatch(NUMBER, value) else value
    return number(value, -largest, largest) + 0.0


def above_zero(value: Any, unit: str = "") -> float:
    """A finite number above zero, in an SI ``unit``."""
    return _number_where(
        value, "a finite number above zero" + (unit and f", {unit}"), lambda x: 0.0 < x < math.inf
    )


def zero_or_above(value: Any, unit: str = "") -> float:
    """A finite number, zero or above, in an SI ``unit``."""
    return _number_where(
        value,
        "a finite number, zero or above" + (unit and f", {unit}"),
        lambda x: 0.0 <= x < math.inf,
    )


def is_whole(value: Any) -> bool:
    """Whether ``value`` is a whole number of Python or NumPy; truth values and spans of time do not
    count.
    """
    return isinstance(value, int | np.integer) and not isinstance(value, bool | np.timedelta64)


def whole(value: Any, low: int, high: int | None = None) -> int:
    """A whole number from ``low`` to ``high``; without an upper limit if ``high`` is None."""
    if is_whole(value) and low <= value and (high is None or value <= high):
        return int(value)
    allowed = f"a whole number, {low} or more"
    if high is not None:
        allowed = f"a whole number from {low} to {high}"
    raise Refused(show(value), allowed)


def grid(value: Any, low: int, high: int, example: str, periods: int = 2) -> tuple[int, ...]:
    """As many whole numbers from ``low`` to ``high`` as there are periods: "64 64", [64, 64], (64,
    64) or an array of two.

    If the ``example`` has more numbers, ones may follow up to its length.
    """
    count = len(example.split())
    ones = ("", " and a 1", " and two ones")[count - periods]
    allowed_words = ("one whole number", "two whole numbers", "three whole numbers")[periods - 1]
    allowed = f"{allowed_words} from {low} to {high}{ones}, such as {example}"
    words: Any = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, str):
        words = [int(w) if re.fullmatch(r"[0-9]{1,9}", w) else w for w in value.split()]
    if not isinstance(words, list | tuple) or not periods <= len(words) <= count:
        raise Refused(show(value), allowed)
    if not all(map(is_whole, words)):
        raise Refused(show(value), allowed)
    for place, word in enumerate(words[periods:], periods):
        if word != 1:
            ordinal = ("first", "second", "third")[place]
            mend = "The packing is one row." if periods == 1 else "The packing is one layer."
            raise Refused(f"{show(value)}, whose {ordinal} number is {word}", allowed, mend)
    if not all(low <= w <= high for w in words[:periods]):
        raise Refused(show(value), allowed)
    return tuple(map(int, words[:periods]))


def lengths(value: Any, low: int, high: int, periods: int | None = None) -> tuple[int, ...]:
    """Whole numbers from ``low`` to ``high``, the lengths of an array along its ``periods``; see
    :func:`grid`.

    Without ``periods`` there may be one to three. A single one may stand alone, without a list.
    """
    plain = value.tolist() if hasattr(value, "tolist") else value
    entries = [plain] if is_whole(plain) and periods in (None, 1) else plain
    words = entries.split() if isinstance(entries, str) else entries
    count = periods or (len(words) if hasattr(words, "__len__") else 0)
    if not 1 <= count <= 3:
        raise Refused(
            show(value),
            f"one to three whole numbers from {low} to {high}, one for each period of the lattice",
        )
    return grid(entries, low, high, ("16384", "128 128", "24 24 24")[count - 1], count)


def real_numbers(values: Any, unit: str = "") -> NDArray[np.float64]:
    """Real numbers as an array of floats of any shape, finite or not.

    An array that carries a unit, as of pint, astropy or xarray, must have the SI ``unit``; if that
    is not told, one that SI has without a factor. Refuses what NumPy would turn into other numbers
    than were meant: complex numbers, whose imaginary part would be dropped; masked entries, which
    would become numbers again; texts and truth values; numbers too large for a float; lists of
    different lengths; and lists that contain themselves.
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    carried_unit = find_unit_of(values)
    if carried_unit is not None and not is_si(carried_unit, unit):
        mend = "Give plain numbers, as x.to_base_units().magnitude of pint."
        raise Refused(f"numbers in {carried_unit}", f"numbers in {unit or 'SI units'}", mend)
    if _is_masked(values):
        mend = "Leave them out, as .compressed() does."
        raise _explain_numbers(values, "which has masked entries", mend)
    try:
        array, why = _convert(values)
    except OverflowError:
        raise _explain_numbers(values, "which is too large") from None
    except (TypeError, ValueError):
        # lists of different lengths, or a signalling nan among decimals
        raise _explain_numbers(values, "") from None
    if array is None:
        raise _explain_numbers(values, why)
    return array


def _explain_numbers(values: Any, why: str, mend: str = "") -> Refused:
    """Return the refusal of ``values`` that are no real numbers; ``why`` may be empty."""
    content = brief(values)
    if why and not content.endswith("too large"):
        content += f", {why}"
    if "too large" in content:
        return Refused(content, "what double precision can hold", mend)
    return Refused(content, "a real number or an array of them", mend)


def _convert(values: Any) -> tuple[NDArray[np.float64] | None, str]:
    """Return values as an array of floats; or None, and why they are none, if that is known."""
    numbers = np.asarray(values)
    kind = numbers.dtype.kind
    # objects are Python's integers of more than 64 bits, fractions, decimals
    objects = numbers.ravel().tolist() if kind == "O" else []
    if kind in "iuf" or (kind == "O" and all(map(_is_real, objects))):
        with np.errstate(over="ignore"):
            array = np.asarray(numbers, np.float64)
        may_overflow = numbers.dtype.itemsize > array.dtype.itemsize
        if may_overflow and np.any(np.isinf(array) & np.isfinite(numbers)):
            return None, "which is too large"
        return array, ""
    if kind == "c" or any(isinstance(entry, complex | np.complexfloating) for entry in objects):
        return None, "which is complex"
    return None, ""


def finite_numbers(values: Any, unit: str = "", low: Low = "") -> NDArray[np.float64]:
    """One or more finite numbers in an SI ``unit``, of any sign if ``low`` is empty."""
    array = real_numbers(values, unit)
    is_allowed = np.isfinite(array)
    if low == "above zero":
        is_allowed &= array > 0.0
    elif low == "zero or above":
        is_allowed &= array >= 0.0
    if array.size and np.all(is_allowed):
        return array
    wrong = array[~is_allowed]
    content = brief(values)
    if wrong.size and array.size > 1:
        content = f"{wrong[0]!s} among {array.size} numbers"
    allowed = f"one or more finite numbers {low}".rstrip()
    raise Refused(content, f"{allowed}, {unit}" if unit else allowed)


def indices(values: Any, count: int, what: str = "balls") -> NDArray[np.intp]:
    """An index, or several, as (n,): of ``count`` balls, or of others, each once."""
    numbers = finite_numbers(values)
    is_index = (numbers == np.rint(numbers)) & (numbers >= 0) & (numbers < count)
    is_list = numbers.ndim < 2
    if not is_list or not np.all(is_index) or np.unique(numbers).size < numbers.size:
        raise Refused(brief(values), f"indices of {what}, 0 to {count - 1}, each once")
    return np.atleast_1d(numbers).astype(np.intp)


def frequencies(
    values: Any, low: Low = "zero or above", in_order: bool = True
) -> NDArray[np.float64]:
    """Frequencies (n,), Hz, of which none is above :data:`HIGHEST_FREQUENCY`; ``in_order``: each
    above the one before.
    """
    array = finite_numbers(values, "Hz", low)
    if array.ndim > 1:
        raise Refused(f"frequencies of the shape {array.shape}", "a list of them, (n,)")
    array = np.atleast_1d(array)
    most = float(array.max())
    if most > HIGHEST_FREQUENCY:
        raise Refused(f"{most:.9g} Hz", f"frequencies up to {HIGHEST_FREQUENCY:g} Hz")
    falling = np.flatnonzero(np.diff(array) <= 0.0)
    if in_order and falling.size:
        frequency, following = array[falling[0] : falling[0] + 2].tolist()
        raise Refused(
            f"{following:.9g} Hz after {frequency:.9g} Hz", "frequencies in ascending order"
        )
    return array


def number_list(values: Any) -> tuple[float, ...]:
    """One real number or a list of them, as plain floats."""
    array = np.atleast_1d(real_numbers(values))
    if array.ndim != 1 or not array.size:
        raise Refused(brief(values, 200), "a real number or a list of them")
    return tuple(array.tolist())


def finite_number_list(values: Any, unit: str = "", low: Low = "") -> tuple[float, ...]:
    """One finite number or a list of them, as plain floats; see :func:`finite_numbers`."""
    return number_list(finite_numbers(values, unit, low))


def find_unit_of(values: Any) -> str | None:
    """The unit that an array carries: of pint (``units``) or astropy (``unit``), or as an attribute
    of xarray; else None.
    """
    if not hasattr(values, "__array__"):
        return None
    data = None if isinstance(values, np.ndarray) else getattr(values, "data", None)
    for carrier in (data, values):
        for name in ("units", "unit"):
            unit = getattr(carrier, name, None)
            if unit is not None:
                return str(unit)
    return None


def _is_real(value: Any) -> bool:
    """Whether a value is a real number; truth values and spans of time are none."""
    return isinstance(value, Real | Decimal) and not isinstance(value, bool | np.timedelta64)


def _is_masked(values: Any, depth: int = 0) -> bool:
    """Whether an array, or a list of numbers and arrays, has a masked entry; lists without end are
    refused.
    """
    if isinstance(values, list | tuple):
        if depth == _DEEPEST:
            raise Refused(
                f"a list nested more than {_DEEPEST} levels deep",
                "an array of numbers",
                "Does it contain itself?",
            )
        return any(_is_masked(entry, depth + 1) for entry in values)
    return isinstance(values, np.ma.MaskedArray) and bool(np.ma.is_masked(values))


def _named(
    rule: Callable[Concatenate[Any, Options], Value],
) -> Callable[Concatenate[str, Any, Options], Value]:
    """A rule as a check that takes the name of the argument before its value."""

    def check(name: str, value: Any, /, *options: Options.args, **more: Options.kwargs) -> Value:
        found: Value = require(name, lambda given: rule(given, *options, **more), value)
        return found

    return check


#: an array of floats of any shape, finite or not; an array of floats is returned without a copy
real_array = _named(real_numbers)
#: an array of one or more finite numbers in an SI unit
finite_array = _named(finite_numbers)
#: indices, each once
index_array = _named(indices)
#: a word among the options
one_of = _named(choice)
#: frequencies, Hz
frequency_array = _named(frequencies)
#: one number or a list of them, as plain floats
real_list = _named(number_list)
#: one finite number or a list of them, as plain floats
finite_list = _named(finite_number_list)
#: a finite real number above zero
positive = _named(above_zero)
#: a finite real number, zero or above
not_negative = _named(zero_or_above)
#: a whole number in a range
whole_number = _named(whole)
#: a whole number for each period
grid_numbers = _named(grid)
#: one text, or a list or array of texts, as a tuple
texts = _named(text_list)
