"""The lattice of contacts of a packing under load, in reduced units, and its elastic tensor and long waves, in SI."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.packing import MINDLIN, Packing
from granphon.dynamics.compatibility import GYRATION
from granphon.dynamics.contact_lattice import ContactLattice

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


@dataclass(frozen=True, eq=False)
class LoadedLattice:
    """The lattice of equal contacts of a packing, at each of some loads.

    Attributes
    ----------
    packing : the balls.
    force, stiffness : mean contact force, N, and normal stiffness k, N/m, at each load.
    relative_overlap : delta/d at each load.
    finite_overlap : whether it has the terms of relative order delta/d: the spacing a, the lever arm a/2, the prestress f/a.
    """

    packing: Packing
    force: Any
    stiffness: Any
    relative_overlap: Any
    finite_overlap: bool

    @property
    def is_one(self) -> bool:
        """Whether the lattice, in reduced units, is the same at all loads."""
        return not np.shape(self.force) or not (self.finite_overlap or self.packing.torsion == MINDLIN)

    @cached_property
    def without_overlap(self) -> ContactLattice:
        """The lattice, in reduced units, without terms of finite overlap.

        The torsion of a Hertz contact is that at the largest load. What does not depend on the load is read from this
        lattice: the names of waves, mechanisms, isotropy.
        """
        hertz = self.packing.torsion == MINDLIN
        return ideal_lattice(self.packing, float(np.max(self._torsion)) if hertz else None)

    @property
    def contacts(self) -> ContactLattice:
        """The lattice in reduced units, of a single load unless it :attr:`is_one` of all."""
        packing = self.packing
        if not self.finite_overlap and packing.torsion != MINDLIN:
            return ideal_lattice(packing)
        spacing, load = (1.0 - self.relative_overlap, float(self._prestress)) if self.finite_overlap else (1.0, 0.0)
        return ContactLattice.of(
            packing.structure, packing.mindlin_ratio, spacing, load,
            torsion=float(self._torsion), bending=packing.bending, motions=packing.ball_motions,
        )  # fmt: skip

    @property
    def velocity_scale(self) -> Array:
        """Unit of velocity d (k/M)^1/2 at each load, m/s."""
        return np.asarray(self.packing.diameter * (np.sqrt(self.stiffness) / np.sqrt(self.packing.mass)))

    @property
    def elastic_tensor(self) -> Array:
        """Elastic tensor in Voigt order, (..., 3, 3) in the plane.

        It is in Pa, in the plane for a layer one diameter thick; of a chain in N. Raises
        :class:`~granphon.base.errors.MechanismError` if a motion costs no energy.
        """
        # with finite overlap the spacing a stands in place of d in space and on a line; the layer of a plane stays d thick
        d, k = self.packing.diameter, self.stiffness
        spacing = d * (1.0 - np.asarray(self.relative_overlap)) if self.finite_overlap else d
        scale = np.asarray({1: k * spacing, 2: k / d, 3: k / spacing}[self.packing.structure.periods])
        return scale[..., None, None] * self._at_each_load(ContactLattice.elastic_tensor)

    def find_waves(self, direction: ArrayLike) -> tuple[Array, Array]:
        """Return velocities, m/s, and polarisations of long waves, in the order of the lattice's ``wave_names``.

        The velocities are (..., n_u), or (..., n, n_u) for directions (n, p); the polarisations are (..., n_u, n_u), with
        unit vectors as columns. Raises :class:`~granphon.base.errors.MechanismError` if a motion costs no energy.
        """

        def find(lattice: ContactLattice, stress: Array | None) -> Array:
            velocities, polarisations = lattice.sound_velocities(direction, stress)
            return np.concatenate([velocities[..., None, :], polarisations], axis=-2)

        scale = self.velocity_scale
        if self.finite_overlap:  # all lengths scale with the spacing
            scale = scale * (1.0 - np.asarray(self.relative_overlap))
        found = self._at_each_load(find)
        velocities = _add_axes(scale, direction) * found[..., 0, :]
        return velocities, np.broadcast_to(found[..., 1:, :], (*velocities.shape, velocities.shape[-1]))

    @property
    def twist_velocity(self) -> Array:
        """Velocity of the twist wave of a straight chain, at each load, m/s."""
        # the distance of balls over their radius of gyration; with finite overlap such a chain buckles
        stiffness = self._torsion * self.stiffness * self.packing.diameter**2
        return np.asarray(np.sqrt(stiffness / self.packing.mass) / GYRATION)

    @property
    def _torsion(self) -> Array:
        return np.asarray(self.packing.find_torsion(self.force, self.stiffness))

    @property
    def _prestress(self) -> Array:
        """f/(k a) at each load, without a unit."""
        spacing = self.packing.diameter * (1.0 - self.relative_overlap)
        return np.asarray(self.force / self.stiffness / spacing)

    def _at_each_load(self, find: Callable[[ContactLattice, Array | None], Array]) -> Array:
        """Return ``find(lattice, prestress)`` for many loads; of a lattice at spacing one.

        With finite overlap all lengths scale with the spacing; of the load, only the prestress changes ratios of elastic
        constants, and torsion and bending do where a cell has several balls. The prestress is None if it is left out.
        """
        packing, finite, shape = self.packing, self.finite_overlap, np.shape(self.force)
        stress = self._prestress if finite else None
        changes = packing.torsion == MINDLIN or (finite and bool(packing.torsion or packing.bending))
        # where no strain twists contacts, it does not matter by how much they resist; prestress might change that
        unmoved = stress is None and changes and not ideal_lattice(packing, 1.0).is_twisted_by_sound
        if packing.structure.n_balls == 1 or not changes or unmoved:
            return find(self.without_overlap, stress)
        squared = np.broadcast_to((1.0 - self.relative_overlap) ** 2 if finite else 1.0, shape)
        twist, roll = np.broadcast_to(self._torsion, shape) / squared, packing.bending / squared
        found = [
            find(ideal_lattice(packing, float(twist[at]), float(roll[at])), None if stress is None else stress[at])
            for at in np.ndindex(shape)
        ]
        return np.asarray(found).reshape(*shape, *found[0].shape)


def _add_axes(values: Array, direction: ArrayLike) -> Array:
    """Append axes of length one to ``values`` of each load: for the directions, if there are many, and for the branches."""
    return values.reshape(*values.shape, *(1,) * np.ndim(direction))
