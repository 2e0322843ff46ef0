"""The contact laws of media as tables that a page interpolates, each with its error.

Balls have Hertz's force c delta^(3/2) at the overlap delta, and diameters of the width W. In units
of W and of c W^(3/2), a law is one curve for all loads and widths: the overlap y and the stiffness
k* at the reduced force f*. A table has the values and slopes of this curve at nodes of ln f*, and
is a cubic (Hermite's) between the nodes. The law of the effective medium depends on eta too, the
ratio of the shear to the normal stiffness: the table has a curve at each of a few nodes of
eta^1/2, and is a polynomial in eta^1/2 between these.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from granphon.balls.diameters import Discrete, Measured, Normal, Uniform
from granphon.balls.hertz import EXPONENT, force_of, high_pressure_overlap
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.base.errors import InputError, MechanismError, PrecisionError
from granphon.base.scales import WidthUnits
from granphon.dynamics.local_field import local_field, paper_local_field
from granphon.laws.effective import VALID_FORCE, EffectiveLaw
from granphon.laws.spread import AveragedLaw
from granphon.media.choice import MediumChoice, find_medium
from granphon.media.state import Law

#: number of nodes of ln f* at first, and the largest number
_NODES = 61
_MOST_NODES = 800
#: error of ln k* in the middle between two nodes, above which a node is added in the middle
_TOLERANCE = 1e-6
#: distance of nodes of ln f* that is not halved any more
_LEAST_STEP = 1e-4
#: y above which the page takes the law of equal balls: the two laws differ by less than 1e-8
_EQUAL_BALLS_OVERLAP = 3000.0
#: number of nodes of eta^1/2, with two and with three periods
_FRICTION_NODES = {2: 8, 3: 5}
#: least eta of a table on a lattice that does not stand without friction
_LEAST_FRICTION = 0.05
#: relative change of k from which a note gives the size of the change
_NOTED_CHANGE = 1e-4
#: number of loads of a simulation
_N_LOADS = 17
#: f* at which the table of a simulation begins at the lowest, and y at which the table ends
_LEAST_SIMULATED_FORCE = 1e-2
_MOST_SIMULATED_OVERLAP = 30.0
#: largest width of the balls of a simulation, in diameters: a narrow spread has the law of W -> 0
_SIMULATED_WIDTH = 1e-3
#: step of ln f* in which the least load with a solution is sought, and the end of the search
_SEARCH_STEP = 0.25
_SEARCH_END = 5.0
#: the media whose law a table takes from a formula
_MEDIA_OF_FORMULAS = ("afa", "ema")
#: a curve: y, ln k* and d ln k* / d ln f* at values of ln f*
_Curve = Callable[[Array], tuple[Array, Array, Array]]


def tabulate_medium(
    packing: Packing,
    choice: MediumChoice,
    least_force: float,
    most_friction: float,
    most_rolling: float,
) -> dict[str, Any]:
    """Return the table of a medium, as plain numbers and texts.

    Parameters
    ----------
    packing : the balls; the table has their torsion and bending, and the shape of the distribution
        that :func:`choose_spread` returns.
    choice : the medium, not an automatic one.
    least_force : f* at which the table begins; where the medium has no solution, the table begins
        at a larger f*.
    most_friction : the largest eta.
    most_rolling : the largest torsion and bending, over k d^2; the table leaves out their effect on
        the medium.

    Returns
    -------
    "name", "words"; "table", None where balls that differ have the stiffness of equal balls, else
    with "log_force" (n,), "roots" (m,) of eta, and "overlap", "log_stiffness" and "slope", (m, n);
    "error", the largest relative error of k from interpolation at the packing's eta, and
    "friction_error", the largest one at any other eta, both found between the nodes; "valid", the
    f* from which the medium is valid; "note", a sentence on what the table leaves out; "refusal",
    the reason why the medium has no table: the lattice is a mechanism at every eta of the page, or
    at that of the packing if its balls differ.

    Raises
    ------
    InputError : the medium is not one of granphon's own, or does not take these balls.
    PrecisionError : the medium has no solution at any load of the page, or Xi is beyond double
        precision.
    ConvergenceError : the samples of a simulation are not found.
    """
    name = choice.name
    description: dict[str, Any] = {
        "name": choice.label,
        "words": find_medium(name).words,
        "table": None,
        "error": 0.0,
        "friction_error": 0.0,
        "valid": 0.0,
        "note": "",
        "refusal": "",
    }
    if name not in ("ala", *_MEDIA_OF_FORMULAS, "simulation"):
        raise InputError(
            f"a page has no table of the medium {choice.label}",
            "The law of a registered medium need not be one curve for all widths",
            f"Give a medium among ala, {', '.join(_MEDIA_OF_FORMULAS)}, simulation",
        )
    if packing.structure.periods == 1:  # every contact of a line bears the load itself
        return description
    if name == "ala":
        return description | {"note": _AVERAGED_NOTE}
    try:
        if name == "simulation":
            return description | _tabulate_simulation(packing, choice, least_force)
        return description | _tabulate_formulas(
            packing, choice, least_force, most_friction, most_rolling
        )
    except MechanismError as error:
        return description | {"refusal": str(error)}


def _tabulate_formulas(
    packing: Packing,
    choice: MediumChoice,
    least_force: float,
    most_friction: float,
    most_rolling: float,
) -> dict[str, Any]:
    """Return "table", "error", "friction_error", "valid" and "note" of the averaged force or the
    effective medium, with the arguments of :func:`tabulate_medium`; empty where the medium has the
    law of equal balls. Raises MechanismError for a lattice that is a mechanism, and PrecisionError
    if the medium has no solution at any load of the page.
    """
    roots = _choose_roots(packing, choice, most_friction)
    laws = [_make_law(packing, choice, root**2) for root in roots]
    if laws[0] is None:  # the load alone fixes the force of every contact
        return {}
    curves = [_make_curve(law) for law in laws if law is not None]

    def require_values(log_force: float) -> None:
        """Raise :class:`PrecisionError` if one of the curves has no value at ``log_force``."""
        for curve in curves:
            curve(np.array([log_force]))

    start = _find_start(require_values, np.log(least_force), PrecisionError)
    if start is None:
        raise PrecisionError("the medium has no solution at any load of the page")
    valid = float(force_of(high_pressure_overlap(1.0)))
    note = ""
    if choice.name == "ema":
        valid = VALID_FORCE
        change = _find_effect_of_rolling(packing, choice, most_rolling, start)
        note = _write_note_on_rolling(packing, change)
    checks = _make_checks(packing, choice, roots)
    table = _tabulate(curves, roots, start, EXPONENT * np.log(_EQUAL_BALLS_OVERLAP), checks)
    return table | {"valid": valid, "note": note}


def choose_spread(packing: Packing) -> Uniform | Normal | Discrete | Measured:
    """Return the spread whose shape has the distribution that the slider of the width scales: that
    of the packing. It is a uniform one where the packing has none, or lists diameters that are all
    the same.
    """
    spread = packing.spread
    if spread is None or spread.shape.bounds == (0.0, 0.0):
        return Uniform(packing.width)
    return spread


def _make_checks(
    packing: Packing, choice: MediumChoice, roots: Sequence[float]
) -> list[tuple[float, _Curve]]:
    """Return the middles between neighbouring ``roots`` of eta, and the curve of the medium at
    each, with which the interpolation between the roots is compared; none where the medium has the
    law of equal balls.
    """
    checks = []
    for low, high in itertools.pairwise(roots):
        middle = 0.5 * (low + high)
        law = _make_law(packing, choice, middle**2)
        if law is not None:
            checks.append((middle, _make_curve(law)))
    return checks


def _tabulate_simulation(
    packing: Packing, choice: MediumChoice, least_force: float
) -> dict[str, Any]:
    """Return "table", "error", "friction_error" and "note" of a simulation, from f* =
    ``least_force`` on.
    """
    curve, low, high, error = _simulate(packing, choice, least_force)
    # the error of the spline through the loads, in place of that of the table of the spline
    errors = {"error": error, "friction_error": error, "note": _SIMULATION_NOTE}
    return _tabulate([curve], [0.0], low, high) | errors


_AVERAGED_NOTE = (
    "In the averaged lattice all balls have the mean diameter: the width changes nothing."
)


_SIMULATION_NOTE = (
    "The page takes the mean stiffness of the contacts from the simulation; the waves are"
    " those of the lattice of such contacts, not those of the samples."
)


def _find_least_root(packing: Packing, choice: MediumChoice) -> float:
    """Return the least eta^1/2 of the table: zero, or ``_LEAST_FRICTION**0.5`` where the lattice
    is a mechanism without friction. Raises MechanismError if the lattice is a mechanism with this
    friction too.
    """
    try:
        _find_xi(packing, choice, 0.0)
    except MechanismError:
        _find_xi(packing, choice, _LEAST_FRICTION)
        return float(_LEAST_FRICTION**0.5)
    return 0.0


def _choose_roots(packing: Packing, choice: MediumChoice, most: float) -> list[float]:
    """Return the nodes of eta^1/2, ascending, up to that of the eta ``most``; zero alone for the
    averaged force, whose law does not depend on eta. Raises MechanismError as
    :func:`_find_least_root` does.
    """
    if choice.name == "afa":
        return [0.0]
    least_root = _find_least_root(packing, choice)
    count = _FRICTION_NODES[packing.structure.periods]
    # Chebyshev's extrema, from 0 to 1
    nodes = 0.5 * (1.0 - np.cos(np.pi * np.arange(count) / (count - 1)))
    roots = least_root + (most**0.5 - least_root) * nodes
    root_of_packing = packing.mindlin_ratio**0.5
    if least_root < root_of_packing < most**0.5:
        # kinks of a law move with eta: a node at the packing's eta needs no interpolation in eta
        nearest = 1 + np.argmin(np.abs(roots[1:-1] - root_of_packing))
        roots[nearest] = root_of_packing
    ascending_roots: list[float] = roots.tolist()
    return ascending_roots


def _find_effect_of_rolling(
    packing: Packing, choice: MediumChoice, most: float, low: float
) -> float:
    """Return the largest relative change of k, from ln f* = ``low`` on, if torsion, bending or
    both, over k d^2, are ``most``, or both are zero, in place of the packing's. It is zero where
    the medium has the law of equal balls or the local field of the paper, and where balls are equal
    on a lattice that is a mechanism at their eta.

    Pairs of torsion and bending with which the lattice is a mechanism, or the medium is beyond
    double precision or has no solution at ``low``, do not count. Raises MechanismError for balls
    that differ on a lattice that is a mechanism at their eta: the medium of the packing itself has
    no stiffness.
    """
    if dict(choice.options).get("local_field") == "paper":
        return 0.0  # the factor that the paper prints depends on eta alone
    eta = packing.mindlin_ratio
    try:
        law_of_packing = _make_law(packing, choice, eta)
    except MechanismError:
        if packing.spread_matters:
            raise
        return 0.0
    if law_of_packing is None:
        return 0.0
    log_force = np.linspace(low, EXPONENT * np.log(_EQUAL_BALLS_OVERLAP), _NODES)
    _, log_stiffness, _ = _make_curve(law_of_packing)(log_force)
    # in a plane the balls of the medium turn about its normal alone, which twists no contact
    torsions = (packing.torsion, most) if packing.structure.periods == 3 else (packing.torsion,)
    pairs = {*itertools.product(torsions, (packing.bending, most)), (0.0, 0.0)}
    change = 0.0
    for torsion, bending in pairs - {(packing.torsion, packing.bending)}:
        changed_packing = replace(packing, torsion=torsion, bending=bending)
        try:
            law = _make_law(changed_packing, choice, eta)
            if law is None:
                continue
            _, changed_log_stiffness, _ = _make_curve(law)(log_force)
        except (MechanismError, PrecisionError):
            continue
        difference = changed_log_stiffness - log_stiffness
        change = max(change, float(np.max(np.abs(np.expm1(difference)))))
    return change


def _write_note_on_rolling(packing: Packing, change: float) -> str:
    """Return the note on the torsion and the bending with which the effective medium is computed.
    Unless ``change`` is zero, the note tells it too: the largest relative change of the stiffness
    by other torsion and bending.
    """
    ratios = {"torsion": _find_own_torsion(packing), "bending": packing.bending}
    words = [f"{name} {ratio:g}" if ratio else f"no {name}" for name, ratio in ratios.items()]
    note = (
        f"The stiffness of the contacts is that of the medium with {' and '.join(words)}; the"
        f" sliders of torsion and bending change the lattice alone."
    )
    if not change:
        return note
    if change >= _NOTED_CHANGE:
        size = f"up to {100.0 * change:.2g} %"
    else:
        size = f"less than {100.0 * _NOTED_CHANGE:g} %"
    return f"{note} In the medium they would change the stiffness by {size}."


def _find_xi(packing: Packing, choice: MediumChoice, eta: float) -> float:
    """Return the local-field factor Xi of the effective medium at ``eta``: the one printed in the
    paper if the options of the medium say so, else that of the packing's lattice. Raises
    MechanismError and PrecisionError as :func:`~granphon.dynamics.local_field.local_field` does.
    """
    if dict(choice.options).get("local_field") == "paper":
        return paper_local_field(eta).xi
    torsion = _find_own_torsion(packing)
    return local_field(packing.structure, eta, bending=packing.bending, torsion=torsion).xi


def _find_own_torsion(packing: Packing) -> float:
    """Return the torsion that the effective medium takes, over k d^2: a number that the packing
    has, else 0, as the torsion "mindlin" of Hertz contacts is of the order delta/d.
    """
    return packing.torsion if isinstance(packing.torsion, float) else 0.0


def _make_law(packing: Packing, choice: MediumChoice, eta: float) -> Law | None:
    """Return the law of the averaged force, the same at every ``eta``, or else of the effective
    medium at this ``eta``, in units of W and c W^(3/2). The shape is that of :func:`choose_spread`.
    None if Xi is zero, where the effective medium has the law of equal balls.

    Raises MechanismError if the lattice has no Xi, and PrecisionError if Xi is beyond double
    precision.
    """
    shape = choose_spread(packing).shape
    if choice.name == "afa":
        return AveragedLaw(coefficient=1.0, width=1.0, shape=shape)
    xi = _find_xi(packing, choice, eta)
    if xi == 0.0:
        return None
    return EffectiveLaw(coefficient=1.0, width=1.0, shape=shape, xi=xi)


def _make_curve(law: Law) -> _Curve:
    """Return the curve of a law in units of W and c W^(3/2)."""

    def curve(log_force: Array) -> tuple[Array, Array, Array]:
        """Return y, ln k* and d ln k* / d ln f* (n,) at ln f* (n,)."""
        force = np.exp(log_force)
        overlap = np.asarray(law.overlap(force))
        stiffness = np.asarray(law.stiffness(overlap))
        slope = force * np.asarray(law.stiffness_slope(overlap)) / stiffness**2
        return overlap, np.log(stiffness), slope

    return curve


def _find_start(
    find: Callable[[float], Any], low: float, refusal: type[InputError]
) -> float | None:
    """Return the first ln f* of the steps from ``low`` to ``_SEARCH_END`` at which ``find``, a
    function of ln f*, raises no error of the class ``refusal``; None if ``find`` raises such an
    error at every step.
    """
    for log_force in np.arange(low, _SEARCH_END, _SEARCH_STEP):
        with suppress(refusal):
            find(log_force)
            return float(log_force)
    return None


def _tabulate(
    curves: list[_Curve],
    roots: list[float],
    low: float,
    high: float,
    checks: list[tuple[float, _Curve]] | None = None,
) -> dict[str, Any]:
    """Return "table", "error" and "friction_error" of :func:`tabulate_medium`, with nodes of ln f*
    from ``low`` to ``high``, from ``curves``, one for each of the ``roots`` of eta.

    "friction_error" is "error" and the largest error at ``checks``, pairs of a root of eta between
    the nodes and its curve; without checks nothing is added.
    """
    from scipy.interpolate import barycentric_interpolate

    log_force, values, error = _refine_nodes(curves, low, high)
    overlap, log_stiffness, slope = np.array(values).swapaxes(0, 1)  # (roots, nodes) each
    error_between_roots = 0.0
    for root, curve in checks or []:
        interpolated_values = barycentric_interpolate(roots, log_stiffness, root)
        _, exact_values, _ = curve(log_force)
        difference = interpolated_values - exact_values
        error_between_roots = max(error_between_roots, float(np.max(np.abs(np.expm1(difference)))))
    table = {
        "log_force": log_force.tolist(),
        "roots": roots,
        "overlap": overlap.tolist(),
        "log_stiffness": log_stiffness.tolist(),
        "slope": slope.tolist(),
    }
    return {"table": table, "error": error, "friction_error": error + error_between_roots}


def _refine_nodes(
    curves: list[_Curve], low: float, high: float
) -> tuple[Array, list[Array], float]:
    """Return nodes (n,) of ln f* from ``low`` to ``high``, the values (3, n) of each curve at the
    nodes, and the largest relative error of k in the middle between two nodes.

    A law has a kink at loads where contacts open: nodes are closer at a kink. Nodes are added until
    the errors are below ``_TOLERANCE`` or the steps below ``_LEAST_STEP``, and as long as there are
    ``_MOST_NODES`` at most.
    """
    nodes = np.linspace(low, high, _NODES)
    while True:
        tables = [np.array(curve(nodes)) for curve in curves]
        middles = 0.5 * (nodes[1:] + nodes[:-1])
        steps = np.diff(nodes)
        errors = np.zeros(len(steps))
        for (_overlap, log_stiffness, slope), curve in zip(tables, curves, strict=True):
            # the value of Hermite's cubic in the middle between two nodes
            means = 0.5 * (log_stiffness[1:] + log_stiffness[:-1])
            interpolated_values = means + steps / 8.0 * (slope[:-1] - slope[1:])
            _overlap, exact_values, _slope = curve(middles)
            differences = interpolated_values - exact_values
            errors = np.maximum(errors, np.abs(np.expm1(differences)))
        is_coarse = (errors > _TOLERANCE) & (steps > _LEAST_STEP)
        n_nodes = len(nodes) + np.count_nonzero(is_coarse)
        if not np.any(is_coarse) or n_nodes > _MOST_NODES:
            return nodes, tables, float(np.max(errors))
        nodes = np.sort(np.concatenate([nodes, middles[is_coarse]]))


def _simulate(
    packing: Packing, choice: MediumChoice, least: float
) -> tuple[_Curve, float, float, float]:
    """Return the curve of a simulation, the lower and the upper end of ln f*, and the relative
    error of k on the curve; ``least`` is the least f* of the page.

    The curve is a spline through :data:`_N_LOADS` loads. The error is that of a spline through
    half of the loads, at the other half.
    """
    from scipy.interpolate import CubicSpline

    largest_width = _SIMULATED_WIDTH * packing.diameter
    width = min(packing.width or largest_width, largest_width)  # equal balls have none
    narrow_packing = replace(packing, spread=choose_spread(packing).with_width(width))
    units = WidthUnits(packing.law.coefficient, width)
    medium: Any = choice.of(narrow_packing)
    low = np.log(max(least, _LEAST_SIMULATED_FORCE))
    high = EXPONENT * np.log(_MOST_SIMULATED_OVERLAP)  # f* is nearly y^(3/2) there

    def find_state(log_force: Any) -> Any:
        """Return the state of the medium at ln f*, a number or (n,)."""
        return medium.at_force(np.exp(log_force) * units.force)

    if medium.friction_history:  # the samples carry no load below that of their start
        start = _find_start(find_state, low, InputError)
        low = low if start is None else start
    loads = np.linspace(low, high, _N_LOADS)  # ln f*
    state = find_state(loads)
    overlap = np.asarray(state.overlap) / width
    log_stiffness = np.log(np.asarray(state.normal_stiffness) / units.stiffness)
    stiffness_spline = CubicSpline(loads, log_stiffness)
    overlap_spline = CubicSpline(loads, overlap)

    def curve(log_force: Array) -> tuple[Array, Array, Array]:
        """Return y, ln k* and d ln k* / d ln f* (n,) at ln f* (n,)."""
        return (
            overlap_spline(log_force),
            stiffness_spline(log_force),
            stiffness_spline(log_force, 1),
        )

    coarse_spline = CubicSpline(loads[::2], log_stiffness[::2])
    differences = coarse_spline(loads[1::2]) - log_stiffness[1::2]
    error = float(np.max(np.abs(np.expm1(differences))))
    return curve, float(loads[0]), float(loads[-1]), error
