"""Linear dynamics in time of a network that a force pushes, to rounding.

The mass-weighted motions x of a network obey x'' + tau D x' + D x = b s(t), where b says which
balls are pushed and s(t) is a tone burst. Every response at a time t is an entire function of D
applied to b: it is expanded in Chebyshev polynomials T_n(y) of y = 2 D / top^2 - 1
(:mod:`granphon.waves.chebyshev`). So all times share one recursion. The signal of a receiver r
needs the moments <r|T_n|b> alone; at the Gauss nodes y_k, where D is a number Omega^2, the response
is that of a damped oscillator in closed form. Damping in proportion to the stiffness of contacts
enters through that number only.

Where the normal and the tangential motion of contacts are damped differently, the damping C = A^T
tau A, with a time tau for each kind of deformation, is no function of D, and modes exchange energy
(:class:`ViscousPropagation`). The equations of first order for z = (omega_top x, x', source),

    z' = L z,    source = alpha (cos omega_j t, sin omega_j t),

do not contain the time explicitly: the waves that a burst consists of are part of z. Their
propagator is expanded in polynomials P_n = i^n T_n(X/i), X = (L + c/2)/R, made by P_n+1 = 2 X P_n +
P_n-1, with Bessel functions J_n(R t) as coefficients (the expansion of exp(R t X) by Jacobi and
Anger). c bounds the damping and R the frequencies. Polynomials grow where damping is strong, so a
record is divided into spans, each so short that no digit is lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.special import jv

from granphon.base.arrays import Array, Complex
from granphon.dynamics.damping import ContactDamping
from granphon.waves.chebyshev import polynomials
from granphon.waves.operator import WaveOperator, explain_instability

#: greatest sum of the coefficients that are left out, over the largest response
TOLERANCE = 1e-13
#: largest rounding of a coefficient, times the root of their number, over the largest phase
_ROUNDING = 2e-15
#: numbers in the blocks that polynomials, and responses at many times, are summed in
_BLOCK = 4_000_000
#: least relative difference of the squares of a mode's frequency and decay rate: nearer squares are
#: set this far apart, as quotients by their difference have no digits
_CRITICAL = 1e-10
#: distance of a rate from that of a wave, times the length of the burst, below which the two are
#: near
_NEAR = 1e-2
#: relative growth of a polynomial's norm, which is never above that of its start, beyond rounding
_GROWTH = 1e-6
#: the longest span of a record with uneven damping, in units of 2/c
_DECAY = 6.0
#: the same in units of 1/R
_PHASE = 400.0
#: size of the terms that are left out
_LEAST = 1e-17
#: size of the source in z: large against the force, so that it couples little
_LARGE = 10.0


@dataclass(frozen=True)
class ToneBurst:
    """sin(omega (t - P/2)) (1 - cos(2 pi t/P))/2 from 0 to P: ``cycles`` periods under a Hann
    window, and zero elsewhere.

    Its integral is zero: it leaves no momentum behind.

    Attributes
    ----------
    frequency : omega / 2 pi, Hz.
    cycles : P omega / 2 pi.
    """

    frequency: float
    cycles: float

    @property
    def duration(self) -> float:
        """P, s."""
        return self.cycles / self.frequency

    def __call__(self, times: Array) -> Array:
        """The burst at times, s."""
        amplitudes, omegas = self.waves
        inside = (times > 0.0) & (times < self.duration)
        phases = np.multiply.outer(np.where(inside, times, 0.0), omegas)
        return np.where(inside, np.imag(np.exp(1j * phases) @ amplitudes), 0.0)

    @property
    def waves(self) -> tuple[Complex, Array]:
        """Amplitudes and angular frequencies of the waves exp(i omega t) whose imaginary parts add
        up to the burst.
        """
        omega = 2.0 * np.pi * self.frequency
        side = 2.0 * np.pi / self.duration
        start = np.exp(-0.5j * omega * self.duration)
        return start * np.array([0.5, -0.25, -0.25]), np.array([omega, omega + side, omega - side])

    def drive(self, rates: Complex, times: Array) -> Complex:
        """Return the integral of exp(rate (t - t')) s(t') over t' from 0 to t, (n_t, n); no time is
        above P.
        """
        amplitudes, omegas = self.waves
        weights = np.concatenate([amplitudes, -np.conj(amplitudes)]) / 2j
        waves = 1j * np.concatenate([omegas, -omegas])
        gaps = rates[:, None] - waves
        # each wave adds (exp(rate t) - exp(wave t))/(rate - wave); where the two rates are near,
        # expm1 keeps the digits of the difference
        near = np.min(np.abs(gaps), axis=1) * self.duration < _NEAR
        quotients = weights / gaps[~near]
        turned = np.exp(np.multiply.outer(times, waves))
        grown = np.exp(np.multiply.outer(times, rates[~near]))
        integrals = np.empty((times.size, rates.size), complex)
        integrals[:, ~near] = grown * np.sum(quotients, axis=1) - turned @ quotients.T
        for column in np.flatnonzero(near):
            gap = gaps[column]
            is_equal = gap == 0.0
            rise = np.expm1(np.multiply.outer(times, gap)) / np.where(is_equal, 1.0, gap)
            differences = turned * np.where(is_equal, times[:, None], rise)
            integrals[:, column] = differences @ weights
        return integrals


@dataclass(frozen=True)
class _Exponentials:
    """The response of an oscillator at each of ``count`` nodes as a sum of exp(rate t).

    ``node`` (n,) is that of each rate (n,), 1/s; the real parts of ``velocity`` (n,) and
    ``displacement`` (n,) times the exponentials add up to the velocity and displacement after a
    unit of momentum.
    """

    node: NDArray[np.intp]
    rate: Complex
    velocity: Complex
    displacement: Complex

    @classmethod
    def of(cls, omega: Array, damping: float) -> _Exponentials:
        """For angular frequencies ``omega`` (count,) and the time tau of the damping, s."""
        # the rates s of exp(s t) are the roots of s^2 + damping omega^2 s + omega^2 = 0
        decay = 0.5 * damping * omega**2
        squared = omega**2 - decay**2
        squared = np.where(np.abs(squared) < _CRITICAL * omega**2, _CRITICAL * omega**2, squared)
        swings = np.flatnonzero(squared > 0.0)
        creeps = np.flatnonzero(squared < 0.0)
        frequency = np.sqrt(squared[swings])
        split = np.sqrt(-squared[creeps])
        # the slow rate by the product of the two, without a difference of near numbers
        slow = -(omega[creeps] ** 2) / (decay[creeps] + split)
        fast = -(decay[creeps] + split)
        swing = -decay[swings] + 1j * frequency
        return cls(
            np.concatenate([swings, creeps, creeps]),
            np.concatenate([swing, slow, fast]),
            np.concatenate([-1j * swing / frequency, slow / (2.0 * split), -fast / (2.0 * split)]),
            np.concatenate([-1j / frequency, 0.5 / split, -0.5 / split]),
        )


class Propagation:
    """Responses of the network behind ``operator`` to a burst that pushes ``push`` (size,), from
    time 0 to ``duration``.

    Parameters
    ----------
    operator : D.
    push : (size,) mass-weighted forces, N/kg^1/2, that the burst multiplies.
    burst : the force in time.
    duration : the latest time, s.
    damping : tau, s: the viscosity of each contact over its stiffness.
    """

    def __init__(
        self,
        operator: WaveOperator,
        push: Array,
        burst: ToneBurst,
        duration: float,
        damping: float = 0.0,
    ) -> None:
        self.operator = operator
        self.push = push
        self.burst = burst
        self.damping = damping
        self.duration = duration

    # -- the response of one oscillator ------------------------------------------------------------

    def _find_nodes(self, count: int) -> _Exponentials:
        """Return the response at the Gauss nodes y = cos(angle) = 2 (Omega / top)^2 - 1."""
        angle = np.pi * (np.arange(count) + 0.5) / count
        return _Exponentials.of(self.operator.top * np.cos(0.5 * angle), self.damping)

    @cached_property
    def order(self) -> int:
        """Number of polynomials; the coefficients of higher ones add up to :data:`TOLERANCE`, or to
        the rounding of phases.
        """
        reach = 0.5 * self.operator.top * self.duration
        margin = 12.0 * reach ** (1.0 / 3.0) + 40.0
        count = math.ceil(reach + margin)
        while True:
            waves = self._find_nodes(count)
            velocities = np.real(waves.velocity * np.exp(waves.rate * self.duration))
            late = np.zeros(count)
            np.add.at(late, waves.node, velocities)
            size = np.abs(dct(late, type=2)) / count
            # rounding of the phases is spread over all coefficients
            size[size < _ROUNDING * (1.0 + reach) / math.sqrt(count)] = 0.0
            remainders = np.cumsum(size[::-1])[::-1]
            short = np.flatnonzero(remainders <= TOLERANCE)
            if short.size and short[0] < count - 0.25 * margin:
                return max(int(short[0]), 2)  # all is still at the end where damping is large
            count *= 2

    # -- recursion ---------------------------------------------------------------------------------

    def follow(
        self, listen: Callable[[Array], Array], times: Array, frames: Array
    ) -> tuple[Array, Array, Array]:
        """Return what receivers hear, and the motions of all balls, from one recursion.

        Parameters
        ----------
        listen : takes the velocities (size,), and returns the numbers (n_r,) of receivers: linear.
        times : (n_t,) even times from zero, s.
        frames : (n_f,) times at which the motions of all balls are returned, s.

        Returns
        -------
        signals : (n_r, n_t) at the ``times``.
        displacements, velocities : (n_f, size), mass-weighted, at the ``frames``.

        Raises :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero.
        """
        waves = self._find_nodes(self.order)
        forms = self._expand_frames(waves, frames)
        moments, states = self._recurse(listen, forms)
        # sum of (2 - delta_n0) mu_n T_n(y_k): the spectral weight at the nodes, and from it the
        # velocities at all times
        spectrum = dct(moments, type=3, axis=0)[waves.node] / self.order
        signals = self._evaluate(waves, spectrum * waves.velocity[:, None], times)
        return signals.T, states[: frames.size], states[frames.size :]

    def _expand_frames(self, waves: _Exponentials, frames: Array) -> Array:
        """Return the coefficients (2 n_f, order) of the polynomials in the displacements, then in
        the velocities, at the times ``frames`` (n_f,), s.
        """
        end = self.burst.duration
        early = frames < end
        grown = np.empty((frames.size, waves.rate.size), complex)
        grown[early] = self.burst.drive(waves.rate, frames[early])
        after_burst = self.burst.drive(waves.rate, np.array([end]))[0]
        grown[~early] = np.exp(np.multiply.outer(frames[~early] - end, waves.rate)) * after_burst
        responses = [np.real(grown * weights).T for weights in (waves.displacement, waves.velocity)]
        values = np.zeros((self.order, 2 * frames.size))
        np.add.at(values, waves.node, np.hstack(responses))
        forms = dct(values.T, type=2, axis=1) / self.order
        forms[:, 0] *= 0.5
        return np.asarray(forms)

    def _recurse(self, listen: Callable[[Array], Array], forms: Array) -> tuple[Array, Array]:
        """Return the moments (order, n_r) at receivers of the polynomials T_n b of the push b, and
        the sums (2 n_f, size) of T_n b with the coefficients ``forms``.
        """
        size = self.push.size
        order = self.order
        states = np.zeros((len(forms), size))
        moments = []
        most = np.linalg.norm(self.push) * (1.0 + _GROWTH)
        block = np.empty((max(1, min(order, _BLOCK // size)), size))
        for n, vector in zip(range(order), polynomials(self.operator, self.push), strict=False):
            moments.append(listen(vector))
            row = n % len(block)
            block[row] = vector
            if row == len(block) - 1 or n == order - 1:
                first = n - row
                states += forms[:, first : n + 1] @ block[: row + 1]
                if not np.linalg.norm(vector) <= most:
                    raise explain_instability(self.operator.network)
        return np.array(moments), states

    def _evaluate(self, waves: _Exponentials, weight: Complex, times: Array) -> Array:
        """Return the velocities (n_t, n_r) at even ``times`` (n_t,), s, of which ``weight`` (n,
        n_r) are the weights of the exponentials.
        """
        end = self.burst.duration
        signals = np.empty((times.size, weight.shape[1]))
        during = int(np.count_nonzero(times < end))
        rows = max(1, _BLOCK // waves.rate.size)
        for first in range(0, during, rows):
            chunk = slice(first, min(first + rows, during))
            signals[chunk] = np.real(self.burst.drive(waves.rate, times[chunk]) @ weight)
        if during == times.size:
            return signals
        # the size of each exponential when the burst ends, from where it goes on by itself
        after_burst = self.burst.drive(waves.rate, np.array([end]))[0]
        weight = weight * after_burst[:, None]
        since_first = times[during : during + rows] - times[during]
        later = np.exp(np.multiply.outer(since_first, waves.rate))  # the same for each chunk
        for first in range(during, times.size, rows):
            chunk = slice(first, min(first + rows, times.size))
            count = chunk.stop - chunk.start
            begin = np.exp(waves.rate * (times[first] - end))
            signals[chunk] = np.real(later[:count] @ (begin[:, None] * weight))
        return signals


class ViscousPropagation:
    """Responses of a network to a burst that pushes ``push``, as in
    :class:`granphon.waves.propagation.Propagation`.

    Parameters
    ----------
    operator : D.
    push : (size,) mass-weighted forces, N/kg^1/2, that the burst multiplies.
    burst : the force in time.
    damping : of the contacts.
    """

    def __init__(
        self, operator: WaveOperator, push: Array, burst: ToneBurst, damping: ContactDamping
    ) -> None:
        self.operator = operator
        self.burst = burst
        self._viscous = operator.weigh(damping.times)
        self._shift = float(0.5 * np.max(damping.times) * operator.top**2)
        amplitudes, self._omegas = burst.waves
        self._radius = max(operator.top, float(np.max(self._omegas)))
        self._alpha = _LARGE * float(np.linalg.norm(push)) / self._radius
        # the burst is the imaginary part of the sum of amplitude (cos + i sin)
        parts = np.concatenate([np.imag(amplitudes), np.real(amplitudes)])
        self._push = push
        self._parts = parts / self._alpha

    def _apply(self, z: Array) -> Array:
        """Return X z of a state: top times displacements (size,), velocities (size,), and the
        cosines and sines of the source.
        """
        size = self._push.size
        top = self.operator.top
        product = np.empty_like(z)
        x = z[:size]
        v = z[size : 2 * size]
        source = z[2 * size :]
        product[:size] = top * v
        pushed = (self._parts @ source) * self._push
        product[size : 2 * size] = pushed - self._viscous @ v - (self.operator @ x) / top
        cosine, sine = np.split(source, 2)
        product[2 * size :] = np.concatenate([-self._omegas * sine, self._omegas * cosine])
        product += self._shift * z
        product /= self._radius
        return product

    def _expand(self, span: float, times: Array) -> Array:
        """Return the coefficients (n_t, order) of the polynomials at ``times`` (n_t,) within a
        ``span``, s.

        The terms of the polynomials that are left out are below :data:`_LEAST`.
        """
        phase = self._radius * span
        n = np.arange(math.ceil(2.0 * phase + 3.0 * self._shift * span) + 80)
        growth = np.exp(np.minimum(n * math.asinh(self._shift / self._radius), 700.0))
        count = int(np.flatnonzero(np.abs(jv(n, phase)) * growth > _LEAST)[-1]) + 2
        n = np.arange(count)
        bessel = np.where(n, 2.0, 1.0) * jv(n, self._radius * times[:, None])
        return np.asarray(bessel * np.exp(-self._shift * times)[:, None])

    def follow(
        self, listen: Callable[[Array], Array], times: Array, frames: Array
    ) -> tuple[Array, Array, Array]:
        """Return what receivers hear, and the motions of all balls; see
        :meth:`Propagation.follow`.
        """
        size = self._push.size
        end = max(float(times[-1]), float(np.max(frames, initial=0.0)))
        z = np.zeros(2 * size + 2 * self._omegas.size)
        z[2 * size : 2 * size + self._omegas.size] = self._alpha

        def listen_to_state(state: Array) -> Array:
            """Return what receivers hear (n_r,) of displacements, velocities and the source."""
            return listen(state[size : 2 * size])

        signals = np.zeros((times.size, listen(z[:size]).size))
        displacements = np.zeros((frames.size, size))
        velocities = np.zeros((frames.size, size))
        for first, last in self._list_spans(end):
            times_within = (times > first) & (times <= last)
            if first == 0.0:
                times_within |= times == 0.0
            frames_within = np.flatnonzero((frames > first) & (frames <= last))
            # states at the end of the span, and at its frames
            state_times = np.concatenate([[last], frames[frames_within]]) - first
            signal_times = times[times_within] - first
            states, heard = self._cross(z, last - first, state_times, signal_times, listen_to_state)
            z = states[0]
            signals[times_within] = heard
            displacements[frames_within] = states[1:, :size] / self.operator.top
            velocities[frames_within] = states[1:, size : 2 * size]
            if last == self.burst.duration:
                z[2 * size :] = 0.0
        return signals.T, displacements, velocities

    def _list_spans(self, end: float) -> Iterator[tuple[float, float]]:
        """Yield the times, s, between which the state is propagated at once; the burst ends between
        two of these spans.
        """
        longest = min(_DECAY / max(self._shift, 1e-300), _PHASE / self._radius)
        first = 0.0
        has_burst_ended = False
        while first < end:
            last = min(first + longest, end)
            if not has_burst_ended and last >= self.burst.duration:
                last = self.burst.duration
                has_burst_ended = True
            yield first, last
            first = last

    def _cross(
        self,
        z: Array,
        span: float,
        state_times: Array,
        signal_times: Array,
        listen: Callable[[Array], Array],
    ) -> tuple[Array, Array]:
        """Return the states at ``state_times`` after a state ``z``, and what receivers hear,
        (n, n_r), at ``signal_times``, within a ``span``, all in s.
        """
        coefficients = self._expand(span, np.concatenate([state_times, signal_times]))
        of_states = coefficients[: state_times.size]
        of_signals = coefficients[state_times.size :]
        states = np.zeros((state_times.size, z.size))
        heard = np.zeros((signal_times.size, listen(z).size))
        previous = z
        current = self._apply(z)
        for order in range(coefficients.shape[1]):
            for state, factor in zip(states, of_states[:, order], strict=True):
                if factor:
                    state += factor * previous
            heard += of_signals[:, order, None] * listen(previous)
            following = self._apply(current)
            following *= 2.0
            following += previous
            previous = current
            current = following
        return states, heard
