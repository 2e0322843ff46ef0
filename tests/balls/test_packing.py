"""Packings: the motions of their balls, friction, torsion and bending."""

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
from granphon.balls.lattices import LATTICES, TRIANGULAR
from granphon.balls.motions import allowed_motions
from granphon.balls.packing import Axis, change_packing
from granphon.base.errors import InputError

NAMED = list(LATTICES)


def test_packing_of_equal_balls(packing, smooth):
    assert_allclose(packing.mass, math.pi / 6 * 7840 * 8e-3**3, rtol=1e-15)
    assert_allclose(packing.effective_density, math.pi * 7840 / (3 * math.sqrt(3)), rtol=1e-15)
    assert_allclose(packing.mindlin_ratio, 2 * 0.724 / 1.724, rtol=1e-15)
    assert smooth.mindlin_ratio == 0.0
    assert packing.structure is TRIANGULAR
    with pytest.raises(dataclasses.FrozenInstanceError):
        packing.diameter = 1.0


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"diameter": "8 mm"}, "diameter"),
        ({"lattice": "cubic"}, "unknown lattice"),
        ({"friction": 1}, "friction"),
        ({"friction": "yes"}, "friction"),
        ({"material": "steel"}, "material"),
    ],
)
def test_impossible_packings(steel, change, text):
    with pytest.raises(InputError, match=text):
        gp.Packing(**({"material": steel, "diameter": 8e-3} | change))


# -- motions and packings --------------------------------------------------------------------------

WORDS = {
    1: ["longitudinal", "in_plane", "out_of_plane", "all"],
    2: ["in_plane", "out_of_plane", "all"],
    3: ["all"],
}
#: translations and rotations of a ball
COUNTS = {"longitudinal": (1, 0), "in_plane": (2, 1), "out_of_plane": (1, 2), "all": (3, 3)}


@pytest.mark.parametrize("name", NAMED)
def test_motions_that_a_lattice_has(steel, name):
    words = WORDS[LATTICES[name].dimension]
    assert list(allowed_motions(LATTICES[name].dimension)) == words
    assert (
        gp.Packing(steel, 8e-3, lattice=name).ball_motions
        == gp.Packing(steel, 8e-3, lattice=name, motions=words[0]).ball_motions
    )
    for word in words:
        moving = gp.Packing(steel, 8e-3, lattice=name, motions=word).ball_motions
        translations, rotations = COUNTS[word]
        assert (moving.name, len(moving.translations), len(moving.rotations)) == (
            word,
            translations,
            rotations,
        )
        smooth = gp.Packing(steel, 8e-3, lattice=name, motions=word, friction=False).ball_motions
        assert (len(smooth.translations), smooth.rotations) == (translations, ())
    for word in set(COUNTS) - set(words):
        with pytest.raises(InputError, match=f"{name} .*'{word}'.*{', '.join(words)}"):
            gp.Packing(steel, 8e-3, lattice=name, motions=word)


