"""Modes of finite networks: the lowest, or those nearest to a frequency.

There are four methods, for networks of more and more motions:

- All modes of a small matrix are found by a dense solver.
- Larger matrices are factorised at a shift, and Lanczos finds the modes nearest to the shift. The
  factors also say, by Sylvester's law of inertia, how many eigenvalues are below a value, so that
  no mode is missed.
- Where the factors would be too large, the lowest modes are found by a block of vectors
  (:mod:`granphon.waves.lowest`).
- There, modes nearest to another frequency are filtered out of random vectors.

Filters use the angle phi of omega = top cos(phi/2), where top is an upper bound of all angular
frequencies. The polynomials T_n(2 D / top^2 - 1) are cos(n phi). A filter is a sum of these
polynomials up to the order M, and its coefficients are one of Slepian's sequences (Bell Syst. Tech.
J. 57, 1371 (1978)): as much of the filter as the order allows lies in a window of phi of the width
2 H. There are 2 M H / pi such filters. All filters are applied to a few random vectors in one
recursion. If there are well more filtered vectors than modes in the window, they span these modes:
filter diagonalisation (Wall and Neuhauser, J. Chem. Phys. 102, 8011 (1995)). The window that holds
a number of modes follows from the density of states, by the kernel polynomial method.

Every mode has a share in a random vector. So after the modes are found, fresh random vectors are
filtered, and their parts along the found modes are subtracted. The squares of what remains count
the modes in the window that are missing.
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
from granphon.base.memory import require_memory
from granphon.base.results import Result, held, read_only, result_class
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
MOST_DENSE_MOTIONS = 600
#: most modes that a request may name: no network has as many
MOST_MODES = 10**9
#: copies of the modes that are held at a time: the vectors in which they are found, an orthonormal
#: basis of these and its product with D, and the modes, their product with D and their residuals
_MODE_COPIES = 6.0
#: frequency over the top frequency at or below which a mode counts as a zero mode, one that costs
#: no energy
ZERO = 1e-6
#: squared frequency of a ball that moves alone, over top^2, up to which the square is zero but for
#: rounding
_FREE_SQUARE = 1e-14
#: random vectors of the density of states from which the window follows
_VECTORS = 4
#: Chebyshev moments of that density
_MOMENTS = 512
#: half width of a line in that density, over the standard deviation of the kernel
_LINE_HALF_WIDTH = 4.0
#: numbers of filters of a window that are tried; many filters pay where nearly all of a window has
#: no modes
_FILTER_COUNTS = (32, 48, 64, 96, 128, 192, 256, 384)
#: numbers of random vectors to begin with, tried in this order until memory suffices: of modes that
#: share one frequency, as many are found as there are random vectors
_START_COUNTS = (12, 8, 6, 4)
#: filtered vectors, over the modes in the window
_VECTORS_PER_MODE = 2.3
#: share of a window, next to its ends, in which modes are not found, times the number of filters
_EDGE_SHARE = 6.4
#: share of a window, about its middle, in which no mode may be missing before the search goes on
#: with a wider window
_CORE_SHARE = 0.8
#: half width of the next window, without its ends, over that of a window that held too few modes
_WIDENING = 1.1
#: modes that the middle of a window holds by the density of states, over those that are requested
_HELD_PER_REQUESTED = 2
#: fewest fresh random vectors
_LEAST_FRESH_VECTORS = 4
#: number of random vectors so far over that of the fresh ones that are filtered next
_GROWTH = 3
#: time of a product with D and of the sums of its vector into filters, over the time of the product
#: alone: the sums take as long as the product
_PRODUCT_WITH_SUMS = 2.0
#: factorisations of a search for modes: one at the shift, with its solutions, and two to count the
#: modes below both ends of the interval that was searched
_FACTORS_OF_MODES = 3.0
#: mean square of the residuals of fresh vectors below which no mode is missing; a missing mode adds
#: 1, and less than this limit with four vectors once in a thousand times
_LEAST_RESIDUAL = 0.02
#: most zero modes that a search finds and counts; if there are more, the search keeps clear of zero
#: modes from the beginning, and does not count them
_MOST_ZEROS = 48
#: lowest frequency that is searched for missing modes, over the highest that is requested, in a
#: search that keeps clear of zero modes
_SOFTEST_SHARE = 0.03
#: most bytes of all filtered vectors
_MOST_BYTES = 2**32
#: copies of the filtered vectors that are held at a time
_VECTOR_COPIES = 3
#: most products of D with a vector
_MOST_PRODUCTS = 2_000_000
#: rows of filtered vectors that are worked on at a time
_ROWS = 2**9
#: number of vectors T_n x that are kept, and then multiplied by the coefficients of all filters
_KEPT_POLYNOMIALS = 32
#: columns of a basis that are worked on at a time
_COLUMNS = 32
#: most motions of a matrix that is made dense because many modes are requested, or because many
#: modes cost no energy: such a matrix and its modes take 2 GB
_LARGEST_DENSE = 10_000
#: number of all modes over that of the modes that are searched, below which all modes are found
#: instead, by a dense matrix
_ALL_OVER_FOUND = 3
#: size of the shift below zero of the factors for the lowest modes, over top^2
_SHIFT = 1e-6
#: products with D that tell whether a network too large to be factorised is stable
_KRYLOV_PRODUCTS = 400
#: error of the lowest eigenvalue by these products, over top^2. The lowest eigenvalue of D is below
#: that of the whole matrix by a tenth of this error, where overlaps are d/50
_RITZ_ERROR = 1e-5
#: greatest rate of growth of a fall, over the top frequency, that forces left on balls at rest
#: excuse; a network that grows faster is unstable
_LARGEST_FALL = 1e-4
#: vectors of a Krylov space beyond those that are requested
_EXTRA_VECTORS = 8
#: shifts, over top^2, that are tried where a matrix is exactly singular, as its shift is an
#: eigenvalue
_NUDGES = (0.0, 1e-9, -1e-7)
#: factor by which a shift is lowered until it is below all eigenvalues
_LOWERING = 100.0
#: relative amount by which an interval of frequencies is shortened, so that the farthest mode, at
#: its end, is not counted within it
_END_MARGIN = 1e-9
#: points in phi at which the weight of filters between two ends is sampled
_PHI_POINTS = 33
#: weight of those filters of a window that are used to find a missing mode, over the weight of all
#: filters of the window
_WEIGHT_SHARE = 0.5


class Eigenpairs(NamedTuple):
    """Modes of D, and how far they were found.

    Attributes
    ----------
    omega : (m,) angular frequencies, rad/s, ascending.
    vectors : (size, m) modes, of norm one.
    residual : the largest norm of D x - omega^2 x of a mode x, over top^2.
    n_zeros : number of all modes of the network that cost no energy; None if they were not counted.
    """

    omega: Array
    vectors: Array
    residual: float
    n_zeros: int | None


class Problem:
    """The eigenvalue problem of D on its live motions: those that some spring or static force acts
    on (:meth:`of`), or all.

    Attributes
    ----------
    operator : D on all motions.
    live : (n_live,) indices of the live motions, ascending. In shapes, "live" is their number.
    top : bound of all angular frequencies, rad/s.
    n_loose : number of the other motions, which nothing acts on.
    """

    def __init__(self, operator: WaveOperator, live: NDArray[np.intp]) -> None:
        self.operator = operator
        self.live = live
        self.top = operator.top
        self.n_loose = operator.size - live.size

    @classmethod
    def of(cls, operator: WaveOperator) -> Self:
        """Return the problem of the motions that have an entry in the matrix of the ``operator``:
        those that some spring or static force acts on.
        """
        return cls(operator, np.flatnonzero(np.diff(operator.matrix.indptr) > 0))

    @property
    def has_factors(self) -> bool:
        """Whether the matrix of the live motions is small enough to be factorised."""
        return self.live.size <= LARGEST_FACTORS[self.operator.network.dimension]

    @cached_property
    def free_motions(self) -> Any:
        """Orthonormal motions (live, n_free), a sparse array, of single balls that deform no
        contact, such as the rotation about the line through two contacts; none with prestress.
        Balls with a motion that nothing acts on are left out.
        """
        from scipy.sparse import csc_array

        operator = self.operator
        size = self.live.size
        if operator.network.prestress:
            return csc_array((size, 0))
        squares, vectors = np.linalg.eigh(operator.ball_blocks)
        balls, modes = np.nonzero(squares <= _FREE_SQUARE * self.top**2)
        places = operator.values(np.arange(operator.size))[balls]  # (k, motions) in a vector
        live_index = np.full(operator.size, -1)
        live_index[self.live] = np.arange(size)
        rows = live_index[places]
        is_live = np.all(rows >= 0, axis=1)
        entries = vectors[balls, :, modes][is_live]
        starts = operator.motions.count * np.arange(len(entries) + 1)
        return csc_array((entries.ravel(), rows[is_live].ravel(), starts), (size, len(entries)))

    def collect_known_zeros(self) -> Any:
        """Return orthonormal motions (size, k), a sparse array, that are known to cost no energy:
        each motion that nothing acts on, and :attr:`free_motions`.
        """
        from scipy.sparse import eye_array, hstack

        unit = eye_array(self.operator.size, format="csc")
        loose_motions = np.setdiff1d(np.arange(self.operator.size), self.live)
        free_motions = unit[:, self.live] @ self.free_motions
        return hstack([unit[:, loose_motions], free_motions], format="csr")

    @cached_property
    def _entries(self) -> list[Any]:
        """A sparse matrix (live, live) that has an entry wherever D or the unit matrix has one; and
        in the order of its entries the numbers (entries,) of D, (rad/s)^2, and those of the unit
        matrix.
        """
        from scipy.sparse import eye_array

        matrix = self.operator.matrix
        if self.n_loose:
            matrix = matrix[self.live][:, self.live]
        return share_places([matrix, eye_array(self.live.size)])

    def shifted(self, value: float) -> Any:
        """Return D less ``value``, (rad/s)^2, times the unit matrix: a sparse matrix (live, live)
        whose entries are in the same places for every value, so that all are eliminated in one
        order.
        """
        places, matrix_entries, unit_entries = self._entries
        matrix = places.copy()
        matrix.data = matrix_entries - value * unit_entries
        return matrix

    @cached_property
    def _elimination(self) -> Elimination:
        """The order of elimination, which is the same for D less any value."""
        places, _, _ = self._entries
        return Elimination(places)

    def factorise_shifted(self, value: float) -> Factors:
        """Return the factors of :meth:`shifted` at ``value``, (rad/s)^2; if this matrix is exactly
        singular, its factors at a value a little beside.

        Raises :class:`~granphon.base.errors.ConvergenceError` if all matrices tried are singular.
        """
        for nudge in _NUDGES:
            matrix = self.shifted(value + nudge * self.top**2)
            try:
                return self._elimination.factorise(matrix)
            except RuntimeError:  # exactly singular: the shift is an eigenvalue
                continue
        raise ConvergenceError("the matrix of the network cannot be factorised")

    def count_below(self, value: float) -> int:
        """Return the number of eigenvalues of D on the live motions below ``value``, (rad/s)^2; if
        the value is exactly an eigenvalue, the number below a value a little beside. Raises what
        :meth:`factorise_shifted` raises.
        """
        return self.factorise_shifted(value).n_below

    def refine(self, vectors: Array) -> tuple[Array, Array, Array]:
        """Return the best approximations of modes in the space of ``vectors`` (live, m): angular
        frequencies (m,), rad/s, ascending, modes (size, m) and residuals (m,) over top^2.

        Without static forces the modes are found as singular vectors of A, so that low frequencies
        lose no digits. With static forces they are eigenvectors of D, and the method raises what
        :func:`find_roots` raises.
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

    def choose_nearest(self, omega: Array, count: int, target: float) -> NDArray[np.intp]:
        """Return the indices, ascending, of the ``count`` modes nearest to ``target``, rad/s, among
        modes of the frequencies ``omega`` (m,), rad/s. Zero modes are left out, and so there are
        fewer indices if fewer modes cost energy.
        """
        elastic_modes = np.flatnonzero(omega > ZERO * self.top)
        nearest_first = np.argsort(np.abs(omega[elastic_modes] - target), kind="stable")
        return np.sort(elastic_modes[nearest_first[:count]])


