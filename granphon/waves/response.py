"""The response of a network at given frequencies: receptance, mobility, and what a moved wall hands
on.

With forces F exp(i omega t) on balls, mass-weighted motions x = M^1/2 u obey Z x = M^-1/2 F,

    Z(omega) = D(omega) - omega^2,    D(omega) = A^T (1 + i eta + i omega tau) A + static forces,

with the damping of :mod:`granphon.dynamics.damping`; a wall that is moved pulls at the balls that
touch it with the same springs and dashpots. There are two ways to solve it.

Directly: sparse LU factors of Z at each frequency, in an order of the motions that is found once.
Further solutions, of the residual, mend the first solution until it changes no more. The error is
the last change, and the effect of the rounding of Z and omega, which is large next to modes that
lose no energy.

By one Krylov space for all frequencies, of the source and a matrix H that does not depend on them:
each step multiplies the last vector by H and makes the result orthogonal to the two before it. On
these vectors H is a tridiagonal matrix, with which the shifted systems of all frequencies are
solved (R. W. Freund, in Numerical Linear Algebra, de Gruyter, 1993). Of the vectors only the
signals of receivers are kept, and a step takes one product and a few sums.

If all contacts are damped alike, Z = s (D - z) with a number s and z = omega^2/s, and H is D: the
process of Lanczos. If they have different loss factors alone, H is A^T (1 + i eta) A, complex and
symmetric, and vectors are orthogonal in the product x.y without conjugation. With different
dashpots, H is that of velocities v = x' and deformations y = i (1 + i eta)^1/2 A x, with which the
equations of motion are of first order,

    (i omega + ((A^T tau A, -B^T), (-B, 0))) (v, y) = (M^-1/2 F, 0),    B = i (1 + i eta)^1/2 A.

It is symmetric too. But if its vectors were real in v and imaginary in y, a vector would be
orthogonal to itself as soon as both have the same energy. So the space is that of 1 - i H times the
source: without losses its vectors are as real as those of Lanczos. x follows from the solution x'
there, x = (x' + i source)/(1 + omega). With strong dashpots this process loses its digits, and
vectors are made orthogonal in the product with conjugation, to the last two only: the process of
Arnoldi, incomplete (Y. Saad, Linear Algebra Appl. 34, 269 (1980)), which is stable and takes many
more steps. A static force adds deformations of imaginary stiffness^1/2.

The residual has the norm of the next vector times the last coefficient. With g the least eta +
omega tau of all contacts, |Z^-1| is at most one over the distance of omega^2 from all d (1 + i g'),
d >= 0 and g' >= g, which bounds the error. The number of steps follows from g beforehand
(:class:`ResponseWork`), and frequencies at which factors are less work are left to factors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.sparse_matrices import estimate_factors, share_places
from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import ConvergenceError, InputError, brief
from granphon.base.memory import require_memory
from granphon.base.results import Result
from granphon.base.scales import write_quantity
from granphon.base.text import counted
from granphon.base.threads import single_products
from granphon.base.validation import frequency_array, index_array, one_of, positive
from granphon.dynamics.damping import ContactDamping
from granphon.dynamics.factors import Analysis
from granphon.networks.network import ContactNetwork
from granphon.waves.operator import WaveOperator
from granphon.waves.pulses import Course, read_push, read_vector, require_moves

#: memory of the response of a ball at one frequency, bytes
_RESPONSE_BYTES = 100.0
#: quantities of a response, and their units
QUANTITIES = {"displacement": "m/N", "velocity": "m/(N s)", "transmissibility": "1"}
#: ways to solve
METHODS = ("direct", "krylov")
#: motions up to which factors are always taken, as they lose no digits
_FEW = 2_000
#: bound of the error of a response, over the largest value at its frequency, with which the
#: response counts as found
TOLERANCE = 1e-9
#: root of the square of a vector, in the product that has either sign, over its norm, up to which
#: the space ends
_DEGENERATE = 1e-4
#: most products of a space
_MOST = 100_000
#: products for which signals and coefficients have room at first
_FIRST = 256
#: longest time of a response whose method is not named, s
_LONGEST = 3600.0
#: longest time of factors where a space has not enough digits, s
_AGAIN = 10.0
#: least pace of a Krylov space, over the mean distance of modes in a network, which the space comes
#: to tell apart
_MODE_PACE = 5.0
#: time of a step with loss factors that differ, over that of Lanczos
_LOSSY = 2.5
#: time of a step with dashpots that differ, likewise
_FIRST_ORDER = 4.5
#: steps with dashpots that differ, over those of Lanczos: of the symmetric process, and of the
#: incomplete one
_SYMMETRIC = 2.0
_INCOMPLETE = 3.0
#: greatest damping, over the top frequency, up to which the symmetric process of first order keeps
#: its digits
_STRONG = 0.45
#: residual, over the source, at which the first solution is tried
_FIRST_TRIAL = 1e-3
#: least residual of the next trial, over that of the last
_NEXT_TRIAL = 0.02
#: norm of the residual of a step, over the largest, at which the space holds all that D makes of
#: the source
_COMPLETE = 1e-13
#: solutions by the same factors, of which each mends the one before
_SOLUTIONS = 4
#: error above which a response has a warning
_UNSURE = 1e-6
#: last change of a solution by factors, over the solution, above which there is none
_UNKNOWN = 1e-2
#: residual of Lanczos, over the source, from which on the residual is rounding alone
_ROUNDING = 1e-16
#: residual over the source, from which on a frequency is never found
_LOST = 1e100
#: most rounds in which a narrow line is approached: the distance from its pole falls as its square
_ROUNDS = 12
#: change of a pole, over its half width, at which the pole stands
_STANDS = 1e-6
#: difference of the poles of two receivers, over the half width, up to which they hear one line
_SAME_LINE = 1e-2
#: least half width of a line over the square of its frequency, 1/Q: losses of a narrower line are
#: not told from rounding
_NARROWEST = 1e-9
#: a function that returns values (n, n_r) at ascending frequencies (n,), Hz
Solve = Callable[[Array], NDArray[np.complex128]]


@dataclass(frozen=True, eq=False, repr=False)
class Response(Result, array="values"):
    """Complex amplitudes of receivers in a steady motion exp(i omega t); ``np.asarray`` of it is
    ``values``.

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    values : (n_f, n_r) amplitude of each receiver over that of the source: m/N, m/(N s) or 1. A
        phase below zero lags.
    quantity : "displacement" (receptance), "velocity" (mobility) or "transmissibility".
    sources : (n_s,) balls that are pushed, each with the same force, or bodies that are moved.
    pushes : (n_s, 3) unit vectors along which sources are pushed or moved.
    receivers : (n_r,) balls that are heard.
    directions : (n_r, 3) unit vectors along which receivers are heard.
    error : (n_f,) error of the values at each frequency, over the largest of them.
    factorisations : number of frequencies whose values were found by factors of the matrix.
    steps : number of steps of the Krylov space by which the others were found; 0 without any.
    warnings : one sentence for the frequencies whose error is above 1e-6, as next to modes without
        damping; and one where contacts are more viscous than stiff, as a damping is a time.
    """

    _notebook_fields = ("method",)
    #: solves at other frequencies; empty where no network is at hand, or nothing loses energy
    _solver: ClassVar[tuple[Solve, ...]] = ()

    frequencies: Annotated[Array, "f", "Hz"]
    values: Annotated[Complex, "f r"]
    quantity: str
    sources: Annotated[Index, "s"]
    pushes: Annotated[Array, "s 3"]
    receivers: Annotated[Index, "r"]
    directions: Annotated[Array, "r 3"]
    error: Annotated[Array, "f"]
    factorisations: int
    steps: int
    warnings: tuple[str, ...] = ()

    def _field_units(self) -> dict[str, str]:
        return {**self.units, "values": QUANTITIES[self.quantity]}

    @property
    def magnitude(self) -> Array:
        """(n_f, n_r) in m/N, m/(N s) or 1."""
        return np.abs(self.values)

    @property
    def phase(self) -> Array:
        """(n_f, n_r) rad, without jumps by 2 pi from one frequency to the next; the first is
        between -pi and pi.
        """
        return np.unwrap(np.angle(self.values), axis=0)

    @property
    def coherent(self) -> NDArray[np.complex128]:
        """(n_f,) mean over the receivers, as that of a plane."""
        return np.asarray(np.mean(self.values, axis=1))

    @cached_property
    def peaks(self) -> tuple[Peaks, ...]:
        """For each receiver its peaks, each that of a mode over a constant background: frequencies,
        heights, Q factors.

        Lines narrower than the step of the frequencies are solved for between these. A response
        that was read from a file or a copy, or that loses no energy, has their frequencies to a
        step, and neither heights nor Q, which are nan.
        """
        return self.peaks_of_means([[place] for place in range(len(self.receivers))])

    def peaks_of_means(self, groups: Sequence[Any]) -> tuple[Peaks, ...]:
        """Return the :attr:`peaks` of means over receivers, as those of planes.

        ``groups`` has for each mean the numbers of its receivers, a list or a slice.
        """

        def take_means(values: Complex) -> Complex:
            return np.stack([np.mean(values[:, group], axis=1) for group in groups], axis=1)

        def solve(frequencies: Array) -> Complex:
            return take_means(self._solver[0](frequencies))

        return find_peaks(
            self.frequencies, take_means(self.values), solve if self._solver else None
        )

    @property
    def method(self) -> str:
        """How the response was found, in words."""
        by_krylov = len(self.frequencies) - self.factorisations
        methods = []
        if self.factorisations:
            frequencies = counted(self.factorisations, "frequency", "frequencies")
            methods.append(f"{frequencies} by factors of the matrix")
        if by_krylov:
            frequencies = counted(by_krylov, "frequency", "frequencies")
            methods.append(f"{frequencies} by a Krylov space of {counted(self.steps, 'step')}")
        return ", ".join(methods)

    @property
    def labelled(self) -> dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]:
        """What ``xarray.Dataset`` takes: dimensions, numbers and units of magnitude, phase, error
        and balls.
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


