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
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.arrays import Array, Index
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
from granphon.dynamics.damping import Losses
from granphon.dynamics.linalg import lanczos_converges
from granphon.networks.network import ContactNetwork, number_pieces
from granphon.waves.modes import find_allowed_fall, find_falling_motions, is_stable, require_stable
from granphon.waves.operator import WaveOperator, make_operator
from granphon.waves.propagation import Propagation, ToneBurst, ViscousPropagation
from granphon.waves.settings import ENDS, READINGS, PulseSettings

#: relative length below which the part of a period along a direction is zero but for rounding
_FLAT = 1e-9
#: greatest distance of the balls of one plane from it, in mean diameters, in a lattice
_THICK = 0.25
#: the same in a network of no lattice
_THICKER = 0.45
#: greatest number of directions that are compared for a message
_MANY = 40_000
#: ways to read a time of flight
METHODS = ("envelope", "first", "correlation")
#: an earlier maximum of the envelope counts if it has this part of the greatest
_HALF = 0.5
#: the maximum is that of a parabola through the envelope where it has this part of the greatest
_NEAR = 0.9
#: part of a reading within which a signal has not travelled
_AT_ONCE = 0.05
#: why a signal has no time of flight
_SHORT = (
    "the record ends before the pulse is over: use a longer duration; in a periodic network a"
    " longer array, a shorter "
    "distance, fewer cycles, a higher frequency, or ends: free"
)
_EARLY = (
    "the signal comes not after the burst: what is heard has not travelled, as no waves of"
    " this frequency and polarisation "
    "do, the plane is too near, or the array is far shorter than the pulse"
)
#: part of the envelope at which a signal begins
_BEGINS = 0.1
#: damping ratio of a wave of the pulse's frequency from which the signal tells no velocity of sound
_MOST_DAMPING = 0.3
#: relative excess of a velocity over that of the fastest wave that may come from the reading of the
#: record
_FASTER = 0.02
#: spectrum at the burst's frequency over its maximum, received over sent, below which other
#: frequencies are received
_LEAST_SHARE = 0.5
#: relative error of a velocity above which the error is a warning
_UNSURE = 0.03
#: relative error of a velocity from which the velocity is not known
_UNKNOWN = 0.5
#: reach of the gate around the height of a pulse, in durations of the burst: all of a pulse that
#: keeps its shape, and a margin
_REACH = 0.75
_DAMPED = (
    "waves of the frequency of the pulse hardly swing, so much are they damped: what arrives has"
    " no velocity of sound"
)
#: message of an array that has no stable part once it is cut
_NOTHING_HELD = message(
    "the array does not hold with free ends: static forces push over one ball after the"
    " other, as far as the receivers",
    "They need the contacts that the ends cut, as such an array has hardly more than it needs",
    "Use ends: walls, balls with friction, or a higher load",
)
#: duration of the record without the burst, over the flight of a long wave in which balls move in
#: proportion
_LATE = 3.0
#: share of the squared bound of frequencies below which a frequency is surely reached: a ball that
#: moves alone has a half
_SURE = 0.45
#: most products with D that a record may take
_MOST = 2**20
#: products with D and with dashpots where motions are damped unevenly, for each radian of the top
#: frequency
_UNEVEN_PRODUCTS = 2.0
#: largest viscosity of a contact over its stiffness, times the highest frequency
_MOST_DAMPED = 1e12
#: largest number of times at which a pulse is read
_MOST_READINGS = 2**24
#: least weight of a reading in the fit of a maximum: above zero, so that a fit has three readings
_LEAST_WEIGHT = 1e-9
#: greatest relative difference of distances, and of dampings, of pulses that are averaged
_SAME = 0.1
#: relative difference of forces that are the same but for rounding
_ROUNDING = 1e-12
#: relative error of the highest squared frequency
_TOP_ERROR = 1e-6
#: reduction of the default distance, in diameters: balls of different samples of one array are not
#: at the same places, and of two planes that are equally near the same one is to be taken
_NEARER = 0.07
#: the mean contact force being the same, velocities and frequencies of an array of differing balls
#: are those of the array of equal ones times a number between this and its inverse, generously
MARGIN = 1.5


