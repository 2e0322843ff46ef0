"""Standard errors of the parameters of a scene, and those that follow for its results.

To first order a result X has the standard error

    sigma_X^2  =  sum over parameters p, q of  (dX/dp sigma_p) rho_pq (dX/dq sigma_q)

with the correlations rho of the errors, zero unless the scene gives them. dX/dp sigma_p is half the
difference of X in two scenes, in one of which p is larger by its standard error, and in the other
smaller: a central difference, through all that the scene computes. The part of p in the variance is
its row of the sum. Errors of sampling, which simulations have, add up with these.

As parameters change, waves of an edge enter the bands and leave them, gaps close, and peaks of a
response come and go: the first wave, gap or peak at the two ends of an error may be another one
than that at its centre, or there may be none. So their derivatives are those of a small change,
within which each wave, gap and peak stays itself.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from copy import copy
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.balls.ball import Ball
from granphon.base.arrays import Array, Flags
from granphon.base.errors import GranphonError, Refused
from granphon.base.quantities import NUMBER, PERCENT, find_factor, find_written_unit
from granphon.base.settings import space_evenly
from granphon.base.text import Document, list_names, show
from granphon.base.validation import real_number
from granphon.observables.catalogue import CATALOGUE
from granphon.runs.tasks import to_json
from granphon.scene.file import SceneSource, write_blocks
from granphon.scene.file_keys import Context
from granphon.scene.written_errors import Keys, name_keys
from granphon.waves.settings import RESPONSES

if TYPE_CHECKING:
    from granphon.runs.dataset import Dataset

#: pattern of a quantity as text: a number and its unit, which may be empty
_QUANTITY = re.compile(rf"\s*({NUMBER})\s*(.*?)\s*", re.DOTALL)
#: ending of the name of the standard error of a number
_ERROR_ENDING = "_error"
#: relative change of a number that is put down to rounding
_ROUNDING = 1e-12
#: the same of numbers that are less precise, by name: derivatives by parameters are differences
_ROUNDINGS = {"sensitivity": 1e-8}
#: second difference of a frequency for a small change, over the frequency, above which another peak
#: or wave has taken the place at one end; for the same peak or wave it is about the square of the
#: change, 1e-8
_GREATEST_SECOND_DIFFERENCE = 1e-3
#: dimension along which a density of states has its own frequencies in each state, and the variable
#: of these frequencies; densities of two states are compared at equal frequencies
_NODE_DIMENSION = "node"
_NODE_FREQUENCIES = "dos_frequency"
#: the last dimension of variables whose numbers stand by rank, and the variable with the frequency
#: of each rank: peaks of a response, and waves of an edge
_FREQUENCIES_OF_RANKS = {"response_peak": "peaks_frequency", "surface_wave": "surface_frequency"}
#: the observables some of whose numbers have the derivatives of small changes, and the names of
#: these numbers in data sets and summaries: those of waves of an edge, of gaps, and of peaks
_NUMBERS_OF_OBSERVABLES = {
    "surface": [name for name, entry in CATALOGUE.items() if entry.cost == "surface"],
    "gaps": ["gaps", "gap_lower", "gap_upper"],
    "response": [
        f"{peak}_{name}"
        for peak in ("peak", "peaks")
        for name in ("frequency", *RESPONSES.values(), "quality")
    ],
}
#: all these names
_NUMBERS_BY_SMALL_CHANGES = frozenset(chain.from_iterable(_NUMBERS_OF_OBSERVABLES.values()))
#: small change of a parameter, over its value: frequencies of waves change by far more than the
#: 1e-10 to which they are known, and by so little that no other wave comes between
_SMALL_CHANGE = 1e-4
#: small change of a parameter that is zero, over its error
_SMALL_PART = 1e-2
#: relative change of a number by a small change of a parameter that is put down to rounding
_ROUNDING_OF_SMALL_CHANGES = 1e-10


def settle_errors(scene: Any) -> tuple[tuple[Keys, float], ...]:
    """Return the standard errors of a scene, SI, each behind the path of its parameter in the file.
    The scene may have an error as a text of a number and a unit, such as "1 %".

    Raises :class:`~granphon.base.errors.Refused` for an error that is no finite number above zero,
    or has a unit of another kind; for an error as large as its value or larger, unless the value is
    zero; and for the error of a parameter that is a whole number, or is not a single quantity.
    """
    blocks = _write(scene)
    settled_errors = []
    for keys, error in scene.errors:
        number, unit = _split_plain(_look_up(blocks, keys), keys)
        size = _read_error(error, number, unit, keys)
        if not 0.0 < size < np.inf:
            raise Refused(f"a standard error of {size:g}", "a finite one above zero", path=keys)
        if number and size >= abs(number):
            raise Refused(
                f"a standard error of {size:g}, as large as the value {number:g}",
                "one below the value, as errors are of first order",
                path=keys,
            )
        settled_errors.append((keys, size))
    return tuple(settled_errors)


def _read_error(error: Any, number: float, unit: str, keys: Keys) -> float:
    """Return the size, in the SI ``unit`` of a ``number``, of its standard ``error``: a number in
    this unit, or a text of a number and a unit, "1 %". Refused, at the path ``keys`` of the number,
    for any other error, such as a nan. An infinite size, or one below zero, is returned.
    """
    if isinstance(error, str):
        match = _QUANTITY.fullmatch(error)
        if match is not None:
            size, unit_of_error = match.groups()
            return float(size) * _find_factor(unit_of_error, number, unit, keys)
    size_in_unit = real_number(error)
    if np.isnan(size_in_unit):
        raise Refused(f"a standard error {show(error)}", "a number, or a text as '1 %'", path=keys)
    return size_in_unit


def _find_factor(unit_of_error: str, number: float, unit: str, keys: Keys) -> float:
    """Return the factor from the unit of a standard error, ``unit_of_error``, to the SI ``unit`` of
    the ``number`` that has the error: for "%" a hundredth of the magnitude of the ``number``.
    Refused, at the path ``keys`` of the number, if the two units are of different kinds.
    """
    if unit_of_error == PERCENT:
        return 0.01 * abs(number)
    factor = find_factor(unit_of_error, unit) if unit or unit_of_error else 1.0
    if factor is None:
        found = f"a standard error in {unit_of_error or 'no unit'}"
        raise Refused(found, f"one in {unit or 'no unit'}, or in %", path=keys)
    return factor


def settle_correlations(scene: Any) -> tuple[tuple[str, str, float], ...]:
    """Return the correlations of the errors of a scene, each as the full names of two parameters,
    such as "material.young_modulus", and the correlation. The scene may have the ends of these
    names, such as "young_modulus".

    Raises :class:`~granphon.base.errors.Refused` for a name that fits no parameter with a standard
    error, or several; for a pair that is given twice, or that is one parameter twice; and for
    correlations whose matrix is not positive semidefinite, which no errors have.
    """
    names = [name_keys(keys) for keys, _ in scene.errors]
    correlation_of_pair: dict[frozenset[str], tuple[str, str, float]] = {}
    for first, second, value in scene.correlations:
        path = ("correlations", f"{first}, {second}")
        pair = [_find_name(name, names, path) for name in (first, second)]
        if len(set(pair)) < 2 or frozenset(pair) in correlation_of_pair:
            twice = "a pair twice" if len(set(pair)) > 1 else f"{pair[0]} twice"
            raise Refused(twice, "each pair of two parameters once", path=path)
        correlation_of_pair[frozenset(pair)] = (*pair, value)
    correlations = tuple(correlation_of_pair.values())
    smallest_eigenvalue = float(
        np.linalg.eigvalsh(make_matrix(names, correlations)).min(initial=0.0)
    )
    if smallest_eigenvalue < -_ROUNDING * len(names):
        raise Refused(
            "correlations that no errors have: an eigenvalue of their matrix is"
            f" {smallest_eigenvalue:.2g}",
            "a positive semidefinite matrix",
            path=("correlations",),
        )
    return correlations


def _find_name(name: str, names: Sequence[str], path: tuple[str, ...]) -> str:
    """Return the one of the full ``names`` of parameters that is ``name``, or ends in a point and
    ``name``. Refused, at ``path`` in the file, if there is no such name, or if there are several.
    """
    matches = [full_name for full_name in names if f".{full_name}".endswith(f".{name}")]
    if len(matches) != 1:
        allowed = f"one of the parameters with a standard error: {list_names(matches or names)}"
        raise Refused(show(name), allowed, path=path)
    return matches[0]


def make_matrix(names: Sequence[str], correlations: Sequence[tuple[str, str, float]]) -> Array:
    """Return the matrix (p, p) of the correlations of the errors of the parameters ``names``, from
    the ``correlations`` of pairs of these names; pairs that are not among them have zero.
    """
    matrix = np.eye(len(names))
    for first, second, value in correlations:
        row = names.index(first)
        column = names.index(second)
        matrix[row, column] = value
        matrix[column, row] = value
    return matrix


def list_parameters(scene: Any) -> list[tuple[str, float, float, str]]:
    """Return the name, the value, the standard error and the SI unit of each parameter of a scene
    that has an error; the unit of a pure number is empty.
    """
    blocks = _write(scene)
    parameters = []
    for keys, error in scene.errors:
        number, unit = _split_plain(_look_up(blocks, keys), keys)
        parameters.append((name_keys(keys), number, error, unit))
    return parameters


def find_state_errors(scene: Any, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return the standard errors of ``numbers`` of the states of a scene as
    :meth:`ErrorPropagation.summarise` does. The ``numbers`` are by name, as
    :meth:`granphon.runs.plan.Plan.collect` returns them. The same numbers are computed for the two
    shifted scenes of each parameter; Refused if one of these scenes is not valid.
    """
    names = [*numbers]
    pairs = [
        (lower.plan.collect(names), upper.plan.collect(names)) for lower, upper in scene.shifted
    ]
    return ErrorPropagation.of(scene, pairs).summarise(numbers)


