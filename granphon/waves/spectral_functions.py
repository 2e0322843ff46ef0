"""Spectral functions of finite networks: which frequencies a plane wave has in an array that is not
perfect, as a line with a peak and a width.

A plane wave has a polarisation and a wave vector q. The periodic cell of the network *has* a wave
vector if the wave repeats with the cell: q . L is a multiple of 2 pi for each of its vectors L.
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
from granphon.base.results import held, read_only, result_class
from granphon.base.validation import finite_array, finite_list, one_of, positive
from granphon.dynamics.zone_means import shortest_vectors
from granphon.networks.network import ContactNetwork
from granphon.observables.validity import network_warnings
from granphon.waves.chebyshev import Kernel, Moments, Refinable, keeps_vectors
from granphon.waves.operator import WaveOperator
from granphon.waves.pulses import read_vector
from granphon.waves.settings import POLARISATIONS

#: largest deviation of q . L / 2 pi from a whole number that counts as rounding
_WHOLE_ROUNDING = 1e-6
#: largest phase of a wave across a network, rad: a larger phase has no digits within a turn
_MOST_PHASE = 1e15
#: length of the component of a direction across q, over that of the direction, below which the
#: component is zero
_LEAST_LENGTH = 1e-9
#: largest number that is tried as a common denominator of the sites of a lattice, in fractions of
#: the lattice vectors
_MOST_PARTS = 24
#: l of the full width l L + ((1 - l)^2 L^2 + G^2)^1/2 to which a kernel of the width G broadens a
#: Lorentz curve of the full width L. A Gaussian kernel has l = 0.5346, Voigt's curve (Olivero and
#: Longbothum, J. Quant. Spectrosc. Radiat. Transf. 17, 233 (1977)). The Jackson kernel is nearly a
#: Gaussian, and the formula holds to 3e-3 with this l
_LORENTZ_SHARE = 0.465
#: width of a line over that of the kernel, from which it counts as resolved
_LEAST_WIDTH = 0.2
#: memory of a spectrum, bytes for each moment
_MOMENT_BYTES = 40.0
#: greatest relative difference of the wave vectors of spectral functions that are averaged
_WAVEVECTOR_TOLERANCE = 1e-9
#: greatest relative difference of the resolutions of spectral functions that are averaged
_RESOLUTION_TOLERANCE = 0.02


class PeriodicCell(NamedTuple):
    """The cell of a network, without its balls.

    Attributes
    ----------
    cell : (3, 3) vectors of the cell, m.
    pbc : which of the vectors are periods.
    dimension : 1, 2 or 3 for balls on a line, in a plane, in space.
    """

    cell: Array
    pbc: tuple[bool, bool, bool]
    dimension: int


# -- wave vectors ----------------------------------------------------------------------------------


def read_wavevectors(network: ContactNetwork, q: ArrayLike) -> Array:
    """Return the wave vectors (n, d), 1/m, that ``q`` (d,) or (n, d) gives, without its rounding:
    along periods they are exactly those that the cell of the ``network`` has.

    Raises :class:`~granphon.base.errors.InputError` for a q that differs from all that the cell
    has by more than rounding; and what :func:`_as_wavevectors` raises.
    """
    requested = _as_wavevectors(network, q)
    nearest = _find_nearest_of_cell(network, requested)
    periods = network.cell[list(network.pbc), : network.dimension]
    # phases (n, p) across the periods, rad
    deviation = np.abs((requested - nearest) @ periods.T)
    rounding = 2.0 * np.pi * _WHOLE_ROUNDING * np.maximum(1.0, np.abs(nearest @ periods.T))
    is_wrong = deviation > rounding
    if np.any(is_wrong):
        row = int(np.argmax(np.any(is_wrong, axis=1)))
        fault = f"q = {_write_vector(requested[row])} is no wave vector of the periodic cell"
        mend = (
            f"The nearest is {_write_vector(nearest[row])} 1/m;"
            f" waves.nearest_wavevectors(q) finds it for any q"
        )
        if not np.any(nearest[row]):
            mend = f"The nearest is zero, and the shortest other {_find_shortest(network):.6g} 1/m"
        why = "Along each of its vectors L, q . L must be a multiple of 2 pi"
        raise InputError(fault, why, mend)
    return nearest


def _write_vector(vector: Array) -> str:
    """Return the text of a ``vector`` (d,), such as "(0, 1)"."""
    return "(" + ", ".join(f"{component:.9g}" for component in vector) + ")"


def nearest_wavevectors(network: ContactNetwork | PeriodicCell, q: ArrayLike) -> Array:
    """Return the wave vectors nearest to ``q`` (d,) or (n, d), 1/m, that the periodic cell of the
    ``network`` has, in the same shape; raises what :func:`_as_wavevectors` raises.
    """
    requested = _as_wavevectors(network, q)
    nearest = _find_nearest_of_cell(network, requested)
    return np.asarray(nearest.reshape(np.shape(q)))


def fold_wavevectors(network: ContactNetwork, q: Array) -> Array | None:
    """Return for each wave vector of ``q`` (n, d), 1/m, the shortest wave vector (n, d), 1/m, whose
    wave moves all balls of a lattice in the same way.

    The two differ by a reciprocal vector G of the lattice with exp(i G . t) = 1 for the steps t
    between all balls of its cell. With one ball in the cell every G is such a vector, and the
    shortest wave vector lies in the first zone; along the axis of hcp every second G is one.

    Returns None for a network of no lattice, or that does not repeat along all periods of its
    lattice; and if no whole number up to :data:`_MOST_PARTS` makes all sites whole multiples of its
    inverse, in fractions of the lattice vectors.
    """
    if network.lattice is None or network.shape is None:
        return None
    n_periods = len(network.shape)
    if not all(network.pbc[:n_periods]):  # then the cell does not have all lattice vectors
        return None
    # steps between the balls of a cell, in fractions of the lattice vectors
    sites = network.lattice.positions @ np.linalg.pinv(network.lattice.vectors)
    steps = sites - sites[0]
    denominator = _find_denominator(steps)
    if denominator is None:
        return None
    whole_steps = np.round(denominator * steps).astype(int)
    repeats = _find_repeats(whole_steps, denominator)
    lattice_vectors = network.cell[:n_periods, : q.shape[1]] / np.array(network.shape)[:, None]
    # the vectors whose reciprocal vectors are the repeats
    periods_of_waves = np.linalg.inv(repeats).T @ lattice_vectors
    return q - _find_nearest(periods_of_waves, q)


def _find_denominator(fractions: Array) -> int | None:
    """Return the least whole number whose products with all ``fractions`` (n, p) are whole; None if
    it is above :data:`_MOST_PARTS`.
    """
    for number in range(1, _MOST_PARTS + 1):
        multiples = number * fractions
        if np.all(np.abs(multiples - np.round(multiples)) <= _WHOLE_ROUNDING):
            return number
    return None


def _find_repeats(steps: NDArray[np.intp], denominator: int) -> NDArray[np.intp]:
    """Return a basis, as rows of whole numbers (p, p) in the reciprocal lattice, of all reciprocal
    vectors G with exp(i G . t) = 1 for the ``steps`` t (n, p), which are whole numbers in units of
    1/``denominator`` of the lattice vectors.

    The denominator times any reciprocal vector is such a G. So the vectors with components from 0
    to the denominator contain a triangular basis.
    """
    p = steps.shape[1]
    all_vectors = np.indices((denominator + 1,) * p).reshape(p, -1).T
    has_same_phases = np.all((all_vectors @ steps.T) % denominator == 0, axis=1)
    vectors = all_vectors[has_same_phases]
    repeats = np.zeros((p, p), np.intp)
    for axis in range(p):
        # zero along the axes before, and as short as can be along this one
        has_zeros_before = ~np.any(vectors[:, :axis], axis=1)
        candidates = vectors[has_zeros_before & (vectors[:, axis] > 0)]
        repeats[axis] = candidates[np.argmin(candidates[:, axis])]
    return repeats


def _as_wavevectors(network: ContactNetwork | PeriodicCell, q: ArrayLike) -> Array:
    """Return the wave vectors (n, d), 1/m, that ``q`` (d,) or (n, d), 1/m, gives; on a line ``q``
    may also be a number.

    Raises :class:`~granphon.base.errors.InputError` for another shape, for no wave vector, and for
    what is not finite; and
    :class:`~granphon.base.errors.PrecisionError` if phases across the ``network`` are so large that
    they have no digits within a turn.
    """
    vectors = finite_array("q", q, "1/m")
    d = network.dimension
    if d == 1 and vectors.ndim == 0:
        vectors = vectors.reshape(1)
    if vectors.ndim not in (1, 2) or vectors.shape[-1] != d:
        why = f"A wave vector of this network has the shape ({d},)"
        mend = f"Give ({d},) or (n, {d}), Cartesian, in 1/m"
        raise InputError(f"q has the shape {vectors.shape}", why, mend)
    extent = float(np.max(np.abs(network.cell), initial=0.0))
    if isinstance(network, ContactNetwork):  # a cell alone has no balls
        extent += float(np.ptp(network.positions))
    phase = float(np.max(np.abs(vectors), initial=0.0)) * extent
    if phase > _MOST_PHASE:
        fault = f"the phase of such a wave differs by {phase:.1e} across the network"
        raise PrecisionError(
            fault, f"Beyond {_MOST_PHASE:.0e} its digits within a turn are lost", "Give a shorter q"
        )
    return np.atleast_2d(vectors)


def _find_shortest(network: ContactNetwork | PeriodicCell) -> float:
    """Return the length, 1/m, of the shortest wave vector but zero that the periodic cell of the
    ``network`` has.
    """
    periods = network.cell[list(network.pbc), : network.dimension]
    reciprocal = 2.0 * np.pi * np.asarray(np.linalg.pinv(periods).T, float)
    return float(np.linalg.norm(shortest_vectors(reciprocal)[0]))


def _find_nearest_of_cell(network: ContactNetwork | PeriodicCell, q: Array) -> Array:
    """Return the wave vectors (n, d), 1/m, nearest to ``q`` (n, d), 1/m, that the cell of the
    ``network`` has; their components across the periods are those of ``q``.
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
    """Return the wave vectors (n, d), 1/m, nearest to ``q`` (n, d), 1/m, whose waves repeat with
    all ``periods`` (p, d), m.
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
    # of candidates that are equally near but for rounding the first is taken, the same at all loads
    nearest = np.argmin(np.round(squares / np.sum(reciprocal**2), 9), axis=1)
    # made from whole numbers, and not as a step from q, the same wave vector always has the same
    # digits, and Gamma is zero; adding zero makes 0 of -0
    numbers = candidates[np.arange(len(q)), nearest] @ to_shortest
    return np.asarray(2.0 * np.pi * numbers @ reciprocal + 0.0)


# -- polarisations ---------------------------------------------------------------------------------


def find_polarisations(
    operator: WaveOperator, q: Array, polarisation: str | ArrayLike, direction: ArrayLike | None
) -> Array:
    """Return the b polarisations that a word means for a wave with the wave vector ``q`` (d,), 1/m,
    as orthonormal rows (b, motions); a spectral function is the mean over these. A polarisation by
    numbers makes one row.

    ``polarisation`` and ``direction`` are the arguments of ``Waves.spectral_function``. Raises
    :class:`~granphon.base.errors.InputError` for another word or other numbers, if the balls do not
    move or turn in that polarisation, and if a direction that the polarisation needs is missing, is
    given beside numbers, or is no vector; and what :func:`_choose_directions` raises.
    """
    motions = operator.motions
    if not isinstance(polarisation, str):
        if direction is not None:
            finite_array("polarisation", polarisation)  # raises if it is not numbers
            raise InputError(
                "a direction is given beside a polarisation by numbers",
                "The numbers are a direction already",
                "Leave the direction out",
            )
        return _read_polarisation(operator, polarisation)
    name = one_of("polarisation", polarisation, POLARISATIONS)
    is_rotational = name == "rotational"
    axes = motions.rotations if is_rotational else motions.translations
    # (a, 3) directions in which balls move, or about which they turn
    free_axes = np.eye(3)[list(axes)]
    directions = np.atleast_2d(_choose_directions(operator.network, q, name, free_axes, direction))
    _require_free_directions(operator, name, directions, axes)
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    if np.any(lengths < _LEAST_LENGTH):
        # these are rotations: a direction in which balls do not move is refused above
        turns = ", ".join("xyz"[axis] for axis in motions.rotations)
        raise InputError(
            "balls do not turn about the direction of the rotational wave",
            f"They turn about {turns} alone",
        )
    unit_vectors = directions / lengths  # (b, 3)
    columns = motions.turning if is_rotational else motions.translating
    rows = np.zeros((len(directions), motions.count))
    rows[:, columns] = unit_vectors[:, list(axes)]
    return rows


def _require_free_directions(
    operator: WaveOperator, name: str, directions: Array, axes: Sequence[int]
) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless balls move along, or turn about, the
    ``directions`` (b, 3) of a wave with the polarisation ``name``. ``axes``, 0 to 2 for x to z, are
    those along which balls can move, or about which balls can turn.
    """
    motions = operator.motions
    held_components = np.abs(np.delete(directions, list(axes), axis=1))
    is_free = np.max(held_components, initial=0.0) <= _LEAST_LENGTH
    if len(directions) and len(axes) and is_free:
        return
    alternatives = {"longitudinal": "transverse", "transverse": "longitudinal"}
    mend = ""
    if name in alternatives and motions.translations:
        mend = f"Take the polarisation {alternatives[name]}"
    why = f"Balls move in {', '.join(motions.letters)} alone"
    raise InputError(f"no {name} wave of this direction runs here", why, mend)


