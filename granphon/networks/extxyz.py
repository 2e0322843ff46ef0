"""Tables of balls and of contacts as frames of extended XYZ, which OVITO and ASE open.

The first line of a frame has the number of rows. The second line has keys with values, of which
``Lattice`` is the box, and ``Properties`` names the columns. The rows follow. Balls stand at their
centres, and contacts at their places. A column may be a vector. Two keys are granphon's own:
``granphon_network``, the fields of the whole network as JSON in percent-encoding, so that readers
of keys do not take it apart; and at the end ``granphon_sha256``, the digest of all the rest.
Numbers are in SI units with all digits.
"""

from __future__ import annotations

import json
import math
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any
from urllib.parse import quote, unquote

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.quantities import Quantity
from granphon.base.tables import Heading, Table, plain_float
from granphon.base.text import damage_error, decode, digest_lines, join_numbers, read_bytes
from granphon.networks.sources import require_balls

#: the columns of tables that are one vector of a frame, by the name of this
_VECTORS = {
    "pos": ("x", "y", "z"),
    "shift": ("shift_1", "shift_2", "shift_3"),
    "normal": ("nx", "ny", "nz"),
    "tangential_force": ("tangential_x", "tangential_y", "tangential_z"),
    "contact_torque": ("torque_x", "torque_y", "torque_z"),
    "force": ("force_x", "force_y", "force_z"),
}
#: the key of the fields of the whole network
_REMARK_KEY = "granphon_network"
#: greatest difference of two cells that count as one, over the largest entry: other programs round
_CELL_TOLERANCE = 1e-6
#: the key of the digest, and what parts it from the rest of its line and from its value
_SEAL_KEY = " granphon_sha256="
#: vectors of contacts that viewers draw; reading takes the parts of which they are made
_VECTORS_FOR_VIEWERS = ("force",)
#: letters of types of columns, by the kind of an array of NumPy
_TYPES = {"i": "I", "f": "R", "U": "S"}


def find_box(network: Any) -> tuple[Array, Array]:
    """Return the vectors (3, 3), m, of a box around a network, the cell along its periods, and the
    corner (3,), m, where they begin: across the periods the box reaches around all balls.
    """
    vectors = network.cell.copy()
    is_open = ~np.asarray(network.pbc)
    is_ball = np.isfinite(network.radii)
    radii = network.radii[is_ball, None]
    # unit vectors across all periods, whose largest components are positive: of the singular
    # directions in space the first ones span the periods
    periods = vectors[~is_open]
    _left, _sizes, directions = np.linalg.svd(periods)
    across = directions[len(periods) :]
    largest = np.argmax(np.abs(across), axis=1)[:, None]
    across *= np.sign(np.take_along_axis(across, largest, axis=1))
    heights = network.positions[is_ball] @ across.T
    low = np.min(heights - radii, axis=0)
    high = np.max(heights + radii, axis=0)
    vectors[is_open] = (high - low)[:, None] * across
    return vectors, low @ across