def write_errors(scene: Any, blocks: dict[str, Any]) -> None:
    """Write the standard errors of a scene behind the quantities in its ``blocks``, plain data that
    are changed in place.
    """
    _write_lists(scene, blocks)
    for keys, error in scene.errors:
        plain = _look_up(blocks, keys)
        _replace(blocks, keys, f"{plain} +- {error!r} {find_written_unit(plain)}".strip())


def shift_scene(scene: Any, keys: Keys, change: float, observed: Sequence[str] = ()) -> Any:
    """Return the ``scene`` with another value of the parameter at the path ``keys``: larger by
    ``change``, SI, or smaller if ``change`` is below zero. The returned scene has no standard
    errors, and observes the names in ``observed``, or without names what the ``scene`` observes.

    Refused, at this path, if the scene is not valid with the changed value, if its sweep replaces
    the parameter, or if there is no single quantity.
    """
    blocks = _write(scene)
    if observed:
        blocks["observe"] = [*observed]
    number, unit = _split_plain(_look_up(blocks, keys), keys)
    shifted = number + change
    _replace(blocks, keys, f"{shifted!r} {unit}" if unit else shifted)
    document = Document("", blocks, {})
    try:
        shifted_scene = type(scene)(**SceneSource(document, scene.origin.path).read())
        shifted_scene.plan.require()
    except GranphonError as error:
        found = f"a standard error of {abs(change):g}, with which the value is {shifted:g}"
        # the refusal has the place of the standard error, so that the message need not name it
        reason = str(error).removeprefix(":1: ").removeprefix(f"{name_keys(keys)}: ")
        raise Refused(found, "one with which there are results", reason, keys) from None
    _require_an_effect(scene, shifted_scene, keys, abs(change))
    return shifted_scene


