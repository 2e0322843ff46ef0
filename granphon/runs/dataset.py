"""The data set of a sweep: its frame, which says what is computed, the results of the cases in it,
and its files.

The files are netCDF for programs, which is read back, and a table for spreadsheets.

A data set that granphon has made or read has an accessor: ``dataset.granphon.plot()``,
``.exponent()``, ``.fit(...)``. Units are the attributes ``units`` of the variables, which
``dataset.pint.quantify()`` of pint-xarray takes.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.packing import SWEEP_PARAMETERS, Packing
from granphon.base.arrays import pad_columns
from granphon.base.errors import (
    InputError,
    InstabilityError,
    MechanismError,
    MissingPackageError,
    needing,
)
from granphon.base.progress import Progress, silent
from granphon.base.quantities import LIGHT_VELOCITY, LOAD_KINDS, find_load_unit, is_si
from granphon.base.results import restore
from granphon.base.tables import Heading, write_table
from granphon.base.text import (
    damage_error,
    digest,
    read_bytes,
    require_schema,
    show,
    suggest,
    versions,
    warn_unverified,
)
from granphon.base.validation import find_unit_of
from granphon.dynamics.elasticity import voigt_names
from granphon.observables.catalogue import CATALOGUE, WAVE_COSTS, entry_of
from granphon.runs.execution import solve_all
from granphon.runs.finished_tasks import Store, TaskResult
from granphon.runs.notes import CaseNotes, tell_notes
from granphon.runs.tasks import (
    INCOMPLETE,
    SWEEP_SCHEMA,
    Grid,
    drop_marks,
    explain_end,
    find_reached,
    read_notes,
    to_json,
)
from granphon.runs.workers import packages

if TYPE_CHECKING:
    from xarray import DataArray
    from xarray import Dataset as Dataset

    from granphon.media.arrangement import Balls
    from granphon.waves.settings import WaveSettings
else:
    Dataset = Any  # what only names the type does not load xarray


Array = NDArray[Any]
#: attribute "format" of the netCDF file, by which a sweep is recognised
FORMAT = "granphon sweep"
#: last dimensions of variables of which some states have fewer values than others
_UNEVEN_DIMS = ("surface_wave", "gap", "branch", "response_peak")
#: name of the attribute that says of each medium, by its label, whether its states have finite
#: overlap, null if some have it and others have not; a JSON text
OVERLAP_OF_MEDIA = "finite_overlap_of_media"
#: name of the attribute with the sha256 digest of the numbers
DIGEST = "granphon_sha256"
#: longest time that opening a file without a digest may take, s
TRIAL_SECONDS = 120.0
#: program of the process that tries to open a file without a digest, see _require_openable
_TRIAL = """
import sys
sys.path.insert(0, sys.argv[1])
import granphon
sys.path[:1] = []
sys.path.extend(sys.argv[2:])
from granphon.runs.dataset import open_bytes
open_bytes(sys.stdin.buffer.read())
print("good")
"""
#: text behind the data of a file; the sha256 digest of all bytes before this text follows, in
#: hexadecimal digits
_TRAILER = b"\ngranphon sha256 of all bytes before: "
#: length of that text with its digest, bytes
_TRAILER_BYTES = len(_TRAILER) + 64
#: size of the largest file that is read, and of the largest data set in one, bytes: a sweep may
#: hold many bands
_MOST_BYTES = 2_000_000_000
#: variables above zero in data sets of packings; those of crystals may have any sign, as balls may
#: adhere, or bear gravity alone
_COMPRESSIVE = {"force", "pressure"}
#: variables above zero, and those that may also be zero; all are finite, but for
#: :data:`_MAY_BE_INFINITE`
_ABOVE_ZERO = {
    "normal_stiffness",
    "effective_density",
    "stiffness_ratio",
    "longitudinal",
    "bulk",
    "shear",
    "young_modulus",
    "density",
    "diameter",
}
_ZERO_OR_ABOVE = {
    "shear_stiffness",
    "reduced_force",
    "force_fluctuation",
    "contact_fraction",
    "contact_force_fluctuation",
    "width",
    "expected_error",
    "frequencies",
    "line_frequency",
    "line_width",
    "mean_free_path",
    "attenuation",
    "dos_total",
    "transverse",
    "transverse_slow",
    "transverse_fast",
    "twist",
    "torsion",
    "bending",
}
_VELOCITIES = {"longitudinal", "transverse", "transverse_slow", "transverse_fast", "twist"}
#: variables that are infinite for equal balls, or where no error is known
_MAY_BE_INFINITE = {
    "reduced_force",
    "reduced_spacing",
    "expected_error",
    "mean_free_path",
    "damped_quality",
}
#: attributes that hold a JSON text, and its type
_JSON_TYPES = {
    "packing": dict,
    "media": list,
    "observe": list,
    "versions": dict,
    "warnings": list,
    OVERLAP_OF_MEDIA: dict,
}
_TYPE_WORDS = {dict: "mapping", list: "list"}


# -- the work --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class SweepRun:
    """The work of a sweep: the cases of its ``grid``, each with its tasks, and the ``frame``, which
    is the data set before anything is computed.
    """

    grid: Grid
    frame: Dataset

    @classmethod
    def of(cls, grid: Grid) -> Self:
        """Return the work on a grid, of which nothing is computed yet.

        Raises :class:`~granphon.base.errors.InputError` as :func:`make_frame` does, and, where the
        request of the grid takes a lattice without velocities for an error,
        :class:`~granphon.base.errors.MechanismError` or
        :class:`~granphon.base.errors.InstabilityError` for a case with such a lattice.
        """
        frame = make_frame(grid)
        if grid.request.sound:
            _require_sound(grid)
        return cls(grid, frame)

    def do(
        self,
        executor: Executor | None = None,
        progress: Progress = silent,
        store: Store | None = None,
    ) -> list[TaskResult]:
        """Do all tasks, and return their results in the order of the cases and of the tasks of
        each case.

        The arguments are those of :func:`~granphon.runs.execution.solve_all`. A ``store`` is
        claimed for this sweep, and keeps the results. The one task of a state that is already known
        is done here, without ``executor``, and its result is not kept.
        """
        tasks = [task for case in self.grid.cases for task in case.tasks]
        is_known = tasks[0].known_state is not None
        if store is not None:
            store.claim(collect_identity(self.frame), lambda: [task.name for task in tasks])
        if is_known:
            # only the waves of its network take time that progress tells of
            has_networks = tasks[0].request.waves is not None
            with progress.step("networks") if has_networks else nullcontext():
                return [task.solve() for task in tasks]
        return solve_all("states", tasks, executor, progress, store)

    def join(self, results: Sequence[TaskResult]) -> Dataset:
        """Return the data set from the results of all tasks, in the order of :meth:`do`.

        Raises :class:`~granphon.base.errors.ConvergenceError` if a path of loads ends early; the
        ``reached`` of the error is the data set at the loads that all paths have reached.
        """
        remaining = iter(results)
        joined = [case.join(list(islice(remaining, len(case.tasks)))) for case in self.grid.cases]
        dataset = fill(self.frame, self.grid, [drop_marks(result) for result in joined])
        reached = find_reached(joined, dataset.sizes["load"])
        if len(reached) < dataset.sizes["load"]:
            error = explain_end(joined)
            error.reached = dataset.isel(load=reached).assign_attrs({INCOMPLETE: str(error)})
            raise error
        return dataset


def _require_sound(grid: Grid) -> None:
    """Raise MechanismError or InstabilityError, with the label of the case, if the lattice of a
    case of the ``grid`` carries no sound.
    """
    for case in grid.cases:
        # an array has its own forces, which are not those of the lattice
        finite_overlap = grid.request.finite_overlap and not case.medium.simulates
        try:
            case.medium.of(case.packing).require_sound(finite_overlap)
        except (MechanismError, InstabilityError) as error:
            raise error.restate(f"{case.label}: {error}") from None


# -- the frame, and results in it ------------------------------------------------------------------


def make_frame(grid: Grid) -> Dataset:
    """Return the data set of a ``grid`` before anything is computed: coordinates, the path of the
    bands, and the inputs as attributes.

    The path, which all packings share, has s segments of p points, and labels of its corners. In
    the data set ``qpoints`` (s, p, 3) are fractions of the reciprocal cell, ``distances`` (s, p)
    lengths along the path of q/(2 pi), in units of 1/d, or of 1/a for states with finite overlap,
    and ``labels`` (s + 1,) the names of the corners. Data sets get their accessor, see
    :func:`register_accessor`.

    Raises :class:`~granphon.base.errors.InputError` for an impossible packing, for a packing that
    has no medium at a load, if there is no such path, and if the bands of the packings do not fit
    into one array. Raises :class:`~granphon.base.errors.MissingPackageError` without xarray.
    """
    with needing("A data set"):
        from xarray import Dataset

        register_accessor()

    request = grid.request
    finite_overlaps = _find_finite_overlaps(grid)
    variables = _frame_bands(grid, finite_overlaps)
    coordinates = _frame_states(grid)
    attrs = _frame_attributes(grid, finite_overlaps)
    if request.direction is not None:
        direction, direction_words = _frame_direction(request.direction)
        coordinates["direction"] = direction
        attrs["direction"] = direction_words
    if request.waves is not None:
        attrs["waves"] = to_json({"of": request.waves, "exponents": request.exponents})
        wave_variables, wave_coordinates = _frame_waves(request.waves)
        variables |= wave_variables
        coordinates |= wave_coordinates
    if request.surface is not None:
        attrs["surface"] = to_json(request.surface)
    if request.bands is not None:
        attrs["damping"] = to_json(request.bands)
    if request.finite_overlap and not all(medium.simulates for medium in grid.media):
        attrs["exponent"] = (
            "left out: it is defined for overlaps that are small beside the diameter"
        )
    attrs["packing"] = to_json(grid.packing)
    return Dataset(variables, coordinates, attrs)


def _find_finite_overlaps(grid: Grid) -> Array:
    """Return whether each state of the ``grid`` has finite overlap, (media, combinations of the
    values of the parameters, loads).
    """
    n_media = len(grid.media)
    # (cases, loads), of which the media run fastest
    finite_overlaps = np.array([case.finite_overlaps for case in grid.cases])
    return np.swapaxes(finite_overlaps.reshape(-1, n_media, grid.load.size), 0, 1)


def _frame_attributes(grid: Grid, finite_overlaps: Array) -> dict[str, Any]:
    """Return the attributes that every data set has, by name, from its ``grid`` and from the
    ``finite_overlaps`` (media, combinations, loads) of :func:`_find_finite_overlaps`. The attribute
    ``direction`` is that of a grid that requests none; where one is requested, :func:`make_frame`
    replaces the attribute.
    """
    structure = grid.cases[0].packing.structure
    x_axis = ("(1)", "(1, 0)", "(1, 0, 0)")[structure.periods - 1]
    media = [{medium.name: medium.settings_on(structure)} for medium in grid.media]
    overlap_of_media = dict[str, bool | None]()
    for medium, overlaps_of_medium in zip(grid.media, finite_overlaps, strict=True):
        values = set(overlaps_of_medium.ravel().tolist())
        overlap_of_media[medium.label] = values.pop() if len(values) == 1 else None
    return {
        "format": FORMAT,
        "schema": SWEEP_SCHEMA,
        "versions": to_json({**packages(), **versions("xarray", "h5netcdf")}),
        "media": to_json(media),
        # netCDF has no attributes of type bool
        "finite_overlap": int(np.all(finite_overlaps)),
        OVERLAP_OF_MEDIA: to_json(overlap_of_media),
        "direction": f"{x_axis}, Cartesian, where velocities depend on it",
        "observe": to_json(grid.request.observe),
    }


def _frame_waves(waves: WaveSettings) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the variables and the coordinates of ``waves``, by name: the path and the
    polarisations of spectra, and the coordinates of the blocks about networks.
    """
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    if waves.spectrum is not None:
        # imported here: other sweeps do not need spectra
        from granphon.waves.path_spectra import join_labels

        coordinates["polarisation"] = list(waves.spectrum.polarisation)
        labels = np.array(join_labels(waves.path, waves.labels))
        meaning = {"long_name": "corners of the path of the spectra"}
        variables["labels_of_path"] = ("corner_of_path", labels, meaning)
    for settings in waves.of_networks:
        for name, (values, unit) in settings.coordinates.items():
            coordinates[name] = (name, np.array(values), {"units": unit} if unit else {})
    return variables, coordinates


