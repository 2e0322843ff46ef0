"""The response of a network at given frequencies: receptance, mobility, accelerance, forces of
contacts, and what a moved wall hands on.

With forces F exp(i omega t) on balls, mass-weighted motions x = M^1/2 u obey Z x = M^-1/2 F,

    Z(omega) = D(omega) + i omega Gamma - omega^2,
    D(omega) = A^T (1 + i eta + i omega tau) A + static forces,

with the losses of :mod:`granphon.dynamics.damping`: the loss factors eta, the times tau and the
matrix of drags Gamma. A maps motions to the deformations of contacts, each times the root of its
stiffness. Of the static forces the part counts that has a potential, so that D is symmetric.

A wall that is moved pulls at the balls that touch it with the same springs and dashpots. A sensor
of force hears the elongations e of contacts: the forces of the contacts are
-k (1 + i eta + i omega tau) e. They include the forces of dashpots, but not the drag, which acts on
balls. There are two methods to solve Z x = M^-1/2 F.

Directly: Z is factorised at each frequency, in an order of the motions that is found once. Further
solutions, of the residual, correct the first solution until it no longer changes. The error is the
last change plus the effect of the rounding of Z and omega, which is large next to modes that lose
no energy.

By one Krylov space for all frequencies: it is that of the source and a matrix H, both independent
of the frequency. Each step multiplies the last vector by H and makes the result orthogonal to the
two vectors before it. On these vectors H is a tridiagonal matrix, with which the shifted systems of
all frequencies are solved (R. W. Freund, in Numerical Linear Algebra, de Gruyter, 1993). Of the
vectors only the signals of receivers are kept, and a step takes one product and a few sums. What H
is depends on the losses:

- All contacts have the same losses, and all motions the same drag gamma. Then Z = s (D - z) with a
  number s and z = (omega^2 - i omega gamma)/s, and H is D: the process of Lanczos.
- Only loss factors differ. Then H is A^T (1 + i eta) A, complex and symmetric, and vectors are made
  orthogonal in the product x.y without conjugation.
- Dashpots differ, or act beside drag. Then H is that of velocities v = x' and deformations
  y = i (1 + i eta)^1/2 A x, with which the equations of motion are of first order,

      (i omega + ((A^T tau A + Gamma, -B^T), (-B, 0))) (v, y) = (M^-1/2 F, 0),
      B = i (1 + i eta)^1/2 A.

  This H is symmetric too. But if its vectors were real in v and imaginary in y, a vector would be
  orthogonal to itself as soon as both have the same energy. So the space begins with 1 - i H times
  the source: without losses its vectors are as real as those of Lanczos. From the solution x' there
  follows x = (x' + i source)/(1 + omega). With strong dashpots this process loses its digits: then
  vectors are made orthogonal in the product with conjugation, to the last two only. This is the
  incomplete process of Arnoldi (Y. Saad, Linear Algebra Appl. 34, 269 (1980)), which is stable and
  takes many more steps. Static forces that press add deformations of imaginary stiffness^1/2.

The norm of the residual is that of the next vector times the last coefficient of the solution. If g
is the least eta + omega tau of all contacts, and gamma the least drag, |Z^-1| is at most one over
the distance of omega^2 - i omega gamma from all d (1 + i g') with d >= 0 and g' >= g; this bounds
the error. The number of steps follows from g beforehand (:class:`ResponseWork`), and frequencies at
which factors take less time are left to factors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.array.sparse_matrices import share_places
from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import ConvergenceError, InputError, brief
from granphon.base.memory import require_memory
from granphon.base.progress import Step
from granphon.base.results import Result, held, result_class
from granphon.base.scales import write_quantity
from granphon.base.text import counted
from granphon.base.threads import single_products
from granphon.base.validation import index_array, one_of, positive
from granphon.dynamics.damping import GivenLosses, Losses
from granphon.dynamics.factors import Elimination
from granphon.networks.network import ContactNetwork
from granphon.waves.operator import WaveOperator
from granphon.waves.peaks import Peaks, Solve, find_peaks
from granphon.waves.pulses import Course, read_push, read_vector, require_moves
from granphon.waves.sensitivities import ResponseSensitivities, ResponseSlopes
from granphon.waves.sensors import (
    DEFAULT_POLARISATION,
    FLOOR,
    LEAST_COSINE,
    Sensor,
    SensorPlaces,
    find_open_axis,
    find_unused,
    is_contact,
    is_plane,
)

#: memory of the response of a ball at one frequency, bytes
_RESPONSE_BYTES = 100.0
#: quantities of a response, and their units
QUANTITIES = {
    "displacement": "m/N",
    "velocity": "m/(N s)",
    "acceleration": "1/kg",
    "force": "1",
    "transmissibility": "1",
    "stiffness": "N/m",
}
#: quantities whose source is a wall that is moved
OF_MOVED_WALL = ("transmissibility", "stiffness")
#: quantities whose receivers are sensors of force
OF_FORCE = ("force", "stiffness")
#: names of the methods that solve the equations
METHODS = ("direct", "krylov")
#: number of motions up to which Z is factorised at all frequencies, unless the method is named, as
#: factors lose no digits
_MOST_FACTORISED_MOTIONS = 2_000
#: bound of the error of a response, over the largest value at its frequency, with which the
#: response counts as found
TOLERANCE = 1e-9
#: root of x.x, in the product without conjugation, over the norm of a vector x, up to which the
#: vector is nearly orthogonal to itself and the space ends
_LEAST_SELF_PRODUCT = 1e-4
#: most steps of a space
_MOST_STEPS = 100_000
#: steps for whose signals and coefficients memory is allocated at first
_FIRST_ROOM = 256
#: longest time of a response whose method is not named, s
_LONGEST_TIME = 3600.0
#: longest time, s, that is spent on factors at frequencies at which a space has not enough digits,
#: unless the space took longer itself
_FACTOR_TIME = 10.0
#: rate at which the error falls once a Krylov space tells single modes apart, over the mean
#: distance of modes
_MODE_PACE = 5.0
#: time of a step if loss factors differ, over that of a step of Lanczos
_LOSSY_TIME = 2.5
#: time of a step if dashpots differ, over that of a step of Lanczos
_FIRST_ORDER_TIME = 4.5
#: number of steps if dashpots differ, over those of Lanczos: of the symmetric process, and of the
#: incomplete process of Arnoldi
_SYMMETRIC_STEPS = 2.0
_INCOMPLETE_STEPS = 3.0
#: greatest omega tau plus drag over omega, at the top frequency, up to which the symmetric process
#: of first order keeps its digits
_STRONGEST_LOSS = 0.45
#: residual, over the source, at which a solution in the space is first computed
_FIRST_TRIAL = 1e-3
#: least residual at which a solution is computed again, over the residual of the last one
_NEXT_TRIAL = 0.02
#: norm of the next vector, over the largest entry of the matrix, up to which the space is complete:
#: it holds all that H makes of the source
_LEAST_LENGTH = 1e-13
#: most solutions by the same factors, each of which corrects the one before
_SOLUTIONS = 4
#: error above which a response has a warning
_WARNED_ERROR = 1e-6
#: last change of a solution by factors, over the solution, above which the solution is not found
_LARGEST_CHANGE = 1e-2
#: residual in a space, over the source, up to which the residual is rounding alone
_ROUNDING = 1e-16
#: greatest last entry of a solution in a space, for a start of size one: the solution has diverged
_LARGEST_ENTRY = 1e100
#: loss factors that are tried to advise the least sufficient one
_ADVISED_LOSSES = (0.01, 0.02, 0.05, 0.1)
#: quantities that are derivatives of the displacement by the time, with the order of the derivative
_DERIVATIVES = {"velocity": 1, "acceleration": 2}


@result_class
class Response(Result, array="values"):
    """Complex amplitudes of receivers in a steady motion exp(i omega t); ``np.asarray`` of it is
    ``values``.

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    values : (n_f, n_r) amplitude of each receiver over that of the source, in the unit of the
        quantity. A phase below zero lags.
    quantity : "displacement" (receptance, m/N), "velocity" (mobility, m/(N s)), "acceleration"
        (accelerance, 1/kg), "force" (1), "transmissibility" (1), or "stiffness" (N/m), the force
        over the displacement of a wall.
    sources : (n_s,) indices of the balls that are pushed, each with the same force, or of the
        bodies that are moved.
    pushes : (n_s, 3) unit vectors along which sources are pushed or moved.
    receivers : (n_r,) indices of the balls that are heard, or of the bodies with sensors; of a
        contact (i, j) the index i.
    directions : (n_r, 3) unit vectors along which receivers are heard; of a contact (i, j) the
        normal from i to j.
    error : (n_f,) error of the values at each frequency, over the largest of them; of forces that
        are all zero the error of the elongations, over the largest elongation.
    factorisations : number of frequencies whose values were found by factors of the matrix.
    steps : number of steps of the Krylov space by which the others were found; 0 without a space.
    warnings : one sentence for the frequencies whose error is above 1e-6, as next to modes without
        losses; and one if contacts are more viscous than stiff, which suggests that the damping,
        a time, was meant in another unit.
    partners : (n_r,) index j of each contact (i, j) that is heard, -1 for sensors in balls and
        walls; None if no force is heard.
    """

    _notebook_fields = ("method",)
    #: function that returns values at other frequencies; empty if the response was read from data,
    #: or if nothing loses energy
    _solver: ClassVar[tuple[Solve, ...]] = ()
    #: function that returns the derivatives; empty if the response was read from data
    _find_slopes: ClassVar[tuple[Callable[[], ResponseSensitivities], ...]] = ()

    frequencies: Array = held(float, "f", "Hz")
    values: Complex = held(complex, "f r")
    quantity: str = held(str)
    sources: Index = held(int, "s")
    pushes: Array = held(float, "s 3")
    receivers: Index = held(int, "r")
    directions: Array = held(float, "r 3")
    error: Array = held(float, "f")
    factorisations: int = held(int)
    steps: int = held(int)
    warnings: tuple[str, ...] = held((str, ...), default=())
    partners: Index | None = held(int, "r?", default=None)

    def _field_units(self) -> dict[str, str]:
        """Return the SI unit of each attribute; that of ``values`` depends on the quantity."""
        return {**self.units, "values": QUANTITIES[self.quantity]}

    @property
    def names(self) -> tuple[str, ...]:
        """(n_r,) name of each receiver, such as "ball 3", also for a wall of the index 3, or
        "contact 3-4".
        """
        partners = np.full(len(self.receivers), -1) if self.partners is None else self.partners
        pairs = zip(self.receivers.tolist(), partners.tolist(), strict=True)
        return tuple(f"ball {i}" if j < 0 else f"contact {i}-{j}" for i, j in pairs)

    @property
    def magnitude(self) -> Array:
        """(n_f, n_r) sizes of the values, in the unit of the quantity."""
        return np.abs(self.values)

    @property
    def phase(self) -> Array:
        """(n_f, n_r) phases of the values, rad, without jumps by 2 pi from one frequency to the
        next; those of the first frequency are between -pi and pi.
        """
        return np.unwrap(np.angle(self.values), axis=0)

    @property
    def coherent(self) -> NDArray[np.complex128]:
        """(n_f,) mean of the values over the receivers, such as the balls of a plane."""
        return np.asarray(np.mean(self.values, axis=1))

    @cached_property
    def sensitivities(self) -> ResponseSensitivities:
        """Derivatives of ``values`` with respect to the stiffnesses and static normal forces of all
        contacts, to the masses and moments of inertia of all balls, and to springs that tie balls
        to the ground, also where there is none.

        When they are first asked for, the matrix is factorised at each frequency, and solved once
        more for each receiver. Raises :class:`~granphon.base.errors.InputError` for a response that
        was read from a file or a copy, for arrays larger than the memory, and at the frequency of a
        mode that loses no energy; :class:`~granphon.base.errors.ConvergenceError` for a network too
        large to be factorised.
        """
        if not self._find_slopes:
            raise InputError(
                "the response has no network",
                "It was read, and nothing says of which contacts it is",
                "Find it again, by gp.Waves(network).response",
            )
        return self._find_slopes[0]()

    @cached_property
    def peaks(self) -> tuple[Peaks, ...]:
        """The peaks of each receiver: their frequencies, heights and Q factors.

        The response is solved anew about each peak, between the frequencies. This is not possible
        for a response that was read from a file or a copy, or in which nothing loses energy: each
        peak is then that of a mode through three values. If a line is narrower than the step of the
        frequencies, its frequency is known to a step, and its height and Q are nan.
        """
        return self.peaks_of_means([[place] for place in range(len(self.receivers))])

    def peaks_of_means(self, groups: Any) -> tuple[Peaks, ...]:
        """Return the :attr:`peaks` of means over receivers, such as the balls of a plane.

        ``groups`` is a list that has for each mean the positions of its receivers among those of
        the response, as a list or a slice; without a mean there are no peaks. Raises
        :class:`~granphon.base.errors.InputError` if ``groups`` is no list, for a group that is
        neither a list nor a slice, for one without a receiver or with a receiver twice, and for
        receivers that are not there.
        """
        if not _is_list(groups):
            mend = "Give a list that has for each mean a list of positions of receivers, or a slice"
            raise InputError(f"groups is {brief(groups)}", mend=mend)
        if not len(groups):
            return ()
        positions_of_groups = [self._find_positions(group) for group in groups]

        def take_means(values: Complex) -> Complex:
            """Return the means (n_f, groups) of values (n_f, n_r)."""
            means = [np.mean(values[:, positions], axis=1) for positions in positions_of_groups]
            return np.stack(means, axis=1)

        def solve(frequencies: Array) -> Complex:
            """Return the means (n_f, groups) at other frequencies (n_f,), Hz."""
            return take_means(self._solver[0](frequencies))

        means = take_means(self.values)
        return find_peaks(self.frequencies, means, solve if self._solver else None)

    def _find_positions(self, group: Any) -> Index:
        """Return the positions (k,) among the receivers of a ``group`` of :meth:`peaks_of_means`,
        which says what is raised.
        """
        count = len(self.receivers)
        positions = group
        if isinstance(group, slice):
            try:
                positions = list(range(count))[group]
            except (TypeError, ValueError):  # ends that are no whole numbers, or a step of zero
                positions = None
        if not _is_list(positions):
            mend = "Give for each mean a list of positions of receivers, or a slice"
            raise InputError(f"groups has {brief(group)}", mend=mend)
        return index_array("groups", positions, count, "receivers")

    @property
    def method(self) -> str:
        """Words that say how many frequencies were solved by factors, and how many by a Krylov
        space.
        """
        n_by_krylov = len(self.frequencies) - self.factorisations
        methods = []
        if self.factorisations:
            frequencies = counted(self.factorisations, "frequency", "frequencies")
            methods.append(f"{frequencies} by factors of the matrix")
        if n_by_krylov:
            frequencies = counted(n_by_krylov, "frequency", "frequencies")
            methods.append(f"{frequencies} by a Krylov space of {counted(self.steps, 'step')}")
        return ", ".join(methods)

    @property
    def labelled(self) -> dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]:
        """The variables of an ``xarray.Dataset``, as its argument: by their names the dimensions,
        numbers and units of magnitude, phase, error and balls.
        """
        unit = QUANTITIES[self.quantity]
        return {
            "frequency": (("frequency",), self.frequencies, {"units": "Hz"}),
            "magnitude": (
                ("frequency", "receiver"),
                self.magnitude,
                {"units": unit, "long_name": self.quantity},
            ),
            "phase": (("frequency", "receiver"), self.phase, {"units": "rad"}),
            "error": (("frequency",), self.error, {"units": "1"}),
            "receiver": (("receiver",), np.arange(len(self.receivers)), {}),
            "ball": (("receiver",), self.receivers, {}),
        }


def _is_list(value: Any) -> bool:
    """Whether a ``value`` is a sequence, such as a list, or an array with axes."""
    return isinstance(value, Sequence) or (isinstance(value, np.ndarray) and value.ndim > 0)


def require_places(
    network: ContactNetwork, name: str, value: Any, quantity: str, **options: Any
) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless a ``network`` has the balls and
    directions of a source or receiver for a response of this ``quantity``.

    ``name`` is "source" or "receiver", ``value`` is that argument of ``Waves.response``, and
    ``options`` are the further arguments of :class:`Places`, whose errors are raised too.
    """
    places = Places(network, **options)
    if name == "source":
        is_moved = places.find_quantity(quantity, value) in OF_MOVED_WALL
        places.find(name, value, wants_held=is_moved)
    elif quantity in OF_FORCE:
        places.find_sensors(value)
    else:
        places.find(name, value)


