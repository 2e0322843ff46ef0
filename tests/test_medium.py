"""From a load to the state of the contacts, and back."""

from __future__ import annotations

import dataclasses
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.errors import InputError

SI = ("force", "pressure", "overlap", "normal_stiffness", "shear_stiffness")
REDUCED = (
    "relative_overlap",
    "reduced_force",
    "reduced_spacing",
    "force_fluctuation",
    "contact_fraction",
    "valid",
    "regime",
)
NAMED = ("force", "pressure", "overlap")

diameters = st.floats(-9.0, 2.0).map(lambda x: 10.0**x)
loads = st.floats(-30.0, -3.0).map(lambda x: 10.0**x)


@given(diameter=diameters, load=loads, lattice=st.sampled_from(["triangular", "square", "kagome"]), friction=st.booleans())
def test_round_trips(diameter, load, lattice, friction):
    material = gp.Material(7e10, 0.2, 2500.0)
    medium = gp.AveragedLattice(gp.Packing(material, diameter, lattice=lattice, friction=friction))
    state = medium.at_force(load * 7e10 * diameter**2)
    for name in NAMED:
        again = getattr(medium, f"at_{name}")(getattr(state, name))
        for other in SI:
            assert_allclose(getattr(again, other), getattr(state, other), rtol=3e-15)
        assert_allclose(getattr(again, name), getattr(state, name), rtol=5e-16)


@given(diameter=diameters, load=loads)
def test_state_is_that_of_equations_1_to_4_and_20(diameter, load):
    packing = gp.Packing(gp.Material(7e10, 0.2, 2500.0), diameter)
    force = load * 7e10 * diameter**2
    state = gp.AveragedLattice(packing).at_force(force)
    with mpmath.workdps(40):
        e, s, d, f = mpmath.mpf(7e10), mpmath.mpf(0.2), mpmath.mpf(diameter), mpmath.mpf(force)
        star = e / (2 * (1 - s**2))
        k = mpmath.cbrt(mpmath.mpf(3) / 2 * star**2 * d * f)
        for name, exact in (
            ("force", f),
            ("overlap", mpmath.cbrt(9 * f**2 / (4 * d * star**2))),
            ("normal_stiffness", k),
            ("shear_stiffness", 2 * (1 - s) / (2 - s) * k),
            ("pressure", mpmath.sqrt(3) * f / d),
        ):
            assert abs(getattr(state, name) / exact - 1) < 4e-15


def test_normal_stiffness_is_minus_df_da_of_the_law(packing):
    state = gp.AveragedLattice(packing).at_force(18.446)
    with mpmath.workdps(40):
        c = mpmath.mpf(state.law.coefficient)
        slope = mpmath.diff(lambda x: c * x ** mpmath.mpf("1.5"), mpmath.mpf(state.overlap))
        assert abs(state.normal_stiffness / slope - 1) < 2e-15
    assert_allclose(state.law.force(state.overlap), state.force, rtol=1e-15)
    assert_allclose(state.law.stiffness(state.overlap), state.normal_stiffness, rtol=1e-15)


@given(part=st.floats(-28.0, 2.0))
def test_pressure_with_finite_overlap_over_thirty_decades(packing, part):
    # P a = sqrt(3) f, with a = d - delta
    pressure = 10.0**part * packing.law.coefficient * packing.diameter**0.5 * 0.1
    state = gp.AveragedLattice(packing).at_pressure(pressure, finite_overlap=True)
    with mpmath.workdps(40):
        p, d, c = mpmath.mpf(pressure), mpmath.mpf(packing.diameter), mpmath.mpf(packing.law.coefficient)
        # the root at forty digits, from the state; delta carries the answer
        ratio = mpmath.sqrt(3) * c / p

        def balance(x):
            return ratio * x ** mpmath.mpf("1.5") - (d - x)

        exact = mpmath.findroot(lambda x: balance(x) / d, mpmath.mpf(state.overlap), tol=1e-60, verify=False)
        assert abs(state.overlap / exact - 1) < 2e-15
        force = c * exact ** mpmath.mpf("1.5")
        assert abs(state.force / force - 1) < 2e-15


