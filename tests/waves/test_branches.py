"""The lowest branches at wave vectors, against all branches of gp.Phonons."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InconsistencyWarning, InputError, PrecisionError
from tests import packings
from tests.dynamics.test_network_lattice import random_network


def read(name, **options):
    """A packing of LAMMPS."""
    files = (packings.FOLDER / f"{name}_{part}.dump" for part in ("atoms", "pairs"))
    return gp.ContactNetwork.from_lammps(*files, packings.MATERIAL, **options)


def press():
    """A packing with friction, whose static tangential forces act."""
    with pytest.warns(InconsistencyWarning, match="torques"):
        network = read("pressed", prestress=True)
    assert np.max(np.abs(network.tangential_force)) > 0.0
    return network


Q = {1: [[0.21]], 2: [[0.21, -0.37], [0.0, 0.0]], 3: [[0.21, -0.37, 0.11]]}


@pytest.mark.claim("lowest-branches")
@pytest.mark.parametrize("name", ["disks", "balls", "prestress", "chain"])
def test_branches_are_those_of_all(name):
    """With static tangential forces too, whose part without a potential is left out in both."""
    networks = {
        "disks": lambda: read("disks"),
        "balls": lambda: read("balls"),
        "prestress": press,
        "chain": lambda: random_network("chain", (9,)),
    }
    network = networks[name]()
    q = Q[int(np.count_nonzero(network.pbc))]
    expected = gp.Phonons(network).frequencies(q)[:, :5]
    found = gp.Waves(network).branches(q, 5)
    assert_allclose(found, expected, rtol=1e-9, atol=1e-7 * expected.max())


@pytest.mark.claim("lowest-branches")
def test_branches_of_a_large_cell_are_those_of_its_parts():
    """The zone of 3 x 3 cells holds nine wave vectors of one cell for each of its own."""
    network = read("disks")
    q = np.array([0.21, -0.37])
    cells = np.stack(np.meshgrid(range(3), range(3)), axis=-1).reshape(-1, 2)
    expected = np.sort(gp.Phonons(network).frequencies((q + cells) / 3.0).ravel())[:8]
    large = gp.Waves(network.repeat((3, 3)))
    assert large.operator.size > 600
    assert_allclose(large.branches(q, 8), expected[None], rtol=1e-10)
    cost = large.estimate("branches", q, 8)
    assert cost.seconds > 0.0
    assert "1 wave vector" in cost.text


def test_what_has_no_branches_is_refused():
    network = read("disks")
    waves = gp.Waves(network)
    for wrong in ([0.1], [[0.1, 0.2, 0.0]], [], "G"):
        with pytest.raises(InputError, match="q"):
            waves.branches(wrong)
    with pytest.raises(InputError, match="count"):
        waves.branches([0.1, 0.2], 10**5000)
    with pytest.raises(InputError, match="fewer"):
        waves.branches([0.1, 0.2], 10_000)
    with pytest.raises(InputError, match="repeats"):
        gp.Waves(network.cut(1, 1).cut(0, 1)).branches([0.1])


def test_a_wave_vector_without_digits_is_refused():
    """As by gp.Phonons: 1e20 does not say where a wave vector is between reciprocal vectors."""
    network = random_network("chain", (9,))
    for find in (gp.Waves(network).branches, gp.Phonons(network).frequencies):
        with pytest.raises(PrecisionError, match="Gamma"):
            find([[1e20]])
