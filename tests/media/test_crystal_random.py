"""Crystals drawn at random, of any lattice, kinds, laws and loads: their balance and waves against
sums over contacts.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import Phase, example, given, reject, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import GranphonError, InputError, InstabilityError
from tests.networks.twin import dynamical_matrix

#: lattices, and the numbers of kinds on their sites
LATTICES = {
    "chain": (1, 2, 3), "square": (1,), "triangular": (1,), "honeycomb": (1, 2), "sc": (1,), "bcc": (1,), "fcc": (1,),
    "hcp": (1, 2), "diamond": (1, 2), "NaCl": (1, 2), "CsCl": (1, 2), "zincblende": (1, 2),
}  # fmt: skip
AXES = {1: [0], 2: [0, 1, 5], 3: [0, 1, 2, 3, 4, 5]}


@st.composite
def crystals(draw):
    """A crystal, with defects in some, and what it is made of."""
    lattice = draw(st.sampled_from(sorted(LATTICES)))
    modulus = st.floats(7.0, 12.0).map(lambda x: 10.0**x)
    ratio = st.floats(0.05, 0.49)
    balls = [
        gp.Ball(
            gp.Material(draw(modulus), draw(ratio), draw(st.floats(500.0, 2e4))), 8e-3, name=name
        )
        for name in "ABC"[: draw(st.sampled_from(LATTICES[lattice]))]
    ]
    laws = st.one_of(
        st.just(gp.Hertz()),
        st.builds(gp.PowerLaw, st.floats(1.0, 3.0), st.floats(5.0, 9.0).map(lambda x: 10.0**x)),
        st.builds(gp.DMT, st.floats(1e-3, 1.0)),
    )
    law = draw(laws)
    space = lattice not in ("chain", "square", "triangular", "honeycomb")
    torsions = st.sampled_from([0.0, 0.05, "mindlin"] if space else [0.0])
    if draw(st.booleans()):
        law = {
            pair: draw(laws)
            for pair in itertools.combinations_with_replacement([ball.name for ball in balls], 2)
        }
    crystal = gp.Crystal.on(lattice, balls, law=law, torsion=draw(torsions))
    if draw(st.booleans()) and crystal.n_balls == 1:
        crystal = crystal.repeat((2,) * crystal.periods)
    return crystal


@settings(max_examples=4, deadline=None, phases=(Phase.explicit, Phase.generate))
@given(
    crystals(),
    st.floats(-3.0, 3.0),
    st.lists(st.floats(-0.2, 0.2), min_size=6, max_size=6),
    st.booleans(),
    st.booleans(),
)
def test_any_crystal_is_in_balance_and_its_waves_are_those_of_its_contacts(
    crystal, size, shear, uneven, follows
):
    p = crystal.periods
    d = crystal.dimension
    least = min(ball.material.young_modulus for ball in crystal.kinds)
    pressure = 1e-9 * least * 8e-3 ** (3 - p) * 10.0**size
    wanted = pressure * np.eye(p)
    if uneven:  # a stress that is not a pressure
        spare = iter(shear)
        for a, b in itertools.combinations_with_replacement(range(p), 2):
            wanted[a, b] += pressure * (one := next(spare))
            wanted[b, a] += pressure * one * (a != b)
    try:
        state = crystal.at_stress(-wanted, finite_overlap=follows)
    except (InputError, InstabilityError):  # such as a stress that contacts do not bear
        return
    # what acts on each ball, and the stress, from the forces along the normals
    table = crystal.contacts
    force = state.normal_force[:, None] * state.normal
    mean = np.mean(np.abs(state.normal_force))
    pull = np.zeros((crystal.n_balls, d))
    np.add.at(pull, table.j, force)
    np.add.at(pull, table.i, -force)
    # of attraction and repulsion apart
    scale = max(mean, np.mean(state.normal_stiffness * np.abs(state.overlap)))
    assert np.max(np.abs(pull)) <= 1e-11 * scale
    deformed = np.eye(p) + state.strain * follows
    virial = force[:, :p].T @ (table.vector[:, :p] + 0.0) @ deformed.T
    size = np.max(np.abs(table.vector)) * scale * len(force)
    volume = crystal.measure * np.linalg.det(deformed)
    assert_allclose(
        0.5 * (virial + virial.T) / volume, wanted, rtol=0.0, atol=2e-11 * size / volume
    )
    # its waves, from the matrix of all contacts one by one
    network = state.network
    fractions = np.full(p, 0.21) + 0.1 * np.arange(p)
    kept = AXES[d] if network.ball_motions.rotate else AXES[d][:d]
    matrix = dynamical_matrix(network, 2.0 * np.pi * np.linalg.pinv(network.cell[:p]) @ fractions)
    rows = (6 * np.arange(network.n_balls)[:, None] + kept).ravel()
    squares = np.linalg.eigvalsh(matrix[np.ix_(rows, rows)])
    try:
        found = (2.0 * np.pi * gp.Phonons(state).frequencies([fractions])[0]) ** 2
    except InstabilityError:  # a static force that turns contacts away
        assert squares[0] < 1e-12 * squares[-1]
        return
    assert_allclose(found, squares, rtol=0.0, atol=1e-11 * squares[-1])


def ask(question, *given):
    """What a question is answered, or the error that it ends with."""
    try:
        return question(*given)
    except GranphonError as error:
        return error


@st.composite
def cells_and_repeats(draw):
    """A crystal of few balls in a cell, and a number of its cells along each vector."""
    lattice = draw(
        st.sampled_from(
            ["chain", "square", "triangular", "honeycomb", "sc", "fcc", "diamond", "NaCl", "CsCl"]
        )
    )
    kinds = [
        gp.Ball(gp.Material(193e9, 0.30, 8000.0), 8e-3),
        gp.Ball(gp.Material(73.5e9, 0.33, 2700.0), 6e-3),
    ]
    balls = (
        kinds
        if lattice in ("chain", "NaCl", "CsCl", "diamond") and draw(st.booleans())
        else kinds[:1]
    )
    motions = {"chain": ["longitudinal", "in_plane", "all"]}.get(lattice, ["all"])
    motions = (
        ["in_plane", "out_of_plane", "all"]
        if lattice in ("square", "triangular", "honeycomb")
        else motions
    )
    options = {
        "law": draw(st.sampled_from([gp.Hertz(), gp.DMT(0.1)])),
        "friction": draw(st.booleans()),
        "motions": draw(st.sampled_from(motions)),
        "torsion": draw(st.sampled_from([0.0, 0.05])),
        "bending": draw(st.sampled_from([0.0, 0.03])),
    }
    try:
        crystal = gp.Crystal.on(lattice, balls, **options)
    except InputError:  # these motions take no torsion or no bending
        reject()
    p = crystal.periods
    repeats = draw(
        st.sampled_from(
            [
                one
                for one in itertools.product((1, 2, 3), repeat=p)
                if 1 < np.prod(one) <= (3 if p < 3 else 2)
            ]
        )
    )
    return crystal, repeats


CHAIN = gp.Crystal.on(
    "chain", [gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)], motions="in_plane"
)
LAYER = gp.Crystal.on(
    "square", [gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)], motions="all", torsion=0.05
)


@settings(max_examples=5, deadline=None)
@example((CHAIN, (2,)), -4.0, [0.0] * 6, True)
@example((CHAIN, (2,)), -4.0, [0.0] * 6, False)
@example((LAYER, (1, 2)), -3.6, [0.0] * 6, True)
@given(
    cells_and_repeats(),
    st.floats(-7.0, -2.5),
    st.lists(st.floats(-0.3, 0.3), min_size=6, max_size=6),
    st.booleans(),
)
def test_a_crystal_and_its_repeats_are_the_same(cells, size, shares, follows):
    crystal, repeats = cells
    p = crystal.periods
    e = 10.0**size
    strain = e * (np.diag(shares[:p]) - np.eye(p))
    for (a, b), shear in zip(itertools.combinations(range(p), 2), shares[3:], strict=False):
        strain[a, b] = strain[b, a] = e * shear
    states = [
        one.at_strain(strain, finite_overlap=follows) for one in (crystal, crystal.repeat(repeats))
    ]
    for direction in np.eye(p)[:1], np.full((1, p), p**-0.5):
        small, large = (ask(gp.sound_velocities, state, direction[0]) for state in states)
        assert type(small) is type(large)
        if isinstance(small, GranphonError):
            assert str(small) == str(large)
            continue
        assert_allclose(
            large.velocities, small.velocities, rtol=1e-8, atol=1e-9 * small.velocities.max()
        )
        assert len(small.warnings) == len(large.warnings)
    small, large = (ask(lambda state: gp.moduli(state).tensor, state) for state in states)
    assert type(small) is type(large)
    if isinstance(small, GranphonError):
        assert str(small) == str(large)
    else:
        assert_allclose(large, small, rtol=0.0, atol=1e-9 * np.abs(small).max())
    cells_of = np.array(list(itertools.product(*map(range, repeats))))
    for q in np.zeros(p), np.full(p, 0.21) + 0.1 * np.arange(p):
        large = ask(gp.Phonons(states[1]).frequencies, [q])
        small = ask(gp.Phonons(states[0]).frequencies, (q + cells_of) / repeats)
        assert type(small) is type(large)
        if not isinstance(small, GranphonError):
            expected = np.sort(small, axis=None) ** 2
            assert_allclose(np.sort(large[0]) ** 2, expected, rtol=0.0, atol=1e-12 * expected[-1])
    assert (
        ask(lambda: gp.Phonons(states[1]).lattice.free_branches)
        == len(cells_of) * gp.Phonons(states[0]).lattice.free_branches
    )


@pytest.mark.parametrize(
    "direction", [(0, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0.3, -0.5, 0.81), (0.9, 0.2, -0.1)]
)
def test_sound_of_pressed_fcc_in_any_direction(direction):
    """The energy of the eight contacts that carry, of which the rotation of the balls takes the
    least.
    """
    ball = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
    state = gp.Crystal.on("fcc", [ball]).at_strain([0.0, 0.0, -1e-4, 0.0, 0.0, 0.0])
    closed = state.normal_force > 0.0
    along = np.array(direction) / np.linalg.norm(direction)
    energy = np.zeros((6, 6))  # of u and phi, per ball
    for n, k, kappa in zip(
        state.normal[closed],
        state.normal_stiffness[closed],
        state.shear_stiffness[closed],
        strict=True,
    ):
        reach = 8e-3 * (along @ n)
        cross = np.array([[0, n[2], -n[1]], [-n[2], 0, n[0]], [n[1], -n[0], 0]])  # phi x n
        slip = np.hstack([reach * (np.eye(3) - np.outer(n, n)), -8e-3 * cross])
        press = np.concatenate([reach * n, np.zeros(3)])
        energy += k * np.outer(press, press) + kappa * slip.T @ slip
    acoustic = energy[:3, :3] - energy[:3, 3:] @ np.linalg.solve(energy[3:, 3:], energy[3:, :3])
    velocities = gp.sound_velocities(state, direction).velocities
    assert_allclose(velocities**2, np.linalg.eigvalsh(acoustic) / ball.mass, rtol=1e-12)


def test_three_balls_in_the_cell_of_a_chain_make_three_bands_and_two_gaps():
    steel = gp.Ball(gp.Material(193e9, 0.30, 8000.0), 19.05e-3, mass=28.84e-3)
    aluminium = gp.Ball(gp.Material(73.5e9, 0.33, 2700.0), 19.05e-3, mass=9.75e-3)
    state = gp.Crystal.on("chain", [steel, aluminium, steel]).at_force(20.0)
    table = state.crystal.contacts
    m = np.array([28.84e-3, 9.75e-3, 28.84e-3])
    edges = []
    for sign in (1.0, -1.0):  # q = 0 and the edge of the zone
        ring = np.zeros((3, 3))
        for i, j, shift, k in zip(
            table.i, table.j, table.shift[:, 0], state.normal_stiffness, strict=True
        ):
            ring[[i, j], [i, j]] += k
            ring[[i, j], [j, i]] -= k * (sign if shift else 1.0)
        edges.append(
            np.sqrt(np.maximum(np.linalg.eigvalsh(ring / np.sqrt(np.outer(m, m))), 0.0))
            / (2.0 * np.pi)
        )
    low = np.min(edges, axis=0)
    high = np.max(edges, axis=0)
    assert_allclose(gp.Phonons(state).gaps(), np.stack([high[:-1], low[1:]], axis=1), rtol=1e-12)
