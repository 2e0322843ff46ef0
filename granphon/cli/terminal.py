"""Output of the command line: lines, tables, warnings and errors; scenes and results in words.

This module imports no code that computes.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence, Sized
from contextlib import contextmanager
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granphon.base.errors import InputError, one_line
from granphon.base.scales import write_error, write_quantity, write_uncertain, write_unit
from granphon.base.text import counted, join_alike, spell

if TYPE_CHECKING:
    from granphon.fits.fit import WidthFit
    from granphon.fits.transfer import DampingFit
    from granphon.scene.scene import RunResult, Scene
    from granphon.tradeoffs.measure import MeasuredPoint, TradeOff


#: quantities of the contacts of a state, and their SI units
_CONTACT_QUANTITIES = (
    ("force", "N"),
    ("overlap", "m"),
    ("normal_stiffness", "N/m"),
    ("shear_stiffness", "N/m"),
)
#: least width of the names of a table, characters: tables of one command have their texts in line
_NAME_WIDTH = 22
#: greatest number of chosen media that a line names; the others are counted together
_MOST_CHOICES = 4
#: warnings about files that the command has printed already
_PRINTED_WARNINGS: list[str] = []
#: end of the message of an interruption that comes before a result is written
NOTHING_WRITTEN = "no result was written."
#: addition to that message if tasks have been finished
GO_ON = "The finished parts are kept: run the same command again to continue."


def say_table(rows: Sequence[tuple[str, str]]) -> None:
    """Print ``rows``, each a name and a text, in two columns. The first column has room for the
    longest name and a space, and at least ``_NAME_WIDTH`` characters.
    """
    width = max([_NAME_WIDTH, *(len(name) + 1 for name, _ in rows)])
    for name, text in rows:
        say(f"  {name:<{width}}{text}")


def say(text: str) -> None:
    """Print ``text`` as one line on standard output. Control characters, and characters that the
    encoding of the output lacks, are printed as backslash escapes.
    """
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    print(one_line(text).encode(encoding, "backslashreplace").decode(encoding))


def warn_of_file(text: str) -> None:
    """Print the ``text`` of a warning about a file that is read, unless this command has printed
    it. :func:`warn` does not repeat what the text says.
    """
    if text not in _PRINTED_WARNINGS:
        warn([text])
        _PRINTED_WARNINGS.append(text)


def forget_warnings() -> None:
    """Forget which warnings about files have been printed: a new command begins."""
    _PRINTED_WARNINGS.clear()


def warn(warnings: Sequence[str], most: int = 10) -> None:
    """Print at most ``most`` of the ``warnings`` on standard error, and then how many more there
    are. What :func:`warn_of_file` has printed is left out.
    """
    new_warnings = [warning for warning in warnings if not _was_printed(warning)]
    lines = new_warnings[:most]
    if len(new_warnings) > most:
        lines.append(f"and {len(new_warnings) - most} more")
    for line in lines:
        print(f"granphon: warning: {one_line(line)}", file=sys.stderr)


def _was_printed(warning: str) -> bool:
    """Whether :func:`warn_of_file` has printed what this ``warning`` says."""
    # a warning about a file has the name of the file before it, and goes on with a small letter
    end = f": {warning[:1].lower()}{warning[1:]}"
    return any(printed.endswith(end) for printed in _PRINTED_WARNINGS)


def fail(text: str, code: int) -> int:
    """Print an error, ``text``, as one line on standard error, and return the exit ``code``."""
    print("granphon: error: " + one_line(" ".join(text.split())), file=sys.stderr)
    return code


def require_name(option: str, path: str | None) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the ``path`` of an ``option`` is empty or
    consists of dashes alone; do nothing if the path is None, as of an option that is not given.

    Other programs take one dash for a stream, and two dashes for the end of the options: neither is
    meant as a name.
    """
    if path == "":
        mend = "Name a file or folder; perhaps a shell variable is not set"
        raise InputError(f"{option} is empty", mend=mend)
    if path and not path.strip("-"):
        why = ""
        if path == "-":
            why = "Results are files, and none is written to the standard output"
        mend = f"Name a file or folder; ./{path} if that is its name"
        raise InputError(f"{option} is {path!r}", why, mend)


