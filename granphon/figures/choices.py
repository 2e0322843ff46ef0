"""What a figure of a sweep shows of its data set: the states that a user chooses, and the panels
among which many curves are shared out; this module does not load matplotlib.

A *parameter* is a dimension of the sweep besides the load and the medium, or the direction of sound
where directions are a dimension.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from granphon.base.arrays import Flags
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import LOADS, Quantity
from granphon.base.scales import write_quantity
from granphon.base.text import list_names, spell, suggest
from granphon.base.validation import require, text, truth
from granphon.figures.style import pick_evenly
from granphon.figures.words import describe_parameter, write_value
from granphon.media.choice import split_label
from granphon.runs.dataset import Dataset, find_load

#: relative difference up to which a number that a user types means a number of the sweep
_TOLERANCE = 5e-3
#: greatest number of shades of a colour that an eye tells apart
MOST_SHADES = 8
#: greatest number of combinations of several parameters, whose shades have no order by which an eye
#: could find one
_MOST_COMBINATIONS = 4
#: greatest number of columns and of rows of panels that a figure chooses by itself; and greatest
#: number of panels if one dimension alone has panels, which then stand in lines of MOST_COLUMNS
MOST_COLUMNS = 3
_MOST_ROWS = 4
_MOST_IN_LINES = 12
#: number of loads that have a curve over a parameter, if there are more than MOST_SHADES loads
_MOST_LOADS = 5
#: greatest number of panels that a user may ask for
_MOST_PANELS = 40
#: a comma between wishes, but not one in parentheses, as in "(1, 0)"
_COMMA = re.compile(r",(?![^(]*\))")
#: quantities of loads, which have no value in words of their own
_LOAD_NAMES = (*LOADS, "reduced_force")


# -- the dimensions of a data set ------------------------------------------------------------------


def require_axes(dataset: Dataset) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a data set without an axis of loads or
    without one of media, from which a single load or medium was chosen.
    """
    for name in ("load", "medium"):
        if name not in dataset.dims:
            raise InputError(
                f"the data set has no dimension {name!r}",
                "Its picture has curves over the load for each medium, and one of these was chosen,"
                " or their mean taken",
                f"Keep all, or choose by a list: isel({name}=[0])",
            )


def list_parameters(dataset: Dataset) -> list[str]:
    """Return the names of the parameters of a data set: all dimensions of the sweep but the load
    and the medium. If directions are a dimension, "direction" follows as the last name. A parameter
    may have a single value.
    """
    names = [str(name) for name in dataset["valid"].dims if name not in ("load", "medium")]
    if "direction" in dataset.dims:
        names.append("direction")
    return names


def find_longest_parameter(dataset: Dataset) -> str | None:
    """Return the parameter in numbers that has the most values, the first of several; None if no
    parameter in numbers has several values.
    """
    longest = None
    largest_size = 1
    for name in list_parameters(dataset):
        if dataset[name].dtype.kind in "fiu" and dataset.sizes[name] > largest_size:
            longest = name
            largest_size = dataset.sizes[name]
    return longest


def turn_over(dataset: Dataset, x: str | None) -> Dataset:
    """Return the data set with the parameter ``x`` in the place of the load, so that curves lie
    over the parameter; the data set itself if ``x`` is None or no parameter of numbers.
    """
    if x not in list_parameters(dataset) or dataset[x].dtype.kind not in "fiu":
        return dataset
    without_load = dataset.drop_vars("load", errors="ignore")
    over_named_load = without_load.swap_dims({"load": find_load(dataset)})
    return over_named_load.rename_dims({x: "load"})


def find_dimension(dataset: Dataset, name: str) -> str | None:
    """Return the dimension along which the coordinate ``name`` of a data set lies: "load" for the
    load that was applied, and ``name`` for a parameter. None if the data set has no such
    coordinate, or one that does not lie along a single dimension.
    """
    if name not in dataset.coords or dataset[name].ndim != 1:
        return None
    return str(dataset[name].dims[0])


def describe_value(dataset: Dataset, name: str, number: int) -> tuple[str, str]:
    """Return the kind of fact that the coordinate ``name`` gives, and in words the value of the
    coordinate at the index ``number``.
    """
    entry = dataset[name].values[number]
    value = entry.item() if hasattr(entry, "item") else entry
    if name == "direction":
        return "direction", f"along {value}"
    kind, text = describe_parameter(name, value)
    if name in _LOAD_NAMES:
        text = f"{name} {write_value(float(value), str(dataset[name].attrs.get('units', '')))}"
    return kind, text


