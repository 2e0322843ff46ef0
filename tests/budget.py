"""The budget of the default tests: a case has half a second of processor, or it is marked ``slow``.

The exceptions are the guards, each of which alone guards a subject that costs more. With
``GRANPHON_TEST_BUDGET=1``, as in ``.ci/run``, a default case that is no guard fails if its call, or
one of its fixtures, takes more than one second of processor, that of child processes included. The
limit is twice the budget, as processors differ. What a process pays once (imports, compiled loops,
the first figure) is paid before the first test there, and is told with its time.
"""

from __future__ import annotations

import io
import os
from collections.abc import Generator, Mapping
from typing import Any

import pytest

#: s of processor that a default case may take where the budget is held
LIMIT = 1.0
IS_HELD = os.environ.get("GRANPHON_TEST_BUDGET") == "1"

#: test functions that alone guard a subject, and the subject, which costs more than the budget
GUARDS: Mapping[str, str] = {
    "tests/array/test_friction_history.py::test_the_energy_of_an_array_from_the_gas_is_kept": (
        "the energy of an array that is pressed from the gas"
    ),
    "tests/array/test_friction_lammps.py::test_forces_are_those_of_lammps": (
        "an array pressed with friction by LAMMPS"
    ),
    "tests/figures/test_plot.py"
    "::test_a_figure_is_saved_without_pyplot_whatever_backend_the_environment_names": (
        "a figure in a new process"
    ),
    "tests/networks/test_network_friction.py"
    "::test_lammps_responds_as_the_network_with_tangential_forces": (
        "a packing pressed with friction by LAMMPS"
    ),
    "tests/page/test_page.py::test_a_page_needs_neither_phonopy_nor_matplotlib": (
        "a page in a new process"
    ),
    "tests/page/test_page.py::test_a_page_of_a_scene": "a page by the command",
    "tests/page/test_page.py::test_the_page_computes_what_the_library_computes": (
        "every lattice in a page"
    ),
    "tests/page/test_page.py::test_friction_between_the_nodes_of_the_effective_medium": (
        "the table of the effective medium in a page"
    ),
    "tests/page/test_page.py::test_the_page_says_what_bending_would_do_to_the_medium": (
        "the same table: the first of the two tests makes it"
    ),
}


def measure_processor_time() -> float:
    """Return the seconds of processor of this process and of its children that have ended."""
    return sum(os.times()[:4])


def may_be_long(item: pytest.Item) -> bool:
    """Whether a test is a guard, or is not in the default selection."""
    marked = any(item.get_closest_marker(name) for name in ("slow", "exhaustive"))
    return marked or item.nodeid.partition("[")[0] in GUARDS


def pytest_sessionstart(session: pytest.Session) -> None:
    """Where the budget is held, pay once for what no test is to pay; the first process compiles."""
    if IS_HELD:
        seconds = warm_up()
        if not hasattr(session.config, "workerinput"):
            print(f"warm-up of each process: {seconds:.1f} s of processor here")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Fail a default case that takes more than the limit."""
    start = measure_processor_time()
    outcome = yield
    require_budget(item, "it", measure_processor_time() - start)
    return outcome


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(
    fixturedef: Any, request: pytest.FixtureRequest
) -> Generator[None, Any, Any]:
    """Fail a default case whose fixture takes more than the limit."""
    start = measure_processor_time()
    outcome = yield
    if isinstance(request.node, pytest.Item):
        require_budget(
            request.node, f"its fixture {fixturedef.argname}", measure_processor_time() - start
        )
    return outcome


def require_budget(item: pytest.Item, what: str, spent: float) -> None:
    """Fail a test of which ``what`` has taken more seconds of processor than the limit."""
    if IS_HELD and spent > LIMIT and not may_be_long(item):
        pytest.fail(
            f"{what} took {spent:.1f} s of processor, and a default case has {LIMIT / 2:g} s."
            " Give it a smaller case, or mark it slow",
            pytrace=False,
        )


def warm_up() -> float:
    """Pay what a process pays once: imports, loops that Numba compiles, the first figure. Return
    the seconds of processor.
    """
    start = measure_processor_time()
    import matplotlib.pyplot as plt
    import numpy as np

    import granphon as gp

    figure, axes = plt.subplots()
    axes.plot([0.0, 1.0], [0.0, 1.0], label="line")
    axes.legend()
    figure.savefig(io.BytesIO(), format="png")
    plt.close(figure)
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    for lattice, shape in (("triangular", (3, 3)), ("fcc", (2, 2, 2))):
        state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice=lattice)).at_force(10.0)
        network = state.network.repeat(shape)
        velocities = np.zeros((network.n_balls, 3))
        velocities[0, 0] = 0.01
        for geometry in ("lattice", "exact"):
            waves = gp.NonlinearWaves(network, geometry=geometry, friction_coefficient=0.2)
            waves.run(1e-7, velocities=velocities, frames=2)
    return measure_processor_time() - start
