"""What is drawn is what was computed: the plotted data are read back, not the pixels."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from inspect import signature

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.base.errors import FigureError, InputError
from granphon.base.scales import HertzPrefix
from granphon.figures import bands as plot
from granphon.figures import scales, style
from granphon.figures.curves import sweep_figure
from granphon.figures.modes import plot_mode
from granphon.figures.plot import OF_DATASETS, PICTURES
from granphon.figures.views import View
from granphon.phonons.paths import zone_polygon
from granphon.scene.outputs import OUTPUTS
from tests.figures.conftest import assert_inside_page, with_gid

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
DIMER = gp.Lattice("dimer", ((1.0, 0.0), (0.0, np.sqrt(3.0))), ((0.0, 0.0), (0.5, 0.5)))


def phonons_of(lattice="triangular", friction=True, cells=1, mass=1.0):
    state = gp.AveragedLattice(
        gp.Packing(STEEL, 8e-3, lattice=lattice, friction=friction)
    ).at_force(18.446)
    if cells == 1:
        return gp.Phonons(state)
    balls = gp.atoms(state).repeat((cells, cells, 1))
    masses = balls.get_masses()
    masses[4] = mass
    balls.set_masses(masses)
    return gp.Phonons(state, balls)


@pytest.fixture(scope="module")
def phonons():
    return phonons_of()


@pytest.fixture(scope="module")
def bands(phonons):
    return phonons.bands("GKMG", npoints=41)


def branches(ax, bands):
    s = len(bands.distances)
    b = bands.n_branches
    return [[with_gid(ax, f"band-{i}-{j}") for j in range(b)] for i in range(s)]


# -- bands -----------------------------------------------------------------------------------------


def test_bands_are_the_connected_frequencies_in_the_unit_of_the_label(bands, ax):
    assert plot.plot_bands(bands, ax) is ax
    drawn = np.array(
        [[np.array(line.get_segments()) for line in row] for row in branches(ax, bands)]
    )
    points = drawn[:, :, :, 1]  # (s, b, p, 2): the middle vertex of each piece
    assert_allclose(
        points[..., 1], np.moveaxis(bands.connected_frequencies, 2, 1) / 1e3, rtol=1e-15
    )
    assert_allclose(
        points[..., 0], np.broadcast_to(bands.distances[:, None], points.shape[:3]), rtol=1e-15
    )
    # each piece ends where the next begins, and the line runs from end to end
    assert_array_equal(drawn[:, :, :-1, 2], drawn[:, :, 1:, 0])
    assert_array_equal(drawn[:, :, 0, 0], points[:, :, 0])
    assert_array_equal(drawn[:, :, -1, 2], points[:, :, -1])
    assert ax.get_ylabel() == "Frequency (kHz)"


def test_every_colour_is_the_rotational_fraction_of_its_point(bands, ax):
    plot.plot_bands(bands, ax)
    drawn = np.array([[line.get_array() for line in row] for row in branches(ax, bands)])
    expected = np.take_along_axis(bands.rotational_fraction, bands.connection, 2)
    assert_allclose(np.moveaxis(drawn, 1, 2), expected, rtol=0, atol=0)
    for line in itertools.chain(*branches(ax, bands)):
        assert (line.norm.vmin, line.norm.vmax) == (0.0, 1.0)
    assert 0.99 < drawn.max() <= 1.0 + 1e-12


def test_colours_grow_lighter_evenly(bands):
    red, green, blue = scales.ROTATION(np.linspace(0.0, 1.0, 64))[:, :3].T
    luminance = 0.2126 * red**2.2 + 0.7152 * green**2.2 + 0.0722 * blue**2.2
    lightness = np.cbrt(luminance)
    assert np.all(np.diff(lightness) > 0.0)
    assert lightness[-1] - lightness[0] > 0.4


def test_ticks_are_at_the_corners(bands, ax):
    plot.plot_bands(bands, ax)
    assert_allclose(ax.get_xticks(), [0.0, 2 / 3, 1.0, 1.0 + 1 / np.sqrt(3.0)], rtol=1e-12)
    assert [t.get_text() for t in ax.get_xticklabels()] == ["Γ", "K", "M", "Γ"]


def test_a_path_that_jumps_is_not_joined(phonons, ax):
    jump = phonons.bands("GK,MG", npoints=11)
    plot.plot_bands(jump, ax)
    assert [t.get_text() for t in ax.get_xticklabels()] == ["Γ", "K|M", "Γ"]
    corner = jump.distances[0, -1]
    for before, after in zip(*branches(ax, jump), strict=True):
        assert np.max(np.array(before.get_segments())[..., 0]) <= corner
        assert np.min(np.array(after.get_segments())[..., 0]) >= corner


@pytest.mark.parametrize(
    ("label", "shown"), [("G", "Γ"), ("K|M", "K|M"), ("H1", r"$\mathrm{H}_{1}$"), ("G|X", "Γ|X")]
)
def test_labels_as_they_are_printed(label, shown):
    assert plot.write_corner(label) == shown


def test_frequencies_in_another_unit(bands, ax):
    plot.plot_bands(bands, ax, unit=HertzPrefix("reduced", bands.scales.frequency))
    top = max(
        np.array(line.get_segments())[..., 1].max()
        for line in itertools.chain(*branches(ax, bands))
    )
    assert_allclose(top, np.sqrt(30.0 * STEEL.mindlin_ratio), rtol=1e-12)
    assert ax.get_ylim()[1] > top
    assert ax.get_ylim()[0] < 0.0
    assert ax.get_ylabel() == "Frequency (reduced)"


def test_without_friction_the_colour_is_the_longitudinal_fraction_and_the_bar_says_so():
    bands = phonons_of(friction=False).bands("GKMG", npoints=21)
    figure = plot.bands_figure(bands)
    ax, bar = figure.axes
    assert bar.get_xlabel() == "Longitudinal part of the kinetic energy"
    expected = np.take_along_axis(bands.longitudinal_fraction, bands.connection, 2)
    rows = branches(ax, bands)
    drawn = np.array([[line.get_array() for line in row] for row in rows])
    assert_array_equal(np.moveaxis(drawn, 1, 2), expected)
    ends = rows[0][0].cmap([0.0, 1.0])
    assert_allclose(
        ends, [to_rgba(style.TRANSVERSE_COLOUR), to_rgba(style.LONGITUDINAL_COLOUR)], atol=1e-12
    )
    # from Gamma the slow branch is transverse and the fast one is longitudinal
    assert_allclose(drawn[0, :, 1], [0.0, 1.0], atol=1e-3)


def test_coinciding_branches_are_all_visible(ax):
    plain = gp.Phonons(gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(18.446)).bands(
        "GKM", npoints=4
    )
    values = np.array([[1.0, 1.0, 1.0], [2.0, 2.0, 3.0], [3.0, 3.0, 3.0], [3.0, 3.5, 4.0]])
    bands = replace(plain, frequencies=np.stack([values, values]), eigenvectors=None)
    plot.plot_bands(bands, ax)
    # the earlier of two is wider where they stay together, and not where they merely touch (the
    # third, at the ends)
    for row in branches(ax, bands):
        widths = np.array([line.get_linewidths() for line in row]).T
        assert_allclose(widths / widths.min(), [[2, 1, 1], [2, 1, 1], [2, 1, 1], [1, 1, 1]])


# -- long waves ------------------------------------------------------------------------------------


@pytest.mark.parametrize("of_lattice", [True, False])
def test_long_waves_start_at_gamma_with_the_sound_velocities(phonons, bands, ax, of_lattice):
    v = gp.sound_velocities(phonons.state)
    plot.plot_bands(bands, ax, asymptotes=phonons.lattice if of_lattice else v)
    for s, gamma in ((0, 0.0), (2, bands.distances[-1, -1])):
        for name, velocity in (("longitudinal", v.longitudinal), ("transverse", v.transverse)):
            x, y = with_gid(ax, f"asymptote-{name}-{s}").get_data()
            wavenumber = 2.0 * np.pi * np.abs(x - gamma) / 8e-3
            assert_allclose(y * 1e3, velocity * wavenumber / (2.0 * np.pi), rtol=1e-12, atol=1e-9)
            assert_allclose(np.ptp(x), 0.5 * np.ptp(bands.distances[s]), rtol=1e-12)
    assert len([line for line in ax.lines if str(line.get_gid()).startswith("asymptote")]) == (
        6 if of_lattice else 4
    )


def test_a_rotational_branch_that_begins_at_zero_has_no_asymptote(phonons, ax):
    network = phonons.state.network
    zeros = np.zeros(network.n_contacts)
    rolling = replace(
        network,
        shear_stiffness=zeros,
        bending_stiffness=zeros + 1.0,
        prestress=False,
        lattice=None,
        shape=None,
    )
    plot.plot_asymptotes(
        phonons.bands("GM", npoints=3), gp.ContactLattice.from_network(rolling), ax
    )
    labels = [str(line.get_gid()) for line in ax.lines]
    assert "asymptote-transverse-0" in labels
    assert "asymptote-optical-0" not in labels


def test_the_optical_asymptote_agrees_with_the_branch_to_fourth_order(phonons, ax):
    near = phonons.bands([[0.0, 0.0], [0.06, 0.06]], npoints=61, labels=("G", "q"))
    plot.plot_asymptotes(near, phonons.lattice, ax, reach=1.0)
    x, y = with_gid(ax, "asymptote-optical-0").get_data()
    q = 2.0 * np.pi * near.distances[0]
    error = np.abs(np.interp(near.distances[0], x, y) - near.frequencies[0, :, -1] / 1e3)
    assert error[-1] / error[30] == pytest.approx((q[-1] / q[30]) ** 4, rel=0.05)


def test_the_optical_asymptote_ends_where_its_square_would_be_negative(phonons, bands, ax):
    plot.plot_asymptotes(bands, phonons.lattice, ax, reach=1.0)
    x, y = with_gid(ax, "asymptote-optical-0").get_data()
    real = np.isfinite(y)
    assert_array_equal(real, (2.0 * np.pi * x) ** 2 / 10.0 <= 1.0)
    assert 0 < real.sum() < real.size


def test_asymptotes_take_one_load_and_one_direction(bands, ax):
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(1.0)
    with pytest.raises(InputError, match="several directions"):
        plot.plot_asymptotes(bands, gp.sound_velocities(state, [[1, 0], [0, 1]]), ax)
    many = gp.sound_velocities(gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force([1.0, 2.0]))
    with pytest.raises(InputError, match="several loads"):
        plot.plot_asymptotes(bands, many, ax)


def test_long_waves_of_an_anisotropic_lattice_follow_the_direction(ax):
    phonons = phonons_of("square")
    plot.plot_bands(phonons.bands("MGX", npoints=11), ax, asymptotes=phonons.lattice)
    for s, direction in ((0, (1, 1)), (1, (0, 1))):
        fast, slow = phonons.lattice.sound_velocities(direction)[0]
        rise = [
            np.ptp(with_gid(ax, f"asymptote-{name}-{s}").get_ydata())
            for name in ("longitudinal", "transverse")
        ]
        assert_allclose(rise[0] / rise[1], fast / slow, rtol=1e-12)


# -- the zone --------------------------------------------------------------------------------------


def area(corners):
    x, y = corners.T
    return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))


@pytest.mark.parametrize(
    ("cell", "corners"),
    [
        ([[1.0, 0.0], [-0.5, np.sqrt(0.75)]], 6),
        ([[1.0, 0.0], [0.0, 1.0]], 4),
        ([[1.0, 0.0], [0.0, 3.0]], 4),
        ([[1.0, 0.0], [0.3, 1.2]], 6),
        ([[1.0, 0.0], [7.3, 1.2]], 6),  # the same lattice, by a slanted cell
        ([[1e-3, 0.0], [0.0, 1e-3]], 4),
        ([[0.0, 1.0], [1.0, 0.0]], 4),  # left-handed
    ],
)
def test_the_zone_is_the_wigner_seitz_cell(cell, corners):
    reciprocal = np.linalg.inv(cell).T
    polygon = zone_polygon(reciprocal)
    assert len(polygon) == corners
    # anticlockwise: the area is positive
    assert_allclose(area(polygon), abs(np.linalg.det(reciprocal)), rtol=1e-12)
    steps = np.stack(np.meshgrid(*[np.arange(-9, 10)] * 2), axis=-1).reshape(-1, 2)
    distance = np.linalg.norm(polygon[:, None] - steps @ reciprocal, axis=2)
    # a corner is nearest to the origin, and as near to two others
    own = np.linalg.norm(polygon, axis=1)
    assert np.all(distance >= own[:, None] * (1.0 - 1e-9))
    assert np.all(np.sum(distance <= own[:, None] * (1.0 + 1e-9), axis=1) >= 3)


def test_the_zone_is_drawn_with_the_path(bands, ax):
    assert plot.plot_zone(bands, ax) is ax
    polygon = with_gid(ax, "zone").get_xy()[:-1]
    assert_allclose(area(polygon), 2.0 / np.sqrt(3.0), rtol=1e-12)
    path = np.array(with_gid(ax, "path").get_segments())
    assert_allclose(
        np.linalg.norm(path, axis=2),
        [[0, 2 / 3], [2 / 3, 1 / np.sqrt(3)], [1 / np.sqrt(3), 0]],
        atol=1e-15,
    )
    assert {text.get_text(): tuple(text.xy) for text in ax.texts}.keys() == {"Γ", "K", "M"}


@pytest.mark.parametrize("axis", [0, 1])
def test_the_zone_of_a_ribbon_is_a_line(phonons, ax, tmp_path, axis):
    """Six rows of balls that are cut out of the array, along either of its vectors."""
    balls = gp.atoms(phonons.state).repeat((1, 6, 1) if axis == 0 else (6, 1, 1))
    balls.pbc = np.arange(3) == axis
    along = gp.Phonons(phonons.state, balls).bands(npoints=5)
    assert along.labels == ("G", "X")
    assert along.pbc == (axis == 0, axis == 1)
    # of 1/d, along the ribbon and not across it
    assert_allclose(along.distances[0, [0, -1]], [0.0, 0.5], atol=1e-15)
    plot.plot_zone(along, ax)
    assert_allclose(with_gid(ax, "path").get_segments(), [[[0.0, 0.0], [0.5, 0.0]]], atol=1e-15)
    assert_allclose(with_gid(ax, "zone").get_segments()[0], [[-0.5, 0.0], [0.5, 0.0]], atol=1e-15)
    along.write(tmp_path / "band.yaml")
    assert gp.Bands.read(tmp_path / "band.yaml").pbc == along.pbc
    assert gp.Bands.from_dict(along.to_dict()) == along


def test_a_cluster_has_no_zone(phonons, ax):
    balls = gp.atoms(phonons.state).repeat((2, 2, 1))
    balls.pbc = False
    flat = gp.Phonons(phonons.state, balls).bands([[0, 0], [0.5, 0]], npoints=3)
    with pytest.raises(InputError, match="repeat along no period"):
        plot.plot_zone(flat, ax)
    assert not plot.bands_figure(flat).axes[0].child_axes


def test_wrong_long_waves_are_told(ax, phonons, bands):
    with pytest.raises(InputError, match="3 has no long waves"):
        plot.plot_asymptotes(bands, 3, ax)
    with pytest.raises(InputError, match="reach"):
        plot.plot_asymptotes(bands, phonons.lattice, ax, reach=-1.0)


def test_options_of_another_kind_are_told(ax, phonons, bands):
    dos = phonons.dos((4, 4))
    for words, draw in (
        ("unit is 'kHz'", lambda: plot.plot_bands(bands, ax, unit="kHz")),
        ("unit is 'kHz'", lambda: plot.plot_dos(dos, ax, unit="kHz")),
        ("errors are", lambda: plot.plot_dos(dos, ax, errors=np.ones(dos.total.shape))),
        ("view is", lambda: plot_mode(phonons, (0.3, 0.1), 0, ax, view=(30.0, 20.0))),
        ("direction is", lambda: plot_mode(phonons, (0.3, 0.1), 0, ax, direction=np.eye(2))),
        ("azimuth", lambda: View("30 deg")),
    ):
        with pytest.raises(InputError, match=words):
            draw()


# -- the density of states -------------------------------------------------------------------------


@pytest.mark.parametrize(("friction", "states"), [(True, 3.0), (False, 2.0)])
@pytest.mark.parametrize("horizontal", [True, False])
def test_the_drawn_density_integrates_to_the_branches_of_a_ball(ax, friction, states, horizontal):
    dos = phonons_of(friction=friction).dos((48, 48))
    assert plot.plot_dos(dos, ax, horizontal=horizontal) is ax
    drawn = {line.get_label(): line.get_data()[:: -1 if horizontal else 1] for line in ax.lines}
    frequency, density = drawn["total"]
    assert np.trapezoid(density, frequency) == pytest.approx(states, rel=1e-12)
    assert_allclose(frequency, dos.frequencies / 1e3, rtol=1e-15)
    if friction:
        assert_allclose(drawn["translation"][1] + drawn["rotation"][1], density, rtol=1e-12)
        assert_allclose(drawn["rotation"][1], dos.rotational * 1e3, rtol=1e-15)
    else:
        assert set(drawn) == {"total"}
    labels = {ax.get_ylabel(), ax.get_xlabel()}
    assert labels == {
        "Frequency (kHz)",
        "DOS per ball\n(1/kHz)" if horizontal else "DOS per ball (1/kHz)",
    }
    assert ax.get_ylabel().startswith("Frequency") is horizontal


def test_beside_bands_in_a_column_the_density_is_readable(phonons, bands):
    with matplotlib.rc_context(style.STYLE):
        figure = Figure((3.4, 3.0), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=[2.4, 1.0])
        plot.plot_bands(bands, left)
        plot.plot_dos(phonons.dos((24, 24)), right)
    figure.draw_without_rendering()
    assert (left.get_ylabel(), right.get_ylabel()) == ("Frequency (kHz)", "")
    ticks = [label.get_window_extent() for label in right.get_xticklabels() if label.get_text()]
    assert len(ticks) >= 2
    assert all(one.x1 < next_one.x0 for one, next_one in itertools.pairwise(ticks))
    assert_inside_page(figure)


# -- figures ---------------------------------------------------------------------------------------


def test_bands_and_dos_share_the_frequency_axis(phonons, bands, tmp_path):
    figure = plot.bands_figure(
        bands, phonons.dos((8, 8)), asymptotes=phonons.lattice, title="Steel"
    )
    left, right, bar = figure.axes
    assert left.get_ylim() == right.get_ylim()
    assert left.get_shared_y_axes().joined(left, right)
    assert bar.get_xlabel() == "Rotational part of the kinetic energy"
    (legend,) = figure.legends
    assert [t.get_text() for t in legend.get_texts()] == [
        "translation",
        "rotation",
        "total",
        "long waves",
    ]
    assert figure.get_suptitle() == "Steel"
    figure.savefig(tmp_path / "bands.png", dpi=50)
    # nothing sticks out of the page, and no text is smaller than 7 points
    assert_inside_page(figure)
    assert (
        min(t.get_fontsize() for t in figure.findobj(matplotlib.text.Text) if t.get_text()) >= 7.0
    )


@pytest.mark.parametrize(
    ("balls", "path"),
    [
        ({"friction": False}, "GKMG"),
        pytest.param({"lattice": "square"}, "GXMG", marks=pytest.mark.slow),
        pytest.param({"lattice": "kagome"}, "GKMG", marks=pytest.mark.slow),
        ({"lattice": DIMER}, "GXSYG"),
        ({"cells": 3, "mass": 3.0}, "GKMG"),
    ],
    ids=["frictionless", "square", "kagome", "dimer", "defect"],
)
def test_every_lattice_draws_and_the_zone_covers_no_line(balls, path, tmp_path):
    phonons = phonons_of(**balls)
    bands = phonons.bands(path, npoints=11)
    figure = plot.bands_figure(bands, phonons.dos((4, 4)), asymptotes=phonons.lattice)
    figure.savefig(tmp_path / "bands.png", dpi=50)
    ax = figure.axes[0]
    (inset,) = ax.child_axes
    box = inset.get_window_extent().transformed(ax.transData.inverted())
    pieces = [c.get_segments() for c in ax.collections if isinstance(c, LineCollection)]
    x, y = np.concatenate(pieces)[:, 1].T
    assert not np.any((x > box.x0) & (x < box.x1) & (y > box.y0) & (y < box.y1))
    # a third and less of the axes is empty above the lines
    assert y.max() <= ax.get_ylim()[1] <= 1.4 * y.max()
    assert_allclose(
        area(with_gid(inset, "zone").get_xy()[:-1]),
        1.0 / np.linalg.det(bands.cell[:2, :2]),
        rtol=1e-9,
    )


def test_either_may_be_left_out_and_not_both(phonons, bands):
    assert len(plot.bands_figure(bands).axes) == 2  # with the colour bar
    (ax,) = plot.bands_figure(dos=phonons.dos((12, 12))).axes
    assert ax.get_xlabel() == "Frequency (kHz)"
    with pytest.raises(InputError, match="nothing to draw"):
        plot.bands_figure()


def test_global_state_is_left_alone(bands):
    before = dict(matplotlib.rcParams)
    plot.bands_figure(bands)
    sweep_figure(
        gp.sweep(gp.Packing(STEEL, 8e-3, gp.Uniform(1e-6)), force=[1.0, 2.0], media=("afa",))
    ).canvas.draw()
    assert dict(matplotlib.rcParams) == before


MADE = """
import sys
import numpy as np, granphon as gp
from granphon.figures.{module} import *
from granphon.figures.bands import bands_figure
from granphon.figures.style import save_figure
state = gp.AveragedLattice(gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)).at_force(18.446)
save_figure(bands_figure(gp.Phonons(state).bands("GKM", npoints=5)), sys.argv[1])
print("matplotlib.pyplot" in sys.modules)
import matplotlib
print(dict.__getitem__(matplotlib.rcParams, "backend"))
"""


@pytest.mark.parametrize(
    ("module", "backend", "kept"),
    [
        pytest.param("bands", "nonsense", None, marks=pytest.mark.exhaustive),
        ("curves", "module://there.is.none", None),
        pytest.param("work_precision", "", None, marks=pytest.mark.exhaustive),
        pytest.param("bands", "svg", "svg", marks=pytest.mark.exhaustive),
    ],
)
def test_a_figure_is_saved_without_pyplot_whatever_backend_the_environment_names(
    tmp_path, module, backend, kept
):
    run = subprocess.run(
        [
            sys.executable,
            "-W",
            "error",
            "-c",
            MADE.format(module=module),
            str(tmp_path / "bands.png"),
        ],
        env={**os.environ, "MPLBACKEND": backend},
        capture_output=True,
        text=True,
    )
    assert run.stderr == ""
    pyplot, found = run.stdout.splitlines()
    assert pyplot == "False"
    assert found == kept or kept is None
    assert (tmp_path / "bands.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("label", "settings", "name", "told"),
    [
        (r"$\Gama$", {}, "bands.png", r"Unknown symbol: \\Gama"),
        ("x", {"text.usetex": True}, "bands.png", "latex"),
        ("x", {}, "bands.xyz", "xyz"),
    ],
)
def test_what_cannot_be_drawn_is_one_error_and_leaves_no_file(
    tmp_path, monkeypatch, label, settings, name, told
):
    monkeypatch.setenv("PATH", str(tmp_path))  # without LaTeX
    with matplotlib.rc_context(settings):
        figure = Figure(layout="constrained")
        figure.subplots().set_xlabel(label)
        with pytest.raises(FigureError, match=f"^{name} .*{told}") as caught:
            style.save_figure(figure, tmp_path / name)
    assert isinstance(caught.value, gp.GranphonError)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("options", [{}, {"backend": "nonsense"}])
def test_what_may_be_mended_is_the_backend_if_one_was_asked_for(tmp_path, options):
    figure = Figure()
    figure.subplots().set_xlabel("x" if options else r"$\Gama$")
    with pytest.raises(FigureError) as caught:
        style.save_figure(figure, tmp_path / "bands.png", **options)
    assert ("--backend" in str(caught.value)) == bool(options)
    assert "the labels" in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_what_the_file_system_refuses_is_its_own_error(ax, tmp_path):
    (tmp_path / "none").write_text("a file in the place of the folder")
    with pytest.raises(OSError, match="none"):
        style.save_figure(ax.get_figure(), tmp_path / "none" / "bands.png")


@pytest.mark.parametrize("suffix", ["png", "pdf", "svg", "xyz"])
def test_what_cannot_be_drawn_leaves_the_file_that_was_there(tmp_path, suffix):
    path = tmp_path / f"bands.{suffix}"
    path.write_text("of yesterday", encoding="utf-8")
    figure = Figure()
    figure.text(0.0, 0.0, r"$\Gama$")
    with pytest.raises(FigureError):
        style.save_figure(figure, path)
    assert path.read_text(encoding="utf-8") == "of yesterday"
    assert list(tmp_path.iterdir()) == [path]


def test_a_picture_has_the_suffix_of_matplotlib_if_it_has_none(tmp_path):
    style.save_figure(Figure(), tmp_path / "bands")
    style.save_figure(Figure(), tmp_path / "raw", format="svg")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bands.png", "raw"]
    (tmp_path / "folder.png").mkdir()
    for path in (None, 3, "", tmp_path / "folder.png"):
        with pytest.raises(gp.GranphonError):
            style.save_figure(Figure(), path)


# -- modes -----------------------------------------------------------------------------------------


def drawn_mode(ax):
    (arrows,) = (c for c in ax.collections if isinstance(c, Quiver))
    spins = next((c for c in ax.collections if c.get_gid() == "spins"), None)
    arcs = None if spins is None else np.array(spins.get_segments()) - np.array(arrows.XY)[:, None]
    return np.array(arrows.XY), np.stack([arrows.U, arrows.V], axis=1), arcs


def turned(arcs):
    """The angle of each arc, its sign by the sense."""
    angle = np.unwrap(np.arctan2(arcs[..., 1], arcs[..., 0]), axis=1)
    return angle[:, -1] - angle[:, 0]


@pytest.mark.parametrize("phase", [0.0, 0.7])
@pytest.mark.parametrize("branch", [0, 1, 2])
def test_a_mode_is_the_real_part_of_its_wave(phonons, ax, branch, phase):
    q = (0.21, 0.13)
    assert plot_mode(phonons, q, branch, ax, cells=(3, 4), phase=phase) is ax
    places, arrows, arcs = drawn_mode(ax)
    assert len(places) == 12
    modes = phonons.modes([q])
    e = modes.eigenvectors[0, :, branch]
    e = e * np.exp(-1j * np.angle(e[np.argmax(np.abs(e))]))
    wave = (e[:, None] * np.exp(1j * (modes.wavevectors[0] * 8e-3 @ places.T + phase))).real
    drawn = np.vstack([arrows.T, turned(arcs) * np.sqrt(0.1)])  # w = R_g phi
    scale = np.sum(drawn * wave) / np.sum(wave**2)
    assert scale > 0.0
    assert_allclose(drawn, scale * wave, atol=1e-12)
    # the largest in a period is 0.4 d
    period = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 2001))[:, None]
    u = (e[:2] * period).real
    w = np.abs(e[2])
    assert scale * max(np.linalg.norm(u, axis=1).max(), w) == pytest.approx(0.4, rel=1e-5)


def test_the_top_mode_at_m_turns_neighbours_against_each_other(phonons, ax):
    plot_mode(phonons, (0.5, 0.0), 2, ax)
    places, arrows, arcs = drawn_mode(ax)
    angle = turned(arcs)
    assert_allclose(arrows, 0.0, atol=1e-12)
    assert_allclose(np.abs(angle), 0.4 / np.sqrt(0.1), rtol=1e-9)
    assert_array_equal(np.sign(angle).reshape(4, 4), np.array([1, -1, 1, -1])[:, None] * np.ones(4))
    spins = with_gid(ax, "spins")
    assert_allclose(spins.get_color(), [to_rgba("#D55E00" if a > 0 else "#0072B2") for a in angle])
    assert ax.get_title() == "q = (1/2, 0)\n38.0 kHz, rotation 100 %"
    assert_allclose(places[4] - places[0], [1.0, 0.0], atol=1e-15)


def test_balls_have_their_real_size(phonons, ax):
    plot_mode(phonons, (1 / 3, 1 / 3), 0, ax, cells=(2, 2))
    balls = [path.get_extents() for path in with_gid(ax, "balls").get_paths()]
    assert_allclose([(b.width, b.height) for b in balls], 1.0, rtol=1e-3)
    # touching balls touch, and all are inside the axes
    assert ax.get_xlim()[0] < min(b.x0 for b in balls)
    assert ax.get_ylim()[1] > max(b.y1 for b in balls)
    assert ax.get_aspect() == 1.0


def test_a_heavy_ball_moves_less_than_its_momentum(ax):
    phonons = phonons_of(cells=3, mass=9.0)
    plot_mode(phonons, (0.0, 0.0), 0, ax, cells=(1, 1), direction=(1, 0))
    _, arrows, _ = drawn_mode(ax)
    # the lowest mode at Gamma is a translation of all balls alike, whatever they weigh
    assert_allclose(arrows - arrows[0], 0.0, atol=1e-7)
    assert np.linalg.norm(arrows[0]) == pytest.approx(0.4, rel=1e-6)


def test_a_mode_without_friction_has_no_spin(ax):
    plot_mode(phonons_of(friction=False), (0.5, 0.0), 1, ax)
    _, arrows, arcs = drawn_mode(ax)
    assert arcs is None
    assert_allclose(np.linalg.norm(arrows, axis=1), 0.4, rtol=1e-12)
    assert "rotation" not in ax.get_title()


def test_a_mode_of_no_frequency_is_said_to_have_none(phonons, ax):
    for branch in (0, 1):
        plot_mode(phonons, (0.0, 0.0), branch, ax, direction=(1, 0))
        assert ax.get_title() == "q = (0, 0)\nzero frequency, rotation 0 %"
    plot_mode(phonons, (1e-9, 0.0), 0, ax)  # slow, and known to rounding
    assert ax.get_title().startswith("q = (1e-09, 0)\n")
    assert "Hz" in ax.get_title()


def test_a_q_that_is_no_simple_fraction_is_written_in_decimals(phonons, ax):
    plot_mode(phonons, (0.21, 1 / 3), 1, ax, cells=(1, 1))
    assert ax.get_title().startswith("q = (0.21, 1/3)\n")


@pytest.mark.parametrize("branch", [-1, 3])
def test_a_branch_that_is_not_there(phonons, ax, branch):
    with pytest.raises(InputError, match="Count from 0 to 2"):
        plot_mode(phonons, (0.5, 0.0), branch, ax)


def test_gamma_needs_a_direction(phonons, ax):
    with pytest.raises(InputError, match="direction"):
        plot_mode(phonons, (0.0, 0.0), 0, ax)


# -- the tables of pictures ------------------------------------------------------------------------


@pytest.mark.parametrize("place", PICTURES)
def test_a_default_picture_is_of_a_public_class_and_its_function_takes_the_result(place):
    module, _, name = place.rpartition(".")
    kind = getattr(import_module(f"granphon.{module}"), name)
    assert getattr(gp, name) is kind
    picture = PICTURES[place]
    assert picture.keyword in signature(picture.load()).parameters


@pytest.mark.parametrize("name", OF_DATASETS)
def test_a_picture_of_a_data_set_is_the_figure_of_an_output(name):
    assert OUTPUTS[name].figure == f"{name}.png"
    assert next(iter(signature(OF_DATASETS[name].load()).parameters)) == "dataset"


def test_a_class_of_a_user_with_the_name_of_a_result_is_no_such_result():
    class Bands:
        """Not those of granphon."""

    with pytest.raises(InputError, match="no default picture"):
        gp.plot(Bands())
