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
from granphon.base.errors import InputError, MissingFileError
from granphon.base.scales import prefixed, write_error, write_quantity, write_uncertain, write_unit
from granphon.base.staging import read_written_files
from granphon.base.tables import Table
from granphon.base.text import join_alike, read_bytes, read_text, read_yaml, spell
from granphon.figures.style import pick_evenly
from granphon.observables.catalogue import CATALOGUE
from granphon.page.document import Block, Code, Items, Link, Picture, Rows, Section, Text
from granphon.scene.outputs import OUTPUTS, Export, list_told, read_summary

#: endings of the files of figures that a page can hold
_PICTURES = (".png", ".svg")
#: keys of summary.yaml that are no numbers of the result
_NO_NUMBERS = {
    "schema", "versions", "source", "observe", "finite_overlap", "sizes", "warnings", "files",
    "units", "validity", "ok", "medium", "peaks", "errors_from", "design",
}  # fmt: skip
#: greatest number of rows of the table of states, about a page
MOST_STATES = 40
#: columns of the table of states besides the observables that the catalogue marks as told
_OTHER_COLUMNS = ("exponent", "contact_fraction", "valid")
#: headings of columns of that table, where they are shorter than the names of the numbers
_SHORT_NAMES = {"exponent": "local exponent"}
#: keys of fit.yaml that are no numbers of the fit, and words for those that are
_NO_FIT_NUMBERS = ("schema", "class", "digest")
_FIT_NAMES = {
    "stderr": "standard error of the width",
    "std": "standard deviation of the diameters",
    "std_stderr": "its standard error",
    "sigma_given": "errors of the data are given",
    "chi2": "chi^2",
    "dof": "degrees of freedom",
}
#: digits of standard errors
_DIGITS = 2
#: components of a tensor below this part of the largest are rounding
_ROUNDING = 1e-12
#: how the model and the program are cited
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
    InputError : the folder holds no results, or damaged ones, or a run writes into it meanwhile.
    """
    source = Path(folder)
    if not source.is_dir():
        problem = f"there is no folder {source}"
        if os.path.lexists(source):
            problem = f"{source} is no folder"
        raise MissingFileError(problem, mend="Give the folder of a run")
    if not any((source / name).is_file() for name in ("summary.yaml", "fit.yaml")):
        mend = "Give a folder of 'granphon run' or 'granphon fit'"
        raise InputError(f"{source} holds no results", mend=mend)
    record = read_written_files(source)
    sections = []
    for part in PARTS:
        if part.files and not any((source / name).is_file() for name in part.files):
            continue
        blocks = part.read(source)
        if blocks:
            sections.append(Section(part.title, blocks))
    if read_written_files(source) != record:
        problem = f"{source} was written into while it was read"
        raise InputError(problem, "The report would mix two results", "Make it again")
    return _find_title(source), sections


def _find_title(source: Path) -> str:
    """Return the title of the report of a folder: the scene that was run, or what was fitted."""
    name = source.resolve().name
    if (source / "summary.yaml").is_file():
        name = read_summary(source).get("source") or name
        return f"granphon: results of {name}"
    return f"granphon: fit in {name}"


# -- the parts -------------------------------------------------------------------------------------


def _read_numbers(source: Path) -> list[Block]:
    """Return the table of the numbers in the summary of the folder ``source``, with their units and
    standard errors; what is observed and the media come first.
    """
    summary = read_summary(source)
    units = summary.get("units", {})
    rows = [("observed", ", ".join(summary.get("observe", ())))]
    media = summary.get("medium", ())
    rows.append(("medium", media if isinstance(media, str) else ", ".join(media)))
    for name, value in summary.items():
        is_error = name.endswith("_error") and name.removesuffix("_error") in summary
        if name in _NO_NUMBERS or is_error:
            continue
        text = _write_value(value, units.get(name, ""), summary.get(f"{name}_error"))
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


def _write_value(value: Any, unit: str, error: Any = None) -> str:
    """Return the text of a value of a summary in the SI ``unit``, with its standard ``error`` if
    that is not None; empty for a number that is not finite, and for a value of another type.

    The value is a word, a number, a mapping of numbers, a list of numbers (two in ascending order
    are the least and the greatest), or a list of lists: a tensor (n, n) for n above two, or else
    intervals (n, 2). The error has the shape of the value.
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
    if not isinstance(value, list) or not value:
        return "none" if value == [] else ""
    if all(isinstance(entry, list) for entry in value):
        is_tensor = len(value) > 2 and all(len(entry) == len(value) for entry in value)
        if is_tensor:
            return _write_tensor(np.array(value, float), unit, error)
        if not error:  # without an error no interval has one
            return ", ".join(_write_range(entry, unit) for entry in value)
        intervals = [
            " to ".join(write_uncertain(*edge, unit) for edge in zip(*pair, strict=True))
            for pair in zip(value, error, strict=True)
        ]
        return ", ".join(intervals)
    # two numbers of branches, such as curvatures, may be in no order
    is_range = len(value) == 2 and value[0] <= value[1]
    text = _write_range(value, unit) if is_range else _list_numbers(value, unit)
    if not isinstance(error, list):
        return text
    # the values of a list have the unit itself
    largest = max(map(abs, value)) if is_range else 1.0
    errors = dict.fromkeys(write_error(end, largest, unit) for end in error)
    return f"{text} +/- {' to '.join(errors)}"


