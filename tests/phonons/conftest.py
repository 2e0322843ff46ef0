"""Builders of states and phonons for the tests of this folder, and phonons of rough and smooth
balls in the plane.
"""

from __future__ import annotations

import numpy as np
import pytest

import granphon as gp

DIAMETER = 8e-3
STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ETA = 2.0 * (1.0 - 0.276) / (2.0 - 0.276)


def at_force(force=18.446, friction=True, lattice="triangular"):
    packing = gp.Packing(STEEL, DIAMETER, lattice=lattice, friction=friction)
    return gp.AveragedLattice(packing).at_force(force)


def at_overlap(
    relative=0.01,
    friction=True,
    lattice="triangular",
    finite_overlap=None,
    diameter=DIAMETER,
    **packing,
):
    balls = gp.Packing(STEEL, diameter, lattice=lattice, friction=friction, **packing)
    return gp.AveragedLattice(balls).at_overlap(relative * diameter, finite_overlap=finite_overlap)


def phonons_of(lattice="fcc", motions=None, **options):
    return gp.Phonons(at_overlap(lattice=lattice, motions=motions, **options))


RESISTED = {"torsion": 0.07, "bending": 0.03}
PLANES = ("square", "triangular", "honeycomb", "kagome")
SPACE = ("sc", "bcc", "fcc", "hcp", "diamond")
CASES = [
    ("chain", "longitudinal", {}),
    ("chain", "in_plane", {}),
    ("chain", "out_of_plane", {"bending": 0.03}),
    ("chain", "all", {}),
    ("chain", "all", RESISTED),
    *((plane, motions, {}) for plane in PLANES for motions in ("out_of_plane", "all")),
    ("triangular", "all", RESISTED),
    *((lattice, "all", {}) for lattice in SPACE),
    ("hcp", "all", RESISTED),
    ("fcc", "all", {"friction": False}),
    ("fcc", "all", {"torsion": 0.1, "friction": False}),
    ("fcc", "all", {"finite_overlap": True, **RESISTED}),
]
every_case = pytest.mark.parametrize(("lattice", "motions", "options"), CASES, ids=str)


def random_points(ph, count=5, seed=3):
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (count, ph.lattice.periods))


def padded(q):
    return np.pad(q, ((0, 0), (0, 3 - q.shape[1])))


@pytest.fixture(scope="module")
def rough():
    return gp.Phonons(at_force())


@pytest.fixture(scope="module")
def smooth():
    return gp.Phonons(at_force(friction=False))


@pytest.fixture(params=["rough", "smooth"])
def phonons(request):
    return request.getfixturevalue(request.param)
