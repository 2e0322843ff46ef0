"""The lattice of contacts in a state, in reduced units, and its elastic tensor and long waves, in SI."""

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
    "contact_lattice", "ideal_lattice", "lattice_scales", "lattice_tensor", "lattice_waves",
    "over_directions", "prestress", "sample_scales", "compute_velocities", "velocity_scale",
]  # fmt: skip

Array = NDArray[np.float64]


def ideal_lattice(packing: Packing) -> ContactLattice:
    """Return the lattice of contacts in the paper's limit, in reduced units, where it is the same under every load."""
    return ContactLattice.of(packing.structure, packing.mindlin_ratio)


def contact_lattice(state: ContactState) -> ContactLattice:
    """Return the lattice of contacts in a state, in reduced units.

    With finite overlap it has the spacing a, the lever arm a/2 and the prestress f/a; the state must then be at one load
    (:class:`~granphon.base.errors.InputError`).
    """
    if not state.finite_overlap:
        return ideal_lattice(state.packing)
    _ = state.scales  # raises InputError for several loads
    packing, spacing = state.packing, 1.0 - state.relative_overlap
    return ContactLattice.of(packing.structure, packing.mindlin_ratio, spacing, float(prestress(state)))


def prestress(state: ContactState) -> Array:
    """Return the prestress f/(k a) at each load, without a unit."""
    spacing = state.packing.diameter * (1.0 - state.relative_overlap)
    return np.asarray(state.force / state.normal_stiffness / spacing)


def velocity_scale(state: ContactState) -> Array:
    """Return the unit of velocity d (k/M)^1/2 at each load, m/s."""
    return np.asarray(state.packing.diameter * (np.sqrt(state.normal_stiffness) / np.sqrt(state.packing.mass)))


def sample_scales(state: ContactState, direction: ArrayLike, names: Sequence[str]) -> list[Array]:
    """Return, for each named branch, the velocity (m/s) by which to multiply the reduced velocities of the ideal lattice.

    It takes the place of d (k/M)^1/2: the long waves of the branch then have the velocity that they have in the state. Each
    array has the shape of the load followed by that of the directions.
    """
    found = state.long_waves(direction)
    ideal, _ = ideal_lattice(state.packing).sound_velocities(direction)
    return [np.asarray(found[..., i] / ideal[..., i]) for i in (("longitudinal", "transverse").index(n) for n in names)]


def lattice_tensor(state: ContactState) -> Array:
    """Return the elastic tensor of the lattice of contacts, (..., 3, 3), Pa, Voigt order xx, yy, xy, one diameter thick."""
    terms = prestress(state) if state.finite_overlap else None
    scale = np.asarray(state.normal_stiffness / state.packing.diameter)
    return scale[..., None, None] * ideal_lattice(state.packing).elastic_tensor(terms)


def lattice_waves(state: ContactState, direction: ArrayLike) -> Array:
    """Return longitudinal and transverse velocity of the lattice of contacts, m/s.

    The shape is (..., 2), or (..., n, 2) for directions (n, 2).
    """
    lattice, scale = ideal_lattice(state.packing), velocity_scale(state)
    if not state.finite_overlap:
        velocities, _ = lattice.sound_velocities(direction)
        return _add_axes(scale, direction) * velocities
    # all lengths scale with the spacing; of the load, only the prestress changes the ratios of elastic constants
    velocities, _ = lattice.sound_velocities(direction, prestress(state))
    return _add_axes(scale * (1.0 - np.asarray(state.relative_overlap)), direction) * velocities


def lattice_scales(state: ContactState, direction: ArrayLike) -> Array:
    """Return the unit of velocity d (k/M)^1/2 for each load and direction, (...) or (..., n), m/s."""
    scale = velocity_scale(state)
    return np.broadcast_to(_add_axes(scale, direction)[..., 0], scale.shape + np.shape(direction)[:-1])


def _add_axes(values: Array, direction: ArrayLike) -> Array:
    """Append axes of length one to ``values`` of each load: for the directions, if there are many, and for the branches."""
    return values.reshape(*values.shape, *(1,) * np.ndim(direction))


def over_directions(velocities: Array, along: Array) -> Array:
    """Repeat isotropic values (..., 2) for each direction: (..., n, 2) for directions (n, 2)."""
    if along.ndim == 1:
        return velocities
    return np.repeat(velocities[..., None, :], len(along), axis=-2)


def compute_velocities(moduli: Array, density: ArrayLike) -> Array:
    """Return v_L and v_T, (..., 2), m/s, from K and G, (..., 2), Pa, and the density, kg/m^3 (equation 16)."""
    bulk, shear = np.moveaxis(moduli, -1, 0)
    return np.asarray(np.sqrt(np.stack([bulk + shear, shear], axis=-1) / np.asarray(density)[..., None]))
