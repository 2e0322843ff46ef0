"""A scene pays for what it asks: in a process of its own, costly calls are counted and costly
modules listed.

The processes are forks of one that has loaded libraries which no scene goes without, and nothing
that is counted.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import json
import os
import re
import sys
from collections import Counter
from collections.abc import Callable
from functools import cache, partial, reduce
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

import numpy as np
import pytest

import granphon as gp
from tests.conftest import only
from tests.warm import Warm

BENCHMARKS = Path(__file__).parent / "benchmarks"


def load(name: str) -> ModuleType:
    """One of the scripts beside the benchmarks."""
    sys.path.insert(0, str(BENCHMARKS))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(BENCHMARKS))


#: what makes the table of costs, and what the benchmarks share
costs = load("costs")
side_by_side = load("side_by_side")

ALWAYS = {"scene.yaml", "summary.yaml", "sweep.nc", "sweep.csv", ".granphon-files"}
SWEEP: set[str] = set()
BANDS = {"band.yaml", "phonopy_params.yaml"}


#: libraries that are not among the costly ones
LIGHT = (
    "numpy",
    "typer",
    "yaml",
    "h5py",
    "PIL.Image",
    "pyparsing",
    "dateutil.parser",
    "multiprocessing",
    "concurrent.futures",
)


@pytest.fixture(scope="module", autouse=True)
def processes(tmp_path_factory):
    """Has :func:`costs.python` fork."""
    if not hasattr(os, "fork"):
        yield
        return
    warm, scratch = Warm(*LIGHT), tmp_path_factory.mktemp("scratch")
    found = f"import sys\nprint({{*{costs.HEAVY!r}, 'granphon'}} & {{*sys.modules}})"
    assert warm.run(scratch, scratch, ["-c"], found) == (0, "set()\n", "")

    def python(code, *arguments):
        path = f"import sys\nsys.path.insert(0, {str(BENCHMARKS)!r})\n"
        status, out, err = warm.run(
            scratch, Path.cwd(), ["-c", *arguments], path + code, {"MPLBACKEND": "Agg"}
        )
        assert status == 0, err
        return out

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(costs, "python", python)
        yield
    warm.close()


@cache
def bringing(part: str) -> set[str]:
    """The watched modules that a module loads, in the versions that there are."""
    return set(costs.HEAVY) & set(costs.python(f"import sys, {part}\nprint(*sys.modules)").split())


def expected(modules: set[str]) -> set[str]:
    """These modules, with what those of scipy and dask bring with them."""
    parts = {one for one in modules if one.startswith(("scipy.", "dask."))}
    return (modules - parts).union(*map(bringing, parts))


#: what the effective medium takes of scipy: nodes of Gauss and Jacobi
NODES = {"scipy.special", "scipy.linalg"}
#: Fourier transforms
WAVES = {"scipy.fft", "scipy.special"}
#: the loops over contacts of an array at rest, and what preconditions them
CONTACTS = WAVES | {"numba", "scipy.linalg"}
PHONOPY = {"phonopy", "spglib", "ase", "ase.calculators"}
#: xarray loads dask, where that is installed
XARRAY = {"xarray", "h5netcdf", "pandas"} | (
    {"dask.array"} if importlib.util.find_spec("dask") else set()
)
#: ase.io, which writes the sample, imports calculators
SAMPLE = {"ase", "ase.calculators"}
EMA = {"local field": 1, "effective medium": 1}
SPECTRA = {"force constants": 1, "phonopy": 1}
#: a sample, and the same below and above its load, for the local exponent
BESIDE = {"equilibria": 3, "linear responses": 3}

#: of each kind: calls, modules, files, all but those of figures
ASKED: dict[str, tuple[dict[str, int], set[str], set[str]]] = {
    "velocities, equal balls": ({}, set(), set()),
    "velocities, averaged force": ({}, set(), set()),
    "velocities, effective medium": (EMA, NODES, set()),
    # an automatic medium takes what it has chosen, and no more
    "auto, equal balls": ({}, set(), set()),
    "auto, high load": ({}, set(), set()),
    "auto, intermediate load": (EMA, NODES, set()),
    "auto, to be simulated": (BESIDE, SAMPLE | CONTACTS, {"sample.extxyz"}),
    "sweep, auto": ({}, set(), SWEEP),
    "bands": (SPECTRA | {"modes": 1}, PHONOPY, BANDS),
    "bands, no friction": (SPECTRA | {"modes": 1}, PHONOPY, BANDS),
    "density of states": ({"modes": 1}, {"ase", "ase.calculators", "spglib"}, {"dos.csv"}),
    "bands and density of states": (SPECTRA | {"modes": 2}, PHONOPY, {*BANDS, "dos.csv"}),
    "sweep, averaged": ({}, set(), SWEEP),
    "sweep, effective medium": (EMA, NODES, SWEEP),
    "simulation": (BESIDE, SAMPLE | CONTACTS, {"sample.extxyz"}),
    "simulation, no friction": (BESIDE, SAMPLE | CONTACTS, {"sample.extxyz"}),
    "simulation in space": (BESIDE, SAMPLE | CONTACTS, {"sample.extxyz"}),
    # no exponent, which takes two more of both; the sound velocity, one of the conditions of
    # validity, takes the response
    "bands of a simulation": (
        SPECTRA | {"modes": 1, "equilibria": 1, "linear responses": 1},
        PHONOPY | CONTACTS,
        {*BANDS, "sample.extxyz"},
    ),
    "sweep of simulations": (
        {"equilibria": 18, "linear responses": 18},
        CONTACTS,
        SWEEP,
    ),
}
FIGURES = {
    "bands": {"bands.png"},
    "bands, no friction": {"bands.png"},
    "density of states": {"dos.png"},
    "bands and density of states": {"bands.png"},
    "sweep, averaged": {"sweep.png"},
    "sweep, effective medium": {"sweep.png"},
    "sweep, auto": {"sweep.png"},
    "auto, to be simulated": {"forces.png"},
    "simulation": {"forces.png"},
    "simulation, no friction": {"forces.png"},
    "simulation in space": {"forces.png"},
    "bands of a simulation": {"bands.png", "forces.png"},
    "sweep of simulations": {"sweep.png"},
}


#: kinds without figures: a sweep, which loads neither phonopy nor matplotlib then, and others
BARE = ("sweep, effective medium", "bands", "sweep of simulations", "simulation")
#: kinds, and options, that the default selection runs: spectra with figures, and the sweep without
DEFAULT = (("bands and density of states", ()), (BARE[0], ("--no-figures",)))


def asked(seen: Any) -> dict[str, int]:
    """Calls but for the trial by which the command estimates what a simulation takes: a state of one
    small sample.
    """
    calls = dict(seen.calls)
    assert calls.pop(costs.TRIAL, 0) <= (3 if "equilibria" in calls else 0)
    return calls


def judged(modules: set[str]) -> set[str]:
    """ASE and phonopy bring parts of scipy of their own, and which is not ours to say."""
    foreign = bool(modules & {"ase", "phonopy"})
    return {one for one in modules if not (foreign and one.startswith("scipy."))}


def test_every_kind_of_scene_is_held_to_what_it_asks():
    assert set(ASKED) == set(costs.SCENES)
    assert set(costs.LARGE) < set(ASKED)


@pytest.mark.claim("benchmark-scenes")
@pytest.mark.parametrize(
    ("kind", "options"),
    only(DEFAULT, [*((kind, ()) for kind in ASKED), *((kind, ("--no-figures",)) for kind in BARE)]),
)
def test_a_scene_calls_loads_and_writes_what_it_asks_and_nothing_else(kind, options):
    calls, modules, files = ASKED[kind]
    drawn = set() if options else FIGURES.get(kind, set())
    seen = costs.seen(kind, *options)
    assert asked(seen) == calls | ({"figures": len(drawn)} if drawn else {})
    assert judged(set(seen.modules)) == judged(
        expected(XARRAY | modules | ({"matplotlib"} if drawn else set()))
    )
    assert set(seen.files) == ALWAYS | files | drawn


@pytest.mark.exhaustive
def test_without_friction_nothing_turns():
    assert costs.seen("bands").branches == 3
    assert costs.seen("bands, no friction").branches == 2


@pytest.mark.parametrize(
    "kind",
    only(["bands and density of states"], ["bands and density of states", "sweep, averaged"]),
)
def test_a_check_computes_no_spectra_and_writes_nothing(kind):
    seen = costs.seen(kind, command="check")
    assert (seen.calls, seen.modules, seen.files) == ({}, [], [])


@pytest.mark.parametrize(
    "kind", only(["bands of a simulation"], ["auto, to be simulated", "bands of a simulation"])
)
def test_a_check_simulates_no_sample_and_loads_no_phonopy(kind):
    seen = costs.seen(kind, command="check")
    assert set(seen.calls) <= {costs.TRIAL}
    assert set(seen.modules) <= expected(CONTACTS | {"scipy.sparse"})
    assert not seen.files


def test_a_scene_that_was_made_in_python_sweeps_like_one_that_was_read_and_like_none():
    text = (
        "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.28, density: 7840 kg/m^3}\n"
        "packing: {diameter: 8 mm, spread: {uniform: 2.04 um}}\nload: {force: [9 N, 40 N]}\n"
        "medium: [{auto: {tolerance: 0.02}}, ala]\nsweep: {width: [1 um, 2 um]}\n"
    )
    read = gp.Scene.from_text(text)
    made = gp.Scene(read.packing, read.load, media=read.media, parameters=read.parameters)
    found = made.sweep()
    assert made.sweep().identical(found)
    assert read.sweep().identical(found)
    assert gp.sweep(
        read.packing, force=read.load.values, media=list(read.media), **dict(read.parameters)
    ).identical(found)


@pytest.mark.claim("exponent-cost")
def test_samples_are_simulated_once_however_often_they_are_asked(steel, monkeypatch):
    from granphon.array import sheared_equilibrium
    from granphon.media import loading

    loads: list[object] = []
    solve = loading.bring_to_rest

    def counted(deviations, load, *rest, **named):
        loads.append(load)
        return solve(deviations, load, *rest, **named)

    for module in (sheared_equilibrium, loading):
        monkeypatch.setattr(module, "bring_to_rest", counted)
    packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2e-6))
    state = gp.DirectSimulation(packing, shape=(8, 8), samples=2).at_force(np.array([10.0, 20.0]))
    assert len(loads) == 4
    for one in (state, state[0], state[1]):
        gp.sound_velocities(one), gp.moduli(one), gp.validity(one)
        _ = one.contact_fraction, one.force_fluctuation, one.standard_error("overlap")
    phonons = gp.Phonons(state[0])
    phonons.bands("GK", npoints=3)
    phonons.dos((4, 4), points=20)
    assert len(loads) == 4
    # exponents take each sample below and above its load, once
    for one in (state, state[0], state[1]):
        _ = gp.local_exponent(one), one.exponent_error
    assert len(loads) == 12


@pytest.mark.parametrize("entry", costs.WATCHED)
def test_what_is_counted_exists_and_is_python(entry):
    module, name = entry
    found = reduce(getattr, name.split("."), importlib.import_module(module))
    found = getattr(found, "__wrapped__", found)
    # so that a call is seen under this name
    assert (found.__module__, found.__code__.co_qualname) == entry


@pytest.mark.parametrize(
    ("value", "bound", "least", "code"),
    [(2, 3, False, 0), (4, 3, False, 1), (4, 3, True, 0), (2, 3, True, 1)],
)
def test_a_missed_bound_of_a_benchmark_is_the_exit_code(
    value, bound, least, code, tmp_path, capsys
):
    row = side_by_side.Row("a ratio", value, bound=bound, least=least)
    parts = {
        "one": lambda repeats: [row],
        "free": lambda repeats: [side_by_side.Row("seconds", repeats, "s")],
    }
    path = tmp_path / "results.json"
    assert (
        side_by_side.command_line("Benchmarks", parts, argv=["--json", str(path), "--repeats", "3"])
        == code
    )
    out, err = capsys.readouterr()
    assert ("missed: a ratio" in err) == bool(code)
    assert (
        f"| a ratio | {value} |  | {'≥' if least else '≤'} 3 | {'FAIL' if code else 'pass'} |"
        in out
    )
    results = json.loads(path.read_text(encoding="utf-8"))
    assert results["machine"]["cores"] >= 1
    assert {"processor", "python", "numpy", "scipy", "phonopy", "blas"} <= set(results["machine"])
    assert results["one"][0]["value"] == value
    assert results["free"][0]["value"] == 3
    assert results["free"][0]["bound"] is None


# -- how far it is from a scene to its files -------------------------------------------------------

#: the folder of the package, with which the names of its files begin
PACKAGE = str(Path(gp.__file__).parent) + os.sep
BANDS_OF_STEEL = (
    "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
    "packing: {diameter: 8 mm}\nload: {force: 18.446 N}\nobserve: [bands]\n"
)


def count_calls(work: Callable[[], object]) -> Counter[str]:
    """Calls of functions of the package in each of its modules, the second time that the work is
    done; comprehensions, which new versions of Python do not call, do not count.
    """
    work()
    calls: Counter[str] = Counter()

    def watch(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        is_function = code.co_flags & inspect.CO_OPTIMIZED and not code.co_name.endswith("comp>")
        if event == "call" and is_function and code.co_filename.startswith(PACKAGE):
            calls[code.co_filename.removeprefix(PACKAGE)] += 1

    profile = sys.getprofile()
    sys.setprofile(watch)
    try:
        work()
    finally:
        sys.setprofile(profile)
    return calls


def test_a_scene_takes_few_calls_to_its_band_yaml(tmp_path):
    """The bounds leave little room for what packages, versions and machines differ by."""
    folders = iter((tmp_path / "a", tmp_path / "b"))
    of_scene = count_calls(
        lambda: gp.Scene.from_text(BANDS_OF_STEEL).run(next(folders), figures=False)
    )
    steel = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
    path = tmp_path / "band.yaml"
    of_python = count_calls(
        lambda: gp.Phonons(gp.AveragedLattice(steel).at_force(18.446)).bands().write(path)
    )
    assert sum(of_scene.values()) <= 3700
    assert len(of_scene) <= 49
    assert sum(of_python.values()) <= 540
    assert len(of_python) <= 29


#: what finds derivatives, errors of parameters and designs, but for the names that a file may have
NOT_ASKED_FOR = re.compile(
    r"granphon\.(\w+\.sensitivities|dynamics\.edge_energies|observables\.parameters"
    r"|inverse\.(?!variables)\w+|scene\.(uncertainty|written_errors|design))"
)


def test_a_plain_scene_loads_no_arrays_no_crystals_no_statics_and_no_derivatives(tmp_path):
    """Modules that are imported, packages among them, in a process that has loaded none before."""
    code = (
        "import sys, granphon as gp\n"
        f"gp.Scene.from_text({BANDS_OF_STEEL!r}).run({str(tmp_path / 'out')!r}, figures=False)\n"
        "print(*(name for name in sys.modules if name.startswith('granphon.')))"
    )
    loaded = set(costs.python(code).split())
    of_arrays = {name for name in loaded if name.startswith("granphon.array.")}
    assert of_arrays == {"granphon.array.options", "granphon.array.atoms"}
    assert {name for name in loaded if name.startswith("granphon.statics.")} == {
        "granphon.statics.options"
    }
    for name in ("crystal", "arrangement", "simulation", "loading"):
        assert f"granphon.media.{name}" not in loaded
    assert not list(filter(NOT_ASKED_FOR.fullmatch, loaded))
    assert len(loaded) <= 118


def make_long_files(rows: int, folder: Path) -> dict[str, Callable[[], object]]:
    """What writes each of the long files, of so many rows or more, by the name of the file."""
    from granphon.array.atoms import write_extxyz

    steel = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
    phonons = gp.Phonons(gp.AveragedLattice(steel).at_force(18.446))
    spread = gp.Packing(steel.material, steel.diameter, gp.Uniform(2e-6))
    state = gp.DirectSimulation(spread, shape=(rows, 4), seed=0).at_force(18.446)
    network = state.sample.network
    return {
        "band.yaml": partial(phonons.bands("GK", rows).write, folder / "band.yaml"),
        "dos.csv": partial(phonons.dos((rows, rows)).write_csv, folder / "dos.csv"),
        "contacts.csv": partial(
            network.write_tables, folder / "balls.csv", folder / "contacts.csv"
        ),
        "sample.extxyz": partial(write_extxyz, folder / "sample.extxyz", gp.atoms(state)),
    }


def test_long_files_take_as_many_calls_for_many_rows_as_for_few(tmp_path):
    few = make_long_files(4, tmp_path)
    many = make_long_files(32, tmp_path)
    for name, write in many.items():
        calls = count_calls(write)
        assert calls == count_calls(few[name]), name
        assert sum(calls.values()) <= 160, name
