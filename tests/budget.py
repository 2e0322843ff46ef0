"""The budget of the default tests: a case has half a second of processor, or it is marked ``slow``.

The exceptions are the guards, each of which alone guards a subject that costs more. With
``GRANPHON_TEST_BUDGET=1``, as in ``.ci/run`` on the newest Python, a default case that is no guard
fails if its call, or one of the fixtures made for it alone, takes more than one second of processor,
that of child processes included. The limit is twice the budget, as a busy machine takes up to twice the
time of a quiet one; that of a property grows with its examples. A case above the limit runs again,
at most twice, and the last count decides: the first one may hold what a process does only once. As
processors differ, the last count is compared with that of a fixed piece of work right after it. What
each process is known to pay once (imports, compiled loops, the first figure) is paid before the first
test there, and is told with its time.
"""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Generator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from _pytest.runner import runtestprotocol

#: s of processor that a default case may take where the budget is held
LIMIT = 1.0
#: examples of each property, and how many of them the limit is for; ".ci/run all" tries more
USUAL_EXAMPLES = 25
EXAMPLES = int(os.environ.get("GRANPHON_TEST_EXAMPLES", USUAL_EXAMPLES))
IS_HELD = os.environ.get("GRANPHON_TEST_BUDGET") == "1"
#: how often a case runs at most
RUNS = 3
#: additions of the fixed piece of work, and the s of processor that they take on the oldest Python
#: alone on the machine where LIMIT was chosen
ADDITIONS = 3_000_000
YARDSTICK = 0.19
#: whether this run of a case has taken more than the limit, and whether the case runs for the last time
_IS_LONG = pytest.StashKey[bool]()
_IS_LAST = pytest.StashKey[bool]()

_SCENE = """
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm}
load: {force: 1 N}
"""

#: test functions that alone guard a subject, and the subject, which costs more than the budget
GUARDS: Mapping[str, str] = {
    "tests/base/test_notebook.py::test_asking_for_a_picture_loads_matplotlib_and_no_pyplot": (
        "pictures without pyplot"
    ),
    "tests/base/test_reading.py::test_a_sweep_without_a_digest_runs_nothing_that_stands_where_we_are": (
        "a netCDF file that a process of its own opens first"
    ),
    "tests/base/test_results.py::test_every_class_of_results_is_made": (
        "that plain data of every class of results are tested"
    ),
    "tests/cli/test_cli.py::test_progress_on_a_real_terminal_leaves_stdout_alone": (
        "progress on a terminal"
    ),
    "tests/runs/test_run.py::test_workers_end_with_the_command_and_what_they_have_finished_is_kept": (
        "workers of a command that is killed"
    ),
    "tests/test_light.py::test_the_core_gives_the_same_numbers_on_numpy_scipy_and_numba_alone": (
        "the core without any other package"
    ),
    "tests/test_light.py::test_what_needs_an_absent_package_says_which_and_how_to_install_it": (
        "what each absent package takes away"
    ),
    "tests/test_required.py::test_a_scene_calls_loads_and_writes_what_it_asks_and_nothing_else": (
        "what a scene pays for, in processes of its own"
    ),
    "tests/fits/test_fit.py::test_errors_of_given_sigma_are_right_in_repeated_experiments": (
        "the errors of a fit against the scatter of repeated experiments"
    ),
    "tests/fits/test_fit.py::test_a_spread_that_does_not_carry_the_frequency_is_named": (
        "a fit whose spreads do not carry the frequency of its pulses"
    ),
    "tests/fits/test_fit.py::test_samples_that_belong_to_one_width_give_it": (
        "a fit to simulated samples in their true geometry, or with a history"
    ),
    "tests/fits/test_transfer.py::test_a_load_multiplies_all_static_forces": (
        "a load fitted to a transfer function"
    ),
    "tests/fits/test_transfer.py"
    "::test_stiffness_and_gain_are_found_with_the_damping_and_errors_follow_from_the_scatter": (
        "three parameters fitted to a transfer function"
    ),
    "tests/fits/test_transfer.py::test_the_command_fits_the_response_of_a_scene": (
        "the command that fits a response, its figure and the same figure drawn again"
    ),
    "tests/phonons/test_ball_contacts.py::test_ase_finds_calculator_and_formats_by_itself": (
        "a process of ASE's in which granphon is installed"
    ),
    "tests/phonons/test_phonopy_bridge.py::test_the_phonopy_command_without_options": (
        "the command of phonopy on a file of granphon's"
    ),
    "tests/waves/test_nonlinear.py::test_a_file_of_a_motion_whose_program_was_killed_can_be_read": (
        "the file of a motion whose process was killed"
    ),
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
    "tests/tradeoffs/test_tradeoff.py::test_a_command_writes_table_and_picture": (
        "the command that measures errors over times"
    ),
    "tests/tradeoffs/test_tradeoff.py::test_an_interruption_leaves_nothing": (
        "an interrupted measurement"
    ),
    "tests/tradeoffs/test_tradeoff.py::test_media_in_space_are_judged_by_samples_in_space": (
        "a reference of samples in space"
    ),
    "tests/media/test_cost.py::test_memory_of_motions_and_responses_is_what_their_process_takes": (
        "the peak of the memory of a process"
    ),
    "tests/runs/test_schedulers.py::test_a_killed_worker_costs_what_it_was_at": (
        "a scheduler of two workers, of which one is killed"
    ),
    "tests/runs/test_schedulers.py::test_a_task_that_kills_its_workers_is_named": (
        "a task that no worker survives"
    ),
    "tests/waves/test_nonlinear_lammps.py::test_balls_with_friction_move_as_in_lammps": (
        "a motion with friction by LAMMPS"
    ),
    "tests/waves/test_nonlinear_lammps.py::test_coulombs_limit_is_that_of_the_law_without_dashpots": (
        "a motion with friction and dashpots by LAMMPS"
    ),
    "tests/test_structure.py::test_a_statement_does_one_thing_and_names_are_nouns_or_verbs": (
        "how the text of the package reads"
    ),
    "tests/runs/test_sweep_waves.py::test_lines_are_means_over_samples": (
        "a sweep of spectra over samples"
    ),
    "tests/runs/test_schedulers.py::test_the_numbers_are_those_of_one_process": (
        "a scheduler of dask with two workers"
    ),
    "tests/runs/test_run.py::test_a_result_of_another_kind_is_replaced_as_a_whole": (
        "results of two kinds in one folder"
    ),
    "tests/runs/test_sweeps.py::test_a_complete_sweep_is_read_again": (
        "a sweep of every kind that is read again"
    ),
    "tests/figures/test_curves.py::test_the_command_draws_files_in_one_figure": (
        "curves of several files by the command"
    ),
}


