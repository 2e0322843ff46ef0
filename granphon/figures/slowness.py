"""Figures of slowness, the inverse of the sound velocity, over the directions of propagation.

As in :mod:`granphon.figures.bands`, every function that takes an Axes draws on it and returns it.
Light blue is transverse and dark blue longitudinal. The normal of a slowness surface is the
direction in which the energy of the wave travels.
"""

from __future__ import annotations

import re
from typing import Any

from granphon.figures.scales import POLARISATION, add_part_bar, hide_axes, styled_figure

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from granphon.balls.lattices import as_direction
from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.text import counted
from granphon.base.validation import real_array
from granphon.dynamics.branches import connect_branches
from granphon.figures.style import FRAME, TRANSVERSE_COLOUR
from granphon.figures.views import HALO, Painter, View, read_view
from granphon.media.state import State, as_state

#: unit of slowness in figures, which equals ms/m
_LABEL = "s/km"
#: label of the colour bar
_PART = "Longitudinal part of the polarisation"
#: number of directions in half a turn, in a cut and on a surface
_CUT = 180
_SURFACE = 48
#: the directions, Cartesian, that span the two cuts through a surface in space
_CUTS = (((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), ((1.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
#: component of a direction, a unit vector, up to which it is the rounding of zero
_ROUNDING = 1e-9


def _find_slowness(state: State, directions: Array) -> tuple[Array, Array, Array]:
    """Return slowness (n, b), s/km, longitudinal part (n, b) and polarisations (n, u, b) of the b
    waves of sound in the ``directions`` (n, p), unit vectors; u counts the components of
    displacements.

    The longitudinal part of a wave is the square of the component of its polarisation, a unit
    vector, along the direction. InputError for a lattice of one period, several loads, or balls
    that move across the plane only.
    """
    periods = state.reference_lattice.periods
    if periods == 1:
        raise InputError(
            f"the {state.name} has one period",
            "Its sound has one direction",
            "Use sound_velocities",
        )
    if not state.is_single:
        raise InputError(
            "the state has several loads", "A slowness surface is that of one load", "Use state[0]"
        )
    # the last wave is the flexural one, which has no velocity
    n_waves = len(state.wave_names) - ("out_of_plane" in state.wave_names)
    if not n_waves:
        raise InputError(
            "these balls move across the plane only", "Their long waves are flexural: no velocity"
        )
    velocities, polarisations = state.polarised_waves(directions)
    slowness = 1.0 / (1e-3 * velocities[:, :n_waves])
    polarisations = polarisations[:, :, :n_waves]
    translation_axes = state.reference_lattice.motions.translations
    # the components of displacements along the periods, and their axes: displacements across a
    # plane have no part along a direction in the plane
    axes_of_components = {
        component: axis for component, axis in enumerate(translation_axes) if axis < periods
    }
    along_periods = polarisations[:, list(axes_of_components)]
    direction_components = directions[:, list(axes_of_components.values())]
    # the product of direction and polarisation of each wave, summed over the components u
    cosines = np.einsum("nu,nub->nb", direction_components, along_periods)
    return slowness, cosines**2, polarisations


def plot_slowness(
    state: Any, ax: Axes, *, plane: ArrayLike | None = None, colorbar: bool = True
) -> Axes:
    """Draw the slowness of sound over the directions of a plane, coloured by the longitudinal part
    of the polarisation.

    In the cut through a crystal in space, waves polarised across the cut are dashed. Flexural waves
    have no velocity and are left out.

    Parameters
    ----------
    state : the state of the contacts, at one load, or a sample or network as in
        :func:`~granphon.sound_velocities`, with two or three periods.
    plane : (2, 3) two Cartesian directions that span the cut through a crystal in space, the first
        to the right; the second is turned so that it is perpendicular to the first. By default x
        and y.
    colorbar : whether to draw the colour bar, above the axes.

    Raises
    ------
    InputError : a ``state`` without a network or without a period, several loads, one period, balls
        that move across their plane alone, a ``plane`` that is not two different directions, or a
        ``plane`` for a lattice of two periods.
    MechanismError : a motion of the lattice costs no energy.
    """
    contact_state = as_state(state)
    periods = contact_state.reference_lattice.periods
    if periods == 2 and plane is not None:
        raise InputError("the lattice is a plane", "It has no other cut", "Leave plane out")
    span = _read_plane(_CUTS[0] if plane is None else plane)
    # the angles lie half a step beside directions of high symmetry, in which the polarisations of
    # transverse waves are not determined
    angles = (np.arange(2 * _CUT + 1) + 0.5) * np.pi / _CUT
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    directions = circle if periods == 2 else circle @ span
    slowness, longitudinal, polarisations = _find_slowness(contact_state, directions)
    out_of_plane = np.zeros_like(longitudinal)
    if periods == 3:
        # the component of each polarisation along the normal of the cut
        out_of_plane = np.einsum("u,nub->nb", np.cross(*span), polarisations) ** 2
    # waves are sorted by velocity in each direction; a curve follows one polarisation instead
    order = connect_branches(polarisations)
    slowness = np.take_along_axis(slowness, order, 1)
    longitudinal = np.take_along_axis(longitudinal, order, 1)
    out_of_plane = np.take_along_axis(out_of_plane, order, 1)
    for wave in range(slowness.shape[1]):
        points = slowness[:, wave, None] * circle
        # on average more than half of the motion is out of the cut
        is_dashed = bool(out_of_plane[:, wave].mean() > 0.5)
        _draw_wave(ax, points, longitudinal[:, wave], is_dashed=is_dashed, gid=f"wave-{wave}")
    names = ["x", "y"]
    if periods == 3:
        names = [_write_direction(direction) for direction in span]
    _set_slowness_axes(ax, 1.12 * float(slowness.max()), names)
    if colorbar:
        add_part_bar(ax, POLARISATION, _PART)
    return ax


def _read_plane(plane: ArrayLike) -> Array:
    """Return two perpendicular unit vectors (2, 3) that span the plane of two directions (2, 3);
    InputError unless ``plane`` holds two different directions in space.
    """
    mend = "Give ((1, 0, 0), (0, 1, 0))"
    directions = real_array("plane", plane)
    is_pair = directions.shape == (2, 3)
    if not is_pair or not np.all(np.isfinite(directions)) or not np.all(directions.any(axis=1)):
        why = "A plane is spanned by two directions, each three finite numbers, not all zero"
        raise InputError(f"plane is {brief(plane)}", why, mend)
    first, second = as_direction(directions, 3)
    across_first = second - (first @ second) * first
    length = float(np.linalg.norm(across_first))
    if length < _ROUNDING:
        raise InputError("the two directions of plane are parallel", mend=mend)
    return np.array([first, across_first / length])


def _draw_wave(ax: Axes, points: Array, longitudinal: Array, *, is_dashed: bool, gid: str) -> None:
    """Draw the slowness of one wave through ``points`` (n, 2), s/km, one degree apart, in the
    colours of its ``longitudinal`` part (n,); ``gid`` names the curve in an SVG file.
    """
    pieces = np.stack([points[:-1], points[1:]], axis=1)  # (n - 1, 2 ends, 2)
    fractions = 0.5 * (longitudinal[1:] + longitudinal[:-1])
    if is_dashed:
        # five pieces, of one degree each, are drawn, and five left out
        is_drawn = np.arange(len(pieces)) % 10 < 5
        pieces = pieces[is_drawn]
        fractions = fractions[is_drawn]
    lines = LineCollection(
        list(pieces),
        linewidths=1.5,
        capstyle="butt" if is_dashed else "round",
        cmap=POLARISATION,
        norm=Normalize(0, 1),
        array=fractions,
        gid=gid,
    )
    ax.add_collection(lines, autolim=False)


def _set_slowness_axes(ax: Axes, most: float, names: list[str]) -> None:
    """Draw both axes through zero, let them reach from -``most`` to ``most``, s/km, and label them
    by the ``names`` of the two directions.
    """
    for draw in (ax.axhline, ax.axvline):
        draw(0.0, color=FRAME, linewidth=0.5, zorder=0.5)
    ax.set(xlabel=f"Slowness, {names[0]} ({_LABEL})", ylabel=f"Slowness, {names[1]} ({_LABEL})")
    ax.set(xlim=(-most, most), ylim=(-most, most), aspect="equal")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10], symmetric=True))
        axis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))


