"""Figures of contact forces: lines, balls and densities are read back."""

from __future__ import annotations

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.lattices import TRIANGULAR
from granphon.base.errors import InputError
from granphon.figures.forces import (
    _BallValues,
    forces_figure,
    plot_directions,
    plot_force_distribution,
    plot_forces,
)
from granphon.figures.modes import plot_participation
from granphon.figures.rigidity import plot_rigidity
from tests import packings
from tests.figures.conftest import assert_inside_page, with_gid
from tests.networks import written

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
PACKING = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))


@pytest.fixture(scope="module")
def simulated():
    """Near the threshold: many contacts are open."""
    return gp.DirectSimulation(PACKING, (12, 10), seed=3, samples=3).at_overlap(
        2.04e-6 * (0.45 - 0.5)
    )


def chains(ax):
    """Segments (n, 2, 2), forces and widths of the contacts drawn."""
    (lines,) = [c for c in ax.collections if c.get_gid() == "forces"]
    return (
        np.array(lines.get_segments()),
        np.asarray(lines.get_array()),
        np.asarray(lines.get_linewidths()),
    )


def wrapped(places, shape):
    """The cell (p, q) of each place, which must be a site."""
    cells = places @ np.linalg.inv(TRIANGULAR.vectors)
    assert_allclose(cells, np.round(cells), atol=1e-9)
    return np.mod(np.round(cells).astype(int), shape)


def test_every_contact_that_carries_load_is_a_line_between_its_balls(simulated, ax):
    sample = simulated.sample
    assert plot_forces(sample, ax) is ax
    segments, values, widths = chains(ax)
    forces = sample.contact_forces / sample.force
    starts = wrapped(segments[:, 0], (12, 10))
    ways = segments[:, 1] - segments[:, 0]
    kinds = np.argmax(ways @ TRIANGULAR.contacts.normal.T, axis=1)
    assert_allclose(ways, TRIANGULAR.contacts.normal[kinds], atol=1e-12)
    # each line has the force of its contact, and every closed contact has one line, or two if it
    # crosses an edge
    assert_allclose(values, forces[starts[:, 0], starts[:, 1], kinds], rtol=1e-12)
    contacts, lines = np.unique(np.column_stack([starts, kinds]), axis=0, return_counts=True)
    assert len(contacts) == np.count_nonzero(forces) < 0.8 * forces.size
    assert set(lines.tolist()) == {1, 2}
    assert_allclose(widths / values, widths[0] / values[0], rtol=1e-12)
    assert np.all(np.diff(values) >= 0.0)  # the strong on top


def test_a_contact_across_an_edge_is_drawn_on_both_sides(simulated, ax):
    segments, _, _ = chains(plot_forces(simulated.sample, ax))
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    height = 10 * np.sqrt(0.75)
    assert (right - left, top - bottom) == pytest.approx((12.0, height))
    inside = np.all((segments > [left, bottom]) & (segments < [right, top]), axis=2)
    assert np.all(np.any(inside, axis=1))  # nothing is drawn wholly outside
    middles = segments[~np.all(inside, axis=1)].mean(axis=1)
    # of the two lines of a contact one is the other moved by a period: (12, 0), or (-5, 10
    # sqrt(3)/2), or both
    periods = np.array([(12.0, 0.0), (-5.0, height), (7.0, height), (-17.0, height)])
    moved = (middles[:, None, None] + np.concatenate([periods, -periods])[:, None])[:, :, 0]
    apart = np.linalg.norm(moved[:, :, None] - middles, axis=-1)
    assert np.all(np.sum(apart < 1e-9, axis=(1, 2)) == 1)
    assert len(middles) > 20


