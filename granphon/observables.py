"""What an experiment measures: sound velocities, pulses of finite frequency, moduli; and where the model holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.branches import AcousticBranch, acoustic_branches
from granphon.contact import contact_radius_ratio
from granphon.errors import InputError, UnreachableFrequencyError, message
from granphon.geometry import as_direction
from granphon.lattice import ContactLattice
from granphon.medium import ContactState
from granphon.results import Result
from granphon.samples import standard_error
from granphon.simulation import SimulatedState

__all__ = [
    "Check",
    "Moduli",
    "PulseVelocities",
    "SoundVelocities",
    "Validity",
    "bulk_and_shear",
    "contact_lattice",
    "local_exponent",
    "moduli",
    "pulse_velocities",
    "sound_velocities",
    "validity",
]

Array = NDArray[np.float64]
#: two elastic constants that should be equal differ by no more than this part
_ISOTROPIC = 1e-10

#: what is checked of the contacts, the limit, and what fails beyond it. The first four are reached together, near
#: delta/d = 1 %, which is also the size of the terms that the contact law leaves out there.
_LIMITS = {
    "contact_radius": (0.1, "contact radius over ball radius", "Hertz's law takes the contact for a small spot"),
    "load": (0.3, "(f/E d^2)^(1/6)", "the balls must be much stiffer than their contacts"),
    "velocity": (0.5, "sound velocity over bulk velocity", "waves must be slow against those inside a ball"),
    "resonance": (0.5, "top frequency over the lowest resonance of a ball", "a ball must move as a rigid body"),
    "spread": (0.03, "rms difference of diameters over their mean", "contacts are taken for those of nearly equal balls"),
    "yield": (1.07, "mean contact pressure over yield strength", "beyond it the contact begins to flow plastically"),
}


def contact_lattice(state: ContactState, finite_overlap: bool = False) -> ContactLattice:
    """The lattice of contacts in a state at one load, in reduced units.

    ``finite_overlap`` keeps the terms of relative order delta/d: spacing a, lever arm a/2, prestress f/a.
    """
    packing = state.packing
    if not finite_overlap:
        return ContactLattice.of(packing.structure, packing.mindlin_ratio)
    _ = state.scales  # one load only
    return ContactLattice.of(
        packing.structure, packing.mindlin_ratio, 1.0 - state.relative_overlap, float(_prestress(state))
    )


def _prestress(state: ContactState) -> Array:
    """f/(k a) of each load."""
    spacing = state.packing.diameter * (1.0 - state.relative_overlap)
    return np.asarray(state.force / state.normal_stiffness / spacing)


def _velocity_scale(state: ContactState) -> Array:
    """d (k/M)^1/2 of each load, m/s."""
    return np.asarray(state.packing.diameter * (np.sqrt(state.normal_stiffness) / np.sqrt(state.packing.mass)))


def _scales(state: ContactState, direction: ArrayLike, names: Sequence[str]) -> list[Array]:
    """d (k/M)^1/2 of each branch: of a simulation, such that long waves have the velocities of its samples."""
    if not isinstance(state, SimulatedState):
        return [_velocity_scale(state)] * len(names)
    found = _raw_velocities(state, direction, False)
    ideal, _ = contact_lattice(state).sound_velocities(direction)
    return [np.asarray(found[..., i] / ideal[..., i]) for i in (("longitudinal", "transverse").index(n) for n in names)]


def _is_isotropic(lattice: ContactLattice) -> bool:
    c = lattice.elastic_tensor()
    off = [c[0, 0] - c[1, 1], c[0, 2], c[1, 2], c[2, 2] - (c[0, 0] - c[0, 1]) / 2.0]
    return bool(np.max(np.abs(off)) <= _ISOTROPIC * c[0, 0])


def _raw_velocities(state: ContactState, direction: ArrayLike, finite_overlap: bool) -> Array:
    """(..., 2) longitudinal and transverse, m/s."""
    if isinstance(state, SimulatedState):
        return _from_moduli(bulk_and_shear(_simulated_tensor(state, finite_overlap)), state.effective_density)
    lattice = contact_lattice(state)
    scale = _velocity_scale(state)
    if not finite_overlap:
        velocities, _ = lattice.sound_velocities(direction)
        return scale[..., None] * velocities
    # every length scales with the spacing; the prestress alone enters the shape of the tensor
    velocities, _ = lattice.sound_velocities(direction, _prestress(state))
    return np.asarray((scale * (1.0 - state.relative_overlap))[..., None] * velocities)


def _simulated_tensor(state: SimulatedState, finite_overlap: bool) -> Array:
    """(..., 3, 3) Pa; :class:`InputError` with finite overlap."""
    if finite_overlap:
        raise InputError(
            message(
                "the linear response of a simulation has no terms of finite overlap",
                "It is found in the paper's limit, spread and overlap small against the diameter",
                "Leave finite_overlap out",
            )
        )
    return state.elastic_tensor


def bulk_and_shear(tensor: Array) -> Array:
    """(..., 2) K and G of an elastic tensor (..., 3, 3), isotropic or nearly: G is the mean of its two orientations."""
    return np.stack([_bulk(tensor), np.mean(_shears(tensor), axis=-1)], axis=-1)


def _bulk(tensor: Array) -> Array:
    c = tensor[..., :2, :2]
    return np.asarray(np.sum(c, axis=(-2, -1)) / 4.0)


def _shears(tensor: Array) -> Array:
    """(..., 2) G for the shear xx - yy, and for xy."""
    c = tensor
    return np.stack([(c[..., 0, 0] + c[..., 1, 1] - 2.0 * c[..., 0, 1]) / 4.0, c[..., 2, 2]], axis=-1)


def _from_moduli(bulk_and_shear: Array, density: ArrayLike) -> Array:
    """(..., 2) v_L and v_T, m/s (equation 16)."""
    bulk, shear = np.moveaxis(bulk_and_shear, -1, 0)
    return np.asarray(np.sqrt(np.stack([bulk + shear, shear], axis=-1) / np.asarray(density)[..., None]))


# -- validity -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class Check(Result):
    """One condition of validity: ``value`` (the shape of the load) must not exceed ``limit``, or not be less, ``at_least``.

    ``meaning`` says what the value is, ``reason`` why it is limited.
    """

    name: str
    meaning: str
    value: Any
    limit: float
    reason: str
    at_least: bool = False

    @property
    def ok(self) -> Any:
        """Whether the condition holds, at each load."""
        return np.asarray(self.value >= self.limit if self.at_least else self.value <= self.limit)[()]

    @property
    def warning(self) -> str | None:
        """What to tell the user, or None if the condition holds at every load."""
        if np.all(self.ok):
            return None
        worst = float(np.min(self.value) if self.at_least else np.max(self.value))
        count = int(np.size(self.ok))
        where = "" if np.ndim(self.value) == 0 else f" (worst of {int(count - np.sum(self.ok))} loads out of {count})"
        excess = f"{worst / self.limit:.4g} times the limit of {self.limit:g}"
        if self.at_least:
            excess = f"below {self.limit:.4g}"
        return f"{self.meaning} is {worst:.4g}{where}, {excess}: {self.reason}"


@dataclass(frozen=True, eq=False, repr=False)
class Validity(Result):
    """The conditions under which the model holds, and how far each is fulfilled."""

    checks: tuple[Check, ...]

    @property
    def ok(self) -> Any:
        """Whether every condition holds, at each load."""
        return np.logical_and.reduce([check.ok for check in self.checks])[()]

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each condition that fails; empty if all hold."""
        return tuple(check.warning for check in self.checks if check.warning is not None)

    def __getitem__(self, name: str) -> Check:
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)


