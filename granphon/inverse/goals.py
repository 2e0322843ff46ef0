"""Goals of a design: a wide gap, given frequencies, a low velocity, a response.

A goal gives a number of a network, and the derivatives of this number by the fields of
:class:`granphon.Sensitivities`. The edges of a gap are the largest frequency below it and the
smallest one above it, over branches and wave vectors. At which of them an edge lies jumps as the
network changes, so that an edge has no derivative there. The search takes smooth edges instead:
t log sum exp(f/t) over all frequencies f lies above the largest by t times the logarithm of their
number at most, and has derivatives everywhere (the Kreisselmeier-Steinhauser function, 1979).
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
from granphon.base.text import counted
from granphon.base.validation import (
    finite_array,
    grid_numbers,
    not_negative,
    one_of,
    positive,
    require,
    truth,
    whole_number,
)
from granphon.dynamics.sensitivities import list_inertias
from granphon.media import cost as costs
from granphon.networks.network import ContactNetwork
from granphon.observables.velocities import sound_velocities
from granphon.phonons.phonons import Phonons
from granphon.phonons.zone_mesh import list_half_mesh
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
REFINEMENT = 4
#: smoothing t of a gap by default, over the top frequency
_DEFAULT_SMOOTHING = 2e-3
#: smooth width of a gap, over the smoothing, up to which two branches touch: the smoothing alone
#: may make such a width, as at all other wave vectors these branches lie so far apart that they
#: hardly count
_TOUCHING_WIDTH = 1e-3
#: weight of a frequency in a smooth edge from which its derivatives count
_LEAST_WEIGHT = 1e-9
#: greatest misfit of a frequency that is matched: in standard errors, and, where these are not
#: given, over the frequency
_MOST_MISFIT = 3.0
_MOST_RELATIVE_MISFIT = 1e-3
#: least overlap of a measured shape with that of a mode at which the two are taken for the same
_LEAST_OVERLAP = 0.5


class Goal(Protocol):
    """A goal of :func:`granphon.design`; an object of your own with this attribute and this method
    is a goal, too.

    ``largest`` says whether the largest value is sought, not the smallest.
    """

    largest: bool

    def evaluate(self, network: ContactNetwork) -> tuple[float, Mapping[str, Any]]:
        """Return the value of a network, and its derivatives by the names of
        :class:`granphon.Sensitivities`: (n_c,) for contacts, (n,) for balls, and (n, motions) for
        springs to the ground. Derivatives that are zero may be left out.
        """
        ...


@dataclass(frozen=True)
class WidestGap:
    """The goal of the widest complete gap between two branches, Hz.

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
        """Check ``near``, ``smoothing`` and ``branches``, if they are given; the ``mesh`` is
        checked with the periods of a network. InputError for both ``near`` and ``branches``, which
        each choose the gap.
        """
        if self.near is not None and self.branches is not None:
            raise InputError("near and branches each choose the gap", mend="Give one of the two")
        for name in ("near", "smoothing"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name), "Hz")
        if self.branches is not None:
            whole_number("branches", self.branches, 1)

    def choose(self, network: ContactNetwork, count: int) -> list[WidestGap]:
        """Return up to ``count`` goals with a fixed number of ``branches`` below the gap, the most
        promising first, for a search that begins at a ``network``.

        With ``branches`` or ``near`` there is one goal: that number of branches, or the number of
        branches whose mean frequency over the zone is below ``near``. Otherwise the goals are those
        of the widest gaps of the network, or, where none is open, of the least overlaps of
        branches. Raises InputError for a network with one branch, for ``branches`` of which none is
        above the gap, for a ``near`` below or above the mean frequencies of all branches, and for a
        ``mesh`` of another number of periods.
        """
        _points, frequencies = self._find_frequencies(Phonons(network))
        tops = frequencies.max(axis=0)
        smoothing = self.smoothing or _DEFAULT_SMOOTHING * float(tops[-1])
        goal = replace(self, near=None, smoothing=smoothing)
        n_gaps = len(tops) - 1
        self._require_branches(n_gaps)
        if self.branches is not None:
            return [goal]
        if self.near is not None:
            return [replace(goal, branches=self._count_below(self.near, frequencies))]
        # of the gap above each branch, below zero where none is
        widths = frequencies.min(axis=0)[1:] - tops[:-1]
        widest = np.argsort(-widths, kind="stable")[:count]
        return [replace(goal, branches=1 + int(number)) for number in widest]

    def _require_branches(self, n_gaps: int) -> None:
        """Raise InputError for a network whose ``n_gaps``, the number of branches less one, is
        zero, or less than the ``branches`` below the gap.
        """
        if not n_gaps:
            raise InputError("the network has one branch alone, and no gap between branches")
        if self.branches is not None:
            whole_number("branches", self.branches, 1, n_gaps)

    @staticmethod
    def _count_below(near: float, frequencies: Array) -> int:
        """Return the number of branches whose mean of the ``frequencies`` (n_q, n_b), Hz, over the
        zone is below the frequency ``near``, Hz; InputError if these are none or all.
        """
        means = np.mean(frequencies, axis=0)  # ascending, as branches ascend at each wave vector
        n_below = int(np.count_nonzero(means < near))
        if n_below in (0, len(means)):
            tops = frequencies.max(axis=0)[:-1]
            bottoms = frequencies.min(axis=0)[1:]
            widest = int(np.argmax(bottoms - tops))
            # between the means, by which branches are counted: their edges may overlap
            between = 0.5 * float(means[widest] + means[widest + 1])
            raise InputError(
                f"no gap can be near {near:g} Hz",
                f"Branches are counted by their means over the zone, which lie from {means[0]:.6g}"
                f" to {means[-1]:.6g} Hz",
                f"Give a frequency between two means, as {between:.6g} Hz, or leave near out",
            )
        return n_below

    def _list_numbers(self, periods: int) -> tuple[int, ...]:
        """Return the numbers of wave vectors along each of the reciprocal vectors, as many as the
        network has ``periods``: those of ``mesh``, or the default ones.
        """
        default = (_MESHES[periods - 1],) * periods
        if self.mesh is None:
            return default
        example = " ".join(map(str, default))
        return grid_numbers("mesh", self.mesh, 1, _MOST_POINTS, example, periods)

    def _find_frequencies(self, phonons: Phonons) -> tuple[Array, Array]:
        """Return the wave vectors (n_q, p) of half of the mesh, in fractions of the reciprocal
        cell, and the frequencies of all branches of the ``phonons`` there, (n_q, n_b), Hz.
        """
        points = list_half_mesh(self._list_numbers(phonons.lattice.periods))
        return points, phonons.frequencies(points)

    def evaluate(self, network: ContactNetwork) -> tuple[float, dict[str, Any]]:
        """Return the smooth width of the gap, Hz, below zero where branches overlap, and its
        derivatives by name: (n_c,) for contacts, (n,) for balls, and (n, motions) for springs to
        the ground. Frequencies that hardly count in an edge are left out of the derivatives.

        Of ``branches`` and ``smoothing``, one that is not given is chosen at this network. Raises
        InputError as :meth:`choose` does; and what :meth:`granphon.Phonons.sensitivities` raises,
        as for a network that is not stable.
        """
        if self.branches is None or self.smoothing is None:
            return self.choose(network, 1)[0].evaluate(network)
        phonons = Phonons(network)
        self._require_branches(phonons.lattice.n_branches - 1)
        points, frequencies = self._find_frequencies(phonons)
        frequencies_below = frequencies[:, : self.branches]
        frequencies_above = frequencies[:, self.branches :]
        top, weights_below = _smooth_largest(frequencies_below, self.smoothing)
        # the smallest frequency is the negative of the largest of the negatives
        negative_bottom, weights_above = _smooth_largest(-frequencies_above, self.smoothing)
        width = -negative_bottom - top
        # (n_q, n_b) derivatives of the width by each frequency; nearly all are negligible
        weights = np.concatenate([-weights_below, weights_above], axis=1)
        is_counted = np.abs(weights) > _LEAST_WEIGHT
        slopes: dict[str, Any] = {}
        for index in np.flatnonzero(np.any(is_counted, axis=1)).tolist():
            branches = np.flatnonzero(is_counted[index])
            sensitivities = phonons.sensitivities(points[[index]], branches)
            _add_slopes(slopes, sensitivities, weights[index, branches])
        return width, slopes

    def certify(self, network: ContactNetwork) -> float:
        """Return the width of the gap, Hz, without smoothing, its edges sought from a mesh four
        times finer than that of the search; zero if the gap is closed. ``branches`` that are not
        given are chosen at this network. Raises what :meth:`evaluate` raises.
        """
        if self.branches is None:
            return self.choose(network, 1)[0].certify(network)
        phonons = Phonons(network)
        self._require_branches(phonons.lattice.n_branches - 1)
        numbers = self._list_numbers(phonons.lattice.periods)
        numbers_below, gaps = phonons.find_gaps([REFINEMENT * number for number in numbers])
        is_gap = numbers_below == self.branches  # of one gap, or of none if the gap is closed
        return float(np.sum(np.diff(gaps[is_gap], axis=1)))

    def tell_closed(self, width: float) -> str:
        """Return words for a gap of the smooth ``width``, Hz, that is closed. Its branches touch if
        the width is zero, or, above or below zero, so small that the smoothing alone may make it;
        they overlap if it is farther below zero. The words are "" for a gap that is open.
        """
        if abs(width) <= _TOUCHING_WIDTH * (self.smoothing or 0.0):
            return "zero, the branches touch"
        return "closed, the branches overlap" if width < 0.0 else ""

    def estimate_memory(self, network: ContactNetwork) -> float:
        """Return the memory that :meth:`evaluate` of a ``network`` takes, bytes."""
        lattice = Phonons(network).lattice
        n_points = math.prod(self._list_numbers(lattice.periods))
        frequency_cost = costs.bands(n_points, lattice.n_branches, eigenvectors=False)
        vector_cost = costs.bands(1, lattice.n_branches, file=False)
        return max(frequency_cost.working, vector_cost.working) + frequency_cost.kept

    def estimate_certificate(self, network: ContactNetwork) -> costs.Cost:
        """Return the cost of :meth:`certify` of a ``network``, in time and memory."""
        lattice = Phonons(network).lattice
        numbers = self._list_numbers(lattice.periods)
        n_points = math.prod(REFINEMENT * number for number in numbers)
        return costs.band_edges(1, n_points, lattice.n_branches, of_all=False, of_network=True)

    def judge_history(self, history: Array, value: float) -> str:
        """Return a sentence if the gap that a search has found is closed where it is certified, if
        none opens, or if the gap, once open, closes again on the way; "" otherwise. Only for a goal
        with a number of ``branches``, as :meth:`choose` returns.

        ``history`` (h,) is the smooth width at each evaluation, Hz, and ``value`` that of the
        certificate, Hz.
        """
        is_open = history > 0.0
        if value <= 0.0:
            branches = f"branches {self.branches} and {self.branches + 1}"  # type: ignore[operator]
            if np.any(is_open):
                return f"on the mesh {REFINEMENT} times finer the gap between {branches} closes"
            return f"no gap opens between {branches}"
        count = int(np.count_nonzero(np.maximum.accumulate(is_open) & ~is_open))
        if not count:
            return ""
        times = f"{count} of {history.size} evaluations"
        return f"the gap closes on the way, at {times}; the widest is kept"