def frame_text(columns: Mapping[str, Array], network: Any, remark: Mapping[str, Any]) -> str:
    """Return the text of a frame, sealed by its digest: the ``columns``, (rows,) or (rows, m) by
    name, in SI units, one or more, and in its head the box of the ``network`` and ``remark``, which
    is plain data. Columns of the components of a vector become one column.
    """
    columns_of_frame: dict[str, Array] = {}
    vector_of_component = {
        component: vector for vector, names in _VECTORS.items() for component in names
    }
    for name, values in columns.items():
        vector = vector_of_component.get(name)
        if vector is None:
            columns_of_frame[name] = values
        elif vector not in columns_of_frame:
            components = [columns[component] for component in _VECTORS[vector]]
            columns_of_frame[vector] = np.stack(components, axis=1)
    n_rows = len(next(iter(columns_of_frame.values())))
    properties = ["species:S:1"]  # each row, a ball or a contact, is an X, which is no element
    cells: list[Sequence[str]] = [["X"] * n_rows]
    for name, values in columns_of_frame.items():
        table = values if values.ndim == 2 else values[:, None]  # (rows, m)
        properties.append(f"{name}:{_TYPES[values.dtype.kind]}:{table.shape[1]}")
        encode = quote if values.dtype.kind == "U" else repr
        cells += [list(map(encode, column.tolist())) for column in table.T]
    vectors, corner = find_box(network)
    keys = [
        f'Lattice="{join_numbers(vectors.ravel().tolist())}"',
        f'Origin="{join_numbers(corner.tolist())}"',
        f"Properties={':'.join(properties)}",
        f'pbc="{" ".join("T" if repeats else "F" for repeats in network.pbc)}"',
        f"{_REMARK_KEY}={quote(json.dumps(remark), safe='')}",
    ]
    lines = [str(n_rows), " ".join(keys), *map(" ".join, zip(*cells, strict=True)), ""]
    lines[1] += _SEAL_KEY + digest_lines(lines)
    return "\n".join(lines)


def read_frame(
    path: str | os.PathLike[str],
    quantities: Mapping[str, Quantity | None],
    most_bytes: int,
    most_rows: int,
) -> tuple[dict[str, Any], bool, Iterator[Table]]:
    """Return the remark of a frame that :func:`frame_text` has made, whether it has a digest,
    and its columns that ``quantities`` holds, in tables of at most ``most_rows`` rows, one below
    the other.

    Raises :class:`~granphon.base.errors.InputError` for a file that cannot be read, has more than
    ``most_bytes``, is another frame, or was changed; and, as the tables are read, for a row that
    :func:`_read_rows` refuses.
    """
    name = str(path)
    lines = decode(name, read_bytes(path, most_bytes)).replace("\r\n", "\n").split("\n")
    head = lines[1] if len(lines) > 1 else ""
    is_sealed = _SEAL_KEY in head
    if is_sealed:
        head, _, seal = head.partition(_SEAL_KEY)
        if digest_lines([lines[0], head, *lines[2:]]) != seal:
            raise damage_error(path, f"{_SEAL_KEY.strip(' =')} in line 2")
    rows = lines[2:-1] if lines[-1] == "" else lines[2:]
    if not any(lines):
        raise InputError(f"{name} is empty", mend="Write it again")
    if lines[0].strip() != str(len(rows)):
        fault = f"{name} says that it has {brief(lines[0].strip())} rows, and has {len(rows)}"
        raise InputError(fault, "It may be cut, or hold several frames", "Write it again")
    keys = dict(re.findall(r"(\w+)=(\S+)", head))
    remark: Any = None
    with suppress(ValueError, RecursionError):
        remark = json.loads(unquote(keys.get(_REMARK_KEY, "")))
    if not isinstance(remark, dict):
        fault = f"{name} is no frame of granphon: its second line has no {_REMARK_KEY}"
        why = "The units of other files are not known, and they have no contacts"
        raise InputError(fault, why, "Give a file of network.write_tables, or arrays in SI")
    _require_box(name, head, remark)
    names = _list_columns(name, keys.get("Properties", ""))
    require_balls(name, names, quantities)
    return remark, is_sealed, _read_rows(name, rows, names, quantities, most_rows)


