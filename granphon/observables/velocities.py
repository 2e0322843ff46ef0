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
from granphon.media.acoustics import over_directions, velocities_of_moduli
from granphon.media.state import ContactState, given_state, with_keyword
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
        if not state.is_isotropic:
            raise InputError(
                message(
                    f"the sound velocities of the {state.packing.structure.name} lattice depend on the direction",
                    mend="Give direction=(x, y)",
                )
            )
        direction = (1.0, 0.0)
    along = as_direction(direction)
    v, longitudinal_error, transverse_error = state.long_waves(along), None, None
    if (every := state.sampled_moduli) is not None:
        velocities = velocities_of_moduli(every, np.asarray(state.effective_density)[..., None])
        errors = over_directions(standard_error(velocities, -2), along)
        longitudinal_error, transverse_error = np.moveaxis(errors, -1, 0)
    return SoundVelocities(
        longitudinal=v[..., 0], transverse=v[..., 1], direction=along, warnings=validity(state).warnings,
        longitudinal_error=longitudinal_error, transverse_error=transverse_error,
    )  # fmt: skip


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
    bulk_error, shear_error = None, None
    if (every := state.sampled_moduli) is not None:
        bulk_error, shear_error = np.moveaxis(standard_error(every, -2), -1, 0)
    return Moduli(
        tensor=state.elastic_tensor, isotropic=state.is_isotropic, warnings=validity(state).warnings,
        bulk_error=bulk_error, shear_error=shear_error,
    )  # fmt: skip
