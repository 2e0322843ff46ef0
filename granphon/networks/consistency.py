"""Whether the numbers of a network agree with each other: its forces are in balance, and are those
of the law at its overlaps; its masses are those of the material; its contacts hold its balls.

Each comparison is of one number with a limit, names the balls that are farthest beyond it, and says
what that does to frequencies. By Hertz's law a stiffness goes as the third root of the force, so
that frequencies go as the sixth root of forces; they go as the inverse root of masses.

A ``network`` is a :class:`~granphon.networks.network.ContactNetwork`, which stands above this
module.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from granphon.balls.hertz import EXPONENT, FREQUENCY_EXPONENT, HertzLaw, harmonic_diameter
from granphon.base.arrays import Array, Index
from granphon.base.errors import InconsistencyWarning, message
from granphon.base.text import counted
from granphon.networks.sources import Balls, find_rounding

#: sum of the forces on a ball, over the mean force of a contact, up to which they are in balance
#: where static forces act: programs of discrete elements leave 1e-4 or less, and weights, walls or
#: digits that a file lacks leave more
BALANCED = 1e-3
#: the same sum, and that of torques over the mean force and the mean radius, from which a packing
#: that nothing else can hold still moves: in files with three digits, too few for forces, it stays
#: below
MOVING = 5e-3
#: greatest difference of a median ratio from one, and greatest scatter about the median
_ALIKE = 0.05
#: greatest error of forces by the rounding of places: frequencies have a sixth of it, 0.1 %
_ROUNDED = 6e-3
#: scatter of the forces of a source about those of its overlaps below which they follow from them
_FOLLOWS = 1e-9
#: least overlap of places over f/k: places with less have no overlaps, as those of a lattice
_LEAST_OVERLAP = 1e-3
#: most balls, or pairs of balls, that a comparison names
_NAMED = 3
#: moment of inertia of a solid sphere over m r^2
_SOLID = 0.4
#: comparisons that readers make themselves, with the names of their files, and that of rattlers,
#: which are there only if they were asked for
_MADE_BY_READERS = ("law", "scatter", "masses", "rounding", "rattlers")


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
    or contacts resist no slip; without prestress only where the network has no open ends. Overlaps,
    stiffnesses and masses are judged of networks that were read: in granphon's own the contacts
    follow their law, and balls need not be solid.
    """
    return tuple(_list_comparisons(network))


def warn_of_faults(network: Any) -> None:
    """Warn of each comparison that a network fails which has been read, but for those that its
    reader makes itself, with the names of its files.
    """
    for comparison in compare_numbers(network):
        if not comparison.holds and comparison.name not in _MADE_BY_READERS:
            text = message(comparison.fault, comparison.reason)
            warnings.warn(text, InconsistencyWarning, stacklevel=4)


def _list_comparisons(network: Any) -> Iterator[Comparison]:
    """Yield the comparisons."""
    if _has_known_forces(network):
        yield compare_forces(network)
        if network.tangential_force is not None:
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
        " other sign, or act at other arms",
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


def _compare_law(network: Any) -> Iterator[Comparison]:
    """Yield the comparisons of overlaps, forces and stiffnesses of the contacts with the median
    force or more, between balls that move: overlaps of others have large relative errors.

    A contact of the force f and the stiffness k has the overlap p f/k: p is 3/2 by Hertz's law, and
    1 where forces are proportional to overlaps; without a material p is the nearer of the two. The
    force at the overlap of the places is f times the power p of that overlap over p f/k.
    """
    joins_moving = network.moving[network.i] & network.moving[network.j]
    force = network.normal_force
    if network.adhesive or not np.any(force[joins_moving]):
        return
    strong = np.flatnonzero(joins_moving & (force >= np.median(force[joins_moving])))
    radii_i = network.radii[network.i[strong]]
    radii_j = network.radii[network.j[strong]]
    overlaps = radii_i + radii_j - network.distance[strong]
    linear_overlaps = (force / network.normal_stiffness)[strong]
    power = float(np.median(overlaps / linear_overlaps))
    if power <= _LEAST_OVERLAP:
        return
    has_material = network.contact_model is not None
    is_linear = abs(power - 1.0) <= _ALIKE if has_material else power < 0.5 * (1.0 + EXPONENT)
    power = 1.0 if is_linear else EXPONENT
    if has_material and not is_linear:
        stiffness_ratio = _compare_stiffness(network, strong)
        yield _compare_median(
            "stiffness",
            "median of the normal stiffness over that of Hertz's law under the force, less one",
            stiffness_ratio,
            "The normal stiffnesses are {ratio} times those of Hertz's law under the forces",
            "The stiffnesses count: if the law is right, all frequencies are off by {effect}",
            effect=stiffness_ratio**0.5,
        )
    # balls that are apart have the ratio zero
    ratios = (np.maximum(overlaps, 0.0) / (power * linear_overlaps)) ** power
    rounding = _find_rounding_of_overlaps(network)[strong]
    error = power * float(np.median(rounding / (power * linear_overlaps)))
    yield from _compare_forces_of_overlaps(network, strong, ratios, error)


