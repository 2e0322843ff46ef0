"""The contact laws of media as tables that a page interpolates, each with its error.

In units of the width W and of c W^(3/2), a law is one curve for all loads and widths: the overlap y
and the stiffness k* at the reduced force f*. A table has that curve at nodes of ln f*, with slopes,
between which it is a cubic (Hermite's). The effective medium depends on eta too: it has a curve at
each of a few nodes of eta^1/2, between which it is a polynomial.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from granphon.balls.diameters import Uniform
from granphon.balls.hertz import EXPONENT, force_of, high_pressure_overlap
from granphon.balls.packing import Packing, change_width
from granphon.base.arrays import Array
from granphon.base.errors import InputError, MechanismError, PrecisionError
from granphon.base.scales import WidthUnits
from granphon.dynamics.local_field import local_field, paper_local_field
from granphon.laws.effective import VALID_FORCE, EffectiveLaw
from granphon.laws.spread import AveragedLaw
from granphon.media.choice import MediumChoice, find_medium
from granphon.media.state import Law

#: nodes of ln f* to begin with, and the most that there may be
_NODES = 61
_MOST_NODES = 800
#: error of ln k* in the middle between two nodes from which another node is put there
_TOLERANCE = 1e-6
#: distance of nodes that is not halved any more
_LEAST_STEP = 1e-4
#: y from which the law of equal balls takes over: the two then differ by less than 1e-8
_EQUAL = 3000.0
#: nodes of eta^1/2, with two and with three periods
_FRICTION_NODES = {2: 8, 3: 5}
#: least eta of a table on a lattice that does not stand without friction
_LEAST_FRICTION = 0.05
#: least relative change of k that is told by its size
_NOTED = 1e-4
#: loads of a simulation
_SIMULATED = 17
#: a curve: y, ln k* and d ln k* / d ln f* at values of ln f*
_Curve = Callable[[Array], tuple[Array, Array, Array]]


def tabulate_medium(
    packing: Packing,
    choice: MediumChoice,
    least_force: float,
    most_friction: float,
    most_rolling: float,
) -> dict[str, Any]:
    """Return the table of a medium, as plain numbers and texts, for the shape of the packing's
    spread, or a uniform one.

    Parameters
    ----------
    packing : the balls; the shape of their distribution, their torsion and bending are those of the
        table.
    choice : the medium, not an automatic one.
    least_force : f* from which the table is wanted; it begins later where the medium has no
        solution.
    most_friction : the largest eta.
    most_rolling : the largest torsion and bending, over k d^2, of which the table leaves out what
        they do to the medium.

    Returns
    -------
    "name", "words"; "table", None where balls that differ have the stiffness of equal balls, else
    with "log_force" (n,), "roots" (m,) of eta, and "overlap", "log_stiffness" and "slope", (m, n);
    "error", the largest relative error of k from interpolation at the packing's eta, and
    "friction_error" that at others, both found between the nodes; "valid", the f* from which the
    medium is valid; "note", what the table leaves out, in words; "refusal", why the medium has no
    table.
    """
    name = choice.name
    found: dict[str, Any] = {
        "name": choice.label,
        "words": find_medium(name).words,
        "table": None,
        "error": 0.0,
        "friction_error": 0.0,
        "valid": 0.0,
        "note": "",
        "refusal": "",
    }
    if packing.structure.periods == 1:
        return found
    if name == "ala":
        return found | {
            "note": "In the averaged lattice all balls have the mean diameter: the width changes"
            " nothing."
        }
    try:
        if name == "simulation":
            curve, low, high, error = _simulate(packing, choice, least_force)
            apart = {"error": error, "friction_error": error, "note": _SIMULATION_NOTE}
            return found | _tabulate([curve], [0.0], low, high) | apart
        roots, note = _choose_friction(packing, choice, most_friction)
        laws = [_make_law(packing, choice, root**2) for root in roots]
    except MechanismError as error:
        return found | {"refusal": str(error)}
    if laws[0] is None:  # the load alone fixes the force of every contact
        return found
    curves = [_follow(law) for law in laws if law is not None]
    start = _find_start(
        lambda x: [curve(np.array([x])) for curve in curves], np.log(least_force), PrecisionError
    )
    if start is None:
        raise PrecisionError("the medium has no solution at any load of the page.")
    between = [0.5 * (one + other) for one, other in itertools.pairwise(roots)]
    checks = [
        (root, _follow(law))
        for root in between
        if (law := _make_law(packing, choice, root**2)) is not None
    ]
    if name == "ema":
        change = _find_effect_of_rolling(packing, choice, most_rolling, start)
        told = (
            f"up to {100.0 * change:.2g} %"
            if change >= _NOTED
            else f"less than {100.0 * _NOTED:g} %"
        )
        note += f" In the medium they would change the stiffness by {told}." if change else ""
    valid = {
        "afa": float(force_of(high_pressure_overlap(1.0))),
        "ema": VALID_FORCE,
    }[name]
    return (
        found
        | _tabulate(curves, roots, start, EXPONENT * np.log(_EQUAL), checks)
        | {"valid": valid, "note": note}
    )


_SIMULATION_NOTE = (
    "The page takes the mean stiffness of the contacts from the simulation; the waves are"
    " those of the lattice of such"
    " contacts, not those of the samples."
)


def _choose_friction(
    packing: Packing, choice: MediumChoice, most: float
) -> tuple[list[float], str]:
    """Return the nodes of eta^1/2, and what the table leaves out, in words."""
    if choice.name == "afa":
        return [0.0], ""
    least = 0.0
    try:
        _find_xi(packing, choice, least)
    except MechanismError:
        least = _LEAST_FRICTION**0.5
        _find_xi(packing, choice, least**2)
    count = _FRICTION_NODES[packing.structure.periods]
    nodes = 0.5 * (1.0 - np.cos(np.pi * np.arange(count) / (count - 1)))
    roots = least + (most**0.5 - least) * nodes
    own = packing.mindlin_ratio**0.5
    if own > least:
        # kinks of a law move with eta: at the scene's own, nothing is interpolated in eta
        roots[1 + np.argmin(np.abs(roots[1:-1] - own))] = own
    stiffness = {"torsion": _find_own_torsion(packing), "bending": packing.bending}
    said = " and ".join(
        f"{name} {value:g}" if value else f"no {name}" for name, value in stiffness.items()
    )
    return roots.tolist(), (
        f"The stiffness of the contacts is that of the medium with {said}; the sliders of"
        f" torsion and bending change the lattice alone."
    )


def _find_effect_of_rolling(
    packing: Packing, choice: MediumChoice, most: float, low: float
) -> float:
    """Return the largest relative change of k, from ln f* = ``low`` on, as torsion and bending go
    to ``most`` or zero.

    What leaves the lattice a mechanism does not count: there the medium has no stiffness at all.
    """
    if dict(choice.options).get("local_field") == "paper":
        return 0.0
    own = (packing.torsion, packing.bending)
    twists = (own[0], most) if packing.structure.periods == 3 else (own[0],)
    x = np.linspace(low, EXPONENT * np.log(_EQUAL), _NODES)
    eta = packing.mindlin_ratio
    change = 0.0
    before = _make_law(packing, choice, eta)
    for torsion, bending in {*itertools.product(twists, (own[1], most)), (0.0, 0.0)} - {own}:
        other = replace(packing, torsion=torsion, bending=bending)
        try:
            law = _make_law(other, choice, eta)
        except (MechanismError, PrecisionError):
            continue
        if before is not None and law is not None:
            change = max(
                change, float(np.max(np.abs(np.expm1(_follow(law)(x)[1] - _follow(before)(x)[1]))))
            )
    return change


def _find_xi(packing: Packing, choice: MediumChoice, eta: float) -> float:
    if dict(choice.options).get("local_field") == "paper":
        return paper_local_field(eta).xi
    return local_field(
        packing.structure, eta, bending=packing.bending, torsion=_find_own_torsion(packing)
    ).xi


def _find_own_torsion(packing: Packing) -> float:
    """Return the torsion that the effective medium takes: none for that of Hertz contacts, which is
    of the order delta/d.
    """
    return packing.torsion if isinstance(packing.torsion, float) else 0.0


def _make_law(packing: Packing, choice: MediumChoice, eta: float) -> Law | None:
    """Return the law of a medium at eta, in units of W and c W^(3/2); None if it is that of equal
    balls.
    """
    shape = (packing.spread or Uniform(1.0)).shape
    if choice.name == "afa":
        return AveragedLaw(1.0, 1.0, shape)
    xi = _find_xi(packing, choice, eta)
    return EffectiveLaw(1.0, 1.0, shape, xi) if xi else None


def _follow(law: Law) -> _Curve:
    def curve(x: Array) -> tuple[Array, Array, Array]:
        force = np.exp(x)
        overlap = np.asarray(law.overlap(force))
        stiffness = np.asarray(law.stiffness(overlap))
        return (
            overlap,
            np.log(stiffness),
            force * np.asarray(law.stiffness_slope(overlap)) / stiffness**2,
        )

    return curve


def _find_start(
    find: Callable[[float], Any], low: float, refusal: type[InputError]
) -> float | None:
    """Return the least ln f* from ``low`` on, in steps of a quarter, at which ``find`` raises no
    ``refusal``.
    """
    for x in np.arange(low, 5.0, 0.25):
        with suppress(refusal):
            find(x)
            return float(x)
    return None


def _tabulate(
    curves: list[_Curve],
    roots: list[float],
    low: float,
    high: float,
    checks: list[tuple[float, _Curve]] | None = None,
) -> dict[str, Any]:
    """Return "table" and the errors; ``checks`` are further curves, with their roots of eta, by
    which the error is found.
    """
    from scipy.interpolate import barycentric_interpolate

    # where contacts open, a law has a kink: nodes of ln f* are put closer there
    x = np.linspace(low, high, _NODES)
    while True:
        values = [np.array(curve(x)) for curve in curves]
        middle = 0.5 * (x[1:] + x[:-1])
        step = np.diff(x)
        errors = np.zeros(len(step))
        for one, curve in zip(values, curves, strict=True):
            # of a cubic of Hermite, in the middle between two nodes
            guess = 0.5 * (one[1][1:] + one[1][:-1]) + step / 8.0 * (one[2][:-1] - one[2][1:])
            errors = np.maximum(errors, np.abs(np.expm1(guess - curve(middle)[1])))
        worse = (errors > _TOLERANCE) & (step > _LEAST_STEP)
        if not np.any(worse) or len(x) + np.count_nonzero(worse) > _MOST_NODES:
            break
        x = np.sort(np.concatenate([x, middle[worse]]))
    table = {
        "log_force": x.tolist(),
        "roots": roots,
        **{
            name: [one[n].tolist() for one in values]
            for n, name in enumerate(("overlap", "log_stiffness", "slope"))
        },
    }
    error = float(np.max(errors))
    beside = 0.0
    found = np.array([one[1] for one in values])
    for root, curve in checks or []:
        beside = max(
            beside,
            float(
                np.max(np.abs(np.expm1(barycentric_interpolate(roots, found, root) - curve(x)[1])))
            ),
        )
    return {"table": table, "error": error, "friction_error": error + beside}


def _simulate(
    packing: Packing, choice: MediumChoice, least: float
) -> tuple[_Curve, float, float, float]:
    """Return the curve of a simulation, a spline through some loads, the ends of ln f*, and the
    error of half as many.
    """
    from scipy.interpolate import CubicSpline

    spread = packing.spread or Uniform(1e-3 * packing.diameter)
    # a narrow spread: the law in units of W does not depend on it
    width = min(spread.width, 1e-3 * packing.diameter)
    balls = replace(packing, spread=change_width(spread, width))
    units = WidthUnits(packing.law.coefficient, width)
    medium: Any = choice.of(balls)
    low = np.log(max(least, 1e-2))
    if medium.friction_history:  # samples can be loaded from their start on
        low = (
            _find_start(lambda x: medium.at_force(np.exp(x) * units.force), low, InputError) or low
        )
    x = np.linspace(low, EXPONENT * np.log(30.0), _SIMULATED)
    state = medium.at_force(np.exp(x) * units.force)
    overlap = np.asarray(state.overlap) / width
    log_stiffness = np.log(np.asarray(state.normal_stiffness) / units.stiffness)
    stiffness, lengths = CubicSpline(x, log_stiffness), CubicSpline(x, overlap)

    def curve(at: Array) -> tuple[Array, Array, Array]:
        return lengths(at), stiffness(at), stiffness(at, 1)

    coarse = CubicSpline(x[::2], log_stiffness[::2])
    error = float(np.max(np.abs(np.expm1(coarse(x[1::2]) - log_stiffness[1::2]))))
    return curve, float(x[0]), float(x[-1]), error
