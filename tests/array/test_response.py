"""The elastic constants of samples against dense matrices, nonlinear equilibria of strained cells,
and the calculator.
"""

from __future__ import annotations

import functools
import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granphon.array import equilibrium
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest
from granphon.dynamics.elasticity import bulk_and_shear
from granphon.statics.options import ResponseOptions
from tests.array.test_equilibrium import (
    at_rest,
    balls,
    by_lstsq,
    differences,
    moved,
    newton,
    symmetries,
)
from tests.array.test_stencils import ETA, Explicit, every_eta

AREA = math.sqrt(3.0) / 2.0  # of a ball
#: strains xx, yy, xy of Voigt's order
STRAINS = [
    np.array(s)
    for s in ([[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], [[0.0, 0.5], [0.5, 0.0]])
]


@functools.cache
def response(shape, seed, spacing, eta):
    return at_rest(shape, seed, spacing).find_elasticity(eta)


def dense_tensor(x, stiffness, eta):
    """The energy of each strain that no motion of balls and rotations takes away, by least
    squares.
    """
    explicit = Explicit(x.shape, eta)
    roots = np.sqrt(np.concatenate([stiffness.ravel(), eta * stiffness.ravel()][: 1 + (eta > 0.0)]))
    strained = np.zeros((len(roots), 3))
    for row, (_, _, normal) in enumerate(explicit.ends):
        n = np.array(normal)
        t = np.array([-normal[1], normal[0]])
        strained[row] = [n @ s @ n for s in STRAINS]
        if eta:
            strained[row + len(explicit.ends)] = [t @ s @ n for s in STRAINS]
    c = roots[:, None] * explicit.dense()
    strained = roots[:, None] * strained
    left = strained - c @ np.linalg.lstsq(c, strained, rcond=1e-12)[0]
    return left.T @ left / (AREA * x.size)


# -- closed forms ----------------------------------------------------------------------------------


@pytest.mark.claim("friction-bulk")
@pytest.mark.parametrize("spacing", [1e6, 1.0, 0.7, 0.5, 0.42])
def test_bulk_modulus_without_friction_is_the_stiffness(spacing):
    # P = sqrt(3) f/d under a uniform compression of delta/d, for every sample
    state = at_rest((24, 24), 0, spacing)
    assert bulk_and_shear(response((24, 24), 0, spacing, 0.0))[0] == pytest.approx(
        AREA * state.stiffness, rel=1e-10
    )


# -- dense matrices --------------------------------------------------------------------------------


@pytest.mark.claim("moduli-linear-response")
@every_eta
@pytest.mark.parametrize("spacing", [3.0, 0.5, 0.42])
@pytest.mark.parametrize("shape", [(1, 7), (2, 3), (5, 7)], ids=str)
def test_against_a_dense_matrix(shape, spacing, eta):
    state = at_rest(shape, 1, spacing)
    found = response(shape, 1, spacing, eta)
    expected = dense_tensor(state.deviations, state.stiffnesses, eta)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10 * expected.max())
    np.testing.assert_allclose(found, found.T, rtol=0.0, atol=1e-15 * found.max())


@pytest.mark.claim("moduli-linear-response")
@pytest.mark.parametrize("spacing", [1.0, 0.6])
def test_against_equilibria_of_strained_cells(spacing):
    # without friction the linear response is the derivative of the stress along true equilibria
    shape = (5, 4)
    step = 1e-5
    x, found = balls(shape, 2), response(shape, 2, spacing, 0.0)
    normals = np.array(Explicit.normals)
    dyads = np.stack([normals[:, 0] ** 2, normals[:, 1] ** 2, normals[:, 0] * normals[:, 1]])
    for column, strain in enumerate(STRAINS):

        def stress(amount, strain=strain):
            forces, _ = newton(x, ReducedLoad(overlap=spacing - 0.5), by_lstsq, amount * strain)
            return -dyads @ np.sum(forces, axis=(1, 2)) / (AREA * x.size)

        np.testing.assert_allclose(
            found[:, column], differences(stress, 0.0, step), rtol=0.0, atol=1e-6 * found.max()
        )


def test_balls_that_nothing_holds_do_not_count():
    # Newton's method leaves them where they touch by a trace of it: shear springs there would hold
    # them
    x, load = balls((14, 13), 3), ReducedLoad(overlap=0.1)
    states = [bring_to_rest(x, load, tolerance=tolerance) for tolerance in (1e-9, 1e-10, 1e-12)]
    assert all(np.any((state.forces > 0.0) & (state.stiffnesses == 0.0)) for state in states)
    first, *others = [state.find_elasticity(ETA) for state in states]
    for other in others:
        np.testing.assert_allclose(other, first, rtol=0.0, atol=1e-7 * first.max())


@pytest.mark.parametrize("eta", [0.0, ETA])
def test_the_error_of_the_response_is_that_asked_for_on_a_grid_too(eta, monkeypatch):
    state = at_rest((12, 12), 4, 0.5)
    exact = dense_tensor(state.deviations, state.stiffnesses, eta)
    none = dict.fromkeys((1, 2, 3), 0)  # balls whose matrix is factorised
    monkeypatch.setattr(equilibrium, "ResponseOptions", partial(ResponseOptions, most_balls=none))
    errors = [
        np.max(np.abs(state.find_elasticity(eta, reduction=reduction) - exact)) / np.max(exact)
        for reduction in (0.1, 1e-3, None)
    ]
    assert errors[0] > 1e-5 > errors[1] > 1e-10 > errors[2]
    assert errors[0] < 0.1**2


# -- the calculator's contacts, in real space ------------------------------------------------------


# -- properties ------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(
    st.tuples(st.integers(1, 7), st.integers(1, 7)),
    st.integers(0, 2**32 - 1),
    st.floats(-2.0, 8.0),
    st.floats(0.01, 3.0),
)
def test_friction_stiffens_and_freedom_softens(shape, seed, decade, eta):
    state = bring_to_rest(balls(shape, seed), ReducedLoad(force=10.0**decade))
    smooth, rough = (state.find_elasticity(ratio) for ratio in (0.0, eta))
    top = float(np.max(rough))
    # rotations and slips cost energy; balls that may not move would be stiffer still (affine strain
    # at the mean stiffness)
    normals = np.array(Explicit.normals)
    tangents = normals @ [[0.0, 1.0], [-1.0, 0.0]]
    affine = np.zeros((3, 3))
    for n, t, k in zip(normals, tangents, np.mean(state.stiffnesses, axis=(1, 2)), strict=True):
        along, across = (np.array([a @ s @ n for s in STRAINS]) for a in (n, t))
        affine += k * (np.outer(along, along) + eta * np.outer(across, across)) / AREA
    for stiffer, softer in ((rough, smooth), (affine, rough)):
        assert np.linalg.eigvalsh(stiffer - softer)[0] >= -1e-9 * top
    assert np.linalg.eigvalsh(smooth)[0] >= -1e-9 * top


@every_eta
def test_bulk_and_mean_shear_modulus_have_the_symmetry_of_the_lattice(eta):
    x, load = balls((8, 8), 3), ReducedLoad(overlap=0.2)
    first = bring_to_rest(x, load).find_elasticity(eta)
    tensors = []
    for matrix in symmetries():
        other = bring_to_rest(moved(x, matrix, np.array([1, 6])), load).find_elasticity(eta)
        tensors.append(other)
        assert bulk_and_shear(other) == pytest.approx(bulk_and_shear(first), rel=1e-10)
    # while the sample itself is not isotropic: its tensor turns with it
    assert np.ptp([tensor[0, 0] for tensor in tensors]) > 1e-3 * first[0, 0]
