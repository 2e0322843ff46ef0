"""Pulses through a network: a tone burst pushes a plane of balls or one ball, and a plane of balls
receives it.

:class:`Course` orders the balls along a direction, and says how the network closes on itself and
where it ends. :class:`PulseSource` says what is sent. Its :class:`Route` through the network is
found first, from the places of balls and the contacts alone, so that what cannot be sent is refused
before anything is simulated; then the pulse is propagated (:mod:`granphon.waves.propagation`).
:class:`Pulse` is what is received: signals, their coherent part, and times of flight as
experimenters read them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import (
    InputError,
    InstabilityError,
    UnreachableFrequencyError,
    brief,
    message,
)
from granphon.base.memory import require_memory
from granphon.base.progress import Progress, silent
from granphon.base.results import Result, held, read_only, result_class
from granphon.base.scales import write_quantity
from granphon.base.text import counted
from granphon.base.validation import (
    Low,
    finite_array,
    index_array,
    one_of,
    positive,
    real_array,
)
from granphon.dynamics.damping import GivenLosses, Losses
from granphon.dynamics.linalg import lanczos_converges
from granphon.networks.network import ContactNetwork, number_pieces
from granphon.waves.modes import find_allowed_fall, find_falling_motions, is_stable, require_stable
from granphon.waves.operator import WaveOperator, make_operator
from granphon.waves.propagation import Propagation, Spans, ToneBurst, ViscousPropagation
from granphon.waves.settings import ENDS, READINGS, PulseSettings

#: relative length below which the part of a period along a direction is zero but for rounding
_ZERO_LENGTH = 1e-9
#: greatest distance of a ball of a plane from its middle ball, in mean diameters, in a lattice
_PLANE_THICKNESS = 0.25
#: greatest distance of a ball of a layer from its middle ball, in mean diameters, in a network of
#: no lattice, which has no planes
_LAYER_THICKNESS = 0.45
#: greatest number of directions that are compared, to offer another one in a message
_MOST_DIRECTIONS = 40_000
#: ways to read a time of flight
METHODS = ("envelope", "first", "correlation")
#: part of the greatest height of an envelope that an earlier maximum must have to be that of the
#: pulse
_MAXIMUM_SHARE = 0.5
#: part of the height of a maximum above which the envelope is fitted by a parabola
_TOP_SHARE = 0.9
#: shift, in steps of the record, up to which a signal has not travelled
_LEAST_SHIFT = 0.05
#: two reasons why a signal has no time of flight
_SHORT_RECORD_REASON = (
    "the record ends before the pulse is over: use a longer duration; in a periodic network a"
    " longer array, a shorter distance, fewer cycles, a higher frequency, or ends: free"
)
_EARLY_REASON = (
    "the signal does not come after the burst: what is heard has not travelled, as no waves of"
    " this frequency and polarisation do, the plane is too near, or the array is far shorter than"
    " the pulse"
)
#: part of the maximum of the envelope at which a signal begins, by default
_THRESHOLD = 0.1
#: damping ratio of a wave of the pulse's frequency from which the signal tells no velocity of sound
_LARGEST_DAMPING_RATIO = 0.3
#: relative excess of a velocity over that of the fastest wave that errors of the time of flight may
#: explain
_VELOCITY_EXCESS = 0.02
#: least share of the burst's frequency in the received signal, over that in the burst; the share is
#: the spectrum at this frequency over the maximum of the spectrum
_LEAST_SHARE = 0.5
#: relative error of a velocity above which the error is a warning
_WARNED_ERROR = 0.03
#: relative error of a velocity from which the velocity is not known
_LARGEST_ERROR = 0.5
#: half width of the gate around the height of a pulse, in durations of the burst: it holds all of a
#: pulse that keeps its shape, and a margin
_GATE_REACH = 0.75
#: warning of a pulse whose damping is above _LARGEST_DAMPING_RATIO
_DAMPED_REMARK = (
    "waves of the frequency of the pulse hardly swing, so much are they damped: what arrives has"
    " no velocity of sound"
)
#: message of an array that has no stable part once it is cut
_FALL_MESSAGE = message(
    "the array does not hold with free ends: static forces push over one ball after the"
    " other, as far as the receivers",
    "They need the contacts that the ends cut, as such an array has hardly more than it needs",
    "Use ends: walls, balls with friction, or a higher load",
)
#: duration of the record after the burst, over the time that the fastest long wave takes for the
#: distance
_RECORD_LENGTH = 3.0
#: squared frequency over the squared bound of all frequencies up to which some mode surely has this
#: frequency or a higher one; for the ball with the highest frequency alone the ratio is nearly 1/2
_SURE_SHARE = 0.45
#: most products with D that a record may take
_MOST_PRODUCTS = 2**20
#: products of a step if motions are damped unevenly: with D, and with the matrix of dashpots
_UNEVEN_PRODUCTS = 2.0
#: largest viscosity of a contact over its stiffness, times the highest angular frequency, with
#: which something moves
_LARGEST_DAMPING = 1e12
#: largest number of times at which a pulse is read
_MOST_READINGS = 2**24
#: least weight of a reading in the fit of a maximum: above zero, so that a fit has three readings
_LEAST_WEIGHT = 1e-9
#: greatest relative difference of the distances, and of the dampings, of pulses that are averaged
_LARGEST_DIFFERENCE = 0.1
#: relative difference of forces that are the same but for rounding
_ROUNDING = 1e-12
#: relative error of the highest squared frequency
_TOP_ERROR = 1e-6
#: reduction of the default distance, in diameters. If two planes are equally near to the default
#: place, small displacements of balls would decide, in each sample anew: with this reduction the
#: plane nearer to the source is taken in all samples
_DISTANCE_REDUCTION = 0.07
#: factor by which velocities and frequencies of an array of differing balls may be above or below
#: those of the array of equal balls with the same mean contact force: a generous bound
MARGIN = 1.5


@dataclass(frozen=True, eq=False)
class Course:
    """The balls of a network in the order in which a plane wave along ``direction`` meets them.

    The *place* of a ball is its distance along the direction from the beginning of the course. In a
    network that repeats along the direction, places are taken less whole periods: the course is
    closed unless it was given ends.

    Attributes
    ----------
    network : the network.
    direction : (3,) unit vector.
    period : distance after which planes across the direction meet themselves, m; infinity if no
        period of the network leads along the direction.
    origin : coordinate along the direction of the beginning of the course, m.
    face : place from which distances count if the network was given ends and a plane is pushed, m;
        nan if it was given none.
    is_known_stable : whether it is known that static forces push over no ball of the network.
    contacts : (n_c,) index of each contact of the network among those of the network before its
        ends were cut; None if no contact was cut.
    """

    network: ContactNetwork
    direction: Array
    period: float
    origin: float = 0.0
    face: float = math.nan
    is_known_stable: bool = False
    contacts: Index | None = None

    @classmethod
    def along(cls, network: ContactNetwork, direction: Array) -> Self:
        """Return the course along ``direction`` (3,), a unit vector, through the ``network``. It
        begins halfway between two planes of balls; or, in a network without a period along the
        direction, half a diameter before the first ball that moves.

        Raises :class:`~granphon.base.errors.InputError` for a direction that leaves the line or the
        plane of the balls, and if no ball moves.
        """
        if not np.any(network.moving):
            raise InputError("no ball of this network moves", "All have an infinite mass")
        if np.any(np.abs(direction[network.dimension :]) > _ZERO_LENGTH):
            mend = f"Give {network.dimension} numbers"
            raise InputError(
                "the direction leaves the line or the plane in which the balls lie", mend=mend
            )
        # the course begins where a cut meets no ball
        course = cls(network, direction, _find_period(network, direction))
        if math.isinf(course.period):
            lowest = float(np.min(course.heights[network.moving]))
            return replace(course, origin=lowest - 0.5 * course.spacing)
        return replace(course, origin=course._find_gap())

    def _find_gap(self) -> float:
        """Return the coordinate, m, of the middle of the first gap between two planes of balls, in
        a network that repeats.

        A plane is less than a diameter thick, so that the widest gap among the balls of the first
        diameter is one between two planes.
        """
        heights = np.sort(self._wrap(self.heights))
        n_near = int(np.searchsorted(heights, self.spacing)) + 1
        near_heights = heights[: max(2, n_near)]
        # the gap before the first ball is that from the last ball, a period earlier
        gaps = np.diff(near_heights, prepend=heights[-1] - self.period)
        # of gaps that are equally wide but for the differences of balls the first is taken
        is_wide = gaps > (1.0 - _PLANE_THICKNESS) * np.max(gaps)
        first_wide = int(np.argmax(is_wide))
        return float(near_heights[first_wide] - 0.5 * gaps[first_wide])

    @cached_property
    def spacing(self) -> float:
        """Mean diameter of the balls that move, m."""
        return 2.0 * float(np.mean(self.network.radii[self.network.moving]))

    @cached_property
    def heights(self) -> Array:
        """(n,) coordinates of balls along the direction, m; of a flat wall that of a point on it,
        as its position may be any, unless nothing touches the wall.
        """
        heights = np.asarray(self.network.positions @ self.direction)
        if np.any(np.isinf(self.network.radii)):
            for wall, (point, _) in self.network.walls.items():
                heights[wall] = point @ self.direction
        return heights

    @cached_property
    def places(self) -> Array:
        """(n,) places of balls, m: distances behind the beginning, from zero to :attr:`period`. If
        the period is infinite, held balls before the beginning have places below zero.
        """
        return self._wrap(self.heights - self.origin)

    def _wrap(self, lengths: Array) -> Array:
        """Return ``lengths`` (n,), m, less whole periods: from zero to :attr:`period`; the lengths
        themselves if the period is infinite.
        """
        return lengths if math.isinf(self.period) else np.mod(lengths, self.period)

    def require_period(self, shortest: float, why: str) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if planes across the direction meet
        themselves before ``shortest``, m; ``why`` says why that length is needed.
        """
        if self.period >= shortest * (1.0 - _ZERO_LENGTH):
            return
        direction = _write_direction(self.direction[: self.network.dimension])
        closure = "do not close"
        if self.period > self.spacing:
            closure = f"come back to themselves after {self.period:.6g} m"
        cell, longer_array = self._describe_cell()
        offers = [
            f"{_write_direction(vector)}, with {period:.6g} m"
            for vector, period in self._find_directions(shortest)
        ]
        fault = f"planes across {direction} {closure} in this periodic network"
        remedy = f"or {longer_array}"
        if offers:
            remedy = f"{longer_array}, or the direction {' or '.join(offers)}"
        reason = f"{why}: {shortest:.6g} m are needed{cell}"
        raise InputError(fault, reason, f"Take a shorter distance, {remedy}")

    def _describe_cell(self) -> tuple[str, str]:
        """Return two parts of the message of :meth:`require_period`: a sentence with the lengths of
        the cell along the direction, empty unless two or more are above zero; and words for an
        array that would have a longer period.
        """
        lengths = np.abs(self.network.cell[list(self.network.pbc)] @ self.direction)
        rounding = _ZERO_LENGTH * float(np.max(lengths))
        sides = [f"{length:.6g}" for length in lengths if length > rounding]
        if len(sides) < 2:
            return "", "a longer array"
        cell = (
            f". The cell is {' and '.join(sides)} m long along the direction, and the greatest"
            f" common measure counts"
        )
        # lengths of the cell that are equal along the direction are the period
        return cell, "an array whose numbers of cells make these lengths equal"

    def _find_directions(self, shortest: float) -> list[tuple[Array, float]]:
        """Return the two directions (d,) nearest to this one whose planes have a period of at least
        ``shortest``, m, each with its period, m; fewer if there are fewer.

        The candidates are the normals of planes whose Miller indices in the periodic cell have no
        common divisor; the period of a plane is one over the length of its reciprocal vector.
        """
        periods = self.network.cell[list(self.network.pbc)]
        reciprocal = np.linalg.pinv(periods).T  # rows b with b_i . a_j = delta_ij
        # higher indices have shorter periods; of (2 n + 1)^p indices at most _MOST_DIRECTIONS are
        # tried
        highest = np.floor(np.linalg.norm(periods, axis=1) / shortest).astype(int)
        affordable = int(0.5 * (_MOST_DIRECTIONS ** (1.0 / len(periods)) - 1.0))
        ranges = [range(-n, n + 1) for n in np.minimum(highest, affordable)]
        candidates = []
        for indices in itertools.product(*ranges):
            if math.gcd(*indices) == 1:
                vector = np.array(indices) @ reciprocal
                period = 1.0 / float(np.linalg.norm(vector))
                if period >= shortest:
                    cosine = float(vector @ self.direction) * period
                    candidates.append((cosine, period * vector, period))
        # by rounded cosines, so that directions that are equally near keep their order
        candidates.sort(key=lambda candidate: -round(candidate[0], 9))
        d = self.network.dimension
        # the sum with zero makes 0 of -0
        return [(np.round(unit[:d], 12) + 0.0, period) for _, unit, period in candidates[:2]]

    @cached_property
    def is_at_flat_wall(self) -> Flags:
        """(n_c,) whether each contact is that of a ball i and a flat wall j, whose position may be
        any.
        """
        return np.isinf(self.network.radii[self.network.j])

    @cached_property
    def lengths(self) -> Array:
        """(n_c,) lengths of contacts along the direction, m, with a sign: from the centre of ball i
        to that of ball j, or to the point in which ball i touches a flat wall.
        """
        network = self.network
        # vector is that between the centres, which the normal of a contact need not be along
        to_centres = network.vector @ self.direction
        to_walls = network.arm_i * (network.normal @ self.direction)
        return np.where(self.is_at_flat_wall, to_walls, to_centres)

    @cached_property
    def crossings(self) -> NDArray[np.intp]:
        """(n_c,) how many times each contact, from ball i to ball j, passes the beginning of the
        course: above zero for a contact that leads from the end of the course on to its beginning,
        below zero for one that leads back from the beginning to the end, and zero for all others,
        as for contacts with flat walls. A contact that is longer along the direction than the
        period may pass it more than once.
        """
        if math.isinf(self.period):
            return np.zeros(self.network.n_contacts, int)
        place_step = self.places[self.network.j] - self.places[self.network.i]
        crossings = np.rint((self.lengths - place_step) / self.period).astype(int)
        return np.where(self.is_at_flat_wall, 0, crossings)

    def with_ends(self, ends: str) -> Course:
        """Return the course through the network with the ``ends`` "periodic", "free" or "walls",
        see :data:`~granphon.waves.settings.ENDS`.

        A network without a period along the direction keeps the ends that it has. Raises
        :class:`~granphon.base.errors.InputError` for walls in such a network, and what
        :meth:`_hold_walls` and :func:`drop_falling` raise.
        """
        if ends == "periodic":
            return self
        has_period = math.isfinite(self.period)
        if ends == "free":
            return self._cut_free() if has_period else self  # without a period nothing is cut
        if not has_period:
            fault = "there is no place for walls: the network has no period along this direction"
            mend = "Leave ends out: the network then has the ends that it has"
            raise InputError(fault, "Walls are made where a period is cut", mend)
        return self._hold_walls()

    def _cut_free(self) -> Course:
        """Return the course through the network without the contacts that pass its beginning, and
        without the balls that static forces then push over; see :func:`drop_falling`.
        """
        network = self.network
        contacts = np.flatnonzero(self.crossings == 0)
        contact_fields = {name: getattr(network, name)[contacts] for name in network.contact_fields}
        stable_network = drop_falling(replace(network, **contact_fields), network)
        has_fallen = network.moving & ~stable_network.moving
        has_end_fallen = has_fallen[network.i[contacts]] | has_fallen[network.j[contacts]]
        return replace(
            self,
            network=stable_network,
            face=0.0,
            is_known_stable=True,
            contacts=contacts[~has_end_fallen],
        )

    def _hold_walls(self) -> Course:
        """Return the course through the network in which the last balls, those with contacts that
        pass the beginning, are held: they are the walls.

        Raises :class:`~granphon.base.errors.InputError` if no contact passes the beginning, and if
        no ball is left that moves.
        """
        network = self.network
        is_crossing = self.crossings != 0
        if not np.any(is_crossing):
            raise InputError(
                "there are no balls for walls: no contact joins the last balls to the first",
                "Walls are made of the last balls, where a period is cut",
                "Leave ends out: the network is cut already",
            )
        is_forward = self.crossings[is_crossing] > 0
        wall_balls = np.unique(np.where(is_forward, network.i[is_crossing], network.j[is_crossing]))
        masses = np.array(network.masses)
        masses[wall_balls] = math.inf
        if not np.any(np.isfinite(masses)):
            raise InputError(
                "no ball moves between the walls",
                "All balls are held as walls",
                "Take a longer array, or other ends",
            )
        # the wall in front of the first balls is the one behind the last, a period earlier
        face = float(np.max(self.places[wall_balls])) - self.period
        return replace(self, network=replace(network, masses=masses), face=face)

    def find_losses(self, losses: Losses) -> Losses:
        """Return the ``losses`` of the network before its ends were cut or held as those of the
        network of this course.
        """
        contacts = slice(None) if self.contacts is None else self.contacts
        return replace(
            losses,
            network=self.network,
            damping=losses.damping[:, contacts],
            factors=losses.factors[:, contacts],
            dashpot=losses.dashpot[:, contacts],
            tsuji=losses.tsuji[contacts],
        )

    def find_plane(self, place: float, role: str) -> Index:
        """Return the indices (k,) of the plane of balls nearest to a ``place``, m, among balls that
        move.

        The plane has the balls that lie, along the direction, within a quarter of a diameter of the
        ball nearest to the place; in a network of no lattice, which has no planes, within nine
        twentieths. Raises :class:`~granphon.base.errors.InputError` if no ball is within a diameter
        of the place; ``role`` says in the message what the plane is for.
        """
        moving = np.flatnonzero(self.network.moving)
        offsets = self._find_offsets(self.places[moving] - place)
        # rounded, so that of balls that are equally near the first is taken
        distances = np.round(np.abs(offsets) / self.spacing, 6)
        nearest = int(np.argmin(distances))
        if abs(offsets[nearest]) > self.spacing:
            low = float(np.min(self.places[moving]))
            high = float(np.max(self.places[moving]))
            why = f"Balls lie from {low:.6g} to {high:.6g} m along the direction"
            mend = "Take a shorter distance, or a longer array"
            raise InputError(
                f"there is no plane of balls for the {role} at {place:.6g} m", why, mend
            )
        thickness = _LAYER_THICKNESS if self.network.lattice is None else _PLANE_THICKNESS
        distances_from_nearest = np.abs(self._find_offsets(offsets - offsets[nearest]))
        return moving[distances_from_nearest <= thickness * self.spacing]

    @property
    def is_closed(self) -> bool:
        """Whether the last balls are neighbours of the first: the network repeats along the
        direction, and was given no ends.
        """
        return math.isfinite(self.period) and math.isnan(self.face)

    def _find_offsets(self, lengths: Array) -> Array:
        """Return ``lengths`` (n,), m, less whole periods, so that the magnitude of each is least;
        on a course that is not closed, the lengths themselves.
        """
        if not self.is_closed:
            return lengths
        return lengths - self.period * np.rint(lengths / self.period)

    def find_place(self, balls: Index) -> float:
        """Return the mean place, m, of ``balls`` (k,), which lie near each other along the
        direction.
        """
        places = self.places[balls]
        return float(places[0] + np.mean(self._find_offsets(places - places[0])))

    def find_distance(self, start: float, balls: Index) -> float:
        """Return the mean distance, m, of ``balls`` (k,) ahead of the place ``start``, m. On a
        closed course it is measured in the sense of the direction, and is never below zero.
        """
        ahead = self.find_place(balls) - start
        return float(np.mod(ahead, self.period)) if self.is_closed else ahead

    def find_echo(self, start: float, balls: Index) -> float:
        """Return the detour, m, of the first echo: the length of its path less that of the path
        from the place ``start``, m, to ``balls`` (k,).

        Balls within a diameter of an end send or hear the pulse and its reflection there as one, so
        that this reflection is no echo. If neither reflection is one, the first echo has run
        through the whole course and back. On a closed course the echo is the pulse that runs the
        other way round.
        """
        if self.is_closed:
            return self.period - 2.0 * self.find_distance(start, balls)
        if math.isfinite(self.period):
            first_end = 0.0
            last_end = self.period
        else:
            moving_places = self.places[self.network.moving]
            first_end = float(np.min(moving_places))
            last_end = float(np.max(moving_places))
        detour_by_first = 2.0 * (start - first_end)
        detour_by_last = 2.0 * (last_end - self.find_place(balls))
        # a detour up to this is not heard by itself
        least_detour = 2.0 * self.spacing
        detours = [detour for detour in (detour_by_first, detour_by_last) if detour > least_detour]
        return min(detours, default=2.0 * (last_end - first_end))


