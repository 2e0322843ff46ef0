"""The search for rest under a load, of balls, walls and a cell held by normal forces alone.

Rest is the minimum of the energy of all contacts less the work of the load
(:mod:`granphon.statics.configuration`). One flow leads there (:mod:`granphon.statics.descent`),
with two flags: whether contacts turn, and whether the cell may change its shape. Where an array of
one law is pressed evenly and contacts do not turn, no contact is spelled out. Some ways begin at
another rest, which is found first. Ways in exact directions begin at rest on the lattice. Ways
under the least loads of a grid begin at rest under more load.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from granphon.balls.hertz import HertzLaw
from granphon.base.errors import ConvergenceError, InputError
from granphon.contacts.assembly import ROUNDING, Assembly, GridAssembly
from granphon.statics.configuration import AppliedLoad, Boundary, Geometry, Problem
from granphon.statics.descent import Descent
from granphon.statics.explanation import find_typical_force
from granphon.statics.grid_descent import GridDescent
from granphon.statics.grid_problem import GridProblem
from granphon.statics.list_descent import LatticeDescent
from granphon.statics.options import RestOptions
from granphon.statics.rest import Rest, find_unknowns
from granphon.statics.turning_descent import TurningDescent


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
        takes the pressure of the load. It does not matter where a strain, or a mean force of
        contacts, is given.
    start : a state near by, which is not used in the directions of the lattice where the balls of
        an even grid, of Hertz's law and pressed evenly, do not differ. By default the search starts
        from linear springs or from the sites, and in exact directions from rest on the lattice,
        which is then found first; steps on the way there count too.
    options : the numbers of the search; the defaults of :class:`RestOptions` if None.

    Raises
    ------
    InputError : contacts cannot bear the load, or are open under it; the load presses nothing; a
        contact law does not reach the forces; or stiffnesses or forces differ by more than rounding
        allows.
    ConvergenceError : the search does not come to rest. Its ``reached`` is the last state of a
        search on an even grid in the directions of the lattice. In exact directions it is the
        nearest state of balls that differ, or None if there is none. In all other searches it is
        None.
    InstabilityError : balls that do not differ have no rest in exact directions near that on the
        lattice.
    MechanismError : balls differ in exact directions, and some of their motions cost no energy even
        where all contacts are closed.
    """
    numbers = options or RestOptions()
    problem = Problem(assembly, load, geometry, boundary)
    # balls that differ, and those of a grid, may be pressed by their cell, under no load
    is_filled = assembly.has_offsets or assembly.grid is not None
    is_pressed = load.acts or load.has_strain or is_filled
    if not (is_pressed or find_typical_force(problem)):
        return _find_rest_without_load(problem)
    descent = _choose_descent(problem, numbers)
    if start is not None:
        return _descend(problem, descent, start, numbers)
    first_rest = _find_start(problem, descent, numbers)
    rest = _descend(problem, descent, first_rest, numbers)
    if first_rest is None:
        return rest
    return replace(
        rest,
        steps=rest.steps + first_rest.steps,
        iterations=rest.iterations + first_rest.iterations,
    )


def _descend(
    problem: Problem, descent: Descent[Any], start: Rest | None, options: RestOptions
) -> Rest:
    """Return the rest to which a ``descent`` leads from a ``start``. If the descent does not lead
    to rest in exact directions, the rest is that of a detour (:func:`_make_detour`).

    Raises the ConvergenceError of the descent if there is no detour, or none leads to rest.
    """
    try:
        return descent.run(start)
    except ConvergenceError:
        if not problem.turns or start is None:
            raise
        rest = _make_detour(problem, start, options)
        if rest is None:
            raise
        return rest