def _choose_directions(
    network: ContactNetwork, q: Array, name: str, free_axes: Array, direction: ArrayLike | None
) -> Array:
    """Return the directions (3,) or (b, 3) in which balls move, or about which they turn, in a wave
    with the polarisation ``name`` and the wave vector ``q`` (d,), 1/m.

    ``free_axes`` (a, 3) are the axes along which balls can move, or about which balls can turn;
    ``direction`` (1,) to (3,) is the one that the user requests, or None. Raises
    :class:`~granphon.base.errors.InputError` for what is no vector, for q = 0 without a direction
    unless the wave is rotational, and for a direction of a transverse wave along q.
    """
    requested = None
    if direction is not None:
        requested = read_vector("direction", direction, network.dimension)
    if name == "rotational":
        if requested is None:
            return free_axes
        return np.asarray((requested @ free_axes.T) @ free_axes)  # the part along free axes
    if not np.any(q):
        if requested is None:
            raise _explain_no_direction(network, name)
        return requested
    directions = _find_directions(network, q, name, free_axes, requested)
    if requested is not None and np.linalg.norm(directions) < _LEAST_LENGTH:
        raise InputError(f"the direction {brief(direction)} of a transverse wave is along q")
    return directions


def _find_directions(
    network: ContactNetwork, q: Array, name: str, free_axes: Array, requested: Array | None
) -> Array:
    """Return the directions (3,) or (b, 3) in which balls move in a wave with the polarisation
    ``name``, longitudinal or transverse, and a wave vector ``q`` (d,) that is not zero.

    A longitudinal wave moves along q. A transverse wave moves along the part of the ``requested``
    direction (3,) that is across q. Without a request, all directions are returned that are across
    q and in the space of ``free_axes`` (a, 3), along which balls can move: those in the plane of
    the balls if there are any, else all.
    """
    unit_q = np.zeros(3)
    unit_q[: q.size] = q / np.max(np.abs(q))  # squares of the numbers as they are may underflow
    unit_q /= np.linalg.norm(unit_q)
    if name == "longitudinal":
        return unit_q
    if requested is not None:
        return np.asarray(requested - (requested @ unit_q) * unit_q)
    # axes of the plane of the balls first
    in_plane = free_axes[np.argmax(free_axes, axis=1) < network.dimension]
    directions = _find_transverse(in_plane, unit_q)
    return directions if len(directions) else _find_transverse(free_axes, unit_q)


