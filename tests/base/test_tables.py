"""Tables as experimenters write them, and as they get them wrong."""

from __future__ import annotations

import re
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import granphon as gp
from granphon.base import quantities
from granphon.base.errors import InputError
from granphon.base.quantities import LENGTH, LOADS, PUSH, Quantity
from granphon.base.tables import Heading, Table, read_rows, table_text
from granphon.fits.measurements import Measurements
from granphon.fits.transfer import TransferFunction

FORCE = LOADS["force"]
SPEED = Quantity("velocity", "m/s", "500 m/s", "m/s, km/s, mm/us")


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
        ("mobility (m/(N s))", "mobility", "m/(N s)"),
        ("impedance [kg/(m^2 s)]", "impedance", "kg/(m^2 s)"),
        ("", "", ""),
        ("(N)", "", "N"),
        ("frequency_Hz", "frequency_Hz", "Hz"),
        ("total_per_Hz", "total_per_Hz", "1/Hz"),
        ("total_per_Hz (s)", "total_per_Hz", "s"),
    ],
)
def test_headings(text, name, unit):
    assert Heading.parse(text) == Heading(name, unit)


@pytest.mark.parametrize(
    "text",
    [
        "force (mN),velocity (km/s)\n2000,0.5\n4000,0.625\n",
        "\ufeffForce [N]\tnote\tVELOCITY [m/s]\r\n2\ta, b\t500\r\n\r\n# between\r\n4\t; c\t625\r\n",
        '"force (kN)" ; "velocity (mm/us)"\n  # a remark\n "2e-3" ; ".5"\n+4.E-3;0.625;;\n',
    ],
)
def test_columns_in_si_to_the_last_bit(tmp_path, text):
    found = table(tmp_path, text)
    np.testing.assert_array_equal(found.column("force", FORCE), [2.0, 4.0])
    np.testing.assert_array_equal(found.column("velocity", SPEED), [500.0, 625.0])
    assert "force" in found
    assert "side force" not in found


UNITS = st.sampled_from(
    [("m", 1), ("um", 10**6), ("cm", 100), ("km", Fraction(1, 1000)), ("inch", Fraction(5000, 127))]
)
NUMBERS = (
    st.integers(1, 10**25).map(str)
    | st.floats(1e-300, 1e280).map(repr)
    | st.decimals(1, 9, places=20).map(str)
)
NUMBERS |= st.sampled_from(["8.", ".5", "+3.25", "8E-3", "8e+02", "1e-199"])


@given(st.lists(NUMBERS, min_size=1, max_size=20), UNITS)
def test_cells_are_the_floats_nearest_to_what_is_written(tmp_path_factory, cells, unit):
    path = tmp_path_factory.mktemp("t") / "data.csv"
    path.write_text("\n".join([f"size ({unit[0]})", *cells]), encoding="utf-8")
    found = Table.read(path).column("size", LENGTH)
    assert found.tolist() == [float(Fraction(cell) / unit[1]) for cell in cells]
    assert found.tolist() == [LENGTH.read(f"{cell} {unit[0]}") for cell in cells]


PLAIN = (
    st.integers(1, 10**25).map(str)
    | st.floats(1e-180, 1e180).map(repr)
    | st.decimals(1, 9, places=20).map(str)
)
SIGNED = PLAIN | PLAIN.map("-{}".format) | st.sampled_from(["0", "-0.0", "0e5", "00.10", "-1.5E+3"])
UNITS_OF_FORCE = st.sampled_from(
    [("N", 1), ("mN", 1000), ("kN", Fraction(1, 1000)), ("kgf", Fraction(100000, 980665))]
)


@given(st.lists(SIGNED, min_size=1, max_size=20), UNITS_OF_FORCE)
def test_whole_columns_are_read_at_once(cells, unit):
    """Also those with zeros, signs, exponents and units that are no power of ten: none is left to
    the reader of one cell.
    """
    alone = [PUSH.read(f"{cell} {unit[0]}") for cell in cells]
    assert alone == [float(Fraction(cell) / unit[1]) for cell in cells]
    found = PUSH.read_many(cells, unit[0])
    assert found.tolist() == alone
    assert not np.any(np.signbit(found[found == 0.0]))


