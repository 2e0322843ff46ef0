"""The lowest branches of networks that repeat, at given wave vectors.

D of waves is sparse, and only its lowest eigenvalues are found: of small networks by a dense
matrix, of all others by :mod:`granphon.waves.lowest`. So cells of 1e5 balls have bands too.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.text import counted
from granphon.base.validation import finite_array, whole_number
from granphon.dynamics.compatibility import require_digits
from granphon.dynamics.lowest_modes import size_block
from granphon.waves.lowest import find_lowest
from granphon.waves.modes import MOST_DENSE_MOTIONS, MOST_MODES, ZERO, find_allowed_fall
from granphon.waves.operator import WaveOperator, explain_instability


def find_branches(operator: WaveOperator, q: ArrayLike, count: int) -> Array:
    """Return the ``count`` lowest frequencies (n_q, count), Hz, at wave vectors ``q`` (n_q, p), in
    fractions of the reciprocal cell; see :meth:`granphon.waves.waves.Waves.branches`.

    Raises what :func:`read_count` and :func:`read_wavevectors` raise, and what
    :func:`_require_stable` raises at the first wave vector at which a squared frequency is below
    zero; :class:`~granphon.base.errors.InputError` if the motions of balls deform no contact; and
    :class:`~granphon.base.errors.ConvergenceError` if the branches of a large network are not
    found. Squares below zero that raise no error are returned as frequencies of zero.
    """
    count = read_count(operator, count)
    wavevectors = read_wavevectors(operator, q)
    size = operator.size
    squares = np.empty((len(wavevectors), count))
    for row, wavevector in zip(squares, wavevectors, strict=True):
        matrix = operator.at_wavevector(wavevector)
        if size <= MOST_DENSE_MOTIONS:
            row[:] = np.linalg.eigvalsh(matrix.toarray())[:count]
        else:
            row[:] = find_lowest(operator, matrix, count, q=wavevector).values
        _require_stable(operator, row)
    is_rounding = squares <= (ZERO * operator.top) ** 2
    squares[is_rounding] = 0.0
    return np.asarray(np.sqrt(squares) / (2.0 * math.pi))


def read_count(operator: WaveOperator, count: int) -> int:
    """Return the number of branches that ``count`` gives.

    Raises :class:`~granphon.base.errors.InputError` for what is no whole number, 1 or more; for
    more branches than there are; and for more than the block of vectors of a large network can
    find, about a third of all.
    """
    count = whole_number("count", count, 1, MOST_MODES)
    size = operator.size
    # an iteration of the block has a space of three blocks: vectors, residuals and last changes
    exceeds_space = size > MOST_DENSE_MOTIONS and 3 * size_block(count) > size
    if count > size or exceeds_space:
        fault = f"{counted(count, 'branch is', 'branches are')} asked for, of {size:,}"
        raise InputError(fault, "Only the lowest ones are found", "Ask for fewer")
    return count


def read_wavevectors(operator: WaveOperator, q: ArrayLike) -> Array:
    """Return the wave vectors (n_q, p), in fractions of the reciprocal cell, that ``q`` (n_q, p) or
    (p,) gives; p is the number of axes along which the network repeats. If p is 1, a number is one
    wave vector.

    Raises :class:`~granphon.base.errors.InputError` for ``q`` of another shape, without a wave
    vector or not finite, and for a network that does not repeat; and
    :class:`~granphon.base.errors.PrecisionError` for a wave vector too far from Gamma.
    """
    p = int(np.count_nonzero(operator.network.pbc))
    if not p:
        raise InputError(
            "the network repeats along no axis",
            "Wave vectors are those of balls that repeat without end",
            "Ask for its modes, or give pbc and a cell",
        )
    wavevectors = np.atleast_2d(finite_array("q", q))
    if wavevectors.ndim != 2 or wavevectors.shape[1] != p or not len(wavevectors):
        raise InputError(
            f"q has the shape {np.shape(q)}",
            f"A wave vector has {counted(p, 'component')}, one for each period, in fractions",
            f"Give an array (n, {p})",
        )
    require_digits(wavevectors)
    return wavevectors


def _require_stable(operator: WaveOperator, squares: Array) -> None:
    """Raise :class:`~granphon.base.errors.InstabilityError` if the lowest of the squared
    frequencies ``squares`` (count,), (rad/s)^2, of a wave vector is below zero by more than
    :func:`find_allowed_fall`.

    Networks with forces that have no potential, such as static tangential ones, pass:
    :attr:`WaveOperator.whole` decides whether they are stable, and these eigenvalues do not.
    """
    if operator.whole is None and float(np.min(squares)) < -find_allowed_fall(operator):
        raise explain_instability(operator.network)