def test_the_map_says_what_it_shows(simulated):
    ax = plot_forces(simulated.sample)
    state, figure = simulated.sample.equilibrium, ax.get_figure()
    assert (
        ax.get_title() == f"$f^*$ = {state.force:.3g}, $a^*$ = 0.45, $N_c$ ="
        f" {simulated.sample.contact_fraction():.3f}"
    )
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_aspect()) == ("$x/d$", "$y/d$", 1.0)
    assert figure.axes[1].get_xlabel() == "Contact force over its mean"
    assert figure.axes[1].get_xlim() == pytest.approx((0.0, chains(ax)[1].max()))
    assert figure.get_size_inches()[0] == 3.4
    assert len([c for c in ax.collections if c.get_gid() == "balls"]) == 1


def test_the_map_of_a_large_sample_has_no_balls():
    many = plot_forces(gp.DirectSimulation(PACKING, (40, 40)).at_force(20.0).sample)
    assert [c.get_gid() for c in many.collections] == ["forces"]


@pytest.fixture(scope="module")
def wide():
    return gp.DirectSimulation(PACKING, (64, 12), seed=2).at_overlap(2.04e-6 * (0.45 - 0.5))


def test_of_a_large_array_the_density_of_the_force_is_drawn(wide, ax):
    sample = wide.sample
    plot_forces(sample, ax)
    (mesh,) = ax.collections
    assert mesh.get_gid() == "density"
    corners = np.asarray(mesh.get_coordinates())
    x = corners[0, :, 0]
    y = corners[:, 0, 1]
    assert (len(x) - 1, len(y) - 1) == (16, 3)
    # each contact counts half at each of its balls, those that carry nothing too
    forces = sample.contact_forces / sample.force
    table = TRIANGULAR.contacts
    sums = np.zeros((64, 12))
    for contact, (p, q) in enumerate(table.shift[:, :2]):
        for row, column in np.ndindex(64, 12):
            sums[row, column] += forces[row, column, contact]
            sums[(row + p) % 64, (column + q) % 12] += forces[row, column, contact]
    places = np.reshape(sample.sites, (64, 12, 2))
    where = (
        np.searchsorted(x, np.mod(places[..., 0] + 1e-9, 64.0), "right") - 1,
        np.searchsorted(y, places[..., 1], "right") - 1,
    )
    expected = np.zeros((16, 3))
    count = np.zeros((16, 3))
    np.add.at(expected, where, sums)
    np.add.at(count, where, 6.0)
    assert_allclose(np.asarray(mesh.get_array()).T, expected / count, rtol=1e-9)
    assert "means over 4 x 3.5 $d$" in ax.get_figure().axes[1].get_xlabel().replace(
        "3.5 x 4", "4 x 3.5"
    )


def test_a_window_shows_the_contacts_inside_it(wide, ax):
    every = chains(plot_forces(wide.sample, Figure().subplots(), show="all"))
    plot_forces(wide.sample, ax, window=(20.0, 2.0, 30.0, 8.0))
    assert (ax.get_xlim(), ax.get_ylim()) == ((20.0, 30.0), (2.0, 8.0))
    inside = np.all((every[0] > [20.0, 2.0]) & (every[0] < [30.0, 8.0]), axis=2)
    lines = {tuple(np.round(one.ravel(), 9)) for one in chains(ax)[0]}
    assert {tuple(np.round(one.ravel(), 9)) for one in every[0][inside.any(axis=1)]} <= lines
    assert len(lines) < 0.3 * len(every[0])
    (balls,) = [c for c in ax.collections if c.get_gid() == "balls"]
    assert len(balls.get_offsets()) < 100
    middle = plot_forces(wide.sample, Figure().subplots(), show="window")
    assert np.ptp(middle.get_xlim()) == pytest.approx(24.0)


def test_the_figure_of_a_large_array_marks_its_window(wide):
    figure = forces_figure(wide)
    figure.draw_without_rendering()
    whole, window, distribution = figure.axes[:3]
    (marked,) = [patch for patch in whole.patches if patch.get_gid() == "window"]
    assert window.get_xlim() == pytest.approx((marked.get_x(), marked.get_x() + marked.get_width()))
    assert window.get_ylim() == pytest.approx(
        (marked.get_y(), marked.get_y() + marked.get_height())
    )
    assert distribution.get_ylabel() == "Probability density"
    assert_inside_page(figure)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"show": "some"}, "all, window, density, auto"),
        ({"window": (3.0, 2.0, 1.0, 4.0)}, "left, lower, right"),
        ({"window": (1.0, 2.0)}, "left, lower, right"),
        ({"window": (500.0, 0.0, 510.0, 9.0)}, "no ball"),
    ],
)
def test_forces_that_cannot_be_shown(simulated, ax, options, told):
    with pytest.raises(InputError, match=told):
        plot_forces(simulated.sample, ax, **options)


