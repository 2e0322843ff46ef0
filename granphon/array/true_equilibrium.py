"""Mechanical equilibrium without friction of an array in its true geometry.

The energy is the sum of (2/5) h_+^(5/2) over all contacts, with the overlaps of
:mod:`granphon.array.geometry`. Away from the limit of small spread it is no longer convex: a
contact that carries a force f pushes the balls aside, with the stiffness -f W/d. On the lattice a
ball between two others in line may stay there. In truth the ball moves out until it touches a third
one, and this contact then carries a force of the order f W/d. The array is an assembly
(:mod:`granphon.contacts.assembly`) whose contacts turn, and comes to rest as others do
(:mod:`granphon.statics.find_rest`), from the equilibrium on the lattice.
"""

from __future__ import annotations

from dataclasses import replace
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
from granphon.array.geometry import list_displacements
from granphon.array.options import ReducedLoad
from granphon.base.arrays import Array
from granphon.base.results import result_class
from granphon.contacts.contact_list import ContactList
from granphon.contacts.deformation import measure_resistance
from granphon.contacts.placed import collect_pulls
from granphon.contacts.tangent import fill_blocks
from granphon.statics.configuration import list_shears
from granphon.statics.response import ListResponse

#: least force that holds a ball which another contact pushes aside, over W/d times the force of
#: that contact: the least distance, in W, by which such a ball lies aside
_ASIDE = 1e-2


