"""What an experiment measures: sound velocities, pulses of finite frequency, moduli, local exponents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.acoustics import (
    branch_scales,
    bulk_and_shear,
    contact_lattice,
    from_moduli,
    ideal_lattice,
    is_isotropic,
    long_waves,
    prestress,
    shears,
)
from granphon.arguments import real_array
from granphon.branches import AcousticBranch, acoustic_branches
from granphon.errors import InputError, UnreachableFrequencyError, brief, message
from granphon.geometry import as_direction
from granphon.limits import validity
from granphon.results import Result
from granphon.samples import standard_error
from granphon.simulation import SimulatedState
from granphon.state import ContactState, with_keyword

__all__ = [
    "Moduli",
    "PulseVelocities",
    "SoundVelocities",
    "local_exponent",
    "moduli",
    "pulse_velocities",
    "sound_velocities",
]

Array = NDArray[np.float64]


def local_exponent(state: ContactState) -> Any:
    """d log v / d log P of both sound velocities, of the shape of the load, always without the terms of order delta/d.

    v goes as the root of k, and P as f, so that it is f k'/2k^2 with the slope k' = dk/d(delta) of the medium's law: 1/6
    for equal balls. Listed diameters have a kink in k where contacts of a pair open, and spikes in the exponent there. Of a
    simulation, whose moduli are not all proportional to k, it is the exponent of the longitudinal velocity, f M'/2kM with
    M = K + G, along the samples' own equilibria.
    """
    if isinstance(state, SimulatedState):
        modulus, slope = (np.sum(bulk_and_shear(values), axis=-1) for values in (state.elastic_tensor, state.elastic_slope))
        return np.asarray(0.5 * (state.force / state.normal_stiffness) * (slope / modulus))[()]
    slope = state.law.stiffness_slope(state.overlap)
    return np.asarray(0.5 * (state.force / state.normal_stiffness) * (slope / state.normal_stiffness))[()]


# -- velocities and moduli ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class SoundVelocities(Result):
    """Velocities of long waves, m/s, with the shape of the load, and the warnings that go with them.

    ``longitudinal_error`` and ``transverse_error`` are standard errors over the samples of a simulation; else None.
    """

    units = {"longitudinal": "m/s", "transverse": "m/s", "longitudinal_error": "m/s", "transverse_error": "m/s"}

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
    direction : of propagation, Cartesian; may be left out where sound is isotropic, as on the triangular lattice.
        Elsewhere the two are the quasi-longitudinal and quasi-transverse waves. Of a simulation, isotropic on average,
        velocities are those of its mean bulk and shear modulus.
    finite_overlap : deprecated; the state has it.

    Raises
    ------
    InputError : no direction is given and velocities depend on it.
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
    v = long_waves(state, direction)
    errors: tuple[Any, ...] = (None, None)
    if isinstance(state, SimulatedState) and state.n_samples > 1:
        every = state.over_samples(lambda sample: bulk_and_shear(sample.elasticity.tensor))
        velocities = from_moduli(every, np.asarray(state.effective_density)[..., None])
        errors = tuple(np.moveaxis(standard_error(velocities, -2), -1, 0))
    return SoundVelocities(v[..., 0], v[..., 1], as_direction(direction), validity(state).warnings, *errors)


@dataclass(frozen=True, eq=False, repr=False)
class Moduli(Result):
    """Elastic constants of the layer taken one diameter thick, Pa.

    ``tensor`` (..., 3, 3) is in Voigt order xx, yy, xy, after the shape of the load. A simulated sample is ``isotropic`` on
    average only; ``bulk_error`` and ``shear_error`` are standard errors over the samples of a simulation, else None.
    """

    units = {
        "tensor": "Pa", "bulk": "Pa", "shear": "Pa", "shears": "Pa", "bulk_error": "Pa", "shear_error": "Pa",
    }  # fmt: skip

    tensor: Array
    isotropic: bool
    warnings: tuple[str, ...]
    bulk_error: Any = None
    shear_error: Any = None

    @property
    def bulk(self) -> Any:
        """K, Pa (equation 17); :class:`~granphon.errors.InputError` if the lattice is not isotropic."""
        self._require_isotropic()
        return bulk_and_shear(self.tensor)[..., 0][()]

    @property
    def shear(self) -> Any:
        """G, Pa (equation 17); :class:`~granphon.errors.InputError` if the lattice is not isotropic.

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
            every = state.over_samples(lambda sample: bulk_and_shear(sample.elasticity.tensor))
            errors = tuple(np.moveaxis(standard_error(every, -2), -1, 0))
        return Moduli(state.elastic_tensor, True, validity(state).warnings, *errors)
    lattice = ideal_lattice(state.packing)
    tensor = lattice.elastic_tensor(prestress(state) if state.finite_overlap else np.zeros(state.shape))
    scale = np.asarray(state.normal_stiffness / state.packing.diameter)
    return Moduli(scale[..., None, None] * tensor, is_isotropic(lattice), validity(state).warnings)


