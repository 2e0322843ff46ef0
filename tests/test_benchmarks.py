"""The page of benchmarks has the numbers of one run, in which every bound was kept."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))

import page


@pytest.fixture(scope="module")
def numbers():
    return json.loads(page.NUMBERS.read_text(encoding="utf-8"))


def test_the_tables_are_those_of_the_numbers(numbers):
    text = page.PAGE.read_text(encoding="utf-8")
    assert page.written(text, numbers) == text
    for name in (*page.TABLES, "machine"):
        assert text.count(f"<!-- {name}: ") == 1


def test_every_part_was_run_and_every_bound_kept(numbers):
    parts = [part for several in page.TABLES.values() for part in several]
    assert {*parts, "machine"} <= set(numbers)
    missed = [row.what for part in parts for row in page.rows(numbers[part]) if not row.passed]
    assert not missed
    assert {"processor", "cores", "python", "numpy", "scipy", "ase", "phonopy", "blas"} <= set(numbers["machine"])