@dataclass(frozen=True)
class Course:
    """The balls of a network in the order in which a plane wave along ``direction`` meets them.

    Attributes
    ----------
    network : the network.
    direction : (3,) unit vector.
    period : distance after which planes across the direction meet themselves, m; infinity if they
        never do.
    origin : coordinate along the direction at which places begin, m.
    face : place from which distances are counted where the network has been given ends, m; else
        nan.
    at_rest : whether it is known that static forces push no ball over.
    """

    network: ContactNetwork
    direction: Array
    period: float
    origin: float = 0.0
    face: float = math.nan
    at_rest: bool = False

    @classmethod
    def along(cls, network: ContactNetwork, direction: Array) -> Self:
        """Return the course along ``direction`` (3,), a unit vector, through the network from its
        first plane on.

        Raises :class:`~granphon.base.errors.InputError` for a direction that leaves the line or the
        plane of the balls.
        """
        if np.any(np.abs(direction[network.dimension :]) > _FLAT):
            mend = f"Give {network.dimension} numbers"
            raise InputError(
                "the direction leaves the line or the plane in which the balls lie", mend=mend
            )
        # places begin halfway between two planes of balls, where a cut meets no ball
        course = cls(network, direction, _find_period(network, direction))
        if math.isinf(course.period):
            lowest = float(np.min(course.heights[network.moving]))
            return replace(course, origin=lowest - 0.5 * course.spacing)
        return replace(course, origin=course._find_gap())

    def _find_gap(self) -> float:
        """Return the middle of the gap between two planes of balls that repeat, m.

        A plane is less than a diameter thick; the widest gap among the balls within a diameter is
        that between two planes.
        """
        heights = np.sort(self._wrap(self.heights))
        n_near = int(np.searchsorted(heights, self.spacing)) + 1
        near_heights = heights[: max(2, n_near)]
        # the gap before the first ball is that from the last ball, a period earlier
        gaps = np.diff(near_heights, prepend=heights[-1] - self.period)
        # of gaps that are equally wide but for the differences of balls the first
        is_wide = gaps > (1.0 - _THICK) * np.max(gaps)
        first_wide = int(np.argmax(is_wide))
        return float(near_heights[first_wide] - 0.5 * gaps[first_wide])

    @cached_property
    def spacing(self) -> float:
        """Mean diameter of the balls that move, m."""
        return 2.0 * float(np.mean(self.network.radii[self.network.moving]))

    @cached_property
    def heights(self) -> Array:
        """(n,) coordinates along the direction, m."""
        return np.asarray(self.network.positions @ self.direction)

    @cached_property
    def places(self) -> Array:
        """(n,) distance of balls behind the beginning, m, below :attr:`period`."""
        return self._wrap(self.heights - self.origin)

    def _wrap(self, lengths: Array) -> Array:
        """Return lengths less whole periods."""
        return lengths if math.isinf(self.period) else np.mod(lengths, self.period)

    def require_period(self, shortest: float, why: str) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if planes across the direction meet
        themselves before ``shortest``, m; ``why`` says why that length is needed.
        """
        if self.period >= shortest * (1.0 - _FLAT):
            return
        direction = _write_direction(self.direction[: self.network.dimension])
        closes = "do not close"
        if self.period > self.spacing:
            closes = f"come back to themselves after {self.period:.6g} m"
        cell, longer_array = self._describe_cell()
        offers = [
            f"{_write_direction(vector)}, with {period:.6g} m"
            for vector, period in self._find_directions(shortest)
        ]
        fault = f"planes across {direction} {closes} in this periodic network"
        remedy = f"or {longer_array}"
        if offers:
            remedy = f"{longer_array}, or the direction {' or '.join(offers)}"
        reason = f"{why}: {shortest:.6g} m are needed{cell}"
        raise InputError(fault, reason, f"Take a shorter distance, {remedy}")

    def _describe_cell(self) -> tuple[str, str]:
        """Return two parts of a message: a sentence with the lengths of the cell along the
        direction, if there are several, and the array that would have a longer period.
        """
        heights = np.abs(self.network.cell[list(self.network.pbc)] @ self.direction)
        rounding = _FLAT * float(np.max(heights))
        sides = [f"{height:.6g}" for height in heights if height > rounding]
        if len(sides) < 2:
            return "", "a longer array"
        cell = (
            f". The cell is {' and '.join(sides)} m long along it, and the greatest common"
            f" measure counts"
        )
        # lengths of the cell that are equal along the direction are the period
        return cell, "an array whose numbers of cells make these lengths equal"

    def _find_directions(self, shortest: float) -> list[tuple[Array, float]]:
        """Return the two directions (d,) nearest to this one whose planes have a period of
        ``shortest``, m, or more; with the periods, m.

        The candidates are the normals of planes whose Miller indices in the periodic cell have no
        common divisor; the period of a plane is one over the length of its reciprocal vector.
        """
        periods = self.network.cell[list(self.network.pbc)]
        reciprocal = np.linalg.pinv(periods).T  # rows b with b_i . a_j = delta_ij
        # higher indices have shorter periods; all indices are (2 n + 1)^p, at most _MANY
        highest = np.floor(np.linalg.norm(periods, axis=1) / shortest).astype(int)
        affordable = int(0.5 * (_MANY ** (1.0 / len(periods)) - 1.0))
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
    def crossings(self) -> NDArray[np.intp]:
        """(n_c,) how often each contact, from ball i to ball j, passes the beginning: 1 for a
        contact that leads from the end of the course to its beginning, -1 for the other way.
        """
        if math.isinf(self.period):
            return np.zeros(self.network.n_contacts, int)
        network = self.network
        place_step = self.places[network.j] - self.places[network.i]
        # the vector leads between the centres, and not along the line of the contact
        true_step = network.vector @ self.direction
        return np.rint((true_step - place_step) / self.period).astype(int)

    def with_ends(self, ends: str) -> Course:
        """Return the course through the network with ``ends``, see
        :data:`~granphon.waves.settings.ENDS`.

        Raises :class:`~granphon.base.errors.InputError` for walls in a network without a period
        along the direction.
        """
        if ends == "periodic":
            return self
        has_period = math.isfinite(self.period)
        if ends == "free":
            return self._cut_free() if has_period else self  # without a period it has free ends
        if not has_period:
            fault = "there is no place for walls: the network has no period along this direction"
            mend = "Leave ends out: the network then has the ends that it has"
            raise InputError(fault, "Walls are made where a period is cut", mend)
        return self._hold_walls()

    def _cut_free(self) -> Course:
        """Return the course through the network without contacts across the beginning, and without
        balls that static forces then push over.
        """
        network = self.network
        is_kept = self.crossings == 0
        kept_fields = {name: getattr(network, name)[is_kept] for name in network.contact_fields}
        stable_network = drop_falling(replace(network, **kept_fields), network)
        return replace(self, network=stable_network, face=0.0, at_rest=True)

    def _hold_walls(self) -> Course:
        """Return the course through the network whose balls before the beginning are held."""
        network = self.network
        crosses = self.crossings != 0
        is_forward = self.crossings[crosses] > 0
        held = np.unique(np.where(is_forward, network.i[crosses], network.j[crosses]))
        masses = np.array(network.masses)
        masses[held] = math.inf
        if not np.any(np.isfinite(masses)):
            raise InputError(
                "no ball moves between the walls",
                "They hold all",
                "Take a longer array, or other ends",
            )
        # the wall in front of the first balls is the one behind the last, a period earlier
        face = float(np.max(self.places[held])) - self.period
        return replace(self, network=replace(network, masses=masses), face=face)

    def find_plane(self, place: float, role: str) -> Index:
        """Return the balls (n,) that move within a quarter of a diameter of the ball nearest to
        ``place``, m, along the direction; ``role`` says in the message what the plane is for.

        In a network of no lattice, which has no planes, the balls are those within nine twentieths
        of a diameter.

        Raises :class:`~granphon.base.errors.InputError` if no ball is within a diameter of
        ``place``.
        """
        moving = np.flatnonzero(self.network.moving)
        offsets = self._find_offset(self.places[moving] - place)
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
        half_thickness = (_THICKER if self.network.lattice is None else _THICK) * self.spacing
        from_nearest = np.abs(self._find_offset(offsets - offsets[nearest]))
        return moving[from_nearest <= half_thickness]

    @property
    def _is_closed(self) -> bool:
        """Whether the last balls are neighbours of the first."""
        return math.isfinite(self.period) and math.isnan(self.face)

    def _find_offset(self, lengths: Array) -> Array:
        """Return ``lengths`` (n,), m, less the whole periods that leave the shortest ones; on a
        course with ends the lengths themselves.
        """
        if not self._is_closed:
            return lengths
        return lengths - self.period * np.rint(lengths / self.period)

    def find_place(self, balls: Index) -> float:
        """Return the mean place of ``balls``, which lie near each other along the direction."""
        places = self.places[balls]
        return float(places[0] + np.mean(self._find_offset(places - places[0])))

    def find_distance(self, start: float, balls: Index) -> float:
        """Return the mean distance of ``balls`` ahead of the place ``start``, m."""
        ahead = self.find_place(balls) - start
        return float(np.mod(ahead, self.period)) if self._is_closed else ahead

    def find_echo(self, start: float, balls: Index) -> float:
        """Return how much longer the path of the first echo from an end is than the path from
        ``start`` to ``balls``, m.

        Balls within a diameter of an end send or hear the pulse and its reflection there as one.
        Without ends the echo is the pulse that runs the other way round.
        """
        if self._is_closed:
            return self.period - 2.0 * self.find_distance(start, balls)
        if math.isfinite(self.period):
            first = 0.0
            last = self.period
        else:
            moving_places = self.places[self.network.moving]
            first = float(np.min(moving_places))
            last = float(np.max(moving_places))
        detour_by_first = 2.0 * (start - first)
        detour_by_last = 2.0 * (last - self.find_place(balls))
        # a shorter detour is not heard by itself
        shortest = 2.0 * self.spacing
        detours = [detour for detour in (detour_by_first, detour_by_last) if detour > shortest]
        return min(detours, default=2.0 * (last - first))


def _write_direction(direction: Array) -> str:
    """Return a vector (d,) in words."""
    return f"({', '.join(f'{x:.6g}' for x in direction)})"


def _find_period(network: ContactNetwork, direction: Array) -> float:
    """Return the distance after which planes across ``direction`` (3,) meet themselves, m: the
    greatest length that measures the heights of all periods; infinity if there is none.
    """
    periods = network.cell[list(network.pbc)]
    heights = np.abs(periods @ direction)  # lengths along the direction
    lengths = np.linalg.norm(periods, axis=1)
    rounding = _FLAT * float(np.max(lengths, initial=0.0))
    periodic_heights = heights[heights > _FLAT * lengths].tolist()
    if not periodic_heights:
        return math.inf
    period: float = periodic_heights[0]
    for height in periodic_heights[1:]:
        period = _find_common_measure(period, height, rounding)
    return period


def _find_common_measure(longer: float, shorter: float, rounding: float) -> float:
    """Return the greatest length that measures two lengths, m, by Euclid's algorithm; lengths up to
    ``rounding`` are zero.
    """
    while shorter > rounding:
        remainder = abs(longer - shorter * round(longer / shorter))
        longer = shorter
        shorter = remainder
    return longer


def drop_falling(cut: ContactNetwork, whole: ContactNetwork) -> ContactNetwork:
    """Return a network ``cut`` from a ``whole`` one without the balls that its static forces push
    over.

    The balls of a cut feel the forces of the contacts that they have lost as dead loads, which keep
    the balance and do not change with small motions. A ball that hangs on one contact rolls off
    that contact under such a load, and then carries nothing: in the returned network the ball does
    not move and has no contacts. A ball hangs if fewer pressed contacts hold it than there are
    dimensions, or do so once other such balls are gone. If static forces still push over several
    balls that hang together, the ball that moves most in each of these motions is left out, until
    the network is stable.

    Raises :class:`~granphon.base.errors.InstabilityError` if the whole network is not stable, if
    nothing of the cut network is held, or if the network is too large for its motions to be found.
    """
    if not cut.prestress:
        return cut
    uncut_operator = make_operator(whole)
    fall = find_allowed_fall(
        uncut_operator
    )  # the loads of the contacts that are cut are no imbalance
    if is_stable(make_operator(cut), fall):
        return cut
    require_stable(uncut_operator)
    hanging_by_cut = np.setdiff1d(_find_hanging(cut), _find_hanging(whole))
    remaining = _detach(cut, hanging_by_cut)
    while remaining.n_contacts:
        operator = make_operator(remaining)
        if is_stable(operator, fall):
            return remaining
        falls = operator.values(find_falling_motions(operator, fall))  # (n_free, motions, falls)
        sizes = np.linalg.norm(falls, axis=1)
        most_moved = np.unique(np.argmax(sizes, axis=0))
        remaining = _detach(remaining, operator.balls[most_moved])
    raise InstabilityError(_NOTHING_HELD)


def _find_hanging(network: ContactNetwork) -> Index:
    """Return the balls (m,) that fewer contacts hold than there are dimensions, or do once such
    balls are gone; held bodies do not hang.
    """
    i = network.i
    j = network.j
    n_balls = network.n_balls
    # a contact that pulls counts as many: it holds a ball alone, as a rope does
    weights = np.where(network.normal_force < 0.0, network.dimension, 1)
    is_hanging = np.zeros(n_balls, bool)
    count_before = -1
    while np.count_nonzero(is_hanging) > count_before:
        count_before = int(np.count_nonzero(is_hanging))
        weights_left = np.where(is_hanging[i] | is_hanging[j], 0, weights)
        n_holding = np.bincount(i, weights_left, n_balls)
        n_holding = n_holding + np.bincount(j, weights_left, n_balls)
        is_hanging = network.moving & (n_holding < network.dimension)
    return np.flatnonzero(is_hanging)


def _detach(network: ContactNetwork, balls: Index) -> ContactNetwork:
    """Return the network in which ``balls`` do not move and have no contacts; all balls keep their
    numbers.
    """
    masses = np.array(network.masses)
    masses[balls] = math.inf
    is_detached = np.isin(network.i, balls) | np.isin(network.j, balls)
    kept_fields = {name: getattr(network, name)[~is_detached] for name in network.contact_fields}
    return replace(network, masses=masses, **kept_fields)


def find_envelope(signals: Array) -> Array:
    """Return the envelopes (..., n_t) of ``signals``: the magnitudes of their analytic signals."""
    from scipy.fft import next_fast_len
    from scipy.signal import hilbert

    count = signals.shape[-1]
    # zeros behind the record: its end is not joined to its beginning
    analytic = hilbert(signals, next_fast_len(2 * count), axis=-1)
    return np.asarray(np.abs(analytic)[..., :count])


def _explain_unknown_time(signal: Array, shift: float, is_held: bool) -> str:
    """Return why a ``signal`` (n_t,) has no time of flight; empty if it has one.

    ``shift`` is the time of flight in steps of the record; it is nan where the burst or the signal
    has no maximum. ``is_held`` says whether the record holds the whole signal, False for nan.
    """
    if not np.any(signal):
        return "the signal is zero"
    if not is_held:
        return _SHORT
    return _EARLY if shift <= _AT_ONCE else ""


def find_arrivals(
    times: Array, signals: Array, sent: Array, duration: float, method: str, threshold: float
) -> tuple[Array, list[str]]:
    """Return the times (n,), s, by which ``signals`` (n, n_t) come after ``sent`` (n_t,), and why
    times are not known; ``times`` (n_t,), s, are even.

    Parameters
    ----------
    duration : of what was sent, s: a record is to hold it, and the time of flight before it.
    method : "envelope": between the maxima of the envelopes, of which the first counts that has
        half the height of the greatest; "first": between the times at which the envelopes first
        reach ``threshold`` of that maximum; "correlation": where the cross-correlation of both
        signals is greatest.

    Returns
    -------
    times : nan of a signal that is zero, does not come after the burst, or is not over when the
        record ends.
    reasons : for each signal why its time is nan; empty if it is not.

    Raises :class:`~granphon.base.errors.InputError` for an unknown method.
    """
    method = one_of("method", method, METHODS)
    step = float(times[1] - times[0])
    if method == "correlation":
        shifts = np.array([_correlate(signal, sent) for signal in signals])
    else:
        envelopes = find_envelope(np.vstack([sent, signals]))
        places = np.array([_find_place(envelope, method, threshold) for envelope in envelopes])
        shifts = places[1:] - places[0]
    are_held = step * shifts + duration <= times[-1] + step
    reasons = [
        _explain_unknown_time(signal, shift, is_held)
        for signal, shift, is_held in zip(signals, shifts, are_held, strict=True)
    ]
    is_unknown = [bool(reason) for reason in reasons]
    return np.where(is_unknown, np.nan, step * shifts), reasons


def _correlate(signal: Array, sent: Array) -> float:
    """Return the shift, in readings, at which the cross-correlation of a ``signal`` (n_t,) and the
    ``sent`` one (n_t,) is greatest; nan if that is the first or the last shift.
    """
    from scipy.signal import correlate

    correlation = correlate(signal, sent)[sent.size - 1 :]  # shifts from zero on
    greatest = int(np.argmax(correlation))
    if not 0 < greatest < correlation.size - 1:
        return math.nan
    # the extreme of the parabola through the values around the greatest
    low, middle, high = correlation[greatest - 1 : greatest + 2]
    curvature = low - 2.0 * middle + high
    return greatest + 0.5 * float((low - high) / curvature)


def _find_place(envelope: Array, method: str, threshold: float) -> float:
    """Return the place of a pulse in its envelope (n_t,), in readings: the first maximum that has
    half the height of the greatest value, or for the ``method`` "first" the place where the
    envelope first has the share ``threshold`` of that maximum; nan without a maximum.
    """
    inner = envelope[1:-1]
    peaks = 1 + np.flatnonzero((inner > envelope[:-2]) & (inner >= envelope[2:]))
    high_peaks = peaks[envelope[peaks] >= _HALF * np.max(envelope)]
    if not high_peaks.size:
        return np.nan
    top = int(high_peaks[0])
    if method == "first":
        return _find_begin(envelope[: top + 1], threshold * envelope[top])
    return _fit_top(envelope, top)


def _find_begin(envelope: Array, level: float) -> float:
    """Return the place, in readings, at which an envelope (n_t,), linear between readings, first
    has a ``level``.
    """
    begin = int(np.argmax(envelope >= level))
    if begin == 0:
        return 0.0
    below = envelope[begin - 1]
    above = envelope[begin]
    return begin - 1 + float((level - below) / (above - below))


def _fit_top(envelope: Array, top: int) -> float:
    """Return the place, in readings, of the maximum of the parabola that fits an envelope (n_t,)
    about its highest reading, ``top``, where the envelope has the share :data:`_NEAR` of that.
    """
    low = np.flatnonzero(envelope < _NEAR * envelope[top])
    n_before = int(np.searchsorted(low, top))
    last_before = int(low[n_before - 1]) if n_before else -1
    first_after = int(low[n_before]) if n_before < low.size else envelope.size
    first = min(top - 1, last_before + 1)
    last = max(top + 1, first_after - 1)
    heights = envelope[first : last + 1] / envelope[top]
    # weights that vanish at the ends: no reading counts more or less when the next one is left out
    weights = np.sqrt(np.maximum(heights - _NEAR, _LEAST_WEIGHT))
    from_top = np.arange(first, last + 1) - top
    curve, slope, _ = np.polyfit(from_top, heights, 2, w=weights)
    return float(np.clip(top - 0.5 * slope / curve, first, last))


def _find_delay(signal: Array, times: Array, frequency: float) -> float:
    """Return the size of the group delay of a ``signal`` (n_t,) at ``times`` (n_t,), s, at a
    ``frequency``, Hz: -d phase / d omega of its Fourier integral, s.

    The delay of a burst that is even about the time zero is zero. It is nan for a signal without
    that frequency.
    """
    integrand = signal * np.exp(-2j * np.pi * frequency * times)
    integral = np.sum(integrand)
    if not abs(integral) > 0.0:
        return math.nan
    return abs(float(np.real(np.sum(times * integrand) / integral)))


def _find_delay_error(signals: Array, times: Array, frequency: float) -> float:
    """Return the standard error of the group delay of the mean of ``signals`` (n, n_t) at a
    ``frequency``, Hz, in s; ``times`` (n_t,) are in s.

    The delay is a quotient of two means over signals, which are taken as independent; the error is
    that of first order. It is zero for one signal, and where the mean has not the frequency, of
    which there is no delay.
    """
    wave = np.exp(-2j * np.pi * frequency * times)
    integrals = signals @ wave  # (n,)
    first_moments = signals @ (times * wave)
    mean_integral = np.mean(integrals)
    n = len(signals)
    if n < 2 or not abs(mean_integral) > 0.0:
        return 0.0
    delay = np.mean(first_moments) / mean_integral
    additions = np.real((first_moments - delay * integrals) / mean_integral)
    return float(np.linalg.norm(additions)) / math.sqrt(n * (n - 1))


def _make_gate(times: Array, reach: float) -> Array:
    """Return factors (n_t,) that are 1 around the time zero, and fall to 0 over the last third of
    the ``reach``, s.
    """
    return np.clip(3.0 * (1.0 - np.abs(times) / reach), 0.0, 1.0)


class _Flight(NamedTuple):
    """The flight of a pulse by its envelope.

    Attributes
    ----------
    time : s; nan if it is not known.
    shape_error, scatter : errors of the time by the change of shape and by the speckle, s.
    why_unknown : why the time is not known; empty if it is.
    """

    time: float
    shape_error: float = math.nan
    scatter: float = math.nan
    why_unknown: str = ""


@result_class
class Pulse(Result):
    """What was heard of a pulse; SI units. Signals are velocities along the polarisation.

    Attributes
    ----------
    frequency, cycles : of the burst sin(omega (t - P/2)) (1 - cos(2 pi t/P))/2 that pushes the
        source; P = cycles/frequency.
    direction, polarisation : (3,) unit vectors.
    damping, tangential_damping : s, the viscosity of contacts over their stiffness, in normal
        motion and in all other, means over the contacts.
    drag : (2,) 1/s, of displacements and of rotations.
    distance : m, of the receiving plane from the source, along the direction.
    times : (n_t,) s, from the beginning of the burst.
    sent : (n_t,) force on each ball of the source, N.
    sources, receivers : indices of the balls that are pushed, and of those of the receiving plane.
    samples : (n_r,) the number of the sample that each receiver belongs to; zeros for a single one.
    signals : (n_r, n_t) velocity of each receiver, m/s.
    energies : (2,) J, kinetic and elastic, when the source has ended and at the end of the record,
        from the displacements and velocities of all balls; means over samples.
    plane_distances : (n_p,) m, of further planes, if there are any.
    planes : (n_p, n_t) mean velocity on each of them, m/s; (0,) without any.
    frames : (n_f,) s, if there are any.
    velocities : (n_f, n, 3) of all balls at the times ``frames``, m/s; (0,) without any.
    warnings : one sentence for each limit of the model that the network exceeds, why the time of
        flight is not known, and how sure the velocity is if its error is above 3 percent.
    echo : m, how much longer the way of the first echo from an end is than the distance, or the way
        round a periodic network in the other direction.
    fastest : (2,) m/s, upper bounds of the velocity of long waves: of this polarisation, and of
        all.
    left_out : number of balls that static forces push over where free ends are cut, and that are
        left out.
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
        """(n_r, n_t) signal of each ball minus the coherent signal, m/s."""
        return read_only(self.signals - self.coherent)

    @cached_property
    def speckle_amplitude(self) -> Array:
        """(n_t,) root of the mean square of the speckle over the balls of the plane, m/s."""
        return read_only(np.sqrt(np.mean(self.speckle**2, axis=0)))

    @property
    def coherent_fraction(self) -> float:
        """Part of the integral over time of the mean square of the signals that is coherent."""
        whole = float(np.sum(np.mean(self.signals**2, axis=0)))
        if not whole:
            return 0.0
        return float(np.sum(self.coherent**2)) / whole

    @property
    def envelope(self) -> Array:
        """(n_t,) envelope of the coherent signal, m/s."""
        return find_envelope(self.coherent)

    @property
    def damping_ratio(self) -> float:
        """zeta of the frequency by the :attr:`damping` of normal motion and the :attr:`drag` of
        displacements, (omega tau + gamma/omega)/2: over the critical one; a period leaves exp(-2 pi
        zeta).
        """
        return self._find_damping_ratio(self.damping)

    def _find_damping_ratio(self, damping: float) -> float:
        """Return zeta of the frequency with a ``damping``, s, and the drag of displacements."""
        omega = 2.0 * math.pi * self.frequency
        return 0.5 * (omega * damping + float(self.drag[0]) / omega)

    @property
    def loss(self) -> float:
        """Part of the energy that is lost from the end of the source to the end of the record."""
        start, end = self.energies
        return float(1.0 - end / start)

    def arrival(self, method: str = "envelope", threshold: float = _BEGINS) -> float:
        """Return the time of flight of the coherent signal, s; nan where there is none, see
        :attr:`time_of_flight`.

        Parameters
        ----------
        method : "envelope": from the maximum of the envelope of the burst to the first maximum of
            the envelope of the signal that has at least half of the greatest height. "first":
            between the times at which the two envelopes first have the part ``threshold`` of that
            maximum. "correlation": the shift at which the cross-correlation of the signal and the
            burst is greatest; it follows single waves under the envelope, so for long pulses it
            tells the phase, up to whole periods.
        threshold : for "first".

        Raises :class:`~granphon.base.errors.InputError` for an unknown method, and a threshold that
        is not between 0 and 1.
        """
        flights, _ = self._find_arrivals(self.coherent[None], method, threshold)
        return math.nan if self.why_unknown else float(flights[0])

    def arrivals(self, method: str = "envelope", threshold: float = _BEGINS) -> Array:
        """Return the time of flight (n_r,) of the signal of each ball, s; nan where there is none.

        ``method`` and ``threshold`` are those of :meth:`arrival`.
        """
        flights, _ = self._find_arrivals(self.signals, method, threshold)
        return np.full(flights.shape, math.nan) if self._find_echo() else flights

    def _find_arrivals(
        self, signals: Array, method: str, threshold: float
    ) -> tuple[Array, list[str]]:
        """Return the times of flight (n,) of ``signals`` (n, n_t), s, and why each is not known, as
        of :func:`find_arrivals`.
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
        times, reasons = self._find_arrivals(self.coherent[None], "envelope", _BEGINS)
        time = float(times[0])
        why = self._find_echo() or reasons[0] or self._explain_too_fast(time)
        if why:
            return _Flight(math.nan, why_unknown=why)
        since_middle, pulse_gate, long_gate = self._make_gates(time)
        # the delay of the pulse alone, and with all that follows, as waves near the top of a band
        # are late: either may agree with the envelope by chance
        pulse = self.coherent * pulse_gate
        pulse_delay = _find_delay(pulse, since_middle, self.frequency)
        long_delay = _find_delay(self.coherent * long_gate, since_middle, self.frequency)
        shape_error = max(pulse_delay, long_delay)
        scatter = _find_delay_error(self.signals * pulse_gate, since_middle, self.frequency)
        share_kept = self._find_share(pulse) / self._find_share(self.sent)
        is_error_small = shape_error < _UNKNOWN * time  # False for nan
        if share_kept < _LEAST_SHARE or not is_error_small:
            why = (
                f"what arrives are other waves of the burst than those of its frequency,"
                f" {self.frequency:.6g} Hz, which are held back more than these: use another"
                f" frequency, such as one of a band, more cycles, or a shorter distance"
            )
            return _Flight(math.nan, why_unknown=why)
        return _Flight(time, shape_error, scatter)

    def _make_gates(self, time: float) -> tuple[Array, Array, Array]:
        """Return the times (n_t,), s, since a pulse with the ``time`` of flight, s, is at its
        height, and two gates (n_t,) about that moment: of the pulse alone, and of all that comes
        before an echo or the end of the record.
        """
        duration = self.cycles / self.frequency
        middle = time + 0.5 * duration
        echo_time = time + self.echo / float(self.fastest[0])
        reach_to_echo = min(echo_time, float(self.times[-1])) - middle
        since_middle = self.times - middle
        pulse_gate = _make_gate(since_middle, min(_REACH * duration, reach_to_echo))
        long_gate = _make_gate(since_middle, reach_to_echo)
        return since_middle, pulse_gate, long_gate

    def _explain_too_fast(self, time: float) -> str:
        """Return why no wave can have taken the ``time``, s, for the distance; empty if one
        can.
        """
        fastest = float(self.fastest[1])
        if not self.distance > (1.0 + _FASTER) * fastest * time:
            return ""
        return (
            f"the signal is highest {write_quantity(time, 's', 4)} after the burst, and"
            f" the fastest waves of the network, of {fastest:.4g} m/s at most, take longer:"
            f" use a longer distance, another frequency or more cycles"
        )

    def _find_share(self, signal: Array) -> float:
        """Return the size of the spectrum of a signal (n_t,) at the frequency of the burst, over
        its maximum: as for the burst if all waves travel alike.
        """
        wave = np.exp(-2j * np.pi * self.frequency * self.times)
        highest = float(np.max(np.abs(np.fft.rfft(signal, 2 * signal.size))))
        return abs(complex(signal @ wave)) / highest

    def _find_echo(self) -> str:
        """Return why an echo makes times of flight unknown, if an echo may come before the pulse is
        at its height; else an empty text.
        """
        # the height is known from the next reading
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
        """Return sentences: that waves are damped too much for a velocity; and why the time of
        flight is not known, or how sure the velocity is if its error is above 3 percent.
        """
        greatest_damping = max(self.damping, self.tangential_damping)
        damping_ratio = self._find_damping_ratio(greatest_damping)
        remarks = [_DAMPED] if damping_ratio > _MOST_DAMPING else []
        if self.why_unknown:
            remarks.append(f"the arrival of the pulse is not known: {self.why_unknown}")
            return tuple(remarks)
        error = self.velocity_error / self.velocity
        if error > _UNSURE:
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

        It is nan, and :attr:`warnings` say why, in six cases: the signal is zero; it does not come
        after the burst; the record ends before the pulse is over; an echo may come before the
        maximum of the pulse; the velocity would be above the fastest wave; other frequencies than
        that of the burst arrive, as in a gap.
        """
        return self._flight.time

    @property
    def why_unknown(self) -> str:
        """Why the time of flight is nan; empty if it is not."""
        return self._flight.why_unknown

    @property
    def velocity(self) -> float:
        """Distance over the time of flight by the envelope, m/s; nan where that is none."""
        return self.distance / self.time_of_flight

    @property
    def velocity_error(self) -> float:
        """How far the velocity may be from the group velocity at the frequency of the burst, m/s.

        The error has two parts, whose squares add up. The shape of the pulse changes: the
        difference from the velocity by the group delay at that frequency, -d phase / d omega of the
        signal, the larger of two, of the pulse alone and of all that comes before an echo or the
        end of the record. And signals differ from ball to ball: the standard error of that delay,
        as if the balls of the plane were independent. The error is a lower bound where an echo
        comes so soon that only a part of the pulse counts, and where neighbours hear alike.
        """
        flight = self._flight
        time_error = math.hypot(flight.shape_error, flight.scatter)
        return self.velocity * time_error / flight.time


