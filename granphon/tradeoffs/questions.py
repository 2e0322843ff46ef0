"""The questions of a trade-off between speed and accuracy: their points, and references made by other algorithms.

- the media, against a large ensemble of simulated samples, whose equilibria and responses a sparse LU has checked;
- the grid of the lattice's Green's function, against adaptive quadrature;
- the solution of the effective medium, against a general integrator of differential equations;
- the mesh of the density of states, against counting between the roots of determinants.

Errors are of what a scene observes, velocities or frequencies, at its loads.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls.diameters import Spread
from granphon.balls.distributions import PointShape, Shape
from granphon.balls.lattices import TRIANGULAR
from granphon.balls.packing import Packing
from granphon.base.errors import GranphonError, InputError, message
from granphon.base.progress import Step
from granphon.dynamics.local_field import local_field, local_field_on
from granphon.dynamics.modes import ContactLattice
from granphon.laws.collocation import solved
from granphon.laws.effective import EffectiveLaw, averages_of, effective_curve
from granphon.laws.effective_curve import EffectiveCurve
from granphon.media.cost import estimate
from granphon.media.mean_field import AveragedForce, AveragedLattice, EffectiveMedium
from granphon.media.simulation import DirectSimulation, SimulatedState
from granphon.media.state import ContactState
from granphon.observables.acoustics import contact_lattice
from granphon.observables.velocities import local_exponent
from granphon.tradeoffs.ensemble import QUANTITIES, Moments, observed

__all__ = ["Point", "Reference", "Study", "studies"]

Array = NDArray[np.float64]
_EPS = float(np.finfo(float).eps)
#: sides of the samples, and how many there are of each
_SIDES, _SAMPLES = (8, 16, 32, 64, 128), (1, 4)
#: the samples of the reference: balls along a side, and the first seed, far from those of the points
_SIDE, _SEED = 64, 1_000_000
#: how many of them it takes at least
_LEAST_SAMPLES = 3
#: balls along a side of the sample that is solved by another algorithm as well
_CHECKED = 24
#: samples between two looks at how good the reference is
_LOOK = 8
#: points along a side of the grids of the Green's function, graded towards its singularities and uniform
_GRADED, _UNIFORM = (2, 3, 4, 6, 8, 12), (4, 8, 16, 32, 64, 128, 256)
#: effective media that tell what an error of Xi makes of a velocity
_SOLUTIONS = 3
#: tolerances of the collocation by its stages; of few stages a small one takes ever more steps
_TOLERANCES = {3: (1e-1, 1e-2, 1e-3, 1e-4), 6: (1e-1, 1e-2, 1e-4, 1e-6), 16: (1e-2, 1e-4, 1e-6, 1e-8, 1e-10)}
#: openings of listed diameters beyond which a general integrator would restart too often
_MOST_OPENINGS = 40
#: diameters of a list that is solved to see how long a longer one takes, by this power of the openings
_FEW, _POWER = 20, 1.1
#: points along a side of the mesh of the density of states; intervals that are compared, every how many of its points
_MESHES, _EVERY = (8, 16, 32, 64, 128, 256), 5


@dataclass(frozen=True)
class Point:
    """A method with its knob: ``prepare(run)`` makes ready, ``solve`` finds what is compared with the reference.

    ``seconds``: about what a run takes; of a ``random`` method every run is another draw.
    """

    method: str
    knob: str
    prepare: Callable[[int], Any]
    solve: Callable[[Any], Any]
    seconds: float = 0.0
    random: bool = False


class Reference(NamedTuple):
    """What is right: ``values``, their relative ``errors``, and how they were found."""

    values: Any
    errors: Array
    made: str


class Study(ABC):
    """One question. Errors are (n_loads, n_observed), relative."""

    name: ClassVar[str]

    @property
    @abstractmethod
    def observed(self) -> tuple[str, ...]:
        """The quantities that errors are of."""

    @property
    @abstractmethod
    def loads(self) -> tuple[float, ...]:
        """Those at which errors are measured, SI."""

    @abstractmethod
    def points(self) -> list[Point]:
        """The methods, each with its knobs, the cheapest knob of a method first."""

    @abstractmethod
    def reference(self, until: float, better: Callable[[Reference], bool], step: Step) -> Reference:
        """Found before the time ``until``, and no better than asked for; :class:`GranphonError` if it cannot be."""

    @abstractmethod
    def errors(self, outcomes: Sequence[Any], reference: Reference) -> Array:
        """Of the outcomes of a point's runs: the rms over them, if they are draws."""

    @abstractmethod
    def floor(self, point: Point, outcomes: Sequence[Any]) -> float:
        """Below which the error of a point cannot be: condition times rounding, or the chance of the draws."""


