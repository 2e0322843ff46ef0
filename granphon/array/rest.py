"""Arrays of balls that come to rest: as assemblies under loads, in units of W and c W^(3/2).

In the limit of small spread contacts keep the directions of the lattice. In the true geometry, with
a given ratio W/d, contacts turn with their balls. The search for rest is that of
:func:`~granphon.statics.find_rest.find_rest`.

The lengths of an assembly are in W. In the true geometry its contacts are as long as d/W at touch;
in the directions of the lattice their length does not matter, and is one. Either length is written
1/``scale``.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from granphon.array.equilibrium import (
    REST_TOLERANCE,
    THRESHOLD_FORCE,
    Equilibrium,
    explain_no_load,
    explain_too_small,
)
from granphon.array.geometry import LOAD_TOLERANCE, list_displacements, require_small
from granphon.array.options import ReducedLoad
from granphon.array.stencils import Stencils
from granphon.array.true_equilibrium import TrueEquilibrium
from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError, InputError
from granphon.contacts.assembly import Assembly, GridAssembly
from granphon.contacts.grid import find_lattice_grid
from granphon.statics.configuration import AppliedLoad, Geometry
from granphon.statics.find_rest import find_rest
from granphon.statics.options import RestOptions
from granphon.statics.response import find_elastic_tensor
from granphon.statics.rest import Rest

#: tolerance of the load over that of the forces on balls, in the directions of the lattice: less
#: than one, as the load is a number that the user gave
_LOAD_PART = 1e-3
#: in the true geometry, largest force that may be left on a ball over W/d times the mean force: the
#: forces on loose balls are of the order of W/d times the mean force
_PART_OF_RATIO = 1e-4
#: least tolerance that rounding allows
LEAST_TOLERANCE = 1e-12


def bring_to_rest(
    deviations: Array,
    load: ReducedLoad,
    stencils: Stencils | None = None,
    start: Equilibrium | None = None,
    tolerance: float | None = None,
    ratio: float | None = None,
) -> Equilibrium:
    """Return the equilibrium without friction of an array of balls under a load, found by
    :func:`~granphon.statics.find_rest.find_rest`.

    Parameters
    ----------
    deviations : x = Delta/W, of mean zero; (L1, ..., Lp), or (n, L1, ..., Lp) if a cell has n > 1
        balls.
    load : overlap, mean contact force or pressure, reduced; a force or pressure is above zero. In
        the true geometry the overlap y is that by which the cell is compressed, and the force is
        the mean normal force over all contacts. In the directions of the lattice a pressure is the
        same as its mean force.
    stencils : stencils of the array; by default those of the triangular lattice.
    start : equilibrium from which to begin, for example that of the same balls under a similar
        load; by default balls begin on their sites, or, in the true geometry, at the equilibrium on
        the lattice under the same load.
    tolerance : largest force left on a ball, over the mean contact force; None or zero, by default:
        1e-10. In the directions of the lattice it is over the rms difference of contact forces if
        that is less: at high loads the effect of disorder is only a small part of the force. In the
        true geometry 1e-4 W/d, but at least 1e-12, takes the place of a tolerance that is larger.
    ratio : W/d, from zero to 0.2, in the true geometry, which at zero is that of the lattice. None,
        by default: contacts keep the directions of the lattice.

    Returns
    -------
    The equilibrium; a :class:`~granphon.array.true_equilibrium.TrueEquilibrium` if ``ratio`` is not
    None.

    Raises
    ------
    InputError : the sample carries no load at this overlap or under this force; or no start is
        given, balls differ and the force is below f* = 1e-8; or the ratio is below zero or too
        large.
    ConvergenceError : the tolerance is not reached; the message states the residual at the end, if
        there is one.
    InstabilityError : in the true geometry equal balls collapse, as under a load that presses them
        together by their diameter.
    """
    stencils = stencils or Stencils(deviations.shape)
    require_small(ratio or 0.0)
    is_small = load.overlap is None and load.force < THRESHOLD_FORCE
    if is_small and start is None and np.ptp(deviations):
        raise explain_too_small(load.force)
    # in the directions of the lattice nothing depends on the diameter
    scale = ratio or 1.0
    geometry: Geometry = "exact" if ratio else "lattice"
    options = _choose_options(tolerance or REST_TOLERANCE, ratio or 0.0, stencils.workers)
    assembly = assemble(deviations, stencils, scale)
    if ratio:
        applied = apply_load(assembly, load, scale, LOAD_TOLERANCE / REST_TOLERANCE)
    else:  # the boundary keeps its size: a pressure is the mean force that stands for it
        load = load._replace(on_boundary=False)
        applied = apply_load(assembly, load, scale, _LOAD_PART)
    begin = None
    if start is not None:
        overlap = load.overlap if ratio and load.overlap is not None else start.overlap
        begin = take_up(assembly, start.balls, overlap, stencils, scale)
    try:
        rest = find_rest(assembly, applied, geometry, "isotropic", begin, options)
    except InputError as error:
        if load.overlap is None:
            raise
        raise explain_no_load(load.overlap) from error
    except ConvergenceError as error:
        if error.reached is None:
            raise
        raise explain_unrest(error.reached, _find_overlap(error.reached, load, scale)) from error
    kind = Equilibrium if ratio is None else TrueEquilibrium
    state = kind(
        deviations=deviations,
        overlap=_find_overlap(rest, load, scale),
        balls=gather_balls(rest, stencils),
        residual=find_residual(rest),
        newton=rest.steps,
        conjugate=rest.iterations,
        lattice=stencils.lattice,
        ratio=ratio or 0.0,
    )
    return state.share(deviations, stencils)  # keeps what the stencils have found


def _choose_options(tolerance: float, ratio: float, workers: int) -> RestOptions:
    """Return the options of a search that ends at the ``tolerance`` of :func:`bring_to_rest`.
    ``ratio`` is W/d, zero in the directions of the lattice; ``workers`` is the number of threads.
    """
    if not ratio:
        return RestOptions(grid_tolerance=tolerance, workers=workers)
    required = min(tolerance, max(LEAST_TOLERANCE, _PART_OF_RATIO * ratio))
    return RestOptions(
        # the aim is a tenth below the requirement, so that the state at the end meets it
        tolerance=0.9 * required,
        negligible_force=required,
        of_all=True,
        grid_tolerance=REST_TOLERANCE,
        workers=workers,
    )


def explain_unrest(nearest: Rest, overlap: float) -> ConvergenceError:
    """Return the error of a search that has not led to rest; ``nearest`` is the state at its end,
    or the nearest to rest, and ``overlap`` its overlap y.
    """
    is_true = nearest.turned_normal is not None
    where = " in its true geometry" if is_true else ""
    residual = find_residual(nearest)
    state = f"a force of {residual:.2g} of the mean contact force is left on a ball"
    if math.isinf(residual):
        state = "contacts carry nothing"
    return ConvergenceError(
        f"the sample has not come to rest{where} after {nearest.steps} steps",
        f"At an overlap of {overlap:.6g} widths {state}",
        "Raise the load, take fewer balls, or take geometry: lattice"
        if is_true
        else "Raise the load, or take fewer balls",
    )


def equilibrate_by_factors(state: Equilibrium) -> Equilibrium:
    """Return the equilibrium of the balls of a ``state`` in the directions of the lattice, at the
    overlap of the state, found in a way that shares no linear algebra with :func:`bring_to_rest`.

    Balls begin on their sites, contacts are a list that is no grid, and each step of Newton's
    method factorises its matrix, unless balls are too many for factors.

    Raises :class:`~granphon.base.errors.GranphonError` if the search does not come to rest.
    """
    stencils = state.stencils
    assembly = assemble(state.deviations, stencils, 1.0).spell_out()
    load = apply_load(assembly, ReducedLoad(overlap=state.overlap), 1.0, _LOAD_PART)
    # on a line, in a plane and in space, iterations would begin beyond the balls of the array
    options = RestOptions(fewest_balls=dict.fromkeys((1, 2, 3), assembly.n_balls + 1))
    rest = find_rest(assembly, load, "lattice", "isotropic", None, options)
    twin = replace(
        state,
        balls=gather_balls(rest, stencils),
        residual=find_residual(rest),
        newton=rest.steps,
        conjugate=rest.iterations,
    )
    return twin.share(twin.deviations, stencils)


def find_tensor_by_factors(state: Equilibrium, shear: float) -> Array:
    """Return the elastic tensor of :meth:`~granphon.array.equilibrium.Equilibrium.find_elasticity`
    of the ``state``, with springs against slip of ``shear`` times the normal stiffness, found by
    factors of a list that is no grid.

    Raises :class:`~granphon.base.errors.ConvergenceError` if the response is not found.
    """
    return find_elastic_tensor(replace(state._list_contacts(shear), grid=()))


def assemble(deviations: Array, stencils: Stencils, scale: float) -> GridAssembly:
    """Return the contacts of an array of balls with the ``deviations`` x, (L1, ..., Lp) or (n, L1,
    ..., Lp). The length of a contact at touch is 1/``scale``, in W; ``scale`` is W/d in the true
    geometry, and otherwise 1.
    """
    grid = find_lattice_grid(stencils.shape, stencils.lattice)
    p = stencils.lattice.periods
    # of the size of the cell only the measure counts: a cube with the measure of the array
    size = (float(stencils.lattice.measure) * grid.n_cells) ** (1.0 / p) / scale
    return GridAssembly(
        grid if scale == 1.0 else grid.scale(1.0 / scale),
        stencils.average_pairs(deviations).ravel(),
        hertz.HertzLaw(1.0),
        size * np.eye(p),
        is_standing=True,
    )


def _find_overlap(rest: Rest, load: ReducedLoad, scale: float) -> float:
    """Return the overlap y of a ``rest`` whose contacts have the length 1/``scale`` at touch: that
    of the ``load`` if it prescribes one, and otherwise that of the strain.
    """
    if load.overlap is not None:
        return float(load.overlap)
    return -float(rest.strain[0, 0]) / scale


def find_residual(rest: Rest) -> float:
    """Return the largest force left on a ball of a ``rest``, over the mean force of all contacts;
    infinite if contacts carry nothing.

    The residual of the rest is over the mean force of closed contacts, which is the mean force of
    all contacts divided by the share of those that are closed.
    """
    closed_share = float(np.mean(rest.overlap > 0.0))
    return rest.residual / closed_share if closed_share else math.inf


def gather_balls(rest: Rest, stencils: Stencils) -> Array:
    """Return the displacements (n p, L1, ..., Lp) of the balls of a ``rest``, in the coordinates of
    the stencils, less their mean; n balls in a cell have p displacements each.
    """
    p = rest.displacement.shape[1]
    motions = (stencils.basis @ rest.displacement.T).reshape(p, stencils.n_balls, -1)
    return stencils.centre(motions.swapaxes(0, 1).reshape(-1, *stencils.shape))


def apply_load(
    assembly: Assembly, load: ReducedLoad, scale: float, cell_tolerance: float
) -> AppliedLoad:
    """Return the ``load`` on an assembly whose contacts have the length 1/``scale`` at touch. A
    load that is not an overlap is met to ``cell_tolerance`` times the tolerance of forces.
    """
    p = assembly.dimension
    no_force = np.broadcast_to(0.0, (assembly.n_balls * p,))  # takes no memory
    strain = np.zeros((p, p))
    stress = None
    mean_force = None
    if load.overlap is not None:
        strain = -scale * load.overlap * np.eye(p)
    elif load.on_boundary:
        # the stress of equal contact forces in a cell that keeps its size
        virial = load.force * assembly.n_contacts * assembly.mean_distance
        stress = -virial / (p * assembly.measure) * np.eye(p)
    else:
        mean_force = load.force
    return AppliedLoad(
        force=no_force,
        words="the load",
        stress=stress,
        strain=strain,
        pressure_force=no_force,
        mean_force=mean_force,
        cell_tolerance=cell_tolerance,
    )


def take_up(
    assembly: Assembly, balls: Array, overlap: float, stencils: Stencils, scale: float
) -> Rest:
    """Return the state from which a search begins, with the displacements ``balls`` (n p, L1, ...,
    Lp), in the coordinates of the stencils, and the ``overlap`` y; contacts of the assembly have
    the length 1/``scale`` at touch. The state has the overlaps of contacts on the sites, not those
    of the displaced balls.
    """
    p = assembly.dimension
    return Rest(
        displacement=list_displacements(stencils, balls),
        wall_motion=np.zeros(0),
        strain=-scale * overlap * np.eye(p),
        overlap=assembly.offset,
        assembly=assembly,
    )