class Interrupted(Exception):
    """An interruption, whose message says what it has left in the folder of the results."""


@contextmanager
def write_of_scene(
    scene_file: str, out: str, endings: Sequence[str], force: bool, why_single: str = ""
) -> Iterator[tuple[Scene, Path]]:
    """Read the scene in the file ``scene_file``, and yield it with the path of a temporary file, at
    which the with-block writes. At the end of the block that file becomes the file ``out``, and a
    line says so; if the block raises, ``out`` is as it was before.

    ``why_single`` is the reason for which the with-block takes scenes of one state; empty if it
    takes others too.

    Raises :class:`~granphon.base.errors.InputError` if ``out`` is empty or has none of the
    ``endings``, if the scene cannot be read or has a mistake, and if the scene has several states
    and ``why_single`` is given. Raises OutputError if the folder of ``out`` cannot hold the file,
    and its subclass FileExistsInRunError if ``out`` is there and ``force`` may not replace it.
    """
    from granphon.base.staging import ResultFiles
    from granphon.scene.scene import Scene

    require_name("--out", out)
    target = Path(out)
    if target.suffix not in endings:
        allowed = " or ".join(endings)
        mend = f"Use {allowed}"
        if len(endings) == 1:
            mend = f"Give a name that ends in {endings[0]}"
        # a name such as ".png" is hidden, and has no ending either
        fault = f"whose ending is not {allowed}" if target.suffix else "a name without an ending"
        raise InputError(f"--out is {out}, {fault}", mend=mend)
    scene = Scene.from_yaml(scene_file)
    files = ResultFiles(target.parent, [target.name], force, inputs=scene.origin.inputs)
    with files.open() as locked:
        if why_single and scene.swept:
            mend = "Keep one load, one medium, and no block 'sweep'"
            raise InputError(f"{scene_file} has many states", why_single, mend)
        with locked.staging() as stage:
            yield scene, stage / target.name
    say(f"Wrote {out}")


