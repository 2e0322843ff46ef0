"""Elastic tensors in Voigt order: their symmetry, their averages over all directions, and the long
waves that they carry.
"""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.lattices import Lattice, as_direction
from granphon.balls.neighbours import steps_within
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
#: distance, in spacings of the lattice, up to which two positions are one; also the relative error
#: of the numbers by which a symmetry of the lattice is recognised
_TOLERANCE = 1e-6
#: greatest difference, over the largest constant, between elastic constants that are equal but for
#: rounding
_MODULUS_ROUNDING = 1e-10
#: number of periods of a lattice, by the number of rows of its elastic tensor
_PERIODS = {1: 1, 3: 2, 6: 3}
#: number of decimals to which components are compared, so that rounding does not decide
_DIGITS = 9
#: relative difference of velocities up to which they are equal but for rounding
_VELOCITY_ROUNDING = 1e-12
#: difference of the components of polarisations along q up to which they are equal
_COMPONENT_ROUNDING = 1e-9


def voigt_pairs(periods: int) -> tuple[tuple[int, int], ...]:
    """Return the pairs of axes (0 for x, 1 for y, 2 for z) of the strains in Voigt order, for 1, 2
    or 3 ``periods``.
    """
    return _VOIGT[periods]


def voigt_names(periods: int) -> tuple[str, ...]:
    """Return the names of the strains in Voigt order, for 1, 2 or 3 ``periods``: xx; xx, yy, xy; or
    xx, yy, zz, yz, xz, xy.
    """
    return tuple("xyz"[a] + "xyz"[b] for a, b in _VOIGT[periods])


def take_voigt(c: Array) -> Array:
    """Return tensors ``c`` (..., p, p, p, p) of components c_ijkl as matrices (..., n, n) in Voigt
    order; components that differ by an exchange of i with j, or of k with l, are averaged.
    """
    symmetric_ij = 0.5 * (c + c.swapaxes(-4, -3))
    symmetric_tensor = 0.5 * (symmetric_ij + symmetric_ij.swapaxes(-2, -1))
    i, j = np.transpose(_VOIGT[c.shape[-1]])
    return np.asarray(symmetric_tensor[..., i[:, None], j[:, None], i[None, :], j[None, :]])


def name_strain(strains: Array) -> str:
    """Return the text of one strain of a space of strains, with the names of its components, of
    which the largest is one: "(xx, yy, 2xy) = (1, -1, 0)".

    ``strains`` (n, m) are orthonormal columns xx, yy, xy sqrt 2, ... in Voigt order, which span the
    space. Among the strains of a single component the one nearest to the space is chosen; the text
    is that of its projection on the space.
    """
    pairs = _VOIGT[_PERIODS[len(strains)]]
    # six decimals, so that rounding does not decide between components that are equally near
    nearest_component = np.argmax(np.round(np.sum(strains**2, axis=1), 6))
    # the components xy sqrt 2 become 2xy
    factors = [1.0 if a == b else np.sqrt(2.0) for a, b in pairs]
    strain = strains @ strains[nearest_component] * factors
    names = [("" if a == b else "2") + "xyz"[a] + "xyz"[b] for a, b in pairs]
    scaled_strain = np.round(strain / strain[np.argmax(np.abs(strain))], 6) + 0.0  # no minus zero
    components = [f"{component:g}" for component in scaled_strain]
    return f"({', '.join(names)}) = ({', '.join(components)})"


