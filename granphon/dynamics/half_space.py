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
    """Waves of an edge: the number of the wave vector, w = omega^2 (complex where they leak), and
    the energy on top.
    """

    place: Index
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
            rows += (pushes := push_rows(cut.normal[:, :d], self.motions))
            stiff += [-cut.normal_force / cut.distance / units.stiffness] * len(pushes)
        # C(q) is the sum over steps s along the edge of C_s exp(i q.s): tails are at s = 0. Kept
        # are the contacts that reach into the two outer blocks, which are those of three
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
        for place, row in enumerate(rows):
            for part, end, at in (
                (-row.tail, cut.i, of_step.ravel()[0]),
                (row.head, cut.j, of_step.ravel()[1:]),
            ):
                ball = end[kept]
                matrix[at, place, np.arange(len(kept)), number[ball]] += (
                    part[kept] * root[ball][:, None]
                )
        columns = 3 * self.size // count
        self._matrix: Array = matrix[:, :, :, :columns].reshape(len(steps), -1, 3 * self.size)
        self._stiff: Array = np.concatenate([one[kept] for one in stiff])
        upper = np.maximum(number[cut.i], number[cut.j]) // (reach * self.per_layer)
        self._whole, self._crossing = (
            np.tile(one[kept], len(rows))
            for one in (lower == 1, (lower == 0) & (upper == 1) & moving[cut.i] & moving[cut.j])
        )
        self._kept = kept
        self._kinds = [row.kind for row in rows]

    def blocks(self, q: Array) -> tuple[Complex, Complex, Complex]:
        """Return E_0, E and A, (n_q, size, size), at wave vectors q (n_q, p - 1) in fractions of
        the reciprocal cell.
        """
        size = self.size
        phase = np.exp(2.0j * np.pi * (q @ self._steps.T))
        rows: Complex = np.asarray(np.tensordot(phase, self._matrix[:, :, : 2 * size], 1), complex)
        whole = rows.conj().swapaxes(1, 2) @ (self._stiff[:, None] * rows)
        return whole[:, :size, :size], whole[:, size:, size:], whole[:, :size, size:]

    def couplings(self, q: Array, elongation: Any = 1.0, other: Any = 1.0) -> Couplings:
        """Return the blocks at one wave vector q (p - 1,); contacts of :attr:`cut` are as many
        times as stiff.

        The factors, of elongation and of all other deformations, are numbers or (n_f, n_c), complex
        where energy is lost.
        """
        size = self.size
        rows = np.tensordot(
            np.exp(2.0j * np.pi * (self._steps @ q)), self._matrix[:, :, : 2 * size], 1
        )
        weights = self._stiff
        parts = list[Complex]()
        if np.ndim(elongation):
            each = {"elongation": elongation, "push": np.ones_like(elongation)}
            weights = weights * np.concatenate(
                [each.get(kind, other)[:, self._kept] for kind in self._kinds], axis=1
            )
        for chosen in (slice(None), self._crossing):
            some = np.asarray(rows[chosen], complex)
            parts.append(some.conj().T @ (weights[..., chosen, None] * some))
        whole, cross = parts
        return Couplings(
            whole[..., size:, size:],
            cross[..., :size, :size],
            cross[..., size:, size:],
            whole[..., :size, size:],
            whole[..., size:, :size],
        )

    def read_wavevector(self, q: ArrayLike) -> Array:
        """Return one wave vector along the edge (p - 1,), zero if () is given; raises InputError
        for another shape.
        """
        p, given = len(self.layers.cell), real_array("q", q)
        if given.shape not in ((p,), (0,)) or not np.all(np.isfinite(given)):
            raise InputError(
                f"q has the shape {given.shape}", mend=f"Give ({p},) fractions, along the layers"
            )
        return given if given.size else np.zeros(p)

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
        self, own: Complex, inner: Complex, hop: Complex, place: Index, w: Complex
    ) -> tuple[Complex, Complex]:
        """Return w - F of the outer block, and of one that has others on both sides, (n, m, m), for
        blocks of ``place``.
        """
        size = own.shape[1]
        out = np.empty((2, len(w), size, size), complex)
        eye = np.eye(size)
        together = max(1, _CHUNK // (12 * size**2))
        for first in range(0, len(w), together):
            part = slice(first, first + together)
            at = place[part]
            here = w[part, None, None] * eye
            top, bulk, down = own[at].copy(), inner[at].copy(), hop[at]
            pair = np.concatenate([down, down.conj().swapaxes(1, 2)], axis=1)  # A on top of B
            left = np.arange(len(at))
            for _ in range(_MOST_DOUBLINGS):
                both = np.concatenate([pair[:, :size], pair[:, size:]], axis=2)
                met = pair @ np.linalg.solve(here[left] - bulk[left], both)
                through = met[:, :size, size:]
                back = met[:, size:, :size]  # A g B and B g A
                top[left] += through
                bulk[left] += through + back
                pair = np.concatenate([met[:, :size, :size], met[:, size:, size:]], axis=1)
                going = (
                    np.max(np.abs(through) + np.abs(back), axis=(1, 2))
                    > _COUPLING_TOLERANCE * self.highest
                )
                left = left[going]
                pair = pair[going]
                if not left.size:
                    break
            out[:, part] = here - top, here - bulk
        return out[0], out[1]

    def inverse_green(self, q: Array, place: Index, w: Complex) -> Complex:
        """Return S = w - F of the outer layers, (n, size, size), at wave vectors ``q[place]`` and w
        (n,).
        """
        return self._eliminate(*self.blocks(q), place, w)[0]

    def bands(self, q: Array) -> Array:
        """Return the lowest and the highest w (n_q, size, 2) of each branch at q (n_q, p - 1), over
        all across the edge.
        """
        _, inner, hop = self.blocks(q)

        def solve(at: Index, angle: Array) -> Array:
            turned = hop[at] * np.exp(1j * angle)[:, None, None]
            return np.linalg.eigvalsh(inner[at] + turned + turned.conj().swapaxes(1, 2))

        n = len(q)
        size = self.size
        grid = 2.0 * np.pi * np.arange(_BAND_SAMPLES) / _BAND_SAMPLES
        values = solve(np.repeat(np.arange(n), _BAND_SAMPLES), np.tile(grid, n)).reshape(
            n, _BAND_SAMPLES, size
        )
        sign = np.array([1.0, -1.0])
        start = grid[np.argmin(values[..., None] * sign, axis=1)].reshape(-1)  # (n, size, 2)
        place = np.repeat(np.arange(n), 2 * size)
        branch = np.tile(np.repeat(np.arange(size), 2), n)
        signs = np.tile(sign, n * size)
        golden = 0.5 * (math.sqrt(5.0) - 1.0)
        step = 2.0 * np.pi / _BAND_SAMPLES
        low = start - step
        high = start + step
        best = signs * solve(place, start)[np.arange(len(place)), branch]
        x = np.stack([high - golden * (high - low), low + golden * (high - low)])
        f = [signs * solve(place, one)[np.arange(len(place)), branch] for one in x]
        for _ in range(_SECTIONS):
            left = f[0] < f[1]
            low, high = np.where(left, low, x[0]), np.where(left, x[1], high)
            new = np.where(left, high - golden * (high - low), low + golden * (high - low))
            found = signs * solve(place, new)[np.arange(len(place)), branch]
            x = np.where(left, [new, x[0]], [x[1], new])
            f = [np.where(left, found, f[1]), np.where(left, f[0], found)]
            best = np.minimum(best, found)
        return (signs * best).reshape(n, size, 2)

    # -- waves of the edge -------------------------------------------------------------------------

    def _find_gaps(self, q: Array, inside: bool = False) -> tuple[Index, Array]:
        """Return intervals of w without a band, or those inside of bands: the wave vector of each,
        and (2, n) its ends.
        """
        place = []
        ends = []
        for at, each in enumerate(self.bands(q)):
            order = each[np.argsort(each[:, 0])]
            below = np.concatenate([[0.0], np.maximum.accumulate(order[:, 1]).clip(0.0)])
            above = np.append(order[:, 0], 1.01 * self.highest)
            clear = above - below > _LEAST_GAP * above
            found = list(zip(below[clear], above[clear], strict=True))
            if inside:
                tops, bottoms = [0.0, *(high for _, high in found)], [*(low for low, _ in found)]
                found = [
                    (a, b) for a, b in zip(tops, bottoms, strict=False) if b - a > _LEAST_GAP * b
                ]
            place += [at] * len(found)
            ends += found
        low, high = np.array(ends).reshape(-1, 2).T
        margin = _GAP_MARGIN * (high - low)
        # motions that cost nothing are no waves
        return np.array(place, np.intp), np.stack(
            [np.maximum(low + margin, _FREE_IN_GAP * high), high - margin]
        )

    def find_waves(self, q: Array) -> EdgeWaves:
        """Find all waves of the edge outside of the bands, at wave vectors q (n_q, p - 1).

        The half space is a crystal without an edge, changed by V in the two blocks that an edge
        parts. Waves of both edges are where M(w) = sign(V) - |V|^1/2 g |V|^1/2 is singular, g being
        the Green's function of the crystal. In a gap M is smooth and its eigenvalues rise, so that
        each has one zero if its sign changes over the gap, and none otherwise.
        """
        own, inner, hop = self.blocks(q)
        size = self.size
        back = hop.conj().swapaxes(1, 2)
        none = np.zeros_like(hop)
        change = np.block([[none, -hop], [-back, own - inner]])
        block, across = (
            np.block([[inner, hop], [back, inner]]),
            np.block([[none, none], [hop, none]]),
        )
        strength, basis = np.linalg.eigh(change)
        signs = np.where(strength < 0.0, -1.0, 1.0)
        root = basis * np.sqrt(np.abs(strength))[:, None]

        def find(place: Index, w: Array, gap: Array) -> tuple[Complex, Complex, Complex]:
            """Return M, its derivative by w, and what moves in both blocks, g |V|^1/2."""
            nearest = np.minimum(w - gap[0], gap[1] - w).clip(_GAP_MARGIN * (gap[1] - gap[0]))
            aside, both = np.outer(_GAP_BROADENINGS, nearest), np.tile(place, 2)
            green = np.linalg.inv(
                self._eliminate(block, block, across, both, (w + 1j * aside).ravel())[1]
            )
            green, turned = (
                one.reshape(2, -1, 2 * size, 2 * size)
                for one in (green, green.conj().swapaxes(1, 2))
            )
            even = 0.5 * (green + turned)
            odd = (green - turned) / (2j * aside[:, :, None, None])
            level, slope = ((4.0 * one[0] - one[1]) / 3.0 for one in (even, odd))
            left = root[place].conj().swapaxes(1, 2)
            moved = level @ root[place]
            return (
                signs[place, None] * np.eye(2 * size) - left @ moved,
                -left @ slope @ root[place],
                moved,
            )

        def rising(place: Index, w: Array, gap: Array) -> Array:
            return np.asarray(np.linalg.eigvalsh(find(place, w, gap)[0]), float)

        place, gap = self._find_gaps(q)
        ends = np.stack([rising(place, one, gap) for one in gap])
        # of zeros at the very ends, beside the poles of g
        rounded = _UNSIGNED * np.max(np.abs(ends), axis=2, keepdims=True)
        row, branch = np.nonzero((ends[0] < -rounded[0]) & (ends[1] > rounded[1]))
        place, gap, w = place[row], gap[:, row], np.zeros(len(row))
        if not row.size:
            return EdgeWaves(place, np.zeros(0, complex), np.zeros(0))
        low, high = gap.copy()
        f_low, f_high = ends[:, row, branch]
        going = np.arange(len(row))
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
            value = rising(place[going], x, gap[:, going])[np.arange(len(going)), branch[going]]
            up = value > 0.0
            again = np.where(up, 1.0, -1.0) == side[going]
            high[going], low[going] = np.where(up, x, b), np.where(up, a, x)
            f_high[going] = np.where(up, value, np.where(again, 0.5 * fb, fb))
            f_low[going] = np.where(up, np.where(again, 0.5 * fa, fa), value)
            side[going], w[going] = np.where(up, 1.0, -1.0), x
            going = going[(high[going] - low[going] > _ROOT_TOLERANCE * x) & (value != 0.0)]
        return self._sort_sides(find, place, w, gap)

    def _sort_sides(self, find: Any, place: Index, w: Array, gap: Array) -> EdgeWaves:
        """Return those waves that are of this edge, not of the one beyond the cut, with their
        energy on top.
        """
        size = self.size
        found = []
        order = np.lexsort((w, place))
        new = np.ones(len(w), bool)
        new[1:] = (np.diff(place[order]) > 0) | (
            np.diff(w[order]) > _DEGENERACY * (gap[1] - gap[0])[order][1:]
        )
        for members in np.split(order, np.flatnonzero(new)[1:]):
            at, here = place[members[:1]], np.mean(w[members])
            (matrix,), (slope,), (moved,) = find(at, np.array([here]), gap[:, members[:1]])
            values, vectors = np.linalg.eigh(matrix)
            free = vectors[:, np.argsort(np.abs(values))[: len(members)]]
            # of a wave of this edge, nothing moves beyond the cut
            top, beyond = (
                part.conj().T @ part for part in (moved[size:] @ free, moved[:size] @ free)
            )
            scale = np.linalg.inv(np.linalg.cholesky(top + beyond))
            share, turned = np.linalg.eigh(scale @ top @ scale.conj().T)
            for one in (free @ scale.conj().T @ turned).T[share > 0.5]:
                energy = float((one.conj() @ slope @ one).real)
                found.append((at[0], here, float(np.sum(np.abs(moved[size:] @ one) ** 2)) / energy))
        table = np.array(found).reshape(-1, 3)
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
        place, branch = np.nonzero(parts > _FREE_TOP_PART)
        return EdgeWaves(
            place, np.zeros(len(place), complex), np.asarray(parts[place, branch], float)
        )

    def find_leaky_waves(self, q: Array) -> EdgeWaves:
        """Find leaky waves within bands at q (n_q, p - 1): poles below narrow resonances of S + dw
        S' on the real axis.
        """
        place, gap = self._find_gaps(q, inside=True)
        three = np.array([-1.0, 0.0, 1.0])
        top = self.highest

        def solve(place: Index, w: Array) -> tuple[Complex, Array]:
            at = np.asarray(
                (w + _DIFFERENCE_STEP * top * three[:, None]).ravel() + 1j * _BAND_BROADENING * top,
                complex,
            )
            low, middle, high = self.inverse_green(q, np.tile(place, 3), at).reshape(
                3, len(w), self.size, self.size
            )
            slope = (high - low) / (2.0 * _DIFFERENCE_STEP * top)
            values, vectors = np.linalg.eig(np.linalg.solve(slope, -middle))
            norm = np.abs(np.einsum("nab,nac,ncb->nb", vectors.conj(), slope, vectors))
            return values, np.sum(np.abs(vectors) ** 2, axis=1) / norm

        # denser towards the edges of the bands
        part = 0.5 * (1.0 - np.cos(np.pi * (np.arange(_LEAKY_STARTS) + 0.5) / _LEAKY_STARTS))
        x = (gap[0] + (gap[1] - gap[0]) * part[:, None]).ravel()
        place, gap = np.tile(place, _LEAKY_STARTS), np.tile(gap, _LEAKY_STARTS)
        wide = 2.0 * (gap[1] - gap[0]) / _LEAKY_STARTS
        offset = solve(place, x)[0] if len(x) else np.zeros((0, self.size), complex)
        close = np.abs(offset.real) <= wide[:, None]
        row, column = np.nonzero(close & (np.abs(offset.imag) < 2.0 * _MOST_WIDTH * x[:, None]))
        place = place[row]
        gap = gap[:, row]
        shift = offset[row, column]
        w, weight, size = (
            np.clip(x[row] + shift.real, *gap),
            np.zeros(len(row)),
            np.full(len(row), np.inf),
        )
        going = np.arange(len(row))
        for _ in range(_SEARCH_STEPS):
            if not going.size:
                break
            offset, parts = solve(place[going], w[going])
            best = np.argmin(np.abs(offset), axis=1)
            shift[going], weight[going] = (
                one[np.arange(len(going)), best] for one in (offset, parts)
            )
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
        kept = kept[self._find_different(place[kept], w[kept] - 1j * depth[kept], _SAME_POLE)]
        poles = w[kept].astype(complex)
        blocks = self.blocks(q)
        for number, chosen in enumerate(kept):
            if depth[chosen] > least or size[chosen] > _NEWTON_TOLERANCE * w[chosen]:
                own, inner, hop = (one[place[chosen]] for one in blocks)
                poles[number] = self._find_pole(
                    own, inner, hop, complex(w[chosen], -max(depth[chosen], least))
                )
        low, high = gap[:, kept]
        within = (poles.real >= low) & (poles.real <= high) & (poles.imag <= least)
        leaks = np.flatnonzero(within & (poles.imag > -2.0 * _MOST_WIDTH * poles.real))
        leaks = leaks[self._find_different(place[kept[leaks]], poles[leaks])]
        found = poles[leaks].real + 1j * np.minimum(poles[leaks].imag, 0.0)
        return EdgeWaves(place[kept[leaks]], found, weight[kept[leaks]])

    def _find_different(self, place: Index, w: Complex, near: float = 0.0) -> Index:
        """Return indices that sort w (n,) at each wave vector, without those that repeat another.

        Two are the same if they differ by less than ``near`` times the lesser half width.
        """
        order = np.lexsort((w.real, place))
        depth = -w[order].imag
        fresh = np.ones(len(order), bool)
        same = near * np.minimum(depth[1:], depth[:-1]) + 0.1 * _NEWTON_TOLERANCE * self.highest
        fresh[1:] = (np.diff(place[order]) > 0) | (np.abs(np.diff(w[order])) > same)
        return order[fresh]

    def _find_pole(self, own: Complex, inner: Complex, hop: Complex, w: complex) -> complex:
        """Return the root of S near w, straight below the real axis; nan if none is found.

        Waves that go from the edge take the motions of a block, times L, to the next: S = w - E_0 -
        A L. Above the real axis they are those that decay. On the way down they are told from the
        others as each of their factors, the eigenvalues of L, moves by less than what parts it from
        the factors of the others.
        """
        from scipy.linalg import ordqz
        from scipy.optimize import linear_sum_assignment

        size, eye, none = self.size, np.eye(self.size), np.zeros((self.size, self.size))
        width = -w.imag
        right = np.block([[eye, none], [none, hop]])

        def solve(w: complex, known: Complex) -> tuple[Complex, Array, Complex]:
            """Return the factors that continue ``known``, what parts each from those of other
            waves, and the waves.
            """
            found = list[tuple[Complex, Array]]()

            def choose(alpha: Any, beta: Any) -> Any:
                factors = np.full(2 * size, _FAR, complex)
                np.divide(alpha, beta, out=factors, where=np.abs(alpha) < _FAR * np.abs(beta))
                far = (
                    np.abs(factors - known[:, None])
                    if len(known)
                    else np.tile(np.abs(factors), (size, 1))
                )
                mine = linear_sum_assignment(far)[1]
                chosen = np.isin(np.arange(2 * size), mine)
                found.append(
                    (factors[mine], np.min(np.abs(factors[mine, None] - factors[~chosen]), axis=1))
                )
                return chosen

            left = np.block([[none, eye], [-hop.conj().T, w * eye - inner]])
            waves = ordqz(left, right, choose, "complex")[5][:, :size]
            return *found[0], np.asarray(waves, complex)

        def inverse_green(w: complex, waves: Complex) -> Complex:
            return w * eye - own - hop @ waves[size:] @ np.linalg.inv(waves[:size])

        for _ in range(_NEWTON_STEPS):
            at = complex(w.real, _BAND_BROADENING * self.highest)
            factors, apart, waves = solve(at, np.zeros(0, complex))
            step = w.imag - at.imag
            while at.imag > w.imag:
                step = max(step, w.imag - at.imag)
                trial = solve(at + 1j * step, factors)
                if np.all(np.abs(trial[0] - factors) <= _MOST_MOVED * np.minimum(trial[1], apart)):
                    (factors, apart, waves), at, step = trial, at + 1j * step, 2.0 * step
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
            if (
                not w.imag < 0.0
                or abs(shift) < _NEWTON_TOLERANCE * width + _POLE_NOISE * self.highest
            ):
                return w
        return complex(np.nan)

    # -- topology ----------------------------------------------------------------------------------

    def _find_rows(self, q: Array) -> Complex:
        """Return |K|^1/2 C M^-1/2 (n, rows, size) of one block of the crystal at q (p - 1,), at n
        phases between blocks.

        A contact of two blocks is one of the lower.
        """
        size, parts = (
            self.size,
            np.tensordot(np.exp(2.0j * np.pi * (self._steps @ q)), self._matrix[:, self._whole], 1),
        )
        phase = np.exp(2.0j * np.pi * np.arange(_WINDING_PHASES) / _WINDING_PHASES)[:, None, None]
        rows = parts[:, size : 2 * size] + phase * parts[:, 2 * size :]
        return np.asarray(np.sqrt(np.abs(self._stiff[self._whole]))[:, None] * rows)

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
        signs = np.sign(self._stiff[self._whole])[:, None]
        squares, vectors = np.linalg.eigh(rows.conj().swapaxes(1, 2) @ (signs * rows))
        shape, gap = vectors[:, :, below:], np.min(squares[:, below] - squares[:, below - 1])
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
            what = (
                f"{rows.shape[1]} deformations of contacts and {rows.shape[2]} motions are not as"
                f" many"
            )
            raise InputError(what, "C has no determinant", "Take an isostatic lattice")
        found, size = np.linalg.det(rows), np.prod(np.linalg.norm(rows, axis=2), axis=1)
        turns = np.angle(np.roll(found, -1) * found.conj())
        if np.any(np.abs(found) <= _SINGULAR * size) or np.max(np.abs(turns)) > 0.5 * np.pi:
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
        stiffness = (
            lattice.gradient_stiffness()[np.ix_(inside, range(p), inside, range(p))]
            / lattice.measure
        )
        tensor = np.einsum("ai,bj,ck,dl,ijkl->abcd", turn, turn, turn, turn, stiffness)
        density = float(lattice.masses.sum()) / lattice.measure
        along, normal = np.append(direction, 0.0), np.eye(p)[-1]

        still, mixed, inner = (
            np.einsum("ijkl,j,l->ik", tensor, one, other)
            for one, other in ((along, along), (along, normal), (normal, normal))
        )
        inverse = np.linalg.inv(inner)

        def slowest(angle: Any) -> Any:
            way = np.cos(angle)[..., None] * along + np.sin(angle)[..., None] * normal
            squared = (
                np.linalg.eigvalsh(np.einsum("ijkl,...j,...l->...ik", tensor, way, way))[..., 0]
                / density
            )
            return np.sqrt(np.maximum(squared, 0.0)) / np.cos(angle)

        def impedance(v: float) -> float:
            # displacements a exp(i (m + p n).x), with the roots p that decay below the edge, and
            # their tractions
            own = still - density * v * v * np.eye(p)
            system = np.block(
                [[-inverse @ mixed.T, inverse], [mixed @ inverse @ mixed.T - own, -mixed @ inverse]]
            )
            roots, vectors = np.linalg.eig(system)
            chosen = np.argsort(-roots.imag)[:p]
            shape = vectors[:p, chosen]
            force = vectors[p:, chosen]
            found = -1j * force @ np.linalg.inv(shape)
            return float(np.linalg.eigvalsh(0.5 * (found + found.conj().T))[0])

        from scipy.optimize import brentq, minimize_scalar

        grid = np.linspace(-1.4, 1.4, 281)
        at = float(grid[np.argmin(slowest(grid))])
        near = (at - 0.01, at + 0.01)
        limit = float(
            minimize_scalar(slowest, bounds=near, method="bounded", options={"xatol": 1e-12}).fun
        )
        ends = 1e-3 * limit, (1.0 - 1e-9) * limit
        if not impedance(ends[0]) * impedance(ends[1]) < 0.0:
            raise GranphonError(
                "no long wave runs along this edge", mend="Choose another direction"
            )
        return float(brentq(impedance, *ends, xtol=1e-15 * limit, rtol=1e-15))
