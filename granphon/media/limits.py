"""Limits of the model: the quantities that are compared with limits, and the warnings about a state
beyond a limit.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from granphon.balls.ball import BALL_LIMITS, WRONG_UNIT
from granphon.balls.hertz import MOST_CONTACT_RADIUS
from granphon.balls.material import ONSET_OF_YIELD
from granphon.base.errors import message
from granphon.base.results import Result, held, result_class
from granphon.base.scales import prefixed, write_in
from granphon.media.left_out import LEFT_OUT_LIMIT


class _Limit(NamedTuple):
    """The limit ``value`` of a ``quantity``, in its unit.

    ``sentence`` is the text of a warning, with fields for the worst value and the limit, which
    :meth:`Check._write_sentence` fills. ``reason`` says why there is a limit.
    """

    value: float
    quantity: str
    sentence: str
    reason: str


#: conditions on the contacts, by name. A rising load reaches the first four limits together, near
#: delta/d = 1 %, where the terms that the contact law leaves out are of that size too. The sentence
#: about a medium is in :attr:`Check.warning`
_LIMITS = {
    "contact_radius": _Limit(
        MOST_CONTACT_RADIUS,
        "contact radius over ball radius",
        "the radius of a contact is {percent} of that of a ball, more than {limit_percent}",
        "Hertz's law assumes that the contact is a small spot",
    ),
    "load": _Limit(
        0.3,
        "(f/E d^2)^(1/6)",
        "the ratio (f/E d^2)^(1/6) is {worst}, more than {limit}",
        "the balls must be much stiffer than their contacts",
    ),
    "velocity": _Limit(
        0.5,
        "sound velocity over bulk velocity",
        "sound is {worst} times as fast as in the material of the balls, more than {limit}",
        "waves must be slow against those inside a ball",
    ),
    "resonance": _Limit(
        0.5,
        "top frequency over the lowest resonance of a ball",
        "the top frequency is {percent} of the lowest resonance of a ball, more than"
        " {limit_percent}",
        "a ball must move as a rigid body",
    ),
    "spread": _Limit(
        0.03,
        "rms difference of diameters over their mean",
        "the rms difference of diameters is {percent} of their mean, more than {limit_percent}",
        "contacts are treated as those of nearly equal balls",
    ),
    "shear": _Limit(
        LEFT_OUT_LIMIT,
        "part by which the shear modulus of a simulation with friction is expected to be too small",
        "the simulated shear modulus is too small, by {about} (v_T by {half})",
        "contacts of loose balls are left out. Use geometry: exact",
    ),
    "places": _Limit(
        LEFT_OUT_LIMIT,
        "part by which a velocity depends on the numbering of the balls",
        "velocities depend on the numbering of the balls, by {about}",
        "loose balls float in their cages as the array is pressed from the gas. Use geometry:"
        " exact",
    ),
    "torsion": _Limit(
        0.1,
        "overlap over diameter, over the torsion of a contact",
        "overlap over diameter is {percent} of the torsion of a contact, more than {limit_percent}",
        "other terms of the order of this torsion are left out",
    ),
    "table": _Limit(
        1.0,
        "overlap over the last of the table of its contact law",
        "the overlap of a contact is {worst} times the last of the table of its law, more"
        " than {limit}",
        "beyond its table the law goes on as a power",
    ),
    "yield": _Limit(
        ONSET_OF_YIELD,
        "mean contact pressure over yield strength",
        "the mean pressure in a contact is {worst} times the yield strength, more than {limit}",
        "beyond it the contact begins to flow plastically",
    ),
}


def _write_force(force: float, chosen_unit: str = "") -> str:
    """Return the text of a ``force``, N, with four digits, in the ``chosen_unit`` of the user. If
    that is empty, the unit is N, if need be with a prefix.
    """
    if chosen_unit:
        return write_in(force, "N", chosen_unit, 4)
    rounded = float(f"{force:.4g}")
    if rounded == 0.0 or 0.01 <= rounded < 1e4:
        return f"{rounded:.4g} N"
    size, unit = prefixed(rounded, "N")
    return f"{rounded / size:.4g} {unit}"


@result_class
class Check(Result):
    """One condition of validity.

    Attributes
    ----------
    name : name of the condition.
    meaning : the quantity that is limited.
    value : a number with the shape of the load, which must not be above ``limit``, or with
        ``at_least`` not below ``limit``. It is a pure number, or, as ``meaning`` says, in SI.
    limit : the limit, in the unit of the value.
    reason : why the value is limited, or, of a network, what a value beyond the limit does to
        frequencies.
    at_least : whether the limit is a lower one.
    fault : what is wrong where the condition of a network fails, in words; empty for others.
    typical : of a network, the rms over balls, where the value is that of the worst ball; else
        None.
    worst : of a network, the balls, or pairs of balls that touch, that are farthest from the
        others, the farthest first: their labels, or indices where there are none.
    """

    name: str = held(str)
    meaning: str = held(str)
    value: Any = held(Any, "...")
    limit: float = held(float)
    reason: str = held(str)
    at_least: bool = held(bool, default=False)
    fault: str = held(str, default="")
    typical: float | None = held(float, "?", default=None)
    worst: tuple[tuple[int, ...], ...] = held(((int, ...), ...), default=())

    @property
    def ok(self) -> Any:
        """Whether the condition holds, with the shape of the load; a plain truth value for one
        load.
        """
        value = np.asarray(self.value)
        is_met = value >= self.limit if self.at_least else value <= self.limit
        return is_met if np.ndim(is_met) else bool(is_met)

    @property
    def failing(self) -> int:
        """Number of loads at which the condition fails."""
        return np.size(self.value) - int(np.count_nonzero(self.ok))

    @property
    def worst_index(self) -> int:
        """Index, in the values in C order, of the value that is farthest beyond the limit, or
        nearest to it if all hold.
        """
        value = np.ravel(self.value)
        return int(np.argmin(value) if self.at_least else np.argmax(value))

    @property
    def _worst_value(self) -> float:
        """The value at the :attr:`worst_index`, in the unit of the value."""
        return float(np.ravel(self.value)[self.worst_index])

    @property
    def excess(self) -> float:
        """How far the worst value is beyond the limit: the ratio of the two, above 1 if the
        condition fails there; infinite where the one that should be larger is zero or below, also
        if both are zero and the condition holds.
        """
        # the value that should be the larger one is the divisor
        divisor, dividend = self.limit, self._worst_value
        if self.at_least:
            divisor, dividend = dividend, divisor
        return dividend / divisor if divisor > 0.0 else math.inf

    def join(self, other: Check) -> Check:
        """Return the condition with the values of this one followed by those of ``other``, which
        is the same condition at other loads.
        """
        return replace(self, value=np.concatenate([np.ravel(self.value), np.ravel(other.value)]))

    @property
    def warning(self) -> str | None:
        """Warning for the user, a sentence or two, or None if the condition holds at every load."""
        return self.tell()

    def tell(self, where: str = "", force_unit: str = "") -> str | None:
        """Return the warning for the user, a sentence or two; None if the condition holds at every
        load.

        ``where`` says in words at which loads the condition fails, and stands in brackets. The
        words are left out for a network, for a condition that does not depend on the load, and for
        a single load unless the condition is that of the medium. ``force_unit`` is the unit of
        contact forces; if it is empty, the unit is N, if need be with a prefix.
        """
        if not self.failing:
            return None
        if self.fault:  # the condition of a network has words of its own
            return message(self.fault, self.reason)
        place = f" ({where})" if where else ""
        if self.name == "medium":
            return f"{self._warn_of_medium(force_unit)}{place}."
        bound = ""
        share = ""
        # the spread and the constants of a ball do not depend on the load
        depends_on_load = self.name not in ("spread", *BALL_LIMITS)
        n_loads = np.size(self.value)
        if depends_on_load and n_loads > 1:
            bound = "up to " if self.failing > 1 else ""
            share = f"{_write_share(self.failing, n_loads)}{place} "
        sentence = f"{share}{self._write_sentence(bound)}"
        return f"{sentence[0].upper()}{sentence[1:]}: {self.reason}."

    def tell_states(self, share: str, place: str, force_unit: str = "") -> str:
        """Return the warning about those states of a sweep at which the condition fails.

        ``share`` says in words at how many states, and at which. The value of this check is the
        worst of theirs, and ``place`` says in words at which state this is; ``place`` is empty if
        there is no other state to tell it from. The ``force_unit`` is as in :meth:`tell`.
        """
        if self.name == "medium":
            at_place = f" ({place})" if place else ""
            force = _write_force(self._worst_value, force_unit)
            least_force = _write_force(self.limit, force_unit)
            return (
                f"{self.reason} {share}: the contact force is {force} where it must be"
                f" {least_force} or more{at_place}."
            )
        sentence = f"{share} {self._write_sentence('up to ' if place else '')}"
        ending = f" The worst is at {place}." if place else ""
        return f"{sentence[0].upper()}{sentence[1:]}: {self.reason}.{ending}"

    def _write_sentence(self, bound: str) -> str:
        """Return in words what is beyond the limit, with the worst value and the limit. ``bound``,
        "up to " or empty, stands before the value.
        """
        worst = self._worst_value
        if self.name in BALL_LIMITS:
            _, quantity, unit, *_ = BALL_LIMITS[self.name]
            relation = "less" if self.at_least else "more"
            limit = f"{self.limit:g} {unit}"
            return f"the {quantity} is {bound}{worst:.4g} {unit}, {relation} than {limit}"
        # of a missing part of the shear modulus, as whose square root a velocity goes; other values
        # may be above 1, and have no such deficit in their sentence
        velocity_deficit = 1.0 - math.sqrt(max(1.0 - worst, 0.0))
        words = {
            "worst": f"{bound}{worst:.4g}",
            "percent": f"{bound}{100.0 * worst:.4g} %",
            "limit": f"{self.limit:g}",
            "limit_percent": f"{100.0 * self.limit:g} %",
            "about": f"{bound}about {100.0 * worst:.2g} %",
            "half": f"{100.0 * velocity_deficit:.2g} %",
        }
        return _LIMITS[self.name].sentence.format_map(words)

    def _warn_of_medium(self, force_unit: str) -> str:
        """Return the warning, without its full stop, that contact forces are below the range of the
        medium, with their number and the least of them. The ``force_unit`` is as in :meth:`tell`.
        """
        clause = "the contact force is"
        n_loads = np.size(self.value)
        if n_loads > 1:
            verb = "is lower," if self.failing == 1 else "are lower, down to"
            clause = f"{self.failing} of the {n_loads} contact forces {verb}"
        force = _write_force(self._worst_value, force_unit)
        limit = _write_force(self.limit, force_unit)
        return f"{self.reason} below {limit}: {clause} {force}"


def check_limit(name: str, value: Any, addition: str = "") -> Check:
    """Return the condition called ``name`` of :data:`_LIMITS` or
    :data:`~granphon.balls.ball.BALL_LIMITS` for a ``value``, of the shape of the load, in the unit
    of the limit. The words ``addition`` end its reason.
    """
    if name in BALL_LIMITS:
        _, quantity, unit, limit, at_least = BALL_LIMITS[name]
        return Check(name, f"{quantity} in {unit}", value, limit, WRONG_UNIT + addition, at_least)
    condition = _LIMITS[name]
    return Check(name, condition.quantity, value, condition.value, condition.reason + addition)


def _write_share(failing: int, loads: int) -> str:
    """Return in words that a condition fails at ``failing`` of several ``loads``."""
    if failing < loads:
        return f"at {failing} of {loads} loads"
    return "at both loads" if loads == 2 else f"at all {loads} loads"