def _write_direction(direction: Array) -> str:
    """Return the text of a vector (d,), such as "(0, 1)"."""
    return f"({', '.join(f'{x:.6g}' for x in direction)})"


def _find_period(network: ContactNetwork, direction: Array) -> float:
    """Return the distance, m, after which planes across ``direction`` (3,) meet themselves in a
    ``network``: the greatest length of which the lengths of all periods along the direction are
    multiples; infinity if no period leads along it.
    """
    periods = network.cell[list(network.pbc)]
    heights = np.abs(periods @ direction)  # lengths along the direction
    lengths = np.linalg.norm(periods, axis=1)
    rounding = _ZERO_LENGTH * float(np.max(lengths, initial=0.0))
    periodic_heights = heights[heights > _ZERO_LENGTH * lengths].tolist()
    if not periodic_heights:
        return math.inf
    period: float = periodic_heights[0]
    for height in periodic_heights[1:]:
        period = _find_common_measure(period, height, rounding)
    return period


def _find_common_measure(a: float, b: float, rounding: float) -> float:
    """Return the greatest length, m, of which the lengths ``a`` and ``b``, m, are both multiples,
    by Euclid's algorithm; lengths up to ``rounding``, m, are zero.
    """
    while b > rounding:
        remainder = abs(a - b * round(a / b))
        a = b
        b = remainder
    return a