def of_packing(name):
    """A network of LAMMPS' disks in a periodic plane, or balls in a periodic space."""
    glass = gp.Material(young_modulus=70e9, poisson_ratio=0.2, density=2500.0)
    return gp.ContactNetwork.from_lammps(
        *(packings.FOLDER / f"{name}_{what}.dump" for what in ("atoms", "pairs")), glass
    )


@pytest.mark.parametrize("name", ["disks", "balls"])
def test_every_contact_of_a_network_is_a_line_as_wide_and_dark_as_its_force(name, ax):
    network = of_packing(name)
    assert plot_forces(network, ax) is ax
    segments, values, widths = chains(ax)
    inside = np.all(network.shift == 0, axis=1)
    assert len(values) == np.count_nonzero(inside) + 2 * np.count_nonzero(~inside)
    # in the order of the forces: whole lines inside, and across an edge two pieces that end where
    # the balls touch
    start = network.positions[network.i, :2]
    end = network.positions[network.j, :2]
    at_i = (network.positions[network.i] + network.arm_i[:, None] * network.normal)[:, :2]
    at_j = (network.positions[network.j] - network.arm_j[:, None] * network.normal)[:, :2]
    pieces = [
        np.stack(pair, axis=1)
        for pair in (
            (start[inside], end[inside]),
            (start[~inside], at_i[~inside]),
            (end[~inside], at_j[~inside]),
        )
    ]
    force = network.normal_force
    forces = np.concatenate([force[inside], force[~inside], force[~inside]])
    order = np.argsort(forces, kind="stable")
    assert_allclose(values, forces[order], rtol=1e-12)
    assert_allclose(segments, np.concatenate(pieces)[order], atol=1e-15)
    assert_allclose(widths / widths[0], np.clip(values / force.mean(), 0.2, 4.0) / 0.2, rtol=1e-12)
    (balls,) = [c for c in ax.collections if c.get_gid() == "balls"]
    # what is nearer hides what is farther
    lowest = np.argsort(network.positions[:, 2], kind="stable")
    assert_allclose(balls.get_offsets(), network.positions[lowest, :2])
    assert_allclose(balls.get_widths(), 2.0 * network.radii[lowest])
    assert ax.get_aspect() == 1.0
    assert (
        ax.get_title()
        == f"{network.n_balls} balls, {network.n_contacts} contacts"
        + ", seen along $z$" * (name == "balls")
    )


def test_a_network_is_drawn_with_its_units():
    figure = gp.plot(of_packing("disks"))
    ax, bar = figure.axes
    assert figure.get_size_inches()[0] == 3.4
    assert (ax.get_xlabel(), ax.get_ylabel(), bar.get_xlabel()) == (
        "$x$ (mm)",
        "$y$ (mm)",
        "Contact force (N)",
    )
    figure.canvas.draw()
    written = dict(
        zip([one.get_text() for one in ax.get_xticklabels()], ax.get_xticks(), strict=True)
    )
    assert [written[one] for one in ("0", "5", "10")] == pytest.approx([0.0, 5e-3, 10e-3])
    assert bar.get_xlim() == pytest.approx((0.0, of_packing("disks").normal_force.max()))


