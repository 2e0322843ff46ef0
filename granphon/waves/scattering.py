"""Transmission through a strip of balls between half-infinite crystals, its leads.

In each lead all waves at a frequency are known (:mod:`granphon.dynamics.bloch_waves`). A wave that
runs in from the left lead drives the strip, whose equations are sparse. The waves that leave the
strip run out, or decay, in the leads. So the amplitudes of waves follow without a small damping,
and without losses the energies that are sent back and that pass add up to the energy that came, to
rounding.

The equations of a strip too long for factors are eliminated slice by slice, from the far end to the
end that is driven: the memory is that of a slice, however long the strip
(:mod:`granphon.waves.slices`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.sparse_matrices import LARGEST_UNSYMMETRIC
from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import InputError, PrecisionError
from granphon.base.progress import Progress, silent
from granphon.base.results import Result, held, result_class
from granphon.base.scales import write_quantity
from granphon.base.text import counted
from granphon.base.validation import frequency_array
from granphon.dynamics.bloch_waves import (
    BlochWaves,
    Couplings,
    count_bloch_bytes,
    find_bloch_waves,
    require_bloch_memory,
)
from granphon.dynamics.compatibility import require_digits
from granphon.dynamics.damping import GivenLosses, Losses
from granphon.dynamics.factors import factorise
from granphon.dynamics.half_space import HalfSpace
from granphon.networks.network import ContactNetwork, given_network
from granphon.waves.operator import WaveOperator
from granphon.waves.slices import count_slice_bytes, find_slices, require_slices, solve_by_slices

#: distance, over the diameter, up to which a ball of the strip stands in the place of a ball of a
#: lead
_SITE_TOLERANCE = 0.1
#: imbalance of transmitted and reflected energy, over the energy that comes, up to which the
#: imbalance is rounding
_LARGEST_IMBALANCE = 1e-6
#: most entries of the matrices of leads at those frequencies whose waves are found together: 700 MB
_ENTRIES_AT_ONCE = 6_000_000
#: most steps of the fit of energies that fall with the length; each changes the level, and the
#: rate times the span of lengths, by at most one
_ROUNDS = 60
#: change of the level, and of the rate times the span, below which a fit is settled
_LARGEST_CHANGE = 1e-9
#: determinant of the curvatures of a fit, over the product of those along level and along rate,
#: below which level and rate are not told apart
_LEAST_DETERMINANT = 1e-12
#: largest size of a logarithm of an energy
_LARGEST_LOGARITHM = 300.0
#: greatest relative difference of the periods of strip and lead along the layers
_PERIOD_TOLERANCE = 0.01
#: height above the outermost ball that moves, over the diameter, from which a held ball lies beyond
#: the strip: it is between the heights of a ball of the same layer and one of the next
_LEAST_HEIGHT = 0.6


@result_class
class Transmission(Result, array="transmitted"):
    """Parts of the energy of waves that pass a strip between two leads. ``np.asarray`` of it is
    ``transmitted``.

    Waves are those that run in the leads at each frequency, in ascending order of their wave
    numbers. There are up to m; if there are fewer at a frequency, the rest of a row is zero.

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    modes : (n_f, 2) number of waves that run in from the first lead, and number of waves that run
        out in the other lead.
    transmitted, reflected : (n_f,) parts of the energy that pass, and that are sent back, as means
        over the waves that run in; their sum is 1 if nothing is lost. Both are zero where no wave
        runs in.
    transmitted_by_mode, reflected_by_mode : (n_f, m) the same parts for each wave that runs in.
    amplitudes : (n_f, m, m) amplitude of each wave that runs out behind the strip (middle axis) for
        each wave that runs in (last axis); their squared sizes are parts of the energy.
    wavenumbers : (n_f, m) wave numbers of the waves that run in, across the layers, 1/m.
    length : length of the strip, m: the height of a layer of the first lead, times the number of
        balls of the strip that move over that of the layer.
    warnings : one sentence if contacts of the strip are more viscous than stiff, which suggests
        that the damping, a time, was meant in another unit.
    """

    frequencies: Array = held(float, "f", "Hz")
    modes: Index = held(int, "f 2")
    transmitted: Array = held(float, "f")
    reflected: Array = held(float, "f")
    transmitted_by_mode: Array = held(float, "f m")
    reflected_by_mode: Array = held(float, "f m")
    amplitudes: Complex = held(complex, "f m m")
    wavenumbers: Array = held(float, "f m", "1/m")
    length: float = held(float, unit="m")
    warnings: tuple[str, ...] = held((str, ...), default=())

    @property
    def total(self) -> Array:
        """(n_f,) sum over all waves that run in of the parts of their energy that pass."""
        return np.asarray(self.transmitted_by_mode.sum(axis=1))


def transmission(
    left: Any,
    middle: Any,
    right: Any,
    frequencies: ArrayLike,
    *,
    axis: Any = 0,
    q: ArrayLike = (),
    damping: Any = 0.0,
    loss_factor: Any = 0.0,
    drag: Any = 0.0,
    dashpot: Any = 0.0,
    restitution: Any = 1.0,
    progress: Progress = silent,
) -> Transmission:
    """Return which part of the energy of waves passes a strip between two half-infinite crystals,
    its leads.

    Parameters
    ----------
    left, right : the leads: states, or networks with periods. The left one goes on towards lower
        layers.
    middle : the strip: a network that repeats as the leads do but for the ``axis``, such as
        ``network.cut(axis, layers)``. The outer balls of the strip stand where the next layers of
        the leads would. They touch the leads as the layers of a lead touch each other, with the
        same stiffness; so an interface of another stiffness belongs to the strip. Periods along the
        layers may differ by 1 %, places of balls by 0.1 of a diameter. Masses, diameters and loads
        may differ: whether the whole is at rest under its static forces is not examined.
        None if the leads touch: by contacts as stiff as those of the left lead. Some layers of the
        right lead then count as the strip.
    frequencies : (n_f,) Hz, ascending, above zero.
    axis : the axis across the layers of both leads, as for :meth:`ContactNetwork.cut`.
    q : (p - 1,) wave vector along the layers, in fractions of their reciprocal cell, for leads with
        p periods; zero by default.
    damping, loss_factor, drag, dashpot, restitution : losses of the strip, as in
        :meth:`Waves.response`. The leads lose no energy.
    progress : is told how many frequencies are done. ``gp.Waves(middle).estimate("transmission",
        left, right, frequencies, ...)`` says beforehand how long they take.

    A strip may be of any length: beyond 12,000 motions in space, 300,000 in a plane and 1,000,000
    on a line, it is taken slice by slice, in a time that goes as its length and as the cube of the
    number of motions across. Dense matrices of the motions of a slice, and of a layer of the leads,
    must fit into memory.

    Raises
    ------
    InputError : a lead without the axis as a period, or whose layers no contact joins; leads or a
        strip that do not fit, or with other motions of balls; a floor or clamped balls between
        them; leads or a strip with forces that have no potential, which are static tangential
        forces and torques, and slip by levers that exceed the arms of contacts; leads or a strip
        too wide for the memory; wrong numbers.
    PrecisionError : a ``q`` too far from Gamma; a frequency at the very edge of a band, or so low
        or high that the waves of the leads cannot be told apart; one that is exactly that of a mode
        of the strip which no wave of the leads reaches; and one at which without losses the two
        parts do not add up, to 1e-6, to what comes.
    """
    work = TransmissionWork.of(left, middle, right, frequencies, axis, q)
    work.require_memory()
    operator = work.operator
    losses = Losses.of(
        operator.network, GivenLosses(damping, loss_factor, drag, dashpot, restitution)
    )
    find_stiffness = _make_stiffness_function(operator, losses, work.first.q)
    return _collect(work, losses, _scatter_at_all(work, find_stiffness, progress))


def _collect(
    work: TransmissionWork, losses: Losses, scattered: Sequence[_ScatteredWaves]
) -> Transmission:
    """Return the transmission of the ``work``, through a strip with these ``losses``, that is made
    of the waves ``scattered`` at each frequency.

    Raises :class:`~granphon.base.errors.PrecisionError` if nothing is lost and energy is not
    conserved.
    """
    # numbers of waves that run in, and that run out behind the strip
    modes = np.array([waves.passing.shape[::-1] for waves in scattered])
    most_modes = int(modes.max(initial=0))
    amplitudes = _stack_matrices([waves.passing for waves in scattered], most_modes)
    back_amplitudes = _stack_matrices([waves.returning for waves in scattered], most_modes)
    running_factors = [waves.running_factors for waves in scattered]
    transmitted = np.sum(np.abs(amplitudes) ** 2, axis=1)
    reflected = np.sum(np.abs(back_amplitudes) ** 2, axis=1)
    wavenumbers = work.first.list_wavenumbers(running_factors, most_modes)
    if losses.is_none:
        is_running = np.arange(most_modes) < modes[:, :1]
        _require_balance(work.hertz, transmitted + reflected - is_running)
    divisor = np.maximum(modes[:, 0], 1)  # where no wave runs in, the mean is zero
    n_layers = work.operator.balls.size / work.first.space.per_layer
    return Transmission(
        frequencies=work.hertz,
        modes=modes,
        transmitted=transmitted.sum(axis=1) / divisor,
        reflected=reflected.sum(axis=1) / divisor,
        transmitted_by_mode=transmitted,
        reflected_by_mode=reflected,
        amplitudes=amplitudes,
        wavenumbers=wavenumbers,
        length=n_layers * work.first.space.height,
        warnings=losses.find_warnings(float(work.hertz[-1])),
    )


class _ScatteredWaves(NamedTuple):
    """What a strip makes of the m waves that run in at one frequency.

    Attributes
    ----------
    returning : (m, m) amplitudes of the waves that are sent back, of which there are as many as run
        in, for each wave that runs in (last axis).
    passing : (n, m) amplitudes of the n waves that run out behind the strip, for each wave that
        runs in.
    running_factors : (m,) factors from layer to layer of the waves that run in.
    """

    returning: Complex
    passing: Complex
    running_factors: Complex


def _scatter_at_all(
    work: TransmissionWork, find_stiffness: Callable[[float], Any], progress: Progress
) -> list[_ScatteredWaves]:
    """Return what the strip makes of the waves at each frequency of the ``work``; progress is told
    of each. ``find_stiffness`` is that of :func:`_make_stiffness_function`.

    Raises :class:`~granphon.base.errors.PrecisionError` at a frequency that is exactly that of a
    mode which no wave of the leads reaches, and for waves of the leads that cannot be told apart.
    """
    omega = 2.0 * np.pi * work.hertz
    scattered = list[_ScatteredWaves]()
    with progress.step("transmission", omega.size) as step:
        for start in range(0, omega.size, work.n_at_once):
            omega_at_once = omega[start : start + work.n_at_once]
            first_waves = work.first.find_waves(omega_at_once)
            last_waves = work.last.find_waves(omega_at_once)
            for w, *waves in zip(omega_at_once, first_waves, last_waves, strict=True):
                try:
                    returning, passing = _scatter(w**2, find_stiffness(w), work, waves)
                except (RuntimeError, np.linalg.LinAlgError):  # exactly singular
                    raise _explain_mode(w) from None
                (incoming, _), _ = waves
                running_factors = incoming.factors[: incoming.n_running]
                scattered.append(_ScatteredWaves(returning, passing, running_factors))
                step.advance()
    return scattered


def _explain_mode(omega: float) -> PrecisionError:
    """Return the error of equations that are singular at the angular frequency ``omega``, rad/s."""
    fault = f"at {write_quantity(omega / (2.0 * math.pi), 'Hz', 12)} the motion has no bound"
    why = "The strip, or a part of it or of a lead, has a mode of exactly this frequency"
    return PrecisionError(fault, why, "Shift the frequency by a millionth")


def _require_strip(operator: WaveOperator, leads: Sequence[_Lead]) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless the balls of the strip have the same
    motions as those of the ``leads``, and unless the forces of the strip have a potential; the
    strip is the network of the ``operator``.
    """
    motions = [operator.motions, *(lead.space.motions for lead in leads)]
    if len({(kind.name, kind.letters) for kind in motions}) > 1:
        fault = "the motions of the balls differ between the leads and the strip"
        raise InputError(
            fault, "A wave would have no motion to go on with", "Use the same motions, and friction"
        )
    if operator.whole is not None:
        raise InputError(
            "the strip has static tangential forces or torques, or slip by levers that exceed the"
            " arms",
            "These have no potential, so that the energies of waves would not add up",
            "Leave static forces out (prestress=False)",
        )


