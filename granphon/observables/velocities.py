"""Sound velocities, m/s, of long waves and of pulses of finite frequency; elastic moduli, Pa; the
exponent of velocities.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from granphon.array.sample import jackknife, standard_error
from granphon.balls.lattices import as_direction
from granphon.base.arrays import Array
from granphon.base.errors import InputError, InstabilityError, UnreachableFrequencyError, brief
from granphon.base.memory import require_memory
from granphon.base.progress import Progress, silent
from granphon.base.results import Result
from granphon.base.validation import finite_array, texts
from granphon.dynamics.branches import AcousticBranch, AcousticBranches, follow_acoustic_branches
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.elasticity import anisotropy, bulk_and_shear, shears, voigt_names
from granphon.media.state import ContactState, State, as_state, given_state
from granphon.observables.validity import find_warnings

#: a result of several loads
Found = TypeVar("Found", "SoundVelocities", "Moduli")
#: largest part of the stress under an even strain that may differ from a pressure; it allows for
#: rounding
_EVEN = 1e-10
#: memory of the velocities of a pulse in one branch, and of each entry of the matrix of its
#: motions, bytes
_PULSE_BYTES = 900.0
_MODE_BYTES = 36.0
#: what to use in place of the moduli of an isotropic lattice
_AVERAGES = "Use .tensor, or the averages over directions .voigt, .reuss and .hill"
#: top of a branch, (k/M)^1/2, that is zero but for rounding
_NO_FREQUENCY = 1e-12


def local_exponent(state: ContactState) -> Any:
    """Return the exponent d log v / d log P of both sound velocities, with the shape of the load.

    Terms of relative order delta/d are left out of media with a contact law; of a simulation with
    geometry="exact" they are not. With ``finite_overlap`` scenes and sweeps have the exponent of
    such a simulation alone. As v goes as the root of k, and P as f, the exponent is f k'/2k^2, with
    the slope k' = dk/d(delta) of the medium's law; it is 1/6 for equal balls. With listed diameters
    k has a kink, and the exponent a spike, where the contacts between two of the diameters open.

    The moduli of a simulation are not all proportional to k. Its exponent is that of the
    longitudinal velocity, which follows from the mean K + G of the samples: the same samples are
    solved at two loads, 5 % below and above, and the difference is taken. ``state.exponent_error``
    is the standard error over the samples: 0 for a medium that does not sample, nan for one sample.
    That of a crystal is f k'/2k^2 of its contacts, (a - 1)/2a where f goes as delta^a.

    Raises :class:`~granphon.base.errors.ConvergenceError` if a simulation beside the load fails,
    and :class:`~granphon.base.errors.InputError` for a network, whose law is not known, and for a
    crystal whose contacts have different exponents.
    """
    exponent = getattr(state, "exponent", None)
    return given_state(state).exponent if exponent is None else exponent


@dataclass(frozen=True, eq=False, repr=False)
class SoundVelocities(Result):
    """Velocities of long waves, m/s, with the shape of the load followed by the shape of the
    directions.

    Attributes
    ----------
    longitudinal : velocity of the (quasi-)longitudinal wave; None if the balls do not move along
        the lattice.
    transverse : velocity of the (quasi-)transverse wave in the plane; in space, and on a chain that
        moves both ways across itself, (..., 2): the slow and the fast one. None if there is none.
    direction : unit vector (p,), or (n, p).
    warnings : one sentence for each limit of the model that the state exceeds; where a velocity is
        zero, one that counts the branches that vanish at every wave vector and says what would stop
        them.
    longitudinal_error, transverse_error : standard errors over the samples of a simulation, m/s;
        None if there are fewer than two samples.
    out_of_plane : velocity of the wave across a plane of balls, if they move that way: zero,
        because it is a flexural wave.
    velocities : (..., n) of all these waves, ascending.
    twist : velocity of the wave in which the balls of a straight chain turn about it; zero without
        torsion, None if they do not turn. It displaces nothing, and is not among ``velocities``.
    polarisations : (..., n, n) their unit displacements (x, y, z, as far as the balls move), as
        columns.
    """

    longitudinal: Annotated[Any, "...?", "m/s"]
    transverse: Annotated[Any, "...|... 2?", "m/s"]
    direction: Annotated[Array, "p|n p", "", "finite"]
    warnings: tuple[str, ...]
    velocities: Annotated[Array, "... u", "m/s", "zero or above"]
    polarisations: Annotated[Array, "... u u"]
    longitudinal_error: Annotated[Any, "...?", "m/s"] = None
    transverse_error: Annotated[Any, "...|... 2?", "m/s"] = None
    out_of_plane: Annotated[Any, "...?", "m/s"] = None
    twist: Annotated[Any, "...?", "m/s"] = None

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` also if the named waves are not those of
        ``velocities``.
        """
        super()._check()
        load = np.shape(self.velocities)[:-1]
        count = self._count_transverse()
        shapes = [None, load, (*load, 2)]
        shape = None if self.transverse is None else np.shape(self.transverse)
        if not 0 <= count <= 2 or shape != shapes[count]:
            raise InputError(
                "the SoundVelocities data lack a wave that 'velocities' has, or have one more"
            )

    @property
    def transverse_slow(self) -> Any:
        """The slow transverse wave, m/s, where there are two; else None."""
        return self._take_transverse(0, self.transverse)

    @property
    def transverse_fast(self) -> Any:
        """The fast transverse wave, m/s, where there are two; else None."""
        return self._take_transverse(1, self.transverse)

    @property
    def transverse_slow_error(self) -> Any:
        """Standard error of :attr:`transverse_slow`, m/s; None where there are not two waves, or
        not two samples.
        """
        return self._take_transverse(0, self.transverse_error)

    @property
    def transverse_fast_error(self) -> Any:
        """Standard error of :attr:`transverse_fast`, m/s; None where there are not two waves, or
        not two samples.
        """
        return self._take_transverse(1, self.transverse_error)

    def _count_transverse(self) -> int:
        """Return the number of transverse waves: all waves but those with other names."""
        named = [wave for wave in (self.longitudinal, self.out_of_plane) if wave is not None]
        return int(np.shape(self.velocities)[-1]) - len(named)

    def _take_transverse(self, number: int, values: Any) -> Any:
        """Return the value of the slow (0) or the fast (1) wave; None where there are not two."""
        if values is None or self._count_transverse() != 2:
            return None
        return np.asarray(values)[..., number][()]


