"""Drawing the results of runs again from the files in their folders, without computing them."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granphon.base.errors import InputError, MissingFileError
from granphon.base.staging import ResultFiles, read_written_files
from granphon.base.text import read_bytes, read_yaml, require_path
from granphon.figures.plot import OF_STATES, choose_figure
from granphon.scene.outputs import (
    OUTPUTS,
    Export,
    Results,
    Tell,
    list_figures,
    read_summary,
    require_folder,
    shows_curves,
)

if TYPE_CHECKING:
    from granphon.dynamics.contact_lattice import ContactLattice
    from granphon.figures.curves import Run


#: endings of the files of figures
_FIGURE_ENDINGS = (".pdf", ".png", ".svg")


@dataclass(frozen=True)
class View:
    """What a figure shows of a sweep.

    Attributes
    ----------
    where : the states that are drawn: texts of values by the name of a parameter, of the load, or
        "medium", as :func:`granphon.figures.choices.choose_states` takes them; empty for all.
    rows, columns : the parameters, or "medium", whose values have rows and columns of panels; None
        where granphon chooses.
    """

    where: Mapping[str, Sequence[str]] = field(default_factory=dict)
    rows: str | None = None
    columns: str | None = None


@dataclass(frozen=True)
class Comparison:
    """What a figure of several runs compares. The attributes are the arguments of the same names of
    :func:`granphon.figures.curves.plot_together`; ``distance`` is in metres.
    """

    x: str | None = None
    y: str | None = None
    data: Sequence[str | os.PathLike[str]] = ()
    distance: float | tuple[float, float] | None = None


#: all states of a sweep, in the panels that granphon chooses
WHOLE = View()
#: the quantities that granphon chooses, without measured values
USUAL_COMPARISON = Comparison()
#: why some figures do not take an option, by the name of the option
_REASONS_OF_REFUSALS = {
    "asymptotes": "Long waves are drawn beside bands only",
    "variable": "Only the curves of a sweep have a variable",
    "where": "Only states of a sweep are chosen",
    "rows": "Only curves over the load or a parameter have rows and columns",
    "columns": "Only curves over the load or a parameter have rows and columns",
}


def redraw(
    folder: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    asymptotes: bool = False,
    variable: str | None = None,
    backend: str | None = None,
    view: View = WHOLE,
    tell: Tell | None = None,
) -> Path:
    """Draw the results in a run's folder again, in one figure, and return the path of its file.

    Parameters
    ----------
    folder : folder of the run or fit.
    out : file of the figure, whose ending .pdf, .png or .svg is the format. The name of a figure of
        the table of outputs, as surface, spectrum or motion, or one of a plug-in, means that
        figure; bands, dos, sweep and fit only if the folder has it. By default, in the folder, the
        figure that comes first: design.png, bands.png, or dos.png without bands; of one state
        without these that of its motion, surface or response; else sweep.png or, of a sweep without
        curves, the figure of what it observes; or fit.png.
    force : overwrite a file that granphon wrote and that was not changed since.
    asymptotes : add to the bands the long waves (equations 13-15) of the scene in the folder.
    variable : name of the one variable of a sweep to draw.
    backend : matplotlib backend that draws, such as "pgf"; by default the one that belongs to the
        ending of ``out``.
    view : which states of a sweep are drawn, and in which panels.
    tell : called with a sentence, if the curves of a sweep are shared out among panels that the
        ``view`` does not name, or if a figure leaves something out.

    Raises
    ------
    MissingFileError : there is no such folder, or a file of the run that is drawn is missing there.
    InputError : ``folder`` or ``out`` is no path; the folder holds nothing to draw, or not the
        figure that ``out`` names; its files are damaged, or change meanwhile; the format, the
        variable or a state of the ``view`` is unknown; or an option belongs to another kind of
        result.
    FigureError : matplotlib cannot draw it.
    FileExistsInRunError, OutputError : the figure cannot be written.
    """
    require_path(folder)
    if out is not None:
        require_path(out)
    source = Path(folder)
    asks_for_sweep = variable is not None or view != WHOLE
    row = _choose_output(
        source, None if out is None else Path(out).stem, asks_for_sweep=asks_for_sweep
    )
    options: dict[str, Any] = {name: value for name, value in vars(view).items() if value}
    if variable is not None:
        options["variable"] = variable
    names_of_options = list(options)
    if asymptotes:
        names_of_options.append("asymptotes")
    _require_options(row, source, names_of_options)
    target = source / row.figure if out is None else Path(out)

    def draw() -> Any:
        """Return the figure of the output ``row``; it reads the results from the folder."""
        if asymptotes:
            options["asymptotes"] = _find_lattice(source)
        return row.make_figure(Results(source), tell, **options)

    return _draw(target, force, draw, [source], backend)


def _require_options(row: Export, source: Path, names: Sequence[str]) -> None:
    """Raise InputError unless the figure of the output ``row`` in the folder ``source`` takes all
    options called ``names``. The option "asymptotes", long waves, also needs bands in the folder.
    """
    refused_names = [name for name in names if name not in row.options]
    has_bands = OUTPUTS["bands"].find_source(source) is not None
    if "asymptotes" in names and "asymptotes" in row.options and not has_bands:
        refused_names.append("asymptotes")
    if refused_names:
        words = " and ".join(refused_names)
        reasons = dict.fromkeys(_REASONS_OF_REFUSALS[name] for name in refused_names)
        problem = f"{row.figure} of {source} cannot be drawn with {words}"
        raise InputError(problem, ". ".join(reasons), f"Leave {words} out")


def _choose_states_of_run(run: Run, view: View) -> Run:
    """Return the ``run`` with those states of its data set alone that a ``view`` chooses; the same
    object if the run has no data set, or if the view has no wishes ``where``.
    """
    if run.dataset is None or not view.where:
        return run
    from granphon.figures.choices import choose_states

    return replace(run, dataset=choose_states(run.dataset, view.where, run.name))


def _choose_output(source: Path, stem: str | None, *, asks_for_sweep: bool) -> Export:
    """Return the output in the folder ``source`` whose figure is drawn.

    ``stem`` is the name of the figure's file without its ending, None if the user names no file; if
    it is the name of a figure, it may choose the output (:func:`_find_named`). Otherwise:

    - States, also a single one, are drawn as curves over the load if ``asks_for_sweep``, that is
      if the user gives an option of sweeps.
    - Else the output that comes first by its rank is drawn; but curves of a run that observes
      nothing for curves are drawn only if the folder holds no other figure.
    - If the figure of this output draws each state by itself, and there are several states, the
      curves are drawn in its place.

    InputError if the folder has no result that can be drawn, or none of the figure that is named.
    """
    _require_results(source)
    rows = list_figures(source)
    named_row = _find_named(source, stem, rows)
    if named_row is not None:
        return named_row
    if not rows:
        raise _explain_no_result(source)
    curves = OUTPUTS["sweep"]
    if curves not in rows:
        return _find_first(rows)
    if asks_for_sweep:
        return curves
    first_row = _find_first(rows)
    other_rows = [row for row in rows if row is not curves]
    if first_row is curves and other_rows and not _observes_curves(source):
        return _find_first(other_rows)
    if first_row.name in OF_STATES:
        return OUTPUTS[choose_figure(Results(source).dataset, [first_row.name])]
    return first_row


def _find_named(source: Path, stem: str | None, rows: Sequence[Export]) -> Export | None:
    """Return the output whose figure has the name ``stem``, if it is among the ``rows`` that can be
    drawn from the folder ``source``.

    None if ``stem`` is no name of a figure. "bands", "dos", "sweep" and "fit", the figures of the
    outputs of :func:`_list_joined`, also count as no name if the folder lacks them: they may name
    the figure of a whole run, whatever it shows. InputError for other figures that it lacks.
    """
    joined_sources = [row.source for row in _list_joined()]
    for _name, row in OUTPUTS.items():
        if row.draw is None or row.stem != stem:
            continue
        if row in rows:
            return row
        if row.source not in joined_sources:
            mend = "Give the figure another name"
            why = "" if row.source else _explain_unkept(row)
            raise InputError(f"{source} holds no {stem} to draw", why, mend)
    return None


def _find_first(rows: Sequence[Export]) -> Export:
    """Return that of the outputs ``rows``, one at least, whose figure comes first: the one of the
    least rank, where rank 0 comes last.
    """
    return min(rows, key=lambda row: row.rank or math.inf)


def _observes_curves(source: Path) -> bool:
    """Whether the run in the folder ``source``, which holds its states, observes something that is
    drawn as curves over the load.
    """
    return shows_curves(json.loads(Results(source).dataset.attrs["observe"]))


def _explain_unkept(row: Export) -> str:
    """Return a sentence that says which command alone draws the figure of ``row``, because no
    folder holds its numbers.
    """
    return f"{row.figure} is drawn by 'granphon {row.command}' alone"


def _explain_no_result(source: Path) -> InputError:
    """Return the error that the folder ``source`` has no result that can be drawn. The error says
    which command draws a figure that is in the folder though its numbers are in no folder.
    """
    unkept_rows = [row for _name, row in OUTPUTS.items() if row.figure and not row.source]
    reasons = [_explain_unkept(row) for row in unkept_rows if (source / row.figure).is_file()]
    mend = "Give a folder of 'granphon run' with bands, a density of states or a sweep"
    return InputError(f"{source} holds no result that can be drawn", "; ".join(reasons), mend)


def draw_together(
    sources: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    comparison: Comparison = USUAL_COMPARISON,
    backend: str | None = None,
    view: View = WHOLE,
    tell: Tell | None = None,
) -> Path:
    """Draw the results of several runs in one figure, and return the path of its file.

    Parameters
    ----------
    sources : folders of runs and of fits, or files of results in them.
    out : file of the figure, whose ending .pdf, .png or .svg is the format; by default
        comparison.png in the working folder.
    force : overwrite a file that granphon wrote and that was not changed since.
    comparison : the quantities that are compared, and measured values beside them.
    backend : matplotlib backend that draws; by default the one that belongs to the ending of
        ``out``.
    view : which states of the runs are drawn; a run that is swept over none of the names of
        ``view.where`` is drawn whole. A single sweep alone has ``rows`` and ``columns``.
    tell : as in :func:`redraw`.

    Raises
    ------
    MissingFileError : there is no such folder or file, or a file of a run is missing.
    InputError : there are no ``sources``; one of them, or ``out``, is no path; a folder or file is
        given twice, the runs cannot share an axis, no run has the states of the ``view``, a file is
        damaged, or the format is unknown; nothing is written then.
    FigureError : matplotlib cannot draw it.
    FileExistsInRunError, OutputError : the figure cannot be written.
    """
    for source in sources:
        require_path(source)
    if out is not None:
        require_path(out)
    names = [str(source) for source in sources]
    # the same folder or file may be written in several ways, as "run" and "./run/"
    real_paths = [os.path.realpath(name) for name in names]
    for name, real_path in zip(names, real_paths, strict=True):
        if real_paths.count(real_path) > 1:
            raise InputError(f"{name} is given twice", mend="Give each run once")

    def draw() -> Any:
        """Return the figure that compares the runs, read when it is needed."""
        from granphon.figures.curves import comparison_figure

        runs = _choose_states_of_runs([read_run(name) for name in names], view)
        # measured loads may be side forces on a hexagonal frame
        balls_per_side = _find_balls_per_side(names) if comparison.data else None
        return comparison_figure(
            runs,
            **vars(comparison),
            balls_per_side=balls_per_side,
            rows=view.rows,
            columns=view.columns,
            tell=tell,
        )

    paths = [Path(name) for name in (*names, *map(str, comparison.data))]
    folders = [path for path in map(Path, names) if path.is_dir()]
    files = [path for path in paths if path.is_file()]
    target = Path("comparison.png" if out is None else out)
    return _draw(target, force, draw, folders, backend, files)


def _choose_states_of_runs(runs: Sequence[Run], view: View) -> list[Run]:
    """Return the ``runs``, each with the states that the wishes ``view.where`` choose by the names
    of parameters, of the load, or by "medium". A run that is swept over none of these names, such
    as a fit, stays whole; without wishes all runs do.

    InputError if there are wishes and all runs would stay whole, and as
    :func:`~granphon.figures.choices.choose_states` raises it: for a run that lacks some of the
    names or values, and for a text that cannot be a value.
    """
    from granphon.figures.choices import find_dimension

    chosen_runs = []
    is_any_chosen = False  # whether the wishes were asked of a run, which may keep all states
    for run in runs:
        is_swept = run.dataset is not None and any(
            find_dimension(run.dataset, name) is not None and run.dataset[name].size > 1
            for name in view.where
        )
        chosen_run = run
        # a single run that is not swept is asked too, to the error that names the parameter
        if is_swept or len(runs) == 1:
            chosen_run = _choose_states_of_run(run, view)
        chosen_runs.append(chosen_run)
        is_any_chosen |= chosen_run is not run
    if view.where and not is_any_chosen:
        names = ", ".join(view.where)
        raise InputError(f"none of the runs is swept over {names}", mend="Leave --where out")
    return chosen_runs


def _find_balls_per_side(names: Sequence[str]) -> int | None:
    """Return the number of balls on a side of the hexagonal frame, if all scenes that have a frame
    have the same; None if no scene has one, or if the numbers differ. The scenes are those in the
    folders ``names``, or beside the files ``names``.
    """
    from granphon.scene.scene import Scene

    numbers = set[Any]()
    for path in map(Path, names):
        folder = path if path.is_dir() else path.parent
        scene_file = folder / "scene.yaml"
        if scene_file.is_file():
            numbers.add(Scene.from_yaml(scene_file).load.balls_per_side)
    numbers.discard(None)
    return numbers.pop() if len(numbers) == 1 else None


def _draw(
    target: Path,
    force: bool,
    draw: Callable[[], Any],
    folders: Sequence[Path],
    backend: str | None,
    inputs: Collection[Path] = (),
) -> Path:
    """Write the figure that ``draw`` returns into the file ``target``, and return its path. The
    figure shows the results in ``folders`` and in the files ``inputs``.

    InputError for an ending that names no format, and if results change while they are drawn;
    FileExistsInRunError if there is a file ``target`` that ``force`` may not replace. The figure
    arrives whole or not at all.
    """
    if target.suffix not in _FIGURE_ENDINGS:
        problem = f"{target} has an ending that names no figure format"
        raise InputError(problem, mend="Use " + ", ".join(_FIGURE_ENDINGS))
    # the folder is locked before anything is read, so that no run replaces the results meanwhile
    with ResultFiles(target.parent, [target.name], force, inputs=inputs).open() as locked:
        records = [read_written_files(folder) for folder in folders]
        figure = draw()
        for folder, record in zip(folders, records, strict=True):
            if read_written_files(folder) != record:
                problem = f"{folder} was written into while it was read"
                raise InputError(problem, "The figure would mix two results", "Draw it again")
        from granphon.figures.style import save_figure

        with locked.staging() as stage:
            save_figure(figure, stage / target.name, backend=backend)
    return target


def read_run(source: str | os.PathLike[str]) -> Run:
    """Return the results in ``source``, the folder of a run or one of its files; summary.yaml means
    the sweep.nc beside it. A fit beside a sweep is left out.

    Raises :class:`~granphon.base.errors.MissingFileError` if no folder or file has the name, or if
    a file that a run wrote into the folder, and that would be drawn, is missing; and
    :class:`~granphon.base.errors.InputError` if ``source`` is no path, or holds no results, or
    damaged ones.
    """
    from granphon.figures.curves import Run

    require_path(source)
    path = Path(source)
    name = str(source)
    if path.name == "summary.yaml" and path.is_file():
        read_summary(path.parent)
        path = path.with_name("sweep.nc")  # the summary tells numbers of this file
        if not path.is_file():
            raise MissingFileError(f"there is no {path}", mend="Run the scene again")
    if path.is_file():
        row = _recognise(path)
        rows = {row.joined: row}
        paths = {row.joined: path}
    else:
        _require_results(path)
        # by the attribute of Run that has the value
        rows = {row.joined: row for row in _list_joined() if row.find_source(path)}
        paths = {attribute: path / str(row.source) for attribute, row in rows.items()}
    if not rows:
        mend = "Give the folder of a run or of a fit, or one of its files, such as sweep.nc"
        raise InputError(f"{name} holds no results to draw with others", mend=mend)
    if "fit" in rows and "dataset" not in rows:
        # without a sweep beside it, the fit is all that is drawn of the folder
        return Run.of(name, rows["fit"].read_value(paths["fit"]))
    values = {
        attribute: row.read_value(paths[attribute])
        for attribute, row in rows.items()
        if attribute != "fit"
    }
    return Run(name, **values)


def _list_joined() -> list[Export]:
    """Return the outputs whose values can be drawn together with those of other runs, such as the
    data set of states.
    """
    return [row for _name, row in OUTPUTS.items() if row.joined]


def _require_results(source: Path) -> None:
    """Raise :class:`~granphon.base.errors.MissingFileError` if there is no folder ``source``, or if
    a file of an output of :func:`_list_joined` is missing that a run wrote there.
    """
    require_folder(source)
    written_names = set(read_written_files(source))
    # without a summary that can be read, the hidden list of written files alone counts
    with suppress(InputError, AttributeError, TypeError):
        written_names |= set(read_yaml(source / "summary.yaml").get("files", ()))
    drawn_names = [str(row.source) for row in _list_joined()]
    missing_names = [
        name for name in drawn_names if name in written_names and not os.path.lexists(source / name)
    ]
    if missing_names:
        names = " and no ".join(missing_names)
        problem = f"{source} holds no {names}, though a run wrote it there"
        mend = "Run the scene again, or copy what is to be drawn into a folder of its own"
        raise MissingFileError(problem, "The figure would leave it out", mend)


def _recognise(path: Path) -> Export:
    """Return the output whose value the file ``path`` holds, among those of :func:`_list_joined`.
    The name of the file tells the output; if the file was renamed, its ending and its content do.
    InputError for any other file.
    """
    rows = _list_joined()
    for row in rows:
        if row.source == path.name:
            return row
    # a data set, sweep.nc, is known by its ending alone
    content = read_bytes(path) if path.suffix in (".csv", ".yaml") else b""
    for row in rows:
        has_ending = path.suffix == Path(str(row.source)).suffix
        if has_ending and any(re.search(mark, content) for mark in row.marks):
            return row
    names = ", ".join(str(row.source) for row in rows)
    mend = f"Give the folder of a run or of a fit, or a file of one: {names}"
    why = ""
    for _name, row in OUTPUTS.items():
        if path.name in row.files:
            why = _explain_file(path, row)
            break
    raise InputError(f"{path} is no file of results that is drawn by itself", why, mend)


def _explain_file(path: Path, row: Export) -> str:
    """Return a sentence that says which command draws the content of the file ``path`` of an output
    ``row`` that is not drawn together with others, or that no figure shows the content.
    """
    drawn_row = row
    if not row.figure:
        # such as motion_contacts.csv, of the same observable as motion.csv, which has a figure
        drawn_rows = [
            other
            for _name, other in OUTPUTS.items()
            if other.figure and row.observed and other.observed == row.observed
        ]
        rows_in_folder = [other for other in drawn_rows if other.find_source(path.parent)]
        drawn_row = next(iter(rows_in_folder or drawn_rows), row)
    if drawn_row.figure and not drawn_row.source:
        return _explain_unkept(drawn_row)
    if drawn_row.figure:
        figure = path.parent / drawn_row.figure
        return f"'granphon plot {path.parent} -o {figure}' draws its content"
    # such as sweep_incomplete.csv, the table of a data set that is drawn
    data = path.with_name(row.files[0])
    if data.suffix == ".nc" and data != path:
        return f"'granphon plot {data}' draws its content"
    return "No figure of granphon shows its content"


def _find_lattice(source: Path) -> ContactLattice:
    """Return the lattice of contacts of the one state of the run in the folder ``source``.

    The state is solved again, but no array is simulated again: the lattice of an array is the ideal
    lattice or, with finite overlap, made of the numbers in the summary. InputError if the folder
    has no scene of one state, or a summary without these numbers.
    """
    # imported here, as a figure without long waves does not need the media
    from granphon.media.state import ContactState, ideal_lattice
    from granphon.scene.scene import Scene

    scene = Scene.from_yaml(source / "scene.yaml")
    packing: Any = scene.packing
    if not scene.serving.arrays:
        return scene.state().contact_lattice()
    summary = read_summary(source)
    try:
        finite_overlap = summary["finite_overlap"]
        numbers = {name: summary[name] for name in ("force", "overlap", "normal_stiffness")}
    except KeyError as error:
        problem = f"{source / 'summary.yaml'} has no {error.args[0]}"
        raise InputError(problem, "The long waves follow from it", "Run the scene again") from None
    if not finite_overlap:
        # in the paper's limit the lattice in reduced units is the same under every load
        return ideal_lattice(packing)
    medium = scene.media[0].name
    state = ContactState(packing, medium, packing.law, **numbers, finite_overlap=True)
    return state.contact_lattice()