def _find_singular(deformations: Array) -> tuple[Array, Array]:
    """Return the singular values (m,), ascending, and the right singular vectors (m, m) of the
    matrix ``deformations`` (rows, m); if it has fewer rows than m, the first values are zero.
    """
    # the triangle of a QR decomposition has the same singular values and right vectors as the
    # matrix, and far fewer rows
    triangle = np.asarray(np.linalg.qr(deformations, mode="r"))
    try:
        _, singular_values, right_rows = np.linalg.svd(triangle)
    except np.linalg.LinAlgError:
        # LAPACK's fast method fails on some matrices with hundreds of singular values near zero;
        # gesvd does not
        from scipy.linalg import svd

        _, singular_values, right_rows = svd(triangle, lapack_driver="gesvd")
    all_values = np.zeros(len(right_rows))
    all_values[: singular_values.size] = singular_values
    order = np.argsort(all_values, kind="stable")
    return all_values[order], right_rows.T[:, order]


def find_allowed_fall(operator: WaveOperator) -> float:
    """Return s^2, (rad/s)^2, the size of squared frequencies below zero that count as zero: a
    network with a square below -s^2 is unstable.

    A square that is zero may come out below zero by rounding, or because static forces on balls do
    not balance: no program brings forces to rest to all digits, and balls that carry no load have
    been left out. A ball with an imbalance F falls where springs do not resist, as exp(s t). About
    the line through two contacts, at a distance h from its centre, s^2 = F h/(2 (m h^2 + I)) for
    neighbours that stay, and F/(m r) is above this for any h. An imbalance T of torques has the
    bound s^2 = T/I.
    """
    network = operator.network
    rounding = (ZERO * operator.top) ** 2
    if not network.prestress:
        return rounding
    balls = operator.balls
    forces, torques = network.unbalanced
    force = np.linalg.norm(forces[balls], axis=1)
    torque = np.linalg.norm(torques[balls], axis=1)
    force_squares = force / (network.masses[balls] * network.radii[balls])
    torque_squares = torque / network.inertias[balls]
    largest_square = float(np.max(force_squares + torque_squares))
    # a faster fall is no imbalance that a program leaves, but an instability
    limit = (_LARGEST_FALL * operator.top) ** 2
    return rounding + min(largest_square, limit)