def _on_branch(branch: AcousticBranch, target: Array, scale: Array) -> tuple[Array, Array]:
    """Wavenumber and group velocity (reduced) at angular frequencies in units of ``scale``, rad/s."""
    if np.any(target > branch.top):
        wanted, top = (float(np.max(target * scale)), float(np.min(branch.top * scale)))
        raise UnreachableFrequencyError(
            message(
                f"the {branch.name} branch does not reach {wanted / (2.0 * np.pi):.6g} Hz in direction"
                f" ({branch.direction[0]:.6g}, {branch.direction[1]:.6g})",
                f"It ends at {top / (2.0 * np.pi):.6g} Hz" + (" at the least load" if np.ptp(scale) > 0.0 else ""),
                "Lower the frequency, or name the branches that reach it",
            )
        )
    q, slope = branch.wavenumber(target.ravel())
    return q.reshape(target.shape), slope.reshape(target.shape)


@dataclass(frozen=True, eq=False, repr=False)
class PulseVelocities(Result):
    """Phase and group velocity of a pulse of given frequency.

    Attributes
    ----------
    branches : names of the branches, along the first axis of the arrays.
    phase, group : (n_branches, ...) m/s; the group velocity is the derivative of the frequency along the direction.
    wavenumber : (n_branches, ...) rad/m.
    frequency : Hz.
    direction : unit vector.
    """

    units = {"phase": "m/s", "group": "m/s", "wavenumber": "rad/m", "frequency": "Hz"}

    branches: tuple[str, ...]
    phase: Array
    group: Array
    wavenumber: Array
    frequency: Any
    direction: Array
    warnings: tuple[str, ...]


def pulse_velocities(
    state: ContactState,
    frequency: ArrayLike,
    direction: ArrayLike = (1.0, 0.0),
    finite_overlap: bool | None = None,
    branches: str | Sequence[str] = ("longitudinal", "transverse"),
) -> PulseVelocities:
    """Phase and group velocity of the acoustic branches at a given frequency, which lie below the long-wave velocity.

    Parameters
    ----------
    state : at one load or many.
    frequency : Hz; a scalar or an array that broadcasts against the load.
    direction : of propagation, Cartesian; (1, 0) is Gamma-K, (0, 1) Gamma-M.
    finite_overlap : deprecated; the state has it.
    branches : those wanted, in the order wanted.

    Of a simulation the branches are those of the lattice, each with the velocity of the samples' own long waves.

    Returns
    -------
    :class:`PulseVelocities`; the wavenumber solves the dispersion relation to rounding.

    Raises
    ------
    UnreachableFrequencyError : a branch ends, at its first maximum or the zone edge, below the frequency.
    InputError : a frequency that is not finite and above zero, an unknown branch.
    """
    state = with_keyword(state, finite_overlap)
    hertz = real_array("frequency", frequency)
    if not (hertz.size and np.all(np.isfinite(hertz)) and np.all(hertz > 0.0)):
        raise InputError(message(f"frequency is {brief(frequency)}", "It must be finite and above zero (Hz)"))
    names = (branches,) if isinstance(branches, str) else tuple(branches)
    unknown = [name for name in names if name not in ("longitudinal", "transverse")]
    if unknown or not names:
        raise InputError(message(f"unknown branch {unknown}", mend="Use longitudinal, transverse or both"))
    d = state.packing.diameter
    try:
        pairs = [
            np.broadcast_arrays(2.0 * np.pi * hertz * d / scale, scale) for scale in branch_scales(state, direction, names)
        ]
    except ValueError:
        raise InputError(
            message(f"frequencies of shape {hertz.shape} do not go with loads of shape {state.shape}")
        ) from None
    target, scale = (np.stack(rows) for rows in zip(*pairs, strict=True))
    wavenumber, group = np.empty((2, *target.shape))
    # in the paper's limit one dispersion relation serves all loads; with finite overlap each load has its own
    parts: list[tuple[ContactState, tuple[Any, ...]]] = [(state, (...,))]
    if state.finite_overlap and state.shape:
        force, overlap, stiffness = (
            np.broadcast_to(x, target.shape[1:]) for x in (state.force, state.overlap, state.normal_stiffness)
        )
        every = replace(state, force=force, overlap=overlap, normal_stiffness=stiffness)
        parts = [(every[index], index) for index in np.ndindex(target.shape[1:])]
    for part, index in parts:
        found = acoustic_branches(contact_lattice(part), direction)
        for row, name in enumerate(names):
            here = (row, *index)
            q, slope = _on_branch(found[name], np.asarray(target[here]), np.asarray(scale[here] / d))
            wavenumber[here], group[here] = q, slope
    return PulseVelocities(
        names, target / wavenumber * scale, group * scale, wavenumber / d, hertz, as_direction(direction),
        validity(state).warnings,
    )  # fmt: skip
