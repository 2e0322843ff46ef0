"""The table of the numbers of statics and of loading with friction."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import pathlib

import pytest

import granphon
from granphon.statics import options

TABLES = [
    table
    for _, table in inspect.getmembers(options, inspect.isclass)
    if dataclasses.is_dataclass(table)
]
ROOMS = ("array", "contacts", "statics")
PACKAGE = pathlib.Path(granphon.__path__[0])
MODULES = sorted(path for room in ROOMS for path in (PACKAGE / room).glob("*.py"))
#: what a caller asks for, and no number of a method: threads change only the time of the computer,
#: and a flag names the mean force that the caller's tolerance refers to
ASKED = ("workers", "of_all")
#: numbers of modules of these rooms that are no options of a method, by what they are
OUTSIDE = {
    "what an array may be asked for": """
        array.options.LARGEST_RATIO array.options.START_SPACING array.options.REFINEMENT_TOLERANCE
        """,
    "what files and results are": """
        array.atoms.LATTICE array.atoms.FINITE array.atoms.SAMPLE array.atoms.ARRAYS
        array.atoms._TILT array.atoms._DECIMALS array.hexagon._NORMALS array.sample.STEP
        array.sample._TOLERANCE contacts.friction.SLIDING_RATIO
        """,
    "elements that a loop or a cache holds, and the columns of a loop": """
        array.minimal_residuals._LENGTH array.stencils._CACHE_ELEMENTS contacts.grid._KEPT_BALLS
        contacts.grid._SHARED_CELLS
        contacts.grid_loops._CONTACTS_AT_ONCE contacts.grid_loops._CONTACTS_IN_CACHE
        contacts.grid_loops._LANES contacts.grid_product._PLACES_AT_ONCE
        contacts.grid_product._BALLS_AT_ONCE contacts.motion._N_SLIPS
        contacts.motion._ROWS_OF_SLIP contacts.motion_loops contacts.rolling_tangent._CHUNK
        contacts.shift_product._CACHE_BYTES contacts.shift_product._LEAST_RATIO
        contacts.shift_product._PRODUCTS_OF_THREAD contacts.tangent._KEPT_PATTERNS
        contacts.tangent._KEPT_BALLS statics.transforms._MOST_PRODUCTS
        """,
    "times and memory that are estimated": """
        array.hexagon._BALL_BYTES array.sparse_matrices.LARGEST_UNSYMMETRIC
        array.sparse_matrices.LARGEST_FACTORS array.sparse_matrices._FACTORS_TIME
        array.sparse_matrices._FACTORS_BYTES array.sparse_matrices._LIBRARY_BYTES
        """,
    "rounding, and numbers of a formula": """
        array.load_step._LOOSE_RESIDUAL array.minimal_residuals._CANCELLATION
        array.stencils._ROUNDING array.stencils._LEAST_SINE contacts.assembly.ROUNDING
        contacts.grid._ROUNDING contacts.motion_laws._GAUSS_POINT contacts.motion_laws._GAUSS_RANGE
        contacts.sliding._LEAST_DIVISOR
        contacts.slips._SERIES_SQUARE statics.grid_problem._WIDTH_OVER_RMS
        """,
    "how exactly an array is at rest": """
        array.equilibrium.REST_TOLERANCE array.rest._LOAD_PART array.rest._PART_OF_RATIO
        array.rest.LEAST_TOLERANCE array.sheared_equilibrium._MOST_PRESSURES
        array.true_equilibrium._LEAST_DISTANCE
        """,
}
ALLOWED = {name for names in OUTSIDE.values() for name in names.split()}


def list_numbers(table):
    """The names of the numbers of a table, without those of tables within it."""
    return [
        field.name
        for field in dataclasses.fields(table)
        if not dataclasses.is_dataclass(getattr(table(), field.name))
    ]


def list_tuned(table):
    """The names of the numbers of a table that a method takes, whoever asks."""
    return [name for name in list_numbers(table) if name not in ASKED]


def list_constants(path):
    """The names of the constants of a module that are set by a number."""
    names = []
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        value = getattr(node, "value", None)
        if not isinstance(node, ast.Assign | ast.AnnAssign) or value is None:
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        parts = [part.value for part in ast.walk(value) if isinstance(part, ast.Constant)]
        if any(isinstance(part, int | float) and not isinstance(part, bool) for part in parts):
            names += [target.id for target in targets if isinstance(target, ast.Name)]
    return names


def test_numbers_are_few():
    assert sum(len(list_tuned(table)) for table in TABLES) <= 130


@pytest.mark.parametrize("table", TABLES)
def test_each_number_has_its_reason(table):
    for name in list_numbers(table):
        told = [line for line in table.__doc__.splitlines() if " : " in line and name in line]
        assert any(name in line.split(" : ")[0].replace(",", "").split() for line in told), name


def test_numbers_of_modules_are_found(tmp_path):
    module = tmp_path / "module.py"
    module.write_text("A = 1e-3\nB: int = 2**4\nC = round(0.5)\nD = 'word'\nE = len('word')\n")
    assert list_constants(module) == ["A", "B", "C"]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: f"{path.parent.name}.{path.stem}")
def test_no_number_stands_outside_the_table(path):
    module = f"{path.parent.name}.{path.stem}"
    found = {f"{module}.{name}" for name in list_constants(path)}
    assert module in ALLOWED or found <= ALLOWED, found - ALLOWED
