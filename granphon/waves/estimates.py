"""What results of waves cost, before they are found: products of D with a vector, and factors of D,
which are counted.

The time of a product is that of D itself, measured once; that of factors follows from the number of
motions (:func:`granphon.array.sparse_matrices.estimate_factors`). Memory is that of D while it is
made, and of vectors. Frequencies and places are checked as by the result itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import numpy as np

from granphon.array.sparse_matrices import estimate_factors
from granphon.base.scales import write_quantity
from granphon.base.text import counted
from granphon.base.validation import frequency_array, one_of, whole_number
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.damping import GivenLosses, Losses
from granphon.dynamics.linalg import MANY_COLUMNS
from granphon.dynamics.lowest_modes import size_block
from granphon.media.cost import Cost, Units, time_once
from granphon.waves.branches import read_wavevectors
from granphon.waves.chebyshev import Kernel
from granphon.waves.lowest import estimate_lowest
from granphon.waves.modes import DENSE, estimate_modes
from granphon.waves.operator import WaveOperator
from granphon.waves.pulses import PulseSource, count_products
from granphon.waves.response import TOLERANCE, ResponseWork
from granphon.waves.scattering import TransmissionWork
from granphon.waves.spectral_functions import PlaneWaves

#: bytes of D while it is made, over those of D itself: its parts, their transpose, and D
_MAKING = 3.0
#: bytes of D of an array, by stencils, for each contact
_STENCIL_BYTES = 200.0
#: bytes of the matrices of a strip over those of D while it is made
_COMPLEX = 3.0
#: vectors that a recursion holds: three polynomials, and what is made of them
_HELD = 4.0
#: steps of a Krylov space, with its sums, over products
_OF_SPACE = 2.0
#: solutions of a dense matrix (n, n) in n^3 s: eigenvalues with vectors; of a complex one that is
#: not Hermitian; a slice of a strip
_DENSE_TIME = 1.5e-9
_EIGEN_TIME = 4e-9
_SLICE_TIME = 6e-10
#: iterations that relax the balls of a random packing, over the balls along its side: measured with
#: 1571 to 1e5; relaxations of moduli; and their factors of real matrices, over complex ones
_ITERATIONS = 6.0
_RELAXATIONS = 2.0
_FACTORS_OF_MODULI = 0.6


class WaveEstimate:
    """The estimated cost of results of the waves of a network, by the names of the methods of
    :class:`~granphon.waves.waves.Waves` that find them.
    """

    def __init__(self, operator: WaveOperator) -> None:
        self.operator = operator

    def find(self, name: str, *arguments: Any, **options: Any) -> Cost:
        """Return the cost of the result ``name`` with the ``arguments`` and ``options`` of its
        method; InputError for a name without an estimate, and for what the method refuses.
        """
        parts: dict[str, Callable[..., Cost]] = {
            "dos": self._find_density,
            "spectral_function": self._find_spectra,
            "modes": self._find_modes,
            "branches": self._find_branches,
            "count_modes": self._find_counts,
            "response": self._find_response,
            "transmit": self._find_pulse,
            "transmission": self._find_transmission,
            "moduli": self._find_moduli,
        }
        return parts[one_of("the result", name, parts)](*arguments, **options)

    @cached_property
    def _matrix_bytes(self) -> float:
        """Memory of D while it is made, bytes."""
        if self.operator.vectors_at_once == 1:
            return _STENCIL_BYTES * self.operator.network.n_contacts
        matrix = self.operator.matrix
        return _MAKING * (matrix.data.nbytes + matrix.indices.nbytes)

    def _measure(self, together: int) -> float:
        """Return the time of a product of D with each of so many vectors together, s."""
        operator = self.operator
        shape = (operator.size,) if together == 1 else (operator.size, together)
        vectors = np.ones(shape)
        seconds = time_once(lambda: operator.advance(vectors, np.zeros(shape)))
        return seconds / together

    def _make(self, words: str, products: float, together: int = 1, memory: float = 0.0) -> Cost:
        """Return the cost of ``products`` with vectors, so many of them ``together``, and of more
        ``memory``, bytes; ``words`` name the result.
        """
        n_balls = self.operator.balls.size
        vectors = 8.0 * _HELD * self.operator.size * together
        return Cost(
            self._matrix_bytes + vectors + memory,
            units=(Units(products, partial(self._measure, together)),),
            parts=(f"{words} of {counted(n_balls, 'ball')}, {products:,.0f} products",),
        )

    def _make_factors(self, words: str, count: float) -> Cost:
        """Return the cost of ``count`` factors of D."""
        operator = self.operator
        seconds, memory = estimate_factors(operator.size, operator.network.dimension)
        n_balls = operator.balls.size
        return Cost(
            self._matrix_bytes + memory,
            units=(Units(count, lambda: seconds),),
            parts=(f"{words} of {counted(n_balls, 'ball')}, by factors",),
        )

    def _make_dense(self, words: str, count: float = 1.0) -> Cost:
        """Return the cost of ``count`` dense matrices of D, one after the other."""
        size = self.operator.size
        return Cost(
            4.0 * 8.0 * size**2,
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
        """Return the cost of a density of states."""
        operator = self.operator
        kernel = Kernel.of(operator.top / (2.0 * math.pi), resolution, moments)
        if operator.size <= DENSE:
            return self._make_dense("density of states")
        n_starts = whole_number("vectors", vectors, 1) * (2 if operator.motions.rotate else 1)
        together = min(operator.vectors_at_once, n_starts)
        return self._make("density of states", n_starts * (kernel.moments // 2), together)

    def _find_spectra(
        self, q: Any, polarisation: Any = "longitudinal", resolution: float | None = None,
        *, direction: Any = None, moments: int | None = None,
    ) -> Cost:  # fmt: skip
        """Return the cost of spectral functions."""
        operator = self.operator
        kernel = Kernel.of(operator.top / (2.0 * math.pi), resolution, moments)
        n_waves = PlaneWaves(operator, q, polarisation, direction).n_waves
        together = min(operator.vectors_at_once, n_waves)
        return self._make("spectral functions", n_waves * (kernel.moments // 2), together)

    def _find_modes(self, count: int = 10, nearest: float | None = None) -> Cost:
        """Return the cost of modes; where they are filtered, their density is found first."""
        operator = self.operator
        count = whole_number("count", count, 1)
        work = estimate_modes(operator, count, nearest)
        if work.is_dense:
            return self._make_dense(counted(count, "mode"))
        if work.factors:
            return self._make_factors(counted(count, "mode"), work.factors)
        return self._make(counted(count, "mode"), work.products, work.together, work.memory)

    def _find_branches(self, q: Any, count: int = 6) -> Cost:
        """Return the cost of branches; complex numbers take twice the time and memory."""
        operator = self.operator
        wavevectors = read_wavevectors(operator, q)
        words = (
            f"{counted(count, 'branch', 'branches')} at {counted(len(wavevectors), 'wave vector')}"
        )
        if operator.size <= DENSE:
            return self._make_dense(words, float(len(wavevectors)))
        together = size_block(whole_number("count", count, 1))
        products, memory = estimate_lowest(operator, together)
        # vectors, boxes and factors of single balls are complex, and D itself is made anew
        memory = 3.0 * memory + 2.0 * self._matrix_bytes
        return self._make(words, 2.0 * len(wavevectors) * products, together, memory)

    def _find_counts(self, frequencies: Any) -> Cost:
        """Return the cost of counts of modes."""
        return self._make_factors("modes below frequencies", float(np.size(frequencies)))

    def _find_response(
        self, frequencies: Any, _source: Any = None, _receiver: Any = None, *losses: Any,
        method: str | None = None, tolerance: float = TOLERANCE, **options: Any,
    ) -> Cost:  # fmt: skip
        """Return the cost of a response."""
        operator = self.operator
        hertz = frequency_array("frequencies", frequencies)
        losses_of_network = Losses.of(operator.network, GivenLosses.take(options, *losses))
        work = ResponseWork(operator, losses_of_network, 2.0 * math.pi * hertz, tolerance)
        by_factors, seconds = work.choose(method)
        n_factors = int(np.count_nonzero(by_factors))
        words = f"response at {counted(hertz.size, 'frequency', 'frequencies')}"
        total = self._make_factors(words, n_factors) if n_factors else Cost()
        if n_factors < hertz.size:
            in_space = seconds - (n_factors * work.factor_time if n_factors else 0.0)
            total += self._make(words, _OF_SPACE * in_space / work.step_time)
        return total

    def _find_transmission(
        self, left: Any, right: Any, frequencies: Any, *, axis: Any = 0, q: Any = (), **_losses: Any
    ) -> Cost:
        """Return the cost of a transmission through the network, between two leads."""
        work = TransmissionWork.of(left, self.operator.network, right, frequencies, axis, q)
        count = work.hertz.size
        seconds = 2.0 * _EIGEN_TIME * (2.0 * work.lead_size) ** 3
        of_slices = _SLICE_TIME * float(np.sum(work.widths**3))
        if work.by_slices:
            seconds += of_slices
        else:
            # strips are mostly narrow: their factors cost less than those of a cube
            of_factors, _bytes = estimate_factors(
                self.operator.size, self.operator.network.dimension
            )
            seconds += min(of_factors, of_slices)
        words = f"transmission at {counted(count, 'frequency', 'frequencies')}"
        return Cost(
            # the matrix is complex, and that less the square of a frequency beside it
            _COMPLEX * self._matrix_bytes + work.memory,
            units=(Units(float(count), lambda: seconds),),
            parts=(f"{words} through {counted(self.operator.balls.size, 'ball')}",),
        )

    def _find_moduli(self) -> Cost:
        """Return the cost of moduli and sound of the network as the cell of a lattice, which
        relaxes the motions of its balls.
        """
        operator = self.operator
        words = "moduli and sound"
        if operator.size <= MANY_COLUMNS:
            return self._make_dense(words)
        periods = int(np.count_nonzero(operator.network.pbc))
        if ContactLattice.from_network(operator.network).tries_iteration:
            together = periods**2  # all gradients of a displacement
            iterations = _RELAXATIONS * _ITERATIONS * operator.balls.size ** (1.0 / periods)
            held = 2.0 * 8.0 * _HELD * operator.size * together + self._matrix_bytes
            return self._make(words, iterations * together, together, held)
        return self._make_factors(words, _FACTORS_OF_MODULI)

    def _find_pulse(
        self, frequency: float, direction: Any, distance: float, cycles: float = 5.0,
        polarisation: Any = "longitudinal", **options: Any,
    ) -> Cost:  # fmt: skip
        """Return the cost of a pulse."""
        tangential = options.pop("tangential_damping", None)
        losses = GivenLosses.take(options).with_tangential(tangential)
        request = PulseSource(
            frequency, direction, distance, cycles, polarisation, losses=losses, **options
        )
        products = count_products(self.operator, request)
        return self._make(f"pulse of {write_quantity(frequency, 'Hz')}", products)
