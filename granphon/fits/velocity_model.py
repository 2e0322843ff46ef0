"""Sound velocities as a function of a packing's parameters, with derivatives: what a fit to
measured velocities needs.

In the paper's limit v is proportional to d (k/M)^(1/2), where k = c W^(1/2) k*(f/c W^(3/2)), k* is
a function of the reduced force f* = f/c W^(3/2) alone, and c is proportional to E d^(1/2). With nu,
the local exponent d log v / d log f that every state knows, the derivatives d log v / d log p are
exactly 1/4 - 3 nu/2 for the width, 1/2 - nu for the Young modulus and -1/4 - nu/2 for the diameter.
In the ideal lattice, where nu = 1/6, they are 0, 1/3 and -1/3: its velocities do not depend on the
width.

A simulation scales in the same way, so that its samples give one curve, which serves all widths.
The curve is interpolated, because each contact that opens puts a cusp into the moduli of a sample,
which is small but may have any slope. Three things do not scale: the exact geometry of contacts,
where k* depends on W/d too, a history that starts at a load in SI units, and the torsion of a Hertz
contact. The curve is then that of one packing, and the fit makes it anew at the packing it finds.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from granphon.balls.diameters import Spread, Uniform
from granphon.balls.hertz import EXPONENT
from granphon.balls.loads import Load
from granphon.balls.packing import MINDLIN, Packing, change_packing
from granphon.base.arrays import Array
from granphon.base.errors import InputError, UnreachableFrequencyError
from granphon.base.results import Result, held, result_class
from granphon.base.scales import write_quantity
from granphon.base.text import suggest
from granphon.base.validation import one_of, positive, require, truth
from granphon.dynamics.branches import follow_acoustic_branches
from granphon.media.choice import MediumChoice, require_finite_overlap
from granphon.media.medium import AveragedLattice
from granphon.media.state import ContactState, ideal_lattice
from granphon.observables.velocities import local_exponent, pulse_velocities

#: the branches whose velocities may be fitted; the last two take the place of the second where
#: there are two of them
_BRANCHES = ("longitudinal", "transverse", "transverse_slow", "transverse_fast")
#: d log v / d log p of long waves for each parameter p: a constant, and the factor of the local
#: exponent that is added to it
VARIABLE: Mapping[str, tuple[float, float]] = {
    "width": ((EXPONENT - 1.0) / 2.0, -EXPONENT),
    "young_modulus": (0.5, -1.0),
    "diameter": ((1.0 - EXPONENT) / 2.0, EXPONENT - 2.0),
}
#: step in the logarithm of a parameter, from which derivatives are found where overlap is finite
_STEP = 1e-4
#: distance in log f* between the equilibria of a simulation: eight to a decade
_NODE_SPACING = math.log(10.0) / 8.0
#: width over diameter at which the curve of samples is made where any will do
_WIDTH_RATIO = 1e-4
#: change in the logarithm of a parameter that a curve need not follow: in the exact geometry such a
#: change of W/d changes velocities at a given f* by less than 1e-4 of them, and the curve itself
#: has errors of 2e-4
_CURVE_TOLERANCE = 1e-3
#: relative correction of a squared velocity below which a stiffness is not corrected again
_LEAST_CORRECTION = 1e-12
#: most corrections of a stiffness: one is exact in the paper's limit; where the forces of contacts
#: act too, each correction leaves about delta/d of the error
_MOST_CORRECTIONS = 10
#: relative step in the frequency of a pulse, from which the slope of its velocity is found
_FREQUENCY_STEP = 1e-4


@result_class
class Waves(Result):
    """The waves whose velocity is measured.

    Attributes
    ----------
    branch : "longitudinal" or "transverse"; in space "transverse_slow" or "transverse_fast" instead
        of the latter.
    direction : direction of propagation, a unit vector (p,).
    frequency : frequency of the pulses, Hz, one number or one for each load; None for long waves.
    finite_overlap : whether terms of relative order delta/d are kept.

    Raises :class:`~granphon.base.errors.InputError` for another branch, and for a
    ``finite_overlap`` that is not true or false.
    """

    branch: str = held(str)
    direction: Array = held(float, "p")
    frequency: Any = held(Any, "...?", "Hz")
    finite_overlap: bool = held(bool)

    def __post_init__(self) -> None:
        """Check the branch, and that ``finite_overlap`` is a truth value."""
        one_of("branch", self.branch, _BRANCHES)
        require("finite_overlap", truth, self.finite_overlap)
        super().__post_init__()

    def find_tops(self, state: ContactState) -> Array:
        """Return the highest frequency, Hz, of a pulse on the branch at each of the n loads of a
        ``state``, (n,).
        """
        # in the paper's limit one dispersion relation serves all loads
        is_shared = state.has_one_lattice
        states = [state] if is_shared else [state[n] for n in range(len(state.force))]
        tops = []
        for state_at_load in states:
            branches = follow_acoustic_branches(state_at_load.contact_lattice(), self.direction)
            tops.append(branches[self.branch].top)
        reduced_tops = np.array(tops)[0] if is_shared else np.array(tops)
        # the branches of a lattice are angular frequencies in units of (k/M)^(1/2)
        rates = np.sqrt(state.normal_stiffness) / np.sqrt(state.packing.mass)
        return np.asarray(reduced_tops * rates / (2.0 * np.pi))

    def velocity(self, state: ContactState) -> tuple[Array, Array]:
        """Return the velocity at each load of a ``state``, m/s, of long waves or of pulses (group),
        and d log v / d log frequency, 0 for long waves; both have the shape of the loads.
        """
        if self.frequency is None:
            wave = state.wave_names.index(self.branch)
            velocities = np.asarray(state.long_waves(self.direction)[..., wave])
            return velocities, np.zeros(velocities.shape)
        # the steps, (3, ...) for any shape of loads, lead to lower frequencies, where the branch is
        # sure to exist
        steps = np.array([0.0, _FREQUENCY_STEP, 2.0 * _FREQUENCY_STEP])
        steps = np.expand_dims(steps, tuple(range(1, 1 + len(state.shape))))
        frequencies = self.frequency * (1.0 - steps)
        pulses = pulse_velocities(state, frequencies, self.direction, branches=self.branch)
        velocities, one_step, two_steps = pulses.group[0]
        # the one-sided difference of second order
        difference = 1.5 * velocities - 2.0 * one_step + 0.5 * two_steps
        return velocities, difference / (_FREQUENCY_STEP * velocities)


@dataclass(frozen=True)
class _WidenedSpread(Spread):
    """The distribution ``source`` at another width; its shape is the same to the last bit, so that
    one curve serves all.
    """

    width: float = field()
    source: Spread = field()

    @property
    def rms(self) -> float:
        """Root mean square deviation Delta_rms of the diameters, m."""
        return self.width / math.sqrt(12.0)

    @property
    def shape(self) -> Any:
        """Shape of the source."""
        return self.source.shape

    def _compute_deviations(self, probability: Array) -> Array:
        """Return the deviations of the source at these values of the cumulative ``probability``
        (...), m, times the ratio of the widths. Those of a long list of diameters are taken from
        the list itself, which its shape condenses.
        """
        if not self.source.width:
            return super()._compute_deviations(probability)
        return self.width * (self.source._compute_deviations(probability) / self.source.width)


class _SampleCurve:
    """The stiffness of a regular lattice in which long ``waves`` have the velocity that they have
    in simulated samples.

    The curve is log(k/(c W^(1/2))) as a function of log f*: k is the stiffness, W the width, and
    c W^(1/2) the unit of stiffness of the samples (``width_units``). The curve goes through
    equilibria at fixed f*, which are solved when they are first needed. Between them it is a cubic
    polynomial, with slopes from four neighbours. The cusps that it leaves out change the velocity
    of 64 x 64 balls by 2e-4 (rms, f* > 0.05), less for more balls. Samples of that size differ by
    more.
    """

    def __init__(self, packing: Packing, choice: MediumChoice, waves: Waves) -> None:
        """Set up the curve of samples of the ``packing`` that the ``choice`` simulates; nothing is
        simulated before a call.
        """
        self.medium = choice.of(packing)
        self.waves = replace(waves, frequency=None)
        # values of the curve by node, a multiple of the spacing
        self._values: dict[int, float] = {}

    def __call__(self, logs: Array) -> tuple[Array, Array]:
        """Return the curve, log(k/(c W^(1/2))), and its slope by log f*, both (n,), at the
        logarithms ``logs`` of f*, (n,). Nodes of the curve that have not been solved yet are
        simulated.
        """
        cell, fraction = np.divmod(logs / _NODE_SPACING, 1.0)
        # (n, 6): two nodes below the cell of each, the two ends of the cell, and two above
        nodes = cell.astype(int)[:, None] + np.arange(-2, 4)
        unsolved = sorted(set(nodes.ravel().tolist()) - set(self._values))
        if unsolved:
            self._values.update(zip(unsolved, self._solve(unsolved), strict=True))
        rows = [[self._values[node] for node in row] for row in nodes.tolist()]
        y = np.array(rows).T  # (6, n): the values at these nodes
        # slopes at the two ends of the cell, per cell, by central differences of fourth order
        slope_below = (y[0] - 8.0 * y[1] + 8.0 * y[3] - y[4]) / 12.0
        slope_above = (y[1] - 8.0 * y[2] + 8.0 * y[4] - y[5]) / 12.0
        # the cubic polynomial in the fraction of the cell with these slopes
        rise = y[3] - y[2]
        bend = 3.0 * rise - 2.0 * slope_below - slope_above
        twist = slope_below + slope_above - 2.0 * rise
        value = y[2] + fraction * (slope_below + fraction * (bend + fraction * twist))
        slope = slope_below + fraction * (2.0 * bend + 3.0 * fraction * twist)
        return value, slope / _NODE_SPACING

    def _solve(self, nodes: list[int]) -> list[float]:
        """Return the values of the curve at ``nodes``, log f* in units of their spacing, by
        equilibria of samples.

        The stiffness of the regular lattice is corrected until its long waves have the velocity
        that they have in the samples, but at most ten times.
        """
        packing = self.medium.packing
        force = np.exp(_NODE_SPACING * np.array(nodes)) * packing.width_units.force
        state = self.medium.at_force(force)
        velocities, _ = self.waves.velocity(state)
        regular_state = _make_regular_state(packing, force, self.waves.finite_overlap)
        stiffness = np.asarray(state.normal_stiffness)
        for _ in range(_MOST_CORRECTIONS):
            corrected_state = replace(regular_state, normal_stiffness=stiffness)
            regular_velocities, _ = self.waves.velocity(corrected_state)
            ratio = (velocities / regular_velocities) ** 2
            stiffness = stiffness * ratio
            if np.max(np.abs(ratio - 1.0)) < _LEAST_CORRECTION:
                break
        values: list[float] = np.log(stiffness / packing.width_units.stiffness).tolist()
        return values


def require_fitted(names: Sequence[str], known: Collection[str]) -> None:
    """Raise :class:`InputError` unless ``names``, of parameters to be fitted, are one or more of
    those ``known``, each at most once.
    """
    for name in names:
        if name not in known:
            raise InputError(f"{name!r} cannot be fitted", mend=suggest(str(name), known))
    if not names or len(set(names)) < len(names):
        raise InputError(f"the parameters are {names}", mend="Give one or more, each at most once")


def _make_regular_state(packing: Packing, force: Array, finite_overlap: bool) -> ContactState:
    """Return the state of the regular lattice of a ``packing``, whose contacts all carry the same
    ``force``, N, at each of the forces (n,), with or without ``finite_overlap``.
    """
    return AveragedLattice(packing).at_force(force, finite_overlap=finite_overlap)


@dataclass(frozen=True)
class VelocityModel:
    """Velocities at given forces (n,) in a medium, as a function of the logarithms of some
    parameters of the packing.

    ``names`` (p,) are those of the parameters, from :data:`VARIABLE`; where the width is not one of
    them the packing keeps its own. ``curve_at`` are the logarithms of the parameters at which
    samples are simulated; by default they are the packing's own, but for the width where one curve
    serves all widths, or where the balls are equal. Raises :class:`InputError` for other names, or
    if the medium does not exist for the packing or with finite overlap, or the lattice has no such
    waves.
    """

    packing: Packing
    names: tuple[str, ...]
    choice: MediumChoice
    force: Array
    waves: Waves
    curve_at: Array | None = None

    def __post_init__(self) -> None:
        """Check that the parameters can be fitted, and that the medium and the lattice have what
        the fit asks of them.
        """
        require_fitted(self.names, VARIABLE)
        if self.waves.finite_overlap:
            require_finite_overlap([self.choice])
        self.choice.of(self._packing_of_samples if self.choice.is_exact else self.packing)
        branches = [name for name in ideal_lattice(self.packing).wave_names if name in _BRANCHES]
        if self.waves.branch not in branches:
            fault = f"the {self.packing.structure.name} lattice has no {self.waves.branch} wave"
            mend = f"Use {' or '.join(branches)}" if branches else "Use other motions"
            raise InputError(fault, mend=mend)

    @property
    def width_index(self) -> int | None:
        """Index of the width among the parameters; None if it is not fitted."""
        return self.names.index("width") if "width" in self.names else None

    def find_start(self, width: float) -> Array:
        """Return the logarithms (p,) of the parameters of the packing, in which ``width``, m, takes
        the place of its own width.
        """
        values = {
            "width": width,
            "young_modulus": self.packing.material.young_modulus,
            "diameter": self.packing.diameter,
        }
        return np.log([values[name] for name in self.names])

    def find_nearly_equal(self) -> Array:
        """Return the logarithms (p,) of the packing's own parameters, but for the width: if that is
        one of them, it is 1e-9 of the diameter, as a width of zero has no logarithm.
        """
        return self.find_start(1e-9 * self.packing.diameter)

    def settle_geometry(self, logs: Array) -> VelocityModel:
        """Return the model with one geometry for its samples: that at the logarithms ``logs`` (p,)
        of the parameters, exact if the geometry is exact at one of the forces. The settings of the
        waves have finite overlap where the geometry has.
        """
        packing = self._make_packing(logs)
        load = Load("force", self.force)
        choice = self.choice.settle(packing, load, self.waves.finite_overlap)
        finite_overlap = choice.has_finite_overlap(packing, self.waves.finite_overlap)
        return replace(
            self, choice=choice, waves=replace(self.waves, finite_overlap=finite_overlap)
        )

    @property
    def is_sampled(self) -> bool:
        """Whether velocities follow from a curve through samples at some loads, as samples at the
        load of each datum would take long.
        """
        return self.choice.stand_in != self.choice

    @property
    def _has_one_curve(self) -> bool:
        """Whether one curve of samples, in reduced units, serves all widths, moduli and
        diameters.
        """
        starts_at_load = isinstance(self.choice.settings.get("start"), Load)
        return not (self.choice.is_exact or starts_at_load or self.packing.torsion == MINDLIN)

    def simulate_at(self, logs: Array) -> VelocityModel:
        """Return the model whose samples are those at the logarithms ``logs`` (p,) of the
        parameters; this model itself if its samples serve there.
        """
        if not self.is_sampled or self._has_one_curve:
            return self
        if self.curve_at is not None and np.max(np.abs(logs - self.curve_at)) <= _CURVE_TOLERANCE:
            return self
        return replace(self, curve_at=logs)

    def find_tops(self, logs: Array) -> Array:
        """Return the highest frequency (n,), Hz, that a pulse can have at each force, if ``logs``
        (p,) are the logarithms of the parameters.
        """
        state, _ = self._find_state(self._make_packing(logs))
        return self.waves.find_tops(state)

    @property
    def equal_balls(self) -> VelocityModel:
        """The same model of equal balls, the stiffest: their sound is fastest, and their branches
        reach highest.
        """
        return replace(self, choice=MediumChoice(AveragedLattice.name))

    def require_carried(self) -> None:
        """Raise UnreachableFrequencyError if equal balls, with the packing's own Young modulus and
        diameter, do not carry one of the pulses: with any spread they do not carry that pulse
        either, and a fit of modulus or diameter has no velocity to start from.
        """
        if self.waves.frequency is None:
            return
        logs = self.find_nearly_equal()
        beyond = int(np.sum(self.waves.frequency >= self.equal_balls.find_tops(logs)))
        if beyond:
            fault = f"the balls do not carry the frequency of {beyond} of {len(self.force)} data"
            why = (
                f"{self.equal_balls.describe_nearest_to_top(logs)}, and any spread of diameters"
                f" lowers that"
            )
            mend = "Check the frequency (Hz)"
            if "young_modulus" in self.names:
                mend += ", or start the fit from a higher Young modulus"
            elif "diameter" in self.names:
                mend += ", or start the fit from a smaller diameter"
            raise UnreachableFrequencyError(fault, why, mend)

    def describe_nearest_to_top(self, logs: Array) -> str:
        """Return in words the pulse whose frequency is nearest to the top of its branch, or
        farthest above the top, for the logarithms ``logs`` (p,) of the parameters.
        """
        tops = self.find_tops(logs)
        frequencies = np.broadcast_to(self.waves.frequency, tops.shape)
        datum = int(np.argmax(frequencies / tops))
        return (
            f"Datum {datum + 1} has {frequencies[datum]:.6g} Hz at {self.force[datum]:.4g} N, where"
            f" the {self.waves.branch} branch ends at {tops[datum]:.6g} Hz"
        )

    def __call__(self, logs: Array) -> tuple[Array, Array]:
        """Return velocities (n,), m/s, and the derivatives (n, p) of their logarithms by the
        logarithms ``logs`` (p,) of the parameters, with the same samples.

        Raises :class:`~granphon.base.errors.InputError` where the packing, or the medium at these
        forces, has none.
        """
        state, exponent = self._find_state(self._make_packing(logs))
        velocities, power = self.waves.velocity(state)
        # d log v / d log p of long waves is a constant plus a factor times the local exponent
        constants, factors = np.array([VARIABLE[name] for name in self.names]).T
        slopes = constants + np.multiply.outer(exponent, factors)
        if self.waves.finite_overlap:
            slopes = self._find_differences(logs)
        # a pulse has v = s g(nu d/s), with s in proportion to the velocity of long waves and power
        # = d log g / d log nu
        is_diameter = np.array([float(name == "diameter") for name in self.names])
        return velocities, slopes + power[:, None] * (is_diameter - slopes)

    def _find_differences(self, logs: Array) -> Array:
        """Return the derivatives (n, p) of the logarithms of velocities of long waves by the
        logarithms ``logs`` (p,) of the parameters, as central differences.
        """
        long_waves = replace(self.waves, frequency=None)
        columns = []
        for move in _STEP * np.eye(len(logs)):
            low_state, _ = self._find_state(self._make_packing(logs - move))
            high_state, _ = self._find_state(self._make_packing(logs + move))
            low, _ = long_waves.velocity(low_state)
            high, _ = long_waves.velocity(high_state)
            columns.append(np.log(high / low) / (2.0 * _STEP))
        return np.stack(columns, axis=1)

    def _make_packing(self, logs: Array) -> Packing:
        """Return the packing whose parameters have these logarithms (p,); its spread has the same
        shape to the last bit at every width. A parameter beyond all floats, 0 or inf, is refused:
        a width by its spread, others by the packing.
        """
        with np.errstate(over="ignore", under="ignore"):
            values: dict[str, Any] = dict(zip(self.names, np.exp(logs).tolist(), strict=True))
        if "width" in values:
            values["spread"] = self._widen(values.pop("width"))
        elif self.packing.width:
            values["spread"] = self._widen(self.packing.width)
        return change_packing(self.packing, values)

    def _widen(self, width: float) -> _WidenedSpread:
        """Return the spread of the packing at another width, m; InputError for 0 and inf."""
        return _WidenedSpread(positive("width", width, "m"), self.packing.spread or Uniform(0.0))

    def _find_state(self, packing: Packing) -> tuple[ContactState, Array]:
        """Return a state with the long-wave velocities that the medium has on a ``packing`` under
        the loads, and their local exponents d log v / d log f, (n,).

        Where samples are simulated, the state is that of a regular lattice with the stiffness of
        the curve of the samples. If the lowest load is too low for samples, an InputError names the
        lowest datum.
        """
        if not self.is_sampled:
            state = self.choice.of(packing).at_force(
                self.force, finite_overlap=self.waves.finite_overlap
            )
            return state, np.asarray(local_exponent(state))
        regular_state = _make_regular_state(packing, self.force, self.waves.finite_overlap)
        try:
            value, slope = self._curve(np.log(regular_state.reduced_force))
        except InputError as error:
            # the curve asks for loads in ascending order: the first one is the lowest
            if error.load_index != 0:
                raise
            lowest = int(np.argmin(self.force))
            where = (
                f"datum {lowest + 1}, the lowest, is {write_quantity(self.force[lowest], 'N')} at a"
                f" width of {write_quantity(packing.width, 'm', 3)}"
            )
            raise InputError(
                f"{where}, and the curve through simulated loads begins lower: {error}"
            ) from None
        stiffness = packing.width_units.stiffness * np.exp(value)
        # v is proportional to k^(1/2)
        return replace(regular_state, normal_stiffness=stiffness), 0.5 * slope

    @property
    def _packing_of_samples(self) -> Packing:
        """The packing whose samples are simulated."""
        if self.curve_at is not None:
            return self._make_packing(self.curve_at)
        width = _WIDTH_RATIO * self.packing.diameter
        if not self._has_one_curve:
            width = self.packing.width or width
        return change_packing(self.packing, {"spread": self._widen(width)})

    @cached_property
    def _curve(self) -> _SampleCurve:
        """The curve through simulated samples, whose points are solved when they are needed."""
        return _SampleCurve(self._packing_of_samples, self.choice, self.waves)

    def fit_packing(self, logs: Array) -> Packing:
        """Return the packing whose parameters have these logarithms (p,); listed diameters are
        shifted so that their mean is the diameter.
        """
        values = dict(zip(self.names, np.exp(logs).tolist(), strict=True))
        spread = self.packing.spread
        if spread is not None:
            spread = spread.with_mean(values.get("diameter", self.packing.diameter))
        return change_packing(self.packing, values | {"spread": spread})
