"""Transmission through a strip of balls between half-infinite crystals, its leads.

Of each lead all waves at a frequency are known (:mod:`granphon.dynamics.bloch_waves`). One that
runs in from the left drives the strip, whose equations are sparse; the waves that leave the strip
run out, or decay, in the leads. So amplitudes of waves follow without a small damping, and the
energies sent back and through add up to the energy that came, to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import InputError, PrecisionError
from granphon.base.results import Result
from granphon.base.scales import write_quantity
from granphon.base.validation import frequency_array
from granphon.dynamics.bloch_waves import (
    BlochWaves,
    Couplings,
    find_bloch_waves,
    require_bloch_memory,
)
from granphon.dynamics.damping import ContactDamping
from granphon.dynamics.factors import factorise
from granphon.dynamics.half_space import HalfSpace
from granphon.networks.network import ContactNetwork, given_network
from granphon.waves.operator import WaveOperator

#: distance, over the diameter, up to which a ball of the strip stands in the place of one of a lead
_SAME_SITE = 0.1
#: imbalance of transmitted and reflected energy, over the energy that comes, up to which it counts
#: as rounding
_BALANCED = 1e-6
#: most steps of the fit of a fall; each changes logarithms by one at most
_ROUNDS = 60
#: last change of the logarithms in a fit
_SETTLED = 1e-9
#: determinant of the curvatures of a fit, over their product along level and rate, below which the
#: two are not told apart
_SINGULAR = 1e-12
#: largest logarithm of an energy, up or down
_FAR = 300.0
#: relative difference of periods along the layers that fit
_SAME_PERIOD = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class Transmission(Result, array="transmitted"):
    """Energy that waves of a lead bring through a strip. ``np.asarray`` of it is ``transmitted``.

    Waves are those that run at each frequency, in ascending order of their wave number; where they
    are fewer than m, the rest of a row is zero.

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    modes : (n_f, 2) numbers of waves that run in from the first lead, and out in the other one.
    transmitted, reflected : (n_f,) the mean over the waves that run in; their sum is 1 if nothing
        is lost. Both are zero where no wave runs in.
    transmitted_by_mode, reflected_by_mode : (n_f, m) of each wave that runs in.
    amplitudes : (n_f, m, m) from each wave that runs in (last axis) to each that runs out; their
        squared sizes are energies.
    wavenumbers : (n_f, m) of the waves that run in, across the layers, 1/m.
    length : of the strip, m: its layers times their height in the first lead.
    warnings : one sentence where contacts of the strip are more viscous than stiff, as a damping is
        a time.
    """

    frequencies: Annotated[Array, "f", "Hz"]
    modes: Annotated[Index, "f 2"]
    transmitted: Annotated[Array, "f"]
    reflected: Annotated[Array, "f"]
    transmitted_by_mode: Annotated[Array, "f m"]
    reflected_by_mode: Annotated[Array, "f m"]
    amplitudes: Annotated[Complex, "f m m"]
    wavenumbers: Annotated[Array, "f m", "1/m"]
    length: Annotated[float, "", "m"]
    warnings: tuple[str, ...] = ()

    @property
    def total(self) -> Array:
        """(n_f,) sum of the transmitted parts over all waves that run in."""
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
) -> Transmission:
    """Find what part of the energy of waves passes a strip between two half-infinite crystals.

    Parameters
    ----------
    left, right : the leads: states, or networks with periods. The left one goes on towards lower
        layers.
    middle : the strip: a network that repeats as the leads do but for the ``axis``, such as
        ``network.cut(axis, layers)``; or None if the leads touch. Its outer balls stand where the
        next layers of the leads would. They touch the leads as a lead's own layers touch each
        other, with its stiffness; so an interface of another stiffness belongs to the strip.
        Periods along the layers may differ by 1 %, places of balls by 0.1 of a diameter. Masses,
        diameters and loads may differ: whether the whole is at rest under its static forces is not
        examined.
    frequencies : (n_f,) Hz, ascending, above zero.
    axis : across the layers of both leads, as for :meth:`ContactNetwork.cut`.
    q : (p - 1,) wave vector along the layers, in fractions of their reciprocal cell; zero by
        default.
    damping, loss_factor : viscosity of the strip's contacts over their stiffness, s, and part of
        the stiffness that loses energy at any frequency, as in :meth:`Waves.response`: numbers or
        (n_c,), or tuples of those of normal and of all other motion.

    Raises
    ------
    InputError : a lead without the axis as a period; leads or a strip that do not fit; a floor or
        clamped balls between them; wrong numbers.
    PrecisionError : a frequency at the very edge of a band, or where without losses the two parts
        do not add up, to 1e-6, to what comes.
    """
    hertz = frequency_array("frequencies", frequencies, "above zero")
    first = _Lead.of(left, axis, q)
    last = _Lead.of(right, axis, q)
    leads = [first, last]
    require_bloch_memory(hertz.size, max(lead.space.size for lead in leads))
    if middle is None:
        middle = last.space.network.cut(axis, last.space.reach + 1)
    strip = given_network(middle)
    operator = WaveOperator(strip)
    damped = ContactDamping.of(strip, damping, loss_factor)
    _require_strip(operator, leads)
    ends = [first.fit(operator, lower=True), last.fit(operator, lower=False)]
    omega = 2.0 * np.pi * hertz
    waves_of_first = first.find_waves(omega)
    waves_of_last = last.find_waves(omega)
    matrix_at = _make_matrices(operator, damped, first.q)
    back = []
    through = []
    for w, *waves in zip(omega, waves_of_first, waves_of_last, strict=True):
        sent, passed = _scatter(w**2, matrix_at(w), leads, ends, waves)
        back.append(sent)
        through.append(passed)
    # numbers of waves that run in, and that run out behind the strip
    modes = np.array([passed.shape[::-1] for passed in through])
    most = int(modes.max(initial=0))
    amplitudes = _stack_matrices(through, most)
    reflected = np.sum(np.abs(_stack_matrices(back, most)) ** 2, axis=1)
    transmitted = np.sum(np.abs(amplitudes) ** 2, axis=1)
    wavenumbers = np.zeros((len(hertz), most))
    for row, (incoming, _) in enumerate(waves_of_first):
        n = incoming.running
        wavenumbers[row, :n] = first.space.wavenumbers(incoming.factors[:n], first.q).real
    if damped.is_none:
        is_running = np.arange(most) < modes[:, :1]
        _require_balance(hertz, transmitted + reflected - is_running)
    count = np.maximum(modes[:, 0], 1)
    layers = operator.balls.size / first.space.per_layer
    return Transmission(
        hertz,
        modes,
        transmitted.sum(axis=1) / count,
        reflected.sum(axis=1) / count,
        transmitted,
        reflected,
        amplitudes,
        wavenumbers,
        layers * first.space.height,
        damped.find_warnings(float(hertz[-1])),
    )


def _require_strip(operator: WaveOperator, leads: Sequence[_Lead]) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless the balls of a strip move as those of
    the leads, and its static forces have a potential.
    """
    strip = operator.network
    motions = [operator.motions, *(lead.space.motions for lead in leads)]
    if len({(kind.name, kind.letters) for kind in motions}) > 1:
        fault = "the motions of the balls differ between the leads and the strip"
        raise InputError(
            fault, "A wave would have no motion to go on with", "Use the same motions, and friction"
        )
    if strip.prestress and strip.tangential_force is not None and np.any(strip.tangential_force):
        raise InputError(
            "the strip has static tangential forces", "With prestress, they have no potential"
        )


