"""The way to rest of contacts that turn with their balls.

The way begins at rest on the lattice, and the tangent has the term -f/r of turning contacts. Where
radii differ, contacts open, and balls that they held lean on others. These loose balls are brought
to rest first, while the others are held (:mod:`granphon.statics.loose_balls`). Newton's method for
all follows, and so on in turn. A step that would raise the energy is replaced by one downhill, and
where neither the loose balls nor the others let each other come to rest, all move together. The
inertia of the factors then proves that rest is a minimum; from a saddle the balls go downhill along
the softest motion. Of a list that is a grid, iterations with Green's function find the steps, and
where most contacts are closed conjugate gradients under random forces take the place of the
inertia.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from granphon.base.arrays import Array, Flags
from granphon.base.errors import ConvergenceError, GranphonError, InstabilityError, MechanismError
from granphon.contacts.assembly import ROUNDING
from granphon.statics.configuration import Configuration, Problem
from granphon.statics.descent import Trail
from granphon.statics.krylov import Map
from granphon.statics.list_descent import ListDescent
from granphon.statics.loose_balls import (
    find_way_down,
    go_down,
    has_soft_motions,
    lead_loose_balls,
)
from granphon.statics.newton import (
    GridEquations,
    find_mean_row,
    find_strongest_push,
    has_hardly_changed,
)
from granphon.statics.options import RestOptions
from granphon.statics.rest import Rest, find_unknowns

#: what mends a crystal, or a simulated array, of differing balls that falls
_STAY = (
    "Leave finite_overlap out, or in a simulation take geometry: lattice: contacts then keep the"
    " directions of the sites"
)


class TurningWay:
    """The configurations along a ``step`` (size,) of contacts that turn, at most a whole step; a
    :class:`~granphon.statics.line_search.Way` along which the energy falls by ``fall``, J per
    length, at the ``start``.

    A length at which the configuration is not possible is too long.
    """

    longest = 1.0

    def __init__(self, start: Configuration, step: Array) -> None:
        self._start = start
        self._step = step
        self.fall = float(start.pull @ step)

    def go(self, length: float) -> Configuration:
        """Return the configuration at a length."""
        return self._start.move(self._start.x + length * self._step)

    def find_slope(self, place: Configuration) -> float:
        """Return the derivative, J, by the length of the energy less the work of the load;
        infinite where the configuration ``place`` is not possible.
        """
        return -float(place.pull @ self._step) if place.is_sound else math.inf

    def find_rise(self, place: Configuration) -> float:
        """Return zero, which stands for a derivative that is not known: of contacts that turn the
        derivative of the slope takes more time than it saves.
        """
        return 0.0


class Factored(NamedTuple):
    """The factors of the tangent at a configuration near rest that is a minimum.

    Attributes
    ----------
    stiffness : (n_c,) of the contacts, N/m.
    residual : that of the last configuration from which a step has been found with the factors.
    invert : from forces (size,), N, to the step (size,), m, that takes them away.
    """

    stiffness: Array
    residual: float
    invert: Map


class TurningDescent(ListDescent):
    """The way to rest in exact directions, from rest on the lattice.

    Attributes
    ----------
    loose : (n,) which balls are led to rest before all others.
    """

    def __init__(self, problem: Problem, options: RestOptions) -> None:
        assembly = problem.assembly
        super().__init__(problem, options, bool(assembly.grid))
        self.loose: Flags = np.zeros(assembly.n_balls, bool)
        #: whether loose balls and all balls together move in turn
        self._move_in_turn = True
        #: residual below which loose balls and all balls together move in turn again, after they
        #: have not
        self._residual_of_turns = options.near_residual
        #: part of the contacts that are closed at the start, where tolerances are over the mean
        #: force of all contacts; otherwise 1
        self._closed_part = 1.0
        #: whether the last step has led down the energy, by more than rounding
        self._has_fallen = False
        #: the factors of an array near rest; None before
        self._factored: Factored | None = None

    @cached_property
    def grid_equations(self) -> GridEquations:
        """Newton's equations of a grid, by iteration."""
        return GridEquations(self.problem, self.options)

    def begin(self, start: Rest | None) -> Configuration:
        """Return the configuration from which the way begins, that of ``start``, and set
        :attr:`loose`. Contacts are heavy if their force is above the part ``options.light_force``
        of the size of forces. Of balls that differ, those with no more heavy contacts than axes are
        loose.

        With ``options.of_all``, tolerances over the mean force of all contacts are lowered to those
        over the mean force of closed ones. Where balls differ and matrices can be factorised,
        whether the crystal stands without friction is tested; that it does is remembered by the
        assembly, which is not tested again with as many free strains. Raises
        :class:`~granphon.base.errors.MechanismError` if motions of balls that differ cost nothing.
        """
        assembly = self.problem.assembly
        assert start is not None
        configuration = self.problem.start_at(find_unknowns(self.problem, start))
        if self.options.of_all:
            self._closed_part = float(np.mean(configuration.force > 0.0))
            self.tolerance *= self._closed_part
            self.required *= self._closed_part
        if not assembly.has_offsets:
            return configuration
        n_strains = len(self.problem.unit_strains)
        if self.is_factored and n_strains not in assembly.standing:
            if has_soft_motions(self.equations):
                raise self._explain_mechanism()
            assembly.standing.add(n_strains)
        is_heavy = configuration.force > self.options.light_force * configuration.force_size
        self.loose = assembly.count_contacts(is_heavy) <= assembly.dimension
        return configuration

    def _explain_mechanism(self) -> MechanismError:
        """Return the error of balls that differ, some of whose motions cost no energy."""
        words = self.problem.load.words
        what = f"balls that differ do not come to rest in the true geometry under {words}"
        why = (
            "The crystal does not stand without friction: motions in which no contact is pressed"
            " cost no energy"
        )
        mend = f"{_STAY}; or take a crystal with more contacts, such as fcc"
        return MechanismError(what, why, mend)

    def _is_stuck(self, place: Configuration) -> bool:
        """Return whether neither the residual falls any longer nor the energy, or the configuration
        is not possible.

        Balls that lean on ever more others go down their energy for long, contact after contact,
        with forces left that are as large as before.
        """
        options = self.options
        has_stalled = self.trail.n_stalled > options.patience and not self._has_fallen
        return has_stalled or not place.is_sound

    def _prepare(self, place: Configuration) -> Configuration:
        """Return the configuration in which loose balls have come to rest between the others;
        ``place`` itself if loose balls do not move in turn, see :meth:`_take_turns`, if there are
        none, or if the configuration is not possible.

        A force may be left on loose balls, over the size of the forces of contacts. It is the part
        ``options.loose_force`` of the smaller of two numbers: the force left on the other balls,
        over that size, and the largest offset of contacts over the mean distance of balls. It is
        not less than rest asks of loose balls.
        """
        options = self.options
        loose = self.loose
        assembly = self.problem.assembly
        if assembly.has_offsets:
            self._take_turns(place)
        if not (self._move_in_turn and np.any(loose) and place.is_sound):
            return place
        spread = float(np.max(np.abs(assembly.offset)) / np.mean(assembly.distance))
        on_others = place.force_on_balls[~loose]
        left = float(np.max(on_others, initial=0.0)) / place.force_size
        at_rest = self._closed_part * options.tolerance
        least = min(at_rest, max(options.loose_force * at_rest, options.loose_rounding))
        tolerance = max(least, options.loose_force * min(spread, left))
        return lead_loose_balls(place, loose, tolerance, options)

    def _take_turns(self, place: Configuration) -> None:
        """Decide anew whether loose balls and all balls together move in turn: no longer where
        moves in turn throw balls about, so that the residual does not fall, but again near rest,
        where loose balls may have a long way from a saddle.

        A change begins a new trail: a small residual of the moves before may have been met far from
        rest, and is not to be compared with.
        """
        if self._move_in_turn:
            is_to_change = self.trail.n_stalled > self.options.patience_of_turns
            if is_to_change:
                # in turn again only nearer to rest than moves in turn have led
                nearer_residual = self.trail.nearer_residual
                self._residual_of_turns = min(self._residual_of_turns, nearer_residual)
        else:
            is_to_change = place.residual <= self._residual_of_turns
        if is_to_change:
            self._move_in_turn = not self._move_in_turn
            self.trail = Trail()

    def _leave_saddle(self, place: Configuration) -> Configuration | None:
        """Return a configuration of less energy if ``place``, which is at rest, is a saddle; None
        at a minimum, and for balls that do not differ.

        Of a grid that is well held iterations probe the curvature. Elsewhere, and where iterations
        do not arrive, factors tell, those of the last step if the stiffnesses have hardly changed
        since. Balls that are too many for factors count as at a minimum where iterations do not
        tell otherwise.
        """
        if not self.problem.assembly.has_offsets:
            return None
        if self.problem.assembly.grid and self._is_well_held(place):
            solution = self.grid_equations.probe(place, self._most_iterations)
            self.iterations += solution.iterations
            if solution.way_down is not None:
                return go_down(place, solution.way_down, self.options)
            if solution.has_arrived or not self.is_factored:
                return None
        if not self.is_factored:
            return None
        factored = self._factored
        if factored and has_hardly_changed(place, factored.stiffness, self.options):
            return None
        return find_way_down(place, self.equations)

    def _advance(self, place: Configuration) -> Configuration:
        """Return the configuration after a step of all balls. Of balls that differ, those on which
        the step leaves much force then become :attr:`loose` as well, unless they are many.
        """
        self._has_fallen = False
        # whole steps that push loose balls into others may go round in circles if loose balls do
        # not move in turn
        if self.problem.assembly.grid and self._move_in_turn:
            ahead = self._advance_on_grid(place)
        else:
            ahead = self._advance_by_energy(place)
        if self.problem.assembly.has_offsets:
            options = self.options
            left_before = options.loosening_force * place.residual * ahead.force_size
            largest = float(np.max(ahead.force_on_balls, initial=0.0))
            is_shaken = ahead.force_on_balls > max(left_before, options.shaken_force * largest)
            if np.count_nonzero(is_shaken) <= options.shaken_part * len(is_shaken):
                self.loose = self.loose | is_shaken
        return ahead

    def _advance_by_energy(self, configuration: Configuration) -> Configuration:
        """Return the configuration after a whole step of Newton's method. If the energy of balls
        that differ does not fall along that step, a step of :meth:`_find_leaning_step` takes its
        place, whose length is searched for. Of balls that differ, sets whether the energy
        ``_has_fallen`` by more than rounding.
        """
        pull = configuration.pull
        step = self._find_step(configuration)
        ahead = configuration.move(configuration.x + step)
        if not self.problem.assembly.has_offsets:
            return ahead
        # steps up the energy would go round in circles, or back to a saddle: the slopes at both
        # ends tell
        is_downhill = ahead.is_sound and pull @ step > 0.0 and (pull + ahead.pull) @ step >= 0.0
        if not is_downhill:
            ahead = self._go_along(configuration, self._find_leaning_step(configuration))
        work = 0.5 * float((pull + ahead.pull) @ (ahead.x - configuration.x))
        stored = float(np.abs(configuration.force) @ np.abs(configuration.overlap))
        self._has_fallen = work > ROUNDING * stored
        return ahead

    def _go_along(self, configuration: Configuration, step: Array) -> Configuration:
        """Return the configuration along a ``step`` (size,), at most its end, at which the energy
        hardly falls any more.
        """
        ahead, _ = self._follow(TurningWay(configuration, step))
        return ahead

    def _advance_on_grid(self, configuration: Configuration) -> Configuration:
        """Return the configuration after a step of an array, which need not lower the energy.

        A step may push loose balls into others: these balls come to rest sooner by themselves than
        by shorter steps. A step that leads too far from rest is replaced by a step down the energy.
        """
        step = self._find_last_step(configuration)
        if step is None:
            step = self._find_grid_step(configuration, (1.0, -1.0))
        ahead = self._go_on(configuration, step)
        if self._is_within_reach(ahead):
            return ahead
        # with the other sign of -f/r alone: with the true sign, a step along which there is hardly
        # any curvature has no end
        return self._go_along(configuration, self._find_grid_step(configuration, (-1.0,)))

    def _go_on(self, configuration: Configuration, step: Array) -> Configuration:
        """Return the configuration at the end of a ``step`` (size,), or beyond it: the length is
        doubled, up to ``options.longest_step``, while the energy falls faster than at the length
        before and the configuration is within reach.

        Away from a saddle, where -f/r has the other sign, a step is only as long as the way so far.
        """
        ahead = configuration.move(configuration.x + step)
        fall = float(configuration.pull @ step)
        length = 1.0
        longest = self.options.longest_step
        while ahead.is_sound and float(ahead.pull @ step) > fall and length < longest:
            fall = float(ahead.pull @ step)
            length *= 2.0
            farther = configuration.move(configuration.x + length * step)
            if not self._is_within_reach(farther) or float(farther.pull @ step) < fall:
                break
            ahead = farther
        return ahead

    def _is_within_reach(self, configuration: Configuration) -> bool:
        """Return whether a configuration is possible, and no farther from rest than a step may
        lead.
        """
        return configuration.is_sound and (configuration.residual <= self.options.farthest_residual)

    def _find_last_step(self, configuration: Configuration) -> Array | None:
        """Return the step (size,) of Newton's method of an array by factors, where the array is
        near rest and factors are to tell whether that is a minimum; None elsewhere, and where the
        curvature of the energy is below zero.

        The factors are kept. Further steps take the factors as long as the stiffnesses hardly
        change and each step leaves at most the part ``options.largest_error`` of the residual. Only
        factors without an eigenvalue below zero are kept, on which :meth:`_leave_saddle` relies.
        """
        options = self.options
        residual = configuration.residual
        if residual > options.near_residual or self._is_well_held(configuration):
            return None
        factored = self._factored
        if (
            factored is None
            or residual > options.largest_error * factored.residual
            or not has_hardly_changed(configuration, factored.stiffness, options)
        ):
            stiffness = configuration.stiffness
            linear = self.equations.linearise(configuration, stiffness)
            # with weak springs a curvature below zero that is rounding does not count
            springs = options.curvature * find_strongest_push(configuration)
            factors = linear.factorise(springs)
            self._factored = None
            if factors.n_below:
                return None
            mean_row = find_mean_row(configuration, stiffness)
            invert = linear.invert(configuration.load_slope, mean_row, factors)
            factored = Factored(stiffness, residual, invert)
        self._factored = factored._replace(residual=residual)
        return self.problem.remove_drift(factored.invert(configuration.pull))

    def _is_well_held(self, configuration: Configuration) -> bool:
        """Return whether iterations are to be preferred to factors: so many contacts are closed
        that iterations take less time, or there are too many balls for factors.
        """
        assembly = self.problem.assembly
        n_closed = int(np.count_nonzero(configuration.stiffness))
        n_motions = assembly.n_balls * assembly.dimension
        return n_closed >= self.options.grid.rigidity * n_motions or not self.is_factored

    @property
    def _most_iterations(self) -> int:
        """Number of iterations, at most, for a step of a grid; then factors find the step, unless
        there are too many balls for factors.
        """
        options = self.options
        if not self.is_factored:
            return options.most_iterations
        return options.grid.patience

    def _find_grid_step(self, configuration: Configuration, turnings: tuple[float, ...]) -> Array:
        """Return a step (size,) of an array by iterations, with -f/r times the first of
        ``turnings`` with which iterations meet no curvature below zero. If they do with each, or do
        not arrive, factors find the step, with -f/r times -1; of too many balls for factors, the
        step is that of the iterations that do not arrive.
        """
        options = self.options
        residual = configuration.residual
        stiffness = configuration.stiffness
        part = options.added_stiffness * min(1.0, residual)
        stiffness = stiffness + part * float(np.mean(stiffness))
        load_slope = configuration.load_slope
        least = options.grid.margin * self.tolerance / residual
        # where hardly a contact opens or closes, two accurate steps take less time than three rough
        # ones
        error = residual if self._is_well_held(configuration) else math.sqrt(residual)
        reduction = min(options.largest_error, max(error, least))
        for turning in turnings:
            solution = self.grid_equations.solve(
                configuration,
                stiffness,
                configuration.pull,
                turning,
                reduction,
                self._most_iterations,
                load_slope,
            )
            self.iterations += solution.iterations
            if solution.way_down is not None:
                continue
            if solution.has_arrived or not self.is_factored:
                return solution.step
            break
        return self.equations.solve(configuration, stiffness, configuration.pull, -1.0, load_slope)

    def _find_step(self, configuration: Configuration) -> Array:
        """Return the step (size,) of Newton's method, by factors; for too many balls for factors, a
        step by iterations, which leave out f/r and the changes of the load's forces.
        """
        stiffness = configuration.stiffness
        if not self.is_factored:
            return self._find_iterated_step(configuration, stiffness)
        return self.equations.solve(
            configuration, stiffness, configuration.pull, load_slope=configuration.load_slope
        )

    def _find_leaning_step(self, configuration: Configuration) -> Array:
        """Return a step (size,) of a tangent in which forces push balls back instead of aside, with
        f/r in place of -f/r, and with a small stiffness added to all contacts: a step is then about
        as long as a ball is far from the line between two others. Iterations, for too many balls
        for factors, leave f/r out.
        """
        stiffness = configuration.stiffness
        part = self.options.added_stiffness * min(1.0, configuration.residual)
        stiffness = stiffness + part * float(np.mean(stiffness))
        if not self.is_factored:
            return self._find_iterated_step(configuration, stiffness)
        return self.equations.solve(configuration, stiffness, configuration.pull, -1.0)

    def _find_iterated_step(self, configuration: Configuration, stiffness: Array) -> Array:
        """Return a step (size,) for contacts of a ``stiffness`` (n_c,), N/m, without -f/r, by
        iterations, as far as ``options.most_iterations`` lead.
        """
        options = self.options
        equations = self.iterated_equations
        pull = configuration.pull
        step, _ = equations.solve(
            configuration, stiffness, pull, options.reduction, options.most_iterations
        )
        return step

    def _explain_failure(self, place: Configuration) -> GranphonError:
        """Return the error of a way that has not led to rest. Of balls that differ, it is a
        ConvergenceError whose ``reached`` is the nearest state, or None if there is none; of
        others, an InstabilityError.
        """
        words = self.problem.load.words
        if self.problem.assembly.has_offsets:
            if place.force_size == 0.0:
                what = f"balls that differ have lost all contact under {words}"
                return ConvergenceError(what, mend=f"{_STAY}; or press the balls more")
            what = f"balls that differ have not come to rest in the true geometry under {words}"
            # the trail has no place where it has just begun anew
            best = min(self.trail.least_residual, place.residual)
            left = ""
            if math.isfinite(best):
                left = f"A force of {best:.2g} of the mean is left on a ball"
            error = ConvergenceError(what, left, f"{_STAY}; or press loose balls more")
            has_place = self.trail.kept_place is not None
            error.reached = self._finish(self._kept_place) if has_place else None
            return error
        why = "Its contacts turn away under the load, and nothing holds it"
        mend = "Lower the load, or add contacts"
        return InstabilityError(f"the crystal collapses under {words}", why, mend)
