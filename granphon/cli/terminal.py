"""Output of the command line: lines, tables, warnings and errors; scenes and results in words.

This module imports no code that computes.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granphon.base.errors import InputError, one_line
from granphon.base.scales import write_quantity, write_uncertain, write_unit
from granphon.base.text import counted, spell

if TYPE_CHECKING:
    from granphon.fits.fit import WidthFit
    from granphon.fits.transfer import DampingFit
    from granphon.scene.scene import RunResult, Scene
    from granphon.tradeoffs.measure import MeasuredPoint, TradeOff


#: end of the message of an interruption that comes before a result is written
NOTHING_WRITTEN = "no result was written."
#: addition to that message if tasks have been finished
GO_ON = "The finished parts are kept: run the same command again to continue."


def say_table(rows: Sequence[tuple[str, str]]) -> None:
    """Print rows of a name and a text each, in two columns."""
    width = max(22, *(len(name) + 1 for name, _ in rows)) if rows else 0
    for name, text in rows:
        say(f"  {name:<{width}}{text}")


def say(text: str) -> None:
    """Print a line; what cannot be printed, and characters that the encoding of stdout lacks, are
    backslash escapes.
    """
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    print(one_line(text).encode(encoding, "backslashreplace").decode(encoding))


def warn(warnings: Sequence[str], most: int = 10) -> None:
    """Print at most ``most`` warnings on standard error, and then how many more there are."""
    lines = list(warnings[:most])
    if len(warnings) > most:
        lines.append(f"and {len(warnings) - most} more")
    for warning in lines:
        print(f"granphon: warning: {one_line(warning)}", file=sys.stderr)


def fail(text: str, code: int) -> int:
    """Print an error on standard error as one line, and return the exit ``code``."""
    print("granphon: error: " + one_line(" ".join(text.split())), file=sys.stderr)
    return code


def require_name(option: str, path: str | None) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the path given for ``option`` is empty, or
    is of dashes only.

    A single dash stands for a stream, and two end the options: none is meant as a name.
    """
    if path == "":
        raise InputError(
            f"{option} is empty", mend="Name a file or folder; perhaps a shell variable is not set"
        )
    if path and not path.strip("-"):
        why = "Results are files, and none is written to the standard output" if path == "-" else ""
        raise InputError(
            f"{option} is {path!r}", why, f"Name a file or folder; ./{path} if that is its name"
        )


class Interrupted(Exception):
    """An interruption, whose message says what it has left in the folder of the results."""


@contextmanager
def write_of_scene(
    scene: str, out: str, endings: Sequence[str], force: bool, why_single: str = ""
) -> Iterator[tuple[Scene, Path]]:
    """Read a scene, and yield it with the path at which the block writes the file ``out``, which
    arrives whole or not at all.

    Raises :class:`~granphon.base.errors.InputError` if the name has none of the ``endings``, or if
    the scene has several states and the block takes a single state, as ``why_single`` says.
    """
    from granphon.base.staging import ResultFiles
    from granphon.scene.scene import Scene

    require_name("--out", out)
    target = Path(out)
    if target.suffix not in endings:
        problem = f"--out is {out}, whose ending is not {' or '.join(endings)}"
        mend = f"Use {' or '.join(endings)}"
        if len(endings) == 1:
            mend = f"Give a name that ends in {endings[0]}"
        raise InputError(problem, mend=mend)
    plan = Scene.from_yaml(scene)
    files = ResultFiles(target.parent, [target.name], force, inputs=plan.origin.inputs)
    with files.open() as locked:
        if why_single and not plan.is_single:
            mend = "Keep one load, one medium, and no block 'sweep'"
            raise InputError(f"{scene} has many states", why_single, mend)
        with locked.staging() as stage:
            yield plan, stage / target.name
    say(f"Wrote {out}")


