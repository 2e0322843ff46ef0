"""The equations of the cluster medium at one overlap, and their solution.

Everything is in the reduced units of Section IV. A cluster of random balls sits in the effective lattice, whose contacts
have the mean force f and the stiffness kappa, and are linear; so are all contacts of the array but for the tensions

    phi_c = (h_c)_+^(3/2) - f - kappa (h_c - y)

by which their forces differ. With the misfits s and the response P (:mod:`granphon.dynamics.cluster_response`) the
equilibrium of the whole array is h = y + s - P phi/kappa. Inside the cluster it is solved as it stands. Outside, phi is not
known: there it is taken as independent from contact to contact, of mean zero and of the variance that it has inside. It
pushes the cluster by -P phi/kappa, which is taken as normal with the covariance tau^2 R, R being ``remote`` and
tau = phi_rms/kappa. So

    h = y + s + tau m - P phi/kappa

in the cluster, and three conditions find f, kappa and tau:

    <(h)_+^(3/2)> = f           the mean force in the cluster is that of the lattice: then <h> = y
    <phi s> = 0                 forces and misfits go together as in the lattice: kappa = <(F - f) s>/<h s>
    <phi^2> = kappa^2 tau^2     contacts inside and outside are alike

with means over the contacts of the cluster and over realisations. The second is chosen so that what is not known outside
depends on the misfits as little as it can. (Without push and with kappa = df/dy the force is 2 % too large at a* = 0.7, and
30 % at a* = 0.5.) The equilibrium of a realisation is the least of a convex function of w, with P = B B^T and
h = y + s + tau m - B w. Balls inside can move without the lattice, so that a ball without contacts may be anywhere in its
cage; a stiffness of 1e-6 kappa holds it.

The force of the law is the mean over the contacts of the ball in the middle. That of the contacts at the rim, which are
included in f, is larger, as what they touch outside is linear: at a* = 0.6 by 1.5 % with seven balls.

Newton's method solves all three at once, and the realisations with them. Its last matrix gives the change of f, kappa and
tau with y, hence k = df/dy, with f and kappa varied too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import PrecisionError, message
from granphon.base.threads import share_out
from granphon.dynamics.cluster_response import ClusterResponse
from granphon.laws.cluster_points import ClusterPoints

Array = NDArray[np.float64]
#: stiffness over kappa by which balls without contacts are held
_HOLD = 1e-6
#: largest relative change of f and kappa in the last iteration: convergence is quadratic
_SETTLED = 1e-5
#: largest force that is not balanced on a mode of a cluster, over f and over kappa W
_BALANCED = 1e-8
#: numbers in the matrices that are worked on at a time
_AT_ONCE = 2**18
#: part of the mean force below which a contact does not count, as in a simulation
LEAST_CONTACT = 1e-6


class Effective(NamedTuple):
    """Mean force f, stiffness kappa and size tau of the push from outside, reduced."""

    force: float
    stiffness: float
    push: float


@dataclass(frozen=True, eq=False)
class Balance:
    """Solution at the overlap ``y``: the effective lattice, the slopes of f, kappa and tau over y, and the middle ball.

    ``force`` is the mean force on that ball's contacts, ``stiffness`` its slope over y, ``error`` its standard error from
    the quadrature, over the force; ``fluctuation`` the rms deviation of the mean force on the ball, over the force;
    ``contacts`` the part of its contacts that carry force. ``realisations`` (n,) are the forces that these are means of,
    with what each realisation misses of the conditions: ``influence`` (3,) is what a unit missing takes off the force, and
    ``matrix`` (3, 3) has the derivatives of what is missing with f, kappa and tau.
    """

    y: float
    effective: Effective
    slopes: Effective
    force: float
    stiffness: float
    error: float
    fluctuation: float
    contacts: float
    realisations: Array
    influence: Array
    matrix: Array


def find_modes(response: ClusterResponse) -> tuple[Array, Array]:
    """Return B (n_c, r) with P = B B^T and orthogonal columns, and the eigenvalues (r,) of P, their squared lengths."""
    values, vectors = np.linalg.eigh(response.response)
    kept = values > _HOLD
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept])), np.asarray(values[kept])


class ClusterBalance:
    """Realisations of a cluster, in equilibrium at one overlap after another; it keeps their last equilibrium."""

    def __init__(self, response: ClusterResponse, points: ClusterPoints) -> None:
        self._modes, values = find_modes(response)
        self._rest = np.diag(1.0 + _HOLD - values)
        #: B_ca B_cb, which a matrix of second derivatives is a sum of, (n_c, r^2)
        self._squares = (self._modes[:, :, None] * self._modes[:, None, :]).reshape(len(self._modes), -1)
        self._central = response.central
        self._points = points
        self._w = np.zeros((len(points.misfits), self._modes.shape[1]))
        size = max(1, _AT_ONCE // self._modes.shape[1] ** 2)
        self._parts = [slice(i, i + size) for i in range(0, len(self._w), size)]
        #: change of w with f, kappa, tau and y
        self._changes = np.zeros((*self._w.shape, 4))

    def step(self, before: Balance, y: float) -> Balance:
        """Go from one overlap to another: follow the slopes, then iterate."""
        up = y - before.y
        moved = np.maximum(np.add(before.effective, np.multiply(before.slopes, up)), np.multiply(0.5, before.effective))
        self._w += self._changes[..., :3] @ (moved - before.effective) + self._changes[..., 3] * up
        return self.solve(y, Effective(*moved.tolist()))

    def solve(self, y: float, start: Effective) -> Balance:
        """Solve at the overlap y, from an estimate; raises :class:`PrecisionError` if it does not settle."""
        now = np.array(start)
        for _ in range(40):
            self._relax(y, Effective(*now.tolist()))
            miss, by, ball, contacts = self._linearise(y, Effective(*now.tolist()))
            matrix = by[:3, :3]
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
            slopes, by_lattice = -np.linalg.solve(matrix, by[:3, 3]), by[3, :3]
            force = float(np.mean(ball) + by_lattice @ change)
            # each scramble alone: its own mean, in its own effective lattice
            influence = np.linalg.solve(matrix.T, by_lattice)
            realisations = np.asarray(ball - miss @ influence, float)
            off = np.mean(realisations.reshape(self._points.scrambles, -1), axis=1)
            error = float(np.std(off, ddof=1) / np.sqrt(off.size)) if off.size > 1 else np.nan
            return Balance(
                y, Effective(*now.tolist()), Effective(*slopes.tolist()), force, float(by[3, 3] + by_lattice @ slopes),
                error / force, float(np.std(ball)) / force, contacts, realisations, np.asarray(influence, float), matrix,
            )  # fmt: skip
        raise PrecisionError(
            message(f"the cluster medium does not settle at an overlap of {y:.6g} widths", mend="Raise the load")
        )

    def overlaps(self, y: float, effective: Effective) -> Array:
        """Return the overlaps h (n, n_c) of all contacts in equilibrium, in a given effective lattice."""
        self._relax(y, effective)
        return self._realise(slice(None), y, effective.push)

    def _realise(self, part: slice, y: float, push: float) -> Array:
        """Return h (n, n_c) of some realisations."""
        points = self._points
        return np.asarray(y + points.misfits[part] + push * points.pushes[part] - self._w[part] @ self._modes.T)

    def _stiffen(self, slopes: Array, stiffness: float) -> Array:
        """Return the matrices (n, r, r) of second derivatives, from the stiffness of each contact."""
        return np.asarray(stiffness * self._rest + (slopes @ self._squares).reshape(len(slopes), *self._rest.shape))

    def _relax(self, y: float, now: Effective) -> None:
        """Bring all realisations into equilibrium, by Newton's method with a line search."""
        f, kappa, tau = now
        points, modes = self._points, self._modes
        rounding = 1e-15 * len(modes) * (f + kappa) * (1.0 + abs(y))

        def energy(w: Array, fixed: Array) -> Array:
            h = fixed - w @ modes.T
            closed = np.maximum(h, 0.0)
            own = 0.4 * closed**2 * np.sqrt(closed) - f * h - 0.5 * kappa * (h - y) ** 2
            return np.asarray(0.5 * (1.0 + _HOLD) * kappa * np.sum(w * w, axis=1) + np.sum(own, axis=1))

        def relax(part: slice) -> None:
            going = np.arange(*part.indices(len(self._w)))
            w, fixed = self._w[going], y + points.misfits[going] + tau * points.pushes[going]
            for _ in range(200):
                h = fixed - w @ modes.T
                closed = np.maximum(h, 0.0)
                root = np.sqrt(closed)
                pull = (1.0 + _HOLD) * kappa * w - (closed * root - f - kappa * (h - y)) @ modes
                left = np.max(np.abs(pull), axis=1) > _BALANCED * min(f, kappa)
                if not np.any(left):
                    return
                going, w, fixed, pull = going[left], w[left], fixed[left], pull[left]
                step = np.linalg.solve(self._stiffen(1.5 * root[left], kappa), pull[..., None])[..., 0]
                length, work = np.ones(len(w)), np.sum(pull * step, axis=1)
                before = energy(w, fixed)
                for _ in range(30):
                    rising = energy(w - length[:, None] * step, fixed) > before - 1e-4 * length * work + rounding
                    if not np.any(rising):
                        break
                    length[rising] *= 0.4
                w = w - length[:, None] * step
                self._w[going] = w
            what = f"a cluster finds no equilibrium at an overlap of {y:.6g} widths"
            raise PrecisionError(message(what, mend="Raise the load"))

        share_out(relax, self._parts)

    def _linearise(self, y: float, now: Effective) -> tuple[Array, Array, Array, float]:
        """Return the conditions and their derivatives; it keeps the changes of w.

        They are what the conditions miss in each realisation (n, 3); the derivatives (4, 4) of these three, and of the mean
        force on the ball in the middle, with f, kappa, tau and y; that force in each realisation (n,); and the part of the
        ball's contacts that carry force.
        """
        f, kappa, _ = now
        misses, slopes, squares, central = [], np.zeros((4, 4)), 0.0, []
        for miss, by, square, ball in share_out(lambda part: self._linearise_part(part, y, now), self._parts):
            misses.append(miss)
            central.append(ball)
            slopes += by * len(miss)
            squares += square
        slopes /= len(self._w)
        rms = np.sqrt(squares / len(self._w))
        # the third condition is for the root of the mean square, in which it is nearly linear
        slopes[2] /= 2.0 * rms
        per = np.concatenate(misses)
        per[:, 2] = (per[:, 2] - rms**2) / (2.0 * rms) + rms
        per -= [f, 0.0, now.push * kappa]
        slopes[2] -= [0.0, now.push, kappa, 0.0]
        slopes[0, 0] -= 1.0
        ball, closed = np.concatenate(central, axis=1)
        return per, slopes, ball, float(np.mean(closed))

    def _linearise_part(self, part: slice, y: float, now: Effective) -> tuple[Array, Array, float, Array]:
        """Return, for one part of the realisations, mean force, <phi s> and <phi^2> of each, and slopes."""
        f, kappa, tau = now
        points, modes = self._points, self._modes
        s, m, w = points.misfits[part], points.pushes[part], self._w[part]
        h = self._realise(part, y, tau)
        closed = np.maximum(h, 0.0)
        root = np.sqrt(closed)
        force, slope, off = closed * root, 1.5 * root, h - y
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
                by_force[:, self._central].mean(axis=(0, 1)),
            ]
        )
        square = np.mean(phi**2, axis=1)
        miss = np.stack([force.mean(axis=1), np.mean(phi * s, axis=1), square], axis=1)
        central = force[:, self._central]
        ball = np.stack([central.mean(axis=1), np.mean(central > LEAST_CONTACT * f, axis=1)])
        return miss, by, float(np.sum(square)), ball
