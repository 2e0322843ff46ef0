"""The cluster medium: a ball and its shells, each with a diameter of its own, among balls that differ too.

It goes a step beyond the effective medium, whose cluster is one ball. See :mod:`granphon.laws.cluster_balance`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from granphon.balls.packing import Packing
from granphon.base.errors import InputError
from granphon.base.validation import whole, whole_number
from granphon.dynamics.cluster_response import ClusterResponse, cluster_response, cluster_sizes
from granphon.laws.cluster import VALID_FORCE, ClusterLaw
from granphon.media.mean_field import LawMedium
from granphon.media.medium import Option
from granphon.media.state import Law


@dataclass(frozen=True)
class ClusterMedium(LawMedium):
    """The cluster medium: a cluster of balls that differ, in the lattice whose stiffness it has, among balls that differ.

    It is valid from f* = 0.03; ``valid`` of a state says so. It is solved from f* = 0.003. Means are over quasi-random
    diameters, so many that their standard error is below 1e-4 of the force where the medium is valid. The first state takes
    half a minute with the first shell and up to a minute and a half with more, of one processor; all processors share this.
    The law is then kept for its distribution, lattice, Mindlin ratio and number of balls.

    Parameters
    ----------
    packing : the balls, on any lattice that stands with its motions.
    balls : number of balls of the cluster, one that completes a shell: 7, 19 or 37 on the triangular lattice, 13 in fcc and
        hcp. None is the first shell: the ball in the middle and the balls that touch it.

    Raises
    ------
    InputError : a number of balls that no shell completes; the message lists the numbers of complete shells. From ``law``
        and ``at_*``, a :class:`~granphon.base.errors.MechanismError` if the lattice has a motion that costs no energy.
    """

    name, words = "cluster", "cluster medium"
    slow_part = "the cluster medium"

    packing: Packing
    balls: int | None = None

    options = {"balls": Option(balls, partial(whole, low=2, high=100))}

    def __post_init__(self) -> None:
        super().__post_init__()
        sizes = cluster_sizes(self.packing.structure)
        given = sizes[0] if self.balls is None else whole_number("balls", self.balls, 2)
        if given not in sizes:
            what = f"balls is {given}, and no shell of the {self.packing.structure.name} lattice completes so many"
            raise InputError(what, mend="Give " + " or ".join(map(str, sizes)))
        if self.balls == sizes[0]:
            object.__setattr__(self, "balls", None)

    @property
    def n_balls(self) -> int:
        """Number of balls of the cluster."""
        return cluster_sizes(self.packing.structure)[0] if self.balls is None else self.balls

    @property
    def response(self) -> ClusterResponse:
        """How the lattice answers the contacts of the cluster."""
        packing = self.packing
        return cluster_response(packing.structure, packing.mindlin_ratio, self.n_balls, packing.bending)

    @property
    def is_quick(self) -> bool:
        """Whether its states take less than 0.1 s, as for equal balls."""
        return not self.packing.width

    def prepare(self) -> None:
        """Find the response around balls that differ, which not every lattice has."""
        if self.packing.width:
            _ = self.response

    @property
    def long_law(self) -> ClusterLaw | None:
        """The law in reduced units, which has neither a width nor a coefficient; None of equal balls and on a line."""
        law = self.law
        return replace(law, coefficient=1.0, width=1.0) if isinstance(law, ClusterLaw) else None

    @property
    def quadrature_error(self) -> float:
        """Largest relative standard error of the force where the medium is valid, from the quadrature; 0 for equal balls."""
        law = self.law
        if not isinstance(law, ClusterLaw):
            return 0.0
        curve = law.curve
        lowest = float(curve.overlap(np.array(VALID_FORCE)))
        y = np.append(curve.nodes[curve.nodes > lowest], lowest)
        return float(np.max(law.quadrature_error(y * law.width)))

    @property
    def spread_law(self) -> Law:
        """Contact law of the medium for balls that differ, in SI."""
        packing, spread = self.packing, self.packing.spread
        # where all contacts must carry one force, as on a chain, balls that differ are as good as equal ones
        if not spread or self.response.is_fixed:
            return packing.law
        coefficient, shape = packing.law.coefficient, spread.shape
        eta, balls = packing.mindlin_ratio, self.n_balls
        return ClusterLaw(coefficient, spread.width, shape, packing.structure, eta, balls, packing.bending)
