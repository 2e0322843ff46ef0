"""Balls, the constants of two that touch, and contact laws: closed forms, derivatives, and laws of
users.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import get_args

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls import contact_laws
from granphon.balls.ball import RIGID_PLANE, ContactConstants
from granphon.balls.contact_laws import (
    check_law,
    law_between,
    opening_overlap,
    read_laws,
)
from granphon.balls.contact_model import PlainLaw
from granphon.base.errors import InputError

STEEL = gp.Material(193e9, 0.30, 8000.0)
ALUMINIUM = gp.Material(73.5e9, 0.33, 2700.0)
S = gp.Ball(STEEL, 19.05e-3, mass=28.84e-3)
A = gp.Ball(ALUMINIUM, 9e-3)
GEL = gp.Ball(gp.Material(1e6, 0.49, 1100.0), 2e-3)

materials = st.builds(
    gp.Material,
    st.floats(4.0, 12.0).map(lambda x: 10.0**x),
    st.floats(-0.9, 0.5),
    st.floats(1e2, 1e4),
)
balls = st.builds(gp.Ball, materials, st.floats(-6.0, 1.0).map(lambda x: 10.0**x))


# -- balls -----------------------------------------------------------------------------------------


def test_a_ball_is_solid_unless_it_is_said_otherwise():
    ball = gp.Ball(STEEL, 8e-3)
    assert_allclose(ball.mass, 8000.0 * math.pi / 6 * 8e-3**3, rtol=1e-15)
    assert_allclose(ball.inertia, 0.4 * ball.mass * 4e-3**2, rtol=1e-15)
    assert S.mass == 28.84e-3
    assert_allclose(S.inertia, 0.4 * 28.84e-3 * (19.05e-3 / 2) ** 2, rtol=1e-15)
    assert gp.Ball(STEEL, 8e-3, inertia=1e-9).inertia == 1e-9
    assert replace(ball, name="S").name == "S"
    assert hash(ball) == hash(gp.Ball(STEEL, 8e-3))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"diameter": 0.0}, "diameter: .*0.0.* above zero"),
        ({"mass": -1.0}, "mass: found -1.0"),
        ({"inertia": 1.0}, "inertia is 1 kg m.2"),
        ({"material": "steel"}, "Give a granphon.Material"),
        ({"name": "=A"}, "the name of a ball"),
    ],
)
def test_no_ball(change, said):
    with pytest.raises(InputError, match=said):
        gp.Ball(**{"material": STEEL, "diameter": 8e-3} | change)


@given(balls, balls)
def test_constants_of_a_pair_are_those_of_johnson(one, other):
    with mpmath.workdps(40):
        e1, e2, n1, n2, r1, r2 = (
            mpmath.mpf(x)
            for x in (
                one.material.young_modulus,
                other.material.young_modulus,
                one.material.poisson_ratio,
                other.material.poisson_ratio,
                one.radius,
                other.radius,
            )
        )
        g1 = e1 / (2 * (1 + n1))
        g2 = e2 / (2 * (1 + n2))
        star = 1 / ((1 - n1**2) / e1 + (1 - n2**2) / e2)
        shear = 1 / ((2 - n1) / g1 + (2 - n2) / g2)
        wanted = (
            star,
            1 / (1 / r1 + 1 / r2),
            4 * shear / star,
            mpmath.mpf(16) / 3 / (1 / g1 + 1 / g2),
        )
        found = ContactConstants.of(one, other)
        mirrored = ContactConstants.of(other, one)
        assert all(abs(a / b - 1) < 3e-15 for a, b in zip(found, wanted, strict=True))
    assert_allclose(found, mirrored, rtol=1e-15)


@given(balls)
def test_equal_balls_have_the_constants_of_a_packing(ball):
    found = ContactConstants.of(ball, ball)
    law = gp.HertzLaw.between(ball.material, ball.diameter)
    assert_allclose(found.mindlin_ratio, ball.material.mindlin_ratio, rtol=1e-14)
    assert_allclose(gp.Hertz().between(ball, ball).coefficient, law.coefficient, rtol=1e-14)
    # a floor is a rigid ball of infinite size: half the compliance, twice the radius of equal balls
    floor = ContactConstants.of(ball, RIGID_PLANE)
    assert_allclose(floor[:3], [2 * found[0], 2 * found[1], found[2]], rtol=1e-14)


def test_two_rigid_planes_make_no_contact():
    with pytest.raises(InputError, match="make no elastic contact"):
        ContactConstants.of(RIGID_PLANE, RIGID_PLANE)


# -- laws ------------------------------------------------------------------------------------------

TABLE = np.geomspace(1e-9, 1e-4, 11)
LAWS = {
    "hertz": gp.Hertz().between(S, A),
    "spring": gp.PowerLaw(1.0, 3e6).between(S, A),
    "cone": gp.PowerLaw(2.0, 1e11).between(S, A),
    "dmt": gp.DMT(0.05).between(GEL, GEL),
    "jkr": gp.JKR(0.05).between(GEL, GEL),
    "stiff jkr": gp.JKR(1e-9).between(S, A),
    "table": gp.TabulatedLaw(TABLE, 1e10 * TABLE**1.5 * (1.0 + 0.2 * np.sin(np.log(TABLE)))),
}


def test_every_law_of_scenes_can_be_stored():
    """A class that is missing in the union is lost by networks, and refused by ``from_dict``."""
    assert {named.law for named in contact_laws.LAWS.values()} == set(get_args(PlainLaw))


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("size", [3e-9, 1.3e-7, 7e-6, 4e-4])
def test_force_and_stiffness_are_derivatives(name, size):
    law = LAWS[name]
    h = 1e-5 * size

    def slope(of):
        # of five points: exact for quartics
        low2, low, high, high2 = (of(size + n * h) for n in (-2, -1, 1, 2))
        return (low2 - 8 * low + 8 * high - high2) / (12 * h)

    # round-off of a difference is that of the larger number over the step
    for of, told in (
        (law.energy, law.force),
        (law.force, law.stiffness),
        (law.stiffness, law.stiffness_slope),
    ):
        noise = 1e-10 * abs(of(size)) / size
        assert abs(slope(of) - told(size)) <= 1e-9 * abs(told(size)) + noise
    assert_allclose(law.overlap(law.force(size)), size, rtol=1e-10)


@pytest.mark.parametrize("name", LAWS)
def test_laws_take_arrays_and_return_floats_for_floats(name):
    law = LAWS[name]
    for method in (law.force, law.stiffness, law.stiffness_slope, law.energy, law.overlap):
        assert isinstance(method(1e-6), float)
        assert_allclose(method(np.full((2, 3), 1e-6)), np.full((2, 3), method(1e-6)), rtol=1e-14)
    apart = law.least_overlap - 1e-9
    assert (
        law.force(apart)
        == law.stiffness(apart)
        == law.stiffness_slope(apart)
        == law.energy(apart)
        == 0.0
    )


@given(st.floats(-3.0, 8.0), st.floats(-6.0, 1.0))
def test_jkr_is_that_of_its_contact_radius(modulus, adhesion):
    ball = gp.Ball(gp.Material(10.0 ** (modulus + 3.0), 0.4, 1e3), 3e-3)
    w = 10.0**adhesion
    law = gp.JKR(w).between(ball, ball)
    constants = ContactConstants.of(ball, ball)
    star = constants.modulus
    r = constants.radius
    # a(f), delta(a) as in the paper of 1971, and k = df/da / d(delta)/da
    least = 1.5 * math.pi * w * r
    for force in least * np.array([-0.999, -0.5, 0.0, 2.0, 1e3]):
        reach = 3 * math.pi * w * r
        a = (3 * r / (4 * star) * (force + reach + math.sqrt(2 * reach * force + reach**2))) ** (
            1 / 3
        )
        delta = a**2 / r - math.sqrt(2 * math.pi * w * a / star)
        assert_allclose(law.overlap(force), delta, rtol=1e-12, atol=1e-13 * a**2 / r)
        assert_allclose(law.force(law.overlap(force)), force, rtol=1e-11, atol=1e-11 * least)
        root = math.sqrt(2 * math.pi * w * star)
        rise = 4 * star * a**2 / r - 3 * root * math.sqrt(a)
        run = 2 * a / r - 0.5 * root / star / math.sqrt(a)
        assert_allclose(law.stiffness(delta), rise / run, rtol=1e-9)
        assert_allclose(law.contact_radius(delta), a, rtol=1e-11)
        if force == 0.0:
            assert_allclose(law.stiffness(delta), 0.6 * 2 * star * a, rtol=1e-12)
    assert_allclose(law.force(law.least_overlap), -least, rtol=1e-12)
    assert law.stiffness(law.least_overlap) <= 1e-6 * law.stiffness(law.overlap(0.0))
    assert law.force(law.least_overlap * 1.001) == 0.0
    with pytest.raises(InputError, match="pulled by more than"):
        law.overlap(-1.001 * least)


def test_dmt_is_hertz_with_a_tension_and_no_adhesion_is_hertz():
    law = gp.DMT(0.05).between(GEL, GEL)
    hertz = gp.Hertz().between(GEL, GEL)
    delta = np.array([0.0, 1e-8, 1e-5])
    assert_allclose(law.force(delta), hertz.force(delta) - 2 * math.pi * 0.05 * 0.5e-3, rtol=1e-14)
    assert gp.JKR(0.0).between(GEL, GEL) == gp.DMT(0.0).between(GEL, GEL).hertz == hertz
    with pytest.raises(InputError, match="pulled by more than"):
        law.overlap(-1.0)
    with pytest.raises(InputError, match=r"Give f >= 0\."):
        gp.DMT(0.0).between(GEL, GEL).overlap(-1.0)
    assert law.energy(-math.inf) == law.force(-math.inf) == 0.0


@given(st.floats(-13.0, -2.0))
def test_a_tabulated_power_law_is_that_law(exponent):
    delta = 10.0**exponent
    hertz = gp.Hertz().between(S, A)
    table = gp.TabulatedLaw([0.0, *TABLE], [0.0, *hertz.force(TABLE)])
    assert table == gp.TabulatedLaw(TABLE, hertz.force(TABLE))
    for method in ("force", "stiffness", "energy"):
        assert_allclose(getattr(table, method)(delta), getattr(hertz, method)(delta), rtol=2e-13)
    assert_allclose(table.stiffness_slope(delta), hertz.stiffness_slope(delta), rtol=1e-11)
    assert_allclose(table.overlap(hertz.force(delta)), delta, rtol=2e-13)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: gp.PowerLaw(0.5, 1.0), "exponent is 0.5"),
        (lambda: gp.PowerLaw(1.5, 0.0), "coefficient: found 0.0"),
        (lambda: gp.DMT(-1.0), "adhesion: found -1.0"),
        (lambda: gp.JKR(math.nan), "adhesion: found nan"),
        (lambda: gp.TabulatedLaw([1.0, 2.0], [1.0]), "one length"),
        (
            lambda: gp.TabulatedLaw([1.0, 2.0, 2.0], [1.0, 2.0, 3.0]),
            "row 2.* above zero",
        ),
        (lambda: gp.TabulatedLaw([0.0, 2.0], [0.0, 3.0]), "has 1 row with a force"),
        (lambda: gp.TabulatedLaw([0.0, 1.0, 2.0, 1.5], [0.0, 1.0, 2.0, 3.0]), "1.5 m.* row 3"),
        (lambda: gp.TabulatedLaw([0.0, 1.0, math.inf], [0.0, 1.0, 2.0]), "inf m.* row 2.* finite"),
        (lambda: gp.PowerLaw(1.5, 1.0).overlap(-1.0), "negative"),
    ],
)
def test_no_law(make, said):
    with pytest.raises(InputError, match=said):
        make()


class Quadratic:
    """A user's law, f = c delta^2 + b delta^3."""

    def __init__(self, **other):
        self.other = other

    def _find(self, name, overlap, *coefficients):
        x = np.maximum(np.asarray(overlap, float), 0.0)
        return self.other.get(name, 1.0) * sum(c * x**power for c, power in coefficients)

    def energy(self, overlap):
        return self._find("energy", overlap, (1e10 / 3, 3), (1e13 / 4, 4))

    def force(self, overlap):
        return self._find("force", overlap, (1e10, 2), (1e13, 3))

    def stiffness(self, overlap):
        return self._find("stiffness", overlap, (2e10, 1), (3e13, 2))

    def stiffness_slope(self, overlap):
        return self._find("stiffness_slope", overlap, (2e10, 0), (6e13, 1))

    def overlap(self, force):
        x = np.sqrt(np.asarray(force, float) / 1e10)
        for _ in range(50):
            x = x - (1e10 * x**2 + 1e13 * x**3 - force) / (2e10 * x + 3e13 * x**2)
        return self.other.get("overlap", 1.0) * x


