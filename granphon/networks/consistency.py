"""Comparisons that tell whether the numbers of a network agree with each other: whether its forces
are in balance, and are those of the law at its overlaps; whether its masses are those of the
material; and whether its contacts hold its balls.

Each comparison is of one number with a limit. It names the balls that are farthest beyond the
limit, and says what the fault does to frequencies. By Hertz's law a stiffness goes as the third
root of the force, so that frequencies go as the sixth root of forces; they go as the inverse root
of masses.

A ``network`` is a :class:`~granphon.networks.network.ContactNetwork`, which stands above this
module.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from granphon.balls.hertz import EXPONENT, FREQUENCY_EXPONENT, HertzLaw, harmonic_diameter
from granphon.balls.material import Material
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InconsistencyWarning, message, warn_caller
from granphon.base.text import counted
from granphon.networks.faults import MOST_NAMED
from granphon.networks.sources import (
    LARGEST_NUMBER,
    SOLID_INERTIA,
    find_errors_of_overlaps,
    find_rounding,
)

#: sum of the forces on a ball, over the mean force of a contact, up to which they are in balance
#: where static forces act: programs of discrete elements leave 1e-4 or less, and weights, walls or
#: digits that a file lacks leave more
BALANCE_LIMIT = 1e-3
#: the same sum, and the sum of the torques on a ball over the mean force and the mean radius, from
#: which on the balls of a packing that nothing else holds still move; rounding to three digits
#: leaves less
REST_LIMIT = 5e-3
#: greatest difference of a median ratio from one, and greatest scatter about the median: 5 %, less
#: a little, so that the rounding of a ratio of 1.05 does not matter
_RATIO_TOLERANCE = 0.049
#: greatest error of forces by the rounding of places: frequencies have a sixth of it, 0.1 %
_ROUNDING_LIMIT = 6e-3
#: least scatter of forces about those of the law at the overlaps, relative; with less the forces
#: were computed from the overlaps
_LEAST_SCATTER = 1e-9
#: greatest factor between the force of a contact and that of the law at its overlap
_MOST_FACTOR = 10.0
#: least force, over the mean, of a contact that is compared by itself with this factor: weaker
#: contacts may not have come to rest
_LEAST_FORCE = 1e-3
#: least overlap of places over the distance: places with less have none, as those of a lattice
_LEAST_OVERLAP = 1e-10
#: moment of inertia of a thin hollow sphere, 2/3 m r^2, the greatest of all, over that of a solid
#: one
_HOLLOW_INERTIA = 2.0 / (3.0 * SOLID_INERTIA)
#: names of the comparisons of what stands in the source of balls
_COMPARISONS_OF_BALLS = ("masses", "single masses", "inertias", "single inertias", "rounding")


@dataclass(frozen=True)
class Comparison:
    """One comparison of the numbers of a network with each other.

    Attributes
    ----------
    name : name of the comparison.
    meaning : the quantity that is limited.
    value : a pure number, which must not be above ``limit``, or with ``at_least`` not below it.
    limit : the limit.
    fault : what is wrong where the value is beyond the limit, in words; elsewhere not to be read.
    reason : what the fault does to frequencies, and how to mend it, in words.
    typical : the rms over balls, where the value is that of the worst ball; None elsewhere.
    worst : the balls, or pairs of balls that touch, that deviate most, three at most, the worst
        first; each a tuple of one or two labels, or indices where balls have no labels. Empty for
        a comparison that names none.
    at_least : whether the limit is a lower one.
    """

    name: str
    meaning: str
    value: float
    limit: float
    fault: str
    reason: str
    typical: float | None = None
    worst: tuple[tuple[int, ...], ...] = ()
    at_least: bool = False

    @property
    def holds(self) -> bool:
        """Whether the value is within the limit."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit


def compare_numbers(network: Any) -> tuple[Comparison, ...]:
    """Return the comparisons of the numbers of a network, as far as its numbers are known.

    The sums of static forces on balls are compared with prestress; without prestress they are
    compared if all static forces are known, and the network has no open ends. The sums of torques
    are compared, too, if tangential forces are known, and static torques are known or no contact
    resists rolling or twist. Overlaps, stiffnesses, masses and moments of inertia are not compared
    if the ``contact_model`` takes the curvatures of contacts from the kinds of the balls
    (``own_radii`` is false), as in networks of granphon's own packings: there the contacts follow
    their law, and balls need not be solid.
    """
    return tuple(_list_comparisons(network))


def warn_of_faults(network: Any) -> None:
    """Warn of each comparison that a ``network`` fails, which has a
    :attr:`~granphon.networks.network.ContactNetwork.reading`. The warning begins with the name of
    the source in which the fault stands, that of balls or that of contacts.

    There is no warning of rattlers, which are in the network only if they were asked for. There is
    none of too few contacts either, if all balls that move have the same number of contacts, as in
    a lattice, and the sums of forces are within their limit or are not compared: the modes of
    frequency zero of a lattice are known.
    """
    failures = {each.name: each for each in compare_numbers(network) if not each.holds}
    failures.pop("rattlers", None)
    if "balance" not in failures and _is_regular(network):
        failures.pop("contacts", None)
    for name, comparison in failures.items():
        is_of_balls = name in _COMPARISONS_OF_BALLS
        source = network.reading.balls if is_of_balls else network.reading.contacts
        fault = comparison.fault[0].lower() + comparison.fault[1:]
        warn_caller(message(f"{source}: {fault}", comparison.reason), InconsistencyWarning)