class ResponseOptions(NamedTuple):
    """Which response is found, and how.

    Attributes
    ----------
    quantity : one of :data:`QUANTITIES`.
    method : one of :data:`METHODS`, or None, see :meth:`ResponseWork.choose`.
    tolerance : bound of the error, over the largest value at a frequency, at which a Krylov space
        ends; above zero and below 1.
    """

    quantity: str
    method: str | None
    tolerance: float

    @classmethod
    def read(cls, quantity: str, method: str | None, tolerance: float) -> ResponseOptions:
        """Return the options of these arguments of ``Waves.response``.

        Raises :class:`~granphon.base.errors.InputError` for other words, and a tolerance that is
        not above zero and below 1.
        """
        quantity = one_of("quantity", quantity, QUANTITIES)
        tolerance = positive("tolerance", tolerance)
        if tolerance >= 1.0:
            raise InputError(
                f"tolerance is {tolerance:g}",
                "With an error as large as the response nothing is known of the response",
                "Give a number below 1",
            )
        if method is not None:
            method = one_of("method", method, METHODS)
        return cls(quantity, method, tolerance)


def find_response(
    find_operator: Callable[[], WaveOperator],
    hertz: Array,
    source: Any,
    receiver: Any,
    options: ResponseOptions,
    losses: Losses,
    places: Places,
) -> Response:
    """Return the response of a network with ``losses`` at the frequencies ``hertz`` (n_f,), Hz,
    ascending.

    ``source`` and ``receiver`` are those of :meth:`granphon.waves.waves.Waves.response`, which also
    says what is raised; ``places`` finds their balls and directions in the network. Then
    ``find_operator`` is called, which returns D after a check that the network is stable.

    The response keeps functions that compute its derivatives and, unless nothing loses energy, its
    values at other frequencies.
    """
    places.require_use(source, receiver)
    options = options._replace(quantity=places.find_quantity(options.quantity, source))
    is_moved = options.quantity in OF_MOVED_WALL
    sources, pushes = places.find("source", source, wants_held=is_moved)
    receivers = _Receivers.of(places, receiver, options.quantity)
    driven = _DrivenNetwork.of(find_operator(), losses, (sources, pushes), is_moved)
    problem = receivers.make_problem(driven)
    require_memory(
        f"responses of {len(receivers.bodies):,} receivers at {hertz.size:,} frequencies",
        _RESPONSE_BYTES * hertz.size * (1.0 + len(problem.heard_motions)),
        "Take fewer frequencies",
    )
    solution = _solve_for_quantity(problem, hertz, options)
    warnings = losses.find_warnings(float(np.max(hertz)))
    if np.any(solution.error > _WARNED_ERROR):
        unit = QUANTITIES[options.quantity]
        warnings = (*warnings, _explain_error(hertz, solution.values, solution.error, unit))
    response = Response(
        frequencies=hertz,
        values=solution.values,
        quantity=options.quantity,
        sources=sources,
        pushes=pushes,
        receivers=receivers.bodies,
        directions=receivers.directions,
        error=solution.error,
        factorisations=solution.factorisations,
        steps=solution.steps,
        warnings=warnings,
        partners=receivers.partners,
    )
    _attach_functions(response, problem, options)
    return response


class _Receivers(NamedTuple):
    """The n_r receivers of a response.

    Attributes
    ----------
    bodies : (n_r,) indices of the balls that are heard, or of the bodies with sensors.
    directions : (n_r, 3) unit vectors along which receivers are heard.
    sensors : the sensors of force; empty if balls are heard.
    """

    bodies: Index
    directions: Array
    sensors: Sequence[Sensor]

    @classmethod
    def of(cls, places: Places, receiver: Any, quantity: str) -> _Receivers:
        """Return the receivers that the argument ``receiver`` of ``Waves.response`` means for a
        response of this ``quantity``; raises what the methods of ``places`` raise.
        """
        if quantity not in OF_FORCE:
            return cls(*places.find("receiver", receiver), sensors=())
        sensors = places.find_sensors(receiver)
        bodies = np.array([sensor.body for sensor in sensors])
        return cls(bodies, np.array([sensor.direction for sensor in sensors]), sensors)

    @property
    def partners(self) -> Index | None:
        """(n_r,) indices of the second bodies of contacts, -1 for other sensors; None if balls are
        heard.
        """
        return np.array([sensor.partner for sensor in self.sensors]) if self.sensors else None

    def make_problem(self, driven: _DrivenNetwork) -> _Problem:
        """Return the equations of the ``driven`` network with these receivers."""
        if self.sensors:
            return _Problem.of_sensors(driven, self.sensors)
        return _Problem.of_balls(driven, self.bodies, self.directions)


