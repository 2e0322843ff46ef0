"""Figures of single modes: balls with their displacements and rotations.

As in :mod:`granphon.figures.bands`, every function that takes an Axes draws on it and returns it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any

from granphon.figures.scales import FORCES, add_title, draw_alone, hide_axes, styled_figure

import matplotlib
import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike, NDArray

from granphon.balls.motions import Motions
from granphon.balls.neighbours import steps_within
from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.scales import HertzPrefix
from granphon.base.validation import (
    is_whole,
    lengths,
    one_of,
    positive,
    real_array,
    require,
    whole_number,
)
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.figures.style import BLUE, COLUMN_WIDTH, STYLE, VERMILION, colour_kinds, write_hertz
from granphon.figures.views import Painter, View, read_angle, read_view

if TYPE_CHECKING:
    from granphon.networks.network import ContactNetwork
    from granphon.phonons.bands import PhononModes
    from granphon.phonons.phonons import Phonons
    from granphon.waves.modes import NetworkModes


#: longest displacement in the drawing, in diameters; spins are drawn on the same scale
_LONGEST_DISPLACEMENT = 0.4
#: angle of the mark of a ball at rest, rad
_MARK = np.pi / 2.0
#: most balls of a network that are drawn
_MOST_BALLS = 500
#: most balls of a network in space that are drawn, with those that are points
_MOST_POINTS = 20_000
#: part of the greatest amplitude up to which a ball in space is drawn as a point, and the radius of
#: a point, in diameters
_LEAST_AMPLITUDE = 0.05
_POINT_RADIUS = 0.06
#: largest denominator of a fraction in the title, for components of q
_MOST_DENOMINATOR = 24
#: numbers of cells that are drawn along the periods of a line and of a plane
_CELLS = ((8,), (4, 4))
#: greatest number of cells along a period
_MOST_CELLS = 1000
#: edge of the cube in space whose balls are drawn, in diameters
_CUBE = 2.4
#: colours of balls, and of balls that do not move
_BALL = "0.93"
_FIXED_BALL = "0.75"
#: colours of the sectors of spins, and the white rim of their arcs on balls of any colour
_SECTOR_COLOURS = {VERMILION: "#F5D6BF", BLUE: "#BFDBEB"}
_RIM = withStroke(linewidth=2.0, foreground="white")
#: width of the shaft of an arrow, in diameters
_SHAFT = 0.055
#: time that an animation takes for a period, ms
_PERIOD = 2000
#: margins around discs and spheres, in diameters
_MARGIN_OF_DISCS = 0.1
_MARGIN_OF_SPHERES = 0.05
#: white part of the colours of the most distant spheres
_FADE = 0.55
#: radius of the arcs of spins, over that of a disc, and over that of a sphere
_RIM_OF_DISC = 0.72
_RIM_OF_SPHERE = 1.03
#: length of the head of the arc of a disc, rad, and at most over the angle of the arc
_HEAD = 0.47
_MOST_OF_ARC = 0.8
#: widths of the lines of contacts without a share, and with the largest, points; and the margin
#: around these lines, in diameters
_LEAST_WIDTH = 0.4
_GREATEST_WIDTH = 3.0
_MARGIN = 0.5
#: rounding of places, in diameters
_ROUNDING = 1e-6
#: sine of the angle between an axis and the line of sight below which the two count as one
_ALONG_SIGHT = 1e-3
#: spins and displacements of spheres up to this part of a diameter are not drawn
_LEAST_LENGTH = 0.01


@dataclass(frozen=True)
class _Motion:
    """The motion of a mode on the m balls that are drawn; lengths are in diameters."""

    places: Array  # (m, 3) centres at rest
    radii: Array  # (m,)
    pairs: NDArray[np.intp]  # (m_c, 2) balls in contact
    shift: NDArray[Any]  # (m, 3) displacements at phase 0, complex
    turn: NDArray[Any]  # (m, 3) angles at phase 0, complex, rad
    gyration: Array  # (m,) radii of gyration
    can_rotate: bool  # whether the balls turn
    is_planar: bool  # whether balls of a plane or a line stay in their plane
    is_seen: NDArray[np.bool_]  # (m,) which balls of space are spheres, the others being points
    title: str
    colours: list[str]  # (m,)
    kinds: dict[str, str]  # colours of known kinds of balls, by their names

    @property
    def view(self) -> View:
        """The direction from which spheres are seen: oblique to all rows of the common lattices,
        and higher above a plane of balls.
        """
        return View(-75.0, 18.0 if np.ptp(self.places[:, 2]) > 0.5 else 30.0)

    def draw(
        self, ax: Axes, phase: float, view: View, size: float, are_moved: bool = False
    ) -> None:
        """Draw the balls at a ``phase``, rad, as discs or as spheres seen from ``view`` with
        ``size`` times their radii; ``are_moved``: spheres move and turn, and have no arrows.
        """
        shift = (self.shift * np.exp(1j * phase)).real
        turn = (self.turn * np.exp(1j * phase)).real
        if self.is_planar:
            _draw_plane(ax, self, shift[:, :2], turn[:, 2])
        elif are_moved:
            _draw_moved_spheres(ax, view, self, size * self.radii, shift, turn)
        else:
            _draw_spheres_with_arrows(ax, view, self, size * self.radii, shift, turn)
        add_title(ax, self.title, self.kinds)


def plot_mode(
    phonons: Phonons,
    q: ArrayLike,
    branch: int,
    ax: Axes,
    *,
    cells: tuple[int, ...] | None = None,
    phase: float = 0.0,
    direction: ArrayLike | None = None,
    view: View | None = None,
    size: float = 0.5,
) -> Axes:
    """Draw the mode of branch ``branch`` at ``q``; axes in mean diameters, hidden.

    A ball of the mass M at r, with the components e of the eigenvector, has the displacement
    Re(e M^-1/2 exp(i q.r + i phase)). The same of the components that are rotations is w, and the
    ball is turned by the angle phi = w/R_g, with its radius of gyration R_g. Displacements and w
    have one scale, on which their largest value in a period is 0.4 d. The free phase of the
    eigenvector makes the largest component of e M^-1/2 real and positive, so that at phase 0 the
    balls are displaced. Balls of several kinds have the colours of a legend.

    Balls that stay in their plane are drawn at their real size, with an arrow from the centre for
    the displacement; the angle is the sector between the upright and a mark, in vermilion
    anticlockwise and in blue clockwise. Other balls are spheres in parallel projection, smaller
    than they are so that the balls behind show, with lines between balls in contact. The
    displacement of a sphere is a black arrow, and its rotation a vermilion arrow along the axis, of
    the length w, with an arc through phi; both arrows start at the surface.

    Parameters
    ----------
    q : (p,) or (3,), fractions of the reciprocal cell.
    branch : number of the branch from 0, in ascending frequency.
    cells : number of cells to draw along each lattice vector: by default 8 on a line and 4 by 4 in
        a plane, and in space all balls in a cube of 2.4 d.
    phase : phase of the motion, rad, which at the time t is -omega t.
    direction : direction from which q is approached, as in ``Phonons.modes``: where branches touch,
        and (required) at Gamma.
    view : direction from which spheres are seen; by default oblique to the rows of the common
        lattices.
    size : size of spheres over their real size.

    Raises
    ------
    InputError : a ``q`` without p or three components, or with one that is not finite, no such
        branch, ``cells`` that are not p whole numbers from 1 to 1000, a ``phase`` that is not
        finite, a ``view`` of another class, a ``size`` that is not above zero, several directions,
        one that is zero or not finite, or at a point where branches touch, Gamma among them, no
        ``direction``.
    """
    chosen_view = read_view(view)
    phase_of_motion = read_angle("phase", phase, "rad")
    ball_size = positive("size", size)
    motion = _find_motion(phonons, q, branch, cells, direction)
    motion.draw(ax, phase_of_motion, chosen_view or motion.view, ball_size)
    return ax


def mode_figure(phonons: Phonons, q: ArrayLike, branch: int, **options: Any) -> Figure:
    """Draw a figure of one mode, one column wide; ``options`` are those of :func:`plot_mode`."""
    return draw_alone(lambda ax: plot_mode(phonons, q, branch, ax, **options), COLUMN_WIDTH)


def plot_network_mode(
    modes: NetworkModes,
    ax: Axes,
    *,
    mode: int = 0,
    phase: float = 0.0,
    view: View | None = None,
    size: float = 0.5,
    show: str = "motion",
) -> Axes:
    """Draw one of the modes of a network, counted from 0 as in ``modes.frequencies``; axes in mean
    diameters, hidden.

    With ``show="motion"`` arrows, colours and the other arguments are those of :func:`plot_mode`.
    Contacts across the edge of a period and flat walls are left out. Of more than 500 balls the 500
    with the most kinetic energy are drawn, and the title gives their number. In space the other
    balls, and those whose amplitude is below 5 % of the greatest, are points, so that those that
    move are seen; with these, at most 20 000 balls are drawn.

    With ``show="sensitivity"`` the contacts are drawn in place of the balls' motions. The larger
    the share of a contact in the frequency (``modes.contact_shares``), the darker and wider is its
    line: a contact that is stiffer by 1 % raises the frequency by 0.5 % of its share. A contact
    across the edge of a period is drawn at both sides; a network in space is seen along z. The
    other arguments have no effect.

    Raises :class:`~granphon.base.errors.InputError` if there is no such mode, for another word of
    ``show``, and for a ``phase``, ``view`` or ``size`` that :func:`plot_mode` refuses.
    """
    index = whole_number("mode", mode, 0, len(modes.frequencies) - 1)
    chosen_view = read_view(view)
    phase_of_motion = read_angle("phase", phase, "rad")
    ball_size = positive("size", size)
    if one_of("show", show, ("motion", "sensitivity")) == "sensitivity":
        return _draw_shares(modes, index, ax)
    motion = _find_network_motion(modes, index)
    motion.draw(ax, phase_of_motion, chosen_view or motion.view, ball_size)
    return ax


def _draw_shares(modes: NetworkModes, mode: int, ax: Axes) -> Axes:
    """Draw the share of each contact in the frequency of the mode of the index ``mode``; return
    ``ax``.
    """
    network = modes.network
    diameter = network.scales.length
    shares = modes.contact_shares[mode]
    # two halves of each contact, which meet in the middle unless it crosses the edge of a period
    half = 0.5 * network.vector
    is_wall = np.isinf(network.distance)
    half[is_wall] = (network.contact_places - network.positions[network.i])[is_wall]
    starts = np.concatenate([network.positions[network.i], network.positions[network.j][~is_wall]])
    steps = np.concatenate([half, -half[~is_wall]])
    segments = np.stack([starts, starts + steps], axis=1)[..., :2] / diameter
    values = np.concatenate([shares, shares[~is_wall]])
    order = np.argsort(values, kind="stable")  # large shares are on top
    largest = max(float(np.max(shares)), np.finfo(float).tiny)
    lines = LineCollection(
        list(segments[order]),
        array=values[order],
        cmap=FORCES,
        norm=Normalize(0.0, largest),
        linewidths=_LEAST_WIDTH + (_GREATEST_WIDTH - _LEAST_WIDTH) * values[order] / largest,
        capstyle="round",
        gid="shares",
    )
    ax.add_collection(lines, autolim=False)
    points = segments.reshape(-1, 2)
    hide_axes(ax, points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN)
    add_title(ax, _write_network_title(modes, mode, network.n_balls), {})
    figure: Any = ax.get_figure()
    bar = figure.colorbar(lines, ax=ax, location="bottom", aspect=40, pad=0.02)
    bar.ax.set_xlabel("Share of the contact in the frequency")
    return ax


def plot_participation(modes: NetworkModes, ax: Axes | None = None) -> Axes:
    """Draw the participation ratios of the modes of a network over their frequencies: 1 where all
    balls move alike, 1/N where one of N moves.

    If ``ax`` is not given, a new figure, one column wide, is made.
    """
    if ax is None:
        with styled_figure(2.4) as figure:
            return plot_participation(modes, figure.subplots())
    unit = HertzPrefix.for_top(float(np.max(modes.frequencies)))
    ax.plot(modes.frequencies / unit.hertz, modes.participation_ratio, ".", color=BLUE)
    ax.set(xlabel=f"Frequency ({write_hertz(unit)})", ylabel="Participation ratio")
    ax.set_ylim(bottom=0.0)
    return ax


def _find_network_motion(modes: NetworkModes, mode: int) -> _Motion:
    """Return a mode of a network, of the index ``mode``, on the balls that are drawn."""
    network = modes.network
    motions = network.ball_motions
    diameter = network.scales.length
    is_planar = network.dimension < 3 and _stay_in_plane(motions)
    balls = _choose_balls(modes, mode, _MOST_BALLS if is_planar else _MOST_POINTS)
    masses = network.masses[balls]
    motion_of_balls = modes.vectors[mode][balls] / np.sqrt(masses)[:, None]
    displacements, spins = _scale_motion(*_split_motion(motions, motion_of_balls))
    is_moving = network.moving[balls]
    inertias = network.inertias[balls][is_moving]
    gyration = np.ones(balls.size)  # of balls that do not move any number will do
    gyration[is_moving] = np.sqrt(inertias / masses[is_moving]) / diameter
    colours_of_kinds, colours = _colour_balls(network)
    is_seen = np.ones(balls.size, bool)
    if not is_planar:
        amplitudes = np.maximum(_find_amplitudes(displacements), _find_amplitudes(spins))
        is_seen = amplitudes > _LEAST_AMPLITUDE * amplitudes.max()
        is_seen &= np.isin(balls, _choose_balls(modes, mode, _MOST_BALLS))
    return _Motion(
        places=network.positions[balls] / diameter,
        radii=network.radii[balls] / diameter,
        pairs=_list_pairs(network, balls),
        shift=displacements,
        turn=spins / gyration[:, None],
        gyration=gyration,
        can_rotate=motions.rotate,
        is_planar=is_planar,
        is_seen=is_seen,
        title=_write_network_title(modes, mode, int(np.count_nonzero(is_seen))),
        colours=[colours[ball] for ball in balls.tolist()],
        kinds=colours_of_kinds,
    )


def _stay_in_plane(motions: Motions) -> bool:
    """Whether balls with these ``motions`` stay in the plane of x and y, and turn about z alone."""
    return 2 not in motions.translations and set(motions.rotations) <= {2}


def _choose_balls(modes: NetworkModes, mode: int, most: int) -> NDArray[np.intp]:
    """Return the indices (m,), ascending, of the balls with the most kinetic energy in a mode: at
    most ``most`` of them, no flat wall among them.
    """
    is_ball = np.isfinite(modes.network.radii)
    energies = np.sum(modes.vectors[mode] ** 2, axis=1)
    ranks = np.where(is_ball, energies, -1.0)  # flat walls come last
    n_drawn = min(most, np.count_nonzero(is_ball))
    descending = np.argsort(-ranks, kind="stable")
    return np.sort(descending[:n_drawn])


def _split_motion(motions: Motions, motion: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the displacements and the spins of m balls along x, y and z, each (m, 3), from a
    ``motion`` (m, motions); zero along axes along or about which no ball moves.

    Spins are angles times radii of gyration, so that both have one unit.
    """
    displacements = np.zeros((len(motion), 3), motion.dtype)
    spins = np.zeros((len(motion), 3), motion.dtype)
    displacements[:, list(motions.translations)] = motion[:, motions.translating]
    spins[:, list(motions.rotations)] = motion[:, motions.turning]
    return displacements, spins


