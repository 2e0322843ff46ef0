"""Energies of the waves of an edge, of which derivatives of their frequencies are made.

Between the bands a wave of the edge, of the squared frequency w, decays from block to block. The
motions of two neighbouring blocks are V S^n z, n from zero at the edge: the columns of V span the
motions that decay, S takes them to the next block, and the outer block decides which z is the wave.
V and S come from a generalised Schur decomposition of the pencil that joins blocks. So V and S
exist also where the outer block of a crystal without this edge would have the wave itself. Energies
of all layers together are sums over n, found by doubling: with P = z z^H the sum of S^n P (S^n)^H
over 2 m blocks is that over m, plus S^m times that over m times (S^m)^H.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from granphon.base.arrays import Array, Complex, Flags, Index
from granphon.base.errors import PrecisionError
from granphon.base.memory import require_memory
from granphon.base.scales import Units
from granphon.dynamics.deformation_rows import Row, network_unit_rows
from granphon.dynamics.half_space import HalfSpace, make_pencil
from granphon.dynamics.sensitivities import (
    STIFFNESSES,
    FrequencySensitivities,
    ModeEnergies,
    Place,
    find_frequency_sensitivities,
    number_equal,
    sum_kinds,
    turn_motions,
)
from granphon.networks.cuts import find_sources

#: doublings of a sum over blocks, at most: waves that decay more slowly are not told from the bulk
_MOST_DOUBLINGS = 60
#: part of a sum over blocks that a doubling adds, at which the sum ends
_LAST_PART = 1e-18
#: arrays of the squares of deformations that are held at once
_ARRAYS_HELD = 4.0


class _EqualWaves(NamedTuple):
    """Waves of one frequency, as mass-weighted motions u of a block, or v of two neighbouring
    blocks.

    Attributes
    ----------
    outer_motions : (blocks, size, count) motions u of each of the ``count`` waves in each of the
        outer blocks.
    block_root : (size, size) X with X X^H = the sum of u u^H over all blocks, a mean over the
        waves. The trace of X X^H is one.
    pair_root : (2 size, size) Y with Y Y^H = the sum of v v^H over all pairs of neighbouring blocks
        but the outermost pair, a mean over the waves.
    """

    outer_motions: Complex
    block_root: Complex
    pair_root: Complex


class _MeanSquares(NamedTuple):
    """Mean squares in waves of one frequency.

    Attributes
    ----------
    deformations : a dictionary of arrays (n_c,), of the deformations of contacts, by the names of
        :data:`~granphon.dynamics.sensitivities.STIFFNESSES`.
    motions : (n, motions) of the mass-weighted motions of balls that move.
    """

    deformations: dict[str, Array]
    motions: Array


class EdgeEnergies:
    """The energies of the waves of the edge of a ``half_space``."""

    def __init__(self, half_space: HalfSpace) -> None:
        """List the rows of the contacts of the cut, and what its balls and contacts are in the
        crystal.
        """
        self.half_space = half_space
        cut = half_space.cut
        self.rows: list[Row] = network_unit_rows(cut)
        moving_balls = np.flatnonzero(cut.moving)
        #: (n,) the number of each ball of the cut among those that move; -1 of other balls
        self.ball_number: Index = np.full(cut.n_balls, -1)
        self.ball_number[moving_balls] = np.arange(moving_balls.size)
        # a body that does not move belongs to no block: its number is above that of all blocks
        block = np.where(
            self.ball_number < 0, moving_balls.size, self.ball_number // self._per_block
        )
        #: (n_c,) the number, from the edge, of the outermost block that each contact of the cut
        #: joins
        self.outer_block: Index = np.minimum(block[cut.i], block[cut.j])
        #: (n_c,) the contact of the crystal that each contact of the cut is, -1 at a wall
        self.crystal_contact: Index = find_sources(
            half_space.network, half_space.layers, half_space.n_layers, cut
        )

    def find_sensitivities(
        self, point: Index, q: Array, squares: Array, warnings: tuple[str, ...]
    ) -> tuple[FrequencySensitivities, FrequencySensitivities]:
        """Return the derivatives of the frequencies of waves by the contacts and balls of the
        crystal, each changed in all layers at once, and by those of the cut, each alone.

        Parameters
        ----------
        point : (n,) number of the wave vector of each wave, ascending.
        q : (n_q, p - 1) wave vectors along the edge, fractions of the reciprocal cell.
        squares : (n,) w of the waves, ascending at each wave vector, in reduced units.
        warnings : sentences about the crystal, which the results hold.

        Raises
        ------
        InputError : arrays larger than the memory.
        PrecisionError : a wave decays too slowly to be told from those of the bulk.
        """
        half_space = self.half_space
        self._require_memory(len(point))
        frequencies = np.sqrt(squares)
        group, sizes = _group_waves(point, frequencies)
        outer, inner, hop = half_space.blocks(q)
        of_crystal = []
        of_cut = []
        for number, size in enumerate(sizes.tolist()):
            members = np.flatnonzero(group == number)
            q_number = point[members[0]]  # of the wave vector of the group
            w = float(np.mean(squares[members]))
            waves = self._find_waves(outer[q_number], inner[q_number], hop[q_number], w, size)
            energies_of_cut, energies_of_crystal = self._measure(waves, q[q_number])
            of_cut += [energies_of_cut] * size
            of_crystal += [energies_of_crystal] * size
        angular = frequencies * half_space.units.angular_frequency
        degenerate = (sizes > 1)[group]
        crystal = half_space.network
        return (
            self._make_sensitivities(of_crystal, angular, degenerate, crystal, warnings),
            self._make_sensitivities(of_cut, angular, degenerate, half_space.cut, warnings),
        )

    def _find_waves(
        self, outer: Complex, inner: Complex, hop: Complex, w: float, count: int
    ) -> _EqualWaves:
        """Return the ``count`` waves at w, from the blocks ``outer`` E_0, ``inner`` E and ``hop``
        A, (size, size). Raises what :func:`_find_decay` raises.
        """
        size = len(outer)
        decaying_motions, step = _find_decay(inner, hop, w)  # V and S
        first = decaying_motions[:size]
        # the outer block: (E_0 - w) u_0 + A u_1 = 0
        condition = np.hstack([outer - w * np.eye(size), hop]) @ decaying_motions
        # the motions of the waves are the null vectors of the condition
        amplitudes = np.linalg.svd(condition)[2][size - count :].conj().T
        metric = amplitudes.conj().T @ _sum_blocks(first.conj().T @ first, step.conj().T)
        metric = metric @ amplitudes
        # in the basis of the inverse factor the energy of each wave is one
        scale = np.linalg.inv(np.linalg.cholesky(0.5 * (metric + metric.conj().T)))
        amplitudes = amplitudes @ scale.conj().T
        amplitudes_in_blocks = [amplitudes]
        for _ in range(self._n_blocks - 1):
            amplitudes_in_blocks.append(step @ amplitudes_in_blocks[-1])
        root = _find_root(_sum_blocks(amplitudes @ amplitudes.conj().T, step) / count)
        return _EqualWaves(
            outer_motions=np.array([first @ z for z in amplitudes_in_blocks]),
            block_root=first @ root,
            pair_root=decaying_motions @ step @ root,
        )

    @property
    def _n_blocks(self) -> int:
        """Number of blocks of the half space that the balls of the cut that move fill, the last
        block perhaps only in part.
        """
        return math.ceil(np.count_nonzero(self.ball_number >= 0) / self._per_block)

    @property
    def _per_block(self) -> int:
        """Number of balls of a block."""
        return self.half_space.reach * self.half_space.per_layer

    def _measure(self, waves: _EqualWaves, q: Array) -> tuple[_MeanSquares, _MeanSquares]:
        """Return the mean squares in ``waves`` at q (p - 1,): those of the contacts and balls of
        the cut, and those of the crystal, which are sums over all layers.
        """
        half_space = self.half_space
        count = half_space.motions.count
        n_waves = waves.outer_motions.shape[2]
        n_moving = int(np.count_nonzero(self.ball_number >= 0))
        all_motions = waves.outer_motions.reshape(-1, count, n_waves)
        # squares of these motions, summed over the waves, are means over the waves
        motions = all_motions[:n_moving] / np.sqrt(n_waves)
        squares = self._square(motions, q, np.arange(half_space.cut.n_contacts))
        squares_of_motions = np.sum(np.abs(motions) ** 2, axis=2)
        return _MeanSquares(squares, squares_of_motions), self._sum_crystal(waves, q, squares)

    def _sum_crystal(
        self, waves: _EqualWaves, q: Array, squares_of_cut: dict[str, Array]
    ) -> _MeanSquares:
        """Return the mean squares in ``waves`` at q (p - 1,) of the contacts and balls of the
        crystal, sums over all layers. ``squares_of_cut``, (n_c,) by name, are those of the
        deformations of the contacts of the cut.
        """
        half_space = self.half_space
        count = half_space.motions.count
        # contacts of the outer block, then those of all blocks below. The deformations of these,
        # summed over the blocks, are those of the contacts of the second block in the motions Y
        squares_of_crystal = {
            name: self._sum_over_layers(values, self.outer_block == 0)
            for name, values in squares_of_cut.items()
        }
        contacts_of_second = np.flatnonzero(self.outer_block == 1)
        pair_motions = waves.pair_root.reshape(-1, count, waves.pair_root.shape[1])
        no_motions = np.zeros((self._per_block, *pair_motions.shape[1:]))  # of the outer block
        motions_below = np.concatenate([no_motions, pair_motions])
        for name, values in self._square(motions_below, q, contacts_of_second).items():
            values_of_cut = np.zeros(half_space.cut.n_contacts)
            values_of_cut[contacts_of_second] = values
            sums = self._sum_over_layers(values_of_cut, self.outer_block == 1)
            squares_of_crystal[name] += sums

        block_motions = waves.block_root.reshape(half_space.reach, half_space.per_layer, count, -1)
        turn = turn_motions(half_space.motions, half_space.layers.turn.T)
        # the motions of each ball n of each layer l, along the axes of the crystal
        turned_motions = np.einsum("ab,lnbk->lnak", turn, block_motions)
        motions_of_crystal = np.sum(np.abs(turned_motions) ** 2, axis=(0, 3))
        return _MeanSquares(squares_of_crystal, motions_of_crystal)

    def _sum_over_layers(self, values: Array, is_counted: Flags) -> Array:
        """Return sums for each contact of the crystal: of the ``values`` (n_c,) of those contacts
        of the cut that are this contact, and for which ``is_counted`` (n_c,) is true.
        """
        is_bulk = is_counted & (self.crystal_contact >= 0)
        n_contacts = self.half_space.network.n_contacts
        sums = np.bincount(self.crystal_contact[is_bulk], values[is_bulk], minlength=n_contacts)
        return np.asarray(sums, float)

    def _square(self, motions: Complex, q: Array, contacts: Index) -> dict[str, Array]:
        """Return a dictionary of the squares (m,) of the deformations of some ``contacts`` (m,) of
        the cut, summed over the last axis of mass-weighted ``motions`` (n, motions, k), by the
        kinds of :attr:`rows`. The wave vector along the edge is q (p - 1,).

        ``motions`` are those of balls in the order of :attr:`ball_number`; balls beyond these do
        not move.
        """
        cut = self.half_space.cut
        masses = np.where(cut.moving, cut.masses, np.inf)
        padded = np.concatenate([motions, np.zeros((1, *motions.shape[1:]))])
        phase = np.exp(2.0j * np.pi * (cut.shift[contacts, : len(q)] @ q))

        def take_motions(balls: Index) -> Complex:
            """Return the motions (m, motions, k), not mass-weighted, of ``balls`` (m,)."""
            number = self.ball_number[balls]
            is_moving = (number >= 0) & (number < len(motions))
            scale = 1.0 / np.sqrt(masses[balls])
            return np.asarray(scale[:, None, None] * padded[np.where(is_moving, number, -1)])

        motions_of_j = take_motions(cut.j[contacts]) * phase[:, None, None]
        motions_of_i = take_motions(cut.i[contacts])
        squares = np.empty((len(self.rows), len(contacts)))
        for row, squares_of_row in zip(self.rows, squares, strict=True):
            # sums over the motions a of the ball at each end
            deformation = np.einsum("ca,cak->ck", row.head[contacts], motions_of_j)
            deformation -= np.einsum("ca,cak->ck", row.tail[contacts], motions_of_i)
            squares_of_row[:] = np.sum(np.abs(deformation) ** 2, axis=1)
        rows_of_contacts = [
            row._replace(stiffness=np.broadcast_to(row.stiffness, cut.n_contacts)[contacts])
            for row in self.rows
        ]
        return sum_kinds(rows_of_contacts, squares.ravel())

    def _make_sensitivities(
        self,
        energies: list[_MeanSquares],
        angular: Array,
        degenerate: Flags,
        network: Any,
        warnings: tuple[str, ...],
    ) -> FrequencySensitivities:
        """Return the derivatives of ``angular`` frequencies (n,), rad/s, from the ``energies`` of
        each wave in the contacts and balls of a ``network``, in SI units.

        ``degenerate`` (n,) says which waves share their frequency, and ``warnings`` are those of
        the result.
        """
        balls = np.flatnonzero(network.moving)
        kinds = {STIFFNESSES[row.kind] for row in self.rows}
        count = len(energies)
        squares = {
            name: np.reshape(
                [of_wave.deformations[name] for of_wave in energies],
                (count, network.n_contacts),
            )
            for name in kinds
        }
        of_balls = np.reshape(
            [of_wave.motions for of_wave in energies],
            (count, balls.size, self.half_space.motions.count),
        )
        of_modes = ModeEnergies(angular, degenerate, squares, of_balls)
        place = Place(network, Units(1.0, 1.0, 1.0), balls, np.arange(network.n_contacts))
        return find_frequency_sensitivities(of_modes, place, warnings)

    def _require_memory(self, count: int) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless derivatives of ``count``
        frequencies fit into memory.
        """
        numbers = 0
        for network in (self.half_space.network, self.half_space.cut):
            numbers += len(self.rows) * network.n_contacts
            # at most one of the mass, the inertia and a spring to the ground for each motion
            numbers += 3 * network.n_balls * self.half_space.motions.count
        require_memory(
            f"derivatives of {count:,} frequencies",
            8.0 * _ARRAYS_HELD * count * numbers,
            "Take fewer wave vectors",
        )