def _list_comparisons(network: Any) -> Iterator[Comparison]:
    """Yield the comparisons of the numbers of a network that can be made, see
    :func:`compare_numbers`.
    """
    if _can_balance(network):
        yield compare_forces(network)
        # contacts that resist rolling or twist may have static torques
        rolls_freely = not np.any(network.bending_stiffness)
        twists_freely = not np.any(network.torsion_stiffness)
        knows_torques = (rolls_freely and twists_freely) or network.contact_torque is not None
        if knows_torques and network.tangential_force is not None:
            yield _compare_torques(network)
    model = network.contact_model
    # contacts with the curvatures of the kinds, as of granphon's own packings, follow their law by
    # construction
    follows_law = model is not None and not model.own_radii
    if not follows_law:
        yield from _compare_law(network)
        yield from _compare_balls(network)
    yield from _compare_hold(network)


# -- balance ---------------------------------------------------------------------------------------


def _can_balance(network: Any) -> bool:
    """Whether the sums of the static forces on balls are compared with zero.

    There must be static forces, and balls that move. With prestress, by which static forces act on
    waves, the sums are then compared. Without prestress they are compared only if no force is
    missing: tangential forces must be known, unless contacts bear none; and the network must repeat
    along all axes, or have bodies that do not move, so that nothing outside of it holds its balls.
    """
    if not np.any(network.normal_force) or not np.any(network.moving):
        return False
    bears_normal_alone = network.dimension == 1 or not np.any(network.shear_stiffness)
    is_known = bears_normal_alone or network.tangential_force is not None
    is_enclosed = all(network.pbc[: network.dimension]) or not np.all(network.moving)
    return bool(network.prestress or (is_known and is_enclosed))


def compare_forces(network: Any) -> Comparison:
    """Return the comparison of the sum of the static forces on each ball, over the mean force of a
    contact, with zero; the network has contacts with forces. Where some balls do not move, the sums
    are less the part that may be in balance with gravity
    (:attr:`~granphon.networks.network.ContactNetwork.residual_forces`).
    """
    ratios = np.linalg.norm(network.residual_forces, axis=1) / network.mean_force
    fault = network.describe_imbalance(network.find_farthest(network.residual_forces))
    if not np.all(network.moving):
        fault += ", less what gravity may balance"
    return _compare_sums(
        network,
        "balance",
        "sum of the static forces on a ball over the mean force of a contact",
        ratios,
        BALANCE_LIMIT if network.prestress else REST_LIMIT,
        fault,
        "Frequencies are of a network that is not at rest, unless something else acts on"
        " the ball, as its weight or a wall",
    )


def _compare_torques(network: Any) -> Comparison:
    """Return the comparison of the sum of the static torques on each ball, over the mean force of a
    contact times the mean radius of the balls that move, with zero; the network has contacts with
    forces, and balls that move.
    """
    _forces, torques = network.unbalanced
    mean_radius = float(np.mean(network.radii[network.moving]))
    ratios = np.linalg.norm(torques, axis=1) / (network.mean_force * mean_radius)
    ball = int(np.argmax(ratios))
    return _compare_sums(
        network,
        "torques",
        "sum of the static torques on a ball over mean force of a contact and mean radius",
        ratios,
        REST_LIMIT,
        f"The static torques on ball {network.name_ball(ball)} add up to {ratios[ball]:.2g} of the"
        f" mean contact force times the mean radius",
        "Frequencies are of balls that begin to turn: tangential forces are of another step, of the"
        " other sign, or act at other arms; or contacts resist rolling, and no stiffness says so",
    )


def _compare_sums(
    network: Any,
    name: str,
    meaning: str,
    ratios: Array,
    limit: float,
    fault: str,
    reason: str,
) -> Comparison:
    """Return the comparison of the largest of the ``ratios`` (n,), a pure number for each ball,
    with the ``limit``.

    The other arguments are fields of :class:`Comparison`. The worst balls are added to ``fault`` if
    there are several.
    """
    failing_balls = np.flatnonzero(ratios > limit)
    order = np.argsort(-ratios[failing_balls], kind="stable")
    worst_balls = failing_balls[order][:MOST_NAMED]
    labels = [network.name_ball(ball) for ball in worst_balls.tolist()]
    if len(labels) > 1:
        fault += f" (the worst balls: {', '.join(map(str, labels))})"
    return Comparison(
        name=name,
        meaning=meaning,
        value=float(np.max(ratios)),
        limit=limit,
        typical=float(np.sqrt(np.mean(ratios[network.moving] ** 2))),
        worst=tuple((label,) for label in labels),
        fault=fault,
        reason=reason,
    )


