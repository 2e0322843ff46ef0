"""Sources of pulses: a tone burst pushes a plane of balls or one ball, and a plane of balls receives it.

:class:`PulseSource` says what is sent. Its :class:`Route` through the network is found first, from the places of balls and
the contacts alone, so that what cannot be sent is refused before anything is simulated; then the pulse is propagated
(:mod:`granphon.waves.propagation`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.errors import InputError, UnreachableFrequencyError, brief, message
from granphon.base.scales import write_quantity
from granphon.base.text import counted
from granphon.base.validation import finite_array, not_negative, positive, real_array
from granphon.networks.network import ContactNetwork, number_pieces
from granphon.waves.modes import require_stable
from granphon.waves.operator import WaveOperator, make_operator
from granphon.waves.planes import Course
from granphon.waves.propagation import Propagation, ToneBurst, ViscousPropagation
from granphon.waves.pulses import Pulse
from granphon.waves.settings import ENDS, READINGS, PulseSettings

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: duration of the record without the burst, over the flight of a long wave in which balls move in proportion
_LATE = 3.0
#: share of the squared bound of frequencies below which a frequency is surely reached: a ball that moves alone has a half
_SURE = 0.45
#: most products with D that a record may take
_MOST = 2**20
#: largest viscosity of a contact over its stiffness, times the highest frequency
_MOST_DAMPED = 1e12
#: largest number of times at which a pulse is read
_MOST_READINGS = 2**24
#: by so much, in diameters, the default distance is shorter than the part of the period that it is meant to be: the balls of
#: samples of one array are not at the same places, and of two planes that are as near the same one is to be taken
_NEARER = 0.07
#: the mean contact force being the same, velocities and frequencies of an array of differing balls are those of the array of
#: equal ones times a number between this and its inverse, generously
MARGIN = 1.5


@dataclass(frozen=True, eq=False)
class PulseSource:
    """A pulse to be sent: its fields are the arguments of :meth:`~granphon.waves.waves.Waves.transmit`, see there."""

    frequency: float
    direction: ArrayLike
    distance: float
    cycles: float = 5.0
    polarisation: str | ArrayLike = "longitudinal"
    _: KW_ONLY
    source: str | int | Sequence[int] = "plane"
    ends: str = "free"
    damping: float = 0.0
    tangential_damping: float | None = None
    duration: float | None = None
    planes: ArrayLike = ()
    frames: ArrayLike = ()

    @classmethod
    def of(cls, settings: PulseSettings, network: ContactNetwork, direction: ArrayLike | None = None) -> Self:
        """Take the settings of a scene, with the ``direction``, Cartesian, (p,); None for x.

        Without a distance in the settings the receiving plane is half a period of the network away, and a quarter where ends
        are periodic; of two planes that are as near to that place it is the one nearer to the source, in all samples alike.
        """
        periods = sum(network.pbc)
        along = np.eye(periods)[0] if direction is None else np.asarray(direction, float)
        distance = settings.distance
        if distance is None:
            unit = np.zeros(3)
            unit[:periods] = along / np.linalg.norm(along)
            course = Course.along(network, unit)
            course.require_period(2.0 * course.spacing, "A pulse goes half of that way")
            distance = (0.25 if settings.ends == "periodic" else 0.5) * course.period - _NEARER * course.spacing
        return cls(
            settings.frequency, along, distance, settings.cycles, settings.polarisation, source=settings.source,
            ends=settings.ends, damping=settings.damping,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Route:
    """Where a pulse goes in a network, and for how long it is heard.

    Attributes
    ----------
    course : the network with its ends, and the order of its balls along the direction.
    burst : the force in time.
    push : (3,) unit vector along which the source pushes.
    start : place from which distances count, m.
    sources : balls that are pushed.
    groups : balls of the receiving plane, and of each further plane.
    fastest : (2,) velocity of waves in which balls move in proportion, along ``push``, and in the stiffest direction, m/s.
    times : (n_t,) at which it is heard, s.
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
    def of(cls, network: ContactNetwork, wanted: PulseSource, margin: float = 1.0) -> Self:
        """Find the route; raises what :meth:`~granphon.waves.waves.Waves.transmit` raises, but for the frequency.

        Waves may be faster by the factor ``margin`` than those of this network.
        """
        hertz, length = positive("frequency", wanted.frequency, "Hz"), positive("distance", wanted.distance, "m")
        burst = ToneBurst(hertz, positive("cycles", wanted.cycles))
        if burst.cycles < 1.0:
            raise InputError(message(f"cycles is {burst.cycles:g}", mend="Give 1 or more"))
        if wanted.ends not in ENDS:
            raise InputError(message(f"ends is {brief(wanted.ends)}", mend=f"Use {', '.join(ENDS)}"))
        along = read_vector("direction", wanted.direction, network.dimension)
        push = read_push(network, along, wanted.polarisation)
        apart = _read_list("planes", wanted.planes, "m", "above zero")
        frames = _read_list("frames", wanted.frames, "s", "zero or above")
        farthest = max([length, *apart.tolist()])
        course = Course.along(network, along)
        if wanted.ends == "periodic":
            course.require_period(2.0 * farthest, "The pulse that runs the other way round would come first")
        course.require_period(farthest, "The pulse would meet itself")
        course = course.with_ends(wanted.ends)
        # the balls that are pushed, and the place from which distances count
        source, moving = wanted.source, course.network.moving
        if isinstance(source, str):
            if source not in ("plane", "ball"):
                raise InputError(message(f"source is {brief(source)}", mend="Use plane, ball, or the index of a ball"))
            # the first balls behind the beginning; the last ones of the period before may be as near to it
            plane = course.find_plane(float(np.min(course.places[moving])), "source")
            sources = plane if source == "plane" else plane[:1]
        else:
            sources = read_balls("source", source, course.network)
            if still := [int(one) for one in sources if not moving[one]]:
                raise InputError(message(f"ball {still[0]} of the source does not move", "Its mass is infinite"))
        at_face = isinstance(source, str) and source == "plane" and not math.isnan(course.face)
        start = course.face if at_face else course.find_place(sources)
        groups = [course.find_plane(start + one, "receivers") for one in (length, *apart)]
        if np.isin(groups[0], sources).any():
            what = f"the distance of {length:.6g} m leads to the plane of the source itself"
            why = "The receiving plane is that of the balls nearest to it"
            raise InputError(message(what, why, f"Take a longer distance: a ball is {course.spacing:.6g} m wide"))
        part = number_pieces(course.network.i, course.network.j, course.network.moving)
        if not np.isin(part[groups[0]], part[sources]).any():
            what = f"no contacts join the source and the {counted(len(groups[0]), 'ball')} of the receiving plane"
            why, mend = f"The balls fall into {np.max(part) + 1} parts", "Use a higher load, or one of network.pieces()"
            raise InputError(message(what, why, mend))
        # the velocities of long waves if balls moved in proportion, than which those of the network are not faster
        net, axes = course.network, list(network.ball_motions.translations)
        way, n = (net.vector @ along) ** 2, net.normal[:, axes]
        tensor = np.einsum("c,ci,cj->ij", (net.normal_stiffness - net.shear_stiffness) * way, n, n)
        tensor += np.eye(len(axes)) * float(np.sum(net.shear_stiffness * way))
        own = float(push[axes] @ tensor @ push[axes])
        if not own > 0.0:
            what = "no contact resists this polarisation in this direction"
            raise InputError(message(what, "Waves of it cost no energy", "Use friction, or another polarisation"))
        mass = float(np.sum(net.masses[net.moving]))
        fastest = np.sqrt(np.array([own, float(np.linalg.eigvalsh(tensor)[-1])]) / mass)
        if wanted.duration is not None:
            duration = positive("duration", wanted.duration, "s")
        else:
            duration = burst.duration + _LATE * farthest / float(fastest[0])
            if wanted.ends == "periodic":
                # the pulse that runs the other way round is to come only when the one that is heard is over
                period, away, velocity = course.period, course.find_distance(start, groups[0]), fastest[0] / margin
                needed, room = 2.0 * away + velocity * burst.duration, period - velocity * burst.duration
                if needed > period:
                    nearer = f"a distance up to {0.5 * room:.3g} m, " if room > 0.0 else ""
                    moments = ((period - away) / velocity, burst.duration, away / velocity)
                    end, pushed, flight = (write_quantity(one, "s", 3) for one in moments)
                    what = f"the record ends at {end}, before the burst of {pushed} and the flight of {flight} are over"
                    why = f"Then the pulse that runs the other way round the periodic network comes, which is {period:.4g} m"
                    other = "fewer cycles, a higher frequency, or ends: free"
                    mend = f"Use {nearer}an array of {needed:.4g} m along the direction, {other}"
                    raise InputError(message(what, f"{why} long", mend))
                duration = min(duration, (period - away) / float(fastest[0]))
        step = 1.0 / (READINGS * hertz)
        readings = duration / step if step else math.inf
        if not readings < _MOST_READINGS:
            what = f"a pulse of {hertz:g} Hz and {burst.cycles:g} cycles is read more than {_MOST_READINGS:,} times"
            raise InputError(message(what, mend="Use a lower frequency, fewer cycles, or a shorter distance or duration"))
        times: Array = step * np.arange(max(3, math.floor(readings) + 1), dtype=np.float64)
        return cls(course, burst, push, start, sources, groups, fastest, times, frames)

    @property
    def last(self) -> float:
        """The latest time to which the pulse is propagated, s."""
        return float(max([self.end, *self.frames]))

    @property
    def end(self) -> float:
        """The end of the record, or of the burst if that is later, s."""
        return max(float(self.times[-1]), self.burst.duration)


