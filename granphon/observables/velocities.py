"""Sound velocities, m/s, of long waves and of pulses of finite frequency; elastic moduli, Pa; the
exponent of velocities.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.lattices import as_direction
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, InstabilityError, UnreachableFrequencyError, brief
from granphon.base.memory import require_memory
from granphon.base.progress import Progress, require_progress, silent
from granphon.base.results import Result, held, result_class
from granphon.base.standard_errors import jackknife, standard_error
from granphon.base.validation import finite_array, texts
from granphon.dynamics.branches import AcousticBranch, AcousticBranches, follow_acoustic_branches
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.elasticity import anisotropy, bulk_and_shear, shears, voigt_names
from granphon.media.state import ContactState, State, as_state, given_state
from granphon.observables.validity import find_warnings

if TYPE_CHECKING:
    from granphon.observables.sensitivities import ModuliSensitivities, VelocitySensitivities

#: a strain that is the same along all axes makes a stress; where that differs from a pressure by no
#: more than this part of the bulk modulus, the difference is taken for rounding
_PRESSURE_ROUNDING = 1e-10
#: memory that finding the velocities of one pulse in one branch takes, without that of its
#: dynamical matrix, bytes
_PULSE_BYTES = 900.0
#: memory for each entry of the dynamical matrix of this pulse, bytes
_ENTRY_BYTES = 36.0
#: what to use in place of the moduli of an isotropic lattice
_AVERAGES = "Use .tensor, or the averages over directions .voigt, .reuss and .hill"
#: largest top of a branch, (k/M)^1/2, that is taken for zero with its rounding
_FREQUENCY_ROUNDING = 1e-12


def local_exponent(state: ContactState) -> Any:
    """Return the exponent d log v / d log P of the sound velocities v, with the shape of the load
    of a ``state`` of a medium or crystal.

    In a medium with a contact law both velocities have the same exponent: v goes as the root of the
    normal stiffness k, and the pressure P as the contact force f. The exponent is f k'/2k^2, with
    the slope k' = dk/d(delta) of the medium's law; 1/6 for equal balls. With listed diameters k has
    a kink, and the exponent a spike, where the contacts between two of the diameters open. The
    exponent of a crystal is f k'/2k^2 of its contacts, (a - 1)/2a where f goes as delta^a; by JKR's
    law with friction it has none, as shear and normal stiffness do not grow alike.

    The moduli of a simulation are not all proportional to k. Its exponent is that of the
    longitudinal velocity, which follows from the mean K + G of the samples (K + 4G/3 in space): the
    same samples are solved at two loads, 5 % below and above (after a history of friction 5 % and
    15 % above), and the difference is taken. ``state.exponent_error`` is the standard error over
    the samples: 0 for a medium that does not sample, nan for one sample.

    The exponents of contact laws leave out terms of relative order delta/d. That of a simulation
    with geometry="exact" has all terms, and is the only exponent that scenes and sweeps with
    ``finite_overlap`` have.

    Raises :class:`~granphon.base.errors.ConvergenceError` if a simulation beside the load fails,
    and :class:`~granphon.base.errors.InputError` for a network, whose law is not known, for what is
    no state, and for a crystal whose contacts, or whose shear and normal stiffness, have different
    exponents, or whose contacts are all open.
    """
    exponent = getattr(state, "exponent", None)
    return given_state(state).exponent if exponent is None else exponent


@result_class
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
    warnings : a warning for each limit of the model that the state exceeds; one about balls that
        sound leaves behind, if there are any; and where a velocity is zero, one that counts the
        branches that vanish at every wave vector and says what would stop them.
    longitudinal_error, transverse_error : standard errors over the samples of a simulation, m/s;
        None if there are fewer than two samples.
    out_of_plane : velocity of the wave across a plane of balls, if they move that way: zero,
        because it is a flexural wave.
    velocities : (..., n_u) of all these waves, ascending.
    twist : velocity of the wave in which the balls of a straight chain turn about it; zero where a
        contact does not resist torsion, None if the lattice is no straight chain, if the balls do
        not turn about it, and if springs to the ground act. It displaces nothing, and is not among
        ``velocities``.
    polarisations : (..., n_u, n_u) unit displacements (x, y, z, as far as the balls move) of the
        waves of ``velocities``, in their order, as columns.
    """

    #: the state; None where none is at hand
    _state: ClassVar[State | None] = None

    longitudinal: Any = held(Any, "...?", "m/s")
    transverse: Any = held(Any, "...|... 2?", "m/s")
    direction: Array = held(float, "p|n p", within="finite")
    warnings: tuple[str, ...] = held((str, ...))
    velocities: Array = held(float, "... u", "m/s", "zero or above")
    polarisations: Array = held(float, "... u u")
    longitudinal_error: Any = held(Any, "...?", "m/s", default=None)
    transverse_error: Any = held(Any, "...|... 2?", "m/s", default=None)
    out_of_plane: Any = held(Any, "...?", "m/s", default=None)
    twist: Any = held(Any, "...?", "m/s", default=None)

    @cached_property
    def sensitivities(self) -> VelocitySensitivities:
        """Derivatives of ``velocities`` with respect to the stiffnesses and static forces of all
        n_c contacts, (..., n_u, n_c), to the masses of all balls, (..., n_u, n_balls), and to
        springs to the ground against each motion of these, (..., n_u, n_balls, motions).

        Raises :class:`~granphon.base.errors.InputError` for velocities of a simulation, which are
        means over samples, and for those of a copy or read from a file.
        """
        # velocities alone do not need the derivatives
        from granphon.observables.sensitivities import find_velocity_sensitivities, list_networks

        networks = list_networks(self._state, "sound_velocities")
        # the axes of the load come first, then that of several directions, and that of the waves
        shape = np.shape(self.velocities)[: -np.ndim(self.direction)]
        return find_velocity_sensitivities(networks, shape, self.direction)

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` also if the named waves are not those of
        ``velocities``.
        """
        super()._check()
        load_shape = np.shape(self.velocities)[:-1]
        # the shape of ``transverse`` with no, one or two transverse waves
        shapes = {0: None, 1: load_shape, 2: (*load_shape, 2)}
        count = self._count_transverse()
        shape = None if self.transverse is None else np.shape(self.transverse)
        if count not in shapes or shape != shapes[count]:
            raise InputError(
                "the SoundVelocities data lack a wave that 'velocities' has, or have one more"
            )

    @property
    def transverse_slow(self) -> Any:
        """Velocity of the slow transverse wave, m/s; None where there are not two."""
        return self._take_transverse(0, self.transverse)

    @property
    def transverse_fast(self) -> Any:
        """Velocity of the fast transverse wave, m/s; None where there are not two."""
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
        """Return the number of transverse waves: all waves but the longitudinal one and the one
        across the plane.
        """
        n_waves = int(np.shape(self.velocities)[-1])
        n_named = (self.longitudinal is not None) + (self.out_of_plane is not None)
        return n_waves - n_named

    def _take_transverse(self, number: int, velocities: Any) -> Any:
        """Return the velocity, or its error, of the transverse wave of a ``number``, slow (0) or
        fast (1), from ``velocities`` or errors (..., 2), m/s; None where there are not two waves,
        or no velocities.
        """
        if velocities is None or self._count_transverse() != 2:
            return None
        return np.asarray(velocities)[..., number][()]


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
        quasi-longitudinal and quasi-transverse. A simulation in the plane is isotropic on average
        if its lattice is: its velocities follow from its mean bulk and shear modulus. The
        quasi-longitudinal wave is the one whose displacement is nearest to the direction. The slow
        transverse wave comes before the fast one. If their velocities are equal, as along [100] and
        [111] of a cubic lattice, the first polarisation is along the axis x, y or z farthest from
        the longitudinal one, in this order if several are.
    progress : told how far the factors of a network of many balls have come, which takes long once;
        the network keeps what :func:`moduli` shares with this.

    Raises
    ------
    InputError : ``state`` is no state and has no network; no direction is given and velocities
        depend on it; a direction is not p finite numbers, or has no length; a network repeats
        nowhere, has no contacts, is not at rest, has bodies that do not move and touch balls, or
        has more balls than memory holds; springs to the ground hold the balls; a ``progress`` has
        no method ``step``.
    MechanismError : a motion of the lattice costs no energy.
    InstabilityError : with finite overlap, or static forces of a network, the lattice buckles.
    ConvergenceError : the balls of a large network do not relax.
    """
    state = as_state(state)
    require_progress(progress)
    if direction is not None:  # refused before the relaxation, which may take long
        _ = as_direction(direction, state.reference_lattice.periods)
    state.relax_inner_motions(progress)
    unit_vectors = choose_direction(
        state, direction, "sound velocities", isotropic=state.is_isotropic
    )
    names = state.wave_names
    # (..., n_u) m/s, and (..., n_u, n_u) polarisations as columns, of n_u waves in the order of
    # their names
    velocities, polarisations = state.polarised_waves(unit_vectors)
    ascending = np.argsort(velocities, axis=-1, kind="stable")
    velocity_of_wave = _name_waves(names, velocities)
    error_of_wave = _name_waves(names, state.wave_errors(unit_vectors))
    twist = state.twist_velocity
    if twist is not None and unit_vectors.ndim > 1:
        twist = np.repeat(np.asarray(twist)[..., None], len(unit_vectors), axis=-1)
    warnings = find_warnings(state) + state.reference_lattice.loose_warnings
    warnings += explain_free_branches(state, velocities)
    sound = SoundVelocities(
        longitudinal=velocity_of_wave.get("longitudinal"),
        transverse=velocity_of_wave.get("transverse"),
        direction=unit_vectors,
        warnings=warnings,
        longitudinal_error=error_of_wave.get("longitudinal"),
        transverse_error=error_of_wave.get("transverse"),
        out_of_plane=velocity_of_wave.get("out_of_plane"),
        velocities=np.take_along_axis(velocities, ascending, -1),
        polarisations=np.take_along_axis(polarisations, ascending[..., None, :], -1),
        twist=twist,
    )
    object.__setattr__(sound, "_state", state)
    return sound


def _name_waves(names: tuple[str, ...], velocities: Array | None) -> dict[str, Any]:
    """Return the ``velocities`` (..., n_u), m/s, or their errors, of n_u waves by the ``names``
    (n_u,) of the waves; two transverse waves also together, (..., 2), as "transverse".

    The result is empty if ``velocities`` is None.
    """
    if velocities is None:
        return {}
    velocity_of_wave: dict[str, Any] = {
        name: velocities[..., wave] for wave, name in enumerate(names)
    }
    if "transverse_slow" in names:
        slow = names.index("transverse_slow")  # the fast wave is the next one
        velocity_of_wave["transverse"] = velocities[..., slow : slow + 2]
    return velocity_of_wave


def explain_free_branches(state: State, velocities: Array) -> tuple[str, ...]:
    """Return a sentence, for a warning, that counts the branches of a ``state`` that nothing
    resists; empty if there are none.

    Branches are counted only where one of the ``velocities``, m/s, is zero: a wave across a row or
    a layer has no velocity if it bends the row or layer, or if nothing resists the wave.
    """
    has_zero = np.any(velocities == 0.0)
    return state.reference_lattice.free_branch_warnings if has_zero else ()


def choose_direction(
    state: State, direction: ArrayLike | None, quantity: str, *, isotropic: bool
) -> Array:
    """Return a ``direction`` (p,), or several (n, p), as unit vectors, for a state whose lattice
    has p periods. The direction None is the axis x if the ``quantity`` is ``isotropic``.

    Raises :class:`~granphon.base.errors.InputError` for the direction None of a quantity that is
    not isotropic, and for a direction that is not p finite numbers, or has no length. The
    ``quantity`` is a plural noun for the message.
    """
    periods = state.reference_lattice.periods
    if direction is None:
        if not isotropic:
            fault = f"the {quantity} of the {state.name} depend on the direction"
            raise InputError(fault, mend=f"Give direction=({', '.join('xyz'[:periods])})")
        direction = np.eye(periods)[0]
    return as_direction(direction, periods)


@result_class
class AveragedModuli(Result):
    """Bulk and shear modulus of a body of many grains, averaged over all directions.

    Attributes
    ----------
    bulk, shear : the moduli, Pa, with the shape of the load.
    """

    bulk: Any = held(Any, "...", "Pa")
    shear: Any = held(Any, "...", "Pa")


@result_class
class Moduli(Result):
    """Elastic constants: Pa, in the plane of the layer taken one diameter thick; N on a line.

    Attributes
    ----------
    tensor : (..., v, v), Pa: the shape of the load, then the v strains :attr:`components` in Voigt
        order: xx; xx, yy, xy; or xx, yy, zz, yz, xz, xy.
    isotropic : whether the tensor is the same in all directions. For a simulation on a lattice in
        the plane with that symmetry it is True, though samples are isotropic only on average; in
        space it is False.
    cubic : whether the lattice is square or cubic, in the same sense.
    bulk_error, shear_error : standard errors over the samples of a simulation, Pa, with the shape
        of the load; of the averages :attr:`voigt` where the lattice is not isotropic. None if there
        are fewer than two samples.
    tensor_error : (..., v, v) standard error of each entry of the tensor, Pa; None likewise.
    anisotropy_error : standard error of :attr:`anisotropy`, a pure number with the shape of the
        load; None likewise.
    warnings : one sentence for each limit of the model that the state exceeds, and one about balls
        that have no part in the moduli, if there are any.
    """

    units = {"bulk": "Pa", "shear": "Pa", "shears": "Pa"}
    _notebook_fields = ("bulk", "shear")

    #: the state; None where none is at hand
    _state: ClassVar[State | None] = None

    tensor: Array = held(float, "... 3 3|... 6 6|... 1 1", "Pa", "finite")
    isotropic: bool = held(bool)
    warnings: tuple[str, ...] = held((str, ...))
    bulk_error: Any = held(Any, "...?", "Pa", default=None)
    shear_error: Any = held(Any, "...?", "Pa", default=None)
    tensor_error: Array | None = held(float, "... 3 3|... 6 6|... 1 1?", "Pa", default=None)
    anisotropy_error: Any = held(Any, "...?", "1", default=None)
    cubic: bool = held(bool, default=False)

    def _field_units(self) -> dict[str, str]:
        """Return the SI unit of each field that has one: of a chain moduli are in N."""
        return {
            name: "N" if unit == "Pa" and self.periods == 1 else unit
            for name, unit in self.units.items()
        }

    @cached_property
    def sensitivities(self) -> ModuliSensitivities:
        """Derivatives of ``tensor`` with respect to the stiffnesses and static forces of all
        n_c contacts, (..., v, v, n_c).

        Raises :class:`~granphon.base.errors.InputError` for moduli of a simulation, which are means
        over samples, and for those of a copy or read from a file.
        """
        # moduli alone do not need the derivatives
        from granphon.observables.sensitivities import find_moduli_sensitivities, list_networks

        networks = list_networks(self._state, "moduli")
        return find_moduli_sensitivities(networks, np.shape(self.tensor)[:-2])

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
        # stresses (..., components) under a strain of 1 along each axis: a pressure p K, and what
        # differs from a pressure
        stress = np.sum(self.tensor[..., :p], axis=-1)
        is_along_axis = np.arange(self.tensor.shape[-1]) < p  # xx, yy, zz
        pressure = p * bulk[..., None] * is_along_axis
        deviation = stress - pressure
        if np.any(np.abs(deviation) > _PRESSURE_ROUNDING * np.abs(bulk)[..., None]):
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
        isotropic. Raises :class:`~granphon.base.errors.InputError` if the lattice is not isotropic,
        and for a chain.
        """
        if not self.isotropic:
            raise InputError("this lattice has no single shear modulus", mend=_AVERAGES)
        return self._find_shears()

    @property
    def anisotropy(self) -> Any:
        """Anisotropy of a cubic or square lattice, 2 C44/(C11 - C12) or 2 C33/(C11 - C12); 1 if it
        is isotropic (Zener).

        C44 is the mean of the shear moduli yz, xz, xy, and C11 - C12 the mean over three axes, as
        these differ in a sample of finite size. In the triangular lattice the difference of the
        anisotropy from 1 shows how far samples are from isotropic.

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
        :class:`~granphon.base.errors.InstabilityError` if a strain gives energy back or costs none,
        as it may with finite overlap.
        """
        self._require_shear()
        p = self.periods
        # stresses and strains yz, xz, xy times sqrt 2 make vectors whose length does not depend on
        # the axes (Mandel), so that traces of the stiffness (..., v, v) do not either
        is_along_axis = np.arange(self.tensor.shape[-1]) < p  # xx, yy, zz
        weights = np.where(is_along_axis, 1.0, np.sqrt(2.0))
        stiffness = self.tensor * weights[:, None] * weights
        symmetric_stiffness = 0.5 * (stiffness + stiffness.swapaxes(-1, -2))
        if np.min(np.linalg.eigvalsh(symmetric_stiffness)) <= 0.0:
            raise InstabilityError(
                "the elastic tensor is not positive",
                "A strain gives energy back or costs none",
                "Use .tensor",
            )
        compliance = np.linalg.inv(stiffness)
        # of the v components one is the pressure, and v - 1 are shears, each of compliance 1/2G
        pressure_compliance = np.sum(compliance[..., :p, :p], axis=(-2, -1))
        trace = np.trace(compliance, axis1=-2, axis2=-1)
        shear_compliance = trace - pressure_compliance / p
        n_shears = stiffness.shape[-1] - 1
        shear = n_shears / (2.0 * shear_compliance)
        return AveragedModuli((1.0 / pressure_compliance)[()], shear[()])

    @property
    def hill(self) -> AveragedModuli:
        """The means of :attr:`voigt` and :attr:`reuss` (R. Hill, Proc. Phys. Soc. A 65, 349,
        1952); raises what these raise.
        """
        upper = self.voigt
        lower = self.reuss
        return AveragedModuli(0.5 * (upper.bulk + lower.bulk), 0.5 * (upper.shear + lower.shear))

    def _find_bulk(self) -> Array:
        """Return the mean pressure under a strain that is the same in all directions, over the
        relative change of volume: Pa, with the shape of the load.
        """
        p = self.periods
        along_axes = self.tensor[..., :p, :p]
        return np.asarray(np.sum(along_axes, axis=(-2, -1)) / p**2)

    def _require_shear(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for a chain, which has no shear."""
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

    Parameters
    ----------
    state : a state, a sample or a network, as in :func:`sound_velocities`.
    progress : as in :func:`sound_velocities`.

    Returns
    -------
    :class:`Moduli`, in Pa, in the plane of the layer taken one diameter thick. A chain has one
    modulus, its ``bulk``, in N. Of a network that repeats along one axis, such as a ribbon, the
    modulus is the force over the strain, N; along two, such as a slab of any thickness, moduli are
    the force per length over the strain and one mean diameter, Pa.

    With finite overlap moduli are the coefficients between Cauchy stress and strain under the
    static pressure, for which equation (16) still holds. Under a static stress that is no pressure,
    as in a network with ``prestress``, the tensor of these coefficients is not symmetric.

    Raises
    ------
    InputError : ``state`` is no state and has no network; balls do not move along the lattice;
        springs to the ground hold the balls or resist their rotations; a network that
        :func:`sound_velocities` refuses; a ``progress`` has no method ``step``.
    MechanismError : a motion of the lattice costs no energy.
    InstabilityError : with finite overlap, or static forces of a network, some strain has a modulus
        below zero, or moves balls in a way whose energy is negative.
    ConvergenceError : the balls of a large network do not relax.
    """
    state = as_state(state)
    require_progress(progress)
    state.relax_inner_motions(progress)
    errors: dict[str, Any] = {}
    tensor = state.elastic_tensor
    isotropic = state.is_isotropic
    cubic = state.has_cubic_axes
    samples = state.sampled_tensors  # (..., n_samples, v, v), Pa
    if samples is not None:
        averages_error = standard_error(bulk_and_shear(samples), -2)  # (..., 2)
        errors["bulk_error"], errors["shear_error"] = np.moveaxis(averages_error, -1, 0)
        errors["tensor_error"] = standard_error(samples, -3)
        is_chain = tensor.shape[-1] == 1
        if (isotropic or cubic) and not is_chain:
            errors["anisotropy_error"] = jackknife(anisotropy, shears(samples))
    warnings = find_warnings(state) + state.reference_lattice.loose_warnings
    result = Moduli(tensor=tensor, isotropic=isotropic, warnings=warnings, cubic=cubic, **errors)
    object.__setattr__(result, "_state", state)
    return result


@result_class
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

    branches: tuple[str, ...] = held((str, ...), "b")
    phase: Array = held(float, "*", "m/s")
    group: Array = held(float, "*", "m/s")
    group_vector: Array = held(float, "*", "m/s")
    wavenumber: Array = held(float, "*", "rad/m")
    frequency: Any = held(Any, unit="Hz")
    direction: Array = held(float, "p|n p")
    warnings: tuple[str, ...] = held((str, ...))


def pulse_velocities(
    state: Any,
    frequency: ArrayLike,
    direction: ArrayLike | None = None,
    branches: str | Sequence[str] | None = None,
) -> PulseVelocities:
    """Return phase and group velocity of the acoustic branches at a given frequency, m/s.

    Both differ from the velocity of long waves. Mostly they are below it, and fall as the frequency
    rises; along some rows of balls that rotate a transverse branch rises faster than its long wave,
    as along x in the square lattice, and both are above. Where the velocity of long waves is zero,
    waves of finite length travel across a plane or a chain of balls if contacts resist torsion or
    bending.

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
    InputError : what is no state and has no network; a network that :func:`sound_velocities`
        refuses; springs to the ground that hold the balls; a frequency that is not finite
        and above zero, or so low that it has lost digits; an unknown branch, or an empty list; no
        direction where velocities depend on it; a direction that is not p finite numbers or has no
        length; frequencies whose shape does not broadcast against the load; more pulses than fit
        into memory.
    MechanismError : a motion of the lattice costs no energy.
    InstabilityError : with finite overlap, or static forces of a network, the lattice buckles.
    ConvergenceError : the balls of a large network do not relax.
    GranphonError : a branch cannot be followed through an avoided crossing.
    """
    state = as_state(state)
    hertz = finite_array("frequency", frequency, "Hz", "above zero")
    d = state.unit_length
    unit_vectors = _choose_pulse_direction(state, direction)
    names = _choose_branches(state, unit_vectors, branches)
    load_shape = _broadcast_loads(hertz, state)
    pulse_shape = load_shape + unit_vectors.shape[:-1]
    _require_pulse_memory(state, len(names) * math.prod(pulse_shape))
    # (b, ...): velocities, m/s, that are one in the reduced units of each of the b branches
    scales = state.branch_scales(unit_vectors, names)
    scale = np.stack([np.broadcast_to(branch_scale, pulse_shape) for branch_scale in scales])
    targets = _reduce_frequencies(hertz, unit_vectors.ndim - 1, scale, d)
    lattices = _list_lattices(state, load_shape)
    wavenumbers, group_vectors = _solve_lattices(lattices, unit_vectors, names, targets, scale / d)
    group = np.sum(group_vectors * unit_vectors, axis=-1)
    return PulseVelocities(
        branches=names,
        phase=targets / wavenumbers * scale,
        group=group * scale,
        group_vector=group_vectors * scale[..., None],
        wavenumber=wavenumbers / d,
        frequency=hertz,
        direction=unit_vectors,
        warnings=find_warnings(state),
    )


def _choose_pulse_direction(state: State, direction: ArrayLike | None) -> Array:
    """Return the ``direction`` of pulses as :func:`choose_direction` does. None is x on a chain,
    and where sound in the plane of the lattice is isotropic.
    """
    has_isotropic_sound = "longitudinal" in state.wave_names and state.is_isotropic
    is_chain = state.reference_lattice.periods == 1
    return choose_direction(state, direction, "pulses", isotropic=is_chain or has_isotropic_sound)


def _broadcast_loads(hertz: Array, state: State) -> tuple[int, ...]:
    """Return the shape to which the frequencies ``hertz`` and the loads broadcast; raise
    :class:`InputError` for shapes that do not.
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
    memory = (_PULSE_BYTES + _ENTRY_BYTES * state.reference_lattice.n_branches**2) * count
    require_memory(
        f"velocities of {count:,} pulses", memory, "Take fewer frequencies, loads or directions"
    )


def _reduce_frequencies(hertz: Array, n_axes: int, scale: Array, d: float) -> Array:
    """Return the angular frequencies of ``hertz``, Hz, in reduced units, of the shape of ``scale``.

    ``scale`` (b, ...) holds the velocities, m/s, that are one in reduced units: on b branches, at
    the loads and frequencies, and in several directions along a last axis. ``n_axes``, 0 or 1, is
    the number of these last axes, which ``hertz`` does not have. The unit of length is d, m. Raises
    :class:`InputError` for frequencies that are too low to have digits.
    """
    hertz_per_direction = hertz.reshape(hertz.shape + (1,) * n_axes)
    with np.errstate(over="ignore"):  # infinity is beyond every branch, too
        reduced = hertz_per_direction * (2.0 * np.pi * d / scale)
    if np.min(reduced) < np.finfo(float).tiny:
        raise InputError(
            f"a frequency of {np.min(hertz):.6g} Hz has lost digits in double precision",
            mend="Raise it: the velocities are those of long waves, gp.sound_velocities",
        )
    return np.asarray(reduced)


def _list_lattices(state: Any, load_shape: tuple[int, ...]) -> list[tuple[Any, slice]]:
    """Return the states that have a lattice of their own, each with the slice of the pulses that
    run in it; pulses are numbered along the loads and frequencies of ``load_shape``, flattened.

    In the paper's limit all loads share one dispersion relation; with finite overlap, or the
    torsion of a Hertz contact, each load has its own.
    """
    if state.has_one_lattice:
        return [(state, slice(None))]
    n_loads = math.prod(state.shape)
    states = [state[np.unravel_index(load, state.shape)] for load in range(n_loads)]
    load_numbers = np.arange(n_loads).reshape(state.shape)
    load_of_pulse = np.broadcast_to(load_numbers, load_shape).ravel().tolist()
    return [(states[load], slice(pulse, pulse + 1)) for pulse, load in enumerate(load_of_pulse)]


def _choose_branches(
    state: State, directions: Array, branches: str | Sequence[str] | None
) -> tuple[str, ...]:
    """Return the names of the branches of pulses; by default those whose long waves have a velocity
    above zero in all ``directions`` (..., p), or all if there are none. InputError for an unknown
    name, and for no name.
    """
    names = state.wave_names
    if branches is None:
        velocities = state.long_waves(directions).reshape(-1, len(names))
        is_moving = np.all(velocities > 0.0, axis=0)
        moving_names = tuple(name for name, moves in zip(names, is_moving, strict=True) if moves)
        return moving_names or names
    requested_names = texts("branches", branches)
    unknown_names = [name for name in requested_names if name not in names]
    if not requested_names:
        raise InputError("branches is an empty list", mend=f"Use {', '.join(names)}")
    if unknown_names:
        allowed = ", ".join(names)
        if names == ("longitudinal", "transverse"):
            allowed = "longitudinal, transverse or both"
        raise InputError(f"unknown branch {brief(unknown_names)}", mend=f"Use {allowed}")
    return requested_names


def _solve_lattices(
    lattices: list[tuple[Any, slice]],
    directions: Array,
    names: Sequence[str],
    targets: Array,
    units: Array,
) -> tuple[Array, Array]:
    """Return the wavenumbers (b, ...) and the group velocities (b, ..., p), in reduced units, of
    pulses on the b branches ``names``: "..." are the axes of loads and frequencies, and then, for
    ``directions`` (n, p) instead of one (p,), an axis of n.

    ``targets`` (b, ...) holds angular frequencies in ``units`` (b, ...), rad/s; ``lattices`` are
    those of :func:`_list_lattices`.
    """
    periods = directions.shape[-1]
    several_directions = directions.reshape(-1, periods)
    # axes of branches, of m loads and frequencies, and of n directions
    three_axes = (len(names), -1, len(several_directions))
    reduced = targets.reshape(three_axes)
    rates = units.reshape(three_axes)
    wavenumbers = np.empty(reduced.shape)
    group_vectors = np.empty((*reduced.shape, periods))
    for state, pulses in lattices:
        wavenumbers[:, pulses], group_vectors[:, pulses] = _find_wavenumbers(
            state.contact_lattice(),
            several_directions,
            names,
            reduced[:, pulses],
            rates[:, pulses],
        )
    return wavenumbers.reshape(targets.shape), group_vectors.reshape(*targets.shape, periods)


def _find_wavenumbers(
    lattice: ContactLattice, directions: Array, names: Sequence[str], targets: Array, units: Array
) -> tuple[Array, Array]:
    """Return wavenumbers (b, m, n) and group velocities (b, m, n, p), in reduced units, of the
    branches ``names`` (b,) in ``directions`` (n, p).

    ``targets`` (b, m, n) holds angular frequencies in ``units`` (b, m, n), rad/s. Raises
    :class:`~granphon.base.errors.UnreachableFrequencyError` for one above the top of its branch,
    and :class:`~granphon.base.errors.GranphonError` where a branch cannot be followed through an
    avoided crossing.
    """
    waves = [lattice.wave_names.index(name) for name in names]
    highest_targets = np.full((len(lattice.wave_names), len(directions)), -np.inf)
    highest_targets[waves] = targets.max(axis=1)
    branches = AcousticBranches.follow(lattice, directions, highest_targets)
    wavenumbers = np.empty(targets.shape)
    group_vectors = np.empty((*targets.shape, directions.shape[1]))
    for b, wave in enumerate(waves):
        # directions are solved together where all frequencies are at most that of the last point
        # before the maximum of the branch, and one by one otherwise
        is_beyond = highest_targets[wave] > _find_last_frequencies(branches, wave)
        rising = np.flatnonzero(~is_beyond)
        if rising.size:
            wavenumbers[b][:, rising], group_vectors[b][:, rising] = _find_rising(
                branches, wave, rising, targets[b][:, rising]
            )
        for n in np.flatnonzero(is_beyond).tolist():
            target = targets[b, :, n]
            branch = branches.take_branch(wave, n)
            if np.any(target > branch.top):
                raise _explain_unreachable(branch, target, units[b, :, n])
            wavenumbers[b, :, n], group_vectors[b, :, n] = branch.find_pulse(target)
    return wavenumbers, group_vectors


def _find_rising(
    branches: AcousticBranches, wave: int, rising: Index, targets: Array
) -> tuple[Array, Array]:
    """Return the reduced wavenumbers (m, r) and group velocities (m, r, p) on the branch number
    ``wave`` in the directions with the numbers ``rising`` (r,), one or more, for reduced angular
    frequencies ``targets`` (m, r) that the branch reaches before its maximum.
    """
    direction_of_target = np.broadcast_to(rising, targets.shape).ravel()
    wavenumbers, velocities = branches.find_wavenumber(wave, direction_of_target, targets.ravel())
    return wavenumbers.reshape(targets.shape), velocities.reshape(*targets.shape, -1)


def _find_last_frequencies(branches: AcousticBranches, wave: int) -> Array:
    """Return the reduced angular frequency (n,) at the last point before the maximum of the branch
    number ``wave``, in each direction; zero where the first point is the maximum.
    """
    n_rising = branches.n_rising[wave]
    directions = np.arange(len(n_rising))
    # without such points the index -1 takes some other frequency, in whose place zero is returned
    last_frequencies = branches.frequencies[wave, directions, n_rising - 1]
    return np.where(n_rising > 0, last_frequencies, 0.0)


def _explain_unreachable(
    branch: AcousticBranch, targets: Array, units: Array
) -> UnreachableFrequencyError:
    """Return the error for reduced angular frequencies ``targets`` (m,), of which some are above
    the top of the ``branch``; ``units`` (m,) are the units of these, rad/s. Of the frequencies
    above the top, the error names the highest, and the top of the branch at the load of this
    frequency. If the top is zero, the error says that the branch has no pulses, and what would give
    it some.
    """
    components = ", ".join(f"{component:.6g}" for component in branch.direction)
    along = f"in direction ({components})"
    if branch.top <= _FREQUENCY_ROUNDING:

        def travels(stiffer: ContactLattice) -> bool:
            """Return whether the waves of the branch cost energy in a ``stiffer`` lattice."""
            branches = follow_acoustic_branches(stiffer, branch.direction)
            return branch.name in branches and branches[branch.name].top > _FREQUENCY_ROUNDING

        remedy = branch.lattice.find_remedy(travels)
        return UnreachableFrequencyError(
            f"the {branch.name} branch has no pulses {along}",
            "Its waves cost no energy there, as they deform no contact, so that their frequency is"
            " zero",
            f"{remedy.capitalize()}, or name other branches",
        )
    hertz = targets / (2.0 * np.pi) * units
    # a load at which the branch reaches its own, higher frequency has no part in the message
    pulse = int(np.argmax(np.where(targets > branch.top, hertz, -np.inf)))
    top = branch.top / (2.0 * np.pi) * units[pulse]
    at_load = " at the load of this frequency" if np.ptp(units) > 0.0 else ""
    return UnreachableFrequencyError(
        f"the {branch.name} branch does not reach {hertz[pulse]:.6g} Hz {along}",
        f"It ends at {top:.6g} Hz{at_load}",
        "Lower the frequency, or name the branches that reach it",
    )
