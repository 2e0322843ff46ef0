"""Drawings of bodies in space on plain Axes, seen from afar: points are projected, and nearer
shapes are drawn later.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import granphon.figures.scales  # noqa: F401

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgba
from matplotlib.path import Path
from matplotlib.typing import ColorType
from numpy.typing import ArrayLike

from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.results import read_only
from granphon.base.validation import real_number

_Rgba = tuple[float, float, float, float]
#: white border of letters on a drawing
HALO = patheffects.withStroke(linewidth=1.5, foreground="white")
#: length of the head of an arrow, over the width of its shaft
_HEAD_LENGTH = 3.6


def read_angle(name: str, value: Any, unit: str) -> float:
    """Return the ``value`` of an angle as a float. InputError for what is no finite number; the
    message has the ``name`` of the angle and its ``unit``.
    """
    angle = real_number(value)  # nan for what is no number
    if not math.isfinite(angle):
        raise InputError(f"{name} is {brief(value)}", mend=f"Give a finite number, {unit}")
    return angle


def read_view(view: Any) -> View | None:
    """Return the ``view`` that a user gives, also None, for a view by default; InputError for what
    is no view.
    """
    if view is not None and not isinstance(view, View):
        mend = "Give granphon.figures.views.View(azimuth, elevation)"
        raise InputError(f"view is {brief(view)}", mend=mend)
    chosen_view: View | None = view
    return chosen_view


@dataclass(frozen=True)
class View:
    """The direction from which a drawing is seen, in parallel projection; z is upright.

    Attributes
    ----------
    azimuth : angle of the viewer about z, from x towards y, degrees.
    elevation : angle of the viewer above the xy plane, degrees.

    Raises :class:`~granphon.base.errors.InputError` for an angle that is no finite number.
    """

    azimuth: float = -60.0
    elevation: float = 20.0

    def __post_init__(self) -> None:
        """Check the angles."""
        for name in ("azimuth", "elevation"):
            read_angle(name, getattr(self, name), "degrees")

    @cached_property
    def axes(self) -> Array:
        """(3, 3), rows, read-only: the unit vectors to the right, upwards, and towards the
        viewer.
        """
        azimuth, elevation = np.radians([self.azimuth, self.elevation])
        horizontal = np.cos(elevation)
        to_viewer = np.array(
            [horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), np.sin(elevation)]
        )
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        upwards = np.cross(to_viewer, right)
        return read_only([right, upwards, to_viewer])

    def project(self, points: ArrayLike) -> Array:
        """Project points (..., 3) on the paper, (..., 2)."""
        return np.asarray(np.asarray(points) @ self.axes[:2].T)

    def nearness(self, points: ArrayLike) -> Array:
        """Return how near to the viewer points (..., 3) are, (...), in their unit of length: larger
        numbers are nearer.
        """
        return np.asarray(np.asarray(points) @ self.axes[2])


class Painter:
    """Shapes in space, which are collected and then drawn from the farthest to the nearest."""

    def __init__(self, view: View) -> None:
        """Begin without shapes; they are seen from the direction ``view``."""
        self.view = view
        #: nearness, outline on the paper, colours of the face and the edge, and width of the edge,
        #: points, of each shape
        self._shapes: list[tuple[float, Path, _Rgba, _Rgba, float]] = []

    def add(
        self,
        nearness: float,
        path: Path,
        *,
        face: ColorType = "none",
        edge: ColorType = "none",
        width: float = 0.0,
    ) -> None:
        """Add a shape with the outline ``path`` on the paper, with the colours of its ``face`` and
        ``edge`` and the ``width`` of the edge, points. Shapes are drawn in the order of their
        ``nearness``, the nearest last; those of equal nearness in the order of their addition.
        """
        self._shapes.append((nearness, path, to_rgba(face), to_rgba(edge), width))

    def add_line(
        self, points: Array, color: ColorType, width: float, nearness: float | None = None
    ) -> None:
        """Add a line of a ``width``, points, through ``points`` (n, 3). Without ``nearness`` the
        line is as near as its points are on average.
        """
        if nearness is None:
            nearness_of_line = float(self.view.nearness(points).mean())
        else:
            nearness_of_line = nearness
        self.add(nearness_of_line, Path(self.view.project(points)), edge=color, width=width)

    def add_polygon(self, corners: Array, nearness: float, **look: Any) -> None:
        """Add a flat face with corners (n, 3); ``look`` as in :meth:`add`."""
        self.add(nearness, _close_path(self.view.project(corners)), **look)

    def add_mesh(self, corners: Array, colours: Array) -> None:
        """Add the faces of a mesh, corners (n, m, 3) and colours (n, 4), without gaps between
        them.
        """
        nearnesses = self.view.nearness(corners).mean(axis=1).tolist()
        paths = map(Path, self.view.project(corners))
        rgba = map(tuple, colours.tolist())
        for nearness, path, colour in zip(nearnesses, paths, rgba, strict=True):
            # edges of the colour of the face cover the gaps
            self._shapes.append((nearness, path, colour, colour, 0.3))

    def add_sphere(self, centre: Array, radius: float, color: ColorType) -> None:
        """Add a ball with a ``centre`` (3,) and a ``radius``, lit from the upper left."""
        nearness = float(self.view.nearness(centre))
        middle = self.view.project(centre)
        colour_of_ball = np.array(to_rgba(color))
        to_light = np.array([-1.0, 1.0])
        # Discs shrink towards the light, each a step brighter: from the whole ball, in the darkest
        # colour, to a small spot that is nearly white. Of so many discs no edge is seen.
        for fraction in np.linspace(0.0, 1.0, 15):
            shade = colour_of_ball.copy()
            shade[:3] *= 0.6 + 0.4 * np.sqrt(fraction)
            shade[:3] += (1.0 - shade[:3]) * 0.6 * fraction**2
            x, y = (middle + radius * 0.36 * fraction * to_light).tolist()
            disc = Path.circle((x, y), radius * (1.0 - 0.95 * fraction))
            is_outermost = fraction == 0.0
            edge = "0.35" if is_outermost else "none"
            self.add(nearness, disc, face=tuple(shade), edge=edge, width=0.5)

    def add_point(self, centre: Array, radius: float, color: ColorType) -> None:
        """Add a plain disc in place of a ball, with a ``centre`` (3,) and a ``radius``."""
        x, y = self.view.project(centre).tolist()
        self.add(float(self.view.nearness(centre)), Path.circle((x, y), radius), face=color)

    def add_arrow(
        self,
        start: Array,
        along: Array,
        color: ColorType,
        width: float,
        nearness: float | None = None,
    ) -> None:
        """Add a flat arrow from ``start`` (3,) by ``along`` (3,), with a shaft of ``width``, in
        units of length; the arrow is as near as its middle unless ``nearness`` is given. An arrow
        whose length on the paper is below ``width`` is left out.
        """
        if nearness is None:
            nearness_of_arrow = float(self.view.nearness(start + 0.5 * along))
        else:
            nearness_of_arrow = nearness
        tail = self.view.project(start)
        arrow = self.view.project(along)
        length = float(np.linalg.norm(arrow))
        if length < width:
            return  # too short to be seen, or nearly along the line of sight
        direction = arrow / length
        normal = np.array([-direction[1], direction[0]])
        # an arrow that is short on the paper keeps its shape, and is drawn smaller
        head_length = min(_HEAD_LENGTH * width, 0.6 * length)
        half_shaft = 0.5 * head_length / _HEAD_LENGTH
        half_head = 1.7 * head_length / _HEAD_LENGTH
        neck = length - head_length
        # the seven corners, from the tail along one side to the tip and back
        along_arrow = [0.0, neck, neck, length, neck, neck, 0.0]
        across_arrow = [
            -half_shaft,
            -half_shaft,
            -half_head,
            0.0,
            half_head,
            half_shaft,
            half_shaft,
        ]
        outline = tail + np.outer(along_arrow, direction) + np.outer(across_arrow, normal)
        path = _close_path(outline)
        self.add(nearness_of_arrow, path, face=color, edge="white", width=0.25)

    def draw(self, ax: Axes, gid: str, *, fade: float = 0.0, **options: Any) -> PathCollection:
        """Draw all shapes as one collection of paths, named ``gid`` in an SVG file, and return the
        collection; the part ``fade`` of the farthest colour is white. ``options`` are those of
        ``PathCollection``.
        """
        shapes = sorted(self._shapes, key=lambda shape: shape[0])
        nearnesses, paths, faces, edges, widths = zip(*shapes, strict=True)
        nearest = nearnesses[-1]
        depth = max(nearest - nearnesses[0], 1e-9)  # above zero where all are equally near
        # of each shape, (n, 1)
        white_parts = fade * (nearest - np.array(nearnesses)[:, None]) / depth
        look: dict[str, Any] = {
            "linewidths": widths,
            "capstyle": "round",
            "joinstyle": "round",
            "gid": gid,
        }
        for name, colours in (("facecolors", faces), ("edgecolors", edges)):
            rgba = np.array(colours)
            rgba[:, :3] += white_parts * (1.0 - rgba[:, :3])
            look[name] = rgba
        collection = PathCollection(list(paths), **look, **options)
        ax.add_collection(collection, autolim=False)
        return collection

    @property
    def extent(self) -> tuple[Array, Array]:
        """The lowest and highest coordinates on the paper, (2,) and (2,)."""
        points = np.concatenate([path.vertices for _, path, *_ in self._shapes])
        return points.min(axis=0), points.max(axis=0)


def _close_path(corners: Array) -> Path:
    """Return the closed outline through corners (n, 2) on the paper."""
    return Path(np.vstack([corners, corners[:1]]), closed=True)
