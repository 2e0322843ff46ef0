"""Standard errors of the parameters of a scene, and those that follow for its results.

A quantity may have its standard error, as "211.65 +- 2 GPa" or "8 mm +- 4 um". To first order a
result X has the standard error

    sigma_X^2  =  sum over parameters p of (dX/dp sigma_p)^2

if the parameters are independent. Each term is half the difference of X in two scenes, in one of
which p is larger by its standard error, and in the other smaller: a central difference, through all
that the scene computes. Errors of sampling, which simulations have, add up with these.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.balls.ball import Ball
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.quantities import NUMBER, find_factor, find_written_unit
from granphon.base.text import Document
from granphon.scene.file import SceneSource, write_blocks
from granphon.scene.rules import Context

if TYPE_CHECKING:
    from granphon.runs.dataset import Dataset

_Path = tuple[str | int, ...]
#: a number and its unit
_VALUE = re.compile(rf"\s*({NUMBER})\s*(.*?)\s*", re.DOTALL)
#: ending of the name of the standard error of a number
_ERROR = "_error"
#: relative change of a number that is put down to rounding
_ROUNDING = 1e-12


def settle_errors(scene: Any) -> tuple[tuple[_Path, float], ...]:
    """Return the standard errors of a scene in SI, each with the path of its parameter in the file.

    Raises :class:`~granphon.base.errors.InputError` for an error that is not above zero or has a
    unit of another kind, and for one of what is no single quantity.
    """
    blocks = _write(scene)
    settled = []
    for path, error in scene.errors:
        name = name_parameter(path)
        number, unit = _split_plain(_look_up(blocks, path), name)
        size = error
        if isinstance(error, str):
            text, _, unit_of_error = error.partition(" ")
            factor = find_factor(unit_of_error, unit) if unit or unit_of_error else 1.0
            if factor is None:
                why = f"{unit_of_error or 'no unit'} and {unit or 'no unit'} are of two kinds"
                raise InputError(f"the standard error of {name} is not in its unit", why)
            size = float(text) * factor
        if not 0.0 < size < np.inf:
            raise InputError(f"the standard error of {name} is {size:g}, which is not above zero")
        if number and abs(size) >= abs(number):
            raise InputError(
                f"the standard error of {name} is as large as {name} itself",
                "Errors are of first order, of parameters that are known well",
            )
        settled.append((path, float(size)))
    return tuple(settled)


def write_errors(scene: Any, blocks: dict[str, Any]) -> None:
    """Write the standard errors of a scene behind the quantities in its ``blocks``."""
    for path, error in scene.errors:
        plain = _look_up(blocks, path)
        _replace(blocks, path, f"{plain} +- {error!r} {find_written_unit(plain)}".strip())


def shift_scene(scene: Any, path: _Path, change: float) -> Any:
    """Return the scene with the parameter at a ``path`` larger by ``change``, SI, and without
    standard errors.
    """
    blocks = _write(scene)
    number, unit = _split_plain(_look_up(blocks, path), name_parameter(path))
    shifted = number + change
    _replace(blocks, path, f"{shifted!r} {unit}" if unit else shifted)
    document = Document(name_parameter(path), blocks, {})
    return type(scene)(**SceneSource(document, scene.origin.path).read())


def name_parameter(path: _Path) -> str:
    """Return the name of the parameter at a ``path`` of the file, "material.young_modulus"."""
    return ".".join(map(str, path))


class Spread:
    """The standard errors that follow from those of the parameters.

    Attributes
    ----------
    names : of the parameters.
    pairs : for each parameter the results at its smaller and at its larger value, by name.
    """

    def __init__(self, names: Sequence[str], pairs: Sequence[tuple[Any, Any]]) -> None:
        self.names = names
        self.pairs = pairs

    def find(self, name: str, value: Any, sampling: Any = None) -> tuple[Array, str] | None:
        """Return the standard errors of the ``value`` of a ``name``, and the parameter that gives
        most of these; None where no parameter has an effect, and for what is no number. The errors
        of ``sampling`` add up with these.
        """
        base = _as_numbers(value)
        if base is None:
            return None
        changes = []
        for pair in self.pairs:
            lower, upper = (_as_numbers(results.get(name)) for results in pair)
            if lower is None or upper is None or not lower.shape == upper.shape == base.shape:
                return None
            is_known = np.isfinite(lower) & np.isfinite(upper)
            unknown_changes = np.full(base.shape, np.nan)
            change = 0.5 * np.subtract(upper, lower, out=unknown_changes, where=is_known)
            changes.append(np.where(np.abs(change) <= _ROUNDING * np.abs(base), 0.0, change))
        variances = np.square(changes)
        if not np.any(variances > 0.0):
            return None
        sampling_variances = (
            0.0 if sampling is None else np.square(np.nan_to_num(np.asarray(sampling, float)))
        )
        total = np.sqrt(np.sum(variances, axis=0) + sampling_variances)
        shares = np.nansum(variances.reshape(len(self.names), -1), axis=1)
        return total, self.names[int(np.argmax(shares))]

    def summarise(self, numbers: Mapping[str, Any]) -> dict[str, Any]:
        """Return the standard errors of ``numbers``, by name as NAME_error, and under "errors_from"
        the parameter that gives most of each.
        """
        errors: dict[str, Any] = {}
        sources: dict[str, str] = {}
        for name, value in numbers.items():
            errors_of_value = None
            if not name.endswith(_ERROR):
                errors_of_value = self.find(name, value, numbers.get(f"{name}{_ERROR}"))
            if errors_of_value is not None:
                errors[f"{name}{_ERROR}"] = errors_of_value[0].tolist()
                sources[name] = errors_of_value[1]
        return errors | {"errors_from": sources}

    def add_to(self, dataset: Dataset) -> Dataset:
        """Return a data set with the standard error of each variable, NAME_error, whose attribute
        ``mostly_from`` is the parameter that gives most of it.
        """
        added = {}
        for name, variable in dataset.data_vars.items():
            errors_of_variable = None
            if not str(name).endswith(_ERROR):
                sampling = dataset.get(f"{name}{_ERROR}")
                sampling_errors = None if sampling is None else sampling.values
                errors_of_variable = self.find(str(name), variable.values, sampling_errors)
            if errors_of_variable is not None:
                error, source = errors_of_variable
                units = {key: text for key, text in variable.attrs.items() if key == "units"}
                attributes = {**units, "mostly_from": source}
                added[f"{name}{_ERROR}"] = (variable.dims, error, attributes)
        return dataset.assign(added)


def _as_numbers(value: Any) -> Array | None:
    """Return an array of real numbers; None if the value is none."""
    if value is None or isinstance(value, str | bool | Mapping):
        return None
    try:
        array = np.asarray(value)
    except ValueError:  # lists of different lengths
        return None
    return array.astype(float) if array.dtype.kind in "fi" and array.size else None


def _write(scene: Any) -> dict[str, Any]:
    """Return the blocks of a scene as plain data in SI, without masses and moments of inertia that
    follow from the density and the diameter of a ball, as these may change.
    """
    blocks = write_blocks(scene, Context(scene.packing.structure))
    kinds = scene.packing.kinds if scene.packing.kind_names else ()
    uncertain = dict(scene.errors)
    for kind, ball in kinds:
        solid = Ball(ball.material, ball.diameter)
        for name in ("mass", "inertia"):
            path = ("balls", kind, name)
            if getattr(ball, name) == getattr(solid, name) and path not in uncertain:
                blocks["balls"][kind].pop(name, None)
    return blocks


def _look_up(blocks: Any, path: _Path) -> Any:
    """Return the entry of the blocks at a ``path``; None if there is none."""
    entry = blocks
    for key in path:
        try:
            entry = entry[key]
        except (KeyError, IndexError, TypeError):
            return None
    return entry


def _replace(blocks: Any, path: _Path, entry: Any) -> None:
    """Put an entry at a ``path`` of the blocks."""
    _look_up(blocks, path[:-1])[path[-1]] = entry


def _split_plain(plain: Any, name: str) -> tuple[float, str]:
    """Return the number and the SI unit of a quantity as it is written; InputError if the
    parameter of this ``name`` is none.
    """
    match = _VALUE.fullmatch(str(plain)) if not isinstance(plain, bool) else None
    if match is None:
        raise InputError(
            f"{name} has a standard error, and is no single quantity",
            mend="Give errors of quantities that are written alone",
        )
    number, unit = match.groups()
    return float(number), unit