@contextmanager
def tell_interruption(describe_folder: Callable[[], str]) -> Iterator[None]:
    """Turn an interruption of the with-block into :class:`Interrupted`. Its message is the sentence
    that ``describe_folder`` returns at the time of the interruption.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(describe_folder()) from None


def write_range(value: Any, unit: str, digits: int = 5) -> str:
    """Return the text of a ``value`` in the SI ``unit``, with a decimal prefix and this number of
    ``digits``. Several values, in any shape, have the least and the greatest, "1 N to 2 N"; if
    the texts of these are equal, one is written.
    """
    import numpy as np  # not above, so that the help of a command needs no numpy

    ends = (float(np.min(value)), float(np.max(value)))
    # a dictionary without values, as a set has no order
    return " to ".join(dict.fromkeys(write_quantity(end, unit, digits) for end in ends))


def _write(value: Any, unit: str) -> str:
    """Return the text of a ``value`` in the SI ``unit`` for a table: lengths, pressures, forces,
    stiffnesses and frequencies as :func:`write_range` writes them, and any other value without a
    decimal prefix.
    """
    if unit in ("m", "Pa", "N", "N/m", "Hz"):
        return write_range(value, unit)
    # imported here, as it loads numpy, which the help of a command does not need
    from granphon.base.results import describe_value

    return f"{describe_value(value)}{write_unit(unit)}"


def describe_scene(scene: Scene) -> list[tuple[str, str]]:
    """Return the rows of a table that describe a scene, each a name and a value in readable units.

    InputError if the scene takes more memory than there is, or if its balls cannot carry the load.
    """
    rows = [(name, _write(value, unit)) for name, value, unit in scene.describe()]
    if scene.errors:
        rows += _describe_errors(scene)
    if scene.swept:
        rows.append(("sweep", _count_states(scene)))
        rows += _place_bands(scene)
    rows += _describe_choices(scene)
    rows += _describe_contacts(scene)
    if "design" in scene.observe:
        rows += [(name, _write(value, unit)) for name, value, unit in scene.posed_design.describe()]
    cost = scene.cost()
    if cost is not None:
        rows.append(("will take", f"{cost.text} on one processor"))
    return rows


def _describe_errors(scene: Scene) -> list[tuple[str, str]]:
    """Return the rows on standard errors: of each parameter its error, also in per cent of the
    value; the correlations; and the files whose numbers have no errors.
    """
    from granphon.scene.outputs import list_outputs
    from granphon.scene.uncertainty import list_parameters

    rows = []
    for name, value, error, unit in list_parameters(scene):
        percent = f" ({100.0 * error / abs(value):.2g} %)" if value else ""
        rows.append((f"error of {name}", write_quantity(error, unit, 3) + percent))
    rows += [
        (f"correlation of {first}", f"with {second} {value:.3g}")
        for first, second, value in scene.correlations
    ]
    names = [name for row in list_outputs(scene) for name in row.files_without_errors]
    if names:
        rows.append(
            ("without errors", f"{', '.join(names)}; other tables and sweep.nc have errors")
        )
    return rows


def _describe_choices(scene: Scene) -> list[tuple[str, str]]:
    """Return the row on the media that automatic media of a scene have chosen: the number of states
    that each serves, and the least and the greatest expected error. There is no row if no medium
    is automatic.
    """
    chosen_media = [
        serving
        for planned in scene.plan.checked_cases
        for serving in planned.serving_media
        if serving.chosen_automatically
    ]
    if not chosen_media:
        return []
    counts: dict[str, int] = {}  # number of states by the label of the medium
    for serving in chosen_media:
        label = serving.medium.label
        counts[label] = counts.get(label, 0) + len(serving.loads)
    errors = [error for serving in chosen_media for error in serving.errors.tolist()]
    words = "exact for equal balls"
    if max(errors):
        # of equal ends one is written
        ends = dict.fromkeys(f"{error:.2g}" for error in (min(errors), max(errors)))
        truths = dict.fromkeys(str(serving.truth) for serving in chosen_media)
        words = f"expected error {' to '.join(ends)} against {' and '.join(truths)}"
    return [("chosen", f"{_name_media(counts)}, {words}")]


def _name_media(counts: dict[str, int]) -> str:
    """Return the labels of media with the number of states that each serves, "ema at 3 states, afa
    at 2 states", from these ``counts`` by label. One medium has the label alone. The states of the
    media beyond the first ``_MOST_CHOICES`` are counted together.
    """
    if len(counts) == 1:
        return next(iter(counts))
    texts = [f"{label} at {counted(count, 'state')}" for label, count in counts.items()]
    n_others = sum([*counts.values()][_MOST_CHOICES:])
    if n_others:
        texts = [*texts[:_MOST_CHOICES], f"others at {counted(n_others, 'state')}"]
    return ", ".join(texts)


def _describe_contacts(scene: Scene) -> list[tuple[str, str]]:
    """Return the rows on force, overlap and stiffnesses of the contacts in the states of a scene;
    several states have the least and the greatest of each.

    If the scene has standard errors, the rows have those of these numbers too, and the parameters
    that cause most of them. There are no rows if some states are not quick to find.
    """
    numbers = scene.plan.collect([name for name, _ in _CONTACT_QUANTITIES])
    if not numbers:
        return []
    errors: dict[str, Any] = {"errors_from": {}}
    if scene.errors:
        from granphon.scene.uncertainty import find_state_errors

        errors = find_state_errors(scene, numbers)
    texts = {
        name: _write_number(numbers[name], errors.get(f"{name}_error"), unit, 5)
        for name, unit in _CONTACT_QUANTITIES
    }
    sources = {spell(name): parameter for name, parameter in errors["errors_from"].items()}
    return [
        ("contact", "force {force}, overlap {overlap}".format(**texts)),
        ("stiffness", "normal {normal_stiffness}, shear {shear_stiffness}".format(**texts)),
        *_tell_sources(sources),
    ]


def _tell_sources(sources: dict[str, str]) -> list[tuple[str, str]]:
    """Return a row for each parameter that causes most of the standard error of some numbers, with
    the names of these numbers. ``sources`` has for each number, by its words, that parameter.
    """
    return [
        (f"{parameter} gives most", f"of the error of {words}")
        for parameter, words in join_alike(sources.items())
    ]


def _place_bands(scene: Scene) -> list[tuple[str, str]]:
    """Return the row that says where the bands of the states of a sweep are, which have no table
    and no figure of their own; no row if the scene observes no bands.
    """
    if "bands" not in scene.observe:
        return []
    return [("bands of each state", "in sweep.nc, variable frequencies")]


def _count_states(scene: Scene) -> str:
    """Return the number of states of a sweep in words, "5 loads x 2 media = 10 states"."""
    counts = [counted(len(scene.load.values), "load"), counted(len(scene.media), "medium", "media")]
    for name, values in scene.parameters:
        counts.append(counted(len(values), f"value of {name}", f"values of {name}"))
    return f"{' x '.join(counts)} = {counted(scene.n_states, 'state')}"


def describe_result(result: RunResult) -> list[tuple[str, str]]:
    """Return the rows of a table of the main numbers of a result, each a label and a value in
    readable units.
    """
    import numpy as np  # not above, so that the help of a command needs no numpy

    from granphon.observables.catalogue import CATALOGUE

    numbers: dict[str, Any] = result.summary()
    rows = list[tuple[str, str]]()
    if "states" in numbers:
        rows.append(("states", str(numbers["states"])))
        rows += _place_bands(result.scene)
    direction = ""
    if "direction" in numbers:
        direction = f" along {write_direction(numbers['direction'])}"
    for name in CATALOGUE:
        entry = result.entry(name)
        if entry is None or not entry.told or name not in numbers:
            continue
        text = _write_number(numbers[name], numbers.get(f"{name}_error"), entry.unit, entry.digits)
        if entry.zero and not any(np.ravel(numbers[name])):
            text = entry.zero
        # a wave of an edge runs along the path, whatever direction the scene has
        if entry.unit == "m/s" and entry.cost != "surface":
            text += direction
        rows.append((entry.label.lower(), text))
    gaps = numbers.get("gaps")
    if gaps is not None:
        text = _describe_gaps(gaps, numbers.get("gaps_error"))
        rows.append(("gaps" if len(gaps) > 1 else "gap", text))
    if "design" in numbers:
        rows += _describe_design(numbers["design"])
    rows += _tell_sources(_name_sources(result, numbers.get("errors_from", {})))
    rows += _tell_strongest(numbers.get("matters_most", {}))
    return rows


def _tell_strongest(parameters: dict[str, str]) -> list[tuple[str, str]]:
    """Return the rows that say on which parameter each quantity depends most: ``parameters`` by the
    names of the quantities.
    """
    if not parameters:
        return []
    from granphon.runs.sensitivities import spell_quantity  # other results do not need it

    strongest = [(spell_quantity(name), parameter) for name, parameter in parameters.items()]
    return [(f"{name} matters most", f"to {words}") for name, words in join_alike(strongest)]


def _name_sources(result: RunResult, parameters: dict[str, str]) -> dict[str, str]:
    """Return for each number in the table of a ``result``, by its label in lower case, the
    parameter that causes most of its standard error. ``parameters`` has these parameters by the
    names of numbers, of which the table does not show all.
    """
    sources = {}
    for name, parameter in parameters.items():
        entry = result.entry(name)
        if entry is not None and entry.told:
            sources[entry.label.lower()] = parameter
        elif name == "gaps":  # an output, and no entry of the catalogue
            sources[name] = parameter
    return sources


def _describe_design(numbers: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows on a design from its ``numbers`` in the summary: the goal at the end and at
    the start, and how long the search was.
    """
    unit = numbers["unit"]
    end, start = (_write(numbers[name], unit) for name in ("value", "start_value"))
    evaluations = counted(numbers["evaluations"], "evaluation")
    return [
        ("design", f"{end}, from {start} at the start"),
        ("search", f"{counted(numbers['unknowns'], 'unknown')}, {evaluations}"),
    ]