class Peaks(NamedTuple):
    """Peaks of a magnitude over frequency.

    Attributes
    ----------
    frequencies : (n,) Hz.
    heights : (n,) magnitude at the peaks, in the unit of the response; nan of a line that is
        narrower than the step of the frequencies, where nothing is solved between them.
    quality : (n,) Q factors, a ratio without a unit; nan if the peak is not resolved, or not that
        of one mode.
    """

    frequencies: Array
    heights: Array
    quality: Array


def find_peaks(
    frequencies: Array, values: Complex, solve: Solve | None = None
) -> tuple[Peaks, ...]:
    """Return the peaks of the magnitude of each receiver, inside of the ascending frequencies
    (n_f,), Hz.

    ``values`` are (n_f, n_r); ``solve`` returns those at other ascending frequencies. B + R/(p -
    f^2), a mode over a constant background, passes through the highest value and its two
    neighbours. Its pole p gives the frequency (Re p)^1/2, the height there, and Q = Re p / Im p.
    Where the width of the line is below half the step of the frequencies, these lie too far from
    it: the response is solved at the pole and half a width beside it, and the pole found anew,
    until it stands. Without ``solve`` the height and Q of such a line are not known, and its
    frequency is that of the highest value. Where the pole is farther away than its width, the peak
    is not that of one mode: it is the highest value, and Q is not known.
    """
    magnitude = np.abs(values)
    tops = (magnitude[1:-1] > magnitude[:-2]) & (magnitude[1:-1] >= magnitude[2:])
    rows = 1 + np.flatnonzero(np.any(tops, axis=1))
    is_top = tops[rows - 1]
    squares = np.array([frequencies[rows + step] ** 2 for step in (-1, 0, 1)])
    heard = np.array([values[rows + step] for step in (-1, 0, 1)])
    x = squares[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):  # two equal values have no pole
        pole = _fit_pole(x, heard)
        strength = (heard[2] - heard[0]) * (pole - x[0]) * (pole - x[2]) / (x[2] - x[0])
        top = np.abs(heard[1] - strength / (pole - x[1]) + strength / (1j * pole.imag))
        step = x[2] - x[0]
        is_broad = np.abs(pole.imag) >= 0.25 * step
        is_near = np.abs(pole.real - x[1]) <= np.maximum(pole.imag, 0.5 * step)
        is_mode = is_broad & (pole.imag > 0.0) & is_near
        peak_squares = np.where(is_mode, pole.real, x[1])
        sampled = np.where(is_broad, magnitude[rows], np.nan)
        heights = np.where(is_mode, np.maximum(top, magnitude[rows]), sampled)
        quality = np.where(is_mode, pole.real / pole.imag, np.nan)
    narrow = is_top & ~is_broad
    if solve is not None and np.any(narrow):
        lines = np.flatnonzero(np.any(narrow, axis=1))
        line_pole, line_squares, line_values = _approach_lines(
            squares[:, lines], heard[:, lines], narrow[lines], solve
        )
        receiver_poles = _fit_pole(line_squares[..., None], line_values)
        difference = np.abs(receiver_poles - line_pole[:, None])
        is_same = difference <= _SAME_LINE * line_pole.imag[:, None]
        height = np.abs(line_values[1])
        is_line = narrow[lines] & is_same & (height >= magnitude[rows[lines]])
        line_quality = (line_pole.real / line_pole.imag)[:, None]
        peak_squares[lines] = np.where(is_line, line_squares[1][:, None], peak_squares[lines])
        heights[lines] = np.where(is_line, height, heights[lines])
        quality[lines] = np.where(is_line, line_quality, quality[lines])
    peaks = []
    for receiver, is_peak in enumerate(is_top.T):
        at_peak = (is_peak, receiver)
        peaks.append(Peaks(np.sqrt(peak_squares[at_peak]), heights[at_peak], quality[at_peak]))
    return tuple(peaks)


