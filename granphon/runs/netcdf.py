"""Bytes of netCDF files: made in memory, and read without a look at other files."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

from granphon.base.errors import needing

if TYPE_CHECKING:
    from xarray import Dataset as Dataset


#: size of the largest file that is read, and of the largest data set in one, bytes: a sweep may hold many bands
MOST_BYTES = 2_000_000_000


def netcdf_bytes(dataset: Dataset) -> bytes:
    """Return the bytes of a netCDF file of the data set, made in memory because HDF5 does not survive a full disk."""
    with needing("A netCDF file"):
        from h5netcdf import File  # type: ignore[import-untyped]
        from xarray.backends import H5NetCDFStore

    stream = io.BytesIO()
    with File(stream, "w") as file:
        # without this, xarray declares nan to be the mark of missing values
        dataset.dump_to_store(H5NetCDFStore(file), encoding={name: {"_FillValue": None} for name in dataset.variables})
    return stream.getvalue()


def open_bytes(data: bytes) -> Dataset:
    """Read the data set of a netCDF file that is given as bytes into memory.

    Raises ValueError if the file refers to other files or would fill the memory, and whatever HDF5, h5netcdf and xarray
    raise.
    """
    with needing("A netCDF file"):
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
        if dataset.nbytes > MOST_BYTES:
            raise ValueError(f"it unpacks to more than {MOST_BYTES // 1_000_000} MB")
        return dataset.load()
