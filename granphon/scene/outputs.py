"""The table of the outputs of runs: for each output its name, its files, when a run has it, and the
functions that find, write, read and draw it.

Whatever lists, writes, checks, resumes, draws again or documents files of results reads this table.
An output of granphon is one row here and its functions; others come by :func:`register_output`. The
functions take the results of a run, which give the value of any output by its name,
``results["bands"]``, and the data set of all states, ``results.dataset``. One state is a data set
too, without axes of a sweep: what a run writes of one state alone, or of many, its row says.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from granphon.base.errors import GranphonError, InputError, MissingFileError, brief, one_line
from granphon.base.registry import Registry
from granphon.base.tables import Heading, Table, table_text
from granphon.base.text import (
    decode,
    dump_yaml,
    parse_yaml,
    read_bytes,
    read_yaml,
    require_path,
    require_schema,
)
from granphon.base.validation import require, text, text_list
from granphon.media import cost as costs
from granphon.media.cost import Cost
from granphon.media.network_file import TABLES
from granphon.observables.catalogue import CATALOGUE, WAVE_COSTS, CostClass, is_free
from granphon.runs.plan import PLACE_OF_EDGE, CostPart
from granphon.runs.workers import packages
from granphon.waves.settings import RESPONSES

if TYPE_CHECKING:
    from granphon.base.results import Result
    from granphon.runs.dataset import Dataset

#: version number of summary.yaml, its key "schema"
SUMMARY_SCHEMA = 1
#: name of the table of measured diameters that are too many for the scene file
DIAMETERS_FILE = "diameters.csv"
#: most variables of a design that the summary lists
_MOST_VARIABLES = 20
#: the tensors of elastic constants, which data sets leave out where moduli say the same
_TENSORS = ("tensor", "tensor_error")
#: the packages that make force constants, bands and densities of states
_PHONON_PACKAGES = ("ase", "phonopy", "spglib")
#: ending of the names of files that hold figures
_FIGURE_ENDING = ".png"
#: the number of states of a run in words, for the reference
_STATES_IN_WORDS = {"any": "", "one": "one state", "many": "a sweep"}
#: commands whose files a later run in the same folder replaces
_RUN_COMMANDS = ("run", "report")
#: the states that a figure shows: texts of values by the name of a parameter, see
#: :func:`granphon.figures.choices.choose_states`
Wishes = Mapping[str, Sequence[str]]
#: is told in a sentence which panels a figure has chosen
Tell = Callable[[str], object]


@dataclass(frozen=True)
class Export:
    """An output of a run: a row of :data:`OUTPUTS`.

    Attributes
    ----------
    name : its name in the table.
    files : names of its files. The figure, one at most, ends in .png; the other files hold numbers.
    observed : the word with which a scene observes the output; empty where no word decides.
    states : whether runs of "one" state, which has no axes of a sweep, of "many" or of "any" number
        have the output.
    of_arrays : whether only media that simulate arrays have the output; a scene that observes it
        with another medium is refused before it runs, so that :meth:`is_of` does not ask.
    when : function of a scene that says whether its run has the output; ``observed``, ``states``
        and ``when`` must all hold.
    find : function of the results of a run that returns the value of the output, None where there
        is nothing to write. Without this function a run finds no value of the output: its files and
        its figure show other values.
    summarise : function of the results of a run that returns numbers of the output for
        summary.yaml, plain data by name.
    cost : function of a scene that estimates the work that finds and writes the output: the path of
        the key that asks for it, how the user can make it smaller, and the cost. None where it is
        part of the work on states, or takes little.
    packages : names of the packages that make the value, besides those of every run.
    write : function that writes the files of numbers of the results into a folder.
    read : function that returns the value from the path of the file ``source``.
    columns : function of the results of a run that returns the numbers of its tables, arrays by
        name, of which standard errors are found if parameters have them: those that
        :meth:`Results.find_errors` gives to ``write`` and ``draw``.
    along : the name of the column at whose values the other ``columns`` of two results are
        compared, such as a time; empty if they are compared row by row.
    of_states : whether the files have the standard errors that the data set of the states has.
    draw : function that returns the figure of the results.
    source : the file by which a folder is known to hold the output, and from which the value is
        read; by default the first of ``files``, empty where no folder holds what the figure is
        drawn from.
    in_curves : whether a sweep also shows numbers of the output over the load, in ``sweep.png``.
    joined : the attribute of :class:`granphon.figures.curves.Run` that holds the value where
        several runs are drawn together; empty if the output is not drawn together with others.
    marks : patterns that tell the file of such a value if the file was renamed: one of them is in
        its content.
    rank : place of the figure among those of a folder, of which the first is drawn by default: the
        least rank comes first, and 0 comes last.
    command : the command of granphon that writes the files.
    label : the name in words, of the work that finds the output.
    occasion, words : which runs have the output, and what its files hold, for the reference; by
        default the ``occasion`` names what is ``observed`` and the number of ``states``, and is
        "every run" where neither decides.
    caption : what the figure shows; by default the ``words``.
    numbers : names of the files that hold numbers, made from ``files``.
    figure, stem : name of the file of the figure with and without its ending, made from ``files``;
        empty for none.
    """

    name: str
    files: tuple[str, ...]
    observed: str = ""
    states: Literal["any", "one", "many"] = "any"
    of_arrays: bool = False
    when: Callable[[Any], Any] | None = None
    find: Callable[[Any], Any] | None = None
    summarise: Callable[[Any], dict[str, Any]] | None = None
    cost: Callable[[Any], CostPart] | None = None
    packages: tuple[str, ...] = ()
    write: Callable[[Any, Path], None] | None = None
    read: Callable[[Path], Any] | None = None
    columns: Callable[[Any], dict[str, Any]] | None = None
    along: str = ""
    of_states: bool = False
    draw: Callable[..., Any] | None = None
    source: str | None = None
    in_curves: bool = False
    joined: str = ""
    marks: tuple[bytes, ...] = ()
    rank: int = 0
    command: str = "run"
    label: str = ""
    occasion: str = ""
    words: str = ""
    caption: str = ""

    numbers: tuple[str, ...] = field(init=False)
    figure: str = field(init=False)
    stem: str = field(init=False)

    def __post_init__(self) -> None:
        """Set ``numbers``, ``figure`` and ``stem`` by the endings of the ``files``, and the
        defaults of ``source``, ``label``, ``occasion`` and ``caption``.
        """
        # the dataclass is frozen: attributes are set past it
        assign = partial(object.__setattr__, self)
        figures = [name for name in self.files if name.endswith(_FIGURE_ENDING)]
        if not self.occasion:
            conditions = [
                f"`{self.observed}`" if self.observed else "",
                _STATES_IN_WORDS[self.states],
            ]
            assign("occasion", ", ".join(filter(None, conditions)) or "every run")
        assign("caption", self.caption or self.words)
        assign("label", self.label or self.name.replace("_", " "))
        assign("numbers", tuple(name for name in self.files if name not in figures))
        assign("figure", figures[0] if figures else "")
        assign("stem", self.figure.removesuffix(_FIGURE_ENDING))
        if self.source is None:
            assign("source", self.files[0] if self.files else "")

    def find_source(self, folder: Path) -> Path | None:
        """Return the path of the file ``source`` in a ``folder``; None if the folder does not hold
        the output.
        """
        if not self.source:
            return None
        path = folder / self.source
        # a folder, or a link to nothing, with this name counts too: it is an error when it is read
        return path if os.path.lexists(path) else None

    @property
    def files_without_errors(self) -> tuple[str, ...]:
        """Names of the files of numbers that hold no standard errors even if parameters have them.
        Of an output of one state alone these are all but band.yaml and the tables (.csv) of an
        output with ``columns`` or ``of_states``. Of other outputs none are named: the errors of
        their numbers, if these are numbers of states, are in sweep.nc.
        """
        if self.states != "one":
            return ()
        has_errors = self.of_states or self.columns is not None
        return tuple(
            name
            for name in self.numbers
            if not (has_errors and name.endswith((".csv", "band.yaml")))
        )

    def is_of(self, scene: Any) -> bool:
        """Whether a run of a ``scene`` has the output; never for an output of another command."""
        if self.command != "run" or (self.observed and self.observed not in scene.observe):
            return False
        if not self.is_of_number(scene.swept):
            return False
        return self.when is None or bool(self._call(self.when, scene))

    def is_of_number(self, swept: Collection[str]) -> bool:
        """Whether the number of states of a run allows the output; ``swept`` are the axes of the
        run, which counts as one state without axes, and otherwise as many, also where a parameter
        is swept over a single value.
        """
        return self.states in ("any", "many" if swept else "one")

    def estimate_cost(self, scene: Any) -> CostPart:
        """Return the estimated work that finds and writes the output of a ``scene``. Only for an
        output with a function ``cost``.
        """
        assert self.cost is not None
        return self._call(self.cost, scene)  # type: ignore[no-any-return]

    def read_errors(self, folder: Path) -> dict[str, Any]:
        """Return the standard errors (n,) that the table of the output in a ``folder`` has, SI, by
        the names of its columns; empty for an output without ``columns``, without a table, and for
        a table without errors. The table is the first of the files of numbers that ends in .csv.
        """
        if self.columns is None:
            return {}
        paths = [folder / name for name in self.numbers if name.endswith(".csv")]
        if not paths or not paths[0].is_file():
            return {}
        return Table.read(paths[0]).list_errors()

    def find_value(self, run: Any) -> Any:
        """Return the value of the output, found from the results of a ``run``; None for an output
        without a value of its own.
        """
        return None if self.find is None else self._call(self.find, run)

    def collect_numbers(self, run: Any) -> dict[str, Any]:
        """Return the numbers of the output for summary.yaml, by name; empty if the ``run`` has
        found no value of the output, or if the output has no such numbers.
        """
        if self.summarise is None or (self.find is not None and run[self.name] is None):
            return {}
        return self.summarise(run)

    def write_numbers(self, results: Any, folder: Path) -> None:
        """Write the files of numbers of the output into a ``folder``, if the output has a function
        ``write``; InputError if this function leaves one of the files out.
        """
        if self.write is None:
            return
        self._call(self.write, results, folder)
        missing_names = [name for name in self.numbers if not (folder / name).is_file()]
        if missing_names:
            problem = f"{OUTPUTS.describe(self.name)} has not written {', '.join(missing_names)}"
            raise InputError(problem, mend="Mend its function write")

    def read_value(self, path: Path) -> Any:
        """Return the value of the output, read from the file ``path``; None for an output that is
        not read.
        """
        return None if self.read is None else self._call(self.read, path)

    @cached_property
    def options(self) -> Collection[str]:
        """The options of the figure: the names of the arguments of the function ``draw`` but the
        first, which is the results; empty for an output without a figure.
        """
        return () if self.draw is None else tuple(signature(self.draw).parameters)[1:]

    def make_figure(self, results: Any, tell: Tell | None = None, **options: Any) -> Any:
        """Return the matplotlib figure of the ``results``, drawn with the ``options``, whose names
        are among :attr:`options`. ``tell`` is called with a sentence that says which panels the
        figure has chosen, if it chooses any. InputError if the output has no figure, or if its
        function ``draw`` returns none; and the errors of this function.
        """
        if self.draw is None:
            raise InputError(f"{OUTPUTS.describe(self.name)} has no figure")
        if tell is not None and "tell" in self.options:
            options["tell"] = tell
        figure = self._call(self.draw, results, **options)
        if not hasattr(figure, "savefig"):
            problem = f"draw of {OUTPUTS.describe(self.name)} returns a {type(figure).__name__}"
            raise InputError(problem, "It has to return a matplotlib Figure", "Mend its draw")
        return figure

    def _call(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """Call a ``function`` of the output and return its result.

        Errors of granphon and of the file system are raised unchanged. Any other exception becomes
        an InputError that names the output, if the output was registered by the user or a plug-in.
        """
        try:
            return function(*arguments, **options)
        except (GranphonError, OSError):
            raise
        except Exception as error:
            if not OUTPUTS.is_added(self.name):
                raise
            fault = f"{OUTPUTS.describe(self.name)} fails: {type(error).__name__}: {error}"
            raise InputError(one_line(fault), mend="Mend its function") from error


@dataclass(frozen=True, eq=False)
class Results:
    """The results in a folder, by the names of outputs: each is read when it is first asked for.

    Attributes
    ----------
    folder : the folder of the results; may be given as a text.
    values : the values that have been found or read so far, by the names of outputs. The object is
        frozen, but reading a value adds it here.
    column_errors : the standard errors of tables that have been found or read so far, by the names
        of outputs and then by those of columns; reading adds to them too.
    """

    folder: Path
    values: dict[str, Any] = field(default_factory=dict, kw_only=True, repr=False)
    column_errors: dict[str, dict[str, Any]] = field(default_factory=dict, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        """Make a path of a folder that is given as a text; InputError for what is no path."""
        require_path(self.folder)
        object.__setattr__(self, "folder", Path(self.folder))  # the dataclass is frozen

    def __getitem__(self, name: str) -> Any:
        """Return the value of the output ``name``, read from its file ``source``, and keep it in
        ``values``; None if the folder does not hold this file, and for an output that is not read.
        The value of an output without files and without a ``source`` is found from other values.

        KeyError if there is no such output; InputError for a file that cannot be read.
        """
        if name not in self.values:
            row = OUTPUTS[name]
            path = row.find_source(self.folder)
            if path is not None:
                self.values[name] = row.read_value(path)
            elif row.files or row.source:
                self.values[name] = None
            else:
                self.values[name] = row.find_value(self)
        return self.values[name]

    def find_errors(self, name: str) -> dict[str, Any]:
        """Return the standard errors (n,), SI, of the numbers in the table of the output ``name``,
        by the names of columns; empty without errors. They are read from the table, and kept in
        ``column_errors``. KeyError if there is no such output; InputError for a table that cannot
        be read.
        """
        if name not in self.column_errors:
            self.column_errors[name] = OUTPUTS[name].read_errors(self.folder)
        return self.column_errors[name]

    @property
    def dataset(self) -> Dataset:
        """Every state, with velocities, moduli and bands, as :func:`granphon.runs.sweep.sweep`
        returns it; :class:`~granphon.base.errors.InputError` if the folder does not hold it.
        """
        dataset = self["states"]
        if dataset is None:
            problem = f"{self.folder} holds no {OUTPUTS['states'].source}"
            raise InputError(problem, "It has every state", "Run the scene again")
        return dataset  # type: ignore[no-any-return]


# -- when a run has an output ----------------------------------------------------------------------


def _has_sample(scene: Any) -> bool:
    """Whether the one state of a scene is simulated."""
    return bool(scene.serving.arrays)


def _has_files(scene: Any) -> bool:
    """Whether the packing of a scene is that of another program, in files."""
    return bool(scene.packing.is_network)


def _has_own_density(scene: Any) -> bool:
    """Whether the one state of a scene has a density of states of its own network: that of a
    packing in files, or of a simulated array.
    """
    return scene.packing.is_network or bool(scene.serving.arrays)


def _has_friction(scene: Any) -> bool:
    """Whether the one state of a scene is simulated, with contacts that keep their friction from
    load to load.
    """
    return any(array.friction_history for array in scene.serving.arrays)


def shows_curves(observe: Collection[str]) -> bool:
    """Whether a sweep that observes the words ``observe`` is drawn as curves over the load: if one
    of the words is "velocities", has no figure of its own in sweeps, or has an output with
    :attr:`Export.in_curves`.
    """
    rows = [row for _name, row in OUTPUTS.items() if row.figure and row.states != "one"]
    words_without_curves = {row.observed for row in rows if not row.in_curves}
    return not words_without_curves.issuperset(observe)


# -- how it is found -------------------------------------------------------------------------------


def _find_surface(run: Any) -> Any:
    """Return the spectrum of the outer layer of the only state, at the edge that the settings
    ``surface`` of the scene choose.
    """
    from granphon.phonons.surfaces import Surface

    settings = run.scene.observed_settings("surface")
    half_space = run.state.cached(Surface, settings.axis, settings.edge)
    return half_space.map(settings.points)


def _find_force_constants(run: Any) -> Any:
    """Return the phonons of the only state, whose force constants are found now, and kept."""
    _ = run.phonons.phonopy
    return run.phonons


def _find_bands(run: Any) -> Any:
    """Return the bands of the only state along the path of the scene."""
    from granphon.phonons.phonons import find_bands

    return run.state.cached(find_bands, run.scene.path, run.scene.band_points)


def _find_gaps(results: Any) -> Any:
    """Return the lower and upper edges (n, 2), Hz, of the n gaps of the only state of the results;
    None if gaps were not observed, or the data set has several states.
    """
    data = results["states"]
    if data is None or "gap_lower" not in data or data["valid"].size > 1:
        return None
    # (2, most gaps), nan beyond the number of gaps
    edges = np.array([data[name].values.ravel() for name in ("gap_lower", "gap_upper")])
    return edges[:, np.isfinite(edges[0])].T


def _find_spectra(run: Any) -> Any:
    """Return the spectral functions of the first sample along the path of the scene, from the
    records of the run.
    """
    from granphon.runs.wave_records import restore_spectra

    return restore_spectra(run.records, run.scene.waves, run.state)


def _find_sample_dos(run: Any) -> Any:
    """Return the density of states of the first sample, or of the packing in files, from the
    records of the run.
    """
    from granphon.runs.wave_records import restore_result
    from granphon.waves.dos import SpectralDensity

    return restore_result(run.records[0], "dos", SpectralDensity)


def _find_design(run: Any) -> Any:
    """Return the best network for the goal of the scene of a ``run``. The searches from all starts
    are tasks, whose results the run keeps under ``identity``: the scene and the versions of
    packages.
    """
    scene = run.scene
    identity = {"scene": parse_yaml(scene.to_yaml(), "scene").data, "versions": packages()}
    posed = scene.posed_design
    return posed.finish(run.means.solve("design", posed.tasks, identity))


def _find_pulse(run: Any) -> Any:
    """Return the mean of the pulses through the samples; None if no sample carries a pulse."""
    from granphon.runs.wave_records import restore_pulse

    return restore_pulse(run.records)


def _find_motion(run: Any) -> Any:
    """Return the motion of the balls of the first sample, or of the state's own network if the
    state has no samples.
    """
    from granphon.runs.wave_records import restore_motion

    return restore_motion(run.records[0])


def _list_limits(run: Any) -> dict[str, Any]:
    """Return the conditions under which the model holds at the only state, as plain data: under
    "ok" whether all hold, and under "validity" a list of them with name, meaning, value, limit and
    whether each holds.
    """
    validity = run.validity
    checks = [
        {
            "name": check.name,
            "meaning": check.meaning,
            "value": check.value,
            "limit": check.limit,
            "ok": bool(check.ok),
        }
        for check in validity.checks
    ]
    return {"ok": bool(validity.ok), "validity": checks}


def _summarise_state(run: Any) -> dict[str, Any]:
    """Return the numbers of the only state by name: its medium, with the choice and the expected
    error of an automatic medium, the local field of an effective medium, and the observables of the
    catalogue that are plain numbers or tensors. Numbers of waves that are not finite are left out.
    """
    scene = run.scene
    data = run.dataset
    numbers: dict[str, Any] = {
        "finite_overlap": bool(run.state.finite_overlap),
        "medium": data["medium"].item(),
    }
    if "choice" in data:
        numbers |= {name: data[name].item() for name in ("choice", "expected_error")}
        numbers["truth"] = str(scene.serving.truth)
    numbers |= _list_numbers(run, ("state", "exponent", "packing"))
    local_field = run.local_field
    if local_field is not None:
        names = ("alpha", "beta", "xi")
        numbers["local_field"] = {name: getattr(local_field, name) for name in names}
    if "velocities" in scene.observe:
        numbers |= _list_numbers(run, ("velocities",))
    for name, entry in CATALOGUE.items():
        if entry.cost in WAVE_COSTS and not entry.dims and name in data:
            value = data[name].item()
            if np.isfinite(value):
                numbers[name] = value
    return numbers


def _list_numbers(run: Any, cost_classes: Sequence[CostClass]) -> dict[str, Any]:
    """Return the numbers of the only state whose costs are of the ``cost_classes``, by name and in
    the order of the classes: from the data set, and, of those that no data set holds, from the
    state itself. A number that the state does not have is left out.
    """
    state = run.dataset.isel(load=0, medium=0)
    numbers: dict[str, Any] = {}
    for cost_class in cost_classes:
        for name, entry in CATALOGUE.items():
            if entry.cost != cost_class or entry.find is None:
                continue
            number = None
            if entry.swept and name in state:
                values = state[name].values
                number = values if values.ndim else values.item()
            elif not entry.swept or name in _TENSORS:
                number = entry.find(run.analysis)
            if number is not None:
                numbers[name] = number
    return numbers


def _summarise_states(run: Any) -> dict[str, Any]:
    """Return the numbers of the states of a sweep by name: the sizes of the dimensions, the number
    of states, the media, the direction of sound, if it was given or if velocities depend on it, the
    least and the greatest of each variable of :func:`list_told` and of its standard errors, and
    whether all states are valid.

    "finite_overlap" is whether the states have finite overlap, "some" if not all of them have it;
    where media differ in this, a list with one such value for each medium.
    """
    from granphon.runs.dataset import list_finite_overlap

    data = run.dataset
    # for each medium, whether all of its states have finite overlap, or none, or some
    overlaps = ["some" if overlap is None else overlap for overlap in list_finite_overlap(data)]
    dims = [*data["valid"].dims]
    if "direction" in data.dims:
        dims.append("direction")
    numbers: dict[str, Any] = {
        "finite_overlap": overlaps if len(set(overlaps)) > 1 else overlaps[0],
        "sizes": {str(name): data.sizes[name] for name in dims},
        "states": data["valid"].size,
        "medium": data["medium"].values,
    }
    if "direction" in data.coords:
        numbers["direction"] = json.loads(data["direction"].attrs["values"])
    elif "tensor" in data:  # some lattice is not isotropic, and its velocities are along x
        is_plane = data.sizes["voigt_row"] == 3
        numbers["direction"] = [1.0, 0.0] if is_plane else [1.0, 0.0, 0.0]
    told_names = [name for name in list_told(run.scene.observe) if name in data]
    for name in told_names:
        if data[name].notnull().any():
            numbers[name] = [float(data[name].min()), float(data[name].max())]
    if run.scene.errors:
        numbers |= _list_errors(data, told_names)
    return numbers | {"valid": bool(data["valid"].all())}


def list_told(observe: Collection[str]) -> list[str]:
    """Return the names of the numbers that are told of a run that observes the words ``observe``:
    those that the catalogue marks as ``told``, velocities and moduli only if ``observe`` has
    "velocities".
    """
    has_velocities = "velocities" in observe
    return [
        name
        for name, entry in CATALOGUE.items()
        if entry.told and (has_velocities or entry.cost != "velocities")
    ]


def _list_errors(data: Dataset, names: Sequence[str]) -> dict[str, Any]:
    """Return the least and the greatest standard error of each of the variables ``names`` of a data
    set, by name as NAME_error, and under "errors_from" for each name the parameter that gives most
    of its error; empty without errors. Errors of sampling alone, which no parameter causes, are
    left out.
    """
    errors: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for name in names:
        error = data.get(f"{name}_error")
        if error is not None and "mostly_from" in error.attrs and error.notnull().any():
            errors[f"{name}_error"] = [float(error.min()), float(error.max())]
            sources[name] = error.attrs["mostly_from"]
    return errors | {"errors_from": sources} if sources else {}


def _of_one_state(summarise: Callable[[Any], dict[str, Any]]) -> Callable[[Any], dict[str, Any]]:
    """Return a function that returns what ``summarise`` does for a run of one state, also for a
    sweep over parameters of one value each, and nothing for a run of several states.
    """

    def summarise_one(run: Any) -> dict[str, Any]:
        """Return the numbers of a ``run`` of one state, by name; empty for several states."""
        return summarise(run) if run.dataset["valid"].size == 1 else {}

    return summarise_one


def _list_onsets(run: Any) -> dict[str, Any]:
    """Return the onsets of the only state, under "onset_frequency" and "onset_curvature": lists of
    the frequencies, Hz, and of the curvatures, m^2/s, of the branches at Gamma.
    """
    names = ("onset_frequency", "onset_curvature")
    return {name: run.dataset[name].values.ravel().tolist() for name in names}


def _list_peaks(run: Any) -> dict[str, Any]:
    """Return, under "peaks", for each receiver of the only state a list of the peaks of the
    response: each has its "frequency", Hz, "height", in the SI unit of the response, and "quality",
    the Q factor, and as NAME_error their standard errors if these are known.
    """
    data = run.dataset
    receivers = data["receiver"].values.tolist()
    peaks_of_receivers: dict[str, list[dict[str, float]]] = {name: [] for name in receivers}
    if "peaks_frequency" not in data:
        return {"peaks": peaks_of_receivers}
    quantity = next(name for name in RESPONSES.values() if name in data)
    # words of the summary, and the variables of the data set, "peaks_..."
    names = {"frequency": "frequency", "height": quantity, "quality": "quality"}
    n_receivers = len(peaks_of_receivers)
    # (receivers, peaks) each, nan beyond the number of peaks of a receiver
    tables = {
        f"{word}{ending}": data[f"peaks_{name}{ending}"].values.reshape(n_receivers, -1).tolist()
        for word, name in names.items()
        for ending in ("", "_error")
        if f"peaks_{name}{ending}" in data
    }
    for row, peaks in enumerate(peaks_of_receivers.values()):
        for column, frequency in enumerate(tables["frequency"][row]):
            if np.isfinite(frequency):
                peaks.append({word: table[row][column] for word, table in tables.items()})
    return {"peaks": peaks_of_receivers}


def _summarise_design(run: Any) -> dict[str, Any]:
    """Return numbers of the design, under "design": the goal at the start and at the end with its
    unit, the numbers of unknowns and of evaluations, and the best value, SI, of each unknown, if
    there are at most ``_MOST_VARIABLES``.
    """
    design = run["design"]
    numbers = {"value": design.value, "start_value": design.start_value, "unit": design.unit}
    numbers |= {"unknowns": len(design.labels), "evaluations": design.evaluations}
    if len(design.labels) <= _MOST_VARIABLES:
        numbers |= dict(zip(design.labels, design.variables.tolist(), strict=True))
    return {"design": numbers}


def _list_strongest(run: Any) -> dict[str, Any]:
    """Return, under "matters_most", for each quantity of the only state the parameter on which the
    quantity depends most, whose logarithmic derivative is the largest in magnitude. A quantity that
    depends on no parameter is left out.
    """
    data = run.dataset
    quantities = data["sensitivity_of"].values.tolist()
    parameters = data["sensitivity_to"].values.tolist()
    # (quantities, parameters); a derivative that is not known counts as zero
    magnitudes = np.nan_to_num(np.abs(data["sensitivity"].values)).reshape(len(quantities), -1)
    strongest_parameters = {
        quantity: parameters[int(np.argmax(magnitudes_of_quantity))]
        for quantity, magnitudes_of_quantity in zip(quantities, magnitudes, strict=True)
        if np.any(magnitudes_of_quantity)
    }
    return {"matters_most": strongest_parameters}


# -- what it costs ---------------------------------------------------------------------------------


def _cost_bands(scene: Any) -> CostPart:
    """Return the cost of the bands along the path, with its key and how it is made smaller."""
    plan = scene.plan
    cost = costs.bands(plan.n_path_points, plan.n_branches)
    return ("phonopy", "band_points"), "Take fewer points", cost


def _cost_force_constants(scene: Any) -> CostPart:
    """Return the cost of force constants, with its key and how it is made smaller; a cost of zero
    unless the scene gives the supercell, as the smallest supercell costs little.
    """
    mend = "Take a smaller supercell: bands and densities of states do not depend on it"
    cost = Cost()
    if scene.dim is not None:
        cost = costs.force_constants(scene.dim, scene.packing.structure.n_balls)
    return ("phonopy", "dim"), mend, cost


def _cost_dos(scene: Any) -> CostPart:
    """Return the cost of the density of states, with its key and how it is made smaller."""
    cost = costs.density_of_states(scene.mesh, scene.plan.n_branches)
    return ("phonopy", "mesh"), "Take a coarser mesh", cost


def _cost_surface(scene: Any) -> CostPart:
    """Return the cost of the map of an edge, with its key and how it is made smaller."""
    from granphon.runs.edge_costs import estimate_map  # other runs do not need it

    cost = estimate_map(scene.serving, scene.observed_settings("surface"))
    return PLACE_OF_EDGE, "Take fewer points or balls", cost


def _cost_design(scene: Any) -> CostPart:
    """Return the cost of the search for a design, with its key and how it is made smaller."""
    return ("design",), "Take fewer balls, steps or restarts", scene.posed_design.cost


# -- how it is written -----------------------------------------------------------------------------


def _write_scene(run: Any, folder: Path) -> None:
    """Write scene.yaml: comments with the versions of packages, and the scene with defaults and in
    SI units. A packing in files is written as that in the tables that the run writes.
    """
    head = "# The scene as it was run, in SI units.\n"
    for package, version in run.package_versions.items():
        head += f"# {package} {version}\n"
    scene = run.scene
    content = scene.to_yaml()
    if _has_files(scene):
        # the tables are written beside scene.yaml, while the user's files may be elsewhere
        data = parse_yaml(content, "scene").data
        content = dump_yaml(data | {"network": scene.packing.block_of_tables})
    (folder / "scene.yaml").write_text(head + content, encoding="utf-8")


def _write_packing(run: Any, folder: Path) -> None:
    """Write the tables of the balls and of the contacts of a packing that was read from files."""
    run.scene.packing.network.write_tables(*(folder / name for name in TABLES))


def _write_diameters(run: Any, folder: Path) -> None:
    """Write the table of measured diameters that are too many for the scene file."""
    (folder / DIAMETERS_FILE).write_text(run.scene.diameters, encoding="utf-8")


def _write_states(run: Any, folder: Path) -> None:
    """Write the data set of every state, sweep.nc, and the table sweep.csv of the variables with
    one number for each state, or for each state and direction of sound.
    """
    from granphon.runs.dataset import write_sweep

    write_sweep(run.dataset, folder / "sweep.nc")


def _write_table(
    name: str, dims: Sequence[str], run: Any, folder: Path, *, numbered: bool = False
) -> None:
    """Write the table in the file ``name`` of those variables of the data set that have the
    dimensions ``dims`` besides those of the states. A column for each of the ``dims`` has its
    coordinate, or if they are ``numbered``, and have no coordinates, the number along it, from
    zero.
    """
    from granphon.runs.dataset import write_waves

    write_waves(run.dataset, folder / name, dims, numbered=numbered)


def _write_edge_waves(run: Any, folder: Path) -> None:
    """Write sweep_surface.csv, the waves of the edge in every state."""
    from granphon.runs.dataset import write_edge_waves

    write_edge_waves(run.dataset, folder / "sweep_surface.csv")


def _write_motion(run: Any, folder: Path) -> None:
    """Write motion.nc, the balls at all times, and motion_contacts.csv, a table of the contacts."""
    from granphon.runs.wave_records import write_contacts

    motion = run["balls_in_motion"]
    motion.write(folder / "motion.nc")
    errors = run.find_errors("balls_in_motion")
    write_contacts(motion, folder / "motion_contacts.csv", run.scene.motion, errors)


def _list_contact_columns(run: Any) -> dict[str, Any]:
    """Return the columns of motion_contacts.csv but the numbers of balls, (n_c,) SI by name."""
    from granphon.runs.wave_records import list_contact_columns

    columns = list_contact_columns(run["balls_in_motion"], run.scene.motion)
    # only the numbers of balls have no unit
    return {name: values for name, unit, values in columns if unit}


def _write_with_table(name: str, run: Any, folder: Path) -> None:
    """Write the value of the output ``name`` as NAME.json, and the table that the value writes
    itself, with standard errors, as NAME.csv.
    """
    _write_json(run[name], folder / f"{name}.json")
    run[name].write_csv(folder / f"{name}.csv", errors=run.find_errors(name))


def _write_surface(run: Any, folder: Path) -> None:
    """Write the spectrum at an edge as surface.json, and its waves as surface.csv, with the
    standard errors of their frequencies and weights if the data set has them.
    """
    from granphon.runs.dataset import find_wave_errors

    _write_json(run["surface"], folder / "surface.json")
    data = run["states"]
    run["surface"].write_csv(
        folder / "surface.csv",
        errors=find_wave_errors(data),
        weight_errors=find_wave_errors(data, "weight"),
    )


def _write_bands(run: Any, folder: Path) -> None:
    """Write the bands as band.yaml, with the standard errors of their frequencies if the data set
    has them.
    """
    bands = run["bands"]
    variable = run.dataset.get("frequencies_error")
    # the data set has the same array behind axes of length one
    errors = None if variable is None else variable.values.reshape(bands.frequencies.shape)
    bands.write(folder / "band.yaml", errors=errors)


def _write_force_constants(run: Any, folder: Path) -> None:
    """Write the force constants and the cell of the only state as phonopy_params.yaml."""
    run["force_constants"].save(folder / "phonopy_params.yaml")


def _write_sample(run: Any, folder: Path) -> None:
    """Write sample.extxyz, the balls of the first sample."""
    from granphon.array.atoms import write_extxyz

    write_extxyz(folder / "sample.extxyz", run.state.samples[0].atoms())


def _write_network(run: Any, folder: Path) -> None:
    """Write tables of the balls and of the contacts of the first sample."""
    network = run.state.samples[0].network
    network.write_tables(folder / "sample_balls.csv", folder / "sample_contacts.csv")


def _write_fields(
    name: str, columns: Sequence[tuple[str, str, str]], run: Any, folder: Path
) -> None:
    """Write the value of the output ``name`` as NAME.json, and some of its attributes, arrays (n,),
    as the columns of NAME.csv, followed by a column of standard errors for each column that has
    them. The ``columns`` are triples of heading, unit and attribute.
    """
    _write_json(run[name], folder / f"{name}.json")
    headings = [Heading(text_of_heading, unit) for text_of_heading, unit, _ in columns]
    heading_of_text = {heading.name: heading for heading in headings}
    errors = run.find_errors(name)
    headings += [heading_of_text[text_of_heading].of_error for text_of_heading in errors]
    values = [*_list_fields(name, columns, run).values(), *errors.values()]
    rows = np.transpose(values).tolist()
    (folder / f"{name}.csv").write_text(table_text(headings, rows), encoding="utf-8")


def _list_fields(name: str, columns: Sequence[tuple[str, str, str]], run: Any) -> dict[str, Any]:
    """Return some attributes of the value of the output ``name``, arrays (n,), by their headings;
    the ``columns`` are triples of heading, unit and attribute.
    """
    value = run[name]
    return {heading: getattr(value, attribute) for heading, _, attribute in columns}


def _write_dos(run: Any, folder: Path) -> None:
    """Write the density of states with its standard errors as dos.csv."""
    run["dos"].write_csv(folder / "dos.csv", errors=run.find_errors("dos"))


def _write_design(run: Any, folder: Path) -> None:
    """Write a design as design.json, its variables, each with its unit, as design.csv, and the goal
    at each evaluation as design_history.csv.
    """
    design = run["design"]
    _write_json(design, folder / "design.json")
    units = run.scene.posed_design.units
    headings = [Heading(name, "") for name in ("variable", "unit", "start", "best", "low", "high")]
    columns = (design.start_variables, design.variables, *design.bounds.T)
    # a label is the name of a variable, behind which "of ..." may name balls or contacts
    rows = [
        [label, units[label.partition(" of ")[0]], *numbers]
        for label, numbers in zip(design.labels, np.transpose(columns).tolist(), strict=True)
    ]
    (folder / "design.csv").write_text(table_text(headings, rows), encoding="utf-8")
    steps = enumerate(design.history.tolist(), start=1)
    history = table_text([Heading("evaluation", ""), Heading("goal", design.unit)], steps)
    (folder / "design_history.csv").write_text(history, encoding="utf-8")


def _write_json(result: Result, path: Path) -> None:
    """Write all fields of a ``result``, with their units and a digest, into the file ``path``, as
    one line of JSON.
    """
    path.write_text(json.dumps(result.to_dict()) + "\n", encoding="utf-8")


def _write_tradeoff(results: Any, folder: Path) -> None:
    """Write tradeoff.csv, the errors and the costs of the media."""
    (folder / "tradeoff.csv").write_text(results["tradeoff"].csv(), encoding="utf-8")


# -- how it is read --------------------------------------------------------------------------------


def _read_states(path: Path) -> Any:
    """Return the data set of every state in the file ``path``."""
    from granphon.runs.dataset import load_sweep

    return load_sweep(path)


def _read_json(kind: str, path: Path) -> Any:
    """Return the result in the JSON file ``path``; ``kind`` is the name of its class in granphon.
    InputError if the file cannot be read, is not JSON, or does not hold such a result.
    """
    import granphon

    content = decode(str(path), read_bytes(path))
    try:
        data = json.loads(content)
    except (ValueError, RecursionError):
        raise InputError(f"{path} is not JSON", mend="Run the scene again") from None
    try:
        return getattr(granphon, kind).from_dict(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _read_motion(path: Path) -> Any:
    """Return the motion of balls in the file ``path``."""
    from granphon.waves.motion import Motion

    return Motion.read(path)


def _read_bands(path: Path) -> Any:
    """Return the bands in the file ``path``."""
    from granphon.phonons.bands import Bands

    return Bands.read(path)


def _read_dos(path: Path) -> Any:
    """Return the density of states in the table ``path``."""
    from granphon.phonons.dos import DensityOfStates

    return DensityOfStates.read_csv(path)


def _read_errors(path: Path) -> Any:
    """Return the standard errors in ``path``, the summary.yaml of a folder, by name as NAME_error,
    and under "errors_from" for each name the parameter that gives most of its error; None without
    errors. InputError if the summary cannot be read.
    """
    summary = read_summary(path.parent)
    if "errors_from" not in summary:
        return None
    if not isinstance(summary["errors_from"], Mapping):
        problem = f"{path}: errors_from is {brief(summary['errors_from'])}"
        raise InputError(problem, "Granphon did not write it so", "Run the scene again")
    error_names = [f"{name}_error" for name in summary["errors_from"]]
    return {name: summary[name] for name in (*error_names, "errors_from") if name in summary}


def _read_limits(path: Path) -> Any:
    """Return the conditions under which the model holds, in the form of :func:`_list_limits`, from
    ``path``, the summary.yaml of a folder; None for a sweep, whose summary has none.
    """
    summary = read_summary(path.parent)
    return {name: summary[name] for name in ("ok", "validity") if name in summary} or None


def _read_fit(path: Path) -> Any:
    """Return the fit, of velocities or of a response, in the file ``path``."""
    from granphon.fits.transfer import read_fit

    return read_fit(read_yaml(path))


# -- how it is drawn -------------------------------------------------------------------------------


def _plot(name: str, results: Any) -> Any:
    """Return the figure by which :func:`granphon.plot` shows the value of the output ``name``."""
    from granphon.figures.plot import plot

    return plot(results[name])


def _plot_with_errors(name: str, results: Any) -> Any:
    """Return the figure by which :func:`granphon.plot` shows the value of the output ``name``, with
    the standard errors that its table has.
    """
    from granphon.figures.plot import plot

    return plot(results[name], errors=results.find_errors(name))


def _plot_sample(run: Any) -> Any:
    """Return the figure of the force chains of the first sample, and of the distribution of the
    forces in all samples.
    """
    from granphon.figures.plot import plot

    return plot(run.state)


def _choose_states(results: Any, where: Wishes | None) -> Dataset:
    """Return the data set of the results: all states, or those that ``where`` chooses."""
    dataset: Dataset = results.dataset
    if where:
        from granphon.figures.choices import choose_states

        dataset = choose_states(dataset, where, str(results.folder))
    return dataset


# the arguments of these functions are the options of the figures, see Export.options: none takes
# options that it does not name


def _draw_dataset(name: str, results: Any, where: Wishes | None = None) -> Any:
    """Return the figure that the output ``name`` has for the data set of the states, or for those
    states that ``where`` chooses.
    """
    from granphon.figures.plot import draw_dataset

    return draw_dataset(_choose_states(results, where), name)


def _draw_sensitivities(results: Any, where: Wishes | None = None, tell: Tell | None = None) -> Any:
    """Return the figure of the derivatives by parameters, of all states or of those that ``where``
    chooses. ``tell`` is called with a sentence that says what the figure leaves out.
    """
    from granphon.figures.plot import draw_dataset

    return draw_dataset(_choose_states(results, where), "sensitivities", tell=tell)


def _draw_panels(
    name: str,
    results: Any,
    where: Wishes | None = None,
    rows: str | None = None,
    columns: str | None = None,
    tell: Tell | None = None,
) -> Any:
    """Return the figure of the output ``name``, in whose panels the states are shared out: all
    states, or those that ``where`` chooses. ``rows``, ``columns`` and ``tell`` are those of
    :func:`granphon.figures.curves.sweep_figure`.
    """
    from granphon.figures.plot import draw_dataset

    dataset = _choose_states(results, where)
    return draw_dataset(dataset, name, rows=rows, columns=columns, tell=tell)


def _draw_curves(
    results: Any,
    variable: str | None = None,
    where: Wishes | None = None,
    rows: str | None = None,
    columns: str | None = None,
    tell: Tell | None = None,
) -> Any:
    """Return the figure of the states over the load: velocities and exponents, or one ``variable``;
    the other arguments are those of :func:`_draw_panels`.
    """
    from granphon.figures.plot import draw_dataset

    dataset = _choose_states(results, where)
    options = {"rows": rows, "columns": columns, "tell": tell}
    return draw_dataset(dataset, "sweep", variable=variable, **options)


def _draw_motion(results: Any, where: Wishes | None = None) -> Any:
    """Return the figure of the motion of balls if the results hold that of a single state, and
    ``where`` chooses no states; otherwise that of the greatest force and the energy of each state
    over time.
    """
    motion = results["balls_in_motion"]
    if where or motion is None:
        return _draw_dataset("motion", results, where)
    from granphon.figures.motions import motion_figure
    from granphon.runs.dataset import find_energy_errors

    return motion_figure(motion, errors=find_energy_errors(motion, results["states"]))


def _draw_surface(results: Any) -> Any:
    """Return the figure of the spectrum at an edge, with the standard errors of its waves if the
    data set has them.
    """
    from granphon.figures.plot import plot
    from granphon.runs.dataset import find_wave_errors

    return plot(results["surface"], errors=find_wave_errors(results["states"]))


def _draw_bands(results: Any, asymptotes: Any = None) -> Any:
    """Return the figure of the bands, the density of states, or both, as the results hold them,
    with gaps and standard errors. The bands, if there are any, have the long waves of the lattice
    of contacts ``asymptotes``, if it is given.
    """
    from granphon.figures.bands import bands_figure

    dos = results["dos"]
    dos_errors = results.find_errors("dos")
    bands = results["bands"]
    if bands is None:
        return bands_figure(None, dos, dos_errors=dos_errors)
    data = results["states"]
    errors = None if data is None else data.get("frequencies_error")
    return bands_figure(
        bands,
        dos,
        asymptotes=asymptotes,
        gaps=results["gaps"],
        errors=errors,
        dos_errors=dos_errors,
    )


# -- the table -------------------------------------------------------------------------------------

#: every output by its name, in the order in which files are written and named
OUTPUTS: Registry[Export] = Registry("output")
#: heading, unit and attribute of the columns of a density of states; the last column is the
#: standard error of the estimate itself
_DENSITY_COLUMNS = (
    ("frequency", "Hz", "frequencies"),
    ("total", "1/Hz", "total"),
    ("translational", "1/Hz", "translational"),
    ("rotational", "1/Hz", "rotational"),
    ("error", "1/Hz", "error"),
)
#: heading, unit and attribute of the columns of a pulse
_PULSE_COLUMNS = (
    ("time", "s", "times"),
    ("force_sent", "N", "sent"),
    ("coherent", "m/s", "coherent"),
    ("envelope", "m/s", "envelope"),
    ("speckle", "m/s", "speckle_amplitude"),
)
for _row in (
    Export(
        "scene",
        ("scene.yaml",),
        write=_write_scene,
        words="the scene in SI units with every default, and versions",
    ),
    # the run itself writes summary.yaml as its last file, because the summary names the others
    Export(
        "summary",
        ("summary.yaml",),
        words="[the numbers](#quantities-of-a-state)",
    ),
    Export("numbers", (), states="one", summarise=_summarise_state),
    Export("peaks", (), observed="response", summarise=_of_one_state(_list_peaks)),
    Export("onsets_of_state", (), observed="onsets", summarise=_of_one_state(_list_onsets)),
    Export("strongest", (), observed="sensitivities", summarise=_of_one_state(_list_strongest)),
    Export(
        "limits",
        (),
        states="one",
        find=_list_limits,
        read=_read_limits,
        source="summary.yaml",
    ),
    Export(
        "errors",
        (),
        states="one",
        when=lambda scene: bool(scene.errors),
        read=_read_errors,
        summarise=lambda run: run["errors"] or {},
        source="summary.yaml",
        occasion="quantities with standard errors, one state",
        words="in `summary.yaml`: `NAME_error` beside each NAME, and `errors_from`, the parameter"
        " that gives most of the error of each",
    ),
    Export(
        "diameters",
        (DIAMETERS_FILE,),
        when=lambda scene: scene.diameters is not None,
        write=_write_diameters,
        occasion="a measured spread of more than 1000 balls",
        words="`diameter (m)`",
    ),
    Export(
        "states",
        ("sweep.nc", "sweep.csv"),
        write=_write_states,
        read=_read_states,
        joined="dataset",
        marks=(b"",),
        words="[every state](#sweepnc-and-sweepcsv), also a single one: netCDF for xarray, and a"
        " table",
    ),
    Export(
        "response",
        ("response.csv", "response.png"),
        observed="response",
        write=partial(_write_table, "response.csv", ("response_frequency", "receiver")),
        draw=partial(_draw_dataset, "response"),
        rank=5,
        words="magnitude and phase for each state, frequency and receiver",
        caption="Response of the network",
    ),
    Export(
        "motion",
        ("motion.csv", "motion.png"),
        observed="motion",
        write=partial(_write_table, "motion.csv", ("motion_time",)),
        draw=_draw_motion,
        in_curves=True,
        rank=3,
        words="energies and the greatest force for each state and time",
        caption="Motion of the balls",
    ),
    Export(
        "damped_bands",
        ("damped_bands.csv",),
        observed="bands",
        when=lambda scene: scene.bands is not None,
        write=partial(
            _write_table, "damped_bands.csv", ("segment", "point", "branch"), numbered=True
        ),
        occasion="`bands` with a block `bands`",
        words="bands, and frequency, decay and Q with losses",
    ),
    Export("ranges", (), states="many", summarise=_summarise_states),
    Export(
        "sweep",
        ("sweep.png",),
        states="many",
        when=lambda scene: shows_curves(scene.observe),
        draw=_draw_curves,
        source="sweep.nc",
        rank=6,
        occasion="a sweep of `velocities`, of `motion`, or of what has no figure of its own",
        words="velocities and exponents over the load, of motion the velocity of its peak",
        caption="Sound velocities over the load, or the parameter, and their local exponent",
    ),
    Export(
        "sweep_dos",
        ("sweep_dos.csv", "sweep_dos.png"),
        observed="dos",
        states="many",
        of_arrays=True,
        write=partial(_write_table, "sweep_dos.csv", ("node",)),
        draw=partial(_draw_dataset, "sweep_dos"),
        words="densities of states of the arrays",
        caption="Densities of states of the simulated arrays",
    ),
    Export(
        "sweep_spectra",
        ("sweep_spectra.csv", "sweep_spectra.png"),
        observed="spectrum",
        states="many",
        of_arrays=True,
        write=partial(_write_table, "sweep_spectra.csv", ("polarisation", "wavevector")),
        draw=partial(_draw_dataset, "sweep_spectra"),
        words="[lines of plane waves](#waves-in-arrays)",
        caption="Spectral functions of the simulated arrays",
    ),
    Export(
        "sweep_gaps",
        ("sweep_gaps.csv", "sweep_gaps.png"),
        observed="gaps",
        states="many",
        write=partial(_write_table, "sweep_gaps.csv", ("gap",), numbered=True),
        draw=partial(_draw_panels, "sweep_gaps"),
        words="edges of each gap, by the number of branches below; gaps and top frequency over the"
        " load",
        caption="Gaps between the branches, and the top frequency",
    ),
    Export(
        "cutoffs",
        ("cutoffs.csv", "cutoffs.png"),
        observed="cutoffs",
        write=partial(_write_table, "cutoffs.csv", ("branch",), numbered=True),
        draw=partial(_draw_panels, "cutoffs"),
        words="lowest and highest frequency of each branch in the zone; these over the load",
        caption="Branches, from their lowest to their highest frequency",
    ),
    Export(
        "onsets",
        ("onsets.csv", "onsets.png"),
        observed="onsets",
        write=partial(_write_table, "onsets.csv", ("branch",), numbered=True),
        draw=partial(_draw_panels, "onsets"),
        words="cut-off frequency and curvature of each branch at Gamma; the frequencies over the"
        " load",
        caption="Cut-off frequencies from which waves begin, at Gamma",
    ),
    Export(
        "sensitivities",
        ("sensitivities.csv", "sensitivities.png"),
        observed="sensitivities",
        write=partial(_write_table, "sensitivities.csv", ("sensitivity_of", "sensitivity_to")),
        draw=_draw_sensitivities,
        words="logarithmic derivatives of velocities, moduli and, if observed, cut-off frequencies"
        " and the waves of an edge (`surface_frequency X 0` is the lowest at the corner X of the"
        " path along the edge) by the parameters of the balls and the load; in `summary.yaml`"
        " of one state, `matters_most`, the parameter on which each depends most",
        caption="Logarithmic derivatives by the parameters",
    ),
    Export(
        "modes",
        ("modes.csv", "modes.png"),
        observed="modes",
        write=partial(_write_table, "modes.csv", ("mode",)),
        draw=partial(_draw_panels, "modes"),
        words="lowest modes of each network: frequency, participation, part in rotations; the"
        " frequencies over the load",
        caption="Frequencies of the lowest modes",
    ),
    Export(
        "sweep_surface",
        ("sweep_surface.csv", "sweep_surface.png"),
        observed="surface",
        states="many",
        write=_write_edge_waves,
        draw=partial(_draw_panels, "sweep_surface"),
        words="waves of the edge along the path, with distance and wave vector; those at its end"
        " over the load",
        caption="Waves of the edge at the end of the path",
    ),
    Export(
        "balls_in_motion",
        ("motion.nc", "motion_contacts.csv"),
        observed="motion",
        states="one",
        find=_find_motion,
        write=_write_motion,
        columns=_list_contact_columns,
        read=_read_motion,
        words="balls at all times, network, forces of contacts; of each contact arrival and"
        " greatest force",
    ),
    Export(
        "surface",
        ("surface.json", "surface.csv", "surface.png"),
        observed="surface",
        states="one",
        find=_find_surface,
        cost=_cost_surface,
        write=_write_surface,
        of_states=True,
        read=partial(_read_json, "SurfaceSpectrum"),
        draw=_draw_surface,
        rank=4,
        words="spectrum of the outer layer: `gp.SurfaceSpectrum.from_dict`; waves of the edge; map",
        caption="Waves of the edge",
    ),
    Export(
        "design",
        ("design.json", "design.csv", "design_history.csv", "design.png"),
        observed="design",
        states="one",
        find=_find_design,
        cost=_cost_design,
        summarise=_summarise_design,
        write=_write_design,
        read=partial(_read_json, "Design"),
        draw=partial(_plot, "design"),
        rank=1,
        words="the best network, its goal and the certificate: `gp.Design.from_dict`; the variables"
        " at the start, at the end, and their bounds; the goal at each evaluation; figure; in"
        " `summary.yaml`, `design`, the goal at both ends and up to twenty variables",
        caption="The goal during the search, and the network at its start and at its end",
    ),
    Export(
        "bands",
        ("band.yaml", "bands.png"),
        observed="bands",
        states="one",
        find=_find_bands,
        cost=_cost_bands,
        packages=_PHONON_PACKAGES,
        summarise=lambda run: {"top_frequency": float(run.bands.frequencies.max())},
        write=_write_bands,
        of_states=True,
        read=_read_bands,
        draw=_draw_bands,
        joined="bands",
        marks=(rb"\nphonon:",),
        rank=1,
        words="[bands](#bandyaml) in phonopy's format; the bands, with the density of states if"
        " asked for",
        caption="Frequencies along the path of wave vectors, and the density of states",
    ),
    Export(
        "force_constants",
        ("phonopy_params.yaml",),
        observed="bands",
        states="one",
        find=_find_force_constants,
        cost=_cost_force_constants,
        packages=_PHONON_PACKAGES,
        write=_write_force_constants,
        words="[force constants](#phonopy_paramsyaml) for phonopy and Euphonic",
    ),
    Export(
        "dos",
        ("dos.csv",),
        observed="dos",
        states="one",
        when=lambda scene: not scene.packing.is_network,
        find=lambda run: run.phonons.dos(mesh=run.scene.mesh),
        cost=_cost_dos,
        packages=_PHONON_PACKAGES,
        write=_write_dos,
        columns=partial(_list_fields, "dos", _DENSITY_COLUMNS[:-1]),
        along="frequency",
        read=_read_dos,
        joined="dos",
        marks=(rb"\Afrequency_Hz",),  # other tables are for spreadsheets
        label="density of states",
        words="[density of states](#doscsv)",
    ),
    Export(
        "dos_figure",
        ("dos.png",),
        observed="dos",
        states="one",
        when=lambda scene: "bands" not in scene.observe and not scene.packing.is_network,
        draw=_draw_bands,
        source="dos.csv",
        rank=2,
        occasion="the same without `bands`",
        words="the same",
        caption="Density of states",
    ),
    Export(
        "gaps",
        (),
        observed="gaps",
        find=_find_gaps,
        packages=_PHONON_PACKAGES,
        summarise=lambda run: {"gaps": run.gaps.tolist()},
    ),
    Export(
        "sample",
        ("sample.extxyz", "forces.png"),
        states="one",
        when=_has_sample,
        packages=("ase",),
        write=_write_sample,
        draw=_plot_sample,
        source="",
        occasion="a simulation, one state",
        words="[balls of the first sample](#sampleextxyz); force chains, distribution of forces",
        caption="Contact forces in the first sample, and their distribution",
    ),
    Export(
        "network",
        ("sample_balls.csv", "sample_contacts.csv"),
        states="one",
        when=_has_friction,
        write=_write_network,
        occasion="the same with `friction_history`",
        words="[balls of the first sample, and its contacts that carry load]"
        "(#sample_ballscsv-and-sample_contactscsv)",
    ),
    Export(
        "packing",
        TABLES,
        when=_has_files,
        write=_write_packing,
        occasion="block `network`",
        words="balls and contacts of the packing, as `ContactNetwork.from_table` reads them",
    ),
    Export(
        "sample_dos",
        ("sample_dos.json", "sample_dos.csv", "sample_dos.png"),
        observed="dos",
        states="one",
        when=_has_own_density,
        find=_find_sample_dos,
        write=partial(_write_fields, "sample_dos", _DENSITY_COLUMNS),
        columns=partial(_list_fields, "sample_dos", _DENSITY_COLUMNS[:-1]),
        along="frequency",
        read=partial(_read_json, "SpectralDensity"),
        draw=partial(_plot_with_errors, "sample_dos"),
        occasion="`dos`, a simulation, one state",
        words="density of states of the first sample: `gp.SpectralDensity.from_dict`",
        caption="Density of states of the simulated arrays",
    ),
    Export(
        "spectrum",
        ("spectrum.json", "spectrum.csv", "spectrum.png"),
        observed="spectrum",
        states="one",
        of_arrays=True,
        packages=("ase",),
        find=_find_spectra,
        write=partial(_write_with_table, "spectrum"),
        columns=lambda run: run["spectrum"].numbers,
        read=partial(_read_json, "PathSpectra"),
        draw=partial(_plot_with_errors, "spectrum"),
        words="spectral functions of the first sample; their peaks, widths, mean free paths; map",
        caption="Spectral functions of the simulated arrays",
    ),
    Export(
        "pulse",
        ("pulse.json", "pulse.csv", "pulse.png"),
        observed="pulse",
        states="one",
        of_arrays=True,
        find=_find_pulse,
        summarise=lambda run: {"pulse_distance": run["pulse"].distance},
        write=partial(_write_fields, "pulse", _PULSE_COLUMNS),
        columns=partial(_list_fields, "pulse", _PULSE_COLUMNS),
        along="time",
        read=partial(_read_json, "Pulse"),
        draw=partial(_plot_with_errors, "pulse"),
        words="what was sent and heard: `gp.Pulse.from_dict`; force, coherent signal, speckle;"
        " figure",
        caption="A pulse through the simulated arrays",
    ),
    Export(
        "sweep_incomplete",
        ("sweep_incomplete.nc", "sweep_incomplete.csv"),
        when=lambda _scene: False,  # it is written where a run fails
        occasion="a path that ends early",
        words="the loads that all media reached, as `sweep`",
    ),
    Export(
        "report",
        ("report.html", "report.md"),
        command="report",
        occasion="`granphon report`",
        words="[one page](../how-to/report.md) about the folder",
    ),
    Export(
        "fit",
        ("fit.yaml", "fit.csv", "fit.png"),
        write=lambda results, folder: results["fit"].write(folder),
        read=_read_fit,
        draw=partial(_plot, "fit"),
        joined="fit",
        marks=(b"class: WidthFit", b"class: DampingFit"),
        rank=7,
        command="fit",
        occasion="`granphon fit`",
        words="[the fit](#fityaml-and-fitcsv)",
        caption="Measured values, the fit, and the residuals",
    ),
    Export(
        "tradeoff",
        ("tradeoff.csv", "tradeoff.png"),
        write=_write_tradeoff,
        draw=partial(_plot, "tradeoff"),
        source="",
        command="tradeoff",
        occasion="`granphon tradeoff`",
        words="[errors and costs](#tradeoffcsv); error over time",
        caption="Error against time of the media",
    ),
):
    OUTPUTS.own(_row.name, _row)


def register_output(
    name: str,
    files: Sequence[str],
    words: str,
    *,
    when: Callable[[Any], Any] | None = None,
    find: Callable[[Any], Any] | None = None,
    write: Callable[[Any, Path], None] | None = None,
    read: Callable[[Path], Any] | None = None,
    draw: Callable[..., Any] | None = None,
) -> Export:
    """Make an output of runs known by its name: to scenes, which may observe it, to ``check``,
    ``run``, ``plot``, and to the table of the reference.

    Parameters
    ----------
    name : its name in scenes and results, a word of letters, digits and underscores; it may be that
        of an observable that was registered before, which a scene then observes too.
    files : names of its files, or its only name. One may be a figure, whose name ends in .png.
    words : what the files hold, in a few words.
    when : function of the :class:`~granphon.Scene` that says whether its run has the output; by
        default a run has it if the scene observes the ``name``.
    find : function of the :class:`~granphon.RunResult` that returns the value of the output, which
        ``result[name]`` is then; None where there is nothing to write.
    write : function of the result and of a folder, a path, that writes the files but the figure;
        needed if there are such files.
    read : function of the path of the first file that returns the value from it, for a figure that
        is drawn again.
    draw : function of the result that returns a matplotlib figure; needed if there is a figure. The
        same function draws it again: the results of a folder have ``dataset`` and ``[name]``. Of
        the keywords ``variable``, ``where``, ``rows``, ``columns`` and ``tell`` it is given those
        that it names, with what the user of ``granphon plot`` asks for; the others are refused.

    Returns
    -------
    The row of the output. Where ``when``, ``find``, ``write`` or ``read`` fails, the run is an
    error that names the output, and nothing is written; where ``draw`` fails, a run has a warning.

    Raises
    ------
    InputError : a name that another output has, or that is no such word; no file, one that another
        output has, that is given twice, or that is no plain name; ``words`` that are no text, or
        blank; two figures; an argument that is no function; files without their function.
    """
    given_name: Any = name
    is_text = isinstance(given_name, str)
    is_of_granphon = is_text and name in CATALOGUE and not CATALOGUE.is_added(name)
    if not is_text or not is_free(name) or is_of_granphon:
        mend = (
            "Give a word of letters, digits and underscores that scenes and data sets do not have"
            " yet, or that of a registered observable"
        )
        raise InputError(f"an output cannot have the name {brief(name)}", mend=mend)
    row = Export(
        name,
        _read_file_names(name, files),
        observed="" if when else name,
        when=when,
        find=find,
        write=write,
        read=read,
        draw=draw,
        occasion=f"`{name}`",
        words=require(f"words of the output {name!r}", text, words),
    )
    _require_functions(row)
    return OUTPUTS.add(name, row, write or draw)


def _read_file_names(name: str, files: Any) -> tuple[str, ...]:
    """Return the names ``files`` of an output ``name`` that is to be registered, as a tuple.

    InputError unless they are different plain names with an ending, which no other output has, at
    least one, and at most one of a figure.
    """
    file_names: tuple[str, ...] = require(f"files of the output {name!r}", text_list, files)
    holders = {file: holder.name for _name, holder in OUTPUTS.items() for file in holder.files}
    for file in file_names:
        is_plain = Path(file).name == file and file.isprintable() and not file.startswith(".")
        if not is_plain or not Path(file).suffix:
            mend = "Give a plain name with an ending, such as impedance.csv"
            raise InputError(f"{brief(file)} is no file of an output", mend=mend)
        if holders.get(file, name) != name:
            why = f"The output {holders[file]!r} has it"
            raise InputError(f"the output {name!r} cannot have the file {file}", why)
    mend = "Give at least one file, and one figure at most"
    if not file_names:
        raise InputError(f"the output {name!r} has no files", mend=mend)
    if len(set(file_names)) < len(file_names):
        repeated_name = next(file for file in file_names if file_names.count(file) > 1)
        problem = f"the output {name!r} has the file {repeated_name} twice"
        raise InputError(problem, mend="Give it once")
    n_figures = sum(file.endswith(_FIGURE_ENDING) for file in file_names)
    if n_figures > 1:
        raise InputError(f"the output {name!r} has {n_figures} figures", mend=mend)
    return file_names


def _require_functions(row: Export) -> None:
    """Raise InputError unless the functions of a ``row`` that is to be registered can be called,
    and there is a function for its files of numbers and for its figure.
    """
    for word, is_needed in (
        ("when", False),
        ("find", False),
        ("read", False),
        ("write", bool(row.numbers)),
        ("draw", bool(row.figure)),
    ):
        function = getattr(row, word)
        if function is None and is_needed:
            problem = f"the output {row.name!r} has no function {word}"
            raise InputError(problem, "Its files need it", f"Give {word}")
        if function is not None and not callable(function):
            problem = f"{word} of the output {row.name!r} is {brief(function)}"
            raise InputError(problem, mend="Give a function")


# -- lists of outputs and files --------------------------------------------------------------------


def list_outputs(scene: Any) -> list[Export]:
    """Return the rows of the outputs that a run of a ``scene`` has."""
    return [row for _name, row in OUTPUTS.items() if row.is_of(scene)]


def is_of_arrays_alone(name: str, swept: Collection[str]) -> bool:
    """Whether only simulated arrays have the observable ``name``, a word of waves in arrays: no
    output of it is also of other media, among those that a run with the axes ``swept`` may have. A
    pulse of a sweep, which has no output of its own, is of arrays alone.
    """
    rows = [row for _name, row in OUTPUTS.items() if row.observed == name]
    return all(row.of_arrays for row in rows if row.is_of_number(swept))


def list_figures(folder: Path) -> list[Export]:
    """Return the rows of the outputs whose figures can be drawn from the files in a ``folder``:
    ``row.make_figure(Results(folder))`` draws one.
    """
    return [
        row for _name, row in OUTPUTS.items() if row.draw is not None and row.find_source(folder)
    ]


def list_files(rows: Sequence[Export], *, figures: bool = True) -> tuple[str, ...]:
    """Return the names of the files of the outputs ``rows``: those of numbers first, and then, if
    ``figures``, those of figures.
    """
    names = [name for row in rows for name in row.numbers]
    if figures:
        names += [row.figure for row in rows if row.figure]
    return tuple(names)


def expected_files(scene: Any, *, figures: bool = True) -> tuple[str, ...]:
    """Return the names of the files that a run of a ``scene`` writes if every output has a value
    and every figure can be drawn; those of figures only if ``figures``.
    """
    return list_files(list_outputs(scene), figures=figures)


def every_file() -> tuple[str, ...]:
    """Return the names of all files that runs of scenes, and reports about runs, may write. A later
    run in the same folder makes all of them outdated.
    """
    return list_files([row for _name, row in OUTPUTS.items() if row.command in _RUN_COMMANDS])


def require_folder(folder: Path) -> None:
    """Raise :class:`~granphon.base.errors.MissingFileError` unless ``folder`` is a folder."""
    if not folder.is_dir():
        problem = f"there is no folder {folder}"
        if os.path.lexists(folder):
            problem = f"{folder} is no folder"
        raise MissingFileError(problem, mend="Give the folder of a run")


def read_summary(folder: Path) -> dict[str, Any]:
    """Return the content of summary.yaml in the ``folder`` of a run; raises
    :class:`~granphon.base.errors.InputError` if there is no such file, or if it is no summary of
    this version.
    """
    path = folder / "summary.yaml"
    summary = read_yaml(path)
    if not isinstance(summary, dict):
        why = "Granphon did not write it so"
        raise InputError(f"{path} holds no keys", why, "Run the scene again")
    require_schema(path, summary.get("schema"), SUMMARY_SCHEMA)
    return summary
