"""The command ``granphon``: a thin layer over the library."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granphon.base.errors import GranphonError, InputError, UnverifiedFileWarning, message
from granphon.cli.wording import announced, described, fitted, results

if TYPE_CHECKING:
    from granphon.scene.scene import Scene

__all__ = ["main"]

PRESETS = ("steel_hexagon", "steel_spread", "glass", "hydrogel")

#: what will take more seconds is announced
_LONG = 10.0

_NOTHING_WRITTEN = "no result was written."
_GO_ON = "What a sweep has finished is kept: the same command again goes on."

_EXIT_CODES = """\b
Exit codes:
  0    done
  1    the computation failed, or its result could not be written
  2    the input or the command line is wrong
  130  interrupted"""

app = typer.Typer(
    add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)  # fmt: skip


def _version(wanted: bool) -> None:
    if wanted:
        from granphon import __version__

        _say(f"granphon {__version__}")
        raise typer.Exit


@app.callback(epilog=_EXIT_CODES)
def _granphon(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Vibrations and sound velocities of granular crystals: elastic balls in contact, rotations included.

    \b
    Examples:
      granphon init                       write scene.yaml, commented
      granphon check scene.yaml           is it right, and what will be computed?
      granphon run scene.yaml -o out      compute, and write the folder out
      granphon plot out -o figure.pdf     draw the results again
      granphon tradeoff scene.yaml        what accuracy costs, measured
    """


_Force = Annotated[bool, typer.Option("--force", help="Replace files that granphon wrote and that were not changed since.")]
_SceneFile = Annotated[str, typer.Argument(metavar="SCENE", help="The scene file.")]


@app.command()
def init(
    path: Annotated[str, typer.Argument(metavar="[PATH]", help="The file to write.")] = "scene.yaml",
    preset: Annotated[str, typer.Option(help="What to start from: " + ", ".join(PRESETS) + ".")] = PRESETS[0],
    force: _Force = False,
) -> None:
    """Write a commented scene to start from.

    \b
    Examples:
      granphon init
      granphon init beads.yaml --preset glass
    """
    from importlib.resources import files

    from granphon.base.staging import opened, write_text
    from granphon.base.text import closest

    if preset not in PRESETS:
        meant = closest(preset, PRESETS)
        raise InputError(
            message(
                f"found the preset {preset!r}; allowed: {', '.join(PRESETS)}",
                mend=f"Did you mean {meant!r}" if meant else "",
            )
        )
    _named("PATH", path)
    texts = {name: (files("granphon") / "data" / f"{name}.yaml").read_text(encoding="utf-8") for name in PRESETS}
    target = Path(path)
    with opened(target.parent, [target.name], force, known=texts.values()):
        write_text(target, texts[preset])
    _say(f"Wrote {path}. Next: granphon check {path}")


@app.command()
def check(scene: _SceneFile) -> None:
    """Say whether a scene is right, and what it means.

    Shows the values in readable units, the files that a run would write, what a long one would take, and where the
    model fails. Writes nothing, and simulates nothing; what it would take long to look at is left to the run.

    \b
    Example:
      granphon check scene.yaml
    """
    from granphon.observables.validity import validity
    from granphon.scene.run import expected_files
    from granphon.scene.scene import Scene

    read = Scene.from_yaml(scene)
    rows = described(read)  # first, as it refuses what there is no memory for
    states, left = read.survey()
    warnings = [
        f"{where}: {warning}" if read.is_sweep else warning
        for where, state in states
        for warning in validity(state).warnings
    ]
    read.to_yaml()  # what a run writes first
    rows += [("left to the run", left)] if left else []
    _say(f"{scene} can be run.")
    _table(rows)
    _table([("will compute", ", ".join(read.observe)), ("will write", ", ".join(expected_files(read)))])
    _warn(warnings)