def _write_number(value: float, unit: str) -> str:
    """Return the text of a number in the SI ``unit``; a whole number without a unit has all its
    digits.
    """
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
    standard ``error`` if that is not None, row by row, all with the same decimal prefix; components
    that are rounding beside the largest are zero.
    """
    largest = float(np.max(np.abs(components)))
    size, name = prefixed(largest, unit)
    shown = np.where(np.abs(components) > _ROUNDING * largest, components / size, 0.0)
    text = _write_rows(shown, 5)
    if error:
        text += f" +/- {_write_rows(np.array(error, float) / size, _DIGITS)}"
    return f"{text}{write_unit(name)}"


def _write_rows(numbers: Array, digits: int) -> str:
    """Return the text of ``numbers`` (n, n), row by row, with so many ``digits``."""
    return "; ".join(", ".join(f"{number:.{digits}g}" for number in row) for row in numbers)


def _list_numbers(values: list[Any], unit: str) -> str:
    """Return the text of several values in the SI ``unit``."""
    return f"{', '.join(f'{value:.5g}' for value in values)}{write_unit(unit)}"


def _read_errors(source: Path) -> list[Block]:
    """Return the table of the parameters that give most of the standard errors, each with the
    numbers whose error is mostly due to it; nothing without such errors.
    """
    sources = read_summary(source).get("errors_from", {})
    rows = join_alike((_name_number(name), parameter) for name, parameter in sources.items())
    return [Rows(("parameter", "gives most of the error of"), tuple(rows))] if rows else []


def _read_design(source: Path) -> list[Block]:
    """Return a sentence on the goal of a design at its end and at its start, the table of its
    variables, and a remark if the table leaves some out.
    """
    numbers = read_summary(source).get("design", {})
    unit = numbers.get("unit", "")
    end, start = (_write_number(numbers[name], unit) for name in ("value", "start_value"))
    table = Table.read(source / "design.csv")
    names = [heading.name for heading in table.headings]
    rows = list(zip(*table.columns, strict=True))
    blocks: list[Block] = [
        Text(f"The goal is {end}, from {start} at the start."),
        Rows(tuple(names), tuple(rows[:MOST_STATES])),
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
        # whether the limit is kept tells on which side it lies, unless the value is the limit
        if check["value"] != check["limit"]:
            is_lower = (check["value"] > check["limit"]) == bool(check["ok"])
            limit = f"{'at least' if is_lower else 'at most'} {limit}"
        rows.append((check["meaning"], f"{check['value']:.4g}", limit, holds))
    return [Rows(("quantity", "value", "limit", "holds"), tuple(rows))] if rows else []


def _read_warnings(source: Path) -> list[Block]:
    """Return the warnings of a run; a sentence if there are none."""
    warnings = tuple(read_summary(source).get("warnings", ()))
    return [Items(warnings)] if warnings else [Text("None: no limit of the model is passed.")]


def _read_states(source: Path) -> list[Block]:
    """Return the table of the states of a sweep: load, medium, parameters and main numbers; nothing
    for a single state. Of more than ``MOST_STATES`` states the table has some, taken evenly, and
    stands behind a link to the table of all.
    """
    from granphon.runs.dataset import find_load, load_sweep

    dataset = load_sweep(source / "sweep.nc")
    dims = dataset["valid"].dims
    n_states = dataset["valid"].size
    if n_states < 2:
        return []
    listed = pick_evenly(n_states, MOST_STATES)  # numbers of the states in the table
    load = find_load(dataset)
    observe = json.loads(dataset.attrs["observe"])
    names = [load, *map(str, dims[1:])]
    for name in (*list_told(observe), *_OTHER_COLUMNS):
        is_unasked = name == "exponent" and "velocities" not in observe
        if name in dataset.data_vars and dataset[name].dims == dims and not is_unasked:
            names.append(name)
    columns = [_write_column(dataset, name, listed) for name in names]
    headings = tuple(heading for heading, _ in columns)
    rows = tuple(zip(*(texts for _, texts in columns), strict=True))
    table = Rows(headings, rows)
    if len(listed) == n_states:
        return [table]
    remark = f"{len(listed)} of {n_states} states, taken evenly; all of them are in"
    return [Link(remark, "sweep.csv"), table]


def _write_column(dataset: Any, name: str, listed: Any) -> tuple[str, list[str]]:
    """Return the heading and the cells of the column of the variable ``name`` in the table of
    states. The heading has the unit, whose decimal prefix makes the numbers short. ``listed`` are
    the numbers (n,) of the states that have a row.
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
        finite = values[np.isfinite(values)]
        size, prefixed_unit = prefixed(float(np.max(np.abs(finite), initial=0.0)), unit)
        heading += f" ({prefixed_unit})"
    cells = zip(values[listed].tolist(), errors[listed].tolist(), strict=True)
    return heading, [_write_cell(value, error, size) for value, error in cells]