def drop_falling(cut: ContactNetwork, whole: ContactNetwork) -> ContactNetwork:
    """Return a network ``cut`` from a ``whole`` one without the balls that static forces push over;
    ``cut`` itself if no static forces act (``prestress``), or if it is stable.

    The balls of a cut still feel the forces of the contacts that they have lost, as dead loads,
    which keep the balance and do not change with small motions. A ball that hangs on too few
    contacts (:func:`_find_hanging`) rolls off them under such a load, and then carries nothing: in
    the returned network the ball does not move and has no contacts. Balls that hang in the whole
    network too stay. If static forces still push over several balls that hang together, the ball
    that moves most in each of these motions is left out, again and again until the network is
    stable.

    Raises :class:`~granphon.base.errors.InstabilityError` if the whole network is not stable, if
    nothing of the cut network is held, or if the network is too large for its motions to be found;
    and :class:`~granphon.base.errors.ConvergenceError` as :func:`is_stable` and
    :func:`find_falling_motions` do.
    """
    if not cut.prestress:
        return cut
    uncut_operator = make_operator(whole)
    # the whole network decides which fall is allowed: the cut one has the loads of the contacts
    # that it lost, which are no imbalance that a program has left
    fall = find_allowed_fall(uncut_operator)
    if is_stable(make_operator(cut), fall):
        return cut
    require_stable(uncut_operator)
    hanging_by_cut = np.setdiff1d(_find_hanging(cut), _find_hanging(whole))
    network = _detach(cut, hanging_by_cut)
    while network.n_contacts:
        operator = make_operator(network)
        if is_stable(operator, fall):
            return network
        falls = operator.values(find_falling_motions(operator, fall))  # (n_free, motions, falls)
        sizes = np.linalg.norm(falls, axis=1)
        leaders = np.unique(np.argmax(sizes, axis=0))  # the ball that moves most in each fall
        network = _detach(network, operator.balls[leaders])
    raise InstabilityError(_FALL_MESSAGE)


def _find_hanging(network: ContactNetwork) -> Index:
    """Return the indices (k,) of the balls of a ``network`` that hang: no contact pulls at them,
    and fewer contacts hold them than there are dimensions, where contacts with other balls that
    hang do not count. Bodies that do not move do not hang.
    """
    i = network.i
    j = network.j
    n_balls = network.n_balls
    # a contact that pulls counts as many contacts as there are dimensions: a ball hangs on it in a
    # stable way, as on a rope
    weights = np.where(network.normal_force < 0.0, network.dimension, 1)
    is_hanging = np.zeros(n_balls, bool)
    count_before = -1
    while np.count_nonzero(is_hanging) > count_before:
        count_before = int(np.count_nonzero(is_hanging))
        weights_left = np.where(is_hanging[i] | is_hanging[j], 0, weights)
        n_as_i = np.bincount(i, weights_left, n_balls)
        n_as_j = np.bincount(j, weights_left, n_balls)
        is_hanging = network.moving & (n_as_i + n_as_j < network.dimension)
    return np.flatnonzero(is_hanging)


def _detach(network: ContactNetwork, balls: Index) -> ContactNetwork:
    """Return the ``network`` with ``balls`` (k,) that do not move and have no contacts; all balls
    keep their numbers.
    """
    masses = np.array(network.masses)
    masses[balls] = math.inf
    is_detached = np.isin(network.i, balls) | np.isin(network.j, balls)
    kept_fields = {name: getattr(network, name)[~is_detached] for name in network.contact_fields}
    return replace(network, masses=masses, **kept_fields)


def find_envelope(signals: Array) -> Array:
    """Return the envelopes (..., n_t) of ``signals`` (..., n_t): the magnitudes of their analytic
    signals.
    """
    from scipy.fft import next_fast_len
    from scipy.signal import hilbert

    count = signals.shape[-1]
    # zeros behind the record keep the transform, which is periodic, from joining its end to its
    # beginning
    analytic_signals = hilbert(signals, next_fast_len(2 * count), axis=-1)
    return np.asarray(np.abs(analytic_signals)[..., :count])


def _explain_unknown_time(signal: Array, shift: float, is_held: bool) -> str:
    """Return why a ``signal`` (n_t,) has no time of flight; empty if it has one.

    ``shift`` is the time of flight in steps of the record, nan if the burst or the signal has no
    maximum. ``is_held`` says whether the record holds the whole signal; it is false if the shift is
    nan.
    """
    if not np.any(signal):
        return "the signal is zero"
    if not is_held:
        return _SHORT_RECORD_REASON
    return _EARLY_REASON if shift <= _LEAST_SHIFT else ""


def find_arrivals(
    times: Array, signals: Array, sent: Array, duration: float, method: str, threshold: float
) -> tuple[Array, list[str]]:
    """Return the times of flight of n ``signals``, by which they come after the signal ``sent``,
    and why times are not known.

    Parameters
    ----------
    times : (n_t,) even times of the readings, s.
    signals, sent : (n, n_t) and (n_t,), each in any unit.
    duration : length of the signal that was sent, s. A record that is shorter than the time of
        flight and this duration does not hold the signal.
    method : "envelope": the time between the maxima of both envelopes; the maximum of an envelope
        is the first one that has half the height of the greatest. "first": the time between the
        moments at which the envelopes first reach the part ``threshold`` of that maximum.
        "correlation": the shift at which the cross-correlation of both signals is greatest.
    threshold : part of the maximum, above 0 and below 1, for the method "first"; not examined.

    Returns
    -------
    flights : (n,) s; nan if a signal is zero, does not come after the burst, or is not over when
        the record ends.
    reasons : for each signal the reason why its time is nan; empty if it is known.

    Raises :class:`~granphon.base.errors.InputError` for an unknown method.
    """
    method = one_of("method", method, METHODS)
    step = float(times[1] - times[0])
    if method == "correlation":
        shifts = np.array([_correlate(signal, sent) for signal in signals])
    else:
        envelopes = find_envelope(np.vstack([sent, signals]))
        positions = np.array(
            [_find_pulse_position(envelope, method, threshold) for envelope in envelopes]
        )
        shifts = positions[1:] - positions[0]
    has_whole_signal = step * shifts + duration <= times[-1] + step  # False for nan
    reasons = [
        _explain_unknown_time(signal, shift, is_held)
        for signal, shift, is_held in zip(signals, shifts, has_whole_signal, strict=True)
    ]
    is_unknown = [bool(reason) for reason in reasons]
    return np.where(is_unknown, np.nan, step * shifts), reasons


def _correlate(signal: Array, sent: Array) -> float:
    """Return the shift, in readings, at which the cross-correlation of a ``signal`` (n_t,) and the
    ``sent`` one (n_t,) is greatest: 0 if that is the first shift, and nan if it is the last one,
    beyond which the correlation may be greater.
    """
    from scipy.signal import correlate

    correlation = correlate(signal, sent)[sent.size - 1 :]  # shifts from zero on
    greatest = int(np.argmax(correlation))
    if greatest == 0:
        return 0.0
    if greatest == correlation.size - 1:
        return math.nan
    # the extreme of the parabola through the values around the greatest
    low, middle, high = correlation[greatest - 1 : greatest + 2]
    curvature = low - 2.0 * middle + high
    return greatest + 0.5 * float((low - high) / curvature)


def _find_pulse_position(envelope: Array, method: str, threshold: float) -> float:
    """Return the position of a pulse in its ``envelope`` (n_t,), in readings: that of the first
    maximum that has half the height of the greatest value, or with the ``method`` "first" the
    position at which the envelope first has the share ``threshold`` of this maximum; nan if there
    is no such maximum.
    """
    inner = envelope[1:-1]
    peaks = 1 + np.flatnonzero((inner > envelope[:-2]) & (inner >= envelope[2:]))
    high_peaks = peaks[envelope[peaks] >= _MAXIMUM_SHARE * np.max(envelope)]
    if not high_peaks.size:
        return np.nan
    top = int(high_peaks[0])
    if method == "first":
        return _find_begin(envelope[: top + 1], threshold * envelope[top])
    return _fit_top(envelope, top)


def _find_begin(envelope: Array, level: float) -> float:
    """Return the position, in readings, at which an ``envelope`` (n_t,), taken as linear between
    readings, first has a ``level``, which one of the readings must reach.
    """
    begin = int(np.argmax(envelope >= level))
    if begin == 0:
        return 0.0
    below = envelope[begin - 1]
    above = envelope[begin]
    return begin - 1 + float((level - below) / (above - below))


def _fit_top(envelope: Array, top: int) -> float:
    """Return the position, in readings, of the maximum of a parabola that is fitted to an
    ``envelope`` (n_t,) about its maximum at the index ``top``: to all readings around the maximum
    that are above the share :data:`_TOP_SHARE` of it, and at least to three.
    """
    low_readings = np.flatnonzero(envelope < _TOP_SHARE * envelope[top])
    n_before = int(np.searchsorted(low_readings, top))
    last_before = int(low_readings[n_before - 1]) if n_before else -1
    first_after = int(low_readings[n_before]) if n_before < low_readings.size else envelope.size
    first = min(top - 1, last_before + 1)
    last = max(top + 1, first_after - 1)
    heights = envelope[first : last + 1] / envelope[top]
    # weights vanish towards the share, so that the result does not jump when a reading passes it
    weights = np.sqrt(np.maximum(heights - _TOP_SHARE, _LEAST_WEIGHT))
    offsets = np.arange(first, last + 1) - top
    half_curvature, slope, _ = np.polyfit(offsets, heights, 2, w=weights)
    return float(np.clip(top - 0.5 * slope / half_curvature, first, last))


def _find_delay(signal: Array, times: Array, frequency: float) -> float:
    """Return the magnitude of the group delay, s, of a ``signal`` (n_t,) with ``times`` (n_t,), s,
    at a ``frequency``, Hz: the magnitude of -d phase / d omega of the signal's Fourier integral.

    The delay of a burst that is even or odd about the time zero is zero. The delay is nan if the
    signal does not have the frequency.
    """
    integrand = signal * np.exp(-2j * np.pi * frequency * times)
    integral = np.sum(integrand)
    if not abs(integral) > 0.0:
        return math.nan
    return abs(float(np.real(np.sum(times * integrand) / integral)))


def _find_delay_error(signals: Array, times: Array, frequency: float) -> float:
    """Return the standard error of the group delay of the mean of ``signals`` (n, n_t) at a
    ``frequency``, Hz, in s; ``times`` (n_t,) are in s.

    The delay is a quotient of two means over signals, which are taken as independent, and the error
    of this quotient is found to first order. The error is zero for one signal, and if the mean does
    not have the frequency and so has no delay.
    """
    wave = np.exp(-2j * np.pi * frequency * times)
    integrals = signals @ wave  # (n,)
    first_moments = signals @ (times * wave)
    mean_integral = np.mean(integrals)
    n = len(signals)
    if n < 2 or not abs(mean_integral) > 0.0:
        return 0.0
    delay = np.mean(first_moments) / mean_integral
    # what each signal adds to the deviation of the quotient; the sum over signals is zero
    deviations = np.real((first_moments - delay * integrals) / mean_integral)
    return float(np.linalg.norm(deviations)) / math.sqrt(n * (n - 1))


