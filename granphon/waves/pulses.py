"""Pulses through a network: a tone burst is sent from a plane of balls or from one ball, and heard on a plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.arguments import finite_array, not_negative, positive
from granphon.base.errors import InputError, UnreachableFrequencyError, brief, message
from granphon.base.results import Result, read_only
from granphon.networks.network import ContactNetwork
from granphon.networks.pieces import number_pieces
from granphon.waves.array_operator import make_operator
from granphon.waves.arrivals import find_arrivals, find_envelope
from granphon.waves.operator import WaveOperator
from granphon.waves.planes import ENDS, Course
from granphon.waves.propagation import Propagation, ToneBurst
from granphon.waves.viscous import ViscousPropagation

__all__ = ["Pulse", "average_pulses", "transmit"]

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: readings of a signal in a period of the burst
_READINGS = 24
#: the record lasts this many times as long as a wave takes if balls move in proportion to a plane wave of great length
_LATE = 3.0
#: part of the squared bound of frequencies that a ball reaches which moves alone, and so the highest mode: nearly a half
_SURE = 0.45
#: most products with D that a record may take
_MOST = 2**20
_ECHO = (
    "an echo from an end of the array may come before the pulse is at its height, and the time of flight is that of both: "
    "use a longer array, a shorter distance, a higher frequency or fewer cycles"
)
#: part of the envelope at which a signal begins
_BEGINS = 0.1


@dataclass(frozen=True, eq=False, repr=False)
class Pulse(Result):
    """What was heard of a pulse; SI units. Signals are velocities along the polarisation.

    Attributes
    ----------
    frequency, cycles : of the burst sin(omega (t - P/2)) (1 - cos(2 pi t/P))/2 that pushes the source; P = cycles/frequency.
    direction, polarisation : (3,) unit vectors.
    damping, tangential_damping : s, the viscosity of each contact over its stiffness, in normal motion and in all other.
    distance : m, of the receiving plane from the source, along the direction.
    times : (n_t,) s, from the beginning of the burst.
    sent : (n_t,) force on each ball of the source, N.
    sources, receivers : indices of the balls that are pushed, and of those of the receiving plane.
    samples : (n_r,) the number of the sample that each receiver belongs to; zeros for a single one.
    signals : (n_r, n_t) velocity of each receiver, m/s.
    energies : (2,) J, kinetic and elastic, when the source has ended and at the end of the record, from the displacements
        and velocities of all balls; means over samples.
    plane_distances : (n_p,) m, of further planes, if there are any.
    planes : (n_p, n_t) mean velocity on each of them, m/s; (0,) without any.
    frames : (n_f,) s, if there are any.
    velocities : (n_f, n, 3) of all balls at the times ``frames``, m/s; (0,) without any.
    warnings : a sentence if an echo from an end may come before the pulse is at its height; times of flight are then those
        of both.
    """

    units = {
        "frequency": "Hz", "damping": "s", "tangential_damping": "s", "distance": "m", "times": "s", "sent": "N",
        "signals": "m/s", "plane_distances": "m", "planes": "m/s", "frames": "s", "velocities": "m/s", "energies": "J",
    }  # fmt: skip
    shapes = {
        "direction": "3", "polarisation": "3", "times": "t", "sent": "t", "sources": "s", "receivers": "r", "samples": "r",
        "signals": "r t", "plane_distances": "p", "planes": "p t|p", "frames": "f", "velocities": "f n 3|f", "energies": "2",
    }  # fmt: skip

    frequency: float
    cycles: float
    direction: Array
    polarisation: Array
    damping: float
    tangential_damping: float
    distance: float
    times: Array
    sent: Array
    sources: Index
    receivers: Index
    samples: Index
    signals: Array
    energies: Array
    plane_distances: Array
    planes: Array
    frames: Array
    velocities: Array
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        # plain data do not keep the shape of an array without numbers
        if not self.planes.size:
            object.__setattr__(self, "planes", np.zeros((len(self.plane_distances), self.times.size)))
        if not self.velocities.size:
            object.__setattr__(self, "velocities", np.zeros((len(self.frames), 0, 3)))
        super().__post_init__()

    @cached_property
    def coherent(self) -> Array:
        """(n_t,) mean velocity of the receiving plane, over all samples, m/s."""
        return read_only(np.mean(self.signals, axis=0))

    @cached_property
    def speckle(self) -> Array:
        """(n_r, n_t) what is left of the signal of each ball without the coherent part, m/s."""
        return read_only(self.signals - self.coherent)

    @cached_property
    def speckle_amplitude(self) -> Array:
        """(n_t,) root of the mean square of the speckle over the balls of the plane, m/s."""
        return read_only(np.sqrt(np.mean(self.speckle**2, axis=0)))

    @property
    def coherent_fraction(self) -> float:
        """Part of the integral over time of the mean square of the signals that is coherent."""
        whole = float(np.sum(np.mean(self.signals**2, axis=0)))
        return float(np.sum(self.coherent**2)) / whole if whole else 0.0

    @property
    def envelope(self) -> Array:
        """(n_t,) envelope of the coherent signal, m/s."""
        return find_envelope(self.coherent)

    @property
    def damping_ratio(self) -> float:
        """zeta = pi times the frequency and the :attr:`damping`: over the critical one; a period leaves exp(-2 pi zeta)."""
        return math.pi * self.damping * self.frequency

    @property
    def loss(self) -> float:
        """Part of the energy that is lost from the end of the source to the end of the record."""
        start, end = self.energies
        return float(1.0 - end / start)

    def arrival(self, method: str = "envelope", threshold: float = _BEGINS) -> float:
        """Return the time of flight of the coherent signal, s.

        Parameters
        ----------
        method : "envelope": from the maximum of the envelope of the burst to that of the signal, whose first maximum counts
            that has half the height of the greatest. "first": between the times at which the two envelopes first have the
            part ``threshold`` of that maximum. "correlation": the shift at which the cross-correlation of the signal and the
            burst is greatest; it follows single waves under the envelope, so for long pulses it tells the phase, up to whole
            periods.
        threshold : for "first".

        Raises
        ------
        InputError : an unknown method, a threshold that is not between 0 and 1.
        ConvergenceError : the record ends before the pulse has arrived, the signal is zero, or not later than the burst.
        """
        return float(self._find_arrivals(self.coherent[None], method, threshold)[0])

    def arrivals(self, method: str = "envelope", threshold: float = _BEGINS) -> Array:
        """Return the time of flight (n_r,) of the signal of each ball, s; see :meth:`arrival`."""
        return self._find_arrivals(self.signals, method, threshold)

    def _find_arrivals(self, signals: Array, method: str, threshold: float) -> Array:
        threshold = positive("threshold", threshold)
        if threshold >= 1.0:
            raise InputError(message(f"threshold is {threshold:g}", mend="Give a part of the maximum, below 1"))
        return find_arrivals(self.times, signals, self.sent, method, threshold)

    @property
    def time_of_flight(self) -> float:
        """Time of flight by the envelope of the coherent signal, s."""
        return self.arrival()

    @property
    def velocity(self) -> float:
        """Distance over the time of flight by the envelope, m/s."""
        return self.distance / self.time_of_flight


def average_pulses(pulses: Sequence[Pulse]) -> Pulse:
    """Return one pulse with the receivers of several, of as many samples: its coherent part is the mean over all of them.

    Records of different lengths end with the shortest. Frames are left out, as they are of one sample.

    Raises :class:`~granphon.base.errors.InputError` for no pulse, or for pulses that were not sent alike.
    """
    if not pulses:
        raise InputError(message("there is no pulse to average"))
    first, count = pulses[0], min(one.times.size for one in pulses)
    for one in pulses[1:]:
        same = ("frequency", "cycles", "direction", "polarisation", "damping", "tangential_damping")
        unlike = [name for name in same if not np.array_equal(getattr(one, name), getattr(first, name))]
        if len(one.planes) != len(first.planes):
            unlike.append("plane_distances")
        if not unlike and abs(one.distance / first.distance - 1.0) > 0.1:
            unlike.append("distance")
        if not unlike and not np.allclose(one.sent[:count], first.sent[:count], atol=1e-12 * np.max(np.abs(first.sent))):
            unlike.append("sent")
        if unlike:
            raise InputError(
                message(f"the pulses differ in {', '.join(unlike)}", mend="Average pulses that were sent alike")
            )
    samples, last = [], 0
    for one in pulses:
        samples.append(one.samples + last)
        last = int(np.max(samples[-1])) + 1
    weights = [float(np.max(one.samples)) + 1.0 for one in pulses]

    def mean(name: str) -> Any:
        values = [getattr(one, name) for one in pulses]
        return np.average([one[..., :count] if name == "planes" else one for one in values], axis=0, weights=weights)

    return replace(
        first, distance=float(mean("distance")), times=first.times[:count], sent=first.sent[:count],
        sources=np.concatenate([one.sources for one in pulses]), receivers=np.concatenate([one.receivers for one in pulses]),
        samples=np.concatenate(samples), signals=np.concatenate([one.signals[:, :count] for one in pulses]),
        energies=mean("energies"), plane_distances=mean("plane_distances"), planes=mean("planes"), frames=np.zeros(0),
        velocities=np.zeros(0), warnings=tuple(dict.fromkeys(text for one in pulses for text in one.warnings)),
    )  # fmt: skip


def transmit(
    network: ContactNetwork,
    frequency: float,
    direction: ArrayLike,
    distance: float,
    cycles: float = 5.0,
    polarisation: str | ArrayLike = "longitudinal",
    *,
    source: str | int | Sequence[int] = "plane",
    ends: str = "free",
    damping: float = 0.0,
    tangential_damping: float | None = None,
    duration: float | None = None,
    planes: ArrayLike = (),
    frames: ArrayLike = (),
    operator: WaveOperator | None = None,
) -> Pulse:
    """Send a pulse through a network; see :meth:`granphon.waves.waves.Waves.transmit`."""
    hertz, length = positive("frequency", frequency, "Hz"), positive("distance", distance, "m")
    tau = not_negative("damping", damping, "s")
    across = tau if tangential_damping is None else not_negative("tangential_damping", tangential_damping, "s")
    burst = ToneBurst(hertz, positive("cycles", cycles))
    if burst.cycles < 1.0:
        raise InputError(message(f"cycles is {burst.cycles:g}", mend="Give 1 or more"))
    if ends not in ENDS:
        raise InputError(message(f"ends is {brief(ends)}", mend=f"Use {', '.join(ENDS)}"))
    along = _read_vector("direction", direction, network.dimension)
    push = _find_polarisation(network, along, polarisation)
    apart = finite_array("planes", planes, "m", "above zero").ravel() if np.size(planes) else np.zeros(0)
    farthest = max(length, *apart) if apart.size else length
    course = Course.along(network, along)
    if ends == "periodic":
        course.require_period(2.0 * farthest, "The pulse that runs the other way round would come first")
    course.require_period(farthest, "The pulse would meet itself")
    course = course.with_ends(ends)
    sources = _find_sources(course, source)
    at_face = isinstance(source, str) and source == "plane" and not math.isnan(course.face)
    start = course.face if at_face else course.find_place(sources)
    groups = [course.find_plane(start + one, "receivers") for one in (length, *apart)]
    _require_joined(course.network, sources, groups[0])
    if operator is None or operator.network is not course.network:
        operator = make_operator(course.network)
    _require_reachable(operator, hertz)
    fastest = _estimate_velocity(course.network, along, push)
    if duration is None:
        duration = burst.duration + _LATE * farthest / fastest
        if ends == "periodic":  # what runs the other way round comes later
            duration = min(duration, (course.period - length) / fastest)
    step = 1.0 / (_READINGS * hertz)
    times: Array = step * np.arange(max(3, math.floor(positive("duration", duration, "s") / step) + 1), dtype=np.float64)
    last = max(float(times[-1]), burst.duration)
    shown = finite_array("frames", frames, "s", "zero or above").ravel() if np.size(frames) else np.zeros(0)
    _require_short(operator, max([last, *shown]))
    place = np.full(network.n_balls, -1)
    place[operator.balls] = np.arange(operator.balls.size)
    e = push[list(operator.motions.translations)]
    moved = np.zeros((operator.balls.size, operator.motions.count))
    moved[place[sources], : e.size] = e / np.sqrt(course.network.masses[sources, None])
    ears = place[np.concatenate(groups)]
    root = 1.0 / np.sqrt(course.network.masses[operator.balls[ears]])
    forces = operator.vector(moved)
    walk = (
        Propagation(operator, forces, burst, max([last, *shown]), tau) if across == tau
        else ViscousPropagation(operator, forces, burst, (tau, across))
    )  # fmt: skip
    signals, displaced, moving = walk.follow(
        lambda vector: root * (operator.values(vector)[ears, : e.size] @ e),
        times,
        np.concatenate([[burst.duration, last], shown]),
    )
    parts = np.split(signals, np.cumsum([len(one) for one in groups[:-1]]))
    energies = [0.5 * (v @ v + x @ (operator @ x)) for x, v in zip(displaced[:2], moving[:2], strict=True)]
    far = [course.find_distance(start, one) for one in groups]
    return Pulse(
        hertz, burst.cycles, along, push, tau, across, far[0], times, burst(times), sources, groups[0],
        np.zeros(len(groups[0]), int), parts[0], np.array(energies), np.array(far[1:]),
        np.array([np.mean(one, axis=0) for one in parts[1:]]), shown,
        np.array([_spread(operator, one) for one in moving[2:]]),
        (_ECHO,) if course.find_echo(start, groups[0]) < 0.5 * burst.duration * fastest else (),
    )  # fmt: skip


def _spread(operator: WaveOperator, state: Array) -> Array:
    """Return the velocities (n, 3) of all balls, m/s, of a mass-weighted vector of them."""
    network, axes, balls = operator.network, operator.motions.translations, operator.balls
    field = np.zeros((network.n_balls, 3))
    field[balls[:, None], list(axes)] = operator.values(state)[:, : len(axes)] / np.sqrt(network.masses[balls, None])
    return field


def _read_vector(name: str, given: Any, dimension: int) -> Array:
    """Return a unit vector (3,) of one of 1 to 3 numbers; those that are left out are zero."""
    vector = finite_array(name, given)
    vector = np.atleast_1d(vector)
    if vector.ndim != 1 or vector.size > 3 or not np.any(vector):
        raise InputError(message(f"{name} is {brief(given)}", f"It is a vector of {dimension} numbers, not all zero"))
    vector = np.pad(vector, (0, 3 - vector.size)) / np.max(np.abs(vector))
    return np.asarray(vector / np.linalg.norm(vector))


def _find_polarisation(network: ContactNetwork, along: Array, given: Any) -> Array:
    """Return the unit vector (3,) along which the source pushes."""
    axes = list(network.ball_motions.translations)
    if not isinstance(given, str):
        push = _read_vector("polarisation", given, network.dimension)
    elif given == "longitudinal":
        push = along
    elif given == "out_of_plane":
        push = np.array([0.0, 0.0, 1.0])
    elif given == "transverse":
        # within the plane of the balls; in space the axis that is farthest from the direction, made perpendicular to it
        among = [axis for axis in ((0, 1) if network.dimension < 3 else (0, 1, 2)) if axis in axes]
        if len(among) < 2:
            what = f"the motions {network.motions!r} have no transverse waves in this direction"
            raise InputError(message(what, mend="Name another polarisation, or give a vector"))
        axis = among[int(np.argmin(np.round(np.abs(along[among]), 9)))]
        push = np.eye(3)[axis] - along[axis] * along
        push = push / np.linalg.norm(push)
    else:
        known = "longitudinal, transverse, out_of_plane, or a vector"
        raise InputError(message(f"polarisation is {brief(given)}", mend=f"Use {known}"))
    if abs(np.linalg.norm(push[axes]) - 1.0) > 1e-9:
        shown = ", ".join(f"{one:.6g}" for one in push)
        moves = " and ".join("xyz"[axis] for axis in axes)
        raise InputError(message(f"balls are pushed along ({shown}), and they move along {moves} only"))
    return push


def _find_sources(course: Course, source: Any) -> Index:
    """Return the indices of the balls that are pushed."""
    if isinstance(source, str):
        if source not in ("plane", "ball"):
            raise InputError(message(f"source is {brief(source)}", mend="Use plane, ball, or the index of a ball"))
        # the first balls behind the beginning; the last ones of the period before may be as near to it
        plane = course.find_plane(float(np.min(course.places[course.network.moving])), "source")
        return plane if source == "plane" else plane[:1]
    balls, count = finite_array("source", source).ravel(), course.network.n_balls
    if np.any(balls != np.rint(balls)) or np.any(balls < 0) or np.any(balls >= count) or len(set(balls)) < balls.size:
        raise InputError(message(f"source is {brief(source)}", f"Balls have the indices 0 to {count - 1}"))
    found = balls.astype(int)
    if still := [int(one) for one in found if not course.network.moving[one]]:
        raise InputError(message(f"ball {still[0]} of the source does not move", "Its mass is infinite"))
    return found


def _require_joined(network: ContactNetwork, sources: Index, receivers: Index) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if no chain of contacts leads from the source to the receivers."""
    part = number_pieces(network)
    if not np.isin(part[receivers], part[sources]).any():
        raise InputError(
            message(
                f"no contacts join the source and the {len(receivers)} balls of the receiving plane",
                f"The balls fall into {np.max(part) + 1} parts",
                "Use a higher load, or one of network.pieces()",
            )
        )