def studies(
    packing: Packing, kind: str, loads: tuple[float, ...], observe: tuple[str, ...], finite_overlap: bool = False
) -> list[Study]:
    """Those that make sense for a packing, the media first; see :func:`granphon.tradeoffs.measure.tradeoff`."""
    found: list[Study] = []
    if packing.width:
        if packing.structure != TRIANGULAR or finite_overlap:
            what = "with finite overlap" if finite_overlap else f"on the {packing.structure.name} lattice"
            raise InputError(
                message(
                    f"media are not compared {what}",
                    "Their reference is the simulated array, which is there on the triangular lattice in the paper's limit",
                    "Change that, or leave the spread out",
                )
            )
        spectra = bool({"bands", "dos"} & set(observe))
        asked = {"frequency": spectra, "longitudinal": "velocities" in observe, "transverse": "velocities" in observe}
        quantities = tuple(name for name in QUANTITIES if asked[name])
        disorder = _Disorder(packing, kind, loads, quantities)
        found += [MediaStudy(disorder), GridStudy(disorder), SolutionStudy(disorder)]
    if "dos" in observe:
        found.append(MeshStudy(packing, kind, loads, finite_overlap))
    if not found:
        raise InputError(
            message(
                "there is nothing to trade for equal balls",
                "All media are exact then, and as fast",
                "Give the packing a spread, or observe dos, whose mesh can be chosen",
            )
        )
    return found


@dataclass(frozen=True)
class _Disorder:
    """Balls that differ, their loads, and which of :data:`QUANTITIES` are observed."""

    packing: Packing
    kind: str
    loads: tuple[float, ...]
    quantities: tuple[str, ...]

    @property
    def columns(self) -> list[int]:
        """Of the observed ones."""
        return [QUANTITIES.index(name) for name in self.quantities]

    @cached_property
    def spread(self) -> Spread:
        """Of the diameters."""
        if self.packing.spread is None:
            raise InputError("the balls are equal.")
        return self.packing.spread

    @property
    def shape(self) -> Any:
        """Of the distribution."""
        return self.spread.shape

    def state(self, medium: Any) -> ContactState:
        """At the loads."""
        state: ContactState = getattr(medium, f"at_{self.kind}")(np.array(self.loads))
        return state

    @cached_property
    def effective(self) -> ContactState:
        """The state in the effective medium, at the loads."""
        return self.state(EffectiveMedium(self.packing))

    @property
    def forces(self) -> Array:
        """f* at the loads, in the effective medium."""
        return np.asarray(self.effective.reduced_force)

    @cached_property
    def solving(self) -> float:
        """About how many seconds the effective medium takes: zero but for long lists of diameters."""
        shape = self.shape
        if shape.openings.size <= _MOST_OPENINGS:
            return 0.0
        x = np.array(shape.positions)[np.unique(np.linspace(0, len(shape.positions) - 1, _FEW).astype(int))]
        few = PointShape(tuple(x.tolist()), (1.0 / x.size,) * x.size)
        begun = time.perf_counter()
        solved(few, 1.0, averages_of(few, 1.0), 12, 1e-10)
        return float((time.perf_counter() - begun) * (shape.openings.size / few.openings.size) ** _POWER)

    @cached_property
    def condition(self) -> float:
        """How many times a relative change of load and width comes back in a velocity, at most."""
        state = self.state(AveragedForce(self.packing))
        if not self.solving:
            with suppress(GranphonError):  # below its loads
                state = self.effective
        by_force = np.asarray(local_exponent(state))
        overlap = np.asarray(state.overlap)
        # v = f^(1/6) times a function of f/W^(3/2), or W^(1/4) times one of delta/W
        by_load = by_force if self.kind != "overlap" else by_force * overlap * state.normal_stiffness / state.force
        by_width = 1.5 * (by_force - 1.0 / 6.0) if self.kind != "overlap" else 0.25 - by_load
        return float(1.0 + np.max(np.abs(by_load) + np.abs(by_width)))

    def repeated(self, errors: Array) -> Array:
        """(n_loads, n_observed) of errors that all quantities share: a stiffness enters each by its root."""
        return np.repeat(np.abs(errors)[:, None], len(self.quantities), axis=1)