def _name_unit_of_path(finite_overlaps: Array) -> str:
    """Return the unit of distances along a path, for the title of the variable;
    ``finite_overlaps`` says of each state whether it has finite overlap.

    The unit is no attribute ``units``: programs that parse units read "1/d" as once a day, and the
    spacing a differs from load to load.
    """
    if np.all(finite_overlaps):
        return "1/a"
    if np.any(finite_overlaps):
        return "1/d, or 1/a of states with finite overlap"
    return "1/d"


def _frame_bands(grid: Grid, finite_overlaps: Array) -> dict[str, Any]:
    """Return the variables of the path of the bands of a ``grid``, ``qpoints`` (s, p, 3),
    ``distances`` (s, p) and ``labels`` (s + 1,) as in :func:`make_frame`; empty without bands.

    ``finite_overlaps`` says of each state whether it has finite overlap. InputError for a path that
    the lattice does not have, and for cases with different lattices, or different motions of balls.
    """
    structure = grid.cases[0].packing.structure
    path = grid.request.find_path(structure)
    if path is None:
        return {}
    lattices_with_motions = {
        (case.packing.structure, case.packing.ball_motions) for case in grid.cases
    }
    if len(lattices_with_motions) > 1:
        why = (
            "The number of branches, or the Brillouin zone, differs, so that they do not fit into"
            " one array"
        )
        problem = "bands cannot be swept over friction, motions or lattices"
        raise InputError(problem, why, "Make a sweep of each")
    qpoints, corners = path
    periods = structure.periods
    reciprocal_vectors = np.linalg.inv(structure.vectors[:, :periods]).T
    cartesian = qpoints[..., :periods] @ reciprocal_vectors
    # The first step of each segment is zero, so that segments that do not join are drawn side by
    # side.
    steps = np.diff(cartesian, axis=1, prepend=cartesian[:, :1])
    lengths = np.linalg.norm(steps, axis=2)
    distances = np.cumsum(lengths).reshape(lengths.shape)
    path_unit = _name_unit_of_path(finite_overlaps)
    distance_words = f"distance along the path in units of {path_unit}, without 2 pi"
    fraction_words = "fractions of the reciprocal cell"
    return {
        "qpoints": (
            ("segment", "point", "fraction"),
            qpoints,
            {"long_name": fraction_words, "units": "1"},
        ),
        "distances": (
            ("segment", "point"),
            distances,
            {"long_name": distance_words, "units": "1"},
        ),
        "labels": ("corner", np.array(corners), {"long_name": "corners of the path"}),
    }