def _attach_functions(response: Response, problem: _Problem, options: ResponseOptions) -> None:
    """Give the ``response`` of a ``problem`` with these ``options`` the functions that compute its
    derivatives and, unless nothing loses energy, its values at other frequencies.
    """
    if not problem.losses.is_none:  # without losses a peak has no height

        def solve(frequencies: Array) -> Complex:
            """Return the values (n_f, n_r) at other frequencies (n_f,), Hz."""
            return _solve_for_quantity(problem, frequencies, options).values

        object.__setattr__(response, "_solver", (solve,))

    def find_slopes() -> ResponseSensitivities:
        """Return the derivatives of the response."""
        return problem.find_sensitivities(response.frequencies, options.quantity)

    object.__setattr__(response, "_find_slopes", (find_slopes,))


def _solve_for_quantity(
    problem: _Problem, frequencies: Array, options: ResponseOptions
) -> _Solution:
    """Return the solution of a ``problem`` at ``frequencies`` (n_f,), Hz, with values (n_f, n_r) in
    the quantity of the ``options``.
    """
    omega = 2.0 * math.pi * frequencies
    solution = problem.solve(omega, options.method, options.tolerance)
    if problem.sensors is not None:
        return problem.sensors.read(omega, solution)
    order = _DERIVATIVES.get(options.quantity, 0)
    return solution._replace(values=solution.values * (1j * omega[:, None]) ** order)


def _explain_error(hertz: Array, values: Complex, error: Array, unit: str) -> str:
    """Return the warning that at some of the frequencies ``hertz`` (n_f,), Hz, the ``error``
    (n_f,), over the largest of the ``values`` (n_f, n_r) there, is above :data:`_WARNED_ERROR`;
    ``unit`` is that of the values.
    """
    n_unsure = int(np.count_nonzero(error > _WARNED_ERROR))
    worst = int(np.argmax(error))
    frequencies = (
        f"{counted(n_unsure, 'frequency', 'frequencies')}, up to {error[worst]:.1e} at"
        f" {hertz[worst]:.6g} Hz"
    )
    why = "hardly anything reaches the receivers, or a mode hardly loses energy"
    absolute_errors = error * np.max(np.abs(values), axis=1)
    largest_unknown = np.max(absolute_errors[error >= 1.0], initial=0.0)
    if largest_unknown > 0.0:
        bound = write_quantity(float(largest_unknown), unit, 2)
        why += f"; where the error is above 1, values are only known to be below {bound}"
    return f"the error of the response is above {_WARNED_ERROR:g} at {frequencies}: {why}."


# -- sources and receivers -------------------------------------------------------------------------


def _list_items(value: Any) -> list[Any]:
    """Return the items of a source or receiver as a list; ``value`` is one item or a list."""
    return value if isinstance(value, list) else [value]


class Places:
    """Finds the balls of a network that are sources and receivers, and the directions in which they
    are pushed and heard.

    ``direction``, ``polarisation`` and ``distance``, m, of planes are arguments of
    ``Waves.response``, None where they are not given. The constructor raises
    :class:`~granphon.base.errors.InputError` for what is no direction, and for a distance that is
    not above zero; a polarisation is read where a plane has it.

    Attributes
    ----------
    network : the network.
    along : (3,) unit vector across the planes.
    polarisation : word or vector of the motion of planes.
    distance : distance of the receiving plane, m, or None.
    """

    def __init__(
        self, network: ContactNetwork, direction: Any, polarisation: Any, distance: float | None
    ) -> None:
        self.network = network
        self._given = {
            "direction": direction,
            "polarisation": polarisation,
            "distance": distance,
        }
        if direction is None:
            direction = find_open_axis(network)
        self.along = read_vector("direction", direction, network.dimension)
        self.polarisation = DEFAULT_POLARISATION if polarisation is None else polarisation
        self.distance = None if distance is None else positive("distance", distance, "m")
        self._sensor_places = SensorPlaces.of(network)

    def require_use(self, source: Any, receiver: Any) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for an argument of planes that is given
        and has no use for a response between ``source`` and ``receiver``.
        """
        name = find_unused(_list_items(source), _list_items(receiver), self._given)
        if not name:
            return
        of_which = "the receiver" if name == "distance" else "neither source nor receiver"
        verb = "is no plane" if name == "distance" else "is a plane"
        raise InputError(
            f"{name} is given, and {of_which} {verb}",
            f"The {name} is that of a plane of balls",
            f"Leave {name} out, or give 'plane'; of a ball give (ball, direction)",
        )

    def find_quantity(self, quantity: str, source: Any) -> str:
        """Return the quantity of a response: the given ``quantity``, or "stiffness" in place of
        "force" if all bodies of the ``source`` are held, as these are moved and not pushed.

        Raises what :meth:`_read_item` raises for the source of a force.
        """
        if quantity != "force":
            return quantity
        moving = self.network.moving
        items = [self._read_item("source", item) for item in _list_items(source)]
        is_held = bool(items) and not any(np.any(moving[balls]) for balls, _ in items)
        return "stiffness" if is_held else "force"

    def find_sensors(self, value: Any) -> list[Sensor]:
        """Return the sensors of force of a receiver or a list of receivers, ``value``: a contact
        (i, j), the floor, a plane, or balls and bodies with a direction.

        Raises :class:`~granphon.base.errors.InputError` if there is no receiver, for two balls that
        do not touch or touch more than once, for a body without a contact along its direction, and
        if no motion of balls changes the forces; and what :meth:`_read_item` raises.
        """
        sensors = list[Sensor]()
        for item in _list_items(value):
            if is_contact(item):
                sensors.append(self._sensor_places.at_contact(*item))
                continue
            bodies, direction = self._read_item("receiver", item)
            sensors += [self._sensor_places.in_body(body, direction) for body in bodies.tolist()]
        if not sensors:
            raise InputError(
                "there is no receiver", mend="Give a contact (i, j), (ball, direction) or 'floor'"
            )
        axes = list(self.network.ball_motions.translations)
        normals = self.network.normal[np.concatenate([sensor.contacts for sensor in sensors])]
        if not np.any(normals[:, axes]):
            raise InputError(
                "no motion of the balls changes the force of these contacts",
                "Balls move across them only",
            )
        return sensors

    def find(self, name: str, value: Any, wants_held: bool = False) -> tuple[Index, Array]:
        """Return the balls (n,) and the unit vectors (n, 3) of a source or receiver.

        ``value`` is the argument of ``Waves.response`` with this ``name``, one item or a list. With
        ``wants_held`` all of its bodies must be held, and else all must move. Raises
        :class:`~granphon.base.errors.InputError` if there is no ball, and for directions in which
        balls do not move; and what :meth:`_read_item` and :meth:`_require_mobility` raise.
        """
        items = _list_items(value)
        balls = [np.zeros(0, int)]
        vectors = [np.zeros((0, 3))]
        for item in items:
            item_balls, vector = self._read_item(name, item, wants_held=wants_held)
            require_moves(name, vector, self.network)
            balls.append(item_balls)
            vectors.append(np.tile(vector, (len(item_balls), 1)))
        all_balls = np.concatenate(balls)
        if not all_balls.size:
            raise InputError(
                f"there is no {name}", mend="Give (ball, direction), or a list of these"
            )
        self._require_mobility(name, all_balls, wants_held)
        return all_balls, np.concatenate(vectors)

    def _read_item(self, name: str, item: Any, *, wants_held: bool = False) -> tuple[Index, Array]:
        """Return the balls (n,) and the unit vector (3,) of one ``item`` of a source or receiver,
        the argument ``name``: "plane", "floor", or (ball, direction); ``wants_held`` says that a
        plane is one of held bodies.

        Raises :class:`~granphon.base.errors.InputError` for any other item, for balls that are not
        there, a wrong direction, no floor or several, and a polarisation in which the balls of a
        plane do not move; and what :meth:`_find_plane` raises.
        """
        if is_plane(item):
            balls = self._find_plane(name, wants_held)
            return balls, read_push(self.network, self.along, self.polarisation)
        if isinstance(item, str) and item == FLOOR:
            floor = self._sensor_places.find_floor()
            return np.array([floor]), -self._sensor_places.walls[floor]  # towards the balls
        if is_contact(item):
            raise InputError(
                f"the {name} is the contact {brief(item)}",
                "A contact has a force alone",
                'Give a receiver of quantity="force", or a direction that is no whole number',
            )
        if isinstance(item, tuple) and len(item) == 2:
            numbers, direction = item
            balls = index_array(name, numbers, self.network.n_balls)
            return balls, self._read_direction(direction)
        mend = "Give (ball, direction), (balls, direction), 'plane', 'floor', or a list of these"
        raise InputError(f"the {name} is {brief(item)}", mend=mend)

    def _require_mobility(self, name: str, balls: Index, wants_held: bool) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless all ``balls`` (n,) of the argument
        ``name`` move; or, with ``wants_held``, unless all are held and one of them touches a ball
        that moves.
        """
        network = self.network
        unfit_balls = balls[network.moving[balls] == wants_held]
        if unfit_balls.size and wants_held:
            raise InputError(
                f"ball {unfit_balls[0]} of the {name} moves",
                "A wall or floor is moved here, and no ball",
                "Give a body of infinite mass",
            )
        if unfit_balls.size:
            raise InputError(
                f"ball {unfit_balls[0]} of the {name} does not move",
                "It is held: its mass is infinite",
                "Ask for the transmissibility, to move it" if name == "source" else "",
            )
        is_i_touching = np.isin(network.i, balls) & network.moving[network.j]
        is_j_touching = np.isin(network.j, balls) & network.moving[network.i]
        if wants_held and not np.any(is_i_touching | is_j_touching):
            fault = f"the {name} touches no ball that moves"
            mend = "Give those balls of the wall that touch others"
            raise InputError(fault, "Nothing moves when it does", mend)

    def _read_direction(self, value: Any) -> Array:
        """Return the unit vector (3,) of a direction, ``value``: the name x, y or z of an axis, or
        a vector (1,) to (3,).

        Raises :class:`~granphon.base.errors.InputError` for any other value.
        """
        if isinstance(value, str):
            if value not in ("x", "y", "z"):
                raise InputError(f"a direction is {brief(value)}", mend="Use x, y, z, or a vector")
            axis = "xyz".index(value)
            return np.asarray(np.eye(3)[axis])
        return read_vector("direction", value, self.network.dimension)

    def _find_plane(self, name: str, wants_held: bool) -> Index:
        """Return the indices (n,) of the balls of a plane across :attr:`along`; with ``wants_held``
        those of the first plane of held bodies (:meth:`_find_held_plane`), whatever the ``name``.

        Of the balls that move, a source (``name`` "source") has the first plane. A receiver has the
        one nearest to :attr:`distance` behind the first, less whole periods of a network that
        repeats; or, if the distance is None, the last plane.

        Raises :class:`~granphon.base.errors.InputError` for a receiver without a distance in a
        network that repeats along this direction, and if there is no such plane or body; and what
        :meth:`Course.along` raises.
        """
        course = Course.along(self.network, self.along)
        if wants_held:
            return self._find_held_plane(course)
        places = course.places[self.network.moving]
        first_place = float(np.min(places))
        if name == "source":
            return course.find_plane(first_place, name)
        if self.distance is not None:
            first_plane = course.find_plane(first_place, name)
            receiver_place = course.find_place(first_plane) + self.distance
            return course.find_plane(receiver_place, name)
        if math.isfinite(course.period):
            fault = (
                "the receiving plane has no distance, and the network repeats along the direction"
            )
            raise InputError(fault, mend="Give the distance, m, from the first plane")
        return course.find_plane(float(np.max(places)), name)

    def _find_held_plane(self, course: Course) -> Index:
        """Return the held bodies (n,) that lie along the ``course`` up to half a diameter behind
        the first one. Flat walls along the course are left out, as they have no place on it, and
        those that nothing touches.

        Raises :class:`~granphon.base.errors.InputError` if no other body is held.
        """
        network = self.network
        walls_across = [
            wall
            for wall, (_, normal) in network.walls.items()
            if abs(normal @ course.direction) > LEAST_COSINE
        ]
        held_balls = np.flatnonzero(~network.moving & np.isfinite(network.radii))
        held_bodies = np.append(held_balls, np.array(walls_across, np.intp))
        if not held_bodies.size:
            raise InputError(
                "no body of this network is held, and has a place along the direction",
                mend="Cut it with clamped edges or a floor",
            )
        heights = course.heights[held_bodies]
        is_first = heights <= np.min(heights) + 0.5 * course.spacing
        return np.asarray(held_bodies[is_first])


