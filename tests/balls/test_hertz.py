"""The contact law (equations 1-4), Mindlin's reduction, the free vibrations of a ball, and the
limits of validity.
"""

from __future__ import annotations

import math
import re

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from scipy.special import spherical_jn

import granphon as gp
from granphon.balls import hertz
from granphon.balls.hertz import HertzLaw
from granphon.balls.loads import Load
from granphon.base.errors import InputError
from granphon.dynamics.local_field import local_field

lengths = st.floats(-9.0, 2.0).map(lambda x: 10.0**x)
loads = st.floats(-30.0, -5.0).map(lambda x: 10.0**x)
ratios = st.floats(-0.999, 0.5)


def exact_contact(material, first, second, force):
    """delta, k, kappa and k of equations (1)-(4), term by term, in the present precision of
    mpmath.
    """
    e = mpmath.mpf(material.young_modulus)
    s = mpmath.mpf(material.poisson_ratio)
    star = e / (2 * (1 - s**2))
    d = 1 / ((1 / mpmath.mpf(first) + 1 / mpmath.mpf(second)) / 2)
    f = mpmath.mpf(force)
    delta = mpmath.cbrt(9 * f**2 / (4 * d * star**2))
    k = mpmath.cbrt(mpmath.mpf(3) / 2 * star**2 * d * f)
    return delta, k, 2 * (1 - s) / (2 - s) * k


# -- the law ---------------------------------------------------------------------------------------


@given(first=lengths, second=lengths, load=loads, sigma=ratios)
def test_law_is_that_of_equations_1_to_4(first, second, load, sigma):
    material = gp.Material(2e11, sigma, 7800.0)
    force = load * material.young_modulus * min(first, second) ** 2
    law = gp.HertzLaw.between(material, first, second)
    with mpmath.workdps(40):
        delta, k, kappa = exact_contact(material, first, second, force)
        measured = law.overlap(force)
        assert abs(measured / delta - 1) < 3e-15
        assert abs(law.stiffness(measured) / k - 1) < 3e-15
        assert abs(material.mindlin_ratio * law.stiffness(measured) / kappa - 1) < 3e-15
        assert abs(law.force(float(delta)) / mpmath.mpf(force) - 1) < 3e-15


@given(first=lengths, second=lengths, overlap=st.floats(-12.0, -1.0))
def test_law_inverts_itself_and_does_not_know_which_ball_is_first(first, second, overlap):
    material = gp.Material(7e10, 0.2, 2500.0)
    delta = 10.0**overlap * min(first, second)
    law = gp.HertzLaw.between(material, first, second)
    mirrored = gp.HertzLaw.between(material, second, first)
    assert_allclose(law.overlap(law.force(delta)), delta, rtol=2e-15)
    assert_allclose(law.coefficient, mirrored.coefficient, rtol=1e-15)


@pytest.mark.parametrize(
    ("bad", "words"), [(-1.0, "negative"), (math.nan, "nan"), ([1.0, -1e-300], "negative")]
)
def test_no_overlap_of_a_tensile_force(steel, bad, words):
    law = gp.HertzLaw.between(steel, 8e-3)
    with pytest.raises(InputError, match=words):
        law.overlap(bad)


@pytest.mark.parametrize("material", [None, 2e11, "steel"])
def test_a_law_needs_a_material(material):
    with pytest.raises(InputError, match="material of a contact"):
        gp.HertzLaw.between(material, 8e-3)


# -- the material ----------------------------------------------------------------------------------


@given(sigma=st.floats(-1.0, 0.5, exclude_min=True))
def test_mindlin_ratio_over_every_stable_poisson_ratio(sigma):
    material = gp.Material(1.0, sigma, 1.0)
    with mpmath.workdps(40):
        s = mpmath.mpf(sigma)
        assert abs(material.mindlin_ratio / (2 * (1 - s) / (2 - s)) - 1) < 1e-15
        assert abs(material.contact_modulus / (1 / (2 * (1 - s**2))) - 1) < 1e-15
    assert 2.0 / 3.0 <= material.mindlin_ratio <= 4.0 / 3.0


@pytest.mark.parametrize("sigma", [-1.0, -1.5, 0.5000001, math.nan, math.inf, "soft", None])
def test_unstable_poisson_ratio_is_an_error(sigma):
    with pytest.raises(InputError, match="poisson_ratio"):
        gp.Material(1.0, sigma, 1.0)