@result_class
class TrueEquilibrium(Equilibrium):
    """Sample at rest without friction in its true geometry, in units of W and c W^(3/2).

    ``overlap`` is y = (d - a)/W, with the spacing a of the compressed cell; if the cell has taken
    another shape, that of an even cell of its size. Other attributes are those of
    :class:`~granphon.array.equilibrium.Equilibrium`. ``stiffness`` is df*/dy of the mean normal
    force.
    """

    def _sign_forces(self) -> Array:
        """Return the normal forces (n_c, L1, ..., Lp) of contacts that carry load, zero of others,
        with the sign turned of those that count as holding their balls against going aside.

        A contact with the force f pushes its balls aside, and they come to lean on other contacts
        with about f W/d. If so small a force cannot be told from the residual, these other contacts
        do not count as carrying load, and nothing would hold the balls: the contact itself then
        counts as holding them, with the same stiffness f W/d.
        """
        least_force = CARRIED_FORCE * self.residual * self.force
        # whether the least force that holds its balls could be told from the residual
        is_told = _ASIDE * self.ratio * self.forces > least_force
        signed = np.where(is_told, self.forces, -self.forces)
        return np.asarray(signed * (self.stiffnesses > 0.0))

    def _sign_forces_at_rest(self, shear: Array | None = None) -> Array:
        """Return the forces of :meth:`_sign_forces`, with the sign turned below zero also of all
        contacts of balls that would go aside while all others are held: the balls are known to rest
        where their energy is least.

        A ball nearly in line with two others may lean on a third with a force that cannot be told
        from the residual. Whether the contacts of a ball would push it aside is seen by its block
        of the tangent: the lowest eigenvalue is then below zero. Contacts that resist slip with
        ``shear`` (a number, or one for each contact) times their normal stiffness hold balls
        themselves: then all contacts count as pushing, and signs are turned only where this
        resistance is not enough. None stands for no resistance.
        """
        acting = self._sign_forces()
        ratio = np.asarray(0.0 if shear is None else shear)
        if shear is not None:
            acting = np.abs(acting)
            pushing = self.ratio * acting / self.place.size
            if np.all(shear * self.stiffnesses >= pushing):
                return acting
        contacts = list_exact_contacts(self, acting, ratio, 0.0, 0.0, False)
        alone = fill_blocks(contacts.columns, contacts.axes, np.zeros((0, 3, 3)), contacts.n_balls)
        blocks = np.moveaxis(alone.diagonal, -1, 0)
        goes_aside = np.linalg.eigvalsh(blocks)[:, 0] < 0.0
        must_hold = (goes_aside[contacts.i] | goes_aside[contacts.j]).reshape(acting.shape)
        return np.where(must_hold, -np.abs(acting), acting)

    def _follow(self) -> tuple[SmallMotions, Array]:
        """Return the small motions of the balls, and the displacements (contacts, 3) of balls j
        less those of balls i by a unit of y in a cell that keeps its shape.

        Side effect: the derivatives :attr:`_along` are kept.
        """
        motions = SmallMotions(self)
        # the cached property would make the small motions once more
        if "_along" not in vars(self):
            vars(self)["_along"] = self._find_along(motions)
        along = list_displacements(self.stencils, self._along)
        return motions, motions.even + motions.separate(along)

    @cached_property
    def _along(self) -> Array:
        """(n p, L1, ..., Lp) derivatives of ``balls`` with respect to y in a cell that keeps its
        shape.
        """
        return self._find_along(SmallMotions(self))

    def _find_along(self, motions: SmallMotions) -> Array:
        """Return the derivatives :attr:`_along`, by the small ``motions`` of the balls."""
        return self.stencils.gather_motions(motions.relax(motions.even))

    def approach(self, load: ReducedLoad) -> TrueEquilibrium:
        """Return the state under a ``load`` near that which the balls bear, to first order in the
        difference of the loads, in a cell that keeps its shape. The state is at rest to first order
        only: its ``residual`` and the numbers of steps are those of this one.

        A force of the ``load`` is taken as a mean force, also where it is one on the boundary.
        """
        if load.overlap is None:
            change = (load.force - self.force) / self.stiffness
        else:
            change = load.overlap - self.overlap
        balls = self.balls + change * self._along
        state = replace(self, overlap=self.overlap + change, balls=balls)
        return state.share(self.deviations, self.stencils)

    def response(self) -> Array:
        """Return (n_c, L1, ..., Lp) derivatives of the overlaps of contacts with respect to y;
        computed anew at each call.
        """
        if self.strain is not None:
            course = self._find_course()
            return -self.place.lose(course.moved) / course.growth[0]
        _, moved = self._follow()
        return -self.place.lose(moved)

    @cached_property
    def stiffness(self) -> float:
        """Stiffness df*/dy, a reduced number. In a cell that keeps its shape it is found without
        its slope, which costs a linear response more; elsewhere the slope is kept with it.
        """
        if self.strain is not None:
            stiffness, slope = self._find_derivatives()
            vars(self)["stiffness_slope"] = slope
            return stiffness
        _, moved = self._follow()
        return float(np.mean(-self.stiffnesses * self.place.lose(moved)))

    def _find_derivatives(self) -> tuple[float, float]:
        """Return the first and the second derivative of the mean force of contacts with respect to
        y, reduced.
        """
        if self.strain is not None:
            return self._find_course().find_derivatives()
        place = self.place
        motions, moved = self._follow()
        loss = place.lose(moved)
        stiffness = self.stiffnesses
        # along the straight motion, overlaps have the second derivative `bend`, and forces `push`;
        # the balls have a second derivative that balances these forces
        bend, push = place.curve(moved, self.forces, stiffness, self.stiffness_slopes)
        push_on_balls, _ = motions.collect(push)
        balancing = motions.separate(motions.find(push_on_balls))
        overlap_curvature = bend - place.lose(balancing)
        curvature = self.stiffness_slopes * loss**2 + stiffness * overlap_curvature
        return float(np.mean(-stiffness * loss)), float(np.mean(curvature))

    def _find_course(self) -> HydrostaticCourse:
        """Return how the cell and the balls move as the pressure rises and the stress stays
        hydrostatic.
        """
        return HydrostaticCourse(self, *self._follow())

    def _list_contacts(
        self, shear: ArrayLike = 0.0, torsion: ArrayLike = 0.0, bending: float = 0.0
    ) -> ContactList:
        """Return the contacts with their springs and the static forces that act, so that elastic
        constants include prestress; contacts that carry no load have neither.
        """
        ratio = np.asarray(shear, float)
        turns = bool(np.any(ratio))
        if not turns:
            # only shear turns balls that are strained: without it twist and roll store nothing
            torsion = 0.0
            bending = 0.0
        forces = self._sign_forces_at_rest(ratio if turns else None)
        return list_exact_contacts(self, forces, ratio, torsion, bending, turns)


