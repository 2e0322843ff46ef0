"""Rules: functions that check a value of any kind and return it in its proper type.

Scenes, command lines and Python calls are checked by the same rules. A rule raises
:class:`~granphon.base.errors.Refused`, which says what was found, what is allowed, and what was
probably meant; :func:`require` adds the name of an argument, and the reader of scenes the place of
a key. The checks of arguments, such as :data:`positive`, take the name of an argument, its value
and the options of a rule. They return the value as a plain number, array or tuple, or raise
:class:`~granphon.base.errors.InputError`.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence
from dataclasses import fields
from decimal import Decimal
from inspect import Parameter
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
Function = TypeVar("Function", bound=Callable[..., Any])
#: bound of numbers from below; empty for any sign
Low = Literal["", "above zero", "zero or above"]
#: highest frequency, Hz, far above that of any contact: its powers stay within the range of floats
HIGHEST_FREQUENCY = 1e30
#: types of plain numbers
_PLAIN_NUMBERS = frozenset((float, int))
#: the deepest nesting of lists: NumPy's arrays have no more dimensions
_MOST_LEVELS = 64


def read_inside(key: str | int, rule: Rule, value: Any) -> Any:
    """Return the ``value`` that stands at ``key`` of a block or list, read by its ``rule``; if the
    rule refuses the value, raise the refusal with the key in front of its path.
    """
    try:
        return rule(value)
    except Refused as refused:
        raise refused.under(key) from None


def spell_out(arguments: Any) -> Callable[[Function], Function]:
    """Return a decorator for a function whose ``**options`` are fields of the dataclass
    ``arguments``, each with a default that is no factory. The decorator changes the signature that
    help and pages show: in place of ``**options`` stand the fields, with their types and defaults,
    that the function does not name itself.
    """

    def decorate(function: Function) -> Function:
        """Return the ``function`` with a signature that names the options."""
        signature = inspect.signature(function)
        parameters = dict(signature.parameters)
        for name, parameter in signature.parameters.items():
            if parameter.kind is Parameter.VAR_KEYWORD:
                del parameters[name]
        for field in fields(arguments):
            option = Parameter(field.name, Parameter.KEYWORD_ONLY, default=field.default)
            parameters.setdefault(field.name, option.replace(annotation=field.type))
        any_function: Any = function  # the type of functions has no such attribute
        any_function.__signature__ = signature.replace(parameters=list(parameters.values()))
        return function

    return decorate


def require(name: str, rule: Rule, value: Any) -> Any:
    """Return the ``value`` of an argument of a Python call, read by a ``rule``; raise
    :class:`~granphon.base.errors.InputError` with the ``name`` of the argument if the rule refuses
    the value.
    """
    try:
        return rule(value)
    except Refused as refused:
        raise _name_argument(name, refused) from None


def require_instance(name: str, value: object, kind: type, mend: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError`, with the argument's ``name`` and the remedy
    ``mend``, unless a ``value`` is an instance of the class ``kind``.
    """
    if not isinstance(value, kind):
        raise InputError(f"{name} is {brief(value)}", mend=mend)


def _name_argument(name: str, refused: Refused) -> InputError:
    """Return the error of the argument ``name`` whose value a rule has refused."""
    place = ".".join(map(str, (name, *refused.path)))
    return InputError(f"{place}: {refused}")


def make_key_refusal(key: Any, known: Iterable[str], mend: str = "") -> Refused:
    """Return the refusal of a ``key`` that is not one of the ``known`` ones; without a ``mend`` the
    refusal suggests the known key that is closest.
    """
    names = list(known)
    guess = closest(str(key), names)
    suggestion = f"Did you mean '{guess}'?" if guess else ""
    return Refused("an unknown key", ", ".join(names) or "none", mend or suggestion, (key,))


def block(value: Any, rules: Mapping[str, Rule], needed: Sequence[str] = ()) -> dict[str, Any]:
    """Return the entries of a block of keys, each value read by the rule of its key. A key without
    a rule is refused, and a block that lacks one of the keys in ``needed``.
    """
    if not isinstance(value, Mapping):
        raise Refused(show(value), f"a block of keys: {', '.join(rules) or 'none'}")
    for key in value:
        if key not in rules:
            raise make_key_refusal(key, rules)
    entries = {key: read_inside(key, rules[key], entry) for key, entry in value.items()}
    for key in needed:
        if key not in value:
            allowed = _describe_allowed(rules[key])
            raise Refused("nothing, and it has no default", allowed, path=(key,))
    return entries


