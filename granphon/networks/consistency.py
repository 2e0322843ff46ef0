"""Whether the numbers of a network agree with each other: its forces are in balance, and are those
of the law at its overlaps; its masses are those of the material; its contacts hold its balls.

Each comparison is of one number with a limit, names the balls that are farthest beyond it, and says
what that does to frequencies. By Hertz's law a stiffness goes as the third root of the force, so
that frequencies go as the sixth root of forces; they go as the inverse root of masses.

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
from granphon.networks.sources import find_errors_of_overlaps, find_rounding

#: sum of the forces on a ball, over the mean force of a contact, up to which they are in balance
#: where static forces act: programs of discrete elements leave 1e-4 or less, and weights, walls or
#: digits that a file lacks leave more
BALANCED = 1e-3
#: the same sum, and that of torques over the mean force and the mean radius, from which a packing
#: that nothing else can hold still moves: in files with three digits, too few for forces, it stays
#: below
MOVING = 5e-3
#: greatest difference of a median ratio from one, however 1.05 is rounded, and greatest scatter
#: about the median
_ALIKE = 0.049
#: greatest error of forces by the rounding of places: frequencies have a sixth of it, 0.1 %
_ROUNDED = 6e-3
#: scatter of the forces of a source about those of its overlaps below which they follow from them
_FOLLOWS = 1e-9
#: greatest factor between the force of a contact and that of the law at its overlap
_MOST_FACTOR = 10.0
#: least force, over the mean, that is compared so: weaker contacts may not have come to rest
_LEAST_COMPARED = 1e-3
#: least overlap of places over the distance: places with less have none, as those of a lattice
_LEAST_OVERLAP = 1e-10
#: most balls, or pairs of balls, that a comparison names
_NAMED = 3
#: moment of inertia of a solid sphere over m r^2
_SOLID = 0.4
#: comparisons of what stands in the file of balls
_OF_BALLS = ("masses", "inertias", "rounding")


@dataclass(frozen=True)
class Comparison:
    """One comparison of the numbers of a network with each other.

    Attributes
    ----------
    name : name of the comparison.
    meaning : the quantity that is limited.
    value : a pure number, which must not be above ``limit``, or with ``at_least`` not below it.
    limit : the limit.
    fault : what is wrong where the value is beyond the limit, in words.
    reason : what that does to frequencies.
    typical : the rms over balls, where the value is that of the worst ball; None elsewhere.
    worst : the balls, or pairs of balls that touch, that are farthest from the others, the
        farthest first: their labels, or indices where there are none.
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

    The sums of static forces and torques on balls are judged where the tangential forces are known,
    or contacts resist no slip; without prestress only where the network has no open ends. Torques
    are not judged where contacts resist rolling or twist, whose static torques are not known.
    Overlaps,
    stiffnesses and masses are judged of networks that were read: in granphon's own the contacts
    follow their law, and balls need not be solid.
    """
    return tuple(_list_comparisons(network))


def warn_of_faults(network: Any) -> None:
    """Warn of each comparison that a network fails which has been read, with the name of its file.

    Rattlers are there only if they were asked for. Too few contacts are no fault of a lattice in
    balance, whose modes of frequency zero are known.
    """
    failing = {each.name: each for each in compare_numbers(network) if not each.holds}
    failing.pop("rattlers", None)
    if "balance" not in failing and _is_regular(network):
        failing.pop("contacts", None)
    for name, comparison in failing.items():
        file = network.reading.balls if name in _OF_BALLS else network.reading.contacts
        fault = comparison.fault[0].lower() + comparison.fault[1:]
        warn_caller(message(f"{file}: {fault}", comparison.reason), InconsistencyWarning)


def _list_comparisons(network: Any) -> Iterator[Comparison]:
    """Yield the comparisons."""
    if _has_known_forces(network):
        yield compare_forces(network)
        # the static torques of contacts that resist rolling are not known
        rolls = not np.any(network.bending_stiffness) and not np.any(network.torsion_stiffness)
        if rolls and network.tangential_force is not None:
            yield _compare_torques(network)
    model = network.contact_model
    is_read = model is None or model.own_radii
    if is_read:
        yield from _compare_law(network)
        yield from _compare_balls(network)
    yield from _compare_hold(network)


# -- balance ---------------------------------------------------------------------------------------


def _has_known_forces(network: Any) -> bool:
    """Whether the static forces on balls can be summed: all are known, and nothing that the network
    lacks holds its balls; with prestress these forces act in any case.
    """
    if not np.any(network.normal_force):
        return False
    slips = network.dimension == 1 or not np.any(network.shear_stiffness)
    is_known = slips or network.tangential_force is not None
    is_enclosed = all(network.pbc[: network.dimension]) or not np.all(network.moving)
    return bool(network.prestress or (is_known and is_enclosed))


def compare_forces(network: Any) -> Comparison:
    """Return the comparison of the sums of static forces on balls, of a network with contacts."""
    ratios = np.linalg.norm(network.residual_forces, axis=1) / network.mean_force
    return _compare_sums(
        network,
        "balance",
        "sum of the static forces on a ball over the mean force of a contact",
        ratios,
        BALANCED if network.prestress else MOVING,
        network.describe_imbalance(network.find_farthest(network.residual_forces)),
        "Frequencies are of a network that is not at rest, unless something else acts on"
        " the ball, as its weight or a wall",
    )


def _compare_torques(network: Any) -> Comparison:
    """Return the comparison of the sums of static torques on the balls of a network."""
    _forces, torques = network.unbalanced
    mean_radius = float(np.mean(network.radii[network.moving]))
    ratios = np.linalg.norm(torques, axis=1) / (network.mean_force * mean_radius)
    ball = int(np.argmax(ratios))
    return _compare_sums(
        network,
        "torques",
        "sum of the static torques on a ball over mean force of a contact and mean radius",
        ratios,
        MOVING,
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
    """Return the comparison of the largest of ``ratios`` (n,), one of each ball."""
    beyond = np.flatnonzero(ratios > limit)
    worst = beyond[np.argsort(-ratios[beyond], kind="stable")][:_NAMED]
    labels = [network.name_ball(ball) for ball in worst.tolist()]
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
    """The ``contacts`` (m,) under a force between balls that move, the overlaps of their places,
    the greatest and the standard errors that rounding leaves in these, and force over stiffness,
    all (m,), m; ``strong`` (m,) are those with the median force or more.
    """

    contacts: Index
    overlaps: Array
    greatest_errors: Array
    errors: Array
    linear_overlaps: Array
    strong: Flags

    @classmethod
    def of(cls, network: Any) -> Self:
        """Return those of a network."""
        force = network.normal_force
        contacts = np.flatnonzero(
            (force > 0.0) & network.moving[network.i] & network.moving[network.j]
        )
        i = network.i[contacts]
        j = network.j[contacts]
        reading = network.reading
        if reading is None:
            rounding = find_rounding(network.positions), find_rounding(network.radii)
        else:
            rounding = reading.rounding, reading.radius_rounding
        errors = find_errors_of_overlaps(*rounding, i, j, network.normal[contacts])
        touch = network.radii[i] + network.radii[j]
        return cls(
            contacts,
            touch - network.distance[contacts],
            np.maximum(errors[0], _LEAST_OVERLAP * touch),
            errors[1],
            force[contacts] / network.normal_stiffness[contacts],
            force[contacts] >= np.median(force[contacts]) if contacts.size else contacts > 0,
        )

    @property
    def power(self) -> float:
        """The median overlap over force over stiffness; zero if there are no overlaps beyond their
        errors.
        """
        strong = self.strong
        if not np.median((self.overlaps - self.greatest_errors)[strong]) > 0.0:
            return 0.0
        return float(np.median(self.overlaps[strong] / self.linear_overlaps[strong]))

    def find_ratios(self, power: float, error: Array | float = 0.0) -> Array:
        """Return the forces (m,) at the overlaps, with an error (m,), m, over those of the
        contacts, if forces go as the ``power`` of overlaps; zero of balls that are apart.
        """
        overlaps = np.maximum(self.overlaps + error, 0.0)
        return np.asarray((overlaps / (power * self.linear_overlaps)) ** power)


def _compare_law(network: Any) -> Iterator[Comparison]:
    """Yield the comparisons of overlaps, forces and stiffnesses of the contacts with the median
    force or more, between balls that move: overlaps of others have large relative errors. There are
    none where contacts are known to have another law than Hertz's.

    A contact of the force f and the stiffness k has the overlap p f/k: p is 3/2 by Hertz's law, and
    1 where forces are proportional to overlaps; without a material p is the nearer of the two. The
    force at the overlap of the places is f times the power p of that overlap over p f/k.
    """
    model = network.contact_model
    if network.adhesive or not (model is None or model.is_hertzian):
        return
    overlaps = _Overlaps.of(network)
    if not overlaps.contacts.size:
        return
    power = overlaps.power
    if not power:
        return
    is_linear = power < 0.5 * (1.0 + EXPONENT)
    stiffness_ratios = _compare_stiffnesses(network, overlaps.contacts[overlaps.strong])
    if stiffness_ratios.size:
        follows = float(np.median(np.abs(stiffness_ratios - 1.0))) <= _ALIKE
        is_linear = abs(power - 1.0) <= _ALIKE and not follows
        if not is_linear:
            stiffness_ratio = float(np.median(stiffness_ratios))
            yield _compare_median(
                "stiffness",
                "median of the normal stiffness over that of Hertz's law under the force, less one",
                stiffness_ratio,
                "The normal stiffnesses are {ratio} times those of Hertz's law under the forces",
                "The stiffnesses count: if the law is right, all frequencies are off by {effect}",
                effect=stiffness_ratio**0.5,
            )
    yield from _compare_forces_of_overlaps(network, overlaps, 1.0 if is_linear else EXPONENT)


def _compare_forces_of_overlaps(
    network: Any, overlaps: _Overlaps, power: float
) -> Iterator[Comparison]:
    """Yield the comparisons of the forces of contacts with those of the law at their overlaps;
    forces go as the ``power`` of overlaps.
    """
    strong = overlaps.strong
    ratios = overlaps.find_ratios(power)
    median = float(np.median(ratios[strong]))
    deviations = np.abs(ratios[strong] / median - 1.0)
    scatter = float(np.median(deviations))
    relative_errors = overlaps.errors[strong] / overlaps.linear_overlaps[strong]
    error = float(np.median(relative_errors))  # of overlaps p f/k to the power p
    yield _compare_median(
        "law",
        "median of the force over that of the law at the overlap of the places, less one",
        1.0 / median,
        "The forces are {ratio} times those of the law at the overlaps of the places",
        "By Hertz's law, if the overlaps are right and not the forces, all frequencies are off by"
        " {effect}. Compare units, Young's modulus and columns. If the law is another one, give the"
        " stiffnesses",
        effect=median**FREQUENCY_EXPONENT,
        slack=error,
    )
    worst = overlaps.contacts[strong][np.argsort(-deviations, kind="stable")]
    yield Comparison(
        name="scatter",
        meaning="median deviation of that ratio from its median, over the median",
        value=scatter,
        limit=_ALIKE + error,
        worst=_name_pairs(network, worst),
        fault=f"The ratios of forces to those of the law at the overlaps scatter by {scatter:.1%}",
        reason="Frequencies are of contacts whose forces are of another step, in another order, or"
        " of other materials",
    )
    # the ratios that rounding of the places allows
    lowest_ratios = overlaps.find_ratios(power, -overlaps.greatest_errors) / median
    highest_ratios = overlaps.find_ratios(power, overlaps.greatest_errors) / median
    force = network.normal_force[overlaps.contacts]
    is_odd = (highest_ratios < 1.0 / _MOST_FACTOR) | (lowest_ratios > _MOST_FACTOR)
    is_odd &= np.maximum(1.0, lowest_ratios) * force > _LEAST_COMPARED * np.mean(force)
    yield _compare_single_forces(network, overlaps.contacts[is_odd], ratios[is_odd])
    if np.max(deviations) >= _FOLLOWS:  # forces of their own lose what directions of contacts lose
        i = network.i[overlaps.contacts]
        j = network.j[overlaps.contacts]
        error = float(np.median(overlaps.errors / (network.radii[i] + network.radii[j])))
    yield _compare_rounding(error)


def _compare_single_forces(network: Any, odd: Index, ratios: Array) -> Comparison:
    """Return the comparison of the number of contacts with an ``odd`` force (m,); ``ratios`` (m,)
    are the forces of the law over those of the contacts.
    """
    forces = network.normal_force[odd]
    order = np.argsort(-np.maximum(ratios * forces, forces), kind="stable")
    pairs = _name_pairs(network, odd[order])
    shown = [
        f"balls {i} and {j}, with {forces[row]:.3g} N where the overlap makes"
        f" {ratios[row] * forces[row]:.3g} N"
        for row, (i, j) in zip(order.tolist(), pairs, strict=False)
    ]
    return Comparison(
        name="single forces",
        meaning="contacts whose force is more than ten times that of the law at the overlap, or"
        " less than a tenth, beside the median ratio of all",
        value=float(odd.size),
        limit=0.0,
        worst=pairs,
        fault=f"{counted(odd.size, 'contact has', 'contacts have')} more than ten times the force"
        f" of the overlap, or less than a tenth: {'; '.join(shown)}",
        reason="Frequencies are of such contacts as if they were pressed by these forces. Compare"
        " units and columns",
    )


def _name_pairs(network: Any, contacts: Index) -> tuple[tuple[int, int], ...]:
    """Return the names of the two balls of each of the first few ``contacts`` (m,)."""
    named = contacts[:_NAMED]
    pairs = zip(network.i[named].tolist(), network.j[named].tolist(), strict=True)
    return tuple((network.name_ball(i), network.name_ball(j)) for i, j in pairs)


def _find_of_materials(network: Any, find: Callable[[Material], float]) -> Array:
    """Return ``find(material)`` (n,) of the material of each ball; nan where it is not known."""
    model = network.contact_model
    if model is None:
        return np.full(network.n_balls, np.nan)
    values = [find(ball.material) for ball in model.kinds]
    if len(values) == 1:
        return np.full(network.n_balls, values[0])
    value_of_kind = dict(zip(model.names, values, strict=True))
    kinds = network.kinds or [""] * network.n_balls
    return np.array([value_of_kind.get(kind, np.nan) for kind in kinds])


def _compare_stiffnesses(network: Any, strong: Index) -> Array:
    """Return the normal stiffnesses of ``strong`` contacts over those of Hertz's law under the
    force, (m,), of the contacts whose materials are known.
    """
    moduli = _find_of_materials(network, lambda material: material.contact_modulus)
    known = strong[np.isfinite(moduli[network.i[strong]] + moduli[network.j[strong]])]
    i = network.i[known]
    j = network.j[known]
    if not known.size:
        return np.zeros(0)
    diameters = harmonic_diameter(2.0 * network.radii[i], 2.0 * network.radii[j])
    compliances = 0.5 / moduli[i] + 0.5 / moduli[j]
    # the coefficient goes as the modulus of the pair and as the root of the diameter: its unit is
    # that of a diameter of 1 m
    material = network.contact_model.kinds[0].material
    coefficient = HertzLaw.between(material, 1.0).coefficient * np.sqrt(diameters)
    coefficient /= compliances * material.contact_modulus
    unit = HertzLaw(1.0)  # Hertz's law is proportional to its coefficient
    expected = coefficient * unit.stiffness(unit.overlap(network.normal_force[known] / coefficient))
    return np.asarray(network.normal_stiffness[known] / expected)


def _compare_rounding(error: float) -> Comparison:
    """Return the comparison of the digits of places, which leave the relative ``error`` in
    forces.
    """
    return Comparison(
        name="rounding",
        meaning="part of the forces that the digits of places leave open",
        value=error,
        limit=_ROUNDED,
        fault=f"Places are rounded: their digits leave {error:.1%} of the forces open",
        reason=f"The forces follow from overlaps: frequencies are off by about"
        f" {FREQUENCY_EXPONENT * error:.1%}. Write places with more digits (in LAMMPS: dump_modify"
        f" 1 format float %.16g), or give the forces",
    )


def _compare_balls(network: Any) -> Iterator[Comparison]:
    """Yield the comparisons of masses against the density, if that is known, and of inertias
    against those of solid spheres, of the balls that move.
    """
    is_ball = network.moving & np.isfinite(network.radii)
    if not np.any(is_ball):
        return
    radii = network.radii[is_ball]
    masses = network.masses[is_ball]
    densities = _find_of_materials(network, lambda material: material.density)[is_ball]
    if np.all(np.isfinite(densities)):
        mass_ratio = float(np.median(masses / (densities * (4.0 / 3.0 * np.pi) * radii**3)))
        listed = ", ".join(f"{density:g}" for density in np.unique(densities))
        yield _compare_median(
            "masses",
            "median of the mass over that of a solid ball of the material, less one",
            mass_ratio,
            f"The masses are {{ratio}} times those of solid balls of {listed} kg/m3",
            "The masses count, and the density does not: if the density is right, all frequencies"
            " are off by {effect}. Compare units and material. If balls are not solid, give the"
            " density of mass over volume",
            effect=mass_ratio**-0.5,
        )
    inertias = network.inertias[is_ball]
    inertia_ratio = float(np.median(inertias / (_SOLID * masses * radii**2)))
    if network.ball_motions.rotate:
        yield _compare_median(
            "inertias",
            "median of the moment of inertia over that of a solid sphere of the mass, less one",
            inertia_ratio,
            "The moments of inertia are {ratio} times those of solid spheres",
            "They count: if balls are solid, frequencies of rotations are off by {effect}",
            effect=inertia_ratio**-0.5,
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
    """Return the comparison of a ``median`` ratio, whose difference from one must not be above the
    limit and a ``slack``; ``effect`` is the factor of frequencies that belongs to it.
    """
    value = abs(median - 1.0)
    return Comparison(
        name=name,
        meaning=meaning,
        value=value,
        limit=_ALIKE + slack,
        fault=fault.format(ratio=f"{median:.4g}"),
        reason=reason.format(effect=f"{abs(effect - 1.0):.1%}"),
    )


# -- what holds the balls --------------------------------------------------------------------------


def _compare_hold(network: Any) -> Iterator[Comparison]:
    """Yield the comparisons of rattlers, of pieces, and of the number of contacts."""
    rattlers = network.rattlers
    yield Comparison(
        name="rattlers",
        meaning="balls that carry no load",
        value=float(rattlers.size),
        limit=0.0,
        worst=tuple((network.name_ball(ball),) for ball in rattlers[:_NAMED].tolist()),
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


def _compare_coordination(network: Any, is_held: Array) -> Comparison:
    """Return the comparison of the number of contacts per ball with the isostatic number, at which
    as many deformations are resisted as there are motions (Maxwell's count). It is that of the
    balls for which ``is_held`` (n,) is true. A contact that resists nothing counts as one that
    resists one deformation.
    """
    motions = network.ball_motions
    n_held = int(np.count_nonzero(is_held))
    is_end = is_held | ~network.moving
    is_counted = is_end[network.i] & is_end[network.j]
    n_contacts = int(np.count_nonzero(is_counted))
    # kinds of deformations that the motions make: normals have no component along motions out of
    # the plane
    n_along = int(0 in motions.translations)
    n_twists = int(motions.twist)
    rows = {
        "normal_stiffness": n_along,
        "shear_stiffness": len(motions.translations) - n_along,
        "torsion_stiffness": n_twists,
        "bending_stiffness": len(motions.rotations) - n_twists,
    }
    n_resisted = sum(
        n_rows * int(np.count_nonzero(getattr(network, name)[is_counted]))
        for name, n_rows in rows.items()
    )
    n_needed = motions.count * n_held - _count_rigid_motions(network)
    per_ball = 2.0 * n_contacts / n_held
    n_soft = n_needed - n_resisted
    resisted_by_contact = n_resisted / n_contacts if n_resisted else 1.0
    isostatic = 2.0 * n_needed / (n_held * resisted_by_contact)
    return Comparison(
        name="contacts",
        meaning="contacts per ball, of those that are held, against the isostatic number",
        value=per_ball,
        limit=isostatic,
        fault=f"The balls have {per_ball:.3g} contacts each, fewer than the {isostatic:.3g} of an"
        f" isostatic packing",
        reason=f"{n_soft} modes or more have the frequency zero",
        at_least=True,
    )


def _is_regular(network: Any) -> bool:
    """Whether all balls that move have the same number of contacts, as in a lattice or a row."""
    counts = np.bincount(np.concatenate([network.i, network.j]), minlength=network.n_balls)
    return bool(np.ptp(counts[network.moving]) == 0)


def _count_rigid_motions(network: Any) -> int:
    """Return the number of motions of the whole that deform no contact: none where bodies that do
    not move hold the balls, and no rotation of what repeats.
    """
    if not np.all(network.moving):
        return 0
    translations = network.ball_motions.translations
    planes = ((1, 2), (2, 0), (0, 1))
    n_turns = sum(
        all(axis in translations and not network.pbc[axis] for axis in plane) for plane in planes
    )
    return len(translations) + n_turns
