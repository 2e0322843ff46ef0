"""Means over the samples of a simulated state, and their standard errors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.sample import standard_error
from granphon.base.errors import InputError, message
from granphon.media.state import ContactState

Array = NDArray[np.float64]
#: the attributes that only samples with a history of friction have, with their units
HISTORY_UNITS = {"sliding_fraction": "1", "tangential_ratio": "1", "work": "J", "dissipated_energy": "J"}


def _average_history(name: str, meaning: str) -> property:
    """Return the property of a state that is the mean over samples of one of :data:`HISTORY_UNITS`; None without them."""

    def find(state: SampleMeans) -> Any:
        known = getattr(state.samples[0], name, None) is not None
        return state._average(lambda sample: getattr(sample, name)) if known else None

    return property(find, doc=f"{meaning}; None without a history of friction.")


class SampleMeans(ContactState):
    """A state whose attributes are means over samples, of which there are equally many at each load."""

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
            raise InputError(
                message("one sample has no standard error", mend="Give samples=2 or more to granphon.DirectSimulation")
            )
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
            raise InputError(message(what, why, "Give friction_history=True to granphon.DirectSimulation"))
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