def _explain_no_direction(network: ContactNetwork, name: str) -> InputError:
    """Return the error for a wave with q = 0 and the polarisation ``name`` in a ``network``, if no
    direction is given.
    """
    mend = "Give direction=, the one in which balls move"
    if any(network.pbc):
        shortest = _find_shortest(network)
        mend += f", or a longer q: the shortest that this cell has is {shortest:.6g} 1/m"
    return InputError(f"a {name} wave with q = 0 has no direction", mend=mend)


def _read_polarisation(operator: WaveOperator, polarisation: ArrayLike) -> Array:
    """Return the ``polarisation`` by numbers, of all displacements or of all motions, as a row
    (1, motions) of norm one.

    Raises :class:`~granphon.base.errors.InputError` for another number of numbers, and for zeros.
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


def _find_transverse(free_axes: Array, along: Array) -> Array:
    """Return orthonormal directions (b, 3) that span the part of the space of the orthonormal
    directions ``free_axes`` (a, 3) that is perpendicular to the unit vector ``along`` (3,), which
    lies in this space or is perpendicular to all of it.
    """
    if not len(free_axes):
        return free_axes
    across = free_axes - (free_axes @ along)[:, None] * along
    _, singular_values, basis = np.linalg.svd(across)
    # all values are 1 but the last, the length of the part of ``along`` that is not among the
    # directions: 0 or 1
    return np.asarray(basis[: singular_values.size][singular_values > 0.5])


# -- vectors ---------------------------------------------------------------------------------------


def make_plane_wave(operator: WaveOperator, q: Array, polarisation: Array, is_sine: bool) -> Array:
    """Return the mass-weighted vector (size,) of a plane wave, in which a ball at r moves by
    cos(q . r), or with ``is_sine`` by sin(q . r), times ``polarisation`` (motions,); ``q`` (d,) is
    in 1/m.

    Displacements, and rotations that are given with them, are weighted by the root of the mass, so
    that q = 0 is the motion of all balls together. In a wave of rotations alone, rotations are
    weighted by the root of the moment of inertia. Balls without contacts take no part, as no wave
    reaches them.
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
    amplitudes = np.sin(phases) if is_sine else np.cos(phases)
    wave = np.where(is_touching[balls], weights * amplitudes, 0.0)
    return np.asarray(operator.vector(wave[:, None] * polarisation))


