"""Elastic tensors in Voigt order: their symmetry, their averages over all directions, and the long
waves that they carry.
"""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.contact_table import steps_within
from granphon.balls.lattices import Lattice, as_direction
from granphon.base.arrays import Array
from granphon.base.errors import InstabilityError
from granphon.base.results import read_only
from granphon.dynamics.linalg import cholesky_factor, jacobi_svd

#: pairs of axes in Voigt order, for one, two and three periods
_VOIGT = {
    1: ((0, 0),),
    2: ((0, 0), (1, 1), (0, 1)),
    3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)),
}
#: tolerance of positions, in spacings
_TOLERANCE = 1e-6
#: greatest difference, over the largest constant, between elastic constants that are equal but for
#: rounding
_ROUNDED = 1e-10
#: number of periods of a lattice whose elastic tensor has so many rows
_PERIODS = {1: 1, 3: 2, 6: 3}
#: relative difference of velocities below which they are equal but for rounding
_TIED = 1e-12
#: the same of the parts of polarisations along q
_TIED_ALONG = 1e-9


def voigt_pairs(periods: int) -> tuple[tuple[int, int], ...]:
    """Return the pairs of axes of the strains in Voigt order."""
    return _VOIGT[periods]


def voigt_names(periods: int) -> tuple[str, ...]:
    """Return the names of the strains in Voigt order: xx; xx, yy, xy; or xx, yy, zz, yz, xz, xy."""
    return tuple("xyz"[a] + "xyz"[b] for a, b in _VOIGT[periods])


def take_voigt(c: Array) -> Array:
    """Return c_ijkl (..., p, p, p, p), made symmetric in i, j and in k, l, as (..., n, n) in Voigt
    order.
    """
    c = 0.5 * (c + c.swapaxes(-4, -3))
    c = 0.5 * (c + c.swapaxes(-2, -1))
    i, j = np.transpose(_VOIGT[c.shape[-1]])
    return np.asarray(c[..., i[:, None], j[:, None], i[None, :], j[None, :]])


def name_strain(strains: Array) -> str:
    """Return a plain strain as text with the names of its parts, the largest part being one.

    ``strains`` (n, m) are orthonormal columns xx, yy, xy sqrt 2, ... in Voigt order, which stand
    for all their sums. The text shows the projection, on these sums, of the plain strain that is
    nearest to them.
    """
    pairs = _VOIGT[_PERIODS[len(strains)]]
    nearest = np.argmax(np.round(np.sum(strains**2, axis=1), 6))
    strain = strains @ strains[nearest] * [1.0 if a == b else np.sqrt(2.0) for a, b in pairs]
    names = ", ".join(("" if a == b else "2") + "xyz"[a] + "xyz"[b] for a, b in pairs)
    scaled = np.round(strain / strain[np.argmax(np.abs(strain))], 6) + 0.0
    shown = ", ".join(f"{component:g}" for component in scaled)
    return f"({names}) = ({shown})"


def find_unstable_strains(tensor: Array) -> Array | None:
    """Return the strains of :func:`name_strain` whose modulus under elastic tensors (..., n, n) is
    farthest below zero.

    None if no modulus is. Under static stress a crystal is stable if the symmetric part of its
    coefficients between stress and strain is positive (J. Wang, J. Li, S. Yip, D. Wolf, Phys. Rev.
    B 52, 12627, 1995).
    """
    unit = np.array(
        [1.0 if a == b else np.sqrt(2.0) for a, b in _VOIGT[_PERIODS[tensor.shape[-1]]]]
    )
    values, vectors = np.linalg.eigh(
        0.5 * (tensor + tensor.swapaxes(-1, -2)) * unit[:, None] * unit
    )
    values = values / np.max(np.abs(values), axis=-1, keepdims=True)
    worst = np.unravel_index(np.argmin(values[..., 0]), values.shape[:-1])
    lowest = values[worst]
    if lowest[0] >= -_ROUNDED:  # rounding may leave a modulus of zero below it
        return None
    return np.asarray(vectors[worst][:, lowest <= lowest[0] + _ROUNDED])