# -- solutions -------------------------------------------------------------------------------------


class _Solution(NamedTuple):
    """A solution at all frequencies.

    Attributes
    ----------
    values : (n_f, n_r) signals of receivers.
    error : (n_f,) error of the signals over the largest one at each frequency.
    factorisations : number of frequencies that were solved by factors.
    steps : number of steps of the Krylov space that solved the others.
    """

    values: Complex
    error: Array
    factorisations: int
    steps: int


class _Space(NamedTuple):
    """A Krylov space in which (H - shift) x = start is solved for the shifts of all frequencies.

    Attributes
    ----------
    apply : function that multiplies a vector by H.
    product : scalar product in which the vectors of the space become orthogonal.
    start : first vector of the space.
    shifts : (n_f,) shift at each frequency.
    scale : (n_f,) factor of x in the signals of receivers.
    bound : (n_f,) bound of the norm of (H - shift)^-1: the error of scale x is at most scale times
        this bound times the residual.
    direct_signals : (n_f, n_r) signals that receivers have directly from the source, beside
        scale x.
    """

    apply: Callable[[NDArray[Any]], NDArray[Any]]
    product: Callable[[NDArray[Any], NDArray[Any]], Any]
    start: NDArray[Any]
    shifts: NDArray[Any]
    scale: NDArray[Any]
    bound: Array
    direct_signals: NDArray[Any]


@dataclass(frozen=True, eq=False)
class ResponseWork:
    """The work for the response of a network, by factors and by a Krylov space.

    Attributes
    ----------
    operator, losses : D of the network, and the losses of the network.
    omega : (n_f,) angular frequencies, rad/s.
    tolerance : bound of the error at which a Krylov space ends.
    """

    operator: WaveOperator
    losses: Losses
    omega: Array
    tolerance: float = TOLERANCE

    @cached_property
    def even_losses(self) -> tuple[float, float, float] | None:
        """The loss factor eta, the time tau, s, and the drag gamma, 1/s, of all contacts and
        motions; None if one of them differs between contacts or motions, or if contacts lose energy
        beside static forces or springs to the ground, which lose none.
        """
        return self.losses.find_even()

    @cached_property
    def row_losses(self) -> Array:
        """(2, rows) loss factors eta, and times tau, s, of all deformations that resist motions:
        those of contacts; and those of springs to the ground and of static forces that pull, whose
        losses are zero.
        """
        factors = self.operator.row_weights(self.losses.factors)
        times = self.operator.row_weights(self.losses.times)
        has_stiffness = self.operator.row_weights() > 0.0
        return np.stack([factors, times])[:, has_stiffness]

    @cached_property
    def least_losses(self) -> Array:
        """(n_f,) the least eta + omega tau of all :attr:`row_losses` at each frequency."""
        factors, times = self.row_losses
        return np.array([np.min(factors + omega * times) for omega in self.omega.tolist()])

    @cached_property
    def drags(self) -> Array:
        """(motions,) drag gamma of each motion of a ball, over the top frequency."""
        return self.losses.drag_of(self.operator.motions) / self.operator.top

    @cached_property
    def distance(self) -> Array:
        """(n_f,) lower bound of the distance of omega^2 - i omega gamma from all d (1 + i g') with
        0 <= d <= top^2 and g' >= g, over top^2, where g is :attr:`least_losses` and gamma the least
        drag. At frequencies where this bound is not above zero, nothing bounds the error.
        """
        w = self.omega / self.operator.top
        depth = w**2 * self.least_losses + w * np.min(self.drags)
        from_line = depth / np.hypot(1.0, self.least_losses)  # from all d (1 + i g), d >= 0
        from_top = w**2 - 1.0
        return np.asarray(np.maximum(from_line, from_top))

    @property
    def is_strong(self) -> bool:
        """Whether the equations are of first order, and their losses too strong for the symmetric
        process.
        """
        strongest_dashpot = float(np.max(self.row_losses[1])) * self.operator.top
        strongest = strongest_dashpot + float(np.max(self.drags))
        return self.is_first_order and strongest > _STRONGEST_LOSS

    @cached_property
    def why_no_space(self) -> str:
        """The reason why no Krylov space solves all frequencies; empty if one does."""
        if self.even_losses is not None:
            return ""
        if self.operator.whole is not None:
            return (
                "Static tangential forces or torques, or levers of slip that exceed arms, have no"
                " potential"
            )
        is_lossless = np.sum(self.row_losses, axis=0) == 0.0
        has_lossless_motions = bool(np.any(is_lossless)) and not np.all(self.drags > 0.0)
        return "Some motions lose energy, and others lose none" if has_lossless_motions else ""

    @property
    def is_first_order(self) -> bool:
        """Whether there are dashpots or drag, and losses are not even (:attr:`even_losses`): the
        equations are then of first order, and the space is one of velocities and deformations.
        """
        return self.even_losses is None and bool(np.any(self.losses.times) or np.any(self.drags))

    @cached_property
    def step_time(self) -> float:
        """Expected time of a step of the Krylov space, s: that of a step of Lanczos, times a factor
        if losses differ between contacts or motions.
        """
        if self.is_first_order:
            time_over_lanczos = _FIRST_ORDER_TIME
        elif self.even_losses is None:
            time_over_lanczos = _LOSSY_TIME
        else:
            time_over_lanczos = 1.0
        product_time = float(self.operator.product_time[self.operator.network.dimension])
        return time_over_lanczos * self.operator.size * product_time

    @cached_property
    def factor_time(self) -> float:
        """Expected time of factors at one frequency, s; infinite if the network is too large."""
        seconds, _ = self.operator.estimate_factors()
        return seconds

    @property
    def factor_bytes(self) -> float:
        """Memory of factors while they are made, bytes; infinite if the network is too large."""
        _, memory = self.operator.estimate_factors()
        return memory

    @cached_property
    def steps(self) -> Array:
        """(n_f,) expected number of steps of the Krylov space for each frequency; infinite if
        nothing bounds it.

        With w = omega/top, the least g = eta + omega tau and the least drag gamma over top, a step
        of Lanczos makes the error smaller by exp(-2 Im arccos(((w^2 - i w gamma)/(1 + i g))^1/2)),
        as Chebyshev's polynomials do. If modes are few, the space tells the modes apart sooner,
        and the error falls faster; not so in the incomplete process of Arnoldi, which is taken
        where losses are strong.
        """
        w = self.omega / self.operator.top
        n = self.operator.size
        d = self.operator.network.dimension
        square = (w**2 - 1j * w * np.min(self.drags)) / (1.0 + 1j * self.least_losses)
        pace = 2.0 * np.abs(np.arccos(np.sqrt(square)).imag)
        is_bounded = (self.distance > 0.0) & (pace > 0.0)
        if not self.is_strong:
            # number of modes for a unit of w, by Debye's law, and not fewer than n^(1/d)
            mode_density = np.maximum(n ** (1.0 / d), n * d * w ** (d - 1))
            pace += 2.0 * _MODE_PACE / mode_density
        counts = np.full(w.shape, np.inf)
        # factors by which the residual is to fall. The error is at most the residual over the
        # distance; it counts over the largest value, which is taken to be one in these units, or
        # one over the distance where that is less
        reductions = np.maximum(1.0 / self.distance[is_bounded], 1.0) / self.tolerance
        counts[is_bounded] = np.log(reductions) / pace[is_bounded]
        if self.is_strong:
            return counts * _INCOMPLETE_STEPS
        return counts * _SYMMETRIC_STEPS if self.is_first_order else counts

    def choose(self, method: str | None) -> tuple[NDArray[np.bool_], float]:
        """Return whether the matrix is factorised at each frequency, (n_f,), and the expected time
        for all frequencies, s. One Krylov space solves all frequencies without factors at once.

        The matrix is factorised at all frequencies in three cases: the ``method`` is "direct"; no
        space serves; or the method is None and the network is small. With the method "krylov" it is
        factorised at none, and with None where that takes less time.

        Raises :class:`~granphon.base.errors.InputError` for the method "krylov" if no space serves.
        Raises :class:`~granphon.base.errors.ConvergenceError` if the network is too large for
        factors that are needed, if the space would take too many steps, and, with the method None,
        if the time is above an hour.
        """
        if self.why_no_space and method == "krylov":
            raise InputError(
                "no Krylov space serves all frequencies", self.why_no_space, "Use the direct method"
            )
        is_small = method is None and self.operator.size <= _MOST_FACTORISED_MOTIONS
        if method == "direct" or self.why_no_space or is_small:
            if not math.isfinite(self.factor_time):
                raise self._explain_no_factors()
            is_factorised = np.ones(self.omega.size, bool)
            seconds = self.factor_time * self.omega.size
        else:
            is_factorised, seconds = self._divide_frequencies(may_factorise=method is None)
            most_steps = float(np.max(self.steps, where=~is_factorised, initial=0.0))
            if most_steps > _MOST_STEPS:
                raise self.explain(
                    f"is not found by a Krylov space of {_MOST_STEPS:,} steps", most_steps
                )
        if method is None and seconds > _LONGEST_TIME:
            raise self.explain(
                "takes longer than an hour",
                float(np.max(self.steps)),
                alternative="name the method, to wait for it",
            )
        return is_factorised, seconds

    def _divide_frequencies(self, may_factorise: bool) -> tuple[NDArray[np.bool_], float]:
        """Return whether the matrix is factorised at each frequency, (n_f,), and the expected time
        for all frequencies, s.

        The frequencies that take most steps of a Krylov space are left to factors, as many as make
        the time the least; none are left to factors unless ``may_factorise``.
        """
        count = self.omega.size
        slowest_first = np.argsort(-self.steps, kind="stable")
        # (n_f + 1,) times with factors at none, one, two, ... of the slowest frequencies
        times = self.step_time * np.append(self.steps[slowest_first], 0.0)
        n_factors = 0
        if may_factorise and math.isfinite(self.factor_time):
            times = times + np.arange(count + 1) * self.factor_time
            n_factors = int(np.argmin(times))
        is_factorised = np.ones(count, bool)
        is_factorised[slowest_first[n_factors:]] = False
        return is_factorised, float(times[n_factors])

    def explain(
        self, failure: str, steps: float = math.inf, alternative: str = ""
    ) -> ConvergenceError:
        """Return the error of a response that is not found; the message has the time that each
        method would take, and a loss factor that would be enough.

        ``failure`` is the end of a sentence that begins with "the response", such as "takes longer
        than an hour"; ``steps`` is the number of steps of the Krylov space, infinite if the space
        does not serve; ``alternative`` is what may be done in place of more damping, if anything.
        """
        lowest = write_quantity(float(self.omega[0]) / (2.0 * math.pi), "Hz", 4)
        fault = f"the response of {self.operator.size:,} motions from {lowest} on {failure}"
        methods = self._list_methods(steps)
        if methods:
            fault += f": {', and '.join(methods)}"
        why = (
            "Modes of a large network lie close together, and with little damping the response is"
            " that of each by itself"
        )
        if not np.all(self.distance > 0.0):
            why = "Where nothing loses energy, nothing bounds the error of a Krylov space"
        mend = self._suggest_damping()
        if alternative:
            mend += f"; or {alternative}"
        return ConvergenceError(fault, self.why_no_space or why, mend)

    def _explain_no_factors(self) -> ConvergenceError:
        """Return the error of a network that is too large for the factors that are needed."""
        fault = f"the response of {self.operator.size:,} motions is not found by factors"
        why = "The network is too large to be factorised"
        if self.why_no_space:
            return ConvergenceError(
                fault,
                f"{why}. {self.why_no_space}",
                "Damp all contacts alike, if neither static forces nor springs to the ground act,"
                " or take fewer balls",
            )
        return ConvergenceError(fault, why, "Leave the method out, or take fewer balls")

    def _list_methods(self, steps: float) -> list[str]:
        """Return words for each possible method that say how long it takes; ``steps`` is the number
        of steps of the Krylov space, infinite if no space serves.
        """
        from granphon.media.cost import write_duration

        methods = []
        if math.isfinite(steps):
            duration = write_duration(steps * self.step_time)
            methods.append(f"a Krylov space takes {duration} by estimate")
        if math.isfinite(self.factor_time):
            count = self.omega.size
            duration = write_duration(self.factor_time * count)
            frequencies = counted(count, "frequency", "frequencies")
            methods.append(f"factors at {frequencies} take {duration} by estimate")
        return methods

    def _suggest_damping(self) -> str:
        """Return words that say how to mend a response that takes too much: by the least of
        :data:`_ADVISED_LOSSES` with which a Krylov space solves all frequencies within an hour, or
        else by fewer frequencies or balls.
        """
        from granphon.media.cost import write_duration

        for eta in _ADVISED_LOSSES:
            losses = Losses.of(self.operator.network, GivenLosses(loss_factor=eta))
            damped_work = replace(self, losses=losses)
            if damped_work.even_losses is None:
                continue
            steps = float(np.max(damped_work.steps))
            seconds = steps * damped_work.step_time
            if steps <= _MOST_STEPS and seconds <= _LONGEST_TIME:
                return (
                    f"Damp all contacts alike and more: a loss_factor of {eta:g} takes"
                    f" {write_duration(seconds)} by estimate"
                )
        return "Leave out the lowest frequencies, or take a smaller network"


