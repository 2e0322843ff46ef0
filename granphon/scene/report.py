"""The report of a folder of results: scene, numbers, figures, warnings, versions, and how to cite.

The parts of a report are rows of one table, :data:`PARTS`; each is made from files of the folder,
and left out where the folder does not hold them. Nothing is computed again.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import GranphonError, InputError, one_line
from granphon.base.scales import prefixed, write_error, write_quantity, write_uncertain, write_unit
from granphon.base.staging import read_written_files
from granphon.base.tables import Table
from granphon.base.text import (
    join_alike,
    read_bytes,
    read_text,
    read_yaml,
    require_path,
    spell,
)
from granphon.figures.style import pick_evenly
from granphon.observables.catalogue import CATALOGUE, SUMMARY_KEYS
from granphon.page.document import Block, Code, Items, Link, Picture, Rows, Section, Text
from granphon.scene.outputs import (
    OUTPUTS,
    Export,
    list_told,
    read_summary,
    require_folder,
)

#: endings of the files of figures that a page can hold
_PICTURE_ENDINGS = (".png", ".svg")
#: keys of summary.yaml that are no numbers of the result, or that other parts of the report show
_KEYS_WITHOUT_NUMBER = SUMMARY_KEYS - {"states", "matters_most", "local_field"}
#: greatest number of rows of the table of states, and of that of the variables of a design: about a
#: page
MOST_STATES = 40
#: columns of the table of states besides the observables that the catalogue marks as told
_OTHER_COLUMNS = ("exponent", "contact_fraction", "valid")
#: headings of columns of that table, where they are shorter than the names of the numbers
_SHORT_NAMES = {"exponent": "local exponent"}
#: keys of fit.yaml that are no numbers of the fit, and words for those that are
_FIT_KEYS_WITHOUT_NUMBER = ("schema", "class", "digest")
_FIT_NAMES = {
    "stderr": "standard error of the width",
    "std": "standard deviation of the diameters",
    "std_stderr": "its standard error",
    "sigma_given": "errors of the data are given",
    "chi2": "chi^2",
    "dof": "degrees of freedom",
}
#: significant digits of standard errors in lists and tensors
_ERROR_DIGITS = 2
#: components of a tensor below this part of the largest are rounding
_ROUNDING = 1e-12
#: the paper whose model granphon computes, as it is cited
PAPER = (
    "B. Velický and C. Caroli, Pressure dependence of the sound velocity in a two-dimensional"
    " lattice of Hertz-Mindlin balls: Mean-field description, Phys. Rev. E 65, 021307 (2002)"
)


@dataclass(frozen=True)
class Part:
    """A part of the report: a row of :data:`PARTS`.

    Attributes
    ----------
    title : its heading.
    files : names of files: a folder has the part if it holds at least one of them; empty for a part
        that every folder has.
    read : function that takes the path of the folder and returns the blocks of the part; a part
        without blocks is left out.
    """

    title: str
    files: tuple[str, ...]
    read: Callable[[Path], list[Block]]


def read_report(folder: str | os.PathLike[str]) -> tuple[str, list[Section]]:
    """Return the title and the sections of the report of a ``folder`` of ``granphon run`` or
    ``granphon fit``.

    Raises
    ------
    MissingFileError : there is no such folder.
    InputError : ``folder`` is no path; the folder holds no results, or damaged ones, or a run
        writes into it meanwhile.
    """
    require_path(folder)
    source = Path(folder)
    require_folder(source)
    if not any((source / name).is_file() for name in ("summary.yaml", "fit.yaml")):
        mend = "Give a folder of 'granphon run' or 'granphon fit'"
        raise InputError(f"{source} holds no results", mend=mend)
    record = read_written_files(source)
    sections = []
    for part in PARTS:
        if part.files and not any((source / name).is_file() for name in part.files):
            continue
        blocks = _read_part(part, source)
        if blocks:
            sections.append(Section(part.title, blocks))
    if read_written_files(source) != record:
        problem = f"{source} was written into while it was read"
        raise InputError(problem, "The report would mix two results", "Make it again")
    return _find_title(source), sections


def _read_part(part: Part, source: Path) -> list[Block]:
    """Return the blocks of a ``part`` of the report of the folder ``source``; InputError that names
    the part if its files hold other data than granphon writes.
    """
    try:
        return part.read(source)
    except GranphonError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        fault = f"{type(error).__name__}: {error}"
        problem = f"{source} holds damaged results: {part.title!r} cannot be read ({fault})"
        raise InputError(one_line(problem), mend="Run the scene again, or fit again") from error


def _find_title(source: Path) -> str:
    """Return the title of the report of the folder ``source``: it names the file of the scene that
    was run, and the folder if the scene has no file, or if the folder is that of a fit.
    """
    folder_name = source.resolve().name
    if (source / "summary.yaml").is_file():
        scene_name = read_summary(source).get("source")
        return f"granphon: results of {scene_name or folder_name}"
    return f"granphon: fit in {folder_name}"


# -- the parts -------------------------------------------------------------------------------------


def _read_numbers(source: Path) -> list[Block]:
    """Return the table of the numbers in the summary of the folder ``source``, with their units and
    standard errors; what is observed and the media come first. Numbers without a text, such as one
    that is not finite, are left out.
    """
    summary = read_summary(source)
    is_of_sweep = "sizes" in summary
    units = summary.get("units", {})
    media = summary.get("medium", ())  # a word for one state, a list for a sweep
    rows = [
        ("observed", ", ".join(summary.get("observe", ()))),
        ("medium", media if isinstance(media, str) else ", ".join(media)),
    ]
    for name, value in summary.items():
        is_error = name.endswith("_error") and name.removesuffix("_error") in summary
        if name in _KEYS_WITHOUT_NUMBER or is_error:
            continue
        if name == "direction":
            text = _write_directions(value)
        else:
            error = summary.get(f"{name}_error")
            text = _write_value(value, units.get(name, ""), error, is_range=is_of_sweep)
        entry = CATALOGUE.get(name)
        if entry is not None and entry.zero and not np.any(value):
            text = entry.zero
        if text:
            rows.append((_name_number(name), text))
    return [Rows(("quantity", "value"), tuple(rows))]


def _name_number(name: str) -> str:
    """Return the words for a number called ``name`` in a summary: those of the catalogue's entry;
    for a number without an entry the name in words.
    """
    entry = CATALOGUE.get(name)
    return spell(name) if entry is None else entry.words


def _write_directions(value: list[Any]) -> str:
    """Return the text of a direction of sound (p,), "1, 0", or of many (n, p), "1, 0; 0, 1"."""
    return _write_rows(np.atleast_2d(np.array(value, float)), 5)


def _write_value(value: Any, unit: str, error: Any = None, *, is_range: bool = False) -> str:
    """Return the text of a value of a summary in the SI ``unit``; empty for a number that is not
    finite, and for a value of another type.

    The value is a word, a number, a mapping of numbers without units, or a list as
    :func:`_write_list` takes it together with ``is_range``. The standard ``error`` has the shape of
    the value, and is None if there is none; that of a single number is written if it is above zero.
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        if not math.isfinite(value):
            return ""
        if isinstance(error, float) and error > 0.0:
            return write_uncertain(float(value), error, unit)
        return _write_number(value, unit)
    if isinstance(value, str):
        return value
    if isinstance(value, Mapping):
        entries = [f"{spell(str(key))} {_write_value(entry, '')}" for key, entry in value.items()]
        return ", ".join(entries)
    return _write_list(value, unit, error, is_range=is_range) if isinstance(value, list) else ""