def test_messages_name_the_first_columns_of_many(tmp_path):
    head = ",".join(f"column {k} (N)" for k in range(500)) + "," + "x" * 9000
    found = table(tmp_path, head + "\n" + ",".join(["1"] * 501) + "\n")
    with pytest.raises(InputError, match="'column 9' and 491 more") as error:
        found.column("force", FORCE)
    assert len(str(error.value)) < 500
    for read in (gp.ContactNetwork.from_table, Measurements.read, TransferFunction.read):
        with pytest.raises(InputError, match=r"column 9 \(N\).? and 491 more") as error:
            read(*[tmp_path / "data.csv"] * (2 if read == gp.ContactNetwork.from_table else 1))
        assert len(str(error.value)) < 1000


def test_names_are_compared_as_words_and_a_name_may_carry_the_unit(tmp_path):
    found = table(tmp_path, "Side-Force (N),v (m/s)\n1,2\n")
    assert found.column("side_force", FORCE) == [1.0]
    assert found.column("Side force (kN)", FORCE) == [1000.0]
    assert found.column("V", SPEED) == [2.0]
    assert found.column("v (km/s)", SPEED) == [2000.0]


def test_only_the_columns_that_are_asked_for_are_read(tmp_path):
    assert table(tmp_path, "ball,diameter (mm)\nfirst,8\nsecond,9\n").column(
        "diameter", LENGTH
    ).tolist() == [0.008, 0.009]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("# nothing\n\n", "is empty"),
        ("force\n2\n", r"'force' has no unit.*'force \(N\)'"),
        ("2.0,500\n4,600\n", r"csv:1: .*2\.0 .*headed"),
        ("force (N),velocity\n", "no rows"),
        (
            "forse (N)\n1\n",
            "'force'.* columns are 'forse'.*Did you mean 'forse'",
        ),
        (
            "a,b\n1,2\n",
            "'force'.* columns are 'a', 'b'",
        ),
        ("force (N),Force (mN)\n1,2\n", "two columns named 'force'"),
        ("force (N),v\n1,2\n3,4,5\n", "csv:3: found 3 cells below 2 headings"),
        ("v;force (N)\n1;2\n\n3\n", "csv:4: force: found nothing"),
        ("force (N)\nnan\n", "csv:2: force: found 'nan'"),
        ("force (N)\n-2\n", "csv:2: force: .*'-2 N', which is tensile"),
        ("force (N)\n# x\n0.0\n", r"csv:3: force: .*'0\.0 N', which is zero"),
        (
            "force (N);v\n2,5;3\n",
            "csv:2: force: found '2,5'.* point",
        ),
        (
            'force (N),v\n"1,5e3",3\n',
            "found '1,5e3'.* point",
        ),
        ("force (N)\ntwo\n", "found 'two'.*number"),
        ("force (N)\n2,5\n", "csv:2: found 2 cells below 1 heading.* point"),
        ("force (m)\n1\n", "csv:2: force: found '1 m'.*unit of force"),
        ("force (Newtons)\n1\n", "csv:2: force: found '1 Newtons'.*unit"),
        ("force (N)\n1e400\n", "csv:2: force: found '1e400 N'.*finite"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, text, words):
    with pytest.raises(InputError, match=words):
        table(tmp_path, text).column("force", FORCE)


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    # more than one cell of a table can hold
    (tmp_path / "wide.csv").write_text("force (N)\n" + "1" * 200_000)
    for path in (
        tmp_path,
        "/dev/null",
        tmp_path / "none.csv",
        tmp_path / "binary.csv",
        f"{tmp_path}/\0",
    ):
        with pytest.raises(InputError, match="cannot be read"):
            Table.read(path)
    with pytest.raises(InputError, match=r"csv:2 .*columns"):
        Table.read(tmp_path / "wide.csv")


@pytest.mark.parametrize(
    "bad", ["0", "-1", "1e400", "1e-400", "nan", "8,5", "eight", "1" * 101, "1e-324", ""]
)
def test_a_bad_cell_among_many_is_told_as_alone(tmp_path, bad):
    alone, among = (
        table(tmp_path, "n;size (mm)\n" + "1;8.25\n" * before + f"2;{bad}\n" + "3;8.5\n" * before)
        for before in (0, 50)
    )
    with pytest.raises(InputError) as one:
        alone.column("size", LENGTH)
    with pytest.raises(InputError, match=re.escape(str(one.value).replace(":2:", ":52:", 1))):
        among.column("size", LENGTH)


