"""Limits of the model: the conditions under which a state may be trusted, and how close the state is to each limit."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np

from granphon.balls.ball import BALL_LIMITS, WRONG_UNIT
from granphon.balls.hertz import MOST_CONTACT_RADIUS, contact_radius_ratio, harmonic_diameter, overlap_from
from granphon.balls.loads import Load
from granphon.balls.material import ONSET_OF_YIELD
from granphon.balls.packing import MINDLIN
from granphon.base.results import Result
from granphon.base.scales import prefixed
from granphon.media.left_out import LEFT_OUT_LIMIT, expect_shear_deficit, find_left_out
from granphon.media.simulation import DirectSimulation
from granphon.media.state import State, as_state, ideal_lattice
from granphon.networks.network import ContactNetwork

#: conditions on the contacts, by name: the limit; the quantity that it limits; what a warning says of it, with the worst
#: value and the limit; what fails beyond it. A rising load reaches the first four together, near delta/d = 1 %, where the
#: terms that the contact law leaves out are of that size too. What is said of the medium is in :attr:`Check.warning`
_LIMITS = {
    "contact_radius": (
        MOST_CONTACT_RADIUS, "contact radius over ball radius",
        "the radius of a contact is {part} of that of a ball, more than {limit_part}",
        "Hertz's law assumes that the contact is a small spot",
    ),
    "load": (
        0.3, "(f/E d^2)^(1/6)", "the ratio (f/E d^2)^(1/6) is {worst}, more than {limit}",
        "the balls must be much stiffer than their contacts",
    ),
    "velocity": (
        0.5, "sound velocity over bulk velocity",
        "sound is {worst} times as fast as in the material of the balls, more than {limit}",
        "waves must be slow against those inside a ball",
    ),
    "resonance": (
        0.5, "top frequency over the lowest resonance of a ball",
        "the top frequency is {part} of the lowest resonance of a ball, more than {limit_part}",
        "a ball must move as a rigid body",
    ),
    "spread": (
        0.03, "rms difference of diameters over their mean",
        "the rms difference of diameters is {part} of their mean, more than {limit_part}",
        "contacts are treated as those of nearly equal balls",
    ),
    "shear": (
        LEFT_OUT_LIMIT, "part by which the shear modulus of a simulation with friction is expected to be too small",
        "the simulated shear modulus is too small, by {about} (v_T by {half})",
        "contacts of loose balls are left out. Use geometry: exact",
    ),
    "places": (
        LEFT_OUT_LIMIT, "part by which a velocity depends on the numbering of the balls",
        "velocities depend on the numbering of the balls, by some {part}",
        "loose balls float in their cages as the array is pressed from the gas. Use geometry: exact",
    ),
    "torsion": (
        0.1, "overlap over diameter, over the torsion of a contact",
        "overlap over diameter is {part} of the torsion of a contact, more than {limit_part}",
        "other terms of the order of this torsion are left out",
    ),
    "table": (
        1.0, "overlap over the last of the table of its contact law",
        "the overlap of a contact is {worst} times the last of the table of its law, more than {limit}",
        "beyond its table the law goes on as a power",
    ),
    "yield": (
        ONSET_OF_YIELD, "mean contact pressure over yield strength",
        "the mean pressure in a contact is {worst} times the yield strength, more than {limit}",
        "beyond it the contact begins to flow plastically",
    ),
}  # fmt: skip
#: spread of log(k^3/f d*) of contacts that follow Hertz's law, over that of log f, at most, and what digits of a file add
_HERTZIAN, _ROUNDED = 0.5, 1e-2
#: part by which velocities of arrays that are pressed from the gas in the directions of the lattice changed where the same
#: balls were numbered otherwise: v_T of sc, 3 x 3 x 3 cells, mu = 0.3, f* = 0.1, the most of two arrays, by
#: ``tests/benchmarks/study_friction.py --only numbering``
_BY_NUMBERING = 0.04
#: what mends the torsion, in media that have terms of finite overlap
_KEEPS = "; finite_overlap=True keeps those of the static force and of the distance of balls"
#: directions in which sound is compared with that in the balls, by the number of periods
_DIRECTIONS = {1: [[1.0]], 2: [[1.0, 0.0]], 3: [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0]]}


def _write_force(force: float) -> str:
    """Text of a force, N, with four digits."""
    size, unit = (1.0, "N") if force == 0.0 or 0.01 <= force < 1e4 else prefixed(force, "N")
    return f"{force / size:.4g} {unit}"


@dataclass(frozen=True, eq=False, repr=False)
class Check(Result):
    """One condition of validity.

    Attributes
    ----------
    name : name of the condition.
    meaning : what the value is.
    value : a pure number with the shape of the load. It must not be above ``limit``, or with ``at_least`` not below it.
    limit : the limit, a pure number.
    reason : why the value is limited.
    at_least : whether the limit is a lower one.
    """

    _shapes = {"value": "..."}

    name: str
    meaning: str
    value: Any
    limit: float
    reason: str
    at_least: bool = False

    @property
    def ok(self) -> Any:
        """Whether the condition holds, with the shape of the load."""
        value = np.asarray(self.value)
        return np.asarray(value >= self.limit if self.at_least else value <= self.limit)[()]

    @property
    def failing(self) -> int:
        """Number of loads at which the condition fails."""
        return np.size(self.value) - int(np.count_nonzero(self.ok))

    def join(self, other: Check) -> Check:
        """Return the same condition over the loads of both."""
        return replace(self, value=np.concatenate([np.ravel(self.value), np.ravel(other.value)]))

    @property
    def warning(self) -> str | None:
        """Warning for the user, a sentence or two, or None if the condition holds at every load."""
        failing, loads = self.failing, np.size(self.value)
        if not failing:
            return None
        several, value = loads > 1, np.asarray(self.value)
        worst = float(value.min() if self.at_least else value.max())
        if self.name == "medium":
            force, least = _write_force(worst), _write_force(self.limit)
            lower = "the contact force is"
            if several:
                are = "is lower," if failing == 1 else "are lower, down to"
                lower = f"{failing} of the {loads} contact forces {are}"
            return f"{self.reason} below {least}: {lower} {force}."
        if self.name in BALL_LIMITS:
            _, what, unit, *_ = BALL_LIMITS[self.name]
            said = f"the {what} is {{worst}} {unit}, {'less' if self.at_least else 'more'} than {{limit}} {unit}"
        else:
            said = _LIMITS[self.name][2]
        several &= self.name not in ("spread", *BALL_LIMITS)  # which do not depend on the load
        up = "up to " if several and failing > 1 else ""
        words = {
            "worst": f"{up}{worst:.4g}", "part": f"{up}{100.0 * worst:.4g} %", "limit": f"{self.limit:g}",
            "limit_part": f"{100.0 * self.limit:g} %", "about": f"{up}about {100.0 * worst:.2g} %",
            "half": f"{100.0 * (1.0 - math.sqrt(max(1.0 - worst, 0.0))):.2g} %",
        }  # fmt: skip
        said = said.format_map(words)
        if several:
            which = f"all {loads}" if failing == loads else f"{failing} of {loads}"
            said = f"at {'both' if which == 'all 2' else which} loads {said}"
        return f"{said[0].upper()}{said[1:]}: {self.reason}."


@dataclass(frozen=True, eq=False, repr=False)
class Validity(Result):
    """The conditions under which the model holds.

    Attributes
    ----------
    checks : the conditions, each with the value that the state has and the limit.
    """

    _notebook_fields = ("ok", "warnings")

    checks: tuple[Check, ...]

    @property
    def ok(self) -> Any:
        """Whether every condition holds, with the shape of the load."""
        return np.logical_and.reduce([check.ok for check in self.checks])[()]

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each condition that fails; empty if all hold."""
        return tuple(one for check in self.checks if (one := check.warning) is not None)

    def __getitem__(self, name: str) -> Check:
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)