def find_roots(operator: WaveOperator, squares: Array) -> Array:
    """Return angular frequencies (m,), rad/s, from their ``squares`` (m,), (rad/s)^2, one or more,
    ascending; squares below zero count as zero.

    Raises :class:`~granphon.base.errors.InstabilityError` if a square is below zero by more than
    :func:`find_allowed_fall`. With forces that have no potential, such as static tangential ones,
    no square raises the error: D lacks their antisymmetric part (:attr:`WaveOperator.whole`), and
    so may have squares below zero though the network is stable.
    """
    if operator.whole is None and squares[0] < -find_allowed_fall(operator):
        raise explain_instability(operator.network)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def require_motions(count: int, available: int) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a request of more modes, ``count``, than
    the number ``available`` of motions that some spring or static force acts on.
    """
    request = counted(count, "mode is", "modes are")
    if not available:
        raise InputError(
            f"{request} asked for, and no motion of the network deforms a contact",
            "Each ball is held, or touches nothing but its own images, which move with it",
            "Repeat the network, or give it balls that move",
        )
    if count > available:
        fault = f"{request} asked for, and forces act on {counted(available, 'motion')} alone"
        raise InputError(fault, mend="Ask for fewer")


def explain_too_few(available: int, count: int) -> InputError:
    """Return the error for a request of ``count`` modes where only ``available`` modes, a smaller
    number, cost energy.
    """
    request = counted(count, "mode is", "modes are")
    among = f"only {available}" if available else "none"
    return InputError(f"{request} asked for, and {among} cost energy", mend="Ask for fewer")


@dataclass(frozen=True)
class _Window:
    """The window |phi - ``centre``| < ``half_width`` of modes, and the number ``n_filters`` of its
    filters.

    The centre is 0 or pi for a window at an end of the spectrum: the highest or the lowest modes.
    """

    centre: float
    half_width: float
    n_filters: int

    @property
    def is_at_end(self) -> bool:
        """Whether the window is at an end of the spectrum."""
        return self.centre in (0.0, math.pi)

    @property
    def order(self) -> int:
        """M, the highest order of the polynomials of the filters, and so the number of products of
        D with each vector. A window of the half width H has 2 M H/pi filters, or half as many at an
        end of the spectrum.
        """
        order = math.ceil(math.pi * self.n_filters / (2.0 * self.half_width))
        return 2 * order if self.is_at_end else order

    @cached_property
    def coefficients(self) -> Array:
        """(filters, M + 1) coefficients of each filter: the filter is the sum over n = 0 to M of
        its coefficients times cos(n phi). Filters of which most lies within the window come first.

        Slepian's sequences s_n, n = -M to M, are even or odd in turn. A filter is the sum over n of
        s_n exp(i n (phi - centre)), together with its image at -phi. So its coefficients of
        cos(n phi) are 2 s_n cos(n centre) if the sequence is even, and 2 s_n sin(n centre) if it is
        odd; the coefficient of order zero is not doubled.
        """
        from scipy.signal.windows import dpss

        # at an end of the spectrum a filter is its own image: only even sequences make filters
        stride = 2 if self.is_at_end else 1
        count = stride * self.n_filters
        # Slepian's product of bandwidth and length is half the number of sequences
        all_orders = dpss(2 * self.order + 1, count / 2, count)  # (count, 2 M + 1)
        sequences = all_orders[::stride, self.order :]
        angles = np.arange(self.order + 1) * self.centre
        is_even = np.arange(0, count, stride) % 2 == 0
        sequences *= np.where(is_even[:, None], np.cos(angles), np.sin(angles))
        sequences[:, 1:] *= 2.0
        return np.asarray(sequences)

    def weights(self, phi: Array) -> Array:
        """Return the weights (filters, n) of filters at the angles ``phi`` (n,): row k is the sum
        of the squares of the first k + 1 filters.
        """
        amplitudes = np.empty((self.n_filters, phi.size))
        orders = np.arange(self.order + 1)
        for column, angle in enumerate(phi.tolist()):
            amplitudes[:, column] = self.coefficients @ np.cos(angle * orders)
        return np.asarray(np.cumsum(amplitudes**2, axis=0))

    def find_ends(self, share: float) -> tuple[float, float]:
        """Return the lower and the upper end in phi of the middle part of the window, a ``share``
        of its width, within 0 and pi.
        """
        low = max(self.centre - share * self.half_width, 0.0)
        high = min(self.centre + share * self.half_width, math.pi)
        return low, high

    def apply(self, operator: WaveOperator, starts: Array) -> Array:
        """Return the vectors (size, filters x m) that all filters make of the vectors ``starts``
        (size, m).

        :data:`_KEPT_POLYNOMIALS` polynomials at a time are kept, and then multiplied by their
        coefficients in all filters, in blocks of rows that fit into a cache of the processor. The
        progress of the ``operator`` is told of each product.
        """
        size, m = starts.shape
        filtered_vectors = np.zeros((size, self.n_filters, m))
        recursion = polynomials(operator, starts)  # yields T_n x, of one order n after the other
        kept_polynomials = np.empty((_KEPT_POLYNOMIALS, size, m))
        with operator.progress.step("modes of a window", self.order + 1) as step:
            for first_order in range(0, self.order + 1, _KEPT_POLYNOMIALS):
                end_order = first_order + _KEPT_POLYNOMIALS
                coefficients = self.coefficients[:, first_order:end_order]
                count = coefficients.shape[1]  # fewer polynomials at the end
                for offset in range(count):
                    kept_polynomials[offset] = next(recursion)
                for row in range(0, size, _ROWS):
                    block = slice(row, row + _ROWS)
                    polynomials_of_block = kept_polynomials[:count, block].reshape(count, -1)
                    sums = coefficients @ polynomials_of_block  # (filters, rows x m)
                    filtered_vectors[block] += sums.reshape(self.n_filters, -1, m).swapaxes(0, 1)
                step.advance(count)
        return filtered_vectors.reshape(size, -1)


class _Density:
    """The density of modes in phi, by the kernel polynomial method, for the live motions of a
    ``problem``; it estimates how many modes a window has.

    The constructor computes :data:`_MOMENTS` moments of :data:`_VECTORS` vectors, drawn from
    ``random``.
    """

    def __init__(self, problem: Problem, random: np.random.Generator) -> None:
        operator = problem.operator
        # the mean over vectors of random signs is an estimate of the trace
        signs = np.zeros((_VECTORS, operator.size))
        signs[:, problem.live] = random.choice([-1.0, 1.0], (_VECTORS, problem.live.size))
        starts = [vector.copy for vector in signs]  # functions: each call makes the vector anew
        n_products = _VECTORS * _MOMENTS // 2
        with operator.progress.step("density of states", n_products) as step:
            moments = Moments(operator, starts).first(_MOMENTS, step)
        self._moments = Kernel(operator.top, _MOMENTS).weights * np.mean(moments, axis=0)

    @property
    def zero_count(self) -> float:
        """Estimated number of modes that cost no energy, or next to none: those at phi = pi, within
        the width of a line.
        """
        # the window about pi counts each mode twice, with its image
        return 0.5 * self.count_within(math.pi, _LINE_HALF_WIDTH * math.pi / _MOMENTS)

    def without_zeros(self) -> _Density:
        """Return a copy of the density from which the line of :attr:`zero_count` modes at phi = pi
        is subtracted.
        """
        density = copy(self)
        moments_at_pi = (-1.0) ** np.arange(_MOMENTS)  # cos(n pi)
        weights = Kernel(1.0, _MOMENTS).weights
        density._moments = self._moments - self.zero_count * moments_at_pi * weights
        return density

    def count_within(self, centre: float, half_width: float) -> float:
        """Return the estimated number of modes at |phi - ``centre``| < ``half_width``; a mode at
        phi counts again at its images -phi and 2 pi - phi if the window reaches there.
        """
        # the integral over the window of (mu_0 + 2 sum_n mu_n cos(n phi))/pi
        n = np.arange(1, _MOMENTS)
        cosine_integrals = 2.0 * np.sin(n * half_width) * np.cos(n * centre) / n
        integral = 2.0 * half_width * self._moments[0]
        integral = integral + 2.0 * self._moments[1:] @ cosine_integrals
        return float(integral) / math.pi

    def find_half_width(self, centre: float, count: float) -> float:
        """Return the half width of the window about ``centre`` in which :meth:`count_within` finds
        ``count`` modes; pi if there are no more in all.
        """
        from scipy.optimize import brentq

        if self.count_within(centre, math.pi) <= count:
            return math.pi

        def count_excess(half_width: float) -> float:
            """Return the number of modes in the window of this half width less the ``count``."""
            return self.count_within(centre, half_width) - count

        return float(brentq(count_excess, 0.0, math.pi, xtol=1e-9))

    def choose_window(
        self, target: float, n_requested: int, n_starts: int, least_half_width: float
    ) -> tuple[_Window, int]:
        """Return the window for the ``n_requested`` modes nearest to phi = ``target``, and the
        number of random vectors that its filters are applied to.

        The window without its ends holds :data:`_HELD_PER_REQUESTED` times the requested modes, and
        has at least ``least_half_width``. For each number of filters of :data:`_FILTER_COUNTS`
        there is one such window, with about ``n_starts`` random vectors for the fewest filters and
        fewer for more. The window that takes the fewest filtered vectors is returned.
        """
        n_held = _HELD_PER_REQUESTED * n_requested
        least_middle = max(self.find_half_width(target, n_held), least_half_width)
        candidates = []
        for n_filters in _FILTER_COUNTS:
            # more filters take fewer random vectors for as many filtered vectors
            n_vectors = max(_START_COUNTS[-1], n_starts * _FILTER_COUNTS[0] // n_filters)
            n_spanned = n_vectors * n_filters / _VECTORS_PER_MODE  # modes that vectors can span
            least_with_ends = least_middle / (1.0 - _EDGE_SHARE / n_filters)
            window, n_modes = self._place_window(
                target, n_filters, n_held, n_spanned, least_with_ends
            )
            n_vectors = max(n_vectors, math.ceil(_VECTORS_PER_MODE * n_modes / n_filters))
            candidates.append((n_filters * n_vectors, window, n_vectors))
        _, window, n_vectors = min(candidates, key=lambda candidate: candidate[0])
        return window, n_vectors

    def _place_window(
        self, target: float, n_filters: int, n_held: int, n_spanned: float, least_half_width: float
    ) -> tuple[_Window, float]:
        """Return the window with ``n_filters`` filters, and the estimated number of modes in it.

        The window is centred on phi = ``target`` and holds ``n_spanned`` modes, or more if its half
        width would be below ``least_half_width``. A window that would reach beyond an end of the
        spectrum is centred on this end. It then holds all modes from the end to the target, and
        beyond the target the larger number of ``n_spanned`` and ``n_held``.
        """
        centre = target
        half_width = max(self.find_half_width(target, n_spanned), least_half_width)
        n_modes = self.count_within(centre, half_width)
        for end in (math.pi, 0.0):
            distance = abs(end - target)
            if distance < half_width:
                # about an end of the spectrum each mode counts twice, with its image
                n_to_target = 0.5 * self.count_within(end, distance)
                n_modes = n_to_target + max(n_held, n_spanned)
                centre = end
                half_width = max(
                    self.find_half_width(end, 2.0 * n_modes), distance + least_half_width
                )
                n_modes = 0.5 * self.count_within(end, half_width)
        return _Window(centre, min(half_width, math.pi), n_filters), n_modes


class _FoundModes(NamedTuple):
    """Modes that are found: their angular frequencies ``omega`` (m,), rad/s, ascending, their
    ``vectors`` (size, m), of norm one, and the norms ``residuals`` (m,) of D x - omega^2 x of each
    vector x, over top^2.
    """

    omega: Array
    vectors: Array
    residuals: Array


def find_filtered(problem: Problem, count: int, target: float) -> Eigenpairs | None:
    """Return the ``count`` modes nearest to ``target``, rad/s, by filters of one window after the
    other, each wider than the last; None if this takes more vectors than there are modes.

    Raises :class:`~granphon.base.errors.InputError` if the first window already takes too much
    memory or too many products with D, before any filter is applied;
    :class:`~granphon.base.errors.ConvergenceError` if a later step takes too much; and what
    :func:`find_roots` raises.
    """
    search = _FilterSearch(problem, count, target)
    while True:
        window, n_starts = search.choose_window()
        modes_of_window = search.filter(window, n_starts)
        if modes_of_window is None:
            return None
        modes, is_complete = modes_of_window
        if is_complete:
            return search.finish(modes)
        search.least_half_width = _WIDENING * window.half_width


class _FilterSearch:
    """The search for the ``count`` modes nearest to ``target``, rad/s, by filters.

    Attributes
    ----------
    random : the generator of all random vectors; its seed is fixed, so that results repeat.
    density : estimate of the number of modes in a window.
    power : the mean square of a mode's share in a random vector is in proportion to
        (omega/top)^power. Above zero, random vectors have no share of the modes that cost no
        energy.
    least_half_width : least half width in phi of the next window, without its ends.
    """

    def __init__(self, problem: Problem, count: int, target: float) -> None:
        self.problem = problem
        self.count = count
        self.target = target
        self.random = np.random.default_rng(0)
        self.density = _Density(problem, self.random)
        self.power = 0
        self.least_half_width = 0.0
        # what a search that takes too much raises: an InputError before the first filter is
        # applied, and a ConvergenceError afterwards
        self._error: type[InputError | ConvergenceError] = InputError
        # each random vector finds one of the modes without energy: if these are many, random
        # vectors are made without any share of them
        if self._is_lowest and self.density.zero_count > _MOST_ZEROS:
            self.density = self.density.without_zeros()
            # random vectors are D x with static forces, else A^T y: see _draw_vectors
            self.power = 4 if problem.operator.network.prestress else 2

    @property
    def _is_lowest(self) -> bool:
        """Whether the lowest modes are requested."""
        return self.target <= ZERO * self.problem.top

    def choose_window(self) -> tuple[_Window, int]:
        """Return the next window, and the number of random vectors to begin with.

        The numbers of :data:`_START_COUNTS` are tried in turn until the filtered vectors fit into
        memory; the last one is taken even if they do not.
        """
        size = self.problem.operator.size
        phi = _find_phi(self.problem.top, self.target)
        for most_starts in _START_COUNTS:
            window, n_starts = self.density.choose_window(
                phi, self.count, most_starts, self.least_half_width
            )
            if _count_bytes(window, size, n_starts) <= _MOST_BYTES:
                break
        return window, n_starts

    def filter(self, window: _Window, n_starts: int) -> tuple[_FoundModes, bool] | None:
        """Return the modes that are found in a ``window``, and whether the requested modes are
        among them; None if this takes more vectors than there are modes.

        The search begins with ``n_starts`` random vectors. Then it filters fresh random vectors,
        which show whether a mode is missing in the range of the requested modes, or in the middle
        part of the window if the requested modes reach beyond it. If so, the fresh vectors are
        added to the basis in which modes are sought, until no mode is missing there. Raises what
        :func:`find_filtered` raises.
        """
        problem = self.problem
        basis = np.zeros((problem.operator.size, 0))
        modes = None
        n_drawn = n_starts
        while True:
            n_vectors = window.n_filters * (n_starts + _count_fresh(n_starts))
            if n_vectors > problem.live.size:
                return None
            _require_affordable(problem, window, n_starts, self.count, self._error)
            self._error = ConvergenceError
            random_vectors = _draw_vectors(problem, self.random, n_drawn, self.power)
            filtered_vectors = window.apply(problem.operator, random_vectors)
            if modes is not None:  # the filtered vectors are fresh ones
                ends = self._find_ends(window, modes)
                searched_ends = window.find_ends(_CORE_SHARE) if ends is None else ends
                n_missing = _estimate_missing(
                    window, filtered_vectors, modes.vectors, searched_ends, self.power
                )
                if n_missing < _LEAST_RESIDUAL:
                    return modes, ends is not None
                n_starts += n_drawn
            basis = _extend_basis(basis, filtered_vectors)
            modes = _find_ritz_modes(problem, window, basis)
            n_drawn = _count_fresh(n_starts)

    def _find_ends(self, window: _Window, modes: _FoundModes) -> tuple[float, float] | None:
        """Return the lower and the upper end in phi between which the requested modes lie among the
        ``modes`` of a ``window``.

        Returns None if not all of the requested modes are found, or if they reach beyond the window
        without its ends, in which no mode is missed.
        """
        top = self.problem.top
        chosen_modes = self.problem.choose_nearest(modes.omega, self.count, self.target)
        if chosen_modes.size < self.count:
            return None
        reach = np.max(np.abs(modes.omega[chosen_modes] - self.target), initial=0.0)
        # random vectors without a share of zero modes have hardly any share of the softest modes,
        # so that a missing one would not show there
        least_omega = _SOFTEST_SHARE * reach if self.power else 0.0
        # phi falls as the frequency rises
        low = _find_phi(top, self.target + reach)
        high = _find_phi(top, max(self.target - reach, least_omega))
        least, greatest = window.find_ends(1.0 - _EDGE_SHARE / window.n_filters)
        return (low, high) if least <= low and high <= greatest else None

    def finish(self, modes: _FoundModes) -> Eigenpairs:
        """Return the requested modes among the ``modes`` of a window, refined; zero modes are
        counted if the window holds them all.
        """
        problem = self.problem
        chosen_modes = problem.choose_nearest(modes.omega, self.count, self.target)
        omega, vectors, residuals = problem.refine(modes.vectors[problem.live][:, chosen_modes])
        n_zeros = None
        if self._is_lowest and not self.power:  # the window holds all zero modes
            n_zeros = problem.n_loose + int(np.sum(modes.omega <= ZERO * problem.top))
        return Eigenpairs(omega, vectors, float(residuals.max()), n_zeros)


def _find_phi(top: float, omega: float) -> float:
    """Return phi, from 0 to pi, of an angular frequency ``omega``, rad/s: omega = top cos(phi/2).

    Frequencies below zero or above ``top`` count as zero or as ``top``.
    """
    return 2.0 * math.acos(min(max(omega / top, 0.0), 1.0))


class ModesWork(NamedTuple):
    """What a search for modes takes.

    Attributes
    ----------
    is_dense : whether all modes are found by a dense matrix; the other numbers then say nothing.
    factors : number of factorisations of D; 0 if the search takes products.
    products : time of the products of D with vectors, and of what is done with each, over the time
        of one product.
    block_size : number of vectors that share each product.
    memory : of the vectors, bytes.
    """

    is_dense: bool = False
    factors: float = 0.0
    products: float = 0.0
    block_size: int = 1
    memory: float = 0.0


def estimate_modes(operator: WaveOperator, count: int, nearest: float | None) -> ModesWork:
    """Return the work of a search for ``count`` modes, the lowest or those nearest to the frequency
    ``nearest``, Hz, by the method with which :func:`find_modes` begins: a block that meets too many
    zero modes goes on with filters, which are not counted.

    Where modes are filtered, this function computes the density of states, which is a small part of
    the search. Raises :class:`~granphon.base.errors.InputError` for modes that take too much;
    :class:`~granphon.base.errors.InstabilityError` if that density meets a squared frequency below
    zero; and what :func:`read_request` raises.
    """
    count, target = read_request(operator, count, nearest)
    problem = Problem.of(operator)
    if _is_dense(problem, count):
        _require_dense(problem, count)
        return ModesWork(is_dense=True)
    if problem.has_factors:
        return ModesWork(factors=_FACTORS_OF_MODES)
    if target <= ZERO * problem.top:
        block_size = size_block(count + _count_rigid(operator))
        products, memory = estimate_lowest(operator, block_size)
        return ModesWork(products=products, block_size=block_size, memory=memory)
    search = _FilterSearch(problem, count, target)
    window, n_starts = search.choose_window()
    _require_affordable(problem, window, n_starts, count, InputError)
    n_vectors = n_starts + _count_fresh(n_starts)
    return ModesWork(
        products=float(_PRODUCT_WITH_SUMS * window.order * n_vectors),
        block_size=n_starts,
        memory=_count_bytes(window, operator.size, n_starts),
    )


def _is_dense(problem: Problem, count: int) -> bool:
    """Return whether all modes are found by a dense matrix: the live motions of the ``problem`` are
    few, or the ``count`` requested modes are many of them.
    """
    size = problem.live.size
    return size <= MOST_DENSE_MOTIONS or count * _ALL_OVER_FOUND > size


def _count_fresh(n_starts: int) -> int:
    """Return the number of fresh random vectors after ``n_starts`` random vectors."""
    return max(_LEAST_FRESH_VECTORS, n_starts // _GROWTH)


def _count_bytes(window: _Window, size: int, n_starts: int) -> int:
    """Return the memory, bytes, of all filtered vectors (size,) that a ``window`` makes of
    ``n_starts`` random vectors and of the fresh vectors after these.
    """
    bytes_per_number = 8
    n_vectors = window.n_filters * (n_starts + _count_fresh(n_starts))
    return bytes_per_number * _VECTOR_COPIES * size * n_vectors


def _require_affordable(
    problem: Problem,
    window: _Window,
    n_starts: int,
    count: int,
    error: type[InputError | ConvergenceError],
) -> None:
    """Raise an error of the class ``error`` if the filters of a ``window`` take too much memory or
    too many products, with ``n_starts`` random vectors and the fresh vectors after these. The
    message says that ``count`` modes were requested.
    """
    products = window.order * (n_starts + _count_fresh(n_starts))
    memory = _count_bytes(window, problem.operator.size, n_starts)
    if memory <= _MOST_BYTES and products <= _MOST_PRODUCTS:
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

    No direction is left out, however small: some filters lie mostly outside of the window, and add
    small directions without which the modes of the window would have errors of 1e-8.
    """
    from scipy.linalg import qr

    m = basis.shape[1]
    # in the order of columns, so that LAPACK can overwrite the array
    joint_vectors = np.empty((len(basis), m + vectors.shape[1]), order="F")
    joint_vectors[:, :m] = basis
    joint_vectors[:, m:] = vectors
    joint_basis, _ = qr(joint_vectors, overwrite_a=True, mode="economic", check_finite=False)
    return np.asarray(joint_basis)


