"""Arrays of real numbers at every public border, and what NumPy would make of others."""

from __future__ import annotations

import warnings
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import granphon as gp
from granphon.arguments import real_array
from granphon.contact import harmonic_diameter, mindlin_reduction
from granphon.cost import estimate
from granphon.errors import InputError

MASKED = np.ma.array([1.0, 2.0], mask=[False, True])


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (2, 2.0),
        ([1, 2.5], [1.0, 2.5]),
        (np.float32(0.1), float(np.float32(0.1))),
        (np.arange(6, dtype=np.uint8).reshape(2, 3), [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]),
        ([10**30, Fraction(1, 4), Decimal("0.1")], [1e30, 0.25, 0.1]),
        (np.longdouble("0.5"), 0.5),
        ([np.inf, -np.inf], [np.inf, -np.inf]),
        (np.ma.array([1.0, 2.0], mask=False), [1.0, 2.0]),
        ([], []),
    ],
)
def test_real_numbers_become_floats(values, expected):
    found = real_array("x", values)
    assert_array_equal(found, expected)
    assert (type(found), found.dtype) == (np.ndarray, np.float64)


def test_an_array_of_floats_is_not_copied():
    values = np.array([1.0, np.nan])
    assert real_array("x", values) is values


REFUSED = [
    (1j, "x is complex: 1j. It must be a real number"),
    (np.array([1.0, 2.0 + 0j]), "x is complex"),
    ([1.0, 0.5j], "x is complex"),
    (np.array([1j, 2], object), "x is complex"),
    (MASKED, r"x has masked entries, which are no real numbers: masked_array\(.*Leave them out"),
    (np.ma.masked, "x has masked entries"),
    ([1.0, np.ma.masked], "x has masked entries"),
    ([[1.0, 2.0], MASKED], "x has masked entries"),
    ("1", "x is '1'. It must be a real number or an array of them"),
    (["1", "2"], "x is"),
    ([None], "x is"),
    (None, "x is None"),
    (True, "x is True"),
    (np.array([True]), "x is"),
    (np.array([1.0, True], object), "x is"),
    (np.array(["2020"], "M8[Y]"), "x is"),
    ([[1.0], [1.0, 2.0]], "x is"),
    (10**400, "x is a whole number of about 401 digits, which is too large"),
    ([1, 10**5000], "x is a list with a number that is too large"),
    (Fraction(10**400, 3), "x is too large"),
]


@pytest.mark.parametrize(("values", "words"), REFUSED)
def test_what_is_no_real_number_is_refused_and_nothing_else_said(values, words):
    with pytest.raises(InputError, match=f"(?s)^{words}") as error:
        real_array("x", values)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 300


@pytest.mark.skipif(np.finfo(np.longdouble).maxexp <= 1024, reason="no wider float here")
def test_wider_floats_that_are_too_large_are_refused():
    with pytest.raises(InputError, match="too large for double precision"):
        real_array("x", np.longdouble("1e4000"))
    assert real_array("x", np.longdouble("inf")) == np.inf


# -- the borders ----------------------------------------------------------------------------------------------------

BALLS = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
STATE = gp.AveragedLattice(BALLS).at_force(18.0)
LATTICE = gp.ContactLattice.of("triangular", 0.84)
PHONONS = gp.Phonons(STATE)
SAMPLE = gp.DirectSimulation(BALLS)
FORCE, SPEED = [2.0, 18.0], [450.0, 700.0]

