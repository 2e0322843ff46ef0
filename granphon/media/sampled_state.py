"""A state that is a mean over samples: its attributes, elastic tensor, sound waves, local exponent, and their errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.sample import standard_error
from granphon.balls.lattices import as_direction
from granphon.base.errors import InputError
from granphon.dynamics.tensors import bulk_and_shear, symmetrise, waves_of_tensor
from granphon.media.state import ContactState

Array = NDArray[np.float64]
#: the attributes that only samples with a history of friction have, with their units
HISTORY_UNITS = {"sliding_fraction": "1", "tangential_ratio": "1", "work": "J", "dissipated_energy": "J"}


def _average_history(name: str, meaning: str) -> property:
    """Return the property of a state that is the mean over samples of one of :data:`HISTORY_UNITS`; None without them."""

    def find(state: SampledState) -> Any:
        known = getattr(state.samples[0], name, None) is not None
        return state._average(lambda sample: getattr(sample, name)) if known else None

    return property(find, doc=f"{meaning}; None without a history of friction.")


class SampledState(ContactState):
    """A state whose attributes are means over samples, of which there are equally many at each load.

    Its elastic tensor is the mean of their linear response.
    """

    units = {**ContactState.units, "contact_force_fluctuation": "1", **HISTORY_UNITS}

    @property
    def _table(self) -> NDArray[Any]:
        """Samples as an array of objects, with the axes of the load and then the index of the sample."""
        table = np.empty(len(self.samples), dtype=object)
        table[:] = self.samples
        return table.reshape(*self.shape, -1)

    @property
    def n_samples(self) -> int:
        """Number of samples that are averaged at each load."""
        return len(self.samples) // int(np.prod(self.shape, dtype=int))

    @property
    def sample(self) -> Any:
        """First sample; for several loads an array of the first samples, with the shape of the load."""
        first = self._table[..., 0]
        return first if self.shape else first[()]

    def over_samples(self, of: Callable[[Any], ArrayLike]) -> Array:
        """Return the quantity ``of`` every sample, in its own unit.

        The shape is that of the load, then (n_samples,), then that of the quantity.
        """
        values = np.array([np.asarray(of(sample)) for sample in self.samples])
        return values.reshape(*self.shape, self.n_samples, *values.shape[1:])

    def standard_error(self, of: str | Callable[[Any], ArrayLike]) -> Any:
        """Return the standard error of the mean of a quantity over samples, in the unit of the quantity.

        ``of`` is the name of an attribute of :class:`Sample`, or a function of a sample. The result has the shape of the
        load followed by that of the quantity. Raises :class:`~granphon.base.errors.InputError` if there is only one sample.
        """
        if self.n_samples < 2:
            raise InputError("one sample has no standard error", mend="Give samples=2 or more to granphon.DirectSimulation")
        values = self.over_samples((lambda sample: getattr(sample, of)) if isinstance(of, str) else of)
        return standard_error(values, len(self.shape))[()]

    def _average(self, of: Callable[[Any], ArrayLike]) -> Any:
        return np.mean(self.over_samples(of), axis=len(self.shape))[()]

    @property
    def force_fluctuation(self) -> Any:
        """Force fluctuation Delta f / f: rms over balls of the mean force of a ball's contacts, over the mean."""
        return self._average(lambda sample: sample.force_fluctuation)

    @property
    def contact_force_fluctuation(self) -> Any:
        """Rms deviation of the forces of single contacts from the mean force, divided by it; with the shape of the load."""
        return self._average(lambda sample: sample.contact_force_fluctuation)

    @property
    def contact_fraction(self) -> Any:
        """Fraction of contacts that carry more than 1e-6 of the mean force, N_c / z (N_c / 6 on the triangular lattice).

        In the exact geometry loose balls lean on others with W/d of that or less, so that it depends on the threshold: at
        a* = 0.4 it is 0.67, 0.68 of all forces above zero, and 0.58 of those above 1e-3 (steel balls, W/d = 2.6e-4).
        ``contact_fraction(threshold=...)`` of one of the ``samples`` takes another threshold.
        """
        return self._average(lambda sample: sample.contact_fraction())

    def tangential_ratio_distribution(self, bins: int = 50, largest: float | None = None) -> tuple[Array, Array, Array]:
        """Return (bins + 1,) edges, and the probability density of ``|T|/f`` with its standard error, (..., bins).

        Both have the shape of the load in front: the density is the mean over samples of
        :meth:`~granphon.array.pressed_sample.PressedSample.tangential_ratio_distribution`, which describes ``bins`` and
        ``largest``, and its error is nan of one sample. Raises :class:`~granphon.base.errors.InputError` without a history
        of friction.
        """
        return self._average_distribution("tangential_ratio_distribution", bins, largest)

    def mobilisation_distribution(self, bins: int = 50) -> tuple[Array, Array, Array]:
        """Return (bins + 1,) edges, and the probability density of ``|T|/(mu f)`` with its standard error, (..., bins).

        See :meth:`tangential_ratio_distribution`; raises :class:`~granphon.base.errors.InputError` if mu is zero or infinite
        too.
        """
        return self._average_distribution("mobilisation_distribution", bins)

    def _average_distribution(self, name: str, *given: Any) -> tuple[Array, Array, Array]:
        """Return the edges of a distribution of the samples, its mean over them, and the standard error of the mean."""
        if not hasattr(self.samples[0], name):
            what, why = f"there is no {name}", "Balls that come to rest without friction bear no tangential forces"
            raise InputError(what, why, "Give friction_history=True to granphon.DirectSimulation")
        edges: Array = getattr(self.samples[0], name)(*given)[0]
        each = self.over_samples(lambda sample: getattr(sample, name)(*given)[1])
        axis = len(self.shape)
        mean = np.mean(each, axis=axis)
        return edges, mean, standard_error(each, axis) if self.n_samples > 1 else np.full_like(mean, np.nan)

    sliding_fraction = _average_history(
        "sliding_fraction", "Part of the contacts that carry load whose tangential force is at Coulomb's limit"
    )
    tangential_ratio = _average_history(
        "tangential_ratio", "Mean magnitude of the tangential forces over the mean normal force"
    )
    work = _average_history("work", "Work of the load since the start, a mean over contacts, J")
    dissipated_energy = _average_history("dissipated_energy", "Energy lost since the start, a mean over contacts, J")

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
        bulk, shear = np.moveaxis(bulk_and_shear(tensor), -1, 0)
        # a sample that resists no shear has a modulus of zero, to rounding
        shear = np.where(np.abs(shear) < 1e-12 * np.abs(bulk), np.maximum(shear, 0.0), shear)
        # v_L and v_T, m/s, from K and G, Pa (equation 16)
        velocities = np.sqrt(np.stack([bulk + shear, shear], axis=-1) / np.asarray(density)[..., None])
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
        found, ideal = self.long_waves(direction), self.loaded_lattice.find_waves(direction)[0]
        places, scales = [self.wave_names.index(name) for name in names], super().branch_scales(direction, names)
        return [np.asarray(found[..., i] / (ideal[..., i] / scale)) for i, scale in zip(places, scales, strict=True)]