def _make_gate(times: Array, reach: float) -> Array:
    """Return factors (n_t,) at ``times`` (n_t,), s. They are 1 around the time zero, fall to either
    side over the last third of the ``reach``, s, which is above zero, and are 0 beyond it.
    """
    return np.clip(3.0 * (1.0 - np.abs(times) / reach), 0.0, 1.0)


class _Flight(NamedTuple):
    """The flight of a pulse by its envelope.

    Attributes
    ----------
    time : time of flight, s; nan if it is not known.
    shape_error : error of the time, s, because the pulse changes its shape; nan as the time.
    scatter : error of the time, s, because of the speckle; nan as the time.
    why_unknown : the reason why the time is not known; empty if it is known.
    """

    time: float
    shape_error: float = math.nan
    scatter: float = math.nan
    why_unknown: str = ""


@result_class
class Pulse(Result):
    """A pulse that was sent through a network, as receivers heard it. Signals are velocities of
    balls along the polarisation.

    Attributes
    ----------
    frequency, cycles : frequency, Hz, and number of periods of the burst that pushes the source,
        sin(omega (t - P/2)) (1 - cos(2 pi t/P))/2 with omega = 2 pi frequency and
        P = cycles/frequency.
    direction, polarisation : (3,) unit vectors, in which the pulse travels and in which the source
        pushes.
    damping, tangential_damping : s, the viscosity of contacts over their stiffness, in normal
        motion and in all other motions, means over the contacts.
    drag : (2,) 1/s, drag of displacements and of rotations.
    distance : distance of the receiving plane from the source along the direction, m.
    times : (n_t,) times of the readings from the beginning of the burst, s.
    sent : (n_t,) force on each ball of the source, N.
    sources, receivers : indices of the balls that are pushed, and of those of the receiving plane.
    samples : (n_r,) number of the sample that each receiver belongs to; zeros for a single sample.
    signals : (n_r, n_t) velocity of each receiver, m/s.
    energies : (2,) kinetic plus elastic energy of all balls at the end of the burst, and at the end
        of the record, J; means over samples.
    plane_distances : (n_p,) distances of further planes from the source, m; may be empty.
    planes : (n_p, n_t) mean velocity of each further plane, m/s.
    frames : (n_f,) times at which the motions of all balls were kept, s; may be empty.
    velocities : (n_f, n, 3) velocities of all balls at the times ``frames``, m/s.
    warnings : one sentence for each limit of the model that the network exceeds; one if balls were
        left out as far inside as the receivers; and those of :meth:`judge`.
    echo : detour of the first echo, m: how much longer its path is than the distance. The echo is
        from an end, or in a closed network the pulse that runs round in the other direction.
    fastest : (2,) upper bounds of the velocity of long waves, m/s: of this polarisation, and of all
        polarisations.
    left_out : number of balls that were left out because static forces push them over where free
        ends were cut.
    """

    frequency: float = held(float, unit="Hz")
    cycles: float = held(float)
    direction: Array = held(float, "3")
    polarisation: Array = held(float, "3")
    damping: float = held(float, unit="s")
    tangential_damping: float = held(float, unit="s")
    drag: Array = held(float, "2", "1/s")
    distance: float = held(float, unit="m")
    times: Array = held(float, "t", "s")
    sent: Array = held(float, "t", "N")
    sources: Index = held(int, "s")
    receivers: Index = held(int, "r")
    samples: Index = held(int, "r")
    signals: Array = held(float, "r t", "m/s")
    energies: Array = held(float, "2", "J")
    plane_distances: Array = held(float, "p", "m")
    planes: Array = held(float, "p t|p", "m/s")
    frames: Array = held(float, "f", "s")
    velocities: Array = held(float, "f n 3|f", "m/s")
    warnings: tuple[str, ...] = held((str, ...), default=())
    echo: float = held(float, unit="m", default=math.inf)
    fastest: Array = held(float, "2", "m/s", default_factory=lambda: np.full(2, math.inf))
    left_out: int = held(int, default=0)

    def __post_init__(self) -> None:
        """Give ``planes`` and ``velocities`` their shapes, also if they are empty, and check all
        fields.
        """
        # plain data do not keep the shape of an array without numbers
        if not self.planes.size:
            object.__setattr__(
                self, "planes", np.zeros((len(self.plane_distances), self.times.size))
            )
        if not self.velocities.size:
            object.__setattr__(self, "velocities", np.zeros((len(self.frames), 0, 3)))
        super().__post_init__()

    @cached_property
    def coherent(self) -> Array:
        """(n_t,) mean velocity of the receiving plane, over all samples, m/s."""
        return read_only(np.mean(self.signals, axis=0))

    @cached_property
    def speckle(self) -> Array:
        """(n_r, n_t) signal of each receiver minus the coherent signal, m/s."""
        return read_only(self.signals - self.coherent)

    @cached_property
    def speckle_amplitude(self) -> Array:
        """(n_t,) root of the mean square of the speckle over the balls of the plane, m/s."""
        return read_only(np.sqrt(np.mean(self.speckle**2, axis=0)))

    @property
    def coherent_fraction(self) -> float:
        """Part of the integral over time of the mean square of the signals that is coherent; zero
        if all signals are zero.
        """
        total_square = float(np.sum(np.mean(self.signals**2, axis=0)))
        if not total_square:
            return 0.0
        return float(np.sum(self.coherent**2)) / total_square

    @property
    def envelope(self) -> Array:
        """(n_t,) envelope of the coherent signal, m/s."""
        return find_envelope(self.coherent)

    @property
    def damping_ratio(self) -> float:
        """Damping ratio zeta at the frequency of the burst, (omega tau + gamma/omega)/2, of which
        the critical one is 1: with the :attr:`damping` tau of normal motion and the :attr:`drag`
        gamma of displacements. In a period the amplitude falls to exp(-2 pi zeta).
        """
        return self._find_damping_ratio(self.damping)

    def _find_damping_ratio(self, damping: float) -> float:
        """Return the damping ratio at the frequency of the burst, with a ``damping``, s, of
        contacts and the drag of displacements.
        """
        omega = 2.0 * math.pi * self.frequency
        return 0.5 * (omega * damping + float(self.drag[0]) / omega)

    @property
    def loss(self) -> float:
        """Part of the energy that is lost from the end of the burst to the end of the record; zero
        if there is no energy at the end of the burst.
        """
        start, end = self.energies.tolist()
        return 1.0 - end / start if start else 0.0

    def arrival(self, method: str = "envelope", threshold: float = _THRESHOLD) -> float:
        """Return the time of flight of the coherent signal, s; nan if :attr:`time_of_flight` is
        nan, or if the signal by this method does not come after the burst or is not over at the end
        of the record.

        Parameters
        ----------
        method : "envelope": from the maximum of the envelope of the burst to the first maximum of
            the envelope of the signal that has at least half of the greatest height. "first":
            between the times at which the two envelopes first have the part ``threshold`` of that
            maximum. "correlation": the shift at which the cross-correlation of the signal and the
            burst is greatest; it follows single waves under the envelope, so for long pulses it
            tells the phase, up to whole periods.
        threshold : part of the maximum, above 0 and below 1, for the method "first"; other methods
            do not use it.

        Raises :class:`~granphon.base.errors.InputError` for an unknown method, and a threshold that
        is not between 0 and 1.
        """
        flights, _ = self._find_arrivals(self.coherent[None], method, threshold)
        return math.nan if self.why_unknown else float(flights[0])

    def arrivals(self, method: str = "envelope", threshold: float = _THRESHOLD) -> Array:
        """Return the time of flight (n_r,), s, of the signal of each receiver; nan if a signal is
        zero, does not come after the burst or is not over at the end of the record, and for all
        receivers if an echo may come before the pulse is at its height.

        ``method`` and ``threshold`` are those of :meth:`arrival`, and so is what is raised.
        """
        flights, _ = self._find_arrivals(self.signals, method, threshold)
        return np.full(flights.shape, math.nan) if self._explain_echo() else flights

    def _find_arrivals(
        self, signals: Array, method: str, threshold: float
    ) -> tuple[Array, list[str]]:
        """Return the times of flight (n,), s, of ``signals`` (n, n_t), and for each time the reason
        why it is not known, empty if it is; see :func:`find_arrivals`.

        Raises :class:`~granphon.base.errors.InputError` for an unknown ``method``, and a
        ``threshold`` that is not between 0 and 1.
        """
        threshold = positive("threshold", threshold)
        if threshold >= 1.0:
            raise InputError(
                f"threshold is {threshold:g}", mend="Give a part of the maximum, below 1"
            )
        return find_arrivals(
            self.times, signals, self.sent, self.cycles / self.frequency, method, threshold
        )

    @cached_property
    def _flight(self) -> _Flight:
        """The flight of the coherent signal, and its errors."""
        times, reasons = self._find_arrivals(self.coherent[None], "envelope", _THRESHOLD)
        time = float(times[0])
        why = self._explain_echo() or reasons[0] or self._explain_too_fast(time)
        if why:
            return _Flight(math.nan, why_unknown=why)
        since_middle, pulse_gate, long_gate = self._make_gates(time)
        # waves near the top of a band come late: one delay is of the pulse alone, and one of the
        # pulse with all that follows. Both are found, as one may agree with the envelope by chance
        pulse = self.coherent * pulse_gate
        pulse_delay = _find_delay(pulse, since_middle, self.frequency)
        long_delay = _find_delay(self.coherent * long_gate, since_middle, self.frequency)
        shape_error = max(pulse_delay, long_delay)
        scatter = _find_delay_error(self.signals * pulse_gate, since_middle, self.frequency)
        share_kept = self._find_share(pulse) / self._find_share(self.sent)
        is_error_small = shape_error < _LARGEST_ERROR * time  # False for nan
        if share_kept < _LEAST_SHARE or not is_error_small:
            why = (
                f"what arrives are other waves of the burst than those of its frequency,"
                f" {self.frequency:.6g} Hz, which are held back more than these: use another"
                f" frequency, such as one of a band, more cycles, or a shorter distance"
            )
            return _Flight(math.nan, why_unknown=why)
        return _Flight(time, shape_error, scatter)

    def _make_gates(self, time: float) -> tuple[Array, Array, Array]:
        """Return the times (n_t,), s, of readings since the height of a pulse whose flight takes
        the ``time``, s, and two gates, factors (n_t,) about the height: one keeps the pulse alone,
        and one keeps all that comes before an echo or the end of the record.
        """
        duration = self.cycles / self.frequency
        middle = time + 0.5 * duration
        echo_time = time + self.echo / float(self.fastest[0])
        reach_to_echo = min(echo_time, float(self.times[-1])) - middle
        since_middle = self.times - middle
        pulse_gate = _make_gate(since_middle, min(_GATE_REACH * duration, reach_to_echo))
        long_gate = _make_gate(since_middle, reach_to_echo)
        return since_middle, pulse_gate, long_gate

    def _explain_too_fast(self, time: float) -> str:
        """Return why no wave can have taken the ``time``, s, for the distance; empty if one
        can.
        """
        fastest = float(self.fastest[1])
        if not self.distance > (1.0 + _VELOCITY_EXCESS) * fastest * time:
            return ""
        return (
            f"the signal is highest {write_quantity(time, 's', 4)} after the burst, and"
            f" the fastest waves of the network, of {fastest:.4g} m/s at most, take longer:"
            f" use a longer distance, another frequency or more cycles"
        )

    def _find_share(self, signal: Array) -> float:
        """Return the magnitude of the spectrum of a ``signal`` (n_t,), which is not zero, at the
        frequency of the burst, over the maximum of the spectrum. If waves of all frequencies travel
        at one velocity, a received signal has the share of the burst itself.
        """
        wave = np.exp(-2j * np.pi * self.frequency * self.times)
        highest = float(np.max(np.abs(np.fft.rfft(signal, 2 * signal.size))))
        return abs(complex(signal @ wave)) / highest

    def _explain_echo(self) -> str:
        """Return why an echo makes times of flight unknown, if an echo may come before the pulse is
        at its height; else an empty text.
        """
        # that the pulse was at its height shows only at the next reading
        interval = float(self.times[1] - self.times[0])
        needed_time = 0.5 * self.cycles / self.frequency + interval
        least_detour = needed_time * float(self.fastest[0])
        if self.echo >= least_detour:
            return ""
        return (
            f"an echo from an end, or what runs round a periodic network the other way, may come"
            f" before the pulse is at its height: its way is {self.echo:.4g} m longer, and"
            f" {least_detour:.4g} m are needed. Use a longer array, a shorter distance, a higher"
            f" frequency or fewer cycles"
        )

    def judge(self) -> tuple[str, ...]:
        """Return warnings about the pulse, none to two sentences. One is there if the damping ratio
        at the frequency of the burst, by the larger of both dampings, is above 0.3, which is too
        much for a velocity of sound. One says why the time of flight is not known; or, if the time
        is known, how far the velocity is known, if the :attr:`velocity_error` is above 3 percent.
        """
        greatest_damping = max(self.damping, self.tangential_damping)
        damping_ratio = self._find_damping_ratio(greatest_damping)
        remarks = [_DAMPED_REMARK] if damping_ratio > _LARGEST_DAMPING_RATIO else []
        if self.why_unknown:
            remarks.append(f"the arrival of the pulse is not known: {self.why_unknown}")
            return tuple(remarks)
        error = self.velocity_error / self.velocity
        if error > _WARNED_ERROR:
            accuracy = f"its velocity is known to {100.0 * error:.0f} % only: use"
            if self._flight.shape_error >= self._flight.scatter:
                remarks.append(
                    f"the pulse changes its shape on the way, and {accuracy} more cycles, a longer"
                    f" distance or a lower frequency"
                )
            else:
                remarks.append(
                    f"the pulse differs from ball to ball, and {accuracy} a wider array, or the"
                    f" mean of several samples"
                )
        return tuple(remarks)

    @property
    def time_of_flight(self) -> float:
        """Time of flight by the envelope of the coherent signal, s.

        The time is nan, and :attr:`warnings` say why, in six cases: the signal is zero; the signal
        does not come after the burst; the record ends before the pulse is over; an echo may come
        before the maximum of the pulse; the velocity would be above that of the fastest wave; other
        frequencies than that of the burst arrive, as in a gap.
        """
        return self._flight.time

    @property
    def why_unknown(self) -> str:
        """The reason why the time of flight is nan; empty if it is known."""
        return self._flight.why_unknown

    @property
    def velocity(self) -> float:
        """Distance over the time of flight by the envelope, m/s; nan if the time is not known."""
        return self.distance / self.time_of_flight

    @property
    def velocity_error(self) -> float:
        """How far the velocity may be from the group velocity at the frequency of the burst, m/s;
        nan if the velocity is not known.

        The error has two parts, whose squares add up. The first arises because the pulse changes
        its shape: it is the difference from the velocity by the group delay, -d phase / d omega of
        the signal at the frequency of the burst. Of two group delays, of the pulse alone and of all
        that comes before an echo or the end of the record, the one with the larger difference
        counts. The second part arises because signals differ from ball to ball: it is the standard
        error of the group delay, as if the balls of the plane were independent.

        The error is a lower bound if an echo comes so soon that only a part of the pulse counts,
        and if the signals of neighbours are alike.
        """
        flight = self._flight
        time_error = math.hypot(flight.shape_error, flight.scatter)
        return self.velocity * time_error / flight.time