class _DrivenNetwork(NamedTuple):
    """A network with its source.

    Attributes
    ----------
    operator, losses : D of the network, and the losses of the network.
    drives : three parts (size,) of the source, N/kg^1/2: the part without losses, that by loss
        factors, and that by dashpots over omega, which is in N s/kg^1/2. The source is the sum of
        the parts with the factors 1, i and i omega.
    is_moved : whether the source is a wall that is moved.
    amplitude : (n, motions) forces on balls, N, or displacements of walls, m.
    """

    operator: WaveOperator
    losses: Losses
    drives: Sequence[Array]
    is_moved: bool
    amplitude: Array

    @classmethod
    def of(
        cls,
        operator: WaveOperator,
        losses: Losses,
        source: tuple[Index, Array],
        is_moved: bool,
    ) -> _DrivenNetwork:
        """Return the network of the ``operator`` with a ``source``: bodies (k,) and the unit
        vectors (k, 3) along which these are pushed with 1 N, or if ``is_moved`` displaced by 1 m.
        """
        network = operator.network
        sources, pushes = source
        axes = list(operator.motions.translations)
        amplitude = np.zeros((network.n_balls, operator.motions.count))
        np.add.at(amplitude[:, : len(axes)], sources, pushes[:, axes])
        if is_moved:
            weights = (None, losses.factors, losses.times)
            drives = [operator.pull(amplitude, weight) for weight in weights]
        else:
            root_masses = np.sqrt(network.masses[operator.balls])[:, None]
            push = operator.vector(amplitude[operator.balls] / root_masses)
            drives = [push, np.zeros(operator.size), np.zeros(operator.size)]
        return cls(operator, losses, drives, is_moved, amplitude)


@dataclass(frozen=True, eq=False)
class _SensorReadings:
    """The readings of sensors of force, from the elongations of contacts.

    Attributes
    ----------
    contacts : (n_h,) indices of the contacts that are heard.
    weights : (n_r, n_h) weight of the force of each of these contacts in each sensor.
    stiffness : (n_h,) normal stiffness of these contacts, N/m.
    factors, times : (n_h,) loss factors, and times of all dashpots, s, of these contacts.
    """

    contacts: Index
    weights: Array
    stiffness: Array
    factors: Array
    times: Array

    def find_factors(self, omega: Any) -> NDArray[Any]:
        """Return the stiffnesses (n_f, n_h) of the contacts at ``omega`` (n_f,), rad/s, over the
        stiffnesses without losses; (n_h,) if ``omega`` is a number. The ratios are complex if a
        contact loses energy at one of these frequencies, and else real.
        """
        losses = self.factors + np.asarray(omega)[..., None] * self.times
        return np.asarray(1.0 + 1j * losses if np.any(losses) else np.ones_like(losses))

    def read(self, omega: Array, solution: _Solution) -> _Solution:
        """Return the solution with forces (n_f, n_r), N, of sensors, above zero where contacts are
        pressed more, and with the error of these forces. The given ``solution`` has elongations
        (n_f, n_h), m, at ``omega`` (n_f,), rad/s.
        """
        stiffness = self.find_factors(omega) * self.stiffness
        forces: Complex = -(solution.values * stiffness) @ self.weights.T.astype(complex)
        # the error is given over the largest elongation: each contact of a sensor may have as much
        largest_elongation = np.max(np.abs(solution.values), axis=1)
        force_error = largest_elongation * np.max(np.abs(stiffness) @ self.weights.T, axis=1)
        loudest = np.max(np.abs(forces), axis=1)
        # forces that are all zero leave nothing to divide by, and keep the error of the elongations
        growth = np.divide(force_error, loudest, out=np.ones_like(loudest), where=loudest > 0.0)
        return solution._replace(values=forces, error=solution.error * growth)

    def find_weights(self, w: float) -> NDArray[Any]:
        """Return the weights (n_h, n_r), N/m, of elongations in the forces of sensors at the
        angular frequency ``w``, rad/s; they are real if nothing loses energy.
        """
        stiffness = self.find_factors(w) * self.stiffness
        return np.asarray(-stiffness[:, None] * self.weights.T)

    def find_stiffness_slopes(self, w: float, elongations: NDArray[Any]) -> NDArray[Any]:
        """Return the derivatives (n_r, n_h), m, of the forces of sensors with respect to the
        stiffness of each contact without losses, at given ``elongations`` (n_h,), m, and the
        angular frequency ``w``, rad/s.
        """
        return np.asarray(-(self.find_factors(w) * elongations) * self.weights)


