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
from granphon.base.arrays import Array
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import NUMBER, split_error
from granphon.base.text import list_names, read_yaml, show
from granphon.scene.file_keys import FIT

#: the keys that lead to a value of a scene
Keys = tuple[str | int, ...]
#: what may be written for a quantity with its standard error
_ALLOWED = "a quantity with its standard error, such as '8 mm +- 4 um' or '211 GPa +- 1 %'"
#: magnitude of a correlation that rounding leaves of zero, in a covariance that is found from
#: derivatives or goes through a file
_ROUNDING = 1e-9
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
    values : the values without their errors, by their paths in the document, as the document would
        have them if they had no error.
    errors : the standard errors, texts of a number and a unit, by the paths of :func:`_spell_out`.
    correlations : the names of two values, and the correlation of their errors.
    fits : the files of fits.
    """

    values: dict[Keys, Any] = field(default_factory=dict)
    errors: dict[Keys, str] = field(default_factory=dict)
    correlations: list[tuple[str, str, float]] = field(default_factory=list)
    fits: list[Path] = field(default_factory=list)

    @classmethod
    def read(cls, entries: Mapping[Keys, Any], folder: Path) -> WrittenErrors:
        """Return the errors in the ``entries`` of a document, by their paths: texts with a standard
        error, and mappings that name the file of a fit. Files are sought in ``folder``.

        Two values of the same fit have its correlation. Refused for a quantity with an error that
        cannot be read, and for a fit that does not have the value.
        """
        written = cls()
        # for each file of a fit, the paths of values that it gives, and the numbers of the
        # parameters of the fit that these are
        numbers_of_fits: dict[Path, dict[Keys, int]] = {}
        fits: dict[Path, Any] = {}
        for keys, entry in entries.items():
            if isinstance(entry, Mapping):
                file = folder / _read_name(keys, entry)
                if file not in fits:
                    fits[file] = _read_fit(keys, file)
                number = written._add_fitted(keys, file.name, fits[file])
                numbers_of_fits.setdefault(file, {})[keys] = number
                continue
            value_and_error = split_error(entry)
            if value_and_error is not None:
                value, error = value_and_error
                written._add(keys, value, error)
            elif re.match(rf"\s*\(?\s*{NUMBER}", entry):
                # another text with the sign of an error is no quantity, and stays as it is
                raise Refused(show(entry), _ALLOWED, path=keys)
        for file, numbers in numbers_of_fits.items():
            for first, second in combinations(numbers, 2):
                correlation = fits[file].correlation[numbers[first], numbers[second]]
                # rounding may put a correlation beyond -1 or 1
                bounded = float(np.clip(correlation, -1.0, 1.0))
                names = name_keys(_spell_out(first)), name_keys(_spell_out(second))
                written.correlations.append((*names, bounded))
        written.fits = list(fits)
        return written

    def _add_fitted(self, keys: Keys, name_of_file: str, fit: Any) -> int:
        """Add the value that the ``fit`` in the file ``name_of_file`` has found for the path
        ``keys`` of a scene, with its standard error; return the number of the parameter in the fit.

        Refused if the fit does not have the parameter, or its errors are not known.
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
        """Add the ``value`` at the path ``keys`` of a document, and its standard ``error``, a text
        of a number and a unit.
        """
        self.values[keys] = value
        self.errors[_spell_out(keys)] = error


def _spell_out(keys: Keys) -> Keys:
    """Return the path at which :func:`granphon.scene.file.write_blocks` writes the value that the
    document has at the path ``keys``: it is a longer path for {normal: 20 um}, which is written as
    {normal: {std: 20 um, cutoff: ...}}.
    """
    return (*keys, "std") if keys[-1] == "normal" else keys


def _read_name(keys: Keys, entry: Mapping[str, Any]) -> str:
    """Return the name of the file of a fit from the ``entry`` {fit: FILE} at the path ``keys``;
    Refused if the entry has another key, or names no file.
    """
    name = entry[FIT]
    if len(entry) > 1 or not isinstance(name, str) or not name:
        raise Refused(show(dict(entry)), "{fit: fit.yaml} alone", path=keys)
    return name


def _read_fit(keys: Keys, file: Path) -> Any:
    """Return the fit in a ``file``, which a scene names at the path ``keys``; Refused if the file
    cannot be read or holds no fit, and for a covariance that no errors have.
    """
    from granphon.fits.transfer import read_fit

    try:
        fit = read_fit(read_yaml(file))
    except InputError as error:
        raise Refused(str(file), "a fit.yaml of 'granphon fit'", f"{error}", keys) from None
    fault = _find_fault(fit.covariance)
    if fault:
        found = f"{file.name}, whose covariance {fault}"
        raise Refused(found, "a symmetric, positive semidefinite covariance", path=keys)
    return fit


def _find_fault(covariance: Array) -> str:
    """Return what is wrong with a ``covariance`` (p, p) that no errors have; an empty text if
    nothing is, and of one that is not known.
    """
    if not np.all(np.isfinite(covariance)):
        return ""
    variances = np.diag(covariance)
    if np.any(variances <= 0.0):
        return f"has the variance {np.min(variances):.3g}"
    scale = np.sqrt(variances)
    correlation = covariance / np.outer(scale, scale)
    if np.max(np.abs(correlation - correlation.T)) > _ROUNDING:
        return "is not symmetric"
    smallest = float(np.linalg.eigvalsh(correlation)[0])
    if smallest < -_ROUNDING * len(scale):
        return f"gives correlations whose matrix has the eigenvalue {smallest:.2g}"
    return ""


def _find_parameter(keys: Keys, fit: Any) -> tuple[str, float]:
    """Return the name that a ``fit`` has for the parameter at the path ``keys`` of a scene, and the
    factor by which the value of the fit is multiplied to give that of the scene.

    The factor is not 1 for a spread, whose number in the scene may be a standard deviation where
    the fit has the width. Refused for a spread of another kind than that of the fit.
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
        # the value stands in a list: the first has the name of the key, as a loss has, and the
        # second loss a name of its own
        key = keys[-2] if key == 0 else SECOND_LOSSES.get(str(keys[-2]), key)
    return str(key), 1.0
