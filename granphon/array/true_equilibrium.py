"""Mechanical equilibrium without friction of an array in its true geometry.

The energy is the sum of (2/5) h_+^(5/2) over all contacts, with the overlaps of
:mod:`granphon.array.geometry`. Away from the limit of small spread the energy is not convex: a
contact that carries a force f pushes its balls aside, with the stiffness -f W/d. In the directions
of the lattice a ball may stay in line between two others. In the true geometry this ball moves out
until it touches a third ball, and the new contact then carries a force of the order f W/d. The
array is an assembly (:mod:`granphon.contacts.assembly`) whose contacts turn, and comes to rest as
others do (:mod:`granphon.statics.find_rest`), from the equilibrium in the directions of the
lattice.
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
from granphon.base.arrays import Array, Flags
from granphon.base.results import result_class
from granphon.contacts.contact_list import ContactList
from granphon.contacts.deformation import measure_resistance
from granphon.contacts.placed import collect_pulls
from granphon.contacts.tangent import fill_blocks
from granphon.dynamics.linalg import bound_lowest
from granphon.statics.configuration import list_shears
from granphon.statics.response import ListResponse

#: least force that holds a ball which a contact pushes aside, over W/d times the force of that
#: contact. This ratio is the least distance, in W, by which such a ball lies aside
_LEAST_DISTANCE = 1e-2


@result_class
class TrueEquilibrium(Equilibrium):
    """Sample at rest without friction in its true geometry, in units of W and c W^(3/2).

    ``overlap`` is y = (d - a)/W, where a is the spacing of the lattice in the compressed cell or,
    if the cell has taken another shape, in an evenly compressed cell of the same size. Other
    attributes are those of :class:`~granphon.array.equilibrium.Equilibrium`. ``stiffness`` is
    df*/dy of the mean normal force.
    """

    def _sign_forces(self) -> Array:
        """Return the normal forces (n_c, L1, ..., Lp) of contacts that carry load; zero for all
        others. Forces of contacts that count as holding their balls against going aside are below
        zero.

        A contact with the force f pushes its balls aside, and they come to lean on other contacts
        with about f W/d. If so small a force cannot be told from the residual, these other contacts
        do not count as carrying load, and nothing would hold the balls: the contact itself then
        counts as holding them, with the same stiffness f W/d.
        """
        least_force = CARRIED_FORCE * self.residual * self.force
        # whether the least force that holds its balls could be told from the residual
        is_told = _LEAST_DISTANCE * self.ratio * self.forces > least_force
        signed_forces = np.where(is_told, self.forces, -self.forces)
        return np.asarray(signed_forces * (self.stiffnesses > 0.0))

    def _follow(self) -> tuple[SmallMotions, Array]:
        """Return the small motions of the balls, and the displacements (contacts, 3) of balls j
        less those of balls i by a unit of y in a cell that keeps its shape.

        Side effect: the derivatives :attr:`_balls_slope` are kept.
        """
        motions = SmallMotions(self)
        # the cached property would make the small motions once more
        if "_balls_slope" not in vars(self):
            vars(self)["_balls_slope"] = self._find_balls_slope(motions)
        slopes = list_displacements(self.stencils, self._balls_slope)
        return motions, motions.even + motions.separate(slopes)

    @cached_property
    def _balls_slope(self) -> Array:
        """(n p, L1, ..., Lp) derivatives of ``balls`` with respect to y in a cell that keeps its
        shape.
        """
        return self._find_balls_slope(SmallMotions(self))

    def _find_balls_slope(self, motions: SmallMotions) -> Array:
        """Return the derivatives :attr:`_balls_slope`, by the small ``motions`` of the balls."""
        return self.stencils.gather_motions(motions.relax(motions.even))

    def approach(self, load: ReducedLoad) -> TrueEquilibrium:
        """Return the state under a ``load`` near that which the balls bear, in a cell that keeps
        its shape. The state is at rest only to first order in the difference of the loads; its
        ``residual`` and the numbers of steps are those of this state.

        A force of the ``load`` is taken as a mean force, also if it stands for a pressure.
        """
        if load.overlap is None:
            change = (load.force - self.force) / self.stiffness
        else:
            change = load.overlap - self.overlap
        balls = self.balls + change * self._balls_slope
        state = replace(self, overlap=self.overlap + change, balls=balls)
        return state.share(self.deviations, self.stencils)

    def response(self) -> Array:
        """Return the derivatives (n_c, L1, ..., Lp) of the overlaps of contacts with respect to y,
        while balls stay in balance. They are computed anew at each call.

        Raises :class:`~granphon.base.errors.ConvergenceError` if they are not found.
        """
        if self.strain is not None:
            course = self._find_course()
            return -self.place.lose(course.displacements) / course.growth[0]
        _, displacements = self._follow()
        return -self.place.lose(displacements)

    def _find_derivatives(self, order: int) -> dict[int, float]:
        """Return derivatives of the mean force of contacts with respect to y, reduced, by their
        order: that of this ``order``, 1 or 2, and the other one if it costs nothing more. In a cell
        that keeps its shape the second derivative costs a linear response more than the first.
        """
        if self.strain is not None:
            stiffness, slope = self._find_course().find_derivatives()
            return {1: stiffness, 2: slope}
        place = self.place
        motions, displacements = self._follow()
        loss = place.lose(displacements)
        stiffnesses = self.stiffnesses
        first = float(np.mean(-stiffnesses * loss))
        if order == 1:
            return {1: first}
        # if balls went straight on, overlaps would have the second derivative `bend`, and forces
        # `push`; the second derivative of the motion of balls balances these forces
        bend, push = place.curve(displacements, self.forces, stiffnesses, self.stiffness_slopes)
        push_on_balls, _ = motions.collect(push)
        balancing = motions.separate(motions.find(push_on_balls))
        overlap_curvature = bend - place.lose(balancing)
        curvature = self.stiffness_slopes * loss**2 + stiffnesses * overlap_curvature
        return {1: first, 2: float(np.mean(curvature))}

    def _find_course(self) -> HydrostaticCourse:
        """Return how the cell and the balls move as the pressure rises and the stress stays
        hydrostatic.
        """
        return HydrostaticCourse(self, *self._follow())

    def _list_contacts(
        self, shear: ArrayLike = 0.0, torsion: ArrayLike = 0.0, bending: float = 0.0
    ) -> ContactList:
        """Return the contacts with their springs and with the static forces that act, so that
        elastic constants include prestress. Contacts that carry no load have neither stiffness nor
        force. Contacts of a ball that they would push aside count as holding it.
        """
        ratio = np.asarray(shear, float)
        can_turn = bool(np.any(ratio))
        forces = self._sign_forces()
        if not can_turn:
            # only shear turns balls that are strained: without it twist and roll store nothing
            contacts = list_exact_contacts(self, forces, ratio, 0.0, 0.0, False)
            return _hold(contacts, _find_holding(contacts))
        # contacts that resist slip hold balls themselves: all forces count as pushing
        forces = np.abs(forces)
        contacts = list_exact_contacts(self, forces, ratio, torsion, bending)
        side_stiffness = self.ratio * forces / self.place.size
        if np.all(ratio * self.stiffnesses >= side_stiffness):
            return contacts
        # but where this resistance is not enough
        without_turns = list_exact_contacts(self, forces, ratio, 0.0, 0.0, False)
        return _hold(contacts, _find_holding(without_turns))


def _find_holding(contacts: ContactList) -> Flags:
    """Return whether each contact (n_c,) of a list without rotations touches a ball that would go
    aside while all other balls are held.

    Such contacts count as holding their balls. For the balls are known to rest where their energy
    is least: a ball nearly in line with two others may lean on a third with a force that cannot be
    told from the residual. The contacts of a ball push it aside if the lowest eigenvalue of its
    block of the tangent is below zero.
    """
    tangent = fill_blocks(contacts.columns, contacts.axes, np.zeros((0, 3, 3)), contacts.n_balls)
    # most balls cannot go aside: the bounds of their eigenvalues are not below zero
    doubtful_balls = np.flatnonzero(bound_lowest(tangent.diagonal) < 0.0)
    blocks = np.moveaxis(tangent.diagonal[..., doubtful_balls], -1, 0)
    can_go_aside = np.zeros(contacts.n_balls, bool)
    can_go_aside[doubtful_balls] = np.linalg.eigvalsh(blocks)[:, 0] < 0.0
    return np.asarray(can_go_aside[contacts.i] | can_go_aside[contacts.j])


def _hold(contacts: ContactList, is_holding: Flags) -> ContactList:
    """Return the ``contacts``, of which those that ``is_holding`` (n_c,) marks hold their balls
    against going aside.
    """
    if not np.any(is_holding):
        return contacts
    leaning = is_holding if not contacts.leaning.size else contacts.leaning | is_holding
    return replace(contacts, leaning=leaning)


class SmallMotions:
    """The small motions of balls at rest in the true geometry, without friction, and the forces of
    contacts against them. Displacements are in W.

    Attributes
    ----------
    even : (contacts, 3) displacements of balls j less those of balls i as y grows by one and balls
        keep their places in the cell: minus the directions on the lattice.
    """

    def __init__(self, state: TrueEquilibrium) -> None:
        self._contacts = state._list_contacts()
        self._directions = state.place.direction
        self._response = ListResponse(self._contacts, np.zeros((0, 3, 3)))
        self.even = -self._directions

    def resist(self, displacements: Array) -> Array:
        """Return the forces (contacts, 3) on balls j that displace them against balls i by small
        ``displacements`` (contacts, 3); contacts exert the opposite forces.
        """
        contacts = self._contacts
        push = np.empty_like(displacements)
        springs = (contacts.normal_stiffness, contacts.side_stiffness)
        measure_resistance(contacts.normal, displacements, *springs, push)
        return push

    def collect(self, push: Array) -> tuple[Array, Array]:
        """Return the forces (n, p) on balls, and the sum (p, p) over contacts of ``push`` (first
        axis) times the direction on the lattice (second axis).

        Ball j of each contact bears the force ``push`` (contacts, 3), and ball i the opposite one.
        """
        contacts = self._contacts
        p = contacts.dimension
        ends = (contacts.i, contacts.j)
        forces, sums = collect_pulls(ends, self._directions, push, contacts.n_balls)
        return np.ascontiguousarray(forces[:, :p]), sums[:p, :p]

    def find(self, forces: Array) -> Array:
        """Return the motions (n, p) of balls under small ``forces`` (n, p) on them."""
        return self._response.find_motions(forces[..., None])[..., 0]

    def relax(self, affine: Array) -> Array:
        """Return the motions (n, p) with which balls come into balance again after the cell has
        displaced balls j against balls i by ``affine`` (contacts, 3).
        """
        resistance, _ = self.collect(self.resist(affine))
        return self.find(-resistance)

    def separate(self, motions: Array) -> Array:
        """Return the displacements (contacts, 3) of balls j less those of balls i, from the motions
        (n, p) of balls.
        """
        contacts = self._contacts
        displacements = np.zeros((contacts.n_contacts, 3))
        displacements[:, : contacts.dimension] = motions[contacts.j] - motions[contacts.i]
        return displacements

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

    The course is a function of a parameter t. F is the (p, p) matrix that takes the lattice to the
    cell. Its derivative with respect to t is eps (-1 + sum of shears): as t grows by one, each
    diameter of the cell shrinks by W, and the cell shears by strains that keep its size to first
    order. In this class the displacement of a contact is that of ball j less that of ball i. The
    stress is S F^T but for a factor, where S is the sum over contacts of the force on ball j times
    the direction on the lattice. The stress is symmetric at rest, and hydrostatic if no shear of
    :func:`~granphon.statics.configuration.list_shears` does work on it.

    Parameters
    ----------
    state : balls at rest.
    motions : the small motions of these balls.
    even : (contacts, 3) displacements of contacts by a unit of t in a cell that does not shear,
        with balls in balance again.

    Attributes
    ----------
    displacements : (contacts, 3) displacements of contacts by a unit of t.
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
        #: for each unit shear, the displacements (contacts, 3) of contacts, with balls in balance
        #: again
        self._shear_displacements = [motions.strain(unit) for unit in self._units]
        # changes of the stress S F^T by each unit shear, and by the even strain: the first term is
        # the change of F, the second that of S
        shear_stresses = [
            eps * forces @ unit + self._change_forces(displacements) @ self._cell
            for unit, displacements in zip(self._units, self._shear_displacements, strict=True)
        ]
        #: (s, s) work on each unit shear (first axis) of the change of stress by each unit shear
        #: (second axis)
        self._resistance = self._project(shear_stresses).T
        even_stress = -eps * forces + self._change_forces(even) @ self._cell
        shears = self._balance(even_stress)
        self.displacements = self._add(even, shears)
        #: (p, p) first derivative of F
        self._cell_slope = eps * (np.einsum("s,sab->ab", shears, self._units) - np.eye(p))

    @cached_property
    def growth(self) -> tuple[float, float]:
        """First and second derivative of y with respect to t if F has no second derivative."""
        return self._measure(np.zeros_like(self._cell))

    def find_derivatives(self) -> tuple[float, float]:
        """Return the first and the second derivative of the mean force f* with respect to the
        overlap y, from the derivatives of f* and of y with respect to t.
        """
        state = self._state
        place = self._place
        stiffness = state.stiffnesses
        slopes = state.stiffness_slopes
        # the first derivative of the motion, continued in a straight line, would leave forces and a
        # stress of second order: the second derivative moves balls and shears the cell so that
        # balls are in balance and the stress is hydrostatic
        bend, push = place.curve(self.displacements, state.forces, stiffness, slopes)
        ball_forces, force_sum = self._motions.collect(push)
        balancing = self._motions.separate(self._motions.find(ball_forces))
        stress = (force_sum + self._change_forces(balancing)) @ self._cell
        stress += 2.0 * self._change_forces(self.displacements) @ self._cell_slope.T
        shears = self._balance(stress)
        overlap_curvature = bend - place.lose(self._add(balancing, shears))
        loss = place.lose(self.displacements)
        first = float(np.mean(-stiffness * loss))
        second = float(np.mean(slopes * loss**2 + stiffness * overlap_curvature))
        cell_curvature = state.ratio * np.einsum("s,sab->ab", shears, self._units)
        rise, curvature = self._measure(cell_curvature)
        return first / rise, (second - first / rise * curvature) / rise**2

    def _measure(self, cell_curvature: Array) -> tuple[float, float]:
        """Return the first and the second derivative of y with respect to t, from those of the size
        of the cell: log det F = p log(1 - eps y). ``cell_curvature`` (p, p) is the second
        derivative of F.
        """
        eps = self._state.ratio
        p = len(self._cell)
        inverse = np.linalg.inv(self._cell)
        # the derivatives of log det F are tr(F^-1 F') and tr(F^-1 F'') - tr((F^-1 F')^2)
        rate = inverse @ self._cell_slope
        spacing = 1.0 - eps * self._state.overlap
        first = -float(np.trace(rate)) * spacing / (p * eps)
        size_curvature = float(np.trace(inverse @ cell_curvature) - np.trace(rate @ rate))
        return first, -size_curvature * spacing / (p * eps) - eps * first**2 / spacing

    def _add(self, displacements: Array, shears: Array) -> Array:
        """Return the ``displacements`` (contacts, 3) plus those by the amounts ``shears`` (s,) of
        the unit shears of the cell.
        """
        for shear, by_unit in zip(shears, self._shear_displacements, strict=True):
            displacements = displacements + shear * by_unit
        return displacements

    def _change_forces(self, displacements: Array) -> Array:
        """Return the change (p, p) of the sum S by ``displacements`` (contacts, 3)."""
        _, sum_of_resistances = self._motions.collect(self._motions.resist(displacements))
        return -sum_of_resistances

    def _project(self, stresses: Any) -> Array:
        """Return the work (..., s) of ``stresses`` (..., p, p) on each unit shear of the cell: the
        sum of the products of their entries.
        """
        return np.asarray(np.einsum("...ab,sab->...s", np.asarray(stresses), self._units))

    def _balance(self, stress: Array) -> Array:
        """Return the amounts (s,) of the unit shears of the cell that, by the change of stress that
        they cause, make a ``stress`` (p, p) hydrostatic.
        """
        return np.asarray(-np.linalg.solve(self._resistance, self._project(stress)))


def list_exact_contacts(
    state: Equilibrium,
    forces: Array,
    shear: Array,
    torsion: ArrayLike,
    bending: float,
    can_turn: bool = True,
    shears: Array | None = None,
) -> ContactList:
    """Return the contacts of a ``state`` at rest in the true geometry, with the forces that act.

    ``forces`` (n_c, L1, ..., Lp) are the normal forces, with a negative sign if they hold balls
    against going aside. ``shears`` (contacts, 3) are the tangential forces of balls j on balls i
    along the axes of space, None without friction. ``shear``, ``torsion`` and ``bending`` are those
    of :meth:`~granphon.array.equilibrium.Equilibrium.find_elasticity`. ``can_turn`` says whether
    balls turn in answer to slips; if not, the list has rotations only if torsion or bending resist
    them.
    """
    normal = state.stiffnesses
    springs = Springs.of(normal, shear * normal, np.asarray(torsion) * normal, bending * normal)
    return list_in_true_directions(
        state.place,
        select_resisted(state.lattice, float(can_turn), torsion, bending),
        springs,
        np.abs(forces),
        forces < 0.0,
        shears,
    )