# -- contacts and balls ----------------------------------------------------------------------------


@dataclass(frozen=True)
class _Overlaps:
    """The overlaps of the contacts that a force presses and whose two balls move.

    Attributes
    ----------
    contacts : (m,) indices of these contacts in the network.
    overlaps : (m,) overlaps that follow from places and radii, m; below zero for balls apart.
    greatest_errors, errors : (m,) greatest and standard errors that rounding leaves in the
        overlaps, m; a greatest error is at least :data:`_LEAST_OVERLAP` times the sum of the radii.
    linear_overlaps : (m,) force over normal stiffness, m: by Hertz's law 2/3 of the overlap.
    is_strong : (m,) whether the force of a contact is the median force of these contacts or more.
    """

    contacts: Index
    overlaps: Array
    greatest_errors: Array
    errors: Array
    linear_overlaps: Array
    is_strong: Flags

    @classmethod
    def of(cls, network: Any) -> Self:
        """Return the overlaps of a network."""
        force = network.normal_force
        # a force under which the overlap is below 1e-60 m counts as none: powers of such an overlap
        # would underflow
        has_force = force / network.normal_stiffness > 1.0 / LARGEST_NUMBER
        both_move = network.moving[network.i] & network.moving[network.j]
        contacts = np.flatnonzero(has_force & both_move)
        i = network.i[contacts]
        j = network.j[contacts]
        reading = network.reading
        if reading is None:
            rounding = find_rounding(network.positions), find_rounding(network.radii)
        else:
            rounding = reading.rounding, reading.radius_rounding
        greatest_errors, errors = find_errors_of_overlaps(*rounding, i, j, network.normal[contacts])
        sum_of_radii = network.radii[i] + network.radii[j]
        is_strong = np.zeros(0, bool)
        if contacts.size:  # the median of no forces is nan
            is_strong = force[contacts] >= np.median(force[contacts])
        return cls(
            contacts=contacts,
            overlaps=sum_of_radii - network.distance[contacts],
            greatest_errors=np.maximum(greatest_errors, _LEAST_OVERLAP * sum_of_radii),
            errors=errors,
            linear_overlaps=force[contacts] / network.normal_stiffness[contacts],
            is_strong=is_strong,
        )

    @property
    def power(self) -> float:
        """The power p in the law that forces f are proportional to overlaps to the power p.

        By this law an overlap is p f/k, where k is the normal stiffness. So p is found as the
        median of the overlap over f/k, over the strong contacts, of which there are some. The power
        is zero, which stands for no law, if the median of the overlaps of these contacts, less
        their greatest errors, is not above zero.
        """
        is_strong = self.is_strong
        if not np.median((self.overlaps - self.greatest_errors)[is_strong]) > 0.0:
            return 0.0
        return float(np.median(self.overlaps[is_strong] / self.linear_overlaps[is_strong]))

    def find_ratios(self, power: float, error: Array | float = 0.0) -> Array:
        """Return the forces of the law at the overlaps, over the forces of the contacts, (m,), if
        forces go as the ``power`` of overlaps; zero for balls that are apart.

        An ``error``, (m,) or a number, m, is added to the overlaps first.
        """
        overlaps = np.maximum(self.overlaps + error, 0.0)
        return np.asarray((overlaps / (power * self.linear_overlaps)) ** power)


def _compare_law(network: Any) -> Iterator[Comparison]:
    """Yield the comparisons of the stiffnesses of contacts with Hertz's law under their forces, if
    materials are known and forces are not proportional to overlaps, and of their forces with the
    law at their overlaps.

    Medians are over the contacts with the median force or more, as the overlaps of the others have
    large relative errors. Nothing is yielded if contacts are adhesive or known to have another law
    than Hertz's, or if the network has no overlaps beyond rounding.
    """
    model = network.contact_model
    if network.adhesive or not (model is None or model.is_hertzian):
        return
    overlaps = _Overlaps.of(network)
    # without such contacts there is no median
    power = overlaps.power if overlaps.contacts.size else 0.0
    if not power:
        return
    ratios = _find_stiffness_ratios(network, overlaps.contacts)
    is_typical = overlaps.is_strong & np.isfinite(ratios)
    is_linear = _is_linear(power, ratios[is_typical])
    # (m,) whether the comparison of single stiffnesses names each contact
    has_odd_stiffness = np.zeros(overlaps.contacts.size, bool)
    if np.any(is_typical) and not is_linear:
        median_ratio = float(np.median(ratios[is_typical]))
        yield _compare_stiffnesses(median_ratio)
        has_odd_stiffness = _find_odd_stiffnesses(network, overlaps, ratios / median_ratio)
        yield _compare_single_stiffnesses(
            network, overlaps.contacts[has_odd_stiffness], ratios[has_odd_stiffness], median_ratio
        )
    power_of_law = 1.0 if is_linear else EXPONENT
    yield from _compare_forces_of_overlaps(network, overlaps, power_of_law, has_odd_stiffness)


