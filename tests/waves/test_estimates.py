"""What results of waves are said to cost beforehand, against the work that they then report."""

from __future__ import annotations

from contextlib import contextmanager
from fractions import Fraction
from inspect import signature
from types import SimpleNamespace

import numpy as np
import pytest

import granphon as gp
from granphon.array.sparse_matrices import estimate_factors
from granphon.base.errors import InputError
from granphon.dynamics.iterative_relaxation import IterativeRelaxation
from granphon.waves.estimates import FINDERS, WaveEstimate
from tests import packings


class Counter:
    """A progress that adds up the pieces of work, and keeps what was expected, by label."""

    def __init__(self):
        self.expected = {}
        self.done = {}

    @contextmanager
    def step(self, label, total=None):
        self.expected[label] = self.expected.get(label, 0.0) + (total or 0.0)
        self.done.setdefault(label, 0.0)

        def advance(amount=1.0):
            self.done[label] += amount

        yield SimpleNamespace(advance=advance)


@pytest.fixture(scope="module")
def network():
    """Four hundred disks of LAMMPS: more motions than are found by a dense matrix."""
    files = (packings.FOLDER / f"glass_{part}.dump" for part in ("atoms", "pairs"))
    return gp.ContactNetwork.from_lammps(*files, packings.MATERIAL)


def count(cost):
    """The number of units of a cost."""
    return sum(unit.number for unit in cost.units)


CALLS = {
    "density of states": ("dos", {"vectors": 3, "moments": 40}),
    "spectral functions": ("spectral_function", {"q": [[0.0, 0.0]], "direction": (1, 0), "moments": 40}),
    "modes below frequencies": ("count_modes", {"frequencies": [1e5, 2e5]}),
}  # fmt: skip


@pytest.mark.parametrize("label", CALLS)
def test_work_is_counted_before_it_is_done(network, label):
    name, options = CALLS[label]
    progress = Counter()
    waves = gp.Waves(network, progress=progress)
    cost = waves.estimate(name, **options)
    assert progress.done == {}
    getattr(waves, name)(**options)
    assert progress.done[label] == progress.expected[label] == count(cost)
    assert "disks" not in cost.text
    assert f"{waves.operator.balls.size} balls" in cost.text
    assert cost.working > waves.operator.matrix.data.nbytes
    assert cost.seconds > 0.0


@pytest.mark.parametrize("damping", [0.0, (1e-8, 3e-8)])
def test_products_of_a_pulse_are_counted(network, damping):
    progress = Counter()
    waves = gp.Waves(network, progress=progress)
    cost = waves.estimate("transmit", 3e5, (1, 0), 1e-2, 2.0, damping=damping)
    waves.transmit(3e5, (1, 0), 1e-2, 2.0, damping=damping)
    assert progress.done["pulse"] == pytest.approx(progress.expected["pulse"])
    if damping:
        assert count(cost) > 100.0
    else:
        assert progress.done["pulse"] == pytest.approx(count(cost), rel=0.1)


def test_steps_of_a_response_are_counted(network):
    progress = Counter()
    waves = gp.Waves(network, progress=progress)
    top = waves.operator.top / (2.0 * np.pi)
    frequencies = np.linspace(0.3, 0.5, 5) * top
    options = {"loss_factor": 0.2, "method": "krylov"}
    cost = waves.estimate("response", frequencies, (0, "x"), [(5, "x")], **options)
    found = waves.response(frequencies, (0, "x"), [(5, "x")], **options)
    assert progress.done["response"] == found.steps
    assert found.steps == pytest.approx(progress.expected["response"], rel=0.5)
    assert count(cost) == pytest.approx(2.0 * progress.expected["response"])
    by_factors = waves.estimate("response", frequencies, method="direct", loss_factor=0.2)
    waves.response(frequencies, (0, "x"), [(5, "x")], loss_factor=0.2, method="direct")
    assert progress.done["response by factors"] == count(by_factors) == 5