def average_pulses(pulses: Sequence[Pulse]) -> Pulse:
    """Return one pulse with the receivers of all ``pulses``, each of which was sent through another
    sample: its coherent signal is the mean over all receivers.

    All records are cut to the length of the shortest. Frames are left out, as they are of one
    sample. Dampings are those of the first pulse, the other numbers means over samples, but
    ``left_out`` is the sum, ``echo`` the least and ``fastest`` the greatest. Warnings are those of
    all pulses that do not judge their velocity, and those that judge the velocity of the mean.

    Raises :class:`~granphon.base.errors.InputError` for what is no list or tuple, an empty list,
    and what is no pulse; and for pulses that differ in frequency, cycles, direction, polarisation,
    drag or burst, or by more than a tenth in their dampings or in the distances of planes. Pulses
    do not hold their ends, nor whether one ball or a plane was pushed: the caller has to see to
    these.
    """
    if not isinstance(pulses, Sequence):
        raise InputError(f"{brief(pulses)} is no list of pulses", mend="Give a list")
    if not pulses:
        raise InputError("there is no pulse to average", mend="Give one or more")
    for pulse in pulses:
        if not isinstance(pulse, Pulse):
            raise InputError(f"{brief(pulse)} is no pulse", mend="Leave it out")
    first = pulses[0]
    count = min(pulse.times.size for pulse in pulses)
    for pulse in pulses[1:]:
        _require_same_settings(pulse, first, count)
    # samples of all pulses are numbered one after the other
    n_samples = [int(np.max(pulse.samples)) + 1 for pulse in pulses]
    first_samples = np.cumsum([0, *n_samples[:-1]])
    samples = [pulse.samples + number for pulse, number in zip(pulses, first_samples, strict=True)]

    def mean(quantities: list[Any]) -> Any:
        """Return the mean of a quantity of each pulse, weighted with its number of samples."""
        return np.average(quantities, axis=0, weights=n_samples)

    mean_pulse = replace(
        first,
        distance=float(mean([pulse.distance for pulse in pulses])),
        times=first.times[:count],
        sent=first.sent[:count],
        sources=np.concatenate([pulse.sources for pulse in pulses]),
        receivers=np.concatenate([pulse.receivers for pulse in pulses]),
        samples=np.concatenate(samples),
        signals=np.concatenate([pulse.signals[:, :count] for pulse in pulses]),
        energies=mean([pulse.energies for pulse in pulses]),
        plane_distances=mean([pulse.plane_distances for pulse in pulses]),
        planes=mean([pulse.planes[..., :count] for pulse in pulses]),
        frames=np.zeros(0),
        velocities=np.zeros(0),
        echo=min(pulse.echo for pulse in pulses),
        fastest=np.max(np.stack([pulse.fastest for pulse in pulses]), axis=0),
        left_out=sum(pulse.left_out for pulse in pulses),
        warnings=(),
    )
    return replace(mean_pulse, warnings=(*_list_warnings(pulses), *mean_pulse.judge()))


def _list_warnings(pulses: Sequence[Pulse]) -> list[str]:
    """Return the warnings of all ``pulses``, each once, except judgements (:meth:`Pulse.judge`) of
    single pulses, which do not hold for the mean of the pulses.
    """
    warnings: list[str] = []
    for pulse in pulses:
        judgements = pulse.judge()
        for warning in pulse.warnings:
            if warning not in judgements and warning not in warnings:
                warnings.append(warning)
    return warnings