def test_bulk_velocities_of_the_material(steel):
    lame = steel.young_modulus * 0.276 / (1.276 * (1 - 2 * 0.276))
    shear = steel.young_modulus / (2 * 1.276)
    assert_allclose(steel.shear_modulus, shear, rtol=1e-15)
    assert_allclose(steel.longitudinal_velocity, math.sqrt((lame + 2 * shear) / 7840.0), rtol=1e-14)
    assert_allclose(steel.transverse_velocity, math.sqrt(shear / 7840.0), rtol=1e-15)
    assert gp.Material(1e6, 0.5, 1000.0).longitudinal_velocity == math.inf


# -- a static tangential load ----------------------------------------------------------------------


@given(part=st.floats(0.0, 0.999999), mu=st.floats(0.05, 2.0), normal=st.floats(1e-9, 1e9))
def test_reduction_is_the_slope_of_mindlins_displacement(part, mu, normal):
    tangential = part * mu * normal
    with mpmath.workdps(40):
        load = mpmath.mpf(tangential)
        limit = mpmath.mpf(mu) * mpmath.mpf(normal)

        def displacement(t):  # in units of the inverse stiffness of the unloaded contact
            return mpmath.mpf(3) / 2 * limit * (1 - (1 - t / limit) ** (mpmath.mpf(2) / 3))

        # dT/d(delta_t) over its value at T = 0, by central differences
        step = limit * mpmath.mpf("1e-14")
        slope = 2 * step / (displacement(load + step) - displacement(load - step))
        # what rounding of T/mu N to double does to the answer is not the formula's doing
        room = 1e-15 + 4e-16 / max(1.0 - part, 1e-7)
        assert abs(gp.mindlin_reduction(tangential, normal, mu) / slope - 1) < room


def test_reduction_is_even_in_the_load_and_one_without_it():
    assert gp.mindlin_reduction(0.0, 2.0, 0.3) == 1.0
    assert_allclose(
        gp.mindlin_reduction([-0.1, 0.1], 2.0, 0.3), [(1 - 1 / 6) ** (1 / 3)] * 2, rtol=1e-15
    )
    assert isinstance(gp.mindlin_reduction(0.1, 2.0, 0.3), float)