def _is_linear(power: float, stiffness_ratios: Array) -> bool:
    """Whether the forces of contacts are compared with forces that are proportional to overlaps,
    and not with those of Hertz's law.

    A contact of the force f and the stiffness k has the overlap p f/k: p is 3/2 by Hertz's law, and
    1 where forces are proportional to overlaps. ``power`` is the p of the network
    (:attr:`_Overlaps.power`). ``stiffness_ratios`` (m,) are the stiffnesses of the contacts that
    count over those of Hertz's law under their forces, none if no material is known. Without them
    the nearer p is taken. With them p is 1 only if the overlaps are f/k and the stiffnesses are not
    those of Hertz's law.
    """
    if not stiffness_ratios.size:
        return power < 0.5 * (1.0 + EXPONENT)
    is_hertzian = float(np.median(np.abs(stiffness_ratios - 1.0))) <= _RATIO_TOLERANCE
    return abs(power - 1.0) <= _RATIO_TOLERANCE and not is_hertzian


def _compare_stiffnesses(median_ratio: float) -> Comparison:
    """Return the comparison of the ``median_ratio``, that of the normal stiffnesses to those of
    Hertz's law under the same forces, with one.
    """
    return _compare_median(
        "stiffness",
        "median of the normal stiffness over that of Hertz's law under the force, less one",
        median_ratio,
        "The normal stiffnesses are {ratio} times those of Hertz's law under the forces",
        "The stiffnesses count: if the law is right, all frequencies are off by {effect}",
        effect=median_ratio**0.5,
    )


def _is_far(ratios: Array) -> Flags:
    """Return whether each of the ``ratios`` (m,) is above ``_MOST_FACTOR`` or below the inverse of
    this factor; false for nan.
    """
    return np.asarray((ratios > _MOST_FACTOR) | (ratios < 1.0 / _MOST_FACTOR))


def _find_odd_stiffnesses(network: Any, overlaps: _Overlaps, relative_ratios: Array) -> Flags:
    """Return (m,) whether the stiffness of each contact is far from that of Hertz's law under the
    force, while the force is near to that of the law at the overlap: then the stiffness is wrong,
    and not the force.

    ``relative_ratios`` (m,) are the ratios of the stiffnesses to those of the law, over the median
    of these ratios; nan where materials are not known. False for all contacts if most of the strong
    ones whose ratios are known join balls that are apart, by their places.
    """
    # forces of the law at the overlaps over those of the contacts, found with the stiffness of the
    # law under the force, times the median ratio, in place of that of the contact
    force_ratios = overlaps.find_ratios(EXPONENT) / relative_ratios**EXPONENT
    median_ratio = float(np.nanmedian(force_ratios[overlaps.is_strong]))
    if not median_ratio:
        return np.zeros(len(force_ratios), bool)
    force = network.normal_force[overlaps.contacts]
    is_odd = _is_far(relative_ratios) & ~_is_far(force_ratios / median_ratio)
    return np.asarray(is_odd & (force > _LEAST_FORCE * np.mean(force)))


def _compare_single_stiffnesses(
    network: Any, outliers: Index, ratios: Array, median_ratio: float
) -> Comparison:
    """Return the comparison of the number of ``outliers`` with zero. These are indices (m,) of
    contacts whose stiffness is far from that of the law; ``ratios`` (m,) are their stiffnesses over
    those of the law, and ``median_ratio`` is the median of such ratios, from which the worst are
    farthest.
    """
    distances = np.abs(np.log(ratios / median_ratio))
    order = np.argsort(-distances, kind="stable")
    stiffnesses = network.normal_stiffness[outliers[order]]
    return _compare_outliers(
        network,
        outliers[order],
        (stiffnesses, stiffnesses / ratios[order]),
        name="single stiffnesses",
        meaning="contacts whose normal stiffness is more than ten times that of Hertz's law under"
        " the force, or less than a tenth, beside the median ratio of all",
        words=("stiffness", "N/m", "force"),
        reason="Frequencies are of such contacts with these stiffnesses. Compare the column, or"
        " leave it out: stiffnesses then follow from the material",
    )


def _compare_outliers(
    network: Any,
    outliers: Index,
    numbers: tuple[Array, Array],
    *,
    name: str,
    meaning: str,
    words: tuple[str, str, str],
    reason: str,
) -> Comparison:
    """Return the comparison of the number of ``outliers`` with zero. These are indices (m,) of
    contacts with a number that is far from that of the law, the worst first.

    ``numbers`` are the numbers of the contacts and the numbers of the law, each (m,). ``words`` are
    the quantity that the numbers measure, the unit of this quantity, and the quantity from which
    the law finds it. The other arguments are fields of the comparison.
    """
    quantity, unit, cause = words
    pairs = _name_pairs(network, outliers)
    # pairs are those of the worst contacts alone
    shown = [
        f"balls {i} and {j}, with {number:.3g} {unit} where the {cause} makes {of_law:.3g} {unit}"
        for (i, j), number, of_law in zip(pairs, *numbers, strict=False)
    ]
    return Comparison(
        name=name,
        meaning=meaning,
        value=float(outliers.size),
        limit=0.0,
        worst=pairs,
        fault=f"{counted(outliers.size, 'contact has', 'contacts have')} more than ten times the"
        f" {quantity} of the {cause}, or less than a tenth: {'; '.join(shown)}",
        reason=reason,
    )