def choose_held(counts: Mapping[str, int], most: int) -> list[str]:
    """Return the names of the dimensions that are held at one value, so that no more than ``most``
    states are drawn; ``counts`` are the numbers of values of all dimensions, by name.

    Dimensions are held one after the other, until at most ``most`` states remain or only one
    dimension is free, of whose values the caller draws some. Each time the dimension is held that
    leaves the most states to draw; of several such dimensions the last is taken.
    """
    held_dimensions: list[str] = []
    free_counts = {name: count for name, count in counts.items() if count > 1}

    def count_drawn(name: str) -> int:
        """Return how many states would be drawn if the free dimension ``name`` were held too: all
        that remain, if these are at most ``most``; ``most`` of them, if one dimension remains; and
        0 if further dimensions would have to be held.
        """
        n_remaining = math.prod(free_counts.values()) // free_counts[name]
        if n_remaining <= most:
            return n_remaining
        has_single_dimension = len(free_counts) == 2
        return most if has_single_dimension else 0

    while len(free_counts) > 1 and math.prod(free_counts.values()) > most:
        name = max(reversed(free_counts), key=count_drawn)
        del free_counts[name]
        held_dimensions.append(name)
    return held_dimensions


# -- the states that a user chooses ----------------------------------------------------------------


def read_wishes(text: str) -> dict[str, list[str]]:
    """Return the values of each name in a text such as "width=2 um, medium=ala, medium=ema"; a name
    that stands there several times has several values. An empty text has none.

    :class:`~granphon.base.errors.InputError` for a text of another form.
    """
    wishes: dict[str, list[str]] = {}
    for wish in _COMMA.split(text) if text else ():
        name, equals, value = wish.partition("=")
        if not (equals and name.strip() and value.strip()):
            mend = "Write it as 'width=2 um, medium=ema'"
            raise InputError(f"--where has {wish.strip()!r}, which is no NAME=VALUE", mend=mend)
        wishes.setdefault(name.strip(), []).append(value.strip())
    return wishes


def choose_states(dataset: Dataset, wishes: Mapping[str, Sequence[str]], run: str) -> Dataset:
    """Return the data set of the states that a user wishes; all dimensions stay.

    ``wishes`` has, by the name of a parameter, of the load or of "medium", the texts of the values
    that are kept: a number with its unit, a range "1 N to 10 N", a label, or the name of a medium,
    which means the medium with any options. A number means the nearest value, if that is the number
    to half a per cent.

    :class:`~granphon.base.errors.InputError`, which calls the sweep ``run``, if the sweep has no
    such name or value, and for a text that cannot be a value, such as one in another unit.
    """
    for name, texts in wishes.items():
        dimension = find_dimension(dataset, name)
        if dimension is None or dimension not in (*dataset["valid"].dims, "direction"):
            names = [find_load(dataset), "medium", *list_parameters(dataset)]
            problem = f"{run} is not swept over {name!r}, by which --where chooses"
            raise InputError(problem, mend=suggest(name, names))
        is_kept = np.zeros(dataset.sizes[dimension], bool)
        for text_of_value in texts:
            is_kept |= _match_values(dataset, name, text_of_value, run)
        dataset = dataset.isel({dimension: np.flatnonzero(is_kept)})
    return dataset


def _match_values(dataset: Dataset, name: str, text: str, run: str) -> Flags:
    """Return (n,) whether each of the n values of the coordinate ``name`` is one that the ``text``
    of a user names. InputError if none is, and for a text that cannot be a value; the message calls
    the sweep ``run``.
    """
    values = dataset[name].values
    if values.dtype.kind in "fiu":
        is_match = _match_numbers(dataset, name, text)
    elif values.dtype.kind == "b":
        is_match = values == require(f"--where {name}", truth, _read_truth(text))
    else:
        labels = [str(label) for label in values.tolist()]
        is_match = np.array([text in (label, _drop_options(label)) for label in labels])
    if not np.any(is_match):
        choices = list_names(_write_value(dataset, name, number) for number in range(values.size))
        raise InputError(f"{run} has no {name} {text}", f"It has {choices}", "Choose one of these")
    return np.asarray(is_match)


def _drop_options(label: str) -> str:
    """Return the name of a medium without its options, or another label as it is."""
    return split_label(label)[0]


def _read_truth(text: str) -> Any:
    """Return the truth value that a word names, or the text if it names none."""
    return {"yes": True, "true": True, "no": False, "false": False}.get(text.lower(), text)


