"""Half spaces: the waves at an edge of a network that goes on without end below it.

Layers of balls, numbered from the edge, couple to the next layers only. So the matrix D(q) of the
half space, at a wave vector q along the edge, is made of blocks: E_0 of the outer layers, E of all
others, and A from each to the next. Its Green's function at the edge, G(w) = (w - F)^-1 with w =
omega^2, follows from eliminating every other block again and again, which doubles the distance that
is taken in (M. P. Lopez Sancho, J. M. Lopez Sancho and J. Rubio, J. Phys. F 15, 851, 1985).

Between the bands a wave of the edge is a pole of G. Within them G has a part that is lost to the
bulk, and a resonance of the edge leaks: a root w of S = G^-1 near the real axis, below it, has the
frequency and half the width of the wave.

The velocity of the long wave is that of the elastic continuum (D. M. Barnett and J. Lothe, J. Phys.
F 4, 671, 1974). All is in reduced units: length d, stiffness k, mass M.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.ball import Wall
from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import GranphonError, InputError
from granphon.base.memory import available_memory, require_memory
from granphon.base.text import counted
from granphon.base.validation import real_array
from granphon.dynamics.bloch_waves import Couplings
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.deformation_rows import Row, find_anchors, network_rows, push_rows
from granphon.networks.network import ContactNetwork

#: the elimination of layers ends where the coupling that is left, over the largest block, is below
#: this
_COUPLING_TOLERANCE = 1e-17
#: doublings of the number of eliminated layers, at most
_MOST_DOUBLINGS = 60
#: most entries of blocks that are held at a time
_CHUNK = 2**20
#: blocks that are held for each w
_MATRICES_HELD = 12
#: matrices of all contacts that are held together while layers are made
_COPIES_HELD = 2.0
#: wavenumbers across the edge on which the edges of bands are bracketed
_BAND_SAMPLES = 48
#: golden sections that refine a bracket
_SECTIONS = 40
#: imaginary parts of w, over the distance to the nearest band, at which M is found in gaps. A piece
#: of the crystal between two walls may have a mode at the real w, where the elimination would
#: divide by zero. Richardson extrapolation from two of them leaves an error of fourth order
_GAP_BROADENINGS = np.array([1e-3, 2e-3])
#: imaginary part of w within a band, over the highest w
_BAND_BROADENING = 1e-9
#: step of finite differences in w within a band, over the highest w
_DIFFERENCE_STEP = 1e-5
#: w, over the bound of all bands, up to which waves are sought above the highest band
_SEARCH_BOUND = 1.01
#: relative width of a gap up to which two bands count as touching
_LEAST_GAP = 1e-7
#: margin at both edges of a gap, over its width, in which no wave is sought
_GAP_MARGIN = 1e-9
#: w, over the upper end of an interval of w, up to which a motion costs no energy
_LEAST_SQUARE = 1e-6
#: eigenvalue of M at an end of a gap, over the largest there, up to which its sign is that of
#: rounding
_SIGN_ROUNDING = 1e-14
#: waves closer than this in w, over the width of the gap, are one degenerate set
_DEGENERACY = 1e-9
#: relative tolerance of w of an edge wave
_ROOT_TOLERANCE = 1e-14
#: starts in a band for the search of leaky waves
_LEAKY_STARTS = 48
#: most steps of Newton's method along the real axis, in the search for leaky waves
_SEARCH_STEPS = 8
#: most steps of Newton's method for the pole of a leaky wave
_NEWTON_STEPS = 12
#: relative change of w at which steps of Newton's method end
_NEWTON_TOLERANCE = 1e-8
#: difference of two poles, over the highest w, up to which the poles are one
_POLE_TOLERANCE = 0.1 * _NEWTON_TOLERANCE
#: -w, over the highest w, at which edge motions without energy are told from others
_FREE_SHIFT = 1e-10
#: least part of the kinetic energy of a motion at zero frequency, in the outer block, with which
#: the motion is one of the edge
_FREE_TOP_PART = 1e-3
#: distance of two resonances, over the lesser half width, up to which both lead to one pole
_RESONANCE_DISTANCE = 0.5
#: change of the factor of a wave in a step, over its distance from the factors of other waves, up
#: to which the wave counts as the same
_LARGEST_MOVE = 0.25
#: least step below the real axis, and step of a difference, over the half width
_LEAST_STEP = 1e-4
#: error of w of a pole, over the highest w
_POLE_NOISE = 1e-12
#: factor from block to block that stands for all larger ones
_LARGEST_FACTOR = 1e3
#: half width over frequency up to which a resonance counts as a leaky wave
_MOST_WIDTH = 0.05
#: part of the kinetic energy of a leaky wave in the outer block, at least
_TOP_PART = 0.02
#: angles, rad, of bulk waves to the edge among which the one that is slowest along it is sought
_COURSES = np.linspace(-1.4, 1.4, 281)


class EdgeWaves(NamedTuple):
    """Waves of an edge, (n,) each.

    Attributes
    ----------
    point : numbers of their wave vectors.
    squares : w = omega^2, k/M, complex where a wave leaks.
    weight : kinetic energy in the outer block, the top layer or layers, over all kinetic energy.
    """

    point: Index
    squares: Complex
    weight: Array


class _Resonances(NamedTuple):
    """Narrow resonances of an edge within bands, (n,) each, as Newton's method leaves them.

    Attributes
    ----------
    point : number of the wave vector.
    band : (2, n) ends of w of the bands.
    w : real part of the resonance.
    shift : from w to the root of S + dw S', complex.
    last_step : size of the last step along the real axis; infinite where the step left the bands.
    weight : kinetic energy in the outer block, over all kinetic energy.
    """

    point: Index
    band: Array
    w: Array
    shift: Complex
    last_step: Array
    weight: Array

    def take(self, numbers: Index) -> _Resonances:
        """Return the resonances of some ``numbers`` (m,), in their order."""
        return _Resonances(
            self.point[numbers],
            self.band[:, numbers],
            self.w[numbers],
            self.shift[numbers],
            self.last_step[numbers],
            self.weight[numbers],
        )


class HalfSpace:
    """The half space of a network's layers above which there is an edge, in the reduced units of
    the network.

    ``axis`` is the period that the edge cuts, and ``edge`` how it is held, as for
    :meth:`ContactNetwork.cut`; the layers go on from its lower face. A block is :attr:`reach`
    layers, as many as a contact reaches across, and :attr:`size` is the number of its motions. The
    network has p periods, of which p - 1 lie along the edge.

    Raises :class:`~granphon.base.errors.InputError` for an axis or an edge that
    :meth:`ContactNetwork.cut` refuses, for layers that no contact joins, for motions that deform no
    contact, for layers too large for the memory, and under ``prestress`` for static tangential
    forces or torques and for slip by levers that exceed the arms.
    """

    def __init__(self, network: ContactNetwork, axis: Any, edge: str | Wall = "free") -> None:
        """Cut the outer layers, and make the rows of C of the contacts of the two outer blocks."""
        self.network = network
        self.edge = edge
        self.units = network.scales
        self.layers = network.layers_across(axis)
        self.reach = self._count_reach()
        # three blocks of layers, and more below, so that the lower edge of the cut is out of reach;
        # a clamped layer does not move, and belongs to no block
        #: number of layers of the cut
        self.n_layers = 4 * self.reach + 1
        if edge == "clamped":
            self.n_layers += 1
        cut = network.cut(axis, self.n_layers, (edge, "free"))
        #: the outer layers, of which the blocks are made
        self.cut = cut
        self.motions = cut.ball_motions
        self.per_layer = int(np.count_nonzero(network.moving))
        self.size = self.reach * self.per_layer * self.motions.count
        rows, stiffnesses = self._list_rows()
        is_moving = cut.moving
        # number of each ball among those that move; all that do not move share the next number
        number = np.where(is_moving, np.cumsum(is_moving) - 1, np.count_nonzero(is_moving))
        block = number // (self.reach * self.per_layer)
        # of each contact: the blocks of its two ends, numbered from the edge
        outer_block = np.minimum(block[cut.i], block[cut.j])
        inner_block = np.maximum(block[cut.i], block[cut.j])
        joins_moving_balls = is_moving[cut.i] & is_moving[cut.j]
        is_crossing = (outer_block == 0) & (inner_block == 1) & joins_moving_balls
        # contacts of the two outer blocks, which reach into a third
        contacts = np.flatnonzero(outer_block < 2)
        self._contacts = contacts
        self._edge_steps, self._matrix = self._assemble(rows, number)
        # of each row of each contact: its stiffness, and whether the contact begins in the second
        # block, or joins the two outer blocks
        self._stiffness: Array = np.concatenate([stiffness[contacts] for stiffness in stiffnesses])
        self._is_in_second: Array = np.tile(outer_block[contacts] == 1, len(rows))
        self._is_crossing: Array = np.tile(is_crossing[contacts], len(rows))
        self._row_kinds = [row.kind for row in rows]
        #: (2 size,) stiffnesses of springs to the ground of the two outer blocks, over masses, k/M
        self._spring_squares = self._list_anchors()

    @property
    def anchors(self) -> Array:
        """(size,) stiffnesses of springs to the ground of a block below the outer one, over masses,
        k/M.
        """
        return self._spring_squares[self.size :]

    def _list_anchors(self) -> Array:
        """Return the stiffnesses (2 size,) of springs to the ground of the two outer blocks, over
        masses, k/M.
        """
        stiffness = find_anchors(self.cut)
        if stiffness is None:
            return np.zeros(2 * self.size)
        is_moving = self.cut.moving
        masses = self.cut.masses[is_moving] / self.units.mass
        springs = stiffness[is_moving, : self.motions.count] / self.units.stiffness
        return np.asarray((springs / masses[:, None]).ravel()[: 2 * self.size])

    def _count_reach(self) -> int:
        """Return the largest number of layers that a contact reaches across; raise
        :class:`~granphon.base.errors.InputError` if no contact joins layers.
        """
        network = self.network
        periods = np.flatnonzero(network.pbc)
        # shifts of contacts between balls that are moved into one layer
        _, shift = self.layers.gather(
            network.positions[:, : network.dimension],
            network.i,
            network.j,
            network.shift[:, periods],
            np.isinf(network.radii),
        )
        layers_crossed = self.layers.split(shift)[1]
        reach = int(np.max(np.abs(layers_crossed), initial=0))
        if not reach:
            raise InputError(
                "no contact joins the layers",
                "Each would have its own waves",
                "Choose another axis",
            )
        return reach

    def _list_rows(self) -> tuple[list[Row], list[Array]]:
        """Return the rows of the contacts of the cut, and the stiffness (n_c,) of each row in
        reduced units, those of static normal forces among them.

        Raises :class:`~granphon.base.errors.InputError` for a network with ``prestress`` that has
        static tangential forces or torques, or slip by levers that exceed the arms.
        """
        cut = self.cut
        units = self.units
        rows = network_rows(cut)
        stiffnesses = [row.stiffness / units.stiffness for row in rows]
        if not cut.prestress:
            return rows, stiffnesses
        has_tangential_force = cut.tangential_force is not None and np.any(cut.tangential_force)
        has_torque = cut.contact_torque is not None and np.any(cut.contact_torque)
        if has_tangential_force or has_torque or cut.lever_excesses is not None:
            raise InputError(
                "the network has static tangential forces or torques, or slip by levers that exceed"
                " the arms",
                "With prestress, these have no potential",
                "Leave static forces out (prestress=False)",
            )
        push_stiffness = -cut.normal_force / cut.distance / units.stiffness
        for row in push_rows(cut.normal[:, : self.network.dimension], self.motions):
            rows.append(row)
            stiffnesses.append(push_stiffness)
        return rows, stiffnesses

    def _assemble(self, rows: list[Row], number: Index) -> tuple[Index, Array]:
        """Return steps s (n_s, p - 1) along the edge, and C_s M^-1/2 (n_s, rows n_c, 3 size) of the
        n_c contacts of the two outer blocks.

        C(q) is the sum over s of C_s exp(i q.s), with tails at s = 0. ``number`` (n,) is that of
        each ball of the cut among those that move, and the next number for a body that does not.
        """
        cut = self.cut
        contacts = self._contacts
        count = self.motions.count
        # the first row, of zeros, is the step of the tails
        all_steps = np.pad(cut.shift[contacts], ((1, 0), (0, 0)))
        steps, step_of_row = np.unique(all_steps, axis=0, return_inverse=True)
        step_of_tail = step_of_row.ravel()[0]
        step_of_head = step_of_row.ravel()[1:]
        masses = np.where(cut.moving, cut.masses / self.units.mass, np.inf)
        inverse_root_mass = 1.0 / np.sqrt(masses)
        tails = cut.i[contacts]
        heads = cut.j[contacts]
        lines = np.arange(len(contacts))
        shape = (len(steps), len(rows), len(contacts), int(number.max()) + 1, count)
        self._require_memory(shape)
        matrix = np.zeros(shape)
        for kind, row in enumerate(rows):
            tail = -row.tail[contacts] * inverse_root_mass[tails][:, None]
            head = row.head[contacts] * inverse_root_mass[heads][:, None]
            matrix[step_of_tail, kind, lines, number[tails]] += tail
            matrix[step_of_head, kind, lines, number[heads]] += head
        n_balls = 3 * self.size // count  # those of three blocks
        in_blocks = matrix[:, :, :, :n_balls].reshape(len(steps), -1, 3 * self.size)
        return steps[:, : len(self.layers.cell)], in_blocks

    def _require_memory(self, shape: tuple[int, ...]) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless matrices of this ``shape`` fit
        into memory; the message has the number of balls whose matrices would.
        """
        needed = _COPIES_HELD * 8.0 * math.prod(shape)
        # rows and columns of a matrix are in proportion to the balls of a layer: memory goes as the
        # square of the balls. The available memory is infinite where it is not known
        fitting_part = min(available_memory() / needed, 1.0)
        n_fitting = int(self.per_layer * math.sqrt(fitting_part))
        require_memory(
            f"layers of {counted(self.per_layer, 'ball')}",
            needed,
            f"Take a network of {n_fitting:,} balls or fewer in each layer",
        )

    def _compute_rows(self, q: Array) -> Complex:
        """Return C M^-1/2 (..., rows, 2 size) of the contacts of the two outer blocks, as
        coefficients of the motions of these blocks, at wave vectors q (..., p - 1).
        """
        phase = np.exp(2.0j * np.pi * (q @ self._edge_steps.T))
        two_blocks = self._matrix[:, :, : 2 * self.size]
        return np.asarray(np.tensordot(phase, two_blocks, 1), complex)

    def blocks(self, q: Array) -> tuple[Complex, Complex, Complex]:
        """Return E_0, E and A, (n_q, size, size), at wave vectors q (n_q, p - 1) in fractions of
        the reciprocal cell.
        """
        size = self.size
        rows = self._compute_rows(q)
        matrices = rows.conj().swapaxes(1, 2) @ (self._stiffness[:, None] * rows)
        matrices += np.diag(self._spring_squares)
        return matrices[:, :size, :size], matrices[:, size:, size:], matrices[:, :size, size:]

    def couplings(self, q: Array, factors: tuple[Complex, Complex] | None = None) -> Couplings:
        """Return the blocks (size, size) of D at one wave vector q (p - 1,), in k/M.

        ``factors``, two arrays (n_f, n_c), multiply the stiffnesses of the contacts of :attr:`cut`
        against elongation, and against all other deformations; complex factors lose energy. What
        static forces and springs to the ground add is not multiplied. The blocks are then (n_f,
        size, size). By default stiffnesses are as they are.
        """
        size = self.size
        rows = self._compute_rows(q)
        stiffness = self._stiffness
        if factors is not None:
            elongation_factor, other_factor = factors
            # static forces, which push, are not changed
            factor_of_kind = {
                "elongation": elongation_factor,
                "push": np.ones_like(elongation_factor),
            }
            factor_of_row = [
                factor_of_kind.get(kind, other_factor)[:, self._contacts]
                for kind in self._row_kinds
            ]
            stiffness = stiffness * np.concatenate(factor_of_row, axis=1)
        both_blocks = rows.conj().T @ (stiffness[..., None] * rows) + np.diag(self._spring_squares)
        # the part of contacts between the two blocks: what they add to the diagonal of each block
        # is taken away where the blocks are cut apart
        crossing_rows = rows[self._is_crossing]
        crossing_stiffness = stiffness[..., self._is_crossing, None]
        crossing = crossing_rows.conj().T @ (crossing_stiffness * crossing_rows)
        return Couplings(
            inner=both_blocks[..., size:, size:],
            tail=crossing[..., :size, :size],
            head=crossing[..., size:, size:],
            up=both_blocks[..., :size, size:],
            down=both_blocks[..., size:, :size],
        )

    def read_wavevector(self, q: ArrayLike) -> Array:
        """Return one wave vector along the edge (p - 1,), in fractions of the reciprocal cell; zero
        if () is given.

        Raises :class:`~granphon.base.errors.InputError` for what is no array of real numbers, for
        another shape, and for a number that is not finite.
        """
        n_along = len(self.layers.cell)
        fractions = real_array("q", q)
        if fractions.shape not in ((n_along,), (0,)):
            raise InputError(
                f"q has the shape {fractions.shape}",
                mend=f"Give ({n_along},) fractions, along the layers",
            )
        if not np.all(np.isfinite(fractions)):
            raise InputError("q is not finite", mend="Give finite numbers")
        return fractions if fractions.size else np.zeros(n_along)

    def wavenumbers(self, factors: Complex, q: Array) -> Complex:
        """Return the wavenumbers (...) across the edge, 1/m, of motions that change by ``factors``
        (...) from layer to layer, none of which is zero.

        Real parts are from minus pi to pi over the height of a layer. The wave vector along the
        edge is q (p - 1,), in fractions of the reciprocal cell.
        """
        n_along = len(q)
        # a layer is shifted along the edge against the layer above: the phase of this shift in the
        # wave along the edge is no part of the wave across
        layer_shift = np.linalg.solve(self.layers.cell[:, :n_along].T, self.layers.stack[:n_along])
        phase_along_edge = layer_shift @ q
        turns = np.angle(factors) / (2.0 * np.pi) - phase_along_edge
        nearest_turns = (turns + 0.5) % 1.0 - 0.5
        return (2.0 * np.pi * nearest_turns - 1j * np.log(np.abs(factors))) / self.height

    @property
    def height(self) -> float:
        """Height of a layer, m."""
        return float(self.layers.stack[len(self.layers.cell)])

    @cached_property
    def highest(self) -> float:
        """An upper bound of all squared frequencies, k/M."""
        rows = np.abs(self._matrix).sum(axis=0)
        of_contacts = float((rows.T @ (np.abs(self._stiffness) * rows.sum(axis=1))).max())
        return of_contacts + float(self._spring_squares.max())

    def _eliminate(
        self, outer: Complex, inner: Complex, hop: Complex, point: Index, w: Complex
    ) -> tuple[Complex, Complex]:
        """Return w - F of the outer block, and of a block with blocks on both sides, both (n, m,
        m), at each w (n,).

        The blocks ``outer`` E_0, ``inner`` E and ``hop`` A are (n_q, m, m), and ``point`` (n,) is
        the number of the wave vector of each w.
        """
        size = outer.shape[1]
        surface = np.empty((len(w), size, size), complex)
        bulk = np.empty((len(w), size, size), complex)
        chunk_length = max(1, _CHUNK // (_MATRICES_HELD * size**2))
        for first in range(0, len(w), chunk_length):
            chunk = slice(first, first + chunk_length)
            numbers = point[chunk]
            shift = w[chunk, None, None] * np.eye(size)
            top, middle = self._double_layers(outer[numbers], inner[numbers], hop[numbers], shift)
            surface[chunk] = shift - top
            bulk[chunk] = shift - middle
        return surface, bulk

    def _double_layers(
        self, outer: Complex, inner: Complex, hop: Complex, shift: Complex
    ) -> tuple[Complex, Complex]:
        """Return F of the outer block, and of a block with blocks on both sides, from the blocks
        ``outer`` E_0, ``inner`` E and ``hop`` A, and from w times the unit matrix as ``shift``, all
        (n, m, m).

        Each turn eliminates every other block, with g = (w - E)^-1 of the blocks in between. B is
        the coupling back, the adjoint of A at first. The turns end where no coupling is left, or
        after :data:`_MOST_DOUBLINGS` turns, with the coupling of so many blocks left out.
        """
        size = outer.shape[1]
        top = outer.copy()
        middle = inner.copy()
        stacked_hops = np.concatenate([hop, hop.conj().swapaxes(1, 2)], axis=1)  # A on top of B
        numbers = np.arange(len(outer))  # of the w at which blocks are still coupled
        for _ in range(_MOST_DOUBLINGS):
            side_by_side = np.concatenate([stacked_hops[:, :size], stacked_hops[:, size:]], axis=2)
            products = stacked_hops @ np.linalg.solve(
                shift[numbers] - middle[numbers], side_by_side
            )
            down_and_up = products[:, :size, size:]  # A g B
            up_and_down = products[:, size:, :size]  # B g A
            top[numbers] += down_and_up
            middle[numbers] += down_and_up + up_and_down
            next_down = products[:, :size, :size]  # A g A
            next_up = products[:, size:, size:]  # B g B
            change = np.max(np.abs(down_and_up) + np.abs(up_and_down), axis=(1, 2))
            is_coupled = change > _COUPLING_TOLERANCE * self.highest
            numbers = numbers[is_coupled]
            stacked_hops = np.concatenate([next_down, next_up], axis=1)[is_coupled]
            if not numbers.size:
                break
        return top, middle

    def inverse_green(self, q: Array, point: Index, w: Complex) -> Complex:
        """Return S = w - F of the outer layers, (n, size, size), at wave vectors ``q[point]`` and w
        (n,).
        """
        return self._eliminate(*self.blocks(q), point, w)[0]

    def bands(self, q: Array) -> Array:
        """Return the lowest and the highest w (n_q, size, 2) of each branch at q (n_q, p - 1), over
        all wavenumbers across the edge.
        """
        _, inner, hop = self.blocks(q)

        def solve(point: Index, angle: Array) -> Array:
            """Return w (n, size), ascending, at phases ``angle`` (n,) from block to block, at the
            wave vectors of numbers ``point`` (n,).
            """
            to_next = hop[point] * np.exp(1j * angle)[:, None, None]
            return np.linalg.eigvalsh(inner[point] + to_next + to_next.conj().swapaxes(1, 2))

        n_points = len(q)
        size = self.size
        angles = 2.0 * np.pi * np.arange(_BAND_SAMPLES) / _BAND_SAMPLES
        sampled_points = np.repeat(np.arange(n_points), _BAND_SAMPLES)
        all_samples = solve(sampled_points, np.tile(angles, n_points))
        samples = all_samples.reshape(n_points, _BAND_SAMPLES, size)
        # the highest w is where -w is lowest
        sign = np.array([1.0, -1.0])
        extreme_sample = np.argmin(samples[..., None] * sign, axis=1)  # (n_q, size, 2)
        start = angles[extreme_sample].reshape(-1)
        # wave vector, branch and sign of each of the (n_q size 2,) extremes
        points = np.repeat(np.arange(n_points), 2 * size)
        branch = np.tile(np.repeat(np.arange(size), 2), n_points)
        signs = np.tile(sign, n_points * size)

        def evaluate(angle: Array) -> Array:
            """Return w times its sign (n_q size 2,) at phases ``angle`` (n_q size 2,)."""
            w = solve(points, angle)[np.arange(len(points)), branch]
            return np.asarray(signs * w)

        lowest_values = _find_minima(evaluate, start, 2.0 * np.pi / _BAND_SAMPLES)
        return (signs * lowest_values).reshape(n_points, size, 2)

    # -- waves of the edge -------------------------------------------------------------------------

    def _find_gaps(self, q: Array) -> tuple[Index, Array]:
        """Return the intervals of w without a band at wave vectors q (n_q, p - 1): the number of
        the wave vector of each, (n,), and their ends (2, n).
        """
        top = _SEARCH_BOUND * self.highest
        return self._join_intervals([_find_free_intervals(bands, top) for bands in self.bands(q)])

    def _find_filled_intervals(self, q: Array) -> tuple[Index, Array]:
        """Return the intervals of w that bands fill at wave vectors q (n_q, p - 1), in the form of
        :meth:`_find_gaps`.
        """
        top = _SEARCH_BOUND * self.highest
        return self._join_intervals(
            [_find_complement(_find_free_intervals(bands, top)) for bands in self.bands(q)]
        )

    def _join_intervals(
        self, intervals_of_points: list[list[tuple[float, float]]]
    ) -> tuple[Index, Array]:
        """Return the number (n,) of the wave vector of each interval, and the ends (2, n), less a
        margin at both ends; ``intervals_of_points`` has a list of the intervals of each wave
        vector, pairs of ends.
        """
        points = []
        ends = []
        for point, intervals in enumerate(intervals_of_points):
            points += [point] * len(intervals)
            ends += intervals
        low, high = np.array(ends).reshape(-1, 2).T
        margin = _GAP_MARGIN * (high - low)
        # an interval begins above zero, as motions that cost nothing are no waves
        low = np.maximum(low + margin, _LEAST_SQUARE * high)
        return np.array(points, np.intp), np.stack([low, high - margin])

    def find_waves(self, q: Array) -> EdgeWaves:
        """Return all waves of the edge outside of the bands, at wave vectors q (n_q, p - 1).

        Waves are where M(w) of :class:`_CutCrystal` is singular. In a gap M is smooth and its
        eigenvalues rise, so that each has one zero if its sign changes over the gap, and none
        otherwise.
        """
        crystal = _CutCrystal(self, q)
        point, gap = self._find_gaps(q)
        ends = np.stack([crystal.eigenvalues(point, end, gap) for end in gap])  # (2, n, 2 size)
        # zeros at the very ends, beside the poles of g, have no sign
        rounding = _SIGN_ROUNDING * np.max(np.abs(ends), axis=2, keepdims=True)
        rises_through_zero = (ends[0] < -rounding[0]) & (ends[1] > rounding[1])
        interval, branch = np.nonzero(rises_through_zero)
        point = point[interval]
        gap = gap[:, interval]
        if not interval.size:
            return EdgeWaves(point, np.zeros(0, complex), np.zeros(0))

        def evaluate(waves: Index, w: Array) -> Array:
            """Return the eigenvalue (m,) of M that is to vanish, of some ``waves`` (m,) at w
            (m,).
            """
            eigenvalues = crystal.eigenvalues(point[waves], w, gap[:, waves])
            return np.asarray(eigenvalues[np.arange(len(waves)), branch[waves]])

        w = _find_roots(evaluate, gap, ends[:, interval, branch])
        return self._sort_sides(crystal, point, w, gap)

    def _sort_sides(self, crystal: _CutCrystal, point: Index, w: Array, gap: Array) -> EdgeWaves:
        """Return those of n waves that run at this edge, and not at the edge beyond the cut.

        The n waves of both edges of the cut ``crystal`` have w (n,) in gaps with the ends ``gap``
        (2, n), at the wave vectors of numbers ``point`` (n,).
        """
        points = []
        squares = []
        weights = []
        order = np.lexsort((w, point))
        width = gap[1] - gap[0]
        is_apart = np.diff(w[order]) > _DEGENERACY * width[order][1:]
        is_new = np.ones(len(w), bool)
        is_new[1:] = (np.diff(point[order]) > 0) | is_apart
        for degenerate_set in np.split(order, np.flatnonzero(is_new)[1:]):
            first_wave = degenerate_set[:1]
            mean_square = np.mean(w[degenerate_set])
            matrices, slopes, motions = crystal.find_matrices(
                point[first_wave], np.array([mean_square]), gap[:, first_wave]
            )
            slope = slopes[0]
            motions_beyond = motions[0, : self.size]
            motions_on_top = motions[0, self.size :]
            for wave in _choose_side(
                matrices[0], motions_beyond, motions_on_top, len(degenerate_set)
            ):
                # the derivative of M by w gives the energy of the whole wave
                energy = float((wave.conj() @ slope @ wave).real)
                top_energy = float(np.sum(np.abs(motions_on_top @ wave) ** 2))
                points.append(point[first_wave[0]])
                squares.append(mean_square)
                weights.append(top_energy / energy)
        return EdgeWaves(
            np.array(points, np.intp), np.array(squares, complex), np.array(weights, float)
        )

    def find_free_motions(self, q: Array) -> EdgeWaves:
        """Return the motions at zero frequency that reach the outer block, at q (n_q, p - 1). The
        weight of each is the part of its kinetic energy in the outer block.

        As the squared frequency w goes to zero from below, w times the Green's function becomes the
        matrix of the outer parts of all such motions, whose eigenvalues are these weights. The
        eigenvalues of other motions go to zero as w, or as its root where a band reaches zero.
        """
        w = np.full(len(q), -_FREE_SHIFT * self.highest, complex)
        green = np.linalg.inv(self.inverse_green(q, np.arange(len(q)), w))
        # Hermitian but for rounding
        outer_parts = w[:, None, None] * 0.5 * (green + green.conj().swapaxes(1, 2))
        top_parts = np.linalg.eigvalsh(outer_parts)
        point, branch = np.nonzero(top_parts > _FREE_TOP_PART)
        weight = np.asarray(top_parts[point, branch], float)
        return EdgeWaves(point, np.zeros(len(point), complex), weight)

    def find_leaky_waves(self, q: Array) -> EdgeWaves:
        """Return leaky waves within bands at q (n_q, p - 1): poles below narrow resonances of S +
        dw S' on the real axis.
        """
        resonances = self._choose_distinct(self._find_narrow_resonances(q))
        poles = self._find_poles(q, resonances)
        low, high = resonances.band
        is_in_band = (poles.real >= low) & (poles.real <= high)
        is_below_axis = poles.imag <= _POLE_NOISE * self.highest
        has_narrow_pole = poles.imag > -2.0 * _MOST_WIDTH * poles.real
        numbers = np.flatnonzero(is_in_band & is_below_axis & has_narrow_pole)
        numbers = numbers[self._sort_distinct(resonances.point[numbers], poles[numbers])]
        squares = poles[numbers].real + 1j * np.minimum(poles[numbers].imag, 0.0)
        return EdgeWaves(resonances.point[numbers], squares, resonances.weight[numbers])

    def _find_half_widths(self, resonances: _Resonances) -> Array:
        """Return the half widths (n,) in w of ``resonances``."""
        return np.abs(resonances.shift.imag + _BAND_BROADENING * self.highest)

    def _choose_distinct(self, resonances: _Resonances) -> _Resonances:
        """Return those of the ``resonances`` that may be leaky waves, and of many that lead to one
        pole only one.
        """
        half_widths = self._find_half_widths(resonances)
        # w = omega^2, so a relative width of w is twice that of omega
        is_narrow = half_widths < 2.0 * _MOST_WIDTH * resonances.w
        stays_in_band = resonances.last_step < np.inf
        is_on_top = resonances.weight > _TOP_PART
        numbers = np.flatnonzero(is_narrow & stays_in_band & is_on_top)
        roots = resonances.w[numbers] - 1j * half_widths[numbers]
        order = self._sort_distinct(resonances.point[numbers], roots, _RESONANCE_DISTANCE)
        return resonances.take(numbers[order])

    def _find_poles(self, q: Array, resonances: _Resonances) -> Complex:
        """Return the poles (n,) of S below ``resonances`` at q (n_q, p - 1); nan where the search
        finds none. A settled resonance without width is a pole on the real axis.
        """
        poles = resonances.w.astype(complex)
        half_widths = self._find_half_widths(resonances)
        noise = _POLE_NOISE * self.highest
        has_settled = resonances.last_step <= _NEWTON_TOLERANCE * resonances.w
        outer, inner, hop = self.blocks(q)
        for n in np.flatnonzero((half_widths > noise) | ~has_settled):
            start = complex(resonances.w[n], -max(half_widths[n], noise))
            point = resonances.point[n]
            poles[n] = self._find_pole(outer[point], inner[point], hop[point], start)
        return poles

    def _find_narrow_resonances(self, q: Array) -> _Resonances:
        """Return the narrow resonances at q (n_q, p - 1) to which Newton's method on the real axis
        leads from starts throughout the bands.
        """
        point, band = self._find_filled_intervals(q)
        # denser towards the edges of the bands
        parts = 0.5 * (1.0 - np.cos(np.pi * (np.arange(_LEAKY_STARTS) + 0.5) / _LEAKY_STARTS))
        start_w = (band[0] + (band[1] - band[0]) * parts[:, None]).ravel()
        point = np.tile(point, _LEAKY_STARTS)
        band = np.tile(band, _LEAKY_STARTS)
        offset = np.zeros((0, self.size), complex)
        if len(start_w):
            offset = self._find_resonances(q, point, start_w)[0]
        # a start leads to all resonances that are about as near as the next start
        reach = 2.0 * (band[1] - band[0]) / _LEAKY_STARTS
        is_close = np.abs(offset.real) <= reach[:, None]
        is_narrow = np.abs(offset.imag) < 2.0 * _MOST_WIDTH * start_w[:, None]
        start, resonance = np.nonzero(is_close & is_narrow)
        shift = offset[start, resonance]
        return self._follow_resonances(q, point[start], band[:, start], start_w[start], shift)

    def _follow_resonances(
        self, q: Array, point: Index, band: Array, start_w: Array, shift: Complex
    ) -> _Resonances:
        """Return the resonances to which Newton's method on the real axis leads from ``start_w``
        (n,) plus the real part of a first ``shift`` (n,).

        ``band`` (2, n) are the ends of the bands, at the wave vectors ``q[point]``. A resonance
        that leaves its band is followed no further.
        """
        count = len(start_w)
        shift = shift.copy()
        w = np.clip(start_w + shift.real, *band)
        weight = np.zeros(count)
        last_step = np.full(count, np.inf)
        numbers = np.arange(count)  # of the resonances that still change
        for _ in range(_SEARCH_STEPS):
            if not numbers.size:
                break
            offset, weights = self._find_resonances(q, point[numbers], w[numbers])
            nearest_entries = (np.arange(len(numbers)), np.argmin(np.abs(offset), axis=1))
            shift[numbers] = offset[nearest_entries]
            weight[numbers] = weights[nearest_entries]
            new_w = w[numbers] + shift[numbers].real
            is_inside = (new_w >= band[0, numbers]) & (new_w <= band[1, numbers])
            last_step[numbers] = np.where(is_inside, np.abs(shift[numbers].real), np.inf)
            w[numbers[is_inside]] = new_w[is_inside]
            is_large_step = last_step[numbers] > _NEWTON_TOLERANCE * w[numbers]
            numbers = numbers[is_inside & is_large_step]
        return _Resonances(point, band, w, shift, last_step, weight)

    def _find_resonances(self, q: Array, point: Index, w: Array) -> tuple[Complex, Array]:
        """Return dw (n, size) of the roots of S + dw S' at w (n,), and of each root the kinetic
        energy in the outer block over all, (n, size), at the wave vectors ``q[point]``.
        """
        highest = self.highest
        steps = _DIFFERENCE_STEP * highest * np.array([-1.0, 0.0, 1.0])
        real_w = (w + steps[:, None]).ravel()
        shifted_w = np.asarray(real_w + 1j * _BAND_BROADENING * highest, complex)
        inverse = self.inverse_green(q, np.tile(point, 3), shifted_w)
        low, middle, high = inverse.reshape(3, len(w), self.size, self.size)
        slope = (high - low) / (2.0 * _DIFFERENCE_STEP * highest)
        offsets, vectors = np.linalg.eig(np.linalg.solve(slope, -middle))
        # S' is the energy of the whole half space where the outer layers have the energy one: v^H
        # S' v of each vector v, of number b
        energy = np.abs(np.einsum("nab,nac,ncb->nb", vectors.conj(), slope, vectors))
        return offsets, np.sum(np.abs(vectors) ** 2, axis=1) / energy

    def _sort_distinct(self, point: Index, w: Complex, tolerance: float = 0.0) -> Index:
        """Return indices that sort w (n,) at each wave vector, of numbers ``point`` (n,), with one
        index for each set of equal w.

        Two w are equal if they differ by no more than ``tolerance`` times the lesser half width
        plus :data:`_POLE_TOLERANCE` times the highest w of the crystal.
        """
        order = np.lexsort((w.real, point))
        half_widths = -w[order].imag
        lesser_half_widths = np.minimum(half_widths[1:], half_widths[:-1])
        margin = tolerance * lesser_half_widths + _POLE_TOLERANCE * self.highest
        is_apart = np.abs(np.diff(w[order])) > margin
        is_new = np.ones(len(order), bool)
        is_new[1:] = (np.diff(point[order]) > 0) | is_apart
        return order[is_new]

    def _find_pole(self, outer: Complex, inner: Complex, hop: Complex, w: complex) -> complex:
        """Return the root of S near the start w, which is below the real axis; nan if the search
        finds none.

        The blocks ``outer``, ``inner`` and ``hop`` are E_0, E and A, (size, size). Each step of
        Newton's method begins just above the real axis, where the waves that decay from the edge
        are known, and follows these waves straight down to w. A step that leads to the axis or
        above ends the search, and its w is returned.
        """
        blocks = _EdgeBlocks(outer, inner, hop)
        half_width = -w.imag
        for _ in range(_NEWTON_STEPS):
            begin = complex(w.real, _BAND_BROADENING * self.highest)
            step = _LEAST_STEP * half_width
            descent = blocks.descend(begin, w, step)
            if descent is None:
                return complex(np.nan)
            inverse = blocks.inverse_green(w, descent.vectors)
            waves_beside = blocks.continue_waves(w + step, descent.factors)
            inverse_beside = blocks.inverse_green(w + step, waves_beside.vectors)
            slope = (inverse_beside - inverse) / step
            shifts = np.linalg.eigvals(np.linalg.solve(slope, -inverse))
            shift = shifts[np.argmin(np.abs(shifts))]
            w = w + shift
            tolerance = _NEWTON_TOLERANCE * half_width + _POLE_NOISE * self.highest
            has_settled = abs(shift) < tolerance
            if not w.imag < 0.0 or has_settled:
                return w
        return complex(np.nan)

    # -- contacts of the crystal -------------------------------------------------------------------

    def weighted_rows(self, q: Array, phases: Array) -> tuple[Complex, Array]:
        """Return |K|^1/2 C M^-1/2 (n, rows, size) of the contacts of one block of the crystal at q
        (p - 1,), and the signs (rows,) of K, which static forces may make negative.

        ``phases`` (n,), rad, are those of the wave from block to block. A contact that joins two
        blocks belongs to the one nearer to the edge.
        """
        size = self.size
        along = np.exp(2.0j * np.pi * (self._edge_steps @ q))
        coefficients = np.tensordot(along, self._matrix[:, self._is_in_second], 1)
        within_block = coefficients[:, size : 2 * size]
        to_next_block = coefficients[:, 2 * size :]
        deformations = within_block + np.exp(1.0j * phases)[:, None, None] * to_next_block
        stiffness = self._stiffness[self._is_in_second]
        rows = np.sqrt(np.abs(stiffness))[:, None] * deformations
        return np.asarray(rows, complex), np.asarray(np.sign(stiffness))

    # -- long waves --------------------------------------------------------------------------------

    def rayleigh_velocity(self, direction: Array) -> float:
        """Return the velocity, d (k/M)^1/2, of the long wave at a free edge along the unit vector
        ``direction`` (p - 1,), in the frame of the cut.

        It is the velocity v at which the surface impedance Z(v), which is Hermitian, is singular.
        Z is positive at v = 0, and falls with v up to a limit: the velocity at which a bulk wave
        first runs along the edge. Raises :class:`~granphon.base.errors.GranphonError` if Z is
        singular nowhere below this limit, and what :meth:`_find_continuum` raises.
        """
        from scipy.optimize import brentq, minimize_scalar

        medium = self._find_continuum(direction)
        slowest_course = float(_COURSES[np.argmin(medium.velocities_along(_COURSES))])
        step = _COURSES[1] - _COURSES[0]
        minimum = minimize_scalar(
            medium.velocities_along,
            bounds=(slowest_course - step, slowest_course + step),
            method="bounded",
            options={"xatol": 1e-12},
        )
        limit = float(minimum.fun)
        # the bracket leaves out zero, where the roots of an isotropic medium coincide, and the
        # limit, where a wave does not decay
        low = 1e-3 * limit
        high = (1.0 - 1e-9) * limit
        if not medium.find_impedance(low) * medium.find_impedance(high) < 0.0:
            raise GranphonError(
                "no long wave runs along this edge", mend="Choose another direction"
            )
        return float(brentq(medium.find_impedance, low, high, xtol=1e-15 * limit, rtol=1e-15))

    def _find_continuum(self, direction: Array) -> _EdgeContinuum:
        """Return the elastic continuum of the crystal, in the frame of the cut, for waves along the
        unit vector ``direction`` (p - 1,). Of a network in a plane, displacements out of that plane
        take no part.

        Raises :class:`~granphon.base.errors.InputError` for an edge that is held, for one period or
        balls that do not move along the edge and across it, for two periods that do not lie in the
        xy plane; and what :meth:`ContactLattice.require_rigid`, as for a mechanism, and
        :meth:`ContactLattice.gradient_stiffness` raise.
        """
        if self.edge != "free":
            raise InputError(
                f"the edge is held ({self.edge})",
                "Only a free edge has a long wave",
                "Take edge='free'",
            )
        lattice = ContactLattice.from_network(self.network)
        p = lattice.periods
        moves = lattice.motions.translations
        lattice.require_rigid()
        if p < 2:
            raise InputError(
                "the network repeats along one axis",
                "No wave runs along its edge",
                "Use a network with two or three periods",
            )
        moves_along_periods = set(range(p)) <= set(moves)
        if not moves_along_periods:
            raise InputError(
                "the balls do not move along the edge and across it", mend="Use other motions"
            )
        turn = self.layers.turn[:p, :p]
        # the lattice of a tilted network is turned into the xy plane, which the cut is not
        if not np.allclose(np.abs(np.linalg.det(turn)), 1.0):
            raise InputError(
                "the periods of the network do not lie along x, or in the xy plane", mend="Turn it"
            )
        displacements = [moves.index(axis) for axis in range(p)]
        along_periods = np.ix_(displacements, range(p), displacements, range(p))
        stiffness = lattice.gradient_stiffness()[along_periods] / lattice.measure
        # all four indices i, j, k, l are turned into the frame of the cut, a, b, c, d
        tensor = np.einsum("ai,bj,ck,dl,ijkl->abcd", turn, turn, turn, turn, stiffness)
        density = float(lattice.masses.sum()) / lattice.measure
        return _EdgeContinuum(tensor, density, np.append(direction, 0.0))


class _CutCrystal:
    """A crystal without an edge, changed by V in the two blocks that an edge parts, at wave vectors
    q (n_q, p - 1) along the edge.

    Waves of both edges are where M(w) = sign(V) - |V|^1/2 g |V|^1/2 is singular, g being the
    Green's function of the crystal, whose half space is ``space``. ``signs`` (n_q, 2 size) are
    those of the eigenvalues of V, and ``root`` (n_q, 2 size, 2 size) is |V|^1/2 in the basis of its
    eigenvectors. ``inner`` and ``hop`` (n_q, 2 size, 2 size) are the matrix of both blocks, and
    from these to the next two.
    """

    def __init__(self, space: HalfSpace, q: Array) -> None:
        """Make the blocks of the crystal, and the root of V, at wave vectors ``q``."""
        self.space = space
        outer, inner, hop = space.blocks(q)
        back = hop.conj().swapaxes(1, 2)
        zero = np.zeros_like(hop)
        # V: the cut takes the coupling away, and the lower block becomes the outer one
        change = np.block([[zero, -hop], [-back, outer - inner]])
        self.inner = np.block([[inner, hop], [back, inner]])
        self.hop = np.block([[zero, zero], [hop, zero]])
        strengths, basis = np.linalg.eigh(change)
        self.signs = np.where(strengths < 0.0, -1.0, 1.0)
        self.root = basis * np.sqrt(np.abs(strengths))[:, None]

    def find_matrices(self, point: Index, w: Array, gap: Array) -> tuple[Complex, Complex, Complex]:
        """Return M, its derivative by w, and the motions of both blocks, g |V|^1/2, all (n, 2 size,
        2 size), at w (n,) in gaps with the ends ``gap`` (2, n), at the wave vectors of numbers
        ``point`` (n,).
        """
        n_motions = self.inner.shape[1]  # those of both blocks
        distance_to_band = np.minimum(w - gap[0], gap[1] - w)
        distance_to_band = distance_to_band.clip(_GAP_MARGIN * (gap[1] - gap[0]))
        broadening = np.outer(_GAP_BROADENINGS, distance_to_band)  # (2, n)
        shifted_w = (w + 1j * broadening).ravel()
        points = np.tile(point, 2)
        _, inverse = self.space._eliminate(self.inner, self.inner, self.hop, points, shifted_w)
        green = np.linalg.inv(inverse).reshape(2, -1, n_motions, n_motions)
        adjoint = green.conj().swapaxes(2, 3)
        # g and dg/dw at the real w: the second broadening, twice the first, cancels second order
        even = 0.5 * (green + adjoint)
        odd = (green - adjoint) / (2j * broadening[:, :, None, None])
        real_green = (4.0 * even[0] - even[1]) / 3.0
        green_slope = (4.0 * odd[0] - odd[1]) / 3.0
        root = self.root[point]
        root_adjoint = root.conj().swapaxes(1, 2)
        motions = real_green @ root
        matrices = self.signs[point, None] * np.eye(n_motions) - root_adjoint @ motions
        slopes = -root_adjoint @ green_slope @ root
        return matrices, slopes, motions

    def eigenvalues(self, point: Index, w: Array, gap: Array) -> Array:
        """Return the eigenvalues (n, 2 size) of M, ascending; arguments are those of
        :meth:`find_matrices`.
        """
        matrices, _, _ = self.find_matrices(point, w, gap)
        return np.asarray(np.linalg.eigvalsh(matrices), float)


def _choose_side(
    matrix: Complex, motions_beyond: Complex, motions_on_top: Complex, count: int
) -> Complex:
    """Return the waves (m, 2 size) of this edge among ``count`` waves on which M, ``matrix``, is
    zero.

    ``motions_beyond`` and ``motions_on_top`` (size, 2 size) take a wave to its motions beyond the
    cut and on top. A wave of this edge moves nothing beyond the cut, and a wave of the edge beyond
    nothing on top: the degenerate waves are turned into those whose share of the motion on top is
    one or zero.
    """
    eigenvalues, vectors = np.linalg.eigh(matrix)
    null_numbers = np.argsort(np.abs(eigenvalues))[:count]
    null_vectors = vectors[:, null_numbers]
    null_on_top = motions_on_top @ null_vectors
    null_beyond = motions_beyond @ null_vectors
    top_metric = null_on_top.conj().T @ null_on_top
    whole_metric = top_metric + null_beyond.conj().T @ null_beyond
    # in the basis of the inverse factor the whole motion of each wave is one
    scale = np.linalg.inv(np.linalg.cholesky(whole_metric))
    share_on_top, turn = np.linalg.eigh(scale @ top_metric @ scale.conj().T)
    waves = (null_vectors @ scale.conj().T @ turn).T
    return np.asarray(waves[share_on_top > 0.5])


def _find_free_intervals(bands: Array, top: float) -> list[tuple[float, float]]:
    """Return the ends of the intervals of w from zero to ``top`` in which no band lies, from the
    ends (size, 2) of the bands.
    """
    ascending = bands[np.argsort(bands[:, 0])]
    # bands overlap: a gap begins at the highest end of all bands that begin below
    highest_so_far = np.maximum.accumulate(ascending[:, 1]).clip(0.0)
    low = np.concatenate([[0.0], highest_so_far])
    high = np.append(ascending[:, 0], top)
    is_gap = high - low > _LEAST_GAP * high
    return list(zip(low[is_gap], high[is_gap], strict=True))


def _find_complement(intervals: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the ends of the intervals of w, from zero on, that lie between the ``intervals``
    without a band.
    """
    bottoms = [0.0, *(high for _, high in intervals)]
    tops = [low for low, _ in intervals]
    # the last bottom, above all bands, has no top
    pairs = zip(bottoms, tops, strict=False)
    return [(bottom, top) for bottom, top in pairs if top - bottom > _LEAST_GAP * top]


def _find_minima(evaluate: Callable[[Array], Array], start: Array, reach: float) -> Array:
    """Return the least values (n,) of functions within ``reach`` of ``start`` (n,), by golden
    sections of all brackets together; ``evaluate`` returns the values (n,) at points (n,).
    """
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    low = start - reach
    high = start + reach
    minimum = evaluate(start)
    # two points (2, n) within each bracket, and the values there
    x = np.stack([high - golden * (high - low), low + golden * (high - low)])
    f = [evaluate(points) for points in x]
    for _ in range(_SECTIONS):
        # the minimum is on the side of the lower value, whose point becomes one of the next two
        is_lower = f[0] < f[1]
        low = np.where(is_lower, low, x[0])
        high = np.where(is_lower, x[1], high)
        new_x = np.where(is_lower, high - golden * (high - low), low + golden * (high - low))
        new_f = evaluate(new_x)
        x = np.where(is_lower, [new_x, x[0]], [x[1], new_x])
        f = [np.where(is_lower, new_f, f[1]), np.where(is_lower, f[0], new_f)]
        minimum = np.minimum(minimum, new_f)
    return minimum


def _find_roots(evaluate: Callable[[Index, Array], Array], ends: Array, values: Array) -> Array:
    """Return the roots (n,) of functions that rise from below zero to above it, between ``ends``
    (2, n), at which they have ``values`` (2, n).

    ``evaluate`` returns the values (m,) of some of the functions, by their numbers (m,), at points
    (m,). The steps are those of false position with the weights of the Illinois rule, and a
    bisection at every third step.
    """
    low, high = ends.copy()
    f_low, f_high = values
    n = len(low)
    roots = np.zeros(n)
    last_side = np.zeros(n)  # 1 if the last point was above the root, else -1
    numbers = np.arange(n)  # of the functions whose brackets are not yet narrow
    for step in range(_SECTIONS * 3):
        if not numbers.size:
            break
        a = low[numbers]
        b = high[numbers]
        fa = f_low[numbers]
        fb = f_high[numbers]
        is_bisection = step % 3 == 2
        trial = 0.5 * (a + b) if is_bisection else (a * fb - b * fa) / (fb - fa)
        x = np.clip(trial, a, b)
        value = evaluate(numbers, x)
        is_above = value > 0.0
        side = np.where(is_above, 1.0, -1.0)
        # an end that stays twice counts half
        weight = np.where(side == last_side[numbers], 0.5, 1.0)
        high[numbers] = np.where(is_above, x, b)
        low[numbers] = np.where(is_above, a, x)
        f_high[numbers] = np.where(is_above, value, weight * fb)
        f_low[numbers] = np.where(is_above, weight * fa, value)
        last_side[numbers] = side
        roots[numbers] = x
        is_wide = high[numbers] - low[numbers] > _ROOT_TOLERANCE * x
        numbers = numbers[is_wide & (value != 0.0)]
    return roots


class _Decay(NamedTuple):
    """Waves that decay from the edge at one w.

    Attributes
    ----------
    factors : (size,) by which they change from block to block.
    distances : (size,) of each factor from those of all other waves.
    vectors : (2 size, size) motions of two blocks.
    """

    factors: Complex
    distances: Array
    vectors: Complex


def make_pencil(inner: Complex, hop: Complex, w: complex) -> tuple[Complex, Complex]:
    """Return the two matrices (2 size, 2 size) of the generalised eigenproblem of the waves at w:
    the eigenvalues are the factors from block to block, and the vectors the motions of two blocks.
    The blocks ``inner`` E and ``hop`` A are (size, size).
    """
    eye = np.eye(len(inner))
    zeros = np.zeros_like(eye)
    # motions u of three blocks: A^H u_1 + (E - w) u_2 + A u_3 = 0, with the factor from u_1 to u_2
    # and from u_2 to u_3
    left = np.block([[zeros, eye], [-hop.conj().T, w * eye - inner]])
    right = np.block([[eye, zeros], [zeros, hop]])
    return left, right


class _EdgeBlocks(NamedTuple):
    """The blocks E_0, E and A (size, size) of a half space at one wave vector.

    Waves that go from the edge take the motions of a block, times L, to the next: S = w - E_0 - A
    L. Above the real axis these are the waves that decay. On the way down they stay the same waves
    as long as each of their factors, the eigenvalues of L, moves by less than its distance from the
    factors of all other waves.
    """

    outer: Complex
    inner: Complex
    hop: Complex

    def inverse_green(self, w: complex, vectors: Complex) -> Complex:
        """Return S (size, size) at w from the waves that go from the edge: their motions of two
        blocks, ``vectors`` (2 size, size).
        """
        size = len(self.outer)
        part_of_crystal = self.hop @ vectors[size:] @ np.linalg.inv(vectors[:size])
        return w * np.eye(size) - self.outer - part_of_crystal

    def continue_waves(self, w: complex, earlier_factors: Complex | None = None) -> _Decay:
        """Return the waves at w whose factors continue ``earlier_factors`` (size,); without these,
        the waves that decay fastest.
        """
        from scipy.linalg import ordqz
        from scipy.optimize import linear_sum_assignment

        size = len(self.outer)
        choices = list[tuple[Complex, Array]]()

        def choose(alpha: Any, beta: Any) -> Any:
            """Return which waves (2 size,), of factors alpha/beta, are chosen; keep their factors,
            in the order of the ``earlier_factors``, and their distances from the other factors.
            """
            factors = np.full(2 * size, _LARGEST_FACTOR, complex)
            np.divide(
                alpha, beta, out=factors, where=np.abs(alpha) < _LARGEST_FACTOR * np.abs(beta)
            )
            costs = np.tile(np.abs(factors), (size, 1))
            if earlier_factors is not None:
                costs = np.abs(factors - earlier_factors[:, None])
            columns = linear_sum_assignment(costs)[1]
            is_chosen = np.isin(np.arange(2 * size), columns)
            distances = np.abs(factors[columns, None] - factors[~is_chosen])
            choices.append((factors[columns], np.min(distances, axis=1)))
            return is_chosen

        left, right = make_pencil(self.inner, self.hop, w)
        schur_vectors = ordqz(left, right, choose, "complex")[5]
        # SciPy calls ``choose`` once, and LAPACK gets the flags alone; the factors that ``ordqz``
        # returns have an order of their own
        factors, distances = choices[0]
        return _Decay(factors, distances, np.asarray(schur_vectors[:, :size], complex))

    def descend(self, begin: complex, end: complex, least_step: float) -> _Decay | None:
        """Return the waves that decay at ``begin``, above the real axis, continued straight down to
        ``end``; None if a step shorter than ``least_step`` still loses them.
        """
        position = begin
        decay = self.continue_waves(position)
        step = end.imag - position.imag  # below zero, as all steps are
        while position.imag > end.imag:
            step = max(step, end.imag - position.imag)
            trial = self.continue_waves(position + 1j * step, decay.factors)
            largest_moves = _LARGEST_MOVE * np.minimum(trial.distances, decay.distances)
            are_same_waves = np.all(np.abs(trial.factors - decay.factors) <= largest_moves)
            if are_same_waves:
                decay = trial
                position = position + 1j * step
                step = 2.0 * step
            elif step > -least_step:
                return None
            else:
                step *= 0.5
        return decay


class _EdgeContinuum(NamedTuple):
    """An elastic continuum below an edge, in reduced units: the stiffness ``tensor`` (p, p, p, p),
    the ``density``, and the unit vector ``along`` (p,) of the waves; the last axis is across the
    edge.
    """

    tensor: Array
    density: float
    along: Array

    @property
    def normal(self) -> Array:
        """The direction (p,) across the edge."""
        return np.asarray(np.eye(len(self.along))[-1])

    def velocities_along(self, angle: Any) -> Any:
        """Return the velocity along the edge (...), d (k/M)^1/2, of the slowest bulk wave that runs
        at an ``angle`` (...) to the edge, rad.
        """
        course = np.cos(angle)[..., None] * self.along + np.sin(angle)[..., None] * self.normal
        # the acoustic tensor c_ijkl n_j n_l of the course n
        acoustic = np.einsum("ijkl,...j,...l->...ik", self.tensor, course, course)
        squared_velocities = np.linalg.eigvalsh(acoustic)[..., 0] / self.density
        return np.sqrt(np.maximum(squared_velocities, 0.0)) / np.cos(angle)

    def find_impedance(self, velocity: float) -> float:
        """Return the lowest eigenvalue, k d^(2-p), of the surface impedance of waves of a
        ``velocity``, d (k/M)^1/2, along the edge. The velocity is above zero, and below the
        velocities along the edge of all bulk waves (:meth:`velocities_along`).

        The impedance is the matrix that takes displacements of the edge to tractions, over the
        wavenumber q. Displacements are a exp(i q (m + z n).x), m along the edge and n across it,
        with those roots z of Stroh's system that decay below the edge.
        """
        size = len(self.along)
        # Q, R and T of Stroh's formalism, without inertia: sums over the components j and l
        along_along = np.einsum("ijkl,j,l->ik", self.tensor, self.along, self.along)
        along_normal = np.einsum("ijkl,j,l->ik", self.tensor, self.along, self.normal)
        normal_normal = np.einsum("ijkl,j,l->ik", self.tensor, self.normal, self.normal)
        inverse = np.linalg.inv(normal_normal)
        dynamic_form = along_along - self.density * velocity * velocity * np.eye(size)
        coupling = along_normal @ inverse @ along_normal.T - dynamic_form
        system = np.block(
            [[-inverse @ along_normal.T, inverse], [coupling, -along_normal @ inverse]]
        )
        roots, vectors = np.linalg.eig(system)
        # half of the roots have an imaginary part above zero, and half below
        decaying_numbers = np.argsort(-roots.imag)[:size]
        displacements = vectors[:size, decaying_numbers]
        tractions = vectors[size:, decaying_numbers]
        impedance = -1j * tractions @ np.linalg.inv(displacements)
        # the impedance at such velocities is Hermitian but for rounding
        hermitian_part = 0.5 * (impedance + impedance.conj().T)
        return float(np.linalg.eigvalsh(hermitian_part)[0])
