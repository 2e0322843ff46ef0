"""Estimates of the time and memory that results of waves take, before they are found.

An estimate counts the products of D with a vector, and the factorisations of D. The time of a
product is measured once, with D itself. The time and memory of factors follow from the numbers of
motions and contacts (:meth:`granphon.waves.operator.WaveOperator.estimate_factors`). The memory is
that of D while it is made, and of vectors. Arguments of a result are checked as by the result
itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from inspect import signature
from typing import Any

import numpy as np

from granphon.base.scales import write_quantity
from granphon.base.text import counted
from granphon.base.validation import finite_array, frequency_array, one_of
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.damping import GivenLosses, Losses
from granphon.dynamics.iterative_relaxation import PROBES
from granphon.dynamics.linalg import MANY_COLUMNS
from granphon.dynamics.lowest_modes import size_block
from granphon.media.cost import Cost, Units, time_once
from granphon.waves.branches import read_count, read_wavevectors
from granphon.waves.chebyshev import Kernel
from granphon.waves.dos import DensityRequest
from granphon.waves.lowest import estimate_lowest
from granphon.waves.modes import MOST_DENSE_MOTIONS, estimate_modes, require_countable
from granphon.waves.operator import WaveOperator
from granphon.waves.pulses import PulseSource, count_products, find_frames_memory
from granphon.waves.response import TOLERANCE, Places, ResponseOptions, ResponseWork
from granphon.waves.scattering import TransmissionWork
from granphon.waves.spectral_functions import PlaneWaves

#: bytes that are in use while D is made, over those of D itself: its parts, their transpose, and D
_MAKING_SHARE = 3.0
#: bytes of D of an array, by stencils, for each contact
_STENCIL_BYTES = 200.0
#: bytes of the complex matrices of a strip, over those that are in use while D is made
_STRIP_SHARE = 3.0
#: vectors that a recursion holds: three polynomials, and one for the sums that are made of them
_HELD_VECTORS = 4.0
#: memory of the densities of states of one random vector, bytes for each moment
_DENSITY_BYTES = 400.0
#: time of a step of a Krylov space, with its sums, over that of a product
_STEP_PRODUCTS = 2.0
#: time, s, over n^3, of all eigenvalues and vectors of a dense symmetric matrix (n, n)
_DENSE_TIME = 1.5e-9
#: dense matrices that are held while the modes of one are found: the matrix itself, its vectors,
#: and two for the work; measured with a matrix of 2000 motions
_DENSE_COPIES = 4.0
#: time, s, over n^3, of all eigenvalues and vectors of a dense complex matrix that is not Hermitian
_EIGEN_TIME = 4e-9
#: time, s, over n^3, of the elimination of a slice of n motions
_SLICE_TIME = 6e-10
#: iterations that relax the balls of a random packing, over the number of balls along its side:
#: measured with packings of 1571 to 1e5 balls
_ITERATIONS = 6.0
#: relaxations that moduli take
_RELAXATIONS = 2.0
#: time and memory of the factors for moduli, which are real, over those of complex factors
_FACTORS_OF_MODULI = 0.6


class WaveEstimate:
    """Estimates of the cost of results for the network of an ``operator``, by the names of the
    methods of :class:`~granphon.waves.waves.Waves` that find them; and by "transmission" and
    "moduli", which other functions find.
    """

    def __init__(self, operator: WaveOperator) -> None:
        self.operator = operator

    def bind(self, name: str, *arguments: Any, **options: Any) -> Callable[[], Cost]:
        """Return the function that finds the cost of the result ``name``, one of :data:`FINDERS`,
        with the ``arguments`` and ``options`` of its method.

        The function raises what :meth:`granphon.waves.waves.Waves.estimate` raises for values. This
        method raises :class:`~granphon.base.errors.InputError` for a name without an estimate, and
        TypeError for arguments that the method does not have, and if some are missing.
        """
        find_cost = partial(FINDERS[one_of("the result", name, FINDERS)], self)
        signature(find_cost).bind(*arguments, **options)
        return partial(find_cost, *arguments, **options)

    @cached_property
    def _matrix_bytes(self) -> float:
        """Memory of D while it is made, bytes."""
        if self.operator.vectors_at_once == 1:  # D of an array, by stencils
            return _STENCIL_BYTES * self.operator.network.n_contacts
        matrix = self.operator.matrix
        return _MAKING_SHARE * (matrix.data.nbytes + matrix.indices.nbytes)

    def _time_product(self, block_size: int) -> float:
        """Return the time, s, of a product of D with one of ``block_size`` vectors that share the
        product, as one such product takes on this machine.
        """
        operator = self.operator
        shape = (operator.size,) if block_size == 1 else (operator.size, block_size)
        vectors = np.ones(shape)
        seconds = time_once(lambda: operator.advance(vectors, np.zeros(shape)))
        return seconds / block_size

    def _cost_products(
        self, words: str, products: float, block_size: int = 1, memory: float = 0.0
    ) -> Cost:
        """Return the cost of D and of a number of ``products`` of D with vectors, of which
        ``block_size`` share each product, plus ``memory``, bytes; ``words`` name the result.
        """
        n_balls = self.operator.balls.size
        vector_bytes = 8.0 * _HELD_VECTORS * self.operator.size * block_size
        return Cost(
            self._matrix_bytes + vector_bytes + memory,
            units=(Units(products, partial(self._time_product, block_size)),),
            parts=(f"{words} of {counted(n_balls, 'ball')}, {products:,.0f} products",),
        )

    def _cost_factors(self, words: str, count: float) -> Cost:
        """Return the cost of D and of ``count`` factorisations of D, one after the other;
        ``words`` name the result.
        """
        operator = self.operator
        seconds, memory = operator.estimate_factors()
        n_balls = operator.balls.size
        return Cost(
            self._matrix_bytes + memory,
            units=(Units(count, lambda: seconds),),
            parts=(f"{words} of {counted(n_balls, 'ball')}, by factors",),
        )

    def _cost_dense(self, words: str, count: float = 1.0) -> Cost:
        """Return the cost of all modes of ``count`` dense matrices as large as D, one after the
        other; ``words`` name the result.
        """
        size = self.operator.size
        return Cost(
            8.0 * _DENSE_COPIES * size**2,
            units=(Units(count * float(size) ** 3, lambda: _DENSE_TIME),),
            parts=(f"{words} of {counted(self.operator.balls.size, 'ball')}",),
        )

    def _find_density(
        self,
        resolution: float | None = None,
        vectors: int = 10,
        seed: int = 0,
        *,
        moments: int | None = None,
    ) -> Cost:
        """Return the cost of a density of states; arguments are those of ``Waves.dos``."""
        operator = self.operator
        request = DensityRequest.read(operator, resolution, vectors, seed, moments)
        if operator.size <= MOST_DENSE_MOTIONS:
            return self._cost_dense("density of states")
        n_moments = request.kernel.moments
        n_starts = request.vectors * (2 if operator.motions.rotate else 1)
        block_size = min(operator.vectors_at_once, n_starts)
        memory = _DENSITY_BYTES * request.vectors * n_moments
        return self._cost_products(
            "density of states", n_starts * (n_moments // 2), block_size, memory
        )

    def _find_spectra(
        self,
        q: Any,
        polarisation: Any = "longitudinal",
        resolution: float | None = None,
        *,
        direction: Any = None,
        moments: int | None = None,
    ) -> Cost:
        """Return the cost of spectral functions; arguments are those of
        ``Waves.spectral_function``.
        """
        operator = self.operator
        kernel = Kernel.of(operator.top / (2.0 * math.pi), resolution, moments)
        n_waves = PlaneWaves(operator, q, polarisation, direction).n_waves
        block_size = min(operator.vectors_at_once, n_waves)
        return self._cost_products(
            "spectral functions", n_waves * (kernel.moments // 2), block_size
        )

    def _find_modes(self, count: int = 10, nearest: float | None = None) -> Cost:
        """Return the cost of modes; arguments are those of ``Waves.modes``. If the modes would be
        filtered out of random vectors, their density of states is computed for the estimate.
        """
        work = estimate_modes(self.operator, count, nearest)
        if work.is_dense:
            return self._cost_dense(counted(count, "mode"))
        if work.factors:
            return self._cost_factors(counted(count, "mode"), work.factors)
        return self._cost_products(
            counted(count, "mode"), work.products, work.block_size, work.memory
        )

    def _find_branches(self, q: Any, count: int = 6) -> Cost:
        """Return the cost of branches; arguments are those of ``Waves.branches``. Products of the
        complex numbers of a large network count twice.
        """
        operator = self.operator
        count = read_count(operator, count)
        wavevectors = read_wavevectors(operator, q)
        words = (
            f"{counted(count, 'branch', 'branches')} at {counted(len(wavevectors), 'wave vector')}"
        )
        if operator.size <= MOST_DENSE_MOTIONS:
            return self._cost_dense(words, float(len(wavevectors)))
        block_size = size_block(count)
        products, memory = estimate_lowest(operator, block_size)
        # vectors, boxes and factors of single balls are complex, and D itself is made anew
        memory = 3.0 * memory + 2.0 * self._matrix_bytes
        return self._cost_products(words, 2.0 * len(wavevectors) * products, block_size, memory)

    def _find_counts(self, frequencies: Any) -> Cost:
        """Return the cost of the numbers of modes below ``frequencies``, Hz: one factorisation for
        each frequency up to the top. A frequency above the top takes none, as all modes are below.
        """
        hertz = finite_array("frequencies", frequencies, "Hz", "above zero")
        require_countable(self.operator)
        n_factors = np.count_nonzero(2.0 * math.pi * hertz <= self.operator.top)
        return self._cost_factors("modes below frequencies", float(n_factors))

    def _find_response(
        self,
        frequencies: Any,
        source: Any = None,
        receiver: Any = None,
        damping: Any = 0.0,
        loss_factor: Any = 0.0,
        *,
        drag: Any = 0.0,
        dashpot: Any = 0.0,
        restitution: Any = 1.0,
        quantity: str = "displacement",
        direction: Any = None,
        polarisation: Any = None,
        distance: float | None = None,
        method: str | None = None,
        tolerance: float = TOLERANCE,
    ) -> Cost:
        """Return the cost of a response; arguments are those of ``Waves.response``. ``source`` and
        ``receiver`` are not used, as the cost does not depend on them.
        """
        operator = self.operator
        hertz = frequency_array("frequencies", frequencies)
        options = ResponseOptions.read(quantity, method, tolerance)
        losses = Losses.of(
            operator.network, GivenLosses(damping, loss_factor, drag, dashpot, restitution)
        )
        Places(operator.network, direction, polarisation, distance)  # refuses wrong numbers
        work = ResponseWork(operator, losses, 2.0 * math.pi * hertz, options.tolerance)
        by_factors, seconds = work.choose(options.method)
        n_factors = int(np.count_nonzero(by_factors))
        words = f"response at {counted(hertz.size, 'frequency', 'frequencies')}"
        total = self._cost_factors(words, n_factors) if n_factors else Cost()
        if n_factors < hertz.size:
            # without factors their time may be infinite, and is not multiplied by zero
            factor_seconds = n_factors * work.factor_time if n_factors else 0.0
            steps = (seconds - factor_seconds) / work.step_time
            total += self._cost_products(words, _STEP_PRODUCTS * steps)
        return total

    def _find_transmission(
        self,
        left: Any,
        right: Any,
        frequencies: Any,
        *,
        axis: Any = 0,
        q: Any = (),
        damping: Any = 0.0,
        loss_factor: Any = 0.0,
        drag: Any = 0.0,
        dashpot: Any = 0.0,
        restitution: Any = 1.0,
    ) -> Cost:
        """Return the cost of a transmission through the network, between the leads ``left`` and
        ``right``; the other arguments are those of :func:`granphon.transmission`, and ``q`` is ()
        where the strip repeats along no other axis.
        """
        given_losses = GivenLosses(damping, loss_factor, drag, dashpot, restitution)
        Losses.of(self.operator.network, given_losses)  # refuses wrong numbers
        work = TransmissionWork.of(left, self.operator.network, right, frequencies, axis, q)
        count = work.hertz.size
        seconds = 2.0 * _EIGEN_TIME * (2.0 * work.lead_size) ** 3  # waves of both leads
        slice_seconds = _SLICE_TIME * float(np.sum(work.widths**3))
        if work.is_sliced:
            seconds += slice_seconds
        else:
            # the estimate of factors is that of a cube; a narrow strip, as most are, costs less
            factor_seconds, _ = self.operator.estimate_factors()
            seconds += min(factor_seconds, slice_seconds)
        words = f"transmission at {counted(count, 'frequency', 'frequencies')}"
        return Cost(
            # the complex matrix of the strip, and beside it the squared frequency less this matrix
            _STRIP_SHARE * self._matrix_bytes + work.memory,
            units=(Units(float(count), lambda: seconds),),
            parts=(f"{words} through {counted(self.operator.balls.size, 'ball')}",),
        )

    def _find_moduli(self) -> Cost:
        """Return the cost of the moduli and sound velocities of the network as the cell of a
        lattice, for which the motions of its balls are relaxed: by a dense matrix if they are few,
        by iteration if they are many and the network repeats along three axes, and else by factors.
        """
        operator = self.operator
        words = "moduli and sound"
        if operator.size <= MANY_COLUMNS:
            return self._cost_dense(words)
        n_periods = int(np.count_nonzero(operator.network.pbc))
        if ContactLattice.from_network(operator.network).tries_iteration:
            block_size = n_periods**2  # all components of the gradient of a displacement
            iterations = _ITERATIONS * operator.balls.size ** (1.0 / n_periods)
            columns = _RELAXATIONS * block_size + PROBES
            # the vectors of conjugate gradients are those of three recursions, of which
            # _cost_products adds one; and the lattice has a matrix of its own
            vector_bytes = 2.0 * 8.0 * _HELD_VECTORS * operator.size * block_size
            memory = vector_bytes + self._matrix_bytes
            return self._cost_products(words, iterations * columns, block_size, memory)
        return self._cost_factors(words, _FACTORS_OF_MODULI)

    def _find_sent_pulse(
        self,
        frequency: float,
        direction: Any,
        distance: float,
        cycles: float = 5.0,
        polarisation: Any = "longitudinal",
        *,
        source: Any = "plane",
        ends: str = "free",
        damping: Any = 0.0,
        tangential_damping: float | None = None,
        drag: Any = 0.0,
        dashpot: Any = 0.0,
        restitution: Any = 1.0,
        duration: float | None = None,
        planes: Any = (),
        frames: Any = (),
    ) -> Cost:
        """Return the cost of a pulse; arguments are those of ``Waves.transmit``."""
        source_of_pulse = PulseSource(
            frequency,
            direction,
            distance,
            cycles,
            polarisation,
            source=source,
            ends=ends,
            damping=damping,
            tangential_damping=tangential_damping,
            drag=drag,
            dashpot=dashpot,
            restitution=restitution,
            duration=duration,
            planes=planes,
            frames=frames,
        )
        return self.find_pulse(source_of_pulse)

    def find_pulse(self, pulse: PulseSource) -> Cost:
        """Return the cost of sending a ``pulse``.

        Raises what :func:`~granphon.waves.pulses.count_products` raises.
        """
        products = count_products(self.operator, pulse)
        n_frames = np.size(pulse.frames)
        memory = find_frames_memory(n_frames, self.operator.network.n_balls, self.operator.size)
        words = f"pulse of {write_quantity(float(pulse.frequency), 'Hz')}"
        return self._cost_products(words, products, memory=memory)


#: the functions that estimate results, by the names of the results; each takes a
#: :class:`WaveEstimate` and the arguments of the method that finds the result
FINDERS: dict[str, Callable[..., Cost]] = {
    "dos": WaveEstimate._find_density,
    "spectral_function": WaveEstimate._find_spectra,
    "modes": WaveEstimate._find_modes,
    "branches": WaveEstimate._find_branches,
    "count_modes": WaveEstimate._find_counts,
    "response": WaveEstimate._find_response,
    "transmit": WaveEstimate._find_sent_pulse,
    "transmission": WaveEstimate._find_transmission,
    "moduli": WaveEstimate._find_moduli,
}