@app.command()
def run(
    scene: _SceneFile,
    out: Annotated[str, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results; made if needed.")],
    force: _Force = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Leave what is complete as it is; go on with what is not.")
    ] = False,
    workers: Annotated[int, typer.Option(min=1, metavar="N", help="Processes that share the work of a sweep.")] = 1,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw a figure.")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no summary; warnings stay.")] = False,
) -> None:
    """Compute what a scene observes and write it into a folder.

    The folder gets scene.yaml (every default written out) and summary.yaml (the numbers); bands add band.yaml and
    phonopy_params.yaml, the density of states adds dos.csv, a simulation adds sample.extxyz, and each a figure. A sweep,
    with several loads or media or a block 'sweep', makes sweep.nc and sweep.csv instead; what it has finished when it is
    cut off waits in the folder, and the same command again goes on from it. With --force an earlier result is replaced;
    files of it that the new scene does not write are removed, and so is what another sweep has finished there. Never
    replaced is a file that the scene is read from, that granphon did not write, or that was changed since.

    \b
    Examples:
      granphon run scene.yaml -o out
      granphon run scene.yaml -o out --force --no-figures
      granphon run sweep.yaml -o out --resume --workers 4
    """
    from granphon.base.progress import on_stderr
    from granphon.scene.result_files import WORK_FOLDER
    from granphon.scene.run import is_complete
    from granphon.scene.scene import Scene
    from granphon.sweeps.workers import worker_processes

    def left() -> str:
        """What an interruption has left."""
        if is_complete(read, out):
            return f"{out} holds the whole result of this scene."
        kept = read.is_sweep and os.path.isdir(os.path.join(out, WORK_FOLDER))
        return f"{_NOTHING_WRITTEN} {_GO_ON}" if kept else _NOTHING_WRITTEN

    _named("--out", out)
    read = Scene.from_yaml(scene)
    if resume and not force and is_complete(read, out):
        if not quiet:
            _say(f"{out} is complete: it holds what this scene gives. Nothing was computed.")
        return
    cost = read.cost()
    if cost is not None and not quiet and cost.seconds > _LONG:
        print(f"granphon: {announced(cost)}", file=sys.stderr, flush=True)
    with _interruption_told(left):
        with worker_processes(workers if read.is_sweep else 1) as executor:
            result = read.run(out, force, on_stderr(quiet), figures, resume, executor)
        _warn(result.warnings)
        if not quiet:
            _table(results(result))
            _say(f"Wrote {', '.join(path.name for path in result.files)} into {out}")


@app.command()
def plot(
    folder: Annotated[str, typer.Argument(metavar="DIR", help="A folder that 'granphon run' wrote.")],
    out: Annotated[
        str | None,
        typer.Option("--out", "-o", metavar="FILE", help="Where to; the ending says the format (.png, .pdf, .svg)."),
    ] = None,
    asymptotes: Annotated[bool, typer.Option("--asymptotes", help="Add the long waves to the bands.")] = False,
    variable: Annotated[
        str | None, typer.Option("--variable", metavar="NAME", help="Draw one variable of a sweep, such as bulk.")
    ] = None,
    backend: Annotated[
        str | None, typer.Option("--backend", metavar="NAME", help="The backend of matplotlib that draws, such as pgf.")
    ] = None,
    force: _Force = False,
) -> None:
    """Draw the results of a run again.

    The bands with the density of states beside them (bands.png in the folder, or the file given), or the velocities and
    exponents of a sweep (sweep.png).

    \b
    Examples:
      granphon plot out --force
      granphon plot out --asymptotes -o figure.pdf
      granphon plot out --variable contact_fraction -o contacts.pdf
    """
    from granphon.scene.redraw import redraw

    _named("--out", out)
    _say(f"Wrote {redraw(folder, out, force, asymptotes, variable, backend)}")


