"""The commands that write, check and run a scene, and draw its results: ``init``, ``check``,
``run`` and ``plot``.
"""

from __future__ import annotations

import os
import sys
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granphon.base.errors import InputError
from granphon.cli.app import (
    FORCE,
    PICTURES,
    SCENES,
    WORK,
    Force,
    SceneFile,
    Scheduler,
    Values,
    Workers,
    command,
)
from granphon.cli.terminal import (
    GO_ON,
    NOTHING_WRITTEN,
    describe_result,
    describe_scene,
    require_name,
    say,
    say_table,
    tell_interruption,
    warn,
)

if TYPE_CHECKING:
    from granphon.media.cost import Cost
    from granphon.scene.scene import RunResult

#: the scenes that ``init`` writes; the first is the default
PRESETS = (
    "steel_hexagon",
    "steel_spread",
    "glass",
    "hydrogel",
    "chain",
    "membrane",
    "fcc",
    "hcp",
    "diatomic",
)
#: time of a run, s, above which the run is announced: a minute, up to which its time is told as
#: "seconds"
_LONG_SECONDS = 60.0
#: group of the options of ``run`` that say which files it writes
_FILES = "Files"


@command("init", rich_help_panel=SCENES)
def write_preset(
    path: Annotated[
        str, typer.Argument(metavar="[PATH]", help="The file to write.")
    ] = "scene.yaml",
    preset: Annotated[
        str,
        typer.Option(metavar="NAME", help="The scene to start from: " + ", ".join(PRESETS) + "."),
    ] = PRESETS[0],
    force: Force = False,
) -> None:
    """Write a commented scene to start from.

    \b
    Examples:
      granphon init
      granphon init beads.yaml --preset glass
    """
    from granphon.base.staging import ResultFiles, write_text
    from granphon.base.validation import choice, require
    from granphon.scene import file

    require("--preset", partial(choice, options=PRESETS), preset)
    require_name("PATH", path)
    # a file with the text of any preset is one that granphon wrote, which --force may replace
    texts = {name: file.write_preset(name) for name in PRESETS}
    target = Path(path)
    with ResultFiles(target.parent, [target.name], force, known_texts=texts.values()).open():
        write_text(target, texts[preset], replace=True)
    say(f"Wrote {path}. Next: granphon check {path}")


@command("check", rich_help_panel=SCENES)
def check_scene(scene_file: SceneFile, values: Values = None) -> None:
    """Check a scene, and show its values.

    Shows the values in readable units, force, overlap and stiffness of the contacts, the media that
    an automatic medium chooses, the files that a run would write, the time and memory of a long
    run, and at which loads a limit of the model is passed. Writes nothing and simulates no load;
    long checks are left to the run.

    \b
    Examples:
      granphon check scene.yaml
      granphon check scene.yaml --set "load.force=18.4 +- 0.2 N"
    """
    from granphon.scene.outputs import expected_files
    from granphon.scene.scene import Scene

    scene = Scene.from_yaml(scene_file, _read_values(values))
    rows = describe_scene(scene)  # first, because it raises if there is too little memory
    warnings, left_out = scene.plan.foresee_warnings()
    scene.to_yaml()  # raises now if a run could not write the scene
    if left_out:
        rows.append(("not checked yet", left_out))
    rows.append(("will write", ", ".join(expected_files(scene))))
    say(f"{scene_file} can be run.")
    say_table(rows)
    warn(warnings)


def _read_values(options: list[str] | None) -> dict[str, str]:
    """Return the values, texts by key, of options --set such as "load.force=18.4 N", none if
    ``options`` is None; InputError for an option without key or value, and for a key that is given
    twice.
    """
    values = {}
    for option in options or ():
        key, _equals, value = (text.strip() for text in option.partition("="))
        fault = ""
        if key in values:
            fault = "is given twice"
        elif not all(key.split(".")):
            fault = "names no key"
        elif not value:
            fault = "names no value"
        if fault:
            mend = "Write --set 'load.force=18.4 N', once for each key"
            raise InputError(f"--set {option} {fault}", mend=mend)
        values[key] = value
    return values


