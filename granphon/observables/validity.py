"""Limits of the model: the conditions under which a state may be trusted, and how close the state
is to each limit.
"""

from __future__ import annotations

from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.balls.ball import BALL_LIMITS
from granphon.balls.hertz import contact_radius_ratio, harmonic_diameter, overlap_from
from granphon.balls.loads import Load
from granphon.balls.packing import MINDLIN
from granphon.base.arrays import Array
from granphon.base.results import Result, held, result_class
from granphon.media.left_out import expect_shear_deficit, find_left_out
from granphon.media.limits import Check, check_limit
from granphon.media.state import as_state, ideal_lattice
from granphon.networks.consistency import Comparison, compare_forces, compare_numbers
from granphon.networks.network import ContactNetwork

if TYPE_CHECKING:
    from granphon.media.simulation import DirectSimulation

#: contacts follow Hertz's law if the standard deviation of log(k^3/f d*) is no larger than
#: ``_HERTZ_SCATTER`` times that of log f, plus ``_ROUNDING_SCATTER``, which allows for the digits
#: of a file
_HERTZ_SCATTER = 0.5
_ROUNDING_SCATTER = 1e-2
#: relative change of a velocity that was seen when the same balls were numbered otherwise, in
#: arrays that are pressed from the gas in the directions of the lattice: the larger change of v_T
#: in two arrays of sc, 3 x 3 x 3 cells, mu = 0.3, f* = 0.1, found by
#: ``tests/benchmarks/study_friction.py --only numbering``
_NUMBERING_EFFECT = 0.08
#: end of the warning about a large torsion, for media that have terms of finite overlap
_MEND_OF_TORSION = (
    "; finite_overlap=True keeps those of the static force and of the distance of balls"
)
#: directions in which sound is compared with that in the balls, by the number of periods
_DIRECTIONS = {
    1: [[1.0]],
    2: [[1.0, 0.0]],
    3: [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0]],
}


@result_class
class Validity(Result):
    """The conditions under which the model holds.

    Attributes
    ----------
    checks : the conditions, each with the value that the state has and the limit.
    """

    _notebook_fields = ("ok", "warnings")

    checks: tuple[Check, ...] = held((Check, ...))

    @property
    def ok(self) -> Any:
        """Whether every condition holds, with the shape of the load; a plain truth value for one
        load.
        """
        holds = np.logical_and.reduce([check.ok for check in self.checks])
        return holds if np.ndim(holds) else bool(holds)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """A warning, of a sentence or two, for each condition that fails; empty if all hold."""
        warnings = (check.warning for check in self.checks)
        return tuple(warning for warning in warnings if warning is not None)

    def __getitem__(self, name: str) -> Check:
        """Return the condition called ``name``; KeyError if there is no such condition."""
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)


def validity(state: Any) -> Validity:
    """Return how a state, a sample or a network compares with the limits of its medium (Section IV)
    and of the contact model (end of Section II).

    For a crystal the limits are :attr:`CrystalState.limits`. For other states whose contacts follow
    a law the quantities compared with limits are:

    - if balls differ, the contact force against the least one at which the medium is valid
      (:attr:`ContactState.least_valid_force`), and the rms difference of diameters over their mean;
    - the contact radius over the ball radius;
    - (f/E d^2)^(1/6);
    - the sound velocity over the bulk velocity: the largest of the longitudinal and transverse
      ratios, along x on a line and in the plane, along (1, 0, 0), (0, 0, 1), (1, 1, 0) and (1, 1,
      1) in space;
    - the top frequency of the branches over the lowest resonance of a free ball;
    - for a simulation that starts from the gas in the geometry of the lattice, the part by which
      velocities depend on the numbering of the balls, as far as that was seen;
    - with ``torsion="mindlin"`` and without finite overlap, the order delta/d of the terms that are
      left out over that torsion;
    - if the material has a ``yield_strength``, the mean contact pressure over it (K. L. Johnson,
      Contact Mechanics, 1985: yield begins at 1.07);
    - for a simulation with friction of balls that differ, in the geometry of the lattice, the part
      by which its shear modulus is expected to be too small, three times as much after a history of
      friction; not where no contact resists slip, as after a history with a friction coefficient of
      zero, unless its contacts stick;
    - Young modulus and density, which must be those of a solid, and the diameter, from 10 nm to 1
      m: others are probably given in a wrong unit.

    For a network, with or without periods, and for one sample of a simulation, the quantities are
    these, as far as the numbers of the network are known; each condition names the balls that are
    farthest from the others, and its reason says what a failure does to frequencies:

    - "balance", "torques": the largest sum of the static forces on a ball over the mean force of a
      contact, without the acceleration that weights give, and that of the torques; ``typical`` is
      the rms. Where tangential forces are not known, or ends are open, only with prestress; torques
      not where contacts resist rolling or twist and their static torques are not known;
    - "law", "scatter": of a network that was read, the force over that of the law at the overlap of
      the places, of contacts with the median force or more: the median, less one, and the median
      deviation of the inverse. "single forces": number of contacts for which that ratio is ten, or
      a tenth, beside the median. "stiffness": the stiffness over that of Hertz's law, and "single
      stiffnesses" as single forces. "rounding": the part of the forces that the digits of places
      leave open;
    - "masses", "inertias": of a network that was read, over those of solid spheres of the material:
      the median, less one. "single masses", "single inertias": number of balls with ten times the
      median, or a tenth, or with a moment of inertia above 2/3 m r^2;
    - "rattlers": number of balls that carry no load; "pieces": number of sets of balls that do not
      touch; "contacts": contacts per ball, at least the isostatic number;
    - the contact radius at the mean overlap over the ball radius, if contacts follow Hertz's law.

    Raises :class:`~granphon.base.errors.InputError` for what is neither a state nor has a network.
    """
    if isinstance(state, ContactNetwork):
        return state.cached(check_network)
    limits = getattr(state, "limits", None)  # a crystal knows its limits
    if limits is not None:
        return Validity(limits)
    return as_state(state).cached(_compute_validity)


