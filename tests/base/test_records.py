"""Files of records that grow."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from granphon.base.errors import InputError, OutputError
from granphon.base.records import RecordFile, read_records


def begin(path: Path) -> RecordFile:
    return RecordFile(path, {}, {"x": ((2,), ("pair",))}, {"x": "m"}, {"kind": "test"})


def test_a_file_that_is_being_written_stays_as_it_is_when_another_run_begins_it(tmp_path):
    pytest.importorskip("fcntl")  # elsewhere there are no such locks
    path = tmp_path / "x.nc"
    writer = begin(path)
    writer.append({"x": [1.0, 2.0]})
    content = path.read_bytes()
    with pytest.raises(OutputError, match=r"x\.nc"):
        begin(path)
    assert path.read_bytes() == content
    writer.append({"x": [3.0, 4.0]})
    writer.close()
    arrays, _ = read_records(path, {"kind": "test"})
    assert_array_equal(arrays["x"], [[1.0, 2.0], [3.0, 4.0]])
    begin(path).close()  # an earlier file makes way, whole
    assert read_records(path, {"kind": "test"})[0]["x"].shape == (0, 2)


def test_a_file_in_which_nothing_grows_holds_what_is_fixed(tmp_path):
    path = tmp_path / "x.nc"
    RecordFile(path, {"a": (np.arange(3.0), ("n",))}, {}, {}, {"kind": "test"}).close()
    arrays, texts = read_records(path, {"kind": "test"})
    assert_array_equal(arrays["a"], [0.0, 1.0, 2.0])
    assert texts == {"kind": "test"}


def test_a_file_whose_header_is_damaged_is_no_file_of_records(tmp_path):
    path = tmp_path / "x.nc"
    growing = {"y": ((2,), ("pair",)), "t": ((), ())}
    RecordFile(path, {}, growing, {}, {"kind": "test"}).close()
    content = path.read_bytes()
    # name and number of dimensions of y, and the numbers of its dimensions, of which 0 is the time
    dimensions = content.index(b"\0\0\0\1y\0\0\0\0\0\0\2") + 12
    damaged = bytearray(content)
    damaged[dimensions + 4 : dimensions + 8] = bytes(4)
    path.write_bytes(damaged)
    with pytest.raises(InputError, match="not a file of records"):
        read_records(path, {"kind": "test"})


def test_a_record_of_another_shape_is_not_written(tmp_path):
    path = tmp_path / "x.nc"
    writer = begin(path)
    for wrong, error in (({"x": [1.0]}, ValueError), ({}, KeyError)):
        with pytest.raises(error, match="x"):
            writer.append(wrong)
    writer.append({"x": [1.0, 2.0]})
    writer.close()
    assert_array_equal(read_records(path, {"kind": "test"})[0]["x"], [[1.0, 2.0]])