def test_pressure_with_finite_overlap_is_met_to_rounding(packing):
    medium, unit = gp.AveragedLattice(packing), packing.law.coefficient * packing.diameter**0.5 * 0.1
    pressures = unit * np.logspace(-28.0, 2.0, 601)
    states = medium.at_pressure(pressures, finite_overlap=True)
    with mpmath.workdps(40):
        for pressure, force, overlap in zip(pressures, states.force, states.overlap, strict=True):
            spacing = mpmath.mpf(packing.diameter) - mpmath.mpf(overlap)
            # beyond half a diameter the last bit of the overlap alone is worth more than one of the spacing
            room = 1e-15 * max(1, mpmath.mpf(overlap) / spacing)
            assert abs(mpmath.sqrt(3) * mpmath.mpf(force) / spacing / mpmath.mpf(pressure) - 1) < room
    assert_allclose(states.force, packing.law.force(states.overlap), rtol=3e-15)


def test_pressure_with_finite_overlap_tends_to_that_without(packing):
    medium = gp.AveragedLattice(packing)
    pressures = 1e7 / 8.0 ** np.arange(4)
    here, there = medium.at_pressure(pressures), medium.at_pressure(pressures, finite_overlap=True)
    assert np.all(there.force < here.force)
    assert_allclose(1 - there.force / here.force, there.relative_overlap, rtol=1e-12)


# -- shapes -----------------------------------------------------------------------------------------------------------


def test_scalar_in_float_out(packing):
    medium = gp.AveragedLattice(packing)
    for given_load in (1.0, np.float64(1.0), np.array(1.0), 1):
        state = medium.at_force(given_load)
        for name in (*SI, "relative_overlap", "reduced_force", "reduced_spacing", "force_fluctuation", "contact_fraction"):
            assert type(getattr(state, name)) is float
        assert state.valid is True
        assert state.shape == ()
        assert state.is_single


@pytest.mark.parametrize("shape", [(1,), (3,), (2, 3), (2, 1, 2)])
@pytest.mark.parametrize("name", NAMED)
def test_attributes_have_the_shape_of_the_load(packing, shape, name):
    medium = gp.AveragedLattice(packing)
    values = getattr(medium.at_force(2.0), name) * (1 + np.arange(math.prod(shape))).reshape(shape)
    state = getattr(medium, f"at_{name}")(values)
    for attribute in (*SI, *REDUCED):
        assert getattr(state, attribute).shape == shape
    assert state.shape == shape
    assert not state.is_single
    for index in np.ndindex(shape):
        alone = getattr(medium, f"at_{name}")(values[index])
        for attribute in SI:
            assert getattr(state, attribute)[index] == getattr(alone, attribute)
        part = state[index]
        assert part.is_single
        assert part.force == alone.force
    if name == "pressure":
        assert medium.at_pressure(values, finite_overlap=True).force.shape == shape


def test_lists_are_arrays(packing):
    assert gp.AveragedLattice(packing).at_force([1.0, 2.0]).shape == (2,)


def test_equal_balls(packing, smooth):
    state = gp.AveragedLattice(packing).at_force(18.446)
    assert state.reduced_force == state.reduced_spacing == math.inf
    assert state.force_fluctuation == 0.0
    assert state.contact_fraction == 1.0
    assert state.valid is True
    assert state.regime == "high"
    many = gp.AveragedLattice(packing).at_force([1.0, 2.0])
    assert np.all(np.isinf(many.reduced_force))
    assert np.all(np.isinf(many.reduced_spacing))
    assert np.array_equal(many.force_fluctuation, [0, 0])
    assert np.array_equal(many.contact_fraction, [1, 1])
    assert np.array_equal(many.valid, [True, True])
    assert many.regime.tolist() == ["high", "high"]
    assert gp.AveragedLattice(smooth).at_force(1.0).shear_stiffness == 0.0


