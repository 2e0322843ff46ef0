"""How the state of a crystal follows the constants of its balls and its load, to first order.

A course maps a relative step of a parameter to the state that has changed with it. Under a given
mean force or overlap the pressure is one more unknown, which the mean over the contacts determines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from granphon.balls.loads import Load
from granphon.base.arrays import Flags
from granphon.base.differences import Course, differentiate
from granphon.media.crystal import Crystal, CrystalState
from granphon.media.mean_force import MeanContacts
from granphon.statics.configuration import AppliedLoad, Configuration, Geometry, Problem
from granphon.statics.options import CourseOptions
from granphon.statics.rest import Rest, find_unknowns
from granphon.statics.rest_courses import (
    PressureFollower,
    RestCourse,
    RestFollower,
    find_pressure,
)

#: loads that are means over the contacts
_MEANS = ("force", "overlap")
#: function of a relative step of a parameter; returns the crystal and its load with the parameter
#: larger by that step
CrystalChange = Callable[[float], tuple[Crystal, Load]]


class CrystalFollower:
    """Finds how the ``state`` of a crystal under a single ``load`` follows parameters.

    If the load is a mean force or overlap, the pressure of the state is found first. The pressure
    then changes with each parameter so that the mean is the given one.
    """

    def __init__(self, state: CrystalState, load: Load) -> None:
        self._load = load
        self._geometry: Geometry = "exact" if state.finite_overlap else "lattice"
        crystal = state.crystal
        rest = _restore(state, self._pose(crystal, load, 0.0))
        self._pressure = 0.0
        if load.kind in _MEANS:
            self._pressure = find_pressure(lambda size: self._pose(crystal, load, size), rest)
        problem = self._pose(crystal, load, self._pressure)
        self._follower = RestFollower(problem, rest)
        self._is_counted = _find_counted_contacts(rest, crystal)
        self._under_mean: PressureFollower | None = None
        if load.kind in _MEANS:
            self._under_mean = PressureFollower(
                self._follower,
                lambda step: self._pose(crystal, load, self._pressure * (1.0 + step)),
                self._measure_mean,
            )

    def follow(self, change: CrystalChange) -> Course[CrystalState]:
        """Return the course of the state with a ``change`` of a parameter."""
        course = self._follow_rest(change)

        def find_state(step: float) -> CrystalState:
            """Return the state with the parameter larger by a relative ``step``."""
            crystal, _ = change(step)
            configuration = course.place(step)
            solution = Rest.of(configuration), configuration.problem.load
            return crystal._stack(np.zeros(()), [solution], 0, self._geometry == "exact")

        return Course(find_state, course.step)

    def _follow_rest(self, change: CrystalChange) -> RestCourse:
        """Return the course of the balls at rest with a ``change`` of a parameter."""

        def pose(step: float, step_of_pressure: float = 0.0) -> Problem:
            """Return the problem with parameter and pressure larger by these relative steps."""
            return self._pose(*change(step), self._pressure * (1.0 + step_of_pressure))

        if self._under_mean is None:
            return self._follower.follow(pose)
        # how fast the given mean itself grows with the parameter; zero unless the load changes
        growth = differentiate(lambda step: float(change(step)[1].array), CourseOptions().step)
        return self._under_mean.follow(pose, growth)

    def _measure_mean(self, configuration: Configuration) -> float:
        """Return the mean that the load gives, force, N, or overlap, m, of a configuration."""
        forces_or_overlaps = getattr(configuration, self._load.kind)
        return float(np.mean(forces_or_overlaps[self._is_counted]))

    def _pose(self, crystal: Crystal, load: Load, pressure: float) -> Problem:
        """Return the problem of a crystal at rest under a load. ``pressure``, N, N/m or Pa, is the
        pressure under which the crystal has a given mean force or overlap; other loads ignore it.
        The cell may shear, as by default under the loads of a crystal.
        """
        applied = _apply(crystal, load, pressure)
        return Problem(crystal._assembly, applied, self._geometry, "stress")


def _apply(crystal: Crystal, load: Load, pressure: float) -> AppliedLoad:
    """Return the forces, stress and strain of a load on a crystal. A load that is a mean force or
    overlap acts as the ``pressure``, N, N/m or Pa; other loads ignore ``pressure``.
    """
    acceleration = load.gravity * crystal.downward if load.gravity else None
    words = str(load)
    value = float(load.array)
    if load.tensor is None:
        value = pressure if load.kind in _MEANS else value
        return crystal._load_hydrostatic(value, acceleration, words)
    components = value * np.array(load.tensor)
    if load.kind == "stress":
        stress = crystal._read_tensor(load.kind, components, 1.0)
        return crystal._load(words, acceleration, stress=stress)
    strain = crystal._read_tensor(load.kind, components, 0.5)
    return crystal._load(words, acceleration, strain=strain)


def _restore(state: CrystalState, problem: Problem) -> Rest:
    """Return the balls at rest of a state, as the solution of a problem. The overlaps of contacts
    are those of the state, and those of springs to the ground, which a state does not hold, follow
    from the displacements of the balls.
    """
    crystal = state.crystal
    # the offsets are no overlaps at rest: they only fill the field until the overlaps are known
    rest = Rest(
        displacement=state.displacements[crystal._bodies.ball_number >= 0],
        wall_motion=state.ways,
        strain=state.strain,
        overlap=problem.assembly.offset,
        assembly=problem.assembly,
    )
    overlap = problem.start_at(find_unknowns(problem, rest)).overlap.copy()
    overlap[: crystal.n_contacts] = state.overlap
    return replace(rest, overlap=overlap)


def _find_counted_contacts(rest: Rest, crystal: Crystal) -> Flags:
    """Return (n_c + n_s,) whether each of the n_c contacts counts in the mean force and overlap.
    The n_s springs to the ground, which come last, do not.
    """
    is_counted = np.zeros(len(rest.overlap), bool)
    contacts = MeanContacts.of(rest, crystal._laws, rest.assembly.has_offsets)
    is_counted[: crystal.n_contacts] = contacts.is_counted
    return is_counted
