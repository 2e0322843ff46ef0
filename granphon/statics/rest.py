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
rest is a minimum; from a saddle the balls go downhill along the softest motion. Of a list that is a
grid, iterations with Green's function find the steps, and where most contacts are closed conjugate
gradients under random forces take the place of the inertia.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from granphon.balls.hertz import HertzLaw
from granphon.base.arrays import Array, Flags
from granphon.base.errors import (
    ConvergenceError,
    GranphonError,
    InputError,
    InstabilityError,
    MechanismError,
)
from granphon.contacts.assembly import ROUNDING, Assembly, GridAssembly
from granphon.statics.configuration import (
    AppliedLoad,
    Boundary,
    Configuration,
    Geometry,
    Problem,
)
from granphon.statics.explanation import explain, find_typical_force
from granphon.statics.krylov import Map
from granphon.statics.loose_balls import (
    find_way_down,
    go_down,
    has_soft_motions,
    lead_loose_balls,
)
from granphon.statics.newton import Equations, GridEquations, IteratedEquations
from granphon.statics.options import RestOptions
from granphon.statics.response import WELL_HELD

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
    assembly : what is at rest.
    turned_normal : (n_c, d) unit vectors of contacts that have turned; None where they keep the
        directions of the sites.
    residual : the largest force left, as on a ball, over the mean force of contacts.
    steps, iterations : numbers of steps of Newton's method for all, and of iterations in them.
    """

    displacement: Array
    wall_motion: Array
    strain: Array
    overlap: Array
    assembly: Assembly
    turned_normal: Array | None = None
    residual: float = 0.0
    steps: int = 0
    iterations: int = 0

    @property
    def normal(self) -> Array:
        """(n_c, d) unit vectors of the contacts."""
        if self.turned_normal is not None:
            return self.turned_normal
        return self.assembly.normal[:, : self.assembly.dimension]

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
            assembly,
            configuration.normal[:, : assembly.dimension] if problem.turns else None,
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
    InputError : contacts that push, or adhere, cannot bear the load; or the load presses nothing.
    ConvergenceError : the search does not come to rest; ``reached`` is the state that came
        nearest, if there is one.
    InstabilityError : there is no rest in exact directions near that on the lattice.
    MechanismError : balls differ, and some of their motions, while all touch, cost no energy.
    """
    numbers = options or RestOptions()
    problem = Problem(assembly, load, geometry, boundary)
    if not problem.turns and _is_even_grid(problem):
        return _find_rest_on_grid(problem, start, numbers)
    # balls of a grid may be pressed by their cell, under no load
    is_pressed = load.acts or load.is_given or assembly.grid is not None
    if not (is_pressed or find_typical_force(problem)):
        return _rest_without_load(problem)
    if not problem.turns:
        on_lattice = _LatticeSearch(problem, numbers)
        return on_lattice.run(on_lattice.begin(start))
    if start is None:
        # rest in exact directions is farther off than what an array is left with
        rough = numbers.loosen() if assembly.grid else numbers
        start = find_rest(assembly, load, "lattice", boundary, None, rough)
    return _find_rest_of_turning_contacts(problem, start, numbers)


def _find_rest_of_turning_contacts(problem: Problem, start: Rest, options: RestOptions) -> Rest:
    """Return the rest in exact directions that a search from ``start`` finds. Where the search ends
    without rest, as loose balls at the least loads may let it, a way over more load leads round.
    """
    try:
        return _ExactSearch(problem, options).run_from(start)
    except ConvergenceError as error:
        for factor in options.detours:
            heavier = problem.load.scale(factor)
            if heavier is None:
                break
            pressed = Problem(problem.assembly, heavier, "exact", problem.boundary)
            try:
                detour = _ExactSearch(pressed, options).run_from(start)
                return _ExactSearch(problem, options).run_from(detour)
            except ConvergenceError:
                continue
        raise error