def _make_stiffness_function(
    operator: WaveOperator, losses: Losses, q: Array
) -> Callable[[float], Any]:
    """Return a function of the angular frequency, rad/s, that returns the stiffness of a strip with
    its ``losses``: a sparse matrix (size, size), (rad/s)^2.

    The strip is the network of the ``operator``; ``q`` (p,) is the wave vector along its p periods,
    in fractions, in their order. Waves go as exp(-i omega t), so that losses enter with the factor
    -i.
    """
    axes = np.flatnonzero(operator.network.pbc)
    phase = np.exp(2.0j * np.pi * (operator.network.shift[:, axes] @ q))
    springs = operator.weigh(phase=phase).tocsc()
    if losses.is_none:
        return lambda w: springs
    loss_factors = operator.weigh(losses.factors, phase).tocsc()
    viscous = operator.resist(losses, phase).tocsc()
    return lambda w: springs - 1j * loss_factors - 1j * w * viscous


def _stack_matrices(matrices: Sequence[Complex], size: int) -> Complex:
    """Return ``matrices`` (n, m), with n and m up to ``size``, as one array (n_f, size, size), in
    which rows and columns that a matrix does not have are zero.
    """
    stacked = np.zeros((len(matrices), size, size), complex)
    for number, matrix in enumerate(matrices):
        n, m = matrix.shape
        stacked[number, :n, :m] = matrix
    return stacked