def find_unstable_strains(tensor: Array) -> Array | None:
    """Return the strains whose modulus is most negative, as orthonormal columns (n, m) for
    :func:`name_strain`; None if no modulus is below zero by more than rounding.

    ``tensor`` are elastic tensors (..., n, n). The moduli are the eigenvalues of their symmetric
    parts, each over the largest size of a modulus of the same tensor. The m strains all belong to
    the tensor with the lowest of these ratios.

    Under static stress a crystal is stable if the symmetric part of its coefficients between stress
    and strain is positive (J. Wang, J. Li, S. Yip, D. Wolf, Phys. Rev. B 52, 12627, 1995).
    """
    pairs = _VOIGT[_PERIODS[tensor.shape[-1]]]
    # strains xy become xy sqrt 2, so that the squares of the n components add up to e_ij e_ij
    factors = np.array([1.0 if a == b else np.sqrt(2.0) for a, b in pairs])
    symmetric_tensor = 0.5 * (tensor + tensor.swapaxes(-1, -2)) * factors[:, None] * factors
    moduli, strains = np.linalg.eigh(symmetric_tensor)
    largest_size = np.max(np.abs(moduli), axis=-1, keepdims=True)
    relative_moduli = np.divide(
        moduli, largest_size, out=np.zeros_like(moduli), where=largest_size > 0.0
    )
    lowest_place = np.unravel_index(np.argmin(relative_moduli[..., 0]), relative_moduli.shape[:-1])
    ratios = relative_moduli[lowest_place]
    if ratios[0] >= -_MODULUS_ROUNDING:  # rounding may make a modulus of zero negative
        return None
    is_lowest = ratios <= ratios[0] + _MODULUS_ROUNDING
    return np.asarray(strains[lowest_place][:, is_lowest])


def find_stress_part(stress: Array) -> Array:
    """Return the contribution (..., n, n) of a Cauchy ``stress`` (..., p, p) to the coefficients
    between stress and strain, in Voigt order and in the unit of the stress.

    These coefficients are the second derivatives of the energy per volume with respect to the
    displacement gradient, in Voigt order (:func:`take_voigt`), plus this contribution (F. Birch,
    Phys. Rev. 71, 809, 1947).
    """
    unit = np.eye(stress.shape[-1])
    turning = np.einsum("...ik,jl->...ijkl", stress, unit)  # stress_ik delta_jl
    stretching = np.einsum("...ij,kl->...ijkl", stress, unit)  # stress_ij delta_kl
    return take_voigt(turning - stretching)


# -- symmetry and averages -------------------------------------------------------------------------


@lru_cache(maxsize=64)
def point_group(lattice: Lattice) -> Array:
    """Return the rotations and reflections (n, p, p) that, each with some shift, map a ``lattice``
    with its balls onto itself.
    """
    p = lattice.periods
    cell = lattice.vectors[:, :p]
    balls = lattice.positions
    gram = cell @ cell.T
    # the images of each vector of the cell are lattice vectors of the same length
    longest_length = float(np.sqrt(gram.diagonal().max()))
    vectors = steps_within(cell, longest_length + _TOLERANCE) @ cell
    lengths = np.linalg.norm(vectors, axis=1)
    images = []
    for axis in range(p):
        has_length = np.abs(lengths - np.sqrt(gram[axis, axis])) < _TOLERANCE
        images.append(vectors[has_length])
    # all combinations of these images, (m, p, p); those with the angles of the cell are cells that
    # have been turned or reflected
    cells = np.array([np.stack(rows) for rows in itertools.product(*images)])
    gram_error = np.max(np.abs(cells @ cells.swapaxes(1, 2) - gram), axis=(1, 2))
    turned_cells = cells[gram_error < _TOLERANCE]
    turns = (np.linalg.inv(cell) @ turned_cells).swapaxes(1, 2)
    return read_only([turn for turn in turns if _maps_balls(turn, cell, balls)])