def _rest_without_load(problem: Problem) -> Rest:
    """Return bonds where they are; raise :class:`InputError` if there are none."""
    untouched = problem.start_at(np.zeros(problem.size))
    if np.any(untouched.stiffness > 0.0):
        return Rest.of(untouched)
    words = problem.load.words
    raise InputError(f"{words} presses nothing", "Contacts have no stiffness without a force")


def _is_even_grid(problem: Problem) -> bool:
    """Return whether contacts are a grid with one law, Hertz's, that the load presses evenly, so
    that none need be spelled out.
    """
    assembly = problem.assembly
    load = problem.load
    if not (isinstance(assembly, GridAssembly) and isinstance(assembly.law, HertzLaw)):
        return False
    presses = load.stress is None or float(np.trace(load.stress)) < 0.0
    distances = assembly.grid.distance
    is_even = load.mean_force is None or float(np.ptp(distances)) <= ROUNDING * distances[0]
    return presses and is_even and not np.any(load.force)


def _find_rest_on_grid(problem: Problem, start: Rest | None, options: RestOptions) -> Rest:
    """Return the rest of an even grid in the directions of the lattice."""
    from granphon.statics.grid_problem import GridProblem  # averages need no Numba
    from granphon.statics.lattice_rest import LatticeSearch

    on_grid = GridProblem(problem)
    if start is None and on_grid.needs_more_load(options):
        heavier = problem.load.scale(options.detours[-1])
        assert heavier is not None
        loosened = options.loosen()
        start = find_rest(problem.assembly, heavier, "lattice", problem.boundary, None, loosened)
    balls = None
    strains = on_grid.find_strains()
    if start is not None and on_grid.spread:
        unknowns = find_unknowns(problem, start)
        strains = unknowns[problem.n_ball_unknowns :] / on_grid.unit
        balls = on_grid.lay(start.displacement)
    search = LatticeSearch(on_grid, options)
    place = search.run(balls, strains)
    assembly = problem.assembly
    overlap = place.find_overlaps()
    overlap *= on_grid.unit
    closed = float(np.mean(overlap > 0.0))
    residual = place.left / place.force * closed if closed else math.inf
    p = assembly.periods
    strain = np.einsum("s,sab->ab", on_grid.unit * place.strains, problem.unit_strains)
    rest = Rest(
        displacement=on_grid.list_displacements(place.balls),
        wall_motion=np.zeros(0),
        strain=(strain + problem.given_strain)[:p, :p],
        overlap=overlap.ravel(),
        assembly=assembly,
        residual=residual,
        steps=search.steps,
        iterations=search.iterations,
    )
    if place.is_at_rest:
        return rest
    error = explain(problem, opened=place.carries_nothing, residual=rest.residual)
    if isinstance(error, ConvergenceError):
        error.reached = rest
    raise error


def find_unknowns(problem: Problem, rest: Rest) -> Array:
    """Return the unknowns (size,) of a state."""
    p = problem.assembly.periods
    units = problem.unit_strains[:, :p, :p]
    free = rest.strain - problem.load.strain
    strains = np.einsum("sab,ab->s", units, free) / np.einsum("sab,sab->s", units, units)
    return np.concatenate([rest.displacement.ravel(), rest.wall_motion, strains])


class _Trail:
    """The configuration nearest to rest on the way, and the steps since the residual was halved."""

    def __init__(self) -> None:
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


