"""The page of evidence is true, and no claim of the pages is missing from it; claims that no other test would show.

A claim is found by its look: a part in per cent, a power of ten below one, seconds or bytes, a number with its error in
brackets, and some words. Every such token of the prose of a page, and of the docstrings that the page of the interface
shows, must be in a row of docs/reference/validation.md under that page, and every one there must be on the page.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import math
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import ase.io
import numpy as np
import pytest
from test_docs import DOCS, PAGES, ROOT, blocks, links, name_of
from test_effective import kinds
from test_required import load

import granphon as gp
from granphon.balls.distributions import MOST_POINTS, NormalShape, UniformShape
from granphon.dynamics.local_field import local_field
from granphon.laws.effective import effective_curve
from granphon.laws.spread import STIFFNESS
from granphon.media.mean_field import _ByLaw
from granphon.tradeoffs.references import balance

PAGE = DOCS / "reference" / "validation.md"
#: pages that are tables of evidence themselves, each with the test or benchmark that makes it
EVIDENCE = {"errata.md", "reference/benchmarks.md", "reference/extremes.md"}
INTERFACE = "reference/api.md"

_CLAIM = re.compile(
    r"""\d[\d.]*\s?\\?%                                                            # 0.6 %
      | (?:[\d.]+\\cdot\s?)?10\^\{-\d+\}  |  (?<![\w.])[\d.]+e-\d+                # 2\cdot10^{-6}, 2e-6
      | (?<![\w.])[\d.]+\s(?:ms|s|kB|MB|GB|MiB|GiB)\b(?!\^)                       # 0.05 s
      | \d\.\d+\(\d+\)                                                            # 0.3423(5)
      | (?:to|within)\srounding | digit\sfor\sdigit | all\sdigits | (?:last|every)\sdigit
      | factor\sof\s\w+ | standard\serrors\sof\seach | \w+\stimes\s(?:faster|slower|as\slong)
    """,
    re.VERBOSE,
)
_PRODUCER = re.compile(
    r"`(?:(?P<test>tests/test_\w+\.py)::(?P<name>test_\w+)|python (?P<benchmark>tests/benchmarks[\w/.]*)(?P<options>[ \w-]*)"
    r"|(?P<example>examples/\w+\.py))`"
)


def normal(token: str) -> str:
    """One way to write a token: white space, TeX, exponents."""
    token = re.sub(r"\s+", " ", token.replace("\\%", "%"))
    token = re.sub(r"(\d)%", r"\1 %", token)
    token = re.sub(r"(?:([\d.]+)\\cdot ?)?10\^\{(-\d+)\}", lambda m: f"{m[1] or 1}e{m[2]}", token)
    return re.sub(r"e-0+", "e-", token)


def tokens(text: str) -> set[str]:
    return {normal(m[0]) for m in _CLAIM.finditer(text)}


def prose(page: Path) -> str:
    """A page without its code, and without tables that are made of the code."""
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"^<!-- (?!end).*?^<!-- end -->", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^```.*?^```\s*?$", "", text, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"`[^`\n]*`", "", text)


def docstrings() -> str:
    """What the page of the interface shows of the package."""
    found = []
    for kind, name in re.findall(
        r"^\.\. auto(class|function|module):: ([\w.]+)$", (DOCS / INTERFACE).read_text(), re.MULTILINE
    ):
        module, _, last = name.rpartition(".")
        thing: Any = importlib.import_module(name) if kind == "module" else getattr(importlib.import_module(module), last)
        found.append(inspect.getdoc(thing) or "")
        if kind != "function":
            members = (getattr(thing, member) for member in dir(thing) if not member.startswith("_"))
            found += [inspect.getdoc(m) or "" for m in members if inspect.isroutine(m) or isinstance(m, property)]
    return "\n".join(found)


def text_of(page: Path) -> str:
    return prose(page) + (docstrings() if name_of(page) == INTERFACE else "")


@cache
def rows() -> dict[str, list[tuple[str, str]]]:
    """Claims and what produces them, by the page that the heading links to."""
    parts = re.split(r"^### (.+)\n", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    found = {}
    for head, text in zip(parts[::2], parts[1::2], strict=True):
        link = re.fullmatch(r"\[[^\]]+\]\(([^)#]+)\)", head)
        page = (PAGE.parent / link[1]).resolve().relative_to(DOCS).as_posix() if link else head
        lines = re.findall(r"^\| (.+?) \| (.+) \|$", text, re.MULTILINE)
        assert lines[0] == ("claim", "produced by"), page
        found[page] = lines[1:]
    return found


def section(title: str) -> str:
    (text,) = re.findall(rf"^## {title}\n(.*?)(?=^## |\Z)", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return str(text)


def without() -> set[str]:
    """Pages that are said to claim nothing besides the values of their code."""
    targets = re.findall(r"\]\(([^)#\s]+)\)", section("Pages without more"))
    return {(PAGE.parent / target).resolve().relative_to(DOCS).as_posix() for target in targets}


# -- the page -----------------------------------------------------------------------------------------------------------


def test_every_page_is_in_the_table_or_said_to_claim_nothing():
    pages = {name_of(page) for page in PAGES} - {name_of(PAGE)}
    assert set(rows()) | without() == pages
    assert not set(rows()) & without()
    assert set(rows()) >= EVIDENCE


@pytest.mark.parametrize("page", [page for page in PAGES if page != PAGE], ids=name_of)
def test_no_claim_is_missing_and_none_is_out_of_date(page):
    if name_of(page) in EVIDENCE:
        return
    listed = tokens(" ".join(claim for claim, _ in rows().get(name_of(page), [])))
    there = tokens(text_of(page))
    assert there <= listed, f"{name_of(page)} claims {sorted(there - listed)}: say on {name_of(PAGE)} what produces it"
    # values of code, which another test compares, may be in a row too
    code = tokens(" ".join(text for _, _, text in blocks(page, "python", "console")))
    assert listed <= there | code, f"{name_of(PAGE)} has {sorted(listed - there)}, and {name_of(page)} has not"


def test_the_scan_finds_claims():
    found = r"0.6 %, 14\% below $2\cdot10^{-6}$, 1e-08, $10^{-4}$; 0.05 s, 3.5 GB; 0.3423(5), to rounding, five times slower"
    assert tokens(found) == {
        "0.6 %", "14 %", "2e-6", "1e-8", "1e-4", "0.05 s", "3.5 GB", "0.3423(5)", "to rounding", "five times slower",
    }  # fmt: skip
    assert not tokens("8 mm, 211.65 GPa, 18.446 N, 790.96 m/s, 1e13 Pa, 64 × 64, 31 balls, Section 4")


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
    for claim, producers in rows().get(page, []):
        found = list(_PRODUCER.finditer(producers))
        assert found or producers.startswith("blocks"), claim
        assert len(found) == producers.count("`") // 2, producers  # nothing else is in code
        for one in found:
            if one["test"]:
                assert one["name"] in named_in(one["test"]), one[0]
            elif one["example"]:
                assert "assert" in (ROOT / one["example"]).read_text(encoding="utf-8"), one[0]
            else:
                script = ROOT / one["benchmark"]
                asked = set(one["options"].partition("--only")[2].split())
                if script.is_dir():
                    known = set().union(*(parts_of(path.stem) for path in script.glob("bench_*.py")))
                else:
                    assert script.is_file(), one[0]
                    known = parts_of(script.stem)
                assert asked <= known, one[0]
                assert not known or asked, f"{one[0]}: which part?"
        if re.search(r"\bblocks\b", producers):
            where = page if page != "README.md" else "../README.md"
            assert blocks(DOCS / where, "python", "console"), f"{page} has no blocks"


def test_every_part_of_the_study_is_on_the_page():
    asked = re.findall(r"study_simulation\.py --only (\w+)`", PAGE.read_text(encoding="utf-8"))
    assert set(asked) == parts_of("study_simulation")


def test_the_page_links_to_every_page():
    assert {target.partition("#")[0] for target in links(PAGE)} >= {
        f"../{name}" if not name.startswith("reference/") else name.removeprefix("reference/")
        for name in {*rows(), *without()} - {"README.md"}
    }


# -- claims that no other test would show -------------------------------------------------------------------------------


def steel_packing(steel, **options):
    return gp.Packing(steel, 8e-3, gp.Uniform(2.04e-6), **options)


@pytest.mark.parametrize("shape", [UniformShape(), NormalShape(2.0), NormalShape(3.0), NormalShape(6.0)], ids=str)
@pytest.mark.parametrize("eta", [0.0, 0.84])
def test_the_curve_of_a_density_has_few_polynomials_and_forgives_little(shape, eta):
    xi = local_field(mindlin_ratio=eta).xi
    curve = effective_curve(shape, xi)
    assert 13 <= curve.places.shape[1] <= 17
    # G_k, about 0.01 at y = 0.3
    x, weights = shape.nodes(0.3)
    k = float(curve.value(np.array([0.3]), STIFFNESS)[0])
    terms = weights, shape.force(0.3, x), shape.stiffness(0.3, x), shape.stiffness_slope(0.3, x)
    assert balance(terms, k, xi)[2] == pytest.approx(0.01, rel=0.15)


def test_the_printed_local_field_changes_the_stiffness_by_half_a_per_cent(steel):
    packing = steel_packing(steel, friction=False)
    force = 0.08 * packing.law.coefficient * packing.width**1.5
    right, printed = (gp.EffectiveMedium(packing, local_field=word).at_force(force) for word in ("computed", "paper"))
    assert printed.normal_stiffness / right.normal_stiffness - 1.0 == pytest.approx(-0.005, abs=0.0005)


def test_a_large_lot_put_together_changes_the_force_by_little():
    off = np.random.default_rng(2).normal(size=10_000)
    lot = gp.Measured(8e-3 + 1e-6 * off)
    assert len(lot.shape.positions) <= MOST_POINTS < off.size
    x = (np.array(lot.diameters) - lot.mean) / lot.width
    y, total = -0.4, 0.0  # few contacts are left, f* = 7e-4
    for some in np.split(x, 50):
        gap = np.maximum(y + 0.5 * (some[:, None] + x), 0.0)
        total += float(np.sum(gap * np.sqrt(gap)))
    assert lot.shape.average(y, 1.5) == pytest.approx(total / x.size**2, rel=3e-6)


def test_rare_kinds_end_the_equation_far_below_its_validity():
    # as study_simulation.py has it of many more lists
    draw, found = np.random.default_rng(3), []
    for _ in range(5):
        off, rare = draw.uniform(-1.0, 1.0, 3), 10.0 ** draw.uniform(-6.0, -2.0, 2)
        curve = effective_curve(kinds(off.tolist(), [1.0 - np.sum(rare), *rare.tolist()]), local_field().xi)
        found.append(curve.least_force if curve.vanishes else 0.0)
    assert 1e-6 < max(found) < 1e-2


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


def test_the_limits_are_reached_together(steel):
    medium = gp.AveragedLattice(gp.Packing(steel, 8e-3))
    names = "contact_radius", "load", "velocity", "resonance"
    below, above = (gp.validity(medium.at_overlap(part * 8e-3)) for part in (0.0094 - 0.0006, 0.019))
    assert all(below[name].ok for name in names)
    assert not any(above[name].ok for name in names)


def test_the_spacing_loses_the_digits_of_the_overlap():
    overlap = 1e-12 * np.linspace(0.11, 0.97, 101)
    left = 1.0 - (1.0 - overlap)
    assert 1e-5 < np.max(np.abs(left / overlap - 1.0)) < 1e-3


def test_sound_is_seven_times_slower_than_in_steel(steel, state):
    assert steel.longitudinal_velocity / gp.sound_velocities(state).longitudinal == pytest.approx(7.0, abs=0.5)


def test_the_exponents_of_the_tutorial(steel):
    force = np.array([100.0, 990.0]) / (31.0 * math.sqrt(3.0))
    for medium, low in ((gp.AveragedLattice, 1.0 / 6.0), (gp.EffectiveMedium, 0.29)):
        found = gp.local_exponent(medium(gp.Packing(steel, 8e-3, gp.Uniform(2e-6))).at_force(force))
        assert found[0] == pytest.approx(low, abs=0.005)
        assert found[1] <= found[0]


@dataclass(frozen=True)
class Quadratic:
    """f = c delta_+^2, a contact law that is not Hertz's, as the page on development has tried it; c in N/m^2."""

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
class Softer(_ByLaw):
    name = "softer"
    packing: gp.Packing

    @property
    def law(self):
        return self._law

    @property
    def _law(self):
        return Quadratic(1e12)


def test_another_contact_law(steel):
    state = Softer(gp.Packing(steel, 8e-3, friction=False)).at_force(10.0)
    assert gp.local_exponent(state) == pytest.approx(0.25, rel=1e-14)
    sheet = gp.atoms(state).repeat((3, 3, 1))
    sheet.calc = gp.HertzMindlin(state)
    sheet.rattle(stdev=0.1 * state.relative_overlap, seed=2)
    forces, step = sheet.get_forces(), 1e-2 * state.relative_overlap
    for ball, axis in ((0, 0), (4, 1), (8, 0)):
        energies = []
        for move in (-step, step):
            other = sheet.copy()
            other.positions[ball, axis] += move
            other.calc = gp.HertzMindlin(state)
            energies.append(other.get_potential_energy())
        assert (energies[0] - energies[1]) / (2.0 * step) == pytest.approx(forces[ball, axis], abs=1e-13)
