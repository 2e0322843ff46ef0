"""Edges of bands: where in the zone a branch is highest or lowest, and where two branches touch.

The best points of a mesh are starts. From these, frequencies are followed along group velocities to
the extremes of a branch. A cone, where two branches cross at a point of their own, has a tip that
no such path reaches: it is found as the zero of the two branches' part of D(q).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from granphon.base.arrays import Array, Complex, Flags, Index
from granphon.dynamics.contact_lattice import ContactLattice

#: branches whose edges are this part of the top frequency apart may touch between the points of the
#: mesh: where they do is looked for
_NEAR = 1e-2
#: number of steps along group velocities, and towards a crossing of two branches, at most
_TURNS = 30
_CROSSING_TURNS = 12
#: number of points of the mesh, for each start of an edge, where two branches are closest
_CLOSEST = 4
#: distance of neighbours on the mesh, over its longest step: those across the diagonal count
_NEIGHBOUR = 1.5
#: number of branches beyond which edges are sought from fewer points, as many edges are near
_FEW_BRANCHES = 120
#: direction, along no axis of symmetry, in which a point without a slope is left
_ASIDE = np.array([1.0, 0.37, 0.22])
#: step, 1/d, after which the frequency is that of the extremum to rounding
_LEVEL = 1e-8
#: half the distance, 1/d, of wave vectors whose D(q) have the slope of D between them
_SLOPE_STEP = 1e-4
#: smallest singular value, over the largest, of slopes across which two branches cross; along the
#: others they stay together, as on a line of touching
_FLATTEST = 1e-6


class ZoneSample(NamedTuple):
    """Where edges of bands are sought.

    Attributes
    ----------
    points : (n_q, p) wave vectors, fractions of the reciprocal cell.
    frequencies : (n_q, n_branches) at these, (k/M)^1/2.
    spacing : the longest step of the mesh, 1/d.
    """

    points: Array
    frequencies: Array
    spacing: float


class Extremes(NamedTuple):
    """The greatest frequencies times sign, ``heights`` (e,), and the wave vectors ``points``
    (e, p), 1/d, at which they are.
    """

    heights: Array
    points: Array


class BandEdges(NamedTuple):
    """Edges of gaps, (e,): first the tops of the branches below the gaps, in ascending order, then
    the bottoms of the branches above.

    The gap below the lowest branch has no edge below. A top is sought as the greatest frequency,
    ``sign`` 1, and a bottom as the greatest negative frequency, ``sign`` -1.
    """

    branch: Index
    sign: Array
    n_tops: int

    @classmethod
    def of(cls, above_gaps: Index) -> BandEdges:
        """Return the edges of the gaps below the branches ``above_gaps`` (n,), ascending."""
        # of the branches below a gap the last reaches as high as any
        below_gaps = above_gaps[above_gaps > 0] - 1
        n_tops = len(below_gaps)
        branch = np.concatenate([below_gaps, above_gaps])
        sign = np.concatenate([np.ones(n_tops), -np.ones(len(above_gaps))])
        return cls(branch, sign, n_tops)

    def find_near(self, heights: Array, width: float) -> Index:
        """Return the numbers (n,) of the tops of gaps between two branches that are below
        ``width``, or of branches that overlap by less, with frequencies times sign ``heights``
        (e,).
        """
        gap_widths = -heights[self.bottoms_of_tops] - heights[: self.n_tops]
        return np.flatnonzero(np.abs(gap_widths) < width)

    @property
    def bottoms_of_tops(self) -> Index:
        """The numbers (n_tops,) of the bottoms across the gaps from the tops."""
        # they are last; before them may be the bottom of the gap without a top
        return np.arange(len(self.branch) - self.n_tops, len(self.branch))

    def pair(self, values: Array) -> tuple[Array, Array]:
        """Return the ``values`` (e, ...) at the lower and at the upper edge of each gap, both
        (n, ...); zero at the lower edge of a gap below all branches.
        """
        upper = values[self.n_tops :]
        lower = np.zeros_like(upper)
        lower[len(upper) - self.n_tops :] = values[: self.n_tops]
        return lower, upper


class EdgeSearch(NamedTuple):
    """The search for the edges of the bands of a ``lattice`` from a sample of its ``zone``."""

    lattice: ContactLattice
    zone: ZoneSample

    def find(self, edges: BandEdges, most_starts: int) -> Extremes:
        """Return the extremes of each of the ``edges`` that are reached from the best points of the
        zone, ``most_starts`` at most, and from where a branch comes next to that across a gap.
        """
        starts = self._choose_starts(edges, most_starts)
        ends = self._climb_edges(edges, np.arange(len(starts)), starts)
        tops = edges.find_near(ends.heights, _NEAR * float(self.zone.frequencies.max()))
        if not tops.size:
            return ends
        bottoms = edges.bottoms_of_tops[tops]
        closest = self._find_closest(edges.branch[tops], _CLOSEST * starts.shape[1])
        near_starts = np.concatenate([starts[tops], starts[bottoms], closest], axis=1)
        crossings, widths = self._approach(near_starts, edges.branch[tops])
        for numbers in (tops, bottoms):
            highest = self._choose_highest(edges, numbers, crossings, starts.shape[1])
            near_peaks = np.take_along_axis(crossings, highest[..., None], axis=1)
            reach = np.take_along_axis(widths, highest, axis=1)
            peaks = self._climb_edges(edges, numbers, near_peaks, reach)
            is_higher = peaks.heights > ends.heights[numbers]
            ends.heights[numbers[is_higher]] = peaks.heights[is_higher]
            ends.points[numbers[is_higher]] = peaks.points[is_higher]
        return ends

    def _choose_starts(self, edges: BandEdges, most_starts: int) -> Array:
        """Return the wave vectors (e, n_starts, p), 1/d, of the zone at which frequencies come next
        to each edge, the nearest first, ``most_starts`` at most.
        """
        frequencies = self.zone.frequencies
        n_starts = max(1, min(most_starts, _FEW_BRANCHES // frequencies.shape[1]))
        return self._choose_points(-edges.sign * frequencies[:, edges.branch], n_starts)

    def _find_closest(self, branch: Index, count: int) -> Array:
        """Return the up to ``count`` wave vectors (n, count, p), 1/d, of the zone at which each
        ``branch`` (n,) comes next to the branch above: there peaks may be narrower than the mesh.
        """
        frequencies = self.zone.frequencies
        return self._choose_points(frequencies[:, branch + 1] - frequencies[:, branch], count)

    def _choose_points(self, depths: Array, count: int) -> Array:
        """Return the up to ``count`` wave vectors (n, count, p), 1/d, of the zone of the least
        ``depths`` (n_q, n), the least first, no two of them neighbours on the mesh as long as
        there are others: neighbours lie about the same extreme.
        """
        points = self.zone.points
        n_chosen = min(count, len(points))
        chosen = np.empty((depths.shape[1], n_chosen), int)
        nearby: dict[int, Flags] = {}
        for own, depth in zip(chosen, depths.T, strict=True):
            order = np.argsort(depth, kind="stable")
            is_far = np.ones(len(points), bool)
            is_free = is_far.copy()
            for n in range(n_chosen):
                candidates = order[is_far[order]]
                own[n] = candidates[0] if candidates.size else order[is_free[order]][0]
                is_free[own[n]] = False
                if own[n] not in nearby:
                    nearby[own[n]] = self._find_neighbours(points[own[n]])
                is_far &= ~nearby[own[n]]
        return self.lattice.wavevectors(points[chosen])

    def _find_neighbours(self, point: Array) -> Flags:
        """Return which of the points of the zone (n_q,) are neighbours of a ``point`` (p,) on the
        mesh, or of its opposite, with the same frequencies; both are fractions.
        """
        is_neighbour = np.zeros(len(self.zone.points), bool)
        for alike in (point, -point):
            step = self.zone.points - alike
            distance = np.linalg.norm(self.lattice.wavevectors(step - np.rint(step)), axis=1)
            is_neighbour |= distance < _NEIGHBOUR * self.zone.spacing
        return is_neighbour

    def _choose_highest(self, edges: BandEdges, numbers: Index, points: Array, count: int) -> Index:
        """Return which ``count`` (n, count) of the wave vectors ``points`` (n, n_points, p), 1/d,
        are the highest of each of the edges of the ``numbers`` (n,).
        """
        n_edges, n_points, p = points.shape
        frequencies = self.lattice.frequencies(points.reshape(-1, p))
        by_edge = frequencies.reshape(n_edges, n_points, -1)
        branch = edges.branch[numbers]
        own = np.take_along_axis(by_edge, branch[:, None, None], axis=2)[..., 0]
        heights = edges.sign[numbers, None] * own
        return np.argsort(-heights, axis=1, kind="stable")[:, :count]

    def _climb_edges(
        self, edges: BandEdges, numbers: Index, starts: Array, widths: Array | None = None
    ) -> Extremes:
        """Return the highest extremes of the edges of the ``numbers`` (n,) that are reached from
        ``starts`` (n, n_starts, p), 1/d, by steps no longer than ``widths`` (n, n_starts), 1/d, or
        the spacing of the mesh.
        """
        n_edges, n_starts, p = starts.shape
        branch = np.repeat(edges.branch[numbers], n_starts)
        sign = np.repeat(edges.sign[numbers], n_starts)
        longest = np.full(n_edges * n_starts, self.zone.spacing)
        if widths is not None:
            longest = np.minimum(longest, widths.ravel())
        ends = self._climb(starts.reshape(-1, p), branch, sign, longest)
        highest = np.argmax(ends.heights.reshape(n_edges, n_starts), axis=1)
        best = np.arange(n_edges) * n_starts + highest
        return Extremes(ends.heights[best], ends.points[best])

    def _climb(self, starts: Array, branch: Index, sign: Array, longest: Array) -> Extremes:
        """Return the extremes, by a ``sign`` (n,), of a ``branch`` (n,) along its group velocity
        from each of the wave vectors ``starts`` (n, p), 1/d.

        Steps are those of J. Barzilai and J. M. Borwein (IMA J. Numer. Anal. 8, 141, 1988), none
        above ``longest`` (n,), 1/d.
        """
        q = starts.copy()
        heights = np.full(len(q), -np.inf)
        points = q.copy()
        last_q = q.copy()
        last_slope = np.zeros_like(q)
        p = q.shape[1]
        direction = np.eye(p)[0]
        climbing = np.arange(len(q))
        for turn in range(_TURNS):
            modes = self.lattice.modes(q[climbing], direction)
            mode = (np.arange(climbing.size), branch[climbing])
            new_heights = sign[climbing] * modes.frequencies[mode]
            is_higher = new_heights > heights[climbing]
            heights[climbing[is_higher]] = new_heights[is_higher]
            points[climbing[is_higher]] = q[climbing[is_higher]]
            slope = sign[climbing, None] * modes.group_velocities[mode]
            steepness = np.linalg.norm(slope, axis=1)
            is_steep = steepness > 0.0
            longest_step = longest[climbing]
            # unit vectors along the slopes
            uphill = np.zeros_like(slope)
            np.divide(slope, steepness[:, None], out=uphill, where=is_steep[:, None])
            if turn == 0:
                # where q is its own opposite, no branch has a slope, be it an extreme or a saddle
                uphill[~is_steep] = _ASIDE[:p] / np.linalg.norm(_ASIDE[:p])
                step = 0.5 * longest_step
            else:
                moved = q[climbing] - last_q[climbing]
                unlimited_step = _secant_step(moved, slope - last_slope[climbing], steepness)
                step = np.minimum(unlimited_step, np.where(is_steep, longest_step, 0.0))
            last_q[climbing] = q[climbing]
            last_slope[climbing] = slope
            q[climbing] += step[:, None] * uphill
            climbing = climbing[step > _LEVEL]
            if not climbing.size:
                break
        return Extremes(heights, points)

    def _approach(self, starts: Array, branch: Index) -> tuple[Array, Array]:
        """Return the wave vectors (n, n_starts, p), 1/d, at which each ``branch`` (n,) crosses the
        branch above or is closest to it, from ``starts`` (n, n_starts, p), and the distances (n,
        n_starts), 1/d, over which the branches separate there.

        Between the two modes D(q) is 2 x 2, and its part without trace is linear in q near by. The
        steps are those of C. F. Gauss and I. Newton to the zero of that part, or its least norm,
        none above the spacing of the mesh.
        """
        n, n_starts, p = starts.shape
        q = starts.reshape(-1, p).copy()
        lower = np.repeat(branch, n_starts)
        widths = np.zeros(len(q))
        moving = np.arange(len(q))
        for _ in range(_CROSSING_TURNS):
            apart, slopes = self._split(q[moving], lower[moving])
            step = -_solve_least(slopes, apart)
            length = np.linalg.norm(step, axis=1)
            steepest = np.linalg.norm(slopes, axis=(1, 2))
            width = np.zeros(moving.size)
            np.divide(np.linalg.norm(apart, axis=1), steepest, out=width, where=steepest > 0.0)
            widths[moving] = width
            shortening = np.minimum(1.0, self.zone.spacing / np.maximum(length, _LEVEL))
            q[moving] += shortening[:, None] * step
            moving = moving[length > _LEVEL]
            if not moving.size:
                break
        return q.reshape(n, n_starts, p), widths.reshape(n, n_starts)

    def _split(self, q: Array, lower: Index) -> tuple[Array, Array]:
        """Return the part without trace of D between the branches ``lower`` (n,) and those above,
        (n, 3), k/M, at wave vectors ``q`` (n, p), 1/d, and its slopes (n, 3, p), k d/M.

        Its components are those of Pauli's matrices.
        """
        p = q.shape[1]
        modes = self.lattice.modes(q, np.eye(p)[0])
        numbers = np.arange(len(q))
        squared = modes.frequencies**2
        apart = np.zeros((len(q), 3))
        apart[:, 2] = 0.5 * (squared[numbers, lower] - squared[numbers, lower + 1])
        pair = lower[:, None] + np.arange(2)
        vectors: Complex = np.take_along_axis(modes.eigenvectors, pair[:, None, :], axis=2)
        slopes = np.empty((len(q), 3, p))
        for axis, direction in enumerate(np.eye(p)):
            ahead = self.lattice.dynamical_matrix(q + _SLOPE_STEP * direction)
            behind = self.lattice.dynamical_matrix(q - _SLOPE_STEP * direction)
            slope = vectors.conj().swapaxes(1, 2) @ (ahead - behind) @ vectors
            slope /= 2.0 * _SLOPE_STEP
            slopes[:, 0, axis] = slope[:, 0, 1].real
            slopes[:, 1, axis] = -slope[:, 0, 1].imag
            slopes[:, 2, axis] = 0.5 * (slope[:, 0, 0] - slope[:, 1, 1]).real
        return apart, slopes


def _solve_least(matrices: Array, values: Array) -> Array:
    """Return the shortest of the vectors (n, p) whose products with ``matrices`` (n, 3, p) are
    nearest to ``values`` (n, 3).
    """
    return np.asarray(np.einsum("npc,nc->np", np.linalg.pinv(matrices, rcond=_FLATTEST), values))


def _secant_step(moved: Array, change: Array, steepness: Array) -> Array:
    """Return the lengths (n,), 1/d, of steps along slopes of size ``steepness`` (n,) that would
    reach a parabola's top, after slopes have changed by ``change`` (n, p) along ``moved`` (n, p),
    1/d; zero where the slope has not changed.
    """
    bend = np.abs(np.sum(moved * change, axis=1))
    squared = np.sum(moved**2, axis=1)
    lengths = np.zeros(len(bend))
    np.divide(squared * steepness, bend, out=lengths, where=bend > 0.0)
    return lengths