@contextmanager
def tell_interruption(describe_folder: Callable[[], str]) -> Iterator[None]:
    """Turn an interruption of the block into :class:`Interrupted`, with the text that
    ``describe_folder`` returns then.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(describe_folder()) from None


def write_range(value: Any, unit: str) -> str:
    """Text of a value, or of the least and the greatest of several, as :func:`write_quantity`
    writes them.
    """
    import numpy as np  # here alone, so that the command's help needs no numpy

    ends = np.unique([np.min(value), np.max(value)]).tolist()
    return " to ".join(write_quantity(end, unit) for end in ends)


def _write(value: Any, unit: str) -> str:
    """Text of a value of a table: a length, force, pressure or stiffness with a decimal prefix, all
    else as it is.
    """
    if unit in ("m", "Pa", "N", "N/m", "Hz"):
        return write_range(value, unit)
    # with numpy, which the help of a command does not need
    from granphon.base.results import describe_value

    return f"{describe_value(value)}{write_unit(unit)}"


def describe_scene(scene: Scene) -> list[tuple[str, str]]:
    """Rows that describe a scene: names, and values in readable units."""
    rows = [(name, _write(value, unit)) for name, value, unit in scene.describe()]
    if scene.is_single and scene.serving.chosen_automatically:
        serving = scene.serving
        error = float(serving.errors[0])
        words = "exact for equal balls"
        if error:
            words = f"expected error {error:.2g} against {serving.truth}"
        rows.append(("chosen", f"{serving.medium.label}, {words}"))
    if not scene.is_single:
        rows.append(("sweep", _count_states(scene)))
    elif scene.serving.is_quick:
        state = scene.state()
        force = write_quantity(state.force, "N")
        overlap = write_quantity(state.overlap, "m")
        normal = write_quantity(state.normal_stiffness, "N/m")
        shear = write_quantity(state.shear_stiffness, "N/m")
        rows.append(("contact", f"force {force}, overlap {overlap}"))
        rows.append(("stiffness", f"normal {normal}, shear {shear}"))
    cost = scene.cost()
    if cost is not None:
        rows.append(("will take", f"{cost.text} on one processor"))
    return rows


def _count_states(scene: Scene) -> str:
    """Return the number of states of a sweep in words: "5 loads x 2 media = 10 states"."""
    sizes = [(len(scene.load.values), "load", "loads"), (len(scene.media), "medium", "media")]
    for name, values in scene.parameters:
        sizes.append((len(values), f"value of {name}", f"values of {name}"))
    states = math.prod(count for count, *_ in sizes)
    counts = " x ".join(counted(*size) for size in sizes)
    return f"{counts} = {counted(states, 'state')}"


def describe_result(result: RunResult) -> list[tuple[str, str]]:
    """Rows of the main numbers of a result: labels, and values in readable units."""
    from granphon.observables.catalogue import CATALOGUE

    numbers: dict[str, Any] = result.summary()
    rows = [("states", str(numbers["states"]))] if "states" in numbers else []
    direction = ""
    if "direction" in numbers:
        direction = f" along {write_direction(numbers['direction'])}"
    for name in CATALOGUE:
        entry = result.entry(name)
        if entry is None or not entry.told or name not in numbers:
            continue
        text = _write_number(numbers[name], numbers.get(f"{name}_error"), entry.unit)
        if entry.unit == "m/s" and entry.cost != "surface":
            text += direction
        rows.append((entry.label.lower(), text))
    gaps = numbers.get("gaps")
    if gaps is not None:
        rows.append(("gaps" if len(gaps) > 1 else "gap", _describe_gaps(gaps)))
    return rows


def _write_number(value: Any, error: Any, unit: str) -> str:
    """Return the text of a value, or of the ends of several, with the standard ``error`` of each if
    the error is not None; all in the SI ``unit``.
    """
    import numpy as np

    if error is None:
        return write_range(value, unit)
    if np.size(value) == 1:
        return write_uncertain(float(np.ravel(value)[0]), float(np.ravel(error)[0]), unit)
    return f"{write_range(value, unit)} +/- {write_range(np.ravel(error), unit)}"


def _describe_gaps(gaps: list[list[float]]) -> str:
    """Return the three widest ``gaps``, (n, 2) Hz, in ascending order, and the number of others."""
    widest = sorted(gaps, key=lambda gap: gap[0] - gap[1])[:3]
    text = ", ".join(write_range(gap, "Hz") for gap in sorted(widest)) or "none"
    if len(gaps) > len(widest):
        text += f", and {len(gaps) - len(widest)} narrower ones"
    return text


def write_direction(direction: Any) -> str:
    """Text of one direction, or of the number of them."""
    if isinstance(direction[0], float | int):
        return f"({', '.join(f'{x:g}' for x in direction)})"
    return counted(len(direction), "direction")


def describe_fit(fit: WidthFit) -> list[tuple[str, str]]:
    """Rows of a fit: its parameters with their standard errors, the data, and how well they
    agree.
    """
    from granphon.balls.packing import PARAMETERS

    rows = []
    for name, value, error in zip(
        fit.parameters, fit.values.tolist(), fit.stderrs.tolist(), strict=True
    ):
        rows.append((spell(name), _write_valued(value, error, PARAMETERS[name] or "")))
        if name == "width":
            rows.append(("standard deviation", _write_valued(fit.std, fit.std_stderr, "m")))
    source = "given" if fit.sigma_given else f"from the scatter, {fit.dof} degrees of freedom"
    ends = dict.fromkeys(f"{sigma:.3g}" for sigma in (min(fit.sigma), max(fit.sigma)))
    errors = "error not known"
    if fit.errors_are_known:
        errors = f"each +/- {' to '.join(ends)} m/s ({source})"
    rows += [("medium", fit.medium), ("velocities", f"{fit.force.size}, {errors}")]
    if not fit.is_isotropic:
        rows.append(("direction", write_direction(fit.waves.direction)))
    if fit.sigma_given:
        # if sigma comes from the scatter, chi^2 equals the degrees of freedom by construction
        rows.append(_judge_fit(fit))
    return rows


def _write_valued(value: float, error: float, unit: str) -> str:
    """Return the text of a fitted value with its standard error, both in the SI ``unit``."""
    if not math.isfinite(error):
        return f"{write_quantity(value, unit)}, error not known"
    if not unit:  # a number takes no prefix
        return f"{value:.4g} +/- {error:.2g}"
    return write_uncertain(value, error, unit)


def _judge_fit(fit: WidthFit | DampingFit) -> tuple[str, str]:
    """Return the row that says how well a fit agrees with its data."""
    if not fit.dof:
        return "chi^2", "none: as many are fitted as were measured"
    return "chi^2", f"{fit.chi2:.4g} for {fit.dof} degrees of freedom, p = {fit.p:.2g}"


def describe_response_fit(fit: DampingFit) -> list[tuple[str, str]]:
    """Rows of a fit to a transfer function: its parameters with their standard errors, the data,
    and how well they agree.
    """
    from granphon.fits.transfer import PARAMETERS

    units = [PARAMETERS[name].replace("1", "") for name in fit.parameters]
    columns = zip(fit.parameters, fit.values.tolist(), fit.stderrs.tolist(), units, strict=True)
    rows = [
        (name.replace("_", " "), _write_valued(value, error, unit))
        for name, value, error, unit in columns
    ]
    data = "magnitudes" if fit.measured.phase is None else "magnitudes and phases"
    source = "sigma given"
    if not fit.sigma_given:
        source = f"sigma from the scatter, {fit.dof} degrees of freedom"
    rows.append(("data", f"{len(fit.magnitude)} {data}, {source}"))
    return [*rows, _judge_fit(fit)] if fit.sigma_given else rows


def describe_tradeoff(result: TradeOff, periods: int) -> list[str]:
    """Lines of the table of a trade-off, of balls on a lattice of 1, 2 or 3 ``periods``."""
    from granphon.base.quantities import load_quantities  # with numpy, too

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
    """Return the eleven cells of the row of a point in the table of a trade-off; a point that was
    not run has the reason in the last cell.
    """
    if point.failure and not point.seconds:
        return (point.method, point.knob, *[""] * 8, point.failure)
    times = [
        write_quantity(time, "s") if time else "0 s"
        for time in (point.seconds, point.spread, point.setup)
    ]
    return (
        point.method,
        point.knob,
        f"{point.error:.2e}" if point.errors.size else "?",
        f"{point.stderr:.0e}" if point.stderr else "",
        str(point.draws),
        *times,
        write_quantity(point.memory, "B"),
        f"{point.floor:.0e}",
        point.note,
    )
