"""Each claim of the pages has its row in docs/reference/validation.md, and its test; claims that no
other test would show.

A claim is found by its id: `<!-- claim: ID -->` beside the sentence, the first cell of the row, and
the mark `claim` of the tests that the row names.
"""

from __future__ import annotations

import ast
import math
import re
from dataclasses import dataclass
from functools import cache

import ase.io
import numpy as np
import pytest

import granphon as gp
from granphon.balls.diameters import MOST_POINTS, NormalShape, UniformShape
from granphon.balls.hertz import STIFFNESS
from granphon.dynamics.local_field import local_field
from granphon.laws.effective import effective_curve
from granphon.media.medium import LawMedium
from tests.conftest import only
from tests.laws.test_effective import kinds
from tests.references import balance
from tests.test_docs import DOCS, PAGES, ROOT, blocks, links, name_of
from tests.test_required import load

PAGE = DOCS / "reference" / "validation.md"

_CLAIM = re.compile(r"<!-- claim: ([a-z0-9-]+) -->")
_PRODUCER = re.compile(
    r"`(?:(?P<test>tests/(?:\w+/)?test_\w+\.py)::(?P<name>test_\w+)"
    r"|python (?P<benchmark>tests/benchmarks[\w/.]*)(?P<options>[ \w-]*)"
    r"|(?P<example>examples/\w+\.py)|(?P<blocks>blocks))`"
)


@dataclass(frozen=True)
class Row:
    """A claim, and what produces it."""

    id: str
    producers: str

    @property
    def tests(self) -> set[str]:
        return {
            f"{one['test']}::{one['name']}"
            for one in _PRODUCER.finditer(self.producers)
            if one["test"]
        }


@cache
def rows() -> dict[str, list[Row]]:
    """The rows of each page, which the heading above them links to."""
    tables = PAGE.read_text(encoding="utf-8").partition("<!-- without claims -->")[0]
    parts = re.split(r"^### (.+)\n", tables, flags=re.MULTILINE)[1:]
    found = {}
    for head, text in zip(parts[::2], parts[1::2], strict=True):
        link = re.fullmatch(r"\[[^\]]+\]\(([^)#]+)\)", head)
        page = (PAGE.parent / link[1]).resolve().relative_to(DOCS).as_posix() if link else head
        # the first row is the heads
        _, *lines = re.findall(r"^\| (.+?) \| (.+) \|$", text, re.MULTILINE)
        found[page] = [Row(*line) for line in lines]
    return found


#: a mark of evidence, before a test
_MARK = re.compile(r"^@pytest\.mark\.claim\(([^)]*)\)$", re.MULTILINE)


@cache
def marked() -> dict[str, set[str]]:
    """Tests that are marked as evidence, by the id of the claim."""
    found: dict[str, set[str]] = {}
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        text = path.read_text(encoding="utf-8")
        for mark in _MARK.finditer(text):
            test = re.compile(r"^def (\w+)", re.MULTILINE).search(text, mark.end())
            assert test is not None
            for name in re.findall(r'"([^"]+)"', mark[1]):
                place = f"{path.relative_to(ROOT).as_posix()}::{test[1]}"
                found.setdefault(name, set()).add(place)
    return found


def without() -> set[str]:
    """Pages that are said to claim nothing besides the values of their code."""
    (text,) = re.findall(
        r"<!-- without claims -->(.*?)<!-- end -->", PAGE.read_text(encoding="utf-8"), re.DOTALL
    )
    targets = re.findall(r"\]\(([^)#\s]+)\)", text)
    return {(PAGE.parent / target).resolve().relative_to(DOCS).as_posix() for target in targets}


# -- the page --------------------------------------------------------------------------------------


def test_every_page_is_in_the_table_or_said_to_claim_nothing():
    pages = {name_of(page) for page in PAGES} - {name_of(PAGE)}
    assert set(rows()) | without() == pages
    assert not set(rows()) & without()


@pytest.mark.parametrize("page", [page for page in PAGES if page != PAGE], ids=name_of)
def test_each_claim_of_a_page_has_its_row_and_each_row_its_claim(page):
    there = _CLAIM.findall(page.read_text(encoding="utf-8"))
    assert len(there) == len(set(there)), "an id stands at one place"
    assert set(there) == {row.id for row in rows().get(name_of(page), [])}


def test_each_claim_has_an_id_of_its_own_and_each_marked_test_a_claim():
    ids = [row.id for claims in rows().values() for row in claims]
    assert len(ids) == len(set(ids))
    assert marked().keys() <= set(ids)


@pytest.mark.parametrize(
    "row", [row for claims in rows().values() for row in claims], ids=lambda row: row.id
)
def test_the_tests_of_a_row_are_those_that_are_marked_with_its_id(row):
    assert row.tests == marked().get(row.id, set())


