"""The data set of a sweep: its frame, which says what is computed, and the results of the cases put in their places."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.packing import Packing
from granphon.balls.parameters import PARAMETERS
from granphon.base.errors import InputError, message
from granphon.base.quantities import LOADS
from granphon.base.text import versions
from granphon.dynamics.long_waves import voigt_names
from granphon.media.left_out import EXACT, LATTICE
from granphon.observables.catalogue import CATALOGUE, entry_of
from granphon.phonons.paths import interpolate_path, special_points
from granphon.runs.archive import FORMAT, SWEEP_SCHEMA
from granphon.runs.cases import Grid, label_warnings
from granphon.runs.store import TaskResult
from granphon.runs.tasks import CaseTasks, tell_warnings, to_json
from granphon.runs.workers import packages

if TYPE_CHECKING:
    from xarray import Dataset as Dataset


Array = NDArray[Any]
#: direction of the waves on a line, in the plane and in space, as files tell it
_FIRST_AXES = ("(1)", "(1, 0)", "(1, 0, 0)")
#: costs of the observables of the waves in simulated arrays
_OF_WAVES = ("pulse", "spectrum", "dos")


def make_frame(grid: Grid, bands: Any = None, npoints: int = 101, corners: Sequence[str] | None = None) -> Dataset:
    """Return the data set before anything is computed: coordinates, the path of the bands, and the inputs as attributes.

    The path, which all packings share, has s segments of p points, and labels of its ``corners``. In the data set
    ``qpoints`` (s, p, 3) are fractions of the reciprocal cell, ``distances`` (s, p) lengths along the path in the paper's
    limit, in units of 1/d without 2 pi, and ``labels`` (s + 1,) the names of the corners.
    :class:`~granphon.base.errors.InputError` if there is no such path.
    """
    from xarray import Dataset

    load, packing, asked = grid.load, grid.cases[0].packing, grid.asked
    finite = [one.has_finite_overlap(asked.finite_overlap) for one in grid.media]
    variables: dict[str, Any] = {}
    if bands is not None:
        if len({(case.packing.structure, case.packing.ball_motions) for case in grid.cases}) > 1:
            why = "The number of branches, or the Brillouin zone, differs, so that they do not fit into one array"
            what = "bands cannot be swept over friction, motions or lattices"
            raise InputError(message(what, why, "Make a sweep of each"))
        vectors, p = packing.structure.vectors, packing.structure.periods
        letters = special_points(vectors) if isinstance(bands, str) else {}
        qpoints, ticks = interpolate_path(bands, npoints, letters, corners, p)
        cartesian = qpoints[..., :p] @ np.linalg.inv(vectors[:, :p]).T
        # no step leads to the first point of a segment, so that segments that do not join are drawn side by side
        steps = np.linalg.norm(np.diff(cartesian, axis=1, prepend=cartesian[:, :1]), axis=2)
        # put in words: programs that parse units read "1/d" as once a day, and the spacing a differs from load to load
        unit = "1/a" if all(finite) else "1/d" + ", or 1/a of media with finite overlap" * any(finite)
        about = {"long_name": f"distance along the path in units of {unit}, without 2 pi", "units": "1"}
        fractions = {"long_name": "fractions of the reciprocal cell", "units": "1"}
        variables["qpoints"] = (("segment", "point", "fraction"), qpoints, fractions)
        variables["distances"] = (("segment", "point"), np.cumsum(steps).reshape(steps.shape), about)
        variables["labels"] = ("corner", np.array(ticks), {"long_name": "corners of the path"})
    loads = ("load", load.array, _list_attributes(load.kind, load.array, packing))
    coordinates: dict[str, Any] = {load.kind: loads, "medium": [choice.label for choice in grid.media]}
    for axis in grid.axes:
        # a label does not describe a spread or a lattice completely
        whole = {"values": to_json(axis.values)} if axis.name in ("spread", "lattice") else {}
        labels = np.array(axis.labels)
        coordinates[axis.name] = (axis.name, labels, _list_attributes(axis.name, labels, packing) | whole)
    along = f"{_FIRST_AXES[packing.structure.periods - 1]}, Cartesian, where velocities depend on it"
    if (given := asked.direction) is not None:
        many = isinstance(given[0], tuple)
        each: Any = given if many else (given,)
        short = [f"({', '.join(f'{x:g}' for x in numbers)})" for numbers in each]  # with as many digits as tell them apart
        exact = [f"({', '.join(map(repr, numbers))})" for numbers in each]
        names = np.array(short if len(set(short)) == len(short) else exact)
        along = f"{', '.join(names.tolist())}, Cartesian"
        about = {"long_name": "direction of propagation, Cartesian", "values": to_json(given)}
        coordinates["direction"] = ("direction", names, about) if many else ((), names[0], about)
    attrs = {
        "format": FORMAT, "schema": SWEEP_SCHEMA, "versions": to_json({**packages(), **versions("xarray", "h5netcdf")}),
        "media": to_json([{one.name: one.settings_on(packing.structure)} for one in grid.media]),
        "finite_overlap": int(all(finite)), "direction": along,
    }  # fmt: skip
    if (waves := asked.waves) is not None:
        attrs["waves"] = to_json({"of": waves, "exponents": asked.exponents})
        if waves.spectrum is not None:
            from granphon.waves.path_spectra import join_labels  # imported here: other sweeps do not need it

            coordinates["polarisation"] = list(waves.spectrum.polarisation)
            labels = np.array(join_labels(waves.path, waves.labels))
            about = {"long_name": "corners of the path of the spectra"}
            variables["labels_of_path"] = ("corner_of_path", labels, about)
    if asked.finite_overlap and not all(one.is_exact for one in grid.media):
        attrs["exponent"] = "left out: it is defined in the limit of small overlap"
    return Dataset(variables, coordinates, attrs | {"packing": to_json(grid.packing)})


def tabulate(
    packing: Packing, medium: str, force: Array, values: Mapping[str, Array], attributes: Mapping[str, Any]
) -> Dataset:
    """Return numbers of states of one medium over the contact force, each (n,), as a data set like that of a sweep."""
    from xarray import Dataset

    variables: dict[str, Any] = {
        name: (("load", "medium"), array[:, None], _list_attributes(name, array, packing)) for name, array in values.items()
    }
    variables["valid"] = (("load", "medium"), np.ones((force.size, 1), bool))
    loads = ("load", force, _list_attributes("force", force, packing))
    return Dataset(variables, {"force": loads, "medium": [medium]}, {**attributes, "packing": to_json(packing)})


def find_dataset(result: Any) -> Dataset | None:
    """Return the data set of states that a result is, or has as its ``dataset``; None if there is none."""
    found = getattr(result, "dataset", result)
    return found if hasattr(found, "data_vars") and "valid" in found else None


def list_finite_overlap(dataset: Dataset) -> list[bool]:
    """Return for each medium of a sweep whether its states have finite overlap; False where a data set does not tell."""
    everywhere, labels = bool(dataset.attrs.get("finite_overlap", 0)), np.atleast_1d(dataset["medium"].values).astype(str)
    # a simulation has finite overlap in its exact geometry, which one with a history takes by default
    return [
        everywhere
        or f"geometry={EXACT}" in label
        or ("friction_history=true" in label and f"geometry={LATTICE}" not in label)
        for label in labels.tolist()
    ]


def collect_identity(frame: Dataset) -> dict[str, Any]:
    """Return all that determines the numbers, as plain data; a frame and the sweep read from its file give the same."""
    made, path = json.loads(frame.attrs["versions"]), [name for name in ("labels", "qpoints") if name in frame]
    out = {name: json.loads(frame.attrs[name]) for name in ("packing", "media", "waves") if name in frame.attrs}
    out |= {"finite_overlap": bool(frame.attrs["finite_overlap"]), "versions": {name: made[name] for name in packages()}}
    for name in [name for name in frame.coords if name in LOADS or name in PARAMETERS or name == "direction"] + path:
        whole = frame[name].attrs.get("values")
        out[str(name)] = frame[name].values.tolist() if whole is None else json.loads(whole)
    return out


def fill(frame: Dataset, grid: Grid, cases: Sequence[CaseTasks], parts: list[TaskResult]) -> Dataset:
    """Return the frame with the results of the cases, ``parts``, filled in."""
    load, axes = grid.load, grid.axes
    dims, counts = ("load", "medium", *(axis.name for axis in axes)), [len(axis.values) for axis in axes]
    along = ("direction",) * ("direction" in frame.dims)
    voigt = list(voigt_names(grid.cases[0].packing.structure.periods))
    sizes = {name: part[name].shape[1:] for part in parts for name in part if name in CATALOGUE and CATALOGUE[name].sampled}
    for number, case in enumerate(cases):
        # standard errors that a result lacks are zero for a medium that samples nothing, and nan, not known, for one sample
        error = np.zeros(load.size)
        for serving in case.case.serving_media:
            error[serving.loads] = np.nan if serving.arrays and serving.packing.width else 0.0
        lacking = {name: shape for name, shape in sizes.items() if name not in parts[number]}
        parts[number] |= {
            name: np.moveaxis(np.broadcast_to(error, (*shape, load.size)), -1, 0) for name, shape in lacking.items()
        }
    labels = [case.label for case in grid.cases]
    told = [(label, text) for label, part in zip(labels, parts, strict=True) for text in tell_warnings(part)]
    parts, missing = _fill_gaps(parts, grid.cases[0].packing.structure.periods)
    told += [(label, text) for label, text in zip(labels, missing, strict=True) if text]
    # a single state needs no name
    warnings = list(dict.fromkeys(text for _, text in told)) if grid.asked.alone else label_warnings(told)
    if any(serving.chosen_automatically for one in cases for serving in one.case.serving_media):
        for number, one in enumerate(cases):  # the medium that serves each load, and its error, +inf where that is not known
            choice, error = np.empty(load.size, object), np.empty(load.size)
            for serving in one.case.serving_media:
                choice[serving.loads], error[serving.loads] = serving.medium.label, serving.errors
            parts[number] |= {"choice": choice.astype(str), "expected_error": error}
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
    along_path = dict(frame.data_vars)  # assigned last, to stand after the variables along it
    return frame.drop_vars(list(along_path)).assign(variables).assign(along_path).assign_attrs(warnings=to_json(warnings))


def _fill_gaps(parts: Sequence[TaskResult], periods: int) -> tuple[list[TaskResult], list[str]]:
    """Return results in which velocities, moduli, pressures and waves that only some of them have are nan in the others.

    For each result, a sentence says which are nan and why; it is empty if none is, and for a mechanism, which has its own
    warning. Bulk and shear moduli and the anisotropy are left out if one of the lattices has a tensor without them. If no
    modulus is left out the tensor is. The standard error of what is left out is left out with it.
    """
    known = {
        name: value
        for part in reversed(parts)
        for name, value in part.items()
        if name == "pressure" or (name in CATALOGUE and CATALOGUE[name].cost in ("velocities", *_OF_WAVES))
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
        lacking = [name for name in nans if _is_of_sound(name)]  # of waves in arrays a case has its own notes
        if lacking and any(map(_is_of_sound, part)):
            are, waves = ("is", "wave") if len(lacking) == 1 else ("are", "waves")
            told.append(f"{', '.join(lacking)} {are} nan, as balls with these motions have no such {waves}")
        missing.append("; ".join(told))
    return filled, missing


def _is_of_sound(name: str) -> bool:
    """Whether a quantity is a velocity or a modulus."""
    return name in CATALOGUE and CATALOGUE[name].cost == "velocities"


def _list_attributes(name: str, values: Array, packing: Packing) -> dict[str, str]:
    """Return the attributes of a variable of a packing: its meaning, and the unit of its numbers."""
    entry = entry_of(name, packing)
    return {"long_name": entry.title} | ({"units": entry.unit} if entry.unit and values.dtype.kind in "iuf" else {})