def _compare_forces_of_overlaps(
    network: Any, overlaps: _Overlaps, power: float, has_odd_stiffness: Flags
) -> Iterator[Comparison]:
    """Yield four comparisons of the forces of contacts with those of the law at their overlaps. By
    the law forces go as the ``power`` of overlaps.

    The comparisons are of the median ratio, of the scatter about the median, of the number of
    contacts far from the median, and of the error that rounding leaves in forces.
    ``has_odd_stiffness`` (m,) marks contacts of wrong stiffnesses, which are not counted again
    among the contacts far from the median.
    """
    is_strong = overlaps.is_strong
    ratios = overlaps.find_ratios(power)  # forces of the law over those of the contacts
    median_ratio = float(np.median(ratios[is_strong]))
    deviations = np.abs(ratios[is_strong] / median_ratio - 1.0)
    relative_errors = overlaps.errors[is_strong] / overlaps.linear_overlaps[is_strong]
    # an overlap p f/k, to the power p, has the relative error p error/(p f/k) = error/(f/k)
    law_error = float(np.median(relative_errors))
    yield _compare_median(
        "law",
        "force over that of the law at the overlap of the places, at the median, less one",
        1.0 / median_ratio,
        "The forces are {ratio} times those of the law at the overlaps of the places",
        "By Hertz's law, if the overlaps are right and not the forces, all frequencies are off by"
        " {effect}. Compare units, Young's modulus and columns. If the law is another one, give the"
        " stiffnesses",
        effect=median_ratio**FREQUENCY_EXPONENT,
        slack=law_error,
    )
    yield _compare_scatter(network, overlaps.contacts[is_strong], deviations, law_error)
    is_odd = _find_odd_forces(network, overlaps, power, median_ratio) & ~has_odd_stiffness
    yield _compare_single_forces(network, overlaps.contacts[is_odd], ratios[is_odd])
    are_forces_of_overlaps = bool(np.max(deviations) < _LEAST_SCATTER)
    yield _compare_rounding(
        law_error if are_forces_of_overlaps else _find_error_of_directions(network, overlaps)
    )


def _compare_scatter(
    network: Any, contacts: Index, deviations: Array, law_error: float
) -> Comparison:
    """Return the comparison of the median of the ``deviations`` (m,) with their limit. These are
    the relative deviations, from their median, of the forces of the law over those of the
    ``contacts``, indices (m,). Rounding leaves the relative error ``law_error`` in the forces of
    the law.
    """
    scatter = float(np.median(deviations))
    worst_first = contacts[np.argsort(-deviations, kind="stable")]
    return Comparison(
        name="scatter",
        meaning="median deviation of that ratio from its median, over the median",
        value=scatter,
        limit=_RATIO_TOLERANCE + law_error,
        worst=_name_pairs(network, worst_first),
        fault=f"The ratios of forces to those of the law at the overlaps scatter by {scatter:.1%}",
        reason="Frequencies are of contacts whose forces are of another step, in another order, or"
        " of other materials",
    )


def _find_odd_forces(network: Any, overlaps: _Overlaps, power: float, median_ratio: float) -> Flags:
    """Return (m,), for each of the contacts of the ``overlaps``, whether its force is more than
    ten times that of the law at the overlap, or less than a tenth, beside ``median_ratio``, the
    median of the forces of the law over those of the contacts, and no rounding of the places
    explains that.

    By the law forces go as the ``power`` of overlaps. A contact with a weak force counts only if
    the law makes a strong one of the overlap.
    """
    # the ratios that rounding of the places allows
    lowest_ratios = overlaps.find_ratios(power, -overlaps.greatest_errors) / median_ratio
    highest_ratios = overlaps.find_ratios(power, overlaps.greatest_errors) / median_ratio
    is_far = (highest_ratios < 1.0 / _MOST_FACTOR) | (lowest_ratios > _MOST_FACTOR)
    force = network.normal_force[overlaps.contacts]
    larger_force = np.maximum(1.0, lowest_ratios) * force  # of the contact, or by the law
    return np.asarray(is_far & (larger_force > _LEAST_FORCE * np.mean(force)))


def _find_error_of_directions(network: Any, overlaps: _Overlaps) -> float:
    """Return the relative error that the rounding of places leaves in forces which were not
    computed from the overlaps: it changes these forces only through the directions of contacts.
    """
    i = network.i[overlaps.contacts]
    j = network.j[overlaps.contacts]
    return float(np.median(overlaps.errors / (network.radii[i] + network.radii[j])))