class _Search(ABC):
    """The search for the rest of a problem; what depends on the geometry stands below."""

    def __init__(self, problem: Problem, options: RestOptions) -> None:
        self.problem = problem
        self.options = options
        self.trail = _Trail()
        assembly = problem.assembly
        self.is_factored = assembly.n_balls <= options.most_factorised[assembly.dimension]
        self.tolerance = options.tolerance
        self.steps = 0
        self.iterations = 0

    @cached_property
    def equations(self) -> Equations:
        """Newton's equations, by factors."""
        return Equations(self.problem, self.options)

    @cached_property
    def grid_equations(self) -> GridEquations:
        """Newton's equations of a grid, by iteration."""
        return GridEquations(self.problem, self.options)

    @cached_property
    def iterated_equations(self) -> IteratedEquations:
        """Newton's equations, by iteration."""
        return IteratedEquations(self.problem, self.options)

    def run(self, configuration: Configuration) -> Rest:
        """Return the state at rest near a configuration, or raise the error of a search that does
        not come to rest.
        """
        for _ in range(self.options.steps):
            configuration = self._prepare(configuration)
            if self._is_stuck(configuration):
                break
            self.trail.add(configuration)
            if self._has_arrived:
                configuration_below = self._leave_saddle()
                if configuration_below is None:
                    return self._finish()
                configuration = configuration_below
                self.trail = _Trail()
                continue
            configuration = self._advance(configuration)
        if self.trail.best <= self.options.required:
            return self._finish()
        raise self._explain_failure(configuration)

    @property
    def _has_arrived(self) -> bool:
        """Whether the balls are at rest, or as near as rounding lets them come."""
        trail = self.trail
        comes_no_nearer = trail.best <= self.options.required and trail.stalled > 2
        return trail.best <= self.tolerance or comes_no_nearer

    def _is_stuck(self, configuration: Configuration) -> bool:
        """Return whether the search ends here without rest."""
        return False

    def _prepare(self, configuration: Configuration) -> Configuration:
        """Return the configuration from which the next step begins."""
        return configuration

    @abstractmethod
    def _advance(self, configuration: Configuration) -> Configuration:
        """Return the configuration after a step."""

    def _leave_saddle(self) -> Configuration | None:
        """Return where to go on from a saddle of the energy; None at a minimum."""
        return None

    def _finish(self) -> Rest:
        """Return the state nearest to rest, without the light contacts of balls that differ: their
        force may be a residual only, and their stiffness would hold a ball.
        """
        assembly = self.problem.assembly
        laws = assembly.laws
        assert self.trail.nearest is not None
        rest = Rest.of(self.trail.nearest)
        rest = replace(rest, steps=self.steps, iterations=self.iterations)
        if not assembly.differs or np.any(laws.adhesion):
            return rest
        force = laws.force(rest.overlap)
        light = np.abs(force) <= self.options.carried * rest.residual * laws.size(force)
        light &= np.isfinite(laws.least)  # a bond never opens
        opened = np.minimum(rest.overlap, laws.least)
        return replace(rest, overlap=np.where(light, opened, rest.overlap))

    @abstractmethod
    def _explain_failure(self, configuration: Configuration) -> GranphonError:
        """Return the error of a search that has not come to rest."""