def find_mean_free_path(velocity: Array, width: Array) -> Array:
    """Return the mean free path (n,), m, of the energy of waves: their phase ``velocity`` (n,),
    m/s, over 2 pi times the full ``width`` (n,) of their lines, Hz; infinite where the width is
    zero.
    """
    paths = np.full(np.shape(width), math.inf)
    np.divide(velocity, 2.0 * math.pi * width, out=paths, where=width > 0.0)
    return paths


def find_attenuation(velocity: Array, width: Array) -> Array:
    """Return the attenuation (n,), 1/m, of the amplitude of waves with a phase ``velocity`` (n,),
    m/s, and lines of the full ``width`` (n,), Hz: half the inverse mean free path; infinite where
    the velocity is zero.
    """
    rates = np.full(np.shape(width), math.inf)
    np.divide(math.pi * width, velocity, out=rates, where=velocity > 0.0)
    return rates


def find_lines(kernel: Kernel, values: Array) -> tuple[Array, Array]:
    """Return for the highest line of each of the spectra ``values`` (n, n_f), 1/Hz, at the
    frequencies of the ``kernel``, the frequency of its peak (n,), Hz, and its full width (n,) at
    half the height, Hz.

    Between the points, which are even in the angle theta of the kernel, the logarithm of a spectrum
    is taken as a parabola at the peak, and as a straight line on the flanks; the first is exact for
    a Gaussian, and nearly so is the kernel. The spectrum is continued as an even function below
    zero. If a line falls to half its height on one side only, the width is twice the half width of
    this side.

    Raises :class:`~granphon.base.errors.InputError` if a line falls to half its height on neither
    side.
    """
    peaks = np.empty(len(values))
    widths = np.empty(len(values))
    for number, spectrum in enumerate(values):
        peaks[number], widths[number] = _find_line(kernel, spectrum)
    return peaks, widths