def test_walls_and_a_row_of_balls_are_drawn(ax):
    pressed = gp.Hexagon(PACKING, 3).at_side_force(30.0)
    plot_forces(pressed.network, ax)
    (walls,) = [c for c in ax.collections if c.get_gid() == "walls"]
    assert len(walls.get_segments()) == np.count_nonzero(pressed.wall_forces)
    assert ax.get_title().startswith("19 balls, ")
    chain = gp.DirectSimulation(
        gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6), lattice="chain"), shape=(9,)
    ).at_force(2.0)
    row = plot_forces(chain.sample.network)
    assert (row.get_xlabel(), row.get_ylabel(), row.get_yticks().tolist()) == (
        "$x$ (mm)",
        "",
        [0.0],
    )
    assert_allclose(chains(row)[1], 2.0)
    assert row.get_figure().get_figheight() < 2.0


def test_of_a_large_network_the_density_or_a_window_is_drawn(wide, ax):
    network = wide.sample.network
    plot_forces(network, ax)
    (mesh,) = ax.collections
    assert mesh.get_gid() == "density"
    corners = np.asarray(mesh.get_coordinates())
    mean = np.ma.filled(mesh.get_array(), np.nan)
    # each contact counts half at each of its balls
    places = network.positions
    force = network.normal_force
    sums = np.zeros(mean.shape)
    counts = np.zeros(mean.shape)
    for ball, one in [*zip(network.i, force, strict=True), *zip(network.j, force, strict=True)]:
        column = np.searchsorted(corners[0, :, 0], places[ball, 0], "right") - 1
        row = np.searchsorted(corners[:, 0, 1], places[ball, 1], "right") - 1
        sums[row, column] += one
        counts[row, column] += 1.0
    assert_allclose(mean[counts > 0], sums[counts > 0] / counts[counts > 0], rtol=1e-9)
    assert np.all(np.isnan(mean[counts == 0]))
    window = plot_forces(network, window=(0.1, 0.02, 0.2, 0.06))
    assert (*window.get_xlim(), *window.get_ylim()) == pytest.approx((0.1, 0.2, 0.02, 0.06))
    with pytest.raises(InputError, match="inside the array"):
        plot_forces(network, window=(10.0, 0.0, 11.0, 1.0))


def test_a_network_without_force_and_what_is_no_network(ax):
    network = of_packing("disks")
    still = replace(network, normal_force=0.0 * network.normal_force)
    plot_forces(still, ax)
    assert len(ax.get_figure().axes) == 1  # without a scale of forces
    ends = {"i": [], "j": [], "normal_force": []}
    alone = gp.ContactNetwork.from_table(
        {"x": [0.0], "y": [0.0], "radius": [1e-3]}, ends, material=STEEL, keep_rattlers=True
    )
    with pytest.raises(InputError, match="no contact"):
        plot_forces(alone)
    with pytest.raises(InputError, match=r"sample.* gp.ContactNetwork"):
        plot_forces(STEEL)


def test_the_distribution_is_that_of_all_samples_and_integrates_to_one(simulated, ax):
    plot_force_distribution(simulated, ax)
    (steps,) = [p for p in ax.patches if p.get_gid() == "density"]
    density, edges, _ = steps.get_data()
    assert np.sum(density * np.diff(edges)) == pytest.approx(1.0, rel=1e-12)
    each = [
        s.contact_forces[s.contact_forces > 1e-6 * s.force] / s.force for s in simulated.samples
    ]
    expected = [np.histogram(one, edges)[0] / one.size / np.diff(edges) for one in each]
    assert_allclose(density, np.mean(expected, axis=0), rtol=1e-9)
    assert edges[-2] < max(one.max() for one in each) < edges[-1]
    assert np.diff(edges)[0] == pytest.approx(0.25 * simulated.contact_force_fluctuation, rel=0.1)
    assert ax.get_yscale() == "log"