def _within(until: float) -> Callable[[], None]:
    """A check that raises when the time ``until`` is over."""

    def check() -> None:
        if time.perf_counter() > until:
            raise GranphonError("it does not fit into the budget.")

    return check


def _rms(values: Sequence[Array]) -> Array:
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))


@dataclass(frozen=True)
class _DisorderStudy(Study):
    """A study of balls that differ, at all their loads."""

    disorder: _Disorder

    @property
    def observed(self) -> tuple[str, ...]:
        """As :class:`Study`."""
        return self.disorder.quantities

    @property
    def loads(self) -> tuple[float, ...]:
        """As :class:`Study`."""
        return self.disorder.loads


# -- the media ------------------------------------------------------------------------------------------------------


class MediaStudy(_DisorderStudy):
    """The rungs of the ladder against the array."""

    name = "media"

    def points(self) -> list[Point]:
        """As :class:`Study`."""
        disorder, packing, solving = self.disorder, self.disorder.packing, self.disorder.solving

        def solve(medium: Any) -> Array:
            return observed(disorder.state(medium))[:, disorder.columns]

        def prepared(medium: Callable[[], EffectiveMedium]) -> Callable[[int], EffectiveMedium]:
            def prepare(run: int) -> EffectiveMedium:
                effective_curve.cache_clear()
                made = medium()
                _ = made.law.curve if isinstance(made.law, EffectiveLaw) else None
                return made

            return prepare

        def sampled(side: int, samples: int) -> Callable[[int], DirectSimulation]:
            return lambda run: DirectSimulation(packing, (side, side), run * samples, samples)

        found = [
            Point("averaged lattice", "ala", lambda run: AveragedLattice(packing), solve),
            Point("averaged force", "afa", lambda run: AveragedForce(packing), solve),
            Point("effective medium", "computed field", prepared(lambda: EffectiveMedium(packing)), solve, solving),
            Point(
                "effective medium, paper's field",
                "printed field",
                prepared(lambda: EffectiveMedium(packing, "paper")),
                solve,
                solving,
            ),
        ]
        kind: Any = disorder.kind
        for samples in _SAMPLES:
            for side in _SIDES:
                prepare = sampled(side, samples)
                seconds = estimate(prepare(0), kind, disorder.loads).seconds
                method = f"simulation, {samples} sample{'s' if samples > 1 else ''}"
                found.append(Point(method, f"{side} x {side}", prepare, solve, seconds, random=True))
        return sorted(found, key=lambda point: point.seconds)

    def reference(self, until: float, better: Callable[[Reference], bool], step: Step) -> Reference:
        """Samples until it is good enough or the time is over; another one a sparse LU solves anew, statics and response."""
        disorder = self.disorder
        moments = Moments(disorder.packing, disorder.kind, disorder.loads, (_SIDE, _SIDE), _SEED)
        begun = time.perf_counter()
        apart = self._checked(until)
        longest, count, found = 0.0, 0, None
        while time.perf_counter() + 1.5 * longest < until:
            start = time.perf_counter()
            moments.add()
            longest, count = max(longest, time.perf_counter() - start), count + 1
            step.advance()
            if count >= _LEAST_SAMPLES and count % _LOOK == 0:
                found = self._reference(moments, apart)
                if better(found):
                    break
        if count < _LEAST_SAMPLES:
            taken = time.perf_counter() - begun
            raise GranphonError(f"the budget holds {count} of its samples only ({taken:.2g} s), and it takes many.")
        return self._reference(moments, apart)

    def _reference(self, moments: Moments, apart: Array) -> Reference:
        columns, ensemble = self.disorder.columns, moments.ensemble()
        errors = np.hypot(ensemble.errors, apart[:, None])
        balls = f"{ensemble.samples} samples of {_SIDE} x {_SIDE} balls"
        checked = f"of one of {_CHECKED} x {_CHECKED}, equilibrium and response by sparse LU differ by {np.max(apart):.0e}"
        made = f"{balls} with control variates; {checked}"
        return Reference(ensemble.values[:, columns], errors[:, columns], made)

    def _checked(self, until: float) -> Array:
        """(n_loads,) by how much a sample differs from its solution by another algorithm."""
        from granphon.array.sparse import SparseArray

        disorder = self.disorder
        simulation = DirectSimulation(disorder.packing, (_SIDE, _SIDE), _SEED)
        kind: Any = disorder.kind
        if (least := _LEAST_SAMPLES * estimate(simulation, kind, disorder.loads).seconds) > until - time.perf_counter():
            raise GranphonError(f"the budget does not hold its samples: {_LEAST_SAMPLES} take some {least:.2g} s.")
        state = disorder.state(DirectSimulation(disorder.packing, (_CHECKED, _CHECKED), _SEED))
        apart = []
        for sample in state.samples if isinstance(state, SimulatedState) else ():
            other = SparseArray(sample.equilibrium.deviations)
            forces = other.forces(sample.equilibrium.overlap, check=_within(until))
            tensor = other.elastic_tensor(forces, disorder.packing.mindlin_ratio)
            ours = sample.elastic_tensor
            scale = sample.normal_stiffness / sample.equilibrium.stiffness / disorder.packing.diameter
            off = np.max(np.abs(scale * tensor - ours)) / np.max(ours)
            apart.append(max(abs(np.mean(forces) / sample.equilibrium.force - 1.0), 0.5 * off))
        return np.array(apart)

    def errors(self, outcomes: Sequence[Any], reference: Reference) -> Array:
        """As :class:`Study`."""
        return _rms([outcome / reference.values - 1.0 for outcome in outcomes])

    def floor(self, point: Point, outcomes: Sequence[Any]) -> float:
        """As :class:`Study`."""
        if not point.random:
            return _EPS * self.disorder.condition
        return float(np.max(np.std(outcomes, axis=0, ddof=1) / np.mean(outcomes, axis=0)))


