"""The commands that compare: ``fit`` compares a scene with measurements, and ``tradeoff`` media
with each other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from granphon.base.errors import InputError, Refused
from granphon.base.text import show
from granphon.cli.app import COMPARISONS, Force, SceneFile, Scheduler, Workers, command
from granphon.cli.terminal import (
    GO_ON,
    NOTHING_WRITTEN,
    describe_fit,
    describe_response_fit,
    describe_tradeoff,
    require_name,
    say,
    say_table,
    tell_interruption,
    warn,
    write_direction,
)

if TYPE_CHECKING:
    from granphon.balls.packing import Packing
    from granphon.base.staging import ResultFiles
    from granphon.fits.transfer import DampingFit
    from granphon.scene.scene import Scene


@command("fit", rich_help_panel=COMPARISONS)
def fit_measurements(
    scene: SceneFile,
    data: Annotated[
        str, typer.Argument(metavar="DATA.csv", help="Measured velocities, or a transfer function.")
    ],
    out: Annotated[
        str | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results.")
    ] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Fit this as well: young_modulus, diameter; or, of a response: damping. May be"
            " repeated.",
        ),
    ] = None,
    frequency: Annotated[
        str | None, typer.Option(metavar="HZ", help="Frequency of the pulses, such as '6.5 kHz'.")
    ] = None,
    distance: Annotated[
        str | None,
        typer.Option(metavar="M", help="Distance of the time of flight, such as '0.4 m'."),
    ] = None,
    sigma: Annotated[
        str | None,
        typer.Option(metavar="M/S", help="Standard error of velocities, such as '5 m/s' or '1 %'."),
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND=NAME",
            help="Name of a column, such as 'velocity=v (km/s)'. May be repeated.",
        ),
    ] = None,
    width: Annotated[
        bool, typer.Option("--width/--no-width", help="Fit the width, or keep the scene's spread.")
    ] = True,
    branch: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="longitudinal or transverse; in space transverse_slow, transverse_fast.",
        ),
    ] = "longitudinal",
    direction: Annotated[
        str | None,
        typer.Option(
            metavar="'X Y'",
            help="Direction of sound, a number for each period; by default the scene's, else the"
            " last axis.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Fit the spread to velocities, or damping to a response.

    The scene gives the balls and the medium; the fit replaces the width of its spread. Equal balls
    in the medium ala are fitted with ema, and the loads of the scene are not used; a warning says
    so if it has several.

    Each column of the table has a name and a unit. The load is 'force (N)', 'pressure (N/m)' (in
    space 'pressure (kPa)') or 'side_force (N)' (the scene then gives balls_per_side). The velocity
    is 'velocity (m/s)', or 'time (ms)' and 'distance (m)', or 'cutoff (kHz)', the highest frequency
    of the branch. If known, there are also 'sigma (m/s)' or 'sigma (%)', 'time_sigma (us)' or
    'cutoff_sigma (Hz)', and 'frequency (kHz)'. Velocities with a frequency are those of pulses. The
    folder gets fit.yaml, fit.csv and fit.png.

    \b
    Examples:
      granphon fit scene.yaml data.csv
      granphon fit scene.yaml data.csv -o fit --frequency "6.5 kHz" --parameter young_modulus
      granphon fit scene.yaml data.csv --column "force=F (kN)" --column time=t --distance "430 mm"
      granphon fit fcc.yaml data.csv --no-width --parameter young_modulus --direction "1 1 0"
      granphon fit chain.yaml transfer.csv --parameter damping --parameter stiffness
    """
    from granphon.balls.loads import force_of_frame
    from granphon.base.quantities import FREQUENCY, LENGTH
    from granphon.base.staging import ResultFiles
    from granphon.base.tables import Table
    from granphon.base.validation import require
    from granphon.fits.fit import FIT_FILES, convert_cutoff, convert_pressure, fit_width
    from granphon.fits.measurements import Measurements, read_sigma
    from granphon.fits.transfer import TransferFunction
    from granphon.scene.scene import Scene

    require_name("--out", out)
    read = Scene.from_yaml(scene)
    files = (
        None
        if out is None
        else ResultFiles(out, FIT_FILES, force, inputs=(*read.origin.inputs, data))
    )
    if files is not None:
        files.require_free()
    given = tuple(parameter or ())
    columns = {kind.strip(): name for kind, _, name in (one.partition("=") for one in column or ())}
    if twice := [name for name in dict.fromkeys(given) if given.count(name) > 1]:
        raise InputError(
            f"--parameter {twice[0]} is given {given.count(twice[0])} times", mend="Give it once"
        )
    table = Table.read(data)
    if any(columns.get(one, one) in table for one in ("magnitude", "phase")):
        options = {
            "--frequency": frequency,
            "--distance": distance,
            "--sigma": sigma,
            "--direction": direction,
        }
        for name in (name for name, value in options.items() if value is not None):
            raise InputError(
                f"{name} is for velocities, and {data} has a transfer function", mend="Leave it out"
            )
        damped = _fit_response(scene, read, data, columns, given)
        _finish_fit(out, files, damped, damped.warnings, describe_response_fit(damped))
        return
    sound = any(columns.get(one, one) in table for one in ("velocity", "time", "cutoff"))
    if not sound and (read.packing.kind_names or read.response is not None):
        TransferFunction.read(data, columns)  # names the column that a transfer function lacks
    packing = _require_one_packing("A fit", scene, read)
    # the direction of the option, else that of the scene
    along: Sequence[float] | None = read.directions[0] if len(read.directions) == 1 else None
    if direction is not None:
        along = require("--direction", _read_direction, direction)
    elif len(read.directions) > 1:
        why = "A fit takes sound along one direction"
        raise InputError(
            f"{scene} has {len(read.directions)} directions", why, "Name one by --direction"
        )
    if len(read.media) > 1:
        raise InputError(f"{scene} has several media", mend="Keep only the one to fit with")
    if "width" in given and not width:
        raise InputError(
            "--no-width keeps the width, and --parameter width fits it", mend="Leave one out"
        )
    if not (width or parameter):
        raise InputError(
            "nothing is left to fit",
            "--no-width keeps the spread",
            "Leave it out, or give --parameter",
        )
    # "ala" is the default for equal balls, so it does not say how balls that differ are to be
    # averaged
    replaced = width and read.media[0].name == "ala" and not read.balls_differ
    medium = "ema" if replaced else read.media[0]
    balls = read.load.balls_per_side
    far = None if distance is None else require("--distance", LENGTH.read, distance)
    frame = None if balls is None else partial(force_of_frame, balls_per_side=balls)
    pressed = partial(convert_pressure, packing, read.finite_overlap, medium, given)
    carried = partial(convert_cutoff, packing, branch, along, read.finite_overlap, given)
    measured = Measurements.read(
        data, columns, far, frame, pressed, packing.structure.periods, carried
    )
    found = fit_width(
        packing,
        measured.force,
        measured.velocity,
        measured.sigma
        if sigma is None
        else require("--sigma", partial(read_sigma, velocity=measured.velocity), sigma),
        measured.frequency
        if frequency is None
        else require("--frequency", FREQUENCY.read, frequency),
        medium=medium,
        parameters=tuple(dict.fromkeys(("width",) * width + given)),
        branch=branch,
        direction=along,
        finite_overlap=read.finite_overlap,
    )

    notes = [
        f"{scene} has the medium ala, which knows no width: the fit takes ema. Name afa or"
        f" ema in it"
    ] * replaced
    if (count := len(read.load.values)) > 1:
        notes.append(f"the {count} loads of {scene} are not used: a fit takes the loads of {data}")
    if direction is None and read.direction is None and not found.is_isotropic:
        notes.append(
            f"sound in the lattice {found.packing.structure.name} depends on the direction,"
            f" and none is given: the fit"
            f" takes {write_direction(found.waves.direction)}. Give --direction, or direction"
            f" in {scene}"
        )
    _finish_fit(out, files, found, (*notes, *found.warnings), describe_fit(found))


