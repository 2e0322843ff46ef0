"""How the equilibrium of an array follows its load and the ratio W/d, to first order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from granphon.array.equilibrium import Equilibrium
from granphon.array.options import ReducedLoad
from granphon.array.rest import apply_load, assemble, gather_balls, take_up
from granphon.array.sheared_equilibrium import split_strain
from granphon.base.differences import Course, differentiate
from granphon.statics.configuration import Boundary, Configuration, Problem
from granphon.statics.options import CourseOptions
from granphon.statics.rest import Rest
from granphon.statics.rest_courses import (
    PressureFollower,
    RestCourse,
    RestFollower,
    find_pressure,
)

#: function of a relative step of a parameter that returns the load in reduced units, and W/d, where
#: the parameter is larger by this step; W/d is zero where contacts keep their directions
ReducedChange = Callable[[float], tuple[ReducedLoad, float]]


class EquilibriumFollower:
    """How an equilibrium without friction follows changes of its load and of W/d, to first order.

    A contact that carries no load stays open.

    Parameters
    ----------
    state : the equilibrium.
    load : the load under which it rests.
    """

    def __init__(self, state: Equilibrium, load: ReducedLoad) -> None:
        self._state = state
        self._load = load
        # a cell that shears is under a pressure or, in the directions of the lattice, has a given
        # size. In true directions a load that is a mean force or an overlap is met by the pressure
        # that makes it, and this pressure is searched for
        self._is_pressed = state.strain is not None
        is_pressure = load.overlap is None and load.on_boundary
        self._is_searched = self._is_pressed and bool(state.ratio) and not is_pressure
        self._stay_open = ~state.carries
        rest = self._restore()
        self._pressure = 0.0  # as f*; it is used only where it is searched for
        if self._is_searched:
            self._pressure = find_pressure(lambda size: self._pose(load, state.ratio, size), rest)
        self._follower = RestFollower(self._pose(load, state.ratio, self._pressure), rest)
        self._under_mean: PressureFollower | None = None
        if self._is_searched:
            self._under_mean = PressureFollower(
                self._follower,
                lambda step: self._pose(load, state.ratio, self._pressure * (1.0 + step)),
                self._measure,
            )

    def follow(self, change: ReducedChange) -> Course[Equilibrium]:
        """Return the course of the equilibrium under a ``change`` (:data:`ReducedChange`): it gives
        the equilibrium at a relative step of the parameter, to first order.
        """
        state = self._state
        course = self._follow_rest(change)

        def find(step: float) -> Equilibrium:
            """Return the equilibrium at a ``step`` of the change."""
            rest = Rest.of(course.place(step))
            ratio = change(step)[1]
            overlap, strain = split_strain(rest.strain, ratio)
            changed_state = replace(
                state,
                overlap=overlap,
                balls=gather_balls(rest, state.stencils),
                ratio=ratio,
                strain=strain if self._is_pressed else None,
            )
            # set behind the frozen class: neither is part of what an equilibrium is made of
            vars(changed_state).update(stencils=state.stencils, _stay_open=self._stay_open)
            return changed_state

        return Course(find, course.step)

    def _follow_rest(self, change: ReducedChange) -> RestCourse:
        """Return the course of the balls at rest under a ``change``. If the pressure is searched
        for, it changes so that the course stays at the load.
        """

        def pose(step: float, step_of_pressure: float = 0.0) -> Problem:
            """Return the problem at a ``step`` of the change, under a pressure that is larger by
            the relative ``step_of_pressure``.
            """
            return self._pose(*change(step), self._pressure * (1.0 + step_of_pressure))

        if self._under_mean is None:
            return self._follower.follow(pose)

        def find_goal(step: float) -> float:
            """Return the mean force or the overlap y that the load prescribes at a ``step``."""
            load, _ = change(step)
            return load.force if load.overlap is None else load.overlap

        return self._under_mean.follow(pose, differentiate(find_goal, CourseOptions().step))

    def _measure(self, configuration: Configuration) -> float:
        """Return the number of a ``configuration`` in the true geometry that the load prescribes:
        the mean force, or the overlap y.
        """
        if self._load.overlap is None:
            return float(np.mean(configuration.force))
        # contacts are as long as d/W, which a change may change
        ratio = 1.0 / configuration.problem.assembly.mean_distance
        return split_strain(configuration.strain, ratio)[0]

    def _pose(self, load: ReducedLoad, ratio: float, pressure: float) -> Problem:
        """Return the problem of the balls at rest at a ``ratio`` W/d under a ``load``. If the
        pressure is searched for, the ``pressure``, as f*, takes the place of the load.
        """
        state = self._state
        scale = ratio or 1.0  # contacts have the length 1/scale, in W
        assembly = assemble(state.deviations, state.stencils, scale)
        if self._is_searched:
            load = ReducedLoad(force=pressure, on_boundary=True)
        elif self._is_pressed:
            load = load._replace(on_boundary=True)
        applied = apply_load(assembly, load, scale, 1.0)
        if self._is_pressed and load.overlap is not None:
            applied = replace(applied, shears=True)
        boundary: Boundary = "stress" if self._is_pressed else "isotropic"
        return Problem(assembly, applied, "exact" if ratio else "lattice", boundary)

    def _restore(self) -> Rest:
        """Return the equilibrium as the result of a search for rest; the overlaps of contacts that
        carry no load are at most zero.
        """
        state = self._state
        scale = state.ratio or 1.0
        assembly = assemble(state.deviations, state.stencils, scale)
        rest = take_up(assembly, state.balls, state.overlap, state.stencils, scale)
        overlap = np.where(self._stay_open, np.minimum(state.overlaps, 0.0), state.overlaps)
        strain = rest.strain if state.strain is None else rest.strain + scale * state.strain
        return replace(rest, strain=strain, overlap=overlap.ravel())
