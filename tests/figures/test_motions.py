"""Figures of balls in motion: what they show is that of the motion."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.base.scales import HertzPrefix
from granphon.figures.motions import (
    motion_figure,
    plot_ball_spectrum,
    plot_energies,
    plot_harmonics,
    plot_motion,
    plot_snapshot,
)
from granphon.figures.waves import (
    _draw_attenuation,
    _draw_map,
    _group_rows,
    animate_pulse,
    plot_attenuation,
    plot_frame,
    plot_lines,
    plot_seismogram,
    plot_surface,
)
from tests.figures.conftest import with_gid

STEEL = gp.Material(211.65e9, 0.276, 7840.0)


def hit(network, ball, velocity, duration, **options):
    velocities = np.zeros((network.n_balls, 3))
    velocities[ball] = velocity
    return gp.NonlinearWaves(network, **options).run(duration, velocities=velocities, frames=41)


@pytest.fixture(scope="module")
def chain():
    packing = gp.Packing(STEEL, diameter=8e-3, lattice="chain", motions="longitudinal")
    return hit(
        gp.AveragedLattice(packing).at_force(1.0).network.cut(0, 12), 0, [0.1, 0.0, 0.0], 2e-4
    )


@pytest.fixture(scope="module")
def array():
    network = (
        gp.AveragedLattice(gp.Packing(STEEL, diameter=8e-3))
        .at_force(5.0)
        .network.repeat((5, 1))
        .cut(1, 4, ("floor", "free"))
    )
    return hit(network, 2, [0.0, 0.1, 0.0], 4e-5, friction_coefficient=0.3)


@pytest.fixture(scope="module")
def grains():
    network = (
        gp.AveragedLattice(gp.Packing(STEEL, diameter=8e-3, lattice="fcc"))
        .at_force(5.0)
        .network.repeat((2, 2, 2))
    )
    return hit(network, 0, [0.1, 0.0, 0.0], 1e-5)


def test_a_frame_that_is_alone_is_drawn(array, tmp_path):
    array.write(tmp_path / "motion")
    start = gp.Motion.read(tmp_path / "motion", slice(0, 1))
    snapshot = motion_figure(start).axes[0]
    speeds = np.linalg.norm(array.velocities[0], axis=1)
    balls = np.isfinite(array.network.radii)
    assert_allclose(1e-3 * with_gid(snapshot, "balls").get_array(), speeds[balls])


def test_maps_have_a_column_for_each_ball_or_contact_of_a_chain(chain, ax):
    plot_motion(chain, ax)
    assert_allclose(ax.collections[0].get_array(), 1e3 * chain.velocities[:, :, 0])
    ax.clear()
    plot_motion(chain, ax, show="forces")
    assert_allclose(ax.collections[0].get_array(), chain.forces - chain.forces[0])
    assert ax.get_xlabel() == "x (mm)"
    with pytest.raises(InputError, match="show"):
        plot_motion(chain, ax, show="spins")


def test_maps_of_forces_take_the_contacts_between_layers_together(array, ax):
    """Contacts within a layer and those up to the next make one column, and an oblique cell is
    folded.
    """
    plot_motion(array, ax, show="forces", axis=1)
    rows = np.round(
        (array.middles[:, 1] - array.network.positions[0, 1]) / (8e-3 * np.sqrt(0.75)) - 0.24
    ).clip(0, 3)
    change = array.forces - array.forces[0]
    wanted = np.array([change[:, rows == row].mean(axis=1) for row in range(4)]).T
    drawn = ax.collections[0].get_array()
    assert_allclose(drawn, wanted * (np.abs(drawn).max() / np.abs(wanted).max()), atol=1e-9)
    ax.clear()
    plot_motion(array, ax, axis=0)
    assert ax.collections[0].get_array().shape[1] == 10  # two for each of five balls


def test_maps_of_an_array_are_means_over_layers(array, ax):
    plot_motion(array, ax)
    # the floor is no ball
    wanted = 1e3 * array.velocities[:, :-1, 1].reshape(41, 4, 5).mean(axis=2)
    assert_allclose(ax.collections[0].get_array(), wanted, atol=1e-12)
    assert ax.get_xlabel() == "y (mm)"


def test_energies_add_up(array, ax):
    plot_energies(array, ax)
    total = sum(np.array(line.get_ydata()) for line in ax.lines)
    assert_allclose(total / total[0], 1.0, rtol=1e-3)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [
        "translation",
        "rotation",
        "contacts",
        "lost",
    ]


def test_snapshots_colour_each_ball_by_its_speed(array, grains, ax):
    plot_snapshot(array, ax, 10)
    assert_allclose(
        ax.collections[0].get_array(), 1e3 * np.linalg.norm(array.velocities[10, :-1], axis=1)
    )
    ax.clear()
    plot_snapshot(grains, ax)
    assert len(ax.collections[0].get_array()) == 8
    with pytest.raises(InputError, match="frame: found 41"):
        plot_snapshot(array, ax, 41)


def test_wrong_options_of_pictures_of_motions_are_told(chain, array, ax):
    """None ends in NumPy's words, and none is ignored."""
    with pytest.raises(InputError, match="frame: found 0"):
        plot_snapshot(array, ax, 0.5)
    with pytest.raises(InputError, match="most"):
        plot_snapshot(array, ax, 1, most="all")
    with pytest.raises(InputError, match="axis"):
        plot_motion(array, ax, axis=1.0)
    with pytest.raises(InputError, match="'stored'"):
        plot_energies(array, ax, {"sored": np.ones(41)})
    with pytest.raises(InputError, match=r"shape \(3,\)"):
        plot_energies(array, ax, {"stored": np.ones(3)})
    # a map along the axis that is given
    assert len(motion_figure(array, axis=0).axes) == 3
    still = hit(chain.network, 0, [0.0, 0.0, 0.0], 2e-4)
    with pytest.raises(InputError, match="along x"):
        plot_harmonics(still, ax, 2e4, count=1, periods=1)


