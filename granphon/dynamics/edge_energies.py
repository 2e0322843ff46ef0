"""Energies of the waves of an edge, of which derivatives of their frequencies are made.

Between the bands a wave of the edge decays from block to block. The motions of two blocks are
V S^n z, n from zero at the edge: the columns of V span the motions that decay, S takes them to the
next block, and the outer block decides which z is the wave. V and S come from a generalised Schur
decomposition of the pencil that joins blocks, so that they exist also where the outer block of a
crystal without this edge would have the wave itself. Energies of all layers together are sums over
n, found by doubling: with P = z z^H the sum of S^n P S^nH over 2 m blocks is that over m, plus
S^m times that over m times S^mH.
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


class _Wave(NamedTuple):
    """Waves of one frequency, as mass-weighted motions.

    Attributes
    ----------
    outer : (blocks, size, count) motions of the waves in each of the outer blocks.
    whole : (size, size) motions of a block, as columns, the sum of whose products X X^H is that
        over all blocks, of the mean wave. The sum of their squares is one.
    below : (2 size, size) motions of two blocks, as columns, the sum of whose products is that over
        all pairs of blocks that follow each other, without the outermost pair.
    """

    outer: Complex
    whole: Complex
    below: Complex


class _MeanSquares(NamedTuple):
    """Mean squares in waves of one frequency.

    Attributes
    ----------
    deformations : (n_c,) of the deformations of contacts, by the names of
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
        moving = np.flatnonzero(cut.moving)
        #: (n,) the number of each ball of the cut among those that move; -1 of other balls
        self.ball_number: Index = np.full(cut.n_balls, -1)
        self.ball_number[moving] = np.arange(moving.size)
        per_block = half_space.reach * half_space.per_layer
        # a body that does not move belongs to no block
        block = np.where(self.ball_number < 0, moving.size, self.ball_number // per_block)
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

        Raises :class:`~granphon.base.errors.InputError` for arrays larger than the memory, and
        :class:`~granphon.base.errors.PrecisionError` for a wave that decays too slowly to be told
        from those of the bulk.
        """
        half_space = self.half_space
        self._require_memory(len(point))
        frequencies = np.sqrt(squares)
        groups = np.zeros(len(point), np.intp)
        for wavevector in np.unique(point):
            is_at = point == wavevector
            # no two wave vectors share a number of a group
            groups[is_at] = number_equal(frequencies[is_at]) + len(point) * wavevector
        _, group, sizes = np.unique(groups, return_inverse=True, return_counts=True)
        outer, inner, hop = half_space.blocks(q)
        of_crystal = []
        of_cut = []
        for number, size in enumerate(sizes.tolist()):
            members = np.flatnonzero(group == number)
            at = point[members[0]]
            w = float(np.mean(squares[members]))
            wave = self._find_wave(outer[at], inner[at], hop[at], w, size)
            energies_of_cut, energies_of_crystal = self._measure(wave, q[at])
            of_cut += [energies_of_cut] * size
            of_crystal += [energies_of_crystal] * size
        angular = frequencies * half_space.units.angular_frequency
        degenerate = (sizes > 1)[group]
        crystal = half_space.network
        return (
            self._make_sensitivities(of_crystal, angular, degenerate, crystal, warnings),
            self._make_sensitivities(of_cut, angular, degenerate, half_space.cut, warnings),
        )

    def _find_wave(
        self, outer: Complex, inner: Complex, hop: Complex, w: float, count: int
    ) -> _Wave:
        """Return the ``count`` waves at w, from the blocks ``outer`` E_0, ``inner`` E and ``hop``
        A, (size, size).
        """
        size = len(outer)
        waves, step = _find_decay(inner, hop, w)
        first = waves[:size]
        # the outer block: (E_0 - w) u_0 + A u_1 = 0
        condition = np.hstack([outer - w * np.eye(size), hop]) @ waves
        amplitudes = np.linalg.svd(condition)[2][size - count :].conj().T
        metric = amplitudes.conj().T @ _sum_blocks(first.conj().T @ first, step.conj().T)
        metric = metric @ amplitudes
        # in the basis of the inverse factor the energy of each wave is one
        scale = np.linalg.inv(np.linalg.cholesky(0.5 * (metric + metric.conj().T)))
        amplitudes = amplitudes @ scale.conj().T
        in_blocks = [amplitudes]
        for _ in range(self._n_blocks - 1):
            in_blocks.append(step @ in_blocks[-1])
        whole = _sum_blocks(amplitudes @ amplitudes.conj().T, step) / count
        root = _find_root(whole)
        return _Wave(np.array([first @ z for z in in_blocks]), first @ root, waves @ step @ root)

    @property
    def _n_blocks(self) -> int:
        """Number of blocks in which balls of the cut move, the last one in part."""
        return math.ceil(np.count_nonzero(self.ball_number >= 0) / self._per_block)

    @property
    def _per_block(self) -> int:
        """Number of balls of a block."""
        return self.half_space.reach * self.half_space.per_layer

    def _measure(self, wave: _Wave, q: Array) -> tuple[_MeanSquares, _MeanSquares]:
        """Return the mean squares in a ``wave`` at q (p - 1,): those of the contacts and balls of
        the cut, and those of the crystal, which are sums over all layers.
        """
        half_space = self.half_space
        count = half_space.motions.count
        in_cut = wave.outer.reshape(-1, count, wave.outer.shape[2])
        n_moving = int(np.count_nonzero(self.ball_number >= 0))
        in_cut = in_cut[:n_moving] / np.sqrt(wave.outer.shape[2])
        squares = self._square(in_cut, q, np.arange(half_space.cut.n_contacts))
        motions = np.sum(np.abs(in_cut) ** 2, axis=2)

        # contacts of the outer block, then those of all blocks below, whose deformations are those
        # of the contacts of the second block in the motions `below`
        in_crystal = {
            name: self._sum_over_layers(values, self.outer_block == 0)
            for name, values in squares.items()
        }
        second = np.flatnonzero(self.outer_block == 1)
        below = wave.below.reshape(-1, count, wave.below.shape[1])
        shifted = np.concatenate([np.zeros((self._per_block, *below.shape[1:])), below])
        for name, values in self._square(shifted, q, second).items():
            values_of_cut = np.zeros(half_space.cut.n_contacts)
            values_of_cut[second] = values
            in_crystal[name] += self._sum_over_layers(values_of_cut, self.outer_block == 1)

        whole = wave.whole.reshape(half_space.reach, half_space.per_layer, count, -1)
        turn = turn_motions(half_space.motions, half_space.layers.turn.T)
        # the motions of each ball n of each layer l, along the axes of the crystal
        turned = np.einsum("ab,lnbk->lnak", turn, whole)
        motions_of_crystal = np.sum(np.abs(turned) ** 2, axis=(0, 3))
        return _MeanSquares(squares, motions), _MeanSquares(in_crystal, motions_of_crystal)

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

        def move(balls: Index) -> Complex:
            """Return the motions (m, motions, k) of ``balls`` (m,)."""
            number = self.ball_number[balls]
            moves = (number >= 0) & (number < len(motions))
            scale = 1.0 / np.sqrt(masses[balls])
            return np.asarray(scale[:, None, None] * padded[np.where(moves, number, -1)])

        ahead = move(cut.j[contacts]) * phase[:, None, None]
        behind = move(cut.i[contacts])
        squares = np.empty((len(self.rows), len(contacts)))
        for row, squares_of_row in zip(self.rows, squares, strict=True):
            # sums over the motions a of the ball at each end
            deformation = np.einsum("ca,cak->ck", row.head[contacts], ahead)
            deformation -= np.einsum("ca,cak->ck", row.tail[contacts], behind)
            squares_of_row[:] = np.sum(np.abs(deformation) ** 2, axis=1)
        chosen_rows = [
            row._replace(stiffness=np.broadcast_to(row.stiffness, cut.n_contacts)[contacts])
            for row in self.rows
        ]
        return sum_kinds(chosen_rows, squares.ravel())

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
            numbers += 3 * network.n_balls * self.half_space.motions.count
        require_memory(
            f"derivatives of {count:,} frequencies",
            8.0 * _ARRAYS_HELD * count * numbers,
            "Take fewer wave vectors",
        )


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


def _sum_blocks(first: Complex, step: Complex) -> Complex:
    """Return the sum over n from zero of S^n ``first`` S^nH, all (size, size), for a ``step`` S."""
    total = first
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