def _require_an_effect(scene: Any, shifted_scene: Any, keys: Keys, error: float) -> None:
    """Raise Refused, at the path ``keys`` of a parameter, if the sweep of a ``scene`` gives all
    values of the parameter, so that no state has its standard ``error``, SI: the states of the
    ``shifted_scene``, in which the parameter is changed, are then those of the ``scene``.
    """
    grid = scene.plan.grid
    shifted_grid = shifted_scene.plan.grid
    if not grid.axes or _are_same(grid.change({}), shifted_grid.change({})):
        # no axis replaces what is neither of the balls nor of their waves, such as the load
        return
    for case, shifted_case in zip(grid.cases, shifted_grid.cases, strict=True):
        balls_and_request = (case.packing, case.request)
        if case.load != shifted_case.load or not _are_same(
            balls_and_request, (shifted_case.packing, shifted_case.request)
        ):
            return  # this state has the error
    names_of_axes = [axis.name for axis in grid.axes]
    both_grids = (grid, shifted_grid)
    # the axes each of which alone undoes the change; it may take several of them
    names_of_undoing_axes = [
        axis.name
        for axis in grid.axes
        if _are_same(*(either.change({axis.name: axis.values[0]}) for either in both_grids))
    ]
    names = names_of_undoing_axes or names_of_axes
    raise Refused(
        f"a standard error of {error:g}, which no state has",
        "standard errors of what the sweep leaves",
        f"The sweep of {' and '.join(names)} gives all values. Write an error behind"
        " each of them, as in '8 mm +- 4 um'.",
        keys,
    )


