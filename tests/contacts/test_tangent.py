"""The tangent of a list of contacts, against finite differences of the forces and torques of a twin
that knows nothing of it.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from granphon.balls.motions import ALL, IN_PLANE, LONGITUDINAL
from granphon.contacts.contact_list import ContactList
from granphon.contacts.placed import ContactForces, find_overlaps
from granphon.contacts.tangent import find_tangent, unit_strains
from granphon.dynamics.deformation_rows import contact_rows

MOTIONS = {1: LONGITUDINAL, 2: IN_PLANE, 3: ALL}


def random_list(dimension, seed, static=False, tangential=False, spins=False, n_balls=6):
    """Balls at random places, each of which touches the next three."""
    generator = np.random.default_rng(seed)
    places = np.zeros((n_balls, 3))
    places[:, :dimension] = generator.uniform(-1.0, 1.0, (n_balls, dimension))
    places[:, 0] += np.arange(n_balls)  # none is on another
    i = np.repeat(np.arange(n_balls), 3)
    j = (i + np.tile([1, 2, 3], n_balls)) % n_balls
    vector = places[j] - places[i]
    vector[j < i, 0] += n_balls  # the next period
    distance = np.linalg.norm(vector, axis=1)
    normal = vector / distance[:, None]
    count = len(i)
    arm = distance * generator.uniform(0.3, 0.7, count)
    across = np.zeros((count, 3))
    if tangential:
        across[:, :dimension] = generator.normal(size=(count, dimension))
        across -= np.sum(across * normal, axis=1)[:, None] * normal
    stiffness = generator.uniform(0.5, 1.5, (4, count))
    turning = dimension > 1
    origin = normal + 0.2 * generator.normal(size=(count, 3)) * (np.arange(3) < dimension)
    return ContactList(
        n_balls=n_balls,
        motions=MOTIONS[dimension],
        i=i,
        j=j,
        vector=vector,
        normal=normal,
        arm_i=arm,
        arm_j=distance - arm,
        normal_stiffness=stiffness[0],
        shear_stiffness=turning * stiffness[1],
        torsion_stiffness=turning * stiffness[2],
        bending_stiffness=turning * stiffness[3],
        normal_force=static * generator.uniform(0.0, 0.5, count),
        tangential_force=across if tangential else np.zeros((0, 3)),
        origin=origin / np.linalg.norm(origin, axis=1)[:, None] if spins else np.zeros((0, 3)),
        measure=float(n_balls),
        dimension=dimension,
    )


def turn(vector, by):
    """The vector, turned by a rotation vector (Rodrigues)."""
    angle = np.linalg.norm(by)
    if not angle:
        return vector
    axis = by / angle
    return (
        np.cos(angle) * vector
        + np.sin(angle) * np.cross(axis, vector)
        + (1.0 - np.cos(angle)) * (axis @ vector) * axis
    )


def act(contacts, motions, strain):
    """Forces and torques on balls, and the force on the strain, contact by contact from places."""
    u = np.zeros((contacts.n_balls, 3))
    phi = np.zeros((contacts.n_balls, 3))
    split = len(contacts.motions.translations)
    u[:, list(contacts.motions.translations)] = motions[:, :split]
    phi[:, list(contacts.motions.rotations)] = motions[:, split:]
    force = np.zeros_like(u)
    torque = np.zeros_like(u)
    stress = np.zeros((3, 3))
    for c, (i, j) in enumerate(zip(contacts.i, contacts.j, strict=True)):
        w = contacts.vector[c]
        moved = u[j] - u[i] + strain @ w
        n = contacts.normal[c]
        r = np.linalg.norm(w + moved)
        # forces keep their size along the normal, which turns; of springs the first order counts
        new = (
            (w + moved) / r
            if np.any(contacts.normal_force) or len(contacts.tangential_force)
            else n
        )
        push = contacts.normal_force[c] * new - contacts.normal_stiffness[c] * (n @ moved) * n
        arms = np.array([contacts.arm_i[c], contacts.arm_j[c]])
        slip = moved - (n @ moved) * n - np.cross(arms[0] * phi[i] + arms[1] * phi[j], n)
        shear = -contacts.shear_stiffness[c] * slip
        push = push + shear
        torques = [-arm * np.cross(n, shear) for arm in arms]
        if len(contacts.tangential_force):
            T = contacts.tangential_force[c]
            axis = np.cross(n, new)
            sine = np.linalg.norm(axis)
            way = axis * (np.arctan2(sine, n @ new) / sine) if sine else axis
            carried = turn(T, way)
            if len(contacts.origin):
                spin = 0.5 * (phi[i] + phi[j]) @ contacts.origin[c] - (
                    way @ contacts.origin[c] / (1.0 + n @ contacts.origin[c])
                )
                carried = turn(carried, spin * new)
            push = push + carried
            lever = 0.5 * (r - np.linalg.norm(w))
            torques = [
                one - (arm + lever) * np.cross(new, carried)
                for one, arm in zip(torques, arms, strict=True)
            ]
        rolling = phi[j] - phi[i]
        twist = (rolling @ n) * n
        back = contacts.torsion_stiffness[c] * twist
        back = back + contacts.bending_stiffness[c] * (rolling - twist)
        force[i] -= push
        force[j] += push
        torque[i] += torques[0] + back
        torque[j] += torques[1] - back
        stress += np.outer(push, w)
    by_ball = np.concatenate(
        [
            force[:, list(contacts.motions.translations)],
            torque[:, list(contacts.motions.rotations)],
        ],
        axis=1,
    )
    return by_ball, stress


def differentiate(contacts):
    """The whole tangent (n m + s, n m + s), by central differences."""
    units = unit_strains(contacts.dimension)
    shape = contacts.n_balls, contacts.motions.count
    size = shape[0] * shape[1]
    step = 1e-5

    def resist(x):
        strain = np.einsum("s,sab->ab", x[size:], units)
        forces, stress = act(contacts, x[:size].reshape(shape), strain)
        return -np.concatenate([forces.ravel(), np.einsum("sab,ab->s", units, stress)])

    ways = step * np.eye(size + len(units))
    return np.stack([(resist(way) - resist(-way)) / (2.0 * step) for way in ways], axis=1)


def assemble(contacts):
    """The whole tangent of the list."""
    tangent = find_tangent(contacts, unit_strains(contacts.dimension))
    size = contacts.n_balls * contacts.motions.count
    ahead = tangent.blocks.ahead.reshape(size, -1)
    back = tangent.blocks.back.reshape(size, -1)
    return np.block([[tangent.matrix.toarray(), ahead], [back.T, tangent.blocks.corner]])


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize(
    "forces",
    [
        {},
        {"static": True},
        {"tangential": True},
        {"static": True, "tangential": True, "spins": True},
    ],
)
def test_the_tangent_is_the_slope_of_forces_and_torques(dimension, forces):
    contacts = random_list(dimension, 3, **forces)
    found = assemble(contacts)
    expected = differentiate(contacts)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * np.max(np.abs(expected)))
    symmetric = not ("tangential" in forces and dimension > 1)
    assert (np.max(np.abs(found - found.T)) < 1e-12) == symmetric


@given(st.sampled_from([1, 2, 3]), st.integers(0, 2**16), st.integers(4, 9))
def test_without_static_forces_the_tangent_is_symmetric_and_not_negative(dimension, seed, n_balls):
    found = assemble(random_list(dimension, seed, n_balls=n_balls))
    np.testing.assert_allclose(found, found.T, rtol=0.0, atol=1e-13)
    values = np.linalg.eigvalsh(found)
    assert values[0] > -1e-13 * values[-1]
    # nothing resists a shift of the whole
    assert np.sum(values < 1e-12 * values[-1]) >= dimension


def test_balls_that_touch_themselves_and_each_other_twice_add_up():
    """A ball whose neighbour on either side is the same ball, and one that is its own image."""
    one = np.array([1.0, 0.0, 0.0])
    arms = np.full(3, 0.5)
    none = np.zeros(3)
    contacts = ContactList(
        n_balls=2,
        motions=LONGITUDINAL,
        i=np.array([0, 1, 0]),
        j=np.array([1, 0, 0]),
        vector=np.array([one, one, 2.0 * one]),
        normal=np.array([one] * 3),
        arm_i=arms,
        arm_j=arms,
        normal_stiffness=np.array([1.0, 2.0, 4.0]),
        shear_stiffness=none,
        torsion_stiffness=none,
        bending_stiffness=none,
        normal_force=none,
        measure=2.0,
        dimension=1,
    )
    expected = [[3.0, -3.0, 1.0], [-3.0, 3.0, -1.0], [1.0, -1.0, 19.0]]
    np.testing.assert_allclose(assemble(contacts), expected, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_springs_at_places_exert_what_the_tangent_says(dimension):
    """The rows of deformations, ball by ball, and the tangent write the same springs twice."""
    contacts = random_list(dimension, 3)
    motions = contacts.motions
    moved = np.random.default_rng(1).normal(size=(contacts.n_balls, motions.count))
    rows = contact_rows(
        contacts.normal[:, :dimension],
        contacts.arm_i,
        contacts.arm_j,
        motions,
        elongation=contacts.normal_stiffness,
        slip=contacts.shear_stiffness,
        twist=contacts.torsion_stiffness,
        roll=contacts.bending_stiffness,
    )
    vector = contacts.vector[:, :dimension]
    exerted = ContactForces(contacts.i, contacts.j, vector, contacts.n_balls, motions)
    shift = np.zeros((contacts.n_balls, 3))
    shift[:, list(motions.translations)] = moved[:, motions.translating]
    apart = (shift[contacts.j] - shift[contacts.i])[:, :dimension]
    turns = np.ascontiguousarray(moved[:, motions.turning])
    for row in rows:
        exerted.resist(row, row.stiffness, np.ascontiguousarray(apart), turns)
    forces, virial = exerted.collect()
    tangent = find_tangent(contacts, unit_strains(dimension))
    expected = -(tangent.matrix @ moved.ravel()).reshape(moved.shape)
    np.testing.assert_allclose(forces[:, :dimension], expected[:, motions.translating], atol=1e-13)
    np.testing.assert_allclose(exerted.torque, expected[:, motions.turning], atol=1e-13)
    assert exerted.energy == pytest.approx(-0.5 * np.sum(moved * expected), rel=1e-13)
    on_strains = -np.einsum("nms,nm->s", tangent.blocks.back, moved)
    by_strain = np.einsum("sab,ab->s", unit_strains(dimension), virial)
    np.testing.assert_allclose(by_strain, on_strains, atol=1e-12)


def test_balls_at_one_place_have_no_direction():
    overlap, normal = find_overlaps(np.zeros((2, 3)), np.array([1.0, 2.0]), 0.25)
    np.testing.assert_array_equal(overlap, [1.25, 2.25])
    np.testing.assert_array_equal(normal, np.zeros((2, 3)))


def test_whole_numbers_have_directions():
    _, normal = find_overlaps(np.array([[3, 4]]), 5.0, 0.0)
    np.testing.assert_array_equal(normal, [[0.6, 0.8]])


@given(st.integers(0, 10_000))
def test_overlaps_at_places_are_those_of_the_distances(seed):
    generator = np.random.default_rng(seed)
    vector = generator.normal(size=(7, 3))
    length = generator.uniform(0.5, 2.0, 7)
    overlap, normal = find_overlaps(vector, length, 0.25)
    distance = np.linalg.norm(vector, axis=1)
    np.testing.assert_allclose(overlap, 0.25 + length - distance, atol=1e-15)
    np.testing.assert_allclose(normal * distance[:, None], vector, atol=1e-15)
    fixed = generator.normal(size=(7, 3))
    overlap, same = find_overlaps(vector, length, 0.25, fixed)
    assert same is fixed
    np.testing.assert_allclose(overlap, 0.25 + length - np.sum(vector * fixed, 1), atol=2e-15)