@pytest.mark.parametrize(
    ("packing", "shape"),
    [
        (PACKING, (2, 3)),
        (PACKING, (3, 17)),
        (gp.Packing(STEEL, 8e-3), (1, 1)),
        *(
            pytest.param(PACKING, shape, marks=pytest.mark.exhaustive)
            for shape in [(1, 1), (8, 5), (7, 40), (40, 7)]
        ),
        *(
            pytest.param(gp.Packing(STEEL, 8e-3), s, marks=pytest.mark.exhaustive)
            for s in [(2, 3), (8, 5), (7, 40), (40, 7)]
        ),
    ],
)
def test_a_figure_of_forces_fits_its_page(shape, packing, tmp_path):
    state = gp.DirectSimulation(packing, shape).at_force(2.0)
    figure = forces_figure(state)
    figure.savefig(tmp_path / "forces.png", dpi=50)
    assert figure.get_size_inches()[0] == 7.0
    assert_inside_page(figure)
    (left, right), bar = figure.axes[:2], figure.axes[2]
    assert right.get_ylabel() == "Probability density"
    assert bar.get_xlabel() == right.get_xlabel()
    closed = np.count_nonzero(state.sample.contact_forces)
    assert len(chains(left)[0]) >= closed
    if not packing.width:
        assert left.get_title() == "$f$ = 2 N, $N_c$ = 1.000"
        assert_allclose(chains(left)[1], 1.0, rtol=1e-12)


def test_the_forces_of_several_loads_are_not_one_figure():
    states = gp.DirectSimulation(PACKING, (4, 4)).at_force([2.0, 3.0])
    for draw in (forces_figure, lambda state: plot_force_distribution(state, Figure().subplots())):
        with pytest.raises(InputError, match="2 loads"):
            draw(states)


def test_the_layer_that_is_drawn_of_hcp_is_whole():
    hcp = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6), lattice="hcp")
    ax = plot_forces(gp.DirectSimulation(hcp, (3, 4, 2)).at_force(20.0).sample)
    (balls,) = [one for one in ax.collections if one.get_gid() == "balls"]
    rows = np.asarray(balls.get_offsets())[:, 1]
    (low, high) = ax.get_ylim()
    assert len(rows) == 12
    # half a row is left below the lowest and above the highest
    assert_allclose([rows.min() - low, high - rows.max()], 0.25 * 3.0**0.5, rtol=1e-12)


def test_a_state_and_a_sample_are_drawn_by_their_networks():
    """Some cells of a state, with a tint for each mass."""
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(18.446)
    assert gp.plot(state).axes[0].get_title() == "16 balls, 48 contacts"
    network = state.network.repeat((1, 2))
    masses = network.masses * [1.0, 2.0]
    ax = gp.plot(replace(network, masses=masses, lattice=None, shape=None)).axes[0]
    colours = with_gid(ax, "balls").get_facecolor()
    assert len({tuple(one) for one in colours.tolist()}) == 2
    with pytest.raises(gp.GranphonError, match="2 loads"):
        gp.plot(gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force([1.0, 2.0]))


def test_balls_beside_flat_walls_are_coloured_by_overlaps():
    """The overlaps with a wall, whose place is not known, are zero."""
    network = written.layer_on_floor()
    assert np.any(np.isinf(network.distance))
    figure = gp.plot(network, color="overlap")
    assert figure.axes[-1].get_ylabel().startswith("Mean overlap")


