"""What is known of the contacts of balls: their materials and the law, from which the stiffness of
any contact follows.

A crystal or a packing has a :class:`ContactModel`, and hands it to its networks of contacts. So a
network that is cut knows how its balls stand on a floor, which they did not touch before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from granphon.balls.ball import RIGID_PLANE, Ball, Body, ContactConstants, Wall
from granphon.balls.contact_laws import (
    DMT,
    JKR,
    Hertz,
    PairLaw,
    PowerLaw,
    TabulatedLaw,
    check_law,
    law_of_pair,
    punch_stiffness,
)
from granphon.balls.packing import MINDLIN, Packing
from granphon.base.arrays import Array
from granphon.base.errors import InputError

#: a contact law that plain data can hold
PlainLaw = Hertz | PowerLaw | DMT | JKR | TabulatedLaw
#: the law of the contacts of balls of several kinds: one law of all pairs, or pairs of names, each
#: with its law; a law may be a user's own
GivenLaw = PlainLaw | tuple[tuple[tuple[str, str], PlainLaw], ...] | Any
#: the stiffnesses of a contact
STIFFNESSES = ("normal_stiffness", "shear_stiffness", "torsion_stiffness", "bending_stiffness")
#: how plain data hold a law, for :func:`granphon.base.results.restore`
LAW_KINDS = [PlainLaw, (((str, str), PlainLaw), ...), Any]


@dataclass(frozen=True)
class ContactModel:
    """The kinds of the balls, and how they touch.

    Attributes
    ----------
    kinds : the ball of each kind, whose diameter is the mean one of the kind.
    names : what each kind is called; empty for balls of one kind that has no name.
    law : the law of all pairs, or a tuple of pairs of names, each with its law, as
        :func:`~granphon.balls.contact_laws.read_laws` returns it.
    friction : whether contacts resist slip, as those of Mindlin that do not slip.
    torsion : stiffness of a contact against twist, over k times the square of a distance: that of
        the two centres, or that of the centre from a wall. Or "mindlin", for the stiffness of an
        elastic contact that does not slip.
    bending : stiffness of a contact against rolling, over k times the square of the same distance.
    own_radii : whether contacts have the curvatures of the radii of their balls, not those of the
        kinds.
    walls : the elastic walls that balls touch, with their names.
    """

    kinds: tuple[Ball, ...] = field(metadata={"kind": (Ball, ...)})
    names: tuple[str, ...] = ()
    law: GivenLaw = field(default_factory=Hertz, metadata={"kind": LAW_KINDS})
    friction: bool = True
    torsion: float | str = 0.0
    bending: float = 0.0
    own_radii: bool = False
    walls: tuple[Wall, ...] = field(default=(), metadata={"kind": (Wall, ...)})

    @classmethod
    def of(cls, packing: Packing) -> Self:
        """Return the contact model of a packing, whose balls are of one kind and have the law of
        the mean ball.
        """
        ball = Ball(packing.material, packing.diameter)
        return cls(
            (ball,), friction=packing.friction, torsion=packing.torsion, bending=packing.bending
        )

    @property
    def is_plain(self) -> bool:
        """Whether plain data can hold the model: none of its laws is a user's own."""
        return all(isinstance(law, PlainLaw) for law in self._laws)

    @property
    def is_hertzian(self) -> bool:
        """Whether all contacts have Hertz's law."""
        return all(isinstance(law, Hertz) for law in self._laws)

    @property
    def _laws(self) -> list[Any]:
        """The laws of all pairs of kinds."""
        return [law for _, law in self.law] if isinstance(self.law, tuple) else [self.law]

    def body(self, name: str) -> Body:
        """Return the body called ``name``: the ball of a kind, a wall, or the rigid plane of a
        floor. If the kinds have no names, any other name is that of the only kind. Raises
        :class:`InputError` if no body is called so.
        """
        walls: list[Body] = [RIGID_PLANE, *self.walls]
        for wall in walls:
            if name == wall.name:
                return wall
        return self.kinds[self._find_number(name)]

    def _find_number(self, name: str) -> int:
        """Return the number of the kind called ``name``, 0 if the kinds have no names; InputError
        if there is no such kind.
        """
        if not self.names:
            return 0
        if name not in self.names:
            problem = f"the contact model has no kind {name!r}"
            raise InputError(problem, mend=f"Use one of {', '.join(self.names)}")
        return self.names.index(name)

    def law_of(self, name: str, other: str) -> tuple[PairLaw, float, float]:
        """Return for a contact of the bodies called ``name`` and ``other`` the contact law, the
        ratio 4 G*/E* of the shear to the normal stiffness (0 without friction), and E*, Pa. Raises
        :class:`InputError` for a name of no body, for two bodies that make no elastic contact, and
        for a pair without a law.
        """
        body = self.body(name)
        other_body = self.body(other)
        constants = ContactConstants.of(body, other_body)
        mindlin_ratio = constants.mindlin_ratio if self.friction else 0.0
        law = law_of_pair(self.law, body, other_body, name, other)
        return law, mindlin_ratio, constants.modulus

    def find_torsion(
        self, stiffness: Any, distance: Any, contact_radius: Any, twist_modulus: Any
    ) -> Array:
        """Return the stiffness against twist (m,), N m, of contacts with a normal ``stiffness``
        (m,), N/m.

        ``distance`` is the distance of the two centres, or of a centre from the wall, m,
        ``contact_radius`` the radius of the area of contact, m, and ``twist_modulus``, Pa, that of
        :class:`~granphon.balls.ball.ContactConstants`; each is a number or (m,).
        """
        if self.torsion == MINDLIN:
            return np.asarray(twist_modulus * contact_radius**3)
        return np.asarray(float(self.torsion) * stiffness * distance**2)

    def find_bending(self, stiffness: Any, distance: Any) -> Array:
        """Return the stiffness against rolling (m,), N m; for the arguments see
        :meth:`find_torsion`.
        """
        return np.asarray(self.bending * stiffness * distance**2)

    @property
    def named_kinds(self) -> dict[str, Ball]:
        """The ball of each kind by its name; empty if the kinds have no names."""
        return dict(zip(self.names, self.kinds, strict=True)) if self.names else {}

    def press_on_wall(
        self, names: Sequence[str], radii: Array, force: Array, wall: Body
    ) -> dict[str, Array]:
        """Return the contacts of balls with a flat wall, each under its own force.

        Parameters
        ----------
        names : (m,) the kind of each ball; empty if all are of the only kind.
        radii : (m,) radii of the balls, m, which are used if the model has ``own_radii``.
        force : (m,) force of each ball on the wall, N.
        wall : the flat body.

        Returns (m,) ``overlap``, m, ``arm``, the radius with which the contact is reckoned, m, and
        ``normal_stiffness``, ``shear_stiffness``, N/m, ``torsion_stiffness``,
        ``bending_stiffness``, N m. Raises :class:`~granphon.base.errors.InputError` for a force
        that the law does not bear, for a name of no kind, for kinds without a law, and for a law
        that :func:`~granphon.balls.contact_laws.check_law` refuses.
        """
        kind_of_ball = np.zeros(len(radii), int)
        if len(names):
            kind_of_ball = np.array([self._find_number(name) for name in names], int)
        diameters = 2.0 * radii
        if not self.own_radii:
            diameters = np.array([ball.diameter for ball in self.kinds])[kind_of_ball]
        columns = {name: np.zeros(len(radii)) for name in ("overlap", "arm", *STIFFNESSES)}
        # balls of the same kind and diameter share a law
        groups, group_of_ball = np.unique(
            np.stack([kind_of_ball, diameters], axis=1), axis=0, return_inverse=True
        )
        for group, (kind, diameter) in enumerate(groups.tolist()):
            balls = np.flatnonzero(group_of_ball.ravel() == group)
            group_columns = self._press_kind(int(kind), diameter, force[balls], wall)
            for name, group_column in group_columns.items():
                columns[name][balls] = group_column
        return columns

    def _press_kind(self, kind: int, diameter: float, force: Array, wall: Body) -> dict[str, Any]:
        """Return the arrays (m,), or numbers, of :meth:`press_on_wall` for balls of one kind and
        ``diameter``, m, under forces (m,), N, on a ``wall``.
        """
        ball = self.kinds[kind]
        body = Ball(ball.material, diameter) if self.own_radii else ball
        name = self.names[kind] if self.names else ""
        law = law_of_pair(self.law, body, wall, name, wall.name)
        constants = ContactConstants.of(body, wall)
        check_law(law, constants.radius)
        overlap = np.asarray(law.overlap(force))
        stiffness = np.asarray(law.stiffness(overlap))
        punch = punch_stiffness(law, overlap, constants.modulus)
        radius = 0.5 * diameter  # the distance of the centre from the wall, too
        contact_radius = punch / (2.0 * constants.modulus)
        shear_stiffness = constants.mindlin_ratio * punch if self.friction else 0.0
        torsion_stiffness = self.find_torsion(
            stiffness, radius, contact_radius, constants.twist_modulus
        )
        return {
            "overlap": overlap,
            "arm": radius,
            "normal_stiffness": stiffness,
            "shear_stiffness": shear_stiffness,
            "torsion_stiffness": torsion_stiffness,
            "bending_stiffness": self.find_bending(stiffness, radius),
        }