def _compare_single_forces(network: Any, outliers: Index, ratios: Array) -> Comparison:
    """Return the comparison of the number of ``outliers`` with zero. These are indices (m,) of
    contacts whose force is far from that of the law; ``ratios`` (m,) are the forces of the law over
    the forces of these contacts.
    """
    forces = network.normal_force[outliers]
    forces_of_law = ratios * forces
    # the contacts with the largest force, of the file or by the law, come first
    order = np.argsort(-np.maximum(forces_of_law, forces), kind="stable")
    return _compare_outliers(
        network,
        outliers[order],
        (forces[order], forces_of_law[order]),
        name="single forces",
        meaning="contacts whose force is more than ten times that of the law at the overlap, or"
        " less than a tenth, beside the median ratio of all",
        words=("force", "N", "overlap"),
        reason="Frequencies are of such contacts as if they were pressed by these forces. Compare"
        " units and columns",
    )


def _name_pairs(network: Any, contacts: Index) -> tuple[tuple[int, int], ...]:
    """Return the labels, or indices, of the two balls of each of the first of ``contacts``, indices
    (m,), three at most.
    """
    first_contacts = contacts[:MOST_NAMED]
    ends_i = network.i[first_contacts].tolist()
    ends_j = network.j[first_contacts].tolist()
    pairs = zip(ends_i, ends_j, strict=True)
    return tuple((network.name_ball(i), network.name_ball(j)) for i, j in pairs)


def _evaluate_materials(network: Any, find: Callable[[Material], float]) -> Array:
    """Return ``find(material)`` (n,) of the material of each ball; nan where the material is not
    known.
    """
    model = network.contact_model
    if model is None:
        return np.full(network.n_balls, np.nan)
    values = [find(ball.material) for ball in model.kinds]
    if len(values) == 1:
        return np.full(network.n_balls, values[0])
    value_of_kind = dict(zip(model.names, values, strict=True))
    kinds = network.kinds or [""] * network.n_balls
    return np.array([value_of_kind.get(kind, np.nan) for kind in kinds])


def _find_stiffness_ratios(network: Any, contacts: Index) -> Array:
    """Return the normal stiffnesses over those of Hertz's law under the same forces, (m,), of the
    ``contacts``, indices; nan where materials are not known.
    """
    ratios = np.full(contacts.size, np.nan)
    moduli = _evaluate_materials(network, lambda material: material.contact_modulus)
    is_known = np.isfinite(moduli[network.i[contacts]] + moduli[network.j[contacts]])
    known_contacts = contacts[is_known]
    if not known_contacts.size:
        return ratios
    i = network.i[known_contacts]
    j = network.j[known_contacts]
    diameters = harmonic_diameter(2.0 * network.radii[i], 2.0 * network.radii[j])
    compliances = 0.5 / moduli[i] + 0.5 / moduli[j]  # of pairs of materials, 1/Pa
    # Hertz's coefficient is proportional to the modulus of the pair and to the root of the diameter
    material = network.contact_model.kinds[0].material
    coefficient = HertzLaw.between(material, 1.0).coefficient * np.sqrt(diameters)
    coefficient /= compliances * material.contact_modulus
    unit_law = HertzLaw(1.0)  # Hertz's law is proportional to its coefficient
    overlaps = unit_law.overlap(network.normal_force[known_contacts] / coefficient)
    stiffnesses_of_law = coefficient * unit_law.stiffness(overlaps)
    ratios[is_known] = network.normal_stiffness[known_contacts] / stiffnesses_of_law
    return ratios


def _compare_rounding(error: float) -> Comparison:
    """Return the comparison of the relative ``error``, which the digits of places leave in forces,
    with its limit.
    """
    return Comparison(
        name="rounding",
        meaning="part of the forces that the digits of places leave open",
        value=error,
        limit=_ROUNDING_LIMIT,
        fault=f"Places are rounded: their digits leave {error:.1%} of the forces open",
        reason=f"The forces follow from overlaps: frequencies are off by about"
        f" {FREQUENCY_EXPONENT * error:.1%}. Write places with more digits (in LAMMPS: dump_modify"
        f" 1 format float %.16g), or give the forces",
    )


def _compare_balls(network: Any) -> Iterator[Comparison]:
    """Yield the comparisons of the balls that move: of their masses with those of the density, if
    it is known for all of them, and of their moments of inertia with those of solid spheres, if
    balls rotate.
    """
    balls = np.flatnonzero(network.moving)
    if not balls.size:
        return
    densities = _evaluate_materials(network, lambda material: material.density)[balls]
    if np.all(np.isfinite(densities)):
        yield from _compare_masses(network, balls, densities)
    if network.ball_motions.rotate:
        yield from _compare_inertias(network, balls)


