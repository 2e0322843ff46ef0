"""The core runs on numpy, scipy and numba; what needs another package says which, and how to install
it.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from pathlib import Path

import pytest

from granphon.base.errors import EXTRAS
from tests.conftest import only
from tests.warm import Warm

#: the packages beyond numpy, scipy and numba, each of which may be absent
KNOWN = ["ase", "phonopy", "spglib", *EXTRAS["scenes"], "distributed"]
PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))[
    "project"
]

#: what hides packages in a process of its own, as if they were not installed
HIDE = """
import sys

class Hidden:
    def __init__(self, finder):
        self.finder = finder

    def __getattr__(self, name):
        return getattr(self.finder, name)

    def find_spec(self, name, path=None, target=None):
        return None if name.partition(".")[0] in HIDDEN else self.finder.find_spec(name, path, target)

sys.meta_path[:] = map(Hidden, sys.meta_path)
"""
#: what is computed with
GIVEN = """
import dataclasses, os, tempfile
import numpy as np
import granphon as gp
steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2e-6))
"""
#: what the core is, each line with numbers to compare
CORE = """
lattice = gp.ContactLattice.of(packing.structure, packing.mindlin_ratio)
print(lattice.frequencies([[0.1, 0.2]]).tolist(), lattice.elastic_tensor().tolist())
for medium in (gp.AveragedLattice, gp.AveragedForce, gp.EffectiveMedium):
    state = medium(packing).at_force([2.0, 20.0])
    v, w = gp.sound_velocities(state), gp.pulse_velocities(state, frequency=6500.0)
    print(v.longitudinal, gp.moduli(state).bulk, gp.local_exponent(state), w.group, gp.validity(state).ok)
simulated = gp.DirectSimulation(packing, (8, 8), seed=0).at_force(20.0)
print(gp.sound_velocities(simulated).longitudinal, simulated.sample.network.n_contacts)
crystal = gp.Crystal.on("fcc", [gp.Ball(steel, 8e-3)], law=gp.JKR(0.1)).at_pressure(1e4)
print(gp.sound_velocities(crystal, (1, 1, 0)).velocities, crystal.network.n_contacts)
chain = gp.Crystal.on("chain", [gp.Ball(steel, 8e-3)]).repeat((30,)).at_force(5.0).network
waves = gp.Waves(chain)
disordered = gp.Waves(simulated.sample)
q = disordered.nearest_wavevectors([[100.0, 0.0]])
print(disordered.spectral_function(q, resolution=2000.0).values.tolist())
print(waves.modes(4).frequencies, waves.response([900.0], (0, "x"), (9, "x"), loss_factor=0.1).values)
motion = gp.NonlinearWaves(chain).run(1e-4, velocities=1e-3 * np.eye(30)[3][:, None], frames=3)
print(motion.displacements[-1, :, 0].tolist())
cell = gp.Crystal.on("fcc", [gp.Ball(steel, 8e-3)]).at_force(5.0).network.repeat((2, 2, 1))
turns = cell.torsion_stiffness + 1.0
cell = dataclasses.replace(cell, torsion_stiffness=turns, bending_stiffness=2.0 * turns)
start = 0.1 * np.random.default_rng(1).standard_normal((cell.n_balls, 3))
turning = gp.NonlinearWaves(cell, friction_coefficient=0.2, geometry="exact").run(3e-5, velocities=start, frames=2)
print(turning.displacements.tolist(), turning.spins.tolist(), turning.forces.tolist(), turning.shears.tolist())
"""
#: what needs other packages than numpy and scipy, by name: what does it, and the packages
FEATURES = {
    "velocities": ("gp.sound_velocities(state), gp.moduli(state), gp.validity(state)", ()),
    "tables": (
        "network.write_tables('b.csv', 'c.csv'), gp.ContactNetwork.from_table('b.csv', 'c.csv')",
        (),
    ),
    "motion file": ("motion.write('m.nc'), gp.Motion.read('m.nc')", ()),
    "fit": ("gp.fit_width(packing, [2.0, 5.0, 10.0], [485.0, 590.0, 690.0])", ()),
    "atoms": ("gp.atoms(state).get_potential_energy()", ("ase",)),
    "sample of atoms": ("sample.atoms()", ("ase",)),
    "structure": ("gp.write_extxyz('a.xyz', gp.atoms(state))", ("ase",)),
    "bands": ("gp.Phonons(state).bands().write('b.yaml')", ("ase",)),
    "density of states": ("gp.Phonons(state).dos((4, 4))", ("ase", "spglib")),
    "phonopy": ("gp.Phonons(state).save('p.yaml')", ("ase", "phonopy", "spglib", "yaml", "h5py")),
    "phonopy read": ("gp.load_phonopy", ("phonopy", "spglib", "yaml", "h5py")),
    "figure": ("gp.plot(crystal)", ("matplotlib",)),
    "sweep": ("gp.sweep(packing, force=[1.0, 2.0], media=('ala',))", ("xarray",)),
    "sweep file": (
        "gp.sweep(packing, force=[1.0, 2.0], media=('ala',), path='s.nc'), gp.load_sweep('s.nc')",
        ("xarray", "h5netcdf", "h5py"),
    ),
    "scene": ("gp.Scene.from_text(scene)", ("yaml",)),
    "run": (
        "gp.Scene.from_text(scene).run('out', figures=False)",
        ("yaml", "xarray", "h5netcdf", "h5py"),
    ),
    "command": ("command('check', 'scene.yaml')", ("typer", "yaml")),
    "workers elsewhere": ("require_workers(None, '10.0.0.1:8786')", ("distributed",)),
}
SCENE = """
schema: 1
material: {young_modulus: 70 GPa, poisson_ratio: 0.22, density: 2500 kg/m^3}
packing: {diameter: 1 mm}
load: {force: 1 N}
"""
#: tries each feature with some packages hidden, and prints what was said
TRY = """
import contextlib, io, json
from granphon.runs.workers import require_workers
from granphon.__main__ import main
network = gp.Crystal.on("chain", [gp.Ball(steel, 8e-3)]).repeat((4,)).at_force(5.0).network
motion = gp.NonlinearWaves(network).run(1e-5, velocities=1e-3 * np.eye(4)[0][:, None], frames=2)
state = gp.AveragedLattice(gp.Packing(steel, 8e-3)).at_force(18.446)
sample = gp.DirectSimulation(packing, (4, 4), seed=0).at_force(20.0).sample
crystal = gp.Crystal.on("chain", [gp.Ball(steel, 8e-3)]).at_force(5.0)

