"""States of contacts, from which velocities, moduli, pulses and phonons are found.

Every medium returns the state of the contacts of a packing under load (:class:`ContactState`). A
network of contacts that repeats without end is the state of its cell: of a crystal, of a ribbon, of
a sample (:class:`NetworkState`).
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.contact_laws import PairLaw
from granphon.balls.contact_model import ContactModel
from granphon.balls.hertz import HIGH_PRESSURE_RATIO, HertzLaw
from granphon.balls.packing import MINDLIN, Packing
from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.progress import Progress
from granphon.base.results import Result, held, read_only, result_class
from granphon.base.scales import Units
from granphon.base.text import counted
from granphon.base.validation import require, truth
from granphon.dynamics.compatibility import GYRATION
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.elasticity import has_cubic_axes, is_cubic
from granphon.laws.effective import EffectiveLaw
from granphon.laws.spread import AveragedLaw
from granphon.networks.network import ContactNetwork, given_network, refuse_unpressed

if TYPE_CHECKING:
    from granphon.array.sample import Sample


#: greatest relative difference that is put down to rounding, maybe of another machine: between a
#: number of a state that was read, and the same number as the law and the samples give it
_READ_TOLERANCE = 1e-6
#: a number for a state at a single load, an array for a state at several loads
Values = Any


class ContactLaw(PairLaw, Protocol):
    """The contact law of a medium: the mean force of its contacts as a function of the overlap.

    Methods take scalars or arrays of any shape: floats in, floats out. ``overlap`` is delta, m.
    """

    @property
    def coefficient(self) -> float:
        """Coefficient c of the law of equal balls, N/m^(3/2)."""
        ...

    @property
    def least_overlap(self) -> float:
        """The overlap up to which all balls are apart, m."""
        ...

    def force_fluctuation(self, overlap: ArrayLike) -> Any:
        """Return the force fluctuation Delta f / f, without a unit, at each ``overlap``, m: rms
        deviation, over balls, of the mean force of their contacts from f, over f.
        """
        ...

    def contact_fraction(self, overlap: ArrayLike) -> Any:
        """Return the fraction of contacts that carry load at each ``overlap``, m: N_c / z, with z
        contacts of a ball in the ideal lattice (6 on the triangular lattice).
        """
        ...

    def least_valid_force(self, width: float) -> float:
        """Return the least mean contact force, N, at which the law is valid for diameters of width
        W (m).
        """
        ...


#: type of the result of a function of a state
ResultT = TypeVar("ResultT")
Law = HertzLaw | AveragedLaw | EffectiveLaw | ContactLaw


def ideal_lattice(
    packing: Packing, torsion: float | None = None, bending: float | None = None
) -> ContactLattice:
    """Return the lattice of contacts in the paper's limit, in reduced units.

    ``torsion`` and ``bending``, over k d^2, replace those of the packing if they are given. The
    torsion of a Hertz contact, which depends on the load, is left out unless it is given. All else
    is the same under every load.
    """
    if torsion is None:
        torsion = 0.0 if packing.torsion == MINDLIN else float(packing.torsion)
    if bending is None:
        bending = packing.bending
    return ContactLattice.of(
        packing.structure,
        packing.mindlin_ratio,
        torsion=torsion,
        bending=bending,
        motions=packing.ball_motions,
    )


# -- states ----------------------------------------------------------------------------------------


class State(ABC):
    """A state of contacts, with the attributes that velocities, moduli, pulses and phonons need.

    The contacts are those of a packing, :class:`ContactState`, or of any network with periods,
    :class:`NetworkState`.
    """

    #: whether all contacts have the law of a packing
    follows_law = False

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the lattice, in messages."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of the balls of the cell, (n,); empty if they are not known."""
        return ()

    @property
    @abstractmethod
    def shape(self) -> tuple[int, ...]:
        """Shape of the load; () for a single one."""

    @property
    @abstractmethod
    def scales(self) -> Units:
        """Length (m), stiffness (N/m) and mass (kg) of the reduced units.

        Raises :class:`~granphon.base.errors.InputError` for several loads.
        """

    @abstractmethod
    def require_single(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for a state at several loads."""

    @property
    @abstractmethod
    def unit_length(self) -> float:
        """Unit of length, the same at all loads, m."""

    @property
    @abstractmethod
    def velocity_scale(self) -> Array:
        """Unit of velocity d (k/M)^1/2 at each load, m/s."""

    @property
    @abstractmethod
    def reference_lattice(self) -> ContactLattice:
        """Lattice, in reduced units, of which properties are read that are the same at all loads:
        the names of waves, mechanisms, isotropy.
        """

    @property
    @abstractmethod
    def has_one_lattice(self) -> bool:
        """Whether the lattice, in reduced units, is the same at all loads."""

    @property
    @abstractmethod
    def elastic_tensor(self) -> Array:
        """Elastic tensor in Voigt order, (..., n, n): N on a line, else Pa; a plane is one diameter
        thick.
        """

    @property
    @abstractmethod
    def has_cubic_axes(self) -> bool:
        """Whether the symmetry is that of a square or cube with edges along x, y, z."""

    @property
    @abstractmethod
    def twist_velocity(self) -> Values | None:
        """Velocity at each load, m/s, of the wave in which the balls of a straight chain turn about
        its line; zero where a contact does not resist torsion.

        None if the lattice is no straight chain, if the balls do not turn about its line, or if
        springs to the ground act.
        """

    @abstractmethod
    def contact_lattice(self) -> ContactLattice:
        """Return the lattice of contacts, in reduced units."""

    @abstractmethod
    def polarised_waves(self, direction: ArrayLike) -> tuple[Array, Array]:
        """Return the velocities of :meth:`long_waves` along ``direction``, m/s, and the unit
        displacements of these n_u waves.

        The displacements are the columns of an array (..., n_u, n_u), or (..., n, n_u, n_u) for
        directions (n, p). Raises what :meth:`long_waves` raises.
        """

    def relax_inner_motions(self, progress: Progress) -> None:
        """Relax the inner motions of the lattice, on which moduli and sound depend, and report the
        progress. The lattice keeps the result; with few balls nothing is done, as it takes no time
        later.
        """
        self.reference_lattice.relax_inner_motions(progress)

    def cached(self, find: Callable[..., ResultT], *arguments: Hashable) -> ResultT:
        """Return ``find(self, *arguments)``. The result of the first call is kept, and returned by
        every later call with equal arguments.
        """
        key = (find, *arguments)
        if key not in self._cache:
            self._cache[key] = find(self, *arguments)
        return self._cache[key]  # type: ignore[no-any-return]

    @cached_property
    def _cache(self) -> dict[Any, Any]:
        """The results of :meth:`cached`, by the function and its further arguments."""
        return {}

    @property
    def is_single(self) -> bool:
        """Whether this is the state at one load."""
        return self.shape == ()

    @property
    def is_isotropic(self) -> bool:
        """Whether the elastic tensor is the same in all directions; also True where balls do not
        move along the periods, and no longitudinal wave tells directions apart. Raises
        :class:`~granphon.base.errors.MechanismError` if a motion costs no energy.
        """
        lattice = self.reference_lattice
        return "longitudinal" not in lattice.wave_names or lattice.is_isotropic

    @property
    def sampled_tensors(self) -> Array | None:
        """Elastic tensor of each sample, (..., n_samples, n, n), Voigt order, in the unit of
        :attr:`elastic_tensor`; None of fewer than two samples.
        """
        return None

    @property
    def wave_names(self) -> tuple[str, ...]:
        """Names of the long waves, in the order of :meth:`long_waves`."""
        return self.reference_lattice.wave_names

    def long_waves(self, direction: ArrayLike) -> Array:
        """Return the velocities of the n_u long waves in the order of :attr:`wave_names`, m/s,
        (..., n_u).

        ``direction`` is a vector (p,) of any length. For directions (n, p) the shape is (..., n,
        n_u). In the plane the waves are the longitudinal and the transverse one.

        Raises :class:`~granphon.base.errors.InputError` for a direction that is not p finite
        numbers, or has no length, and :class:`~granphon.base.errors.MechanismError` if a motion
        costs no energy.
        """
        return self.polarised_waves(direction)[0]

    def wave_errors(self, direction: ArrayLike) -> Array | None:
        """Return standard errors over samples of :meth:`long_waves` along ``direction``, m/s; None
        of fewer than two samples.
        """
        return None

    def branch_scales(self, direction: ArrayLike, names: Sequence[str]) -> list[Array]:
        """Return the unit of velocity d (k/M)^1/2, m/s, of each branch of the ``names``; each is an
        array with the shape of the load, (...), or (..., n) for directions (n, p).

        The branches of a law have one unit in common; those of samples have units of their own.
        """
        scale = np.asarray(self.velocity_scale)
        direction_shape = np.shape(direction)[:-1]  # () or (n,)
        with_direction_axis = scale.reshape(scale.shape + (1,) * len(direction_shape))
        common_scale = np.broadcast_to(with_direction_axis, scale.shape + direction_shape)
        return [common_scale for _ in names]


@result_class
class ContactState(State, Result):
    """The contacts of a packing under load. Every attribute has the shape of the load.

    Attributes
    ----------
    packing, medium, law : the packing, the name of the medium that made the state, and its contact
        law.
    force : f, mean contact force, N.
    overlap : delta = d - a, m. The overlap is stored instead of the spacing a, which would lose
        every digit of the overlap.
    normal_stiffness : k = df/d(delta), N/m.
    finite_overlap : whether every result from the state includes the terms of relative order
        delta/d: spacing a = d - delta, lever arm a/2, prestress f/a; pressure and density of a
        boundary that shrinks with the balls.
    chosen_automatically : whether the medium was chosen for its expected error at this load;
        ``valid`` is then True.
    """

    follows_law = True
    units = {
        "shear_stiffness": "N/m",
        "pressure": "N/m",
        "relative_overlap": "1",
        "effective_density": "kg/m^3",
        "reduced_force": "1",
        "reduced_spacing": "1",
        "force_fluctuation": "1",
        "contact_fraction": "1",
        "stiffness_ratio": "1",
        "valid": "1",
    }
    _notebook_fields = ("shear_stiffness", "pressure")

    packing: Packing = held(Packing)
    medium: str = held(str)
    law: Law = held(Law, repr=False)
    force: Values = held(Any, "...", "N", "above zero")
    overlap: Values = held(Any, "...", "m", "finite")
    normal_stiffness: Values = held(Any, "...", "N/m", "above zero")
    finite_overlap: bool = held(bool, default=False)
    chosen_automatically: bool = held(bool, default=False)

    def _check(self) -> None:
        """Raise :class:`InputError` for what the check of the base class refuses, and also if an
        overlap that was read is out of range, or if force, overlap and stiffness do not belong to
        each other.

        The range leaves out balls that lie in each other, and balls that are all apart.
        """
        super()._check()
        overlap = np.asarray(self.overlap)
        diameter = self.packing.diameter
        # the least overlap of the law of samples would need the diameters to be drawn: minus the
        # width, or the diameter of equal balls, stands in its place, below the overlaps of samples
        # that carry load
        width = self.packing.width_units.width
        least_overlap = -width if self.samples else self.law.least_overlap
        is_in_range = (overlap > max(least_overlap, -diameter)) & (overlap < diameter)
        if not np.all(is_in_range):
            first_outside = float(overlap[~is_in_range].flat[0])
            raise InputError(
                f"overlap of the {type(self).__name__} is {first_outside:g} m",
                f"The mean diameter is {diameter:g} m",
                "Make the state again",
            )
        expected_numbers = self._find_again()
        for name, unit in (("force", "N"), ("overlap", "m"), ("normal_stiffness", "N/m")):
            if name in expected_numbers:
                self._require_equal(name, unit, np.asarray(expected_numbers[name]))

    def _require_equal(self, name: str, unit: str, expected_numbers: Array) -> None:
        """Raise :class:`InputError` unless the numbers of the attribute ``name``, in its ``unit``,
        are the ``expected_numbers`` (of the shape of the load), to rounding.
        """
        numbers = np.asarray(getattr(self, name))
        # an overlap may be near zero, and is the difference of lengths of the size of the width
        least_size = self.packing.width if name == "overlap" else 0.0
        size = np.maximum(np.abs(numbers), least_size)
        # nan, which compares with nothing, is wrong too
        is_wrong = ~(np.abs(expected_numbers - numbers) <= _READ_TOLERANCE * size)
        if np.any(is_wrong):
            first_number = float(numbers[is_wrong].flat[0])
            first_expected_number = float(expected_numbers[is_wrong].flat[0])
            raise InputError(
                f"{name} of the {type(self).__name__} is {first_number:.6g} {unit}",
                f"What the overlap, the law and the samples of the state make of it is"
                f" {first_expected_number:.6g} {unit}",
                "Make the state again",
            )

    def _find_again(self) -> dict[str, Any]:
        """Return attributes of the state, by name, found again from what the state holds: the
        force, N, and the normal stiffness, N/m, as its law gives them at the overlap.
        """
        return {
            "force": self.law.force(self.overlap),
            "normal_stiffness": self.law.stiffness(self.overlap),
        }

    def __getitem__(self, index: Any) -> Self:
        """Return the state at some of the loads, indexed like an array; the errors are those of
        :func:`select_loads`.
        """
        select_loads(self.shape, index)  # raises its errors
        names = ("force", "overlap", "normal_stiffness")
        return replace(self, **{name: np.asarray(getattr(self, name))[index] for name in names})

    def _field_units(self) -> dict[str, str]:
        """The SI unit of each attribute; the units of pressure and density depend on the number of
        periods of the lattice.
        """
        of_lattice = self.packing.structure.units_of({"pressure", "effective_density"})
        return {**self.units, **of_lattice}

    @property
    def torsion(self) -> Values:
        """Stiffness of a contact against twist about its normal, over k d^2.

        The torsion is that of the packing, also where balls differ. ``torsion="mindlin"`` means the
        torsion of a Hertz contact that does not slip, at the mean force
        (:meth:`~granphon.balls.packing.Packing.find_torsion`). Each contact of a simulated sample
        has the torsion at its own force.
        """
        return _unwrap_scalars(self.packing.find_torsion(self.force, self.normal_stiffness))

    @property
    def torsion_stiffness(self) -> Values:
        """Stiffness of a contact against twist, N m: :attr:`torsion` times k d^2."""
        return self.torsion * self.normal_stiffness * self.packing.diameter**2

    @property
    def bending_stiffness(self) -> Values:
        """Stiffness of a contact against rolling, N m: the bending of the packing times k d^2."""
        return self.packing.bending * self.normal_stiffness * self.packing.diameter**2

    @property
    def shear_stiffness(self) -> Values:
        """Shear stiffness kappa = eta k, N/m (equation 4); zero without friction."""
        return self.packing.mindlin_ratio * self.normal_stiffness

    @property
    def pressure(self) -> Values:
        """Pressure P: the force on a line, N; the force per length of the boundary in the plane,
        N/m; the force per area in space, Pa.

        P is sqrt(3) f / d on the triangular lattice (equation 20), 2 sqrt(2) f / d^2 in fcc and
        hcp, f on a chain. With finite overlap the spacing a stands in place of d. Raises
        :class:`~granphon.base.errors.InputError` if the stress of the lattice is not a pressure.
        """
        spacing = self.packing.diameter * self._shrinkage
        return self.packing.structure.pressure_per_force(spacing) * self.force

    @property
    def effective_density(self) -> Values:
        """Density that belongs to the moduli (:attr:`Packing.effective_density`), with finite
        overlap at the spacing a.
        """
        return self.packing.effective_density / self._shrinkage**self.packing.structure.periods

    @property
    def _shrinkage(self) -> Values:
        """a/d if the boundary follows the balls (finite overlap), otherwise 1."""
        return 1.0 - self.relative_overlap if self.finite_overlap else self._fill_shape(1.0)

    @property
    def relative_overlap(self) -> Values:
        """Overlap over the mean diameter, delta / d."""
        return self.overlap / self.packing.diameter

    @property
    def reduced_force(self) -> Values:
        """Reduced force f* = f / (c W^(3/2)) of Section IV, over the force of equal balls at
        overlap W; +inf if W = 0.
        """
        if not self.packing.width:
            return self._fill_shape(np.inf)
        # W may be so small that f* is above the floating range: f* is then +inf
        with np.errstate(over="ignore"):
            return _unwrap_scalars(self.packing.width_units.reduced_force(np.asarray(self.force)))

    @property
    def reduced_spacing(self) -> Values:
        """Reduced spacing a* = (d + W/2 - a)/W of Section IV; +inf for equal balls."""
        return self._convert_overlap(self.packing.width_units.reduced_spacing)

    @property
    def force_fluctuation(self) -> Values:
        """Force fluctuation Delta f / f of Section IV: rms deviation, over balls, of the mean force
        of their contacts from f, over f.

        The fluctuation is 0 for equal balls, and on a line.
        """
        return _unwrap_scalars(self.law.force_fluctuation(self.overlap))

    @property
    def contact_fraction(self) -> Values:
        """Fraction N_c / z of contacts that carry load: of the z contacts of a ball in the ideal
        lattice (6 on the triangular lattice), N_c do so on average.

        The fraction is 1 for equal balls, and on a line. In a simulation, contacts that carry less
        than 1e-6 of the mean force do not count.
        """
        return _unwrap_scalars(self.law.contact_fraction(self.overlap))

    @property
    def stiffness_ratio(self) -> Values:
        """Normal stiffness k over the stiffness of the ideal lattice at the same force, the
        ordinate of Figure 11.
        """
        stiffness = self.packing.law.stiffness(self.overlap_of_equal_balls)
        return _unwrap_scalars(self.normal_stiffness / stiffness)

    @cached_property
    def overlap_of_equal_balls(self) -> Array:
        """Overlap, m, that equal balls have at the mean force. It is above zero, also where balls
        differ and the mean overlap is below zero.
        """
        return read_only(self.packing.law.overlap(self.force))

    @property
    def exponent(self) -> Values:
        """Local exponent d log v / d log P = f k'/2k^2 of all sound velocities v, see
        :func:`granphon.local_exponent`.
        """
        slope = self.law.stiffness_slope(self.overlap)
        k = self.normal_stiffness
        return _unwrap_scalars(0.5 * (self.force / k) * (slope / k))

    @property
    def exponent_error(self) -> Values:
        """Standard error of ``exponent`` over samples: 0, as a contact law draws no samples."""
        return self._fill_shape(0.0)

    @property
    def valid(self) -> Values:
        """Whether the load is inside the range of the medium; always True for equal balls, on a
        line, and where the medium was ``chosen_automatically``.

        The range of the effective medium is f* >= 0.08 (Section IV), on all lattices, though the
        range was found on the triangular lattice. The averaged lattice and the averaged force leave
        out the effect of disorder on the lattice, and hold at high pressure (:attr:`regime`).
        """
        return _unwrap_scalars(np.asarray(self.force) >= self.least_valid_force)

    @property
    def floats(self) -> bool:
        """Whether loose balls float in their cages, so that velocities depend on the numbering of
        the balls: only simulated samples that were pressed from the gas may.
        """
        return False

    @property
    def shear_deficit(self) -> Values | None:
        """Fraction by which the shear modulus is expected to be too small; None where nothing is
        known to be left out.
        """
        return None

    @property
    def least_valid_force(self) -> float:
        """Least mean contact force at which the medium is valid, N.

        The force is 0 for equal balls, on a line, and if the medium was ``chosen_automatically``.
        """
        if self.chosen_automatically or not self.packing.spread_matters:
            return 0.0
        return self.law.least_valid_force(self.packing.width)

    @property
    def regime(self) -> Values:
        """Pressure regime of Section III, with the shape of the load: "low", "intermediate" or
        "high", as for equal balls.

        The regime is "high" if the overlap is sqrt(10) times Delta_rms or more, "low" if Delta_rms
        is sqrt(10) times the overlap or more.
        """
        reduced_overlap = self._convert_overlap(self.packing.width_units.reduced_overlap)
        overlap_over_rms = math.sqrt(12.0) * np.asarray(reduced_overlap)  # W is sqrt(12) Delta_rms
        regime = np.full(overlap_over_rms.shape, "intermediate")
        regime[overlap_over_rms <= 1.0 / HIGH_PRESSURE_RATIO] = "low"
        regime[overlap_over_rms >= HIGH_PRESSURE_RATIO] = "high"
        return regime if self.shape else str(regime)

    def _convert_overlap(self, reduce: Callable[[Values], Values]) -> Values:
        """Return ``reduce(overlap)``, a reduced quantity in units of the width W, with the shape of
        the load; +inf for equal balls, as W = 0.
        """
        if not self.packing.width:
            return self._fill_shape(np.inf)
        with np.errstate(over="ignore"):  # a small W may lead above the floating range, to +inf
            return reduce(self.overlap)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the load; () for a single one."""
        return np.shape(self.force)

    @cached_property
    def scales(self) -> Units:
        """Length (m), stiffness (N/m) and mass (kg) of the reduced units at this load.

        Raises :class:`~granphon.base.errors.InputError` for several loads.
        """
        self.require_single()
        return Units(self.packing.diameter, self.normal_stiffness, self.packing.mass)

    def require_single(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for a state at several loads."""
        if not self.is_single:
            raise InputError(
                f"the state holds {int(np.size(self.force))} loads",
                "Atoms, force constants and phonons belong to one",
                "Make a state with one load, as medium.at_force(1.0) does, or take one of these:"
                " state[0]",
            )

    @property
    def samples(self) -> tuple[Sample, ...]:
        """Samples over which the state is a mean; empty if the contacts follow from a law."""
        return ()

    @property
    def n_samples(self) -> int:
        """Number of samples over which the state is a mean; 0 if the contacts follow from a law."""
        return 0

    @cached_property
    def reference_lattice(self) -> ContactLattice:
        """The lattice of contacts without terms of finite overlap, in reduced units.

        The torsion of a Hertz contact is that at the largest load. The lattice serves for
        properties that do not depend on the load: the names of waves, mechanisms, isotropy.
        """
        largest_torsion = None  # the torsion of the packing, which no load changes
        if self.packing.torsion == MINDLIN:
            largest_torsion = float(np.max(self.torsion))
        return ideal_lattice(self.packing, largest_torsion)

    @property
    def has_one_lattice(self) -> bool:
        """Whether the lattice, in reduced units, is the same at all loads."""
        return self.is_single or not (self.finite_overlap or self.packing.torsion == MINDLIN)

    def contact_lattice(self) -> ContactLattice:
        """Return the lattice of contacts, in reduced units.

        With finite overlap the lattice has the spacing a, the lever arm a/2 and the prestress f/a.
        With finite overlap or the torsion of a Hertz contact the lattice depends on the load:
        :class:`~granphon.base.errors.InputError` for several loads.
        """
        packing = self.packing
        depends_on_load = self.finite_overlap or packing.torsion == MINDLIN
        if not depends_on_load:
            return ideal_lattice(packing)
        self.require_single()
        spacing = 1.0
        prestress = 0.0
        if self.finite_overlap:
            spacing = 1.0 - self.relative_overlap
            prestress = float(self._prestress)
        return ContactLattice.of(
            packing.structure,
            packing.mindlin_ratio,
            spacing,
            prestress,
            torsion=float(self.torsion),
            bending=packing.bending,
            motions=packing.ball_motions,
        )

    @property
    def velocity_scale(self) -> Array:
        """Unit of velocity d (k/M)^1/2 at each load, m/s."""
        # the root of k over the root of M: k/M itself may leave the floating range
        frequency = np.sqrt(self.normal_stiffness) / np.sqrt(self.packing.mass)
        return np.asarray(self.packing.diameter * frequency)

    @property
    def elastic_tensor(self) -> Array:
        """Elastic tensor of the lattice of contacts in Voigt order.

        The tensor is (..., 1, 1), N, on a line; (..., 3, 3), Pa, xx, yy, xy, in the plane, for a
        layer one diameter thick; (..., 6, 6), Pa, xx, yy, zz, yz, xz, xy, in space.

        With finite overlap the entries are the coefficients between Cauchy stress and strain under
        the static pressure. Raises :class:`~granphon.base.errors.MechanismError` if a motion costs
        no energy.
        """
        # with finite overlap the spacing a stands in place of d in space and on a line; the layer
        # of a plane stays d thick
        d = self.packing.diameter
        k = self.normal_stiffness
        spacing: Values = d
        if self.finite_overlap:
            spacing = d * (1.0 - np.asarray(self.relative_overlap))
        units = {1: k * spacing, 2: k / d, 3: k / spacing}  # N, Pa and Pa, by the periods
        unit = np.asarray(units[self.packing.structure.periods])
        return unit[..., None, None] * self._at_each_load(ContactLattice.elastic_tensor)

    def polarised_waves(self, direction: ArrayLike) -> tuple[Array, Array]:
        """Return the velocities, m/s, of :meth:`long_waves` along ``direction``, and the unit
        displacements of these waves.

        The shapes are those of :meth:`State.polarised_waves`. Raises
        :class:`~granphon.base.errors.MechanismError` if a motion costs no energy.
        """

        def find_waves(lattice: ContactLattice, prestress: Array | None) -> Array:
            """Return one array (..., 1 + n_u, n_u): the reduced velocities of a lattice in the
            first row, and the displacements in the other rows.
            """
            velocities, displacements = lattice.sound_velocities(direction, prestress)
            return np.concatenate([velocities[..., None, :], displacements], axis=-2)

        waves = self._at_each_load(find_waves)
        reduced_velocities = waves[..., 0, :]
        displacements = waves[..., 1:, :]
        scale = self.velocity_scale
        if self.finite_overlap:  # all lengths scale with the spacing
            scale = scale * (1.0 - np.asarray(self.relative_overlap))
        # behind the load come axes of length one: for directions (n, p) one for the directions, and
        # always one for the branches
        scale = scale.reshape(*scale.shape, *(1,) * np.ndim(direction))
        velocities = scale * reduced_velocities
        shape = (*velocities.shape, velocities.shape[-1])
        return velocities, np.broadcast_to(displacements, shape)

    @property
    def _prestress(self) -> Array:
        """The prestress f/(k a) at each load, without a unit, with the spacing a = d - delta."""
        spacing = self.packing.diameter * (1.0 - self.relative_overlap)
        return np.asarray(self.force / self.normal_stiffness / spacing)

    def _at_each_load(self, find: Callable[[ContactLattice, Array | None], Array]) -> Array:
        """Return ``find(lattice, prestress)`` at all loads, for lattices with a spacing of one.

        ``prestress`` is f/(k a), or None without finite overlap. If the load changes the lattice
        (:attr:`_lattice_changes`), ``find`` is called at each load, with one lattice and one
        number. Otherwise ``find`` is called once, with the lattice in common and the prestress at
        all loads, an array of their shape. The result has the shape of the load followed by that
        of one result; only that of one result if neither lattice nor prestress depends on the load.
        """
        packing = self.packing
        shape = self.shape
        prestress = self._prestress if self.finite_overlap else None
        if not self._lattice_changes:
            return find(self.reference_lattice, prestress)
        spacing = 1.0 - self.relative_overlap if self.finite_overlap else 1.0
        # torsion and bending over k a^2, from those over k d^2
        spacing_squared = np.broadcast_to(spacing**2, shape)
        torsion = np.broadcast_to(self.torsion, shape) / spacing_squared
        bending = packing.bending / spacing_squared
        results = []
        for index in np.ndindex(shape):
            lattice = ideal_lattice(packing, float(torsion[index]), float(bending[index]))
            prestress_at_load = None if prestress is None else prestress[index]
            results.append(find(lattice, prestress_at_load))
        return np.asarray(results).reshape(*shape, *results[0].shape)

    @property
    def _lattice_changes(self) -> bool:
        """Whether the load changes the elastic tensor, over k, by something else than the
        prestress. Torsion and bending may do so where a cell has several balls.
        """
        packing = self.packing
        if packing.structure.n_balls == 1:
            return False
        if self.finite_overlap:
            return bool(packing.torsion or packing.bending)
        # where no strain twists contacts, their torsion does not matter; with finite overlap the
        # prestress might twist them
        return packing.torsion == MINDLIN and ideal_lattice(packing, 1.0).is_twisted_by_sound

    @property
    def name(self) -> str:
        """Name of the lattice, in messages."""
        return f"{self.packing.structure.name} lattice"

    @property
    def unit_length(self) -> float:
        """The mean diameter, m."""
        return self.packing.diameter

    @property
    def has_cubic_axes(self) -> bool:
        """Whether the lattice is square or cubic with its axes along x, y, z. Samples of such a
        lattice have this symmetry on average.
        """
        return has_cubic_axes(self.packing.structure)

    @property
    def mean_errors(self) -> dict[str, Values]:
        """Standard error over samples of the force or overlap, as "force_error" (N) or
        "overlap_error" (m).

        At a given force or pressure it is the error of the overlap, at a given overlap the error of
        the force. The dictionary is empty if there are fewer than two samples.
        """
        return {}

    @property
    def network(self) -> ContactNetwork:
        """One cell of the lattice at this load, as a network of contacts, from which its method
        ``repeat`` makes an array.

        With finite overlap the network has the spacing a and prestress. Raises
        :class:`~granphon.base.errors.InputError` for several loads, and for a state of samples,
        which have networks of their own.
        """
        if self.samples:
            samples = counted(self.n_samples, "simulated sample")
            raise InputError(
                f"the state is of {samples}, and not of a lattice",
                mend="Use the network of a sample: state.samples[0].network",
            )
        structure = self.packing.structure
        units = self.scales
        reduced_force = self.force / units.force
        return self.contact_lattice().contact_network(
            units,
            reduced_force,
            lattice=structure,
            shape=(1,) * structure.periods,
            contact_model=ContactModel.of(self.packing),
        )

    @property
    def twist_velocity(self) -> Values | None:
        """Velocity of the wave of twist at each load, m/s, see :attr:`State.twist_velocity`.

        The velocity is d (k_t/I)^1/2, with the torsion stiffness k_t of a contact and the moment of
        inertia I of a ball.
        """
        if not self.reference_lattice.runs_twist:
            return None
        # with I = M (GYRATION d)^2, d cancels. The balls are at the distance d: there is no finite
        # overlap here, as a straight chain with finite overlap buckles
        frequency = np.sqrt(self.torsion_stiffness / self.packing.mass)
        return _unwrap_scalars(frequency / GYRATION)

    def _fill_shape(self, value: Any) -> Values:
        """Return the value at each load: an array of the shape of the load, or the value itself at
        a single load.
        """
        return np.full(self.shape, value) if self.shape else value


def select_loads(shape: tuple[int, ...], index: Any) -> NDArray[np.intp]:
    """Return the numbers, in C order, of the loads of a state that an ``index`` selects, of the
    shape of the selection. ``shape`` is that of all loads.

    Raises :class:`~granphon.base.errors.InputError` for a number or slice as index of the state at
    a single load, and for an index that selects no load. Raises what NumPy raises for an index of
    an array: IndexError, by which loops over the loads end, for one outside the loads.
    """
    numbers = np.arange(math.prod(shape)).reshape(shape)
    try:
        selected_numbers = np.asarray(numbers[index])
    except IndexError:
        if shape:
            raise
        problem = "the state has one load, and no index"
        raise InputError(problem, mend="Use it as it is") from None
    if not selected_numbers.size:
        problem = f"the index {brief(index)} selects none of the loads"
        raise InputError(problem, mend="Select one or more")
    return selected_numbers


def read_finite_overlap(finite_overlap: bool | None) -> bool:
    """Return whether terms of finite overlap are kept; None means that they are not.

    Raises :class:`InputError` if ``finite_overlap`` is not True, False or None.
    """
    return finite_overlap is not None and bool(require("finite_overlap", truth, finite_overlap))


def _unwrap_scalars(values: Any) -> Values:
    """Return a Python number (or bool) if ``values`` have no axes, as at a single load; an array is
    returned unchanged.
    """
    return np.asarray(values).item() if np.ndim(values) == 0 else values


# -- networks as states ----------------------------------------------------------------------------


class NetworkState(State):
    """The state of the contacts of a network with periods, with a stiffness and a force of each.

    A source with a network at each of several loads, as a crystal under load, has one such state
    for all loads. Lengths, stiffnesses and masses are in the reduced units of each network,
    :attr:`ContactNetwork.scales`.

    Parameters
    ----------
    source : a network, which repeats along one, two or three axes; or an object with a network at
        each load, ``source[i]`` at one of them.
    warnings : sentences about limits, from the maker of the source; None for the warnings that the
        network itself gives.

    Raises :class:`~granphon.base.errors.InputError` for a network that
    :meth:`ContactLattice.from_network` refuses, as one without periods, or one whose balls are not
    at rest; the networks of another source are looked at when they are needed.
    """

    name = "network"

    def __init__(self, source: Any, warnings: tuple[str, ...] | None = None) -> None:
        self.source = source
        self.warnings = warnings
        if isinstance(source, ContactNetwork):
            _ = self._lattices  # raises the errors of the cell

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the load; () for a single one."""
        return () if isinstance(self.source, ContactNetwork) else tuple(self.source.shape)

    @cached_property
    def _networks(self) -> list[ContactNetwork]:
        """The network at each load, in C order."""
        if not self.shape:
            return [given_network(self.source)]
        return [given_network(self.source[index]) for index in np.ndindex(self.shape)]

    @cached_property
    def _lattices(self) -> list[ContactLattice]:
        """The lattice of each of the networks, in reduced units."""
        return [ContactLattice.from_network(network) for network in self._networks]

    def _stack(self, find: Callable[[ContactLattice, ContactNetwork], Any]) -> Array:
        """Return ``find(lattice, network)`` at each load, with the shape of the load in front."""
        results = np.array(list(map(find, self._lattices, self._networks)))
        return results.reshape((*self.shape, *results.shape[1:]))

    def __getitem__(self, index: Any) -> State:
        """Return the state at some of the loads, indexed like an array; the errors are those of
        :func:`select_loads`.
        """
        select_loads(self.shape, index)  # raises its errors
        if isinstance(self.source, ContactNetwork):  # the index, such as (), selects the only load
            return self
        return as_state(self.source[index])

    @property
    def network(self) -> ContactNetwork:
        """The network at the only load; :class:`~granphon.base.errors.InputError` for several
        loads.
        """
        return given_network(self.source)

    def contact_lattice(self) -> ContactLattice:
        """Return the lattice at the only load; :class:`~granphon.base.errors.InputError` for
        several loads.
        """
        self.require_single()
        return self.reference_lattice

    def require_single(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for a state at several loads."""
        # the source of the networks says how to take one of its loads
        given_network(self.source)

    @property
    def has_one_lattice(self) -> bool:
        """Whether the lattice is the same at all loads: only with a single load, as each load has a
        lattice of its own.
        """
        return self.is_single

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of the balls that move, in the order of the lattice; empty if they are
        not known.
        """
        network = self._networks[0]
        return tuple(itertools.compress(network.kinds or (), network.moving))

    @property
    def reference_lattice(self) -> ContactLattice:
        """The lattice of contacts at the first load, in reduced units."""
        return self._lattices[0]

    def relax_inner_motions(self, progress: Progress) -> None:
        """Relax the inner motions at every load; see :meth:`State.relax_inner_motions`."""
        for lattice in self._lattices:
            lattice.relax_inner_motions(progress)

    @property
    def scales(self) -> Units:
        """Length (m), stiffness (N/m) and mass (kg) of the reduced units.

        Raises :class:`~granphon.base.errors.InputError` for several loads.
        """
        return self.network.scales

    @property
    def unit_length(self) -> float:
        """Unit of length, m; :class:`~granphon.base.errors.InputError` if it is not the same at all
        loads.
        """
        lengths = self._stack(lambda _, network: network.scales.length)
        if np.ptp(lengths) > 0.0:
            raise InputError(
                "the balls are not as far apart at all loads",
                "Wave numbers are in units of their distance",
                "Take one load, as state[0]",
            )
        return float(np.ravel(lengths)[0])

    @property
    def velocity_scale(self) -> Array:
        """Unit of velocity at each load, m/s."""
        return self._stack(lambda _, network: network.scales.velocity)

    @cached_property
    def elastic_tensor(self) -> Array:
        """Elastic tensor of the periods in Voigt order, (..., n, n), with inner motions relaxed.

        The tensor is in N where the network repeats along a line, whatever its width; in Pa where
        the network repeats in a plane, the force per length over one diameter, however thick the
        network is; in Pa in space. Raises what :func:`~granphon.observables.velocities.moduli`
        raises for a network.
        """

        def find_tensor(lattice: ContactLattice, network: ContactNetwork) -> Array:
            """Return the tensor (n, n) of one load."""
            scales = network.scales
            unit = scales.force if lattice.periods == 1 else scales.modulus
            return np.asarray(unit * lattice.elastic_tensor())

        self._require_sound()
        return read_only(self._stack(find_tensor))

    def _require_sound(self) -> None:
        """Raise the error, with its numbers in SI, of a lattice that is not rigid, in which sound
        has no velocity; see :meth:`ContactLattice.require_rigid`.
        """
        for lattice, network in zip(self._lattices, self._networks, strict=True):
            lattice.require_rigid(network.scales)

    @property
    def has_cubic_axes(self) -> bool:
        """Whether the elastic tensor is, at all loads and to rounding, that of a square or cube
        with edges along x, y, z, and not isotropic. False on a line. Raises the errors of
        :attr:`elastic_tensor`.
        """
        tensor = self.elastic_tensor
        return all(map(is_cubic, tensor.reshape(-1, *tensor.shape[-2:])))

    @property
    def is_isotropic(self) -> bool:
        """Whether the elastic tensor is the same in all directions, at all loads. Raises
        :class:`~granphon.base.errors.InputError` if springs to the ground or bodies that do not
        move hold the balls, and :class:`~granphon.base.errors.MechanismError` if a motion costs no
        energy.
        """
        self._require_sound()
        return all(
            "longitudinal" not in lattice.wave_names or lattice.is_isotropic
            for lattice in self._lattices
        )

    def polarised_waves(self, direction: ArrayLike) -> tuple[Array, Array]:
        """Return velocities, m/s, and unit displacements of long waves, see
        :meth:`State.polarised_waves`.
        """
        shape = self.shape
        self._require_sound()
        waves = [lattice.sound_velocities(direction) for lattice in self._lattices]
        # the first axis runs over all loads, and is replaced by the axes of the load
        velocities = np.array([velocities_at_load for velocities_at_load, _ in waves])
        displacements = np.array([displacements_at_load for _, displacements_at_load in waves])
        velocities = velocities.reshape((*shape, *velocities.shape[1:]))
        displacements = displacements.reshape((*shape, *displacements.shape[1:]))
        n_inner_axes = velocities.ndim - len(shape)  # for directions and branches
        scale = self.velocity_scale.reshape((*shape, *(1,) * n_inner_axes))
        return velocities * scale, displacements

    @property
    def twist_velocity(self) -> Values | None:
        """Velocity of the wave of twist at each load, m/s, see :attr:`State.twist_velocity`."""

        def find_velocity(lattice: ContactLattice, network: ContactNetwork) -> float:
            """Return the velocity at one load, m/s; zero where a contact does not resist twist."""
            torsion = np.broadcast_to(lattice.torsion, lattice.stiffness.shape) * lattice.stiffness
            if not np.all(torsion):
                return 0.0
            # a long wave turns against all springs of the cell in a row, and all its inertias
            compliance = np.sum(1.0 / torsion)
            inertia = float(lattice.masses @ lattice.gyration**2)
            velocity = lattice.measure / np.sqrt(compliance * inertia)
            return float(velocity * network.scales.velocity)

        return self._stack(find_velocity)[()] if self.reference_lattice.runs_twist else None


def as_state(source: Any) -> State:
    """Return ``source``, the argument of a public call, as a state.

    A state is returned as it is, and anything else with a network becomes the
    :class:`NetworkState` of its network or networks. A :class:`NetworkState` at a single load,
    whose source may be the state of a crystal, becomes the state of the network itself, with the
    same warnings.

    Raises :class:`~granphon.base.errors.InputError` for something that has no network, and for a
    network that :class:`NetworkState` refuses.
    """
    if isinstance(source, NetworkState) and source.is_single:
        return NetworkState(source.network, source.warnings)
    if isinstance(source, State):
        return source
    warnings = getattr(source, "warnings", None)
    if warnings is not None:
        warnings = tuple(warnings)
    is_single = getattr(source, "is_single", True)  # a network has no loads
    network_source = given_network(source) if is_single else source
    return NetworkState(network_source, warnings)


def given_state(state: Any) -> ContactState:
    """Return ``state``, the argument of a public function; raises :class:`InputError` if it is not
    a ContactState.
    """
    if isinstance(state, ContactState):
        return state
    if isinstance(state, NetworkState):
        state.require_single()
    refuse_unpressed(state)
    why = ""
    if isinstance(state, NetworkState | ContactNetwork):
        why = "It needs the contact law of a packing"
    state_in_words = brief(getattr(state, "network", state))
    mend = "Give a ContactState, as medium.at_force gives it"
    raise InputError(f"state is {state_in_words}", why, mend)
