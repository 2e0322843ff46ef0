"""What some work will need, before it is done: memory and time.

Memory follows from the arrays. The time of a simulation is that of a small sample, found here and now, times what the load
adds: the nearer the rigidity threshold, the more steps each equilibrium takes. The powers were fitted to runs of 64^2 to
256^2 balls between f* = 1e-3 and 30, of which the estimate is within a factor of three. Bands, densities of states, force
constants and sweeps were measured on one processor at 2 to 3 GHz: memory, their arrays as Python's tracemalloc counts them,
is right within a factor of two or so, their time within five.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.equilibrium import Prescribed, equilibrate
from granphon.balls.diameters import uniform_numbers
from granphon.balls.loads import Load
from granphon.balls.motions import select_motions
from granphon.balls.packing import Packing
from granphon.media.simulation import DirectSimulation

__all__ = ["Cost", "available_memory", "bands", "density_of_states", "estimate", "force_constants", "sweep_states"]

Array = NDArray[np.float64]
#: what Python and its libraries take, bytes
_PYTHON_BYTES = 80e6
#: bytes for each ball while a sample without rotations is worked on
_BALL_BYTES = 450.0
#: bytes for each ball while a linear response with rotations is worked on
_ROTATING_BALL_BYTES = 620.0
#: bytes for each ball of a further sample that is kept
_SAMPLE_BYTES = 8.0
#: bytes for each ball of a further equilibrium that is kept
_EQUILIBRIUM_BYTES = 17.0
#: a* of uniform diameters, between which loads given as overlaps are placed
_SPACINGS = np.array([0.345, 0.35, 0.363, 0.42, 0.5, 0.7, 1.0])
#: f* of uniform diameters at each of these a*
_FORCES = np.array([5e-5, 2e-4, 8.4e-4, 7.3e-3, 2.55e-2, 0.1163, 0.3678])
#: time of a linear response without rotations over that of its equilibrium
_RESPONSE_TIME = 0.8
#: time of a linear response with rotations over that of its equilibrium
_ROTATING_RESPONSE_TIME = 1.4
#: time of an equilibrium that is found from one beside it, over that of the other
_BESIDE_TIME = 0.6
#: balls along the sides of the small sample
_SMALL_SHAPE = (96, 96)
#: a* of the small sample
_SMALL_SPACING = 1.0
#: s; work that takes less is not worth telling
_TOLD_SECONDS = 1.0
#: bytes; work that takes less is not worth telling
_TOLD_BYTES = 1e8


@dataclass(frozen=True)
class Cost:
    """What work takes; costs add up to that of one piece after the other.

    Attributes
    ----------
    working : bytes while a piece is done, given back after it.
    kept : bytes that stay to the end.
    work : of simulations, in balls of the small sample.
    known : seconds of what is not simulated.
    balls, equilibria : of one sample, and how many there are.
    parts : what else there is, in words.
    """

    working: float = 0.0
    kept: float = 0.0
    work: float = 0.0
    known: float = 0.0
    balls: int = 0
    equilibria: int = 0
    parts: tuple[str, ...] = ()

    def __add__(self, other: Cost) -> Cost:
        return Cost(
            max(self.working, other.working), self.kept + other.kept, self.work + other.work, self.known + other.known,
            max(self.balls, other.balls), self.equilibria + other.equilibria, self.parts + other.parts,
        )  # fmt: skip

    def times(self, count: float) -> Cost:
        """Of so many of the same kind, one after the other."""
        return replace(
            self, kept=self.kept * count, work=self.work * count, known=self.known * count,
            equilibria=round(self.equilibria * count),
        )  # fmt: skip

    @property
    def memory(self) -> float:
        """Bytes at the most, with Python and its libraries."""
        return _PYTHON_BYTES + self.working + self.kept

    @property
    def seconds(self) -> float:
        """Of one processor of this machine, on which the small sample is tried when simulations are first asked for."""
        return self.known + (self.work * _second_per_ball() if self.work else 0.0)

    @property
    def tells(self) -> bool:
        """Whether it is worth telling: a simulation always is."""
        return bool(self.equilibria) or self.known > _TOLD_SECONDS or self.memory - _PYTHON_BYTES > _TOLD_BYTES

    @property
    def text(self) -> str:
        """One line."""
        many = f", {self.equilibria} equilibria" if self.equilibria > 1 else ""
        simulated = (f"simulation of {self.balls:,} balls{many}",) if self.equilibria else ()
        what = "; ".join(simulated + self.parts)
        return f"{what}: about {_bytes(self.memory)} and {_duration(self.seconds)}"


def _bytes(memory: float) -> str:
    return f"{_digits(memory / 1e9)} GB" if memory >= 1e9 else f"{memory / 1e6:.0f} MB"


def _duration(seconds: float) -> str:
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{_digits(seconds / size)} {unit}"
    return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"


def _digits(value: float) -> str:
    """Two of them."""
    return f"{value:.2g}" if value < 100.0 else f"{float(f'{value:.2g}'):,.0f}"


# -- what the machine has -------------------------------------------------------------------------------------------


def available_memory(root: Path = Path("/")) -> float:
    """Bytes that this process may still take beside all others; infinite where the system does not say.

    On Linux what the kernel says is available, or what is left of the limit of the process's control group or one above it,
    whichever is least; elsewhere the memory that is free, or that there is. ``root`` is where the files of the system are.
    """
    return min(_of_machine(root), _of_groups(root))


def _of_machine(root: Path) -> float:
    for line in _lines(root / "proc/meminfo"):
        words = line.split()
        if words[:1] == ["MemAvailable:"] and words[1:2] and words[1].isdigit():
            return float(words[1]) * 1024.0
    known = getattr(os, "sysconf_names", ())
    pages = next((name for name in ("SC_AVPHYS_PAGES", "SC_PHYS_PAGES") if name in known), None)
    if pages is None or "SC_PAGE_SIZE" not in known:
        return math.inf
    return float(os.sysconf(pages)) * float(os.sysconf("SC_PAGE_SIZE"))


#: of the two versions of control groups: where they are, the files of limit and use, the cache that can be given back
_GROUPS = {
    "memory": ("sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
    "": ("sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
}


def _of_groups(root: Path) -> float:
    """What is left of the least limit of the process's groups; infinite where there is none."""
    left = math.inf
    for line in _lines(root / "proc/self/cgroup"):
        _, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        kind = "memory" if "memory" in controllers.split(",") else controllers
        if kind not in _GROUPS:
            continue
        place, limit, use, cache = _GROUPS[kind]
        group = Path(path.lstrip("/"))
        for folder in (group, *group.parents):  # a limit above holds too; in a container its path may not be there
            here = root / place / folder
            most, taken = (_number(_lines(here / name)) for name in (limit, use))
            if most is not None and taken is not None:
                words = dict(line.split()[:2] for line in _lines(here / "memory.stat") if len(line.split()) >= 2)
                left = min(left, max(most - taken + (_number([words.get(cache, "")]) or 0.0), 0.0))
    return left


