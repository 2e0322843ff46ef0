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
from granphon.dynamics.lowest_modes import size_block
from granphon.waves.lowest import find_lowest
from granphon.waves.modes import DENSE, ZERO, find_fall
from granphon.waves.operator import WaveOperator, explain_instability


def find_branches(operator: WaveOperator, q: ArrayLike, count: int) -> Array:
    """Return the lowest frequencies (n_q, count), Hz, at wave vectors ``q``; see
    :meth:`granphon.waves.waves.Waves.branches`.
    """
    count = whole_number("count", count, 1)
    wavevectors = read_wavevectors(operator, q)
    size = operator.size
    if size_block(count) * 3 > size > DENSE or count > size:
        fault = f"{counted(count, 'branch is', 'branches are')} asked for, of {size:,}"
        raise InputError(fault, "Only the lowest ones are found", "Ask for fewer")
    squares = np.empty((len(wavevectors), count))
    for row, wavevector in zip(squares, wavevectors, strict=True):
        matrix = operator.at_wavevector(wavevector)
        if size <= DENSE:
            row[:] = np.linalg.eigvalsh(matrix.toarray())[:count]
        else:
            row[:] = find_lowest(operator, matrix, count, q=wavevector).values
    _require_stable(operator, squares)
    squares[squares <= (ZERO * operator.top) ** 2] = 0.0  # below are digits of rounding
    return np.asarray(np.sqrt(squares) / (2.0 * math.pi))


def read_wavevectors(operator: WaveOperator, q: ArrayLike) -> Array:
    """Return wave vectors (n_q, p), of ``q`` (n_q, p) or (p,), in fractions; InputError for others,
    and for a network without a period.
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
    return wavevectors


def _require_stable(operator: WaveOperator, squares: Array) -> None:
    """Raise :class:`~granphon.base.errors.InstabilityError` for squared frequencies below zero by
    more than static forces that are left on balls explain.
    """
    if operator.whole is None and float(np.min(squares)) < -find_fall(operator):
        raise explain_instability(operator.network)
