"""Benchmarks of the calculator: ratios, each measured side by side in one run."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from side_by_side import Part, Row, alternate, over

if TYPE_CHECKING:
    from ase import Atoms

#: balls along each side
SIDE = 100


def step(sheet: Atoms, sites: NDArray[np.float64], moves: list[NDArray[np.float64]]) -> None:
    """Forces after a move of every ball; the moves are taken in turns."""
    moves.append(moves.pop(0))
    sheet.positions[:, :2] = sites[:, :2] + moves[0]
    sheet.get_forces()


def neighbours(repeats: int) -> list[Row]:
    """A step of an optimiser or of dynamics: every ball moves a little, and energy, forces and
    stress are asked for.
    """
    from ase.neighborlist import neighbor_list

    import granphon as gp

    steel = gp.Material(211.65e9, 0.276, 7840.0)
    rows = []
    for friction in (False, True):
        state = gp.AveragedLattice(gp.Packing(steel, 8e-3, friction=friction)).at_force(18.446)
        sheet = gp.atoms(state).repeat((SIDE, SIDE, 1))
        sheet.calc = gp.HertzMindlin(state)
        sites = sheet.positions.copy()
        rng = np.random.default_rng(0)
        moves = [0.1 * state.relative_overlap * rng.normal(size=(len(sheet), 2)) for _ in range(4)]
        kept = partial(step, sheet, sites, moves)
        fresh = gp.HertzMindlin(state)
        kept()
        assert np.array_equal(fresh.get_property("forces", sheet), sheet.get_forces()), (
            "what is kept changes the forces"
        )
        seconds = alternate(repeats, kept=kept, ase=partial(neighbor_list, "ijDS", sheet, 1.25))
        what = (
            f"{SIDE * SIDE} balls {'with' if friction else 'without'} friction, a step that moves"
            f" all of them"
        )
        rows.append(
            over(
                f"{what}: times faster than ASE's neighbour list alone",
                seconds,
                "ase",
                "kept",
                10.0,
                least=True,
            )
        )
    return rows


PARTS: dict[str, Part] = {"neighbours": neighbours}
