"""Derivatives of a response: a closed form, and central differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from tests.dynamics.test_network_lattice import CASES
from tests.dynamics.test_sensitivities import (
    CASES_HERE,
    FIELDS,
    changes,
    contract,
    difference,
    on_springs,
)

#: receivers: two balls, along the x axis and along another direction
BALLS = [(1, "x"), (2, (0.6, 0.8))]


@pytest.mark.claim("sensitivities-response")
@pytest.mark.parametrize(
    ("case", "options", "receivers"),
    [
        pytest.param("plane", {"damping": 1e-7}, BALLS, marks=pytest.mark.slow),
        ("plane", {"damping": 1e-7, "drag": (3e3, 1e4)}, BALLS),
        pytest.param(
            "tangential forces in a plane",
            {"loss_factor": 0.05, "quantity": "velocity"},
            BALLS,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "growing tangential forces, one ball",
            {"damping": 1e-7},
            [(0, "y")],
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "held",
            {"damping": (1e-7, 3e-7), "quantity": "transmissibility"},
            BALLS,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "plane",
            {"loss_factor": 0.03, "quantity": "acceleration"},
            BALLS,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "plane",
            {"damping": 1e-7, "quantity": "force"},
            [(1, "x"), (2, (0.6, 0.8))],
            marks=pytest.mark.slow,
        ),
        ("fcc", {"damping": 1e-7}, [(1, "z")]),
        ("held", {"loss_factor": 0.02, "quantity": "force"}, [(1, "y"), (4, "x")]),
        ("held", {"quantity": "stiffness"}, [(1, "y"), (4, "x")]),
    ],
)
def test_derivatives_are_those_of_central_differences(case, options, receivers):
    network = on_springs(CASES_HERE[case]())
    moved = options.get("quantity") in ("transmissibility", "stiffness")
    frequencies = [11e3, 26e3]
    source = "plane" if moved else (network.n_balls - 1, "x")

    def respond(changed):
        return gp.Waves(changed).response(frequencies, source, receivers, **options)

    response = respond(network)
    found = response.sensitivities
    for name in FIELDS:
        values = getattr(found, name)
        if values is None or not np.any(getattr(network, FIELDS[name])):
            continue
        change = changes(network, name)
        wanted = difference(lambda one: respond(one).values, network, name, change)
        atol = 1e-8 * np.max(np.abs(response.values))
        assert_allclose(contract(values, change), wanted, rtol=1e-8, atol=atol, err_msg=name)
    assert type(found).from_dict(found.to_dict()) == found


def test_a_ball_on_a_spring():
    """h = 1/(k (1 + i eta) - m omega^2): dh/dk = -(1 + i eta) h^2, dh/dm = omega^2 h^2."""
    ball = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
    chain = gp.Crystal.on("chain", [ball], friction=False).at_force(10.0).network
    network = chain.cut(0, 2, edges=("clamped", "free"))
    frequency = 4e3
    response = gp.Waves(network).response([frequency], (1, "x"), (1, "x"), loss_factor=0.1)
    h = response.values[0, 0]
    found = response.sensitivities
    assert_allclose(found.normal_stiffness[0, 0], [-(1.0 + 0.1j) * h**2], rtol=1e-10)
    omega = 2.0 * np.pi * frequency
    assert_allclose(found.mass[0, 0, 1], omega**2 * h**2, rtol=1e-10)
    assert found.mass[0, 0, 0] == 0.0  # of the ball that is held


def test_a_response_that_was_read_has_none():
    network = CASES["plane"]()
    response = gp.Waves(network).response([1e3], (0, "x"), (1, "x"), loss_factor=0.1)
    again = type(response).from_dict(response.to_dict())
    with pytest.raises(InputError, match="read"):
        _ = again.sensitivities