def sound_velocities(
    state: Any, direction: ArrayLike | None = None, *, progress: Progress = silent
) -> SoundVelocities:
    """Return the velocities of sound, m/s, in the limit of long waves (equations 13, 14, 16).

    Parameters
    ----------
    state : the state of the contacts, at one load or many; the state of a crystal, a sample, or a
        :class:`~granphon.ContactNetwork`, that repeats along one axis or more. Waves run along the
        periods: along the one of a ribbon, in any direction of the plane of a slab.
    direction : direction of propagation, Cartesian, (p,) for a lattice with p periods, or (n, p)
        for many at once, whose axis follows those of the load. It may be left out where sound is
        isotropic, as on the triangular lattice and on a chain. On other lattices the waves are
        quasi-longitudinal and quasi-transverse. A simulation is isotropic on average: its
        velocities follow from its mean bulk and shear modulus. The quasi-longitudinal wave is the
        one whose displacement is nearest to the direction. The slow transverse wave comes before
        the fast one. If their velocities are equal, as along [100] and [111] of a cubic lattice,
        the first polarisation is along the axis x, y or z farthest from the longitudinal one, in
        this order if several are.
    progress : told how far the factors of a network of many balls have come, which takes long once;
        the network keeps what :func:`moduli` shares with this.

    Raises
    ------
    InputError : no direction is given and velocities depend on it; a direction is not p finite
        numbers, or has no length; a network repeats nowhere, or has bodies that do not move.
    MechanismError : a motion of the lattice costs no energy.
    InstabilityError : with finite overlap, the lattice buckles.
    """
    state = as_state(state)
    state.relax_inner_motions(progress)
    along = choose_direction(state, direction, "sound velocities", state.is_isotropic)
    names = state.wave_names
    v, vectors = state.polarised_waves(along)
    order = np.argsort(v, axis=-1, kind="stable")
    named = _name_values(names, v)
    errors = _name_values(names, state.wave_errors(along))
    twist = state.twist_velocity
    if twist is not None and along.ndim > 1:
        twist = np.repeat(np.asarray(twist)[..., None], len(along), axis=-1)
    return SoundVelocities(
        longitudinal=named.get("longitudinal"),
        transverse=named.get("transverse"),
        direction=along,
        warnings=find_warnings(state)
        + state.reference_lattice.loose_warnings
        + warn_of_free_branches(state, v),
        longitudinal_error=errors.get("longitudinal"),
        transverse_error=errors.get("transverse"),
        out_of_plane=named.get("out_of_plane"),
        velocities=np.take_along_axis(v, order, -1),
        polarisations=np.take_along_axis(vectors, order[..., None, :], -1),
        twist=twist,
    )