def _number(lines: list[str]) -> float | None:
    """The one number of a file; None if there is none ("max")."""
    return float(lines[0]) if lines and lines[0].isdigit() else None


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="ascii", errors="replace").split("\n")
    except OSError:
        return []


# -- simulations ----------------------------------------------------------------------------------------------------


def estimate(
    simulation: DirectSimulation,
    load: Load,
    moduli: bool = True,
    exponents: bool = False,
) -> Cost:
    """Memory and time of the states at a load, and of their ``moduli``, on one processor of this machine.

    With ``exponents`` also of the two equilibria beside each, and their moduli, by which the local exponent is found.

    Meant for loads above the rigidity threshold: what lies below is taken to be at it.
    """
    balls, count = int(np.prod(simulation.shape)), load.size * simulation.samples
    packing = simulation.packing
    turning = moduli and select_motions(packing.mindlin_ratio).rotate
    kept = _SAMPLE_BYTES * (simulation.samples - 1) + _EQUILIBRIUM_BYTES * (count - 1)
    memory = balls * ((_ROTATING_BALL_BYTES if turning else _BALL_BYTES) + kept)
    if not packing.width:
        return Cost(memory, work=0.1 * balls * count, balls=balls, equilibria=count)
    force = np.maximum(_reduced_force(packing, load.applied), _FORCES[0])
    rest = _steps(force)
    linear = rest * (_ROTATING_RESPONSE_TIME if turning else _RESPONSE_TIME) if moduli else 0.0
    beside = 2.0 * (_BESIDE_TIME * rest + linear) if exponents else 0.0
    relative = float(np.sum(rest + linear + beside) / _steps(np.interp(_SMALL_SPACING, _SPACINGS, _FORCES)))
    return Cost(memory, work=relative * balls * simulation.samples, balls=balls, equilibria=count)


