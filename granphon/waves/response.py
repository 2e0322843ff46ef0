"""The response of a network at given frequencies: receptance, mobility, and what a moved wall hands on.

With forces F exp(i omega t) on balls, mass-weighted motions x = M^1/2 u obey Z x = M^-1/2 F,

    Z(omega) = D(omega) - omega^2,    D(omega) = A^T (1 + i eta + i omega tau) A + static forces,

with the damping of :mod:`granphon.dynamics.damping`; a wall that is moved pulls at the balls that touch it with the same
springs and dashpots. There are two ways to solve it.

Directly: sparse LU factors of Z at each frequency, in an order of the motions that is found once. Further solutions, of what
is left, mend the first until they change it no more; the last change is the error.

By one Krylov space for all frequencies, of the source and a matrix H that does not depend on them: the process of Lanczos
turns H into a tridiagonal matrix on the vectors that it makes of the source, and the shifted systems of all frequencies are
solved there (R. W. Freund, in Numerical Linear Algebra, de Gruyter, 1993). Of the vectors only the signals of receivers are
kept. If all contacts are damped alike, Z = s (D - z) with a number s and z = omega^2/s, and H is D. Else H is that of
velocities v = x' and deformations y = (1 + i eta)^1/2 A x, with which the equations of motion are of first order,

    (i omega + ((A^T tau A, A^T (1 + i eta)^1/2), (-(1 + i eta)^1/2 A, 0))) (v, y) = (M^-1/2 F, 0).

This H is symmetric in the product v.v - y.y, which has either sign, so that the vectors are of square one or minus one (or,
with loss factors, complex). A static force adds deformations of imaginary stiffness^1/2.

What is left has the norm of the next vector times the last coefficient. With g the least eta + omega tau of all contacts,
|Z^-1| is at most one over the distance of omega^2 from all d (1 + i g'), d >= 0 and g' >= g, which bounds the error. Less
damping takes more steps. They go on until they have cost as much as factors at the frequencies that are left.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.sparse_matrices import factorise
from granphon.base.errors import ConvergenceError, InputError, brief
from granphon.base.results import Result
from granphon.base.scales import write_quantity
from granphon.base.text import counted
from granphon.base.validation import finite_array, positive
from granphon.dynamics.damping import ContactDamping
from granphon.networks.network import ContactNetwork
from granphon.waves.modes import LARGEST_FACTORS, PIVOT
from granphon.waves.operator import WaveOperator
from granphon.waves.pulses import Course, read_balls, read_push, read_vector

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.intp]
#: what may be asked for, and its unit
QUANTITIES = {"displacement": "m/N", "velocity": "m/(N s)", "transmissibility": "1"}
#: ways to solve
METHODS = ("direct", "krylov")
#: motions up to which factors are always taken, as they lose no digits
_FEW = 2_000
#: work of the factors at a frequency, in steps of Lanczos, for balls on a line, in a plane and in space: c n^p of n motions
_FACTORS = {1: (30.0, 0.0), 2: (6.0, 0.5), 3: (0.6, 1.0)}
#: bound of the error of a response, over the largest of its frequency, with which it counts as found
TOLERANCE = 1e-9
#: root of the square of a vector, in the product that has either sign, over its norm, up to which nothing follows from it
_DEGENERATE = 1e-4
#: steps after which Lanczos is looked at first, and growth of their number to the next time
_FIRST, _GROWTH = 64, 1.15
#: most steps where factors are too large
_MOST = 100_000
#: norm of what is left in a step, over the largest, at which the space holds all that D makes of the source
_COMPLETE = 1e-13
#: solutions by the same factors, of which each mends the one before
_SOLUTIONS = 4
#: error above which a response is told to be unsure, and part of all motions by which a solution is mended if it is none
_UNSURE, _UNKNOWN = 1e-6, 1e-2
#: part of the source that is left by Lanczos, from which on rounding is all that is left
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False, repr=False)
class Response(Result):
    """Complex amplitudes of receivers in a steady motion exp(i omega t); ``np.asarray`` of it is ``values``.

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    values : (n_f, n_r) amplitude of each receiver over that of the source: m/N, m/(N s) or 1. A phase below zero lags.
    quantity : "displacement" (receptance), "velocity" (mobility) or "transmissibility".
    sources : (n_s,) balls that are pushed, each with the same force, or bodies that are moved.
    pushes : (n_s, 3) unit vectors along which they are.
    receivers : (n_r,) balls that are heard.
    directions : (n_r, 3) unit vectors along which they are.
    error : (n_f,) error of the values at each frequency, over the largest of them.
    factorisations : number of frequencies whose values were found by factors of the matrix.
    steps : number of steps of the Krylov space by which the others were found; 0 without any.
    warnings : one sentence for the frequencies whose error is above 1e-6, as next to modes without damping.
    """

    units = {"frequencies": "Hz"}
    _shapes = {
        "frequencies": "f", "values": "f r", "sources": "s", "pushes": "s 3", "receivers": "r", "directions": "r 3",
        "error": "f",
    }  # fmt: skip
    _notebook_fields = ("method",)

    frequencies: Array
    values: NDArray[np.complex128]
    quantity: str
    sources: Index
    pushes: Array
    receivers: Index
    directions: Array
    error: Array
    factorisations: int
    steps: int
    warnings: tuple[str, ...] = ()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.values, dtype)

    def _field_units(self) -> dict[str, str]:
        return {**self.units, "values": QUANTITIES[self.quantity]}

    @property
    def magnitude(self) -> Array:
        """(n_f, n_r) in m/N, m/(N s) or 1."""
        return np.abs(self.values)

    @property
    def phase(self) -> Array:
        """(n_f, n_r) rad, without jumps by 2 pi from one frequency to the next; the first is between -pi and pi."""
        return np.unwrap(np.angle(self.values), axis=0)

    @property
    def coherent(self) -> NDArray[np.complex128]:
        """(n_f,) mean over the receivers, as that of a plane."""
        return np.asarray(np.mean(self.values, axis=1))

    @property
    def peaks(self) -> tuple[Peaks, ...]:
        """For each receiver its peaks, each that of a mode over a constant background: frequencies, heights, Q factors."""
        return tuple(find_peaks(self.frequencies, one) for one in self.values.T)

    @property
    def method(self) -> str:
        """How it was found, in words."""
        krylov = len(self.frequencies) - self.factorisations
        parts = [f"{counted(self.factorisations, 'frequency', 'frequencies')} by factors of the matrix"] * bool(
            self.factorisations
        )
        if krylov:
            parts.append(f"{counted(krylov, 'frequency', 'frequencies')} by a Krylov space of {counted(self.steps, 'step')}")
        return ", ".join(parts)

    @property
    def labelled(self) -> dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]:
        """What ``xarray.Dataset`` takes: dimensions, numbers and units of magnitude, phase, error and balls."""
        unit = QUANTITIES[self.quantity]
        return {
            "frequency": (("frequency",), self.frequencies, {"units": "Hz"}),
            "magnitude": (("frequency", "receiver"), self.magnitude, {"units": unit, "long_name": self.quantity}),
            "phase": (("frequency", "receiver"), self.phase, {"units": "rad"}),
            "error": (("frequency",), self.error, {"units": "1"}),
            "receiver": (("receiver",), np.arange(len(self.receivers)), {}),
            "ball": (("receiver",), self.receivers, {}),
        }


def read_frequencies(given: ArrayLike) -> Array:
    """Return frequencies (n_f,), Hz, ascending from zero or above; raises InputError for others."""
    found = np.atleast_1d(finite_array("frequencies", given, "Hz", "zero or above"))
    if found.ndim != 1 or np.any(np.diff(found) <= 0.0):
        why = "They are a list" if found.ndim != 1 else "Each is to be above the one before"
        raise InputError("the frequencies are not sorted", why, "Give np.unique(frequencies)")
    return found


class Peaks(NamedTuple):
    """Peaks of a magnitude over frequency.

    Attributes
    ----------
    frequencies : (n,) Hz.
    heights : (n,) magnitude at the peaks, in the unit of the response.
    quality : (n,) Q factors, a ratio without a unit; nan if the peak is not resolved.
    """

    frequencies: Array
    heights: Array
    quality: Array


def find_peaks(frequencies: Array, values: Complex) -> Peaks:
    """Return the peaks of the magnitude of a response (n_f,) inside of the ascending frequencies (n_f,), Hz.

    B + R/(p - f^2), a mode over a constant background, passes through the highest value and its two neighbours. Its pole p
    gives the frequency (Re p)^1/2, the height there, and Q = Re p / Im p. Where the width of the line is below half the step
    of the frequencies, or the pole is farther away than its width, the peak is the highest value, and Q is not known.
    """
    magnitude = np.abs(values)
    at = 1 + np.flatnonzero((magnitude[1:-1] > magnitude[:-2]) & (magnitude[1:-1] >= magnitude[2:]))
    x, h = (np.array([one[at + step] for step in (-1, 0, 1)]) for one in (frequencies**2, values))
    with np.errstate(divide="ignore", invalid="ignore"):  # two equal values have no pole
        ratio = (h[1] - h[0]) / (h[2] - h[1]) * (x[2] - x[1]) / (x[1] - x[0])
        pole = (x[2] - ratio * x[0]) / (1.0 - ratio)
        strength = (h[2] - h[0]) * (pole - x[0]) * (pole - x[2]) / (x[2] - x[0])
        top = np.abs(h[1] - strength / (pole - x[1]) + strength / (1j * pole.imag))
        known = (pole.imag >= 0.25 * (x[2] - x[0])) & (
            np.abs(pole.real - x[1]) <= np.maximum(pole.imag, 0.5 * (x[2] - x[0]))
        )
        quality = np.where(known, pole.real / pole.imag, np.nan)
    heights = np.where(known, np.maximum(top, magnitude[at]), magnitude[at])
    return Peaks(np.sqrt(np.where(known, pole.real, x[1])), heights, quality)


def require_places(network: ContactNetwork, name: str, given: Any, moved: bool, **options: Any) -> None:
    """Raise InputError unless a network has the places of a source or receiver, as arguments of ``Waves.response``."""
    _Places(network, **options).find(name, given, held=moved)


def find_response(
    operator: WaveOperator, frequencies: ArrayLike, source: Any, receiver: Any, damping: Any = 0.0,
    loss_factor: Any = 0.0, *, quantity: str = "displacement", direction: ArrayLike | None = None,
    polarisation: str | ArrayLike = "longitudinal", distance: float | None = None, method: str | None = None,
    tolerance: float = TOLERANCE,
) -> Response:  # fmt: skip
    """Return the response of a network; see :meth:`granphon.waves.waves.Waves.response`."""
    network, hertz = operator.network, read_frequencies(frequencies)
    for name, word, known in (("quantity", quantity, tuple(QUANTITIES)), ("method", method, (None, *METHODS))):
        if word not in known:
            raise InputError(f"{name} is {brief(word)}", mend=f"Use {', '.join(filter(None, known))}")
    tolerance = positive("tolerance", tolerance, "")
    damped, places = ContactDamping.of(network, damping, loss_factor), _Places(network, direction, polarisation, distance)
    moved = quantity == "transmissibility"
    sources, pushes = places.find("source", source, held=moved)
    receivers, directions = places.find("receiver", receiver)
    axes, count = list(operator.motions.translations), operator.motions.count
    # the source: what does not depend on the damping, and what the loss factors and the dashpots add
    amplitude = np.zeros((network.n_balls, count))
    np.add.at(amplitude[:, : len(axes)], sources, pushes[:, axes])
    if moved:
        drives = [operator.pull(amplitude), *(operator.pull(amplitude, one) for one in (damped.losses, damped.times))]
    else:
        pushed = operator.vector(amplitude[operator.balls] / np.sqrt(network.masses[operator.balls])[:, None])
        drives = [pushed, np.zeros(operator.size), np.zeros(operator.size)]
    row = np.full(network.n_balls, -1)
    row[operator.balls] = np.arange(operator.balls.size)
    heard = operator.values(np.arange(operator.size))[row[receivers], : len(axes)]
    ears = directions[:, axes] / np.sqrt(network.masses[receivers])[:, None]
    problem = _Problem(operator, damped, drives, heard, ears, moved, operator.stretch(amplitude) if moved else np.zeros(0))
    values, error, factored, steps = problem.solve(2.0 * math.pi * hertz, method, tolerance)
    if quantity == "velocity":
        values = values * (2j * math.pi * hertz)[:, None]
    warnings: tuple[str, ...] = ()
    unsure = np.flatnonzero(error > _UNSURE)
    if unsure.size:
        worst = unsure[np.argmax(error[unsure])]
        where = f"{counted(unsure.size, 'frequency', 'frequencies')}, up to {error[worst]:.1e} at {hertz[worst]:.6g} Hz"
        why = "hardly anything reaches the receivers, or a mode hardly loses energy"
        most = np.max((error * np.max(np.abs(values), axis=1))[error >= 1.0], initial=0.0)
        if most > 0.0:
            below = write_quantity(float(most), QUANTITIES[quantity], 2)
            why += f"; where it is above 1, all that is known is that they are below {below}"
        warnings = (f"the error of the response is above {_UNSURE:g} at {where}: {why}.",)
    return Response(
        hertz, values, quantity, sources, pushes, receivers, directions, error, factored, steps, warnings
    )  # fmt: skip


# -- sources and receivers ---------------------------------------------------------------------------------------------


class _Places:
    """Where a network is pushed and heard; the arguments are those of ``Waves.response``."""

    def __init__(self, network: ContactNetwork, direction: Any, polarisation: Any, distance: float | None) -> None:
        self.network = network
        if direction is None:  # across the periods, if there is a direction across them
            free = [axis for axis in range(network.dimension) if not np.any(network.cell[:, axis])]
            direction = np.eye(3)[free[0] if free else 0]
        self.along = read_vector("direction", direction, network.dimension)
        self.polarisation = polarisation
        self.distance = None if distance is None else positive("distance", distance, "m")

    def find(self, name: str, given: Any, held: bool = False) -> tuple[Index, Array]:
        """Return balls (n,) and unit vectors (n, 3) of a source or receiver, or of a list of these."""
        network, several = self.network, given if isinstance(given, list) else [given]
        axes, balls, vectors = list(network.ball_motions.translations), [np.zeros(0, int)], [np.zeros((0, 3))]
        for one in several:
            if isinstance(one, str) and one == "plane":
                found, vector = self._find_plane(name, held), read_push(network, self.along, self.polarisation)
            elif isinstance(one, tuple) and len(one) == 2:
                found, vector = read_balls(name, one[0], network), self._read_direction(one[1])
            else:
                mend = "Give (ball, direction), (balls, direction), 'plane', or a list of these"
                raise InputError(f"the {name} is {brief(one)}", mend=mend)
            if abs(np.linalg.norm(vector[axes]) - 1.0) > 1e-9:
                moves, shown = " and ".join("xyz"[axis] for axis in axes), ", ".join(f"{x:.6g}" for x in vector)
                raise InputError(f"the {name} is along ({shown})", f"Balls move along {moves} only")
            balls.append(found)
            vectors.append(np.tile(vector, (len(found), 1)))
        every = np.concatenate(balls)
        if not every.size:
            raise InputError(f"there is no {name}", mend="Give (ball, direction), or a list of these")
        wrong = every[network.moving[every] == held]
        if wrong.size:
            what = f"ball {wrong[0]} of the {name} {'moves' if held else 'does not move'}"
            why = "A transmissibility is that of a wall or floor" if held else "It is held: its mass is infinite"
            mend = (
                "Give a body of infinite mass" if held else "Ask for the transmissibility, to move it" * (name == "source")
            )
            raise InputError(what, why, mend)
        return every, np.concatenate(vectors)

    def _read_direction(self, given: Any) -> Array:
        if isinstance(given, str):
            if given not in ("x", "y", "z"):
                raise InputError(f"a direction is {brief(given)}", mend="Use x, y, z, or a vector")
            return np.asarray(np.eye(3)["xyz".index(given)])
        return read_vector("direction", given, self.network.dimension)

    def _find_plane(self, name: str, held: bool) -> Index:
        """Return the first plane of balls along the direction, or that of receivers."""
        network, course = self.network, Course.along(self.network, self.along)
        if held:
            still = np.flatnonzero(~network.moving)
            if not still.size:
                raise InputError("no body of this network is held", mend="Cut it with clamped edges or a floor")
            heights = course.heights[still]
            return np.asarray(still[heights <= np.min(heights) + 0.5 * course.spacing])
        places = course.places[network.moving]
        first = float(np.min(places))
        if name == "source":
            return course.find_plane(first, name)
        if self.distance is not None:
            return course.find_plane(course.find_place(course.find_plane(first, name)) + self.distance, name)
        if math.isfinite(course.period):
            what = "the receiving plane has no distance, and the network repeats along the direction"
            raise InputError(what, mend="Give the distance, m, from the first plane")
        return course.find_plane(float(np.max(places)), name)


# -- solutions ----------------------------------------------------------------------------------------------------------


class _Space(NamedTuple):
    """A matrix H that is symmetric in a product of two vectors, which has either sign, and (H - shift) x = start.

    ``scale`` (n_f,) times x is heard. The error of scale x is at most scale times ``bound`` (n_f,) times what is left.
    """

    apply: Callable[[NDArray[Any]], NDArray[Any]]
    product: Callable[[NDArray[Any], NDArray[Any]], Any]
    start: NDArray[Any]
    shifts: NDArray[Any]
    scale: NDArray[Any]
    bound: Array


@dataclass(frozen=True, eq=False)
class _Problem:
    """Z x = source, and what of x is heard.

    ``drives`` are the parts of the source without damping, by loss factors and, over omega, by dashpots; ``moved`` says that
    it is a wall, which makes ``stretched`` of the rows of A. ``heard`` and ``ears`` (n_r, axes) are places in x, and their
    weights.
    """

    operator: WaveOperator
    damping: ContactDamping
    drives: Sequence[Array]
    heard: Index
    ears: Array
    moved: bool
    stretched: Array

    def solve(self, omega: Array, method: str | None, tolerance: float) -> tuple[Complex, Array, int, int]:
        """Return values and errors at ``omega`` (n_f,), rad/s, the number of factorisations, and of steps of Lanczos."""
        operator, n = self.operator, self.operator.size
        dimension, unfit = operator.network.dimension, self._explain_unfit()
        if unfit and method == "krylov":
            raise InputError("no Krylov space serves all frequencies", unfit, "Use the direct method")
        values, error = np.zeros((omega.size, len(self.heard)), complex), np.full(omega.size, np.inf)
        fits, steps = n <= LARGEST_FACTORS[dimension], 0
        if not unfit and method != "direct" and (n > _FEW or method == "krylov"):
            factor, power = _FACTORS[dimension]
            price = factor * n**power if fits and method is None else None
            space = self._make_first_order(omega) if self.even is None else self._make_even(omega, self.even)
            values, error, steps = self._follow_lanczos(space, price, tolerance)
            # what arrives deep in a gap is less than the rounding of a Krylov space; factors have all of its digits
            deep = np.flatnonzero(np.isfinite(error) & (error > max(_UNSURE, tolerance)))
            if price is not None and deep.size * price <= _MOST:
                error[deep] = np.inf
        left = np.flatnonzero(np.isinf(error))
        if left.size and (method == "krylov" or not fits):
            hardest = write_quantity(float(omega[left[0]]) / (2.0 * math.pi), "Hz", 4)
            space_of = f"a Krylov space of {counted(steps, 'step')}"
            what = f"the response of {n:,} motions at {hardest} is not found by {space_of}"
            why = unfit or (
                "In a large network modes lie close together, and with little damping the response is that of each by itself"
            )
            raise ConvergenceError(what, why, "Give more damping to all contacts, or take a smaller network")
        if left.size:
            values[left], error[left] = self._factorise(omega[left])
        return values, error, int(left.size), steps if left.size < omega.size else 0

    @cached_property
    def even(self) -> tuple[float, float] | None:
        """(eta, tau) where all contacts are damped alike, and no static forces act."""
        return self.damping.find_even(self.operator.network)

    def _explain_unfit(self) -> str:
        """Tell why no Krylov space serves all frequencies; empty if one does."""
        if self.even is None and self.operator.whole is not None:
            return "Static tangential forces act, which have no potential"
        lossless = self.even is None and np.any((np.sum(self._of_rows, axis=0) == 0.0) & (self.operator.of_rows() > 0.0))
        return "Some contacts lose energy, and others lose none" if lossless else ""

    @cached_property
    def _of_rows(self) -> Array:
        """(2, rows) eta and tau, 1 and s, of the rows of A; zero of static forces."""
        return np.stack([self.operator.of_rows(one) for one in (self.damping.losses, self.damping.times)])

    def _make_even(self, omega: Array, even: tuple[float, float]) -> _Space:
        """Return D over top^2, whose shifts are those of all frequencies."""
        operator, squared = self.operator, self.operator.top**2
        scale = 1.0 + 1j * (even[0] + omega * even[1])
        shifts = omega**2 / scale / squared
        distance = np.hypot(shifts.imag, np.maximum(np.maximum(shifts.real - 1.0, -shifts.real), 0.0))
        return _Space(
            lambda x: (operator @ x) / squared, np.dot, self.drives[0], shifts,
            (1.0 if self.moved else 1.0 / scale) / squared * np.ones(omega.size), _invert(distance),
        )  # fmt: skip

    def _make_first_order(self, omega: Array) -> _Space:
        """Return H of velocities and deformations, over the top frequency; static forces are further rows of A."""
        operator, n, (losses, times) = self.operator, self.operator.size, self._of_rows
        root, w = operator.full_root / operator.top, omega / operator.top
        back, stiff, viscous = root.T.tocsr(), operator.of_rows(), times * operator.top
        is_real = not np.any(losses) and np.all(stiff > 0.0)
        spring = np.ones(stiff.size) if is_real else np.sqrt(stiff + 1j * losses)

        def apply(x: NDArray[Any]) -> NDArray[Any]:
            strain = root @ x[:n]
            return np.concatenate([-(back @ (spring * x[n:] + viscous * strain)), spring * strain])

        def product(x: NDArray[Any], y: NDArray[Any]) -> Any:
            return np.dot(x[:n], y[:n]) - np.dot(x[n:], y[n:])

        if self.moved:  # (H - i w) (v, y) = i omega (-A^T tau s, spring s) for walls that stretch contacts by s
            start = np.concatenate([-(back @ (viscous * self.stretched)), spring * self.stretched])
        else:
            start = np.concatenate([self.drives[0], np.zeros(stiff.size)])
        least = np.min((losses + omega[:, None] * times)[:, stiff > 0.0], axis=1)
        distance = np.maximum(w**2 * least / np.hypot(1.0, least), w**2 - 1.0)
        scale = -1.0 / operator.top * (np.ones(w.size) if self.moved else _invert(1j * omega))
        reach = (w + float(np.max(np.abs(spring)))) * _invert(distance)
        return _Space(apply, product, start, 1j * w, scale, np.where(w > 0.0, reach, np.inf))

    def _listen(self, x: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(np.sum(x[self.heard] * self.ears, axis=1))

    def _factorise(self, omega: Array) -> tuple[Complex, Array]:
        """Return values (n_f, n_r) and errors (n_f,) by factors of Z at each frequency."""
        from scipy.sparse import csc_array, eye_array

        operator, squared = self.operator, self.operator.top**2
        # reduced by top^2; the order of the motions is that of least fill; all parts have entries at the same places
        losses, times = ((operator.weigh(one) if np.any(one) else None) for one in (self.damping.losses, self.damping.times))
        place = factorise(operator.matrix / squared + eye_array(operator.size)).perm_c
        order = np.argsort(place)
        given: list[Any] = [operator.matrix, losses, times, squared * eye_array(operator.size, format="csr")]
        parts = [None if one is None else (one / squared)[order][:, order].tocsc().sorted_indices() for one in given]
        shape: Any = sum(abs(one).astype(bool) for one in parts if one is not None).tocsc().sorted_indices()
        entries = [None if one is None else _spread(one, shape) for one in parts]
        drives = [one[order] / squared for one in self.drives]
        values, error = np.zeros((omega.size, len(self.heard)), complex), np.zeros(omega.size)
        for row, w in enumerate(omega.tolist()):
            data, drive = entries[0] - w**2 / squared * entries[3], drives[0]
            for part, more, factor in ((entries[1], drives[1], 1j), (entries[2], drives[2], 1j * w)):
                if part is not None and factor:
                    data, drive = data + factor * part, drive + factor * more
            matrix = csc_array((data, shape.indices, shape.indptr), shape=shape.shape)
            drive, x, found = drive.astype(matrix.dtype), np.zeros(operator.size, matrix.dtype), values[row]
            try:
                factors = factorise(matrix, pivot=PIVOT, order="NATURAL")
                for solution in range(_SOLUTIONS):
                    x += (change := factors.solve(drive - matrix @ x))
                    before, found = found, self._listen(x[place])
                    error[row] = np.max(np.abs(found - before)) / (np.max(np.abs(found)) or 1.0)
                    if solution and error[row] <= TOLERANCE:
                        break
            except RuntimeError:  # exactly singular
                raise _explain_resonance(w) from None
            if not np.linalg.norm(change) <= _UNKNOWN * np.linalg.norm(x):
                raise _explain_resonance(w)
            values[row] = found
        return values, error

    def _follow_lanczos(self, space: _Space, price: float | None, tolerance: float) -> tuple[Complex, Array, int]:
        """Return values, errors (infinite of what is not found) and the number of steps.

        It ends when these have cost as much as factors at the frequencies that are left, each at the ``price`` of so many
        steps; without one after :data:`_MOST`.
        """
        from scipy.linalg import solve_banded

        values, error = np.zeros((space.shifts.size, len(self.heard)), complex), np.zeros(space.shifts.size)
        square = space.product(space.start, space.start)
        if not np.any(space.start):
            return values, error, 0
        error[:] = np.inf
        size, loud = math.sqrt(abs(square)), float(np.max(np.linalg.norm(self.ears, axis=1)))
        left, step, growth = np.flatnonzero(np.isfinite(space.bound)), 0, 1.0  # without damping no end is sure to come
        # the square of each vector has the size one, and a sign; where it is far from the norm, rounding grows
        before, current, across = np.zeros(1), space.start / size, 0.0
        sign, last = square / abs(square), 1.0
        below, diagonal, above, signals, check = list[float](), list[Any](), list[Any](), list[NDArray[Any]](), _FIRST
        while left.size and step < (_MOST if price is None else price * left.size):
            step += 1
            signals.append(self._listen(current))
            following = space.apply(current)
            following -= (across * sign / last) * before
            diagonal.append(space.product(current, following) / sign)
            following -= diagonal[-1] * current
            square = space.product(following, following)
            across, length = math.sqrt(abs(square)), float(np.linalg.norm(following))
            complete = length <= _COMPLETE * max(*below, length, abs(diagonal[0]))
            below.append(across)
            if not complete and across <= _DEGENERATE * length:
                break
            growth = max(growth, (length / across) ** 2 if across else 1.0)
            last, sign = sign, square / abs(square) if across else sign
            above.append(across * sign / last)
            if step >= check or complete:
                check = math.ceil(step * _GROWTH)
                bands = np.zeros((3, step), complex)
                bands[0, 1:], bands[2, :-1] = above[:-1], below[:-1]
                start, sounds, unsolved = np.eye(1, step)[0], np.array(signals), []
                for place in left:
                    bands[1] = np.array(diagonal) - space.shifts[place]
                    y = solve_banded((1, 1), bands, start, check_finite=False)
                    found = size * space.scale[place] * (y @ sounds)
                    rest = 0.0 if complete else size * length * abs(y[-1]) * space.bound[place]
                    least = abs(space.scale[place]) * loud * rest
                    values[place] = found
                    error[place] = np.finfo(float).eps * step * growth + least / (
                        float(np.max(np.abs(found))) or least or 1.0
                    )
                    if error[place] > tolerance and rest > _ROUNDING * size * growth:
                        unsolved.append(place)
                left = np.array(unsolved, int)
            if complete:
                break
            before, current = current, following / across
        error[left] = np.inf
        return values, error, step


def _spread(part: Any, shape: Any) -> NDArray[Any]:
    """Return the entries of a matrix at the places of another, which has all of its places; both in columns, sorted."""
    own, every = (
        np.repeat(np.arange(one.shape[1]), np.diff(one.indptr)) * one.shape[0] + one.indices for one in (part, shape)
    )
    entries = np.zeros(every.size, part.dtype)
    entries[np.searchsorted(every, own)] = part.data
    return entries


def _invert(values: NDArray[Any]) -> NDArray[Any]:
    """Return one over values; infinite of zeros."""
    return np.asarray(np.divide(1.0, values, out=np.full(values.shape, np.inf, values.dtype), where=values != 0.0))


def _explain_resonance(omega: float) -> InputError:
    what = f"the response at {write_quantity(omega / (2.0 * math.pi), 'Hz', 6)} has no bound"
    why = "The network has a mode of this frequency that loses no energy"
    return InputError(what, why, "Give a damping or a loss_factor, or another frequency")