def _fit_pole(x: Array, values: Complex, weights: Any = None) -> Any:
    """Return the pole p of B + R/(p - x) through three values, the first axis.

    With ``weights`` (n, n_r) it is that which the receivers, the last axis, have in common, by
    least squares.
    """
    rise = values[1] - values[0]
    following = values[2] - values[1]
    if weights is None:
        ratio = rise / following
    else:
        overlap = np.sum(weights * rise * following.conj(), axis=-1)
        ratio = overlap / np.sum(weights * np.abs(following) ** 2, axis=-1)
    ratio = ratio * (x[2] - x[1]) / (x[1] - x[0])
    return (x[2] - ratio * x[0]) / (1.0 - ratio)


def _approach_lines(
    x: Array, values: Complex, heard: Any, solve: Solve
) -> tuple[Complex, Array, Complex]:
    """Solve at lines (n,) between three points until their poles stand.

    ``x`` (3, n) are squares of frequencies, ``values`` (3, n, n_r), and ``heard`` (n, n_r) says
    which receivers hear a line. Returns the poles (n,), nan of lines that are not found, and the
    last points and values about each.
    """
    low = x[0]
    high = x[2]
    x = x.copy()
    values = values.copy()
    pole = np.full(len(low), np.nan + 0j)
    with np.errstate(divide="ignore", invalid="ignore"):
        estimate = _fit_pole(x, values, heard)
    active = np.arange(len(low))
    for _ in range(_ROUNDS):
        active = active[np.isfinite(estimate[active])]
        if not active.size:
            break
        centre = np.clip(estimate[active].real, low[active], high[active])
        half_width = np.clip(
            np.abs(estimate[active].imag), _NARROWEST * centre, 0.25 * (high - low)[active]
        )
        x[:, active] = centre + half_width * np.array([[-1.0], [0.0], [1.0]])
        frequencies, index = np.unique(np.sqrt(x[:, active]), return_inverse=True)
        values[:, active] = solve(frequencies)[index.reshape(3, active.size)]
        with np.errstate(divide="ignore", invalid="ignore"):
            renewed = _fit_pole(x[:, active], values[:, active], heard[active])
        change = np.abs(renewed - estimate[active])
        stands = (change <= _STANDS * renewed.imag) & (renewed.imag > _NARROWEST * centre)
        pole[active[stands]] = renewed[stands]
        estimate[active] = renewed
        active = active[~stands]
    return pole, x, values


def require_places(
    network: ContactNetwork, name: str, value: Any, moved: bool, **options: Any
) -> None:
    """Raise InputError unless a network has the places of a source or receiver, as arguments of
    ``Waves.response``.
    """
    _Places(network, **options).find(name, value, held=moved)