def test_shapes_that_do_not_broadcast_are_refused():
    packing = gp.Packing(STEEL, 8e-3, lattice="fcc", friction=True, torsion="mindlin")
    for find in (lambda *loads: gp.mindlin_reduction(*loads, 0.3), packing.find_torsion):
        assert find([[0.1], [0.2]], [1.0, 2.0, 3.0]).shape == (2, 3)
        with pytest.raises(InputError, match=r"\(2,\).*\(3,\)"):
            find([0.1, 0.2], [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("tangential", "normal", "mu"),
    [
        (0.6, 2.0, 0.3),
        (-0.7, 2.0, 0.3),
        ([0.0, 0.6], 2.0, 0.3),
        (1e308, 1e-300, 0.3),
        (1.0, 5e-324, 5e-324),
        (-1.7e308, 1.0, 0.3),
    ],
)
def test_sliding_contact_is_an_error(tangential, normal, mu):
    with pytest.raises(InputError, match="friction threshold"):
        gp.mindlin_reduction(tangential, normal, mu)


@pytest.mark.parametrize(
    ("tangential", "normal", "mu"),
    [(math.nan, 1, 1), (0, 0, 1), (0, -1, 1), (0, 1, 0), (0, 1, math.nan)],
)
def test_reduction_of_an_impossible_contact_is_an_error(tangential, normal, mu):
    with pytest.raises(InputError):
        gp.mindlin_reduction(tangential, normal, mu)


# -- the lowest resonance of a ball ----------------------------------------------------------------


def torsional(x, order):
    return (order - 1) * spherical_jn(order, x) - x * spherical_jn(order + 1, x)


def spheroidal(x, order, sigma):
    """Lamb's determinant of the spheroidal modes of a free sphere; x = omega R / v_T."""
    y = math.sqrt((1 - 2 * sigma) / (2 * (1 - sigma))) * x

    def j(n, z):
        return spherical_jn(n, z)

    n = order
    return ((n * n - n - x**2 / 2) * j(n, y) + 2 * y * j(n + 1, y)) * (
        (n * n - 1 - x**2 / 2) * j(n, x) + x * j(n + 1, x)
    ) - n * (n + 1) * ((n - 1) * j(n, x) - x * j(n + 1, x)) * ((n - 1) * j(n, y) - y * j(n + 1, y))


def breathing(x, sigma):
    """4 mu u'-type condition of no pressure on the surface, from u = j_1(y r): (lambda + 2 mu) u' +
    2 lambda u / r = 0.
    """
    c2 = 2 * (1 - sigma) / (1 - 2 * sigma)  # (v_L / v_T)^2 = (lambda + 2 mu)/mu
    y = x / math.sqrt(c2)
    return c2 * y * spherical_jn(1, y, derivative=True) + 2 * (c2 - 2) * spherical_jn(1, y)


def first_root(function, *parameters):
    grid = np.linspace(1e-3, 7.0, 14001)
    values = function(grid, *parameters)
    crossings = np.flatnonzero(values[:-1] * values[1:] < 0.0)
    if not crossings.size:
        return math.inf
    crossing = crossings[0]
    return brentq(function, grid[crossing], grid[crossing + 1], args=parameters, xtol=1e-14)


def resonance_number(sigma):
    ball = gp.Material(1.0, sigma, 1.0)
    return ball.lowest_resonance(2.0) * 2 * math.pi / ball.transverse_velocity


@pytest.mark.claim("lowest-resonance")
def test_tables_of_lamb_and_love():
    # Lamb 1882, Love's Treatise art. 195: 0.7961 pi for torsion of order two, 0.840 pi and 0.8160
    # pi v_L/v_T at sigma = 1/4
    assert_allclose(first_root(torsional, 2), 2.5011, atol=5e-5)
    assert_allclose(first_root(spheroidal, 2, 0.25), 0.840 * math.pi, atol=5e-4 * math.pi)
    assert_allclose(
        first_root(breathing, 0.25),
        0.8160 * math.pi * math.sqrt(3.0),
        atol=5e-5 * math.pi * math.sqrt(3.0),
    )
    # incompressible: 0.848 pi
    assert_allclose(first_root(spheroidal, 2, 0.4999999), 0.848 * math.pi, atol=5e-4 * math.pi)


@pytest.mark.parametrize(
    "sigma",
    [
        0.0,
        0.276,
        0.4999999,
        *(pytest.param(sigma, marks=pytest.mark.slow) for sigma in (0.1, 0.25, 0.45)),
    ],
)
def test_torsion_is_lowest_in_ordinary_materials(sigma):
    lowest = resonance_number(sigma)
    assert_allclose(lowest, first_root(torsional, 2), rtol=1e-13)
    others = [first_root(torsional, 3), first_root(breathing, sigma)] + [
        first_root(spheroidal, n, sigma) for n in (1, 2, 3)
    ]
    assert lowest < min(others)


@pytest.mark.parametrize(
    "sigma",
    [
        -0.05,
        -0.13,
        -0.2,
        -0.5,
        -0.99,
        *(pytest.param(sigma, marks=pytest.mark.slow) for sigma in (-0.1, -0.15, -0.3, -0.7, -0.9)),
    ],
)
def test_lowest_of_all_modes_in_auxetic_materials(sigma):
    modes = [first_root(torsional, 2), first_root(torsional, 3), first_root(breathing, sigma)]
    modes += [first_root(spheroidal, n, sigma) for n in (1, 2, 3)]
    assert_allclose(resonance_number(sigma), min(modes), rtol=1e-12)


def test_breathing_falls_to_zero_with_the_bulk_modulus():
    # a ball strained uniformly: omega^2 R^2 / v_T^2 -> 15 K/G
    for sigma in (-0.999, -0.99999, -0.9999999):
        uniform = math.sqrt(10 * (1 + sigma) / (1 - 2 * sigma))
        assert_allclose(resonance_number(sigma), uniform, rtol=2.0 * (1 + sigma))


def test_resonance_scales_with_size_and_velocity(steel):
    assert_allclose(
        steel.lowest_resonance(8e-3),
        2.5011326204 * steel.transverse_velocity / (2 * math.pi * 4e-3),
        rtol=1e-10,
    )
    assert_allclose(steel.lowest_resonance(4e-3), 2 * steel.lowest_resonance(8e-3), rtol=1e-15)
    assert steel.lowest_resonance(5e-324) == math.inf


# -- where the model holds -------------------------------------------------------------------------


def validity_by_hand(packing, force, eta):
    material = packing.material
    d = packing.diameter
    delta, k, _ = (float(x) for x in exact_contact(material, d, d, force))
    # Hertz: a^2 = R delta with R = d/4 for equal balls of diameter d
    radius = math.sqrt(delta * d / 4)
    mass = math.pi / 6 * material.density * d**3
    longitudinal = d * math.sqrt(9 / 8 * (1 + eta / 3) * k / mass)
    transverse = d * math.sqrt(3 / 8 * (1 + eta) * k / mass)
    return {
        "contact_radius": radius / (d / 2),
        "load": (force / (material.young_modulus * d * d)) ** (1 / 6),
        "velocity": max(
            longitudinal / material.longitudinal_velocity, transverse / material.transverse_velocity
        ),
        "yield": force / (math.pi * radius**2) / material.yield_strength,
    }, math.sqrt(k / mass) / (2 * math.pi)


#: conditions that the unit of a number is probably wrong
OF_BALLS = ("young_modulus", "density", "high_density", "diameter", "large_diameter")


@pytest.mark.claim("limits-together")
@pytest.mark.parametrize("friction", [True, False])
@pytest.mark.parametrize("force", [1e-6, 18.446, 3e5])
def test_validity_is_computed(twin, friction, force):
    packing = gp.Packing(
        gp.Material(211.65e9, 0.276, 7840.0, yield_strength=2e9), 8e-3, friction=friction
    )
    eta = packing.mindlin_ratio
    checks = gp.validity(gp.AveragedLattice(packing).at_force(force))
    expected, unit = validity_by_hand(packing, force, eta)
    # the top of the bands on a mesh of the twin
    cell = 2 * math.pi * np.linalg.inv([[1.0, 0.0], [-0.5, math.sqrt(0.75)]]).T
    mesh = [np.array([m, n]) / 24 @ cell for m in range(24) for n in range(24)]
    top = max(twin.frequencies(twin.hexagon(), q, eta)[-1] for q in mesh)
    expected["resonance"] = top * unit / packing.material.lowest_resonance(8e-3)
    assert {check.name for check in checks.checks} - set(OF_BALLS) == set(expected)
    for name, value in expected.items():
        assert_allclose(checks[name].value, value, rtol=1e-12)
        assert checks[name].ok == (value <= checks[name].limit)
    assert checks.ok == all(value <= checks[name].limit for name, value in expected.items())


def test_warnings_say_which_limit_and_by_how_much():
    hard = gp.Material(211.65e9, 0.276, 7840.0, yield_strength=1e9)
    medium = gp.AveragedLattice(gp.Packing(hard, 8e-3))
    assert gp.validity(medium.at_force(1e-3)).warnings == ()
    checks = gp.validity(medium.at_overlap(8e-4))
    warnings = checks.warnings
    assert len(warnings) == 5
    assert not checks.ok
    radius = math.sqrt(0.1)
    assert re.search(f"radius .*{100.0 * radius:.4g} %.* 10 %", warnings[0])
    failed = [check for check in checks.checks if not check.ok]
    for check, text in zip(failed, warnings, strict=True):
        value = float(check.value)
        fraction = (f"{100.0 * value:.4g} %", f"{100.0 * check.limit:g} %", check.reason)
        number = (f"{value:.4g}", f"{check.limit:g}", check.reason)
        assert any(all(word in text for word in words) for words in (fraction, number))
    # and they travel with the velocities and the moduli
    assert gp.sound_velocities(medium.at_overlap(8e-4)).warnings == warnings
    assert gp.moduli(medium.at_overlap(8e-4)).warnings == warnings


def test_warning_counts_the_loads_that_fail():
    medium = gp.AveragedLattice(gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3))
    checks = gp.validity(medium.at_overlap(np.array([8e-9, 8e-7, 4e-4, 8e-4])))
    assert_allclose(checks["contact_radius"].ok, [True, True, False, False])
    assert re.search("2 of 4 loads .*radius .*31.62 %", checks["contact_radius"].warning)
    assert re.search(
        "1 of 2 loads .*ratio .* 0.47", gp.validity(medium.at_overlap([8e-7, 8e-4]))["load"].warning
    )
    assert gp.validity(medium.at_overlap([4e-4, 8e-4]))["load"].warning.startswith("At both loads")
    assert_allclose(checks.ok, [True, True, False, False])
    with pytest.raises(KeyError):
        checks["colour"]