def _require_balance(hertz: Array, excess: Array) -> None:
    """Raise :class:`~granphon.base.errors.PrecisionError` if energy is not conserved, but for
    rounding, at one of the frequencies ``hertz`` (n_f,), Hz, or is not known.

    ``excess`` (n_f, m) is, for each wave that runs in, the sum of the parts of its energy that pass
    and that are sent back, less one.
    """
    imbalance = np.max(np.abs(excess), axis=1, initial=0.0)
    if np.all(imbalance <= _LARGEST_IMBALANCE):  # False for nan
        return
    worst = int(np.argmax(imbalance))
    fault = (
        f"at {write_quantity(float(hertz[worst]), 'Hz', 12)} what passes and what is sent back"
        f" differ from what comes by {imbalance[worst]:.1e} of it"
    )
    why = (
        "Nothing is lost: rounding is magnified there, as at the edge of a band or a sharp"
        " resonance"
    )
    raise PrecisionError(fault, why, "Shift the frequency by a millionth")


@result_class
class ScatteringLengths(Result):
    """How far waves go in disordered strips of the length L.

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    mean_free_path, mean_free_path_error : (n_f, m) mean free path l, m, of each of the m waves, and
        its standard error: the squared size of the mean amplitude of the wave that goes on as
        itself falls as exp(-L/l). The path is infinite if it does not fall, and zero for waves that
        do not run at a frequency. The error is infinite if the path is, and if the wave stands out
        from the noise only in the shortest strips.
    localisation_length, localisation_length_error : (n_f,) localisation length xi, m, and its
        standard error: the mean of ln(total) falls as -2 L/xi (P. W. Anderson et al., Phys. Rev. B
        22, 3519, 1980). Both are infinite if it does not fall.
    """

    frequencies: Array = held(float, "f", "Hz")
    mean_free_path: Array = held(float, "f m", "m")
    mean_free_path_error: Array = held(float, "f m", "m")
    localisation_length: Array = held(float, "f", "m")
    localisation_length_error: Array = held(float, "f", "m")


def scattering_lengths(runs: Sequence[Transmission]) -> ScatteringLengths:
    """Return the mean free paths and localisation lengths that are fitted to transmissions through
    strips of several lengths.

    ``runs`` are transmissions with the same leads and frequencies, at least two samples for each
    length. For mean free paths, E exp(-L/l) is fitted to the squared sizes of mean amplitudes, less
    the variance of these means, with weights from the fitted fall and from the noise of all lengths
    together. For localisation lengths, a line is fitted to the means of ln(total), weighted as if
    their variances grew as the length. Weights from the scatter at each length would favour lengths
    whose scatter is small by chance, and make errors too small. Errors are standard errors, from
    the scatter over the samples of each length.

    Raises :class:`~granphon.base.errors.InputError` for what are no transmissions; for fewer than
    two lengths, and fewer than two samples of a length; for runs that differ in their frequencies
    or numbers of waves; and where nothing is transmitted.
    """
    _require_alike(runs)
    first = runs[0]
    lengths, runs_of_length = _group_by_length(runs)
    # amplitudes (runs, n_f, m) of a wave that goes on as itself, and total energies (runs, n_f)
    amplitudes = np.array([np.diagonal(run.amplitudes, axis1=1, axis2=2) for run in runs])
    totals = np.array([run.total for run in runs])
    # waves that run on both sides, (n_f, m)
    is_running = np.arange(amplitudes.shape[2]) < first.modes.min(axis=1)[:, None]
    has_running = np.any(is_running, axis=1)
    if np.any(totals[:, has_running] <= 0.0) or not np.all(has_running):
        raise InputError(
            "nothing is transmitted at some frequency", mend="Leave out frequencies of gaps"
        )
    amplitudes_of_length = [amplitudes[numbers] for numbers in runs_of_length]
    path, path_error = _fit_paths(lengths, amplitudes_of_length, is_running)
    logs = [np.log(totals[numbers]) for numbers in runs_of_length]
    log_rate, log_rate_error = _fit_logarithms(lengths, logs)
    length, length_error = _invert(log_rate, log_rate_error, 2.0)
    return ScatteringLengths(
        frequencies=first.frequencies,
        mean_free_path=path,
        mean_free_path_error=path_error,
        localisation_length=length,
        localisation_length_error=length_error,
    )