class _LatticeSearch(_Search):
    """The search in the directions of the lattice."""

    def __init__(self, problem: Problem, options: RestOptions) -> None:
        super().__init__(problem, options)
        assembly = problem.assembly
        fewest = options.fewest_iterated[assembly.dimension]
        self.iterates = not self.is_factored or assembly.n_balls >= fewest
        if self.iterates:
            self.tolerance = options.iterated_tolerance
        #: the inverse of the equations of an earlier step, once single balls do not suffice
        self.kept_inverse: Map | None = None
        self.largest_mean = 0.0

    def begin(self, start: Rest | None) -> Configuration:
        """Return the configuration from which the search begins: that of ``start``, of a given
        strain, or of linear springs.
        """
        problem = self.problem
        if start is not None:
            return problem.start_at(find_unknowns(problem, start), start.overlap.copy())
        untouched = problem.start_at(np.zeros(problem.size))
        if problem.load.is_given:
            return untouched
        return self._relax_springs(untouched)

    def _relax_springs(self, untouched: Configuration) -> Configuration:
        """Return where linear springs are at rest that have the force and the stiffness of the
        contacts at a typical force; ``untouched`` is the configuration on the sites.
        """
        problem = self.problem
        laws = problem.assembly.laws
        force = find_typical_force(problem)
        if not force:
            raise explain(problem)
        forces = np.full(problem.assembly.n_contacts, force)
        with np.errstate(all="ignore"):
            reached = laws.overlap(forces)
            while not np.all(np.isfinite(reached)) and forces[0] > 1e-300:
                forces = 0.5 * forces  # a law may have a largest force
                reached = laws.overlap(forces)
        stiffness = laws.stiffness(reached)
        forces = forces + stiffness * (untouched.overlap - reached)
        pull = problem.force + problem.collect_forces(untouched.normal, forces)
        step = self._solve(untouched, stiffness, pull, self.options.reduction)
        return untouched.move(step, untouched.overlap - problem.measure_losses(step))

    def _prepare(self, configuration: Configuration) -> Configuration:
        """Return the configuration; raise :class:`InputError` if all contacts are open."""
        problem = self.problem
        mean = configuration.mean
        self.largest_mean = max(self.largest_mean, mean)
        # under a strain alone balls may move aside until none is pressed
        is_relaxed = mean < self.options.required * self.largest_mean
        if not mean or (is_relaxed and not problem.load.acts):
            raise explain(problem, opened=True)
        return configuration

    def _solve(
        self, configuration: Configuration, stiffness: Array, pull: Array, reduction: float
    ) -> Array:
        """Return the step (size,) of springs of a ``stiffness`` (n_c,), N/m, under forces ``pull``
        (size,); iterations end where these are left to a part, the ``reduction``.

        Iterations are preconditioned by single balls, until these do not suffice, and then by the
        factors of an earlier step.
        """
        equations = self.equations
        options = self.options
        if not self.iterates:
            return equations.solve(configuration, stiffness, pull)
        most = options.most_iterations
        if self.is_factored:
            most = options.patience_of_iterations[self.problem.assembly.dimension]
            if self.kept_inverse is not None:
                most = options.patience_of_factors
        step, has_converged = self.iterated_equations.solve(
            configuration, stiffness, pull, reduction, most, self.kept_inverse
        )
        if has_converged or not self.is_factored:
            return step
        self.kept_inverse = equations.linearise(configuration, stiffness).invert()
        return self.problem.remove_drift(self.kept_inverse(pull))

    def _advance(self, configuration: Configuration) -> Configuration:
        """Return the configuration after a step of Newton's method, of a length at which the slope
        of the energy is small.
        """
        problem = self.problem
        options = self.options
        residual = configuration.residual
        stiffness = configuration.stiffness
        closed = stiffness[stiffness > 0.0]
        # contacts that carry a force and have no stiffness, as where they break, get some
        added = configuration.mean / problem.length
        if closed.size:
            added = options.added * min(1.0, residual) * float(np.mean(closed))
        pull = configuration.pull
        # far from rest a rough solution serves
        reduction = max(0.1 * min(1.0, residual**0.5), options.reduction)
        step = self._solve(configuration, stiffness + added, pull, reduction)
        loss = problem.measure_losses(step)
        length = self._find_length(configuration, loss, float(pull @ step))
        return configuration.move(
            configuration.x + length * step, configuration.overlap - length * loss
        )

    def _find_length(self, configuration: Configuration, loss: Array, fall: float) -> float:
        """Return the length of a step at which the energy no longer falls much.

        ``loss`` (n_c,) is what contacts lose of their overlaps along the whole step, m, and
        ``fall`` how fast the energy falls at its start, J per step.

        Raises the error of a load that cannot be borne if the energy falls without end.
        """
        options = self.options
        laws = self.problem.assembly.laws
        overlap = configuration.overlap
        force = configuration.force
        longest = math.inf
        if laws.adhere:  # no contact may be torn: nine tenths of the way to the first that would
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
            is_near = configuration.residual < options.near and length == 1.0 and slope <= fall
            if abs(slope) <= options.slope * fall or is_near:
                return length
            if slope > 0.0:
                high = length
            elif length >= longest:
                return length
            else:
                low = length
            length = min(4.0 * length, longest) if high == math.inf else 0.5 * (low + high)
        if high == math.inf:
            raise explain(self.problem)
        return length

    def _finish(self) -> Rest:
        """Return the state at rest, in which overlaps that are rounding are zero."""
        rest = super()._finish()
        laws = self.problem.assembly.laws
        if laws.adhere and not np.any(np.isinf(laws.tension)):
            return rest
        size = np.abs(rest.overlap)
        is_rounding = (size <= ROUNDING * np.max(size, initial=0.0)) & (laws.tension == 0.0)
        return replace(rest, overlap=np.where(is_rounding, 0.0, rest.overlap))

    def _explain_failure(self, configuration: Configuration) -> GranphonError:
        """Return the error of a search that has not come to rest."""
        laws = self.problem.assembly.laws
        error = explain(self.problem, residual=self.trail.best)
        if laws.adhere and isinstance(error, ConvergenceError):
            contact = int(np.argmin(configuration.overlap - laws.least))
            tension = laws.tension[contact] + 0.0  # of contacts that only push, no -0
            if not tension and np.any(np.isinf(laws.tension)):
                return self._explain_unloaded(configuration, contact)
            problem = f"{self.problem.load.words} pulls contact {contact} apart"
            why = f"It bears a tension of up to {tension:.6g} N"
            return InputError(problem, why, "Press the crystal more")
        return error

    def _explain_unloaded(self, configuration: Configuration, contact: int) -> InputError:
        """Return the error of a ``contact`` that only pushes, and has no force as springs to the
        ground or bonds bear the load.
        """
        laws = self.problem.assembly.laws
        never_opens = np.isinf(laws.tension)
        stiffness = laws.stiffness(configuration.overlap)
        stiffest_contact = float(np.max(stiffness[~never_opens]))
        words = f"{self.problem.load.words} leaves no force to contact {contact}"
        why = "Springs to the ground or bonds bear the load in its place"
        if stiffest_contact > 0.0:
            ratio = float(np.max(stiffness[never_opens])) / stiffest_contact
            why += f", of up to {ratio:.3g} times the stiffness of the stiffest contact"
        return InputError(words, why, "Take softer ones, fewer balls in a row, or a greater load")