def average_pulses(pulses: Sequence[Pulse]) -> Pulse:
    """Return one pulse with the receivers of all ``pulses``, each of other samples: its coherent
    part is the mean over all receivers.

    Records of different lengths end with the shortest. Frames are left out, as they are of one
    sample.

    Raises :class:`~granphon.base.errors.InputError` for no pulse, or for pulses that were not sent
    alike.
    """
    if not pulses:
        raise InputError("there is no pulse to average", mend="Give one or more")
    first = pulses[0]
    count = min(pulse.times.size for pulse in pulses)
    for pulse in pulses[1:]:
        _require_alike(pulse, first, count)
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
    # judgements of each pulse alone do not hold for their mean
    warnings: list[str] = []
    for pulse in pulses:
        judgements = pulse.judge()
        for warning in pulse.warnings:
            if warning not in judgements and warning not in warnings:
                warnings.append(warning)
    return replace(mean_pulse, warnings=(*warnings, *mean_pulse.judge()))


def _require_alike(pulse: Pulse, first: Pulse, count: int) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a pulse that was not sent as the
    ``first`` was; ``count`` times are compared.
    """
    settings = (
        "frequency",
        "cycles",
        "direction",
        "polarisation",
        "drag",
    )
    unlike = [
        name for name in settings if not np.array_equal(getattr(pulse, name), getattr(first, name))
    ]
    if len(pulse.planes) != len(first.planes):
        unlike.append("plane_distances")
    # what depends on the balls differs a little from sample to sample
    for name in ("damping", "tangential_damping", "distance"):
        size = getattr(first, name)
        if not unlike and abs(getattr(pulse, name) - size) > _SAME * size:
            unlike.append(name)
    rounding = _ROUNDING * np.max(np.abs(first.sent))
    if not unlike and not np.allclose(pulse.sent[:count], first.sent[:count], atol=rounding):
        unlike.append("sent")
    if unlike:
        fault = f"the pulses differ in {', '.join(unlike)}"
        raise InputError(fault, mend="Average pulses that were sent alike")


@dataclass(frozen=True, eq=False)
class PulseSource:
    """A pulse to be sent: its fields are the arguments of
    :meth:`~granphon.waves.waves.Waves.transmit`, see there.
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

    def find_losses(self, network: ContactNetwork) -> Losses:
        """Return the losses of a network in which the pulse travels."""
        damping = self.damping
        if self.tangential_damping is not None:
            normal = damping[0] if isinstance(damping, tuple) else damping
            damping = (normal, self.tangential_damping)
        return Losses.of(
            network,
            damping,
            drag=self.drag,
            dashpot=self.dashpot,
            restitution=self.restitution,
        )

    @classmethod
    def of(
        cls, settings: PulseSettings, network: ContactNetwork, direction: ArrayLike | None = None
    ) -> Self:
        """Return the pulse of the ``settings`` of a scene, in a ``direction``, Cartesian, (p,);
        None for x.

        Without a distance in the settings the receiving plane is half a period of the network away,
        and a quarter where ends are periodic; of two planes that are as near to that place it is
        the one nearer to the source, in all samples alike.
        """
        periods = sum(network.pbc)
        vector = np.eye(periods)[0] if direction is None else np.asarray(direction, float)
        distance = settings.distance
        if distance is None:
            unit_vector = np.zeros(3)
            unit_vector[:periods] = vector / np.linalg.norm(vector)
            course = Course.along(network, unit_vector)
            course.require_period(2.0 * course.spacing, "A pulse goes half of that way")
            share = 0.25 if settings.ends == "periodic" else 0.5
            distance = share * course.period - _NEARER * course.spacing
        return cls(
            settings.frequency,
            vector,
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
    burst : the force in time.
    push : (3,) unit vector along which the source pushes.
    start : place from which distances count, m.
    sources : balls that are pushed.
    groups : balls of the receiving plane, and of each further plane.
    fastest : (2,) velocity of waves in which balls move in proportion, along ``push``, and in the
        stiffest direction, m/s.
    times : (n_t,) at which the pulse is heard, s.
    frames : (n_f,) at which the motions of all balls are kept, s.
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
        """Return the route of the pulse that is requested.

        In the network for which the pulse is meant, waves may be slower or faster than in this one
        by the factor ``margin``. Raises what :meth:`~granphon.waves.waves.Waves.transmit` raises,
        but for the frequency.
        """
        hertz = positive("frequency", request.frequency, "Hz")
        distance = positive("distance", request.distance, "m")
        burst = ToneBurst(hertz, positive("cycles", request.cycles))
        if burst.cycles < 1.0:
            raise InputError(f"cycles is {burst.cycles:g}", mend="Give 1 or more")
        ends = one_of("ends", request.ends, ENDS)
        direction = read_vector("direction", request.direction, network.dimension)
        push = read_push(network, direction, request.polarisation)
        plane_distances = _read_list("planes", request.planes, "m", "above zero")
        frames = _read_list("frames", request.frames, "s", "zero or above")
        distances = [distance, *plane_distances.tolist()]
        farthest = max(distances)
        course = Course.along(network, direction)
        if ends == "periodic":
            why = "The pulse that runs the other way round would come first"
            course.require_period(2.0 * farthest, why)
        course.require_period(farthest, "The pulse would meet itself")
        course = course.with_ends(ends)
        sources = _find_sources(course, request.source)
        is_plane = isinstance(request.source, str) and request.source == "plane"
        at_face = is_plane and not math.isnan(course.face)
        start = course.face if at_face else course.find_place(sources)
        groups = [course.find_plane(start + length, "receivers") for length in distances]
        receivers = groups[0]
        _require_apart(course, distance, sources, receivers)
        may_have_fallen = ends == "free" and np.any(network.moving & ~course.network.moving)
        fastest = _find_fastest(
            course, push, sources, receivers, may_have_fallen=bool(may_have_fallen)
        )
        if request.duration is not None:
            duration = positive("duration", request.duration, "s")
        else:
            duration = burst.duration + _LATE * farthest / float(fastest[0])
            if ends == "periodic":
                # the record ends before the pulse that runs the other way round comes
                flight_length = course.find_distance(start, receivers)
                _require_room(course.period, flight_length, fastest[0] / margin, burst)
                other_way = course.period - flight_length
                duration = min(duration, other_way / float(fastest[0]))
        times = _list_readings(burst, duration)
        return cls(
            course=course,
            burst=burst,
            push=push,
            start=start,
            sources=sources,
            groups=groups,
            fastest=fastest,
            times=times,
            frames=frames,
        )

    @property
    def last(self) -> float:
        """The latest time to which the pulse is propagated, s."""
        return float(max([self.end, *self.frames]))

    @property
    def end(self) -> float:
        """The end of the record, or of the burst if that is later, s."""
        return max(float(self.times[-1]), self.burst.duration)


def _require_apart(course: Course, distance: float, sources: Index, receivers: Index) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if balls of the receiving plane, at a
    ``distance``, m, are among the sources.
    """
    if not np.isin(receivers, sources).any():
        return
    fault = f"the distance of {distance:.6g} m leads to the plane of the source itself"
    why = "The receiving plane is that of the balls nearest to it"
    raise InputError(fault, why, f"Take a longer distance: a ball is {course.spacing:.6g} m wide")


def _list_readings(burst: ToneBurst, duration: float) -> Array:
    """Return the times (n_t,), s, at which a pulse is read within a ``duration``, s:
    :data:`READINGS` in a period of the burst, and three at least.

    Raises :class:`~granphon.base.errors.InputError` for too many times.
    """
    step = 1.0 / (READINGS * burst.frequency)
    n_steps = duration / step if step else math.inf  # a step of zero is one that has underflowed
    if not n_steps < _MOST_READINGS:
        fault = (
            f"a pulse of {burst.frequency:g} Hz and {burst.cycles:g} cycles is read more than"
            f" {_MOST_READINGS:,} times"
        )
        raise InputError(
            fault, mend="Use a lower frequency, fewer cycles, or a shorter distance or duration"
        )
    n_readings = max(3, math.floor(n_steps) + 1)  # a parabola goes through three
    times: Array = step * np.arange(n_readings, dtype=np.float64)
    return times


def _find_sources(course: Course, source: str | int | Sequence[int]) -> Index:
    """Return the balls that are pushed: those given, the first plane along the direction, or its
    ball of lowest index.

    Raises :class:`~granphon.base.errors.InputError` for a ball that does not move, and another
    word.
    """
    moving = course.network.moving
    if not isinstance(source, str):
        sources = index_array("source", source, course.network.n_balls)
        held = sources[~moving[sources]]
        if held.size:
            raise InputError(
                f"ball {held[0]} of the source does not move",
                "Its mass is infinite, or it fell where the end was cut",
            )
        return sources
    if source not in ("plane", "ball"):
        raise InputError(
            f"source is {brief(source)}", mend="Use plane, ball, or the index of a ball"
        )
    # not the place 0: on a closed course the last plane may be as near to it as the first
    plane = course.find_plane(float(np.min(course.places[moving])), "source")
    return plane if source == "plane" else plane[:1]


def _find_fastest(
    course: Course, push: Array, sources: Index, receivers: Index, may_have_fallen: bool
) -> Array:
    """Return the velocities (2,) of long waves in which the balls of a piece move in proportion,
    along ``push`` and in the stiffest direction, m/s: no wave of the piece is faster.

    ``may_have_fallen`` says that balls were left out between free ends. Raises
    :class:`~granphon.base.errors.InputError` if no contacts join the sources and the receivers
    (:class:`~granphon.base.errors.InstabilityError` if balls may have fallen), or none resists
    ``push``.
    """
    network = course.network
    piece_of_ball = number_pieces(network.i, network.j, network.moving)
    shared_pieces = np.intersect1d(piece_of_ball[receivers], piece_of_ball[sources])
    if not shared_pieces.size:
        if may_have_fallen:
            raise InstabilityError(_NOTHING_HELD)
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


def _find_stiffnesses(course: Course, piece_of_ball: Index, chosen: Index) -> Array:
    """Return the stiffness of the ``chosen`` pieces over their mass, (m/s)^2, for waves along the
    course in which balls move in proportion: (pieces, n_u, n_u), over the n_u axes along which
    balls move.

    ``piece_of_ball`` (n,) is the number of the piece of each ball.
    """
    network = course.network
    axes = list(network.ball_motions.translations)
    moving = network.moving
    moving_end = np.where(moving[network.i], network.i, network.j)  # a ball of each contact
    piece_of_contact = piece_of_ball[moving_end]
    n_pieces = int(np.max(piece_of_ball)) + 1
    masses = np.bincount(piece_of_ball[moving], network.masses[moving], n_pieces)
    # the two balls of a contact differ in their motion by its length along the course
    squared_lengths = (network.vector @ course.direction) ** 2
    shear = network.shear_stiffness
    normals = network.normal.T
    excess = (network.normal_stiffness - shear) * squared_lengths
    stiffness = np.zeros((len(axes), len(axes), n_pieces))
    for row, a in enumerate(axes):
        for column, b in enumerate(axes):
            of_contacts = excess * normals[a] * normals[b] + (a == b) * shear * squared_lengths
            stiffness[row, column] = np.bincount(piece_of_contact, of_contacts, n_pieces)
    tensors = np.moveaxis(stiffness, -1, 0)[chosen]
    return np.asarray(tensors / masses[chosen, None, None])


def _require_room(period: float, distance: float, velocity: float, burst: ToneBurst) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if in a ``period``, m, the pulse that runs
    the other way round comes before the pulse at a ``distance``, m, is over; ``velocity``, m/s, is
    that of both.
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
        f"Then the pulse that runs the other way round the periodic network"
        f" comes, which is {period:.4g} m long"
    )
    changes = "fewer cycles, a higher frequency, or ends: free"
    mend = f"Use {nearer}an array of {least_period:.4g} m along the direction, {changes}"
    raise InputError(fault, why, mend)


def require_sendable(network: ContactNetwork, request: PulseSource) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if it is known beforehand that a pulse cannot
    be sent, or not be read.

    ``network`` is the array of equal balls that stands for an array of differing balls before that
    array is simulated. Requests that depend on the forces of contacts are refused only where no
    forces could serve them.
    """
    route = Route.of(network, request, MARGIN)
    burst = route.burst
    operator = make_operator(route.course.network)
    limit = MARGIN * operator.top / (2.0 * math.pi)
    if burst.frequency > limit:
        raise _explain_unreachable(burst.frequency, f"which is below {limit:.4g} Hz")
    _require_short(operator, route.last / MARGIN)


def transmit(
    network: ContactNetwork,
    request: PulseSource,
    operator: WaveOperator | None = None,
    progress: Progress = silent,
) -> Pulse:
    """Send a pulse through a network; see :meth:`granphon.waves.waves.Waves.transmit`.

    ``operator`` is that of the network, if it is known, and known to be stable; ``progress`` is
    told how far the pulse has come where it is not known.
    """
    route = Route.of(network, request)
    course = route.course
    burst = route.burst
    receivers = route.groups[0]
    if operator is None or operator.network is not course.network:
        operator = make_operator(course.network, progress)
        if not course.at_rest:
            require_stable(operator)
    _require_reached(operator, burst.frequency)
    losses = request.find_losses(course.network)
    _require_short(operator, route.last, losses)
    _require_frames_memory(len(route.frames), network.n_balls, operator.size)
    motions = _propagate(route, operator, losses)
    distances = [course.find_distance(route.start, balls) for balls in route.groups]
    fallen = np.zeros(0, np.intp)
    if request.ends == "free":
        fallen = np.flatnonzero(network.moving & ~course.network.moving)
    pulse = Pulse(
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
        left_out=fallen.size,
    )
    remarks = _judge_fallen(course, fallen, receivers)
    return replace(pulse, warnings=(*remarks, *pulse.judge()))


def count_products(operator: WaveOperator, request: PulseSource) -> float:
    """Return the number of products of D with a vector that a pulse through a network takes;
    ``operator`` is that of the whole network, whose ends the request may cut.

    Raises :class:`~granphon.base.errors.InputError` for a pulse that cannot be sent.
    """
    route = Route.of(operator.network, request)
    losses = request.find_losses(route.course.network)
    _require_short(operator, route.last, losses)
    even = losses.find_even()
    if even is None:
        return _UNEVEN_PRODUCTS * operator.top * route.last
    _, time, drag = even
    no_push = np.zeros(0)
    return float(Propagation(operator, no_push, route.burst, route.last, time, drag).order)


def _find_mean(values: Array) -> float:
    """Return the mean of values (n,); of equal ones their value, without rounding."""
    return float(values[0] if np.ptp(values) == 0.0 else np.mean(values))


def _require_frames_memory(n_frames: int, n_balls: int, size: int) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the frames do not fit into memory: the
    velocities of all balls, and displacements and velocities as vectors (size,).
    """
    memory = 8.0 * n_frames * (3.0 * n_balls + 2.0 * size)  # 8 bytes for each number
    require_memory(f"{n_frames:,} frames of {n_balls:,} balls", memory, "Give fewer frames")


class _HeardMotions(NamedTuple):
    """The motions of balls that a pulse has reached.

    Attributes
    ----------
    signals : (n, n_t) velocities of the balls of each group of receivers, m/s.
    energies : (2,) kinetic and elastic, at the ends of the burst and of the record, J.
    velocities : (n_f, n, 3) of all balls at the frames, m/s.
    """

    signals: list[Array]
    energies: Array
    velocities: Array


def _propagate(route: Route, operator: WaveOperator, losses: Losses) -> _HeardMotions:
    """Return the motions of the pulse of a route in a network with these ``losses``."""
    network = operator.network
    burst = route.burst
    axes = list(operator.motions.translations)
    push = route.push[axes]
    inverse_root = 1.0 / np.sqrt(network.masses)  # from mass-weighted motions to motions
    forces = operator.push(route.sources, route.push, inverse_root[route.sources])
    receivers = np.concatenate(route.groups)
    indices = operator.indices[receivers, : push.size]
    propagation: Propagation | ViscousPropagation
    even = losses.find_even()
    if even is None:
        propagation = ViscousPropagation(operator, forces, burst, losses)
    else:
        _, time, drag = even
        propagation = Propagation(operator, forces, burst, route.last, time, drag)

    def listen(vector: Array) -> Array:
        """Return the velocities (n_r,) of receivers along the push, m/s, from a ``vector`` (size,)
        of mass-weighted velocities.
        """
        return inverse_root[receivers] * (vector[indices] @ push)

    # energies are found at the ends of the burst and of the record
    energy_times = [burst.duration, route.end]
    state_times = np.concatenate([energy_times, route.frames])
    signals, state_x, state_v = propagation.follow(listen, route.times, state_times)
    energies = [
        0.5 * (v @ v) + operator.store(x) for x, v in zip(state_x[:2], state_v[:2], strict=True)
    ]
    velocities = _find_ball_velocities(operator, state_v[2:])
    group_ends = np.cumsum([len(balls) for balls in route.groups[:-1]])
    return _HeardMotions(np.split(signals, group_ends), np.array(energies), velocities)


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


def _judge_fallen(course: Course, fallen: Index, receivers: Index) -> list[str]:
    """Return a warning if balls that have ``fallen`` (n,) behind cut ends lie as far inside as the
    ``receivers``; else nothing.
    """
    if not fallen.size:
        return []
    depths = np.minimum(course.places, course.period - course.places)  # from the nearer end, m
    if np.max(depths[fallen]) < np.min(depths[receivers]):
        return []
    return [
        f"static forces push {counted(fallen.size, 'ball')} over behind the ends that are cut,"
        f" as far inside as the receiving plane, so that the array is no longer what it was:"
        f" use ends: walls, friction, or a higher load"
    ]


def _require_reached(operator: WaveOperator, hertz: float) -> None:
    """Raise :class:`~granphon.base.errors.UnreachableFrequencyError` for a frequency above all
    modes.
    """
    from scipy.sparse.linalg import eigsh

    square = (2.0 * np.pi * hertz) ** 2
    if square <= _SURE * operator.top**2 and not operator.network.prestress:
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
    """Return the numbers (n,) of an argument, in its ``unit``; the list may be empty."""
    if not real_array(name, value).size:
        return np.zeros(0)
    return finite_array(name, value, unit, low).ravel()


def read_vector(name: str, value: Any, dimension: int) -> Array:
    """Return the unit vector (3,) along a vector of 1 to 3 numbers; components that are not given
    are zero. ``dimension`` is the number that the message asks for.
    """
    components = np.atleast_1d(finite_array(name, value))
    is_vector = components.ndim == 1 and components.size <= 3
    if not is_vector or not np.any(components):
        raise InputError(
            f"{name} is {brief(value)}", f"It is a vector of {dimension} numbers, not all zero"
        )
    # over the largest component first: squares of very large or small numbers have no digits
    vector = np.pad(components, (0, 3 - components.size)) / np.max(np.abs(components))
    return np.asarray(vector / np.linalg.norm(vector))


def require_moves(name: str, along: Array, network: ContactNetwork, turns: bool = False) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless the balls of a network move, or with
    ``turns`` turn, along a vector (3,), or each ball along its own vector (n, 3).
    """
    motions = network.ball_motions
    vectors = np.atleast_2d(along)
    axes = motions.rotations if turns else motions.translations
    forbidden = np.abs(np.delete(vectors, list(axes), axis=1))  # components off these axes
    largest_forbidden = forbidden.max(axis=1, initial=0.0)
    rounding = _FLAT * np.abs(vectors).max(initial=0.0)
    if largest_forbidden.max(initial=0.0) <= rounding:
        return
    ball = int(np.argmax(largest_forbidden))
    verb, preposition = ("turn", "about") if turns else ("move", "along")
    vector = _write_direction(vectors[ball])
    is_of_all_balls = along.ndim == 1
    if is_of_all_balls:
        fault = f"the {name} is {preposition} {vector}"
    else:
        fault = f"{name} of ball {ball} are {vector}"
    allowed = f"do not {verb}"
    if axes:
        axis_names = " and ".join("xyz"[axis] for axis in axes)
        allowed = f"{verb} {preposition} {axis_names} only"
    raise InputError(fault, f"Balls {allowed}")


def read_push(network: ContactNetwork, along: Array, polarisation: Any) -> Array:
    """Return the unit vector (3,) along which a source with a ``polarisation`` pushes; its waves
    travel along the unit vector ``along`` (3,).
    """
    if not isinstance(polarisation, str):
        push = read_vector("polarisation", polarisation, network.dimension)
    elif polarisation == "longitudinal":
        push = along
    elif polarisation == "out_of_plane":
        push = np.array([0.0, 0.0, 1.0])
    elif polarisation == "transverse":
        push = _find_transverse(network, along)
    else:
        options = "longitudinal, transverse, out_of_plane, or a vector"
        raise InputError(f"polarisation is {brief(polarisation)}", mend=f"Use {options}")
    require_moves("push", push, network)
    return push


def _find_transverse(network: ContactNetwork, along: Array) -> Array:
    """Return the unit vector (3,) across ``along`` (3,) in the plane of the balls; in space the
    axis farthest from ``along``, made perpendicular to that vector.
    """
    axes = network.ball_motions.translations
    candidates = [axis for axis in range(max(network.dimension, 2)) if axis in axes]
    if len(candidates) < 2:
        fault = f"the motions {network.motions!r} have no transverse waves in this direction"
        raise InputError(fault, mend="Name another polarisation, or give a vector")
    cosines = np.round(np.abs(along[candidates]), 9)  # rounded: of equal ones the first is taken
    axis = candidates[int(np.argmin(cosines))]
    push = np.eye(3)[axis] - along[axis] * along
    return np.asarray(push / np.linalg.norm(push))


def _explain_unreachable(hertz: float, limit: str) -> UnreachableFrequencyError:
    """Return the error of a frequency above the ``limit`` of the network's modes, in words."""
    fault = f"the frequency {hertz:.6g} Hz is above the top of the network's modes, {limit}"
    return UnreachableFrequencyError(
        fault, "Nothing of the pulse would travel", "Lower the frequency"
    )


def _require_short(operator: WaveOperator, duration: float, losses: Losses | None = None) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a record of a ``duration``, s, that takes
    more than :data:`_MOST` products with D, and for ``losses`` with which nothing moves.
    """
    damping = 0.0
    drag = 0.0
    uneven = False
    if losses is not None:
        damping = float(np.max(losses.times))
        drag = float(np.max(losses.drag))
        uneven = losses.find_even() is None
    tau = write_quantity(damping, "s", 3)
    top = write_quantity(operator.top / (2.0 * math.pi), "Hz", 3)
    ratio = operator.top * damping
    if ratio > _MOST_DAMPED:
        longest_damping = write_quantity(_MOST_DAMPED / operator.top, "s", 3)
        raise InputError(
            f"with a damping of {tau} nothing moves at frequencies up to {top}",
            mend=f"Give {longest_damping} at most",
        )
    viscous_products = (ratio * operator.top + drag) * duration
    if uneven and viscous_products > _MOST:
        fault = f"a damping of {tau} takes {viscous_products:.3g} products"
        raise InputError(
            f"{fault} with the matrix of the network",
            "Different dampings are propagated in steps of the most damped motion",
            "Give less, or one for both",
        )
    products = 0.5 * operator.top * duration
    if products > _MOST:
        record = write_quantity(duration, "s", 3)
        longest = write_quantity(2.0 * _MOST / operator.top, "s", 3)
        raise InputError(
            f"a record of {record} takes {products:.3g} products with the matrix of the network",
            f"Its frequencies go up to {top}, and {_MOST:,} products reach {longest}",
            "Use a higher frequency, fewer cycles, or a shorter distance or duration",
        )