def _write_list(values: list[Any], unit: str, error: Any, *, is_range: bool) -> str:
    """Return the text of a list in the SI ``unit``, with its standard ``error``, a list of the same
    shape, if that is not None; "none" for an empty list.

    The ``values`` are the least and the greatest number of a sweep if ``is_range``. Otherwise they
    are numbers, such as those of branches or of directions; or lists: a tensor (n, n) for n above
    two, or else intervals (n, 2).
    """
    if not values:
        return "none"
    if all(isinstance(entry, list) for entry in values):
        is_tensor = len(values) > 2 and all(len(entry) == len(values) for entry in values)
        if is_tensor:
            return _write_tensor(np.array(values, float), unit, error)
        return _write_intervals(values, unit, error)
    if is_range:
        range_text = _write_range(values, unit)
        if not isinstance(error, list):
            return range_text
        largest = max(map(abs, values))
        # of equal errors one is written
        errors = dict.fromkeys(write_error(end, largest, unit) for end in error)
        return f"{range_text} +/- {' to '.join(errors)}"
    list_text = _list_numbers(values, unit)
    if isinstance(error, list):
        list_text += f" +/- {_list_numbers(error, unit, _ERROR_DIGITS)}"
    return list_text


def _write_intervals(intervals: list[Any], unit: str, error: Any) -> str:
    """Return the text of ``intervals`` (n, 2) in the SI ``unit``, each edge with its standard
    ``error`` (n, 2) if that is neither None nor empty.
    """
    if not error:
        return ", ".join(_write_range(edges, unit) for edges in intervals)
    texts = []
    for edges, errors_of_edges in zip(intervals, error, strict=True):
        pairs = zip(edges, errors_of_edges, strict=True)
        texts.append(" to ".join(write_uncertain(edge, of_edge, unit) for edge, of_edge in pairs))
    return ", ".join(texts)


