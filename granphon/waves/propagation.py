"""Linear dynamics in time of a network that a force pushes, to rounding.

The mass-weighted motions x of a network obey x'' + (tau D + gamma) x' + D x = b s(t), where b says
which balls are pushed and s(t) is a tone burst. Every response at a time t is an entire function of
D applied to b: it is expanded in Chebyshev polynomials T_n(y) of y = 2 D / top^2 - 1
(:mod:`granphon.waves.chebyshev`). So all times share one recursion. The signal of a receiver r
needs only the moments <r|T_n|b>. The coefficients of the expansion follow from the response where D
is a number, Omega^2, at the Gauss nodes y_k: it is that of a damped oscillator in closed form, with
the damping tau Omega^2 + gamma.

Where contacts or motions are damped differently, the damping C = A^T tau A + Gamma, with a time tau
for each deformation and a drag for each motion, is no function of D, and modes exchange energy
(:class:`ViscousPropagation`). The equations of first order for z = (omega_top x, x', source),

    z' = L z,    source = alpha (cos omega_j t, sin omega_j t),

do not contain the time explicitly: the waves that a burst consists of are part of z. Their
propagator is expanded in polynomials Q_n = i^n T_n(X/i), X = (L + c/2)/R, made by Q_n+1 = 2 X Q_n +
Q_n-1, with Bessel functions J_n(R t) as coefficients (the expansion of exp(R t X) by Jacobi and
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
from granphon.dynamics.damping import Losses
from granphon.waves.chebyshev import GROWTH, polynomials
from granphon.waves.operator import WaveOperator, explain_instability

#: greatest sum of the coefficients that are left out of an expansion, over the largest response
TOLERANCE = 1e-13
#: largest rounding of a coefficient, times the root of the number of coefficients, over the largest
#: phase
_ROUNDING = 2e-15
#: most numbers in a block of polynomials, or of responses at many times, that are summed at once
_BLOCK = 4_000_000
#: least relative difference of the squares of a mode's frequency and decay rate: nearer squares are
#: set this far apart, as quotients by their difference have no digits
_LEAST_DIFFERENCE = 1e-10
#: distance of a rate from that of a wave, times the length of the burst, below which the two are
#: near
_RATE_DISTANCE = 1e-2
#: longest span of a record with uneven damping, in units of 2/c
_LONGEST_DECAY = 6.0
#: longest span of a record with uneven damping, in units of 1/R
_LONGEST_PHASE = 400.0
#: size up to which terms of the expansion of a span are left out
_LEAST_TERM = 1e-17
#: logarithm at which the growth of polynomials is capped, so that its exponential is still finite
_LARGEST_LOG = 700.0
#: size of the source in z, over that of the force divided by R: the larger the source is, the
#: weaker is its coupling to motions
_SOURCE_SIZE = 10.0


@dataclass(frozen=True)
class ToneBurst:
    """A tone burst: sin(omega (t - P/2)) (1 - cos(2 pi t/P))/2 for times t from 0 to P, ``cycles``
    periods of a tone under a Hann window, and zero at other times.

    The integral of the burst is zero: as a force it leaves no momentum behind.

    Attributes
    ----------
    frequency : omega / 2 pi, Hz.
    cycles : number of periods of the tone, P omega / 2 pi.
    """

    frequency: float
    cycles: float

    @property
    def duration(self) -> float:
        """P, the length of the burst, s."""
        return self.cycles / self.frequency

    def __call__(self, times: Array) -> Array:
        """Return the burst (...) at ``times`` (...), s."""
        amplitudes, omegas = self.waves
        is_inside = (times > 0.0) & (times < self.duration)
        phases = np.multiply.outer(np.where(is_inside, times, 0.0), omegas)
        burst = np.imag(np.exp(1j * phases) @ amplitudes)
        return np.where(is_inside, burst, 0.0)

    @property
    def waves(self) -> tuple[Complex, Array]:
        """Amplitudes (3,) and angular frequencies (3,), rad/s, of the waves exp(i omega t) whose
        imaginary parts add up to the burst: the tone, and the tone at the sum and the difference of
        its frequency and that of the Hann window.
        """
        omega = 2.0 * np.pi * self.frequency
        window_omega = 2.0 * np.pi / self.duration
        start_phase = np.exp(-0.5j * omega * self.duration)
        amplitudes = start_phase * np.array([0.5, -0.25, -0.25])
        return amplitudes, np.array([omega, omega + window_omega, omega - window_omega])

    def drive(self, rates: Complex, times: Array) -> Complex:
        """Return what the burst drives exponentials to: the integrals (n_t, n), s, of
        exp(rate (t - t')) times the burst at t', over t' from 0 to t.

        ``times`` t (n_t,), s, are between 0 and P, and ``rates`` (n,) are complex, 1/s.
        """
        amplitudes, omegas = self.waves
        # the burst is the sum of weight exp(wave_rate t): three waves, and their conjugates
        weights = np.concatenate([amplitudes, -np.conj(amplitudes)]) / 2j
        wave_rates = 1j * np.concatenate([omegas, -omegas])
        differences = rates[:, None] - wave_rates
        # each wave adds (exp(rate t) - exp(wave_rate t))/(rate - wave_rate); where the two rates
        # are near, expm1 keeps the digits of the difference
        is_near = np.min(np.abs(differences), axis=1) * self.duration < _RATE_DISTANCE
        quotients = weights / differences[~is_near]
        waves_at_times = np.exp(np.multiply.outer(times, wave_rates))
        exponentials = np.exp(np.multiply.outer(times, rates[~is_near]))
        integrals = np.empty((times.size, rates.size), complex)
        of_exponentials = exponentials * np.sum(quotients, axis=1)
        integrals[:, ~is_near] = of_exponentials - waves_at_times @ quotients.T
        for column in np.flatnonzero(is_near):
            difference = differences[column]
            is_equal = difference == 0.0
            # (exp(difference t) - 1)/difference, times the wave
            divisor = np.where(is_equal, 1.0, difference)
            rises = np.expm1(np.multiply.outer(times, difference)) / divisor
            rises = np.where(is_equal, times[:, None], rises)  # the limit of equal rates
            integrals[:, column] = (waves_at_times * rises) @ weights
        return integrals


@dataclass(frozen=True, eq=False)
class _Exponentials:
    """The motion of the damped oscillator at each node, after a unit of momentum at the time zero,
    as a sum of exponentials exp(rate t).

    Attributes
    ----------
    node : (n,) index of the node to which each exponential belongs.
    rate : (n,) complex rates, 1/s.
    velocity, displacement : (n,) factors of the exponentials: real parts of factor times
        exponential, summed over those of a node, are its velocity and its displacement.
    """

    node: NDArray[np.intp]
    rate: Complex
    velocity: Complex
    displacement: Complex

    @classmethod
    def of(cls, omega: Array, damping: float, drag: float = 0.0) -> _Exponentials:
        """Return the motions of oscillators, one at each node, with the angular frequencies
        ``omega`` (n_nodes,), rad/s, the time tau of the ``damping``, s, and the ``drag``, 1/s.

        An oscillator that swings has one exponential with a complex rate, whose conjugate the real
        part stands for. An oscillator that creeps has two exponentials with real rates.
        """
        # the rates s of exp(s t) are the roots of s^2 + (damping omega^2 + drag) s + omega^2 = 0
        decay = 0.5 * (damping * omega**2 + drag)
        least_square = _LEAST_DIFFERENCE * omega**2
        exact_square = omega**2 - decay**2
        damped_square = np.where(np.abs(exact_square) < least_square, least_square, exact_square)
        swing_nodes = np.flatnonzero(damped_square > 0.0)
        creep_nodes = np.flatnonzero(damped_square < 0.0)
        damped_omega = np.sqrt(damped_square[swing_nodes])
        swing_rate = -decay[swing_nodes] + 1j * damped_omega
        half_difference = np.sqrt(-damped_square[creep_nodes])  # of the two rates
        # the product of the two rates is omega^2: the slow rate follows from the fast one without a
        # difference of near numbers
        fast_rate = -(decay[creep_nodes] + half_difference)
        slow_rate = omega[creep_nodes] ** 2 / fast_rate
        difference_of_rates = 2.0 * half_difference
        velocities = [
            -1j * swing_rate / damped_omega,
            slow_rate / difference_of_rates,
            -fast_rate / difference_of_rates,
        ]
        displacements = [
            -1j / damped_omega,
            1.0 / difference_of_rates,
            -1.0 / difference_of_rates,
        ]
        return cls(
            node=np.concatenate([swing_nodes, creep_nodes, creep_nodes]),
            rate=np.concatenate([swing_rate, slow_rate, fast_rate]),
            velocity=np.concatenate(velocities),
            displacement=np.concatenate(displacements),
        )


class Propagation:
    """Responses of a network, whose motions are damped evenly, to a burst of force, from the time
    zero to ``duration``.

    Parameters
    ----------
    operator : D.
    push : (size,) mass-weighted forces, N/kg^1/2, which act times the burst.
    burst : the course of the force in time.
    duration : the latest time of a response, s.
    damping : tau, s: the viscosity of each contact over its stiffness.
    drag : gamma of all motions, 1/s.
    """

    def __init__(
        self,
        operator: WaveOperator,
        push: Array,
        burst: ToneBurst,
        duration: float,
        damping: float = 0.0,
        drag: float = 0.0,
    ) -> None:
        self.operator = operator
        self.push = push
        self.burst = burst
        self.damping = damping
        self.drag = drag
        self.duration = duration

    # -- the response of one oscillator ------------------------------------------------------------

    def _find_oscillators(self, n_nodes: int) -> _Exponentials:
        """Return the motions of oscillators with the frequencies Omega, rad/s, of ``n_nodes`` Gauss
        nodes y = cos(angle) = 2 (Omega / top)^2 - 1.
        """
        angle = np.pi * (np.arange(n_nodes) + 0.5) / n_nodes
        omega = self.operator.top * np.cos(0.5 * angle)
        return _Exponentials.of(omega, self.damping, self.drag)

    @cached_property
    def order(self) -> int:
        """Number of polynomials that are summed; the coefficients of all higher orders add up to
        :data:`TOLERANCE` at most, or are rounding of phases.

        The latest response needs the most polynomials. Its coefficients are found from the response
        at nodes, which are more than the order that results: their number is doubled until the
        order falls short of it by a quarter of a margin.
        """
        # coefficients J_2n(top t) fall off beyond 2n = top t, within a width of (top t)^1/3: twelve
        # widths are tried first, and forty orders more, for phases that are small
        phase = 0.5 * self.operator.top * self.duration
        margin = 12.0 * phase ** (1.0 / 3.0) + 40.0
        n_nodes = math.ceil(phase + margin)
        while True:
            responses = self._find_oscillators(n_nodes)
            velocities = np.real(responses.velocity * np.exp(responses.rate * self.duration))
            last_velocities = np.zeros(n_nodes)
            np.add.at(last_velocities, responses.node, velocities)
            sizes = np.abs(dct(last_velocities, type=2)) / n_nodes  # of coefficients
            # rounding of the phases is spread over all coefficients
            rounding = _ROUNDING * (1.0 + phase) / math.sqrt(n_nodes)
            sizes[sizes < rounding] = 0.0
            remainders = np.cumsum(sizes[::-1])[::-1]  # sums of all sizes from an order on
            is_negligible = remainders <= TOLERANCE
            order = int(np.argmax(is_negligible)) if np.any(is_negligible) else n_nodes
            has_spare_nodes = order < n_nodes - 0.25 * margin
            if has_spare_nodes:
                # strong damping leaves no response at the end, and no order: two are the least
                return max(order, 2)
            n_nodes *= 2

    # -- recursion ---------------------------------------------------------------------------------

    def follow(
        self, listen: Callable[[Array], Array], times: Array, frames: Array
    ) -> tuple[Array, Array, Array]:
        """Return the signals of receivers, and the motions of all balls, from one recursion.

        Parameters
        ----------
        listen : linear function of the mass-weighted velocities (size,), which returns the signals
            (n_r,) of receivers.
        times : (n_t,) even times from zero, s, of the signals.
        frames : (n_f,) times, s, at which the motions of all balls are returned.

        Returns
        -------
        signals : (n_r, n_t) of receivers, at the ``times``.
        displacements, velocities : (n_f, size), mass-weighted, at the ``frames``.

        Raises :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero.
        """
        responses = self._find_oscillators(self.order)
        coefficients = self._expand_frames(responses, frames)
        moments, states = self._recurse(listen, coefficients)
        # the transform sums (2 - delta_n0) mu_n T_n(y_k): the spectral weights at nodes (n, n_r),
        # of which the velocities at all times follow
        spectrum = dct(moments, type=3, axis=0)[responses.node] / self.order
        signals = self._evaluate(responses, spectrum * responses.velocity[:, None], times)
        displacements = states[: frames.size]
        velocities = states[frames.size :]
        return signals.T, displacements, velocities

    def _expand_frames(self, responses: _Exponentials, frames: Array) -> Array:
        """Return the coefficients (2 n_f, order) of the polynomials T_n b in the displacements at
        the times ``frames`` (n_f,), s, and then in the velocities at these times.

        ``responses`` are the motions of the oscillators at the nodes.
        """
        rates = responses.rate
        end = self.burst.duration
        is_early = frames < end
        # (n_f, n) sizes to which the burst has driven the exponentials
        sizes = np.empty((frames.size, rates.size), complex)
        sizes[is_early] = self.burst.drive(rates, frames[is_early])
        sizes_at_end = self.burst.drive(rates, np.array([end]))[0]
        times_after = frames[~is_early] - end
        sizes[~is_early] = np.exp(np.multiply.outer(times_after, rates)) * sizes_at_end
        displacements = np.real(sizes * responses.displacement).T  # (n, n_f)
        velocities = np.real(sizes * responses.velocity).T
        at_nodes = np.zeros((self.order, 2 * frames.size))
        np.add.at(at_nodes, responses.node, np.hstack([displacements, velocities]))
        coefficients = dct(at_nodes.T, type=2, axis=1) / self.order
        coefficients[:, 0] *= 0.5
        return np.asarray(coefficients)

    def _recurse(
        self, listen: Callable[[Array], Array], coefficients: Array
    ) -> tuple[Array, Array]:
        """Return what receivers ``listen`` to in the polynomials T_n b of the push b, (order, n_r),
        and the sums (2 n_f, size) over n of T_n b times the ``coefficients`` (2 n_f, order).

        Raises :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero.
        """
        size = self.push.size
        order = self.order
        states = np.zeros((len(coefficients), size))
        moments = []
        largest_norm = np.linalg.norm(self.push) * (1.0 + GROWTH)
        # polynomials are kept in a block, and multiplied by their coefficients all at once
        block = np.empty((max(1, min(order, _BLOCK // size)), size))
        vectors = zip(range(order), polynomials(self.operator, self.push), strict=False)
        with self.operator.progress.step("pulse", order) as step:
            for n, vector in vectors:
                moments.append(listen(vector))
                row = n % len(block)
                block[row] = vector
                is_block_full = row == len(block) - 1
                if is_block_full or n == order - 1:
                    first = n - row
                    states += coefficients[:, first : n + 1] @ block[: row + 1]
                    # nan compares as false, so that numbers that overflowed are unstable, too
                    is_bounded = np.linalg.norm(vector) <= largest_norm
                    if not is_bounded:
                        raise explain_instability(self.operator.network)
                step.advance()
        return np.array(moments), states

    def _evaluate(self, responses: _Exponentials, weights: Complex, times: Array) -> Array:
        """Return the signals (n_t, n_r) of receivers at even ``times`` (n_t,), s.

        Each signal is the real part of the sum of the exponentials of ``responses`` that the burst
        has driven, times their ``weights`` (n, n_r) at receivers. After the burst the exponentials
        go on by themselves. Times are evaluated chunk by chunk, as memory allows.
        """
        rates = responses.rate
        end = self.burst.duration
        signals = np.empty((times.size, weights.shape[1]))
        n_during = int(np.count_nonzero(times < end))
        n_rows = max(1, _BLOCK // rates.size)
        for first in range(0, n_during, n_rows):
            chunk = slice(first, min(first + n_rows, n_during))
            signals[chunk] = np.real(self.burst.drive(rates, times[chunk]) @ weights)
        if n_during == times.size:
            return signals
        # sizes of the exponentials at the end of the burst, from where they go on by themselves
        sizes_at_end = self.burst.drive(rates, np.array([end]))[0]
        weights_at_end = weights * sizes_at_end[:, None]
        since_first = times[n_during : n_during + n_rows] - times[n_during]
        within_chunk = np.exp(np.multiply.outer(since_first, rates))  # the same for each chunk
        for first in range(n_during, times.size, n_rows):
            chunk = slice(first, min(first + n_rows, times.size))
            count = chunk.stop - chunk.start
            to_chunk = np.exp(rates * (times[first] - end))
            weights_at_chunk = to_chunk[:, None] * weights_at_end
            signals[chunk] = np.real(within_chunk[:count] @ weights_at_chunk)
        return signals


@dataclass(frozen=True)
class Spans:
    """The spans of time in which a network whose motions are damped unevenly is propagated: so
    short that polynomials, which grow where damping is strong, lose no digits.

    Attributes
    ----------
    half_damping, radius : c/2 and R of the polynomials, both 1/s; see the head of this module.
    """

    half_damping: float
    radius: float

    @classmethod
    def of(cls, top: float, burst: ToneBurst, losses: Losses) -> Spans:
        """Return the spans of a network with its ``losses`` under a ``burst``; ``top``, rad/s, is
        the bound of its angular frequencies.
        """
        greatest_rate = np.max(losses.times) * top**2 + np.max(losses.drag)
        _, omegas = burst.waves
        radius = max(top, float(np.max(omegas)))
        return cls(0.5 * float(greatest_rate), radius)

    @property
    def longest(self) -> float:
        """The longest span, s."""
        longest = _LONGEST_PHASE / self.radius
        if self.half_damping > 0.0:
            longest = min(_LONGEST_DECAY / self.half_damping, longest)
        return longest

    def find_order(self, span: float) -> int:
        """Return the number of polynomials that are summed in a ``span``, s.

        Terms that are left out are at most :data:`_LEAST_TERM` at the end of the span.
        """
        phase = self.radius * span
        # more orders than needed are examined: terms fall off beyond an order of about the phase,
        # later where damping makes the polynomials grow
        n_orders = math.ceil(2.0 * phase + 3.0 * self.half_damping * span) + 80
        orders = np.arange(n_orders)
        # logarithm of the factor by which polynomials grow from order to order
        growth_rate = math.asinh(self.half_damping / self.radius)
        growth = np.exp(np.minimum(orders * growth_rate, _LARGEST_LOG))
        terms = np.abs(jv(orders, phase)) * growth
        last = int(np.flatnonzero(terms > _LEAST_TERM)[-1])
        return last + 2  # the orders from 0 to the last, and one more, which is small

    def count_products(self, end: float) -> float:
        """Return a bound of the number of products with D that the propagation up to the time
        ``end``, s, above zero, takes.
        """
        longest = min(self.longest, end)
        n_spans = math.ceil(end / longest) + 1  # the end of the burst divides one span
        # each span begins with a product, and computes one polynomial beyond its last one
        n_products_of_span = self.find_order(longest) + 1
        return float(n_spans * n_products_of_span)


class ViscousPropagation:
    """Responses of a network, whose motions are damped unevenly, to a burst of force; see
    :class:`Propagation` for those that are damped evenly.

    A state z (2 size + 6,) holds top times the displacements, then the velocities, both
    mass-weighted, and then the three cosines and three sines of the waves of the source.

    Parameters
    ----------
    operator : D.
    push : (size,) mass-weighted forces, N/kg^1/2, not all zero, which act times the burst.
    burst : the course of the force in time.
    losses : losses of the network.
    """

    def __init__(
        self, operator: WaveOperator, push: Array, burst: ToneBurst, losses: Losses
    ) -> None:
        self.operator = operator
        self.burst = burst
        self._push = push
        self._viscous = operator.resist(losses)
        self._spans = Spans.of(operator.top, burst, losses)
        # alpha of the source; see the head of this module
        self._alpha = _SOURCE_SIZE * float(np.linalg.norm(push)) / self._spans.radius
        amplitudes, self._omegas = burst.waves
        # the burst is the imaginary part of the sum of amplitude (cos + i sin)
        factors = np.concatenate([np.imag(amplitudes), np.real(amplitudes)])
        self._source_factors = factors / self._alpha

    def _apply(self, z: Array) -> Array:
        """Return X z = (L z + c/2 z)/R of a state z (2 size + 6,)."""
        size = self._push.size
        top = self.operator.top
        product = np.empty_like(z)
        scaled_x = z[:size]
        v = z[size : 2 * size]
        source = z[2 * size :]
        product[:size] = top * v
        force = (self._source_factors @ source) * self._push
        spring_force = (self.operator @ scaled_x) / top
        product[size : 2 * size] = force - self._viscous @ v - spring_force
        cosines, sines = np.split(source, 2)
        product[2 * size :] = np.concatenate([-self._omegas * sines, self._omegas * cosines])
        product += self._spans.half_damping * z
        product /= self._spans.radius
        return product

    def _expand(self, span: float, times: Array) -> Array:
        """Return the coefficients (n_t, order) of the polynomials Q_n z of the state z at the
        beginning of a ``span``, s, in the states at ``times`` (n_t,), s, after this beginning.
        """
        half_damping = self._spans.half_damping
        radius = self._spans.radius
        orders = np.arange(self._spans.find_order(span))
        multiplicity = np.where(orders > 0, 2.0, 1.0)  # orders above zero count twice
        bessel = multiplicity * jv(orders, radius * times[:, None])
        return np.asarray(bessel * np.exp(-half_damping * times)[:, None])

    def follow(
        self, listen: Callable[[Array], Array], times: Array, frames: Array
    ) -> tuple[Array, Array, Array]:
        """Return the signals of receivers, and the motions of all balls, span by span; arguments
        and results are those of :meth:`Propagation.follow`. All is at rest at the time zero.
        """
        size = self._push.size
        n_waves = self._omegas.size
        end = max(float(times[-1]), float(np.max(frames, initial=0.0)))
        # the waves of the source begin with cosines of one and sines of zero
        z = np.zeros(2 * size + 2 * n_waves)
        z[2 * size : 2 * size + n_waves] = self._alpha

        def listen_to_state(state: Array) -> Array:
            """Return the signals (n_r,) of receivers in a state z, by its velocities."""
            return listen(state[size : 2 * size])

        signals = np.zeros((times.size, listen(z[:size]).size))
        displacements = np.zeros((frames.size, size))
        velocities = np.zeros((frames.size, size))
        with self.operator.progress.step("pulse", end / self.burst.duration) as step:
            for first, last in self._list_spans(end):
                is_in_span = (times > first) & (times <= last)
                if first == 0.0:
                    is_in_span |= times == 0.0
                frames_in_span = np.flatnonzero((frames > first) & (frames <= last))
                # the state at the end of the span comes first, then those at its frames
                state_times = np.concatenate([[last], frames[frames_in_span]]) - first
                signal_times = times[is_in_span] - first
                states, span_signals = self._propagate(
                    z, last - first, state_times, signal_times, listen_to_state
                )
                z = states[0]
                signals[is_in_span] = span_signals
                displacements[frames_in_span] = states[1:, :size] / self.operator.top
                velocities[frames_in_span] = states[1:, size : 2 * size]
                if last == self.burst.duration:
                    z[2 * size :] = 0.0  # the source is silent from here on
                step.advance((last - first) / self.burst.duration)
        return signals.T, displacements, velocities

    def _list_spans(self, end: float) -> Iterator[tuple[float, float]]:
        """Yield the first and the last time, s, of each span in which the state is propagated at
        once, up to the time ``end``; the burst ends between two of these spans.
        """
        longest = self._spans.longest
        first = 0.0
        has_burst_ended = False
        while first < end:
            last = min(first + longest, end)
            if not has_burst_ended and last >= self.burst.duration:
                last = self.burst.duration
                has_burst_ended = True
            yield first, last
            first = last

    def _propagate(
        self,
        z: Array,
        span: float,
        state_times: Array,
        signal_times: Array,
        listen: Callable[[Array], Array],
    ) -> tuple[Array, Array]:
        """Return the states (m, 2 size + 6) at ``state_times`` (m,), s, and the signals (n, n_r) of
        receivers, by ``listen``, at ``signal_times`` (n,), s.

        Times count from the beginning of a ``span``, s, where the state is ``z``, and are within
        the span.
        """
        coefficients = self._expand(span, np.concatenate([state_times, signal_times]))
        of_states = coefficients[: state_times.size]
        of_signals = coefficients[state_times.size :]
        states = np.zeros((state_times.size, z.size))
        signals = np.zeros((signal_times.size, listen(z).size))
        previous = z
        current = self._apply(z)
        for order in range(coefficients.shape[1]):
            for state, factor in zip(states, of_states[:, order], strict=True):
                if factor:
                    state += factor * previous
            signals += of_signals[:, order, None] * listen(previous)
            # Q_n+1 = 2 X Q_n + Q_n-1, in place
            following = self._apply(current)
            following *= 2.0
            following += previous
            previous = current
            current = following
        return states, signals