def find_warnings(state: Any) -> tuple[str, ...]:
    """Return a warning for each limit that a ``state`` exceeds: its own ``warnings`` if it has
    them, as the state of a crystal does; otherwise those of :func:`validity`. For a state without a
    contact law the warnings are those of :func:`network_warnings`.
    """
    warnings = getattr(state, "warnings", None)
    if warnings is not None:
        return tuple(warnings)
    if state.follows_law:
        return validity(state).warnings
    return network_warnings(state.network)


def expect_checks(simulation: DirectSimulation, load: Load) -> tuple[Check, ...]:
    """Return the conditions that a simulation will not meet at the values of an applied load, as
    far as this is known before the simulation is run; empty if it will meet them, and if no contact
    resists slip.
    """
    if not simulation.resists_slip:
        return ()
    shear_deficit = expect_shear_deficit(simulation.packing, load, simulation.friction_history)
    left_out = find_left_out(shear_deficit, simulation.geometry)
    check = check_limit("shear", left_out)
    return (check,) if check.failing else ()


def _compute_validity(state: Any) -> Validity:
    """Return the limits of a state whose contacts follow a law, or of a network; see
    :func:`validity`.
    """
    if not state.follows_law:
        return check_network(state.network)
    checks = []
    if state.packing.width:
        reason = f"{state.medium} is not reliable"
        force = np.asarray(state.force)
        least_force = state.least_valid_force
        checks.append(
            Check("medium", "contact force in N", force, least_force, reason, at_least=True)
        )
    # only media with a contact law can keep the terms of finite overlap
    remedies = {} if state.n_samples else {"torsion": _MEND_OF_TORSION}
    for name, ratio in _find_limited_ratios(state).items():
        checks.append(check_limit(name, np.asarray(ratio), remedies.get(name, "")))
    # each row begins with the place of the property in a packing, such as "material.density"
    for name, (attribute, *_) in BALL_LIMITS.items():
        property_of_balls = attrgetter(attribute)(state.packing)
        checks.append(check_limit(name, np.full(state.shape, property_of_balls)))
    return Validity(tuple(checks))


def _find_limited_ratios(state: Any) -> dict[str, Any]:
    """Return the pure numbers that are compared with limits, each of the shape of the loads, by the
    names of the limits, in the order of the conditions; see :func:`validity`. A number that a state
    does not have is left out.
    """
    packing = state.packing
    ratios: dict[str, Any] = {
        "contact_radius": _find_radius_ratio(state),
        "load": _find_load_ratio(state),
    }
    if not state.reference_lattice.mechanism:  # a mechanism has no sound
        ratios["velocity"] = _find_velocity_ratio(state)
    ratios["resonance"] = _find_resonance_ratio(state)
    if packing.width:
        ratios["spread"] = np.full(state.shape, packing.spread.rms / packing.diameter)
    if state.shear_deficit is not None:
        ratios["shear"] = state.shear_deficit
    if state.floats:
        ratios["places"] = np.full(state.shape, _NUMBERING_EFFECT)
    if packing.torsion == MINDLIN and not state.finite_overlap:
        ratios["torsion"] = _find_torsion_ratio(state)
    if packing.material.yield_strength is not None:
        ratios["yield"] = _find_yield_ratio(state)
    return ratios


def _find_radius_ratio(state: Any) -> Array:
    """Return the contact radius over the ball radius, of the shape of the loads."""
    overlap = state.overlap_of_equal_balls
    return np.asarray(contact_radius_ratio(overlap, state.packing.diameter))


def _find_load_ratio(state: Any) -> Array:
    """Return (f/E d^2)^(1/6), of the shape of the loads."""
    d = state.packing.diameter
    # divide one factor at a time: E d^2 may be beyond the floating range though the ratio is not
    load_over_stiffness = state.force / (state.packing.material.young_modulus * d) / d
    return np.asarray(np.cbrt(np.sqrt(load_over_stiffness)))  # the sixth root