def _find_line(kernel: Kernel, spectrum: Array) -> tuple[float, float]:
    """Return the peak, Hz, and the full width, Hz, of the highest line of a ``spectrum`` (n_f,), as
    :func:`find_lines` does, which says what is raised.
    """
    step = math.pi / (2 * kernel.count - 1)  # difference of theta from point to point
    highest = int(np.argmax(spectrum))
    log = np.log(np.maximum(spectrum, np.finfo(float).tiny))
    peak_point, height = _fit_peak(log, highest)
    peak = kernel.top * math.sin(step * peak_point)
    half_height = height - math.log(2.0)
    half_widths = []
    for sign, flank in ((-1, log[highest::-1]), (1, log[highest:])):
        n_points = _measure_fall(flank, half_height)
        if n_points is not None:
            crossing = highest + sign * n_points
            half_widths.append(abs(kernel.top * math.sin(step * crossing) - peak))
    if not half_widths:
        fault = f"the highest line, at {peak:.6g} Hz, falls to half its height on neither side"
        why = f"So it has no width at a resolution of {kernel.resolution:.4g} Hz"
        raise InputError(fault, why, "Give a finer resolution, or more moments")
    has_two_flanks = len(half_widths) == 2
    width = sum(half_widths) if has_two_flanks else 2.0 * half_widths[0]
    return peak, width


def _measure_fall(flank: Array, level: float) -> float | None:
    """Return after how many points, a fraction among these, a ``flank`` (n,), taken as linear
    between points, has fallen to a ``level``, above which it begins; None if it does not fall so
    far.
    """
    below = np.flatnonzero(flank < level)
    if not below.size:
        return None
    first_below = int(below[0])
    last_above = flank[first_below - 1]
    share = (last_above - level) / (last_above - flank[first_below])
    return float(first_below - 1 + share)


def _fit_peak(log: Array, highest: int) -> tuple[float, float]:
    """Return the position, in points, and the height, a logarithm, of the top of the parabola
    through the logarithms ``log`` (n_f,) at the ``highest`` point, an index, and at both points
    beside it; at the last point those of the point itself.
    """
    height = float(log[highest])
    if highest == log.size - 1:
        return float(highest), height
    previous = float(log[abs(highest - 1)])  # the spectrum is even about zero
    following = float(log[highest + 1])
    curvature = previous - 2.0 * height + following
    shift = 0.0 if curvature >= 0.0 else 0.5 * (previous - following) / curvature
    return float(highest) + shift, height - 0.25 * (previous - following) * shift