def _write_number(value: float, unit: str) -> str:
    """Return the text of a number in the SI ``unit``; an int without a unit has all its digits."""
    if isinstance(value, int) and not unit:
        return str(value)
    return write_quantity(float(value), unit)


def _write_range(ends: list[Any], unit: str) -> str:
    """Return the text of the two ``ends`` of a range or interval in the SI ``unit``, "1 N to 2 N";
    if both have the same text, it stands once.
    """
    return " to ".join(dict.fromkeys(_write_number(end, unit) for end in ends))


def _write_tensor(components: Array, unit: str, error: Any = None) -> str:
    """Return the text of the ``components`` (n, n) of a tensor in the SI ``unit``, and of their
    standard ``error``, n lists of n numbers, if that is neither None nor empty, row by row, all
    with the same decimal prefix; components that are rounding beside the largest are zero.
    """
    largest = float(np.max(np.abs(components)))
    size, prefixed_unit = prefixed(largest, unit)
    written = np.where(np.abs(components) > _ROUNDING * largest, components / size, 0.0)
    tensor_text = _write_rows(written, 5)
    if error:
        tensor_text += f" +/- {_write_rows(np.array(error, float) / size, _ERROR_DIGITS)}"
    return f"{tensor_text}{write_unit(prefixed_unit)}"


def _write_rows(numbers: Array, digits: int) -> str:
    """Return the text of ``numbers`` (n, m), row by row, with ``digits`` significant digits."""
    return "; ".join(", ".join(f"{number:.{digits}g}" for number in row) for row in numbers)


def _list_numbers(values: list[Any], unit: str, digits: int = 5) -> str:
    """Return the text of the ``values``, one or more, with ``digits`` significant digits, and
    behind the last the SI ``unit``, without a prefix.
    """
    return f"{', '.join(f'{value:.{digits}g}' for value in values)}{write_unit(unit)}"


def _read_errors(source: Path) -> list[Block]:
    """Return the table of the uncertain parameters, from the summary in the folder ``source``: each
    with the numbers to whose standard error no other parameter contributes more. No block is
    returned for results without such errors.
    """
    parameter_of_number = read_summary(source).get("errors_from", {})
    rows = join_alike(
        (_name_number(name), str(parameter)) for name, parameter in parameter_of_number.items()
    )
    return [Rows(("parameter", "gives most of the error of"), tuple(rows))] if rows else []


def _read_design(source: Path) -> list[Block]:
    """Return a sentence on the goal of the design in the folder ``source``, at the end and at the
    start of its search, and the table of its variables.

    The table has at most the first ``MOST_STATES`` variables; if there are more, a remark says so.
    """
    numbers = read_summary(source)["design"]
    unit = numbers.get("unit", "")
    end = _write_number(numbers["value"], unit)
    start = _write_number(numbers["start_value"], unit)
    table = Table.read(source / "design.csv")
    names = [heading.name for heading in table.headings]
    rows = list(zip(*table.columns, strict=True))
    # the first two columns are the variable and its unit
    rounded_rows = tuple(
        (label, unit_name, *(_write_cell(float(number), 0.0, 1.0) for number in numbers))
        for label, unit_name, *numbers in rows[:MOST_STATES]
    )
    blocks: list[Block] = [
        Text(f"The goal is {end}, from {start} at the start."),
        Rows(tuple(names), rounded_rows),
    ]
    if len(rows) > MOST_STATES:
        blocks.append(Text(f"{MOST_STATES} of {len(rows)} variables; design.csv has all of them."))
    return blocks