def _maps_balls(turn: Array, cell: Array, balls: Array) -> bool:
    """Return whether a rotation or reflection ``turn`` (p, p), with some shift, maps all ``balls``
    (n, d) onto balls, up to vectors of the ``cell`` (p, p). Components of the balls across the
    periods are not turned.
    """
    p = len(cell)
    turned_balls = np.concatenate([balls[:, :p] @ turn.T, balls[:, p:]], axis=1)
    for shift in balls - turned_balls[0]:  # each shift maps the first ball onto a ball
        offset = (turned_balls + shift)[:, None] - balls
        steps = offset[..., :p] @ np.linalg.inv(cell)
        offset[..., :p] = (steps - np.rint(steps)) @ cell
        nearest_distances = np.min(np.linalg.norm(offset, axis=-1), axis=1)
        if np.all(nearest_distances < _TOLERANCE):
            return True
    return False


def symmetrise(tensor: Array, lattice: Lattice) -> Array:
    """Return elastic tensors in Voigt order, ``tensor`` (..., n, n), averaged over the operations
    of the :func:`point_group` of a ``lattice``: (..., n, n).
    """
    p = lattice.periods
    a, b = np.transpose(voigt_pairs(p))
    number_of_pair = np.empty((p, p), int)  # the number, in Voigt order, of each pair of axes
    number_of_pair[a, b] = np.arange(len(a))
    number_of_pair[b, a] = np.arange(len(a))
    four_axes = tensor[..., number_of_pair[:, :, None, None], number_of_pair[None, None]]
    turns = point_group(lattice)
    # the sum over the operations g of the tensor whose four axes a, b, c, d are turned by g
    total = np.einsum(
        "gia,gjb,gkc,gld,...abcd->...ijkl", turns, turns, turns, turns, four_axes, optimize=True
    )
    mean_tensor = total / len(turns)
    return np.asarray(mean_tensor[..., a[:, None], b[:, None], a[None], b[None]])


@lru_cache(maxsize=64)
def has_cubic_axes(lattice: Lattice) -> bool:
    """Return whether the symmetry of a ``lattice`` is that of a square or cube with edges along the
    axes, so that there are three elastic constants: C11, C12, and C33 in the plane or C44 in space.

    False for a line, and for the triangular lattice, on which an elastic tensor is isotropic.
    """
    n = len(voigt_pairs(lattice.periods))
    if n == 1:
        return False
    # a symmetric matrix of different constants, whose mean has no symmetry but that of the lattice
    constants = np.arange(1.0, n * n + 1.0).reshape(n, n) ** 2
    return is_cubic(symmetrise(constants + constants.T, lattice), _TOLERANCE)


def is_cubic(tensor: Array, tolerance: float = _MODULUS_ROUNDING) -> bool:
    """Return whether an elastic tensor (n, n) is that of a square or cube with edges along x, y, z,
    and not isotropic; False on a line.

    Each entry may differ from that of such a tensor by less than the ``tolerance`` times the
    largest absolute entry. The tensor counts as isotropic if C11 - C12 differs from twice the shear
    constant, C33 in the plane and C44 in space, by less than the same number.
    """
    n = len(tensor)
    if n == 1:
        return False
    p = _PERIODS[n]
    cubic_tensor = np.zeros((n, n))
    cubic_tensor[:p, :p] = tensor[0, 1]
    cubic_tensor[np.arange(p), np.arange(p)] = tensor[0, 0]
    cubic_tensor[np.arange(p, n), np.arange(p, n)] = tensor[p, p]
    largest_error = tolerance * np.max(np.abs(tensor))
    is_isotropic = abs(tensor[0, 0] - tensor[0, 1] - 2.0 * tensor[p, p]) < largest_error
    return bool(np.max(np.abs(tensor - cubic_tensor)) < largest_error and not is_isotropic)