def test_an_estimate_takes_the_names_of_arguments(network):
    """What the method takes by name its estimate takes by the same name, and in the same order."""
    methods = set(FINDERS) - {"moduli", "transmission"}
    assert len(methods) == 7
    for name in methods:
        _, *of_method = signature(getattr(gp.Waves, name)).parameters.values()
        names = [(parameter.name, parameter.kind) for parameter in of_method]
        _, *of_estimate = signature(FINDERS[name]).parameters.values()
        assert [(parameter.name, parameter.kind) for parameter in of_estimate] == names
    by_name = gp.Waves(network).estimate(
        "response", [1e3], source=(0, "x"), receiver=[(5, "x")], method="direct"
    )
    assert count(by_name) == 1


def test_products_of_filtered_modes_are_counted(network, monkeypatch):
    monkeypatch.setattr("granphon.waves.modes.LARGEST_FACTORS", {2: 0, 3: 0})
    progress = Counter()
    waves = gp.Waves(network, progress=progress)
    cost = waves.estimate("modes", 2, nearest=3e5)
    assert set(progress.done) == {"density of states"}
    waves.modes(2, nearest=3e5)
    filters = progress.done["modes of a window"]
    assert filters == progress.expected["modes of a window"]
    # each polynomial is of several random vectors
    assert 2.0 * filters < count(cost) < 50.0 * filters


def test_a_result_without_an_estimate_is_refused(network):
    with pytest.raises(InputError, match="transmit"):
        gp.Waves(network).estimate("bands")
    small = gp.Waves(network.select(np.arange(60)).without_rattlers())
    assert small.operator.size < 600
    assert "modes" in small.estimate("modes", 3).text
    assert small.estimate("dos").seconds > 0.0


def test_iterations_of_moduli_are_estimated(network, monkeypatch):
    """Of a network that is relaxed by iteration the number of products is about that which is
    counted; of smaller ones it is the size of factors, or of a dense matrix.
    """
    files = (packings.FOLDER / f"balls_{part}.dump" for part in ("atoms", "pairs"))
    balls = gp.ContactNetwork.from_lammps(*files, packings.MATERIAL).repeat((2, 2, 1))
    assert "moduli" in gp.Waves(network).estimate("moduli").text
    assert count(gp.Waves(network).estimate("moduli")) < 1.0
    monkeypatch.setattr("granphon.dynamics.long_waves.MOST_RELAXED_BY_FACTORS", 0)
    monkeypatch.setattr("granphon.dynamics.long_waves.MOST_FIRM_RELAXED_BY_FACTORS", 0)
    cost = gp.Waves(balls).estimate("moduli")
    applied = []
    solve = IterativeRelaxation._solve

    def count_products(relaxation, apply, right, *floor):
        return solve(relaxation, lambda x: applied.append(x.shape[1]) or apply(x), right, *floor)

    monkeypatch.setattr(IterativeRelaxation, "_solve", count_products)
    gp.moduli(balls)
    assert count(cost) == pytest.approx(sum(applied), rel=0.7)


@pytest.mark.parametrize(
    ("name", "arguments", "options"),
    [
        ("dos", (), {"seed": -1}),
        ("dos", (), {"vectors": 2**40}),
        ("modes", (10**5,), {}),
        ("modes", (10, 1e12), {}),
        ("branches", ([0.0, 0.0], 10**5), {}),
        ("count_modes", ([-1.0],), {}),
        ("transmit", (1e7, (0, 1), 0.015), {}),
        ("response", ([100.0], (0, "x"), (1, "x")), {"method": "fast"}),
        ("response", ([100.0], (0, "x"), (1, "x")), {"tolerance": -1.0}),
        ("response", ([100.0], (0, "x"), (1, "x")), {"quantity": "speed"}),
        (
            "response",
            ([100.0], (0, "x"), (1, "x")),
            {"method": "krylov", "damping": (1e-6, 0.0)},
        ),
    ],
)
def test_estimates_refuse_what_the_results_refuse(network, name, arguments, options):
    waves = gp.Waves(network)
    with pytest.raises(InputError):
        getattr(waves, name)(*arguments, **options)
    with pytest.raises(InputError):
        waves.estimate(name, *arguments, **options)


