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
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import GranphonError, InputError
from granphon.base.validation import real_array
from granphon.dynamics.bloch_waves import Couplings
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.rows import network_rows, push_rows
from granphon.networks.network import ContactNetwork

#: the elimination of layers ends where the coupling that is left, over the largest block, is below
#: this
_COUPLING_TOLERANCE = 1e-17
#: doublings of the number of eliminated layers, at most
_MOST_DOUBLINGS = 60
#: entries of blocks that are inverted in one call
_CHUNK = 2**20
#: wave numbers across the edge on which the edges of bands are bracketed
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
#: relative width of a gap up to which two bands count as touching
_LEAST_GAP = 1e-7
#: margin at both edges of a gap, over its width, in which no wave is sought
_GAP_MARGIN = 1e-9
#: w, over the lowest band, up to which a motion costs no energy
_FREE_IN_GAP = 1e-6
#: eigenvalue of M at an end of a gap, over the largest there, up to which its sign is that of
#: rounding
_UNSIGNED = 1e-14
#: waves closer than this in w, over the width of the gap, are one degenerate set
_DEGENERACY = 1e-9
#: relative tolerance of w of an edge wave
_ROOT_TOLERANCE = 1e-14
#: starts in a band for the search of leaky waves
_LEAKY_STARTS = 48
#: steps of Newton's method for a leaky wave, at most: on the real axis, and for its pole
_SEARCH_STEPS = 8
_NEWTON_STEPS = 12
#: relative change of w at which they end
_NEWTON_TOLERANCE = 1e-8
#: phases from layer to layer at which Zak phases and windings are summed
_WINDING_PHASES = 256
#: determinant, over the product of the norms of its rows, and gap in w, over the highest w, that
#: count as zero
_SINGULAR = 1e-12
#: least overlap of branches from one phase to the next at which their gap counts as open
_OPEN = 0.5
#: phase that is zero but for rounding, rad
_NO_PHASE = 1e-9
#: -w, over the highest w, at which edge motions without energy are told from others
_FREE_SHIFT = 1e-10
#: part of the energy of such a motion in the top layer, at least
_FREE_TOP_PART = 1e-3
#: distance of two resonances, over the lesser half width, up to which both lead to one pole
_SAME_POLE = 0.5
#: motion of a factor of a wave, over what parts it from those of other waves, up to which it counts
#: as the same wave
_MOST_MOVED = 0.25
#: least step below the real axis, and step of a difference, over the half width
_LEAST_STEP = 1e-4
#: error of w of a pole, over the highest w
_POLE_NOISE = 1e-12
#: factor from block to block that stands for all larger ones
_FAR = 1e3
#: half width over frequency up to which a resonance counts as a leaky wave
_MOST_WIDTH = 0.05
#: part of the energy of a leaky wave in the top layer, at least
_TOP_PART = 0.02


class EdgeWaves(NamedTuple):
    """Waves of an edge: the number ``point`` of the wave vector, w = omega^2 (complex where they
    leak), and the energy on top.
    """

    point: Index
    squares: Complex
    weight: Array


