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
        force, and to dashpots, between the gas and rest and where balls fall; as ``work``.
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
        return self.law.stored(self.contacts)

    @property
    def dissipated(self) -> float:
        """Energy lost since the start, a mean over contacts, in units of c W^(5/2)."""
        return self.slid + self.loosened + self.damped

    def measure_motion(self, before: PressedArray) -> float:
        """Return the largest change of an overlap or a slip since another state, in W."""
        now = self.contacts
        then = before.contacts
        change_of_overlaps = float(np.max(np.abs(now.overlaps - then.overlaps)))
        change_of_slips = float(np.max(np.abs(now.slips - then.slips)))
        return max(change_of_overlaps, change_of_slips)

    @property
    def sliding_fraction(self) -> float:
        """Part of the contacts that carry load whose tangential force is at Coulomb's limit."""
        return self.law.sliding_fraction(self.contacts)
