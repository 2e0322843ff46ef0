"""Many realisations of a cluster, each nearly in equilibrium: they take most of the quadrature
error off the few that are.

An equilibrium to rounding takes a dozen factorised matrices. A fixed number of steps of descent
with momentum takes a hundredth of that, and comes so near that what is left hardly differs from one
realisation to another. So means are found in three levels (the multilevel method of Giles,
Operations Research 56, 607 (2008)), each with points of its own: many realisations after a short
descent; what a long descent adds, of fewer; and what equilibrium adds, of the few that are in it.
What a descent is off cancels: nothing is left of it but the scatter of the differences, which is in
the error.

Sets of points are drawn until the error is as small as it is to be, by as many threads as there are
processors. The few realisations have found the effective lattice with an error of their own. The
long descents correct it first, so that its square, which the conditions do not take off, is
nothing. That is done at some overlaps only. At those between a survey, of the same points at all of
them, says how the means go.

Descent is Polyak's heavy ball, x' = x - G g(x) + beta (x - x_before), for the energy of the cluster
in its modes, with the stiffness of each as if all contacts had one, L: G_a = 1/(kappa (1 -
lambda_a) + L lambda_a). It begins in the effective lattice, w = 0, where h = y + s + tau m. In the
overlaps, of which w is a linear function, a step is a single product, h' = b + M (L h - h_+^(3/2))
+ beta (h - h_before) with M = B G B^T.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from granphon.balls.diameters import Shape
from granphon.balls.hertz import COUNTED_FORCE
from granphon.base.arrays import Array
from granphon.base.threads import share_out
from granphon.laws.cluster_balance import Balance, ClusterBalance, PointSource

Single = NDArray[np.float32]
#: number of steps of a short descent; its overlaps are within 1e-2 of the rms of the equilibrium's
_SHORT = 15
#: number of steps of a descent of a survey
_MIDDLE = 25
#: number of steps of a long descent; its overlaps are within 1e-4 of the rms of the equilibrium's
_LONG = 50
#: part of the last step that is added to the next one
_MOMENTUM = 0.7
#: overlaps above the mean, over their rms, of the contacts whose stiffness is that of a step
_STIFF = 0.25
#: numbers that are worked on at a time
_AT_ONCE = 2**15
#: least number of points of a set
_LEAST_SET = 2**11
#: most points of a set, where many sets are needed
_MOST_SET = 2**14
#: contacts of all points of a set that is the same for all solutions
_FIRST = 2**18
#: least number of sets of a level
_LEAST_SETS = 16
#: number of sets that is aimed at: as many as leave a good estimate of their scatter
_AIM_SETS = 64
#: most sets of a level
MOST_SETS = 512
#: part of the sets that are still to be drawn by an estimate, of which some are drawn before the
#: next estimate
_NEXT = 0.9
#: where a realisation has what the conditions miss
_MISS = slice(4, 7)
#: part of the error that long descents may leave
_LONG_SHARE = 0.4


class ClusterDescent:
    """Realisations of a cluster without number, which correct the solutions of a ``balance`` of
    few.

    Descents of another ``seed`` share no point.
    """

    def __init__(self, balance: ClusterBalance, shape: Shape, seed: int = 0) -> None:
        self._values = balance.values
        self._vectors = balance.modes / np.sqrt(balance.values)
        self._central = central = balance.response.central
        #: weights of the mean over all contacts, and over those of the ball in the middle
        self._weights = np.stack(
            [np.full(len(central), 1.0 / len(central)), central / np.count_nonzero(central)], axis=1
        ).astype(np.float32)
        self._source = PointSource(balance.response, shape, many=True)
        self._seed = seed
        # of a small cluster, of which a realisation takes less time, there are more
        points = max(_LEAST_SET, 2 ** int(np.log2(_FIRST / len(central))))
        #: sets that are the same for all solutions
        self._first = self._source.draw(
            [[seed, 0, number] for number in range(_LEAST_SETS)], points
        )
        self._few = balance.misfits.astype(np.float32), balance.pushes.astype(np.float32)
        self._half = len(balance.misfits) // balance.sets // 2

    def evaluate_first(self, found: Balance, steps: tuple[int, ...] = (_MIDDLE, _LONG)) -> Array:
        """Return means (len(steps), sets, 7) of a survey after so many steps: of a few sets, the
        same for all solutions.
        """
        means = share_out(
            lambda one: self._evaluate(found, found.effective, one, steps).mean(axis=1), self._first
        )
        return np.stack(means, axis=1)

    def survey(self, found: Sequence[Balance], counts: Sequence[int], start: int) -> Array:
        """Return means (sets, n, 4) of n solutions after a middle descent, of sets of points from
        the ``start`` on.

        Sets are the same for all solutions. A solution has so many as ``counts`` says, and zeros
        for those beyond.
        """

        def evaluate(number: int) -> Array:
            (points,) = self._source.draw([[self._seed, 0, number]], len(self._first[0][0]))
            means = np.zeros((len(found), 4))
            for row, one, count in zip(means, found, counts, strict=True):
                if number < count:
                    row[:] = np.mean(
                        self._evaluate(one, one.effective, points, (_MIDDLE,))[0, :, :4], axis=0
                    )
            return means

        return np.array(share_out(evaluate, range(start, max(counts)))).reshape(-1, len(found), 4)

    def refine(self, found: Balance, goal: float, number: int) -> tuple[Array, float, Array]:
        """Find means so good that the force has a relative standard error of ``goal``, if the most
        points that there are do.

        Most points are those of the ``number``, from 1 on: no two share any of these. Returns means
        (4,), the standard error of their first, and the means (2, sets, 4) of a survey after a
        middle and a long descent. They are the force on the ball in the middle, in the lattice that
        the conditions ask for; this force in a lattice that is nearly that one, its square, and the
        part of the contacts that carry force.
        """
        bound = goal * found.force
        few = self._evaluate(found, found.effective, self._few, (_LONG,))[0]
        # a realisation and its antithetic one are no two, but all else that the points do for the
        # few is not counted
        pairs = np.mean((found.realisations - few[:, 0]).reshape(-1, 2, self._half), axis=1).ravel()
        variance = float(np.var(pairs, ddof=1)) / pairs.size
        first = self.evaluate_first(found, (_SHORT, _MIDDLE, _LONG))
        least = max(_LONG_SHARE * bound, 0.5 * np.sqrt(variance))
        points = len(self._first[0][0])
        start, end = self._sample(
            found, found.effective, (_SHORT, _LONG), least, [number, 1], points, first[::2]
        )
        variance += _find_variance(end - start)
        miss = np.mean(end, axis=0) - np.mean(few, axis=0)
        now = found.effective - np.linalg.solve(found.matrix, miss[_MISS])
        left = np.sqrt(max(bound**2 - variance, 0.25 * variance))
        # sets are larger where there are many
        wanted = points * start.shape[0] * _find_variance(start) / left**2 / _AIM_SETS
        points = int(np.clip(2.0 ** np.floor(np.log2(wanted)), _LEAST_SET, _MOST_SET))
        (many,) = self._sample(found, now, (_SHORT,), left, [number, 0], points)
        variance += _find_variance(many)
        equal = [
            found.force,
            found.force,
            found.force**2 * (1.0 + found.fluctuation**2),
            found.contacts,
        ]
        means = (
            np.mean(many[:, :4], axis=0)
            + np.mean(end - start, axis=0)[:4]
            + equal
            - np.mean(few, axis=0)[:4]
        )
        return means, float(np.sqrt(variance)), first[1:, :, :4]

    def _sample(
        self,
        found: Balance,
        now: Array,
        steps: tuple[int, ...],
        bound: float,
        number: list[int],
        points: int,
        known: Array | None = None,
    ) -> Array:
        """Return means of sets (len(steps), sets, 7), so many that their force has an error of
        ``bound``.

        With two numbers of steps it is that of the difference. Sets are those ``known``, and more
        of so many ``points``.
        """

        def draw(place: int) -> Array:
            (some,) = self._source.draw([[self._seed, *number, place]], points)
            return np.asarray(np.mean(self._evaluate(found, now, some, steps), axis=1))

        sets = [] if known is None else list(known.swapaxes(0, 1))
        wanted = _LEAST_SETS
        while True:
            sets += share_out(draw, range(len(sets), wanted))
            means = np.stack(sets, axis=1)
            over = _find_variance(means[-1] - means[0] if len(steps) > 1 else means[0]) / bound**2
            if len(sets) >= MOST_SETS or over <= 1.0:
                return means
            # with some left for the next estimate: this one is not exact
            wanted = min(max(len(sets) + 4, math.ceil(_NEXT * over * len(sets))), MOST_SETS)

    def _evaluate(
        self, found: Balance, now: Array, points: tuple[Single, Single], steps: tuple[int, ...]
    ) -> Array:
        """Return for each realisation (len(steps), n, 7), after so many steps, what the solution
        has means of.

        First is the force on the ball in the middle less what the conditions miss, as their
        ``influence`` says; then that force alone, its square, the part of its contacts that carry
        force, and the three that the conditions miss.
        """
        y = found.y
        (f, kappa, tau) = now.tolist()
        misfits, pushes = points
        n_c = len(self._weights)
        size = max(1, _AT_ONCE // n_c)
        rows = np.empty((len(steps), len(misfits), 7))
        for start in range(0, len(misfits), size):
            part = slice(start, start + size)
            for row, h in zip(
                rows, self._descend(y, now, misfits[part], pushes[part], steps), strict=True
            ):
                closed = np.maximum(h, np.float32(0.0))
                force = closed * np.sqrt(closed)
                phi = force - np.float32(f) - np.float32(kappa) * (h - np.float32(y))
                mean, ball = (force @ self._weights).T.astype(float)
                pull, square = (
                    np.einsum("nc,nc->n", phi, one) / n_c for one in (misfits[part], phi)
                )
                miss = np.stack(
                    [mean - f, pull, (square - (kappa * tau) ** 2) / (2.0 * kappa * tau)], axis=1
                )
                contacts = np.mean(force[:, self._central] > COUNTED_FORCE * f, axis=1)
                row[part, : _MISS.start] = np.stack(
                    [ball - miss @ found.influence, ball, ball**2, contacts], axis=1
                )
                row[part, _MISS] = miss
        return rows

    def _descend(
        self, y: float, now: Array, misfits: Single, pushes: Single, steps: tuple[int, ...]
    ) -> Iterator[Single]:
        """Yield the overlaps h (n, n_c) after so many steps."""
        f, kappa, tau = now.tolist()
        free = misfits + np.float32(tau) * pushes
        stiff = 1.5 * np.sqrt(max(y, 0.0) + _STIFF * float(np.std(free)))
        move = (
            self._vectors * (self._values / (kappa * (1.0 - self._values) + stiff * self._values))
        ) @ self._vectors.T
        # with x = h / L^2 it is L h - h^(3/2) = L^3 x (1 - x^(1/2))
        unit = np.float32(stiff**2)
        begin = (free + np.float32(y)) / unit
        pull = np.float32((stiff - kappa) / unit) * free + np.float32((stiff * y - f) / unit)
        fixed = begin - pull @ move.astype(np.float32)
        move = (-stiff * move).astype(np.float32)
        # all in place: new arrays would take longer than what is done to them
        x = begin
        before = begin.copy()
        after = np.empty_like(begin)
        root = np.empty_like(begin)
        for step in range(1, steps[-1] + 1):
            np.maximum(x, np.float32(0.0), out=root)
            np.sqrt(root, out=root)
            root -= np.float32(1.0)
            root *= x
            np.matmul(root, move, out=after)
            np.subtract(x, before, out=before)
            before *= np.float32(_MOMENTUM * step / (step + 3.0))
            after += before
            after += fixed
            x, before, after = after, x, before
            if step in steps:
                yield x * unit


def _find_variance(means: Array) -> float:
    """Return the variance of the mean force over sets."""
    return float(np.var(means[:, 0], ddof=1)) / len(means)