def _write_number(value: Any, error: Any, unit: str, digits: int) -> str:
    """Return the text of a ``value`` in the SI ``unit``, or of the least and the greatest of
    several values, with this number of ``digits``.

    A standard ``error`` that is not None has the shape of the value, and is written too. The error
    then decides how many digits a single value has. Several values then have five digits, followed
    by the least and the greatest error.
    """
    import numpy as np  # not above, so that the help of a command needs no numpy

    if error is None:
        return write_range(value, unit, digits)
    values = np.ravel(value)
    errors = np.ravel(error)
    if values.size == 1:
        return write_uncertain(float(values[0]), float(errors[0]), unit)
    largest = float(np.max(np.abs(values)))
    ends = (float(np.min(errors)), float(np.max(errors)))
    texts = dict.fromkeys(write_error(end, largest, unit) for end in ends)
    return f"{write_range(values, unit)} +/- {' to '.join(texts)}"


def _describe_gaps(gaps: list[list[float]], errors: list[list[float]] | None) -> str:
    """Return in words the three widest of n ``gaps``, in ascending order, and the number of the
    other gaps; "none" without a gap. ``gaps`` are the lower and upper edges, (n, 2), Hz; standard
    ``errors`` of the edges, (n, 2), Hz, are written too unless they are None.
    """
    # numbers of the gaps; the least of lower minus upper edge is the widest gap
    widest = sorted(range(len(gaps)), key=lambda number: gaps[number][0] - gaps[number][1])[:3]
    texts = []
    for number in sorted(widest):
        text = write_range(gaps[number], "Hz")
        if errors is not None:
            edges = zip(gaps[number], errors[number], strict=True)
            text = " to ".join(write_uncertain(edge, error, "Hz") for edge, error in edges)
        texts.append(text)
    text = ", ".join(texts) or "none"
    if len(gaps) > len(widest):
        text += f", and {counted(len(gaps) - len(widest), 'narrower one')}"
    return text