def _find_resonance_ratio(state: Any) -> Array:
    """Return the top frequency of the branches over the lowest resonance of a free ball, of the
    shape of the loads.
    """
    d = state.packing.diameter
    top_frequency = _find_top_frequency(state) * state.velocity_scale / d / (2.0 * np.pi)  # Hz
    return np.asarray(top_frequency / state.packing.material.lowest_resonance(d))


def _find_torsion_ratio(state: Any) -> Array:
    """Return the relative overlap of equal balls over the torsion of a contact, over k d^2, of the
    shape of the loads.
    """
    # 3 f/2 k is the overlap of equal balls: the mean overlap of balls that differ may be negative
    overlap = overlap_from(state.force, state.normal_stiffness)
    return np.asarray(overlap / state.packing.diameter / state.torsion)


def _find_yield_ratio(state: Any) -> Array:
    """Return the mean contact pressure over the yield strength of the material, of the shape of the
    loads.
    """
    contact_radius = _find_radius_ratio(state) * state.packing.diameter / 2.0
    contact_pressure = state.force / contact_radius / (np.pi * contact_radius)
    return np.asarray(contact_pressure / state.packing.material.yield_strength)


def _find_velocity_ratio(state: Any) -> Array:
    """Return the largest ratio of a sound velocity to that of the same wave in the bulk of the
    material, of the shape of the loads.
    """
    lattice = state.reference_lattice
    material = state.packing.material
    bulk_velocities = []
    for name in lattice.wave_names:
        if name == "longitudinal":
            bulk_velocities.append(material.longitudinal_velocity)
        else:
            bulk_velocities.append(material.transverse_velocity)
    # (..., directions, waves), m/s
    velocities = state.long_waves(_DIRECTIONS[lattice.periods])
    return np.asarray(np.max(velocities / bulk_velocities, axis=(-2, -1)))


def _find_top_frequency(state: Any) -> Any:
    """Return the top frequency of the branches at each load, (k/M)^1/2, without terms of finite
    overlap.

    Where the torsion depends on the load, the squared frequency is interpolated between zero
    torsion and the largest torsion. The squared frequency is a convex function of the torsion, so
    that the result is not below the top frequency.
    """
    top = state.reference_lattice.top_frequency  # of the largest torsion
    torsions = np.asarray(state.torsion)
    is_torsion_constant = np.ptp(torsions) == 0.0
    if state.has_one_lattice or is_torsion_constant:
        return top
    top_without_torsion = ideal_lattice(state.packing).top_frequency
    end_squares = [top_without_torsion**2, top**2]
    squares = np.interp(torsions, [0.0, np.max(torsions)], end_squares)
    return np.sqrt(squares)


def check_network(network: ContactNetwork) -> Validity:
    """Return the checks of a network: those of numbers that may contradict each other
    (:func:`~granphon.networks.consistency.compare_numbers`), and the limit of the contact radius at
    the mean overlap, if the contacts follow Hertz's law.
    """
    comparisons = [_make_check(comparison) for comparison in compare_numbers(network)]
    return Validity((*comparisons, *_check_contact_radius(network)))


def _make_check(comparison: Comparison) -> Check:
    """Return a comparison of numbers of a network as a condition."""
    return Check(**vars(comparison))


def _check_contact_radius(network: ContactNetwork) -> tuple[Check, ...]:
    """Return the limit of the contact radius at the mean overlap of a network, whose material is
    not known; none if the contacts do not follow Hertz's law.

    The overlap is found from the force f and the stiffness k, 3 f/2 k, which holds for Hertz's law
    alone. Under that law k^3/(f d*), with the harmonic mean d* of the two diameters, is the same
    for all contacts of one material: contacts follow the law if the logarithm of this number varies
    less than that of the forces. Contacts that are all alike count as Hertz's, as nothing tells
    their law.
    """
    # a contact with a flat wall, whose centre is infinitely far, may be of another material
    is_pressed = (network.normal_force > 0.0) & np.isfinite(network.distance)
    if not np.any(is_pressed):
        return ()
    force = network.normal_force[is_pressed]
    stiffness = network.normal_stiffness[is_pressed]
    diameter_i = 2.0 * network.radii[network.i[is_pressed]]
    diameter_j = 2.0 * network.radii[network.j[is_pressed]]
    diameter = harmonic_diameter(diameter_i, diameter_j)
    log_material = 3.0 * np.log(stiffness) - np.log(force) - np.log(diameter)
    if np.std(log_material) > _HERTZ_SCATTER * np.std(np.log(force)) + _ROUNDING_SCATTER:
        return ()
    mean_relative_overlap = np.mean(overlap_from(force, stiffness) / diameter)
    ratio = contact_radius_ratio(mean_relative_overlap, 1.0)
    return (check_limit("contact_radius", ratio),)


def network_warnings(network: ContactNetwork) -> tuple[str, ...]:
    """Return a warning if the contact radius of a network exceeds its limit, and one if static
    forces act and are out of balance.
    """
    checks = _check_contact_radius(network)
    if not network.is_balanced:
        checks += (_make_check(compare_forces(network)),)
    return Validity(checks).warnings
