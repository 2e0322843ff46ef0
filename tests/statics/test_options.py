"""The table of the numbers of statics."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import pathlib

import pytest

import granphon.statics
from granphon.statics import options

TABLES = [
    table
    for _, table in inspect.getmembers(options, inspect.isclass)
    if dataclasses.is_dataclass(table)
]
MODULES = sorted(pathlib.Path(granphon.statics.__path__[0]).glob("*.py"))


def list_numbers(table):
    """The names of the numbers of a table, without those of tables within it."""
    return [
        field.name
        for field in dataclasses.fields(table)
        if not dataclasses.is_dataclass(getattr(table(), field.name))
    ]


def test_numbers_are_few():
    assert sum(len(list_numbers(table)) for table in TABLES) <= 130


@pytest.mark.parametrize("table", TABLES)
def test_each_number_has_its_reason(table):
    for name in list_numbers(table):
        told = [line for line in table.__doc__.splitlines() if " : " in line and name in line]
        assert any(name in line.split(" : ")[0].replace(",", "").split() for line in told), name


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_no_number_stands_outside_the_table(path):
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        value = getattr(node, "value", None)
        if isinstance(node, ast.Assign | ast.AnnAssign) and value is not None:
            constants = [part.value for part in ast.walk(value) if isinstance(part, ast.Constant)]
            # a factor of geometry is no tuned number
            is_formula = any(isinstance(part, ast.Call) for part in ast.walk(value))
            numbers = [one for one in constants if isinstance(one, int | float)]
            assert not numbers or is_formula, ast.unparse(node)