@cache
def named_in(path: str) -> set[str]:
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@cache
def parts_of(script: str) -> set[str]:
    """Parts that a benchmark knows; none of one that has no parts."""
    module = load(script)
    return set(getattr(module, "PARTS", {})) | set(getattr(module, "HUGE_PARTS", {}))


@pytest.mark.parametrize("page", [name_of(page) for page in PAGES])
def test_what_produces_a_claim_exists(page):
    for row in rows().get(page, []):
        producers = row.producers
        found = list(_PRODUCER.finditer(producers))
        assert found, row.id
        assert len(found) == producers.count("`") // 2, producers  # nothing else is in code
        for one in found:
            if one["test"]:
                assert one["name"] in named_in(one["test"]), one[0]
            elif one["blocks"]:
                where = page if page != "README.md" else "../README.md"
                assert blocks(DOCS / where, "python", "console"), f"{page} has no blocks"
            elif one["example"]:
                assert "assert" in (ROOT / one["example"]).read_text(encoding="utf-8"), one[0]
            else:
                script = ROOT / one["benchmark"]
                asked = set(one["options"].partition("--only")[2].split())
                if script.is_dir():
                    known = set().union(
                        *(parts_of(path.stem) for path in script.glob("bench_*.py"))
                    )
                else:
                    assert script.is_file(), one[0]
                    known = parts_of(script.stem)
                assert asked <= known, one[0]
                assert not known or asked, f"{one[0]}: which part?"


def test_every_part_of_the_study_is_on_the_page():
    asked = re.findall(r"study_simulation\.py --only (\w+)`", PAGE.read_text(encoding="utf-8"))
    assert set(asked) == parts_of("study_simulation")


def test_the_page_links_to_every_page():
    assert {target.partition("#")[0] for target in links(PAGE)} >= {
        f"../{name}" if not name.startswith("reference/") else name.removeprefix("reference/")
        for name in {*rows(), *without()} - {"README.md"}
    }


# -- claims that no other test would show ----------------------------------------------------------


def steel_packing(steel, **options):
    return gp.Packing(steel, 8e-3, gp.Uniform(2.04e-6), **options)


@pytest.mark.claim("few-polynomials")
@pytest.mark.parametrize(
    "shape",
    only(
        [UniformShape(), NormalShape(3.0)],
        [UniformShape(), *(NormalShape(cutoff) for cutoff in (2.0, 3.0, 6.0))],
    ),
    ids=str,
)
@pytest.mark.parametrize("eta", [0.0, 0.84])
def test_the_curve_of_a_density_has_few_polynomials_and_forgives_little(shape, eta):
    xi = local_field(mindlin_ratio=eta).xi
    curve = effective_curve(shape, xi)
    assert 13 <= curve.steps.shape[1] <= 17
    # G_k, about 0.01 at y = 0.3
    x, weights = shape.nodes(0.3)
    k = float(curve.value(np.array([0.3]), STIFFNESS)[0])
    terms = weights, shape.force(0.3, x), shape.stiffness(0.3, x), shape.stiffness_slope(0.3, x)
    assert balance(terms, k, xi)[2] == pytest.approx(0.01, rel=0.15)


@pytest.mark.claim("printed-local-field")
def test_the_printed_local_field_changes_the_stiffness_by_half_a_per_cent(steel):
    packing = steel_packing(steel, friction=False)
    force = 0.08 * packing.law.coefficient * packing.width**1.5
    right, printed = (
        gp.EffectiveMedium(packing, local_field=word).at_force(force)
        for word in ("computed", "paper")
    )
    assert printed.normal_stiffness / right.normal_stiffness - 1.0 == pytest.approx(
        -0.005, abs=0.0005
    )


@pytest.mark.claim("places-of-a-lot")
def test_a_large_lot_put_together_changes_the_force_by_little():
    off = np.random.default_rng(2).normal(size=4_000)
    lot = gp.Measured(8e-3 + 1e-6 * off)
    assert len(lot.shape.positions) <= MOST_POINTS < off.size
    x = (np.array(lot.diameters) - lot.mean) / lot.width
    y = -0.4
    total = 0.0  # few contacts are left, f* = 7e-4
    for some in np.split(x, 20):
        gap = np.maximum(y + 0.5 * (some[:, None] + x), 0.0)
        total += float(np.sum(gap * np.sqrt(gap)))
    assert lot.shape.average(y, 1.5) == pytest.approx(total / x.size**2, rel=3e-6)


@pytest.mark.claim("rare-kinds-end")
@pytest.mark.exhaustive
def test_rare_kinds_end_the_equation_far_below_its_validity():
    # as study_simulation.py has it of many more lists
    draw = np.random.default_rng(3)
    found = []
    for _ in range(5):
        off = draw.uniform(-1.0, 1.0, 3)
        rare = 10.0 ** draw.uniform(-6.0, -2.0, 2)
        curve = effective_curve(
            kinds(off.tolist(), [1.0 - np.sum(rare), *rare.tolist()]), local_field().xi
        )
        found.append(curve.least_force if curve.has_zero_stiffness else 0.0)
    assert 1e-6 < max(found) < 1e-2