def _group_waves(point: Index, frequencies: Array) -> tuple[Index, Index]:
    """Return the number (n,) of the group of each wave, and the number (m,) of waves in each group:
    a group has one frequency at one wave vector. ``point`` (n,) is the number of the wave vector of
    each wave, and ``frequencies`` (n,) are ascending at each.
    """
    groups = np.zeros(len(point), np.intp)
    for wavevector in np.unique(point):
        is_here = point == wavevector
        # no two wave vectors share a number of a group
        groups[is_here] = number_equal(frequencies[is_here]) + len(point) * wavevector
    _, group, sizes = np.unique(groups, return_inverse=True, return_counts=True)
    return group, sizes


def _find_decay(inner: Complex, hop: Complex, w: float) -> tuple[Complex, Complex]:
    """Return V (2 size, size), the motions of two blocks in all waves that decay at w, and S (size,
    size), which takes them to the next block, from the blocks ``inner`` E and ``hop`` A, both
    (size, size).

    Raises :class:`~granphon.base.errors.PrecisionError` unless as many waves decay from the edge as
    towards it.
    """
    from scipy.linalg import ordqz

    size = len(inner)
    left, right = make_pencil(inner, hop, w)
    upper, divisor, alpha, beta, _, vectors = ordqz(left, right, "iuc", "complex")
    if np.count_nonzero(np.abs(alpha) < np.abs(beta)) != size:
        raise PrecisionError(
            "a wave of the edge cannot be told from waves of the bulk",
            "It decays too slowly, so near to an edge of a band",
            "Shift the wave vector a little",
        )
    step = np.linalg.solve(divisor[:size, :size], upper[:size, :size])
    return np.asarray(vectors[:, :size], complex), np.asarray(step, complex)


def _sum_blocks(matrix: Complex, step: Complex) -> Complex:
    """Return the sum over n from zero of S^n P (S^n)^H, all (size, size), for a ``matrix`` P and a
    ``step`` S.
    """
    total = matrix
    for _ in range(_MOST_DOUBLINGS):
        addition = step @ total @ step.conj().T
        total = total + addition
        if np.linalg.norm(addition) <= _LAST_PART * np.linalg.norm(total):
            break
        step = step @ step
    return total


def _find_root(matrix: Complex) -> Complex:
    """Return R with R R^H = ``matrix`` (m, m), which is Hermitian and not negative but for
    rounding.
    """
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.conj().T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
