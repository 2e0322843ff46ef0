"""Dynamics of a network whose contacts are damped differently in their normal and tangential motion.

The damping C = A^T tau A, with a time tau for each kind of deformation, is no function of D then, and modes exchange energy.
The equations of first order for z = (omega_top x, x', source),

    z' = L z,    source = alpha (cos omega_j t, sin omega_j t),

have no explicit time: the waves that a burst consists of are part of z. Their propagator is expanded in polynomials
P_n = i^n T_n(X/i), X = (L + c/2)/R, made by P_n+1 = 2 X P_n + P_n-1, with Bessel functions J_n(R t) as coefficients (the
expansion of exp(R t X) by Jacobi and Anger). c bounds the damping and R the frequencies. Polynomials grow where damping is
strong, so that a record is made of spans, each so short that no digit is lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import jv

from granphon.waves.operator import WaveOperator
from granphon.waves.propagation import ToneBurst

Array = NDArray[np.float64]
#: the longest span, in units of 2/c and of 1/R
_DECAY, _PHASE = 6.0, 400.0
#: size of the terms that are left out
_LEAST = 1e-17
#: size of the source in z: large against the force, so that it couples little
_LARGE = 10.0


class ViscousPropagation:
    """Responses of a network to a burst that pushes ``push``, as in :class:`granphon.waves.propagation.Propagation`.

    Parameters
    ----------
    operator : D.
    push : (size,) mass-weighted forces, N/kg^1/2, that the burst multiplies.
    burst : the force in time.
    damping : times tau of normal motion (elongation), and of all other deformations, s.
    """

    def __init__(self, operator: WaveOperator, push: Array, burst: ToneBurst, damping: tuple[float, float]) -> None:
        self.operator, self.burst = operator, burst
        times = [damping[row.kind != "elongation"] for row in operator.rows]
        root = operator.root
        lag = np.repeat(times, root.shape[0] // len(times))
        self._viscous = (root.T.tocsr() @ root.multiply(lag[:, None]).tocsr()).tocsr()
        self._shift = float(0.5 * max(damping) * operator.top**2)
        amplitudes, self._omegas = burst.waves
        self._radius = max(operator.top, float(np.max(self._omegas)))
        self._alpha = _LARGE * float(np.linalg.norm(push)) / self._radius
        # the burst is the imaginary part of the sum of amplitude (cos + i sin)
        parts = np.concatenate([np.imag(amplitudes), np.real(amplitudes)])
        self._push, self._parts = push, parts / self._alpha

    def _apply(self, z: Array) -> Array:
        """Return X z."""
        size, top, found = self._push.size, self.operator.top, np.empty_like(z)
        x, v, source = z[:size], z[size : 2 * size], z[2 * size :]
        found[:size] = top * v
        found[size : 2 * size] = (self._parts @ source) * self._push - self._viscous @ v - (self.operator @ x) / top
        cosine, sine = np.split(source, 2)
        found[2 * size :] = np.concatenate([-self._omegas * sine, self._omegas * cosine])
        found += self._shift * z
        found /= self._radius
        return found

    @cached_property
    def _span(self) -> float:
        return min(_DECAY / max(self._shift, 1e-300), _PHASE / self._radius)

    def _count_terms(self, span: float) -> int:
        """Return the number of polynomials beyond which all terms are below :data:`_LEAST`."""
        phase, part = self._radius * span, self._shift / self._radius
        n = np.arange(math.ceil(2.0 * phase + 3.0 * self._shift * span) + 80)
        sizes = np.abs(jv(n, phase)) * np.exp(np.minimum(n * math.asinh(part), 700.0))
        return int(np.flatnonzero(sizes > _LEAST)[-1]) + 2

    def follow(self, listen: Callable[[Array], Array], times: Array, frames: Array) -> tuple[Array, Array, Array]:
        """Return what receivers hear, and the motions of all balls; see :meth:`Propagation.follow`."""
        size, end = self._push.size, max(float(times[-1]), float(np.max(frames, initial=0.0)))
        z = np.zeros(2 * size + 2 * self._omegas.size)
        z[2 * size : 2 * size + self._omegas.size] = self._alpha
        signals = np.zeros((times.size, listen(z[:size]).size))
        displaced, moving = np.zeros((frames.size, size)), np.zeros((frames.size, size))
        first, switched = 0.0, False
        while first < end:
            last = min(first + self._span, end)
            if not switched and last >= self.burst.duration:
                last, switched = self.burst.duration, True
            heard = (times > first) & (times <= last) | ((times == 0.0) & (first == 0.0))
            seen = np.flatnonzero((frames > first) & (frames <= last))
            z, signals[heard], states = self._advance(z, listen, times[heard] - first, frames[seen] - first, last - first)
            displaced[seen], moving[seen] = states[:, :size] / self.operator.top, states[:, size : 2 * size]
            if last == self.burst.duration:
                z[2 * size :] = 0.0
            first = last
        return signals.T, displaced, moving

    def _advance(
        self, z: Array, listen: Callable[[Array], Array], times: Array, frames: Array, span: float
    ) -> tuple[Array, Array, Array]:
        """Return z after the ``span``, signals (n_t, n_r) at ``times``, and z (n_f, ...) at ``frames``."""
        size, count = self._push.size, self._count_terms(span)
        n = np.arange(count)
        when = np.concatenate([[span], frames, times])
        forms = np.where(n, 2.0, 1.0) * jv(n, self._radius * when[:, None]) * np.exp(-self._shift * when)[:, None]
        whole, parts = forms[: 1 + frames.size], forms[1 + frames.size :]
        states, signals = np.zeros((len(whole), z.size)), np.zeros((times.size, listen(z[:size]).size))
        previous, current = z, self._apply(z)
        for order in range(count):
            for state, factor in zip(states, whole[:, order], strict=True):
                if factor:
                    state += factor * previous
            signals += parts[:, order, None] * listen(previous[size : 2 * size])
            following = self._apply(current)
            following *= 2.0
            following += previous
            previous, current = current, following
        return states[0], signals, states[1:]
