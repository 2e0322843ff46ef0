"""An array of balls at rest, with the forces that its history has left."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from granphon.base.arrays import Array
from granphon.contacts.friction import Contacts, FrictionLaw


@dataclass(frozen=True, eq=False)
class PressedArray:
    """Array of balls at rest, with the forces that its history has left; in units of W and c
    W^(3/2).

    Attributes
    ----------
    overlap : y, common to all contacts.
    balls : (fields, L1, ..., Lp) displacements and rotations, in the coordinates of the stencils.
    contacts : state of the contacts.
    law : the law of the contacts.
    residual : largest force or torque (over the diameter) left on a ball, over the mean normal
        force.
    work : work of the load since the start, a mean over contacts, in units of c W^(5/2).
    slid, loosened, damped : energies lost since the start by sliding, by the law of the tangential
        force, and to dashpots; means over contacts, in units of c W^(5/2). Dashpots act while balls
        come to rest from a gas, and where balls fall.
    steps, newton, krylov : numbers of steps of the load, of Newton's method and of GMRES since the
        start.
    """

    overlap: float
    balls: Array
    contacts: Contacts
    law: FrictionLaw
    residual: float = 0.0
    work: float = 0.0
    slid: float = 0.0
    loosened: float = 0.0
    damped: float = 0.0
    steps: int = 0
    newton: int = 0
    krylov: int = 0

    @cached_property
    def force(self) -> float:
        """Mean normal force f*, over all contacts, open ones included."""
        return float(np.mean(self.contacts.forces))

    @cached_property
    def stored(self) -> float:
        """Mean energy that a contact stores, in units of c W^(5/2)."""
        return self.law.find_stored_energy(self.contacts)

    @property
    def dissipated(self) -> float:
        """Energy lost since the start, a mean over contacts, in units of c W^(5/2)."""
        return self.slid + self.loosened + self.damped

    def measure_motion(self, before: PressedArray) -> float:
        """Return the largest change of an overlap or a slip since the state ``before``, in W."""
        overlap_changes = self.contacts.overlaps - before.contacts.overlaps
        slip_changes = self.contacts.slips - before.contacts.slips
        return max(float(np.max(np.abs(overlap_changes))), float(np.max(np.abs(slip_changes))))

    @property
    def sliding_fraction(self) -> float:
        """Fraction of contacts with a tangential force at Coulomb's limit among those that carry
        load.
        """
        return self.law.sliding_fraction(self.contacts)
