"""Topology of the branches of a crystal: the Zak phase, and the winding of det C.

Both are sums over the phase by which a wave changes from block to block across an edge, at one wave
vector along the edge. A block is a layer, or several, of the half space. Both follow from the
infinite crystal alone, and count the waves at its edges: J. Zak, Phys. Rev. Lett. 62, 2747 (1989);
C. L. Kane and T. C. Lubensky, Nature Physics 10, 39 (2014).
"""

from __future__ import annotations

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.dynamics.half_space import HalfSpace

#: phases from block to block, rad, at which Zak phases and windings are summed
_PHASES = 2.0 * np.pi * np.arange(256) / 256
#: determinant, over the product of the norms of its rows, up to which the determinant is zero
_SINGULARITY = 1e-12
#: gap in w = omega^2, over the highest w, up to which the gap is closed
_LEAST_GAP = 1e-12
#: least overlap of branches from one phase to the next at which their gap counts as open
_LEAST_OVERLAP = 0.5
#: size of a Zak phase, rad, up to which it is zero but for rounding
_PHASE_ROUNDING = 1e-9
#: largest turn of a determinant from one phase to the next, rad, at which turns can be counted
_LARGEST_TURN = 0.5 * np.pi


def find_zak_phase(half_space: HalfSpace, q: Array, below: int) -> float:
    """Return the Zak phase, rad, from 0 to 2 pi, of all branches of the crystal of a ``half_space``
    above the ``below`` lowest, at q (p - 1,) in fractions of the reciprocal cell; ``below`` is one
    or more, and less than the number of branches.

    If the edge is held, the phase is that of the motions of the balls, because such an edge leaves
    whole cells of balls. If it is free, the phase is that of the deformations of contacts, because
    such an edge leaves whole cells of contacts. Raises
    :class:`~granphon.base.errors.InputError` if the gap below these branches closes, and for a free
    edge under prestress.
    """
    is_free = half_space.edge == "free"
    if is_free and half_space.network.prestress:
        raise InputError(
            "static forces act at the free edge (prestress)",
            mend="Take a state without prestress, or a held edge",
        )
    rows, signs = half_space.weighted_rows(q, _PHASES)
    matrices = rows.conj().swapaxes(1, 2) @ (signs[:, None] * rows) + np.diag(half_space.anchors)
    squares, modes = np.linalg.eigh(matrices)
    states = modes[:, :, below:]  # (phases, size, branches)
    if is_free:
        states = np.linalg.qr(rows @ states)[0]  # (phases, rows, branches)
    next_states = np.roll(states, -1, axis=0)
    overlaps = np.linalg.det(states.conj().swapaxes(1, 2) @ next_states)  # (phases,)
    gap = np.min(squares[:, below] - squares[:, below - 1])
    is_closed = gap <= _LEAST_GAP * half_space.highest
    if is_closed or np.min(np.abs(overlaps)) < _LEAST_OVERLAP:
        branches = "lowest branch" if below == 1 else f"{below} lowest branches"
        raise InputError(
            f"the gap above the {branches} closes, or nearly",
            mend="Take another wave vector",
        )
    phase = -float(np.angle(np.prod(overlaps / np.abs(overlaps))))
    # a phase just below zero, which is rounding, would become 2 pi
    return 0.0 if abs(phase) < _PHASE_ROUNDING else phase % (2.0 * np.pi)


def find_winding(half_space: HalfSpace, q: Array) -> int:
    """Return how often det C of the crystal of a ``half_space`` winds about zero as the phase from
    block to block grows by 2 pi, at q (p - 1,) in fractions of the reciprocal cell. As many motions
    of a free edge cost nothing.

    Raises :class:`~granphon.base.errors.InputError` if C is not square, if its determinant
    vanishes, and if springs to the ground hold balls.
    """
    if np.any(half_space.anchors):
        raise InputError(
            "springs to the ground hold the balls", "Each motion at an edge costs energy"
        )
    rows, _ = half_space.weighted_rows(q, _PHASES)
    _, n_deformations, n_motions = rows.shape
    if n_deformations != n_motions:
        raise InputError(
            f"{n_deformations} deformations of contacts and {n_motions} motions are not as many",
            "C has no determinant",
            "Take an isostatic lattice",
        )
    determinants = np.linalg.det(rows)
    # Hadamard: no determinant is larger than the product of the lengths of its rows
    bounds = np.prod(np.linalg.norm(rows, axis=2), axis=1)
    turns = np.angle(np.roll(determinants, -1) * determinants.conj())
    is_singular = np.any(np.abs(determinants) <= _SINGULARITY * bounds)
    if is_singular or np.max(np.abs(turns)) > _LARGEST_TURN:
        raise InputError("det C vanishes, or nearly, at this wave vector", mend="Take another one")
    return int(np.rint(turns.sum() / (2.0 * np.pi)))