def find_response(
    operator: WaveOperator,
    frequencies: ArrayLike,
    source: Any,
    receiver: Any,
    damping: Any = 0.0,
    loss_factor: Any = 0.0,
    *,
    quantity: str = "displacement",
    direction: ArrayLike | None = None,
    polarisation: str | ArrayLike = "longitudinal",
    distance: float | None = None,
    method: str | None = None,
    tolerance: float = TOLERANCE,
) -> Response:
    """Return the response of a network; see :meth:`granphon.waves.waves.Waves.response`."""
    network = operator.network
    hertz = frequency_array("frequencies", frequencies)
    quantity = one_of("quantity", quantity, QUANTITIES)
    tolerance = positive("tolerance", tolerance, "")
    method = None if method is None else one_of("method", method, METHODS)
    damped = ContactDamping.of(network, damping, loss_factor)
    places = _Places(network, direction, polarisation, distance)
    moved = quantity == "transmissibility"
    sources, pushes = places.find("source", source, held=moved)
    receivers, directions = places.find("receiver", receiver)
    axes = list(operator.motions.translations)
    # the source: a part that does not depend on the damping, and those by losses and by dashpots
    amplitude = np.zeros((network.n_balls, operator.motions.count))
    np.add.at(amplitude[:, : len(axes)], sources, pushes[:, axes])
    if moved:
        weights = (None, damped.losses, damped.times)
        drives = [operator.pull(amplitude, weight) for weight in weights]
        stretched = operator.stretch(amplitude)
    else:
        root_masses = np.sqrt(network.masses[operator.balls])[:, None]
        pushed = operator.vector(amplitude[operator.balls] / root_masses)
        drives = [pushed, np.zeros(operator.size), np.zeros(operator.size)]
        stretched = np.zeros(0)
    heard = operator.indices[receivers, : len(axes)]
    ears = directions[:, axes] / np.sqrt(network.masses[receivers])[:, None]
    problem = _Problem(operator, damped, drives, heard, ears, moved, stretched)

    def solve(frequencies: Array) -> tuple[Complex, Array, int, int]:
        omega = 2.0 * math.pi * frequencies
        values, error, factored, steps = problem.solve(omega, method, tolerance)
        if quantity == "velocity":
            values = values * (2j * math.pi * frequencies)[:, None]
        return values, error, factored, steps

    require_memory(
        f"responses of {len(receivers):,} balls at {hertz.size:,} frequencies",
        _RESPONSE_BYTES * hertz.size * (1.0 + len(receivers)),
        "Take fewer frequencies",
    )
    values, error, factored, steps = solve(hertz)
    warnings = damped.find_warnings(float(np.max(hertz)))
    if np.any(error > _UNSURE):
        warnings = (*warnings, _explain_error(hertz, values, error, QUANTITIES[quantity]))
    response = Response(
        hertz,
        values,
        quantity,
        sources,
        pushes,
        receivers,
        directions,
        error,
        factored,
        steps,
        warnings,
    )
    if not damped.is_none:  # without losses a peak has no height
        object.__setattr__(response, "_solver", (lambda frequencies: solve(frequencies)[0],))
    return response


def _explain_error(hertz: Array, values: Complex, error: Array, unit: str) -> str:
    """Return the warning of the frequencies (n_f,), Hz, whose ``error`` (n_f,) is large."""
    unsure = np.flatnonzero(error > _UNSURE)
    worst = unsure[np.argmax(error[unsure])]
    where = (
        f"{counted(unsure.size, 'frequency', 'frequencies')}, up to {error[worst]:.1e} at"
        f" {hertz[worst]:.6g} Hz"
    )
    why = "hardly anything reaches the receivers, or a mode hardly loses energy"
    bounds = error * np.max(np.abs(values), axis=1)
    most = np.max(bounds[error >= 1.0], initial=0.0)
    if most > 0.0:
        below = write_quantity(float(most), unit, 2)
        why += f"; where it is above 1, all that is known is that they are below {below}"
    return f"the error of the response is above {_UNSURE:g} at {where}: {why}."


# -- sources and receivers -------------------------------------------------------------------------


