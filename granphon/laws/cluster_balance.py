"""The equations of the cluster medium at one overlap, and their solution for random realisations of
a cluster.

Everything is in the reduced units of Section IV. A cluster of random balls sits in the effective
lattice, whose contacts have the mean force f and the stiffness kappa, and are linear; so are all
contacts of the array but for the tensions

    phi_c = (h_c)_+^(3/2) - f - kappa (h_c - y)

by which their forces, those of Hertz's law, differ. With the misfits s and the response P
(:mod:`granphon.dynamics.cluster_response`) the equilibrium of the whole array is h = y + s - P
phi/kappa. Inside the cluster it is solved as it stands. Outside, phi is not known: there it is
taken as independent from contact to contact, of mean zero and of the variance that it has inside.
It pushes the cluster by -P phi/kappa, which is taken as normal with the covariance tau^2 R, R being
``remote`` and tau = phi_rms/kappa. So

    h = y + s + tau m - P phi/kappa

in the cluster, and three conditions find f, kappa and tau:

    <(h)_+^(3/2)> = f           the mean force in the cluster is that of the lattice: then <h> = y
    <phi s> = 0                 forces and misfits go together as in the lattice:
                                kappa = <(F - f) s>/<h s>
    <phi^2> = kappa^2 tau^2     contacts inside and outside are alike

with means over the contacts of the cluster and over realisations. The second is chosen so that what
is not known outside depends on the misfits as little as it can. (Without push and with kappa =
df/dy the force is 2 % too large at a* = 0.7, and 30 % at a* = 0.5.) The equilibrium of a
realisation is the least of a convex function of w, with P = B B^T and h = y + s + tau m - B w.
Balls inside can move without the lattice, so that a ball without contacts may be anywhere in its
cage; a stiffness of 1e-6 kappa holds it.

The force of the law is the mean over the contacts of the ball in the middle. That of the contacts
at the rim, which are included in f, is larger, as what they touch outside is linear: at a* = 0.6 by
1.5 % with seven balls.

Newton's method solves all three at once, and the realisations with them. Its last matrix gives the
change of f, kappa and tau with y, hence k = df/dy, with f and kappa varied too.

A realisation is a point of the unit cube. Its first coordinates give the deviations of the balls of
the cluster and of those that touch it, by the quantiles of their distribution. The many balls
farther off add up to normal deviates with what is left of the covariance; so does the push of
contacts outside, which is known up to its size. The points are Sobol's, scrambled, each with its
antithetic one. Independent scrambles are kept apart, and from their differences follows the error
of every mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.diameters import Shape
from granphon.balls.hertz import COUNTED_FORCE
from granphon.base.arrays import Array
from granphon.base.errors import PrecisionError
from granphon.base.results import read_only
from granphon.base.threads import share_out
from granphon.dynamics.cluster_response import ClusterResponse

#: of single or double precision
Floats = NDArray[Any]
#: variance of the deviations in widths W, by the definition of W
_VARIANCE = 1.0 / 12.0
#: eigenvalues of a covariance below this are rounding
_LEAST = 1e-9
#: least number of points for each direction of the covariance: half of them are mirror images
_POINTS_PER_DIRECTION = 2.5
#: least variance of a direction before it is stretched, over what it is to be
_LEAST_VARIANCE = 0.02
#: binary digits of a coordinate
_DIGITS = 30
#: most points of a scramble
_MOST_POINTS = 2**13
#: stiffness over kappa by which balls without contacts are held
_HOLD = 1e-6
#: largest relative change of f and kappa in the last iteration: convergence is quadratic
_SETTLED = 1e-5
#: largest force that is not balanced on a mode of a cluster, over f and over kappa W
_BALANCED = 1e-8
#: numbers in the matrices that are worked on at a time
_AT_ONCE = 2**18


class PointSource:
    """Randomised sets of realisations for a cluster and a distribution.

    Each is scrambled by itself. Of ``many`` sets each is a random shift of the same points, in
    single precision: it takes a fraction of the time, and its scatter is hardly larger.
    """

    def __init__(self, response: ClusterResponse, shape: Shape, many: bool = False) -> None:
        from scipy.linalg import block_diag

        near = response.influence
        far = _root(_VARIANCE * (response.misfit - near @ near.T))
        push = _root(response.remote)
        self._contacts, self._near = near.shape
        root = _root(np.asarray(block_diag(_VARIANCE * response.misfit, push @ push.T)))
        both = block_diag(np.hstack([np.sqrt(_VARIANCE) * near, far]), push)
        #: deviates give uncorrelated parts of the realisations, and these the realisations
        self._dtype: type[np.floating] = np.float32 if many else np.float64
        self._parts = (np.linalg.pinv(root) @ both).T.astype(self._dtype)
        self._root = root
        self._shape = shape
        self._many = many

    def draw(self, seeds: Sequence[int | list[int]], points: int) -> list[tuple[Floats, Floats]]:
        """Draw a set of ``points`` for each seed, a power of two, half of them antithetic: misfits
        and pushes (n, n_c).

        Misfits are in widths W; pushes have the covariance ``remote`` of the response, and must be
        multiplied by their size. In each set the mean is zero, and the covariance that of the
        infinite array, exactly. There are more points, if as many do not fix the covariance. Raises
        :class:`~granphon.base.errors.PrecisionError` for a distribution with so rare a kind of
        balls that even many more do not.
        """
        points = max(points, 2 ** math.ceil(math.log2(_POINTS_PER_DIRECTION * self._root.shape[1])))
        most = max(points, _MOST_POINTS)
        while points <= most:
            sets = [one for seed in seeds if (one := self._draw(seed, points)) is not None]
            if len(sets) == len(seeds):
                return sets
            points *= 2
        what = "the cluster medium does not hold balls of so rare a kind"
        raise PrecisionError(
            what, mend="Use the effective medium, or leave the rarest diameters out"
        )

    def _draw(self, seed: int | list[int], points: int) -> tuple[Floats, Floats] | None:
        """Draw a set of so many points, or return None if too few are of a rare kind."""
        from scipy.special import ndtri

        size = len(self._parts), points // 2
        if self._many:
            # the same points with a random shift of their binary digits
            shift = np.random.default_rng(seed).integers(0, 2**_DIGITS, size[0], dtype=np.uint32)
            cube = np.asarray((_find_net(*size) ^ shift) * 2.0**-_DIGITS)
        else:
            cube = _scramble(*size, seed)
        cube = cube + 0.5 ** (_DIGITS + 1)  # in the middle of their cells: in the open cube
        near = cube[:, : self._near]
        one, other = (
            self._shape.quantile(part) / np.sqrt(_VARIANCE) for part in (near, 1.0 - near)
        )
        # of a point and its mirror image, half of the difference and of the sum: the sum of a
        # symmetric distribution is zero
        odd = np.empty(cube.shape, self._dtype)
        odd[:, : self._near] = 0.5 * (one - other)
        odd[:, self._near :] = ndtri(cube[:, self._near :])
        even = 0.5 * (one + other)
        # uncorrelated parts of the realisations; where no ``even`` is left it is zero
        lopsided = (
            even.astype(self._dtype) @ self._parts[: self._near]
            if np.any(np.abs(even) > _LEAST)
            else None
        )
        odd = odd @ self._parts
        covariance = (odd.T @ odd).astype(float)
        if lopsided is not None:
            lopsided -= lopsided.mean(axis=0, dtype=float).astype(lopsided.dtype)
            covariance += lopsided.T @ lopsided
        covariance /= len(odd)
        try:
            # it has a factor if all directions vary more than that
            np.linalg.cholesky(covariance - _LEAST_VARIANCE * np.eye(len(covariance)))
        except np.linalg.LinAlgError:
            return None
        # so stretched that the covariance is root root^T: even + odd, then even - odd
        stretch = np.linalg.solve(np.linalg.cholesky(covariance).T, self._root.T).astype(odd.dtype)
        found = np.empty((2 * len(odd), len(self._root)), odd.dtype)
        np.matmul(odd, stretch, out=found[: len(odd)])
        np.negative(found[: len(odd)], out=found[len(odd) :])
        if lopsided is not None:
            found.reshape(2, len(odd), -1)[:] += lopsided @ stretch
        return found[:, : self._contacts], found[:, self._contacts :]


def _scramble(dimensions: int, points: int, seed: int | list[int]) -> Array:
    """Return scrambled Sobol points (points, dimensions) of the unit cube, multiples of 2^-30."""
    from scipy.stats import qmc

    return np.asarray(
        qmc.Sobol(dimensions, scramble=True, bits=_DIGITS, seed=np.random.default_rng(seed)).random(
            points
        )
    )


@lru_cache(maxsize=8)
def _find_net(dimensions: int, points: int) -> NDArray[np.uint32]:
    """Return the points that others are shifts of, (points, dimensions), as whole numbers of 30
    binary digits.
    """
    return read_only((_scramble(dimensions, points, 0) * 2.0**_DIGITS).astype(np.uint32))


def _root(covariance: Array) -> Array:
    """Return A (n, r) of full rank with A A^T = ``covariance``, the largest parts first."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _LEAST
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept]))[:, ::-1])