def test_state_is_frozen_and_its_arrays_read_only(packing):
    state = gp.AveragedLattice(packing).at_force([1.0, 2.0])
    with pytest.raises(dataclasses.FrozenInstanceError):
        state.force = 1.0
    for name in ("force", "overlap", "normal_stiffness"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(state, name)[0] = 0.0


def test_state_does_not_follow_the_array_it_was_made_from(packing):
    values = np.array([1.0, 2.0])
    state = gp.AveragedLattice(packing).at_force(values)
    values[:] = 5.0
    assert state.force.tolist() == [1.0, 2.0]


def test_medium_protocol(packing):
    assert isinstance(gp.AveragedLattice(packing), gp.Medium)
    assert gp.AveragedLattice(packing).packing is packing


def test_scales_belong_to_one_load(packing):
    state = gp.AveragedLattice(packing).at_force(18.446)
    scales = state.scales
    assert (scales.length, scales.stiffness, scales.mass) == (packing.diameter, state.normal_stiffness, packing.mass)
    assert_allclose(scales.frequency, math.sqrt(state.normal_stiffness / packing.mass) / (2 * math.pi), rtol=1e-15)
    assert_allclose(scales.velocity, 2 * math.pi * scales.frequency * 8e-3, rtol=1e-15)
    with pytest.raises(InputError, match="2 loads"):
        _ = gp.AveragedLattice(packing).at_force([1.0, 2.0]).scales


# -- what cannot be ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize(
    ("value", "text"),
    [
        (math.nan, "finite"),
        (math.inf, "finite"),
        (-math.inf, "finite"),
        ([1e-6, math.nan], "finite"),
        (0.0, "zero"),
        (-0.0, "zero"),
        ([1e-6, 0.0], "zero"),
        (-1e-6, "tensile"),
        ([1e-6, -1e-300], "tensile"),
        ([], "finite"),
        (np.empty((0, 3)), "finite"),
        ("10 N", "number"),
        (None, "number|finite"),
    ],
)
def test_impossible_loads(packing, name, value, text):
    at = getattr(gp.AveragedLattice(packing), f"at_{name}")
    with pytest.raises(InputError, match=text) as caught:
        at(value)
    assert isinstance(caught.value, ValueError)
    assert name in str(caught.value)
    if name == "pressure":
        with pytest.raises(InputError, match=text):
            at(value, finite_overlap=True)


def test_balls_cannot_overlap_by_their_diameter(packing):
    medium = gp.AveragedLattice(packing)
    just = np.nextafter(8e-3, 0.0)
    assert medium.at_overlap(just).overlap == just
    for value in (8e-3, [1e-6, 9e-3]):
        with pytest.raises(InputError, match="diameter"):
            medium.at_overlap(value)
    limit = medium.at_overlap(just)
    with pytest.raises(InputError, match="diameter"):
        medium.at_force(1.001 * limit.force)
    with pytest.raises(InputError, match="diameter"):
        medium.at_pressure(1.001 * limit.pressure)


@pytest.mark.parametrize("name", NAMED)
def test_loads_below_double_precision(packing, name):
    with pytest.raises(InputError):
        getattr(gp.AveragedLattice(packing), f"at_{name}")(5e-324)


@pytest.mark.parametrize(
    "name",
    [
        "force",
        "pressure",
        "overlap",
    ],
)
def test_loads_beyond_double_precision(packing, name):
    with pytest.raises(InputError):
        getattr(gp.AveragedLattice(packing), f"at_{name}")(1e308)


@pytest.mark.parametrize("pressure", [20.0, 4e3, [1.0, 1e5]])
def test_pressure_and_density_of_a_boundary_that_follows_the_balls(packing, pressure):
    state = gp.AveragedLattice(packing).at_pressure(pressure, finite_overlap=True)
    assert_allclose(state.pressure, pressure, rtol=1e-14)
    v, m = gp.sound_velocities(state, finite_overlap=True), gp.moduli(state, finite_overlap=True)
    assert_allclose(m.bulk + m.shear, state.effective_density * v.longitudinal**2, rtol=1e-13)
    again = gp.AveragedLattice(packing).at_force(state.force, finite_overlap=True)
    assert_allclose(again.pressure, pressure, rtol=1e-14)
    assert gp.AveragedLattice(packing).at_force(1.0).effective_density == packing.effective_density


@pytest.mark.parametrize(
    "load", [True, "18.4", 1 + 2j, np.ma.masked_array([1.0, 5.0], mask=[0, 1]), np.datetime64("2020-01-01")]
)
def test_loads_of_the_wrong_kind(packing, load):
    with pytest.raises(InputError, match="real number"):
        gp.AveragedLattice(packing).at_force(load)


def test_a_state_does_not_share_the_callers_memory(packing):
    load = np.array([1.0, 2.0])
    view = load.view()
    view.flags.writeable = False
    state = gp.AveragedLattice(packing).at_force(view)
    load[0] = -5.0
    assert_allclose(state.force, [1.0, 2.0])
