"""The lattice Green's function of a periodic array: the inverse of C^T K C for equal contacts, in Fourier space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.array_rows import ArrayRow

Array = NDArray[np.float64]
#: number of wave vectors at which matrices are inverted at a time
_PART = 2**15
#: eigenvalue, over the largest of the same wave, that rounding explains
_SINGULAR = 1e-14


def green_function(
    rows: Sequence[ArrayRow], shape: tuple[int, ...], is_rotation: Sequence[bool], n_balls: int
) -> tuple[tuple[Any, ...], ...]:
    """Return the inverse of C^T K C of contacts of stiffness one, as entries [a][b] over pairs of fields.

    ``is_rotation`` says which of the fields are rotations. Entries have the shape (L1, ..., Lp/2 + 1) of the waves of real
    arrays. They are zero for translations of the whole array, and for other waves that deform no contact: where no ring of
    contacts is odd, balls can turn like gears, each against its neighbours. With one ball in the cell entries are real:
    rotations are multiplied by i. With several they are complex.
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
        for row in rows:
            angle = sum(step * part for step, part in zip(row.shift, half, strict=True))
            factors = _real_factors(row, angle, is_rotation) if real else _complex_factors(row, angle)
            for a, one in factors.items():
                for b, other in factors.items():
                    matrix[..., a, b] += row.ratio * np.conj(one) * other
        if first == 0:
            matrix[(0,) * len(shape)] += still
        inverse = _invert(matrix)
        if first == 0:
            inverse[(0,) * len(shape)] -= still
        entries[:, :, first : first + step] = np.moveaxis(inverse, (-2, -1), (0, 1))
    if real:  # symmetric, to the last digit
        return tuple(tuple(entries[min(a, b), max(a, b)] for b in range(fields)) for a in range(fields))
    return tuple(tuple(entries[a, b] for b in range(fields)) for a in range(fields))


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
        waves = fft.rfft(force, axis=axes[-1], workers=workers)
        for axis in axes[:-1]:
            waves = fft.fft(waves, axis=axis, workers=workers, overwrite_x=True)
        for rows in blocks:
            parts = waves[:, rows]
            parts[turning] *= -1j
            plain = parts.view(green.dtype)
            np.multiply(np.einsum("ab...,b...->a...", green[:, :, rows], plain), over, out=plain)
            parts[turning] *= 1j
        # transform one axis after the other: all at once would allocate another array of waves
        for axis in axes[:-1]:
            waves = fft.ifft(waves, axis=axis, workers=workers, overwrite_x=True)
        return np.asarray(fft.irfft(waves, shape[-1], axis=axes[-1], workers=workers))

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


def _real_factors(row: ArrayRow, angle: Any, is_rotation: Sequence[bool]) -> dict[int, Array]:
    """Return the deformation about the middle of the contact, by a wave z exp(i q r) of each field, less a common phase.

    A displacement deforms by 2i sin. A rotation deforms by 2 cos in a slip, which becomes 2i cos as rotations are multiplied
    by i, and by 2i sin in twist and roll.
    """
    sine, cosine, tail = 2.0 * np.sin(angle), 2.0 * np.cos(angle), dict(row.tail)
    return {a: head * (cosine if is_rotation[a] and head == -tail[a] else sine) for a, head in row.head}


def _complex_factors(row: ArrayRow, angle: Any) -> dict[int, NDArray[np.complex128]]:
    """Return the deformation by a wave exp(i q R) of each field, where R is the place of the cell."""
    factors: dict[int, Any] = {}
    for a, head in row.head:
        factors[a] = head * np.exp(2.0j * angle)
    for a, tail in row.tail:
        factors[a] = factors.get(a, 0.0) - tail + np.zeros_like(angle, complex)
    return factors