def write_direction(direction: Any) -> str:
    """Return the text of a direction, "(1, 0)", from its components; of several directions, (n,
    components), return their number, "3 directions".
    """
    if not isinstance(direction[0], Sized):  # a component
        return f"({', '.join(f'{x:g}' for x in direction)})"
    return counted(len(direction), "direction")


def describe_fit(fit: WidthFit) -> list[tuple[str, str]]:
    """Return the rows of a table of a fit: its parameters with their standard errors, the data, and
    how well they agree.
    """
    from granphon.balls.packing import PARAMETERS

    rows = list[tuple[str, str]]()
    columns = zip(fit.parameters, fit.values.tolist(), fit.stderrs.tolist(), strict=True)
    for name, value, error in columns:
        unit = PARAMETERS[name] or ""
        rows.append((spell(name), _write_fitted(value, error, unit)))
        if name == "width":
            rows.append(("standard deviation", _write_fitted(fit.std, fit.std_stderr, "m")))
    rows.append(("medium", fit.medium))
    words = "error not known"
    if fit.errors_are_known:
        # of equal ends one is written
        ends = dict.fromkeys(f"{sigma:.3g}" for sigma in (min(fit.sigma), max(fit.sigma)))
        source = "given" if fit.sigma_given else f"from the scatter, {_count_freedom(fit)}"
        words = f"each +/- {' to '.join(ends)} m/s ({source})"
    rows.append(("velocities", f"{fit.force.size}, {words}"))
    if not fit.is_isotropic:
        rows.append(("direction", write_direction(fit.waves.direction)))
    if fit.sigma_given:
        # if sigma comes from the scatter, chi^2 equals the degrees of freedom by construction
        rows.append(_judge_fit(fit))
    return rows


def _write_fitted(value: float, error: float, unit: str) -> str:
    """Return the text of a fitted ``value`` with its standard ``error``, both in the SI ``unit``,
    which is empty for a plain number. Of an error that is nan or infinite the text says that it is
    not known.
    """
    if not math.isfinite(error):
        return f"{write_quantity(value, unit)}, error not known"
    if not unit:  # a number takes no prefix
        return f"{value:.4g} +/- {error:.2g}"
    return write_uncertain(value, error, unit)


