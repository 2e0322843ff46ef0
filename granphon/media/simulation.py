"""The disordered array itself: every ball with its own diameter, at rest under load, as a medium.

Section III of Velicky and Caroli replaces the array by an average one. Here it is simulated: a periodic sample of L1 x L2
balls in mechanical equilibrium (:mod:`granphon.array.equilibrium`), which is found without friction; and then its linear
response (:mod:`granphon.array.response`), with shear springs at every contact that carries load.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.equilibrium import Prescribed
from granphon.array.response import bulk_and_shear
from granphon.array.sample import Sample, standard_error
from granphon.balls.hertz import HertzLaw
from granphon.balls.lattices import as_direction
from granphon.balls.loads import Load
from granphon.base.errors import InputError, message
from granphon.base.results import read_only
from granphon.media.acoustics import over_directions, sample_scales, velocities_of_moduli
from granphon.media.equilibria import find_equilibria, find_equilibrium, prescribe, require_load, share_array
from granphon.media.exponents import exponent_error, mean_exponent
from granphon.media.medium import Loaded
from granphon.media.sampled_balls import SampledBalls
from granphon.media.state import ContactState, overlap_flag

__all__ = ["DirectSimulation", "SampleLaw", "SimulatedState", "no_finite_overlap"]

Array = NDArray[np.float64]
#: overlaps of which a law keeps the samples
_MOST_KEPT = 64


@dataclass(frozen=True)
class SampleLaw:
    """The law of the samples of a simulation: mean force, stiffness and energy of a contact against the overlap.

    Methods take scalars or arrays of overlaps, m: floats in, floats out. Each overlap is an equilibrium of every sample:
    found when first asked for; the last few are kept.
    """

    simulation: DirectSimulation

    @property
    def coefficient(self) -> float:
        """c of equal balls, N/m^(3/2)."""
        return self.simulation.packing.law.coefficient

    @property
    def least_overlap(self) -> float:
        """The overlap (m, below zero) up to which all balls are apart where they sit on their sites."""
        largest = max(float(np.max(self.simulation.deviations(index))) for index in range(self.simulation.samples))
        return -largest * self.simulation.packing.width_units.width

    def _mean(self, overlap: ArrayLike, of: Callable[[Sample], float]) -> Any:
        values = np.asarray(overlap, float)
        different, where = np.unique(values, return_inverse=True)
        means = [np.mean([of(one) for one in self._samples(value)]) for value in different.tolist()]
        return np.array(means)[where].reshape(values.shape)[()]

    def __reduce__(self) -> tuple[Any, ...]:
        return SampleLaw, (self.simulation,)  # without what is kept

    def _samples(self, overlap: float) -> tuple[Sample, ...]:
        kept = self._kept
        if overlap not in kept:
            if len(kept) == _MOST_KEPT:
                kept.pop(next(iter(kept)))
            kept[overlap] = self.simulation.at_overlap(overlap).samples
        return kept[overlap]

    @cached_property
    def _kept(self) -> dict[float, tuple[Sample, ...]]:
        return {}

    def energy(self, overlap: ArrayLike) -> Any:
        """Energy of a contact, J."""
        return self._mean(overlap, lambda sample: sample.energy)

    def force(self, overlap: ArrayLike) -> Any:
        """f, N."""
        return self._mean(overlap, lambda sample: sample.force)

    def stiffness(self, overlap: ArrayLike) -> Any:
        """df/d(delta), N/m."""
        return self._mean(overlap, lambda sample: sample.normal_stiffness)

    def stiffness_slope(self, overlap: ArrayLike) -> Any:
        """d^2f/d(delta)^2, N/m^2; the derivative of these samples, of which no mean over many has a finite variance."""
        return self._mean(overlap, lambda sample: sample.stiffness_slope)

    def force_fluctuation(self, overlap: ArrayLike) -> Any:
        """Delta f / f over the balls."""
        return self._mean(overlap, lambda sample: sample.force_fluctuation)

    def contact_fraction(self, overlap: ArrayLike) -> Any:
        """The part of the contacts that carries load."""
        return self._mean(overlap, lambda sample: sample.contact_fraction())

    def least_valid_force(self, width: float) -> float:
        """0: the simulation holds at every load at which it finds an equilibrium."""
        return 0.0

    def overlap(self, force: ArrayLike) -> Any:
        """delta at a mean contact force, m."""
        return self.simulation.at_force(force).overlap


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedState(ContactState):
    """The contacts of simulated samples: means over the samples, and the samples themselves.

    At given force or pressure every sample bears the same, and overlaps are averaged; at given overlap forces are. In both
    cases ``normal_stiffness`` is the exact derivative of one mean by the other.

    Attributes
    ----------
    samples : one for each load (in C order) and, running fastest, each sample.
    spaced : whether it is the overlap that the samples have in common, not the force.

    ``finite_overlap`` is always False: the linear response of the samples is that of the paper's limit, and so are the
    pressure and the density that go with it. :class:`~granphon.base.errors.InputError` otherwise.
    """

    units = {**ContactState.units, "contact_force_fluctuation": "1"}

    law: HertzLaw | SampleLaw = field(repr=False)
    samples: tuple[Sample, ...] = field(default=(), repr=False)
    spaced: bool = False

    #: the field that holds what is averaged
    _averaged: ClassVar[str] = "samples"

    @classmethod
    def of(cls, simulation: DirectSimulation, samples: Sequence[Any], load: Load, overlap_given: bool = False) -> Self:
        """The state of ``samples`` under an applied ``load``, whose own numbers it has where they are force or overlap."""
        rows = np.array([(s.force, s.overlap, s.normal_stiffness) for s in samples]).reshape(*load.shape, -1, 3)
        forces, overlaps, stiffnesses = np.moveaxis(rows, -1, 0)
        spaced = load.kind == "overlap"
        # at common spacing stiffnesses add up, at common force compliances
        k = np.mean(stiffnesses, axis=-1) if spaced else 1.0 / np.mean(1.0 / stiffnesses, axis=-1)
        f = load.array if load.kind == "force" else np.mean(forces, axis=-1)
        delta = load.array if spaced else np.mean(overlaps, axis=-1)
        own: dict[str, Any] = {cls._averaged: tuple(samples)}
        return cls(
            packing=simulation.packing, medium=simulation.name, law=simulation.law, force=np.asarray(f)[()],
            overlap=np.asarray(delta)[()], normal_stiffness=np.asarray(k)[()], overlap_given=overlap_given,
            spaced=spaced, **own,
        )  # fmt: skip

    def __post_init__(self) -> None:
        if self.finite_overlap:
            raise no_finite_overlap(self.medium)
        super().__post_init__()

    def __getitem__(self, index: Any) -> Self:
        """The state at some of the loads, as arrays are indexed."""
        which = np.arange(int(np.prod(self.shape, dtype=int))).reshape(self.shape)[index]
        samples = tuple(self._table.reshape(-1, self.n_samples)[which].ravel().tolist())
        f, delta, k = (np.asarray(x)[index] for x in (self.force, self.overlap, self.normal_stiffness))
        own: dict[str, Any] = {self._averaged: samples}
        return replace(self, force=f, overlap=delta, normal_stiffness=k, **own)

    @property
    def _table(self) -> NDArray[Any]:
        """The samples by load and index."""
        samples = getattr(self, self._averaged)
        table = np.empty(len(samples), dtype=object)
        table[:] = samples
        return table.reshape(*self.shape, -1)

    @property
    def n_samples(self) -> int:
        """How many samples are averaged."""
        return len(getattr(self, self._averaged)) // int(np.prod(self.shape, dtype=int))

    @property
    def sample(self) -> Any:
        """The first sample; of several loads an array of them, indexed like the load."""
        first = self._table[..., 0]
        return first if self.shape else first[()]

    def over_samples(self, of: Callable[[Any], ArrayLike]) -> Array:
        """A quantity of every sample: the axes of the load, that of the samples, those of the quantity."""
        values = np.array([np.asarray(of(sample)) for sample in getattr(self, self._averaged)])
        return values.reshape(*self.shape, self.n_samples, *values.shape[1:])

    def standard_error(self, of: str | Callable[[Any], ArrayLike]) -> Any:
        """Standard error of the mean over samples of a quantity: the name of one of :class:`Sample`, or a function of it.

        The shape of the load, then that of the quantity. :class:`~granphon.base.errors.InputError` with one sample alone.
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
        """Delta f / f: rms over balls of the mean force of a ball's six contacts, over the mean."""
        return self._average(lambda sample: sample.force_fluctuation)

    @property
    def contact_force_fluctuation(self) -> Any:
        """rms over single contacts of the difference from the mean force, over the mean."""
        return self._average(lambda sample: sample.contact_force_fluctuation)

    @property
    def contact_fraction(self) -> Any:
        """N_c / 6, the part of the contacts that carry more than 1e-6 of the mean force."""
        return self._average(lambda sample: sample.contact_fraction())

    @property
    def elastic_tensor(self) -> Array:
        """(..., 3, 3) Pa, Voigt order xx, yy, xy: mean over samples of their linear response.

        At common force ``normal_stiffness`` is a mean of compliances: of several samples without friction, the bulk modulus
        is then (3^(1/2)/2) k/d but for the square of their differences.
        """
        return np.asarray(self._average(lambda sample: sample.elastic_tensor))

    @property
    def is_isotropic(self) -> bool:
        """True: a simulated sample is isotropic on average."""
        return True

    @property
    def sampled_moduli(self) -> Array | None:
        """(..., n_samples, 2) bulk and shear modulus of two samples or more, Pa; None of a single one."""
        return self.over_samples(lambda sample: bulk_and_shear(sample.elastic_tensor)) if self.n_samples > 1 else None

    @property
    def mean_errors(self) -> dict[str, Any]:
        """Standard error over samples of what they do not have in common, "force_error" (N) or "overlap_error" (m)."""
        name = "force" if self.spaced else "overlap"
        return {f"{name}_error": self.standard_error(name)} if self.n_samples > 1 else {}

    def long_waves(self, direction: ArrayLike) -> Array:
        """(..., 2) velocities that the mean bulk and shear modulus give, m/s; (..., n, 2) for directions (n, 2)."""
        velocities = velocities_of_moduli(bulk_and_shear(self.elastic_tensor), self.effective_density)
        return over_directions(velocities, as_direction(direction))

    def branch_scales(self, direction: ArrayLike, names: Sequence[str]) -> list[Array]:
        """The scale with which each named branch of the ideal lattice has the long waves of the samples, m/s."""
        return sample_scales(self, direction, names)

    @property
    def exponent(self) -> Any:
        """d log v_L / d log P: that of the mean K + G of the samples, by differences over
        :data:`~granphon.array.sample.STEP`.

        Each sample is solved at two more loads beside its own, when this or its error is first asked for. The derivative
        itself has no finite variance: a contact about to open has the slope h^(-1/2). Equal balls have exactly 1/6.
        """
        if not self.packing.width:
            return super().exponent
        return mean_exponent(self)[()]

    @property
    def exponent_error(self) -> Any:
        """Standard error of ``exponent`` over the samples; nan of a single one, whose is not known; 0 of equal balls."""
        if not self.packing.width:
            return super().exponent_error
        if self.n_samples == 1:
            return self._constant(math.nan)
        return exponent_error(self)[()]

    @property
    def least_valid_force(self) -> float:
        """0: the simulation holds at every load at which it finds an equilibrium."""
        return 0.0