def test_numbers_of_modes_above_the_top_take_no_factors(network):
    waves = gp.Waves(network)
    top = waves.operator.top / (2.0 * np.pi)
    costs = [waves.estimate("count_modes", [0.5 * top, factor * top]) for factor in (0.6, 2.0)]
    assert costs[0].seconds > 1.5 * costs[1].seconds


def test_modes_are_refused_before_the_network_is_found_stable(network, monkeypatch):
    def refuse(_operator):
        raise AssertionError("stability was examined first")

    monkeypatch.setattr("granphon.waves.waves.require_stable", refuse)
    waves = gp.Waves(network)
    for name, arguments in (
        ("modes", (0,)),
        ("dos", (-1.0,)),
        ("count_modes", ([0.0],)),
        ("spectral_function", ([1.0],)),
        ("response", ([100.0], (0, "x"), (10**9, "x"))),
    ):
        with pytest.raises(InputError):
            getattr(waves, name)(*arguments)


def test_frames_of_a_pulse_take_memory(network):
    waves = gp.Waves(network)
    arguments = (3e5, (1, 0), 1e-2, 2.0)
    frames = np.linspace(0.0, 1e-5, 1000)
    without, found = (
        waves.estimate("transmit", *arguments, **options) for options in ({}, {"frames": frames})
    )
    velocities = waves.transmit(*arguments, frames=frames[:2]).velocities
    # displacements and velocities as vectors, and then the velocities of all balls
    kept = 500 * velocities.nbytes + 2.0 * 8.0 * 1000 * waves.operator.size
    assert found.working - without.working == pytest.approx(kept, rel=0.01)
    as_fraction = waves.estimate("transmit", Fraction(300_000), *arguments[1:])
    assert as_fraction.parts == without.parts


def test_factors_take_less_than_is_estimated(network):
    """Without what the library takes for itself; each entry takes 16 bytes."""
    lattice = gp.AveragedLattice(gp.Packing(packings.MATERIAL, 1e-2, friction=True)).at_force(1.0)
    for packing in (network, lattice.network.repeat((40, 40))):
        operator = gp.Waves(packing).operator
        matrix = operator.matrix.astype(complex)
        matrix.setdiag(matrix.diagonal() - 0.3 * operator.top**2 * (1.0 + 0.01j))
        _, of_library = estimate_factors(operator.size, 2, 0.0)
        memory = operator.estimate_factors()[1] - of_library
        columns = matrix.tocsc()
        symbolic = pytest.importorskip("rslab").analyze(columns, path="ldlt")
        taken = symbolic.memory_plan("complex128")["factor_bytes"]
        assert 0.1 * memory < taken < memory


def test_estimates_of_factors_follow_contacts():
    """A large triangular lattice took 0.63 GB, as a process with rslab told, and 0.9 GB with
    SuperLU; a packing with fewer contacts takes less.
    """
    _, dense = estimate_factors(120_000, 2, 6.0)
    _, sparse = estimate_factors(120_000, 2, 4.5)
    assert 0.63e9 < dense < 1.0e9
    assert sparse < 0.8 * dense


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        (("dos",), {"width": 3.0}, "width"),
        (("transmit",), {}, "frequency"),
        (("transmit", 1e3, (1,), 0.1), {"end": "free"}, "end"),
    ],
)
def test_arguments_that_a_result_does_not_have_are_refused(arguments, options, words):
    ball = gp.Ball(packings.MATERIAL, 8e-3)
    waves = gp.Waves(gp.Crystal.on("chain", [ball]).at_force(1.0).network.repeat((9,)))
    with pytest.raises(InputError, match=words):
        waves.estimate(*arguments, **options)
    with pytest.raises(TypeError, match=words):  # of a wrong call inside the package
        WaveEstimate(waves.operator).bind(*arguments, **options)
