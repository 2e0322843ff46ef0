"""The medium that simulates the disordered array: every ball has its own diameter and is at rest
under load.

Section III of Velicky and Caroli replaces the array by an average array. Here a periodic sample of
L1 x ... x Lp cells is simulated, on a lattice with p periods. The mechanical equilibrium of the
sample is found without friction (:mod:`granphon.array.equilibrium`), or the sample is loaded with
friction step by step (:mod:`granphon.media.loading`); the linear response
(:mod:`granphon.statics.response`) then has shear springs at every contact that carries load. A
state is a mean over samples; its attributes, elastic tensor, sound waves and local exponent have
standard errors.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache, partial
from operator import attrgetter, methodcaller
from types import NoneType
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.equilibrium import Equilibrium
from granphon.array.equilibrium_courses import EquilibriumFollower
from granphon.array.geometry import require_small
from granphon.array.options import ReducedLoad
from granphon.array.pressed_sample import PressedEquilibrium, PressedSample
from granphon.array.sample import STEP, Sample
from granphon.array.stencils import Stencils
from granphon.array.true_equilibrium import TrueEquilibrium
from granphon.balls.diameters import Measured, subtract_mean
from granphon.balls.hertz import EnergyLaw, HertzLaw, read_overlap
from granphon.balls.lattices import Lattice, as_direction
from granphon.balls.loads import Load, require_of_packing
from granphon.balls.motions import Motions, default_motions
from granphon.balls.packing import Packing, given_packing
from granphon.base.arrays import Array
from granphon.base.differences import Course
from granphon.base.errors import GranphonError, InputError, MechanismError, brief
from granphon.base.memory import require_memory
from granphon.base.progress import Progress, require_progress, silent
from granphon.base.results import held, read_only, result_class
from granphon.base.standard_errors import jackknife, standard_error
from granphon.base.text import suggest
from granphon.base.threads import naming_lost_workers, require_executor
from granphon.base.validation import choice, lengths, one_of, require, whole, whole_number
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.elasticity import (
    bulk_and_shear,
    longitudinal_modulus,
    symmetrise,
    waves_of_tensor,
)
from granphon.media.array_options import (
    DEFAULT_SHAPES,
    HISTORY_OPTIONS,
    SAMPLE_UNITS,
    FrictionHistory,
    no_finite_overlap,
    prescribe,
    read_cells,
)
from granphon.media.crystal_sites import read_diameters
from granphon.media.left_out import (
    EXACT,
    GEOMETRIES,
    LATTICE,
    LEFT_OUT_LIMIT,
    can_be_exact,
    choose_geometries,
    estimate_shear_deficit,
)
from granphon.media.loading import (
    LoadedSample,
    find_equilibria,
    find_equilibrium,
    require_above,
    require_load,
)
from granphon.media.medium import SIMULATION, Change, Medium, Option
from granphon.media.newtons import in_newtons
from granphon.media.sample_memory import estimate_memory
from granphon.media.state import ContactState, read_finite_overlap, select_loads
from granphon.statics.configuration import BOUNDARIES

#: the largest seed of a sample
_MOST_SEED = 2**64 - 1
#: greatest numbers of balls along a side of a sample, of its cells, and of samples, far more than
#: memory holds
_MOST_SIDE = 2**31
_MOST_CELLS = 2**48
_MOST_SAMPLES = 2**31
#: number of wave vectors along each axis at which a lattice is probed: corners, edges and faces of
#: the zone are among them
_PROBE_COUNT = 12
#: frequency, (k/M)^1/2, below which a wave costs nothing
_SOFT_FREQUENCY = 1e-6
#: least width over diameter: where overlaps are more than 1e20 widths, some samples find no
#: equilibrium
_LEAST_WIDTH = 1e-20
#: time for each ball of a start in the exact geometry, over the time in the directions of the
#: lattice
_EXACT_TIME_RATIO = 20
#: balls whose start takes as long as the fixed cost of any sample, by whether the geometry is exact
_LEAST_BALLS = {False: 625, True: 2500}
#: f* of a start that takes twice as long as a start at a high force; below it the time grows as
#: 1/f*
_SLOW_FORCE = 0.0015
#: shear modulus over bulk modulus that is rounding
_SHEAR_ROUNDING = 1e-12


@dataclass(frozen=True)
class SampleLaw(EnergyLaw):
    """The contact law of a simulation: mean force, stiffness and energy of a contact against the
    overlap.

    Methods take scalars or arrays of overlaps, m: floats in, floats out. Each overlap needs an
    equilibrium of every sample, which is found at the first request. The equilibria at the last 64
    overlaps are kept. The variance of the slope of the stiffness is infinite.

    Attributes
    ----------
    simulation : the :class:`DirectSimulation` whose samples are solved.
    """

    simulation: DirectSimulation = field(metadata={"kind": lambda: DirectSimulation})

    @property
    def coefficient(self) -> float:
        """Coefficient c of the law of equal balls, N/m^(3/2)."""
        return self.simulation.packing.law.coefficient

    @property
    def least_overlap(self) -> float:
        """Overlap up to which all balls are apart while they are on the sites of the lattice, m; at
        most zero, which it is where all balls drawn are alike.
        """
        simulation = self.simulation
        samples = range(simulation.samples)
        largest_deviation = max(float(np.max(simulation.deviations(index))) for index in samples)
        # a difference, as minus a deviation of zero would be -0.0
        return 0.0 - largest_deviation * simulation.packing.width_units.width

    def _average_at(self, overlap: ArrayLike, quantity: Callable[[Sample], float]) -> Any:
        """Return the mean over samples of a ``quantity``, a number of each sample, at each
        ``overlap``, m. The result has the shape of the overlaps. Raises InputError for overlaps
        that are no numbers, and the errors of :meth:`DirectSimulation.at`.
        """
        overlaps = read_overlap(overlap)
        # equilibria are found once where an overlap is asked for twice
        distinct_overlaps, index = np.unique(overlaps, return_inverse=True)
        means = []
        for distinct_overlap in distinct_overlaps.tolist():
            samples = self._simulate(distinct_overlap)
            means.append(np.mean([quantity(sample) for sample in samples]))
        return np.array(means)[index].reshape(overlaps.shape)[()]

    @cached_property
    def _simulate(self) -> Callable[[float], tuple[Sample, ...]]:
        """The function of an overlap, m, that returns the samples at rest at this overlap. The
        samples of the last 64 overlaps are kept.
        """
        return lru_cache(maxsize=64)(lambda overlap: self.simulation.at_overlap(overlap).samples)

    def __reduce__(self) -> tuple[Any, ...]:
        return SampleLaw, (self.simulation,)  # a copy starts without the samples that are kept

    def _evaluate(self, overlap: ArrayLike, order: int) -> Any:
        """Return the derivative, of the ``order`` 0 to 3, of a contact's energy by its overlap,
        J/m^order, at each ``overlap``, m. Order 0 is the energy itself.
        """
        names = ("energy", "force", "normal_stiffness", "stiffness_slope")
        return self._average_at(overlap, attrgetter(names[order]))

    def force_fluctuation(self, overlap: ArrayLike) -> Any:
        """Return the force fluctuation over the balls, the ratio Delta f / f, at each ``overlap``,
        m.
        """
        return self._average_at(overlap, lambda sample: sample.force_fluctuation)

    def contact_fraction(self, overlap: ArrayLike) -> Any:
        """Return the fraction of contacts that carry more than 1e-6 of the mean force, at each
        ``overlap``, m.
        """
        return self._average_at(overlap, lambda sample: sample.contact_fraction())

    def least_valid_force(self, width: float) -> float:
        """Return 0 N for any ``width``, m: the simulation is valid at every load that has an
        equilibrium.
        """
        return 0.0

    def overlap(self, force: ArrayLike) -> Any:
        """Return the mean overlap delta, m, at each mean contact ``force``, N."""
        return self.simulation.at_force(force).overlap


@result_class
class SimulatedState(ContactState):
    """The contacts of simulated samples: means over the samples, and the samples themselves.

    At a given force or pressure every sample bears the same force, and overlaps are averaged. At a
    given overlap all samples have the same overlap, and forces are averaged. In both cases
    ``normal_stiffness`` is the exact derivative of the mean force with respect to the mean overlap;
    after a history with friction ``normal_stiffness`` belongs to the linear response, which differs
    from the slope of the path (:attr:`PressedSample.normal_stiffness`).

    Attributes
    ----------
    samples : the samples at each load, in C order of the loads; the index of the sample runs
        fastest.
    fixed_overlap : True if all samples have the same overlap, False if they have the same force.

    ``finite_overlap`` is True of samples in their exact geometry, if only at some loads. False
    means that the linear response, pressure and density of the samples are in the paper's limit;
    :class:`~granphon.base.errors.InputError` if such a state is made with True.
    """

    units = {**ContactState.units, **SAMPLE_UNITS}

    law: HertzLaw | SampleLaw = held(HertzLaw | SampleLaw, repr=False)
    samples: tuple[Sample | PressedSample, ...] = held(
        (Sample | PressedSample, ...), default=(), repr=False
    )
    fixed_overlap: bool = held(bool, default=False)

    @classmethod
    def of(cls, simulation: DirectSimulation, samples: Sequence[Any], load: Load) -> Self:
        """Make the state of ``samples`` under an applied ``load``; samples come in C order of the
        loads, the index of the sample fastest.

        The force or the overlap of the state is exact if the load is given as such.
        """
        shape = (*load.shape, -1)  # axes of the load, and then the samples
        stiffnesses = np.reshape([sample.normal_stiffness for sample in samples], shape)
        fixed_overlap = load.kind == "overlap"
        if fixed_overlap:  # samples act in parallel
            stiffness = np.mean(stiffnesses, axis=-1)
            overlap = load.array
        else:  # samples act in series
            stiffness = 1.0 / np.mean(1.0 / stiffnesses, axis=-1)
            overlap = np.mean(np.reshape([sample.overlap for sample in samples], shape), axis=-1)
        if load.kind == "force":
            force = load.array
        else:
            force = np.mean(np.reshape([sample.force for sample in samples], shape), axis=-1)
        # at some loads of the state static forces act on small motions
        has_exact_geometry = any(medium.is_exact for medium, _ in simulation.by_geometry(load))
        return cls(
            packing=simulation.packing,
            medium=simulation.name,
            law=simulation.law,
            force=np.asarray(force)[()],
            overlap=np.asarray(overlap)[()],
            normal_stiffness=np.asarray(stiffness)[()],
            samples=tuple(samples),
            fixed_overlap=fixed_overlap,
            finite_overlap=has_exact_geometry,
        )

    def __post_init__(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for finite overlap that samples in the
        directions of the lattice do not have.
        """
        simulation = self._simulation
        may_be_exact = simulation is not None and simulation.geometry != LATTICE
        if self.finite_overlap and not may_be_exact:
            raise no_finite_overlap(self.medium)
        super().__post_init__()

    def __getitem__(self, index: Any) -> Self:
        """Return the state at some of the loads, indexed like an array; the errors are those of
        :func:`~granphon.media.state.select_loads`.
        """
        samples = self._table.reshape(-1, self.n_samples)[select_loads(self.shape, index)]
        return replace(
            self,
            force=np.asarray(self.force)[index],
            overlap=np.asarray(self.overlap)[index],
            normal_stiffness=np.asarray(self.normal_stiffness)[index],
            samples=tuple(samples.ravel().tolist()),
            # each load may have a geometry of its own: the selected loads decide
            finite_overlap=bool(np.any(np.asarray(self._is_exact)[index])),
        )

    def _find_again(self) -> dict[str, Any]:
        """Return the force, N, and the overlap, m, by name, as means over the samples."""
        return {name: self._average(attrgetter(name)) for name in ("force", "overlap")}

    @property
    def _table(self) -> NDArray[Any]:
        """Samples as an array of objects, with the axes of the load and then the index of the
        sample.
        """
        table = np.empty(len(self.samples), dtype=object)
        table[:] = self.samples
        return table.reshape(*self.shape, -1)

    @property
    def n_samples(self) -> int:
        """Number of samples that are averaged at each load."""
        return len(self.samples) // int(np.prod(self.shape, dtype=int))

    @property
    def sample(self) -> Any:
        """First sample; for several loads an array of the first samples, with the shape of the
        load.
        """
        first_samples = self._table[..., 0]
        return first_samples if self.shape else first_samples[()]

    def over_samples(self, of: Callable[[Any], ArrayLike]) -> Array:
        """Return a quantity of every sample, in its own unit; ``of`` is the function that returns
        the quantity of a sample.

        The shape is that of the load, then (n_samples,), then that of the quantity. Raises
        :class:`~granphon.base.errors.InputError` if ``of`` is no function, or its results are not
        numbers, or arrays of one shape.
        """
        if not callable(of):
            raise InputError(f"of is {brief(of)}", mend="Give a function of a sample")
        quantities = [of(sample) for sample in self.samples]
        try:
            values = np.array(quantities)
        except ValueError:  # lists of different lengths
            values = np.array(None)
        if values.dtype.kind not in "biufc":
            raise InputError(
                f"the quantity of a sample is {brief(quantities[0])}",
                "Numbers, or arrays of one shape, can be compared over samples",
                "Give a function that returns these",
            )
        return values.reshape(*self.shape, self.n_samples, *values.shape[1:])

    def standard_error(self, of: str | Callable[[Any], ArrayLike]) -> Any:
        """Return the standard error of the mean of a quantity over samples, in the unit of the
        quantity.

        ``of`` is the name of an attribute of :class:`Sample`, or a function of a sample. The result
        has the shape of the load followed by that of the quantity. Raises
        :class:`~granphon.base.errors.InputError` for any other argument, for an attribute without
        numbers or of different shapes, and if there is only one sample.
        """
        argument: Any = of
        names = [name for name in dir(self.samples[0]) if not name.startswith("_")]
        if isinstance(argument, str) and argument not in names:
            raise InputError(f"a sample has no {argument!r}", mend=suggest(argument, names))
        if not (isinstance(argument, str) or callable(argument)):
            mend = "Give the name of an attribute, or a function of a sample"
            raise InputError(f"of is {brief(argument)}", mend=mend)
        if self.n_samples < 2:
            mend = "Give samples=2 or more to granphon.DirectSimulation"
            raise InputError("one sample has no standard error", mend=mend)
        quantity = attrgetter(of) if isinstance(of, str) else of
        return standard_error(self.over_samples(quantity), len(self.shape))[()]

    def _average(self, quantity: Callable[[Any], ArrayLike]) -> Any:
        """Return the mean over samples of a ``quantity`` of each sample. It has the shape of
        the load followed by that of the quantity.
        """
        return np.mean(self.over_samples(quantity), axis=len(self.shape))[()]

    @property
    def force_fluctuation(self) -> Any:
        """Force fluctuation Delta f / f: rms deviation, over balls, of the mean force of a ball's
        contacts from f, over f.
        """
        return self._average(lambda sample: sample.force_fluctuation)

    @property
    def contact_force_fluctuation(self) -> Any:
        """Rms deviation of the forces of single contacts from the mean force, over the mean force;
        with the shape of the load.
        """
        return self._average(lambda sample: sample.contact_force_fluctuation)

    @property
    def contact_fraction(self) -> Any:
        """Fraction of contacts that carry more than 1e-6 of the mean force, N_c / z (N_c / 6 on the
        triangular lattice).

        In the exact geometry loose balls lean on others with W/d of the mean force or less, so that
        the fraction depends on the threshold: at a* = 0.4 the fraction is 0.67, that of all forces
        above zero 0.68, and that of forces above 1e-3 of the mean 0.58 (steel balls, W/d = 2.6e-4).
        ``contact_fraction(threshold=...)`` of one of the ``samples`` takes another threshold.
        """
        return self._average(lambda sample: sample.contact_fraction())

    def tangential_ratio_distribution(
        self, bins: int = 50, largest: float | None = None
    ) -> tuple[Array, Array, Array]:
        """Return the edges (bins + 1,) of bins of ``|T|/f``, the probability density (..., bins),
        and the standard error of the density (..., bins).

        "..." is the shape of the load. The density is the mean over samples of
        :meth:`~granphon.array.pressed_sample.PressedSample.tangential_ratio_distribution`, which
        describes ``bins`` and ``largest``. The error is nan if there is only one sample. Raises
        :class:`~granphon.base.errors.InputError` without a history of friction, and for ``bins``
        and ``largest`` that the method refuses.
        """
        return self._average_distribution("tangential_ratio_distribution", bins, largest)

    def mobilisation_distribution(self, bins: int = 50) -> tuple[Array, Array, Array]:
        """Return the edges (bins + 1,) of bins of ``|T|/(mu f)``, the probability density (...,
        bins), and the standard error of the density (..., bins).

        See :meth:`tangential_ratio_distribution`. Raises
        :class:`~granphon.base.errors.InputError` without a history of friction, if mu is zero or
        infinite, and if ``bins`` is no whole number from 1 to a million.
        """
        return self._average_distribution("mobilisation_distribution", bins)

    def _average_distribution(self, name: str, *arguments: Any) -> tuple[Array, Array, Array]:
        """Return the edges (bins + 1,) of a distribution of the samples, its mean over samples
        (..., bins), and the standard error of the mean (..., bins).

        The distribution is the method of a sample with the ``name``, called with the ``arguments``;
        InputError for samples without such a method, which have no history of friction.
        """
        if not hasattr(self.samples[0], name):
            raise InputError(
                f"there is no {name}",
                "Balls that come to rest without friction bear no tangential forces",
                "Give friction_history=True to granphon.DirectSimulation",
            )
        find_distribution = methodcaller(name, *arguments)
        edges: Array = find_distribution(self.samples[0])[0]

        def find_density(sample: Any) -> Array:
            """Return the probability density (bins,) of one sample."""
            _, density = find_distribution(sample)
            return np.asarray(density)

        densities = self.over_samples(find_density)
        sample_axis = len(self.shape)
        mean = np.mean(densities, axis=sample_axis)
        error = np.full_like(mean, np.nan)
        if self.n_samples > 1:
            error = standard_error(densities, sample_axis)
        return edges, mean, error

    def _average_history(self, name: str) -> Any:
        """Return the mean over samples of the attribute ``name`` that a history of friction gives
        them, with the shape of the load; None if samples have no history of friction.
        """
        if getattr(self.samples[0], name, None) is None:
            return None
        return self._average(attrgetter(name))

    @property
    def sliding_fraction(self) -> Any:
        """Fraction of the contacts that carry load whose tangential force is at Coulomb's limit;
        None without a history of friction.
        """
        return self._average_history("sliding_fraction")

    @property
    def tangential_ratio(self) -> Any:
        """Mean magnitude of the tangential forces over the mean normal force; None without a
        history of friction.
        """
        return self._average_history("tangential_ratio")

    @property
    def work(self) -> Any:
        """Work of the load since the start, a mean over contacts, J; None without a history of
        friction.
        """
        return self._average_history("work")

    @property
    def dissipated_energy(self) -> Any:
        """Energy lost since the start, a mean over contacts, J; None without a history of
        friction.
        """
        return self._average_history("dissipated_energy")

    @property
    def elastic_tensor(self) -> Array:
        """Elastic tensor in Voigt order: the mean over samples of their linear response.

        The tensor is (..., 3, 3), Pa, xx, yy, xy in the plane; (..., 6, 6), Pa, xx, yy, zz, yz, xz,
        xy in space; (..., 1, 1), N, of a chain. Samples of finite size do not have the symmetry of
        the lattice; velocities follow from the part of the tensor that has the symmetry.

        If samples have the same force, ``normal_stiffness`` k is the inverse of a mean of
        compliances. For several samples without friction the bulk modulus, on the triangular
        lattice, then differs from (3^(1/2)/2) k/d in second order of the differences of samples.
        """
        return np.asarray(self._average(lambda sample: sample.elastic_tensor))

    @property
    def is_isotropic(self) -> bool:
        """Whether samples are isotropic on average: on a line always, in the plane if the lattice
        has that symmetry, in space never.
        """
        periods = self.packing.structure.periods
        return periods == 1 or (periods == 2 and super().is_isotropic)

    @property
    def sampled_tensors(self) -> Array | None:
        """Elastic tensor of each sample, (..., n_samples, n, n), Voigt order; None if there is only
        one sample.
        """
        if self.n_samples < 2:
            return None
        return self.over_samples(attrgetter("elastic_tensor"))

    def polarised_waves(self, direction: ArrayLike) -> tuple[Array, Array]:
        """Return the velocities, m/s, of the n_u long waves along ``direction``, and their unit
        displacements.

        For one direction (p,) the velocities have the shape (..., n_u), and the displacements are
        the columns of (..., n_u, n_u). For directions (n, p) the shapes are (..., n, n_u) and (...,
        n, n_u, n_u). Both follow from the mean elastic tensor; in an isotropic plane from its bulk
        and shear modulus.
        """
        return self._find_waves(self.elastic_tensor, self.effective_density, direction)

    def _find_waves(
        self, tensor: Array, density: ArrayLike, direction: ArrayLike
    ) -> tuple[Array, Array]:
        """Return the velocities, m/s, and unit displacements of waves, of the shapes of
        :meth:`polarised_waves`, from elastic tensors (..., s, s) in Voigt order, Pa (N on a line),
        and densities (...), kg/m^3 (kg/m). Tensors and densities are those of each sample, or means
        over the samples.
        """
        structure = self.packing.structure
        directions = as_direction(direction, structure.periods)
        if structure.periods != 2 or not self.is_isotropic:
            squared_velocities = (
                symmetrise(tensor, structure) / np.asarray(density)[..., None, None]
            )
            return waves_of_tensor(squared_velocities, directions)
        bulk, shear = np.moveaxis(bulk_and_shear(tensor), -1, 0)
        # a sample that resists no shear has a modulus of zero, to rounding
        is_rounding = np.abs(shear) < _SHEAR_ROUNDING * np.abs(bulk)
        shear = np.where(is_rounding, np.maximum(shear, 0.0), shear)
        # v_L and v_T, m/s, from K and G, Pa (equation 16)
        wave_moduli = np.stack([bulk + shear, shear], axis=-1)
        velocities = np.sqrt(wave_moduli / np.asarray(density)[..., None])
        if directions.ndim > 1:
            velocities = np.repeat(velocities[..., None, :], len(directions), axis=-2)
        # the displacements of the transverse wave are normal to the direction
        normals = np.stack([-directions[..., 1], directions[..., 0]], axis=-1)
        displacements = np.stack([directions, normals], axis=-1)
        return velocities, np.broadcast_to(displacements, (*velocities.shape, 2))

    def wave_errors(self, direction: ArrayLike) -> Array | None:
        """Return the standard errors over samples of :meth:`long_waves` along ``direction``, m/s,
        of the same shape; None if there is only one sample.
        """
        tensors = self.sampled_tensors
        if tensors is None:
            return None
        density = np.asarray(self.effective_density)[..., None]
        velocities, _ = self._find_waves(tensors, density, direction)
        return standard_error(velocities, len(self.shape))

    def branch_scales(self, direction: ArrayLike, names: Sequence[str]) -> list[Array]:
        """Return the velocity, m/s, that scales each named branch of the ideal lattice to the long
        wave of the samples; shapes are those of :meth:`State.branch_scales`.

        Raises :class:`~granphon.base.errors.InputError` for a name that is none of
        :attr:`wave_names`.
        """
        velocities = self.long_waves(direction)
        ideal_velocities, _ = super().polarised_waves(direction)  # of the ideal lattice, m/s
        ideal_scales = super().branch_scales(direction, names)
        scales = []
        for name, ideal_scale in zip(names, ideal_scales, strict=True):
            branch = self.wave_names.index(one_of("names", name, self.wave_names))
            # in reduced units the branch of samples is taken to be that of the ideal lattice
            reduced_velocity = ideal_velocities[..., branch] / ideal_scale
            scales.append(np.asarray(velocities[..., branch] / reduced_velocity))
        return scales

    @property
    def _simulation(self) -> DirectSimulation | None:
        """The medium that made the state; None of samples that have the law of equal balls."""
        return self.law.simulation if isinstance(self.law, SampleLaw) else None

    @property
    def _is_exact(self) -> Any:
        """Whether the samples are in their exact geometry, at each load. If the medium names no
        geometry, each load has a geometry of its own.
        """
        simulation = self._simulation
        if simulation is None or simulation.geometry is not None:
            return self._fill_shape(self.finite_overlap)
        first_samples = self.samples[:: self.n_samples]
        return np.reshape([sample.is_exact for sample in first_samples], self.shape)[()]

    @property
    def _shrinkage(self) -> Any:
        """a/d at loads of the exact geometry, otherwise 1."""
        return np.where(self._is_exact, 1.0 - self.relative_overlap, 1.0)[()]

    @property
    def floats(self) -> bool:
        """Whether loose balls float in their cages, so that velocities depend on the numbering of
        the balls: in samples that were pressed from the gas in the directions of the lattice.
        """
        simulation = self._simulation
        return simulation is not None and simulation.floats

    @property
    def shear_deficit(self) -> Any:
        """Fraction by which the shear modulus is expected to be too small, as contacts have the
        directions of the lattice.

        These directions leave out that loose balls lean on others
        (:func:`~granphon.media.left_out.estimate_shear_deficit`). The deficit is None in the exact
        geometry, for equal balls, on a line, and where no contact resists slip. If only some loads
        are in the exact geometry, the deficit is zero at these.
        """
        simulation = self._simulation
        if simulation is None or not simulation.resists_slip:
            return None
        if np.all(self._is_exact):
            return None
        ratio = self.packing.relative_width
        periods = self.packing.structure.periods
        deficit = estimate_shear_deficit(
            self.contact_fraction, ratio, periods, simulation.friction_history
        )
        return np.where(self._is_exact, 0.0, deficit)[()]

    @property
    def valid(self) -> Any:
        """Whether the directions of the lattice leave out at most 1 % of the shear modulus
        (:attr:`shear_deficit`), at each load.

        A state without such a deficit is valid. So is one that an automatic medium chose, whatever
        its deficit: the expected error by which the medium was chosen counts the deficit. No state
        that was pressed from the gas in these directions is valid, as its velocities depend on the
        numbering of the balls (:attr:`floats`).
        """
        if self.floats:
            return self._fill_shape(False)
        deficit = self.shear_deficit
        if self.chosen_automatically or deficit is None:
            return self._fill_shape(True)
        return deficit <= LEFT_OUT_LIMIT

    @property
    def pressure(self) -> Any:
        """Pressure P, N/m in the plane, Pa in space: see :attr:`granphon.ContactState.pressure`.

        In the exact geometry the pressure is the work of the load on the cell, over the change of
        the size of the cell: the mean over samples.
        """
        if not self.finite_overlap:
            return super().pressure
        boundary_force = self._average(attrgetter("boundary_force"))
        exact_pressure = self.packing.pressure_per_force * boundary_force
        return np.where(self._is_exact, exact_pressure, super().pressure)[()]

    @property
    def mean_errors(self) -> dict[str, Any]:
        """Standard error over samples of the force or overlap, as "force_error" (N) or
        "overlap_error" (m).

        At a given force or pressure it is the error of the overlap, at a given overlap the error of
        the force. The dictionary is empty if there is only one sample.
        """
        if self.n_samples < 2:
            return {}
        name = "force" if self.fixed_overlap else "overlap"
        return {f"{name}_error": self.standard_error(name)}

    @property
    def exponent(self) -> Any:
        """Local exponent d log v_L / d log P; exactly 1/6 for equal balls and on a line.

        The exponent belongs to the modulus of longitudinal waves, averaged over all directions and
        samples: K + G in the plane, K + 4G/3 in space, with the averages of Voigt where samples are
        not isotropic.

        The exponent is a difference over :data:`~granphon.array.sample.STEP` of log f to either
        side: each sample is solved at two more loads, when the exponent or its error is first asked
        for. The derivative itself is not used, as its variance is infinite: a contact of a small
        overlap h contributes a slope that goes as h^(-1/2). After a history of friction both loads
        are higher, by 5 % and 15 %. In the exact geometry the spacing falls with the load, by f/k
        for each unit of log f; density and pressure follow.
        """
        if not self.packing.spread_matters:
            return super().exponent
        periods = self.packing.structure.periods
        shortening = self._shortening
        exponent = _compute_exponent(np.mean(self._exponent_terms, axis=-2))
        velocity_rise = exponent - 0.5 * periods * shortening  # d log v / d log f
        pressure_rise = 1.0 + (periods - 1.0) * shortening  # d log P / d log f
        return (velocity_rise / pressure_rise)[()]

    @property
    def exponent_error(self) -> Any:
        """Standard error of ``exponent`` over the samples: 0 for equal balls and on a line, where
        the exponent is exact; else nan, not known, if there is one sample.
        """
        if not self.packing.spread_matters:
            return super().exponent_error
        if self.n_samples == 1:
            return self._fill_shape(math.nan)
        error = jackknife(_compute_exponent, self._exponent_terms)
        periods = self.packing.structure.periods
        pressure_rise = 1.0 + (periods - 1.0) * self._shortening  # d log P / d log f
        return (error / pressure_rise)[()]

    @property
    def _exponent_terms(self) -> Array:
        """The terms M', M, k and f of each sample, (..., n_samples, 4), from whose means over the
        samples :func:`_compute_exponent` finds the exponent.
        """
        tensors_beside = self.over_samples(attrgetter("elastic_tensors_beside"))
        lower_modulus, higher_modulus = np.moveaxis(longitudinal_modulus(tensors_beside), -1, 0)
        modulus = longitudinal_modulus(self.over_samples(attrgetter("elastic_tensor")))
        rise = modulus * np.log(higher_modulus / lower_modulus) / (2.0 * STEP)  # dM / d log f
        # samples at the same force need neither their force nor their stiffness
        force = np.ones_like(modulus)
        stiffness = np.ones_like(modulus)
        if self.fixed_overlap:
            force = self.over_samples(attrgetter("force"))
            stiffness = self.over_samples(attrgetter("normal_stiffness"))
        return np.stack([rise * stiffness / force, modulus, stiffness, force], axis=-1)

    @property
    def _shortening(self) -> Array:
        """Fraction by which the spacing falls for each unit of log f; 0 in the directions of the
        lattice. In the exact geometry the fraction is f/(k a), with the spacing a.
        """
        spacing = self.packing.diameter - np.asarray(self.overlap)
        return np.where(self._is_exact, self.force / self.normal_stiffness / spacing, 0.0)