def _describe_allowed(rule: Rule) -> str:
    """Return what a rule allows, in the words by which the rule refuses None; else "a value"."""
    try:
        rule(None)
    except Refused as refused:
        return refused.allowed
    return "a value"


def each(value: Any, rule: Rule, what: str) -> tuple[Any, ...]:
    """Return the values of a list or tuple that is not empty, each read by the same ``rule``;
    ``what`` is the plural for the values in messages.
    """
    is_list = isinstance(value, list | tuple)
    if not is_list or not value:
        content = "an empty list" if is_list else show(value)
        raise Refused(content, f"a list of one or more {what}")
    return tuple(read_inside(index, rule, entry) for index, entry in enumerate(value))


def is_one_of(value: object, options: Container[str]) -> bool:
    """Whether a value is text, and one of ``options``: what cannot be hashed or compared is not."""
    return isinstance(value, str) and value in options


def choice(value: Any, options: Collection[str]) -> str:
    """Return a word that must be one of the ``options``.

    The options may be a :class:`~granphon.base.registry.Registry`: then the refusal names the
    plug-ins that have failed, one of which may have the word.
    """
    if is_one_of(value, options):
        return str(value)
    suggestions = []
    if hasattr(options, "describe_failures"):
        suggestions.append(options.describe_failures())
    guess = closest(value, options) if isinstance(value, str) else None
    if guess:
        suggestions.append(f"Did you mean {guess!r}?")
    raise Refused(show(value), ", ".join(options), ". ".join(filter(None, suggestions)))


def text(value: Any) -> str:
    """Return a text, as it is. Refused are a blank text, a text with a null character, and any
    value that is no text.
    """
    if isinstance(value, str) and value.strip() and "\0" not in value:
        return value
    raise Refused(show(value), "a name")


def label(value: Any) -> str:
    """Return a name that stands in tables, as it is. A name with a character that cannot be printed
    is refused, one that a spreadsheet takes for a formula, and what :func:`text` refuses.
    """
    name = text(value)
    if not name.isprintable():
        raise Refused(show(value), "a name of letters that can be seen")
    # spreadsheets also take the wide forms of these signs, which NFKC makes plain
    first_character = normalize("NFKC", name).strip()[:1]
    if first_character in ("=", "+", "-", "@"):
        raise Refused(
            show(value),
            "a name that does not begin with =, +, - or @",
            "Spreadsheets would compute it",
        )
    return name


def text_list(value: Any) -> tuple[str, ...]:
    """Return one text, or a list or array of texts, as a tuple; an array without axes is one text.
    An empty list is an empty tuple.
    """
    # masked entries of an array become None, which is no text
    entries: Any = value.tolist() if isinstance(value, np.ndarray) else value
    if isinstance(entries, str):
        return (entries,)
    is_list = isinstance(entries, Sequence) and not isinstance(entries, bytes | bytearray)
    if not is_list or not all(isinstance(entry, str) for entry in entries):
        raise Refused(brief(value), "a text, or a list of texts")
    return tuple(entries)