def _compare_masses(network: Any, balls: Index, densities: Array) -> Iterator[Comparison]:
    """Yield the comparisons of the masses of ``balls``, indices (n,), with those of solid spheres
    of the ``densities`` (n,): of the median ratio, and of single masses.
    """
    volumes = 4.0 / 3.0 * np.pi * network.radii[balls] ** 3
    ratios = network.masses[balls] / (densities * volumes)
    median_ratio = float(np.median(ratios))
    listed_densities = ", ".join(f"{density:g}" for density in np.unique(densities))
    yield _compare_median(
        "masses",
        "median of the mass over that of a solid ball of the material, less one",
        median_ratio,
        f"The masses are {{ratio}} times those of solid balls of {listed_densities} kg/m3",
        "The masses count, and the density does not: if the density is right, all frequencies are"
        " off by {effect}. Compare units and material. If balls are not solid, give the density of"
        " mass over volume",
        effect=median_ratio**-0.5,
    )
    relative_ratios = ratios / median_ratio
    is_odd = _is_far(relative_ratios)
    yield _compare_single_balls(
        network,
        "single masses",
        "balls whose mass is more than ten times that of a solid ball of the material, or less than"
        " a tenth, beside the median ratio of all",
        balls[is_odd],
        relative_ratios[is_odd],
        "{count} more than ten times the mass of the size, or less than a tenth: {listed} times the"
        " mass",
        "Frequencies are of balls with these masses. Compare columns and units",
    )


def _compare_inertias(network: Any, balls: Index) -> Iterator[Comparison]:
    """Yield the comparisons of the moments of inertia of ``balls``, indices (n,), with those of
    solid spheres of their masses and radii: of the median ratio, and of single moments.
    """
    solid_inertias = SOLID_INERTIA * network.masses[balls] * network.radii[balls] ** 2
    ratios = network.inertias[balls] / solid_inertias
    median_ratio = float(np.median(ratios))
    yield _compare_median(
        "inertias",
        "median of the moment of inertia over that of a solid sphere of the mass, less one",
        median_ratio,
        "The moments of inertia are {ratio} times those of solid spheres",
        "The moments count: if balls are solid, frequencies of rotations are off by {effect}",
        effect=median_ratio**-0.5,
    )
    # a moment far from the others, or one above that of a hollow sphere
    is_odd = _is_far(ratios / median_ratio) | (ratios > (1.0 + _RATIO_TOLERANCE) * _HOLLOW_INERTIA)
    yield _compare_single_balls(
        network,
        "single inertias",
        "balls whose moment of inertia is above that of a hollow sphere of the mass, 2/3 m r^2, or"
        " ten times or a tenth of that of a solid sphere, beside the median ratio of all",
        balls[is_odd],
        ratios[is_odd],
        "{count} a moment of inertia that no sphere of the mass and the radius has, or one far from"
        " those of others: {listed} times that of a solid sphere",
        "Frequencies of rotations are of balls with these moments. Compare columns and units, or"
        " leave the moments out: those of solid spheres are taken",
    )


def _compare_single_balls(
    network: Any,
    name: str,
    meaning: str,
    outliers: Index,
    ratios: Array,
    fault: str,
    reason: str,
) -> Comparison:
    """Return the comparison of the number of ``outliers`` with zero. These are indices (m,) of
    balls with a wrong number; ``ratios`` (m,) are their numbers over the expected ones.

    In ``fault`` the number of outliers takes the place of {count}, and the worst of them that of
    {listed}. The other arguments are fields of :class:`Comparison`.
    """
    order = np.argsort(-np.abs(np.log(ratios)), kind="stable")[:MOST_NAMED]
    labels = [network.name_ball(ball) for ball in outliers[order].tolist()]
    shown = [
        f"ball {label} has {ratio:.3g}"
        for label, ratio in zip(labels, ratios[order].tolist(), strict=True)
    ]
    return Comparison(
        name=name,
        meaning=meaning,
        value=float(outliers.size),
        limit=0.0,
        worst=tuple((label,) for label in labels),
        fault=fault.format(
            count=counted(outliers.size, "ball has", "balls have"), listed="; ".join(shown)
        ),
        reason=reason,
    )


def _compare_median(
    name: str,
    meaning: str,
    median: float,
    fault: str,
    reason: str,
    effect: float,
    slack: float = 0.0,
) -> Comparison:
    """Return the comparison of a ``median`` ratio with one. Their difference must not be above
    :data:`_RATIO_TOLERANCE` plus a ``slack``.

    In ``fault`` the ratio takes the place of {ratio}. ``effect`` is the factor by which frequencies
    are off; in ``reason`` its difference from one takes the place of {effect}. The other arguments
    are fields of :class:`Comparison`.
    """
    value = abs(median - 1.0)
    return Comparison(
        name=name,
        meaning=meaning,
        value=value,
        limit=_RATIO_TOLERANCE + slack,
        fault=fault.format(ratio=f"{median:.4g}"),
        reason=reason.format(effect=f"{abs(effect - 1.0):.1%}"),
    )


# -- what holds the balls --------------------------------------------------------------------------