#: what is called, and a pair of numbers that it takes
BORDERS = {
    "lattice.frequencies": (lambda pair: LATTICE.frequencies([pair]), (0.1, 0.2)),
    "lattice.modes": (lambda pair: LATTICE.modes([pair]), (0.1, 0.2)),
    "lattice.modes, direction": (lambda pair: LATTICE.modes([[1.0, 0.0]], pair), (0.1, 0.2)),
    "lattice.wavevectors": (lambda pair: LATTICE.wavevectors([pair]), (0.1, 0.2)),
    "lattice.compatibility": (lambda pair: LATTICE.compatibility([pair]), (0.1, 0.2)),
    "lattice.dynamical_matrix": (lambda pair: LATTICE.dynamical_matrix([pair]), (0.1, 0.2)),
    "lattice.sound_velocities": (LATTICE.sound_velocities, (0.1, 0.2)),
    "lattice.elastic_tensor": (lambda pair: LATTICE.elastic_tensor(pair), (0.0, 0.001)),
    "phonons.frequencies": (lambda pair: PHONONS.frequencies([pair]), (0.1, 0.2)),
    "phonons.modes": (lambda pair: PHONONS.modes([pair]), (0.1, 0.2)),
    "phonons.bands": (lambda pair: PHONONS.bands([[0.0, 0.0], pair], 3), (0.1, 0.2)),
    "sound_velocities": (lambda pair: gp.sound_velocities(STATE, pair), (0.1, 0.2)),
    "pulse_velocities": (lambda pair: gp.pulse_velocities(STATE, pair), (500.0, 800.0)),
    "pulse_velocities, direction": (lambda pair: gp.pulse_velocities(STATE, 1e3, pair), (0.1, 0.2)),
    "at_force": (gp.AveragedLattice(BALLS).at_force, FORCE),
    "diameters": (lambda pair: gp.DirectSimulation(BALLS, diameters=[pair, pair]), (7.9e-3, 8.1e-3)),
    "cost": (lambda pair: estimate(SAMPLE, "force", pair), FORCE),
    "measured": (gp.Measured, (7.9e-3, 8.1e-3)),
    "fit, force": (lambda pair: gp.fit_width(BALLS, pair, SPEED), FORCE),
    "fit, velocity": (lambda pair: gp.fit_width(BALLS, FORCE, pair), SPEED),
    "fit, sigma": (lambda pair: gp.fit_width(BALLS, FORCE, SPEED, pair), (2.0, 3.0)),
    "fit, frequency": (lambda pair: gp.fit_width(BALLS, FORCE, SPEED, 5.0, pair), (10.0, 20.0)),
    "fit.velocity_at": (lambda pair: FIT.velocity_at(pair), FORCE),
    "harmonic_diameter": (lambda pair: harmonic_diameter(pair, 1.0), (1.0, 2.0)),
    "mindlin_reduction": (lambda pair: mindlin_reduction(pair, 10.0, 0.5), (1.0, 2.0)),
    "law.overlap": (BALLS.law.overlap, FORCE),
    "law.force": (BALLS.law.force, (1e-6, 2e-6)),
    "cell": (lambda pair: gp.Lattice("own", (pair, (0.0, 1.0))), (1.0, 0.0)),
}
FIT = gp.fit_width(BALLS, FORCE, SPEED)


@pytest.mark.parametrize(("call", "pair"), BORDERS.values(), ids=BORDERS)
def test_every_border_refuses_what_it_cannot_take(call, pair):
    call(pair)
    call(np.array(pair))
    for wrong in (
        np.array(pair) * (1.0 + 0.1j),
        np.ma.array(pair, mask=[False, True]),
        [pair[0], np.ma.masked],
        [10**400, pair[1]],
        [str(number) for number in pair],
    ):
        with warnings.catch_warnings(record=True) as said, pytest.raises(InputError, match=r"complex|masked|large| is "):
            call(wrong)
        assert not said


@pytest.mark.parametrize("shape", [(3,), (2, 3), (4, 1)])
def test_wave_vectors_are_pairs(shape):
    for find in (LATTICE.frequencies, LATTICE.modes, LATTICE.dynamical_matrix):
        with pytest.raises(InputError, match=r"wave vectors of shape .* Give \(n_q, 2\)"):
            find(np.ones(shape))
    with pytest.raises(InputError, match="fractions of shape"):
        LATTICE.wavevectors(np.ones(4))
