"""Modes of finite networks: the lowest, or those nearest to a frequency.

Small matrices are dense. Larger matrices are factorised at a shift, and Lanczos finds the modes
nearest to the shift; the factors also say, by Sylvester's law of inertia, how many eigenvalues are
below a value, so that none is missed.

Where the factors would be too large, the lowest modes are found by a block of vectors
(:mod:`granphon.waves.lowest`), and modes of a window of frequencies are filtered out of random
vectors. With omega = top cos(phi/2) the polynomials T_n(2 D / top^2 - 1) are cos(n phi). A filter
is a sum of polynomials up to the order M that lies in a window of phi, of the width 2 H, as much as
the order allows: its coefficients are one of Slepian's sequences (Bell Syst. Tech. J. 57, 1371
(1978)), and there are 2 M H / pi filters. All filters, applied to a few random vectors in one
recursion, make vectors that span the modes of the window if the vectors are well more than the
modes: filter diagonalisation (Wall and Neuhauser, J. Chem. Phys. 102, 8011 (1995)). The window that
holds a number of modes follows from the density of states, by the kernel polynomial method.

Every mode has a share in a random vector. So after the modes are found, fresh random vectors are
filtered, and freed of these modes: the squares of the residuals count the modes in the window that
are missing.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from granphon.array.sparse_matrices import LARGEST_FACTORS, LARGEST_UNSYMMETRIC, share_places
from granphon.base.arrays import Array, Complex
from granphon.base.errors import ConvergenceError, InputError, message
from granphon.base.results import Result, held, result_class
from granphon.base.scales import Units
from granphon.base.text import counted
from granphon.base.threads import single_products
from granphon.base.validation import not_negative, whole_number
from granphon.dynamics.damping import DampedModes, Losses, damp_evenly, damp_unevenly
from granphon.dynamics.deformation_rows import network_unit_rows
from granphon.dynamics.factors import Elimination, Factors, factorise
from granphon.dynamics.linalg import find_nearest, lanczos_converges
from granphon.dynamics.lowest_modes import size_block
from granphon.dynamics.sensitivities import (
    FrequencySensitivities,
    ModeEnergies,
    Place,
    average_equal,
    find_frequency_sensitivities,
    number_equal,
    sum_kinds,
)
from granphon.networks.network import ContactNetwork
from granphon.observables.validity import network_warnings
from granphon.waves.chebyshev import Kernel, Moments, polynomials
from granphon.waves.lowest import RESIDUAL, estimate_lowest, find_lowest
from granphon.waves.operator import WaveOperator, explain_instability

#: most motions of a network all of whose modes are found at once, by a dense matrix
DENSE = 600
#: frequency over the top frequency, at or below which a mode counts as one that costs no energy
ZERO = 1e-6
#: square of a frequency of a ball that moves alone, over top^2, up to which it is rounding of zero
_FREE_SQUARE = 1e-14
#: random vectors of the density of states from which the window follows
_VECTORS = 4
#: Chebyshev moments of that density
_MOMENTS = 512
#: half width of a line in that density, over the standard deviation of the kernel
_RESOLVED = 4.0
#: numbers of filters of a window that are tried; many pay where nearly all of a window is empty
_FILTERS = (32, 48, 64, 96, 128, 192, 256, 384)
#: numbers of random vectors to begin with that are tried, until memory suffices: as many modes of
#: one frequency are found
_STARTS = (12, 8, 6, 4)
#: filtered vectors, over the modes in the window
_VECTORS_PER_MODE = 2.3
#: share of a window next to its ends where modes are not found, times the number of filters
_EDGE = 6.4
#: share of a window that is to be without a missing mode before a wider window is taken
_CORE = 0.8
#: half width of the next window that is tried, but for its ends, over that of a window with too few
#: modes
_WIDER = 1.1
#: modes that the middle of a window holds by the density of states, over those that are requested
_SPARE_MODES = 2
#: fewest fresh random vectors
_FRESH = 4
#: random vectors so far, over fresh ones
_GROWTH = 3
#: products and sums over filters, over products
_SUMS_OF_FILTERS = 2.0
#: factors of a search for modes: at the shift, and to count the modes at both ends, with solutions
_FACTORS_OF_MODES = 3.0
#: mean square of the residuals of fresh vectors below which no mode is missing; a missing mode adds
#: 1, and less than this limit with four vectors once in a thousand times
_LEAST_RESIDUAL = 0.02
#: more modes than these that cost no energy are left out from the beginning, and not counted
_ZEROS = 48
#: then, lowest frequency that is searched for missing modes, over the highest that is requested
_SOFT = 0.03
#: most bytes of all vectors
_BYTES = 2**32
#: copies of the vectors that are held at a time
_COPIES = 3
#: most products of D with a vector
_PRODUCTS = 2_000_000
#: rows of filtered vectors that are worked on at a time
_ROWS = 2**9
#: polynomials that are kept for a sum over them
_KEPT = 32
#: vectors that are worked on at a time
_COLUMNS = 32
#: most motions of a matrix that is dense because many modes are requested, or many cost no energy:
#: 2 GB
_LARGEST = 10_000
#: number of all modes over the most that are found without finding all
_SHARE = 3
#: shift of the factors for the lowest modes, over top^2
_SHIFT = 1e-6
#: products with D that tell whether a network too large to be factorised is stable
_KRYLOV = 400
#: error of the lowest eigenvalue by these products, over top^2. D is lower than the whole by a
#: tenth of that, where overlaps are d/50
_RITZ_ERROR = 1e-5
#: greatest rate of growth, over the top frequency, that is put down to forces left on balls at rest
_BALANCED = 1e-4
#: vectors of a Krylov space beyond those that are requested
_SPARE = 8
#: shifts, over top^2, that are tried where a matrix is exactly singular, as its shift is an
#: eigenvalue
_NUDGES = (0.0, 1e-9, -1e-7)
#: factor by which a shift is lowered until it is below all eigenvalues
_LOWER = 100.0
#: relative distance by which a mode at the end of an interval is left out of a count of the modes
#: within it
_INSIDE = 1e-9
#: points in phi at which the weight of filters between two ends is sampled
_PHI_POINTS = 33
#: weight of the filters of a window that show a missing mode, over the weight of all its filters
_WEIGHT_SHARE = 0.5


class Eigenpairs(NamedTuple):
    """Angular frequencies ``omega`` (m,), rad/s, ascending; ``vectors`` (size, m) of norm one;
    largest ``residual``/top^2.

    ``zeros`` is the number of modes of the network that cost no energy; None if these were not
    counted.
    """

    omega: Array
    vectors: Array
    residual: float
    zeros: int | None


class Problem:
    """D on the motions that some spring holds.

    Attributes
    ----------
    operator : D on all motions.
    live : (n_live,) indices of the motions that some spring holds. Axes "live" have this length.
    top : bound of all angular frequencies, rad/s.
    loose : number of the other motions.
    """

    def __init__(self, operator: WaveOperator, live: NDArray[np.intp]) -> None:
        self.operator = operator
        self.live = live
        self.top = operator.top
        self.loose = operator.size - live.size

    @classmethod
    def of(cls, operator: WaveOperator) -> Self:
        """Return D on all motions that some spring holds."""
        return cls(operator, np.flatnonzero(np.diff(operator.matrix.indptr) > 0))

    @cached_property
    def free_motions(self) -> Any:
        """Sparse, orthonormal motions (live, m) of single balls that deform no contact, as the
        rotation about the line through two contacts; none where static forces act.
        """
        from scipy.sparse import csc_array

        operator = self.operator
        size = self.live.size
        if operator.network.prestress:
            return csc_array((size, 0))
        squares, vectors = np.linalg.eigh(operator.ball_blocks)
        balls, modes = np.nonzero(squares <= _FREE_SQUARE * self.top**2)
        m = operator.motions.count
        motions = operator.values(np.arange(operator.size))[balls]  # (k, m)
        live_index = np.full(operator.size, -1)
        live_index[self.live] = np.arange(size)
        rows = live_index[motions]
        # a ball that nothing holds has no live motion
        is_held = np.all(rows >= 0, axis=1)
        entries = vectors[balls, :, modes][is_held]
        starts = m * np.arange(len(entries) + 1)
        return csc_array((entries.ravel(), rows[is_held].ravel(), starts), (size, len(entries)))

    def find_idle(self) -> Any:
        """Return sparse, orthonormal motions (size, k) that cost no energy: those without a spring,
        and :attr:`free_motions`.
        """
        from scipy.sparse import eye_array, hstack

        unit = eye_array(self.operator.size, format="csc")
        loose = np.setdiff1d(np.arange(self.operator.size), self.live)
        return hstack([unit[:, loose], unit[:, self.live] @ self.free_motions], format="csr")

    @cached_property
    def _entries(self) -> list[Any]:
        """A sparse matrix (live, live) with an entry wherever D or the unit matrix has one, and the
        entries of D and of the unit matrix in these places.
        """
        from scipy.sparse import eye_array

        matrix = self.operator.matrix
        if self.loose:
            matrix = matrix[self.live][:, self.live]
        return share_places([matrix, eye_array(self.live.size)])

    def shifted(self, value: float) -> Any:
        """Return D - ``value``, (rad/s)^2, a sparse matrix (live, live) that has its entries in the
        same places for every value.
        """
        places, elastic, ones = self._entries
        matrix = places.copy()
        matrix.data = elastic - value * ones
        return matrix

    @cached_property
    def _elimination(self) -> Elimination:
        """The order of elimination of D less any value."""
        places, _, _ = self._entries
        return Elimination(places)

    def factors(self, value: float) -> Factors:
        """Return the factors of D - ``value``, (rad/s)^2; where that is exactly singular, those of
        D less a value beside it. ConvergenceError if there are none.
        """
        for nudge in _NUDGES:
            matrix = self.shifted(value + nudge * self.top**2)
            try:
                return self._elimination.factorise(matrix)
            except RuntimeError:  # exactly singular: the shift is an eigenvalue
                continue
        raise ConvergenceError("the matrix of the network cannot be factorised")

    def count_below(self, value: float) -> int:
        """Return the number of eigenvalues below ``value``, (rad/s)^2, or, if that is exactly an
        eigenvalue, below a value beside it.
        """
        return self.factors(value).n_below

    def refine(self, vectors: Array) -> tuple[Array, Array, Array]:
        """Return angular frequencies (m,), rad/s, ascending, modes (size, m) and residuals (m,)
        over top^2 within the space of ``vectors`` (live, m).

        Without static forces the modes are singular vectors of A, so that low frequencies lose no
        digits. With them there is an error of :func:`find_roots` for a network that is not stable.
        """
        operator = self.operator
        basis = np.zeros((operator.size, vectors.shape[1]))
        basis[self.live], _ = np.linalg.qr(vectors)
        forces = operator.matrix @ basis
        if operator.network.prestress:
            squares, coefficients = np.linalg.eigh(basis.T @ forces)
            omega = find_roots(operator, squares)
        else:
            omega, coefficients = _find_singular(operator.root @ basis)
        modes = basis @ coefficients
        forces_of_modes = forces @ coefficients
        differences = forces_of_modes - omega**2 * modes
        residuals = np.linalg.norm(differences, axis=0) / self.top**2
        return omega, modes, residuals

    def choose(self, omega: Array, count: int, target: float) -> NDArray[np.intp]:
        """Return the indices, ascending, of the ``count`` frequencies nearest to ``target``, rad/s,
        among those of ``omega`` (m,), rad/s, that cost energy; of all these if they are fewer.
        """
        elastic = np.flatnonzero(omega > ZERO * self.top)
        from_nearest = np.argsort(np.abs(omega[elastic] - target), kind="stable")
        return np.sort(elastic[from_nearest[:count]])


def _find_singular(deformations: Array) -> tuple[Array, Array]:
    """Return singular values (m,), ascending, and right singular vectors (m, m) of a matrix (rows,
    m); values are zero where there are fewer rows than m.
    """
    # the triangle R of A = QR has the singular values and right vectors of A, and far fewer rows
    triangle = np.asarray(np.linalg.qr(deformations, mode="r"))
    try:
        _, singular_values, right_rows = np.linalg.svd(triangle)
    except np.linalg.LinAlgError:
        # LAPACK's fast method fails on some matrices with hundreds of singular values near zero;
        # gesvd does not
        from scipy.linalg import svd

        _, singular_values, right_rows = svd(triangle, lapack_driver="gesvd")
    padded = np.zeros(len(right_rows))
    padded[: singular_values.size] = singular_values
    ascending = np.argsort(padded, kind="stable")
    return padded[ascending], right_rows.T[:, ascending]


def find_fall(operator: WaveOperator) -> float:
    """Return the size, (rad/s)^2, of squared frequencies below zero that count as zero.

    Such squares are rounding, or come from the imbalance of static forces on balls: no program
    brings forces to rest to all digits, and balls that carry no load have been left out. A ball
    with an imbalance F falls where springs do not resist: about the line through two contacts, at a
    distance h from its centre, as exp(s t), s^2 = F h/(2 (m h^2 + I)) for neighbours that stay.
    F/(m r) is above s^2 for any h; T/I is the bound for an imbalance T of torques.
    """
    network = operator.network
    rounding = (ZERO * operator.top) ** 2
    if not network.prestress:
        return rounding
    balls = operator.balls
    forces, torques = network.unbalanced
    force = np.linalg.norm(forces[balls], axis=1)
    torque = np.linalg.norm(torques[balls], axis=1)
    falls = force / (network.masses[balls] * network.radii[balls])
    falls = falls + torque / network.inertias[balls]
    # a larger fall is no imbalance that a program leaves, but an instability
    greatest = (_BALANCED * operator.top) ** 2
    return rounding + min(float(np.max(falls)), greatest)


def find_roots(operator: WaveOperator, squares: Array) -> Array:
    """Return angular frequencies (m,), rad/s, from their ``squares`` (m,), which ascend; squares
    below zero count as zero.

    Raises :class:`~granphon.base.errors.InstabilityError` if a square is below zero by more than
    :func:`find_fall`. With static tangential forces there is no limit: D lacks a part of these
    forces, which lowers frequencies of zero.
    """
    if operator.whole is None and squares[0] < -find_fall(operator):
        raise explain_instability(operator.network)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def require_motions(count: int, available: int) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a request of more modes than the motions
    that are ``available``.
    """
    if count > available:
        request = counted(count, "mode is", "modes are")
        fault = f"{request} asked for, and the network has {counted(available, 'motion')}"
        raise InputError(fault, mend="Ask for fewer")