class HalfSpace:
    """The half space of a network's layers above which there is an edge, in the reduced units of
    the network.

    ``edge`` is how it is held, as for :meth:`ContactNetwork.cut`; the layers go on from its lower
    face.
    """

    def __init__(self, network: ContactNetwork, axis: Any, edge: str = "free") -> None:
        self.network = network
        self.edge = edge
        self.units = network.scales
        self.layers = network.layers_across(axis)
        periods = np.flatnonzero(network.pbc)
        p = len(self.layers.cell)
        d = network.dimension
        _, shift = self.layers.gather(
            network.positions[:, :d],
            network.i,
            network.j,
            network.shift[:, periods],
            np.isinf(network.radii),
        )
        self.reach = reach = int(np.max(np.abs(self.layers.split(shift)[1]), initial=0))
        if not reach:
            raise InputError(
                "no contact joins the layers",
                "Each would have its own waves",
                "Choose another axis",
            )
        self.cut = cut = network.cut(axis, 4 * reach + 1 + (edge == "clamped"), (edge, "free"))
        units = self.units
        moving = cut.moving
        self.motions = cut.ball_motions
        self.per_layer = int(np.count_nonzero(network.moving))
        self.size = reach * self.per_layer * self.motions.count
        rows = network_rows(cut)
        stiff = [row.stiffness / units.stiffness for row in rows]
        if cut.prestress:
            if cut.tangential_force is not None and np.any(cut.tangential_force):
                raise InputError(
                    "the network has static tangential forces",
                    "With prestress, they have no potential",
                )
            pushes = push_rows(cut.normal[:, :d], self.motions)
            rows += pushes
            stiff += [-cut.normal_force / cut.distance / units.stiffness] * len(pushes)
        # C(q) is the sum over steps s along the edge of C_s exp(i q.s), with tails at s = 0. The
        # contacts kept are those of the two outer blocks, which reach into a third
        number = np.where(moving, np.cumsum(moving) - 1, np.count_nonzero(moving))
        lower = np.minimum(number[cut.i], number[cut.j]) // (reach * self.per_layer)
        kept = np.flatnonzero(lower < 2)
        steps, of_step = np.unique(
            np.pad(cut.shift[kept], ((1, 0), (0, 0))), axis=0, return_inverse=True
        )
        self._steps = steps[:, :p]
        count = self.motions.count
        root = 1.0 / np.sqrt(np.where(moving, cut.masses / units.mass, np.inf))
        matrix = np.zeros((len(steps), len(rows), len(kept), int(number.max()) + 1, count))
        for n, row in enumerate(rows):
            for coefficients, end, step in (
                (-row.tail, cut.i, of_step.ravel()[0]),
                (row.head, cut.j, of_step.ravel()[1:]),
            ):
                ball = end[kept]
                effect = coefficients[kept] * root[ball][:, None]
                matrix[step, n, np.arange(len(kept)), number[ball]] += effect
        columns = 3 * self.size // count
        self._matrix: Array = matrix[:, :, :, :columns].reshape(len(steps), -1, 3 * self.size)
        self._stiff: Array = np.concatenate([stiffness[kept] for stiffness in stiff])
        upper = np.maximum(number[cut.i], number[cut.j]) // (reach * self.per_layer)
        crosses = (lower == 0) & (upper == 1) & moving[cut.i] & moving[cut.j]
        self._second: Array = np.tile(lower[kept] == 1, len(rows))
        self._crossing: Array = np.tile(crosses[kept], len(rows))
        self._kept = kept
        self._kinds = [row.kind for row in rows]

    def blocks(self, q: Array) -> tuple[Complex, Complex, Complex]:
        """Return E_0, E and A, (n_q, size, size), at wave vectors q (n_q, p - 1) in fractions of
        the reciprocal cell.
        """
        size = self.size
        phase = np.exp(2.0j * np.pi * (q @ self._steps.T))
        rows: Complex = np.asarray(np.tensordot(phase, self._matrix[:, :, : 2 * size], 1), complex)
        matrices = rows.conj().swapaxes(1, 2) @ (self._stiff[:, None] * rows)
        return matrices[:, :size, :size], matrices[:, size:, size:], matrices[:, :size, size:]

    def couplings(self, q: Array, elongation: Any = 1.0, other: Any = 1.0) -> Couplings:
        """Return the blocks at one wave vector q (p - 1,); contacts of :attr:`cut` are as many
        times as stiff.

        The factors, of elongation and of all other deformations, are numbers or (n_f, n_c), complex
        where energy is lost.
        """
        size = self.size
        phase = np.exp(2.0j * np.pi * (self._steps @ q))
        rows = np.asarray(np.tensordot(phase, self._matrix[:, :, : 2 * size], 1), complex)
        weights = self._stiff
        if np.ndim(elongation):
            factors = {"elongation": elongation, "push": np.ones_like(elongation)}
            weights = weights * np.concatenate(
                [factors.get(kind, other)[:, self._kept] for kind in self._kinds], axis=1
            )
        full = rows.conj().T @ (weights[..., None] * rows)
        crossing = rows[self._crossing]
        cross = crossing.conj().T @ (weights[..., self._crossing, None] * crossing)
        return Couplings(
            full[..., size:, size:],
            cross[..., :size, :size],
            cross[..., size:, size:],
            full[..., :size, size:],
            full[..., size:, :size],
        )

    def read_wavevector(self, q: ArrayLike) -> Array:
        """Return one wave vector along the edge (p - 1,), zero if () is given; raises InputError
        for another shape.
        """
        p = len(self.layers.cell)
        fractions = real_array("q", q)
        if fractions.shape not in ((p,), (0,)) or not np.all(np.isfinite(fractions)):
            raise InputError(
                f"q has the shape {fractions.shape}",
                mend=f"Give ({p},) fractions, along the layers",
            )
        return fractions if fractions.size else np.zeros(p)

    def wavenumbers(self, factors: Complex, q: Array) -> Complex:
        """Return wave numbers across the edge, 1/m, of motions that change by ``factors`` from
        layer to layer.

        Real parts are within half of the period 2 pi over a layer's height. The wave vector along
        the edge is q (p - 1,).
        """
        p = len(q)
        beside = np.linalg.solve(self.layers.cell[:, :p].T, self.layers.stack[:p]) @ q
        real = (np.angle(factors) / (2.0 * np.pi) - beside + 0.5) % 1.0 - 0.5
        return (2.0 * np.pi * real - 1j * np.log(np.abs(factors))) / self.height

    @property
    def height(self) -> float:
        """Height of a layer, m."""
        return float(self.layers.stack[len(self.layers.cell)])

    @cached_property
    def highest(self) -> float:
        """A bound of all squared frequencies, k/M."""
        rows = np.abs(self._matrix).sum(axis=0)
        return float((rows.T @ (np.abs(self._stiff) * rows.sum(axis=1))).max())

    def _eliminate(
        self, outer: Complex, inner: Complex, hop: Complex, point: Index, w: Complex
    ) -> tuple[Complex, Complex]:
        """Return w - F of the outer block, and of a block with blocks on both sides, (n, m, m), at
        the wave vectors ``point`` (n,) of the blocks.
        """
        size = outer.shape[1]
        surface = np.empty((len(w), size, size), complex)
        bulk = np.empty((len(w), size, size), complex)
        together = max(1, _CHUNK // (12 * size**2))
        for first in range(0, len(w), together):
            chunk = slice(first, first + together)
            numbers = point[chunk]
            shift = w[chunk, None, None] * np.eye(size)
            top = outer[numbers].copy()
            middle = inner[numbers].copy()
            down = hop[numbers]
            pair = np.concatenate([down, down.conj().swapaxes(1, 2)], axis=1)  # A on top of B
            going = np.arange(len(numbers))
            for _ in range(_MOST_DOUBLINGS):
                side_by_side = np.concatenate([pair[:, :size], pair[:, size:]], axis=2)
                products = pair @ np.linalg.solve(shift[going] - middle[going], side_by_side)
                through = products[:, :size, size:]  # A g B
                back = products[:, size:, :size]  # B g A
                top[going] += through
                middle[going] += through + back
                next_down = products[:, :size, :size]  # A g A
                next_up = products[:, size:, size:]  # B g B
                change = np.max(np.abs(through) + np.abs(back), axis=(1, 2))
                is_coupled = change > _COUPLING_TOLERANCE * self.highest
                going = going[is_coupled]
                pair = np.concatenate([next_down, next_up], axis=1)[is_coupled]
                if not going.size:
                    break
            surface[chunk] = shift - top
            bulk[chunk] = shift - middle
        return surface, bulk

    def inverse_green(self, q: Array, point: Index, w: Complex) -> Complex:
        """Return S = w - F of the outer layers, (n, size, size), at wave vectors ``q[point]`` and w
        (n,).
        """
        return self._eliminate(*self.blocks(q), point, w)[0]

    def bands(self, q: Array) -> Array:
        """Return the lowest and the highest w (n_q, size, 2) of each branch at q (n_q, p - 1), over
        all across the edge.
        """
        _, inner, hop = self.blocks(q)

        def solve(point: Index, angle: Array) -> Array:
            turned = hop[point] * np.exp(1j * angle)[:, None, None]
            return np.linalg.eigvalsh(inner[point] + turned + turned.conj().swapaxes(1, 2))

        n = len(q)
        size = self.size
        grid = 2.0 * np.pi * np.arange(_BAND_SAMPLES) / _BAND_SAMPLES
        samples = solve(np.repeat(np.arange(n), _BAND_SAMPLES), np.tile(grid, n))
        samples = samples.reshape(n, _BAND_SAMPLES, size)
        sign = np.array([1.0, -1.0])
        start = grid[np.argmin(samples[..., None] * sign, axis=1)].reshape(-1)  # (n, size, 2)
        points = np.repeat(np.arange(n), 2 * size)
        branch = np.tile(np.repeat(np.arange(size), 2), n)
        signs = np.tile(sign, n * size)

        def evaluate(angle: Array) -> Array:
            return np.asarray(signs * solve(points, angle)[np.arange(len(points)), branch])

        # the golden section of all brackets together; f is +-w at two inner angles x
        golden = 0.5 * (math.sqrt(5.0) - 1.0)
        step = 2.0 * np.pi / _BAND_SAMPLES
        low = start - step
        high = start + step
        best = evaluate(start)
        x = np.stack([high - golden * (high - low), low + golden * (high - low)])
        f = [evaluate(angle) for angle in x]
        for _ in range(_SECTIONS):
            is_lower = f[0] < f[1]
            low = np.where(is_lower, low, x[0])
            high = np.where(is_lower, x[1], high)
            new_x = np.where(is_lower, high - golden * (high - low), low + golden * (high - low))
            new_f = evaluate(new_x)
            x = np.where(is_lower, [new_x, x[0]], [x[1], new_x])
            f = [np.where(is_lower, new_f, f[1]), np.where(is_lower, f[0], new_f)]
            best = np.minimum(best, new_f)
        return (signs * best).reshape(n, size, 2)

    # -- waves of the edge -------------------------------------------------------------------------

    def _find_gaps(self, q: Array, inside: bool = False) -> tuple[Index, Array]:
        """Return intervals of w without a band, or those inside of bands: the wave vector of each,
        and (2, n) its ends.
        """
        points = []
        ends = []
        for point, bands in enumerate(self.bands(q)):
            ascending = bands[np.argsort(bands[:, 0])]
            below = np.concatenate([[0.0], np.maximum.accumulate(ascending[:, 1]).clip(0.0)])
            above = np.append(ascending[:, 0], 1.01 * self.highest)
            clear = above - below > _LEAST_GAP * above
            intervals = list(zip(below[clear], above[clear], strict=True))
            if inside:
                bottoms = [0.0, *(high for _, high in intervals)]
                tops = [low for low, _ in intervals]
                intervals = [
                    (bottom, top)
                    for bottom, top in zip(bottoms, tops, strict=False)
                    if top - bottom > _LEAST_GAP * top
                ]
            points += [point] * len(intervals)
            ends += intervals
        low, high = np.array(ends).reshape(-1, 2).T
        margin = _GAP_MARGIN * (high - low)
        # motions that cost nothing are no waves
        low = np.maximum(low + margin, _FREE_IN_GAP * high)
        return np.array(points, np.intp), np.stack([low, high - margin])

    def find_waves(self, q: Array) -> EdgeWaves:
        """Find all waves of the edge outside of the bands, at wave vectors q (n_q, p - 1).

        The half space is a crystal without an edge, changed by V in the two blocks that an edge
        parts. Waves of both edges are where M(w) = sign(V) - |V|^1/2 g |V|^1/2 is singular, g being
        the Green's function of the crystal. In a gap M is smooth and its eigenvalues rise, so that
        each has one zero if its sign changes over the gap, and none otherwise.
        """
        outer, inner, hop = self.blocks(q)
        size = self.size
        back = hop.conj().swapaxes(1, 2)
        none = np.zeros_like(hop)
        change = np.block([[none, -hop], [-back, outer - inner]])
        block = np.block([[inner, hop], [back, inner]])
        across = np.block([[none, none], [hop, none]])
        strength, basis = np.linalg.eigh(change)
        signs = np.where(strength < 0.0, -1.0, 1.0)
        root = basis * np.sqrt(np.abs(strength))[:, None]

        def find(point: Index, w: Array, gap: Array) -> tuple[Complex, Complex, Complex]:
            """Return M, its derivative by w, and the motions of both blocks, g |V|^1/2."""
            nearest = np.minimum(w - gap[0], gap[1] - w).clip(_GAP_MARGIN * (gap[1] - gap[0]))
            aside = np.outer(_GAP_BROADENINGS, nearest)
            shifted = (w + 1j * aside).ravel()
            inverse = self._eliminate(block, block, across, np.tile(point, 2), shifted)[1]
            green = np.linalg.inv(inverse).reshape(2, -1, 2 * size, 2 * size)
            adjoint = green.conj().swapaxes(2, 3)
            even = 0.5 * (green + adjoint)
            odd = (green - adjoint) / (2j * aside[:, :, None, None])
            level = (4.0 * even[0] - even[1]) / 3.0
            slope = (4.0 * odd[0] - odd[1]) / 3.0
            root_adjoint = root[point].conj().swapaxes(1, 2)
            moved = level @ root[point]
            matrices = signs[point, None] * np.eye(2 * size) - root_adjoint @ moved
            return matrices, -root_adjoint @ slope @ root[point], moved

        def rising(point: Index, w: Array, gap: Array) -> Array:
            return np.asarray(np.linalg.eigvalsh(find(point, w, gap)[0]), float)

        point, gap = self._find_gaps(q)
        ends = np.stack([rising(point, end, gap) for end in gap])
        # zeros at the very ends, beside the poles of g, have no sign
        rounded = _UNSIGNED * np.max(np.abs(ends), axis=2, keepdims=True)
        row, branch = np.nonzero((ends[0] < -rounded[0]) & (ends[1] > rounded[1]))
        point = point[row]
        gap = gap[:, row]
        if not row.size:
            return EdgeWaves(point, np.zeros(0, complex), np.zeros(0))
        low, high = gap.copy()
        f_low, f_high = ends[:, row, branch]
        going = np.arange(len(row))
        w = np.zeros(len(row))
        side = np.zeros(len(row))
        for step in range(_SECTIONS * 3):
            if not going.size:
                break
            # false position with the weights of the Illinois rule, and a bisection at every third
            # step
            a = low[going]
            b = high[going]
            fa = f_low[going]
            fb = f_high[going]
            x = 0.5 * (a + b) if step % 3 == 2 else (a * fb - b * fa) / (fb - fa)
            x = np.clip(x, a, b)
            value = rising(point[going], x, gap[:, going])[np.arange(len(going)), branch[going]]
            up = value > 0.0
            again = np.where(up, 1.0, -1.0) == side[going]
            high[going] = np.where(up, x, b)
            low[going] = np.where(up, a, x)
            f_high[going] = np.where(up, value, np.where(again, 0.5 * fb, fb))
            f_low[going] = np.where(up, np.where(again, 0.5 * fa, fa), value)
            side[going] = np.where(up, 1.0, -1.0)
            w[going] = x
            going = going[(high[going] - low[going] > _ROOT_TOLERANCE * x) & (value != 0.0)]
        return self._sort_sides(find, point, w, gap)

    def _sort_sides(self, find: Any, point: Index, w: Array, gap: Array) -> EdgeWaves:
        """Return the waves of this edge, not of the edge beyond the cut, with their energy on
        top.
        """
        size = self.size
        waves = []
        order = np.lexsort((w, point))
        is_apart = np.diff(w[order]) > _DEGENERACY * (gap[1] - gap[0])[order][1:]
        is_new = np.ones(len(w), bool)
        is_new[1:] = (np.diff(point[order]) > 0) | is_apart
        for members in np.split(order, np.flatnonzero(is_new)[1:]):
            number = point[members[:1]]
            mean = np.mean(w[members])
            (matrix,), (slope,), (moved,) = find(number, np.array([mean]), gap[:, members[:1]])
            values, vectors = np.linalg.eigh(matrix)
            free = vectors[:, np.argsort(np.abs(values))[: len(members)]]
            # a wave of this edge moves nothing beyond the cut
            on_top = moved[size:] @ free
            beyond = moved[:size] @ free
            top = on_top.conj().T @ on_top
            scale = np.linalg.inv(np.linalg.cholesky(top + beyond.conj().T @ beyond))
            share, turned = np.linalg.eigh(scale @ top @ scale.conj().T)
            for wave in (free @ scale.conj().T @ turned).T[share > 0.5]:
                energy = float((wave.conj() @ slope @ wave).real)
                top_energy = float(np.sum(np.abs(moved[size:] @ wave) ** 2))
                waves.append((number[0], mean, top_energy / energy))
        table = np.array(waves).reshape(-1, 3)
        return EdgeWaves(table[:, 0].astype(np.intp), table[:, 1].astype(complex), table[:, 2])

    def find_free_motions(self, q: Array) -> EdgeWaves:
        """Find motions of the outer layers that cost nothing at q (n_q, p - 1), by the part of
        their energy on top.

        Towards w = 0 from below, -w times the Green's function becomes the matrix of the outer
        parts of all such motions, whose eigenvalues are these parts; others go as w, or as its root
        where a band reaches zero.
        """
        w = np.full(len(q), -_FREE_SHIFT * self.highest, complex)
        green = np.linalg.inv(self.inverse_green(q, np.arange(len(q)), w))
        parts = np.linalg.eigvalsh(w[:, None, None] * 0.5 * (green + green.conj().swapaxes(1, 2)))
        point, branch = np.nonzero(parts > _FREE_TOP_PART)
        weight = np.asarray(parts[point, branch], float)
        return EdgeWaves(point, np.zeros(len(point), complex), weight)

    def find_leaky_waves(self, q: Array) -> EdgeWaves:
        """Find leaky waves within bands at q (n_q, p - 1): poles below narrow resonances of S + dw
        S' on the real axis.
        """
        point, gap = self._find_gaps(q, inside=True)
        steps = _DIFFERENCE_STEP * self.highest * np.array([-1.0, 0.0, 1.0])
        top = self.highest

        def solve(point: Index, w: Array) -> tuple[Complex, Array]:
            """Return dw (n, size) of the resonances of S + dw S' at w, and their energy on top."""
            real = (w + steps[:, None]).ravel()
            shifted = np.asarray(real + 1j * _BAND_BROADENING * top, complex)
            inverse = self.inverse_green(q, np.tile(point, 3), shifted)
            low, middle, high = inverse.reshape(3, len(w), self.size, self.size)
            slope = (high - low) / (2.0 * _DIFFERENCE_STEP * top)
            values, vectors = np.linalg.eig(np.linalg.solve(slope, -middle))
            norm = np.abs(np.einsum("nab,nac,ncb->nb", vectors.conj(), slope, vectors))
            return values, np.sum(np.abs(vectors) ** 2, axis=1) / norm

        # denser towards the edges of the bands
        starts = 0.5 * (1.0 - np.cos(np.pi * (np.arange(_LEAKY_STARTS) + 0.5) / _LEAKY_STARTS))
        x = (gap[0] + (gap[1] - gap[0]) * starts[:, None]).ravel()
        point = np.tile(point, _LEAKY_STARTS)
        gap = np.tile(gap, _LEAKY_STARTS)
        reach = 2.0 * (gap[1] - gap[0]) / _LEAKY_STARTS
        offset = solve(point, x)[0] if len(x) else np.zeros((0, self.size), complex)
        close = np.abs(offset.real) <= reach[:, None]
        row, column = np.nonzero(close & (np.abs(offset.imag) < 2.0 * _MOST_WIDTH * x[:, None]))
        point = point[row]
        gap = gap[:, row]
        shift = offset[row, column]
        w = np.clip(x[row] + shift.real, *gap)
        weight = np.zeros(len(row))
        size = np.full(len(row), np.inf)
        going = np.arange(len(row))
        for _ in range(_SEARCH_STEPS):
            if not going.size:
                break
            offset, weights = solve(point[going], w[going])
            best = np.argmin(np.abs(offset), axis=1)
            shift[going] = offset[np.arange(len(going)), best]
            weight[going] = weights[np.arange(len(going)), best]
            moved = w[going] + shift[going].real
            inside = (moved >= gap[0, going]) & (moved <= gap[1, going])
            size[going] = np.where(inside, np.abs(shift[going].real), np.inf)
            w[going[inside]] = moved[inside]
            going = going[inside & (size[going] > _NEWTON_TOLERANCE * w[going])]
        depth = np.abs(shift.imag + _BAND_BROADENING * top)
        least = _POLE_NOISE * top
        kept = np.flatnonzero(
            (depth < 2.0 * _MOST_WIDTH * w) & (size < np.inf) & (weight > _TOP_PART)
        )
        # many resonances lead to one pole
        kept = kept[self._find_different(point[kept], w[kept] - 1j * depth[kept], _SAME_POLE)]
        poles = w[kept].astype(complex)
        blocks = self.blocks(q)
        for number, chosen in enumerate(kept):
            if depth[chosen] > least or size[chosen] > _NEWTON_TOLERANCE * w[chosen]:
                outer, inner, hop = (block[point[chosen]] for block in blocks)
                start = complex(w[chosen], -max(depth[chosen], least))
                poles[number] = self._find_pole(outer, inner, hop, start)
        low, high = gap[:, kept]
        within = (poles.real >= low) & (poles.real <= high) & (poles.imag <= least)
        leaks = np.flatnonzero(within & (poles.imag > -2.0 * _MOST_WIDTH * poles.real))
        leaks = leaks[self._find_different(point[kept[leaks]], poles[leaks])]
        squares = poles[leaks].real + 1j * np.minimum(poles[leaks].imag, 0.0)
        return EdgeWaves(point[kept[leaks]], squares, weight[kept[leaks]])

    def _find_different(self, point: Index, w: Complex, near: float = 0.0) -> Index:
        """Return indices that sort w (n,) at each wave vector, without those that repeat another.

        Two are the same if they differ by less than ``near`` times the lesser half width.
        """
        order = np.lexsort((w.real, point))
        depth = -w[order].imag
        is_new = np.ones(len(order), bool)
        same = near * np.minimum(depth[1:], depth[:-1]) + 0.1 * _NEWTON_TOLERANCE * self.highest
        is_new[1:] = (np.diff(point[order]) > 0) | (np.abs(np.diff(w[order])) > same)
        return order[is_new]

    def _find_pole(self, outer: Complex, inner: Complex, hop: Complex, w: complex) -> complex:
        """Return the root of S near w, straight below the real axis; nan if the search finds none.

        Waves that go from the edge take the motions of a block, times L, to the next: S = w - E_0 -
        A L. Above the real axis these are the waves that decay. On the way down they stay the same
        waves as long as each of their factors, the eigenvalues of L, moves by less than its
        distance from the factors of all other waves.
        """
        from scipy.linalg import ordqz
        from scipy.optimize import linear_sum_assignment

        size = self.size
        eye = np.eye(size)
        none = np.zeros((size, size))
        width = -w.imag
        right = np.block([[eye, none], [none, hop]])

        def solve(w: complex, earlier: Complex) -> tuple[Complex, Array, Complex]:
            """Return the factors that continue ``earlier`` ones, the distance of each from those of
            other waves, and the waves.
            """
            choices = list[tuple[Complex, Array]]()

            def choose(alpha: Any, beta: Any) -> Any:
                factors = np.full(2 * size, _FAR, complex)
                np.divide(alpha, beta, out=factors, where=np.abs(alpha) < _FAR * np.abs(beta))
                moves = np.tile(np.abs(factors), (size, 1))
                if len(earlier):
                    moves = np.abs(factors - earlier[:, None])
                columns = linear_sum_assignment(moves)[1]
                chosen = np.isin(np.arange(2 * size), columns)
                distances = np.abs(factors[columns, None] - factors[~chosen])
                choices.append((factors[columns], np.min(distances, axis=1)))
                return chosen

            left = np.block([[none, eye], [-hop.conj().T, w * eye - inner]])
            waves = ordqz(left, right, choose, "complex")[5][:, :size]
            factors, distances = choices[0]
            return factors, distances, np.asarray(waves, complex)

        def inverse_green(w: complex, waves: Complex) -> Complex:
            return w * eye - outer - hop @ waves[size:] @ np.linalg.inv(waves[:size])

        for _ in range(_NEWTON_STEPS):
            position = complex(w.real, _BAND_BROADENING * self.highest)
            factors, apart, waves = solve(position, np.zeros(0, complex))
            step = w.imag - position.imag
            while position.imag > w.imag:
                step = max(step, w.imag - position.imag)
                trial = solve(position + 1j * step, factors)
                if np.all(np.abs(trial[0] - factors) <= _MOST_MOVED * np.minimum(trial[1], apart)):
                    factors, apart, waves = trial
                    position = position + 1j * step
                    step = 2.0 * step
                elif step > -_LEAST_STEP * width:
                    return complex(np.nan)
                else:
                    step *= 0.5
            inverse = inverse_green(w, waves)
            aside = _LEAST_STEP * width
            slope = (inverse_green(w + aside, solve(w + aside, factors)[2]) - inverse) / aside
            shifts = np.linalg.eigvals(np.linalg.solve(slope, -inverse))
            shift = shifts[np.argmin(np.abs(shifts))]
            w = w + shift
            tolerance = _NEWTON_TOLERANCE * width + _POLE_NOISE * self.highest
            if not w.imag < 0.0 or abs(shift) < tolerance:
                return w
        return complex(np.nan)

    # -- topology ----------------------------------------------------------------------------------

    def _find_rows(self, q: Array) -> Complex:
        """Return |K|^1/2 C M^-1/2 (n, rows, size) of one block of the crystal at q (p - 1,), at n
        phases between blocks.

        A contact that joins two blocks counts to the lower-numbered block.
        """
        size = self.size
        along = np.exp(2.0j * np.pi * (self._steps @ q))
        coefficients = np.tensordot(along, self._matrix[:, self._second], 1)
        phase = np.exp(2.0j * np.pi * np.arange(_WINDING_PHASES) / _WINDING_PHASES)[:, None, None]
        rows = coefficients[:, size : 2 * size] + phase * coefficients[:, 2 * size :]
        return np.asarray(np.sqrt(np.abs(self._stiff[self._second]))[:, None] * rows)

    def zak_phase(self, q: Array, below: int) -> float:
        """Return the Zak phase of all but the ``below`` lowest branches at q (p - 1,), 0 to 2 pi
        (J. Zak, Phys. Rev. Lett. 62, 2747, 1989).

        It is that of the motions of the balls where an edge is held, and of the deformations of
        contacts where it is free, as each edge leaves whole cells of these. Raises
        :class:`~granphon.base.errors.InputError` where the gap closes.
        """
        if self.edge == "free" and self.network.prestress:
            raise InputError(
                "static forces act at the free edge (prestress)",
                mend="Take a state without, or a held edge",
            )
        rows = self._find_rows(q)
        signs = np.sign(self._stiff[self._second])[:, None]
        squares, vectors = np.linalg.eigh(rows.conj().swapaxes(1, 2) @ (signs * rows))
        shape = vectors[:, :, below:]
        gap = np.min(squares[:, below] - squares[:, below - 1])
        if self.edge == "free":
            shape = np.linalg.qr(rows @ shape)[0]
        steps = np.linalg.det(shape.conj().swapaxes(1, 2) @ np.roll(shape, -1, axis=0))
        if gap <= _SINGULAR * self.highest or np.min(np.abs(steps)) < _OPEN:
            raise InputError(
                f"the gap above the {below} lowest branches closes, or nearly",
                mend="Take another wave vector",
            )
        phase = -float(np.angle(np.prod(steps / np.abs(steps))))
        return 0.0 if abs(phase) < _NO_PHASE else phase % (2.0 * np.pi)

    def winding(self, q: Array) -> int:
        """Return how often det C winds about zero at q (p - 1,), which is the number of motions at
        a free edge that cost nothing (C. L. Kane and T. C. Lubensky, Nature Physics 10, 39, 2014).

        Raises :class:`~granphon.base.errors.InputError` where C is not square, or its determinant
        vanishes.
        """
        rows = self._find_rows(q)
        if rows.shape[1] != rows.shape[2]:
            raise InputError(
                f"{rows.shape[1]} deformations of contacts and {rows.shape[2]} motions are not as"
                " many",
                "C has no determinant",
                "Take an isostatic lattice",
            )
        determinants = np.linalg.det(rows)
        bounds = np.prod(np.linalg.norm(rows, axis=2), axis=1)
        turns = np.angle(np.roll(determinants, -1) * determinants.conj())
        is_singular = np.any(np.abs(determinants) <= _SINGULAR * bounds)
        if is_singular or np.max(np.abs(turns)) > 0.5 * np.pi:
            raise InputError(
                "det C vanishes, or nearly, at this wave vector", mend="Take another one"
            )
        return int(np.rint(turns.sum() / (2.0 * np.pi)))

    # -- long waves --------------------------------------------------------------------------------

    def rayleigh_velocity(self, direction: Array) -> float:
        """Return the velocity of the long wave at a free edge along ``direction`` (p - 1,), in the
        frame of the cut.

        The surface impedance Z(v), which is Hermitian, is singular there; it is positive at v = 0,
        and falls with v up to the velocity at which a bulk wave first runs along the edge. Raises
        :class:`~granphon.base.errors.InputError` for an edge that is held, and if there is no such
        wave.
        """
        if self.edge != "free":
            raise InputError(
                f"the edge is held ({self.edge})", "Long waves there are none", "Take edge='free'"
            )
        lattice = ContactLattice.from_network(self.network)
        p = lattice.periods
        moves = lattice.motions.translations
        lattice.require_rigid()
        if p < 2 or not set(range(p)) <= set(moves):
            raise InputError(
                "the balls do not move along the edge and across it", mend="Use other motions"
            )
        inside = [moves.index(axis) for axis in range(p)]
        turn = self.layers.turn[:p, :p]
        if not np.allclose(np.abs(np.linalg.det(turn)), 1.0):
            raise InputError(
                "the periods of the network do not lie along x, or in the xy plane", mend="Turn it"
            )
        gradients = np.ix_(inside, range(p), inside, range(p))
        stiffness = lattice.gradient_stiffness()[gradients] / lattice.measure
        tensor = np.einsum("ai,bj,ck,dl,ijkl->abcd", turn, turn, turn, turn, stiffness)
        density = float(lattice.masses.sum()) / lattice.measure
        along = np.append(direction, 0.0)
        normal = np.eye(p)[-1]
        still = np.einsum("ijkl,j,l->ik", tensor, along, along)
        mixed = np.einsum("ijkl,j,l->ik", tensor, along, normal)
        inverse = np.linalg.inv(np.einsum("ijkl,j,l->ik", tensor, normal, normal))

        def slowest(angle: Any) -> Any:
            """Return the velocity along the edge of the slowest bulk wave that runs at an angle."""
            course = np.cos(angle)[..., None] * along + np.sin(angle)[..., None] * normal
            acoustic = np.einsum("ijkl,...j,...l->...ik", tensor, course, course)
            squared = np.linalg.eigvalsh(acoustic)[..., 0] / density
            return np.sqrt(np.maximum(squared, 0.0)) / np.cos(angle)

        def impedance(v: float) -> float:
            # displacements a exp(i (m + p n).x), with the roots p that decay below the edge, and
            # their tractions
            dynamic = still - density * v * v * np.eye(p)
            coupling = mixed @ inverse @ mixed.T - dynamic
            system = np.block([[-inverse @ mixed.T, inverse], [coupling, -mixed @ inverse]])
            roots, vectors = np.linalg.eig(system)
            chosen = np.argsort(-roots.imag)[:p]
            shape = vectors[:p, chosen]
            force = vectors[p:, chosen]
            impedances = -1j * force @ np.linalg.inv(shape)
            return float(np.linalg.eigvalsh(0.5 * (impedances + impedances.conj().T))[0])

        from scipy.optimize import brentq, minimize_scalar

        grid = np.linspace(-1.4, 1.4, 281)
        best = float(grid[np.argmin(slowest(grid))])
        near = (best - 0.01, best + 0.01)
        minimum = minimize_scalar(slowest, bounds=near, method="bounded", options={"xatol": 1e-12})
        limit = float(minimum.fun)
        ends = (1e-3 * limit, (1.0 - 1e-9) * limit)
        if not impedance(ends[0]) * impedance(ends[1]) < 0.0:
            raise GranphonError(
                "no long wave runs along this edge", mend="Choose another direction"
            )
        return float(brentq(impedance, *ends, xtol=1e-15 * limit, rtol=1e-15))