def _name_values(names: tuple[str, ...], values: Array | None) -> dict[str, Any]:
    """Return values (..., n) of waves by the names (n,), with both transverse waves together under
    "transverse"; empty if there are none.
    """
    if values is None:
        return {}
    named: dict[str, Any] = {name: values[..., n] for n, name in enumerate(names)}
    if "transverse_slow" in names:
        first = names.index("transverse_slow")
        named["transverse"] = values[..., first : first + 2]
    return named


def warn_of_free_branches(state: State, velocities: Array) -> tuple[str, ...]:
    """Return a sentence that counts the branches that nothing resists, or none.

    A wave across a row or a layer has no velocity because it bends, or because nothing resists it;
    so only where one of the ``velocities`` is zero are branches counted.
    """
    return state.reference_lattice.free_branch_warnings if np.any(velocities == 0.0) else ()


def choose_direction(
    state: State, direction: ArrayLike | None, what: str, isotropic: bool
) -> Array:
    """Return the direction as unit vectors (p,) or (n, p): x if it is None.

    None is an :class:`~granphon.base.errors.InputError` unless ``what``, which has the direction,
    is ``isotropic``.
    """
    periods = state.reference_lattice.periods
    if direction is None and not isotropic:
        mend = f"Give direction=({', '.join('xyz'[:periods])})"
        raise InputError(f"the {what} of the {state.name} depend on the direction", mend=mend)
    return as_direction(np.eye(periods)[0] if direction is None else direction, periods)


@dataclass(frozen=True, eq=False, repr=False)
class AveragedModuli(Result):
    """Bulk and shear modulus of a body of many grains, averaged over all directions.

    Attributes
    ----------
    bulk, shear : the moduli, Pa, with the shape of the load.
    """

    bulk: Annotated[Any, "...", "Pa"]
    shear: Annotated[Any, "...", "Pa"]