EXTREME = [
    5e-324,
    1e-308,
    1e308,
    -1e308,
    math.inf,
    -math.inf,
    math.nan,
    10**400,
    "1",
    None,
    1j,
    [1.0, "a"],
    [[1.0], 2.0],
]


@pytest.mark.parametrize("name", LAWS)
def test_laws_refuse_what_is_beyond_double_precision(name):
    """Numbers are finite, or there is one error; overlaps of balls that are far apart give zero."""
    law = LAWS[name]
    for method in ("force", "stiffness", "stiffness_slope", "energy", "overlap", "contact_radius"):
        for value in EXTREME if hasattr(law, method) else ():
            try:
                assert np.all(np.isfinite(getattr(law, method)(value)))
            except InputError:
                assert value not in (5e-324, 1e-308)
    assert law.force(-1e308) == 0.0
    with pytest.raises(InputError, match=r"an overlap is nan\. Give a number, m"):
        law.force(math.nan)


def test_adhesion_beyond_double_precision():
    for make in (lambda: gp.JKR(5e-324), lambda: gp.JKR(1e308), lambda: gp.DMT(1e308)):
        with pytest.raises(InputError, match="precision"):
            make().between(GEL, GEL)
    # so little adhesion is none
    for law in (gp.JKR(1e-304), gp.DMT(5e-324)):
        assert_allclose(
            law.between(GEL, GEL).force(1e-6), gp.Hertz().between(GEL, GEL).force(1e-6), rtol=1e-14
        )
    with pytest.raises(InputError, match=r"Give a granphon\.Ball"):
        gp.JKR(0.1).between(GEL, 2.0)