class _Places:
    """Where a network is pushed and heard; the arguments are those of ``Waves.response``."""

    def __init__(
        self, network: ContactNetwork, direction: Any, polarisation: Any, distance: float | None
    ) -> None:
        self.network = network
        if direction is None:  # across the periods, if there is a direction across them
            free = [axis for axis in range(network.dimension) if not np.any(network.cell[:, axis])]
            direction = np.eye(3)[free[0] if free else 0]
        self.along = read_vector("direction", direction, network.dimension)
        self.polarisation = polarisation
        self.distance = None if distance is None else positive("distance", distance, "m")

    def find(self, name: str, value: Any, held: bool = False) -> tuple[Index, Array]:
        """Return balls (n,) and unit vectors (n, 3) of a source or receiver, or of a list of
        these.
        """
        network = self.network
        several = value if isinstance(value, list) else [value]
        balls = [np.zeros(0, int)]
        vectors = [np.zeros((0, 3))]
        for item in several:
            if isinstance(item, str) and item == "plane":
                chosen = self._find_plane(name, held)
                vector = read_push(network, self.along, self.polarisation)
            elif isinstance(item, tuple) and len(item) == 2:
                chosen = index_array(name, item[0], network.n_balls)
                vector = self._read_direction(item[1])
            else:
                mend = "Give (ball, direction), (balls, direction), 'plane', or a list of these"
                raise InputError(f"the {name} is {brief(item)}", mend=mend)
            require_moves(name, vector, network)
            balls.append(chosen)
            vectors.append(np.tile(vector, (len(chosen), 1)))
        all_balls = np.concatenate(balls)
        if not all_balls.size:
            raise InputError(
                f"there is no {name}", mend="Give (ball, direction), or a list of these"
            )
        self._require_mobility(name, all_balls, held)
        return all_balls, np.concatenate(vectors)

    def _require_mobility(self, name: str, balls: Index, held: bool) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless balls move; or are ``held``, and
        touch balls that move.
        """
        network = self.network
        wrong = balls[network.moving[balls] == held]
        if wrong.size and held:
            raise InputError(
                f"ball {wrong[0]} of the {name} moves",
                "A transmissibility is that of a wall or floor",
                "Give a body of infinite mass",
            )
        if wrong.size:
            raise InputError(
                f"ball {wrong[0]} of the {name} does not move",
                "It is held: its mass is infinite",
                "Ask for the transmissibility, to move it" if name == "source" else "",
            )
        ends = np.stack([network.i, network.j])
        if held and not np.any(np.isin(ends, balls) & network.moving[ends[::-1]]):
            fault = f"the {name} touches no ball that moves"
            mend = "Give those balls of the wall that touch others"
            raise InputError(fault, "Nothing moves when it does", mend)

    def _read_direction(self, value: Any) -> Array:
        if isinstance(value, str):
            if value not in ("x", "y", "z"):
                raise InputError(f"a direction is {brief(value)}", mend="Use x, y, z, or a vector")
            return np.asarray(np.eye(3)["xyz".index(value)])
        return read_vector("direction", value, self.network.dimension)

    def _find_plane(self, name: str, held: bool) -> Index:
        """Return the first plane of balls along the direction, or that of receivers."""
        network = self.network
        course = Course.along(self.network, self.along)
        if held:
            still = np.flatnonzero(~network.moving)
            if not still.size:
                raise InputError(
                    "no body of this network is held", mend="Cut it with clamped edges or a floor"
                )
            heights = course.heights[still]
            return np.asarray(still[heights <= np.min(heights) + 0.5 * course.spacing])
        places = course.places[network.moving]
        first = float(np.min(places))
        if name == "source":
            return course.find_plane(first, name)
        if self.distance is not None:
            return course.find_plane(
                course.find_place(course.find_plane(first, name)) + self.distance, name
            )
        if math.isfinite(course.period):
            fault = (
                "the receiving plane has no distance, and the network repeats along the direction"
            )
            raise InputError(fault, mend="Give the distance, m, from the first plane")
        return course.find_plane(float(np.max(places)), name)


# -- solutions -------------------------------------------------------------------------------------


class _Space(NamedTuple):
    """A matrix H, the product in which its vectors become orthogonal, and (H - shift) x = start.

    Receivers hear ``scale`` (n_f,) times x, and ``direct`` (n_f, n_r) from the source. The error of
    scale x is at most scale times ``bound`` (n_f,) times the residual.
    """

    apply: Callable[[NDArray[Any]], NDArray[Any]]
    product: Callable[[NDArray[Any], NDArray[Any]], Any]
    start: NDArray[Any]
    shifts: NDArray[Any]
    scale: NDArray[Any]
    bound: Array
    direct: Any = 0.0


@dataclass(frozen=True, eq=False)
class ResponseWork:
    """The work for the response of a network, by factors and by a Krylov space.

    Attributes
    ----------
    operator, damping : D of the network, and the damping of its contacts.
    omega : (n_f,) rad/s.
    tolerance : bound of the error at which a Krylov space ends.
    """

    operator: WaveOperator
    damping: ContactDamping
    omega: Array
    tolerance: float = TOLERANCE

    @cached_property
    def even(self) -> tuple[float, float] | None:
        """(eta, tau) where all contacts are damped alike, and no static forces act."""
        return self.damping.find_even(self.operator.network)

    @cached_property
    def of_rows(self) -> Array:
        """(2, springs) eta and tau, 1 and s, of the rows of A that have a stiffness; tension is a
        stiffness that loses no energy.
        """
        losses = self.operator.of_rows(self.damping.losses)
        times = self.operator.of_rows(self.damping.times)
        return np.stack([losses, times])[:, self.operator.of_rows() > 0.0]

    @cached_property
    def least(self) -> Array:
        """(n_f,) the least eta + omega tau of all springs."""
        losses, times = self.of_rows
        return np.array([np.min(losses + omega * times) for omega in self.omega.tolist()])

    @cached_property
    def distance(self) -> Array:
        """(n_f,) lower bound of the distance of omega^2 from all d (1 + i g'), 0 <= d <= top^2 and
        g' >= g, over top^2; no bound if not above zero.
        """
        square = (self.omega / self.operator.top) ** 2
        return np.asarray(np.maximum(square * self.least / np.hypot(1.0, self.least), square - 1.0))

    @property
    def is_strong(self) -> bool:
        """Whether dashpots differ, and are too strong for a process that is symmetric."""
        return self.has_order_one and float(np.max(self.of_rows[1])) * self.operator.top > _STRONG

    @cached_property
    def unfit(self) -> str:
        """Why no Krylov space serves all frequencies; empty if one does."""
        if self.even is None and self.operator.whole is not None:
            return "Static tangential forces act, which have no potential"
        lossless = self.even is None and np.any(np.sum(self.of_rows, axis=0) == 0.0)
        return "Some contacts lose energy, and others lose none" if lossless else ""

    @property
    def has_order_one(self) -> bool:
        """Whether dashpots differ, so that the space is one of velocities and deformations."""
        return self.even is None and bool(np.any(self.damping.times))

    @cached_property
    def step(self) -> float:
        """Time of a step of the Krylov space, s."""
        factor = 1.0 if self.even is not None else _LOSSY
        if self.has_order_one:
            factor = _FIRST_ORDER
        product_time = float(self.operator.product_time[self.operator.network.dimension])
        return factor * self.operator.size * product_time

    @cached_property
    def price(self) -> float:
        """Time of factors at a frequency, s; infinite if the network is too large."""
        return estimate_factors(self.operator.size, self.operator.network.dimension)[0]

    @property
    def factor_bytes(self) -> float:
        """Memory of factors while they are made, bytes; infinite if the network is too large."""
        return estimate_factors(self.operator.size, self.operator.network.dimension)[1]

    @cached_property
    def steps(self) -> Array:
        """(n_f,) steps of the Krylov space; infinite without a bound.

        With w = omega/top and g = eta + omega tau the least of all, a step of Lanczos makes the
        error smaller by exp(-2 Im arccos(w/(1 + i g)^1/2)), as the polynomials of Chebyshev do. In
        a network of few modes these are told apart sooner, but by the incomplete process.
        """
        w = self.omega / self.operator.top
        n = self.operator.size
        d = self.operator.network.dimension
        pace = 2.0 * np.abs(np.arccos(w / np.sqrt(1.0 + 1j * self.least)).imag)
        counts = np.full(w.shape, np.inf)
        is_bounded = (self.distance > 0.0) & (pace > 0.0)
        if not self.is_strong:
            pace += 2.0 * _MODE_PACE / np.maximum(n ** (1.0 / d), n * d * w ** (d - 1))
        reductions = np.maximum(1.0 / self.distance[is_bounded], 1.0) / self.tolerance
        counts[is_bounded] = np.log(reductions) / pace[is_bounded]
        if self.is_strong:
            return counts * _INCOMPLETE
        return counts * _SYMMETRIC if self.has_order_one else counts

    def choose(self, method: str | None) -> tuple[NDArray[np.bool_], float]:
        """Return at which frequencies (n_f,) the matrix is factorised, and the time of all, s.

        The Krylov space serves all others at once. Raises
        :class:`~granphon.base.errors.ConvergenceError` if neither method serves, or takes too long
        and is not named.
        """
        count = self.omega.size
        fits = math.isfinite(self.price)
        chosen = np.ones(count, bool)
        if method == "direct" or self.unfit or (method is None and self.operator.size <= _FEW):
            if not fits:
                raise self.explain("is not found by factors")
            seconds = self.price * count
        else:  # factors at the frequencies that take most steps
            order = np.argsort(-self.steps, kind="stable")
            times = self.step * np.append(self.steps[order], 0.0)
            n_factors = 0
            if method is None and fits:
                times = times + np.arange(count + 1) * self.price
                n_factors = int(np.argmin(times))
            chosen[order[n_factors:]] = False
            seconds = float(times[n_factors])
            most = float(np.max(self.steps, where=~chosen, initial=0.0))
            if most > _MOST:
                raise self.explain(f"is not found by a Krylov space of {_MOST:,} steps", most)
        if method is None and seconds > _LONGEST:
            raise self.explain("takes longer than an hour", float(np.max(self.steps)))
        return chosen, seconds

    def explain(self, fails: str, most: float = math.inf) -> ConvergenceError:
        """Return the error of a response that fails, with the time that each method would take, and
        a loss factor that would do.

        ``most`` are the steps of the Krylov space.
        """
        from granphon.media.cost import write_duration

        count = self.omega.size
        lowest = write_quantity(float(self.omega[0]) / (2.0 * math.pi), "Hz", 4)
        fault = f"the response of {self.operator.size:,} motions from {lowest} on {fails}"
        methods = []
        if math.isfinite(most):
            methods.append(f"a Krylov space takes about {write_duration(most * self.step)}")
        if math.isfinite(self.price):
            takes = write_duration(self.price * count)
            frequencies = counted(count, "frequency", "frequencies")
            methods.append(f"factors at {frequencies} take about {takes}")
        if methods:
            fault += f": {', and '.join(methods)}"
        why = (
            "Modes of a large network lie close together, and with little damping the response is"
            " that of each by itself"
        )
        network = self.operator.network
        for eta in (0.01, 0.02, 0.05, 0.1):
            damped = replace(self, damping=ContactDamping.of(network, 0.0, eta))
            least = float(np.max(damped.steps))
            if damped.even is not None and least <= _MOST and least * damped.step <= _LONGEST:
                takes = write_duration(least * damped.step)
                mend = (
                    f"Damp all contacts alike and more: a loss_factor of {eta:g} takes about"
                    f" {takes}"
                )
                break
        else:
            mend = "Leave out the lowest frequencies, or take a smaller network"
        if "longer" in fails:
            mend += "; or name the method, to wait for it"
        return ConvergenceError(fault, self.unfit or why, mend)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Z x = source, and the signals of receivers.

    ``drives`` are the parts of the source without damping, by loss factors and, over omega, by
    dashpots; ``moved`` says that the source is a wall, which stretches the rows of A by
    ``stretched``. A receiver hears a sum of x at the indices ``heard`` (n_r, axes), with the
    weights ``ears``.
    """

    operator: WaveOperator
    damping: ContactDamping
    drives: Sequence[Array]
    heard: Index
    ears: Array
    moved: bool
    stretched: Array

    @single_products()
    def solve(
        self, omega: Array, method: str | None, tolerance: float
    ) -> tuple[Complex, Array, int, int]:
        """Return values and errors at ``omega`` (n_f,), rad/s, the number of factorisations, and of
        steps of Lanczos.
        """
        work = ResponseWork(self.operator, self.damping, omega, tolerance)
        if work.unfit and method == "krylov":
            raise InputError(
                "no Krylov space serves all frequencies", work.unfit, "Use the direct method"
            )
        by_factors, _ = work.choose(method)
        values = np.zeros((omega.size, len(self.heard)), complex)
        error = np.full(omega.size, np.inf)
        steps = 0
        by_krylov = np.flatnonzero(~by_factors)
        may_factorise = method is None and math.isfinite(work.price)
        if by_krylov.size:
            most = float(np.max(work.steps[by_krylov])) if may_factorise else math.inf
            krylov_work = replace(work, omega=omega[by_krylov])
            values[by_krylov], error[by_krylov], steps = self._follow(krylov_work, most)
        # a response deep in a gap is less than the rounding of a Krylov space; factors keep all of
        # its digits
        deep = np.flatnonzero(np.isfinite(error) & (error > max(_UNSURE, tolerance)))
        if may_factorise and deep.size * work.price <= max(steps * work.step, _AGAIN):
            error[deep] = np.inf
        unsolved = np.flatnonzero(np.isinf(error))
        if unsolved.size and (method == "krylov" or not math.isfinite(work.price)):
            raise replace(work, omega=omega[unsolved]).explain("is not found by a Krylov space")
        if unsolved.size:
            values[unsolved], error[unsolved] = self._factorise(omega[unsolved])
        return values, error, int(unsolved.size), steps if unsolved.size < omega.size else 0

    def _make_space(self, work: ResponseWork) -> _Space:
        omega = work.omega
        operator = self.operator
        losses = self.damping.losses
        even = work.even
        if work.has_order_one:
            return self._make_first_order(work)
        top = operator.top**2
        if even is None:
            start = self.drives[0] + 1j * self.drives[1]
            bound = _invert(top * work.distance)
            return _Space(
                operator.make_lossy_product(losses),
                np.dot,
                start,
                omega**2,
                np.ones(omega.size),
                bound,
            )
        scale = 1.0 + 1j * (even[0] + omega * even[1])
        shifts = omega**2 / scale
        outside = np.maximum(np.maximum(shifts.real - top, -shifts.real), 0.0)
        distance = np.hypot(shifts.imag, outside)
        scale = scale**0 if self.moved else 1.0 / scale
        return _Space(
            lambda x: operator @ x, np.dot, self.drives[0], shifts, scale, _invert(distance)
        )

    def _make_first_order(self, work: ResponseWork) -> _Space:
        """Return H of velocities and deformations, over the top frequency; static forces are
        further rows of A.
        """
        top = self.operator.top
        n = self.operator.size
        parts = self.operator.parts
        omega = work.omega
        w = omega / top
        viscous = parts.weigh(self.damping.times)
        spring = np.sqrt(-parts.weigh() - 1j * parts.weigh(self.damping.losses)) / top
        dashpots = viscous / top

        def apply(x: Complex) -> Complex:
            strain = parts.deform(x[:n])
            stress = x[n:] * spring
            stress -= dashpots * strain
            product = np.empty_like(x)
            product[:n] = parts.pull(stress)
            np.multiply(strain, spring, out=product[n:])
            return product

        if self.moved:
            # (H - i w) (v, y) = i omega (-A^T tau s, spring s) for walls that stretch contacts by s
            start = np.concatenate(
                [-parts.pull(viscous * self.stretched), top * spring * self.stretched]
            )
        else:
            start = np.concatenate([self.drives[0], np.zeros(spring.size, complex)])
        scale: Any = -1.0 / top * (np.ones(w.size) if self.moved else _invert(1j * omega))
        largest = math.sqrt(math.hypot(1.0, float(np.max(work.of_rows[0]))))
        reach = np.where(w > 0.0, (w + largest) * _invert(work.distance), np.inf)
        if work.is_strong:
            return _Space(apply, np.vdot, start, 1j * w, scale, reach)
        direct = 1j * (scale / (1.0 + w))[:, None] * self._listen(start)
        return _Space(
            apply, np.dot, start - 1j * apply(start), 1j * w, scale / (1.0 + w), reach, direct
        )

    def _listen(self, x: NDArray[Any]) -> NDArray[Any]:
        """Return the signals (n_r,) of receivers."""
        return np.asarray(np.sum(x[self.heard] * self.ears, axis=1))

    def _factorise(self, omega: Array) -> tuple[Complex, Array]:
        """Return values (n_f, n_r) and errors (n_f,) by factors of Z, reduced by top^2, at each
        frequency.
        """
        from scipy.sparse import eye_array

        operator = self.operator
        squared = self.operator.top**2
        unit = eye_array(operator.size)
        # powers of omega, and weights of the rows, of loss factors and of dashpots
        losses = (self.damping.losses, self.damping.times)
        powers = [power for power, weights in enumerate(losses) if np.any(weights)]
        matrices: list[Any] = [operator.matrix, *(operator.weigh(losses[n]) for n in powers)]
        matrix, ones, elastic, *lossy = share_places(
            [unit, *(matrix / squared for matrix in matrices)]
        )
        analysis = Analysis(matrix)
        drives = [drive / squared for drive in self.drives]
        values = np.zeros((omega.size, len(self.heard)), complex)
        error = np.zeros(omega.size)
        for row, w in enumerate(omega.tolist()):
            entries = elastic - w**2 / squared * ones
            drive = drives[0]
            for power, lossy_entries in zip(powers, lossy, strict=True):
                factor = 1j * w**power
                if factor:
                    entries = entries + factor * lossy_entries
                    drive = drive + factor * drives[1 + power]
            matrix.data = entries
            drive = drive.astype(matrix.dtype)
            x = np.zeros(operator.size, matrix.dtype)
            heard = values[row]
            try:
                factors = analysis.factorise(matrix)
                for solution in range(_SOLUTIONS):
                    change = factors.solve(drive - matrix @ x)
                    x += change
                    previous = heard
                    heard = self._listen(x)
                    loudest = np.max(np.abs(heard)) or 1.0
                    error[row] = np.max(np.abs(heard - previous)) / loudest
                    if solution and error[row] <= TOLERANCE:
                        break
                # the entries of Z, and omega, have the rounding of a float
                sizes = np.abs(matrix.diagonal()) + 2.0 * w**2 / squared
                rounded = factors.solve(np.finfo(float).eps * sizes * x)
                error[row] += np.max(np.abs(self._listen(rounded))) / loudest
            except RuntimeError:  # exactly singular
                raise _explain_resonance(w) from None
            if not np.linalg.norm(change) <= _UNKNOWN * np.linalg.norm(x):
                raise _explain_resonance(w)
            values[row] = heard
        return values, error

    def _follow(self, work: ResponseWork, most: float) -> tuple[Complex, Array, int]:
        """Return values and errors by a Krylov space, and the number of its steps; errors are
        infinite where no value is found.
        """
        from scipy.linalg.blas import daxpy, zaxpy

        omega = work.omega
        tolerance = work.tolerance
        space = self._make_space(work)
        direct = np.broadcast_to(space.direct, (omega.size, len(self.heard)))
        values = np.zeros((omega.size, len(self.heard)), complex)
        error = np.zeros(omega.size)
        if not np.any(space.start):
            return values, error, 0
        error[:] = np.inf
        add: Any = zaxpy if np.iscomplexobj(space.start) else daxpy
        size = np.sqrt(space.product(space.start, space.start))
        loudest = float(np.max(np.linalg.norm(self.ears, axis=1)))
        previous = np.zeros_like(space.start)
        current = space.start / size
        # the matrix by its columns, above, on and below the diagonal; the signals of vectors
        bands = np.zeros((3, _FIRST), complex)
        signals = np.zeros((_FIRST, len(self.heard)), current.dtype)
        # for each frequency the last pivot, the last entry of the solution, and the residual at
        # which the next solution is tried
        pivot = np.ones(omega.size, complex)
        last_entry = np.ones(omega.size)
        trial = np.full(omega.size, _FIRST_TRIAL)
        active = np.isfinite(space.bound)
        below = 1.0
        largest = 0.0
        growth = 1.0
        for step in range(1, 1 + math.ceil(min(2.0 * most, _MOST))):
            if step > len(signals):
                bands = np.pad(bands, ((0, 0), (0, step - 1)))
                signals = np.pad(signals, ((0, step - 1), (0, 0)))
            signals[step - 1] = self._listen(current)
            following = space.apply(current)
            above = space.product(previous, following)
            following = add(previous, following, a=-above)
            diagonal = space.product(current, following)
            following = add(current, following, a=-diagonal)
            pivot = diagonal - space.shifts - above * below / pivot
            quotient = np.abs(below / np.where(pivot == 0.0, np.finfo(float).tiny, pivot))
            last_entry = np.minimum(last_entry * quotient, _LOST)
            below = np.sqrt(space.product(following, following))
            length = math.sqrt(np.vdot(following, following).real)
            bands[:, step - 1] = above, diagonal, below
            largest = max(largest, length, abs(diagonal))
            is_complete = length <= _COMPLETE * largest
            if not is_complete and abs(below) <= _DEGENERATE * length:
                break
            if not is_complete:
                growth = max(growth, (length / abs(below)) ** 2)
            is_tried = active & ((length * last_entry <= trial) | is_complete)
            for number in np.flatnonzero(is_tried):
                solutions = _solve_tridiagonal(bands[:, :step], space.shifts[number], largest)
                solution, rounded = size * space.scale[number] * (solutions @ signals[:step])
                solution = solution + direct[number]
                values[number] = solution
                residual = 0.0 if is_complete else abs(size) * length * float(last_entry[number])
                bound = abs(space.scale[number]) * loudest * residual * space.bound[number]
                heard = float(np.max(np.abs(solution))) or bound or 1.0
                cut = bound / heard
                rounding = np.finfo(float).eps * math.sqrt(step) * growth
                error[number] = rounding + np.max(np.abs(rounded)) / heard + cut
                # before receivers hear anything nothing is known
                least = _ROUNDING * abs(size) * growth if np.any(solution) else 0.0
                active[number] = not is_complete and cut > tolerance and residual > least
                trial[number] = 0.0
                if active[number]:
                    reduction = max(0.5 * tolerance / cut, _NEXT_TRIAL)
                    trial[number] = residual / abs(size) * reduction
            if is_complete or not np.any(active & (last_entry < _LOST)):
                break
            previous = current
            current = following
            current /= below
        error[active] = np.inf
        return values, error, step


def _solve_tridiagonal(bands: Complex, shift: complex, largest: float) -> Complex:
    """Return two solutions (2, n) of a tridiagonal matrix less its ``shift``: y for the first unit
    vector, and for the rounding of the matrix times y.

    ``bands`` (3, n) are the entries above, on and below the diagonal, column by column; ``largest``
    is the greatest entry.
    """
    from scipy.linalg import solve_banded

    matrix = bands.copy()
    matrix[1] -= shift
    unit = np.eye(1, bands.shape[1], dtype=complex)[0]
    y = solve_banded((1, 1), matrix, unit, check_finite=False)
    rounding = np.finfo(float).eps * largest * y
    return np.stack([y, solve_banded((1, 1), matrix, rounding, check_finite=False)])


def _invert(values: NDArray[Any]) -> NDArray[Any]:
    """Return one over values; infinite of zeros."""
    inverse = np.full(values.shape, np.inf, values.dtype)
    return np.asarray(np.divide(1.0, values, out=inverse, where=values != 0.0))


def _explain_resonance(omega: float) -> InputError:
    fault = f"the response at {write_quantity(omega / (2.0 * math.pi), 'Hz', 6)} has no bound"
    why = "The network has a mode of this frequency that loses no energy"
    return InputError(fault, why, "Give a damping or a loss_factor, or another frequency")