def find_true_width(broadened_width: Array, kernel_width: Array) -> Array:
    """Return the full widths L (n,), Hz, of Lorentz curves to which a kernel of the full width
    ``kernel_width`` G (n,), Hz, has given the ``broadened_width`` full widths (n,), Hz.

    L follows from broadened = l L + ((1 - l)^2 L^2 + G^2)^1/2 with l = :data:`_LORENTZ_SHARE`. A
    curve that is not wider than the kernel has the width zero.
    """
    width = np.maximum(broadened_width, kernel_width)
    # the positive root of (1 - 2 l) L^2 + 2 l B L = B^2 - G^2, B the broadened width
    square = (1.0 - _LORENTZ_SHARE) ** 2
    leading_coefficient = square - _LORENTZ_SHARE**2  # 1 - 2 l
    root = np.sqrt(square * width**2 - leading_coefficient * kernel_width**2)
    return np.asarray(np.maximum((root - _LORENTZ_SHARE * width) / leading_coefficient, 0.0))


def find_ioffe_regel(
    wavenumber: Array, peak: Array, width: Array, product: float = 1.0
) -> float | None:
    """Return the frequency, Hz, from which the ``wavenumber`` (n,), 1/m, times the mean free path
    is below ``product``, of waves whose lines have the ``peak`` (n,), Hz, and the full ``width``
    (n,), Hz; None if no wave has so small a product.

    See :meth:`granphon.waves.spectral_functions.SpectralFunction.ioffe_regel`, which says how the
    frequency is interpolated and what is raised. If the last line with a larger product has the
    width zero, nothing can be interpolated, and the frequency is that of the next peak. A line at
    the frequency zero has the product zero, whatever its width.
    """
    log_product = math.log(positive("product", product))
    ascending = np.argsort(wavenumber, kind="stable")
    peaks = peak[ascending]
    widths = width[ascending]
    # wavenumber times mean free path is peak over width
    divisors = np.where(peaks > 0.0, widths, 1.0)
    with np.errstate(divide="ignore"):  # a line without width is infinitely far above
        log_excess = np.log(peaks) - np.log(divisors) - log_product
    if log_excess[0] < 0.0:
        fault = (
            f"the wave of the least q, at {peaks[0]:.4g} Hz, is already beyond the Ioffe-Regel"
            f" frequency"
        )
        raise InputError(fault, mend="Give shorter wave vectors, which a larger network has")
    below = np.flatnonzero(log_excess < 0.0)
    if not below.size:
        return None
    first = int(below[0])
    last_excess = log_excess[first - 1]  # that of the last wave with a larger product
    if math.isinf(last_excess):
        return float(peaks[first])
    share = last_excess / (last_excess - log_excess[first])
    return float(peaks[first - 1] + share * (peaks[first] - peaks[first - 1]))