def validity(state: Any) -> Validity:
    """Compare the state with the limits of its medium (Section IV) and of the contact model (end of Section II).

    Of a crystal it is what :attr:`CrystalState.limits` has. Of a network, whose material is not known, it is the contact
    radius alone, if its contacts follow Hertz's law. The quantities compared with limits are:

    - if balls differ, the contact force against the least one at which the medium is valid
      (:attr:`ContactState.least_valid_force`), and the rms difference of diameters over their mean;
    - the contact radius over the ball radius;
    - (f/E d^2)^(1/6);
    - the sound velocity over the bulk velocity: the largest of the longitudinal and transverse ratios, along x on a line and
      in the plane, along (1, 0, 0), (0, 0, 1), (1, 1, 0) and (1, 1, 1) in space;
    - the top frequency of the branches over the lowest resonance of a free ball;
    - for a simulation that starts from the gas in the geometry of the lattice, the part by which velocities depend on the
      numbering of the balls, as far as that was seen;
    - with ``torsion="mindlin"`` and without finite overlap, the order delta/d of the terms that are left out over that
      torsion;
    - if the material has a ``yield_strength``, the mean contact pressure over it (K. L. Johnson, Contact Mechanics, 1985:
      yield begins at 1.07);
    - for a simulation with friction of balls that differ, in the geometry of the lattice, the part by which its shear
      modulus is expected to be too small, three times as much after a history of friction; not where no contact resists
      slip, as after a history with a friction coefficient of zero, unless its contacts stick;
    - Young modulus and density, which must be those of a solid, and the diameter, from 10 nm to 1 m: others are probably
      given in a wrong unit.
    """
    if (limits := getattr(state, "limits", None)) is not None:  # a crystal says itself what limits it
        return Validity(
            tuple(
                Check(name, f"{BALL_LIMITS[name][1]} in {BALL_LIMITS[name][2]}", value[()], limit, WRONG_UNIT, at_least)
                if name in BALL_LIMITS
                else _check(name, value[()])
                for name, value, limit, at_least, _ in limits
            )
        )
    return as_state(state).cached(_compute_validity)


