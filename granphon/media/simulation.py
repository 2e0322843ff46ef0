"""The disordered array itself: every ball with its own diameter, at rest under load, as a medium.

Section III of Velicky and Caroli replaces the array by an average one. Here it is simulated: a periodic sample of L1 x L2
balls in mechanical equilibrium (:mod:`granphon.array.equilibrium`), which is found without friction; and then its linear
response (:mod:`granphon.array.response`), with shear springs at every contact that carries load.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.equilibrium import LEAST_FORCE, Equilibrium, Prescribed, equilibrate, too_small
from granphon.array.response import bulk_and_shear
from granphon.array.sample import STEP, Sample, jackknife, standard_error
from granphon.array.stencils import Stencils
from granphon.balls.diameters import Measured
from granphon.balls.hertz import HertzLaw
from granphon.balls.lattices import TRIANGULAR, as_direction
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.arguments import finite_array, whole_number
from granphon.base.errors import GranphonError, InputError, brief, message
from granphon.base.results import read_only
from granphon.media.acoustics import over_directions, sample_scales, velocities_of_moduli
from granphon.media.mean_field import AveragedLattice
from granphon.media.medium import Loaded, untouched
from granphon.media.state import ContactState, overlap_flag

__all__ = ["MOST_SEED", "DirectSimulation", "SampleLaw", "SimulatedState", "in_order", "no_finite_overlap"]

Array = NDArray[np.float64]
#: the largest seed of a sample
MOST_SEED = 2**64 - 1
#: balls along a side, and samples, of which no machine holds a million times less
_MOST_SIDE, _MOST_SAMPLES = 2**31, 2**31
#: overlaps of which a law keeps the samples
_MOST_KEPT = 64
#: least width over diameter: where overlaps are more widths than this some samples do not come to rest
_LEAST_WIDTH = 1e-20


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
        return _exponent(np.mean(self._powers, axis=-2))[()]

    @property
    def exponent_error(self) -> Any:
        """Standard error of ``exponent`` over the samples; nan of a single one, whose is not known; 0 of equal balls."""
        if not self.packing.width:
            return super().exponent_error
        if self.n_samples == 1:
            return self._constant(math.nan)
        return jackknife(_exponent, self._powers)[()]

    @property
    def _powers(self) -> Array:
        """(..., n_samples, 4) what :func:`_exponent` takes the means of."""
        low, high = np.moveaxis(self._longitudinal(lambda sample: sample.elastic_tensors_beside), -1, 0)
        modulus = self._longitudinal(lambda sample: sample.elastic_tensor)
        force, stiffness = np.ones_like(modulus), np.ones_like(modulus)
        if self.spaced:  # what the samples have in common is the overlap, and forces add up
            force = self.over_samples(lambda sample: sample.force)
            stiffness = self.over_samples(lambda sample: sample.normal_stiffness)
        rise = modulus * np.log(high / low) / (2.0 * STEP)  # dM / d log f
        return np.stack([rise * stiffness / force, modulus, stiffness, force], axis=-1)

    def _longitudinal(self, of: Callable[[Any], Array]) -> Array:
        """M = K + G of an elastic tensor, or several, of every sample."""
        return np.asarray(np.sum(bulk_and_shear(self.over_samples(of)), axis=-1))

    @property
    def least_valid_force(self) -> float:
        """0: the simulation holds at every load at which it finds an equilibrium."""
        return 0.0


def _exponent(means: Array) -> Array:
    """(...) f M'/2kM from means (..., 4) of M' = dM/d(delta), M = K + G, k and f; at common f of dM/d log f, M, 1 and 1."""
    rise, modulus, stiffness, force = np.moveaxis(means, -1, 0)
    return np.asarray(0.5 * force * rise / (stiffness * modulus))


@dataclass(frozen=True, eq=False)
class DirectSimulation(Loaded[SimulatedState]):
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

    packing: Packing
    shape: tuple[int, int] = (128, 128)
    seed: int = 0
    samples: int = 1
    diameters: Array | None = None
    executor: Executor | None = field(default=None, compare=False, repr=False)
    workers: int = field(default=1, compare=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.packing, Packing):
            raise InputError(message(f"packing is {self.packing!r}", mend="Give a granphon.Packing"))
        if self.packing.structure != TRIANGULAR:
            raise InputError(
                message(
                    f"the {self.packing.structure.name} lattice is not simulated",
                    "Without friction, only the triangular lattice holds its shape",
                    "Use another medium, or the triangular lattice",
                )
            )
        shape = tuple(whole_number("shape", length, 1, _MOST_SIDE) for length in _pair(self.shape))
        object.__setattr__(self, "shape", shape)
        if self.diameters is not None:
            self._take(self.diameters)
        if 0.0 < self.packing.width < _LEAST_WIDTH * self.packing.diameter:
            what = f"the width of the diameters is {self.packing.width / self.packing.diameter:.3g} of their mean"
            raise InputError(message(what, f"Below {_LEAST_WIDTH:g} a sample is not simulated", "Leave the spread out"))
        object.__setattr__(self, "samples", whole_number("samples", self.samples, 1, _MOST_SAMPLES))
        object.__setattr__(self, "seed", whole_number("seed", self.seed, 0, MOST_SEED + 1 - self.samples))
        whole_number("workers", self.workers, 1)
        if self.diameters is not None and self.samples > 1:
            raise InputError(message("diameters are those of one sample", mend="Leave samples out"))
        if self.executor is not None and not hasattr(self.executor, "submit"):
            raise InputError(message(f"executor is {self.executor!r}", mend="Give a concurrent.futures.Executor, or none"))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, DirectSimulation):
            return NotImplemented
        return self._key == other._key and bool(np.all(np.asarray(self.diameters) == np.asarray(other.diameters)))

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[Any, ...]:
        """All that determines the numbers, but for given diameters."""
        return self.packing, self.shape, self.seed, self.samples, self.diameters is None

    def _take(self, diameters: ArrayLike) -> None:
        """Given diameters: their shape, and their spread if the packing has none."""
        array = read_only(finite_array("diameters", diameters, "m", "above zero"))
        if array.ndim != 2:
            raise InputError(message(f"diameters have the shape {array.shape}", mend="Give an array (L1, L2)"))
        packing = self.packing
        if packing.spread is None and np.ptp(array):
            # the mean of the list, which its own rounding may move, is the packing's
            spread = Measured(tuple((packing.diameter + (array - np.mean(array))).ravel().tolist()))
            packing = replace(packing, spread=spread, diameter=spread.mean)
        object.__setattr__(self, "packing", packing)
        object.__setattr__(self, "diameters", array)
        if self.shape not in (DirectSimulation.shape, array.shape):
            what = f"shape is {self.shape!r}, and the diameters have {array.shape}"
            raise InputError(message(what, "A sample of given balls has their shape", "Leave shape out"))
        object.__setattr__(self, "shape", array.shape)

    @cached_property
    def law(self) -> HertzLaw | SampleLaw:
        """Mean force against overlap; Hertz's law for equal balls."""
        return SampleLaw(replace(self, executor=None)) if self.packing.width else self.packing.law

    def deviations(self, index: int) -> Array:
        """(L1, L2) x = Delta/W of a sample, of mean zero."""
        packing = self.packing
        if packing.spread is None:
            return np.zeros(self.shape)
        given = self.diameters if self.diameters is not None else packing.spread.sample(self.shape, self.seed + index)
        # twice: the mean of what is left is then zero to its own rounding
        off = given - np.mean(given)
        return np.asarray((off - np.mean(off)) / packing.width_units.width)

    def at(self, load: Load, *, finite_overlap: bool | None = None) -> SimulatedState:
        """State at a load of every sample; :meth:`at_force`, :meth:`at_pressure` and :meth:`at_overlap` name its kind."""
        load, (wanted, said) = load.applied, overlap_flag(finite_overlap)
        if wanted:
            raise no_finite_overlap(self.name)
        prescribed = self.prescribed(load)
        order, alone = in_order(prescribed), replace(self, executor=None)
        if self.executor is None:
            found = [_equilibria(alone, index, prescribed, order) for index in range(self.samples)]
        else:
            jobs = [self.executor.submit(_equilibria, alone, index, prescribed, order) for index in range(self.samples)]
            found = [_shared(job.result(), self.workers) for job in jobs]
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
        units = self.packing.width_units
        if load.kind == "overlap":
            return [Prescribed(overlap=one) for one in units.reduced_overlap(load.array).ravel().tolist()]
        force = units.reduced_force(load.array)
        if load.kind == "pressure":
            force = load.array / (TRIANGULAR.pressure_factor * units.force) * self.packing.diameter
        return [Prescribed(force=one) for one in force.ravel().tolist()]

    def sample(self, load: Prescribed, before: tuple[float, Array] | None = None) -> Sample:
        """The first sample under one load, as a state has it.

        ``before`` are overlap and displacements of its equilibrium under the load before this one in :func:`in_order`; None
        for the first.
        """
        deviations = read_only(self.deviations(0))
        start = None if before is None else Equilibrium(deviations, *before)
        found = equilibrate(deviations, load, Stencils(deviations.shape, workers=self.workers), start)
        return Sample(self.packing, None if self.diameters is not None else self.seed, found)

    def require(self, load: Load) -> None:
        """:class:`~granphon.base.errors.InputError` for an applied load that no sample can bear, before any is looked at.

        Beyond the law of equal balls, or by a whole diameter, or, where balls differ, below f* = 1e-8 or without any
        touching.
        """
        hertz, units = AveragedLattice(replace(self.packing, spread=None)), self.packing.width_units
        if load.kind != "overlap":
            least = units.reduced_force(float(np.min(hertz.at(load).force)))
            if self.packing.width and least < LEAST_FORCE:
                raise too_small(least)
        elif not self.packing.width:
            hertz.at(load)
        else:
            if np.max(load.array) > self.packing.width:
                hertz.at(Load("overlap", np.max(load.array)))
            # given balls may differ by more than the spread that they are taken from
            given = units.width * float(np.max(self.deviations(0))) if self.diameters is not None else 0.0
            largest = max(given, self.packing.spread.largest if self.packing.spread else 0.0)
            if np.min(load.array) <= -largest:
                raise untouched(load, largest)