@dataclass(frozen=True, eq=False)
class _Problem:
    """The equations Z x = source, and the signals of receivers.

    If receivers are sensors of force, the n_r receivers of this problem are the contacts that the
    sensors hear, and signals are the elongations of these contacts.

    Attributes
    ----------
    driven : the network and its source.
    heard_motions, motion_weights : (n_r, axes) indices of motions in x, and their weights: the
        signal of a receiver is the sum of these motions times their weights, plus its ``shift``.
    shift : (n_r,) signals that walls which are moved make directly, by stretching contacts.
    sensors : readings of sensors of force; None if receivers are balls.
    """

    driven: _DrivenNetwork
    heard_motions: Index
    motion_weights: Array
    shift: Array
    sensors: _SensorReadings | None = None

    @classmethod
    def of_balls(cls, driven: _DrivenNetwork, receivers: Index, directions: Array) -> _Problem:
        """Return the problem whose ``receivers`` (n_r,) are balls, heard along unit vectors,
        ``directions`` (n_r, 3).
        """
        operator = driven.operator
        axes = list(operator.motions.translations)
        heard_motions = operator.indices[receivers, : len(axes)]
        motion_weights = directions[:, axes] / np.sqrt(operator.network.masses[receivers])[:, None]
        return cls(driven, heard_motions, motion_weights, np.zeros(len(receivers)))

    @classmethod
    def of_sensors(cls, driven: _DrivenNetwork, sensors: Sequence[Sensor]) -> _Problem:
        """Return the problem of ``sensors`` of force, in which receivers are the contacts that they
        hear, each once.
        """
        operator = driven.operator
        network = operator.network
        axes = list(operator.motions.translations)
        contacts_of_sensors = np.concatenate([sensor.contacts for sensor in sensors])
        contacts, columns = np.unique(contacts_of_sensors, return_inverse=True)
        weights = np.zeros((len(sensors), contacts.size))
        rows = np.repeat(np.arange(len(sensors)), [sensor.contacts.size for sensor in sensors])
        weights[rows, columns] = np.concatenate([sensor.weights for sensor in sensors])
        readings = _SensorReadings(
            contacts=contacts,
            weights=weights,
            stiffness=network.normal_stiffness[contacts],
            factors=driven.losses.factors[0, contacts],
            times=driven.losses.times[0, contacts],
        )
        i = network.i[contacts]
        j = network.j[contacts]
        normal = network.normal[contacts][:, axes]
        root_mass_i = np.sqrt(network.masses[i])[:, None]
        root_mass_j = np.sqrt(network.masses[j])[:, None]
        shift = np.zeros(contacts.size)
        if driven.is_moved:
            displacement = driven.amplitude[:, : len(axes)]
            shift = np.sum(normal * (displacement[j] - displacement[i]), axis=1)
        indices = operator.indices[:, : len(axes)]
        return cls(
            driven,
            heard_motions=np.hstack([indices[i], indices[j]]),
            motion_weights=np.hstack([-normal / root_mass_i, normal / root_mass_j]),
            shift=shift,
            sensors=readings,
        )

    @property
    def operator(self) -> WaveOperator:
        """D of the network."""
        return self.driven.operator

    @property
    def losses(self) -> Losses:
        """The losses of the network."""
        return self.driven.losses

    @property
    def n_receivers(self) -> int:
        """Number of receivers of the response: sensors, or balls."""
        return len(self.heard_motions) if self.sensors is None else len(self.sensors.weights)

    @single_products()
    def solve(self, omega: Array, method: str | None, tolerance: float) -> _Solution:
        """Return the signals of the receivers at ``omega`` (n_f,), rad/s, by the ``method``, to the
        ``tolerance``.

        Without a method :meth:`ResponseWork.choose` decides how each frequency is solved. Then, in
        a second pass, factors solve the frequencies that a Krylov space has not found, and, if this
        takes little time, those that it has found with too large an error.

        Raises what :meth:`ResponseWork.choose` raises;
        :class:`~granphon.base.errors.InputError` for the frequency of a mode without losses; and
        :class:`~granphon.base.errors.ConvergenceError` if a Krylov space does not find the values
        of all its frequencies, and either it was named, or the network is too large for factors.
        """
        work = ResponseWork(self.operator, self.losses, omega, tolerance)
        is_factorised, _ = work.choose(method)
        values = np.zeros((omega.size, len(self.heard_motions)), complex)
        error = np.full(omega.size, np.inf)  # infinite where no value is found yet
        steps = 0
        krylov_rows = np.flatnonzero(~is_factorised)
        has_factors = math.isfinite(work.factor_time)
        may_factorise = method is None and has_factors
        if krylov_rows.size:
            krylov_work = replace(work, omega=omega[krylov_rows])
            values[krylov_rows], error[krylov_rows], steps = self._solve_in_space(
                krylov_work, may_factorise
            )
        # a response deep in a gap is less than the rounding of a Krylov space; factors keep all of
        # its digits
        is_imprecise = np.isfinite(error) & (error > max(_WARNED_ERROR, tolerance))
        affordable_time = max(steps * work.step_time, _FACTOR_TIME)
        if may_factorise and np.count_nonzero(is_imprecise) * work.factor_time <= affordable_time:
            error[is_imprecise] = np.inf
        unsolved_rows = np.flatnonzero(np.isinf(error))
        if unsolved_rows.size:
            unsolved_omega = omega[unsolved_rows]
            if method == "krylov" or not has_factors:
                unsolved_work = replace(work, omega=unsolved_omega)
                raise unsolved_work.explain("is not found by a Krylov space")
            values[unsolved_rows], error[unsolved_rows] = self._solve_by_factors(unsolved_omega)
        if unsolved_rows.size == omega.size:
            steps = 0  # no value comes from the space
        return _Solution(values, error, int(unsolved_rows.size), steps)

    def _make_space(self, work: ResponseWork) -> _Space:
        """Return the Krylov space in which all frequencies of the ``work`` are solved; the head of
        this module says which one.
        """
        if work.is_first_order:
            return self._make_first_order(work)
        if work.even_losses is not None:
            return self._make_even(work.omega, *work.even_losses)
        omega = work.omega
        return _Space(
            apply=self.operator.make_lossy_product(self.losses.factors),
            product=np.dot,
            start=self.driven.drives[0] + 1j * self.driven.drives[1],
            shifts=omega**2,
            scale=np.ones(omega.size),
            bound=_invert(self.operator.top**2 * work.distance),
            direct_signals=self._list_shift(omega.size),
        )

    def _make_even(self, omega: Array, loss: float, time: float, drag: float) -> _Space:
        """Return the space of D, for contacts that all have the same ``loss`` factor and the same
        ``time`` of their dashpots, s, and motions that all have the same ``drag``, 1/s, at
        ``omega`` (n_f,), rad/s.
        """
        top_square = self.operator.top**2
        stiffness_factor = 1.0 + 1j * (loss + omega * time)  # over the stiffness without losses
        shifts = (omega**2 - 1j * omega * drag) / stiffness_factor
        # distance of each shift from the eigenvalues of D, which lie between 0 and top^2
        along_axis = np.maximum(np.maximum(shifts.real - top_square, -shifts.real), 0.0)
        distance = np.hypot(shifts.imag, along_axis)
        # a wall pulls with the same factor as the springs
        scale = np.ones(omega.size, complex) if self.driven.is_moved else 1.0 / stiffness_factor
        return _Space(
            apply=lambda x: self.operator @ x,
            product=np.dot,
            start=self.driven.drives[0],
            shifts=shifts,
            scale=scale,
            bound=_invert(distance),
            direct_signals=self._list_shift(omega.size),
        )

    def _make_first_order(self, work: ResponseWork) -> _Space:
        """Return the space of velocities and deformations for the frequencies of the ``work``; H is
        that of the head of this module over the top frequency, with static forces as further rows
        of A.
        """
        top = self.operator.top
        weigh = self.operator.parts.weigh
        omega = work.omega
        w = omega / top
        times = weigh(self.losses.times)  # (rows,) s
        spring = np.sqrt(-weigh() - 1j * weigh(self.losses.factors)) / top
        apply = self._make_first_order_product(spring, times)
        source = self._make_first_order_source(spring, times)
        # from velocities, which the equations of first order give, to motions; the source of a wall
        # is taken without its factor i omega, and so gives motions already
        to_motions = np.ones(w.size, complex) if self.driven.is_moved else _invert(1j * omega)
        scale = -to_motions / top
        # |(H - i w)^-1| is at most this, with the largest |1 + i eta|^1/2 of a spring
        largest_spring = math.sqrt(math.hypot(1.0, float(np.max(work.row_losses[0]))))
        bound = np.where(w > 0.0, (w + largest_spring) * _invert(work.distance), np.inf)
        if work.is_strong:
            return _Space(
                apply=apply,
                product=np.vdot,
                start=source,
                shifts=1j * w,
                scale=scale,
                bound=bound,
                direct_signals=self._list_shift(w.size),
            )
        # the space begins with 1 - i H times the source, from which x follows as the head says
        scale = scale / (1.0 + w)
        return _Space(
            apply=apply,
            product=np.dot,
            start=source - 1j * apply(source),
            shifts=1j * w,
            scale=scale,
            bound=bound,
            direct_signals=self.shift + 1j * scale[:, None] * self._listen(source),
        )

    def _make_first_order_product(
        self, spring: NDArray[Any], times: Array
    ) -> Callable[[Complex], Complex]:
        """Return the function that multiplies a vector (size + rows,) of velocities and
        deformations by H of :meth:`_make_first_order`; ``spring`` (rows,) are roots of stiffnesses,
        complex, over the top frequency, and ``times`` (rows,), s, are those of dashpots.
        """
        n = self.operator.size
        parts = self.operator.parts
        dashpots = times / self.operator.top
        drag = self.operator.drag(self.losses) / self.operator.top

        def apply(vector: Complex) -> Complex:
            """Return H times a ``vector`` (size + rows,)."""
            strain = parts.deform(vector[:n])
            stress = vector[n:] * spring
            stress -= dashpots * strain
            product = np.empty_like(vector)
            product[:n] = parts.pull(stress) - drag * vector[:n]
            np.multiply(strain, spring, out=product[n:])
            return product

        return apply

    def _make_first_order_source(self, spring: NDArray[Any], times: Array) -> NDArray[Any]:
        """Return the source (size + rows,) of velocities and deformations, that of a wall over its
        factor i omega; ``spring`` and ``times`` are those of :meth:`_make_first_order_product`.
        """
        if not self.driven.is_moved:
            return np.concatenate([self.driven.drives[0], np.zeros(spring.size, complex)])
        # if walls stretch the rows of A by s, it is (-A^T tau s, top spring s)
        stretches = self.operator.stretch(self.driven.amplitude)
        ball_source = -self.operator.parts.pull(times * stretches)
        deformation_source = self.operator.top * spring * stretches
        return np.concatenate([ball_source, deformation_source])

    def _list_shift(self, n_frequencies: int) -> Array:
        """Return the shifts of receivers, which do not depend on the frequency, as
        (``n_frequencies``, n_r).
        """
        return np.broadcast_to(self.shift, (n_frequencies, len(self.shift)))

    def _listen(self, x: NDArray[Any]) -> NDArray[Any]:
        """Return the signals (n_r,) of receivers for motions x (size,), without their shifts."""
        return np.asarray(np.sum(x[self.heard_motions] * self.motion_weights, axis=1))

    def _solve_by_factors(self, omega: Array) -> tuple[Complex, Array]:
        """Return the signals (n_f, n_r) at ``omega`` (n_f,), rad/s, and their errors (n_f,), by
        factors of Z at each frequency, of which the progress of the operator is told.
        """
        equations = _Equations(self)
        values = np.zeros((omega.size, len(self.heard_motions)), complex)
        error = np.zeros(omega.size)
        with self.operator.progress.step("response by factors", omega.size) as step:
            for row, w in enumerate(omega.tolist()):
                values[row], error[row] = self._solve_directly(equations, w)
                step.advance()
        return values, error

    def _solve_directly(self, equations: _Equations, w: float) -> tuple[Complex, float]:
        """Return the signals (n_r,) at the angular frequency ``w``, rad/s, and their error over the
        largest signal.

        The error is the change by the last correction, plus that by the rounding of Z and omega.
        Raises :class:`~granphon.base.errors.InputError` at the frequency of a mode that loses no
        energy.
        """
        matrix, drive = equations.at(w)
        x = np.zeros(drive.size, matrix.dtype)
        signals = np.zeros(len(self.heard_motions), complex)
        try:
            factors = equations.elimination.factorise(matrix)
            for number in range(_SOLUTIONS):
                residual = drive - matrix @ x
                change = factors.solve(residual)
                x += change
                previous = signals
                signals = self._listen(x) + self.shift
                loudest = np.max(np.abs(signals)) or 1.0  # signals that are all zero: no quotient
                error = float(np.max(np.abs(signals - previous)) / loudest)
                is_corrected = number > 0
                if is_corrected and error <= TOLERANCE:
                    break
            # the entries of Z, and omega, have the rounding of a float
            entry_sizes = np.abs(matrix.diagonal()) + 2.0 * w**2 / equations.top_square
            rounding = factors.solve(np.finfo(float).eps * entry_sizes * x)
            error += float(np.max(np.abs(self._listen(rounding))) / loudest)
        except RuntimeError:  # exactly singular
            raise _explain_resonance(w) from None
        is_solved = np.linalg.norm(change) <= _LARGEST_CHANGE * np.linalg.norm(x)  # False for nan
        if not is_solved:
            raise _explain_resonance(w)
        return signals, error

    def _solve_in_space(
        self, work: ResponseWork, may_factorise: bool
    ) -> tuple[Complex, Array, int]:
        """Return the signals (n_f, n_r) at the frequencies of the ``work`` and their errors (n_f,),
        by a Krylov space, and the number of its steps, of which the progress of the operator is
        told.

        The space ends at the latest after :data:`_MOST_STEPS`, and if factors ``may_factorise``
        what it leaves, after twice as many steps as are expected.
        """
        expected_steps = float(np.max(work.steps))
        most_steps = 2.0 * expected_steps if may_factorise else math.inf
        with self.operator.progress.step("response", expected_steps) as step:
            return self._build_space(work, min(most_steps, _MOST_STEPS), step)

    def _build_space(
        self, work: ResponseWork, most_steps: float, step: Step
    ) -> tuple[Complex, Array, int]:
        """Return what :meth:`_solve_in_space` returns, by a space of up to ``most_steps``; the
        progress ``step`` is told of each step.

        A frequency is found when its error is within the tolerance, or is rounding alone; errors of
        frequencies that are not found are infinite. If the source is zero, no step is taken, and
        errors are zero.
        """
        n_frequencies = work.omega.size
        space = self._make_space(work)
        values = self._list_shift(n_frequencies).astype(complex)
        error = np.zeros(n_frequencies)
        if not np.any(space.start):
            return values, error, 0
        error[:] = np.inf
        process = _KrylovProcess(space, self._listen)
        # residual, over the source, at which the next solution of each frequency is tried
        trial_residual = np.full(n_frequencies, _FIRST_TRIAL)
        is_sought = np.isfinite(space.bound)
        while process.steps < most_steps:
            process.advance()
            step.advance()
            if process.is_degenerate:
                break
            residuals = process.length * process.last_entry
            is_tried = is_sought & ((residuals <= trial_residual) | process.is_complete)
            for number in np.flatnonzero(is_tried).tolist():
                trial = self._try_solution(process, number)
                values[number] = trial.signals
                error[number] = trial.rounding + trial.truncation
                trial_residual[number] = trial.find_next_residual(process, work.tolerance)
                is_sought[number] = trial_residual[number] > 0.0
            may_improve = is_sought & (process.last_entry < _LARGEST_ENTRY)
            if process.is_complete or not np.any(may_improve):
                break
        error[is_sought] = np.inf
        return values, error, process.steps

    @single_products()
    def find_sensitivities(self, hertz: Array, quantity: str) -> ResponseSensitivities:
        """Return the derivatives of the response in a ``quantity`` at frequencies ``hertz`` (n_f,),
        Hz, by factors at each frequency and an adjoint solution for each receiver.

        Raises :class:`~granphon.base.errors.InputError` if the derivatives do not fit into memory,
        and at the frequency of a mode that loses no energy;
        :class:`~granphon.base.errors.ConvergenceError` for a network too large to be factorised.
        """
        omega = 2.0 * math.pi * hertz
        work = ResponseWork(self.operator, self.losses, omega)
        work.choose("direct")  # raises the error of a network too large for factors
        amplitude = self.driven.amplitude
        wall_motions = amplitude if self.driven.is_moved else np.zeros_like(amplitude)
        slopes = ResponseSlopes(self.operator, self.losses, wall_motions)
        slopes.require_memory(hertz.size * self.n_receivers)
        signal_vectors = self._make_signal_vectors()
        equations = _Equations(self)
        order = _DERIVATIVES.get(quantity, 0)
        slopes_of_frequencies = []
        for w in omega.tolist():
            derivatives = self._differentiate(equations, slopes, signal_vectors, w)
            rate = (1j * w) ** order  # from displacements to their derivatives by the time
            slopes_of_frequencies.append(
                {name: rate * values for name, values in derivatives.items()}
            )
        fields: dict[str, Any] = {"normal_force": None}  # as it is without prestress
        for name in slopes_of_frequencies[0]:
            values = [of_frequency[name] for of_frequency in slopes_of_frequencies]
            fields[name] = np.array(values, complex)
        unit = QUANTITIES[quantity]
        return ResponseSensitivities(**fields, frequencies=hertz, quantity_unit=unit)

    def _differentiate(
        self, equations: _Equations, slopes: ResponseSlopes, signal_vectors: Array, w: float
    ) -> dict[str, NDArray[Any]]:
        """Return the derivatives of displacements, or of the forces of sensors, at the angular
        frequency ``w``, rad/s, by the names of fields, as :meth:`ResponseSlopes.find` does.

        ``signal_vectors`` (size, n) are those of :meth:`_make_signal_vectors`. Raises what
        :meth:`_solve_adjoint` raises.
        """
        sensors = self.sensors
        if sensors is None:
            motions = self._solve_adjoint(equations, w, signal_vectors)
            return slopes.find(motions[:, 0], motions[:, 1:], w)
        sensor_vectors = signal_vectors @ sensors.find_weights(w)
        motions = self._solve_adjoint(equations, w, sensor_vectors)
        x = motions[:, 0]
        derivatives = slopes.find(x, motions[:, 1:], w)
        elongations = self._listen(x) + self.shift
        # the stiffness of a heard contact also turns its elongation into a force
        reading_slopes = sensors.find_stiffness_slopes(w, elongations)
        derivatives["normal_stiffness"][:, sensors.contacts] += reading_slopes
        return derivatives

    def _make_signal_vectors(self) -> Array:
        """Return the vectors e (size, n_r) of receivers: the signal of each, without its shift, is
        e^T x of motions x (size,).
        """
        vectors = np.zeros((self.operator.size, len(self.heard_motions)))
        receivers = zip(self.heard_motions, self.motion_weights, strict=True)
        for number, (motions, weights) in enumerate(receivers):
            # added, as both ends of a contact may be one ball
            np.add.at(vectors[:, number], motions, weights)
        return vectors

    def _solve_adjoint(
        self, equations: _Equations, w: float, receiver_vectors: Array
    ) -> NDArray[Any]:
        """Return the motions (size, 1 + n_r) at the angular frequency ``w``, rad/s: first those
        that the source makes, then for each receiver its adjoint motions, the solution with its
        vector among ``receiver_vectors`` (size, n_r) in place of the source.

        Raises :class:`~granphon.base.errors.InputError` at the frequency of a mode that loses no
        energy.
        """
        matrix, drive = equations.at(w)
        right_sides = np.column_stack([drive, receiver_vectors / equations.top_square])
        right_sides = right_sides.astype(matrix.dtype)
        try:
            factors = equations.elimination.factorise(matrix)
            motions = factors.solve(right_sides)
            change = factors.solve(right_sides - matrix @ motions)
        except RuntimeError:  # exactly singular
            raise _explain_resonance(w) from None
        if not np.linalg.norm(change) <= _LARGEST_CHANGE * np.linalg.norm(motions):
            raise _explain_resonance(w)
        return np.asarray(motions + change)

    @cached_property
    def _signal_bound(self) -> float:
        """A bound of the signals that motions x of norm one make in any receiver."""
        return float(np.max(np.linalg.norm(self.motion_weights, axis=1)))

    def _try_solution(self, process: _KrylovProcess, number: int) -> _Trial:
        """Return the solution at the frequency of this ``number``, an index, in the space of the
        steps so far, with its residual and errors.
        """
        space = process.space
        steps = process.steps
        scale = space.scale[number]
        bands = process.bands[:, :steps]
        solutions = _solve_tridiagonal(bands, space.shifts[number], process.largest)
        # signals of the solution in the space, and of its change by rounding
        space_signals, rounding_signals = (
            process.size * scale * (solutions @ process.signals[:steps])
        )
        signals = space_signals + space.direct_signals[number]
        residual = process.find_residual(number)
        bound = abs(scale) * self._signal_bound * residual * space.bound[number]
        # the first vectors may not reach the receivers: then the bound stands for their signals
        loudest = float(np.max(np.abs(signals))) or bound or 1.0
        rounding_of_vectors = np.finfo(float).eps * math.sqrt(steps) * process.growth
        rounding_of_matrix = np.max(np.abs(rounding_signals)) / loudest
        rounding = rounding_of_vectors + rounding_of_matrix
        return _Trial(signals, residual, bound / loudest, rounding)