def _judge_fit(fit: WidthFit | DampingFit) -> tuple[str, str]:
    """Return the row with chi^2 of a fit, the degrees of freedom, and the probability p that errors
    of the given sizes make a larger chi^2. A fit without degrees of freedom has none.
    """
    if not fit.dof:
        return "chi^2", "none: as many are fitted as were measured"
    return "chi^2", f"{fit.chi2:.4g} for {_count_freedom(fit)}, p = {fit.p:.2g}"


def _count_freedom(fit: WidthFit | DampingFit) -> str:
    """Return the number of degrees of freedom of a fit in words."""
    return counted(fit.dof, "degree of freedom", "degrees of freedom")


def describe_response_fit(fit: DampingFit) -> list[tuple[str, str]]:
    """Return the rows of a table of a fit to a transfer function: its parameters with their
    standard errors, the data, and how well they agree.
    """
    from granphon.fits.transfer import PARAMETERS

    rows = list[tuple[str, str]]()
    columns = zip(fit.parameters, fit.values.tolist(), fit.stderrs.tolist(), strict=True)
    for name, value, error in columns:
        # a number without a unit has none in a text
        unit = "" if PARAMETERS[name] == "1" else PARAMETERS[name]
        rows.append((name.replace("_", " "), _write_fitted(value, error, unit)))
    correlation = fit.correlation
    for row, column in combinations(range(len(fit.parameters)), 2):
        words = " and ".join(fit.parameters[index] for index in (row, column))
        rows.append(
            (f"correlation of {words.replace('_', ' ')}", f"{correlation[row, column]:.2f}")
        )
    data = "magnitudes" if fit.measured.phase is None else "magnitudes and phases"
    source = "sigma given"
    if not fit.sigma_given:
        source = f"sigma from the scatter, {_count_freedom(fit)}"
    rows.append(("data", f"{len(fit.magnitude)} {data}, {source}"))
    if fit.sigma_given:
        # if sigma comes from the scatter, chi^2 equals the degrees of freedom by construction
        rows.append(_judge_fit(fit))
    return rows


def describe_tradeoff(result: TradeOff, periods: int) -> list[str]:
    """Return the lines that describe a trade-off: its loads, a table of the media, the reference,
    and the time taken. The ``periods``, 1, 2 or 3, of the lattice decide the unit of a pressure.
    """
    # imported here, as it loads numpy
    from granphon.base.quantities import load_quantities

    heads: tuple[str, ...] = (
        "method",
        "knob",
        "error",
        "+/-",
        "runs",
        "time",
        "+/-",
        "set-up",
        "memory",
        "floor",
        "",
    )
    loads = write_range(result.loads, load_quantities(periods)[result.kind].unit)
    runs = counted(result.runs, "warm run")
    lines = [f"errors at {counted(len(result.loads), 'load')}, {loads}; {runs} each"]
    rows = [heads, *(_describe_point(point) for point in result.points)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines += ["", f"media (of {', '.join(result.observed)})"]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        lines.append(f"  {'  '.join(cells).rstrip()}")
    if result.reference:
        lines.append(f"  reference: {result.reference}")
    seconds = write_quantity(result.seconds, "s")
    return [*lines, "", f"took {seconds} of {write_quantity(result.budget, 's')}"]


def _describe_point(point: MeasuredPoint) -> tuple[str, ...]:
    """Return the eleven cells of the row of a point in the table of a trade-off. A point that was
    not run has the reason in the last cell, and no numbers; one without errors has "?" for them.
    """
    if not point.ran:
        no_numbers = ("",) * 8
        return (point.method, point.knob, *no_numbers, point.failure)
    return (
        point.method,
        point.knob,
        f"{point.error:.2e}" if point.errors.size else "?",
        f"{point.stderr:.0e}" if point.stderr else "",
        str(point.draws),
        _write_time(point.seconds),
        _write_time(point.spread),
        _write_time(point.setup),
        write_quantity(point.memory, "B"),
        f"{point.floor:.0e}",
        point.note,
    )


def _write_time(seconds: float) -> str:
    """Return the text of a time, s; of zero without a decimal prefix."""
    return write_quantity(seconds, "s") if seconds else "0 s"
