"""Contacts of balls in motion against plain geometry and balances."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.contacts.motion import MetPairs, MovingContacts
from granphon.contacts.motion_laws import Powers
from granphon.contacts.motion_loops import Rules
from granphon.dynamics.damping import Losses

STEEL = gp.Material(211.65e9, 0.276, 7840.0)


def make_contacts(lattice: str, turns: bool) -> tuple[gp.ContactNetwork, MovingContacts]:
    """Return a network of a few balls that are pressed, and its contacts."""
    shape = (3, 3) if lattice == "triangular" else (2, 2, 2)
    packing = gp.Packing(STEEL, 8e-3, lattice=lattice)
    network = gp.AveragedLattice(packing).at_force(10.0).network.repeat(shape)
    none = np.zeros(0, np.intp)
    pairs = MetPairs(none, none, np.zeros((0, 3), np.intp), np.zeros(0), 0.0)
    overlap = 1.5 * network.normal_force / network.normal_stiffness
    law = Powers(1.5, network.normal_force / overlap**1.5, overlap)
    punch = network.normal_stiffness
    rules = Rules(turns, 0.3)
    return network, MovingContacts(network, pairs, law, punch, Losses.of(network), rules)


@pytest.mark.parametrize("turns", [False, True])
@pytest.mark.parametrize("lattice", ["triangular", "fcc"])
def test_contacts_measure_distances_and_act_on_both_balls(lattice, turns):
    network, contacts = make_contacts(lattice, turns)
    rng = np.random.default_rng(1)
    moment = contacts.make_moment()
    overlap = 1.5 * np.mean(network.normal_force / network.normal_stiffness)
    moment.motions[:] = 0.9 * overlap * rng.uniform(-1.0, 1.0, moment.motions.shape)
    is_turn = contacts.axes >= 3
    moment.motions[:, is_turn] /= network.arm_i[0]
    displacement = np.zeros((network.n_balls, 3))
    displacement[:, contacts.axes[~is_turn]] = moment.motions[:, ~is_turn]
    moved = displacement[network.j] - displacement[network.i]
    contacts.begin(moment)
    if turns:
        distance = np.linalg.norm(network.vector + moved, axis=1)
        elongation = distance - np.linalg.norm(network.vector, axis=1)
    else:
        elongation = np.sum(network.normal * moved, axis=1)
    assert_allclose(moment.e, elongation, rtol=0.0, atol=1e-9 * overlap)
    # the law of Hertz, of which some contacts have opened
    overlaps = np.maximum(overlap - elongation, 0.0)
    force = network.normal_force * (overlaps / overlap) ** 1.5
    assert np.any(force == 0.0)
    scale = np.mean(network.normal_force)
    change = force - network.normal_force
    assert_allclose(moment.pull[0], change, rtol=0.0, atol=1e-8 * scale)
    shears = contacts.shears(moment)
    assert np.all(shears <= 0.3 * force + 1e-8 * scale)
    assert np.any(shears > 0.29 * force)
    total = np.sum(contacts.on_balls[:, ~is_turn], axis=0)
    assert_allclose(total, 0.0, atol=1e-11 * scale * network.n_contacts)