class _Trial(NamedTuple):
    """A solution at one frequency in a Krylov space.

    Attributes
    ----------
    signals : (n_r,) signals of the receivers.
    residual : norm of the residual, in the unit of the source.
    truncation : error because the space ends here, over the largest signal.
    rounding : error by rounding, over the largest signal.
    """

    signals: Complex
    residual: float
    truncation: float
    rounding: float

    def find_next_residual(self, process: _KrylovProcess, tolerance: float) -> float:
        """Return the residual, over the source, at which the next solution of the ``process`` is to
        be computed; zero if this solution is within the ``tolerance``, or no later one would be
        better.
        """
        size = float(abs(process.size))
        # as long as no signal reaches the receivers, the residual is not taken as rounding
        rounding = _ROUNDING * size * process.growth if np.any(self.signals) else 0.0
        is_precise = self.truncation <= tolerance
        if process.is_complete or is_precise or self.residual <= rounding:
            return 0.0
        # the error falls with the residual: the aim is half of the tolerance, but not too far ahead
        reduction = max(0.5 * tolerance / self.truncation, _NEXT_TRIAL)
        return self.residual / size * reduction


class _Equations:
    """The equations Z x = source of a ``problem``, both sides over top^2, as sparse matrices. All
    matrices have their entries in the same places, so that Z has one order of elimination.

    Attributes
    ----------
    elimination : the order of elimination of Z.
    top_square : top^2, (rad/s)^2.
    """

    def __init__(self, problem: _Problem) -> None:
        from scipy.sparse import eye_array

        operator = problem.operator
        self.top_square = operator.top**2
        unit = eye_array(operator.size)
        losses = problem.losses
        # power of omega with which each matrix of losses counts: 0 for loss factors, and 1 for
        # dashpots and drag
        self._powers = []
        matrices: list[Any] = [operator.matrix]
        if np.any(losses.factors):
            self._powers.append(0)
            matrices.append(operator.weigh(losses.factors))
        if losses.has_dashpots or np.any(losses.drag):
            self._powers.append(1)
            matrices.append(operator.resist(losses))
        reduced_matrices = [matrix / self.top_square for matrix in matrices]
        self._matrix, self._ones, self._elastic, *self._lossy = share_places(
            [unit, *reduced_matrices]
        )
        self.elimination = Elimination(self._matrix)
        self._drives = [drive / self.top_square for drive in problem.driven.drives]

    def at(self, w: float) -> tuple[Any, NDArray[Any]]:
        """Return Z (size, size), sparse, and the source (size,), both over top^2, at the angular
        frequency ``w``, rad/s; the next call overwrites the matrix.
        """
        entries = self._elastic - w**2 / self.top_square * self._ones
        drive = self._drives[0]
        for power, lossy_entries in zip(self._powers, self._lossy, strict=True):
            factor = 1j * w**power
            if factor:  # dashpots do nothing at frequency zero, where Z stays real
                entries = entries + factor * lossy_entries
                drive = drive + factor * self._drives[1 + power]
        self._matrix.data = entries
        return self._matrix, drive.astype(self._matrix.dtype)