def validity(state: ContactState, finite_overlap: bool = False) -> Validity:
    """Where the state stands against the limits of its medium (Section IV) and of the contact model (end of Section II).

    Computed: if balls differ, how far the load is above the medium's range (:attr:`ContactState.least_valid_force`) and how
    much they differ; contact radius over ball radius; (f/E d^2)^(1/6); sound over bulk velocity (the larger of the
    longitudinal and transverse ratios); the top of the branches over the lowest resonance of a free ball; and, if the
    material has a ``yield_strength``, the mean contact pressure over it (K. L. Johnson, Contact Mechanics, 1985: yield
    begins at 1.07).
    """
    material, d = state.packing.material, state.packing.diameter
    lattice = contact_lattice(state)
    direction = (1.0, 0.0)
    v = _raw_velocities(state, direction, finite_overlap)
    # of the mean force: where balls differ the mean overlap may be negative
    radius = np.asarray(contact_radius_ratio(state.packing.law.overlap(state.force), d))
    values = {
        "contact_radius": radius,
        # roots before products: f and E d^2 may each be near the ends of the floating range
        "load": np.cbrt(np.sqrt(state.force / (material.young_modulus * d) / d)),
        "velocity": np.maximum(v[..., 0] / material.longitudinal_velocity, v[..., 1] / material.transverse_velocity),
        "resonance": lattice.top_frequency * _velocity_scale(state) / d / (2.0 * np.pi) / material.lowest_resonance(d),
    }
    if state.packing.spread is not None:
        values["spread"] = np.full(state.shape, state.packing.spread.rms / d)
    if material.yield_strength is not None:
        spot = radius * d / 2.0
        values["yield"] = state.force / spot / (np.pi * spot) / material.yield_strength
    checks = []
    for name, value in values.items():
        limit, meaning, reason = _LIMITS[name]
        checks.append(Check(name, meaning, np.asarray(value), limit, reason))
    if state.packing.width:
        reason = f"pressed so little, the balls differ too much for the medium {state.medium!r}"
        force = np.asarray(state.force)
        checks.insert(0, Check("medium", "contact force in N", force, state.least_valid_force, reason, at_least=True))
    return Validity(tuple(checks))


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
    state: ContactState, direction: ArrayLike | None = None, finite_overlap: bool = False
) -> SoundVelocities:
    """Longitudinal and transverse sound velocity (equations 13, 14, 16).

    Parameters
    ----------
    state : at one load or many.
    direction : of propagation, Cartesian; may be left out where sound is isotropic, as on the triangular lattice.
        Elsewhere the two are the quasi-longitudinal and quasi-transverse waves. Of a simulation, isotropic on average,
        velocities are those of its mean bulk and shear modulus.
    finite_overlap : keep the terms of relative order delta/d.

    Raises
    ------
    InputError : no direction is given and velocities depend on it.
    InstabilityError : with finite overlap, the lattice buckles.
    """
    if direction is None:
        if not _is_isotropic(contact_lattice(state)):
            raise InputError(
                message(
                    f"the sound velocities of the {state.packing.structure.name} lattice depend on the direction",
                    mend="Give direction=(x, y)",
                )
            )
        direction = (1.0, 0.0)
    v = _raw_velocities(state, direction, finite_overlap)
    errors: tuple[Any, ...] = (None, None)
    if isinstance(state, SimulatedState) and state.n_samples > 1:
        every = state.over_samples(lambda sample: bulk_and_shear(sample.elasticity.tensor))
        velocities = _from_moduli(every, np.asarray(state.effective_density)[..., None])
        errors = tuple(np.moveaxis(standard_error(velocities, -2), -1, 0))
    warnings = validity(state, finite_overlap).warnings
    return SoundVelocities(v[..., 0], v[..., 1], as_direction(direction), warnings, *errors)


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
        return _bulk(self.tensor)[()]

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
        return _shears(self.tensor)

    def _require_isotropic(self) -> None:
        if not self.isotropic:
            raise InputError(message("this lattice has no single bulk and shear modulus", mend="Use .tensor"))


