"""Many realisations of a cluster, each nearly in equilibrium: they take most of the quadrature error off the few that are.

An equilibrium to rounding takes a dozen factorised matrices. A fixed number of steps of accelerated gradient descent takes a
hundredth of that, and comes so near that what is left hardly differs from one realisation to another. So a mean over few
realisations in equilibrium is corrected by the mean over many after the descent, less that of the few after the same
descent (the multilevel method of Giles, Operations Research 56, 607 (2008), with two levels). What the descent is off
cancels: nothing is left of it but a scatter, that of the difference, which is in the error.

Descent is in the modes of the cluster, with the stiffness of each as if all contacts were alike: it begins in the effective
lattice, w = 0, where h = y + s + tau m.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from granphon.dynamics.cluster_response import ClusterResponse
from granphon.laws.cluster_balance import LEAST_CONTACT, Balance, Effective, find_modes
from granphon.laws.cluster_points import ClusterPoints

__all__ = ["ClusterDescent"]

Array = NDArray[np.float64]
Single = NDArray[np.float32]
#: steps of descent
_STEPS = 30
#: overlaps above the mean, over their rms, of the contacts whose stiffness is that of a step
_STIFF = 2.0
#: numbers that are worked on at a time
_AT_ONCE = 2**15


class ClusterDescent:
    """The ``few`` realisations of a balance and sets of ``many`` others, which correct its means."""

    def __init__(self, response: ClusterResponse, few: ClusterPoints, many: Iterable[ClusterPoints]) -> None:
        modes, values = find_modes(response)
        self._modes, self._values, self._central = modes.astype(np.float32), values.astype(np.float32), response.central
        self._few, self._half = _halve(few), len(few.misfits) // few.scrambles // 2
        self._many = [_halve(one) for one in many]

    def refine(self, found: Balance) -> Balance:
        """Return the solution with the means of the many realisations, and what is left of the error."""
        few = self._evaluate(found, *self._few)
        many = np.array([np.mean(self._evaluate(found, *one), axis=0) for one in self._many])
        force, ball, square, contacts = np.mean(many, axis=0) - np.mean(few, axis=0)
        # a realisation and its antithetic one are no two, but all else that the points do for the few is not counted
        pairs = np.mean((found.realisations - few[:, 0]).reshape(-1, 2, self._half), axis=1).ravel()
        error = float(np.sqrt(np.var(pairs, ddof=1) / pairs.size + np.var(many[:, 0], ddof=1) / len(many)))
        total = found.force + float(force)
        # relative to the mean in the lattice of the few, where the squares are too
        squares = (found.force**2 * (1.0 + found.fluctuation**2) + float(square)) / (found.force + float(ball)) ** 2
        return replace(
            found, force=total, error=error / total, fluctuation=float(np.sqrt(max(squares - 1.0, 0.0))),
            contacts=found.contacts + float(contacts),
        )  # fmt: skip

    def _evaluate(self, found: Balance, misfits: Single, pushes: Single) -> Array:
        """Return for each realisation (n, 4), after the descent, what its mean is the mean of.

        It is the force on the ball in the middle, with what the realisation misses of the conditions, as in
        ``found.realisations`` up to a constant; that force alone; its square; and the part of the contacts that carry force.
        """
        y, (f, kappa, tau) = found.y, found.effective
        size = max(1, _AT_ONCE // len(self._modes))
        rows = []
        for start in range(0, len(misfits), size):
            part = slice(start, start + size)
            off = self._descend(y, found.effective, misfits[part], pushes[part])
            closed = np.maximum(y + off, 0.0)
            force = closed * np.sqrt(closed)
            phi = force - f - kappa * off
            ball = force[:, self._central]
            mean = np.mean(ball, axis=1, dtype=float)
            missed = np.stack([np.mean(one, axis=1, dtype=float) for one in (force, phi * misfits[part], phi * phi)], axis=1)
            weights = found.influence / [1.0, 1.0, 2.0 * tau * kappa]
            rows.append(
                np.stack([mean - missed @ weights, mean, mean**2, np.mean(ball > LEAST_CONTACT * f, axis=1)], axis=1)
            )
        return np.concatenate(rows)

    def _descend(self, y: float, now: Effective, misfits: Single, pushes: Single) -> Single:
        """Return h - y (n, n_c) after the steps: Nesterov's method for the energy of the cluster."""
        f, kappa, tau = now
        b, soft = self._modes, np.float32(kappa) * (1.0 - self._values)
        free = misfits + np.float32(tau) * pushes
        stiff = 1.5 * np.sqrt(max(y, 0.0) + _STIFF * float(np.std(free)))
        rate = (1.0 / (soft + np.float32(stiff) * self._values)).astype(np.float32)
        # the pull on a mode: what of it does not depend on w first
        fixed = np.float32(kappa) * (free @ b) + np.float32(f) * b.sum(axis=0)
        shift = np.float32(y)
        w = ahead = np.zeros_like(fixed)
        for step in range(_STEPS):
            closed = np.maximum(free - ahead @ b.T + shift, np.float32(0.0))
            moved = ahead - rate * (fixed + soft * ahead - (closed * np.sqrt(closed)) @ b)
            ahead = moved + np.float32(step / (step + 3.0)) * (moved - w)
            w = moved
        return np.asarray(free - w @ b.T)


def _halve(points: ClusterPoints) -> tuple[Single, Single]:
    """Return misfits and pushes in single precision, which does for the descent."""
    return points.misfits.astype(np.float32), points.pushes.astype(np.float32)