def _write_direction(direction: Array) -> str:
    """Return a Cartesian ``direction`` (3,) in words, as a sum of unit vectors: "x", "x+y",
    "−x+2z", "0.6x+0.8z".

    Where all components are multiples of the smallest, whole numbers are written, else two
    decimals.
    """
    smallest = np.abs(direction[np.abs(direction) > _ROUNDING]).min()
    multiples = np.rint(direction / smallest)
    is_whole = np.allclose(direction / smallest, multiples, atol=1e-6)
    numbers = multiples if is_whole else np.round(direction, 2)
    terms = "".join(f"{x:+g}{letter}" for x, letter in zip(numbers, "xyz", strict=True) if x)
    # a factor of 1 is not written; the 1 at the end of another number, as in 11x or 0.1x, stays
    return re.sub(r"(?<![\d.])1(?=[xyz])", "", terms).removeprefix("+").replace("-", "−")


def plot_slowness_surface(
    state: Any, ax: Axes, *, view: View | None = None, colorbar: bool = True
) -> Axes:
    """Draw the three slowness surfaces of a crystal in space, coloured by the longitudinal part of
    the polarisation.

    The octant that faces the viewer is taken from the two outer surfaces, those of the slower
    waves, so that the inner surface shows. Arrows mark the Cartesian axes; the bar is a unit of
    slowness.

    Parameters
    ----------
    state : as in :func:`plot_slowness`, with three periods.
    view : the direction from which the surfaces are seen; by default the octant of positive x, y
        and z is cut.
    colorbar : whether to draw the colour bar, above the axes.

    Raises
    ------
    InputError : a ``state`` without a network, several loads, fewer than three periods, or a
        ``view`` that is no View.
    MechanismError : a motion of the lattice costs no energy.
    """
    crystal_state = as_state(state)
    periods = crystal_state.reference_lattice.periods
    if periods != 3:
        problem = f"the {crystal_state.name} has {counted(periods, 'period')}"
        raise InputError(problem, "Surfaces belong to three", "Use plot_slowness")
    # by default the octant of positive x, y, z faces the viewer
    view = read_view(view) or View(32.0, 24.0)
    directions = _make_mesh()
    slowness, longitudinal, _ = _find_slowness(crystal_state, directions.reshape(-1, 3))
    shape = (*directions.shape[:2], 3)  # three waves in each direction
    slowness = slowness.reshape(shape)
    longitudinal = longitudinal.reshape(shape)
    painter = Painter(view)
    # the signs of x, y and z in the octant that faces the viewer
    octant = np.where(view.axes[2] >= 0.0, 1.0, -1.0)
    for wave in range(3):
        points = slowness[..., wave, None] * directions
        is_outer = wave > 0  # waves are sorted from the fastest, of least slowness
        _add_surface(painter, points, longitudinal[..., wave], octant, is_outer=is_outer)
        if is_outer:
            _add_rims(painter, points, octant)
    longest = float(slowness.max())
    _add_axes(painter, ax, octant, float(slowness.min()), longest)
    painter.draw(ax, "surfaces", rasterized=True)
    low, high = painter.extent
    corner = np.array([low[0], low[1] - 0.08 * longest])
    _draw_unit(ax, corner, 10.0 ** np.floor(np.log10(longest)))
    hide_axes(ax, np.minimum(low, corner) - [0.1 * longest, 0.3 * longest], high + 0.12 * longest)
    if colorbar:
        add_part_bar(ax, POLARISATION, _PART)
    return ax


