"""A sweep as files: netCDF for programs, a table for spreadsheets, and back."""

from __future__ import annotations

import hashlib
import io
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.base.digests import damage_error, digest, warn_unverified
from granphon.base.errors import InputError, message
from granphon.base.quantities import LOADS
from granphon.base.reading import read_bytes
from granphon.base.tables import Heading, write_table

if TYPE_CHECKING:
    from xarray import Dataset

__all__ = ["FORMAT", "SWEEP_SCHEMA", "file_names", "load_sweep", "netcdf_bytes", "write_sweep"]

#: what a file of a sweep calls itself
FORMAT = "granphon sweep"
#: version of the format
SWEEP_SCHEMA = 1
#: the attribute with the digest of the numbers
DIGEST = "granphon_sha256"
#: attributes in which other programs note what they did, and change no number
_HISTORY = ("history", "NCO")
#: the largest file that is read: a sweep may hold many bands
MAX_SWEEP = 2_000_000_000
#: time in which a file without a digest must open
TRIAL_SECONDS = 120.0
_TRIAL = """
import sys
sys.path.insert(0, sys.argv[1])
import granphon
sys.path[:1] = []
sys.path.extend(sys.argv[2:])
from granphon.sweeps.archive import open_bytes
open_bytes(sys.stdin.buffer.read())
print("good")
"""
#: what ends a file, before the digest of all that stands before it
_TRAILER = b"\ngranphon sha256 of all bytes before: "
_TRAILER_BYTES = len(_TRAILER) + 64
#: variables without which a sweep is damaged: figures draw them
_REQUIRED = {"force", "longitudinal", "transverse", "valid", "medium"}


def file_names(path: Path) -> list[str]:
    """Names of the netCDF file and of the table beside it."""
    return [path.name, path.with_suffix(".csv").name]


def write_sweep(dataset: Dataset, path: Path) -> None:
    """Write the netCDF file ``path``, and the table of the same name beside it.

    The file carries two digests: an attribute, of the numbers, which stays if another program writes the file anew; and one
    of all its bytes behind the end of what HDF5 reads, so that damage is found before HDF5 meets it.
    """
    marked = dataset.assign_attrs({DIGEST: _digest_numbers(dataset)})
    data = netcdf_bytes(marked)
    path.write_bytes(data)
    with path.open("ab") as stream:
        stream.write(_TRAILER + hashlib.sha256(data).hexdigest().encode())
    _write_table(dataset, path.with_suffix(".csv"))


def netcdf_bytes(dataset: Dataset) -> bytes:
    """What a netCDF file of the data set holds. Made in memory: HDF5 itself does not survive a disk that is full."""
    from h5netcdf import File  # type: ignore[import-untyped]
    from xarray.backends import H5NetCDFStore

    stream = io.BytesIO()
    with File(stream, "w") as file:
        # xarray marks what is missing by nan unless told that nothing is
        dataset.dump_to_store(H5NetCDFStore(file), encoding={name: {"_FillValue": None} for name in dataset.variables})
    return stream.getvalue()


def _digest_numbers(dataset: Dataset) -> str:
    """Digest of names, dimensions, kinds, numbers and attributes, and of nothing that depends on how they are stored."""
    variables = {
        str(name): [list(variable.dims), list(variable.shape), *_content(variable.values), variable.attrs]
        for name, variable in dataset.variables.items()
    }
    attributes = {name: value for name, value in dataset.attrs.items() if name not in (DIGEST, *_HISTORY)}
    return digest({"variables": variables, "attributes": attributes})


def _content(values: np.ndarray[Any, Any]) -> tuple[str, Any]:
    """Kind and content of an array, whatever the order of its bytes, and the length that its texts are stored with."""
    if values.dtype.kind in "OUT":
        return "text", values.astype(str).tolist()
    ordered = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    return f"{values.dtype.kind}{values.dtype.itemsize}", hashlib.sha256(ordered.data).hexdigest()


