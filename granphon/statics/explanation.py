"""Why an assembly does not come to rest under a load."""

from __future__ import annotations

from typing import Any

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError, InputError
from granphon.statics.configuration import Problem
from granphon.statics.options import RestOptions

#: units of a pressure, by the number of periods
_UNITS = ("", "N", "N/m", "Pa")


def find_typical_force(problem: Problem) -> float:
    """Return an estimate of the size of contact forces under a load, N, with which a search begins.

    A given mean force is the estimate itself. A stress with a pressure gives the estimate by the
    virial; so does the size of another stress where there are bonds. Otherwise the forces on balls
    and walls give the estimate, and without these the largest tension that contacts bear by
    adhesion, which is zero where they do not adhere.
    """
    assembly = problem.assembly
    laws = assembly.laws
    stress = problem.load.stress
    # virial of contacts that all have a force of one
    virial = assembly.n_contacts * assembly.mean_distance
    if problem.load.mean_force is not None:
        return problem.load.mean_force
    if stress is not None and assembly.periods:
        pressing = -float(np.trace(stress))
        if pressing > 0.0:
            return pressing * assembly.measure / virial
        if np.any(stress) and np.any(np.isinf(laws.tension)):  # bonds pull as well
            return float(np.linalg.norm(stress)) * assembly.measure / virial
    on_balls = np.abs(problem.load.force[: problem.n_ball_unknowns])
    on_walls = np.abs(problem.load.force[problem.n_ball_unknowns :]) / assembly.wall_balls
    # as if the sum of all forces, as of a weight, were borne by about as many contacts as a layer
    # of a square array has
    in_layer = float(np.sum(on_balls)) / max(assembly.n_contacts**0.5, 1.0)
    largest_of_each = (float(np.max(forces, initial=0.0)) for forces in (on_balls, on_walls))
    return max(in_layer, *largest_of_each) or float(np.max(laws.adhesion))


def _find_bearing(problem: Problem) -> tuple[bool, str]:
    """Return whether contacts can bear the load, and a sentence on the pressure from all sides with
    which they could. The sentence is empty if they can, and if no such pressure is found. A load
    counts as borne unless it is proven to be too much.

    A linear programme seeks forces of contacts that balance the load (:func:`_seek_forces`). A
    second one seeks the least pressure that makes such forces possible.
    """
    from scipy.sparse import csr_array, hstack

    assembly = problem.assembly
    # (size, n_c) matrix from forces of contacts to the forces of a load that they balance
    balance = -problem.make_losses().T
    # status 2: there are no such forces; another status: such forces are found, or the search has
    # failed
    if _seek_forces(problem, balance, np.zeros(balance.shape[1])).status != 2:
        return True, ""
    if not len(problem.unit_strains):
        return False, ""
    # a pressure from all sides, times the measure of the cell, takes these from the forces of the
    # load
    sides = np.zeros(problem.size)
    sides[problem.n_displacements :] = (
        problem.find_work(np.eye(assembly.periods)) / assembly.measure
    )
    cost = np.zeros(balance.shape[1] + 1)
    cost[-1] = 1.0
    answer = _seek_forces(problem, hstack([balance, csr_array(sides[:, None])]), cost)
    if not answer.success:
        return False, ""
    pressure = answer.x[-1] * _find_largest_force(problem) / assembly.measure
    # where contacts have no force but rounding, the pressure only takes the load off, and more
    # pressure is needed. Of the mean force that the pressure alone would make, rounding is about
    # 1e-16, and a force that is needed is far more than 1e-9
    force_of_pressure = answer.x[-1] / (assembly.n_contacts * assembly.mean_distance)
    is_pressed = np.max(np.abs(answer.x[:-1])) > 1e-9 * force_of_pressure
    word = "of" if is_pressed else "above"
    unit = _UNITS[assembly.periods]
    return False, (f"A pressure {word} {pressure:.4g} {unit} from all sides in addition would do")