@app.command()
def fit(
    scene: _SceneFile,
    data: Annotated[str, typer.Argument(metavar="DATA.csv", help="The table of measured velocities.")],
    out: Annotated[str | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results.")] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Fit this as well as the width: young_modulus, diameter. May be repeated."),
    ] = None,
    frequency: Annotated[str | None, typer.Option(metavar="HZ", help="Of the pulses, such as '6.5 kHz'.")] = None,
    distance: Annotated[str | None, typer.Option(metavar="M", help="How far sound went, such as '0.4 m'.")] = None,
    sigma: Annotated[
        str | None, typer.Option(metavar="M/S", help="Standard error of velocities, such as '5 m/s' or '1 %'.")
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND=NAME", help="How a column is headed, such as 'velocity=v (km/s)'. May be repeated."),
    ] = None,
    branch: Annotated[str, typer.Option(metavar="NAME", help="longitudinal or transverse.")] = "longitudinal",
    direction: Annotated[tuple[float, float], typer.Option(metavar="X Y", help="Of propagation.")] = (0.0, 1.0),
    force: _Force = False,
) -> None:
    """Find the width of the distribution of diameters from measured sound velocities.

    The scene gives the balls and the medium; the width of its spread is replaced. The table has columns headed by names and
    units, 'force (N)', 'pressure (N/m)' or 'side_force (N)' (the scene then gives balls_per_side), 'velocity (m/s)' or
    'time (ms)' and 'distance (m)', and perhaps 'sigma (m/s)' or 'sigma (%)', 'time_sigma (us)', 'frequency (kHz)'.
    Velocities with a frequency are those of pulses. The folder gets fit.yaml, fit.csv and fit.png.

    \b
    Examples:
      granphon fit scene.yaml data.csv
      granphon fit scene.yaml data.csv -o fit --frequency "6.5 kHz" --parameter young_modulus
      granphon fit scene.yaml data.csv --column "force=F (kN)" --column time=t --distance "430 mm"
    """
    from functools import partial

    from granphon.balls.loads import force_of_frame
    from granphon.base.quantities import LENGTH
    from granphon.base.staging import check_free, staging
    from granphon.base.validation import require
    from granphon.fits.fit import FIT_FILES, fit_width, force_of_pressure
    from granphon.fits.measurements import FREQUENCY, Measurements, read_sigma
    from granphon.scene.scene import Scene

    _named("--out", out)
    read = Scene.from_yaml(scene)
    inputs: tuple[str | Path, ...] = (*read.inputs, data)
    if out is not None:
        check_free(out, FIT_FILES, force, inputs=inputs)
    _of_one_packing("A fit", scene, read)
    if len(read.media) > 1:
        raise InputError(message(f"{scene} has several media", mend="Leave the one that is to be fitted"))
    # the medium of a scene of equal balls says nothing about those that differ
    medium = read.media[0] if read.balls_differ or read.media[0].name != "ala" else "ema"
    balls = read.load.balls_per_side
    measured = Measurements.read(
        data,
        {kind.strip(): name for kind, _, name in (one.partition("=") for one in column or ())},
        None if distance is None else require("--distance", LENGTH.read, distance),
        None if balls is None else partial(force_of_frame, balls_per_side=balls),
        partial(force_of_pressure, read.packing, read.finite_overlap, medium, parameter or ()),
    )
    found = fit_width(
        read.packing, measured.force, measured.velocity,
        measured.sigma if sigma is None else require("--sigma", partial(read_sigma, velocity=measured.velocity), sigma),
        measured.frequency if frequency is None else require("--frequency", FREQUENCY.read, frequency),
        medium=medium, parameters=("width", *(parameter or ())), branch=branch, direction=direction,
        finite_overlap=read.finite_overlap,
    )  # fmt: skip
    failures: dict[str, str] = {}
    if out is not None:
        from granphon.figures.style import draw

        def figure(_: str) -> Any:
            from granphon.figures.fits import fit_figure  # a failure of this import is one of the figure

            return fit_figure(found)

        with staging(out, FIT_FILES, force, inputs, optional=["fit.png"]) as place:
            found.write(place)
            failures = draw(figure, ["fit.png"], place)
    with _interruption_told(lambda: _NOTHING_WRITTEN if out is None else f"the result was written into {out}."):
        _warn((*found.warnings, *failures.values()))
        _table(fitted(found))
        if out is not None:
            _say(f"Wrote {', '.join(name for name in FIT_FILES if name not in failures)} into {out}")


