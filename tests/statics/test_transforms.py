"""Fourier transforms of fields on a grid."""

from __future__ import annotations

import math

import numpy as np
import pytest

from granphon.statics.transforms import FastTransform, MatrixTransform, find_transform

#: even and odd lengths, one cell along an axis, one to three axes
SHAPES = [(1,), (2,), (7,), (24,), (1, 5), (6, 1), (5, 4), (24, 24), (3, 4, 5), (2, 2, 7)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_matrices_transform_as_the_sum_over_cells_does(shape, precision):
    rng = np.random.default_rng(0)
    fields = rng.normal(size=(2, 3, math.prod(shape))).astype(precision)
    transform = MatrixTransform(shape, np.dtype(precision))
    waves = transform.find_waves(fields)
    # sum over cells of the field times exp(-i q r), wave by wave
    cells = np.stack([index.ravel() for index in np.indices(shape)])
    numbers = np.indices((*shape[:-1], shape[-1] // 2 + 1)).reshape(len(shape), -1)
    angles = 2.0 * np.pi * (numbers / np.array(shape)[:, None]).T @ cells
    expected = np.einsum("fkc,wc->fkw", fields.astype(float), np.exp(-1j * angles))
    digits = 1e-6 if precision is np.float32 else 1e-14
    scale = math.prod(shape)
    assert waves.dtype == np.result_type(precision, np.complex64)
    np.testing.assert_allclose(waves, expected, rtol=0.0, atol=digits * scale)
    back = transform.find_fields(waves)
    assert back.dtype == precision
    np.testing.assert_allclose(back, fields, rtol=0.0, atol=10.0 * digits)


@pytest.mark.parametrize("shape", SHAPES)
def test_matrices_and_fast_transforms_give_the_same_fields(shape):
    rng = np.random.default_rng(1)
    fields = rng.normal(size=(3, math.prod(shape)))
    by_matrices = MatrixTransform(shape, np.dtype(float))
    fast = FastTransform(shape, 1)
    waves = fast.find_waves(fields)
    np.testing.assert_allclose(by_matrices.find_waves(fields), waves, rtol=0.0, atol=1e-12)
    # waves that are no transform of a real field, as products with a table may be by rounding
    amplitudes = waves * (1.0 + 0.5j)
    found = by_matrices.find_fields(amplitudes.copy())
    np.testing.assert_allclose(found, fast.find_fields(amplitudes), rtol=0.0, atol=1e-12)


def test_short_grids_are_transformed_by_matrices_and_long_ones_fast():
    precision = np.dtype(np.float32)
    for shape in [(200,), (24, 24), (8, 8, 8)]:
        assert isinstance(find_transform(shape, precision), MatrixTransform)
    for shape in [(1000,), (40, 40), (4, 1000), (16, 16, 16)]:
        assert isinstance(find_transform(shape, precision), FastTransform)