# -- encodings -------------------------------------------------------------------------------------

MICRO = "ball,diameter (µm)\n1,7999\n2,8001\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_utf_8_is_read_with_its_mark_and_without(encoding):
    found = Table.parse("lot.csv", MICRO.encode(encoding))
    np.testing.assert_array_equal(found.column("diameter", LENGTH), [7.999e-3, 8.001e-3])


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (
            MICRO.encode("utf-16"),
            "lot.csv:1 .*byte 0xff",
        ),
        (
            MICRO.encode("utf-16"),
            "looks like UTF-16.*iconv",
        ),
        (b"\xfe\xff" + MICRO.encode("utf-16-be"), "lot.csv:1 .*byte 0xfe"),
        (
            "size (m)\n8\n".encode("utf-16-le"),
            "lot.csv:1 .*byte 0x00",
        ),
        ("size (m)\n8\n".encode("utf-16-le"), "looks like UTF-16"),
        (
            MICRO.encode("latin-1"),
            "lot.csv:1 .*byte 0xb5",
        ),
        (
            MICRO.encode("latin-1"),
            "looks like Latin-1",
        ),
        (
            "diameter (m)\n8\n# é\n".encode("latin-1"),
            "lot.csv:3 .*byte 0xe9",
        ),
        # bytes behind a mark are counted with the mark
        (b"\xef\xbb\xbfsize (m)\n# \xe9\n", "lot.csv:2 .*byte 0xe9"),
        (
            b"a\n\x89PNG\r\n\x1a",
            "lot.csv:2 .*byte 0x89.* text",
        ),
        (
            b"a (m)\n1\n2\0\n",
            "lot.csv:3 .*byte 0x00.* text",
        ),
    ],
)
def test_other_encodings_are_named_with_line_and_byte_and_how_to_mend(raw, words):
    with pytest.raises(InputError, match=words):
        Table.parse("lot.csv", raw)


# -- files that a scene has named, and that may hold anything --------------------------------------

SECRET = "hunter2"
FOREIGN = [
    f"root:{SECRET}:0:0::/root:/bin/sh\nalice:{SECRET}\n",
    f"{SECRET}\n{SECRET}\n",
    f"{SECRET},password\nalice,{SECRET}\n",
    "20220518,1\nalice,1\n".replace("20220518", "987654321"),
    f"diameter\n{SECRET}\n",
    f"diameter,{SECRET}\n{SECRET},1\n",
    f"diameter ({SECRET})\nwide\n",
    f"diameter (s)\n{SECRET}\n",
    f"{SECRET} (s)\n1\n",
    f'diameter (mm)\n1,{SECRET},"\n',
    f"Diameter,diameter\n{SECRET},1\n",
]


@pytest.mark.parametrize("text", FOREIGN)
@pytest.mark.parametrize("name", ["diameter", "diameter (m)", "diametre"])
def test_errors_do_not_quote_a_file_that_is_no_table_of_quantities(text, name):
    with pytest.raises(InputError) as error:
        Table.parse("lot.csv", text.encode(), quoted=False).column(name, LENGTH)
    assert SECRET not in str(error.value)
    assert "987654321" not in str(error.value)


def test_of_such_a_file_the_error_says_how_many_columns_and_which_heading():
    for text, words in (
        ("user:hunter2\n1\n", r"one column, .*'diameter \(m\)'"),
        ("a,b,c\n1,2,3\n", r"3 columns, .*'diameter \(m\)'"),
        ("a,diametre (mm)\n1,2\n", "Did you mean 'diametre'"),
    ):
        with pytest.raises(InputError, match=words):
            Table.parse("lot.csv", text.encode(), quoted=False).column("diameter", LENGTH)


def test_a_table_of_quantities_is_quoted_wherever_it_was_named():
    table = Table.parse("lot.csv", b"ball,diameter (mm)\n1,wide\n", quoted=False)
    with pytest.raises(InputError, match=r"lot\.csv:2: diameter: .*'wide'"):
        table.column("diameter", LENGTH)