class _ExactSearch(_Search):
    """The search in exact directions, from rest on the lattice."""

    def __init__(self, problem: Problem, options: RestOptions) -> None:
        super().__init__(problem, options)
        assembly = problem.assembly
        if assembly.grid or not self.is_factored:
            self.tolerance = max(options.tolerance, options.iterated_tolerance)
        #: (n,) the balls that are led to rest before all others
        self.loose: Flags = np.zeros(assembly.n_balls, bool)

    def run_from(self, start: Rest) -> Rest:
        """As :meth:`run`, from a state at rest on the lattice or under another load."""
        return self.run(self.begin(start))

    def begin(self, start: Rest) -> Configuration:
        """Return the configuration from which the search begins, that of ``start``. Of balls that
        differ, those with no more contacts that carry load than axes are loose.

        Raises :class:`~granphon.base.errors.MechanismError` if motions of balls that differ cost
        nothing.
        """
        assembly = self.problem.assembly
        configuration = self.problem.start_at(find_unknowns(self.problem, start))
        if not assembly.differs:
            return configuration
        n_strains = len(self.problem.unit_strains)
        is_known = not self.is_factored or n_strains in assembly.standing
        if not is_known and has_soft_motions(self.equations):
            words = self.problem.load.words
            what = f"balls that differ do not come to rest in the true geometry under {words}"
            why = (
                "The crystal does not stand without friction: motions in which no contact is"
                " pressed cost no energy"
            )
            mend = f"{_STAY}; or take a crystal with more contacts, such as fcc"
            raise MechanismError(what, why, mend)
        assembly.standing.add(n_strains)
        heavy = configuration.force > self.options.light * configuration.mean
        self.loose = assembly.count_contacts(heavy) <= assembly.dimension
        return configuration

    def _is_stuck(self, configuration: Configuration) -> bool:
        """Return whether the residual no longer falls, or the configuration is not sound."""
        patience = self.options.patience
        if self.problem.assembly.differs:
            patience = 4 * patience
        return self.trail.stalled > patience or not configuration.is_sound

    def _prepare(self, configuration: Configuration) -> Configuration:
        """Return the configuration in which loose balls are at rest between the others: to a part
        of the force that is left on these, or of the spread of radii if that is less.
        """
        options = self.options
        loose = self.loose
        moves_in_turn = np.any(loose) and self.trail.stalled <= options.patience
        if not (moves_in_turn and configuration.is_sound):
            return configuration
        assembly = self.problem.assembly
        spread = float(np.max(np.abs(assembly.offset)) / np.mean(assembly.distance))
        on_others = configuration.force_on_balls[~loose]
        left = float(np.max(on_others, initial=0.0)) / configuration.mean
        finest = min(options.tolerance, max(options.finer * options.tolerance, options.rounding))
        least = max(finest, options.light * min(spread, left))
        return lead_loose_balls(configuration, loose, least, options)

    def _leave_saddle(self) -> Configuration | None:
        """Return where to go on from a saddle of the energy of balls that differ; None at a
        minimum.
        """
        if not self.problem.assembly.differs:
            return None
        assert self.trail.nearest is not None
        configuration = self.trail.nearest
        if self.problem.assembly.grid and self._is_well_held(configuration):
            solution = self.grid_equations.probe(configuration, self._patience_of_grid)
            self.iterations += solution.iterations
            if solution.way_down is not None:
                return go_down(configuration, solution.way_down, self.options)
            if solution.has_arrived or not self.is_factored:
                return None
        if not self.is_factored:
            return None
        return find_way_down(configuration, self.equations)

    def _advance(self, configuration: Configuration) -> Configuration:
        """Return the configuration after a step; of balls that differ, those that are far from rest
        then become loose.
        """
        self.steps += 1
        # whole steps that push loose balls into others may go round in circles
        if self.problem.assembly.grid and self.trail.stalled <= self.options.patience:
            ahead = self._advance_on_grid(configuration)
        else:
            ahead = self._advance_by_energy(configuration)
        if self.problem.assembly.differs:
            options = self.options
            size = options.failed * configuration.residual * ahead.mean
            size = max(size, options.worst * float(np.max(ahead.force_on_balls)))
            shaken = ahead.force_on_balls > size
            if np.mean(shaken) <= options.most_shaken:
                self.loose = self.loose | shaken
        return ahead

    def _advance_by_energy(self, configuration: Configuration) -> Configuration:
        """Return the configuration after a step along which the energy of balls that differ
        falls.
        """
        pull = configuration.pull
        step = self._find_step(configuration)
        ahead = configuration.move(configuration.x + step)
        if not self.problem.assembly.differs:
            return ahead
        # steps up the energy would go round in circles, or back to a saddle: the slopes at both
        # ends tell
        falls = ahead.is_sound and pull @ step > 0.0 and (pull + ahead.pull) @ step >= 0.0
        if not falls:
            ahead = self._search(configuration, self._find_leaning_step(configuration))
        return ahead

    def _advance_on_grid(self, configuration: Configuration) -> Configuration:
        """Return the configuration after a step of an array, which may push loose balls into
        others: these come to rest sooner by themselves than by shorter steps.
        """
        options = self.options
        step = self._find_grid_step(configuration, (1.0, -1.0))
        ahead = configuration.move(configuration.x + step)
        work = float(configuration.pull @ step)
        length = 1.0
        # away from a saddle a step with the other sign is as long as the way so far: go on while
        # the energy falls faster
        while ahead.is_sound and float(ahead.pull @ step) > work and length < options.longest:
            work = float(ahead.pull @ step)
            length *= 2.0
            farther = configuration.move(configuration.x + length * step)
            is_too_far = not farther.is_sound or farther.residual > options.too_far
            if is_too_far or float(farther.pull @ step) < work:
                break
            ahead = farther
        if ahead.is_sound and ahead.residual <= options.too_far:
            return ahead
        # with the true sign, a step along which there is hardly any curvature has no end
        return self._search(configuration, self._find_grid_step(configuration, (-1.0,)))

    def _is_well_held(self, configuration: Configuration) -> bool:
        """Return whether so many contacts are closed that iterations take less time than factors,
        or factors take too much.
        """
        assembly = self.problem.assembly
        closed = int(np.count_nonzero(configuration.stiffness))
        motions = assembly.n_balls * assembly.dimension
        return closed >= WELL_HELD * motions or not self.is_factored

    @property
    def _patience_of_grid(self) -> int:
        """Iterations after which a grid that can be factorised is."""
        options = self.options
        if not self.is_factored:
            return options.most_iterations
        return options.patience_of_grid

    def _find_grid_step(self, configuration: Configuration, turnings: tuple[float, ...]) -> Array:
        """Return a step (size,) of an array, by the first of the signs ``turnings`` of -f/r with
        which the energy has no curvature below zero.
        """
        options = self.options
        residual = configuration.residual
        stiffness = configuration.stiffness
        added = options.added * min(1.0, residual) * float(np.mean(stiffness))
        load_slope = configuration.load_slope
        least = options.margin * self.tolerance / residual
        # where hardly a contact opens or closes, two accurate steps take less time than three
        shy = residual if self._is_well_held(configuration) else math.sqrt(residual)
        reduction = min(options.inexact, max(shy, least))
        for turning in turnings:
            solution = self.grid_equations.solve(
                configuration,
                stiffness + added,
                configuration.pull,
                turning,
                reduction,
                self._patience_of_grid,
                load_slope,
            )
            self.iterations += solution.iterations
            if solution.way_down is not None:
                continue
            if solution.has_arrived or not self.is_factored:
                return solution.step
            break
        return self.equations.solve(
            configuration, stiffness + added, configuration.pull, -1.0, load_slope
        )

    def _find_step(self, configuration: Configuration) -> Array:
        """Return the step (size,) of Newton's method."""
        stiffness = configuration.stiffness
        if not self.is_factored:
            return self._iterate(configuration, stiffness)
        slope = configuration.load_slope
        return self.equations.solve(configuration, stiffness, configuration.pull, load_slope=slope)

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
        options = self.options
        equations = self.iterated_equations
        pull = configuration.pull
        step, _ = equations.solve(
            configuration, stiffness, pull, options.reduction, options.most_iterations
        )
        return step

    def _search(self, configuration: Configuration, step: Array) -> Configuration:
        """Return the configuration along a ``step``, at most a whole one, at which the energy falls
        at most by the part ``options.slope`` of its fall at the start.

        The fall is the work of the forces left along the step, minus the slope of the energy. A
        length at which balls are not sound is too long; if none is sound, the last one is returned.
        """
        options = self.options
        first = float(configuration.pull @ step)
        low = 0.0
        high = 1.0
        length = 1.0
        ahead = configuration
        for _ in range(options.slopes):
            ahead = configuration.move(configuration.x + length * step)
            fall = float(ahead.pull @ step) if ahead.is_sound else -math.inf
            if abs(fall) <= options.slope * abs(first) or (fall > 0.0 and length >= 1.0):
                break
            if fall > 0.0:
                low = length
            else:
                high = length
            length = 0.5 * (low + high)
        return ahead

    def _explain_failure(self, configuration: Configuration) -> GranphonError:
        """Return the error of a search that has not come to rest."""
        words = self.problem.load.words
        if self.problem.assembly.differs:
            what = f"balls that differ have not come to rest in the true geometry under {words}"
            left = f"A force of {self.trail.best:.2g} of the mean is left on a ball"
            error = ConvergenceError(what, left, f"{_STAY}; or press loose balls more")
            error.reached = None if self.trail.nearest is None else self._finish()
            return error
        why = "Its contacts turn away under the load, and nothing holds it"
        mend = "Lower the load, or add contacts"
        return InstabilityError(f"the crystal collapses under {words}", why, mend)