def make_too_few(available: int, count: int) -> InputError:
    """Return the error of a request of ``count`` modes where fewer are ``available``."""
    request = counted(count, "mode is", "modes are")
    among = f"only {available}" if available else "none"
    return InputError(f"{request} asked for, and {among} cost energy", mend="Ask for fewer")


@dataclass(frozen=True)
class _Window:
    """The window |phi - centre| < half of modes, and its number of ``filters``; ``centre`` is 0 or
    pi for a window at an end of the spectrum.
    """

    centre: float
    half: float
    filters: int

    @property
    def at_end(self) -> bool:
        """Whether the window is at an end of the spectrum."""
        return self.centre in (0.0, math.pi)

    @property
    def order(self) -> int:
        """M, the number of products of D with a vector that the filters take: 2 M H/pi filters are
        in a window of the half width H, and half of these at an end of the spectrum.
        """
        order = math.ceil(math.pi * self.filters / (2.0 * self.half))
        return 2 * order if self.at_end else order

    @cached_property
    def coefficients(self) -> Array:
        """(filters, M + 1) coefficients of the polynomials of each filter, whose values are
        cos(n phi); filters that lie within the window most come first.

        Slepian's sequences s_n, n = -M to M, are even or odd in turn. The filter sum_n s_n
        exp(i n (phi - centre)), with its image at -phi, is a series of cos(n phi), whose
        coefficients are 2 s_n cos(n centre) of an even sequence, and 2 s_n sin(n centre) of an odd
        one; that of order zero is not doubled.
        """
        from scipy.signal.windows import dpss

        # at an end of the spectrum a filter is its own image: only even sequences make filters
        stride = 2 if self.at_end else 1
        count = stride * self.filters
        all_orders = dpss(2 * self.order + 1, count / 2, count)  # (count, 2 M + 1)
        sequences = all_orders[::stride, self.order :]
        angles = np.arange(self.order + 1) * self.centre
        is_even = np.arange(0, count, stride) % 2 == 0
        sequences *= np.where(is_even[:, None], np.cos(angles), np.sin(angles))
        sequences[:, 1:] *= 2.0
        return np.asarray(sequences)

    def weights(self, phi: Array) -> Array:
        """Return weights (filters, n) at ``phi`` (n,): in row m, the sum of the squares of the
        first m + 1 filters.
        """
        amplitudes = np.empty((self.filters, phi.size))
        orders = np.arange(self.order + 1)
        for column, angle in enumerate(phi.tolist()):
            amplitudes[:, column] = self.coefficients @ np.cos(angle * orders)
        return np.asarray(np.cumsum(amplitudes**2, axis=0))

    def middle(self, share: float) -> tuple[float, float]:
        """Return the ends in phi of the middle of the window, a ``share`` of its width."""
        low = max(self.centre - share * self.half, 0.0)
        high = min(self.centre + share * self.half, math.pi)
        return low, high

    def apply(self, operator: WaveOperator, starts: Array) -> Array:
        """Return the vectors (size, filters x m) that all filters make of the vectors ``starts``
        (size, m).

        Some polynomials are kept for a product with their coefficients, in blocks of rows that fit
        into a cache of the processor.
        """
        size, m = starts.shape
        filtered = np.zeros((size, self.filters, m))
        recursion = polynomials(operator, starts)
        kept = np.empty((_KEPT, size, m))
        with operator.progress.step("modes of a window", self.order + 1) as step:
            for first in range(0, self.order + 1, _KEPT):
                coefficients = self.coefficients[:, first : first + _KEPT]
                count = coefficients.shape[1]
                for offset in range(count):
                    kept[offset] = next(recursion)
                for row in range(0, size, _ROWS):
                    block = slice(row, row + _ROWS)
                    polynomials_of_block = kept[:count, block].reshape(count, -1)
                    sums = coefficients @ polynomials_of_block  # (filters, rows x m)
                    filtered[block] += sums.reshape(self.filters, -1, m).swapaxes(0, 1)
                step.advance(count)
        return filtered.reshape(size, -1)