def _compare_hold(network: Any) -> Iterator[Comparison]:
    """Yield the comparisons of rattlers, of pieces, and of the number of contacts.

    If all balls that move are rattlers, pieces are not compared, and the number of contacts is only
    if there are none at all.
    """
    rattlers = network.rattlers
    yield Comparison(
        name="rattlers",
        meaning="balls that carry no load",
        value=float(rattlers.size),
        limit=0.0,
        worst=tuple((network.name_ball(ball),) for ball in rattlers[:MOST_NAMED].tolist()),
        fault=f"{counted(rattlers.size, 'ball carries', 'balls carry')} no load",
        reason="Each adds modes of frequency zero, or nearly zero. Leave them out:"
        " network.without_rattlers()",
    )
    is_held = network.moving.copy()
    is_held[rattlers] = False
    if not np.any(is_held):
        if np.any(network.moving) and not network.n_contacts:
            yield _compare_coordination(network, network.moving)
        return
    n_pieces = np.unique(network.piece_numbers[is_held]).size
    yield Comparison(
        name="pieces",
        meaning="sets of balls that no contact joins to others",
        value=float(n_pieces),
        limit=1.0,
        fault=f"The network falls into {n_pieces} pieces that do not touch",
        reason="No wave passes from one to another, and each has modes of frequency zero of its"
        " own. Take one: network.pieces()",
    )
    yield _compare_coordination(network, is_held)


def _compare_coordination(network: Any, is_held: Flags) -> Comparison:
    """Return the comparison of the number of contacts per ball with the isostatic number, at which
    as many deformations are resisted as there are motions (Maxwell's count).

    The balls and their motions are counted where ``is_held`` (n,) is true; the contacts are those
    among these balls, and with bodies that do not move. Springs to the ground resist motions, too,
    so that fewer contacts are needed. If no contact resists a deformation, each is counted as one
    that resists one.
    """
    motions = network.ball_motions
    n_held = int(np.count_nonzero(is_held))
    is_end = is_held | ~network.moving
    is_counted = is_end[network.i] & is_end[network.j] & network.in_lattice
    n_contacts = int(np.count_nonzero(is_counted))
    n_resisted = _count_resisted(network, is_counted)
    n_needed = motions.count * n_held - _count_rigid_motions(network)
    if network.on_site is not None:
        # a spring to the ground resists one motion of its ball; rotations are the last motions
        n_needed -= int(np.count_nonzero(network.on_site[is_held, : motions.count]))
    n_soft = max(n_needed - n_resisted, 0)
    resisted_by_contact = n_resisted / n_contacts if n_resisted else 1.0
    n_isostatic = max(n_needed, 0) / resisted_by_contact  # contacts of the network
    # a contact with a body that does not move has one end alone at a ball that is held; without
    # contacts there is no mean, and each would join two balls
    n_ends = int(np.count_nonzero(is_held[network.i] & is_counted))
    n_ends += int(np.count_nonzero(is_held[network.j] & is_counted))
    balls_of_contact = n_ends / n_contacts if n_contacts else 2.0
    contacts_of_ball = balls_of_contact * n_contacts / n_held
    isostatic_number = balls_of_contact * n_isostatic / n_held
    return Comparison(
        name="contacts",
        meaning="contacts per ball, of those that are held, against the isostatic number",
        value=contacts_of_ball,
        limit=isostatic_number,
        fault=f"The balls have {contacts_of_ball:.3g} contacts each, fewer than the"
        f" {isostatic_number:.3g} of an isostatic packing",
        reason=f"{n_soft} modes or more have the frequency zero",
        at_least=True,
    )


def _count_resisted(network: Any, is_counted: Flags) -> int:
    """Return the number of deformations that the contacts which ``is_counted`` (n_c,) marks resist.

    The motions of balls deform a contact along its normal, unless balls move out of the plane
    alone; by slip along each of the other displacements; by twist; and by rolling about each of the
    other rotations. Each deformation has its stiffness.
    """
    motions = network.ball_motions
    # normals lie in the line or plane, along which balls move if they move along x
    n_along = int(0 in motions.translations)
    n_twists = int(motions.twist)
    n_deformations = {
        "normal_stiffness": n_along,
        "shear_stiffness": len(motions.translations) - n_along,
        "torsion_stiffness": n_twists,
        "bending_stiffness": len(motions.rotations) - n_twists,
    }
    return sum(
        number * int(np.count_nonzero(getattr(network, name)[is_counted]))
        for name, number in n_deformations.items()
    )


def _is_regular(network: Any) -> bool:
    """Whether all balls that move have the same number of contacts, as in a lattice or a row
    between walls; also true if no ball moves.
    """
    counts = np.bincount(np.concatenate([network.i, network.j]), minlength=network.n_balls)
    return np.unique(counts[network.moving]).size <= 1


def _count_rigid_motions(network: Any) -> int:
    """Return the number of rigid motions, translations and rotations of the whole network that
    deform no contact.

    None is counted if some body does not move or there are springs to the ground, as if these held
    the balls against all of them. A network turns in a plane only if its balls move along both axes
    of the plane, and it repeats along neither.
    """
    if not np.all(network.moving) or network.on_site is not None:
        return 0
    translations = network.ball_motions.translations
    planes = ((1, 2), (2, 0), (0, 1))
    n_turns = sum(
        all(axis in translations and not network.pbc[axis] for axis in plane) for plane in planes
    )
    return len(translations) + n_turns