STEEL = gp.Material(2e11, 0.28, 7800.0)
SPREAD = gp.Packing(STEEL, 8e-3, gp.Uniform(2e-6))
TAKES_NUMBERS = {
    "material": lambda big: gp.Material(big, 0.3, 1.0),
    "ratio": lambda big: gp.Material(1e9, big, 1.0),
    "yield": lambda big: gp.Material(1e9, 0.3, 1.0, big),
    "packing": lambda big: gp.Packing(STEEL, big),
    "width": lambda big: gp.Uniform(big),
    "std": lambda big: gp.Normal(big),
    "list": lambda big: gp.Measured([8e-3, big]),
    "kinds": lambda big: gp.Discrete([1.0, big], [1, 0]),
    "force": lambda big: gp.AveragedLattice(SPREAD).at_force(big),
    "forces": lambda big: gp.AveragedForce(SPREAD).at_force([1.0, big]),
    "overlap": lambda big: gp.EffectiveMedium(SPREAD).at_overlap(big),
    "sample": lambda big: gp.Uniform(1.0).sample(big, 1),
    "seed": lambda big: gp.Uniform(1.0).sample(3, big),
    "shape": lambda big: gp.DirectSimulation(SPREAD, (big, 8)),
    "samples": lambda big: gp.DirectSimulation(SPREAD, (8, 8), samples=big),
    "load": lambda big: Load("force", (1.0, big)),
    "tolerance": lambda big: gp.AutoMedium(SPREAD, big),
    "sweep": lambda big: gp.sweep(SPREAD, force=1.0, width=big),
    "points": lambda big: gp.sweep(SPREAD, force=1.0, bands="GKMG", npoints=big),
    "mesh": lambda big: gp.Scene(SPREAD, Load("force", (5.0,)), mesh=(big, 2)),
    "direction": lambda big: gp.sound_velocities(
        gp.AveragedLattice(SPREAD).at_force(5.0), (big, 1)
    ),
    "pulse": lambda big: gp.pulse_velocities(gp.AveragedLattice(SPREAD).at_force(5.0), big),
    "lattice": lambda big: gp.Lattice("long", ((1.0, 0.0), (0.0, big))),
    "friction": lambda big: local_field("triangular", big),
    "tangential": lambda big: gp.mindlin_reduction(big, 1.0, 0.3),
    "fit": lambda big: gp.fit_width(SPREAD, [1.0, big], [500.0, 600.0]),
}