def require_sendable(network: ContactNetwork, wanted: PulseSource) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if it is known that a pulse cannot be sent, or not be read.

    ``network`` is the array of equal balls in the place of one of differing balls that has not been simulated. What depends
    on the forces of contacts is refused only where it is beyond doubt.
    """
    route = Route.of(network, wanted, MARGIN)
    burst = route.burst
    operator = make_operator(route.course.network)
    limit = MARGIN * operator.top / (2.0 * math.pi)
    if burst.frequency > limit:
        raise _explain_unreachable(burst.frequency, f"which is below {limit:.4g} Hz")
    _require_short(operator, route.last / MARGIN)


def transmit(network: ContactNetwork, wanted: PulseSource, operator: WaveOperator | None = None) -> Pulse:
    """Send a pulse through a network; see :meth:`granphon.waves.waves.Waves.transmit`.

    ``operator`` is that of the network, if it is known, and known to be stable.
    """
    from scipy.sparse.linalg import eigsh

    tau = not_negative("damping", wanted.damping, "s")
    across = tau if wanted.tangential_damping is None else not_negative("tangential_damping", wanted.tangential_damping, "s")
    route = Route.of(network, wanted)
    course, burst, push, sources, groups = route.course, route.burst, route.push, route.sources, route.groups
    if operator is None or operator.network is not course.network:
        operator = make_operator(course.network)
        require_stable(operator)
    squared = (2.0 * np.pi * burst.frequency) ** 2
    if squared > _SURE * operator.top**2 or operator.network.prestress:
        if operator.size > 2:
            begin = np.random.default_rng(0).normal(size=operator.size)
            (top,) = eigsh(operator, k=1, which="LA", v0=begin, tol=1e-6, return_eigenvectors=False)
        else:
            top = np.max(np.linalg.eigvalsh(operator @ np.eye(operator.size)))
        if squared > top * (1.0 + 1e-6):
            raise _explain_unreachable(burst.frequency, f"{math.sqrt(top) / (2.0 * math.pi):.6g} Hz")
    _require_short(operator, route.last, max(tau, across), across != tau)
    place = np.full(network.n_balls, -1)
    place[operator.balls] = np.arange(operator.balls.size)
    axes = list(operator.motions.translations)
    e = push[axes]
    moved = np.zeros((operator.balls.size, operator.motions.count))
    moved[place[sources], : e.size] = e / np.sqrt(course.network.masses[sources, None])
    receivers = place[np.concatenate(groups)]
    root = 1.0 / np.sqrt(course.network.masses[operator.balls])
    forces = operator.vector(moved)
    propagation = (
        Propagation(operator, forces, burst, route.last, tau) if across == tau
        else ViscousPropagation(operator, forces, burst, (tau, across))
    )  # fmt: skip
    signals, displaced, moving = propagation.follow(
        lambda vector: root[receivers] * (operator.values(vector)[receivers, : e.size] @ e),
        route.times,
        np.concatenate([[burst.duration, route.end], route.frames]),
    )
    parts = np.split(signals, np.cumsum([len(one) for one in groups[:-1]]))
    energies = [0.5 * (v @ v + x @ (operator @ x)) for x, v in zip(displaced[:2], moving[:2], strict=True)]
    velocities = np.zeros((len(route.frames), network.n_balls, 3))
    for field, vector in zip(velocities, moving[2:], strict=True):
        field[operator.balls[:, None], axes] = root[:, None] * operator.values(vector)[:, : e.size]
    far = [course.find_distance(route.start, one) for one in groups]
    heard = Pulse(
        burst.frequency, burst.cycles, course.direction, push, tau, across, far[0], route.times, burst(route.times), sources,
        groups[0], np.zeros(len(groups[0]), int), parts[0], np.array(energies), np.array(far[1:]),
        np.array([np.mean(one, axis=0) for one in parts[1:]]), route.frames, velocities,
        echo=course.find_echo(route.start, groups[0]), fastest=route.fastest,
    )  # fmt: skip
    return replace(heard, warnings=heard.judge())


def _read_list(name: str, given: ArrayLike, unit: str, span: str) -> Array:
    """Return numbers (n,), which may be none."""
    return finite_array(name, given, unit, span).ravel() if real_array(name, given).size else np.zeros(0)


def read_vector(name: str, given: Any, dimension: int) -> Array:
    """Return a unit vector (3,) of one of 1 to 3 numbers; those that are left out are zero."""
    vector = finite_array(name, given)
    vector = np.atleast_1d(vector)
    if vector.ndim != 1 or vector.size > 3 or not np.any(vector):
        raise InputError(message(f"{name} is {brief(given)}", f"It is a vector of {dimension} numbers, not all zero"))
    vector = np.pad(vector, (0, 3 - vector.size)) / np.max(np.abs(vector))
    return np.asarray(vector / np.linalg.norm(vector))


def read_balls(name: str, given: Any, network: ContactNetwork) -> Index:
    """Return the indices (n,) of some balls, each once; raises InputError for others than there are."""
    balls, count = finite_array(name, given).ravel(), network.n_balls
    whole = np.all((balls == np.rint(balls)) & (balls >= 0) & (balls < count))
    if not whole or len(set(balls)) < balls.size:
        raise InputError(message(f"{name} is {brief(given)}", f"Balls have the indices 0 to {count - 1}"))
    return balls.astype(int)


def read_push(network: ContactNetwork, along: Array, given: Any) -> Array:
    """Return the unit vector (3,) along which a source pushes whose waves travel ``along``, from its polarisation."""
    axes = list(network.ball_motions.translations)
    if not isinstance(given, str):
        push = read_vector("polarisation", given, network.dimension)
    elif given == "longitudinal":
        push = along
    elif given == "out_of_plane":
        push = np.array([0.0, 0.0, 1.0])
    elif given == "transverse":
        # within the plane of the balls; in space the axis farthest from the direction, made perpendicular to it
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


def _explain_unreachable(hertz: float, limit: str) -> UnreachableFrequencyError:
    """Return the error of a frequency above the ``limit`` of the network's modes, in words."""
    what = f"the frequency {hertz:.6g} Hz is above the top of the network's modes, {limit}"
    return UnreachableFrequencyError(message(what, "Nothing of the pulse would travel", "Lower the frequency"))


