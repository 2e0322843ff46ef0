"""Drawings of bodies in space on plain Axes, seen from afar: points are projected, and nearer
shapes are drawn later.
"""

from __future__ import annotations

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

_Rgba = tuple[float, float, float, float]
#: white border of letters on a drawing
HALO = patheffects.withStroke(linewidth=1.5, foreground="white")
#: length of the head of an arrow, over the width of its shaft
_HEAD_LENGTH = 3.6


@dataclass(frozen=True)
class View:
    """The direction from which a drawing is seen, in parallel projection; z is upright.

    Attributes
    ----------
    azimuth : angle of the viewer about z, from x towards y, degrees.
    elevation : angle of the viewer above the xy plane, degrees.
    """

    azimuth: float = -60.0
    elevation: float = 20.0

    @cached_property
    def axes(self) -> Array:
        """(3, 3), rows: the unit vectors to the right, upwards, and towards the viewer."""
        a, e = np.radians([self.azimuth, self.elevation])
        toward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        return np.array([right, np.cross(toward, right), toward])

    def project(self, points: ArrayLike) -> Array:
        """Project points (..., 3) on the paper, (..., 2)."""
        return np.asarray(np.asarray(points) @ self.axes[:2].T)

    def nearness(self, points: ArrayLike) -> Array:
        """Return how near to the viewer points (..., 3) are, (...)."""
        return np.asarray(np.asarray(points) @ self.axes[2])


class Painter:
    """Shapes in space, which are collected and then drawn from the farthest to the nearest."""

    def __init__(self, view: View) -> None:
        self.view = view
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
        """Add a shape on the paper; of shapes with equal nearness the later one is drawn later."""
        self._shapes.append((nearness, path, to_rgba(face), to_rgba(edge), width))

    def add_line(
        self, points: Array, color: ColorType, width: float, nearness: float | None = None
    ) -> None:
        """Add a line through points (n, 3), as near as their mean unless ``nearness`` is given."""
        depth = float(self.view.nearness(points).mean()) if nearness is None else nearness
        self.add(depth, Path(self.view.project(points)), edge=color, width=width)

    def add_polygon(self, corners: Array, nearness: float, **look: Any) -> None:
        """Add a flat face with corners (n, 3); ``look`` as in add."""
        flat = self.view.project(corners)
        self.add(nearness, Path(np.vstack([flat, flat[:1]]), closed=True), **look)

    def add_mesh(self, corners: Array, colours: Array) -> None:
        """Add the faces of a mesh, corners (n, m, 3) and colours (n, 4), without gaps between
        them.
        """
        depths = self.view.nearness(corners).mean(axis=1).tolist()
        paths = map(Path, self.view.project(corners))
        rgba = map(tuple, colours.tolist())
        self._shapes += [
            (depth, path, colour, colour, 0.3)
            for depth, path, colour in zip(depths, paths, rgba, strict=True)
        ]

    def add_sphere(self, centre: Array, radius: float, color: ColorType) -> None:
        """Add a ball lit from the upper left."""
        depth = float(self.view.nearness(centre))
        middle = self.view.project(centre)
        base = np.array(to_rgba(color))
        for fraction in np.linspace(0.0, 1.0, 15):
            # discs that shrink towards the light, each a step brighter
            shade = base * [*[0.6 + 0.4 * np.sqrt(fraction)] * 3, 1.0]
            shade[:3] += (1.0 - shade[:3]) * 0.6 * fraction**2
            across, up = (middle + radius * 0.36 * fraction * np.array([-1.0, 1.0])).tolist()
            disc = Path.circle((across, up), radius * (1.0 - 0.95 * fraction))
            self.add(
                depth,
                disc,
                face=tuple(shade),
                edge="0.35" if fraction == 0.0 else "none",
                width=0.5,
            )

    def add_arrow(
        self,
        start: Array,
        along: Array,
        color: ColorType,
        width: float,
        nearness: float | None = None,
    ) -> None:
        """Add a flat arrow from ``start`` (3,) by ``along`` (3,), with a shaft of ``width``, in
        units of length.
        """
        depth = float(self.view.nearness(start + 0.5 * along)) if nearness is None else nearness
        tail = self.view.project(start)
        shaft = self.view.project(along)
        length = float(np.linalg.norm(shaft))
        if length < width:
            return  # the arrow points along the line of sight
        x = shaft / length
        y = np.array([-x[1], x[0]])
        # an arrow that is short on the paper keeps its shape, and is drawn smaller
        head = min(_HEAD_LENGTH * width, 0.6 * length)
        half = 0.5 * head / _HEAD_LENGTH
        wing = 1.7 * head / _HEAD_LENGTH
        neck = length - head
        along_x = [0.0, neck, neck, length, neck, neck, 0.0]
        along_y = [-half, -half, -wing, 0.0, wing, half, half]
        outline = tail + np.outer(along_x, x) + np.outer(along_y, y)
        self.add(
            depth,
            Path(np.vstack([outline, outline[:1]]), closed=True),
            face=color,
            edge="white",
            width=0.25,
        )

    def draw(self, ax: Axes, gid: str, *, fade: float = 0.0, **options: Any) -> PathCollection:
        """Draw all shapes as one collection of paths; the part ``fade`` of the farthest colour is
        white.
        """
        depths, paths, faces, edges, widths = zip(
            *sorted(self._shapes, key=lambda shape: shape[0]), strict=True
        )
        white = fade * (depths[-1] - np.array(depths)[:, None]) / max(depths[-1] - depths[0], 1e-9)
        look: dict[str, Any] = {
            "linewidths": widths,
            "capstyle": "round",
            "joinstyle": "round",
            "gid": gid,
        }
        for name, colours in (("facecolors", faces), ("edgecolors", edges)):
            rgba = np.array(colours)
            rgba[:, :3] += white * (1.0 - rgba[:, :3])
            look[name] = rgba
        drawn = PathCollection(list(paths), **look, **options)
        ax.add_collection(drawn, autolim=False)
        return drawn

    @property
    def extent(self) -> tuple[Array, Array]:
        """The lowest and highest coordinates on the paper, (2,) and (2,)."""
        points = np.concatenate([path.vertices for _, path, *_ in self._shapes])
        return points.min(axis=0), points.max(axis=0)
