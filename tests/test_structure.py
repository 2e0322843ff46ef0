"""What import-linter, which holds the direction of imports, cannot say: nothing is loaded that was
not asked for.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import granphon
from tests import budget
from tests.budget import GUARDS

PACKAGE = Path(granphon.__file__).parent


def loaded_after(code: str) -> set[str]:
    run = subprocess.run(
        [
            sys.executable,
            "-W",
            "error",
            "-c",
            f"{code}\nimport sys\nprint('\\n'.join(sys.modules))",
        ],
        check=True,
        capture_output=True,
        text=True,
    )
    return set(run.stdout.split())


HEAVY = {"phonopy", "matplotlib", "spglib", "xarray", "h5netcdf"}


def heavy(modules: set[str]) -> set[str]:
    return {m for m in modules if m.split(".")[0] in HEAVY or m.startswith("ase.calculators")}


#: compiled loops over vectors and fields of balls, which know of no contact
OF_VECTORS = {"array/minimal_residuals.py", "statics/green.py", "statics/grid_iteration.py"}


def test_loops_over_contacts_are_compiled_in_one_room():
    files = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if "\n@compiled\n" in path.read_text(encoding="utf-8")
    }
    assert {name for name in files if not name.startswith("contacts/")} == OF_VECTORS


def test_importing_granphon_loads_nothing_heavy():
    modules = loaded_after("import granphon")
    assert not heavy(modules)
    assert not {m for m in modules if m.split(".")[0] in ("numpy", "scipy", "ase", "pint")}


def test_velocities_load_neither_phonopy_nor_matplotlib_nor_calculators():
    code = (
        "import granphon as gp\n"
        "state = gp.AveragedLattice(gp.Packing(gp.Material(70e9, 0.22, 2500.0),"
        " 1e-3)).at_force(1.0)\n"
        "gp.sound_velocities(state), gp.moduli(state), gp.pulse_velocities(state, 1e3)"
    )
    assert not heavy(loaded_after(code))


def test_public_names_stand_in_the_stub_which_type_checkers_read_and_nowhere_else():
    statements = ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8")).body[1:]
    listed = {"__version__"}
    for statement in statements:
        if isinstance(statement, ast.ImportFrom):
            (alias,) = statement.names
            # a name that a stub imports "as" itself is public for type checkers
            assert (statement.level, alias.asname) == (1, alias.name)
            listed.add(alias.name)
            assert getattr(granphon, alias.name).__module__ == f"granphon.{statement.module}"
        else:
            assert ast.unparse(statement) == "__version__: str"
    assert sorted(granphon.__all__) == sorted(listed)
    starred: dict[str, Any] = {}
    exec("from granphon import *", starred)
    assert listed <= set(starred)


def test_public_names_exist_and_are_documented():
    for name in granphon.__all__:
        value = getattr(granphon, name)
        assert name == "__version__" or value.__doc__, f"{name} has no docstring"
    assert set(granphon.__all__) <= set(dir(granphon))
    assert granphon.Material  # an imported name is listed once all the same
    assert len(dir(granphon)) == len(set(dir(granphon)))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = granphon.nonsense


#: places above the law that hold 3/2, 2/3, 1/3, 5/2, 2/5 or 5/3, or a cube root, and what they are
#: there
NOT_HERTZ = {
    "statics/options.py:": "how fast the gaps of the interior-point method are closed",
    "contacts/sliding.py:_find_rising_losses": "integrals of powers of h^(1/2): the closed form of Hertz and"
    " Mindlin in one step",
    "contacts/sliding.py:_find_falling_losses": "the same",
    "balls/ball.py:__post_init__": "inertia of a shell over that of a solid ball",
    "balls/diameters.py:cut_rms": "argument of the gamma function",
    "balls/lattices.py:": "places in a cell",
    "dynamics/contact_lattice.py:top_frequency": "wave vectors",
    "dynamics/local_field.py:compute_xi": "equations 35 and 45: six contacts at 60 degrees",
    "dynamics/local_field.py:_list_kinds": "place of a neighbour's far contact",
    "fits/velocity_model.py:velocity": "coefficients of a one-sided difference",
    "media/accuracy.py:compute_form_coefficients": "the skewness of a distribution",
    "media/left_out.py:": "tabulated forces",
    "observables/validity.py:_find_load_ratio": "the paper's criterion (f/E d^2)^(1/6)",
    "runs/plan.py:_estimate_waves": "a bound with a margin",
    "waves/propagation.py:order": "the width of Bessel functions near their turning point",
}
#: what states laws, averages Hertz's over distributions, or knows no contact
LAWFUL = ("balls/hertz.py", "balls/contact_laws.py", "laws/", "base/", "figures/", "cli/")
EXPONENTS = {1.5, 2.5, 0.4}
QUOTIENTS = {(3, 2), (2, 3), (1, 3), (5, 3), (5, 2), (2, 5), (1, 6)}


def holds_exponent(node: ast.AST) -> bool:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
        ends = [
            end.value if isinstance(end, ast.Constant) else None for end in (node.left, node.right)
        ]
        return tuple(ends) in QUOTIENTS
    if isinstance(node, ast.Constant):
        return isinstance(node.value, float) and node.value in EXPONENTS
    return isinstance(node, ast.Attribute) and node.attr == "cbrt"


def find_exponents(path: Path) -> set[str]:
    """Functions that hold an exponent; a number of the module that is one alone has a name and a
    reason of its own.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    lone = {id(node.value) for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign)}
    place = path.relative_to(PACKAGE).as_posix()

    places = set()
    nodes: list[tuple[ast.AST, str]] = [(tree, "")]
    while nodes:
        node, function = nodes.pop()
        if isinstance(node, ast.FunctionDef):
            function = node.name
        if holds_exponent(node) and not (isinstance(node, ast.Constant) and id(node) in lone):
            places.add(f"{place}:{function}")
        nodes += [(inner, function) for inner in ast.iter_child_nodes(node)]
    return places


