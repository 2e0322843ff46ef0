"""Spectral functions of finite networks: the frequencies of a plane wave in an array that is not
perfect, and its line.

A plane wave has a wave vector that the cell of the network has, and a polarisation; its vector is
one of the operator's.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.arrays import Array
from granphon.base.errors import InputError, PrecisionError, brief
from granphon.base.memory import require_memory
from granphon.base.results import held, result_class
from granphon.base.validation import finite_array, finite_list, one_of, positive
from granphon.dynamics.zone_means import shortest_vectors
from granphon.networks.network import ContactNetwork
from granphon.observables.validity import network_warnings
from granphon.waves.chebyshev import Kernel, Moments, Refinable, keeps_vectors
from granphon.waves.operator import WaveOperator
from granphon.waves.pulses import read_vector
from granphon.waves.settings import POLARISATIONS

#: largest deviation of q . L / 2 pi from a whole number that counts as rounding
_WHOLE = 1e-6
#: largest phase of a wave across a network, rad: of a larger one no digit within a turn is left
_MOST_PHASE = 1e15
#: length of the component of a direction across q, over that of the direction, below which the
#: component is zero
_ACROSS = 1e-9
#: greatest common denominator of the sites of a lattice, in fractions of its vectors, that is tried
_MOST_PARTS = 24
#: l of the full width l L + ((1 - l)^2 L^2 + G^2)^1/2 to which a kernel of the width G broadens a
#: Lorentz curve of the full width L. A Gaussian kernel has l = 0.5346, Voigt's curve (Olivero and
#: Longbothum, J. Quant. Spectrosc. Radiat. Transf. 17, 233 (1977)). The Jackson kernel is nearly a
#: Gaussian, and the formula holds to 3e-3 with this l
_LINEAR = 0.465
#: width of a line over that of the kernel, from which it counts as resolved
_RESOLVED = 0.2
#: memory of a spectrum for each moment, bytes
_MOMENT_BYTES = 40.0
#: greatest relative difference of the wave vectors of spectral functions that are averaged
_SAME = 1e-9
#: greatest relative difference of their resolutions
_ALIKE = 0.02


class PeriodicCell(NamedTuple):
    """The cell of a network, without its balls: vectors (3, 3), m, which of them are periods, and
    the dimension.
    """

    cell: Array
    pbc: tuple[bool, bool, bool]
    dimension: int


# -- wave vectors ----------------------------------------------------------------------------------


def read_wavevectors(network: ContactNetwork, q: ArrayLike) -> Array:
    """Return ``q`` as (n, d), 1/m; along axes with a period the wave vectors are those that the
    cell has, to rounding.

    Raises :class:`~granphon.base.errors.InputError` for another shape, and for a q that the cell
    does not have.
    """
    requested = _as_wavevectors(network, q)
    nearest = _find_nearest_of_cell(network, requested)
    periods = network.cell[list(network.pbc), : network.dimension]
    # phases (n, p) across the periods, rad
    deviation = np.abs((requested - nearest) @ periods.T)
    rounding = 2.0 * np.pi * _WHOLE * np.maximum(1.0, np.abs(nearest @ periods.T))
    is_wrong = deviation > rounding
    if np.any(is_wrong):
        row = int(np.argmax(np.any(is_wrong, axis=1)))
        fault = f"q = {_write_vector(requested[row])} is no wave vector of the periodic cell"
        mend = (
            f"The nearest is {_write_vector(nearest[row])} 1/m;"
            f" waves.nearest_wavevectors(q) finds it for any q"
        )
        if not np.any(nearest[row]):
            mend = (
                f"It is shorter than those of this cell, of which the shortest is"
                f" {_find_shortest(network):.6g} 1/m"
            )
        why = "Along each of its vectors L, q . L must be a multiple of 2 pi"
        raise InputError(fault, why, mend)
    return nearest


def _write_vector(vector: Array) -> str:
    """Return a vector (d,) in words."""
    return "(" + ", ".join(f"{component:.9g}" for component in vector) + ")"


def nearest_wavevectors(network: ContactNetwork | PeriodicCell, q: ArrayLike) -> Array:
    """Return the wave vectors nearest to ``q`` (d,) or (n, d), 1/m, that the periodic cell has, in
    the same shape.
    """
    requested = _as_wavevectors(network, q)
    nearest = _find_nearest_of_cell(network, requested)
    return np.asarray(nearest.reshape(np.shape(q)))


def fold_wavevectors(network: ContactNetwork, q: Array) -> Array | None:
    """Return for wave vectors ``q`` (n, d) of a lattice, 1/m, the shortest wave vectors (n, d),
    1/m, in whose waves all balls move as in those of q.

    The two differ by a reciprocal vector G with exp(i G . t) = 1 for the steps t between all balls
    of a cell. With one ball in a cell every G is such a vector, and the shortest wave vector lies
    in the first zone; along the axis of hcp every second G is one. None for a network of no
    lattice, and for a lattice whose sites are no multiples of a 24th, or of a larger part, of the
    lattice vectors.
    """
    if network.lattice is None or network.shape is None:
        return None
    periods = len(network.shape)
    # steps between the balls of a cell, in fractions of the lattice vectors
    sites = network.lattice.positions @ np.linalg.pinv(network.lattice.vectors)
    steps = sites - sites[0]
    denominator = _find_denominator(steps)
    if denominator is None:
        return None
    whole_steps = np.round(denominator * steps).astype(int)
    repeats = _find_repeats(whole_steps, denominator)
    lattice_vectors = network.cell[:periods, : q.shape[1]] / np.array(network.shape)[:, None]
    # the vectors whose reciprocal vectors are the repeats
    periods_of_waves = np.linalg.inv(repeats).T @ lattice_vectors
    return q - _find_nearest(periods_of_waves, q)


def _find_denominator(fractions: Array) -> int | None:
    """Return the least whole number that makes all ``fractions`` whole; None if it is too large."""
    for number in range(1, _MOST_PARTS + 1):
        multiples = number * fractions
        if np.all(np.abs(multiples - np.round(multiples)) <= _WHOLE):
            return number
    return None


def _find_repeats(steps: NDArray[np.intp], denominator: int) -> NDArray[np.intp]:
    """Return reciprocal vectors, as rows of whole numbers (p, p), that span all G with exp(i G . t)
    = 1 for the ``steps`` t (n, p) in fractions of 1/``denominator``.

    The denominator times any reciprocal vector is such a G, so that those of 0 to the denominator
    contain a triangular basis.
    """
    p = steps.shape[1]
    all_vectors = np.indices((denominator + 1,) * p).reshape(p, -1).T
    keeps_phases = np.all((all_vectors @ steps.T) % denominator == 0, axis=1)
    vectors = all_vectors[keeps_phases]
    repeats = np.zeros((p, p), np.intp)
    for axis in range(p):
        # zero along the axes before, and as short as can be along this one
        has_zeros_before = ~np.any(vectors[:, :axis], axis=1)
        candidates = vectors[has_zeros_before & (vectors[:, axis] > 0)]
        repeats[axis] = candidates[np.argmin(candidates[:, axis])]
    return repeats


def _as_wavevectors(network: ContactNetwork | PeriodicCell, q: ArrayLike) -> Array:
    """Return ``q`` (d,) or (n, d) as (n, d), 1/m.

    Raises :class:`~granphon.base.errors.InputError` for another shape, and
    :class:`~granphon.base.errors.PrecisionError` for phases that lose their digits.
    """
    vectors = finite_array("q", q, "1/m")
    d = network.dimension
    if d == 1 and vectors.ndim == 0:
        vectors = vectors.reshape(1)
    if vectors.ndim not in (1, 2) or vectors.shape[-1] != d:
        why = f"A wave vector of this network has the shape ({d},)"
        mend = f"Give ({d},) or (n, {d}), Cartesian, in 1/m"
        raise InputError(f"q has the shape {vectors.shape}", why, mend)
    extent = np.ptp(getattr(network, "positions", 0.0))
    size = float(np.max(np.abs(network.cell), initial=0.0) + extent)
    phase = float(np.max(np.abs(vectors), initial=0.0)) * size
    if phase > _MOST_PHASE:
        fault = f"the phase of such a wave differs by {phase:.1e} across the network"
        raise PrecisionError(
            fault, f"Beyond {_MOST_PHASE:.0e} its digits within a turn are lost", "Give a shorter q"
        )
    return np.atleast_2d(vectors)


def _find_shortest(network: ContactNetwork | PeriodicCell) -> float:
    """Return the length of the shortest of the reciprocal vectors of the periodic cell, 1/m."""
    periods = network.cell[list(network.pbc), : network.dimension]
    return float(2.0 * np.pi * np.min(np.linalg.norm(np.linalg.pinv(periods), axis=0)))


def _find_nearest_of_cell(network: ContactNetwork | PeriodicCell, q: Array) -> Array:
    """Return the wave vectors (n, d), 1/m, nearest to ``q`` (n, d) that the cell of a network has;
    across its periods they are ``q``.
    """
    periods = network.cell[list(network.pbc), : network.dimension]
    if not len(periods):
        return q
    nearest = _find_nearest(periods, q)
    if len(periods) < network.dimension:
        along_periods = q @ np.linalg.pinv(periods) @ periods
        nearest += q - along_periods
    return nearest


def _find_nearest(periods: Array, q: Array) -> Array:
    """Return the wave vectors (n, d) that are nearest to ``q`` among those that repeat with
    ``periods`` (p, d).
    """
    # (p, d) rows b with b_i . L_j = delta_ij
    reciprocal = np.asarray(np.linalg.pinv(periods).T, float)
    # whole numbers (p, p) that make the basis of the shortest vectors: only in this basis are the
    # lattice points nearest to a point among the corners of its cell and of the cells next to it
    to_shortest = np.rint(shortest_vectors(reciprocal) @ periods.T)
    coordinates = q @ periods.T @ np.linalg.inv(to_shortest) / (2.0 * np.pi)  # in that basis
    corners = np.array(list(itertools.product((-1.0, 0.0, 1.0, 2.0), repeat=len(periods))))
    candidates = np.floor(coordinates)[:, None] + corners  # (n, corners, p)
    vectors = (candidates - coordinates[:, None]) @ (to_shortest @ reciprocal)
    squares = np.sum(vectors**2, axis=-1)
    # the first of those that are equally near but for rounding: the same one at all loads
    nearest = np.argmin(np.round(squares / np.sum(reciprocal**2), 9), axis=1)
    # from whole numbers, not as a step from q: the same wave vector has the same digits, and Gamma
    # is zero, where the sum makes 0 of -0
    numbers = candidates[np.arange(len(q)), nearest] @ to_shortest
    return np.asarray(2.0 * np.pi * numbers @ reciprocal + 0.0)


# -- polarisations ---------------------------------------------------------------------------------


def find_polarisations(
    operator: WaveOperator, q: Array, polarisation: str | ArrayLike, direction: ArrayLike | None
) -> Array:
    """Return the polarisations of a wave with the wave vector ``q`` (d,), 1/m: orthonormal rows
    (b, motions), over which a spectral function is averaged.

    ``polarisation`` and ``direction`` are the arguments of ``Waves.spectral_function``. Raises
    :class:`~granphon.base.errors.InputError` if the balls do not move in that polarisation, or if a
    direction that the polarisation needs is missing.
    """
    motions = operator.motions
    letters = ", ".join(motions.letters)
    if not isinstance(polarisation, str):
        if direction is not None:
            finite_array("polarisation", polarisation)  # what is no numbers is refused as such
            raise InputError(
                "a direction is given besides the polarisation by numbers", "They say the same"
            )
        return _read_polarisation(operator, polarisation)
    name = one_of("polarisation", polarisation, POLARISATIONS)
    turns = name == "rotational"
    axes = motions.rotations if turns else motions.translations
    free = np.eye(3)[list(axes)]  # (a, 3) directions in which balls move
    directions = np.atleast_2d(_choose_directions(operator.network, q, name, free, direction))
    held_components = np.abs(np.delete(directions, axes, axis=1))
    may_move = len(directions) > 0 and len(axes) > 0
    if not may_move or np.max(held_components, initial=0.0) > _ACROSS:
        raise InputError(
            f"no {name} wave of this direction runs here", f"Balls move in {letters} alone"
        )
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    if np.any(lengths < _ACROSS):
        raise InputError(f"the direction of a {name} wave is across all motions {letters}")
    unit_vectors = directions / lengths  # (b, 3)
    columns = motions.turning if turns else motions.translating
    rows = np.zeros((len(directions), motions.count))
    rows[:, columns] = unit_vectors[:, list(axes)]
    return rows


def _choose_directions(
    network: ContactNetwork, q: Array, name: str, free: Array, direction: ArrayLike | None
) -> Array:
    """Return the directions (3,) or (b, 3) in which balls move, or about which they turn, in a wave
    of the polarisation ``name`` and a wave vector ``q`` (d,).

    ``free`` (a, 3) are those that balls can have; ``direction`` (d,) is the requested one, or None.
    Raises :class:`~granphon.base.errors.InputError` for q = 0 without a direction, and for a
    direction of a transverse wave along q.
    """
    requested = None
    if direction is not None:
        requested = read_vector("direction", direction, network.dimension)
    if name == "rotational":
        if requested is None:
            return free
        return np.asarray((requested @ free.T) @ free)  # the part along free axes
    if not np.any(q):
        if requested is None:
            raise _explain_still(network, name)
        return requested
    directions = _find_directions(network, q, name, free, requested)
    if requested is not None and np.linalg.norm(directions) < _ACROSS:
        raise InputError(f"the direction {brief(direction)} of a transverse wave is along q")
    return directions


def _find_directions(
    network: ContactNetwork, q: Array, name: str, free: Array, requested: Array | None
) -> Array:
    """Return the directions (3,) or (b, 3) in which balls move in a longitudinal or transverse wave
    of a wave vector ``q`` (d,).

    ``free`` (a, 3) are those in which balls can move, and ``requested`` (3,) is one of which a
    transverse wave has the part across q.
    """
    unit_q = np.zeros(3)
    unit_q[: q.size] = q
    unit_q /= np.linalg.norm(unit_q)
    if name == "longitudinal":
        return unit_q
    if requested is not None:
        return np.asarray(requested - (requested @ unit_q) * unit_q)
    # within the plane of the balls, if they move across q there
    in_plane = free[np.argmax(free, axis=1) < network.dimension]
    directions = _find_transverse(in_plane, unit_q)
    return directions if len(directions) else _find_transverse(free, unit_q)


def _explain_still(network: ContactNetwork, name: str) -> InputError:
    """Return the error of a wave with q = 0, of which no direction is given."""
    mend = "Give direction=, the one in which balls move"
    if any(network.pbc):
        shortest = _find_shortest(network)
        mend += f", or a longer q: the shortest that this cell has is {shortest:.6g} 1/m"
    return InputError(f"a {name} wave with q = 0 has no direction", mend=mend)


def _read_polarisation(operator: WaveOperator, polarisation: ArrayLike) -> Array:
    """Return the row (1, motions) of a polarisation by numbers: of all displacements, or of all
    motions.
    """
    motions = operator.motions
    letters = ", ".join(motions.letters)
    components = finite_array("polarisation", polarisation)
    sizes = (len(motions.translations), motions.count)
    has_size = components.ndim == 1 and components.size in sizes
    if not has_size or not np.any(components):
        why = f"By numbers it is {sizes[0]} displacements, or all {sizes[1]} motions {letters}"
        mend = f"Give these, not all zero, or one of {', '.join(POLARISATIONS)}"
        raise InputError(f"the polarisation is {brief(polarisation)}", why, mend)
    # over the largest first: squares of very large or small numbers have no digits
    scaled = components / np.max(np.abs(components))
    row = np.zeros((1, motions.count))
    row[0, : scaled.size] = scaled / np.linalg.norm(scaled)
    return row


def _find_transverse(free: Array, along: Array) -> Array:
    """Return orthonormal directions (b, 3) that are the parts of the directions ``free`` (a, 3),
    themselves orthonormal, across the unit vector ``along`` (3,).
    """
    if not len(free):
        return free
    across = free - (free @ along)[:, None] * along
    _, singular_values, basis = np.linalg.svd(across)
    # all values are 1 but the last, the length of the part of ``along`` that is not among the
    # directions: 0 or 1
    return np.asarray(basis[: singular_values.size][singular_values > 0.5])


# -- vectors ---------------------------------------------------------------------------------------


def make_plane_wave(operator: WaveOperator, q: Array, polarisation: Array, sine: bool) -> Array:
    """Return the vector (size,) of balls that all move with the velocity cos(q . r), or with
    ``sine`` sin(q . r), times ``polarisation`` (motions,); ``q`` (d,) is in 1/m.

    Vectors are weighted with masses: displacements, and rotations given with them, by the root of
    the mass, so that q = 0 is the motion of all balls together. In a wave of rotations alone balls
    turn at that rate, weighted by the root of the moment of inertia. Balls that touch none take no
    part, as no wave reaches them.
    """
    network = operator.network
    balls = operator.balls
    is_touching = np.zeros(network.n_balls, bool)
    is_touching[network.i] = True
    is_touching[network.j] = True
    has_translations = np.any(polarisation[operator.motions.translating])
    masses = network.masses if has_translations else network.inertias
    weights = np.sqrt(masses[balls])
    phases = network.positions[balls, : q.size] @ q
    amplitudes = np.sin(phases) if sine else np.cos(phases)
    wave = np.where(is_touching[balls], weights * amplitudes, 0.0)
    return np.asarray(operator.vector(wave[:, None] * polarisation))


def find_mean_free_path(velocity: Array, width: Array) -> Array:
    """Return the mean free path (n,) of the energy of waves, m: the phase ``velocity`` (n,), m/s,
    over 2 pi times the ``width`` (n,) of their lines, Hz; infinite where the width is zero.
    """
    paths = np.full(np.shape(width), math.inf)
    np.divide(velocity, 2.0 * math.pi * width, out=paths, where=width > 0.0)
    return paths


def find_attenuation(velocity: Array, width: Array) -> Array:
    """Return the attenuation (n,) of the amplitude of waves, 1/m: half the inverse mean free path,
    of their phase ``velocity`` (n,), m/s, and the ``width`` (n,) of their lines, Hz; infinite where
    the velocity is zero.
    """
    rates = np.full(np.shape(width), math.inf)
    np.divide(math.pi * width, velocity, out=rates, where=velocity > 0.0)
    return rates


def find_lines(kernel: Kernel, values: Array) -> tuple[Array, Array]:
    """Return the highest line of each of the spectra ``values`` (n, n_f), 1/Hz, at the points of
    ``kernel``: the peaks (n,), Hz, and the full widths (n,) at half the height, Hz.

    Between points, which are even in theta, the logarithm is a parabola at the peak and a straight
    line on the flanks: both are right for a Gaussian, as the kernel is one. The spectrum goes on
    evenly below zero. If a line falls to half its height on one side only, the width is twice the
    half width of this side.

    Raises :class:`~granphon.base.errors.InputError` if a line does so on neither side.
    """
    peaks = np.empty(len(values))
    widths = np.empty(len(values))
    for number, spectrum in enumerate(values):
        peaks[number], widths[number] = _find_line(kernel, spectrum)
    return peaks, widths


def _find_line(kernel: Kernel, spectrum: Array) -> tuple[float, float]:
    """Return the peak and the width of the highest line of a ``spectrum`` (n_f,), Hz; see
    :func:`find_lines`.
    """
    step = math.pi / (2 * kernel.count - 1)  # of the angle from point to point
    highest = int(np.argmax(spectrum))
    log = np.log(np.maximum(spectrum, np.finfo(float).tiny))
    peak_point, height = _fit_peak(log, highest)
    peak = kernel.top * math.sin(step * peak_point)
    half_height = height - math.log(2.0)
    half_widths = []
    for sign, flank in ((-1, log[highest::-1]), (1, log[highest:])):
        # the point at which the flank falls to half the height, if it does
        below = np.flatnonzero(flank < half_height)
        if below.size:
            k = int(below[0])
            share = (flank[k - 1] - half_height) / (flank[k - 1] - flank[k])
            crossing = highest + sign * float(k - 1 + share)
            half_widths.append(abs(kernel.top * math.sin(step * crossing) - peak))
    if not half_widths:
        fault = f"the highest line, at {peak:.6g} Hz, falls to half its height on neither side"
        why = f"So it has no width at a resolution of {kernel.resolution:.4g} Hz"
        raise InputError(fault, why, "Give a finer resolution, or more moments")
    has_two_flanks = len(half_widths) == 2
    width = sum(half_widths) if has_two_flanks else 2.0 * half_widths[0]
    return peak, width


def _fit_peak(log: Array, n: int) -> tuple[float, float]:
    """Return the place of the top, in points, and its height, a logarithm, of the parabola through
    the logarithms ``log`` (n_f,) at the highest point ``n`` and beside it.
    """
    height = float(log[n])
    if n == log.size - 1:
        return float(n), height
    previous = float(log[abs(n - 1)])  # the spectrum goes on evenly below zero
    following = float(log[n + 1])
    curvature = previous - 2.0 * height + following
    shift = 0.0 if curvature >= 0.0 else 0.5 * (previous - following) / curvature
    return float(n) + shift, height - 0.25 * (previous - following) * shift


def find_true_width(broadened: Array, kernel_width: Array) -> Array:
    """Return the widths L (n,) of Lorentz curves which a kernel has broadened, from ``broadened`` =
    l L + ((1 - l)^2 L^2 + G^2)^1/2, where l = :data:`_LINEAR` and G = ``kernel_width``, all in Hz.

    A curve that is not wider than the kernel has the width zero.
    """
    width = np.maximum(broadened, kernel_width)
    # the positive root of (1 - 2 l) L^2 + 2 l B L = B^2 - G^2, B the broadened width
    square = (1.0 - _LINEAR) ** 2
    leading = square - _LINEAR**2  # 1 - 2 l
    root = np.sqrt(square * width**2 - leading * kernel_width**2)
    return np.asarray(np.maximum((root - _LINEAR * width) / leading, 0.0))


def find_ioffe_regel(
    wavenumber: Array, peak: Array, width: Array, product: float = 1.0
) -> float | None:
    """Return the frequency, Hz, from which ``wavenumber`` (n,), 1/m, times the mean free path of
    lines at ``peak`` (n,) with ``width`` (n,), Hz, is below ``product``; None if never.

    See :meth:`granphon.waves.spectral_functions.SpectralFunction.ioffe_regel`. After a line without
    width, to which nothing can be interpolated, the frequency is that of the next peak.
    """
    log_product = math.log(positive("product", product))
    ascending = np.argsort(wavenumber, kind="stable")
    peaks = peak[ascending]
    widths = width[ascending]
    # wavenumber times mean free path is peak over width
    with np.errstate(divide="ignore"):  # a line without width is infinitely far above
        log_excess = np.log(peaks) - np.log(widths) - log_product
    if log_excess[0] < 0.0:
        fault = (
            f"the wave of the least q, at {peaks[0]:.4g} Hz, is already beyond the Ioffe-Regel"
            f" frequency"
        )
        raise InputError(fault, mend="Give lesser wave vectors, which a larger network has")
    below = np.flatnonzero(log_excess < 0.0)
    if not below.size:
        return None
    first = int(below[0])
    last_excess = log_excess[first - 1]  # of the wave before
    if math.isinf(last_excess):
        return float(peaks[first])
    share = last_excess / (last_excess - log_excess[first])
    return float(peaks[first - 1] + share * (peaks[first] - peaks[first - 1]))


@result_class
class SpectralFunction(Refinable):
    """A(q, f) of plane waves on a network: the spectrum of ``<s| delta(f - D^1/2 / 2 pi) |s>``, s
    the wave of norm one.

    It is exact for the network but for the kernel, which broadens each line. A plane wave that is
    no mode of the network scatters into other modes, and its line has a width.

    Attributes
    ----------
    q : (n, d) wave vectors, Cartesian, 1/m.
    polarisation : "longitudinal", "transverse", "rotational", or "given" by numbers.
    direction : the direction that was given, or the numbers of the polarisation; empty if none was
        given.
    frequencies : (n_f,) Hz, from zero; Chebyshev nodes, four within the standard deviation of the
        kernel.
    values : (n, n_f) 1/Hz; the integral over frequencies is 1.
    top : bound of all frequencies, Hz, on which the polynomials are made.
    moments : number of Chebyshev moments.
    shortest : (n, d) the shortest wave vectors, 1/m, for which all balls of the lattice move as for
        q. They differ from q by reciprocal vectors G with exp(i G . t) = 1 for the steps t between
        all balls of a cell. With one ball in a cell these are all G, and the shortest lie in the
        first zone. None where the network has no lattice, and where the sites of the lattice are no
        multiples of a 24th, or of a larger part, of its vectors.
    warnings : one sentence for each limit of the contact law that the network exceeds.
    """

    q: Array = held(float, "n d", "1/m")
    polarisation: str = held(str)
    direction: tuple[float, ...] = held((float, ...))
    frequencies: Array = held(float, "f", "Hz")
    values: Array = held(float, "n f", "1/Hz")
    top: float = held(float, unit="Hz")
    moments: int = held(int)
    shortest: Array | None = held(float, "n d?", "1/m", default=None)
    warnings: tuple[str, ...] = held((str, ...), default=())

    @property
    def integral(self) -> Array:
        """(n,) integrals over all frequencies: 1."""
        return self._kernel.integral(self.values)

    # -- lines -------------------------------------------------------------------------------------

    @cached_property
    def _lines(self) -> tuple[Array, Array]:
        """The peaks (n,) and the widths (n,) of the highest lines, with the kernel, Hz."""
        return find_lines(self._kernel, self.values)

    @cached_property
    def _kernel_width(self) -> Array:
        """(n,) the full width at half maximum that the kernel alone gives to a line at each peak,
        Hz.
        """
        return find_lines(self._kernel, self._kernel.line(self.peak))[1]

    @property
    def peak(self) -> Array:
        """(n,) frequency of the highest maximum, Hz: the dispersion of the coherent wave."""
        return self._lines[0]

    @cached_property
    def width(self) -> Array:
        """(n,) full width at half maximum of the highest line, Hz, without the width of the kernel.

        The kernel's part is taken off as from a Lorentz curve that the kernel has broadened; a line
        that is not wider than the kernel has the width zero. See :attr:`resolved`. If the line
        falls to half its height on one side only, the width is twice the half width of this side.

        Raises :class:`~granphon.base.errors.InputError`, as :attr:`peak` does, if it does so on
        neither side: the resolution is too coarse.
        """
        return find_true_width(self._lines[1], self._kernel_width)

    @property
    def resolved(self) -> NDArray[np.bool_]:
        """(n,) whether the width of each line is a fifth of the kernel's or more; a smaller width
        is not to be relied on.
        """
        return np.asarray(self.width >= _RESOLVED * self._kernel_width)

    @property
    def wavenumber(self) -> Array:
        """(n,) length of the wave vector, 1/m: of :attr:`shortest` where it exists, else of
        ``q``.
        """
        wavevectors = self.q if self.shortest is None else self.shortest
        return np.asarray(np.linalg.norm(wavevectors, axis=1))

    @property
    def phase_velocity(self) -> Array:
        """(n,) 2 pi peak over the :attr:`wavenumber`, m/s.

        Raises :class:`~granphon.base.errors.InputError` for q = 0, and for a q at which all balls
        move as at q = 0.
        """
        rounding = _SAME * np.linalg.norm(self.q, axis=1)
        if np.any(self.wavenumber <= rounding):
            why = (
                "Where exp(i q . r) is the same at all sites of a lattice, all balls move"
                " together, as at q = 0"
            )
            raise InputError("a wave with q = 0 has no velocity", why, "Give other wave vectors")
        return np.asarray(2.0 * math.pi * self.peak / self.wavenumber)

    @property
    def mean_free_path(self) -> Array:
        """(n,) mean free path of the energy of a wave, m: phase velocity over 2 pi width; infinite
        where the width is zero.

        The energy of a coherent wave falls as exp(-2 pi width t). Where bands bend, its group
        velocity is not the phase velocity, and the path is so much longer or shorter.
        """
        return find_mean_free_path(self.phase_velocity, self.width)

    @property
    def attenuation(self) -> Array:
        """(n,) attenuation of the amplitude, 1/m (neper per metre): half the inverse mean free
        path.
        """
        return find_attenuation(self.phase_velocity, self.width)

    def ioffe_regel(self, product: float = 1.0) -> float | None:
        """Return the frequency, Hz, from which wavenumber times mean free path is below
        ``product``; None if never.

        With 1 the mean free path is the wavelength over 2 pi, and the width the frequency; with pi
        it is half the wavelength. The frequency lies between two wave vectors, in the order of
        their lengths, of which the first has a larger product and the next a smaller one; the
        logarithm of peak/width is interpolated. Raises
        :class:`~granphon.base.errors.InputError` if already the shortest wave vector has a smaller
        product.
        """
        return find_ioffe_regel(self.wavenumber, self.peak, self.width, product)

    # -- more of it --------------------------------------------------------------------------------

    @classmethod
    def average(cls, found: Sequence[SpectralFunction]) -> SpectralFunction:
        """Return the mean over arrays of one shape, at the points of the array with the highest
        ``top``.

        The others are interpolated (cubic splines), to about 1e-3 of their peaks. The mean does not
        refine.

        Raises :class:`~granphon.base.errors.InputError` if wave vectors or polarisations differ, or
        resolutions by more than 2 %: give all of them the same ``resolution``.
        """
        if not found:
            raise InputError("there are no spectral functions to average", mend="Give one or more")
        highest = max(found, key=lambda spectrum: spectrum.top)
        for spectrum in found:
            spectrum._require_like(highest)
        interpolated = [spectrum._interpolate(highest.frequencies) for spectrum in found]
        values = np.mean(interpolated, axis=0)
        # interpolation changes the integral, which is 1, a little
        integrals = highest._kernel.integral(values)
        return replace(highest, values=values / integrals[:, None])

    def _require_like(self, reference: SpectralFunction) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless wave vectors, polarisation and
        resolution are those of the ``reference``.
        """
        has_same_q = self.q.shape == reference.q.shape
        if has_same_q:
            rounding = _SAME * np.max(np.abs(reference.q))
            has_same_q = np.allclose(self.q, reference.q, rtol=_SAME, atol=rounding)
        has_same_word = self.polarisation == reference.polarisation
        has_same_direction = self.direction == reference.direction
        if not (has_same_q and has_same_word and has_same_direction):
            raise InputError(
                "spectral functions of other wave vectors or polarisations have no mean"
            )
        difference = abs(self.resolution - reference.resolution)
        if difference > _ALIKE * reference.resolution:
            fault = (
                f"the spectral functions have resolutions of {self.resolution:.6g} and"
                f" {reference.resolution:.6g} Hz"
            )
            raise InputError(fault, mend="Give all of them the same resolution")

    def _interpolate(self, points: Array) -> Array:
        """Return the values (n, n_points), 1/Hz, at ``points`` (n_points,), Hz; zero beyond the
        frequencies of this spectrum.
        """
        from scipy.interpolate import CubicSpline

        if np.array_equal(points, self.frequencies):
            return self.values
        spline = CubicSpline(self.frequencies, self.values, axis=1)
        return np.where(points <= self.frequencies[-1], spline(points), 0.0)


