"""What the waves of an edge cost: the times of small crystals, and how they grow with the number of
balls in a layer.
"""

from __future__ import annotations

import math
from functools import cache, partial
from typing import Any

import numpy as np

from granphon.balls.ball import Ball
from granphon.balls.material import Material
from granphon.media import cost as costs
from granphon.media.choice import ServingMedium
from granphon.media.crystal import Crystal
from granphon.waves.settings import SurfaceSettings

#: for each dimension the lattice of the crystals that are timed
_LATTICES = {1: "chain", 2: "triangular", 3: "fcc"}
#: greatest number of balls in a layer of the crystal whose waves of an edge are timed
_TIMED_LAYER = 4
#: power of the number of balls in a layer with which this time grows, as measured from 4 to 16
#: balls
_GROWTH = 3.0
#: number of segments of the path along an edge, by the number of periods along it
_SEGMENTS = (0, 1, 3)
#: number of different corners of the path of the crystals that are timed, by the number of periods
#: along the edge; other crystals may have three where these have four
_CORNERS = (1, 2, 4)
#: number of frequencies of a spectrum that are timed: of fewer, each takes longer
_TIMED_FREQUENCIES = 128


def estimate_edge(serving: ServingMedium, settings: SurfaceSettings) -> costs.Cost:
    """Return the estimated memory and time of the waves of an edge along its path, with the points
    of the ``settings``, at all loads of a medium, ``serving``, that simulates no arrays.
    """
    from granphon.phonons.surfaces import estimate_waves_memory

    balls = serving.packing
    n_points = _count_points(serving, settings)
    n_motions = balls.ball_motions.count * balls.structure.n_balls
    # a search of all corners is timed, and takes as long as one of so many other points
    n_searches = serving.load.size * n_points / _CORNERS[balls.structure.dimension - 1]
    units = costs.Units(n_searches, partial(measure_corners, *_describe_layer(serving)))
    words = f"waves of an edge at {n_points:,} wave vectors"
    memory = estimate_waves_memory(n_motions, n_points)
    return costs.Cost(memory, units=(units,), parts=(words,))


def estimate_map(serving: ServingMedium, settings: SurfaceSettings) -> costs.Cost:
    """Return the estimated time of the spectra of an edge along its path, with the points of the
    ``settings``, for a medium, ``serving``, that simulates no arrays and has one load.
    """
    from granphon.phonons.surfaces import N_FREQUENCIES

    n_points = _count_points(serving, settings)
    measure = partial(_measure_spectrum, *_describe_layer(serving))
    words = f"spectra of an edge at {n_points:,} wave vectors"
    return costs.Cost(units=(costs.Units(n_points * N_FREQUENCIES, measure),), parts=(words,))


def _count_points(serving: ServingMedium, settings: SurfaceSettings) -> int:
    """Return the number of wave vectors on the path along an edge of the lattice of a medium,
    ``serving``, with the points of each segment that the ``settings`` have.
    """
    n_segments = _SEGMENTS[serving.packing.structure.dimension - 1]
    return 1 + n_segments * (settings.points - 1)


def _describe_layer(serving: ServingMedium) -> tuple[int, int, bool]:
    """Return what the time of the waves of an edge depends on, of a medium, ``serving``: the
    dimension of the lattice, the number of balls in a layer, which is as thick as a cell, and
    whether there is friction.
    """
    structure = serving.packing.structure
    return structure.dimension, structure.n_balls, serving.packing.friction


def estimate_corners_memory(dimension: int, n_motions: int) -> float:
    """Return the memory, bytes, of the waves of an edge at the corners of its path, of a crystal in
    ``dimension`` dimensions with ``n_motions`` motions in a layer.
    """
    from granphon.phonons.surfaces import estimate_waves_memory  # others do not need surfaces

    return estimate_waves_memory(n_motions, _CORNERS[dimension - 1])


@cache
def measure_corners(dimension: int, n_balls: int, friction: bool) -> float:
    """Return the time, s, of the waves of an edge, at the corners of its path, of a crystal in
    ``dimension`` dimensions with ``n_balls`` balls in a layer, with or without ``friction``.

    The time of a crystal of at most :data:`_TIMED_LAYER` balls is measured, and multiplied by the
    power of the number of balls in :data:`_GROWTH`.
    """
    surface, n_timed = _make_surface(dimension, n_balls, friction)
    corners = np.array(list(surface.corners().values()))[:, : dimension - 1]
    seconds = costs.time_once(lambda: surface.branches(corners))
    return seconds * math.pow(n_balls / n_timed, _GROWTH)


@cache
def _measure_spectrum(dimension: int, n_balls: int, friction: bool) -> float:
    """Return the time, s, of a spectrum at an edge, at one wave vector and frequency, of the
    crystal of :func:`measure_corners`, whose arguments are the same, measured as there.
    """
    surface, n_timed = _make_surface(dimension, n_balls, friction)
    corners = np.array(list(surface.corners().values()))[:, : dimension - 1]
    highest = float(np.sqrt(surface.half_space.highest))
    frequencies = np.linspace(0.1, 1.0, _TIMED_FREQUENCIES) * highest
    frequencies *= surface.half_space.units.angular_frequency / (2.0 * np.pi)  # Hz
    seconds = costs.time_once(lambda: surface.spectrum(corners, frequencies))
    n_spectra = len(corners) * _TIMED_FREQUENCIES
    return seconds / n_spectra * math.pow(n_balls / n_timed, _GROWTH)


def _make_surface(dimension: int, n_balls: int, friction: bool) -> tuple[Any, int]:
    """Return the free edge, across the last axis, of a crystal that is timed, in ``dimension``
    dimensions and with or without ``friction``, and the number of balls in a layer of this crystal:
    ``n_balls``, but at most :data:`_TIMED_LAYER`.
    """
    from granphon.phonons.surfaces import Surface  # others do not need surfaces

    n_cells = min(n_balls, _TIMED_LAYER)  # along the first period
    cells = (n_cells, *(1,) * (dimension - 1))
    state = make_crystal(dimension, cells, friction).at_force(1.0)
    return Surface(state, dimension - 1), n_cells


def make_crystal(dimension: int, cells: tuple[int, ...], friction: bool) -> Crystal:
    """Return a crystal of equal balls, without a load, whose times are measured, on a lattice in
    ``dimension`` dimensions, with or without ``friction``; it has ``cells`` (``dimension``,) along
    its periods.
    """
    ball = Ball(Material(1e9, 0.3, 1e3), 1e-2)  # any ball: times do not depend on its numbers
    return Crystal.on(_LATTICES[dimension], [ball], friction=friction).repeat(cells)