@dataclass(frozen=True)
class MatchFrequencies:
    """The goal that frequencies are the measured ones: the least sum of the squares of the misfits,
    each over its standard error.

    Parameters
    ----------
    measured : Hz. Without ``q``, (m,) frequencies of the lowest modes of the network that cost
        energy, ascending, or with ``shapes`` in any order. With ``q``, frequencies of branches:
        (n_q, b), or (b,) at one wave vector, or (n_q,) of one branch.
    sigma : standard errors, Hz, a number or of the shape of ``measured``; None for errors in
        proportion to the frequencies.
    q : (n_q, p) wave vectors, fractions of the reciprocal cell.
    branches : (b,) numbers of the branches at the wave vectors, from 0; the first ones by default.
    shapes : (m, n, motions) measured motions of the balls in the modes, displacements in m and
        rotations in rad, each mode in any scale. The m measured shapes are then assigned to the m
        lowest modes of the network so that their overlaps are greatest, and each frequency is
        compared with that of the mode to which it is assigned.
    """

    measured: Any
    sigma: Any = None
    q: Any = None
    branches: Any = None
    shapes: Any = None
    unit = "1"
    largest = False

    def __post_init__(self) -> None:
        """Raise InputError for frequencies or standard errors that are not finite and above zero,
        and for arguments that do not agree: ``sigma`` of another shape than ``measured``; with
        ``q``, shapes of modes, or neither a row of frequencies nor one frequency for each wave
        vector; without ``q``, what :meth:`_require_modes` refuses.
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
            has_all_points = measured.ndim == 2 and len(measured) == n_points
        else:
            has_all_points = n_points in (1, measured.size)
        if not has_all_points:
            fault = (
                f"measured has the shape {measured.shape}, and there are {n_points} wave vectors"
            )
            raise InputError(fault, mend="Give a row of frequencies for each wave vector")

    def _require_modes(self, measured: Array) -> None:
        """Raise InputError unless ``measured`` (m,), Hz, may be frequencies of modes: without
        branches, and ascending, or with a shape for each that is not zero.
        """
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
        """Return the memory that :meth:`evaluate` of a ``network`` takes, bytes."""
        measured = np.asarray(self.measured)
        if self.q is None:
            cost = Waves(network).estimate("modes", measured.size)
        else:
            branches = Phonons(network).lattice.n_branches
            cost = costs.bands(measured.size, branches, file=False)
        return cost.working + cost.kept

    def find_residuals(self, network: ContactNetwork) -> tuple[Array, dict[str, Any]]:
        """Return the misfits of the m frequencies over their errors, (m,), and their derivatives,
        by name: (m, n_c) for contacts, (m, n) for balls, and (m, n, motions) for springs to the
        ground.

        Without ``sigma`` the errors are the measured frequencies. Raises InputError if ``shapes``
        are of other balls or motions or move no ball, if there are not as many frequencies as are
        measured, and for wave vectors or branches that the network does not have; and what
        :meth:`granphon.Waves.modes` or :meth:`granphon.Phonons.sensitivities` raises, as for a
        network that is not stable.
        """
        measured = np.asarray(self.measured, float)
        sigma = measured if self.sigma is None else self.sigma
        errors = np.broadcast_to(sigma, measured.shape).ravel()
        order: Any = slice(None)  # the mode or branch of each measured frequency
        if self.q is None:
            modes = Waves(network).modes(measured.size)
            sensitivities: Any = modes.sensitivities
            if self.shapes is not None:
                order, _overlaps = self._assign_modes(modes)
        else:
            points = np.atleast_1d(self.q)
            points = points.reshape(len(points), -1)  # (n_q, p), also of numbers along a chain
            count = measured.size // len(points)
            branches = np.arange(count) if self.branches is None else self.branches
            sensitivities = Phonons(network).sensitivities(points, branches)
        frequencies = sensitivities.frequencies.ravel()[order]
        if frequencies.size != measured.size:
            n_measured = counted(measured.size, "frequency is", "frequencies are")
            raise InputError(
                f"{n_measured} measured, and the goal has {frequencies.size}",
                mend="Give a frequency for each branch at each wave vector",
            )
        residuals = (frequencies - measured.ravel()) / errors
        slopes = {}
        for name in NAMES:
            derivatives = getattr(sensitivities, name)
            if derivatives is not None:
                # the axes of the frequencies, (n_q, b) with q, become one axis, (m, ...)
                shape_of_field = derivatives.shape[sensitivities.frequencies.ndim :]
                rows = derivatives.reshape(frequencies.size, *shape_of_field)[order]
                # the derivatives of a frequency of zero are nan, and count as zero
                slopes[name] = (np.nan_to_num(rows).T / errors).T
        return residuals, slopes

    def _assign_modes(self, modes: NetworkModes) -> tuple[Index, Array]:
        """Return, for each measured shape, the number (m,) of that of the ``modes`` to which the
        shape is assigned, and its overlap (m,) with the shape of that mode: the square of the
        cosine between the two, weighted by masses and moments of inertia. The sum of the overlaps
        is the greatest one.

        InputError for shapes of other balls or motions, and for a shape of balls that are held.
        """
        from scipy.optimize import linear_sum_assignment

        network = modes.network
        shapes = np.asarray(self.shapes, float)
        if shapes.shape[1:] != modes.vectors.shape[1:]:
            fault = f"shapes have the shape {shapes.shape}"
            raise InputError(fault, f"Modes of the network have {modes.vectors.shape}")
        inertias = np.where(network.moving[:, None], list_inertias(network), 0.0)
        rows = (np.sqrt(inertias) * shapes).reshape(len(shapes), -1)
        if not np.all(np.any(rows, axis=1)):
            fault = "a shape moves no ball of the network that can move"
            raise InputError(fault, mend="Give the motions of its balls")
        columns = modes.vectors.reshape(len(shapes), -1)
        products = (rows @ columns.T) ** 2
        overlaps = products / np.outer(np.sum(rows**2, axis=1), np.sum(columns**2, axis=1))
        shape_indices, numbers = linear_sum_assignment(overlaps, maximize=True)
        return numbers, overlaps[shape_indices, numbers]

    def evaluate(self, network: ContactNetwork) -> tuple[float, dict[str, Any]]:
        """Return the sum of the squares of the misfits over their errors, without a unit, and its
        derivatives by name: (n_c,) for contacts, (n,) for balls, and (n, motions) for springs to
        the ground. Raises what :meth:`find_residuals` raises.
        """
        residuals, slopes = self.find_residuals(network)
        # the derivative of r^2 is 2 r dr
        square_slopes = {
            name: np.tensordot(2.0 * residuals, slope, 1) for name, slope in slopes.items()
        }
        return float(residuals @ residuals), square_slopes

    def judge(self, network: ContactNetwork, value: float) -> str:
        """Return a sentence if some measured shape overlaps too little with the mode to which it is
        assigned, or some frequency of a ``network`` is not matched; "" otherwise.

        ``value``, that of :meth:`evaluate`, stands in the signature of all goals, and is not used.
        Raises what :meth:`find_residuals` raises.
        """
        residuals, _slopes = self.find_residuals(network)
        if self.shapes is not None:
            modes = Waves(network).modes(len(residuals))
            _numbers, overlaps = self._assign_modes(modes)
            least_overlap = float(np.min(overlaps))
            if least_overlap < _LEAST_OVERLAP:
                return (
                    "a measured shape and the mode to which it is assigned overlap by"
                    f" {least_overlap:.2g}"
                )
        largest_misfit = float(np.max(np.abs(residuals)))
        tolerance = _MOST_RELATIVE_MISFIT if self.sigma is None else _MOST_MISFIT
        if largest_misfit <= tolerance:
            return ""
        unit = "of its value" if self.sigma is None else "standard errors"
        miss = f"{largest_misfit:.3g} {unit}"
        return f"the goal is not reached: a measured frequency is missed by {miss}"


@dataclass(frozen=True)
class LowestVelocity:
    """The goal of the lowest velocity of one of the sound waves along a direction, m/s.

    Parameters
    ----------
    direction : (p,) Cartesian; its default is that of :func:`granphon.sound_velocities`.
    wave : number of the wave, from 0 for the slowest, in the ascending order of ``velocities``.
    """

    direction: ArrayLike | None = None
    wave: int = 0
    unit = "m/s"
    largest = False

    def estimate_memory(self, network: ContactNetwork) -> float:
        """Return the memory that :meth:`evaluate` of a ``network`` takes, bytes."""
        n_balls = int(np.count_nonzero(network.moving))
        return costs.relaxation_memory(n_balls, network.ball_motions.count, network.dimension)

    def evaluate(self, network: ContactNetwork) -> tuple[float, dict[str, Any]]:
        """Return the velocity in a ``network``, m/s, and its derivatives by name: (n_c,) for
        contacts, (n,) for balls, and (n, motions) for springs to the ground.

        Raises InputError for several directions or loads, and for a ``wave`` that is not there; and
        what :func:`granphon.sound_velocities` raises.
        """
        sensitivities = sound_velocities(network, self.direction).sensitivities
        shape = sensitivities.velocities.shape
        if len(shape) != 1:
            mend = "Give one direction, and a network at one load"
            raise InputError(f"the velocities have the shape {shape}", mend=mend)
        n_waves = shape[0]
        wave = whole_number("wave", self.wave, 0, n_waves - 1)
        weights = np.eye(n_waves)[wave]  # one for this wave, and zero for the others
        slopes: dict[str, Any] = {}
        _add_slopes(slopes, sensitivities, weights)
        return float(sensitivities.velocities[wave]), slopes


@dataclass(frozen=True, init=False)
class ResponseAt:
    """The goal of the smallest, or the largest, magnitude of a response at a frequency, m/N or in
    the unit of its quantity.

    Parameters
    ----------
    frequency : Hz.
    source, receiver, options : as for :meth:`granphon.Waves.response`; with several receivers the
        goal is the magnitude of the mean of their complex responses.
    largest : whether the largest response is sought; by default the smallest.
    """

    frequency: float
    source: Any
    receiver: Any
    largest: bool
    options: dict[str, Any]

    @property
    def unit(self) -> str:
        """The unit of the response, which follows from the option ``quantity``."""
        return QUANTITIES[self.options.get("quantity", "displacement")]

    def __init__(
        self, frequency: float, source: Any, receiver: Any, *, largest: bool = False, **options: Any
    ) -> None:
        """Set the fields of the goal; InputError for a frequency that is below zero or not finite,
        a ``largest`` that is no truth value, and an unknown quantity. ``options`` are those of
        :meth:`granphon.Waves.response`, which checks the others.
        """
        not_negative("frequency", frequency, "Hz")
        is_largest = require("largest", truth, largest)
        if "quantity" in options:
            one_of("quantity", options["quantity"], QUANTITIES)
        # a frozen data class allows no assignment; the names of fields are in the order of values
        values = (frequency, source, receiver, is_largest, options)
        for name, value in zip(self.__dataclass_fields__, values, strict=True):
            object.__setattr__(self, name, value)

    def estimate_memory(self, network: ContactNetwork) -> float:
        """Return the memory that :meth:`evaluate` of a ``network`` takes, bytes."""
        places = (self.source, self.receiver)
        cost = Waves(network).estimate("response", [self.frequency], *places, **self.options)
        return cost.working + cost.kept

    def evaluate(self, network: ContactNetwork) -> tuple[float, dict[str, Any]]:
        """Return the magnitude in a ``network``, in ``unit``, and its derivatives by name: (n_c,)
        for contacts, (n,) for balls, and (n, motions) for springs to the ground. There are no
        derivatives where the response is zero. Raises what :meth:`granphon.Waves.response` raises.
        """
        waves = Waves(network)
        response = waves.response([self.frequency], self.source, self.receiver, **self.options)
        sensitivities = response.sensitivities
        mean = complex(response.coherent[0])  # over the receivers
        magnitude = abs(mean)
        slopes = {}
        for name in NAMES:
            derivatives = getattr(sensitivities, name)
            if derivatives is not None and magnitude > 0.0:
                # d|z| = Re(z* dz)/|z| of the mean z over the receivers, the axis after that of the
                # one frequency
                mean_derivatives = np.mean(derivatives[0], axis=0)
                slopes[name] = (np.conj(mean) * mean_derivatives).real / magnitude
        return magnitude, slopes


def _smooth_largest(values: Array, t: float) -> tuple[float, Array]:
    """Return the smooth maximum t log sum exp(f/t) of n ``values`` f, an array of any shape, and
    its derivatives by the values, of the same shape, which add up to one.

    The smooth maximum is above the largest value by t log n at most; ``t`` has the unit of the
    values.
    """
    highest = float(np.max(values))  # taken out of the sum, as exp(f/t) may overflow
    exponentials = np.exp((values - highest) / t)
    total = float(np.sum(exponentials))
    return highest + t * float(np.log(total)), exponentials / total


def _add_slopes(slopes: dict[str, Any], sensitivities: Any, weights: Array) -> None:
    """Add the derivatives of a weighted sum of b results to ``slopes``, in place.

    ``sensitivities`` are those of the results, which may have several axes, as (1, b). ``weights``
    are (b,). ``slopes`` has the derivatives by name: (n_c,) for contacts, (n,) for balls, and
    (n, motions) for springs to the ground.
    """
    n_axes = sensitivities.mass.ndim - 1  # of the results: the last axis of mass is that of balls
    for name in NAMES:
        derivatives = getattr(sensitivities, name)
        if derivatives is not None:
            rows = derivatives.reshape(len(weights), *derivatives.shape[n_axes:])
            # the derivatives of a frequency of zero are nan, and count as zero
            slopes[name] = slopes.get(name, 0.0) + np.tensordot(weights, np.nan_to_num(rows), 1)