def test_a_table_begins_as_a_power_of_one_or_above():
    """Where the interpolator has a flat end, or the table rises less, contacts would push at once
    when balls touch.
    """
    for overlap, force in (
        ([1e-8, 1e-6, 1.001e-6, 1e-5], [1e-9, 1e-7, 1e-5, 1.1e-5]),
        ([1e-8, 1e-6], [1e-3, 2e-3]),
    ):
        law = gp.TabulatedLaw(overlap, force)
        assert_allclose(law.force(overlap), force, rtol=1e-12)
        assert_allclose(law.force(1e-3 * overlap[0]), 1e-3 * force[0], rtol=1e-12)
        assert_allclose(law.energy(overlap[0]), 0.5 * overlap[0] * force[0], rtol=1e-12)
        assert np.all(law.stiffness(np.geomspace(1e-12, 1e-3, 200)) > 0.0)
    near = [1e10, math.nextafter(1e10, 2e10)]
    for table in ((near, [1.0, 2.0]), ([1.0, 2.0], near)):
        with pytest.raises(InputError, match="rows 0 and 1"):
            gp.TabulatedLaw(*table)


def test_a_law_of_a_user_serves_if_its_methods_agree():
    law = law_between(Quadratic(), S, A)
    check_law(law, 5e-3)
    for name in ("energy", "force", "stiffness", "stiffness_slope", "overlap"):
        with pytest.raises(InputError, match=r"Quadratic .*overlap"):
            check_law(Quadratic(**{name: 1.01}), 5e-3)
    with pytest.raises(InputError, match="does not rise"):
        check_law(Quadratic(energy=-1.0, force=-1.0, stiffness=-1.0, stiffness_slope=-1.0), 5e-3)
    wide = type("Wide", (Quadratic,), {"contact_radius": lambda self, overlap: -1.0 * overlap})
    with pytest.raises(InputError, match=r"contact_radius .*Wide"):
        check_law(wide(), 5e-3)
    half = type("Half", (), dict.fromkeys(("force", "energy", "overlap"), Quadratic.force))
    with pytest.raises(InputError, match="stiffness, stiffness_slope"):
        law_between(half(), S, A)
    named = type("Named", (), {"between": "balls"})
    with pytest.raises(InputError, match=r"Named .*has no method force"):
        law_between(named(), S, A)
    with pytest.raises(InputError, match="a body of a contact"):
        gp.Hertz().between(gp.Ball, S)
    flat = type("Flat", (Quadratic,), {"force": lambda self, overlap: 1.0})
    with pytest.raises(InputError, match="same shape"):
        check_law(flat(), 5e-3)
    lost = type("Lost", (Quadratic,), {"overlap": lambda self, force: np.nan * force})
    with pytest.raises(InputError, match=r"overlap .*Lost .*forces"):
        check_law(lost(), 5e-3)