def no_finite_overlap(medium: str) -> InputError:
    """What to say of a ``medium`` that is, or may be, a simulation, where terms of finite overlap are wanted."""
    what = f"the medium {medium!r} has no terms of finite overlap"
    why = "Its linear response is found in the limit of spread and overlap small against the diameter"
    return InputError(message(what, why, "Leave finite_overlap out, or take another medium"))


def in_order(loads: Sequence[Prescribed]) -> list[int]:
    """Places of the loads from the highest down. Each equilibrium is found from the one above; where it began is not seen
    but in digits beyond the tolerance."""
    return sorted(range(len(loads)), key=lambda i: loads[i], reverse=True)


def _equilibria(
    simulation: DirectSimulation, index: int, loads: Sequence[Prescribed], order: Sequence[int]
) -> dict[int, Equilibrium]:
    """One sample under all loads, each found from the one before in ``order``; an error says which, as ``load_index``."""
    deviations = read_only(simulation.deviations(index))  # one array for all of them
    stencils, out, last = Stencils(deviations.shape, workers=simulation.workers), dict[int, Equilibrium](), None
    for place in order:
        try:
            last = out[place] = equilibrate(deviations, loads[place], stencils, last)
            _ = last.stiffness  # needed by every state; here, so that it is worked out side by side
        except GranphonError as error:
            vars(error)["load_index"] = place
            raise
    stencils.forget()
    return out


def _shared(found: dict[int, Equilibrium], workers: int) -> dict[int, Equilibrium]:
    """The same, with one array of deviations for all loads, which each has its own of when it comes from another process."""
    deviations = next(iter(found.values())).deviations
    stencils = Stencils(deviations.shape, workers=workers)
    for one in found.values():
        object.__setattr__(one, "deviations", deviations)
        vars(one)["stencils"] = stencils
    return found


def _pair(shape: Any) -> tuple[Any, Any]:
    try:
        first, second = shape
    except (TypeError, ValueError):
        raise InputError(message(f"shape is {brief(shape)}", mend="Give two whole numbers, (L1, L2)")) from None
    return first, second