def _make_matrices(
    operator: WaveOperator, damped: ContactDamping, q: Array
) -> Callable[[float], Any]:
    """Return the function that gives the stiffness of a strip, (rad/s)^2, sparse, at an angular
    frequency, rad/s, for the wave vector ``q`` (p,) along its layers, in fractions.
    """
    phase = np.exp(2.0j * np.pi * (operator.network.shift[:, : len(q)] @ q))
    springs = operator.weigh(None, phase).tocsc()
    if damped.is_none:
        return lambda w: springs
    losses = operator.weigh(damped.losses, phase).tocsc()
    dashpots = operator.weigh(damped.times, phase).tocsc()
    return lambda w: springs + -1j * losses + -1j * w * dashpots


def _stack_matrices(matrices: Sequence[Complex], size: int) -> Complex:
    """Return matrices (n, m) of numbers of waves n and m up to ``size`` as one array (n_f, size,
    size), with zeros behind.
    """
    stacked = np.zeros((len(matrices), size, size), complex)
    for number, matrix in enumerate(matrices):
        n, m = matrix.shape
        stacked[number, :n, :m] = matrix
    return stacked


def _require_balance(hertz: Array, excess: Array) -> None:
    """Raise :class:`~granphon.base.errors.PrecisionError` if the energies that waves bring back and
    through differ from those that came by an ``excess`` (n_f, m), over what came, of more than
    rounding.
    """
    imbalance = np.max(np.abs(excess), axis=1, initial=0.0)
    if not np.any(imbalance > _BALANCED):
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


