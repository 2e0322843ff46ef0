"""The architecture, kept true: one direction of imports, and nothing loaded that was not asked for."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import granphon

PACKAGE = Path(granphon.__file__).parent

#: each module imports only from those before it
ORDER = [
    "errors", "arguments", "reading", "digests", "units", "progress", "files", "results", "staging", "quantities",
    "blocks", "tables",
    "contact", "shapes", "diameters", "geometry", "packing", "parameters", "jacobi", "compatibility", "longwave", "lattice",
    "local_field", "laws", "curve", "collocation", "points", "effective", "branches", "state", "medium",
    "stencils", "equilibrium", "response", "balls", "samples", "simulation", "direct", "cost", "accuracy", "ladder", "plan",
    "acoustics", "limits", "observables", "ensemble",
    "pairs", "calculator", "spectra", "bridge", "phonons", "references",
    "tasks", "archive", "jobs", "sweeps", "measurements", "velocity_model", "goodness", "fit", "studies", "tradeoffs",
    "rules", "schema", "load", "scene", "style", "scales", "plot", "charts", "diagrams", "redraw", "run", "wording",
    "workers", "cli", "__main__",
]  # fmt: skip
#: the one module that may import each of these
BORDERS = {
    "ase.calculators": {"calculator"}, "phonopy": {"bridge", "phonons"},
    "matplotlib": {"style", "scales", "plot", "charts", "diagrams"}, "typer": {"cli"},
    "yaml": {"reading"}, "h5py": {"archive"},
}  # fmt: skip


def imports(module: str, top_level_only: bool = False) -> set[str]:
    """Modules that a module of the package imports, by their full names."""
    tree = ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))
    found: set[str] = set()
    for node in tree.body if top_level_only else ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
            if node.module == "granphon":
                found |= {f"granphon.{alias.name}" for alias in node.names}
    return found


def test_the_order_lists_every_module():
    modules = {path.stem for path in PACKAGE.glob("*.py")} - {"__init__"}
    assert modules == set(ORDER)


@pytest.mark.parametrize("module", ORDER)
def test_imports_point_one_way(module):
    before = ORDER[: ORDER.index(module)]
    own = {name.split(".")[1] for name in imports(module) if name.startswith("granphon.")} & set(ORDER)
    # Scene.run is a name of the contract, and hands over to the module that carries scenes out
    allowed = {*before, "run"} if module == "scene" else set(before)
    assert own <= allowed, f"{module} imports {own - allowed}"
    assert not {name for name in imports(module, top_level_only=True) if name == "granphon.scene.run"} or module in (
        "cli",
        "__main__",
    )


@pytest.mark.parametrize(("package", "homes"), BORDERS.items())
def test_each_library_has_one_door(package, homes):
    users = {m for m in ORDER if any(name == package or name.startswith(package + ".") for name in imports(m))}
    assert users <= homes


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
    assert not {m for m in modules if m.split(".")[0] in ("numpy", "scipy", "ase", "pydantic", "pint")}


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
    assert not heavy(modules)
    assert (tmp_path / "out" / "summary.yaml").is_file()


def test_public_names_exist_and_are_documented():
    for name in granphon.__all__:
        value = getattr(granphon, name)
        assert name == "__version__" or value.__doc__, f"{name} has no docstring"
    assert set(granphon.__all__) <= set(dir(granphon))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = granphon.nonsense
