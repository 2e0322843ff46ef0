"""Standard errors as they are written in a scene: behind a quantity, as in "8 mm +- 4 um", or in a
fit.

A value "{fit: fit.yaml}" stands for what ``granphon fit`` has found of its key: the value, the
standard error, and the correlations with other values of the same fit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from granphon.balls.packing import SECOND_LOSSES
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import NUMBER, split_error
from granphon.base.text import list_names, read_yaml, show
from granphon.scene.file_keys import FIT

#: the keys that lead to a value of a scene
Keys = tuple[str | int, ...]
#: what may be written for a quantity with its standard error
_ALLOWED = "a quantity with its standard error, such as '8 mm +- 4 um' or '211 GPa +- 1 %'"
#: the number of a spread of each kind that a fit of the width gives
_NUMBERS_OF_SPREADS = {"uniform": "width", "normal": "std"}


def name_keys(keys: Keys) -> str:
    """Return the name of the parameter to which ``keys`` lead, "material.young_modulus"."""
    return ".".join(map(str, keys))


@dataclass
class WrittenErrors:
    """The standard errors that are written in a document.

    Attributes
    ----------
    values : the values alone, by the keys that lead to them, as they stand without an error.
    errors : the standard errors likewise, texts of a number and a unit.
    correlations : the names of two values, and the correlation of their errors.
    fits : the files of fits.
    """

    values: dict[Keys, Any] = field(default_factory=dict)
    errors: dict[Keys, str] = field(default_factory=dict)
    correlations: list[tuple[str, str, float]] = field(default_factory=list)
    fits: list[Path] = field(default_factory=list)

    @classmethod
    def read(cls, entries: Mapping[Keys, Any], folder: Path) -> WrittenErrors:
        """Read the ``entries`` of a document, by the keys that lead to them: texts with a standard
        error, and mappings that name the file of a fit, which is sought in a ``folder``.

        Refused for a quantity with an error that cannot be read, and for a fit that does not have
        the value.
        """
        written = cls()
        # by the file of a fit, the keys of its values, each with the number of its parameter
        keys_of_fits: dict[Path, dict[Keys, int]] = {}
        fits: dict[Path, Any] = {}
        for keys, entry in entries.items():
            if isinstance(entry, Mapping):
                file = folder / _read_name(keys, entry)
                if file not in fits:
                    fits[file] = _read_fit(keys, file)
                number = written._add_fitted(keys, file.name, fits[file])
                keys_of_fits.setdefault(file, {})[keys] = number
                continue
            value_and_error = split_error(entry)
            if value_and_error is not None:
                written._add(keys, *value_and_error)
            elif re.match(rf"\s*\(?\s*{NUMBER}", entry):
                raise Refused(show(entry), _ALLOWED, path=keys)
        for file, numbers in keys_of_fits.items():
            for first, second in combinations(numbers, 2):
                correlation = fits[file].correlation[numbers[first], numbers[second]]
                # rounding may put a correlation beyond its ends
                value = float(np.clip(correlation, -1.0, 1.0))
                names = name_keys(_spell_out(first)), name_keys(_spell_out(second))
                written.correlations.append((*names, value))
        written.fits = list(fits)
        return written

    def _add_fitted(self, keys: Keys, name_of_file: str, fit: Any) -> int:
        """Add the value of a ``fit``, with its error, to which the ``keys`` of a scene lead; return
        the number of its parameter.
        """
        name, scale = _find_parameter(keys, fit)
        if name not in fit.parameters:
            found = f"{name_of_file}, a fit of {list_names(fit.parameters)}"
            raise Refused(found, f"a fit of {name}", path=keys)
        number: int = fit.parameters.index(name)
        value = scale * float(fit.values[number])
        error = scale * float(fit.stderrs[number])
        if not math.isfinite(error):
            found = f"{name_of_file}, whose standard errors are not known"
            raise Refused(found, "a fit whose errors are known", "Write the value itself.", keys)
        unit = fit.units_of_values[number]
        unit = "" if unit == "1" else unit.replace(" ", "*")
        self._add(keys, f"{value!r} {unit}" if unit else value, f"{error!r} {unit}".strip())
        return number

    def _add(self, keys: Keys, value: Any, error: str) -> None:
        """Add a value with its standard error, to which the ``keys`` of a document lead."""
        self.values[keys] = value
        self.errors[_spell_out(keys)] = error


def _spell_out(keys: Keys) -> Keys:
    """Return the keys under which a scene writes the value at ``keys``: a spread that is normal may
    stand in short, with its standard deviation alone.
    """
    return (*keys, "std") if keys[-1] == "normal" else keys


def _read_name(keys: Keys, entry: Mapping[str, Any]) -> str:
    """Return the name of the file of a fit; Refused if the ``entry`` has another key, or names no
    file.
    """
    name = entry[FIT]
    if len(entry) > 1 or not isinstance(name, str) or not name:
        raise Refused(show(dict(entry)), "{fit: fit.yaml} alone", path=keys)
    return name


def _read_fit(keys: Keys, file: Path) -> Any:
    """Return the fit in a ``file``, to which the ``keys`` of a scene lead; Refused if the file
    cannot be read or holds no fit.
    """
    from granphon.fits.transfer import read_fit

    try:
        return read_fit(read_yaml(file))
    except InputError as error:
        raise Refused(str(file), "a fit.yaml of 'granphon fit'", f"{error}", keys) from None


def _find_parameter(keys: Keys, fit: Any) -> tuple[str, float]:
    """Return the name of the parameter of a ``fit`` to which the ``keys`` of a scene lead, and the
    value in the scene over that of the parameter.
    """
    if "spread" in keys:
        spread = getattr(getattr(fit, "packing", None), "spread", None)
        kind = type(spread).__name__.lower()
        number = _NUMBERS_OF_SPREADS.get(kind)
        if number is None or kind not in keys:
            raise Refused(f"a fit of a spread that is {kind}", "the same kind of spread", path=keys)
        return "width", getattr(spread, number) / fit.width
    key = keys[-1]
    if isinstance(key, int):
        key = keys[-2] if key == 0 else SECOND_LOSSES.get(str(keys[-2]), key)
    return str(key), 1.0