@pytest.mark.claim("extxyz-of-ase")
def test_forces_read_from_extxyz(steel, tmp_path):
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3)).at_overlap(8e-8)
    worst = 0.0
    for part in (0.0, 0.01, 0.1):
        sheet = gp.atoms(state).repeat((6, 6, 1))
        sheet.calc = gp.HertzMindlin(state)
        sheet.rattle(stdev=part * state.relative_overlap, seed=1)
        ase.io.write(tmp_path / "sheet.extxyz", sheet)
        again = ase.io.read(tmp_path / "sheet.extxyz")
        again.calc = gp.HertzMindlin(state)
        worst = max(worst, float(np.max(np.abs(again.get_forces() - sheet.get_forces()))))
    assert worst * state.scales.force / state.force == pytest.approx(0.005, rel=0.25)


@pytest.mark.claim("limits-together")
def test_the_limits_are_reached_together(steel):
    medium = gp.AveragedLattice(gp.Packing(steel, 8e-3))
    names = "contact_radius", "load", "velocity", "resonance"
    below, above = (
        gp.validity(medium.at_overlap(part * 8e-3)) for part in (0.0094 - 0.0006, 0.019)
    )
    assert all(below[name].ok for name in names)
    assert not any(above[name].ok for name in names)


@pytest.mark.claim("spacing-loses-digits", "api-spacing", "state-variable")
def test_the_spacing_loses_the_digits_of_the_overlap():
    overlap = 1e-12 * np.linspace(0.11, 0.97, 101)
    left = 1.0 - (1.0 - overlap)
    assert 1e-5 < np.max(np.abs(left / overlap - 1.0)) < 1e-3


@pytest.mark.claim("slower-than-steel")
def test_sound_is_seven_times_slower_than_in_steel(steel, state):
    assert steel.longitudinal_velocity / gp.sound_velocities(state).longitudinal == pytest.approx(
        7.0, abs=0.5
    )


@pytest.mark.claim("tutorial-exponents")
def test_the_exponents_of_the_tutorial(steel):
    force = np.array([100.0, 990.0]) / (31.0 * math.sqrt(3.0))
    for medium, low in ((gp.AveragedLattice, 1.0 / 6.0), (gp.EffectiveMedium, 0.29)):
        found = gp.local_exponent(medium(gp.Packing(steel, 8e-3, gp.Uniform(2e-6))).at_force(force))
        assert found[0] == pytest.approx(low, abs=0.005)
        assert found[1] <= found[0] + 1e-12  # rounding


@dataclass(frozen=True)
class Quadratic:
    """f = c delta_+^2, a contact law that is not Hertz's, as the page on development has tried it;
    c in N/m^2.
    """

    coefficient: float
    least_overlap: float = 0.0

    def energy(self, overlap):
        return self.coefficient / 3.0 * np.maximum(overlap, 0.0) ** 3

    def force(self, overlap):
        return self.coefficient * np.maximum(overlap, 0.0) ** 2

    def stiffness(self, overlap):
        return 2.0 * self.coefficient * np.maximum(overlap, 0.0)

    def stiffness_slope(self, overlap):
        return 2.0 * self.coefficient * (np.asarray(overlap) > 0.0)

    def overlap(self, force):
        return np.sqrt(np.asarray(force) / self.coefficient)


@dataclass(frozen=True)
class Softer(LawMedium):
    name = "softer"
    packing: gp.Packing

    @property
    def law(self):
        return self.spread_law

    @property
    def spread_law(self):
        return Quadratic(1e12)


@pytest.mark.claim("another-law")
def test_another_contact_law(steel):
    state = Softer(gp.Packing(steel, 8e-3, friction=False)).at_force(10.0)
    assert gp.local_exponent(state) == pytest.approx(0.25, rel=1e-14)
    sheet = gp.atoms(state).repeat((3, 3, 1))
    sheet.calc = gp.HertzMindlin(state)
    sheet.rattle(stdev=0.1 * state.relative_overlap, seed=2)
    forces = sheet.get_forces()
    step = 1e-2 * state.relative_overlap
    for ball, axis in ((0, 0), (4, 1), (8, 0)):
        energies = []
        for move in (-step, step):
            other = sheet.copy()
            other.positions[ball, axis] += move
            other.calc = gp.HertzMindlin(state)
            energies.append(other.get_potential_energy())
        assert (energies[0] - energies[1]) / (2.0 * step) == pytest.approx(
            forces[ball, axis], abs=1e-13
        )