def measure_processor_time() -> float:
    """Return the seconds of processor of this process and of its children that have ended."""
    return sum(os.times()[:4])


def may_be_long(item: pytest.Item) -> bool:
    """Whether a test is a guard, or is not in the default selection."""
    marked = any(item.get_closest_marker(name) for name in ("slow", "exhaustive"))
    return marked or item.nodeid.partition("[")[0] in GUARDS


@pytest.hookimpl(trylast=True)  # hypothesis refuses to make its table of characters earlier
def pytest_sessionstart(session: pytest.Session) -> None:
    """Where the budget is held, pay once for what no test is to pay; the first process compiles."""
    if IS_HELD:
        seconds = warm_up()
        if not hasattr(session.config, "workerinput"):
            print(f"warm-up of each process: {seconds:.1f} s of processor here")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a default case, and again if it takes more than the limit."""
    if not IS_HELD or may_be_long(item):
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for run in range(1, RUNS + 1):
        item.stash[_IS_LONG] = False
        item.stash[_IS_LAST] = run == RUNS
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        if not item.stash[_IS_LONG] or not all(report.passed for report in reports):
            break
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Hold the call of a default case to the limit."""
    start = measure_processor_time()
    outcome = yield
    require_budget(item, "it", measure_processor_time() - start)
    return outcome


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(
    fixturedef: Any, request: pytest.FixtureRequest
) -> Generator[None, Any, Any]:
    """Hold a fixture that is made for a default case alone to the limit."""
    start = measure_processor_time()
    outcome = yield
    if isinstance(request.node, pytest.Item):
        spent = measure_processor_time() - start
        require_budget(request.node, f"its fixture {fixturedef.argname}", spent)
    return outcome


def measure_slowness() -> float:
    """Return how many times longer than where the limit was chosen this processor takes at present."""
    start = measure_processor_time()
    total = 0
    for number in range(ADDITIONS):
        total += number % 7
    return (measure_processor_time() - start) / YARDSTICK


def find_limit(item: pytest.Item) -> float:
    """Return the limit of a case in seconds of processor; that of a property grows with its
    examples.
    """
    is_property = item.get_closest_marker("hypothesis") is not None
    return LIMIT * (max(1.0, EXAMPLES / USUAL_EXAMPLES) if is_property else 1.0)


def require_budget(item: pytest.Item, what: str, spent: float) -> None:
    """Fail a test of which ``what`` takes more seconds of processor than the limit, if the test is
    run for the last time.
    """
    if not IS_HELD or spent <= find_limit(item) or may_be_long(item):
        return
    item.stash[_IS_LONG] = True
    if not item.stash.get(_IS_LAST, False) or spent <= find_limit(item) * measure_slowness():
        return
    pytest.fail(
        f"{what} took {spent:.1f} s of processor, and has {find_limit(item) / 2:g} s."
        " Give it a smaller case, or mark it slow",
        pytrace=False,
    )


def warm_up() -> float:
    """Pay what a process pays once: imports, loops that Numba compiles, the first figure, the first
    scene. Return the seconds of processor.
    """
    start = measure_processor_time()
    import matplotlib.pyplot as plt
    import numpy as np
    from hypothesis import find
    from hypothesis.strategies import characters

    import granphon as gp
    from granphon.cli.main import main

    # hypothesis makes its table of characters where a clone has none
    find(characters(codec="utf-8"), lambda _: True)
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
            waves = gp.NonlinearWaves(
                network, geometry=geometry, friction_coefficient=0.2, damping=1e-6
            )
            waves.run(1e-7, velocities=velocities, frames=2)
            waves.run(1e-7, velocities=velocities, frames=2, scheme="midpoint")
    with TemporaryDirectory() as folder:
        sweep = Path(folder) / "sweep.nc"
        gp.sweep(gp.Packing(steel, 8e-3), force=[1.0, 2.0]).to_netcdf(sweep, engine="h5netcdf")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it has no digest
            gp.load_sweep(sweep)
        (Path(folder) / "scene.yaml").write_text(_SCENE, encoding="utf-8")
        out = str(Path(folder) / "out")
        assert main(["run", str(Path(folder) / "scene.yaml"), "-o", out, "-q"]) == 0
    return measure_processor_time() - start