def _write_table(dataset: Dataset, path: Path) -> None:
    """One row for each load, medium and combination of parameters; all digits."""
    dims = dataset["longitudinal"].dims
    load = next(name for name in LOADS if name in dataset.coords)
    names = [load, *dims[1:], *(name for name, data in dataset.data_vars.items() if data.dims == dims)]
    headings = [Heading(str(name), dataset[name].attrs.get("units", "")) for name in names]
    columns = [dataset[name].broadcast_like(dataset["longitudinal"]).transpose(*dims).values.ravel() for name in names]
    with path.open("w", encoding="utf-8", newline="") as stream:
        write_table(stream, headings, zip(*(column.tolist() for column in columns), strict=True))


def load_sweep(path: str | os.PathLike[str]) -> Dataset:
    """The data set that :func:`granphon.sweeps.sweep.sweep` wrote to ``path``, in memory.

    Raises
    ------
    MissingFileError : there is no such file.
    InputError : it is no sweep, was damaged, or edited after granphon had written it, or is of a newer schema.

    Warns
    -----
    UnverifiedFileWarning : the file carries no digest, as those of older versions.
    """
    raw = read_bytes(path, MAX_SWEEP)
    body, trailer = raw[:-_TRAILER_BYTES], raw[-_TRAILER_BYTES:]
    sound = trailer.startswith(_TRAILER)
    if sound and trailer != _TRAILER + hashlib.sha256(body).hexdigest().encode():
        raise damage_error(path, "sha256 of the file, at its end")
    if not sound:
        body = raw
        _try_elsewhere(path, body)
    dataset = _open_checked(path, body)
    if dataset.attrs.get("format") != FORMAT:
        raise InputError(message(f"{path} is no sweep", "granphon did not write it", "Give a sweep.nc"))
    schema: Any = dataset.attrs.get("schema")
    number = int(schema) if isinstance(schema, int | np.integer) else 0
    if number > SWEEP_SCHEMA:
        what = f"{path} is of schema {number}, newer than this granphon knows ({SWEEP_SCHEMA})"
        raise InputError(message(what, mend="Update granphon"))
    if number < 1 or _REQUIRED - set(dataset.variables):
        raise InputError(message(f"{path} is damaged: it lacks a part of what a sweep holds", mend="Run the sweep again"))
    told = dataset.attrs.pop(DIGEST, None)
    if told is not None and told != _digest_numbers(dataset):
        raise damage_error(path, f"sha256 of the numbers, the attribute {DIGEST}")
    if told is None and not sound:
        warn_unverified(path)
    return dataset


def _open_checked(path: str | os.PathLike[str], data: bytes) -> Dataset:
    try:
        # the bytes that were checked, and no other file
        return open_bytes(data)
    except Exception as error:  # whatever HDF5, h5netcdf and xarray trip over stands in the file
        raise _unreadable(path, str(error)) from None


def open_bytes(data: bytes) -> Dataset:
    """The data set in a netCDF file that is given as bytes, in memory; refuses what would read other files, or fill memory.

    Raises whatever HDF5, h5netcdf and xarray do.
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


def _unreadable(path: str | os.PathLike[str], why: str) -> InputError:
    return InputError(message(f"{path} cannot be read", why, "Is this the right file?"))


def _try_elsewhere(path: str | os.PathLike[str], data: bytes) -> None:
    """Open a file that no digest vouches for in a process of its own first: HDF5 may hang, or crash, on a damaged one."""
    if not data.startswith(b"\x89HDF\r\n\x1a\n"):
        raise _unreadable(path, "It is no netCDF file of version 4")
    # isolated: what stands in the folder where we are, such as a sitecustomize.py, is not run when Python starts; granphon
    # is this one, and whatever else it needs is looked for there last
    found = [str(Path(str(sys.modules["granphon"].__file__)).parent.parent), *(place for place in sys.path if place)]
    try:
        done = subprocess.run(
            [sys.executable, "-I", "-c", _TRIAL, *found], input=data, capture_output=True, timeout=TRIAL_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        raise _unreadable(path, f"HDF5 has not opened it in {TRIAL_SECONDS:.0f} seconds: it is damaged") from None
    except OSError as error:
        raise _unreadable(path, f"It carries no digest, and no process could be started to try it: {error}") from None
    if done.returncode != 0 or done.stdout.strip() != b"good":
        said = done.stderr.decode("utf-8", "replace").strip().splitlines()
        raise _unreadable(path, f"HDF5 fails on it: {said[-1] if done.returncode > 0 and said else 'it crashes'}")
