"""What each kind of scene loads, calls and takes, measured: processes of the command line, each
with nothing loaded before.

    python tests/benchmarks/costs.py [--json FILE] [--repeats N] [--only SCENE ...]

``tests/test_required.py`` holds scenes to it: what is counted here must be no more than the scene
asks for.
"""

from __future__ import annotations

import argparse
import builtins
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from side_by_side import alternate, machine, recorded

HERE = Path(__file__).resolve().parent

#: costly functions, by module and qualified name: they are counted however they were imported
WATCHED = {
    ("granphon.laws.effective", "solve_curve"): "effective medium",
    ("granphon.dynamics.local_field", "_compute_local_field"): "local field",
    ("granphon.phonons.calculator", "contact_blocks"): "force constants",
    ("granphon.phonons.phonopy_bridge", "ContactPhonopy.give_force_constants"): "phonopy",
    ("granphon.dynamics.contact_lattice", "ContactLattice.modes"): "modes",
    ("granphon.array.rest", "bring_to_rest"): "equilibria",
    ("granphon.array.equilibrium", "Equilibrium.find_elasticity"): "linear responses",
    ("matplotlib.figure", "Figure.savefig"): "figures",
}
#: small equilibria by which the time of large ones is estimated
TRIAL = "trial equilibria"
#: costly modules
HEAVY = (
    "phonopy",
    "spglib",
    "matplotlib",
    "ase",
    "ase.calculators",
    "xarray",
    "h5netcdf",
    "pandas",
    "rich",
    "numba",
    "scipy.fft",
    "scipy.special",
    "scipy.linalg",
    "scipy.sparse",
    "scipy.optimize",
    "scipy.integrate",
    "scipy.spatial",
)

_BALLS = """material: {young_modulus: 70 GPa, poisson_ratio: 0.22, density: 2500 kg/m^3}
packing: {diameter: 1 mm%s}
load: {force: %s}
"""
EQUAL = _BALLS % ("", "1 N")
SPREAD = _BALLS % (", spread: {uniform: 0.3 um}", "1 N")
SPACE = _BALLS % (", lattice: fcc, spread: {uniform: 0.3 um}", "1 N")
ROUGH = ", spread: {uniform: 3 um}"
SMOOTH = ", friction: false"
LOADS = "[1 N, 2 N, 4 N]"
SCENES = {
    "velocities, equal balls": EQUAL + "medium: ema\n",
    "velocities, averaged force": SPREAD + "medium: afa\n",
    "auto, equal balls": EQUAL + "medium: auto\n",
    "auto, high load": _BALLS % (ROUGH, "40 N") + "medium: auto\n",
    "auto, intermediate load": _BALLS % (ROUGH, "0.8 N") + "medium: {auto: {tolerance: 0.02}}\n",
    "auto, to be simulated": _BALLS % (ROUGH, "0.8 N") + "medium: {auto: {tolerance: 0.01}}\n",
    "sweep, auto": _BALLS % (ROUGH, "[12 N, 40 N]") + "medium: auto\n",
    "velocities, effective medium": SPREAD + "medium: ema\n",
    "bands": EQUAL + "observe: [bands]\n",
    "bands, no friction": _BALLS % (SMOOTH, "1 N") + "observe: [bands]\n",
    "density of states": EQUAL + "observe: [dos]\n",
    "bands and density of states": EQUAL + "observe: [bands, dos]\n",
    "sweep, averaged": _BALLS % (", spread: {uniform: 0.3 um}", LOADS) + "medium: [ala, afa]\n",
    "sweep, effective medium": _BALLS % (", spread: {uniform: 0.3 um}", LOADS)
    + "medium: [ala, ema]\n",
    "simulation": SPREAD + "medium: {simulation: {shape: 32 32}}\n",
    "simulation, no friction": _BALLS % (f", spread: {{uniform: 0.3 um}}{SMOOTH}", "1 N")
    + "medium: {simulation: {shape: 32 32}}\n",
    "simulation in space": SPACE + "medium: {simulation: {shape: 24 24 24}}\n",
    "bands of a simulation": SPREAD + "medium: {simulation: {shape: 32 32}}\nobserve: [bands]\n",
    "sweep of simulations": _BALLS % (", spread: {uniform: 0.3 um}", LOADS)
    + "medium: {simulation: {shape: 16 16, samples: 2}}\n",
}
#: the same kinds with data so large that memory beside it is small
LARGE = {
    "bands": SCENES["bands"] + "phonopy: {band_points: 5001}\n",
    "density of states": SCENES["density of states"] + "phonopy: {mesh: 1024 1024 1}\n",
    "sweep, effective medium": SCENES["sweep, effective medium"].replace(
        LOADS, "{from: 1 N, to: 2 N, points: 50000}"
    ),
    "simulation": SCENES["simulation"].replace("32 32", "512 512"),
    "simulation in space": SCENES["simulation in space"].replace("24 24 24", "48 48 48"),
}