def _require_box(name: str, head: str, remark: Mapping[str, Any]) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if Lattice or pbc in the ``head`` of the file
    ``name`` are not those of the network, whose fields are in the ``remark``; a remark without a
    cell is that of contacts.
    """
    if "cell" not in remark or "pbc" not in remark:
        return
    lattice_match = re.search('Lattice="([^"]*)"', head)
    pbc_match = re.search('pbc="([^"]*)"', head)
    is_same = True
    # a remark of other kinds of values is refused later
    with suppress(IndexError, TypeError, ValueError):
        pbc = np.array(remark["pbc"], bool)
        cell = np.array(remark["cell"], float)
        if pbc_match:
            letters = ["T" if is_period else "F" for is_period in pbc.tolist()]
            is_same &= pbc_match[1].split() == letters
        if lattice_match:
            try:
                box = np.array(lattice_match[1].split(), float).reshape(3, 3)
            except ValueError:
                box = np.full((3, 3), np.nan)
            is_same &= np.allclose(
                box[pbc], cell[pbc], rtol=0.0, atol=_CELL_TOLERANCE * np.max(np.abs(cell))
            )
    if not is_same:
        fault = f"{name}: Lattice or pbc in line 2 is not that of the network in {_REMARK_KEY}"
        raise InputError(fault, "The line was changed", "Give cell and pbc of arrays, or mend it")


def _list_columns(name: str, properties: str) -> list[str]:
    """Return the names of the single columns of the frame in the file ``name``, from the value of
    its key Properties, as "pos:R:3:mass:R:1"; InputError for another ``properties``.

    The components of a vector that tables have go by the names of their columns, as x, y and z;
    other ones are numbered, as force.0, force.1 and force.2.
    """
    parts = properties.split(":")
    is_whole = len(parts) % 3 == 0 and all(re.fullmatch("[1-9]", part) for part in parts[2::3])
    if not is_whole:
        fault = f"{name}: Properties={brief(properties)} in line 2 names no columns"
        raise InputError(fault, mend="Write it again")
    names = list[str]()
    for column, width in zip(parts[::3], map(int, parts[2::3]), strict=True):
        numbered = [column] if width == 1 else [f"{column}.{place}" for place in range(width)]
        components = () if column in _VECTORS_FOR_VIEWERS else _VECTORS.get(column, ())
        names += components if len(components) == width else numbered
    return names


def _read_rows(
    name: str,
    rows: Sequence[str],
    names: Sequence[str],
    quantities: Mapping[str, Quantity | None],
    most_rows: int,
) -> Iterator[Table]:
    """Yield the ``rows`` of the file ``name``, the first of which is line 3, as tables of at most
    ``most_rows`` rows. The tables have those of the columns ``names`` that ``quantities`` holds,
    with the units of these, none for a quantity of None. If there is no row, the one table has no
    rows.

    InputError, with the line, for a row that has not as many cells as there are ``names``, and for
    a place or a shown vector whose numbers are not finite.
    """
    units = {key: "" if kind is None else kind.unit for key, kind in quantities.items()}
    places = [place for place, column in enumerate(names) if column in units]
    headings = tuple(Heading(names[place], units[names[place]]) for place in places)
    vectors = (
        *_VECTORS["pos"],
        *(f"{vector}.{place}" for vector in _VECTORS_FOR_VIEWERS for place in range(3)),
    )
    must_be_finite = [place for place, column in enumerate(names) if column in vectors]
    for first in range(0, max(len(rows), 1), most_rows):
        columns: list[list[str]] = [[] for _ in places]
        piece = rows[first : first + most_rows]
        for line, row in enumerate(piece, first + 3):
            cells = row.split()
            if len(cells) != len(names):
                fault = f"{name}:{line}: found {len(cells)} cells, and there are {len(names)}"
                raise InputError(f"{fault} columns", mend="Write it again")
            for place in must_be_finite:  # also where nothing but a viewer reads the numbers
                if not _is_finite(cells[place]):
                    fault = f"{name}:{line}: {names[place]} is {brief(cells[place])}"
                    raise InputError(fault, "It must be a finite number")
            for place, column in zip(places, columns, strict=True):
                column.append(cells[place])
        for heading, column in zip(headings, columns, strict=True):
            if heading.name == "kind":
                column[:] = [sys.intern(unquote(cell)) for cell in column]
        numbers = tuple(range(first + 3, first + 3 + len(piece)))
        yield Table(name, headings, numbers, tuple(map(tuple, columns)))


def _is_finite(cell: str) -> bool:
    """Whether a ``cell`` is a finite number."""
    with suppress(ValueError):
        return math.isfinite(plain_float(cell))
    return False