def _match_numbers(dataset: Dataset, name: str, text: str) -> Flags:
    """Return (n,) whether each of the n numbers of the coordinate ``name`` is meant by a ``text``.
    A range "A to B" means the numbers between A and B, and those beyond by the part ``_TOLERANCE``
    of an end at most. A single number means the nearest of the values, or none if the nearest
    differs by more than this part of itself. InputError for a text that is neither a number nor a
    range, and for a number in the unit of another quantity.
    """
    values = np.asarray(dataset[name].values, float)
    ends = [_read_number(dataset, name, end.strip()) for end in text.split(" to ")]
    if len(ends) == 2:
        low, high = sorted(ends)
        is_above = values >= low - _TOLERANCE * abs(low)
        return np.asarray(is_above & (values <= high + _TOLERANCE * abs(high)))
    if len(ends) > 2:
        raise InputError(f"--where has {name}={text}", mend="Give one number, or 'A to B'")
    distances = np.abs(values - ends[0])
    is_nearest = distances == distances.min()
    return np.asarray(is_nearest & (distances <= _TOLERANCE * np.abs(values)))


def _read_number(dataset: Dataset, name: str, text: str) -> float:
    """Return the number of a ``text``, in the SI unit of the coordinate ``name``; InputError for
    what is no number, and for a unit of another quantity.
    """
    unit = str(dataset[name].attrs.get("units", ""))
    if unit in ("", "1"):
        try:
            return float(text)
        except ValueError:
            mend = f"Write it as --where {name}={dataset[name].values[0]:g}"
            raise InputError(f"--where {name} is {text}, which is no number", mend=mend) from None
    example = _write_value(dataset, name, 0)
    try:
        return Quantity(spell(name), unit, example, unit, "any").read(text)
    except Refused as refusal:
        raise InputError(f"--where {name}: {refusal}") from None


def _write_value(dataset: Dataset, name: str, number: int) -> str:
    """Return the value of the coordinate ``name`` at the index ``number`` as --where takes it."""
    values = dataset[name].values
    if values.dtype.kind == "b":
        return "yes" if values[number] else "no"
    if values.dtype.kind not in "fiu":
        return str(values[number])
    return write_quantity(float(values[number]), str(dataset[name].attrs.get("units", "")))


# -- the panels of a figure ------------------------------------------------------------------------


@dataclass(frozen=True)
class Layout:
    """How the curves of a sweep are shared out among panels.

    Attributes
    ----------
    rows, columns : the dimensions, parameters or "medium", whose values have rows and columns of
        panels; None for none.
    shown : the indices that are drawn, of each dimension of which some are left out.
    is_chosen : whether granphon has chosen panels or curves, as one panel would have too many.
    """

    rows: str | None = None
    columns: str | None = None
    shown: dict[str, list[int]] = field(default_factory=dict)
    is_chosen: bool = False

    @property
    def has_panels(self) -> bool:
        """Whether there are several panels."""
        return self.rows is not None or self.columns is not None

    def list_numbers(self, dataset: Dataset, name: str | None) -> list[int | None]:
        """Return the indices of the values of a dimension that have panels; [None] for no
        dimension.
        """
        if name is None:
            return [None]
        dimension = find_dimension(dataset, name)
        return list(self.shown.get(name, range(dataset.sizes[dimension])))

    def select(self, dataset: Dataset, row: int | None, column: int | None) -> Dataset:
        """Return the states of a panel, with all dimensions, from the index of its ``row`` and that
        of its ``column``, each as :meth:`list_numbers` lists them.
        """
        indices: dict[Any, list[int]] = {}
        panel = {self.rows: row, self.columns: column}
        for name, numbers in self.shown.items():
            if name not in panel:
                indices[find_dimension(dataset, name)] = numbers
        for dimension, number in panel.items():
            if dimension is not None and number is not None:
                indices[find_dimension(dataset, dimension)] = [number]
        return dataset.isel(indices)

    def describe(self, dataset: Dataset) -> str:
        """Return in words which dimensions have columns and rows of panels, which dimensions have
        values that are left out, and the options that change this.
        """
        places = []
        for name, place in ((self.columns, "columns"), (self.rows, "rows")):
            if name is not None:
                places.append(f"{place} of panels are {name}")
        for name, numbers in self.shown.items():
            dimension = find_dimension(dataset, name)
            if len(numbers) == 1:
                places.append(f"{name} is held at {_write_value(dataset, name, numbers[0])}")
            else:
                count = f"{len(numbers)} of {dataset.sizes[dimension]}"
                places.append(f"{count} values of {name} are drawn")
        options = "--where chooses states; --columns and --rows other panels"
        return f"{', '.join(places)} (granphon plot: {options})"


def _count_values(dataset: Dataset, variable: str, x: str | None) -> dict[str, int]:
    """Return the numbers of values, by name, of the parameters in which the curves of a
    ``variable`` over ``x`` differ, each with several values. If ``x`` is itself a parameter in
    numbers, the load counts as a parameter in its place.
    """
    counts = {}
    if x in list_parameters(dataset) and dataset[x].dtype.kind in "fiu":
        counts[find_load(dataset)] = dataset.sizes["load"]
    for name in list_parameters(dataset):
        # a variable without the dimension is the same in all directions
        is_without_effect = name == "direction" and "direction" not in dataset[variable].dims
        if name != x and not is_without_effect:
            counts[name] = dataset.sizes[find_dimension(dataset, name)]
    return {name: count for name, count in counts.items() if count > 1}