class PlaneWaves:
    """Moments of plane waves: of the cosine and the sine of each polarisation, which add up.

    Parameters
    ----------
    operator : D of the network.
    q, polarisation, direction : as for :meth:`granphon.waves.waves.Waves.spectral_function`, which
        says what raises InputError.
    """

    def __init__(
        self,
        operator: WaveOperator,
        q: ArrayLike,
        polarisation: str | ArrayLike,
        direction: ArrayLike | None,
    ) -> None:
        wavevectors = read_wavevectors(operator.network, q)
        is_word = isinstance(polarisation, str)
        is_longitudinal = is_word and polarisation == "longitudinal"
        is_direction_known = is_longitudinal and np.all(np.any(wavevectors, axis=1))
        if is_direction_known and direction is not None:
            fault = "a direction is given for a longitudinal wave, which moves along q"
            raise InputError(fault, mend="Leave it out")
        self._operator = operator
        self._q = wavevectors
        self._polarisation = str(polarisation) if is_word else "given"
        components = direction if is_word else polarisation
        self._direction = () if components is None else finite_list("direction", components)
        # the number of the wave vector of each wave, and the function that makes its vector
        self._numbers: list[int] = []
        starts = list[Callable[[], Array]]()
        for n, wavevector in enumerate(wavevectors):
            rows = find_polarisations(operator, wavevector, polarisation, direction)
            # the sine of a wave of q = 0 is zero
            sines = (False, True) if np.any(wavevector) else (False,)
            for row, sine in itertools.product(rows, sines):
                self._numbers.append(n)
                starts.append(partial(make_plane_wave, operator, wavevector, row, sine=sine))
        self._waves = Moments(operator, starts, keep=keeps_vectors(operator, len(starts)))

    @property
    def n_waves(self) -> int:
        """Number of real waves: of the cosine and the sine of each polarisation."""
        return len(self._numbers)

    def find(self, moments: int) -> SpectralFunction:
        """Return the spectral function of this number of moments."""
        kernel = Kernel(self._operator.top / (2.0 * math.pi), moments)
        require_memory(
            f"spectra of {moments:,} moments at {len(self._q):,} wave vectors",
            _MOMENT_BYTES * len(self._q) * float(moments),
            "Take fewer wave vectors, or a coarser resolution",
        )
        sums = np.zeros((len(self._q), moments))
        n_products = self.n_waves * (moments // 2)
        with self._operator.progress.step("spectral functions", n_products) as step:
            np.add.at(sums, self._numbers, self._waves.first(moments, step))
        squared_norms = sums[:, :1]  # the moments of order zero
        if not np.all(squared_norms > 0.0):
            why = "The wave vector or the polarisation is wrong"
            raise InputError("no ball that touches others moves in this wave", why)
        return SpectralFunction(
            q=self._q,
            polarisation=self._polarisation,
            direction=self._direction,
            frequencies=kernel.frequencies,
            values=kernel.densities(sums / squared_norms),
            top=kernel.top,
            moments=moments,
            shortest=fold_wavevectors(self._operator.network, self._q),
            warnings=network_warnings(self._operator.network),
        )._with_work(self.find)