def _frame_states(grid: Grid) -> dict[str, Any]:
    """Return the coordinates of the states of a ``grid``, by their names: loads in SI units, the
    labels of the media, and the labels of the values of each swept parameter.
    """
    load = grid.load
    packing = grid.cases[0].packing
    load_attributes = _list_attributes(load.kind, load.array, packing)
    if load.kind == "pressure":
        # The pressure of a cut crystal acts on its faces too, so that its unit is not that of the
        # dimension alone.
        structure = packing.structure
        load_attributes["units"] = find_load_unit(
            "pressure", structure.periods, structure.pressed_axes
        )
    coordinates: dict[str, Any] = {
        load.kind: ("load", load.array, load_attributes),
        "medium": [medium.label for medium in grid.media],
    }
    for axis in grid.axes:
        labels = np.array(axis.labels)
        attributes = _list_attributes(axis.name, labels, packing)
        if axis.name in ("spread", "lattice"):
            # a label does not describe a spread or a lattice completely
            attributes["values"] = to_json(axis.values)
        coordinates[axis.name] = (axis.name, labels, attributes)
    return coordinates


def _frame_direction(direction: tuple[Any, ...]) -> tuple[tuple[Any, ...], str]:
    """Return the coordinate of the direction of sound, as dimensions, names and attributes, and the
    attribute ``direction`` of the data set.

    ``direction`` holds the Cartesian components of a direction, or is a list of directions, a tuple
    of one or more such tuples; only a list has the dimension ``direction``.
    """
    is_list = isinstance(direction[0], tuple)
    directions: Any = direction if is_list else (direction,)
    # Six digits are easier to read, and serve unless two directions would have the same name.
    short_names = [
        f"({', '.join(f'{component:g}' for component in components)})" for components in directions
    ]
    exact_names = [f"({', '.join(map(repr, components))})" for components in directions]
    are_distinct = len(set(short_names)) == len(short_names)
    names = np.array(short_names if are_distinct else exact_names)
    attributes = {
        "long_name": "direction of propagation, Cartesian",
        "values": to_json(direction),
    }
    words = f"{', '.join(names.tolist())}, Cartesian"
    if is_list:
        return ("direction", names, attributes), words
    return ((), names[0], attributes), words


def tabulate(
    packing: Packing,
    medium: str,
    force: Array,
    values: Mapping[str, Array],
    attributes: Mapping[str, Any],
) -> Dataset:
    """Return a data set like that of a sweep, of n states of one ``medium``.

    ``force``, N, and each of the ``values``, in SI units, have the shape (n,). The data set has the
    dimensions ``load``, of size n, and ``medium``, of size 1; ``attributes`` are its attributes,
    beside the packing. Data sets get their accessor, see :func:`register_accessor`.
    """
    with needing("A data set"):
        from xarray import Dataset

        register_accessor()

    variables: dict[str, Any] = {
        name: (("load", "medium"), array[:, None], _list_attributes(name, array, packing))
        for name, array in values.items()
    }
    variables["valid"] = (("load", "medium"), np.ones((force.size, 1), bool))
    loads = ("load", force, _list_attributes("force", force, packing))
    coordinates = {"force": loads, "medium": [medium]}
    return Dataset(variables, coordinates, {**attributes, "packing": to_json(packing)})


def find_dataset(result: Any) -> Dataset | None:
    """Return the data set of states that a ``result`` is, or has as its attribute ``dataset``; None
    for a result without one. A data set of states has a variable ``valid``. Raises InputError if a
    variable is not in SI units.
    """
    dataset: Dataset = getattr(result, "dataset", result)
    is_of_states = hasattr(dataset, "data_vars") and "valid" in dataset
    if not is_of_states:
        return None
    for name, values in dataset.variables.items():
        unit = str(find_unit_of(values) or values.attrs.get("units", ""))
        if not is_si(unit):
            mend = "Convert it back (.pint.to), or plot it with xarray"
            problem = f"{name} of the data set is in {unit}"
            raise InputError(problem, "Variables have SI units", mend)
    return dataset


def find_wave_errors(data: Dataset | None, of: str = "frequency") -> Any:
    """Return the standard errors (n,) of one number of each of the n waves of an edge in a ``data``
    set of one state; None without a data set, or if it has no such errors.

    ``of`` is the number whose errors are returned: "frequency", Hz, or another number that waves of
    an edge have, such as "weight".
    """
    name = f"surface_{of}_error"
    if data is None or name not in data:
        return None
    table = data[name]
    # the table has an empty place where a wave vector has fewer waves than another
    return table.values[np.isfinite(data["surface_frequency"].values)]


def find_energy_errors(motion: Any, data: Dataset | None) -> dict[str, Any]:
    """Return the standard errors (n,), J, of the energies of a ``motion`` at its n times, by the
    names of its attributes.

    The mapping is empty without a data set, and if the motion is that of one of several samples:
    the errors of the ``data`` set are then those of the means over the samples.
    """
    if data is None or not np.array_equal(data["motion_stored"].values.ravel(), motion.stored):
        return {}
    names = ("translation", "rotation", "stored", "lost")
    errors = {name: data.get(f"motion_{name}_error") for name in names}
    return {name: error.values.ravel() for name, error in errors.items() if error is not None}


def find_load(dataset: Dataset) -> str:
    """Return the kind of load that was applied to the states of a ``dataset``: the name of its
    coordinate along the loads, "force" if no such coordinate is a kind of load.
    """
    for name in LOAD_KINDS:
        if name in dataset.coords and dataset[name].dims == ("load",):
            return str(name)
    return "force"


def list_finite_overlap(dataset: Dataset) -> list[bool | None]:
    """Return for each medium of a ``dataset`` whether its states have finite overlap; None if some
    have it and others have not.

    Where the data set does not tell this of a medium, the attribute ``finite_overlap``, which is of
    all media, stands in; without this attribute no state has finite overlap.
    """
    default = bool(dataset.attrs.get("finite_overlap", 0))
    overlap_of_media = json.loads(dataset.attrs.get(OVERLAP_OF_MEDIA, "{}"))
    labels = np.atleast_1d(dataset["medium"].values).astype(str)
    return [overlap_of_media.get(label, default) for label in labels.tolist()]