def _require_same_settings(pulse: Pulse, first: Pulse, count: int) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if a ``pulse`` was not sent with the settings
    of the ``first``; of the bursts, ``count`` times are compared.

    Dampings and the distances of all planes, which differ from sample to sample, need only be
    similar.
    """
    unlike_names = [
        name
        for name in ("frequency", "cycles", "direction", "polarisation", "drag")
        if not np.array_equal(getattr(pulse, name), getattr(first, name))
    ]
    # what depends on the balls differs a little from sample to sample
    unlike_names += [
        name
        for name in ("damping", "tangential_damping", "distance", "plane_distances")
        if not _is_similar(getattr(pulse, name), getattr(first, name))
    ]
    rounding = _ROUNDING * np.max(np.abs(first.sent))
    # bursts of other settings differ in any case, and are not named beside these
    if not unlike_names and not np.allclose(pulse.sent[:count], first.sent[:count], atol=rounding):
        unlike_names.append("sent")
    if unlike_names:
        fault = f"the pulses differ in {', '.join(unlike_names)}"
        raise InputError(fault, mend="Average pulses that were sent alike")


def _is_similar(values: ArrayLike, reference: ArrayLike) -> bool:
    """Whether ``values`` (...), none below zero, have the shape of a ``reference`` and differ
    from it by at most :data:`_LARGEST_DIFFERENCE` times the reference.
    """
    if np.shape(values) != np.shape(reference):
        return False
    return bool(np.allclose(values, reference, rtol=_LARGEST_DIFFERENCE, atol=0.0))


@dataclass(frozen=True, eq=False)
class PulseSource:
    """A pulse to be sent. Its fields are the arguments of
    :meth:`~granphon.waves.waves.Waves.transmit`, which says what they are.
    """

    frequency: float
    direction: ArrayLike
    distance: float
    cycles: float = 5.0
    polarisation: str | ArrayLike = "longitudinal"
    _: KW_ONLY
    source: str | int | Sequence[int] = "plane"
    ends: str = "free"
    damping: Any = 0.0
    tangential_damping: float | None = None
    drag: Any = 0.0
    dashpot: Any = 0.0
    restitution: Any = 1.0
    duration: float | None = None
    planes: ArrayLike = ()
    frames: ArrayLike = ()

    @property
    def losses(self) -> GivenLosses:
        """The losses of the pulse; raises what :meth:`GivenLosses.with_tangential` raises."""
        losses = GivenLosses(
            self.damping, drag=self.drag, dashpot=self.dashpot, restitution=self.restitution
        )
        return losses.with_tangential(self.tangential_damping)

    @classmethod
    def of(
        cls, settings: PulseSettings, network: ContactNetwork, direction: ArrayLike | None = None
    ) -> Self:
        """Return the pulse of the ``settings`` of a scene in a ``direction`` (1,) to (3,),
        Cartesian, or along x for None.

        If the settings have no distance, the distance is half of the period of the ``network``, or
        a quarter if ends are periodic, less a small part of a diameter (of two planes that are
        equally near, that nearer to the source is then taken in all samples). Raises
        :class:`~granphon.base.errors.InputError` for what is no direction; and without a distance,
        if the network has no period along the direction, or one too short for a pulse, and what
        :meth:`Course.along` raises.
        """
        given_direction = [1.0] if direction is None else direction
        unit_vector = read_vector("direction", given_direction, network.dimension)
        distance = settings.distance
        if distance is None:
            course = Course.along(network, unit_vector)
            if math.isinf(course.period):
                raise InputError(
                    "the pulse has no distance",
                    "A part of the period is taken by default, and the network does not repeat"
                    " along the direction",
                    "Give pulse.distance",
                )
            is_periodic = settings.ends == "periodic"
            share_words = "a quarter" if is_periodic else "half"
            course.require_period(2.0 * course.spacing, f"A pulse goes {share_words} of that way")
            share = 0.25 if is_periodic else 0.5
            distance = share * course.period - _DISTANCE_REDUCTION * course.spacing
        return cls(
            settings.frequency,
            given_direction,
            distance,
            settings.cycles,
            settings.polarisation,
            source=settings.source,
            ends=settings.ends,
            **settings.losses,
        )


@dataclass(frozen=True, eq=False)
class Route:
    """The route of a pulse in a network, and the times at which it is heard.

    Attributes
    ----------
    course : the network with its ends, and the order of its balls along the direction.
    burst : the force as a function of time.
    push : (3,) unit vector along which the source pushes.
    start : place from which distances are counted, m.
    sources : (k,) indices of the balls that are pushed.
    groups : indices of the balls of the receiving plane, and of those of each further plane, an
        array for each.
    fastest : (2,) upper bounds of the velocity of long waves, m/s, of :func:`_find_fastest`: along
        ``push``, and in the stiffest direction.
    times : (n_t,) times at which the pulse is read, s.
    frames : (n_f,) times at which the motions of all balls are kept, s.
    """

    course: Course
    burst: ToneBurst
    push: Array
    start: float
    sources: Index
    groups: list[Index]
    fastest: Array
    times: Array
    frames: Array

    @classmethod
    def of(cls, network: ContactNetwork, request: PulseSource, margin: float = 1.0) -> Self:
        """Return the route through the ``network`` of the pulse of a ``request``.

        A ``margin`` above one says that the pulse is meant for another network, in which waves may
        be slower or faster by this factor: whether the pulse that runs round a periodic network the
        other way comes too early is then judged by the slowest waves. Raises what
        :meth:`~granphon.waves.waves.Waves.transmit` raises, except for losses, for frequencies that
        the network does not have, for the number of products with D, and for the memory of frames.
        """
        burst = _read_burst(request)
        direction = read_vector("direction", request.direction, network.dimension)
        push = read_push(network, direction, request.polarisation)
        further_distances = _read_list("planes", request.planes, "m", "above zero")
        frames = _read_list("frames", request.frames, "s", "zero or above")
        distance = positive("distance", request.distance, "m")
        distances = [distance, *further_distances.tolist()]
        course = _find_course(network, direction, request.ends, max(distances))
        sources = _find_sources(course, request.source)
        start = _find_start(course, request.source, sources)
        groups = [course.find_plane(start + length, "receivers") for length in distances]
        receivers = groups[0]
        _require_apart(course, distance, sources, receivers)
        has_fallen = request.ends == "free" and bool(
            np.any(network.moving & ~course.network.moving)
        )
        fastest = _find_fastest(course, push, sources, receivers, has_fallen)
        if request.duration is None:
            flight_length = course.find_distance(start, receivers)
            lengths = flight_length, max(distances)
            duration = _choose_duration(course, burst, lengths, float(fastest[0]), margin)
        else:
            duration = positive("duration", request.duration, "s")
        return cls(
            course=course,
            burst=burst,
            push=push,
            start=start,
            sources=sources,
            groups=groups,
            fastest=fastest,
            times=_list_readings(burst, duration),
            frames=frames,
        )

    @property
    def last_time(self) -> float:
        """The time to which the pulse is propagated, s: that of the last frame, or
        :attr:`end_time` if that is later.
        """
        return float(max([self.end_time, *self.frames]))

    @property
    def end_time(self) -> float:
        """The end of the record, or of the burst if that is later, s."""
        return max(float(self.times[-1]), self.burst.duration)


def _read_burst(request: PulseSource) -> ToneBurst:
    """Return the burst of a ``request``.

    Raises :class:`~granphon.base.errors.InputError` for a frequency that is not above zero, and for
    fewer cycles than 1.
    """
    hertz = positive("frequency", request.frequency, "Hz")
    cycles = positive("cycles", request.cycles)
    if cycles < 1.0:
        raise InputError(f"cycles is {cycles:g}", mend="Give 1 or more")
    return ToneBurst(hertz, cycles)


def _find_course(network: ContactNetwork, direction: Array, ends: str, farthest: float) -> Course:
    """Return the course along ``direction`` (3,), a unit vector, through the ``network`` with the
    ``ends``, a word, for a pulse that is heard at distances up to ``farthest``, m.

    Raises :class:`~granphon.base.errors.InputError` for another word, and for a period that is
    shorter than such a pulse needs; and what :meth:`Course.along` and :meth:`Course.with_ends`
    raise.
    """
    ends = one_of("ends", ends, ENDS)
    course = Course.along(network, direction)
    if ends == "periodic":
        why = "The pulse that runs the other way round would come first"
        course.require_period(2.0 * farthest, why)
    course.require_period(farthest, "The pulse would meet itself")
    return course.with_ends(ends)


def _find_start(course: Course, source: str | int | Sequence[int], sources: Index) -> float:
    """Return the place, m, on a ``course`` from which distances count: the face if the ``source``
    is "plane" and the course was given ends, and else the place of the balls ``sources`` (k,).
    """
    is_plane = isinstance(source, str) and source == "plane"
    is_at_face = is_plane and not math.isnan(course.face)
    return course.face if is_at_face else course.find_place(sources)


def _require_apart(course: Course, distance: float, sources: Index, receivers: Index) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if some of the ``receivers`` (k,), balls at a
    ``distance``, m, on the ``course``, are among the ``sources``.
    """
    if not np.isin(receivers, sources).any():
        return
    fault = f"the distance of {distance:.6g} m leads to the plane of the source itself"
    why = "The receiving plane is that of the balls nearest to it"
    raise InputError(fault, why, f"Take a longer distance: a ball is {course.spacing:.6g} m wide")


def _choose_duration(
    course: Course,
    burst: ToneBurst,
    lengths: tuple[float, float],
    velocity: float,
    margin: float,
) -> float:
    """Return the default duration of a record, s: that of the ``burst``, and
    :data:`_RECORD_LENGTH` times the flight of the fastest long wave to the farthest plane. On a
    closed ``course`` the record ends before that wave comes round the other way.

    ``lengths``, m, are those of the flights to the receiving plane and to the farthest plane, and
    ``velocity``, m/s, is that of the fastest long wave; ``margin`` is that of :meth:`Route.of`.
    Raises what :func:`_require_room` raises.
    """
    flight_length, farthest = lengths
    duration = burst.duration + _RECORD_LENGTH * farthest / velocity
    if not course.is_closed:
        return duration
    _require_room(course.period, flight_length, velocity / margin, burst)
    return min(duration, (course.period - flight_length) / velocity)


def _list_readings(burst: ToneBurst, duration: float) -> Array:
    """Return the times (n_t,), s, at which a pulse is read within a ``duration``, s:
    :data:`READINGS` in a period of the burst, and three at least.

    Raises :class:`~granphon.base.errors.InputError` for too many times.
    """
    step = 1.0 / (READINGS * burst.frequency)
    n_steps = duration / step if step else math.inf  # at huge frequencies the step underflows
    if not n_steps < _MOST_READINGS:
        fault = (
            f"a pulse of {burst.frequency:g} Hz and {burst.cycles:g} cycles is read more than"
            f" {_MOST_READINGS:,} times"
        )
        raise InputError(
            fault, mend="Use a lower frequency, fewer cycles, or a shorter distance or duration"
        )
    n_readings = max(3, math.floor(n_steps) + 1)  # the fit of a maximum needs three
    times: Array = step * np.arange(n_readings, dtype=np.float64)
    return times


def _find_sources(course: Course, source: str | int | Sequence[int]) -> Index:
    """Return the indices (k,) of the balls on a ``course`` that are pushed. The ``source`` is the
    index of a ball or several; "plane", the first plane along the direction; or "ball", the ball of
    lowest index of this plane.

    Raises :class:`~granphon.base.errors.InputError` for a ball that is not there or does not move,
    for a ball that is given twice, and for another word.
    """
    moving = course.network.moving
    if not isinstance(source, str):
        sources = index_array("source", source, course.network.n_balls)
        held_sources = sources[~moving[sources]]
        if held_sources.size:
            raise InputError(
                f"ball {held_sources[0]} of the source does not move",
                "Its mass is infinite, or it fell where the end was cut",
            )
        return sources
    if source not in ("plane", "ball"):
        raise InputError(
            f"source is {brief(source)}", mend="Use plane, ball, or the index of a ball"
        )
    # the first plane is sought at the least place, and not at the place 0, to which the last plane
    # of a closed course may be nearer
    plane = course.find_plane(float(np.min(course.places[moving])), "source")
    return plane if source == "plane" else plane[:1]


def _find_fastest(
    course: Course, push: Array, sources: Index, receivers: Index, has_fallen: bool
) -> Array:
    """Return upper bounds (2,), m/s, of the velocity of long waves along a ``course``: with motions
    along ``push`` (3,), and with motions in the stiffest direction.

    The bounds are the velocities of waves in which all balls move in proportion to a plane wave,
    without the relative motions by which a network gives way, without rotations, and without the
    static forces of pressed contacts. Of the pieces that join the ``sources`` to the ``receivers``,
    the fastest counts.

    Raises :class:`~granphon.base.errors.InputError` if no contact resists ``push``, or if no
    contacts join sources and receivers; in the latter case
    :class:`~granphon.base.errors.InstabilityError` if ``has_fallen`` says that balls were left out
    behind free ends.
    """
    network = course.network
    piece_of_ball = number_pieces(network.i, network.j, network.moving)
    shared_pieces = np.intersect1d(piece_of_ball[receivers], piece_of_ball[sources])
    if not shared_pieces.size:
        if has_fallen:
            raise InstabilityError(_FALL_MESSAGE)
        fault = (
            f"no contacts join the source and the {counted(len(receivers), 'ball')} of the"
            f" receiving plane"
        )
        why = f"The balls fall into {np.max(piece_of_ball) + 1} parts"
        mend = "Use a higher load, or one of network.pieces()"
        raise InputError(fault, why, mend)
    tensors = _find_stiffnesses(course, piece_of_ball, shared_pieces)
    push_of_axes = push[list(network.ball_motions.translations)]
    square_along_push = (push_of_axes @ tensors @ push_of_axes).max()
    greatest_square = np.linalg.eigvalsh(tensors).max()
    fastest = np.sqrt(np.maximum([square_along_push, greatest_square], 0.0))
    if not fastest[0] > 0.0:
        fault = "no contact resists this polarisation in this direction"
        raise InputError(
            fault, "Waves of it cost no energy", "Use friction, or another polarisation"
        )
    return np.asarray(fastest)


