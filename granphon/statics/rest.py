"""Balls, walls and a cell at rest under a load, held by normal forces alone.

Rest is the minimum of the energy of all contacts less the work of the load
(:mod:`granphon.statics.configuration`). One method finds it: Newton's, with a line search on the
slope of the energy, that is on forces; differences of energies would be rounding near rest.

In the directions of the lattice the problem is convex, as contacts push ever harder: the forces at
rest are unique, while balls that nothing holds may be anywhere. Where contacts have opened, the
tangent is short of their stiffness, and a small stiffness that falls with the residual is added to
all contacts.

In exact directions contacts turn. The search starts from rest on the lattice, and the tangent has
the term -f/r of turning contacts. Where radii differ, contacts open, and balls that they held lean
on others. These loose balls are brought to rest first, while the others are held
(:mod:`granphon.statics.loose_balls`). Newton's method for all follows, and so on in turn. A step
that would raise the energy is replaced by one downhill, and where neither the loose balls nor the
others let each other come to rest, all move together. The inertia of the factors then proves that
rest is a minimum; from a saddle the balls go downhill along the softest motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from granphon.base.arrays import Array, Flags
from granphon.base.errors import (
    ConvergenceError,
    GranphonError,
    InputError,
    InstabilityError,
    MechanismError,
)
from granphon.contacts.assembly import Assembly
from granphon.statics.configuration import (
    ROUNDING,
    AppliedLoad,
    Boundary,
    Configuration,
    Geometry,
    Problem,
)
from granphon.statics.explanation import explain, find_typical_force
from granphon.statics.krylov import Map
from granphon.statics.loose_balls import find_way_down, has_soft_motions, lead_loose_balls
from granphon.statics.newton import Equations, IteratedEquations
from granphon.statics.options import RestOptions

#: what mends a crystal of differing balls that falls
_STAY = "Leave finite_overlap out: contacts then keep the directions of the sites"


@dataclass(frozen=True, eq=False, repr=False)
class Rest:
    """An assembly at rest; SI units.

    Attributes
    ----------
    displacement : (n, d) of the balls that move, m.
    wall_motion : (k,) of the walls along their lines, m.
    strain : (p, p) of the cell.
    overlap : (n_c,) of the contacts, m.
    normal : (n_c, d) unit vectors of the contacts.
    residual : the largest force left, as on a ball, over the mean force of contacts.
    """

    displacement: Array
    wall_motion: Array
    strain: Array
    overlap: Array
    normal: Array
    residual: float = 0.0

    @classmethod
    def of(cls, configuration: Configuration) -> Self:
        """Return a configuration that is at rest."""
        problem = configuration.problem
        assembly = problem.assembly
        x = configuration.x
        balls = x[: problem.n_ball_unknowns]
        return cls(
            balls.reshape(assembly.n_balls, assembly.dimension),
            x[problem.n_ball_unknowns : problem.n_displacements],
            configuration.strain,
            configuration.overlap,
            configuration.normal[:, : assembly.dimension],
            configuration.residual,
        )

    def scale(self, factor: float) -> Rest:
        """Return the state with all displacements, strains and overlaps times a ``factor``."""
        return replace(
            self,
            displacement=factor * self.displacement,
            wall_motion=factor * self.wall_motion,
            strain=factor * self.strain,
            overlap=factor * self.overlap,
        )


def find_rest(
    assembly: Assembly,
    load: AppliedLoad,
    geometry: Geometry = "lattice",
    boundary: Boundary = "stress",
    start: Rest | None = None,
    options: RestOptions | None = None,
) -> Rest:
    """Find balls, walls and a cell at rest under a load.

    Parameters
    ----------
    assembly : what comes to rest.
    load : what acts on it.
    geometry : "lattice": contacts keep the directions of the sites, and overlaps are linear in the
        displacements; "exact": contacts turn, the cell deforms, and the stress is Cauchy's.
    boundary : "stress": the cell takes the stress of the load; "isotropic": it keeps its shape and
        takes the pressure of the load. Neither matters to a cell whose strain is given.
    start : a state near by. By default the search starts from linear springs, and in exact
        directions from rest on the lattice.
    options : the numbers of the search.

    Raises
    ------
    InputError : contacts that push, or adhere, cannot bear the load.
    ConvergenceError : the search does not come to rest.
    InstabilityError : there is no rest in exact directions near that on the lattice.
    MechanismError : balls differ, and some of their motions, while all touch, cost no energy.
    """
    numbers = options or RestOptions()
    problem = Problem(assembly, load, geometry, boundary)
    if not problem.turns:
        return _LatticeSearch(problem, numbers).run(start)
    if start is None:
        start = find_rest(assembly, load, "lattice", boundary, None, numbers)
    if not (np.any(start.overlap) or load.acts):
        return start  # bonds without a load
    return _ExactSearch(problem, numbers).run(start)


def _find_unknowns(problem: Problem, rest: Rest) -> Array:
    """Return the unknowns (size,) of a state."""
    p = problem.assembly.periods
    units = problem.unit_strains[:, :p, :p]
    free = rest.strain - problem.load.strain
    strains = np.einsum("sab,ab->s", units, free) / np.einsum("sab,sab->s", units, units)
    return np.concatenate([rest.displacement.ravel(), rest.wall_motion, strains])


class _Trail:
    """The configuration nearest to rest on the way, and the steps since the residual was halved."""

    def __init__(self, required: float) -> None:
        self.required = required
        self.begin()

    def begin(self) -> None:
        """Forget the way."""
        self.best = math.inf
        self.stalled = 0
        self.nearest: Configuration | None = None

    def add(self, configuration: Configuration) -> None:
        """Go on to a configuration."""
        residual = configuration.residual
        self.stalled = self.stalled + 1 if residual > 0.5 * self.best else 0
        if residual < self.best:
            self.best = residual
            self.nearest = configuration

    def has_arrived(self, tolerance: float) -> bool:
        """Return whether the nearest configuration is at rest, or as near as rounding lets it
        come.
        """
        return self.best <= tolerance or (self.best <= self.required and self.stalled > 2)


class _Search:
    """A search for the rest of a problem."""

    def __init__(self, problem: Problem, options: RestOptions) -> None:
        self.problem = problem
        self.options = options
        assembly = problem.assembly
        self.is_factored = assembly.n_balls <= options.most_factorised[assembly.dimension]
        self.trail = _Trail(options.required)

    @cached_property
    def equations(self) -> Equations:
        """Newton's equations, by factors."""
        return Equations(self.problem, self.options)

    @cached_property
    def iterated_equations(self) -> IteratedEquations:
        """Newton's equations, by iteration."""
        return IteratedEquations(self.problem, self.options)

    def finish(self) -> Rest:
        """Return the state nearest to rest, without the light contacts of balls that differ: their
        force may be a residual only, and their stiffness would hold a ball.
        """
        assembly = self.problem.assembly
        laws = assembly.laws
        assert self.trail.nearest is not None
        rest = Rest.of(self.trail.nearest)
        if not assembly.differs or laws.adhere:
            return rest
        force = laws.force(rest.overlap)
        light = np.abs(force) <= self.options.carried * rest.residual * laws.size(force)
        opened = np.minimum(rest.overlap, laws.least)
        return replace(rest, overlap=np.where(light, opened, rest.overlap))