class _KrylovProcess:
    """The process that makes the vectors of a Krylov space one after the other, with the signals
    that each makes and the tridiagonal matrix that H is on these vectors.

    ``listen`` returns the signals (n_r,) of receivers for a vector.

    Attributes
    ----------
    space : the space: H, its scalar product, its start, and the shifts (n_f,).
    size : root of the square of the start, in the product of the space.
    steps : number of vectors that H has been applied to.
    bands : (3, steps or more) entries of the matrix above, on and below the diagonal, column by
        column.
    signals : (steps or more, n_r) signals of the vectors.
    last_entry : (n_f,) size of the last entry of the solution at each frequency, for a start of
        size one.
    length : norm of the next vector before it is scaled.
    largest : greatest entry of the matrix so far.
    growth : greatest square of the norm of a vector so far.
    is_complete : whether the space holds all that H makes of the start.
    is_degenerate : whether the next vector is nearly orthogonal to itself, which ends the space.
    """

    def __init__(self, space: _Space, listen: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
        from scipy.linalg.blas import daxpy, zaxpy

        self.space = space
        self.size = np.sqrt(space.product(space.start, space.start))
        self.steps = 0
        self._listen = listen
        self._add: Any = zaxpy if np.iscomplexobj(space.start) else daxpy  # y + a x, in place of y
        self._previous_vector = np.zeros_like(space.start)
        self._vector = space.start / self.size
        self._next_vector = self._vector
        first_signals = listen(self._vector)
        self.bands = np.zeros((3, _FIRST_ROOM), complex)
        self.signals = np.zeros((_FIRST_ROOM, first_signals.size), self._vector.dtype)
        self._pivot = np.ones(space.shifts.size, complex)  # last pivots of the shifted matrices
        self.last_entry = np.ones(space.shifts.size)
        self._below: Any = 1.0  # last entry below the diagonal
        self.length = 0.0
        self.largest = 0.0
        self.growth = 1.0
        self.is_complete = False
        self.is_degenerate = False

    def advance(self) -> None:
        """Make a step: apply H to the next vector, make the product orthogonal to the last two
        vectors, and add a column to the tridiagonal matrix.

        Sets the signals of the vector, the last entries of all solutions, and whether the space
        ends.
        """
        if self.steps:
            self._previous_vector = self._vector
            self._vector = self._next_vector
            self._vector /= self._below
        self._make_room()
        product = self.space.product
        self.signals[self.steps] = self._listen(self._vector)
        following = self.space.apply(self._vector)
        above = product(self._previous_vector, following)
        following = self._add(self._previous_vector, following, a=-above)
        diagonal = product(self._vector, following)
        following = self._add(self._vector, following, a=-diagonal)
        self._eliminate(above, diagonal)  # with the entry below the last diagonal one
        self._below = np.sqrt(product(following, following))
        self._next_vector = following
        self.bands[:, self.steps] = (above, diagonal, self._below)
        self.steps += 1
        self._check_end(abs(diagonal))

    def _make_room(self) -> None:
        """Double the length of ``bands`` and ``signals`` if they are full."""
        if self.steps == len(self.signals):
            self.bands = np.pad(self.bands, ((0, 0), (0, self.steps)))
            self.signals = np.pad(self.signals, ((0, self.steps), (0, 0)))

    def _eliminate(self, above: Any, diagonal: Any) -> None:
        """Eliminate the new column in the shifted matrices of all frequencies: set the last pivots
        (n_f,) of these matrices and the last entries of their solutions. The column has the entries
        ``above`` the diagonal and on the ``diagonal``.
        """
        pivot = diagonal - self.space.shifts - above * self._below / self._pivot
        # a shift may be a number on the diagonal: a pivot of zero is replaced by its rounding
        numbers = np.finfo(float)
        rounding = max(numbers.eps * max(self.largest, abs(diagonal)), numbers.tiny)
        self._pivot = np.where(pivot == 0.0, rounding, pivot)
        quotient = np.abs(self._below / self._pivot)
        self.last_entry = np.minimum(self.last_entry * quotient, _LARGEST_ENTRY)

    def _check_end(self, diagonal_size: float) -> None:
        """Set whether the space is complete or degenerate, and the greatest sizes so far;
        ``diagonal_size`` is the size of the last entry on the diagonal.
        """
        self.length = math.sqrt(np.vdot(self._next_vector, self._next_vector).real)
        self.largest = max(self.largest, self.length, diagonal_size)
        self.is_complete = self.length <= _LEAST_LENGTH * self.largest
        if self.is_complete:
            return
        self.is_degenerate = abs(self._below) <= _LEAST_SELF_PRODUCT * self.length
        if not self.is_degenerate:
            self.growth = max(self.growth, (self.length / abs(self._below)) ** 2)

    def find_residual(self, number: int) -> float:
        """Return the norm of the residual, in the unit of the source, of the solution at the
        frequency of this ``number``, an index.
        """
        if self.is_complete:
            return 0.0
        return float(abs(self.size) * self.length * float(self.last_entry[number]))


def _solve_tridiagonal(bands: Complex, shift: complex, largest: float) -> Complex:
    """Return two solutions (2, n) of a tridiagonal matrix less a ``shift``: y, with the first unit
    vector as the right side, and a second one that estimates the change of y by the rounding of the
    matrix.

    ``bands`` (3, n) are the entries of the matrix above, on and below the diagonal, column by
    column, and ``largest`` is the size of the greatest entry.
    """
    from scipy.linalg import solve_banded

    matrix = bands.copy()
    matrix[1] -= shift
    first_unit_vector = np.zeros(bands.shape[1], complex)
    first_unit_vector[0] = 1.0
    y = solve_banded((1, 1), matrix, first_unit_vector, check_finite=False)
    rounding = np.finfo(float).eps * largest * y
    y_of_rounding = solve_banded((1, 1), matrix, rounding, check_finite=False)
    return np.stack([y, y_of_rounding])


def _invert(values: NDArray[Any]) -> NDArray[Any]:
    """Return one over ``values`` (...); infinite where these are zero."""
    inverse = np.full(values.shape, np.inf, values.dtype)
    return np.asarray(np.divide(1.0, values, out=inverse, where=values != 0.0))


def _explain_resonance(omega: float) -> InputError:
    """Return the error of a response at the angular frequency ``omega``, rad/s, of a mode that
    loses no energy.
    """
    fault = f"the response at {write_quantity(omega / (2.0 * math.pi), 'Hz', 6)} has no bound"
    why = "The network has a mode of this frequency that loses no energy"
    return InputError(fault, why, "Give a loss, such as a damping, or another frequency")