def _reduced_force(packing: Packing, load: Load) -> Array:
    """f*, about, of an applied load."""
    loads = np.ravel(load.array)
    if load.kind == "overlap":
        spacing = packing.width_units.reduced_spacing(loads)
        near = np.exp(np.interp(np.log(np.maximum(spacing, _SPACINGS[0])), np.log(_SPACINGS), np.log(_FORCES)))
        return np.asarray(np.where(spacing > _SPACINGS[-1], np.maximum(spacing - 0.5, 0.0) ** 1.5, near))
    if load.kind == "pressure":
        loads = loads * packing.diameter / packing.structure.pressure_factor
    return np.asarray(packing.width_units.reduced_force(loads))


def _steps(force: ArrayLike) -> Array:
    """What an equilibrium costs a ball, in arbitrary units, by the reduced force."""
    return np.asarray(1.0 + 0.37 * np.asarray(force, float) ** -0.7)


@cache
def _second_per_ball() -> float:
    """Of the small sample at a* = 1, with its stiffness, on this machine."""
    deviations = uniform_numbers(_SMALL_SHAPE, 0) - 0.5
    deviations -= np.mean(deviations)
    times = []
    for _ in range(3):
        start = perf_counter()
        _ = equilibrate(deviations, Prescribed(overlap=_SMALL_SPACING - 0.5)).stiffness
        times.append(perf_counter() - start)
    return min(times) / deviations.size


# -- spectra, and sweeps --------------------------------------------------------------------------------------------


def bands(points: int, branches: int) -> Cost:
    """Of a band structure at so many wave vectors, with its file.

    Bytes and microseconds of a wave vector, with eigenvectors, phonopy's dynamical matrices and the lines of the file, as
    measured with 2, 3 and 9 branches; the matrices take the square.
    """
    square = branches * branches
    what = f"bands at {points:,} wave vectors"
    return Cost(kept=points * (2000.0 + 280.0 * square), known=1e-6 * points * (110.0 + 12.0 * square), parts=(what,))


def density_of_states(mesh: tuple[int, int], branches: int) -> Cost:
    """Of a density of states on a mesh.

    Bytes and microseconds of a point of the mesh: phonopy's tables of the grid, and of the points that its symmetry leaves
    (an eighth at the most, of equal sides; else it may be all) the modes, and the weights of the tetrahedra at 501
    frequencies, of which 64 MB are held at a time. Measured on the three lattices, 128^2 to 512^2 wave vectors.
    """
    points = mesh[0] * mesh[1]
    left = points * (0.125 if mesh[0] == mesh[1] else 1.0)
    memory = 1e8 + 180.0 * points + left * (400.0 + 550.0 * branches)
    seconds = 1e-6 * left * (200.0 + 45.0 * branches)
    return Cost(memory, known=seconds, parts=(f"density of states on {mesh[0]} x {mesh[1]} wave vectors",))


def force_constants(dim: tuple[int, int], balls: int) -> Cost:
    """Of phonopy's supercell of ``dim`` cells of so many ``balls``, and of its file.

    phonopy compares the atoms of the supercell with each other, once for every cell: 20 bytes a pair, and by their number to
    the power 2.2 in time. The file has one atom more in each cell.
    """
    atoms = dim[0] * dim[1] * (balls + 1)
    what = f"force constants of {dim[0]} x {dim[1]} cells"
    return Cost(20.0 * atoms * atoms, known=1e-6 * (0.5 * atoms) ** 2.2, parts=(what,))


def sweep_states(cases: int, loads: int, frequencies: int) -> Cost:
    """Of a sweep: so many media and packings, at so many loads each, with so many ``frequencies`` of bands in a state.

    A state takes some thirty numbers, held as results, stacked, and written; a case its tables. Bytes and seconds were
    measured with 40 to 40 000 states, and with up to 1e7 frequencies.
    """
    states = cases * loads
    what = f"{states:,} states" + (f" with {frequencies:,} frequencies each" if frequencies else "")
    memory = 8000.0 * cases + states * (2400.0 + 20.0 * frequencies) + 120.0 * frequencies
    return Cost(kept=memory, known=4e-3 * cases + states * (5e-5 + 4e-7 * frequencies), parts=(what,))
