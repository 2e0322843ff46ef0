"""Elastic tensors of simulated samples, and the sound waves that follow from their mean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.sample import standard_error
from granphon.balls.lattices import as_direction
from granphon.dynamics.tensors import bulk_and_shear, symmetrise, waves_of_tensor
from granphon.media.sample_means import SampleMeans

Array = NDArray[np.float64]


class SampledWaves(SampleMeans):
    """A state whose elastic tensor is the mean over samples of their linear response."""

    @property
    def elastic_tensor(self) -> Array:
        """Elastic tensor in Voigt order: the mean over samples of their linear response.

        It is (..., 3, 3), Pa, xx, yy, xy in the plane; (..., 6, 6), Pa, xx, yy, zz, yz, xz, xy in space; (..., 1, 1), N, of
        a chain. Samples of finite size do not have the symmetry of the lattice; velocities follow from
        the part that has.

        If samples have the same force, ``normal_stiffness`` k is the inverse of a mean of compliances. For several samples
        without friction the bulk modulus then differs from (3^(1/2)/2) k/d in second order of the differences of samples.
        """
        return np.asarray(self._average(lambda sample: sample.elastic_tensor))

    @property
    def is_isotropic(self) -> bool:
        """Whether samples are isotropic on average: in the plane if the lattice has that symmetry, in space never."""
        return self.packing.structure.periods == 1 or self._is_isotropic_plane

    @property
    def _is_isotropic_plane(self) -> bool:
        return self.packing.structure.periods == 2 and super().is_isotropic

    @property
    def sampled_tensors(self) -> Array | None:
        """Elastic tensor of each sample, (..., n_samples, n, n), Voigt order; None if there is only one sample."""
        return self.over_samples(lambda sample: sample.elastic_tensor) if self.n_samples > 1 else None

    def polarised_waves(self, direction: ArrayLike) -> tuple[Array, Array]:
        """Return velocities, m/s, (..., n_u) along ``direction``, or (..., n, n_u) for directions (n, p), and displacements.

        Displacements are unit vectors, columns of (..., n_u, n_u) or (..., n, n_u, n_u). Both follow from the mean elastic
        tensor: in an isotropic plane from its bulk and shear modulus.
        """
        return self._find_waves(self.elastic_tensor, self.effective_density, direction)

    def _find_waves(self, tensor: Array, density: ArrayLike, direction: ArrayLike) -> tuple[Array, Array]:
        """Return velocities and displacements of waves from elastic tensors (..., n, n) of samples, or of their mean."""
        structure = self.packing.structure
        along = as_direction(direction, structure.periods)
        if not self._is_isotropic_plane:
            tensor = symmetrise(tensor, structure) / np.asarray(density)[..., None, None]
            return waves_of_tensor(tensor, along)
        velocities = _compute_velocities(bulk_and_shear(tensor), density)
        if along.ndim > 1:
            velocities = np.repeat(velocities[..., None, :], len(along), axis=-2)
        across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        vectors = np.stack([along, across], axis=-1)
        return velocities, np.broadcast_to(vectors, (*velocities.shape, 2))

    def wave_errors(self, direction: ArrayLike) -> Array | None:
        """Return standard errors of velocities along ``direction``, m/s, in the order of ``wave_names``; None of one."""
        every = self.sampled_tensors
        if every is None:
            return None
        velocities, _ = self._find_waves(every, np.asarray(self.effective_density)[..., None], direction)
        return standard_error(velocities, len(self.shape))

    def branch_scales(self, direction: ArrayLike, names: Sequence[str]) -> list[Array]:
        """Return the velocities (m/s) that scale each branch of the ideal lattice to the long waves of the samples."""
        found, order = self.long_waves(direction), self.wave_names
        ideal = self.loaded_lattice.find_reduced_velocities(direction)
        return [np.asarray(found[..., i] / ideal[..., i]) for i in (order.index(n) for n in names)]


def _compute_velocities(moduli: Array, density: ArrayLike) -> Array:
    """Return v_L and v_T, (..., 2), m/s, from K and G, (..., 2), Pa, and the density, kg/m^3 (equation 16)."""
    bulk, shear = np.moveaxis(moduli, -1, 0)
    # a sample that resists no shear has a modulus of zero, to rounding
    shear = np.where(np.abs(shear) < 1e-12 * np.abs(bulk), np.maximum(shear, 0.0), shear)
    return np.asarray(np.sqrt(np.stack([bulk + shear, shear], axis=-1) / np.asarray(density)[..., None]))