def arrange(
    dataset: Dataset,
    variable: str,
    x: str | None = None,
    rows: str | None = None,
    columns: str | None = None,
    *,
    wants_single_curves: bool = False,
) -> Layout:
    """Return the panels for the curves of a ``variable`` of a sweep over ``x``, a load, or a
    parameter in numbers.

    ``rows`` and ``columns`` name the dimensions whose values have rows and columns of panels: the
    medium, parameters, and if ``x`` is a parameter the load. What they do not name are shades of a
    colour in a panel, unless several parameters have more combinations than the eye finds among
    shades. Then the parameters with the fewest values get panels, until shades suffice: the first
    parameter gets the columns, the second the rows, as far as these are free, and all further ones
    are held at their first value. A parameter that gets panels in this way and has more values than
    there is place for is drawn at some of them; so is the load over a parameter, if there are more
    loads than shades. If the figure ``wants_single_curves``, no panel has several combinations, and
    the medium counts as a parameter.

    Raises :class:`~granphon.base.errors.InputError` if ``rows`` or ``columns`` is no name of what
    tells curves apart, if both are the same, or if they take too many panels.
    """
    rows = _read_dimension("rows", rows)
    columns = _read_dimension("columns", columns)
    counts = _count_values(dataset, variable, x)
    all_counts = counts | {"medium": dataset.sizes["medium"]}
    allowed = [name for name, count in all_counts.items() if count > 1]
    _require_swept(rows, columns, allowed)
    if wants_single_curves:  # media are told apart as parameters are
        counts = {name: all_counts[name] for name in allowed}
    names = {"--rows": rows, "--columns": columns}
    _require_few_panels(
        {option: all_counts[name] for option, name in names.items() if name is not None}
    )
    # parameters that shades of a colour tell apart within a panel, with their numbers of values
    shaded = {name: count for name, count in counts.items() if name not in (rows, columns)}
    # parameters whose values may not all have a place, with the greatest number that has one
    limits: dict[str, int] = {}
    load = find_load(dataset)
    if shaded.get(load, 0) > MOST_SHADES:  # a curve for each load over a parameter
        limits[load] = _MOST_LOADS
        shaded[load] = _MOST_LOADS
    most_curves = 1 if wants_single_curves else _MOST_COMBINATIONS
    # one parameter alone has shades in their order, however many values it has
    while math.prod(shaded.values()) > most_curves and (wants_single_curves or len(shaded) > 1):
        # the fewest values, and of several such parameters the last in the order of the scene
        name = min(reversed(shaded), key=shaded.__getitem__)
        del shaded[name]
        if columns is None:
            columns = name
            limits[name] = _MOST_IN_LINES if rows is None else MOST_COLUMNS
        elif rows is None:
            rows = name
            limits[name] = _MOST_ROWS
            if columns in limits:
                limits[columns] = MOST_COLUMNS
        else:
            limits[name] = 1  # held at the first value
    shown = {
        name: pick_evenly(counts[name], limit)
        for name, limit in limits.items()
        if counts[name] > limit
    }
    return Layout(rows, columns, shown, is_chosen=bool(limits))


def _read_dimension(option: str, name: Any) -> str | None:
    """Return the ``name`` of a dimension that a user gives for an ``option``, or None; InputError
    for what is no name.
    """
    return None if name is None else str(require(option, text, name))


def _require_few_panels(counts: Mapping[str, int]) -> None:
    """Raise InputError if the user asks for more panels than a figure can have; ``counts`` are the
    numbers of rows and of columns by the option that asks for them, as far as it is given.
    """
    n_panels = math.prod(counts.values())
    if n_panels > _MOST_PANELS:
        verb = "ask" if len(counts) > 1 else "asks"
        problem = f"{' and '.join(counts)} {verb} for {n_panels} panels"
        why = f"A figure has at most {_MOST_PANELS}"
        raise InputError(problem, why, "Choose some of the values by --where")


def _require_swept(rows: str | None, columns: str | None, allowed: Sequence[str]) -> None:
    """Raise InputError unless ``rows`` and ``columns`` are different names among the ``allowed``,
    or None.
    """
    for option, name in (("rows", rows), ("columns", columns)):
        if name is not None and name not in allowed:
            problem = f"--{option} is {name}, which does not tell curves of the figure apart"
            mend = suggest(name, allowed) if allowed else "Leave it out"
            raise InputError(problem, mend=mend)
    if rows is not None and rows == columns:
        raise InputError(f"--rows and --columns are both {rows}", mend="Leave one of them out")
