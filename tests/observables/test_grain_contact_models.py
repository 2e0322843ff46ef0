"""Moduli of crystals against the effective moduli of random packings by Walton and Digby, typed out
and of another program.

K. Walton (J. Mech. Phys. Solids 35, 213, 1987) and P. J. Digby (J. Appl. Mech. 48, 803, 1981) let
every ball follow the mean strain, and average over the directions of contacts. In sc, bcc and fcc
balls do so by symmetry, and the averages of Voigt over all directions of the crystal are the same
numbers.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp

QUARTZ = gp.Material(95.6e9, 0.08, 2650.0)
BALL = gp.Ball(QUARTZ, 2e-3)
PRESSURE = 5e6
#: contacts of a ball, and the part of the volume that balls fill
PACKINGS = {
    "sc": (6, np.pi / 6.0),
    "bcc": (8, np.pi * 3.0**0.5 / 8.0),
    "fcc": (12, np.pi / 18.0**0.5),
}
each_packing = pytest.mark.parametrize("name", PACKINGS)


def bulk_of_quartz():
    """Bulk and shear modulus of the balls, GPa."""
    return QUARTZ.young_modulus / (
        3.0 - 6.0 * QUARTZ.poisson_ratio
    ) / 1e9, QUARTZ.shear_modulus / 1e9


@each_packing
def test_rough_balls_have_waltons_moduli(name):
    contacts, filled = PACKINGS[name]
    found = gp.moduli(gp.Crystal.on(name, [BALL]).at_pressure(PRESSURE)).voigt
    shear = QUARTZ.shear_modulus
    nu = QUARTZ.poisson_ratio
    base = (contacts * filled * shear / (1.0 - nu)) ** 2 * PRESSURE / np.pi**2
    bulk = (base / 18.0) ** (1.0 / 3.0)
    assert_allclose(found.bulk, bulk, rtol=1e-12)
    assert_allclose(found.shear, 0.6 * bulk * (5.0 - 4.0 * nu) / (2.0 - nu), rtol=1e-12)


@each_packing
def test_rough_balls_agree_with_another_program(name):
    models = pytest.importorskip("rockphypy").GM
    contacts, filled = PACKINGS[name]
    found = gp.moduli(gp.Crystal.on(name, [BALL]).at_pressure(PRESSURE)).voigt
    for model in (models.Walton, models.hertzmindlin):
        other = model(*bulk_of_quartz(), 1.0 - filled, contacts, PRESSURE / 1e6, 1.0)  # MPa
        assert_allclose([found.bulk, found.shear], np.array(other) * 1e9, rtol=1e-12)


@each_packing
@pytest.mark.parametrize("bonded", [0.01, 0.05])
def test_bonded_balls_agree_with_another_program(name, bonded):
    """Digby's stiffnesses, whose normal and shear part have no radius in common, given to the
    contacts of a network.
    """
    models = pytest.importorskip("rockphypy").GM
    contacts, filled = PACKINGS[name]
    bulk, shear = models.Digby(*bulk_of_quartz(), 1.0 - filled, contacts, PRESSURE / 1e6, bonded)
    nu = QUARTZ.poisson_ratio
    radius = BALL.radius
    cubic = [
        1.0,
        0.0,
        1.5 * bonded**2,
        -1.5 * np.pi * (1.0 - nu) * PRESSURE / (contacts * filled * QUARTZ.shear_modulus),
    ]
    roots = np.roots(cubic)
    spread = np.hypot(float(roots[np.abs(roots.imag) < 1e-12].real[0]), bonded)
    network = gp.Crystal.on(name, [BALL]).at_pressure(PRESSURE).network
    ones = np.ones(network.n_contacts)
    network = replace(
        network,
        normal_stiffness=2.0 * QUARTZ.shear_modulus * spread * radius / (1.0 - nu) * ones,
        shear_stiffness=4.0 * QUARTZ.shear_modulus * bonded * radius / (2.0 - nu) * ones,
    )
    found = gp.moduli(network).voigt
    assert_allclose([found.bulk, found.shear], np.ravel([bulk, shear]) * 1e9, rtol=1e-9)


def test_smooth_balls_of_fcc_have_three_fifths_of_the_bulk_modulus():
    found = gp.moduli(gp.Crystal.on("fcc", [BALL], friction=False).at_pressure(PRESSURE)).voigt
    assert_allclose(found.shear, 0.6 * found.bulk, rtol=1e-12)