def _find_start(problem: Problem, descent: Descent[Any], options: RestOptions) -> Rest | None:
    """Return the rest at which the way of a ``descent`` begins, which is found here; None where the
    way begins at no other rest.

    In exact directions this is the rest on the lattice. Where a descent needs more load, this is
    the rest under the load times the largest of the ``detours``.
    """
    assembly = problem.assembly
    if problem.turns:
        on_lattice = Problem(assembly, problem.load, "lattice", problem.boundary)
        # a rough rest of an array on the lattice serves: its error is less than its distance from
        # rest in exact directions. Where the places of loose balls depend on it, it must be fine
        is_rough = assembly.grid is not None
        if _is_even_grid(on_lattice):
            is_rough = not GridProblem(on_lattice).needs_fine_start(options)
        numbers = options.loosen() if is_rough else options
        return find_rest(assembly, problem.load, "lattice", problem.boundary, None, numbers)
    if not descent.needs_more_load:
        return None
    heavier = problem.load.scale(options.detours[-1])
    assert heavier is not None  # grids have no forces on balls, and no strain is given here
    return find_rest(assembly, heavier, "lattice", problem.boundary, None, options.loosen())


def _make_detour(problem: Problem, start: Rest, options: RestOptions) -> Rest | None:
    """Return the rest in exact directions that is found from ``start`` by a detour: first to rest
    under more load, by each factor of ``options.detours`` in turn, and from there back to the load
    of the problem. None if no detour leads to rest, or the load cannot be raised. Loose balls at
    low loads may bar the straight way.
    """
    for factor in options.detours:
        heavier = _press_more(problem, start, factor)
        if heavier is None:
            return None
        pressed = Problem(problem.assembly, heavier, "exact", problem.boundary)
        try:
            pressed_rest = TurningDescent(pressed, options).run(start)
            return TurningDescent(problem, options).run(pressed_rest)
        except ConvergenceError:
            continue
    return None


def _press_more(problem: Problem, rest: Rest, factor: float) -> AppliedLoad | None:
    """Return a load about ``factor`` times that of a problem; None if forces act on balls or walls.

    To a given strain a strain is added that presses from all sides. With the added strain, contacts
    whose force is the size of the forces at ``rest`` would have ``factor`` times this force.
    """
    load = problem.load
    assembly = problem.assembly
    if np.any(load.force):
        return None
    if load.stress is not None or load.mean_force is not None:
        return load.scale(factor)
    laws = assembly.laws
    configuration = problem.start_at(find_unknowns(problem, rest))
    forces = np.full(laws.count, configuration.force_size)
    added_overlap = float(np.mean(laws.overlap(factor * forces) - laws.overlap(forces)))
    contraction = added_overlap / assembly.mean_distance * np.eye(assembly.periods)
    return replace(load, strain=load.strain - contraction)


def _choose_descent(problem: Problem, options: RestOptions) -> Descent[Any]:
    """Return the descent that finds the rest of a ``problem``: one for contacts that turn; for
    contacts that do not turn, one for an even grid, and one for all others.
    """
    if problem.turns:
        return TurningDescent(problem, options)
    if not _is_even_grid(problem):
        return LatticeDescent(problem, options)
    return GridDescent(GridProblem(problem), options)


def _find_rest_without_load(problem: Problem) -> Rest:
    """Return the rest of bonds at their sites, which need no load; raise :class:`InputError` if no
    contact has a stiffness there.
    """
    on_sites = problem.start_at(np.zeros(problem.size))
    if np.any(on_sites.stiffness > 0.0):
        return Rest.of(on_sites)
    words = problem.load.words
    raise InputError(f"{words} presses nothing", "Contacts have no stiffness without a force")


def _is_even_grid(problem: Problem) -> bool:
    """Return whether the contacts of a ``problem`` are a grid, all have Hertz's law, and are
    pressed evenly by the load. Then no list of contacts need be made.

    A load presses evenly if no forces act on balls and it is a strain, a stress with a pressure, or
    a mean force of contacts that all have one length.
    """
    assembly = problem.assembly
    load = problem.load
    if not (isinstance(assembly, GridAssembly) and isinstance(assembly.law, HertzLaw)):
        return False
    distances = assembly.grid.distance
    has_one_length = bool(np.ptp(distances) <= ROUNDING * distances[0])
    if np.any(load.force) or (load.mean_force is not None and not has_one_length):
        return False
    return load.stress is None or float(np.trace(load.stress)) < 0.0