def _find_stiffnesses(course: Course, piece_of_ball: Index, pieces: Index) -> Array:
    """Return the stiffness over the mass, (k, n_u, n_u), (m/s)^2, of each of the ``pieces``, for
    waves along the ``course`` in which all balls move in proportion to a plane wave; n_u is the
    number of axes along which balls move.

    ``piece_of_ball`` (n,) is the number of the piece of each ball, and ``pieces`` (k,) are such
    numbers.
    """
    network = course.network
    axes = list(network.ball_motions.translations)
    moving = network.moving
    # of the two balls of a contact, one that moves, if one does
    moving_end = np.where(moving[network.i], network.i, network.j)
    piece_of_contact = piece_of_ball[moving_end]
    n_pieces = int(np.max(piece_of_ball)) + 1
    masses = np.bincount(piece_of_ball[moving], network.masses[moving], n_pieces)
    # in a long wave the motions of the two balls of a contact differ in proportion to its length
    # along the course
    squared_lengths = course.lengths**2
    shear = network.shear_stiffness
    if network.prestress:
        # contacts that pull resist motions across them, as strings do; pressed ones only slow waves
        normal_force, _ = network.static_forces
        shear = shear + np.maximum(-normal_force, 0.0) / network.distance
    normals = network.normal.T
    excess = (network.normal_stiffness - shear) * squared_lengths
    stiffness = np.zeros((len(axes), len(axes), n_pieces))
    for row, a in enumerate(axes):
        for column, b in enumerate(axes):
            contact_stiffness = excess * normals[a] * normals[b]
            if a == b:
                contact_stiffness = contact_stiffness + shear * squared_lengths
            stiffness[row, column] = np.bincount(piece_of_contact, contact_stiffness, n_pieces)
    tensors = np.moveaxis(stiffness, -1, 0)[pieces]
    return np.asarray(tensors / masses[pieces, None, None])


def _require_room(period: float, distance: float, velocity: float, burst: ToneBurst) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the pulse that runs round a ``period``, m,
    the other way comes to receivers at a ``distance``, m, before the pulse is over there.

    ``velocity``, m/s, is that of both pulses, which last as long as the ``burst``.
    """
    least_period = 2.0 * distance + velocity * burst.duration
    if least_period <= period:
        return
    room = period - velocity * burst.duration
    nearer = f"a distance up to {0.5 * room:.3g} m, " if room > 0.0 else ""
    record_end = write_quantity((period - distance) / velocity, "s", 3)
    burst_duration = write_quantity(burst.duration, "s", 3)
    flight = write_quantity(distance / velocity, "s", 3)
    fault = (
        f"the record ends at {record_end}, before the burst of {burst_duration} and the flight"
        f" of {flight} are over"
    )
    why = (
        f"Then the pulse comes that runs the other way round the periodic network, which is"
        f" {period:.4g} m long"
    )
    changes = "fewer cycles, a higher frequency, or ends: free"
    mend = f"Use {nearer}an array of {least_period:.4g} m along the direction, {changes}"
    raise InputError(fault, why, mend)


def require_sendable(network: ContactNetwork, request: PulseSource) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if it is known beforehand that the pulse of a
    ``request`` cannot be sent, or cannot be read.

    ``network`` is an array of equal balls. It stands for an array of differing balls that is not
    yet simulated, whose velocities and frequencies may differ by the factor :data:`MARGIN`: with
    this margin the frequency, the room of a periodic network and the number of products with D are
    judged. Raises also what :meth:`Route.of` raises for the network.
    """
    route = Route.of(network, request, MARGIN)
    burst = route.burst
    operator = make_operator(route.course.network)
    limit = MARGIN * operator.top / (2.0 * math.pi)
    if burst.frequency > limit:
        raise _explain_unreachable(burst.frequency, f"which is below {limit:.4g} Hz")
    losses = route.course.find_losses(Losses.of(network, request.losses))
    _require_short(operator.top / MARGIN, burst, route.last_time, losses)


def transmit(
    network: ContactNetwork,
    request: PulseSource,
    find_operator: Callable[[], WaveOperator] | None = None,
    progress: Progress = silent,
) -> Pulse:
    """Send the pulse of a ``request`` through a ``network`` and return it; see
    :meth:`granphon.waves.waves.Waves.transmit`, which says what is raised.

    ``find_operator`` returns the operator of the network after a check that the network is stable;
    it is called once, and only if the ends leave the network as it is. Else, and if it is None, a
    new operator is made, whose work ``progress`` is told of.
    """
    route = Route.of(network, request)
    course = route.course
    burst = route.burst
    losses = course.find_losses(Losses.of(network, request.losses))
    if find_operator is not None and course.network is network:
        operator = find_operator()
    else:
        operator = _make_stable_operator(course, progress)
    _require_short(operator.top, burst, route.last_time, losses)
    _require_frames_memory(len(route.frames), network.n_balls, operator.size)
    _require_reached(operator, burst.frequency)
    fallen_balls = np.zeros(0, np.intp)
    if request.ends == "free":
        fallen_balls = np.flatnonzero(network.moving & ~course.network.moving)
    pulse = _make_pulse(route, losses, _propagate(route, operator, losses), fallen_balls.size)
    remarks = _warn_of_fallen(course, fallen_balls, route.groups[0])
    return replace(pulse, warnings=(*remarks, *pulse.judge()))


def _make_pulse(route: Route, losses: Losses, motions: _HeardMotions, n_left_out: int) -> Pulse:
    """Return the pulse of a ``route``, without warnings, that made these ``motions`` in a network
    with ``losses``, from which ``n_left_out`` balls had been left out.
    """
    course = route.course
    burst = route.burst
    receivers = route.groups[0]
    distances = [course.find_distance(route.start, balls) for balls in route.groups]
    return Pulse(
        frequency=burst.frequency,
        cycles=burst.cycles,
        direction=course.direction,
        polarisation=route.push,
        damping=_find_mean(losses.times[0]),
        tangential_damping=_find_mean(losses.times[1]),
        drag=losses.drag,
        distance=distances[0],
        times=route.times,
        sent=burst(route.times),
        sources=route.sources,
        receivers=receivers,
        samples=np.zeros(len(receivers), int),
        signals=motions.signals[0],
        energies=motions.energies,
        plane_distances=np.array(distances[1:]),
        planes=np.array([np.mean(plane, axis=0) for plane in motions.signals[1:]]),
        frames=route.frames,
        velocities=motions.velocities,
        echo=course.find_echo(route.start, receivers),
        fastest=route.fastest,
        left_out=n_left_out,
    )


def _make_stable_operator(course: Course, progress: Progress) -> WaveOperator:
    """Return the operator of the network of a ``course``, whose work ``progress`` is told of, after
    a check that the network is stable, unless this is known.

    Raises :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero.
    """
    operator = make_operator(course.network, progress)
    if not course.is_known_stable:
        require_stable(operator)
    return operator


def count_products(operator: WaveOperator, request: PulseSource) -> float:
    """Return the number of products of D with a vector that the pulse of a ``request`` takes;
    ``operator`` is that of the network before its ends are cut.

    Raises :class:`~granphon.base.errors.InputError` for a pulse that cannot be sent, and
    :class:`~granphon.base.errors.InstabilityError` for an array that does not hold between free
    ends. A frequency is refused only if it is above the bound of all modes, as the highest mode is
    not found.
    """
    route = Route.of(operator.network, request)
    limit = operator.top / (2.0 * math.pi)
    if route.burst.frequency > limit:
        raise _explain_unreachable(route.burst.frequency, f"which is below {limit:.4g} Hz")
    _require_frames_memory(len(route.frames), operator.network.n_balls, operator.size)
    losses = route.course.find_losses(Losses.of(operator.network, request.losses))
    _require_short(operator.top, route.burst, route.last_time, losses)
    even_losses = losses.find_even()
    if even_losses is None:
        spans = Spans.of(operator.top, route.burst, losses)
        return _UNEVEN_PRODUCTS * spans.count_products(route.last_time)
    _, time, drag = even_losses
    no_push = np.zeros(0)  # the order of the expansion does not depend on the push
    return float(Propagation(operator, no_push, route.burst, route.last_time, time, drag).order)


def _find_mean(values: Array) -> float:
    """Return the mean of ``values`` (n_c,); if all are equal, the value itself, without the
    rounding of a mean.
    """
    return float(values[0] if np.ptp(values) == 0.0 else np.mean(values))


def find_frames_memory(n_frames: int, n_balls: int, size: int) -> float:
    """Return the memory, bytes, of ``n_frames`` frames of ``n_balls`` balls: each has the
    velocities of all balls, and displacements and velocities as vectors (size,).
    """
    return 8.0 * n_frames * (3.0 * n_balls + 2.0 * size)  # 8 bytes for each number