class _LatticeSearch(_Search):
    """The search in the directions of the lattice."""

    def __init__(self, problem: Problem, options: RestOptions) -> None:
        super().__init__(problem, options)
        assembly = problem.assembly
        #: whether equations are solved by iteration
        self.iterates = (
            not self.is_factored or assembly.n_balls >= options.fewest_iterated[assembly.dimension]
        )
        self.tolerance = options.iterated_tolerance if self.iterates else options.tolerance
        #: whether single balls make a preconditioner that is good enough
        self.balls_suffice = True
        self.kept_inverse: Map | None = None

    def run(self, start: Rest | None) -> Rest:
        """Return the state at rest."""
        problem = self.problem
        laws = problem.assembly.laws
        trail = self.trail
        if start is not None:
            unknowns = _find_unknowns(problem, start)
            configuration = problem.start_at(unknowns, start.overlap.copy())
        else:
            configuration = problem.start_at(np.zeros(problem.size))
            if not problem.load.is_given:
                if not (problem.load.acts or find_typical_force(problem)):
                    return self._rest_unloaded(configuration)
                configuration = self._guess(configuration)
        first = configuration.mean
        for _ in range(self.options.steps):
            mean = configuration.mean
            first = first or mean
            # under a strain alone balls may move aside until none is pressed
            relaxed = mean < self.options.relaxed * first and not problem.load.acts
            if not mean or relaxed:
                raise explain(problem, opened=True)
            trail.add(configuration)
            if trail.has_arrived(self.tolerance):
                break
            configuration = self._advance(configuration)
        if trail.best > self.options.required:
            raise self._explain_failure(configuration)
        rest = self.finish()
        if laws.adhere and not np.any(np.isinf(laws.tension)):
            return rest
        size = np.abs(rest.overlap)
        rounded = (size <= ROUNDING * np.max(size, initial=0.0)) & (laws.tension == 0.0)
        return replace(rest, overlap=np.where(rounded, 0.0, rest.overlap))

    def _rest_unloaded(self, configuration: Configuration) -> Rest:
        """Return bonds without a load."""
        if np.any(configuration.stiffness > 0.0):
            return Rest.of(configuration)
        words = self.problem.load.words
        raise InputError(f"{words} presses nothing", "Contacts have no stiffness without a force")

    def _guess(self, configuration: Configuration) -> Configuration:
        """Return where linear springs are at rest that have the law of the contacts at a typical
        force.
        """
        problem = self.problem
        laws = problem.assembly.laws
        size = np.full(problem.assembly.n_contacts, find_typical_force(problem))
        if not np.any(size):
            raise explain(problem)
        with np.errstate(all="ignore"):
            reached = laws.overlap(size)
            while not np.all(np.isfinite(reached)) and size[0] > 1e-300:
                size = 0.5 * size  # a law may have a largest force
                reached = laws.overlap(size)
        stiffness = laws.stiffness(reached)
        force = size + stiffness * (configuration.overlap - reached)
        pull = problem.force + problem.collect_forces(configuration.normal, force)
        step = self._solve(configuration, stiffness, pull, 1e-3)
        loss = problem.measure_losses(step)
        return configuration.move(step, configuration.overlap - loss)

    def _solve(
        self, configuration: Configuration, stiffness: Array, pull: Array, reduction: float
    ) -> Array:
        """Return the step (size,) of springs of a ``stiffness`` under forces ``pull``."""
        if not len(pull):
            return pull
        if not self.iterates:
            return self.equations.solve(configuration, stiffness, pull)
        options = self.options
        most = options.most_iterations
        if self.is_factored:
            most = options.patience_of_iterations[self.problem.assembly.dimension]
            if self.kept_inverse:
                most = options.patience_of_factors
        if self.balls_suffice or self.kept_inverse:
            step, has_converged = self.iterated_equations.solve(
                configuration, stiffness, pull, reduction, most, self.kept_inverse
            )
            if has_converged or not self.is_factored:
                return step
            self.balls_suffice = False
        self.kept_inverse = self.equations.linearise(configuration, stiffness).invert()
        return self.problem.remove_drift(self.kept_inverse(pull))

    def _advance(self, configuration: Configuration) -> Configuration:
        """Return the configuration after a step of Newton's method, of a length at which the slope
        of the energy is small.
        """
        problem = self.problem
        residual = configuration.residual
        stiffness = configuration.stiffness
        closed = stiffness[stiffness > 0.0]
        added = configuration.mean / problem.length
        if closed.size:
            added = self.options.added * min(1.0, residual) * float(np.mean(closed))
        pull = configuration.pull
        reduction = min(0.1, max(0.1 * residual**0.5, 1e-4))
        step = self._solve(configuration, stiffness + added, pull, reduction)
        loss = problem.measure_losses(step)
        length = self._find_length(configuration, loss, float(pull @ step))
        return configuration.move(
            configuration.x + length * step, configuration.overlap - length * loss
        )

    def _find_length(self, configuration: Configuration, loss: Array, fall: float) -> float:
        """Return the length of a step at which the energy no longer falls much, at first by
        ``fall``.

        Raises the error of a load that cannot be borne if the energy falls without end.
        """
        options = self.options
        laws = self.problem.assembly.laws
        overlap = configuration.overlap
        force = configuration.force
        longest = math.inf
        if laws.adhere:  # no contact may be torn on the way
            parting = loss > 0.0
            room = (overlap - laws.least)[parting] / loss[parting]
            longest = max(0.9 * float(np.min(room, initial=math.inf)), 1e-9)
        length = min(1.0, longest)
        low = 0.0
        high = math.inf
        if fall <= 0.0:  # the rounding of a state at rest
            return length
        for _ in range(options.slopes):
            force_ahead = laws.force(overlap - length * loss)
            slope = float((force - force_ahead) @ loss) - fall
            if not np.any(force_ahead) and np.any(force):
                # under a load that is small against the forces before it
                slope = math.inf
            near_rest = configuration.residual < 1e-6 and length == 1.0 and slope <= fall
            if abs(slope) <= options.slope * fall or near_rest:
                return length
            if slope < 0.0:
                low = length
                if length >= longest:
                    return length
                if length > options.endless:
                    raise explain(self.problem)
            else:
                high = length
            length = min(4.0 * length, longest) if high == math.inf else 0.5 * (low + high)
        return length

    def _explain_failure(self, configuration: Configuration) -> GranphonError:
        """Return the error of a search that has not come to rest."""
        laws = self.problem.assembly.laws
        error = explain(self.problem, residual=self.trail.best)
        if laws.adhere and isinstance(error, ConvergenceError):
            contact = int(np.argmin(configuration.overlap - laws.least))
            problem = f"{self.problem.load.words} pulls contact {contact} apart"
            why = f"It bears a tension of up to {laws.tension[contact]:.6g} N"
            return InputError(problem, why, "Press the crystal more")
        return error