@given(st.lists(st.tuples(st.floats(), st.text("ab, \"';µ", max_size=8)), min_size=1, max_size=8))
def test_what_is_written_is_read_again(rows):
    text = table_text([Heading("value", "m/s"), "note"], rows, ["a comment, with a comma", "nan"])
    found = Table.parse("table.csv", text.encode())
    assert found.headings == (Heading("value", "m/s"), Heading("note", ""))
    np.testing.assert_array_equal(found.numbers("value"), [value for value, _ in rows])
    assert found.columns[1] == tuple(note.strip() for _, note in rows)
    assert text.splitlines()[1:3] == ["# a comment, with a comma", "# nan"]


def test_every_table_that_granphon_writes_is_read_by_the_one_reader(tmp_path):
    steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2e-6))
    data = gp.sweep(
        packing,
        force=[2.0, 9.0],
        media=("ala", {"ema": {"local_field": "paper"}}),
        path=tmp_path / "sweep.nc",
    )
    swept = Table.read(tmp_path / "sweep.csv")
    np.testing.assert_array_equal(
        swept.numbers("longitudinal"), data["longitudinal"].values.ravel()
    )
    assert swept.column("bulk", quantities.MODULUS).tolist() == data["bulk"].values.ravel().tolist()
    dos = gp.Phonons(gp.AveragedLattice(packing).at_force(2.0)).dos((4, 4), points=31)
    dos.write_csv(tmp_path / "dos.csv")
    there = Table.read(tmp_path / "dos.csv")
    hertz = Quantity("frequency", "Hz", "1 Hz", "Hz", "zero or above")
    np.testing.assert_array_equal(there.column("frequency_Hz", hertz), dos.frequencies)
    np.testing.assert_array_equal(there.numbers("total_per_Hz"), dos.total)
    assert there.unit("total_per_Hz") == "1/Hz"
    with pytest.raises(KeyError):
        there.numbers("absent")


def test_numbers_of_two_columns_of_one_heading_are_refused():
    table = Table.parse("t.csv", b"H,H (V)\n1,2\n")
    with pytest.raises(InputError, match=r"two columns.*'H'"):
        table.numbers("H")
    table = Table.parse("t.csv", b"H,h (V),H\n1,2,3\n")
    with pytest.raises(InputError, match=r"3 columns.*'H'"):
        table.numbers("H")


def test_rows_without_cells_are_named():
    assert read_rows("f", b"1 2\n3 4\n", [1], ["x"], 2, 5).tolist() == [[2.0], [4.0]]
    assert read_rows("f", b"", [1], ["x"], 0, 5).shape == (0, 1)
    for body, line in ((b"\n\n", 5), (b"1 2\n\n", 6), (b"1 2\n3 1_0\n", 6)):
        with pytest.raises(InputError, match=f"f:{line}: x"):
            read_rows("f", body, [1], ["x"], 2, 5)


def test_what_is_written_is_read_back():
    headings = ["kind;a", Heading("x,y", "N"), 'b"c']
    rows = [["#1", 1.0, "p;q"], ["plain", 2.0, "x, y"], ['"', 3.0, "# z"], ["", 4.0, "tab\tin"]]
    text = table_text(headings, rows, ["two\nlines"])
    table = Table.parse("t.csv", text.encode())
    assert [str(heading) for heading in table.headings] == [str(heading) for heading in headings]
    assert list(zip(*table.columns, strict=True)) == [
        tuple(cell if isinstance(cell, str) else repr(cell) for cell in row) for row in rows
    ]
    assert Table.parse("t.csv", table_text(["#a"], [["#b"]]).encode()).columns == (("#b",),)
    # a row of one blank cell is no empty line
    text = table_text([" "], [["b"], [" "], [""]])
    assert Table.parse("t.csv", text.encode()).columns == (("b", "", ""),)


def test_quotes_that_are_not_closed_on_their_line_are_refused():
    for text in ('a,b\n"1\n2",3\n', 'a,b\n"1,2\n', '"a,b\n1,2\n'):
        with pytest.raises(InputError, match="not closed"):
            Table.parse("t.csv", text.encode())
    assert Table.parse("t.csv", b'a,b\n3",4\n').columns == (('3"',), ("4",))


def test_rows_that_are_missing_are_told():
    with pytest.raises(InputError, match="t:6: a: found nothing"):
        read_rows("t", b"1\n", (0,), ("a",), 2, 5)