@dataclass(frozen=True, eq=False)
class Balance:
    """Solution at the overlap ``y``: ``effective`` (3,), which are f, kappa and tau, their
    ``slopes`` (3,), and the ball.

    ``force`` is the mean force on the contacts of the ball in the middle, ``stiffness`` its slope
    over y, ``error`` its standard error from the quadrature, over the force; ``fluctuation`` the
    rms deviation of the mean force on the ball, over the force; ``contacts`` the part of its
    contacts that carry force. ``realisations`` (n,) are the forces that these are means of, with
    what each realisation misses of the conditions: ``influence`` (3,) is what a unit missing takes
    off the force, and ``matrix`` (3, 3) has the derivatives of what is missing with f, kappa and
    tau.
    """

    y: float
    effective: Array
    slopes: Array
    force: float
    stiffness: float
    error: float
    fluctuation: float
    contacts: float
    realisations: Array
    influence: Array
    matrix: Array


class ClusterBalance:
    """Realisations of a cluster, in equilibrium at one overlap after another; it keeps their last
    equilibrium.

    ``sets`` are what a :class:`PointSource` draws, and each set tells the error of the quadrature.
    ``modes`` (n_c, r) is B, whose columns are orthogonal, and ``values`` (r,) the eigenvalues of P,
    their squared lengths.
    """

    def __init__(self, response: ClusterResponse, sets: Sequence[tuple[Floats, Floats]]) -> None:
        self.response = response
        self.sets = len(sets)
        self.misfits, self.pushes = (np.concatenate(part) for part in zip(*sets, strict=True))
        values, vectors = np.linalg.eigh(response.response)
        kept = values > _HOLD
        self.modes = np.asarray(vectors[:, kept] * np.sqrt(values[kept]))
        self.values = np.asarray(values[kept])
        self._rest = np.diag(1.0 + _HOLD - self.values)
        #: B_ca B_cb, which a matrix of second derivatives is a sum of, (n_c, r^2)
        self._squares = (self.modes[:, :, None] * self.modes[:, None, :]).reshape(
            len(self.modes), -1
        )
        self._w = np.zeros((len(self.misfits), self.modes.shape[1]))
        size = max(1, _AT_ONCE // self.modes.shape[1] ** 2)
        self._parts = [slice(i, i + size) for i in range(0, len(self._w), size)]
        #: change of w with f, kappa, tau and y
        self._changes = np.zeros((*self._w.shape, 4))

    def step(self, before: Balance, y: float) -> Balance:
        """Go from one overlap to another: follow the slopes, then iterate."""
        up = y - before.y
        moved = np.maximum(before.effective + before.slopes * up, 0.5 * before.effective)
        self._w += self._changes[..., :3] @ (moved - before.effective) + self._changes[..., 3] * up
        return self.solve(y, moved)

    def solve(self, y: float, start: ArrayLike) -> Balance:
        """Solve at the overlap y, from an estimate (3,) of f, kappa and tau.

        Raises :class:`~granphon.base.errors.PrecisionError` if it does not settle.
        """
        now = np.array(start, float)
        for _ in range(40):
            f, kappa, tau = now.tolist()
            misses, slopes, squares, balls, closed = zip(
                *share_out(partial(self._linearise, y, (f, kappa, tau)), self._parts), strict=True
            )
            # the derivatives (4, 4) of the conditions, and of the mean force on the ball, with f,
            # kappa, tau and y
            by = np.asarray(
                sum(by * len(miss) for by, miss in zip(slopes, misses, strict=True)) / len(self._w)
            )
            # the third condition is for the root of the mean square, in which it is nearly linear
            rms = np.sqrt(sum(squares) / len(self._w))
            by[2] = by[2] / (2.0 * rms) - [0.0, tau, kappa, 0.0]
            by[0, 0] -= 1.0
            # what the conditions miss in each realisation (n, 3), and that force in each (n,)
            miss = np.concatenate(misses)
            ball = np.concatenate(balls)
            miss[:, 2] = (miss[:, 2] - rms**2) / (2.0 * rms) + rms
            miss -= [f, 0.0, tau * kappa]
            matrix = by[:3, :3]
            by_lattice = by[3, :3]
            change = -np.linalg.solve(matrix, np.mean(miss, axis=0))
            ratio = np.abs(change / now)[:2]
            change *= min(1.0, 0.5 / float(np.max(ratio)))
            now = now + change
            self._w += self._changes[..., :3] @ change
            if not np.all(np.isfinite(now)):
                break
            if np.max(ratio) >= _SETTLED:
                continue
            # ``now`` is a last small change away from where the conditions were evaluated
            slope = -np.linalg.solve(matrix, by[:3, 3])
            force = float(np.mean(ball) + by_lattice @ change)
            # each scramble alone: its own mean, in its own effective lattice
            influence = np.linalg.solve(matrix.T, by_lattice)
            realisations = np.asarray(ball - miss @ influence, float)
            off = np.mean(realisations.reshape(self.sets, -1), axis=1)
            error = float(np.std(off, ddof=1) / np.sqrt(off.size)) if off.size > 1 else np.nan
            return Balance(
                y,
                now,
                slope,
                force,
                float(by[3, 3] + by_lattice @ slope),
                error / force,
                float(np.std(ball)) / force,
                float(np.mean(np.concatenate(closed))),
                realisations,
                np.asarray(influence, float),
                matrix,
            )
        raise PrecisionError(
            f"the cluster medium does not settle at an overlap of {y:.6g} widths",
            mend="Raise the load",
        )

    def _stiffen(self, slopes: Array, stiffness: float) -> Array:
        """Return the matrices (n, r, r) of second derivatives, from the stiffness of each
        contact.
        """
        return np.asarray(
            stiffness * self._rest
            + (slopes @ self._squares).reshape(len(slopes), *self._rest.shape)
        )

    def relax(self, y: float, effective: Sequence[float], part: slice = slice(None)) -> Array:
        """Bring realisations into equilibrium in a given lattice, by Newton's method with a line
        search.

        Returns the overlaps h (n, n_c) of their contacts.
        """
        f, kappa, tau = effective
        modes = self.modes
        rounding = 1e-15 * len(modes) * (f + kappa) * (1.0 + abs(y))

        def energy(w: Array, fixed: Array) -> Array:
            h = fixed - w @ modes.T
            closed = np.maximum(h, 0.0)
            own = 0.4 * closed**2 * np.sqrt(closed) - f * h - 0.5 * kappa * (h - y) ** 2
            return np.asarray(
                0.5 * (1.0 + _HOLD) * kappa * np.sum(w * w, axis=1) + np.sum(own, axis=1)
            )

        free = y + self.misfits[part] + tau * self.pushes[part]
        going = np.arange(*part.indices(len(self._w)))
        w = self._w[going]
        fixed = free
        for _ in range(200):
            h = fixed - w @ modes.T
            closed = np.maximum(h, 0.0)
            root = np.sqrt(closed)
            pull = (1.0 + _HOLD) * kappa * w - (closed * root - f - kappa * (h - y)) @ modes
            left = np.max(np.abs(pull), axis=1) > _BALANCED * min(f, kappa)
            if not np.any(left):
                return np.asarray(free - self._w[part] @ modes.T)
            going = going[left]
            w = w[left]
            fixed = fixed[left]
            pull = pull[left]
            step = np.linalg.solve(self._stiffen(1.5 * root[left], kappa), pull[..., None])[..., 0]
            length = np.ones(len(w))
            work = np.sum(pull * step, axis=1)
            before = energy(w, fixed)
            for _ in range(30):
                rising = (
                    energy(w - length[:, None] * step, fixed)
                    > before - 1e-4 * length * work + rounding
                )
                if not np.any(rising):
                    break
                length[rising] *= 0.4
            w = w - length[:, None] * step
            self._w[going] = w
        raise PrecisionError(
            f"a cluster finds no equilibrium at an overlap of {y:.6g} widths", mend="Raise the load"
        )

    def _linearise(
        self, y: float, effective: Sequence[float], part: slice
    ) -> tuple[Array, Array, float, Array, Array]:
        """Bring some realisations into equilibrium, and return what they add to the conditions; it
        keeps the changes of w.

        That is the mean force, <phi s> and <phi^2> of each (n, 3); the derivatives (4, 4) of their
        means, and of the mean force on the ball in the middle, with f, kappa, tau and y; the sum of
        <phi^2>; that force in each (n,); and the part of the ball's contacts that carry force (n,).
        """
        f, kappa, _ = effective
        h = self.relax(y, effective, part)
        modes = self.modes
        s = self.misfits[part]
        m = self.pushes[part]
        w = self._w[part]
        closed = np.maximum(h, 0.0)
        root = np.sqrt(closed)
        force = closed * root
        slope = 1.5 * root
        off = h - y
        phi = force - f - kappa * off
        # derivatives of the pull on each mode at fixed w, and of h and the force at fixed w
        pulls = np.stack(
            [
                np.broadcast_to(modes.sum(axis=0), w.shape),
                (1.0 + _HOLD) * w + off @ modes,
                -((slope - kappa) * m) @ modes,
                -slope @ modes,
            ],
            axis=-1,
        )
        moved = -np.linalg.solve(self._stiffen(slope, kappa), pulls)
        self._changes[part] = moved
        by_off = -np.matmul(modes, moved)
        by_off[..., 2] += m
        by_force = slope[..., None] * by_off
        by_force[..., 3] += slope
        by_phi = by_force - kappa * by_off
        by_phi[..., 0] -= 1.0
        by_phi[..., 1] -= off
        n = s.size
        by = np.stack(
            [
                by_force.mean(axis=(0, 1)),
                np.einsum("ncp,nc->p", by_phi, s) / n,
                2.0 * np.einsum("ncp,nc->p", by_phi, phi) / n,
                by_force[:, self.response.central].mean(axis=(0, 1)),
            ]
        )
        square = np.mean(phi**2, axis=1)
        miss = np.stack([force.mean(axis=1), np.mean(phi * s, axis=1), square], axis=1)
        central = force[:, self.response.central]
        return (
            miss,
            by,
            float(np.sum(square)),
            central.mean(axis=1),
            np.mean(central > COUNTED_FORCE * f, axis=1),
        )