def _make_mesh() -> Array:
    """Return unit vectors (polar angles, azimuths, 3) at the points of a mesh over the sphere, of
    which some lines are the edges of octants.
    """
    polar_angles = np.linspace(0.0, np.pi, _SURFACE + 1)
    azimuths = np.linspace(0.0, 2.0 * np.pi, 2 * _SURFACE + 1)
    theta, phi = np.meshgrid(polar_angles, azimuths, indexing="ij")
    x = np.sin(theta) * np.cos(phi)
    y = np.sin(theta) * np.sin(phi)
    return np.stack([x, y, np.cos(theta)], axis=-1)


def _list_corners(values: Array) -> list[Array]:
    """Return the values at the four corners of each face of a mesh, in turn about the face, from
    values at the points of the mesh: (n, m, ...) gives four arrays (n - 1, m - 1, ...).
    """
    return [values[:-1, :-1], values[1:, :-1], values[1:, 1:], values[:-1, 1:]]


def _add_surface(
    painter: Painter, points: Array, longitudinal: Array, octant: Array, *, is_outer: bool
) -> None:
    """Add the slowness surface of a wave, a mesh of ``points`` (n, m, 3), s/km, in the colours of
    its ``longitudinal`` part (n, m).

    An outer surface lacks the ``octant`` with these signs of x, y and z, (3,); the inner surface
    lacks its far side, which is never seen.
    """
    view = painter.view
    faces = np.stack(_list_corners(points), axis=2).reshape(-1, 4, 3)
    fractions = np.mean(_list_corners(longitudinal), axis=0).ravel()
    middles = faces.mean(axis=1)
    normals = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    # the surface is about the origin: a normal points outwards if it points to its face
    outwards = np.sign(np.sum(normals * middles, axis=1))[:, None] * normals
    cosines_to_viewer = view.nearness(outwards)
    is_outside_octant = np.any(middles * octant < 0.0, axis=1)
    is_near_side = cosines_to_viewer > -0.1  # and a few faces beyond, so that no gap is left
    is_shown = is_outside_octant if is_outer else is_near_side
    # the light comes from the upper left, on the side of the viewer
    light = view.axes.T @ np.array([-0.45, 0.55, 0.7])
    brightness_outside = 0.72 + 0.28 * np.clip(outwards @ light, 0.0, 1.0)
    # the inside of a surface, seen through the cut, is darker
    brightness = np.where(cosines_to_viewer > 0.0, brightness_outside, 0.55)
    colours = np.array(POLARISATION(fractions))
    colours[:, :3] *= brightness[:, None]
    painter.add_mesh(faces[is_shown], colours[is_shown])


