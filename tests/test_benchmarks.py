"""The page of benchmarks has the numbers of one run, in which every bound was kept."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))

import costs
import page


@pytest.fixture(scope="module")
def numbers():
    return json.loads(page.NUMBERS.read_text(encoding="utf-8"))


@pytest.mark.claim("benchmark-tables")
def test_the_tables_are_those_of_the_numbers(numbers):
    text = page.PAGE.read_text(encoding="utf-8")
    assert page.written(text, numbers) == text
    for name in (*page.TABLES, "machine", "costs"):
        assert text.count(f"<!-- {name}: ") == 1


def test_what_scenes_cost_was_measured_of_every_kind_there_is(numbers):
    assert [one["scene"] for one in numbers["costs"]["scenes"]] == list(costs.SCENES)
    timed = bool(numbers["costs"]["repeats"])
    assert {one["scene"] for one in numbers["costs"]["scenes"] if one["data"]} == (
        set(costs.LARGE) if timed else set()
    )
    for one in numbers["costs"]["scenes"]:
        assert one["modules"] or one["scene"].startswith(("velocities", "auto"))
        assert (one["bare"] is not None) == (timed and "figures" in one["calls"])


def test_no_measured_number_is_typed_into_the_text():
    text = re.sub(
        r"<!-- \w+: python .*?<!-- end -->",
        "",
        page.PAGE.read_text(encoding="utf-8"),
        flags=re.DOTALL,
    )
    assert re.findall(r"\d+(?:\.\d+)? ?(?:%|[kMG]i?B|m?s\b)|\b\d+\.\d+\b(?! diameters)", text) == []


@pytest.mark.claim("benchmark-tables")
def test_every_part_was_run_and_every_bound_kept(numbers):
    parts = [part for several in page.TABLES.values() for part in several]
    assert {*parts, "machine"} <= set(numbers)
    missed = [row.what for part in parts for row in page.rows(numbers[part]) if not row.passed]
    assert not missed
    assert {"processor", "cores", "python", "numpy", "scipy", "ase", "phonopy", "blas"} <= set(
        numbers["machine"]
    )