class SmallMotions:
    """The small motions of balls at rest in the true geometry, without friction, and the forces of
    contacts against them. Displacements are in W.

    Attributes
    ----------
    even : (contacts, 3) displacements of balls j less those of balls i where y grows by one and
        balls keep their places in the cell: minus the directions on the lattice.
    """

    def __init__(self, state: TrueEquilibrium) -> None:
        self._contacts = state._list_contacts()
        self._directions = state.place.direction
        self._response = ListResponse(self._contacts, np.zeros((0, 3, 3)))
        self.even = -self._directions

    def resist(self, moved: Array) -> Array:
        """Return the forces (contacts, 3) on balls j that it takes to displace them against balls
        i by ``moved`` (contacts, 3), small; contacts exert the opposite forces.
        """
        contacts = self._contacts
        push = np.empty_like(moved)
        springs = (contacts.normal_stiffness, contacts.side_stiffness)
        measure_resistance(contacts.normal, moved, *springs, push)
        return push

    def collect(self, push: Array) -> tuple[Array, Array]:
        """Return the forces (n, p) on balls, and the sum (p, p) over contacts of the product of
        ``push`` (first index) and the direction on the lattice (second).

        Ball j of each contact bears the force ``push`` (contacts, 3), and ball i the opposite one.
        """
        contacts = self._contacts
        p = contacts.dimension
        ends = (contacts.i, contacts.j)
        forces, sums = collect_pulls(ends, self._directions, push, contacts.n_balls)
        return np.ascontiguousarray(forces[:, :p]), sums[:p, :p]

    def find(self, forces: Array) -> Array:
        """Return the motions (n, p) of balls under small forces (n, p)."""
        return self._response.find_motions(forces[..., None])[..., 0]

    def relax(self, affine: Array) -> Array:
        """Return the motions (n, p) with which balls come into balance again, after the cell has
        displaced them by ``affine`` (contacts, 3), balls j less balls i.
        """
        resistance, _ = self.collect(self.resist(affine))
        return self.find(-resistance)

    def separate(self, motions: Array) -> Array:
        """Return the displacements (contacts, 3) of balls j less those of balls i, from the motions
        (n, p) of balls.
        """
        contacts = self._contacts
        moved = np.zeros((contacts.n_contacts, 3))
        moved[:, : contacts.dimension] = motions[contacts.j] - motions[contacts.i]
        return moved

    def strain(self, strain: Array) -> Array:
        """Return the displacements (contacts, 3) of balls j less those of balls i under a
        ``strain`` (p, p) of the cell, in W/d, after the balls have come into balance again.
        """
        affine = np.zeros_like(self._directions)
        p = len(strain)
        affine[:, :p] = self._directions[:, :p] @ strain.T
        return affine + self.separate(self.relax(affine))