def collect_identity(frame: Dataset) -> dict[str, Any]:
    """Return all that determines the numbers of a sweep, by name, as plain data for JSON: inputs,
    versions of packages, and the values of what is swept.

    The frame of a sweep and the sweep that is read from its file have equal identities, once that
    of the frame has been through JSON.
    """
    identity = {
        name: json.loads(frame.attrs[name])
        for name in ("packing", "media", "observe", "waves", "surface", "damping")
        if name in frame.attrs
    }
    identity["finite_overlap"] = bool(frame.attrs["finite_overlap"])
    all_versions = json.loads(frame.attrs["versions"])
    # other packages, such as those that write files, change no number
    identity["versions"] = {name: all_versions[name] for name in packages()}
    parameters = {*LOAD_KINDS, *SWEEP_PARAMETERS, "direction"}
    # a name with a point is a parameter of a kind of ball, or of a wall
    swept_names = [name for name in frame.coords if name in parameters or "." in str(name)]
    path_names = [name for name in ("labels", "qpoints") if name in frame]
    for name in swept_names + path_names:
        # where the values of a coordinate are labels, an attribute holds what the labels stand for
        values = frame[name].attrs.get("values")
        if values is None:
            identity[str(name)] = frame[name].values.tolist()
        else:
            identity[str(name)] = json.loads(values)
    return identity


def fill(frame: Dataset, grid: Grid, results: list[TaskResult]) -> Dataset:
    """Return the ``frame`` with the ``results`` filled in, one for each case of the ``grid``; a
    result holds arrays whose first axis is the loads.

    A variable that some cases lack is left out, but for standard errors (:func:`_fill_errors`), the
    choices of media (:func:`_fill_choices`), and velocities, moduli, pressures and waves
    (:func:`_fill_missing`), whose values are filled in. The results are changed in place.
    """
    packing = grid.cases[0].packing
    notes = [read_notes(result) for result in results]
    _fill_errors(grid, results)
    edge_waves = _join_edge_waves(grid, results)
    # padded before values are filled in, as these take the shape of the values of other results
    _pad_uneven(results)
    results, sentences = _fill_missing(results, packing.structure.periods)
    for notes_on_case, sentence in zip(notes, sentences, strict=True):
        if sentence:
            notes_on_case.append(sentence)
    warnings = list[str]()
    if any(notes):
        warnings = tell_notes(list(map(CaseNotes.of, grid.cases, notes)))
    _fill_choices(grid, results)
    variables = _stack_shared(frame, grid, results)
    if "tensor" in variables:
        voigt = list(voigt_names(packing.structure.periods))
        frame = frame.assign_coords(dict.fromkeys(CATALOGUE["tensor"].dims, voigt))
    if "sensitivities" in grid.request.observe:
        # imported here: other runs do not need derivatives
        from granphon.runs.sensitivities import NAME

        labels, variables[NAME] = _label_sensitivities(grid, variables[NAME], edge_waves)
        frame = frame.assign_coords(labels)
    along_path = dict(frame.data_vars)  # assigned last, to stand after the variables along it
    return (
        frame.drop_vars(list(along_path))
        .assign(variables)
        .assign(along_path)
        .assign_attrs(warnings=to_json(warnings))
    )


def _stack_shared(frame: Dataset, grid: Grid, results: Sequence[TaskResult]) -> dict[str, Any]:
    """Return the variables that all ``results`` have, one for each case of the ``grid``, by name,
    each as its dimensions, values and attributes. The load, a coordinate of the ``frame``, is not
    among them, nor are the notes.
    """
    packing = grid.cases[0].packing
    # the array of a variable has room for no case without the variable
    shared_names = set(results[0]).intersection(*results) - {grid.load.kind, "warnings"}
    variables: dict[str, Any] = {}
    for name in results[0]:
        if name in shared_names:
            dims, values = _stack(name, frame, grid, results)
            variables[name] = (dims, values, _list_attributes(name, values, packing))
    return variables


def _join_edge_waves(grid: Grid, results: Sequence[TaskResult]) -> list[str]:
    """Add the derivatives of the waves of an edge to those of the other quantities in each of the
    ``results``, which are changed in place. Return the names of these waves; empty for a run
    without derivatives.
    """
    if "sensitivities" not in grid.request.observe:
        return []
    from granphon.runs.sensitivities import join_edge_waves

    return join_edge_waves(results)


def _label_sensitivities(
    grid: Grid, derivatives: tuple[tuple[str, ...], Array, dict[str, str]], edge_waves: list[str]
) -> tuple[dict[str, Array], tuple[tuple[str, ...], Array, dict[str, str]]]:
    """Return the labels of the last two axes of the variable ``derivatives`` of a ``grid``, by
    dimension, and the variable.

    A variable consists of dimensions, values and attributes. The values are (..., quantities,
    parameters). The labels are the names of the quantities, the last of which are ``edge_waves``,
    and the names of the parameters. Quantities and parameters of which no state has a derivative
    are left out of the labels and of the values that are returned.
    """
    from granphon.runs.sensitivities import Parameters, list_quantities

    request = grid.request
    balls = grid.cases[0].packing
    quantities = list_quantities(balls, has_cutoffs="cutoffs" in request.observe)
    parameters = Parameters(balls, grid.load, request.surface).names
    dims, values, attributes = derivatives
    state_axes = tuple(range(values.ndim - 2))
    is_known = np.any(np.isfinite(values), axis=state_axes)  # (quantities, parameters)
    has_derivatives = np.any(is_known, axis=1)
    can_change = np.any(is_known, axis=0)
    labels = {
        dims[-2]: np.array([*quantities, *edge_waves])[has_derivatives],
        dims[-1]: np.array(parameters)[can_change],
    }
    return labels, (dims, values[..., has_derivatives, :][..., can_change], attributes)


def _stack(
    name: str, frame: Dataset, grid: Grid, results: Sequence[TaskResult]
) -> tuple[tuple[str, ...], Array]:
    """Return the dimensions and the values of the variable ``name`` of all cases of the ``grid``,
    each (loads, ...) in one of the ``results``. The axes of the values are loads, media, the
    parameters in their order, directions where the variable has them and the ``frame`` has several,
    and the variable's own dimensions.
    """
    axes = grid.axes
    counts = [len(axis.values) for axis in axes]
    by_case = np.array([result[name] for result in results])  # (cases, loads, ...)
    by_parameter = by_case.reshape(
        *counts, frame.sizes["medium"], grid.load.size, *by_case.shape[2:]
    )
    medium_axis = len(axes)
    load_axis = len(axes) + 1
    values = np.moveaxis(by_parameter, (load_axis, medium_axis), (0, 1))
    dims = ["load", "medium", *(axis.name for axis in axes)]
    entry = CATALOGUE[name]
    if entry.per_direction and "direction" in frame.dims:
        dims.append("direction")
    return (*dims, *entry.dims), values


def _fill_errors(grid: Grid, results: Sequence[TaskResult]) -> None:
    """Add to the ``results`` of the cases of a ``grid``, in place, the standard errors that some of
    them lack and others have.

    The error at a load is zero for a medium that samples nothing and for equal balls. For simulated
    arrays of balls that differ the error is not known, as of a single sample, and is nan.
    """
    # the shapes of standard errors without their first axis, the loads
    shapes = {
        name: result[name].shape[1:]
        for result in results
        for name in result
        if (entry := CATALOGUE.get(name)) and entry.sampled
    }
    n_loads = grid.load.size
    for case, result in zip(grid.cases, results, strict=True):
        errors = np.zeros(n_loads)
        for serving in case.serving_media:
            is_sampled = bool(serving.arrays) and serving.packing.width > 0.0
            errors[serving.loads] = np.nan if is_sampled else 0.0
        for name, shape in shapes.items():
            if name not in result:
                errors_of_name = np.broadcast_to(errors, (*shape, n_loads))
                result[name] = np.moveaxis(errors_of_name, -1, 0)  # (n_loads, *shape)