def _seek_forces(problem: Problem, columns: Any, cost: Array) -> Any:
    """Return SciPy's answer to a linear programme: the numbers x of least ``cost`` @ x with which
    the ``columns`` add up to the load.

    The first n_c columns are those of the contacts, and their numbers the forces: none has more
    tension than its contact bears. The numbers of further columns are zero or above. All are over
    the largest force of the load.
    """
    from scipy.optimize import linprog

    size = _find_largest_force(problem)
    least_forces = -problem.assembly.laws.tension / size
    bounds = [(bound, None) for bound in least_forces.tolist()]
    bounds += [(0.0, None)] * (columns.shape[1] - len(least_forces))
    right_side = problem.force / size
    return linprog(cost, A_eq=columns, b_eq=right_side, bounds=bounds, method="highs")


def _find_largest_force(problem: Problem) -> float:
    """Return the size of the largest force of the load on an unknown, N; 1 without a force."""
    return float(np.max(np.abs(problem.force), initial=0.0)) or 1.0


def explain(
    problem: Problem,
    options: RestOptions,
    is_open: bool = False,
    residual: float | None = None,
) -> InputError | ConvergenceError:
    """Return the error of a load that the assembly has not come to rest under.

    An InputError names the first reason that holds. The reasons are, in this order: contacts cannot
    bear the load; all contacts are open or bear nothing, which the caller knows (``is_open``); a
    law does not reach the forces; stiffnesses or forces differ too much. If none holds, a
    ConvergenceError says the ``residual``, the largest force left on a ball over the mean force;
    None if it is not known.
    """
    words = problem.load.words
    error = _explain_unborne(problem, options)
    if error is None and is_open:
        why = "The balls do not touch, or too few do to hold each other"
        what = f"contacts are open or bear nothing under {words}"
        error = InputError(what, why, "Press the balls")
    error = error or _explain_laws(problem, options)
    if error is not None:
        return error
    left = "" if residual is None else f"A force of {residual:.2g} of the mean is left on a ball"
    return ConvergenceError(f"the crystal has not come to rest under {words}", left)


def _explain_unborne(problem: Problem, options: RestOptions) -> InputError | None:
    """Return the error of a load that contacts cannot bear; None of a load that may be borne.

    A load without forces is borne by any contacts. Loads of more than ``options.most_contacts``
    contacts are not looked into, which would take too much time.
    """
    assembly = problem.assembly
    if assembly.n_contacts > options.most_contacts or not np.any(problem.force):
        return None
    is_borne, mend = _find_bearing(problem)
    if is_borne:
        return None
    why = "Contacts only push along the lines of their centres, and no such forces add up to it"
    if assembly.laws.can_adhere:
        why = (
            "No forces along the lines of the centres, up to the tension that contacts bear, add"
            " up to it"
        )
    mend = mend or "Press the crystal from the sides too, or give another load"
    if problem.load.lift is not None:
        # gravity that lifts balls off what they stand on is the nearer reason
        why, mend = problem.load.lift
    return InputError(f"the crystal cannot bear {problem.load.words}", why, mend)


def _explain_laws(problem: Problem, options: RestOptions) -> InputError | None:
    """Return the error of laws that have no overlap at a typical force of the load, or of
    stiffnesses or forces of the load that differ by more than ``options`` allow; None if there is
    no such reason.
    """
    laws = problem.assembly.laws
    words = problem.load.words
    size = find_typical_force(problem)
    with np.errstate(all="ignore"):
        overlap = laws.overlap(np.full(laws.count, size))
        stiffness = laws.stiffness(overlap)
    if not np.all(np.isfinite(overlap)):
        why = f"They are about {size:.4g} N, and the law has no overlap at that force"
        mend = "Lower the load, or give a law whose force grows on"
        return InputError(f"a contact law does not reach the forces under {words}", why, mend)
    forces = np.abs(problem.force * problem.weights)
    # springs to the ground bear any tension, as bonds do
    kinds = "contacts and springs" if np.any(np.isinf(laws.tension)) else "contacts"
    for quantity, values, most in (
        (f"the stiffnesses of {kinds}", stiffness, options.most_ratio_of_stiffnesses),
        ("the forces of the load (each as on a ball)", forces, options.most_ratio_of_forces),
    ):
        positive = values[values > 0.0]
        ratio = float(np.max(positive) / np.min(positive)) if positive.size else 0.0
        if ratio > most:
            what = (
                f"the crystal has not come to rest under {words}, where {quantity} differ by a"
                f" factor of {ratio:.2g}"
            )
            why = f"A factor of up to {most:g} can be told from rounding"
            return InputError(what, why, "Compare the units, or leave the smaller ones out")
    return None
