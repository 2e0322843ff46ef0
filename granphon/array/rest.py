"""Arrays of balls that come to rest: as assemblies under loads, in units of W and c W^(3/2).

Contacts keep the directions of the lattice, the limit of small spread, or turn with their balls, of
which the ratio W/d tells. The search is that of :func:`~granphon.statics.rest.find_rest`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from granphon.array.contact_lists import find_lattice_grid
from granphon.array.geometry import ReducedLoad
from granphon.array.stencils import Stencils
from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.contacts.assembly import Assembly, GridAssembly
from granphon.statics.configuration import AppliedLoad
from granphon.statics.options import RestOptions
from granphon.statics.rest import Rest, find_rest

#: part of the tolerance of forces to which a load is met: the load is a number that the user gave
_LOAD_PART = 1e-3


class ArrayRest(NamedTuple):
    """An array at rest, or on the way to rest.

    Attributes
    ----------
    balls : (n p, L1, ..., Lp) displacements, in the coordinates of the stencils.
    overlap : y, common to all contacts.
    residual : largest force left on a ball, over the mean force of all contacts.
    steps, iterations : of Newton's method and of conjugate gradients.
    """

    balls: Array
    overlap: float
    residual: float = 0.0
    steps: int = 0
    iterations: int = 0

    @classmethod
    def of(cls, rest: Rest, stencils: Stencils, scale: float, overlap: float | None) -> ArrayRest:
        """Take a state at rest, of contacts as long as 1/``scale``; the ``overlap`` is a given
        one.
        """
        p = rest.displacement.shape[1]
        motions = (stencils.basis @ rest.displacement.T).reshape(p, stencils.n_balls, -1)
        balls = motions.swapaxes(0, 1).reshape(-1, *stencils.shape)
        # by the mean force of all contacts, which is that of closed ones times their part
        closed = float(np.mean(rest.overlap > 0.0))
        return cls(
            balls=stencils.centre(balls),
            overlap=-float(rest.strain[0, 0]) / scale if overlap is None else overlap,
            residual=rest.residual / closed if closed else np.inf,
            steps=rest.steps,
            iterations=rest.iterations,
        )


def assemble(deviations: Array, stencils: Stencils, scale: float) -> GridAssembly:
    """Return the contacts of an array, as long as 1/``scale`` at touch: W/d of balls that turn
    about each other.
    """
    grid = find_lattice_grid(stencils.shape, stencils.lattice)
    p = stencils.lattice.periods
    size = (float(stencils.lattice.measure) * grid.n_cells) ** (1.0 / p) / scale
    return GridAssembly(
        grid if scale == 1.0 else grid.scale(1.0 / scale),
        stencils.average_pairs(deviations).ravel(),
        hertz.HertzLaw(1.0),
        size * np.eye(p),
        stands=True,
    )


def find_on_lattice(
    deviations: Array,
    load: ReducedLoad,
    stencils: Stencils,
    start: ArrayRest | None,
    tolerance: float,
) -> ArrayRest:
    """Find an array at rest in the directions of the lattice.

    ``start`` is a state near by, and ``tolerance`` that of
    :func:`~granphon.array.equilibrium.equilibrate`. Errors are those of
    :func:`~granphon.statics.rest.find_rest`.
    """
    assembly = assemble(deviations, stencils, 1.0)
    applied = apply(assembly, load._replace(on_boundary=False), 1.0, _LOAD_PART)
    begin = None if start is None else take_up(assembly, start, stencils, 1.0)
    options = RestOptions(grid_tolerance=tolerance)
    rest = find_rest(assembly, applied, "lattice", "isotropic", begin, options)
    return ArrayRest.of(rest, stencils, 1.0, load.overlap)


def apply(
    assembly: Assembly, load: ReducedLoad, scale: float, cell_tolerance: float
) -> AppliedLoad:
    """Return the load on an assembly whose contacts are as long as 1/``scale``."""
    p = assembly.dimension
    nothing = np.broadcast_to(0.0, (assembly.n_balls * p,))
    strain = np.zeros((p, p))
    stress = None
    mean_force = None
    if load.overlap is not None:
        strain = -scale * load.overlap * np.eye(p)
    elif load.on_boundary:
        virial = load.force * assembly.n_contacts * assembly.mean_distance
        stress = -virial / (p * assembly.measure) * np.eye(p)
    else:
        mean_force = load.force
    return AppliedLoad(
        force=nothing,
        words="the load",
        stress=stress,
        strain=strain,
        pressure_force=nothing,
        mean_force=mean_force,
        cell_tolerance=cell_tolerance,
    )


def take_up(assembly: Assembly, start: ArrayRest, stencils: Stencils, scale: float) -> Rest:
    """Return the state from which a search begins."""
    p = assembly.dimension
    return Rest(
        displacement=stencils.displacements(start.balls).reshape(p, -1).T,
        wall_motion=np.zeros(0),
        strain=-scale * start.overlap * np.eye(p),
        overlap=assembly.offset,
        assembly=assembly,
    )