class _ExactSearch(_Search):
    """The search in exact directions."""

    def run(self, start: Rest) -> Rest:
        """Return the state at rest near ``start``."""
        options = self.options
        problem = self.problem
        assembly = problem.assembly
        differs = assembly.differs
        trail = self.trail
        tolerance = options.tolerance if self.is_factored else options.iterated_tolerance
        configuration = problem.start_at(_find_unknowns(problem, start))
        loose = np.zeros(assembly.n_balls, bool)
        spread = 0.0
        if differs:
            self._require_rigid()
            spread = float(np.max(np.abs(assembly.offset)) / np.mean(assembly.distance))
            heavy = configuration.force > options.light * configuration.mean
            loose = assembly.count_contacts(heavy) <= assembly.dimension
        n_saddles = 0
        for _ in range(options.steps):
            in_turn = np.any(loose) and trail.stalled <= options.patience
            if configuration.is_sound and in_turn:
                configuration = self._lead(configuration, loose, spread)
            if not configuration.is_sound:
                break
            trail.add(configuration)
            if trail.has_arrived(tolerance):
                if not differs:
                    return self.finish()
                below = self._leave_saddle() if n_saddles < options.saddles else None
                if below is None:
                    return self.finish()
                configuration = below
                trail.begin()
                n_saddles += 1
                continue
            patience = (4 if differs else 1) * options.patience
            if trail.stalled > patience or not np.any(configuration.stiffness):
                break
            configuration = self._advance(configuration, loose)
        raise self._explain_failure()

    def _require_rigid(self) -> None:
        """Raise :class:`MechanismError` if motions of balls that differ cost nothing."""
        if not (self.is_factored and has_soft_motions(self.equations)):
            return
        words = self.problem.load.words
        what = f"balls that differ do not come to rest in the true geometry under {words}"
        why = (
            "The crystal does not stand without friction: motions in which no contact is pressed"
            " cost no energy"
        )
        raise MechanismError(
            what, why, f"{_STAY}; or take a crystal with more contacts, such as fcc"
        )

    def _lead(self, configuration: Configuration, loose: Flags, spread: float) -> Configuration:
        """Return the configuration in which loose balls are at rest between the others."""
        options = self.options
        on_others = configuration.force_on_balls[~loose]
        left = float(np.max(on_others, initial=0.0)) / configuration.mean
        least = max(options.tolerance, options.loose_tolerance * min(spread, left))
        return lead_loose_balls(configuration, loose, least, options)

    def _leave_saddle(self) -> Configuration | None:
        """Return where to go on from a saddle of the energy; None at a minimum."""
        if not self.is_factored:
            return None
        assert self.trail.nearest is not None
        return find_way_down(self.trail.nearest, self.equations)

    def _advance(self, configuration: Configuration, loose: Flags) -> Configuration:
        """Return the configuration after a step; of balls that differ, those that are far from rest
        then become ``loose``.
        """
        options = self.options
        assembly = self.problem.assembly
        step = self._find_step(configuration)
        ahead = configuration.move(configuration.x + step)
        if not assembly.differs:
            return ahead
        # steps up the energy would go round in circles, or back to a saddle: the slopes at both
        # ends tell
        falls = (
            ahead.is_sound
            and configuration.pull @ step > 0.0
            and (configuration.pull + ahead.pull) @ step >= 0.0
        )
        if not (falls and ahead.residual < options.farthest):
            ahead = self._search(configuration, self._find_leaning_step(configuration))
        size = options.failed * configuration.residual * ahead.mean
        loose |= ahead.force_on_balls > size
        return ahead

    def _find_step(self, configuration: Configuration) -> Array:
        """Return the step (size,) of Newton's method."""
        pull = configuration.pull
        if not len(pull):
            return pull
        stiffness = configuration.stiffness
        if not self.is_factored:
            return self._iterate(configuration, stiffness)
        slope = self._find_load_slope(configuration)
        return self.equations.solve(configuration, stiffness, pull, load_slope=slope)

    def _find_leaning_step(self, configuration: Configuration) -> Array:
        """Return a step (size,) of a tangent in which forces push balls back instead of aside: a
        step is then about as long as a ball is far from the line between two others.
        """
        stiffness = configuration.stiffness
        added = self.options.added * min(1.0, configuration.residual) * float(np.mean(stiffness))
        if not self.is_factored:
            return self._iterate(configuration, stiffness + added)
        return self.equations.solve(configuration, stiffness + added, configuration.pull, -1.0)

    def _iterate(self, configuration: Configuration, stiffness: Array) -> Array:
        """Return a step (size,) that iteration finds."""
        most = self.options.most_iterations
        return self.iterated_equations.solve(
            configuration, stiffness, configuration.pull, 1e-4, most
        )[0]

    def _find_load_slope(self, configuration: Configuration) -> Array | None:
        """Return the growth (size, k + s) of the load's forces with walls and strains: the load
        follows the cell as that deforms.
        """
        problem = self.problem
        load = problem.load
        p = problem.assembly.periods
        units = problem.unit_strains[:, :p, :p]
        if not len(units) or load.stress is None:
            return None
        n = problem.n_displacements
        inverse = np.linalg.inv(configuration.deformed)
        growth = configuration.growth
        slope = np.zeros((problem.size, problem.assembly.n_walls + len(units)))
        for column, unit in enumerate(units, start=problem.assembly.n_walls):
            grown = growth * float(np.trace(inverse @ unit))
            slope[:n, column] = grown * load.pressure_force
            turned = grown * inverse - growth * inverse @ unit @ inverse
            slope[n:, column] = problem.find_work(load.stress @ turned)
        return slope

    def _search(self, configuration: Configuration, step: Array) -> Configuration:
        """Go along a step until the energy no longer falls much: its slope is that of the forces
        left.
        """
        options = self.options
        first = float(configuration.pull @ step)
        low = 0.0
        high = math.inf
        length = 1.0
        ahead = configuration
        for _ in range(options.slopes):
            ahead = configuration.move(configuration.x + length * step)
            slope = float(ahead.pull @ step) if ahead.is_sound else -math.inf
            if abs(slope) <= options.loose_slope * abs(first) or (slope > 0.0 and length >= 1.0):
                break
            if slope > 0.0:
                low = length
            else:
                high = length
            length = 0.5 * (low + high)
        return ahead

    def _explain_failure(self) -> ConvergenceError | InstabilityError:
        """Return the error of a search that has not come to rest."""
        words = self.problem.load.words
        if self.problem.assembly.differs:
            problem = f"balls that differ have not come to rest in the true geometry under {words}"
            left = f"A force of {self.trail.best:.2g} of the mean is left on a ball"
            return ConvergenceError(problem, left, f"{_STAY}; or press loose balls more")
        why = "Its contacts turn away under the load, and nothing holds it"
        mend = "Lower the load, or add contacts"
        return InstabilityError(f"the crystal collapses under {words}", why, mend)