def _write_cell(value: Any, error: float, size: float) -> str:
    """Return the text of a value in the table of states. A number is divided by ``size``, the size
    of the unit in the heading; its standard ``error``, SI, is written too if it is above zero, and
    is nan where it is not known.
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if error > 0.0:
        return write_uncertain(value / size, error / size, "")
    return f"{value / size:.6g}" if isinstance(value, float) else str(value)


def _read_fit(source: Path) -> list[Block]:
    """Return the table of the plain numbers and words of a fit."""
    fit = read_yaml(source / "fit.yaml")
    if not isinstance(fit, dict):
        raise InputError(f"{source / 'fit.yaml'} holds no keys", mend="Fit again")
    units = fit.get("units", {})
    rows = []
    for name, value in fit.items():
        is_plain = isinstance(value, str | int | float) and name not in _NO_FIT_NUMBERS
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
    rows: dict[str, Export | None] = {}  # by the name of the figure without its ending
    for _name, row in OUTPUTS.items():
        if row.figure:
            rows.setdefault(row.stem, row)
    names = [
        name
        for name in sorted(read_written_files(source))
        if name.endswith(_PICTURES) and (source / name).is_file()
    ]
    figures = [(name, rows.get(Path(name).stem)) for name in names]
    order = [*rows.values(), None]
    return sorted(figures, key=lambda figure: order.index(figure[1]))


def _read_scene(source: Path) -> list[Block]:
    """Return the scene as it was run."""
    return [Code(read_text(source / "scene.yaml"))]


def _read_versions(source: Path) -> list[Block]:
    """Return the table of the versions with which the results were made."""
    versions = _find_versions(source)
    rows = tuple((str(name), str(version)) for name, version in versions.items())
    return [Rows(("package", "version"), rows)] if rows else []


def _find_versions(source: Path) -> Mapping[str, Any]:
    """Return the versions of packages by name, as the summary in the folder ``source``, or without
    one the fit, has them; empty for none. A fit has the version of granphon alone.
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
    version = _find_versions(source).get("granphon", "")
    return [
        Text("Please cite the paper whose model granphon computes, and the program:"),
        Items((f"{PAPER}.", f"The granphon developers, granphon {version}.".replace(" .", "."))),
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
