"""The way to rest of a list of contacts, which keep the directions of the lattice.

The problem is convex, as contacts push ever harder: the forces at rest are unique, while balls that
nothing holds may be anywhere. Where contacts have opened, the tangent is short of their stiffness,
and a small stiffness that falls with the residual is added to all contacts.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError, GranphonError, InputError
from granphon.contacts.assembly import ROUNDING
from granphon.statics.configuration import Configuration, Problem
from granphon.statics.descent import Descent
from granphon.statics.explanation import explain, find_typical_force
from granphon.statics.krylov import Map
from granphon.statics.newton import Equations, IteratedEquations
from granphon.statics.options import RestOptions
from granphon.statics.rest import Rest, find_unknowns


class ListDescent(Descent[Configuration]):
    """What the ways of lists to rest have in common: the equations of steps, and the state at rest.

    Attributes
    ----------
    problem : the balls under their load.
    is_factored : whether there are so few balls that matrices can be factorised.
    iterates : whether iterations find the steps: where the caller wants it, and always where
        matrices cannot be factorised. The tolerance is then at least that of iterations.
    """

    def __init__(self, problem: Problem, options: RestOptions, iterates: bool) -> None:
        assembly = problem.assembly
        self.problem = problem
        self.is_factored = assembly.n_balls <= options.most_balls[assembly.dimension]
        self.iterates = iterates or not self.is_factored
        tolerance = options.tolerance
        if self.iterates:
            tolerance = max(tolerance, options.iterated_tolerance)
        super().__init__(options, tolerance, options.negligible_force)

    @cached_property
    def equations(self) -> Equations:
        """Newton's equations, by factors."""
        return Equations(self.problem, self.options)

    @cached_property
    def iterated_equations(self) -> IteratedEquations:
        """Newton's equations, by iteration."""
        return IteratedEquations(self.problem, self.options)

    def _finish(self, place: Configuration) -> Rest:
        """Return the state of a configuration at rest. Where balls differ and no contact adheres,
        light contacts are open in the state: their force may be a residual only, and their
        stiffness would hold a ball that nothing holds.
        """
        assembly = self.problem.assembly
        laws = assembly.laws
        rest = replace(Rest.of(place), steps=self.steps, iterations=self.iterations)
        if not assembly.has_offsets or np.any(laws.adhesion):
            return rest
        force = laws.force(rest.overlap)
        is_light = np.abs(force) <= self.options.open_force * rest.residual * laws.size(force)
        is_light &= np.isfinite(laws.least)  # a bond never opens
        open_overlap = np.minimum(rest.overlap, laws.least)
        return replace(rest, overlap=np.where(is_light, open_overlap, rest.overlap))


class LatticeWay:
    """The configurations along a ``step`` (size,) of contacts that keep their directions, a
    :class:`~granphon.statics.line_search.Way`.

    Attributes
    ----------
    fall : fall of the energy per length at the start, J.
    longest : the greatest length, infinite where no contact would be torn. Otherwise it is the part
        ``options.tear_part`` of the length at which the first contact would be torn, but at least
        :data:`~granphon.contacts.assembly.ROUNDING`. Contacts that bear no tension are not torn,
        and may open on the way, but for those of balls that do not differ, beside springs to the
        ground or bonds.
    """

    def __init__(self, start: Configuration, step: Array, options: RestOptions) -> None:
        self._start = start
        self._step = step
        #: (n_c,) what contacts lose of their overlaps along the whole step, m
        self._loss = start.problem.measure_losses(step)
        self.fall = float(start.pull @ step)
        self.longest = math.inf
        laws = start.problem.assembly.laws
        if laws.can_adhere:
            # those that are open already cannot be torn
            can_tear = (laws.tension > 0.0) & (start.overlap >= laws.least)
            if np.any(np.isinf(laws.tension)) and not start.problem.assembly.has_offsets:
                # springs may leave a contact of equal balls a force that is next to nothing, and
                # rounding once it has opened: no step opens a contact, and the search tells of it
                can_tear[:] = True
            can_tear &= self._loss > 0.0
            lengths_to_tear = (start.overlap - laws.least)[can_tear] / self._loss[can_tear]
            longest = options.tear_part * float(np.min(lengths_to_tear, initial=math.inf))
            # a contact that is about to be torn does not end the search at once
            self.longest = max(longest, ROUNDING)

    def go(self, length: float) -> Configuration:
        """Return the configuration at a length."""
        start = self._start
        return start.move(start.x + length * self._step, start.overlap - length * self._loss)

    def find_slope(self, place: Configuration) -> float:
        """Return the derivative of the energy by the length at a ``place`` of the way, J.

        The slope is infinite where all contacts have opened, so that no step goes there: under a
        load that is small against the forces at the start the energy falls that far.
        """
        before = self._start.force
        if not np.any(place.force) and np.any(before):
            return math.inf
        return float((before - place.force) @ self._loss) - self.fall

    def find_rise(self, place: Configuration) -> float:
        """Return the derivative of the slope by the length at a ``place`` of the way, J."""
        return float((place.stiffness * self._loss) @ self._loss)


