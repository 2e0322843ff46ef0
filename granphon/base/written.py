"""Values in the units that a user has written."""

from __future__ import annotations

from granphon.base.quantities import find_factor
from granphon.base.scales import write_quantity

#: numbers in a unit of the user that are written in this unit
_LEAST_SHORT = 1e-3
_MOST_SHORT = 1e4


def write_in(value: float, unit: str, written: str = "", digits: int = 5) -> str:
    """Return the text of a value in the SI ``unit``, with ``digits`` significant digits, in the
    unit ``written`` that a user has chosen, such as "0.5 mm"; with a decimal prefix without such a
    unit, with one of another dimension, and where the number would be long.
    """
    factor = find_factor(unit, written) if written else None
    if factor is None:
        return write_quantity(value, unit, digits)
    number = value * factor
    if number and not _LEAST_SHORT <= abs(number) < _MOST_SHORT:
        return write_quantity(value, unit, digits)
    return f"{number:.{digits}g} {written}"