def _read_limits(source: Path) -> list[Block]:
    """Return the table of the limits of the model at a single state, from the summary in the folder
    ``source``; nothing for a sweep, whose summary has none.
    """
    rows = []
    for check in read_summary(source).get("validity", ()):
        holds = "yes" if check["ok"] else "no"
        limit = f"{check['limit']:.4g}"
        # whether the limit is kept tells on which side it lies, unless the value is the limit or
        # is not known
        if check["value"] != check["limit"] and not math.isnan(check["value"]):
            is_lower = (check["value"] > check["limit"]) == bool(check["ok"])
            limit = f"{'at least' if is_lower else 'at most'} {limit}"
        rows.append((str(check["meaning"]), f"{check['value']:.4g}", limit, holds))
    return [Rows(("quantity", "value", "limit", "holds"), tuple(rows))] if rows else []


def _read_warnings(source: Path) -> list[Block]:
    """Return the warnings of a run; a sentence if there are none."""
    warnings = tuple(map(str, read_summary(source).get("warnings", ())))
    return [Items(warnings)] if warnings else [Text("None: no limit of the model is passed.")]


def _read_states(source: Path) -> list[Block]:
    """Return the table of the states of a sweep: load, medium, parameters, and of the numbers that
    are told those with one value for each state; nothing for a single state. Of more than
    ``MOST_STATES`` states the table has so many, taken evenly, and stands behind a link to the
    table of all.
    """
    from granphon.runs.dataset import find_load, load_sweep

    dataset = load_sweep(source / "sweep.nc")
    dims = dataset["valid"].dims
    n_states = dataset["valid"].size
    if n_states < 2:
        return []
    state_numbers = pick_evenly(n_states, MOST_STATES)
    observe = json.loads(dataset.attrs["observe"])
    # the first dimension is "load", whose values are those of a force or a pressure
    names = [find_load(dataset), *map(str, dims[1:])]
    for name in (*list_told(observe), *_OTHER_COLUMNS):
        is_unasked = name == "exponent" and "velocities" not in observe
        if name in dataset.data_vars and dataset[name].dims == dims and not is_unasked:
            names.append(name)
    columns = [_write_column(dataset, name, state_numbers) for name in names]
    headings = tuple(heading for heading, _ in columns)
    rows = tuple(zip(*(texts for _, texts in columns), strict=True))
    table = Rows(headings, rows)
    if len(state_numbers) == n_states:
        return [table]
    remark = f"{len(state_numbers)} of {n_states} states, taken evenly; all of them are in"
    return [Link(remark, "sweep.csv"), table]


def _write_column(dataset: Any, name: str, state_numbers: Any) -> tuple[str, list[str]]:
    """Return the heading and the cells of the column of the variable ``name`` in the table of
    states. The heading has the unit, whose decimal prefix is that of the largest number.
    ``state_numbers`` are the numbers (n,) of the states that have a row, which count from zero.
    """
    states = dataset["valid"]
    values = dataset[name].broadcast_like(states).transpose(*states.dims).values.ravel()
    errors = np.zeros(states.size)
    if f"{name}_error" in dataset:
        variable = dataset[f"{name}_error"].broadcast_like(states)
        errors = variable.transpose(*states.dims).values.ravel()
    unit = str(dataset[name].attrs.get("units", ""))
    heading = _SHORT_NAMES.get(name, _name_number(name))
    size = 1.0
    if unit not in ("", "1"):
        finite_values = values[np.isfinite(values)]
        size, prefixed_unit = prefixed(float(np.max(np.abs(finite_values), initial=0.0)), unit)
        heading += f" ({prefixed_unit})"
    cells = zip(values[state_numbers].tolist(), errors[state_numbers].tolist(), strict=True)
    return heading, [_write_cell(value, error, size) for value, error in cells]