class LatticeDescent(ListDescent):
    """The way to rest in the directions of the lattice.

    Attributes
    ----------
    kept_inverse : the inverse of the equations of an earlier step, by factors; None as long as
        iterations that are preconditioned by single balls have ended in time.
    largest_size : largest size of the forces of contacts on the way, N.
    """

    def __init__(self, problem: Problem, options: RestOptions) -> None:
        assembly = problem.assembly
        fewest = options.fewest_balls[assembly.dimension]
        super().__init__(problem, options, assembly.n_balls >= fewest)
        self.kept_inverse: Map | None = None
        self.largest_size = 0.0

    def begin(self, start: Rest | None) -> Configuration:
        """Return the configuration from which the way begins: that of ``start``, if there is one.
        Without a start, it is that of balls on their sites, if a strain is given or the balls press
        each other there without a load, and otherwise that of linear springs at rest, with the
        errors of :meth:`_relax_springs`.
        """
        problem = self.problem
        if start is not None:
            return self._take_up(start)
        on_sites = problem.start_at(np.zeros(problem.size))
        is_pressed_on_sites = not problem.load.acts and on_sites.force_size > 0.0
        if problem.load.has_strain or is_pressed_on_sites:
            return on_sites
        return self._relax_springs(on_sites)

    def _take_up(self, start: Rest) -> Configuration:
        """Return the configuration at the displacements of a ``start``. Its overlaps are those of
        the start, less what a change of the strain takes from them: a given strain may differ from
        that of the start, and a strain that is neither given nor an unknown is left out.
        """
        problem = self.problem
        x = find_unknowns(problem, start)
        p = problem.assembly.periods
        change = problem.find_strain(x) + problem.given_strain
        change[:p, :p] -= start.strain
        overlap = start.overlap.copy()
        # the overlaps of the start have digits that a difference of rounding would spoil
        if np.any(np.abs(change) > ROUNDING * np.max(np.abs(start.strain), initial=0.0)):
            overlap -= problem.measure_losses(np.zeros(problem.size), strain=change)
        return problem.start_at(x, overlap)

    def _relax_springs(self, on_sites: Configuration) -> Configuration:
        """Return the configuration at rest of linear springs in place of the contacts;
        ``on_sites`` is the configuration of balls on their sites.

        The springs have the overlap and the stiffness that contacts have at a typical force. Where
        a law does not reach that force, it is halved until all laws do. Raises the error of
        :func:`~granphon.statics.explanation.explain` under a load that gives no typical force.
        """
        problem = self.problem
        laws = problem.assembly.laws
        force = find_typical_force(problem)
        if not force:
            raise explain(problem, self.options)
        forces = np.full(problem.assembly.n_contacts, force)
        with np.errstate(all="ignore"):
            overlap = laws.overlap(forces)
            # a law may have a largest force; below 1e-300 doubles lose their digits
            while not np.all(np.isfinite(overlap)) and forces[0] > 1e-300:
                forces = 0.5 * forces
                overlap = laws.overlap(forces)
        stiffness = laws.stiffness(overlap)
        # forces of the springs while the balls are on their sites
        forces = forces + stiffness * (on_sites.overlap - overlap)
        pull = problem.force + problem.collect_forces(on_sites.normal, forces)
        step = self._solve(on_sites, stiffness, pull, self.options.reduction)
        return on_sites.move(step, on_sites.overlap - problem.measure_losses(step))

    def _is_stuck(self, place: Configuration) -> bool:
        """Return whether the residual no longer falls."""
        return self.trail.n_stalled > self.options.patience

    def _prepare(self, place: Configuration) -> Configuration:
        """Return the configuration as it is; raise the error of a load under which all contacts
        have opened. Where no load acts and a strain alone presses, raise it already if the contacts
        have lost nearly all of the largest force on the way.
        """
        problem = self.problem
        size = place.force_size
        self.largest_size = max(self.largest_size, size)
        # under a strain alone balls may move aside until none is pressed
        is_relaxed = size < self.options.negligible_force * self.largest_size
        if not size or (is_relaxed and not problem.load.acts):
            raise explain(problem, self.options, is_open=True)
        return place

    def _solve(
        self, configuration: Configuration, stiffness: Array, pull: Array, reduction: float
    ) -> Array:
        """Return the step (size,) of springs of a ``stiffness`` (n_c,), N/m, under forces ``pull``
        (size,), N; iterations end where the part ``reduction`` of the forces is left.

        Iterations are preconditioned by single balls. Where iterations do not end in time, factors
        solve the equations and are kept (:attr:`kept_inverse`), and precondition the iterations of
        later steps, until these too do not end in time. Too many balls for factors are left where
        ``options.most_iterations`` have led.
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

    def _advance(self, place: Configuration) -> Configuration:
        """Return the configuration after a step of Newton's method, of a length at which the slope
        of the energy is small.

        Raises the error of :func:`~granphon.statics.explanation.explain` if the energy still falls
        steeply at the last length that is tried, and that is not the greatest length of the way.
        """
        problem = self.problem
        options = self.options
        residual = place.residual
        stiffness = place.stiffness
        positive = stiffness[stiffness > 0.0]
        # an estimate for contacts that all carry a force without a stiffness, as where they break
        added_stiffness = place.force_size / problem.length
        if positive.size:
            added_stiffness = (
                options.added_stiffness * min(1.0, residual) * float(np.mean(positive))
            )
        # far from rest a rough solution serves
        reduction = max(options.rough_reduction * min(1.0, residual**0.5), options.reduction)
        step = self._solve(place, stiffness + added_stiffness, place.pull, reduction)
        way = LatticeWay(place, step, options)
        # near rest slopes are rounding: no length is better than another
        if way.fall <= 0.0:
            return way.go(min(1.0, way.longest))
        # near rest a step is whole unless its end is steeper than its start
        part = 1.0 if residual < options.rounding_residual else options.slope
        ahead, length = self._follow(way, part)
        if length < way.longest and way.find_slope(ahead) < -part * way.fall:
            raise explain(problem, options)
        return ahead

    def _finish(self, place: Configuration) -> Rest:
        """Return the state at rest, with overlaps of zero where they are rounding. The overlaps of
        contacts that bear tension stay, and all stay where contacts adhere and none is a bond.
        """
        rest = super()._finish(place)
        laws = self.problem.assembly.laws
        if laws.can_adhere and not np.any(np.isinf(laws.tension)):
            return rest
        size = np.abs(rest.overlap)
        is_rounding = (size <= ROUNDING * np.max(size, initial=0.0)) & (laws.tension == 0.0)
        return replace(rest, overlap=np.where(is_rounding, 0.0, rest.overlap))

    def _explain_failure(self, place: Configuration) -> GranphonError:
        """Return the error of a way that has not led to rest at ``place``. Where contacts adhere,
        and no other reason is found, the error names the contact that is nearest to breaking, if
        this contact pulls. It also names this contact if it has no force while there are springs or
        bonds.
        """
        laws = self.problem.assembly.laws
        error = explain(self.problem, self.options, residual=self.trail.least_residual)
        if not (laws.can_adhere and isinstance(error, ConvergenceError)):
            return error
        contact = int(np.argmin(place.overlap - laws.least))
        force = place.force[contact]
        if force < 0.0:
            what = f"the crystal has not come to rest under {self.problem.load.words}"
            why = (
                f"Contact {contact} is the nearest to breaking: it pulls with {-force:.6g} N, and"
                f" bears up to {laws.tension[contact]:.6g} N"
            )
            return ConvergenceError(what, why, "Press the crystal more")
        if force == 0.0 and np.any(np.isinf(laws.tension)):
            return self._explain_unloaded(place, contact)
        return error

    def _explain_unloaded(self, place: Configuration, contact: int) -> InputError:
        """Return the error of a ``contact``, by number, that has no force but rounding at
        ``place``, since springs to the ground or bonds bear the load.
        """
        laws = self.problem.assembly.laws
        never_opens = np.isinf(laws.tension)
        stiffness = laws.stiffness(place.overlap)
        stiffest_contact = float(np.max(stiffness[~never_opens], initial=0.0))
        words = f"{self.problem.load.words} leaves no force to contact {contact}"
        why = "Springs to the ground or bonds bear the load in its place"
        if stiffest_contact > 0.0:
            ratio = float(np.max(stiffness[never_opens])) / stiffest_contact
            why += f", of up to {ratio:.3g} times the stiffness of the stiffest contact"
        return InputError(words, why, "Take softer ones, fewer balls in a row, or a greater load")
