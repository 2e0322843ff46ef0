"""Moduli and sound of cells of many balls by sparse factors: against dense singular values, and
their cells.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import csr_array

import granphon as gp
from granphon.base.errors import GranphonError, InputError, InstabilityError
from granphon.dynamics import iterative_relaxation, long_waves, sparse_relaxation
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.fronts import Fronts, dissect
from granphon.dynamics.iterative_relaxation import IterativeRelaxation
from granphon.dynamics.sparse_relaxation import SparseRelaxation
from tests.dynamics.test_network_lattice import STEEL, random_network, ribbon
from tests.packings import balance


def keep(network, kept):
    fields = {name: getattr(network, name)[kept] for name in network.contact_fields}
    return replace(network, **fields)


def bare(name, shape, part=1.0, slip=True, seed=2):
    """A part of the contacts of a random network, without torsion and bending, and with slip or
    not.
    """
    network = random_network(name, shape)
    nothing = np.zeros(network.n_contacts)
    shear = network.shear_stiffness if slip else nothing
    network = replace(
        network, shear_stiffness=shear, torsion_stiffness=nothing, bending_stiffness=nothing
    )
    return keep(network, np.random.default_rng(seed).uniform(size=network.n_contacts) < part)


def hang(contacts):
    """A network of which one ball has so many contacts."""
    network = bare("fcc", (2, 2, 3))
    kept = (network.i != 3) & (network.j != 3)
    kept[np.flatnonzero(~kept)[:contacts]] = True
    return keep(network, kept)


def iterate(network, monkeypatch):
    """The lattice of a network whose cell counts as too large for factors and dense matrices."""
    monkeypatch.setattr(long_waves, "MANY_COLUMNS", 0)
    monkeypatch.setattr(long_waves, "MOST_DENSE_WITH_GEARS", 0)
    monkeypatch.setattr(long_waves, "MOST_FIRM_RELAXED_BY_FACTORS", 0)
    monkeypatch.setattr(long_waves, "MOST_RELAXED_BY_FACTORS", 0)
    iterated = ContactLattice._make_of_network(network)
    assert type(iterated._sparse_relaxation) is IterativeRelaxation
    return iterated


ITERATED = {
    "fcc": lambda: random_network("fcc", (3, 3, 3)),
    "prestress": lambda: balance(random_network("fcc", (2, 2, 3), prestress=True)),
    "a ball without contacts": lambda: hang(0),
    "a ball with two contacts": lambda: hang(2),
    "fewer contacts, no slip": lambda: bare("fcc", (3, 3, 3), 0.85, slip=False),
}


@pytest.mark.claim("iterated-moduli")
@pytest.mark.parametrize("name", list(ITERATED))
def test_iteration_gives_the_moduli_and_sound_of_factors(name, monkeypatch):
    """The energy of a strain comes from above, with twice the digits of the motions."""
    network = ITERATED[name]()
    monkeypatch.setattr(long_waves, "MANY_COLUMNS", 0)
    factored = ContactLattice.from_network(network)
    assert type(factored._sparse_relaxation) is SparseRelaxation
    iterated = iterate(network, monkeypatch)
    tensor = factored.elastic_tensor()
    change = iterated.elastic_tensor() - tensor
    assert np.max(np.abs(change)) < 1e-10 * np.max(tensor)
    if name != "prestress":
        assert np.linalg.eigvalsh(change)[0] > -1e-12 * np.max(tensor)
    directions = [[1.0, 0.0, 0.0], [1.0, 2.0, 3.0]]
    assert_allclose(
        iterated.sound_velocities(directions)[0],
        factored.sound_velocities(directions)[0],
        rtol=1e-9,
    )
    # a ball that spins between two contacts twists them, which costs nothing, by any amount
    resisting = [row.kind in {row.kind for row in factored.rows} for row in factored.unit_rows]
    deformations = factored.gradient_deformations[1][: len(resisting)][resisting]
    assert_allclose(
        iterated.gradient_deformations[1][: len(resisting)][resisting],
        deformations,
        rtol=0.0,
        atol=1e-8 * np.max(np.abs(deformations)),
    )


#: networks, and whether they are iterated if they are large, but not beyond what factors can do
FIRM = {
    "fcc": (lambda: bare("fcc", (2, 2, 3)), True),
    "a ball without contacts": (lambda: hang(0), True),
    "a ball with one contact": (lambda: hang(1), True),
    "five contacts for each ball": (lambda: bare("fcc", (2, 3, 3), 0.4), True),
    "clusters that are loose": (lambda: bare("fcc", (3, 3, 3), 0.35), False),
    "without friction": (lambda: bare("fcc", (2, 3, 3), slip=False), True),
    "without friction, loose clusters": (lambda: bare("fcc", (3, 3, 3), 0.56, slip=False), False),
    "balls that turn as gears do": (lambda: bare("sc", (4, 2, 2)), False),
    "gears, each in an odd ring": (lambda: bare("sc", (3, 3, 3)), True),
    "plane": (lambda: random_network("triangular", (4, 3)), False),
}


@pytest.mark.claim("iterated-moduli")
@pytest.mark.parametrize("name", list(FIRM))
def test_loose_balls_are_relaxed_by_factors(name, monkeypatch):
    """Factors find motions of several balls that cost nothing in less time than iteration: moduli
    and sound are those of factors in every case.
    """
    make, is_iterated = FIRM[name]
    network = make()
    monkeypatch.setattr(long_waves, "MANY_COLUMNS", 0)
    factored = ContactLattice._make_of_network(network)
    monkeypatch.setattr(long_waves, "MOST_FIRM_RELAXED_BY_FACTORS", 0)
    lattice = ContactLattice._make_of_network(network)
    assert lattice.tries_iteration == (is_iterated or "clusters" in name)
    assert (type(lattice._sparse_relaxation) is IterativeRelaxation) == is_iterated
    results = []
    for cell in (lattice, factored):
        try:
            tensor = cell.elastic_tensor()
            sound = cell.sound_velocities([1.0, 2.0, 3.0][: cell.periods])[0]
            results.append(np.append(tensor.ravel(), sound))
        except GranphonError as error:
            results.append(str(error))
    if isinstance(results[1], str):
        assert results[0] == results[1]
    else:
        assert_allclose(results[0], results[1], rtol=1e-9, atol=1e-10)


def gears(difference, **options):
    """A simple cubic crystal whose balls can turn as gears do, but that their lever arms differ by
    up to such a part, as overlaps do.
    """
    packing = gp.Packing(STEEL, 8e-3, lattice="sc", motions="all")
    network = gp.AveragedLattice(packing).at_force(10.0, **options).network.repeat((4, 2, 2))
    rng = np.random.default_rng(1)
    arms = 4e-3 * (1.0 - difference * rng.uniform(size=(2, network.n_contacts)))
    return replace(network, arm_i=arms[0], arm_j=arms[1], lattice=None, shape=None)


#: networks with motions of several balls that cost nothing, or nothing but for their overlaps
LOOSE = {
    "clusters that are loose": lambda: bare("fcc", (3, 3, 3), 0.35),
    "without friction, loose clusters": lambda: bare("fcc", (3, 3, 3), 0.56, slip=False),
    "without friction, a mechanism": lambda: bare("fcc", (2, 3, 3), 0.45, slip=False),
    "loose, a mechanism": lambda: bare("fcc", (2, 3, 3), 0.25),
    "gears": lambda: gears(0.0),
    "gears of arms that differ by 1e-8": lambda: gears(1e-8),
    "gears of arms that differ by 1e-6": lambda: gears(1e-6),
    "gears of arms that differ by 1e-3": lambda: gears(1e-3),
    "gears under prestress": lambda: gears(1e-5, finite_overlap=True),
}


@pytest.mark.claim("iterated-moduli")
@pytest.mark.parametrize("name", list(LOOSE))
def test_what_is_loose_is_found_by_iteration(name, monkeypatch):
    """In a cell too large for factors, too, loose balls stay behind in sound, gears do not make a
    crystal soft, and a mechanism is refused: as with dense matrices.
    """
    network = LOOSE[name]()
    monkeypatch.setattr(long_waves, "MANY_COLUMNS", 10**9)
    dense = ContactLattice._make_of_network(network)
    along = [[1.0, 2.0, 3.0], [1.0, 0.0, 0.0]]
    if dense.mechanism:
        assert iterate(network, monkeypatch).mechanism == dense.mechanism
        return
    tensor = dense.elastic_tensor()
    sound = dense.sound_velocities(along)[0]
    iterated = iterate(network, monkeypatch)
    assert_allclose(iterated.elastic_tensor(), tensor, rtol=0.0, atol=1e-9 * np.max(tensor))
    assert_allclose(iterated.sound_velocities(along)[0], sound, rtol=1e-9)
    assert iterated.loose_warnings == dense.loose_warnings


def test_clusters_that_no_contact_joins_to_others_are_not_searched_for(monkeypatch):
    """Two small clusters of balls have 6 motions each as rigid bodies, and more as chains."""
    network = bare("fcc", (4, 4, 4))
    inside = [np.isin(end, [0, 1, 2, 40, 41]) for end in (network.i, network.j)]
    alone = keep(network, inside[0] == inside[1])
    iterated = iterate(alone, monkeypatch)
    assert iterated._sparse_relaxation.loose.size == 0
    monkeypatch.setattr(iterative_relaxation, "_MOST_IN_CLUSTER", 1)
    searched = iterate(alone, monkeypatch)
    assert searched._sparse_relaxation.loose.shape[1] > 5
    assert_allclose(iterated._sound_mass.moving_mass, searched._sound_mass.moving_mass, atol=1e-9)
    expected = 1.0 - np.sum(alone.masses[[0, 1, 2, 40, 41]]) / np.sum(alone.masses)
    assert_allclose(iterated._sound_mass.moving_mass, expected * np.eye(3), atol=1e-9)


def test_more_loose_motions_than_are_found_are_refused(monkeypatch):
    """Many are told after the first random motions, few once they are counted."""
    network = bare("fcc", (2, 3, 3), 0.25)
    count = iterate(network, monkeypatch)._sparse_relaxation.loose.shape[1]
    assert count > 2
    for most in (0, count - 1):
        monkeypatch.setattr(iterative_relaxation, "_MOST_LOOSE", most)
        with pytest.raises(InputError, match=f"{most} at most"):
            iterate(network, monkeypatch).sound_velocities([1.0, 0.0, 0.0])


def test_the_number_of_loose_motions_is_estimated_without_bias(monkeypatch):
    """The trace of what takes motions to their remainders is the number; the sum of the squares of
    its entries, which squared lengths of remainders would estimate, is three times as large.
    """
    relaxation = iterate(bare("fcc", (3, 3, 4), 0.25), monkeypatch)._sparse_relaxation
    search = relaxation._search
    count = relaxation.loose.shape[1]
    unit_motions = np.eye(relaxation.lattice.n_branches)
    remainders = search._find_remainders(unit_motions, search._nothing)
    assert_allclose(np.trace(remainders), count, rtol=1e-9)
    sum_of_squares = np.sum(remainders**2)
    assert sum_of_squares > 3.0 * count
    # the variance of m.Rm is twice the sum of squares of the symmetric part of R
    variance = (sum_of_squares + np.sum(remainders * remainders.T)) / iterative_relaxation.PROBES
    assert abs(search.estimate - count) < 2.0 * np.sqrt(variance)


def test_a_search_that_stops_early_tells_the_estimated_number(monkeypatch):
    """After two and two times twelve random motions it has found 26 of 31."""
    network = bare("fcc", (3, 3, 4), 0.25)
    monkeypatch.setattr(iterative_relaxation, "_MOST_LOOSE", 20)
    lattice = ContactLattice._make_of_network(network)
    head, tail = sparse_relaxation.compose_ends(lattice, *lattice._weight_rows())
    relaxation = IterativeRelaxation(lattice, (head - tail).tocsr())
    estimate = relaxation._search.estimate
    assert relaxation.n_free < estimate
    with pytest.raises(InputError, match=f"{estimate:.0f} ways"):
        _ = relaxation.loose


def test_motions_that_cost_too_little_for_iteration_are_refused(monkeypatch):
    """Gears whose lever arms differ beyond what overlaps explain are no gears, but soft."""
    monkeypatch.setattr(long_waves, "_LARGEST_ARM_DIFFERENCE", 0.0)
    with pytest.raises(InputError, match="almost no cost"):
        iterate(gears(1e-7), monkeypatch).elastic_tensor()


def test_gears_that_are_kept_back_are_not_loose(monkeypatch):
    """They cost energy, also where loose motions are searched for only once they are kept back."""
    lattice = iterate(gears(1e-3), monkeypatch)
    turning = lattice._touching_lattice._free_motions
    assert turning.size
    head, tail = sparse_relaxation.compose_ends(lattice, *lattice._weight_rows())
    relaxation = IterativeRelaxation(lattice, (head - tail).tocsr()).keep_back(turning)
    assert relaxation.keeps_back
    assert relaxation.n_free == 0
    assert not relaxation.leaves_loose


def test_iteration_tells_of_a_network_that_gives_way(monkeypatch):
    network = random_network("fcc", (2, 2, 3), prestress=True)
    pressed = replace(
        network,
        normal_force=1.5 * np.mean(network.normal_stiffness) * network.distance,
        tangential_force=None,
    )
    monkeypatch.setattr(long_waves, "MANY_COLUMNS", 0)
    monkeypatch.setattr(long_waves, "MOST_FIRM_RELAXED_BY_FACTORS", 0)
    monkeypatch.setattr(long_waves, "MOST_RELAXED_BY_FACTORS", 0)
    monkeypatch.setattr(gp.ContactNetwork, "require_rest", lambda network: None)
    with pytest.raises(InstabilityError, match="gives way"):
        ContactLattice.from_network(pressed).elastic_tensor()


CASES = {
    "fcc": lambda: random_network("fcc", (2, 2, 3)),
    "prestress": lambda: balance(random_network("fcc", (2, 2, 3), prestress=True)),
    "plane": lambda: random_network("triangular", (4, 3)),
    "plane, all motions": lambda: random_network("triangular", (4, 3), "all"),
    "honeycomb": lambda: random_network("honeycomb", (3, 3)),
    "diamond": lambda: random_network("diamond", (2, 1, 2)),
    "chain": lambda: random_network("chain", (40,)),
    "chain, all motions": lambda: random_network("chain", (20,), "all"),
    "ribbon": lambda: ribbon(random_network("triangular", (4, 4)), 0),
    "a ball without contacts": lambda: hang(0),
    "a ball with one contact": lambda: hang(1),
    "a ball with two contacts, about which it spins": lambda: hang(2),
    "without friction": lambda: bare("fcc", (2, 3, 3), slip=False),
    "without friction, balls that are not held": lambda: bare("fcc", (3, 3, 3), 0.56, slip=False),
    "without friction, a mechanism": lambda: bare("fcc", (2, 3, 3), 0.45, slip=False),
    "five contacts for each ball": lambda: bare("fcc", (2, 3, 3), 0.4),
    "loose, a mechanism": lambda: bare("fcc", (2, 3, 3), 0.25),
    "shears that turn balls against each other": lambda: bare("square", (4, 4)),
    "rows that turn as gears do": lambda: bare("kagome", (2, 2), slip=False),
}


#: these take the same ways as others
LIKE = ("plane, all motions", "honeycomb", "chain, all motions", "a ball with one contact", "plane")


def find_all(network):
    """All that long waves find, or its error."""
    lattice = ContactLattice._make_of_network(network)

    def find(value):
        try:
            return value()
        except GranphonError as error:
            return f"{type(error).__name__}: {error}"

    return {
        "mechanism": lattice.mechanism,
        "warnings": lattice.loose_warnings,
        "part": lattice._sound_mass.moving_mass,
        "tensor": find(lattice.elastic_tensor),
        "sound": find(lambda: lattice.sound_velocities(np.eye(lattice.periods)[0])[0]),
    }


@pytest.mark.claim("sparse-moduli")
@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=[pytest.mark.slow] * (case in LIKE)) for case in CASES]
)
def test_sparse_factors_have_the_digits_of_dense_singular_values(case, monkeypatch):
    network = CASES[case]()
    monkeypatch.setattr(long_waves, "MANY_COLUMNS", 10**9)
    dense = find_all(network)
    monkeypatch.setattr(long_waves, "MANY_COLUMNS", 0)
    monkeypatch.setattr(
        "granphon.dynamics.fronts._MOST_UNCUT_BALLS", 4
    )  # so that few balls are cut too
    sparse = find_all(network)
    for name, wanted in dense.items():
        if isinstance(wanted, np.ndarray):
            assert_allclose(sparse[name], wanted, rtol=0.0, atol=2e-13 * np.max(np.abs(wanted)))
        else:
            assert sparse[name] == wanted


@pytest.mark.parametrize("case", [case for case in CASES if case.endswith("a mechanism")])
def test_mechanisms_are_among_the_cases(case):
    assert str(find_all(CASES[case]())["tensor"]).startswith("MechanismError")


def test_a_crystal_in_a_large_cell_has_its_moduli_and_velocities():
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="fcc", friction=True)).at_force(10.0)
    network = state.network.repeat((4, 4, 4))
    assert ContactLattice.from_network(network)._uses_sparse_matrices
    assert_allclose(
        gp.moduli(network).tensor,
        gp.moduli(state.network).tensor,
        atol=1e-13 * gp.moduli(state).tensor.max(),
    )
    direction = [1.0, 2.0, 0.5]
    wanted = gp.sound_velocities(state.network, direction).velocities
    assert_allclose(gp.sound_velocities(network, direction).velocities, wanted, rtol=1e-13)


def test_the_network_keeps_the_factors_and_progress_is_told(monkeypatch):
    network = random_network("fcc", (4, 4, 4))
    steps = []

    class Told:
        def step(self, label, total=None):
            steps.append([label, total, 0])
            return self

        def advance(self, amount=1.0):
            steps[-1][2] += amount

        def __enter__(self):
            return self

        def __exit__(self, *error):
            return None

    found = gp.moduli(network, progress=Told())
    ((_, total, done),) = steps
    assert total == done > 1
    monkeypatch.setattr(sparse_relaxation, "Fronts", None)
    assert_allclose(gp.moduli(network).tensor, found.tensor, rtol=0.0)
    gp.sound_velocities(network, [1.0, 0.0, 0.0], progress=Told())
    assert len(steps) == 1


def test_an_inner_motion_that_a_static_force_pushes_over_is_an_error(monkeypatch):
    # one ball of many: its contacts push it aside more than they hold it, and sound of the others
    # is not what fails. Walls of which the network knows nothing may hold the balls of a slab
    monkeypatch.setattr(long_waves, "MANY_COLUMNS", 0)
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="fcc", friction=False)).at_force(
        10.0
    )
    network = state.network.repeat((3, 3, 3))
    network = replace(
        keep(network, network.shift[:, 2] == 0),
        pbc=(True, True, False),
        lattice=None,
        shape=None,
        prestress=True,
    )
    pressed = (network.i == 5) | (network.j == 5)
    force = np.where(
        pressed, network.normal_stiffness * network.distance, 1e-3 * network.normal_force
    )
    with pytest.raises(InstabilityError, match=r"q = \(0, 0\)"):
        gp.sound_velocities(replace(network, normal_force=force), [1.0, 0.0])


# -- factors ---------------------------------------------------------------------------------------


def make_graph(n, seed=0):
    """Balls in a box with periods, and the pairs that are near."""
    places = np.random.default_rng(seed).uniform(0.0, 1.0, (n, 3))
    apart = places[:, None] - places
    distance = np.linalg.norm(apart - np.rint(apart), axis=2)
    i, j = np.nonzero(np.triu(distance < 1.3 * n ** (-1 / 3), 1))
    return places, i, j


def test_layers_cut_balls_into_halves_that_do_not_touch():
    places, i, j = make_graph(300)
    layers = dissect(places, i, j)
    assert_allclose(np.sort(np.concatenate([layer.balls for layer in layers])), np.arange(300))
    below: list[set[int]] = []
    touching = [
        *zip(i.tolist(), j.tolist(), strict=True),
        *zip(j.tolist(), i.tolist(), strict=True),
    ]
    for layer in layers:
        inside = set(layer.balls.tolist()).union(*(below[half] for half in layer.halves))
        outside = {other for one, other in touching if one in inside} - inside
        assert set(layer.beyond.tolist()) == outside
        for half in layer.halves:
            assert set(layers[half].beyond.tolist()).isdisjoint(
                *(below[other] for other in layer.halves if other != half)
            )
        below.append(inside)
    assert len(layers) > 10


@pytest.mark.parametrize("count", [127, 128, 256, 300])
def test_a_ball_with_hundreds_of_neighbours_is_in_no_half(count):
    places = np.random.default_rng(0).random((count + 1, 3))
    hub = np.zeros(count, int)
    layers = dissect(places, hub, np.arange(1, count + 1))
    beyond = [layer.beyond.tolist() for layer in layers[:-1]]
    assert all(numbers in ([], [0]) for numbers in beyond)
    laplacian = np.eye(count + 1)
    laplacian[0, 1:] = laplacian[1:, 0] = -0.9 / np.sqrt(count)
    solved = Fronts(csr_array(laplacian), layers, 1).solve(laplacian @ places)
    assert_allclose(solved, places, atol=1e-12)


def test_iteration_leaves_what_nothing_deforms_at_rest():
    lattice = ContactLattice.from_network(bare("fcc", (1, 1, 2)))
    head, tail = sparse_relaxation.compose_ends(lattice, *lattice._weight_rows())
    iterated = IterativeRelaxation(lattice, (head - tail).tocsr())
    deformations = np.zeros((head.shape[0], 2))
    deformations[:, 0] = np.random.default_rng(0).normal(size=head.shape[0])
    motions = iterated.find_motions(deformations)
    assert np.any(motions[:, 0])
    assert not np.any(motions[:, 1])


@pytest.mark.parametrize("rank", [0, 3])
def test_factors_solve_and_leave_motions_that_cost_nothing(rank):
    places, i, j = make_graph(120)
    rng = np.random.default_rng(1)
    n = 120
    count = 2
    rows = np.zeros((4 * len(i), n * count))
    for row in range(len(rows)):
        for end in (i, j):
            ball = end[row % len(i)]
            rows[row, count * ball : count * ball + count] = rng.normal(size=count)
    loose = np.array([7, 100, 101])[:rank]
    rows[:, loose] = 0.0
    rows /= np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    matrix = rows.T @ rows
    fronts = Fronts(csr_array(matrix), dissect(places, i, j), count)
    assert sorted(fronts.aside.tolist()) == loose.tolist()
    wanted = rng.normal(size=(n * count, 2))
    wanted[loose] = 0.0
    assert_allclose(fronts.solve(matrix @ wanted), wanted, atol=1e-11)
    assert_allclose(rows @ fronts.follow(), 0.0, atol=1e-14)