ROOMS = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))


@pytest.mark.parametrize("room", [room for room in ROOMS if f"{room}/" not in LAWFUL])
def test_only_the_law_holds_its_exponents(room):
    """Hertz's law has one owner, granphon.balls.hertz: what is above it asks for forces,
    stiffnesses, energies by name.
    """
    paths = [
        path
        for path in (PACKAGE / room).rglob("*.py")
        if not path.relative_to(PACKAGE).as_posix().startswith(LAWFUL)
    ]
    excused = {place for place in NOT_HERTZ if place.startswith(f"{room}/")}
    assert set().union(*map(find_exponents, paths)) == excused


def test_every_excuse_for_an_exponent_is_of_a_room():
    assert {place.partition("/")[0] for place in NOT_HERTZ} <= set(ROOMS)


def test_every_guard_of_the_budget_is_a_test_and_there_are_few():
    for name in GUARDS:
        path, _, function = name.partition("::")
        text = (Path(__file__).parents[1] / path).read_text(encoding="utf-8")
        assert f"\ndef {function}(" in text, name
    assert len(GUARDS) <= 40


@pytest.mark.parametrize(
    ("counts", "runs", "passes"),
    [
        ([0.9], 1, True),
        ([2.0, 0.9], 2, True),
        ([2.0, 2.0, 0.9], 3, True),
        ([2.0, 2.0, 2.0], 3, False),
    ],
)
def test_a_case_over_the_budget_runs_again_and_then_counts(monkeypatch, counts, runs, passes):
    """``counts`` are the seconds of processor that the case takes in each of its runs."""
    logged = []
    hooks = {
        "pytest_runtest_logstart": lambda **_: None,
        "pytest_runtest_logreport": lambda report: logged.append(report.passed),
        "pytest_runtest_logfinish": lambda **_: None,
    }
    case = SimpleNamespace(
        nodeid="a case",
        location=None,
        stash=pytest.Stash(),
        ihook=SimpleNamespace(**hooks),
        get_closest_marker=lambda name: None,
    )
    remaining = [budget.LIMIT * count for count in counts]

    def run(item, log, nextitem):
        # a fixture that is long too does not make a first run the last
        try:
            for _ in range(2):
                budget.require_budget(item, "it", remaining[0])
        except pytest.fail.Exception:
            return [SimpleNamespace(passed=False)]
        finally:
            remaining.pop(0)
        return [SimpleNamespace(passed=True)]

    monkeypatch.setattr(budget, "IS_HELD", True)
    monkeypatch.setattr(budget, "runtestprotocol", run)
    assert budget.pytest_runtest_protocol(case, None)
    assert logged == [passes]
    assert len(counts) - len(remaining) == runs