def truth(value: Any) -> bool:
    """Return a truth value of Python or NumPy as a bool; words such as "yes" are refused."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    word = value.strip().lower() if isinstance(value, str) else None
    suggestion = ""
    if word in ("yes", "on", "y", "true"):
        suggestion = "Did you mean true?"
    elif word in ("no", "off", "n", "false"):
        suggestion = "Did you mean false?"
    raise Refused(show(value), "true or false", suggestion)


def real_number(value: Any) -> float:
    """Return a value as a float; nan if it is not a real number. A number too large for a float is
    nan or, of decimals and of NumPy's long doubles, inf.

    Real numbers are those of Python and NumPy, fractions and decimals, and arrays without
    dimensions that hold one. Texts and truth values do not count, though ``float`` takes them.
    """
    if type(value) is float:
        return value
    has_no_axes = isinstance(value, np.ndarray) and value.ndim == 0
    scalar = value[()] if has_no_axes else value
    if not _is_real(scalar):
        return math.nan
    try:
        return float(scalar)
    except (OverflowError, ValueError):  # ValueError: a signalling nan among decimals
        return math.nan


def _make_number_refusal(value: Any, allowed: str, unit: str = "") -> Refused:
    """Return the refusal of a ``value`` that is no number of the kind that the words ``allowed``
    describe, in an SI ``unit``, or without a unit if ``unit`` is empty.
    """
    mend = "Write it without quotes or unit." if isinstance(value, str) else ""
    return Refused(show(value), f"{allowed}, {unit}" if unit else allowed, mend)


def number(value: Any, low: float, high: float) -> float:
    """Return a plain number, without a unit, from ``low`` to ``high``."""
    as_float = real_number(value)
    if low <= as_float <= high:
        return as_float
    raise _make_number_refusal(value, f"a plain number from {low:g} to {high:g}")


def fraction(value: Any, largest: float) -> float:
    """Return the number that ``value`` holds: a plain number, a text such as "0.5", or a text such
    as "1/3", the quotient of two whole numbers of at most nine digits, of which the second is not
    zero.

    The magnitude of the number is at most ``largest``; a quotient may have any magnitude. A zero
    has no sign.
    """
    plain_number = value
    if isinstance(value, str):
        quotient = re.fullmatch(r"([-+]?[0-9]{1,9})/(0*[1-9][0-9]{0,8})", value)
        if quotient:
            numerator = int(quotient[1])
            denominator = int(quotient[2])
            return numerator / denominator
        if re.fullmatch(NUMBER, value):
            plain_number = float(value)
    return number(plain_number, -largest, largest) + 0.0  # -0.0 + 0.0 is 0.0


def above_zero(value: Any, unit: str = "") -> float:
    """Return a finite number above zero, in an SI ``unit``."""
    as_float = real_number(value)
    if 0.0 < as_float < math.inf:
        return as_float
    raise _make_number_refusal(value, "a finite number above zero", unit)


def zero_or_above(value: Any, unit: str = "") -> float:
    """Return a finite number, zero or above, in an SI ``unit``."""
    as_float = real_number(value)
    if 0.0 <= as_float < math.inf:
        return as_float
    raise _make_number_refusal(value, "a finite number, zero or above", unit)


def is_whole(value: Any) -> bool:
    """Whether ``value`` is a whole number of Python or NumPy; truth values and spans of time do not
    count.
    """
    return isinstance(value, int | np.integer) and not isinstance(value, bool | np.timedelta64)


def whole(value: Any, low: int, high: int | None = None) -> int:
    """Return a whole number from ``low`` to ``high``; without an upper limit if ``high`` is
    None.
    """
    if is_whole(value) and low <= value and (high is None or value <= high):
        return int(value)
    allowed = f"a whole number, {low} or more"
    if high is not None:
        allowed = f"a whole number from {low} to {high}"
    raise Refused(show(value), allowed)


def read_words(text: str) -> list[int | str]:
    """Return the words of a text between spaces: a word of at most nine digits as the whole number
    that it is, and another word as it is, for a rule to refuse.
    """
    is_count = re.compile(r"[0-9]{1,9}").fullmatch
    return [int(word) if is_count(word) else word for word in text.split()]


def grid(value: Any, low: int, high: int, example: str, periods: int = 2) -> tuple[int, ...]:
    """Return as many whole numbers from ``low`` to ``high`` as there are ``periods``, 1 to 3: of
    two periods, those of "64 64", [64, 64], (64, 64) or an array of two.

    The message shows the ``example``, which has as many numbers as there are periods, or up to
    three. If the example has more numbers than there are periods, the value may have as many as the
    example, of which those beyond the periods must be ones, and are not returned.
    """
    most = len(example.split())
    counts_in_words = {1: "one whole number", 2: "two whole numbers", 3: "three whole numbers"}
    ones_in_words = {0: "", 1: " and a 1", 2: " and two ones"}
    allowed = f"{counts_in_words[periods]} from {low} to {high}"
    allowed += f"{ones_in_words[most - periods]}, such as {example}"
    numbers: Any = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, str):
        numbers = read_words(value)
    if not isinstance(numbers, list | tuple) or not periods <= len(numbers) <= most:
        raise Refused(show(value), allowed)
    if not all(map(is_whole, numbers)):
        raise Refused(show(value), allowed)
    for index, count in enumerate(numbers[periods:], periods):
        if count != 1:
            ordinal = ("first", "second", "third")[index]
            mend = "The packing is one row." if periods == 1 else "The packing is one layer."
            raise Refused(f"{show(value)}, whose {ordinal} number is {count}", allowed, mend)
    if not all(low <= count <= high for count in numbers[:periods]):
        raise Refused(show(value), allowed)
    return tuple(map(int, numbers[:periods]))


def lengths(value: Any, low: int, high: int, periods: int | None = None) -> tuple[int, ...]:
    """Return the numbers of cells of a sample along each of its ``periods``, from ``low`` to
    ``high``; ``value`` is a text, list or NumPy array as for :func:`grid`, or for one period a
    plain number. If ``periods`` is None, one to three numbers are allowed.
    """
    entries = value.tolist() if hasattr(value, "tolist") else value
    if is_whole(entries) and periods in (None, 1):
        entries = [entries]
    if periods is None:
        words = entries.split() if isinstance(entries, str) else entries
        count = len(words) if hasattr(words, "__len__") else 0
    else:
        count = periods
    if not 1 <= count <= 3:
        raise Refused(
            show(value),
            f"one to three whole numbers from {low} to {high}, one for each period of the lattice",
        )
    example = ("16384", "128 128", "24 24 24")[count - 1]
    return grid(entries, low, high, example, count)


def real_numbers(values: Any, unit: str = "") -> NDArray[np.float64]:
    """Return real numbers, finite or not, as an array of floats of the shape of ``values``; an
    array of floats is returned as it is, without a copy.

    An array that carries a unit, as of pint, astropy or xarray, must have the SI ``unit``; if
    ``unit`` is empty, a unit that SI has without a factor. Values are refused that NumPy would turn
    into other numbers than were meant: complex numbers, whose imaginary part would be dropped;
    masked entries, which would become numbers again; texts and truth values; numbers too large for
    a float; lists of different lengths; and lists that contain themselves.
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    if type(values) is float:
        return np.array(values)
    carried_unit = find_unit_of(values)
    if carried_unit is not None and not is_si(carried_unit, unit):
        mend = "Give plain numbers, as x.to_base_units().magnitude of pint."
        raise Refused(f"numbers in {carried_unit}", f"numbers in {unit or 'SI units'}", mend)
    if _holds(_is_masked_or_of_truth, values):
        if _holds(_is_masked, values):
            mend = "Leave them out, as .compressed() does."
            raise _make_numbers_refusal(values, "which has masked entries", mend)
        is_single = isinstance(values, bool | np.bool_)
        raise _make_numbers_refusal(values, "" if is_single else "which has truth values")
    try:
        array, why = _convert_numbers(values)
    except OverflowError:
        raise _make_numbers_refusal(values, "which is too large") from None
    except (TypeError, ValueError):
        # lists of different lengths, or a signalling nan among decimals
        raise _make_numbers_refusal(values, "") from None
    if array is None:
        raise _make_numbers_refusal(values, why)
    return array


