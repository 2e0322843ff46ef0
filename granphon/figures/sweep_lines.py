"""What a sweep holds, as the lines of a figure: a curve for each medium, combination of parameters and direction."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.balls.lattices import find_lattice
from granphon.balls.packing import Packing
from granphon.base.errors import FigureError, InputError, message
from granphon.base.quantities import LOADS
from granphon.base.results import restore
from granphon.figures.curves import Curve
from granphon.figures.style import readable_unit
from granphon.figures.words import describe_medium, describe_overlap, describe_parameter, list_facts
from granphon.media.choice import AutoMedium
from granphon.media.simulation import DirectSimulation
from granphon.runs.dataset import list_finite_overlap

if TYPE_CHECKING:
    from granphon.runs.dataset import Dataset


#: the largest number on an axis; matplotlib overflows where it draws margins and ticks beyond
_LARGEST = 1e280


def find_load(dataset: Dataset) -> str:
    """Return the name of the load that was given: a coordinate along the loads."""
    return next((str(name) for name in LOADS if name in dataset.coords and dataset[name].dims == ("load",)), "force")


def is_simulated(dataset: Dataset, index: dict[str, int]) -> bool:
    """Return whether the medium at ``index`` is a simulation, by its label."""
    return _name_medium(dataset, index) == DirectSimulation.name


def drop_directions(dataset: Dataset, variable: str) -> Dataset:
    """Return the sweep without its directions, if a variable is the same in all: its lines are those of the media."""
    same = variable in dataset and "direction" not in dataset[variable].dims
    return dataset.drop_dims("direction", errors="ignore") if same else dataset


def read_values(dataset: Dataset, name: str) -> Any:
    """Return a variable over the load; :class:`InputError` if it cannot be drawn, FigureError beyond matplotlib's axes."""
    if name not in dataset.variables:
        known = ", ".join(map(str, dataset.data_vars))
        raise InputError(message(f"the sweep has no variable {name!r}", f"It has {known}"))
    values = dataset[name]
    extra = set(values.dims) - {"load", "medium", *list_parameters(dataset)}
    if "load" not in values.dims or values.dtype.kind not in "fiub" or extra:
        raise InputError(message(f"{name!r} is not one number at each load", mend="Draw another variable"))
    if not np.any(np.isfinite(values)):
        raise InputError(message(f"{name!r} has no finite value", mend="Draw another variable"))
    sizes = np.abs(np.asarray(values, float))
    far = (np.isfinite(sizes) & (sizes > _LARGEST)) | ((sizes > 0.0) & (sizes < 1.0 / _LARGEST))
    if np.any(far):
        what = f"{name!r} has the value {np.asarray(values)[far].flat[0]:g}"
        why = f"Figures have axes from {1.0 / _LARGEST:g} to {_LARGEST:g}"
        raise FigureError(message(what, why, "Draw another variable"))
    return values


def pick_evenly(count: int, most: int) -> list[int]:
    """Return the numbers of at most ``most`` of ``count`` things, evenly taken, the first and the last among them."""
    chosen: list[int] = np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()
    return chosen


def list_parameters(dataset: Dataset) -> list[str]:
    """Return the dimensions of the sweep besides load and medium: its parameters, and directions if there are many."""
    along = ("direction",) * ("direction" in dataset.dims)
    return [str(name) for name in (*dataset["valid"].dims, *along) if name not in ("load", "medium")]


def list_combinations(dataset: Dataset) -> list[tuple[str, dict[str, int]]]:
    """Return every combination of parameters: the values of those that vary, in words, and the index of each parameter."""
    names = list_parameters(dataset)
    words = {name: [f"{name.replace('_', ' ')} {label}" for label in write_labels(dataset, name)] for name in names}
    several = [name for name in names if dataset.sizes[name] > 1]
    places = [dict(zip(names, index, strict=True)) for index in np.ndindex(*(dataset.sizes[name] for name in names))]
    return [(", ".join(words[name][place[name]] for name in several), place) for place in places]


def write_labels(dataset: Dataset, name: str) -> list[str]:
    """Return the names of the values of a dimension in a legend."""
    values = np.atleast_1d(dataset[name].values).tolist()
    if name == "medium":
        return _write_media(dataset)
    if not all(isinstance(value, float) for value in values):
        return [str(value) for value in values]
    number, unit = readable_unit(max(map(abs, values)), dataset[name].attrs.get("units", ""))
    return [f"{value / number:.4g} {unit}".rstrip() for value in values]


