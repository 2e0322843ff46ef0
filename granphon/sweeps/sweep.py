"""Many states at once: loads, media and parameters of the packing, as one labelled data set.

The work is cut into tasks (:mod:`granphon.sweeps.jobs`), and the results are put in place by index. With a path each
finished task is kept beside the result until that is written, so that an interrupted sweep goes on from what it has.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import Lattice, as_direction, find_lattice
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.balls.parameters import PARAMETERS, Axis, find_double
from granphon.base.errors import InputError, InstabilityError, MechanismError, message
from granphon.base.progress import Progress, silent
from granphon.base.quantities import LOADS
from granphon.base.staging import ResultFiles
from granphon.base.text import versions
from granphon.base.validation import require, truth
from granphon.base.written_files import is_written, read_written_files
from granphon.dynamics.long_waves import voigt_names
from granphon.dynamics.modes import ContactLattice
from granphon.media.cases import Case, Grid, label_warnings
from granphon.media.choice import MediumChoice, no_simulation
from granphon.observables.catalogue import CATALOGUE, entry_of
from granphon.phonons.paths import interpolate_path, special_points
from granphon.sweeps.archive import FORMAT, SWEEP_SCHEMA, file_names, load_sweep, write_sweep
from granphon.sweeps.jobs import Work, packages, tell_warnings, to_json
from granphon.sweeps.tasks import Store, TaskResult, open_store, solve_all

if TYPE_CHECKING:
    from xarray import Dataset

__all__ = ["sweep", "sweep_grid"]

Array = NDArray[Any]
#: direction of the waves on a line, in the plane and in space, as files tell it
_FIRST_AXES = ("(1)", "(1, 0)", "(1, 0, 0)")
#: a prestress f/(k a) so small that a lattice which buckles under it does so under any
_LEAST_PUSH = 1e-30


# -- the sweep ------------------------------------------------------------------------------------------------------


def sweep(
    packing: Packing,
    *,
    force: ArrayLike | None = None,
    pressure: ArrayLike | None = None,
    overlap: ArrayLike | None = None,
    media: Any = ("ala",),
    finite_overlap: bool = False,
    direction: ArrayLike | None = None,
    bands: str | ArrayLike | Sequence[ArrayLike] | None = None,
    npoints: int = 101,
    labels: Sequence[str] | None = None,
    executor: Executor | None = None,
    progress: Progress = silent,
    path: str | os.PathLike[str] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    store: Store | None = None,
    **parameters: Any,
) -> Dataset:
    """States, velocities and moduli over loads, media and parameters of the packing.

    Parameters
    ----------
    packing : the packing whose parameters are varied; those that are not swept keep its values.
    force, pressure, overlap : the loads; one of the three, a number or a list of any order. A force is in N, an overlap in
        m, a pressure in N on a line, N/m in the plane and Pa in space.
    media : "ala", "afa", "ema", "simulation", "auto", mappings with options such as {"ema": {"local_field": "paper"}},
        {"simulation": {"shape": (64, 64), "seed": 0, "samples": 4}} or {"auto": {"tolerance": 1e-3}}, or a list of these,
        each once.
    finite_overlap : keep the terms of relative order delta/d. The exponent, which is of the paper's limit, is then left out.
    direction : Cartesian direction of sound, (p,) for lattices of p periods, or (n, p) for many; by default x. Many make one
        more dimension of the velocities, ``direction``.
    bands : a path as :meth:`granphon.phonons.phonons.Phonons.bands` takes it; the frequencies along it are added to the
        data set.
    npoints : number of points on each segment of that path.
    labels : names of the corners of that path; by default the letters, or the coordinates.
    executor : any executor with the interface of :class:`concurrent.futures.Executor`, for work side by side; the numbers
        do not depend on it.
    progress : is told how many steps are done. A step is a medium at one combination of parameters, or one sample of a
        simulation at one load.
    path : "out/sweep.nc", written whole or not at all, with the table "out/sweep.csv" beside it. Finished tasks are kept
        beside it until then: the same sweep to the same path continues from them, and gives the same numbers as an
        uninterrupted one.
    resume : if the sweep in ``path`` is complete, return it, and compute and write nothing.
    overwrite : replace existing files, and discard the finished tasks of another sweep to ``path``.
    store : where finished tasks are kept, instead of beside ``path``. Results that it holds are used; the caller clears it.
    **parameters : values of any of :data:`~granphon.balls.parameters.PARAMETERS`. A ``width`` (W, m) scales the spread
        and keeps its shape, which is uniform if the packing has no spread; a ``diameter`` leaves the spread as it is.
        Lattices must have the same number of periods.

    Returns
    -------
    Dataset of dimensions load, medium, then the parameters in the order given, with ``units`` and ``long_name`` of each
    variable: the state's attributes, ``valid``, ``regime``, ``longitudinal`` and ``transverse`` (m/s, along the direction;
    in space and on a chain that moves across itself ``transverse_slow`` and ``transverse_fast``), ``bulk``
    and ``shear`` (Pa; N on a line; the ``tensor`` in Voigt order if a lattice is not isotropic), ``exponent`` and its
    standard error over samples ``exponent_error``, zero for media that sample nothing and nan for one
    sample; if a simulation has several samples, ``longitudinal_error``, ``transverse_error``, ``bulk_error``,
    ``shear_error``, ``tensor_error``, zero for other media and nan for one sample; of square and cubic lattices the
    ``anisotropy``; if all media are simulations, ``contact_force_fluctuation``;
    if one is "auto", the ``choice`` at each load, and its ``expected_error`` (+inf where it is not known);
    velocities and moduli that balls with some of the swept motions do not have are nan there, and the warnings say which;
    and with bands ``frequencies`` (..., segment, point, branch) in Hz. Loads are a coordinate under their own name.
    ``attrs`` holds versions, packing, media and the warnings of validity, as JSON.

    Raises
    ------
    InputError : no load or several kinds, an unknown medium or parameter, a medium twice, a value that makes no packing,
        bands over parameters that change the number of branches, a simulation with finite overlap, lattices of different
        dimension.
    MechanismError : a lattice is a mechanism; raised before anything is computed. With bands, velocities and moduli are left
        out instead, with a warning.
    InstabilityError : with finite overlap, a lattice buckles.
    FileExistsInRunError : the files exist, or finished tasks of another sweep or version do, and ``overwrite`` is off;
        raised before anything is computed.
    OutputError : the files cannot be written; raised before anything is computed if that can be known by then.
    GranphonError : a medium has no solution. The message names medium, parameters and load, and ``load_index`` is the index
        of that load. No result is written then.
    """
    load = Load.only(force=force, pressure=pressure, overlap=overlap)
    axes = [Axis.of(name, given) for name, given in parameters.items()]
    # all lattices of a sweep have the same number of periods
    lattice = find_lattice(next((axis.values[0] for axis in axes if axis.name == "lattice"), packing.structure))
    choices = _parse_media(media, lattice)
    if require("finite_overlap", truth, finite_overlap):
        no_simulation(choices)
    along = _parse_direction(lattice, direction)
    return sweep_grid(
        Grid(packing, axes, choices, load, finite_overlap, along), bands=bands, npoints=npoints, labels=labels,
        executor=executor, progress=progress, path=path, resume=resume, overwrite=overwrite, store=store,
    )  # fmt: skip


def sweep_grid(
    grid: Grid,
    *,
    bands: str | ArrayLike | Sequence[ArrayLike] | None = None,
    npoints: int = 101,
    labels: Sequence[str] | None = None,
    executor: Executor | None = None,
    progress: Progress = silent,
    path: str | os.PathLike[str] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    store: Store | None = None,
) -> Dataset:
    """Carry out :func:`sweep` for the cases of a grid; what is known of them, such as a choice of media, is not found again.

    Arguments, the data set and errors are those of :func:`sweep`. The load is an applied one, of at most one dimension.
    """
    cases = grid.cases
    way = None if bands is None else _Way.of([case.packing for case in cases], bands, npoints, labels)
    frame = _make_frame(grid, way)
    if way is None:  # bands are those of a mechanism too
        _require_sound(cases)
    target = _choose_target(path, resume)
    if target is not None and resume and not overwrite and (there := _load_complete(target, frame)) is not None:
        return there
    qpoints = None if way is None else way.qpoints
    works = [Work(case, qpoints, grid.direction, grid.pulse) for case in cases]
    pieces = [work.pieces for work in works]
    folder = nullcontext() if target is None else ResultFiles(target.parent, file_names(target), overwrite).open()
    own = open_store(None if target is None else target.with_name(f".{target.name}.partial"), overwrite)
    with folder as locked, own if store is None else nullcontext(store) as place:
        place.claim(_collect_identity(frame), lambda: [piece.name for several in pieces for piece in several])
        found = solve_all("sweep", [piece for several in pieces for piece in several], executor, progress, place)
        ends = accumulate(map(len, pieces), initial=0)
        parts = [work.join(found[first:last]) for work, (first, last) in zip(works, pairwise(ends), strict=True)]
        dataset = _fill(frame, grid, works, parts)
        if locked is not None and target is not None:
            with locked.staging() as stage:
                write_sweep(dataset, stage / target.name)
    return dataset


def _parse_media(given: Any, lattice: Lattice) -> list[MediumChoice]:
    """Parse the media; :class:`InputError` if there is none, or one is given twice, or has options of another lattice."""
    choices = [MediumChoice.parse(one, lattice) for one in (given if isinstance(given, list | tuple) else [given])]
    if not choices:
        raise InputError(message("there is no medium to sweep over", mend="Give at least one, such as 'ala'"))
    double = [choice.label for choice in choices if choices.count(choice) > 1]
    if double:
        raise InputError(message(f"the medium {double[0]!r} is given twice", mend="Give each once"))
    return choices


def _parse_direction(lattice: Lattice, direction: ArrayLike | None) -> tuple[Any, ...] | None:
    """Return one direction as its numbers, or many as a tuple of these; :class:`InputError` if the lattice has none such."""
    if direction is None:
        return None
    along = as_direction(direction, lattice.periods)
    numbers = np.asarray(direction, float).tolist()
    if along.ndim == 1:
        return tuple(numbers)
    if (double := find_double(along.tolist())) is not None:
        what = f"the sweep has the direction {tuple(numbers[double])} twice"
        raise InputError(message(what, mend="Give each direction once"))
    return tuple(map(tuple, numbers))


@dataclass(frozen=True, eq=False)
class _Way:
    """The path of the bands, s segments of p points.

    ``qpoints`` (s, p, 3) are fractions of the reciprocal cell, ``distances`` (s, p) lengths along the path in the paper's
    limit, in units of 1/d without 2 pi, and ``labels`` (s + 1,) the names of the corners.
    """

    qpoints: Array
    distances: Array
    labels: tuple[str, ...]

    @classmethod
    def of(cls, packings: Sequence[Packing], bands: Any, npoints: int, labels: Sequence[str] | None) -> _Way:
        """Lay the path that all packings share; :class:`InputError` if there is no such path."""
        first = packings[0]
        if len({(one.structure, one.ball_motions) for one in packings}) > 1:
            raise InputError(
                message(
                    "bands cannot be swept over friction, motions or lattices",
                    "The number of branches, or the Brillouin zone, differs, so that they do not fit into one array",
                    "Make a sweep of each",
                )
            )
        vectors, p = first.structure.vectors, first.structure.periods
        letters = special_points(vectors) if isinstance(bands, str) else {}
        qpoints, ticks = interpolate_path(bands, npoints, letters, labels, p)
        cartesian = qpoints[..., :p] @ np.linalg.inv(vectors[:, :p]).T
        # no step leads to the first point of a segment, so that segments that do not join are drawn side by side
        steps = np.linalg.norm(np.diff(cartesian, axis=1, prepend=cartesian[:, :1]), axis=2)
        return cls(qpoints, np.cumsum(steps).reshape(steps.shape), ticks)


def _require_sound(cases: Sequence[Case]) -> None:
    """Raise if a lattice has no sound, before anything is computed: a mechanism, or one that buckles under any load.

    Of the stiffnesses of contacts it matters only which of them there are.
    """
    known: set[tuple[Any, ...]] = set()
    for case in cases:
        packing = case.packing
        present = tuple(float(bool(one)) for one in (packing.mindlin_ratio, packing.torsion, packing.bending))
        kind = (packing.structure, present, packing.ball_motions, case.finite_overlap)
        if kind in known:
            continue
        known.add(kind)
        eta, torsion, bending = present
        lattice = ContactLattice.of(packing.structure, eta, torsion=torsion, bending=bending, motions=packing.ball_motions)
        try:
            lattice.sound_velocities(np.eye(lattice.periods), _LEAST_PUSH if case.finite_overlap else None)
        except (MechanismError, InstabilityError) as error:
            raise type(error)(f"{case.label}: {error}") from None


def _choose_target(path: str | os.PathLike[str] | None, resume: bool) -> Path | None:
    if path is None:
        if resume:
            raise InputError(
                message(
                    "a sweep without a path cannot be resumed", "Its finished parts are kept beside its file", "Give path"
                )
            )
        return None
    target = Path(path)
    if target.suffix != ".nc":
        raise InputError(message(f"{target} does not end in .nc", "It is a netCDF file, with a .csv beside it"))
    return target


def _load_complete(target: Path, frame: Dataset) -> Dataset | None:
    """Return the sweep in ``target`` if it is complete and is the one that ``frame`` describes; otherwise None."""
    written = read_written_files(target.parent)
    if not all(name in written and is_written(target.with_name(name), written[name]) for name in file_names(target)):
        return None
    there = load_sweep(target)
    return there if _collect_identity(there) == json.loads(to_json(_collect_identity(frame))) else None


# -- the data set ---------------------------------------------------------------------------------------------------


def _make_frame(grid: Grid, way: _Way | None) -> Dataset:
    """Return the data set before anything is computed: coordinates, the path of the bands, and the inputs as attributes."""
    from xarray import Dataset

    load, finite, packing = grid.load, grid.finite_overlap, grid.cases[0].packing
    loads = ("load", load.array, _list_attributes(load.kind, load.array, packing))
    coordinates: dict[str, Any] = {load.kind: loads, "medium": [choice.label for choice in grid.media]}
    for axis in grid.axes:
        # a label does not describe a spread or a lattice completely
        whole = {"values": to_json(axis.values)} if axis.name in ("spread", "lattice") else {}
        labels = np.array(axis.labels)
        coordinates[axis.name] = (axis.name, labels, _list_attributes(axis.name, labels, packing) | whole)
    along = f"{_FIRST_AXES[packing.structure.periods - 1]}, Cartesian, where velocities depend on it"
    if (given := grid.direction) is not None:
        many = isinstance(given[0], tuple)
        names = np.array(_name_directions(given if many else (given,)))
        along = f"{', '.join(names.tolist())}, Cartesian"
        about = {"long_name": "direction of propagation, Cartesian", "values": to_json(given)}
        coordinates["direction"] = ("direction", names, about) if many else ((), names[0], about)
    attrs = {
        "format": FORMAT, "schema": SWEEP_SCHEMA, "versions": to_json({**packages(), **versions("xarray", "h5netcdf")}),
        "media": to_json([{one.name: one.settings_on(packing.structure)} for one in grid.media]),
        "finite_overlap": int(finite), "direction": along,
    }  # fmt: skip
    attrs |= {} if grid.pulse is None else {"pulse": to_json(grid.pulse)}
    if finite:
        attrs["exponent"] = "left out: it is defined in the limit of small overlap"
    variables = {} if way is None else _list_path_variables(way, finite)
    return Dataset(variables, coordinates, attrs | {"packing": to_json(grid.packing)})


def _collect_identity(frame: Dataset) -> dict[str, Any]:
    """Return all that determines the numbers, as plain data; a frame and the sweep read from its file give the same."""
    made, path = json.loads(frame.attrs["versions"]), [name for name in ("labels", "qpoints") if name in frame]
    out = {name: json.loads(frame.attrs[name]) for name in ("packing", "media", "pulse") if name in frame.attrs}
    out |= {"finite_overlap": bool(frame.attrs["finite_overlap"]), "versions": {name: made[name] for name in packages()}}
    for name in [name for name in frame.coords if name in LOADS or name in PARAMETERS or name == "direction"] + path:
        whole = frame[name].attrs.get("values")
        out[str(name)] = frame[name].values.tolist() if whole is None else json.loads(whole)
    return out


def _fill(frame: Dataset, grid: Grid, works: Sequence[Work], parts: Sequence[TaskResult]) -> Dataset:
    """Return the frame with the results of the cases, ``parts``, filled in."""
    load, axes = grid.load, grid.axes
    dims, counts = ("load", "medium", *(axis.name for axis in axes)), [len(axis.values) for axis in axes]
    along = ("direction",) * ("direction" in frame.dims)
    voigt = list(voigt_names(grid.cases[0].packing.structure.periods))
    many = tuple(frame.sizes[name] for name in along)
    sizes = {
        name: (many if one.per_direction else ()) + (len(voigt),) * len(one.dims)
        for name, one in CATALOGUE.items()
        if one.sampled and any(name in part for part in parts)
    }
    parts = [_fill_errors(work, part, sizes) for work, part in zip(works, parts, strict=True)]
    labels = [case.label for case in grid.cases]
    told = [(label, text) for label, part in zip(labels, parts, strict=True) for text in tell_warnings(part)]
    parts, missing = _fill_gaps(parts, grid.cases[0].packing.structure.periods)
    warnings = label_warnings([*told, *((label, text) for label, text in zip(labels, missing, strict=True) if text)])
    if any(medium.is_automatic for medium in grid.media):
        parts = [part | work.choices() for work, part in zip(works, parts, strict=True)]
    # keep the variables that every case has
    names = [name for name in parts[0] if name not in (load.kind, "warnings") and all(name in part for part in parts)]
    packing = grid.cases[0].packing
    variables: dict[str, Any] = {}
    for name in names:
        stack = np.array([part[name] for part in parts])
        stack = stack.reshape(*counts, frame.sizes["medium"], load.size, *stack.shape[2:])
        stack = np.moveaxis(stack, (len(axes) + 1, len(axes)), (0, 1))
        entry = CATALOGUE[name]
        variables[name] = (
            (*dims, *(along if entry.per_direction else ()), *entry.dims),
            stack,
            _list_attributes(name, stack, packing),
        )
    if "tensor" in names:
        frame = frame.assign_coords(dict.fromkeys(CATALOGUE["tensor"].dims, voigt))
    path = dict(frame.data_vars)  # assigned last, to stand after the variables along it
    return frame.drop_vars(list(path)).assign(variables).assign(path).assign_attrs(warnings=to_json(warnings))


def _fill_errors(work: Work, part: TaskResult, sizes: Mapping[str, tuple[int, ...]]) -> TaskResult:
    """Return a result with the standard errors in ``sizes``, each with its shape at one load, that it lacks.

    They are zero for a medium that samples nothing, and nan, not known, for a single sample.
    """
    error = np.zeros(work.case.load.size)
    for rung in work.case.rungs:
        error[rung.loads] = np.nan if rung.medium.simulates and rung.packing.width else 0.0
    each = {name: np.moveaxis(np.broadcast_to(error, (*shape, error.size)), -1, 0) for name, shape in sizes.items()}
    return part | {name: one for name, one in each.items() if name not in part}


def _fill_gaps(parts: Sequence[TaskResult], periods: int) -> tuple[list[TaskResult], list[str]]:
    """Return results in which velocities, moduli and pressures that only some of them have are nan in the others.

    For each result, a sentence says which are nan and why; it is empty if none is, and for a mechanism, which has its own
    warning. Bulk and shear moduli and the anisotropy are left out if one of the lattices has a tensor without them. If no
    modulus is left out the tensor is. The standard error of what is left out is left out with it.
    """
    known = {
        name: value for part in reversed(parts) for name, value in part.items() if _is_of_sound(name) or name == "pressure"
    }
    left_out = {
        name for name in ("bulk", "shear", "anisotropy") if any("tensor" in part and name not in part for part in parts)
    }
    if "bulk" in known and left_out - {"anisotropy"} <= ({"shear"} if periods == 1 else set()):
        left_out.add("tensor")
    left_out |= {f"{name}_error" for name in left_out}
    filled, missing = list[TaskResult](), list[str]()
    for part in parts:
        nans = {name: np.full_like(one, np.nan) for name, one in known.items() if name not in part and name not in left_out}
        filled.append({name: one for name, one in part.items() if name not in left_out} | nans)
        told = ["pressure is nan, as the stress of the lattice is not one"] * (nans.pop("pressure", None) is not None)
        if nans and any(map(_is_of_sound, part)):
            are, waves = ("is", "wave") if len(nans) == 1 else ("are", "waves")
            told.append(f"{', '.join(nans)} {are} nan, as balls with these motions have no such {waves}")
        missing.append("; ".join(told))
    return filled, missing


def _is_of_sound(name: str) -> bool:
    """Whether a quantity is a velocity or a modulus."""
    return name in CATALOGUE and CATALOGUE[name].cost == "velocities"


def _name_directions(given: Sequence[Sequence[float]]) -> list[str]:
    """Return directions in words, such as "(1, 1, 0)", with as many digits as tell them apart."""
    short = [f"({', '.join(f'{x:g}' for x in numbers)})" for numbers in given]
    return short if len(set(short)) == len(short) else [f"({', '.join(map(repr, numbers))})" for numbers in given]


def _list_attributes(name: str, values: Array, packing: Packing) -> dict[str, str]:
    """Return the attributes of a variable of a packing: its meaning, and the unit of its numbers."""
    entry = entry_of(name, packing)
    return {"long_name": entry.title} | ({"units": entry.unit} if entry.unit and values.dtype.kind in "iuf" else {})


def _list_path_variables(way: _Way, finite_overlap: bool) -> dict[str, Any]:
    # put in words: programs that parse units read "1/d" as once a day, and the spacing a differs from load to load
    unit = "1/a" if finite_overlap else "1/d"
    return {
        "qpoints": (
            ("segment", "point", "fraction"), way.qpoints, {"long_name": "fractions of the reciprocal cell", "units": "1"},
        ),
        "distances": (
            ("segment", "point"), way.distances,
            {"long_name": f"distance along the path in units of {unit}, without 2 pi", "units": "1"},
        ),
        "labels": ("corner", np.array(way.labels), {"long_name": "corners of the path"}),
    }  # fmt: skip
