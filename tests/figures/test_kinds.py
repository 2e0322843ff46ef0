"""Balls of several kinds in pictures: one colour a kind, which every eye tells from the others, and
a legend of names.
"""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.base.errors import InputError
from granphon.figures.modes import (
    _find_network_motion,
    _write_network_title,
    mode_figure,
    plot_mode,
    plot_network_mode,
)
from granphon.figures.style import KIND_COLOURS, OTHER_KINDS, colour_kinds
from tests.dynamics.test_network_lattice import random_network
from tests.figures.conftest import assert_inside_page, texts, with_gid

MATERIAL = gp.Material(193e9, 0.30, 8000.0)
STEEL = gp.Ball(MATERIAL, 8e-3, name="steel")
ALUMINIUM = gp.Ball(MATERIAL, 8e-3, mass=7e-4, name="aluminium")
CHAIN = gp.Crystal.on("chain", [STEEL, ALUMINIUM])
#: what each kind of colour blindness leaves of linear red, green and blue: Machado, Oliveira and
#: Fernandes, IEEE Trans. Vis. Comput. Graph. 15, 1291 (2009), at severity one, with the eye that
#: sees all
EYES = {
    "all": np.eye(3),
    "protan": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deutan": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritan": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}


def lab(colour, eye):
    """CIE 1976 L*, a*, b* of a colour (white D65) as an eye sees it."""
    c = np.array(to_rgb(colour))
    linear = np.asarray(EYES[eye]) @ np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    ) @ np.clip(linear, 0, 1)
    x, y, z = np.cbrt(xyz / [0.9505, 1.0, 1.089])
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("eye", EYES)
def test_every_eye_tells_the_kinds_apart(eye):
    """Two colours of a distance of 2.3 in L*a*b* are just told apart; those of kinds are five times
    as far.
    """
    seen = [lab(colour, eye) for colour in (*KIND_COLOURS, OTHER_KINDS)]
    assert (
        min(np.linalg.norm(one - other) for one, other in itertools.combinations(seen, 2)) > 5 * 2.3
    )
    assert min(one[0] for one in seen) > 40.0  # black arrows are seen on them


def test_kinds_beyond_the_colours_share_one():
    found = colour_kinds([f"{n}" for n in (0, 1, 0, 2, *range(9))])
    assert list(found) == [f"{n}" for n in range(9)]
    assert list(found.values()) == [*KIND_COLOURS, *[OTHER_KINDS] * 3]
    assert colour_kinds(["steel"] * 3) == {}


def faces(ax):
    return [tuple(one) for one in with_gid(ax, "balls").get_facecolor().tolist()]


def test_the_picture_of_a_state_has_the_colours_and_names_of_its_kinds():
    state = CHAIN.at_force(20.0)
    figure = gp.plot(state)
    ax = figure.axes[0]
    assert texts(ax.get_legend()) == ["steel", "aluminium"]
    assert faces(ax) == [to_rgba(KIND_COLOURS[n % 2]) for n in range(16)]
    assert_inside_page(figure)
    again = gp.plot(state.network.repeat((3,))).axes[0]  # a network keeps its kinds
    assert faces(again) == faces(ax)[:6]
    assert texts(again.get_legend()) == texts(ax.get_legend())
    # where none are known, balls of each mass have a tint
    plain = gp.plot(replace(state.network, kinds=None)).axes[0]
    assert texts(plain.get_legend()) == [f"{1e3 * ball.mass:.5g} g" for ball in (STEEL, ALUMINIUM)]
    assert gp.plot(gp.Crystal.on("chain", [STEEL]).at_force(20.0)).axes[0].get_legend() is None


def test_balls_that_do_not_move_are_grey_and_a_floor_is_no_kind():
    crystal = (
        gp.Crystal.on("triangular", [STEEL])
        .repeat((3, 1))
        .replace(1, ALUMINIUM)
        .cut(1, 3, edges=("floor", "clamped"))
    )
    state = crystal.at_pressure(10.0)
    assert state.network.kinds == (*["steel", "aluminium", "steel"] * 3, "floor")
    bulk = (
        gp.Crystal.on("triangular", [STEEL])
        .repeat((3, 1))
        .replace(1, ALUMINIUM)
        .at_pressure(10.0)
        .network
    )
    assert bulk.cut(1, 3, edges=("floor", "clamped")).kinds == state.network.kinds
    ax = gp.plot(state).axes[0]
    assert texts(ax.get_legend()) == ["steel", "aluminium"]
    assert faces(ax)[6:] == [to_rgba("0.75")] * 3
    assert faces(gp.plot(gp.Waves(state).modes(2), mode=1).axes[0]) == faces(ax)


def test_kinds_of_a_mode_are_those_of_the_cell_wherever_the_drawing_begins(ax):
    phonons = gp.Phonons(gp.Crystal.on("NaCl", [STEEL, ALUMINIUM]).at_pressure(1e5))
    plot_mode(phonons, (0.25, 0.1, 0.3), 3, ax)
    assert texts(ax.get_legend()) == ["steel", "aluminium"]
    assert [line.get_color() for line in ax.get_legend().get_lines()] == list(KIND_COLOURS[:2])
    figure = mode_figure(gp.Phonons(CHAIN.at_force(1.0)), [0.5], 1)
    assert faces(figure.axes[0]) == [to_rgba(KIND_COLOURS[n % 2]) for n in range(16)]
    assert_inside_page(figure)


