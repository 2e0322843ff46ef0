"""The lowest modes of packings that LAMMPS has pressed with friction, against those of LAMMPS' own
forces.
"""

from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from tests import packings
from tests.networks.test_lammps import measure, respond
from tests.networks.test_network_friction import press

ROLLING = 3e5
TWISTING = 0.02
#: words of rolling and twisting, with damping and a limit; and what the reader is told of them
ROLLS = f"rolling sds {ROLLING} {{}} {{}}", {"rolling_stiffness": ROLLING}
TWISTS = (
    f"{ROLLS[0]} twisting sds {TWISTING} 0 {{}}",
    ROLLS[1] | {"twisting_stiffness": TWISTING},
)
SIZES = np.linspace(0.6e-3, 1.4e-3, 9)
#: dimension, number of balls, filled part before and after, seed; what else is asked of LAMMPS; law
#: of slip; rolling. None has a ball that is loose: LAMMPS' own contact with such a ball, which is
#: about to open, is not linear in the least displacements of which forces can be told apart
PACKINGS = {
    "few that roll": ((2, 12, 0.80, 0.82, 1), {}, "mindlin/force", ROLLS),
    "plane": ((2, 20, 0.80, 0.82, 1), {}, "mindlin/force", None),
    "tilted": ((2, 24, 0.80, 0.82, 2), {"tilt": 0.3}, "mindlin/force", None),
    "rolling": ((2, 24, 0.80, 0.82, 7), {}, "mindlin/force", ROLLS),
    "mindlin in space": ((3, 30, 0.56, 0.59, 5), {}, "mindlin", None),
    "polydisperse": ((3, 40, 0.56, 0.59, 1), {"radii": SIZES}, "mindlin/force", None),
    "rolling in space": ((3, 30, 0.56, 0.58, 6), {}, "mindlin/force", TWISTS),
}


@pytest.mark.claim("network-lammps-modes")
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name == "few that roll" else pytest.mark.slow)
        for name in PACKINGS
    ],
)
def test_lowest_modes_are_those_of_lammps(name, tmp_path):
    """At rest under static forces, of rolling too: the whole matrix and its modes; and those of its
    symmetric part, to second order of the static forces and of the overlap.
    """
    about, options, law, rolling = PACKINGS[name]
    words, told = rolling or ("", {})
    lmp = packings.start_or_skip()
    press(lmp, *about, law=law, rolling=words.format(0.05, 0.3, 0.3), **options)
    files = tmp_path / "atoms.dump", tmp_path / "pairs.dump"
    packings.write_dumps(lmp, *files, rolling=bool(rolling))
    told = {"prestress": True, "tangential_law": law} | told
    network = gp.ContactNetwork.from_lammps(*files, packings.MATERIAL, **told)
    assert network.left_out == 0
    assert network.imbalance[2] < 1e-6
    size = np.mean(np.linalg.norm(network.tangential_force, axis=1))
    assert size > 0.05 * network.mean_force
    assert (network.contact_torque is not None) == bool(rolling)
    still = replace(network, contact_torque=None)
    torque, without = (np.max(np.abs(one.unbalanced[1])) for one in (network, still))
    length = np.mean(network.radii)
    assert torque < 1e-9 * network.mean_force * length
    assert (without > 1e-3 * network.mean_force * length) == bool(rolling)
    # LAMMPS turns a tangential force with its contact if the change is above 1e-10 of its limit:
    # the coefficients of friction are as small as no contact slides
    response = measure(lmp, network, f"{law} NULL 0 1 {words.format(0, 1, 1)}")
    lmp.close()
    waves = gp.Waves(network)
    own = respond(network)
    error = np.max(np.abs(response - own)) / np.max(own)
    assert error < 1e-5
    # in a plane the static torque of rolling turns with no contact
    if rolling and network.dimension == 3:
        assert np.max(np.abs(response - respond(still))) > 5e-5 * np.max(own)
    modes = waves.modes(10)
    squares = np.sort(np.linalg.eigvals(response).real)[modes.zero_modes :]
    lowest = np.sqrt(squares[:10]) / (2.0 * np.pi)
    whole = waves.whole_modes(10).frequencies
    assert np.max(np.abs(whole.imag)) == 0.0
    np.testing.assert_allclose(whole.real, lowest, rtol=1e-5)
    touch = network.radii[network.i] + network.radii[network.j]
    overlap = np.max(1.0 - network.distance / touch)
    # second order over the distance of a mode to its neighbours, of which the nearest are 0.01 off
    np.testing.assert_allclose(modes.frequencies, lowest, rtol=10.0 * overlap**2)