def _pad_uneven(results: Sequence[TaskResult]) -> None:
    """Pad the variables of which some states have fewer values than others with nan, so that the
    values of all cases have the same shape. The ``results`` are changed in place.
    """
    uneven_names = {
        name
        for result in results
        for name in result
        if (entry := CATALOGUE.get(name)) and entry.dims and entry.dims[-1] in _UNEVEN_DIMS
    }
    for name in uneven_names:
        results_with_name = [result for result in results if name in result]
        if len(results_with_name) == 1:  # there is no wider table to which it could be padded
            continue
        tables = pad_columns([result[name] for result in results_with_name])
        for result, table in zip(results_with_name, tables, strict=True):
            result[name] = table


def _fill_choices(grid: Grid, results: Sequence[TaskResult]) -> None:
    """Add to each of the ``results`` of the cases of a ``grid``, in place, the label of the medium
    that serves each load, "choice" (loads,), and the expected relative error of that medium,
    "expected_error" (loads,), +inf where none is known. Nothing is added unless a medium of the
    sweep was chosen automatically.
    """
    serving_media = [serving for case in grid.cases for serving in case.serving_media]
    if not any(serving.chosen_automatically for serving in serving_media):
        return
    for case, result in zip(grid.cases, results, strict=True):
        labels = np.empty(grid.load.size, object)
        errors = np.empty(grid.load.size)
        for serving in case.serving_media:
            labels[serving.loads] = serving.medium.label
            errors[serving.loads] = serving.errors
        result["choice"] = labels.astype(str)
        result["expected_error"] = errors


def _fill_missing(
    results: Sequence[TaskResult], periods: int
) -> tuple[list[TaskResult], list[str]]:
    """Return the results in which velocities, moduli, pressures and waves that only some of the
    ``results`` have are nan in the others, and for each result a sentence that says which are nan
    and why, see :func:`_explain_missing`.

    Bulk and shear moduli and the anisotropy are left out of all results if one of the lattices has
    a tensor without them. The tensor is left out if the moduli that say the same are kept: the bulk
    modulus and the shear modulus, or on a chain (``periods`` 1) the bulk modulus alone. A variable
    is left out with its standard error.
    """
    # values of each variable that may be nan, from the first result with the variable
    examples = {
        name: values
        for result in reversed(results)
        for name, values in result.items()
        if _may_be_missing(name)
    }
    omitted_names = {
        name
        for name in ("bulk", "shear", "anisotropy")
        if any("tensor" in result and name not in result for result in results)
    }
    # a chain has no shear modulus that the tensor would have to stand for
    dispensable_names = {"shear", "anisotropy"} if periods == 1 else {"anisotropy"}
    if "bulk" in examples and omitted_names <= dispensable_names:
        omitted_names.add("tensor")
    omitted_names |= {f"{name}_error" for name in omitted_names}
    filled_results = list[TaskResult]()
    sentences = list[str]()
    for result in results:
        nans = {
            name: np.full_like(example, np.nan)
            for name, example in examples.items()
            if name not in result and name not in omitted_names
        }
        values_of_result = {
            name: values for name, values in result.items() if name not in omitted_names
        }
        filled_results.append(values_of_result | nans)
        sentences.append(_explain_missing(result, list(nans)))
    return filled_results, sentences


def _explain_missing(result: TaskResult, missing: Sequence[str]) -> str:
    """Return in words why the variables ``missing``, which the ``result`` lacks, are nan: reasons
    parted by semicolons; empty if nothing is to be said.

    The reasons are about the pressure, and about velocities and moduli if the result has others of
    them: a result without any is that of a mechanism, which has its own warning.
    """
    reasons = list[str]()
    if "pressure" in missing:
        reasons.append("pressure is nan, as the stress of the lattice is not a pressure")
    # waves in arrays, which are not of sound, have notes of their own
    of_sound = [name for name in missing if _is_of_sound(name)]
    if of_sound and any(map(_is_of_sound, result)):
        verb = "is" if len(of_sound) == 1 else "are"
        reasons.append(f"{', '.join(of_sound)} {verb} nan, as balls with these motions have none")
    return "; ".join(reasons)


def _may_be_missing(name: str) -> bool:
    """Whether the variable ``name`` is nan in those cases of a sweep that lack the variable, if
    other cases have it.
    """
    return name == "pressure" or _find_cost(name) in ("velocities", *WAVE_COSTS)


def _is_of_sound(name: str) -> bool:
    """Whether the variable ``name`` is found from the velocities of sound."""
    return _find_cost(name) == "velocities"


def _find_cost(name: str) -> str:
    """Return the ``cost`` of the variable ``name`` in the catalogue, the word for what the variable
    is found from, such as "velocities" or "spectrum"; empty for a variable that is no observable.
    """
    entry = CATALOGUE.get(name)
    return entry.cost if entry else ""


def _list_attributes(name: str, values: Array, packing: Balls) -> dict[str, str]:
    """Return the attributes of the variable ``name`` of a ``packing``: its title, and its unit if
    the ``values`` are numbers.
    """
    entry = entry_of(name, packing)
    attributes = {"long_name": entry.title}
    if entry.unit and values.dtype.kind in "iuf":
        attributes["units"] = entry.unit
    return attributes


# -- files -----------------------------------------------------------------------------------------


def file_names(path: Path) -> list[str]:
    """Return the names of the netCDF file ``path`` and of the table beside it."""
    return [path.name, path.with_suffix(".csv").name]


def netcdf_bytes(dataset: Dataset) -> bytes:
    """Return the bytes of a netCDF file of the ``dataset``, made in memory because HDF5 does not
    survive a full disk. Raises :class:`~granphon.base.errors.MissingPackageError` without h5netcdf
    or xarray.
    """
    with needing("A netCDF file"):
        from h5netcdf import File  # type: ignore[import-untyped]
        from xarray.backends import H5NetCDFStore

    # by default xarray declares nan to be the mark of missing values
    encoding: Any = {name: {"_FillValue": None} for name in dataset.variables}
    stream = io.BytesIO()
    with File(stream, "w") as file:
        dataset.dump_to_store(H5NetCDFStore(file), encoding=encoding)
    return stream.getvalue()