def _make_numbers_refusal(values: Any, why: str, mend: str = "") -> Refused:
    """Return the refusal of ``values`` that are no real numbers; ``why`` is a relative clause about
    the values, or empty.
    """
    content = brief(values)
    if why and not content.endswith("too large"):
        content += f", {why}"
    if "too large" in content:
        return Refused(content, "what double precision can hold", mend)
    return Refused(content, "a real number or an array of them", mend)


def _convert_numbers(values: Any) -> tuple[NDArray[np.float64] | None, str]:
    """Return values as an array of floats of their shape, and ""; or None, and a relative clause
    that says why the values are no real numbers, "" if that is not known.
    """
    numbers = np.asarray(values)
    kind = numbers.dtype.kind
    # objects are Python's integers of more than 64 bits, fractions, decimals
    objects = numbers.ravel().tolist() if kind == "O" else []
    are_real_objects = kind == "O" and all(map(_is_real, objects))
    if kind in "iuf" or are_real_objects:
        with np.errstate(over="ignore"):
            array = np.asarray(numbers, np.float64)
        may_overflow = numbers.dtype.itemsize > array.dtype.itemsize  # long doubles
        if may_overflow and np.any(np.isinf(array) & np.isfinite(numbers)):
            return None, "which is too large"
        return array, ""
    if kind == "c" or any(isinstance(entry, complex | np.complexfloating) for entry in objects):
        return None, "which is complex"
    return None, ""


def finite_numbers(values: Any, unit: str = "", low: Low = "") -> NDArray[np.float64]:
    """Return one or more finite numbers in an SI ``unit`` as an array of floats of the shape of
    ``values``, see :func:`real_numbers`; the numbers may have any sign if ``low`` is empty.
    """
    array = real_numbers(values, unit)
    is_allowed = np.isfinite(array)
    if low == "above zero":
        is_allowed &= array > 0.0
    elif low == "zero or above":
        is_allowed &= array >= 0.0
    if array.size and np.all(is_allowed):
        return array
    refused_numbers = array[~is_allowed]
    content = brief(values)
    if refused_numbers.size and array.size > 1:
        content = f"{refused_numbers[0]!s} among {array.size} numbers"
    allowed = f"one or more finite numbers {low}".rstrip()
    if unit:
        allowed += f", {unit}"
    raise Refused(content, allowed)