@result_class
class SpectralFunction(Refinable):
    """Spectral function A(q, f) of plane waves s of norm one on a network: the spectrum
    ``<s| delta(f - D^1/2 / 2 pi) |s>``.

    It is exact for the network, but for the kernel, which broadens each line. A plane wave that is
    no mode of the network scatters into other modes, and its line has a width.

    Attributes
    ----------
    q : (n, d) wave vectors, Cartesian, 1/m.
    polarisation : "longitudinal", "transverse", "rotational", or "given" if given by numbers.
    direction : the direction that was given, or the numbers of the polarisation; empty if there
        were none.
    frequencies : (n_f,) Hz, from zero; Chebyshev nodes, four within the standard deviation of the
        kernel.
    values : (n, n_f) 1/Hz; the integral over all frequencies is 1 for each wave vector.
    top : bound of all frequencies, Hz, to which the polynomials are scaled.
    moments : number of Chebyshev moments.
    shortest : (n, d) shortest wave vectors, 1/m, whose waves move all balls of the lattice as those
        of ``q``. They differ from q by reciprocal vectors G with exp(i G . t) = 1 for the steps t
        between all balls of a cell. With one ball in a cell every G is such a vector, and the
        shortest wave vectors lie in the first zone. None if the network has no lattice, or does not
        repeat along all of its periods, or if no whole number up to 24 makes all sites of the
        lattice whole multiples of its inverse, in fractions of the lattice vectors.
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
        """The peaks (n,), Hz, and the full widths (n,), Hz, of the highest lines as the kernel has
        broadened them.
        """
        peaks, widths = find_lines(self._kernel, self.values)
        return read_only(peaks), read_only(widths)

    @cached_property
    def _kernel_width(self) -> Array:
        """(n,) the full width at half maximum that the kernel alone gives to a line at each peak,
        Hz.
        """
        _, widths = find_lines(self._kernel, self._kernel.line(self.peak))
        return widths

    @property
    def peak(self) -> Array:
        """(n,) frequency of the highest maximum, Hz: the dispersion of the coherent wave.

        Raises :class:`~granphon.base.errors.InputError` if the line falls to half its height on
        neither side: the resolution is too coarse.
        """
        peaks, _ = self._lines
        return peaks

    @cached_property
    def width(self) -> Array:
        """(n,) full width at half maximum of the highest line, Hz, without the width of the kernel.

        The line is taken as a Lorentz curve that the kernel has broadened, and the width is that of
        the Lorentz curve; a line that is not wider than the kernel has the width zero. See
        :attr:`resolved`. If the line falls to half its height on one side only, the width is twice
        the half width of this side. Raises what :attr:`peak` raises.
        """
        _, broadened_width = self._lines
        return read_only(find_true_width(broadened_width, self._kernel_width))

    @property
    def resolved(self) -> NDArray[np.bool_]:
        """(n,) whether the width of each line is at least a fifth of that of the kernel; a smaller
        width is not to be relied on. Raises what :attr:`peak` raises.
        """
        return np.asarray(self.width >= _LEAST_WIDTH * self._kernel_width)

    @property
    def wavenumber(self) -> Array:
        """(n,) lengths of the wave vectors, 1/m: those of :attr:`shortest`, or of ``q`` if it is
        None.
        """
        wavevectors = self.q if self.shortest is None else self.shortest
        return np.asarray(np.linalg.norm(wavevectors, axis=1))

    @property
    def phase_velocity(self) -> Array:
        """(n,) 2 pi peak over the :attr:`wavenumber`, m/s.

        Raises :class:`~granphon.base.errors.InputError` for q = 0, and, if :attr:`shortest` is
        known, for a q at which all balls move as at q = 0; and what :attr:`peak` raises.
        """
        self._require_travelling("velocity")
        return np.asarray(2.0 * math.pi * self.peak / self.wavenumber)

    def _require_travelling(self, quantity: str) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the :attr:`wavenumber` of one of the
        waves is zero, so that this wave has no such ``quantity``, a word for the message.
        """
        rounding = _WAVEVECTOR_TOLERANCE * np.linalg.norm(self.q, axis=1)
        if np.any(self.wavenumber <= rounding):
            why = (
                "Where exp(i q . r) is the same at all sites of a lattice, all balls move"
                " together, as at q = 0"
            )
            raise InputError(f"a wave with q = 0 has no {quantity}", why, "Give other wave vectors")

    @property
    def mean_free_path(self) -> Array:
        """(n,) mean free path of the energy of a wave, m: phase velocity over 2 pi width; infinite
        where the width is zero.

        The energy of a coherent wave falls as exp(-2 pi width t). Where bands bend, the wave
        travels at a group velocity that is not the phase velocity: its path is then longer or
        shorter than this number by the ratio of both. Raises what :attr:`phase_velocity` raises.
        """
        return find_mean_free_path(self.phase_velocity, self.width)

    @property
    def attenuation(self) -> Array:
        """(n,) attenuation of the amplitude, 1/m (neper per metre): half the inverse mean free
        path; infinite where the velocity is zero. Raises what :attr:`phase_velocity` raises.
        """
        return find_attenuation(self.phase_velocity, self.width)

    def ioffe_regel(self, product: float = 1.0) -> float | None:
        """Return the frequency, Hz, from which wavenumber times mean free path is below
        ``product``; None if it is below for no wave.

        For a product of 1 the mean free path is the wavelength over 2 pi, and the width of the line
        its frequency; for a product of pi the path is half the wavelength. In the order of the
        lengths of wave vectors, the frequency lies between the first wave with a smaller product
        and the one before it; the logarithm of peak/width is interpolated between their peaks.
        Raises :class:`~granphon.base.errors.InputError` if already the shortest wave vector has a
        smaller product, for a ``product`` that is not above zero, and as :attr:`phase_velocity`
        does.
        """
        self._require_travelling("mean free path")
        return find_ioffe_regel(self.wavenumber, self.peak, self.width, product)

    # -- means -------------------------------------------------------------------------------------

    @classmethod
    def average(cls, found: Sequence[SpectralFunction]) -> SpectralFunction:
        """Return the mean of the spectral functions ``found`` of arrays with one shape, at the
        frequencies of the one with the highest ``top``.

        The others are interpolated to these frequencies by cubic splines, to about 1e-3 of their
        peaks. The wave vectors, moments and warnings of the mean are those of that one. More
        moments cannot be computed of the mean.

        Raises :class:`~granphon.base.errors.InputError` for what is no list or tuple, if there is
        no spectral function, for what is none, if wave vectors or polarisations differ, or if
        resolutions differ by more than 2 %: give all of them the same ``resolution``.
        """
        if not isinstance(found, Sequence):
            raise InputError(f"{brief(found)} is no list of spectral functions", mend="Give a list")
        if not found:
            raise InputError("there are no spectral functions to average", mend="Give one or more")
        for spectrum in found:
            if not isinstance(spectrum, SpectralFunction):
                raise InputError(f"{brief(spectrum)} is no spectral function", mend="Leave it out")
        highest = max(found, key=lambda spectrum: spectrum.top)
        for spectrum in found:
            spectrum._require_like(highest)
        interpolated_values = [spectrum._interpolate(highest.frequencies) for spectrum in found]
        values = np.mean(interpolated_values, axis=0)
        # interpolation changes the integral a little: it is made 1 again
        integrals = highest._kernel.integral(values)
        return replace(highest, values=values / integrals[:, None])

    def _require_like(self, reference: SpectralFunction) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless wave vectors, polarisation and
        resolution are those of the ``reference``.
        """
        rounding = _WAVEVECTOR_TOLERANCE * np.max(np.abs(reference.q), initial=0.0)
        has_same_q = self.q.shape == reference.q.shape and np.allclose(
            self.q, reference.q, rtol=_WAVEVECTOR_TOLERANCE, atol=rounding
        )
        has_same_word = self.polarisation == reference.polarisation
        has_same_direction = self.direction == reference.direction
        if not (has_same_q and has_same_word and has_same_direction):
            raise InputError(
                "spectral functions of other wave vectors or polarisations have no mean"
            )
        difference = abs(self.resolution - reference.resolution)
        if difference > _RESOLUTION_TOLERANCE * reference.resolution:
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
    """Plane waves on a network, and their Chebyshev moments, from which :meth:`find` makes spectral
    functions.

    For each wave vector there are real waves: the cosine and the sine of each polarisation. Their
    moments are summed. Moments that were computed are kept.

    Parameters
    ----------
    operator : D of the network.
    q, polarisation, direction : arguments of
        :meth:`granphon.waves.waves.Waves.spectral_function`, which says what is raised.
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
        name, components = ("direction", direction) if is_word else ("polarisation", polarisation)
        self._direction = () if components is None else finite_list(name, components)
        # of each real wave the index of its wave vector, and the function that makes its vector
        self._wavevector_of_wave: list[int] = []
        starts = list[Callable[[], Array]]()
        for number, wavevector in enumerate(wavevectors):
            rows = find_polarisations(operator, wavevector, polarisation, direction)
            # the sine of a wave of q = 0 is zero
            sine_flags = (False, True) if np.any(wavevector) else (False,)
            for row, is_sine in itertools.product(rows, sine_flags):
                self._wavevector_of_wave.append(number)
                starts.append(partial(make_plane_wave, operator, wavevector, row, is_sine=is_sine))
        self._waves = Moments(operator, starts, is_kept=keeps_vectors(operator, len(starts)))

    @property
    def n_waves(self) -> int:
        """Number of real waves: cosines and sines of all polarisations and wave vectors."""
        return len(self._wavevector_of_wave)

    def find(self, moments: int) -> SpectralFunction:
        """Return the spectral function by this number of ``moments``.

        Raises :class:`~granphon.base.errors.InputError` for more than memory holds, and for a wave
        in which no ball with contacts moves.
        """
        kernel = Kernel(self._operator.top / (2.0 * math.pi), moments)
        require_memory(
            f"spectra of {moments:,} moments at {len(self._q):,} wave vectors",
            _MOMENT_BYTES * len(self._q) * float(moments),
            "Take fewer wave vectors, or a coarser resolution",
        )
        sums = np.zeros((len(self._q), moments))
        n_products = self.n_waves * (moments // 2)
        with self._operator.progress.step("spectral functions", n_products) as step:
            np.add.at(sums, self._wavevector_of_wave, self._waves.first(moments, step))
        squared_norms = sums[:, :1]  # the moments of order zero
        if not np.all(squared_norms > 0.0):
            why = "Balls without contacts take no part, as no wave reaches them"
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
        )._with_finder(self.find)