def _fit_response(
    scene: str, read: Scene, data: str, columns: Mapping[str, str], names: tuple[str, ...]
) -> DampingFit:
    """Fit the damping of the network of a scene with one state, and a block response, to a transfer
    function.
    """
    from granphon.fits.transfer import TransferFunction, fit_damping
    from granphon.waves.settings import find_place

    wanted = read.response
    if wanted is None:
        what = f"{scene} has no block response, and {data} has a transfer function"
        raise InputError(
            what,
            "It says where the network is driven and heard",
            "Write it, with observe: [response]",
        )
    if read.n_states > 1:
        raise InputError(
            f"{scene} has {read.n_states} states",
            "A transfer function is of one",
            "Keep one load and medium",
        )
    measured = TransferFunction.read(data, columns, wanted.quantity)
    return fit_damping(
        wanted.shape(read.cases[0].state.network),
        measured,
        [find_place(one) for one in wanted.source],
        [find_place(one) for one in wanted.receiver],
        parameters=names or ("damping",),
        damping=wanted.damping,
        loss_factor=wanted.loss_factor,
        quantity=wanted.quantity,
        direction=wanted.direction,
        polarisation=wanted.polarisation,
        distance=wanted.distance,
    )


def _finish_fit(
    out: str | None,
    files: ResultFiles | None,
    found: Any,
    notes: Sequence[str],
    table: list[tuple[str, str]],
) -> None:
    from granphon.fits.fit import FIT_FILES

    def figure(_: str) -> Any:
        # here, so that a failed import counts as a failed figure
        from granphon.figures.plot import (
            plot,
        )

        return plot(found)

    failures: dict[str, str] = {}
    if files is not None:
        with files.open() as locked:
            failures = _stage_study(locked, found.write, figure)
    with tell_interruption(
        lambda: NOTHING_WRITTEN if out is None else f"the result was written into {out}."
    ):
        warn((*notes, *failures.values()))
        say_table(table)
        _say_written(out, FIT_FILES, failures)


