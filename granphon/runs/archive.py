"""Write a sweep to files, netCDF for programs and a table for spreadsheets, and read the netCDF file back."""

from __future__ import annotations

import hashlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.base.errors import InputError, message
from granphon.base.quantities import LIGHT_VELOCITY, LOADS
from granphon.base.tables import Heading, write_table
from granphon.base.text import damage_error, digest, read_bytes, require_schema, show, warn_unverified
from granphon.observables.catalogue import CATALOGUE

if TYPE_CHECKING:
    from xarray import Dataset


#: attribute "format" of the netCDF file, by which a sweep is recognised
FORMAT = "granphon sweep"
#: version of the format, attribute "schema"; files of another one are refused
SWEEP_SCHEMA = 1
#: name of the attribute with the sha256 digest of the numbers
DIGEST = "granphon_sha256"
#: attributes in which other programs log what they did; the digest leaves them out, as they change no number
_HISTORY = ("history", "NCO")
#: size of the largest file that is read, and of the largest data set in one, bytes: a sweep may hold many bands
MAX_SWEEP = 2_000_000_000
#: longest time that opening a file without a digest may take, s
TRIAL_SECONDS = 120.0
#: program of the process that tries to open a file without a digest, see _try_elsewhere
_TRIAL = """
import sys
sys.path.insert(0, sys.argv[1])
import granphon
sys.path[:1] = []
sys.path.extend(sys.argv[2:])
from granphon.runs.archive import open_bytes
open_bytes(sys.stdin.buffer.read())
print("good")
"""
#: text behind the data of a file; the sha256 digest of all bytes before this text follows, in hexadecimal digits
_TRAILER = b"\ngranphon sha256 of all bytes before: "
#: length of that text with its digest, bytes
_TRAILER_BYTES = len(_TRAILER) + 64
#: variables without which a sweep is damaged
_REQUIRED = {"force", "overlap", "valid", "medium"}
#: variables above zero, and those that may also be zero; all are finite, but for the next two
_ABOVE_ZERO = {
    "force", "pressure", "normal_stiffness", "effective_density", "stiffness_ratio", "longitudinal", "bulk", "shear",
    "young_modulus", "density", "diameter",
}  # fmt: skip
_ZERO_OR_ABOVE = {
    "shear_stiffness", "reduced_force", "force_fluctuation", "contact_fraction", "contact_force_fluctuation", "width",
    "expected_error", "frequencies", "line_frequency", "line_width", "mean_free_path", "attenuation", "dos_total",
    "transverse", "transverse_slow", "transverse_fast", "twist", "torsion", "bending",
}  # fmt: skip
_VELOCITIES = {"longitudinal", "transverse", "transverse_slow", "transverse_fast", "twist"}
#: variables that are infinite for equal balls, or where no error is known
_MAY_BE_INFINITE = {"reduced_force", "reduced_spacing", "expected_error", "mean_free_path"}
#: variables that are nan where a warning says that they are not known
_MAY_BE_UNKNOWN = {name for name, one in CATALOGUE.items() if one.cost in ("pulse", "spectrum", "dos")}
#: standard errors, nan where they are not known
_ERRORS = {name for name, one in CATALOGUE.items() if one.sampled} | {"exponent_error"}
#: attributes that hold a JSON text, and its type
_JSON = {"packing": dict, "media": list, "versions": dict, "warnings": list}
_WORDS = {dict: "mapping", list: "list"}


def file_names(path: Path) -> list[str]:
    """Names of the netCDF file and of the table beside it."""
    return [path.name, path.with_suffix(".csv").name]


def write_sweep(dataset: Dataset, path: Path) -> None:
    """Write the netCDF file ``path``, and the table of the same name beside it.

    The file carries two digests. The first, an attribute, is that of the numbers; it stays if another program rewrites the
    file. The second is that of all bytes of the netCDF file and stands behind the end of what HDF5 reads, so that damage is
    found before HDF5 reads the file.
    """
    marked = dataset.assign_attrs({DIGEST: _digest_numbers(dataset)})
    data = netcdf_bytes(marked)
    path.write_bytes(data)
    with path.open("ab") as stream:
        stream.write(_TRAILER + hashlib.sha256(data).hexdigest().encode())
    # a row for each load, medium, combination of parameters and direction of sound
    along = ("direction",) * ("direction" in dataset.coords)  # a single direction is a coordinate without a dimension
    own = dataset["valid"].dims
    dims = (*own, *(name for name in along if name in dataset.dims))
    columns = [name for name, data in dataset.data_vars.items() if data.dims in (own, dims)]
    _write_rows(dataset, path.with_suffix(".csv"), dims, [*along, *columns])


