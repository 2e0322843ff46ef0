"""Phonons of rough and of smooth balls in the triangular lattice, for tests of bands and densities of states."""

from __future__ import annotations

import pytest

import granphon as gp

DIAMETER = 8e-3
STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ETA = 2.0 * (1.0 - 0.276) / (2.0 - 0.276)


def at_force(force=18.446, friction=True, lattice="triangular"):
    packing = gp.Packing(STEEL, DIAMETER, lattice=lattice, friction=friction)
    return gp.AveragedLattice(packing).at_force(force)


@pytest.fixture(scope="module")
def rough():
    return gp.Phonons(at_force())


@pytest.fixture(scope="module")
def smooth():
    return gp.Phonons(at_force(friction=False))


@pytest.fixture(params=["rough", "smooth"])
def phonons(request):
    return request.getfixturevalue(request.param)