def shears(tensor: Array) -> Array:
    """Return the shear moduli of an elastic tensor under an orthonormal set of shears.

    In the plane, for tensors (..., 3, 3), they are (..., 2): of the strains xx - yy and xy. In
    space, for tensors (..., 6, 6), they are (..., 5): of 2zz - xx - yy, xx - yy, yz, xz and xy. On
    a line, for tensors (..., 1, 1), there is none: (..., 0).
    """
    c = tensor
    if c.shape[-1] == 1:
        return np.zeros((*c.shape[:-2], 0))
    xx_less_yy = (c[..., 0, 0] + c[..., 1, 1] - 2.0 * c[..., 0, 1]) / 4.0
    if c.shape[-1] == 3:
        return np.stack([xx_less_yy, c[..., 2, 2]], axis=-1)
    # the strain s = 2zz - xx - yy has s.s = 6, and its shear modulus is s C s/(2 s.s)
    without_z_coupling = (
        c[..., 0, 0] + c[..., 1, 1] + 4.0 * c[..., 2, 2] + 2.0 * c[..., 0, 1]
    ) / 12.0
    along_z = without_z_coupling - (c[..., 0, 2] + c[..., 1, 2]) / 3.0
    return np.stack([along_z, xx_less_yy, c[..., 3, 3], c[..., 4, 4], c[..., 5, 5]], axis=-1)


def bulk_and_shear(tensor: Array) -> Array:
    """Return the bulk modulus K and the shear modulus G (..., 2) of elastic tensors, ``tensor``
    (..., n, n), averaged over all directions (W. Voigt, 1889). On a line K is the only modulus, and
    G is zero.
    """
    p = _PERIODS[tensor.shape[-1]]
    bulk = np.sum(tensor[..., :p, :p], axis=(-2, -1)) / p**2
    shear = np.zeros_like(bulk)
    if p > 1:
        shear = np.mean(shears(tensor), axis=-1)
    return np.stack([bulk, shear], axis=-1)


def anisotropy(shear: Array) -> Array:
    """Return the anisotropy (...) of cubic elastic constants, 2 C44/(C11 - C12) in space and 2
    C33/(C11 - C12) in the plane, from their shear moduli ``shear`` (..., 5) or (..., 2), as
    :func:`shears` returns them.

    The anisotropy is 1 for an isotropic tensor (C. Zener, Phys. Rev. 71, 846, 1947). C11 and C12
    must differ.
    """
    # shears such as xx - yy come first, then those such as xy
    n_axial = shear.shape[-1] // 2
    axial_mean = np.mean(shear[..., :n_axial], axis=-1)
    diagonal_mean = np.mean(shear[..., n_axial:], axis=-1)
    return np.asarray(diagonal_mean / axial_mean)


def longitudinal_modulus(tensor: Array) -> Array:
    """Return the modulus of longitudinal waves (...) of elastic tensors, ``tensor`` (..., n, n),
    averaged over all directions: K + G in the plane, K + 4G/3 in space, K on a line.
    """
    p = _PERIODS[tensor.shape[-1]]
    bulk, shear = np.moveaxis(bulk_and_shear(tensor), -1, 0)
    return np.asarray(bulk + 2.0 * (p - 1) / p * shear)


# -- waves -----------------------------------------------------------------------------------------


def name_waves(axes: tuple[int, ...], periods: int) -> tuple[str, ...]:
    """Return the names of the long waves of balls that move along ``axes`` (0 for x, ...), on a
    lattice with this number of ``periods``.

    The first is "longitudinal", if balls move along all periods. Then follows "transverse", or
    "transverse_slow" and "transverse_fast", for the other displacements. If balls in a plane leave
    it, "out_of_plane" is the last.
    """
    moves_along_periods = set(range(periods)) <= set(axes)
    longitudinal_names = ("longitudinal",) if moves_along_periods else ()
    leaves_plane = periods == 2 and 2 in axes
    out_of_plane_names = ("out_of_plane",) if leaves_plane else ()
    count = len(axes) - len(longitudinal_names) - len(out_of_plane_names)
    transverse_names = ("transverse_slow", "transverse_fast")[:count]
    if count == 1:
        transverse_names = ("transverse",)
    return (*longitudinal_names, *transverse_names, *out_of_plane_names)


