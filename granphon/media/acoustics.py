"""The lattice of contacts in a state, in reduced units, and its elastic tensor and long waves, in SI."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.packing import MINDLIN, Packing
from granphon.dynamics.compatibility import GYRATION
from granphon.dynamics.modes import ContactLattice

if TYPE_CHECKING:
    from granphon.media.state import ContactState

__all__ = [
    "compute_velocities", "contact_lattice", "find_overlap_of_equal_balls", "has_one_lattice", "ideal_lattice",
    "lattice_scales", "lattice_tensor", "lattice_waves", "lattice_without_overlap", "over_directions", "prestress",
    "sample_scales", "velocity_scale",
]  # fmt: skip

Array = NDArray[np.float64]


def ideal_lattice(packing: Packing, torsion: float | None = None, bending: float | None = None) -> ContactLattice:
    """Return the lattice of contacts in the paper's limit, in reduced units.

    It is the same under every load, except for the torsion of a Hertz contact, which is left out. ``torsion`` and
    ``bending`` replace those of the packing, over k d^2.
    """
    twist = (0.0 if packing.torsion == MINDLIN else float(packing.torsion)) if torsion is None else torsion
    return ContactLattice.of(
        packing.structure, packing.mindlin_ratio, torsion=twist,
        bending=packing.bending if bending is None else bending, motions=packing.ball_motions,
    )  # fmt: skip


def lattice_without_overlap(state: ContactState) -> ContactLattice:
    """Return the lattice of contacts, in reduced units, without terms of finite overlap.

    The torsion of a Hertz contact is that at the largest load. What does not depend on the load is read from this lattice:
    the names of waves, mechanisms, isotropy.
    """
    return state.once(_make_lattice_without_overlap)


def _make_lattice_without_overlap(state: ContactState) -> ContactLattice:
    hertz = state.packing.torsion == MINDLIN
    return ideal_lattice(state.packing, float(np.max(state.torsion)) if hertz else None)


def has_one_lattice(state: ContactState) -> bool:
    """Whether the lattice of contacts, in reduced units, is the same at all loads of a state."""
    return state.is_single or not (state.finite_overlap or state.packing.torsion == MINDLIN)


def contact_lattice(state: ContactState) -> ContactLattice:
    """Return the lattice of contacts in a state, in reduced units.

    With finite overlap it has the spacing a, the lever arm a/2 and the prestress f/a; the state must then be at one load
    (:class:`~granphon.base.errors.InputError`).
    """
    packing = state.packing
    if not state.finite_overlap and packing.torsion != MINDLIN:
        return ideal_lattice(packing)
    _ = state.scales  # raises InputError for several loads
    spacing, load = (1.0 - state.relative_overlap, float(prestress(state))) if state.finite_overlap else (1.0, 0.0)
    return ContactLattice.of(
        packing.structure, packing.mindlin_ratio, spacing, load,
        torsion=float(state.torsion), bending=packing.bending, motions=packing.ball_motions,
    )  # fmt: skip


def find_overlap_of_equal_balls(state: ContactState) -> Array:
    """Return the overlap of equal balls at the mean force, m: where balls differ the mean overlap may be negative."""
    return np.asarray(state.packing.law.overlap(state.force))


def prestress(state: ContactState) -> Array:
    """Return the prestress f/(k a) at each load, without a unit."""
    spacing = state.packing.diameter * (1.0 - state.relative_overlap)
    return np.asarray(state.force / state.normal_stiffness / spacing)


def velocity_scale(state: ContactState) -> Array:
    """Return the unit of velocity d (k/M)^1/2 at each load, m/s."""
    return np.asarray(state.packing.diameter * (np.sqrt(state.normal_stiffness) / np.sqrt(state.packing.mass)))


def modulus_scale(state: ContactState) -> Array:
    """Return the unit of the elastic tensor at each load: k/d, Pa, in the plane and in space; k d, N, on a line.

    With finite overlap the spacing a stands in place of d in space and on a line; the layer of a plane stays d thick.
    """
    d, k = state.packing.diameter, state.normal_stiffness
    spacing = d * (1.0 - np.asarray(state.relative_overlap)) if state.finite_overlap else d
    return np.asarray({1: k * spacing, 2: k / d, 3: k / spacing}[state.packing.structure.periods])


def sample_scales(state: ContactState, direction: ArrayLike, names: Sequence[str]) -> list[Array]:
    """Return, for each named branch, the velocity (m/s) by which to multiply the reduced velocities of the ideal lattice.

    It takes the place of d (k/M)^1/2: the long waves of the branch then have the velocity that they have in the state. Each
    array has the shape of the load followed by that of the directions.
    """
    found, order = state.long_waves(direction), lattice_without_overlap(state).wave_names
    ideal = lattice_waves(state, direction)[0] / _add_axes(velocity_scale(state), direction)
    return [np.asarray(found[..., i] / ideal[..., i]) for i in (order.index(n) for n in names)]


def lattice_tensor(state: ContactState) -> Array:
    """Return the elastic tensor of the lattice of contacts in Voigt order, (..., 3, 3) in the plane.

    It is in Pa, in the plane for a layer one diameter thick; of a chain in N. Raises
    :class:`~granphon.base.errors.MechanismError` if a motion costs no energy.
    """
    return modulus_scale(state)[..., None, None] * _at_each_load(state, ContactLattice.elastic_tensor)


def lattice_waves(state: ContactState, direction: ArrayLike) -> tuple[Array, Array]:
    """Return velocities, m/s, and polarisations of long waves of the lattice, in the order of its ``wave_names``.

    The velocities are (..., n_u), or (..., n, n_u) for directions (n, p); the polarisations are (..., n_u, n_u), with unit
    vectors as columns. Raises :class:`~granphon.base.errors.MechanismError` if a motion costs no energy.
    """

    def find(lattice: ContactLattice, stress: Array | None) -> Array:
        velocities, polarisations = lattice.sound_velocities(direction, stress)
        return np.concatenate([velocities[..., None, :], polarisations], axis=-2)

    scale = velocity_scale(state)
    if state.finite_overlap:  # all lengths scale with the spacing
        scale = scale * (1.0 - np.asarray(state.relative_overlap))
    found = _at_each_load(state, find)
    velocities = _add_axes(scale, direction) * found[..., 0, :]
    shape = (*velocities.shape, velocities.shape[-1])
    return velocities, np.broadcast_to(found[..., 1:, :], shape)


def lattice_twist(state: ContactState) -> Array:
    """Return the velocity of the twist wave of a straight chain, at each load, m/s."""
    # the distance of balls over their radius of gyration; with finite overlap such a chain buckles
    return np.asarray(np.sqrt(np.asarray(state.torsion_stiffness) / state.packing.mass) / GYRATION)


def _at_each_load(state: ContactState, find: Callable[[ContactLattice, Array | None], Array]) -> Array:
    """Return ``find(lattice, prestress)`` for a state of many loads; of a lattice at spacing one.

    With finite overlap all lengths scale with the spacing; of the load, only the prestress changes ratios of elastic
    constants, and torsion and bending do where a cell has several balls. The prestress is None if it is left out.
    """
    packing, finite = state.packing, state.finite_overlap
    lattice, stress = lattice_without_overlap(state), prestress(state) if finite else None
    changes = packing.torsion == MINDLIN or (finite and bool(packing.torsion or packing.bending))
    # where no strain twists contacts, it does not matter by how much they resist; prestress might change that
    unmoved = stress is None and changes and not ideal_lattice(packing, 1.0).is_twisted_by_sound
    if packing.structure.n_balls == 1 or not changes or unmoved:
        return find(lattice, stress)
    squared = np.broadcast_to((1.0 - state.relative_overlap) ** 2 if finite else 1.0, state.shape)
    twist, roll = np.broadcast_to(state.torsion, state.shape) / squared, packing.bending / squared
    found = [
        find(ideal_lattice(packing, float(twist[at]), float(roll[at])), None if stress is None else stress[at])
        for at in np.ndindex(state.shape)
    ]
    return np.asarray(found).reshape(*state.shape, *found[0].shape)


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
    # a sample that resists no shear has a modulus of zero, to rounding
    shear = np.where(np.abs(shear) < 1e-12 * np.abs(bulk), np.maximum(shear, 0.0), shear)
    return np.asarray(np.sqrt(np.stack([bulk + shear, shear], axis=-1) / np.asarray(density)[..., None]))
