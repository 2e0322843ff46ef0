"""The estimate of a simulation's memory and time."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from granphon.balls.loads import Load
from granphon.base.memory import available_memory
from granphon.media import cost
from granphon.media import simulation as simulations
from granphon.media.cost import estimate
from granphon.media.left_out import estimate_reduced_force
from tests.conftest import only

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
WIDTH = 2.04e-6


def simulation(shape=(64, 64), friction=True, samples=1):
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH), friction=friction)
    return gp.DirectSimulation(packing, shape, samples=samples, geometry="lattice")


PLANE = [
    ((64, 64), 1, 1),
    ((32, 32), 1, 3),
    ((128, 128), 1, 1),
    ((48, 48), 1, 5),
    ((48, 48), 3, 1),
    ((128, 128), 1, 24),
    ((128, 128), 12, 1),
]
SPACE = [
    ("fcc", (12, 12, 12), True),
    ("chain", (20_000,), True),
    ("fcc", (24, 24, 24), True),
    ("fcc", (24, 24, 24), False),
    ("hcp", (9, 9, 9), True),
    ("hcp", (18, 18, 18), False),
]
MEMORY = [*(("triangular", *one, friction) for one in PLANE for friction in (False, True))]
MEMORY += [(name, shape, 1, 1, friction) for name, shape, friction in SPACE]


@pytest.mark.claim("array-estimate")
@pytest.mark.parametrize(
    ("lattice", "shape", "samples", "loads", "friction"),
    only([MEMORY[0], MEMORY[3], MEMORY[9], MEMORY[14]], MEMORY),
)
def test_memory_is_what_the_arrays_take(lattice, shape, samples, loads, friction):
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH), lattice, friction=friction)
    medium = gp.DirectSimulation(
        packing, shape, samples=samples, geometry="lattice" if lattice == "triangular" else None
    )
    force = np.linspace(5.0, 6.0, loads)
    guess = estimate(medium, Load("force", force))
    # what is loaded once, factors and iterations on a grid, is not counted
    _ = gp.DirectSimulation(packing, (6,) * len(shape)).at_force(5.0).elastic_tensor
    tracemalloc.start()
    _ = medium.at_force(force).elastic_tensor
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # less than what is announced, and not less than half of it
    assert 0.5 < peak / (guess.working + guess.kept) < 1.0


@pytest.mark.parametrize(
    ("lattice", "shape", "geometry"),
    only(
        [("triangular", (32, 32), "lattice"), ("triangular", (32, 32), "exact")],
        [
            ("triangular", (32, 32), "lattice"),
            ("triangular", (32, 32), "exact"),
            (
                "triangular",
                (92, 92),
                "exact",
            ),  # right sides of equations no longer share transforms
            ("triangular", (300, 300), "lattice"),  # moduli without a list of contacts
            ("fcc", (14, 14, 14), "exact"),
            ("fcc", (18, 18, 18), "lattice"),
            ("hcp", (9, 9, 9), "exact"),
        ],
    ),
)
def test_memory_of_cells_that_shear_is_what_is_told_and_what_is_refused(
    lattice, shape, geometry, monkeypatch
):
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH), lattice)
    options = {"geometry": geometry, "boundary": "stress"}
    medium = gp.DirectSimulation(packing, shape, **options)
    guess = estimate(medium, Load("force", 5.0))
    told = guess.working + guess.kept
    asked = []
    require = simulations.require_memory
    monkeypatch.setattr(
        simulations, "require_memory", lambda *args: (asked.append(args[1]), require(*args))
    )
    _ = gp.DirectSimulation(packing, (6,) * len(shape), **options).at_force(5.0).elastic_tensor
    asked.clear()
    tracemalloc.start()
    _ = medium.at_force(5.0).elastic_tensor
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert asked == [told]
    assert 0.5 < peak / told < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("geometry", ["lattice", "exact"])
@pytest.mark.parametrize(
    ("lattice", "shape"), [("triangular", (64, 64)), ("fcc", (6, 6, 6)), ("hcp", (5, 5, 5))]
)
def test_memory_of_loading_with_friction_is_what_the_arrays_take(lattice, shape, geometry):
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH), lattice)
    options = {"friction_history": True, "friction_coefficient": 0.3, "geometry": geometry}
    force = np.array([2.0, 3.0, 4.0])
    medium = gp.DirectSimulation(packing, shape, **options)
    guess = estimate(medium, Load("force", force))
    _ = gp.DirectSimulation(packing, (4,) * len(shape), **options).at_force(force).elastic_tensor
    tracemalloc.start()
    _ = medium.at_force(force).elastic_tensor
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.5 < peak / (guess.working + guess.kept) < 1.0


@pytest.mark.slow
@pytest.mark.claim("array-exponents", "exponent-cost")
def test_exponents_take_two_states_more_beside_each():
    for friction in (False, True):
        medium = simulation(friction=friction)
        plain, asked = (
            estimate(medium, Load("force", [5.0, 20.0]), exponents=exponents)
            for exponents in (False, True)
        )
        assert asked.work == 3 * plain.work
        assert asked.memory == plain.memory
        assert asked.equilibria == 3 * plain.equilibria
    medium = simulation((128, 128))
    guess = estimate(medium, Load("force", 5.0), exponents=True)
    medium.at_force(5.0)  # what is loaded once, factors and iterations on a grid, is not counted
    tracemalloc.start()
    _ = medium.at_force(5.0).exponent
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.5 < peak / (guess.working + guess.kept) < 1.0


def test_the_kinds_of_load_agree():
    medium = simulation()
    for spacing in (0.5, 1.0, 3.0):
        overlap = (spacing - 0.5) * WIDTH
        state = medium.at_overlap(overlap)
        loads = {"overlap": overlap, "force": state.force, "pressure": state.pressure}
        force, *rest = [
            estimate_reduced_force(medium.packing, Load(kind, load)) for kind, load in loads.items()
        ]
        for other in rest:
            assert force == pytest.approx(other, rel=0.02)
            assert other == pytest.approx(state.reduced_force, rel=1e-12)


# -- time --------------------------------------------------------------------------------------------


def taking(seconds, **values):
    """A cost of one unit that takes so many seconds."""
    return cost.Cost(units=(cost.Units(1.0, lambda: seconds),), **values)


@pytest.fixture
def clock(monkeypatch):
    """A clock that goes on by a second for each ball in each equilibrium, and by nothing else."""
    cost._pay_for_imports()
    time = [0.0]
    solve = gp.DirectSimulation.at

    def at(self, load, **options):
        time[0] += self.balls * self.samples * load.size
        return solve(self, load, **options)

    monkeypatch.setattr(gp.DirectSimulation, "at", at)
    monkeypatch.setattr(cost, "process_time", lambda: time[0])
    cost._time_array.cache_clear()
    yield time
    cost._time_array.cache_clear()


def test_the_time_of_a_small_array_is_that_of_its_own_equilibria(clock):
    """64 balls are no more than the small array has, and so they are timed themselves."""
    medium = simulation((8, 8), samples=3)
    guess = estimate(medium, Load("force", np.linspace(10.0, 20.0, 5)), exponents=True)
    assert guess.equilibria == 45
    assert guess.seconds == pytest.approx(45 * 64)
    assert clock[0] == 64  # one sample at one load


def test_the_time_of_a_large_array_follows_from_a_small_one(clock):
    """At a load that closes all contacts the time per ball falls, as arrays of few balls are
    slow.
    """
    guess = estimate(simulation((1000, 1000)), Load("force", 500.0))
    small = 32 * 32
    assert clock[0] == 0  # nothing is timed before the time is asked for
    few = (1.0 + cost._OVERHEAD_BALLS / 1e6) / (1.0 + cost._OVERHEAD_BALLS / small)
    assert guess.seconds == pytest.approx(1e6 * few)
    assert clock[0] == small
    _ = guess.seconds, estimate(simulation((2000, 1000)), Load("force", 500.0)).times(3).seconds
    assert clock[0] == small + 45 * 22  # each small array once


def test_the_time_grows_faster_than_the_balls_where_contacts_are_open(clock):
    load = Load("force", 0.03 * simulation().packing.width_units.force)
    small, large = (estimate(simulation((side, side)), load).seconds for side in (32, 320))
    few = (1.0 + cost._OVERHEAD_BALLS / 320**2) / (1.0 + cost._OVERHEAD_BALLS / 32**2)
    opened = 1.0 - simulation((32, 32)).at(load).contact_fraction
    assert 0.2 < opened < 0.35
    assert large / small == pytest.approx(100.0 * few * 100.0**opened)


def test_a_load_that_no_array_bears_has_a_time_too():
    guess = estimate(simulation((8, 8)), Load("overlap", -0.6 * WIDTH))
    assert 0.0 < guess.seconds < np.inf


@pytest.mark.parametrize("ordered", [False, True])
def test_of_a_path_with_friction_some_loads_are_timed(clock, ordered):
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH))
    medium = gp.DirectSimulation(
        packing,
        (4, 4),
        friction_history=True,
        friction_coefficient=0.5,
        geometry="lattice",
        ordered=ordered,
    )
    overlap = WIDTH * np.array([0.6, 0.5, 0.4, 0.55, 0.45, 0.52, 0.58, 0.42])
    guess = estimate(medium, Load("overlap", overlap))
    assert guess.seconds == pytest.approx(8 * 16)
    assert clock[0] == overlap.size * 16  # at most a dozen


@pytest.mark.parametrize(
    ("seconds", "word"),
    [(0.0, "seconds"), (59.0, "seconds"), (61.0, "minutes"), (3700.0, "hours"), (1e6, "days")],
)
def test_the_time_is_told_in_one_word(seconds, word):
    guess = taking(seconds, working=2.5e9 - cost._PYTHON_BYTES, balls=10_000_000, equilibria=1)
    assert guess.text.startswith("simulation of 10,000,000 balls: ")
    assert guess.text.endswith(f" 2.5 GB and {word}")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (5.8e-5, "less than 0.1 s"),
        (0.123, "0.12 s"),
        (100.0, "100 s"),
        (200.0, "3.3 min"),
        (99.6 * 60.0, "100 min"),
        (1234.0 * 86400.0, "1,200 days"),
        (1e4, "2.8 h"),
        (1e6, "12 days"),
    ],
)
def test_durations_are_read_at_a_glance(seconds, text):
    assert cost.write_duration(seconds) == text


def test_the_text_counts_equilibria():
    assert (
        ", 4 equilibria: about" in estimate(simulation(samples=2), Load("force", [1.0, 2.0])).text
    )


# -- what is available -----------------------------------------------------------------------------

MEMINFO = "MemTotal:       32000000 kB\nMemFree:         1000000 kB\nMemAvailable:    8000000 kB\n"
LIMITS = "Limit  Soft Limit  Hard Limit  Units\nMax address space  {}  unlimited  bytes\n"
STATUS = "Name:\tpython\nVmSize:\t 1000000 kB\n"
V1 = "sys/fs/cgroup/memory"
V2 = "sys/fs/cgroup"
LIMITED_1 = {
    f"{V1}/job/memory.limit_in_bytes": "5000000000\n",
    f"{V1}/job/memory.usage_in_bytes": "3000000000\n",
    f"{V1}/job/memory.stat": "inactive_file 1\ntotal_inactive_file 500000000\n",
}
LIMITED_2 = {
    f"{V2}/user/job/memory.max": "max\n",
    f"{V2}/user/job/memory.current": "7\n",
    f"{V2}/user/memory.max": "3000000000\n",
    f"{V2}/user/memory.current": "2000000000\n",
}


@pytest.mark.parametrize(
    ("files", "available"),
    [
        ({"proc/meminfo": MEMINFO}, 8.192e9),
        (
            {
                "proc/meminfo": MEMINFO,
                "proc/self/cgroup": "4:memory:/job\n2:cpu:/\n0::/\n",
                **LIMITED_1,
            },
            2.5e9,
        ),
        ({"proc/meminfo": MEMINFO, "proc/self/cgroup": "7:cpu,memory:/job\n", **LIMITED_1}, 2.5e9),
        # a limit of a group above holds too; one that is larger than what is available does not
        ({"proc/meminfo": MEMINFO, "proc/self/cgroup": "0::/user/job\n", **LIMITED_2}, 1e9),
        (
            {
                "proc/meminfo": MEMINFO.replace("8000000", "80000"),
                "proc/self/cgroup": "0::/user/job\n",
                **LIMITED_2,
            },
            81.92e6,
        ),
        # in a container the path is that outside of it, and the group is the root
        (
            {
                "proc/meminfo": MEMINFO,
                "proc/self/cgroup": "0::/docker/0a1b\n",
                f"{V2}/memory.max": "600000000",
                f"{V2}/memory.current": "700000000",
            },
            0.0,
        ),
        ({"proc/meminfo": MEMINFO, "proc/self/cgroup": "0::/\nnonsense\n::\n"}, 8.192e9),
        # the addresses of a process may be limited, as by ulimit -v
        (
            {
                "proc/meminfo": MEMINFO,
                "proc/self/limits": LIMITS.format("6000000000"),
                "proc/self/status": STATUS,
            },
            4.976e9,
        ),
        (
            {
                "proc/meminfo": MEMINFO,
                "proc/self/limits": LIMITS.format("unlimited"),
                "proc/self/status": STATUS,
            },
            8.192e9,
        ),
    ],
)
def test_what_is_available_is_the_least_of_the_machines_and_the_groups(tmp_path, files, available):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert available_memory(tmp_path) == available


@pytest.mark.parametrize(
    ("names", "available"),
    [
        ({"SC_AVPHYS_PAGES": 1, "SC_PHYS_PAGES": 2, "SC_PAGE_SIZE": 3}, 4096.0 * 100),
        ({"SC_PHYS_PAGES": 2, "SC_PAGE_SIZE": 3}, 4096.0 * 200),
        ({"SC_PAGE_SIZE": 3}, np.inf),
    ],
)
def test_without_the_files_of_linux_the_system_is_asked(tmp_path, monkeypatch, names, available):
    monkeypatch.setattr("os.sysconf_names", names, raising=False)
    monkeypatch.setattr(
        "os.sysconf",
        {"SC_AVPHYS_PAGES": 100, "SC_PHYS_PAGES": 200, "SC_PAGE_SIZE": 4096}.__getitem__,
        raising=False,
    )
    assert available_memory(tmp_path) == available


# -- spectra and sweeps ----------------------------------------------------------------------------

SCENE = """\
material: {{young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}}
packing: {{diameter: 8 mm, lattice: {}, friction: {}}}
load: {{force: {}}}
observe: [{}]
phonopy: {{{}}}
"""
RANGE = "{from: 5 N, to: 9 N, points: 3000}"


@pytest.mark.parametrize(
    ("lattice", "friction", "load", "observe", "phonopy"),
    [
        pytest.param(
            "triangular", "true", "5 N", "bands", "band_points: 600", marks=pytest.mark.exhaustive
        ),
        pytest.param(
            "triangular", "false", "5 N", "bands", "band_points: 300", marks=pytest.mark.slow
        ),
        pytest.param(
            "kagome", "true", "5 N", "bands", "band_points: 150", marks=pytest.mark.exhaustive
        ),
        pytest.param(
            "triangular", "true", "5 N", "dos", "mesh: 200 200 1", marks=pytest.mark.exhaustive
        ),
        pytest.param(
            "triangular", "true", "5 N", "dos", "mesh: 60 61 1", marks=pytest.mark.exhaustive
        ),
        pytest.param(
            "triangular",
            "true",
            "5 N",
            "bands",
            "dim: 16 16 1, band_points: 2",
            marks=pytest.mark.exhaustive,
        ),
        pytest.param("triangular", "true", RANGE, "velocities", "", marks=pytest.mark.exhaustive),
        pytest.param(
            "triangular",
            "true",
            RANGE,
            "velocities, bands",
            "band_points: 40",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_memory_of_spectra_and_sweeps_is_what_their_arrays_take(
    tmp_path, lattice, friction, load, observe, phonopy
):
    scene = gp.Scene.from_text(SCENE.format(lattice, friction, load, observe, phonopy))
    guess = sum((part for _, _, part in scene.parts), cost.Cost())
    small = SCENE.format(
        lattice,
        friction,
        "[5 N, 6 N]" if load == RANGE else load,
        observe,
        "mesh: 4 4 1, band_points: 2",
    )
    # what is loaded once, factors and iterations on a grid, is not counted
    gp.Scene.from_text(small).run(tmp_path / "small", figures=False)
    tracemalloc.start()
    scene.run(tmp_path / "out", figures=False)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # less than what is announced, and not less than a quarter of it
    assert 0.25 < peak / (guess.working + guess.kept) < 1.0


HEAD = (
    "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\nload:"
    " {force: 10 N}\n"
)
IMPACT = (
    "observe: [motion]\nmotion: {repeat: %s, duration: %s, frames: 201, drive: {balls: 0, impact:"
    " 1 cm/s}}\n"
)
DRIVEN = (
    "observe: [response]\nresponse: {repeat: %s, source: 0 x, receiver: 5 x, frequencies: [1 kHz, 9"
    " kHz]}\n"
)
#: a small scene of the same kind comes first: what it loads or compiles, once for each machine, is
#: there before the peak of the process counts
RUN = r"""
import re, sys, granphon as gp
first, scene, folder = sys.argv[1:]
gp.Scene.from_text(first).run(folder + " first", figures=False)
open("/proc/self/clear_refs", "w").write("5")
gp.Scene.from_text(scene).run(folder, figures=False)
print(re.search(r"VmHWM:\s*(\d+) kB", open("/proc/self/status").read())[1])
"""


@pytest.mark.skipif(
    not os.access("/proc/self/clear_refs", os.W_OK),
    reason="the system does not tell the peak of a process",
)
@pytest.mark.parametrize(
    ("lattice", "first", "asked"),
    [
        ("chain", IMPACT % ("30", "0.05 ms"), IMPACT % ("300", "0.05 ms")),
        *(
            pytest.param(lattice, *(asked % cells for cells in repeats), marks=pytest.mark.slow)
            for lattice, asked, repeats in (
                ("chain", IMPACT % ("%s", "0.1 ms"), ("30", "1000")),
                ("triangular", IMPACT % ("%s", "0.1 ms"), ("6 6", "30 30")),
                ("triangular", DRIVEN, ("6 6", "50 50")),
                ("chain", DRIVEN, ("30", "10000")),
            )
        ),
        *(
            pytest.param(
                lattice, *(asked % cells for cells in repeats), marks=pytest.mark.exhaustive
            )
            for lattice, asked, repeats in (
                ("triangular", DRIVEN, ("6 6", "100 100")),
                ("triangular", IMPACT % ("%s", "0.1 ms"), ("6 6", "150 150")),
                ("fcc", IMPACT % ("%s", "0.05 ms"), ("3 3 3", "16 16 16")),
            )
        ),
    ],
    ids=lambda value: re.sub(r".*repeat: ([\d ]*),.*", r"\1", value, flags=re.DOTALL),
)
def test_memory_of_motions_and_responses_is_what_their_process_takes(
    tmp_path, lattice, first, asked
):
    head = f"{HEAD}packing: {{lattice: {lattice}, diameter: 8 mm}}\n"
    guess = sum((part for _, _, part in gp.Scene.from_text(head + asked).parts), cost.Cost())
    command = [sys.executable, "-c", RUN, head + first, head + asked, str(tmp_path / "out")]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert 1.0 / 1.5 < 1024.0 * float(done.stdout) / guess.memory < 1.5


@pytest.mark.claim("told-above")
def test_what_takes_more_than_a_second_or_100_mb_is_told():
    assert cost.Cost(units=(cost.Units(1000.0, lambda: 1.1e-3),)).tells
    assert cost.Cost(working=0.6e8, kept=0.41e8).tells
    assert cost.Cost(work=1.0, balls=64, equilibria=1).tells  # a simulation always
    few = cost.Units(1000.0, lambda: 0.9e-3)
    assert not cost.Cost(working=0.5e8, kept=0.49e8, units=(few,)).tells


def test_what_cannot_take_long_is_not_timed():
    def measure():
        raise AssertionError("this is timed")

    guess = cost.Cost(units=(cost.Units(1e6, measure),))
    assert not guess.takes_longer(cost.MOST_SECONDS)
    with pytest.raises(AssertionError):
        guess.takes_longer(10.0)


def test_small_arrays_are_not_timed_to_see_whether_they_take_a_minute(monkeypatch):
    def measure(simulation, load):
        raise AssertionError("this is timed")

    monkeypatch.setattr(cost, "_measure_ball", measure)

    def estimate(shape, samples, **settings):
        packing = gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH))
        simulation = gp.DirectSimulation(packing, shape, samples=samples, **settings)
        return cost.estimate(simulation, gp.Load("force", np.geomspace(0.05, 10.0, 9)), True)

    assert not estimate((24, 24), 4).takes_longer(60.0)
    assert not estimate((2, 2), 4).takes_longer(60.0)
    history = {"friction_history": True, "friction_coefficient": 0.5, "geometry": "lattice"}
    for long in (
        estimate((64, 64), 4),
        estimate((24, 24), 1, **history),  # each load takes many steps
    ):
        with pytest.raises(AssertionError):
            long.takes_longer(60.0)


def test_the_tables_of_few_states_are_not_timed(monkeypatch):
    def measure(do_piece):
        raise AssertionError("this is timed")

    monkeypatch.setattr(cost, "time_once", measure)
    cost._measure_number.cache_clear()
    assert not cost.sweep_states(2, 9, 0).tells
    with pytest.raises(AssertionError):
        _ = cost.sweep_states(2, 9000, 0).tells


def test_costs_add_up_to_one_after_the_other():
    first = taking(5.0, working=3.0, kept=1.0, work=7.0, balls=10, equilibria=2, parts=("a",))
    second = taking(6.0, working=2.0, kept=4.0, work=8.0, balls=20, equilibria=1, parts=("b",))
    total = first + second
    assert (total.working, total.kept, total.seconds, total.work) == (3.0, 5.0, 11.0, 15.0)
    assert (total.balls, total.equilibria, total.parts) == (20, 3, ("a", "b"))
    assert total.memory == cost._PYTHON_BYTES + 8.0
    thrice = first.times(3)
    assert (thrice.working, thrice.kept, thrice.seconds, thrice.work) == (3.0, 3.0, 15.0, 21.0)
    assert (thrice.balls, thrice.equilibria, thrice.parts) == (10, 6, ("a",))
    assert sum([first, second], cost.Cost()) == total


def test_bands_of_a_large_cell_go_as_the_cube_of_its_branches_and_take_few_matrices_at_a_time():
    """The memory is that of the arrays of a cell of 363 branches, with LAPACK's copy, which NumPy
    counts from 2.5 on.
    """
    few, many = (cost.bands(60, branches, eigenvectors=False) for branches in (1000, 3000))
    units = [one.units for one in (few, many)]
    growth = [of_many.number / of_few.number for of_few, of_many in zip(*units, strict=True)]
    # text grows as the square, eigenvalues as the cube
    assert growth == pytest.approx([9.0, 27.0], rel=2e-3)
    assert many.memory < 1e9 < cost.bands(60, 3000).memory
    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, spread=gp.Uniform(2e-6))
    ph = gp.Phonons(gp.DirectSimulation(packing, shape=(11, 11), seed=0).at_force(18.0).sample)
    ph.frequencies([[0.1, 0.2]])
    tracemalloc.start()
    ph.frequencies([[0.3, 0.1]])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    found = ph.estimate(1, eigenvectors=False)
    assert "363 branches" in found.text
    assert 1.0 < (found.working + found.kept) / peak < 3.0


def test_the_edges_of_the_bands_of_large_cells_take_long():
    """The cube of the branches counts, and cut-offs are those of all branches."""
    few = cost.band_edges(1, 100, 300, of_all=False).units[-1].number
    assert cost.band_edges(3, 100, 300, of_all=False).units[-1].number == 3.0 * few
    assert cost.band_edges(1, 100, 600, of_all=False).units[-1].number > 8.0 * few
    assert cost.band_edges(1, 100, 300, of_all=True).units[-1].number > 5.0 * few
    assert cost.band_edges(1, 100, 300, False, of_network=True).units[-1].number > 3.0 * few


@pytest.mark.parametrize("change", [{"boundary": "stress"}, {"geometry": "exact"}])
def test_the_estimate_and_the_check_of_a_simulation_count_the_same_memory(change, monkeypatch):
    medium = replace(simulation(shape=(2048, 2048)), **change)
    load = Load("force", [5.0, 6.0])
    needed = []
    monkeypatch.setattr(
        "granphon.media.simulation.require_memory", lambda what, size, mend: needed.append(size)
    )
    medium._require_memory(load)
    assert needed == [estimate(medium, load).working]
    # contacts that turn are listed; those of a cell that shears stay a grid
    at_rest = estimate(simulation(shape=(2048, 2048)), load).working
    assert (needed[0] > at_rest) == ("geometry" in change)


def test_an_estimate_is_in_the_geometry_that_the_load_chooses():
    medium = replace(simulation(shape=(2048, 2048)), geometry=None)
    for force, geometry in ((0.3, "exact"), (1e3, "lattice")):
        load = Load("force", force)
        assert [medium.geometry for medium, _ in medium.by_geometry(load)] == [geometry]
        expected = replace(medium, geometry=geometry).find_memory(load)
        assert estimate(medium, load).working == expected


@pytest.mark.parametrize(
    ("first", "later", "calls", "expected"),
    [(0.5, 0.03, 3, 0.03), (2.0, 0.03, 1, 2.0), (0.03, 0.03, 3, 0.03)],
)
def test_imports_of_the_first_call_are_not_in_the_time(monkeypatch, first, later, calls, expected):
    """A clock that the calls alone move; a long piece of work is done once."""
    durations = []
    monkeypatch.setattr("granphon.media.cost.process_time", lambda: sum(durations))

    def do_piece():
        durations.append(later if durations else first)

    assert cost.time_once(do_piece) == pytest.approx(expected)
    assert len(durations) == calls
