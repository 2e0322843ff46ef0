"""Arrays pressed with friction against LAMMPS, contact by contact: other code, true positions,
damped motion in time.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import granphon as gp
from granphon.array.history import LoadingHistory
from granphon.array.options import ReducedLoad
from granphon.array.pressed_place import PressedGeometry
from granphon.array.rest import bring_to_rest
from granphon.array.stencils import Stencils
from tests.array.pressed_twin import PressedTwin, apart

SHAPE = (8, 8)
ETA = 0.82


def differences(mu, spacings, steps, *width, exact=False):
    """Rms differences of contact forces at the ``spacings`` a*, each reached from the one before in
    so many steps.

    The ``width`` is W/d of LAMMPS' balls; the history has it only in its ``exact`` geometry.
    """
    x = gp.Uniform(1.0).sample(SHAPE, 0)
    x -= np.mean(x)
    stencils = Stencils(SHAPE, ETA)
    start, geometry = (
        bring_to_rest(x, ReducedLoad(overlap=spacings[0] - 0.5)),
        PressedGeometry(stencils, x, *width) if exact else None,
    )
    history = LoadingHistory(x, stencils, mu, math.inf, start, geometry=geometry)
    ways = [np.linspace(a, b, steps + 1)[1:] - 0.5 for a, b in itertools.pairwise(spacings)]
    try:
        twin = PressedTwin(x, stencils, mu, history.begin(), *width)
    except (ImportError, OSError) as error:
        pytest.skip(f"LAMMPS cannot be loaded: {error}")
    found = []
    slid = 0.0
    for place, state in enumerate(
        history.path(ReducedLoad(overlap=float(y)) for y in np.concatenate(ways)), 1
    ):
        normal, tangential, left = twin.press(state.overlap)
        assert left < 1e-6  # most go below 1e-8; positions have ten digits of W
        slid = max(slid, state.sliding_fraction)
        if place % steps == 0:
            found.append(
                apart((normal, tangential), (state.contacts.forces, state.contacts.shears[0]))
            )
    twin.close()
    assert np.sqrt(np.mean(tangential**2)) > 0.01 * np.mean(normal)
    assert (slid > 0.02) == (mu < math.inf)
    return np.array(found)


@pytest.mark.claim("friction-lammps")
def test_forces_are_those_of_lammps():
    """Up and down: in twice as many steps the difference is half as large, or less."""
    coarse, fine = (differences(0.1, (0.7, 1.0, 0.7), steps) for steps in (2, 5))
    assert np.all(fine < 0.4 * coarse)
    assert np.all(fine < 5e-4)


@pytest.mark.exhaustive
@pytest.mark.claim("friction-lammps")
@pytest.mark.parametrize(
    ("mu", "spacings"),
    [(0.1, (0.5, 0.8, 0.6)), (0.3, (0.5, 0.8, 0.6)), (math.inf, (0.55, 0.85, 0.65))],
)
def test_forces_from_a_low_load_are_those_of_lammps(mu, spacings):
    """Without Coulomb's limit, contacts that bear next to nothing hold balls that are loose at a* =
    1/2 as chance has it.
    """
    found = np.array([differences(mu, spacings, steps) for steps in (3, 6, 12)])
    assert np.all(found[:-1] > 1.4 * found[1:])
    assert np.all(found[0] > 3.0 * found[-1])
    assert np.all(found[-1] < 1e-3)


@pytest.mark.exhaustive
@pytest.mark.claim("friction-directions")
def test_true_directions_hardly_change_the_forces():
    """Of balls of 8 mm with W = 2.04 um: the difference is no larger than at a small width, that of
    the steps.
    """
    assert np.all(differences(0.2, (0.5, 0.75, 1.0), 10, 2.55e-4) < 8e-4)


@pytest.mark.claim("friction-lammps")
@pytest.mark.exhaustive
def test_forces_in_the_exact_geometry_are_those_of_lammps():
    """At a width at which directions matter; that the force of a contact goes with its own radii is
    of order 0.1 W/d.
    """
    width = 3e-3
    path = (0.1, (0.7, 0.9, 0.75), 8)
    exact, lattice = (differences(*path, width, exact=one) for one in (True, False))
    assert np.all(exact < 3e-4)
    assert np.all(lattice > 3.0 * exact)


@pytest.mark.claim("friction-lammps")
@pytest.mark.exhaustive
@pytest.mark.parametrize("size", [16, 32])
def test_the_mean_force_is_that_of_lammps_from_a_start_of_its_own(size):
    """Loose balls lie elsewhere, and single forces differ by percents; the mean force tells wrong
    directions even so.
    """
    shape = (size, size)
    width = 1e-2
    mu = 0.2
    x = gp.Uniform(1.0).sample(shape, 0)
    x -= np.mean(x)
    stencils = Stencils(shape, ETA)
    try:
        twin = PressedTwin(x, stencils, mu, 0.0, width)
    except (ImportError, OSError) as error:
        pytest.skip(f"LAMMPS cannot be loaded: {error}")
    loads = [*np.linspace(0.0, 0.5, 7)[1:].tolist(), *np.linspace(0.5, 0.1, 7)[1:].tolist()]
    found = [twin.press(load)[0].mean() for load in loads]
    twin.close()
    errors = []
    for geometry in (PressedGeometry(stencils, x, width), None):
        history = LoadingHistory(x, stencils, mu, math.inf, geometry=geometry)
        forces = [
            state.force for state in history.path(ReducedLoad(overlap=load) for load in loads)
        ]
        errors.append(np.max(np.abs(np.array(forces) / found - 1.0)))
    assert errors[0] < 1e-3 < 2e-3 < errors[1]
