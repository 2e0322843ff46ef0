"""The search for rest under a load, of balls, walls and a cell held by normal forces alone.

Rest is the minimum of the energy of all contacts less the work of the load
(:mod:`granphon.statics.configuration`). One flow leads there (:mod:`granphon.statics.descent`),
with two flags: whether contacts turn, and whether the cell may change its shape. Where an array of
one law is pressed evenly and contacts do not turn, no contact is spelled out. A way begins at
another rest where that leads round: in exact directions at rest on the lattice, at the least loads
at rest under more.
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
        takes the pressure of the load. Neither matters to a cell whose strain is given.
    start : a state near by. By default the search starts from linear springs, and in exact
        directions from rest on the lattice, which is then found first; steps on the way there count
        too.
    options : the numbers of the search.

    Raises
    ------
    InputError : contacts that push, or adhere, cannot bear the load, or are left open by it; the
        load presses nothing; or stiffnesses or forces differ by more than rounding allows.
    ConvergenceError : the search does not come to rest. ``reached`` is the state at the end of a
        search on a grid in the directions of the lattice, and the nearest one of balls that differ
        in exact directions, if there is one; None of others.
    InstabilityError : there is no rest in exact directions near that on the lattice.
    MechanismError : balls differ, and some of their motions, while all touch, cost no energy.
    """
    numbers = options or RestOptions()
    problem = Problem(assembly, load, geometry, boundary)
    # balls that differ, and those of a grid, may be pressed by their cell, under no load
    is_filled = assembly.differs or assembly.grid is not None
    is_pressed = load.acts or load.is_given or is_filled
    if not (is_pressed or find_typical_force(problem)):
        return _rest_without_load(problem)
    descent = _choose_descent(problem, numbers)
    begin = start or _find_start(problem, descent, numbers)
    try:
        rest = descent.run(begin)
    except ConvergenceError:
        led = _lead_round(problem, begin, numbers) if problem.turns and begin else None
        if led is None:
            raise
        rest = led
    if begin is None or begin is start:
        return rest
    taken = (rest.steps + begin.steps, rest.iterations + begin.iterations)
    return replace(rest, steps=taken[0], iterations=taken[1])


def _find_start(problem: Problem, descent: Descent[Any], options: RestOptions) -> Rest | None:
    """Return the rest at which the way of a ``descent`` begins; None where it begins at the sites.

    In exact directions this is the rest on the lattice, and where a descent needs more load the
    rest under the largest of the ``detours`` times the load. Either is found here.
    """
    assembly = problem.assembly
    if problem.turns:
        on_lattice = Problem(assembly, problem.load, "lattice", problem.boundary)
        # a rough rest of an array on the lattice serves, as that in exact directions is farther
        # off, but where loose balls depend on it
        is_rough = bool(assembly.grid)
        if _is_even_grid(on_lattice):
            is_rough = not GridProblem(on_lattice).needs_fine_start(options)
        numbers = options.loosen() if is_rough else options
        return find_rest(assembly, problem.load, "lattice", problem.boundary, None, numbers)
    if not descent.needs_more_load:
        return None
    heavier = problem.load.scale(options.detours[-1])
    assert heavier is not None
    numbers = options.loosen()
    return find_rest(problem.assembly, heavier, "lattice", problem.boundary, None, numbers)


def _lead_round(problem: Problem, start: Rest, options: RestOptions) -> Rest | None:
    """Return the rest in exact directions that is found from ``start`` by a detour: first to rest
    under more load, by each factor of ``detours`` in turn, and from there back to the load of the
    problem. None if no detour leads to rest. Loose balls at low loads may bar the straight way.
    """
    for factor in options.detours:
        heavier = _press_more(problem, start, factor)
        if heavier is None:
            return None
        pressed = Problem(problem.assembly, heavier, "exact", problem.boundary)
        try:
            detour = TurningDescent(pressed, options).run(start)
            return TurningDescent(problem, options).run(detour)
        except ConvergenceError:
            continue
    return None


def _press_more(problem: Problem, rest: Rest, factor: float) -> AppliedLoad | None:
    """Return a load about ``factor`` times that of a problem; None of forces on balls.

    A given strain presses more from all sides: by the strain that raises the force of contacts, as
    large as their mean at ``rest``, by the factor.
    """
    load = problem.load
    assembly = problem.assembly
    if np.any(load.force) or not load.is_given:
        return load.scale(factor)
    laws = assembly.laws
    place = problem.start_at(find_unknowns(problem, rest))
    forces = np.full(laws.count, place.force_size)
    more = float(np.mean(laws.overlap(factor * forces) - laws.overlap(forces)))
    pressing = more / assembly.mean_distance * np.eye(assembly.periods)
    return replace(load, strain=load.strain - pressing)


def _choose_descent(problem: Problem, options: RestOptions) -> Descent[Any]:
    """Return the descent that finds the rest of a ``problem``: one for contacts that turn; for
    contacts that do not turn, one for an even grid, and one for all others.
    """
    if problem.turns:
        return TurningDescent(problem, options)
    if not _is_even_grid(problem):
        return LatticeDescent(problem, options)
    return GridDescent(GridProblem(problem), options)


def _rest_without_load(problem: Problem) -> Rest:
    """Return the rest of bonds at their sites, which need no load; raise :class:`InputError` if no
    contact has a stiffness there.
    """
    untouched = problem.start_at(np.zeros(problem.size))
    if np.any(untouched.stiffness > 0.0):
        return Rest.of(untouched)
    words = problem.load.words
    raise InputError(f"{words} presses nothing", "Contacts have no stiffness without a force")


def _is_even_grid(problem: Problem) -> bool:
    """Return whether contacts are a grid with one law, Hertz's, that the load presses evenly: then
    no list of contacts need be made.
    """
    assembly = problem.assembly
    load = problem.load
    if not (isinstance(assembly, GridAssembly) and isinstance(assembly.law, HertzLaw)):
        return False
    presses = load.stress is None or float(np.trace(load.stress)) < 0.0
    distances = assembly.grid.distance
    is_even = load.mean_force is None or float(np.ptp(distances)) <= ROUNDING * distances[0]
    return presses and is_even and not np.any(load.force)