def _read_direction(value: str) -> list[float]:
    try:
        return [float(word) for word in value.replace(",", " ").split()]
    except ValueError:
        raise Refused(show(value), "numbers parted by spaces, such as '0 1'") from None


@command("tradeoff", rich_help_panel=COMPARISONS)
def measure_tradeoff(
    scene: SceneFile,
    out: Annotated[
        str | None,
        typer.Option("--out", "-o", metavar="DIR", help="Folder for tradeoff.csv and .png."),
    ] = None,
    budget: Annotated[
        str,
        typer.Option(
            metavar="TIME", help="Time for the measurements; imports and drawing are extra."
        ),
    ] = "3 minutes",
    loads: Annotated[
        int, typer.Option(min=1, metavar="N", help="Largest number of loads to use.")
    ] = 3,
    runs: Annotated[
        int, typer.Option(min=5, metavar="N", help="Number of timed runs of each point.")
    ] = 5,
    workers: Workers = None,
    scheduler: Scheduler = None,
    force: Force = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="No progress and no table; warnings stay.")
    ] = False,
) -> None:
    """Measure time, memory and error of the media for a scene.

    For the balls and the loads of the scene it compares the averaged lattice, the averaged force,
    the effective medium, and simulations of several sizes, with arrays at rest without friction or,
    if a medium of the scene has friction_history, with arrays loaded with friction. An error is
    that of the observed quantities, against an ensemble of such arrays that another algorithm has
    checked. A time is the median of warm runs, measured by the worker: --workers and --scheduler
    need an idle processor. What does not fit into the budget is listed as not run. The folder gets
    tradeoff.csv and tradeoff.png, the work-precision diagram.

    \b
    Examples:
      granphon tradeoff scene.yaml
      granphon tradeoff scene.yaml -o tradeoff --budget "20 minutes" --loads 5
    """
    from granphon.base.progress import on_stderr
    from granphon.base.quantities import TIME
    from granphon.base.staging import ResultFiles
    from granphon.base.validation import require
    from granphon.media.loading import REFERENCE_OPTIONS, REST
    from granphon.runs.store import open_store
    from granphon.runs.workers import open_executor, require_workers
    from granphon.scene.scene import WORK_FILE, Scene
    from granphon.tradeoffs.measure import TRADEOFF_FILES, tradeoff

    require_name("--out", out)
    require_workers(workers, scheduler)
    seconds = require("--budget", TIME.read, budget)
    read = Scene.from_yaml(scene)
    files = (
        None if out is None else ResultFiles(out, TRADEOFF_FILES, force, inputs=read.origin.inputs)
    )
    if files is not None:
        files.require_free()
    packing = _require_one_packing("A trade-off", scene, read)
    load = read.load.applied
    # the truth that the media name: arrays at rest without friction, unless one has a history
    loaded = list(
        dict.fromkeys(one.history.reference for one in read.media if one.history.is_loaded)
    ) or [REST]
    if len(loaded) > 1:
        what = f"the media of {scene} are loaded with friction in {len(loaded)} ways"
        raise InputError(what, "A trade-off judges all by one of them", "Keep one")
    truth = loaded[0].options
    given: dict[str, Any] = {
        load.kind: load.values,
        **{name: truth[name] for name in REFERENCE_OPTIONS},
    }
    work = None if out is None else Path(out) / WORK_FILE
    failures: dict[str, str] | None = None

    def left() -> str:
        """Describe what an interruption has left in the folder."""
        if work is None:
            return NOTHING_WRITTEN
        if failures is not None:
            return f"the result was written into {out}."
        return f"{NOTHING_WRITTEN} {GO_ON}" if work.is_file() else NOTHING_WRITTEN

    def write(place: Path) -> None:
        (place / "tradeoff.csv").write_text(found.csv(), encoding="utf-8")

    def figure(_: str) -> Any:
        # here: a failed import counts as a failed figure
        from granphon.figures.work_precision import (
            tradeoff_figure,
        )

        return tradeoff_figure(found)

    with (
        tell_interruption(left),
        nullcontext() if files is None else files.open() as locked,
        open_store(work, force) as store,
    ):
        with open_executor(workers, scheduler) as executor:
            # of simulations in their exact geometry the scene has not asked for it, and media are
            # compared in the limit
            asked = read.finite_overlap and not all(one.is_exact for one in read.media)
            found = tradeoff(
                packing,
                **given,
                observe=read.observe,
                finite_overlap=asked,
                budget=seconds,
                most_loads=loads,
                runs=runs,
                progress=on_stderr(quiet),
                executor=executor,
                store=store,
            )
        failures = {} if locked is None else _stage_study(locked, write, figure)
    with tell_interruption(left):
        warn(tuple(failures.values()))
        if not quiet:
            for line in describe_tradeoff(found, packing.structure.periods):
                say(line)
            _say_written(out, TRADEOFF_FILES, failures)


def _stage_study(
    locked: ResultFiles, write: Callable[[Path], None], figure: Callable[[str], Any]
) -> dict[str, str]:
    """Write the files into their folder, which is locked.

    Returns, for the name of each figure that could not be drawn, the reason.
    """
    from granphon.figures.style import draw

    drawn = [name for name in locked.names if name.endswith(".png")]
    with locked.staging(drawn) as place:
        write(place)
        return draw(figure, drawn, place)


def _say_written(out: str | None, names: Sequence[str], failures: Mapping[str, str]) -> None:
    if out is not None:
        say(f"Wrote {', '.join(name for name in names if name not in failures)} into {out}")


def _require_one_packing(what: str, scene: str, read: Scene) -> Packing:
    if read.packing.kind_names:
        mend = "Describe balls of one kind by the blocks material and packing"
        raise InputError(f"{scene} has balls of several kinds", f"{what} is for one packing", mend)
    if read.parameters:
        swept = f"{scene} sweeps {', '.join(name for name, _ in read.parameters)}"
        raise InputError(swept, f"{what} is for one packing", "Leave the block 'sweep' out")
    return cast("Packing", read.packing)