# -- text that reads -------------------------------------------------------------------------------

#: names that say nothing: what a value is has a noun of the field, or a verb
_PRONOUNS = """
one other others found own here there at part told given taken more less rest those these it this
that such both way ways thing things what which its left right_ wanted needed asked seen known
before after next_ last_ nothing lost
"""
PRONOUNS = frozenset(_PRONOUNS.split())
#: places that are to be written anew, and keep their names until then
KEEP_NAMES = ("array/",)


class TextFacts:
    """Counts what makes a module hard to read, with the places of what is not allowed at all."""

    def __init__(self, path: Path) -> None:
        self.text = path.read_text(encoding="utf-8")
        self.packed = 0
        self.walruses = 0
        self.pronouns = 0
        self.forbidden: list[str] = []
        #: lines with tokens other than comments and docstrings
        self.lines: set[int] = set()
        for node in ast.walk(ast.parse(self.text)):
            if isinstance(node, ast.stmt):
                self.count_lines(node)
            if isinstance(node, ast.Assign):
                self.read_assignment(node)
            elif isinstance(node, ast.NamedExpr):
                self.walruses += 1
            elif isinstance(node, ast.IfExp):
                parts = [part for child in ast.iter_child_nodes(node) for part in ast.walk(child)]
                if any(isinstance(part, ast.IfExp) for part in parts):
                    self.forbid(node, "a conditional expression in another one")
            elif isinstance(node, ast.Call):
                is_getattr = isinstance(node.func, ast.Name) and node.func.id == "getattr"
                if is_getattr and isinstance(node.args[1], ast.JoinedStr):
                    self.forbid(node, "an attribute looked up by a composed text")
            elif isinstance(node, ast.ClassDef):
                for statement in node.body:
                    value = statement.value if isinstance(statement, ast.Assign) else None
                    if isinstance(value, ast.Call) and ast.unparse(value.func).startswith("_"):
                        self.forbid(statement, "an attribute made by a helper")

    def count_lines(self, node: ast.stmt) -> None:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return
        last = node.lineno if hasattr(node, "body") else node.end_lineno or node.lineno
        self.lines.update(range(node.lineno, last + 1))

    def read_assignment(self, node: ast.Assign) -> None:
        target = node.targets[0]
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            names = sorted(ast.unparse(name) for name in target.elts)
            is_swap = names == sorted(ast.unparse(value) for value in node.value.elts)
            self.packed += not is_swap
        self.pronouns += sum(
            isinstance(name, ast.Name) and name.id in PRONOUNS for name in ast.walk(target)
        )

    def forbid(self, node: ast.expr | ast.stmt, what: str) -> None:
        self.forbidden.append(f"line {node.lineno}: {what}")


def test_a_statement_does_one_thing_and_names_are_nouns_or_verbs():
    """The bounds leave room for the few places where another form would read worse."""
    facts = {
        path.relative_to(PACKAGE).as_posix(): TextFacts(path) for path in PACKAGE.rglob("*.py")
    }
    n_lines = sum(len(module.lines) for module in facts.values())
    assert sum(module.packed for module in facts.values()) <= 3e-3 * n_lines
    assert sum(module.walruses for module in facts.values()) <= 60
    named = [module for name, module in facts.items() if not name.startswith(KEEP_NAMES)]
    assert sum(module.pronouns for module in named) <= 200
    forbidden = {name: module.forbidden for name, module in facts.items() if module.forbidden}
    assert forbidden == {}
    assert sum(module.text.count("# fmt: skip") for module in facts.values()) <= 30