def _require_frames_memory(n_frames: int, n_balls: int, size: int) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if ``n_frames`` frames of ``n_balls`` balls
    do not fit into memory; ``size`` is that of :func:`find_frames_memory`.
    """
    memory = find_frames_memory(n_frames, n_balls, size)
    require_memory(f"{n_frames:,} frames of {n_balls:,} balls", memory, "Give fewer frames")


class _HeardMotions(NamedTuple):
    """The motions that a pulse makes.

    Attributes
    ----------
    signals : for each group of receivers the velocities (k, n_t) of its k balls along the push,
        m/s.
    energies : (2,) kinetic plus elastic energy at the end of the burst, and at the end of the
        record, J.
    velocities : (n_f, n, 3) velocities of all balls at the frames, m/s.
    """

    signals: list[Array]
    energies: Array
    velocities: Array


def _propagate(route: Route, operator: WaveOperator, losses: Losses) -> _HeardMotions:
    """Return the motions that the pulse of a ``route`` makes in the network of the ``operator``
    with these ``losses``; progress of the operator is told of the work.
    """
    network = operator.network
    push = route.push[list(operator.motions.translations)]
    inverse_root = 1.0 / np.sqrt(network.masses)  # from mass-weighted motions to motions
    forces = operator.push(route.sources, route.push, inverse_root[route.sources])
    receivers = np.concatenate(route.groups)
    indices = operator.indices[receivers, : push.size]
    propagation = _make_propagation(route, operator, losses, forces)

    def listen(vector: Array) -> Array:
        """Return the velocities (n_r,) of receivers along the push, m/s, from a ``vector`` (size,)
        of mass-weighted velocities.
        """
        return inverse_root[receivers] * (vector[indices] @ push)

    # the first two states are for the energies, at the ends of the burst and of the record
    energy_times = [route.burst.duration, route.end_time]
    state_times = np.concatenate([energy_times, route.frames])
    signals, state_x, state_v = propagation.follow(listen, route.times, state_times)
    energies = [
        0.5 * (v @ v) + operator.store(x) for x, v in zip(state_x[:2], state_v[:2], strict=True)
    ]
    velocities = _find_ball_velocities(operator, state_v[2:])
    group_ends = np.cumsum([len(balls) for balls in route.groups[:-1]])
    return _HeardMotions(np.split(signals, group_ends), np.array(energies), velocities)


def _make_propagation(
    route: Route, operator: WaveOperator, losses: Losses, forces: Array
) -> Propagation | ViscousPropagation:
    """Return the propagation of the pulse of a ``route`` in the network of the ``operator``, on
    which the mass-weighted ``forces`` (size,) act as the burst does: one expansion for the whole
    time if ``losses`` are even, and else steps.
    """
    even_losses = losses.find_even()
    if even_losses is None:
        return ViscousPropagation(operator, forces, route.burst, losses)
    _, time, drag = even_losses
    return Propagation(operator, forces, route.burst, route.last_time, time, drag)


def _find_ball_velocities(operator: WaveOperator, vectors: Array) -> Array:
    """Return the velocities (n_f, n, 3) of all balls, m/s, from ``vectors`` (n_f, size) of
    mass-weighted velocities.
    """
    network = operator.network
    balls = operator.balls
    axes = list(operator.motions.translations)
    inverse_root = 1.0 / np.sqrt(network.masses[balls])
    velocities = np.zeros((len(vectors), network.n_balls, 3))
    for frame, vector in zip(velocities, vectors, strict=True):
        translations = operator.values(vector)[:, : len(axes)]
        frame[balls[:, None], axes] = inverse_root[:, None] * translations
    return velocities


def _warn_of_fallen(course: Course, fallen_balls: Index, receivers: Index) -> list[str]:
    """Return a list of one warning if one of the ``fallen_balls`` behind cut ends lies as far
    inside as the outermost of the ``receivers``, else an empty list; both are indices of balls.
    """
    if not fallen_balls.size:
        return []
    depths = np.minimum(course.places, course.period - course.places)  # from the nearer end, m
    if np.max(depths[fallen_balls]) < np.min(depths[receivers]):
        return []
    return [
        f"static forces push {counted(fallen_balls.size, 'ball')} over behind the ends that are"
        f" cut, as far inside as the receiving plane, so that the array is no longer what it was:"
        f" use ends: walls, friction, or a higher load"
    ]


def _require_reached(operator: WaveOperator, hertz: float) -> None:
    """Raise :class:`~granphon.base.errors.UnreachableFrequencyError` if the frequency ``hertz``,
    Hz, is above those of all modes.

    The highest mode is only computed if a bound does not decide. Raises
    :class:`~granphon.base.errors.ConvergenceError` if this mode is not found.
    """
    from scipy.sparse.linalg import eigsh

    square = (2.0 * np.pi * hertz) ** 2
    if square <= _SURE_SHARE * operator.top**2 and not operator.network.prestress:
        return
    if operator.size > 2:
        start = np.random.default_rng(0).normal(size=operator.size)
        with lanczos_converges():
            squares = eigsh(
                operator, k=1, which="LA", v0=start, tol=_TOP_ERROR, return_eigenvectors=False
            )
    else:  # too small for Lanczos
        squares = np.linalg.eigvalsh(operator @ np.eye(operator.size))
    top_square = np.max(squares)
    if square > top_square * (1.0 + _TOP_ERROR):
        raise _explain_unreachable(hertz, f"{math.sqrt(top_square) / (2.0 * math.pi):.6g} Hz")


def _read_list(name: str, value: ArrayLike, unit: str, low: Low) -> Array:
    """Return the ``value`` of the argument ``name``, a number or a list of numbers in the ``unit``,
    as an array (n,), which may be empty.

    Raises :class:`~granphon.base.errors.InputError` for an array of more axes, and for numbers that
    are not finite, or that the lower bound ``low`` does not allow.
    """
    if not real_array(name, value).size:
        return np.zeros(0)
    numbers = np.atleast_1d(finite_array(name, value, unit, low))
    if numbers.ndim > 1:
        raise InputError(f"{name} has the shape {numbers.shape}", mend="Give a list of numbers")
    return numbers


def read_vector(name: str, value: Any, dimension: int) -> Array:
    """Return the unit vector (3,) along the ``value`` of the argument ``name``, which is a number
    or a vector of 1 to 3 numbers; components that are not given are zero.

    Raises :class:`~granphon.base.errors.InputError` for what is not finite numbers, for another
    shape, and for zeros. ``dimension`` is the number of components for which the message about
    shape and zeros asks; up to three are taken whatever it is.
    """
    components = np.atleast_1d(finite_array(name, value))
    is_vector = components.ndim == 1 and components.size <= 3
    if not is_vector or not np.any(components):
        raise InputError(
            f"{name} is {brief(value)}", f"It is a vector of {dimension} numbers, not all zero"
        )
    # over the largest component first: squares of the numbers as they are may overflow
    vector = np.pad(components, (0, 3 - components.size)) / np.max(np.abs(components))
    return np.asarray(vector / np.linalg.norm(vector))


def require_moves(
    name: str, direction: Array, network: ContactNetwork, is_rotation: bool = False
) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless the balls of a ``network`` can move in
    a ``direction`` (3,), or each ball in its own direction (n, 3); with ``is_rotation``, unless
    balls can turn about the direction. ``name`` is that of the argument. The direction zero passes.
    """
    motions = network.ball_motions
    vectors = np.atleast_2d(direction)
    axes = motions.rotations if is_rotation else motions.translations
    forbidden = np.abs(np.delete(vectors, list(axes), axis=1))  # components off these axes
    largest_forbidden = forbidden.max(axis=1, initial=0.0)
    rounding = _ZERO_LENGTH * np.abs(vectors).max(initial=0.0)
    if largest_forbidden.max(initial=0.0) <= rounding:
        return
    ball = int(np.argmax(largest_forbidden))
    verb, preposition = ("turn", "about") if is_rotation else ("move", "along")
    vector = _write_direction(vectors[ball])
    is_of_all_balls = direction.ndim == 1
    if is_of_all_balls:
        fault = f"the {name} is {preposition} {vector}"
    else:
        fault = f"{name} of ball {ball} are {vector}"
    allowed = f"do not {verb}"
    if axes:
        axis_names = " and ".join("xyz"[axis] for axis in axes)
        allowed = f"{verb} {preposition} {axis_names} only"
    raise InputError(fault, f"Balls {allowed}")


def read_push(network: ContactNetwork, direction: Array, polarisation: Any) -> Array:
    """Return the unit vector (3,) along which a source with a ``polarisation``, a word or a vector,
    pushes; its waves travel along the ``direction`` (3,), a unit vector.

    Raises :class:`~granphon.base.errors.InputError` for another word, for what is no vector, if
    balls do not move along the push, and what :func:`_find_transverse` raises.
    """
    if not isinstance(polarisation, str):
        push = read_vector("polarisation", polarisation, network.dimension)
    elif polarisation == "longitudinal":
        push = direction
    elif polarisation == "out_of_plane":
        push = np.array([0.0, 0.0, 1.0])
    elif polarisation == "transverse":
        push = _find_transverse(network, direction)
    else:
        options = "longitudinal, transverse, out_of_plane, or a vector"
        raise InputError(f"polarisation is {brief(polarisation)}", mend=f"Use {options}")
    require_moves("push", push, network)
    return push


def _find_transverse(network: ContactNetwork, direction: Array) -> Array:
    """Return a unit vector (3,) perpendicular to the ``direction`` (3,), a unit vector: in a plane
    one in the plane, in space the part across the direction of the axis farthest from it.

    Raises :class:`~granphon.base.errors.InputError` if balls move along fewer than two of the axes
    in question: x and y on a line and in a plane, all three in space.
    """
    axes = network.ball_motions.translations
    candidates = [axis for axis in range(max(network.dimension, 2)) if axis in axes]
    if len(candidates) < 2:
        fault = f"the motions {network.motions!r} have no transverse waves in this direction"
        raise InputError(fault, mend="Name another polarisation, or give a vector")
    # rounded, so that of axes that are equally far the first is taken
    cosines = np.round(np.abs(direction[candidates]), 9)
    axis = candidates[int(np.argmin(cosines))]
    push = np.eye(3)[axis] - direction[axis] * direction
    return np.asarray(push / np.linalg.norm(push))


def _explain_unreachable(hertz: float, limit: str) -> UnreachableFrequencyError:
    """Return the error of a frequency ``hertz``, Hz, above all modes of the network; ``limit`` is
    the top of the modes in words.
    """
    fault = f"the frequency {hertz:.6g} Hz is above the top of the network's modes, {limit}"
    return UnreachableFrequencyError(
        fault, "Nothing of the pulse would travel", "Lower the frequency"
    )


def _require_short(top: float, burst: ToneBurst, duration: float, losses: Losses) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the propagation of a ``burst`` over a
    ``duration``, s, takes more than :data:`_MOST_PRODUCTS` products with D, or if ``losses`` are so
    strong that nothing moves.

    The duration is :attr:`Route.last_time`; ``top``, rad/s, is the bound of the angular frequencies
    of the network.
    """
    highest = write_quantity(top / (2.0 * math.pi), "Hz", 3)
    damping = float(np.max(losses.times))
    if top * damping > _LARGEST_DAMPING:
        tau = write_quantity(damping, "s", 3)
        longest_damping = write_quantity(_LARGEST_DAMPING / top, "s", 3)
        raise InputError(
            f"with a damping of {tau} nothing moves at frequencies up to {highest}",
            mend=f"Give {longest_damping} at most",
        )
    if losses.find_even() is None:
        _require_few_spans(Spans.of(top, burst, losses), duration, f"up to {highest}")
        return
    products = 0.5 * top * duration
    if products > _MOST_PRODUCTS:
        record = write_quantity(duration, "s", 3)
        longest = write_quantity(2.0 * _MOST_PRODUCTS / top, "s", 3)
        raise InputError(
            f"a record of {record} takes {products:.3g} products with the matrix of the network",
            f"Its frequencies go up to {highest}, and {_MOST_PRODUCTS:,} products reach {longest}",
            "Use a higher frequency, fewer cycles, a shorter distance or duration, or earlier"
            " frames",
        )


def _require_few_spans(spans: Spans, duration: float, frequencies: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the propagation over a ``duration``, s, in
    ``spans`` takes more than :data:`_MOST_PRODUCTS` products with D; ``frequencies`` are those of
    the network, in words.
    """
    products = spans.count_products(duration)
    if products <= _MOST_PRODUCTS:
        return
    record = write_quantity(duration, "s", 3)
    raise InputError(
        f"a record of {record} takes {products:.3g} products with the matrix of the network,"
        f" and {_MOST_PRODUCTS:,} at most are made",
        f"Losses that differ are propagated in steps of the fastest motion, and here frequencies"
        f" go {frequencies} and motions decay by up to {2.0 * spans.half_damping:.3g} 1/s",
        "Give less damping or drag, the same for all contacts and motions, a shorter distance or"
        " duration, or earlier frames",
    )