def test_spectra_and_harmonics_are_those_of_the_motion(chain, ax):
    plot_ball_spectrum(chain, ax, 3)
    frequencies, amplitudes = chain.spectrum(3)
    x, y = ax.lines[0].get_data()
    assert_allclose(x[1] / x[2], frequencies[1] / frequencies[2])
    assert_allclose(y / y.max(), amplitudes / amplitudes.max(), atol=1e-8)
    ax.clear()
    plot_harmonics(chain, ax, 1e4, count=2, periods=2)
    assert len(ax.lines) == 2
    found = np.abs(chain.harmonics(1e4, 2, 0, 2))
    assert_allclose(ax.lines[1].get_ydata() / ax.lines[0].get_ydata(), found[1] / found[0])
    # more harmonics than colours, and an axis along which nothing moves
    assert len(plot_harmonics(chain, Figure().subplots(), 1e4, count=8, periods=2).lines) == 8
    still = plot_ball_spectrum(chain, Figure().subplots(), 3, axis=1)
    assert still.get_xlim()[1] == pytest.approx(x[-1])


def test_harmonics_are_those_of_balls_alone(array, ax):
    """A flat wall may have any place, and would make the axis long."""
    is_wall = np.isinf(array.network.radii)
    positions = np.where(is_wall[:, None], -1.0, array.network.positions)
    moved = replace(array, network=replace(array.network, positions=positions))
    plot_harmonics(moved, ax, 1e5, count=1, axis=1, periods=2)
    heights = positions[~is_wall, 1]
    assert_allclose(1e-3 * ax.lines[0].get_xdata(), np.sort(heights) - heights.min(), atol=1e-12)


def test_rows_of_a_map_lie_about_their_frequencies():
    frequencies = np.array([1.0, 2.0, 4.0])
    edges, values = _group_rows(frequencies, np.array([[5.0, 6.0, 7.0]]))
    assert_allclose(edges, [1.0, 1.5, 3.0, 4.0])
    assert_allclose(values, [[5.0, 6.0, 7.0]])
    many = np.arange(2403.0)
    edges, values = _group_rows(many, many[None])
    assert_allclose(edges[[0, 1, -1]], [0.0, 3.5, 2399.0])  # four in a row, three left out
    assert_allclose(values[0, [0, -1]], [3.0, 2399.0])


def test_pictures_of_a_pulse_in_space_colour_each_ball_by_its_own_velocity(grains):
    """In the order in which balls are drawn, which is not that of their numbers."""
    network = grains.network
    velocities = np.zeros((2, network.n_balls, 3))
    velocities[1, :, 0] = np.arange(network.n_balls)
    pulse = SimpleNamespace(
        frames=[1e-6, 2e-6], velocities=velocities, polarisation=np.array([1.0, 0.0, 0.0])
    )
    (still_balls,) = plot_frame(network, pulse, 0, Figure().subplots()).collections
    # at rest, all balls have the colour in the middle, which is that of no velocity
    assert_allclose(still_balls.norm(still_balls.get_array()), 0.5)
    ax = plot_frame(network, pulse, 1, Figure().subplots())
    figure = Figure()
    animation = animate_pulse(network, pulse, figure=figure)
    (balls,) = animation._func(1)
    animation._draw_was_started = True  # nothing is to be saved
    (alone,) = ax.collections
    assert_allclose(balls.get_array(), alone.get_array())
    assert_allclose(balls.get_offsets(), alone.get_offsets())


