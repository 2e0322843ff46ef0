"""One sample of the disordered array under many loads: the quantity that each load prescribes, and the equilibria."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granphon.array.equilibrium import THRESHOLD_FORCE, Equilibrium, array_shape, equilibrate, explain_too_small
from granphon.array.geometry import ReducedLoad
from granphon.array.stencils import Stencils
from granphon.array.true_equilibrium import equilibrate_exactly
from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.base.errors import GranphonError, InputError
from granphon.media.medium import AveragedLattice, explain_untouched


def reduce_load(packing: Packing, load: Load) -> Array:
    """Return f* of each value of an applied load, or a* of a load that is given as an overlap, with its shape."""
    units, values = packing.width_units, load.array
    with np.errstate(all="ignore"):  # beyond the floating range f* and a* are infinite
        if load.kind == "overlap":
            return np.asarray(units.reduced_spacing(values))
        if load.kind == "pressure":
            values = values / packing.pressure_per_force
        return np.asarray(units.reduced_force(values))


def prescribe(packing: Packing, load: Load, is_exact: bool = False) -> list[ReducedLoad]:
    """Convert each value of an applied load to a prescribed force or overlap in units of the width, in C order.

    In the exact geometry the boundary on which a pressure acts shrinks with the cell.
    """
    if load.kind == "overlap":  # a* would lose the digits of a small overlap
        return [ReducedLoad(overlap=one) for one in packing.width_units.reduced_overlap(load.array).ravel().tolist()]
    on_boundary = is_exact and load.kind == "pressure"
    return [ReducedLoad(force=one, on_boundary=on_boundary) for one in reduce_load(packing, load).ravel().tolist()]


def require_load(packing: Packing, load: Load, largest: float) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for an applied load that no sample of a packing can bear.

    These are loads beyond the range of the law of equal balls, or that press them together by a whole diameter. Where balls
    differ they are also loads below f* = 1e-8, and overlaps at which not even two of the largest balls touch; ``largest`` is
    the excess of their diameter over the mean, m.
    """
    hertz = AveragedLattice(replace(packing, spread=None))
    if packing.width and not packing.spread_matters:
        least = packing.width_units.reduced_force(float(np.min(hertz.at(load).force)))
        if least < THRESHOLD_FORCE:  # no threshold of rigidity is on a line
            what = f"a contact force of f* = {least:.3g} is below {THRESHOLD_FORCE:g}, the least that is simulated"
            raise InputError(what, mend="Raise the load, or take another medium, which on a line is exact too")
    elif load.kind != "overlap":
        least = packing.width_units.reduced_force(float(np.min(hertz.at(load).force)))
        if packing.width and least < THRESHOLD_FORCE:
            raise explain_too_small(least)
    elif not packing.width:
        hertz.at(load)
    else:
        if np.max(load.array) > packing.width:
            hertz.at(Load("overlap", np.max(load.array)))
        if np.min(load.array) <= -largest:
            raise explain_untouched(load, largest)


def sort_by_load(prescribed: Sequence[ReducedLoad]) -> list[int]:
    """Return the indices of the loads, from the highest load down.

    Each equilibrium is found from that at the next higher load. The starting point affects only digits beyond the tolerance;
    in the true geometry, where it decides where loose balls come to rest, each has its own.
    """
    return sorted(range(len(prescribed)), key=lambda i: prescribed[i], reverse=True)


def find_equilibria(
    deviations: Array, lattice: Lattice, prescribed: Sequence[ReducedLoad], workers: int, ratio: float = 0.0
) -> dict[int, Equilibrium]:
    """Find the equilibria of a sample with these ``deviations`` under all loads, by the index of the load.

    Each is found from the equilibrium at the next higher load. A ``ratio`` W/d above zero means the true geometry: there
    each is found from the lattice's under the same load, so that it does not depend on which others are asked for. An error
    carries the index of its load as ``load_index``.
    """
    stencils = Stencils(array_shape(deviations, lattice), workers=workers, lattice=lattice)
    out, before = dict[int, Equilibrium](), None
    for place in sort_by_load(prescribed):
        try:
            found = out[place] = find_equilibrium(deviations, stencils, prescribed[place], before, ratio)
            _ = found.stiffness  # every state needs it: found here, it is found in parallel
        except GranphonError as error:
            error.load_index = place
            raise
        before = found.overlap, found.balls
    stencils.forget()
    return out


def find_equilibrium(
    deviations: Array, stencils: Stencils, load: ReducedLoad, before: tuple[float, Array] | None, ratio: float = 0.0
) -> Equilibrium:
    """Find the equilibrium of a sample with these ``deviations`` under one load.

    The search starts from ``before``, the overlap and displacements of an earlier equilibrium, unless it is None; in the
    true geometry it does not.
    """
    if ratio:
        return equilibrate_exactly(deviations, load, ratio, stencils)
    start = None if before is None else Equilibrium(deviations, *before, lattice=stencils.lattice)
    return equilibrate(deviations, load, stencils, start)
