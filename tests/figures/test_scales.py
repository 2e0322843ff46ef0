"""Scales, ticks and units of axes."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.base.errors import InputError
from granphon.figures import scales
from tests.conftest import only

STEEL = gp.Material(211.65e9, 0.276, 7840.0)


LEAST = [0.013, 0.92, 1.01, 2.4, 351.0, 880.0]
RATIOS = [1.01, 1.3, 1.9, 2.4, 3.9, 4.1, 6.0, 20.0, 300.0]


@pytest.mark.parametrize(
    ("least", "ratio"),
    only(zip(itertools.cycle(LEAST), RATIOS), itertools.product(LEAST, RATIOS)),
)
def test_an_axis_of_loads_or_velocities_has_four_labels_or_more_and_few_with_ticks_between(
    ax, least, ratio
):
    ax.plot([1.0, 2.0], [least, ratio * least])
    scales.scale_axis(ax, "y", np.array([least, ratio * least]))
    ax.set_ylim(least, ratio * least)
    ticks = ax.get_yticks()
    assert 4 <= np.sum((ticks >= least) & (ticks <= ratio * least)) <= 9
    minor = ax.get_yticks(minor=True)
    assert np.sum((minor >= least) & (minor <= ratio * least)) >= len(ticks)
    assert {label.get_text() for label in ax.get_yticklabels(minor=True)} == {""}
    labels = [label.get_text() for label in ax.get_yticklabels()]
    assert_allclose([float(label) for label in labels], ticks, rtol=1e-5)


@pytest.mark.parametrize("apart", [2e-16, 1e-14, 1e-10])
def test_an_axis_of_values_that_differ_by_rounding_goes_a_twentieth_to_either_side(ax, apart):
    values = 0.1 * np.array([1.0, 1.0 + apart])
    ax.plot([1.0, 2.0], values)
    ax.margins(0.1)
    scales.scale_axis(ax, "y", values)
    scales.widen_axis(ax, "y", values)
    assert_allclose(ax.get_ylim(), [0.095, 0.105], rtol=1e-9)
    ax.figure.draw_without_rendering()
    assert ax.get_tightbbox().height < 1.1 * ax.figure.bbox.height


@pytest.mark.parametrize(
    ("values", "unit", "label", "size"),
    [
        ([2e8, 3e9], "Pa", "y (GPa)", 1e9),
        ([1e3, 3e9], "Pa", "y (GPa)", 1e9),
        ([-1e-6, 2e-6], "m", "y (µm)", 1e-6),
        ([1e-5, 2e-4], "N", "y (µN)", 1e-6),
        ([0.2, 20.0], "N", "y (N)", 1.0),
        ([2.0, 9e4], "N/m", "y (N/m)", 1.0),
        ([2.0, 9e3], "Hz", "y (Hz)", 1.0),
        ([2.0, 9e7], "Hz", "y (MHz)", 1e6),
        ([0.0, 0.0], "m", "y (m)", 1.0),
        ([1e6, 2e6], "", "y", 1.0),
    ],
)
def test_a_unit_with_a_prefix_divides_what_is_written_at_the_ticks(ax, values, unit, label, size):
    ax.plot([1.0, 2.0], values)
    scales.scale_axis(ax, "y", np.array(values))
    scales.name_axis(ax.yaxis, float(np.max(np.abs(values))), "y", unit)
    assert ax.get_ylabel() == label
    assert_array_equal(ax.lines[0].get_ydata(), values)
    ax.figure.canvas.draw()
    written = [text.get_text().replace("\N{MINUS SIGN}", "-") for text in ax.get_yticklabels()]
    powers = [re.fullmatch(r"\$\\mathdefault\{10\^\{([-\d]+)\}\}\$", one) for one in written]
    found = [
        10.0 ** int(power[1]) if power else float(one)
        for power, one in zip(powers, written, strict=True)
    ]
    if size != 1.0:
        assert_allclose(np.array(found) * size, ax.get_yticks(), rtol=1e-9, atol=1e-15)
        assert max(map(len, written)) < 6 or all(powers)


@pytest.mark.parametrize("values", [[1.0, 1e300], [1e-300, 1.0]])
def test_an_axis_that_would_reach_beyond_floating_point_is_refused(ax, values):
    with pytest.raises(InputError, match=r"x axis .*units"):
        scales.scale_axis(ax, "x", np.array(values))


@pytest.mark.parametrize("width", [0.5, 1.0, 2.0])
def test_texts_of_a_small_panel_do_not_overlap_along_x(ax, width):
    ax.set_position((0.2, 0.2, width / ax.figure.get_figwidth(), 0.5))
    values = np.array([2900.0, 6300.0])
    ax.plot(values, [1.0, 2.0])
    scales.scale_axis(ax, "x", values)
    scales.thin_ticks(ax)
    ax.figure.draw_without_rendering()
    boxes = [label.get_window_extent() for label in ax.get_xticklabels()]
    assert boxes
    assert all(left.x1 < right.x0 for left, right in itertools.pairwise(boxes))


def test_a_linear_axis_of_a_small_panel_has_three_ticks_or_more(ax):
    ax.set_position((0.2, 0.2, 0.5, 0.6 / ax.figure.get_figheight()))
    ax.set_ylim(0.0, 93.0)
    scales.thin_ticks(ax)
    ticks = ax.get_yticks()
    assert np.sum((ticks >= 0.0) & (ticks <= 93.0)) >= 3


def test_a_density_of_zero_is_drawn_over_all_of_its_frequencies(ax):
    frequencies = np.array([1e3, 2e3, 3e3])
    scales.draw_densities(ax, [("k", "none", frequencies, np.zeros(3), np.zeros(3))])
    assert_allclose(ax.get_xlim(), (0.0, 1.03 * 3.0))