@pytest.mark.parametrize(
    ("motions", "torsion", "bending", "rotations"),
    [
        ("all", 0.1, 0.0, (0, 1, 2)),
        ("all", 0.0, 0.1, (0, 1, 2)),
        ("all", "mindlin", 0.0, (0, 1, 2)),
        ("in_plane", 0.0, 0.1, (2,)),
        ("out_of_plane", 0.1, 0.0, (0, 1)),
        ("all", 0.0, 0.0, ()),
    ],
)
def test_what_resists_rotations_without_friction(steel, motions, torsion, bending, rotations):
    packing = gp.Packing(
        steel,
        8e-3,
        lattice="chain",
        friction=False,
        motions=motions,
        torsion=torsion,
        bending=bending,
    )
    assert packing.ball_motions.rotations == rotations


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"motions": "sideways"}, "no motions 'sideways'"),
        ({"motions": 6}, "no motions 6"),
        ({"motions": ["all"]}, "no motions"),
        ({"torsion": -1e-9}, "torsion"),
        ({"torsion": "Mindlin"}, "torsion is 'Mindlin'.*mindlin"),
        ({"torsion": [0.1, 0.2]}, "torsion"),
        ({"bending": -1.0}, "bending"),
        ({"bending": "mindlin"}, "bending"),
        (
            {"lattice": "chain", "torsion": 0.1},
            "torsion without .*'longitudinal'.* out_of_plane, all",
        ),
        (
            {"lattice": "chain", "bending": 0.1},
            "bending without .* in_plane, out_of_plane, all",
        ),
        (
            {"lattice": "chain", "motions": "in_plane", "torsion": 0.1},
            "torsion without .*normals",
        ),
        (
            {"lattice": "kagome", "torsion": "mindlin"},
            "torsion without .*'in_plane'.* out_of_plane, all",
        ),
        (
            {"lattice": "square", "torsion": 0.1, "bending": 0.1},
            "^torsion without.* out_of_plane, all",
        ),
        (
            {"lattice": "chain", "motions": "longitudinal", "torsion": 0.1, "bending": 0.2},
            "torsion and bending without .*leave both",
        ),
    ],
)
def test_packings_that_cannot_be(steel, change, text):
    with pytest.raises(InputError, match=text) as caught:
        gp.Packing(**({"material": steel, "diameter": 8e-3, "lattice": "fcc"} | change))
    assert "\n" not in str(caught.value)


# -- torsion of a Hertz contact --------------------------------------------------------------------


def turned_surface(x, y, poisson_ratio, nodes=64):
    """Displacement at (x, y) of a half-space, G = 1, under tractions (-y, x) (4/pi)/sqrt(1 - x^2 -
    y^2) on the unit circle.

    Cerruti: a force Q at distance s along e moves the surface by [(1 - nu) Q + nu e (e.Q)]/(2 pi G
    s) (K. L. Johnson, Contact Mechanics, 1985, section 3.6). Along a line through the point, which
    leaves the circle at s1 and s2, the root is that of (s2 - s)(s - s1), and s cancels: Gauss and
    Chebyshev's rule is exact.
    """
    total = np.zeros(2)
    for angle in (np.arange(nodes) + 0.5) * math.pi / nodes:
        e = np.array([math.cos(angle), math.sin(angle)])
        middle = -(x * e[0] + y * e[1])
        root = math.sqrt(1 - (x * e[1] - y * e[0]) ** 2)
        for s in middle + root * np.cos(np.array([1, 3, 5]) * math.pi / 6):
            force = 4 / math.pi * np.array([-(y + s * e[1]), x + s * e[0]])
            total += math.pi / 3 * ((1 - poisson_ratio) * force + poisson_ratio * e * (e @ force))
    return total * (math.pi / nodes) / (2 * math.pi)


@pytest.mark.claim("mindlin-torsion")
def test_torsion_of_a_bonded_circle():
    # Mindlin's traction turns the circle as one piece by the angle 1, whatever Poisson's ratio; its
    # torque is 16/3 G r^3. Two balls turn by half the relative angle each: k_t = 8/3 G r^3
    for poisson_ratio in (0.0, 0.276, 0.5):
        for x, y in ((0.0, 0.0), (0.3, 0.4), (0.1, -0.8), (0.95, 0.0)):
            assert_allclose(turned_surface(x, y, poisson_ratio), [-y, x], atol=1e-14)
    with mpmath.workdps(30):
        torque = mpmath.quad(
            lambda r: 2 * mpmath.pi * r**3 * 4 / mpmath.pi / mpmath.sqrt(1 - r**2), [0, 1]
        )
    assert float(torque) == pytest.approx(16 / 3, rel=1e-9)