@pytest.mark.parametrize("big", [10**400, -(10**400), 10**5000], ids=["1e400", "-1e400", "1e5000"])
@pytest.mark.parametrize("take", TAKES_NUMBERS.values(), ids=TAKES_NUMBERS)
def test_whole_numbers_beyond_any_float_are_one_clear_error(take, big):
    with pytest.raises(InputError) as told:
        take(big)
    assert len(str(told.value)) < 450


@pytest.mark.parametrize(
    ("values", "failed"),
    [
        ((70.0, 25.0, 8e-3), ["young_modulus"]),
        ((70e9, 0.0025, 8e-3), ["density"]),
        ((70e9, 2.5e6, 8e-3), ["high_density"]),
        ((999.0, 19.9, 1e-3), ["young_modulus", "density"]),
        ((1e3, 20.0, 1e-8), []),
        ((1e3, 3e4, 1.0), []),
        ((70e9, 2500.0, 8.0), ["large_diameter"]),
        ((70e9, 2500.0, 8e6), ["large_diameter"]),
        ((70e9, 2500.0, 9e-9), ["diameter"]),
    ],
)
def test_a_ball_in_a_wrong_unit_is_questioned(values, failed):
    """70 GPa given as 70 made 1.87 m/s without a word, and 8 mm given as 8 Mm any velocity."""
    young, density, d = values
    packing = gp.Packing(gp.Material(young, 0.22, density), d, gp.Uniform(2.5e-4 * d))
    loads = 1e-9 * young * d**2 * np.array([1.0, 2.0])
    for state in (
        gp.AveragedLattice(packing).at_force(loads[0]),
        gp.AveragedLattice(packing).at_force(loads),
    ):
        report = gp.validity(state)
        units = [check for check in report.checks if check.name in OF_BALLS]
        assert [check.name for check in units if not np.all(check.ok)] == failed
        assert all(np.shape(check.value) == state.shape for check in units)
        said = [
            text for text in gp.sound_velocities(state).warnings if "unit is probably wrong" in text
        ]
        assert len(said) == len(failed)
        assert all(
            text.startswith(("The Young modulus is", "The density is", "The diameter is"))
            for text in said
        )