def indices(values: Any, count: int, what: str = "balls") -> NDArray[np.intp]:
    """Return one index or a list of n, one or more, as an array (n,): each is a whole number from 0
    to ``count`` - 1, of any type, and stands there once; ``what`` is the plural for the indexed
    objects in messages.
    """
    numbers = finite_numbers(values)
    is_whole_number = numbers == np.rint(numbers)
    is_index = is_whole_number & (numbers >= 0) & (numbers < count)
    is_list = numbers.ndim < 2
    has_twins = np.unique(numbers).size < numbers.size
    if not is_list or not np.all(is_index) or has_twins:
        listed = values.tolist() if isinstance(values, np.ndarray) else values
        raise Refused(brief(listed), f"indices of {what}, 0 to {count - 1}, each once")
    return np.atleast_1d(numbers).astype(np.intp)


def frequencies(
    values: Any, low: Low = "zero or above", in_order: bool = True
) -> NDArray[np.float64]:
    """Return one frequency or a list of n, one or more, as an array (n,), Hz, each of the sign that
    ``low`` says and of a size up to :data:`HIGHEST_FREQUENCY`; with ``in_order`` each must be above
    the frequency before. An array (n,) of floats is returned as it is, without a copy.
    """
    numbers = finite_numbers(values, "Hz", low)
    if numbers.ndim > 1:
        raise Refused(f"frequencies of the shape {numbers.shape}", "a list of them, (n,)")
    array = np.atleast_1d(numbers)
    largest = float(array[np.argmax(np.abs(array))])
    if abs(largest) > HIGHEST_FREQUENCY:
        raise Refused(f"{largest:.9g} Hz", f"frequencies up to {HIGHEST_FREQUENCY:g} Hz")
    falls = np.flatnonzero(np.diff(array) <= 0.0)  # places of those that the next is not above
    if in_order and falls.size:
        frequency, following = array[falls[0] : falls[0] + 2].tolist()
        raise Refused(
            f"{following:.9g} Hz after {frequency:.9g} Hz", "frequencies in ascending order"
        )
    return array


def number_list(values: Any) -> tuple[float, ...]:
    """Return one real number, or a list of one or more, as a tuple of plain floats."""
    array = np.atleast_1d(real_numbers(values))
    if array.ndim != 1 or not array.size:
        raise Refused(brief(values, 200), "a real number or a list of them")
    return tuple(array.tolist())


def finite_number_list(values: Any, unit: str = "", low: Low = "") -> tuple[float, ...]:
    """Return one finite number, or a list of one or more, as a tuple of plain floats; ``unit`` and
    ``low`` are those of :func:`finite_numbers`.
    """
    return number_list(finite_numbers(values, unit, low))


def find_unit_of(values: Any) -> str | None:
    """Return the text of the unit that an array carries: as ``units`` (pint) or ``unit`` (astropy),
    of the array or, as in xarray, of its data; None if there is no unit.
    """
    if not hasattr(values, "__array__"):
        return None
    # the data of an array of NumPy are a buffer, which has no unit
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


def _is_masked(value: Any) -> bool:
    """Whether a value is an array with a masked entry."""
    return isinstance(value, np.ma.MaskedArray) and bool(np.ma.is_masked(value))


def _is_masked_or_of_truth(value: Any) -> bool:
    """Whether a value is an array with a masked entry, a truth value, or an array of truth
    values.
    """
    if isinstance(value, np.ndarray):
        return value.dtype.kind == "b" or _is_masked(value)
    return isinstance(value, bool | np.bool_)


def _holds(condition: Callable[[Any], bool], values: Any, depth: int = 0) -> bool:
    """Whether ``values`` meet a ``condition`` that no plain number meets, or are a list that has an
    entry that meets it, at any depth.

    ``depth`` is the number of lists around ``values``; a list that is nested too deeply, as a list
    that contains itself is, is refused.
    """
    if not isinstance(values, list | tuple):
        return condition(values)
    if _PLAIN_NUMBERS.issuperset(map(type, values)):
        return False
    if depth == _MOST_LEVELS:
        raise Refused(
            f"a list nested more than {_MOST_LEVELS} levels deep",
            "an array of numbers",
            "Does it contain itself?",
        )
    return any(_holds(condition, entry, depth + 1) for entry in values)


def _named(
    rule: Callable[Concatenate[Any, Options], Value],
) -> Callable[Concatenate[str, Any, Options], Value]:
    """Return the check of an argument by a ``rule``: a function that takes the name of the
    argument, its value, and the options of the rule.
    """

    def check(
        name: str, value: Any, /, *options: Options.args, **named_options: Options.kwargs
    ) -> Value:
        """Return the value that the rule reads; the error names the argument."""
        try:
            return rule(value, *options, **named_options)
        except Refused as refused:
            raise _name_argument(name, refused) from None

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