def find_stress_part(stress: Array) -> Array:
    """Return what a Cauchy stress (..., p, p) adds to the second derivatives of the energy by
    strain, (..., n, n).

    The sums are the coefficients between stress and strain (F. Birch, Phys. Rev. 71, 809, 1947).
    """
    unit = np.eye(stress.shape[-1])
    return take_voigt(
        np.einsum("...ik,jl->...ijkl", stress, unit) - np.einsum("...ij,kl->...ijkl", stress, unit)
    )


# -- symmetry and averages -------------------------------------------------------------------------


@lru_cache(maxsize=64)
def point_group(lattice: Lattice) -> Array:
    """Return the rotations and reflections (n, p, p) that, with some shift, carry a lattice with
    its balls into itself.
    """
    p = lattice.periods
    cell = lattice.vectors[:, :p]
    balls = lattice.positions
    gram = cell @ cell.T
    # a vector of the cell may be carried onto lattice vectors of the same length
    reach = steps_within(cell, float(np.sqrt(gram.diagonal().max())) + _TOLERANCE) @ cell
    lengths = np.linalg.norm(reach, axis=1)
    images = [reach[np.abs(lengths - np.sqrt(gram[axis, axis])) < _TOLERANCE] for axis in range(p)]
    chosen = np.array([np.stack(rows) for rows in itertools.product(*images)])
    kept = chosen[np.max(np.abs(chosen @ chosen.swapaxes(1, 2) - gram), axis=(1, 2)) < _TOLERANCE]
    group = []
    for turn in (np.linalg.inv(cell) @ kept).swapaxes(1, 2):
        # carries each row of the cell to its image
        turned = np.concatenate([balls[:, :p] @ turn.T, balls[:, p:]], axis=1)
        for shift in balls - turned[0]:
            # along the periods: it carries balls to balls, up to lattice vectors
            apart = (turned + shift)[:, None] - balls
            along = apart[..., :p] @ np.linalg.inv(cell)
            apart[..., :p] = (along - np.rint(along)) @ cell
            if np.all(np.min(np.linalg.norm(apart, axis=-1), axis=1) < _TOLERANCE):
                group.append(turn)
                break
    return read_only(group)


def symmetrise(tensor: Array, lattice: Lattice) -> Array:
    """Return the mean of elastic tensors (..., n, n) in Voigt order over the :func:`point_group` of
    a lattice.
    """
    a, b = np.transpose(voigt_pairs(lattice.periods))
    number = np.empty((lattice.periods,) * 2, int)  # of each pair of axes in Voigt order
    number[a, b] = number[b, a] = np.arange(len(a))
    full = tensor[..., number[:, :, None, None], number[None, None]]
    turns = point_group(lattice)
    mean = np.einsum(
        "gia,gjb,gkc,gld,...abcd->...ijkl", turns, turns, turns, turns, full, optimize=True
    ) / len(turns)
    return np.asarray(mean[..., a[:, None], b[:, None], a[None], b[None]])


@lru_cache(maxsize=64)
def has_cubic_axes(lattice: Lattice) -> bool:
    """Whether the symmetry of a lattice is that of a square or cube with edges along x, y, z, so
    that C11, C12, C44 are all.

    False of a line, and of the triangular lattice, on which an elastic tensor is isotropic.
    """
    n = len(voigt_pairs(lattice.periods))
    if n == 1:
        return False
    each = np.arange(1.0, n * n + 1.0).reshape(n, n) ** 2
    return is_cubic(symmetrise(each + each.T, lattice), _TOLERANCE)


def is_cubic(tensor: Array, tolerance: float = _ROUNDED) -> bool:
    """Whether an elastic tensor (n, n) is that of a square or cube with edges along x, y, z, and
    not isotropic.

    ``tolerance`` is relative to its largest entry.
    """
    n = len(tensor)
    p = _PERIODS[len(tensor)]
    if n == 1:
        return False
    cubic = np.zeros((n, n))
    cubic[:p, :p] = tensor[0, 1]
    cubic[np.arange(p), np.arange(p)] = tensor[0, 0]
    cubic[np.arange(p, n), np.arange(p, n)] = tensor[p, p]
    largest_error = tolerance * np.max(tensor)
    is_isotropic = abs(tensor[0, 0] - tensor[0, 1] - 2.0 * tensor[p, p]) < largest_error
    return bool(np.max(np.abs(tensor - cubic)) < largest_error and not is_isotropic)


