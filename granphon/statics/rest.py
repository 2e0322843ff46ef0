"""A state of rest, and what a search starts from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from granphon.base.arrays import Array
from granphon.contacts.assembly import Assembly
from granphon.statics.configuration import Configuration, Problem


@dataclass(frozen=True, eq=False, repr=False)
class Rest:
    """An assembly at rest; SI units.

    Attributes
    ----------
    displacement : (n, d) of the balls that move, m.
    wall_motion : (k,) of the walls along their lines, m.
    strain : (p, p) of the cell.
    overlap : (n_c,) of the contacts, m.
    assembly : what is at rest.
    turned_normal : (n_c, d) unit vectors of contacts that have turned; None where they keep the
        directions of the sites.
    residual : the largest force left, as on a ball, over the size of the forces of contacts: where
        none adheres, the mean force of those that are closed. Infinite if that size is zero.
    steps, iterations : numbers of steps of Newton's method for all balls, and of iterations in
        these steps.
    """

    displacement: Array
    wall_motion: Array
    strain: Array
    overlap: Array
    assembly: Assembly
    turned_normal: Array | None = None
    residual: float = 0.0
    steps: int = 0
    iterations: int = 0

    @property
    def normal(self) -> Array:
        """(n_c, d) unit vectors of the contacts."""
        if self.turned_normal is not None:
            return self.turned_normal
        return self.assembly.normal[:, : self.assembly.dimension]

    @classmethod
    def of(cls, configuration: Configuration) -> Self:
        """Return the state of a ``configuration`` that is at rest, without steps and iterations."""
        problem = configuration.problem
        assembly = problem.assembly
        x = configuration.x
        balls = x[: problem.n_ball_unknowns]
        turned_normal = configuration.normal[:, : assembly.dimension] if problem.turns else None
        return cls(
            displacement=balls.reshape(assembly.n_balls, assembly.dimension),
            wall_motion=x[problem.n_ball_unknowns : problem.n_displacements],
            strain=configuration.strain,
            overlap=configuration.overlap,
            assembly=assembly,
            turned_normal=turned_normal,
            residual=configuration.residual,
        )

    def scale(self, factor: float) -> Rest:
        """Return the state with all displacements, strains and overlaps times a ``factor``, from
        which a search may begin. Normals and the residual stay, and the state need not be at rest
        under any load.
        """
        return replace(
            self,
            displacement=factor * self.displacement,
            wall_motion=factor * self.wall_motion,
            strain=factor * self.strain,
            overlap=factor * self.overlap,
        )


def find_unknowns(problem: Problem, rest: Rest) -> Array:
    """Return the unknowns (size,), m, of a state of ``rest``; its strain, less the given strain of
    the load, is projected on the strains that are unknowns of the problem.
    """
    p = problem.assembly.periods
    units = problem.unit_strains[:, :p, :p]
    strain = rest.strain - problem.load.strain
    # the units are at right angles to each other
    strains = np.einsum("sab,ab->s", units, strain) / np.einsum("sab,sab->s", units, units)
    return np.concatenate([rest.displacement.ravel(), rest.wall_motion, strains])