@pytest.mark.parametrize(
    ("lattice", "unit"), [("chain", "N"), ("triangular", "N/m"), ("fcc", "Pa")]
)
def test_a_load_that_crushes_balls_is_told_with_its_unit(steel, lattice, unit):
    medium = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice=lattice))
    with pytest.raises(InputError, match=rf"^pressure = 1e\+18 {unit}"):
        medium.at_pressure(1e18)
    with pytest.raises(InputError, match=r"^force = 1e\+18 N"):
        medium.at_force(1e18)
    with pytest.raises(InputError, match=r"^overlap = 1.0 m presses"):
        medium.at_overlap(1)


@pytest.mark.parametrize("medium", [gp.AveragedLattice, gp.EffectiveMedium, gp.DirectSimulation])
def test_a_load_that_crushes_balls_of_a_modulus_in_a_wrong_unit_says_so(medium):
    for young in (70.0, math.nextafter(1e3, 0.0), 1e3, 70e9):
        packing = gp.Packing(gp.Material(young, 0.22, 2500.0), 8e-3)
        with pytest.raises(InputError, match="together") as told:
            medium(packing).at_force(young * 8e-3**2)
        assert (f"{young:g} Pa, probably a wrong unit" in str(told.value)) == (young < 1e3)
        assert "ower the load" in str(told.value)


@pytest.mark.parametrize(
    ("tangential", "normal", "mu"),
    [(1e308, 1.7e308, 3.0), (1e-320, 1e-300, 1e-10), (3e-200, 1e200, 1e-300), (1e308, 1e9, 1e300)],
)
def test_mindlin_reduction_of_loads_at_the_ends_of_the_floating_range(tangential, normal, mu):
    with mpmath.workdps(30):
        exact = mpmath.cbrt(1 - mpmath.mpf(tangential) / (mpmath.mpf(mu) * mpmath.mpf(normal)))
    assert gp.mindlin_reduction(tangential, normal, mu) == pytest.approx(float(exact), rel=1e-15)


def test_reduced_law_is_the_law_with_the_coefficient_one():
    """What loops over arrays ask, against the methods of HertzLaw: forces, stiffnesses, slopes,
    energies and inverses.
    """
    law = HertzLaw(1.0)
    h = np.concatenate([-np.geomspace(1e-12, 1.0, 7), [0.0], np.geomspace(1e-12, 1e12, 97)])
    forces, roots = hertz.press(h.copy())
    assert_allclose(forces, law.force(h), rtol=1e-15)
    assert_allclose(hertz.force_of(h), forces, rtol=1e-15)
    assert_allclose(hertz.stiffness_of(roots), law.stiffness(h), rtol=1e-15)
    assert_allclose(hertz.stiffness_under(forces), law.stiffness(h), rtol=1e-15)
    assert_allclose(hertz.slope_of(roots), law.stiffness_slope(h), rtol=1e-15)
    closed = np.maximum(h, 0.0)
    assert_allclose(hertz.energy_of(forces, closed), law.energy(h), rtol=1e-15)
    assert_allclose(hertz.overlap_of(forces), closed, rtol=1e-15)
    some = forces > 0.0
    assert_allclose(hertz.overlap_from(forces[some], law.stiffness(h[some])), h[some], rtol=1e-15)


@pytest.mark.parametrize("overlap", [-0.3, 0.0, 0.7, 1e4])
def test_excess_forces_keep_the_digits_that_a_subtraction_loses(overlap):
    differences = np.array([-1.0, -0.2, 0.5, *(1e-12 * np.array([-1.0, 1.0]))])
    found, roots = hertz.press_further(overlap, differences.copy())
    with mpmath.workdps(40):
        y = mpmath.mpf(overlap)
        for n, off in enumerate(map(mpmath.mpf, differences.tolist())):
            h = max(y + off, 0)
            wanted = h ** mpmath.mpf(1.5) - max(y, 0) ** mpmath.mpf(1.5)
            assert abs(found[n] - wanted) <= 1e-15 * abs(wanted) * 4
            assert abs(roots[n] - mpmath.sqrt(h)) <= 1e-15 * mpmath.sqrt(h) * 4


@pytest.mark.parametrize("medium", ["AveragedForce", "EffectiveMedium", "DirectSimulation"])
def test_averages_over_diameters_refuse_balls_with_a_law_of_their_own(medium, steel):
    crystal = gp.Crystal.on("triangular", [gp.Ball(steel, 8e-3)], law=gp.PowerLaw(2.0, 1e9))
    with pytest.raises(InputError, match=r"Hertz.*\.at_force"):
        getattr(gp, medium)(crystal)