def netcdf_bytes(dataset: Dataset) -> bytes:
    """Return the bytes of a netCDF file of the data set, made in memory because HDF5 does not survive a full disk."""
    from h5netcdf import File  # type: ignore[import-untyped]
    from xarray.backends import H5NetCDFStore

    stream = io.BytesIO()
    with File(stream, "w") as file:
        # without this, xarray declares nan to be the mark of missing values
        dataset.dump_to_store(H5NetCDFStore(file), encoding={name: {"_FillValue": None} for name in dataset.variables})
    return stream.getvalue()


def _digest_numbers(dataset: Dataset) -> str:
    """Digest of names, dimensions, types, numbers and attributes; it does not depend on how they are stored."""
    variables = dict[str, list[Any]]()
    for name, variable in dataset.variables.items():
        # neither the byte order nor the stored length of texts counts
        values, kind, content = variable.values, "text", None
        if values.dtype.kind in "OUT":
            content = values.astype(str).tolist()
        else:
            ordered = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
            kind, content = f"{values.dtype.kind}{values.dtype.itemsize}", hashlib.sha256(ordered.data).hexdigest()
        variables[str(name)] = [list(variable.dims), list(variable.shape), kind, content, variable.attrs]
    attributes = {name: value for name, value in dataset.attrs.items() if name not in (DIGEST, *_HISTORY)}
    return digest({"variables": variables, "attributes": attributes})


def write_waves(dataset: Dataset, path: Path) -> None:
    """Write a table of the waves in simulated arrays, by the name of the file.

    sweep_dos.csv has a row for each state and frequency, sweep_spectra.csv one for each state, polarisation and wave vector.
    """
    extra = ("node",) if path.name == "sweep_dos.csv" else ("polarisation", "wavevector")
    dims = (*dataset["valid"].dims, *extra)
    whole = [one for one, data in dataset.data_vars.items() if set(extra[-1:]) <= set(data.dims) <= set(dims)]
    _write_rows(dataset, path, dims, [*(one for one in extra if one in dataset.coords), *whole])


def _write_rows(dataset: Dataset, path: Path, dims: Sequence[Any], columns: Sequence[Any]) -> None:
    """Write a row for each point of the grid of ``dims``: load, medium and parameters, then the ``columns``, all digits."""
    load, own = next(name for name in LOADS if name in dataset.coords), dataset["valid"].dims
    names = [load, *own[1:], *columns]
    grid = dataset["valid"].broadcast_like(dataset[names[len(own) :]])
    headings = [Heading(str(name), dataset[name].attrs.get("units", "")) for name in names]
    values = [dataset[name].broadcast_like(grid).transpose(*dims).values.ravel() for name in names]
    with path.open("w", encoding="utf-8", newline="") as stream:
        write_table(stream, headings, zip(*(column.tolist() for column in values), strict=True))


def load_sweep(path: str | os.PathLike[str]) -> Dataset:
    """Read the data set that :func:`granphon.runs.sweep.sweep` wrote to ``path`` into memory.

    Raises
    ------
    MissingFileError : there is no such file.
    InputError : it is not a sweep, was damaged, was edited after granphon had written it, or has another schema.

    Warns
    -----
    UnverifiedFileWarning : the file carries no digest.
    """
    raw = read_bytes(path, MAX_SWEEP)
    body, trailer = raw[:-_TRAILER_BYTES], raw[-_TRAILER_BYTES:]
    sound = trailer.startswith(_TRAILER)
    if sound and trailer != _TRAILER + hashlib.sha256(body).hexdigest().encode():
        raise damage_error(path, "sha256 of the file, at its end")
    if not sound:
        body = raw
        _try_elsewhere(path, body)
    try:
        # open the bytes that were checked: the file itself may have changed since
        dataset = open_bytes(body)
    except Exception as error:  # whatever makes HDF5, h5netcdf or xarray fail is in the file
        raise _explain_unreadable(path, str(error)) from None
    if dataset.attrs.get("format") != FORMAT:
        raise InputError(message(f"{path} is not a sweep", "granphon did not write it", "Give a sweep.nc"))
    schema: Any = dataset.attrs.get("schema")
    require_schema(path, schema.item() if isinstance(schema, np.generic) else schema, SWEEP_SCHEMA)
    if _REQUIRED - set(dataset.variables):
        raise InputError(message(f"{path} is damaged: a part of the sweep is missing", mend="Run the sweep again"))
    told = dataset.attrs.pop(DIGEST, None)
    if told is not None and told != _digest_numbers(dataset):
        raise damage_error(path, f"sha256 of the numbers, the attribute {DIGEST}")
    if told is None and not sound:
        _require_sense(path, dataset)
        warn_unverified(path)
    return dataset