def _are_same(first: tuple[Any, Any], second: tuple[Any, Any]) -> bool:
    """Return whether the ``first`` and the ``second`` pair, each of balls and of the request of
    their states, describe the same states. The pairs are those of two scenes that differ in one
    number, so that of the requests only what a sweep may change is compared: the settings of waves,
    of an edge and of bands.
    """
    (balls, request), (other_balls, other_request) = first, second
    settings = (request.waves, request.surface, request.bands)
    return bool(
        balls == other_balls
        and settings == (other_request.waves, other_request.surface, other_request.bands)
    )


def is_by_small_change(name: str) -> bool:
    """Return whether the standard error of the number called ``name``, of a summary or a data set,
    is found by a small change of each parameter: that of a wave of an edge, a gap or a peak.
    """
    return name in _NUMBERS_BY_SMALL_CHANGES


def shift_slightly(scene: Any) -> list[tuple[Any, Any]]:
    """Return for each parameter with a standard error two scenes: the parameter is a little smaller
    in the first, and a little larger in the second. Of what the given ``scene`` observes they
    observe the waves of an edge, gaps and responses alone. Empty if the ``scene`` observes none of
    these. Raises :class:`~granphon.base.errors.Refused` as :func:`shift_scene` does.
    """
    observed = [word for word in scene.observe if word in _NUMBERS_OF_OBSERVABLES]
    if not observed:
        return []
    return [
        (shift_scene(scene, keys, -change, observed), shift_scene(scene, keys, change, observed))
        for (keys, _), (_, change) in zip(scene.errors, _list_small_changes(scene), strict=True)
    ]