# -- the grid of the Green's function -------------------------------------------------------------------------------


class GridStudy(_DisorderStudy):
    """The q grid that gives the local-field factor Xi; errors are what those of Xi make of velocities, to first order."""

    name = "Green's function"

    @cached_property
    def _sensitivity(self) -> Array:
        """(n_loads,) d log v / d log Xi."""
        disorder, law, step = self.disorder, EffectiveMedium(self.disorder.packing).law, 1e-3
        if not isinstance(law, EffectiveLaw):
            raise InputError("the balls are equal.")
        k = []
        for factor in (1.0 - step, 1.0 + step):
            other = EffectiveLaw(law.coefficient, law.width, law.shape, factor * law.xi)
            given = disorder.effective
            overlap = given.overlap if disorder.kind == "overlap" else other.overlap(given.force)
            k.append(np.asarray(other.stiffness(overlap)))
        return np.asarray(0.5 * (k[1] - k[0]) / (k[1] + k[0]) / step)

    def points(self) -> list[Point]:
        """As :class:`Study`."""
        eta = self.disorder.packing.mindlin_ratio

        def nothing(run: int) -> None:
            return None

        def point(method: str, number: int, graded: bool) -> Point:
            return Point(method, f"{number}", nothing, lambda ready: local_field_on(number, eta, graded))

        graded = [point("graded triangles", number, True) for number in _GRADED]
        return graded + [point("uniform grid", number, False) for number in _UNIFORM]

    def reference(self, until: float, better: Callable[[Reference], bool], step: Step) -> Reference:
        """By adaptive quadrature."""
        from granphon.tradeoffs.references import local_field_by_cubature

        if (least := _SOLUTIONS * self.disorder.solving) > until - time.perf_counter():
            raise GranphonError(f"its {_SOLUTIONS} effective media, some {least:.2g} s, do not fit into the budget.")
        xi, error = local_field_by_cubature(self.disorder.packing.mindlin_ratio)
        errors = self.disorder.repeated(self._sensitivity * error / xi)
        return Reference(xi, errors, f"adaptive quadrature of the Green's function, Xi = {xi:.12g} to {error:.0e}")

    def errors(self, outcomes: Sequence[Any], reference: Reference) -> Array:
        """As :class:`Study`."""
        return self.disorder.repeated(self._sensitivity * (outcomes[0] / reference.values - 1.0))

    def floor(self, point: Point, outcomes: Sequence[Any]) -> float:
        """As :class:`Study`."""
        # Xi = 1/u_1 - 1; and a velocity is rounded itself
        return float(np.max(np.abs(self._sensitivity)) * _EPS * (1.0 + 1.0 / outcomes[0])) + _EPS