def shears(tensor: Array) -> Array:
    """Return the shear moduli of an elastic tensor under an orthonormal set of shears.

    They are (..., 2), of xx - yy and xy, of tensors (..., 3, 3); and (..., 5), of 2zz - xx - yy, xx
    - yy, yz, xz, xy, of tensors (..., 6, 6). A line has none: (..., 0).
    """
    c = tensor
    if c.shape[-1] == 1:
        return np.zeros((*c.shape[:-2], 0))
    across = (c[..., 0, 0] + c[..., 1, 1] - 2.0 * c[..., 0, 1]) / 4.0
    if c.shape[-1] == 3:
        return np.stack([across, c[..., 2, 2]], axis=-1)
    along_z = (c[..., 0, 0] + c[..., 1, 1] + 4.0 * c[..., 2, 2] + 2.0 * c[..., 0, 1]) / 12.0
    along_z = along_z - (c[..., 0, 2] + c[..., 1, 2]) / 3.0
    return np.stack([along_z, across, c[..., 3, 3], c[..., 4, 4], c[..., 5, 5]], axis=-1)


def bulk_and_shear(tensor: Array) -> Array:
    """Return (..., 2) K and G of elastic tensors (..., n, n): averages over all directions (W.
    Voigt, 1889).

    Of a line K is its modulus, and G is zero.
    """
    p = _PERIODS[tensor.shape[-1]]
    bulk = np.sum(tensor[..., :p, :p], axis=(-2, -1)) / p**2
    each = shears(tensor)
    return np.stack([bulk, np.mean(each, axis=-1) if p > 1 else np.zeros_like(bulk)], axis=-1)


def anisotropy(shear: Array) -> Array:
    """Return the anisotropy (...) of cubic elastic constants from :func:`shears` (..., 2) or (...,
    5): 2 C44/(C11 - C12).

    In the plane it is 2 C33/(C11 - C12), of xy over xx - yy; it is 1 of an isotropic tensor (C.
    Zener, Phys. Rev. 71, 846, 1947).
    """
    axial = shear.shape[-1] // 2  # shears along the axes come first
    return np.asarray(np.mean(shear[..., axial:], axis=-1) / np.mean(shear[..., :axial], axis=-1))


def longitudinal_modulus(tensor: Array) -> Array:
    """Return the modulus of longitudinal waves over all directions, (...): K + G in the plane, K +
    4G/3 in space.
    """
    p = _PERIODS[tensor.shape[-1]]
    bulk, shear = np.moveaxis(bulk_and_shear(tensor), -1, 0)
    return np.asarray(bulk + 2.0 * (p - 1) / p * shear)


# -- waves -----------------------------------------------------------------------------------------


def name_waves(axes: tuple[int, ...], periods: int) -> tuple[str, ...]:
    """Return the names of the long waves of balls that move along these ``axes``, on a lattice with
    ``periods``.

    They are "longitudinal", then "transverse", or "transverse_slow" and "transverse_fast"; on a
    plane of balls that also move across it, "out_of_plane" is the last.
    """
    ahead = ("longitudinal",) * (set(range(periods)) <= set(axes))
    across = ("out_of_plane",) * (periods == 2 and 2 in axes)
    count = len(axes) - len(ahead) - len(across)
    transverse = ("transverse_slow", "transverse_fast")[:count]
    if count == 1:
        transverse = ("transverse",)
    return (*ahead, *transverse, *across)


def decompose_waves(along: Array, factor: Array, axes: tuple[int, ...]) -> tuple[Array, Array]:
    """Return velocities (..., n_u) and polarisations (..., n_u, n_u), columns, in the order of
    :func:`name_waves`.

    ``along`` (..., p) are the directions, unit vectors; ``factor`` (..., n, n_u) are factors of the
    acoustic tensors, whose eigenvalues are the squares of velocities.
    """
    values, right = jacobi_svd(factor)
    periods = along.shape[-1]
    if len(axes) == 3:
        along_in_space = np.pad(along, [(0, 0)] * (along.ndim - 1) + [(0, 3 - periods)])
        right = _settle_vectors(along_in_space, values, right)
    names = name_waves(axes, periods)
    toward = np.zeros((*along.shape[:-1], len(axes)))
    for axis in set(range(periods)) & set(axes):
        toward[..., axes.index(axis)] = along[..., axis]
    rank = np.zeros(right.shape[:-2] + right.shape[-1:])
    if names[0] == "longitudinal":
        along_q = np.abs(np.einsum("...i,...ib->...b", toward, right))
        # the fast one of two waves that are equally longitudinal
        tied = along_q >= (1.0 - _TIED_ALONG) * np.max(along_q, axis=-1, keepdims=True)
        ahead = len(axes) - 1 - np.argmax(tied[..., ::-1], axis=-1)
        np.put_along_axis(rank, ahead[..., None], -1.0, -1)
    if names[-1] == "out_of_plane":
        off_plane = np.abs(right[..., axes.index(2), :])
        across = np.argmax(np.where(rank < 0.0, -1.0, off_plane), axis=-1)
        np.put_along_axis(rank, across[..., None], 1.0, -1)
    order = np.argsort(rank, axis=-1, kind="stable")
    return np.take_along_axis(values, order, -1), np.take_along_axis(right, order[..., None, :], -1)


