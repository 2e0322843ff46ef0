"""The medium that simulates the disordered array: every ball has its own diameter and is at rest under load.

Section III of Velicky and Caroli replaces the array by an average one. Here a periodic sample of L1 x L2 balls is simulated.
Its mechanical equilibrium is found without friction (:mod:`granphon.array.equilibrium`); its linear response
(:mod:`granphon.array.linear_response`) then has shear springs at every contact that carries load.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from operator import attrgetter
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.geometry import ReducedLoad
from granphon.array.pressed_sample import PressedSample
from granphon.array.sample import STEP, Sample, jackknife
from granphon.array.stencils import Stencils
from granphon.balls.hertz import HertzLaw
from granphon.balls.loads import Load
from granphon.base.errors import GranphonError, InputError, brief
from granphon.base.progress import Progress, silent
from granphon.base.results import read_only
from granphon.dynamics.tensors import longitudinal_modulus
from granphon.media.equilibria import find_equilibria, find_equilibrium, prescribe, require_load, share_array
from granphon.media.left_out import LATTICE, LEFT_OUT_LIMIT, estimate_shear_deficit
from granphon.media.loading import LoadedSample, require_above
from granphon.media.medium import MediumBase
from granphon.media.sampled_balls import SampledBalls
from granphon.media.sampled_state import SampledState
from granphon.media.state import read_finite_overlap

Array = NDArray[np.float64]
#: for how many balls a ball counts in the exact geometry where a start is solved, and the least that a sample counts for:
#: both take their time
_EXACT_BALL, _LEAST_SAMPLE = 20, {False: 625, True: 2500}
#: f* of a start that takes twice as long as one at a high force; below it the time grows as 1/f*
_SLOW_FORCE = 0.0015


@dataclass(frozen=True)
class SampleLaw:
    """The contact law of a simulation: mean force, stiffness and energy of a contact against the overlap.

    Methods take scalars or arrays of overlaps, m: floats in, floats out. Each overlap needs an equilibrium of every sample,
    which is found at the first request. The equilibria at the last 64 overlaps are kept.

    Attributes
    ----------
    simulation : the :class:`DirectSimulation` whose samples are solved.
    """

    simulation: DirectSimulation

    @property
    def coefficient(self) -> float:
        """Coefficient c of the law of equal balls, N/m^(3/2)."""
        return self.simulation.packing.law.coefficient

    @property
    def least_overlap(self) -> float:
        """Overlap up to which all balls are apart while they are on the sites of the lattice, m; it is below zero."""
        largest = max(float(np.max(self.simulation.deviations(index))) for index in range(self.simulation.samples))
        return -largest * self.simulation.packing.width_units.width

    def _average_at(self, overlap: ArrayLike, of: Callable[[Sample], float]) -> Any:
        values = np.asarray(overlap, float)
        different, where = np.unique(values, return_inverse=True)
        means = [np.mean([of(one) for one in self._simulate(value)]) for value in different.tolist()]
        return np.array(means)[where].reshape(values.shape)[()]

    @cached_property
    def _simulate(self) -> Callable[[float], tuple[Sample, ...]]:
        """The samples at an overlap, of which the last 64 are kept."""
        return lru_cache(maxsize=64)(lambda overlap: self.simulation.at_overlap(overlap).samples)

    def __reduce__(self) -> tuple[Any, ...]:
        return SampleLaw, (self.simulation,)  # a copy starts without the samples that are kept

    def energy(self, overlap: ArrayLike) -> Any:
        """Return the mean energy of a contact, J."""
        return self._average_at(overlap, lambda sample: sample.energy)

    def force(self, overlap: ArrayLike) -> Any:
        """Return the mean contact force f, N."""
        return self._average_at(overlap, lambda sample: sample.force)

    def stiffness(self, overlap: ArrayLike) -> Any:
        """Return the mean normal stiffness df/d(delta), N/m."""
        return self._average_at(overlap, lambda sample: sample.normal_stiffness)

    def stiffness_slope(self, overlap: ArrayLike) -> Any:
        """Return the slope of the stiffness of these samples, d^2f/d(delta)^2, N/m^2, whose variance is infinite."""
        return self._average_at(overlap, lambda sample: sample.stiffness_slope)

    def force_fluctuation(self, overlap: ArrayLike) -> Any:
        """Return the force fluctuation over the balls, the ratio Delta f / f, at each ``overlap``, m."""
        return self._average_at(overlap, lambda sample: sample.force_fluctuation)

    def contact_fraction(self, overlap: ArrayLike) -> Any:
        """Return the fraction of contacts that carry more than 1e-6 of the mean force."""
        return self._average_at(overlap, lambda sample: sample.contact_fraction())

    def least_valid_force(self, width: float) -> float:
        """Return 0 N for any ``width``, m: the simulation is valid at every load at which it finds an equilibrium."""
        return 0.0

    def overlap(self, force: ArrayLike) -> Any:
        """Return the mean overlap delta at a mean contact force, m."""
        return self.simulation.at_force(force).overlap


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedState(SampledState):
    """The contacts of simulated samples: means over the samples, and the samples themselves.

    At a given force or pressure every sample bears the same force, and overlaps are averaged. At a given overlap all samples
    have the same overlap, and forces are averaged. In both cases ``normal_stiffness`` is the exact derivative of the mean
    force with respect to the mean overlap; after a history with friction it belongs to the linear response, which differs
    from the slope of the path (:attr:`PressedSample.normal_stiffness`).

    Attributes
    ----------
    samples : the samples at each load, in C order of the loads; the index of the sample runs fastest.
    fixed_overlap : True if all samples have the same overlap, False if they have the same force.

    ``finite_overlap`` is True of samples in their exact geometry, if only at some loads. Otherwise it is False: the linear
    response, pressure and density of the samples are in the paper's limit; :class:`~granphon.base.errors.InputError` if it
    is set.
    """

    law: HertzLaw | SampleLaw = field(repr=False)
    samples: tuple[Sample | PressedSample, ...] = field(default=(), repr=False)
    fixed_overlap: bool = False

    @classmethod
    def of(cls, simulation: DirectSimulation, samples: Sequence[Any], load: Load) -> Self:
        """Make the state of ``samples`` under an applied ``load``.

        Its force or overlap is exact if the load is given as one of these.
        """
        rows = np.array([(s.force, s.overlap, s.normal_stiffness) for s in samples]).reshape(*load.shape, -1, 3)
        forces, overlaps, stiffnesses = np.moveaxis(rows, -1, 0)
        fixed_overlap = load.kind == "overlap"
        # samples with the same overlap act in parallel: average stiffnesses; with the same force in series: compliances
        k = np.mean(stiffnesses, axis=-1) if fixed_overlap else 1.0 / np.mean(1.0 / stiffnesses, axis=-1)
        f = load.array if load.kind == "force" else np.mean(forces, axis=-1)
        delta = load.array if fixed_overlap else np.mean(overlaps, axis=-1)
        return cls(
            packing=simulation.packing, medium=simulation.name, law=simulation.law, force=np.asarray(f)[()],
            overlap=np.asarray(delta)[()], normal_stiffness=np.asarray(k)[()], samples=tuple(samples),
            fixed_overlap=fixed_overlap, finite_overlap=any(one.is_exact for one, _ in simulation.by_geometry(load)),
        )  # fmt: skip

    def __post_init__(self) -> None:
        if self.finite_overlap and not (isinstance(self.law, SampleLaw) and self.law.simulation.geometry != LATTICE):
            raise no_finite_overlap(self.medium)
        super().__post_init__()

    def __getitem__(self, index: Any) -> Self:
        """Return the state at some of the loads, indexed like an array."""
        which = np.arange(int(np.prod(self.shape, dtype=int))).reshape(self.shape)[index]
        samples = tuple(self._table.reshape(-1, self.n_samples)[which].ravel().tolist())
        f, delta, k = (np.asarray(x)[index] for x in (self.force, self.overlap, self.normal_stiffness))
        finite = bool(np.any(np.asarray(self._is_exact)[index]))
        return replace(self, force=f, overlap=delta, normal_stiffness=k, samples=samples, finite_overlap=finite)

    @property
    def _is_exact(self) -> Any:
        """Whether the samples at each load are in their exact geometry: each load has its own if none is named."""
        simulation = getattr(self.law, "simulation", None)
        if simulation is None or simulation.geometry is not None:
            return self._fill_shape(self.finite_overlap)
        return np.reshape([one.is_exact for one in self.samples[:: self.n_samples]], self.shape)[()]

    @property
    def _shrinkage(self) -> Any:
        return np.where(self._is_exact, 1.0 - self.relative_overlap, 1.0)[()]

    @property
    def floats(self) -> bool:
        """Whether loose balls float in their cages as samples are pressed from the gas: in the directions of the lattice."""
        simulation = getattr(self.law, "simulation", None)
        return simulation is not None and simulation.floats

    @property
    def shear_deficit(self) -> Any:
        """Part by which the shear modulus is expected to be too small, as contacts have the directions of the lattice.

        They leave out that loose balls lean on others (:func:`~granphon.media.left_out.estimate_shear_deficit`). It is None
        in the exact geometry, for equal balls, on a line, and where no contact resists slip.
        """
        simulation = getattr(self.law, "simulation", None)
        if simulation is None or np.all(self._is_exact) or not simulation.resists_slip:
            return None
        ratio, periods = self.packing.relative_width, self.packing.structure.periods
        deficit = estimate_shear_deficit(self.contact_fraction, ratio, periods, simulation.friction_history)
        return np.where(self._is_exact, 0.0, deficit)[()]

    @property
    def valid(self) -> Any:
        """Whether the directions of the lattice leave out at most 1 % of the shear modulus (:attr:`shear_deficit`).

        From the gas in these directions none is, as velocities depend on the numbering of the balls (:attr:`floats`).
        """
        if self.floats:
            return self._fill_shape(False)
        deficit = self.shear_deficit
        return self._fill_shape(True) if self.chosen_automatically or deficit is None else (deficit <= LEFT_OUT_LIMIT)

    @property
    def pressure(self) -> Any:
        """Pressure P, N/m in the plane, Pa in space: see :attr:`granphon.ContactState.pressure`.

        In the exact geometry it is the work of the load on the cell, over the change of its size: the mean over samples.
        """
        if not self.finite_overlap:
            return super().pressure
        of_work = self.packing.pressure_per_force * self._average(lambda sample: sample.boundary_force)
        return np.where(self._is_exact, of_work, super().pressure)[()]

    @property
    def mean_errors(self) -> dict[str, Any]:
        """Standard error over samples of the force or overlap, as "force_error" (N) or "overlap_error" (m).

        At a given force or pressure it is that of the overlap, at a given overlap that of the force. The dictionary is empty
        if there is only one sample.
        """
        name = "force" if self.fixed_overlap else "overlap"
        return {f"{name}_error": self.standard_error(name)} if self.n_samples > 1 else {}

    @property
    def exponent(self) -> Any:
        """Local exponent d log v_L / d log P; exactly 1/6 for equal balls and on a line.

        It belongs to the modulus of longitudinal waves, averaged over all directions and samples: K + G in the plane, K +
        4G/3 in space, with the averages of Voigt where samples are not isotropic.

        It is a difference over :data:`~granphon.array.sample.STEP` of log f to either side: each sample is solved at two
        more loads, when the exponent or its error is first asked for. The derivative itself is not used, as its variance is
        infinite: a contact about to open contributes a slope of h^(-1/2). With a history of friction the two loads are those
        of further loading, 5 % and 15 % above. In the exact geometry the spacing falls with the load, by f/k for each unit
        of log f; density and pressure follow.
        """
        if not self.packing.spread_matters:
            return super().exponent
        periods, shortening = self.packing.structure.periods, self._shortening
        exponent = _compute_exponent(np.mean(self._exponent_terms, axis=-2))
        return ((exponent - 0.5 * periods * shortening) / (1.0 + (periods - 1.0) * shortening))[()]

    @property
    def exponent_error(self) -> Any:
        """Standard error of ``exponent`` over the samples; nan (not known) of one sample, 0 of equal balls, on a line."""
        if not self.packing.spread_matters:
            return super().exponent_error
        if self.n_samples == 1:
            return self._fill_shape(math.nan)
        error = jackknife(_compute_exponent, self._exponent_terms)
        return (error / (1.0 + (self.packing.structure.periods - 1.0) * self._shortening))[()]

    @property
    def _exponent_terms(self) -> Array:
        """The terms of each sample whose means :func:`_compute_exponent` takes, (..., n_samples, 4)."""
        low, high = np.moveaxis(longitudinal_modulus(self.over_samples(attrgetter("elastic_tensors_beside"))), -1, 0)
        modulus = longitudinal_modulus(self.over_samples(attrgetter("elastic_tensor")))
        rise = modulus * np.log(high / low) / (2.0 * STEP)  # dM / d log f
        # the mean force is an average of samples at the same overlap; at the same force the two are left out
        names = ("force", "normal_stiffness") if self.fixed_overlap else ()
        f, k = [self.over_samples(attrgetter(name)) for name in names] or (np.ones_like(modulus),) * 2
        return np.stack([rise * k / f, modulus, k, f], axis=-1)

    @property
    def _shortening(self) -> Array:
        """Part by which the spacing falls for each unit of log f; 0 in the directions of the lattice."""
        spacing = self.packing.diameter - np.asarray(self.overlap)
        return np.where(self._is_exact, self.force / self.normal_stiffness / spacing, 0.0)


@dataclass(frozen=True, eq=False)
class DirectSimulation(SampledBalls, MediumBase[SimulatedState]):
    """The medium that simulates samples of the packing, ball by ball, at rest under load.

    Parameters
    ----------
    packing : the balls, on a lattice that stands without friction: the chain, the triangular lattice, fcc, hcp, or one given
        as data; others with a history of friction from the gas.
    shape : (L1, ..., Lp), numbers of cells of a periodic sample along the p vectors of the cell; by default (16384,),
        (128, 128) or (24, 24, 24).
    seed : seed of the first sample; the next ones have the next seeds. Diameters are the same on any machine.
    samples : number of samples that are averaged.
    diameters : (L1, ..., Lp), m, or (L1, ..., Lp, n) of n > 1 balls in the cell, instead of a shape and a seed: one sample
        of just these balls. They are shifted to have the packing's diameter as their mean; a packing without a spread takes
        theirs.
    executor : a :class:`concurrent.futures.Executor`, or an object with the same methods, that solves samples in parallel.
    workers : number of threads for each Fourier transform. Neither ``executor`` nor ``workers`` changes results.
    friction_history : load the samples with friction, step by step from ``start``: tangential forces, by Mindlin's law up to
        Coulomb's limit, are then part of the statics. ``at_*`` is the state of monotonic loading, and :meth:`path` takes
        loads up and down. By default samples come to rest without friction.
    friction_coefficient : mu of the contacts, zero to infinity; a history needs it.
    geometry : "exact", directions, lever arms and overlaps follow from positions, with ``finite_overlap`` (prestress and
        boundary included); or "lattice": contacts keep the directions of the lattice, the limit of small spread, which is
        faster; or None, the default: a history of friction is then exact, and without one the geometry is that of the
        lattice if its directions are expected to leave out less than 1e-3 of the shear modulus, at each load, else exact.
        Equal balls, and balls that differ by more than a fifth of their diameter, have the directions of the lattice.
    start : where the loading starts, at rest without friction: a reduced spacing a*, 1/2 by default, or a load as
        {"force": 1.0} (N), {"pressure": ...}, {"overlap": ...} (m). Or "gas": balls lie apart on their sites, and are
        pressed with friction until they stand; so lattices begin that do not stand without friction.
    shear_response : tangential stiffness of a contact under sound, after a history: "stick", eta k everywhere, which small
        cycles of the load meet; or, for a load that goes on in one direction, "slide", none where a contact slides, and
        "partial_slip", ``eta k (1 - |T|/mu f)^(1/3)``, as if ``|T|`` were about to grow at every contact.
    step_tolerance : steps of the load are halved until that changes f* by less than this fraction.
    ordered : whether ``at_*`` take the loads in the order given, as :meth:`path` does.

    Raises
    ------
    MechanismError : the lattice does not stand without friction, as sc, bcc, diamond, square, honeycomb and kagome, and
        there is no history of friction that starts from the gas.
    InputError : motions other than those along the periods, a shape or number that is not whole and above zero, diameters
        with a shape or samples, a width below 1e-20 of the diameter; options of a history without ``friction_history``, a
        history without a friction coefficient, on a chain, or of balls that resist no slip.

    ``at_*`` take scalars or arrays: floats in, floats out. They raise :class:`~granphon.base.errors.InputError` for a load
    that is not finite, not compressive, or presses balls together by their whole diameter; for a load so low that a
    sample carries none (at and below the rigidity threshold, a* = 0.343 on the triangular lattice), or below the start of a
    history; and with ``finite_overlap`` in the geometry of the lattice, which has no such terms. They raise
    :class:`~granphon.base.errors.ConvergenceError` if no equilibrium is found, or a path ends before its last load;
    ``reached`` of the error is then the state at the loads before.
    """

    name, words = "simulation", "simulation"

    @property
    def is_quick(self) -> bool:
        """Whether its states take less than 0.1 s: arrays may not."""
        return False

    @property
    def arrays(self) -> tuple[Self, ...]:
        """The simulation itself."""
        return (self,)

    @cached_property
    def law(self) -> HertzLaw | SampleLaw:
        """Contact law: mean force against overlap of the samples; Hertz's law for equal balls and on a line.

        With a history of friction it is the law of monotonic loading.
        """
        return SampleLaw(replace(self, executor=None, ordered=False)) if self.packing.spread_matters else self.packing.law

    def at(self, load: Load, *, finite_overlap: bool | None = None) -> SimulatedState:
        """Return the state at a load; :meth:`at_force`, :meth:`at_pressure` and :meth:`at_overlap` take its value in SI."""
        load, wanted = load.applied, read_finite_overlap(finite_overlap)
        if self.geometry is None:
            return self._join(load, finite_overlap)
        if wanted and not self.is_exact:
            raise no_finite_overlap(self.name)
        if finite_overlap is not None and self.is_exact and not wanted:
            why = "Balls that have their true geometry overlap as much as they do"
            raise InputError("the exact geometry has finite overlap", why, "Leave finite_overlap out")
        prescribed = self.prescribed(load)
        if self.history.is_loaded:
            return self._press(load, prescribed)
        given = self.packing.structure, prescribed, self.workers, self.ratio
        every = [read_only(self.deviations(index)) for index in range(self.samples)]
        if self.executor is None:
            found = [find_equilibria(one, *given) for one in every]
        else:
            jobs = [self.executor.submit(find_equilibria, one, *given) for one in every]
            found = [share_array(job.result(), self.workers) for job in jobs]
        samples = [
            Sample(self.packing, self.seed_of(index), equilibria[place])
            for place in range(load.size)
            for index, equilibria in enumerate(found)
        ]
        return SimulatedState.of(self, samples, load)

    def _join(self, load: Load, finite_overlap: bool | None) -> SimulatedState:
        """Return the state at loads of which each has its own geometry."""
        self.require(load)
        groups = self.by_geometry(load, finite_overlap)
        if finite_overlap is not None:  # one geometry at all loads
            return groups[0][0].at(load, finite_overlap=finite_overlap)
        samples: list[list[Any]] = [[]] * load.size
        for one, places in groups:
            try:
                found = one.at(load.flat[places]).samples
            except GranphonError as error:
                if error.load_index is not None:
                    error.load_index = places[error.load_index]
                raise
            for row, place in enumerate(places):
                samples[place] = list(found[row * self.samples : (row + 1) * self.samples])
        return SimulatedState.of(self, [one for each in samples for one in each], load)

    def path(
        self, load: Load | None = None, *, force: ArrayLike | None = None, pressure: ArrayLike | None = None,
        overlap: ArrayLike | None = None, progress: Progress = silent,
    ) -> SimulatedState:  # fmt: skip
        """Return the states at loads that are applied in the order given: up, down, in cycles.

        Exactly one of force (N), pressure and overlap (m) is a list, or ``load`` is a
        :class:`~granphon.balls.loads.Load` of many values. The path begins at :attr:`start`, from where the first load is
        reached. Raises :class:`~granphon.base.errors.InputError` without ``friction_history``, where the order has no
        meaning, and for numbers that do not say which load they are; and what :meth:`at` raises. If a load is not reached,
        the error's ``reached`` is the state at those before it, None if there is none.
        """
        if not self.history.is_loaded:
            why = "Without friction the forces do not depend on the way to the load"
            raise InputError("a path needs friction_history", why, "Give friction_history=True, or use at_force")
        given: dict[str, ArrayLike | None] = {"force": force, "pressure": pressure, "overlap": overlap}
        if load is None:
            load = Load.only(**given)
        elif not isinstance(load, Load):
            what = f"a path takes no {brief(load)}"  # type: ignore[unreachable]
            mend = "Give force=[...] (N), pressure=[...] or overlap=[...] (m), or a Load of granphon.balls.loads"
            raise InputError(what, "It does not say what kind of load that is", mend)
        elif kinds := [kind for kind, values in given.items() if values is not None]:
            what = f"the loads of a path are given as a Load and as {' and '.join(kinds)}"
            raise InputError(what, mend="Give one")
        load = load.applied
        simulation = replace(self, ordered=True)
        return simulation._press(load, simulation.prescribed(load), progress)

    def _press(self, load: Load, prescribed: Sequence[ReducedLoad], progress: Progress = silent) -> SimulatedState:
        """Load all samples along one path; an error at which it ends has ``reached`` the state at the loads before."""
        order = self.history.sort(prescribed)
        path = [prescribed[place] for place in order]
        jobs = [partial(self._loaded_sample(index).press, path) for index in range(self.samples)]
        with progress.step("loading with friction", len(path) * len(jobs)) as step:
            if self.executor is None:
                found = [job(report=step.advance) for job in jobs]
            else:
                waiting, found = [self.executor.submit(job) for job in jobs], []
                for one in waiting:
                    found.append(one.result())
                    step.advance(len(path))
        reached = min(len(samples) for samples, _ in found)
        places = sorted(range(reached), key=lambda place: order[place])
        every = [samples[place] for place in places for samples, _ in found]
        error = next((error for samples, error in found if error is not None and len(samples) == reached), None)
        if error is None:
            return SimulatedState.of(self, every, load)
        if error.load_index is not None:
            error.load_index = order[error.load_index]
        if reached:
            error.reached = SimulatedState.of(self, every, load.flat[[order[place] for place in places]])
        raise error

    def _loaded_sample(self, index: int) -> LoadedSample:
        """Return one of the samples, as it is loaded with friction."""
        deviations = read_only(self.deviations(index))
        return LoadedSample(self.packing, self.seed_of(index), deviations, self.history, self.ratio, self.workers)

    def prescribed(self, load: Load) -> list[ReducedLoad]:
        """Convert each value of an applied load to a prescribed force or overlap in reduced units, in C order.

        Raises as :meth:`require` does.
        """
        self.require(load)
        return prescribe(self.packing, load, self.is_exact)

    def sample(self, load: ReducedLoad, before: tuple[float, Array] | None = None) -> Sample:
        """Return the first sample under one load, with the same numbers as in a state.

        ``before`` holds the overlap and displacements of its equilibrium under the previous load, in the order of
        :func:`~granphon.media.equilibria.sort_by_load`; it is None for the first load.
        """
        deviations = read_only(self.deviations(0))
        stencils = Stencils(self.cells, workers=self.workers, lattice=self.packing.structure)
        found = find_equilibrium(deviations, stencils, load, before, self.ratio)
        return Sample(self.packing, self.seed_of(0), found)

    def require(self, load: Load) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for an applied load that no sample can bear, solving none.

        It may be below the start of a loading, as far as that is known before the start is found.
        """
        require_load(self.packing, load, self._largest)
        if (start := self._start) is not None:
            require_above(start, prescribe(self.packing, load, self.is_exact))

    @property
    def _start(self) -> ReducedLoad | None:
        """The start below which no load may be, in reduced units; None if there is none, or if it is found as at the gas."""
        history = self.history
        if not history.is_loaded or history.ordered or not self.packing.width:
            return None
        start = history.reduce_start(self.packing, self.is_exact)
        return start if isinstance(start, ReducedLoad) else None

    def require_start(self, load: Load) -> None:
        """Raise as :meth:`require` does where the start of a loading is of another kind than the load: the start is solved.

        A start as a force is at another overlap in each sample, and one as an overlap at another force.
        """
        if self.count_start(load):
            path = self.prescribed(load)
            for index in range(self.samples):
                self._loaded_sample(index).require_start(path)

    def count_start(self, load: Load) -> float:
        """Return how many balls take as long as the start that :meth:`require_start` solves; zero if it need not."""
        start, exact = self._start, self.is_exact
        if start is None:
            return 0.0
        by_force = start.overlap is None
        if all((one.overlap is None) == by_force for one in self.prescribed(load)):
            return 0.0
        slow = 1.0 + _SLOW_FORCE / start.force if by_force else 1.0
        return slow * self.samples * max(self.balls * (_EXACT_BALL if exact else 1), _LEAST_SAMPLE[exact])


def _compute_exponent(means: Array) -> Array:
    """Return f M'/2kM, (...), from ``means`` (..., 4) over samples of M' = dM/d(delta), of M, k and f.

    If all samples have the same force, the four are dM/d log f, M, 1 and 1. M is the modulus of longitudinal waves, Pa.
    """
    rise, modulus, stiffness, force = np.moveaxis(means, -1, 0)
    return np.asarray(0.5 * force * rise / (stiffness * modulus))


def no_finite_overlap(medium: str) -> InputError:
    """Return the error for terms of finite overlap in a ``medium`` that is, or may become, a simulation."""
    what = f"the medium {medium!r} has no terms of finite overlap"
    why = "Its linear response is found in the limit of spread and overlap small against the diameter"
    return InputError(what, why, "Leave finite_overlap out, simulate with geometry exact, or take another medium")