def _require_sense(path: str | os.PathLike[str], dataset: Dataset) -> None:
    """Raise InputError if a variable or an attribute of a file without a digest cannot be of a sweep."""
    for name, kind in _JSON.items():
        try:
            if name in dataset.attrs and not isinstance(json.loads(dataset.attrs[name]), kind):
                raise ValueError
        except (TypeError, ValueError, RecursionError):
            what = f"{path} is damaged: its attribute {name} is {show(dataset.attrs[name])}, which is no JSON {_WORDS[kind]}"
            raise InputError(message(what, mend="Run the sweep again")) from None
    # velocities that balls with some of the motions do not have are nan, and pressures that some lattices do not have
    lacking = not {"motions", "torsion", "bending", "lattice"}.isdisjoint(dataset.coords)
    for name in map(str, dataset.variables):
        values = dataset[name].values
        if name not in CATALOGUE or not CATALOGUE[name].unit or values.dtype.kind == "b":
            continue
        if name in ("torsion", "direction") and values.dtype.kind in "OUT":
            continue  # "mindlin" is among the values of torsion; directions are named
        wrong = None if values.dtype.kind in "iuf" else "which are no numbers"
        if wrong is None:
            if lacking and (CATALOGUE[name].cost == "velocities" or name == "pressure"):
                values = values[~np.isnan(values)]
            good, allowed = np.isfinite(values), "finite"
            if name in _MAY_BE_INFINITE:
                good |= values == np.inf
            if name in _ABOVE_ZERO:
                good, allowed = good & (values > 0.0), "above zero"
            elif name in _ZERO_OR_ABOVE or name in _ERRORS:
                good, allowed = good & (values >= 0.0), "zero or above"
            if name in _VELOCITIES:
                good, allowed = good & (values < LIGHT_VELOCITY), f"{allowed}, and below the velocity of light"
            if name in _ERRORS | _MAY_BE_UNKNOWN:
                good |= np.isnan(values)
            wrong = None if np.all(good) else f"of which one is {values[~good].flat[0]:g}; allowed: {allowed}"
        if wrong is not None:
            what = f"{path} is damaged: it holds values of {name}, {wrong}"
            raise InputError(message(what, mend="Run the sweep again"))


def open_bytes(data: bytes) -> Dataset:
    """Read the data set of a netCDF file that is given as bytes into memory.

    Raises ValueError if the file refers to other files or would fill the memory, and whatever HDF5, h5netcdf and xarray
    raise.
    """
    import h5py
    from xarray import open_dataset

    def check(_: str, item: Any) -> None:
        group = isinstance(item, h5py.Group)
        if group and any(isinstance(item.get(key, getlink=True), h5py.ExternalLink) for key in item):
            raise ValueError("it refers to another file")
        if isinstance(item, h5py.Dataset) and (item.external or item.is_virtual):
            raise ValueError("it refers to another file")

    stream = io.BytesIO(data)
    with h5py.File(stream, "r") as file:
        check("/", file)
        file.visititems(check)
    with open_dataset(stream, engine="h5netcdf") as dataset:
        if dataset.nbytes > MAX_SWEEP:
            raise ValueError(f"it unpacks to more than {MAX_SWEEP // 1_000_000} MB")
        return dataset.load()


def _explain_unreadable(path: str | os.PathLike[str], why: str) -> InputError:
    return InputError(message(f"{path} cannot be read", why, "Is this the right file?"))


def _try_elsewhere(path: str | os.PathLike[str], data: bytes) -> None:
    """Open a file without a digest in a separate process first: HDF5 may hang, or crash, on a damaged file."""
    if not data.startswith(b"\x89HDF\r\n\x1a\n"):
        raise _explain_unreadable(path, "It is not a netCDF-4 file")
    # -I isolates the process: files of the current folder, such as a sitecustomize.py, are not run when Python starts. It
    # imports the granphon of this process, and searches the rest of this process's path last
    found = [str(Path(str(sys.modules["granphon"].__file__)).parent.parent), *(place for place in sys.path if place)]
    try:
        done = subprocess.run(
            [sys.executable, "-I", "-c", _TRIAL, *found], input=data, capture_output=True, timeout=TRIAL_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        raise _explain_unreadable(path, f"HDF5 has not opened it in {TRIAL_SECONDS:.0f} seconds: it is damaged") from None
    except OSError as error:
        raise _explain_unreadable(
            path, f"It carries no digest, and no process could be started to test it: {error}"
        ) from None
    if done.returncode != 0 or done.stdout.strip() != b"good":
        said = done.stderr.decode("utf-8", "replace").strip().splitlines()
        raise _explain_unreadable(path, f"HDF5 fails on it: {said[-1] if done.returncode > 0 and said else 'it crashes'}")
