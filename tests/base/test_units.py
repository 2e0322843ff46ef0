"""Units: those that are read, decimal prefixes of hertz in files, and of numbers as people read
them.
"""

from __future__ import annotations

import math
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import granphon as gp
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import (
    ADHESION,
    DENSITY,
    FREQUENCY,
    LENGTH,
    MASS,
    MODULUS,
    PUSH,
    TIME,
    VELOCITY,
    find_factor,
    find_written_unit,
    is_si,
    read_with_error,
    split_error,
)
from granphon.base.scales import (
    HertzPrefix,
    WidthUnits,
    prefixed,
    write_error,
    write_in,
    write_quantity,
    write_uncertain,
)


@given(st.floats(1e-24, 9.99e26))
def test_a_frequency_lies_between_one_and_a_thousand_of_its_unit(frequency):
    unit = HertzPrefix.for_top(frequency)
    assert unit.hertz <= frequency
    # 1e-21 is not a thousand times 1e-24 to the last bit
    assert frequency < 1000.0 * unit.hertz * (1.0 + 1e-15)
    assert HertzPrefix.named(unit.name) == unit


@pytest.mark.parametrize(
    ("frequency", "name", "hertz"),
    [
        (999.999999999, "Hz", 1.0),
        (1e3, "kHz", 1e3),
        (6.5e6, "MHz", 1e6),
        (2e-6, "uHz", 1e-6),
        (1e-30, "yHz", 1e-24),
        (0.0, "yHz", 1e-24),
        (1e30, "YHz", 1e24),
    ],
)
def test_units_of_hertz(frequency, name, hertz):
    assert HertzPrefix.for_top(frequency) == HertzPrefix(name, hertz)


def test_a_unit_of_hertz_that_is_none():
    with pytest.raises(InputError, match=r"'khz' .*kHz"):
        HertzPrefix.named("khz")


@pytest.mark.parametrize(
    ("value", "size", "name"),
    [
        (2.04e-6, 1e-6, "um"),
        (-2.04e-6, 1e-6, "um"),
        (8e-3, 1e-3, "mm"),
        (1.0, 1.0, "m"),
        (2e11, 1e9, "Gm"),
        (3e-14, 1e-15, "fm"),
        (math.nextafter(1e-3, 0.0), 1e-3, "mm"),
        (0.999e-3, 1e-6, "um"),
        (0.0, 1.0, "m"),
        (1e-300, 1.0, "m"),
        (1e27, 1.0, "m"),
        (math.inf, 1.0, "m"),
    ],
)
def test_multiples_for_reading(value, size, name):
    assert prefixed(value, "m") == (size, name)


@pytest.mark.parametrize(
    ("unit", "text", "both"),
    [
        ("1", "0.00025", "0.000250 +/- 0.000010"),
        ("1/m", "0.00025 1/m", "0.000250 +/- 0.000010 1/m"),
        ("m^2", "0.00025 m^2", "0.000250 +/- 0.000010 m^2"),
        ("kg/m^3", "0.00025 kg/m^3", "0.000250 +/- 0.000010 kg/m^3"),
        ("N s/m", "250 uN s/m", "250 +/- 10 uN s/m"),
        ("m/s^2", "250 um/s^2", "250 +/- 10 um/s^2"),
    ],
)
def test_units_take_a_prefix_where_their_first_one_can(unit, text, both):
    assert write_quantity(2.5e-4, unit) == text
    assert write_uncertain(2.5e-4, 1e-5, unit) == both


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1111.795, 0.3935, "1.11180 +/- 0.00039 km/s"),
        (1.0604e-6, 1.543e-9, "1.0604 +/- 0.0015 um/s"),
        (988.2e6, 747e3, "988.20 +/- 0.75 Mm/s"),
        (100.0, 250.0, "100 +/- 250 m/s"),
        (0.0, 1e-9, "0.0 +/- 1.0 nm/s"),
        (-5e-7, 3e-9, "-500.0 +/- 3.0 nm/s"),
        (2.04e-6, 1.04e-15, "2.04 um/s +/- 1 fm/s"),
        (2.0, 0.0, "2 m/s +/- 0 m/s"),
    ],
)
def test_a_value_and_its_error_have_the_same_unit_and_place(value, error, text):
    assert write_uncertain(value, error, "m/s") == text


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("211,65 GPa", "211.65 GPa"),
        ("-8,5 mm", "-8.5 mm"),
        ("1,234,567 Pa", ""),
        ("2.5,3 mm", ""),
        ("2, mm", ""),
    ],
)
def test_a_decimal_comma_is_told(text, meant):
    with pytest.raises(InputError, match="one unit") as error:
        (MODULUS if text.endswith("Pa") else LENGTH).read(text)
    assert ("point" in str(error.value)) == bool(meant)
    assert meant in str(error.value)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.0, 2.8e6, "0 s +/- 2.8e+06 s"),
        (-1e-9, 3.0, "0.0 +/- 3.0 s"),
        (0.0, 3e-5, "0 +/- 30 us"),
        (1.2e-6, 4e-8, "1.200 +/- 0.040 us"),
        (5400.0, 36.0, "5400 +/- 36 s"),
    ],
)
def test_times_have_no_multiples_of_the_second(value, error, text):
    assert write_uncertain(value, error, "s") == text


