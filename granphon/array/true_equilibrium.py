"""Mechanical equilibrium without friction of an array in its true geometry.

The energy is the sum of (2/5) h_+^(5/2) over all contacts, with the overlaps of
:mod:`granphon.array.geometry`. Away from the limit of small spread it is no longer convex: a
contact that carries a force f pushes the balls aside, with the stiffness -f W/d. On the lattice a
ball between two others in line may stay there. In truth it moves out until it touches a third,
which then carries a force of the order f W/d. The array is an assembly
(:mod:`granphon.contacts.assembly`) whose contacts turn, and comes to rest as others do
(:mod:`granphon.statics.rest`), from the equilibrium on the lattice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.array.contact_lists import (
    Springs,
    list_in_true_directions,
    select_resisted,
)
from granphon.array.equilibrium import CARRIED_FORCE, Equilibrium
from granphon.array.geometry import (
    ActingForces,
)
from granphon.array.stencils import Motion
from granphon.base.arrays import Array
from granphon.contacts.contact_list import ContactList
from granphon.statics.response import LinearResponse

#: force that holds a ball which moves aside, over W/d times the force that pushes it there, at
#: least: the distance in W
_ASIDE = 1e-2


@dataclass(frozen=True, eq=False, repr=False)
class TrueEquilibrium(Equilibrium):
    """Sample at rest without friction in its true geometry, in units of W and c W^(3/2).

    ``overlap`` is y = (d - a)/W, with the spacing a of the compressed cell. Other attributes are
    those of :class:`~granphon.array.equilibrium.Equilibrium`. ``stiffness`` is df*/dy of the mean
    normal force.
    """

    def _act(self) -> ActingForces:
        """Return the contacts that carry load, without friction.

        Balls that light contacts push aside lean on others with about W/d of their force. Where
        that cannot be told from the residual, the light contacts hold instead, with W/d of their
        force.
        """
        stiffness = self.stiffnesses
        least = CARRIED_FORCE * self.residual * self.force
        carried = np.where(_ASIDE * self.ratio * self.forces > least, self.forces, -self.forces) * (
            stiffness > 0.0
        )
        return ActingForces(lambda loss, slip: (stiffness * loss, slip), carried)

    def _act_at_rest(self, shear: Array | None = None) -> ActingForces:
        """Return what :meth:`_act` does where the energy is known to be least.

        A ball nearly in line with two others may lean on a third with less than can be told from
        the residual. It is at rest all the same: what pushes it aside then holds it. Contacts that
        resist slip with ``shear`` times their stiffness hold balls themselves, and light ones need
        not.
        """
        acting = self._act()
        stencils = self.stencils
        stiffness = self.stiffnesses
        if shear is not None:
            acting = acting._replace(forces=np.abs(acting.forces))
            pushing = self.ratio * acting.forces / self.place.size
            if np.all(shear * stiffness >= pushing):
                return acting
        axes = self.place.geometry.axes()
        table = self.place.tabulate_stiffness(stiffness, acting.forces)
        if shear is not None:
            normal = np.array(self.place.normal[: len(table)])
            table -= shear * stiffness * normal[:, None] * normal
            for axis in range(len(table)):
                table[axis, axis] += shear * stiffness
        blocks = [
            [stencils.around(one) for one in row]
            for row in np.einsum("nka,kln...,nlb->abn...", axes, table, axes)
        ]
        aside = np.linalg.eigvalsh(np.moveaxis(np.array(blocks), (0, 1), (-2, -1)))[..., 0] < 0.0
        leans = stencils.average_pairs(aside.astype(float)) > 0.0
        return acting._replace(forces=np.where(leans, -np.abs(acting.forces), acting.forces))

    def _follow(self) -> tuple[Callable[[Array], Array], Any]:
        """Return what finds small motions of the balls, and the relative displacements of contacts
        with y.
        """
        acting = self._act_at_rest()
        still = np.zeros_like(self.balls)
        pull, _ = self.place.respond(Motion(still, 1.0), acting)
        stencils = self.stencils
        response = LinearResponse(self._list_contacts())

        def find(forces: Array) -> Array:
            motions = response.find_motions(stencils.list_forces(forces)[..., None])
            return stencils.gather_motions(motions[..., 0])

        return find, self.place.geometry.split(Motion(find(-pull), 1.0))[0]

    def response(self) -> Array:
        """Return (n_c, L1, ..., Lp) derivatives of the contacts' overlaps with respect to y;
        computed anew at each call.
        """
        return -self.place.lose(self._follow()[1])

    @cached_property
    def _derivatives(self) -> tuple[float, float]:
        place = self.place
        find, moved = self._follow()
        loss = place.lose(moved)
        stiffness = self.stiffnesses
        # the second derivatives: of the overlaps along the motion itself, and by the motion that
        # balances those of forces
        bend, push = place.curve(moved, self.forces, stiffness, self.stiffness_slopes)
        more = bend - place.lose(
            place.geometry.split(Motion(find(place.geometry.join(push, *_STILL)), 0.0))[0]
        )
        return float(np.mean(-stiffness * loss)), float(
            np.mean(self.stiffness_slopes * loss**2 + stiffness * more)
        )

    def _list_contacts(
        self, shear: ArrayLike = 0.0, torsion: ArrayLike = 0.0, bending: float = 0.0
    ) -> ContactList:
        """Return the contacts with their springs and the forces that act, so that elastic constants
        include prestress; those that carry no load have none.
        """
        ratio = np.asarray(shear, float)
        turns = bool(np.any(ratio))
        if not turns:
            # only shear turns balls that are strained: without it twist and roll store nothing
            torsion = bending = 0.0
        forces = self._act_at_rest(ratio if turns else None).forces
        return list_exact_contacts(self, forces, ratio, torsion, bending, turns)


def list_exact_contacts(
    state: Equilibrium,
    forces: Array,
    shear: Array,
    torsion: ArrayLike,
    bending: float,
    turns: bool = True,
    shears: Array | None = None,
) -> ContactList:
    """Return the contacts of a state at rest in the true geometry, with the forces that act.

    ``forces`` (n_c, L1, ..., Lp) are normal, below zero where they hold balls that go aside, and
    ``shears`` tangential, if there are any. ``shear``, ``torsion`` and ``bending`` are those of
    :meth:`~granphon.array.equilibrium.Equilibrium.find_elasticity`; ``turns`` says whether balls
    rotate.
    """
    normal = state.stiffnesses
    springs = Springs.of(normal, shear * normal, np.asarray(torsion) * normal, bending * normal)
    return list_in_true_directions(
        state.place,
        select_resisted(state.lattice, float(turns), torsion, bending),
        springs,
        np.abs(forces),
        forces < 0.0,
        None if shears is None else (normal > 0.0) * shears,
    )


_STILL = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