def decompose_waves(along: Array, factor: Array, axes: tuple[int, ...]) -> tuple[Array, Array]:
    """Return the velocities (..., n_u) of long waves, and their polarisations (..., n_u, n_u) as
    columns, in the order of :func:`name_waves`.

    ``along`` (..., p) are the directions, unit vectors. ``factor`` (..., n, n_u) are factors F of
    the acoustic tensors F^T F, whose eigenvalues are the squares of the velocities. ``axes`` are
    the n_u axes along which balls move. The longitudinal wave is that with the largest displacement
    along the direction, and the wave out of the plane that with the largest across the plane.
    """
    unordered_velocities, unordered_vectors = jacobi_svd(factor)
    periods = along.shape[-1]
    if len(axes) == 3:
        along_in_space = np.pad(along, [(0, 0)] * (along.ndim - 1) + [(0, 3 - periods)])
        unordered_vectors = _settle_vectors(along_in_space, unordered_velocities, unordered_vectors)
    names = name_waves(axes, periods)
    # the direction in components of the motions
    direction = np.zeros((*along.shape[:-1], len(axes)))
    for axis in set(range(periods)) & set(axes):
        direction[..., axes.index(axis)] = along[..., axis]
    rank = _rank_waves(names, axes, direction, unordered_vectors)
    order = np.argsort(rank, axis=-1, kind="stable")
    velocities = np.take_along_axis(unordered_velocities, order, -1)
    polarisations = np.take_along_axis(unordered_vectors, order[..., None, :], -1)
    return velocities, polarisations


def _rank_waves(
    names: tuple[str, ...], axes: tuple[int, ...], direction: Array, vectors: Array
) -> Array:
    """Return numbers (..., n_u) by which waves are sorted: -1 for the longitudinal wave, 1 for the
    wave out of the plane, each if it is among the ``names``, and 0 for all others.

    ``direction`` (..., n_u) is given in components of the motions along ``axes``, and ``vectors``
    (..., n_u, n_u) are the polarisations, as columns, of waves of ascending velocity.
    """
    rank = np.zeros(vectors.shape[:-2] + vectors.shape[-1:])
    if names[0] == "longitudinal":
        part_along = np.abs(np.einsum("...i,...ib->...b", direction, vectors))
        largest_part = np.max(part_along, axis=-1, keepdims=True)
        # of waves that are equally longitudinal, the last is chosen, which is the fastest
        is_most_longitudinal = part_along >= (1.0 - _COMPONENT_ROUNDING) * largest_part
        longitudinal_number = len(axes) - 1 - np.argmax(is_most_longitudinal[..., ::-1], axis=-1)
        np.put_along_axis(rank, longitudinal_number[..., None], -1.0, -1)
    if names[-1] == "out_of_plane":
        part_across = np.abs(vectors[..., axes.index(2), :])
        # the longitudinal wave is not chosen a second time
        out_of_plane_number = np.argmax(np.where(rank < 0.0, -1.0, part_across), axis=-1)
        np.put_along_axis(rank, out_of_plane_number[..., None], 1.0, -1)
    return rank