@pytest.mark.parametrize("width", [1e-150, 1e-20, 2.04e-6, 1.0, 1e100])
def test_units_of_the_width_are_those_of_hertz_at_an_overlap_of_it(width):
    units = WidthUnits(3.7e9, width)
    law = gp.HertzLaw(3.7e9)
    assert (0.4 * units.energy, units.force) == pytest.approx(
        (law.energy(width), law.force(width)), rel=4e-15
    )
    expected = law.stiffness(width), law.stiffness_slope(width)
    assert (1.5 * units.stiffness, 0.75 * units.stiffness_slope) == pytest.approx(
        expected, rel=4e-15
    )
    force = np.array([0.3, 2.0]) * units.force
    overlap = np.array([-0.25, 2.0]) * width
    np.testing.assert_allclose(units.reduced_force(force), [0.3, 2.0], rtol=1e-15)
    np.testing.assert_allclose(units.reduced_overlap(overlap), [-0.25, 2.0], rtol=1e-15)
    np.testing.assert_allclose(units.reduced_spacing(overlap), [0.25, 2.5], rtol=1e-15)


@pytest.mark.parametrize(
    ("coefficient", "width"), [(3.7e9, 1e-210), (3.7e9, 1e-218), (2e-150, 1e150), (2e150, 1e-150)]
)
def test_units_of_the_width_where_powers_of_it_leave_the_floating_range(coefficient, width):
    units = WidthUnits(coefficient, width)
    root = Decimal(width).sqrt()
    for n, name in ((5, "energy"), (3, "force"), (1, "stiffness"), (-1, "stiffness_slope")):
        exact = float(Decimal(coefficient) * root**n)
        assert getattr(units, name) == pytest.approx(exact, rel=2e-15, abs=5e-324)
    for force in (1e-100, 1e100):
        exact = float(Decimal(force) / Decimal(coefficient) / root**3)
        with np.errstate(over="ignore"):
            assert units.reduced_force(np.array([force])) == pytest.approx(exact, rel=2e-15)


def test_a_width_whose_units_are_above_the_floating_range():
    units = WidthUnits(3.7e9, 1e200)
    assert units.stiffness == pytest.approx(3.7e109, rel=1e-15)
    for name, power in (("energy", 5), ("force", 3)):
        with pytest.raises(
            InputError,
            match=rf"1e\+200 m .*\({power}/2\)",
        ):
            getattr(units, name)


@pytest.fixture(scope="module")
def registry():
    import pint

    return pint.UnitRegistry(non_int_type=Decimal)


@pytest.mark.parametrize(
    ("kind", "units"),
    [
        (
            LENGTH,
            "m cm mm um µm μm nm pm km inch inches foot feet ft yard yd mile angstrom Å metre"
            " meters micrometre",
        ),
        (
            MODULUS,
            "Pa kPa MPa GPa bar mbar atm psi N/mm^2 kN/m**2 kgf/cm² dyn/cm^2 J/m³ J·m^-3"
            " kg/m/s^2 lbf/inch^2",
        ),
        (DENSITY, "kg/m^3 g/cm^3 g/cm3 g·cm**-3 t/m^3 lb/ft^3 mg/mm³ tonne/metre^3"),
        (FREQUENCY, "Hz kHz MHz 1/s 1/ms s^-1 1/hour hertz kilohertz"),
        (TIME, "s ms us minute minutes h hour hours nanoseconds"),
        (VELOCITY, "m/s mm/s km/h km/hour mile_per_hour mph knot knots fps foot_per_second inch/s"),
        (PUSH, "N mN kN kgf kilogram_force lbf pound_force dyn kg*m/s^2 J/m Pa*m^2 newtons"),
        (MASS, "kg g mg lb pounds t tonnes N*s^2/m"),
        (ADHESION, "J/m^2 mJ/m^2 N/m dyn/cm kg/s^2"),
    ],
)
def test_units_are_those_of_pint(registry, kind, units):
    for unit in units.split():
        written = (
            unit.replace("·", "*").replace("²", "^2").replace("³", "^3").replace("cm3", "cm^3")
        )
        factor = registry.Quantity(Decimal(1), written).to(kind.unit).magnitude
        assert kind.read(f"3 {unit}") == pytest.approx(float(3 * factor), rel=2e-16), unit