class Seen(NamedTuple):
    """Of one run: costly modules loaded, costly functions called, files written, branches of the
    spectra.
    """

    modules: list[str]
    calls: dict[str, int]
    files: list[str]
    branches: int | None


# -- inside a process of its own -------------------------------------------------------------------


def follow(scene: str, out: str, *options: str, command: str = "run") -> None:
    """Run the command on a scene file and print what was :class:`Seen`."""
    counts: Counter[str] = Counter()
    names = {name for _, name in WATCHED}

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and (name := frame.f_code.co_qualname) in names:
            what = WATCHED.get((frame.f_globals["__name__"], name))
            if what is not None:
                counts[TRIAL if is_timed(frame) else what] += 1

    def is_timed(frame: FrameType | None) -> bool:
        """Whether a call is of the small piece of work from which the time is estimated."""
        while frame is not None and frame.f_globals["__name__"] != "granphon.media.cost":
            frame = frame.f_back
        return frame is not None

    load = builtins.__import__

    def load_unwatched(name: str, *more: Any, **named: Any) -> Any:
        """Import a module; a library calls nothing that is counted while it is loaded."""
        if name.startswith("granphon") or sys.getprofile() is None:
            return load(name, *more, **named)
        sys.setprofile(None)
        try:
            return load(name, *more, **named)
        finally:
            sys.setprofile(watch)

    from granphon.cli.main import main

    builtins.__import__ = load_unwatched
    sys.setprofile(watch)
    code = main(
        ["check", scene] if command == "check" else ["run", scene, "-o", out, "-q", *options]
    )
    sys.setprofile(None)
    assert code == 0
    loaded = [one for one in HEAVY if one in sys.modules]
    files = sorted(path.name for path in Path(out).iterdir()) if Path(out).is_dir() else []
    branches = None
    if "band.yaml" in files:
        from granphon.phonons.bands import Bands

        branches = Bands.read(Path(out) / "band.yaml").frequencies.shape[-1]
    print(json.dumps(Seen(loaded, counts, files, branches)._asdict()))


def weigh(kind: str, folder: str) -> None:
    """Print by how many bytes the peak grows from a small scene to a large one of the same kind,
    and those of its data.
    """
    import resource

    from granphon.scene.scene import Scene

    def peak() -> int:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
            1 if sys.platform == "darwin" else 1024
        )

    Scene.from_text(SCENES[kind]).run(Path(folder) / "small", figures=False)
    before = peak()
    result: Any = Scene.from_text(LARGE[kind]).run(Path(folder) / "large", figures=False)
    print(json.dumps({"grown": peak() - before, "data": data(kind, result)}))


def data(kind: str, result: Any) -> int:
    """Bytes of what the scene has to hold: the arrays of its result; of a density of states, the
    frequencies on its mesh.
    """
    if kind == "density of states":
        n1, n2 = result.dos.mesh
        return int(n1 * n2 * result.phonons.lattice.n_branches * 8)
    if kind == "bands":
        names = ("qpoints", "distances", "frequencies", "group_velocities", "eigenvectors")
        return sum(getattr(result.bands, name).nbytes for name in names)
    if kind in ("simulation", "simulation in space"):
        sample = result.state.sample
        return sum(
            one.nbytes for one in (sample.diameters, sample.displacements, sample.contact_forces)
        )
    return int(result.dataset.nbytes)


