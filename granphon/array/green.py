"""The lattice Green's function of a periodic array: the inverse of C^T K C for equal contacts, in Fourier space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: number of wave vectors at which matrices are inverted at a time
_PART = 2**15
#: eigenvalue, over the largest of the same wave, that rounding explains
_SINGULAR = 1e-14


def green_function(
    coefficients: Array,
    shifts: Sequence[tuple[int, ...]],
    ratios: Sequence[float],
    shape: tuple[int, ...],
    is_rotation: Sequence[bool],
    n_balls: int,
) -> NDArray[Any]:
    """Return the inverse of C^T K C of contacts of stiffness one, as entries [a][b] over pairs of fields.

    C has the ``coefficients`` (2, rows, fields) of balls j and i, which are ``shifts`` of cells apart; ``ratios`` are the
    stiffnesses of the rows. ``is_rotation`` says which of the fields are rotations. Entries have the shape (L1, ..., Lp/2 +
    1) of the waves of real arrays. They are zero for translations of the whole array, and for other waves that deform no
    contact: where no ring of contacts is odd, balls can turn like gears, each against its neighbours. With one ball in the
    cell entries are real: rotations are multiplied by i. With several they are complex.
    """
    fields, real = len(is_rotation), n_balls == 1
    waves = (*shape[:-1], shape[-1] // 2 + 1)
    entries = np.zeros((fields, fields, *waves), float if real else complex)
    still = np.zeros((fields, fields))  # the projection on translations of the whole array
    per_ball = fields // n_balls
    for field in np.flatnonzero(~np.array(is_rotation)):
        still[field, field % per_ball :: per_ball] = 1.0 / n_balls
    step = max(1, _PART * shape[0] // max(1, int(np.prod(waves))))
    for first in range(0, waves[0], step):
        ticks = [np.arange(count) for count in waves]
        ticks[0] = ticks[0][first : first + step]
        half = np.meshgrid(*(np.pi / length * tick for length, tick in zip(shape, ticks, strict=True)), indexing="ij")
        matrix = np.zeros((*half[0].shape, fields, fields), entries.dtype)
        for row, (head, tail, ratio) in enumerate(zip(*coefficients, ratios, strict=True)):
            angle = sum(step * part for step, part in zip(shifts[row % len(shifts)], half, strict=True))
            factors = _real_factors(head, tail, angle, is_rotation) if real else _complex_factors(head, tail, angle)
            for a, one in factors.items():
                for b, other in factors.items():
                    matrix[..., a, b] += ratio * np.conj(one) * other
        if first == 0:
            matrix[(0,) * len(shape)] += still
        inverse = _invert(matrix)
        if first == 0:
            inverse[(0,) * len(shape)] -= still
        entries[:, :, first : first + step] = np.moveaxis(inverse, (-2, -1), (0, 1))
    if real:  # symmetric, to the last digit
        for a, b in combinations(range(fields), 2):
            entries[b, a] = entries[a, b]
    return entries


def green_inverse(
    green: Array, over: Any, turning: slice, shape: tuple[int, ...], blocks: Sequence[slice], workers: int
) -> Callable[[Array], Array]:
    """Return the product of forces (fields, L1, ..., Lp) with Green's function and a number ``over`` the stiffness.

    The precision of forces is that of ``green``, whose entries of one ball in the cell stand twice, for the real and the
    imaginary parts of waves; the fields ``turning`` are then rotations. ``blocks`` are parts of the first axis that stay in
    the processor's cache; ``workers`` threads share each Fourier transform.
    """
    from scipy import fft  # imported here: media that are not simulated do not need it

    axes = tuple(range(1, len(shape) + 1))

    def apply(force: Array) -> Array:
        waves = fft.rfftn(force, axes=axes, workers=workers)
        for rows in blocks:
            parts = waves[:, rows]
            parts[turning] *= -1j
            plain = parts.view(green.dtype)
            np.multiply(np.einsum("ab...,b...->a...", green[:, :, rows], plain), over, out=plain)
            parts[turning] *= 1j
        return np.asarray(fft.irfftn(waves, shape, axes=axes, workers=workers, overwrite_x=True))

    return apply


def _invert(matrix: NDArray[Any]) -> NDArray[Any]:
    """Return the inverses of (..., n, n) Hermitian matrices, zero for motions that cost nothing."""
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:  # not even rounding keeps it from being singular
        inverse = np.full_like(matrix, np.inf)
    sizes = [np.max(np.abs(one), axis=(-2, -1)) for one in (matrix, inverse)]
    singular = sizes[0] * sizes[1] * _SINGULAR > 1.0
    if np.any(singular):
        inverse[singular] = np.linalg.pinv(matrix[singular], rcond=_SINGULAR, hermitian=True)
    return np.asarray(inverse)


def _real_factors(head: Array, tail: Array, angle: Any, is_rotation: Sequence[bool]) -> dict[int, Array]:
    """Return the deformation about the middle of the contact, by a wave z exp(i q r) of each field, less a common phase.

    A displacement deforms by 2i sin. A rotation deforms by 2 cos in a slip, which becomes 2i cos as rotations are multiplied
    by i, and by 2i sin in twist and roll.
    """
    sine, cosine = 2.0 * np.sin(angle), 2.0 * np.cos(angle)
    return {a: head[a] * (cosine if is_rotation[a] and head[a] == -tail[a] else sine) for a in np.flatnonzero(head).tolist()}


def _complex_factors(head: Array, tail: Array, angle: Any) -> dict[int, NDArray[np.complex128]]:
    """Return the deformation by a wave exp(i q R) of each field, where R is the place of the cell."""
    ahead = np.exp(2.0j * angle)
    return {a: head[a] * ahead - tail[a] for a in np.flatnonzero((head != 0.0) | (tail != 0.0)).tolist()}