def _require_reachable(operator: WaveOperator, hertz: float) -> None:
    """Raise :class:`~granphon.base.errors.UnreachableFrequencyError` for a frequency above all modes of the network."""
    from scipy.sparse.linalg import eigsh

    squared = (2.0 * np.pi * hertz) ** 2
    if squared <= _SURE * operator.top**2 and not operator.network.prestress:
        return
    if operator.size > 2:
        start = np.random.default_rng(0).normal(size=operator.size)
        (top,) = eigsh(operator, k=1, which="LA", v0=start, tol=1e-6, return_eigenvectors=False)
    else:
        top = np.max(np.linalg.eigvalsh(operator @ np.eye(operator.size)))
    if squared <= top * (1.0 + 1e-6):
        return
    limit = math.sqrt(top) / (2.0 * math.pi)
    raise UnreachableFrequencyError(
        message(f"the frequency {hertz:.6g} Hz is above the top of the network's modes, {limit:.6g} Hz",
                "Nothing of the pulse would travel", "Lower the frequency")
    )  # fmt: skip


def _require_short(operator: WaveOperator, duration: float) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a record that takes more than :data:`_MOST` products with D."""
    products = 0.5 * operator.top * duration
    if products > _MOST:
        longest, hertz = 2.0 * _MOST / operator.top, operator.top / (2.0 * math.pi)
        raise InputError(
            message(
                f"a record of {duration:.3g} s takes {products:.3g} products with the matrix of the network",
                f"Its frequencies go up to {hertz:.3g} Hz, and {_MOST} products reach {longest:.3g} s",
                "Use a higher frequency, fewer cycles, or a shorter distance or duration",
            )
        )


def _estimate_velocity(network: ContactNetwork, along: Array, push: Array) -> float:
    """Return the velocity of long waves if balls moved in proportion to them, m/s: those of the network are not faster."""
    part = (network.normal @ push) ** 2
    spring = network.normal_stiffness * part + network.shear_stiffness * (1.0 - part)
    mass = float(np.sum(network.masses[network.moving]))
    squared = float(np.sum(spring * (network.vector @ along) ** 2)) / mass
    if not squared > 0.0:
        raise InputError(
            message("no contact resists this polarisation in this direction", "Waves of it cost no energy",
                    "Use friction, or another polarisation")
        )  # fmt: skip
    return math.sqrt(squared)