class Floats:
    """Hertz's law of floats alone."""

    def energy(self, overlap):
        return 0.4e9 * max(overlap, 0.0) ** 2.5

    def force(self, overlap):
        return 1e9 * max(overlap, 0.0) ** 1.5

    def stiffness(self, overlap):
        return 1.5e9 * math.sqrt(max(overlap, 0.0))

    def stiffness_slope(self, overlap):
        return 0.75e9 / math.sqrt(overlap) if overlap > 0.0 else 0.0

    def overlap(self, force):
        return (force / 1e9) ** (2.0 / 3.0)


class Unclosed(Floats):
    """Hertz's law without a word on balls that are apart."""

    def energy(self, h):
        return 0.4e9 * h**2.5

    def force(self, h):
        return 1e9 * h**1.5

    def stiffness(self, h):
        return 1.5e9 * np.sqrt(h)

    def stiffness_slope(self, h):
        return 0.75e9 / np.sqrt(h)


class Bent:
    """A bond whose force below zero is not the derivative of its energy."""

    def energy(self, overlap):
        return 0.5e6 * np.asarray(overlap) ** 2

    def force(self, overlap):
        return 1e6 * np.where(np.asarray(overlap) < 0.0, 2.0, 1.0) * overlap

    def stiffness(self, overlap):
        return np.full(np.shape(overlap), 1e6)

    def stiffness_slope(self, overlap):
        return np.zeros(np.shape(overlap))

    def overlap(self, force):
        return np.asarray(force) / 1e6


