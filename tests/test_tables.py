"""Tables as experimenters write them, and as they get them wrong."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from granphon.errors import InputError
from granphon.quantities import LENGTH, LOADS, Quantity
from granphon.tables import Heading, Table

FORCE, SPEED = LOADS["force"], Quantity("velocity", "m/s", "500 m/s", "m/s, km/s, mm/us")


def table(tmp_path, text):
    path = tmp_path / "data.csv"
    path.write_bytes(text.encode())
    return Table.read(path)


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("force", "force", ""),
        (" Force ( N ) ", "Force", "N"),
        ("velocity[km/s]", "velocity", "km/s"),
        ("size / lot A (µm)", "size / lot A", "µm"),
        ("v (mean) (m/s)", "v (mean)", "m/s"),
        ("f()", "f", ""),
        ("", "", ""),
        ("(N)", "", "N"),
    ],
)
def test_headings(text, name, unit):
    assert Heading.parse(text) == Heading(name, unit)


@pytest.mark.parametrize(
    "text",
    [
        "force (mN),velocity (km/s)\n2000,0.5\n4000,0.625\n",
        "\ufeffForce [N]\tnote\tVELOCITY\r\n2\ta, b\t500\r\n\r\n# between\r\n4\t; c\t625\r\n",
        '"force (kN)" ; "velocity (mm/us)"\n  # a remark\n "2e-3" ; ".5"\n+4.E-3;0.625;;\n',
    ],
)
def test_columns_in_si_to_the_last_bit(tmp_path, text):
    found = table(tmp_path, text)
    np.testing.assert_array_equal(found.column("force", FORCE), [2.0, 4.0])
    np.testing.assert_array_equal(found.column("velocity", SPEED), [500.0, 625.0])
    assert "force" in found
    assert "side force" not in found


@given(st.lists(st.floats(1e-300, 1e300), min_size=1, max_size=20))
def test_numbers_come_back(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("t") / "data.csv"
    path.write_text("n,force\n" + "".join(f"{n},{value!r}\n" for n, value in enumerate(values)), encoding="utf-8")
    assert Table.read(path).column("force", FORCE).tolist() == values


def test_names_are_compared_as_words_and_a_name_may_carry_the_unit(tmp_path):
    found = table(tmp_path, "Side-Force,v (m/s)\n1,2\n")
    assert found.column("side_force", FORCE) == [1.0]
    assert found.column("Side force (kN)", FORCE) == [1000.0]
    assert found.column("V", SPEED) == [2.0]
    assert found.column("v (km/s)", SPEED) == [2000.0]


def test_only_the_columns_that_are_asked_for_are_read(tmp_path):
    assert table(tmp_path, "ball,diameter (mm)\nfirst,8\nsecond,9\n").column("diameter", LENGTH).tolist() == [0.008, 0.009]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("# nothing\n\n", "is empty"),
        ("2.0,500\n4,600\n", "csv:1: found the number 2.0 where the columns are headed"),
        ("force (N),velocity\n", "no rows below its headings"),
        ("forse (N)\n1\n", "no column named 'force'. Its columns are 'forse'. Did you mean 'forse'"),
        ("a,b\n1,2\n", "no column named 'force'. Its columns are 'a', 'b'. Name the column that is meant"),
        ("force (N),Force (mN)\n1,2\n", "two columns named 'force'"),
        ("force (N),v\n1,2\n3,4,5\n", "csv:3: found 3 cells below 2 headings"),
        ("v;force (N)\n1;2\n\n3\n", "csv:4: force: found nothing, where a number is needed"),
        ("force (N)\nnan\n", "csv:2: force: found 'nan', where a number is needed"),
        ("force (N)\n-2\n", "csv:2: force: found '-2 N', which is tensile"),
        ("force (N)\n# x\n0.0\n", "csv:3: force: found '0.0 N', which is zero"),
        ("force (N);v\n2,5;3\n", "csv:2: force: found '2,5', where a number is needed"),
        ("force (m)\n1\n", "csv:2: force: found '1 m', whose unit is not one of force"),
        ("force (Newtons)\n1\n", "csv:2: force: found '1 Newtons', whose unit is not known"),
        ("force (N)\n1e400\n", "csv:2: force: found '1e400 N', which is not a finite number"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, text, words):
    with pytest.raises(InputError, match=re.escape(words)):
        table(tmp_path, text).column("force", FORCE)


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    for path in (tmp_path, tmp_path / "none.csv", tmp_path / "binary.csv", f"{tmp_path}/\0"):
        with pytest.raises(InputError, match="cannot be read"):
            Table.read(path)
