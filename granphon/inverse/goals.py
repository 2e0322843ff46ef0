"""What a design is to reach: a wide gap, given frequencies, a low velocity, a response.

A goal gives a number of a network, and its derivatives by the fields of
:class:`granphon.Sensitivities`. The edges of a gap are a largest and a smallest frequency over
branches and wave vectors, which jump from one to another as the network changes. The search takes
smooth ones: t log sum exp(f/t) over all of them lies above the largest by t times the logarithm of
their number at most, and has derivatives everywhere (the Kreisselmeier-Steinhauser function, 1979).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, brief
from granphon.base.validation import (
    finite_array,
    grid_numbers,
    not_negative,
    positive,
    whole_number,
)
from granphon.dynamics.sensitivities import list_inertias
from granphon.media import cost as costs
from granphon.networks.network import ContactNetwork
from granphon.observables.velocities import sound_velocities
from granphon.phonons.phonons import Phonons
from granphon.waves.modes import NetworkModes
from granphon.waves.response import QUANTITIES
from granphon.waves.waves import Waves

#: names of the derivatives that goals have
NAMES = (
    "normal_stiffness",
    "shear_stiffness",
    "torsion",
    "bending",
    "mass",
    "inertia",
    "normal_force",
    "on_site",
)
#: points of the mesh of a gap along each of one, two and three periods
_MESHES = (48, 12, 6)
#: most points of a mesh along each period
_MOST_POINTS = 1000
#: how much finer the mesh is on which a gap is certified
FINER = 4
#: smoothing t of a gap, over the top frequency
_SMOOTH = 2e-3
#: weight of a frequency in a smooth edge from which its derivatives count
_LEAST_WEIGHT = 1e-9
#: misfit, in standard deviations, or relative without these, above which frequencies are not
#: matched
_FAR = 3.0
_FAR_RELATIVE = 1e-3
#: overlap of a measured shape with that of a mode from which both are alike
_ALIKE = 0.5


class Goal(Protocol):
    """A goal of :func:`granphon.design`; an object of your own with these serves, too.

    ``largest`` says that the largest value is sought, not the smallest.
    """

    largest: bool

    def evaluate(self, network: ContactNetwork) -> tuple[float, Mapping[str, Any]]:
        """Return the value of a network, and its derivatives (n_c,), or (n,) of balls, by the names
        of :class:`granphon.Sensitivities`, those that are not zero.
        """
        ...


@dataclass(frozen=True)
class WidestGap:
    """The widest complete gap between two branches, Hz.

    Parameters
    ----------
    near : frequency, Hz: the gap is that between the branches below and above it in the network
        with which the search begins; None for the widest gap of all.
    mesh : numbers of wave vectors along each period for the search; by default 48, 12 x 12, or 6 x
        6 x 6. The gap that is found is that on a mesh four times finer.
    branches : number of branches below the gap, in place of ``near``.
    smoothing : Hz, the t of the edges; by default 2e-3 of the top frequency of the network with
        which the search begins.
    """

    near: float | None = None
    mesh: tuple[int, ...] | None = None
    branches: int | None = None
    smoothing: float | None = None
    unit = "Hz"
    largest = True

    def __post_init__(self) -> None:
        """Check the arguments that are given."""
        for name in ("near", "smoothing"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name), "Hz")
        if self.branches is not None:
            whole_number("branches", self.branches, 1)

    def choose(self, network: ContactNetwork, most: int) -> list[WidestGap]:
        """Return up to ``most`` goals of a given number of branches below the gap, the most
        promising first, for a search that begins at a ``network``.
        """
        frequencies = self._find_frequencies(Phonons(network))[1]
        tops = frequencies.max(axis=0)
        smoothing = self.smoothing or _SMOOTH * float(tops[-1])
        goal = replace(self, near=None, smoothing=smoothing)
        n_gaps = len(tops) - 1
        if not n_gaps:
            raise InputError("the network has one branch alone, and no gap between branches")
        if self.branches is not None:
            whole_number("branches", self.branches, 1, n_gaps)
            return [goal]
        bottoms = frequencies.min(axis=0)
        if self.near is not None:
            means = np.mean(frequencies, axis=0)
            n_below = int(np.count_nonzero(means < self.near))
            if n_below in (0, len(tops)):
                number = int(np.argmax(bottoms[1:] - tops[:-1]))
                low, high = sorted((float(tops[number]), float(bottoms[number + 1])))
                raise InputError(
                    f"no gap can be near {self.near:g} Hz",
                    f"Means of branches over the zone lie from {means[0]:.6g} to {means[-1]:.6g}"
                    " Hz, and gaps between branches",
                    f"Give a frequency between two of them, as near={0.5 * (low + high):.4g}, or"
                    " leave near out",
                )
            return [replace(goal, branches=n_below)]
        widths = bottoms[1:] - tops[:-1]  # of the gap above each branch, below zero where none is
        widest = np.argsort(-widths, kind="stable")[:most]
        return [replace(goal, branches=1 + int(number)) for number in widest]

    def _list_numbers(self, periods: int) -> tuple[int, ...]:
        """Return the numbers of wave vectors along the ``periods`` reciprocal vectors, given or by
        default.
        """
        default = (_MESHES[periods - 1],) * periods
        if self.mesh is None:
            return default
        example = " ".join(map(str, default))
        return grid_numbers("mesh", self.mesh, 1, _MOST_POINTS, example, periods)

    def _find_frequencies(self, phonons: Phonons) -> tuple[Array, Array]:
        """Return wave vectors (n_q, p), fractions, and frequencies (n_q, n_b), Hz."""
        numbers = self._list_numbers(phonons.lattice.periods)
        axes = [np.arange(number) / number for number in numbers]
        axes[0] = axes[0][: numbers[0] // 2 + 1]  # q and -q have the same frequencies
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(numbers))
        return points, phonons.frequencies(points)

    def evaluate(self, network: ContactNetwork) -> tuple[float, dict[str, Any]]:
        """Return the smooth width of the gap, Hz, and its derivatives (n_c,), or (n,) of balls."""
        if self.branches is None or self.smoothing is None:
            return self.choose(network, 1)[0].evaluate(network)
        phonons = Phonons(network)
        points, frequencies = self._find_frequencies(phonons)
        lower = frequencies[:, : self.branches]
        upper = frequencies[:, self.branches :]
        top, weights_below = _smooth_largest(lower, self.smoothing)
        bottom, weights_above = _smooth_largest(-upper, self.smoothing)
        weights = np.concatenate([-weights_below, weights_above], axis=1)
        slopes: dict[str, Any] = {}
        for number in np.flatnonzero(np.any(np.abs(weights) > _LEAST_WEIGHT, axis=1)).tolist():
            branches = np.flatnonzero(np.abs(weights[number]) > _LEAST_WEIGHT)
            sensitivities = phonons.sensitivities(points[number : number + 1], branches)
            _add(slopes, sensitivities, weights[number, branches])
        return -bottom - top, slopes

    def certify(self, network: ContactNetwork) -> float:
        """Return the width of the gap, Hz, on a mesh four times finer; zero of a gap that is
        closed.
        """
        if self.branches is None:
            return self.choose(network, 1)[0].certify(network)
        phonons = Phonons(network)
        numbers = self._list_numbers(phonons.lattice.periods)
        below, gaps = phonons.find_gaps([FINER * number for number in numbers])
        is_gap = below == self.branches
        return float(np.sum(np.diff(gaps[is_gap], axis=1)))

    def estimate_memory(self, network: ContactNetwork) -> float:
        """Return the memory of an evaluation, bytes."""
        lattice = Phonons(network).lattice
        n_points = math.prod(self._list_numbers(lattice.periods))
        frequencies = costs.bands(n_points, lattice.n_branches, eigenvectors=False)
        vectors = costs.bands(1, lattice.n_branches, file=False)
        return max(frequencies.working, vectors.working) + frequencies.kept

    def estimate_certificate(self, network: ContactNetwork) -> costs.Cost:
        """Return the cost of a certificate."""
        lattice = Phonons(network).lattice
        numbers = self._list_numbers(lattice.periods)
        n_points = math.prod(FINER * number for number in numbers)
        return costs.band_edges(1, n_points, lattice.n_branches, of_all=False, of_network=True)

    def judge_history(self, history: Array) -> str:
        """Return a sentence if the gap closes in the ``history`` (h,) of a search, or nothing."""
        was_open = np.maximum.accumulate(history) > 0.0
        count = int(np.count_nonzero(was_open & (history <= 0.0)))
        if not count:
            return ""
        times = f"{count} of {history.size} evaluations"
        return f"the gap closes on the way, at {times}; the widest is kept"

    def judge(self, network: ContactNetwork, value: float) -> str:
        """Return a sentence if there is no gap, or nothing."""
        if value > 0.0:
            return ""
        return f"no gap opens between branches {self.branches} and {self.branches + 1}"  # type: ignore[operator]


@dataclass(frozen=True)
class MatchFrequencies:
    """Measured frequencies: the least sum of the squares of misfits over their errors.

    Parameters
    ----------
    measured : (m,) Hz, ascending: of the lowest modes of the network that cost energy; with
        ``shapes`` in any order; or with ``q``, (n_q, b) of its branches, or (b,) at one wave
        vector, or (n_q,) of one branch.
    sigma : standard errors, Hz, a number or of the shape of ``measured``; None for errors in
        proportion to the frequencies.
    q : (n_q, p) wave vectors, fractions of the reciprocal cell.
    branches : (b,) numbers of the branches at these, from 0; the first ones by default.
    shapes : (m, n, motions) measured motions of the balls in these modes, displacements in m and
        rotations in rad, each mode in any scale: each frequency is then compared with that of the
        lowest modes whose shape overlaps most with the measured one, whatever their order.
    """

    measured: Any
    sigma: Any = None
    q: Any = None
    branches: Any = None
    shapes: Any = None
    unit = "1"
    largest = False

    def __post_init__(self) -> None:
        """Check that the shapes of the arguments agree: frequencies of modes, or a row of
        frequencies for each wave vector.
        """
        measured = finite_array("measured", self.measured, "Hz", "above zero")
        if self.sigma is not None:
            sigma = finite_array("sigma", self.sigma, "Hz", "above zero")
            if sigma.shape not in ((), measured.shape):
                fault = f"sigma has the shape {sigma.shape}, and measured {measured.shape}"
                raise InputError(fault, mend="Give one standard error, or one for each frequency")
        if self.q is None:
            self._require_modes(measured)
            return
        if self.shapes is not None:
            raise InputError("shapes are given with q", mend="Leave one of them out")
        n_points = len(np.atleast_1d(finite_array("q", self.q)))
        if measured.ndim > 1:
            fits = measured.ndim == 2 and len(measured) == n_points
        else:
            fits = n_points in (1, measured.size)
        if not fits:
            fault = (
                f"measured has the shape {measured.shape}, and there are {n_points} wave vectors"
            )
            raise InputError(fault, mend="Give a row of frequencies for each wave vector")

    def _require_modes(self, measured: Array) -> None:
        """Raise InputError unless ``measured`` are frequencies of modes, without branches."""
        if self.branches is not None:
            raise InputError("branches are given without q", mend="Give the wave vectors, q")
        if self.shapes is not None:
            shapes = finite_array("shapes", self.shapes)
            if measured.ndim != 1 or shapes.ndim != 3 or len(shapes) != len(measured):
                fault = f"shapes have the shape {shapes.shape}, and measured {measured.shape}"
                raise InputError(fault, mend="Give the motions (n, motions) of each mode")
            if not np.all(np.any(shapes, axis=(1, 2))):
                raise InputError("a shape is zero", mend="Give the motions of its balls")
            return
        if measured.ndim > 1 or np.any(np.diff(measured.ravel()) < 0.0):
            fault = f"measured is {brief(self.measured)}"
            why = "The lowest modes of a network ascend"
            raise InputError(fault, why, "Sort them, or give the wave vectors of branches, q")

    def estimate_memory(self, network: ContactNetwork) -> float:
        """Return the memory of an evaluation, bytes."""
        measured = np.asarray(self.measured)
        if self.q is None:
            cost = Waves(network).estimate("modes", measured.size)
        else:
            branches = Phonons(network).lattice.n_branches
            cost = costs.bands(measured.size, branches, file=False)
        return cost.working + cost.kept

    def find_residuals(self, network: ContactNetwork) -> tuple[Array, dict[str, Any]]:
        """Return the misfits over their errors, (m,), and their derivatives (m, ...)."""
        measured = np.asarray(self.measured, float)
        sigma = measured if self.sigma is None else self.sigma
        errors = np.broadcast_to(sigma, measured.shape).ravel()
        order: Any = slice(None)
        if self.q is None:
            modes = Waves(network).modes(measured.size)
            sensitivities: Any = modes.sensitivities
            if self.shapes is not None:
                order = self._pair(modes)[0]
        else:
            points = np.atleast_1d(self.q)
            points = points.reshape(len(points), -1)
            count = measured.size // len(points)
            branches = np.arange(count) if self.branches is None else self.branches
            sensitivities = Phonons(network).sensitivities(points, branches)
        frequencies = sensitivities.frequencies.ravel()[order]
        if frequencies.size != measured.size:
            raise InputError(
                f"{measured.size} frequencies are measured, and the goal has {frequencies.size}",
                mend="Give a frequency for each branch at each wave vector",
            )
        residuals = (frequencies - measured.ravel()) / errors
        slopes = {}
        for name in NAMES:
            values = getattr(sensitivities, name)
            if values is not None:
                rest = values.shape[sensitivities.frequencies.ndim :]
                by_row = np.nan_to_num(values.reshape(frequencies.size, *rest)[order])
                slopes[name] = (by_row.T / errors).T
        return residuals, slopes

    def _pair(self, modes: NetworkModes) -> tuple[Index, Array]:
        """Return the number (m,) of the mode that belongs to each measured shape, and their overlap
        (m,): the square of the cosine between both, weighted by masses.

        InputError for shapes of other balls or motions.
        """
        from scipy.optimize import linear_sum_assignment

        network = modes.network
        shapes = np.asarray(self.shapes, float)
        if shapes.shape[1:] != modes.vectors.shape[1:]:
            fault = f"shapes have the shape {shapes.shape}"
            raise InputError(fault, f"Modes of the network have {modes.vectors.shape}")
        inertias = np.where(network.moving[:, None], list_inertias(network), 0.0)
        rows = (np.sqrt(inertias) * shapes).reshape(len(shapes), -1)
        columns = modes.vectors.reshape(len(shapes), -1)
        cosines = (rows @ columns.T) ** 2
        overlaps = cosines / np.outer(np.sum(rows**2, axis=1), np.sum(columns**2, axis=1))
        places, numbers = linear_sum_assignment(overlaps, maximize=True)
        return numbers, overlaps[places, numbers]

    def evaluate(self, network: ContactNetwork) -> tuple[float, dict[str, Any]]:
        """Return the sum of the squares of the misfits over their errors, without a unit, and its
        derivatives (n_c,), or (n,) of balls.
        """
        residuals, slopes = self.find_residuals(network)
        doubled = {name: np.tensordot(2.0 * residuals, slope, 1) for name, slope in slopes.items()}
        return float(residuals @ residuals), doubled

    def judge(self, network: ContactNetwork, value: float) -> str:
        """Return a sentence if some frequency is not matched, or nothing."""
        residuals, _ = self.find_residuals(network)
        if self.shapes is not None:
            overlap = float(np.min(self._pair(Waves(network).modes(len(residuals)))[1]))
            if overlap < _ALIKE:
                return f"a measured shape overlaps with no mode by more than {overlap:.2g}"
        worst = float(np.max(np.abs(residuals)))
        if worst <= (_FAR_RELATIVE if self.sigma is None else _FAR):
            return ""
        unit = "of it" if self.sigma is None else "standard errors"
        return f"the goal is not reached: a measured frequency is missed by {worst:.3g} {unit}"


@dataclass(frozen=True)
class LowestVelocity:
    """The lowest velocity of sound along a direction, m/s.

    Parameters
    ----------
    direction : (p,) Cartesian, as for :func:`granphon.sound_velocities`.
    wave : number of the wave in the order of ``velocities``, ascending.
    """

    direction: ArrayLike | None = None
    wave: int = 0
    unit = "m/s"
    largest = False

    def estimate_memory(self, network: ContactNetwork) -> float:
        """Return the memory of an evaluation, bytes."""
        n_balls = int(np.count_nonzero(network.moving))
        return costs.relaxation_memory(n_balls, network.ball_motions.count, network.dimension)

    def evaluate(self, network: ContactNetwork) -> tuple[float, dict[str, Any]]:
        """Return the velocity, m/s, and its derivatives (n_c,), or (n,) of balls."""
        sensitivities = sound_velocities(network, self.direction).sensitivities
        shape = sensitivities.velocities.shape
        if len(shape) != 1:
            mend = "Give one direction, and a network at one load"
            raise InputError(f"the velocities have the shape {shape}", mend=mend)
        wave = whole_number("wave", self.wave, 0, shape[0] - 1)
        weights = np.eye(shape[0])[wave]
        slopes: dict[str, Any] = {}
        _add(slopes, sensitivities, weights)
        return float(sensitivities.velocities[wave]), slopes


@dataclass(frozen=True, init=False)
class ResponseAt:
    """The magnitude of a response at a frequency, m/N or in the unit of its quantity.

    Parameters
    ----------
    frequency : Hz.
    source, receiver, options : as for :meth:`granphon.Waves.response`; of several receivers the
        mean over them counts.
    largest : whether the largest response is sought; by default the smallest.
    """

    frequency: float
    source: Any
    receiver: Any
    largest: bool
    options: dict[str, Any]

    @property
    def unit(self) -> str:
        """The unit of the response."""
        return QUANTITIES[self.options.get("quantity", "displacement")]

    def __init__(
        self, frequency: float, source: Any, receiver: Any, *, largest: bool = False, **options: Any
    ) -> None:
        """Set up the goal; ``options`` are those of :meth:`granphon.Waves.response`."""
        not_negative("frequency", frequency, "Hz")
        values = (frequency, source, receiver, largest, options)
        for name, value in zip(self.__dataclass_fields__, values, strict=True):
            object.__setattr__(self, name, value)

    def estimate_memory(self, network: ContactNetwork) -> float:
        """Return the memory of an evaluation, bytes."""
        places = (self.source, self.receiver)
        cost = Waves(network).estimate("response", [self.frequency], *places, **self.options)
        return cost.working + cost.kept

    def evaluate(self, network: ContactNetwork) -> tuple[float, dict[str, Any]]:
        """Return the magnitude, in ``unit``, and its derivatives (n_c,), or (n,) of balls."""
        waves = Waves(network)
        response = waves.response([self.frequency], self.source, self.receiver, **self.options)
        sensitivities = response.sensitivities
        mean = complex(response.coherent[0])  # over the receivers
        magnitude = abs(mean)
        slopes = {}
        for name in NAMES:
            derivatives = getattr(sensitivities, name)
            if derivatives is not None and magnitude > 0.0:
                # d|z| = Re(z* dz)/|z|
                of_mean = np.mean(derivatives[0], axis=0)
                slopes[name] = (np.conj(mean) * of_mean).real / magnitude
        return magnitude, slopes


def _smooth_largest(values: Array, t: float) -> tuple[float, Array]:
    """Return a smooth largest of the ``values`` f (n,), t log sum exp(f/t), and its derivatives by
    the values, which add up to one. It is above the largest value by t log n at most.
    """
    highest = float(np.max(values))
    exponentials = np.exp((values - highest) / t)
    total = float(np.sum(exponentials))
    return highest + t * float(np.log(total)), exponentials / total


def _add(slopes: dict[str, Any], sensitivities: Any, weights: Array) -> None:
    """Add to ``slopes``, in place, the derivatives of b results in the fields of their
    ``sensitivities``, (b, ...), times the ``weights`` (b,) of the results.
    """
    n_axes = sensitivities.mass.ndim - 1
    for name in NAMES:
        derivatives = getattr(sensitivities, name)
        if derivatives is not None:
            rows = derivatives.reshape(len(weights), *derivatives.shape[n_axes:])
            slopes[name] = slopes.get(name, 0.0) + np.tensordot(weights, np.nan_to_num(rows), 1)