def _require_short(operator: WaveOperator, duration: float, damping: float = 0.0, uneven: bool = False) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a record that takes more than :data:`_MOST` products with D.

    ``damping`` is the largest time, s; ``uneven`` says that contacts are damped differently in their motions.
    """
    tau, top = write_quantity(damping, "s", 3), write_quantity(operator.top / (2.0 * math.pi), "Hz", 3)
    if (ratio := operator.top * damping) > _MOST_DAMPED:
        what = f"with a damping of {tau} nothing moves in a network whose frequencies go up to {top}"
        raise InputError(message(what, mend=f"Give {write_quantity(_MOST_DAMPED / operator.top, 's', 3)} at most"))
    if uneven and (viscous := ratio * operator.top * duration) > _MOST:
        what = f"a damping of {tau} takes {viscous:.3g} products with the matrix of the network"
        why = "Different dampings are propagated in steps of the most damped motion"
        raise InputError(message(what, why, "Give less, or one for both"))
    products = 0.5 * operator.top * duration
    if products > _MOST:
        record, longest = (write_quantity(one, "s", 3) for one in (duration, 2.0 * _MOST / operator.top))
        what = f"a record of {record} takes {products:.3g} products with the matrix of the network"
        why = f"Its frequencies go up to {top}, and {_MOST:,} products reach {longest}"
        mend = "Use a higher frequency, fewer cycles, or a shorter distance or duration"
        raise InputError(message(what, why, mend))