def command(*words):
    sys.argv = ["granphon", *words]
    with contextlib.redirect_stderr(io.StringIO()) as said, contextlib.redirect_stdout(io.StringIO()):
        code = main()
    if code:
        raise gp.GranphonError(f"{code} {said.getvalue()}")

os.chdir(tempfile.mkdtemp())
with open("scene.yaml", "w") as stream:
    stream.write(scene)
told = {}
for name, code in features.items():
    try:
        eval(code)
    except gp.GranphonError as error:
        told[name] = f"{type(error).__name__}: {error}"
    except BaseException as error:
        told[name] = f"not ours: {error!r}"
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Runs programs, each in a fork of a process that has loaded what the core stands on alone."""
    if not hasattr(os, "fork"):
        pytest.skip("needs forks of a process")
    warm = Warm("numpy", "scipy.linalg", "scipy.optimize", "scipy.sparse.linalg", "scipy.special")
    scratch = tmp_path_factory.mktemp("scratch")

    def run_program(hidden, *parts, **environment):
        code = f"HIDDEN = {hidden!r}" + "".join((HIDE, *parts))
        status, out, err = warm.run(scratch, scratch, ["-c"], code, environment)
        assert status == 0, err
        return out

    yield run_program
    warm.close()


def imported(requirement):
    name = re.split(r"[><=\[]", requirement)[0]
    return {"PyYAML": "yaml"}.get(name, name)


def test_the_core_gives_the_same_numbers_on_numpy_scipy_and_numba_alone(run):
    others = {"ase", "phonopy", "spglib", "pandas", *EXTRAS["scenes"], *EXTRAS["distributed"]}
    assert run(others, GIVEN, CORE) == run(set(), GIVEN, CORE)


@pytest.mark.parametrize(
    ("hidden", "environment", "words"),
    [
        ({"numba"}, {}, "numba .*"),
        (set(), {"NUMBA_DISABLE_JIT": "1"}, ".*NUMBA_DISABLE_JIT.*"),
        pytest.param(set(), {}, "", marks=pytest.mark.slow),
    ],
)
def test_a_motion_says_that_it_is_slow_where_nothing_is_compiled(run, hidden, environment, words):
    code = """
import warnings
chain = gp.Crystal.on("chain", [gp.Ball(steel, 8e-3)]).repeat((3,)).at_force(5.0).network
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    gp.NonlinearWaves(chain).run(1e-5, velocities=1e-3 * np.eye(3)[0][:, None], frames=2)
print(*(one.message for one in told))
"""
    assert re.fullmatch(words + "\n", run(hidden, GIVEN, code, **environment))


def test_errors_name_the_extras_that_bring_the_packages():
    extras = PROJECT["optional-dependencies"]
    assert [imported(one) for one in extras["scenes"]] == list(EXTRAS["scenes"])
    assert {imported(one) for one in extras["distributed"]} <= {*EXTRAS["distributed"], "granphon"}
    assert "granphon[scenes]" in extras["test"]


@pytest.mark.parametrize(
    "hidden",
    only([KNOWN], [KNOWN, list(EXTRAS["scenes"]), *([one] for one in KNOWN)]),
)
def test_what_needs_an_absent_package_says_which_and_how_to_install_it(run, hidden):
    features = {name: code for name, (code, _) in FEATURES.items()}
    # dask imports yaml, and xarray imports dask if it is there: without yaml there is none
    absent = {*hidden, "dask", "distributed"} if "yaml" in hidden else {*hidden}
    for one in KNOWN:  # so that each runs where it may
        pytest.importorskip(one)
    told = json.loads(run(absent, GIVEN, f"\nfeatures, scene = {features!r}, {SCENE!r}\n", TRY))
    assert set(told) == {name for name, (_, needs) in FEATURES.items() if set(needs) & absent}
    for name, text in told.items():
        (package,) = (one for one in absent if f"needs {one}, " in text)
        install = next(
            (f'"granphon[{extra}]"' for extra, brings in EXTRAS.items() if package in brings),
            package,
        )
        assert text.strip().endswith(f" Install it: pip install {install}.")
        assert text.startswith(
            "GranphonError: 2 granphon: error: " if name == "command" else "MissingPackageError: "
        )
        assert text.strip().count("\n") == 0
