"""Paths of loads that end early: what a sweep has of the loads before, and where it is kept.

A sample that is loaded with friction may not reach all loads. Its task is then done as far as it goes: the result has the
loads that were reached, their places among all loads of the task, and why the path ended. When all tasks are done, the sweep
is an error, with the loads that all tasks have reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import ConvergenceError, GranphonError, OutputError
from granphon.base.staging import ResultFiles
from granphon.base.text import counted
from granphon.sweeps.archive import file_names, write_sweep
from granphon.sweeps.store import Store, TaskResult

if TYPE_CHECKING:
    from xarray import Dataset


#: attribute of a data set that says why it lacks loads
INCOMPLETE = "incomplete"
#: in a result: places of the loads that were not reached, why the path ended, and the place of the load at which it did
_MARKS = _MISSED, _WHY, _AT = "path.missed", "path.why", "path.at"


def end_early(part: TaskResult, places: Sequence[int], size: int, error: GranphonError) -> TaskResult:
    """Return a result at the loads in ``places``, of ``size``, marked with the error that ended the path."""
    at = -1 if error.load_index is None else error.load_index
    missed = np.setdiff1d(np.arange(size), places)
    return spread(part, places, size) | {_MISSED: missed, _WHY: np.array([str(error)]), _AT: np.array([at])}


def spread(part: TaskResult, places: Sequence[int], size: int) -> TaskResult:
    """Return a result at the loads in ``places`` with a row for each of all loads; the other rows mean nothing."""
    rows = np.zeros(size, int)
    rows[list(places)] = range(len(places))
    return {name: value if name == "warnings" else value[rows] for name, value in part.items()}


def strip(part: TaskResult) -> TaskResult:
    """Return a result without its marks."""
    return {name: value for name, value in part.items() if name not in _MARKS}


def find_reached(parts: Sequence[TaskResult], size: int) -> list[int]:
    """Return the places of the loads, of ``size``, that all results have; raise the error of a path if there is none."""
    missed = {place for part in parts if _MISSED in part for place in part[_MISSED].tolist()}
    if len(missed) == size:
        raise _explain(parts)
    return [place for place in range(size) if place not in missed]


def mark_as(parts: Sequence[TaskResult], loads: Sequence[NDArray[Any]]) -> TaskResult:
    """Return the marks of what is made of several results, each at some of the ``loads``; nothing if no path ended early."""
    ended = [(part, own) for part, own in zip(parts, loads, strict=True) if _MISSED in part]
    if not ended:
        return {}
    missed = np.unique(np.concatenate([own[part[_MISSED]] for part, own in ended]))
    return {_MISSED: missed} | {name: np.concatenate([part[name] for part, _ in ended]) for name in (_WHY, _AT)}


def require_complete(parts: Sequence[TaskResult], dataset: Dataset) -> None:
    """Raise the error of a path that ended early, if one did; its ``reached`` is the data set without the missing loads."""
    places = find_reached(parts, dataset.sizes["load"])
    if len(places) < dataset.sizes["load"]:
        error = _explain(parts)
        error.reached = dataset.isel(load=places).assign_attrs({INCOMPLETE: str(error)})
        raise error


def _explain(parts: Sequence[TaskResult]) -> ConvergenceError:
    """Return the error of the first path that ended early."""
    whys, places = ([one for part in parts if name in part for one in part[name].tolist()] for name in (_WHY, _AT))
    more = "" if len(whys) == 1 else f" {counted(len(whys) - 1, 'more path')} of the sweep ended early."
    error = ConvergenceError(whys[0] + more)
    error.load_index = places[0] if places[0] >= 0 else None
    return error


# -- files ----------------------------------------------------------------------------------------------------------


def incomplete_files(name: str) -> list[str]:
    """Return the names of the files for the loads that were reached, of a sweep whose result has this ``name``."""
    path = Path(name)
    return file_names(path.with_stem(f"{path.stem}_{INCOMPLETE}"))


def keep_incomplete(error: GranphonError, files: ResultFiles, name: str, store: Store) -> GranphonError:
    """Write the data set that an error has ``reached`` into a folder under lock, and return the error which says so.

    The finished tasks are deleted then. If the files cannot be written, these stay, and the error is returned as it is.
    """
    names, count = incomplete_files(name), error.reached.sizes["load"]
    with suppress(OutputError):
        with replace(files, names=names, force=True, earlier=()).staging() as place:
            write_sweep(error.reached, place / names[0])
        store.clear()
        told = f"The {count} loads that were reached are" if count > 1 else "The load that was reached is"
        return error.restate(f"{error} {told} in {' and '.join(names)} in {files.folder}.")
    return error