def _draw_vectors(problem: Problem, random: np.random.Generator, count: int, power: int) -> Array:
    """Return ``count`` random vectors, (size, count), in which the squared share of a mode has the
    mean (omega / top)^``power``.

    With normal random numbers x or y the vectors are x, A^T y / top or D x / top^2, for the powers
    0, 2 and 4; A^T y and D x have no share of the modes that cost no energy.
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
    """Return the modes of the ``window`` in the space of an orthonormal ``basis`` (size, n): those
    Ritz vectors of D with frequencies in the window whose residuals are at most :data:`RESIDUAL`.

    Raises what :func:`find_roots` raises.
    """
    matrix = problem.operator.matrix
    columns = range(0, basis.shape[1], _COLUMNS)
    # a block of columns at a time saves memory
    projection = np.hstack(
        [basis.T @ (matrix @ basis[:, column : column + _COLUMNS]) for column in columns]
    )
    squares, coefficients = np.linalg.eigh(0.5 * (projection + projection.T))
    omega = find_roots(problem.operator, squares)
    low, high = window.find_ends(1.0)  # in phi: the frequency falls from low to high
    highest = problem.top * math.cos(low / 2.0)
    # modes that cost no energy are at zero, where the cosine is above zero by rounding: a margin
    # keeps these modes in the window
    lowest = problem.top * (math.cos(high / 2.0) - ZERO)
    is_inside = (omega <= highest) & (omega >= lowest)
    return _keep_converged(problem, basis, coefficients[:, is_inside], omega[is_inside])


def _keep_converged(
    problem: Problem, basis: Array, coefficients: Array, omega: Array
) -> _FoundModes:
    """Return those Ritz vectors whose residuals are at most :data:`RESIDUAL`, with their
    frequencies and residuals.

    Ritz vectors are given by their ``coefficients`` (n, m) in the ``basis`` (size, n) and their
    frequencies ``omega`` (m,), rad/s. Blocks of vectors are made and checked one after the other,
    which saves memory.
    """
    matrix = problem.operator.matrix
    vectors = [basis[:, :0]]  # if no mode is found, the vectors are (size, 0)
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
    window: _Window,
    fresh_vectors: Array,
    known_modes: Array,
    ends: tuple[float, float],
    power: int,
) -> float:
    """Return an estimate of the number of modes between the ``ends``, two angles phi, that are not
    among ``known_modes`` (size, m); the estimate is too low only by chance.

    ``fresh_vectors`` (size, filters x n) are what the filters of the ``window`` make of n random
    vectors that were not used to find the known modes. On average a mode adds to the squares of
    each vector the sum of the squares of the filters at its phi, times (omega / top)^``power``. The
    known modes are taken out of the vectors; the squares that remain, over the least that a mode
    between the ends adds, are the estimate. Modes outside of the ends add to the estimate.
    """
    phi = np.linspace(*ends, _PHI_POINTS)
    omega_over_top = np.cos(0.5 * phi)
    # (filters,) the least that a mode between the ends adds, by the first filter, by two, ...
    least_weights = np.min(window.weights(phi) * omega_over_top**power, axis=1)
    # the fewest filters with enough weight are taken: the last filters lie mostly outside of the
    # window, and would add modes outside of the ends
    is_enough = least_weights >= _WEIGHT_SHARE * least_weights[-1]
    n_used = int(np.argmax(is_enough)) + 1
    size = len(fresh_vectors)
    by_filter = fresh_vectors.reshape(size, window.n_filters, -1)[:, :n_used]
    n_vectors = by_filter.shape[2]
    vectors = by_filter.reshape(size, -1)
    residuals = vectors - known_modes @ (known_modes.T @ vectors)
    return float(np.sum(residuals**2) / (n_vectors * least_weights[n_used - 1]))


@result_class
class NetworkModes(Result):
    """Modes of a network that cost energy.

    Attributes
    ----------
    frequencies : (m,) Hz, ascending.
    vectors : (m, n_balls, motions) the modes, real, of norm one, in mass-weighted motions: M^1/2 u
        of the displacement u of a ball, and I^1/2 phi of its rotation phi, with its mass M and its
        moment of inertia I. Balls that do not move have zeros. The number that is largest in size
        is above zero. Modes that share one frequency are some basis of their space.
    displacements : number of the motions of a ball that are displacements; they come first, and
        the others are rotations.
    moving : number of the balls that move.
    zero_modes : number of modes that cost no energy: motions of the whole network, of balls that
        nothing holds, and of mechanisms. Their frequencies are at or below 1e-6 of the top
        frequency, an upper bound of all frequencies. They are not among the modes. None if they
        were not counted. They are always counted in networks that can be factorised; in larger
        ones, if the lowest modes are requested and balls that touch others have about 48 zero modes
        or fewer.
    residual : largest norm of D x - omega^2 x of a mode x over the square of the top angular
        frequency, with the dynamical matrix D, (rad/s)^2, and the mode's angular frequency omega.
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
        """Derivatives of the frequencies (m,) with respect to the stiffnesses and static normal
        forces of all contacts, to the masses and moments of inertia of all balls, and to springs
        that tie balls to the ground, also where there is none.

        Modes whose frequencies agree to 1e-8 all get the derivative of their mean frequency. A mode
        of that frequency that is not among these modes does not count: request a few modes more if
        the last ones may share their frequency with others.
        """
        network = self.network
        groups = number_equal(self.frequencies)  # modes of one frequency have one number
        moving_balls = np.flatnonzero(network.moving)
        square_motions = self.vectors[:, moving_balls] ** 2

        def average(values: Array) -> Array:
            """Return values (m, ...) of modes, each replaced by the mean over the modes of the same
            frequency.
            """
            return np.moveaxis(average_equal(np.moveaxis(values, 0, -1), groups, groups), -1, 0)

        square_deformations = {
            kind: average(squares.T) for kind, squares in self._square_deformations().items()
        }
        is_shared = np.bincount(groups)[groups] > 1
        energies = ModeEnergies(
            2.0 * math.pi * self.frequencies,
            is_shared,
            square_deformations,
            average(square_motions),
        )
        si_units = Units(1.0, 1.0, 1.0)
        place = Place(network, si_units, moving_balls, np.arange(network.n_contacts))
        return find_frequency_sensitivities(energies, place, self.warnings)

    @cached_property
    def contact_shares(self) -> Array:
        """(m, n_c) share of each contact in the elastic energy of a mode.

        The share is 2 d ln f / d ln k, where f is the frequency, and all stiffnesses of the contact
        change by the same factor as k. The shares of a mode add up to one less the share of springs
        to the ground and, with ``prestress``, less that of static forces. Where contacts are
        pressed, the energy of static forces is below zero, so that the shares may add up to more
        than one. As in :attr:`sensitivities`, modes whose frequencies agree to 1e-8 all get the
        mean of their shares.
        """
        network = self.network
        derivatives = self.sensitivities
        # df/d ln k, Hz, summed over the stiffnesses k of a contact
        slopes = derivatives.normal_stiffness * network.normal_stiffness
        for derivative, stiffness in (
            (derivatives.shear_stiffness, network.shear_stiffness),
            (derivatives.torsion, network.torsion_stiffness),
            (derivatives.bending, network.bending_stiffness),
        ):
            if derivative is not None:
                slopes = slopes + derivative * stiffness
        return read_only(2.0 * slopes / self.frequencies[:, None])

    def _square_deformations(self) -> dict[str, Array]:
        """Return for each kind of stiffness, by its name in
        :class:`~granphon.dynamics.sensitivities.FrequencySensitivities`, the sums (n_c, m) of the
        squared deformations of contacts that this stiffness resists, in each mode.
        """
        network = self.network
        scale = np.where(network.moving, 1.0 / np.sqrt(network.masses), 0.0)
        motions = scale[:, None] * self.vectors  # (m, n, motions)
        rows = network_unit_rows(network)
        squares = np.empty((len(rows), network.n_contacts, len(motions)))
        for row, squares_of_row in zip(rows, squares, strict=True):
            # sums over the motions a of each ball, of contact c in mode m
            by_ball_j = np.einsum("ca,mca->cm", row.head, motions[:, network.j])
            by_ball_i = np.einsum("ca,mca->cm", row.tail, motions[:, network.i])
            squares_of_row[:] = (by_ball_j - by_ball_i) ** 2
        return sum_kinds(rows, squares.reshape(-1, len(motions)))

    @property
    def _energies(self) -> Array:
        """(m, n_balls, 2) shares of each ball in the kinetic energy of a mode: that of its
        displacement, and that of its rotation.
        """
        energies = self.vectors**2  # of each motion: vectors are weighted with masses
        translation = energies[..., : self.displacements].sum(axis=2)
        rotation = energies[..., self.displacements :].sum(axis=2)
        return np.stack([translation, rotation], axis=-1)

    @property
    def participation_ratio(self) -> Array:
        """(m,) (sum e)^2 / (N sum e^2) of each mode, where e are the kinetic energies of the N
        balls that can move: 1/N if a single ball moves in the mode, and 1 if all balls have the
        same energy.
        """
        energies = self._energies.sum(axis=2)
        squares = np.sum(energies**2, axis=1)
        return np.asarray(energies.sum(axis=1) ** 2 / (self.moving * squares))

    @property
    def rotational_fraction(self) -> Array:
        """(m,) share of rotations in the kinetic energy of each mode."""
        return np.asarray(self._energies[..., 1].sum(axis=1))