def _add_rims(painter: Painter, points: Array, octant: Array) -> None:
    """Add the three edges of the cut ``octant``, signs of x, y and z (3,), of a surface with the
    mesh ``points`` (n, m, 3), s/km.
    """
    # a quarter of a turn has as many steps along a meridian as along the equator
    quarter = _SURFACE // 2
    # quadrants of the azimuth, in turn from x, by the signs of x and y
    quadrants = {(1.0, 1.0): 0, (-1.0, 1.0): 1, (-1.0, -1.0): 2, (1.0, -1.0): 3}
    first = quadrants[octant[0], octant[1]] * quarter
    last = first + quarter
    upright = slice(0, quarter + 1) if octant[2] > 0.0 else slice(quarter, None)
    rims = (points[upright, first], points[upright, last], points[quarter, first : last + 1])
    for rim in rims:
        # in front of the faces that end at the rim
        nearness = float(painter.view.nearness(rim).max()) + 1e-3
        painter.add_line(rim, "black", 0.6, nearness=nearness)


def _add_axes(painter: Painter, ax: Axes, octant: Array, shortest: float, longest: float) -> None:
    """Add arrows along the Cartesian axes of the ``octant``, signs of x, y and z (3,), from the
    ``shortest`` slowness to beyond the ``longest``, s/km, and write their names.
    """
    for axis, name in enumerate("xyz"):
        tip = np.eye(3)[axis] * octant[axis] * 1.42 * longest
        start = tip * shortest / float(np.linalg.norm(tip))
        # nearer than all surfaces, which would hide the arrow
        painter.add_arrow(start, tip - start, "black", 0.016 * longest, nearness=10.0 * longest)
        x, y = painter.view.project(1.07 * tip).tolist()
        sign = "" if octant[axis] > 0.0 else "−"
        ax.annotate(
            f"{sign}{name}", (x, y), ha="center", va="center", zorder=3.0, path_effects=[HALO]
        )


def _draw_unit(ax: Axes, start: Array, unit: float) -> None:
    """Draw a horizontal bar of one ``unit`` of slowness, s/km, from ``start`` (2,), with its length
    below.
    """
    x, y = start
    ax.plot([x, x + unit], [y, y], color="black", linewidth=1.5, gid="unit")
    middle = (x + 0.5 * unit, y)
    below = (0.0, -3.0)
    ax.annotate(
        f"{unit:g} {_LABEL}", middle, below, textcoords="offset points", ha="center", va="top"
    )


def slowness_figure(state: Any, *, title: str | None = None) -> Figure:
    """Draw a figure of slowness, one column wide: the curves of a lattice in the plane; in space
    the surfaces, and two cuts beneath them.

    The cuts are spanned by x and y, and by (1, 1, 0) and z. ``title`` stands above the figure.
    ``state`` and what is raised are as in :func:`plot_slowness`.
    """
    in_space = as_state(state).reference_lattice.periods == 3
    with styled_figure(5.0 if in_space else 3.6) as figure:
        if in_space:
            rows: Any = figure.subfigures(2, 1, height_ratios=[1.75, 1.0])
            plot_slowness_surface(state, rows[0].subplots())
            for ax, plane in zip(rows[1].subplots(1, 2), _CUTS, strict=True):
                plot_slowness(state, ax, plane=plane, colorbar=False)
            dashes_of_polarisation: dict[str, Any] = {
                "polarised in the cut": "-",
                "across the cut": (0, (2.2, 2.2)),
            }
            lines = [
                Line2D([], [], color=TRANSVERSE_COLOUR, linestyle=dashes, label=name)
                for name, dashes in dashes_of_polarisation.items()
            ]
            rows[1].legend(handles=lines, loc="outside lower center", ncols=2)
        else:
            plot_slowness(state, figure.subplots())
        figure.suptitle(title or "")
    return figure