@pytest.mark.parametrize("color", ["force", "overlap", "contacts", "spin", "numbers"])
def test_balls_of_a_network_are_coloured_by_numbers(color):
    """The colours ascend with the numbers, and a bar names them; texts stay on the page."""
    network = gp.ContactNetwork.from_lammps(
        packings.FOLDER / "disks_atoms.dump",
        packings.FOLDER / "disks_pairs.dump",
        packings.MATERIAL,
    )
    ends = np.concatenate([network.i, network.j])
    counts = np.bincount(ends, minlength=network.n_balls)
    overlap = network.radii[network.i] + network.radii[network.j] - network.distance
    numbers = {
        "force": np.bincount(ends, np.tile(network.normal_force, 2)) / counts,
        "overlap": np.bincount(ends, np.tile(overlap, 2)) / counts,
        "contacts": counts,
        "spin": gp.find_nonaffine(network).rotations[:, 2],
        "numbers": np.linspace(-1.0, 2.0, network.n_balls),
    }[color]
    figure = gp.plot(network, color=numbers if color == "numbers" else color)
    ax, *bars = figure.axes
    names = {
        "force": "Mean contact force",
        "overlap": "Mean overlap",
        "contacts": "Contacts",
        "spin": "Rotation per shear",
    }
    labels = [bar.get_ylabel() + bar.get_xlabel() for bar in bars]
    assert any(label.startswith(names.get(color, "Value")) for label in labels)
    balls = with_gid(ax, "balls")
    colours = balls.get_facecolor()
    has_signs = np.min(numbers) < 0.0 < np.max(numbers)
    assert has_signs == (color in ("spin", "numbers"))
    greatest = np.max(np.abs(numbers))
    low, high = (-greatest, greatest) if has_signs else (np.min(numbers), np.max(numbers))
    # dark where numbers are large, as contacts are where forces are large
    name = "RdBu_r" if has_signs else "cividis_r"
    order = np.argsort(network.positions[:, 2], kind="stable")
    expected = matplotlib.colormaps[name]((numbers[order] - low) / (high - low))
    assert_allclose(colours, expected, atol=1e-2)
    assert_inside_page(figure)


def test_a_colour_that_a_network_does_not_have_is_refused():
    network = gp.AveragedLattice(gp.Packing(packings.MATERIAL, 2e-3)).at_force(1.0).network
    whole = network.repeat((3, 3))
    with pytest.raises(InputError, match="color"):
        plot_forces(whole, color="speed")
    smooth = gp.AveragedLattice(gp.Packing(packings.MATERIAL, 2e-3, friction=False)).at_force(1.0)
    with pytest.raises(InputError, match="turn"):
        plot_forces(smooth.network.repeat((3, 3)), color="spin")
    with pytest.raises(InputError, match="shape"):
        plot_forces(whole, color=[1.0, 2.0])


def test_directions_of_contacts_and_forces_have_the_order_of_their_tensors():
    """Contacts of a square lattice, whose rows along x bear three times the force of the others."""
    lattice = gp.ContactLattice.of("square", 0.8).contact_network(gp.Units(1.0, 1.0, 1.0))
    along = np.abs(lattice.normal[:, 0]) > 0.5
    network = replace(lattice.repeat((2, 2)), normal_force=np.tile(np.where(along, 3.0, 1.0), 4))
    ax = plot_directions(network)
    contacts, forces = (patch.get_data() for patch in ax.patches)
    for steps in (contacts, forces):
        assert np.mean(steps.values) == pytest.approx(1.0)
    assert contacts.values[[0, 9]] == pytest.approx([9.0, 9.0])
    assert forces.values[[0, 9]] == pytest.approx([13.5, 4.5])
    even, uneven = (line.get_ydata() for line in ax.lines)
    np.testing.assert_allclose(even, 1.0)
    # the mean of 2 cos(2 theta) is a: three quarters of the force are along x
    assert uneven[[0, 90]] == pytest.approx([2.0, 0.0])
    assert {text.get_text() for text in ax.get_legend().get_texts()} == {"contacts", "forces"}
    with pytest.raises(gp.GranphonError, match="3 dimensions"):
        plot_directions(gp.ContactLattice.of("fcc", 0.8).contact_network(gp.Units(1.0, 1.0, 1.0)))


def test_participation_is_drawn_over_the_frequency():
    network = gp.ContactLattice.of("square", 0.8).contact_network(gp.Units(1.0, 1.0, 1.0))
    modes = gp.Waves(network.repeat((4, 4))).modes(12)
    ax = plot_participation(modes)
    x, y = ax.lines[0].get_data()
    np.testing.assert_array_equal(y, modes.participation_ratio)
    np.testing.assert_allclose(x / x[0], modes.frequencies / modes.frequencies[0])
    assert "Hz" in ax.get_xlabel()
    assert ax.get_ylim()[0] == 0.0