def open_bytes(data: bytes) -> Dataset:
    """Return the data set of a netCDF file whose bytes are ``data``, read into memory.

    Raises ValueError if the file refers to other files, or unpacks to more than
    :data:`_MOST_BYTES`; MissingPackageError without h5py or xarray; and whatever HDF5, h5netcdf and
    xarray raise.
    """
    with needing("A netCDF file"):
        import h5py
        from xarray import open_dataset

    def require_inside(_: str, item: Any) -> None:
        """Raise ValueError if an ``item`` of the file, a group or a data set, refers to another
        file; h5py gives its name too.
        """
        keys = item if isinstance(item, h5py.Group) else ()
        links = [item.get(key, getlink=True) for key in keys]
        has_outer_link = any(isinstance(link, h5py.ExternalLink) for link in links)
        is_data = isinstance(item, h5py.Dataset)
        is_stored_outside = is_data and (item.external or item.is_virtual)
        if has_outer_link or is_stored_outside:
            raise ValueError("it refers to another file")

    stream = io.BytesIO(data)
    with h5py.File(stream, "r") as file:
        require_inside("/", file)
        file.visititems(require_inside)
    with open_dataset(stream, engine="h5netcdf") as dataset:
        if dataset.nbytes > _MOST_BYTES:
            raise ValueError(f"it unpacks to more than {_MOST_BYTES // 1_000_000} MB")
        return dataset.load()


def write_sweep(dataset: Dataset, path: Path) -> None:
    """Write a ``dataset`` into the netCDF file ``path``, and the table of the same name beside it;
    both replace what is there.

    The file carries two digests. The first, an attribute, is that of the numbers; it stays if
    another program rewrites the file. The second is that of all bytes of the netCDF file and stands
    behind the end of what HDF5 reads, so that damage is found before HDF5 reads the file.
    """
    data = netcdf_bytes(dataset.assign_attrs({DIGEST: _digest_numbers(dataset)}))
    path.write_bytes(data)
    with path.open("ab") as stream:
        stream.write(_TRAILER + hashlib.sha256(data).hexdigest().encode())
    _write_states(dataset, path.with_suffix(".csv"))


def _write_states(dataset: Dataset, path: Path) -> None:
    """Write the table ``path`` of the variables of a ``dataset`` with one number for each state, or
    for each state and direction of sound: a row for each load, medium, combination of parameters
    and direction.
    """
    state_dims = dataset["valid"].dims
    row_dims = state_dims
    if "direction" in dataset.dims:
        row_dims = (*state_dims, "direction")
    columns = list[Any]()
    if "direction" in dataset.coords:  # also a single direction, which has no dimension
        columns.append("direction")
    for name, variable in dataset.data_vars.items():
        if variable.dims in (state_dims, row_dims):
            columns.append(name)
    _write_rows(dataset, path, row_dims, columns)


def _digest_values(values: Array) -> tuple[str, Any]:
    """Return the type of ``values`` in words, and what stands for the values in a digest: of texts
    the texts themselves, in lists for each axis, of numbers their sha256 in hexadecimal digits.
    Neither the byte order of numbers nor the stored length of texts counts.
    """
    if values.dtype.kind in "OUT":
        return "text", values.astype(str).tolist()
    ordered = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    kind = f"{values.dtype.kind}{values.dtype.itemsize}"
    return kind, hashlib.sha256(ordered.data).hexdigest()


def _digest_numbers(dataset: Dataset) -> str:
    """Return the digest of the names, dimensions, types, numbers and attributes of a ``dataset``;
    the digest does not depend on how the file stores these.
    """
    variables = dict[str, list[Any]]()
    for name, variable in dataset.variables.items():
        variables[str(name)] = [
            list(variable.dims),
            list(variable.shape),
            *_digest_values(variable.values),
            variable.attrs,
        ]
    # In "history" and "NCO" other programs log what they did, which changes no number.
    ignored = (DIGEST, "history", "NCO")
    attributes = {name: value for name, value in dataset.attrs.items() if name not in ignored}
    return digest({"variables": variables, "attributes": attributes})


def write_waves(
    dataset: Dataset, path: Path, wave_dims: Sequence[str], *, numbered: bool = False
) -> None:
    """Write the table ``path`` of those variables of a ``dataset`` that have the last of the
    dimensions ``wave_dims``, and no others beside it than the rest of these and those of the
    states; a row for each point of all of these dimensions.

    ``numbered`` is for ``wave_dims`` without coordinates in the data set: columns of their indices,
    from zero, then tell rows apart.
    """
    dims = (*dataset["valid"].dims, *wave_dims)
    if numbered:
        numbers = {name: np.arange(dataset.sizes[name]) for name in wave_dims}
        dataset = dataset.assign_coords(numbers)
    coordinates = [name for name in wave_dims if name in dataset.coords]
    # The last dimension decides: without it are numbers of a state and the path of bands (segment,
    # point); with it alone are wave numbers (wavevector,), which each polarisation repeats.
    variables = [
        name
        for name, data in dataset.data_vars.items()
        if wave_dims[-1] in data.dims and set(data.dims) <= set(dims)
    ]
    _write_rows(dataset, path, dims, [*coordinates, *variables])


def write_edge_waves(dataset: Dataset, file: Path) -> None:
    """Write the table ``file`` of the waves of an edge in a ``dataset``: a row for each wave in
    every state, with its wave vector and the distance along the path.
    """
    wave_dims = ("surface_point", "surface_wave")
    distances = dataset["surface_distance"]
    # the columns of the path along the edge: distance, and components of the wave vector
    columns: dict[str, Any] = {"distance": (distances.dims, distances.values, {"units": "1/d"})}
    components = np.moveaxis(dataset["surface_qpoint"].values, -1, 0)
    for number, component in enumerate(components, 1):
        columns[f"q{number}"] = (distances.dims, component)
    waves = [name for name, data in dataset.data_vars.items() if wave_dims[-1] in data.dims]
    dims = (*dataset["valid"].dims, *wave_dims)
    names = [*columns, *waves]
    _write_rows(dataset.assign(columns), file, dims, names, row_variable="surface_frequency")


def _write_rows(
    dataset: Dataset,
    path: Path,
    dims: Sequence[Any],
    columns: Sequence[Any],
    row_variable: str | None = None,
) -> None:
    """Write the table ``path`` of a ``dataset``, with a row for each point of the grid of the
    dimensions ``dims``, of which the last runs fastest. A row has the load, the medium and the
    parameters, and then the variables or coordinates ``columns``, with all digits. Points at which
    the ``row_variable``, one of the columns, is nan have no row.
    """
    load = find_load(dataset)
    state_dims = dataset["valid"].dims
    names = [load, *state_dims[1:], *columns]
    headings = [Heading(str(name), dataset[name].attrs.get("units", "")) for name in names]
    grid = dataset["valid"].broadcast_like(dataset[list(columns)])
    values = list[list[Any]]()
    for name in names:
        variable = dataset[name].broadcast_like(grid).transpose(*dims)
        values.append(variable.values.ravel().tolist())
    rows: Iterable[tuple[Any, ...]] = zip(*values, strict=True)
    if row_variable is not None:
        index = names.index(row_variable)
        rows = (row for row in rows if not math.isnan(row[index]))
    with path.open("w", encoding="utf-8", newline="") as stream:
        write_table(stream, headings, rows)