@command("run", rich_help_panel=SCENES)
def run_scene(
    scene_file: SceneFile,
    out: Annotated[
        str,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Folder for the results; made if needed.",
            rich_help_panel=_FILES,
        ),
    ],
    force: Annotated[bool, typer.Option("--force", help=FORCE, rich_help_panel=_FILES)] = False,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Leave what is complete as it is; go on with what is not.",
            rich_help_panel=WORK,
        ),
    ] = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    figures: Annotated[
        bool, typer.Option("--figures/--no-figures", help="Draw a figure.", rich_help_panel=_FILES)
    ] = True,
    quiet: Annotated[
        bool,
        typer.Option(
            "--quiet", "-q", help="No progress and no summary; warnings stay.", rich_help_panel=WORK
        ),
    ] = False,
    values: Values = None,
) -> None:
    """Compute what a scene observes and write it into a folder.

    The folder gets scene.yaml (defaults written out), summary.yaml (the main numbers), and
    sweep.nc and sweep.csv with every state. Of a single state bands add band.yaml and
    phonopy_params.yaml, the density of states adds dos.csv, a simulation adds sample.extxyz, and
    each a figure. If a run of several states is cut off, those that are finished are kept in the
    folder, and the same command continues from there. --force replaces an earlier result: it also
    removes the files of that result which the new scene does not write, and the finished part of
    another run. A file that the scene is read from, that granphon did not write, or that was
    changed since is never replaced.

    \b
    Examples:
      granphon run scene.yaml -o out
      granphon run scene.yaml -o out --force --no-figures
      granphon run scene.yaml -o out --set "material.young_modulus=211 +- 2 GPa"
      granphon run sweep.yaml -o out --resume --workers 4
      granphon run sweep.yaml -o out --scheduler tcp://10.0.0.1:8786
    """
    from granphon.base.progress import on_stderr
    from granphon.runs.workers import open_executor, require_workers
    from granphon.scene.scene import WORK_FILE, Scene, is_complete

    def describe_folder() -> str:
        """Return a sentence that says what an interruption has left in the folder ``out``."""
        if is_complete(scene, out):
            return f"{out} holds the whole result of this scene."
        has_work = scene.has_tasks and os.path.isfile(os.path.join(out, WORK_FILE))
        return f"{NOTHING_WRITTEN} {GO_ON}" if has_work else NOTHING_WRITTEN

    require_name("--out", out)
    require_workers(workers, scheduler)
    scene = Scene.from_yaml(scene_file, _read_values(values))
    if resume and not force and is_complete(scene, out):
        if not quiet:
            say(f"{out} is complete: it holds the results of this scene. Nothing was computed.")
        return
    cost = scene.cost()  # quiet or not, this refuses what does not fit into memory
    if cost is not None and not quiet:
        _announce_time(cost)
    with tell_interruption(describe_folder):
        opened_executor = open_executor(workers, scheduler) if scene.has_tasks else nullcontext()
        with opened_executor as executor:
            result = scene.run(
                out,
                force=force,
                progress=on_stderr(quiet),
                figures=figures,
                resume=resume,
                executor=executor,
            )
        warn(result.warnings)
        if not quiet:
            _say_result(result, out)


def _announce_time(cost: Cost) -> None:
    """Print on stderr about how long a run of this ``cost`` takes, if it takes longer than
    ``_LONG_SECONDS``.
    """
    if cost.takes_longer(_LONG_SECONDS):
        print(f"granphon: {cost.text} on one processor", file=sys.stderr, flush=True)


def _say_result(result: RunResult, out: str) -> None:
    """Print the main numbers of a ``result``, the names of its files in the folder ``out``, and its
    remarks.
    """
    say_table(describe_result(result))
    names = [path.name for path in result.files]
    say(f"Wrote {', '.join(names)} into {out}")
    for remark in result.remarks:
        say(remark)