def find_warnings(state: State) -> tuple[str, ...]:
    """Return one sentence for each limit that a state exceeds: its own, or else those of :func:`validity`."""
    own = getattr(state, "warnings", None)
    return validity(state).warnings if own is None else own


def expect_warnings(simulation: DirectSimulation, load: Load) -> tuple[str, ...]:
    """Return the warnings that a simulation will have at the values of an applied load, as far as known before it is run."""
    if not simulation.resists_slip:
        return ()
    deficit = find_left_out(expect_shear_deficit(simulation.packing, load, simulation.friction_history), simulation.geometry)
    warning = _check("shear", deficit).warning
    return () if warning is None else (warning,)


def _check(name: str, value: Any, more: str = "") -> Check:
    limit, meaning, _, reason = _LIMITS[name]
    return Check(name, meaning, value, limit, reason + more)


def _compute_validity(state: Any) -> Validity:
    if not state.follows_law:
        return check_network(state.network)
    material, d = state.packing.material, state.packing.diameter
    lattice = state.loaded_lattice.without_overlap
    radius = np.asarray(contact_radius_ratio(state.overlap_of_equal_balls, d))
    values = {
        "contact_radius": radius,
        # divide one factor at a time: E d^2 may be beyond the floating range though the ratio is not
        "load": np.cbrt(np.sqrt(state.force / (material.young_modulus * d) / d)),
    }
    if not lattice.mechanism:  # a mechanism has no sound
        v, names = state.long_waves(_DIRECTIONS[lattice.periods]), lattice.wave_names
        bulk = [material.longitudinal_velocity if name == "longitudinal" else material.transverse_velocity for name in names]
        values["velocity"] = np.max(v / bulk, axis=(-2, -1))
    # the top frequency of the branches at each load, (k/M)^1/2, without terms of finite overlap. Where the torsion depends
    # on the load, the square is interpolated between none and the largest torsion: it is a convex function, so that the
    # result is not below the top frequency
    top, torsion = lattice.top_frequency, np.asarray(state.torsion)
    if not state.loaded_lattice.is_one and np.ptp(torsion) > 0.0:
        ends = [ideal_lattice(state.packing).top_frequency ** 2, top**2]
        top = np.sqrt(np.interp(torsion, [0.0, np.max(torsion)], ends))
    values["resonance"] = top * state.loaded_lattice.velocity_scale / d / (2.0 * np.pi) / material.lowest_resonance(d)
    if state.packing.spread is not None:
        values["spread"] = np.full(state.shape, state.packing.spread.rms / d)
    if (deficit := state.shear_deficit) is not None:
        values["shear"] = deficit
    if state.floats:
        values["places"] = np.full(state.shape, _BY_NUMBERING)
    if state.packing.torsion == MINDLIN and not state.finite_overlap:
        # where balls differ the mean overlap may be negative: take 3 f/2 k, the overlap of equal balls
        values["torsion"] = overlap_from(state.force, state.normal_stiffness) / d / state.torsion
    if material.yield_strength is not None:
        spot = radius * d / 2.0
        values["yield"] = state.force / spot / (np.pi * spot) / material.yield_strength
    keeps = {"torsion": _KEEPS} if not state.n_samples else {}
    checks = [_check(name, np.asarray(value), keeps.get(name, "")) for name, value in values.items()]
    if state.packing.width:
        reason = f"{state.medium} is not reliable"
        force = np.asarray(state.force)
        checks.insert(0, Check("medium", "contact force in N", force, state.least_valid_force, reason, at_least=True))
    for name, (attribute, what, unit, limit, at_least) in BALL_LIMITS.items():
        value = np.full(state.shape, attrgetter(attribute)(state.packing))
        checks.append(Check(name, f"{what} in {unit}", value, limit, WRONG_UNIT, at_least))
    return Validity(tuple(checks))


def check_network(network: ContactNetwork) -> Validity:
    """Return the limits of a network, whose material is not known: that of the mean contact radius, or none.

    The overlap follows from force and stiffness, 3 f/2 k. So the contacts must be those of Hertz's law: k^3/(f d*) is then
    the same for all, and varies less than forces do.
    """
    pressed = (network.normal_force > 0.0) & np.isfinite(network.distance)
    if not np.any(pressed):
        return Validity(())
    force, stiffness = network.normal_force[pressed], network.normal_stiffness[pressed]
    diameter = harmonic_diameter(*(2.0 * network.radii[end[pressed]] for end in (network.i, network.j)))
    law = 3.0 * np.log(stiffness) - np.log(force) - np.log(diameter)
    if np.std(law) > _HERTZIAN * np.std(np.log(force)) + _ROUNDED:
        return Validity(())
    ratio = contact_radius_ratio(np.mean(overlap_from(force, stiffness) / diameter), 1.0)
    return Validity((_check("contact_radius", ratio),))