# -- the solution of the effective medium ---------------------------------------------------------------------------


class SolutionStudy(_DisorderStudy):
    """The collocation of equation (36): stages and tolerance; errors are of velocities at the same forces."""

    name = "effective medium"

    @cached_property
    def _xi(self) -> float:
        return local_field(TRIANGULAR, self.disorder.packing.mindlin_ratio).xi

    def points(self) -> list[Point]:
        """As :class:`Study`."""
        shape, xi = self.disorder.shape, self._xi

        def point(stages: int, tolerance: float) -> Point:
            def solve(averages: Any) -> Array:
                law = _LawOf(1.0, 1.0, shape, xi, solved(shape, xi, averages, stages, tolerance))
                return np.asarray(law.stiffness(law.overlap(self.disorder.forces)))

            return Point(
                f"{stages} stages", f"{tolerance:.0e}", lambda run: averages_of(shape, xi), solve, self.disorder.solving
            )

        return [point(stages, tolerance) for stages, several in _TOLERANCES.items() for tolerance in several]

    def reference(self, until: float, better: Callable[[Reference], bool], step: Step) -> Reference:
        """By scipy's integrator."""
        from granphon.tradeoffs.references import curve_by_integration

        shape: Shape = self.disorder.shape
        if shape.openings.size > _MOST_OPENINGS:
            raise GranphonError(f"the diameters have {shape.openings.size} openings, at each of which it would start anew.")
        check = _within(until)
        found = [
            curve_by_integration(shape, self._xi, self.disorder.forces, tolerance, check=check)[1]
            for tolerance in (1e-11, 1e-13)
        ]
        errors = self.disorder.repeated(0.5 * (found[0] / found[1] - 1.0))
        made = f"a general integrator of differential equations, with a tolerance 100 times larger {np.max(errors):.0e} away"
        return Reference(found[1], np.maximum(errors, _EPS), made)

    def errors(self, outcomes: Sequence[Any], reference: Reference) -> Array:
        """As :class:`Study`."""
        return self.disorder.repeated(0.5 * (outcomes[0] / reference.values - 1.0))

    def floor(self, point: Point, outcomes: Sequence[Any]) -> float:
        """As :class:`Study`."""
        return _EPS * self.disorder.condition


