"""The dynamical matrix of an array of balls without a matrix: see :mod:`granphon.array.contact_operator`.

Several vectors at once are left to the sparse matrix, which is read once for all of them, and is then faster.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.contact_operator import ContactHessian, ContactOperator
from granphon.networks.network import ContactNetwork
from granphon.waves.operator import WaveOperator

Array = NDArray[np.float64]
#: relative difference of numbers that are equal but for rounding
_ALIKE = 1e-12
#: number of balls below which a sparse matrix is faster
_LEAST_BALLS = 2500


def make_operator(network: ContactNetwork) -> WaveOperator:
    """Return D of a network: by stencils if it is a large enough array of equal masses, else by a sparse matrix."""
    kinds = find_kinds(network) if network.n_balls >= _LEAST_BALLS else None
    return WaveOperator(network) if kinds is None else ArrayOperator(network, kinds)


def find_kinds(network: ContactNetwork) -> NDArray[np.intp] | None:
    """Return (n_c,) the row of each contact in the table of the lattice; None if the network is not such an array.

    Contacts must have the directions and arms of the lattice, each from ball i to ball j of the table; masses must be equal,
    and there must be no prestress. An array so short that a ball touches another twice is not treated as one.
    """
    lattice, shape = network.lattice, network.shape
    if lattice is None or shape is None or network.prestress or min(shape) < 3:
        return None
    table, n, p = lattice.contacts, lattice.n_balls, lattice.periods
    if network.n_balls != n * math.prod(shape) or not (_is_one(network.masses) and _is_one(network.inertias)):
        return None
    cells = [np.stack(np.unravel_index(ball // n, shape), axis=-1) for ball in (network.i, network.j)]
    step = cells[1] + network.shift[:, :p] * np.array(shape) - cells[0]
    kinds = np.full(network.n_contacts, -1)
    for kind, (i, j, shift) in enumerate(zip(table.i.tolist(), table.j.tolist(), table.shift, strict=True)):
        kinds[(network.i % n == i) & (network.j % n == j) & np.all(step == shift, axis=1)] = kind
    if np.any(kinds < 0) or len(set((kinds * network.n_balls + network.i).tolist())) < kinds.size:
        return None
    normal = np.zeros((len(table), 3))
    normal[:, : table.normal.shape[1]] = table.normal
    fine = np.max(np.abs(network.normal - normal[kinds]), initial=0.0) <= _ALIKE
    for own, arm in ((network.arm_i, table.arm_i), (network.arm_j, table.arm_j)):
        fine = fine and _is_one(own / arm[kinds])
    return kinds if fine else None


def _is_one(values: Array) -> bool:
    """Whether all values are the same, but for rounding, and finite."""
    return bool(np.all(np.isfinite(values)) and np.ptp(values) <= _ALIKE * np.max(np.abs(values), initial=0.0))


class ArrayOperator(WaveOperator):
    """D of an array of equal masses; vectors run over the motions of the balls of a cell, and for each over all cells."""

    def __init__(self, network: ContactNetwork, kinds: NDArray[np.intp]) -> None:
        super().__init__(network)
        assert network.lattice is not None  # find_kinds has seen that
        assert network.shape is not None
        self.lattice, self.cells, self._kinds = network.lattice, network.shape, kinds
        self._fields = self.lattice.n_balls * self.motions.count

    def vector(self, values: ArrayLike) -> NDArray[Any]:
        """Return the vector (size, ...) of values (n, motions, ...) of balls."""
        values = np.asarray(values)
        by_cell = values.reshape(-1, self._fields, *values.shape[2:])
        return np.ascontiguousarray(by_cell.swapaxes(0, 1)).reshape(self.size, *values.shape[2:])

    def values(self, vector: ArrayLike) -> NDArray[Any]:
        """Return the values (n, motions, ...) of balls in a vector (size, ...)."""
        vector = np.asarray(vector)
        by_cell = vector.reshape(self._fields, -1, *vector.shape[1:]).swapaxes(0, 1)
        return by_cell.reshape(-1, self.motions.count, *vector.shape[1:])

    @cached_property
    def _product(self) -> ContactHessian:
        """4 D / top^2: its springs are those of the contacts that there are, at the cells of their balls i."""
        table, m, kinds, scale = self.lattice.contacts, self.motions.count, self._kinds, float(self.network.masses[0])
        ends, springs = (
            np.zeros((2, len(self.rows), len(table), self._fields)),
            np.zeros((len(self.rows), len(table), *self.cells)),
        )
        cells = self.network.i // self.lattice.n_balls
        for kind, (i, j) in enumerate(zip(table.i.tolist(), table.j.tolist(), strict=True)):
            own = np.flatnonzero(kinds == kind)
            for place, row in enumerate(self.rows if own.size else ()):
                ends[0, place, kind, m * j : m * (j + 1)] = row.head[own[0]]
                ends[1, place, kind, m * i : m * (i + 1)] = row.tail[own[0]]
                stiffness = np.broadcast_to(row.stiffness, kinds.shape)[own]
                springs[place, kind].reshape(-1)[cells[own]] = 4.0 / self.top**2 / scale * stiffness
        shifts = [tuple(steps) for steps in table.shift.tolist()]
        operator = ContactOperator(self.cells, shifts, *ends.reshape(2, -1, self._fields))
        return ContactHessian(operator, list(springs), precision=np.float64)

    def advance(self, current: Array, previous: Array) -> Array:
        """Return the next Chebyshev polynomial, see :meth:`WaveOperator.advance`."""
        if current.ndim > 1:
            return super().advance(current, previous)
        following = self._product(current.reshape(self._fields, *self.cells))[0].ravel()
        following -= 2.0 * current
        following -= previous
        return following

    def _matvec(self, x: NDArray[Any]) -> NDArray[Any]:
        x = np.ravel(x)
        if np.iscomplexobj(x):
            return np.asarray(self._matvec(x.real) + 1j * self._matvec(x.imag))
        return np.asarray(0.25 * self.top**2 * self._product(x.reshape(self._fields, *self.cells))[0].ravel())