@dataclass(frozen=True, eq=False)
class DirectSimulation(SampledBalls, Loaded[SimulatedState]):
    """Samples of the packing, ball by ball, at rest under load.

    Parameters
    ----------
    packing : the balls, on the triangular lattice.
    shape : (L1, L2) balls of a periodic sample, along a1 and a2 of the cell.
    seed : of the first sample; the next ones have the next seeds. Diameters are the same on any machine.
    samples : how many are averaged.
    diameters : (L1, L2) m, instead of a shape and a seed: one sample of just these balls. They are shifted to have the
        packing's diameter as their mean; a packing without a spread takes theirs.
    executor : any that follows :class:`concurrent.futures.Executor`, for samples side by side.
    workers : threads for each Fourier transform. Neither changes the numbers.

    Raises
    ------
    InputError : another lattice, a shape or number that is not whole and above zero, diameters with a shape or samples, a
        width below 1e-20 of the diameter.

    ``at_*`` take scalars or arrays: floats in, floats out. They raise :class:`~granphon.base.errors.InputError` for a load
    that is not finite, not compressive, or presses balls together by their whole diameter, and for one under which a sample
    carries none (at and below the rigidity threshold a* = 0.343), and with ``finite_overlap``, whose terms a simulation does
    not have; and :class:`~granphon.base.errors.ConvergenceError` where no equilibrium is found.
    """

    name = "simulation"

    @cached_property
    def law(self) -> HertzLaw | SampleLaw:
        """Mean force against overlap; Hertz's law for equal balls."""
        return SampleLaw(replace(self, executor=None)) if self.packing.width else self.packing.law

    def at(self, load: Load, *, finite_overlap: bool | None = None) -> SimulatedState:
        """State at a load of every sample; :meth:`at_force`, :meth:`at_pressure` and :meth:`at_overlap` name its kind."""
        load, (wanted, said) = load.applied, overlap_flag(finite_overlap)
        if wanted:
            raise no_finite_overlap(self.name)
        prescribed = self.prescribed(load)
        every = [read_only(self.deviations(index)) for index in range(self.samples)]
        if self.executor is None:
            found = [find_equilibria(one, prescribed, self.workers) for one in every]
        else:
            jobs = [self.executor.submit(find_equilibria, one, prescribed, self.workers) for one in every]
            found = [share_array(job.result(), self.workers) for job in jobs]
        seeds = [None if self.diameters is not None else self.seed + index for index in range(self.samples)]
        samples = [
            Sample(self.packing, seed, column[place])
            for place in range(load.size)
            for seed, column in zip(seeds, found, strict=True)
        ]
        return SimulatedState.of(self, samples, load, overlap_given=said)

    def prescribed(self, load: Load) -> list[Prescribed]:
        """What each value of an applied load prescribes in reduced units, in C order; errors as :meth:`require`."""
        self.require(load)
        return prescribe(self.packing, load)

    def sample(self, load: Prescribed, before: tuple[float, Array] | None = None) -> Sample:
        """The first sample under one load, as a state has it.

        ``before`` are overlap and displacements of its equilibrium under the load before this one, in the order of
        :func:`~granphon.media.equilibria.in_order`; None for the first.
        """
        deviations = read_only(self.deviations(0))
        found = find_equilibrium(deviations, load, before, self.workers)
        return Sample(self.packing, None if self.diameters is not None else self.seed, found)

    def require(self, load: Load) -> None:
        """:class:`~granphon.base.errors.InputError` for an applied load that no sample can bear, before any is looked at."""
        # given balls may differ by more than the spread that they are taken from
        given = self.packing.width_units.width * float(np.max(self.deviations(0))) if self.diameters is not None else 0.0
        require_load(self.packing, load, max(given, self.packing.spread.largest if self.packing.spread else 0.0))


def no_finite_overlap(medium: str) -> InputError:
    """What to say of a ``medium`` that is, or may be, a simulation, where terms of finite overlap are wanted."""
    what = f"the medium {medium!r} has no terms of finite overlap"
    why = "Its linear response is found in the limit of spread and overlap small against the diameter"
    return InputError(message(what, why, "Leave finite_overlap out, or take another medium"))