def test_a_pulse_has_flat_traces_where_no_signal_arrives_and_errors_of_its_shape(ax):
    packing = gp.Packing(STEEL, diameter=8e-3, lattice="chain", motions="longitudinal")
    network = gp.AveragedLattice(packing).at_force(8.0).network.repeat((40,))
    pulse = gp.Waves(network).transmit(5e3, (1,), 6.0 * 8e-3, cycles=2)
    silent = replace(pulse, signals=np.zeros_like(pulse.signals))
    plot_seismogram(silent, ax)
    assert_allclose(ax.lines[1].get_ydata(), -1.0)
    with pytest.raises(InputError, match=r"shape \(3,\)"):
        plot_seismogram(pulse, ax, errors={"coherent": np.ones(3)})
    # axes that hold other lines already: the band is about the mean, and no other line
    ax = Figure().subplots()
    for height in (7.0, 8.0):
        ax.axhline(height)
    relative_error = 0.25
    greatest = np.max(np.abs(pulse.signals))
    errors = np.full(pulse.times.shape, relative_error * greatest)
    plot_seismogram(pulse, ax, errors={"coherent": errors})
    (band,) = ax.collections
    vertices = band.get_paths()[0].vertices
    mean = ax.lines[3].get_ydata()
    scale = (mean.max() - mean.min()) / np.ptp(pulse.coherent)
    assert_allclose(
        [vertices[:, 1].min(), vertices[:, 1].max()],
        [mean.min() - scale * errors[0], mean.max() + scale * errors[0]],
    )
    assert_allclose(mean, scale * pulse.coherent - 1.0)


@pytest.mark.parametrize(("name", "panels"), [("chain", 2), ("array", 4), ("grains", 4)])
def test_the_figure_of_a_motion(name, panels, request):
    motion = request.getfixturevalue(name)
    drawn = [ax for ax in gp.plot(motion).axes if ax.get_label() != "<colorbar>"]
    assert len(drawn) == panels
    assert len(motion_figure(motion, show="forces").axes) == 3


def test_a_word_that_is_empty_is_refused_and_what_is_no_network_of_the_pulse(array, chain):
    with pytest.raises(InputError, match="show"):
        motion_figure(array, show="")
    network = chain.network
    velocities = np.zeros((1, network.n_balls, 3))
    pulse = SimpleNamespace(frames=[1e-6], velocities=velocities, polarisation=np.eye(3)[0])
    for other in (array.network, None):
        with pytest.raises(InputError, match="network"):
            plot_frame(other, pulse, 0, Figure().subplots())
        with pytest.raises(InputError, match="network"):
            animate_pulse(other, pulse)


def test_spectra_that_are_zero_are_drawn_and_a_power_that_is_none_is_refused(ax):
    network = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(3.0).network.repeat((4, 4))
    shortest = 2.0 * np.pi * np.linalg.inv(network.cell[:2, :2])[:, 0]
    spectrum = gp.Waves(network).spectral_function([shortest, 2.0 * shortest], moments=20)
    silent = replace(spectrum, values=np.zeros_like(spectrum.values))
    assert plot_lines(silent, ax).get_xlim()[1] > 0.0
    for power in ("2", np.nan, 101.0, True):
        with pytest.raises(InputError, match="power"):
            plot_attenuation(spectrum, ax, power=power)


def test_branches_of_an_edge_are_drawn_at_the_wave_vectors_of_the_spectrum_alone(ax):
    surface = gp.Surface(gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(3.0).network, 1)
    q = [[0.1], [0.2]]
    spectrum = surface.spectrum(q, [1e3, 2e3], damping=1e3)
    plot_surface(spectrum, ax, branches=surface.branches(q))
    for branches in (surface.branches([[0.1], [0.3]]), surface.branches([[0.1]]), 3):
        with pytest.raises(InputError, match="branches"):
            plot_surface(spectrum, ax, branches=branches)


def test_a_spectrum_of_zeros_is_drawn_in_one_colour(ax):
    _draw_map(ax, np.arange(3.0), np.arange(4.0), np.zeros((2, 3)), "", HertzPrefix.named("Hz"))
    ax.get_figure().draw_without_rendering()
    assert np.ptp(ax.collections[0].get_array()) == 0.0


def test_attenuations_have_bars_where_their_errors_are_known(ax):
    table = {
        "attenuation": np.array([1.0, 2.0, 3.0, 4.0]),
        "attenuation_error": np.array([0.1, np.nan, 0.3, np.nan]),
        "line_frequency": np.array([1e3, 2e3, 3e3, 4e3]),
        "line_resolved": np.array([1.0, 1.0, 1.0, 0.0]),
    }
    unit = HertzPrefix.named("kHz")
    drawn = _draw_attenuation(ax, lambda name, _=0: table[name], 0, "k", unit, has_errors=True)
    assert_allclose(drawn, [1.0, 2.0, 3.0])
    (container,) = ax.containers
    (bars,) = container.lines[2]
    lengths = [np.ptp(segment[:, 1]) for segment in bars.get_segments()]
    assert_allclose(lengths, [0.2, 0.0, 0.6], atol=1e-15)
