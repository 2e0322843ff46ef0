"""Standard errors as they stand in a scene file: behind a quantity, as in "8 mm +- 4 um", or in the
file of a fit.

A value {fit: fit.yaml} stands for what ``granphon fit`` has found for its key: the value, the
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

#: a path: the keys, and the indices in lists, that lead to a value of a scene
Keys = tuple[str | int, ...]
#: what may be written for a quantity with its standard error
_QUANTITY_WITH_ERROR = (
    "a quantity with its standard error, such as '8 mm +- 4 um' or '211 GPa +- 1 %'"
)
#: error of a correlation by rounding, in a covariance that is found from derivatives and read from
#: a file
_ROUNDING = 1e-9
#: the number of each kind of spread that follows from the width that a fit has found
_NUMBERS_OF_SPREADS = {"uniform": "width", "normal": "std"}


def name_keys(keys: Keys) -> str:
    """Return the name of the parameter at the path ``keys``, such as "material.young_modulus"."""
    return ".".join(map(str, keys))


@dataclass
class WrittenErrors:
    """The standard errors that are written in a document.

    Attributes
    ----------
    values : the values without their errors, by their paths in the document, as the document would
        have them if they had no error.
    errors : the standard errors, texts of a number and a unit if it has one, by the paths of
        :func:`_spell_out`.
    correlations : for each two values of the same fit their names, those of :func:`name_keys`, and
        the correlation of their errors.
    fits : the files of fits, each once.
    """

    values: dict[Keys, Any] = field(default_factory=dict)
    errors: dict[Keys, str] = field(default_factory=dict)
    correlations: list[tuple[str, str, float]] = field(default_factory=list)
    fits: list[Path] = field(default_factory=list)

    @classmethod
    def read(cls, entries: Mapping[Keys, Any], folder: Path) -> WrittenErrors:
        """Return the errors in the ``entries`` of a document. An entry, by its path of one key or
        more, is a text with the sign of a standard error, or a mapping {fit: FILE} that names the
        file of a fit. Files are sought in ``folder``.

        Refused for a quantity with an error that cannot be read, for a mapping with another key or
        without a name of a file, for a file that holds no fit or a covariance that no errors have,
        and for a fit that has another kind of spread, or does not have the value or its error.
        """
        written = cls()
        fits: dict[Path, Any] = {}
        # for each file, by the paths of the values that its fit gives, the numbers of their
        # parameters in the fit
        numbers_in_fits: dict[Path, dict[Keys, int]] = {}
        for keys, entry in entries.items():
            if not isinstance(entry, Mapping):
                written._add_text(keys, entry)
                continue
            file = folder / _read_name(keys, entry)
            if file not in fits:
                fits[file] = _read_fit(keys, file)
            number = written._add_fitted(keys, file.name, fits[file])
            numbers_in_fits.setdefault(file, {})[keys] = number
        for file, numbers in numbers_in_fits.items():
            written._add_correlations(numbers, fits[file].correlation)
        written.fits = list(fits)
        return written

    def _add_text(self, keys: Keys, text: str) -> None:
        """Add the value and the standard error in a ``text`` at the path ``keys``. A text that does
        not begin with a number is no quantity, and nothing is added. Refused for a quantity whose
        error cannot be read.
        """
        value_and_error = split_error(text)
        if value_and_error is not None:
            self._add(keys, *value_and_error)
        elif re.match(rf"\s*\(?\s*{NUMBER}", text):
            raise Refused(show(text), _QUANTITY_WITH_ERROR, path=keys)

    def _add_correlations(self, numbers: Mapping[Keys, int], correlation: Array) -> None:
        """Add the correlation of each two values that a scene takes from one fit. The ``numbers``,
        by the paths of the values, are those of their parameters in the fit, from 0. The
        ``correlation`` (p, p) is that of the errors of all p parameters of the fit.
        """
        for first, second in combinations(numbers, 2):
            # rounding may put a correlation beyond -1 or 1
            bounded = float(np.clip(correlation[numbers[first], numbers[second]], -1.0, 1.0))
            names = name_keys(_spell_out(first)), name_keys(_spell_out(second))
            self.correlations.append((*names, bounded))

    def _add_fitted(self, keys: Keys, name_of_file: str, fit: Any) -> int:
        """Add the value that the ``fit`` has found for the path ``keys`` of a scene, with its
        standard error; return the number, from 0, of the parameter in the fit. Messages call the
        fit by the ``name_of_file``.

        Refused if the fit does not have the parameter or has another kind of spread, and if the
        standard error is not known.
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
        of a number and a unit if it has one.
        """
        self.values[keys] = value
        self.errors[_spell_out(keys)] = error


def _spell_out(keys: Keys) -> Keys:
    """Return the path at which :func:`granphon.scene.file.write_blocks` writes the value that the
    document has at the path ``keys``: the same path, but for {normal: 20 um}, which is written as
    {normal: {std: 20 um, cutoff: ...}}, and for the list {measured: [8 mm, ...]}, which is written
    as {measured: {diameters: [8 mm, ...]}}.
    """
    if keys[-1] == "normal":
        return (*keys, "std")
    *path_of_list, key = keys
    if isinstance(key, int) and path_of_list[-1] == "measured":
        return (*path_of_list, "diameters", key)
    return keys


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
    from granphon.fits.transfer import read_fit  # other scenes need no fits

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
    """Return words for the reason why no errors of p parameters, one at least, have a
    ``covariance`` (p, p). An empty text without such a reason, and for a ``covariance`` that is not
    finite.
    """
    if not np.all(np.isfinite(covariance)):
        return ""  # the errors are not known, which is refused where one of them is taken
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
    factor by which the value of the fit is multiplied to give that of the scene. The fit need not
    have the parameter.

    The factor is not 1 for a spread, whose number in the scene may be a standard deviation where
    the fit has the width. Refused for a spread of another kind than that of the fit.
    """
    if "spread" in keys:
        spread = getattr(getattr(fit, "packing", None), "spread", None)
        kind = getattr(spread, "kind", "")
        if kind not in _NUMBERS_OF_SPREADS or kind not in keys:
            found = f"a fit of a spread that is {kind}" if kind else "a fit without a spread"
            raise Refused(found, "the same kind of spread", path=keys)
        return "width", getattr(spread, _NUMBERS_OF_SPREADS[kind]) / fit.width
    index = keys[-1]
    if not isinstance(index, int):
        return index, 1.0
    # a value in a list has the name of the key of the list, but for the second number of a loss
    key = str(keys[-2])
    return SECOND_LOSSES.get(key, key) if index == 1 else key, 1.0