class _Density:
    """Number of modes in windows of phi, by the kernel polynomial method, for the motions that some
    spring holds.
    """

    def __init__(self, problem: Problem, random: np.random.Generator) -> None:
        operator = problem.operator
        # the mean over vectors of random signs is an estimate of the trace
        signs = np.zeros((_VECTORS, operator.size))
        signs[:, problem.live] = random.choice([-1.0, 1.0], (_VECTORS, problem.live.size))
        starts = [vector.copy for vector in signs]
        n_products = _VECTORS * _MOMENTS // 2
        with operator.progress.step("density of states", n_products) as step:
            moments = Moments(operator, starts).first(_MOMENTS, step)
        self._moments = Kernel(operator.top, _MOMENTS).weights * np.mean(moments, axis=0)

    @property
    def zeros(self) -> float:
        """Number of modes that cost no energy, or next to none."""
        return 0.5 * self.within(math.pi, _RESOLVED * math.pi / _MOMENTS)

    def without_zeros(self) -> _Density:
        """Return the density without the modes that cost no energy: those at phi = pi, as far as
        the moments tell.
        """
        density = copy(self)
        moments_at_pi = (-1.0) ** np.arange(_MOMENTS)  # cos(n pi)
        weights = Kernel(1.0, _MOMENTS).weights
        density._moments = self._moments - self.zeros * moments_at_pi * weights
        return density

    def within(self, centre: float, half: float) -> float:
        """Return the number of modes at |phi - centre| < half; modes at phi count again at -phi, or
        2 pi - phi.
        """
        # the integral over the window of (mu_0 + 2 sum_n mu_n cos(n phi))/pi
        n = np.arange(1, _MOMENTS)
        cosine_integrals = 2.0 * np.sin(n * half) * np.cos(n * centre) / n
        integral = 2.0 * half * self._moments[0] + 2.0 * self._moments[1:] @ cosine_integrals
        return float(integral) / math.pi

    def reach(self, centre: float, count: float) -> float:
        """Return the half width about ``centre`` within which there are ``count`` modes; pi if all
        are fewer.
        """
        from scipy.optimize import brentq

        if self.within(centre, math.pi) <= count:
            return math.pi

        def count_excess(half: float) -> float:
            """Return the number of modes within ``half`` less the ``count``."""
            return self.within(centre, half) - count

        return float(brentq(count_excess, 0.0, math.pi, xtol=1e-9))

    def choose(
        self, target: float, requested: int, starts: int, least: float
    ) -> tuple[_Window, int]:
        """Return the window for the ``requested`` modes nearest to phi = ``target``, and how many
        random vectors it takes.

        The window without its ends holds :data:`_SPARE_MODES` times these modes, and has at least
        the half width ``least``. Of such windows it is the one that takes the fewest filtered
        vectors, with ``starts`` random vectors or so.
        """
        n_held = _SPARE_MODES * requested
        least_middle = max(self.reach(target, n_held), least)
        candidates = []
        for filters in _FILTERS:
            vectors = max(_STARTS[-1], starts * _FILTERS[0] // filters)
            n_spanned = vectors * filters / _VECTORS_PER_MODE  # modes that the vectors can hold
            least_half = least_middle / (1.0 - _EDGE / filters)
            window, count = self._place_window(target, filters, n_held, n_spanned, least_half)
            vectors = max(vectors, math.ceil(_VECTORS_PER_MODE * count / filters))
            candidates.append((filters * vectors, window, vectors))
        _, window, vectors = min(candidates, key=lambda candidate: candidate[0])
        return window, vectors

    def _place_window(
        self, target: float, filters: int, n_held: int, n_spanned: float, least_half: float
    ) -> tuple[_Window, float]:
        """Return the window about phi = ``target``, or about an end of the spectrum that is near,
        with so many ``filters``, and the number of modes in it: ``n_spanned``, or more if the half
        width would be below ``least_half``.

        About an end of the spectrum the window holds as many modes beyond the target, and at least
        ``n_held`` there.
        """
        centre = target
        half = max(self.reach(target, n_spanned), least_half)
        count = self.within(centre, half)
        for end in (math.pi, 0.0):
            distance = abs(end - target)
            if distance < half:
                # the window begins at the end of the spectrum, and holds as many modes beyond the
                # target; about an end each mode counts twice, with its image
                count = 0.5 * self.within(end, distance) + max(n_held, n_spanned)
                centre = end
                half = max(self.reach(end, 2.0 * count), distance + least_half)
                count = 0.5 * self.within(end, half)
        return _Window(centre, min(half, math.pi), filters), count


class _FoundModes(NamedTuple):
    """Modes that are found: ``omega`` (m,) ascending, rad/s, ``vectors`` (size, m), ``residuals``
    (m,) over top^2.
    """

    omega: Array
    vectors: Array
    residuals: Array


def find_filtered(problem: Problem, count: int, target: float) -> Eigenpairs | None:
    """Return the ``count`` modes nearest to ``target``, rad/s; None if that takes more vectors than
    there are modes.

    Raises :class:`~granphon.base.errors.InputError` before the first filter is applied if the
    search takes too much memory or too many products with D, and
    :class:`~granphon.base.errors.ConvergenceError` if the search needs as much later; and what
    :func:`find_roots` raises.
    """
    search = _FilterSearch(problem, count, target)
    while True:
        window, starts = search.choose_window()
        modes_of_window = search.filter(window, starts)
        if modes_of_window is None:
            return None
        modes, is_complete = modes_of_window
        if is_complete:
            return search.finish(modes)
        search.least = _WIDER * window.half


class _FilterSearch:
    """The search for the ``count`` modes nearest to ``target``, rad/s, by filters.

    Attributes
    ----------
    density : of the modes.
    power : of omega/top with which the mean square of a mode in a random vector grows: above zero,
        random vectors have no share of the modes that cost no energy.
    least : half width of the window, without its ends, in phi.
    """

    def __init__(self, problem: Problem, count: int, target: float) -> None:
        self.problem = problem
        self.count = count
        self.target = target
        self.random = np.random.default_rng(0)
        self.density = _Density(problem, self.random)
        self.power = 0
        self.least = 0.0
        #: the error of a search that takes too much, before and after the first filter
        self._error: type[InputError | ConvergenceError] = InputError
        # each random vector finds one of the modes without energy: many such modes are left out
        # from the beginning
        if self._is_lowest and self.density.zeros > _ZEROS:
            self.density = self.density.without_zeros()
            # D x with static forces, else A^T y: see _draw_vectors
            self.power = 4 if problem.operator.network.prestress else 2

    @property
    def _is_lowest(self) -> bool:
        """Whether the lowest modes are requested."""
        return self.target <= ZERO * self.problem.top

    def choose_window(self) -> tuple[_Window, int]:
        """Return a window, and the number of random vectors to begin with: the largest of
        :data:`_STARTS` whose filtered vectors fit into memory, or the least.
        """
        size = self.problem.operator.size
        phi = _find_phi(self.problem.top, self.target)
        for most_starts in _STARTS:
            window, starts = self.density.choose(phi, self.count, most_starts, self.least)
            if _count_bytes(window, size, starts) <= _BYTES:
                break
        return window, starts

    def filter(self, window: _Window, starts: int) -> tuple[_FoundModes, bool] | None:
        """Return the modes of a window, of which none is missing, and whether those requested are
        among them; None if that takes more vectors than there are modes.

        The search begins with ``starts`` random vectors. Raises what :func:`find_filtered` raises.
        """
        problem = self.problem
        basis = np.zeros((problem.operator.size, 0))
        modes = None
        n_drawn = starts
        while True:
            n_vectors = window.filters * (starts + _count_fresh(starts))
            if n_vectors > problem.live.size:
                return None
            _require_affordable(problem, window, starts, self.count, self._error)
            self._error = ConvergenceError
            random_vectors = _draw_vectors(problem, self.random, n_drawn, self.power)
            filtered = window.apply(problem.operator, random_vectors)
            if modes is not None:
                # fresh vectors, freed of the modes that are known, show whether one is missing
                ends = self._find_ends(window, modes)
                searched = window.middle(_CORE) if ends is None else ends
                n_missing = _estimate_missing(window, filtered, modes.vectors, searched, self.power)
                if n_missing < _LEAST_RESIDUAL:
                    return modes, ends is not None
                starts += n_drawn
            basis = _extend_basis(basis, filtered)
            modes = _find_ritz_modes(problem, window, basis)
            n_drawn = _count_fresh(starts)

    def _find_ends(self, window: _Window, modes: _FoundModes) -> tuple[float, float] | None:
        """Return the ends in phi, ascending, between which the requested modes lie; None unless all
        of these are found, and within the window without its ends, where no mode is missed.
        """
        top = self.problem.top
        chosen = self.problem.choose(modes.omega, self.count, self.target)
        if chosen.size < self.count:
            return None
        reach = np.max(np.abs(modes.omega[chosen] - self.target), initial=0.0)
        # random vectors without modes of zero energy have hardly any share of the softest modes
        softest = _SOFT * reach if self.power else 0.0
        first = _find_phi(top, self.target + reach)
        last = _find_phi(top, max(self.target - reach, softest))
        low, high = window.middle(1.0 - _EDGE / window.filters)
        return (first, last) if low <= first and last <= high else None

    def finish(self, modes: _FoundModes) -> Eigenpairs:
        """Return the requested modes of a window's ``modes``, refined."""
        problem = self.problem
        chosen = problem.choose(modes.omega, self.count, self.target)
        omega, vectors, residuals = problem.refine(modes.vectors[problem.live][:, chosen])
        n_zeros = None
        if self._is_lowest and not self.power:  # the window holds all modes that cost no energy
            n_zeros = problem.loose + int(np.sum(modes.omega <= ZERO * problem.top))
        return Eigenpairs(omega, vectors, float(residuals.max()), n_zeros)


def _find_phi(top: float, omega: float) -> float:
    """Return phi of an angular frequency: omega = top cos(phi/2)."""
    return 2.0 * math.acos(min(max(omega / top, 0.0), 1.0))


class ModesWork(NamedTuple):
    """What a search for modes takes: a dense matrix, or so many ``factors``, or products of D with
    vectors, so many ``together``, and ``memory``, bytes.
    """

    is_dense: bool = False
    factors: float = 0.0
    products: float = 0.0
    together: int = 1
    memory: float = 0.0


def estimate_modes(operator: WaveOperator, count: int, nearest: float | None) -> ModesWork:
    """Return the method and the memory of the search for ``count`` modes. Where modes are filtered,
    the density of states is found, which is a small part of the search.

    Raises :class:`~granphon.base.errors.InputError` for modes that take too much.
    """
    problem = Problem.of(operator)
    if _is_dense(problem, count):
        return ModesWork(is_dense=True)
    if _has_factors(operator):
        return ModesWork(factors=_FACTORS_OF_MODES)
    if _read_target(nearest) <= ZERO * problem.top:
        together = size_block(count + _count_rigid(operator))
        products, memory = estimate_lowest(operator, together)
        return ModesWork(products=products, together=together, memory=memory)
    search = _FilterSearch(problem, count, _read_target(nearest))
    window, starts = search.choose_window()
    _require_affordable(problem, window, starts, count, InputError)
    n_vectors = starts + _count_fresh(starts)
    return ModesWork(
        products=float(_SUMS_OF_FILTERS * window.order * n_vectors),
        together=starts,
        memory=_count_bytes(window, operator.size, starts),
    )


def _is_dense(problem: Problem, count: int) -> bool:
    """Whether all modes are found, as the motions are few or the ``count`` is large."""
    size = problem.live.size
    return size <= DENSE or count * _SHARE > size


def _count_fresh(starts: int) -> int:
    """Return the number of fresh random vectors after ``starts`` random vectors."""
    return max(_FRESH, starts // _GROWTH)


def _count_bytes(window: _Window, size: int, starts: int) -> int:
    """Return the memory of the filtered vectors (size,) of ``starts`` random vectors, and of the
    fresh vectors after these, bytes.
    """
    bytes_per_number = 8
    n_vectors = window.filters * (starts + _count_fresh(starts))
    return bytes_per_number * _COPIES * size * n_vectors


def _require_affordable(
    problem: Problem,
    window: _Window,
    starts: int,
    count: int,
    error: type[InputError | ConvergenceError],
) -> None:
    """Raise the ``error`` if the filters of a window take too much memory or too many products,
    with ``starts`` random vectors and the fresh vectors after these; ``count`` modes are requested.
    """
    products = window.order * (starts + _count_fresh(starts))
    memory = _count_bytes(window, problem.operator.size, starts)
    if memory <= _BYTES and products <= _PRODUCTS:
        return
    fault = (
        f"{count} modes of {problem.live.size} motions take {memory / 1e9:.2g} GB,"
        f" and {products:.2g} products of D with a vector"
    )
    why = "In a large network modes of one frequency range lie close together"
    mend = "Ask for fewer modes, or take a smaller network, or its density of states"
    raise error(message(fault, why, mend))


def _extend_basis(basis: Array, vectors: Array) -> Array:
    """Return an orthonormal basis (size, m + n) of the space of a ``basis`` (size, m) and of
    ``vectors`` (size, n).

    No direction is left out, however small: filters that reach out of the window a little add
    directions that modes lack at 1e-8.
    """
    from scipy.linalg import qr

    m = basis.shape[1]
    joined = np.empty((len(basis), m + vectors.shape[1]), order="F")  # overwritten by LAPACK
    joined[:, :m] = basis
    joined[:, m:] = vectors
    orthonormal, _ = qr(joined, overwrite_a=True, mode="economic", check_finite=False)
    return np.asarray(orthonormal)


def _draw_vectors(problem: Problem, random: np.random.Generator, count: int, power: int) -> Array:
    """Return ``count`` random vectors, (size, count), in which the square of a mode has the mean
    (omega / top)^``power``.

    The vectors are x, A^T y or D x, for the powers 0, 2 and 4; A^T y and D x have no share of the
    modes that cost no energy.
    """
    operator = problem.operator
    if power == 2:
        rows = random.normal(size=(operator.root.shape[0], count))
        return np.asarray(operator.root.T @ rows) / problem.top
    vectors = np.zeros((operator.size, count))
    vectors[problem.live] = random.normal(size=(problem.live.size, count))
    if not power:
        return vectors
    return np.asarray(operator.matrix @ vectors) / problem.top**2


def _find_ritz_modes(problem: Problem, window: _Window, basis: Array) -> _FoundModes:
    """Return the modes of the window in the space of ``basis`` (size, n): Ritz vectors whose
    residuals are small.
    """
    matrix = problem.operator.matrix
    columns = range(0, basis.shape[1], _COLUMNS)
    projected = np.hstack(
        [basis.T @ (matrix @ basis[:, column : column + _COLUMNS]) for column in columns]
    )
    squares, coefficients = np.linalg.eigh(0.5 * (projected + projected.T))
    omega = find_roots(problem.operator, squares)
    low, high = window.middle(1.0)  # in phi, with which frequencies fall
    highest = problem.top * math.cos(low / 2.0)
    # modes that cost no energy are at zero, where this cosine is above zero by rounding; no mode is
    # at the top, which is a bound with a margin
    lowest = problem.top * (math.cos(high / 2.0) - ZERO)
    is_inside = (omega <= highest) & (omega >= lowest)
    return _keep_converged(problem, basis, coefficients[:, is_inside], omega[is_inside])


def _keep_converged(
    problem: Problem, basis: Array, coefficients: Array, omega: Array
) -> _FoundModes:
    """Return the Ritz vectors whose residuals are small, of those with ``coefficients`` (n, m) in
    the ``basis`` (size, n) and frequencies ``omega`` (m,), rad/s.

    Blocks of vectors are made and checked one after the other, which saves memory.
    """
    matrix = problem.operator.matrix
    vectors = [basis[:, :0]]
    residuals = np.empty(omega.size)
    for column in range(0, omega.size, _COLUMNS):
        block = slice(column, column + _COLUMNS)
        ritz_vectors = basis @ coefficients[:, block]
        differences = matrix @ ritz_vectors - omega[block] ** 2 * ritz_vectors
        residuals[block] = np.linalg.norm(differences, axis=0) / problem.top**2
        vectors.append(ritz_vectors[:, residuals[block] <= RESIDUAL])
    is_mode = residuals <= RESIDUAL
    return _FoundModes(omega[is_mode], np.hstack(vectors), residuals[is_mode])


def _estimate_missing(
    window: _Window, fresh: Array, known: Array, ends: tuple[float, float], power: int
) -> float:
    """Return an estimate of the number of modes between the ``ends`` in phi that are not ``known``
    (size, m); the estimate is too low by chance only.

    ``fresh`` (size, filters x n) are filtered random vectors from which the known modes have not
    been made. The share of a mode in the squares of these vectors is the sum of the squares of the
    filters at its frequency, times (omega / top)^``power``. Modes outside of the ends add to the
    estimate.
    """
    phi = np.linspace(*ends, _PHI_POINTS)
    omega_over_top = np.cos(0.5 * phi)
    # (filters,) the least share of a mode between the ends, by the first filters
    least_weights = np.min(window.weights(phi) * omega_over_top**power, axis=1)
    # the last filters reach out of the window: they add modes that are outside of the ends
    is_enough = least_weights >= _WEIGHT_SHARE * least_weights[-1]
    n_filters = int(np.argmax(is_enough)) + 1
    by_filter = fresh.reshape(len(fresh), window.filters, -1)[:, :n_filters]
    n_vectors = by_filter.shape[2]
    vectors = by_filter.reshape(len(fresh), -1)
    residuals = vectors - known @ (known.T @ vectors)
    return float(np.sum(residuals**2) / (n_vectors * least_weights[n_filters - 1]))


@result_class
class NetworkModes(Result):
    """Modes of a network that cost energy.

    Attributes
    ----------
    frequencies : (m,) Hz, ascending.
    vectors : (m, n_balls, motions) the modes, real, of norm one, weighted with masses: M^1/2 times
        displacements u, and M^1/2 w, w = (I/M)^1/2 phi, of the rotations. Balls that do not move
        have zeros. The largest number is above zero. Modes of one frequency are any basis of their
        space.
    displacements : number of the motions that are displacements: the others are rotations.
    moving : number of the balls that move.
    zero_modes : number of modes of the network that cost no energy, at or below 1e-6 of the top
        frequency: of the whole at rest, of balls that nothing holds, of mechanisms. They are not
        among the modes. None if they were not counted: in a network too large to be factorised,
        unless the lowest modes are requested and held balls have about 48 zero modes or fewer.
    residual : largest ``|D x - omega^2 x|`` / top^2 of a mode x.
    network : the network whose modes these are.
    """

    _notebook_fields = ("warnings",)

    frequencies: Array = held(float, "m", "Hz", "zero or above")
    vectors: Array = held(float, "m n c", within="finite")
    displacements: int = held(int)
    moving: int = held(int)
    zero_modes: int | None = held(int, "?")
    residual: float = held(float)
    network: ContactNetwork = held(ContactNetwork, repr=False)

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each limit of the contact law that the network exceeds."""
        return network_warnings(self.network)

    @cached_property
    def sensitivities(self) -> FrequencySensitivities:
        """Derivatives of the frequencies (m,) with respect to the stiffnesses and static forces of
        all contacts, and the masses and moments of inertia of all balls.

        Modes of one frequency, to 1e-8 of it, have the derivative of their mean. Those that are not
        among the modes do not count: ask for some modes more where the last ones may have such
        partners.
        """
        network = self.network
        groups = number_equal(self.frequencies)
        moving = np.flatnonzero(network.moving)
        motions = self.vectors[:, moving] ** 2

        def average(values: Array) -> Array:
            """Return the means of values (m, ...) over modes of one frequency."""
            return np.moveaxis(average_equal(np.moveaxis(values, 0, -1), groups, groups), -1, 0)

        energies = ModeEnergies(
            2.0 * math.pi * self.frequencies,
            np.bincount(groups)[groups] > 1,
            {name: average(values.T) for name, values in self._square_deformations().items()},
            average(motions),
        )
        units = Units(1.0, 1.0, 1.0)
        place = Place(network, units, moving, np.arange(network.n_contacts))
        return find_frequency_sensitivities(energies, place, self.warnings)

    @cached_property
    def contact_shares(self) -> Array:
        """(m, n_c) share of each contact in the frequency of a mode, d ln f / d ln k of all of its
        stiffnesses over the sum 1/2 of all contacts: its part of the elastic energy. The shares of
        a mode add up to one without static forces, and to a little more where these press.
        """
        network = self.network
        by_kind = self.sensitivities
        slopes = by_kind.normal_stiffness * network.normal_stiffness
        for derivative, stiffness in (
            (by_kind.shear_stiffness, network.shear_stiffness),
            (by_kind.torsion, network.torsion_stiffness),
            (by_kind.bending, network.bending_stiffness),
        ):
            if derivative is not None:
                slopes = slopes + derivative * stiffness
        return np.asarray(2.0 * slopes / self.frequencies[:, None])

    def _square_deformations(self) -> dict[str, Array]:
        """Return the squares (n_c, m) of the deformations of contacts in the modes, by the kind of
        their stiffness.
        """
        network = self.network
        scale = np.where(network.moving, 1.0 / np.sqrt(network.masses), 0.0)
        motions = scale[:, None] * self.vectors  # (m, n, motions)
        rows = network_unit_rows(network)
        squares = np.empty((len(rows), network.n_contacts, len(motions)))
        for row, squares_of_row in zip(rows, squares, strict=True):
            ahead = np.einsum("ca,mca->cm", row.head, motions[:, network.j])
            behind = np.einsum("ca,mca->cm", row.tail, motions[:, network.i])
            squares_of_row[:] = (ahead - behind) ** 2
        return sum_kinds(rows, squares.reshape(-1, len(motions)))

    @property
    def _energies(self) -> Array:
        """(m, n_balls, 2) share of each ball in the kinetic energy of a mode: of displacements, and
        of rotations.
        """
        energies = self.vectors**2  # of each motion: vectors are weighted with masses
        translation = energies[..., : self.displacements].sum(axis=2)
        rotation = energies[..., self.displacements :].sum(axis=2)
        return np.stack([translation, rotation], axis=-1)

    @property
    def participation_ratio(self) -> Array:
        """(m,) (sum e)^2 / (N sum e^2) of the kinetic energies e of the N balls that move: from
        1/N, if one moves, to 1.
        """
        energies = self._energies.sum(axis=2)
        squares = np.sum(energies**2, axis=1)
        return np.asarray(energies.sum(axis=1) ** 2 / (self.moving * squares))

    @property
    def rotational_fraction(self) -> Array:
        """(m,) share of rotations in the kinetic energy."""
        return np.asarray(self._energies[..., 1].sum(axis=1))


def find_modes(operator: WaveOperator, count: int, nearest: float | None) -> NetworkModes:
    """Return ``count`` modes of a network that is stable (:func:`require_stable`), the lowest or
    those nearest to the frequency ``nearest``, Hz.

    Raises what :meth:`granphon.waves.waves.Waves.modes` raises.
    """
    count = whole_number("count", count, 1)
    target = _read_target(nearest)
    if target > operator.top:
        top = operator.top / (2.0 * math.pi)
        raise InputError(
            f"the network has no modes near {nearest:g} Hz",
            f"All frequencies are below {top:.6g} Hz",
        )
    problem = Problem.of(operator)
    size = problem.live.size
    require_motions(count, size)
    if _is_dense(problem, count):
        pairs = _find_dense(problem, count, target)
    elif size <= LARGEST_FACTORS[operator.network.dimension]:
        pairs = _find_factored(problem, count, target)
    else:
        pairs = _find_large(problem, count, target)
    network = operator.network
    motions = operator.motions
    vectors = np.zeros((count, network.n_balls, motions.count))
    vectors[:, operator.balls] = np.moveaxis(operator.values(pairs.vectors), -1, 0)
    # the sign of a mode is free: the largest number is above zero
    largest = np.argmax(np.abs(pairs.vectors), axis=0)
    signs = np.sign(pairs.vectors[largest, np.arange(count)])
    vectors *= signs[:, None, None]
    return NetworkModes(
        frequencies=pairs.omega / (2.0 * math.pi),
        vectors=vectors,
        displacements=len(motions.translations),
        moving=operator.balls.size,
        zero_modes=pairs.zeros,
        residual=pairs.residual,
        network=network,
    )


def _read_target(nearest: float | None) -> float:
    """Return the angular frequency, rad/s, of the frequency ``nearest``, Hz; zero for None."""
    return 0.0 if nearest is None else 2.0 * math.pi * not_negative("nearest", nearest, "Hz")


def find_damped(
    operator: WaveOperator, count: int, nearest: float | None, losses: Losses
) -> DampedModes:
    """Return ``count`` damped modes of a network that is stable, the lowest or those nearest to the
    frequency ``nearest``, Hz; see :meth:`granphon.waves.waves.Waves.damped_modes`.
    """
    even = losses.find_even()
    if even is not None:
        modes = find_modes(operator, count, nearest)
        omega = damp_evenly(2.0 * math.pi * modes.frequencies, *even)
        order = np.argsort(omega)  # by real parts: the highest modes are the first to creep
        vectors = modes.vectors[order].astype(complex)
        highest = float(modes.frequencies[-1])
        return DampedModes(
            frequencies=omega[order] / (2.0 * math.pi),
            vectors=vectors,
            warnings=losses.find_warnings(highest),
        )
    count = whole_number("count", count, 1)
    omega, shapes = _find_unevenly_damped(operator, losses, count, _read_target(nearest))
    vectors = np.zeros((count, operator.network.n_balls, operator.motions.count), complex)
    vectors[:, operator.balls] = np.moveaxis(operator.values(shapes), -1, 0)
    # without losses, a motion of this shape has the frequency of Rayleigh's quotient
    forces = np.asarray(operator.matrix @ shapes)
    squares = np.sum(shapes.conj() * forces, axis=0).real
    highest = math.sqrt(max(float(np.max(squares)), 0.0)) / (2.0 * math.pi)
    return DampedModes(
        frequencies=omega / (2.0 * math.pi),
        vectors=vectors,
        warnings=losses.find_warnings(highest),
    )


def _find_unevenly_damped(
    operator: WaveOperator, losses: Losses, count: int, target: float
) -> tuple[Complex, Complex]:
    """Return angular frequencies (count,), rad/s, and shapes (size, count) of the modes nearest to
    ``target``, rad/s, of motions that are damped differently: by the real part if all modes are
    found, else by the complex frequency.

    InputError for a network too large, for more modes than cost energy, and for more than are found
    in a large network.
    """
    problem = Problem.of(operator)
    top = operator.top
    live = problem.live
    if live.size > LARGEST_FACTORS[operator.network.dimension]:
        mend = "Damp all contacts alike, or take a smaller network"
        raise InputError(f"{live.size:,} motions that are damped unevenly are too many", mend=mend)
    # in units of the top frequency: x'' + viscous x' + stiffness x = 0
    lossy = (operator.matrix + 1j * operator.weigh(losses.factors)) / top**2
    stiffness = lossy.tocsr()[live][:, live]
    viscous = (operator.resist(losses) / top).tocsr()[live][:, live]
    # where drag differs it couples the motions that cost no energy to the others
    drags = losses.drag_of(operator.motions)
    is_coupled = bool(np.ptp(drags) > 0.0)
    # the matrix of first order has twice the size of D
    is_small = 2 * live.size <= DENSE
    are_many = _SHARE * (2 * count + _SPARE) > 2 * live.size
    is_dense = is_small or (are_many and live.size <= DENSE)
    find = _find_damped_dense if is_dense else _find_damped_near
    omega_over_top, vectors = find(problem, stiffness, viscous, count, target / top, is_coupled)
    shapes = np.zeros((operator.size, count), complex)
    shapes[live] = vectors
    return omega_over_top * top, shapes


def _find_damped_dense(
    problem: Problem, stiffness: Any, viscous: Any, count: int, target: float, is_coupled: bool
) -> tuple[Complex, Complex]:
    """Return the ``count`` modes nearest to ``target``, over top, among all: omega over top
    (count,), and vectors (live, count); InputError if fewer cost energy.

    ``stiffness`` and ``viscous`` (live, live) are the matrices of x and x', in units of the top
    frequency; with ``is_coupled`` the latter couples motions that cost no energy to the others.
    """
    squares, shapes = _diagonalise(problem, count)
    costs_energy = find_roots(problem.operator, squares) > ZERO * problem.top
    elastic = shapes[:, costs_energy]
    if elastic.shape[1] < count:
        raise make_too_few(elastic.shape[1], count)
    basis = shapes if is_coupled else elastic
    reduced_stiffness = basis.T @ np.asarray(stiffness @ basis)
    reduced_viscous = basis.T @ np.asarray(viscous @ basis)
    omega, vectors = damp_unevenly(reduced_stiffness, reduced_viscous)
    if is_coupled:
        omega, vectors = _leave_out_zeros(omega, vectors)
    chosen = _choose_damped(omega, count, target)
    return omega[chosen], basis @ vectors[:, chosen]


def _leave_out_zeros(omega: Complex, vectors: Complex) -> tuple[Complex, Complex]:
    """Return the modes ``omega`` (m,), over top, and ``vectors`` (n, m) without those of frequency
    zero, whose motions cost no energy.
    """
    moves = np.abs(omega) > ZERO
    return omega[moves], vectors[:, moves]


def _find_damped_near(
    problem: Problem, stiffness: Any, viscous: Any, count: int, target: float, is_coupled: bool
) -> tuple[Complex, Complex]:
    """Return the ``count`` modes nearest to ``target`` by factors, as
    :func:`_find_damped_dense`.

    Raises :class:`~granphon.base.errors.InputError` if fewer modes cost energy, or so many are
    requested that Arnoldi's method would have to find half of all rates, of which there are two for
    each mode.
    """
    still = _find_still(problem, count)
    available = problem.live.size - still.shape[1]
    if available < count:
        raise make_too_few(available, count)
    rate_count = 2 * count + _SPARE  # modes that swing have two rates
    if is_coupled:
        rate_count += still.shape[1]  # rates of zero, which are left out later
        still = still[:, :0]
    while rate_count <= available:
        omega, vectors = _follow_damped(stiffness, viscous, still, rate_count, target)
        if is_coupled:
            omega, vectors = _leave_out_zeros(omega, vectors)
        chosen = _choose_damped(omega, count, target)
        if chosen.size == count:
            return omega[chosen], vectors[:, chosen]
        # some rates are those of one mode: mirrored ones, and the faster ones of modes that creep
        rate_count *= 2
    fault = (
        f"{count} modes of {problem.live.size} motions that are damped unevenly are too many to be"
        f" found"
    )
    raise InputError(fault, mend="Ask for fewer")


def _choose_damped(omega: Complex, count: int, target: float) -> NDArray[np.intp]:
    """Return the indices of the ``count`` modes whose real parts are nearest to ``target``, or of
    all if they are fewer, in ascending order of the real part, then of the imaginary part.
    """
    nearest = np.lexsort((omega.imag, np.abs(omega.real - target)))[:count]
    return nearest[np.lexsort((omega[nearest].imag, omega[nearest].real))]


def _find_still(problem: Problem, count: int) -> Array:
    """Return the motions (live, n_still) that cost no energy, orthonormal: by factors, and by a
    dense matrix where factors do not find them all.

    ``count``, the number of modes that are requested, is for the message of a matrix too large.
    """
    n_zeros = problem.count_below((ZERO * problem.top) ** 2)
    if not n_zeros:
        return np.zeros((problem.live.size, 0))
    shift = -_SHIFT * problem.top**2
    n_searched = n_zeros + _SPARE
    solve = problem.factors(shift).solve
    while n_searched * _SHARE <= problem.live.size:
        _, vectors = find_nearest(problem.shifted(0.0), n_searched, shift, solve)
        omega, modes, _ = problem.refine(vectors)
        is_still = omega <= ZERO * problem.top
        if np.count_nonzero(is_still) == n_zeros:
            return modes[problem.live][:, is_still]
        n_searched *= 2
    squares, vectors = _diagonalise(problem, count)
    is_still = find_roots(problem.operator, squares) <= ZERO * problem.top
    return np.asarray(vectors[:, is_still])


@single_products()
def _follow_damped(
    stiffness: Any, viscous: Any, still: Array, rate_count: int, target: float
) -> tuple[Complex, Complex]:
    """Return modes of x'' + G x' + D x = 0, with D the ``stiffness`` and G the ``viscous`` matrix
    (n, n): omega (m,) of the ``rate_count`` rates nearest to ``target``, and vectors (n, m), in
    units of the top frequency.

    With y = x', ((0, 1), (-D, -G)) - s is solved by the factors of D + s G + s^2. Arnoldi's vectors
    z = (x, y) are kept free of the motions ``still`` (n, n_still), which cost no energy: each has
    the rate zero twice, nearer than all other rates. A motion that creeps has two rates, the roots
    of r^2 + (x.Gx) r + x.Dx; the slower of the two, above their mean, is kept.
    """
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import LinearOperator, eigs

    n = stiffness.shape[0]
    shift = math.sqrt(_SHIFT) + 1j * target
    unit: Any = eye_array(n)
    matrix = (stiffness + shift * viscous + shift**2 * unit).astype(complex)
    factors = factorise(matrix)

    def free(z: Any) -> Any:
        """Return z (2 n,) without the motions that cost no energy."""
        # real columns (n, 4): a product of the real ``still`` with complex numbers would copy it
        columns = np.stack([z[:n].real, z[:n].imag, z[n:].real, z[n:].imag], axis=1)
        columns -= still @ (still.T @ columns)
        x = columns[:, 0] + 1j * columns[:, 1]
        y = columns[:, 2] + 1j * columns[:, 3]
        return np.concatenate([x, y])

    def apply(z: Any) -> Any:
        """Return the matrix of first order times z (2 n,)."""
        return np.concatenate([z[n:], -(stiffness @ z[:n]) - viscous @ z[n:]])

    def solve(z: Any) -> Any:
        """Return the inverse of the matrix of first order less the shift, times z (2 n,)."""
        x = -factors.solve(z[n:] + viscous @ z[:n] + shift * z[:n])
        return free(np.concatenate([x, z[:n] + shift * x]))

    whole = LinearOperator((2 * n, 2 * n), matvec=apply, dtype=complex)
    inverse = LinearOperator((2 * n, 2 * n), matvec=solve, dtype=complex)
    start = free(np.random.default_rng(0).normal(size=2 * n).astype(complex))
    with lanczos_converges():
        rates, vectors = eigs(whole, k=rate_count, sigma=shift, OPinv=inverse, v0=start)
    omega = -1j * rates
    shapes = vectors[:n] / np.linalg.norm(vectors[:n], axis=0)
    creeps = np.abs(omega.real) <= ZERO
    omega = np.where(creeps, 1j * omega.imag, omega)
    sums_of_rates = np.sum(shapes.conj() * (viscous @ shapes), axis=0).real  # x.Gx
    is_slower = 2.0 * omega.imag < sums_of_rates
    is_kept = np.where(creeps, is_slower, omega.real > 0.0)  # one of each pair of rates
    return omega[is_kept], shapes[:, is_kept]


# -- modes of forces without a potential -----------------------------------------------------------


def find_whole(operator: WaveOperator, count: int, nearest: float | None) -> DampedModes:
    """Return ``count`` modes of :attr:`WaveOperator.whole` of a network that is stable, the lowest
    or those nearest to the frequency ``nearest``, Hz; see
    :meth:`granphon.waves.waves.Waves.whole_modes`.

    Small matrices are dense, all others are factorised, and Arnoldi's method finds the eigenvalues
    nearest to that frequency squared, ever more of them until enough cost energy.
    """
    count = whole_number("count", count, 1)
    target = _read_target(nearest)
    live = Problem.of(operator).live
    require_motions(count, live.size)
    whole = operator.matrix if operator.whole is None else operator.whole
    matrix = (whole / operator.top**2).tocsr()[live][:, live]
    squares, columns = _diagonalise_whole(operator, matrix, count, target / operator.top)
    shapes = np.zeros((operator.size, count), complex)
    shapes[live] = columns
    vectors = np.zeros((count, operator.network.n_balls, operator.motions.count), complex)
    vectors[:, operator.balls] = np.moveaxis(operator.values(shapes), -1, 0)
    omega: Complex = np.asarray(operator.top * np.sqrt(squares), complex)
    return DampedModes(
        frequencies=omega / (2.0 * math.pi),
        vectors=vectors,
        warnings=network_warnings(operator.network),
    )


def _diagonalise_whole(
    operator: WaveOperator, matrix: Any, count: int, target: float
) -> tuple[Complex, Complex]:
    """Return the squares (count,) of the complex frequencies nearest to ``target`` among those that
    cost energy, ascending, and vectors (live, count) of norm one.

    ``matrix`` (live, live) is the whole in units of the square of the top frequency, as are the
    squares; the target is in units of that frequency. InputError if fewer cost energy, or so many
    are requested that Arnoldi's method would have to find a third of all, and for a matrix that is
    too large.
    """
    size = matrix.shape[0]
    if size <= DENSE:
        squares, vectors = np.linalg.eig(matrix.toarray())
        chosen = _choose_whole(operator, squares, count, target)
        if chosen.size < count:
            raise make_too_few(chosen.size, count)
        return squares[chosen].astype(complex), vectors[:, chosen].astype(complex)
    if size > LARGEST_UNSYMMETRIC[operator.network.dimension]:
        fault = f"the matrix of {size:,} motions is not symmetric, and too large to be factorised"
        raise InputError(fault, mend="Ask for modes of its symmetric part, or take fewer balls")
    shift = -_SHIFT if target <= ZERO else target**2
    n_searched = count + _SPARE
    while n_searched * _SHARE <= size:
        squares, vectors = _find_nearest_whole(matrix, n_searched, shift)
        chosen = _choose_whole(operator, squares, count, target)
        if chosen.size == count:
            return squares[chosen], vectors[:, chosen]
        n_searched *= 2
    raise InputError(f"{count} modes of {size:,} motions are too many", mend="Ask for fewer")


@single_products()
def _find_nearest_whole(matrix: Any, count: int, shift: float) -> tuple[Complex, Complex]:
    """Return the ``count`` complex eigenvalues of a real sparse ``matrix`` (n, n) nearest to
    ``shift``, and their vectors (n, count).
    """
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import LinearOperator, eigs

    factors = factorise((matrix - shift * eye_array(matrix.shape[0])).tocsc(), symmetric=False)
    inverse = LinearOperator(matrix.shape, matvec=factors.solve, dtype=float)
    start = np.random.default_rng(0).normal(size=matrix.shape[0])
    with lanczos_converges():
        squares, vectors = eigs(matrix, k=count, sigma=shift, OPinv=inverse, v0=start)
    return squares, vectors


def _choose_whole(
    operator: WaveOperator, squares: Complex, count: int, target: float
) -> NDArray[np.intp]:
    """Return the indices of the ``count`` eigenvalues whose real frequencies are nearest to
    ``target``, in the order of :class:`DampedModes`; of fewer, if no more cost energy.
    """
    # below is rounding, and what forces that are left on balls at rest do
    costs_energy = np.flatnonzero(np.abs(squares) > find_fall(operator) / operator.top**2)
    omega = np.sqrt(squares[costs_energy].astype(complex))
    return costs_energy[_choose_damped(omega, count, target)]


def require_stable(operator: WaveOperator) -> None:
    """Raise :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero,
    see :func:`is_stable`.
    """
    if not is_stable(operator):
        raise explain_instability(operator.network)


def is_stable(operator: WaveOperator, fall: float | None = None) -> bool:
    """Return whether no squared frequency is below zero by more than ``fall``, (rad/s)^2, by
    default :func:`find_fall`.

    Only static forces make a square below zero. Where static tangential forces act, and D has a
    square below zero, the lowest eigenvalue of the whole matrix that is not symmetric decides: its
    real part is not below the lowest of D. For networks too large to be factorised the lowest Ritz
    value of a Krylov space of D decides; with static tangential forces that value may be below zero
    by the part :data:`_RITZ_ERROR` of the bound of all squares, whatever ``fall`` is.
    """
    if not operator.network.prestress:
        return True
    whole = operator.whole
    least_square = -(find_fall(operator) if fall is None else fall)
    if not _has_factors(operator):
        least_ritz_value = least_square if whole is None else -_RITZ_ERROR * operator.top**2
        return _search_lowest(operator) >= least_ritz_value
    problem = Problem(operator, np.arange(operator.size))
    if not problem.count_below(least_square):
        return True
    if whole is None:
        return False
    lowest, _ = _find_lowest_of_whole(operator, whole, least_square)
    return lowest >= least_square


def find_falls(operator: WaveOperator, fall: float) -> Array:
    """Return motions (size, m) by which a network that is not stable falls: modes whose squared
    frequency is below zero by more than ``fall``, (rad/s)^2.

    All such modes are returned; with static tangential forces only the sizes of the lowest mode.
    Raises :class:`~granphon.base.errors.InstabilityError` for a network too large to be factorised.
    """
    if not _has_factors(operator):
        raise explain_instability(operator.network)
    whole = operator.whole
    if whole is not None:
        _, sizes = _find_lowest_of_whole(operator, whole, -fall)
        return sizes[:, None]
    network = operator.network
    problem = Problem(operator, np.arange(operator.size))
    # no square is lower than twice that of a single ball which static forces alone move
    static_stiffness = np.maximum(network.normal_force, 0.0) / network.distance
    of_balls = np.bincount(network.i, static_stiffness, network.n_balls)
    of_balls = of_balls + np.bincount(network.j, static_stiffness, network.n_balls)
    shift = -2.0 * float(np.max(of_balls / network.masses))
    count = problem.count_below(-fall)
    solve = problem.factors(shift).solve
    _, vectors = find_nearest(problem.shifted(0.0), count, shift, solve)
    return np.asarray(vectors)


def _has_factors(operator: WaveOperator) -> bool:
    """Return whether the matrix of the network is small enough to be factorised."""
    return operator.size <= LARGEST_FACTORS[operator.network.dimension]


def _find_lowest_of_whole(operator: WaveOperator, whole: Any, low: float) -> tuple[float, Array]:
    """Return the lowest real part of an eigenvalue of :attr:`WaveOperator.whole`, ``whole`` (size,
    size), (rad/s)^2, and the sizes (size,) of the motions of its eigenvector.

    The search begins at ``low``, (rad/s)^2, below zero, and lower if D has eigenvalues below it. D
    is the symmetric part of the whole, so that no eigenvalue of the whole has a real part below the
    lowest of D, and all are above the shift. The eigenvalue nearest to the shift is taken as the
    lowest: a complex pair farther away, of a lower real part, would be passed over.
    """
    from scipy.sparse.linalg import eigs

    # all motions, as in the whole matrix, those that no spring holds among them
    problem = Problem(operator, np.arange(operator.size))
    shift = low
    while problem.count_below(shift):
        shift *= _LOWER
    start = np.random.default_rng(0).normal(size=operator.size)
    with lanczos_converges():
        eigenvalues, vectors = eigs(whole.tocsc(), k=1, sigma=shift, v0=start, tol=1e-8)
    return float(eigenvalues[0].real), np.abs(vectors[:, 0])


def _search_lowest(operator: WaveOperator) -> float:
    """Return the lowest Ritz value of the Krylov space of a random vector, (rad/s)^2, by Lanczos's
    recursion: above the lowest eigenvalue of D.
    """
    from scipy.linalg import eigvalsh_tridiagonal

    x = np.random.default_rng(0).normal(size=operator.size)
    x /= np.linalg.norm(x)
    previous = np.zeros(operator.size)
    coupling = 0.0
    diagonal = []
    couplings = []
    for _ in range(_KRYLOV):
        y = operator @ x - coupling * previous
        diagonal.append(float(x @ y))
        y -= diagonal[-1] * x
        coupling = float(np.linalg.norm(y))
        couplings.append(coupling)
        previous = x
        x = y / coupling
    ritz_values = eigvalsh_tridiagonal(
        np.array(diagonal), np.array(couplings[:-1]), select="i", select_range=(0, 0)
    )
    return float(ritz_values[0])


def _diagonalise(problem: Problem, count: int) -> tuple[Array, Array]:
    """Return all eigenvalues (live,) and eigenvectors (live, live) of D, of which ``count`` modes
    are requested.

    Raises :class:`~granphon.base.errors.InputError` for a matrix that is too large.
    """
    from scipy.linalg import eigh

    if problem.live.size > _LARGEST:
        fault = (
            f"{count} modes of {problem.live.size} motions, with those without energy, are too"
            f" many to be found"
        )
        raise InputError(fault, mend="Ask for fewer")
    squares, vectors = eigh(problem.shifted(0.0).toarray())
    return squares, vectors


def _find_dense(problem: Problem, count: int, target: float) -> Eigenpairs:
    """Return the ``count`` modes nearest to ``target``, rad/s, among all; InputError if fewer cost
    energy, and for a matrix that is too large.
    """
    squares, vectors = _diagonalise(problem, count)
    omega = find_roots(problem.operator, squares)
    chosen = problem.choose(omega, count, target)
    if chosen.size < count:
        raise make_too_few(chosen.size, count)
    n_zeros = int(np.sum(omega <= ZERO * problem.top))
    refined_omega, modes, residuals = problem.refine(vectors[:, chosen])
    return Eigenpairs(refined_omega, modes, float(residuals.max()), problem.loose + n_zeros)


def _find_factored(problem: Problem, count: int, target: float) -> Eigenpairs:
    """Return the ``count`` modes nearest to ``target``, rad/s, by factors at a shift next to it;
    more modes are sought until none is missed, and in the end all, by :func:`_find_dense`.

    In packings most modes that cost no energy are of single balls, which turn about the line
    through their two contacts. These are known, and Lanczos's vectors are kept free of them.
    InputError if fewer modes cost energy.
    """
    size = problem.live.size
    top = problem.top
    shift = -_SHIFT * top**2 if target <= ZERO * top else target**2
    factors = problem.factors(shift)
    free = problem.free_motions
    start = np.random.default_rng(0).normal(size=size)
    start -= free @ (free.T @ start)

    def solve(right: Array) -> Array:
        """Return the solution, without what rounding has of single balls that move freely."""
        solution = factors.solve(right)
        return np.asarray(solution - free @ (free.T @ solution))

    n_searched = count + _SPARE
    while n_searched * _SHARE <= size:
        _, vectors = find_nearest(problem.shifted(0.0), n_searched, shift, solve, start)
        omega, modes, residuals = problem.refine(vectors)
        chosen = problem.choose(omega, count, target)
        n_searched *= 2
        if chosen.size < count:
            n_zeros = problem.count_below((ZERO * top) ** 2)
            if count > size - n_zeros:
                raise make_too_few(size - n_zeros, count)
            n_searched = max(n_searched, count + n_zeros - free.shape[1] + _SPARE)
        elif np.max(residuals[chosen]) <= RESIDUAL:
            known_zeros = _prove_complete(problem, omega, chosen, target)
            if known_zeros is not None:
                largest_residual = float(residuals[chosen].max())
                return Eigenpairs(
                    omega[chosen], modes[:, chosen], largest_residual, problem.loose + known_zeros
                )
    return _find_dense(problem, count, target)


def _find_large(problem: Problem, count: int, target: float) -> Eigenpairs:
    """Return the ``count`` modes nearest to ``target``, rad/s, of a network too large to be
    factorised: the lowest ones by a block of vectors, unless many modes cost no energy; all others
    by filters.
    """
    pairs = _follow_lowest(problem, count) if target <= ZERO * problem.top else None
    pairs = pairs or find_filtered(problem, count, target)
    return pairs or _find_dense(problem, count, target)


def _follow_lowest(problem: Problem, count: int) -> Eigenpairs | None:
    """Return the ``count`` lowest modes by a block of vectors; None if the network is small, or if
    more modes cost no energy than the block is to hold, besides motions of single balls, which are
    known.
    """
    operator = problem.operator
    known = problem.find_idle()
    n_expected = _count_rigid(operator)
    while n_expected <= _ZEROS and _SHARE * size_block(count + n_expected) <= operator.size:
        found = find_lowest(operator, operator.matrix, count + n_expected, known)
        is_elastic = find_roots(operator, found.values) > ZERO * problem.top
        n_zeros = int(np.count_nonzero(~is_elastic))
        if n_zeros <= n_expected:
            vectors = found.vectors[problem.live][:, is_elastic][:, :count]
            omega, modes, residuals = problem.refine(vectors)
            return Eigenpairs(omega, modes, float(residuals.max()), known.shape[1] + n_zeros)
        n_expected = max(2 * n_expected, n_zeros)
    return None


def _count_rigid(operator: WaveOperator) -> int:
    """Return the number of motions of the whole network, if nothing holds it."""
    network = operator.network
    if not np.all(network.moving) or np.any(operator.anchors):
        return 0
    motions = operator.motions
    return len(motions.translations) if np.any(network.pbc) else motions.count


def _prove_complete(
    problem: Problem, omega: Array, chosen: NDArray[np.intp], target: float
) -> int | None:
    """Return the number of modes that cost no energy, if all modes nearer to ``target``, rad/s,
    than the farthest of the ``chosen`` ones are among ``omega`` (m,), rad/s; None if one is
    missing.
    """
    zero = ZERO * problem.top
    n_free = problem.free_motions.shape[1]
    reach = np.max(np.abs(omega[chosen] - target)) * (1.0 - _INSIDE)
    low = target - reach
    high = target + reach
    n_below_high = problem.count_below(high**2)
    if low <= zero:  # all modes below are among those that are known
        is_complete = n_below_high == n_free + np.count_nonzero(omega < high)
        return n_free + int(np.count_nonzero(omega <= zero)) if is_complete else None
    n_within = n_below_high - problem.count_below(low**2)
    is_complete = n_within == np.count_nonzero((omega > low) & (omega < high))
    return problem.count_below(zero**2) if is_complete else None


def count_modes(operator: WaveOperator, frequencies: Array) -> NDArray[np.intp]:
    """Return the numbers (n_f,) of modes below ``frequencies`` (n_f,), Hz, of a network that is
    stable; see :meth:`granphon.waves.waves.Waves.count_modes`.
    """
    problem = Problem.of(operator)
    size = problem.live.size
    limit = LARGEST_FACTORS[operator.network.dimension]
    if size > limit:
        raise InputError(
            f"modes of {size:,} motions are too many to be counted",
            f"Matrices are factorised up to {limit:,}",
            "Integrate the density of states, waves.dos()",
        )
    omega = np.maximum(2.0 * math.pi * frequencies, ZERO * problem.top)
    counts = np.full(omega.size, size)
    with operator.progress.step("modes below frequencies", omega.size) as step:
        for row, value in enumerate((omega**2).tolist()):
            if value <= problem.top**2:
                counts[row] = problem.count_below(value)
            step.advance()
    return problem.loose + counts