@dataclass(frozen=True, eq=False, repr=False)
class ScatteringLengths(Result):
    """How far waves go in disordered strips; arrays over frequencies (n_f,), and over the waves
    that run in (n_f, m).

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    mean_free_path, mean_free_path_error : (n_f, m) l, m, of the coherent wave: the squared size of
        the mean amplitude falls as exp(-L/l). Infinite where it does not fall; zero beyond the
        waves that run. An error is infinite where only the shortest strips let a wave be seen.
    localisation_length, localisation_length_error : (n_f,) xi, m: the mean of ln(total) falls as -2
        L/xi (P. W. Anderson et al., Phys. Rev. B 22, 3519, 1980). Infinite where it does not fall.
    """

    frequencies: Annotated[Array, "f", "Hz"]
    mean_free_path: Annotated[Array, "f m", "m"]
    mean_free_path_error: Annotated[Array, "f m", "m"]
    localisation_length: Annotated[Array, "f", "m"]
    localisation_length_error: Annotated[Array, "f", "m"]


def scattering_lengths(runs: Sequence[Transmission]) -> ScatteringLengths:
    """Fit mean free paths and localisation lengths to transmissions through strips of several
    lengths.

    ``runs`` are of the same leads and frequencies, for each length at least two samples. E
    exp(-L/l) is fitted to the squared sizes of mean amplitudes, less the variance of the means,
    with weights from the fitted fall and from the noise of all lengths together. A line is fitted
    to the means of ln(total), with the weights of variances that grow as the length, too. Weights
    from the scatter at each length would favour lengths whose scatter is small by chance, and make
    errors too small. Errors are standard errors, from the scatter over the samples of each length.

    Raises :class:`~granphon.base.errors.InputError` for fewer than two lengths, or two samples of a
    length; for other frequencies or numbers of waves; and where nothing is transmitted.
    """
    _require_alike(runs)
    first = runs[0]
    lengths, number_of_run = np.unique([run.length for run in runs], return_inverse=True)
    samples = np.bincount(number_of_run)
    if len(lengths) < 2 or samples.min() < 2:
        fault = f"there are {len(lengths)} lengths, with {samples.min()} samples or more"
        raise InputError(fault, "A fall and its error need two of each", "Give more runs")
    # (runs, n_f, m)
    through = np.array([np.diagonal(run.amplitudes, axis1=1, axis2=2) for run in runs])
    total = np.array([run.total for run in runs])
    is_open = np.arange(through.shape[2]) < first.modes.min(axis=1)[:, None]
    has_open = np.any(is_open, axis=1)
    if np.any(total[:, has_open] <= 0.0) or not np.all(has_open):
        raise InputError(
            "nothing is transmitted at some frequency", mend="Leave out frequencies of gaps"
        )
    # the runs of each length
    groups = [np.flatnonzero(number_of_run == number) for number in range(len(lengths))]
    falls = []
    for frequency, wave in np.argwhere(is_open):
        amplitudes = [through[group][:, frequency, wave] for group in groups]
        falls.append(_fit_energy(lengths, amplitudes))
    rate, rate_error = np.array(falls).T
    path = np.zeros(is_open.shape)
    path_error = np.zeros(is_open.shape)
    path[is_open], path_error[is_open] = _invert(rate, rate_error, 1.0)
    fall, fall_error = _fit_logarithms(lengths, [np.log(total[group]) for group in groups])
    length, length_error = _invert(fall, fall_error, 2.0)
    return ScatteringLengths(first.frequencies, path, path_error, length, length_error)