@dataclass(frozen=True, eq=False, repr=False)
class Moduli(Result):
    """Elastic constants: Pa, in the plane of the layer taken one diameter thick; N on a line.

    Attributes
    ----------
    tensor : (..., n, n), Pa: the shape of the load, then the strains :attr:`components` in Voigt
        order: xx; xx, yy, xy; or xx, yy, zz, yz, xz, xy.
    isotropic : whether the tensor is the same in all directions. For a simulation it is True,
        though samples are isotropic only on average.
    cubic : whether the lattice is square or cubic, in the same sense.
    bulk_error, shear_error : standard errors over the samples of a simulation, Pa, with the shape
        of the load; of the averages :attr:`voigt` where the lattice is not isotropic. None if there
        are fewer than two samples.
    tensor_error : (..., n, n) standard error of each entry of the tensor, Pa; None likewise.
    anisotropy_error : standard error of :attr:`anisotropy`, a pure number with the shape of the
        load; None likewise.
    warnings : one sentence for each limit of the model that the state exceeds.
    """

    units = {"bulk": "Pa", "shear": "Pa", "shears": "Pa"}
    _notebook_fields = ("bulk", "shear")

    tensor: Annotated[Array, "... 3 3|... 6 6|... 1 1", "Pa", "finite"]
    isotropic: bool
    warnings: tuple[str, ...]
    bulk_error: Annotated[Any, "...?", "Pa"] = None
    shear_error: Annotated[Any, "...?", "Pa"] = None
    tensor_error: Annotated[Array | None, "... 3 3|... 6 6|... 1 1?", "Pa"] = None
    anisotropy_error: Annotated[Any, "...?", "1"] = None
    cubic: bool = False

    def _field_units(self) -> dict[str, str]:
        return {
            name: "N" if unit == "Pa" and self.periods == 1 else unit
            for name, unit in self.units.items()
        }

    @property
    def periods(self) -> int:
        """Number p of periods of the lattice, to which the strains belong."""
        return {1: 1, 3: 2, 6: 3}[self.tensor.shape[-1]]

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the strains along the rows and columns of ``tensor``, such as "xx"."""
        return voigt_names(self.periods)

    @property
    def bulk(self) -> Any:
        """Bulk modulus K, Pa (equation 17): pressure over relative change of area or volume. Of a
        chain its modulus, N.

        Raises :class:`~granphon.base.errors.InputError` if the strain under pressure is not the
        same in all directions.
        """
        bulk = self._find_bulk()
        p = self.periods
        if self.isotropic or self.cubic:
            return bulk[()]
        # the stress under a strain that is the same in all directions, without its mean pressure
        stress = np.sum(self.tensor[..., :p], axis=-1) - p * bulk[..., None] * (
            np.arange(self.tensor.shape[-1]) < p
        )
        if np.any(np.abs(stress) > _EVEN * np.abs(bulk)[..., None]):
            raise InputError(
                "this lattice has no single bulk modulus",
                "Its strain under pressure is not even",
                _AVERAGES,
            )
        return bulk[()]

    @property
    def shear(self) -> Any:
        """Shear modulus G, Pa (equation 17), the mean of :attr:`shears`.

        Raises :class:`~granphon.base.errors.InputError` if the lattice is not isotropic, and for a
        chain.
        """
        return np.mean(self.shears, axis=-1)[()]

    @property
    def shears(self) -> Array:
        """Shear moduli, Pa: (..., 2) of the shears xx - yy and xy; in space (..., 5) of 2zz - xx -
        yy, xx - yy, yz, xz, xy.

        In a sample of finite size they differ; the difference shows how far the sample is from
        isotropic. Raises
        :class:`~granphon.base.errors.InputError` if the lattice is not isotropic, and for a chain.
        """
        if not self.isotropic:
            raise InputError("this lattice has no single shear modulus", mend=_AVERAGES)
        return self._find_shears()

    @property
    def anisotropy(self) -> Any:
        """Anisotropy of a cubic or square lattice, 2 C44/(C11 - C12) or 2 C33/(C11 - C12); 1 if it
        is isotropic (Zener).

        C44 is the mean of the shear moduli yz, xz, xy, and C11 - C12 the mean over three axes; they
        differ in a sample of finite size. So its distance from 1 in the triangular lattice shows
        how far samples are from isotropic.

        Raises :class:`~granphon.base.errors.InputError` if the lattice is neither isotropic nor
        square or cubic, and for a chain.
        """
        self._require_shear()
        if not (self.isotropic or self.cubic):
            why = "One number says how far cubic and square lattices are from isotropic"
            raise InputError("this lattice has no single anisotropy", why, "Use .tensor")
        return anisotropy(self._find_shears())[()]

    @property
    def voigt(self) -> AveragedModuli:
        """The moduli of grains in all directions under the same strain: the upper limit (W. Voigt,
        1889).

        Raises :class:`~granphon.base.errors.InputError` for a chain.
        """
        return AveragedModuli(self._find_bulk()[()], np.mean(self._find_shears(), axis=-1)[()])

    @property
    def reuss(self) -> AveragedModuli:
        """The moduli of grains in all directions under the same stress: the lower limit (A. Reuss,
        1929).

        Raises :class:`~granphon.base.errors.InputError` for a chain, and
        :class:`~granphon.base.errors.InstabilityError` if a strain gives energy back, as it may
        with finite overlap.
        """
        self._require_shear()
        p = self.periods
        # with strains yz, xz, xy times sqrt 2 it is a matrix between vectors
        size = np.where(np.arange(self.tensor.shape[-1]) < p, 1.0, np.sqrt(2.0))
        stiffness = self.tensor * size[:, None] * size
        if np.min(np.linalg.eigvalsh(0.5 * (stiffness + stiffness.swapaxes(-1, -2)))) <= 0.0:
            raise InstabilityError(
                "the elastic tensor is not positive", "A strain gives energy back", "Use .tensor"
            )
        compliance = np.linalg.inv(stiffness)
        under_pressure = np.sum(compliance[..., :p, :p], axis=(-2, -1))
        under_shear = np.trace(compliance, axis1=-2, axis2=-1) - under_pressure / p
        shear = (stiffness.shape[-1] - 1) / (2.0 * under_shear)
        return AveragedModuli((1.0 / under_pressure)[()], shear[()])

    @property
    def hill(self) -> AveragedModuli:
        """The means of :attr:`voigt` and :attr:`reuss` (R. Hill, Proc. Phys. Soc. A 65, 349,
        1952).
        """
        upper = self.voigt
        lower = self.reuss
        return AveragedModuli(0.5 * (upper.bulk + lower.bulk), 0.5 * (upper.shear + lower.shear))

    def _find_bulk(self) -> Array:
        """Return the mean pressure under a strain that is the same in all directions, over the
        change of volume.
        """
        return np.asarray(
            np.sum(self.tensor[..., : self.periods, : self.periods], axis=(-2, -1))
            / self.periods**2
        )

    def _require_shear(self) -> None:
        if self.periods == 1:
            raise InputError("a chain has no shear modulus", mend="Use .bulk, its modulus in N")

    def _find_shears(self) -> Array:
        """Return the shear moduli of an orthonormal set of shears, (..., 2), or (..., 5) in space;
        Pa.
        """
        self._require_shear()
        return shears(self.tensor)


def moduli(state: Any, *, progress: Progress = silent) -> Moduli:
    """Return the elastic moduli: the tensor, with bulk and shear modulus where they exist (equation
    17), and averages.

    They are in Pa, in the plane of the layer taken one diameter thick; a chain has one modulus, in
    N, which is its ``bulk``. ``state`` is a state, a sample or a network, and ``progress`` is told
    how far it is, as in :func:`sound_velocities`. Of a network that repeats along one axis, such as
    a ribbon, the modulus is the force over the strain, N; along two, such as a slab of any
    thickness, moduli are the force per length over the strain and one mean diameter, Pa. Raises
    :class:`~granphon.base.errors.InputError` if balls do not move along the lattice, and
    :class:`~granphon.base.errors.MechanismError` if a motion of the lattice costs no energy.

    With finite overlap these are the coefficients between Cauchy stress and strain under the static
    pressure, for which equation (16) still holds. Under a static stress that is no pressure, as in
    a network with ``prestress``, the tensor of these coefficients is not symmetric.
    """
    state = as_state(state)
    state.relax_inner_motions(progress)
    errors: dict[str, Any] = {}
    tensor = state.elastic_tensor
    isotropic = state.is_isotropic
    cubic = state.has_cubic_axes
    samples = state.sampled_tensors
    if samples is not None:
        averages_error = standard_error(bulk_and_shear(samples), -2)
        errors["bulk_error"], errors["shear_error"] = np.moveaxis(averages_error, -1, 0)
        errors["tensor_error"] = standard_error(samples, -3)
        if (isotropic or cubic) and tensor.shape[-1] > 1:
            errors["anisotropy_error"] = jackknife(anisotropy, shears(samples))
    warnings = find_warnings(state) + state.reference_lattice.loose_warnings
    return Moduli(tensor=tensor, isotropic=isotropic, warnings=warnings, cubic=cubic, **errors)


@dataclass(frozen=True, eq=False, repr=False)
class PulseVelocities(Result):
    """Phase and group velocity of a pulse of given frequency, m/s.

    Attributes
    ----------
    branches : names of the branches, along the first axis of all arrays; then come loads and
        frequencies, then directions.
    phase : (n_branches, ...) phase velocity, m/s.
    group : (n_branches, ...) m/s, the component of the group velocity along the wave vector, d
        omega/dq in its direction.
    group_vector : (n_branches, ..., p) m/s, the group velocity itself: the direction and speed of
        the flow of energy. Where two branches coincide along an axis of symmetry it is the mean of
        both.
    wavenumber : (n_branches, ...) rad/m.
    frequency : the given frequencies, Hz.
    direction : unit vector of the wave vector, (p,) or (n, p).
    warnings : one sentence for each limit of the model that the state exceeds.
    """

    branches: Annotated[tuple[str, ...], "b"]
    phase: Annotated[Array, "", "m/s"]
    group: Annotated[Array, "", "m/s"]
    group_vector: Annotated[Array, "", "m/s"]
    wavenumber: Annotated[Array, "", "rad/m"]
    frequency: Annotated[Any, "", "Hz"]
    direction: Annotated[Array, "p|n p"]
    warnings: tuple[str, ...]


def pulse_velocities(
    state: Any,
    frequency: ArrayLike,
    direction: ArrayLike | None = None,
    branches: str | Sequence[str] | None = None,
) -> PulseVelocities:
    """Return phase and group velocity of the acoustic branches at a given frequency, m/s.

    Both are below the velocity of long waves, except where that is zero: waves of finite length
    travel across a plane or a chain of balls if contacts resist torsion or bending.

    Parameters
    ----------
    state : the state of the contacts, at one load or many; or a sample or network, as in
        :func:`sound_velocities`.
    frequency : Hz; a scalar or an array that broadcasts against the load.
    direction : direction of the wave vector, Cartesian, (p,) for a lattice with p periods, or (n,
        p) for many at once. It may be left out on a chain, and where sound in the plane is
        isotropic, as on the triangular lattice: it is then x. In the named plane lattices (1, 0) is
        along a row of touching balls: Gamma-K of the triangular and kagome lattices (where (0, 1)
        is Gamma-M), and Gamma-X of the square lattice. In cubic ones x is along the cube.
    branches : names of the branches, in the order of the result: "longitudinal" and "transverse";
        in space, and on a chain that moves both ways across itself, "transverse_slow" and
        "transverse_fast"; "out_of_plane" on a plane of balls that move across it
        (:attr:`ContactState.wave_names`). By default those whose long waves have a velocity above
        zero, or all if there are none.

    For a simulation the branches are those of the ideal lattice, each scaled to the long-wave
    velocity of the samples.

    Returns
    -------
    :class:`PulseVelocities`; the wavenumber solves the dispersion relation to rounding. Its
    ``group`` is the component of the group velocity along the wave vector; the vector itself, which
    points elsewhere off the axes of symmetry, is ``group_vector``. Arrays run over the branches,
    then loads and frequencies, then directions, so that ``phase[0]`` belongs to the first branch.

    Raises
    ------
    UnreachableFrequencyError : a branch ends, at its first maximum or the zone edge, below the
        frequency; or its waves cost no energy in that direction.
    InputError : a frequency that is not finite and above zero; an unknown branch; no direction
        where velocities depend on it; a direction that is not p finite numbers or has no length;
        frequencies whose shape does not broadcast against the load.
    MechanismError : a motion of the lattice costs no energy.
    """
    state = as_state(state)
    hertz = finite_array("frequency", frequency, "Hz", "above zero")
    d = state.unit_length
    periods = state.reference_lattice.periods
    even = periods == 1 or ("longitudinal" in state.wave_names and state.is_isotropic)
    along = choose_direction(state, direction, "pulses", even)
    names = _choose_branches(state, along, branches)
    shape = _broadcast_loads(hertz, state)
    pulse_shape = shape + along.shape[:-1]
    _require_pulse_memory(state, len(names) * math.prod(pulse_shape))
    scales = state.branch_scales(along, names)
    scale = np.stack([np.broadcast_to(branch_scale, pulse_shape) for branch_scale in scales])
    target = _reduce_frequencies(hertz, along.ndim - 1, scale, d)
    # shape (branches, loads and frequencies, directions)
    directions = along.reshape(-1, periods)
    flat = (len(names), -1, len(directions))
    target = target.reshape(flat)
    units = scale.reshape(flat) / d
    wavenumber = np.empty(target.shape)
    vector = np.empty((*target.shape, periods))
    for single, pulses in _part_loads(state, shape):
        wavenumber[:, pulses], vector[:, pulses] = _find_wavenumbers(
            single.contact_lattice(), directions, names, target[:, pulses], units[:, pulses]
        )
    group = np.sum(vector * directions, axis=-1)
    phase = (target / wavenumber).reshape(scale.shape) * scale
    return PulseVelocities(
        names,
        phase,
        group.reshape(scale.shape) * scale,
        vector.reshape(*scale.shape, periods) * scale[..., None],
        wavenumber.reshape(scale.shape) / d,
        hertz,
        along,
        find_warnings(state),
    )


def _broadcast_loads(hertz: Array, state: State) -> tuple[int, ...]:
    """Return the shape of frequencies and loads together; raise :class:`InputError` for shapes that
    do not broadcast.
    """
    try:
        return np.broadcast_shapes(hertz.shape, state.shape)
    except ValueError:
        raise InputError(
            f"the frequencies have the shape {hertz.shape}, and the loads {state.shape}",
            mend="Give one frequency, or shapes that numpy can broadcast",
        ) from None


def _require_pulse_memory(state: State, count: int) -> None:
    """Raise :class:`InputError` if the velocities of ``count`` pulses do not fit into memory."""
    memory = (_PULSE_BYTES + _MODE_BYTES * state.reference_lattice.n_branches**2) * count
    require_memory(
        f"velocities of {count:,} pulses", memory, "Take fewer frequencies, loads or directions"
    )


def _reduce_frequencies(hertz: Array, axes: int, scale: Array, d: float) -> Array:
    """Return angular frequencies in reduced units, of the shape of ``scale`` (b, ...).

    ``hertz`` lacks the last ``axes`` axes, those of directions; ``scale`` are the velocities, m/s,
    that are one in reduced units, and d, m, is the unit of length. Raises :class:`InputError` for
    frequencies that are too low to have digits.
    """
    with np.errstate(over="ignore"):  # infinity is beyond every branch, too
        target = hertz.reshape(hertz.shape + (1,) * axes) * (2.0 * np.pi * d / scale)
    if np.min(target) < np.finfo(float).tiny:
        raise InputError(
            f"a frequency of {np.min(hertz):.6g} Hz has lost digits in double precision",
            mend="Raise it: the velocities are those of long waves, gp.sound_velocities",
        )
    return np.asarray(target)


def _part_loads(state: Any, shape: tuple[int, ...]) -> list[tuple[Any, slice]]:
    """Return the states that have a lattice of their own, each with the pulses that run in it: a
    slice of loads and frequencies, of ``shape`` together, in one row.

    In the paper's limit all loads share one dispersion relation; with finite overlap, or the
    torsion of a Hertz contact, each load has its own.
    """
    if state.has_one_lattice:
        return [(state, slice(None))]
    size = math.prod(state.shape)
    states = [state[np.unravel_index(load, state.shape)] for load in range(size)]
    loads = np.broadcast_to(np.arange(size).reshape(state.shape), shape).ravel().tolist()
    return [(states[load], slice(pulse, pulse + 1)) for pulse, load in enumerate(loads)]


def _choose_branches(
    state: State, along: Array, branches: str | Sequence[str] | None
) -> tuple[str, ...]:
    """Return the names of the branches of pulses; by default those whose long waves have a velocity
    above zero in all directions ``along`` (..., p), or all if there are none.
    """
    names = state.wave_names
    if branches is None:
        velocities = state.long_waves(along).reshape(-1, len(names))
        moves = np.all(velocities > 0.0, axis=0)
        moving = tuple(name for name, is_moving in zip(names, moves, strict=True) if is_moving)
        return moving or names
    requested = texts("branches", branches)
    unknown = [name for name in requested if name not in names]
    if unknown or not requested:
        allowed = ", ".join(names)
        if names == ("longitudinal", "transverse"):
            allowed = "longitudinal, transverse or both"
        raise InputError(f"unknown branch {brief(unknown)}", mend=f"Use {allowed}")
    return requested


def _find_wavenumbers(
    lattice: ContactLattice, along: Array, names: Sequence[str], target: Array, scale: Array
) -> tuple[Array, Array]:
    """Find wavenumber (b, m, n) and group velocity (b, m, n, p), in reduced units, in directions
    ``along`` (n, p).

    ``target`` (b, m, n) holds angular frequencies in units of ``scale`` (rad/s).
    """
    waves = [lattice.wave_names.index(name) for name in names]
    highest = np.full((len(lattice.wave_names), len(along)), -np.inf)
    highest[waves] = target.max(axis=1)
    branches = AcousticBranches.follow(lattice, along, highest)
    q = np.empty(target.shape)
    group = np.empty((*target.shape, along.shape[1]))
    directions = np.arange(len(along))
    for b, wave in enumerate(waves):
        # the frequency at the last point before the maximum, in each direction
        rising = branches.rising[wave]
        last = np.where(rising > 0, branches.frequencies[wave, directions, rising - 1], 0.0)
        is_beyond = highest[wave] > last
        # directions are solved together if the frequency is below the last point before the
        # maximum, and one by one otherwise
        inside = np.flatnonzero(~is_beyond)
        if inside.size:
            goals = target[b][:, inside]
            flat = np.broadcast_to(inside, goals.shape).ravel()
            numbers, velocities = branches.find_wavenumber(wave, flat, goals.ravel())
            q[b][:, inside] = numbers.reshape(goals.shape)
            group[b][:, inside] = velocities.reshape(*goals.shape, -1)
        for direction in np.flatnonzero(is_beyond).tolist():
            goal = target[b, :, direction]
            branch = branches.take_branch(wave, direction)
            if np.any(goal > branch.top):
                raise _explain_unreachable(branch, goal, scale[b, :, direction])
            q[b, :, direction], group[b, :, direction] = branch.find_pulse(goal)
    return q, group


def _explain_unreachable(
    branch: AcousticBranch, target: Array, scale: Array
) -> UnreachableFrequencyError:
    """Return the error for angular frequencies (in units of ``scale``, rad/s) above the top of a
    branch.
    """
    components = ", ".join(f"{component:.6g}" for component in branch.direction)
    along = f"in direction ({components})"
    if branch.top <= _NO_FREQUENCY:

        def travels(stiffer: ContactLattice) -> bool:
            branches = follow_acoustic_branches(stiffer, branch.direction)
            return branch.name in branches and branches[branch.name].top > _NO_FREQUENCY

        remedy = branch.lattice.find_remedy(travels)
        return UnreachableFrequencyError(
            f"the {branch.name} branch has no pulses {along}",
            "Its waves cost no energy there, as they deform no contact, so that their frequency is"
            " zero",
            f"{remedy.capitalize()}, or name other branches",
        )
    highest = float(np.max(target / (2.0 * np.pi) * scale))
    top = float(np.min(branch.top * scale)) / (2.0 * np.pi)
    at_load = " at the least load" if np.ptp(scale) > 0.0 else ""
    return UnreachableFrequencyError(
        f"the {branch.name} branch does not reach {highest:.6g} Hz {along}",
        f"It ends at {top:.6g} Hz{at_load}",
        "Lower the frequency, or name the branches that reach it",
    )
