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
    laws = problem.assembly.laws
    stress = problem.load.stress
    virial = assembly.n_contacts * assembly.mean_distance
    if problem.load.mean_force is not None:
        return problem.load.mean_force
    if stress is not None and assembly.periods:
        pressing = -float(np.trace(stress))
        if pressing > 0.0:
            return pressing * assembly.measure / virial
        if np.any(stress) and np.any(np.isinf(laws.tension)):  # bonds pull as well
            return float(np.linalg.norm(stress)) * assembly.measure / virial
    sizes = np.abs(problem.load.force[: problem.n_ball_unknowns])
    on_balls = float(np.sum(sizes)) / max(assembly.n_contacts**0.5, 1.0)
    on_walls = np.abs(problem.load.force[problem.n_ball_unknowns :]) / assembly.wall_balls
    largest = max(on_balls, float(np.max(sizes, initial=0.0)), float(np.max(on_walls, initial=0.0)))
    return largest or float(np.max(laws.adhesion))


def _find_bearing(problem: Problem) -> tuple[bool, str]:
    """Return whether contacts can bear the load, and, if not, a sentence on the pressure from all
    sides with which they could; an empty text if there is no such pressure. A load that is not
    proven to be more than they can bear counts as borne.

    A linear programme seeks forces of contacts that balance the load, none with more tension than
    its contact bears. A second one seeks the least pressure that makes such forces possible.
    """
    from scipy.optimize import linprog
    from scipy.sparse import csr_array, hstack

    assembly = problem.assembly
    # (size, n_c) matrix from forces of contacts to forces against which they press the unknowns
    press = -problem.make_losses().T
    size = float(np.max(np.abs(problem.force), initial=0.0)) or 1.0
    right = problem.force / size
    least = -assembly.laws.tension / size

    def search(columns: Any, cost: Array) -> Any:
        """Return the answer for forces of least ``cost`` whose ``columns`` add up to the load; the
        columns after those of the contacts belong to numbers that are zero or above.
        """
        bounds = [(bound, None) for bound in least.tolist()]
        bounds += [(0.0, None)] * (columns.shape[1] - len(least))
        return linprog(cost, A_eq=columns, b_eq=right, bounds=bounds, method="highs")

    # 2: there are no such forces; other numbers: they are found, or the search has failed
    if search(press, np.zeros(press.shape[1])).status != 2:
        return True, ""
    if not len(problem.unit_strains):
        return False, ""
    sides = np.zeros(problem.size)
    sides[problem.n_displacements :] = (
        problem.find_work(np.eye(assembly.periods)) / assembly.measure
    )
    cost = np.zeros(press.shape[1] + 1)
    cost[-1] = 1.0
    answer = search(hstack([press, csr_array(sides[:, None])]), cost)
    if not answer.success:
        return False, ""
    pressure = answer.x[-1] * size / assembly.measure
    # without forces of contacts the pressure only takes the load off, and more of it is needed
    presses = np.max(np.abs(answer.x[:-1])) > 1e-9 * answer.x[-1]
    word = "of" if presses else "above"
    unit = _UNITS[assembly.periods]
    return False, (f"A pressure {word} {pressure:.4g} {unit} from all sides in addition would do")


def explain(
    problem: Problem,
    options: RestOptions,
    opened: bool = False,
    residual: float | None = None,
) -> InputError | ConvergenceError:
    """Return the error of a load that the assembly has not come to rest under.

    It is an InputError if contacts cannot bear the load, if all are open or bear nothing
    (``opened``), if a law does not reach the forces, or if stiffnesses or forces differ too much;
    else a ConvergenceError. ``residual`` is the largest force left on a ball, over the mean force;
    None if it is not known.
    """
    assembly = problem.assembly
    laws = assembly.laws
    words = problem.load.words
    # a load without forces is borne by any contacts; long lists would take too much time
    if assembly.n_contacts <= options.most_explained and np.any(problem.force):
        is_borne, mend = _find_bearing(problem)
        if not is_borne:
            why = (
                "Contacts only push along the lines of their centres, and no such forces add up"
                " to it"
            )
            if laws.adhere:
                why = (
                    "No forces along the lines of the centres, up to the tension that contacts"
                    " bear, add up to it"
                )
            mend = mend or "Press the crystal from the sides too, or give another load"
            return InputError(
                f"the crystal cannot bear {words}", *(problem.load.lift or (why, mend))
            )
    if opened:
        why = "The balls do not touch, or too few do to hold each other"
        return InputError(
            f"contacts are open or bear nothing under {words}", why, "Press the balls"
        )
    size = find_typical_force(problem)
    with np.errstate(all="ignore"):
        reached = laws.overlap(np.full(laws.count, size))
        stiffness = laws.stiffness(reached)
    if not np.all(np.isfinite(reached)):
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
        present = values[values > 0.0]
        ratio = float(np.max(values) / np.min(present)) if present.size else 0.0
        if ratio > most:
            what = (
                f"the crystal has not come to rest under {words}, where {quantity} differ by a"
                f" factor of {ratio:.2g}"
            )
            why = f"A factor of up to {most:g} can be told from rounding"
            return InputError(what, why, "Compare the units, or leave the smaller ones out")
    left = "" if residual is None else f"A force of {residual:.2g} of the mean is left on a ball"
    return ConvergenceError(f"the crystal has not come to rest under {words}", left)