def _write_cell(value: Any, error: float, size: float) -> str:
    """Return the text of a value in the table of states, in which a bool is "yes" or "no". A number
    is divided by ``size``, the size of the unit in the heading, but an int without an error, which
    has no unit. The standard ``error``, SI, is written behind the number if it is above zero; it
    is nan where it is not known, and is not written then.
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if error > 0.0:
        return write_uncertain(value / size, error / size, "")
    return f"{value / size:.6g}" if isinstance(value, float) else str(value)


def _read_fit(source: Path) -> list[Block]:
    """Return the table of the plain numbers and words of the fit in the folder ``source``;
    InputError if fit.yaml there cannot be read, or holds no keys.
    """
    fit = read_yaml(source / "fit.yaml")
    if not isinstance(fit, dict):
        raise InputError(f"{source / 'fit.yaml'} holds no keys", mend="Fit again")
    units = fit.get("units", {})
    rows = []
    for name, value in fit.items():
        is_plain = isinstance(value, str | int | float) and name not in _FIT_KEYS_WITHOUT_NUMBER
        unit = units.get(name, "") if isinstance(units, Mapping) else ""
        text = _write_value(value, unit) if is_plain else ""
        if text:
            rows.append((_FIT_NAMES.get(name, spell(name)), text))
    return [Rows(("quantity", "value"), tuple(rows))]


def _read_figures(source: Path) -> list[Block]:
    """Return the figures that granphon has drawn into the folder ``source``, each with its caption;
    a sentence if there are none.
    """
    pictures: list[Block] = []
    for name, row in _list_figures(source):
        caption = spell(Path(name).stem) if row is None else row.caption
        pictures.append(Picture(name, read_bytes(source / name), caption))
    return pictures or [Text("None is in the folder; 'granphon plot' draws them.")]


def _list_figures(source: Path) -> list[tuple[str, Export | None]]:
    """Return the names of the files of figures that granphon has drawn into the folder ``source``,
    each with the output that it shows, in the order of the table of outputs; then, with None, the
    files whose names are not those of outputs.
    """
    row_of_stem: dict[str, Export | None] = {}
    for _name, row in OUTPUTS.items():
        if row.figure:
            row_of_stem.setdefault(row.stem, row)
    names = [
        name
        for name in sorted(read_written_files(source))
        if name.endswith(_PICTURE_ENDINGS) and (source / name).is_file()
    ]
    figures = [(name, row_of_stem.get(Path(name).stem)) for name in names]
    order = [*row_of_stem.values(), None]
    return sorted(figures, key=lambda figure: order.index(figure[1]))


def _read_scene(source: Path) -> list[Block]:
    """Return the text of the scene as it was run, from scene.yaml in the folder ``source``."""
    return [Code(read_text(source / "scene.yaml"))]


def _read_versions(source: Path) -> list[Block]:
    """Return the table of the versions of packages with which the results were made; nothing if the
    files name none.
    """
    versions = _find_versions(source)
    rows = tuple((str(name), str(version)) for name, version in versions.items())
    return [Rows(("package", "version"), rows)] if rows else []


def _find_versions(source: Path) -> Mapping[str, Any]:
    """Return the versions of packages, by name, from the summary in the folder ``source``. Without
    a summary return that of granphon, which alone a fit has, from the fit there. Empty if the file
    has no versions, or if there is neither.
    """
    for name in ("summary.yaml", "fit.yaml"):
        if (source / name).is_file():
            versions = read_yaml(source / name).get("versions", {})
            return versions if isinstance(versions, Mapping) else {"granphon": versions}
    return {}


def _read_files(source: Path) -> list[Block]:
    """Return the table of the files that a run wrote, with their sizes; a file that is no longer
    there is "missing".
    """
    rows = []
    for name in read_summary(source).get("files", ()):
        path = source / name
        size = write_quantity(path.stat().st_size, "B", 3) if path.is_file() else "missing"
        rows.append((str(name), size))
    return [Rows(("file", "size"), tuple(rows))]


def _cite(source: Path) -> list[Block]:
    """Return a list of what to cite for the results in the folder ``source``: the paper, and the
    version of granphon that made them.
    """
    program = f"granphon {_find_versions(source).get('granphon', '')}".strip()
    return [
        Text("Please cite the paper whose model granphon computes, and the program:"),
        Items((f"{PAPER}.", f"The granphon developers, {program}.")),
    ]


#: the parts of a report, in their order
PARTS = (
    Part("Numbers", ("summary.yaml",), _read_numbers),
    Part("Standard errors", ("summary.yaml",), _read_errors),
    Part("Design", ("design.csv",), _read_design),
    Part("Fit", ("fit.yaml",), _read_fit),
    Part("Warnings", ("summary.yaml",), _read_warnings),
    Part("Figures", (), _read_figures),
    Part("States", ("sweep.nc",), _read_states),
    Part("Limits of the model", ("summary.yaml",), _read_limits),
    Part("Scene", ("scene.yaml",), _read_scene),
    Part("Versions", ("summary.yaml", "fit.yaml"), _read_versions),
    Part("Files", ("summary.yaml",), _read_files),
    Part("How to cite", (), _cite),
)
