"""Edges of bands: where in the zone a branch is highest or lowest, and where two branches touch.

The points of a mesh with the highest or lowest frequencies are starts. From these, paths along the
group velocity lead to the extremes of a branch. If two branches cross at a single point, they form
a cone, whose tip no such path reaches. The tip is found as the point where D(q), between the modes
of the two branches, is a multiple of the unit matrix.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from granphon.base.arrays import Array, Complex, Flags, Index
from granphon.dynamics.contact_lattice import ContactLattice

#: width of a gap, over the top frequency, below which two branches may touch between the points of
#: the mesh, so that a crossing is sought
_TOUCHING_WIDTH = 1e-2
#: largest number of steps along group velocities to an extreme
_MOST_STEPS = 30
#: largest number of steps towards a crossing of two branches
_MOST_CROSSING_STEPS = 12
#: number of points of the mesh at which two branches are closest, for each start of an edge
_POINTS_PER_START = 4
#: distance of two points of the mesh, over its longest step, below which they are neighbours; those
#: across a diagonal are
_NEIGHBOUR_DISTANCE = 1.5
#: number of branches beyond which an edge is sought from one point alone, as many edges are near;
#: with fewer branches the number of points goes as the inverse of theirs
_BRANCHES_OF_ONE_START = 120
#: direction, along no axis of symmetry, of the first step from a point without a slope
_FIRST_DIRECTION = np.array([1.0, 0.37, 0.22])
#: step, 1/d, after which the frequency is that of the extremum to rounding
_LAST_STEP = 1e-8
#: half the distance, 1/d, of the two wave vectors whose D(q) give the slope of D by difference
_SLOPE_STEP = 1e-4
#: singular value of the slopes of D between two branches, over the largest, up to which the
#: branches do not separate along its direction, as along a line of touching
_LEAST_SLOPE = 1e-6


class ZoneSample(NamedTuple):
    """A mesh of wave vectors, from which edges of bands are sought.

    Attributes
    ----------
    points : (n_q, p) wave vectors, fractions of the reciprocal cell.
    frequencies : (n_q, n_branches) frequencies at the points, (k/M)^1/2.
    spacing : the longest step of the mesh, 1/d.
    """

    points: Array
    frequencies: Array
    spacing: float


class Extremes(NamedTuple):
    """Extreme frequencies of e edges.

    Attributes
    ----------
    heights : (e,) frequencies, (k/M)^1/2, times the ``sign`` of the edges; the greatest found.
    points : (e, p) wave vectors, 1/d, of the extremes.
    """

    heights: Array
    points: Array


class BandEdges(NamedTuple):
    """The e edges of gaps between branches: first the tops of the branches below the gaps, in
    ascending order, then the bottoms of the branches above.

    The gap below the lowest branch has a bottom alone. A top is the greatest value of the
    frequency, and a bottom the greatest value of the negative frequency.

    Attributes
    ----------
    branch : (e,) number of the branch of each edge.
    sign : (e,) 1 for a top, -1 for a bottom.
    n_tops : number of tops.
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
        """Return the numbers (n,) of the tops whose branch is less than ``width`` below the bottom
        across the gap, or overlaps with the branch above by less than ``width``.

        ``heights`` (e,) are the extreme frequencies times ``sign``, in the unit of the width.
        """
        gap_widths = -heights[self.bottoms_of_tops] - heights[: self.n_tops]
        return np.flatnonzero(np.abs(gap_widths) < width)

    @property
    def bottoms_of_tops(self) -> Index:
        """The numbers (n_tops,) of the edges that are the bottoms across the gaps from the tops."""
        # these bottoms are the last edges; the bottom of a gap without a top is before them
        return np.arange(len(self.branch) - self.n_tops, len(self.branch))

    def pair(self, values: Array) -> tuple[Array, Array]:
        """Return those of the ``values`` (e, ...) of all edges that belong to the lower edges of
        the n gaps, and those of their upper edges, both (n, ...). The value at the lower edge of
        the gap below all branches is zero.
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
        """Return the outermost extreme found of each of the ``edges``: the highest of a top, the
        lowest of a bottom. Heights are frequencies, with the opposite sign for bottoms, so that
        paths climb to both.

        Paths start at the points of the mesh where the frequency comes nearest to the edge,
        ``most_starts`` at most for each edge. If a gap is narrow, crossings of its two branches are
        sought too, from these points and from those where the branches are closest; further paths
        start at the crossings.
        """
        starts = self._choose_starts(edges, most_starts)
        ends = self._climb_edges(edges, np.arange(len(starts)), starts)
        tops = edges.find_near(ends.heights, _TOUCHING_WIDTH * float(self.zone.frequencies.max()))
        if not tops.size:
            return ends
        bottoms = edges.bottoms_of_tops[tops]
        closest = self._find_closest(edges.branch[tops], _POINTS_PER_START * starts.shape[1])
        near_starts = np.concatenate([starts[tops], starts[bottoms], closest], axis=1)
        crossings, widths = self._approach_crossings(near_starts, edges.branch[tops])
        for numbers in (tops, bottoms):
            highest = self._choose_highest(edges, numbers, crossings, starts.shape[1])
            near_peaks = np.take_along_axis(crossings, highest[..., None], axis=1)
            longest_steps = np.take_along_axis(widths, highest, axis=1)
            peaks = self._climb_edges(edges, numbers, near_peaks, longest_steps)
            is_higher = peaks.heights > ends.heights[numbers]
            ends.heights[numbers[is_higher]] = peaks.heights[is_higher]
            ends.points[numbers[is_higher]] = peaks.points[is_higher]
        return ends

    def _choose_starts(self, edges: BandEdges, most_starts: int) -> Array:
        """Return the wave vectors (e, n_starts, p), 1/d, of the mesh at which frequencies come
        nearest to each of the e ``edges``, the nearest first; n_starts is ``most_starts`` or less.
        """
        frequencies = self.zone.frequencies
        n_starts = max(1, min(most_starts, _BRANCHES_OF_ONE_START // frequencies.shape[1]))
        return self._choose_points(-edges.sign * frequencies[:, edges.branch], n_starts)

    def _find_closest(self, branch: Index, count: int) -> Array:
        """Return wave vectors (n, count, p), 1/d, of the mesh at which each ``branch`` (n,) is
        closest to the branch above it, where peaks may be narrower than the mesh. There are fewer
        than ``count`` if the mesh has fewer points.
        """
        frequencies = self.zone.frequencies
        return self._choose_points(frequencies[:, branch + 1] - frequencies[:, branch], count)

    def _choose_points(self, depths: Array, count: int) -> Array:
        """Return wave vectors (n, count, p), 1/d, of the mesh at which the ``depths`` (n_q, n) are
        least, the least first; fewer than ``count`` if the mesh has fewer points.

        No two of the chosen points are neighbours on the mesh, which would lie about the same
        extreme, until all points are neighbours of chosen ones.
        """
        points = self.zone.points
        n_chosen = min(count, len(points))
        numbers_of_all = np.empty((depths.shape[1], n_chosen), int)
        neighbours_of: dict[int, Flags] = {}
        for numbers, depth in zip(numbers_of_all, depths.T, strict=True):
            order = np.argsort(depth, kind="stable")
            is_far = np.ones(len(points), bool)  # from all points chosen so far
            is_unchosen = is_far.copy()
            for n in range(n_chosen):
                candidates = order[is_far[order]]
                if not candidates.size:
                    candidates = order[is_unchosen[order]]
                number = int(candidates[0])
                numbers[n] = number
                is_unchosen[number] = False
                if number not in neighbours_of:
                    neighbours_of[number] = self._find_neighbours(points[number])
                is_far &= ~neighbours_of[number]
        return self.lattice.wavevectors(points[numbers_of_all])

    def _find_neighbours(self, point: Array) -> Flags:
        """Return (n_q,) whether each point of the mesh is a neighbour of a ``point`` (p,), in
        fractions, or of the opposite point, which has the same frequencies.
        """
        is_neighbour = np.zeros(len(self.zone.points), bool)
        for equivalent in (point, -point):
            step = self.zone.points - equivalent
            distance = np.linalg.norm(self.lattice.wavevectors(step - np.rint(step)), axis=1)
            is_neighbour |= distance < _NEIGHBOUR_DISTANCE * self.zone.spacing
        return is_neighbour

    def _choose_highest(self, edges: BandEdges, numbers: Index, points: Array, count: int) -> Index:
        """Return for each of the n ``edges`` that ``numbers`` (n,) select the indices (n, count) of
        the wave vectors among its ``points`` (n, n_points, p), 1/d, at which its height is
        greatest, the greatest first. The height is the frequency of the branch, times the sign of
        the edge.
        """
        n_edges, n_points, p = points.shape
        frequencies = self.lattice.frequencies(points.reshape(-1, p))
        by_edge = frequencies.reshape(n_edges, n_points, -1)
        branch = edges.branch[numbers]
        of_branch = np.take_along_axis(by_edge, branch[:, None, None], axis=2)[..., 0]
        heights = edges.sign[numbers, None] * of_branch
        return np.argsort(-heights, axis=1, kind="stable")[:, :count]

    def _climb_edges(
        self, edges: BandEdges, numbers: Index, starts: Array, widths: Array | None = None
    ) -> Extremes:
        """Return, for each of the edges of the ``numbers`` (n,), the highest of the extremes that
        are reached from its ``starts`` (n, n_starts, p), 1/d.

        Steps are no longer than the spacing of the mesh, and than ``widths`` (n, n_starts), 1/d, if
        these are given.
        """
        n_edges, n_starts, p = starts.shape
        branch = np.repeat(edges.branch[numbers], n_starts)
        sign = np.repeat(edges.sign[numbers], n_starts)
        longest = np.full(n_edges * n_starts, self.zone.spacing)
        if widths is not None:
            longest = np.minimum(longest, widths.ravel())
        ends = self._climb(starts.reshape(-1, p), branch, sign, longest)
        highest = np.argmax(ends.heights.reshape(n_edges, n_starts), axis=1)
        number = np.arange(n_edges) * n_starts + highest
        return Extremes(ends.heights[number], ends.points[number])

    def _climb(self, starts: Array, branch: Index, sign: Array, longest: Array) -> Extremes:
        """Return the extremes (n,) that n paths along group velocities reach from the wave vectors
        ``starts`` (n, p), 1/d: each is where the frequency of a ``branch`` (n,), times its
        ``sign`` (n,), is greatest on the path.

        Steps are those of J. Barzilai and J. M. Borwein (IMA J. Numer. Anal. 8, 141, 1988), and no
        longer than ``longest`` (n,), 1/d.
        """
        q = starts.copy()
        heights = np.full(len(q), -np.inf)
        points = q.copy()
        last_q = q.copy()
        last_slope = np.zeros_like(q)
        p = q.shape[1]
        direction = np.eye(p)[0]
        paths = np.arange(len(q))  # the numbers of the paths that still climb
        for turn in range(_MOST_STEPS):
            modes = self.lattice.modes(q[paths], direction)
            mode = (np.arange(paths.size), branch[paths])
            new_heights = sign[paths] * modes.frequencies[mode]
            is_higher = new_heights > heights[paths]
            heights[paths[is_higher]] = new_heights[is_higher]
            points[paths[is_higher]] = q[paths[is_higher]]
            slope = sign[paths, None] * modes.group_velocities[mode]
            steepness = np.linalg.norm(slope, axis=1)
            is_steep = steepness > 0.0
            longest_step = longest[paths]
            # unit vectors along the slopes; zero without a slope
            uphill = np.zeros_like(slope)
            np.divide(slope, steepness[:, None], out=uphill, where=is_steep[:, None])
            if turn == 0:
                # at a q equivalent to -q no branch has a slope, whether q is an extreme or a saddle
                uphill[~is_steep] = _FIRST_DIRECTION[:p] / np.linalg.norm(_FIRST_DIRECTION[:p])
                step = 0.5 * longest_step
            else:
                last_step = q[paths] - last_q[paths]
                unlimited_step = _secant_step(last_step, slope - last_slope[paths], steepness)
                step = np.minimum(unlimited_step, np.where(is_steep, longest_step, 0.0))
            last_q[paths] = q[paths]
            last_slope[paths] = slope
            q[paths] += step[:, None] * uphill
            paths = paths[step > _LAST_STEP]
            if not paths.size:
                break
        return Extremes(heights, points)

    def _approach_crossings(self, starts: Array, branch: Index) -> tuple[Array, Array]:
        """Return the wave vectors (n, n_starts, p), 1/d, at which each ``branch`` (n,) crosses the
        branch above or is closest to it, and the distances (n, n_starts), 1/d, over which the
        branches separate there; the search begins at ``starts`` (n, n_starts, p), 1/d.

        Between the modes of the two branches, D(q) is a 2 x 2 matrix. Its part without trace, which
        vanishes where the branches cross, is nearly linear in q. Gauss-Newton steps, no longer than
        the spacing of the mesh, lead to its zero or its least norm.
        """
        n, n_starts, p = starts.shape
        q = starts.reshape(-1, p).copy()
        lower = np.repeat(branch, n_starts)
        widths = np.zeros(len(q))
        searches = np.arange(len(q))  # the numbers of the searches that still move
        for _ in range(_MOST_CROSSING_STEPS):
            splitting, slopes = self._find_splitting(q[searches], lower[searches])
            step = -_solve_least(slopes, splitting)
            length = np.linalg.norm(step, axis=1)
            steepest = np.linalg.norm(slopes, axis=(1, 2))
            size = np.linalg.norm(splitting, axis=1)
            width = np.divide(size, steepest, out=np.zeros_like(size), where=steepest > 0.0)
            widths[searches] = width
            shortening = np.minimum(1.0, self.zone.spacing / np.maximum(length, _LAST_STEP))
            q[searches] += shortening[:, None] * step
            searches = searches[length > _LAST_STEP]
            if not searches.size:
                break
        return q.reshape(n, n_starts, p), widths.reshape(n, n_starts)

    def _find_splitting(self, q: Array, lower: Index) -> tuple[Array, Array]:
        """Return the part without trace (n, 3), k/M, of the 2 x 2 matrix of D between the branches
        ``lower`` (n,) and those above, at wave vectors ``q`` (n, p), 1/d, and its derivatives
        (n, 3, p), k d/M, with respect to q.

        The three components are the coefficients of Pauli's matrices.
        """
        p = q.shape[1]
        modes = self.lattice.modes(q, np.eye(p)[0])
        numbers = np.arange(len(q))
        squared = modes.frequencies**2
        # D is diagonal in its modes
        splitting = np.zeros((len(q), 3))
        splitting[:, 2] = 0.5 * (squared[numbers, lower] - squared[numbers, lower + 1])
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
        return splitting, slopes


def _solve_least(matrices: Array, values: Array) -> Array:
    """Return the shortest of the vectors (n, p) whose products with ``matrices`` (n, 3, p) are
    nearest to ``values`` (n, 3).
    """
    inverses = np.linalg.pinv(matrices, rcond=_LEAST_SLOPE)  # (n, p, 3)
    return np.asarray((inverses @ values[..., None])[..., 0])


def _secant_step(last_step: Array, change: Array, steepness: Array) -> Array:
    """Return the lengths (n,), 1/d, of steps along slopes of size ``steepness`` (n,) that would
    reach the top of a parabola; zero if the slope has not changed.

    The curvature of the parabola is that by which the slope changed by ``change`` (n, p) over the
    ``last_step`` (n, p), 1/d.
    """
    # the curvature times the square of the step, and that square
    bend = np.abs(np.sum(last_step * change, axis=1))
    square = np.sum(last_step**2, axis=1)
    lengths = np.zeros(len(bend))
    np.divide(square * steepness, bend, out=lengths, where=bend > 0.0)
    return lengths