def find_modes(operator: WaveOperator, count: int, nearest: float | None) -> NetworkModes:
    """Return ``count`` modes of a network, the lowest or those nearest to the frequency
    ``nearest``, Hz; see :meth:`granphon.waves.waves.Waves.modes`, which says what is raised.

    The caller has made sure by :func:`require_stable` that the network is stable.
    """
    count, target = read_request(operator, count, nearest)
    problem = Problem.of(operator)
    if _is_dense(problem, count):
        pairs = _find_dense(problem, count, target)
    elif problem.has_factors:
        pairs = _find_factored(problem, count, target)
    else:
        pairs = _find_large(problem, count, target)
    # the sign of a mode is free: the number that is largest in size is above zero
    largest_motion = np.argmax(np.abs(pairs.vectors), axis=0)
    signs = np.sign(pairs.vectors[largest_motion, np.arange(count)])
    return NetworkModes(
        frequencies=pairs.omega / (2.0 * math.pi),
        vectors=_list_by_balls(operator, signs * pairs.vectors),
        displacements=len(operator.motions.translations),
        moving=operator.balls.size,
        zero_modes=pairs.n_zeros,
        residual=pairs.residual,
        network=operator.network,
    )


def _list_by_balls(operator: WaveOperator, vectors: NDArray[Any]) -> NDArray[Any]:
    """Return the modes (m, n_balls, motions) that are ``vectors`` (size, m) of the ``operator``;
    zero for balls that do not move.
    """
    shape = (vectors.shape[1], operator.network.n_balls, operator.motions.count)
    modes = np.zeros(shape, vectors.dtype)
    modes[:, operator.balls] = np.moveaxis(operator.values(vectors), -1, 0)
    return modes


def read_request(operator: WaveOperator, count: int, nearest: float | None) -> tuple[int, float]:
    """Return the number of modes, and the angular frequency, rad/s, of a request for ``count``
    modes, the lowest or those nearest to the frequency ``nearest``, Hz.

    Raises :class:`~granphon.base.errors.InputError` for a ``count`` that is no whole number, 1 or
    more; for more modes than there are motions that some spring or static force acts on, or than
    memory holds; and for a frequency that is no finite number, zero or above, or is above the bound
    of all frequencies of the ``operator``.
    """
    count = whole_number("count", count, 1, MOST_MODES)
    hertz = 0.0 if nearest is None else not_negative("nearest", nearest, "Hz")
    target = 2.0 * math.pi * hertz
    if target > operator.top:
        top = operator.top / (2.0 * math.pi)
        raise InputError(
            f"the network has no modes near {hertz:g} Hz",
            f"All frequencies are below {top:.6g} Hz",
        )
    require_motions(count, Problem.of(operator).live.size)
    memory = 8.0 * _MODE_COPIES * operator.size * count  # 8 bytes for each number
    require_memory(f"{count:,} modes of {operator.size:,} motions", memory, "Ask for fewer")
    return count, target


def find_damped(
    operator: WaveOperator, count: int, nearest: float | None, losses: Losses
) -> DampedModes:
    """Return ``count`` damped modes of a network that is stable, the lowest or those nearest to the
    frequency ``nearest``, Hz; see :meth:`granphon.waves.waves.Waves.damped_modes`, which says what
    is raised.

    If the ``losses`` are even (:meth:`Losses.find_even`), modes without losses are found and then
    damped. Else the damped modes are found by a matrix of first order.
    """
    even_losses = losses.find_even()
    if even_losses is not None:
        modes = find_modes(operator, count, nearest)
        omega = damp_evenly(2.0 * math.pi * modes.frequencies, *even_losses)
        # by real parts: strong losses turn the highest modes into creep, of real part zero
        order = np.argsort(omega)
        vectors = modes.vectors[order].astype(complex)
        highest_frequency = float(modes.frequencies[-1])
        return DampedModes(
            frequencies=omega[order] / (2.0 * math.pi),
            vectors=vectors,
            warnings=losses.find_warnings(highest_frequency),
        )
    count, target = read_request(operator, count, nearest)
    omega, shapes = _find_unevenly_damped(operator, losses, count, target)
    # warnings need the highest frequency without losses: Rayleigh's quotient of each shape
    forces = np.asarray(operator.matrix @ shapes)
    squares = np.sum(shapes.conj() * forces, axis=0).real
    highest_frequency = math.sqrt(max(float(np.max(squares)), 0.0)) / (2.0 * math.pi)
    return DampedModes(
        frequencies=omega / (2.0 * math.pi),
        vectors=_list_by_balls(operator, shapes),
        warnings=losses.find_warnings(highest_frequency),
    )


