"""The architecture, kept true: one direction of imports, and nothing loaded that was not asked for."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

import granphon

PACKAGE = Path(granphon.__file__).parent
ROOT = Path(__file__).parent.parent


def contract(name: str) -> dict[str, Any]:
    """A contract of import-linter, as pyproject.toml has it."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"]
    return next(one for one in contracts if one["id"] == name)


#: the level of each package, the ground first; packages of one level do not know each other
LEVELS = {
    room.strip(): level for level, rooms in enumerate(reversed(contract("rooms")["layers"])) for room in rooms.split("|")
}
MODULES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py"))


def imports(module: Path) -> set[str]:
    """Modules that a module of the package imports, those for types included, by their full names."""
    found: set[str] = set()
    for node in ast.walk(ast.parse((PACKAGE / module).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def test_the_top_folder_holds_the_public_names_and_the_packages():
    files = {path.name for path in PACKAGE.iterdir() if path.is_file()}
    assert files == {"__init__.py", "__init__.pyi", "__main__.py", "py.typed"}
    packages = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert packages == LEVELS.keys() - {"__main__"}
    for package in packages:
        assert (PACKAGE / package / "__init__.py").read_text(encoding="utf-8").startswith('"""')


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_a_module_imports_from_its_own_package_and_those_below_it(module):
    """What import-linter holds, for those who run the tests without it."""
    if len(module.parts) == 1:
        return
    own = module.parts[0]
    for name in imports(module):
        if name.startswith("granphon.") and (other := name.split(".")[1]) in LEVELS:
            assert other == own or LEVELS[other] < LEVELS[own], f"{module} imports {name}"


def test_calculators_of_ase_have_one_door():
    """A part of ASE, which import-linter does not tell from the rest."""
    users = {module for module in MODULES if any(name.startswith("ase.calculators") for name in imports(module))}
    assert users == {Path("phonons/calculator.py")}


def loaded_after(code: str) -> set[str]:
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", f"{code}\nimport sys\nprint('\\n'.join(sys.modules))"],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    return set(run.stdout.split())


HEAVY = {"phonopy", "matplotlib", "spglib", "xarray", "h5netcdf"}


def heavy(modules: set[str]) -> set[str]:
    return {m for m in modules if m.split(".")[0] in HEAVY or m.startswith("ase.calculators")}


def test_importing_granphon_loads_nothing_heavy():
    modules = loaded_after("import granphon")
    assert not heavy(modules)
    assert not {m for m in modules if m.split(".")[0] in ("numpy", "scipy", "ase", "pint")}


def test_velocities_load_neither_phonopy_nor_matplotlib_nor_calculators():
    code = (
        "import granphon as gp\n"
        "state = gp.AveragedLattice(gp.Packing(gp.Material(70e9, 0.22, 2500.0), 1e-3)).at_force(1.0)\n"
        "gp.sound_velocities(state), gp.moduli(state), gp.pulse_velocities(state, 1e3)"
    )
    assert not heavy(loaded_after(code))


def test_a_scene_of_velocities_loads_neither_phonopy_nor_matplotlib_nor_calculators(tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "material: {young_modulus: 70 GPa, poisson_ratio: 0.22, density: 2500 kg/m^3}\n"
        "packing: {diameter: 1 mm}\nload: {force: 1 N}\n",
        encoding="utf-8",
    )
    code = (
        f"from granphon.cli.commands import main\nassert main(['run', {str(scene)!r}, '-o', {str(tmp_path / 'out')!r}]) == 0"
    )
    modules = loaded_after(code)
    assert {one.split(".")[0] for one in heavy(modules)} == {"xarray", "h5netcdf"}  # for the data set
    assert (tmp_path / "out" / "summary.yaml").is_file()


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
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = granphon.nonsense
