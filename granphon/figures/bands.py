"""Figures of bands and densities of states, and of the Brillouin zone with the path of the bands.

Every function draws on an Axes and returns the Axes; units change only in figures. The global state
of matplotlib is not changed, and no window is needed: :func:`bands_figure` makes a plain
``matplotlib.figure.Figure``, which :func:`~granphon.figures.style.save_figure` saves. Translation
is dark blue and rotation orange, on a scale that is uniform to the eye, in grey as well.

In the shapes of arrays, s counts the segments of the path, p the points of a segment, and b the
branches.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from typing import Any

from granphon.figures.scales import (
    POLARISATION,
    ROTATION,
    STANDARD_ERROR,
    add_part_bar,
    count_columns,
    draw_error_band,
    find_axis,
    hide_axes,
    make_error_handle,
    name_errors,
    read_errors,
    styled_figure,
)

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from granphon.base.arrays import Array, Flags
from granphon.base.errors import InputError, brief
from granphon.base.scales import HertzPrefix
from granphon.base.validation import positive, real_array
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.figures.style import BLUE, FRAME, VERMILION, write_hertz
from granphon.figures.views import HALO, Painter, View, read_view
from granphon.observables.velocities import SoundVelocities
from granphon.phonons.bands import Bands
from granphon.phonons.dos import DensityOfStates
from granphon.phonons.paths import zone_faces, zone_polygon

Asymptotes = SoundVelocities | ContactLattice

#: looks of the lines of long waves
_LONG_WAVES: dict[str, Any] = {
    "color": "black",
    "linewidth": 0.8,
    "dashes": (3.5, 1.8),
    "zorder": 3.0,
}
#: greatest number of letters in a legend of one row
_LETTERS_OF_ROW = 32
#: colour of a gap between the branches
_GAP = "0.9"
#: colour of the standard errors of branches, behind lines of any colour
_ERRORS = "0.35"
#: colours of energy at the lower edge of a cut, at the upper edge, and inside
_EDGES = (BLUE, VERMILION, "0.75")
#: part of the energy of a wave spread evenly that is in the lower or the upper quarter of a cut
_EVEN_PART = 0.25
#: part of the energy in both of these quarters, from which on modes are waves of the edges
_EDGE_PART = 0.75
#: lengths of directions, and fractions of a wave vector, below this are rounding of zero
_ROUNDING = 1e-9
#: distance of the name of a corner of the zone from the corner, points
_NAME_DISTANCE = 7.0
#: distance of a label from its corner in the search for a free direction, in parts of the path's
#: extent
_LABEL_DISTANCE = 0.15
#: height of the bar at an end of a zone on a line, over half the zone
_BAR = 0.08
#: the least slope of faces of a zone against the view beyond which more slope is no better
_ENOUGH_NEARNESS = 0.15
#: part of the path below which the labels of neighbouring corners are one above the other
_LEAST_SPACING = 0.1
#: distance of an inset from the lines, in parts of the axes: the least, and that beyond which more
#: distance is no better
_LEAST_CLEARANCE = 0.01
_ENOUGH_CLEARANCE = 0.06
#: distance of an inset at the top from the lines beneath, in parts of the axes
_TOP_CLEARANCE = 0.02
#: frequencies closer than this part of the highest one are one line in print
_ONE_LINE = 1e-6
#: width of a line, and of branches that are zero, in points, and the number of coinciding branches
#: that widen the lower ones
_WIDTH = 1.5
_WIDTH_OF_ZERO = 0.6
_MOST_WIDENED = 3
#: greatest number of branches whose lines have this width, as they cover a third of the height of a
#: column; and the least part of the width, with which a line is still printed
_MOST_WIDE_BRANCHES = 30
_LEAST_PART = 0.15
#: sides of the inset of the zone, in parts of the axes, large first; side above the lines, and its
#: distance from the frame
_INSETS = (0.3, 0.25)
_TOP_INSET = 0.22
_MARGIN = 0.05
#: a density of states whose greatest value is larger than this multiple of its quantile has peaks
#: of flat branches
_QUANTILE = 0.98
_PEAK = 6.0


def find_reciprocal(bands: Bands) -> Array:
    """Return the reciprocal vectors of the cell of ``bands`` as rows, (periods, periods), in units
    of 2 pi/d.
    """
    return np.asarray(np.linalg.inv(bands.cell[: bands.periods, : bands.periods]).T)


def write_corner(label: str) -> str:
    """Return the ``label`` of a corner as it stands in a figure: Γ for G, GAMMA and Gamma, and the
    number after a capital letter as a subscript. The label of a jump, such as "K|M", has two names,
    each written in this way.
    """
    names_in_figure = []
    for name in label.split("|"):
        if name in ("G", "GAMMA", "Gamma"):
            names_in_figure.append("Γ")
        else:
            names_in_figure.append(re.sub(r"^([A-Z])(\d+)$", r"$\\mathrm{\1}_{\2}$", name))
    return "|".join(names_in_figure)


def name_corners(ax: Axes, corners: Array, labels: Sequence[str], **options: Any) -> None:
    """Make the x axis that of a path, with lines at the corners inside the path, and the names of
    all corners. ``corners`` (n,) are distances along the path, ``labels`` their n labels, and
    ``options`` those of the names as texts of matplotlib.
    """
    for corner in corners[1:-1].tolist():
        ax.axvline(corner, color=FRAME, linewidth=0.5, zorder=0.5)
    ax.set_xticks(corners, [write_corner(label) for label in labels], **options)
    ax.tick_params(axis="x", length=0)
    ax.set(xlabel="Wave vector", xlim=corners[[0, -1]])


def plot_zone(bands: Bands, ax: Axes, *, view: View | None = None) -> Axes:
    """Draw the Brillouin zone of the bands' cell, with the path and the names of its corners.

    The axes are in units of 2 pi/d and hidden. In space the zone is seen from ``view``, by default
    a view in which the corners of the path lie apart on the paper and on the near side; far edges
    are thin and light. The zone has the periods along which the cell repeats: that of a chain or a
    ribbon is a line with two ends.

    Raises :class:`~granphon.base.errors.InputError` for a cluster, which repeats along no period
    and has no zone, and for a ``view`` that is no View. A zone on a line or in a plane looks the
    same from every ``view``.
    """
    chosen_view = read_view(view)
    repeats = np.asarray(bands.pbc)  # of each vector of the cell
    if not np.any(repeats):
        raise InputError("the balls repeat along no period", "A cluster has no Brillouin zone")
    periods = int(np.sum(repeats))
    reciprocal = _find_reciprocal_of_periods(bands, repeats)
    ends_of_segments = bands.qpoints[:, [0, -1], : len(repeats)]
    # (segments, 2, periods): both ends of each segment of the path, in units of 2 pi/d
    ends = ends_of_segments[..., repeats] @ reciprocal
    if periods == 3:
        faces = zone_faces(reciprocal)
        view_of_zone = chosen_view or _choose_view(ends.reshape(-1, 3), faces)
        outline = _draw_zone_in_space(ax, faces, view_of_zone)
        paper_ends = view_of_zone.project(ends)
    elif periods == 2:
        outline = zone_polygon(reciprocal)
        style: dict[str, Any] = {"facecolor": "white", "edgecolor": "0.3", "linewidth": 0.7}
        ax.add_patch(Polygon(outline, closed=True, **style, gid="zone"))
        paper_ends = ends
    else:
        outline = _draw_zone_on_line(ax, 0.5 * float(abs(reciprocal[0, 0])))
        paper_ends = np.concatenate([ends, np.zeros_like(ends)], axis=-1)
    path = LineCollection(list(paper_ends), colors="black", linewidths=1.2, zorder=2.5, gid="path")
    ax.add_collection(path, autolim=False)
    _name_corners_of_zone(ax, bands.labels, paper_ends, outline, periods)
    points = np.vstack([outline, *paper_ends])
    low = points.min(axis=0)
    high = points.max(axis=0)
    margin = 0.2 * np.max(high - low)  # room for the names
    hide_axes(ax, low - margin, high + margin)
    return ax


def _find_reciprocal_of_periods(bands: Bands, repeats: Flags) -> Array:
    """Return the reciprocal vectors (periods, periods) of the vectors along which the cell
    repeats, as rows in units of 2 pi/d. ``repeats`` says which vectors do. If not all do, the
    components are along perpendicular axes that the repeating vectors span.
    """
    if np.all(repeats):
        return find_reciprocal(bands)
    vectors = bands.cell[: bands.periods, : bands.periods][repeats]
    orthogonal, upper = np.linalg.qr(vectors.T)
    # the signs of a QR factorisation are arbitrary: the first axis points along the first vector
    axes = orthogonal * np.sign(np.diag(upper))
    return np.asarray(np.linalg.inv(vectors @ axes).T)


def _draw_zone_in_space(ax: Axes, faces: list[Array], view: View) -> Array:
    """Draw the ``faces`` of a zone, each with its corners (n, 3) in units of 2 pi/d; return the
    corners of all faces on the paper, (m, 2).
    """
    painter = Painter(view)
    # near faces are translucent, so that far edges, which are thin, can be seen
    near_look: dict[str, Any] = {"edge": "0.3", "width": 0.7, "face": (0.6, 0.75, 0.9, 0.18)}
    far_look: dict[str, Any] = {"edge": "0.75", "width": 0.4, "face": "none"}
    for face in faces:
        is_near = view.nearness(face.mean(axis=0)) > 0.0
        look = near_look if is_near else far_look
        painter.add_polygon(face, float(is_near), **look)
    painter.draw(ax, "zone")
    return view.project(np.concatenate(faces))


def _draw_zone_on_line(ax: Axes, half: float) -> Array:
    """Draw a zone from -``half`` to ``half``, in units of 2 pi/d, with a bar at each end; return
    its ends (2, 2).
    """
    outline = np.array([[-half, 0.0], [half, 0.0]])
    bars = outline[:, None] + np.array([[0.0, -_BAR], [0.0, _BAR]]) * half
    lines = LineCollection([outline, *bars], colors="0.3", linewidths=0.7, gid="zone")
    ax.add_collection(lines, autolim=False)
    return outline


def _find_name_direction(corner: Array, ends: Array, middle: Array, periods: int) -> Array:
    """Return the direction (2,) on the paper, of any length, from a ``corner`` (2,) of a path to
    its name. With three ``periods`` the name is away from the segments of the path, whose ends are
    ``ends`` (n, 2, 2); with two, away from the ``middle`` (2,) of the zone; with one, below.
    """
    if periods == 1:
        return np.array([0.0, -1.0])
    direction = _find_free_direction(corner, ends) if periods == 3 else corner - middle
    if np.linalg.norm(direction) > _ROUNDING:
        return direction
    # the corner is the middle of the zone: its name stands on the other side of the path
    middle_of_path: Array = ends.reshape(-1, 2).mean(axis=0)
    return middle - middle_of_path


def _name_corners_of_zone(
    ax: Axes, labels: Sequence[str], ends: Array, outline: Array, periods: int
) -> None:
    """Draw a dot at each corner of a path, and its name unless its label has fractions alone. On
    the paper the segments of the path have the ``ends`` (n, 2, 2), and the zone has an ``outline``
    with the corners (m, 2).
    """
    corners = {}  # places (2,) by the names in the figure
    for segment, (start, end) in enumerate(ends):
        # at a jump "K|M" a segment ends at K, and the next segment starts at M
        name_of_start = labels[segment].split("|")[-1]
        name_of_end = labels[segment + 1].split("|")[0]
        corners[write_corner(name_of_start)] = start
        corners[write_corner(name_of_end)] = end
    middle = outline.mean(axis=0)
    for name, corner in corners.items():
        ax.plot(*corner, "o", color="black", markersize=2.2, zorder=2.6)
        if name.startswith("("):  # fractions of a corner that has no name
            continue
        direction = _find_name_direction(corner, ends, middle, periods)
        length = max(float(np.linalg.norm(direction)), _ROUNDING)
        x, y = (_NAME_DISTANCE * direction / length).tolist()
        ax.annotate(
            name,
            corner,
            (x, y),
            textcoords="offset points",
            ha="center",
            va="center",
            zorder=3.0,
            path_effects=[HALO],
        )


def _find_free_direction(corner: Array, ends: Array) -> Array:
    """Return the direction (2,) from a ``corner`` (2,) on the paper in which a label is farthest
    from the lines of the path. The segments of the path have the ``ends`` (n, 2, 2).
    """
    steps = np.linspace(0.0, 1.0, 41)[:, None, None]
    points = (ends[:, 0] + steps * (ends[:, 1] - ends[:, 0])).reshape(-1, 2)  # along all segments
    angles = 2.0 * np.pi * np.arange(32) / 32.0
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    extent = float(np.ptp(points, axis=0).max())
    label_offsets = _LABEL_DISTANCE * extent * directions[:, None]  # (32, 1, 2)
    distances = np.linalg.norm(corner + label_offsets - points, axis=2).min(axis=1)  # (32,)
    # rounded, so that of equal distances the first is taken on every machine
    return np.asarray(directions[np.argmax(np.round(distances, 9))])


def _choose_view(corners: Array, faces: list[Array]) -> View:
    """Return the view in which the corners (n, 3) of a path are seen best: far apart on the paper,
    and on the near side. Views along the plane of one of the ``faces``, each with its corners
    (m, 3), count as bad.
    """
    distinct_corners = np.unique(np.round(corners, 9), axis=0)
    middles = np.array([face.mean(axis=0) for face in faces])
    # the middle of a face lies near the normal through the centre of the zone
    normals = middles / np.linalg.norm(middles, axis=1, keepdims=True)
    first, second = np.triu_indices(len(distinct_corners), 1)  # all pairs of corners
    best_score = -np.inf
    best_view = View()
    for azimuth, elevation in itertools.product(range(0, 360, 6), (10, 16, 22, 28)):  # degrees
        view = View(azimuth, elevation)
        paper_corners = view.project(distinct_corners)
        distances = np.linalg.norm(paper_corners[first] - paper_corners[second], axis=1)
        least_distance = float(distances.min(initial=np.inf))
        least_nearness = float(np.abs(view.nearness(normals)).min())
        score = least_distance * min(least_nearness, _ENOUGH_NEARNESS)
        are_corners_near = view.nearness(distinct_corners).mean() >= 0.0
        if score > best_score and are_corners_near:
            best_score = score
            best_view = view
    return best_view


def plot_bands(
    bands: Bands,
    ax: Axes,
    *,
    asymptotes: Asymptotes | None = None,
    gaps: ArrayLike | None = None,
    bulk: ArrayLike | None = None,
    edges: bool = False,
    errors: ArrayLike | None = None,
    unit: HertzPrefix | None = None,
    colorbar: bool = True,
) -> Axes:
    """Draw bands, each branch followed through its crossings and coloured by its rotational
    fraction, or, where no ball rotates, by its longitudinal fraction.

    With ``edges``, and if the bands have no eigenvectors, branches are not followed through their
    crossings, but drawn in ascending order of frequency. Without ``edges``, the branches of bands
    without eigenvectors, and of balls with a single motion, have one colour.

    Each segment of the path has a LineCollection for each branch: piece i runs through point i of
    the segment, and has the colour of the point. Where branches coincide the lower one is drawn
    wider, so that all remain visible. If there are more than 30 branches, lines are thinner; with
    ``edges`` the waves of the edges keep the width of a line.

    Parameters
    ----------
    asymptotes : velocities of sound, or the lattice, whose long waves are drawn too, see
        :func:`plot_asymptotes`.
    gaps : (n, 2) intervals without a branch, Hz, such as those of ``Phonons.gaps()``, which are
        shaded.
    bulk : (s, p, b, 2) lowest and highest frequency of each branch of the crystal at each point,
        Hz, such as ``[surface.continuum(segment) for segment in bands.qpoints]``: a grey field
        behind the bands of a cut.
    edges : whether colours are those of the energy at the lower edge and at the upper edge of a
        cut, mixed with grey, which the legend names.
    errors : (s, p, b) standard errors of the frequencies, Hz, in ascending order of these, as the
        variable ``frequencies_error`` of a data set has them, also with further axes of length 1: a
        grey field about each branch.
    unit : unit of frequency; by default the decimal unit of hertz in which the top frequency lies
        between 1 and 1000.
    colorbar : whether to draw above the axes the bar of the colours, where branches are coloured by
        their fraction; there is none with ``edges``, nor where branches have one colour.

    Raises :class:`~granphon.base.errors.InputError` for ``gaps``, ``bulk`` or ``errors`` of another
    shape, gaps that are not finite, ``edges`` of bands of no cut, a ``unit`` that is no
    HertzPrefix, and what :func:`plot_asymptotes` raises.
    """
    unit = _read_unit(unit, bands)
    # the eigenvectors that connect branches do not tell coinciding waves of two edges apart
    is_followed = bands.eigenvectors is not None and not edges
    hertz = bands.connected_frequencies if is_followed else bands.frequencies
    frequencies = hertz / unit.hertz  # (s, p, b)
    # where balls have a single motion every branch would have the same colour
    has_colours = is_followed and bands.motions.count > 1
    shades = {}
    is_wide = np.zeros(frequencies.shape, bool)
    if edges:
        weight = _spread_flat_bands(bands)
        shades = _shade_by_edges(bands, weight)
        is_wide = weight.sum(axis=-1) > _EDGE_PART
    elif has_colours:
        shades = _shade_by_fraction(bands)
    if bulk is not None:
        _draw_bulk(bands, ax, real_array("bulk", bulk), unit)
    if errors is not None:
        branch_errors = read_errors(errors, frequencies.shape) / unit.hertz
        if is_followed:
            branch_errors = np.take_along_axis(branch_errors, bands.connection, 2)
        _draw_errors(bands, ax, frequencies, branch_errors)
    top = float(frequencies.max()) or 1.0  # if all branches are zero, any height will do
    least_difference = _ONE_LINE * top
    for s, x in enumerate(bands.distances):
        widths = _find_line_widths(frequencies[s], least_difference, is_wide[s])
        for b in range(bands.n_branches):
            shade = shades.get((s, b), {"colors": BLUE})
            _draw_branch(ax, x, frequencies[s, :, b], widths[:, b], gid=f"band-{s}-{b}", **shade)
    ax.axhline(0.0, color=FRAME, linewidth=0.5, zorder=0.5)
    _name_corners_of_bands(ax, bands)
    ax.set(ylabel=f"Frequency ({write_hertz(unit)})", ylim=(-0.02 * top, 1.05 * top))
    if gaps is not None:
        _draw_gaps(ax, real_array("gaps", gaps), unit)
    if asymptotes is not None:
        plot_asymptotes(bands, asymptotes, ax, unit=unit)
    if edges:
        _name_colours_of_edges(ax)
    elif colorbar and has_colours:
        _add_fraction_bar(ax, bands)
    return ax


def _draw_errors(bands: Bands, ax: Axes, frequencies: Array, errors: Array) -> None:
    """Draw the standard ``errors`` of the ``frequencies`` of branches, both (s, p, b) in the unit
    of the axis, as a grey field about each branch, and name the field in the legend.
    """
    for s, b in np.ndindex(len(frequencies), bands.n_branches):
        branch = frequencies[s, :, b]
        gid = f"errors-{s}-{b}"
        draw_error_band(ax, bands.distances[s], branch, errors[s, :, b], _ERRORS, gid)
    ax.add_line(make_error_handle(frequencies, errors))


def _name_colours_of_edges(ax: Axes) -> None:
    """Name the colours of the two edges of a cut, and of its inside, in the legend, by lines that
    have no points.
    """
    for name, colour in zip(("lower edge", "upper edge", "inside"), _EDGES, strict=True):
        ax.plot([], [], color=colour, label=name)


def _add_fraction_bar(ax: Axes, bands: Bands) -> None:
    """Add the colour bar of the fraction by which branches are coloured."""
    if bands.motions.rotate:
        add_part_bar(ax, ROTATION, "Rotational part of the kinetic energy")
    else:
        add_part_bar(ax, POLARISATION, "Longitudinal part of the kinetic energy")


#: options of matplotlib that give the line of a branch its colours, by the numbers of the segment
#: and of the branch
_Shades = dict[tuple[int, int], dict[str, Any]]


def _shade_by_fraction(bands: Bands) -> _Shades:
    """Return colours by the rotational fraction of the followed branches, or by the longitudinal
    fraction where no ball rotates.
    """
    if bands.motions.rotate:
        fractions_in_order = bands.rotational_fraction
        colours = ROTATION
    else:
        fractions_in_order = bands.longitudinal_fraction
        colours = POLARISATION
    # (segments, points, branches), from the order of frequencies to that of followed branches
    fractions = np.take_along_axis(fractions_in_order, bands.connection, 2)
    shades: _Shades = {}
    for s, b in np.ndindex(len(bands.distances), bands.n_branches):
        shades[s, b] = {"array": fractions[s, :, b], "cmap": colours, "norm": Normalize(0.0, 1.0)}
    return shades


def _shade_by_edges(bands: Bands, weight: Array) -> _Shades:
    """Return colours by the parts ``weight`` (s, p, b, 2) of the energy at the two edges of a cut;
    waves of the edges are drawn last.
    """
    colours = _mix_edge_colours(weight)  # (s, p, b, 3)
    shades: _Shades = {}
    for s, b in np.ndindex(len(bands.distances), bands.n_branches):
        is_of_edge = weight[s, :, b].sum(axis=-1).max() > _EDGE_PART
        # of branches that coincide the later one, which is narrower, stands above
        shades[s, b] = {
            "colors": colours[s, :, b].clip(0.0, 1.0),
            "zorder": 2.0 + float(is_of_edge) + 0.1 * b / bands.n_branches,
        }
    return shades


def _spread_flat_bands(bands: Bands) -> Array:
    """Return the parts (s, p, b, 2) of the energy of each wave at the lower and the upper edge of
    a cut. In a flat band, where more than two branches coincide, each branch gets the mean of all,
    unless most of the energy is at the edges.

    The eigenvectors of coinciding branches are arbitrary combinations, whose energies may be
    anywhere in the cut; their mean is not arbitrary.
    """
    weight = np.array(bands.edge_weight)
    top = bands.frequencies.max()
    coincide = np.diff(bands.frequencies, axis=2) <= _ONE_LINE * top
    for s, p in np.argwhere(np.any(coincide, axis=2)):
        starts = np.flatnonzero(~coincide[s, p]) + 1
        for branches in np.split(np.arange(bands.n_branches), starts):
            mean = weight[s, p, branches].mean(axis=0)
            # two branches that coincide may be a wave at each edge: they keep their own parts
            if len(branches) > 2 and mean.sum() < _EDGE_PART:
                weight[s, p, branches] = mean
    return weight


def _draw_branch(ax: Axes, x: Array, y: Array, widths: Array, **options: Any) -> None:
    """Draw a branch through points ``x`` and ``y``, both (p,), in as many pieces with ``widths``
    (p,), in points: the line is cut half way between its points.
    """
    points = np.stack([x, y], axis=1)
    middles = 0.5 * (points[:-1] + points[1:])
    starts = np.vstack([points[:1], middles])
    ends = np.vstack([middles, points[-1:]])
    pieces = np.stack([starts, points, ends], axis=1)
    lines = LineCollection(list(pieces), linewidths=widths, capstyle="round", **options)
    ax.add_collection(lines, autolim=False)


def _name_corners_of_bands(ax: Axes, bands: Bands) -> None:
    """Name the corners of the path of the bands: long names slanted, and the two names at a jump of
    the path one above the other where corners are close.
    """
    corners = np.append(bands.distances[:, 0], bands.distances[-1, -1])
    has_long_labels = max(map(len, bands.labels)) > 5
    slant: dict[str, Any] = {"rotation": 30, "ha": "right"} if has_long_labels else {}
    name_corners(ax, corners, bands.labels, **slant)
    least_distance = np.min(np.diff(corners), initial=np.inf)
    length_of_path = corners[-1] - corners[0]
    if least_distance < _LEAST_SPACING * length_of_path:
        ax.set_xticklabels([text.get_text().replace("|", "\n") for text in ax.get_xticklabels()])


def _draw_gaps(ax: Axes, gaps: Array, unit: HertzPrefix) -> None:
    """Shade intervals without a branch, ``gaps`` (n, 2), Hz; InputError for another shape, or
    numbers that are not finite.
    """
    fault = ""
    if gaps.ndim != 2 or gaps.shape[1] != 2:
        fault = f"gaps have the shape {gaps.shape}"
    elif not np.all(np.isfinite(gaps)):
        fault = "gaps hold a number that is not finite"
    if fault:
        raise InputError(fault, mend="Give (n, 2) finite frequencies in Hz")
    style: dict[str, Any] = {"color": _GAP, "linewidth": 0.0, "zorder": 0.2}
    for number, (low, high) in enumerate((gaps / unit.hertz).tolist()):
        label = "_gap" if number else "gap"  # the legend has one entry
        ax.axhspan(low, high, **style, label=label, gid=f"gap-{number}")


def _mix_edge_colours(weight: Array) -> Array:
    """Return colours (..., 3) for parts (..., 2) of the energy at the lower and the upper edge.

    An edge has its colour in proportion to the energy beyond that of a wave spread evenly.
    """
    parts_of_edges = np.maximum(weight - _EVEN_PART, 0.0) / (1.0 - _EVEN_PART)
    part_inside = 1.0 - parts_of_edges.sum(axis=-1, keepdims=True)
    colours = np.array([to_rgb(colour) for colour in _EDGES])
    # the colours of both edges and of the inside, each times its part
    return np.asarray(np.concatenate([parts_of_edges, part_inside], axis=-1) @ colours)


def _draw_bulk(bands: Bands, ax: Axes, bulk: Array, unit: HertzPrefix) -> None:
    """Draw the lowest and the highest frequency of each branch of the crystal, as fields behind the
    ``bands`` of a cut. ``bulk`` (segments, points, branches, 2), Hz, are these frequencies at the
    points of each segment of the path of the bands; the number of branches is free. InputError for
    another shape.
    """
    shape = bands.frequencies.shape[:2]
    has_right_shape = bulk.ndim == 4 and bulk.shape[:2] == shape and bulk.shape[3] == 2
    if not has_right_shape:
        raise InputError(f"bulk has the shape {bulk.shape}", mend=f"Give {shape}, branches and 2")
    for s, b in np.ndindex(bulk.shape[0], bulk.shape[2]):
        low, high = bulk[s, :, b].T / unit.hertz
        ax.fill_between(bands.distances[s], low, high, color=_GAP, linewidth=0.0, zorder=0.1)


def _find_line_widths(frequencies: Array, least: float, is_wide: Flags) -> Array:
    """Return the widths (p, b), in points, of the lines of branches with ``frequencies`` (p, b) at
    the points of a segment.

    Lines of branches that coincide must all be seen: a branch is a step wider for each later
    branch that is closer than ``least`` both at a point and at one of its neighbours, up to
    ``_MOST_WIDENED`` steps. A branch that is at most ``least`` at all points, and so is zero, is a
    thin line. If there are more than ``_MOST_WIDE_BRANCHES`` branches, lines are thinner the more
    branches there are, down to the part ``_LEAST_PART``, except where ``is_wide`` (p, b).
    """
    differences = np.abs(frequencies[:, :, None] - frequencies[:, None, :])  # (p, b, b)
    is_close = differences <= least
    # between a point and the next, with no coinciding branches beyond the ends
    coincide_between = np.pad(is_close[1:] & is_close[:-1], ((1, 1), (0, 0), (0, 0)))
    coincide = coincide_between[1:] | coincide_between[:-1]
    n_later = np.triu(coincide, 1).sum(axis=2)  # (p, b)
    # many branches would be a solid block
    part = max(min(_MOST_WIDE_BRANCHES / frequencies.shape[1], 1.0), _LEAST_PART)
    base_widths = _WIDTH * np.where(is_wide, 1.0, part)
    widths = base_widths * (1.0 + np.minimum(n_later, _MOST_WIDENED))
    is_zero = np.all(frequencies <= least, axis=0)  # (b,)
    widths[:, is_zero] = min(_WIDTH_OF_ZERO, part * _WIDTH)
    return np.asarray(widths)


def _read_unit(unit: HertzPrefix | None, result: Bands | DensityOfStates) -> HertzPrefix:
    """Return the ``unit`` that a user gives, or for None the unit that :func:`_choose_unit` finds
    for the ``result``; InputError for what is no decimal unit of hertz.
    """
    if unit is None:
        return _choose_unit(result)
    if not isinstance(unit, HertzPrefix):
        raise InputError(f"unit is {brief(unit)}", mend='Give gp.HertzPrefix.named("kHz")')
    return unit


def _choose_unit(result: Bands | DensityOfStates) -> HertzPrefix:
    """Return the decimal unit of hertz of the highest frequency of bands, or of the highest
    frequency at which a density has states.
    """
    frequencies = result.frequencies
    if isinstance(result, DensityOfStates):
        frequencies = frequencies[result.total > 0.0]
    return HertzPrefix.for_top(float(frequencies.max()))


def plot_asymptotes(
    bands: Bands,
    velocities: Asymptotes,
    ax: Axes,
    *,
    unit: HertzPrefix | None = None,
    reach: float = 0.5,
) -> Axes:
    """Draw the long waves near Gamma, dashed: omega = v q, and the optical branch omega^2 =
    omega_0^2 (1 - c q^2), with the velocity v of each wave, and the frequency omega_0 at Gamma and
    the curvature c of the branch.

    ``velocities`` are velocities of sound at one load, found along one direction, that are the same
    in every direction of a line or a plane; or the lattice (``Phonons.lattice``), which has a
    velocity for each direction, and a rotational branch with one ball in the cell. ``unit`` is as
    in :func:`plot_bands`; ``reach`` is the part of each segment from or to Gamma along which the
    long waves are drawn. Waves without a velocity, such as flexural waves, are left out.

    Raises :class:`~granphon.base.errors.InputError` for what is neither velocities nor a lattice,
    for velocities at several loads or along several directions, for those of a crystal in space,
    for a ``reach`` that is not above zero, and for a ``unit`` that is no HertzPrefix;
    :class:`~granphon.base.errors.MechanismError` for a lattice that is a mechanism.
    """
    if not isinstance(velocities, Asymptotes):
        raise InputError(
            f"{brief(velocities)} has no long waves to draw",
            mend="Give velocities of sound, or Phonons.lattice",
        )
    part = positive("reach", reach)
    unit = _read_unit(unit, bands)
    if isinstance(velocities, SoundVelocities):
        _require_single(velocities)
    reciprocal = find_reciprocal(bands)
    if isinstance(velocities, SoundVelocities) and len(reciprocal) == 3:
        raise InputError(
            "the velocities are those of one direction",
            "In space they depend on it",
            "Give Phonons.lattice",
        )
    label = "long waves"
    # a segment may start at Gamma, and may end there: the indices of its points at Gamma and far
    # from Gamma
    for s, (near, far) in itertools.product(range(len(bands.qpoints)), ((0, -1), (-1, 0))):
        gamma = bands.qpoints[s, near]
        is_gamma = np.allclose(gamma, np.round(gamma), rtol=0.0, atol=_ROUNDING)
        if not is_gamma:
            continue
        fractions = (bands.qpoints[s, far] - gamma)[: len(reciprocal)]
        direction = fractions @ reciprocal  # in units of 2 pi/d
        q = 2.0 * np.pi * part * np.linalg.norm(direction) * np.linspace(0.0, 1.0, 101)  # 1/d
        waves = _find_long_waves(velocities, direction, q, bands.scales.velocity)
        start = bands.distances[s, near]
        x = start + np.sign(bands.distances[s, far] - start) * q / (2.0 * np.pi)
        for name, omega in waves.items():
            y = omega * bands.scales.frequency / unit.hertz
            ax.plot(x, y, **_LONG_WAVES, label=label, gid=f"asymptote-{name}-{s}")
            label = "_"  # the legend has one entry
    return ax


def _require_single(velocities: SoundVelocities) -> None:
    """Raise InputError for velocities at several loads or along several directions."""
    if velocities.direction.ndim > 1:
        raise InputError(
            "the velocities are those of several directions",
            mend="Give those of one direction, or Phonons.lattice",
        )
    if velocities.velocities.ndim > 1:
        raise InputError(
            "the velocities are those of several loads",
            mend="Give the velocities at the load of the bands",
        )


def _find_long_waves(
    velocities: Asymptotes, direction: Array, q: Array, scale: float
) -> dict[str, Array]:
    """Return the angular frequencies (n,) of long waves, in units of (k/M)^(1/2), at wave numbers
    ``q`` (n,), 1/d, along a Cartesian ``direction`` (periods,), by the names of the waves.

    ``scale``, m/s, is the velocity that is one in reduced units. Waves without a velocity are left
    out, and the optical branch is nan where its parabola is below zero.
    """
    if isinstance(velocities, SoundVelocities):
        in_si = {"longitudinal": velocities.longitudinal, "transverse": velocities.transverse}
        # None in place of a wave that the lattice does not have
        speeds = {name: speed / scale for name, speed in in_si.items() if speed is not None}
    else:
        speeds_in_order, _ = velocities.sound_velocities(direction)
        speeds = dict(zip(velocities.wave_names, speeds_in_order.tolist(), strict=True))
    greatest = max(speeds.values(), default=0.0)
    waves = {}
    for name, speed in speeds.items():
        if speed > _ROUNDING * greatest:  # a smaller one is rounding of zero
            waves[name] = speed * q
    if isinstance(velocities, ContactLattice):
        has_one_rotation = len(velocities.motions.rotations) == velocities.n_balls == 1
        # where contacts resist rolling or twist alone the rotational branch begins at zero
        at_gamma = velocities.frequencies(np.zeros((1, velocities.periods)))
        if has_one_rotation and np.any(at_gamma > 0.0):
            squared, curvature = velocities.optical_branch(direction)
            decrease = 1.0 - curvature * q**2
            # the parabola ends where it would fall below zero
            waves["optical"] = np.sqrt(squared * np.where(decrease >= 0.0, decrease, np.nan))
    return waves


def plot_dos(
    dos: DensityOfStates,
    ax: Axes,
    *,
    horizontal: bool = True,
    unit: HertzPrefix | None = None,
    errors: Mapping[str, ArrayLike] | None = None,
) -> Axes:
    """Draw the density of states per ball: its translational and rotational part filled, the total
    as a line.

    ``horizontal`` draws the density to the right and the frequency upwards, to stand beside bands;
    otherwise the frequency is to the right. ``unit`` of frequency is as in :func:`plot_bands`. The
    lines are labelled for a legend. An axis of frequency that is shared with a neighbour, as in
    ``subplots(1, 2, sharey=True)``, has no label. If peaks of flat branches would hide the rest of
    the density, the axis of the density ends below the peaks, and its label gives their height. The
    standard errors (n,), 1/Hz, of the total under "total" in ``errors``, nan where unknown, are a
    grey field about the line; ``errors`` of other names are not drawn.

    Raises :class:`~granphon.base.errors.InputError` for ``errors`` that are no mapping, a total of
    another shape there, and a ``unit`` that is no HertzPrefix.
    """
    unit = _read_unit(unit, dos)
    frequency = dos.frequencies / unit.hertz
    fill = ax.fill_betweenx if horizontal else ax.fill_between
    curves: dict[str, tuple[Array, Any]] = {"total": (dos.total, "black")}
    if np.any(dos.rotational > 0.0):
        curves = {
            "translation": (dos.translational, ROTATION(0.0)),
            "rotation": (dos.rotational, ROTATION(1.0)),
            **curves,
        }
    for name, (states_per_hertz, colour) in curves.items():
        density = states_per_hertz * unit.hertz
        line_width = 0.7
        if name != "total":
            fill(frequency, density, color=colour, alpha=0.25, linewidth=0.0)
            line_width = 1.0
        x, y = (density, frequency) if horizontal else (frequency, density)
        ax.plot(x, y, color=colour, linewidth=line_width, label=name)
    given_errors = name_errors(errors)
    if "total" in given_errors:
        total_errors = read_errors(given_errors["total"], dos.total.shape) * unit.hertz
        total = dos.total * unit.hertz
        draw_error_band(
            ax, frequency, total, total_errors, _ERRORS, "errors", is_upright=horizontal
        )
        ax.add_line(make_error_handle())
    _set_dos_axes(ax, dos, horizontal, unit)
    return ax


def _limit_density(density: Array) -> float:
    """Return the value, 1/Hz, at which the axis of a ``density`` (n,) of states ends. It is the
    greatest density; but if single peaks, such as those of flat branches, rise far above all other
    values, it is twice a high quantile of the density.
    """
    peak = float(density.max())
    quantile = float(np.quantile(density, _QUANTILE))
    # a quantile of zero gives no axis: then the peaks are nearly all of the density
    has_peaks = 0.0 < quantile < peak / _PEAK
    return 2.0 * quantile if has_peaks else peak


def _set_dos_axes(ax: Axes, dos: DensityOfStates, horizontal: bool, unit: HertzPrefix) -> None:
    """Limit and label the axes of a density of states, in this ``unit`` of frequency. The axis of
    the density ends below the peaks of flat branches, if there are such peaks. If ``horizontal``,
    the density is to the right, else upwards.
    """
    frequency_letter = "x"
    density_letter = "y"
    separator = " "
    ticks = "labelbottom"
    most_ticks: Any = 5
    if horizontal:
        frequency_letter = "y"
        density_letter = "x"
        separator = "\n"  # the axis of the density is short
        ticks = "labelleft"
        most_ticks = "auto"
    unit_name = write_hertz(unit)
    highest_frequency = dos.frequencies[-1] / unit.hertz
    peak = float(dos.total.max()) * unit.hertz
    top = _limit_density(dos.total) * unit.hertz
    height_of_peaks = f"{separator}peaks to {peak:.2g}" if peak > top else ""
    # an axis that is shared with a neighbour has no numbers
    has_numbers = find_axis(ax, frequency_letter).get_tick_params().get(ticks, True)
    frequency_label = f"Frequency ({unit_name})" if has_numbers else ""
    density_label = f"DOS per ball{separator}(1/{unit_name}){height_of_peaks}"
    ax.set(**{f"{frequency_letter}label": frequency_label, f"{density_letter}label": density_label})
    ax.set(**{f"{frequency_letter}lim": (0.0, highest_frequency)})
    ax.set(**{f"{density_letter}lim": (0.0, 1.05 * top)})
    density_axis = find_axis(ax, density_letter)
    density_axis.set_major_locator(MaxNLocator(most_ticks, steps=[1, 2, 5, 10]))
    density_axis.set_major_formatter(lambda value, _: f"{value:g}")  # narrow: 0, not 0.00


def bands_figure(
    bands: Bands | None = None,
    dos: DensityOfStates | None = None,
    *,
    asymptotes: Asymptotes | None = None,
    gaps: ArrayLike | None = None,
    bulk: ArrayLike | None = None,
    edges: bool = False,
    errors: ArrayLike | None = None,
    dos_errors: Mapping[str, ArrayLike] | None = None,
    title: str | None = None,
) -> Figure:
    """Draw a figure of bands with the Brillouin zone, and the density of states beside them on the
    same axis.

    The figure is one column wide. The zone is an inset, and in space a panel beneath the bands; a
    cluster has none. Bands or densities may be left out. ``asymptotes``, ``gaps``, ``bulk``,
    ``edges`` and ``errors`` are as in :func:`plot_bands`, and ``dos_errors`` are the errors of
    :func:`plot_dos`; they have no effect without the bands or the densities. ``title`` stands above
    the figure. Raises :class:`~granphon.base.errors.InputError` if both bands and densities are
    left out, and what :func:`plot_bands` and :func:`plot_dos` raise.
    """
    main_result = dos if bands is None else bands
    if main_result is None:
        raise InputError(
            "there is nothing to draw", mend="Give bands, a density of states, or both"
        )
    unit = _choose_unit(main_result)
    has_both = bands is not None and dos is not None
    # a zone in space has too many corners for an inset
    in_space = bands is not None and sum(bands.pbc) == 3
    height = 2.4  # inches
    if bands is not None:
        height = 4.4 if in_space else 3.1
    with styled_figure(height) as figure:
        heights = [1.0, 0.5] if in_space else [1.0]
        widths = [2.4, 1.0] if has_both else [2.4]
        rows = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        grid = rows[0].subgridspec(1, len(widths), width_ratios=widths)
        axes = grid.subplots(sharey=has_both, squeeze=False)[0]
        if dos is not None:
            plot_dos(dos, axes[-1], horizontal=bands is not None, unit=unit, errors=dos_errors)
        if bands is not None:
            plot_bands(
                bands,
                axes[0],
                asymptotes=asymptotes,
                gaps=gaps,
                bulk=bulk,
                edges=edges,
                errors=errors,
                unit=unit,
            )
            if in_space:
                plot_zone(bands, figure.add_subplot(rows[1]))
            elif any(bands.pbc):  # a cluster has no zone
                _add_inset_of_zone(bands, axes[0])
        if has_both:
            axes[1].axhline(0.0, color=FRAME, linewidth=0.5, zorder=0.5)
        _add_joint_legend(figure, axes)
        figure.suptitle(title or "")
    return figure


def _add_inset_of_zone(bands: Bands, ax: Axes) -> None:
    """Draw the zone of bands in a free place of their Axes, which may be extended for it."""
    inset = ax.inset_axes(_find_free_place(ax))
    inset.set_in_layout(False)
    plot_zone(bands, inset)


def _add_joint_legend(figure: Figure, axes: Any) -> None:
    """Add the legend of all ``axes``, each label once, below a figure; none where the total density
    would be its only entry.
    """
    # of a label that several axes have, the entry of the first axes stays
    handles_by_label: dict[str, Any] = {}
    for ax in axes[::-1]:
        handles, labels = ax.get_legend_handles_labels()
        handles_by_label.update(zip(labels, handles, strict=True))
    _join_error_entries(handles_by_label)
    if set(handles_by_label) - {"total"}:
        labels = list(handles_by_label)
        has_one_row = sum(map(len, labels)) <= _LETTERS_OF_ROW
        figure.legend(
            handles_by_label.values(),
            labels,
            loc="outside lower center",
            ncols=4 if has_one_row else count_columns(labels),
            columnspacing=1.2,
        )


def _join_error_entries(handles_by_label: dict[str, Any]) -> None:
    """Join the entries of a legend for the errors of a density and for the errors of bands, if the
    legend has both. The mapping ``handles_by_label`` is changed: one entry, such as "standard error
    (bands 1 %)", has the mark of the density, which can be seen, and the size of the errors of the
    bands.
    """
    labels_with_size = [
        label for label in handles_by_label if label.startswith(f"{STANDARD_ERROR} ")
    ]
    if STANDARD_ERROR not in handles_by_label or not labels_with_size:
        return
    field = handles_by_label.pop(STANDARD_ERROR)
    label_of_bands = labels_with_size[0]
    del handles_by_label[label_of_bands]
    size = label_of_bands.removeprefix(STANDARD_ERROR)
    handles_by_label[f"{STANDARD_ERROR} (bands{size})"] = field


def _find_free_place(ax: Axes) -> tuple[float, float, float, float]:
    """Return a square clear of the points of all bands and long waves: x, y, width, height in parts
    of the axes. If no square is clear, the axes are extended upwards until one is.
    """
    points = _list_points(ax)
    square = _find_clear_square(points)
    return _make_room(ax, points) if square is None else square


def _find_clear_square(points: Array) -> tuple[float, float, float, float] | None:
    """Return the largest square among ``_INSETS`` that is clear of the ``points`` (n, 2) of lines:
    x, y, width, height, all in parts of the axes; None if no square is clear.

    Of clear squares of one size the one farthest from the lines is taken; beyond
    ``_ENOUGH_CLEARANCE`` the first.
    """
    steps = np.linspace(0.0, 1.0, 31)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    for size in _INSETS:
        corners = _MARGIN + (1.0 - 2.0 * _MARGIN - size) * grid  # lower left ones of squares
        clearances = []  # distance of the nearest point of a line from the square at each corner
        for corner in corners:
            distances_from_middle = np.abs(points - corner - size / 2.0).max(axis=1)
            clearances.append(float(distances_from_middle.min()) - size / 2.0)
        if max(clearances) > _LEAST_CLEARANCE:
            best = int(np.argmax(np.minimum(clearances, _ENOUGH_CLEARANCE)))
            x, y = corners[best].tolist()
            return x, y, size, size
    return None


def _make_room(ax: Axes, points: Array) -> tuple[float, float, float, float]:
    """Extend the axes upwards, as far as needed, so that a square at their top is clear of all
    lines; return the square as x, y, width, height in parts of the extended axes.

    ``points`` (n, 2) are those of the lines, in parts of the axes before. The square stands where
    the lines beneath it reach least high.
    """
    size = _TOP_INSET
    bottom_of_square = 1.0 - _MARGIN - size
    starts = np.linspace(_MARGIN, bottom_of_square, 31)
    heights = []  # of the highest line beneath the square, for each start
    for start in starts:
        distance = np.abs(points[:, 0] - start - size / 2.0)
        is_beneath = distance < size / 2.0 + _TOP_CLEARANCE
        heights.append(points[is_beneath, 1].max(initial=0.0))
    extension = max(1.0, (min(heights) + _TOP_CLEARANCE) / bottom_of_square)
    bottom, top = ax.get_ylim()
    ax.set_ylim(bottom, bottom + (top - bottom) * extension)
    best_start = float(starts[int(np.argmin(heights))])
    return best_start, bottom_of_square, size, size


def _list_points(ax: Axes) -> Array:
    """Return the finite points (n, 2) of bands and long waves, in parts of the axes."""
    curves = []
    for collection in ax.collections:
        if isinstance(collection, LineCollection):
            # the middle point of each piece of a branch is a point of the bands
            curves.append(np.asarray(collection.get_segments())[:, 1])
    for line in ax.lines:
        if str(line.get_gid()).startswith("asymptote"):
            # the outer end is left out
            curves.append(np.column_stack(line.get_data())[:-1])
    left, right = ax.get_xlim()
    bottom, top = ax.get_ylim()
    points = (np.concatenate(curves) - [left, bottom]) / [right - left, top - bottom]
    return np.asarray(points[np.all(np.isfinite(points), axis=1)])
