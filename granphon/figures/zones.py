"""Drawings of the Brillouin zone, on a line, in a plane and in space, with a path through it."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from typing import Any

from granphon.figures.scales import hide_axes

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from granphon.base.errors import InputError, message
from granphon.figures.style import FRAME
from granphon.figures.views import HALO, Painter, View
from granphon.phonons.bands import Bands
from granphon.phonons.paths import zone_faces, zone_polygon

Array = NDArray[np.float64]
#: directions, degrees, among which the one is chosen from which a zone in space is seen
_AZIMUTHS, _ELEVATIONS = range(0, 360, 6), (10, 16, 22, 28)


def find_reciprocal(bands: Bands) -> Array:
    """Return the reciprocal vectors of the cell of ``bands`` as rows, (p, p), in units of 2 pi/d, for p periods."""
    return np.asarray(np.linalg.inv(bands.cell[: bands.periods, : bands.periods]).T)


def print_label(label: str) -> str:
    """Return the label of a corner as it is printed: Γ for G, and an index as a subscript."""
    parts = [re.sub(r"^([A-Z])(\d+)$", r"$\\mathrm{\1}_{\2}$", part) for part in label.split("|")]
    return "|".join("Γ" if part in ("G", "GAMMA", "Gamma") else part for part in parts)


def name_corners(ax: Axes, corners: Array, labels: Sequence[str], **options: Any) -> None:
    """Make the x axis that of a path: lines at the corners inside it, and the names of all, whose ``options`` these are."""
    for corner in corners[1:-1].tolist():
        ax.axvline(corner, color=FRAME, linewidth=0.5, zorder=0.5)
    ax.set_xticks(corners, [print_label(label) for label in labels], **options)
    ax.tick_params(axis="x", length=0)
    ax.set(xlabel="Wave vector", xlim=corners[[0, -1]])


def plot_zone(bands: Bands, ax: Axes, *, view: View | None = None) -> Axes:
    """Draw the Brillouin zone of the bands' cell, with the path and the names of its corners.

    The axes are in units of 2 pi/d and hidden. In space the zone is seen from ``view``, by default one from which the
    corners of the path lie apart on the paper and on the near side; far edges are thin and light. On a line the zone is a
    line with two ends. It is that of the periods along which the cell repeats: the zone of a ribbon is a line.

    Raises :class:`~granphon.base.errors.InputError` for a cluster, which repeats along none and has no zone.
    """
    repeats = np.asarray(bands.pbc)
    if not np.any(repeats):
        raise InputError(message("the balls repeat along no period", "A cluster has no Brillouin zone"))
    reciprocal, periods = find_reciprocal(bands), int(np.sum(repeats))
    if not np.all(repeats):  # in Cartesian axes of the vectors along which the cell repeats
        vectors = bands.cell[: bands.periods, : bands.periods][repeats]
        axes, upper = np.linalg.qr(vectors.T)
        reciprocal = np.asarray(np.linalg.inv(vectors @ (axes * np.sign(np.diag(upper)))).T)
    ends = bands.qpoints[:, [0, -1], : len(repeats)][..., repeats] @ reciprocal
    if periods == 3:
        faces = zone_faces(reciprocal)
        view = _choose_view(ends.reshape(-1, 3), faces) if view is None else view
        painter = Painter(view)  # faces are translucent, far edges thin
        near = [view.nearness(face.mean(axis=0)) > 0.0 for face in faces]
        for face, front in sorted(zip(faces, near, strict=True), key=lambda pair: pair[1]):
            look: dict[str, Any] = {"edge": "0.3", "width": 0.7, "face": (0.6, 0.75, 0.9, 0.18)}
            look = look if front else {"edge": "0.75", "width": 0.4, "face": "none"}
            painter.add_polygon(face, float(front), **look)
        painter.draw(ax, "zone")
        outline, ends = view.project(np.concatenate(faces)), view.project(ends)
    elif periods == 2:
        outline = zone_polygon(reciprocal)
        ax.add_patch(Polygon(outline, closed=True, facecolor="white", edgecolor="0.3", linewidth=0.7, gid="zone"))
    else:
        half = 0.5 * float(abs(reciprocal[0, 0]))
        outline = np.array([[-half, 0.0], [half, 0.0]])
        ends = np.concatenate([ends, np.zeros_like(ends)], axis=-1)
        bars = outline[:, None] + np.array([[0.0, -0.08], [0.0, 0.08]]) * half
        style: dict[str, Any] = {"colors": "0.3", "linewidths": 0.7}
        ax.add_collection(LineCollection([outline, *bars], **style, gid="zone"), autolim=False)
    ax.add_collection(LineCollection(list(ends), colors="black", linewidths=1.2, zorder=2.5, gid="path"), autolim=False)
    middle = outline.mean(axis=0)
    names = {print_label(bands.labels[s + e].split("|")[e - 1]): ends[s, e] for s in range(len(ends)) for e in (0, 1)}
    for name, place in names.items():
        ax.plot(*place, "o", color="black", markersize=2.2, zorder=2.6)
        away = _find_free_side(place, ends) if periods == 3 else place - middle
        if np.linalg.norm(away) <= 1e-9:
            away = middle - ends.reshape(-1, 2).mean(axis=0)
        if periods == 1:
            away = np.array([0.0, -1.0])
        if not name.startswith("("):
            x, y = (7.0 * away / max(float(np.linalg.norm(away)), 1e-9)).tolist()
            ax.annotate(
                name, place, (x, y), textcoords="offset points", ha="center",
                va="center", zorder=3.0, path_effects=[HALO],
            )  # fmt: skip
    points = np.vstack([outline, *ends])
    low, high = points.min(axis=0), points.max(axis=0)
    hide_axes(ax, low - 0.2 * np.max(high - low), high + 0.2 * np.max(high - low))
    return ax


def _find_free_side(place: Array, ends: Array) -> Array:
    """Find the direction (2,) from ``place`` in which a label is farthest from the lines of the path, ``ends`` (n, 2, 2)."""
    along = np.linspace(0.0, 1.0, 41)[:, None, None]
    lines = (ends[:, 0] + along * (ends[:, 1] - ends[:, 0])).reshape(-1, 2)
    angle = 2.0 * np.pi * np.arange(32) / 32.0
    ways = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    reach = 0.15 * float(np.ptp(lines, axis=0).max())
    distance = np.linalg.norm(place + reach * ways[:, None] - lines, axis=2).min(axis=1)
    return np.asarray(ways[np.argmax(np.round(distance, 9))])


def _choose_view(corners: Array, faces: list[Array]) -> View:
    """Choose the view in which the corners (n, 3) of a path lie far apart on the paper, on the near side, and no face is
    seen along its plane.
    """
    apart, middles = np.unique(np.round(corners, 9), axis=0), np.array([face.mean(axis=0) for face in faces])
    # the middle of a face is not always on its normal, but near enough to it
    normals = middles / np.linalg.norm(middles, axis=1, keepdims=True)
    one, two = np.triu_indices(len(apart), 1)
    best, found = -np.inf, View()
    for azimuth, elevation in itertools.product(_AZIMUTHS, _ELEVATIONS):
        view = View(azimuth, elevation)
        flat = view.project(apart)
        distance = float(np.linalg.norm(flat[one] - flat[two], axis=1).min(initial=np.inf))
        score = distance * min(float(np.abs(view.nearness(normals)).min()), 0.15)
        if score > best and view.nearness(apart).mean() >= 0.0:
            best, found = score, view
    return found