def _settle_vectors(along: Array, values: Array, vectors: Array) -> Array:
    """Return polarisations (..., 3, 3), columns, that rounding does not decide: those of equal
    velocities, and their signs.

    ``along`` (..., 3) is the direction; ``values`` (..., 3) are the velocities, ascending.
    """
    vectors = vectors.copy()
    along = np.broadcast_to(along, vectors.shape[:-1])
    tied = np.diff(values, axis=-1) <= _TIED * values[..., 1:]
    triple = np.all(tied, axis=-1)
    vectors[triple, :, 2] = along[triple]
    for pair, third in ((0, 2), (1, 0)):
        settled = tied[..., pair] & (~triple if pair else True)
        apart = vectors[settled][..., third]
        # the first vector is the direction, or an axis far from the third vector, without the part
        # along the third
        ahead = along[settled] - np.sum(along[settled] * apart, axis=-1, keepdims=True) * apart
        axis = np.eye(3)[np.argmin(np.round(np.abs(apart), 9), axis=-1)]
        aside = axis - np.sum(axis * apart, axis=-1, keepdims=True) * apart
        first = np.where(np.linalg.norm(ahead, axis=-1, keepdims=True) > _TIED_ALONG, ahead, aside)
        first /= np.linalg.norm(first, axis=-1, keepdims=True)
        vectors[settled, :, pair] = first
        vectors[settled, :, pair + 1] = np.cross(apart, first)
    # longitudinal parts point ahead; a vector without one has its largest component above zero
    longitudinal = np.einsum("...i,...ib->...b", along, vectors)
    largest = np.argmax(np.round(np.abs(vectors), 9), axis=-2)
    component = np.take_along_axis(vectors, largest[..., None, :], -2)[..., 0, :]
    decisive = np.where(np.abs(longitudinal) > _TIED_ALONG, longitudinal, component)
    return vectors * np.where(decisive < 0.0, -1.0, 1.0)[..., None, :]


def waves_of_tensor(tensor: Array, direction: ArrayLike) -> tuple[Array, Array]:
    """Find the long waves of elastic tensors (..., n, n) along ``direction`` (p,) or (n, p),
    without prestress.

    Returns
    -------
    velocities : (..., p), or (..., n, p), in the order of
        :func:`~granphon.dynamics.elasticity.name_waves`, in the root of the tensor's unit: over the
        root of the density they are velocities.
    polarisations : (..., p, p), or (..., n, p, p), unit vectors as columns.

    Raises :class:`~granphon.base.errors.InstabilityError` if a tensor is not positive.
    """
    periods = _PERIODS[tensor.shape[-1]]
    along = as_direction(direction, periods)
    pairs = voigt_pairs(periods)
    # strains of waves with a unit displacement along each axis
    strain = np.zeros((*along.shape, len(pairs)))
    for n, (a, b) in enumerate(pairs):
        strain[..., a, n] += along[..., b]
        if a != b:
            strain[..., b, n] += along[..., a]
    stiffness = np.asarray(tensor)[(..., *(None,) * (along.ndim - 1), slice(None), slice(None))]
    try:
        factor = cholesky_factor(strain @ stiffness @ strain.swapaxes(-1, -2))
    except np.linalg.LinAlgError:
        raise InstabilityError(
            "a squared sound velocity is negative",
            "The elastic tensor is not positive",
            "Raise the load",
        ) from None
    return decompose_waves(along, factor, tuple(range(periods)))