def test_rigidity_is_drawn_over_the_contacts_above_the_isostatic_number():
    """Of a triangular lattice without friction: 6 contacts against 4 less 2 of 2 n motions, and
    G/K = 1/2; with friction G/K grows with the shear stiffness, and each ball has three motions.
    """
    packing = gp.Packing(packings.MATERIAL, 2e-3, friction=False)
    smooth = gp.AveragedLattice(packing).at_force(1.0).network.repeat((4, 5))
    rough = gp.AveragedLattice(replace(packing, friction=True)).at_force(1.0).network.repeat((4, 5))
    ax = plot_rigidity(iter([smooth, rough]))
    excesses, ratios = ax.lines[0].get_data()
    np.testing.assert_allclose(excesses, [6.0 - 4.0 * 19 / 20, 6.0 - 2.0 * (60 - 2) / (2 * 20)])
    bulk = gp.moduli(rough)
    np.testing.assert_allclose(ratios, [0.5, bulk.shear / bulk.bulk])
    assert ratios[1] > 0.9
    with pytest.raises(InputError, match="no network"):
        plot_rigidity([])
    # a series has the time step of each network
    ax = plot_rigidity(enumerate([smooth, rough]))
    np.testing.assert_allclose(ax.lines[0].get_xydata(), np.transpose([excesses, ratios]))


def test_a_packing_without_a_ball_that_is_held_has_no_rigidity(ax):
    chain = gp.Packing(packings.MATERIAL, 2e-3, lattice="chain", friction=False)
    network = gp.AveragedLattice(chain).at_force(1.0).network.repeat((3,))
    loose = replace(network.cut(0, 2), cell=np.diag([1.0, 0.0, 0.0]), pbc=(True, False, False))
    with pytest.raises(InputError, match="hold no ball"):
        plot_rigidity([loose], ax)


def test_a_wall_has_no_part_in_the_colours_of_balls():
    """Its contacts are many, and the places of balls and walls show no overlap."""
    bed = gp.Crystal.on("square", [gp.Ball(STEEL, 8e-3)]).repeat((6, 1))
    pressed = bed.cut(1, 3, edges=("floor", "free")).at_pressure(100.0)
    network = pressed.network
    walls = np.flatnonzero(np.isinf(network.radii))
    counts = np.bincount(np.concatenate([network.i, network.j]), minlength=network.n_balls)
    assert counts[walls[0]] > np.max(np.delete(counts, walls))
    ax = plot_forces(network, color="contacts")
    bar = ax.get_figure().axes[-1]
    assert bar.get_ylim()[1] == np.max(np.delete(counts, walls))
    # every contact of two balls has the overlap 1e-6 m, and so has their mean at each ball
    near = replace(network, radii=network.radii + 0.5e-6)
    numbers = _BallValues.of(near, "overlap").numbers
    assert_allclose(np.delete(numbers, walls), 1e-6, rtol=1e-6)


def test_a_state_without_samples_has_no_distribution_of_forces(ax):
    state = gp.AveragedForce(PACKING).at_force(20.0)
    for draw in (forces_figure, lambda state: plot_force_distribution(state, ax)):
        with pytest.raises(InputError, match="no samples"):
            draw(state)


def test_a_wrong_window_is_refused_also_where_it_has_no_effect(ax):
    network = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(3.0).network.repeat((4, 4))
    for show in ("window", "all", "density", "auto"):
        with pytest.raises(InputError, match="window"):
            plot_forces(network, ax, show=show, window=(1.0, 1.0, 0.0, 0.0))
    with pytest.raises(InputError, match="network"):
        plot_directions(3, ax)
    with pytest.raises(InputError, match="networks is 3"):
        plot_rigidity(3, ax)


def test_a_row_of_balls_has_its_tick_where_it_is(ax):
    """The limits of the axes are beside the balls, wherever these are."""
    row = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(3.0).network.repeat((5, 1))
    moved = replace(row, positions=row.positions + np.array([0.0, 0.1, 0.0]))
    plot_forces(moved, ax)
    assert_allclose(ax.get_yticks(), [0.1])
    low, high = ax.get_ylim()
    assert 0.09 < low < high < 0.11