@command("plot", rich_help_panel=PICTURES)
def draw_results(
    runs: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN", help="Folders of 'granphon run' or 'granphon fit', or files in them."
        ),
    ],
    out: Annotated[
        str | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="The file to write; its ending is the format (.png, .pdf, .svg).",
        ),
    ] = None,
    x: Annotated[
        str | None,
        typer.Option(
            "--x",
            metavar="NAME",
            help="What to draw over: force, pressure, overlap, reduced_force, or a parameter.",
        ),
    ] = None,
    y: Annotated[
        str | None,
        typer.Option(
            "--y",
            "--variable",
            metavar="NAME",
            help="What to draw over the load: any observable, such as bulk.",
        ),
    ] = None,
    where: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="Draw only these states of a sweep, as 'width=2 um, medium=ema'. 'force=1 N to"
            " 5 N' is a range; for several values repeat the name.",
        ),
    ] = None,
    rows: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="A parameter, or medium: each of its values has a row of panels."
        ),
    ] = None,
    columns: Annotated[
        str | None, typer.Option(metavar="NAME", help="The same for columns.")
    ] = None,
    data: Annotated[
        list[str] | None,
        typer.Option(
            "--data",
            metavar="FILE.csv",
            help="Measured velocities, as for 'granphon fit'. May be repeated.",
        ),
    ] = None,
    distance: Annotated[
        str | None,
        typer.Option(
            metavar="M",
            help="Distance of the times of flight in the data, such as '0.4 m +- 1 mm'.",
        ),
    ] = None,
    asymptotes: Annotated[
        bool, typer.Option("--asymptotes", help="Add the long waves to the bands of one run.")
    ] = False,
    backend: Annotated[
        str | None,
        typer.Option("--backend", metavar="NAME", help="The backend of matplotlib, such as pgf."),
    ] = None,
    force: Force = False,
) -> None:
    """Draw the results of one run, or of several in one figure.

    One run: the figure shows its bands, with the density of states beside them. A run without bands
    shows its density of states, motion, surface or response instead, and a sweep its velocities
    over the load, or what --y names. To draw another figure of the run, give its name to --out: "-o
    surface.pdf" draws the surface. The names are those of the figures that 'granphon run' draws.

    Several runs: the figure compares their curves over the load, or over what --x names; with
    --data it has measured points too. If all runs hold bands, it compares the bands. One run is
    drawn in this way if --x or --data is given.

    Sweeps over parameters: each combination of values has a curve. --where draws some of the curves
    only. --rows and --columns give each value of a parameter a small panel of its own. If there are
    too many curves for one panel, the parameters with the fewest values have panels, and a line
    says which.

    Without --out the figure of one run is written into its folder, and the figure of several runs
    as comparison.png into the working folder.

    \b
    Examples:
      granphon plot out --force
      granphon plot out --asymptotes -o figure.pdf
      granphon plot out -o surface.pdf
      granphon plot out --y contact_fraction -o contacts.pdf
      granphon plot out --where "width=2 um, medium=ema" --columns diameter -o some.pdf
      granphon plot steel glass --x pressure --data steel.csv -o both.pdf
    """
    from granphon.base.quantities import LENGTH, read_with_error
    from granphon.base.validation import require
    from granphon.figures.choices import read_wishes
    from granphon.scene.redraw import Comparison, View, draw_together, redraw

    require_name("--out", out)
    if distance is not None and not data:
        raise InputError("--distance is for times of flight", mend="Give them by --data")
    distance_of_data: Any = None
    if distance is not None:
        distance_of_data = require(
            "--distance", partial(read_with_error, quantity=LENGTH), distance
        )
    view = View(read_wishes(", ".join(where or ())), rows, columns)
    is_one_folder = len(runs) == 1 and not os.path.isfile(runs[0])
    if is_one_folder and x is None and not data:
        figure_file = redraw(
            runs[0],
            out,
            force=force,
            asymptotes=asymptotes,
            variable=y,
            backend=backend,
            view=view,
            tell=say,
        )
    elif asymptotes:
        problem = "--asymptotes is for the bands of one run"
        raise InputError(problem, mend="Leave it out, or give one folder")
    else:
        figure_file = draw_together(
            runs,
            out,
            force=force,
            comparison=Comparison(x, y, data or (), distance_of_data),
            backend=backend,
            view=view,
            tell=say,
        )
    say(f"Wrote {figure_file}")