def _find_unevenly_damped(
    operator: WaveOperator, losses: Losses, count: int, target: float
) -> tuple[Complex, Complex]:
    """Return the complex angular frequencies (count,), rad/s, and the shapes (size, count) of the
    damped modes nearest to ``target``, rad/s, in a network whose motions are damped unevenly.

    In small networks all modes are found, and the nearest are those whose real parts are nearest.
    In larger networks the modes nearest in the complex plane are found. Raises
    :class:`~granphon.base.errors.InputError` for a network too large to be factorised, for more
    modes than cost energy, and for more modes than can be found in a large network;
    :class:`~granphon.base.errors.PrecisionError` for dashpots that differ and are far stiffer than
    springs; and :class:`~granphon.base.errors.ConvergenceError` if the iteration does not end.
    """
    problem = Problem.of(operator)
    top = operator.top
    live = problem.live
    if not problem.has_factors:
        mend = (
            "Damp all contacts alike, if neither static forces nor springs to the ground act, or"
            " take a smaller network"
        )
        raise InputError(f"{live.size:,} motions that are damped unevenly are too many", mend=mend)
    # in units of the top frequency: x'' + viscous x' + stiffness x = 0
    complex_matrix = (operator.matrix + 1j * operator.weigh(losses.factors)) / top**2
    stiffness = complex_matrix.tocsr()[live][:, live]
    viscous = (operator.resist(losses) / top).tocsr()[live][:, live]
    # drag that differs between displacements and rotations couples zero modes to the others
    drags = losses.drag_of(operator.motions)
    is_coupled = bool(np.ptp(drags) > 0.0)
    # the matrix of first order has twice the size of D; its eigenvalues are rates, two of each mode
    n_rates = 2 * live.size
    is_small = n_rates <= MOST_DENSE_MOTIONS
    takes_most_rates = _ALL_OVER_FOUND * (2 * count + _EXTRA_VECTORS) > n_rates
    is_dense = is_small or (takes_most_rates and live.size <= MOST_DENSE_MOTIONS)
    find_damped_modes = _find_damped_dense if is_dense else _find_damped_near
    omega_over_top, vectors = find_damped_modes(
        problem, stiffness, viscous, count, target / top, is_coupled
    )
    shapes = np.zeros((operator.size, count), complex)
    shapes[live] = vectors
    return omega_over_top * top, shapes


def _find_damped_dense(
    problem: Problem, stiffness: Any, viscous: Any, count: int, target: float, is_coupled: bool
) -> tuple[Complex, Complex]:
    """Return the ``count`` damped modes whose real parts are nearest to ``target``, by a search for
    all modes: the complex frequencies (count,) and the vectors (live, count).

    All frequencies are in units of the top frequency. ``stiffness`` and ``viscous`` (live, live)
    are the matrices of x and of x' in x'' + viscous x' + stiffness x = 0; ``is_coupled`` says
    whether the viscous matrix couples motions that cost no energy to the others. Raises
    :class:`~granphon.base.errors.InputError` if fewer modes cost energy, and what
    :func:`_diagonalise`, :func:`find_roots` and :func:`damp_unevenly` raise.
    """
    squares, shapes = _diagonalise(problem, count)
    costs_energy = find_roots(problem.operator, squares) > ZERO * problem.top
    n_elastic = int(np.count_nonzero(costs_energy))
    if n_elastic < count:
        raise explain_too_few(n_elastic, count)
    # zero modes that are not coupled stay at rest
    basis = shapes if is_coupled else shapes[:, costs_energy]
    reduced_stiffness = basis.T @ np.asarray(stiffness @ basis)
    reduced_viscous = basis.T @ np.asarray(viscous @ basis)
    omega, vectors = damp_unevenly(reduced_stiffness, reduced_viscous)
    if is_coupled:
        omega, vectors = _drop_zeros(omega, vectors)
    chosen_modes = _choose_damped(omega, count, target)
    return omega[chosen_modes], basis @ vectors[:, chosen_modes]


def _drop_zeros(omega: Complex, vectors: Complex) -> tuple[Complex, Complex]:
    """Return the frequencies ``omega`` (m,), over top, and the ``vectors`` (n, m) of modes, without
    those of frequency zero, which cost no energy.
    """
    costs_energy = np.abs(omega) > ZERO
    return omega[costs_energy], vectors[:, costs_energy]


def _find_damped_near(
    problem: Problem, stiffness: Any, viscous: Any, count: int, target: float, is_coupled: bool
) -> tuple[Complex, Complex]:
    """Return the ``count`` damped modes whose complex frequencies are nearest to ``target``, by
    Arnoldi's method with factors; arguments and results are those of :func:`_find_damped_dense`.

    Raises :class:`~granphon.base.errors.InputError` if fewer modes cost energy, or if so many are
    requested that Arnoldi's method would have to find more rates, of which each mode has two, than
    modes cost energy; :class:`~granphon.base.errors.ConvergenceError` if the iteration does not
    end; and what :func:`_find_zero_motions` raises.
    """
    zero_motions = _find_zero_motions(problem, count)
    n_elastic = problem.live.size - zero_motions.shape[1]
    if n_elastic < count:
        raise explain_too_few(n_elastic, count)
    n_rates = 2 * count + _EXTRA_VECTORS  # each mode has two rates, though both need not be near
    if is_coupled:
        n_rates += zero_motions.shape[1]  # rates of zero, which are left out later
        zero_motions = zero_motions[:, :0]
    while n_rates <= n_elastic:
        omega, vectors = _find_rates_near(stiffness, viscous, zero_motions, n_rates, target)
        if is_coupled:
            omega, vectors = _drop_zeros(omega, vectors)
        chosen_modes = _choose_damped(omega, count, target)
        if chosen_modes.size == count:
            return omega[chosen_modes], vectors[:, chosen_modes]
        # of some modes both rates were found, which make one mode: more rates are needed
        n_rates *= 2
    fault = (
        f"{count} modes of {problem.live.size} motions that are damped unevenly are too many to be"
        f" found"
    )
    raise InputError(fault, mend="Ask for fewer")


def _choose_damped(omega: Complex, count: int, target: float) -> NDArray[np.intp]:
    """Return the indices (count,) of the modes whose frequencies ``omega`` (m,), complex, have real
    parts nearest to ``target``, in ascending order of the real part, then of the imaginary part;
    all m if these are fewer.
    """
    nearest = np.lexsort((omega.imag, np.abs(omega.real - target)))[:count]
    return nearest[np.lexsort((omega[nearest].imag, omega[nearest].real))]


def _find_zero_motions(problem: Problem, count: int) -> Array:
    """Return orthonormal motions (live, n_zero) that span all motions without energy: by factors,
    or by a dense matrix if factors do not find them all.

    ``count``, the number of modes that are requested, is for the message of the error that
    :func:`_diagonalise` raises for a matrix that is too large. Raises this error, what
    :func:`find_roots` and :meth:`Problem.factorise_shifted` raise, and
    :class:`~granphon.base.errors.ConvergenceError` if the iteration does not end.
    """
    n_zeros = problem.count_below((ZERO * problem.top) ** 2)
    if not n_zeros:
        return np.zeros((problem.live.size, 0))
    shift = -_SHIFT * problem.top**2
    n_searched = n_zeros + _EXTRA_VECTORS
    solve = problem.factorise_shifted(shift).solve
    while n_searched * _ALL_OVER_FOUND <= problem.live.size:
        _, vectors = find_nearest(problem.shifted(0.0), n_searched, shift, solve)
        omega, modes, _ = problem.refine(vectors)
        is_zero = omega <= ZERO * problem.top
        if np.count_nonzero(is_zero) == n_zeros:
            return modes[problem.live][:, is_zero]
        n_searched *= 2
    squares, vectors = _diagonalise(problem, count)
    is_zero = find_roots(problem.operator, squares) <= ZERO * problem.top
    return np.asarray(vectors[:, is_zero])


@single_products()
def _find_rates_near(
    stiffness: Any, viscous: Any, zero_motions: Array, n_rates: int, target: float
) -> tuple[Complex, Complex]:
    """Return the modes of x'' + G x' + D x = 0 that belong to the ``n_rates`` rates r = i omega
    nearest to a shift beside i ``target``: the complex frequencies omega (m,) and the vectors
    (n, m), of norm one.

    D is the ``stiffness`` and G the ``viscous`` matrix (n, n), in units of the top frequency, as
    are frequencies. Rates are eigenvalues of the matrix of first order ((0, 1), (-D, -G)), which
    acts on z = (x, y) with y = x'; this matrix less a shift s is solved by the factors of
    D + s G + s^2.

    The orthonormal ``zero_motions`` (n, n_zero) cost no energy, and G takes each of them to gamma
    times itself, gamma being the drag: their rates are zero and -gamma, zero twice without drag.
    These rates are not sought, and Arnoldi's vectors are kept free of the motions. Where drag
    couples such motions to others, none are given, and their rates of zero are among the results.
    One of the two rates of each mode is kept, by :func:`_drop_second_rates`, so that m is at most
    ``n_rates``.
    """
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import LinearOperator, eigs

    n = stiffness.shape[0]
    shift = math.sqrt(_SHIFT) + 1j * target  # damped rates lie to its left
    unit: Any = eye_array(n)
    matrix = (stiffness + shift * viscous + shift**2 * unit).astype(complex)
    factors = factorise(matrix)

    def remove_zeros(z: Any) -> Any:
        """Return z (2 n,) without the motions that cost no energy."""
        # real columns (n, 4), as a product of zero_motions with complex numbers would copy them
        columns = np.stack([z[:n].real, z[:n].imag, z[n:].real, z[n:].imag], axis=1)
        columns -= zero_motions @ (zero_motions.T @ columns)
        x = columns[:, 0] + 1j * columns[:, 1]
        y = columns[:, 2] + 1j * columns[:, 3]
        return np.concatenate([x, y])

    def apply(z: Any) -> Any:
        """Return the matrix of first order times z (2 n,)."""
        return np.concatenate([z[n:], -(stiffness @ z[:n]) - viscous @ z[n:]])

    def solve(z: Any) -> Any:
        """Return the inverse of the matrix of first order less the shift, times z (2 n,)."""
        x = -factors.solve(z[n:] + viscous @ z[:n] + shift * z[:n])
        return remove_zeros(np.concatenate([x, z[:n] + shift * x]))

    first_order = LinearOperator((2 * n, 2 * n), matvec=apply, dtype=complex)
    inverse = LinearOperator((2 * n, 2 * n), matvec=solve, dtype=complex)
    start = remove_zeros(np.random.default_rng(0).normal(size=2 * n).astype(complex))
    with lanczos_converges():
        rates, vectors = eigs(first_order, k=n_rates, sigma=shift, OPinv=inverse, v0=start)
    shapes = vectors[:n] / np.linalg.norm(vectors[:n], axis=0)
    return _drop_second_rates(-1j * rates, shapes, viscous)