@pytest.mark.claim("mindlin-torsion")
@given(
    load=st.floats(-12, 3),
    diameter=st.floats(-6, 1),
    poisson_ratio=st.floats(-0.9, 0.5),
    name=st.sampled_from(["chain", "triangular", "fcc"]),
)
def test_torsion_of_a_hertz_contact_at_any_load(load, diameter, poisson_ratio, name):
    young = 70e9
    d = 10.0**diameter
    packing = gp.Packing(
        gp.Material(young, poisson_ratio, 2500.0), d, lattice=name, motions="all", torsion="mindlin"
    )
    force = 10.0**load * young * d**2 * 1e-8
    state = gp.AveragedLattice(packing).at_force(force)
    # Hertz: r^3 = 3 f R/(4 E*), R = d/4, E* = E/2(1 - nu^2), delta = r^2/R, k = 2 E* r
    modulus = young / (2 * (1 - poisson_ratio**2))
    shear = young / (2 * (1 + poisson_ratio))
    radius = (3 * force * d / (16 * modulus)) ** (1 / 3)
    assert state.torsion_stiffness == pytest.approx(8 / 3 * shear * radius**3, rel=1e-12)
    assert state.normal_stiffness == pytest.approx(2 * modulus * radius, rel=1e-12)
    assert state.torsion == pytest.approx((1 - poisson_ratio) / 3 * 4 * radius**2 / d**2, rel=1e-12)
    assert state.torsion == pytest.approx((1 - poisson_ratio) / 3 * state.overlap / d, rel=1e-12)


def test_torsion_has_the_shape_of_the_load(steel):
    packing = gp.Packing(steel, 8e-3, lattice="fcc", torsion="mindlin")
    states = gp.AveragedLattice(packing).at_force(np.array([[1.0, 8.0], [27.0, 64.0]]))
    assert states.torsion.shape == (2, 2)
    # overlap goes as f^(2/3)
    assert_allclose(states.torsion / states.torsion[0, 0], [[1, 4], [9, 16]], rtol=1e-13)
    fixed = gp.AveragedLattice(
        gp.Packing(steel, 8e-3, lattice="fcc", torsion=0.1, bending=0.2)
    ).at_force(np.array([1.0, 8.0]))
    assert_allclose(fixed.torsion, 0.1, rtol=0)
    assert_allclose(fixed.torsion_stiffness, 0.1 * fixed.normal_stiffness * 8e-3**2, rtol=1e-15)
    assert_allclose(fixed.bending_stiffness, 0.2 * fixed.normal_stiffness * 8e-3**2, rtol=1e-15)


@pytest.mark.parametrize("more", [{"motions": "all"}, {"motions": "out_of_plane"}])
def test_what_a_simulation_does_not_know_is_refused(steel, more):
    with pytest.raises(InputError, match="are not simulated"):
        gp.DirectSimulation(gp.Packing(steel, 8e-3, **more))


@pytest.mark.parametrize("lattice", ["chain", "triangular"])
def test_motions_that_deform_no_contact_have_bands_at_zero(steel, lattice):
    packing = gp.Packing(steel, 8e-3, lattice=lattice, motions="out_of_plane", friction=False)
    ph = gp.Phonons(gp.AveragedLattice(packing).at_force(18.0))
    bands = ph.bands(npoints=3)
    assert not np.any(bands.frequencies)
    assert any("vanishes" in one for one in bands.warnings)
    assert not np.any(ph.calculator.get_force_constants(ph.atoms))
    with pytest.raises(InputError, match="every branch vanishes"):
        ph.dos()


@pytest.mark.parametrize("name", ["torsion", "bending"])
def test_a_stiffness_beyond_all_contacts_is_refused(steel, name):
    with pytest.raises(InputError, match=f"{name} is 1e.*300"):
        gp.Packing(steel, 8e-3, lattice="fcc", **{name: 1e300})


@pytest.mark.parametrize("name", ["on_site.w", "on_site.rotation_w"])
def test_an_unknown_spring_is_refused_with_the_names_of_springs(name):
    with pytest.raises(InputError, match=r"on_site\.rotation_z") as refused:
        Axis.of(name, [1.0])
    assert "a kind of ball" not in str(refused.value)


def test_a_width_needs_a_spread_to_scale(steel):
    packing = gp.Packing(steel, 8e-3)
    with pytest.raises(InputError, match="spread is 'narrow'"):
        change_packing(packing, {"spread": "narrow", "width": 1e-6})
    assert change_packing(packing, {"width": 1e-6}).spread == gp.Uniform(1e-6)
