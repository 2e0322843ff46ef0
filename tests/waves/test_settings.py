"""Settings of waves: signals of drives, and the faces of arrays that they move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError
from granphon.waves.settings import DriveSettings, ModesSettings, ResponseSettings, Signal

BALL = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)


def integrate_lost(signal, step, end):
    """The share of the area that is lost, by sums over a fine mesh."""
    times = (np.arange(2_000_000) + 0.5) / 2_000_000 * end
    samples = step * np.arange(int(end / step) + 2)
    values = np.interp(times, signal.times, signal.values)
    lines = np.interp(times, samples, np.interp(samples, signal.times, signal.values))
    area = np.sum(np.abs(values))
    return np.sum(np.abs(values - lines)) / area if area else 0.0


@pytest.mark.parametrize(
    ("times", "values"),
    [
        ((1.0, 1.0001), (5.0, 0.0)),  # the signal has a value before its first time
        ((0.0, 1.0, 1.001, 1.002, 50.0), (1.0, 1.0, 0.0, 1.0, 1.0)),  # and goes on after the end
        ((0.0, 0.01, 0.02), (0.0, 1.0, 0.0)),
        ((0.0, 0.17, 0.34, 0.5), (1.0, -1.0, 1.0, -1.0)),  # as much of it is below zero as above
    ],
)
@pytest.mark.parametrize("end", [0.5, 2.0, 10.0])
def test_lost_area_is_that_from_the_start_to_the_end(times, values, end):
    signal = Signal(times, values)
    expected = integrate_lost(signal, 0.1, end)
    assert np.isclose(signal.find_lost_share(0.1, end), expected, rtol=1e-2, atol=1e-6)


def test_faces_are_across_the_periods_whichever_axis_these_are_along():
    strip = gp.Crystal.on("square", [BALL]).at_force(1.0).network.cut(0, 5)
    drive = DriveSettings(balls="upper", impact=0.1)
    upper = drive.find_balls(strip)
    assert np.allclose(strip.positions[upper, 1], np.max(strip.positions[:, 1]))
    # the same strip with x and y exchanged
    order = [1, 0, 2]
    turned = replace(
        strip,
        cell=strip.cell[np.ix_(order, order)],
        pbc=(False, True, False),
        positions=strip.positions[:, order],
        normal=strip.normal[:, order],
        shift=strip.shift[:, order],
    )
    assert np.array_equal(drive.find_balls(turned), upper)


def test_a_floor_is_a_face_whatever_its_position():
    strip = gp.Crystal.on("square", [BALL]).at_force(1.0).network.repeat((3, 1))
    strip = strip.cut(1, 5, ("floor", "free"))
    positions = strip.positions.copy()
    positions[-1, 1] = 1.0
    moved = replace(strip, positions=positions)
    for name, index in (("lower", strip.n_balls - 1), ("upper", 12)):
        balls = DriveSettings(balls=name, impact=0.1).find_balls(moved)
        assert index in balls
        assert np.array_equal(balls, DriveSettings(balls=name, impact=0.1).find_balls(strip))


def test_a_cut_has_an_axis_layers_and_edges_and_no_more():
    edges = ("free", "free")
    assert ModesSettings(cut=((0, 3),)).cut == ModesSettings(cut=((0, 3, edges),)).cut
    with pytest.raises(InputError, match="cut"):
        ModesSettings(cut=((0, 3, edges, 1),))


@pytest.mark.parametrize("receiver", ["9" * 5000 + " x", "9" * 5000 + "-1"])
def test_an_index_of_thousands_of_digits_is_one_error(receiver):
    with pytest.raises(InputError, match="number of a ball"):
        ResponseSettings(frequencies=(1e3, 2e3), source="plane", receiver=receiver)


@pytest.mark.parametrize("value", [np.array([2, 2]), np.array([2]), np.array([])])
@pytest.mark.parametrize("key", ["repeat", "cut"])
def test_an_array_in_place_of_a_tuple_is_one_error(key, value):
    with pytest.raises(InputError, match=key):
        ModesSettings(**{key: value})
