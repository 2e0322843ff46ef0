"""A sweep as files: netCDF for programs, a table for spreadsheets, and back."""

from __future__ import annotations

import csv
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.errors import InputError, message

if TYPE_CHECKING:
    from xarray import Dataset

__all__ = ["FORMAT", "LOADS", "SCHEMA", "file_names", "load_sweep", "write_sweep"]

FORMAT, SCHEMA = "granphon sweep", 1
#: kinds of load, and their names in words; one of them is a coordinate
LOADS = {"force": "mean contact force", "pressure": "force per length of boundary", "overlap": "d - a"}
#: what figures draw
_NEEDED = {"force", "longitudinal", "transverse", "valid", "medium"}


def file_names(path: Path) -> list[str]:
    """Of the netCDF file and of the table beside it."""
    return [path.name, path.with_suffix(".csv").name]


def write_sweep(dataset: Dataset, path: Path) -> None:
    """Write the netCDF file ``path``, and the table of the same name beside it."""
    # xarray marks what is missing by nan unless told that nothing is
    dataset.to_netcdf(path, engine="h5netcdf", encoding={name: {"_FillValue": None} for name in dataset.variables})
    _write_table(dataset, path.with_suffix(".csv"))


def _write_table(dataset: Dataset, path: Path) -> None:
    """One row for each load, medium and combination of parameters; all digits."""
    dims = dataset["longitudinal"].dims
    load = next(name for name in LOADS if name in dataset.coords)
    names = [load, *dims[1:], *(name for name, data in dataset.data_vars.items() if data.dims == dims)]
    units = [dataset[name].attrs.get("units") for name in names]
    columns = [dataset[name].broadcast_like(dataset["longitudinal"]).transpose(*dims).values.ravel() for name in names]
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow([name if unit is None else f"{name} ({unit})" for name, unit in zip(names, units, strict=True)])
        table.writerows(zip(*(column.tolist() for column in columns), strict=True))


def load_sweep(path: str | os.PathLike[str]) -> Dataset:
    """The data set that :func:`granphon.sweeps.sweep` wrote to ``path``, in memory.

    :class:`~granphon.errors.InputError` if there is no such file, if it is damaged or no sweep, or of a newer schema.
    """
    from xarray import load_dataset

    try:
        dataset = load_dataset(path, engine="h5netcdf")
    except FileNotFoundError:
        raise InputError(message(f"{path}: there is no such file", mend="sweep(path=...) writes one")) from None
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise InputError(message(f"{path} cannot be read", str(error), "Is this the right file?")) from error
    if dataset.attrs.get("format") != FORMAT:
        raise InputError(message(f"{path} is no sweep", "granphon did not write it", "Give a sweep.nc"))
    schema: Any = dataset.attrs.get("schema")
    number = int(schema) if isinstance(schema, int | np.integer) else 0
    if number > SCHEMA:
        what = f"{path} is of schema {number}, newer than this granphon knows ({SCHEMA})"
        raise InputError(message(what, mend="Update granphon"))
    if number < 1 or _NEEDED - set(dataset.variables):
        raise InputError(message(f"{path} is damaged: it lacks a part of what a sweep holds", mend="Run the sweep again"))
    return dataset