def _require_alike(runs: Any) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless ``runs`` are transmissions with the
    same frequencies and waves.
    """
    is_list = isinstance(runs, Sequence) and all(isinstance(run, Transmission) for run in runs)
    if not is_list or len({run.amplitudes.shape for run in runs}) != 1:
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
    """Return the rate at which the mean of ln(total) falls over the ``lengths``, m, and its error,
    1/m, (n_f,).

    ``logs`` are ln(total) of the samples of each length, (samples, n_f).
    """
    counts = np.array([len(values) for values in logs])
    # the variance of ln(total) grows as the length
    shares = _fit_slope(lengths, counts / lengths)
    fall = -np.tensordot(shares, [values.mean(axis=0) for values in logs], 1)
    scatter = [np.var(values, axis=0, ddof=1) / len(values) for values in logs]
    return fall, np.sqrt(np.tensordot(shares**2, scatter, 1))


def _invert(rate: Array, error: Array, factor: float) -> tuple[Array, Array]:
    """Return the length ``factor`` over the rate of a fall, and its error; infinite where nothing
    falls.
    """
    falls = rate > 0.0
    length = np.divide(factor, rate, out=np.full(rate.shape, np.inf), where=falls)
    relative_error = np.divide(error, rate, out=np.full(rate.shape, np.inf), where=falls)
    return length, length * relative_error


def _fit_slope(x: Array, weights: Array) -> Array:
    """Return the shares (n,) of values at ``x`` (n,) in the slope of the line that is fitted to
    them with these weights.
    """
    offsets = x - np.average(x, weights=weights)
    return np.asarray(weights * offsets / np.sum(weights * offsets**2))


def _fit_energy(lengths: Array, amplitudes: list[Complex]) -> tuple[float, float]:
    """Return the rate at which the squared size of the mean of ``amplitudes`` falls over the
    lengths, 1/m, and its error.

    The squared size less the variance of the mean has the mean E exp(-rate L), whatever the number
    n of samples. It is a U statistic (W. Hoeffding, Ann. Math. Stat. 19, 293 (1948)), with the
    variance 4 a E/n + 2 |C|^2/(n (n - 1)), where C are the covariances of real and imaginary parts,
    and a is the variance along the mean. For weights C is that of all lengths together, the same in
    all directions; for the error C is that at each length. Both take E from the fit, which is
    repeated until it does not change (quasi-likelihood). Where the fit goes on to change, the
    signal is above the noise at the least length alone, and the error is infinite.
    """
    count = np.array([len(values) for values in amplitudes], float)
    mean = np.array([values.mean() for values in amplitudes])
    spread = _find_covariances(amplitudes, mean)
    noise = np.trace(spread, axis1=1, axis2=2)
    common = 0.5 * float(np.average(noise, weights=count - 1.0))
    square = np.abs(mean) ** 2
    energy = square - noise / count
    pairs = count * (count - 1.0)
    offsets = lengths - np.average(lengths, weights=count)
    level, rate = _fit_line(lengths, offsets, square, count)
    size = float(np.ptp(lengths))
    for _ in range(_ROUNDS):
        fitted = np.exp(np.clip(level - rate * offsets, -_FAR, _FAR))
        # derivatives of the fitted energies by level and rate
        slopes = np.stack([fitted, -fitted * offsets / size])
        weight = 1.0 / (fitted / count + common / pairs)
        matrix = slopes * weight @ slopes.T
        if np.linalg.det(matrix) <= _SINGULAR * matrix[0, 0] * matrix[1, 1]:
            break
        shares = np.linalg.solve(matrix, slopes * weight)
        change = shares @ (energy - fitted)
        change /= max(1.0, float(np.max(np.abs(change))))
        level = level + float(change[0])
        rate = rate + float(change[1]) / size
        if np.max(np.abs(change)) < _SETTLED:
            noise_squares = np.sum(spread**2, axis=(1, 2))
            variance = 4.0 * spread[:, 0, 0] * fitted / count + 2.0 * noise_squares / pairs
            return rate, math.sqrt(float(shares[1] ** 2 @ variance)) / size
    return rate, math.inf


def _find_covariances(amplitudes: Sequence[Complex], mean: Complex) -> Array:
    """Return the covariances of the parts of amplitudes along and across their ``mean`` (lengths,),
    (lengths, 2, 2).
    """
    covariances = []
    for values, middle in zip(amplitudes, mean, strict=True):
        turned = values * np.conj(middle) / (abs(middle) or 1.0)
        covariances.append(np.cov(turned.real, turned.imag))
    return np.array(covariances)


def _fit_line(lengths: Array, offsets: Array, square: Array, count: Array) -> tuple[float, float]:
    """Return the level, a logarithm, and the rate, 1/m, at which a fit begins: those of the line
    through the logarithms of the squared means.

    ``offsets`` are those of the lengths from their mean, m; ``square`` is the squared mean of each
    length, and ``count`` its number of samples, all (lengths,).
    """
    rate = 0.0
    level = -_FAR
    is_above = square > 0.0
    if np.count_nonzero(is_above) > 1:
        shares = _fit_slope(lengths[is_above], (count * square)[is_above])
        rate = -float(shares @ np.log(square[is_above]))
    if is_above.any():
        weights = count * np.exp(-np.clip(rate * offsets, -_FAR, _FAR))
        level = math.log(np.average(square, weights=weights))
    return level, rate


class _Lead(NamedTuple):
    """A half-infinite crystal; the wave vector along its layers, and its blocks, (rad/s)^2."""

    space: HalfSpace
    q: Array
    blocks: Couplings

    @classmethod
    def of(cls, source: Any, axis: Any, q: ArrayLike) -> _Lead:
        """Return the lead of a state or network; the arguments are those of
        :func:`transmission`.
        """
        space = HalfSpace(given_network(source), axis)
        along = space.read_wavevector(q)
        square = (2.0 * np.pi * space.units.frequency) ** 2
        blocks = [square * couplings for couplings in space.couplings(along)]
        return cls(space, along, Couplings(*blocks))

    def find_waves(self, omega: Array) -> Sequence[tuple[BlochWaves, BlochWaves]]:
        """Return the waves at each angular frequency (n_f,), rad/s: those towards higher layers,
        and those towards lower ones.
        """
        motions_of_layer = self.space.size // self.space.reach
        return find_bloch_waves(self.blocks, omega**2, motions_of_layer)

    def fit(self, operator: WaveOperator, lower: bool) -> Any:
        """Return S (size, size of the strip), sparse: the motions that a block of the lead has at
        an end of the strip.

        Balls of the strip are sought where those of a block would stand. They have masses and
        inertias of their own.
        """
        strip = operator.network
        misfit = f"the strip does not fit to the {'first' if lower else 'other'} lead"
        periods = strip.cell[np.flatnonzero(strip.pbc)][:, : strip.dimension]
        self._require_periods(periods, misfit)
        size = self.space.size // operator.motions.count
        if len(operator.balls) >= size:
            self._require_free_end(strip, operator.balls, lower, misfit)
            matches = self._match_block(operator, periods, lower)
            if matches is not None:
                return self._compose_end(operator, *matches)
        why = f"Its outer balls do not stand where {size} balls of the lead's layers would"
        raise InputError(misfit, why, "Begin and end it with layers like the lead's")

    def _require_periods(self, periods: Array, misfit: str) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless the ``periods`` (p, d) of a strip,
        m, are those of the lead along its layers.
        """
        cell = self.space.layers.cell
        tolerance = _SAME_PERIOD * np.max(np.abs(cell), initial=0.0)
        has_period = periods.shape == cell.shape
        if not has_period or np.any(np.abs(periods - cell) > tolerance):
            why = "It must repeat along the layers as the lead does, and not across them"
            raise InputError(
                misfit, why, "Give lead.cut(axis, layers), or a strip of the same width"
            )

    def _find_block(self, motions: int) -> Index:
        """Return the balls of the first block of the lead, which have so many ``motions`` each."""
        return np.flatnonzero(self.space.cut.moving)[: self.space.size // motions]

    def _match_block(
        self, operator: WaveOperator, periods: Array, lower: bool
    ) -> tuple[Index, Array] | None:
        """Return the balls (block,) of the strip that stand where those of a block would, at its
        ``lower`` or upper end, and the cells (block, p) of the strip in which they stand; None if
        there are none.
        """
        strip = operator.network
        cut = self.space.cut
        block = self._find_block(operator.motions.count)
        size = block.size
        p = len(periods)
        height = strip.positions[operator.balls, p]
        order = np.argsort(height if lower else -height, kind="stable")
        near = operator.balls[order[:size]]
        places = strip.positions[near]
        sites = cut.positions[block]
        distances, cells = _measure_sites(places, sites - sites[0], periods)
        nearest = np.argmin(distances, axis=2)  # (first, block)
        worst = np.min(distances, axis=2).max(axis=1)
        is_shared = [np.unique(balls).size < size for balls in nearest]
        worst[is_shared] = np.inf
        # of several fits, as where two kinds of balls alternate, the one that leaves the frame of
        # the lead unchanged
        moved = self._find_moves(places - sites[0], periods)
        most = _SAME_SITE * float(2.0 * np.mean(cut.radii[block]))
        first = int(np.argmin(np.where(worst <= most, moved, np.inf)))
        if worst[first] > most:
            return None
        return near[nearest[first]], cells[first, np.arange(size), nearest[first]]

    def _find_moves(self, vectors: Array, periods: Array) -> Array:
        """Return how far ``vectors`` (n, d), m, are from the nearest steps of the frame of the
        lead: the ``periods`` (p, d) and the step from layer to layer.
        """
        p = len(periods)
        frame = np.concatenate([periods, self.space.layers.stack[None]])[:, : p + 1]
        steps = vectors[:, : p + 1] @ np.linalg.inv(frame)
        return np.asarray(np.linalg.norm((steps - np.rint(steps)) @ frame, axis=1))

    def _compose_end(self, operator: WaveOperator, balls: Index, cells: Array) -> Any:
        """Return S, sparse, for the ``balls`` (block,) of the strip, and the ``cells`` (block, p)
        in which they stand in the places of a block.
        """
        from scipy.sparse import csr_array

        strip = operator.network
        cut = self.space.cut
        count = operator.motions.count
        block = self._find_block(count)
        ratio = np.sqrt(cut.masses[block] / strip.masses[balls])
        turn = np.sqrt(cut.inertias[block] / strip.inertias[balls])
        scale = np.where(operator.motions.is_rotation, turn[:, None], ratio[:, None])
        entries = scale * np.exp(-2.0j * np.pi * (cells @ self.q))[:, None]
        first_columns = np.searchsorted(operator.balls, balls)[:, None] * count
        columns = first_columns + np.arange(count)
        rows = np.arange(block.size * count)
        shape = (self.space.size, operator.size)
        return csr_array((entries.ravel(), (rows, columns.ravel())), shape=shape)

    def _require_free_end(
        self, strip: ContactNetwork, balls: Index, lower: bool, misfit: str
    ) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if a floor or clamped balls lie beyond
        the ``balls`` that move.
        """
        p = len(self.space.layers.cell)
        cut = self.space.cut
        block = self._find_block(strip.ball_motions.count)
        diameter = float(2.0 * np.mean(cut.radii[block]))
        heights = strip.positions[:, p] * (-1.0 if lower else 1.0)
        beyond = heights - heights[balls].max()
        least = np.where(np.isinf(strip.radii), 0.0, 0.6 * diameter)
        if np.all(self.space.network.moving) and np.any(~strip.moving & (beyond > least)):
            raise InputError(
                misfit, "A floor or clamped balls stand between them", "Cut it with free edges"
            )


def _measure_sites(places: Array, sites: Array, periods: Array) -> tuple[Array, Array]:
    """Return the distances (first, block, n) of balls at ``places`` (n, d) from the ``sites``
    (block, d) of a block that begins at each of the balls, to their nearest images, m; and the
    cells (first, block, n, p) of these images.
    """
    p = len(periods)
    vectors = places[None, None] - sites[None, :, None] - places[:, None, None]
    cells = np.rint(vectors[..., :p] @ np.linalg.inv(periods[:, :p]))
    vectors[..., :p] -= cells @ periods[:, :p]
    return np.linalg.norm(vectors, axis=-1), cells


def _scatter(
    w: float,
    matrix: Any,
    leads: list[_Lead],
    ends: list[Any],
    waves: Sequence[tuple[BlochWaves, BlochWaves]],
) -> tuple[Complex, Complex]:
    """Return the amplitudes of waves that are sent back (m, m), and that pass (n, m), at w =
    omega^2, (rad/s)^2.

    ``matrix`` is the stiffness of the strip; ``ends`` are the motions that blocks of the leads have
    at its ends, and ``waves`` those of each lead towards higher and towards lower layers.
    """
    from scipy.sparse import csc_array, eye_array

    first, last = leads
    lower, upper = ends
    (come, leave), (go, _) = waves
    first_blocks = first.blocks
    last_blocks = last.blocks
    reach = first.space.reach
    further = last.space.reach
    # Green's functions of the outer blocks of the leads, with their contacts to the strip
    inner = w * np.eye(first.space.size) - first_blocks.inner
    back = np.linalg.inv(inner - first_blocks.down @ leave.continue_by(-reach))
    inner = w * np.eye(last.space.size) - last_blocks.inner
    ahead = np.linalg.inv(inner - last_blocks.up @ go.continue_by(further))
    held = [
        first_blocks.head + first_blocks.down @ back @ first_blocks.up,
        last_blocks.tail + last_blocks.up @ ahead @ last_blocks.down,
    ]
    for end, block in zip(ends, held, strict=True):
        matrix = matrix + end.conj().T @ csc_array(block) @ end
    shape = come.vectors[:, : come.running]
    factor = come.factors[: come.running] ** reach
    pushed = first_blocks.up @ shape * factor
    drive = lower.conj().T @ (first_blocks.down @ (shape - back @ pushed))
    factors = factorise(w * eye_array(matrix.shape[0]) - matrix, symmetric=False)
    moved = factors.solve(np.asarray(drive, complex))
    sent = leave.find_parts(back @ (first_blocks.up @ (lower @ moved) - pushed))
    return sent, go.find_parts(ahead @ (last_blocks.down @ (upper @ moved)))