# -- from outside ----------------------------------------------------------------------------------


def python(code: str, *arguments: str) -> str:
    """What a new process prints."""
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            f"import sys\nsys.path.insert(0, {str(HERE)!r})\n{code}",
            *arguments,
        ],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "MPLBACKEND": "Agg"},
    )
    return done.stdout


@cache
def seen(kind: str, *options: str, command: str = "run") -> Seen:
    """What carrying out a kind of scene was seen to take."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.yaml"
        scene.write_text(SCENES[kind], encoding="utf-8")
        code = f"import costs\ncosts.follow(*sys.argv[1:], command={command!r})"
        return Seen(
            **json.loads(
                python(code, str(scene), str(Path(folder) / "out"), *options).splitlines()[-1]
            )
        )


def times(repeats: int, kinds: Sequence[str]) -> dict[str, float]:
    """Median seconds of a process for each kind, of one without figures, and of one that imports
    numpy.
    """
    with tempfile.TemporaryDirectory() as folder:

        def scene(kind: str, *options: str) -> Callable[[], object]:
            path = Path(folder) / f"{kind}.yaml"
            path.write_text(SCENES[kind], encoding="utf-8")
            arguments = [
                "run",
                str(path),
                "-o",
                str(Path(folder) / "out"),
                "-q",
                "--force",
                *options,
            ]
            return lambda: python(
                f"from granphon.cli.main import main\nassert main({arguments!r}) == 0"
            )

        calls = {kind: scene(kind) for kind in kinds}
        calls |= {
            f"{kind}, no figures": scene(kind, "--no-figures")
            for kind in kinds
            if seen(kind).calls.get("figures")
        }
        return alternate(repeats, **calls, numpy=lambda: python("import numpy"))


def weighed(kind: str) -> dict[str, int]:
    """See :func:`weigh`."""
    with tempfile.TemporaryDirectory() as folder:
        return dict(
            json.loads(
                python("import costs\ncosts.weigh(*sys.argv[1:])", kind, folder).splitlines()[-1]
            )
        )


def measured(repeats: int, kinds: Sequence[str] = tuple(SCENES)) -> dict[str, Any]:
    """Of kinds of scenes what it was seen to take, its seconds, those without figures, and memory
    where it is large.

    Without repeats it is counted alone, and neither timed nor weighed: for a machine that is busy.
    """
    memory = {kind: weighed(kind) for kind in LARGE if repeats and kind in kinds}
    seconds: Mapping[str, float] = times(repeats, kinds) if repeats else {}
    scenes = [
        {
            "scene": kind,
            **seen(kind)._asdict(),
            "seconds": seconds.get(kind),
            "bare": seconds.get(f"{kind}, no figures"),
            **memory.get(kind, {"grown": None, "data": None}),
        }
        for kind in kinds
    ]
    return {
        "machine": machine(),
        "repeats": repeats,
        "numpy": seconds.get("numpy"),
        "scenes": scenes,
    }


def exchanged(before: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, Any]:
    """An earlier measurement with some of its scenes measured anew, each with the time of numpy
    beside it.
    """
    scenes = {one["scene"]: one for one in before["scenes"]}
    scenes |= {one["scene"]: one | {"numpy": found["numpy"]} for one in found["scenes"]}
    return {**before, "scenes": [scenes[kind] for kind in SCENES if kind in scenes]}


def main(argv: Sequence[str] | None = None) -> int:
    from page import costs

    parser = argparse.ArgumentParser(description="What each kind of scene loads, calls and takes")
    parser.add_argument("--json", type=Path, help="also write it here, under the name costs")
    parser.add_argument(
        "--repeats", type=int, default=5, help="none: count, and neither time nor weigh"
    )
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="SCENE",
        choices=list(SCENES),
        help="these alone, into those of the file",
    )
    options = parser.parse_args(argv)
    found = measured(options.repeats, options.only or tuple(SCENES))
    if options.only and options.json:
        found = exchanged(json.loads(options.json.read_text(encoding="utf-8"))["costs"], found)
    if options.json:
        recorded(options.json, {"costs": found})
    print(costs(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
