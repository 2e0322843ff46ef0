"""Digits of paths with friction, in a plane and in space, in both geometries, from another program.

``friction_digits.json`` was written by granphon as it was before all contacts stood in one list
with compiled loops: geometries, law, tangents and preconditioners were other code. Balls are those
of ``balls(shape, 3, lattice)``, eta = 0.82, mu = 0.1, and forces were balanced to 1e-13 of the mean.
Displacements are without their mean, which nothing holds. Each path begins at the displacements of
``start``, at rest without friction.
"""

from __future__ import annotations

import itertools
import json
import math
import pathlib

import numpy as np
import pytest

from granphon.array.history import LoadingHistory
from granphon.array.options import ReducedLoad
from granphon.array.pressed_array import PressedArray
from granphon.array.pressed_place import PressedGeometry
from granphon.array.stencils import Stencils
from granphon.balls.lattices import FCC, TRIANGULAR
from granphon.contacts.friction import Contacts
from granphon.statics.options import LoadingOptions
from tests.array.test_equilibrium import balls

HERE = pathlib.Path(__file__).parent
PATHS = json.loads((HERE / "friction_digits.json").read_text(encoding="utf-8"))
#: balance as near as rounding allows
EXACT = LoadingOptions(tolerance=1e-13)
LATTICES = {"triangular": TRIANGULAR, "fcc": FCC}


def begin(path, options=EXACT):
    """The loading of the balls of a path, and the state at its start."""
    lattice = LATTICES[path["lattice"]]
    shape = tuple(path["shape"])
    stencils = Stencils(shape, 0.82, lattice=lattice)
    deviations = balls(shape, 3, lattice)
    loading = LoadingHistory(
        deviations,
        stencils,
        friction_coefficient=0.1,
        tolerance=math.inf,
        geometry=PressedGeometry(stencils, deviations, path["ratio"]),
        options=options,
    )
    start = path["start"]
    displacements = np.reshape(start["displacements"], (-1, *shape))
    return loading, loading.stepper.place(displacements, start["overlap"])


def assert_digits(loading, state, digits, tolerance=1e-10):
    """Displacements, rotations and tangential forces of a state, ball by ball and contact by
    contact, have the ``digits``.
    """
    stencils = loading.stencils
    motions = stencils.motions
    fields = state.balls.reshape(stencils.n_balls, motions.count, -1)
    moved = fields[:, motions.translating]
    moved = moved - np.mean(moved, axis=(0, 2), keepdims=True)
    found = {
        "displacements": moved,
        "rotations": fields[:, motions.turning],
        "tangential_forces": state.contacts.shears / state.force,
    }
    for name, values in found.items():
        unit = state.force if name == "tangential_forces" else 1.0
        expected = np.array(digits[name]) / unit
        assert np.max(np.abs(expected)) > 1e-2
        np.testing.assert_allclose(
            np.ravel(values), expected, rtol=0.0, atol=tolerance, err_msg=name
        )


def resume(loading, digits):
    """The state with these ``digits``, in which no slip counts but that from now on."""
    stencils = loading.stencils
    motions = stencils.motions
    cells = math.prod(stencils.shape)
    fields = np.empty((stencils.n_balls, motions.count, cells))
    fields[:, motions.translating] = np.reshape(
        digits["displacements"], (stencils.n_balls, -1, cells)
    )
    fields[:, motions.turning] = np.reshape(digits["rotations"], (stencils.n_balls, -1, cells))
    moved = fields.reshape(-1, *stencils.shape)
    geometry = loading.stepper.geometry
    overlaps, slips = geometry.begin(moved, digits["overlap"])
    shears = np.reshape(digits["tangential_forces"], slips.shape)
    contacts = Contacts(overlaps, slips, shears)
    return PressedArray(digits["overlap"], moved, contacts, loading.stepper.law)


@pytest.mark.parametrize("path", PATHS, ids=lambda path: f"{path['lattice']}-{path['ratio']}")
def test_a_path_has_the_digits_of_another_program(path):
    loading, state = begin(path)
    loads = [ReducedLoad(overlap=digits["overlap"]) for digits in path["states"]]
    slid = 0.0
    for digits, end in zip(path["states"], loading.path(loads, state), strict=True):
        assert_digits(loading, end, digits)
        slid = max(slid, end.sliding_fraction)
    assert slid > 0.25


@pytest.mark.parametrize("path", PATHS, ids=lambda path: f"{path['lattice']}-{path['ratio']}")
def test_each_step_from_the_state_of_another_program_has_its_digits(path):
    loading, _ = begin(path)
    states = path["states"]
    for before, after in itertools.pairwise(states):
        load = ReducedLoad(overlap=after["overlap"])
        end = loading.stepper.step([resume(loading, before)], load)
        assert_digits(loading, end, after)


@pytest.mark.parametrize("path", PATHS, ids=lambda path: f"{path['lattice']}-{path['ratio']}")
def test_steps_have_the_digits_to_a_billionth_by_default(path):
    loading, _ = begin(path, LoadingOptions())
    states = path["states"]
    for before, after in itertools.pairwise(states):
        load = ReducedLoad(overlap=after["overlap"])
        end = loading.stepper.step([resume(loading, before)], load)
        assert_digits(loading, end, after, 1e-9)