@app.command()
def tradeoff(
    scene: _SceneFile,
    out: Annotated[str | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for tradeoff.csv and .png.")] = None,
    budget: Annotated[
        str, typer.Option(metavar="TIME", help="What measuring may take; imports and drawing come on top.")
    ] = "3 minutes",
    loads: Annotated[int, typer.Option(min=1, metavar="N", help="At most so many of the loads.")] = 3,
    runs: Annotated[int, typer.Option(min=5, metavar="N", help="How often each point is timed.")] = 5,
    force: _Force = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no table; warnings stay.")] = False,
) -> None:
    """Measure what the media, and the knobs inside them, cost and are worth for a scene.

    For the balls and the loads of the scene: averaged lattice and force, effective medium, and simulations of several
    sizes; the grid of the Green's function; the solution of the effective medium; the mesh of the density of states, if the
    scene observes it. Each error is that of what the scene observes, against a reference that another algorithm has made;
    each time the median of warm runs. What does not fit into the budget is listed as not run. The folder gets tradeoff.csv
    and, as a picture, the work-precision diagrams.

    \b
    Examples:
      granphon tradeoff scene.yaml
      granphon tradeoff scene.yaml -o tradeoff --budget "20 minutes" --loads 5
    """
    from granphon.base.progress import on_stderr
    from granphon.base.staging import check_free, staging
    from granphon.base.validation import require
    from granphon.cli.wording import work_and_precision
    from granphon.fits.measurements import TIME
    from granphon.scene.scene import Scene
    from granphon.tradeoffs.measure import TRADEOFF_FILES
    from granphon.tradeoffs.measure import tradeoff as measure

    _named("--out", out)
    seconds = require("--budget", TIME.read, budget)
    read = Scene.from_yaml(scene)
    if out is not None:
        check_free(out, TRADEOFF_FILES, force, inputs=read.inputs)
    _of_one_packing("A trade-off", scene, read)
    load = read.load.applied
    given: dict[str, Any] = {load.kind: load.values}
    found = measure(
        read.packing, **given, observe=read.observe, finite_overlap=read.finite_overlap, budget=seconds, most_loads=loads,
        runs=runs, progress=on_stderr(quiet),
    )  # fmt: skip
    failures: dict[str, str] = {}
    if out is not None:
        from granphon.figures.style import draw

        def figure(_: str) -> Any:
            from granphon.figures.work_precision import tradeoff_figure  # a failure of this import is one of the figure

            return tradeoff_figure(found)

        with staging(out, TRADEOFF_FILES, force, read.inputs, optional=["tradeoff.png"]) as place:
            (place / "tradeoff.csv").write_text(found.csv(), encoding="utf-8")
            failures = draw(figure, ["tradeoff.png"], place)
    with _interruption_told(lambda: _NOTHING_WRITTEN if out is None else f"the result was written into {out}."):
        _warn(tuple(failures.values()))
        if not quiet:
            for line in work_and_precision(found):
                _say(line)
            if out is not None:
                _say(f"Wrote {', '.join(name for name in TRADEOFF_FILES if name not in failures)} into {out}")


def _of_one_packing(what: str, scene: str, read: Scene) -> None:
    if read.parameters:
        swept = f"{scene} sweeps {', '.join(name for name, _ in read.parameters)}"
        raise InputError(message(swept, f"{what} is that of one packing", "Leave the block 'sweep' out"))


def _named(option: str, path: str | None) -> None:
    if path == "":
        raise InputError(message(f"{option} is empty", mend="Name a file or folder; was a shell variable not set"))


# -- what is printed ------------------------------------------------------------------------------------------------


def _table(rows: Sequence[tuple[str, str]]) -> None:
    for name, text in rows:
        _say(f"  {name:<22}{text}")


def _say(text: str) -> None:
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    print(text.encode(encoding, "backslashreplace").decode(encoding))


def _warn(warnings: Sequence[str], most: int = 10) -> None:
    more = [f"and {len(warnings) - most} more"] if len(warnings) > most else []
    for warning in (*warnings[:most], *more):
        print(f"granphon: warning: {warning}", file=sys.stderr)


def _fail(text: str, code: int) -> int:
    print("granphon: error: " + " ".join(text.split()), file=sys.stderr)
    return code


# -- the entry ------------------------------------------------------------------------------------------------------

#: the base of typer's usage errors, wherever this version of typer keeps it
_USAGE_ERROR = next(one for one in typer.BadParameter.__mro__ if one.__name__ == "ClickException")


class _Interrupted(Exception):
    """An interruption; says what it has left."""


@contextmanager
def _interruption_told(left: Callable[[], str]) -> Iterator[None]:
    """Let an interruption of the block say what it has ``left``."""
    try:
        yield
    except KeyboardInterrupt:
        raise _Interrupted(left()) from None


@contextmanager
def _terminated_like_interrupted() -> Iterator[None]:
    """Let SIGTERM (a batch system's time limit, ``kill``) clean up as an interruption does."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _unverified_files_told() -> Iterator[None]:
    """Say in one line of a file that carries no digest that it does; other warnings stay as they are."""
    with warnings.catch_warnings():
        show = warnings.showwarning

        def tell(
            message: Warning | str, category: type[Warning], filename: str, lineno: int, file: Any = None, line: Any = None
        ) -> None:
            if issubclass(category, UnverifiedFileWarning):
                _warn([str(message)])
            else:
                show(message, category, filename, lineno, file, line)

        warnings.simplefilter("always", UnverifiedFileWarning)
        warnings.showwarning = tell
        yield


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code, listed in ``granphon --help``. Raises nothing but bugs."""
    try:
        with _terminated_like_interrupted(), _unverified_files_told():
            code = app(args=None if argv is None else list(argv), prog_name="granphon", standalone_mode=False)
        if sys.stdout is not None:  # closed before we started
            sys.stdout.flush()
        if code == 130:  # typer has caught the interruption
            raise KeyboardInterrupt
        return int(code or 0)
    except InputError as error:
        return _fail(str(error), 2)
    except GranphonError as error:
        return _fail(str(error), 1)
    except MemoryError:
        return _fail(
            "there is not enough memory for this scene. Take a coarser mesh, or fewer points, loads, balls or samples.", 1
        )
    except _Interrupted as interrupted:
        return _fail(f"interrupted; {interrupted}", 130)
    except (KeyboardInterrupt, typer.Abort):
        return _fail(f"interrupted; {_NOTHING_WRITTEN}", 130)
    except BrokenPipeError:
        # whoever read our output has gone: keep the interpreter from writing into the pipe again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _fail(f"{error.filename or 'output'}: {error.strerror or error}", 1)
    except Exception as error:
        if isinstance(error, _USAGE_ERROR):
            return _fail(f"{error.format_message()} See 'granphon --help'.", 2)  # type: ignore[attr-defined]
        raise
