"""The lattice of contacts in a state, its elastic tensor and its long waves, in SI."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.packing import Packing
from granphon.dynamics.modes import ContactLattice

if TYPE_CHECKING:
    from granphon.media.state import ContactState

__all__ = [
    "contact_lattice", "ideal_lattice", "is_isotropic", "lattice_scales", "lattice_tensor", "lattice_waves",
    "over_directions", "prestress", "sample_scales", "velocities_of_moduli", "velocity_scale",
]  # fmt: skip

Array = NDArray[np.float64]
#: two elastic constants that should be equal differ by no more than this part
_ISOTROPIC = 1e-10


def ideal_lattice(packing: Packing) -> ContactLattice:
    """The lattice of contacts in the paper's limit, the same under every load; in reduced units."""
    return ContactLattice.of(packing.structure, packing.mindlin_ratio)


def contact_lattice(state: ContactState) -> ContactLattice:
    """The lattice of contacts in a state, in reduced units.

    With finite overlap, where the state must be at one load: spacing a, lever arm a/2, prestress f/a.
    """
    if not state.finite_overlap:
        return ideal_lattice(state.packing)
    _ = state.scales  # one load only
    packing, spacing = state.packing, 1.0 - state.relative_overlap
    return ContactLattice.of(packing.structure, packing.mindlin_ratio, spacing, float(prestress(state)))


def prestress(state: ContactState) -> Array:
    """f/(k a) of each load."""
    spacing = state.packing.diameter * (1.0 - state.relative_overlap)
    return np.asarray(state.force / state.normal_stiffness / spacing)


def velocity_scale(state: ContactState) -> Array:
    """d (k/M)^1/2 of each load, m/s."""
    return np.asarray(state.packing.diameter * (np.sqrt(state.normal_stiffness) / np.sqrt(state.packing.mass)))


def sample_scales(state: ContactState, direction: ArrayLike, names: Sequence[str]) -> list[Array]:
    """d (k/M)^1/2 of each branch, (..., directions), m/s, with which the ideal lattice has the long waves of the state."""
    found = state.long_waves(direction)
    ideal, _ = ideal_lattice(state.packing).sound_velocities(direction)
    return [np.asarray(found[..., i] / ideal[..., i]) for i in (("longitudinal", "transverse").index(n) for n in names)]


def is_isotropic(lattice: ContactLattice) -> bool:
    """Whether the elastic tensor is the same in all directions."""
    c = lattice.elastic_tensor()
    off = [c[0, 0] - c[1, 1], c[0, 2], c[1, 2], c[2, 2] - (c[0, 0] - c[0, 1]) / 2.0]
    return bool(np.max(np.abs(off)) <= _ISOTROPIC * c[0, 0])


def lattice_tensor(state: ContactState) -> Array:
    """(..., 3, 3) Pa, Voigt order xx, yy, xy, of the lattice of contacts, one diameter thick."""
    terms = prestress(state) if state.finite_overlap else np.zeros(state.shape)
    scale = np.asarray(state.normal_stiffness / state.packing.diameter)
    return scale[..., None, None] * ideal_lattice(state.packing).elastic_tensor(terms)


def lattice_waves(state: ContactState, direction: ArrayLike) -> Array:
    """(..., 2) longitudinal and transverse velocity of the lattice of contacts, m/s; (..., n, 2) for directions (n, 2)."""
    lattice, scale = ideal_lattice(state.packing), velocity_scale(state)
    if not state.finite_overlap:
        velocities, _ = lattice.sound_velocities(direction)
        return _add_axes(scale, direction) * velocities
    # every length scales with the spacing; the prestress alone enters the shape of the tensor
    velocities, _ = lattice.sound_velocities(direction, prestress(state))
    return _add_axes(scale * (1.0 - np.asarray(state.relative_overlap)), direction) * velocities


def lattice_scales(state: ContactState, direction: ArrayLike) -> Array:
    """d (k/M)^1/2 of each load and direction, (...) or (..., n), m/s."""
    scale = velocity_scale(state)
    return np.broadcast_to(_add_axes(scale, direction)[..., 0], scale.shape + np.shape(direction)[:-1])


def _add_axes(values: Array, direction: ArrayLike) -> Array:
    """Values of each load, with an axis of length one for each of ``direction``: directions, if many, and branches."""
    return values.reshape(*values.shape, *(1,) * np.ndim(direction))


def over_directions(velocities: Array, along: Array) -> Array:
    """Isotropic values (..., 2), the same in each direction: (..., n, 2) for directions (n, 2)."""
    if along.ndim == 1:
        return velocities
    return np.repeat(velocities[..., None, :], len(along), axis=-2)


def velocities_of_moduli(moduli: Array, density: ArrayLike) -> Array:
    """(..., 2) v_L and v_T, m/s, of K and G (equation 16)."""
    bulk, shear = np.moveaxis(moduli, -1, 0)
    return np.asarray(np.sqrt(np.stack([bulk + shear, shear], axis=-1) / np.asarray(density)[..., None]))