class Named(Bent):
    """A law whose force is a text."""

    def force(self, overlap):
        return "strong"


class Begun(Bent):
    """A law whose least overlap is a text."""

    least_overlap = "now"


class Round(Bent):
    """A bond whose radius takes floats alone."""

    def contact_radius(self, overlap):
        return math.sqrt(overlap)


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (
            Floats(),
            "force .*Floats .*array.*np.maximum",
        ),
        (
            Unclosed(),
            "force .*Unclosed .*0 m.*np.maximum",
        ),
        (
            Bent(),
            "force .*Bent is -.* energy .*overlap of -",
        ),
        (Named(), "force .*Named "),
        (Begun(), "least_overlap .*Begun .*'now'"),
        (Round(), "contact_radius .*Round .*array.*np.sqrt"),
    ],
)
def test_what_a_law_must_say_of_arrays_and_of_balls_that_are_apart(law, said):
    with pytest.raises(InputError, match=said):
        check_law(law, 2e-3)


def test_one_law_may_stand_twice_for_a_pair_and_two_may_not():
    hertz = gp.Hertz()
    assert read_laws({("A", "B"): "hertz", ("B", "A"): hertz}) == (
        (("A", "B"), hertz),
        (("B", "A"), hertz),
    )
    spring = gp.PowerLaw(1.0, 1e5)
    for pairs in ((("A", "B"), ("B", "A")), (("A", "B"), ("A", "B"))):
        with pytest.raises(InputError, match="two laws"):
            read_laws(tuple(zip(pairs, (hertz, spring), strict=True)))


class BondThatSaysSo:
    """A spring that pulls at any distance, and says that it never opens."""

    least_overlap = -math.inf

    def energy(self, overlap):
        return 5e4 * np.square(overlap)

    def force(self, overlap):
        return 1e5 * np.asarray(overlap)

    def stiffness(self, overlap):
        return np.full(np.shape(overlap), 1e5)

    def stiffness_slope(self, overlap):
        return np.zeros(np.shape(overlap))

    def overlap(self, force):
        return np.asarray(force) / 1e5


def test_a_bond_may_say_that_it_never_opens():
    law = BondThatSaysSo()
    check_law(law, 1e-3)
    assert opening_overlap(law) == -math.inf
