"""Figures of crystals on a line, in a plane and in space: what is drawn is what was computed."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.base.errors import InputError, MechanismError
from granphon.figures import slowness
from granphon.figures.bands import bands_figure, plot_asymptotes, plot_bands, plot_dos, plot_zone
from granphon.figures.curves import sweep_figure
from granphon.figures.modes import animate_mode, plot_mode
from granphon.figures.views import Painter, View
from granphon.phonons.paths import zone_faces
from tests.figures.conftest import with_gid

STEEL = gp.Material(211.65e9, 0.276, 7840.0)


def state_of(lattice, **options):
    return gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice=lattice, **options)).at_force(18.446)


@pytest.fixture(scope="module")
def fcc():
    return gp.Phonons(state_of("fcc"))


@pytest.fixture(scope="module")
def chain():
    return gp.Phonons(state_of("chain", motions="all", torsion=0.02, bending=0.01))


# -- projection ------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", [View(), View(0.0, 0.0), View(33.0, 71.0), View(-120.0, -15.0)])
def test_a_view_is_a_rotation_that_keeps_z_upright(view):
    assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(view.axes) == pytest.approx(1.0)
    right, up = view.project([0.0, 0.0, 1.0])
    assert right == pytest.approx(0.0, abs=1e-15)
    assert up > 0.0


def test_the_viewer_stands_at_the_azimuth_and_the_elevation():
    # from x: y to the right, z upwards; from above: x would point down
    assert_allclose(View(0.0, 0.0).axes, [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-15)
    assert View(0.0, 90.0).nearness([0.0, 0.0, 2.0]) == pytest.approx(2.0)


def test_what_is_nearer_is_drawn_later(ax):
    painter = Painter(View(0.0, 0.0))
    for x, colour in ((3.0, "red"), (1.0, "green"), (2.0, "blue")):
        painter.add_line(np.array([[x, 0.0, 0.0], [x, 1.0, 0.0]]), colour, 1.0)
    drawn = painter.draw(ax, "lines")
    assert_array_equal(drawn.get_edgecolor()[:, :3], [[0.0, 128 / 255, 0.0], [0, 0, 1], [1, 0, 0]])
    painter.draw(ax, "faded", fade=0.5)
    assert_allclose(
        with_gid(ax, "faded").get_edgecolor()[:, :3],
        [[0.5, 0.5 + 64 / 255, 0.5], [0.25, 0.25, 1], [1, 0, 0]],
    )


# -- the zone in space -----------------------------------------------------------------------------


def volume(faces):
    """Volume of the body with these faces, anticlockwise as seen from outside: sum of tetrahedra
    from the origin.
    """
    return sum(
        np.linalg.det([face[0], b, c]) / 6.0
        for face in faces
        for b, c in itertools.pairwise(face[1:])
    )


@pytest.mark.parametrize(
    ("cell", "corners"),
    [
        (LATTICES["sc"].cell, [4] * 6),
        (LATTICES["bcc"].cell, [4] * 12),  # a rhombic dodecahedron
        (LATTICES["fcc"].cell, [4] * 6 + [6] * 8),  # a truncated octahedron
        (LATTICES["hcp"].cell, [4] * 6 + [6] * 2),  # a prism
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 3.0]], [4] * 6),
        ([[1.0, 0.0, 0.0], [2.3, 1.2, 0.0], [-1.1, 1.3, 0.9]], None),  # slanted
        (1e-3 * np.array(LATTICES["fcc"].cell)[::-1], [4] * 6 + [6] * 8),  # small, and left-handed
    ],
)
def test_the_zone_in_space_is_the_wigner_seitz_cell(cell, corners):
    reciprocal = np.linalg.inv(cell).T
    faces = zone_faces(reciprocal)
    if corners is not None:
        assert sorted(map(len, faces)) == corners
    assert volume(faces) == pytest.approx(abs(np.linalg.det(reciprocal)), rel=1e-9)
    points = np.concatenate(faces)
    steps = np.stack(np.meshgrid(*[np.arange(-9, 10)] * 3), axis=-1).reshape(-1, 3)
    distance = np.linalg.norm(points[:, None] - steps @ reciprocal, axis=2)
    # a corner is nearest to the origin, and as near to three others
    own = np.linalg.norm(points, axis=1)
    assert np.all(distance >= own[:, None] * (1.0 - 1e-9))
    assert np.all(np.sum(distance <= own[:, None] * (1.0 + 1e-6), axis=1) >= 4)


def test_the_zone_in_space_is_drawn_with_the_path(fcc, ax):
    bands = fcc.bands("GXWKGL", npoints=3)
    view = View(40.0, 20.0)
    assert plot_zone(bands, ax, view=view) is ax
    path = np.array(with_gid(ax, "path").get_segments())
    corners = (
        np.array([fcc.special_points[name] for name in "GXWKGL"])
        @ fcc.lattice.reciprocal
        / (2.0 * np.pi)
    )
    assert_allclose(
        path, np.stack([view.project(corners[:-1]), view.project(corners[1:])], axis=1), atol=1e-12
    )
    assert {text.get_text(): tuple(text.xy) for text in ax.texts}.keys() == {
        "Γ",
        "X",
        "W",
        "K",
        "L",
    }
    assert len(with_gid(ax, "zone").get_paths()) == 14


@pytest.mark.parametrize(
    ("lattice", "path"),
    [
        ("sc", "GXMGRX,MR"),
        ("bcc", "GHNGPH,PN"),
        ("fcc", "GXWKGL"),
        pytest.param("hcp", "GMKGALHA", marks=pytest.mark.slow),
    ],
)
def test_the_corners_of_a_path_lie_apart_in_the_drawing_of_the_zone(lattice, path, ax):
    bands = gp.Phonons(state_of(lattice)).bands(path, npoints=2)
    plot_zone(bands, ax)
    places = np.array([text.xy for text in ax.texts])
    width = np.ptp(with_gid(ax, "zone").get_paths()[0].vertices, axis=0).max()
    distance = np.linalg.norm(places[:, None] - places, axis=2) + 9.0 * np.eye(len(places))
    assert distance.min() > 0.1 * width


def test_the_zone_of_a_chain_is_a_line(chain, ax):
    plot_zone(chain.bands(npoints=3), ax)
    (outline, *_) = with_gid(ax, "zone").get_segments()
    assert_allclose(outline, [[-0.5, 0.0], [0.5, 0.0]], atol=1e-15)
    assert_allclose(with_gid(ax, "path").get_segments(), [[[0.0, 0.0], [0.5, 0.0]]], atol=1e-15)
    assert ax.texts[0].get_text() == "Γ"


# -- bands -----------------------------------------------------------------------------------------


def test_a_wrong_view_is_refused_also_where_it_has_no_effect(chain, ax):
    bands = chain.bands(npoints=3)
    with pytest.raises(InputError, match="view"):
        plot_zone(bands, ax, view="above")
    plot_zone(bands, ax, view=View())


@pytest.mark.slow
def test_bands_in_space_have_the_zone_in_a_panel_and_draw(fcc, tmp_path):
    figure = bands_figure(
        fcc.bands("GXWKGL", npoints=5), fcc.dos((3, 3, 3)), asymptotes=fcc.lattice
    )
    figure.savefig(tmp_path / "bands.png", dpi=50)
    assert [ax for ax in figure.axes if any(a.get_gid() == "zone" for a in ax.get_children())]
    assert not figure.axes[0].child_axes


def test_gaps_are_shaded_between_the_branches(ax):
    light, heavy = (gp.Ball(STEEL, 8e-3, mass=mass) for mass in (1e-3, 4e-3))
    phonons = gp.Phonons(gp.Crystal.on("chain", [light, heavy]).at_force(10.0))
    (gap,) = phonons.gaps()
    plot_bands(phonons.bands(npoints=5), ax, gaps=phonons.gaps(), colorbar=False)
    box = with_gid(ax, "gap-0").get_extents().transformed(ax.transData.inverted())
    assert_allclose([box.y0, box.y1], gap / 1e3, rtol=1e-9)
    with pytest.raises(InputError, match="gaps"):
        plot_bands(phonons.bands(npoints=5), ax, gaps=[1.0, 2.0, 3.0])


def test_names_at_a_jump_stand_one_above_the_other_where_corners_are_close(ax):
    bands = gp.Phonons(state_of("hcp")).bands("GMKGALHA,LM,KH", npoints=3)
    plot_bands(bands, ax)
    assert [text.get_text() for text in ax.get_xticklabels()] == [*"ΓMKΓALH", "A\nL", "M\nK", "H"]


def test_long_waves_in_space_are_three_lines_with_the_velocities_of_their_direction(fcc, ax):
    bands = fcc.bands("GX", npoints=5)
    plot_asymptotes(bands, fcc.lattice, ax)
    speeds = gp.sound_velocities(
        fcc.state, fcc.lattice.wavevectors(bands.qpoints[0, -1])
    ).velocities
    slopes = []
    for line in ax.lines:
        x, y = line.get_data()
        # x is q over 2 pi, in 1/d; y is in kHz
        slopes.append(1e3 * (y[-1] - y[0]) / (x[-1] - x[0]) * fcc.scales.length)
    assert_allclose(np.sort(slopes), speeds, rtol=1e-9)
    with pytest.raises(InputError, match="one direction"):
        plot_asymptotes(bands, gp.sound_velocities(fcc.state, (1, 0, 0)), ax)


def test_flexural_waves_have_no_long_waves_to_draw(chain, ax):
    plot_asymptotes(chain.bands(npoints=5), chain.lattice, ax)
    assert len(ax.lines) == 1  # the longitudinal one


def test_peaks_of_flat_branches_leave_the_rest_to_be_seen(ax):
    # 3 of 6 branches of the honeycomb out of its plane are zero everywhere, and one is flat; 2 lie
    # from 29.4 to 32.9 kHz
    dos = gp.Phonons(state_of("honeycomb", motions="out_of_plane")).dos((24, 24))
    plot_dos(dos, ax)
    peak = 1e3 * dos.total.max()  # 1/kHz
    between = 1e3 * np.max(dos.total[(dos.frequencies > 29.6e3) & (dos.frequencies < 32.5e3)])
    assert between < ax.get_xlim()[1] < 0.1 * peak
    assert ax.get_xlabel() == f"DOS per ball\n(1/kHz)\npeaks to {peak:.2g}"
    # peaks of van Hove are drawn whole
    whole = Figure().subplots()
    row = gp.Phonons(state_of("chain")).dos((128,))
    plot_dos(row, whole)
    assert whole.get_xlim()[1] == pytest.approx(1.05e3 * row.total.max())
    assert "peaks" not in whole.get_xlabel()


# -- slowness --------------------------------------------------------------------------------------


def drawn_waves(ax):
    lines = [artist for artist in ax.get_children() if str(artist.get_gid()).startswith("wave")]
    return [np.concatenate(line.get_segments()) for line in lines], lines


def test_slowness_in_the_plane_is_the_inverse_of_the_velocity(ax):
    state = state_of("square")
    assert slowness.plot_slowness(state, ax) is ax
    curves, lines = drawn_waves(ax)
    assert len(curves) == 2
    for points, line in zip(curves, lines, strict=True):
        radius = np.linalg.norm(points, axis=1)
        velocities = gp.sound_velocities(state, points[::7] / radius[::7, None]).velocities
        assert_allclose(
            np.abs(velocities * radius[::7, None] / 1e3 - 1.0).min(axis=1), 0.0, atol=1e-9
        )
        assert line.norm.vmax == 1.0
    # the fast wave is longitudinal
    fast = int(np.argmin([np.linalg.norm(points, axis=1).mean() for points in curves]))
    assert lines[fast].get_array().min() > 0.9
    assert "s/km" in ax.get_xlabel()
    assert "s/km" in ax.get_ylabel()


def test_the_cut_through_a_crystal_is_that_of_its_closed_form(ax):
    state = state_of("fcc", friction=False)
    slowness.plot_slowness(state, ax, plane=((1, 1, 0), (0, 0, 1)))
    curves, lines = drawn_waves(ax)
    assert ax.get_xlabel() == "Slowness, x+y (s/km)"
    # without friction C11 = 2 C44 and C12 = C44; the wave across the cut has rho v^2 = C44 (cos^2/2
    # + sin^2)
    c44 = gp.sound_velocities(state, (1, 0, 0)).transverse[0] ** 2
    dashed = next(
        points for points, line in zip(curves, lines, strict=True) if len(line.get_segments()) < 360
    )
    radius = np.linalg.norm(dashed, axis=1)
    x, z = (dashed / radius[:, None]).T
    assert_allclose((1e3 / radius) ** 2, c44 * (0.5 * x**2 + z**2), rtol=1e-9)


def test_flexural_waves_are_left_out(ax):
    bent = state_of("triangular", motions="all", bending=0.01)
    slowness.plot_slowness(bent, ax)
    curves, _ = drawn_waves(ax)
    plain = gp.sound_velocities(state_of("triangular"))
    radii = sorted(float(np.linalg.norm(points, axis=1).mean()) for points in curves)
    assert_allclose(radii, [1e3 / plain.longitudinal, 1e3 / plain.transverse], rtol=1e-6)


@pytest.mark.parametrize(
    ("lattice", "panels"), [("square", 1), pytest.param("hcp", 2, marks=pytest.mark.slow)]
)
def test_a_slowness_figure_draws(tmp_path, lattice, panels):
    figure = slowness.slowness_figure(state_of(lattice), title=lattice)
    assert sum("s/km" in ax.get_xlabel() for ax in figure.axes) == panels
    figure.savefig(tmp_path / "slowness.png", dpi=50)


def test_a_slowness_figure_of_a_network_in_space_has_two_panels():
    figure = slowness.slowness_figure(state_of("fcc").network)
    assert sum("s/km" in ax.get_xlabel() for ax in figure.axes) == 2


def test_surfaces_are_as_far_from_the_middle_as_the_slowness(ax):
    state = state_of("fcc", friction=False)
    view = View(0.0, 0.0)
    slowness.plot_slowness_surface(state, ax, view=view, colorbar=False)
    # seen along x the outline is the slowest wave at right angles to the sight: along y + z, 1/v of
    # the wave across
    points = np.concatenate([path.vertices for path in with_gid(ax, "surfaces").get_paths()[:-20]])
    along = points @ np.array([1.0, 1.0]) / np.sqrt(2.0)
    slowest = 1e3 / gp.sound_velocities(state, (0, 1, 1)).velocities[0]
    near = np.abs(points @ np.array([1.0, -1.0])) < 0.05 * slowest
    assert along[near].max() == pytest.approx(slowest, rel=5e-3)


@pytest.mark.parametrize(
    ("direction", "name"),
    [
        ((1, 0, 0), "x"),
        ((0, -1, 0), "−y"),
        ((1, 1, 0), "x+y"),
        ((1, -2, 0), "x−2y"),
        ((0.1, 0.0, 0.57), "0.17x+0.98z"),
    ],
)
def test_names_of_directions(direction, name, ax):
    slowness.plot_slowness(
        state_of("fcc", friction=False), ax, plane=(direction, (0.3, 0.2, 0.9)), colorbar=False
    )
    assert ax.get_xlabel() == f"Slowness, {name} (s/km)"


@pytest.mark.parametrize(
    ("state", "plane", "error", "words"),
    [
        (state_of("chain"), None, InputError, "one period"),
        (state_of("square"), ((1, 0, 0), (0, 1, 0)), InputError, "no other cut"),
        (state_of("fcc"), ((1, 0, 0), (2, 0, 0)), InputError, "parallel"),
        (state_of("fcc"), ((1, 0), (0, 1)), InputError, "plane"),
        (state_of("fcc"), 3.0, InputError, "plane is 3"),
        (state_of("fcc"), ((1, 0, 0), (0, 1)), InputError, "plane: found"),
        (state_of("fcc"), ((1, 0, 0), (0, 0, 0)), InputError, "plane is"),
        (state_of("sc", friction=False), None, MechanismError, "mechanism"),
        (
            state_of("triangular", motions="out_of_plane", bending=0.01),
            None,
            InputError,
            "flexural",
        ),
        (
            gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="fcc")).at_force([1.0, 2.0]),
            None,
            InputError,
            "several loads",
        ),
    ],
)
def test_what_has_no_slowness_curve_is_refused(state, plane, error, words, ax):
    with pytest.raises(error, match=words):
        slowness.plot_slowness(state, ax, plane=plane)


def test_surfaces_are_those_of_a_crystal_in_space(ax):
    with pytest.raises(InputError, match="2 periods"):
        slowness.plot_slowness_surface(state_of("square"), ax)


# -- modes -----------------------------------------------------------------------------------------


def colours_drawn(ax):
    return with_gid(ax, "spheres").get_facecolor()


def moved(phonons, q, branch, **options):
    """What plot_mode has drawn: places, displacements and angles of the balls."""
    from granphon.figures import modes

    return modes._find_motion(phonons, q, branch, options.get("cells"), options.get("direction"))


def test_a_mode_in_space_solves_the_equation_of_motion(fcc):
    # the contacts of the drawn balls deform as C(q) says: w^2 M u is the force on a ball inside the
    # drawing
    q = (0.21, 0.13, -0.3)
    branch = 2
    motion = moved(fcc, q, branch, cells=(3, 3, 3))
    u = motion.shift
    phi = motion.turn
    eta = STEEL.mindlin_ratio
    middle = 13
    force = np.zeros(3, complex)
    torque = np.zeros(3, complex)
    partners = [(i, j) for i, j in motion.pairs if middle in (i, j)]
    assert len(partners) == 12
    for i, j in partners:
        other = j if i == middle else i
        n = motion.places[other] - motion.places[middle]
        gap = u[other] - u[middle]
        slip = gap - (n @ gap) * n - 0.5 * np.cross(phi[middle] + phi[other], n)
        force += (n @ gap) * n + eta * slip
        torque += 0.5 * eta * np.cross(n, slip)
    squared = (fcc.frequencies([q])[0, branch] / fcc.scales.frequency) ** 2
    assert_allclose(force, -squared * u[middle], atol=1e-9)
    assert_allclose(torque, -squared * phi[middle] / 10.0, atol=1e-9)


def test_the_largest_motion_has_the_length_of_the_scale(fcc):
    motion = moved(fcc, (0.1, 0.2, 0.3), 0)
    phase = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 721))[:, None, None]
    longest = np.linalg.norm((motion.shift * phase).real, axis=2).max()
    turned = np.linalg.norm((motion.turn * phase).real, axis=2).max() / np.sqrt(10.0)
    assert max(longest, turned) == pytest.approx(0.4, rel=1e-4)


def test_balls_in_contact_are_joined_and_no_others(fcc):
    motion = moved(fcc, (0.5, 0.0, 0.5), 0)
    i, j = motion.pairs.T
    assert_allclose(np.linalg.norm(motion.places[i] - motion.places[j], axis=1), 1.0, rtol=1e-12)
    distance = np.linalg.norm(motion.places[:, None] - motion.places, axis=2)
    assert len(motion.pairs) == np.sum(np.abs(distance - 1.0) < 1e-9) // 2


def test_spheres_have_an_arrow_for_displacement_and_one_for_rotation(fcc, ax):
    assert plot_mode(fcc, (0.5, 0.0, 0.5), 0, ax, cells=(2, 2, 2)) is ax
    assert ax.get_title() == "q = (1/2, 0, 1/2)\n38.0 kHz, rotation 100 %"
    spins = np.sum(colours_drawn(ax)[:, 0] > colours_drawn(ax)[:, 2] + 0.2)
    assert spins == 16  # for each of the eight balls the arrow, and the head of the arc
    plain = Figure().subplots()
    plot_mode(fcc, (0.5, 0.0, 0.5), 3, plain, cells=(2, 2, 2))
    assert not np.any(colours_drawn(plain)[:, 0] > colours_drawn(plain)[:, 2] + 0.2)
    assert ax.get_aspect() == 1.0


def test_a_chain_that_bends_is_drawn_in_space_and_one_along_itself_is_not(chain, ax):
    plot_mode(chain, (0.125,), 0, ax)
    assert with_gid(ax, "spheres")
    along = Figure().subplots()
    plot_mode(gp.Phonons(state_of("chain")), (0.5,), 0, along)
    assert len(with_gid(along, "balls").get_paths()) == 8
    arrows = with_gid(along, "displacements")
    assert_allclose(arrows.U, 0.4 * np.resize([1.0, -1.0], 8), atol=1e-12)
    assert_allclose(arrows.V, 0.0, atol=1e-12)


def test_wrong_numbers_of_cells_and_sizes_are_refused(fcc, ax):
    for cells in ((2, 2), 2, (2, 2, 0), (2, 2, 1.5)):
        with pytest.raises(InputError, match="three whole numbers"):
            plot_mode(fcc, (0.5, 0.0, 0.5), 0, ax, cells=cells)
    for branch in (-1, 6, 1.5, "1"):
        with pytest.raises(InputError, match="no branch"):
            plot_mode(fcc, (0.5, 0.0, 0.5), branch, ax)
    with pytest.raises(InputError, match="size"):
        plot_mode(fcc, (0.5, 0.0, 0.5), 0, ax, size=0.0)
    with pytest.raises(InputError, match="frames"):
        animate_mode(fcc, (0.5, 0.0, 0.5), 0, frames=1)


@pytest.mark.parametrize("lattice", ["fcc", pytest.param("triangular", marks=pytest.mark.slow)])
def test_an_animation_comes_back_after_a_period(lattice, tmp_path):
    phonons = gp.Phonons(state_of(lattice))
    q = (0.5, 0.0, 0.5)[: phonons.lattice.periods]
    animation = animate_mode(phonons, q, 1, cells=(2, 2, 1)[: phonons.lattice.periods], frames=4)
    animation.save(tmp_path / "mode.gif", writer="pillow", dpi=40)
    from PIL import Image

    with Image.open(tmp_path / "mode.gif") as image:
        assert image.n_frames == 4


# -- sweeps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lattice", "more", "forces", "names"),
    [
        pytest.param(
            "bcc", {}, [1.0, 100.0], ["$v_{T1}$, $v_{T2}$", "$v_L$"], marks=pytest.mark.slow
        ),  # as fast along [100]
        pytest.param(
            "hcp",
            {"friction": False},
            [10.0, 12.0],
            ["$v_{T1}$", "$v_{T2}$", "$v_L$"],
            marks=pytest.mark.slow,
        ),
        # close on this scale
        pytest.param(
            "hcp",
            {"friction": False},
            [1.0, 100.0],
            ["$v_{T1}$, $v_{T2}$", "$v_L$"],
            marks=pytest.mark.slow,
        ),
        ("chain", {"motions": "all"}, [1.0, 100.0], ["$v_L$"]),  # bending waves have no velocity
    ],
)
def test_velocities_of_a_sweep_are_named_beside_the_axes_and_apart(lattice, more, forces, names):
    figure = sweep_figure(gp.sweep(gp.Packing(STEEL, 8e-3, lattice=lattice, **more), force=forces))
    upper = figure.axes[0]
    assert [text.get_text() for text in upper.texts] == names
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in upper.texts]
    frame = upper.get_window_extent()
    assert all(frame.x1 < box.x0 and box.x1 <= figure.bbox.x1 for box in boxes)
    assert all(lower.y1 <= higher.y0 for lower, higher in itertools.pairwise(boxes))


def test_slowness_and_modes_of_a_network_are_those_of_its_state(ax):
    state = state_of("square")
    slowness.plot_slowness(state, ax)
    own = [collection.get_segments() for collection in ax.collections]
    ax.clear()
    slowness.plot_slowness(state.network, ax)
    for one, other in zip(
        own, [collection.get_segments() for collection in ax.collections], strict=True
    ):
        assert_allclose(np.concatenate(other), np.concatenate(one), rtol=1e-12, atol=1e-12)
    ax.clear()
    plot_mode(gp.Phonons(state.network.repeat((2, 1))), (0.25, 0.0), 1, ax, cells=(2, 2))
    assert "kHz" in ax.get_title()


def test_a_flat_band_of_a_ribbon_has_no_colour_of_an_edge_and_zero_branches_are_thin(ax):
    """Out of its plane a zigzag ribbon has a flat band, whose modes may be summed to be anywhere,
    and motions that deform no contact.
    """
    packing = gp.Packing(STEEL, 8e-3, lattice="honeycomb", motions="out_of_plane")
    ribbon = gp.AveragedLattice(packing).at_force(18.446).network.cut(axis=1, layers=6)
    bands = gp.Phonons(ribbon).bands(npoints=5)
    plot_bands(bands, ax, edges=True)
    top = bands.frequencies.max()
    inside = np.array(to_rgb("0.75"))
    n_zero = n_flat = 0
    # of more than 30 branches the lines are thinner, and those of zero branches still the thinnest
    width = 1.5 * 30.0 / bands.n_branches
    for b in range(bands.n_branches):
        line = with_gid(ax, f"band-0-{b}")
        frequencies = bands.frequencies[0, :, b]
        if np.all(frequencies < 1e-6 * top):
            n_zero += 1
            assert np.all(np.array(line.get_linewidths()) < 0.6 * width)
        elif np.ptp(frequencies) < 1e-6 * top:
            n_flat += 1
        else:
            assert np.all(np.array(line.get_linewidths()) >= 0.999 * width)
            continue
        assert_allclose(line.get_edgecolors()[:, :3], np.tile(inside, (5, 1)), atol=0.1)
    assert n_zero > 2
    assert n_flat > 2
    # the weights themselves are those of sums that are most at one edge
    assert bands.edge_weight.max() > 0.99


def test_complex_bands_leave_room_at_the_border():
    light = gp.Ball(STEEL, 8e-3, mass=0.5 * gp.Ball(STEEL, 8e-3).mass, name="light")
    network = (
        gp.Crystal.on("chain", [gp.Ball(STEEL, 8e-3, name="heavy"), light]).at_force(20.0).network
    )
    frequencies = np.linspace(0.0, 50e3, 30)
    bands = gp.Phonons(network).complex_bands(frequencies[1:], axis=0)
    left, right = gp.plot(bands).axes
    for ax in (left, right):
        (low, high), (bottom, top) = ax.get_xlim(), ax.get_ylim()
        for line in ax.lines:
            x, y = line.get_xydata().T
            assert np.all((x > low) & (x < high))
            assert np.all((y > bottom) & (y < top))
    reached = np.concatenate([line.get_xdata() for line in left.lines])
    assert np.max(np.abs(reached)) == pytest.approx(1.0)