def _drop_second_rates(omega: Complex, shapes: Complex, viscous: Any) -> tuple[Complex, Complex]:
    """Return the frequencies ``omega`` (m,), complex, and the ``shapes`` (n, m), of norm one, with
    one of the two rates r = i omega of each mode of x'' + G x' + D x = 0, in units of the top
    frequency; G is the ``viscous`` matrix (n, n).

    A mode that swings has a pair of mirrored frequencies, and the one with the real part above zero
    is kept. The rates of a motion that creeps are the roots of r^2 + (x.Gx) r + x.Dx, and the
    slower one, nearer to zero than the mean of the two, is kept, with a real part of exactly zero.
    """
    creeps = np.abs(omega.real) <= ZERO
    omega = np.where(creeps, 1j * omega.imag, omega)
    sums_of_rates = np.sum(shapes.conj() * (viscous @ shapes), axis=0).real  # x.Gx
    is_slower = 2.0 * omega.imag < sums_of_rates
    is_kept = np.where(creeps, is_slower, omega.real > 0.0)  # one of each pair of rates
    return omega[is_kept], shapes[:, is_kept]


# -- modes of forces without a potential -----------------------------------------------------------


def find_whole_modes(operator: WaveOperator, count: int, nearest: float | None) -> DampedModes:
    """Return ``count`` modes of :attr:`WaveOperator.whole`, or of D where that is None, of a
    network that is stable: the lowest, or those nearest to the frequency ``nearest``, Hz; see
    :meth:`granphon.waves.waves.Waves.whole_modes`, which says what is raised.

    All modes of a small matrix are found by a dense solver. Larger matrices are factorised, and
    Arnoldi's method finds the eigenvalues nearest to the squared frequency, more and more of them
    until enough cost energy.
    """
    count, target = read_request(operator, count, nearest)
    live = Problem.of(operator).live
    whole = operator.matrix if operator.whole is None else operator.whole
    matrix = (whole / operator.top**2).tocsr()[live][:, live]
    squares, columns = _diagonalise_whole(operator, matrix, count, target / operator.top)
    shapes = np.zeros((operator.size, count), complex)
    shapes[live] = columns
    omega: Complex = np.asarray(operator.top * np.sqrt(squares), complex)
    return DampedModes(
        frequencies=omega / (2.0 * math.pi),
        vectors=_list_by_balls(operator, shapes),
        warnings=network_warnings(operator.network),
    )


def _diagonalise_whole(
    operator: WaveOperator, matrix: Any, count: int, target: float
) -> tuple[Complex, Complex]:
    """Return the squares (count,) of the complex frequencies nearest to ``target`` among those of
    modes that cost energy, ascending, and the vectors (live, count) of these modes, of norm one.

    ``matrix`` (live, live) is the whole matrix over the square of the top frequency, as are the
    squares; ``target`` is over the top frequency. Raises
    :class:`~granphon.base.errors.InputError` if fewer modes cost energy, if so many are requested
    that Arnoldi's method would have to find more than a third of all, and for a large matrix beyond
    the limit of unsymmetric factors; and
    :class:`~granphon.base.errors.ConvergenceError` if the iteration does not end.
    """
    size = matrix.shape[0]
    if size <= MOST_DENSE_MOTIONS:
        squares, vectors = np.linalg.eig(matrix.toarray())
        chosen_modes = _choose_whole(operator, squares, count, target)
        if chosen_modes.size < count:
            raise explain_too_few(chosen_modes.size, count)
        return squares[chosen_modes].astype(complex), vectors[:, chosen_modes].astype(complex)
    if size > LARGEST_UNSYMMETRIC[operator.network.dimension]:
        raise InputError(
            f"{size:,} motions are too many for modes with all forces",
            "The whole matrix may not be symmetric, and takes larger factors",
            "Ask for modes() of its symmetric part, or take fewer balls",
        )
    shift = -_SHIFT if target <= ZERO else target**2
    n_searched = count + _EXTRA_VECTORS
    while n_searched * _ALL_OVER_FOUND <= size:
        squares, vectors = _find_nearest_whole(matrix, n_searched, shift)
        chosen_modes = _choose_whole(operator, squares, count, target)
        if chosen_modes.size == count:
            return squares[chosen_modes], vectors[:, chosen_modes]
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
    """Return the indices of the ``count`` eigenvalues ``squares`` (m,), over top^2, whose
    frequencies have real parts nearest to ``target``, over the top frequency, in the order of
    :class:`DampedModes`; fewer if no more of them cost energy.
    """
    # squares up to the allowed fall are rounding, or due to forces on balls that do not balance
    largest_zero = find_allowed_fall(operator) / operator.top**2
    costs_energy = np.flatnonzero(np.abs(squares) > largest_zero)
    omega = np.sqrt(squares[costs_energy].astype(complex))
    return costs_energy[_choose_damped(omega, count, target)]


def require_stable(operator: WaveOperator) -> None:
    """Raise :class:`~granphon.base.errors.InstabilityError` unless the network of the ``operator``
    is stable by :func:`is_stable`, and what that function raises.
    """
    if not is_stable(operator):
        raise explain_instability(operator.network)


def is_stable(operator: WaveOperator, fall: float | None = None) -> bool:
    """Return whether no squared frequency is below zero by more than ``fall``, (rad/s)^2, by
    default :func:`find_allowed_fall`.

    Only static forces can make a square lie below zero. If D has such a square, and some forces
    have no potential, as static tangential ones, the lowest eigenvalue of
    :attr:`WaveOperator.whole`, which is not symmetric, decides by its real part. This is never
    below the lowest eigenvalue of D.

    For networks too large to be factorised the lowest Ritz value of a Krylov space of D decides.
    With forces that have no potential this value may be below zero by :data:`_RITZ_ERROR` times
    top^2, whatever ``fall`` is.

    Raises :class:`~granphon.base.errors.ConvergenceError` if the matrix cannot be factorised, or
    the lowest eigenvalue of the whole matrix is not found.
    """
    if not operator.network.prestress:
        return True
    whole = operator.whole
    least_square = -(find_allowed_fall(operator) if fall is None else fall)
    if not _has_factors(operator):
        least_ritz_value = least_square if whole is None else -_RITZ_ERROR * operator.top**2
        return _search_lowest(operator) >= least_ritz_value
    problem = Problem(operator, np.arange(operator.size))  # all motions, as static forces move them
    if not problem.count_below(least_square):
        return True
    if whole is None:
        return False
    lowest, _ = _find_lowest_of_whole(operator, whole, least_square)
    return lowest >= least_square


def find_falling_motions(operator: WaveOperator, fall: float) -> Array:
    """Return the motions (size, m) by which a network falls that is not stable by
    :func:`is_stable`: all modes whose squared frequency is below -``fall``, (rad/s)^2.

    ``fall`` is above zero. If the network has :attr:`WaveOperator.whole`, only the lowest mode of
    this matrix is returned, as the sizes of its complex numbers. Raises
    :class:`~granphon.base.errors.InstabilityError` for a network too large to be factorised, and
    :class:`~granphon.base.errors.ConvergenceError` if the motions are not found.
    """
    if not _has_factors(operator):
        raise explain_instability(operator.network)
    whole = operator.whole
    if whole is not None:
        _, sizes = _find_lowest_of_whole(operator, whole, -fall)
        return sizes[:, None]
    network = operator.network
    problem = Problem(operator, np.arange(operator.size))
    # no square is lower than twice that of a single ball which static forces alone move: f/r of a
    # contact that is pressed pushes both of its balls
    normal_force, _ = network.static_forces
    static_stiffness = np.maximum(normal_force, 0.0) / network.distance
    as_ball_i = np.bincount(network.i, static_stiffness, network.n_balls)
    as_ball_j = np.bincount(network.j, static_stiffness, network.n_balls)
    shift = -2.0 * float(np.max((as_ball_i + as_ball_j) / network.masses))
    count = problem.count_below(-fall)
    solve = problem.factorise_shifted(shift).solve
    _, vectors = find_nearest(problem.shifted(0.0), count, shift, solve)
    return np.asarray(vectors)


def _has_factors(operator: WaveOperator) -> bool:
    """Return whether the matrix of all motions of the network is small enough to be factorised."""
    return operator.size <= LARGEST_FACTORS[operator.network.dimension]


def _find_lowest_of_whole(
    operator: WaveOperator, whole_matrix: Any, low: float
) -> tuple[float, Array]:
    """Return the real part, (rad/s)^2, of the lowest eigenvalue of ``whole_matrix`` (size, size),
    which is :attr:`WaveOperator.whole`, and the sizes (size,) of the numbers of its eigenvector.

    D is the symmetric part of the whole matrix, so that no eigenvalue of the whole has a real part
    below the lowest eigenvalue of D. The shift begins at ``low``, (rad/s)^2, below zero, and is
    lowered until it is below all eigenvalues of D. The eigenvalue of the whole nearest to the shift
    is then taken as the lowest: a complex pair farther away, of a lower real part, would be passed
    over.
    """
    from scipy.sparse.linalg import eigs

    # the whole matrix has all motions, also those that no spring holds
    problem = Problem(operator, np.arange(operator.size))
    shift = low
    while problem.count_below(shift):
        shift *= _LOWERING
    start = np.random.default_rng(0).normal(size=operator.size)
    with lanczos_converges():
        eigenvalues, vectors = eigs(whole_matrix.tocsc(), k=1, sigma=shift, v0=start, tol=1e-8)
    return float(eigenvalues[0].real), np.abs(vectors[:, 0])


