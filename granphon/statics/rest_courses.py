"""How a rest follows what it depends on: constants of balls, diameters, the load.

At rest the forces left on the unknowns vanish, R(x, p) = 0, whatever a parameter p is. So x has the
derivative

    dx/dp  =  A^-1 dR/dp

with the tangent A at rest (the implicit function theorem): one solution with the factors at rest
for each parameter, and no search for another rest. dR/dp is a difference of the forces left at
unknowns that stay, in which nothing is solved. What a solution leaves of dR/dp is solved for again
(iterative refinement), so that the derivative does not depend on the accuracy of the equations.

A contact that is open at rest stays open. Steps of differences are short against the overlap of
each contact over its derivative: where a contact is about to open, its stiffness goes as the root
of the overlap.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from granphon.base.arrays import Array
from granphon.base.differences import differentiate
from granphon.base.errors import ConvergenceError
from granphon.statics.configuration import Configuration, Problem
from granphon.statics.krylov import Map
from granphon.statics.newton import Equations, GridEquations, IteratedEquations, find_mean_row
from granphon.statics.options import CourseOptions, ResponseOptions, RestOptions
from granphon.statics.rest import Rest, find_unknowns

#: function that returns the problem of a rest whose parameter is larger by a relative step
Change = Callable[[float], Problem]


@dataclass(frozen=True, eq=False, repr=False)
class RestCourse:
    """A rest that follows a parameter, to first order.

    Attributes
    ----------
    follower : the follower of the rest.
    change : function that returns the problem at a relative step of the parameter.
    slope : (size,) derivative of the unknowns by the step, m.
    """

    follower: RestFollower
    change: Change
    slope: Array

    def place(self, step: float) -> Configuration:
        """Return the configuration at a relative ``step`` of the parameter."""
        return self.follower.place(self.change(step), step * self.slope)

    @cached_property
    def step(self) -> float:
        """The relative step of differences along the course: ``numbers.step``, or less where a
        closed contact would otherwise come too near to its opening. Such a contact may lose or gain
        the part ``numbers.overlap_change`` of the overlap that it has beyond that at which it
        opens. The step is at least ``numbers.least_step``.
        """
        numbers = self.follower.numbers
        trial = numbers.least_step
        slope = (self.place(trial).overlap - self.place(-trial).overlap) / (2.0 * trial)
        rest = self.follower.configuration
        laws = rest.problem.assembly.laws
        room = np.where(np.isfinite(laws.least), rest.overlap - laws.least, math.inf)
        changes = self.follower.is_closed & (slope != 0.0)
        shortest = np.min(np.abs(room[changes] / slope[changes]), initial=math.inf)
        return min(numbers.step, max(numbers.least_step, numbers.overlap_change * float(shortest)))


class RestFollower:
    """Finds how a rest follows parameters.

    Parameters
    ----------
    problem : the balls under their load.
    rest : the rest of the balls under that load.

    Attributes
    ----------
    problem : that which is given.
    numbers : the options of courses.
    configuration : the configuration at rest, with the overlaps of the rest.
    is_closed : (n_c,) whether each contact carries load, or resists one.
    """

    def __init__(self, problem: Problem, rest: Rest) -> None:
        self.problem = problem
        self.numbers = CourseOptions()
        self._rest = rest
        unknowns = find_unknowns(problem, rest)
        #: (n_c,) overlaps that follow from the unknowns at rest, m
        self._measured = problem.start_at(unknowns).overlap
        self.configuration = problem.start_at(unknowns, rest.overlap)
        self.is_closed = (self.configuration.stiffness != 0.0) | (self.configuration.force != 0.0)

    def place(self, problem: Problem, change: Array) -> Configuration:
        """Return the configuration of a changed ``problem``, whose unknowns differ from those at
        rest by the ``change`` (size,), m. Contacts that are open at rest stay open, but for bonds.
        """
        unknowns = find_unknowns(problem, self._rest) + change
        measured = problem.start_at(unknowns).overlap
        # the overlap at rest has digits that the unknowns do not give
        overlap = self._rest.overlap + (measured - self._measured)
        least = problem.assembly.laws.least
        stays_open = ~self.is_closed & np.isfinite(least)  # a bond never opens
        return problem.start_at(unknowns, np.where(stays_open, np.minimum(overlap, least), overlap))

    def follow(self, change: Change, slope: Array | None = None) -> RestCourse:
        """Return the course of the rest with the parameter of ``change``; ConvergenceError if the
        derivative is not found. The rounds of refinement begin at a ``slope`` (size,), m, that is
        nearly right, or at zero.
        """
        problem = self.problem
        numbers = self.numbers
        course = RestCourse(self, change, np.zeros(problem.size))
        remaining = self._find_remaining(course)
        # size of dR/dp at unknowns that stay, of which rounds leave a small part
        size = float(np.linalg.norm(remaining * problem.weights))
        if slope is not None:
            course = replace(course, slope=slope)
            remaining = self._find_remaining(course)
        rounding = 8.0 * math.ulp(self.configuration.force_size) * math.sqrt(problem.size)
        last_norm = math.inf
        earlier = course
        refinement = ResponseOptions()
        for _ in range(refinement.rounds):
            norm = float(np.linalg.norm(remaining * problem.weights))
            is_small = norm <= max(RestOptions().negligible_force * size, rounding / course.step)
            has_stalled = norm > refinement.stalled_part * last_norm
            if is_small or (has_stalled and norm <= numbers.remainder * size):
                # the last round may have left more than the one before
                return course if norm <= last_norm else earlier
            last_norm = norm
            earlier = course
            course = replace(course, slope=course.slope + self._solve(remaining))
            remaining = self._find_remaining(course)
        raise ConvergenceError(
            f"the derivative of the rest under {problem.load.words} is not found",
            "Balls are held by little more than rounding",
            "Raise the load",
        )

    def _find_remaining(self, course: RestCourse) -> Array:
        """Return the derivative (size,), by the step, of the forces left along a course, N: zero
        along the true course.
        """
        return np.asarray(differentiate(lambda step: course.place(step).pull, course.step))

    @cached_property
    def _solve(self) -> Map:
        """The map from forces (size,), N, to the changes of the unknowns (size,), m, that take the
        forces away, or most of them: by factors, or for too many balls by iterations.
        """
        problem = self.problem
        options = RestOptions()
        configuration = self.configuration
        stiffness = configuration.stiffness
        load_slope = configuration.load_slope
        assembly = problem.assembly
        if assembly.n_balls <= options.most_balls[assembly.dimension]:
            linear = Equations(problem, options).linearise(configuration, stiffness)
            invert = linear.invert(load_slope, find_mean_row(configuration, stiffness))
            return lambda pull: problem.remove_drift(invert(pull))
        # the forces that a round leaves are solved for in the next
        reduction = options.reduction
        most = options.most_iterations
        if assembly.grid:
            on_grid = GridEquations(problem, options)
            turning = 1.0 if problem.turns else 0.0

            def iterate(pull: Array) -> Array:
                """Return the unknowns (size,) that take forces ``pull`` (size,) away."""
                given = (configuration, stiffness, pull, turning, reduction, most, load_slope)
                return on_grid.solve(*given).step

            return iterate
        iterated = IteratedEquations(problem, options)
        return lambda pull: iterated.solve(configuration, stiffness, pull, reduction, most)[0]


class PressureFollower:
    """Finds how a rest follows parameters where the pressure is one more unknown: the pressure is
    such that a measure of the rest, as the mean force of its contacts, is a given number.

    Parameters
    ----------
    follower : the follower of the rest at its pressure.
    pose : function that returns the problem at a relative step of the pressure.
    measure : function that returns the measure of a configuration.
    """

    def __init__(
        self,
        follower: RestFollower,
        pose: Change,
        measure: Callable[[Configuration], float],
    ) -> None:
        self._follower = follower
        self._pose = pose
        self._measure = measure

    def follow(self, change: Callable[[float, float], Problem], growth: float) -> RestCourse:
        """Return the course of the rest with a parameter, along which the derivative of the measure
        by the step is ``growth``. The function ``change`` returns the problem at a step of the
        parameter and a relative step of the pressure.

        The pressure follows linearly: the course is that with the parameter alone plus the course
        with the pressure, in the ratio that gives the measure its growth.
        """
        at_pressure = self._follower.follow(lambda step: change(step, 0.0))
        under_pressure, gain = self._under_pressure
        ratio = (growth - self._find_slope(at_pressure)) / gain
        slope = at_pressure.slope + ratio * under_pressure.slope
        return self._follower.follow(lambda step: change(step, ratio * step), slope)

    @cached_property
    def _under_pressure(self) -> tuple[RestCourse, float]:
        """The course of the rest with its pressure, and the derivative of the measure by the
        relative step of the pressure.
        """
        course = self._follower.follow(self._pose)
        return course, self._find_slope(course)

    def _find_slope(self, course: RestCourse) -> float:
        """Return the derivative of the measure by the step along a course."""
        return float(differentiate(lambda step: self._measure(course.place(step)), course.step))


def find_pressure(pose: Callable[[float], Problem], rest: Rest) -> float:
    """Return the pressure under which ``rest`` is in balance, in the sense of least squares, in the
    unit of the argument of ``pose``. That function returns the problem at a pressure, of which the
    forces of the load are a linear function.
    """
    pulls = []
    for pressure in (0.0, 1.0):
        problem = pose(pressure)
        pulls.append(problem.start_at(find_unknowns(problem, rest), rest.overlap).pull)
    unit = pulls[1] - pulls[0]
    return -float(unit @ pulls[0]) / float(unit @ unit)