def load_sweep(path: str | os.PathLike[str]) -> Dataset:
    """Read the data set that :func:`granphon.runs.sweep.sweep` wrote to ``path`` into memory.

    Raises
    ------
    MissingFileError : there is no such file.
    InputError : ``path`` is not the name of a file, or names a folder or a file that cannot be
        read; or the file is not a sweep, was damaged, was edited after granphon had written it, or
        has another schema.
    MissingPackageError : h5py or xarray is not installed.

    Warns
    -----
    UnverifiedFileWarning : the file carries no digest.
    """
    content, has_file_digest = _read_checked(path)
    try:
        # The bytes that were checked are opened: the file may have changed since.
        dataset = open_bytes(content)
        register_accessor()
    except MissingPackageError:
        raise
    except Exception as error:  # whatever makes HDF5, h5netcdf or xarray fail is in the file
        raise _explain_unreadable(path, str(error)) from None
    _require_sweep(path, dataset)
    kept_digest = dataset.attrs.pop(DIGEST, None)
    # an attribute of a file may be an array, whose comparison would have no truth value
    is_kept = isinstance(kept_digest, str) and kept_digest == _digest_numbers(dataset)
    if kept_digest is not None and not is_kept:
        raise damage_error(path, f"sha256 of the numbers, the attribute {DIGEST}")
    if kept_digest is None and not has_file_digest:
        _require_plausible(path, dataset)
        warn_unverified(path)
    return dataset


def _read_checked(path: str | os.PathLike[str]) -> tuple[bytes, bool]:
    """Return the bytes of the netCDF file in ``path``, and whether the digest of the file stands
    behind them; InputError if the digest is that of other bytes, or if a file without a digest
    cannot be opened.
    """
    content = read_bytes(path, _MOST_BYTES)
    netcdf = content[:-_TRAILER_BYTES]
    trailer = content[-_TRAILER_BYTES:]
    if not trailer.startswith(_TRAILER):
        _require_openable(path, content)
        return content, False
    if trailer != _TRAILER + hashlib.sha256(netcdf).hexdigest().encode():
        raise damage_error(path, "sha256 of the file, at its end")
    return netcdf, True


def _require_sweep(path: str | os.PathLike[str], dataset: Dataset) -> None:
    """Raise InputError unless a ``dataset``, read from the file ``path``, is a whole sweep in the
    schema that is read.
    """
    file_format = dataset.attrs.get("format")
    # an attribute of a file may be an array, whose comparison would have no truth value
    if not isinstance(file_format, str) or file_format != FORMAT:
        raise InputError(f"{path} is not a sweep", "granphon did not write it", "Give a sweep.nc")
    schema: Any = dataset.attrs.get("schema")
    if isinstance(schema, np.generic):
        schema = schema.item()
    require_schema(path, schema, SWEEP_SCHEMA)
    missing_names = {"force", "overlap", "valid", "medium"} - set(dataset.variables)
    if missing_names:
        problem = f"{path} is damaged: a part of the sweep is missing"
        raise InputError(problem, mend="Run the sweep again")


def _require_plausible(path: str | os.PathLike[str], dataset: Dataset) -> None:
    """Raise InputError if a variable or an attribute of a ``dataset``, read from the file ``path``
    without a digest, cannot be of a sweep.
    """
    for name, kind in _JSON_TYPES.items():
        if name in dataset.attrs and not _is_json_of(kind, dataset.attrs[name]):
            problem = (
                f"{path} is damaged: its attribute {name} is {show(dataset.attrs[name])}, which"
                f" is no JSON {_TYPE_WORDS[kind]}"
            )
            raise InputError(problem, mend="Run the sweep again")
    # balls with some of the motions lack velocities, and some lattices have no pressure
    swept = {"motions", "torsion", "bending", "lattice"}.intersection(dataset.coords)
    packing = json.loads(dataset.attrs.get("packing", "{}"))
    may_pull = packing.get("class") != Packing.__name__
    for name in map(str, dataset.variables):
        values = dataset[name].values
        if not _is_quantity(name, values):
            continue
        fault = _find_fault(name, values, may_lack=bool(swept), may_pull=may_pull)
        if fault:
            problem = f"{path} is damaged: it holds values of {name}, {fault}"
            raise InputError(problem, mend="Run the sweep again")


def _is_json_of(kind: type, text: Any) -> bool:
    """Whether ``text``, an attribute, is a JSON text of a value of the type ``kind``."""
    try:
        return isinstance(json.loads(text), kind)
    except (TypeError, ValueError, RecursionError):
        return False


def _is_quantity(name: str, values: Array) -> bool:
    """Whether the ``values`` of the variable ``name`` must be numbers of a known quantity."""
    if name in ("torsion", "direction") and values.dtype.kind in "OUT":
        return False  # "mindlin" is among the values of torsion; directions are named
    has_unit = name in CATALOGUE and bool(CATALOGUE[name].unit)
    return has_unit and values.dtype.kind != "b"  # truth values, as of "valid"


def _find_fault(name: str, values: Array, *, may_lack: bool, may_pull: bool) -> str:
    """Return words for the first of the ``values`` of the variable ``name`` that cannot be of a
    sweep, and for the bounds of the variable; an empty text if all values can be.

    Standard errors, waves and registered observables may be nan, and with ``may_lack`` velocities,
    moduli and pressures too; variables of :data:`_MAY_BE_INFINITE` may be +inf. With ``may_pull``
    the :data:`_COMPRESSIVE` variables may have any sign.
    """
    if values.dtype.kind not in "iuf":
        return "which are no numbers"
    entry = CATALOGUE[name]
    is_error = entry.sampled or name == "exponent_error"
    # standard errors, waves and registered observables are nan where they are not known
    kind_may_be_nan = is_error or entry.cost in WAVE_COSTS or CATALOGUE.is_added(name)
    sweep_may_lack = may_lack and (entry.cost == "velocities" or name == "pressure")
    is_bad = values == -np.inf if name in _MAY_BE_INFINITE else np.isinf(values)
    if not (kind_may_be_nan or sweep_may_lack):
        is_bad |= np.isnan(values)
    bounds = "finite, or inf" if name in _MAY_BE_INFINITE else "finite"
    if name in _ABOVE_ZERO or (name in _COMPRESSIVE and not may_pull):
        is_bad |= values <= 0.0
        bounds = "above zero"
    elif name in _ZERO_OR_ABOVE or is_error:
        is_bad |= values < 0.0
        bounds = "zero or above"
    top = ""
    if name in _VELOCITIES:
        is_bad |= values >= LIGHT_VELOCITY
        top = ", and below the velocity of light"
    if not np.any(is_bad):
        return ""
    return f"of which one is {values[is_bad].flat[0]:g}; allowed: {bounds}{top}"


def _explain_unreadable(path: str | os.PathLike[str], why: str) -> InputError:
    """Return the error of the file ``path``, which cannot be read for the reason ``why``, a
    sentence.
    """
    return InputError(f"{path} cannot be read", why, "Is this the right file?")