def _compare_forces_of_overlaps(
    network: Any, strong: Index, ratios: Array, error: float
) -> Iterator[Comparison]:
    """Yield the comparisons of the forces of the law at the overlaps of ``strong`` contacts (m,),
    whose ``ratios`` to the forces are (m,); places leave the relative ``error`` in such forces.
    """
    median = float(np.median(ratios))
    deviations = np.abs(ratios / median - 1.0)
    scatter = float(np.median(deviations))
    yield _compare_median(
        "law",
        "median of the force of the law at the overlap of the places over the force, less one",
        median,
        "The forces of the law at the overlaps of the places are {ratio} times the forces",
        "By Hertz's law, if the overlaps are right and not the forces, all frequencies are off by"
        " {effect}",
        effect=median**FREQUENCY_EXPONENT,
        slack=error,
    )
    worst = strong[np.argsort(-deviations, kind="stable")[:_NAMED]]
    pairs = zip(network.i[worst].tolist(), network.j[worst].tolist(), strict=True)
    yield Comparison(
        name="scatter",
        meaning="median deviation of that ratio from its median, over the median",
        value=scatter,
        limit=_ALIKE + error,
        worst=tuple((network.name_ball(i), network.name_ball(j)) for i, j in pairs),
        fault=f"The ratios of forces to those of the law at the overlaps scatter by {scatter:.1%}",
        reason="Frequencies are of contacts whose forces are of another step, in another order, or"
        " of other materials",
    )
    yield _compare_rounding(network, error, follows=bool(np.max(deviations) < _FOLLOWS))


def _compare_stiffness(network: Any, strong: Index) -> float:
    """Return the median of the normal stiffness of ``strong`` contacts (m,) over that of Hertz's
    law of the material under the force.
    """
    diameters = harmonic_diameter(
        2.0 * network.radii[network.i[strong]], 2.0 * network.radii[network.j[strong]]
    )
    # the coefficient goes as the root of the diameter: its unit is that of a diameter of 1 m
    material = network.contact_model.kinds[0].material
    coefficient = HertzLaw.between(material, 1.0).coefficient * np.sqrt(diameters)
    unit = HertzLaw(1.0)  # Hertz's law is proportional to its coefficient
    expected = coefficient * unit.stiffness(
        unit.overlap(network.normal_force[strong] / coefficient)
    )
    return float(np.median(network.normal_stiffness[strong] / expected))


def _compare_rounding(network: Any, error: float, follows: bool) -> Comparison:
    """Return the comparison of the digits of places, which leave the relative ``error`` in forces
    that ``follows`` says to be those of the overlaps; others lose what directions of contacts lose.
    """
    if not follows:
        errors = _find_rounding_of_overlaps(network)
        error = float(np.median(errors / (network.arm_i + network.arm_j)))
    return Comparison(
        name="rounding",
        meaning="part of the forces that the digits of places leave open",
        value=error,
        limit=_ROUNDED,
        fault=f"The digits of places leave {error:.1%} of the forces open",
        reason=f"The forces follow from overlaps: frequencies are off by about"
        f" {FREQUENCY_EXPONENT * error:.1%}",
    )


def _find_rounding_of_overlaps(network: Any) -> Array:
    """Return the standard errors (n_c,), m, that the digits of places and radii leave in
    overlaps.
    """
    balls = Balls(
        "the network",
        network.positions,
        network.radii,
        rounding=find_rounding(network.positions),
        radius_rounding=find_rounding(network.radii),
    )
    _greatest, standard = balls.find_errors(network.i, network.j, network.normal)
    return standard


def _compare_balls(network: Any) -> Iterator[Comparison]:
    """Yield the comparisons of masses against the density, if that is known, and of inertias
    against those of solid spheres, of the balls that move.
    """
    is_ball = network.moving & np.isfinite(network.radii)
    if not np.any(is_ball):
        return
    radii = network.radii[is_ball]
    masses = network.masses[is_ball]
    if network.contact_model is not None:
        density = network.contact_model.kinds[0].material.density
        mass_ratio = float(np.median(masses / (density * (4.0 / 3.0 * np.pi) * radii**3)))
        yield _compare_median(
            "masses",
            "median of the mass over that of a solid ball of the material, less one",
            mass_ratio,
            "The masses are {ratio} times those of solid balls of the material",
            "The masses count: if the density is right, all frequencies are off by {effect}",
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
        fault=fault.format(ratio=f"{median:.3g}"),
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
    """Return the comparison of the contacts per ball against the isostatic number, at which as many
    deformations are resisted as there are motions (Maxwell's count), of balls that are held (n,).
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
    isostatic = per_ball * n_needed / n_resisted if n_resisted else 0.0
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