def test_few_digits_are_written_without_an_exponent():
    assert [write_quantity(value, "m/s", 2) for value in (0.9, 0.0123, 123.0, 0.996)] == [
        "900 mm/s",
        "12 mm/s",
        "120 m/s",
        "1 m/s",
    ]


def test_a_number_in_a_chosen_unit_has_neither_an_exponent_nor_the_unit_one():
    assert write_in(1.234, "m", "mm", 2) == "1200 mm"
    assert write_in(9.9996, "m", "mm", 2) == "10 m"
    assert write_in(0.5, "1", "1") == "0.5"
    assert write_error(0.1, 1.0, "1") == "0.1"
    assert write_error(123.0, 2.0, "m") == "120 m"
    assert write_error(9999.6, 2.0, "m") == "10 km"


def test_a_width_beyond_double_precision_is_refused_with_the_way_out():
    for units, name, mend in (
        (WidthUnits(1e308, 1e308), "energy", "smaller"),
        (WidthUnits(1e300, 1e-300), "stiffness_slope", "larger"),
    ):
        with pytest.raises(InputError, match=f"Give a {mend} width"):
            getattr(units, name)


def test_an_error_that_rounds_up_keeps_two_digits():
    assert write_uncertain(200.0, 0.0996, "m/s") == "200.00 +/- 0.10 m/s"
    assert write_uncertain(200.0, 9.96, "m/s") == "200 +/- 10 m/s"
    assert write_uncertain(200.0, 150.0, "m/s") == "200 +/- 150 m/s"


def test_an_error_that_rounds_up_to_a_thousand_has_the_next_multiple():
    assert write_uncertain(1.0, 999.4, "m/s") == "1 +/- 999 m/s"
    assert write_uncertain(1.0, 999.6, "m/s") == "0.0 +/- 1.0 km/s"
    assert write_uncertain(1.0, 1000.0, "m/s") == "0.0 +/- 1.0 km/s"


def test_a_nautical_mile_is_no_thousand_millionth_of_a_mile():
    assert LENGTH.read("8 nmi") == LENGTH.read("8 nautical_miles") == 8.0 * 1852.0
    assert VELOCITY.read("3600 knots") == VELOCITY.read("3600 nmi/h") == 1852.0


def test_units_divided_by_several_in_brackets_are_measured():
    for text in (
        "m/(N s m)",
        "m/( N s m )",
        "m/(N*s*m)",
        "m / (N * s * m)",
        "meter / (newton * second * meter)",
    ):
        assert find_factor(text, "1/(N s)") == 1.0
        assert is_si(text, "1/(N s)")
    assert find_factor("s^4/(kg m**2)", "s**4/kg/m^2") == 1.0


def test_a_standard_error_is_zero_or_above_and_finite():
    assert read_with_error("8 mm", LENGTH) == (8e-3, 0.0)
    assert read_with_error("8 mm +- 0 um", LENGTH) == (8e-3, 0.0)
    assert read_with_error("-2 N +- 1 N", PUSH) == (-2.0, 1.0)
    value, error = read_with_error("-2 N +- 5 %", PUSH)
    assert (value, error) == (-2.0, pytest.approx(0.1))
    for text in (
        "2 N +- -1 N",
        "2 N +- -5 %",
        "2 N +- 1e999 %",
        "2 N +- 1e999 N",
        "1e308 N +- 1e5 %",
    ):
        with pytest.raises(Refused, match=r"negative|not finite|not a finite|too large"):
            read_with_error(text, PUSH)


@pytest.mark.parametrize(
    ("unit", "target", "factor"),
    [
        ("um", "m", 1e-6),
        ("kg m^2", "g*cm^2", 1e7),
        ("km/(N s)", "m/N/s", 1e3),
        ("m/(N/s)", "m", None),
        ("", "1", 1.0),
        ("m", "", None),
        ("m", "N", None),
        ("!um", "m", None),
        ("5 um", "m", None),
        ("mm +- 1 %", "m", None),
    ],
)
def test_a_factor_is_that_of_a_whole_text(unit, target, factor):
    assert find_factor(unit, target) == (factor if factor is None else pytest.approx(factor))


def test_the_unit_of_a_text_is_a_unit():
    assert find_written_unit("8 mm") == "mm"
    assert find_written_unit("4 kN/m ") == "kN/m"
    for text in ("8", "8 mm +- 1 %", "8 mm!", 8.0, None):
        assert find_written_unit(text) == ""


def test_a_quantity_with_an_error_has_a_number_of_few_digits():
    assert split_error("0012 +- 1") == (12, "1")
    for text in ("9" * 5000 + " +- 1", "1 +- " + "9" * 5000):
        assert split_error(text) is None


def test_a_quantity_is_written_from_a_float_of_numpy():
    assert LENGTH.read(LENGTH.write(np.float64(0.1))) == 0.1
