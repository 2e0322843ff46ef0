"""The command ``velocity``: the sound velocity that traces of sensors show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granphon.base.errors import InputError
from granphon.base.scales import write_quantity, write_uncertain
from granphon.base.text import counted
from granphon.cli.app import COMPARISONS, Force, command
from granphon.cli.terminal import require_name, say, say_table, warn

if TYPE_CHECKING:
    from granphon.fits.traces import Traces, TraceVelocity

#: value of ``--lowpass`` for traces that are not filtered
_NO_FILTER = "none"


@command("velocity", rich_help_panel=COMPARISONS)
def find_velocity(
    data: Annotated[
        list[str],
        typer.Argument(metavar="TRACES", help="Files of traces (.csv, .h5), of the same times."),
    ],
    out: Annotated[
        str, typer.Option("--out", "-o", metavar="FILE", help="The figure to write.")
    ] = "velocity.png",
    method: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="How arrivals are found: threshold, peak, correlation or phase."
        ),
    ] = "threshold",
    threshold: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="Share of its first maximum at which a pulse begins."),
    ] = None,
    frequency: Annotated[
        str | None, typer.Option(metavar="HZ", help="Frequency of the phase, such as '8 kHz'.")
    ] = None,
    lowpass: Annotated[
        str,
        typer.Option(metavar="HZ", help="Cut-off of the low-pass filter; 'auto', or 'none'."),
    ] = "auto",
    quiet_until: Annotated[
        str | None,
        typer.Option(metavar="S", help="The traces are noise up to this time, such as '0.2 ms'."),
    ] = None,
    distances: Annotated[
        str | None,
        typer.Option(
            metavar="'M, M, ...'", help="Distances of the sensors, such as '0 mm, 40 +- 0.2 mm'."
        ),
    ] = None,
    time_step: Annotated[
        str | None, typer.Option(metavar="S", help="Time between samples, such as '0.1 us'.")
    ] = None,
    force: Force = False,
) -> None:
    """Find the sound velocity that traces of two or more sensors show.

    A table of traces has a column 'time (us)' and one for each sensor, headed with its distance,
    such as 'bead 5 at 40 mm (V)'. Prints the velocity with its standard error, which follows from
    the noise before the pulse and from the errors of distances that have one, and draws traces and
    arrivals (velocity.png in the working folder, or the file given).

    \b
    Examples:
      granphon velocity traces.csv
      granphon velocity traces.csv --method correlation -o velocity.pdf
      granphon velocity near.csv far.csv --distances "0 mm, 152.4 mm"
    """
    from granphon.base.quantities import TIME
    from granphon.base.staging import ResultFiles
    from granphon.base.validation import require
    from granphon.fits.traces import Traces

    require_name("--out", out)
    target = Path(out)
    if not target.suffix:
        raise InputError(f"--out is {out}, without an ending", mend="Use .png, .pdf or .svg")
    files = ResultFiles(target.parent, [target.name], force, inputs=data)
    files.require_free()  # before the velocity is found, which takes longer
    # without the option, the distances are those in the headings of the table
    places, errors = (None, []) if distances is None else _read_distances(distances)
    step = None if time_step is None else require("--time-step", TIME.read, time_step)
    traces = Traces.read(data, places, step)
    options = _read_options(method, threshold, frequency, lowpass, quiet_until)
    velocity = traces.velocity(**options)
    if any(errors):
        # the errors of the distances are independent of each other and of that of the arrivals
        effects = _find_effects(traces, errors, **options)
        velocity = replace(velocity, stderr=math.hypot(velocity.stderr, *effects))
    with files.open() as locked, locked.staging() as stage:
        _draw(traces, velocity, stage / target.name)
    warn(velocity.warnings)
    say_table(_describe(traces, velocity))
    say(f"Wrote {out}")


def _read_options(
    method: str,
    threshold: float | None,
    frequency: str | None,
    lowpass: str,
    quiet_until: str | None,
) -> dict[str, Any]:
    """Return the keywords of :meth:`Traces.velocity`, with values in SI units, from the options of
    :func:`find_velocity`; an option that is None has no keyword. InputError for a text that is no
    frequency or no time.
    """
    from granphon.base.quantities import FREQUENCY
    from granphon.base.validation import require
    from granphon.fits.trace_files import TIMES

    cutoff: float | str | None = lowpass
    if lowpass == _NO_FILTER:
        cutoff = None
    elif lowpass != "auto":
        cutoff = require("--lowpass", FREQUENCY.read, lowpass)
    options: dict[str, Any] = {"method": method, "lowpass": cutoff}
    if threshold is not None:
        options["threshold"] = threshold
    if frequency is not None:
        options["frequency"] = require("--frequency", FREQUENCY.read, frequency)
    if quiet_until is not None:
        options["quiet"] = require("--quiet-until", TIMES.read, quiet_until)
    return options


def _read_distances(option: str) -> tuple[list[float], list[float]]:
    """Return the distances of the sensors in the text of the ``option``, such as "0 mm, 40 +- 0.2
    mm", and their standard errors, both m; an error is zero where none is written. InputError for
    a text that is no list of lengths.
    """
    from granphon.base.quantities import read_with_error
    from granphon.base.validation import require
    from granphon.fits.trace_files import PLACES

    read = partial(read_with_error, quantity=PLACES)
    pairs = [require("--distances", read, text.strip()) for text in option.split(",")]
    distances = [distance for distance, _ in pairs]
    errors = [error for _, error in pairs]
    return distances, errors


def _find_effects(traces: Traces, errors: Sequence[float], **options: Any) -> list[float]:
    """Return the change of the velocity, m/s, by the error of each distance that has one.

    ``errors`` (n,), m, are the standard errors of the distances of n sensors, in the order of the
    traces; zero of a distance without one. A change is half the difference of the velocities for
    the larger and the smaller distance. The ``options`` are those of :meth:`Traces.velocity`.
    """
    effects = []
    for sensor, error in enumerate(errors):
        if not error:
            continue
        velocities = []
        for change in (-error, error):
            distances = traces.distances.copy()
            distances[sensor] += change
            moved_traces = replace(traces, distances=distances)
            velocities.append(moved_traces.velocity(**options).velocity)
        lower, upper = velocities
        effects.append(0.5 * (upper - lower))
    return effects


def _draw(traces: Traces, velocity: TraceVelocity, path: Path) -> None:
    """Draw the traces and the arrivals of the pulse, as the ``velocity`` has them, into the file
    ``path``.
    """
    from granphon.figures.style import save_figure
    from granphon.figures.traces import traces_figure

    save_figure(traces_figure(traces, velocity), path)


def _describe(traces: Traces, velocity: TraceVelocity) -> list[tuple[str, str]]:
    """Return rows (name, text) on the ``velocity`` that ``traces`` show: how it was found, the
    arrival at each sensor, and, if degrees of freedom are left, how well a straight line fits.
    """
    rows = [
        ("velocity", write_uncertain(velocity.velocity, velocity.stderr, "m/s")),
        ("method", velocity.method),
        ("filter", velocity.filter),
        ("samples", f"{traces.times.size}, each {write_quantity(traces.time_step, 's')}"),
    ]
    columns = zip(
        traces.names,
        velocity.distances.tolist(),
        velocity.arrivals.tolist(),
        velocity.arrival_errors.tolist(),
        strict=True,
    )
    for name, distance, arrival, error in columns:
        place = write_quantity(distance, "m")
        rows.append((f"sensor {name} at {place}", write_uncertain(arrival, error, "s")))
    if velocity.dof:
        freedom = counted(velocity.dof, "degree of freedom", "degrees of freedom")
        rows.append(("chi^2", f"{velocity.chi2:.4g} for {freedom}, p = {velocity.p:.2g}"))
    return rows
