"""Balls in space as shaded spheres, with the contacts between them, and with arrows of their motion or turned marks."""

from __future__ import annotations

from granphon.figures.scales import hide_axes

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from granphon.figures.style import VERMILION
from granphon.figures.views import Painter, View

Array = NDArray[np.float64]
#: colours of balls, of the lines that join balls in contact, and of marks on balls
_BALL, _CONTACT, _MARK = "0.93", "0.62", "0.3"
#: part of white in the colours of what is farthest from the viewer
_FADE = 0.55
#: width of the shaft of an arrow, in diameters
_SHAFT = 0.055
#: spins and displacements below this part of a diameter are not drawn
_LEAST = 0.01


def draw_spheres(
    ax: Axes, view: View, centres: Array, radii: Array, pairs: NDArray[np.intp], shift: Array, turn: Array, gyration: Array
) -> Painter:
    """Draw balls with arrows: black for the displacement, vermilion for the rotation, which is about its arrow.

    An arrow starts at the surface of its ball, so that its length is all seen. The arc with a head shows the angle through
    which the surface has turned, on the side of the viewer; looking along the arrow, the ball turns clockwise.

    Parameters
    ----------
    centres, radii : (n, 3) and (n,), of the balls as drawn, in diameters.
    pairs : (m, 2) indices of balls in contact.
    shift, turn : (n, 3) displacements, and angles in rad about the three axes.
    gyration : (n,) lengths of the arrows of one rad, in diameters.
    """
    painter = Painter(view)
    _join(painter, centres, radii, pairs)
    for centre, radius, u, phi, scale in zip(centres, radii, shift, turn, gyration, strict=True):
        painter.add_sphere(centre, radius, _BALL)
        for arrow, colour in ((u, "black"), (scale * phi, VERMILION)):
            length = float(np.linalg.norm(arrow))
            if length > _LEAST:
                painter.add_arrow(centre + radius / length * arrow, arrow, colour, _SHAFT)
        if scale * np.linalg.norm(phi) > _LEAST:
            _add_arc(painter, centre, 1.03 * radius, phi)
    _finish(ax, painter, centres, radii)
    return painter


def draw_moved_spheres(
    ax: Axes, view: View, centres: Array, radii: Array, pairs: NDArray[np.intp], shift: Array, turn: Array
) -> Painter:
    """Draw balls where they have moved; three great circles on each show how it has turned. Arguments as above."""
    # imported here, as only a ball that turns needs it
    from scipy.spatial.transform import Rotation

    painter = Painter(view)
    _join(painter, centres + shift, radii, pairs)
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    rings = np.stack([np.roll(ring, axis, axis=1) for axis in range(3)])
    for centre, radius, u, phi in zip(centres, radii, shift, turn, strict=True):
        painter.add_sphere(centre + u, radius, _BALL)
        for circle in rings @ Rotation.from_rotvec(phi).as_matrix().T:
            seen = np.flatnonzero(view.nearness(circle) >= 0.0)
            for part in np.split(seen, np.flatnonzero(np.diff(seen) > 1) + 1):
                if len(part) > 1:
                    nearness = float(view.nearness(centre + u))
                    painter.add_line(centre + u + radius * circle[part], _MARK, 0.5, nearness=nearness)
    _finish(ax, painter, centres, radii)
    return painter


def _join(painter: Painter, centres: Array, radii: Array, pairs: NDArray[np.intp]) -> None:
    """Add a line for each contact, from surface to surface of the two balls as drawn."""
    for i, j in pairs:
        way = centres[j] - centres[i]
        way = way / np.linalg.norm(way)
        painter.add_line(np.array([centres[i] + radii[i] * way, centres[j] - radii[j] * way]), _CONTACT, 1.0)


def _add_arc(painter: Painter, centre: Array, radius: float, phi: Array) -> None:
    """Add the arc through which a point of the surface, on the side of the viewer, is turned by ``phi``, with a head."""
    toward, angle = painter.view.axes[2], float(np.linalg.norm(phi))
    axis = phi / angle
    front = toward - (toward @ axis) * axis
    if np.linalg.norm(front) < 1e-3:  # it turns about the line of sight
        front = painter.view.axes[1] - (painter.view.axes[1] @ axis) * axis
    front = front / np.linalg.norm(front)
    side = np.cross(axis, front)
    angles = angle * np.linspace(-0.5, 0.5, 25)
    arc = centre + radius * (np.cos(angles)[:, None] * front + np.sin(angles)[:, None] * side)
    near = float(painter.view.nearness(centre)) + 1e-3 * radius
    painter.add_line(arc, VERMILION, 1.1, nearness=near)
    end = angles[-1]
    tangent = -np.sin(end) * front + np.cos(end) * side
    head = 0.5 * radius
    painter.add_arrow(arc[-1] - 0.4 * head * tangent, head * tangent, VERMILION, 0.25 * head, nearness=near)


def _finish(ax: Axes, painter: Painter, centres: Array, radii: Array) -> None:
    painter.draw(ax, "spheres", fade=_FADE)
    low, high = painter.extent
    hide_axes(ax, low - 0.05, high + 0.05)