def list_errors_by_small_changes(dataset: Dataset, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return the standard errors of those ``numbers`` of a summary that small changes give, see
    :func:`is_by_small_change`, from the ``dataset`` of its only state, in the form of
    :meth:`ErrorPropagation.summarise`. A number without an error in the ``dataset`` has none.
    """
    errors: dict[str, Any] = {}
    sources: dict[str, str] = {}
    error: Any
    for name in filter(is_by_small_change, numbers):
        if name == "gaps":
            error, variable = _list_gap_errors(dataset)
        else:
            variable = dataset.get(f"{name}{_ERROR_ENDING}")
            error = None if variable is None else variable.values.item()
        if variable is not None:
            errors[f"{name}{_ERROR_ENDING}"] = error
            sources[name] = variable.attrs["mostly_from"]
    return errors | {"errors_from": sources}


def _list_gap_errors(dataset: Dataset) -> tuple[list[list[float]], Any]:
    """Return the standard errors, Hz, of the lower and the upper edge of each gap of the only state
    in a ``dataset``, and the variable of the errors of the upper edges, or of the lower edges if no
    parameter acts on the upper; no errors and None if no parameter acts on any edge.
    """
    variables = [dataset.get(f"{edge}{_ERROR_ENDING}") for edge in ("gap_lower", "gap_upper")]
    known_variables = [variable for variable in variables if variable is not None]
    if not known_variables:
        return [], None
    # edges on which no parameter acts, as the lower one at zero, have no variable
    errors = [
        np.zeros(known_variables[0].size) if variable is None else variable.values.ravel()
        for variable in variables
    ]
    is_gap = np.isfinite(dataset["gap_lower"].values.ravel())
    return np.transpose(errors)[is_gap].tolist(), known_variables[-1]


def _list_small_changes(scene: Any) -> list[tuple[float, float]]:
    """Return for each parameter that has a standard error a small change of it, at most the error
    itself: as a part of the error, and in SI.
    """
    changes = []
    for _, value, error, _ in list_parameters(scene):
        part = min(1.0, _SMALL_CHANGE * abs(value) / error) if value else _SMALL_PART
        changes.append((part, part * error))
    return changes


class ErrorPropagation:
    """The standard errors of results that follow from those of the parameters.

    Attributes
    ----------
    names : names of the p parameters, one or more.
    pairs : for each parameter the results, by name, in two scenes: in the first the parameter is
        smaller by its standard error, or by a part of it, and in the second larger.
    correlations : (p, p) of the errors of the parameters.
    parts : (p,) parts of the errors by which the parameters change; all 1 if none are given.
    rounding : relative change of a number that is put down to rounding.
    lacking : names of results without a known error: the scenes have different numbers of their
        values, as of gaps or peaks. :meth:`find` and :meth:`add_to` add to these names.
    """

    def __init__(
        self,
        names: Sequence[str],
        pairs: Sequence[tuple[Any, Any]],
        correlations: Array,
        parts: Sequence[float] = (),
        rounding: float = _ROUNDING,
    ) -> None:
        """Keep the arguments, which are the attributes. No name is in ``lacking`` yet."""
        self.names = names
        self.pairs = pairs
        self.correlations = correlations
        self.parts = parts or [1.0] * len(names)
        self.rounding = rounding
        self.lacking: dict[str, None] = {}

    @classmethod
    def of(cls, scene: Any, pairs: Sequence[tuple[Any, Any]]) -> ErrorPropagation:
        """Return the propagation to the results of a ``scene``. The ``pairs`` are the results, by
        name, of the shifted scenes of each parameter.
        """
        names = [name_keys(keys) for keys, _ in scene.errors]
        return cls(names, pairs, make_matrix(names, scene.correlations))

    @classmethod
    def of_small_changes(cls, scene: Any, pairs: Sequence[tuple[Any, Any]]) -> ErrorPropagation:
        """Return the propagation to the waves of an edge, the gaps and the peaks of a ``scene``.
        The ``pairs`` are data sets of the two scenes of each parameter that
        :func:`shift_slightly` returns.
        """
        names = [name_keys(keys) for keys, _ in scene.errors]
        parts = [part for part, _ in _list_small_changes(scene)]
        return cls(
            names, pairs, make_matrix(names, scene.correlations), parts, _ROUNDING_OF_SMALL_CHANGES
        )

    def find(
        self, name: str, value: Any, sampling: Any = None, unit: str = ""
    ) -> tuple[Array, str] | None:
        """Return the standard errors of the result ``name``, an array of the shape of its
        ``value``, and the name of the parameter that gives most of them.

        None if no parameter has an effect, and for a value that is not numbers. None too, and
        ``name`` is added to ``lacking``, if a shifted scene has no numbers of the shape of the
        value, or if no error above zero is known and a shifted scene has no number where the value
        has one. Otherwise an error is nan where a shifted scene has no number.
        The standard errors of ``sampling``, of the same shape, add up with those that the
        parameters cause; a nan among them adds nothing. A value in the ``unit`` rad is an angle,
        which a full turn does not change.
        """
        base = _as_numbers(value)
        if base is None:
            return None
        changes = []  # (p, ...)
        for part, pair in zip(self.parts, self.pairs, strict=True):
            lower, upper = (_fit_ranks(results.get(name), base.shape) for results in pair)
            if lower is None or upper is None or not lower.shape == upper.shape == base.shape:
                self.lacking[name] = None
                return None
            rounding = max(self.rounding, _ROUNDINGS.get(name, 0.0))
            changes.append(_find_change(lower, upper, base, unit, rounding) / part)
        # (p, ...): the part of each parameter in the variance, its row of the double sum
        contributions = np.array(changes) * np.tensordot(self.correlations, changes, axes=1)
        # rounding may leave a sum of zero below zero
        variances = np.maximum(np.sum(contributions, axis=0), 0.0)
        if not np.any(variances > 0.0):
            is_unknown = np.isnan(variances) & np.isfinite(base)
            if np.any(is_unknown):
                self.lacking[name] = None
            return None
        if sampling is not None:
            variances = variances + np.square(np.nan_to_num(np.asarray(sampling, float)))
        # (p,): the part of each parameter in the variances of all values together
        shares = np.nansum(contributions.reshape(len(self.names), -1), axis=1)
        return np.sqrt(variances), self.names[int(np.argmax(shares))]

    def find_along(self, columns: Mapping[str, Any], along: str) -> dict[str, Array]:
        """Return the standard errors, by name, of those of the ``columns`` of a table, arrays (n,)
        by name, that the parameters change. Where rows lie ``along`` one of the columns, such as a
        time, the other columns are compared at its values, and it has no errors itself; n is then
        at least 1. Otherwise ``along`` is empty.
        """
        propagation = self
        if along:
            places = np.asarray(columns[along])
            propagation = self._change_results(lambda results: _resample(results, along, places))
        errors: dict[str, Array] = {}
        for name, values in columns.items():
            errors_and_parameter = None if name == along else propagation.find(name, values)
            if errors_and_parameter is not None:
                errors[name], _ = errors_and_parameter
        return errors

    def _change_results(self, change: Callable[[Any], Any]) -> ErrorPropagation:
        """Return the same propagation with ``change(results)`` in place of the results of each
        shifted scene. Both add to the same ``lacking`` names.
        """
        propagation = copy(self)
        propagation.pairs = [(change(lower), change(upper)) for lower, upper in self.pairs]
        return propagation

    def summarise(self, numbers: Mapping[str, Any]) -> dict[str, Any]:
        """Return the standard errors of ``numbers``, by name as NAME_error, and under "errors_from"
        for each name the parameter that gives most of its error. An entry NAME_error among the
        ``numbers`` is the error of sampling of NAME. Numbers without an error that
        :meth:`find` knows are left out.
        """
        errors: dict[str, Any] = {}
        sources: dict[str, str] = {}
        for name, value in numbers.items():
            if name.endswith(_ERROR_ENDING):
                continue
            errors_and_parameter = self.find(name, value, numbers.get(f"{name}{_ERROR_ENDING}"))
            if errors_and_parameter is not None:
                errors_of_value, parameter = errors_and_parameter
                errors[f"{name}{_ERROR_ENDING}"] = errors_of_value.tolist()
                sources[name] = parameter
        return errors | {"errors_from": sources}

    def add_to(self, dataset: Dataset, names: Collection[str] | None = None) -> Dataset:
        """Return the ``dataset`` with a variable NAME_error for the standard error of each
        variable, or of those called ``names``, that the parameters change; its attribute
        ``mostly_from`` is the parameter that gives most of the error.

        Densities of states have errors at the frequencies of the ``dataset``. Errors of peaks of a
        response, and of waves of an edge, are nan as :meth:`_leave_out_changed` says.
        """
        error_variables = {}
        propagation = self
        if _NODE_FREQUENCIES in dataset:
            propagation = self._change_results(
                lambda results: _resample_densities(results, dataset)
            )
        for name, variable in dataset.data_vars.items():
            is_asked = names is None or name in names
            if not is_asked or str(name).endswith(_ERROR_ENDING) or name == _NODE_FREQUENCIES:
                continue
            sampling = dataset.get(f"{name}{_ERROR_ENDING}")
            sampling_errors = None if sampling is None else sampling.values
            unit = str(variable.attrs.get("units", ""))
            errors_and_parameter = propagation.find(
                str(name), variable.values, sampling_errors, unit
            )
            if errors_and_parameter is not None:
                errors, parameter = errors_and_parameter
                attributes = {"units": unit} if unit else {}
                attributes["mostly_from"] = parameter
                errors = self._leave_out_changed(errors, dataset, str(name))
                error_variables[f"{name}{_ERROR_ENDING}"] = (variable.dims, errors, attributes)
        return dataset.assign(error_variables)

    def _leave_out_changed(self, errors: Array, dataset: Dataset, name: str) -> Array:
        """Return the ``errors`` of the variable ``name`` of the ``dataset``. Those of peaks and of
        waves of an edge are nan where :meth:`_find_same` does not find the same peak or wave in all
        shifted scenes; ``name`` is added to ``lacking`` if a value loses its error so. Errors of
        other variables are returned unchanged.
        """
        variable = dataset[name]
        name_of_frequencies = (
            _FREQUENCIES_OF_RANKS.get(str(variable.dims[-1])) if variable.dims else None
        )
        if name_of_frequencies is None:
            return errors
        known_errors = np.where(self._find_same(dataset, name_of_frequencies), errors, np.nan)
        if np.any(np.isnan(known_errors) & np.isfinite(variable.values)):
            self.lacking[name] = None
        return known_errors

    def _find_same(self, dataset: Dataset, name: str) -> Flags:
        """Return, of the shape of the frequencies ``name`` in the ``dataset``, whether each is that
        of the same peak, or of the same wave of an edge, in all shifted scenes.

        The peaks of a receiver, and the waves at a wave vector, are not the same where a scene has
        more of them, or fewer; nor where one peak enters and another leaves, so that the frequency
        of their rank jumps.
        """
        base = dataset[name].values
        # ranks beyond the last peak or wave are nan
        count = np.sum(np.isfinite(base), axis=-1, keepdims=True)
        is_same = np.ones(base.shape, bool)
        for pair in self.pairs:
            for results in pair:
                is_number = np.isfinite(results[name].values)
                is_same &= np.sum(is_number, axis=-1, keepdims=True) == count
            lower, upper = (_pad_ranks(results[name].values, base.shape[-1]) for results in pair)
            second_difference = np.abs(upper + lower - 2.0 * base)
            # nan of ranks without a peak or wave is no jump
            is_same &= ~(second_difference > _GREATEST_SECOND_DIFFERENCE * np.abs(base))
        return is_same


def warn_of_lacking(dataset: Dataset, propagations: Sequence[ErrorPropagation]) -> Dataset:
    """Return the ``dataset`` with one more warning, which names the results whose standard errors
    the ``propagations`` have not found; the same data set if no result lacks its errors.
    """
    # each name once, in order
    names = dict.fromkeys(name for propagation in propagations for name in propagation.lacking)
    if not names:
        return dataset
    why = "their number differs within the errors of the parameters"
    warning = f"no standard errors of {list_names(names)}, or not of all: {why}"
    warnings = [*json.loads(dataset.attrs["warnings"]), warning]
    return dataset.assign_attrs(warnings=to_json(warnings))


def _find_change(lower: Array, upper: Array, base: Array, unit: str, rounding: float) -> Array:
    """Return half the difference of the numbers ``upper`` and ``lower``, which are results of the
    two shifted scenes of a parameter, in the shape of ``base``, the results of the scene itself.

    Half the difference is zero where it is at most ``rounding`` times ``base``, and nan where one
    of the two numbers is not finite. The difference of angles, in the ``unit`` rad, is taken
    between -pi and pi.
    """
    is_known = np.isfinite(lower) & np.isfinite(upper)
    difference = np.subtract(upper, lower, out=np.full(base.shape, np.nan), where=is_known)
    if unit == "rad":
        difference = np.angle(np.exp(1j * difference))
    is_rounding = np.abs(difference) <= 2.0 * rounding * np.abs(base)
    return np.where(is_rounding, 0.0, 0.5 * difference)


def _resample(columns: Mapping[str, Any], along: str, places: Array) -> dict[str, Array]:
    """Return the ``columns`` of a table, arrays (n,) by name, at the ``places`` (m,) of the column
    ``along``, which ascends: linear between its values, and nan beyond them. Empty if the table has
    no such column, as that of a scene without the result.
    """
    if along not in columns:
        return {}
    values_along = np.asarray(columns[along])
    return {
        name: np.interp(places, values_along, values, left=np.nan, right=np.nan)
        for name, values in columns.items()
    }


def _resample_densities(results: Dataset, base: Dataset) -> Dataset:
    """Return the data set of a shifted scene, ``results``, with its densities of states at the
    frequencies of ``base``, the data set of the scene itself; nan beyond the frequencies of the
    shifted scene. A data set without densities is returned as it is.
    """
    if _NODE_FREQUENCIES not in results:
        return results
    base_frequencies = base[_NODE_FREQUENCIES].values  # (..., n)
    frequencies = results[_NODE_FREQUENCIES].values  # (..., m)
    resampled_variables = {}
    for name, variable in results.data_vars.items():
        if _NODE_DIMENSION in variable.dims and name != _NODE_FREQUENCIES:
            values = variable.values
            densities = np.full(base_frequencies.shape, np.nan)
            for state in np.ndindex(base_frequencies.shape[:-1]):
                columns = {_NODE_FREQUENCIES: frequencies[state], str(name): values[state]}
                resampled = _resample(columns, _NODE_FREQUENCIES, base_frequencies[state])
                densities[state] = resampled[str(name)]
            resampled_variables[name] = (base[_NODE_FREQUENCIES].dims, densities, variable.attrs)
    return (
        results.drop_vars([_NODE_FREQUENCIES, *resampled_variables])
        .drop_dims(_NODE_DIMENSION, errors="ignore")
        .assign(resampled_variables)
    )


def _fit_ranks(value: Any, shape: tuple[int, ...]) -> Array | None:
    """Return the ``value`` of a result of a shifted scene as an array of floats, None where
    :func:`_as_numbers` has none.

    A variable of a data set whose numbers stand by rank, as those of peaks do, is cut, or goes on
    with nan, to the last length of ``shape``, the shape of the result of the scene itself. So the
    two can be compared though they have different numbers of ranks.
    :meth:`ErrorPropagation._find_same` says which ranks are those of the same peak or wave.
    """
    numbers = _as_numbers(value)
    dims = getattr(value, "dims", ())
    if numbers is None or not dims or dims[-1] not in _FREQUENCIES_OF_RANKS:
        return numbers
    return _pad_ranks(numbers, shape[-1])


def _pad_ranks(numbers: Array, length: int) -> Array:
    """Return ``numbers`` with a last dimension of this ``length``: it is cut there, or goes on with
    nan.
    """
    n_missing = max(0, length - numbers.shape[-1])
    widths = [(0, 0)] * (numbers.ndim - 1) + [(0, n_missing)]
    return np.pad(numbers, widths, constant_values=np.nan)[..., :length]


def _as_numbers(value: Any) -> Array | None:
    """Return a value as an array of floats; None if the value is not real numbers, or is empty."""
    if value is None or isinstance(value, str | bool | Mapping):
        return None
    try:
        array = np.asarray(value)
    except ValueError:  # lists of different lengths
        return None
    return array.astype(float) if array.dtype.kind in "fi" and array.size else None


def _write(scene: Any) -> dict[str, Any]:
    """Return the blocks of a scene as plain data in SI, without correlations.

    Masses and moments of inertia are left out where they follow from the density and the diameter
    of a solid ball: where a density or diameter is shifted, the mass and the inertia are to follow.
    Values are lists where the path of a standard error leads into a list, see :func:`_write_lists`.
    """
    blocks = write_blocks(scene, Context(scene.packing.structure))
    blocks.pop("correlations", None)
    kinds = scene.packing.kinds if scene.packing.kind_names else ()
    error_of_path = dict(scene.errors)
    for kind, ball in kinds:
        solid = Ball(ball.material, ball.diameter)
        for name in ("mass", "inertia"):
            path = ("balls", kind, name)
            if getattr(ball, name) == getattr(solid, name) and path not in error_of_path:
                blocks["balls"][kind].pop(name, None)
    _write_lists(scene, blocks)
    return blocks


def _write_lists(scene: Any, blocks: dict[str, Any]) -> None:
    """Replace in ``blocks``, in place, each value that has an error at an index in the file by a
    list, so that the path of the error leads into the list. :func:`write_blocks` writes a list of
    one value as the value itself, values that are evenly spaced as a range, and vectors as tuples.
    Other entries, to which no path of an error leads, are left.
    """
    for (*path_of_list, key), _ in scene.errors:
        if not isinstance(key, int):
            continue
        for depth in range(1, len(path_of_list) + 1):
            entry = _look_up(blocks, path_of_list[:depth])
            if isinstance(entry, tuple):
                _replace(blocks, path_of_list[:depth], list(entry))
            elif isinstance(entry, Mapping) and "points" in entry and depth == len(path_of_list):
                _replace(blocks, path_of_list, _list_range(entry))
            elif isinstance(entry, str | float) and depth == len(path_of_list):
                _replace(blocks, path_of_list, [entry])


def _list_range(entry: Mapping[str, Any]) -> list[Any]:
    """Return the quantities of a range, each as plain data; the ``entry`` is the range as
    :func:`write_blocks` writes it.
    """
    ends = [str(entry[key]).partition(" ") for key in ("from", "to")]
    first, last = (float(number) for number, _, _ in ends)
    unit = ends[0][2]
    numbers = space_evenly(first, last, entry["points"], entry["scale"])
    return [f"{number!r} {unit}" if unit else number for number in numbers]


def _look_up(blocks: Any, keys: Sequence[str | int]) -> Any:
    """Return the entry of ``blocks``, nested mappings and lists, at the path ``keys``; None if
    there is none.
    """
    entry = blocks
    for key in keys:
        if isinstance(entry, str):
            return None  # a text is not a list of letters
        try:
            entry = entry[key]
        except (KeyError, IndexError, TypeError):
            return None
    return entry


def _replace(blocks: Any, keys: Sequence[str | int], entry: Any) -> None:
    """Put an ``entry`` into ``blocks`` at the path ``keys``, in place. The path must lead to an
    entry, and the last mapping or list on it must not be a tuple.
    """
    _look_up(blocks, keys[:-1])[keys[-1]] = entry


def _split_plain(plain: Any, keys: Keys) -> tuple[float, str]:
    """Return the number and the SI unit of a quantity in ``plain`` data, "211e9 Pa" or a number
    without unit. Refused, at its path ``keys``, for a whole number and for anything else.
    """
    is_whole = isinstance(plain, int) and not isinstance(plain, bool)
    match = _QUANTITY.fullmatch(str(plain)) if isinstance(plain, str | float) else None
    if match is None:
        found = "a standard error of a whole number" if is_whole else "a standard error"
        raise Refused(found, "those of quantities that are written alone", path=keys)
    number, unit = match.groups()
    return float(number), unit