def read_geometry(value: Any) -> str | None:
    """Read the name of a geometry; None leaves the geometry to the load.

    The function is a rule of :mod:`granphon.base.validation`.
    """
    return None if value is None else choice(value, options=GEOMETRIES)


#: rule of validation for what the cell of an array may do
read_boundary = partial(choice, options=BOUNDARIES)


@dataclass(frozen=True, eq=False)
class DirectSimulation(Medium[SimulatedState]):
    """The medium that simulates samples of the packing, ball by ball, at rest under load.

    Parameters
    ----------
    packing : the balls, on a lattice that stands without friction: the chain, the triangular
        lattice, fcc, hcp, or one given as data; others with a history of friction from the gas.
    shape : (L1, ..., Lp), numbers of cells of a periodic sample along the p vectors of the cell; by
        default (16384,), (128, 128) or (24, 24, 24).
    seed : seed of the first sample; the next ones have the next seeds. Diameters are the same on
        any machine.
    samples : number of samples that are averaged.
    diameters : (L1, ..., Lp), m, or (L1, ..., Lp, n) of n > 1 balls in the cell, instead of a shape
        and a seed: one sample of just these balls, whatever the seed. The diameters are shifted to
        have the packing's diameter as their mean; a packing without a spread takes their spread.
    executor : a :class:`concurrent.futures.Executor`, or an object with the same methods, that
        solves samples in parallel.
    workers : number of threads for each Fourier transform. Neither ``executor`` nor ``workers``
        changes results.
    friction_history : load the samples with friction, step by step from ``start``: tangential
        forces, by Mindlin's law up to Coulomb's limit, are then part of the statics. ``at_*`` is
        the state of monotonic loading, and :meth:`path` takes loads up and down. By default samples
        come to rest without friction.
    friction_coefficient : mu of the contacts, zero to infinity; a history needs it.
    geometry : "exact": directions, lever arms and overlaps follow from positions, with
        ``finite_overlap`` (prestress and boundary included). "lattice": contacts keep the
        directions of the lattice, the limit of small spread, which is faster. None, the default:
        "exact" for a history of friction; without a history "lattice" at loads where the directions
        of the lattice are expected to leave out less than 1e-3 of the shear modulus, else "exact".
        Equal balls, and balls that differ by more than a fifth of their diameter, have the
        directions of the lattice.
    start : where the loading starts, at rest without friction: a reduced spacing a*, 1/2 by
        default, or a load as {"force": 1.0} (N), {"pressure": ...}, {"overlap": ...} (m). Or "gas":
        balls lie apart on their sites, and are pressed with friction until they carry a load; for
        lattices that are not rigid without friction.
    shear_response : tangential stiffness of a contact under sound, after a history. "stick": eta k
        everywhere, as for small cycles of the load. For a load that continues in one direction,
        "slide": eta k, and zero where a contact slides; or "partial_slip": ``eta k (1 - |T|/mu
        f)^(1/3)``, as if ``|T|`` were about to grow at every contact.
    step_tolerance : steps of the load are halved until a halving changes f* by less than this
        fraction.
    ordered : whether ``at_*`` take the loads in the order given, as :meth:`path` does.
    boundary : "isotropic", the default of arrays: the cell keeps its shape, and the mean of its
        principal stresses is the pressure. "stress", the default of crystals: the cell may shear,
        and its whole stress is hydrostatic; not after a history of friction. An overlap then is
        that of a cell of the same size.

    Raises
    ------
    MechanismError : the lattice does not stand without friction, as sc, bcc, diamond, square,
        honeycomb and kagome do not, and there is no history of friction that starts from the gas.
    InputError : something else than a :class:`~granphon.Packing`, motions other than those along
        the periods, a shape or number that is not whole and above zero, a sample whose seed is no
        whole number from 0 to 2^64 - 1; diameters that are not finite and above zero, of another
        shape, or with a shape or samples; a width above zero that is below 1e-20 of the diameter;
        the exact geometry of equal balls, on a line, or of balls that differ by more than a fifth
        of their diameter; options of a history without ``friction_history``, a history without a
        friction coefficient, on a chain, of balls that resist no slip, with the boundary "stress",
        or from a start that no sample bears; an executor without ``submit``, and another word for
        an option than those above.

    ``at_*`` take scalars or arrays: floats in, floats out. They raise
    :class:`~granphon.base.errors.InputError` for a load that is not finite, not compressive, of a
    kind that crystals alone bear, or presses balls together by their whole diameter; for more
    balls, samples or loads than memory holds; for a load so low that a sample carries none (at and
    below the rigidity threshold, a* = 0.343 on the triangular lattice), or below the start of a
    history; with ``finite_overlap`` in the geometry of the lattice, which has no such terms, and
    with ``finite_overlap=False`` in the exact geometry, which has them. They raise
    :class:`~granphon.base.errors.ConvergenceError` if no equilibrium is found, or a path ends
    before its last load; ``reached`` of the error is then the state at the loads before. They raise
    :class:`~granphon.base.errors.GranphonError` if the executor loses a worker.
    """

    packing: Packing = field(metadata={"kind": Packing})
    shape: tuple[int, ...] | None = None
    seed: int = 0
    samples: int = 1
    diameters: Array | None = field(default=None, metadata={"kind": [NoneType, np.dtype(float)]})
    executor: Executor | None = field(default=None, compare=False, repr=False)
    workers: int = field(default=1, compare=False, repr=False)
    friction_history: bool = False
    friction_coefficient: float | None = FrictionHistory.friction_coefficient
    geometry: str | None = None
    start: float | Load | str = field(
        default=FrictionHistory.start, metadata={"kind": float | Load | str}
    )
    shear_response: str = FrictionHistory.shear_response
    step_tolerance: float = FrictionHistory.step_tolerance
    ordered: bool = FrictionHistory.ordered
    boundary: str = "isotropic"

    #: what a scene may set: neither diameters nor executor and workers
    options: ClassVar[Mapping[str, Option]] = {
        "shape": Option(
            shape,
            read_cells,
            "cells along each period of the array, by default one of these, by the dimension of the"
            " lattice",
            ", ".join(f"`{' '.join(map(str, cells))}`" for cells in DEFAULT_SHAPES.values()),
        ),
        "seed": Option(
            seed,
            partial(whole, low=0, high=_MOST_SEED),
            "seed of the diameters of the first sample; each further sample has the next number",
        ),
        "samples": Option(
            samples,
            partial(whole, low=1, high=10_000),
            "how many arrays are averaged; two or more have standard errors",
        ),
        "geometry": Option(
            geometry,
            read_geometry,
            "`lattice`: contacts keep the directions of the lattice; `exact`: their own, with"
            " `finite_overlap`; left out: [exact where it"
            " matters](../explanation/simulation.md#which-geometry)",
        ),
        "boundary": Option(
            boundary,
            read_boundary,
            "`isotropic`: the cell keeps its shape; `stress`: it may shear, and its whole stress is"
            " [hydrostatic](../explanation/rest.md#two-flags); not with `friction_history`",
        ),
        **HISTORY_OPTIONS,
    }

    name = SIMULATION
    words = "simulation"

    def __post_init__(self) -> None:
        """Read the options, replace each by the value that was read, and raise the errors that the
        class lists.
        """
        given_packing(self.packing)
        for name, value in self.history.options.items():
            object.__setattr__(self, name, value)
        self._require_simulated_lattice()
        periods = self.packing.structure.periods
        object.__setattr__(self, "shape", self._read_shape() or DEFAULT_SHAPES[periods])
        if self.diameters is not None:
            diameters = self._read_diameters(self.diameters)
            object.__setattr__(self, "packing", self._take_spread(diameters))
            object.__setattr__(self, "diameters", diameters)
            object.__setattr__(self, "shape", diameters.shape[:periods])
        self._require_width()
        samples = whole_number("samples", self.samples, 1, _MOST_SAMPLES)
        object.__setattr__(self, "samples", samples)
        # the last sample has the seed seed + samples - 1
        seed = whole_number("seed", self.seed, 0, _MOST_SEED + 1 - samples)
        object.__setattr__(self, "seed", seed)
        whole_number("workers", self.workers, 1)
        if self.diameters is not None and samples > 1:
            raise InputError("diameters are given, which make one sample", mend="Leave samples out")
        require_executor(self.executor)
        object.__setattr__(self, "geometry", self._read_geometry())
        object.__setattr__(self, "boundary", require("boundary", read_boundary, self.boundary))
        require_small(self.ratio)
        self._require_history()

    def _require_width(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the width of the diameters is above
        zero, but below 1e-20 of their mean.
        """
        if 0.0 < self.packing.width < _LEAST_WIDTH * self.packing.diameter:
            raise InputError(
                f"the width of the diameters is {self.packing.relative_width:.3g} of their mean",
                f"Samples are simulated from {_LEAST_WIDTH:g} on",
                "Leave the spread out",
            )

    def _require_simulated_lattice(self) -> None:
        """Raise :class:`~granphon.base.errors.MechanismError` unless the lattice stands without
        friction, or a history holds the balls by friction from the gas on. Raises
        :class:`~granphon.base.errors.InputError` for motions that are not simulated.
        """
        structure = self.packing.structure
        motions = self._read_motions()
        history = self.history
        has_friction = history.is_loaded and history.friction_coefficient != 0
        if has_friction and history.from_gas:
            return
        soft_waves = _explain_soft_waves(structure, motions)
        if soft_waves is not None:
            raise MechanismError(
                f"the {structure.name} lattice is not simulated, because it does not stand without"
                f" friction",
                soft_waves,
                self._suggest_support(),
            )

    def _read_motions(self) -> Motions:
        """Return the motions of simulated balls; raise
        :class:`~granphon.base.errors.InputError` if those of the packing are others.
        """
        packing = self.packing
        structure = packing.structure
        periods = structure.periods
        motions_of_lattice = default_motions(periods)
        why = "Simulated balls move along the periods of their lattice"
        if structure.dimension > periods:
            problem = f"balls with a lattice of {periods} periods in space are not simulated"
            raise InputError(problem, why, "Use another medium")
        if packing.motions not in (None, motions_of_lattice.name):
            problem = f"balls with the motions {packing.motions!r} are not simulated"
            mend = f"Use another medium, or the motions {motions_of_lattice.name!r}"
            raise InputError(problem, why, mend)
        return motions_of_lattice

    def _suggest_support(self) -> str:
        """Return the sentence of a message that says what holds a lattice which does not stand
        without friction.
        """
        packing = self.packing
        alternative = (
            "use another medium, or a lattice with more contacts, such as triangular or fcc"
        )
        lattice_with_friction = ContactLattice.of(
            packing.structure, packing.material.mindlin_ratio, bending=packing.bending
        )
        if lattice_with_friction.mechanism:
            return f"Friction does not hold it either: {alternative}"
        friction = "" if packing.friction else "friction: true of the packing and "
        if self.history.is_loaded:
            settings = f"{friction}start: gas, and a friction_coefficient above zero"
            start = f"Start the history at the gas ({settings}), from which friction holds it"
            return f"{start}; or {alternative}"
        settings = f"{friction}friction_history: true with a friction_coefficient and start: gas"
        return f"A simulation with {settings} simulates it; or {alternative}"

    def _read_shape(self) -> tuple[int, ...] | None:
        """Return the numbers of cells along the periods (L1, ..., Lp), or None if they are not
        given. Raises InputError for values that are no such numbers, and for more cells than any
        memory holds.
        """
        if self.shape is None:
            return None
        periods = self.packing.structure.periods
        rule = partial(lengths, low=1, high=_MOST_SIDE, periods=periods)
        shape: tuple[int, ...] = require("shape", rule, self.shape)
        cells = math.prod(shape)
        if cells > _MOST_CELLS:
            raise InputError(
                f"shape is {shape}, which are {float(cells):.3g} cells",
                f"No memory holds more than {_MOST_CELLS:.3g}",
                "Give fewer",
            )
        return shape

    def _read_diameters(self, diameters: ArrayLike) -> Array:
        """Return ``diameters`` as a read-only array, see
        :func:`~granphon.media.crystal_sites.read_diameters`; InputError also if a ``shape`` is
        given that is neither the default nor that of the diameters.
        """
        structure = self.packing.structure
        periods = structure.periods
        array = read_only(read_diameters(diameters, periods, structure.n_balls))
        if self.shape not in (DEFAULT_SHAPES[periods], array.shape[:periods]):
            raise InputError(
                f"shape is {self.shape!r}, and the diameters have the shape {array.shape}",
                "The diameters determine the shape of the sample",
                "Leave shape out",
            )
        return array

    def _take_spread(self, diameters: Array) -> Packing:
        """Return the packing. If it has no spread of its own, and the given ``diameters`` (L1, ...,
        Lp) or (L1, ..., Lp, n), m, differ, it takes theirs.
        """
        packing = self.packing
        if packing.spread is not None or not np.ptp(diameters):
            return packing
        # the packing takes the mean of the shifted list, which rounding may have changed
        shifted_diameters = packing.diameter + (diameters - np.mean(diameters))
        spread = Measured(tuple(shifted_diameters.ravel().tolist()))
        return replace(packing, spread=spread, diameter=spread.mean)

    def _read_geometry(self) -> str | None:
        """Return the geometry of contacts, "lattice" or "exact"; None if the load decides.

        If the caller named no geometry: balls that cannot be exact
        (:func:`~granphon.media.left_out.can_be_exact`) have "lattice"; other balls have "exact"
        after a history of friction, and otherwise the load decides. Raises InputError for another
        word, and for the exact geometry of equal balls, or on a line.
        """
        geometry: str | None = require("geometry", read_geometry, self.geometry)
        if geometry is None and not can_be_exact(self.packing):
            geometry = LATTICE
        elif geometry is None and self.history.is_loaded:
            geometry = EXACT
        if geometry == EXACT and not self.packing.spread_matters:
            case = "on a line" if self.packing.width else "of equal balls"
            raise InputError(
                f"the exact geometry {case} is not simulated",
                f"The contacts {case} have the directions of the lattice anyway",
                "Use a medium with finite_overlap",
            )
        return geometry

    def _require_history(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for a history of friction that balls do
        not have, or a start that no sample can bear.
        """
        history = self.history
        if not history.is_loaded:
            return
        if self.boundary != "isotropic":
            problem = f"a friction_history with the boundary {self.boundary!r} is not simulated"
            why = "Along its path the cell keeps its shape"
            raise InputError(problem, why, "Leave boundary out, or friction_history")
        if self.packing.structure.periods == 1:
            why = "On a line contacts do not slip, so that friction does nothing"
            raise InputError("a chain has no friction_history", why, "Leave it out")
        if not self.packing.mindlin_ratio > 0.0:
            raise InputError(
                "friction_history needs contacts with friction",
                "The balls of this packing resist no slip (its mindlin_ratio is zero)",
                "Give the packing friction=True",
            )
        start = history.start
        if isinstance(start, float) and self.packing.width:  # a reduced spacing a*
            start = Load("overlap", self.packing.width * (start - 0.5))
        if isinstance(start, Load):
            try:
                require_load(self.packing, start.applied, self._largest_excess)
            except InputError as error:
                start_error = InputError(f"the start of the loading: {error}")
                start_error.option = "start"
                raise start_error from None

    @cached_property
    def history(self) -> FrictionHistory:
        """How samples are loaded: the options of a history, read as one; see
        :meth:`FrictionHistory.read`.
        """
        options = {name: getattr(self, name) for name in HISTORY_OPTIONS}
        return require("DirectSimulation", FrictionHistory.read, options)  # type: ignore[no-any-return]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, DirectSimulation):
            return NotImplemented
        if self._key != other._key:
            return False
        # with equal keys both have diameters, of one shape, or neither has
        return bool(np.all(np.asarray(self.diameters) == np.asarray(other.diameters)))

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[Any, ...]:
        """The values that determine the results, for comparison and hashing. An array has no hash:
        of given diameters the key says only that they are given.
        """
        has_diameters = self.diameters is not None
        return (
            self.packing,
            self.shape,
            self.seed,
            self.samples,
            has_diameters,
            self.geometry,
            self.boundary,
            self.history,
        )

    @property
    def cells(self) -> tuple[int, ...]:
        """Numbers of cells (L1, ..., Lp) of a sample: ``shape``, or its default."""
        return self.shape or DEFAULT_SHAPES[self.packing.structure.periods]

    @property
    def balls(self) -> int:
        """Number of balls of a sample."""
        return math.prod(self.cells) * self.packing.structure.n_balls

    @property
    def is_exact(self) -> bool:
        """Whether contacts have the geometry of the displaced balls, and so finite overlap,
        whatever the load.
        """
        return self.geometry == EXACT

    def has_finite_overlap(self, wants_terms: bool) -> bool:
        """Return whether the states have the terms of relative order delta/d, see
        :meth:`Medium.has_finite_overlap`. If the simulation names a geometry, the geometry decides,
        whether the user asks for the terms (``wants_terms``) or not. Otherwise they are there if
        the user asks for them; if not, the load decides, and the answer is False.
        """
        return wants_terms if self.geometry is None else self.is_exact

    @property
    def ratio(self) -> float:
        """W/d if the simulation names the exact geometry; zero if it names that of the lattice, and
        zero also if it names none: :meth:`by_geometry` makes simulations that do.
        """
        return self.packing.relative_width if self.is_exact else 0.0

    def by_geometry(
        self, load: Load, finite_overlap: bool | None = None
    ) -> list[tuple[Self, list[int]]]:
        """Return pairs: the simulation in one geometry, and the indices, in C order, of the values
        of the applied ``load`` that have this geometry. Each geometry that occurs has one pair.

        If the simulation names a geometry, all values have it. Otherwise
        :func:`~granphon.media.left_out.choose_geometries` finds the geometry of each value, in
        which ``finite_overlap``, unless it is None, decides.
        """
        if self.geometry is not None:
            return [(self, list(range(load.size)))]
        geometries = choose_geometries(self.packing, load.applied.flat, finite_overlap)
        simulations = []
        for geometry in dict.fromkeys(geometries):
            indices = [index for index, name in enumerate(geometries) if name == geometry]
            simulations.append((replace(self, geometry=geometry), indices))
        return simulations

    @property
    def floats(self) -> bool:
        """Whether loose balls float in their cages, so that velocities depend on the numbering of
        the balls: in samples that are pressed from the gas in the directions of the lattice.
        """
        return self.history.is_loaded and self.history.from_gas and not self.ratio

    @property
    def resists_slip(self) -> bool:
        """Whether contacts have springs against slip under sound. They have none in a packing
        without friction. With mu = 0 all contacts slide, and have springs only if
        ``shear_response`` is "stick".
        """
        history = self.history
        all_slide = history.friction_coefficient == 0.0 and history.shear_response != "stick"
        return self.packing.mindlin_ratio > 0.0 and not all_slide

    @property
    def _largest_excess(self) -> float:
        """Excess, m, over the mean diameter that the largest ball has, of given diameters, or may
        have, of drawn ones; zero of equal balls.
        """
        packing = self.packing
        if packing.spread is None:
            return 0.0
        if self.diameters is None:
            return packing.spread.largest
        return packing.width_units.width * float(np.max(self.deviations(0)))

    def seed_of(self, index: int) -> int | None:
        """Return the seed of the sample number ``index``, from 0; None if diameters are given."""
        return None if self.diameters is not None else self.seed + index

    def deviations(self, index: int) -> Array:
        """Return the reduced deviations x = Delta/W of the diameters of a sample, without a unit.
        Their mean is zero. ``index`` is the number of the sample, from 0.

        The shape is (L1, ..., Lp), and (n, L1, ..., Lp) with n > 1 balls in the cell.
        """
        packing = self.packing
        n = packing.structure.n_balls
        if packing.spread is None:
            return np.zeros((n, *self.cells) if n > 1 else self.cells)
        diameters = self.diameters
        if diameters is None:
            drawn_shape = (*self.cells, n) if n > 1 else self.cells
            diameters = packing.spread.sample(drawn_shape, self.seed + index)
        if n > 1:  # the balls of a cell come in front of the cells
            diameters = np.ascontiguousarray(np.moveaxis(diameters, -1, 0))
        return np.asarray(subtract_mean(diameters) / packing.width_units.width)

    @property
    def is_quick(self) -> bool:
        """Whether the states of the medium take less than 0.1 s: those of arrays may not."""
        return False

    @property
    def arrays(self) -> tuple[Self, ...]:
        """The simulations that the medium runs: only this simulation."""
        return (self,)

    @cached_property
    def law(self) -> HertzLaw | SampleLaw:
        """Contact law: mean force against overlap of the samples; Hertz's law for equal balls and
        on a line.

        With a history of friction the law is that of monotonic loading. The law solves its samples
        one after the other, without the ``executor``.
        """
        if not self.packing.spread_matters:
            return self.packing.law
        # states keep the law: it must be picklable, and outlive an executor
        return SampleLaw(replace(self, executor=None, ordered=False))

    @in_newtons
    def at(self, load: Load, *, finite_overlap: bool | None = None) -> SimulatedState:
        """Return the state of all samples at a load. :meth:`at_force`, :meth:`at_pressure` and
        :meth:`at_overlap` take the values of the load in SI.

        If the simulation names no geometry, ``finite_overlap`` (True: exact, False: lattice) or the
        load decides; otherwise a ``finite_overlap`` that contradicts the geometry is an error. The
        errors are those that the class lists.
        """
        require_of_packing(load)
        applied = load.applied
        wants_finite_overlap = read_finite_overlap(finite_overlap)
        if self.geometry is None:
            return self._join_geometries(applied, finite_overlap)
        if wants_finite_overlap and not self.is_exact:
            raise no_finite_overlap(self.name, can_be_exact(self.packing))
        is_denied = finite_overlap is not None and not wants_finite_overlap
        if self.is_exact and is_denied:
            raise InputError(
                "the exact geometry has finite overlap",
                "Balls that have their true geometry overlap as much as they do",
                "Leave finite_overlap out",
            )
        prescribed = self.prescribed(applied)
        self._require_memory(applied)
        if self.history.is_loaded:
            return self._press(applied, prescribed)
        equilibria = self._find_equilibria(prescribed)
        samples = []
        for load_index in range(applied.size):
            for sample_index, equilibria_of_sample in enumerate(equilibria):
                equilibrium = equilibria_of_sample[load_index]
                samples.append(Sample(self.packing, self.seed_of(sample_index), equilibrium))
        return SimulatedState.of(self, samples, applied)

    def follow(
        self, load: Load, changes: Sequence[Change], finite_overlap: bool | None = None
    ) -> tuple[Any, list[Course[Any]]]:
        """Return the state at a single load, and its course with each of the ``changes``, in the
        geometry that ``finite_overlap`` or else the load decides on, as in :meth:`at`.

        A change maps a relative step of a parameter to the changed simulation and load; its course
        maps the step to the state. The course follows from the linear response of each sample at
        rest. After a history of friction each state of a course is solved anew, as it depends on
        the way to the load.
        """
        if self.history.is_loaded:
            return super().follow(load, changes, finite_overlap)
        state = self.at(load, finite_overlap=finite_overlap)
        [(simulation, _)] = self.by_geometry(load, finite_overlap)
        (reduced_load,) = simulation._prescribe(load.applied)
        followers = [
            EquilibriumFollower(sample.equilibrium, reduced_load) for sample in state.samples
        ]
        return state, [simulation._follow_samples(followers, change) for change in changes]

    def _follow_samples(
        self, followers: Sequence[EquilibriumFollower], change: Change
    ) -> Course[SimulatedState]:
        """Return the course of the state of all samples with a ``change``, in the geometry of this
        simulation, which the changed load might not have chosen. The ``followers`` are those of the
        equilibria of the samples.
        """

        def change_simulation(step: float) -> tuple[DirectSimulation, Load]:
            """Return the simulation and the applied load changed by a ``step``."""
            medium, changed_load = change(step)
            return replace(medium, geometry=self.geometry), changed_load.applied

        def reduce_change(step: float) -> tuple[ReducedLoad, float]:
            """Return the changed load in reduced units and the changed W/d, on which alone the
            equilibrium in reduced units depends.
            """
            changed_simulation, changed_load = change_simulation(step)
            return changed_simulation._prescribe(changed_load)[0], changed_simulation.ratio

        courses = [follower.follow(reduce_change) for follower in followers]

        def find_state(step: float) -> SimulatedState:
            """Return the state of all samples at a ``step`` of the change."""
            changed_simulation, changed_load = change_simulation(step)
            changed_samples = [
                Sample(changed_simulation.packing, self.seed_of(index), course.at(step))
                for index, course in enumerate(courses)
            ]
            return SimulatedState.of(changed_simulation, changed_samples, changed_load)

        return Course(find_state, min(course.step for course in courses))

    def _join_geometries(self, load: Load, finite_overlap: bool | None) -> SimulatedState:
        """Return one state at an applied load each of whose values has its own geometry, that of
        :meth:`by_geometry`. If ``finite_overlap`` is not None, all values have the geometry that it
        names.

        The ``load_index`` of an error is that of the failing value in the whole load.
        """
        self.require(load)
        simulations = self.by_geometry(load, finite_overlap)
        if finite_overlap is not None:  # one geometry at all loads
            [(only_simulation, _)] = simulations
            return only_simulation.at(load, finite_overlap=finite_overlap)
        samples_of_load: list[Sequence[Any]] = [() for _ in range(load.size)]
        for simulation, indices in simulations:
            try:
                samples = simulation.at(load.flat[indices]).samples
            except GranphonError as error:
                if error.load_index is not None:
                    error.load_index = indices[error.load_index]
                raise
            for position, index in enumerate(indices):
                first_sample = position * self.samples
                samples_of_load[index] = samples[first_sample : first_sample + self.samples]
        all_samples = list(itertools.chain.from_iterable(samples_of_load))
        return SimulatedState.of(self, all_samples, load)

    def _find_equilibria(self, prescribed: Sequence[ReducedLoad]) -> list[dict[int, Equilibrium]]:
        """Return, for each sample, its equilibria without friction by the index of the load in
        ``prescribed``. The samples are solved in parallel if there is an executor.
        """
        find_equilibria_of_sample = partial(
            find_equilibria,
            lattice=self.packing.structure,
            prescribed=prescribed,
            workers=self.workers,
            ratio=self.ratio,
            boundary=self.boundary,
        )
        deviations = [read_only(self.deviations(index)) for index in range(self.samples)]
        if self.executor is None:
            return list(map(find_equilibria_of_sample, deviations))
        with naming_lost_workers("the simulation"):
            jobs = [self.executor.submit(find_equilibria_of_sample, array) for array in deviations]
            equilibria = [job.result() for job in jobs]
        return [self._share(equilibria_of_sample) for equilibria_of_sample in equilibria]

    def _share(self, equilibria: dict[int, Equilibrium]) -> dict[int, Equilibrium]:
        """Return the equilibria of one sample, by the index of the load, which share one copy of
        the deviations and one of the stencils.

        Each equilibrium from another process has copies of its own, which would fill the memory.
        """
        first_equilibrium = next(iter(equilibria.values()))
        stencils = Stencils(
            first_equilibrium.stencils.shape,
            workers=self.workers,
            lattice=first_equilibrium.lattice,
        )
        return {
            index: equilibrium.share(first_equilibrium.deviations, stencils)
            for index, equilibrium in equilibria.items()
        }

    @in_newtons
    def path(
        self,
        load: Load | None = None,
        *,
        force: ArrayLike | None = None,
        pressure: ArrayLike | None = None,
        overlap: ArrayLike | None = None,
        progress: Progress = silent,
    ) -> SimulatedState:
        """Return the states at loads that are applied in the order given: up, down, in cycles.

        Exactly one of force (N), pressure and overlap (m) is a list, or ``load`` is a
        :class:`~granphon.balls.loads.Load` of many values. The path begins at :attr:`start`, from
        where the first load is reached. ``progress`` is told of each load of each sample. Raises
        :class:`~granphon.base.errors.InputError` without ``friction_history``, where the order has
        no meaning, for numbers that do not say which load they are, and for a ``progress`` without
        ``step``; and the errors of :meth:`at`. If a load is not reached, ``reached`` of the error
        is the state at the loads before it, None if there are none.
        """
        if not self.history.is_loaded:
            raise InputError(
                "a path needs friction_history",
                "Without friction the forces do not depend on the way to the load",
                "Give friction_history=True, or use at_force",
            )
        require_progress(progress)
        values_of_kinds = {"force": force, "pressure": pressure, "overlap": overlap}
        applied = _read_path(load, values_of_kinds).applied
        self._require_memory(applied)
        simulation = replace(self, ordered=True)
        prescribed = simulation.prescribed(applied)
        return simulation._press(applied, prescribed, progress)

    def _press(
        self, load: Load, prescribed: Sequence[ReducedLoad], progress: Progress = silent
    ) -> SimulatedState:
        """Return the state of all samples at every value of ``load``, applied one after the other
        in the order of the history.

        ``prescribed`` are the same values in reduced units; ``progress`` is told of each. If the
        path ends early, the error has the state at the values that all samples have reached as its
        ``reached``.
        """
        order = self.history.sort(prescribed)
        path = [prescribed[index] for index in order]
        results = self._press_each(path, progress)
        # the steps of the path that all samples have reached, sorted by their index in ``load``
        reached_count = min(len(samples) for samples, _ in results)
        reached_steps = sorted(range(reached_count), key=lambda step: order[step])
        reached_samples = []
        for step in reached_steps:
            reached_samples += [samples[step] for samples, _ in results]
        # the path ends with the sample that has come least far
        errors = [error for samples, error in results if len(samples) == reached_count]
        first_error = next((error for error in errors if error is not None), None)
        if first_error is None:
            return SimulatedState.of(self, reached_samples, load)
        if first_error.load_index is not None:
            first_error.load_index = order[first_error.load_index]
        if reached_samples:
            reached_load = load.flat[[order[step] for step in reached_steps]]
            first_error.reached = SimulatedState.of(self, reached_samples, reached_load)
        raise first_error

    def _press_each(
        self, path: Sequence[ReducedLoad], progress: Progress
    ) -> list[tuple[list[PressedSample], GranphonError | None]]:
        """Load each sample along a path, and return for each its states at the loads that it
        reaches, and the error at which its path ends, or None. ``progress`` is told of each load of
        each sample; with an executor, of all loads of a sample when it and those before it are
        done.
        """
        loaded_samples = [self._loaded_sample(index) for index in range(self.samples)]
        with progress.step("loading with friction", len(path) * self.samples) as step:
            if self.executor is None:
                return [sample.press(path, report=step.advance) for sample in loaded_samples]
            results = []
            with naming_lost_workers("the simulation"):
                jobs = [self.executor.submit(sample.press, path) for sample in loaded_samples]
                for job in jobs:
                    results.append(job.result())
                    step.advance(len(path))
            return results

    def find_memory(self, load: Load) -> float:
        """Return the estimated memory, bytes, that the states of the samples at all values of a
        load need, with their moduli.

        If the load decides on the geometry, the estimate is an upper bound: as if all values had
        the geometry that takes most.
        """
        simulations = [simulation for simulation, _ in self.by_geometry(load)]
        return max(estimate_memory(simulation, load) for simulation in simulations)

    def _require_memory(self, load: Load) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the samples at a load do not fit into
        the memory of this machine.
        """
        mend = "Take fewer balls (shape), samples or loads"
        require_memory(f"samples of {self.balls:,} balls", self.find_memory(load), mend)

    def _loaded_sample(self, index: int) -> LoadedSample:
        """Return the sample number ``index``, from 0, ready to be loaded with friction."""
        deviations = read_only(self.deviations(index))
        return LoadedSample(
            self.packing, self.seed_of(index), deviations, self.history, self.ratio, self.workers
        )

    def prescribed(self, load: Load) -> list[ReducedLoad]:
        """Return the prescribed force or overlap, in reduced units, of each value of an applied
        load, in C order; first raise as :meth:`require` does for a load that no sample can bear.
        """
        self.require(load)
        return self._prescribe(load)

    def _prescribe(self, load: Load) -> list[ReducedLoad]:
        """Return the load of each value as :meth:`prescribed` does, without its check."""
        return prescribe(self.packing, load, self.is_exact)

    def sample(self, load: ReducedLoad, before: tuple[float, Array] | None = None) -> Sample:
        """Return the first sample at rest under one reduced load, with the same numbers as in a
        state at many loads.

        In such a state, with the directions of the lattice and a cell that keeps its shape, the
        search at each load starts from the equilibrium at the load before it, in the order of
        :func:`~granphon.media.array_options.sort_by_load`. ``before`` holds the reduced overlap and
        displacements of that equilibrium; it is None for the first load. In exact directions, and
        where the cell shears, the search starts from the lattice, and ``before`` is not used.
        """
        deviations = read_only(self.deviations(0))
        stencils = Stencils(self.cells, workers=self.workers, lattice=self.packing.structure)
        equilibrium = find_equilibrium(
            deviations, stencils, load, before, self.ratio, self.boundary
        )
        return Sample(self.packing, self.seed_of(0), equilibrium)

    def average(self, samples: Sequence[Any], load: Load) -> SimulatedState:
        """Return the state that :meth:`SimulatedState.of` makes of ``samples``, or of records with
        those numbers of samples that a state reads.
        """
        return SimulatedState.of(self, samples, load)

    def list_balls(self, sample: Sample | PressedSample) -> dict[str, Array]:
        """Return the arrays, by name, of which :meth:`restore_sample` makes a sample again.

        They are the arrays of its equilibrium without the deviations, which are drawn again from
        the seed. Without a history of friction, ``derivatives`` (2,) is added: the reduced
        stiffness and its slope.
        """
        equilibrium: Any = sample.equilibrium
        arrays = {
            name: getattr(equilibrium, name) for name in _list_names_of_arrays(type(equilibrium))
        }
        balls = {name: np.asarray(array) for name, array in arrays.items() if array is not None}
        if not self.history.is_loaded:  # a history's derivatives follow from the elastic tensors
            balls["derivatives"] = np.array([equilibrium.stiffness, equilibrium.stiffness_slope])
        return balls

    def restore_sample(self, balls: Mapping[str, Array]) -> Sample | PressedSample:
        """Return the first sample from its arrays by name, as :meth:`list_balls` lists them."""
        seed = self.seed_of(0)
        kind: type[Equilibrium] = TrueEquilibrium if self.ratio else Equilibrium
        if self.history.is_loaded:
            kind = PressedEquilibrium
        arrays: dict[str, Any] = {
            name: balls[name] for name in _list_names_of_arrays(kind) if name in balls
        }
        deviations = read_only(self.deviations(0))
        structure = self.packing.structure
        equilibrium: Any = kind(deviations=deviations, lattice=structure, **arrays)
        if self.history.is_loaded:
            return PressedSample(self.packing, seed, equilibrium, self.history.shear_response)
        # the derivatives are put where the equilibrium keeps them, so that it does not solve again
        equilibrium.derivatives.update(enumerate(balls["derivatives"].tolist(), start=1))
        return Sample(self.packing, seed, equilibrium)

    @in_newtons
    def require(self, load: Load) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for an applied load that no sample can
        bear, solving none.

        A load below the start of a history is refused here if load and start are both forces, or
        both overlaps. :meth:`require_start` compares a force with an overlap. A start at the gas is
        compared with the loads when samples are loaded.
        """
        require_load(self.packing, load, self._largest_excess)
        start = self._start
        if start is not None:
            require_above(start, self._prescribe(load))

    @property
    def _start(self) -> ReducedLoad | None:
        """The start below which no load may be, in reduced units; None if there is none, or if the
        start at the gas must be found first.
        """
        history = self.history
        may_go_down = history.ordered or not self.packing.width  # equal balls never slip
        if not history.is_loaded or may_go_down:
            return None
        start = history.reduce_start(self.packing, self.is_exact)
        return start if isinstance(start, ReducedLoad) else None

    @in_newtons
    def require_start(self, load: Load) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for a load below the start of a history,
        where one of the two is a force and the other an overlap.

        The start is then solved in each sample: a start that is given as a force has another
        overlap in each, and a start that is given as an overlap has another force.
        """
        if self.count_start(load):
            path = self.prescribed(load)
            for index in range(self.samples):
                self._loaded_sample(index).require_start(path)

    def count_start(self, load: Load) -> float:
        """Return the cost of the start that :meth:`require_start` solves for a ``load``, as the
        number of balls of a quick start, at high force in the directions of the lattice, that takes
        as long. The cost is zero if no start is solved. Raises the errors of :meth:`prescribed`.
        """
        start = self._start
        if start is None:
            return 0.0
        starts_at_force = start.overlap is None
        are_forces = [reduced_load.overlap is None for reduced_load in self.prescribed(load)]
        if all(is_force == starts_at_force for is_force in are_forces):
            return 0.0  # loads of the kind of the start are compared with it unsolved
        # a start at a low force takes longer, and so does one in the exact geometry; the force of a
        # start that is given as an overlap is not known beforehand
        slowness = 1.0 + _SLOW_FORCE / start.force if starts_at_force else 1.0
        quick_balls = self.balls * (_EXACT_TIME_RATIO if self.is_exact else 1)
        return slowness * self.samples * max(quick_balls, _LEAST_BALLS[self.is_exact])


def _list_names_of_arrays(kind: type[Equilibrium]) -> list[str]:
    """Return the names of the arrays of an equilibrium that are kept of a sample: not the
    deviations, which are drawn again, nor the lattice, which is that of the packing.
    """
    return [field.name for field in fields(kind) if field.name not in ("deviations", "lattice")]


def _read_path(load: Load | None, values_of_kinds: Mapping[str, ArrayLike | None]) -> Load:
    """Return the loads of a path: a ``load``, or the values, in SI, of one kind of load. Raises
    InputError unless exactly one of ``load`` and the kinds is given.
    """
    if load is None:
        return Load.only(**values_of_kinds)
    if not isinstance(load, Load):
        problem = f"a path takes no {brief(load)}"  # type: ignore[unreachable]
        mend = (
            "Give force=[...] (N), pressure=[...] or overlap=[...] (m), or a Load of"
            " granphon.balls.loads"
        )
        raise InputError(problem, "It does not say what kind of load that is", mend)
    kinds = [kind for kind, values in values_of_kinds.items() if values is not None]
    if kinds:
        problem = f"the loads of a path are given as a Load and as {' and '.join(kinds)}"
        raise InputError(problem, mend="Give one")
    return load


def _compute_exponent(means: Array) -> Array:
    """Return f M'/2kM, (...), from ``means`` (..., 4) over samples of M' = dM/d(delta), of M, k and
    f.

    If all samples have the same force, the means are those of dM/d log f, M, 1 and 1. M is the
    modulus of longitudinal waves, Pa.
    """
    rise, modulus, stiffness, force = np.moveaxis(means, -1, 0)
    return np.asarray(0.5 * force * rise / (stiffness * modulus))


@lru_cache(maxsize=64)
def _explain_soft_waves(structure: Lattice, motions: Motions) -> str | None:
    """Return the sentence of a message on the waves of the lattice without friction that cost no
    energy; None if the lattice stands.

    The waves are probed on a grid of :data:`_PROBE_COUNT` wave vectors along each axis of the zone,
    without its centre, where every lattice moves as a whole.
    """
    lattice = ContactLattice.of(structure, 0.0, motions=motions)
    if lattice.mechanism:
        return lattice.mechanism
    periods = structure.periods
    coordinates = np.arange(_PROBE_COUNT) / _PROBE_COUNT  # fractions of a reciprocal vector
    grids = np.meshgrid(*[coordinates for _ in range(periods)], indexing="ij")
    fractions = np.stack(grids, axis=-1).reshape(-1, periods)
    wavevectors = lattice.wavevectors(fractions[1:])  # without q = 0
    lowest_frequencies = lattice.frequencies(wavevectors)[:, 0]
    is_stable = bool(np.all(lowest_frequencies > _SOFT_FREQUENCY))
    return None if is_stable else "Some of its waves cost no energy"