def _group_by_length(runs: Sequence[Transmission]) -> tuple[Array, list[Index]]:
    """Return the lengths (k,), m, of the strips of ``runs``, ascending, and for each length the
    indices (samples,) of its runs.

    Raises :class:`~granphon.base.errors.InputError` for fewer than two lengths, and fewer than two
    samples of a length.
    """
    lengths, length_of_run = np.unique([run.length for run in runs], return_inverse=True)
    runs_of_length = [np.flatnonzero(length_of_run == number) for number in range(len(lengths))]
    fewest_samples = min(len(numbers) for numbers in runs_of_length)
    if len(lengths) < 2 or fewest_samples < 2:
        samples = counted(fewest_samples, "sample")
        fault = f"the runs have {counted(len(lengths), 'length')}, with {samples} or more of each"
        raise InputError(fault, "A fall and its error need two of each", "Give more runs")
    return lengths, runs_of_length


def _fit_paths(
    lengths: Array, amplitudes: Sequence[Complex], is_running: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return the mean free paths (n_f, m), m, and their errors (n_f, m), m, of waves; zero where a
    wave does not run. ``is_running`` (n_f, m) is true for at least one wave.

    ``amplitudes`` has for each of the ``lengths`` (k,), m, an array (samples, n_f, m).
    """
    rates_and_errors = []
    for frequency, wave in np.argwhere(is_running):
        amplitudes_of_wave = [samples[:, frequency, wave] for samples in amplitudes]
        rates_and_errors.append(_fit_energy(lengths, amplitudes_of_wave))
    rates, rate_errors = np.array(rates_and_errors).T
    path = np.zeros(is_running.shape)
    path_error = np.zeros(is_running.shape)
    path[is_running], path_error[is_running] = _invert(rates, rate_errors, 1.0)
    return path, path_error


def _require_alike(runs: Any) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless ``runs`` are transmissions with the
    same frequencies and waves.
    """
    is_of_runs = isinstance(runs, Sequence) and all(isinstance(run, Transmission) for run in runs)
    if not is_of_runs or len({run.amplitudes.shape for run in runs}) != 1:
        raise InputError(
            "runs are not transmissions with the same leads", mend="Give results of gp.transmission"
        )
    first = runs[0]
    for run in runs:
        if np.any(run.frequencies != first.frequencies) or np.any(run.modes != first.modes):
            raise InputError(
                "runs have other frequencies or waves", mend="Give results of the same leads"
            )


def _fit_logarithms(lengths: Array, logs: Sequence[Array]) -> tuple[Array, Array]:
    """Return the rates (n_f,) at which the mean logarithm of the total transmission falls over the
    ``lengths`` (k,), m, and their errors (n_f,), both 1/m.

    ``logs`` has the logarithms of the samples of each length, k arrays (samples, n_f).
    """
    counts = np.array([len(samples) for samples in logs])
    # the variance of the logarithm grows as the length
    shares = _find_slope_shares(lengths, counts / lengths)
    means = [samples.mean(axis=0) for samples in logs]
    rates = -np.tensordot(shares, means, 1)
    variances = [np.var(samples, axis=0, ddof=1) / len(samples) for samples in logs]
    return rates, np.sqrt(np.tensordot(shares**2, variances, 1))


def _invert(rate: Array, error: Array, factor: float) -> tuple[Array, Array]:
    """Return the lengths ``factor``/``rate`` (...), m, and their errors (...), m, of falls with a
    ``rate`` (...), 1/m, and its ``error`` (...), 1/m. Length and error are infinite where the rate
    is not above zero.
    """
    is_falling = rate > 0.0
    length = np.divide(factor, rate, out=np.full(rate.shape, np.inf), where=is_falling)
    relative_error = np.divide(error, rate, out=np.full(rate.shape, np.inf), where=is_falling)
    return length, length * relative_error


def _find_slope_shares(x: Array, weights: Array) -> Array:
    """Return the factors (n,) with which values at ``x`` (n,) add up to the slope of the line that
    is fitted to the values with these ``weights`` (n,).
    """
    offsets = x - np.average(x, weights=weights)
    return np.asarray(weights * offsets / np.sum(weights * offsets**2))


def _fit_energy(lengths: Array, amplitudes: list[Complex]) -> tuple[float, float]:
    """Return the rate, 1/m, at which the squared size of the mean of ``amplitudes`` falls over the
    ``lengths`` (k,), m, and its standard error, 1/m; ``amplitudes`` has for each length an array
    (samples,).

    The squared size less the variance of the mean has the mean E = E_0 exp(-rate L), whatever the
    number n of samples. This difference is a U statistic (W. Hoeffding, Ann. Math. Stat. 19, 293
    (1948)), with the variance 4 a E/n + 2 |C|^2/(n (n - 1)), where C are the covariances of the
    parts of amplitudes along and across the mean, and a is the variance along the mean.

    The weights of the fit take C from all lengths together, the same in all directions; the error
    takes C at each length. Both take E from the fit, which is repeated until it does not change
    (quasi-likelihood). If the fit does not settle, or does not tell the level from the rate, the
    signal is above the noise only at the least length, and the error is infinite.
    """
    statistics = _Statistics.of(amplitudes)
    offsets = lengths - np.average(lengths, weights=statistics.counts)
    # energies are exp(level - rate offset); the fit changes the level, and the rate times the span
    level, rate = _fit_line(lengths, offsets, statistics.squares, statistics.counts)
    span = float(np.ptp(lengths))
    for _ in range(_ROUNDS):
        logs = np.clip(level - rate * offsets, -_LARGEST_LOGARITHM, _LARGEST_LOGARITHM)
        fitted_energies = np.exp(logs)
        derivatives = np.stack([fitted_energies, -fitted_energies * offsets / span])  # (2, lengths)
        weights = statistics.weigh(fitted_energies)
        matrix = derivatives * weights @ derivatives.T
        if np.linalg.det(matrix) <= _LEAST_DETERMINANT * matrix[0, 0] * matrix[1, 1]:
            break
        shares = np.linalg.solve(matrix, derivatives * weights)
        change = shares @ (statistics.energies - fitted_energies)
        change /= max(1.0, float(np.max(np.abs(change))))  # each by at most one
        level = level + float(change[0])
        rate = rate + float(change[1]) / span
        if np.max(np.abs(change)) < _LARGEST_CHANGE:
            variances = statistics.find_variances(fitted_energies)
            return rate, math.sqrt(float(shares[1] ** 2 @ variances)) / span
    return rate, math.inf


class _Statistics(NamedTuple):
    """What the amplitudes of a wave are at each of k lengths.

    Attributes
    ----------
    counts : (k,) numbers n of samples.
    squares : (k,) squared sizes of the mean amplitudes.
    covariances : (k, 2, 2) covariances C of the parts of amplitudes along and across the mean.
    """

    counts: Array
    squares: Array
    covariances: Array

    @classmethod
    def of(cls, amplitudes: Sequence[Complex]) -> Self:
        """Return the statistics of ``amplitudes``, an array (samples,) for each length."""
        counts = np.array([len(samples) for samples in amplitudes], float)
        means = np.array([samples.mean() for samples in amplitudes])
        return cls(counts, np.abs(means) ** 2, _find_covariances(amplitudes, means))

    @property
    def n_pairs(self) -> Array:
        """(k,) numbers n (n - 1) of pairs of samples, each pair counted twice."""
        return self.counts * (self.counts - 1.0)

    @property
    def noise(self) -> Array:
        """(k,) variances of the complex amplitudes."""
        return np.asarray(np.trace(self.covariances, axis1=1, axis2=2))

    @property
    def energies(self) -> Array:
        """(k,) squared sizes of the means less the variances of the means."""
        return self.squares - self.noise / self.counts

    def weigh(self, energies: Array) -> Array:
        """Return weights (k,) for the fit of the :attr:`energies`: one over their variances about
        ``energies`` (k,), but for a common factor, with the noise of all lengths together, the same
        in all directions.
        """
        common_variance = 0.5 * float(np.average(self.noise, weights=self.counts - 1.0))
        return 1.0 / (energies / self.counts + common_variance / self.n_pairs)

    def find_variances(self, energies: Array) -> Array:
        """Return the variances (k,) of the :attr:`energies` about ``energies`` (k,)."""
        variances_along_mean = self.covariances[:, 0, 0]
        covariance_squares = np.sum(self.covariances**2, axis=(1, 2))
        variances = 4.0 * variances_along_mean * energies / self.counts
        return np.asarray(variances + 2.0 * covariance_squares / self.n_pairs)


def _find_covariances(amplitudes: Sequence[Complex], means: Complex) -> Array:
    """Return for each of k lengths the covariances (k, 2, 2) of the parts of ``amplitudes`` along
    and across their complex mean, which is that of ``means`` (k,).

    ``amplitudes`` has for each length an array (samples,). If its mean is zero, all covariances are
    zero.
    """
    covariances = []
    for samples, mean in zip(amplitudes, means, strict=True):
        divisor = abs(mean) or 1.0
        along_mean = samples * np.conj(mean) / divisor  # with the mean on the real axis
        covariances.append(np.cov(along_mean.real, along_mean.imag))
    return np.array(covariances)


def _fit_line(lengths: Array, offsets: Array, squares: Array, counts: Array) -> tuple[float, float]:
    """Return the level, a logarithm, and the rate, 1/m, with which the fit of energies
    exp(level - rate offset) begins: the rate of the line through the logarithms of the squared
    means, and the level of the mean energy with that rate.

    ``lengths``, m, have the ``offsets``, m, from their mean; ``squares`` are the squared mean
    amplitudes at each length, and ``counts`` the numbers of samples, all (k,). The rate is zero if
    fewer than two squares are above zero, and the level is -:data:`_LARGEST_LOGARITHM` if none is.
    """
    rate = 0.0
    level = -_LARGEST_LOGARITHM
    is_above = squares > 0.0
    if np.count_nonzero(is_above) > 1:
        shares = _find_slope_shares(lengths[is_above], (counts * squares)[is_above])
        rate = -float(shares @ np.log(squares[is_above]))
    if is_above.any():
        weights = counts * np.exp(-np.clip(rate * offsets, -_LARGEST_LOGARITHM, _LARGEST_LOGARITHM))
        level = math.log(np.average(squares, weights=weights))
    return level, rate


class _Lead(NamedTuple):
    """A half-infinite crystal that waves come from, or go to.

    It is divided into blocks of so many layers that a block is coupled only to the blocks beside
    it.

    Attributes
    ----------
    space : the crystal and its layers.
    q : (p - 1,) wave vector along the layers, in fractions.
    blocks : couplings (size, size), (rad/s)^2, within a block, and between a block and the next.
    """

    space: HalfSpace
    q: Array
    blocks: Couplings

    @classmethod
    def of(cls, source: Any, axis: Any, q: ArrayLike) -> _Lead:
        """Return the lead of a state or network; the arguments are those of
        :func:`transmission`.

        Raises :class:`~granphon.base.errors.InputError` for what has no network, and for a wave
        vector of another shape or not finite; :class:`~granphon.base.errors.PrecisionError` for a
        wave vector too far from Gamma; and what :class:`HalfSpace` raises for the axis.
        """
        space = HalfSpace(given_network(source), axis)
        wavevector = space.read_wavevector(q)
        require_digits(wavevector)
        unit_square = (2.0 * np.pi * space.units.frequency) ** 2
        blocks = [unit_square * block for block in space.couplings(wavevector)]
        return cls(space, wavevector, Couplings(*blocks))

    def find_waves(self, omega: Array) -> Sequence[tuple[BlochWaves, BlochWaves]]:
        """Return for each angular frequency of ``omega`` (n_f,), rad/s, the waves that go towards
        higher layers, and those that go towards lower layers.
        """
        motions_of_layer = self.space.size // self.space.reach
        return find_bloch_waves(self.blocks, omega**2, motions_of_layer)

    def list_wavenumbers(self, factors: Sequence[Complex], n_columns: int) -> Array:
        """Return the wave numbers (n_f, n_columns) across the layers, 1/m, of the waves that run at
        each frequency. ``factors`` has for each frequency the factors (m,) of its waves from layer
        to layer; in columns from m on there are zeros.
        """
        wavenumbers = np.zeros((len(factors), n_columns))
        for row, factors_of_row in zip(wavenumbers, factors, strict=True):
            row[: len(factors_of_row)] = self.space.wavenumbers(factors_of_row, self.q).real
        return wavenumbers

    def map_to_block(self, operator: WaveOperator, is_lower: bool) -> Any:
        """Return the sparse matrix S (size, size of the strip) that maps mass-weighted motions of
        the strip, the network of the ``operator``, to those of a block of the lead. The block is at
        the lower or, unless ``is_lower``, at the upper end of the strip.

        The balls of the strip that stand where those of the block would are found. They have masses
        and inertias of their own, and S weighs their motions with the masses and inertias of the
        lead. Raises :class:`~granphon.base.errors.InputError` for a strip that does not fit to the
        lead.
        """
        strip = operator.network
        misfit = f"the strip does not fit to the {'first' if is_lower else 'other'} lead"
        periods = strip.cell[np.flatnonzero(strip.pbc)][:, : strip.dimension]
        self._require_periods(periods, misfit)
        n_balls = self.space.size // operator.motions.count
        if len(operator.balls) >= n_balls:
            self._require_free_end(strip, operator.balls, is_lower, misfit)
            matches = self._match_block(operator, periods, is_lower)
            if matches is not None:
                return self._compose_end(operator, *matches)
        why = f"Its outer balls do not stand where {n_balls} balls of the lead's layers would"
        raise InputError(misfit, why, "Begin and end it with layers like the lead's")

    def _require_periods(self, periods: Array, misfit: str) -> None:
        """Raise :class:`~granphon.base.errors.InputError`, which begins with the text ``misfit``,
        unless the ``periods`` (p, d), m, of a strip are those of the lead along its layers.
        """
        cell = self.space.layers.cell
        tolerance = _PERIOD_TOLERANCE * np.max(np.abs(cell), initial=0.0)
        is_of_shape = periods.shape == cell.shape
        if not is_of_shape or np.any(np.abs(periods - cell) > tolerance):
            why = "It must repeat along the layers as the lead does, and not across them"
            raise InputError(
                misfit, why, "Give lead.cut(axis, layers), or a strip of the same width"
            )

    def _find_block(self, n_motions: int) -> Index:
        """Return the indices (block,), in the network ``space.cut``, of the balls of the first
        block of the lead; ``n_motions`` is the number of motions of a ball.
        """
        n_balls = self.space.size // n_motions
        return np.flatnonzero(self.space.cut.moving)[:n_balls]

    def _match_block(
        self, operator: WaveOperator, periods: Array, is_lower: bool
    ) -> tuple[Index, Array] | None:
        """Return the balls (block,) of the strip that stand where those of a block of the lead
        would, and the whole numbers of ``periods`` (p, d), m, by which each of these balls is
        displaced, (block, p); None if there are no such balls. The arguments are those of
        :meth:`map_to_block`.
        """
        strip = operator.network
        cut = self.space.cut
        block = self._find_block(operator.motions.count)
        n_sites = block.size
        p = len(periods)
        heights = strip.positions[operator.balls, p]  # layers lie along the first p axes
        from_end = np.argsort(heights if is_lower else -heights, kind="stable")
        outer_balls = operator.balls[from_end[:n_sites]]
        positions = strip.positions[outer_balls]
        sites = cut.positions[block]
        # the block is tried with its first site at each of the outer balls: "first" is the number
        # of that ball; distances are (first, block, n), of balls from sites
        distances, cells = _measure_sites(positions, sites - sites[0], periods)
        nearest = np.argmin(distances, axis=2)  # (first, block)
        largest_distances = np.min(distances, axis=2).max(axis=1)
        is_shared = [np.unique(balls).size < n_sites for balls in nearest]  # a ball has two sites
        largest_distances[is_shared] = np.inf
        # several first balls may match, as when two kinds of balls alternate: that one is taken
        # with which the sites of strip and lead are one lattice
        frame_shifts = self._find_frame_shifts(positions - sites[0], periods)
        tolerance = _SITE_TOLERANCE * float(2.0 * np.mean(cut.radii[block]))
        first = int(np.argmin(np.where(largest_distances <= tolerance, frame_shifts, np.inf)))
        if largest_distances[first] > tolerance:
            return None
        ball_of_site = nearest[first]
        return outer_balls[ball_of_site], cells[first, np.arange(n_sites), ball_of_site]

    def _find_frame_shifts(self, vectors: Array, periods: Array) -> Array:
        """Return how far ``vectors`` (n, d), m, are from steps that map the lead onto itself: the
        distances (n,), m, from the nearest whole sums of the ``periods`` (p, d), m, and of the step
        from layer to layer.
        """
        p = len(periods)
        frame = np.concatenate([periods, self.space.layers.stack[None]])[:, : p + 1]
        steps = vectors[:, : p + 1] @ np.linalg.inv(frame)
        parts_of_steps = steps - np.rint(steps)
        return np.asarray(np.linalg.norm(parts_of_steps @ frame, axis=1))

    def _compose_end(self, operator: WaveOperator, balls: Index, cells: Array) -> Any:
        """Return S of :meth:`map_to_block`, sparse, for the ``balls`` (block,) of the strip that
        stand where those of a block would, displaced by ``cells`` (block, p), whole numbers of
        periods.
        """
        from scipy.sparse import csr_array

        strip = operator.network
        cut = self.space.cut
        n_motions = operator.motions.count
        block = self._find_block(n_motions)
        # mass-weighted motions of the strip are weighted anew with the masses of the lead
        mass_roots = np.sqrt(cut.masses[block] / strip.masses[balls])
        inertia_roots = np.sqrt(cut.inertias[block] / strip.inertias[balls])
        is_rotation = operator.motions.is_rotation
        scale = np.where(is_rotation, inertia_roots[:, None], mass_roots[:, None])
        phases = np.exp(-2.0j * np.pi * (cells @ self.q))
        entries = scale * phases[:, None]
        # the balls of the operator are in ascending order
        first_columns = np.searchsorted(operator.balls, balls)[:, None] * n_motions
        columns = first_columns + np.arange(n_motions)
        rows = np.arange(block.size * n_motions)
        shape = (self.space.size, operator.size)
        return csr_array((entries.ravel(), (rows, columns.ravel())), shape=shape)

    def _require_free_end(
        self, strip: ContactNetwork, balls: Index, is_lower: bool, misfit: str
    ) -> None:
        """Raise :class:`~granphon.base.errors.InputError`, which begins with the text ``misfit``,
        if a floor or clamped balls of the ``strip`` lie beyond its ``balls`` (n_free,) that move,
        at the lower or, unless ``is_lower``, at the upper end.

        Nothing is raised if the lead itself has bodies that do not move, as these then belong to
        its layers.
        """
        p = len(self.space.layers.cell)
        cut = self.space.cut
        block = self._find_block(strip.ball_motions.count)
        diameter = float(2.0 * np.mean(cut.radii[block]))
        outwards = -1.0 if is_lower else 1.0
        heights = strip.positions[:, p] * outwards
        for wall, (point, _) in strip.walls.items():  # a flat wall may have any position
            heights[wall] = point[p] * outwards
        heights_above = heights - heights[balls].max()
        # a floor, whose radius is infinite, is never of the same layer as balls
        least_heights = np.where(np.isinf(strip.radii), 0.0, _LEAST_HEIGHT * diameter)
        is_blocking = ~strip.moving & (heights_above > least_heights)
        if np.all(self.space.network.moving) and np.any(is_blocking):
            raise InputError(
                misfit,
                "A floor or clamped balls stand between strip and lead",
                "Cut it with free edges",
            )


def _measure_sites(places: Array, sites: Array, periods: Array) -> tuple[Array, Array]:
    """Return the distances (first, block, n), m, of n balls from the sites of a block, when its
    first site is put at each of the balls in turn, and the whole numbers (first, block, n, p) of
    periods by which balls are displaced to be nearest.

    Balls have the ``places`` (n, d), m; ``sites`` (block, d), m, count from the first site, and
    ``periods`` are (p, d), m.
    """
    p = len(periods)
    # axes: the ball at the first site, the site, the ball whose distance is measured
    vectors = places[None, None] - sites[None, :, None] - places[:, None, None]
    cells = np.rint(vectors[..., :p] @ np.linalg.inv(periods[:, :p]))
    vectors[..., :p] -= cells @ periods[:, :p]
    return np.linalg.norm(vectors, axis=-1), cells


def _find_green(square: float, inner: Complex, beyond: Complex) -> Complex:
    """Return Green's function (size, size), s^2, of the outer block of a lead, without the strip,
    at ``square`` = omega^2, (rad/s)^2: the inverse of omega^2 - inner - beyond.

    ``inner`` is the stiffness of the block, and ``beyond`` what the layers behind the block add to
    it, both (size, size), (rad/s)^2.
    """
    return np.asarray(np.linalg.inv(square * np.eye(len(inner)) - inner - beyond))


def _solve_strip(work: TransmissionWork, equations: Any, drive: Any) -> tuple[Complex, Complex]:
    """Return the motions of the blocks at the lower and at the upper end of the strip of the
    ``work``, (size of the block, m), that solve ``equations`` (size, size), sparse, with the right
    sides ``drive`` (size, m).

    Raises RuntimeError or numpy.linalg.LinAlgError if the equations are exactly singular.
    """
    lower, upper = work.ends
    if work.is_sliced:
        return solve_by_slices(equations.tocsr(), drive, lower, upper)
    strip_motions = factorise(equations, symmetric=False).solve(np.asarray(drive, complex))
    return lower @ strip_motions, upper @ strip_motions


def _find_self_energies(work: TransmissionWork, first_green: Complex, last_green: Complex) -> Any:
    """Return what the leads of the ``work`` add to the stiffness of the strip at its ends: a sparse
    matrix (size, size), (rad/s)^2, for the motions of the strip. It holds the stiffness of the
    contacts between the strip and the leads, which the strip alone lacks, and the self-energies of
    the leads behind these contacts.

    ``first_green`` (n_1, n_1) and ``last_green`` (n_2, n_2), s^2, are Green's functions of those
    blocks of the leads, of n_1 and n_2 motions, that are next to the strip.
    """
    from scipy.sparse import csc_array

    lower, upper = work.ends
    first = work.first.blocks
    last = work.last.blocks
    at_lower = csc_array(first.head + first.down @ first_green @ first.up)
    at_upper = csc_array(last.tail + last.up @ last_green @ last.down)
    return lower.conj().T @ at_lower @ lower + upper.conj().T @ at_upper @ upper


class TransmissionWork:
    """The leads and the strip of a transmission, and the memory that its search takes.

    The constructor raises :class:`~granphon.base.errors.InputError` for leads and a strip that do
    not fit, and for a strip whose forces have no potential.

    Attributes
    ----------
    hertz : (n_f,) frequencies, Hz.
    first, last : the lead that waves come from, and the lead behind the strip.
    operator : D of the strip.
    ends : the matrices S of :meth:`_Lead.map_to_block` of the lower and of the upper end.
    """

    def __init__(self, hertz: Array, first: _Lead, last: _Lead, operator: WaveOperator) -> None:
        _require_strip(operator, [first, last])
        self.hertz = hertz
        self.first = first
        self.last = last
        self.operator = operator
        self.ends = (
            first.map_to_block(operator, is_lower=True),
            last.map_to_block(operator, is_lower=False),
        )

    @classmethod
    def of(
        cls, left: Any, middle: Any, right: Any, frequencies: ArrayLike, axis: Any, q: ArrayLike
    ) -> Self:
        """Return the work of a :func:`transmission` with these arguments.

        Raises :class:`~granphon.base.errors.InputError` for a strip that has no network, and for
        frequencies that are not ascending and above zero; and as :meth:`_Lead.of` and the
        constructor do.
        """
        hertz = frequency_array("frequencies", frequencies, "above zero")
        first = _Lead.of(left, axis, q)
        last = _Lead.of(right, axis, q)
        if middle is None:
            # the strip is a piece of the right lead, one layer more than its contacts reach over:
            # contacts between the leads then have the stiffness of those of the left lead
            middle = last.space.network.cut(axis, last.space.reach + 1)
        operator = WaveOperator(given_network(middle))
        return cls(hertz, first, last, operator)

    @property
    def lead_size(self) -> int:
        """Number of motions of a block of the wider lead."""
        return max(self.first.space.size, self.last.space.size)

    @property
    def n_at_once(self) -> int:
        """Number of frequencies for which the waves of the leads are found together, as one stack
        of matrices: many if the matrices are small, and one if they are large.
        """
        entries = (2 * self.lead_size) ** 2  # the waves of both ways are found by one matrix
        return max(min(self.hertz.size, _ENTRIES_AT_ONCE // entries), 1)

    @property
    def is_sliced(self) -> bool:
        """Whether the strip is too large for factors, so that it is solved slice by slice."""
        operator = self.operator
        return operator.size > LARGEST_UNSYMMETRIC[operator.network.dimension]

    @cached_property
    def widths(self) -> Array:
        """(k,) number of motions of each slice of the strip."""
        from scipy.sparse import csr_array

        lower, upper = self.ends
        last = self.last.blocks
        # Green's function of the last lead couples all motions of the upper end that touch the
        # lead; those of the lower end are all in the first slice, whatever couples them
        touches_lead = np.any(last.up, axis=1)
        is_touched = np.any(last.down, axis=0)
        is_coupled = np.logical_and.outer(touches_lead, is_touched) | (last.tail != 0.0)
        pattern_of_lead = abs(upper).T @ csr_array(is_coupled) @ abs(upper)
        slices = find_slices(abs(self.operator.matrix) + pattern_of_lead, np.unique(lower.indices))
        return np.array([len(rows) for rows in slices], float)

    @property
    def memory(self) -> float:
        """Memory of the waves of the leads, and of the slices of the strip, bytes."""
        memory = count_bloch_bytes(self.n_at_once, self.lead_size)
        if self.is_sliced:
            memory += count_slice_bytes(int(self.widths.max()))
        return memory

    def require_memory(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless leads and slices fit into
        memory.
        """
        require_bloch_memory(self.n_at_once, self.lead_size)
        if self.is_sliced:
            require_slices(int(self.widths.max()))


def _scatter(
    square: float,
    matrix: Any,
    work: TransmissionWork,
    waves: Sequence[tuple[BlochWaves, BlochWaves]],
) -> tuple[Complex, Complex]:
    """Return the amplitudes of waves at ``square`` = omega^2, (rad/s)^2, for each of the m waves
    that run in: those of the m waves that are sent back, (m, m), and those of the n waves that run
    out behind the strip, (n, m).

    ``matrix`` (size, size) is the stiffness of the strip, (rad/s)^2. ``waves`` are, for the first
    and for the last lead, the waves towards higher and those towards lower layers.
    """
    from scipy.sparse import eye_array

    lower, _ = work.ends
    (incoming, outgoing_back), (outgoing_through, _) = waves
    first_blocks = work.first.blocks
    last_blocks = work.last.blocks
    first_reach = work.first.space.reach
    # beyond the outer block of a lead only outgoing waves run
    beyond_first = first_blocks.down @ outgoing_back.continue_by(-first_reach)
    beyond_last = last_blocks.up @ outgoing_through.continue_by(work.last.space.reach)
    first_green = _find_green(square, first_blocks.inner, beyond_first)
    last_green = _find_green(square, last_blocks.inner, beyond_last)
    # incoming waves push the outer block of the first lead, and by it the strip
    shapes = incoming.vectors[:, : incoming.n_running]
    phases = incoming.factors[: incoming.n_running] ** first_reach
    push = first_blocks.up @ shapes * phases
    drive = lower.conj().T @ (first_blocks.down @ (shapes - first_green @ push))
    stiffness = matrix + _find_self_energies(work, first_green, last_green)
    equations = square * eye_array(stiffness.shape[0]) - stiffness
    at_lower, at_upper = _solve_strip(work, equations, drive)
    back_motions = first_green @ (first_blocks.up @ at_lower - push)
    through_motions = last_green @ (last_blocks.down @ at_upper)
    back_amplitudes = outgoing_back.find_parts(back_motions)
    return back_amplitudes, outgoing_through.find_parts(through_motions)