def test_a_mode_of_a_network_is_drawn_as_it_moves():
    """The local mode of a light ball in a row: neighbours move by the closed form of the decay, (1
    - e)/(1 + e).
    """
    e = 0.5
    light = gp.Ball(MATERIAL, 8e-3, mass=(1.0 - e) * STEEL.mass, name="light")
    row = gp.Crystal.on("chain", [STEEL]).repeat((41,)).replace(20, light).at_force(10.0)
    modes = gp.Waves(row).modes(1, nearest=gp.Phonons(row).frequencies([[0.0]])[0, -1])
    ax = gp.plot(modes).axes[0]
    assert texts(ax.get_legend()) == ["steel", "light"]
    assert "participation 0.0" in ax.get_title()
    u = np.asarray(with_gid(ax, "displacements").U)
    assert_allclose(np.abs(u[20]), 0.4, rtol=1e-12)
    assert_allclose(u[21:25] / u[20:24], -(1.0 - e) / (1.0 + e), rtol=1e-8)
    assert modes.to_dict()["network"]["kinds"][20] == "light"
    with pytest.raises(InputError, match="mode"):
        gp.plot(modes, mode=1)


def test_in_space_balls_that_hardly_move_are_points():
    """The local mode of a light ball: the balls above a twentieth of its amplitude are drawn."""
    light = gp.Ball(gp.Material(211e9, 0.3, 2000.0), 8e-3, name="light")
    crystal = gp.Crystal.on("fcc", [STEEL]).repeat((3, 3, 3)).replace(13, light).at_force(20.0)
    modes = gp.Waves(crystal).modes(1, nearest=120e3)
    motion = _find_network_motion(modes, 0)
    amplitudes = np.maximum(
        np.linalg.norm(motion.shift, axis=1),
        motion.gyration * np.linalg.norm(motion.turn, axis=1),
    )
    assert_array_equal(motion.is_seen, amplitudes > 0.05 * amplitudes.max())
    n_seen = int(motion.is_seen.sum())
    assert motion.is_seen[13]
    assert 1 <= n_seen < 27
    ax = gp.plot(modes).axes[0]
    assert f"{n_seen} of 27 balls" in ax.get_title()
    # spheres are discs that shrink towards the light; the others are one disc each
    extents = [path.get_extents() for path in with_gid(ax, "spheres").get_paths()]
    is_point = [abs(box.width - 0.12) < 1e-9 and abs(box.height - 0.12) < 1e-9 for box in extents]
    assert sum(is_point) == 27 - n_seen


@pytest.mark.parametrize(
    ("lattice", "shape", "pressure"),
    [
        ("honeycomb", (16, 16), 1e3),
        pytest.param("NaCl", (7, 7, 6), 1e5, marks=pytest.mark.slow),
    ],
)
def test_of_a_large_network_the_balls_are_drawn_that_move_most(lattice, shape, pressure):
    crystal = gp.Crystal.on(lattice, [STEEL, ALUMINIUM]).repeat(shape)
    ax = gp.plot(gp.Waves(crystal.at_pressure(pressure)).modes(1)).axes[0]
    assert f"500 of {crystal.n_balls} balls" in ax.get_title()
    assert texts(ax.get_legend()) == ["steel", "aluminium"]


def test_a_title_counts_no_flat_walls():
    bed = gp.Crystal.on("square", [STEEL]).repeat((6, 1)).cut(1, 3, edges=("floor", "free"))
    network = bed.at_pressure(100.0).network
    n_walls = np.count_nonzero(np.isinf(network.radii))
    assert n_walls > 0
    modes = gp.Waves(network).modes(1)
    title = _write_network_title(modes, 0, 3)
    assert title.endswith(f", 3 of {network.n_balls - n_walls} balls")
    assert "balls" not in _write_network_title(modes, 0, network.n_balls - n_walls)


def test_contacts_have_the_colours_of_their_shares_in_a_mode():
    network = random_network("triangular", (3, 3))
    modes = gp.Waves(network).modes(2)
    figure = gp.plot(modes, show="sensitivity", mode=1)
    (lines,) = (c for c in figure.axes[0].collections if c.get_gid() == "shares")
    drawn = np.asarray(lines.get_array())
    assert_allclose(np.sort(drawn), np.sort(np.tile(modes.contact_shares[1], 2)), rtol=1e-12)
    widths = lines.get_linewidths()
    assert widths[-1] == max(widths)  # the largest share is on top
    with pytest.raises(gp.GranphonError, match="show"):
        gp.plot(modes, show="colour")


@pytest.mark.parametrize("options", [{"view": 3}, {"phase": np.nan}, {"size": 0.0}])
def test_options_of_a_mode_are_checked_also_where_they_have_no_effect(options):
    network = CHAIN.at_force(20.0).network.repeat((3,))
    modes = gp.Waves(network).modes(2)
    for show in ("motion", "sensitivity"):
        with pytest.raises(InputError, match=next(iter(options))):
            plot_network_mode(modes, Figure().subplots(), show=show, **options)