def _settle_vectors(along: Array, velocities: Array, vectors: Array) -> Array:
    """Return polarisations (..., 3, 3), columns, that do not depend on rounding: where velocities
    are equal, ``vectors`` (..., 3, 3) are turned, and all signs are fixed.

    ``along`` (..., 3) is the direction; ``velocities`` (..., 3) are ascending. Of two waves of
    equal velocity the first is polarised as nearly along the direction as can be. Of three waves of
    equal velocity the last is polarised along the direction.
    """
    vectors = vectors.copy()
    along = np.broadcast_to(along, vectors.shape[:-1])
    is_next_equal = np.diff(velocities, axis=-1) <= _VELOCITY_ROUNDING * velocities[..., 1:]
    are_all_equal = np.all(is_next_equal, axis=-1)
    vectors[are_all_equal, :, 2] = along[are_all_equal]
    has_slow_pair = is_next_equal[..., 0]
    slow_pair = _choose_pair(along[has_slow_pair], vectors[has_slow_pair][..., 2])
    vectors[has_slow_pair, :, 0], vectors[has_slow_pair, :, 1] = slow_pair
    has_fast_pair = is_next_equal[..., 1] & ~are_all_equal
    fast_pair = _choose_pair(along[has_fast_pair], vectors[has_fast_pair][..., 0])
    vectors[has_fast_pair, :, 1], vectors[has_fast_pair, :, 2] = fast_pair
    # a vector has a positive component along the direction, or if that is zero a positive largest
    # component
    component_along = np.einsum("...i,...ib->...b", along, vectors)
    largest_axis = np.argmax(np.round(np.abs(vectors), _DIGITS), axis=-2)
    largest_component = np.take_along_axis(vectors, largest_axis[..., None, :], -2)[..., 0, :]
    deciding_component = np.where(
        np.abs(component_along) > _COMPONENT_ROUNDING, component_along, largest_component
    )
    return vectors * np.where(deciding_component < 0.0, -1.0, 1.0)[..., None, :]


def _choose_pair(along: Array, third_vector: Array) -> tuple[Array, Array]:
    """Return two unit vectors (n, 3) perpendicular to each other and to ``third_vector`` (n, 3);
    the first is as near to the direction ``along`` (n, 3) as can be.

    Where the direction is parallel to the third vector, the first is as near as can be to the axis
    x, y or z that is farthest from the third.
    """
    part_of_direction = along - np.sum(along * third_vector, axis=-1, keepdims=True) * third_vector
    axis = np.eye(3)[np.argmin(np.round(np.abs(third_vector), _DIGITS), axis=-1)]
    part_of_axis = axis - np.sum(axis * third_vector, axis=-1, keepdims=True) * third_vector
    has_part = np.linalg.norm(part_of_direction, axis=-1, keepdims=True) > _COMPONENT_ROUNDING
    first_vector = np.where(has_part, part_of_direction, part_of_axis)
    first_vector /= np.linalg.norm(first_vector, axis=-1, keepdims=True)
    return first_vector, np.cross(third_vector, first_vector)


def waves_of_tensor(tensor: Array, direction: ArrayLike) -> tuple[Array, Array]:
    """Return the long waves of elastic tensors (..., v, v), in Voigt order, along a ``direction``
    (p,), or (n, p), of any length, without prestress.

    Returns
    -------
    velocities : (..., p), or (..., n, p), in the order of
        :func:`~granphon.dynamics.elasticity.name_waves`, times the square root of the density, in
        the square root of the tensor's unit.
    polarisations : (..., p, p), or (..., n, p, p), unit vectors as columns.

    Raises
    ------
    InputError : a direction of another shape, not finite or of length zero.
    InstabilityError : a tensor has a negative squared velocity along the direction.
    """
    stiffness = np.asarray(tensor)
    periods = _PERIODS[stiffness.shape[-1]]
    along = as_direction(direction, periods)
    pairs = voigt_pairs(periods)
    # (..., p, v), in Voigt order: the strain, over i |q|, of a wave with a unit displacement along
    # each axis
    strain = np.zeros((*along.shape, len(pairs)))
    for number, (a, b) in enumerate(pairs):
        strain[..., a, number] += along[..., b]
        if a != b:
            strain[..., b, number] += along[..., a]
    # tensors get an axis for the n directions
    if along.ndim > 1:
        stiffness = stiffness[..., None, :, :]
    try:
        factor = cholesky_factor(strain @ stiffness @ strain.swapaxes(-1, -2))
    except np.linalg.LinAlgError:
        raise InstabilityError(
            "a squared sound velocity is negative",
            "The elastic tensor is not positive",
            "Raise the load",
        ) from None
    return decompose_waves(along, factor, tuple(range(periods)))