def moduli(state: ContactState, finite_overlap: bool = False) -> Moduli:
    """Bulk and shear modulus (equation 17), or the elastic tensor of a lattice that is not isotropic.

    With ``finite_overlap`` these are the coefficients between Cauchy stress and strain under the static pressure, for which
    equation (16) still holds.
    """
    if isinstance(state, SimulatedState):
        tensor = _simulated_tensor(state, finite_overlap)
        errors: tuple[Any, ...] = (None, None)
        if state.n_samples > 1:
            every = state.over_samples(lambda sample: bulk_and_shear(sample.elasticity.tensor))
            errors = tuple(np.moveaxis(standard_error(every, -2), -1, 0))
        return Moduli(tensor, True, validity(state).warnings, *errors)
    lattice = contact_lattice(state)
    tensor = lattice.elastic_tensor(_prestress(state) if finite_overlap else np.zeros(state.shape))
    scale = np.asarray(state.normal_stiffness / state.packing.diameter)
    return Moduli(scale[..., None, None] * tensor, _is_isotropic(lattice), validity(state, finite_overlap).warnings)


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
    finite_overlap: bool = False,
    branches: str | Sequence[str] = ("longitudinal", "transverse"),
) -> PulseVelocities:
    """Phase and group velocity of the acoustic branches at a given frequency, which lie below the long-wave velocity.

    Parameters
    ----------
    state : at one load or many.
    frequency : Hz; a scalar or an array that broadcasts against the load.
    direction : of propagation, Cartesian; (1, 0) is Gamma-K, (0, 1) Gamma-M.
    finite_overlap : keep the terms of relative order delta/d. A simulation has none: its branches are those of the lattice,
        each with the velocity of the samples' own long waves.
    branches : those wanted, in the order wanted.

    Returns
    -------
    :class:`PulseVelocities`; the wavenumber solves the dispersion relation to rounding.

    Raises
    ------
    UnreachableFrequencyError : a branch ends, at its first maximum or the zone edge, below the frequency.
    InputError : a frequency that is not finite and above zero, an unknown branch.
    """
    try:
        hertz = np.asarray(frequency, float)
    except (TypeError, ValueError):
        hertz = np.array(np.nan)
    if not (hertz.size and np.all(np.isfinite(hertz)) and np.all(hertz > 0.0)):
        raise InputError(message(f"frequency is {frequency!r}", "It must be finite and above zero (Hz)"))
    names = (branches,) if isinstance(branches, str) else tuple(branches)
    if isinstance(state, SimulatedState):
        _simulated_tensor(state, finite_overlap)
    unknown = [name for name in names if name not in ("longitudinal", "transverse")]
    if unknown or not names:
        raise InputError(message(f"unknown branch {unknown}", mend="Use longitudinal, transverse or both"))
    d = state.packing.diameter
    try:
        pairs = [np.broadcast_arrays(2.0 * np.pi * hertz * d / scale, scale) for scale in _scales(state, direction, names)]
    except ValueError:
        raise InputError(
            message(f"frequencies of shape {hertz.shape} do not go with loads of shape {state.shape}")
        ) from None
    target, scale = (np.stack(rows) for rows in zip(*pairs, strict=True))
    wavenumber, group = np.empty((2, *target.shape))
    # in the paper's limit one dispersion relation serves all loads; with finite overlap each load has its own
    parts: list[tuple[ContactState, tuple[Any, ...]]] = [(state, (...,))]
    if finite_overlap and state.shape:
        force, overlap, stiffness = (
            np.broadcast_to(x, target.shape[1:]) for x in (state.force, state.overlap, state.normal_stiffness)
        )
        every = ContactState(state.packing, state.medium, state.law, force, overlap, stiffness, True)
        parts = [(every[index], index) for index in np.ndindex(target.shape[1:])]
    for part, index in parts:
        found = acoustic_branches(contact_lattice(part, finite_overlap), direction)
        for row, name in enumerate(names):
            here = (row, *index)
            q, slope = _on_branch(found[name], np.asarray(target[here]), np.asarray(scale[here] / d))
            wavenumber[here], group[here] = q, slope
    return PulseVelocities(
        names, target / wavenumber * scale, group * scale, wavenumber / d, hertz, as_direction(direction),
        validity(state, finite_overlap).warnings,
    )  # fmt: skip
