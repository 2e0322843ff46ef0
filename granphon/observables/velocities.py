"""Long waves: sound velocities, elastic moduli, and their local exponents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.response import bulk_and_shear, shears
from granphon.array.sample import standard_error
from granphon.balls.lattices import as_direction
from granphon.base.errors import InputError, message
from granphon.base.results import Result
from granphon.media.simulation import SimulatedState
from granphon.media.state import ContactState, given_state, with_keyword
from granphon.observables.acoustics import (
    from_moduli,
    ideal_lattice,
    is_isotropic,
    long_waves,
    over_directions,
    prestress,
)
from granphon.observables.validity import validity

__all__ = [
    "Moduli",
    "SoundVelocities",
    "local_exponent",
    "moduli",
    "sound_velocities",
]

Array = NDArray[np.float64]


def local_exponent(state: ContactState) -> Any:
    """d log v / d log P of both sound velocities, of the shape of the load, always without the terms of order delta/d.

    v goes as the root of k, and P as f, so that it is f k'/2k^2 with the slope k' = dk/d(delta) of the medium's law: 1/6
    for equal balls. Listed diameters have a kink in k where contacts of a pair open, and spikes in the exponent there. Of a
    simulation, whose moduli are not all proportional to k, it is the exponent of the longitudinal velocity: that of the
    mean K + G of the samples, by differences between two loads, 5 % below and above, at which the same samples are solved.
    ``state.exponent_error`` is its standard error over the samples: 0 of a medium, which samples nothing, and nan of one
    sample. :class:`~granphon.base.errors.ConvergenceError` if a simulation beside the load fails.
    """
    return given_state(state).exponent


# -- velocities and moduli ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class SoundVelocities(Result):
    """Velocities of long waves, m/s, with the shape of the load, then that of the directions, and their warnings.

    ``longitudinal_error`` and ``transverse_error`` are standard errors over the samples of a simulation; else None.
    """

    units = {"longitudinal": "m/s", "transverse": "m/s", "longitudinal_error": "m/s", "transverse_error": "m/s"}
    shapes = {
        "longitudinal": "...", "transverse": "...", "direction": "2|n 2", "longitudinal_error": "...?",
        "transverse_error": "...?",
    }  # fmt: skip

    longitudinal: Any
    transverse: Any
    direction: Array
    warnings: tuple[str, ...]
    longitudinal_error: Any = None
    transverse_error: Any = None


def sound_velocities(
    state: ContactState, direction: ArrayLike | None = None, finite_overlap: bool | None = None
) -> SoundVelocities:
    """Longitudinal and transverse sound velocity (equations 13, 14, 16).

    Parameters
    ----------
    state : at one load or many.
    direction : of propagation, Cartesian, (2,), or (n, 2) for many at once, whose axis follows those of the load. It may be
        left out where sound is isotropic, as on the triangular lattice. Elsewhere the two are the quasi-longitudinal and
        quasi-transverse waves. Of a simulation, isotropic on average, velocities are those of its mean bulk and shear
        modulus.
    finite_overlap : deprecated; the state has it.

    Raises
    ------
    InputError : no direction is given and velocities depend on it; a direction is not two finite numbers, or has no length.
    InstabilityError : with finite overlap, the lattice buckles.
    """
    state = with_keyword(state, finite_overlap)
    if direction is None:
        if not is_isotropic(ideal_lattice(state.packing)):
            raise InputError(
                message(
                    f"the sound velocities of the {state.packing.structure.name} lattice depend on the direction",
                    mend="Give direction=(x, y)",
                )
            )
        direction = (1.0, 0.0)
    along = as_direction(direction)
    v = long_waves(state, along)
    errors: tuple[Any, ...] = (None, None)
    if isinstance(state, SimulatedState) and state.n_samples > 1:
        every = state.over_samples(lambda sample: bulk_and_shear(sample.elastic_tensor))
        velocities = from_moduli(every, np.asarray(state.effective_density)[..., None])
        errors = tuple(np.moveaxis(over_directions(standard_error(velocities, -2), along), -1, 0))
    return SoundVelocities(v[..., 0], v[..., 1], along, validity(state).warnings, *errors)


@dataclass(frozen=True, eq=False, repr=False)
class Moduli(Result):
    """Elastic constants of the layer taken one diameter thick, Pa.

    ``tensor`` (..., 3, 3) is in Voigt order xx, yy, xy, after the shape of the load. A simulated sample is ``isotropic`` on
    average only; ``bulk_error`` and ``shear_error`` are standard errors over the samples of a simulation, else None.
    """

    units = {
        "tensor": "Pa", "bulk": "Pa", "shear": "Pa", "shears": "Pa", "bulk_error": "Pa", "shear_error": "Pa",
    }  # fmt: skip
    shapes = {"tensor": "... 3 3", "bulk_error": "...?", "shear_error": "...?"}

    tensor: Array
    isotropic: bool
    warnings: tuple[str, ...]
    bulk_error: Any = None
    shear_error: Any = None

    @property
    def bulk(self) -> Any:
        """K, Pa (equation 17); :class:`~granphon.base.errors.InputError` if the lattice is not isotropic."""
        self._require_isotropic()
        return bulk_and_shear(self.tensor)[..., 0][()]

    @property
    def shear(self) -> Any:
        """G, Pa (equation 17); :class:`~granphon.base.errors.InputError` if the lattice is not isotropic.

        The mean of two orientations, which differ in a sample of finite size.
        """
        return np.mean(self.shears, axis=-1)[()]

    @property
    def shears(self) -> Array:
        """(..., 2) Pa: G of the shear xx - yy, and of xy; their difference measures the isotropy of a sample."""
        self._require_isotropic()
        return shears(self.tensor)

    def _require_isotropic(self) -> None:
        if not self.isotropic:
            raise InputError(message("this lattice has no single bulk and shear modulus", mend="Use .tensor"))


def moduli(state: ContactState, finite_overlap: bool | None = None) -> Moduli:
    """Bulk and shear modulus (equation 17), or the elastic tensor of a lattice that is not isotropic.

    With finite overlap these are the coefficients between Cauchy stress and strain under the static pressure, for which
    equation (16) still holds. The keyword ``finite_overlap`` is deprecated: the state has it.
    """
    state = with_keyword(state, finite_overlap)
    if isinstance(state, SimulatedState):
        errors: tuple[Any, ...] = (None, None)
        if state.n_samples > 1:
            every = state.over_samples(lambda sample: bulk_and_shear(sample.elastic_tensor))
            errors = tuple(np.moveaxis(standard_error(every, -2), -1, 0))
        return Moduli(state.elastic_tensor, True, validity(state).warnings, *errors)
    lattice = ideal_lattice(state.packing)
    tensor = lattice.elastic_tensor(prestress(state) if state.finite_overlap else np.zeros(state.shape))
    scale = np.asarray(state.normal_stiffness / state.packing.diameter)
    return Moduli(scale[..., None, None] * tensor, is_isotropic(lattice), validity(state).warnings)