@dataclass(frozen=True)
class _LawOf(EffectiveLaw):
    """The law of a curve that was solved otherwise than :func:`~granphon.laws.effective.effective_curve` does."""

    own: EffectiveCurve

    @property
    def curve(self) -> EffectiveCurve:
        """That curve."""
        return self.own


# -- the mesh of the density of states ------------------------------------------------------------------------------


@dataclass(frozen=True)
class MeshStudy(Study):
    """Mesh and method of the density of states; errors are the part of the modes in a wrong interval of frequency."""

    name = "density of states"

    packing: Packing
    kind: str
    given: tuple[float, ...]
    finite_overlap: bool

    @property
    def observed(self) -> tuple[str, ...]:
        """As :class:`Study`."""
        return ("dos",)

    @property
    def loads(self) -> tuple[float, ...]:
        """One: in the paper's limit the density of states has the same form at each."""
        return self.given[-1:]

    @cached_property
    def _state(self) -> ContactState:
        medium = EffectiveMedium(self.packing)
        state: ContactState = getattr(medium, f"at_{self.kind}")(self.loads[0], finite_overlap=self.finite_overlap)
        return state

    @property
    def _lattice(self) -> ContactLattice:
        return contact_lattice(self._state)

    @cached_property
    def _edges(self) -> Array:
        """Of the intervals, in reduced units."""
        top = 1.02 * self._lattice.top_frequency
        at = np.linspace(0.0, top, 501)
        return np.concatenate([at[:1], 0.5 * (at[1:] + at[:-1])[_EVERY - 1 :: _EVERY], at[-1:]])

    def points(self) -> list[Point]:
        """As :class:`Study`."""

        def prepare(run: int) -> Any:
            from granphon.phonons.phonons import Phonons

            phonons = Phonons(self._state)
            _ = phonons.phonopy
            return phonons

        def point(method: str, mesh: int) -> Point:
            def solve(phonons: Any) -> Array:
                return self._below(phonons.dos((mesh, mesh), method))

            return Point(method, f"{mesh} x {mesh}", prepare, solve)

        return [point(method, mesh) for method in ("tetrahedron", "smearing") for mesh in _MESHES]

    def _below(self, dos: Any) -> Array:
        """Modes per ball below each edge."""
        at = dos.frequencies / self._state.scales.frequency
        ends = np.concatenate([at[:1], 0.5 * (at[1:] + at[:-1]), at[-1:]])
        total = np.concatenate([[0.0], np.cumsum(dos.total * self._state.scales.frequency * np.diff(ends))])
        return np.asarray(np.interp(self._edges, ends, total))

    def reference(self, until: float, better: Callable[[Reference], bool], step: Step) -> Reference:
        """By counting between roots."""
        from granphon.tradeoffs.references import integrated_dos

        check = _within(until)
        rough, fine = (integrated_dos(self._lattice, self._edges, points, check) for points in (128, 256))
        error = _displaced(rough, fine)
        made = f"counting between the roots of determinants, on twice the lines {error:.0e} away"
        return Reference(fine, np.array([[max(error, _EPS)]]), made)

    def errors(self, outcomes: Sequence[Any], reference: Reference) -> Array:
        """As :class:`Study`."""
        return np.array([[_displaced(outcomes[0], reference.values)]])

    def floor(self, point: Point, outcomes: Sequence[Any]) -> float:
        """As :class:`Study`."""
        return _EPS * self._lattice.n_branches


def _displaced(below: Array, reference: Array) -> float:
    """The part of the modes that one has in another interval than the other."""
    return float(0.5 * np.sum(np.abs(np.diff(below) - np.diff(reference))) / reference[-1])