def read_packing(dataset: Dataset) -> Packing | None:
    """Return the packing whose parameters a sweep varies; None if the data set does not tell it."""
    told = dataset.attrs.get("packing")
    found: Packing | None = None if told is None else restore(json.loads(told), Packing, "the packing of the sweep")
    return found


def read_curve(
    dataset: Dataset, variable: str, x: str, index: dict[str, int], run: str = "", facts: dict[str, str] | None = None
) -> Curve:
    """Return the curve of a variable over ``x`` at an index of each dimension besides the load."""

    def take(values: Any) -> Any:
        return np.asarray(values.isel(index, missing_dims="ignore"))

    across, along = read_values(dataset, x), read_values(dataset, variable)
    error = dataset.get(f"{variable}_error", dataset[variable] * np.nan)
    served: tuple[str, ...] = ()
    if _name_medium(dataset, index) == AutoMedium.name and "choice" in dataset:
        served = tuple(map(str, take(dataset["choice"]).tolist()))
    horizontal = take(across).astype(float)
    simulated = [one.partition("(")[0] == DirectSimulation.name for one in served] or is_simulated(dataset, index)
    simulated = dataset.attrs.get("points", simulated)  # a fit is a line, whatever its medium
    units = tuple(str(dataset[name].attrs.get("units", "")) for name in (x, variable))
    return Curve(
        run, facts or {}, horizontal, take(along).astype(float), take(error).astype(float), take(dataset["valid"]),
        np.broadcast_to(np.asarray(simulated, bool), horizontal.shape), served, (units[0], units[1]),
        path=_is_path(dataset, index),
    ).sorted()  # fmt: skip


def describe_lines(dataset: Dataset, variable: str) -> list[tuple[dict[str, str], dict[str, int]]]:
    """Return for each line of a variable what it is, in words by kind, and its index in each dimension besides the load."""
    packing = read_packing(dataset)
    finite = list_finite_overlap(dataset)
    base = {} if packing is None else list_facts(packing)
    found, names, media = [], list_parameters(drop_directions(dataset, variable)), _write_media(dataset)
    if "direction" in dataset.coords and "direction" not in names and dataset["direction"].ndim == 0:
        base["direction"] = f"along {dataset['direction'].item()}"
    for place in np.ndindex(*(dataset.sizes[name] for name in names)):
        at = dict(zip(names, place, strict=True))
        facts = dict(base)
        for name, number in at.items():
            value = dataset[name].values[number]
            value = value.item() if hasattr(value, "item") else value
            told = ("direction", f"along {value}") if name == "direction" else describe_parameter(name, value)
            facts[told[0]] = told[1]
        for m, medium in enumerate(media):
            overlap = {} if packing is None else {"overlap": describe_overlap(finite[m])}
            found.append((facts | overlap | {"medium": medium}, at | {"medium": m}))
    return found


def _name_medium(dataset: Dataset, index: dict[str, int]) -> str:
    """Return the name of the medium at ``index``, by its label."""
    return str(np.atleast_1d(dataset["medium"].values)[index["medium"]]).partition("(")[0]


def _is_path(dataset: Dataset, index: dict[str, int]) -> bool:
    """Return whether the medium at ``index`` takes the loads in the order given, up and down."""
    options: dict[str, Any] = next(iter(json.loads(dataset.attrs.get("media", "[{}]"))[index["medium"]].values()), {})
    return bool(options.get("ordered"))


def _write_media(dataset: Dataset) -> list[str]:
    """Return the media of a sweep in words; cells of a lattice that is not told, or varied, are called cells."""
    packing = read_packing(dataset)
    periods, balls = (2, 2) if packing is None else (packing.structure.periods, packing.structure.n_balls)
    if "lattice" in dataset.coords and packing is not None:
        names = [str(name) for name in np.atleast_1d(dataset["lattice"].values)]
        try:
            lattices = [find_lattice(name) for name in names]
            periods, balls = lattices[0].periods, max(one.n_balls for one in lattices)
        except InputError:  # a lattice of the user's own
            balls = 2
    return [describe_medium(str(label), periods, balls) for label in np.atleast_1d(dataset["medium"].values).tolist()]