def _scale_motion(
    displacements: NDArray[Any], spins: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return ``displacements`` and ``spins``, each (m, 3), in diameters of the drawing: the largest
    that any of them reaches in a period is ``_LONGEST_DISPLACEMENT``.
    """
    scale = _LONGEST_DISPLACEMENT / max(_find_amplitude(displacements), _find_amplitude(spins))
    return scale * displacements, scale * spins


def _list_pairs(network: ContactNetwork, balls: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the contacts (m_c, 2) between the ``balls`` (m,) that are drawn, by the places of both
    balls in ``balls``, without contacts across the edge of a period.
    """
    place_of_ball = np.full(network.n_balls, -1)  # -1 for balls that are not drawn
    place_of_ball[balls] = np.arange(balls.size)
    pairs = np.stack([place_of_ball[network.i], place_of_ball[network.j]], axis=1)
    is_drawn = np.all(pairs >= 0, axis=1)
    is_across = np.any(network.shift, axis=1)
    return np.asarray(pairs[is_drawn & ~is_across])


def _colour_balls(network: ContactNetwork) -> tuple[dict[str, str], list[str]]:
    """Return the colours of the kinds of balls that move, by name, and the colour of each ball."""
    names = network.kinds or [""] * network.n_balls
    colours_of_kinds = colour_kinds(itertools.compress(names, network.moving))
    colours = []
    for name, is_moving in zip(names, network.moving, strict=True):
        colours.append(colours_of_kinds.get(name, _BALL) if is_moving else _FIXED_BALL)
    return colours_of_kinds, colours


def _write_network_title(modes: NetworkModes, mode: int, n_drawn: int) -> str:
    """Return the title of the mode of the index ``mode`` of a network: its frequency, the part of
    the energy in rotation where balls turn, the participation ratio, and the number ``n_drawn`` of
    balls that are drawn unless these are all balls. Flat walls do not count.
    """
    network = modes.network
    n_balls = int(np.count_nonzero(np.isfinite(network.radii)))
    hertz = float(modes.frequencies[mode])
    unit = HertzPrefix.for_top(hertz)
    title = f"{hertz / unit.hertz:.1f} {write_hertz(unit)}"
    if network.ball_motions.rotate:
        title += f", rotation {100.0 * float(modes.rotational_fraction[mode]):.0f} %"
    title += f"\nparticipation {modes.participation_ratio[mode]:.2g}"
    if n_drawn < n_balls:
        title += f", {n_drawn} of {n_balls} balls"
    return title


def animate_mode(
    phonons: Phonons,
    q: ArrayLike,
    branch: int,
    *,
    cells: tuple[int, ...] | None = None,
    direction: ArrayLike | None = None,
    view: View | None = None,
    size: float = 0.5,
    frames: int = 24,
) -> FuncAnimation:
    """Draw one period of a mode as an animation, one column wide, for ``animation.save("mode.gif",
    writer="pillow")``.

    Spheres move, and great circles on them turn; balls that stay in their plane are drawn as by
    :func:`plot_mode`, whose arguments the others are. ``frames`` is the number of pictures in
    a period, 2 to 1000. Raises what :func:`plot_mode` raises, and
    :class:`~granphon.base.errors.InputError` for another number of frames.
    """
    n_frames = whole_number("frames", frames, 2, 1000)
    ball_size = positive("size", size)
    chosen_view = read_view(view)
    motion = _find_motion(phonons, q, branch, cells, direction)
    direction_of_view = chosen_view or motion.view
    # limits of spheres, the same in all pictures
    centres = direction_of_view.project(motion.places)
    margin = _LONGEST_DISPLACEMENT + ball_size * motion.radii.max() + _MARGIN_OF_SPHERES
    low = centres.min(axis=0) - margin
    high = centres.max(axis=0) + margin
    with styled_figure(COLUMN_WIDTH, dpi=150) as figure:
        ax = figure.subplots()

    def draw(frame: int) -> None:
        """Draw the picture of the number ``frame``, in place of the one before."""
        phase = -2.0 * np.pi * frame / n_frames
        ax.clear()
        with matplotlib.rc_context(STYLE):
            motion.draw(ax, phase, direction_of_view, ball_size, are_moved=True)
            if not motion.is_planar:
                hide_axes(ax, low, high)

    milliseconds_per_frame = _PERIOD // n_frames
    return FuncAnimation(figure, draw, frames=n_frames, interval=milliseconds_per_frame)


def _find_motion(
    phonons: Phonons,
    q: ArrayLike,
    branch: int,
    cells: tuple[int, ...] | None,
    direction: ArrayLike | None,
) -> _Motion:
    """Return the mode of the branch number ``branch`` at ``q`` of a lattice, on the balls that are
    drawn; the arguments are those of :func:`plot_mode`, which says what is refused.
    """
    modes = _find_modes(phonons, q, branch, direction)
    lattice = phonons.lattice
    n_balls = lattice.n_balls
    motions = lattice.motions
    vectors = modes.eigenvectors[0, :, branch].reshape(n_balls, -1)
    motion_in_cell = _fix_phase(vectors / np.sqrt(lattice.masses)[:, None])
    displacements, spins = _scale_motion(*_split_motion(motions, motion_in_cell))
    angles = spins / lattice.gyration[:, None]
    places, balls, pairs = _place_balls(lattice, cells)
    q_per_diameter = modes.wavevectors[0] * phonons.scales.length  # rad per diameter
    wave = np.exp(1j * (places[:, : lattice.periods] @ q_per_diameter))[:, None]
    # in diameters; atoms without radii are balls of one diameter
    radii = phonons.atoms.arrays.get("radius", np.full(n_balls, 0.5))
    names = phonons.state.kinds or [""] * n_balls
    colours_of_kinds = colour_kinds(names)
    is_flat = lattice.periods < 3 and not places[:, 2].any()
    fractions = np.asarray(q, float)[: lattice.periods]
    return _Motion(
        places=places,
        radii=radii[balls],
        pairs=pairs,
        shift=displacements[balls] * wave,
        turn=angles[balls] * wave,
        gyration=lattice.gyration[balls],
        can_rotate=motions.rotate,
        is_planar=is_flat and _stay_in_plane(motions),
        is_seen=np.ones(balls.size, bool),
        title=_write_title(modes, fractions, branch, motions.rotate),
        colours=[colours_of_kinds.get(names[ball], _BALL) for ball in balls.tolist()],
        kinds=colours_of_kinds,
    )


def _find_modes(
    phonons: Phonons, q: ArrayLike, branch: int, direction: ArrayLike | None
) -> PhononModes:
    """Return the modes of a lattice at a single ``q``; InputError for several directions, and if
    there is no ``branch``, see :func:`plot_mode`.
    """
    if direction is not None and real_array("direction", direction).ndim != 1:
        raise InputError(f"direction is {brief(direction)}", mend="Give one direction")
    modes = phonons.modes([real_array("q", q)], direction)
    n_branches = modes.frequencies.shape[1]
    if not (is_whole(branch) and 0 <= branch < n_branches):
        raise InputError(
            f"there is no branch {brief(branch)}", mend=f"Count from 0 to {n_branches - 1}"
        )
    return modes


def _fix_phase(motion: NDArray[Any]) -> NDArray[Any]:
    """Return a complex ``motion``, u components of n balls, (n, u), with the phase at which its
    largest component is real and positive. The first of several components counts as the largest
    if they differ by rounding alone, by a millionth of the largest.
    """
    components = motion.ravel()
    relative_magnitudes = np.abs(components) / np.abs(components).max()
    largest = components[np.argmax(np.round(relative_magnitudes, 6))]
    return np.asarray(motion * (abs(largest) / largest))


def _write_title(modes: PhononModes, q: Array, branch: int, rotate: bool) -> str:
    """Return the title of the mode of a branch at ``q`` (p,), fractions of the reciprocal cell; the
    title has the part of the energy in rotation where balls ``rotate``.
    """
    hertz = float(modes.frequencies[0, branch])
    unit = HertzPrefix.for_top(hertz)
    frequency = f"{hertz / unit.hertz:.1f} {write_hertz(unit)}"
    # a frequency of zero has rounding errors of this size
    n_branches = modes.frequencies.shape[1]
    rounding = n_branches * np.finfo(float).eps * float(modes.frequencies.max())
    if hertz <= rounding:
        frequency = "zero frequency"
    fractions = ", ".join(map(_write_fraction, q.tolist()))
    title = f"q = ({fractions})\n{frequency}"
    if rotate:
        title += f", rotation {100.0 * float(modes.rotational_fraction[0, branch]):.0f} %"
    return title


def _write_fraction(x: float) -> str:
    """Return a number as a fraction with a small denominator, or else as a decimal number."""
    ratio = Fraction(x).limit_denominator(_MOST_DENOMINATOR)
    return str(ratio) if abs(x - ratio) < 1e-9 else f"{x:.4g}"


def _place_balls(
    lattice: ContactLattice, cells: tuple[int, ...] | None
) -> tuple[Array, NDArray[np.intp], NDArray[np.intp]]:
    """Return the balls of a lattice that are drawn: their places (m, 3) in diameters, their indices
    (m,) in the cell, and their contacts (m_c, 2). A contact has the positions of its two balls in
    these arrays.
    """
    p, d = lattice.cell.shape
    cell = np.zeros((p, 3))
    sites = np.zeros((lattice.n_balls, 3))
    cell[:, :d] = lattice.cell
    sites[:, :d] = lattice.positions
    is_in_cube = cells is None and p == 3
    if is_in_cube:
        diagonal = _CUBE * np.sqrt(3.0)
        extent_of_cell = float(np.ptp(sites, axis=0).max())
        steps = steps_within(lattice.cell, diagonal + extent_of_cell)
    else:
        requested = _CELLS[p - 1] if cells is None else cells
        counts = require("cells", partial(lengths, low=1, high=_MOST_CELLS, periods=p), requested)
        steps = np.array(list(np.ndindex(*counts)))  # (cells, p)
    cell_steps = np.repeat(steps, lattice.n_balls, axis=0)  # (m, p), of the cell of each ball
    balls = np.tile(np.arange(lattice.n_balls), len(steps))
    places = cell_steps @ cell + sites[balls]
    if is_in_cube:
        from_first = places - sites[0]
        is_inside = np.all((from_first > -_ROUNDING) & (from_first < _CUBE), axis=1)
        cell_steps = cell_steps[is_inside]
        balls = balls[is_inside]
        places = places[is_inside]
    return places, balls, _find_pairs(lattice, balls, cell_steps)


def _find_pairs(
    lattice: ContactLattice, balls: NDArray[np.intp], cell_steps: NDArray[Any]
) -> NDArray[np.intp]:
    """Return the contacts (m_c, 2) of the drawn balls, by the places of both balls in ``balls``
    (m,), which holds their indices in the cell. ``cell_steps`` (m, p) are the numbers of cells,
    along each of p periods, from the first cell to the cell of each drawn ball.
    """
    index_of_ball = {}  # places in the arrays, by index in the cell and steps
    for index, (ball, steps) in enumerate(zip(balls.tolist(), cell_steps.tolist(), strict=True)):
        index_of_ball[ball, tuple(steps)] = index
    table = lattice.contacts
    pairs = []
    for i, j, shift in zip(table.i.tolist(), table.j.tolist(), table.shift.tolist(), strict=True):
        for (ball, steps), index in index_of_ball.items():
            if ball != i:
                continue
            neighbour_steps = tuple(n + m for n, m in zip(steps, shift, strict=True))
            neighbour = (j, neighbour_steps)
            if neighbour in index_of_ball:
                pairs.append((index, index_of_ball[neighbour]))
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def _draw_plane(ax: Axes, motion: _Motion, shift: Array, angles: Array) -> None:
    """Draw discs with their displacements ``shift`` (m, 2), in diameters, as arrows; where balls
    rotate, their ``angles`` (m,), rad, each as a sector, an arc with a head, and a marked diameter.
    The axes end beside the discs.
    """
    centres = motion.places[:, :2]
    radii = motion.radii
    discs = [Circle((x, y), radius) for (x, y), radius in zip(centres, radii, strict=True)]
    look: dict[str, Any] = {"facecolor": motion.colours, "edgecolor": "0.45", "linewidth": 0.6}
    ax.add_collection(PatchCollection(discs, **look, zorder=1.0, gid="balls"))
    if motion.can_rotate:
        _draw_spins(ax, centres, radii, angles)
    ax.quiver(
        *centres.T,
        *shift.T,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        units="xy",
        width=_SHAFT,
        headwidth=3.6,
        headlength=4.0,
        headaxislength=3.6,
        minlength=0.0,
        minshaft=1.5,
        color="black",
        zorder=3.0,
        gid="displacements",
    )
    low = (centres - radii[:, None]).min(axis=0)
    high = (centres + radii[:, None]).max(axis=0)
    hide_axes(ax, low - _MARGIN_OF_DISCS, high + _MARGIN_OF_DISCS)


def _draw_spins(ax: Axes, centres: Array, radii: Array, angles: Array) -> None:
    """Draw the ``angles`` (m,), rad, of discs with ``centres`` (m, 2) and ``radii`` (m,): sectors
    from the upright to a marked diameter, and arcs with heads.
    """

    def find_points(distances: Array, directions: Array) -> Array:
        """Return points (m, n, 2) at distances (m,) from the centres, in directions (m, n), rad."""
        unit_vectors = np.stack([np.cos(directions), np.sin(directions)], axis=-1)
        return np.asarray(centres[:, None] + distances[:, None, None] * unit_vectors)

    is_anticlockwise = angles >= 0.0
    colours = [VERMILION if flag else BLUE for flag in is_anticlockwise]
    arc_radii = _RIM_OF_DISC * radii
    ends = _MARK + angles[:, None]  # directions of the marks, rad
    marks = find_points(radii, ends + np.array([0.0, np.pi]))  # both ends of a diameter
    arcs = find_points(arc_radii, _MARK + angles[:, None] * np.linspace(0.0, 1.0, 33))
    tips = arcs[:, -1:]
    # a head along the arc, as long as the arc allows
    head_angles = np.sign(angles) * np.minimum(_HEAD, _MOST_OF_ARC * np.abs(angles))
    necks = find_points(arc_radii, ends - head_angles[:, None])
    quarter_turn = np.array([[0.0, 1.0], [-1.0, 0.0]])  # of row vectors
    wings = 0.5 * (tips - necks) @ quarter_turn
    heads = np.concatenate([tips, necks + wings, necks - wings], axis=1)  # triangles (m, 3, 2)
    sectors = np.concatenate([centres[:, None], arcs], axis=1)
    light: dict[str, Any] = {"facecolors": [_SECTOR_COLOURS[colour] for colour in colours]}
    ax.add_collection(PolyCollection(list(sectors), **light, linewidths=0.0, zorder=1.5))
    ax.add_collection(LineCollection(list(marks), colors="0.45", linewidths=0.6, gid="marks"))
    line_look: dict[str, Any] = {"colors": colours, "linewidths": 1.0, "path_effects": [_RIM]}
    ax.add_collection(LineCollection(list(arcs), **line_look, gid="spins"))
    ax.add_collection(PolyCollection(list(heads), facecolors=colours, linewidths=0.0, zorder=2.1))


def _draw_spheres_with_arrows(
    ax: Axes, view: View, motion: _Motion, radii: Array, shift: Array, turn: Array
) -> None:
    """Draw balls of ``radii`` (m,) as spheres at rest with arrows.

    A black arrow is the displacement, ``shift`` (m, 3), and a vermilion arrow the rotation,
    ``turn`` (m, 3), rad, about the arrow. An arrow starts at the surface of its ball; an arrow that
    points away from the viewer starts at the outline of the ball, so that its whole length is seen.
    The arc with a head, on the side of the viewer, is the angle through which the surface turns; to
    a viewer who looks along the arrow the ball turns clockwise.
    """
    painter = Painter(view)
    is_between_seen = np.all(motion.is_seen[motion.pairs], axis=1)
    _add_bonds(painter, motion.pairs[is_between_seen], motion.places, radii)
    spins = motion.gyration[:, None] * turn
    for centre in motion.places[~motion.is_seen]:
        painter.add_point(centre, _POINT_RADIUS, _FIXED_BALL)
    for ball in np.flatnonzero(motion.is_seen).tolist():
        centre = motion.places[ball]
        radius = radii[ball]
        painter.add_sphere(centre, radius, motion.colours[ball])
        _add_arrow(painter, centre, radius, shift[ball], "black")
        _add_arrow(painter, centre, radius, spins[ball], VERMILION)
        if motion.gyration[ball] * np.linalg.norm(turn[ball]) > _LEAST_LENGTH:
            _add_arc(painter, centre, _RIM_OF_SPHERE * radius, turn[ball])
    _show_spheres(painter, ax)


def _draw_moved_spheres(
    ax: Axes, view: View, motion: _Motion, radii: Array, shift: Array, turn: Array
) -> None:
    """Draw balls of ``radii`` (m,) as spheres that are displaced by ``shift`` (m, 3), with three
    great circles that are turned by ``turn`` (m, 3), rad.
    """
    # imported here, because only moved spheres need the package
    from scipy.spatial.transform import Rotation

    painter = Painter(view)
    centres = motion.places + shift
    _add_bonds(painter, motion.pairs, centres, radii)
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    circles = np.stack([np.roll(circle, axis, axis=1) for axis in range(3)])  # (3, points, 3)
    for ball, matrix in enumerate(Rotation.from_rotvec(turn).as_matrix()):
        painter.add_sphere(centres[ball], radii[ball], motion.colours[ball])
        _add_circles(painter, centres[ball], radii[ball], circles @ matrix.T)
    _show_spheres(painter, ax)


def _add_bonds(painter: Painter, pairs: NDArray[np.intp], centres: Array, radii: Array) -> None:
    """Add a line for each contact, of which ``pairs`` (m_c, 2) are the balls, from surface to
    surface of spheres with ``centres`` (m, 3) and ``radii`` (m,).
    """
    for i, j in pairs:
        difference = centres[j] - centres[i]
        direction = difference / np.linalg.norm(difference)
        start = centres[i] + radii[i] * direction
        end = centres[j] - radii[j] * direction
        painter.add_line(np.array([start, end]), "0.62", 1.0)


def _show_spheres(painter: Painter, ax: Axes) -> None:
    """Draw the shapes of a ``painter``, distant ones fainter, on ``ax``, which is limited to them
    and hidden.
    """
    painter.draw(ax, "spheres", fade=_FADE)
    low, high = painter.extent
    hide_axes(ax, low - _MARGIN_OF_SPHERES, high + _MARGIN_OF_SPHERES)


def _add_arrow(painter: Painter, centre: Array, radius: float, arrow: Array, colour: str) -> None:
    """Add an ``arrow`` (3,) that starts at the surface of a ball with ``centre`` (3,), unless the
    arrow is too short to be seen; an arrow away from the viewer starts at the outline of the ball.
    """
    if np.linalg.norm(arrow) <= _LEAST_LENGTH:
        return
    to_viewer = painter.view.axes[2]
    # of an arrow away from the viewer, the direction on the paper
    component_away = min(float(arrow @ to_viewer), 0.0)
    direction = arrow - component_away * to_viewer
    # an arrow along the line of sight has no length on the paper
    length = float(np.linalg.norm(direction)) or 1.0
    start = centre + radius / length * direction
    painter.add_arrow(start, arrow, colour, _SHAFT)


def _add_circles(painter: Painter, centre: Array, radius: float, circles: Array) -> None:
    """Add the visible stretches of great circles of a sphere with ``centre`` (3,) and ``radius``;
    ``circles`` (n, points, 3) are those of a sphere of radius one about the origin.
    """
    view = painter.view
    nearness = float(view.nearness(centre))
    for circle in circles:
        indices = np.flatnonzero(view.nearness(circle) >= 0.0)  # of the visible points
        ends = np.flatnonzero(np.diff(indices) > 1)  # where a stretch ends
        for stretch in np.split(indices, ends + 1):
            if len(stretch) > 1:
                points = centre + radius * circle[stretch]
                painter.add_line(points, "0.3", 0.5, nearness=nearness)


def _add_arc(painter: Painter, centre: Array, radius: float, phi: Array) -> None:
    """Add the arc of ``radius``, about a ``centre`` (3,), through which a point on the viewer's
    side turns by the rotation ``phi`` (3,), rad, with a head.
    """
    _, upwards, to_viewer = painter.view.axes
    angle = float(np.linalg.norm(phi))
    axis = phi / angle
    # the middle of the arc, as near to the viewer as the axis allows
    across_axis = to_viewer - (to_viewer @ axis) * axis
    if np.linalg.norm(across_axis) < _ALONG_SIGHT:  # the ball turns about the line of sight
        across_axis = upwards - (upwards @ axis) * axis
    front = across_axis / np.linalg.norm(across_axis)
    side = np.cross(axis, front)
    angles = angle * np.linspace(-0.5, 0.5, 25)
    arc = centre + radius * (np.cos(angles)[:, None] * front + np.sin(angles)[:, None] * side)
    # a little nearer than the ball, so that the arc is drawn after the ball, and its rim between
    nearness = float(painter.view.nearness(centre)) + 1e-3 * radius
    # a white rim shows the arc on balls of any colour
    painter.add_line(arc, "white", 2.6, nearness=nearness - 1e-4 * radius)
    painter.add_line(arc, VERMILION, 1.1, nearness=nearness)
    tangent = -np.sin(angles[-1]) * front + np.cos(angles[-1]) * side
    length_of_head = 0.5 * radius
    start = arc[-1] - 0.4 * length_of_head * tangent
    width = 0.25 * length_of_head
    painter.add_arrow(start, length_of_head * tangent, VERMILION, width, nearness=nearness)


def _find_amplitude(motion: NDArray[Any]) -> float:
    """Return the largest length that the complex vectors ``motion`` (n, 3) reach in a period."""
    return float(_find_amplitudes(motion).max())


def _find_amplitudes(motion: NDArray[Any]) -> Array:
    """Return the largest length (n,) that each of the complex vectors ``motion`` (n, 3) reaches in
    a period: the longer half axis of its elliptic path.
    """
    # of the squares of both half axes of each path
    sum_of_squares = np.sum(np.abs(motion) ** 2, axis=1)
    difference_of_squares = np.abs(np.sum(motion * motion, axis=1))
    return np.asarray(np.sqrt(0.5 * (sum_of_squares + difference_of_squares)))