class HydrostaticCourse:
    """The motion of a cell that shears as the pressure on it rises: its stress stays hydrostatic.

    The course is a function of a parameter t. The cell F, a (p, p) matrix that takes the lattice to
    the cell, has the derivative eps (-1 + sum of shears) by t: as t grows by one, each diameter of
    the cell shrinks by W, and the cell shears by strains that keep its size to first order. The
    displacement of a contact is here that of ball j less that of ball i. A stress is here S F^T,
    but for a factor, where S is the sum over contacts of the force on ball j times the direction on
    the lattice. The stress is symmetric at rest, and hydrostatic if no shear of
    :func:`~granphon.statics.configuration.list_shears` does work on it.

    Parameters
    ----------
    state : balls at rest.
    motions : the small motions of these balls.
    even : (contacts, 3) displacements of contacts by a unit of t in a cell that does not shear,
        balls in balance again.

    Attributes
    ----------
    moved : (contacts, 3) displacements of contacts by a unit of t.
    """

    def __init__(self, state: TrueEquilibrium, motions: SmallMotions, even: Array) -> None:
        self._state = state
        self._place = state.place
        self._motions = motions
        p = state.lattice.periods
        self._units = list_shears(p)
        eps = state.ratio
        strain = np.zeros((p, p)) if state.strain is None else state.strain
        self._cell = np.eye(p) - eps * state.overlap * np.eye(p) + eps * strain
        push = state.forces.reshape(-1, 1) * state.place.normal
        _, forces = motions.collect(push)  # S
        #: (contacts, 3) displacements of contacts by each unit shear, balls in balance again
        self._sheared = [motions.strain(unit) for unit in self._units]
        # changes of the stress S F^T by each unit shear, and by the even strain: by that of F, and
        # by that of S
        by_shears = [
            eps * forces @ unit + self._change_forces(moved) @ self._cell
            for unit, moved in zip(self._units, self._sheared, strict=True)
        ]
        #: (s, s) work on each unit shear (first index) of the change of stress by each (second)
        self._resistance = self._project(by_shears).T
        by_even_strain = -eps * forces + self._change_forces(even) @ self._cell
        shears = self._balance(by_even_strain)
        self.moved = self._add(even, shears)
        #: (p, p) first derivative of the cell
        self._strained = eps * (np.einsum("s,sab->ab", shears, self._units) - np.eye(p))

    @cached_property
    def growth(self) -> tuple[float, float]:
        """First and second derivative of y by t, where the cell has no second derivative."""
        return self._measure(np.zeros_like(self._cell))

    def find_derivatives(self) -> tuple[float, float]:
        """Return the first and the second derivative of the mean force f* by the overlap y, from
        those of both by t.
        """
        state = self._state
        place = self._place
        stiffness = state.stiffnesses
        slopes = state.stiffness_slopes
        # the first derivative of the motion, continued in a straight line, would leave forces and a
        # stress of second order: the second derivative moves balls and shears the cell so that
        # balls are in balance and the stress is hydrostatic
        bend, push = place.curve(self.moved, state.forces, stiffness, slopes)
        on_balls, on_cell = self._motions.collect(push)
        straight = self._motions.separate(self._motions.find(on_balls))
        forced = (on_cell + self._change_forces(straight)) @ self._cell
        forced += 2.0 * self._change_forces(self.moved) @ self._strained.T
        shears = self._balance(forced)
        overlap_curvature = bend - place.lose(self._add(straight, shears))
        loss = place.lose(self.moved)
        first = float(np.mean(-stiffness * loss))
        second = float(np.mean(slopes * loss**2 + stiffness * overlap_curvature))
        bent = state.ratio * np.einsum("s,sab->ab", shears, self._units)
        rise, curvature = self._measure(bent)
        return first / rise, (second - first / rise * curvature) / rise**2

    def _measure(self, bent: Array) -> tuple[float, float]:
        """Return the first and the second derivative of y by t, from those of the size of the cell:
        log det F = p log(1 - eps y). ``bent`` (p, p) is the second derivative of F.
        """
        eps = self._state.ratio
        p = len(self._cell)
        inverse = np.linalg.inv(self._cell)
        # the derivatives of log det F are tr(F^-1 F') and tr(F^-1 F'') - tr((F^-1 F')^2)
        rate = inverse @ self._strained
        spacing = 1.0 - eps * self._state.overlap
        first = -float(np.trace(rate)) * spacing / (p * eps)
        shrinking = float(np.trace(inverse @ bent) - np.trace(rate @ rate))
        return first, -shrinking * spacing / (p * eps) - eps * first**2 / spacing

    def _add(self, moved: Array, shears: Array) -> Array:
        """Return the displacements ``moved`` (contacts, 3) plus those by the amounts ``shears``
        (s,) of the unit shears of the cell.
        """
        for shear, sheared in zip(shears, self._sheared, strict=True):
            moved = moved + shear * sheared
        return moved

    def _change_forces(self, moved: Array) -> Array:
        """Return the change (p, p) of the sum S by displacements ``moved`` (contacts, 3)."""
        _, sum_of_resistances = self._motions.collect(self._motions.resist(moved))
        return -sum_of_resistances

    def _project(self, stresses: Any) -> Array:
        """Return the work (..., s) of stresses (..., p, p) on each unit shear of the cell: the sum
        over both indices of their product.
        """
        return np.asarray(np.einsum("...ab,sab->...s", np.asarray(stresses), self._units))

    def _balance(self, stress: Array) -> Array:
        """Return the amounts (s,) of the unit shears of the cell whose change of stress makes a
        ``stress`` (p, p) hydrostatic.
        """
        return np.asarray(-np.linalg.solve(self._resistance, self._project(stress)))


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

    ``forces`` (n_c, L1, ..., Lp) are the normal forces, with the sign turned where they hold balls
    against going aside; ``shears`` (contacts, 3) are the tangential forces of balls j on balls i
    along the axes of space, None without friction. ``shear``, ``torsion`` and ``bending`` are those
    of :meth:`~granphon.array.equilibrium.Equilibrium.find_elasticity`; ``turns`` says whether balls
    turn in answer to slips: without, the list has no rotations unless torsion or bending resist
    them.
    """
    normal = state.stiffnesses
    springs = Springs.of(normal, shear * normal, np.asarray(torsion) * normal, bending * normal)
    return list_in_true_directions(
        state.place,
        select_resisted(state.lattice, float(turns), torsion, bending),
        springs,
        np.abs(forces),
        forces < 0.0,
        shears,
    )