def _require_openable(path: str | os.PathLike[str], data: bytes) -> None:
    """Raise InputError if the ``data`` of the file ``path``, which has no digest, are not those of
    a netCDF-4 file, or cannot be opened.

    A separate process tries to open the data, for at most :data:`TRIAL_SECONDS`: on a damaged file
    HDF5 may hang, or crash.
    """
    if data.startswith(b"CDF") and b"granphon motion" in data:
        mend = f"Draw it in Python, gp.plot(gp.Motion.read({str(path)!r}))"
        raise InputError(f"{path} is not a sweep", "It is a motion", mend)
    if not data.startswith(b"\x89HDF\r\n\x1a\n"):
        raise _explain_unreadable(path, "It is not a netCDF-4 file")
    # -I isolates the process: files of the current folder, such as a sitecustomize.py, are not run
    # when Python starts. The process imports the granphon of this process, and searches the rest of
    # this process's path last.
    package_folder = Path(str(sys.modules["granphon"].__file__)).parent.parent
    folders = [str(package_folder), *(folder for folder in sys.path if folder)]
    try:
        trial = subprocess.run(
            [sys.executable, "-I", "-c", _TRIAL, *folders],
            input=data,
            capture_output=True,
            timeout=TRIAL_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        why = f"HDF5 has not opened it in {TRIAL_SECONDS:.0f} seconds: it is damaged"
        raise _explain_unreadable(path, why) from None
    except OSError as error:
        why = f"It carries no digest, and no process could be started to test it: {error}"
        raise _explain_unreadable(path, why) from None
    if trial.returncode != 0 or trial.stdout.strip() != b"good":
        lines = trial.stderr.decode("utf-8", "replace").strip().splitlines()
        # the code of a crash by a signal is negative
        has_raised = trial.returncode > 0 and bool(lines)
        reason = lines[-1] if has_raised else "it crashes"
        raise _explain_unreadable(path, f"HDF5 fails on it: {reason}")


# -- what a data set does by itself ----------------------------------------------------------------


class SweepAccessor:
    """The accessor ``dataset.granphon`` of a ``dataset``, as :func:`~granphon.sweep` or
    :func:`~granphon.load_sweep` returns it.
    """

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset

    @property
    def packing(self) -> Packing:
        """The packing that was swept; :class:`InputError` for a data set of other balls, a crystal
        or a packing in files, and for one that granphon has not made.
        """
        try:
            fields = json.loads(self._dataset.attrs["packing"])
            packing: Packing = restore(fields, Packing, "the attribute packing")
        except (KeyError, ValueError, TypeError, RecursionError):
            why = "It is of a crystal or of files, or was not made by granphon.sweep"
            raise InputError("the data set holds no packing", why) from None
        return packing

    def plot(self, **options: Any) -> Any:
        """Return the figure of the sweep, as :func:`~granphon.plot` draws it.

        ``options`` are the keywords of :func:`~granphon.figures.curves.sweep_figure`: ``x``,
        ``variable``, ``rows``, ``columns`` and ``tell``. With ``axes``, Axes of matplotlib on which
        the sweep is drawn, they are those of :func:`~granphon.figures.curves.plot_together`. Raises
        :class:`~granphon.base.errors.InputError` for other keywords.
        """
        import granphon

        return granphon.plot(self._dataset, **options)

    def exponent(self, name: str = "longitudinal", over: str | None = None) -> DataArray:
        """Return the local exponent of a variable over the load, d log(variable)/d log(load), in
        the shape of the variable.

        The exponent is the slope of a parabola through three points, on logarithmic scales, so that
        its error goes as the square of their distance. The points are those of a load and its two
        neighbours; at the first and the last load, those of the load and the two next to it. The
        exponent is nan where the variable is nan or infinite at one of the three. The variable
        ``exponent`` of a sweep has that of the velocities at each load alone.

        Parameters
        ----------
        name : the variable.
        over : another variable, as "pressure", in place of what the loads are given by.

        Raises
        ------
        InputError : a name that is not that of a variable of numbers with the dimension of loads;
            fewer than three loads, loads that do not ascend or are nan, loads or values that are
            not above zero; and ``over`` with a dimension that the variable does not have, such as
            the medium.
        """
        data = self._dataset
        over = find_load(data) if over is None else over
        for variable in (name, over):
            _require_over_loads(data, variable)
        if data.sizes["load"] < 3:
            raise InputError("an exponent needs three loads or more", mend="Sweep more loads")
        values = data[name]
        ordered = values.transpose("load", ...)
        further_dims = [str(dim) for dim in data[over].dims if dim not in values.dims]
        if further_dims:
            why = f"{over} also depends on {', '.join(further_dims)}, and {name} does not"
            raise InputError(f"{name} has no exponent over {over}", why)
        loads = data[over].broadcast_like(ordered).transpose(*ordered.dims)
        x = loads.values.astype(float)  # (n, ...)
        y = ordered.values.astype(float)  # (n, ...)
        y[np.isinf(y)] = np.nan
        is_positive = np.all(x > 0.0) and np.all(y[~np.isnan(y)] > 0.0)
        is_ascending = np.all(x[1:] > x[:-1])
        if not (is_positive and is_ascending):
            why = "Loads must ascend, and values be above zero"
            raise InputError(f"{name} has no exponent here", why)
        exponents = ordered.copy(data=_find_slopes(np.log(x), np.log(y)))
        exponents.attrs = {
            "units": "1",
            "long_name": f"local exponent of {values.attrs.get('long_name', name)}",
        }
        return exponents.transpose(*values.dims).rename(f"{name}_exponent")

    def fit(self, force: ArrayLike, velocity: ArrayLike, *more: Any, **options: Any) -> Any:
        """Fit the width of the packing to measured ``velocity``, m/s (n,), over ``force``, N (n,).

        ``more``, ``options`` and the result are those of :func:`~granphon.fit_width` for the
        packing of the data set: ``sigma``, ``frequency``, and the keywords after them. Raises what
        :func:`~granphon.fit_width` raises, and :class:`~granphon.base.errors.InputError` for a data
        set without a packing, see :attr:`packing`.
        """
        import granphon

        return granphon.fit_width(self.packing, force, velocity, *more, **options)


def _require_over_loads(dataset: Dataset, name: str) -> None:
    """Raise InputError unless a ``dataset`` has a variable ``name`` of numbers along its loads."""
    names = [
        str(variable)
        for variable, values in dataset.variables.items()
        if values.dtype.kind in "iuf" and "load" in values.dims
    ]
    if name not in names:
        problem = f"the data set has no numbers {name!r} over loads"
        mend = suggest(str(name), names) if names else "Give a data set of gp.sweep"
        raise InputError(problem, mend=mend)


def _find_slopes(x: Array, y: Array) -> Array:
    """Return the slopes dy/dx (n, ...) of values ``y`` over ``x``, both (n, ...), along the first
    axis: at each point that of the parabola through the point and its neighbours, at an end the two
    points next to it. A slope is nan where one of the three values is.
    """
    columns = zip(x.reshape(len(x), -1).T, y.reshape(len(y), -1).T, strict=True)
    slopes = [np.gradient(y_column, x_column, edge_order=2) for x_column, y_column in columns]
    # the slope amid equal steps is found without the value in the middle
    return np.where(np.isnan(y), np.nan, np.transpose(slopes).reshape(y.shape))


def register_accessor() -> None:
    """Give all data sets of xarray the accessor ``granphon``, a :class:`SweepAccessor`, unless they
    have it.
    """
    import xarray

    if getattr(xarray.Dataset, "granphon", None) is not SweepAccessor:
        register: Any = xarray.register_dataset_accessor
        register("granphon")(SweepAccessor)