def _search_lowest(operator: WaveOperator) -> float:
    """Return the lowest Ritz value, (rad/s)^2, of D in the Krylov space of a random vector, by
    :data:`_KRYLOV_PRODUCTS` steps of Lanczos's recursion. It is not below the lowest eigenvalue but
    for rounding.
    """
    from scipy.linalg import eigvalsh_tridiagonal

    x = np.random.default_rng(0).normal(size=operator.size)
    x /= np.linalg.norm(x)
    previous = np.zeros(operator.size)
    coupling = 0.0
    diagonal = []
    couplings = []
    for _ in range(_KRYLOV_PRODUCTS):
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
    """Return all eigenvalues (live,), (rad/s)^2, ascending, and the eigenvectors (live, live) of D
    on the live motions, by a dense matrix.

    Raises :class:`~granphon.base.errors.InputError` for a matrix that is too large; the message
    says that ``count`` modes were requested.
    """
    from scipy.linalg import eigh

    _require_dense(problem, count)
    squares, vectors = eigh(problem.shifted(0.0).toarray())
    return squares, vectors


def _require_dense(problem: Problem, count: int) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the motions of the ``problem`` are too
    many for a dense matrix; the message says that ``count`` modes were requested.
    """
    if problem.live.size <= _LARGEST_DENSE:
        return
    fault = (
        f"{count} modes of {problem.live.size} motions, with those without energy, are too"
        f" many to be found"
    )
    raise InputError(fault, mend="Ask for fewer")


def _find_dense(problem: Problem, count: int, target: float) -> Eigenpairs:
    """Return the ``count`` modes nearest to ``target``, rad/s, by a dense matrix, which finds all.

    Raises :class:`~granphon.base.errors.InputError` if fewer modes cost energy, and for a matrix
    that is too large.
    """
    squares, vectors = _diagonalise(problem, count)
    omega = find_roots(problem.operator, squares)
    chosen_modes = problem.choose_nearest(omega, count, target)
    if chosen_modes.size < count:
        raise explain_too_few(chosen_modes.size, count)
    n_zeros = int(np.sum(omega <= ZERO * problem.top))
    refined_omega, modes, residuals = problem.refine(vectors[:, chosen_modes])
    return Eigenpairs(refined_omega, modes, float(residuals.max()), problem.n_loose + n_zeros)


def _find_factored(problem: Problem, count: int, target: float) -> Eigenpairs:
    """Return the ``count`` modes nearest to ``target``, rad/s, by Lanczos's method with factors at
    a shift next to the target.

    The number of modes that are sought is doubled until all residuals are small and
    :func:`_prove_complete` finds no mode missing. If more than a third of all modes would be
    sought, :func:`_find_dense` finds all instead. In packings most zero modes are of single balls,
    which turn about the line through their two contacts. These modes are known, and Lanczos's
    vectors are kept free of them. Raises what :func:`_find_dense` and
    :meth:`Problem.factorise_shifted` raise.
    """
    size = problem.live.size
    top = problem.top
    shift = -_SHIFT * top**2 if target <= ZERO * top else target**2
    factors = problem.factorise_shifted(shift)
    free_motions = problem.free_motions
    start = np.random.default_rng(0).normal(size=size)
    start -= free_motions @ (free_motions.T @ start)

    def solve(right: Array) -> Array:
        """Return the solution (live,) for the right side (live,), less the free motions of single
        balls that rounding has brought into it.
        """
        solution = factors.solve(right)
        return np.asarray(solution - free_motions @ (free_motions.T @ solution))

    n_searched = count + _EXTRA_VECTORS
    while n_searched * _ALL_OVER_FOUND <= size:
        _, vectors = find_nearest(problem.shifted(0.0), n_searched, shift, solve, start)
        omega, modes, residuals = problem.refine(vectors)
        chosen_modes = problem.choose_nearest(omega, count, target)
        n_searched *= 2
        if chosen_modes.size < count:
            n_zeros = problem.count_below((ZERO * top) ** 2)
            if count > size - n_zeros:
                raise explain_too_few(size - n_zeros, count)
            # zero modes are nearest to the shift: the next search has to find them all
            n_searched = max(n_searched, count + n_zeros - free_motions.shape[1] + _EXTRA_VECTORS)
        elif np.max(residuals[chosen_modes]) <= RESIDUAL:
            n_live_zeros = _prove_complete(problem, omega, chosen_modes, target)
            if n_live_zeros is not None:
                return Eigenpairs(
                    omega[chosen_modes],
                    modes[:, chosen_modes],
                    float(residuals[chosen_modes].max()),
                    problem.n_loose + n_live_zeros,
                )
    return _find_dense(problem, count, target)


def _find_large(problem: Problem, count: int, target: float) -> Eigenpairs:
    """Return the ``count`` modes nearest to ``target``, rad/s, of a network too large to be
    factorised.

    The lowest modes are found by a block of vectors, unless many modes cost no energy, and modes
    nearest to another frequency by filters. If filters would take more vectors than there are
    modes, a dense matrix finds all.
    """
    pairs = None
    if target <= ZERO * problem.top:
        pairs = _find_lowest_by_block(problem, count)
    if pairs is None:
        pairs = find_filtered(problem, count, target)
    if pairs is None:
        pairs = _find_dense(problem, count, target)
    return pairs


def _find_lowest_by_block(problem: Problem, count: int) -> Eigenpairs | None:
    """Return the ``count`` lowest modes by a block of vectors, which first finds the zero modes
    that are not known.

    The block is made larger until it holds these zero modes as well as the requested modes. Returns
    None if more than :data:`_MOST_ZEROS` of these zero modes are expected, or if the block would
    have more than a third as many vectors as there are motions. Raises
    :class:`~granphon.base.errors.ConvergenceError` if the block does not converge, and what
    :func:`find_roots` raises.
    """
    operator = problem.operator
    known_zeros = problem.collect_known_zeros()
    n_expected = _count_rigid(operator)
    while (
        n_expected <= _MOST_ZEROS
        and _ALL_OVER_FOUND * size_block(count + n_expected) <= operator.size
    ):
        lowest = find_lowest(operator, operator.matrix, count + n_expected, known_zeros)
        is_elastic = find_roots(operator, lowest.values) > ZERO * problem.top
        n_zeros = int(np.count_nonzero(~is_elastic))
        if n_zeros <= n_expected:
            vectors = lowest.vectors[problem.live][:, is_elastic][:, :count]
            omega, modes, residuals = problem.refine(vectors)
            return Eigenpairs(omega, modes, float(residuals.max()), known_zeros.shape[1] + n_zeros)
        n_expected = max(2 * n_expected, n_zeros)
    return None


def _count_rigid(operator: WaveOperator) -> int:
    """Return the number of zero modes that are expected of motions of the whole network as a rigid
    body: none if a ball is held or tied to the ground by a spring, the translations if the network
    repeats, else as many as a ball has motions.

    Where balls do not rotate, rigid rotations cost no energy either, and are not counted.
    """
    network = operator.network
    if not np.all(network.moving) or np.any(operator.anchors):
        return 0
    motions = operator.motions
    return len(motions.translations) if np.any(network.pbc) else motions.count


def _prove_complete(
    problem: Problem, omega: Array, chosen_modes: NDArray[np.intp], target: float
) -> int | None:
    """Return the number of zero modes of the live motions, if no mode is missing; None if one is.

    ``omega`` (m,), rad/s, are the frequencies of all modes that were found, and ``chosen_modes``
    the indices of the requested modes among these. No mode is missing if factors count as many
    modes as were found that are nearer to ``target``, rad/s, than the farthest chosen mode. Besides
    the found modes there are the free motions of single balls, from which the search was kept free.
    """
    zero = ZERO * problem.top
    n_free = problem.free_motions.shape[1]
    reach = np.max(np.abs(omega[chosen_modes] - target)) * (1.0 - _END_MARGIN)
    low = target - reach
    high = target + reach
    n_below_high = problem.count_below(high**2)
    if low <= zero:  # the interval holds all zero modes, so that they need no count of their own
        is_complete = n_below_high == n_free + np.count_nonzero(omega < high)
        return n_free + int(np.count_nonzero(omega <= zero)) if is_complete else None
    n_within = n_below_high - problem.count_below(low**2)
    is_complete = n_within == np.count_nonzero((omega > low) & (omega < high))
    return problem.count_below(zero**2) if is_complete else None


def require_countable(operator: WaveOperator) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the network of the ``operator`` is too
    large to be factorised, so that its modes cannot be counted.
    """
    problem = Problem.of(operator)
    if problem.has_factors:
        return
    limit = LARGEST_FACTORS[operator.network.dimension]
    raise InputError(
        f"modes of {problem.live.size:,} motions are too many to be counted",
        f"Matrices are factorised up to {limit:,}",
        "Integrate the density of states, waves.dos()",
    )


def count_modes(operator: WaveOperator, frequencies: Array) -> NDArray[np.intp]:
    """Return the numbers (n_f,) of modes below the ``frequencies`` (n_f,), Hz, in a network that is
    stable; see :meth:`granphon.waves.waves.Waves.count_modes`.

    Zero modes count, also those of motions that nothing acts on. Raises what
    :func:`require_countable` and :meth:`Problem.count_below` raise.
    """
    require_countable(operator)
    problem = Problem.of(operator)
    size = problem.live.size
    # modes up to this frequency cost no energy, and are below every frequency
    least_frequency = ZERO * problem.top / (2.0 * math.pi)
    top_frequency = problem.top / (2.0 * math.pi)
    counts = np.full(frequencies.size, size)  # all modes are below the top frequency
    with operator.progress.step("modes below frequencies", frequencies.size) as step:
        for row, frequency in enumerate(np.maximum(frequencies, least_frequency).tolist()):
            if frequency <= top_frequency:
                counts[row] = problem.count_below((2.0 * math.pi * frequency) ** 2)
            step.advance()
    return problem.n_loose + counts
